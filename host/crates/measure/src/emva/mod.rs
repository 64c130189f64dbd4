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
pub use figures::{ChannelEmva, DarkRow, Figures, LevelRow};
pub use profiles::{Profile, Profiles};

pub(crate) use self::spatial::prnu_of_levels;
use self::spatial::{SpatialPair, spatial_figures};
use self::warnings::{correlation_warning, curvature_warnings, set_warnings};
use super::codes::Codes;
use super::copies;
use super::dark::{self, DarkLine, distinct};
use super::figure;
use super::fit::Fit;
use super::ladder::{self, Level, Selection};
use super::moments::SATURATED_SHARE;
use super::remarks;
use super::rounding::QUANTISATION_LIMITED;
use super::stack::Stack;
use super::tolerance::SAME_EXPOSURE;
use super::transfer::{Knee, Transfer};
use camrig_base::Value;
use camrig_base::{Error, Result};
use camrig_captures::{Capture, CaptureSet};
use serde_json::{Map, Value as Json, json};
use std::collections::BTreeMap;

/// Upper end of the photon transfer's range over saturation (section 6.6).
const TRANSFER_RANGE: f64 = 0.7;
/// Range of the linearity fit over saturation (section 6.7).
const LINEARITY_RANGE: std::ops::RangeInclusive<f64> = 0.05..=0.95;
/// Largest temporal dark noise that quantisation can hide, in steps of the codes (DN; eq. 54:
/// 0.40 DN at a variance below 0.24 DN²).
const HIDDEN_NOISE_DN: f64 = 0.40;
/// Fewest light levels for a saturation: two below it and one at it. Fewer determine gain, dark
/// noise and spatial figures. The standard requires 50; fewer cause a warning.
const MIN_LEVELS: usize = 3;
/// Standard errors from which K is a gain: by chance, one in 700 of constant noise.
const SIGNIFICANT_GAIN: f64 = 3.0;
/// Light levels with which the flat of the spatial figures stays one of them.
const FEW_LEVELS: usize = 5;
/// Fewest exposure times of darks for a line (the standard requires six for dark current).
const DARK_EXPOSURES: usize = 3;

/// Smallest detectable signal, e⁻, for a temporal dark variance (DN²) and the gain `k` (DN/e⁻):
/// SNR = 1 solved for the signal (release 4.0, eq. 27; earlier releases omitted the ¼). The
/// variance is not below what rounding to steps with the square `step_dn2` (DN²) can hide (eq. 53
/// and 54); the threshold is an upper limit then, without an error.
#[must_use]
pub fn threshold_e(dark_dn2: Value, step_dn2: f64, k: Value) -> Value {
    let Threshold { value, of_dark, of_gain } = Threshold::of(dark_dn2, step_dn2, k.value);
    let Some(of_dark) = of_dark else { return Value::chosen(value) };
    let relative = libm::hypot(of_dark * dark_dn2.std_error, of_gain * k.std_error / k.value);
    Value::new(value, value * relative)
}

/// Dynamic range: a largest signal (DN) over the smallest detectable one of [`threshold_e`]. The
/// gain's error nearly cancels. Where rounding hides the dark noise, the range is a lower limit,
/// without an error.
#[must_use]
pub fn dynamic_range(largest_dn: Value, dark_dn2: Value, step_dn2: f64, k: Value) -> Value {
    let Threshold { value, of_dark, of_gain } = Threshold::of(dark_dn2, step_dn2, k.value);
    let range = largest_dn.value / k.value / value;
    let Some(of_dark) = of_dark else { return Value::chosen(range) };
    let of_signal = largest_dn.std_error / largest_dn.value;
    let of_gain = (1.0 + of_gain) * k.std_error / k.value;
    let relative = libm::hypot(libm::hypot(of_signal, of_dark * dark_dn2.std_error), of_gain);
    Value::new(range, range * relative)
}

/// A ratio in dB: 20 log₁₀.
#[must_use]
pub fn decibels(ratio: Value) -> Value {
    let db = 20.0 * libm::log10(ratio.value);
    Value::new(db, 20.0 / std::f64::consts::LN_10 * ratio.std_error / ratio.value)
}

/// A ratio in bits: its binary logarithm.
fn bits(ratio: Value) -> Value {
    let error = ratio.std_error / ratio.value / std::f64::consts::LN_2;
    Value::new(libm::log2(ratio.value), error)
}

/// The smallest detectable signal, e⁻, and its relative change by one DN² of the dark variance
/// (`None` where rounding hides it) and by a relative change of the gain.
struct Threshold {
    value: f64,
    of_dark: Option<f64>,
    of_gain: f64,
}

impl Threshold {
    fn of(dark_dn2: Value, step_dn2: f64, k: f64) -> Self {
        let limit = QUANTISATION_LIMITED * step_dn2;
        let variance_e2 = dark_dn2.value.max(limit) / (k * k);
        let root = (variance_e2 + 0.25).sqrt();
        let value = root + 0.5;
        let shown = dark_dn2.value > limit;
        let of_dark = shown.then_some(0.5 / (k * k) / root / value);
        Self { value, of_dark, of_gain: -variance_e2 / root / value }
    }
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

impl Checked {
    /// The figures as a JSON object; at the top those of the channel with most light, for which the
    /// levels were chosen.
    ///
    /// # Errors
    /// No channels.
    pub fn json(&self) -> Result<Map<String, Json>> {
        let signal = |c: &&ChannelEmva| c.levels.iter().map(|l| l.signal_dn).sum();
        let most = self.channels.iter().max_by(|a, b| f64::total_cmp(&signal(a), &signal(b)));
        let most = most.ok_or_else(|| Error::input("no channels"))?;
        let mut object = figure::object(&most.figures)?;
        object.insert("reference_channel".into(), json!(most.channel));
        object.insert("lower_limits".into(), json!(most.lower_limits()));
        let of_channel = |c: &ChannelEmva| {
            let mut object = figure::object(c)?;
            object.insert("lower_limits".into(), json!(c.lower_limits()));
            Ok((c.channel.clone(), object))
        };
        let channels = self.channels.iter().map(of_channel);
        object.insert("channels".into(), json!(channels.collect::<Result<BTreeMap<_, _>>>()?));
        object.insert("warnings".into(), json!(self.warnings));
        Ok(object)
    }
}

/// Measures a capture set.
///
/// # Errors
/// Darks or flats missing, single frames, the same frame twice, no level below saturation, a black
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
    let all: Vec<&Level> = flats.iter().map(|(_, flat)| flat).collect();
    let pair = SpatialPair::choose(&darks, &all);
    let in_ladder = |id: &str| match &pair {
        Some(p) if flats.len() > FEW_LEVELS => id != p.flat_id,
        _ => true,
    };
    let levels: Vec<Level> =
        flats.iter().filter(|(_, l)| in_ladder(&l.id)).map(|f| f.1.clone()).collect();
    let stacks = match &pair {
        Some(p) => Some((
            dark_stacks.take(set, selection.darks[p.dark])?,
            flat_stacks.take(set, selection.flats[flats[p.flat].0])?,
        )),
        None => None,
    };
    let mut warnings = set_warnings(set, &selection, &darks, &levels, pair.as_ref());
    if let (Some(p), Some((_, flat))) = (&pair, &stacks) {
        correlation_warning(set, selection.flats[flats[p.flat].0], flat, &mut warnings)?;
    }
    let conditions = Conditions::of(set, &selection, &darks, &levels, pair.as_ref());
    let mut channels = Vec::new();
    for (c, letter) in set.cfa().channels().iter().enumerate() {
        let name = letter.to_ascii_lowercase().to_string();
        let mut channel = ladder_figures(set, &darks, &levels, c, &name, &mut warnings)
            .map_err(|e| e.at(format!("channel {name}")))?;
        channel.figures.dark_current_doubling_c = dark::doubling(&darks, &other_darks, c);
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
    signal: Vec<Value>,
    /// Temporal variance above dark, DN².
    variance: Vec<f64>,
    /// Photons per pixel, where every level has them.
    photons: Option<Vec<f64>>,
    /// Dark variance over exposure time.
    dark: VarianceLine,
    /// Index of the saturated level; `None` of fewer than [`MIN_LEVELS`].
    saturation: Option<usize>,
    /// Index of the last level in the range of the photon transfer.
    last: usize,
    /// The codes of the samples.
    codes: Codes,
}

impl<'a> Steps<'a> {
    fn of(darks: &[Level], levels: &'a [Level], c: usize) -> Result<Self> {
        let mean = DarkLine::of(darks, c);
        let dark = VarianceLine::of(darks, c);
        let above = |l: &Level| {
            let (m, d) = (&l.channels[c], mean.mean_at(l.exposure_s));
            Value::new(m.mean() - d.value, libm::hypot(m.mean_error(), d.std_error))
        };
        let signal: Vec<Value> = levels.iter().map(above).collect();
        let variance: Vec<f64> =
            levels.iter().map(|l| l.channels[c].temporal - dark.at(l.exposure_s)).collect();
        let photons: Option<Vec<f64>> = levels.iter().map(|l| l.photons).collect();
        let saturation = (levels.len() >= MIN_LEVELS)
            .then(|| saturation_index(&levels.iter().collect::<Vec<_>>(), c));
        let below = |i: usize| match saturation {
            Some(s) => i <= s && signal[i].value <= TRANSFER_RANGE * signal[s].value,
            None => levels[i].channels[c].whites <= SATURATED_SHARE,
        };
        let Some(last) = (0..levels.len()).rev().find(|&i| below(i)) else {
            let range = if saturation.is_some() { "70 % of " } else { "" };
            return Err(Error::input(format!("no level below {range}saturation"))
                .help("add flats between dark and saturation"));
        };
        let codes = ladder::codes(darks, levels);
        Ok(Self { levels, channel: c, signal, variance, photons, dark, saturation, last, codes })
    }

    /// Signals in the range of the photon transfer, DN.
    fn signals(&self) -> Vec<f64> {
        self.signal[..=self.last].iter().map(|s| s.value).collect()
    }

    /// K, DN/e⁻.
    fn gain(&self) -> Result<Value> {
        let signal = self.signals();
        let errors = self.levels[..=self.last].iter().map(|l| {
            let of_dark = self.dark.error_at(l.exposure_s);
            libm::hypot(l.channels[self.channel].temporal_error, of_dark)
        });
        let sum: f64 = errors.zip(&signal).map(|(e, s)| (e * s).powi(2)).sum();
        let k = Value::new(
            slope_through_zero(&signal, &self.variance[..=self.last]),
            sum.sqrt() / signal.iter().map(|s| s * s).sum::<f64>(),
        );
        // Not a number is no gain either.
        if k.z() > SIGNIFICANT_GAIN {
            return Ok(k);
        }
        Err(Error::input(format!(
            "the variance does not grow with the signal (K = {:.2e} ± {:.2e} DN/e⁻)",
            k.value, k.std_error
        ))
        .help(
            "check that flats and darks are raw frames of one analog gain, and that the flats are \
             not saturated; of small frames, take more",
        ))
    }

    /// Responsivity, DN per photon.
    fn responsivity(&self) -> Option<Value> {
        let photons = &self.photons.as_ref()?[..=self.last];
        let error = self.signal.iter().zip(photons).map(|(s, p)| (s.std_error * p).powi(2));
        let error = error.sum::<f64>().sqrt() / photons.iter().map(|p| p * p).sum::<f64>();
        Some(Value::new(slope_through_zero(photons, &self.signals()), error))
    }

    /// Signal over temporal noise of a level, dB (section 2.6).
    fn snr_db(&self, level: usize) -> Option<Value> {
        let m = &self.levels[level].channels[self.channel];
        let noise = Value::new(m.temporal, m.temporal_error).sqrt()?;
        let signal = self.signal[level];
        (signal.value > 0.0).then(|| decibels(signal.over(noise)))
    }

    /// Dark variance below which quantisation hides the dark noise, DN².
    fn quantisation_limit(&self) -> f64 {
        QUANTISATION_LIMITED * self.codes.square()
    }

    /// The figures that follow from signals, variances and photons for a gain of `k`.
    fn figures(&self, k: Value) -> Figures {
        let responsivity = self.responsivity();
        let efficiency = responsivity.map(|r| r.over(k));
        let (limit, dark) = (self.quantisation_limit(), self.dark.at_zero);
        let shown = Some(dark).filter(|d| d.value >= limit);
        let resolved = shown
            .and_then(|d| Value::new(d.value - self.codes.quantisation(), d.std_error).sqrt());
        let threshold = threshold_e(dark, self.codes.square(), k);
        let photons = self.photons.as_ref().zip(self.saturation).map(|(p, s)| p[s]);
        let saturation_e = self.saturation.map(|s| match (efficiency, photons) {
            (Some(eta), Some(p)) => eta.scaled(p),
            _ => self.signal[s].over(k),
        });
        let snr = saturation_e.and_then(Value::sqrt);
        let range =
            saturation_e.map(|e| dynamic_range(e.scaled(k.value), dark, self.codes.square(), k));
        Figures {
            quantum_efficiency: efficiency,
            overall_system_gain: Some(k),
            responsivity_dn_per_photon: responsivity,
            temporal_dark_noise_dn: match shown {
                Some(dark) => dark.sqrt(),
                None => Some(Value::chosen(limit.sqrt())),
            },
            temporal_dark_noise_e: resolved.map(|noise| noise.over(k)),
            absolute_sensitivity_threshold_p: efficiency.map(|eta| threshold.over(eta)),
            absolute_sensitivity_threshold_e: Some(threshold),
            saturation_capacity_p: photons.map(Value::chosen),
            saturation_capacity_e: saturation_e,
            snr_max: snr,
            snr_max_db: snr.map(decibels),
            snr_max_bit: snr.map(bits),
            dynamic_range: range,
            dynamic_range_db: range.map(decibels),
            dynamic_range_bit: range.map(bits),
            ..Figures::default()
        }
    }

    /// Deviation of every level from the straight line over `light`, per cent; fills in the
    /// linearity errors.
    fn linearity(&self, light: Option<&[f64]>, figures: &mut Figures) -> Option<Vec<f64>> {
        let signal: Vec<f64> = self.signal.iter().map(|s| s.value).collect();
        let deviations = linearity(light?, &signal, self.saturation?)?;
        let inside: Vec<f64> = deviations.iter().filter(|d| d.1).map(|d| d.0).collect();
        if !inside.is_empty() {
            let absolute = inside.iter().map(|d| d.abs()).sum::<f64>() / inside.len() as f64;
            let ends = [(f64::MAX, f64::min as fn(f64, f64) -> f64), (f64::MIN, f64::max)];
            let [least, most] = ends.map(|(start, end)| inside.iter().copied().fold(start, end));
            figures.linearity_error_percent = Some(Value::chosen(absolute));
            figures.linearity_error_min_percent = Some(Value::chosen(least));
            figures.linearity_error_max_percent = Some(Value::chosen(most));
        }
        Some(deviations.into_iter().map(|d| d.0).collect())
    }

    /// Dark current of a gain of `k` from the means and from the variances of the darks, e⁻/s.
    fn dark_current(&self, darks: &[Level], k: Value) -> [Option<Value>; 2] {
        let exposures: Vec<f64> = darks.iter().map(|d| d.exposure_s).collect();
        if distinct(&exposures) < DARK_EXPOSURES {
            return [None, None];
        }
        let moments = darks.iter().map(|d| &d.channels[self.channel]);
        let means: Vec<Value> = moments.map(|m| Value::new(m.mean(), m.mean_error())).collect();
        let variance = self.dark.slope.map(|s| s.over(k).over(k)).filter(|v| v.value >= 0.0);
        [line(&exposures, &means).map(|l| l.slope.over(k)), variance]
    }
}

/// What the levels' linearity is measured against: photons, or exposure times of one light.
pub(super) fn light_of(levels: &[Level]) -> Option<Vec<f64>> {
    if let Some(photons) = levels.iter().map(|l| l.photons).collect() {
        return Some(photons);
    }
    let first = levels.first()?;
    let times: Vec<f64> = levels.iter().map(|l| l.exposure_s).collect();
    let same = levels.iter().all(|l| l.light == first.light);
    (same && distinct(&times) == levels.len()).then_some(times)
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
    let saturates = steps.saturation.is_some_and(|s| s + 1 < levels.len());
    if !saturates && steps.saturation.is_some() {
        warnings.push(format!(
            "channel {name}: saturation was not reached: capacity, SNR and dynamic range are \
             lower limits"
        ));
    }
    let k = steps.gain()?;
    let mut figures = steps.figures(k);
    if figures.temporal_dark_noise_e.is_none() {
        warnings.push(format!(
            "channel {name}: the dark variance ({:.3} DN²) is below {:.2} DN²: quantisation hides \
             the dark noise, whose upper limit is {:.2} e⁻",
            steps.dark.at_zero.value,
            steps.quantisation_limit(),
            HIDDEN_NOISE_DN * steps.codes.step_dn / k.value
        ));
    }
    let deviations = steps.linearity(light_of(levels).as_deref(), &mut figures);
    [figures.dark_current_mean_e_per_s, figures.dark_current_variance_e_per_s] =
        steps.dark_current(darks, k);
    let transfer = whole_transfer(set, darks, levels, c).ok();
    if let Some(t) = &transfer {
        curvature_warnings(t, k, name, warnings);
    }
    figures.linearised_system_gain = transfer.as_ref().map(|t| t.gain);
    warnings.extend(figures.quantum_efficiency.and_then(|v| remarks::efficiency(name, v)));
    let rows = (0..levels.len()).map(|i| LevelRow {
        id: levels[i].id.clone(),
        exposure_s: levels[i].exposure_s,
        photons: levels[i].photons,
        signal_dn: steps.signal[i].value,
        variance_dn2: steps.variance[i],
        snr_db: steps.snr_db(i),
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
    points: Vec<(f64, Value)>,
    /// Variance at zero exposure, DN².
    at_zero: Value,
    /// DN²/s.
    slope: Option<Value>,
}

impl VarianceLine {
    fn of(darks: &[Level], c: usize) -> Self {
        let variance =
            |d: &Level| Value::new(d.channels[c].temporal, d.channels[c].temporal_error);
        let mut points: Vec<(f64, Value)> =
            darks.iter().map(|d| (d.exposure_s, variance(d))).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (t, v): (Vec<f64>, Vec<Value>) = points.iter().copied().unzip();
        let fitted = (distinct(&t) >= DARK_EXPOSURES).then(|| line(&t, &v)).flatten();
        let at_zero = fitted.as_ref().map_or(points[0].1, |l| l.at_zero);
        Self { at_zero, slope: fitted.map(|l| l.slope), points }
    }

    /// Variances of the exposure time.
    fn same(&self, exposure_s: f64) -> Vec<Value> {
        let same = |p: &&(f64, Value)| (p.0 / exposure_s - 1.0).abs() < SAME_EXPOSURE;
        self.points.iter().filter(same).map(|p| p.1).collect()
    }

    fn at(&self, exposure_s: f64) -> f64 {
        let same = self.same(exposure_s);
        match (same.len(), self.slope) {
            (0, Some(slope)) => self.at_zero.value + slope.value * exposure_s,
            (0, None) => self.at_zero.value,
            (n, _) => same.iter().map(|v| v.value).sum::<f64>() / n as f64,
        }
    }

    /// Standard error of [`at`](Self::at), DN²; on the line, that at zero exposure.
    fn error_at(&self, exposure_s: f64) -> f64 {
        let same = self.same(exposure_s);
        match same.len() {
            0 => self.at_zero.std_error,
            n => same.iter().map(|v| v.std_error.powi(2)).sum::<f64>().sqrt() / n as f64,
        }
    }
}

/// An unweighted straight line, as the standard fits it, with the errors that follow from those of
/// its points.
struct Line {
    at_zero: Value,
    slope: Value,
}

fn line(x: &[f64], y: &[Value]) -> Option<Line> {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    let square: f64 = x.iter().map(|x| (x - mean).powi(2)).sum();
    let of = |weight: &dyn Fn(f64) -> f64| {
        let terms = || x.iter().zip(y).map(|(x, y)| y.scaled(weight(*x)));
        let error = terms().map(|t| t.std_error.powi(2)).sum::<f64>().sqrt();
        Value::new(terms().map(|t| t.value).sum(), error)
    };
    (square > 0.0).then(|| Line {
        at_zero: of(&|x| 1.0 / n - mean * (x - mean) / square),
        slope: of(&|x| (x - mean) / square),
    })
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
