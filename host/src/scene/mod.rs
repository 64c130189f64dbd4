//! Scenes: what is in front of the lens, as spectral reflectance or spectral radiance.
//!
//! # Coordinates
//! Scenes are asked for in *frame coordinates*: the sensor's width is 1, the image centre (0, 0), u
//! to the right, v **down**, both in units of the sensor's width (so v runs over ±height/(2·width)).
//! They are those of the ideal (paraxial, upright) image; the lens maps them to where light lands.

pub mod spectrum;
pub mod table;

use crate::{Plane, Result};
pub use spectrum::{Bands, Spectrum};

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
}

/// A scene with its light: spectral radiance is what comes out.
pub struct LitScene<'a> {
    /// The scene.
    pub scene: &'a dyn Scene,
    /// Radiance of a perfect white (reflectance 1), W m⁻² sr⁻¹ nm⁻¹, one value per band of the scene;
    /// for a radiance scene the factor by which it is multiplied (1 everywhere, or a new level).
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
