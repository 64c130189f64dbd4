//! Figures of a picture after its kind of scene, as `camrig measure` and `camrig isp` give them.
//!
//! - `uniform`: `snr_db` per channel, 20 log₁₀ of the signal above black over the noise, in the
//!   middle quarter of the frame. Noise is that of one frame from pixel to pixel, temporal and
//!   fixed, from differences of neighbours of one colour, so that shading does not count.
//! - `slanted-edge`: `mtf50_cycles_per_pixel` per channel (e-SFR) in the same region.
//! - any scene, where `[figures]` names it: `dynamic_range_db` per channel (EMVA 1288), 20 log₁₀ of
//!   the largest signal over the smallest detectable one: (white − black)/K e⁻ over
//!   [`emva::threshold_e`] of the temporal noise of two dark frames of the picture's exposure, gain
//!   and temperature, and the system gain K, DN/e⁻.
//! - `colorchecker`: `delta_e_2000`, mean and largest over the patches, of the simple development
//!   by [`preview`].

use camrig_base::{Error, Plane, RawFrame, Result, toml_text};
use camrig_formats::{DngInfo, preview};
use camrig_measure::emva;
use camrig_measure::mtf::{self, Roi};
use camrig_measure::picture::{Card, colours, srgb_to_linear};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// Names of the figures.
const NAMES: [&str; 6] = [
    "mean_dn",
    "saturated_fraction",
    "snr_db",
    "dynamic_range_db",
    "mtf50_cycles_per_pixel",
    "delta_e_2000",
];
/// Those of them that have a better and a worse.
pub(crate) const RANKED: [&str; 4] =
    ["snr_db", "dynamic_range_db", "mtf50_cycles_per_pixel", "delta_e_2000"];
/// Width of the built-in ColorChecker's card unless its options set another, sensor widths.
const CARD: f64 = 0.8;

/// Which figures are wanted: all that a scene allows, unless a sweep file's `[figures]` names
/// some.
#[derive(Clone, Debug, Default)]
pub struct Wanted(Option<Vec<String>>);

impl Wanted {
    /// From `[figures]`: each name with true or false.
    pub(crate) fn new(table: Option<&BTreeMap<String, bool>>) -> Result<Self> {
        let Some(table) = table else { return Ok(Self(None)) };
        if let Some(name) = table.keys().find(|name| !NAMES.contains(&&name[..])) {
            return Err(Error::input(format!("figure {name:?}"))
                .at("[figures]")
                .help(toml_text::did_you_mean(name, &NAMES)));
        }
        let names = table.iter().filter(|(_, wanted)| **wanted).map(|(name, _)| name.clone());
        Ok(Self(Some(names.collect())))
    }

    /// Whether the sweep file names figures, which then have a table of their own.
    pub(crate) fn is_named(&self) -> bool {
        self.0.is_some()
    }

    /// Whether dark frames are to be taken: only for a figure that the sweep file names.
    pub(crate) fn takes_dark(&self) -> bool {
        self.is_named() && self.has("dynamic_range_db")
    }

    fn has(&self, name: &str) -> bool {
        self.0.as_ref().is_none_or(|names| names.iter().any(|n| n == name))
    }
}

/// Figures of a picture.
pub struct Figures {
    /// By channel.
    pub channels: Value,
    /// Of the whole picture; empty where its scene has none.
    pub picture: Map<String, Value>,
}

/// Two frames without light, and the system gain, DN/e⁻.
pub struct Dark {
    /// Frames of the picture's settings.
    pub frames: [RawFrame; 2],
    /// K.
    pub dn_per_e: f64,
}

impl Dark {
    /// Dynamic range of each channel, dB.
    pub fn dynamic_ranges_db(&self) -> Vec<Option<f64>> {
        let channels = self.frames[0].cfa.channels().len();
        (0..channels).map(|channel| self.dynamic_range_db(channel)).collect()
    }

    /// Dynamic range of a channel, dB; `None` without a pixel of it.
    fn dynamic_range_db(&self, channel: usize) -> Option<f64> {
        let [a, b] = &self.frames;
        let of_channel = |i: &usize| a.cfa.channel(i % a.width, i / a.width) == channel;
        let (mut square, mut count) = (0.0, 0.0);
        for i in (0..a.data.len()).filter(of_channel) {
            square += (f64::from(a.data[i]) - f64::from(b.data[i])).powi(2);
            count += 1.0;
        }
        // A difference of two samples has twice the variance of one; codes are whole DN.
        let threshold_e = emva::threshold_e(square / (2.0 * count), 1.0, self.dn_per_e);
        let largest_e = (f64::from(a.white_level_dn) - a.black_level_dn) / self.dn_per_e;
        (count > 0.0).then(|| 20.0 * libm::log10(largest_e / threshold_e))
    }
}

/// The figures of a frame of `scene`, with the dynamic range of each channel where it was
/// measured. One that the frame does not determine is null, with the
/// reason beside it.
#[must_use]
pub fn of(
    frame: &RawFrame,
    dynamic_ranges_db: Option<&[Option<f64>]>,
    info: &DngInfo,
    scene: &str,
    wanted: &Wanted,
) -> Figures {
    let (chart, options) = scene.split_once(':').unwrap_or((scene, ""));
    let chart = &*chart.to_ascii_lowercase();
    let mut channels = Map::new();
    for (index, channel) in frame.channel_means().into_iter().enumerate() {
        let mut figures =
            json!({ "mean_dn": channel.mean_dn, "saturated_fraction": channel.saturated });
        if chart == "uniform" && wanted.has("snr_db") {
            figures["snr_db"] = json!(snr_db(frame, index));
        }
        if let Some(channels) = dynamic_ranges_db {
            figures["dynamic_range_db"] = json!(channels.get(index));
        }
        if chart == "slanted-edge" && wanted.has("mtf50_cycles_per_pixel") {
            let mtf50 = mtf50(frame, frame.cfa.channels()[index]);
            figures["mtf50_cycles_per_pixel"] = json!(mtf50.as_ref().ok().map(|m| m.0));
            figures["mtf50_std_error"] = json!(mtf50.as_ref().ok().map(|m| m.1));
            if let Err(why) = mtf50 {
                figures["mtf50_missing"] = json!(why.what());
            }
        }
        channels.insert(channel.name, figures);
    }
    let mut picture = Map::new();
    let colour = frame.cfa.channels() == ['R', 'G', 'B'];
    if chart == "colorchecker" && colour && wanted.has("delta_e_2000") {
        let found = delta_e(frame, info, options);
        picture.insert("delta_e_2000".into(), found.as_ref().map_or(Value::Null, Value::clone));
        if let Err(why) = found {
            picture.insert("delta_e_2000_missing".into(), json!(why.what()));
        }
    }
    Figures { channels: channels.into(), picture }
}

/// The middle half of the width and height.
fn middle(frame: &RawFrame) -> Roi {
    let (x, y) = (frame.width / 4, frame.height / 4);
    Roi { x, y, width: frame.width - 2 * x, height: frame.height - 2 * y }
}

/// Signal over noise of a channel, dB; `None` where there is no signal or no noise.
fn snr_db(frame: &RawFrame, channel: usize) -> Option<f64> {
    let Roi { x, y, width, height } = middle(frame);
    let step = frame.cfa.width;
    let (mut sum, mut count, mut square, mut pairs) = (0.0, 0.0, 0.0, 0.0);
    for v in y..y + height {
        for u in (x..x + width).filter(|u| frame.cfa.channel(*u, v) == channel) {
            let at = |u: usize| f64::from(frame.data[v * frame.width + u]);
            sum += at(u);
            count += 1.0;
            if u + step < x + width {
                square += (at(u + step) - at(u)).powi(2);
                pairs += 1.0;
            }
        }
    }
    let signal = sum / count - frame.black_level_dn;
    // A difference of two samples has twice the variance of one.
    let noise = (square / (2.0 * pairs)).sqrt();
    (signal > 0.0 && noise > 0.0).then(|| 20.0 * libm::log10(signal / noise))
}

fn mtf50(frame: &RawFrame, letter: char) -> Result<(f64, f64)> {
    let plane = Plane { width: frame.width, height: frame.height, data: frame.data.clone() };
    let white = Some(frame.white_level_dn);
    let edge = mtf::measure(&plane, &frame.cfa, letter, middle(frame), white, None)?;
    Ok((edge.mtf50_cycles_per_pixel, edge.mtf50_std_error))
}

/// Colour error of the chart's patches.
fn delta_e(frame: &RawFrame, info: &DngInfo, options: &str) -> Result<Value> {
    let width = options.split([':', ',']).find_map(|option| option.strip_prefix("width="));
    let card = width.and_then(|w| w.parse().ok()).unwrap_or(CARD);
    let shown = preview::render(frame, info);
    let linear = |p: &[u8; 3]| p.map(|v| srgb_to_linear(f64::from(v) / 255.0));
    let picture = Plane {
        width: shown.width,
        height: shown.height,
        data: shown.data.iter().map(linear).collect(),
    };
    let patches = colours(&picture, Card { frame_width: frame.width, card_width: card })?;
    let mean = patches.iter().map(|p| p.delta_e_2000).sum::<f64>() / patches.len() as f64;
    let max = patches.iter().map(|p| p.delta_e_2000).fold(0.0, f64::max);
    Ok(json!({ "mean": mean, "max": max }))
}

/// Records as a table: a line per picture and channel, parameters and figures in columns, and
/// those of the picture beside the first channel.
pub(crate) fn table(records: &[Value], wanted: &Wanted) -> String {
    let keys: Vec<String> = records
        .first()
        .and_then(|r| r["parameters"]["camera_keys"].as_object())
        .map_or_else(Vec::new, |keys| keys.keys().cloned().collect());
    let fixed = ["camera", "scene", "illuminant", "lux", "exposure_s", "analog_gain", "frame"];
    let columns = |name: &'static str| match name {
        "mtf50_cycles_per_pixel" => vec![name, "mtf50_std_error", "mtf50_missing"],
        _ => vec![name],
    };
    let figures: Vec<&str> =
        NAMES.into_iter().filter(|name| wanted.has(name)).flat_map(columns).collect();
    let mut head = vec!["index"];
    head.extend(fixed);
    head.extend(keys.iter().map(|key| &key[..]));
    head.push("channel");
    head.extend(&figures);
    let mut lines = vec![head.iter().map(|h| cell(&json!(h))).collect::<Vec<_>>().join(",")];
    for record in records {
        let parameters = &record["parameters"];
        let mut of_picture = Some(&record["figures"]["delta_e_2000"]["mean"]);
        for (channel, values) in record["channels"].as_object().into_iter().flatten() {
            let mut cells = vec![cell(&record["index"])];
            cells.extend(fixed.iter().map(|name| cell(&parameters[*name])));
            cells.extend(keys.iter().map(|key| cell(&parameters["camera_keys"][key])));
            cells.push(channel.clone());
            cells.extend(figures.iter().map(|name| match *name {
                "delta_e_2000" => of_picture.take().map_or_else(String::new, cell),
                name => cell(&values[name]),
            }));
            lines.push(cells.join(","));
        }
    }
    lines.push(String::new());
    lines.join("\n")
}

/// A value as a cell of a CSV file (RFC 4180).
fn cell(value: &Value) -> String {
    let text = match value {
        Value::Null => return String::new(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    match text.contains([',', '"', '\n']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::Cfa;

    fn frame(sample: impl Fn(usize, usize) -> u16) -> RawFrame {
        let (width, height) = (64, 48);
        RawFrame {
            width,
            height,
            bits: 12,
            cfa: Cfa::parse("mono").unwrap(),
            black_level_dn: 100.0,
            white_level_dn: 4095,
            data: (0..width * height).map(|i| sample(i % width, i / width)).collect(),
        }
    }

    fn figures(scene: &str, frame: &RawFrame) -> Figures {
        of(frame, None, &DngInfo::default(), scene, &Wanted::default())
    }

    /// Samples alternate by ±5 about 1100 on a slope of 1 DN per pixel. Of the 32 columns in the
    /// middle, whose mean is 1131.5 DN, 16 differences of neighbours are -9 and 15 are 11: a mean
    /// square of 100.355 DN² and a noise of √(100.355/2) = 7.0836 DN.
    #[test]
    fn signal_to_noise_of_a_uniform_scene() {
        let frame = frame(|x, _| (1100 + x + if x % 2 == 0 { 10 } else { 0 } - 5) as u16);
        let found = figures("uniform:0.18", &frame).channels["m"]["snr_db"].as_f64().unwrap();
        let truth = 20.0 * (1031.5_f64 / 7.0836).log10();
        assert!((found - truth).abs() < 1e-3, "{found} {truth}");
        assert!(figures("ramp", &frame).channels["m"].get("snr_db").is_none());
        let flat = self::frame(|_, _| 500);
        assert!(figures("uniform", &flat).channels["m"]["snr_db"].is_null());
    }

    /// Frames that differ by ±4 DN have a noise of 4/√2 DN, with K = 2 DN/e⁻ 1.414 e⁻; the range is
    /// 3995/2 e⁻.
    #[test]
    fn dynamic_range_of_dark_frames() {
        let dark = Dark {
            frames: [
                frame(|x, _| 100 + 4 * (x % 2) as u16),
                frame(|x, _| 104 - 4 * (x % 2) as u16),
            ],
            dn_per_e: 2.0,
        };
        let found = dark.dynamic_range_db(0).unwrap();
        let truth = 20.0 * (1997.5_f64 / (2.25_f64.sqrt() + 0.5)).log10();
        assert!((found - truth).abs() < 1e-9, "{found} {truth}");
        // Where all samples have one code, rounding may hide 0.49 DN.
        let quiet = Dark { frames: [frame(|_, _| 100), frame(|_, _| 100)], dn_per_e: 2.0 };
        let truth = 20.0 * (1997.5_f64 / ((0.24_f64 / 4.0 + 0.25).sqrt() + 0.5)).log10();
        let found = quiet.dynamic_range_db(0).unwrap();
        assert!((found - truth).abs() < 1e-9, "{found} {truth}");
        assert_eq!(dark.dynamic_range_db(7), None);
    }

    /// An edge that rises evenly over two pixels has the MTF sinc(2f), which is ½ at 0.3017 cycles
    /// per pixel.
    #[test]
    fn mtf50_of_an_edge_and_why_there_is_none() {
        let edge = frame(|x, y| {
            let place = 32.0 + 0.1 * (y as f64 - 24.0) - x as f64;
            let noise = ((3 * x + 5 * y) % 7) as f64;
            (500.0 + 2000.0 * (1.0 - (place / 2.0).clamp(0.0, 1.0)) + noise).round() as u16
        });
        let figures = figures("slanted-edge:angle=5", &edge);
        let found = figures.channels["m"]["mtf50_cycles_per_pixel"].as_f64();
        let found = found.unwrap_or_else(|| panic!("{}", figures.channels["m"]["mtf50_missing"]));
        assert!((found - 0.3017).abs() < 0.005, "{found}");
        let none = self::figures("slanted-edge", &frame(|_, _| 500));
        assert!(none.channels["m"]["mtf50_cycles_per_pixel"].is_null());
        assert!(none.channels["m"]["mtf50_missing"].is_string());
    }

    #[test]
    fn figures_are_chosen_by_name_and_written_as_a_table() {
        let named = |names: &[(&str, bool)]| {
            Wanted::new(Some(&names.iter().map(|(n, w)| ((*n).to_owned(), *w)).collect()))
        };
        let wanted = named(&[("snr_db", true), ("mean_dn", false)]).unwrap();
        assert!(wanted.is_named() && wanted.has("snr_db") && !wanted.has("mean_dn"));
        let error = named(&[("snr", true)]).unwrap_err().to_string();
        assert!(error.contains("snr_db"), "{error}");
        let record = json!({
            "index": 3,
            "parameters": {
                "camera": "a, b", "scene": "uniform", "lux": 10.0, "camera_keys": { "k": 2 }
            },
            "channels": { "g": { "mean_dn": 5.0, "snr_db": 30.5 } },
        });
        let text = table(&[record], &wanted);
        assert_eq!(
            text,
            "index,camera,scene,illuminant,lux,exposure_s,analog_gain,frame,k,channel,snr_db\n\
             3,\"a, b\",uniform,,10.0,,,,2,g,30.5\n"
        );
    }
}
