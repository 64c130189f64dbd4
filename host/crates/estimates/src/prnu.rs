//! The spread of the pixels' gain in two parts: each pixel's own, and what neighbours share.
//!
//! What they share has the law of the effect `prnu-correlated`: of its variance σ² pixels side by
//! side have 1/2 in common, diagonal ones 1/4 and others nothing (Bartlett's triangle along rows
//! and columns). Each of these covariances is taken less that of the same columns two rows apart,
//! and of those side by side less the same of two columns apart: what columns have in common, what
//! rows have, and what is smooth is as large in both. All are without unit, of a map of relative
//! gains from which the mean over a square of n pixels was taken: the mean over all flats, by their
//! light, in which a pattern is the same and shot noise is not.

use super::flat::{Flat, SIDE, SQUARE, correlations, products};
use super::robust::mean;
use camrig_base::Value;

/// Distances in columns and rows at which a gain map is compared with itself.
const DISTANCES: [(isize, usize); 10] =
    [(1, 0), (2, 0), (0, 1), (0, 2), (1, 1), (-1, 1), (1, 2), (-1, 2), (2, 2), (-2, 2)];
/// How much of the correlation at each of them makes that of neighbours to the right, below and
/// diagonally below, with what is taken off.
const NEIGHBOURS: [[f64; 10]; 3] = [
    [1.0, -1.0, 0.0, 0.0, 0.0, 0.0, -0.5, -0.5, 0.5, 0.5],
    [0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, 0.5, 0.5, -0.5, -0.5, 0.0, 0.0],
];
/// Part of the variance that each of them shares.
const LAW: [f64; 3] = [0.5, 0.5, 0.25];
/// Sum of the law over all pixels: by so much more the mean over a square varies.
const SUM: f64 = 4.0;
/// Part of what the law gives diagonal neighbours from which it is nearer than none: charge or
/// light that passes into the pixels beside is hardly any to them.
const NEARER: f64 = 0.5;

/// The parts of the variance over pixels of the relative gain.
#[derive(Clone, Copy, Debug)]
pub struct Prnu {
    /// The whole.
    pub variance: Value,
    /// What neighbours share, by those to the right, below and diagonally below.
    pub shared: [Value; 3],
}

/// What the mean over the square changes of the covariance of pixels at a distance, for a pattern
/// of which a pixel and all those around it have the variance 1 in common: −(2 − o)/n, with o
/// the part of the square that two of them have in common.
fn removed((right, below): (isize, usize)) -> f64 {
    let overlap = |distance: usize| 1.0 - distance as f64 / SIDE as f64;
    (overlap(right.unsigned_abs()) * overlap(below) - 2.0) / SQUARE as f64
}

/// What is left of the variance of patterns of which a pixel and all those around it have so much
/// in common.
fn kept(sum: f64) -> f64 {
    1.0 + sum * removed((0, 0))
}

/// The maps of several flats.
#[derive(Default)]
pub(crate) struct Gains {
    /// Sums over the flats by even and by odd frames, each flat with its light.
    halves: [Vec<f64>; 2],
    /// Sum of the light.
    light: f64,
}

impl Gains {
    /// Adds a flat of so many frames with its own maps.
    pub fn add(&mut self, flat: &Flat, frames: usize, halves: &[Vec<f64>; 2]) {
        let light = flat.level().max(0.0) * frames as f64;
        self.light += light;
        for (sum, map) in self.halves.iter_mut().zip(halves) {
            sum.resize(map.len(), 0.0);
            sum.iter_mut().zip(map).for_each(|(s, v)| *s += light * v);
        }
    }

    /// The parts of the variance of their mean; none without flats.
    pub fn prnu(&self, width: usize) -> Option<Prnu> {
        if !(self.light > 0.0) {
            return None;
        }
        let whole = mean(&products(&self.halves, width, 0, 0));
        let variance = whole.scaled((self.light * self.light * kept(1.0)).recip());
        Some(Prnu::of(variance, &correlations(&self.halves, width, DISTANCES)))
    }
}

impl Prnu {
    /// Of a map with this variance, as it was before the mean over the square was taken off, and
    /// these correlations at [`DISTANCES`].
    fn of(variance: Value, correlation: &[Value; 10]) -> Self {
        let shared = std::array::from_fn(|i| {
            let (factors, law) = (&NEIGHBOURS[i], LAW[i]);
            let less = DISTANCES.iter().zip(factors).map(|(d, factor)| factor * removed(*d));
            let less: f64 = less.sum();
            let terms = correlation.iter().zip(factors).map(|(c, factor)| c.scaled(*factor));
            let seen = terms.fold(Value::new(0.0, 0.0), |sum, v| sum + v).scaled(kept(1.0));
            // What is seen is `less` of each pixel's own part and `law` + SUM less of the other.
            let per_variance = law + SUM * less - less * kept(SUM) / kept(1.0);
            let share = Value::new(seen.value - less, seen.std_error);
            share.scaled(variance.value / per_variance)
        });
        Self { variance, shared }
    }

    /// What it has more than another.
    pub fn less(&self, other: &Self) -> Self {
        let shared = std::array::from_fn(|i| self.shared[i] - other.shared[i]);
        Self { variance: self.variance - other.variance, shared }
    }

    /// The variance of what neighbours share.
    pub fn shared(&self) -> Value {
        Value::combine(self.shared).unwrap_or(Value::new(0.0, f64::INFINITY))
    }

    /// The variance of each pixel for itself.
    pub fn own(&self) -> Value {
        self.variance - self.shared().scaled(kept(SUM) / kept(1.0))
    }

    /// Standard errors by which a shared part stands out in each of the three; 0 where they are of
    /// both signs, and where diagonal neighbours share so little that it is not of this law.
    pub fn deviation(&self) -> f64 {
        let [right, below, diagonal] = self.shared;
        let Some(beside) = Value::combine([right, below]) else { return 0.0 };
        if diagonal.value / beside.value < NEARER {
            return 0.0;
        }
        let sign = beside.value.signum();
        let least = self.shared.map(|s| sign * s.z()).into_iter().fold(f64::INFINITY, f64::min);
        sign * least.max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Sites, Stack, estimate};
    use camrig_base::Plane;
    use camrig_captures::Role;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    /// Standard deviations of relative gain, and what is seen of the pattern.
    #[derive(Clone, Copy)]
    struct Sensor {
        own: f64,
        shared: f64,
        /// Of columns, and of eight channels of them.
        columns: f64,
        channels: f64,
        /// What each pixel passes to each of the four beside it.
        coupling: f64,
        /// Loss of light in the corners.
        shading: f64,
    }

    const WHITE: Sensor = Sensor {
        own: 0.008,
        shared: 0.0,
        columns: 0.0,
        channels: 0.0,
        coupling: 0.0,
        shading: 0.0,
    };

    impl Sensor {
        fn prnu(&self, [width, height]: [usize; 2], seed: u64) -> Prnu {
            let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
            let mut normal = move || -> f64 { StandardNormal.sample(&mut rng) };
            let corners: Vec<f64> = (0..(width + 1) * (height + 1)).map(|_| normal()).collect();
            let columns: Vec<f64> = (0..width).map(|_| self.columns * normal()).collect();
            let channels: Vec<f64> = (0..8).map(|_| self.channels * normal()).collect();
            let gains: Vec<f64> = (0..width * height)
                .map(|p| {
                    let (x, y) = (p % width, p / width);
                    let corner = |dx, dy| corners[(y + dy) * (width + 1) + x + dx];
                    let around = corner(0, 0) + corner(1, 0) + corner(0, 1) + corner(1, 1);
                    let own = self.own * normal() + 0.5 * self.shared * around;
                    let [u, v] =
                        [(x, width), (y, height)].map(|(i, n)| 2.0 * i as f64 / n as f64 - 1.0);
                    let shading = 1.0 - 0.5 * self.shading * (u * u + v * v);
                    (1.0 + own + columns[x] + channels[x % 8]) * shading
                })
                .collect();
            let at = |x: usize, y: usize| gains[y.min(height - 1) * width + x.min(width - 1)];
            let seen = |p: usize| {
                let (x, y) = (p % width, p / width);
                let beside = at(x.saturating_sub(1), y)
                    + at(x + 1, y)
                    + at(x, y.saturating_sub(1))
                    + at(x, y + 1);
                at(x, y) + self.coupling * (beside - 4.0 * at(x, y))
            };
            let seen: Vec<f64> = (0..width * height).map(seen).collect();
            // 0.25 DN per electron, 12,000 of them.
            let mut stack = |role, light_dn: f64| {
                let frames = (0..8).map(|_| {
                    Plane::from_fn(width, height, |x, y| {
                        let mean = light_dn * seen[y * width + x];
                        (64.0 + mean + (1.0 + 0.25 * mean).sqrt() * normal()).round() as u16
                    })
                });
                Stack::new("", role, 0.01, frames.collect())
            };
            let stacks = [stack(Role::Dark, 0.0), stack(Role::Flat, 3000.0)];
            let found = estimate(&stacks, Sites { across: 1, down: 1 }, 0.25).unwrap();
            found.prnu.unwrap()
        }
    }

    /// Of 240 sensors whose neighbours share nothing none passes three errors in all three figures,
    /// whatever else their gains have, with charge that passes into the pixels beside or without.
    #[test]
    fn neighbours_that_share_nothing_have_none() {
        for (name, sensor) in [
            ("white", WHITE),
            ("shading", Sensor { shading: 0.3, ..WHITE }),
            ("columns", Sensor { columns: 0.008, ..WHITE }),
            ("channels", Sensor { channels: 0.008, ..WHITE }),
            ("coupling", Sensor { coupling: 0.02, ..WHITE }),
            ("strong coupling", Sensor { coupling: 0.04, ..WHITE }),
        ] {
            for seed in 0..40 {
                let size = [[48, 48], [64, 40]][seed as usize % 2];
                let found = sensor.prnu(size, seed);
                let z = found.deviation();
                assert!(z.abs() < 3.0, "{name}, seed {seed}: {z}, {found:?}");
            }
        }
    }

    /// Figures of forty sensors: each within four of its errors, which are those of what scatters,
    /// and their means within one; that of 40 scatters by 0.16, and rows and columns that are taken
    /// off have some per cent of so small a map.
    #[test]
    fn both_parts_are_within_their_errors() {
        for (own, shared) in [(0.0022, 0.0028), (0.008, 0.006), (0.003, 0.004)] {
            let sensor = Sensor { own, shared, columns: 0.002, ..WHITE };
            let found: Vec<Prnu> = (0..40).map(|seed| sensor.prnu([96, 96], 100 + seed)).collect();
            let pulls = |of: &dyn Fn(&Prnu) -> Value, right: f64| {
                let off = |p| (of(p).value - right) / of(p).std_error;
                let all: Vec<f64> = found.iter().map(off).collect();
                let mean = all.iter().sum::<f64>() / 40.0;
                let most = all.iter().fold(0.0f64, |most, z| most.max(z.abs()));
                assert!(mean.abs() < 1.0 && most < 4.0, "{own} {shared}: {mean} {all:?}");
            };
            pulls(&Prnu::shared, shared * shared);
            pulls(&Prnu::own, own * own + sensor.columns * sensor.columns);
        }
    }
}
