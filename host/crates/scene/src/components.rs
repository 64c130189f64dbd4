//! Scenes whose spectra are mixtures of a few.

use super::resample::resample;
use super::{Bands, Grid, Quantity, Scene};
use camrig_base::{Plane, Result};
use camrig_light::colour::mixture::{Mixed, Mixer};
use std::sync::Arc;

/// A scene as a mixture: for a channel its value in a band is the sum over components of what the
/// channel's curve has there times the component's plane.
pub struct Components {
    /// `[channel][component][band]`; zeros where a channel takes nothing from a component.
    pub curves: Vec<Vec<Vec<f64>>>,
    /// A scene that has a component where others have a band; its values may be negative.
    pub planes: Box<dyn Scene>,
    /// Bound on what the mixture leaves out, however a lens blurs: at an edge between two of the
    /// scene's spectra, as a part of what the channel sees of white, the largest of all channels.
    pub left_out: f64,
}

impl Components {
    /// Of planes in the scene's own pixels.
    #[must_use]
    pub fn of_planes(mixed: Mixed, quantity: Quantity) -> Self {
        let Mixed { curves, planes, left_out } = mixed;
        Self { curves, planes: Box::new(Planes { planes, quantity }), left_out }
    }

    /// Of a scene that is the same in all bands: itself, exactly.
    pub(crate) fn of_grey(scene: impl Scene + 'static, mixer: &Mixer) -> Self {
        let bands = scene.bands();
        let curve = vec![1.0; bands.count];
        let planes = Box::new(Grey::new(scene, &Bands { count: 1, ..bands }));
        Self { curves: vec![vec![curve]; mixer.seen().len()], planes, left_out: 0.0 }
    }

    /// The same with the planes seen otherwise, in a way that is linear in their values.
    pub(crate) fn seen<S: Scene + 'static>(self, seen: impl FnOnce(Arc<dyn Scene>) -> S) -> Self {
        Self { planes: Box::new(seen(Arc::from(self.planes))), ..self }
    }
}

/// Components in their own pixels.
struct Planes {
    planes: Vec<Plane<f32>>,
    quantity: Quantity,
}

impl Scene for Planes {
    fn bands(&self) -> Bands {
        Bands { count: self.planes.len(), ..Bands::VISIBLE }
    }

    fn quantity(&self) -> Quantity {
        self.quantity
    }

    fn aspect(&self) -> Option<f64> {
        self.planes.first().map(|p| p.width as f64 / p.height as f64)
    }

    fn plane(&self, component: usize, grid: &Grid) -> Result<Plane<f32>> {
        Ok(resample(&self.planes[component], grid))
    }
}

/// Wavelengths of a scene without colour, nm: all.
pub(crate) const ALL_NM: [f64; 2] = [0.0, f64::INFINITY];

/// A scene that is the same in all bands, in some of them.
#[derive(Clone)]
pub(crate) struct Grey {
    scene: Arc<dyn Scene>,
    bands: Bands,
}

impl Grey {
    /// Of a scene that is the same in all of its own bands.
    pub fn new(scene: impl Scene + 'static, bands: &Bands) -> Self {
        Self { scene: Arc::new(scene), bands: *bands }
    }
}

impl Scene for Grey {
    fn bands(&self) -> Bands {
        self.bands
    }

    fn data_nm(&self) -> [f64; 2] {
        ALL_NM
    }

    fn in_bands(&self, bands: &Bands) -> Option<Box<dyn Scene>> {
        Some(Box::new(Self { bands: *bands, ..self.clone() }))
    }

    fn components(&self, mixer: &Mixer) -> Result<Option<Components>> {
        Ok(Some(Components::of_grey(self.clone(), mixer)))
    }

    fn quantity(&self) -> Quantity {
        self.scene.quantity()
    }

    fn aspect(&self) -> Option<f64> {
        self.scene.aspect()
    }

    fn plane(&self, _band: usize, grid: &Grid) -> Result<Plane<f32>> {
        self.scene.plane(0, grid)
    }
}
