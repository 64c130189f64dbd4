//! `captures.toml`: the format of the file, which is checked into a [`CaptureSet`].

mod check;
mod paths;
mod write;

use super::capture::one_or_several;
use super::{Capture, CaptureSet, Held};
use camrig_base::{Error, Result, mistakes, toml_text};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema, schema_for};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

pub use write::ManifestWriter;

/// Placeholder for a value of a manifest that is not known yet. Loading such a set is an error that
/// lists all placeholders.
pub const UNKNOWN: &str = "?";

/// A capture set: the sensor that took its frames, and under which conditions. Paths are relative
/// to the file.
#[derive(Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct File {
    /// `"captures/1"`.
    format: String,
    /// The assumed model of the camera: a preset or a camera file.
    camera: Option<String>,
    /// The origin of the frames: free text under any keys; not interpreted.
    #[serde(default)]
    #[schemars(schema_with = "free_table")]
    source: toml::Table,
    /// The sensor's frames.
    sensor: Sensor,
    /// The captures, in order of time.
    #[serde(default)]
    #[schemars(with = "Vec<Capture>")]
    capture: Vec<Spanned<Capture>>,
}

/// The frames of a sensor.
#[derive(Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Sensor {
    /// Pixels in a row.
    width: usize,
    /// Rows.
    height: usize,
    /// Bits of a sample.
    bits: u32,
    /// Colour filter pattern, such as `"RGGB"`; if omitted, monochrome.
    cfa: Option<String>,
    /// Mean without light, DN; if omitted, it is measured from dark frames.
    black_level_dn: Option<f64>,
    /// Value at which a sample saturates, DN; if omitted, the largest of `bits`.
    white_level_dn: Option<u16>,
    /// Distance of neighbouring pixels, µm.
    pitch_um: Option<f64>,
}

fn free_table(_: &mut SchemaGenerator) -> Schema {
    json_schema!({ "type": "object" })
}

/// The JSON schema of `captures.toml`.
pub fn schema() -> Schema {
    schema_for!(File)
}

/// Parses and checks the text of the manifest at `file`.
pub fn parse(text: &str, file: &Path) -> Result<CaptureSet> {
    let raw: File = read(text).map_err(|e| mistakes::all(e).at(file.display()))?;
    let root = file.parent().unwrap_or(Path::new(".")).to_owned();
    check::check(raw, root, text).map_err(|e| e.at(file.display()))
}

/// Parses and checks the text of a manifest whose captures have their frames in memory, each those
/// of its place in `held`, and no files (`files = []`).
///
/// # Errors
/// Those of [`CaptureSet::load`], and another number of captures than of `held`.
pub fn with_held(text: &str, held: Vec<Held>) -> Result<CaptureSet> {
    let mut raw = read(text).map_err(mistakes::all)?;
    if raw.capture.len() != held.len() {
        return Err(Error::disagreement(format!(
            "{} captures with the frames of {}",
            raw.capture.len(),
            held.len()
        )));
    }
    for (capture, held) in raw.capture.iter_mut().zip(held) {
        capture.get_mut().held = Some(held);
    }
    check::check(raw, PathBuf::from("."), text)
}

/// Reads the text, or reports all placeholders and mistakes.
fn read(text: &str) -> std::result::Result<File, Vec<Error>> {
    let mut placeholders = Vec::new();
    if let Ok(table) = DeTable::parse(text) {
        find_placeholders(table.get_ref(), text, "", &mut placeholders);
    }
    let mistakes = match mistakes::find(text) {
        Ok(file) if placeholders.is_empty() => return Ok(file),
        Ok(_) => Vec::new(),
        Err(mistakes) => mistakes,
    };
    // A placeholder has the wrong type too; that mistake is not reported as well.
    let line = |place: Option<&str>| Some(place?.split(',').next()?.to_string());
    let reported: Vec<_> = placeholders.iter().map(|e| line(e.place())).collect();
    let others = mistakes.into_iter().filter(|e| !reported.contains(&line(e.place())));
    Err(placeholders.into_iter().chain(others.collect::<Vec<_>>()).collect())
}

/// A stack of a manifest of which not all values are filled in yet.
#[derive(Debug)]
pub struct DraftStack {
    /// Its name in the manifest.
    pub id: String,
    /// Its frames.
    pub files: Vec<PathBuf>,
}

/// The dark stacks of a manifest with placeholders.
pub fn darks_of_draft(text: &str, root: &Path) -> Result<Option<Vec<DraftStack>>> {
    #[derive(Deserialize)]
    struct Draft {
        #[serde(default)]
        capture: Vec<Stack>,
    }
    #[derive(Deserialize)]
    struct Stack {
        id: String,
        role: String,
        #[serde(deserialize_with = "one_or_several::deserialize")]
        files: Vec<PathBuf>,
    }
    let mut placeholders = Vec::new();
    if let Ok(table) = DeTable::parse(text) {
        find_placeholders(table.get_ref(), text, "", &mut placeholders);
    }
    if placeholders.is_empty() {
        return Ok(None);
    }
    let draft: Draft = toml::from_str(text).map_err(|e| Error::input(e.message()))?;
    let darks = draft.capture.into_iter().filter(|stack| stack.role == "dark");
    let expanded = |stack: Stack| {
        let files = paths::expand_all(root, &stack.files)?;
        Ok(DraftStack { id: stack.id, files })
    };
    darks.map(expanded).collect::<Result<_>>().map(Some)
}

/// Finds [`UNKNOWN`] values, each with its line, key and capture.
fn find_placeholders(table: &DeTable<'_>, text: &str, within: &str, found: &mut Vec<Error>) {
    let id = table.iter().find(|(key, _)| key.get_ref() == "id");
    let within = match id.and_then(|(_, value)| value.get_ref().as_str()) {
        Some(id) => format!(", [[capture]] id {id:?}"),
        None => within.to_string(),
    };
    // The source is free text.
    for (key, value) in table.iter().filter(|(key, _)| key.get_ref() != "source") {
        let inner: Vec<&Spanned<DeValue<'_>>> = match value.get_ref() {
            DeValue::Array(list) => list.iter().collect(),
            _ => vec![value],
        };
        for value in inner {
            match value.get_ref() {
                DeValue::Table(table) => find_placeholders(table, text, &within, found),
                DeValue::String(word) if word == UNKNOWN => {
                    let line = toml_text::line_of(text, value.span().start);
                    let unknown = Error::input(format!("{} is not known", key.get_ref()));
                    let place = format!("line {line}{within}");
                    found
                        .push(unknown.at(place).help(format!("replace {UNKNOWN:?} by its value")));
                }
                _ => {}
            }
        }
    }
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
    fn an_unknown_key_is_reported_with_its_line_and_the_nearest_key() {
        let text = format!("{HEAD}whte_level_dn = 4095\n");
        let message = parsed(&text);
        assert!(message.contains("\"whte_level_dn\""), "{message}");
        assert!(message.contains("line 6"), "{message}");
        assert!(message.contains("\"white_level_dn\"?"), "{message}");
    }

    #[test]
    fn placeholders_and_mistakes_are_reported_with_their_lines() {
        let text = "format = \"captures/1\"\n[sensor]\nwidth = 4\nheight = 4\nbits = \"?\"\n\
            cfa = \"?\"\n[[capture]]\nid = \"a\"\nrole = \"?\"\nfiles = \"*\"\n\
            exposure_s = \"?\"\n[[capture]]\nid = \"b\"\nrole = \"dark\"\nfiles = \"*\"\n\
            exposure_s = true\n";
        let message = parsed(text);
        for expected in [
            "5 things to put right",
            "line 5: bits is not known",
            "line 6: cfa is not known",
            "line 9, [[capture]] id \"a\": role is not known",
            "line 11, [[capture]] id \"a\": exposure_s is not known",
            "line 16, key \"exposure_s\" of [[capture]]: exposure_s = true (use a number)",
        ] {
            assert!(message.contains(expected), "{expected}: {message}");
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
        for (files, message) in
            [("[]", "no files"), ("[\"x*\", \"x.npy\"]", "twice"), ("3", "files = 3")]
        {
            assert!(of(files).unwrap_err().to_string().contains(message), "{files}");
        }
    }

    #[test]
    fn wrong_values_are_reported() {
        for (tail, expected) in [
            ("white_level_dn = 5000\n", "does not fit 12 bits"),
            ("black_level_dn = 4095.0\n", "black_level_dn"),
            ("cfa = \"rgb\"\n", "colour filter pattern"),
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
            let message = parsed(&format!("{HEAD}{tail}"));
            assert!(message.contains(expected), "{message}");
        }
        assert_eq!(parsed(HEAD), "0 captures");
        let several = format!(
            "{HEAD}white_levle_dn = 4095\n[[capture]]\nid='a'\nrole='drak'\nfiles='*.npy'\n"
        );
        let message = parsed(&several.replace("bits = 12", "bits = '12'"));
        for (line, word) in [
            (5, "bits"),
            (6, "white_levle_dn"),
            (9, "drak"),
            (7, "\"capture.exposure_s\" is missing"),
        ] {
            let found = message
                .lines()
                .any(|l| l.trim_start().starts_with(&format!("line {line}")) && l.contains(word));
            assert!(found, "{line} {word}: {message}");
        }
        let capture = |id: &str, tail: &str| {
            format!("[[capture]]\nid='{id}'\nrole='dark'\nfiles='*.npy'\n{tail}\n")
        };
        let text = format!(
            "{HEAD}pitch_um = -1\n{}{}",
            capture("a", "exposure_s = -1"),
            capture("a", "exposure_s = 1\npreceded_by = 'b'")
        );
        let message = parsed(&text);
        for word in ["pitch_um = -1", "exposure_s = -1", "used twice", "\"b\" is no capture's id"]
        {
            assert!(message.contains(word), "{word}: {message}");
        }
        assert!(message.contains("line 7, [[capture]] id \"a\": exposure_s = -1"), "{message}");
        assert!(
            parsed("format = \"captures/2\"\n[sensor]\nwidth=1\nheight=1\nbits=8\n")
                .contains("captures/1")
        );
    }
}
