//! The keys of a camera file with meaning, unit and range, for documentation and editors.
//!
//! Keys of effects are in the catalogue of effects ([`super::EffectKind`]).

use super::SensorTiming;
use camrig_base::Error;

/// The type of a key's value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Holds {
    /// A number within limits.
    Number(f64, f64),
    /// A whole number within limits.
    Whole(u64, u64),
    /// A number within limits, or the name of a file.
    NumberOrFile(f64, f64),
    /// The name of a file or directory, relative to the camera file.
    File,
    /// One of some words.
    Word(&'static [&'static str]),
    /// One of some words, or the name of a file.
    WordOrFile(&'static [&'static str]),
    /// Text.
    Text,
    /// A text or a list of texts.
    Texts,
    /// A whole number from 1, or a name.
    NumberOrName,
}

/// A key.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// Its table: empty at the top, `lens`, `sensor`, `sensor.timing` or `sensor.noise`.
    pub table: &'static str,
    /// Its name.
    pub name: &'static str,
    /// Type and range of its value.
    pub holds: Holds,
    /// Unit; empty where it has none.
    pub unit: &'static str,
    /// Meaning.
    pub doc: &'static str,
    /// Usual values of real cameras; empty where there are none.
    pub usual: &'static str,
    /// Value where the key is left out; `None` for a key that must be given.
    pub default: Option<&'static str>,
}

impl Key {
    /// The key of a path such as `sensor.noise.read_e`.
    #[must_use]
    pub fn of(path: &str) -> Option<&'static Self> {
        KEYS.iter().find(|key| key.path() == path)
    }

    /// The first sentence of its meaning, without the full stop.
    #[must_use]
    pub fn summary(&self) -> &'static str {
        self.doc.split_once(". ").map_or(self.doc, |(first, _)| first).trim_end_matches('.')
    }

    /// What its value may be, such as `number, 8 to 16 bits`.
    #[must_use]
    pub fn range(&self) -> String {
        let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
        match self.holds {
            Holds::Number(low, high) => format!("number, {low} to {high}{unit}"),
            Holds::Whole(low, high) => format!("whole number, {low} to {high}{unit}"),
            Holds::NumberOrFile(low, high) => format!("number, {low} to {high}{unit}, or a file"),
            Holds::File => "file".into(),
            Holds::Word(words) => format!("one of {}", words.join(", ")),
            Holds::WordOrFile(words) => format!("{}, or a file", words.join(", ")),
            Holds::Text => "text".into(),
            Holds::Texts => "text, or a list of texts".into(),
            Holds::NumberOrName => "whole number from 1, or a name".into(),
        }
    }

    /// Whether a value has the type and lies in the range that [`Key::range`] tells.
    #[must_use]
    pub fn takes(&self, value: &toml::Value) -> bool {
        let number = value.as_float().or(value.as_integer().map(|i| i as f64));
        let within = |low, high| number.is_some_and(|v| (low..=high).contains(&v));
        match self.holds {
            Holds::Number(low, high) => within(low, high),
            Holds::Whole(low, high) => value.is_integer() && within(low as f64, high as f64),
            Holds::NumberOrFile(low, high) => value.is_str() || within(low, high),
            Holds::File | Holds::Text | Holds::WordOrFile(_) => value.is_str(),
            Holds::Word(words) => value.as_str().is_some_and(|word| words.contains(&word)),
            Holds::Texts => value.is_str() || value.is_array(),
            Holds::NumberOrName => value.is_str() || within(1.0, f64::INFINITY),
        }
    }

    /// Path, unit and usual values, such as `sensor.height in pixels, usually 480 to 6000`.
    pub(crate) fn with_usual(&self) -> String {
        let unit = if self.unit.is_empty() { String::new() } else { format!(" in {}", self.unit) };
        let usual = match (self.holds, self.usual) {
            (Holds::Word(words), "") => format!(", one of {}", words.join(", ")),
            (_, "") => String::new(),
            (_, usual) => format!(", usually {usual}"),
        };
        format!("{}{unit}{usual}", self.path())
    }

    /// Table and name, such as `sensor.noise.read_e`.
    pub fn path(&self) -> String {
        match self.table {
            "" => self.name.to_string(),
            table => format!("{table}.{}", self.name),
        }
    }
}

const fn key(
    table: &'static str,
    name: &'static str,
    holds: Holds,
    unit: &'static str,
    default: Option<&'static str>,
    usual: &'static str,
    doc: &'static str,
) -> Key {
    Key { table, name, holds, unit, doc, usual, default }
}

use Holds::{File, Number, NumberOrFile, NumberOrName, Text, Texts, Whole, Word, WordOrFile};

const SIDE: u64 = camrig_sensor_core::config::MAX_SIDE as u64;
const SIGNAL_E: f64 = camrig_sensor_core::arith::MAX_SIGNAL_E as f64;
/// Distances in front of a lens, mm: from a micrometre to infinity.
pub(crate) const DISTANCES_MM: (f64, f64) = (1e-3, f64::INFINITY);
/// Ways of the sensor along the axis, mm: more than the longest camera lens.
pub(crate) const SHIFTS_MM: (f64, f64) = (-1e3, 1e3);
/// Radii of a stop, mm: a micrometre to ten metres.
pub(crate) const STOP_RADII_MM: (f64, f64) = (1e-3, 1e4);
/// Wavelengths that a lens may be made for, nm: far ultraviolet to far infrared.
pub(crate) const WAVELENGTHS_NM: (f64, f64) = (100.0, 20_000.0);
/// Spatial frequencies on the sensor, cycles/mm: up to the cut-off of f/0.5 in the blue.
pub(crate) const FREQUENCIES_PER_MM: (f64, f64) = (1e-2, 5000.0);
/// Default of keys that only some kinds of lens need.
const BY_KIND: Option<&str> = Some("needed or not after lens.kind");

/// Every key, in the order of a camera file.
pub const KEYS: &[Key] = &[
    key(
        "",
        "name",
        Text,
        "",
        Some("the file's name"),
        "",
        "Name of the camera in raw files and reports.",
    ),
    key(
        "lens",
        "kind",
        Word(&["diffraction-limited", "characterised", "prescription"]),
        "",
        None,
        "",
        "How the lens is described: key parameters of an aberration-free lens, a measured or \
         exported grid of figures and PSFs, or a prescription that is ray-traced.",
    ),
    key(
        "lens",
        "f_number",
        Number(0.5, 128.0),
        "",
        BY_KIND,
        "1.4 to 16",
        "Focal length over entrance pupil diameter; sets exposure and diffraction \
         (diffraction-limited).",
    ),
    key(
        "lens",
        "focal_length_mm",
        Number(0.1, 10_000.0),
        "mm",
        BY_KIND,
        "2 to 8 in phones, 4 to 50 in machine vision",
        "Focal length (diffraction-limited).",
    ),
    key(
        "lens",
        "magnification",
        Number(0.0, 100.0),
        "",
        Some("0"),
        "0 for distant scenes",
        "Image size over object size, |m| of the camera equation; 0 is an object at infinity \
         (diffraction-limited).",
    ),
    key(
        "lens",
        "transmittance",
        NumberOrFile(0.0, 1.0),
        "",
        Some("1"),
        "0.85 to 0.98",
        "Fraction of light that gets through: a number, or a CSV of wavelength_nm,transmittance.",
    ),
    key(
        "lens",
        "relative_illumination",
        WordOrFile(&["cos4", "none"]),
        "",
        Some("cos4"),
        "",
        "Fall-off towards the corner: the cos⁴ law, none, or a CSV of field,ratio with field 0 at \
         the axis and 1 at the corner (diffraction-limited).",
    ),
    key("lens", "data", File, "", BY_KIND, "", "Directory or file of a characterised lens."),
    key("lens", "file", File, "", BY_KIND, "", "Prescription: .zmx, CODE V .seq, or .toml."),
    key(
        "lens",
        "object_distance_mm",
        Number(DISTANCES_MM.0, DISTANCES_MM.1),
        "mm",
        Some("that of the file"),
        "",
        "Distance of the scene in front of the first surface; inf is allowed (prescription).",
    ),
    key(
        "lens",
        "focus_distance_mm",
        Number(DISTANCES_MM.0, DISTANCES_MM.1),
        "mm",
        Some("the sensor is where the file has the image"),
        "",
        "Focuses at this distance: the sensor moves as the paraxial image does from the file's \
         object to one there; inf is allowed (prescription).",
    ),
    key(
        "lens",
        "focus_mtf_per_mm",
        Number(FREQUENCIES_PER_MM.0, FREQUENCIES_PER_MM.1),
        "cycles/mm",
        Some("the sensor is where the file has the image"),
        "20 to 100",
        "Focuses where the MTF on the axis at this frequency is largest, in the mean over the \
         file's wavelengths (prescription).",
    ),
    key(
        "lens",
        "sensor_shift_mm",
        Number(SHIFTS_MM.0, SHIFTS_MM.1),
        "mm",
        Some("0"),
        "",
        "Moves the sensor away from the lens, from where focus puts it (prescription).",
    ),
    key(
        "lens",
        "stop_radius_mm",
        Number(STOP_RADII_MM.0, STOP_RADII_MM.1),
        "mm",
        Some("from the file's aperture"),
        "",
        "Radius of the stop (prescription).",
    ),
    key(
        "lens",
        "reference_nm",
        Number(WAVELENGTHS_NM.0, WAVELENGTHS_NM.1),
        "nm",
        Some("that of the file"),
        "",
        "Wavelength of paraxial figures and of the stop's radius (prescription).",
    ),
    key(
        "lens",
        "configuration",
        NumberOrName,
        "",
        Some("the active one"),
        "",
        "Configuration of a file with several, by number from 1 or by title (prescription).",
    ),
    key(
        "lens",
        "glass",
        Texts,
        "",
        Some("none"),
        "",
        "Glasses that no catalogue has, as NAME=n_d:V_d (prescription).",
    ),
    key(
        "lens",
        "glass_catalogue",
        Texts,
        "",
        Some("those beside the file"),
        "",
        "Glass catalogues (.agf), or folders of them, before those beside the file \
         (prescription).",
    ),
    key("sensor", "width", Whole(1, SIDE), "pixels", None, "640 to 8000", "Pixels in a row."),
    key("sensor", "height", Whole(1, SIDE), "pixels", None, "480 to 6000", "Rows."),
    key(
        "sensor",
        "pitch_um",
        Number(0.1, 1000.0),
        "µm",
        None,
        "0.6 to 2 in phones, 2 to 10 elsewhere",
        "Distance of neighbouring pixels.",
    ),
    key(
        "sensor",
        "fill_factor",
        Number(0.001, 1.0),
        "",
        None,
        "0.3 to 0.6 without microlenses, 0.8 to 1 with",
        "Effective photosensitive area over pitch².",
    ),
    key(
        "sensor",
        "cfa",
        Text,
        "",
        None,
        "RGGB, GRBG, GBRG, BGGR, mono",
        "Colour filter pattern: the top-left 2 x 2 pixels row by row, mono, or rows of letters \
         parted by slashes.",
    ),
    key(
        "sensor",
        "qe",
        NumberOrFile(0.0, 1.0),
        "electrons per photon",
        None,
        "0.3 to 0.8 at the peak",
        "Quantum efficiency with the colour filter: a number, or a CSV of wavelength_nm,r,g,b (or \
         gr,gb apart, one column for mono, a column per letter of the pattern). Straight lines \
         join its points, at most 100 nm apart; outside them it is zero, or held where the CSV has \
         a line `# outside: held`.",
    ),
    key(
        "sensor",
        "qe_peak",
        Number(0.001, 1.0),
        "electrons per photon",
        Some("the table's values as they are"),
        "0.4 to 0.95",
        "Largest quantum efficiency: scales the table of qe, which may be relative, so that its \
         largest value is this.",
    ),
    key(
        "sensor",
        "ir_cut",
        File,
        "",
        Some("none"),
        "",
        "Infrared cut filter: CSV of wavelength_nm,transmittance; outside its wavelengths as for \
         qe.",
    ),
    key(
        "sensor",
        "crosstalk",
        File,
        "",
        Some("none"),
        "",
        "Positional crosstalk: CSV of channel,wavelength_nm,x,y,factor with x, y in -1..1 over \
         the sensor and factors relative to the centre.",
    ),
    key(
        "sensor",
        "conversion_gain_uv_per_e",
        Number(0.001, 10_000.0),
        "µV per electron",
        Some("it cancels in the DN"),
        "20 to 200",
        "Voltage per electron at the sense node. Cancels in the DN: full well and bits set the \
         scale.",
    ),
    key(
        "sensor",
        "full_well_e",
        Number(1.0, SIGNAL_E),
        "e-",
        None,
        "4000 to 10000 at 1 to 2 µm, 10000 to 100000 above 3 µm",
        "Linear full well: the charge at which the converter's range ends at unity gain.",
    ),
    key("sensor", "bits", Whole(8, 16), "bits", None, "10 to 14", "Bits of the converter."),
    key(
        "sensor",
        "black_level_dn",
        Number(0.0, 65_534.0),
        "DN",
        None,
        "1/64 to 1/16 of the range",
        "Mean DN of no signal; below the top of the converter.",
    ),
    key(
        "sensor",
        "analog_gain",
        Number(0.01, 1000.0),
        "",
        Some("1"),
        "1 to 16",
        "Gain before the converter.",
    ),
    key(
        "sensor",
        "temperature_c",
        Number(-100.0, 150.0),
        "°C",
        Some("25"),
        "20 to 60",
        "Temperature of the sensor.",
    ),
    key(
        "sensor",
        "seed",
        Whole(0, i64::MAX as u64),
        "",
        Some("1"),
        "",
        "Names the physical sensor: fixes every fixed pattern.",
    ),
    key(
        "sensor.timing",
        "line_time_us",
        Number(0.1, 10_000.0),
        "µs",
        Some("needed where the table is given: without it a frame is one moment"),
        "5 to 40",
        "Time from one row to the next. Exposure, skew and frame rate follow from it; the rig's \
         register 0x3000 holds it in ns.",
    ),
    key(
        "sensor.timing",
        "frame_length_lines",
        Whole(1, 65_535),
        "lines",
        Some("the rows"),
        "1.02 to 1.5 times the rows",
        "Lines of a frame, those without pixels included: the frame period over the line time. A \
         longer exposure makes a longer frame. The rig's register 0x0340.",
    ),
    key(
        "sensor.timing",
        "shutter",
        Word(&SensorTiming::SHUTTERS),
        "",
        Some("rolling"),
        "",
        "Whether rows collect light one after the other, or all at once.",
    ),
    key(
        "sensor.timing",
        "direction",
        Word(&SensorTiming::DIRECTIONS),
        "",
        Some("down"),
        "",
        "Which row is read first: the top one (down) or the bottom one (up).",
    ),
    key(
        "sensor.noise",
        "read_e",
        Number(0.0, 1e5),
        "e-",
        None,
        "1 to 10",
        "Read noise at unity gain, input-referred, standard deviation.",
    ),
    key(
        "sensor.noise",
        "read_e_post",
        Number(0.0, 1e5),
        "e-",
        Some("0"),
        "0 to all of read_e",
        "The part of it that comes after the gain stage; referred to the input it falls as \
         1/gain. At most read_e.",
    ),
    key(
        "sensor.noise",
        "dark_current_e_per_s",
        Number(0.0, 1e6),
        "e-/s",
        None,
        "1 to 100 at 25 °C",
        "Mean dark current at temperature_ref_c.",
    ),
    key(
        "sensor.noise",
        "dark_doubling_c",
        Number(1.0, 100.0),
        "K",
        Some("7"),
        "6 to 9",
        "Rise of temperature that doubles the dark current.",
    ),
    key(
        "sensor.noise",
        "temperature_ref_c",
        Number(-100.0, 150.0),
        "°C",
        Some("25"),
        "",
        "Temperature for which the dark current holds.",
    ),
    key(
        "sensor.noise",
        "dsnu_e_per_s",
        Number(0.0, 1e6),
        "e-/s",
        Some("0"),
        "0.1 to 1 of the dark current",
        "Dark signal non-uniformity: standard deviation over pixels of the dark current.",
    ),
    key(
        "sensor.noise",
        "prnu",
        Number(0.0, 0.14),
        "",
        None,
        "0.005 to 0.02",
        "Photo response non-uniformity: standard deviation over pixels of the gain, mean 1.",
    ),
    key(
        "sensor.noise",
        "row_fpn_e",
        Number(0.0, 1e5),
        "e-",
        Some("half of read_e"),
        "0.1 to 1 of read_e",
        "Row-wise fixed pattern, standard deviation over rows.",
    ),
];

/// The keys that a lens of each kind needs.
const OF_LENS: [(&str, &[&str]); 3] = [
    ("diffraction-limited", &["f_number", "focal_length_mm"]),
    ("characterised", &["data"]),
    ("prescription", &["file"]),
];

/// All keys that must be in the text of a camera file and are not, with units and usual values;
/// `None` where none is missing or the text is no TOML.
pub(crate) fn missing(text: &str) -> Option<Error> {
    let file: toml::Table = toml::from_str(text).ok()?;
    let given = |key: &Key| {
        let mut table = key.table.split('.').filter(|t| !t.is_empty());
        let found = table.try_fold(&file, |table, name| table.get(name)?.as_table());
        found.is_some_and(|table| table.contains_key(key.name))
    };
    let kind = file.get("lens").and_then(|lens| lens.get("kind")?.as_str());
    let kind = kind.unwrap_or("diffraction-limited");
    let of_lens = OF_LENS.iter().find(|(of, _)| *of == kind).map_or(&[][..], |(_, keys)| *keys);
    let needed =
        |key: &Key| key.default.is_none() || key.table == "lens" && of_lens.contains(&key.name);
    let missing: Vec<&Key> = KEYS.iter().filter(|key| needed(key) && !given(key)).collect();
    (!missing.is_empty()).then(|| {
        are_missing(&missing).help(
            "`camrig camera new` writes a whole camera file, and `camrig explain` says what the \
             keys mean",
        )
    })
}

/// Some keys are missing, with units and usual values.
pub(crate) fn are_missing(keys: &[&Key]) -> Error {
    let (what, are) = if keys.len() == 1 { ("key", "is") } else { ("keys", "are") };
    let keys: Vec<String> = keys.iter().map(|key| key.with_usual()).collect();
    Error::input(format!("{what} {are} missing:\n  {}", keys.join("\n  ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Camera, presets};

    /// What the reader of camera files accepts, from its own words about an unknown key.
    fn accepted(table: &str) -> Vec<String> {
        let text = presets::file("mt9t012.toml").unwrap();
        let header = format!("[{table}]\n");
        let text = match table {
            "" => format!("xyzzy = 1\n{text}"),
            _ if !text.contains(&header) => format!("{text}\n{header}xyzzy = 1\n"),
            _ => text.replacen(&header, &format!("{header}xyzzy = 1\n"), 1),
        };
        let error = toml::from_str::<crate::file::CameraFile>(&text).unwrap_err();
        let words = error.message().split('`').skip(1).step_by(2);
        words.map(String::from).filter(|w| w != "xyzzy").collect()
    }

    #[test]
    fn the_keys_are_those_that_a_camera_file_may_have() {
        for (table, sub_tables) in [
            ("", &["lens", "sensor", "effect"][..]),
            ("lens", &[]),
            ("sensor", &["timing", "noise"]),
            ("sensor.timing", &[]),
            ("sensor.noise", &[]),
        ] {
            let mut known: Vec<String> =
                KEYS.iter().filter(|k| k.table == table).map(|k| k.name.to_string()).collect();
            known.extend(sub_tables.iter().map(|t| t.to_string()));
            let mut accepted = accepted(table);
            known.sort();
            accepted.sort();
            assert_eq!(known, accepted, "[{table}]");
        }
    }

    #[test]
    fn the_ranges_are_those_that_are_checked() {
        let with = |key: &Key, value: toml::Value| {
            Camera::load_with("mt9t012", &[(key.path(), value)])
                .map(drop)
                .map_err(|e| e.to_string())
        };
        for key in KEYS {
            let (low, high) = match key.holds {
                Number(low, high) | NumberOrFile(low, high) => (low, high),
                Whole(low, high) if key.name != "seed" => (low as f64, high as f64),
                _ => continue,
            };
            let value = |v: f64| match key.holds {
                Whole(..) => toml::Value::Integer(v as i64),
                _ => toml::Value::Float(v),
            };
            // |m| is taken: its sign says nothing.
            let below = if key.name == "magnification" { low } else { low - 1.0 };
            for outside in [below, high + high.abs().max(1.0)] {
                if outside == low {
                    continue;
                }
                let said =
                    with(key, value(outside)).expect_err(&format!("{} = {outside}", key.path()));
                assert!(said.contains(key.name) || outside < 0.0, "{}: {said}", key.path());
            }
            for inside in [low, high] {
                // Ends that other keys of the preset do not allow.
                let apart = ["read_e_post", "black_level_dn", "read_e"].contains(&key.name);
                // Keys of another kind of lens than the preset's are not looked at.
                let of_other_kind = |said: &str| said.contains("means nothing for kind");
                // Keys of a table that the preset lacks, alone in it.
                let alone = |said: &str| said.contains("is missing");
                if let Err(said) = with(key, value(inside))
                    && !apart
                    && !of_other_kind(&said)
                    && !alone(&said)
                {
                    assert!(!said.contains(&format!("{} =", key.name)), "{}: {said}", key.path());
                }
            }
        }
    }

    #[test]
    fn missing_keys_are_told_at_once_with_unit_and_usual_values() {
        let said = |text: &str| {
            let folder = crate::Folder::BuiltIn;
            Camera::parse(text, "x", &folder).unwrap_err().to_string()
        };
        let text = said("[lens]\nkind = 'diffraction-limited'\n[sensor]\nwidth = 64\nbist = 10\n");
        for key in KEYS.iter().filter(|k| k.default.is_none() && k.table.starts_with("sensor")) {
            assert_eq!(text.contains(&key.path()), key.name != "width", "{}: {text}", key.path());
        }
        assert!(text.contains("lens.f_number, usually 1.4 to 16"), "{text}");
        assert!(text.contains("sensor.height in pixels, usually 480 to 6000"), "{text}");
        assert!(text.contains("line 5: unknown key \"bist\""), "{text}");
        assert!(!text.contains("missing field"), "{text}");
        let traced = said("[lens]\nkind = 'prescription'\n[sensor]\n");
        assert!(traced.contains("lens.file") && !traced.contains("lens.f_number"), "{traced}");
        for preset in presets::NAMES {
            assert!(missing(presets::file(&format!("{preset}.toml")).unwrap()).is_none());
        }
    }
}
