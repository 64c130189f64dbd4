//! The records of a sweep as settings with their figures.

use crate::numbers::{amount, number};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// A figure that a sweep may have.
#[derive(Debug)]
pub(super) struct Figure {
    /// Its key in a record, or the name of one that follows from those.
    pub key: &'static str,
    /// Its name and unit for people.
    pub name: &'static str,
    pub unit: &'static str,
    /// Whether less is better; `None` where neither is.
    pub less_is_better: Option<bool>,
}

/// Figures that no record has: MTF50 where the pitch is known, and the light for an SNR of 10
/// where the light was swept.
const PER_MM: &str = "mtf50_cycles_per_mm";
pub(super) const LIGHT: &str = "snr_10_lux";
pub(super) const SNR: &str = "snr_db";

/// SNR of 10, dB: the least with which ISO 12232 calls a picture acceptable.
pub(super) const ACCEPTABLE_DB: f64 = 20.0;

pub(super) const FIGURES: [Figure; 8] = [
    figure(LIGHT, "Light for SNR 10", "lx", Some(true)),
    figure(SNR, "SNR", "dB", Some(false)),
    figure(PER_MM, "MTF50 on the sensor", "cycles/mm", Some(false)),
    figure("mtf50_cycles_per_pixel", "MTF50", "cycles/pixel", Some(false)),
    figure("dynamic_range_db", "Dynamic range", "dB", Some(false)),
    figure("delta_e_2000", "Colour error, mean", "ΔE2000", Some(true)),
    figure("mean_dn", "Mean", "DN", None),
    figure("saturated_fraction", "Saturated share", "1", None),
];

const fn figure(
    key: &'static str,
    name: &'static str,
    unit: &'static str,
    less_is_better: Option<bool>,
) -> Figure {
    Figure { key, name, unit, less_is_better }
}

impl Figure {
    /// The figure of a key.
    pub fn of(key: &str) -> Option<&'static Self> {
        FIGURES.iter().find(|f| f.key == key)
    }

    /// Name and unit, for an axis or the head of a column.
    pub fn words(&self) -> String {
        format!("{}, {}", self.name, self.unit)
    }

    /// 1 where more is better, −1 where less is.
    pub fn sign(&self) -> f64 {
        if self.less_is_better == Some(true) { -1.0 } else { 1.0 }
    }

    pub fn wanted(&self) -> &'static str {
        if self.less_is_better == Some(true) { "least" } else { "largest" }
    }

    /// Whether a value is as good as a need.
    pub fn meets(&self, value: f64, need: f64) -> bool {
        self.sign() * (value - need) >= 0.0
    }
}

/// A value that was swept.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Swept {
    Number(f64),
    Word(String),
}

impl Swept {
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Number(value) => Some(*value),
            Self::Word(_) => None,
        }
    }
}

/// A value with its standard error, if that is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Measured {
    pub value: f64,
    pub std_error: Option<f64>,
}

/// Pictures of one setting.
#[derive(Clone, Debug)]
pub(super) struct Setting {
    pub values: Vec<Swept>,
    /// Values of each figure, one per picture, each a mean over the channels.
    figures: BTreeMap<&'static str, Vec<Measured>>,
}

impl Setting {
    /// Mean of a figure. The standard error comes from the scatter of two pictures or more, which
    /// may be small by chance: it is not below what the pictures' own errors give. A single picture
    /// has its own, if any.
    pub fn mean(&self, figure: &Figure) -> Option<Measured> {
        let values = self.figures.get(figure.key).filter(|values| !values.is_empty())?;
        if let [one] = values[..] {
            return Some(one);
        }
        let n = values.len() as f64;
        let mean = values.iter().map(|v| v.value).sum::<f64>() / n;
        let square: f64 = values.iter().map(|v| (v.value - mean).powi(2)).sum();
        let own: f64 = values.iter().filter_map(|v| v.std_error).map(|e| e * e).sum();
        let std_error = (square / (n - 1.0) / n).sqrt().max(own.sqrt() / n);
        Some(Measured { value: mean, std_error: Some(std_error) })
    }

    /// Text of a figure.
    pub fn words(&self, figure: &Figure) -> Option<String> {
        self.mean(figure).map(|mean| amount(mean.value, mean.std_error, figure.unit))
    }
}

/// A sweep's figures by what was swept.
#[derive(Clone, Debug)]
pub(super) struct Settings {
    /// Names of what was swept.
    pub names: Vec<String>,
    pub all: Vec<Setting>,
}

/// A figure over one parameter, with the others as in one of its settings.
pub(super) struct Line<'a> {
    pub of: &'a Setting,
    pub points: Vec<[f64; 2]>,
}

/// What a parameter of a record is, but for an object of more of them.
fn swept(value: &Value) -> Swept {
    match value.as_f64() {
        Some(number) => Swept::Number(number),
        None => Swept::Word(value.as_str().map_or_else(|| value.to_string(), str::to_owned)),
    }
}

/// The parameters of a record, keys of the camera file among them.
fn parameters(record: &Value) -> BTreeMap<String, Swept> {
    /// Neither is a choice that a camera's maker has.
    const NOT_CHOSEN: [&str; 4] = ["scene", "frame", "sensor_seed", "camera_keys"];
    let of = |value: &Value| value.as_object().cloned().unwrap_or_default();
    let all = of(&record["parameters"]);
    let keys = of(&record["parameters"]["camera_keys"]);
    let own =
        all.iter().filter(|(name, value)| !NOT_CHOSEN.contains(&&name[..]) && !value.is_null());
    own.chain(&keys).map(|(name, value)| (name.clone(), swept(value))).collect()
}

/// A figure of a picture, mean over its channels.
fn figure_of(record: &Value, figure: &Figure) -> Option<Measured> {
    let of_picture = &record["figures"][format!("{}_mean", figure.key)]["value"];
    if let Some(value) = of_picture.as_f64() {
        return Some(Measured { value, std_error: None });
    }
    let pitch_um = record["parameters"]["camera_keys"]["sensor.pitch_um"].as_f64();
    let (key, factor) = match figure.key {
        PER_MM => ("mtf50_cycles_per_pixel", 1e3 / pitch_um?),
        key => (key, 1.0),
    };
    let channels = record["channels"].as_object()?;
    let of = |part: &str| -> Vec<f64> {
        channels.values().filter_map(|c| c[key][part].as_f64()).collect()
    };
    let (values, errors) = (of("value"), of("std_error"));
    let n = values.len() as f64;
    let std_error = (errors.len() == values.len())
        .then(|| factor * errors.iter().map(|e| e * e).sum::<f64>().sqrt() / n);
    (n > 0.0).then(|| Measured { value: factor * values.iter().sum::<f64>() / n, std_error })
}

impl Settings {
    pub fn new(records: &[Value]) -> Self {
        let all: Vec<_> = records.iter().map(parameters).collect();
        let differs =
            |name: &&String| all.windows(2).any(|pair| pair[0].get(*name) != pair[1].get(*name));
        let names: BTreeSet<&String> = all.iter().flat_map(|p| p.keys()).collect();
        let names: Vec<String> = names.into_iter().filter(differs).cloned().collect();
        let mut settings: Vec<Setting> = Vec::new();
        for (record, parameters) in records.iter().zip(&all) {
            let none = || Swept::Word(String::new());
            let values: Vec<Swept> = names
                .iter()
                .map(|name| parameters.get(name).cloned().unwrap_or_else(none))
                .collect();
            let place = settings.iter().position(|s| s.values == values).unwrap_or_else(|| {
                settings.push(Setting { values, figures: BTreeMap::new() });
                settings.len() - 1
            });
            for figure in &FIGURES {
                if let Some(value) = figure_of(record, figure) {
                    settings[place].figures.entry(figure.key).or_default().push(value);
                }
            }
        }
        Self { names, all: settings }
    }

    /// Where the light is among what was swept, if SNR was measured over it.
    pub fn light(&self) -> Option<usize> {
        let light = self.names.iter().position(|name| name == "lux")?;
        let snr = Figure::of(SNR)?;
        let found = self.lines(snr, light).iter().any(|line| line.points.len() > 1);
        found.then_some(light)
    }

    /// Settings without the light: the light for an SNR of 10 instead of the SNR, and other
    /// figures at the most light, where noise counts least.
    pub fn without_light(&self) -> Self {
        let (Some(light), Some(snr)) = (self.light(), Figure::of(SNR)) else {
            return self.clone();
        };
        let without = |values: &[Swept]| {
            let mut values = values.to_vec();
            values.remove(light);
            values
        };
        let mut names = self.names.clone();
        names.remove(light);
        let mut brightest_first: Vec<&Setting> = self.all.iter().collect();
        let lux = |s: &Setting| s.values[light].number().unwrap_or(0.0);
        brightest_first.sort_by(|a, b| lux(b).total_cmp(&lux(a)));
        let mut all: Vec<Setting> = Vec::new();
        for setting in self.all.iter().map(|s| without(&s.values)) {
            if all.iter().any(|s| s.values == setting) {
                continue;
            }
            let own = brightest_first.iter().filter(|s| without(&s.values) == setting);
            let mut figures = BTreeMap::new();
            for (key, values) in own.flat_map(|s| &s.figures) {
                if ![SNR, "mean_dn", "saturated_fraction"].contains(key) {
                    figures.entry(*key).or_insert_with(|| values.clone());
                }
            }
            all.push(Setting { values: setting, figures });
        }
        for line in self.lines(snr, light) {
            let values = without(&line.of.values);
            let found = all.iter_mut().find(|s| s.values == values);
            if let (Some(setting), Ok(lux)) = (found, crossing(&line.points)) {
                setting.figures.insert(LIGHT, vec![Measured { value: lux, std_error: None }]);
            }
        }
        Self { names, all }
    }

    /// Whether a figure differs between settings; `None` where none has it.
    pub fn differs(&self, figure: &Figure) -> Option<bool> {
        let mut means = self.all.iter().filter_map(|s| s.mean(figure));
        let first = means.next()?.value;
        Some(means.any(|mean| mean.value != first))
    }

    /// Of some settings that where a figure is best.
    pub fn best<'a>(
        of: impl Iterator<Item = &'a Setting>,
        figure: &Figure,
    ) -> Option<&'a Setting> {
        figure.less_is_better?;
        let with = of.filter_map(|s| Some((s, figure.sign() * s.mean(figure)?.value)));
        with.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(setting, _)| setting)
    }

    /// The different values of a parameter in order, if all are numbers and there are several.
    pub fn numbers(&self, index: usize) -> Option<Vec<f64>> {
        let mut all = Vec::new();
        for setting in &self.all {
            let value = setting.values[index].number()?;
            if !all.contains(&value) {
                all.push(value);
            }
        }
        all.sort_by(f64::total_cmp);
        (all.len() > 1).then_some(all)
    }

    /// Text of a setting, without the parameters in `without`.
    pub fn words(&self, setting: &Setting, without: &[usize]) -> String {
        let named = self.names.iter().zip(&setting.values).enumerate();
        let words = named
            .filter(|(i, _)| !without.contains(i))
            .map(|(_, (name, value))| spoken_value(name, value));
        words.collect::<Vec<_>>().join(", ")
    }

    /// Lines of a figure over a parameter: one for each setting of the others.
    pub fn lines(&self, figure: &Figure, over: usize) -> Vec<Line<'_>> {
        let mut lines: Vec<Line<'_>> = Vec::new();
        for setting in &self.all {
            let (Some(mean), Some(x)) = (setting.mean(figure), setting.values[over].number())
            else {
                continue;
            };
            let same = |line: &Line<'_>| {
                let pairs = line.of.values.iter().zip(&setting.values).enumerate();
                pairs.filter(|(i, _)| *i != over).all(|(_, (a, b))| a == b)
            };
            match lines.iter_mut().find(|line| same(line)) {
                Some(line) => line.points.push([x, mean.value]),
                None => lines.push(Line { of: setting, points: vec![[x, mean.value]] }),
            }
        }
        lines.iter_mut().for_each(|l| l.points.sort_by(|a, b| a[0].total_cmp(&b[0])));
        lines
    }
}

/// A parameter's name and unit for people.
pub(super) fn spoken(name: &str) -> String {
    match name {
        "lux" => "scene illuminance, lx".into(),
        "exposure_s" => "exposure, s".into(),
        "analog_gain" => "analog gain".into(),
        "lens.f_number" => "f-number".into(),
        "sensor.pitch_um" => "pixel pitch, µm".into(),
        "sensor.full_well_e" => "full well, e⁻".into(),
        "sensor.noise.read_e" => "read noise, e⁻".into(),
        other => other.rsplit('.').next().unwrap_or(other).replace('_', " "),
    }
}

/// Text of a parameter's value: with its unit, and its name if the unit is ambiguous.
pub(super) fn spoken_value(name: &str, value: &Swept) -> String {
    let text = match value {
        Swept::Number(value) => short(*value),
        Swept::Word(word) => return word.clone(),
    };
    match name {
        "lux" => format!("{text}\u{a0}lx"),
        "exposure_s" => match value.number() {
            Some(s) if s < 1.0 => amount(1e3 * s, None, "ms"),
            _ => format!("{text}\u{a0}s"),
        },
        "lens.f_number" => format!("f/{text}"),
        "sensor.pitch_um" => format!("{text}\u{a0}µm"),
        other => match spoken(other).split_once(", ") {
            Some((words, unit)) => format!("{words} {text}\u{a0}{unit}"),
            None => format!("{} {text}", spoken(other)),
        },
    }
}

/// A swept number as it was written, where that is short.
pub(super) fn short(value: f64) -> String {
    let text = value.to_string();
    if text.len() <= 6 { text } else { number(value) }
}

/// Where a rising curve in dB against lx reaches the acceptable SNR, or text why nowhere. Between
/// two points the SNR is taken as linear in the logarithm of the illuminance.
pub(super) fn crossing(points: &[[f64; 2]]) -> Result<f64, String> {
    let (Some(first), Some(last)) = (points.first(), points.last()) else {
        return Err(String::new());
    };
    if first[1] >= ACCEPTABLE_DB {
        return Err(format!("below {}", short(first[0])));
    }
    let pair = points.windows(2).find(|pair| pair[1][1] >= ACCEPTABLE_DB);
    let Some([[a, low], [b, high]]) = pair else {
        return Err(format!("above {}", short(last[0])));
    };
    let t = (ACCEPTABLE_DB - low) / (high - low);
    Ok(a * libm::exp(t * libm::log(b / a)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn crossings_outside_the_sweep_are_told_as_limits() {
        assert_eq!(crossing(&[[1.0, 25.0], [10.0, 30.0]]), Err("below 1".into()));
        assert_eq!(crossing(&[[1.0, 5.0], [10.0, 15.0]]), Err("above 10".into()));
        let middle = crossing(&[[1.0, 10.0], [100.0, 30.0]]).unwrap();
        assert!((middle - 10.0).abs() < 1e-12);
    }

    #[test]
    fn several_pictures_of_a_setting_are_averaged() {
        let record = |snr: f64, lux: f64| {
            json!({
                "parameters": { "scene": "uniform", "lux": lux, "camera_keys": {} },
                "channels": { "g": { "snr_db": { "value": snr } } },
            })
        };
        let settings = Settings::new(&[record(10.0, 1.0), record(12.0, 1.0), record(30.0, 2.0)]);
        let snr = Figure::of(SNR).unwrap();
        let mean = settings.all[0].mean(snr).unwrap();
        assert!(
            (mean.value - 11.0).abs() < 1e-12 && (mean.std_error.unwrap() - 1.0).abs() < 1e-12
        );
        assert_eq!(settings.all[1].mean(snr).unwrap().std_error, None);
        let light = Figure::of(LIGHT).unwrap();
        let light = settings.without_light().all[0].mean(light).unwrap().value;
        assert!((light - libm::exp2(9.0 / 19.0)).abs() < 1e-12, "{light}");
    }

    #[test]
    fn one_picture_of_an_edge_has_its_own_error() {
        let edge =
            |v: f64, e: f64| json!({ "mtf50_cycles_per_pixel": { "value": v, "std_error": e } });
        let record = json!({
            "parameters": { "scene": "slanted-edge", "camera_keys": { "sensor.pitch_um": 2.0 } },
            "channels": { "r": edge(0.2, 0.03), "g": edge(0.4, 0.04) },
        });
        let settings = Settings::new(std::slice::from_ref(&record));
        let mean = settings.all[0].mean(Figure::of(PER_MM).unwrap()).unwrap();
        assert!(
            (mean.value - 150.0).abs() < 1e-9 && (mean.std_error.unwrap() - 12.5).abs() < 1e-9
        );
        // Two pictures that agree by chance do not know better than √2.
        let settings = Settings::new(&[record.clone(), record]);
        let mean = settings.all[0].mean(Figure::of(PER_MM).unwrap()).unwrap();
        assert!((mean.std_error.unwrap() - 12.5 / 2f64.sqrt()).abs() < 1e-9, "{mean:?}");
    }
}
