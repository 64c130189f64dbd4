//! A lens in closed form, for examples and tests.

use super::{Characterisation, PsfGrid};
use camrig_base::Spectrum;

impl Characterisation {
    /// A small invented lens of 1 mm focal length at f/2.8: barrel distortion with lateral colour,
    /// fall-off, and Gaussian PSFs of `size` x `size` samples, `spacing_um` apart, that grow with
    /// image height and wavelength.
    #[must_use]
    pub fn example(size: usize, spacing_um: f64) -> Self {
        let heights_mm: Vec<f64> = (0..6).map(|i| f64::from(i) * 0.1).collect();
        let wavelengths_nm = vec![400.0, 550.0, 700.0];
        let grid = |f: &dyn Fn(f64, f64) -> f64| -> Vec<f64> {
            let pairs =
                heights_mm.iter().flat_map(|&h| wavelengths_nm.iter().map(move |&w| (h, w)));
            pairs.map(|(h, w)| f(h, w)).collect()
        };
        let mut data = Vec::new();
        for &h in &heights_mm {
            for &w in &wavelengths_nm {
                let (radial, across) = (1.0 + 6.0 * h, 0.9 + 2.0 * h + (w - 400.0) / 600.0);
                for i in 0..size {
                    for j in 0..size {
                        let y = (i as f64 - (size / 2) as f64) * spacing_um / radial;
                        let x = (j as f64 - (size / 2) as f64) * spacing_um / across;
                        data.push(libm::exp(-0.5 * (x * x + y * y) - 0.3 * h * y.max(0.0)) as f32);
                    }
                }
            }
        }
        let mut psf = PsfGrid {
            heights_mm: heights_mm.clone(),
            wavelengths_nm: wavelengths_nm.clone(),
            size,
            spacing_um,
            data,
            captured: None,
            between: None,
        };
        // Sums of Gaussians are finite and above zero.
        let _ = psf.normalise();
        Self {
            name: "example".into(),
            source: "closed form".into(),
            efl_mm: 1.0,
            f_number: 2.8,
            magnification: 0.0,
            pupil_magnification: 1.0,
            axis_solid_angle_sr: None,
            stop_radius_mm: Some(0.18),
            transmittance: Spectrum::constant(0.9),
            real_height_mm: grid(&|h, w| h * (1.0 - 0.2 * h * h + 2e-5 * (w - 550.0))),
            relative_illumination: grid(&|h, _| 1.0 / (1.0 + h * h).powi(2)),
            chief_ray_angle_deg: Some(grid(&|h, _| libm::atan(h).to_degrees())),
            heights_mm,
            wavelengths_nm,
            psf,
        }
    }
}
