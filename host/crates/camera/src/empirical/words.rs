//! The words of an empirical effect in a camera file.

use camrig_base::{Error, Result, toml_text};
use camrig_sensor_core::effects::empirical::{Quantity, Shape};

/// A key of an effect that holds a word or a text.
#[derive(Clone, Copy, Debug)]
pub struct Word {
    /// Key in a camera file.
    pub key: &'static str,
    /// What it is.
    pub doc: &'static str,
    /// The words that it may be; empty where it may be any text.
    pub values: &'static [&'static str],
    /// Whether it must be given.
    pub required: bool,
}

const DOMAINS: [&str; 5] = ["offset", "gain", "dark", "temporal", "response"];
const SHAPES: [&str; 11] = [
    "row-flat",
    "column-flat",
    "row-profile",
    "column-profile",
    "seam",
    "wave",
    "map",
    "distribution",
    "correlation",
    "signal-curve",
    "frame-curve",
];

/// The words of the kind, in their order.
pub(crate) const WORDS: &[Word] = &[
    Word { key: "domain", doc: "What of the sensor it changes", values: &DOMAINS, required: true },
    Word { key: "shape", doc: "How it lies over the frame", values: &SHAPES, required: true },
    Word {
        key: "table",
        doc: "File of the table (TOML), relative to the camera file; none of a flat shape",
        values: &[],
        required: false,
    },
    Word { key: "description", doc: "In words, for people", values: &[], required: false },
];

/// The word of a domain.
pub(super) fn of_quantity(quantity: Quantity) -> &'static str {
    DOMAINS[Quantity::ALL.iter().position(|q| *q == quantity).unwrap_or_default()]
}

/// The word of a shape.
pub(super) fn of_shape(shape: Shape) -> &'static str {
    SHAPES[Shape::ALL.iter().position(|s| *s == shape).unwrap_or_default()]
}

/// The key of a domain's amount.
pub(super) fn amount(quantity: Quantity) -> &'static str {
    match quantity {
        Quantity::Offset | Quantity::Temporal => "amount_e",
        Quantity::Gain | Quantity::Response => "amount",
        Quantity::Dark => "amount_e_per_s",
    }
}

/// Whether a shape is common to rows or columns.
pub(super) fn is_of_lines(shape: Shape) -> bool {
    use Shape::{ColumnFlat, ColumnProfile, RowFlat, RowProfile};
    matches!(shape, RowFlat | ColumnFlat | RowProfile | ColumnProfile)
}

fn word<'a>(table: &'a toml::Table, key: &str, known: &[&str]) -> Result<(&'a str, usize)> {
    let word = table.get(key).and_then(toml::Value::as_str).ok_or_else(|| {
        Error::input(format!("key {key:?} is missing or no text"))
            .help(format!("known: {}", known.join(", ")))
    })?;
    let at = known.iter().position(|k| *k == word).ok_or_else(|| {
        Error::input(format!("{key} = {word:?}")).help(toml_text::did_you_mean(word, known))
    })?;
    Ok((word, at))
}

/// The domain of an `[[effect]]`.
pub(super) fn quantity(table: &toml::Table) -> Result<Quantity> {
    Ok(Quantity::ALL[word(table, "domain", &DOMAINS)?.1])
}

/// The shape of an `[[effect]]`.
pub(super) fn shape(table: &toml::Table) -> Result<Shape> {
    Ok(Shape::ALL[word(table, "shape", &SHAPES)?.1])
}
