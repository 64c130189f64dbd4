//! Scenes in files: spectral cubes, photographs and renders, stored scenes and libraries of them,
//! and sequences of these, as [`Scene`]s of `camrig-scene`.
//!
//! [`open`] finds a scene by its name: a built-in chart ([`chart`]), a spectral cube in a file
//! (NumPy, ENVI, MATLAB, HDF5, OpenEXR, TIFF), a picture of red, green and blue, whose spectra are
//! estimated, a folder of pictures, one per band, or a stored scene ([`stored`]);
//! [`sequence::open`] finds scenes that change with time.
//!
//! ```
//! use camrig_scene::{Bands, Grid};
//!
//! // A cube of two rows, three columns and 31 bands, as NumPy saves it.
//! let folder = tempfile::tempdir()?;
//! let file = folder.path().join("ramp.npy");
//! let samples: Vec<f32> = (0..2 * 3 * 31).map(|i| (i / 31) as f32 / 5.0).collect();
//! camrig_base::npy::write(&mut std::fs::File::create(&file)?, "(2, 3, 31)", &samples)?;
//! let options = "axes=yxb,start_nm=400,step_nm=10";
//! let scene = camrig_scene_files::open(&format!("{}:{options}", file.display()))?;
//! assert_eq!(scene.bands(), Bands::VISIBLE);
//!
//! let frame = Grid { width: 3, height: 2, left: -0.5, top: -1.0 / 3.0, cell: 1.0 / 3.0 };
//! let reflectance = scene.plane(0, &frame)?;
//! assert_eq!(reflectance.data, [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod arrays;
pub mod envi;
mod envi_header;
mod exr;
mod hdf5;
mod images;
pub mod isetcam;
pub mod library;
mod matlab;
mod matlab_write;
pub mod numpy;
mod rgb;
pub mod sequence;
mod sidecar;
pub mod stored;
pub mod strided;
mod tiff_tags;
mod units;

use camrig_base::{Error, ErrorCode, Result};
use camrig_scene::{Bands, Beyond, Components, Quantity, Scene, White};
use camrig_scene::{chart, cube, level, preview, selection};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Opens a scene by its name: a built-in chart (`NAME[:OPTIONS]`), a spectral cube or a picture
/// (`FILE[:OPTIONS]`) or the directory of a stored scene, with options as `KEY=VALUE,...`.
///
/// # Errors
/// A name that is none of these, options that the scene does not have, a file that cannot be read.
pub fn open(spec: &str) -> Result<Box<dyn Scene>> {
    Ok(open_with_size(spec)?.0)
}

/// Whether a scene's name is that of a file or directory rather than of a built-in chart.
pub fn is_file(spec: &str) -> bool {
    let (name, _) = spec.split_once(':').unwrap_or((spec, ""));
    !chart::NAMES.iter().any(|chart| chart.eq_ignore_ascii_case(name))
}

/// A scene's own width and height in pixels; charts have none.
pub type PixelSize = Option<(usize, usize)>;

/// Opens a scene together with its size.
///
/// # Errors
/// Those of [`open`].
pub fn open_with_size(spec: &str) -> Result<(Box<dyn Scene>, PixelSize)> {
    if let Some(chart) = chart::open(spec) {
        return Ok((chart.map_err(|e| e.at(format!("scene {spec:?}")))?, None));
    }
    let cube = open_file(spec)?;
    let size = cube.size();
    Ok((Box::new(cube), Some(size)))
}

/// Opens a spectral cube, a picture or the directory of a stored scene.
///
/// # Errors
/// The name of a chart, which has no pixels of its own; otherwise those of [`open`].
pub fn open_file(spec: &str) -> Result<cube::Cube> {
    let (path, options) = file_and_options(spec);
    if path.is_dir() {
        return open_folder(path, options);
    }
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    // Wavelengths are those of a cube: of the channels that a picture would leave out.
    let of_bands = options.contains("_nm=");
    if !of_bands && rgb::is_picture(path, &extension).map_err(|e| e.at(path.display()))? {
        return rgb::open(path, &extension, options).map_err(|e| e.at(path.display()));
    }
    let open = match extension.as_str() {
        "npy" | "npz" => numpy::open,
        "hdr" => envi::open,
        "mat" | "h5" | "hdf5" | "hdf" | "he5" | "nc" | "nc4" => arrays::open,
        "exr" => exr::open,
        "tif" | "tiff" => images::open_stack,
        _ if envi::header_beside(path).is_some() => envi::open,
        _ if arrays::is_hdf5(path) => arrays::open,
        _ => return Err(unknown_scene(spec)),
    };
    let sidecar = sidecar::Sidecar::read(path, options)?;
    open(path, &sidecar).map_err(|e| e.at(path.display()))
}

/// Whether the first bytes of a file are these.
fn starts_with(path: &Path, magic: &[u8]) -> bool {
    let mut start = vec![0; magic.len()];
    File::open(path).is_ok_and(|mut file| file.read_exact(&mut start).is_ok()) && start == magic
}

/// A file's name and the options behind it.
fn file_and_options(spec: &str) -> (&Path, &str) {
    match spec.rsplit_once(':') {
        Some((path, options)) if !Path::new(spec).exists() => (Path::new(path), options),
        _ => (Path::new(spec), ""),
    }
}

/// Opens a stored scene or a folder of pictures, one per band.
fn open_folder(path: &Path, options: &str) -> Result<cube::Cube> {
    if path.join(stored::DESCRIPTION).exists() {
        if !options.is_empty() {
            return Err(Error::input(format!("options {options:?} of a stored scene"))
                .help("it says itself what it holds; leave them out"));
        }
        return stored::open(path);
    }
    if let Ok(sequence::folder::Kind::Sequence) = sequence::folder::kind(path, options) {
        return Err(one_scene(&path.display().to_string(), "a folder of pictures or cubes"));
    }
    let options = &sequence::folder::of_cube(options)?;
    let sidecar = sidecar::Sidecar::read(path, options)?;
    let cube = images::open_folder(path, &sidecar).map_err(|e| e.at(path.display()))?;
    // Without pictures, what is missing of a stored scene.
    cube.map_or_else(|| stored::open(path), Ok)
}

/// A sequence where one scene is wanted.
fn one_scene(spec: &str, what: &str) -> Error {
    Error::unsupported(format!("{spec:?} is {what}: a sequence, and one scene is wanted here"))
        .help("name one of its frames; or simulate the sequence, frame by frame")
}

fn unknown_scene(spec: &str) -> Error {
    let name = spec.split(':').next().unwrap_or(spec);
    if sequence::is_stream(spec) {
        return one_scene(spec, "a stream");
    }
    if sequence::is_video(Path::new(name)) {
        return one_scene(spec, "video");
    }
    if chart::NAMES.contains(&name) {
        return Error::input(format!("{name:?} is a chart, which has no pixels of its own"))
            .help("draw it first, at a number of pixels")
            .with_code(ErrorCode::ChartNotDrawn);
    }
    let picture = ["bmp", "webp", "gif", "ppm", "pfm", "heic", "avif", "jxl"];
    if picture.iter().any(|e| name.to_ascii_lowercase().ends_with(&format!(".{e}"))) {
        return Error::unsupported(format!("{spec:?} is a picture of a kind that is not read"))
            .help("save it as PNG, JPEG, TIFF, OpenEXR or Radiance");
    }
    let kinds = "a spectral cube (.npy, .npz, .hdr, .mat, .h5, .nc, .exr, .tif), a picture (.png, \
                 .jpg, .tif, .exr, .hdr)";
    if Path::new(name).is_file() {
        return Error::unsupported(format!("{name:?} is a file of a kind that is no scene"))
            .help(format!("a scene is {kinds}"));
    }
    let nearest = camrig_base::toml_text::nearest(name, chart::NAMES.iter().copied());
    Error::input(format!("unknown scene {spec:?}; did you mean {nearest}?")).help(format!(
        "use a chart ({}), {kinds}, a folder of pictures, one per band, or a scene directory; a \
         sequence is a folder of these, or video (.y4m, - for standard input)",
        chart::NAMES.join(", ")
    ))
}
