//! A picture as what each channel of a sensor sees of it.
//!
//! Channel c takes a spectrum ρ for r_c times that of white, r_c = Σ S_c·ρ / Σ S_c·white, S_c what
//! it sees of a value of 1 in each band. Even areas are exact. What is left out of a spectrum, ρ −
//! r_c·white, sums to nothing in the channel; a blur that differs between bands brings out at most
//! half of Σ |S_c·(ρ − r_c·white)|, and at an edge between two spectra at most both halves.

/// What a channel sees of each band, over what it sees of white; none of a channel that sees
/// nothing of white.
pub fn over_white(channel: &[f64], white: &[f64]) -> Option<Vec<f64>> {
    let of_white: f64 = channel.iter().zip(white).map(|(s, w)| s * w).sum();
    (of_white > 0.0).then(|| channel.iter().map(|seen| seen / of_white).collect())
}

/// What the channels of a sensor see, relative to white.
pub struct ChannelPlanes {
    white: Vec<f64>,
    /// What each channel sees of each band, over what it sees of white; none of a channel that
    /// sees nothing of white.
    pub seen: Vec<Option<Vec<f64>>>,
}

impl ChannelPlanes {
    /// Of channels that see so much of a value of 1 in each band, in the unit that makes white
    /// `white`.
    pub fn of(white: &[f64], seen: &[Vec<f64>]) -> Self {
        let seen = seen.iter().map(|channel| over_white(channel, white)).collect();
        Self { white: white.to_vec(), seen }
    }

    /// Components: one for each channel.
    pub fn count(&self) -> usize {
        self.seen.len()
    }

    /// `[channel][component][band]`.
    pub fn curves(&self) -> Vec<Vec<Vec<f64>>> {
        let of_pair = |channel: usize, component: usize| match self.seen[channel] {
            Some(_) if channel == component => self.white.clone(),
            _ => vec![0.0; self.white.len()],
        };
        let of_channel = |c: usize| (0..self.count()).map(|k| of_pair(c, k)).collect();
        (0..self.count()).map(of_channel).collect()
    }

    /// What each channel sees of a spectrum, and the most that is left out at an edge, as a part
    /// of what a channel sees of white.
    pub fn mix(&self, spectrum: &[f64]) -> (Vec<f64>, f64) {
        let mut most = 0.0f64;
        let values = self.seen.iter().map(|channel| {
            let Some(seen) = channel else { return 0.0 };
            let value: f64 = seen.iter().zip(spectrum).map(|(s, v)| s * v).sum();
            let rest = |((s, v), w): ((&f64, &f64), &f64)| (s * (v - value * w)).abs();
            most = most.max(seen.iter().zip(spectrum).zip(&self.white).map(rest).sum());
            value
        });
        (values.collect(), most)
    }
}
