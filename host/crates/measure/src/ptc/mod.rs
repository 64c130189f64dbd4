//! Photon transfer: system gain, noise, full well and fixed patterns of a sensor from dark and
//! flat stacks.
//!
//! With shot noise of variance equal to the mean (in electrons) and a gain of K DN per electron,
//! the temporal variance of a flat is
//!
//! V = V₀ + V₁ t + K x g′(x)²     (DN²)
//!
//! with x = K · electrons of light, g the response curve ([`Response`](super::response::Response);
//! a straight line has g′ = 1), V₀ = K² σ_read² + 1/12 (read noise and quantisation) and V₁ the
//! dark current's shot noise (Janesick, *Photon Transfer*, 2007, ch. 5 and 7). Variances are
//! temporal, so fixed patterns drop out. K, V₀ and V₁ come from one weighted fit to darks and
//! flats together; the weights are the variances' own sampling errors.
//!
//! Levels excluded from the fit: (1) more than 0.1 % of the samples at the white level;
//! (2) variance per signal below 0.7 of the median of the darker levels, by more than 3.5 standard
//! errors, at this and all brighter levels (the full-well knee); in both cases everything brighter
//! too; (3) a mean within four standard deviations of the saturated
//! levels or of the white level; (4) from the top down, a variance more than 3.5
//! standard errors below the fit to the rest.

mod notes;

use self::notes::{channel_notes, sensor_notes};
use super::codes::Codes;
use super::copies;
use super::dark::{self, DarkLine, MIN_EXPOSURES};
use super::emva;
use super::figure;
use super::ladder::{self, Level, Selection};
use super::maps::{Line, LineMaps, Point};
use super::moments::Moments;
use super::remarks;
use super::rounding::{QUANTISATION, rounding_of_patterns};
use super::site::Site;
use super::spatial::SpatialVariance;
use super::stack::Stack;
use super::transfer::{Knee, Transfer};
use camrig_base::Result;
use camrig_base::Value;
use camrig_captures::{Capture, CaptureSet};
use serde::Serialize;
use serde_json::{Map, Value as Json, json};
use std::collections::BTreeMap;

/// The figures of one channel, or of the sensor over its channels. `None` where the captures do
/// not determine a figure.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Figures {
    /// System gain K at small signals, DN/e⁻.
    pub system_gain_dn_per_e: Option<Value>,
    /// Read noise at zero exposure, input-referred, without quantisation, e⁻.
    pub read_noise_e: Option<Value>,
    /// Full well: signal at which the sensor or its converter saturates, e⁻.
    pub full_well_e: Option<Value>,
    /// PRNU: standard deviation over pixels of the gain (mean 1).
    pub prnu: Option<Value>,
    /// DSNU: standard deviation over pixels of the dark signal at `dsnu_exposure_s`, e⁻.
    pub dsnu_e: Option<Value>,
    /// Mean dark current of the ordinary pixels, e⁻/s, from the dark means.
    pub dark_current_e_per_s: Option<Value>,
    /// Dark current from the dark variances, e⁻/s: that from the means, unless the camera
    /// subtracts its dark current or its noise is not shot noise.
    pub dark_current_from_variance_e_per_s: Option<Value>,
    /// Standard deviation over the ordinary pixels of the dark current, e⁻/s.
    pub dsnu_e_per_s: Option<Value>,
    /// Share of hot pixels, which lie over six standard deviations above the median dark current,
    /// and of those below by the exponential law of the former.
    pub hot_pixel_fraction: Option<Value>,
    /// Mean of their exponential law, e⁻/s.
    pub hot_pixel_mean_e_per_s: Option<Value>,
    /// Standard deviation over pixels of the offset at zero exposure, without the parts of rows
    /// and columns, e⁻.
    pub pixel_fpn_e: Option<Value>,
    /// Standard deviation of the rows' offsets at zero exposure, e⁻.
    pub row_fpn_e: Option<Value>,
    /// Standard deviation of the columns' offsets at zero exposure, e⁻.
    pub column_fpn_e: Option<Value>,
    /// Black level: mean of no light at zero exposure, DN.
    pub black_level_dn: Option<Value>,
    /// Deviation of the response from its slope at zero, at the brightest level fitted, per cent.
    pub nonlinearity_percent: Option<Value>,
    /// Temperature step that doubles the dark current, °C.
    pub dark_doubling_c: Option<Value>,
    /// Quantum efficiency: electrons per photon on the area of the pixel.
    pub quantum_efficiency: Option<Value>,
}

/// One level of the photon transfer curve.
#[derive(Clone, Debug, Serialize)]
pub struct CurvePoint {
    /// Id of the capture.
    pub id: String,
    /// Mean signal above dark, DN.
    pub signal_dn: f64,
    /// Temporal variance, dark included, DN².
    pub variance_dn2: Value,
    /// Whether the fit used the level.
    pub used: bool,
}

/// Result for one channel.
#[derive(Clone, Debug, Serialize)]
pub struct ChannelPtc {
    /// The channel's letter, lower case (`m` for mono).
    #[serde(skip)]
    pub channel: String,
    /// The channel's figures.
    #[serde(flatten)]
    pub figures: Figures,
    /// χ² per degree of freedom of the photon-transfer fit.
    pub reduced_chi2: f64,
    /// The photon transfer curve.
    pub curve: Vec<CurvePoint>,
}

/// Result of a photon transfer.
#[derive(Clone, Debug)]
pub struct Ptc {
    /// Figures over all channels, weighted by the inverse squares of the channels' errors.
    pub figures: Figures,
    /// Figures of each channel.
    pub channels: Vec<ChannelPtc>,
    /// Analog gain of the captures.
    pub analog_gain: f64,
    /// Exposure of the dark stack for `dsnu_e`, s.
    pub dsnu_exposure_s: f64,
    /// Remarks: excluded levels, violated assumptions.
    pub notes: Vec<String>,
}

impl Ptc {
    /// The figures as a JSON object, with those of [`gains`](crate::gains) where there are several.
    ///
    /// # Errors
    /// None but a fault of the program.
    pub fn json(&self, gains: Option<&impl Serialize>) -> Result<Map<String, Json>> {
        let mut object = figure::object(&self.figures)?;
        if let Some(gains) = gains {
            object.append(&mut figure::object(gains)?);
        }
        let channels = self.channels.iter().map(|c| Ok((c.channel.clone(), figure::object(c)?)));
        object.insert("channels".into(), json!(channels.collect::<Result<BTreeMap<_, _>>>()?));
        object.insert("analog_gain".into(), json!(self.analog_gain));
        object.insert("dsnu_exposure_s".into(), json!(self.dsnu_exposure_s));
        object.insert("notes".into(), json!(self.notes));
        Ok(object)
    }
}

/// Runs the photon transfer on the analog gain and light with most flats.
///
/// # Errors
/// Darks or flats missing, single frames, the same frame twice, no usable flat level,
/// a black level or flats that the darks contradict.
pub fn measure(set: &CaptureSet) -> Result<Ptc> {
    of_selection(set, &Selection::of(set)?)
}

/// The photon transfer of captures of one analog gain and light.
///
/// # Errors
/// Those of [`measure`].
pub fn of_selection(set: &CaptureSet, selection: &Selection<'_>) -> Result<Ptc> {
    let (darks, dark_maps) = read_darks(set, &selection.darks)?;
    ladder::check_darks(set, &darks)?;
    let (other_darks, _) = read_darks(set, &selection.other_darks)?;
    let flats = Flats::read(set, selection, &darks)?;

    ladder::check_flats(&darks, flats.levels.iter())?;

    let mut notes = sensor_notes(set, selection, &darks);
    let remarks = remarks::of_ladder(set, selection, &darks, &flats.levels, MIN_EXPOSURES);
    notes.extend(remarks);
    notes.extend(ladder::codes(&darks, &flats.levels).note());
    // The longest stack has the least noise in its fixed patterns; of several, that with the
    // longest exposure.
    let longest = (0..darks.len()).max_by(|&a, &b| {
        let key = |i: usize| (darks[i].channels[0].frames, darks[i].exposure_s);
        key(a).partial_cmp(&key(b)).unwrap_or(std::cmp::Ordering::Equal)
    });
    let dsnu_level = &darks[longest.unwrap_or(0)];
    let white = f64::from(set.sensor.white_level_dn);
    let mut channels = Vec::new();
    for (c, letter) in set.cfa().channels().iter().enumerate() {
        let name = letter.to_ascii_lowercase().to_string();
        let transfer =
            Transfer::fit(c, &darks, &flats.levels, &flats.passed[c], &flats.knees[c], white)
                .map_err(|e| e.at(format!("channel {name}")))?;
        channel_notes(&transfer, &flats.levels, &name, &mut notes);
        let mut figures = figures_of(&transfer, &flats.levels, c, white);
        notes.extend(figures.quantum_efficiency.and_then(|v| remarks::efficiency(&name, v)));
        let k = transfer.gain.value;
        spatial_figures(&mut figures, k, &dark_maps, &flats.maps, c);
        if flats.maps.spread(Line::Slope, c).is_none() {
            // Levels too near to each other for a slope: the standard's figure of one of them.
            figures.prnu = emva::prnu_of_levels(&darks, &flats.levels, c);
        }
        let dsnu = dsnu_level.channels[c].spatial().total;
        figures.dsnu_e = dsnu.sqrt().map(|v| v.scaled(1.0 / k));
        leave_out_rounded_patterns(
            &mut figures,
            (k, &transfer.codes),
            dsnu_level.channels[c].temporal,
            &name,
            &mut notes,
        );
        figures.dark_doubling_c = dark::doubling(&darks, &other_darks, c);
        channels.push(ChannelPtc {
            channel: name,
            figures,
            reduced_chi2: transfer.reduced_chi2,
            curve: curve(&transfer, &flats.levels, c),
        });
    }
    Ok(Ptc {
        figures: over_channels(&channels),
        channels,
        analog_gain: selection.analog_gain,
        dsnu_exposure_s: dsnu_level.exposure_s,
        notes,
    })
}

/// Reads dark stacks as levels and as lines against exposure time for every pixel.
fn read_darks(set: &CaptureSet, captures: &[&Capture]) -> Result<(Vec<Level>, LineMaps)> {
    let mut maps = LineMaps::new(set.sensor.width, set.sensor.height, &Site::all(&set.cfa()));
    let mut levels = Vec::new();
    for capture in captures {
        let stack = Stack::read(set, capture)?;
        copies::refuse(set, capture, &stack)?;
        let level = Level::new(set, capture, &stack);
        let point = |m: &Moments| Point {
            x: level.exposure_s,
            z: 0.0,
            weight: m.frames as f64 / m.temporal.max(QUANTISATION),
        };
        maps.add(&stack, &level.channels.iter().map(point).collect::<Vec<_>>());
        levels.push(level);
    }
    Ok((levels, maps))
}

/// The flats in rising order of light.
struct Flats {
    levels: Vec<Level>,
    /// Whether a level lies below the knee, per channel and level.
    passed: Vec<Vec<bool>>,
    knees: Vec<Knee>,
    /// Lines for every pixel over the channel's mean signal, from the levels below the knee.
    maps: LineMaps,
}

impl Flats {
    fn read(set: &CaptureSet, selection: &Selection, darks: &[Level]) -> Result<Self> {
        let sites = Site::all(&set.cfa());
        let count = set.cfa().channels().len();
        let white = f64::from(set.sensor.white_level_dn);
        let dark_lines: Vec<DarkLine> = (0..count).map(|c| DarkLine::of(darks, c)).collect();
        let mut flats = Self {
            levels: Vec::new(),
            passed: vec![Vec::new(); count],
            knees: vec![Knee::default(); count],
            maps: LineMaps::new(set.sensor.width, set.sensor.height, &sites),
        };
        let mut order = selection.flats.clone();
        let light = |c: &Capture| ladder::photons(set, c).unwrap_or(c.exposure_s);
        order.sort_by(|a, b| light(a).total_cmp(&light(b)));
        // A level is added to the maps after the next brighter one, which may show saturation.
        let mut waiting: Option<(Stack, Level)> = None;
        for capture in order {
            let stack = Stack::read(set, capture)?;
            copies::refuse(set, capture, &stack)?;
            let level = Level::new(set, capture, &stack);
            let codes = ladder::codes(darks, std::slice::from_ref(&level));
            for (c, m) in level.channels.iter().enumerate() {
                if m.frames < 2 {
                    return Err(ladder::single_frame(format!("flat capture {:?}", level.id)));
                }
                let dark = dark_lines[c].mean_at(level.exposure_s).value;
                let variance = m.above(&darks[0].channels[c]);
                let passes = flats.knees[c].passes(m, m.mean() - dark, variance, &codes);
                flats.passed[c].push(passes);
            }
            if let Some((stack, level)) = waiting.replace((stack, level)) {
                flats.keep(&stack, level, &dark_lines, white);
            }
        }
        if let Some((stack, level)) = waiting {
            flats.keep(&stack, level, &dark_lines, white);
        }
        Ok(flats)
    }

    fn keep(&mut self, stack: &Stack, level: Level, dark: &[DarkLine], white: f64) {
        let index = self.levels.len();
        let points: Vec<Point> = (0..level.channels.len())
            .map(|c| {
                let m = &level.channels[c];
                let usable = self.passed[c][index] && self.knees[c].clear(m, white);
                let weight = m.frames as f64 / m.temporal.max(QUANTISATION);
                Point {
                    x: m.mean() - dark[c].mean_at(level.exposure_s).value,
                    z: level.exposure_s,
                    weight: if usable { weight } else { 0.0 },
                }
            })
            .collect();
        self.maps.add(stack, &points);
        self.levels.push(level);
    }
}

fn figures_of(t: &Transfer, flats: &[Level], channel: usize, white: f64) -> Figures {
    let k = t.gain;
    let (black, rate) = t.dark.offset_and_rate();
    let brightest =
        t.signals.iter().zip(&t.used).filter(|s| *s.1).map(|s| *s.0).fold(0.0, f64::max);
    let photons_known = flats.iter().all(|f| f.photons.is_some());
    Figures {
        system_gain_dn_per_e: Some(k),
        read_noise_e: t.read_noise(),
        full_well_e: t.full_well(flats, channel, white),
        dark_current_e_per_s: rate.map(|r| r.over(k)),
        dark_current_from_variance_e_per_s: t
            .dark_variance_rate
            .map(|r| Value::new(r.value, r.std_error).scaled(1.0 / (k.value * k.value))),
        black_level_dn: Some(black),
        nonlinearity_percent: t.response.map(|r| {
            let x = r.linearise(brightest);
            Value::new(100.0 * (brightest / x - 1.0), 100.0 * r.quadratic.std_error * x)
        }),
        quantum_efficiency: t.response.filter(|_| photons_known).map(|r| r.responsivity.over(k)),
        ..Figures::default()
    }
}

/// Adds the spatial figures from the lines of the pixels, in electrons.
fn spatial_figures(f: &mut Figures, k: f64, darks: &LineMaps, flats: &LineMaps, channel: usize) {
    let offsets = darks.spread(Line::Offset, channel);
    let hot = darks.hot(channel);
    let rates = darks.spread_without(Line::Slope, channel, hot.as_ref()).map(|s| s.1.total);
    if let Some((_, SpatialVariance { row, column, pixel, .. })) = offsets {
        f.row_fpn_e = row.sqrt().map(|v| v.scaled(1.0 / k));
        f.column_fpn_e = column.sqrt().map(|v| v.scaled(1.0 / k));
        f.pixel_fpn_e = pixel.sqrt().map(|v| v.scaled(1.0 / k));
        if let Some(black) = &mut f.black_level_dn {
            // The mean of a pattern is zero over all sensors, but not over the pixels of this one.
            let of_rows = row.value.max(0.0) / flats.rows() as f64;
            let of_columns = column.value.max(0.0) / flats.columns() as f64;
            let of_pixels = pixel.value.max(0.0) / (flats.rows() * flats.columns()) as f64;
            black.std_error =
                libm::hypot(black.std_error, (of_rows + of_columns + of_pixels).sqrt());
        }
    }
    if let Some(rates) = rates {
        f.dsnu_e_per_s = rates.sqrt().map(|v| v.scaled(1.0 / k));
        if let Some(hot) = &hot {
            f.hot_pixel_fraction = Some(hot.fraction);
            f.hot_pixel_mean_e_per_s = hot.mean.map(|v| v.scaled(1.0 / k));
            if let Some(current) = &mut f.dark_current_e_per_s {
                current.value -= hot.of_mean / k;
            }
        }
        if let Some(current) = &mut f.dark_current_e_per_s {
            let population = rates.value.max(0.0) / (k * k) / flats.pixels(channel);
            current.std_error = libm::hypot(current.std_error, population.sqrt());
        }
    }
    let Some((mean, gains)) = flats.spread(Line::Slope, channel) else { return };
    // Where flats differ in exposure time, the pattern of the dark current contributes to the
    // slope.
    let lean = flats.companion_slope(channel).unwrap_or(0.0);
    let dark_part = rates.map_or(0.0, |r| r.value.max(0.0) * lean * lean);
    let variance = (gains.total.value - dark_part) / (mean * mean);
    f.prnu = Value::new(variance, gains.total.std_error / (mean * mean)).sqrt();
}

/// Largest relative change of patterns by rounding to whole DN with which they are reported.
const ROUNDED: f64 = 0.05;

/// Excludes fixed patterns of the dark that rounding to whole DN changes: offsets by the noise
/// at zero exposure, the pattern of the dark current by the noise of the longest stack
/// (`variance`, DN²).
fn leave_out_rounded_patterns(
    f: &mut Figures,
    (k, codes): (f64, &Codes),
    variance: f64,
    name: &str,
    notes: &mut Vec<String>,
) {
    let note = |what: &str, noise: f64| {
        format!(
            "channel {name}: {what} not determined: with a noise of {:.2} DN, rounding to {} \
             changes patterns that are smaller than {}",
            noise * codes.step_dn,
            if codes.step_dn > 1.0 { "codes" } else { "whole DN" },
            if codes.step_dn > 1.0 { "their step" } else { "a DN" },
        )
    };
    let at_zero = f.read_noise_e.map_or(0.0, |r| r.value * k) / codes.step_dn;
    if rounding_of_patterns(at_zero * at_zero) > ROUNDED {
        (f.row_fpn_e, f.column_fpn_e, f.pixel_fpn_e) = (None, None, None);
        notes.push(note("row_fpn_e, column_fpn_e and pixel_fpn_e", at_zero));
    }
    let longest = (variance / codes.square() - QUANTISATION).max(0.0);
    if rounding_of_patterns(longest) > ROUNDED {
        (f.dsnu_e, f.dsnu_e_per_s) = (None, None);
        notes.push(note("dsnu_e and dsnu_e_per_s", longest.sqrt()));
    }
}

fn curve(t: &Transfer, flats: &[Level], channel: usize) -> Vec<CurvePoint> {
    (0..flats.len())
        .map(|i| {
            let m = &flats[i].channels[channel];
            CurvePoint {
                id: flats[i].id.clone(),
                signal_dn: t.signals[i],
                variance_dn2: Value::new(m.temporal, m.temporal_error),
                used: t.used[i],
            }
        })
        .collect()
}

/// The figures over all channels.
fn over_channels(channels: &[ChannelPtc]) -> Figures {
    let of = |get: fn(&Figures) -> Option<Value>| {
        let values: Vec<Value> = channels.iter().filter_map(|c| get(&c.figures)).collect();
        if let [one] = values[..] { Some(one) } else { Value::combine(values) }
    };
    // Errors of counts grow with these: weighted by them, the mean would be too low.
    let of_counts = |get: fn(&Figures) -> Option<Value>| {
        let values: Vec<Value> = channels.iter().filter_map(|c| get(&c.figures)).collect();
        let n = values.len() as f64;
        let mean = values.iter().map(|v| v.value).sum::<f64>() / n;
        let error = values.iter().map(|v| v.std_error * v.std_error).sum::<f64>().sqrt() / n;
        (!values.is_empty()).then(|| Value::new(mean, error))
    };
    let mono = channels.len() == 1;
    Figures {
        system_gain_dn_per_e: of(|f| f.system_gain_dn_per_e),
        read_noise_e: of(|f| f.read_noise_e),
        full_well_e: of(|f| f.full_well_e),
        prnu: of(|f| f.prnu),
        dsnu_e: of(|f| f.dsnu_e),
        dark_current_e_per_s: of(|f| f.dark_current_e_per_s),
        dark_current_from_variance_e_per_s: of(|f| f.dark_current_from_variance_e_per_s),
        dsnu_e_per_s: of(|f| f.dsnu_e_per_s),
        hot_pixel_fraction: of_counts(|f| f.hot_pixel_fraction),
        hot_pixel_mean_e_per_s: of_counts(|f| f.hot_pixel_mean_e_per_s),
        pixel_fpn_e: of(|f| f.pixel_fpn_e),
        row_fpn_e: of(|f| f.row_fpn_e),
        column_fpn_e: of(|f| f.column_fpn_e),
        black_level_dn: of(|f| f.black_level_dn),
        nonlinearity_percent: of(|f| f.nonlinearity_percent),
        dark_doubling_c: of(|f| f.dark_doubling_c),
        // Quantum efficiency includes the colour filter, so that there is none over all channels.
        quantum_efficiency: if mono { of(|f| f.quantum_efficiency) } else { None },
    }
}

#[cfg(test)]
mod tests;
