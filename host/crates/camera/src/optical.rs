//! Optical effects that a camera file may name in `[[effect]]`: the catalogue, and what each
//! changes.
//!
//! They act before the irradiance, so a rig never sees them; the sensor's effects are
//! [`camrig_sensor_core::effects`]. What a [`Change`] does to a lens is computed where the camera's
//! lens is made, in `camrig-render`. Each is a declared [`OpticalEntry`] like those: kind,
//! description, parameters with unit and range. `relative-illumination` is among the sensor's: a
//! factor over the field that is the same for all wavelengths gives the same electrons on either
//! side of the irradiance, and so needs no second name.
//!
//! # Adding an effect
//! One entry in [`OpticalEffect::CATALOGUE`] and one variant of [`Change`], which
//! `camrig_render` then has to apply.

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
    change: fn(&[f64]) -> Change,
}

impl PartialEq for OpticalEntry {
    fn eq(&self, other: &Self) -> bool {
        self.kind == other.kind
    }
}

/// What an effect changes, in the units of its parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    /// The sensor lies out of focus.
    Defocus {
        /// Its distance from the focus, away from the lens, µm.
        shift_um: f64,
    },
    /// The image has another size at each wavelength.
    LateralColour {
        /// Outward displacement at 450 nm in the corner.
        blue_px: f64,
        /// The same at 650 nm.
        red_px: f64,
    },
    /// Points lie elsewhere in the image.
    Distortion {
        /// Third-order change in the corner.
        k1: f64,
        /// Fifth-order change in the corner.
        k2: f64,
        /// Size of the image, relative.
        size: f64,
    },
    /// The axis does not meet the sensor's centre.
    DecentreTilt {
        /// Axis right of the centre.
        x_px: f64,
        /// Axis below the centre.
        y_px: f64,
    },
    /// The lens passes another share of the light.
    LensTransmittance {
        /// Factor at 550 nm.
        factor: f64,
        /// Change per 100 nm towards red.
        slope: f64,
    },
    /// The stop of the lens is another one.
    FNumber {
        /// Light over that at the f-number of `[lens]`, the inverse square of their ratio.
        light: f64,
    },
    /// Scattered light lies over the whole image.
    VeilingGlare {
        /// Share of the light that is scattered.
        fraction: f64,
    },
}

/// An effect of the optics with its values.
#[derive(Clone, Debug, PartialEq)]
pub struct OpticalEffect {
    entry: &'static OpticalEntry,
    values: Vec<f32>,
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

impl OpticalEffect {
    /// The catalogue.
    pub const CATALOGUE: &'static [OpticalEntry] = &[
        OpticalEntry {
            kind: "defocus",
            doc: "Defocus: the sensor lies out of the focus of the lens.\n\n\
                  Wavefront error δ/(8 Nw²) at the pupil's edge, Nw the image-side f-number; OTF \
                  of Hopkins 1955 for a perfect lens, traced for a prescription. A characterised \
                  lens knows no wavefront and cannot be defocused.\n\n\
                  Source: Hopkins 1955, Proc. R. Soc. A 231, 91.\n\n\
                  Closed form: the MTF of a defocused perfect lens as Hopkins gives it.",
            parameters: &[parameter(
                "shift_um",
                "um",
                "Distance δ of the sensor from the focus, away from the lens",
                (-1000.0, 1000.0),
                None,
            )],
            change: |v| Change::Defocus { shift_um: v[0] },
        },
        OpticalEntry {
            kind: "lateral-colour",
            doc: "Lateral colour: the image has another size at each wavelength.\n\n\
                  Radial displacement in proportion to the height; 0 at 550 nm, linear in \
                  wavelength between 450, 550 and 650 nm, constant beyond.\n\n\
                  Source: definition.\n\n\
                  Closed form: a point at the height h lies h/h_corner times the \
                  displacement further out at 450 and 650 nm.",
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
            change: |v| Change::LateralColour { blue_px: v[0], red_px: v[1] },
        },
        OpticalEntry {
            kind: "distortion",
            doc: "Distortion: points lie elsewhere in the image than the lens model has them.\n\n\
                  Real height = h·(size + k1·r² + k2·r⁴), r = h over the half diagonal of the \
                  sensor (Brown 1966); size is another object distance.\n\n\
                  Source: Brown 1966.\n\n\
                  Closed form: the height of a point, by the equation.",
            parameters: &[
                parameter("k1", "1", "Third-order change in the corner", (-0.1, 0.2), Some(0.0)),
                parameter("k2", "1", "Fifth-order change in the corner", (-0.02, 0.1), Some(0.0)),
                parameter("size", "1", "Size of the image, relative", (0.8, 1.25), Some(1.0)),
            ],
            change: |v| Change::Distortion { k1: v[0], k2: v[1], size: v[2] },
        },
        OpticalEntry {
            kind: "decentre-tilt",
            doc: "Decentred sensor: the optical axis does not meet its centre.\n\n\
                  Distortion, fall-off and field-dependent blur are about the axis; the scene \
                  stays centred on the sensor.\n\n\
                  Source: definition.\n\n\
                  Closed form: fall-off and displacement of a point by its distance from the axis, \
                  not from the centre.",
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
            change: |v| Change::DecentreTilt { x_px: v[0], y_px: v[1] },
        },
        OpticalEntry {
            kind: "lens-transmittance",
            doc: "Transmittance of the lens: it passes another share of the light than [lens] \
                  says.\n\n\
                  Irradiance ·= factor + slope·(λ − 550 nm)/100 nm, at least 0.\n\n\
                  Source: definition.\n\n\
                  Closed form: electrons times factor at 550 nm, by the slope elsewhere.",
            parameters: &[
                parameter("factor", "1", "Factor at 550 nm", (0.01, 2.0), None),
                parameter("slope", "1", "Change per 100 nm towards red", (-0.5, 0.5), Some(0.0)),
            ],
            change: |v| Change::LensTransmittance { factor: v[0], slope: v[1] },
        },
        OpticalEntry {
            kind: "f-number",
            doc: "Another f-number: the stop of the lens is not the one that [lens] says, as after \
                  one click of the aperture ring.\n\n\
                  N = N₀/√light, with all that depends on it: irradiance 1/N², the Airy disc, \
                  the depth of focus; one stop is light = 0.5. Of a lens of kind \
                  \"diffraction-limited\"; others have figures for their own stop.\n\n\
                  Source: Chen et al. 2009, eqs. 6 and 7.\n\n\
                  Closed form: electrons times light, cutoff of the MTF times its root.",
            parameters: &[parameter(
                "light",
                "1",
                "Light over that at the f-number of [lens], (N₀/N)²",
                (0.06, 16.0),
                None,
            )],
            change: |v| Change::FNumber { light: v[0] },
        },
        OpticalEntry {
            kind: "veiling-glare",
            doc: "Veiling glare: light scattered in the lens lies over the whole image \
                  (ISO 9358).\n\n\
                  E = (1 − g)·E + g·mean of E over the frame, per wavelength.\n\n\
                  Source: ISO 9358.\n\n\
                  Closed form: in a frame half black and half white, black reads g/2 of \
                  white's light without glare.",
            parameters: &[parameter(
                "fraction",
                "1",
                "Share g of the light that is scattered",
                (0.0, 0.5),
                None,
            )],
            change: |v| Change::VeilingGlare { fraction: v[0] },
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

    /// What it changes.
    #[must_use]
    pub fn change(&self) -> Change {
        let values: Vec<f64> = self.values.iter().map(|&v| f64::from(v)).collect();
        (self.entry.change)(&values)
    }

    /// Its parameters in the order of the entry.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        &self.values
    }
}
