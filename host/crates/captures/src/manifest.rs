//! `captures.toml`: the raw shape of the file, and its check into [`CaptureSet`].

use super::{Capture, CaptureSet, Light, Role, Rotation, SceneSeen, SensorFacts, Split};
use camrig_base::Cfa;
use camrig_base::{Error, Result, mistakes, toml_text};
use camrig_light::Illuminant;
use camrig_scene as scene;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema, schema_for};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// What stands in a manifest in place of a value that is not known yet. Nothing reads such a set;
/// whoever tries is told all of these.
pub const UNKNOWN: &str = "?";

/// What a capture set is: which sensor took its frames, and under what conditions. Paths are
/// relative to the file.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct File {
    /// `"captures/1"`.
    format: String,
    /// The camera as it is thought to be: a preset or a camera file.
    camera: Option<String>,
    /// Where the frames come from: free text for people, under any keys; not interpreted.
    #[serde(default)]
    #[schemars(schema_with = "free_table")]
    #[allow(dead_code, reason = "free text for people; accepted, not interpreted")]
    source: toml::Table,
    /// The sensor's frames.
    sensor: Sensor,
    /// The captures, in order of time.
    #[serde(default)]
    #[schemars(with = "Vec<Entry>")]
    capture: Vec<toml::Spanned<Entry>>,
}

/// The frames of a sensor.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Sensor {
    /// Pixels in a row.
    width: usize,
    /// Rows.
    height: usize,
    /// Bits of a sample.
    bits: u32,
    /// Colour filter pattern, such as `"RGGB"`; left out: monochrome.
    cfa: Option<String>,
    /// Mean without light, DN; where it is left out, dark frames tell.
    black_level_dn: Option<f64>,
    /// Value at which a sample saturates, DN; left out: the largest of `bits`.
    white_level_dn: Option<u16>,
    /// Distance of neighbouring pixels, µm.
    pitch_um: Option<f64>,
}

/// One stack of frames under the same conditions.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Entry {
    /// Unique name within the set.
    id: String,
    /// What it is for.
    role: Role,
    /// The frames' files: a name, or a pattern with `*`, in order of time by name; or a list of
    /// these, in order of time.
    #[schemars(schema_with = "names")]
    files: Names,
    /// Which side of a fit it belongs to; left out: the program alternates, and says so.
    split: Option<Split>,
    /// Exposure time, s; 0 for bias frames (role `dark`).
    exposure_s: f64,
    /// Gain before the converter.
    #[serde(default = "one")]
    analog_gain: f64,
    /// Temperature of the sensor, °C; left out: that of the camera file.
    temperature_c: Option<f64>,
    /// Exposure time that the camera was asked for, s, where it differs.
    exposure_requested_s: Option<f64>,
    /// The capture right before it, by id, where image lag may matter.
    preceded_by: Option<String>,
    /// Light on the sensor or on the scene.
    light: Option<Light>,
    /// What an edge, a chart, dots or a scene looked at.
    scene: Option<SceneSeen>,
    /// How the sensor was turned; with role `rotation`.
    rotation: Option<Rotation>,
}

/// One name or pattern, or several.
struct Names(Vec<String>);

impl<'de> Deserialize<'de> for Names {
    fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        struct Visit;
        impl<'de> serde::de::Visitor<'de> for Visit {
            type Value = Names;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a file name, a pattern, or a list of these")
            }

            fn visit_str<E>(self, name: &str) -> Result<Names, E> {
                Ok(Names(vec![name.to_string()]))
            }

            fn visit_seq<A: serde::de::SeqAccess<'de>>(
                self,
                mut list: A,
            ) -> Result<Names, A::Error> {
                let mut names = Vec::new();
                while let Some(name) = list.next_element()? {
                    names.push(name);
                }
                Ok(Names(names))
            }
        }
        from.deserialize_any(Visit)
    }
}

fn names(_: &mut SchemaGenerator) -> Schema {
    json_schema!({
        "anyOf": [{ "type": "string" }, { "type": "array", "items": { "type": "string" } }]
    })
}

fn free_table(_: &mut SchemaGenerator) -> Schema {
    json_schema!({ "type": "object" })
}

/// The JSON schema of `captures.toml`.
pub fn schema() -> Schema {
    schema_for!(File)
}

/// The text of a manifest, written capture by capture.
pub struct ManifestWriter {
    head: toml::Table,
    captures: Vec<toml::Value>,
}

#[derive(Serialize)]
struct WrittenCapture<'a> {
    id: &'a str,
    role: Role,
    files: String,
    exposure_s: f64,
    analog_gain: f64,
    temperature_c: Option<f64>,
    light: Option<&'a Light>,
    scene: Option<&'a SceneSeen>,
    rotation: Option<&'a Rotation>,
}

impl ManifestWriter {
    /// A manifest of these frames; `camera` is a preset or a path relative to the set.
    pub fn new(facts: SensorFacts, camera: Option<&str>, name: &str) -> Self {
        let mut sensor = toml::Table::new();
        sensor.insert("width".into(), (facts.width as i64).into());
        sensor.insert("height".into(), (facts.height as i64).into());
        sensor.insert("bits".into(), i64::from(facts.bits).into());
        sensor.insert("white_level_dn".into(), i64::from(facts.white_level_dn).into());
        if let Some(cfa) = facts.cfa {
            sensor.insert("cfa".into(), cfa.to_string().into());
        }
        if let Some(black) = facts.black_level_dn {
            sensor.insert("black_level_dn".into(), black.into());
        }
        if let Some(pitch) = facts.pitch_um {
            sensor.insert("pitch_um".into(), pitch.into());
        }
        let mut source = toml::Table::new();
        source.insert("sensor".into(), format!("camera {name:?}, simulated by camrig").into());
        let mut head = toml::Table::new();
        head.insert("format".into(), "captures/1".into());
        if let Some(camera) = camera {
            head.insert("camera".into(), camera.into());
        }
        head.insert("source".into(), source.into());
        head.insert("sensor".into(), sensor.into());
        Self { head, captures: Vec::new() }
    }

    /// Adds a capture; its one file is taken as the pattern. Files of its scene and light are
    /// named from the root.
    pub fn push(&mut self, c: &Capture) {
        let (mut light, mut seen) = (c.light.clone(), c.scene.clone());
        name_files_from(&std::env::current_dir().unwrap_or_default(), &mut light, &mut seen);
        let written = WrittenCapture {
            id: &c.id,
            role: c.role,
            files: c.files.first().map_or(String::new(), |f| f.to_string_lossy().into()),
            exposure_s: c.exposure_s,
            analog_gain: c.analog_gain,
            temperature_c: c.temperature_c,
            light: light.as_ref(),
            scene: seen.as_ref(),
            rotation: c.rotation.as_ref(),
        };
        self.captures.extend(toml::Value::try_from(written));
    }

    /// The text.
    pub fn text(mut self) -> Result<String> {
        self.head.insert("capture".into(), self.captures.into());
        toml::to_string(&self.head).map_err(|e| Error::input(format!("captures.toml: {e}")))
    }
}

/// Makes relative names of files in a capture's light and scene paths from `folder`; what is built
/// in keeps its name.
fn name_files_from(folder: &Path, light: &mut Option<Light>, seen: &mut Option<SceneSeen>) {
    let from = |name: &str| folder.join(name).to_string_lossy().into_owned();
    if let Some(illuminant) = light.as_mut().and_then(|l| l.illuminant.as_mut())
        && Illuminant::is_file(illuminant)
    {
        *illuminant = from(illuminant);
    }
    if let Some(seen) = seen
        && scene::is_file(&seen.scene)
    {
        seen.scene = from(&seen.scene);
    }
}

fn one() -> f64 {
    1.0
}

/// Parses and checks the text of the manifest at `file`.
pub fn parse(text: &str, file: &Path) -> Result<CaptureSet> {
    let raw: File = read(text).map_err(|e| mistakes::all(e).at(file.display()))?;
    let root = file.parent().unwrap_or(Path::new(".")).to_owned();
    check(raw, root, text).map_err(|e| e.at(file.display()))
}

/// Reads the text, or says what is not known yet and every mistake.
fn read(text: &str) -> std::result::Result<File, Vec<Error>> {
    let mut marks = Vec::new();
    if let Ok(table) = DeTable::parse(text) {
        find_unknown(table.get_ref(), text, "", &mut marks);
    }
    let mistakes = match mistakes::find(text) {
        Ok(file) if marks.is_empty() => return Ok(file),
        Ok(_) => Vec::new(),
        Err(mistakes) => mistakes,
    };
    // A mark is of another type than the value that it stands for, which says no more.
    let line = |place: Option<&str>| Some(place?.split(',').next()?.to_string());
    let marked: Vec<_> = marks.iter().map(|mark| line(mark.place())).collect();
    let others = mistakes.into_iter().filter(|e| !marked.contains(&line(e.place())));
    Err(marks.into_iter().chain(others.collect::<Vec<_>>()).collect())
}

/// The places of [`UNKNOWN`], each with its line, key and capture.
fn find_unknown(table: &DeTable<'_>, text: &str, within: &str, found: &mut Vec<Error>) {
    let id = table.iter().find(|(key, _)| key.get_ref() == "id");
    let within = match id.and_then(|(_, value)| value.get_ref().as_str()) {
        Some(id) => format!(", [[capture]] id {id:?}"),
        None => within.to_string(),
    };
    // What is said of the source is free text.
    for (key, value) in table.iter().filter(|(key, _)| key.get_ref() != "source") {
        let inner: Vec<&Spanned<DeValue<'_>>> = match value.get_ref() {
            DeValue::Array(list) => list.iter().collect(),
            _ => vec![value],
        };
        for value in inner {
            match value.get_ref() {
                DeValue::Table(table) => find_unknown(table, text, &within, found),
                DeValue::String(word) if word == UNKNOWN => {
                    let line = toml_text::line_of(text, value.span().start);
                    let mark = Error::input(format!("{} is not known", key.get_ref()));
                    let place = format!("line {line}{within}");
                    found.push(mark.at(place).help(format!("put it in place of {UNKNOWN:?}")));
                }
                _ => {}
            }
        }
    }
}

/// Checks all values, and says all that are wrong.
fn check(raw: File, root: PathBuf, text: &str) -> Result<CaptureSet> {
    if raw.format != "captures/1" {
        return Err(Error::unsupported(format!("capture format {:?}", raw.format))
            .at("key \"format\"")
            .help("this program reads format = \"captures/1\""));
    }
    let mut wrong = Vec::new();
    let sensor = check_sensor(raw.sensor).map_err(|e| wrong.push(e.at("[sensor]"))).ok();
    let camera = raw.camera.map(|c| {
        let is_path = c.contains(['/', '\\']) || Path::new(&c).extension().is_some();
        if is_path { root.join(c) } else { PathBuf::from(c) }
    });
    let ids: Vec<String> = raw.capture.iter().map(|entry| entry.get_ref().id.clone()).collect();
    let mut captures: Vec<Capture> = Vec::with_capacity(ids.len());
    for (index, entry) in raw.capture.into_iter().enumerate() {
        let id = &ids[index];
        let line = toml_text::line_of(text, entry.span().start);
        let place = format!("line {line}, [[capture]] id {id:?}");
        if ids[..index].contains(id) {
            let twice = Error::input(format!("capture id {id:?} is used twice"));
            wrong.push(twice.at(&place).help("ids name captures; make them unique"));
        }
        let entry = entry.into_inner();
        if let Some(before) = entry.preceded_by.as_ref().filter(|before| !ids.contains(before)) {
            let known: Vec<&str> = ids.iter().map(String::as_str).collect();
            let unknown = Error::input(format!("preceded_by = {before:?} is no capture's id"));
            wrong.push(unknown.at(&place).help(toml_text::did_you_mean(before, &known)));
        }
        match check_entry(entry, &root) {
            Ok(capture) => captures.push(capture),
            Err(e) => wrong.push(e.at(place)),
        }
    }
    match sensor {
        Some(sensor) if wrong.is_empty() => Ok(CaptureSet { root, camera, sensor, captures }),
        _ => Err(mistakes::all(wrong)),
    }
}

fn check_sensor(s: Sensor) -> Result<SensorFacts> {
    if s.width == 0 || s.height == 0 || s.width > 1 << 16 || s.height > 1 << 16 {
        return Err(Error::input(format!("frame size {} x {}", s.width, s.height))
            .help("width and height are in pixels, 1 to 65536"));
    }
    if !(1..=16).contains(&s.bits) {
        return Err(Error::input(format!("bits = {}", s.bits)).help("use 1 to 16"));
    }
    let full_scale = ((1u32 << s.bits) - 1) as u16;
    let white = s.white_level_dn.unwrap_or(full_scale);
    if white > full_scale {
        return Err(Error::input(format!(
            "white_level_dn = {white} does not fit {} bits",
            s.bits
        ))
        .help(format!("use at most {full_scale}")));
    }
    if let Some(black) = s.black_level_dn
        && !(black >= 0.0 && black < f64::from(white))
    {
        return Err(Error::input(format!("black_level_dn = {black}"))
            .help(format!("it lies between 0 and white_level_dn = {white}")));
    }
    if let Some(pitch) = s.pitch_um
        && !(pitch > 0.0 && pitch.is_finite())
    {
        return Err(Error::input(format!("pitch_um = {pitch}")).help("use a pixel pitch in µm"));
    }
    let cfa = s.cfa.as_deref().map(Cfa::parse).transpose().map_err(|e| e.at("key \"cfa\""))?;
    Ok(SensorFacts {
        width: s.width,
        height: s.height,
        bits: s.bits,
        cfa,
        black_level_dn: s.black_level_dn,
        white_level_dn: white,
        pitch_um: s.pitch_um,
        window: None,
    })
}

fn check_entry(mut e: Entry, root: &Path) -> Result<Capture> {
    // Bias frames, of no exposure, show no light and no dark current.
    if !(e.role == Role::Dark && e.exposure_s == 0.0) {
        positive("exposure_s", e.exposure_s)?;
    }
    positive("analog_gain", e.analog_gain)?;
    if let Some(t) = e.exposure_requested_s {
        positive("exposure_requested_s", t)?;
    }
    if let Some(t) = e.temperature_c
        && !(t > -273.15 && t.is_finite())
    {
        return Err(Error::input(format!("temperature_c = {t}")).help("it is in degrees Celsius"));
    }
    if let Some(light) = &e.light {
        check_light(light, e.role)?;
    }
    if e.role == Role::Rotation && e.rotation.is_none() {
        return Err(Error::input("a rotation capture without [capture.rotation]")
            .help("give x, y (-1..1), tilt_x_deg and tilt_y_deg"));
    }
    if let Some(r) = &e.rotation {
        let ok = r.x.abs() <= 1.0
            && r.y.abs() <= 1.0
            && r.tilt_x_deg.abs() < 80.0
            && r.tilt_y_deg.abs() < 80.0;
        if !ok {
            return Err(Error::input("a point or tilt out of range")
                .at("[capture.rotation]")
                .help("x and y are -1..1 over the sensor, tilts below 80 degrees"));
        }
    }
    name_files_from(root, &mut e.light, &mut e.scene);
    Ok(Capture {
        files: expand_all(root, &e.files.0)?,
        id: e.id,
        role: e.role,
        split: e.split,
        exposure_s: e.exposure_s,
        analog_gain: e.analog_gain,
        temperature_c: e.temperature_c,
        exposure_requested_s: e.exposure_requested_s,
        preceded_by: e.preceded_by,
        light: e.light,
        scene: e.scene,
        rotation: e.rotation,
    })
}

fn check_light(light: &Light, role: Role) -> Result<()> {
    let place = |e: Error| e.at("[capture.light]");
    let amounts = [light.irradiance_w_m2, light.photons_per_pixel_per_s, light.lux];
    if role == Role::Dark && amounts.iter().flatten().any(|&a| a > 0.0) {
        return Err(place(Error::input("a dark capture with light"))
            .help("remove [capture.light], or use role = \"flat\""));
    }
    for amount in amounts.into_iter().flatten() {
        if !(amount >= 0.0 && amount.is_finite()) {
            return Err(place(Error::input(format!("an amount of light of {amount}")))
                .help("light is zero or more"));
        }
    }
    if light.irradiance_w_m2.is_some() && light.wavelength_nm.is_none() {
        return Err(place(Error::input("irradiance_w_m2 without wavelength_nm"))
            .help("the number of photons depends on the wavelength: add wavelength_nm"));
    }
    if let Some(w) = light.wavelength_nm {
        positive("wavelength_nm", w).map_err(place)?;
    }
    Ok(())
}

fn positive(key: &str, value: f64) -> Result<()> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(Error::input(format!("{key} = {value}")).help("it is more than zero"))
}

/// The files of names and patterns below `root`, in the order given.
fn expand_all(root: &Path, names: &[String]) -> Result<Vec<PathBuf>> {
    if names.is_empty() {
        return Err(Error::input("no files").at("key \"files\"").help("name the frames' files"));
    }
    let expanded: Vec<_> = names.iter().map(|name| expand(root, name)).collect::<Result<_>>()?;
    let files: Vec<PathBuf> = expanded.into_iter().flatten().collect();
    for (i, file) in files.iter().enumerate() {
        if files[..i].contains(file) {
            return Err(Error::input(format!("{} twice in one list", file.display()))
                .at("key \"files\"")
                .help("a frame counts once"));
        }
    }
    Ok(files)
}

/// The files that match `pattern` below `root`, in name order.
fn expand(root: &Path, pattern: &str) -> Result<Vec<PathBuf>> {
    let base = glob::Pattern::escape(&root.to_string_lossy());
    let full = Path::new(&base).join(pattern);
    let wrong = |what: String| Error::input(what).at("key \"files\"");
    let paths = glob::glob(&full.to_string_lossy())
        .map_err(|e| wrong(format!("pattern {pattern:?}: {}", e.msg)))?;
    let mut files = Vec::new();
    for path in paths {
        files.push(path.map_err(|e| wrong(format!("cannot look into {:?}: {e}", e.path())))?);
    }
    if files.is_empty() {
        return Err(wrong(format!("no file matches {pattern:?}"))
            .help(format!("the pattern is relative to {}", root.display())));
    }
    files.sort();
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "format = \"captures/1\"\n[sensor]\nwidth = 4\nheight = 4\nbits = 12\n";

    fn parsed(text: &str) -> String {
        match parse(text, Path::new("dir/captures.toml")) {
            Ok(set) => format!("{} captures", set.captures.len()),
            Err(e) => e.to_string(),
        }
    }

    #[test]
    fn unknown_key_names_line_and_nearest() {
        let text = format!("{HEAD}whte_level_dn = 4095\n");
        let said = parsed(&text);
        assert!(said.contains("\"whte_level_dn\""), "{said}");
        assert!(said.contains("line 6"), "{said}");
        assert!(said.contains("\"white_level_dn\"?"), "{said}");
    }

    #[test]
    fn what_is_not_known_is_told_with_its_line_and_mistakes_beside_it() {
        let text = "format = \"captures/1\"\n[sensor]\nwidth = 4\nheight = 4\nbits = \"?\"\n\
            cfa = \"?\"\n[[capture]]\nid = \"a\"\nrole = \"?\"\nfiles = \"*\"\n\
            exposure_s = \"?\"\n[[capture]]\nid = \"b\"\nrole = \"dark\"\nfiles = \"*\"\n\
            exposure_s = true\n";
        let said = parsed(text);
        for told in [
            "5 things to put right",
            "line 5: bits is not known",
            "line 6: cfa is not known",
            "line 9, [[capture]] id \"a\": role is not known",
            "line 11, [[capture]] id \"a\": exposure_s is not known",
            "line 16: exposure_s: invalid type: boolean",
        ] {
            assert!(said.contains(told), "{told}: {said}");
        }
    }

    #[test]
    fn files_may_be_listed_in_their_order() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["f2.npy", "f10.npy", "x.npy"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let of = |files: &str| {
            let tail = "id = \"a\"\nrole = \"dark\"\nexposure_s = 1\n";
            let text = format!("{HEAD}[[capture]]\n{tail}files = {files}\n");
            parse(&text, &folder.path().join("captures.toml"))
        };
        let names = |set: CaptureSet| -> Vec<String> {
            let files = set.captures[0].files.iter();
            files.map(|f| f.file_name().unwrap().to_string_lossy().into()).collect()
        };
        assert_eq!(names(of("[\"f2.npy\", \"f10.npy\"]").unwrap()), ["f2.npy", "f10.npy"]);
        assert_eq!(names(of("\"f*.npy\"").unwrap()), ["f10.npy", "f2.npy"]);
        for (files, said) in
            [("[]", "no files"), ("[\"x*\", \"x.npy\"]", "twice"), ("3", "a file name, a pattern")]
        {
            assert!(of(files).unwrap_err().to_string().contains(said), "{files}");
        }
    }

    #[test]
    fn files_are_named_from_the_set_and_built_in_things_as_they_are() {
        let named = |illuminant: &str, scene: &str| {
            let mut light =
                Some(Light { illuminant: Some(illuminant.into()), ..Light::default() });
            let mut seen = Some(SceneSeen { scene: scene.into(), angle_deg: None });
            name_files_from(Path::new("set"), &mut light, &mut seen);
            (light.and_then(|l| l.illuminant).unwrap(), seen.unwrap().scene)
        };
        for (illuminant, scene) in [("D65", "dots:pitch=0.05"), ("blackbody:3200", "uniform:0.18")]
        {
            assert_eq!(named(illuminant, scene), (illuminant.into(), scene.into()));
        }
        assert_eq!(named("lamp.csv", "a/b.mat"), ("set/lamp.csv".into(), "set/a/b.mat".into()));
        assert_eq!(named("/lamp.csv", "/b.mat").0, "/lamp.csv");
    }

    #[test]
    fn wrong_values_are_named() {
        for (tail, expected) in [
            ("white_level_dn = 5000\n", "does not fit 12 bits"),
            ("black_level_dn = 4095.0\n", "black_level_dn"),
            ("cfa = \"rggb\"\n", "colour filter pattern"),
            ("pitch_um = -1.0\n", "pitch_um"),
            (
                "[[capture]]\nid='a'\nrole='flat'\nfiles='*.npy'\nexposure_s = 0\n",
                "more than zero",
            ),
            (
                "[[capture]]\nid='a'\nrole='dark'\nfiles='*.npy'\nexposure_s = 0\n",
                "no file matches",
            ),
            (
                "[[capture]]\nid='a'\nrole='dark'\nfiles='*.npy'\nexposure_s = 1\n",
                "no file matches",
            ),
            ("[[capture]]\nid='a'\nrole='drak'\nfiles='*.npy'\nexposure_s = 1\n", "drak"),
        ] {
            let said = parsed(&format!("{HEAD}{tail}"));
            assert!(said.contains(expected), "{said}");
        }
        assert_eq!(parsed(HEAD), "0 captures");
        let several = format!(
            "{HEAD}white_levle_dn = 4095\n[[capture]]\nid='a'\nrole='drak'\nfiles='*.npy'\n"
        );
        let said = parsed(&several.replace("bits = 12", "bits = '12'"));
        for (line, word) in
            [(5, "bits"), (6, "white_levle_dn"), (9, "drak"), (7, "missing field `exposure_s`")]
        {
            let found =
                said.lines().any(|l| l.contains(&format!("line {line}:")) && l.contains(word));
            assert!(found, "{line} {word}: {said}");
        }
        let capture = |id: &str, tail: &str| {
            format!("[[capture]]\nid='{id}'\nrole='dark'\nfiles='*.npy'\n{tail}\n")
        };
        let text = format!(
            "{HEAD}pitch_um = -1\n{}{}",
            capture("a", "exposure_s = -1"),
            capture("a", "exposure_s = 1\npreceded_by = 'b'")
        );
        let said = parsed(&text);
        for word in ["pitch_um = -1", "exposure_s = -1", "used twice", "\"b\" is no capture's id"]
        {
            assert!(said.contains(word), "{word}: {said}");
        }
        assert!(said.contains("line 7, [[capture]] id \"a\": exposure_s = -1"), "{said}");
        assert!(
            parsed("format = \"captures/2\"\n[sensor]\nwidth=1\nheight=1\nbits=8\n")
                .contains("captures/1")
        );
    }
}
