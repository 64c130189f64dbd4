//! Events in single frames: samples far above their pixel's other frames, with the neighbours that
//! they extend to. Whether they are particles is decided over the whole set ([`super::particles`]).
//!
//! A residual r from the pixel's median over N frames is compared with √(v (1 + π/(2(N − 1)))),
//! where v is the larger of the variance expected at the pixel's level and a lower bound from its
//! own residuals, the largest left out. The limit is the normal quantile that one sample of the
//! whole set exceeds once in a thousand sets, plus γ/6 (z² − 1) for the skewness γ of shot noise
//! (Cornish & Fisher 1938).

use super::band::Band;
use super::corrections::Substitution;
use super::residuals::Residuals;
use camrig_base::tails;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Probability of one false event in a whole set.
pub const FALSE_EVENTS: f64 = 1e-3;
/// Shortest stack that is searched for events, frames.
pub const MIN_FRAMES: usize = 3;
/// Standard deviations above which a neighbour belongs to an event.
const NEIGHBOUR: f64 = 3.5;
/// The same for the further neighbours of a large event.
const FAR_NEIGHBOUR: f64 = 2.5;
/// Standard deviations above which an event is large: its edge extends beyond one pixel.
const LARGE: f64 = 12.0;
/// Pixels over which a large event is followed.
const REACH: usize = 12;
/// Standard deviations above which a pixel's own variance is computed.
const OWN_VARIANCE_FROM: f64 = 4.0;
/// Most samples of a band whose margin is recorded.
const MAX_MARGINS: usize = 512;
/// Normal quantile for the lower bound of a pixel's own variance, exceeded once in a thousand.
const OWN_BOUND: f64 = 3.09;

/// An event.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// Index of the scan.
    pub stack: usize,
    /// Its frame.
    pub frame: usize,
    /// Column and row of its largest sample.
    pub at: [usize; 2],
    /// Its pixels, by their index in the frame.
    pub pixels: Vec<u32>,
    /// For each pixel, the sample and its estimate without the event.
    pub samples: Vec<Substitution>,
    /// Sum of its residuals, DN.
    pub charge_dn: f64,
    /// Largest residual, DN.
    pub peak_dn: f64,
    /// The same in standard deviations.
    pub z: f64,
}

/// Events of a band.
#[derive(Default)]
pub struct Found {
    /// Samples far above their pixel's median.
    pub events: Vec<Event>,
    /// Number of samples as far below.
    pub negative: usize,
    /// For samples spread over the band: how far each would have to rise to be an event, DN.
    pub margins: Vec<f32>,
}

/// Where a band lies, and what its samples are tested against.
pub struct Search {
    /// Index of the scan.
    pub stack: usize,
    /// The band's first row.
    pub first_row: usize,
    /// DN per electron; 0 where unknown.
    pub dn_per_e: f64,
    /// Level without light, DN.
    pub black: f64,
    /// Number of samples of the whole set.
    pub samples: f64,
    /// Level from which samples are clipped, DN.
    pub white: f64,
}

impl Search {
    /// The limit, standard deviations.
    pub fn limit(&self) -> f64 {
        tails::normal_quantile(libm::log(FALSE_EVENTS / self.samples.max(1.0)))
    }

    /// Events of a band; `period` is the number of columns of the filter pattern.
    pub fn find(&self, band: &Band, r: &Residuals, period: usize) -> Found {
        let n = r.frames;
        if n < MIN_FRAMES {
            return Found::default();
        }
        let limit = self.limit();
        let scatter = 1.0 + std::f64::consts::PI / 2.0 / (n as f64 - 1.0);
        let trimmed = Trimmed::new(n);
        let sd: Vec<f32> = r
            .expected_variance(self.dn_per_e)
            .par_iter()
            .zip(r.values.par_chunks(n))
            .map(|(&v, values)| (trimmed.own_variance(v, values, scatter) * scatter).sqrt() as f32)
            .collect();
        // Limits in DN above and below for each pixel.
        let above = |p: usize| {
            let v = f64::from(sd[p]).powi(2);
            let signal = (f64::from(r.median[p]) - self.black).max(0.0);
            let skewness = self.dn_per_e * self.dn_per_e * signal / libm::pow(v, 1.5);
            f64::from(sd[p]) * (limit + skewness / 6.0 * (limit * limit - 1.0))
        };
        let mut seeds: Vec<(usize, usize)> = Vec::new();
        let mut negative = 0;
        for (p, values) in r.values.chunks(n).enumerate() {
            let below = -f64::from(sd[p]) * limit;
            let mut high = None;
            for (i, &x) in values.iter().enumerate() {
                let x = f64::from(x);
                if x < below && f64::from(r.median[p]) < self.white {
                    negative += 1;
                } else if x > -below && x > *high.get_or_insert_with(|| above(p)) {
                    seeds.push((i, p));
                }
            }
        }
        seeds.sort_unstable();
        let mut events = self.grow(r, &sd, &seeds, limit);
        self.estimate_samples(band, r, period, &mut events);
        // Frames in turn.
        let step = r.values.len().div_ceil(MAX_MARGINS);
        let places =
            (0..MAX_MARGINS).map(|k| (k * step / n, k % n)).take_while(|p| p.0 < sd.len());
        let margin = |(p, i): (usize, usize)| above(p) as f32 - r.values[p * n + i];
        let margins = places.map(margin).filter(|&m| m > 0.0).collect();
        Found { events, negative, margins }
    }

    /// Estimates the samples of events without the event: the next pixel of the same filter in the
    /// row, in the same frame, shifted to the pixel's own level. It has the noise of row and frame.
    fn estimate_samples(&self, band: &Band, r: &Residuals, period: usize, events: &mut [Event]) {
        let first = self.first_row * r.width;
        let taken: BTreeSet<(usize, u32)> =
            events.iter().flat_map(|e| e.pixels.iter().map(|&p| (e.frame, p))).collect();
        for e in events {
            let sample = |p: usize| band.samples[p * r.frames + e.frame];
            e.samples = (e.pixels.iter())
                .map(|&pixel| {
                    let p = pixel as usize - first;
                    let used = |q: usize| taken.contains(&(e.frame, (q + first) as u32));
                    let q = substitute(p, r.width, period, used);
                    let shifted = f32::from(sample(q)) + (r.median[p] - r.median[q]);
                    let to = shifted.round().clamp(0.0, f32::from(u16::MAX)) as u16;
                    Substitution { from: sample(p), to }
                })
                .collect();
        }
    }

    /// Grows events around seeds (frame, pixel), which are in the order of frames.
    fn grow(&self, r: &Residuals, sd: &[f32], seeds: &[(usize, usize)], limit: f64) -> Vec<Event> {
        let n = r.frames;
        let (width, height) = (r.width, r.median.len() / r.width);
        let z = |p: usize, i: usize| f64::from(r.values[p * n + i] / sd[p]);
        let mut events = Vec::new();
        let mut taken = BTreeSet::new();
        for &(i, seed) in seeds {
            if !taken.insert((i, seed)) {
                continue;
            }
            // Breadth first, each pixel with its distance from the seed.
            let mut pixels = vec![(seed, 0)];
            let mut next = 0;
            while let Some(&(p, steps)) = pixels.get(next) {
                next += 1;
                let large = z(seed, i) > LARGE;
                let least = if steps > 0 && large { FAR_NEIGHBOUR } else { NEIGHBOUR };
                if steps > 0 && (!large || steps > REACH) && z(p, i) < limit {
                    continue;
                }
                for q in around(p, width, height) {
                    if z(q, i) > least && taken.insert((i, q)) {
                        pixels.push((q, steps + 1));
                    }
                }
            }
            let residual = |p: usize| f64::from(r.values[p * n + i]);
            let peak = pixels
                .iter()
                .map(|p| p.0)
                .fold(seed, |best, p| if residual(p) > residual(best) { p } else { best });
            events.push(Event {
                stack: self.stack,
                frame: i,
                at: [peak % width, peak / width + self.first_row],
                pixels: pixels.iter().map(|p| (p.0 + self.first_row * width) as u32).collect(),
                samples: Vec::new(),
                charge_dn: pixels.iter().map(|p| residual(p.0)).sum(),
                peak_dn: residual(peak),
                z: z(peak, i),
            });
        }
        events
    }
}

/// A trimmed variance: without its largest squared residuals, so that two events in one pixel do
/// not mask each other. The same for every pixel of a stack.
struct Trimmed {
    /// Number of largest squares that are left out.
    out: usize,
    /// Expected sum of the remaining squares of normal variates.
    kept: f64,
    /// Upper limit of the trimmed variance over the true one, from chance alone.
    bound: f64,
}

impl Trimmed {
    /// Of stacks of `n` frames.
    fn new(n: usize) -> Self {
        let out = if n >= 8 { 2 } else { 1 };
        let kept = (0..n - out)
            .map(|i| {
                let share = (i as f64 + 0.625) / (n as f64 + 0.25);
                tails::normal_quantile(libm::log((1.0 - share) / 2.0)).powi(2)
            })
            .sum();
        Self { out, kept, bound: tails::quantile_of_squares(OWN_BOUND, (n - out - 1) as f64) }
    }

    /// The larger of a pixel's expected variance and the lower bound from its own residuals.
    fn own_variance(&self, expected: f32, values: &[f32], scatter: f64) -> f64 {
        let expected = f64::from(expected);
        let far = OWN_VARIANCE_FROM * OWN_VARIANCE_FROM * expected * scatter;
        let n = values.len();
        if n < 4 || values.iter().all(|&x| f64::from(x * x) < far) {
            return expected;
        }
        let mut squares: Vec<f64> = values.iter().map(|&x| f64::from(x * x)).collect();
        squares.sort_unstable_by(f64::total_cmp);
        let own = squares[..n - self.out].iter().sum::<f64>() / self.kept;
        expected.max(own / self.bound)
    }
}

/// The eight neighbours of a pixel.
fn around(p: usize, width: usize, height: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (p % width, p / width);
    let rows = y.saturating_sub(1)..(y + 2).min(height);
    rows.flat_map(move |v| {
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        columns.map(move |u| v * width + u)
    })
    .filter(move |&q| q != p)
}

/// The nearest pixel of the same filter in the row of `p` that is not `used` itself; `p` where
/// there is none.
pub fn substitute(p: usize, width: usize, period: usize, used: impl Fn(usize) -> bool) -> usize {
    let (row, x) = (p / width * width, p % width);
    let (mut left, mut right) = (x, x);
    loop {
        let more = right + period < width;
        if more {
            right += period;
            if !used(row + right) {
                return row + right;
            }
        }
        if left >= period {
            left -= period;
            if !used(row + left) {
                return row + left;
            }
        } else if !more {
            return p;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_substitute_has_the_same_filter_and_is_unused() {
        assert_eq!(substitute(3, 10, 2, |_| false), 5);
        assert_eq!(substitute(13, 10, 2, |q| q == 15), 11);
        assert_eq!(substitute(9, 10, 2, |q| q != 1), 1);
        assert_eq!(substitute(1, 3, 2, |_| false), 1);
    }
}
