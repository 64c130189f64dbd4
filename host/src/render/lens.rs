//! The lens of a camera file as the optics engine takes it.

use crate::camera::{Camera, LensKind, RelativeIllumination};
use crate::optics::interpolate::MonotoneCubic;
use crate::optics::{Departures, Diffraction, Illumination, Lens, SensorGrid};
use crate::{Error, Result};

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

/// The lens with the departures that the file's optical effects ask for.
pub fn lens(camera: &Camera) -> Result<Box<dyn Lens>> {
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
                    let sensor = &camera.sensor;
                    let corner_mm = f64::hypot(f64::from(sensor.width), f64::from(sensor.height))
                        * sensor.pitch_um
                        * 5e-4;
                    let (heights, ratios) = table.iter().map(|(h, r)| (h * corner_mm, *r)).unzip();
                    Illumination::Table(MonotoneCubic::new(heights, ratios))
                }
            },
            departures: Departures::default(),
        })),
        LensKind::Characterised(path) | LensKind::Prescription(path) => {
            Err(Error::input(format!("the lens of {} is not available yet", path.display())))
        }
    }
}
