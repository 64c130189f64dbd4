//! Quantiles of a stack's pixels and samples, the means of its sites, and the variances of rows and
//! frames: whatever an effect does to some of the pixels, it moves some of these.
//!
//! The standard deviation of a quantile is half the distance between the order statistics that lie
//! one binomial standard deviation, √(p (1 − p)/n) of the share, to either side of it: it assumes
//! no distribution. Codes and means of few of them lie on a lattice, over whose steps they are
//! spread evenly.

use super::collect::{Collected, cube_root_sd};
use super::statistic::{Scale, What};
use super::temporal::Temporal;
use crate::data::design::Condition;
use crate::numerics::steps::Spread;
use camrig_base::Cfa;
use camrig_captures::Role;
use camrig_linear::moments;

/// Shares of the pixels or samples that lie below the quantiles.
pub const SHARES: [f64; 7] = [0.001, 0.01, 0.1, 0.5, 0.9, 0.99, 0.999];
const MEDIAN: usize = 3;
/// Most pixels of a stack, evenly spread, whose quantiles are taken: those of 16 thousand are known
/// to a hundredth of their spread, and ordering them takes little of the time of their simulation.
const MAX_PIXELS: usize = 1 << 14;
/// Robust standard deviations from the median at which the pixels of a site are clipped.
const CLIP: f64 = 4.0;
/// Least standard deviation, DN: codes are whole numbers, and a quantile may stay at the edge of
/// one in all replicates.
const MIN_SD_DN: f64 = 0.02;

/// The quantiles, site means and variances of a stack; of flats whose light is taken from their own
/// mean, no means, and of those that may be uneven, no quantiles of pixels or samples, which shading
/// moves.
pub(super) fn statistics(t: &Temporal, c: &Condition, cfa: &Cfa, out: &mut Collected) {
    if c.stack.role == Role::Dark || c.level_known {
        site_means(t, cfa, out);
    }
    let bins = t.row_power.len() as f64;
    let rows = t.row_power.iter().sum::<f64>() / bins;
    let sd = cube_root_sd(rows, 2.0 * t.dof * bins);
    out.add(What::RowVarianceDn, rows, sd, Scale::CubeRoot);
    let (_, frames) = moments(&t.frame_means);
    let sd = cube_root_sd(frames, t.frames as f64 - 1.0);
    out.add(What::FrameVarianceDn, frames, sd, Scale::CubeRoot);
    // One code in one of n frames changes a variance of 0 to 1/n.
    let variances = pixels(&t.pixel_variance, t.step());
    let means = pixels(&t.mean.data, t.step());
    let codes = Codes::of(&t.histogram);
    let middle = [means.quantile(SHARES[MEDIAN]), codes.quantile(SHARES[MEDIAN])];
    for (i, share) in SHARES.into_iter().enumerate() {
        let name = i as u8;
        let [low, high] = around(share, variances.count()).map(|p| variances.quantile(p));
        let sd = (libm::cbrt(high) - libm::cbrt(low)) / 2.0;
        let value = variances.quantile(share);
        let sd = sd.max(libm::cbrt(MIN_SD_DN * MIN_SD_DN));
        out.add(What::VarianceQuantile(name), value, sd, Scale::CubeRoot);
        if i == MEDIAN || c.is_flat() && !c.even {
            continue;
        }
        let of = |quantile: &dyn Fn(f64) -> f64, count: f64, middle: f64| {
            let [low, high] = around(share, count).map(quantile);
            (quantile(share) - middle, ((high - low) / 2.0).max(MIN_SD_DN))
        };
        let (value, sd) = of(&|p| means.quantile(p), means.count(), middle[0]);
        out.add(What::MeanQuantile(name), value, sd, Scale::Linear);
        let (value, sd) = of(&|p| codes.quantile(p), codes.count, middle[1]);
        out.add(What::CodeQuantile(name), value, sd, Scale::Linear);
    }
}

/// The shares one binomial standard deviation below and above a share of so many.
fn around(share: f64, count: f64) -> [f64; 2] {
    let sd = (share * (1.0 - share) / count).sqrt();
    [(share - sd).max(0.0), (share + sd).min(1.0)]
}

/// Mean of each site, its pixels clipped about their median.
fn site_means(t: &Temporal, cfa: &Cfa, out: &mut Collected) {
    for site in 0..cfa.width * cfa.height {
        let rows = t.mean.data.chunks(t.width).skip(site / cfa.width).step_by(cfa.height);
        let own = rows.flat_map(|row| row.iter().skip(site % cfa.width).step_by(cfa.width));
        let own: Vec<f32> = own.copied().collect();
        let spread = Spread::of(own.clone(), t.step());
        let (middle, sd) = (spread.median() as f32, spread.robust_sd());
        let limit = (CLIP * sd) as f32;
        let clipped = own.iter().map(|x| f64::from((x - middle).clamp(-limit, limit)));
        let count = own.len() as f64;
        let mean = f64::from(middle) + clipped.sum::<f64>() / count;
        let sd = (sd / count.sqrt()).max(MIN_SD_DN / count.sqrt());
        out.add(What::SiteMean(site as u8), mean, sd, Scale::Linear);
    }
}

/// Pixels evenly spread over all, with the step between the values that they can have.
fn pixels(values: &[f32], step: f64) -> Spread {
    // An odd step visits all sites and columns.
    let every = values.len().div_ceil(MAX_PIXELS) | 1;
    Spread::of(values.iter().step_by(every).copied().collect(), step)
}

/// Samples by code.
pub(super) struct Codes<'a> {
    histogram: &'a [u32],
    count: f64,
}

impl<'a> Codes<'a> {
    pub(super) fn of(histogram: &'a [u32]) -> Self {
        Self { histogram, count: histogram.iter().map(|&n| f64::from(n)).sum() }
    }

    /// A quantile of samples that are spread evenly from half a code below theirs to half above.
    pub(super) fn quantile(&self, share: f64) -> f64 {
        let mut left = share * self.count;
        for (code, n) in self.histogram.iter().map(|&n| f64::from(n)).enumerate() {
            if left <= n && n > 0.0 {
                return code as f64 - 0.5 + left / n;
            }
            left -= n;
        }
        self.histogram.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    /// Over 400 draws of 2000 values the quantiles scatter by as much as they say, and about those
    /// of the normal law: of normal values, and of means of sixteen codes with noise of 1 DN, which
    /// have steps of 1/16 and, spread, the variance (1 + 1/12)/16 + 1/3072. That density is not
    /// even within steps moves their quantiles by a quarter of the scatter at most: 3 % more.
    #[test]
    fn a_quantile_is_as_uncertain_as_it_says() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(4);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        check_uncertainty(&mut normal, 0.0, [0.0, 1.0]);
        let mut code = || (0.3 + normal()).round();
        let mut mean = || (0..16).map(|_| code()).sum::<f64>() / 16.0;
        let sd = (13.0f64 / 192.0 + 1.0 / 3072.0).sqrt();
        check_uncertainty(&mut mean, 1.0 / 16.0, [0.3, sd]);
    }

    /// Of values of this mean and standard deviation, on a lattice of this step.
    fn check_uncertainty(value: &mut dyn FnMut() -> f64, step: f64, [mean, sd]: [f64; 2]) {
        for (share, expected) in [(0.01, -2.3263), (0.1, -1.2816), (0.5, 0.0), (0.99, 2.3263)] {
            let (mut squares, mut sds) = (0.0, 0.0);
            for _ in 0..400 {
                let draw = Spread::of((0..2000).map(|_| value() as f32).collect(), step);
                let [low, high] = around(share, draw.count()).map(|p| draw.quantile(p));
                squares += (draw.quantile(share) - mean - expected * sd).powi(2);
                sds += (high - low) / 2.0;
            }
            let (scatter, own) = ((squares / 400.0f64).sqrt(), sds / 400.0);
            // The scatter is known to 3.5 %; of the twenty lowest values the mean is off by 2 %.
            assert!((scatter / own - 1.0).abs() < 0.13, "{step} {share}: {scatter} {own}");
        }
    }

    #[test]
    fn a_quantile_of_codes_moves_by_parts_of_a_code() {
        // Half of the samples at 1, half at 2: the median is where one becomes the other.
        assert!((Codes::of(&[0, 50, 50]).quantile(0.5) - 1.5).abs() < 1e-12);
        assert!((Codes::of(&[0, 40, 60]).quantile(0.5) - (1.5 + 1.0 / 6.0)).abs() < 1e-12);
    }
}
