//! EMVA Standard 1288, release 4.0 linear, from a capture set.
//!
//! The standard's model is a linear camera: the temporal noise is shot noise, dark noise and
//! quantisation, scaled by K. The figures follow the standard's own estimators (unweighted fits
//! over its ranges), so that they are comparable with data sheets; [`Checked::warnings`] reports
//! where the sensor does not meet the standard's assumptions, with the results of the photon
//! transfer without them ([`super::transfer`]).
//!
//! Sections of the standard (release 4.0 linear): noise model 2.4, SNR 2.6, threshold eq. 27, dark
//! current 3, two-frame temporal variance eq. 18, photon transfer 6.6, non-uniformities 4 and 8;
//! rows, columns and pixels are split as in its reference implementation, the package `emva1288`.
//!
//! Choice of captures: all flats of the gain and light with most levels are the light levels. The
//! longest flat stack nearest to half saturation of the channel that saturates first, below
//! saturation in all of them where there is one, and a dark stack of its exposure are used for the
//! spatial figures; with more than five levels that flat is not also a light level.

mod conditions;
mod figures;
mod profiles;
mod spatial;
mod warnings;

pub use conditions::Conditions;
pub use figures::{ChannelEmva, DarkRow, Figures, LevelRow, StdErrors};
pub use profiles::{Profile, Profiles};

use self::spatial::{SpatialPair, spatial_figures};
use self::warnings::{correlation_warning, curvature_warnings, set_warnings};
use super::codes::Codes;
use super::copies;
use super::dark::{self, DarkLine, distinct};
use super::fit::Fit;
use super::ladder::{self, Level, Selection};
use super::remarks;
use super::rounding::QUANTISATION_LIMITED;
use super::stack::Stack;
use super::tolerance::SAME_EXPOSURE;
use super::transfer::{Knee, Transfer};
use camrig_base::Value;
use camrig_base::{Error, Result};
use camrig_captures::{Capture, CaptureSet};

/// Upper end of the photon transfer's range over saturation (section 6.6).
const TRANSFER_RANGE: f64 = 0.7;
/// Range of the linearity fit over saturation (section 6.7).
const LINEARITY_RANGE: std::ops::RangeInclusive<f64> = 0.05..=0.95;
/// Largest temporal dark noise that quantisation can hide, in steps of the codes (DN; eq. 54:
/// 0.40 DN at a variance below 0.24 DN²).
const HIDDEN_NOISE_DN: f64 = 0.40;
/// Fewest light levels: a slope and a saturation need two levels below and one at saturation. The
/// standard requires 50; fewer cause a warning.
const MIN_LEVELS: usize = 3;
/// Light levels with which the flat of the spatial figures stays one of them.
const FEW_LEVELS: usize = 5;
/// Fewest exposure times of darks for a line (the standard requires six for dark current).
const DARK_EXPOSURES: usize = 3;

/// Smallest detectable signal, e⁻, for a temporal dark variance (DN²) and the gain `k`: SNR = 1
/// solved
/// for the signal (release 4.0, eq. 27; earlier releases omitted the ¼). The variance is not below
/// what rounding to steps with the square `step_dn2` (DN²) can hide (eq. 53 and 54).
#[must_use]
pub fn threshold_e(dark_dn2: f64, step_dn2: f64, k: f64) -> f64 {
    (dark_dn2.max(QUANTISATION_LIMITED * step_dn2) / (k * k) + 0.25).sqrt() + 0.5
}

/// Result of the measurement.
#[derive(Clone, Debug)]
pub struct Checked {
    /// Figures of each channel.
    pub channels: Vec<ChannelEmva>,
    /// The operating point.
    pub conditions: Conditions,
    /// The standard's assumptions and requirements that these captures do not meet.
    pub warnings: Vec<String>,
}

/// Measures a capture set.
///
/// # Errors
/// Darks or flats missing, single frames, the same frame twice, fewer than three levels, a black
/// level or flats that the darks contradict.
pub fn measure(set: &CaptureSet) -> Result<Checked> {
    let selection = Selection::of(set)?;
    let (mut dark_stacks, mut flat_stacks) = (Longest::default(), Longest::default());
    let darks = dark_stacks.read(set, &selection.darks)?;
    ladder::check_darks(set, &darks)?;
    let other_darks = Longest::default().read(set, &selection.other_darks)?;
    let flats = flat_stacks.read(set, &selection.flats)?;
    let mut flats: Vec<(usize, Level)> = flats.into_iter().enumerate().collect();
    flats.sort_by(|a, b| {
        let light = |l: &Level| l.photons.unwrap_or(l.channels[0].mean());
        light(&a.1).total_cmp(&light(&b.1))
    });
    for (_, flat) in &flats {
        if flat.channels[0].frames < 2 {
            return Err(ladder::single_frame(format!("flat capture {:?}", flat.id)));
        }
    }
    ladder::check_flats(&darks, flats.iter().map(|f| &f.1))?;
    let pair = SpatialPair::choose(&darks, &flats);
    let in_ladder = |id: &str| match &pair {
        Some(p) if flats.len() > FEW_LEVELS => id != p.flat_id,
        _ => true,
    };
    let levels: Vec<Level> =
        flats.iter().filter(|(_, l)| in_ladder(&l.id)).map(|f| f.1.clone()).collect();
    if levels.len() < MIN_LEVELS {
        return Err(Error::input(format!("{} flat levels", levels.len())).help(
            "the standard requires 50, from dark to saturation; three are the minimum. \
                   `measure ptc` gives gain and read noise of one",
        ));
    }
    let stacks = match &pair {
        Some(p) => Some((
            dark_stacks.take(set, selection.darks[p.dark])?,
            flat_stacks.take(set, selection.flats[p.flat])?,
        )),
        None => None,
    };
    let mut warnings = set_warnings(set, &selection, &darks, &levels, pair.as_ref());
    if let (Some(p), Some((_, flat))) = (&pair, &stacks) {
        correlation_warning(set, selection.flats[p.flat], flat, &mut warnings)?;
    }
    let conditions = Conditions::of(set, &selection, &darks, &levels, pair.as_ref());
    let mut channels = Vec::new();
    for (c, letter) in set.cfa().channels().iter().enumerate() {
        let name = letter.to_ascii_lowercase().to_string();
        let mut channel = ladder_figures(set, &darks, &levels, c, &name, &mut warnings)
            .map_err(|e| e.at(format!("channel {name}")))?;
        channel.figures.dark_current_doubling_c =
            dark::doubling(&darks, &other_darks, c).map(|v| v.value);
        if let (Some(p), Some((dark, flat))) = (&pair, &stacks) {
            let flat = (!p.past[c]).then_some(flat);
            spatial_figures(&mut channel, dark, flat, c, &mut warnings)?;
        }
        channels.push(channel);
    }
    Ok(Checked { channels, conditions, warnings })
}

/// Reads stacks as levels and keeps the longest one, as it is usually the stack of the spatial
/// figures.
#[derive(Default)]
struct Longest(Option<(String, Stack)>);

impl Longest {
    fn read(&mut self, set: &CaptureSet, captures: &[&Capture]) -> Result<Vec<Level>> {
        let level = |&capture: &&Capture| {
            // Two files are two frames, a level without spatial figures; one file may contain many.
            if capture.files.len() == 2 {
                let stack = Stack::read_moments(set, capture)?;
                copies::refuse(set, capture, &stack)?;
                return Ok(Level::new(set, capture, &stack));
            }
            let stack = Stack::read(set, capture)?;
            copies::refuse(set, capture, &stack)?;
            let level = Level::new(set, capture, &stack);
            if self.0.as_ref().is_none_or(|longest| longest.1.frames < stack.frames) {
                self.0 = Some((capture.id.clone(), stack));
            }
            Ok(level)
        };
        captures.iter().map(level).collect()
    }

    fn take(self, set: &CaptureSet, capture: &Capture) -> Result<Stack> {
        match self.0 {
            Some((id, stack)) if id == capture.id => Ok(stack),
            _ => Stack::read(set, capture),
        }
    }
}

/// Index of the level with the largest temporal variance: saturation as the standard defines it.
fn saturation_index(levels: &[&Level], channel: usize) -> usize {
    let variance = |i: usize| levels[i].channels[channel].temporal;
    (0..levels.len()).max_by(|&a, &b| variance(a).total_cmp(&variance(b))).unwrap_or(0)
}

/// Slope of the unweighted line through the origin.
fn slope_through_zero(x: &[f64], y: &[f64]) -> f64 {
    let xy: f64 = x.iter().zip(y).map(|(x, y)| x * y).sum();
    xy / x.iter().map(|x| x * x).sum::<f64>()
}

/// The light levels of one channel, in rising order of light.
struct Steps<'a> {
    levels: &'a [Level],
    channel: usize,
    /// Mean above dark, DN.
    signal: Vec<f64>,
    /// Temporal variance above dark, DN².
    variance: Vec<f64>,
    /// Photons per pixel, where every level has them.
    photons: Option<Vec<f64>>,
    /// Dark variance over exposure time.
    dark: VarianceLine,
    /// Index of the saturated level.
    saturation: usize,
    /// Index of the last level in the range of the photon transfer.
    last: usize,
    /// The codes of the samples.
    codes: Codes,
}

impl<'a> Steps<'a> {
    fn of(darks: &[Level], levels: &'a [Level], c: usize) -> Result<Self> {
        let mean = DarkLine::of(darks, c);
        let dark = VarianceLine::of(darks, c);
        let signal: Vec<f64> = levels
            .iter()
            .map(|l| l.channels[c].mean() - mean.mean_at(l.exposure_s).value)
            .collect();
        let variance: Vec<f64> =
            levels.iter().map(|l| l.channels[c].temporal - dark.at(l.exposure_s)).collect();
        let photons: Option<Vec<f64>> = levels.iter().map(|l| l.photons).collect();
        let saturation = saturation_index(&levels.iter().collect::<Vec<_>>(), c);
        let upper = TRANSFER_RANGE * signal[saturation];
        let last = (0..levels.len()).rev().find(|&i| i <= saturation && signal[i] <= upper);
        let Some(last) = last.filter(|&i| i >= 1) else {
            return Err(Error::input("fewer than two levels below 70 % of saturation")
                .help("add flats between dark and saturation"));
        };
        let codes = ladder::codes(darks, levels);
        Ok(Self { levels, channel: c, signal, variance, photons, dark, saturation, last, codes })
    }

    /// K and its standard error, DN/e⁻.
    fn gain(&self) -> Result<(f64, f64)> {
        let signal = &self.signal[..=self.last];
        let k = slope_through_zero(signal, &self.variance[..=self.last]);
        if k.is_nan() || k <= 0.0 {
            return Err(Error::input(format!(
                "the variance does not grow with the signal (K = {k})"
            ))
            .help("check that flats and darks are raw frames of one analog gain"));
        }
        let errors =
            self.levels[..=self.last].iter().map(|l| l.channels[self.channel].temporal_error);
        let sum: f64 = errors.zip(signal).map(|(e, s)| (e * s).powi(2)).sum();
        Ok((k, sum.sqrt() / signal.iter().map(|s| s * s).sum::<f64>()))
    }

    /// Dark variance below which quantisation hides the dark noise, DN².
    fn quantisation_limit(&self) -> f64 {
        QUANTISATION_LIMITED * self.codes.square()
    }

    /// The figures that follow from signals, variances and photons for a gain of `k`.
    fn figures(&self, k: f64) -> Figures {
        let photons = self.photons.as_ref();
        let responsivity =
            photons.map(|p| slope_through_zero(&p[..=self.last], &self.signal[..=self.last]));
        let efficiency = responsivity.map(|r| r / k);
        let limit = self.quantisation_limit();
        let dark_dn2 = self.dark.at_zero.max(limit);
        let hidden = self.dark.at_zero < limit;
        let threshold_e = threshold_e(self.dark.at_zero, self.codes.square(), k);
        let saturation_p = photons.map(|p| p[self.saturation]);
        let saturation_e = match (efficiency, saturation_p) {
            (Some(eta), Some(p)) => eta * p,
            _ => self.signal[self.saturation] / k,
        };
        let snr = saturation_e.sqrt();
        let range = saturation_e / threshold_e;
        Figures {
            quantum_efficiency: efficiency,
            overall_system_gain: k,
            responsivity_dn_per_photon: responsivity,
            temporal_dark_noise_dn: dark_dn2.sqrt(),
            temporal_dark_noise_e: (!hidden)
                .then(|| (dark_dn2 - self.codes.quantisation()).sqrt() / k),
            absolute_sensitivity_threshold_p: efficiency.map(|eta| threshold_e / eta),
            absolute_sensitivity_threshold_e: threshold_e,
            saturation_capacity_p: saturation_p,
            saturation_capacity_e: saturation_e,
            snr_max: snr,
            snr_max_db: 20.0 * libm::log10(snr),
            snr_max_bit: libm::log2(snr),
            dynamic_range: range,
            dynamic_range_db: 20.0 * libm::log10(range),
            dynamic_range_bit: libm::log2(range),
            ..Figures::default()
        }
    }

    /// Deviation of every level from the straight line, per cent; fills in the linearity errors.
    fn linearity(&self, figures: &mut Figures) -> Option<Vec<f64>> {
        let deviations = linearity(self.photons.as_ref()?, &self.signal, self.saturation)?;
        let inside: Vec<f64> = deviations.iter().filter(|d| d.1).map(|d| d.0).collect();
        if !inside.is_empty() {
            let absolute = inside.iter().map(|d| d.abs()).sum::<f64>();
            figures.linearity_error_percent = Some(absolute / inside.len() as f64);
            figures.linearity_error_min_percent =
                Some(inside.iter().copied().fold(f64::MAX, f64::min));
            figures.linearity_error_max_percent =
                Some(inside.iter().copied().fold(f64::MIN, f64::max));
        }
        Some(deviations.into_iter().map(|d| d.0).collect())
    }

    /// Dark current of a gain of `k` from the means and from the variances of the darks, e⁻/s.
    fn dark_current(&self, darks: &[Level], k: f64) -> (Option<f64>, Option<f64>) {
        let exposures: Vec<f64> = darks.iter().map(|d| d.exposure_s).collect();
        if distinct(&exposures) < DARK_EXPOSURES {
            return (None, None);
        }
        let means: Vec<f64> = darks.iter().map(|d| d.channels[self.channel].mean()).collect();
        let variance = self.dark.slope.map(|s| s / (k * k)).filter(|v| *v >= 0.0);
        (line(&exposures, &means).map(|l| l.1 / k), variance)
    }
}

/// The figures of one channel that come from light levels and darks.
fn ladder_figures(
    set: &CaptureSet,
    darks: &[Level],
    levels: &[Level],
    c: usize,
    name: &str,
    warnings: &mut Vec<String>,
) -> Result<ChannelEmva> {
    let steps = Steps::of(darks, levels, c)?;
    let saturates = steps.saturation + 1 < levels.len();
    if !saturates {
        warnings.push(format!(
            "channel {name}: saturation was not reached: capacity, SNR and dynamic range are \
             lower limits"
        ));
    }
    let (k, k_error) = steps.gain()?;
    let mut figures = steps.figures(k);
    if figures.temporal_dark_noise_e.is_none() {
        warnings.push(format!(
            "channel {name}: the dark variance ({:.3} DN²) is below {:.2} DN²: quantisation hides \
             the dark noise, whose upper limit is {:.2} e⁻",
            steps.dark.at_zero,
            steps.quantisation_limit(),
            HIDDEN_NOISE_DN * steps.codes.step_dn / k
        ));
    }
    let deviations = steps.linearity(&mut figures);
    (figures.dark_current_mean_e_per_s, figures.dark_current_variance_e_per_s) =
        steps.dark_current(darks, k);
    let transfer = whole_transfer(set, darks, levels, c).ok();
    if let Some(t) = &transfer {
        curvature_warnings(t, k, k_error, name, warnings);
    }
    figures.linearised_system_gain = transfer.as_ref().map(|t| t.gain.value);
    let std_errors = StdErrors {
        overall_system_gain: k_error,
        quantum_efficiency: figures.quantum_efficiency.map(|eta| eta * k_error / k),
        temporal_dark_noise_e: transfer
            .as_ref()
            .and_then(Transfer::read_noise)
            .map(|v| v.std_error),
        linearised_system_gain: transfer.as_ref().map(|t| t.gain.std_error),
        ..StdErrors::default()
    };
    let efficiency = figures.quantum_efficiency.zip(std_errors.quantum_efficiency);
    warnings.extend(efficiency.and_then(|(v, e)| remarks::efficiency(name, Value::new(v, e))));
    let rows = (0..levels.len()).map(|i| LevelRow {
        id: levels[i].id.clone(),
        photons: levels[i].photons,
        signal_dn: steps.signal[i],
        variance_dn2: steps.variance[i],
        linearity_deviation_percent: deviations.as_ref().map(|d| d[i]),
    });
    let dark_rows = darks.iter().map(|d| DarkRow {
        exposure_s: d.exposure_s,
        mean_dn: d.channels[c].mean(),
        variance_dn2: d.channels[c].temporal,
    });
    Ok(ChannelEmva {
        channel: name.to_owned(),
        saturates,
        figures,
        std_errors,
        levels: rows.collect(),
        darks: dark_rows.collect(),
        spectrogram_dark: None,
        spectrogram_prnu: None,
        histogram_dsnu: None,
        histogram_prnu: None,
        profiles: None,
    })
}

/// The photon transfer without the standard's assumption of linearity, on the same levels.
fn whole_transfer(
    set: &CaptureSet,
    darks: &[Level],
    levels: &[Level],
    c: usize,
) -> Result<Transfer> {
    let white = f64::from(set.sensor.white_level_dn);
    let dark = DarkLine::of(darks, c);
    let mut knee = Knee::default();
    let codes = ladder::codes(darks, levels);
    let passed: Vec<bool> = levels
        .iter()
        .map(|l| {
            let m = &l.channels[c];
            let signal = m.mean() - dark.mean_at(l.exposure_s).value;
            knee.passes(m, signal, m.above(&darks[0].channels[c]), &codes)
        })
        .collect();
    Transfer::fit(c, darks, levels, &passed, &knee, white)
}

/// Dark variance against exposure time, by the standard: an unweighted line through three or
/// more exposure times, else the variance of the shortest exposure.
struct VarianceLine {
    /// Exposure time s, variance DN².
    points: Vec<(f64, f64)>,
    /// Variance at zero exposure, DN².
    at_zero: f64,
    /// DN²/s.
    slope: Option<f64>,
}

impl VarianceLine {
    fn of(darks: &[Level], c: usize) -> Self {
        let mut points: Vec<(f64, f64)> =
            darks.iter().map(|d| (d.exposure_s, d.channels[c].temporal)).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (t, v): (Vec<f64>, Vec<f64>) = points.iter().copied().unzip();
        let fitted = (distinct(&t) >= DARK_EXPOSURES).then(|| line(&t, &v)).flatten();
        Self { at_zero: fitted.map_or(points[0].1, |l| l.0), slope: fitted.map(|l| l.1), points }
    }

    fn at(&self, exposure_s: f64) -> f64 {
        let same: Vec<f64> = self
            .points
            .iter()
            .filter(|p| (p.0 / exposure_s - 1.0).abs() < SAME_EXPOSURE)
            .map(|p| p.1)
            .collect();
        match (same.len(), self.slope) {
            (0, Some(slope)) => self.at_zero + slope * exposure_s,
            (0, None) => self.at_zero,
            (n, _) => same.iter().sum::<f64>() / n as f64,
        }
    }
}

/// Unweighted straight line: value at zero and slope.
fn line(x: &[f64], y: &[f64]) -> Option<(f64, f64)> {
    let data: Vec<_> =
        x.iter().zip(y).map(|(&x, &y)| (vec![1.0, x], Value::new(y, 1.0))).collect();
    let fit = Fit::new(&data).ok()?;
    Some((fit.coefficients[0], fit.coefficients[1]))
}

/// Deviation of every level from a straight line, per cent, and whether the level lies between 5
/// and 95 % of saturation. The line is fitted to these levels with relative weights, as the
/// standard minimises relative deviations.
fn linearity(photons: &[f64], signal: &[f64], saturation: usize) -> Option<Vec<(f64, bool)>> {
    let full = signal[saturation];
    let inside: Vec<bool> = (0..signal.len())
        .map(|i| {
            i <= saturation
                && signal[i] >= LINEARITY_RANGE.start() * full
                && signal[i] <= LINEARITY_RANGE.end() * full
        })
        .collect();
    let chosen = (0..signal.len()).filter(|&i| inside[i]);
    let datum = |i: usize| (vec![1.0, photons[i]], Value::new(signal[i], signal[i]));
    let fit = Fit::new(&chosen.map(datum).collect::<Vec<_>>()).ok()?;
    let model = |i: usize| fit.coefficients[0] + fit.coefficients[1] * photons[i];
    Some((0..signal.len()).map(|i| (100.0 * (signal[i] / model(i) - 1.0), inside[i])).collect())
}

#[cfg(test)]
mod tests;
