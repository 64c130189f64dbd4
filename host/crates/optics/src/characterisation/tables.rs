//! The tables of a lens, whichever symmetry it has.

use super::Characterisation;
use super::directory::{PLANE_FORMAT, format_of};
use super::plane::PlaneCharacterisation;
use crate::engine::Lens;
use camrig_base::{Result, Spectrum};
use std::path::Path;

/// A lens as tables, of either kind; what a lens directory holds.
#[derive(Clone, Debug, PartialEq)]
pub enum LensTables {
    /// Rotationally symmetric: over image height.
    Heights(Characterisation),
    /// Any other: over places of the image.
    Plane(PlaneCharacterisation),
}

impl LensTables {
    /// Reads a lens directory.
    ///
    /// # Errors
    /// Those of [`Characterisation::read`] and [`PlaneCharacterisation::read`].
    pub fn read(dir: &Path) -> Result<Self> {
        Ok(match format_of(dir)? == PLANE_FORMAT {
            true => Self::Plane(PlaneCharacterisation::read(dir)?),
            false => Self::Heights(Characterisation::read(dir)?),
        })
    }

    /// Writes a lens directory, whole or not at all; an existing one only with `force`.
    ///
    /// # Errors
    /// Invalid data, an existing directory, or a failure to write.
    pub fn write(&self, dir: &Path, force: bool) -> Result<()> {
        match self {
            Self::Heights(lens) => lens.write(dir, force),
            Self::Plane(lens) => lens.write(dir, force),
        }
    }

    /// Transmittance over wavelength.
    pub fn transmittance(&self) -> &Spectrum {
        match self {
            Self::Heights(lens) => &lens.transmittance,
            Self::Plane(lens) => &lens.transmittance,
        }
    }

    /// The lens with another transmittance.
    pub fn into_lens(self, transmittance: Spectrum) -> Box<dyn Lens> {
        match self {
            Self::Heights(lens) => Box::new(Characterisation { transmittance, ..lens }),
            Self::Plane(lens) => Box::new(PlaneCharacterisation { transmittance, ..lens }),
        }
    }
}
