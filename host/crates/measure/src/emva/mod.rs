//! EMVA Standard 1288, release 4.0 linear, from a capture set.
//!
//! The standard's model is a linear camera: K and the dark noise describe all of the temporal
//! noise but photons' shot noise and quantisation. Figures here follow the standard's own
//! estimators (unweighted fits over its ranges), so that they can be laid beside a data sheet;
//! [`Checked::warnings`] says where the sensor breaks the standard's assumptions, and what the
//! photon transfer without them ([`super::transfer`]) finds.
//!
//! Where the standard (release 4.0 linear) has what: noise model 2.4, SNR 2.6, threshold eq. 27,
//! dark current 3, two-frame temporal variance eq. 18, photon transfer 6.6, non-uniformities 4 and
//! 8; rows, columns and pixels apart as in its reference implementation, the package `emva1288`.
//!
//! Choice of captures: all flats of the gain and light with most levels make the ladder, except
//! the pair of longest stacks nearest to half saturation (flat, and dark of that exposure), which
//! give the spatial figures, when five or more levels remain without it.

mod figures;
mod spatial;
mod warnings;

pub use figures::{ChannelEmva, DarkRow, Figures, LevelRow, StdErrors};

use self::spatial::{SpatialPair, spatial_figures};
use self::warnings::{correlation_warning, curvature_warnings, set_warnings};
use super::dark::{self, DarkLine};
use super::fit::Fit;
use super::ladder::{self, Level, Selection};
use super::ptc::QUANTISATION_LIMITED;
use super::rounding::QUANTISATION;
use super::stack::Stack;
use super::transfer::{Knee, Transfer};
use camrig_base::{Error, Result};
use camrig_captures::{Capture, CaptureSet};

/// The outcome, with what a reader must know.
#[derive(Clone, Debug)]
pub struct Checked {
    /// Per channel.
    pub channels: Vec<ChannelEmva>,
    /// The standard's assumptions that these captures break, and its demands they do not meet.
    pub warnings: Vec<String>,
}

/// Measures a set.
///
/// # Errors
/// Darks or flats missing, single frames, fewer than three levels, a black level that the darks
/// contradict.
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
            return Err(Error::input("one frame has no temporal noise to measure")
                .at(format!("flat capture {:?}", flat.id))
                .help("give at least two frames per capture"));
        }
    }
    let pair = SpatialPair::choose(&darks, &flats);
    let in_ladder = |id: &str| match &pair {
        Some(p) if flats.len() > 5 => id != p.flat_id,
        _ => true,
    };
    let levels: Vec<Level> =
        flats.iter().filter(|(_, l)| in_ladder(&l.id)).map(|f| f.1.clone()).collect();
    if levels.len() < 3 {
        return Err(Error::input(format!("{} flat levels", levels.len()))
            .help("the standard asks for 50, from dark to saturation; three are the least"));
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
    let mut channels = Vec::new();
    for (c, letter) in set.cfa().channels().iter().enumerate() {
        let name = letter.to_ascii_lowercase().to_string();
        let mut channel = ladder_figures(set, &darks, &levels, c, &name, &mut warnings)
            .map_err(|e| e.at(format!("channel {name}")))?;
        channel.figures.dark_current_doubling_c =
            dark::doubling(&darks, &other_darks, c).map(|v| v.value);
        if let Some((dark, flat)) = &stacks {
            spatial_figures(&mut channel, dark, flat, c)?;
        }
        channels.push(channel);
    }
    Ok(Checked { channels, warnings })
}

/// Stacks on their way to levels, of which the longest is kept: most often it is the one for the
/// spatial figures.
#[derive(Default)]
struct Longest(Option<(String, Stack)>);

impl Longest {
    fn read(&mut self, set: &CaptureSet, captures: &[&Capture]) -> Result<Vec<Level>> {
        let level = |&capture: &&Capture| {
            // Two frames are a level of the ladder; one file may hold many.
            if capture.files.len() == 2 {
                return Ok(Level::new(set, capture, &Stack::read_moments(set, capture)?));
            }
            let stack = Stack::read(set, capture)?;
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

/// The level with the largest temporal variance: saturation in the standard's sense.
fn saturation_index(levels: &[&Level], channel: usize) -> usize {
    let variance = |i: usize| levels[i].channels[channel].temporal;
    (0..levels.len()).max_by(|&a, &b| variance(a).total_cmp(&variance(b))).unwrap_or(0)
}

/// Slope of the unweighted line through the origin.
fn slope_through_zero(x: &[f64], y: &[f64]) -> f64 {
    let xy: f64 = x.iter().zip(y).map(|(x, y)| x * y).sum();
    xy / x.iter().map(|x| x * x).sum::<f64>()
}

fn ladder_figures(
    set: &CaptureSet,
    darks: &[Level],
    levels: &[Level],
    c: usize,
    name: &str,
    warnings: &mut Vec<String>,
) -> Result<ChannelEmva> {
    let dark = DarkLine::of(darks, c);
    let dark_variance = VarianceLine::of(darks, c);
    let signal: Vec<f64> =
        levels.iter().map(|l| l.channels[c].mean() - dark.mean_at(l.exposure_s).value).collect();
    let variance: Vec<f64> =
        levels.iter().map(|l| l.channels[c].temporal - dark_variance.at(l.exposure_s)).collect();
    let photons: Option<Vec<f64>> = levels.iter().map(|l| l.photons).collect();
    let saturation = saturation_index(&levels.iter().collect::<Vec<_>>(), c);
    if saturation + 1 == levels.len() {
        warnings.push(format!(
            "channel {name}: saturation was not reached: capacity, SNR and dynamic range are \
             lower limits"
        ));
    }
    let upper = 0.7 * signal[saturation];
    let last = (0..levels.len()).rev().find(|&i| i <= saturation && signal[i] <= upper);
    let Some(last) = last.filter(|&i| i >= 1) else {
        return Err(Error::input("fewer than two levels below 70 % of saturation")
            .help("add flats between dark and saturation"));
    };
    let range = ..=last;
    let k = slope_through_zero(&signal[range], &variance[range]);
    if k.is_nan() || k <= 0.0 {
        return Err(Error::input(format!("the variance does not grow with the signal (K = {k})"))
            .help("check that flats and darks are raw frames of one analog gain"));
    }
    let k_error = {
        let moments = levels[range].iter().map(|l| l.channels[c].temporal_error);
        let sum: f64 = moments.zip(&signal[range]).map(|(e, s)| (e * s).powi(2)).sum();
        sum.sqrt() / signal[range].iter().map(|s| s * s).sum::<f64>()
    };
    let responsivity = photons.as_ref().map(|p| slope_through_zero(&p[range], &signal[range]));
    let efficiency = responsivity.map(|r| r / k);

    let dark_dn2 = dark_variance.at_zero().max(QUANTISATION_LIMITED);
    let dark_dn = dark_dn2.sqrt();
    let hidden = dark_variance.at_zero() < QUANTISATION_LIMITED;
    if hidden {
        warnings.push(format!(
            "channel {name}: the dark variance ({:.3} DN²) is below 0.24 DN²: quantisation hides \
             the dark noise, whose upper limit is {:.2} e⁻",
            dark_variance.at_zero(),
            0.40 / k
        ));
    }
    // SNR = 1 solved for the signal (release 4.0, eq. 27; earlier ones left the ¼ out).
    let threshold_e = (dark_dn2 / (k * k) + 0.25).sqrt() + 0.5;
    let saturation_p = photons.as_ref().map(|p| p[saturation]);
    let saturation_e = match (efficiency, saturation_p) {
        (Some(eta), Some(p)) => eta * p,
        _ => signal[saturation] / k,
    };
    let snr = saturation_e.sqrt();
    let range_ratio = saturation_e / threshold_e;
    let deviations = photons.as_ref().and_then(|p| linearity(p, &signal, saturation));
    let in_range: Vec<f64> = deviations.iter().flatten().filter(|d| d.1).map(|d| d.0).collect();
    let linearity_of = |f: fn(&[f64]) -> f64| (!in_range.is_empty()).then(|| f(&in_range));

    let exposures: Vec<f64> = darks.iter().map(|d| d.exposure_s).collect();
    let distinct = distinct(&exposures);
    let current_mean = (distinct >= 3).then(|| {
        let means: Vec<f64> = darks.iter().map(|d| d.channels[c].mean()).collect();
        line(&exposures, &means).map(|l| l.1 / k)
    });
    let current_variance = (distinct >= 3)
        .then(|| dark_variance.slope.map(|s| s / (k * k)))
        .flatten()
        .filter(|v| *v >= 0.0);
    let transfer = whole_transfer(set, darks, levels, c);
    if let Ok(t) = &transfer {
        curvature_warnings(t, k, k_error, name, warnings);
    }
    let figures = Figures {
        quantum_efficiency: efficiency,
        overall_system_gain: k,
        responsivity_dn_per_photon: responsivity,
        temporal_dark_noise_dn: dark_dn,
        temporal_dark_noise_e: (!hidden).then(|| (dark_dn2 - QUANTISATION).sqrt() / k),
        absolute_sensitivity_threshold_p: efficiency.map(|eta| threshold_e / eta),
        absolute_sensitivity_threshold_e: threshold_e,
        saturation_capacity_p: saturation_p,
        saturation_capacity_e: saturation_e,
        snr_max: snr,
        snr_max_db: 20.0 * snr.log10(),
        snr_max_bit: snr.log2(),
        dynamic_range: range_ratio,
        dynamic_range_db: 20.0 * range_ratio.log10(),
        dynamic_range_bit: range_ratio.log2(),
        linearity_error_percent: linearity_of(|d| {
            d.iter().map(|d| d.abs()).sum::<f64>() / d.len() as f64
        }),
        linearity_error_min_percent: linearity_of(|d| d.iter().copied().fold(f64::MAX, f64::min)),
        linearity_error_max_percent: linearity_of(|d| d.iter().copied().fold(f64::MIN, f64::max)),
        dark_current_mean_e_per_s: current_mean.flatten(),
        dark_current_variance_e_per_s: current_variance,
        linearised_system_gain: transfer.as_ref().ok().map(|t| t.gain.value),
        ..Figures::default()
    };
    let std_errors = StdErrors {
        overall_system_gain: k_error,
        quantum_efficiency: efficiency.map(|eta| eta * k_error / k),
        temporal_dark_noise_e: transfer
            .as_ref()
            .ok()
            .and_then(|t| t.read_noise(ladder::dark_spread(darks, c)))
            .map(|v| v.std_error),
        linearised_system_gain: transfer.as_ref().ok().map(|t| t.gain.std_error),
        ..StdErrors::default()
    };
    let rows = (0..levels.len()).map(|i| LevelRow {
        id: levels[i].id.clone(),
        photons: levels[i].photons,
        signal_dn: signal[i],
        variance_dn2: variance[i],
        linearity_deviation_percent: deviations.as_ref().map(|d| d[i].0),
    });
    let dark_rows = darks.iter().map(|d| DarkRow {
        exposure_s: d.exposure_s,
        mean_dn: d.channels[c].mean(),
        variance_dn2: d.channels[c].temporal,
    });
    Ok(ChannelEmva {
        channel: name.to_owned(),
        figures,
        std_errors,
        levels: rows.collect(),
        darks: dark_rows.collect(),
        spectrogram_dark: None,
        spectrogram_prnu: None,
        histogram_dsnu: None,
        histogram_prnu: None,
    })
}

/// The photon transfer without the standard's assumptions, on the same levels.
fn whole_transfer(
    set: &CaptureSet,
    darks: &[Level],
    levels: &[Level],
    c: usize,
) -> Result<Transfer> {
    let white = f64::from(set.sensor.white_level_dn);
    let dark = DarkLine::of(darks, c);
    let mut knee = Knee::default();
    let passed: Vec<bool> = levels
        .iter()
        .map(|l| {
            let m = &l.channels[c];
            let signal = m.mean() - dark.mean_at(l.exposure_s).value;
            knee.passes(m, signal, m.temporal - darks[0].channels[c].temporal)
        })
        .collect();
    Transfer::fit(c, darks, levels, &passed, &knee, white)
}

/// Dark variance over exposure time, the standard's way: unweighted line with three or more
/// exposure times, else the shortest exposure's.
struct VarianceLine {
    points: Vec<(f64, f64)>,
    at_zero: f64,
    slope: Option<f64>,
}

impl VarianceLine {
    fn of(darks: &[Level], c: usize) -> Self {
        let mut points: Vec<(f64, f64)> =
            darks.iter().map(|d| (d.exposure_s, d.channels[c].temporal)).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (t, v): (Vec<f64>, Vec<f64>) = points.iter().copied().unzip();
        let fitted = (distinct(&t) >= 3).then(|| line(&t, &v)).flatten();
        Self { at_zero: fitted.map_or(points[0].1, |l| l.0), slope: fitted.map(|l| l.1), points }
    }

    fn at_zero(&self) -> f64 {
        self.at_zero
    }

    fn at(&self, exposure_s: f64) -> f64 {
        let same: Vec<f64> = self
            .points
            .iter()
            .filter(|p| (p.0 / exposure_s - 1.0).abs() < 1e-6)
            .map(|p| p.1)
            .collect();
        match (same.len(), self.slope) {
            (0, Some(slope)) => self.at_zero + slope * exposure_s,
            (0, None) => self.at_zero,
            (n, _) => same.iter().sum::<f64>() / n as f64,
        }
    }
}

fn distinct(values: &[f64]) -> usize {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup_by(|a, b| (*a / *b - 1.0).abs() < 1e-6);
    sorted.len()
}

/// Unweighted line: value at zero, slope.
fn line(x: &[f64], y: &[f64]) -> Option<(f64, f64)> {
    let design: Vec<Vec<f64>> = x.iter().map(|&x| vec![1.0, x]).collect();
    let fit = Fit::new(&design, y, &vec![1.0; y.len()]).ok()?;
    Some((fit.coefficients[0], fit.coefficients[1]))
}

/// Deviation of every level from the line, per cent, and whether it lies between 5 and 95 % of
/// saturation, where the line is fitted with relative weights (the standard minimises relative
/// deviations).
fn linearity(photons: &[f64], signal: &[f64], saturation: usize) -> Option<Vec<(f64, bool)>> {
    let full = signal[saturation];
    let inside: Vec<bool> = (0..signal.len())
        .map(|i| i <= saturation && signal[i] >= 0.05 * full && signal[i] <= 0.95 * full)
        .collect();
    let chosen: Vec<usize> = (0..signal.len()).filter(|&i| inside[i]).collect();
    let design: Vec<Vec<f64>> = chosen.iter().map(|&i| vec![1.0, photons[i]]).collect();
    let y: Vec<f64> = chosen.iter().map(|&i| signal[i]).collect();
    let fit = Fit::new(&design, &y, &y).ok()?;
    let model = |i: usize| fit.coefficients[0] + fit.coefficients[1] * photons[i];
    Some((0..signal.len()).map(|i| (100.0 * (signal[i] / model(i) - 1.0), inside[i])).collect())
}

#[cfg(test)]
mod tests;
