//! Optical effects that a camera file may name in `[[effect]]`: the catalogue, and what each
//! changes.
//!
//! They act before the irradiance, so a rig never sees them; the sensor's effects are
//! [`camrig_sensor_core::effects`]. Each is a declared [`OpticalEntry`] like those: kind,
//! description, parameters with unit and range. `relative-illumination` is among the sensor's: a
//! factor over the field that is the same for all wavelengths gives the same electrons on either
//! side of the irradiance, and so needs no second name.
//!
//! # Adding an effect
//! One entry in [`OpticalEffect::CATALOGUE`] with its `apply`; one line in its test.

use super::{Departures, SensorGrid};
use camrig_base::Spectrum;
use camrig_base::{Error, Result};
use camrig_sensor_core::effects::Parameter;

/// An entry of the catalogue.
#[derive(Clone, Copy, Debug)]
pub struct OpticalEntry {
    /// Name in camera files.
    pub kind: &'static str,
    /// Description, equation and source.
    pub doc: &'static str,
    /// Its parameters in order.
    pub parameters: &'static [Parameter],
    /// Adds the effect to those before it: lengths and coefficients add, factors multiply.
    apply: fn(&[f64], &SensorGrid, &mut Optics) -> Result<()>,
}

impl PartialEq for OpticalEntry {
    fn eq(&self, other: &Self) -> bool {
        self.kind == other.kind
    }
}

/// An effect of the optics with its values.
#[derive(Clone, Debug, PartialEq)]
pub struct OpticalEffect {
    entry: &'static OpticalEntry,
    values: Vec<f32>,
}

/// The optical effects of a camera, combined.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Optics {
    /// Displacement of the sensor from the focus, away from the lens, µm.
    pub defocus_um: f64,
    /// All effects that need no knowledge of the wavefront.
    pub departures: Departures,
}

const fn parameter(
    key: &'static str,
    unit: &'static str,
    doc: &'static str,
    range: (f32, f32),
    default: Option<f32>,
) -> Parameter {
    Parameter { key, unit, doc, min: range.0, max: range.1, default }
}

/// Wavelengths at which lateral colour is given, nm: near the peaks of a camera's blue, green and
/// red channels.
const BLUE_NM: f64 = 450.0;
const GREEN_NM: f64 = 550.0;
const RED_NM: f64 = 650.0;

impl OpticalEffect {
    /// The catalogue.
    pub const CATALOGUE: &'static [OpticalEntry] = &[
        OpticalEntry {
            kind: "defocus",
            doc: "Defocus: the sensor lies out of the focus of the lens.\n\n\
                  Wavefront error δ/(8 Nw²) at the pupil's edge, Nw the image-side f-number; OTF \
                  of Hopkins 1955 for a perfect lens, traced for a prescription. A characterised \
                  lens knows no wavefront and cannot be defocused.",
            parameters: &[parameter(
                "shift_um",
                "um",
                "Distance δ of the sensor from the focus, away from the lens",
                (-1000.0, 1000.0),
                None,
            )],
            apply: |v, _, optics| {
                optics.defocus_um += v[0];
                Ok(())
            },
        },
        OpticalEntry {
            kind: "lateral-colour",
            doc: "Lateral colour: the image has another size at each wavelength.\n\n\
                  Radial displacement in proportion to the height; 0 at 550 nm, linear in \
                  wavelength between 450, 550 and 650 nm, constant beyond.",
            parameters: &[
                parameter(
                    "blue_px",
                    "pixels",
                    "Outward displacement at 450 nm in the corner",
                    (-20.0, 20.0),
                    Some(0.0),
                ),
                parameter(
                    "red_px",
                    "pixels",
                    "Outward displacement at 650 nm in the corner",
                    (-20.0, 20.0),
                    Some(0.0),
                ),
            ],
            apply: |v, grid, optics| {
                let size = |px: f64| 1.0 + px * grid.pitch_um * 1e-3 / grid.corner_mm();
                let more = Spectrum::new(
                    vec![BLUE_NM, GREEN_NM, RED_NM],
                    vec![size(v[0]), 1.0, size(v[1])],
                )?;
                let sizes = &mut optics.departures.lateral_colour;
                *sizes = sizes.times(&more)?;
                Ok(())
            },
        },
        OpticalEntry {
            kind: "distortion",
            doc: "Distortion: points lie elsewhere in the image than the lens model has them.\n\n\
                  Real height = h·(size + k1·r² + k2·r⁴), r = h over the half diagonal of the \
                  sensor (Brown 1966); size is another object distance.",
            parameters: &[
                parameter("k1", "1", "Third-order change in the corner", (-0.1, 0.2), Some(0.0)),
                parameter("k2", "1", "Fifth-order change in the corner", (-0.02, 0.1), Some(0.0)),
                parameter("size", "1", "Size of the image, relative", (0.8, 1.25), Some(1.0)),
            ],
            apply: |v, grid, optics| {
                let distortion = &mut optics.departures.distortion;
                distortion.unit_mm = grid.corner_mm();
                distortion.k1 += v[0];
                distortion.k2 += v[1];
                distortion.size *= v[2];
                Ok(())
            },
        },
        OpticalEntry {
            kind: "decentre-tilt",
            doc: "Decentred sensor: the optical axis does not meet its centre.\n\n\
                  Distortion, fall-off and field-dependent blur are about the axis; the scene \
                  stays centred on the sensor.",
            parameters: &[
                parameter(
                    "x_px",
                    "pixels",
                    "Axis right of the centre",
                    (-500.0, 500.0),
                    Some(0.0),
                ),
                parameter("y_px", "pixels", "Axis below the centre", (-500.0, 500.0), Some(0.0)),
            ],
            apply: |v, grid, optics| {
                let axis = &mut optics.departures.axis_mm;
                axis.0 += v[0] * grid.pitch_um * 1e-3;
                axis.1 += v[1] * grid.pitch_um * 1e-3;
                Ok(())
            },
        },
        OpticalEntry {
            kind: "lens-transmittance",
            doc: "Transmittance of the lens: it passes another share of the light than [lens] \
                  says.\n\n\
                  Irradiance ·= factor + slope·(λ − 550 nm)/100 nm, at least 0.",
            parameters: &[
                parameter("factor", "1", "Factor at 550 nm", (0.01, 2.0), None),
                parameter("slope", "1", "Change per 100 nm towards red", (-0.5, 0.5), Some(0.0)),
            ],
            apply: |v, _, optics| {
                let nm: Vec<f64> = (30..=120).map(|i| f64::from(i) * 10.0).collect();
                let at = |nm: &f64| (v[0] + v[1] * (nm - GREEN_NM) / 100.0).max(0.0);
                let factors = nm.iter().map(at).collect();
                let transmittance = &mut optics.departures.transmittance;
                *transmittance = transmittance.times(&Spectrum::new(nm, factors)?)?;
                Ok(())
            },
        },
        OpticalEntry {
            kind: "veiling-glare",
            doc: "Veiling glare: light scattered in the lens lies over the whole image \
                  (ISO 9358).\n\n\
                  E = (1 − g)·E + g·mean of E over the frame, per wavelength.",
            parameters: &[parameter(
                "fraction",
                "1",
                "Share g of the light that is scattered",
                (0.0, 0.5),
                None,
            )],
            apply: |v, _, optics| {
                let glare = &mut optics.departures.veiling_glare;
                *glare = 1.0 - (1.0 - *glare) * (1.0 - v[0]);
                Ok(())
            },
        },
    ];

    /// The effect of this kind; `None` when there is none, or a value is missing or out of range.
    #[must_use]
    pub fn new(kind: &str, values: &[f32]) -> Option<Self> {
        let entry = Self::CATALOGUE.iter().find(|e| e.kind == kind)?;
        let fits = values.len() == entry.parameters.len()
            && values.iter().zip(entry.parameters).all(|(v, p)| (p.min..=p.max).contains(v));
        fits.then(|| Self { entry, values: values.to_vec() })
    }

    /// Its entry.
    #[must_use]
    pub fn entry(&self) -> &'static OpticalEntry {
        self.entry
    }

    /// Its parameters in the order of the entry.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        &self.values
    }
}

impl Optics {
    /// Combines `effects` on a sensor with this grid.
    ///
    /// # Errors
    /// None for effects within their ranges.
    pub fn of(effects: &[OpticalEffect], grid: &SensorGrid) -> Result<Self> {
        let mut optics = Self::default();
        for effect in effects {
            let values: Vec<f64> = effect.values.iter().map(|&v| f64::from(v)).collect();
            (effect.entry.apply)(&values, grid, &mut optics)
                .map_err(|e: Error| e.at(effect.entry.kind))?;
        }
        Ok(optics)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_sensor_core::effects::Effect;
    use std::collections::BTreeSet;

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
