//! Sweep files: the grid of pictures that `camrig batch` makes.
//!
//! ```toml
//! format = "sweep/1"
//! frames = 2                  # of each combination, each with temporal noise of its own
//! files = "dng"               # or tiff, npy, pgm, fits
//!
//! [grid]                      # each key takes a value or a list; numbers also
//!                             # { from, to, count, spacing = "log" }
//! camera = "mt9t012"          # paths are relative to the sweep file
//! scene = ["colorchecker", "slanted-edge:angle=5"]
//! illuminant = ["D65", "A"]
//! lux = [10, 100, 1000]
//! exposure_s = { from = 0.001, to = 0.1, count = 5, spacing = "log" }
//! analog_gain = [1, 8]
//! sensor_seed = [1, 2, 3]     # other physical sensors of the same kind
//!
//! [grid.camera_keys]          # any key of the camera file, with its table
//! "sensor.noise.read_e" = [2.0, 4.0]
//!
//! [figures]                   # these alone, and a table of them, figures.csv; without it, all
//! snr_db = true               # that a scene allows are in its record. Also mean_dn,
//! delta_e_2000 = true         # saturated_fraction, mtf50_cycles_per_pixel
//!
//! [choice]                    # which setting the page of the figures calls the optimum
//! best = "snr_10_lux"         # of the figures, snr_10_lux and mtf50_cycles_per_mm
//! need = { mtf50_cycles_per_mm = 150 }
//! ```
//!
//! Every combination is taken. Their order, slowest first: camera, camera keys (by name), scene,
//! illuminant, lux, exposure, gain, sensor seed, frame. Picture i of the grid has frame number
//! `frame_seed + i`, so no two share temporal noise.

use super::figures::{self, Wanted};
use camrig_base::alternatives::{Alternatives, Numbers};
use camrig_base::{Error, Result, mistakes, toml_text};
use camrig_camera::{Camera, Change, Value, is_preset};
use camrig_light::Illuminant;
use camrig_render::Arithmetic;
use camrig_scene::{self as scene, chart};
use schemars::{JsonSchema, Schema, schema_for};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Most cameras of a sweep. A trade: all of them are loaded and checked before the first picture
/// is made, and a sweep of more is better split.
const MAX_CAMERAS: usize = 100_000;

/// Most pictures of a sweep: frame numbers have 32 bits.
const MAX_PICTURES: u64 = u32::MAX as u64;

/// Kinds of files that a data set may have: those of one frame that keep every sample.
const FILES: [&str; 5] = ["dng", "tiff", "npy", "pgm", "fits"];

/// A grid of pictures. Every combination of the grid's values is taken; their order, slowest
/// first: camera, camera keys (by name), scene, illuminant, lux, exposure, gain, sensor seed,
/// frame. Picture i of the grid has frame number `frame_seed + i`, so no two share temporal noise.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct File {
    /// `"sweep/1"`.
    format: String,
    /// Frames of each combination, each with temporal noise of its own.
    #[serde(default = "one")]
    frames: u32,
    /// Frame number of the first picture.
    #[serde(default)]
    frame_seed: u32,
    /// Kind of file: `dng`, `tiff`, `npy`, `pgm` or `fits`.
    #[serde(default = "dng")]
    files: String,
    /// Arithmetic of the sensor: `f32`, or `fixed` as on parts without a floating-point unit.
    #[serde(default)]
    #[schemars(with = "Option<String>")]
    arith: Arithmetic,
    /// Whether DNG files carry lens shading and bad pixels.
    #[serde(default)]
    opcodes: bool,
    /// Cells per pixel and direction in the optics stage; left out: chosen by error.
    oversample: Option<usize>,
    /// Figures by name, each true or false: `mean_dn`, `saturated_fraction`, `snr_db`,
    /// `dynamic_range_db`, `mtf50_cycles_per_pixel`, `delta_e_2000`. Those named have a table,
    /// figures.csv, and a page; left out: all that a scene allows are in its record.
    figures: Option<BTreeMap<String, bool>>,
    /// Which setting the page of figures calls the optimum.
    choice: Option<Choice>,
    /// The grid.
    grid: GridFile,
}

/// Axes of the grid.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct GridFile {
    /// Presets or camera files, whose paths are relative to the sweep file.
    camera: Alternatives<String>,
    /// Any keys of the camera file, with their table: `"sensor.noise.read_e" = [2.0, 4.0]`.
    #[serde(default)]
    #[schemars(with = "BTreeMap<String, serde_json::Value>")]
    camera_keys: BTreeMap<String, CameraKey>,
    /// Scenes as on the command line.
    scene: Alternatives<String>,
    /// Lights on scenes of reflectance: names or files.
    illuminant: Option<Alternatives<String>>,
    /// Illuminance of the scene, lx.
    lux: Option<Numbers>,
    /// Exposure time, s.
    exposure_s: Numbers,
    /// Gain before the converter; left out: the camera's own.
    analog_gain: Option<Numbers>,
    /// Other physical sensors of the same kind; left out: the camera's own.
    sensor_seed: Option<Alternatives<u64>>,
}

/// A value of the camera file: a number, a word, a list of either, or a range.
#[derive(Deserialize)]
#[serde(untagged)]
enum CameraKey {
    // Before the range, whose fields would be taken from a list in order.
    List(Vec<Value>),
    Range(camrig_base::alternatives::Range),
    One(Value),
}

/// The JSON schema of a sweep file.
pub fn schema() -> Schema {
    schema_for!(File)
}

fn one() -> u32 {
    1
}

fn dng() -> String {
    "dng".into()
}

/// A sweep, checked: every camera loads, every scene opens, every light is known.
#[derive(Debug)]
pub struct Sweep {
    /// The file's text.
    pub text: String,
    /// Extension of the pictures' files.
    pub files: String,
    /// Arithmetic of the sensor stage.
    pub arithmetic: Arithmetic,
    /// Whether DNG files carry lens shading and bad pixels.
    pub opcodes: bool,
    /// Cells per pixel and direction in the optics stage, where it is not chosen by error.
    pub oversample: Option<usize>,
    /// Files and directories that the pictures depend on.
    pub inputs: Vec<PathBuf>,
    /// Figures that records have.
    pub figures: Wanted,
    /// How a setting is chosen by its figures.
    pub choice: Option<Choice>,
    frame_seed: u32,
    frames: u32,
    /// Cameras: what they are called, and what is changed in their files.
    pub variants: Vec<Variant>,
    scenes: Vec<Named>,
    illuminants: Vec<Named>,
    /// Whether the file names illuminants, which scenes of radiance do not take.
    pub names_light: bool,
    lux: Vec<Option<f64>>,
    exposures_s: Vec<f64>,
    gains: Vec<Option<f64>>,
    sensor_seeds: Vec<Option<u64>>,
}

/// Figures that follow from those of records, and may decide a [`Choice`].
const DERIVED: [&str; 2] = ["snr_10_lux", "mtf50_cycles_per_mm"];

/// How a setting is chosen by its figures.
#[derive(Clone, Debug, Deserialize, PartialEq, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Choice {
    /// The figure that is to be best: one of a record that has a better and a worse, `snr_10_lux`
    /// (light at which the SNR is 10) or `mtf50_cycles_per_mm`.
    pub best: String,
    /// What figures must reach: the least of those of which more is better, the most of others.
    #[serde(default)]
    pub need: BTreeMap<String, f64>,
}

impl Choice {
    fn checked(self) -> Result<Self> {
        let known: Vec<&str> = figures::RANKED.into_iter().chain(DERIVED).collect();
        let names = std::iter::once(&self.best).chain(self.need.keys());
        for name in names {
            if !known.contains(&&name[..]) {
                return Err(Error::input(format!("figure {name:?}"))
                    .at("[choice]")
                    .help(toml_text::did_you_mean(name, &known)));
            }
        }
        match self.need.iter().find(|(_, value)| !value.is_finite()) {
            Some((name, value)) => {
                Err(Error::input(format!("{name} = {value}")).at("[choice]").help("give a number"))
            }
            None => Ok(self),
        }
    }
}

/// Endings of tables of spectra; `D5002.78K` has none.
const TABLES: [&str; 5] = ["csv", "txt", "tsv", "spd", "dat"];

/// A scene or a light.
#[derive(Clone, Debug, PartialEq)]
pub struct Named {
    /// As the sweep file names it.
    pub name: String,
    /// As this process finds it.
    pub spec: String,
}

/// A camera of the grid.
#[derive(Clone, Debug)]
pub struct Variant {
    /// As the sweep file names it.
    pub name: String,
    /// What [`Camera::load_with`] takes.
    pub spec: String,
    /// Keys changed.
    pub changes: Vec<Change>,
}

/// One picture of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture<'a> {
    /// Its place in the grid.
    pub index: u64,
    /// Which of [`Sweep::variants`].
    pub variant: usize,
    /// The scene.
    pub scene: &'a Named,
    /// The light on it.
    pub illuminant: &'a Named,
    /// Scene illuminance, lx; `None` where the sweep has none.
    pub lux: Option<f64>,
    /// Integration time, s.
    pub exposure_s: f64,
    /// Analog gain; the camera's own where `None`.
    pub analog_gain: Option<f64>,
    /// Seed of the physical sensor; the camera's own where `None`.
    pub sensor_seed: Option<u64>,
    /// Place in the burst of frames of the combination.
    pub burst: u32,
    /// Names the temporal noise.
    pub frame: u32,
}

impl Sweep {
    /// Reads and checks a sweep file.
    ///
    /// # Errors
    /// Unknown keys, values out of range, cameras, scenes or lights that cannot be.
    pub fn load(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::io("read", path, e))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Self::parse(text, folder).map_err(|e| e.at(path.display()))
    }

    fn parse(text: String, folder: &Path) -> Result<Self> {
        let file: File = mistakes::read(&text)?;
        if file.format != "sweep/1" {
            return Err(Error::unsupported(format!("sweep format {:?}", file.format))
                .help("this program reads format = \"sweep/1\""));
        }
        if !FILES.contains(&file.files.as_str()) {
            return Err(Error::input(format!("files = {:?}", file.files))
                .help(toml_text::did_you_mean(&file.files, &FILES)));
        }
        if file.frames == 0 {
            return Err(Error::input("frames = 0").help("take at least one frame"));
        }
        if file.choice.is_some() && file.figures.is_none() {
            return Err(Error::input("[choice] without [figures]")
                .help("name the figures that decide it in [figures]"));
        }
        let grid = file.grid;
        let mut sweep = Self {
            files: file.files,
            arithmetic: file.arith,
            opcodes: file.opcodes,
            oversample: file.oversample,
            inputs: Vec::new(),
            figures: Wanted::new(file.figures.as_ref())?,
            choice: file.choice.map(Choice::checked).transpose()?,
            frame_seed: file.frame_seed,
            frames: file.frames,
            variants: variants(&grid, folder)?,
            scenes: named(grid.scene.values().map_err(|e| e.at("scene"))?, |name| {
                (!is_chart(name)).then_some(folder)
            }),
            illuminants: match &grid.illuminant {
                Some(names) => named(names.values().map_err(|e| e.at("illuminant"))?, |name| {
                    let ending = name.rsplit_once('.').map(|(_, ending)| ending.to_lowercase());
                    ending.is_some_and(|e| TABLES.contains(&e.as_str())).then_some(folder)
                }),
                None => named(vec!["D65".into()], |_| None),
            },
            names_light: grid.illuminant.is_some(),
            lux: optional("lux", grid.lux.as_ref())?,
            exposures_s: positive("exposure_s", &grid.exposure_s)?,
            gains: optional("analog_gain", grid.analog_gain.as_ref())?,
            sensor_seeds: match &grid.sensor_seed {
                Some(seeds) => seeds
                    .values()
                    .map_err(|e| e.at("sensor_seed"))?
                    .into_iter()
                    .map(Some)
                    .collect(),
                None => vec![None],
            },
            text,
        };
        sweep.check()?;
        Ok(sweep)
    }

    /// Opens everything once, finds the files behind it, and counts.
    fn check(&mut self) -> Result<()> {
        let mut wrong = Vec::new();
        for variant in &self.variants {
            let camera = match Camera::load_with(&variant.spec, &variant.changes) {
                Ok(camera) => camera,
                Err(e) => {
                    wrong.push(e);
                    continue;
                }
            };
            if !is_preset(&variant.spec) {
                self.inputs.push(variant.spec.clone().into());
                let home = Path::new(&variant.spec).parent().unwrap_or(Path::new(""));
                self.inputs.extend(files_named(&camera.text, home));
            }
        }
        for scene in &self.scenes {
            let opened = match camrig_scene_files::open(&scene.spec) {
                Ok(opened) => opened,
                Err(e) => {
                    wrong.push(e.at("scene"));
                    continue;
                }
            };
            let own_light = opened.quantity() == scene::Quantity::Radiance;
            if own_light && self.names_light {
                wrong.push(
                    Error::input(format!("an illuminant for the scene {:?}", scene.name)).help(
                        "it holds radiance, light included; leave illuminant out (lux scales it)",
                    ),
                );
            }
            if !is_chart(&scene.name) {
                self.inputs.extend(existing(&scene.spec));
            }
        }
        for light in &self.illuminants {
            wrong.extend(Illuminant::parse(&light.spec).err().map(|e| e.at("illuminant")));
            let path = PathBuf::from(&light.spec);
            self.inputs.extend(path.is_file().then_some(path));
        }
        if !wrong.is_empty() {
            return Err(mistakes::all(wrong));
        }
        self.inputs.sort();
        self.inputs.dedup();
        let total = self.radices().iter().try_fold(1u64, |n, &r| n.checked_mul(r as u64));
        if total.is_none_or(|n| n > MAX_PICTURES) {
            return Err(Error::limit("a grid of too many pictures")
                .help(format!("at most {MAX_PICTURES}; split it into several sweeps")));
        }
        Ok(())
    }

    /// Sides of the grid, slowest first.
    fn radices(&self) -> [usize; 8] {
        [
            self.variants.len(),
            self.scenes.len(),
            self.illuminants.len(),
            self.lux.len(),
            self.exposures_s.len(),
            self.gains.len(),
            self.sensor_seeds.len(),
            self.frames as usize,
        ]
    }

    /// Pictures in all.
    pub fn pictures(&self) -> u64 {
        self.radices().iter().map(|&r| r as u64).product()
    }

    /// Picture `index` of the grid.
    pub fn picture(&self, index: u64) -> Picture<'_> {
        let mut at = [0; 8];
        let mut rest = index;
        for (digit, &radix) in at.iter_mut().zip(&self.radices()).rev() {
            *digit = (rest % radix as u64) as usize;
            rest /= radix as u64;
        }
        let [variant, scene, light, lux, exposure, gain, seed, burst] = at;
        Picture {
            index,
            variant,
            scene: &self.scenes[scene],
            illuminant: &self.illuminants[light],
            lux: self.lux[lux],
            exposure_s: self.exposures_s[exposure],
            analog_gain: self.gains[gain],
            sensor_seed: self.sensor_seeds[seed],
            burst: burst as u32,
            frame: self.frame_seed.wrapping_add(index as u32),
        }
    }

    /// The level of light at which the optics stage is run for all levels.
    pub fn base_lux(&self) -> Option<f64> {
        self.lux[0]
    }
}

impl Picture<'_> {
    /// Whether two pictures share the optics stage.
    pub fn same_view(&self, other: &Self) -> bool {
        (self.variant, self.scene, self.illuminant)
            == (other.variant, other.scene, other.illuminant)
    }
}

/// Every camera with every combination of changed keys.
fn variants(grid: &GridFile, folder: &Path) -> Result<Vec<Variant>> {
    let mut variants = Vec::new();
    for name in grid.camera.values().map_err(|e| e.at("camera"))? {
        let beside = || folder.join(&name).to_string_lossy().into_owned();
        let spec = if is_preset(&name) { name.clone() } else { beside() };
        variants.push(Variant { spec, changes: Vec::new(), name });
    }
    for (key, values) in &grid.camera_keys {
        let values: Vec<Value> = match values {
            CameraKey::One(value) => Ok(vec![value.clone()]),
            CameraKey::List(values) if values.is_empty() => {
                Err(Error::input("an empty list").help("give one value or more"))
            }
            CameraKey::List(values) => Ok(values.clone()),
            CameraKey::Range(range) => {
                let numbers = Numbers::Range(range.clone()).values();
                numbers.map(|numbers| numbers.into_iter().map(Value::from).collect())
            }
        }
        .map_err(|e| e.at(format!("camera key {key:?}")))?;
        if variants.len().saturating_mul(values.len()) > MAX_CAMERAS {
            return Err(
                Error::limit(format!("more than {MAX_CAMERAS} cameras")).help("split the sweep")
            );
        }
        let with = |variant: &Variant, value: &Value| {
            let mut variant = variant.clone();
            variant.changes.push(Change::new(key, value.clone()));
            variant
        };
        variants = variants
            .iter()
            .flat_map(|variant| values.iter().map(|value| with(variant, value)))
            .collect();
    }
    Ok(variants)
}

fn positive(key: &str, numbers: &Numbers) -> Result<Vec<f64>> {
    let values = numbers.values().map_err(|e| e.at(key))?;
    match values.iter().find(|&&v| !(v > 0.0)) {
        Some(v) => Err(Error::input(format!("{key} = {v}")).help("use values above zero")),
        None => Ok(values),
    }
}

fn optional(key: &str, numbers: Option<&Numbers>) -> Result<Vec<Option<f64>>> {
    match numbers {
        Some(numbers) => Ok(positive(key, numbers)?.into_iter().map(Some).collect()),
        None => Ok(vec![None]),
    }
}

/// Names with where they are found: in a folder, or by themselves.
fn named<'a>(names: Vec<String>, folder: impl Fn(&str) -> Option<&'a Path>) -> Vec<Named> {
    let found = |name: String| {
        let in_folder = folder(&name).map(|f| f.join(&name).to_string_lossy().into_owned());
        Named { spec: in_folder.unwrap_or_else(|| name.clone()), name }
    };
    names.into_iter().map(found).collect()
}

fn is_chart(scene: &str) -> bool {
    chart::NAMES.contains(&scene.split(':').next().unwrap_or(scene))
}

/// The file or directory of a scene, if it is one, with its sidecars.
fn existing(scene: &str) -> Vec<PathBuf> {
    let path = match scene.rsplit_once(':') {
        Some((path, _)) if !Path::new(scene).exists() => Path::new(path),
        _ => Path::new(scene),
    };
    let beside = ["toml", "img", "dat", "raw", ""].map(|e| path.with_extension(e));
    let all = std::iter::once(path.to_path_buf()).chain(beside);
    all.filter(|p| p.exists()).collect()
}

/// Files that the strings of a camera file name.
fn files_named(text: &str, folder: &Path) -> Vec<PathBuf> {
    fn strings(value: &toml::Value, found: &mut Vec<String>) {
        match value {
            toml::Value::String(s) => found.push(s.clone()),
            toml::Value::Array(values) => values.iter().for_each(|v| strings(v, found)),
            toml::Value::Table(table) => table.values().for_each(|v| strings(v, found)),
            _ => {}
        }
    }
    let mut found = Vec::new();
    if let Ok(table) = toml::from_str::<toml::Table>(text) {
        strings(&toml::Value::Table(table), &mut found);
    }
    let named = found.iter().filter(|s| !s.is_empty()).map(|s| folder.join(s));
    named.filter(|p| p.is_file() || p.is_dir() && p.file_name().is_some()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: &str = "format = 'sweep/1'\nframes = 2\n[grid]\ncamera = 'mt9t012'\n\
        scene = ['colorchecker', 'ramp']\nlux = [10, 100]\nexposure_s = 0.01\n\
        [grid.camera_keys]\n'sensor.noise.read_e' = [3.0, 5.0]\n";

    fn said(text: &str) -> String {
        Sweep::parse(text.into(), Path::new("")).unwrap_err().to_string()
    }

    #[test]
    fn every_combination_once_slowest_first() {
        let sweep = Sweep::parse(GRID.into(), Path::new("")).unwrap();
        assert_eq!(sweep.pictures(), 16);
        let all: Vec<_> = (0..16).map(|i| sweep.picture(i)).collect();
        for (i, a) in all.iter().enumerate() {
            assert_eq!((a.index, a.frame), (i as u64, i as u32));
            let key = |p: &Picture<'_>| (p.variant, p.scene.name.clone(), p.lux, p.burst);
            assert!(all[..i].iter().all(|b| key(b) != key(a)));
        }
        assert_eq!((all[1].burst, all[2].lux, &*all[4].scene.name), (1, Some(100.0), "ramp"));
        assert_eq!((all[7].variant, all[8].variant), (0, 1));
        assert!(all[3].same_view(&all[0]) && !all[4].same_view(&all[3]));
    }

    /// A list of three numbers is three values, and not a range with the third as its count.
    #[test]
    fn lists_of_camera_keys_are_their_values() {
        for (list, last) in [("[3.5, 4, 6]", 6), ("[3, 4, 5]", 5)] {
            let sweep = Sweep::parse(GRID.replace("[3.0, 5.0]", list), Path::new("")).unwrap();
            assert_eq!(sweep.variants.len(), 3, "{list}");
            assert_eq!(sweep.variants[2].changes[0].value, Value::from(last));
        }
        let range = GRID.replace("[3.0, 5.0]", "{ from = 3, to = 7, count = 5 }");
        assert_eq!(Sweep::parse(range, Path::new("")).unwrap().variants.len(), 5);
    }

    #[test]
    fn wrong_sweeps_are_refused_before_any_work() {
        assert!(said(&GRID.replace("lux", "luxx")).contains("luxx"));
        assert!(said(&GRID.replace("[10, 100]", "[10, -1]")).contains("lux = -1"));
        assert!(said(&GRID.replace("'ramp'", "'rump'")).contains("rump"));
        assert!(said(&GRID.replace("read_e", "raed_e")).contains("raed_e"));
        assert!(said(&GRID.replace("frames = 2", "frames = 0")).contains("frames"));
        assert!(said(&GRID.replace("frames = 2", "files = 'jpeg'")).contains("jpeg"));
        assert!(said(&GRID.replace("sweep/1", "sweep/9")).contains("sweep/9"));
        let huge = GRID.replace("[10, 100]", "{ from = 1, to = 2, count = 100000 }");
        let huge = huge.replace("0.01", "{ from = 1, to = 2, count = 100000 }");
        assert!(said(&huge).contains("too many"));
    }
}
