//! System gain and response from means and variances of flats together.
//!
//! A pixel with n electrons gives, above black and in DN,
//!
//! m = K n (1 − a (n/W)^p),  V = (dm/dn)² n
//!
//! with K the DN per electron at an analog gain, W the electrons at the top of the converter's
//! range at unity gain, a the loss there and p its exponent: the effect `nonlinearity` of a camera
//! file (Janesick, *Photon Transfer*, 2007, ch. 7). Read noise is taken off beforehand
//! ([`camrig_estimates::flat`]). Variance over mean needs no light. Where the light of the flats is
//! known, n = q · photons for each wavelength and site of the colour filter pattern, and the means
//! count too: they are what shows a bend best. Light is stated with errors of its own, so where the
//! means scatter more than by noise, they count less accordingly.
//!
//! K of each gain, a and all q are fitted together, for each exponent of `EXPONENTS` and for a
//! straight line; the least χ² + k ln n of k parameters and n data wins (Schwarz 1978), n ln χ²
//! where no curve fits to within the errors.

use camrig_base::Value;
use camrig_base::median::median;
use camrig_base::{Error, Result};
use camrig_linear::{LeastSquares, Matrix, Vector};

/// Exponents of the response that are tried: from a bend at small signals to one near saturation.
const EXPONENTS: [f64; 8] = [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0];
/// Passes of the Gauss-Newton fit, each with half the error of the one before at worst.
const PASSES: usize = 20;
/// Relative change of the parameters at which it ends.
const SMALL: f64 = 1e-10;
/// Passes in which the error of the stated light is found from the scatter of the means.
const LIGHT_PASSES: usize = 3;
/// Passes that invert the response: the loss is at most a half, so that each halves the error.
const INVERSIONS: usize = 60;
/// Standard errors from which a response is bent.
const MIN_DEVIATION: f64 = 3.0;
/// Largest loss that is tried, that of the effect.
const MAX_LOSS: f64 = 0.5;

/// A flat at one site.
#[derive(Clone, Copy, Debug)]
pub struct Datum {
    /// Which of the gains.
    pub gain: usize,
    /// Which wavelength and site: what shares a quantum efficiency.
    pub light_of: usize,
    /// Photons per pixel; none where they are not known.
    pub photons: Option<f64>,
    /// Mean above black, DN.
    pub level: Value,
    /// What of it is dark signal, DN.
    pub dark_dn: f64,
    /// Variance over frames without read noise, over `level`: DN.
    pub ratio: Value,
}

/// Gains and response.
#[derive(Clone, Debug)]
pub struct Response {
    /// DN per electron at each gain.
    pub gains: Vec<Value>,
    /// Covariance of these.
    pub covariance: Matrix,
    /// Loss and exponent; none of a straight response.
    pub bend: Option<Bend>,
    /// Electrons per photon of each wavelength and site; none where the light is not known.
    pub efficiency: Vec<Value>,
    /// χ² of the variances and how many there are.
    pub chi2: f64,
    /// See `chi2`.
    pub data: usize,
    /// Relative error of the stated light, from the scatter of the means.
    pub light_error: f64,
    top_e: f64,
}

/// A response that is not straight.
#[derive(Clone, Copy, Debug)]
pub struct Bend {
    /// Loss at the top of the converter's range at unity gain.
    pub loss: Value,
    /// Exponent.
    pub exponent: f64,
}

impl Response {
    /// Distance of the exponents that were tried.
    pub fn exponent_step(&self) -> f64 {
        EXPONENTS[1] - EXPONENTS[0]
    }

    /// The relative change of a level, dm/m, for a relative change of the charge, dn/n, at a level
    /// of a gain in DN.
    pub fn slope(&self, gain: usize, level_dn: f64) -> f64 {
        let (loss, exponent) = self.bend.map_or((0.0, 1.0), |b| (b.loss.value, b.exponent));
        let law = Law { loss, exponent, top_e: self.top_e };
        let k = self.gains[gain].value;
        let n = law.electrons(level_dn / k);
        law.slope(n) * n * k / level_dn
    }
}

/// The response with K = 1.
#[derive(Clone, Copy)]
struct Law {
    loss: f64,
    exponent: f64,
    top_e: f64,
}

impl Law {
    fn power(&self, n: f64) -> f64 {
        libm::pow((n / self.top_e).max(0.0), self.exponent)
    }

    fn level(&self, n: f64) -> f64 {
        n * (1.0 - self.loss * self.power(n))
    }

    fn slope(&self, n: f64) -> f64 {
        1.0 - self.loss * (1.0 + self.exponent) * self.power(n)
    }

    fn electrons(&self, level: f64) -> f64 {
        (0..INVERSIONS).fold(level, |n, _| level / (1.0 - self.loss * self.power(n)).max(0.5))
    }
}

/// The fit of one exponent, or of a straight line.
struct Try<'a> {
    data: &'a [Datum],
    stated: &'a [f64],
    exponent: Option<f64>,
    /// Photons that quantum efficiencies are scaled by, so that parameters are near 1.
    lit: bool,
    lights: usize,
    light_error: f64,
    /// Codes of the converter's range.
    top_dn: f64,
}

struct Fitted {
    parameters: Vec<f64>,
    covariance: Matrix,
    chi2: f64,
}

impl Try<'_> {
    /// K of each gain, the loss if there is one, the efficiencies if there is light.
    fn law(&self, p: &[f64]) -> Law {
        let gains = self.stated.len();
        let loss = self.exponent.map_or(0.0, |_| p[gains].clamp(-MAX_LOSS, MAX_LOSS));
        let top_e = self.top_dn * self.stated[0] / p[0];
        Law { loss, exponent: self.exponent.unwrap_or(1.0), top_e }
    }

    fn efficiency<'p>(&self, p: &'p [f64]) -> &'p [f64] {
        &p[p.len() - if self.lit { self.lights } else { 0 }..]
    }

    /// Residuals of the variances, then those of the means, over their errors.
    fn residuals(&self, p: &[f64]) -> Vec<f64> {
        let law = self.law(p);
        let of_variance = |d: &Datum| {
            let k = p[d.gain];
            let n = law.electrons(d.level.value / k);
            let slope = law.slope(n);
            (d.ratio.value - k * k * slope * slope * n / d.level.value) / d.ratio.std_error
        };
        let of_mean = |d: &Datum| {
            let (k, q) = (p[d.gain], self.efficiency(p).get(d.light_of)?);
            let n = q * d.photons? + d.dark_dn / k;
            let error = libm::hypot(d.level.std_error, self.light_error * d.level.value);
            Some((d.level.value - k * law.level(n)) / error)
        };
        let means = self.data.iter().filter_map(of_mean);
        self.data.iter().map(of_variance).chain(means).collect()
    }

    fn start(&self) -> Vec<f64> {
        let gain = |g: usize| {
            let of = self.data.iter().filter(|d| d.gain == g);
            Value::combine(of.map(|d| d.ratio)).map_or(1.0, |v| v.value)
        };
        let gains: Vec<f64> = (0..self.stated.len()).map(gain).collect();
        let light = |l: usize| {
            let of = self.data.iter().filter(|d| d.light_of == l);
            let own =
                of.filter_map(|d| Some((d.level.value - d.dark_dn) / gains[d.gain] / d.photons?));
            median(&mut own.collect::<Vec<_>>(), f64::total_cmp)
        };
        let lights: Vec<f64> =
            if self.lit { (0..self.lights).map(light).collect() } else { Vec::new() };
        let loss = self.exponent.map(|_| 0.0);
        gains.into_iter().chain(loss).chain(lights).collect()
    }

    /// Gauss-Newton, with steps that are halved until they go downhill.
    fn fit(&self) -> Option<Fitted> {
        let sum = |r: &[f64]| r.iter().map(|v| v * v).sum::<f64>();
        let mut p = self.start();
        let mut residuals = self.residuals(&p);
        let mut covariance = None;
        for _ in 0..PASSES {
            // The loss is a number of some per cent, the others are in proportion.
            let step: Vec<f64> = p.iter().map(|v| (1e-5 * v.abs()).max(1e-7)).collect();
            let columns: Vec<Vec<f64>> = (0..p.len())
                .map(|j| {
                    let mut moved = p.clone();
                    moved[j] += step[j];
                    let of = self.residuals(&moved);
                    // In units of the step, so that the columns are of like size.
                    of.iter().zip(&residuals).map(|(a, b)| a - b).collect()
                })
                .collect();
            let design = Matrix::from_fn(residuals.len(), p.len(), |i, j| columns[j][i]);
            let target = Vector::from_fn(residuals.len(), |i, _| -residuals[i]);
            let solved = LeastSquares::of(&design, &target)?;
            covariance = Some(Matrix::from_fn(p.len(), p.len(), |i, j| {
                solved.covariance[(i, j)] * step[i] * step[j]
            }));
            let mut share = 1.0;
            let (next, next_residuals) = loop {
                let moved: Vec<f64> = (0..p.len())
                    .map(|j| p[j] + share * solved.coefficients[j] * step[j])
                    .collect();
                let of = self.residuals(&moved);
                if sum(&of) <= sum(&residuals) || share < 1e-3 {
                    break (moved, of);
                }
                share *= 0.5;
            };
            let change = |(a, b): (&f64, &f64)| (a - b).abs() <= SMALL * (1.0 + a.abs());
            let done = p.iter().zip(&next).all(change) || sum(&next_residuals) > sum(&residuals);
            (p, residuals) = (next, next_residuals);
            if done {
                break;
            }
        }
        Some(Fitted { chi2: sum(&residuals), parameters: p, covariance: covariance? })
    }

    /// χ² plus what its parameters cost; where the data scatter by more than their errors, as if
    /// these were larger accordingly.
    fn score(&self, fitted: &Fitted) -> f64 {
        let n = self.count() as f64;
        let over = (fitted.chi2 / n).max(1.0);
        let misfit = fitted.chi2 / over + n * libm::log(over);
        misfit + fitted.parameters.len() as f64 * libm::log(n)
    }

    fn count(&self) -> usize {
        self.data.len() * if self.lit { 2 } else { 1 }
    }
}

/// Fits the flats of all gains together. `stated` are the analog gains, `top_dn` the largest code.
///
/// # Errors
/// Data that do not determine the gains.
pub fn fit(data: &[Datum], stated: &[f64], top_dn: f64) -> Result<Response> {
    let lights = data.iter().map(|d| d.light_of + 1).max().unwrap_or(0);
    // A light that is stated once fits any mean.
    let lit = data.iter().all(|d| d.photons.is_some()) && data.len() > lights;
    let base = Try { data, stated, exponent: None, lit, lights, light_error: 0.0, top_dn };
    let tries = |light_error: f64, exponents: &[f64]| {
        let exponents = std::iter::once(None).chain(exponents.iter().copied().map(Some));
        let all = exponents.filter_map(|exponent| {
            let tried = Try { exponent, light_error, ..base };
            let fitted = tried.fit()?;
            Some((tried.score(&fitted), tried, fitted))
        });
        all.min_by(|a, b| a.0.total_cmp(&b.0))
    };
    let undetermined = || {
        Error::input("the flats do not tell the gain").help(
            "photon transfer needs flats between dark and saturation, each of two frames or more",
        )
    };
    let fitted = |exponents: &[f64]| {
        let (mut error, mut best) = (0.0, tries(0.0, exponents).ok_or_else(undetermined)?);
        for _ in 0..if lit { LIGHT_PASSES } else { 0 } {
            let next = light_error(&best.1, &best.2);
            if next <= error {
                break;
            }
            error = next;
            best = tries(error, exponents).ok_or_else(undetermined)?;
        }
        Ok((best.1, best.2))
    };
    let (tried, found) = fitted(&EXPONENTS)?;
    let all = response(&tried, &found);
    let clear = all.bend.is_none_or(|bend| bend.loss.z().abs() > MIN_DEVIATION);
    let all = match clear {
        true => all,
        false => fitted(&[]).map(|(tried, found)| response(&tried, &found))?,
    };
    if all.gains.iter().any(|k| !(k.value > 0.0 && k.std_error.is_finite())) {
        return Err(undetermined());
    }
    Ok(all)
}

/// What a fit says, with errors that are larger where the variances scatter by more than theirs.
fn response(tried: &Try<'_>, fitted: &Fitted) -> Response {
    let (data, stated) = (tried.data, tried.stated);
    let residuals = tried.residuals(&fitted.parameters);
    let chi2: f64 = residuals[..data.len()].iter().map(|r| r * r).sum();
    // Where no law fits, the errors are those that the misfit leaves.
    let freedom = data.len() as f64 - stated.len() as f64 - 1.0;
    let wider = if freedom > 0.0 { (chi2 / freedom).max(1.0) } else { 1.0 };
    let covariance = fitted.covariance.scale(wider);
    let value = |i: usize| Value::new(fitted.parameters[i], covariance[(i, i)].sqrt());
    let gains: Vec<Value> = (0..stated.len()).map(value).collect();
    let first = fitted.parameters.len() - if tried.lit { tried.lights } else { 0 };
    Response {
        bend: tried.exponent.map(|exponent| Bend { loss: value(stated.len()), exponent }),
        efficiency: (first..fitted.parameters.len()).map(value).collect(),
        covariance: Matrix::from_fn(gains.len(), gains.len(), |i, j| covariance[(i, j)]),
        chi2,
        data: data.len(),
        light_error: tried.light_error,
        top_e: tried.law(&fitted.parameters).top_e,
        gains,
    }
}

/// Relative error of the light with which the means scatter as they do; 0 where noise explains it.
fn light_error(tried: &Try<'_>, fitted: &Fitted) -> f64 {
    /// Standard deviations of χ² by which noise may exceed its mean.
    const MAX_DEVIATION: f64 = 3.0;
    let n = tried.data.len();
    let residuals = tried.residuals(&fitted.parameters);
    let freedom = (n as f64 - tried.lights as f64).max(1.0);
    let chi2: f64 = residuals[n..].iter().map(|r| r * r).sum();
    if chi2 <= freedom + MAX_DEVIATION * (2.0 * freedom).sqrt() {
        return tried.light_error;
    }
    let relative = |(d, r): (&Datum, &f64)| {
        let error = libm::hypot(d.level.std_error, tried.light_error * d.level.value);
        (r * error / d.level.value).powi(2) - (d.level.std_error / d.level.value).powi(2)
    };
    let sum: f64 = tried.data.iter().zip(&residuals[n..]).map(relative).sum();
    (sum / freedom).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Levels of a law without noise, with the errors that noise would give them.
    fn data(law: Law, gains: &[f64], k: f64, fills: &[f64], wrong: Option<usize>) -> Vec<Datum> {
        let mut data = Vec::new();
        for (g, gain) in gains.iter().enumerate() {
            for (i, fill) in fills.iter().enumerate() {
                let n = fill * law.top_e / gain;
                let (own, pixels, frames) = (k * gain, 2e4, 8.0f64);
                let level = own * law.level(n);
                let variance = (own * law.slope(n)).powi(2) * n;
                let error = (2.0f64 / (pixels * (frames - 1.0))).sqrt();
                let label = if wrong == Some(i) { 0.96 } else { 1.0 };
                data.push(Datum {
                    gain: g,
                    light_of: 0,
                    photons: Some(label * n / 0.6),
                    level: Value::new(level, (variance / (pixels * frames)).sqrt()),
                    dark_dn: 0.0,
                    ratio: Value::new(variance / level, error * variance / level),
                });
            }
        }
        data
    }

    const FILLS: [f64; 8] = [0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9];

    #[test]
    fn gain_loss_exponent_and_efficiency_come_back() {
        for (loss, exponent) in [(0.02, 1.0), (0.05, 3.0), (-0.01, 2.0), (0.03, 0.5)] {
            let law = Law { loss, exponent, top_e: 11_000.0 };
            let k = 4095.0 / law.top_e;
            let found =
                fit(&data(law, &[1.0, 4.0], k, &FILLS, None), &[1.0, 4.0], 4095.0).unwrap();
            let bend = found.bend.unwrap();
            assert_eq!(bend.exponent, exponent, "{found:?}");
            assert!((bend.loss.value - loss).abs() < 1e-6, "{found:?}");
            for (gain, found) in [1.0, 4.0].iter().zip(&found.gains) {
                assert!((found.value / (gain * k) - 1.0).abs() < 1e-6, "{found:?}");
            }
            assert!((found.efficiency[0].value - 0.6).abs() < 1e-6);
            // At 80 % of the range the level moves by less than the charge.
            let n = 0.8 * law.top_e;
            let right = law.slope(n) * n / law.level(n);
            assert!((found.slope(0, k * law.level(n)) - right).abs() < 1e-6);
        }
        let straight = Law { loss: 0.0, exponent: 1.0, top_e: 11_000.0 };
        let found = fit(&data(straight, &[1.0], 0.37, &FILLS, None), &[1.0], 4095.0).unwrap();
        assert!(found.bend.is_none() && found.light_error == 0.0);
    }

    /// A label of light 4 % off counts as much as its error: the gain stays that of the variances.
    #[test]
    fn a_wrong_label_does_not_move_the_gain() {
        let law = Law { loss: 0.02, exponent: 3.0, top_e: 11_000.0 };
        let k = 4095.0 / law.top_e;
        let found = fit(&data(law, &[1.0], k, &FILLS, Some(4)), &[1.0], 4095.0).unwrap();
        let gain = found.gains[0];
        assert!(found.light_error > 5e-3, "{found:?}");
        assert!((gain.value - k).abs() < 3.0 * gain.std_error, "{found:?}");
        assert!(gain.std_error < 0.01 * k, "{found:?}");
    }
}
