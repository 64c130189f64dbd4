//! The lens of a camera file as the optics engine takes it.

use crate::camera::{Camera, LensKind, RelativeIllumination};
use crate::optics::effects::Optics;
use crate::optics::interpolate::MonotoneCubic;
use crate::optics::lens::characterise::{self, Plan, PsfMethod};
use crate::optics::lens::heights::Density;
use crate::optics::lens::{Catalogue, Conditions, System, read_prescription};
use crate::optics::{Characterisation, Departed, Departures, Diffraction, Illumination};
use crate::optics::{Lens, Options, SensorGrid};
use crate::scene::Bands;
use crate::{Error, Result};
use std::path::Path;

/// The sensor's grid as the optics sees it.
pub fn sensor_grid(camera: &Camera) -> SensorGrid {
    let sensor = &camera.sensor;
    SensorGrid {
        width: sensor.width as usize,
        height: sensor.height as usize,
        pitch_um: sensor.pitch_um,
        fill_factor: sensor.fill_factor,
    }
}

/// The lens with the optical effects of the camera file. A prescription is traced at the wavelengths of `bands`, at as
/// many heights as [`Options::misplaced_light`] asks.
///
/// # Errors
/// Lens data that cannot be read or traced; a defocus of a lens whose wavefront is not known.
pub fn lens(camera: &Camera, bands: &Bands, options: &Options) -> Result<Box<dyn Lens>> {
    let optics = Optics::of(&camera.optical_effects, &sensor_grid(camera))?;
    let lens = described(camera, bands, options, optics.defocus_um)?;
    Ok(match optics.departures == Departures::default() {
        true => lens,
        false => Box::new(Departed { lens, departures: optics.departures }),
    })
}

/// The lens as `[lens]` describes it, with the sensor `defocus_um` further away.
fn described(
    camera: &Camera,
    bands: &Bands,
    options: &Options,
    defocus_um: f64,
) -> Result<Box<dyn Lens>> {
    let transmittance = camera.lens.transmittance.clone();
    match &camera.lens.kind {
        LensKind::DiffractionLimited {
            f_number,
            focal_length_mm,
            magnification,
            relative_illumination,
        } => Ok(Box::new(Diffraction {
            f_number: *f_number,
            focal_length_mm: *focal_length_mm,
            magnification: *magnification,
            transmittance,
            illumination: match relative_illumination {
                RelativeIllumination::Cos4 => Illumination::Cos4,
                RelativeIllumination::Flat => Illumination::Uniform,
                RelativeIllumination::Table(table) => {
                    let corner_mm = sensor_grid(camera).corner_mm();
                    let (heights, ratios) = table.iter().map(|(h, r)| (h * corner_mm, *r)).unzip();
                    Illumination::Table(MonotoneCubic::new(heights, ratios))
                }
            },
            defocus_um,
        })),
        LensKind::Characterised(_) if defocus_um != 0.0 => {
            Err(Error::input("defocus of a characterised lens: its tables hold no wavefront")
                .at("[[effect]] kind = \"defocus\"")
                .help(
                    "use a lens of kind \"prescription\" or \"diffraction-limited\", or a \
                     characterisation made out of focus (camrig lens trace --sensor-shift)",
                ))
        }
        LensKind::Characterised(path) => {
            let mut lens = Characterisation::read(path)?;
            lens.transmittance = lens.transmittance.times(&transmittance)?;
            Ok(Box::new(lens))
        }
        LensKind::Prescription(path) => {
            let mut lens = characterise(camera, path, bands, options, defocus_um)?;
            lens.transmittance = lens.transmittance.times(&transmittance)?;
            Ok(Box::new(lens))
        }
    }
}

/// Traces the prescription out to the sensor's corner, in the scene's bands.
fn characterise(
    camera: &Camera,
    path: &Path,
    bands: &Bands,
    options: &Options,
    defocus_um: f64,
) -> Result<Characterisation> {
    /// Image heights from the axis to the corner, before more are added.
    const HEIGHTS: usize = 21;
    const PSF_SIZE: usize = 128;
    let prescription = read_prescription(path, &Catalogue::default())?;
    let conditions = Conditions { sensor_shift_mm: 1e-3 * defocus_um, ..Conditions::default() };
    let system = System::new(prescription, conditions).map_err(|e| e.at(path.display()))?;
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
    characterise::characterise(&system, &plan, &|_, _| ()).map_err(|e| e.at(path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::diffraction::hopkins_otf;
    use crate::optics::{Blur, OpticalEffect};
    use std::path::PathBuf;

    fn steradians_and_mtf(camera: &Camera) -> (f64, f64) {
        let lens = lens(camera, &Bands::VISIBLE, &Options::default()).unwrap();
        let mtf = match lens.blur(550.0) {
            Blur::Otf { otf, .. } => otf(100.0),
            Blur::Field { psfs, .. } => psfs.axial_mtf()(100.0),
        };
        (lens.steradians(550.0), mtf)
    }

    #[test]
    fn optical_effects_reach_every_kind_of_lens_that_can_have_them() {
        let mut camera = Camera::load("mt9t012").unwrap();
        let (light, mtf) = steradians_and_mtf(&camera);
        let effect = |kind, values: &[f32]| OpticalEffect::new(kind, values).unwrap();
        camera.optical_effects =
            vec![effect("defocus", &[20.0]), effect("lens-transmittance", &[0.5, 0.0])];
        let (less, lower) = steradians_and_mtf(&camera);
        assert!((less / light - 0.5).abs() < 1e-12 && lower < 0.9 * mtf, "{lower} of {mtf}");

        camera.lens.kind = LensKind::Characterised(PathBuf::from("not-read"));
        let error = lens(&camera, &Bands::VISIBLE, &Options::default()).err().unwrap().to_string();
        assert!(error.contains("no wavefront"), "{error}");

        // A plane and a hyperboloid of eccentricity n: perfect on the axis, so Hopkins holds.
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("singlet.toml");
        std::fs::write(&file, SINGLET).unwrap();
        camera.lens.kind = LensKind::Prescription(file);
        (camera.sensor.width, camera.sensor.height) = (64, 48);
        let bands = Bands { start_nm: 550.0, step_nm: 10.0, count: 1 };
        for defocus_um in [0.0, 40.0, -80.0] {
            camera.optical_effects = vec![effect("defocus", &[defocus_um])];
            let lens = lens(&camera, &bands, &Options::default()).unwrap();
            let Blur::Field { psfs, cutoff_per_mm } = lens.blur(550.0) else {
                panic!("a traced lens has PSFs")
            };
            let waves = f64::from(defocus_um).abs() / (8.0 * 16.0 * 0.55);
            for per_mm in [30.0, 60.0, 120.0] {
                let theory = hopkins_otf(per_mm / cutoff_per_mm, waves).abs();
                let found = psfs.axial_mtf()(per_mm);
                // The window of 128 samples cuts the PSF's wings, some per cent of its light.
                assert!((found - theory).abs() < 0.03, "{defocus_um} {per_mm}: {found} {theory}");
            }
        }
    }

    const SINGLET: &str = r#"
format = "camrig-prescription/1"
wavelengths_nm = [550.0]
fields_deg = [0.0]
[aperture]
f_number = 4.0
[[surface]]
thickness_mm = 2.0
glass = "flat"
stop = true
[[surface]]
radius_mm = -5.0
conic = -2.25
thickness_mm = 10.0
[glass.flat]
table_nm = [[400.0, 1.5], [700.0, 1.5]]
"#;
}
