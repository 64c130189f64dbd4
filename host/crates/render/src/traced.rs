//! Lenses traced from prescriptions, kept on disk by content: `KEY.lens`, a lens directory as
//! `camrig lens trace` writes it. The key covers the prescription as it was understood, glasses
//! included, how it is used and what is traced of it.

use super::sensor_grid;
use camrig_base::Bands;
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_lens::System;
use camrig_lens::characterise::{Plan, PsfMethod, characterise, field_points};
use camrig_lens::field::{self, PlanePlan};
use camrig_lens::heights::Density;
use camrig_lens::prescription::Setup;
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

/// Steps of image height from the axis to that of the sensor's corner, before more are added.
const STEPS: f64 = 20.0;
/// Largest ideal image height that is traced, over the sensor's: a fisheye of 170° has 8 times the
/// height of its picture, and steps grow in number as it does.
const MAX_OVER_IDEAL: f64 = 4.0;

/// How far out a lens is traced.
struct Largest {
    field_deg: f64,
    /// Its ideal image height over the real one that is wanted.
    over_ideal: f64,
    /// What to tell where that is not as far as the sensor's corner.
    note: Option<String>,
}

impl Largest {
    /// The field whose chief ray reaches the image height `reach_mm`, at least that whose ideal
    /// image lies there: barrel distortion draws the image inwards.
    fn of(system: &System, reach_mm: f64) -> Result<Self> {
        let ideal = system.field_of_paraxial_height(reach_mm).abs();
        let over = |deg: f64| system.paraxial_height_mm(deg) / reach_mm;
        let far = |deg: &f64| *deg < 90.0 && over(*deg) <= MAX_OVER_IDEAL;
        match system.field_of_real_height(reach_mm).ok().filter(far) {
            Some(real) if real > ideal => {
                Ok(Self { field_deg: real, over_ideal: over(real), note: None })
            }
            Some(_) => Ok(Self { field_deg: ideal, over_ideal: 1.0, note: None }),
            None => {
                let points = field_points(system, &[ideal], &[system.prescription.reference_nm])?;
                let real = points[0].chief_ray_height_mm.abs();
                let note = (real < reach_mm).then(|| {
                    format!(
                        "the lens is traced to {ideal:.2}°, whose chief ray lands {real:.3} mm \
                         from the axis, and the sensor's corner lies at {reach_mm:.3} mm: between \
                         them distortion goes on along its last slope, and relative illumination \
                         and PSFs are those of the end"
                    )
                });
                Ok(Self { field_deg: ideal, over_ideal: 1.0, note })
            }
        }
    }
}

impl Tracing {
    /// The prescription of `setup`, out to the real image height `reach_mm` of the sensor's
    /// corner, in the scene's bands.
    ///
    /// # Errors
    /// A prescription that cannot be read, or does not image.
    pub fn new(
        camera: &Camera,
        setup: &Setup,
        bands: &Bands,
        options: &Options,
        defocus_um: f64,
        reach_mm: f64,
    ) -> Result<Self> {
        const PSF_SIZE: usize = 128;
        let mut conditions = setup.conditions;
        conditions.sensor_shift_mm += 1e-3 * defocus_um;
        let prescription = camrig_lens_files::prescription(setup)?;
        let given = format!("{prescription:?} {conditions:?}");
        let mut system =
            System::new(prescription, conditions).map_err(|e| e.at(setup.file.display()))?;
        let centres: Vec<f64> = bands.centres().collect();
        let beyond = system.prescription.beyond_data(&centres);
        system.prescription.notes.extend(beyond);
        let density =
            Some(Density { tolerance: options.misplaced_light, pixel_um: camera.sensor.pitch_um });
        let grid = sensor_grid(camera);
        if system.prescription.asymmetry().is_some() {
            let plan = PlanePlan {
                frame_mm: [grid.width, grid.height].map(|n| n as f64 * 1e-3 * grid.pitch_um),
                density,
                wavelengths_nm: centres,
                psf_size: PSF_SIZE,
                psf_spacing_um: None,
                method: PsfMethod::Auto,
            };
            let description = format!("{given} {plan:?}");
            let wanted = Wanted::Plane(plan);
            return Ok(Self { file: setup.file.clone(), system, wanted, description });
        }
        let Largest { field_deg, over_ideal, note } = Largest::of(&system, reach_mm)?;
        let plan = Plan {
            heights: 1 + (STEPS * over_ideal).ceil() as usize,
            density,
            max_field_deg: field_deg,
            wavelengths_nm: centres,
            psf_size: PSF_SIZE,
            psf_spacing_um: None,
            method: PsfMethod::Auto,
        };
        let description = format!("{given} {plan:?}");
        let wanted = Wanted::Heights(plan);
        system.prescription.notes.extend(note);
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

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::Spectrum;

    /// A stop in front of a plane and a hyperboloid: 2.8 % of barrel distortion at 4 mm.
    const LANDSCAPE: &str = r#"
format = "camrig-prescription/1"
wavelengths_nm = [550.0]
fields_deg = [0.0]
[aperture]
f_number = 32.0
[[surface]]
stop = true
thickness_mm = 1.0
[[surface]]
thickness_mm = 2.0
glass = "flat"
[[surface]]
radius_mm = -5.0
conic = -2.25
thickness_mm = 10.0
[glass.flat]
table_nm = [[400.0, 1.5], [700.0, 1.5]]
"#;

    #[test]
    fn barrel_distortion_leaves_no_corner_beyond_the_tables() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("landscape.toml");
        std::fs::write(&file, LANDSCAPE).unwrap();
        let setup = Setup { file, ..Setup::default() };
        let system = camrig_lens_files::system(&setup).unwrap();
        // An image height at which the distortion is some per cent.
        let reach_mm = 4.0;
        let ideal = system.field_of_paraxial_height(reach_mm);
        let height =
            |deg: f64| field_points(&system, &[deg], &[550.0]).unwrap()[0].chief_ray_height_mm;
        assert!(height(ideal) < 0.99 * reach_mm, "{}", height(ideal));
        let Largest { field_deg, over_ideal, note } = Largest::of(&system, reach_mm).unwrap();
        assert!((height(field_deg) - reach_mm).abs() < 1e-9 && note.is_none(), "{note:?}");
        let tangents = field_deg.to_radians().tan() / ideal.to_radians().tan();
        assert!((over_ideal - tangents).abs() < 1e-12, "{over_ideal} instead of {tangents}");

        let mut camera = Camera::load("mt9t012").unwrap();
        (camera.sensor.width, camera.sensor.height, camera.sensor.pitch_um) = (8, 6, 500.0);
        camera.lens.transmittance = Spectrum::constant(1.0);
        let bands = Bands { start_nm: 550.0, step_nm: 10.0, count: 1 };
        let tracing =
            Tracing::new(&camera, &setup, &bands, &Options::default(), 0.0, reach_mm).unwrap();
        let (LensTables::Heights(lens), _) = tracing.tables(None).unwrap() else {
            panic!("a symmetric lens")
        };
        let end = lens.real_height_mm[lens.real_height_mm.len() - 1];
        assert!((end - reach_mm).abs() < 1e-9, "{end}");
    }

    #[test]
    fn a_corner_that_is_not_reached_is_told() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("landscape.toml");
        std::fs::write(&file, LANDSCAPE).unwrap();
        let system = camrig_lens_files::system(&Setup { file, ..Setup::default() }).unwrap();
        // EFL 10 mm: the ideal image of 63.43° lies at 20 mm, and its chief ray lands at 12.617 mm
        // (the law of refraction at plane and hyperboloid, computed apart from the tracer). The ray
        // to 20 mm has an ideal image more than four times as far out.
        let Largest { field_deg, note, .. } = Largest::of(&system, 20.0).unwrap();
        assert_eq!(field_deg, system.field_of_paraxial_height(20.0));
        let note = note.unwrap_or_default();
        let words = "traced to 63.43°, whose chief ray lands 12.617 mm from the axis";
        assert!(note.contains(words) && note.contains("corner lies at 20.000 mm"), "{note}");
    }
}
