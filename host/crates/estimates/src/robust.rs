//! Statistics that a few extreme pixels do not rule, with their standard errors.

use camrig_base::Value;
use camrig_base::median::SD_PER_MAD;

/// The median: of an even number of values the mean of the two in the middle, of none NaN.
pub fn median(mut values: Vec<f64>) -> f64 {
    let n = values.len();
    if n == 0 {
        return f64::NAN;
    }
    let (below, middle, _) = values.select_nth_unstable_by(n / 2, f64::total_cmp);
    let upper = *middle;
    if n % 2 == 1 {
        return upper;
    }
    0.5 * (upper + below.iter().copied().fold(f64::NEG_INFINITY, f64::max))
}

/// Standard deviation from the median absolute deviation, that of a normal law.
pub fn mad_sd(values: &[f64]) -> f64 {
    let centre = median(values.to_vec());
    SD_PER_MAD * median(values.iter().map(|v| (v - centre).abs()).collect())
}

/// Clips values at `sds` robust standard deviations about their median; leaves them where more
/// than half are equal.
pub fn clip(values: &mut [f64], sds: f64) {
    let (centre, sd) = (median(values.to_vec()), mad_sd(values));
    if sd > 0.0 {
        values.iter_mut().for_each(|v| *v = v.clamp(centre - sds * sd, centre + sds * sd));
    }
}

/// Mean of the values clipped at `sds` robust standard deviations, and its standard error.
pub fn clipped_mean(mut values: Vec<f64>, sds: f64) -> Value {
    clip(&mut values, sds);
    mean(&values)
}

/// Mean and its standard error.
pub fn mean(values: &[f64]) -> Value {
    let n = values.len() as f64;
    let value = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - value).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    Value { value, std_error: (variance / n).sqrt() }
}

/// Variance with n − 1 degrees of freedom.
pub fn variance(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    (mean(values).std_error).powi(2) * n
}

/// Values in ascending order, whose quantiles are asked for.
pub struct Sorted(Vec<f64>);

impl Sorted {
    /// Sorts values; those that are not numbers are left out.
    pub fn new(values: impl IntoIterator<Item = f64>) -> Self {
        let mut values: Vec<f64> = values.into_iter().filter(|v| !v.is_nan()).collect();
        values.sort_unstable_by(f64::total_cmp);
        Self(values)
    }

    /// Interpolated quantile; of no values NaN.
    pub fn quantile(&self, p: f64) -> f64 {
        self.at(p * (self.0.len() as f64 - 1.0))
    }

    fn at(&self, rank: f64) -> f64 {
        let Some(last) = self.0.len().checked_sub(1) else { return f64::NAN };
        let rank = rank.clamp(0.0, last as f64);
        let (i, part) = (rank as usize, rank.fract());
        let next = self.0[(i + 1).min(last)];
        self.0[i] + part * (next - self.0[i])
    }

    /// A quantile with its standard error from the order statistics on both sides, whose rank is
    /// binomial: no law of the values is assumed. Of values on a lattice, as means of few whole
    /// numbers are, the quantile is not known better than the lattice is fine: the error is at
    /// least that of rounding to it, its step over √12.
    pub fn estimate(&self, p: f64) -> Value {
        let n = self.0.len() as f64;
        let (rank, sd) = (p * (n - 1.0), (n * p * (1.0 - p)).sqrt());
        let error = 0.5 * (self.at(rank + sd) - self.at(rank - sd));
        let value = self.at(rank);
        Value::new(value, error.max(self.step(value) / 12f64.sqrt()))
    }

    /// Half the distance between the next values below and above one, beyond rounding; 0 where
    /// there are none.
    fn step(&self, value: f64) -> f64 {
        let (Some(first), Some(last)) = (self.0.first(), self.0.last()) else { return 0.0 };
        let rounding = 1e-9 * value.abs().max(last - first);
        let below = self.0.partition_point(|v| *v < value - rounding);
        let above = self.0.partition_point(|v| *v <= value + rounding);
        let below = below.checked_sub(1).map_or(value, |i| self.0[i]);
        0.5 * (self.0.get(above).copied().unwrap_or(value) - below)
    }

    /// Standard deviation of a normal law from the distance between the lower quartile and the
    /// median, so that a tail above does not rule, with its standard error.
    pub fn lower_sd(&self) -> Value {
        /// Φ⁻¹(3/4).
        const QUARTILE: f64 = 0.674_489_75;
        /// Correlation of the lower quartile and the median over samples: √(¼·½ / (½·¾)).
        const CORRELATION: f64 = 0.577_350_3;
        let (low, middle) = (self.estimate(0.25), self.estimate(0.5));
        let variance = low.std_error.powi(2) + middle.std_error.powi(2)
            - 2.0 * CORRELATION * low.std_error * middle.std_error;
        Value {
            value: (middle.value - low.value) / QUARTILE,
            std_error: variance.max(0.0).sqrt() / QUARTILE,
        }
    }
}

/// The normal core of values with a tail above.
pub struct Core {
    /// Its centre.
    pub centre: Value,
    /// Its standard deviation.
    pub sd: Value,
}

impl Core {
    /// From all values within three deviations of the median, where that agrees with the lower half
    /// alone, which knows nothing of the tail but has 2.4 times the error; else the median, and the
    /// lower half. `step` is how far a value moves where one of the whole numbers it is made of
    /// changes by one: quantiles are not known better than rounding to it (step/√12), which on a
    /// lattice with others between its points their own errors do not tell.
    pub fn of(sorted: &Sorted, step: f64) -> Self {
        /// Where values are cut, and what the cut leaves of a normal law's variance: 1 − 2cφ(c)/
        /// (2Φ(c) − 1).
        const CUT: f64 = 3.0;
        const KEPT: f64 = 0.973_336_9;
        /// Standard errors of the deviation and the mean over σ/√n, of values so cut (Huber 1981).
        const ERRORS: [f64; 2] = [0.761, 1.014];
        const PASSES: usize = 30;
        let rounded = |v: Value| Value::new(v.value, v.std_error.max(step / 12f64.sqrt()));
        let (low, middle) = (rounded(sorted.lower_sd()), rounded(sorted.estimate(0.5)));
        let within = |sd: f64| {
            let kept = sorted.0.iter().map(|v| v - middle.value).filter(|v| v.abs() <= CUT * sd);
            kept.fold([0.0; 3], |[n, sum, squares], v| [n + 1.0, sum + v, squares + v * v])
        };
        let sd = (0..PASSES).fold(low.value, |sd, _| {
            let [n, _, squares] = within(sd);
            (squares / n.max(1.0) / KEPT).sqrt()
        });
        let [n, sum, _] = within(sd);
        let centre = middle.value + sum / n.max(1.0);
        let apart = |a: f64, b: Value| (a - b.value).abs() > 2.0 * b.std_error;
        if apart(sd, low) || apart(centre, middle) {
            return Self { centre: middle, sd: low };
        }
        let [of_sd, of_mean] = ERRORS.map(|e| e * sd / (sorted.0.len() as f64).sqrt());
        Self { centre: Value::new(centre, of_mean), sd: Value::new(sd, of_sd) }
    }
}

/// Standard error of a figure by leaving out one of `n` parts at a time (the jackknife; Efron
/// 1982): `without` gives the figure without a part.
pub fn jackknife(n: usize, without: impl Fn(usize) -> f64) -> f64 {
    let values: Vec<f64> = (0..n).map(without).collect();
    let n = n as f64;
    let mean = values.iter().sum::<f64>() / n;
    ((n - 1.0) / n * values.iter().map(|v| (v - mean).powi(2)).sum::<f64>()).sqrt()
}

/// Variance of the logarithm of a mean of squares with 2 x degrees of freedom: ψ′(x), by its
/// asymptotic series from x = 12 on (Abramowitz & Stegun, 6.4.12).
pub fn trigamma(mut x: f64) -> f64 {
    let mut sum = 0.0;
    while x < 12.0 {
        sum += 1.0 / (x * x);
        x += 1.0;
    }
    let square = x * x;
    sum + (1.0 + (0.5 + (1.0 / 6.0 - 1.0 / (30.0 * square)) / x) / x) / x
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    #[test]
    fn errors_are_those_of_a_normal_law() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        let values: Vec<f64> = (0..100_000).map(|_| StandardNormal.sample(&mut rng)).collect();
        let sorted = Sorted::new(values.iter().copied());
        let median = sorted.estimate(0.5);
        // √(π/2) / √n
        assert!((median.std_error / 3.963e-3 - 1.0).abs() < 0.1, "{median:?}");
        assert!(median.value.abs() < 4.0 * median.std_error);
        let sd = sorted.lower_sd();
        assert!((sd.value - 1.0).abs() < 4.0 * sd.std_error && sd.std_error < 0.01, "{sd:?}");
        let core = Core::of(&sorted, 0.0);
        assert!((core.sd.value - 1.0).abs() < 4.0 * core.sd.std_error, "{:?}", core.sd);
        assert!(core.centre.value.abs() < 4.0 * core.centre.std_error, "{:?}", core.centre);
        assert!(core.sd.std_error < 0.5 * sd.std_error, "{:?}", core.sd);
        assert!(core.centre.std_error < 0.85 * median.std_error, "{:?}", core.centre);
        // Of a wide tail, the median and the lower half.
        let tail = |(i, v): (usize, &f64)| if i % 5 == 0 { v.abs() * 4.0 } else { *v };
        let sorted = Sorted::new(values.iter().enumerate().map(tail));
        let core = Core::of(&sorted, 0.0);
        assert_eq!((core.centre, core.sd), (sorted.estimate(0.5), sorted.lower_sd()));
        let kept = jackknife(values.len().min(200), |i| {
            let rest = values[..200].iter().enumerate().filter(|(k, _)| *k != i).map(|(_, v)| v);
            rest.sum::<f64>() / 199.0
        });
        assert!((kept / mean(&values[..200]).std_error - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_lattice_bounds_how_well_a_quantile_is_known() {
        // Thirds, with the rounding that differences of means have.
        let value = |i: usize| (f64::from(i as u32 % 5) - 2.0) / 3.0 + 1e-16 * i as f64;
        let sorted = Sorted::new((0..5000).map(value));
        let median = sorted.estimate(0.5);
        assert!(median.value.abs() < 1e-9);
        assert!((median.std_error - 1.0 / 3.0 / 12f64.sqrt()).abs() < 1e-9, "{median:?}");
        assert_eq!(Sorted::new([1.0; 9]).estimate(0.5), Value::new(1.0, 0.0));
        let none = Sorted::new([f64::NAN]);
        assert!(none.estimate(0.5).value.is_nan() && none.quantile(0.1).is_nan());
        assert!(none.lower_sd().value.is_nan());
    }

    /// Means of 12 whole numbers less the mean of as many, weighted so that no two points of their
    /// lattice are the same: the core is not taken for one with a tail.
    #[test]
    fn a_lattice_with_others_between_its_points_is_no_tail() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(2);
        let mut mean_of = |mean: f64| {
            let codes = (0..12).map(|_| {
                let z: f64 = StandardNormal.sample(&mut rng);
                (mean + 1.4 * z).round()
            });
            codes.sum::<f64>() / 12.0
        };
        let values: Vec<f64> = (0..50_000)
            .map(|_| mean_of(64.55) - 0.503 * mean_of(64.0) - 0.497 * mean_of(64.0))
            .collect();
        let core = Core::of(&Sorted::new(values.iter().copied()), 1.0 / 12.0);
        assert!(
            (core.centre.value - 0.55).abs() < 4.0 * core.centre.std_error,
            "{:?}",
            core.centre
        );
        let sd = variance(&values).sqrt();
        assert!((core.sd.value / sd - 1.0).abs() < 0.01, "{:?} {sd}", core.sd);
    }

    #[test]
    fn trigamma_has_its_closed_forms() {
        let pi2 = std::f64::consts::PI.powi(2);
        assert!((trigamma(1.0) - pi2 / 6.0).abs() < 1e-8);
        assert!((trigamma(0.5) - pi2 / 2.0).abs() < 1e-8);
    }

    #[test]
    fn outliers_move_neither_centre_nor_width() {
        let mut values: Vec<f64> = (0..1001).map(|i| f64::from(i) - 500.0).collect();
        values.extend([1e9; 3]);
        assert!((median(values.clone()) - 1.5).abs() < 1e-9);
        assert!(clipped_mean(values, 4.0).value.abs() < 10.0);
    }
}
