//! Completeness: the share of particles that is detected, by injecting events of the fitted
//! distribution into the corrected frames.
//!
//! Charges above a threshold Q₀ are taken to be Q₀ plus an exponential variate, spread over pixels
//! like those detected. Its mean is that of the detected charges, each weighted by one over the
//! detected share of its like (Horvitz & Thompson 1952). An event is detected where one of its
//! pixels rises above the margin of its place in the corrected frames.

use super::events::Event;

/// Number of charges injected, at the middles of parts of equal probability.
const CHARGES: usize = 32;
/// Smallest share that is assumed to be detected, which limits the weight of a single event.
const MIN_SHARE: f64 = 0.02;

/// How the particles of a set are distributed over pixels and charge, and where they are detected.
pub struct Completeness<'a> {
    /// For each detected event of the larger half, the shares of its charge in its pixels.
    tracks: Vec<Vec<f64>>,
    /// For each stack, how far samples must rise to be events, DN.
    margins: &'a [Vec<f32>],
    /// Q₀, DN.
    threshold: f64,
    /// Mean charge above it, DN.
    mean_excess: f64,
}

impl<'a> Completeness<'a> {
    /// From one or more events; `threshold` is Q₀, DN.
    pub fn new(events: &[&Event], margins: &'a [Vec<f32>], threshold: f64) -> Self {
        let mut charges: Vec<f64> = events.iter().map(|e| e.charge_dn).collect();
        charges.sort_unstable_by(f64::total_cmp);
        // Faint ones are detected because they lie in one pixel; they do not show how charge
        // spreads.
        let middle = charges[charges.len() / 2];
        let tracks = events.iter().filter(|e| e.charge_dn >= middle).map(|e| track(e)).collect();
        let mut all = Self { tracks, margins, threshold, mean_excess: 0.0 };
        let (mut sum, mut weights) = (0.0, 0.0);
        for e in events.iter().filter(|e| e.charge_dn > threshold) {
            let weight = 1.0 / all.detected(e.stack, e.charge_dn);
            sum += weight * (e.charge_dn - threshold);
            weights += weight;
        }
        all.mean_excess = sum / f64::max(weights, 1.0);
        all
    }

    /// The share of all particles that is detected in a stack.
    pub fn of_stack(&self, stack: usize) -> f64 {
        let (threshold, mean) = (self.threshold, self.mean_excess);
        let charge = |i| threshold - mean * libm::log(1.0 - (f64::from(i) + 0.5) / CHARGES as f64);
        (0..CHARGES as u32).map(|i| self.detected(stack, charge(i))).sum::<f64>() / CHARGES as f64
    }

    /// The share of the events of a charge, DN, that is detected in a stack.
    fn detected(&self, stack: usize, charge: f64) -> f64 {
        let margins = &self.margins[stack];
        // The pixels of a track are placed far from each other: their noise is independent anyway.
        let at =
            |i: usize, k: usize| f64::from(margins[(i + k * margins.len() / 5) % margins.len()]);
        let is_detected = |&i: &usize| {
            let track = &self.tracks[i % self.tracks.len()];
            track.iter().enumerate().any(|(k, share)| share * charge > at(i, k))
        };
        let count = (0..margins.len()).filter(is_detected).count();
        (count as f64 / margins.len().max(1) as f64).max(MIN_SHARE)
    }
}

/// The shares of an event's charge in its pixels.
fn track(e: &Event) -> Vec<f64> {
    let rises = e.samples.iter().map(|s| (f64::from(s.from) - f64::from(s.to)).max(0.0));
    let rises: Vec<f64> = rises.collect();
    let sum = rises.iter().sum::<f64>().max(1.0);
    rises.into_iter().map(|r| r / sum).collect()
}

#[cfg(test)]
mod tests {
    use super::super::corrections::Substitution;
    use super::*;

    fn event(stack: usize, charge: u16, pixels: u32) -> Event {
        Event {
            stack,
            frame: 0,
            at: [0, 0],
            pixels: (0..pixels).collect(),
            samples: vec![
                Substitution { from: 100 + charge / pixels as u16, to: 100 };
                pixels as usize
            ],
            charge_dn: f64::from(charge),
            peak_dn: f64::from(charge) / f64::from(pixels),
            z: 10.0,
        }
    }

    #[test]
    fn the_share_of_an_exponential_law_beyond_a_limit_is_detected() {
        // Every sample of the first stack must rise by 30 DN, of the second by 90; charges of
        // 30 + 60 × Exp(1) in one pixel: all of them and e⁻¹ of them are detected.
        let margins = [vec![30.0; 100], vec![90.0; 100]];
        let n = 400;
        let charge = |i: u32| 30.0 - 60.0 * (1.0 - (f64::from(i) + 0.5) / f64::from(n)).ln();
        let events: Vec<Event> = (0..n).map(|i| event(0, charge(i).round() as u16, 1)).collect();
        let found = Completeness::new(&events.iter().collect::<Vec<_>>(), &margins, 30.0);
        assert!((found.mean_excess - 60.0).abs() < 1.0, "{}", found.mean_excess);
        assert_eq!(found.of_stack(0), 1.0);
        // 32 charges are injected.
        assert!((found.of_stack(1) - (-1.0f64).exp()).abs() < 1.0 / 32.0);
        // Spread over two pixels, twice the charge is needed: e^(−150/60).
        let events: Vec<Event> = events.iter().map(|e| event(0, e.charge_dn as u16, 2)).collect();
        let found = Completeness::new(&events.iter().collect::<Vec<_>>(), &margins, 30.0);
        let law = found.mean_excess;
        assert!((found.of_stack(1) - (-150.0 / law).exp()).abs() < 1.0 / 32.0);
    }
}
