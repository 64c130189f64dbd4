//! Which share of particles is found: events of the fitted law are put into the cleaned frames.
//!
//! Charges beyond a threshold Q₀ are taken to follow Q₀ plus an exponential law, spread over pixels
//! as those found are. Its mean is that of the found ones, each weighted by one over the share of
//! its like that is found (Horvitz & Thompson 1952). An event is found where one of its pixels
//! rises beyond what its place in the cleaned frames allows.

use super::hits::Event;

/// Charges of the law that are put in, at the middles of so many parts of equal chance.
const CHARGES: usize = 32;
/// Least share that is taken to be found, so that single events do not count for more than as many
/// as this says.
const LEAST: f64 = 0.02;

/// How the particles of a set are spread over pixels and charge, and where they would be found.
pub struct Completeness<'a> {
    /// For each found event of the larger half, the shares of its charge in its pixels.
    tracks: Vec<Vec<f64>>,
    /// For each stack, how far samples must rise to be events, DN.
    margins: &'a [Vec<f32>],
    /// Q₀ and the mean of the law beyond it, DN.
    law: (f64, f64),
}

impl<'a> Completeness<'a> {
    /// Of events, at least one, with charges beyond `threshold` DN.
    pub fn new(events: &[&Event], margins: &'a [Vec<f32>], threshold: f64) -> Self {
        let mut charges: Vec<f64> = events.iter().map(|e| e.charge_dn).collect();
        charges.sort_unstable_by(f64::total_cmp);
        // Faint ones are found because they lie in one pixel: they do not tell how charge spreads.
        let middle = charges[charges.len() / 2];
        let tracks = events.iter().filter(|e| e.charge_dn >= middle).map(|e| track(e)).collect();
        let mut all = Self { tracks, margins, law: (threshold, 0.0) };
        let (mut sum, mut weights) = (0.0, 0.0);
        for e in events.iter().filter(|e| e.charge_dn > threshold) {
            let weight = 1.0 / all.found(e.stack, e.charge_dn);
            sum += weight * (e.charge_dn - threshold);
            weights += weight;
        }
        all.law.1 = sum / f64::max(weights, 1.0);
        all
    }

    /// The share of the law's events that is found in a stack.
    pub fn of_law(&self, stack: usize) -> f64 {
        let (threshold, mean) = self.law;
        let charge = |i| threshold - mean * libm::log(1.0 - (f64::from(i) + 0.5) / CHARGES as f64);
        (0..CHARGES as u32).map(|i| self.found(stack, charge(i))).sum::<f64>() / CHARGES as f64
    }

    /// The share of the events of a charge, DN, that is found in a stack.
    fn found(&self, stack: usize, charge: f64) -> f64 {
        let margins = &self.margins[stack];
        // The pixels of a track lie in places far apart: their noise is independent anyhow.
        let at =
            |i: usize, k: usize| f64::from(margins[(i + k * margins.len() / 5) % margins.len()]);
        let is_found = |&i: &usize| {
            let track = &self.tracks[i % self.tracks.len()];
            track.iter().enumerate().any(|(k, share)| share * charge > at(i, k))
        };
        let count = (0..margins.len()).filter(is_found).count();
        (count as f64 / margins.len().max(1) as f64).max(LEAST)
    }
}

/// The shares of an event's charge in its pixels.
fn track(e: &Event) -> Vec<f64> {
    let rises = e.samples.iter().map(|&[was, is]| (f64::from(was) - f64::from(is)).max(0.0));
    let rises: Vec<f64> = rises.collect();
    let sum = rises.iter().sum::<f64>().max(1.0);
    rises.into_iter().map(|r| r / sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(stack: usize, charge: u16, pixels: u32) -> Event {
        Event {
            stack,
            frame: 0,
            at: [0, 0],
            pixels: (0..pixels).collect(),
            samples: vec![[100 + charge / pixels as u16, 100]; pixels as usize],
            charge_dn: f64::from(charge),
            peak_dn: f64::from(charge) / f64::from(pixels),
            z: 10.0,
        }
    }

    #[test]
    fn the_share_of_an_exponential_law_beyond_a_limit_is_found() {
        // Every sample of the first stack must rise by 30 DN, of the second by 90; charges of
        // 30 + 60 × Exp(1) in one pixel: of these all and e⁻¹ pass.
        let margins = [vec![30.0; 100], vec![90.0; 100]];
        let n = 400;
        let charge = |i: u32| 30.0 - 60.0 * (1.0 - (f64::from(i) + 0.5) / f64::from(n)).ln();
        let events: Vec<Event> = (0..n).map(|i| event(0, charge(i).round() as u16, 1)).collect();
        let found = Completeness::new(&events.iter().collect::<Vec<_>>(), &margins, 30.0);
        assert!((found.law.1 - 60.0).abs() < 1.0, "{}", found.law.1);
        assert_eq!(found.of_law(0), 1.0);
        // The law is put in at 32 charges.
        assert!((found.of_law(1) - (-1.0f64).exp()).abs() < 1.0 / 32.0);
        // Spread over two pixels, twice the charge is needed: e^(−150/60).
        let events: Vec<Event> = events.iter().map(|e| event(0, e.charge_dn as u16, 2)).collect();
        let found = Completeness::new(&events.iter().collect::<Vec<_>>(), &margins, 30.0);
        let law = found.law.1;
        assert!((found.of_law(1) - (-150.0 / law).exp()).abs() < 1.0 / 32.0);
    }
}
