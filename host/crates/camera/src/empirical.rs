//! `[[effect]] kind = "empirical"`: a shape that no other effect has, with its table in a file of
//! its own next to the camera file.

mod table;
mod words;

pub use table::{Along, Curve, Law, Map, Noise, Response, Seam, Sine, Step, Table, Term, Wave};
pub(crate) use words::WORDS;
pub use words::Word;

use super::parameter::number;
use super::{Camera, Folder};
use camrig_base::{Error, Result, mistakes, toml_text};
use camrig_sensor_core::effects::empirical::{self as core, Quantity, Shape};
use camrig_sensor_core::effects::{Effect, MAX_TABLE, Parameter};
use std::cell::RefCell;

/// Name of the kind in camera files.
pub const KIND: &str = "empirical";
/// Longest file of a table, bytes: a thousand numbers with their remarks.
const MAX_FILE_BYTES: u64 = 256 * 1024;

const fn parameter(
    key: &'static str,
    unit: &'static str,
    doc: &'static str,
    (min, max): (f32, f32),
    default: f32,
) -> Parameter {
    Parameter { key, unit, doc, min, max, default: Some(default) }
}

/// Limits of an amount, in its unit.
const AMOUNT_LIMITS: (f32, f32) = (-1e6, 1e6);
const ON_SIGNAL: Parameter = parameter(
    "on_signal",
    "1",
    "Exponent of the signal, of temporal noise common to rows or columns",
    (0.0, 4.0),
    0.0,
);
const SIGNAL_E: Parameter = parameter(
    "signal_e",
    "e-",
    "Signal at which such noise has its amount",
    (1.0, 524_287.0),
    1.0,
);
const DOUBLING_C: Parameter = parameter(
    "doubling_c",
    "K",
    "Temperature rise that doubles a dark current",
    (1.0, 100.0),
    7.0,
);
const REFERENCE_C: Parameter = parameter(
    "reference_c",
    "degC",
    "Reference temperature of a dark current",
    (-100.0, 150.0),
    25.0,
);
const EVIDENCE: Parameter = parameter(
    "evidence",
    "1",
    "Twice the gain in log-likelihood with which it was found; for people",
    (0.0, f32::MAX),
    0.0,
);

/// What tables are multiplied by: each domain has one of them.
const AMOUNTS: &[Parameter] = &[
    parameter(
        "amount_e",
        "e-",
        "What the table is multiplied by: offset, temporal",
        AMOUNT_LIMITS,
        1.0,
    ),
    parameter("amount", "1", "The same of a gain or a response", AMOUNT_LIMITS, 1.0),
    parameter("amount_e_per_s", "e-/s", "The same of a dark current", AMOUNT_LIMITS, 1.0),
];

/// The numbers that a camera file may give.
pub(crate) const PARAMETERS: &[Parameter] =
    &[AMOUNTS[0], AMOUNTS[1], AMOUNTS[2], ON_SIGNAL, SIGNAL_E, DOUBLING_C, REFERENCE_C, EVIDENCE];

/// An empirical effect: its `[[effect]]` table and the numbers of its file.
#[derive(Clone, Debug, PartialEq)]
pub struct Empirical {
    /// What of the sensor it changes.
    pub quantity: Quantity,
    /// How it lies over the frame or the signal.
    pub table: Table,
    /// What the table's values are multiplied by, in the unit of the quantity.
    pub amount: f64,
    /// Exponent on the signal, and the signal, e⁻, of temporal noise common to lines.
    pub on_signal: (f64, f64),
    /// Temperature rise that doubles a dark current, K, and its reference temperature, °C.
    pub temperature: (f64, f64),
    /// Twice the gain in log-likelihood with which it was found.
    pub evidence: Option<f64>,
    /// In words.
    pub description: Option<String>,
}

impl Empirical {
    /// One that depends on neither signal nor temperature.
    pub fn new(quantity: Quantity, table: Table, amount: f64) -> Self {
        let of = |p: Parameter| f64::from(p.default.unwrap_or_default());
        Self {
            quantity,
            table,
            amount,
            on_signal: (of(ON_SIGNAL), of(SIGNAL_E)),
            temperature: (of(DOUBLING_C), of(REFERENCE_C)),
            evidence: None,
            description: None,
        }
    }

    /// Reads an `[[effect]]` table and the file that it names.
    ///
    /// # Errors
    /// Everything that is wrong with either, at once.
    pub(crate) fn read(table: &toml::Table, folder: &Folder<'_>) -> Result<Self> {
        let file = File { table, wrong: RefCell::default() };
        file.check_keys();
        let quantity = file.kept(words::quantity(table));
        let shape = file.kept(words::shape(table));
        let shown = shape.and_then(|shape| file.kept(Table::read(table, shape, folder)));
        let amount = file.amount(quantity);
        let on_signal = (file.number(&ON_SIGNAL), file.number(&SIGNAL_E));
        let temperature = (file.number(&DOUBLING_C), file.number(&REFERENCE_C));
        let evidence = table.contains_key(EVIDENCE.key).then(|| file.number(&EVIDENCE));
        if let (Some(quantity), Some(shape)) = (quantity, shape) {
            file.check_shape(quantity, shape);
        }
        let description = table.get("description").and_then(toml::Value::as_str);
        let description = description.map(str::to_string);
        match (quantity, shown, file.wrong.take()) {
            (Some(quantity), Some(table), wrong) if wrong.is_empty() => {
                Ok(Self { quantity, table, amount, on_signal, temperature, evidence, description })
            }
            (.., wrong) => Err(mistakes::all(wrong)),
        }
    }

    /// The keys of its `[[effect]]` table, in TOML; its table of numbers is in `file`.
    pub fn to_toml(&self, file: &str) -> String {
        let defaults = Self::new(self.quantity, Table::RowFlat, 1.0);
        let mut out = toml::Table::new();
        let mut put = |key: &str, value: toml::Value| out.insert(key.to_string(), value);
        put("kind", KIND.into());
        put("domain", words::of_quantity(self.quantity).into());
        put("shape", words::of_shape(self.table.shape()).into());
        put(words::amount(self.quantity), toml_text::seven_figures(self.amount).into());
        if self.table.has_file() {
            put("table", file.into());
        }
        if self.on_signal != defaults.on_signal {
            put(ON_SIGNAL.key, toml_text::seven_figures(self.on_signal.0).into());
            put(SIGNAL_E.key, toml_text::seven_figures(self.on_signal.1).into());
        }
        if self.quantity == Quantity::Dark {
            put(DOUBLING_C.key, toml_text::seven_figures(self.temperature.0).into());
            put(REFERENCE_C.key, toml_text::seven_figures(self.temperature.1).into());
        }
        if let Some(evidence) = self.evidence {
            put(EVIDENCE.key, toml_text::seven_figures(evidence).into());
        }
        if let Some(description) = &self.description {
            put("description", description.as_str().into());
        }
        out.to_string()
    }

    /// Its words in the table of a sensor that starts with a frame: their number, then themselves.
    fn words(&self, first_frame: u32) -> Vec<f32> {
        let words = self.table.words(first_frame);
        std::iter::once(words.len() as f32).chain(words).collect()
    }

    /// As a stage whose words begin at `start`.
    fn stage(&self, start: usize) -> Effect {
        let index = |i: Option<usize>| i.unwrap_or_default() as f32;
        core::Empirical {
            quantity: index(Quantity::ALL.iter().position(|q| *q == self.quantity)),
            shape: index(Shape::ALL.iter().position(|s| *s == self.table.shape())),
            amount: self.amount as f32,
            on_signal: self.on_signal.0 as f32,
            signal_e: self.on_signal.1 as f32,
            doubling_c: self.temperature.0 as f32,
            reference_c: self.temperature.1 as f32,
            start: start as f32,
        }
        .into()
    }
}

/// An `[[effect]]` table, with what is wrong with it.
struct File<'a> {
    table: &'a toml::Table,
    wrong: RefCell<Vec<Error>>,
}

impl File<'_> {
    fn report(&self, what: String, help: String) {
        self.wrong.borrow_mut().push(Error::input(what).help(help));
    }

    fn kept<T>(&self, read: Result<T>) -> Option<T> {
        read.map_err(|e| self.wrong.borrow_mut().push(e)).ok()
    }

    fn number(&self, p: &Parameter) -> f64 {
        self.kept(number(self.table, KIND, p)).unwrap_or_default().into()
    }

    fn check_keys(&self) {
        let known = ["kind"].into_iter().chain(WORDS.iter().map(|w| w.key));
        let known: Vec<&str> = known.chain(PARAMETERS.iter().map(|p| p.key)).collect();
        for key in self.table.keys().filter(|k| !known.contains(&k.as_str())) {
            let help = toml_text::did_you_mean(key, &known);
            self.report(format!("unknown key {key:?} of {KIND:?}"), help);
        }
    }

    /// The amount of a domain; that of another is a mistake.
    fn amount(&self, quantity: Option<Quantity>) -> f64 {
        let Some(own) = quantity.map(words::amount) else { return 1.0 };
        let mut amount = 1.0;
        for p in AMOUNTS {
            if p.key == own {
                amount = self.number(p);
            } else if self.table.contains_key(p.key) {
                let help = format!("the amount of this domain is {own}");
                self.report(format!("key {:?} means nothing here", p.key), help);
            }
        }
        amount
    }

    /// Checks that the domain has the shape, and the shape the keys that are given.
    fn check_shape(&self, quantity: Quantity, shape: Shape) {
        let of = words::of_shape(shape);
        if !shape.suits(quantity) {
            let suit = Shape::ALL.into_iter().filter(|s| s.suits(quantity)).map(words::of_shape);
            let suit: Vec<&str> = suit.collect();
            let what = format!("domain {:?} has no {of:?}", words::of_quantity(quantity));
            self.report(what, format!("its shapes: {}", suit.join(", ")));
        }
        let lines = quantity == Quantity::Temporal && words::is_of_lines(shape);
        let dark = quantity == Quantity::Dark;
        let foreign = [
            (ON_SIGNAL.key, lines, "only noise common to rows or columns grows with the signal"),
            (SIGNAL_E.key, lines, "only noise common to rows or columns grows with the signal"),
            (DOUBLING_C.key, dark, "only dark current grows with the temperature"),
            (REFERENCE_C.key, dark, "only dark current grows with the temperature"),
        ];
        for (key, _, why) in foreign.iter().filter(|f| !f.1 && self.table.contains_key(f.0)) {
            self.report(format!("key {key:?} means nothing here"), (*why).to_string());
        }
    }
}

impl Camera {
    /// The tables of the gains and of all empirical effects, as the sensor takes them.
    pub fn table(&self) -> Vec<f32> {
        let gains = self.sensor.gains.iter().flat_map(super::Gains::words);
        gains.chain(self.empirical.iter().flat_map(|e| e.words(self.first_frame))).collect()
    }

    /// Adds an empirical effect's table to the camera, and returns its stage for
    /// [`Camera::effects`].
    ///
    /// # Errors
    /// Tables that are together longer than a sensor holds.
    pub fn keep(&mut self, effect: Empirical) -> Result<Effect> {
        let start = self.table().len();
        let stage = effect.stage(start);
        let words = start + effect.words(0).len();
        if words > MAX_TABLE {
            let error = Error::limit(format!("tables of effects with {words} numbers"));
            return Err(error.help(format!("use {MAX_TABLE} in all: fewer knots or effects")));
        }
        self.empirical.push(effect);
        Ok(stage)
    }

    /// Whether an effect depends on the frames since the sensor's start.
    pub fn changes_after_its_start(&self) -> bool {
        self.empirical.iter().any(|e| e.table.shape() == Shape::FrameCurve)
    }

    /// What a stage of the chain was made of, if it is an empirical one.
    pub fn empirical_of(&self, stage: &Effect) -> Option<&Empirical> {
        let Effect::Empirical(e) = stage else { return None };
        let mut start = self.sensor.gains.as_ref().map_or(0, |gains| gains.words().len());
        self.empirical.iter().find(|own| {
            let here = start == e.start as usize;
            start += own.words(0).len();
            here
        })
    }
}
