//! Lenses traced from prescriptions, kept on disk by content: `KEY.lens`, a lens directory as
//! `camrig lens trace` writes it. The key covers the prescription as it was understood, glasses
//! included, how it is used and what is traced of it.

use super::sensor_grid;
use camrig_base::Bands;
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_lens::characterise::{Plan, PsfMethod, characterise};
use camrig_lens::field::{self, PlanePlan};
use camrig_lens::heights::Density;
use camrig_lens::{Setup, System};
use camrig_optics::{LensTables, Options, content};
use std::path::{Path, PathBuf};

/// A prescription and what is to be traced of it.
pub struct Tracing {
    file: PathBuf,
    system: System,
    wanted: Wanted,
    description: String,
}

/// What is to be traced, by the lens's symmetry.
enum Wanted {
    Heights(Plan),
    Plane(PlanePlan),
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
        let density =
            Some(Density { tolerance: options.misplaced_light, pixel_um: camera.sensor.pitch_um });
        let grid = sensor_grid(camera);
        if system.prescription.asymmetry().is_some() {
            let plan = PlanePlan {
                frame_mm: [grid.width, grid.height].map(|n| n as f64 * 1e-3 * grid.pitch_um),
                density,
                wavelengths_nm: bands.centres().collect(),
                psf_size: PSF_SIZE,
                psf_spacing_um: None,
                method: PsfMethod::Auto,
            };
            let description = format!("{given} {plan:?}");
            let wanted = Wanted::Plane(plan);
            return Ok(Self { file: setup.file.clone(), system, wanted, description });
        }
        let plan = Plan {
            heights: HEIGHTS,
            density,
            max_field_deg: system.field_of_paraxial_height(grid.corner_mm()).abs(),
            wavelengths_nm: bands.centres().collect(),
            psf_size: PSF_SIZE,
            psf_spacing_um: None,
            method: PsfMethod::Auto,
        };
        let description = format!("{given} {plan:?}");
        let wanted = Wanted::Heights(plan);
        Ok(Self { file: setup.file.clone(), system, wanted, description })
    }

    /// All that the result depends on.
    pub fn description(&self) -> &str {
        &self.description
    }

    /// What the reader of the prescription assumed or ignored.
    pub fn notes(&self) -> &[String] {
        &self.system.prescription.notes
    }

    /// The tables, and whether it had to be traced: what `directory` holds is taken from
    /// there, what it does not hold is left there.
    ///
    /// # Errors
    /// Rays that do not reach the image.
    pub fn tables(&self, directory: Option<&Path>) -> Result<(LensTables, bool)> {
        let kept = directory
            .map(|d| d.join(format!("{}.lens", content::key_of_description(&self.description))));
        if let Some(lens) = kept.as_deref().and_then(|kept| LensTables::read(kept).ok()) {
            return Ok((lens, false));
        }
        let traced = match &self.wanted {
            Wanted::Heights(plan) => {
                characterise(&self.system, plan, &|_, _| ()).map(LensTables::Heights)
            }
            Wanted::Plane(plan) => {
                field::characterise(&self.system, plan, &|_, _| ()).map(LensTables::Plane)
            }
        };
        let lens = traced.map_err(|e| e.at(self.file.display()))?;
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
