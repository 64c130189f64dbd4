//! The photon transfer fit of one channel: K, the dark noise and the dark current from moments.

use super::dark::{DarkLine, spans};
use super::fit::Fit;
use super::ladder::{Level, exposures};
use super::moments::Moments;
use super::response::Response;
use super::rounding::{QUANTISATION, rounding};
use super::value::Value;
use camrig_base::median::median;
use camrig_base::{Error, Result};

/// Whether flats, taken in the order of their light, still follow the straight part of the photon
/// transfer curve. The rule is stated in [`super::ptc`].
#[derive(Clone, Debug, Default)]
pub struct Knee {
    ratios: Vec<f64>,
    plateau: Option<f64>,
}

impl Knee {
    /// Judges the next brighter level: mean signal and temporal variance above dark.
    pub fn passes(&mut self, m: &Moments, signal: f64, variance: f64) -> bool {
        let ratio = variance / signal;
        let bent = self.ratios.len() >= 2
            && ratio < 0.7 * median(&mut self.ratios.clone(), f64::total_cmp);
        if self.plateau.is_some() || m.whites > 1e-3 || bent {
            self.plateau = Some(self.plateau.unwrap_or(0.0).max(m.mean()));
            return false;
        }
        // Only levels well above the noise of the dark tell the ratio.
        if variance > 5.0 * m.temporal_error {
            self.ratios.push(ratio);
        }
        true
    }

    /// Mean DN of the brightest level that did not pass, when any did not.
    pub fn plateau(&self) -> Option<f64> {
        self.plateau
    }

    /// Whether a level that passed lies clear of where the saturated ones stand, and of the white
    /// level: four standard deviations of its samples.
    pub fn clear(&self, m: &Moments, white: f64) -> bool {
        let spread = (m.temporal + m.plane.measured).sqrt();
        m.mean() + 4.0 * spread < self.plateau.unwrap_or(white).min(white)
    }
}

/// The photon transfer of one channel.
#[derive(Clone, Debug)]
pub struct Transfer {
    /// K at small signals, DN/e⁻.
    pub gain: Value,
    /// Temporal variance of the dark at zero exposure, DN².
    pub dark_variance: Value,
    /// Covariance of `gain` and `dark_variance`.
    covariance: f64,
    /// Growth of the dark's variance, DN²/s, where there are two exposure times.
    pub dark_variance_rate: Option<Value>,
    /// Dark mean over exposure.
    pub dark: DarkLine,
    /// The response curve, where the light of five or more levels is known.
    pub response: Option<Response>,
    /// Per flat: signal above dark, DN.
    pub signals: Vec<f64>,
    /// Per flat: whether the fit used it.
    pub used: Vec<bool>,
    /// χ² per degree of freedom.
    pub reduced_chi2: f64,
    /// K of the fit that takes the response for a straight line.
    pub gain_if_straight: Value,
    /// Plateau of saturated levels, DN, and their share of samples at the white level.
    pub plateau: Option<(f64, f64)>,
}

impl Transfer {
    /// Fits one channel. `flats` in the order of their light, `passed` from [`Knee`].
    ///
    /// # Errors
    /// Fewer than two levels left to fit, or a fit that comes out without a positive gain.
    pub fn fit(
        channel: usize,
        darks: &[Level],
        flats: &[Level],
        passed: &[bool],
        knee: &Knee,
        white: f64,
    ) -> Result<Self> {
        let dark = DarkLine::of(darks, channel);
        let signal: Vec<Value> = flats
            .iter()
            .map(|f| {
                let m = &f.channels[channel];
                let d = dark.mean_at(f.exposure_s);
                Value::new(m.mean() - d.value, m.mean_error().hypot(d.std_error))
            })
            .collect();
        let mut used: Vec<bool> = flats
            .iter()
            .zip(passed)
            .map(|(f, &ok)| ok && knee.clear(&f.channels[channel], white))
            .collect();
        let light = exposures(flats);
        loop {
            if used.iter().filter(|u| **u).count() < 2 {
                return Err(Error::input("fewer than two flat levels below saturation").help(
                    "photon transfer needs flats at several exposures between dark and \
                     saturation; see the levels' share of samples at the white level",
                ));
            }
            let response = light.as_ref().and_then(|h| fit_response(h, &signal, &used));
            let data = Data { channel, darks, flats, signal: &signal, used: &used };
            let fit = data.fit(response)?;
            let top = used.iter().rposition(|u| *u).unwrap_or(0);
            if data.below_the_rest(top, response)? {
                used[top] = false;
                continue;
            }
            let straight = data.fit(None)?;
            if fit.gain.value.is_nan() || fit.gain.value <= 0.0 {
                return Err(Error::input(format!(
                    "the variance does not grow with the signal (K = {:.3e} DN/e⁻)",
                    fit.gain.value
                ))
                .help("check that flats and darks are raw frames of one analog gain"));
            }
            let plateau = knee.plateau().map(|mean| {
                let top = flats.iter().map(|f| &f.channels[channel]);
                let whites = top.map(|m| m.whites).fold(0.0, f64::max);
                (mean, whites)
            });
            return Ok(Self {
                gain: fit.gain,
                dark_variance: fit.dark_variance,
                covariance: fit.covariance,
                dark_variance_rate: fit.rate,
                dark,
                response: fit.response,
                signals: signal.iter().map(|s| s.value).collect(),
                used,
                reduced_chi2: fit.reduced_chi2,
                gain_if_straight: straight.gain,
                plateau,
            });
        }
    }

    /// Read noise at zero exposure, e⁻, without quantisation; `None` where quantisation hides it.
    ///
    /// `spread` is the variance over pixels of the dark's mean, DN²: noise of less than a DN is
    /// rounded differently at different places between two codes.
    pub fn read_noise(&self, spread: f64) -> Option<Value> {
        let (k, v) = (self.gain, self.dark_variance);
        let (black, _) = self.dark.offset_and_rate();
        let mut variance = v.value - QUANTISATION;
        for _ in 0..50 {
            variance = v.value - rounding(variance.max(0.0), black.value, spread.max(0.0));
        }
        if variance <= 0.0 {
            return None;
        }
        let noise = variance.sqrt() / k.value;
        // σ = sqrt(V - 1/12) / K: relative errors of both, and their covariance.
        let relative = (0.5 * v.std_error / variance).powi(2) + (k.std_error / k.value).powi(2)
            - self.covariance / (variance * k.value);
        Some(Value::new(noise, noise * relative.max(0.0).sqrt()))
    }

    /// Saturation, e⁻: where the brightest levels stand when they are saturated throughout (more
    /// than half the samples at the white level, or a temporal variance below a tenth of what
    /// their signal's shot noise would be).
    pub fn full_well(&self, flats: &[Level], channel: usize, white: f64) -> Option<Value> {
        let (plateau, whites) = self.plateau?;
        let (black, _) = self.dark.offset_and_rate();
        let top = flats.iter().zip(&self.used).filter(|(_, used)| !**used);
        let brightest =
            top.map(|(f, _)| &f.channels[channel]).max_by(|a, b| a.mean().total_cmp(&b.mean()))?;
        let shot = self.gain.value * (brightest.mean() - black.value);
        if whites <= 0.5 && brightest.temporal - self.dark_variance.value > 0.1 * shot {
            return None;
        }
        let level = if whites > 0.5 { white } else { plateau };
        let signal = level - black.value;
        let signal = self.response.map_or(signal, |r| r.linearise(signal));
        // The plateau of a fixed-pattern sensor is known to its scatter over the pixels.
        let error = (brightest.plane.measured / brightest.pixels()).sqrt().hypot(black.std_error);
        Some(Value::new(signal, error).over(self.gain))
    }
}

fn fit_response(light: &[f64], signal: &[Value], used: &[bool]) -> Option<Response> {
    let chosen: Vec<usize> = (0..used.len()).filter(|&i| used[i]).collect();
    let h: Vec<f64> = chosen.iter().map(|&i| light[i]).collect();
    let s: Vec<f64> = chosen.iter().map(|&i| signal[i].value).collect();
    let e: Vec<f64> = chosen.iter().map(|&i| signal[i].std_error).collect();
    Response::fit(&h, &s, &e)
}

struct Data<'a> {
    channel: usize,
    darks: &'a [Level],
    flats: &'a [Level],
    signal: &'a [Value],
    used: &'a [bool],
}

/// What a fit of the variances gives.
struct VarianceFit {
    gain: Value,
    dark_variance: Value,
    rate: Option<Value>,
    covariance: f64,
    response: Option<Response>,
    reduced_chi2: f64,
    lines: Fit,
}

impl Data<'_> {
    /// Weighted fit of darks and used flats to `V = K x g'² + V₀ + V₁ t`. The curve g that the
    /// means gave enters as a datum with its error, so that the variances have their say where the
    /// light was not steady (Gauss-Newton in the curve's quadratic coefficient). Sampling errors
    /// are those of the fitted variances, not of the measured ones, which would pull the fit down;
    /// they are widened to the scatter of the variances.
    fn fit(&self, from_means: Option<Response>) -> Result<VarianceFit> {
        let levels: Vec<(Option<usize>, &Level)> = (self.darks.iter().map(|d| (None, d)))
            .chain(
                (0..self.flats.len()).filter(|&i| self.used[i]).map(|i| (Some(i), &self.flats[i])),
            )
            .collect();
        let moments = levels.iter().map(|(_, l)| &l.channels[self.channel]);
        let measured: Vec<f64> = moments.clone().map(|m| m.temporal).collect();
        let sampling: Vec<f64> = moments.map(variance_error).collect();
        let exposures: Vec<f64> = self.darks.iter().map(|d| d.exposure_s).collect();
        let has_rate = spans(&exposures);

        let mut curve = from_means;
        let mut gain = 0.0;
        let mut errors = sampling.clone();
        let mut scatter = 1.0;
        let mut pass = 0;
        loop {
            let mut design: Vec<Vec<f64>> = Vec::with_capacity(levels.len() + 1);
            for (flat, level) in &levels {
                let s = flat.map_or(0.0, |i| self.signal[i].value);
                let mut row = vec![abscissa(s, curve.as_ref()), 1.0];
                row.extend(curve.map(|c| gain * abscissa_slope(s, &c)));
                row.extend(has_rate.then_some(level.exposure_s));
                design.push(row);
            }
            let mut y = measured.clone();
            let mut e: Vec<f64> =
                errors.iter().map(|e| e * f64::max(scatter, 1.0).sqrt()).collect();
            if let (Some(now), Some(datum)) = (curve, from_means) {
                let mut row = vec![0.0; design[0].len()];
                row[2] = 1.0;
                design.push(row);
                y.push(datum.quadratic.value - now.quadratic.value);
                e.push(datum.quadratic.std_error);
            }
            let lines = Fit::new(&design, &y, &e)?;
            gain = lines.coefficients[0];
            if let Some(c) = &mut curve {
                let moved = c.quadratic.value + lines.coefficients[2];
                let error = lines.covariance(2, 2).sqrt();
                *c = c.with_quadratic(Value::new(moved, error));
            }
            pass += 1;
            if pass == 2 {
                scatter = lines.reduced_chi2();
            }
            if pass == 5 {
                let of =
                    |j: usize| Value::new(lines.coefficients[j], lines.covariance(j, j).sqrt());
                return Ok(VarianceFit {
                    gain: of(0),
                    dark_variance: of(1),
                    rate: has_rate.then(|| of(design[0].len() - 1)),
                    covariance: lines.covariance(0, 1),
                    response: curve,
                    reduced_chi2: scatter,
                    lines,
                });
            }
            for i in 0..levels.len() {
                let terms = design[i].iter().zip(&lines.coefficients);
                let model: f64 = terms.map(|(a, c)| a * c).sum();
                let ratio = if measured[i] > 0.0 { model / measured[i] } else { 1.0 };
                errors[i] = sampling[i] * ratio.clamp(0.5, 2.0);
            }
        }
    }

    /// Whether the brightest level's variance lies more than 3.5 standard errors below the fit to
    /// the others (three or more): the first sign of the full-well knee.
    fn below_the_rest(&self, top: usize, response: Option<Response>) -> Result<bool> {
        if self.used.iter().filter(|u| **u).count() < 4 {
            return Ok(false);
        }
        let mut others = self.used.to_vec();
        others[top] = false;
        let fit = Data { used: &others, ..*self }.fit(response)?;
        let (m, t) = (&self.flats[top].channels[self.channel], self.flats[top].exposure_s);
        let s = self.signal[top].value;
        let mut row = vec![abscissa(s, fit.response.as_ref()), 1.0];
        row.extend(fit.response.map(|c| fit.gain.value * abscissa_slope(s, &c)));
        row.extend(fit.rate.map(|_| t));
        let mut model = 0.0;
        let mut variance = m.temporal_error.powi(2) * fit.reduced_chi2.max(1.0);
        for (i, a) in row.iter().enumerate() {
            // The curve's shift is already in the abscissa.
            if fit.response.is_none() || i != 2 {
                model += a * fit.lines.coefficients[i];
            }
            for (j, b) in row.iter().enumerate() {
                variance += a * b * fit.lines.covariance(i, j);
            }
        }
        Ok((m.temporal - model) / variance.sqrt() < -3.5)
    }
}

/// Standard error of a level's temporal variance. A constant frame has no scatter; its variance is
/// still known only as well as rounding lets one see.
fn variance_error(m: &Moments) -> f64 {
    let samples = m.pixels() * m.frames as f64;
    m.temporal_error.max(QUANTISATION * (2.0 / samples).sqrt())
}

/// x g'(x)²: what multiplies K in the variance of a flat with signal `s`.
fn abscissa(s: f64, response: Option<&Response>) -> f64 {
    match response {
        Some(r) => {
            let x = r.linearise(s);
            x * r.slope(x).powi(2)
        }
        None => s,
    }
}

/// d(x g'²)/dq, by a central difference wide enough for rounding and narrow enough for the curve.
fn abscissa_slope(s: f64, response: &Response) -> f64 {
    let q = response.quadratic.value;
    let step = 1e-4 / s.abs().max(1.0);
    let at = |q: f64| abscissa(s, Some(&response.with_quadratic(Value::new(q, 0.0))));
    (at(q + step) - at(q - step)) / (2.0 * step)
}
