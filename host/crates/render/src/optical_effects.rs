//! What the optical effects of a camera file do to its lens.

use camrig_base::{Error, Result, Spectrum};
use camrig_camera::optical::{Change, OpticalEffect};
use camrig_optics::{Departures, SensorGrid};

/// The optical effects of a camera, combined.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Optics {
    /// Displacement of the sensor from the focus, away from the lens, µm.
    pub defocus_um: f64,
    /// Natural logarithm of the f-number over that of the camera file.
    pub ln_f_number: f64,
    /// All effects that need no knowledge of the wavefront.
    pub departures: Departures,
}

/// Wavelengths at which lateral colour is given, nm: near the peaks of a camera's blue, green and
/// red channels.
const BLUE_NM: f64 = 450.0;
const GREEN_NM: f64 = 550.0;
const RED_NM: f64 = 650.0;
/// Ends of what lenses are described for, nm.
const ENDS_NM: [f64; 2] = [300.0, 1200.0];

impl Optics {
    /// Combines `effects` on a sensor with this grid.
    ///
    /// # Errors
    /// None for effects within their ranges.
    pub fn of(effects: &[OpticalEffect], grid: &SensorGrid) -> Result<Self> {
        let mut optics = Self::default();
        for effect in effects {
            let kind = effect.entry().kind;
            optics.add(effect.change(), grid).map_err(|e: Error| e.at(kind))?;
        }
        Ok(optics)
    }

    /// Adds an effect to those before it: lengths and coefficients add, factors multiply.
    fn add(&mut self, change: Change, grid: &SensorGrid) -> Result<()> {
        match change {
            Change::Defocus { shift_um } => {
                self.defocus_um += shift_um;
            }
            Change::LateralColour { blue_px, red_px } => {
                let size = |px: f64| 1.0 + px * grid.pitch_um * 1e-3 / grid.corner_mm();
                let more = Spectrum::new(
                    vec![BLUE_NM, GREEN_NM, RED_NM],
                    vec![size(blue_px), 1.0, size(red_px)],
                )?;
                let sizes = &mut self.departures.lateral_colour;
                *sizes = sizes.times(&more)?;
            }
            Change::Distortion { k1, k2, size } => {
                let distortion = &mut self.departures.distortion;
                distortion.unit_mm = grid.corner_mm();
                distortion.k1 += k1;
                distortion.k2 += k2;
                distortion.size *= size;
            }
            Change::DecentreTilt { x_px, y_px } => {
                let axis = &mut self.departures.axis_mm;
                axis.0 += x_px * grid.pitch_um * 1e-3;
                axis.1 += y_px * grid.pitch_um * 1e-3;
            }
            Change::LensTransmittance { factor, slope } => {
                // A straight line to where it meets 0, if it does.
                let zero_nm = GREEN_NM - 100.0 * factor / slope;
                let nm: Vec<f64> = match ENDS_NM[0] < zero_nm && zero_nm < ENDS_NM[1] {
                    true => vec![ENDS_NM[0], zero_nm, ENDS_NM[1]],
                    false => ENDS_NM.to_vec(),
                };
                let at = |nm: &f64| (factor + slope * (nm - GREEN_NM) / 100.0).max(0.0);
                let factors = nm.iter().map(at).collect();
                let transmittance = &mut self.departures.transmittance;
                *transmittance = transmittance.times(&Spectrum::new(nm, factors)?)?;
            }
            Change::FNumber { light } => {
                self.ln_f_number -= 0.5 * libm::log(light);
            }
            Change::VeilingGlare { fraction } => {
                let glare = &mut self.departures.veiling_glare;
                *glare = 1.0 - (1.0 - *glare) * (1.0 - fraction);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_sensor_core::effects::Effect;
    use std::collections::BTreeSet;

    /// Where each effect has its test against its closed form.
    const TESTS: &str = include_str!("../tests/optical_effects.rs");
    const GRID: SensorGrid =
        SensorGrid { width: 300, height: 400, pitch_um: 2.0, fill_factor: 1.0 };

    fn optics(effects: &[(&str, &[f32])]) -> Optics {
        let effects: Vec<_> =
            effects.iter().map(|(k, v)| OpticalEffect::new(k, v).unwrap()).collect();
        Optics::of(&effects, &GRID).unwrap()
    }

    #[test]
    fn entries_are_sound_and_no_kind_has_two_meanings() {
        let mut kinds: BTreeSet<&str> = Effect::CATALOGUE.iter().map(|e| e.kind).collect();
        for entry in OpticalEffect::CATALOGUE {
            assert!(kinds.insert(entry.kind), "{} is there twice", entry.kind);
            assert!(entry.doc.len() > 40, "{}", entry.kind);
            for part in ["Source: ", "Closed form: "] {
                assert!(entry.doc.contains(&format!("\n\n{part}")), "{}: {part}", entry.kind);
            }
            let test = format!("fn {}() {{", entry.kind.replace('-', "_"));
            assert!(TESTS.contains(&test), "{}", entry.kind);
            for p in entry.parameters {
                assert!(p.min < p.max && !p.doc.is_empty() && !p.unit.is_empty(), "{}", p.key);
                assert!(p.default.is_none_or(|d| (p.min..=p.max).contains(&d)), "{}", p.key);
            }
            let most: Vec<f32> = entry.parameters.iter().map(|p| p.max).collect();
            assert_ne!(optics(&[(entry.kind, &most)]), Optics::default(), "{}", entry.kind);
            assert_eq!(OpticalEffect::new(entry.kind, &[]), None);
        }
        assert_eq!(OpticalEffect::new("defocus", &[2000.0]), None);
    }

    #[test]
    fn effects_of_one_kind_add_up_and_mean_what_they_say() {
        let o = optics(&[
            ("defocus", &[12.0]),
            ("defocus", &[-4.0]),
            ("veiling-glare", &[0.1]),
            ("veiling-glare", &[0.1]),
            ("lens-transmittance", &[0.9, 0.05]),
            ("lens-transmittance", &[0.5, 0.0]),
            ("decentre-tilt", &[10.0, -5.0]),
        ]);
        assert_eq!(o.defocus_um, 8.0);
        let d = o.departures;
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-7, "{a} instead of {b}");
        near(d.veiling_glare, 0.19);
        near(d.transmittance.at(550.0), 0.45);
        near(d.transmittance.at(650.0), 0.475);
        near(d.axis_mm.0, 0.02);
        near(d.axis_mm.1, -0.01);
        // The half diagonal is 0.5 mm: 2.5 pixels of 2 µm are 1 % of it.
        let d = optics(&[("lateral-colour", &[0.0, 2.5])]).departures;
        near(d.lateral_colour.at(650.0), 1.01);
        near(d.lateral_colour.at(600.0), 1.005);
        near(d.lateral_colour.at(450.0), 1.0);
        let d = optics(&[("distortion", &[0.04, -0.01, 1.02])]).departures;
        near(d.distortion.real(0.5), 0.5 * 1.05);
        near(d.distortion.real(0.25), 0.25 * (1.02 + 0.01 - 0.000625));
    }
}
