//! Tails of the distributions that thresholds come from.

use std::f64::consts::FRAC_1_SQRT_2;

/// P(Z > z) of a standard normal Z.
pub fn normal_upper(z: f64) -> f64 {
    0.5 * libm::erfc(z * FRAC_1_SQRT_2)
}

/// The z that a standard normal deviate passes with the probability `p`, 0 < p < 1.
pub fn normal_deviate(p: f64) -> f64 {
    bisect((-38.0, 38.0), |z| normal_upper(z) > p)
}

/// Median of a sum of squares of `dof` standard normal deviates, over `dof` (Wilson & Hilferty
/// 1931).
pub fn median_of_squares(dof: f64) -> f64 {
    squares(0.0, dof)
}

/// What a sum of squares of `dof` standard normal deviates over `dof` passes as rarely as a
/// standard normal deviate passes `z` (Wilson & Hilferty 1931).
pub fn squares(z: f64, dof: f64) -> f64 {
    let v = 2.0 / (9.0 * dof);
    (1.0 - v + z * v.sqrt()).max(0.0).powi(3)
}

/// P(|T| > |t|) of Student's t with `dof` degrees of freedom.
pub fn student_both(t: f64, dof: f64) -> f64 {
    incomplete_beta(dof / 2.0, 0.5, dof / (dof + t * t))
}

/// P(F > f) of Fisher's F with `a` degrees of freedom over `b`.
pub fn fisher_upper(f: f64, a: f64, b: f64) -> f64 {
    if f <= 0.0 { 1.0 } else { incomplete_beta(b / 2.0, a / 2.0, b / (b + a * f)) }
}

/// P(N ≥ n) of a Poisson law with this mean.
pub fn poisson_least(n: usize, mean: f64) -> f64 {
    let mut term = (-mean).exp();
    let mut below = 0.0;
    for k in 0..n {
        below += term;
        term *= mean / (k as f64 + 1.0);
    }
    (1.0 - below).max(0.0)
}

/// P(N ≤ n) of a binomial law of `trials` with the probability `p`, 0 < p < 1.
pub fn binomial_most(n: usize, trials: usize, p: f64) -> f64 {
    let choose = |k: f64| {
        let t = trials as f64;
        libm::lgamma(t + 1.0) - libm::lgamma(k + 1.0) - libm::lgamma(t - k + 1.0)
    };
    let term = |k: f64| (choose(k) + k * p.ln() + (trials as f64 - k) * (1.0 - p).ln()).exp();
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
    let front =
        libm::lgamma(a + b) - libm::lgamma(a) - libm::lgamma(b) + a * x.ln() + b * (1.0 - x).ln();
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
    front.exp() * value / a
}

/// Where `above` stops to hold, to the rounding of a double.
fn bisect((mut low, mut high): (f64, f64), above: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..64 {
        let middle = 0.5 * (low + high);
        if above(middle) { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_are_those_of_the_tables() {
        // Abramowitz & Stegun, tables 26.1, 26.9 and 26.10.
        assert!((normal_deviate(0.025) - 1.959_963_985).abs() < 1e-8);
        assert!((student_both(4.604, 4.0) - 0.01).abs() < 1e-5);
        assert!((student_both(636.619, 1.0) - 0.001).abs() < 1e-7);
        assert!((fisher_upper(5.41, 3.0, 5.0) - 0.05).abs() < 1e-4);
        assert!((fisher_upper(16.26, 5.0, 5.0) - 0.0041).abs() < 1e-3);
        assert!((poisson_least(3, 1.0) - 0.080_301).abs() < 1e-6);
        assert!((binomial_most(1, 10, 0.5) - 11.0 / 1024.0).abs() < 1e-12);
        assert!((median_of_squares(4.0) - 3.357 / 4.0).abs() < 4e-3);
    }
}
