//! Figures of a picture after its kind of scene, as `camrig measure` and `camrig isp` give them.
//!
//! - `uniform`: `snr_db` per channel, in the middle quarter of the frame ([`even`]).
//! - `slanted-edge`: `mtf50_cycles_per_pixel` per channel (e-SFR) in the same region.
//! - any scene, where `[figures]` names it: `dynamic_range_db` per channel (EMVA 1288), of two dark
//!   frames of the picture's exposure, gain and temperature, and the system gain K, DN/e⁻
//!   ([`dark_stack`](camrig_measure::dark_stack)).
//! - `colorchecker`: `delta_e_2000_mean` and `delta_e_2000_max` over the patches, of the simple
//!   development by [`preview`].
//!
//! Each is what `camrig measure` or `camrig isp` gives of the same frames, digit for digit.

use camrig_base::{Error, Plane, RawFrame, Result, toml_text};
use camrig_formats::{DngInfo, preview};
use camrig_measure::picture::{Card, ColourError, colours, srgb_to_linear};
use camrig_measure::{Value as Figure, even, figure, mtf};
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
    pub channels: Map<String, Value>,
    /// Of the whole picture; empty where its scene has none.
    pub picture: Map<String, Value>,
}

/// The figures of a frame of `scene`, with the dynamic range of each channel, dB, where it was
/// measured. One that the frame does not determine is null, with the reason beside it.
///
/// # Errors
/// A fault of the program.
pub fn of(
    frame: &RawFrame,
    dynamic_ranges_db: Option<&[Figure]>,
    info: &DngInfo,
    scene: &str,
    wanted: &Wanted,
) -> Result<Figures> {
    let (chart, options) = scene.split_once(':').unwrap_or((scene, ""));
    let chart = &*chart.to_ascii_lowercase();
    let mut channels = Map::new();
    for (index, channel) in frame.channel_means().into_iter().enumerate() {
        let mut figures = Map::new();
        let mut put = |name: &str, found: Result<Figure>| {
            if let Err(why) = &found {
                let name = name.split('_').next().unwrap_or(name);
                figures.insert(format!("{name}_missing"), json!(why.what()));
            }
            figures.insert(name.into(), json!(found.ok()));
        };
        put("mean_dn", Ok(Figure::chosen(channel.mean_dn)));
        put("saturated_fraction", Ok(Figure::chosen(channel.saturated)));
        if chart == "uniform" && wanted.has("snr_db") {
            put("snr_db", even::snr_db(frame, index, even::middle(frame)));
        }
        if let Some(ranges) = dynamic_ranges_db {
            put("dynamic_range_db", Ok(ranges[index]));
        }
        if chart == "slanted-edge" && wanted.has("mtf50_cycles_per_pixel") {
            put("mtf50_cycles_per_pixel", mtf50(frame, frame.cfa.channels()[index]));
        }
        channels.insert(channel.name, figures.into());
    }
    let mut picture = Map::new();
    let colour = frame.cfa.channels() == ['R', 'G', 'B'];
    if chart == "colorchecker" && colour && wanted.has("delta_e_2000") {
        match delta_e(frame, info, options) {
            Ok(found) => picture = figure::object(&found)?,
            Err(why) => drop(picture.insert("delta_e_2000_missing".into(), json!(why.what()))),
        }
    }
    Ok(Figures { channels: figure::object(&channels)?, picture })
}

fn mtf50(frame: &RawFrame, letter: char) -> Result<Figure> {
    let (roi, white) = (even::middle(frame), Some(frame.white_level_dn));
    Ok(mtf::measure(&frame.plane(), &frame.cfa, letter, roi, white, None)?.mtf50_cycles_per_pixel)
}

/// Colour error of the chart's patches.
fn delta_e(frame: &RawFrame, info: &DngInfo, options: &str) -> Result<ColourError> {
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
    Ok(ColourError::of(&patches))
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
        "snr_db" => vec![name, "snr_std_error", "snr_missing"],
        "dynamic_range_db" => vec![name, "dynamic_range_std_error"],
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
        let mut of_picture = Some(&record["figures"]["delta_e_2000_mean"]["value"]);
        for (channel, values) in record["channels"].as_object().into_iter().flatten() {
            let mut cells = vec![cell(&record["index"])];
            cells.extend(fixed.iter().map(|name| cell(&parameters[*name])));
            cells.extend(keys.iter().map(|key| cell(&parameters["camera_keys"][key])));
            cells.push(channel.clone());
            cells.extend(figures.iter().map(|name| match *name {
                "delta_e_2000" => of_picture.take().map_or_else(String::new, cell),
                name => match name.strip_suffix("_std_error") {
                    Some(figure) => {
                        let whole = NAMES.into_iter().find(|name| name.starts_with(figure));
                        cell(&values[whole.unwrap_or(figure)]["std_error"])
                    }
                    None if values[name].is_object() => cell(&values[name]["value"]),
                    None => cell(&values[name]),
                },
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
        of(frame, None, &DngInfo::default(), scene, &Wanted::default()).unwrap()
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
        let found = figures.channels["m"]["mtf50_cycles_per_pixel"]["value"].as_f64();
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
            "channels": {
                "b": { "snr_db": null, "snr_missing": "no signal" },
                "g": { "mean_dn": { "value": 5.0 }, "snr_db": { "value": 30.5, "std_error": 0.2 } },
            },
        });
        let text = table(&[record], &wanted);
        assert_eq!(
            text,
            "index,camera,scene,illuminant,lux,exposure_s,analog_gain,frame,k,channel,snr_db,\
             snr_std_error,snr_missing\n\
             3,\"a, b\",uniform,,10.0,,,,2,b,,,no signal\n\
             3,\"a, b\",uniform,,10.0,,,,2,g,30.5,0.2,\n"
        );
    }
}
