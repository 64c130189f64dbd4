//! EMVA Standard 1288, release 4.0 linear, from a capture set.
//!
//! The standard's model is a linear camera: K and the dark noise describe all of the temporal
//! noise but photons' shot noise and quantisation. Figures here follow the standard's own
//! estimators (unweighted fits over its ranges), so that they can be laid beside a data sheet;
//! [`Checked::warnings`] says where the sensor breaks the standard's assumptions, and what the
//! photon transfer without them ([`super::transfer`]) finds.
//!
//! Choice of captures: all flats of the gain and light with most levels make the ladder, except the
//! pair of longest stacks nearest to half saturation (flat, and dark of that exposure), which give
//! the spatial figures, when five or more levels remain without it.

use super::correlation::NoiseCorrelation;
use super::fit::Fit;
use super::ladder::{self, Level, Selection};
use super::ptc::QUANTISATION_LIMITED;
use super::spectrogram::{Histogram, SitePlane, Spectrogram};
use super::stack::Stack;
use super::transfer::{DarkLine, Knee, QUANTISATION, Transfer};
use crate::captures::{Capture, CaptureSet};
use crate::{Error, Result};
use serde::Serialize;

/// The standard's figures of one channel; `None` where the captures do not determine one.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Figures {
    /// η, electrons per photon (0..1).
    pub quantum_efficiency: Option<f64>,
    /// K, DN/e⁻.
    pub overall_system_gain: f64,
    /// R, DN per photon.
    pub responsivity_dn_per_photon: Option<f64>,
    /// σ_y.dark, DN.
    pub temporal_dark_noise_dn: f64,
    /// σ_d, e⁻; `None` where quantisation hides it.
    pub temporal_dark_noise_e: Option<f64>,
    /// μ_p.min, photons.
    pub absolute_sensitivity_threshold_p: Option<f64>,
    /// μ_e.min, e⁻.
    pub absolute_sensitivity_threshold_e: f64,
    /// μ_p.sat, photons.
    pub saturation_capacity_p: Option<f64>,
    /// μ_e.sat, e⁻.
    pub saturation_capacity_e: f64,
    /// SNR at saturation.
    pub snr_max: f64,
    /// The same in dB.
    pub snr_max_db: f64,
    /// The same in bits.
    pub snr_max_bit: f64,
    /// Saturation over threshold.
    pub dynamic_range: f64,
    /// The same in dB.
    pub dynamic_range_db: f64,
    /// The same in bits.
    pub dynamic_range_bit: f64,
    /// DSNU1288, e⁻.
    pub dsnu_1288_e: Option<f64>,
    /// Its row part, e⁻.
    pub dsnu_1288_row_e: Option<f64>,
    /// Its column part, e⁻.
    pub dsnu_1288_column_e: Option<f64>,
    /// Its pixel part, e⁻.
    pub dsnu_1288_pixel_e: Option<f64>,
    /// PRNU1288, per cent.
    pub prnu_1288_percent: Option<f64>,
    /// Its row part, per cent.
    pub prnu_1288_row_percent: Option<f64>,
    /// Its column part, per cent.
    pub prnu_1288_column_percent: Option<f64>,
    /// Its pixel part, per cent.
    pub prnu_1288_pixel_percent: Option<f64>,
    /// LE: mean of the absolute deviations from the line, 5 to 95 % of saturation, per cent.
    pub linearity_error_percent: Option<f64>,
    /// Most negative deviation, per cent.
    pub linearity_error_min_percent: Option<f64>,
    /// Most positive deviation, per cent.
    pub linearity_error_max_percent: Option<f64>,
    /// μ_I.mean, e⁻/s.
    pub dark_current_mean_e_per_s: Option<f64>,
    /// μ_I.var, e⁻/s.
    pub dark_current_variance_e_per_s: Option<f64>,
    /// Doubling temperature interval, °C.
    pub dark_current_doubling_c: Option<f64>,
    /// K at small signals with the response's curvature taken into account, DN/e⁻ (not part of the
    /// standard).
    pub linearised_system_gain: Option<f64>,
}

/// Standard errors of the main figures from the sampling errors of variances and means.
#[derive(Clone, Debug, Default, Serialize)]
pub struct StdErrors {
    /// Of K.
    pub overall_system_gain: f64,
    /// Of η (that of K, which outweighs the responsivity's).
    pub quantum_efficiency: Option<f64>,
    /// Of σ_d.
    pub temporal_dark_noise_e: Option<f64>,
    /// Of DSNU1288.
    pub dsnu_1288_e: Option<f64>,
    /// Of PRNU1288.
    pub prnu_1288_percent: Option<f64>,
    /// Of the linearised K.
    pub linearised_system_gain: Option<f64>,
}

/// One channel's outcome.
#[derive(Clone, Debug, Serialize)]
pub struct ChannelEmva {
    /// The channel's letter, lower case (`m` for mono).
    #[serde(skip)]
    pub channel: String,
    /// The figures.
    #[serde(flatten)]
    pub figures: Figures,
    /// Their errors.
    pub std_errors: StdErrors,
    /// Levels: photons, signal DN, variance DN² (both above dark), deviation from the line %.
    pub levels: Vec<LevelRow>,
    /// Dark stacks at the flats' temperature.
    pub darks: Vec<DarkRow>,
    /// Spectra of the dark mean frame, DN².
    pub spectrogram_dark: Option<Spectrogram>,
    /// Spectra of the flat mean frame less the dark one, DN².
    pub spectrogram_prnu: Option<Spectrogram>,
    /// Deviations of pixels of the dark mean frame, DN.
    pub histogram_dsnu: Option<Histogram>,
    /// Deviations of pixels of the flat mean frame less the dark one, high-pass filtered, DN.
    pub histogram_prnu: Option<Histogram>,
}

/// One level of the ladder.
#[derive(Clone, Debug, Serialize)]
pub struct LevelRow {
    /// Capture.
    pub id: String,
    /// Photons per pixel.
    pub photons: Option<f64>,
    /// Mean above dark, DN.
    pub signal_dn: f64,
    /// Temporal variance above dark, DN².
    pub variance_dn2: f64,
    /// Deviation from the line of the linearity fit, per cent, where the fit covers it.
    pub linearity_deviation_percent: Option<f64>,
}

/// One dark stack.
#[derive(Clone, Debug, Serialize)]
pub struct DarkRow {
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Mean, DN.
    pub mean_dn: f64,
    /// Temporal variance, DN².
    pub variance_dn2: f64,
}

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
    let read = |captures: &[&Capture]| -> Result<Vec<Level>> {
        let levels = captures.iter().map(|c| Ok(Level::new(set, c, &Stack::read(set, c)?)));
        levels.collect()
    };
    let darks = read(&selection.darks)?;
    ladder::check_darks(set, &darks)?;
    let other_darks = read(&selection.other_darks)?;
    let mut flats: Vec<(usize, Level)> = read(&selection.flats)?.into_iter().enumerate().collect();
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
            Stack::read(set, selection.darks[p.dark])?,
            Stack::read(set, selection.flats[p.flat])?,
        )),
        None => None,
    };
    let mut warnings = set_warnings(set, &selection, &darks, &levels, pair.as_ref());
    if let Some(p) = &pair {
        correlation_warning(set, selection.flats[p.flat], &mut warnings)?;
    }
    let mut channels = Vec::new();
    for (c, letter) in set.cfa().channels().iter().enumerate() {
        let name = letter.to_ascii_lowercase().to_string();
        let mut channel = ladder_figures(set, &darks, &levels, c, &name, &mut warnings)
            .map_err(|e| e.at(format!("channel {name}")))?;
        channel.figures.dark_current_doubling_c =
            ladder::doubling(&darks, &other_darks, c).map(|v| v.value);
        if let Some((dark, flat)) = &stacks {
            spatial_figures(&mut channel, dark, flat, c)?;
        }
        channels.push(channel);
    }
    Ok(Checked { channels, warnings })
}

/// The stacks behind the spatial figures, as indices into the selection.
struct SpatialPair {
    dark: usize,
    flat: usize,
    flat_id: String,
    frames: usize,
    same_exposure: bool,
}

impl SpatialPair {
    fn choose(darks: &[Level], flats: &[(usize, Level)]) -> Option<Self> {
        let saturation = saturation_index(&flats.iter().map(|f| &f.1).collect::<Vec<_>>(), 0);
        let dark_mean = darks[0].channels[0].mean();
        let half = 0.5 * (flats[saturation].1.channels[0].mean() - dark_mean);
        let usable = |l: &&(usize, Level)| {
            let m = &l.1.channels[0];
            m.frames >= 3 && m.whites < 1e-3
        };
        let most = flats.iter().filter(usable).map(|f| f.1.channels[0].frames).max()?;
        let off = |l: &Level| (l.channels[0].mean() - dark_mean - half).abs();
        let (flat, level) = flats
            .iter()
            .filter(usable)
            .filter(|f| 2 * f.1.channels[0].frames >= most)
            .min_by(|a, b| off(&a.1).total_cmp(&off(&b.1)))?;
        let apart = |d: &Level| (d.exposure_s / level.exposure_s).ln().abs();
        let dark =
            (0..darks.len()).filter(|&i| darks[i].channels[0].frames >= 2).min_by(|&a, &b| {
                let key = |i: usize| (apart(&darks[i]) > 1e-6, darks[i].channels[0].frames);
                // Same exposure first, then the longest stack, then the nearest exposure.
                let (ka, kb) = (key(a), key(b));
                ka.0.cmp(&kb.0)
                    .then(kb.1.cmp(&ka.1))
                    .then(apart(&darks[a]).total_cmp(&apart(&darks[b])))
            })?;
        Some(Self {
            dark,
            flat: *flat,
            flat_id: level.id.clone(),
            frames: level.channels[0].frames,
            same_exposure: apart(&darks[dark]) <= 1e-6,
        })
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

fn spatial_figures(out: &mut ChannelEmva, dark: &Stack, flat: &Stack, c: usize) -> Result<()> {
    let (d, f) = (dark.channel_moments(c), flat.channel_moments(c));
    let (ds, fs) = (d.spatial(), f.spatial());
    let k = out.figures.overall_system_gain;
    let signal = f.mean() - d.mean();
    let root = |v: f64| (v > 0.0).then(|| v.sqrt());
    let dsnu = |v: f64| root(v).map(|s| s / k);
    let prnu = |flat: f64, dark: f64| root(flat - dark).map(|s| 100.0 * s / signal);
    let figures = &mut out.figures;
    figures.dsnu_1288_e = dsnu(ds.total.value);
    figures.dsnu_1288_row_e = dsnu(ds.row.value);
    figures.dsnu_1288_column_e = dsnu(ds.column.value);
    figures.dsnu_1288_pixel_e = dsnu(ds.pixel.value);
    figures.prnu_1288_percent = prnu(fs.total.value, ds.total.value);
    figures.prnu_1288_row_percent = prnu(fs.row.value, ds.row.value);
    figures.prnu_1288_column_percent = prnu(fs.column.value, ds.column.value);
    figures.prnu_1288_pixel_percent = prnu(fs.pixel.value, ds.pixel.value);
    out.std_errors.dsnu_1288_e =
        figures.dsnu_1288_e.map(|s| 0.5 * ds.total.std_error / (s * k * k));
    out.std_errors.prnu_1288_percent = figures.prnu_1288_percent.map(|p| {
        let error = fs.total.std_error.hypot(ds.total.std_error);
        0.5 * error * (100.0 / signal).powi(2) / p
    });
    // Spectra and histograms of the channel's first site: sites of one channel are alike.
    let Some(&site) = flat.sites.iter().find(|s| s.channel == c) else { return Ok(()) };
    let plane =
        |value: &dyn Fn(usize, usize) -> f64| SitePlane::of(site, flat.width, flat.height, value);
    let dark_plane = plane(&|x, y| dark.mean_at(x, y));
    let flat_plane = plane(&|x, y| flat.mean_at(x, y) - dark.mean_at(x, y));
    out.spectrogram_dark = Some(dark_plane.spectrogram()?);
    out.spectrogram_prnu = Some(flat_plane.spectrogram()?);
    let mean = dark_plane.data.iter().sum::<f64>() / dark_plane.data.len() as f64;
    let deviations: Vec<f64> = dark_plane.data.iter().map(|v| v - mean).collect();
    out.histogram_dsnu = Some(Histogram::of(&deviations));
    out.histogram_prnu = Some(Histogram::of(&flat_plane.high_pass()));
    Ok(())
}

fn set_warnings(
    set: &CaptureSet,
    selection: &Selection,
    darks: &[Level],
    levels: &[Level],
    pair: Option<&SpatialPair>,
) -> Vec<String> {
    let mut out = Vec::new();
    if set.sensor.cfa.is_none() {
        out.push("the set names no colour filter pattern: taken as one channel".into());
    }
    if levels.len() < 50 {
        out.push(format!("{} light levels; the standard asks for at least 50", levels.len()));
    }
    if levels.iter().any(|l| l.photons.is_none()) {
        out.push(
            "the photons per pixel are not known (photons_per_pixel_per_s, or irradiance_w_m2 with \
             wavelength_nm and pitch_um): no quantum efficiency, responsivity or linearity"
                .into(),
        );
    }
    let clipped = darks.iter().flat_map(|d| &d.channels).map(|m| m.zeros).fold(0.0, f64::max);
    if clipped > 5e-3 {
        out.push(format!(
            "{:.1} % of the dark samples are at 0 DN (the standard allows 0.5 %): the offset clips \
             the dark noise, so dark noise, DSNU and K are wrong",
            100.0 * clipped
        ));
    }
    match pair {
        None => out.push(
            "no flat stack of three or more unsaturated frames: no DSNU and PRNU, no spectrograms"
                .into(),
        ),
        Some(p) => {
            if p.frames < 100 {
                out.push(format!(
                    "spatial figures from {} frames ({}); the standard asks for at least 100",
                    p.frames, p.flat_id
                ));
            }
            if !p.same_exposure {
                out.push(
                    "no dark stack of the spatial flat's exposure time: the nearest is used".into(),
                );
            }
            if !selection.even_light {
                out.push(
                    "the light may be uneven over the sensor: PRNU includes its shading".into(),
                );
            }
        }
    }
    out
}

fn correlation_warning(set: &CaptureSet, flat: &Capture, warnings: &mut Vec<String>) -> Result<()> {
    let correlation = NoiseCorrelation::of(set, flat)?;
    for ((dx, dy), rho) in &correlation.lags[..2] {
        // Below 0.2 % the bias of K (four times the coefficient) is below 1 %.
        if rho.value.abs() > 0.002 && rho.value.abs() > 4.0 * rho.std_error {
            warnings.push(format!(
                "the temporal noise of neighbours at ({dx}, {dy}) is correlated ({:+.2} % ± \
                 {:.2} %): pixels are not independent as the standard assumes (neighbour coupling \
                 or filtering), and K is biased by several times that",
                100.0 * rho.value,
                100.0 * rho.std_error
            ));
        }
    }
    Ok(())
}

fn curvature_warnings(t: &Transfer, k: f64, k_error: f64, name: &str, warnings: &mut Vec<String>) {
    let bias = k / t.gain.value - 1.0;
    let significant = (k - t.gain.value).abs() > 3.0 * k_error.hypot(t.gain.std_error);
    if let Some(r) = &t.response
        && bias.abs() > 0.005
        && significant
    {
        let q = r.quadratic;
        warnings.push(format!(
            "channel {name}: the response is not a straight line ({:+.2} ± {:.2} % per 1000 DN): \
             the standard's K is {:+.1} % off the gain at small signals, {:.4} DN/e⁻, and the \
             quantum efficiency is off by as much the other way",
            1e5 * q.value,
            1e5 * q.std_error,
            100.0 * bias,
            t.gain.value
        ));
    }
    if t.reduced_chi2 > 3.0 {
        warnings.push(format!(
            "channel {name}: the variances scatter about a photon transfer curve more than their \
             sampling errors (χ²/ν = {:.1}): the noise is not shot noise and read noise alone, or \
             the light was not steady",
            t.reduced_chi2
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::synthetic::{Sensor, Shot, shared};

    fn near(found: Option<f64>, expected: f64, tolerance: f64, name: &str) {
        let found = found.unwrap_or_else(|| panic!("{name} not determined"));
        assert!((found / expected - 1.0).abs() < tolerance, "{name}: {found}, expected {expected}");
    }

    /// The real set: what its full documentation says within 2 % (the subset's sampling), and the
    /// figures of the `emva1288` package 1.0.2 for the levels that have a dark of their own
    /// (tests/peers/emva1288_peer.py) within 0.5 %.
    #[test]
    fn reference_set_and_the_emva1288_package() {
        let Some(shared) = shared() else { return };
        let root = shared.join("data/captures/emva1288_ref001_CCD_12Bit");
        let mut set = CaptureSet::load(&root).unwrap();
        let whole = measure(&set).unwrap();
        let f = &whole.channels[0].figures;
        near(Some(f.overall_system_gain), 0.2808, 0.02, "K of the documentation");
        near(Some(f.temporal_dark_noise_dn), 3.07, 0.02, "dark noise of the documentation");
        assert!(whole.warnings.iter().any(|w| w.contains("not a straight line")));

        let darks: Vec<f64> =
            set.with_role(crate::captures::Role::Dark).map(|c| c.exposure_s).collect();
        set.captures.retain(|c| darks.contains(&c.exposure_s));
        let result = measure(&set).unwrap();
        let f = &result.channels[0].figures;
        near(Some(f.overall_system_gain), 0.285_366, 0.005, "K");
        near(f.quantum_efficiency, 0.445_340, 0.005, "quantum efficiency");
        near(f.responsivity_dn_per_photon, 0.127_085, 0.005, "responsivity");
        near(Some(f.temporal_dark_noise_dn), 3.078_418, 0.005, "dark noise");
        near(f.temporal_dark_noise_e, 10.740_068, 0.005, "dark noise in electrons");
        near(f.saturation_capacity_p, 27_530.0, 0.005, "saturation");
        near(f.dsnu_1288_e, 0.488_336, 0.005, "DSNU");
        near(f.dsnu_1288_row_e, 0.443_426, 0.01, "DSNU of rows");
        near(f.dsnu_1288_column_e, 0.528_035, 0.01, "DSNU of columns");
        near(f.prnu_1288_percent, 0.432_784, 0.005, "PRNU");
        near(f.prnu_1288_row_percent, 0.323_621, 0.005, "PRNU of rows");
        near(f.prnu_1288_column_percent, 0.111_281, 0.005, "PRNU of columns");
        near(f.linearity_error_max_percent, 0.141_651, 0.01, "linearity error");
        // The package leaves the long dark stack out of the line over exposure time; the line's own
        // sampling error is 15 % (4.9 of 31 e⁻/s).
        near(f.dark_current_mean_e_per_s, 29.570, 0.15, "dark current");
    }

    fn shots(sensor: &Sensor) -> Vec<Shot> {
        let dark = |exposure_s, frames| Shot { exposure_s, rate: 0.0, frames, temperature_c: 25.0 };
        let mut out = vec![dark(0.02, 2), dark(0.1, 2), dark(0.2, 2), dark(0.02, 16)];
        let rate = sensor.full_well_e / sensor.qe[0] / 0.02;
        let flat = |fill: f64, frames| Shot {
            exposure_s: 0.02,
            rate: fill * rate,
            frames,
            temperature_c: 25.0,
        };
        out.extend((1..=22).map(|k| flat(0.05 * f64::from(k), 2)));
        out.push(flat(0.501, 16));
        out
    }

    fn measured(sensor: &Sensor) -> Checked {
        let directory = tempfile::tempdir().unwrap();
        sensor.write(directory.path(), &shots(sensor));
        measure(&CaptureSet::load(directory.path()).unwrap()).unwrap()
    }

    /// A hidden non-linearity of 2 % at full well: the standard's K is off, and it is said.
    #[test]
    fn a_hidden_nonlinearity_is_told() {
        let honest = Sensor { width: 256, height: 192, dark_e_per_s: 20.0, ..Sensor::default() };
        let straight = measured(&honest);
        let f = &straight.channels[0].figures;
        near(Some(f.overall_system_gain), 0.4, 0.005, "K");
        near(f.temporal_dark_noise_e, 4.0, 0.01, "dark noise");
        near(f.prnu_1288_percent, 1.0, 0.02, "PRNU");
        assert!(
            !straight.warnings.iter().any(|w| w.contains("straight line")),
            "{:?}",
            straight.warnings
        );
        let bent = measured(&Sensor { nonlinearity: 0.02, ..honest });
        let f = &bent.channels[0].figures;
        let off = f.overall_system_gain / 0.4 - 1.0;
        assert!(off < -0.015, "{off}");
        near(f.linearised_system_gain, 0.4, 0.01, "linearised K");
        assert!(
            bent.warnings.iter().any(|w| w.contains("not a straight line")),
            "{:?}",
            bent.warnings
        );
    }

    #[test]
    fn what_cannot_be_measured_is_refused() {
        let sensor = Sensor { width: 32, height: 32, ..Sensor::default() };
        let directory = tempfile::tempdir().unwrap();
        let said = |shots: &[Shot]| {
            sensor.write(directory.path(), shots);
            let set = CaptureSet::load(directory.path()).unwrap();
            measure(&set).unwrap_err().to_string()
        };
        let dark = |frames| Shot { exposure_s: 0.02, rate: 0.0, frames, temperature_c: 25.0 };
        let flat = |rate, frames| Shot { exposure_s: 0.02, rate, frames, temperature_c: 25.0 };
        assert!(said(&[dark(2)]).contains("no flat captures"));
        assert!(said(&[flat(1e4, 2)]).contains("no dark captures"));
        assert!(said(&[dark(1), flat(1e4, 2)]).contains("one frame"));
        assert!(said(&[dark(2), flat(1e4, 2), flat(2e4, 1), flat(3e4, 2)]).contains("one frame"));
        assert!(said(&[dark(2), flat(1e4, 2)]).contains("flat levels"));
        let saturated = [dark(2), flat(1e7, 2), flat(2e7, 2), flat(3e7, 2)];
        assert!(said(&saturated).contains("70 % of saturation"));
        // Mismatched sizes and a black level that the darks contradict.
        sensor.write(directory.path(), &[dark(2), flat(1e4, 2)]);
        let manifest = directory.path().join("captures.toml");
        let text = std::fs::read_to_string(&manifest).unwrap();
        let changed = |from: &str, to: &str| {
            std::fs::write(&manifest, text.replace(from, to)).unwrap();
            measure(&CaptureSet::load(directory.path()).unwrap()).unwrap_err().to_string()
        };
        assert!(changed("width = 32", "width = 31").contains("a frame of 32 x 32"));
        assert!(
            changed("black_level_dn = 64.0", "black_level_dn = 500.0")
                .contains("darker than black")
        );
        let narrow = text.replace("bits = 12", "bits = 6");
        let narrow = narrow.replace("black_level_dn = 64.0", "black_level_dn = 10.0");
        std::fs::write(&manifest, narrow).unwrap();
        let said = measure(&CaptureSet::load(directory.path()).unwrap()).unwrap_err().to_string();
        assert!(said.contains("DN in 6 bits"), "{said}");
    }
}
