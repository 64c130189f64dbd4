//! Drafts of camera files: every key with its value and what is behind the value.
//!
//! A value is given by whoever makes the file, else it follows from a built-in camera
//! ([`crate::facts`] and the files of [`crate::presets`]), else from a rule of thumb
//! ([`crate::typical`]). [`Draft::text`] is the file, with the basis of each value in a comment.

use super::facts::{Fact, Sensor};
use super::keys::{self, Key};
use super::typical::{self, GREEN_OVER_MONO, rounded};
use super::{Camera, Change, Folder, Value, builtin, efficiency};
use camrig_base::{Error, ErrorCode, Result, mistakes, toml_text};
use std::path::Path;

/// What sort of knowledge a value is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grade {
    /// Given by whoever made the file.
    Given,
    /// Someone's measurement.
    Measured,
    /// The maker's data sheet.
    Datasheet,
    /// A camera maker's page, a table, a program.
    Quoted,
    /// It follows from measured, printed or quoted values.
    Derived,
    /// A rule of thumb, a guess, or a value borrowed from another sensor.
    Typical,
}

impl Grade {
    /// The word in the comment after a value.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Given => "given",
            Self::Measured => "measured",
            Self::Datasheet => "datasheet",
            Self::Quoted => "quoted",
            Self::Derived => "derived",
            Self::Typical => "typical",
        }
    }

    fn of(word: &str) -> Self {
        match word {
            "measured" => Self::Measured,
            "datasheet" => Self::Datasheet,
            "quoted" => Self::Quoted,
            "derived" => Self::Derived,
            _ => Self::Typical,
        }
    }
}

/// What is behind a value.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Basis {
    /// What sort of knowledge it is.
    pub grade: Grade,
    /// Whether the source is known from someone's transcription of it only.
    pub second_hand: bool,
    /// Title and address; empty where there is none.
    pub source: String,
    /// Mode and condition, how the value was derived, or the reason of a rule; of a value with a
    /// standard error, what it was measured on.
    pub note: String,
    /// Standard error of what was measured by whoever made the file.
    pub std_error: Option<f64>,
}

impl Basis {
    /// That of a value measured on some frames, such as `64 frames, gain 1`.
    #[must_use]
    pub fn measured(std_error: f64, frames: &str) -> Self {
        Self { std_error: Some(std_error), ..Self::plain(Grade::Measured, frames) }
    }

    /// That of a value that was stated.
    #[must_use]
    pub fn given(note: &str) -> Self {
        Self::plain(Grade::Given, note)
    }

    /// That of a value that nothing is known about, with the reason for it.
    #[must_use]
    pub fn typical(reason: &str) -> Self {
        Self::plain(Grade::Typical, reason)
    }

    fn of(fact: &Fact) -> Self {
        let known = fact.via != "none";
        let source = if known { fact.source.clone() } else { String::new() };
        let note = [&fact.mode, &fact.condition];
        let note: Vec<&str> = note.into_iter().map(|s| &s[..]).filter(|s| !s.is_empty()).collect();
        let second_hand = fact.via == "second-hand";
        let (grade, note) = (Grade::of(&fact.grade), note.join("; "));
        Self { grade, second_hand, source, note, std_error: None }
    }

    /// That of a value which follows from a fact: what is derived from a typical one is typical.
    fn derived(fact: &Fact, note: String) -> Self {
        let basis = Self::of(fact);
        let typical = basis.grade == Grade::Typical;
        let grade = if typical { Grade::Typical } else { Grade::Derived };
        let told = if basis.note.is_empty() { String::new() } else { format!("; {}", basis.note) };
        Self { grade, note: format!("{note} ({}{told})", fact.grade), ..basis }
    }

    fn plain(grade: Grade, note: &str) -> Self {
        let (source, note) = (String::new(), note.to_string());
        Self { grade, second_hand: false, source, note, std_error: None }
    }
}

/// A key of a camera file with its value.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Entry {
    /// The key.
    pub key: &'static Key,
    /// Its value.
    pub value: Value,
    /// What is behind it.
    pub basis: Basis,
}

/// A camera file that is not written yet.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Draft {
    /// What the camera is, a sentence or more.
    pub about: String,
    /// Keys in the order of a camera file.
    pub entries: Vec<Entry>,
    /// Parameters of effects and columns of `[sensor.gains]`, by their paths.
    pub more: Vec<Known>,
    /// Tables that were made for it: name and text.
    pub made: Vec<(String, String)>,
}

/// A value with what is behind it, for a draft.
#[derive(Clone, Debug)]
pub struct Known {
    /// The key, `effect.KIND.KEY` or `sensor.gains.KEY`, and its value.
    pub change: Change,
    /// What is behind it.
    pub basis: Basis,
}

impl Known {
    /// Whether it is a key of the file outside its tables of effects and gains.
    fn is_plain(&self) -> bool {
        !["effect.", "sensor.gains."].iter().any(|table| self.change.key.starts_with(table))
    }
}

/// What a camera file is to be made of.
#[derive(Clone, Debug, Default)]
pub struct Request {
    /// Name of the camera.
    pub name: String,
    /// A built-in camera that it starts from.
    pub like: Option<String>,
    /// Keys with values.
    pub given: Vec<Change>,
    /// Values with what is behind them, which hold where none is given.
    pub known: Vec<Known>,
    /// Points of the quantum efficiency from a data sheet, as [`efficiency::Point`] reads them.
    pub efficiency: Vec<String>,
}

/// Keys without a rule of thumb, which must be given.
const MUST: [&str; 5] =
    ["sensor.width", "sensor.height", "sensor.pitch_um", "sensor.cfa", "sensor.bits"];

/// Curves of quantum efficiency by sensor, with their grade. The head of a table names its source.
const CURVES: [(&str, &str, Grade); 9] = [
    ("ov5647", "ov5647-qe.csv", Grade::Quoted),
    ("imx219", "imx219-relative-qe.csv", Grade::Quoted),
    ("imx428", "imx426-qe.csv", Grade::Quoted),
    ("mt9v034", "mt9v024-mono-qe.csv", Grade::Datasheet),
    ("imx183", "imx183-qe.csv", Grade::Quoted),
    ("imx455", "imx455-qe.csv", Grade::Quoted),
    ("imx571", "imx455-qe.csv", Grade::Quoted),
    ("kaf8300", "kaf8300-qe.csv", Grade::Quoted),
    ("gsense400bsi", "gsense400bsi-qe.csv", Grade::Datasheet),
];

/// Size, pitch and bits.
const GEOMETRY: [&str; 4] = ["sensor.width", "sensor.height", "sensor.pitch_um", "sensor.bits"];

/// Keys of the three built-in camera files that have a source, its grade, and it; the other values
/// are typical, as the heads of the files say.
const SOURCED: [(&str, &[&str], Grade, &str); 5] = [
    ("mt9t012", &GEOMETRY, Grade::Quoted, "Chen et al. 2009, section IV"),
    ("mt9t012", &["sensor.cfa"], Grade::Quoted, "Chen et al. 2009, section IV"),
    (
        "mt9t012",
        &["sensor.qe"],
        Grade::Typical,
        "ISETCam data/sensor/colorfilters/auto/AptinaMT9M131.mat, that of a sibling",
    ),
    ("mt9v024", &GEOMETRY, Grade::Datasheet, "onsemi data sheet MT9V024-D"),
    ("mt9v024", &["sensor.qe"], Grade::Datasheet, "onsemi data sheet MT9V024-D, digitised"),
];

impl Draft {
    /// The draft of a built-in camera.
    ///
    /// # Errors
    /// No built-in camera has this name.
    pub fn of_preset(name: &str) -> Result<Self> {
        Self::of(&Request { like: Some(name.into()), name: name.into(), ..Request::default() })
    }

    /// A draft of what is given, the rest from a built-in camera or by rules of thumb.
    ///
    /// # Errors
    /// All keys at once that are unknown, have values of another type or range, or are missing;
    /// points of the quantum efficiency that no curve goes through; an unknown built-in camera.
    pub fn of(request: &Request) -> Result<Self> {
        let Request { given, known, .. } = request;
        let mut making = Making { given, known, base: base(request)?, curve: None };
        let points = checked(request, &making)?;
        let mut made = Vec::new();
        if !points.is_empty() {
            let shape = making.entry("sensor.qe");
            let shape = shape.and_then(|(name, _)| builtin::file(name.as_str()?));
            let shape = shape.ok_or_else(|| {
                Error::input("points of the quantum efficiency beside sensor.qe").help("give one")
            })?;
            let curve = efficiency::through(&points, shape, making.mono())?;
            let name = format!("{}-qe.csv", request.name);
            making.curve = Some((name.clone(), points.len()));
            made.push((name, curve));
        }
        let entries = Key::all().iter().filter_map(|key| {
            let (value, basis) = match (key.path(), making.given("name")) {
                ("name", None) => (request.name.clone().into(), Basis::plain(Grade::Given, "")),
                (path, _) => making.entry(path)?,
            };
            Some(Entry { key, value, basis })
        });
        let entries = entries.collect();
        let more = known.iter().filter(|k| !k.is_plain()).cloned().collect();
        Ok(Self { about: making.about(), entries, more, made })
    }

    /// Value and basis of a key by its path.
    #[must_use]
    pub fn entry(&self, path: &str) -> Option<&Entry> {
        self.entries.iter().find(|entry| entry.key.path() == path)
    }

    /// The tables that the file names and that come with it: made for it, or built in.
    #[must_use]
    pub fn tables(&self) -> Vec<(String, String)> {
        let named = self.entries.iter().filter(|e| e.basis.grade != Grade::Given);
        let named = named.filter_map(|e| e.value.as_str());
        let built_in = named.filter(|name| name.ends_with(".csv")).map(table);
        let built_in = built_in.map(|(name, text)| (name.to_string(), text.to_string()));
        self.made.iter().cloned().chain(built_in).collect()
    }

    /// The camera of the file, if it were in `directory` with its tables.
    ///
    /// # Errors
    /// Those of [`Camera::load`].
    pub fn camera(&self, directory: &Path) -> Result<Camera> {
        let tables = self.tables();
        Camera::parse(&self.text(), "camera", &Folder::Draft { tables: &tables, directory })
    }
}

/// The points of the quantum efficiency, if nothing is wrong or missing.
fn checked(request: &Request, making: &Making<'_>) -> Result<Vec<efficiency::Point>> {
    let mut wrong = mistakes_of(&request.given);
    let mut points = Vec::new();
    for point in &request.efficiency {
        point.parse().map_or_else(|fault| wrong.push(fault), |point| points.push(point));
    }
    let missing = MUST.iter().filter(|path| making.decided(path).is_none());
    let missing: Vec<&Key> = missing.filter_map(|path| Key::of(path)).collect();
    if !missing.is_empty() {
        wrong.push(keys::are_missing(&missing));
        return Err(mistakes::all(wrong).with_code(ErrorCode::CameraKeys));
    }
    if wrong.is_empty() { Ok(points) } else { Err(mistakes::all(wrong)) }
}

/// What is wrong with given keys: unknown, or with values of another type or range.
fn mistakes_of(given: &[Change]) -> Vec<Error> {
    let mistake = |change: &Change| match Key::of(&change.key) {
        Some(key) => key.mistake(&change.value),
        None => Some(keys::unknown(&change.key)),
    };
    given.iter().filter_map(mistake).collect()
}

/// A built-in table with its name.
fn table(name: &str) -> (&str, &'static str) {
    (name, builtin::file(name).unwrap_or_default())
}

/// The camera that a draft starts from.
enum Base {
    None,
    Sensor(Sensor),
    File(&'static str, toml::Table),
}

fn base(request: &Request) -> Result<Base> {
    let Some(name) = &request.like else { return Ok(Base::None) };
    if let Some(sensor) = Sensor::of(name) {
        return Ok(Base::Sensor(sensor));
    }
    if builtin::HDR_NAMES.contains(&name.as_str()) {
        return Err(Error::unsupported(format!(
            "a draft like {name}, which has several captures"
        ))
        .help(format!("start from its file: `camrig presets {name} > camera.toml`")));
    }
    let file = builtin::NAMES.into_iter().find(|n| n == name).and_then(|name| {
        let text = builtin::file(&format!("{name}.toml"))?;
        Some(Base::File(name, toml::from_str(text).ok()?))
    });
    file.ok_or_else(|| unknown("preset", name))
}

/// Names of all built-in cameras.
pub(crate) fn names() -> Vec<&'static str> {
    let files = builtin::NAMES.into_iter().chain(builtin::HDR_NAMES);
    let tabled = Sensor::all().map(|sensor| sensor.name());
    files.chain(tabled.filter(|name| !builtin::HDR_NAMES.contains(name))).collect()
}

/// No built-in camera has this name; `what` is what it was taken for.
pub(crate) fn unknown(what: &str, name: &str) -> Error {
    Error::input(format!("unknown {what} {name:?}")).help(toml_text::did_you_mean(name, &names()))
}

/// A draft in the making: where values come from.
struct Making<'a> {
    given: &'a [Change],
    known: &'a [Known],
    base: Base,
    /// A table of the quantum efficiency that was made, and through how many points.
    curve: Option<(String, usize)>,
}

type Found = Option<(Value, Basis)>;

impl Making<'_> {
    /// Value and basis of a key, `None` where it is left out.
    fn entry(&self, path: &str) -> Found {
        let kind = self.given("lens.kind").and_then(Value::as_str);
        let of_another_lens = kind.is_some_and(|kind| kind != "diffraction-limited")
            && ["lens.f_number", "lens.focal_length_mm", "lens.relative_illumination"]
                .contains(&path);
        // A table or number that is given is taken as it is.
        let scaled = path == "sensor.qe_peak"
            && (self.given("sensor.qe").is_some() || self.curve.is_some());
        if (of_another_lens || scaled) && self.given(path).is_none() {
            return None;
        }
        self.decided(path).or_else(|| {
            if matches!(self.base, Base::File(..)) {
                return None; // it is whole
            }
            let (value, why) = typical::rule(path, &self.facts())?;
            Some((value, Basis::plain(Grade::Typical, why)))
        })
    }

    fn given(&self, path: &str) -> Option<&Value> {
        self.given.iter().rev().find(|change| change.key == path).map(|change| &change.value)
    }

    /// Value and basis without rules of thumb.
    fn decided(&self, path: &str) -> Found {
        if let Some(value) = self.given(path) {
            return Some((value.clone(), Basis::plain(Grade::Given, "")));
        }
        if let ("sensor.qe", Some((name, points))) = (path, &self.curve) {
            let note = format!("a curve through {points} points; see the table");
            return Some((name.clone().into(), Basis::plain(Grade::Given, &note)));
        }
        let of_path = |known: &&Known| known.is_plain() && known.change.key == path;
        if let Some(known) = self.known.iter().find(of_path) {
            return Some((known.change.value.clone(), known.basis.clone()));
        }
        match &self.base {
            Base::None => None,
            Base::Sensor(sensor) => self.of_sensor(path, *sensor),
            Base::File(name, file) => of_file(path, name, file),
        }
    }

    fn number(&self, path: &str) -> Option<f64> {
        let (value, _) = self.decided(path)?;
        value.as_f64()
    }

    fn mono(&self) -> bool {
        let cfa = self.decided("sensor.cfa");
        cfa.is_some_and(|(cfa, _)| cfa.as_str() == Some("mono"))
    }

    fn facts(&self) -> typical::Known {
        let number = |path| self.number(path).unwrap_or_default();
        let dark = self.number("sensor.noise.dark_current_e_per_s");
        let at = self.number("sensor.noise.temperature_ref_c").unwrap_or(25.0);
        typical::Known {
            size: (number("sensor.width"), number("sensor.height")),
            pitch_um: number("sensor.pitch_um"),
            bits: number("sensor.bits") as u32,
            mono: self.mono(),
            qe_peak: self.number("sensor.qe_peak"),
            read_e: self.number("sensor.noise.read_e"),
            dark: dark.map(|dark| (dark, at)),
        }
    }

    /// What the camera is.
    fn about(&self) -> String {
        let Base::Sensor(sensor) = &self.base else {
            return match &self.base {
                Base::File(name, _) => format!("Made from the built-in camera {name}."),
                _ => "Made from the figures that were given.".into(),
            };
        };
        let mut about = format!(
            "{} {}, {} ({} shutter).",
            sensor.text("maker"),
            sensor.name().to_uppercase(),
            sensor.text("class"),
            sensor.text("shutter")
        );
        for (parameter, name) in [("frame_rate", "Frame rate"), ("line_time", "Line time")] {
            if let Some(fact) = sensor.fact(parameter) {
                let mode = if fact.mode.is_empty() { "" } else { &format!(" ({})", fact.mode) };
                about += &format!(" {name} {} {}{mode}.", fact.value, fact.unit);
            }
        }
        about
    }

    fn of_sensor(&self, path: &str, sensor: Sensor) -> Found {
        let fact = |parameter| sensor.fact(parameter);
        let number = |parameter| {
            let fact = fact(parameter)?;
            Some((fact.number()?.into(), Basis::of(fact)))
        };
        let whole = |parameter| {
            let fact = fact(parameter)?;
            Some((fact.value.parse::<i64>().ok()?.into(), Basis::of(fact)))
        };
        match path {
            "sensor.width" => whole("width"),
            "sensor.height" => whole("height"),
            "sensor.bits" => whole("bits"),
            "sensor.pitch_um" => number("pitch"),
            "sensor.cfa" => pattern(fact("cfa")?),
            "sensor.qe" => self.curve_of(sensor),
            "sensor.qe_peak" => self.peak_of(sensor),
            "sensor.conversion_gain_uv_per_e" => number("conversion_gain"),
            "sensor.full_well_e" => self.full_well_of(sensor),
            "sensor.black_level_dn" => self.black_of(sensor),
            "sensor.noise.read_e" => number("read_noise"),
            "sensor.noise.read_e_post" => self.post_of(sensor),
            "sensor.noise.dark_current_e_per_s" => number("dark_current"),
            "sensor.noise.temperature_ref_c" => {
                let fact = fact("dark_current")?;
                Some((fact.temperature_c()?.into(), Basis::of(fact)))
            }
            "sensor.noise.dark_doubling_c" => number("dark_doubling"),
            "sensor.noise.prnu" => {
                let fact = fact("prnu")?;
                Some((rounded(fact.number()? / 100.0, 4).into(), Basis::of(fact)))
            }
            _ => None,
        }
    }

    /// The sensor's own curve, where it is one of this colour filter pattern.
    fn curve_of(&self, sensor: Sensor) -> Found {
        let (_, name, grade) = CURVES.into_iter().find(|(of, ..)| *of == sensor.name())?;
        let (_, text) = table(name);
        let mono = !text.lines().any(|line| line == "wavelength_nm,r,g,b");
        let basis = Basis { source: efficiency::source(text), ..Basis::plain(grade, "") };
        (mono == self.mono()).then(|| (name.into(), basis))
    }

    /// The peak of the efficiency: behind colour filters less than without.
    fn peak_of(&self, sensor: Sensor) -> Found {
        let fact = sensor.fact("qe_peak")?;
        let peak = fact.number()?;
        let without = fact.mode.contains("mono")
            || fact.condition.contains("without colour filter")
            || sensor.text("cfa").starts_with("mono");
        if self.mono() || !without {
            return Some((peak.into(), Basis::of(fact)));
        }
        let note =
            format!("{peak} without filters x {GREEN_OVER_MONO}, which green ones let through");
        let basis = Basis { grade: Grade::Typical, ..Basis::derived(fact, note) };
        Some((rounded(peak * GREEN_OVER_MONO, 3).into(), basis))
    }

    /// Black level in DN of the draft's bits.
    fn black_of(&self, sensor: Sensor) -> Found {
        let fact = sensor.fact("black_level")?;
        let (bits, level) = (self.number("sensor.bits")?, fact.number()?);
        let at = fact.bits().map(f64::from).or(sensor.fact("bits")?.number())?;
        if at == bits {
            return Some((level.into(), Basis::of(fact)));
        }
        let scaled = rounded(level * libm::exp2(bits - at), 4);
        Some((scaled.into(), Basis::derived(fact, format!("{level} DN of {at} bits"))))
    }

    /// The charge at which the converter's range would end without a black level: electrons per DN
    /// times the range, or from the charge at saturation, which lies a black level below.
    fn full_well_of(&self, sensor: Sensor) -> Found {
        let bits = self.number("sensor.bits")?;
        let own = sensor.fact("bits")?.number()?;
        let top = libm::exp2(bits) - 1.0;
        let holds = |fact: &&Fact| fact.bits().map_or(own, f64::from) == bits;
        if let Some(gain) = sensor.fact("system_gain").filter(holds) {
            let note = format!("{} e-/DN x {top} DN", gain.value);
            let basis = Basis::derived(gain, note);
            return Some((rounded(gain.number()? * top, 4).into(), basis));
        }
        let well = sensor.fact("full_well")?;
        let (black, _) = self.entry("sensor.black_level_dn")?;
        let black = black.as_f64()?;
        let note = format!("{} e- fill {} of {top} DN", well.value, top - black);
        let full = well.number()? * top / (top - black);
        Some((rounded(full, 4).into(), Basis::derived(well, note)))
    }

    /// The read noise after the gain stage, from that at two gains: pre² + post²/gain².
    fn post_of(&self, sensor: Sensor) -> Found {
        let mut noises = sensor.facts().iter().filter(|fact| fact.parameter == "read_noise");
        let (unity, raised) = (noises.next()?, noises.next()?);
        let of_another = |known: &Known| known.change.key == "sensor.noise.read_e";
        if self.given("sensor.noise.read_e").is_some() || self.known.iter().any(of_another) {
            return None;
        }
        let (a, b, gain) = (unity.number()?, raised.number()?, raised.gain()?);
        let post = ((a * a - b * b) / (1.0 - 1.0 / (gain * gain))).sqrt();
        let note = format!("{a} e- at unity gain, {b} e- at gain {}", rounded(gain, 3));
        Some((rounded(post, 3).into(), Basis::derived(raised, note)))
    }
}

/// A colour filter pattern in the words of a camera file.
fn pattern(fact: &Fact) -> Found {
    let told = &fact.value;
    let order = ["RGGB", "GRBG", "GBRG", "BGGR"].into_iter().find(|order| told.contains(order));
    let mut basis = Basis::of(fact);
    basis.note = [&told[..], &basis.note].join("; ").trim_end_matches("; ").to_string();
    if told.starts_with("mono") {
        return Some(("mono".into(), basis));
    }
    if order.is_none() {
        basis =
            Basis { grade: Grade::Typical, note: format!("{told}; order taken as RGGB"), ..basis };
    }
    let order = order.unwrap_or("RGGB");
    if !told.contains("quad") {
        return Some((order.into(), basis));
    }
    let twice = |row: &str| row.chars().flat_map(|c| [c, c]).collect::<String>();
    let (above, below) = (twice(&order[..2]), twice(&order[2..]));
    Some((format!("{above}/{above}/{below}/{below}").into(), basis))
}

/// Value and basis of a key of one of the built-in camera files.
fn of_file(path: &str, name: &str, file: &toml::Table) -> Found {
    let (last, tables) =
        path.split('.').collect::<Vec<_>>().split_last().map(|(l, t)| (*l, t.to_vec()))?;
    let table = tables.into_iter().try_fold(file, |table, name| table.get(name)?.as_table())?;
    let value = Value(table.get(last)?.clone());
    let sourced = SOURCED.iter().find(|(of, keys, ..)| *of == name && keys.contains(&path));
    let basis = match sourced {
        Some((_, _, grade, source)) => {
            Basis { source: source.to_string(), ..Basis::plain(*grade, "") }
        }
        None => Basis::plain(Grade::Typical, &format!("chosen for the built-in camera {name}")),
    };
    Some((value, basis))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(like: Option<&str>, given: &[&str], points: &[&str]) -> Request {
        Request {
            name: "mine".into(),
            like: like.map(String::from),
            given: given.iter().map(|text| text.parse().unwrap()).collect(),
            efficiency: points.iter().map(|point| point.to_string()).collect(),
            known: Vec::new(),
        }
    }

    fn camera(request: &Request) -> (Draft, Camera) {
        let draft = Draft::of(request).unwrap();
        let camera = draft.camera(Path::new("/nowhere")).unwrap();
        (draft, camera)
    }

    /// The camera of each sensor has the figures that the table of facts gives: the system gain,
    /// or without one the charge at saturation, exactly; read noise, peak efficiency and PRNU.
    /// Where both are known, from different sources, the charge at saturation follows within 8 %.
    #[test]
    fn cameras_have_the_figures_of_their_sensors() {
        for sensor in Sensor::all() {
            let name = sensor.name();
            let camera = Camera::load(name).unwrap().sensor;
            let fact = |parameter| sensor.fact(parameter).and_then(Fact::number);
            let near = |a: f64, b: f64, part: f64| {
                assert!((a / b - 1.0).abs() <= part, "{name}: {a} for {b}");
            };
            near(f64::from(camera.width), fact("width").unwrap(), 0.0);
            near(camera.pitch_um, fact("pitch").unwrap(), 0.0);
            let top = f64::from((1u32 << camera.bits) - 1);
            let e_per_dn = camera.full_well_e / top;
            let saturation = e_per_dn * (top - camera.black_level_dn);
            let gain = sensor.fact("system_gain");
            match gain.and_then(Fact::number) {
                Some(gain) => near(e_per_dn, gain, 1e-3),
                None => near(saturation, fact("full_well").unwrap(), 1e-3),
            }
            near(saturation, fact("full_well").unwrap(), 0.08);
            if let Some(read_e) = fact("read_noise") {
                near(camera.noise.read_e, read_e, 0.0);
            }
            if let Some(percent) = fact("prnu") {
                near(100.0 * camera.noise.prnu, percent, 1e-9);
            }
            let samples = camera.qe.iter().flat_map(|curve| curve.samples());
            let peak = samples.fold(0.0f64, |m, (_, v)| m.max(v));
            let filters = if camera.cfa.is_mono() { 1.0 } else { GREEN_OVER_MONO };
            let told = fact("qe_peak").unwrap();
            assert!([told, rounded(told * filters, 3)].contains(&peak), "{name}: {peak}");
        }
    }

    #[test]
    fn what_is_given_stands_and_the_rest_follows_from_it() {
        let (draft, camera) = camera(&request(
            Some("imx477"),
            &["sensor.noise.read_e=2.5", "sensor.bits=10", "lens.f_number=4"],
            &[],
        ));
        let grade = |path| draft.entry(path).unwrap().basis.grade;
        assert_eq!(camera.sensor.noise.read_e, 2.5);
        assert_eq!(grade("sensor.noise.read_e"), Grade::Given);
        // The noise after the gain stage was that of another read noise, the black level and the
        // system gain those of 12 bits: 256.3 / 4, and 8180 e- in 1023 - 64.08 DN.
        assert_eq!(grade("sensor.noise.read_e_post"), Grade::Typical);
        assert_eq!(camera.sensor.black_level_dn, 64.08);
        assert_eq!(camera.sensor.full_well_e, 8727.0);
        assert_eq!(grade("sensor.full_well_e"), Grade::Derived);
        // A whole number is a number: 4562 e- in 1023 - 23 DN.
        let given = request(Some("imx219"), &["sensor.black_level_dn=23"], &[]);
        let full = Draft::of(&given).unwrap().entry("sensor.full_well_e").unwrap().clone();
        assert_eq!(full.value.as_f64(), Some(4667.0));
        assert!(matches!(
            camera.lens.kind,
            crate::LensKind::DiffractionLimited { f_number: 4.0, .. }
        ));
    }

    /// Measured values stand with their errors behind them, those of effects and gains in tables of
    /// their own; a value that is given comes first.
    #[test]
    fn measured_values_stand_with_their_errors() {
        let frames = "64 frames, gain 1";
        let known = |key: &str, value: Value, error: f64| Known {
            change: Change::new(key, value),
            basis: Basis::measured(error, frames),
        };
        let request = Request {
            known: vec![
                known("sensor.noise.read_e", 2.5.into(), 0.01234),
                known("sensor.noise.prnu", 0.007.into(), 0.0001),
                known("sensor.gains.at", vec![1.0, 2.0].into(), 0.0),
                known("sensor.gains.read_e", vec![2.5, 2.25].into(), 0.01),
                known("effect.row-temporal-noise.sigma_e", 0.5.into(), 0.02),
                known("effect.hot-pixels.fraction", 0.002.into(), 0.0004),
                known("effect.hot-pixels.mean_e_per_s", 1500.0.into(), 200.0),
            ],
            ..request(Some("imx477"), &["sensor.noise.prnu=0.02"], &[])
        };
        let (draft, camera) = camera(&request);
        let sensor = &camera.sensor;
        assert_eq!((sensor.noise.read_e, sensor.noise.prnu), (2.5, 0.02));
        assert_eq!(sensor.gains.as_ref().unwrap().read_e, Some(vec![2.5, 2.25]));
        let kinds: Vec<&str> = camera.effects.iter().map(|e| e.entry().kind).collect();
        assert_eq!(kinds, ["row-temporal-noise", "hot-pixels"]);
        let text = draft.text();
        for line in [
            "read_e = 2.5                     # measured ± 0.012, 64 frames, gain 1",
            "sigma_e = 0.5                    # measured ± 0.02, 64 frames, gain 1",
            "prnu = 0.02                      # given",
        ] {
            assert!(text.contains(line), "{line}: {text}");
        }
    }

    #[test]
    fn a_mono_sensor_with_filters_gets_their_curves() {
        let (draft, camera) = camera(&request(Some("imx455"), &["sensor.cfa=RGGB"], &[]));
        let names = draft.tables().into_iter().map(|(name, _)| name).collect::<Vec<_>>();
        assert_eq!(names, ["mobile-qe.csv", "ir-cut-690.csv"]);
        assert_eq!(camera.sensor.qe.len(), 3);
        assert_eq!(draft.entry("sensor.qe_peak").unwrap().value.as_f64(), Some(0.72));
    }

    #[test]
    fn everything_wrong_or_missing_is_told_at_once() {
        let told = |given: &[&str], points: &[&str]| {
            Draft::of(&request(None, given, points)).unwrap_err().to_string()
        };
        let text =
            told(&["sensor.pitch_um=wide", "sensor.bits=20", "sensor.noise.raed_e=1"], &["x"]);
        for words in [
            "sensor.pitch_um = \"wide\" (use a number, 0.1 to 1000 µm)",
            "sensor.bits = 20 (use a whole number, 8 to 16 bits)",
            "did you mean \"sensor.noise.read_e\"?",
            "\"x\" is no point",
            "sensor.width in pixels, usually 640 to 8000",
            "sensor.height in pixels",
            "sensor.cfa, usually RGGB",
        ] {
            assert!(text.contains(words), "{words}: {text}");
        }
        let unknown = Draft::of(&request(Some("imx47"), &[], &[])).unwrap_err().to_string();
        assert!(unknown.contains("did you mean \"imx477\"?"), "{unknown}");
    }

    /// Each key of a draft has its unit, usual values and the word for what it is based on; a
    /// reader of TOML sees the same values.
    #[test]
    fn the_text_says_all() {
        let (draft, _) = camera(&request(
            None,
            &[
                "sensor.width=64",
                "sensor.height=48",
                "sensor.pitch_um=3.45",
                "sensor.bits=12",
                "sensor.cfa=mono",
            ],
            &["450:0.5", "529:0.64"],
        ));
        let text = draft.text();
        assert!(text.lines().all(|line| line.chars().count() <= 100), "{text}");
        assert!(
            text.contains("# Distance of neighbouring pixels, µm; usually 0.6 to 2 in phones")
        );
        let file: toml::Table = toml::from_str(&text).unwrap();
        for entry in draft.entries.iter().filter(|e| !e.key.table().is_empty()) {
            let mut tables = entry.key.table().split('.');
            let table = tables.try_fold(&file, |t, name| t.get(name)?.as_table()).unwrap();
            assert_eq!(table[entry.key.name()], entry.value.0);
            let line = text.lines().find(|l| l.starts_with(&format!("{} =", entry.key.name())));
            let words = line.unwrap().split_once(" # ").unwrap().1;
            assert!(words.starts_with(entry.basis.grade.name()), "{words}");
        }
        let qe = &draft.made[0];
        assert_eq!(qe.0, "mine-qe.csv");
        assert!(qe.1.contains("\n450,0.5000\n") && qe.1.contains("\n529,0.6400\n"), "{}", qe.1);
    }

    /// The rule for the full well against the wells that are not typical themselves.
    #[test]
    fn the_usual_full_well_is_within_a_factor_of_three() {
        for sensor in Sensor::all() {
            let well = sensor.fact("full_well").unwrap();
            if well.grade == "typical" {
                continue;
            }
            let pitch = sensor.text("pitch");
            let given =
                ["sensor.width=64", "sensor.height=48", "sensor.bits=12", "sensor.cfa=mono"];
            let pitch = format!("sensor.pitch_um={pitch}");
            let (draft, _) = camera(&request(None, &[&given[..], &[&pitch]].concat(), &[]));
            let rule = draft.entry("sensor.full_well_e").unwrap().value.as_f64().unwrap();
            let ratio = rule / well.number().unwrap();
            assert!((1.0 / 3.0..=3.0).contains(&ratio), "{}: {ratio}", sensor.name());
        }
    }
}
