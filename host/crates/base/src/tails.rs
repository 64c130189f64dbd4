//! Tails of distributions, so that every statistic can be given as a standard normal deviate.

use std::f64::consts::{FRAC_1_SQRT_2, LN_2};

/// ln of half of 2π.
const HALF_LN_TWO_PI: f64 = 0.918_938_533_204_672_8;

/// ln P(Z > z) of a standard normal Z, by its asymptotic series where erfc underflows.
pub fn ln_upper(z: f64) -> f64 {
    if z < 10.0 {
        return libm::log(libm::erfc(z * FRAC_1_SQRT_2)) - LN_2;
    }
    let u = 1.0 / (z * z);
    -0.5 * z * z - libm::log(z) - HALF_LN_TWO_PI + libm::log1p(u * (-1.0 + u * (3.0 - 15.0 * u)))
}

/// The quantile of the standard normal distribution at an upper tail, given by its logarithm: the z
/// with ln P(Z > z) = `ln_p`.
pub fn normal_quantile(ln_p: f64) -> f64 {
    let (mut low, mut high) = (-12.0, 1e6);
    // Halving a range of 1e6 to below the rounding of a double at 10.
    for _ in 0..72 {
        let middle = 0.5 * (low + high);
        if ln_upper(middle) > ln_p {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Normal deviate of a mean of squares with `dof` degrees of freedom over its expectation (Wilson
/// & Hilferty 1931).
pub fn chi_square(ratio: f64, dof: f64) -> f64 {
    let v = 2.0 / (9.0 * dof);
    (libm::cbrt(ratio.max(0.0)) - (1.0 - v)) / v.sqrt()
}

/// Normal deviate of the ratio of two mean squares of one expectation, with so many degrees of
/// freedom above and below: Fisher's F (Paulson 1942, Ann. Math. Stat. 13, 233; from three degrees
/// below).
pub fn variance_ratio(ratio: f64, [above, below]: [f64; 2]) -> f64 {
    let (root, v, w) = (libm::cbrt(ratio.max(0.0)), 2.0 / (9.0 * above), 2.0 / (9.0 * below));
    ((1.0 - w) * root - (1.0 - v)) / (v + w * root * root).sqrt()
}

/// χ² over its degrees of freedom ν where it is beyond chance: five standard deviations √(2ν) above
/// its mean, a false alarm in some thousand sets of normal errors.
///
/// ```
/// use camrig_base::tails::misfit;
///
/// assert_eq!((misfit(24.0, 8.0), misfit(32.0, 8.0)), (None, Some(4.0)));
/// ```
pub fn misfit(chi2: f64, freedom: f64) -> Option<f64> {
    const MAX_DEVIATION: f64 = 5.0;
    (chi2 > freedom + MAX_DEVIATION * (2.0 * freedom).sqrt()).then(|| chi2 / freedom)
}

/// Median of a mean of squares with `dof` degrees of freedom over its expectation (Wilson &
/// Hilferty 1931).
pub fn median_of_squares(dof: f64) -> f64 {
    quantile_of_squares(0.0, dof)
}

/// What a mean of squares with `dof` degrees of freedom over its expectation passes as rarely as a
/// standard normal deviate passes `z` (Wilson & Hilferty 1931).
pub fn quantile_of_squares(z: f64, dof: f64) -> f64 {
    let v = 2.0 / (9.0 * dof);
    (1.0 - v + z * v.sqrt()).max(0.0).powi(3)
}

/// What a normal deviate over a standard deviation estimated with `dof` degrees of freedom passes
/// as rarely as a standard normal one passes `z`: Student's t (Abramowitz & Stegun, 26.7.5; 0.1 %
/// of it from 7 degrees and `z` of 2).
pub fn student(z: f64, dof: f64) -> f64 {
    let (z2, v) = (z * z, 1.0 / dof);
    let second = (5.0 * z2 * z2 + 16.0 * z2 + 3.0) / 96.0;
    let third = (((3.0 * z2 + 19.0) * z2 + 17.0) * z2 - 15.0) / 384.0;
    z * (1.0 + v * ((z2 + 1.0) / 4.0 + v * (second + v * third)))
}

/// Normal deviate of the largest of `count` independent standard normal deviates.
pub fn largest(z: f64, count: usize) -> f64 {
    let ln_expected = libm::log(count.max(1) as f64) + ln_upper(z);
    // P(any) = 1 − exp(−expected).
    normal_quantile(if ln_expected < -30.0 {
        ln_expected
    } else {
        libm::log(-libm::expm1(-libm::exp(ln_expected)))
    })
}

/// Normal deviate of a count of which `runs` replicates of the model had `total` together: the
/// predictive law is negative binomial (a gamma prior of shape ½ for the rate, Jeffreys').
pub fn count(seen: f64, total: f64, runs: f64) -> f64 {
    let shape = total + 0.5;
    let (p, q) = (1.0 / (1.0 + runs), runs / (1.0 + runs));
    // From the mean on both tails are summed term by term; far out a normal law on the root scale
    // serves.
    let mean = shape / runs;
    if mean > 200.0 || seen > 2000.0 {
        let sd = (mean * (1.0 + 1.0 / runs)).sqrt();
        return 2.0 * ((seen + 0.375).sqrt() - (mean + 0.375).sqrt()) * mean.sqrt() / sd;
    }
    let ln_term = |k: f64| {
        libm::lgamma(k + shape) - libm::lgamma(shape) - libm::lgamma(k + 1.0)
            + shape * libm::log(q)
            + k * libm::log(p)
    };
    let mut below = 0.0;
    let mut k = 0.0;
    while k < seen {
        below += libm::exp(ln_term(k));
        k += 1.0;
    }
    // Half of the observed count's own chance to either side keeps the deviate centred.
    let here = libm::exp(ln_term(seen));
    let mut above = 0.5 * here;
    let mut k = seen + 1.0;
    loop {
        let term = libm::exp(ln_term(k));
        above += term;
        if term < 1e-17 * above || k > seen + 4000.0 || term < 1e-300 {
            break;
        }
        k += 1.0;
    }
    if above < 0.5 {
        normal_quantile(libm::log(above.max(1e-290)))
    } else {
        -normal_quantile(libm::log((below + 0.5 * here).clamp(1e-290, 0.5)))
    }
}

/// P(|T| > |t|) of Student's t with `dof` degrees of freedom.
pub fn student_two_sided(t: f64, dof: f64) -> f64 {
    incomplete_beta(dof / 2.0, 0.5, dof / (dof + t * t))
}

/// P(F > f) of Fisher's F with `a` degrees of freedom over `b`.
pub fn fisher_upper(f: f64, a: f64, b: f64) -> f64 {
    if f <= 0.0 { 1.0 } else { incomplete_beta(b / 2.0, a / 2.0, b / (b + a * f)) }
}

/// P(N ≥ n) of a Poisson law with this mean.
pub fn poisson_at_least(n: usize, mean: f64) -> f64 {
    let mut term = libm::exp(-mean);
    let mut below = 0.0;
    for k in 0..n {
        below += term;
        term *= mean / (k as f64 + 1.0);
    }
    (1.0 - below).max(0.0)
}

/// P(N ≤ n) of a binomial law of `trials` with the probability `p`, 0 < p < 1.
pub fn binomial_at_most(n: usize, trials: usize, p: f64) -> f64 {
    let choose = |k: f64| {
        let t = trials as f64;
        libm::lgamma(t + 1.0) - libm::lgamma(k + 1.0) - libm::lgamma(t - k + 1.0)
    };
    let term = |k: f64| {
        libm::exp(choose(k) + k * libm::log(p) + (trials as f64 - k) * libm::log(1.0 - p))
    };
    (0..=n.min(trials)).map(|k| term(k as f64)).sum()
}

/// The regularised incomplete beta function, by its continued fraction (Abramowitz & Stegun,
/// 26.5.8), evaluated from the front (Lentz 1976).
fn incomplete_beta(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 || x >= 1.0 {
        return x.clamp(0.0, 1.0);
    }
    // The fraction converges fast below the mean; the function of 1 − x is its complement.
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - incomplete_beta(b, a, 1.0 - x);
    }
    let front = libm::lgamma(a + b) - libm::lgamma(a) - libm::lgamma(b)
        + a * libm::log(x)
        + b * libm::log(1.0 - x);
    let held = |v: f64| if v.abs() < 1e-300 { 1e-300 } else { v };
    let (mut c, mut d) = (1.0, 1.0 / held(1.0 - (a + b) * x / (a + 1.0)));
    let mut value = d;
    for m in 1..500 {
        let m = f64::from(m);
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        let before = value;
        for coefficient in [even, odd] {
            d = 1.0 / held(1.0 + coefficient * d);
            c = held(1.0 + coefficient / c);
            value *= d * c;
        }
        if (value / before - 1.0).abs() < 1e-14 {
            break;
        }
    }
    libm::exp(front) * value / a
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_invert_tails() {
        // Tail probabilities of the normal law (Abramowitz & Stegun, table 26.1).
        assert!((ln_upper(1.959_963_985).exp() - 0.025).abs() < 1e-9);
        assert!((ln_upper(5.0).exp() / 2.866_515_7e-7 - 1.0).abs() < 1e-6);
        for z in [-3.0, 0.0, 2.0, 9.99, 10.01, 50.0, 3000.0] {
            assert!((normal_quantile(ln_upper(z)) - z).abs() < 1e-6 * (1.0 + z.abs()), "{z}");
        }
    }

    #[test]
    fn the_median_of_squares_is_that_of_chi_square() {
        // Medians of χ² of 2, 10 and 100 degrees of freedom: 2 ln 2, 9.342, 99.334 (Abramowitz &
        // Stegun, table 26.8).
        for (dof, median, near) in
            [(2.0, 2.0 * LN_2, 0.02), (10.0, 9.342, 1e-3), (100.0, 99.334, 2e-5)]
        {
            assert!((median_of_squares(dof) / (median / dof) - 1.0).abs() < near, "{dof}");
            assert!((chi_square(quantile_of_squares(1.5, dof), dof) - 1.5).abs() < 1e-9);
        }
    }

    #[test]
    fn quantiles_of_student() {
        // Of 7, 15 and 30 degrees of freedom at 95 % and 97.5 % (Abramowitz & Stegun, table
        // 26.10).
        for (dof, at_95, at_975) in
            [(7.0, 1.895, 2.365), (15.0, 1.753, 2.131), (30.0, 1.697, 2.042)]
        {
            assert!((student(1.644_854, dof) - at_95).abs() < 1e-3, "{dof}");
            assert!((student(1.959_964, dof) - at_975).abs() < 2.5e-3, "{dof}");
        }
    }

    #[test]
    fn quantiles_of_fisher() {
        // At 95, 99 and 99.9 % (Abramowitz & Stegun, table 26.9).
        for (ratio, freedom, z) in [
            (2.35, [10.0, 20.0], 1.645),
            (3.37, [10.0, 20.0], 2.326),
            (1.75, [15.0, 120.0], 1.645),
            (2.78, [15.0, 120.0], 3.090),
        ] {
            // The table's last digit is 0.006 to 0.015 deviations.
            assert!((variance_ratio(ratio, freedom) - z).abs() < 0.02, "{ratio} {freedom:?}");
        }
    }

    #[test]
    fn largest_of_one_is_itself() {
        assert!((largest(2.0, 1) - 2.0).abs() < 0.1);
        // The median of the largest of 1000 is where a single one has 1 − 2^(−1/1000).
        let median = normal_quantile((1.0f64 - 0.5f64.powf(1e-3)).ln());
        assert!(largest(median, 1000).abs() < 1e-3);
    }

    #[test]
    fn counts_are_centred_and_ordered() {
        assert!(count(0.0, 0.0, 16.0).abs() < 0.3);
        assert!(count(3.0, 0.0, 16.0) > 3.0);
        assert!(count(100.0, 1600.0, 16.0).abs() < 0.1);
        assert!(count(150.0, 1600.0, 16.0) > 4.0 && count(60.0, 1600.0, 16.0) < -4.0);
    }

    #[test]
    fn tails_are_those_of_the_tables() {
        // Abramowitz & Stegun, tables 26.1, 26.9 and 26.10.
        assert!((normal_quantile(0.025_f64.ln()) - 1.959_963_985).abs() < 1e-8);
        assert!((student_two_sided(4.604, 4.0) - 0.01).abs() < 1e-5);
        assert!((student_two_sided(636.619, 1.0) - 0.001).abs() < 1e-7);
        assert!((fisher_upper(5.41, 3.0, 5.0) - 0.05).abs() < 1e-4);
        assert!((fisher_upper(16.26, 5.0, 5.0) - 0.0041).abs() < 1e-3);
        assert!((poisson_at_least(3, 1.0) - 0.080_301).abs() < 1e-6);
        assert!((binomial_at_most(1, 10, 0.5) - 11.0 / 1024.0).abs() < 1e-12);
        assert!((median_of_squares(4.0) - 3.357 / 4.0).abs() < 4e-3);
    }
}
