//! Effect of rounding to whole DN on the variance and on the mean of noise.

/// Variance of rounding to whole DN, DN² (uniform over one DN).
pub const QUANTISATION: f64 = 1.0 / 12.0;

/// Temporal variance of the dark, in squares of the codes' step (DN²), below which rounding is no
/// longer equivalent to added noise (EMVA 1288 release 4.0, eq. 53 and 54).
pub const QUANTISATION_LIMITED: f64 = 0.24;

/// Variance that rounding to whole DN adds to Gaussian noise of `variance` (DN²) around `mean`
/// (DN), which itself varies over pixels with the variance `spread` (DN²): 1/12 and the first
/// harmonic of the characteristic function, -cos(2πµ) exp(-2π² (σ² + s²)) (1/π² + 4 σ²) (Widrow
/// and Kollár, *Quantization Noise*, 2008, ch. 4); the second is below 1e-4 DN² for σ > 0.3 DN.
pub fn rounding(variance: f64, mean: f64, spread: f64) -> f64 {
    use std::f64::consts::PI;
    let fall = libm::exp(-2.0 * PI * PI * (variance + spread));
    QUANTISATION - libm::cos(2.0 * PI * mean) * fall * (1.0 / (PI * PI) + 4.0 * variance)
}

/// d/dσ² of the variance of rounded Gaussian noise, σ² + [`rounding`]: how much of a change of
/// the noise shows.
pub fn sensitivity(variance: f64, mean: f64, spread: f64) -> f64 {
    use std::f64::consts::PI;
    let fall = libm::exp(-2.0 * PI * PI * (variance + spread));
    1.0 - libm::cos(2.0 * PI * mean) * fall * (2.0 - 8.0 * PI * PI * variance)
}

/// Largest relative change by rounding to whole DN of differences of means that are much smaller
/// than a DN, under Gaussian noise of `variance` (DN², before rounding).
///
/// The mean of rounded samples is µ + Σ (−1)ᵏ/(πk) sin(2πkµ) exp(−2π²k²σ²) (Widrow and Kollár
/// 2008, ch. 4): its slope differs from 1 by up to 2 exp(−2π²σ²).
pub fn rounding_of_patterns(variance: f64) -> f64 {
    2.0 * libm::exp(-2.0 * std::f64::consts::PI.powi(2) * variance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_of_small_patterns() {
        // Slope of the mean of rounded Gaussian samples at a whole DN, where it is least, by
        // summing codes.
        for sigma in [0.3, 0.45, 0.6] {
            let mean = |mu: f64| {
                let density = |k: i32| (-0.5 * ((f64::from(k) * 1e-4 - mu) / sigma).powi(2)).exp();
                let all = -60_000..60_000;
                let sum: f64 =
                    all.clone().map(|k| density(k) * (f64::from(k) * 1e-4).round()).sum();
                sum / all.map(density).sum::<f64>()
            };
            let slope = (mean(0.01) - mean(-0.01)) / 0.02;
            let found = 1.0 - rounding_of_patterns(sigma * sigma);
            assert!((slope - found).abs() < 0.02, "{sigma}: {slope} {found}");
        }
    }

    #[test]
    fn rounding_of_little_noise() {
        // Variance of rounded Gaussian noise by summing over codes, against the formula.
        for (sigma, mean) in [(0.53, 64.0), (0.5, 10.5), (0.4, 3.25), (1.5, 7.0)] {
            let density = |x: f64| (-0.5 * ((x - mean) / sigma).powi(2)).exp();
            let (mut n, mut sum, mut square) = (0.0, 0.0, 0.0);
            for k in -200_000..200_000 {
                let x = mean + f64::from(k) * 1e-4;
                let (w, code) = (density(x), x.round());
                n += w;
                sum += w * (code - mean);
                square += w * (code - mean).powi(2);
            }
            let exact = square / n - (sum / n).powi(2);
            let found = sigma * sigma + rounding(sigma * sigma, mean, 0.0);
            // The squared shift of the mean and the second harmonic are neglected.
            assert!((exact - found).abs() < 4e-3, "{sigma} {mean}: {exact} {found}");
        }
    }
}
