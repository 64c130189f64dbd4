//! Scenes: what is in front of the lens, as spectral reflectance or spectral radiance.
//!
//! # Coordinates
//! Scenes are asked for in *frame coordinates*: the sensor's width is 1, the image centre (0, 0),
//! u to the right, v **down**, both in units of the sensor's width (so v runs over
//! ±height/(2·width)). They are those of the ideal (paraxial, upright) image; the lens maps them
//! to where light lands.

pub mod chart;
pub mod cube;
pub mod delta_e;
pub mod envi;
mod exr;
mod hdf5;
pub mod illuminant;
pub mod isetcam;
pub mod library;
mod matlab;
pub mod moving;
pub mod numpy;
pub mod painting;
pub mod photometry;
pub mod preview;
pub mod shape;
mod sidecar;
pub mod stored;
pub mod strided;

pub use camrig_base::{Bands, Spectrum};
use camrig_base::{Error, Plane, Result};
pub use illuminant::Illuminant;
pub use photometry::LightLevel;
use std::path::Path;

/// A rectangular grid of square cells in frame coordinates on which a scene is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Cells across.
    pub width: usize,
    /// Cells down.
    pub height: usize,
    /// u of the left edge of column 0.
    pub left: f64,
    /// v of the top edge of row 0.
    pub top: f64,
    /// Edge length of a cell, in sensor widths.
    pub cell: f64,
}

impl Grid {
    /// The grid laid over content of that aspect (width over height) so that the content covers a
    /// frame of `frame_aspect`, its aspect kept, centred, excess cut off.
    #[must_use]
    pub fn over_content(&self, aspect: Option<f64>, frame_aspect: f64) -> Grid {
        // Content flatter than the frame would leave bars above and below: enlarge it.
        let shrink = aspect.map_or(1.0, |aspect| (frame_aspect / aspect).min(1.0));
        let Grid { width, height, left, top, cell } = *self;
        Grid { width, height, left: left * shrink, top: top * shrink, cell: cell * shrink }
    }
}

/// What the values of a scene are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Lambertian reflectance, 0..=1: lit by an illuminant.
    Reflectance,
    /// Spectral radiance, W m⁻² sr⁻¹ nm⁻¹.
    Radiance,
}

/// Something that can be put in front of the lens.
pub trait Scene: Send + Sync {
    /// The bands in which it is held.
    fn bands(&self) -> Bands;
    /// What its values are.
    fn quantity(&self) -> Quantity;
    /// Width over height of its content; `None` when it fills any frame (charts, uniform).
    fn aspect(&self) -> Option<f64>;
    /// The **area average** over each cell of `grid` of the scene in one band. Defined for every
    /// (u, v): outside its own content a scene repeats its edge or shows its background.
    fn plane(&self, band: usize, grid: &Grid) -> Result<Plane<f32>>;
    /// What a user should know about the scene, such as bands that were extrapolated.
    fn notes(&self) -> Vec<String> {
        Vec::new()
    }
}

/// A scene with its light: spectral radiance is what comes out.
pub struct LitScene<'a> {
    /// The scene.
    pub scene: &'a dyn Scene,
    /// Radiance of a perfect white (reflectance 1), W m⁻² sr⁻¹ nm⁻¹, one value per band of the
    /// scene; for a radiance scene the factor by which it is multiplied (1 everywhere, or a new
    /// level).
    pub white: Vec<f64>,
}

impl LitScene<'_> {
    /// Spectral radiance in one band, W m⁻² sr⁻¹ nm⁻¹, averaged over the cells of `grid`.
    pub fn radiance(&self, band: usize, grid: &Grid) -> Result<Plane<f32>> {
        let mut plane = self.scene.plane(band, grid)?;
        let white = self.white[band] as f32;
        plane.data.iter_mut().for_each(|v| *v *= white);
        Ok(plane)
    }
}

/// Opens what `--scene` names: a built-in chart (`NAME[:OPTIONS]`), a spectral cube
/// (`FILE[:OPTIONS]`) or the directory of a stored scene, options as `KEY=VALUE,...`.
pub fn open(spec: &str) -> Result<Box<dyn Scene>> {
    Ok(open_with_size(spec)?.0)
}

/// Whether a scene is one of a file or directory rather than a built-in chart.
pub fn is_file(spec: &str) -> bool {
    let (name, _) = spec.split_once(':').unwrap_or((spec, ""));
    !chart::NAMES.contains(&name)
}

/// Opens a scene to be seen in a frame of that aspect (width over height): content with an aspect
/// of its own fills the frame, see [`Grid::over_content`].
pub fn open_filling(spec: &str, frame_aspect: f64) -> Result<Box<dyn Scene>> {
    Ok(Box::new(Filling { scene: open(spec)?, frame_aspect }))
}

/// Opens a scene with its width and height in pixels, `None` for charts.
#[allow(clippy::type_complexity, reason = "a pair, named by the sentence above")]
pub fn open_with_size(spec: &str) -> Result<(Box<dyn Scene>, Option<(usize, usize)>)> {
    let (name, options) = spec.split_once(':').unwrap_or((spec, ""));
    if let Some(chart) = chart::open(name, options) {
        return Ok((chart.map_err(|e| e.at(format!("scene {spec:?}")))?, None));
    }
    let cube = open_file(spec)?;
    let size = cube.size();
    Ok((Box::new(cube), Some(size)))
}

/// Opens a spectral cube or the directory of a stored scene.
pub fn open_file(spec: &str) -> Result<cube::Cube> {
    let (path, options) = match spec.rsplit_once(':') {
        Some((path, options)) if !Path::new(spec).exists() => (Path::new(path), options),
        _ => (Path::new(spec), ""),
    };
    if path.is_dir() {
        return stored::open(path);
    }
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    let open = match extension.as_str() {
        "npy" | "npz" => numpy::open,
        "hdr" => envi::open,
        "mat" => isetcam::open,
        "exr" => exr::open,
        _ => return Err(unknown_scene(spec)),
    };
    let sidecar = sidecar::Sidecar::read(path, options)?;
    open(path, &sidecar).map_err(|e| e.at(path.display()))
}

/// A scene enlarged to fill a frame.
struct Filling {
    scene: Box<dyn Scene>,
    frame_aspect: f64,
}

impl Scene for Filling {
    fn bands(&self) -> Bands {
        self.scene.bands()
    }

    fn quantity(&self) -> Quantity {
        self.scene.quantity()
    }

    fn aspect(&self) -> Option<f64> {
        None
    }

    fn plane(&self, band: usize, grid: &Grid) -> Result<Plane<f32>> {
        self.scene.plane(band, &grid.over_content(self.scene.aspect(), self.frame_aspect))
    }

    fn notes(&self) -> Vec<String> {
        self.scene.notes()
    }
}

fn unknown_scene(spec: &str) -> Error {
    let name = spec.split(':').next().unwrap_or(spec);
    if chart::NAMES.contains(&name) {
        return Error::input(format!("{name:?} is a chart, which has no pixels of its own"))
            .help("draw it first, at a number of pixels")
            .with_code("chart-not-drawn");
    }
    let nearest = camrig_base::toml_text::nearest(name, chart::NAMES.iter().copied());
    Error::input(format!("unknown scene {spec:?}; did you mean {nearest}?")).help(format!(
        "use a chart ({}), a spectral cube (.npy, .npz, .hdr, .mat, .exr), or a scene directory",
        chart::NAMES.join(", ")
    ))
}
