//! A lens file and how it is used: what a camera file and the command line say alike.

use camrig_base::Result;
use camrig_glass::{Glass, files};
use std::path::PathBuf;

/// A prescription in a file, the glasses it needs, and how the lens is used.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Setup {
    /// The prescription: `.zmx`, `.seq` or `.toml`.
    pub file: PathBuf,
    /// Glasses under names that the file uses, before those of all catalogues
    /// ([`Glass::named`]).
    pub glasses: Vec<(String, Glass)>,
    /// Glass catalogues (`.agf`) or folders of them, before those beside the file.
    pub catalogues: Vec<PathBuf>,
    /// Configuration of a file with several, by number from 1 or by name; `None` takes the active
    /// one.
    pub configuration: Option<String>,
    /// How the lens is used.
    pub conditions: Conditions,
}

/// How a lens is used, where that differs from its prescription.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Conditions {
    /// Object distance in front of the first surface, mm (infinite is allowed).
    pub object_distance_mm: Option<f64>,
    /// Where the sensor is.
    pub focus: Focus,
    /// The sensor moved away from the lens by this much, mm, from where `focus` puts it.
    pub sensor_shift_mm: f64,
    /// Radius of the stop instead of the one the prescription's aperture gives, mm.
    pub stop_radius_mm: Option<f64>,
    /// Wavelength of paraxial figures and of the stop's radius instead of the prescription's, nm.
    pub reference_nm: Option<f64>,
}

/// Where the sensor is, before [`Conditions::sensor_shift_mm`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Focus {
    /// Where the prescription has the image, whatever the object distance.
    #[default]
    AsDesigned,
    /// Focused by moving the sensor: away from where the prescription has the image by as much as
    /// the paraxial image moves from the prescription's object to one at this distance in front of
    /// the first surface, mm (infinite is allowed). What the design chose between paraxial and
    /// best focus is kept.
    At(f64),
    /// Where the MTF on the axis at this many cycles per mm, averaged over the design
    /// wavelengths, is largest.
    BestMtf(f64),
}

impl Setup {
    /// The files among [`Self::catalogues`] and in their folders.
    ///
    /// # Errors
    /// A name that does not exist, a folder without a catalogue.
    pub fn catalogue_files(&self) -> Result<Vec<PathBuf>> {
        let files: Result<Vec<Vec<PathBuf>>> =
            self.catalogues.iter().map(|path| files::named(path)).collect();
        Ok(files?.concat())
    }
}
