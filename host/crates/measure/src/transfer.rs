//! The photon transfer fit of one channel: system gain, dark noise and dark current from moments.

use super::codes::Codes;
use super::dark::{DarkLine, spans};
use super::fit::Fit;
use super::ladder::{self, Level, exposures};
use super::moments::{Moments, SATURATED_SHARE};
use super::response::Response;
use camrig_base::Value;
use camrig_base::median::median;
use camrig_base::{Error, Result};

/// Variance per signal over the median of the darker levels below which a level counts as past the
/// full-well knee. Curved responses change the ratio by a few per cent and sampling errors by
/// less; clipping at the full well takes it to 0.
const KNEE_RATIO: f64 = 0.7;
/// Standard error of the median of Gaussian values over that of their mean: sqrt(π/2).
const MEDIAN_ERROR: f64 = 1.253_314_137;
/// Smallest variance above dark in standard errors for a level to count in that median.
const CLEAR_VARIANCE: f64 = 5.0;
/// Standard deviations of its samples by which the mean of a level has to be below saturation: a
/// Gaussian has 3 in 100,000 samples beyond.
const CLEAR_OF_SATURATION: f64 = 4.0;
/// Standard errors by which the variance of a level may lie below the fit to the others, or below
/// that of the darker levels: by chance, a good level is rejected once in 4000 fits.
const BELOW_FIT: f64 = 3.5;
/// Share of samples at the white level above which a level is completely saturated.
const SATURATED_THROUGHOUT: f64 = 0.5;
/// Temporal variance over the shot noise of the signal below which a level is completely
/// saturated without samples at the white level.
const NO_SHOT_NOISE: f64 = 0.1;
/// Fewest levels for judging the brightest one by the others: three determine gain and dark noise.
const MIN_TO_JUDGE: usize = 4;
/// Passes of the Gauss-Newton fit, and the pass whose scatter widens the errors. The
/// number is fixed so that equal data give equal bits; five suffice because weights depend on the
/// fit only weakly.
const PASSES: usize = 5;
const SCATTER_PASS: usize = 2;
/// Largest change of a sampling error by the fit, as a factor: keeps one wrong variance from
/// dominating.
const LARGEST_REWEIGHTING: f64 = 2.0;
/// Step of the numerical derivative over the curve's quadratic coefficient, over 1/signal.
const DERIVATIVE_STEP: f64 = 1e-4;

/// Decides whether flats, in rising order of light, are on the straight part of the photon transfer
/// curve. The rule is stated in [`super::ptc`].
#[derive(Clone, Debug, Default)]
pub struct Knee {
    /// Variance per signal of the levels on the straight part, DN, with sampling errors.
    ratios: Vec<Value>,
    plateau: Option<f64>,
    /// Whether a level had samples at the white level, from which nothing brighter returns.
    saturated: bool,
}

impl Knee {
    /// Tests the next brighter level: mean signal and temporal variance above dark, the latter
    /// with its sampling error. A level whose noise is hidden by rounding is no evidence about
    /// others.
    pub fn passes(&mut self, m: &Moments, signal: f64, variance: Value, codes: &Codes) -> bool {
        let ratio = Value::new(variance.value / signal, variance.std_error / signal);
        self.saturated |= m.whites > SATURATED_SHARE;
        if self.saturated || self.is_bent(ratio, m, signal) {
            self.plateau = Some(self.plateau.unwrap_or(0.0).max(m.mean()));
            return false;
        }
        // Above a full well the variance never recovers: a low dim level with a normal brighter
        // one is a bad stack, not a knee.
        self.plateau = None;
        if variance.value > CLEAR_VARIANCE * variance.std_error && !codes.hides(m.temporal) {
            self.ratios.push(ratio);
        }
        true
    }

    /// Whether a ratio is below that of the straight part by more than a curved response causes
    /// and by more than its error.
    fn is_bent(&self, ratio: Value, m: &Moments, signal: f64) -> bool {
        if self.ratios.len() < 2 {
            return false;
        }
        let of = |get: fn(&Value) -> f64| {
            median(&mut self.ratios.iter().map(get).collect::<Vec<_>>(), f64::total_cmp)
        };
        let straight = of(|r| r.value);
        let short = straight - ratio.value;
        // The sampling error of the variance that a straight level would have, for Gaussian noise:
        // that of the level itself is small because the variance is.
        let samples = m.pixels() * (m.frames as f64 - 1.0);
        let expected = (m.temporal / signal + short) * (2.0 / samples).sqrt();
        let of_median = MEDIAN_ERROR * of(|r| r.std_error) / (self.ratios.len() as f64).sqrt();
        ratio.value < KNEE_RATIO * straight
            && short > BELOW_FIT * libm::hypot(expected.max(ratio.std_error), of_median)
    }

    /// Mean of the brightest level that did not pass, DN, `None` where all passed.
    pub fn plateau(&self) -> Option<f64> {
        self.plateau
    }

    /// Whether a level that passed lies four standard deviations of its samples below the
    /// saturated levels and the white level (DN).
    pub fn clear(&self, m: &Moments, white: f64) -> bool {
        let spread = (m.temporal + m.plane.measured).sqrt();
        m.mean() + CLEAR_OF_SATURATION * spread < self.plateau.unwrap_or(white).min(white)
    }
}

/// The photon transfer of one channel.
#[derive(Clone, Debug)]
pub struct Transfer {
    /// K at small signals, DN/e⁻.
    pub gain: Value,
    /// Temporal variance of the dark at zero exposure, DN², as if rounding added a twelfth of the
    /// square of the codes' step.
    pub dark_variance: Value,
    /// Whether the noise of the darks is too small to be determined: `dark_variance` is that of the
    /// flats, extrapolated to zero signal.
    pub dark_is_hidden: bool,
    /// Covariance of `gain` and `dark_variance`.
    covariance: f64,
    /// Increase of the dark's variance, DN²/s, where the darks' exposure times span a line.
    pub dark_variance_rate: Option<Value>,
    /// Mean of the dark over exposure time.
    pub dark: DarkLine,
    /// Response curve, where the light of five or more levels is known.
    pub response: Option<Response>,
    /// Signal above dark of each flat, DN.
    pub signals: Vec<f64>,
    /// Whether the fit used a flat.
    pub used: Vec<bool>,
    /// χ² per degree of freedom of the fit.
    pub reduced_chi2: f64,
    /// K of a fit with a linear response, DN/e⁻.
    pub gain_if_straight: Value,
    /// Mean of the saturated levels, DN, and their largest share of samples at the white level.
    pub plateau: Option<(f64, f64)>,
    /// The codes of the samples.
    pub codes: Codes,
}

impl Transfer {
    /// Fits one channel. `flats` are in rising order of light, `passed` comes from [`Knee`],
    /// `white` is the white level, DN.
    ///
    /// # Errors
    /// No level for the fit, or a gain that is not positive.
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
                Value::new(m.mean() - d.value, libm::hypot(m.mean_error(), d.std_error))
            })
            .collect();
        let mut used: Vec<bool> = flats
            .iter()
            .zip(passed)
            .map(|(f, &ok)| ok && knee.clear(&f.channels[channel], white))
            .collect();
        let light = exposures(flats);
        let codes = ladder::codes(darks, flats);
        loop {
            if !used.contains(&true) {
                return Err(Error::input("no flat level below saturation").help(
                    "photon transfer needs flats between dark and saturation; see the levels' \
                     share of samples at the white level",
                ));
            }
            let response = light.as_ref().and_then(|h| fit_response(h, &signal, &used));
            let data = Data { channel, darks, flats, signal: &signal, used: &used, codes };
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
                dark_is_hidden: darks
                    .iter()
                    .all(|d| data.resolved(&d.channels[channel]).is_none()),
                covariance: fit.covariance,
                dark_variance_rate: fit.rate,
                dark,
                response: fit.response,
                signals: signal.iter().map(|s| s.value).collect(),
                used,
                reduced_chi2: fit.reduced_chi2,
                gain_if_straight: straight.gain,
                plateau,
                codes,
            });
        }
    }

    /// Read noise at zero exposure, e⁻, without quantisation; `None` where quantisation hides it.
    pub fn read_noise(&self) -> Option<Value> {
        let (k, v) = (self.gain, self.dark_variance);
        let variance = v.value - self.codes.quantisation();
        if self.dark_is_hidden || variance <= 0.0 {
            return None;
        }
        let noise = variance.sqrt() / k.value;
        // σ = sqrt(V - 1/12) / K: relative errors of both, and their covariance.
        let relative = (0.5 * v.std_error / variance).powi(2) + (k.std_error / k.value).powi(2)
            - self.covariance / (variance * k.value);
        Some(Value::new(noise, noise * relative.max(0.0).sqrt()))
    }

    /// Full well, e⁻: the signal of the brightest levels, where they are saturated throughout
    /// (more than half of the samples at the white level, or a temporal variance below a tenth of
    /// the shot noise of their signal).
    pub fn full_well(&self, flats: &[Level], channel: usize, white: f64) -> Option<Value> {
        let (plateau, whites) = self.plateau?;
        let (black, _) = self.dark.offset_and_rate();
        let top = flats.iter().zip(&self.used).filter(|(_, used)| !**used);
        let brightest =
            top.map(|(f, _)| &f.channels[channel]).max_by(|a, b| a.mean().total_cmp(&b.mean()))?;
        let shot = self.gain.value * (brightest.mean() - black.value);
        if whites <= SATURATED_THROUGHOUT
            && brightest.temporal - self.dark_variance.value > NO_SHOT_NOISE * shot
        {
            return None;
        }
        let level = if whites > SATURATED_THROUGHOUT { white } else { plateau };
        let signal = level - black.value;
        let signal = self.response.map_or(signal, |r| r.linearise(signal));
        // The plateau's error is that of a mean over pixels with different full wells.
        let error =
            libm::hypot((brightest.plane.measured / brightest.pixels()).sqrt(), black.std_error);
        Some(Value::new(signal, error).over(self.gain))
    }
}

fn fit_response(light: &[f64], signal: &[Value], used: &[bool]) -> Option<Response> {
    let chosen = (0..used.len()).filter(|&i| used[i]);
    Response::fit(&chosen.map(|i| (light[i], signal[i])).collect::<Vec<_>>())
}

struct Data<'a> {
    channel: usize,
    darks: &'a [Level],
    flats: &'a [Level],
    signal: &'a [Value],
    used: &'a [bool],
    codes: Codes,
}

/// Result of a fit of the variances.
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
    /// Weighted fit of darks and used flats to `V = K x g'² + V₀ + V₁ t`. The quadratic
    /// coefficient of the curve g, fitted to the means, enters as a datum with its error, so that
    /// the variances also determine it where the light was not steady (Gauss-Newton iteration).
    /// Sampling errors are those of the fitted variances, as those of the measured ones would bias
    /// the fit to low values; they are widened to the scatter of the variances.
    fn fit(&self, from_means: Option<Response>) -> Result<VarianceFit> {
        let levels: Vec<(Option<usize>, &Level)> = (self.darks.iter().map(|d| (None, d)))
            .chain(
                (0..self.flats.len()).filter(|&i| self.used[i]).map(|i| (Some(i), &self.flats[i])),
            )
            .collect();
        let moments = levels.iter().map(|(_, l)| &l.channels[self.channel]);
        let (measured, sampling): (Vec<f64>, Vec<f64>) =
            moments.map(|m| self.variance(m)).map(|v| (v.value, v.std_error)).unzip();
        let exposures: Vec<f64> = self.darks.iter().map(|d| d.exposure_s).collect();
        let has_rate = spans(&exposures);

        let mut curve = from_means;
        let mut gain = 0.0;
        let mut errors = sampling.clone();
        let mut scatter = 1.0;
        let mut pass = 0;
        loop {
            let widened = f64::max(scatter, 1.0).sqrt();
            let mut data: Vec<(Vec<f64>, Value)> = Vec::with_capacity(levels.len() + 1);
            for (i, (flat, level)) in levels.iter().enumerate() {
                let s = flat.map_or(0.0, |i| self.signal[i].value);
                let mut row = vec![abscissa(s, curve.as_ref()), 1.0];
                row.extend(curve.map(|c| gain * abscissa_slope(s, &c)));
                row.extend(has_rate.then_some(level.exposure_s));
                data.push((row, Value::new(measured[i], errors[i] * widened)));
            }
            if let (Some(now), Some(datum)) = (curve, from_means) {
                let mut row = vec![0.0; data[0].0.len()];
                row[2] = 1.0;
                let more = datum.quadratic.value - now.quadratic.value;
                data.push((row, Value::new(more, datum.quadratic.std_error)));
            }
            let lines = Fit::new(&data)?;
            gain = lines.coefficients[0];
            if let Some(c) = &mut curve {
                let moved = c.quadratic.value + lines.coefficients[2];
                let error = lines.covariance(2, 2).sqrt();
                *c = c.with_quadratic(Value::new(moved, error));
            }
            pass += 1;
            if pass == SCATTER_PASS {
                scatter = lines.reduced_chi2();
            }
            if pass == PASSES {
                let of =
                    |j: usize| Value::new(lines.coefficients[j], lines.covariance(j, j).sqrt());
                return Ok(VarianceFit {
                    gain: of(0),
                    dark_variance: of(1),
                    rate: has_rate.then(|| of(data[0].0.len() - 1)),
                    covariance: lines.covariance(0, 1),
                    response: curve,
                    reduced_chi2: scatter,
                    lines,
                });
            }
            for i in 0..levels.len() {
                let terms = data[i].0.iter().zip(&lines.coefficients);
                let model: f64 = terms.map(|(a, c)| a * c).sum();
                let ratio = if measured[i] > 0.0 { model / measured[i] } else { 1.0 };
                errors[i] =
                    sampling[i] * ratio.clamp(1.0 / LARGEST_REWEIGHTING, LARGEST_REWEIGHTING);
            }
        }
    }

    /// Temporal variance of a level, DN², as if rounding added the same to each; `None` where the
    /// noise of the level is too small to be determined.
    fn resolved(&self, m: &Moments) -> Option<Value> {
        let measured = Value::new(m.temporal, variance_error(m, &self.codes));
        self.codes.as_if_resolved(measured, m.mean(), m.spatial().total.value.max(0.0))
    }

    /// The same; where undetermined, the measured variance, with the uncertainty of rounding.
    fn variance(&self, m: &Moments) -> Value {
        let error = || variance_error(m, &self.codes).max(self.codes.quantisation());
        self.resolved(m).unwrap_or_else(|| Value::new(m.temporal, error()))
    }

    /// Whether the variance of the brightest level lies more than 3.5 standard errors below the
    /// fit to the others (three or more): the first sign of the full-well knee.
    fn below_the_rest(&self, top: usize, response: Option<Response>) -> Result<bool> {
        if self.used.iter().filter(|u| **u).count() < MIN_TO_JUDGE {
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
            // The abscissa includes the shift of the curve already.
            if fit.response.is_none() || i != 2 {
                model += a * fit.lines.coefficients[i];
            }
            for (j, b) in row.iter().enumerate() {
                variance += a * b * fit.lines.covariance(i, j);
            }
        }
        Ok((m.temporal - model) / variance.sqrt() < -BELOW_FIT)
    }
}

/// Standard error of a level's temporal variance, DN². A constant frame has no scatter; its
/// variance is still uncertain by rounding.
fn variance_error(m: &Moments, codes: &Codes) -> f64 {
    let samples = m.pixels() * m.frames as f64;
    m.temporal_error.max(codes.quantisation() * (2.0 / samples).sqrt())
}

/// x g'(x)², DN: the factor of K in the variance of a flat with signal `s` (DN).
fn abscissa(s: f64, response: Option<&Response>) -> f64 {
    match response {
        Some(r) => {
            let x = r.linearise(s);
            x * r.slope(x).powi(2)
        }
        None => s,
    }
}

/// d(x g'²)/dq by a central difference, wide enough for rounding and narrow enough for the curve.
fn abscissa_slope(s: f64, response: &Response) -> f64 {
    let q = response.quadratic.value;
    let step = DERIVATIVE_STEP / s.abs().max(1.0);
    let at = |q: f64| abscissa(s, Some(&response.with_quadratic(Value::new(q, 0.0))));
    (at(q + step) - at(q - step)) / (2.0 * step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spatial::PlaneMoments;

    /// Levels of a signal and a variance over those of K = 0.5 DN/e⁻, 1000 pixels of two frames.
    fn judged(levels: &[(f64, f64)]) -> (Vec<bool>, Option<f64>) {
        let mut knee = Knee::default();
        let relative = (2.0f64 / 1000.0).sqrt();
        let judge = |&(signal, share): &(f64, f64)| {
            let temporal = 0.5 * signal * share;
            let plane = PlaneMoments {
                rows: 25,
                columns: 40,
                mean: signal + 64.0,
                measured: 0.0,
                of_rows: 0.0,
                of_columns: 0.0,
            };
            let m = Moments {
                plane,
                sites: 1,
                frames: 2,
                drift: 0.0,
                temporal,
                temporal_error: relative * temporal,
                zeros: 0.0,
                whites: 0.0,
                beyond_white: 0.0,
            };
            let variance = Value::new(temporal, m.temporal_error.max(0.01));
            knee.passes(&m, signal, variance, &Codes::of([]))
        };
        let passed = levels.iter().map(judge).collect();
        (passed, knee.plateau())
    }

    #[test]
    fn a_knee_takes_all_brighter_levels_and_a_bad_stack_only_itself() {
        let knee = [(100.0, 1.0), (200.0, 1.0), (300.0, 1.0), (400.0, 0.5), (410.0, 0.0)];
        assert_eq!(judged(&knee), (vec![true, true, true, false, false], Some(474.0)));
        let bad = [(100.0, 1.0), (200.0, 1.0), (300.0, 0.5), (400.0, 1.0), (500.0, 1.0)];
        assert_eq!(judged(&bad), (vec![true, true, false, true, true], None));
        // Dim levels between two codes, with a quarter of a code's square each, are ignored.
        let between = [(0.1, 5.0), (0.2, 2.5), (300.0, 1.0), (400.0, 1.0)];
        assert_eq!(judged(&between), (vec![true; 4], None));
    }
}
