//! Order statistics of values that lie on a lattice, as means of few whole numbers do.
//!
//! Means of n codes are multiples of 1/n: their median and quantiles stay on one of these or jump
//! to the next, so that they either do not scatter at all or by many times what a law without steps
//! would let them. Here a value stands for everything within half a step of it, at an even density:
//! the grouped quantile. With p of the values below and f the density that is spread over the step,
//! its variance over samples of n is p (1 − p)/(n f²), as for a law without steps; quantiles of
//! the mid-distribution, which are as good, are treated by Ma, Genton & Parzen 2011, "Asymptotic
//! properties of sample quantiles of discrete distributions", Ann. Inst. Stat. Math. 63, 227.
//!
//! Limits: spreading adds step²/12 to the variance of the law, and where its density f changes
//! within a step, a quantile is off by up to step² |f′|/(8 f).

use camrig_base::median::robust_sd;

/// Values in ascending order, each group of equal ones spread evenly over its step.
pub struct Spread(Vec<f32>);

impl Spread {
    /// Of values on multiples of `step`, in the unit of the values; of 0, they are on no lattice
    /// and stay what they are. Rounding of the values does not matter.
    pub fn of(mut values: Vec<f32>, step: f64) -> Self {
        values.sort_unstable_by(f32::total_cmp);
        if step > 0.0 {
            let multiple = |v: f32| (f64::from(v) / step).round();
            for equal in values.chunk_by_mut(|a, b| multiple(*a) == multiple(*b)) {
                let (at, count) = (multiple(equal[0]), equal.len() as f64);
                for (i, v) in equal.iter_mut().enumerate() {
                    *v = (step * (at + (i as f64 + 0.5) / count - 0.5)) as f32;
                }
            }
        }
        Self(values)
    }

    /// Number of values.
    pub fn count(&self) -> f64 {
        self.0.len() as f64
    }

    /// The value below which this share of all lies, between two by interpolation; 0 of none.
    pub fn quantile(&self, share: f64) -> f64 {
        let at = share * (self.0.len().saturating_sub(1)) as f64;
        let value = |i: usize| self.0.get(i).map_or(0.0, |v| f64::from(*v));
        let low = at as usize;
        value(low) + (at - low as f64) * (value(low + 1) - value(low)).max(0.0)
    }

    /// The median.
    pub fn median(&self) -> f64 {
        self.quantile(0.5)
    }

    /// Robust standard deviation, from the median absolute deviation.
    pub fn robust_sd(&self) -> f64 {
        let middle = self.median() as f32;
        robust_sd(self.0.iter().map(|v| v - middle))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn a_median_moves_by_parts_of_a_step() {
        // Thirds of which 40 % are below, with the rounding that differences of means have: the
        // median is a sixth of a step above where one becomes the other.
        let value = |i: usize| if i < 400 { 100.333_34 - 100.0 } else { 2.0f32 / 3.0 };
        let spread = Spread::of((0..1000).map(value).collect(), 1.0 / 3.0);
        let expected = (1.5 + 1.0 / 6.0) / 3.0;
        // Values of a group are 1/600 of a step apart.
        assert!((spread.median() - expected).abs() < 1.0 / 3.0 / 600.0, "{}", spread.median());
    }

    #[test]
    fn values_without_steps_have_ordinary_quantiles() {
        let spread = Spread::of(vec![4.0, 1.0, 2.0, 8.0, 2.0], 0.0);
        let quantiles = [0.0, 0.25, 0.5, 0.625, 0.75, 1.0].map(|p| spread.quantile(p));
        assert_eq!(quantiles, [1.0, 2.0, 2.0, 3.0, 4.0, 8.0]);
        assert_eq!((Spread::of(Vec::new(), 0.0).median(), spread.count()), (0.0, 5.0));
    }

    /// Maps of 4000 means of five codes, with noise of 0.8 DN: steps are 0.2 DN, the median of a
    /// law without them has a standard deviation of 0.0075 DN, a 27th of a step.
    #[test]
    fn means_of_codes_have_the_median_and_the_width_of_their_law() {
        const PIXELS: usize = 4000;
        const FRAMES: usize = 5;
        const DRAWS: usize = 200;
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(6);
        let n = FRAMES as f64;
        // Rounding to a code adds 1/12 DN² to each sample.
        let variance = (0.8 * 0.8 + 1.0 / 12.0) / n;
        // So does spreading of the means, of their step.
        let widened = variance + 1.0 / (12.0 * n * n);
        let median_sd = (FRAC_PI_2 * widened / PIXELS as f64).sqrt();
        // The median absolute deviation of a normal law has this standard deviation, times σ/√n.
        let width_sd = 1.166 * (widened / PIXELS as f64).sqrt();
        let (mut squares, mut centres, mut widths) = (0.0, 0.0, 0.0);
        for draw in 0..DRAWS {
            // Where the mean is between codes differs, so that both are met: on a step and between.
            let mean = 20.0 + draw as f64 / DRAWS as f64;
            let mut code = || {
                let z: f64 = StandardNormal.sample(&mut rng);
                (mean + 0.8 * z).round()
            };
            let mut pixel = || ((0..FRAMES).map(|_| code()).sum::<f64>() / n) as f32;
            let spread = Spread::of((0..PIXELS).map(|_| pixel()).collect(), 1.0 / n);
            let off = (spread.median() - mean) / median_sd;
            squares += off * off;
            centres += off;
            widths += spread.robust_sd();
        }
        let draws = DRAWS as f64;
        // Four standard errors: of a mean of draws, of their scatter, of the mean width.
        assert!((centres / draws).abs() < 4.0 / draws.sqrt(), "{centres}");
        let scatter = (squares / draws).sqrt();
        assert!((scatter - 1.0).abs() < 4.0 / (2.0 * draws).sqrt(), "{scatter}");
        let width = widths / draws;
        assert!((width - widened.sqrt()).abs() < 4.0 * width_sd / draws.sqrt(), "{width}");
    }
}
