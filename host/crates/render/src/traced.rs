//! Lenses traced from prescriptions, kept on disk by content: `KEY.lens`, a lens directory as
//! `camrig lens trace` writes it. The key covers the prescription as it was understood, glasses
//! included, how it is used and what is traced of it.

use super::sensor_grid;
use camrig_base::Bands;
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_lens::characterise::{Plan, PsfMethod, characterise};
use camrig_lens::heights::Density;
use camrig_lens::{Setup, System};
use camrig_optics::{Characterisation, Options, content};
use std::path::{Path, PathBuf};

/// A prescription and what is to be traced of it.
pub struct Tracing {
    file: PathBuf,
    system: System,
    plan: Plan,
    description: String,
}

impl Tracing {
    /// The prescription of `setup`, out to the sensor's corner, in the scene's bands.
    ///
    /// # Errors
    /// A prescription that cannot be read, or does not image.
    pub fn new(
        camera: &Camera,
        setup: &Setup,
        bands: &Bands,
        options: &Options,
        defocus_um: f64,
    ) -> Result<Self> {
        /// Image heights from the axis to the corner, before more are added.
        const HEIGHTS: usize = 21;
        const PSF_SIZE: usize = 128;
        let mut conditions = setup.conditions;
        conditions.sensor_shift_mm += 1e-3 * defocus_um;
        let prescription = setup.prescription()?;
        let given = format!("{prescription:?} {conditions:?}");
        let system =
            System::new(prescription, conditions).map_err(|e| e.at(setup.file.display()))?;
        let plan = Plan {
            heights: HEIGHTS,
            density: Some(Density {
                tolerance: options.misplaced_light,
                pixel_um: camera.sensor.pitch_um,
            }),
            max_field_deg: system.field_of_paraxial_height(sensor_grid(camera).corner_mm()).abs(),
            wavelengths_nm: bands.centres().collect(),
            psf_size: PSF_SIZE,
            psf_spacing_um: None,
            method: PsfMethod::Auto,
        };
        let description = format!("{given} {plan:?}");
        Ok(Self { file: setup.file.clone(), system, plan, description })
    }

    /// All that the result depends on.
    pub fn description(&self) -> &str {
        &self.description
    }

    /// What the reader of the prescription assumed or ignored.
    pub fn notes(&self) -> &[String] {
        &self.system.prescription.notes
    }

    /// The characterisation, and whether it had to be traced: what `directory` holds is taken from
    /// there, what it does not hold is left there.
    ///
    /// # Errors
    /// Rays that do not reach the image.
    pub fn characterisation(&self, directory: Option<&Path>) -> Result<(Characterisation, bool)> {
        let kept = directory
            .map(|d| d.join(format!("{}.lens", content::key_of_description(&self.description))));
        if let Some(lens) = kept.as_deref().and_then(|kept| Characterisation::read(kept).ok()) {
            return Ok((lens, false));
        }
        let lens = characterise(&self.system, &self.plan, &|_, _| ())
            .map_err(|e| e.at(self.file.display()))?;
        if let (Some(kept), Some(directory)) = (&kept, directory) {
            // What is there cannot be read. That the lens cannot be kept is no reason to fail: it
            // is in hand.
            let _ = std::fs::remove_dir_all(kept);
            if std::fs::create_dir_all(directory).is_ok() {
                let _ = lens.write(kept, false);
            }
        }
        Ok((lens, true))
    }
}
