//! The page of a sweep's figures: each figure over what was swept, and where it is best.
//!
//! A *setting* is what a picture was taken with, but for its scene and frame number; pictures of
//! one setting are averaged, with the standard error of their mean. Colour channels are averaged
//! too where a figure is compared, as a setting is chosen for all of them.

use super::numbers::{amount, number};
use super::page::Page;
use super::plot::{Colour, Mark, Plot};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// A figure that a sweep may have.
struct Figure {
    /// Its key in a record.
    key: &'static str,
    /// Its name and unit for people.
    name: &'static str,
    unit: &'static str,
    /// Whether less is better; `None` where neither is.
    less_is_better: Option<bool>,
}

/// A figure that no record has: it follows from MTF50 per pixel where the pitch was swept.
const PER_MM: &str = "mtf50_cycles_per_mm";

const FIGURES: [Figure; 7] = [
    Figure { key: "snr_db", name: "SNR", unit: "dB", less_is_better: Some(false) },
    Figure {
        key: "dynamic_range_db",
        name: "Dynamic range",
        unit: "dB",
        less_is_better: Some(false),
    },
    Figure {
        key: PER_MM,
        name: "MTF50 on the sensor",
        unit: "cycles/mm",
        less_is_better: Some(false),
    },
    Figure {
        key: "mtf50_cycles_per_pixel",
        name: "MTF50",
        unit: "cycles/pixel",
        less_is_better: Some(false),
    },
    Figure { key: "delta_e_2000", name: "ΔE2000, mean", unit: "", less_is_better: Some(true) },
    Figure { key: "mean_dn", name: "Mean", unit: "DN", less_is_better: None },
    Figure { key: "saturated_fraction", name: "Saturated share", unit: "", less_is_better: None },
];

/// SNR of 10, dB: the least with which ISO 12232 calls a picture acceptable.
const ACCEPTABLE_DB: f64 = 20.0;
/// Most lines in a plot, as many as there are colours; with more, those far from the best setting
/// are left out.
const MOST_LINES: usize = 6;
/// Most rows and columns of a table of two parameters.
const MOST_CELLS: usize = 12;
/// Ratio of the largest to the smallest value from which an axis is logarithmic.
const DECADE: f64 = 10.0;

/// A value that was swept.
#[derive(Clone, Debug, PartialEq)]
enum Swept {
    Number(f64),
    Word(String),
}

impl Swept {
    fn text(&self) -> String {
        match self {
            Self::Number(value) => value.to_string(),
            Self::Word(word) => word.clone(),
        }
    }

    fn number(&self) -> Option<f64> {
        match self {
            Self::Number(value) => Some(*value),
            Self::Word(_) => None,
        }
    }
}

/// Pictures of one setting.
struct Setting {
    values: Vec<Swept>,
    /// Of each figure, the values of its pictures, each a mean over the channels.
    figures: BTreeMap<&'static str, Vec<f64>>,
}

impl Setting {
    /// Mean of a figure and, of two pictures or more, its standard error.
    fn mean(&self, figure: &Figure) -> Option<(f64, Option<f64>)> {
        let values = self.figures.get(figure.key).filter(|values| !values.is_empty())?;
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let square: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        Some((mean, (n > 1.0).then(|| (square / (n - 1.0) / n).sqrt())))
    }
}

/// A sweep's figures by what was swept.
struct Table {
    /// Names of what was swept.
    names: Vec<String>,
    settings: Vec<Setting>,
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
fn figure_of(record: &Value, figure: &Figure) -> Option<f64> {
    if let Some(value) = record["figures"][figure.key]["mean"].as_f64() {
        return Some(value);
    }
    let pitch_um = record["parameters"]["camera_keys"]["sensor.pitch_um"].as_f64();
    let (key, factor) = match figure.key {
        PER_MM => ("mtf50_cycles_per_pixel", 1e3 / pitch_um?),
        key => (key, 1.0),
    };
    let channels = record["channels"].as_object()?;
    let values: Vec<f64> = channels.values().filter_map(|channel| channel[key].as_f64()).collect();
    (!values.is_empty()).then(|| factor * values.iter().sum::<f64>() / values.len() as f64)
}

impl Table {
    fn new(records: &[Value]) -> Self {
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
        Self { names, settings }
    }

    /// Whether a figure differs between settings; `None` where none has it.
    fn differs(&self, figure: &Figure) -> Option<bool> {
        let mut means = self.settings.iter().filter_map(|s| s.mean(figure));
        let (first, _) = means.next()?;
        Some(means.any(|(mean, _)| mean != first))
    }

    /// The setting where a figure is best.
    fn best(&self, figure: &Figure) -> Option<(&Setting, f64, Option<f64>)> {
        let sign = if figure.less_is_better? { -1.0 } else { 1.0 };
        let with = self.settings.iter().filter_map(|s| s.mean(figure).map(|(m, e)| (s, m, e)));
        with.max_by(|a, b| (sign * a.1).total_cmp(&(sign * b.1)))
    }

    /// The different values of a parameter, numbers in order, if all are numbers.
    fn numbers(&self, index: usize) -> Option<Vec<f64>> {
        let mut all = Vec::new();
        for setting in &self.settings {
            let value = setting.values[index].number()?;
            if !all.contains(&value) {
                all.push(value);
            }
        }
        all.sort_by(f64::total_cmp);
        (all.len() > 1).then_some(all)
    }

    /// A setting in words, without the parameters that are left out.
    fn words(&self, setting: &Setting, without: &[usize]) -> String {
        let named = self.names.iter().zip(&setting.values).enumerate();
        let words = named
            .filter(|(i, _)| !without.contains(i))
            .map(|(_, (name, value))| format!("{} {}", spoken(name), value.text()));
        words.collect::<Vec<_>>().join(", ")
    }

    /// Lines of a figure over a parameter: one for each setting of the others.
    fn lines(&self, figure: &Figure, over: usize) -> Vec<Line<'_>> {
        let mut lines: Vec<Line<'_>> = Vec::new();
        for setting in &self.settings {
            let (Some((mean, _)), Some(x)) = (setting.mean(figure), setting.values[over].number())
            else {
                continue;
            };
            let same = |line: &Line<'_>| {
                let pairs = line.of.values.iter().zip(&setting.values).enumerate();
                pairs.filter(|(i, _)| *i != over).all(|(_, (a, b))| a == b)
            };
            match lines.iter_mut().find(|line| same(line)) {
                Some(line) => line.points.push([x, mean]),
                None => lines.push(Line { of: setting, points: vec![[x, mean]] }),
            }
        }
        lines.iter_mut().for_each(|l| l.points.sort_by(|a, b| a[0].total_cmp(&b[0])));
        lines
    }
}

/// A figure over one parameter, with the others as in one of its settings.
struct Line<'a> {
    of: &'a Setting,
    points: Vec<[f64; 2]>,
}

/// A parameter's name for people.
fn spoken(name: &str) -> String {
    match name {
        "lux" => "illuminance, lx".into(),
        "exposure_s" => "exposure, s".into(),
        "analog_gain" => "analog gain".into(),
        "lens.f_number" => "f-number".into(),
        "sensor.pitch_um" => "pixel pitch, µm".into(),
        other => other.rsplit('.').next().unwrap_or(other).replace('_', " "),
    }
}

/// The page of a complete sweep from the records of its pictures.
pub fn page(title: &str, records: &[Value]) -> Page {
    let table = Table::new(records);
    let mut page = Page::new(title);
    page.kind("Trade-off");
    page.paragraph(&format!(
        "{} pictures of {} settings. Swept: {}.",
        records.len(),
        table.settings.len(),
        table.names.iter().map(|name| spoken(name)).collect::<Vec<_>>().join("; ")
    ));
    best(&mut page, &table);
    let differ = FIGURES.iter().filter(|figure| table.differs(figure) == Some(true));
    let figures: Vec<&Figure> = differ.collect();
    for figure in &figures {
        page.heading(figure.name).grid(|page| {
            for over in 0..table.names.len() {
                if let Some(values) = table.numbers(over) {
                    draw(page, &table, figure, over, &values);
                }
            }
        });
        grid(&mut page, &table, figure);
        if figure.key == "snr_db" {
            acceptable(&mut page, &table, figure);
        }
    }
    frontier(&mut page, &table, &figures);
    page
}

/// Where each figure is best, or that it is the same everywhere.
fn best(page: &mut Page, table: &Table) {
    let row = |figure: &Figure| {
        let differs = table.differs(figure)?;
        let (setting, mean, error) = table.best(figure)?;
        let value = amount(mean, error, figure.unit);
        let wanted = if figure.less_is_better? { "least" } else { "largest" };
        Some(match differs {
            true => {
                vec![figure.name.into(), format!("{wanted}: {value}"), table.words(setting, &[])]
            }
            false => vec![figure.name.into(), value, "everywhere".into()],
        })
    };
    let rows: Vec<Vec<String>> = FIGURES.iter().filter_map(row).collect();
    if !rows.is_empty() {
        page.heading("Best settings");
        page.table(&["figure", "best", "at"], &rows);
    }
}

fn is_wide(values: &[f64]) -> bool {
    match (values.first(), values.last()) {
        (Some(low), Some(high)) => *low > 0.0 && high / low >= DECADE,
        _ => false,
    }
}

/// A figure over a parameter.
fn draw(page: &mut Page, table: &Table, figure: &Figure, over: usize, values: &[f64]) {
    let x = spoken(&table.names[over]);
    let y = format!("{}, {}", figure.name, figure.unit);
    let y = y.trim_end_matches(", ");
    let mut plot = Plot::new(&format!("{} over {x}", figure.name), &x, y);
    if is_wide(values) {
        plot.log_x();
    }
    let mut lines = table.lines(figure, over);
    lines.retain(|line| line.points.len() > 1);
    let all = lines.len();
    let sign = if figure.less_is_better == Some(true) { -1.0 } else { 1.0 };
    let peak = |line: &Line<'_>| {
        line.points.iter().map(|p| sign * p[1]).fold(f64::NEG_INFINITY, f64::max)
    };
    if all > MOST_LINES {
        lines.sort_by(|a, b| peak(b).total_cmp(&peak(a)));
        lines.truncate(MOST_LINES);
    }
    for (i, line) in lines.iter().enumerate() {
        let label = table.words(line.of, &[over]);
        plot.series(&label, Mark::LinePoints, Colour::Series(i), line.points.clone());
    }
    if figure.key == "snr_db" {
        plot.limit_y(ACCEPTABLE_DB, "SNR 10");
    }
    plot.note(&match all > MOST_LINES {
        true => format!("The {MOST_LINES} of {all} other settings with the best values."),
        false => "A line for each setting of what else was swept.".into(),
    });
    if !lines.is_empty() {
        page.plot(&plot);
    }
}

/// A figure over two parameters that were swept alone, its best value marked.
fn grid(page: &mut Page, table: &Table, figure: &Figure) {
    let numeric: Vec<(usize, Vec<f64>)> = (0..table.names.len())
        .filter_map(|i| table.numbers(i).map(|values| (i, values)))
        .collect();
    let [(row, rows), (column, columns)] = &numeric[..] else { return };
    let fits = rows.len() <= MOST_CELLS && columns.len() <= MOST_CELLS;
    if table.names.len() != 2 || !fits {
        return;
    }
    let best = table.best(figure).map(|(setting, ..)| &setting.values);
    let corner = format!("{} \\ {}", spoken(&table.names[*row]), spoken(&table.names[*column]));
    let head: Vec<String> =
        std::iter::once(corner).chain(columns.iter().map(f64::to_string)).collect();
    let cell = |r: f64, c: f64| {
        let at = |s: &&Setting| {
            s.values[*row].number() == Some(r) && s.values[*column].number() == Some(c)
        };
        let Some(setting) = table.settings.iter().find(at) else { return String::new() };
        let Some((mean, _)) = setting.mean(figure) else { return "not determined".into() };
        let mark = if best == Some(&setting.values) { " (best)" } else { "" };
        format!("{}{mark}", number(mean))
    };
    let body: Vec<Vec<String>> = rows
        .iter()
        .map(|&r| {
            std::iter::once(r.to_string()).chain(columns.iter().map(|&c| cell(r, c))).collect()
        })
        .collect();
    page.table(&head.iter().map(|h| &h[..]).collect::<Vec<_>>(), &body);
}

/// The illuminance at which the SNR is 10, between those that were swept.
fn acceptable(page: &mut Page, table: &Table, figure: &Figure) {
    let Some(lux) = table.names.iter().position(|name| name == "lux") else { return };
    let rows: Vec<Vec<String>> = table
        .lines(figure, lux)
        .iter()
        .map(|line| vec![table.words(line.of, &[lux]), crossing(&line.points)])
        .collect();
    page.table(&["setting", "illuminance at which the SNR is 10, lx"], &rows);
}

/// Where a rising curve in dB over lx reaches the acceptable SNR, in words. Between two points the
/// SNR is taken as linear in the logarithm of the illuminance.
fn crossing(points: &[[f64; 2]]) -> String {
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return String::new() };
    if first[1] >= ACCEPTABLE_DB {
        return format!("below {}", first[0]);
    }
    let pair = points.windows(2).find(|pair| pair[1][1] >= ACCEPTABLE_DB);
    let Some([[a, low], [b, high]]) = pair else { return format!("above {}", last[0]) };
    let t = (ACCEPTABLE_DB - low) / (high - low);
    number(a * libm::exp(t * libm::log(b / a)))
}

/// The first two figures of which each has a best, against each other: what more of one costs of
/// the other.
fn frontier(page: &mut Page, table: &Table, figures: &[&Figure]) {
    let mut ranked = figures.iter().filter(|figure| figure.less_is_better.is_some());
    let (Some(x), Some(y)) = (ranked.next(), ranked.next()) else { return };
    let both = |s: &Setting| Some([s.mean(x)?.0, s.mean(y)?.0]);
    let points: Vec<[f64; 2]> = table.settings.iter().filter_map(both).collect();
    let sign = [x, y].map(|f| if f.less_is_better == Some(true) { -1.0 } else { 1.0 });
    let beats = |a: &[f64; 2], b: &[f64; 2]| {
        let ahead = |i: usize| sign[i] * (a[i] - b[i]);
        ahead(0) >= 0.0 && ahead(1) >= 0.0 && ahead(0) + ahead(1) > 0.0
    };
    let mut front: Vec<[f64; 2]> =
        points.iter().filter(|p| !points.iter().any(|other| beats(other, p))).copied().collect();
    if front.len() < 2 {
        return;
    }
    front.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let axis = |f: &Figure| format!("{}, {}", f.name, f.unit);
    let title = format!("{} against {}", y.name, x.name);
    let mut plot =
        Plot::new(&title, axis(x).trim_end_matches(", "), axis(y).trim_end_matches(", "));
    plot.note("Settings on the line are the choice; for others there is a better.");
    plot.series("settings", Mark::Points, Colour::Reference, points);
    plot.series("none is better in both", Mark::Line, Colour::Series(0), front);
    page.heading(&title).plot(&plot);
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// Pictures at two f-numbers and three light levels: SNR rises by 10 dB per decade of light
    /// and is 3 dB lower at the larger f-number; MTF50 is higher there.
    fn records() -> Vec<Value> {
        let mut records = Vec::new();
        for (n, f_number) in [2.8, 4.0].into_iter().enumerate() {
            for (i, lux) in [1.0, 10.0, 100.0].into_iter().enumerate() {
                for (scene, key, value) in [
                    ("uniform", "snr_db", 10.0 * i as f64 + 5.0 - 3.0 * n as f64),
                    ("slanted-edge", "mtf50_cycles_per_pixel", 0.2 + 0.1 * n as f64),
                ] {
                    let mut green = json!({ "mean_dn": 100.0 });
                    green[key] = json!(value);
                    records.push(json!({
                        "parameters": {
                            "camera": "c", "scene": scene, "lux": lux, "frame": 0,
                            "exposure_s": 0.01, "camera_keys": { "lens.f_number": f_number }
                        },
                        "channels": { "g": green },
                    }));
                }
            }
        }
        records
    }

    #[test]
    fn the_page_has_what_was_swept_where_it_is_best_and_the_light_for_snr_10() {
        let html = page("sweep", &records()).html();
        for words in [
            "12 pictures of 6 settings",
            "SNR over illuminance, lx",
            "MTF50 over f-number",
            "largest: 25.0\u{a0}dB",
            "f-number 2.8, illuminance, lx 100",
            "MTF50 against SNR",
        ] {
            assert!(html.contains(words), "{words}: {html}");
        }
        // 20 dB lie between 15 dB at 10 lx and 25 dB at 100 lx: 10^1.5 lx; and 10^1.8 lx.
        assert!(html.contains("31.6") && html.contains("63.1"), "{html}");
        // Values that are the same everywhere are no axis.
        assert!(!html.contains("over exposure"), "{html}");
    }

    #[test]
    fn crossings_outside_the_sweep_are_told_as_limits() {
        assert_eq!(crossing(&[[1.0, 25.0], [10.0, 30.0]]), "below 1");
        assert_eq!(crossing(&[[1.0, 5.0], [10.0, 15.0]]), "above 10");
    }

    #[test]
    fn several_pictures_of_a_setting_are_averaged() {
        let record = |snr: f64, lux: f64| {
            json!({
                "parameters": { "scene": "uniform", "lux": lux, "camera_keys": {} },
                "channels": { "g": { "snr_db": snr } },
            })
        };
        let table = Table::new(&[record(10.0, 1.0), record(12.0, 1.0), record(30.0, 2.0)]);
        let (mean, error) = table.settings[0].mean(&FIGURES[0]).unwrap();
        assert!((mean - 11.0).abs() < 1e-12 && (error.unwrap() - 1.0).abs() < 1e-12);
        assert_eq!(table.settings[1].mean(&FIGURES[0]).unwrap().1, None);
    }
}
