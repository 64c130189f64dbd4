//! Scenes: what is in front of the lens, as spectral reflectance (0 to 1) or spectral radiance
//! (W m⁻² sr⁻¹ nm⁻¹) in bands of equal width.
//!
//! A [`Scene`] gives one plane per band on any [`Grid`]; each value is the area average over a
//! cell. Built-in scenes are in [`chart`], spectral cubes in [`cube`], scenes that change with time
//! in [`sequence`]; `camrig-scene-files` reads all of them from files. An illuminant with a level
//! in lux or cd/m² turns reflectance into radiance ([`camrig_light::photometry::white_radiance`],
//! [`LitScene`]).
//!
//! # Coordinates
//! Scenes use *frame coordinates*: the sensor's width is 1, the image centre (0, 0), u points to
//! the right, v **down**, both in units of the sensor's width (so v runs over ±height/(2·width)).
//! They are those of the ideal (paraxial, upright) image; the lens maps them to where light lands.
//!
//! # Example
//! Luminance of the white and the black patch of a ColorChecker under D65 at 1000 lx, cd/m²:
//! ```
//! use camrig_base::Spectrum;
//! use camrig_light::photometry::{KM, white_radiance, xyz};
//! use camrig_light::{Illuminant, LightLevel};
//! use camrig_scene::Bands;
//! use camrig_scene::chart::colorchecker;
//!
//! let light = Illuminant::parse("D65")?;
//! let bands = Bands::VISIBLE;
//! let white = white_radiance(&light, LightLevel::Lux(1000.0), &bands)?; // W m⁻² sr⁻¹ nm⁻¹
//! let patches = colorchecker::reflectances();
//! let luminance = |patch: usize| -> camrig_base::Result<f64> {
//!     let reflectance = patches.spectrum(patch - 1)?.in_bands(&bands);
//!     let radiance = reflectance.iter().zip(&white).map(|(r, w)| r * w).collect();
//!     Ok(KM * xyz(&Spectrum::new(bands.centres().collect(), radiance)?)[1])
//! };
//! // A perfect white has 1000/π = 318 cd/m².
//! assert!((luminance(19)? / 318.3 - 0.912).abs() < 0.005);
//! assert!((luminance(24)? / 318.3 - 0.032).abs() < 0.003);
//! # Ok::<(), camrig_base::Error>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod band_source;
pub mod chart;
pub mod components;
pub mod cube;
pub mod level;
pub mod moving;
pub mod painting;
pub mod part;
pub mod preview;
mod resample;
pub mod selection;
pub mod sequence;
pub mod shape;

pub use camrig_base::{Bands, Spectrum};
use camrig_base::{Plane, Result};
use camrig_light::colour::mixture::Mixer;
pub use components::Components;

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
    /// The grid for content of some aspect (width over height) that is to cover a frame of
    /// `frame_aspect`: the content keeps its aspect, is centred, and its excess is cut off.
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
    /// Lambertian reflectance, 0 to 1, lit by an illuminant.
    Reflectance,
    /// Spectral radiance, W m⁻² sr⁻¹ nm⁻¹.
    Radiance,
}

impl Quantity {
    /// `reflectance` or `radiance`.
    pub fn name(self) -> &'static str {
        match self {
            Quantity::Reflectance => "reflectance",
            Quantity::Radiance => "radiance",
        }
    }

    /// The quantity of that name.
    pub fn parse(name: &str) -> Option<Self> {
        [Quantity::Reflectance, Quantity::Radiance].into_iter().find(|q| q.name() == name)
    }
}

/// What a scene is at wavelengths where its data end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Beyond {
    /// Dark: nothing is invented.
    #[default]
    Dark,
    /// As at the first and the last wavelength of its data: a guess that may suit reflectances.
    Hold,
}

impl Beyond {
    /// The choices, the default first.
    pub const NAMES: [&str; 2] = ["dark", "hold"];

    /// The choice of that name.
    pub fn parse(name: &str) -> Option<Self> {
        let index = Self::NAMES.iter().position(|n| *n == name)?;
        Some([Self::Dark, Self::Hold][index])
    }
}

/// The white of a picture of radiance, to which a light level refers.
#[derive(Clone, Debug, PartialEq)]
pub struct White {
    /// Its luminance by the scene's values, cd/m².
    pub luminance: f64,
    /// Whether the scene's values are a radiance as they are, and do not need a level.
    pub absolute: bool,
    /// What it is, in words.
    pub words: String,
}

/// Something that can be put in front of the lens.
pub trait Scene: Send + Sync {
    /// The bands in which the scene is given.
    fn bands(&self) -> Bands;
    /// What the scene's values are.
    fn quantity(&self) -> Quantity;
    /// From where to where its data reach, nm.
    fn data_nm(&self) -> [f64; 2] {
        let bands = self.bands();
        [bands.edges_nm(0)[0], bands.edges_nm(bands.count.saturating_sub(1))[1]]
    }
    /// What the scene is outside [`Self::data_nm`].
    fn beyond(&self) -> Beyond {
        Beyond::Dark
    }
    /// The same scene in other bands, its data held at their ends; none of a scene that is known
    /// in its own bands alone.
    fn in_bands(&self, bands: &Bands) -> Option<Box<dyn Scene>> {
        let _ = bands;
        None
    }
    /// Width over height of the scene's content; `None` for a scene that fills any frame, such as
    /// a chart.
    fn aspect(&self) -> Option<f64>;
    /// The **area average** over each cell of `grid` of the scene in one band. Defined for every
    /// (u, v): outside its own content a scene repeats its edge or shows its background.
    ///
    /// # Errors
    /// A file that cannot be read or holds values that are not those of the quantity.
    fn plane(&self, band: usize, grid: &Grid) -> Result<Plane<f32>>;
    /// The white that a light level refers to; none where it refers to the scene as a whole.
    fn white(&self) -> Option<&White> {
        None
    }
    /// The scene as a mixture of few components for the channels of a sensor; none of a scene that
    /// has to be computed band by band.
    ///
    /// # Errors
    /// A file that cannot be read.
    fn components(&self, mixer: &Mixer) -> Result<Option<Components>> {
        let _ = mixer;
        Ok(None)
    }
    /// How its content fills a frame of another shape; none where nothing is cut off.
    fn shown(&self) -> Option<Shown> {
        None
    }
    /// Remarks for the user, such as bands that were extrapolated.
    fn notes(&self) -> Vec<String> {
        Vec::new()
    }
}

/// Which part of a scene's content a frame of another shape shows: the middle of its width or
/// height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// Width over height of the content.
    pub content_aspect: f64,
    /// Width over height of the frame.
    pub frame_aspect: f64,
}

/// Smallest part of the content's width or height whose loss is told: a pixel of a thousand.
const MIN_LOST: f64 = 1e-3;

impl Shown {
    fn new(content_aspect: f64, frame_aspect: f64) -> Option<Self> {
        let shown = Self { content_aspect, frame_aspect };
        (shown.width().min(shown.height()) < 1.0 - MIN_LOST).then_some(shown)
    }

    /// Part of the content's width that is in the frame.
    #[must_use]
    pub fn width(&self) -> f64 {
        (self.frame_aspect / self.content_aspect).min(1.0)
    }

    /// Part of its height.
    #[must_use]
    pub fn height(&self) -> f64 {
        (self.content_aspect / self.frame_aspect).min(1.0)
    }

    /// What is cut off, and where the rest comes to.
    fn words(&self) -> String {
        let ([axis, side, first], sides, share) = match self.width() < self.height() {
            true => (["x", "width", "left"], "left and right", self.width()),
            false => (["y", "height", "top"], "top and bottom", self.height()),
        };
        let lost = 0.5 * (1.0 - share);
        format!(
            "the scene is {:.4} times as wide as high, the frame {:.4} times: it fills the frame, \
             centred, with {:.2} % cut off at its {sides} each; through an ideal lens, what lies at \
             a part {axis} of its {side}, from the {first}, comes to ({axis} - {lost:.4}) / \
             {share:.4} of the frame's",
            self.content_aspect,
            self.frame_aspect,
            100.0 * lost,
        )
    }
}

/// A scene with its light, which gives spectral radiance.
pub struct LitScene<'a> {
    /// The scene.
    pub scene: &'a dyn Scene,
    /// Radiance of a perfect white (reflectance 1), W m⁻² sr⁻¹ nm⁻¹, one value per band of the
    /// scene. For a radiance scene, the factor by which each band is multiplied: 1, or the ratio
    /// of a new light level to its own.
    pub white: Vec<f64>,
}

impl LitScene<'_> {
    /// Spectral radiance in one band, W m⁻² sr⁻¹ nm⁻¹, averaged over the cells of `grid`.
    ///
    /// # Errors
    /// Those of [`Scene::plane`].
    pub fn radiance(&self, band: usize, grid: &Grid) -> Result<Plane<f32>> {
        let mut plane = self.scene.plane(band, grid)?;
        let white = self.white[band] as f32;
        plane.data.iter_mut().for_each(|v| *v *= white);
        Ok(plane)
    }
}

/// Whether a scene's name is that of a file or directory rather than of a built-in chart.
pub fn is_file(spec: &str) -> bool {
    let (name, _) = spec.split_once(':').unwrap_or((spec, ""));
    !chart::NAMES.contains(&name)
}

/// The scene for a frame of some aspect (width over height): content with an aspect of its own
/// fills the frame, see [`Grid::over_content`].
#[must_use]
pub fn filling(scene: Box<dyn Scene>, frame_aspect: f64) -> Box<dyn Scene> {
    Box::new(Filling { scene, frame_aspect })
}

/// A scene that is scaled to fill a frame.
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

    fn data_nm(&self) -> [f64; 2] {
        self.scene.data_nm()
    }

    fn beyond(&self) -> Beyond {
        self.scene.beyond()
    }

    fn in_bands(&self, bands: &Bands) -> Option<Box<dyn Scene>> {
        Some(filling(self.scene.in_bands(bands)?, self.frame_aspect))
    }

    fn aspect(&self) -> Option<f64> {
        None
    }

    fn plane(&self, band: usize, grid: &Grid) -> Result<Plane<f32>> {
        self.scene.plane(band, &grid.over_content(self.scene.aspect(), self.frame_aspect))
    }

    fn white(&self) -> Option<&White> {
        self.scene.white()
    }

    fn components(&self, mixer: &Mixer) -> Result<Option<Components>> {
        let components = self.scene.components(mixer)?;
        Ok(components.map(|c| Components { planes: filling(c.planes, self.frame_aspect), ..c }))
    }

    fn shown(&self) -> Option<Shown> {
        Shown::new(self.scene.aspect()?, self.frame_aspect)
    }

    fn notes(&self) -> Vec<String> {
        let mut notes = self.scene.notes();
        notes.extend(self.shown().map(|shown| shown.words()));
        notes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture of three by two in frames of four by three and of sixteen by nine: 1/18 of the
    /// width is lost on each side, and 5/64 of the height.
    #[test]
    fn what_a_frame_of_another_shape_cuts_off_is_told() {
        let wide = Shown::new(1.5, 4.0 / 3.0).unwrap();
        assert!((wide.width() - 8.0 / 9.0).abs() < 1e-12 && wide.height() == 1.0);
        let words = wide.words();
        assert!(words.contains("5.56 % cut off at its left and right each"), "{words}");
        assert!(words.contains("(x - 0.0556) / 0.8889 of the frame's"), "{words}");
        let flat = Shown::new(1.5, 16.0 / 9.0).unwrap();
        assert!((flat.height() - 27.0 / 32.0).abs() < 1e-12 && flat.width() == 1.0);
        assert!(flat.words().contains("7.81 % cut off at its top and bottom each"));
        // The frame of 4056 x 3040 pixels shows a picture of four by three, but for a pixel.
        assert_eq!(Shown::new(4.0 / 3.0, 4056.0 / 3040.0), None);
    }
}
