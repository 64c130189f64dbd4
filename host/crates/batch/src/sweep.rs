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
//!
//! [random]                    # other keys of the grid, or of the camera file, at random
//! count = 200                 # draws for each combination of the grid
//! seed = 1
//! [random.keys]
//! scene = { choice = ["photos/*.jpg", "more/"] }
//! lux = { log-range = [10, 1000] }
//! "sensor.noise.read_e" = { range = [2, 4] }
//!
//! [clean]                     # the expected signal beside each frame: NAME.clean.npy
//! unit = "dn"                 # or "e"
//!
//! [labels]                    # labels carried through the lens: NAME.labels.json, NAME.mask.png
//! folder = "labels"           # of scene STEM.jpg: STEM.json (LabelMe), STEM.png (a mask)
//! ```
//!
//! Every combination is taken. Their order, slowest first: camera, camera keys (by name), scene,
//! illuminant, lux, exposure, gain, sensor seed, draw, frame. Picture i of the grid has frame
//! number `frame_seed + i`, so no two share temporal noise.
//!
//! A scene with `*`, `?` or `[` that is no file stands for all files of that pattern, a folder with
//! `/` at its end for all files in it, in order of their names.

use super::draws::{Draw, Random};
use super::figures::{self, Wanted};
use super::labels;
use camrig_base::alternatives::{Alternatives, Numbers};
use camrig_base::{Error, Result, mistakes, toml_text};
use camrig_camera::{Camera, Change, Value, is_preset};
use camrig_light::Illuminant;
use camrig_render::Arithmetic;
use camrig_scene::{self as scene, chart};
use schemars::{JsonSchema, Schema, schema_for};
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Most cameras of a sweep. A trade: all of them are loaded and checked before the first picture
/// is made, and a sweep of more is better split.
const MAX_CAMERAS: usize = 100_000;

/// Most pictures of a sweep: frame numbers have 32 bits.
const MAX_PICTURES: u64 = u32::MAX as u64;

/// Kinds of files that a data set may have: those of one frame that keep every sample.
const FILES: [&str; 5] = ["dng", "tiff", "npy", "pgm", "fits"];

/// A grid of pictures. Every combination of the grid's values is taken; their order, slowest
/// first: camera, camera keys (by name), scene, illuminant, lux, exposure, gain, sensor seed, draw,
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
    /// Pictures in each tar file, as WebDataset reads them; left out: files alone.
    #[schemars(range(min = 1))]
    pictures_per_tar: Option<u32>,
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
    /// The expected signal, before noise and any other effect of the sensor, beside each frame:
    /// `NAME.clean.npy`, 32-bit floating point, neither rounded nor clipped.
    clean: Option<Clean>,
    /// Labels of the scenes' pictures, carried through the lens: `NAME.labels.json`,
    /// `NAME.mask.png`.
    labels: Option<LabelsFile>,
    /// Keys that take values at random.
    #[serde(default)]
    random: Random,
    /// The grid. `scene` and `exposure_s` have to be here or at random.
    grid: GridFile,
}

/// The expected signal.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Clean {
    /// `dn`, the black level included, or `e`, photo-electrons.
    #[serde(default)]
    pub unit: CleanUnit,
}

/// Unit of the expected signal.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq)]
#[serde(rename_all = "lowercase")]
pub enum CleanUnit {
    /// Digital numbers, the black level included.
    #[default]
    Dn,
    /// Photo-electrons.
    E,
}

/// Where labels are.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct LabelsFile {
    /// Folder, relative to the sweep file, with the labels of the scene `STEM.jpg`: `STEM.json`,
    /// shapes as LabelMe writes them, or `STEM.png`, a grey picture with a number for each class.
    folder: PathBuf,
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
    /// Scenes as on the command line, patterns of files (`photos/*.jpg`) and folders of files
    /// (`photos/`).
    scene: Option<Alternatives<String>>,
    /// Lights on scenes of reflectance: names or files.
    illuminant: Option<Alternatives<String>>,
    /// Illuminance of the scene, lx.
    lux: Option<Numbers>,
    /// Exposure time, s.
    exposure_s: Option<Numbers>,
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
    /// Whether pictures have their expected signal beside them, and in what.
    pub clean: Option<Clean>,
    /// Pictures in each tar file, if they are to be in some.
    pub pictures_per_tar: Option<u32>,
    random: Random,
    labels: Option<PathBuf>,
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
    /// Files with the labels of a scene, where the sweep has labels.
    pub labels: Vec<PathBuf>,
}

/// A camera of the grid.
#[derive(Clone, Debug, PartialEq)]
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
    /// The camera.
    pub camera: Variant,
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
        let mut file: File = mistakes::read(&text)?;
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
        file.random.check()?;
        file.grid.with_drawn(&file.random)?;
        let grid = file.grid;
        let labels = file.labels.map(|labels| folder.join(labels.folder));
        let scenes = grid.scene.as_ref().ok_or_else(|| missing("scene"))?;
        let mut sweep = Self {
            files: file.files,
            arithmetic: file.arith,
            opcodes: file.opcodes,
            oversample: file.oversample,
            inputs: Vec::new(),
            figures: Wanted::new(file.figures.as_ref())?,
            choice: file.choice.map(Choice::checked).transpose()?,
            clean: file.clean,
            pictures_per_tar: file.pictures_per_tar,
            frame_seed: file.frame_seed,
            frames: file.frames,
            variants: variants(&grid, folder)?,
            scenes: found_scenes(&scenes.values().map_err(|e| e.at("scene"))?, folder)?,
            illuminants: match &grid.illuminant {
                Some(names) => named(names.values().map_err(|e| e.at("illuminant"))?, |name| {
                    let ending = name.rsplit_once('.').map(|(_, ending)| ending.to_lowercase());
                    ending.is_some_and(|e| TABLES.contains(&e.as_str())).then_some(folder)
                }),
                None => named(vec!["D65".into()], |_| None),
            },
            names_light: grid.illuminant.is_some(),
            lux: optional("lux", grid.lux.as_ref())?,
            exposures_s: positive(
                "exposure_s",
                grid.exposure_s.as_ref().ok_or_else(|| missing("exposure_s"))?,
            )?,
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
            random: file.random,
            labels,
            text,
        };
        sweep.check()?;
        Ok(sweep)
    }

    /// Opens everything once, finds the files behind it, and counts.
    fn check(&mut self) -> Result<()> {
        let mut wrong = Vec::new();
        let total = self.radices().iter().try_fold(1u64, |n, &r| n.checked_mul(r as u64));
        if total.is_none_or(|n| n > MAX_PICTURES) {
            return Err(Error::limit("a grid of too many pictures")
                .help(format!("at most {MAX_PICTURES}; split it into several sweeps")));
        }
        let mut labelled = BTreeSet::new();
        let cameras = self.cameras()?;
        for variant in &cameras {
            let camera = match Camera::load_with(&variant.spec, &variant.changes) {
                Ok(camera) => camera,
                // One of many draws shows what is wrong with the others.
                Err(e) if cameras.len() > self.variants.len() => {
                    wrong.push(e);
                    break;
                }
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
        for scene in &mut self.scenes {
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
            if let Some(folder) = &self.labels {
                match labels::files(folder, path_of(&scene.spec)) {
                    Ok(files) => scene.labels = files,
                    Err(e) => wrong.push(e.at("[labels]")),
                }
                if let Some(shared) = scene.labels.iter().find(|f| !labelled.insert((*f).clone()))
                {
                    wrong.push(
                        Error::input(format!(
                            "{} would be the labels of {:?} and of another scene",
                            shared.display(),
                            scene.name
                        ))
                        .at("[labels]")
                        .help("give the scenes names of their own"),
                    );
                }
                self.inputs.extend(scene.labels.iter().cloned());
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
        Ok(())
    }

    /// Every camera of the sweep: those of the grid, or one for each draw.
    fn cameras(&self) -> Result<Vec<Variant>> {
        if !self.random.draws().any(|(key, _)| is_camera_key(key)) {
            return Ok(self.variants.clone());
        }
        let places = self.pictures() / u64::from(self.frames);
        if places > MAX_CAMERAS as u64 {
            return Err(too_many_cameras());
        }
        let first = |place| self.picture(place * u64::from(self.frames)).camera;
        Ok((0..places).map(first).collect())
    }

    /// Sides of the grid, slowest first.
    fn radices(&self) -> [usize; 9] {
        let side = |key: &str, values: usize| match self.random.get(key) {
            Some(_) => 1,
            None => values,
        };
        [
            self.variants.len(),
            side("scene", self.scenes.len()),
            side("illuminant", self.illuminants.len()),
            side("lux", self.lux.len()),
            side("exposure_s", self.exposures_s.len()),
            side("analog_gain", self.gains.len()),
            side("sensor_seed", self.sensor_seeds.len()),
            self.random.count(),
            self.frames as usize,
        ]
    }

    /// Pictures in all.
    pub fn pictures(&self) -> u64 {
        self.radices().iter().map(|&r| r as u64).product()
    }

    /// Picture `index` of the grid.
    pub fn picture(&self, index: u64) -> Picture<'_> {
        let mut at = [0; 9];
        let mut rest = index;
        for (digit, &radix) in at.iter_mut().zip(&self.radices()).rev() {
            *digit = (rest % radix as u64) as usize;
            rest /= radix as u64;
        }
        let [variant, scene, light, lux, exposure, gain, seed, _, burst] = at;
        // Frames of one burst share their draws.
        let place = index / u64::from(self.frames);
        let drawn = |key: &str| self.random.value(key, place);
        let number = |key: &str| drawn(key).as_ref().and_then(Value::as_f64);
        let one_of = |key: &str, grid: usize, count: usize| match self.random.get(key) {
            Some(_) => self.random.one_of(key, place, count),
            None => grid,
        };
        let mut camera = self.variants[variant].clone();
        for (key, _) in self.random.draws().filter(|(key, _)| is_camera_key(key)) {
            camera.changes.extend(drawn(key).map(|value| Change::new(key, value)));
        }
        Picture {
            index,
            camera,
            scene: &self.scenes[one_of("scene", scene, self.scenes.len())],
            illuminant: &self.illuminants[one_of("illuminant", light, self.illuminants.len())],
            lux: number("lux").or(self.lux[lux]),
            exposure_s: number("exposure_s").unwrap_or(self.exposures_s[exposure]),
            analog_gain: number("analog_gain").or(self.gains[gain]),
            sensor_seed: self.sensor_seeds[one_of("sensor_seed", seed, self.sensor_seeds.len())],
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
        (&self.camera, self.scene, self.illuminant)
            == (&other.camera, other.scene, other.illuminant)
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
            return Err(too_many_cameras());
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

fn missing(key: &str) -> Error {
    Error::input(format!("no {key}")).at("[grid]").help("give it there or in [random.keys]")
}

fn too_many_cameras() -> Error {
    Error::limit(format!("more than {MAX_CAMERAS} cameras")).help("split the sweep")
}

/// Keys of the grid that may be drawn instead. All others that are drawn are of the camera file.
const DRAWN: [&str; 6] =
    ["scene", "illuminant", "lux", "exposure_s", "analog_gain", "sensor_seed"];

fn is_camera_key(key: &str) -> bool {
    !DRAWN.contains(&key)
}

impl GridFile {
    /// The grid with what is drawn in it: all values of a choice, or the ends of a range, which are
    /// checked like those that are listed.
    fn with_drawn(&mut self, random: &Random) -> Result<()> {
        let as_text = |value: &Value| value.as_str().map(str::to_owned);
        let as_whole = |value: &Value| value.to_string().parse::<u64>().ok();
        for (key, draw) in random.draws() {
            let at = |e: Error| e.at(format!("random key {key:?}"));
            let twice = match &key[..] {
                "scene" => fill(&mut self.scene, || listed(draw, "texts", as_text)).map_err(at)?,
                "illuminant" => {
                    fill(&mut self.illuminant, || listed(draw, "texts", as_text)).map_err(at)?
                }
                "lux" => fill(&mut self.lux, || numbers(draw)).map_err(at)?,
                "exposure_s" => fill(&mut self.exposure_s, || numbers(draw)).map_err(at)?,
                "analog_gain" => fill(&mut self.analog_gain, || numbers(draw)).map_err(at)?,
                "sensor_seed" => {
                    fill(&mut self.sensor_seed, || listed(draw, "whole numbers", as_whole))
                        .map_err(at)?
                }
                "camera" => {
                    return Err(at(Error::unsupported("a camera at random"))
                        .help("list cameras in [grid], and draw keys of their files"));
                }
                key => self.camera_keys.contains_key(key),
            };
            if twice {
                return Err(at(Error::input("it is in the grid, too")).help("give it once"));
            }
        }
        Ok(())
    }
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

/// Fills a place that is empty; whether it was not.
fn fill<T>(place: &mut Option<T>, value: impl FnOnce() -> Result<T>) -> Result<bool> {
    Ok(place.replace(value()?).is_some())
}

fn listed<T>(
    draw: &Draw,
    what: &str,
    read: impl Fn(&Value) -> Option<T>,
) -> Result<Alternatives<T>> {
    let Draw::Choice(values) = draw else {
        return Err(Error::input("a range").help(format!("use {{ choice = [{what}, ...] }}")));
    };
    let read = |value| {
        read(value).ok_or_else(|| Error::input(value.to_string()).help(format!("use {what}")))
    };
    Ok(Alternatives::List(values.iter().map(read).collect::<Result<_>>()?))
}

fn numbers(draw: &Draw) -> Result<Numbers> {
    match draw {
        Draw::Range(ends) | Draw::LogRange(ends) => Ok(Numbers::List(ends.to_vec())),
        draw => Ok(Numbers::List(listed(draw, "numbers", Value::as_f64)?.as_slice().to_vec())),
    }
}

/// Scenes as a sweep file names them: patterns and folders stand for the files they have.
fn found_scenes(names: &[String], folder: &Path) -> Result<Vec<Named>> {
    let mut all = Vec::new();
    for name in names {
        let (files, options) = match name.rsplit_once(':') {
            Some((files, options)) if options.contains('=') => (files, format!(":{options}")),
            _ => (&name[..], String::new()),
        };
        let is_pattern = files.contains(['*', '?', '[']) && !folder.join(files).exists();
        if is_chart(name) || !(is_pattern || files.ends_with('/')) {
            all.push(name.clone());
            continue;
        }
        let wrong = |why: String| Error::input(why).at(format!("scene {name:?}"));
        let inside = glob::Pattern::escape(&folder.to_string_lossy());
        let pattern = Path::new(&inside).join(files).join(if is_pattern { "" } else { "*" });
        let pattern = pattern.to_string_lossy();
        let found = glob::glob(pattern.trim_end_matches('/')).map_err(|e| wrong(e.to_string()))?;
        let before = all.len();
        for path in found {
            let path = path.map_err(|e| wrong(e.to_string()))?;
            let name = path.strip_prefix(folder).unwrap_or(&path).to_string_lossy();
            if path.is_file() {
                all.push(format!("{name}{options}"));
            }
        }
        if all.len() == before {
            return Err(wrong("no files".into()).help("patterns are relative to the sweep file"));
        }
    }
    Ok(named(all, |name| (!is_chart(name)).then_some(folder)))
}

/// Names with where they are found: in a folder, or by themselves.
fn named<'a>(names: Vec<String>, folder: impl Fn(&str) -> Option<&'a Path>) -> Vec<Named> {
    let found = |name: String| {
        let in_folder = folder(&name).map(|f| f.join(&name).to_string_lossy().into_owned());
        Named { spec: in_folder.unwrap_or_else(|| name.clone()), name, labels: Vec::new() }
    };
    names.into_iter().map(found).collect()
}

fn is_chart(scene: &str) -> bool {
    chart::NAMES.contains(&scene.split(':').next().unwrap_or(scene))
}

/// The file or directory of a scene without its options.
fn path_of(scene: &str) -> &Path {
    match scene.rsplit_once(':') {
        Some((path, _)) if !Path::new(scene).exists() => Path::new(path),
        _ => Path::new(scene),
    }
}

/// The file or directory of a scene, if it is one, with its sidecars.
fn existing(scene: &str) -> Vec<PathBuf> {
    let path = path_of(scene);
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
            let key =
                |p: &Picture<'_>| (p.camera.changes.clone(), p.scene.name.clone(), p.lux, p.burst);
            assert!(all[..i].iter().all(|b| key(b) != key(a)));
        }
        assert_eq!((all[1].burst, all[2].lux, &*all[4].scene.name), (1, Some(100.0), "ramp"));
        let read_e = |i: usize| all[i].camera.changes[0].value.as_f64();
        assert_eq!((read_e(7), read_e(8)), (Some(3.0), Some(5.0)));
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
