//! The page of a sweep's figures: where they are best, and what more of one costs of another.
//!
//! A *setting* is what a picture was taken with, but for its scene and frame number; pictures of
//! one setting are averaged, with the standard error of their mean. Colour channels are averaged
//! too where a figure is compared, as a setting is chosen for all of them. Where the light was
//! swept, settings are compared by the light at which their SNR is 10.

mod compare;
mod light;
mod table;

use super::numbers::{NOT_DETERMINED, counted, number};
use super::page::{KeyFigure, Page, Table};
use compare::comparison;
use light::light;
use serde_json::Value;
use std::collections::BTreeMap;
use table::{FIGURES, Figure, Setting, Settings, spoken};

/// Most lines in a plot, as many as there are colours; with more, those far from the best setting
/// are left out.
const MAX_LINES: usize = 6;
/// Most settings of which print lists each: a sheet of A4.
const MAX_PRINTED: usize = 50;
/// Most bests of single figures on cards.
const MAX_CARDS: usize = 3;

/// How a setting is chosen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Choice {
    /// The figure that is to be best: one that a record has, `snr_10_lux` or
    /// `mtf50_cycles_per_mm`.
    pub best: String,
    /// What figures must reach: the least of those of which more is better, the most of others.
    pub need: BTreeMap<String, f64>,
}

/// A choice with its figures, and what it leads to.
struct Chosen<'a> {
    best: &'static Figure,
    needs: Vec<(&'static Figure, f64)>,
    /// `None` where no setting meets the needs.
    setting: Option<&'a Setting>,
}

impl<'a> Chosen<'a> {
    fn of(choice: &Choice, settings: &'a Settings) -> Option<Self> {
        let best = Figure::of(&choice.best)?;
        let needs =
            choice.need.iter().filter_map(|(key, v)| Some((Figure::of(key)?, *v))).collect();
        let mut chosen = Self { best, needs, setting: None };
        chosen.setting = Settings::best(settings.all.iter().filter(|s| chosen.meets(s)), best);
        Some(chosen)
    }

    fn meets(&self, setting: &Setting) -> bool {
        let met =
            |(f, need): &(&Figure, f64)| setting.mean(f).is_some_and(|m| f.meets(m.value, *need));
        self.needs.iter().all(met)
    }

    /// Text of the condition.
    fn words(&self) -> String {
        let needs = self.needs.iter().map(|(f, need)| {
            let sign = if f.less_is_better == Some(true) { "≤" } else { "≥" };
            format!("{} {sign} {}\u{a0}{}", in_sentence(f.name), number(*need), f.unit)
        });
        let needs: Vec<String> = needs.collect();
        let with = if needs.is_empty() { "" } else { " with " };
        format!("{} {}{with}{}", self.best.wanted(), in_sentence(self.best.name), needs.join(", "))
    }
}

/// A name within a sentence: acronyms keep their capitals.
fn in_sentence(name: &str) -> String {
    let mut letters = name.chars();
    match (letters.next(), letters.next()) {
        (Some(a), Some(b)) if b.is_lowercase() => {
            format!("{}{b}{}", a.to_lowercase(), letters.as_str())
        }
        _ => name.to_owned(),
    }
}

/// The page of a complete sweep from the records of its pictures and the text of its file.
pub fn page(title: &str, records: &[Value], sweep: &str, choice: Option<&Choice>) -> Page {
    let settings = Settings::new(records);
    let compared = settings.without_light();
    let chosen = choice.and_then(|choice| Chosen::of(choice, &compared));
    let mut page = Page::new(title);
    let names: Vec<String> =
        settings.names.iter().map(|n| spoken(n).split(", ").next().unwrap_or(n).into()).collect();
    page.kind("Trade-off").subtitle(&format!(
        "{} of {}: {}",
        counted(records.len(), "picture"),
        counted(settings.all.len(), "setting"),
        names.join(", ")
    ));
    let differ: Vec<&Figure> =
        FIGURES.iter().filter(|figure| compared.differs(figure) == Some(true)).collect();
    let ranked: Vec<&Figure> =
        differ.iter().copied().filter(|f| f.less_is_better.is_some()).collect();
    why_missing(&mut page, records, "MTF50", "mtf50_missing");
    why_missing(&mut page, records, "SNR", "snr_missing");
    optimum(&mut page, &compared, &ranked, chosen.as_ref());
    comparison(&mut page, &compared, &differ, &ranked, chosen.as_ref());
    light(&mut page, &settings, &compared);
    page.heading("Sweep");
    page.folded("Sweep file", |page| {
        page.verbatim(sweep);
    });
    let words = format!("All {} settings (each picture: figures.csv)", compared.all.len());
    match compared.all.len() > MAX_PRINTED {
        true => page.folded_on_screen(&words, |page| all(page, &compared)),
        false => page.folded(&words, |page| all(page, &compared)),
    };
    page
}

/// Most reasons that are told.
const MAX_REASONS: usize = 3;

/// Why pictures have no figure of this name, the most frequent reasons first; `key` is that of the
/// reasons.
fn why_missing(page: &mut Page, records: &[Value], name: &str, key: &str) {
    let mut reasons: BTreeMap<&str, usize> = BTreeMap::new();
    let channels = records.iter().filter_map(|r| r["channels"].as_object());
    for reason in channels.flat_map(|c| c.values()).filter_map(|c| c[key].as_str()) {
        *reasons.entry(reason).or_default() += 1;
    }
    let all: usize = reasons.values().sum();
    if all == 0 {
        return;
    }
    let mut sorted: Vec<(&str, usize)> = reasons.into_iter().collect();
    sorted.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let told =
        sorted.iter().take(MAX_REASONS).map(|(reason, count)| format!("{reason} ({count})"));
    let told: Vec<String> = told.collect();
    let more = if sorted.len() > MAX_REASONS { "; the others are in figures.csv" } else { "" };
    page.note(&format!(
        "{name} is not determined in {}: {}{more}.",
        counted(all, "channel"),
        told.join("; ")
    ));
}

/// Cards: the optimum with the condition it was chosen by, and where single figures are best.
fn optimum(page: &mut Page, settings: &Settings, ranked: &[&Figure], chosen: Option<&Chosen<'_>>) {
    let mut cards = Vec::new();
    if let Some(chosen) = chosen {
        match chosen.setting {
            Some(setting) => {
                let of = std::iter::once(chosen.best).chain(chosen.needs.iter().map(|n| n.0));
                let values: Vec<String> =
                    of.filter_map(|f| Some(format!("{} {}", f.name, setting.words(f)?))).collect();
                let name = format!("Optimum: {}", chosen.words());
                let card = KeyFigure::new(&name, &settings.words(setting, &[]));
                cards.push(card.below(&values.join(" · ")).picked());
            }
            None => {
                page.note(&format!("No setting meets the need: {}.", chosen.words()));
            }
        }
    }
    let others = ranked.iter().filter(|f| chosen.is_none_or(|c| c.best.key != f.key));
    for figure in others.take(MAX_CARDS) {
        let Some(best) = Settings::best(settings.all.iter(), figure) else { continue };
        let name = format!("{} {}", capital(figure.wanted()), in_sentence(figure.name));
        let card = KeyFigure::new(&name, &best.words(figure).unwrap_or_default());
        cards.push(card.below(&settings.words(best, &[])));
    }
    if !cards.is_empty() {
        page.key_figures(&cards);
    }
    let same = FIGURES.iter().filter(|f| settings.differs(f) == Some(false));
    let same: Vec<String> =
        same.filter_map(|f| Some(format!("{} {}", f.name, settings.all[0].words(f)?))).collect();
    if !same.is_empty() {
        page.small(&format!("The same everywhere: {}.", same.join("; ")));
    }
}

fn capital(word: &str) -> String {
    let mut letters = word.chars();
    letters.next().map_or_else(String::new, |c| c.to_uppercase().chain(letters).collect())
}

fn texts(all: &[String]) -> Vec<&str> {
    all.iter().map(String::as_str).collect()
}

/// All settings with all their figures. One column has the whole setting, so that the table stays
/// narrow whatever was swept.
fn all(page: &mut Page, settings: &Settings) {
    let has = |f: &&Figure| settings.all.iter().any(|s| s.mean(f).is_some());
    let figures: Vec<&Figure> = FIGURES.iter().filter(has).collect();
    let heads: Vec<String> = figures.iter().map(|f| f.words()).collect();
    let mut table = Table::new(&["setting"]).numbers(&texts(&heads));
    for setting in &settings.all {
        let figures = figures.iter().map(|f| {
            let unitless = Figure { unit: "", ..**f };
            setting.words(&unitless).unwrap_or_else(|| NOT_DETERMINED.into())
        });
        table.row(std::iter::once(settings.words(setting, &[])).chain(figures).collect());
    }
    page.rows(&table);
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
                    let mut green = json!({ "mean_dn": { "value": 100.0 } });
                    green[key] = json!({ "value": value });
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
        let html = page("sweep", &records(), "[grid]", None).html();
        for words in [
            "12 pictures of 6 settings: f-number, scene illuminance",
            "SNR against scene illuminance",
            "Light for SNR 10 against f-number",
            "MTF50 against f-number",
            "Least light for SNR 10",
            "MTF50 against light for SNR 10",
            "[grid]",
        ] {
            assert!(html.contains(words), "{words}: {html}");
        }
        // 20 dB lie between 15 dB at 10 lx and 25 dB at 100 lx: 10^1.5 lx; and 10^1.8 lx.
        assert!(html.contains("31.6\u{a0}lx") && html.contains("63.1"), "{html}");
        // Values that are the same everywhere are no axis.
        assert!(!html.contains("against exposure"), "{html}");
    }

    #[test]
    fn a_choice_names_its_condition_and_is_refused_where_nothing_meets_it() {
        let choice = |need: f64| Choice {
            best: "snr_10_lux".into(),
            need: [("mtf50_cycles_per_pixel".to_owned(), need)].into(),
        };
        let html = page("sweep", &records(), "", Some(&choice(0.25))).html();
        let words = "Optimum: least light for SNR 10 with MTF50 ≥ 0.250\u{a0}cycles/pixel";
        assert!(html.contains(words) && html.contains(">f/4</b>"), "{html}");
        let html = page("sweep", &records(), "", Some(&choice(0.35))).html();
        assert!(html.contains("No setting meets the need: least light"), "{html}");
    }
}
