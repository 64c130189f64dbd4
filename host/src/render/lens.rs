//! The lens of a camera file as the optics engine takes it.

use crate::Result;
use crate::camera::{Camera, LensKind, RelativeIllumination};
use crate::optics::interpolate::MonotoneCubic;
use crate::optics::lens::characterise::{self, Plan, PsfMethod};
use crate::optics::lens::{Catalogue, Conditions, System, read_prescription};
use crate::optics::{Characterisation, Departures, Diffraction, Illumination, Lens, SensorGrid};
use crate::scene::{Bands, Spectrum};
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

/// The lens with the departures that the file's optical effects ask for; `bands` are the wavelengths at which
/// a prescription is traced.
pub fn lens(camera: &Camera, bands: &Bands) -> Result<Box<dyn Lens>> {
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
                    let corner_mm = corner_mm(camera);
                    let (heights, ratios) = table.iter().map(|(h, r)| (h * corner_mm, *r)).unzip();
                    Illumination::Table(MonotoneCubic::new(heights, ratios))
                }
            },
            departures: Departures::default(),
        })),
        LensKind::Characterised(path) => {
            let lens = Characterisation::read(path)?;
            Ok(Box::new(with_transmittance(lens, &transmittance)?))
        }
        LensKind::Prescription(path) => {
            let lens = characterise(camera, path, bands)?;
            Ok(Box::new(with_transmittance(lens, &transmittance)?))
        }
    }
}

/// Traces the prescription out to the sensor's corner, in the scene's bands.
fn characterise(camera: &Camera, path: &Path, bands: &Bands) -> Result<Characterisation> {
    /// Image heights from the axis to the corner.
    const HEIGHTS: usize = 21;
    const PSF_SIZE: usize = 128;
    let prescription = read_prescription(path, &Catalogue::default())?;
    let system =
        System::new(prescription, Conditions::default()).map_err(|e| e.at(path.display()))?;
    let plan = Plan {
        heights: HEIGHTS,
        max_field_deg: system.field_of_paraxial_height(corner_mm(camera)).abs(),
        wavelengths_nm: bands.centres().collect(),
        psf_size: PSF_SIZE,
        psf_spacing_um: None,
        method: PsfMethod::Auto,
    };
    characterise::characterise(&system, &plan, &|| ()).map_err(|e| e.at(path.display()))
}

/// Half the sensor's diagonal, mm.
fn corner_mm(camera: &Camera) -> f64 {
    let sensor = &camera.sensor;
    f64::hypot(f64::from(sensor.width), f64::from(sensor.height)) * sensor.pitch_um * 5e-4
}

/// The camera file's transmittance on top of the lens's own.
fn with_transmittance(mut lens: Characterisation, file: &Spectrum) -> Result<Characterisation> {
    let mut nm: Vec<f64> =
        lens.transmittance.samples().chain(file.samples()).map(|(nm, _)| nm).collect();
    nm.sort_by(f64::total_cmp);
    nm.dedup();
    let value = nm.iter().map(|&nm| lens.transmittance.at(nm) * file.at(nm)).collect();
    lens.transmittance = Spectrum::new(nm, value)?;
    Ok(lens)
}
