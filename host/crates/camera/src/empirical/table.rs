//! The table of an empirical effect: a TOML file, one form for each shape.

use super::{MAX_FILE_BYTES, words};
use crate::Folder;
use camrig_base::{Error, Result, mistakes};
use camrig_sensor_core::effects::MAX_TABLE;
use camrig_sensor_core::effects::empirical::Shape;
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// The table of a shape. Values are multiplied by the effect's amount.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Table {
    /// Common to a row, alike along it: no file.
    RowFlat,
    /// Common to a column, alike along it: no file.
    ColumnFlat,
    /// Over columns.
    RowProfile(Curve),
    /// Over rows.
    ColumnProfile(Curve),
    /// Steps between parts of the sensor.
    Seam(Seam),
    /// Plane waves.
    Wave(Wave),
    /// A sum of products.
    Map(Map),
    /// A law over pixels.
    Distribution(Law),
    /// Noise that follows itself.
    Correlation(Noise),
    /// Over the signal.
    SignalCurve(Response),
    /// Over the frames since the sensor's start.
    FrameCurve(Curve),
}

/// A curve over lines or frames: straight between knots, two at one place are a step, alike beyond
/// the ends.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Curve {
    /// Columns, rows or frames of the knots, counted from 0, not falling.
    pub at: Vec<f64>,
    /// The values there.
    pub values: Vec<f64>,
}

/// Steps between parts of the sensor, which add up.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Seam {
    /// The steps.
    pub seam: Vec<Step>,
}

/// So much more from a column and a row on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// First column.
    #[serde(default)]
    pub first_column: u32,
    /// First row.
    #[serde(default)]
    pub first_row: u32,
    /// How much more.
    pub step: f64,
}

/// Stationary plane waves, which add up.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Wave {
    /// The waves.
    pub wave: Vec<Sine>,
}

/// a sin(2π(f_x x + f_y y + φ)).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sine {
    /// Cycles per column, −½ to ½.
    pub cycles_per_column: f64,
    /// Cycles per row, −½ to ½.
    pub cycles_per_row: f64,
    /// Phase at the first pixel, turns.
    #[serde(default)]
    pub phase_turns: f64,
    /// Amplitude.
    pub amplitude: f64,
}

/// A sum of curves over columns times curves over rows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Map {
    /// The products, at most 4; all with as many knots.
    pub term: Vec<Term>,
}

/// A product: knots are equally apart from the first pixel to the last.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Term {
    /// Knots over columns.
    pub columns: Vec<f64>,
    /// Knots over rows.
    pub rows: Vec<f64>,
}

/// A law over pixels by its quantile function.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Law {
    /// Standard normal deviates, not falling.
    pub deviates: Vec<f64>,
    /// The values of the pixels there.
    pub values: Vec<f64>,
}

/// Noise that follows itself, along rows or down columns: by taps, or by a length.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Noise {
    /// Along which lines.
    pub along: Along,
    /// Shares of the white noise of the pixel itself and of up to three before it; they are scaled
    /// to a variance of 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub taps: Option<Vec<f64>>,
    /// Length of the correlation e^(−h/L), pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length: Option<f64>,
}

/// Along which lines noise follows itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Along {
    /// From pixel to pixel of a row.
    Rows,
    /// From row to row of a column.
    Columns,
}

/// How the response deviates from a straight line.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Response {
    /// Signals of the knots, e⁻, not falling; two at one signal are a step.
    pub signal_e: Vec<f64>,
    /// Change of the signal there, e⁻.
    pub change_e: Vec<f64>,
    /// Noise that is added there, standard deviation, e⁻.
    pub noise_e: Vec<f64>,
}

/// Taps of noise, at most.
const MAX_TAPS: usize = 4;
/// Terms of a map, at most, and knots over columns or rows.
const MAX_TERMS: usize = 4;
const MAX_KNOTS: usize = 64;
/// Greatest standard normal deviate that a pixel may have.
const MAX_DEVIATE: f64 = 7.0;

fn parsed<T: DeserializeOwned + JsonSchema>(text: &str) -> Result<T> {
    mistakes::read(text)
}

/// What a table must be, with the keys that it is about.
fn require(wrong: &mut Vec<Error>, holds: bool, what: &str, help: &str) {
    if !holds {
        wrong.push(Error::input(what).help(help));
    }
}

fn knots(wrong: &mut Vec<Error>, key: &str, places: &[f64], others: &[(&str, &[f64])]) {
    let least = "give at least one knot";
    require(wrong, !places.is_empty(), &format!("{key:?} is empty"), least);
    for (other, values) in others {
        let what = format!("{key:?} has {} numbers, {other:?} has {}", places.len(), values.len());
        require(wrong, values.len() == places.len(), &what, "give one for each knot");
    }
    let what = format!("{key:?} falls, or is no number");
    require(wrong, places.is_sorted(), &what, "sort the knots");
}

impl Table {
    /// The table that an `[[effect]]` of this shape names.
    pub(super) fn read(effect: &toml::Table, shape: Shape, folder: &Folder<'_>) -> Result<Self> {
        let name = effect.get("table").and_then(toml::Value::as_str);
        let flat = matches!(shape, Shape::RowFlat | Shape::ColumnFlat);
        let name = match (name, flat) {
            (None, true) if shape == Shape::RowFlat => return Ok(Self::RowFlat),
            (None, true) => return Ok(Self::ColumnFlat),
            (Some(_), true) => {
                return Err(Error::input("key \"table\" means nothing for a flat shape")
                    .help("remove it, or use row-profile or column-profile"));
            }
            (None, false) => {
                let shape = words::of_shape(shape);
                return Err(Error::input("key \"table\" is missing")
                    .help(format!("the file with the table of the {shape}")));
            }
            (Some(name), false) => name,
        };
        let text = folder.read_short(name, MAX_FILE_BYTES)?;
        let table = match shape {
            Shape::RowProfile => parsed(&text).map(Self::RowProfile),
            Shape::ColumnProfile => parsed(&text).map(Self::ColumnProfile),
            Shape::Seam => parsed(&text).map(Self::Seam),
            Shape::Wave => parsed(&text).map(Self::Wave),
            Shape::Map => parsed(&text).map(Self::Map),
            Shape::Distribution => parsed(&text).map(Self::Distribution),
            Shape::Correlation => parsed(&text).map(Self::Correlation),
            Shape::SignalCurve => parsed(&text).map(Self::SignalCurve),
            Shape::FrameCurve => parsed(&text).map(Self::FrameCurve),
            Shape::RowFlat => Ok(Self::RowFlat),
            Shape::ColumnFlat => Ok(Self::ColumnFlat),
        };
        table.and_then(Self::checked).map_err(|e| e.at(name))
    }

    /// Whether it makes sense.
    fn checked(self) -> Result<Self> {
        let mut wrong = Vec::new();
        let w = &mut wrong;
        match &self {
            Self::RowFlat | Self::ColumnFlat => {}
            Self::RowProfile(c) | Self::ColumnProfile(c) | Self::FrameCurve(c) => {
                knots(w, "at", &c.at, &[("values", &c.values)]);
            }
            Self::Seam(s) => require(w, !s.seam.is_empty(), "no [[seam]]", "give at least one"),
            Self::Wave(waves) => {
                require(w, !waves.wave.is_empty(), "no [[wave]]", "give at least one");
                for s in &waves.wave {
                    let cycles = [s.cycles_per_column, s.cycles_per_row];
                    let what = format!("a [[wave]] of {cycles:?} cycles per column and row");
                    let sound = cycles.iter().all(|f| (-0.5..=0.5).contains(f));
                    require(w, sound, &what, "use -0.5 to 0.5: beyond, pixels show another wave");
                }
            }
            Self::Map(map) => map.check(w),
            Self::Distribution(law) => {
                knots(w, "deviates", &law.deviates, &[("values", &law.values)]);
                let sound = law.deviates.iter().all(|z| z.abs() <= MAX_DEVIATE);
                require(w, sound, "a deviate beyond ±7", "no pixel of a sensor is so far out");
            }
            Self::Correlation(noise) => noise.check(w),
            Self::SignalCurve(fit) => {
                let others = [("change_e", &fit.change_e[..]), ("noise_e", &fit.noise_e[..])];
                knots(w, "signal_e", &fit.signal_e, &others);
                let sound = fit.noise_e.iter().all(|s| *s >= 0.0);
                require(w, sound, "a \"noise_e\" below 0", "use standard deviations");
            }
        }
        let numbers = self.words(0);
        let finite = numbers.iter().all(|v| v.is_finite());
        require(w, finite, "a number that is not finite", "use numbers up to 1e38");
        let what = format!("{} numbers", numbers.len());
        let help = format!("use at most {MAX_TABLE} in all tables of a camera");
        require(w, numbers.len() < MAX_TABLE, &what, &help);
        if wrong.is_empty() { Ok(self) } else { Err(mistakes::all(wrong)) }
    }

    /// Its shape.
    pub fn shape(&self) -> Shape {
        match self {
            Self::RowFlat => Shape::RowFlat,
            Self::ColumnFlat => Shape::ColumnFlat,
            Self::RowProfile(_) => Shape::RowProfile,
            Self::ColumnProfile(_) => Shape::ColumnProfile,
            Self::Seam(_) => Shape::Seam,
            Self::Wave(_) => Shape::Wave,
            Self::Map(_) => Shape::Map,
            Self::Distribution(_) => Shape::Distribution,
            Self::Correlation(_) => Shape::Correlation,
            Self::SignalCurve(_) => Shape::SignalCurve,
            Self::FrameCurve(_) => Shape::FrameCurve,
        }
    }

    /// Whether it is in a file.
    pub fn has_file(&self) -> bool {
        !matches!(self, Self::RowFlat | Self::ColumnFlat)
    }

    /// The text of its file.
    ///
    /// # Errors
    /// None that a table could cause.
    pub fn text(&self) -> Result<String> {
        let text = match self {
            Self::RowFlat | Self::ColumnFlat => Ok(String::new()),
            Self::RowProfile(t) | Self::ColumnProfile(t) | Self::FrameCurve(t) => {
                toml::to_string(t)
            }
            Self::Seam(t) => toml::to_string(t),
            Self::Wave(t) => toml::to_string(t),
            Self::Map(t) => toml::to_string(t),
            Self::Distribution(t) => toml::to_string(t),
            Self::Correlation(t) => toml::to_string(t),
            Self::SignalCurve(t) => toml::to_string(t),
        };
        text.map_err(|e| Error::internal(format!("the table of an empirical effect: {e}")))
    }

    /// As a sensor takes it that starts with the frame of this number.
    pub(super) fn words(&self, first_frame: u32) -> Vec<f32> {
        let numbers: Vec<f64> = match self {
            Self::RowFlat | Self::ColumnFlat => Vec::new(),
            Self::RowProfile(c) | Self::ColumnProfile(c) => c.words().collect(),
            Self::FrameCurve(c) => {
                let halves = [first_frame >> 16, first_frame & 0xffff].map(f64::from);
                halves.into_iter().chain(c.words()).collect()
            }
            Self::Seam(s) => s.seam.iter().flat_map(Step::words).collect(),
            Self::Wave(w) => w.wave.iter().flat_map(Sine::words).collect(),
            Self::Map(m) => m.words(),
            Self::Distribution(l) => {
                l.deviates.iter().zip(&l.values).flat_map(|(x, y)| [*x, *y]).collect()
            }
            Self::Correlation(n) => {
                let down = f64::from(u8::from(n.along == Along::Columns));
                let long = f64::from(u8::from(n.length.is_some()));
                let values = n.taps.iter().flatten().chain(&n.length);
                [down, long].iter().chain(values).copied().collect()
            }
            Self::SignalCurve(f) => {
                let rest = f.change_e.iter().zip(&f.noise_e);
                f.signal_e.iter().zip(rest).flat_map(|(x, (y, s))| [*x, *y, *s]).collect()
            }
        };
        numbers.into_iter().map(|v| v as f32).collect()
    }
}

impl Curve {
    fn words(&self) -> impl Iterator<Item = f64> {
        self.at.iter().zip(&self.values).flat_map(|(x, y)| [*x, *y])
    }
}

impl Step {
    fn words(&self) -> [f64; 3] {
        [f64::from(self.first_column), f64::from(self.first_row), self.step]
    }
}

impl Sine {
    fn words(&self) -> [f64; 4] {
        let turns = self.phase_turns - self.phase_turns.floor();
        [self.cycles_per_column, self.cycles_per_row, turns, self.amplitude]
    }
}

impl Map {
    fn check(&self, wrong: &mut Vec<Error>) {
        let terms = (1..=MAX_TERMS).contains(&self.term.len());
        require(wrong, terms, &format!("{} [[term]]", self.term.len()), "use 1 to 4");
        let Some(first) = self.term.first() else { return };
        let sizes = |t: &Term| (t.columns.len(), t.rows.len());
        let alike = self.term.iter().all(|t| sizes(t) == sizes(first));
        require(wrong, alike, "terms of unlike sizes", "give all as many knots");
        let (columns, rows) = sizes(first);
        let sound = [columns, rows].iter().all(|n| (1..=MAX_KNOTS).contains(n));
        let what = format!("{columns} knots over columns and {rows} over rows");
        require(wrong, sound, &what, "use 1 to 64 each");
    }

    fn words(&self) -> Vec<f64> {
        let size = self.term.first().map(|t| [t.columns.len() as f64, t.rows.len() as f64]);
        let knots = self.term.iter().flat_map(|t| t.columns.iter().chain(&t.rows).copied());
        size.into_iter().flatten().chain(knots).collect()
    }
}

impl Noise {
    fn check(&self, wrong: &mut Vec<Error>) {
        let one = self.taps.is_some() != self.length.is_some();
        require(wrong, one, "both or neither of \"taps\" and \"length\"", "give one of them");
        if let Some(taps) = &self.taps {
            let sound = (1..=MAX_TAPS).contains(&taps.len()) && taps.iter().any(|t| *t != 0.0);
            require(wrong, sound, "\"taps\"", "use 1 to 4 numbers, not all 0");
        }
        if let Some(length) = &self.length {
            let sound = (0.1..=1e4).contains(length);
            require(wrong, sound, &format!("length = {length}"), "use 0.1 to 10000 pixels");
        }
    }
}
