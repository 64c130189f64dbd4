//! Where the planes of a cube come from: memory, or a file of any format.

use super::Components;
use camrig_base::{Plane, Result};
use camrig_light::colour::mixture::Mixer;

/// Where a cube's planes come from.
pub trait BandSource: Send + Sync {
    /// Width and height in pixels.
    fn size(&self) -> (usize, usize);
    /// Number of bands.
    fn bands(&self) -> usize;
    /// One band as stored, in the source's unit.
    ///
    /// # Errors
    /// A file that cannot be read.
    fn read(&self, band: usize) -> Result<Plane<f32>>;
    /// The bands as mixtures, see [`Scene::components`](super::Scene::components); none of a
    /// source that only has bands.
    ///
    /// # Errors
    /// A file that cannot be read.
    fn components(&self, mixer: &Mixer) -> Result<Option<Components>> {
        let _ = mixer;
        Ok(None)
    }
}
