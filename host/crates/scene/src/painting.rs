//! A scene of flat shapes, each of one material.

use super::components::ALL_NM;
use super::shape::Shape;
use super::{Beyond, Components, Grid, Quantity, Scene};
use camrig_base::{Bands, Plane, Result, Spectrum};
use camrig_light::colour::mixture::Mixer;

/// Shapes laid on a ground. A shape lies wholly within one material beneath it, so that
/// value = ground + Σ coverage · (material − beneath) is the exact area average of every cell.
#[derive(Clone, Debug)]
pub struct Painting {
    bands: Bands,
    /// Reflectance of each material over wavelength.
    spectra: Vec<Spectrum>,
    beyond: Beyond,
    /// Reflectance of each material in each band.
    materials: Vec<Vec<f64>>,
    marks: Vec<Mark>,
    /// The least value that a material may have.
    least: f32,
}

/// A material of a [`Painting`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Material(usize);

#[derive(Clone, Debug)]
struct Mark {
    shape: Shape,
    material: Material,
    beneath: Material,
}

impl Painting {
    /// The material of the ground.
    pub const GROUND: Material = Material(0);

    /// A ground of one reflectance.
    pub fn new(bands: Bands, ground: &Spectrum) -> Self {
        Self {
            bands,
            spectra: vec![ground.clone()],
            beyond: Beyond::Dark,
            materials: vec![ground.in_bands(&bands)],
            marks: Vec::new(),
            least: 0.0,
        }
    }

    /// The same with what materials are beyond the ends of their tables.
    #[must_use]
    pub fn with_beyond(self, beyond: Beyond) -> Self {
        Self { beyond, ..self }
    }

    /// Adds a material.
    pub fn material(&mut self, reflectance: &Spectrum) -> Material {
        self.spectra.push(reflectance.clone());
        self.materials.push(reflectance.in_bands(&self.bands));
        Material(self.materials.len() - 1)
    }

    /// Lays a shape of `material` on an area that consists of the material `beneath` alone.
    pub fn lay(&mut self, shape: Shape, material: Material, beneath: Material) {
        self.marks.push(Mark { shape, material, beneath });
    }
}

impl Scene for Painting {
    fn bands(&self) -> Bands {
        self.bands
    }

    fn quantity(&self) -> Quantity {
        Quantity::Reflectance
    }

    /// Where the tables of all materials reach; a number holds at all wavelengths.
    fn data_nm(&self) -> [f64; 2] {
        let tables = self.spectra.iter().filter(|s| s.samples().nth(1).is_some());
        tables.map(Spectrum::range_nm).fold(ALL_NM, |[a, b], (c, d)| [a.max(c), b.min(d)])
    }

    fn beyond(&self) -> Beyond {
        self.beyond
    }

    fn in_bands(&self, bands: &Bands) -> Option<Box<dyn Scene>> {
        let materials = self.spectra.iter().map(|s| s.in_bands(bands)).collect();
        Some(Box::new(Self { bands: *bands, materials, ..self.clone() }))
    }

    fn aspect(&self) -> Option<f64> {
        None
    }

    fn plane(&self, band: usize, grid: &Grid) -> Result<Plane<f32>> {
        let value = |material: Material| self.materials[material.0][band];
        let mut plane = Plane::filled(grid.width, grid.height, value(Self::GROUND) as f32);
        for mark in &self.marks {
            let change = value(mark.material) - value(mark.beneath);
            mark.shape.paint(grid, change as f32, &mut plane);
        }
        // Rounding of the sum can leave a tiny negative value where a material is 0.
        plane.data.iter_mut().for_each(|v| *v = v.max(self.least));
        Ok(plane)
    }

    fn components(&self, mixer: &Mixer) -> Result<Option<Components>> {
        let mixed = mixer.mix_spectra(&self.materials, &vec![1.0; self.bands.count]);
        let planes = Self {
            bands: Bands { count: mixed.weights[0].len(), ..self.bands },
            spectra: Vec::new(),
            beyond: self.beyond,
            materials: mixed.weights,
            marks: self.marks.clone(),
            least: f32::NEG_INFINITY,
        };
        let (curves, left_out) = (mixed.curves, mixed.left_out);
        Ok(Some(Components { curves, planes: Box::new(planes), left_out }))
    }
}
