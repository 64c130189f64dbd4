//! Effects, their parameters and statistics in words, with units.

use crate::emva::capitalised;
use crate::numbers::{amount, spoken_unit};
use camrig_camera::EffectKind;
use camrig_diagnose::report::{EMPIRICAL, Form, Parameter, Step};
use camrig_diagnose::statistics::maps::MapKind;
use camrig_diagnose::statistics::statistic::{Figure, Key, Place, What};

/// Longest name that a text of the catalogue may begin with, letters.
const LONGEST_NAME: usize = 48;

/// An amount of an effect: what it is, and the value with its unit.
pub struct Amount {
    pub name: String,
    pub value: String,
}

fn kind_of(effect: &str) -> Option<EffectKind> {
    EffectKind::all().find(|kind| kind.kind == effect)
}

/// The first paragraph of what the catalogue says of an effect: its name, and the rest.
fn text(effect: &str) -> Option<(String, String)> {
    let doc = kind_of(effect)?.doc;
    let paragraph: Vec<&str> = doc
        .lines()
        .map(str::trim)
        .skip_while(|line| line.is_empty())
        .take_while(|line| !line.is_empty())
        .collect();
    let (name, rest) = paragraph.join(" ").split_once(": ").map(|(a, b)| (a.into(), b.into()))?;
    let name: String = name;
    (name.chars().count() <= LONGEST_NAME).then_some((name, rest))
}

/// Name of an effect of the catalogue: `Amplifier glow`.
pub fn kind(effect: &str) -> String {
    text(effect).map_or_else(|| capitalised(&effect.replace('-', " ")), |t| t.0)
}

/// Name of the effect of a step.
pub fn name(step: &Step) -> String {
    if step.effect != EMPIRICAL {
        return kind(&step.effect);
    }
    let shape = match step.shape {
        Some(Form::Seam) => "a seam",
        Some(Form::Wave) => "a wave",
        Some(Form::RowProfile) => "a profile along rows",
        Some(Form::ColumnProfile) => "a profile along columns",
        Some(Form::RowFlat) => "offsets of rows",
        Some(Form::ColumnFlat) => "offsets of columns",
        Some(Form::Correlation) => "noise that neighbours share",
        Some(Form::Distribution) => "a spread of the pixels",
        Some(Form::SignalStep) => "a step of the response",
        Some(Form::FrameCurve) => "a curve over the frames since the start",
        None => "a shape",
    };
    format!("Not in the catalogue: {shape}")
}

/// What an effect is, in a sentence.
pub fn sentence(step: &Step) -> String {
    if let Some(description) = &step.description {
        return format!("{}.", capitalised(description));
    }
    let rest = text(&step.effect).map_or_else(String::new, |t| t.1);
    let end = rest.find(". ").map_or(rest.len(), |i| i + 1);
    capitalised(&rest[..end])
}

/// The amounts of a step, the main one first.
pub fn amounts(step: &Step) -> Vec<Amount> {
    let known = kind_of(&step.effect).map_or(&[][..], |kind| kind.parameters);
    let mut all = Vec::new();
    for parameter in known {
        if let Some(p) = step.parameters.get(parameter.key) {
            let value = amount(p.value, p.std_error, spoken(parameter.unit));
            all.push(Amount { name: printed(parameter.doc.trim()), value });
        }
    }
    let others = step.parameters.iter().filter(|(key, _)| known.iter().all(|k| k.key != **key));
    all.extend(others.map(|(key, p)| of_key(key, p)));
    all
}

/// A unit of the catalogue in words that follow a number.
fn spoken(unit: &str) -> &str {
    match unit {
        "half width" => "half widths",
        "half height" => "half heights",
        unit => unit,
    }
}

/// An amount of something without an entry in the catalogue: its key ends with its unit.
fn of_key(key: &str, p: &Parameter) -> Amount {
    let units = [("_e_per_s", "e⁻/s"), ("_e", "e⁻"), ("_dn", "DN"), ("_s", "s")];
    let unit = units.into_iter().find_map(|(end, unit)| Some((key.strip_suffix(end)?, unit)));
    let (name, unit) = unit.unwrap_or((key, ""));
    let name = match name {
        "sigma" => "standard deviation".into(),
        name => name.replace('_', " "),
    };
    Amount { name: capitalised(&name), value: amount(p.value, p.std_error, unit) }
}

/// What a map is called, and the unit in which it is shown.
pub fn map(kind: MapKind) -> (&'static str, &'static str) {
    match kind {
        MapKind::Offset => ("offset of the shortest dark", "e⁻"),
        MapKind::DarkCurrent => ("rise of the dark signal", "e⁻/s"),
        MapKind::Gain => ("response to light, relative", "%"),
        MapKind::Curvature => ("response, bright less medium light", "%"),
        MapKind::AfterLight => ("dark after light", "e⁻"),
    }
}

/// Unit of a statistic, or what it is relative to; empty where it is a mere number.
pub fn unit(key: Key) -> String {
    let of_map = match key.0 {
        Place::Map(MapKind::Offset | MapKind::AfterLight) => "DN",
        Place::Map(MapKind::DarkCurrent) => "e⁻/s",
        _ => "",
    };
    match key.1 {
        What::Mean(_) => "DN".into(),
        What::Variance(_) => "DN²".into(),
        What::FrameVariance
        | What::RowVariance
        | What::ColumnVariance
        | What::BlockVariance
        | What::NoiseBlocks => "over that of white noise".into(),
        What::FrameTrend
        | What::RowPeak
        | What::ColumnPeak
        | What::PlanePeak
        | What::RowPatternPeak
        | What::ColumnPatternPeak
        | What::Lattice => "standard deviations".into(),
        What::NoisyPixels | What::High | What::Low => "pixels".into(),
        What::MissingCodes => "codes".into(),
        What::Slope(_)
        | What::Corner(_)
        | What::EveryOtherRow
        | What::EveryOtherColumn
        | What::Checkerboard => of_map.into(),
        What::RowPattern | What::ColumnPattern | What::PixelPattern if of_map.ends_with('s') => {
            "(e⁻/s)²".into()
        }
        What::RowPattern | What::ColumnPattern | What::PixelPattern if !of_map.is_empty() => {
            format!("{of_map}²")
        }
        What::Of(figure) => of_target(figure).into(),
        _ => String::new(),
    }
}

fn of_target(figure: Figure) -> &'static str {
    match figure {
        Figure::Response { .. } => "modulation",
        Figure::EdgeLevel { .. }
        | Figure::Background { .. }
        | Figure::PatchMean { .. }
        | Figure::PatchScatter(_) => "DN",
        _ => "pixels",
    }
}

/// A count as a word at the beginning of a sentence, as far as words are usual.
pub fn number_word(n: usize) -> String {
    const WORDS: [&str; 11] =
        ["No", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine", "Ten"];
    WORDS.get(n).map_or_else(|| n.to_string(), |word| (*word).into())
}

/// A sentence of the diagnosis as pages write it: units and signs of print.
pub fn printed(text: &str) -> String {
    let mut out = String::new();
    for (i, part) in spoken_unit(text).split(" -").enumerate() {
        if i > 0 {
            let minus = part.starts_with(|c: char| c.is_ascii_digit());
            out.push_str(if minus { " −" } else { " -" });
        }
        out.push_str(part);
    }
    out.replace("(-", "(−")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_the_catalogue_has_a_name_in_words() {
        for kind in EffectKind::all() {
            let (name, rest) = text(kind.kind).unwrap_or_else(|| panic!("{}", kind.doc));
            assert!(!name.contains('`') && !rest.is_empty(), "{name}");
        }
        assert_eq!(super::kind("amp-glow"), "Amplifier glow");
    }

    #[test]
    fn sentences_have_the_signs_of_print() {
        let text = printed("mean: -3.1 DN, 4 e-/s in row-wise order (-2.0 standard deviations)");
        assert_eq!(text, "mean: −3.1 DN, 4 e⁻/s in row-wise order (−2.0 standard deviations)");
    }
}
