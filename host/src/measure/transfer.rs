//! The photon transfer fit of one channel: K, the dark noise and the dark current from moments.

use super::fit::Fit;
use super::ladder::{Level, exposures};
use super::response::Response;
use super::stack::Moments;
use super::value::Value;
use crate::{Error, Result};

/// Variance of rounding to whole DN, DN² (uniform over one DN).
pub const QUANTISATION: f64 = 1.0 / 12.0;

/// Exposure times that agree to this fraction are one exposure time.
const SAME_EXPOSURE: f64 = 1e-6;

/// Mean and variance of the dark over exposure time.
#[derive(Clone, Debug)]
pub struct DarkLine {
    /// Exposure time s, mean DN, its error, variance DN², its error.
    points: Vec<[f64; 5]>,
    /// Line through the means, where there are two or more exposure times.
    line: Option<Fit>,
}

impl DarkLine {
    /// The dark of one channel.
    pub fn of(darks: &[Level], channel: usize) -> Self {
        let points: Vec<[f64; 5]> = darks
            .iter()
            .map(|d| {
                let m = &d.channels[channel];
                // A constant frame has no scatter; it is still known only to a DN's rounding.
                let floor = (QUANTISATION / (m.pixels() * m.frames as f64)).sqrt();
                let variance_error = m.temporal_error.max(floor);
                [d.exposure_s, m.mean(), m.mean_error().max(floor), m.temporal, variance_error]
            })
            .collect();
        let design: Vec<Vec<f64>> = points.iter().map(|p| vec![1.0, p[0]]).collect();
        let means: Vec<f64> = points.iter().map(|p| p[1]).collect();
        let errors: Vec<f64> = points.iter().map(|p| p[2]).collect();
        Self { line: Fit::new(&design, &means, &errors).ok(), points }
    }

    /// Mean of the dark at an exposure time: of the darks of that exposure, else on the line
    /// through all, else of the only dark there is. DN, with its error.
    pub fn mean_at(&self, exposure_s: f64) -> Value {
        let same: Vec<Value> = self
            .points
            .iter()
            .filter(|p| (p[0] - exposure_s).abs() <= SAME_EXPOSURE * exposure_s)
            .map(|p| Value::new(p[1], p[2]))
            .collect();
        if let Some(mean) = Value::combine(&same) {
            return mean;
        }
        match &self.line {
            Some(fit) => {
                let c = &fit.coefficients;
                let variance = fit.covariance(0, 0)
                    + 2.0 * exposure_s * fit.covariance(0, 1)
                    + exposure_s * exposure_s * fit.covariance(1, 1);
                let error = (variance * fit.reduced_chi2().max(1.0)).sqrt();
                Value::new(c[0] + c[1] * exposure_s, error)
            }
            None => Value::new(self.points[0][1], self.points[0][2]),
        }
    }

    /// DN at zero exposure, and DN per second; the latter `None` with one exposure time.
    pub fn offset_and_rate(&self) -> (Value, Option<Value>) {
        match &self.line {
            Some(fit) => {
                let of = |j| Value::new(fit.coefficients[j], fit.std_error(j));
                (of(0), Some(of(1)))
            }
            None => (self.mean_at(self.points[0][0]), None),
        }
    }
}

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
        let mut sorted = self.ratios.clone();
        sorted.sort_by(f64::total_cmp);
        let ratio = variance / signal;
        let bent = sorted.len() >= 2 && ratio < 0.7 * sorted[sorted.len() / 2];
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
            let fit = data.fit(response.as_ref())?;
            let top = used.iter().rposition(|u| *u).unwrap_or(0);
            if data.below_the_rest(top, response.as_ref())? {
                used[top] = false;
                continue;
            }
            let straight = data.fit(None)?;
            let mut gain = Value::new(fit.coefficients[0], fit.std_error(0));
            if let Some(r) = &response {
                // The curve's own uncertainty moves K: refit with the curve moved by its error.
                let q = r.quadratic;
                let moved = data.fit(Some(&r.with_quadratic(q.value + q.std_error)))?;
                gain.std_error = gain.std_error.hypot(moved.coefficients[0] - gain.value);
            }
            if gain.value.is_nan() || gain.value <= 0.0 {
                return Err(Error::input(format!(
                    "the variance does not grow with the signal (K = {:.3e} DN/e⁻)",
                    gain.value
                ))
                .help("check that flats and darks are raw frames of one analog gain"));
            }
            let with_rate = fit.coefficients.len() == 3;
            let plateau = knee.plateau().map(|mean| {
                let top = flats.iter().map(|f| &f.channels[channel]);
                let whites = top.map(|m| m.whites).fold(0.0, f64::max);
                (mean, whites)
            });
            return Ok(Self {
                gain,
                dark_variance: Value::new(fit.coefficients[1], fit.std_error(1)),
                covariance: fit.covariance(0, 1),
                dark_variance_rate: with_rate
                    .then(|| Value::new(fit.coefficients[2], fit.std_error(2))),
                dark,
                response,
                signals: signal.iter().map(|s| s.value).collect(),
                used,
                reduced_chi2: fit.reduced_chi2(),
                gain_if_straight: Value::new(straight.coefficients[0], straight.std_error(0)),
                plateau,
            });
        }
    }

    /// Read noise at zero exposure, e⁻, without quantisation; `None` where quantisation hides it.
    pub fn read_noise(&self) -> Option<Value> {
        let (k, v) = (self.gain, self.dark_variance);
        let variance = v.value - QUANTISATION;
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

impl Data<'_> {
    /// Weighted fit of darks and used flats to `V = K x g'² + V₀ + V₁ t`. Sampling errors are
    /// those of the fitted variance, not of the measured one, which would pull the fit down.
    fn fit(&self, response: Option<&Response>) -> Result<Fit> {
        let two_exposures = self.darks.iter().any(|d| {
            let t = self.darks[0].exposure_s;
            (d.exposure_s - t).abs() > SAME_EXPOSURE * t
        });
        let mut design = Vec::new();
        let mut y = Vec::new();
        let mut error = Vec::new();
        let mut push = |x: f64, t: f64, m: &Moments| {
            design.push(if two_exposures { vec![x, 1.0, t] } else { vec![x, 1.0] });
            y.push(m.temporal);
            let floor = QUANTISATION * (2.0 / (m.pixels() * m.frames as f64)).sqrt();
            error.push(m.temporal_error.max(floor));
        };
        for d in self.darks {
            push(0.0, d.exposure_s, &d.channels[self.channel]);
        }
        for ((f, s), _) in self.flats.iter().zip(self.signal).zip(self.used).filter(|f| *f.1) {
            push(abscissa(s.value, response), f.exposure_s, &f.channels[self.channel]);
        }
        let mut fit = Fit::new(&design, &y, &error)?;
        for _ in 0..3 {
            let refined: Vec<f64> = (0..y.len())
                .map(|i| {
                    let model: f64 =
                        design[i].iter().zip(&fit.coefficients).map(|(a, c)| a * c).sum();
                    let ratio = if y[i] > 0.0 { (model / y[i]).clamp(0.5, 2.0) } else { 1.0 };
                    error[i] * ratio
                })
                .collect();
            fit = Fit::new(&design, &y, &refined)?;
        }
        Ok(fit)
    }

    /// Whether the brightest level's variance lies more than 3.5 standard errors below the fit to
    /// the others (three or more): the first sign of the full-well knee.
    fn below_the_rest(&self, top: usize, response: Option<&Response>) -> Result<bool> {
        if self.used.iter().filter(|u| **u).count() < 4 {
            return Ok(false);
        }
        let mut others = self.used.to_vec();
        others[top] = false;
        let fit = Data { used: &others, ..*self }.fit(response)?;
        let (m, t) = (&self.flats[top].channels[self.channel], self.flats[top].exposure_s);
        let row = [abscissa(self.signal[top].value, response), 1.0, t];
        let row = &row[..fit.coefficients.len()];
        let model: f64 = row.iter().zip(&fit.coefficients).map(|(a, c)| a * c).sum();
        let mut variance = m.temporal_error.powi(2);
        for (i, a) in row.iter().enumerate() {
            for (j, b) in row.iter().enumerate() {
                variance += a * b * fit.covariance(i, j) * fit.reduced_chi2().max(1.0);
            }
        }
        Ok((m.temporal - model) / variance.sqrt() < -3.5)
    }
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
