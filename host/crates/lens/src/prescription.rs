//! A lens prescription: surfaces, glasses, stop, fields and wavelengths, checked, in mm.
//!
//! # Conventions
//! Light travels along +z. A surface with positive curvature has its centre on the +z side; its
//! thickness leads to the next surface (negative after a mirror). Surface 0 is the first one light
//! meets; object and image are not in the list. The last thickness leads to the image plane. In a
//! file's own numbering the first surface is usually 1, and messages call it so.

use super::glass::Glass;
use camrig_base::{Error, Result};

/// A rotationally symmetric sequential lens.
#[derive(Clone, Debug, PartialEq)]
pub struct Prescription {
    /// Name of the lens.
    pub name: String,
    /// Surfaces in the order light meets them, the stop among them.
    pub surfaces: Vec<Surface>,
    /// Index of the stop in `surfaces`.
    pub stop: usize,
    /// Where the object is.
    pub object: Object,
    /// What fixes the size of the stop.
    pub aperture: Aperture,
    /// Design wavelengths, nm, in the file's order.
    pub wavelengths_nm: Vec<f64>,
    /// The wavelength that paraxial figures and the stop radius refer to, nm.
    pub reference_nm: f64,
    /// Design fields.
    pub fields: Fields,
    /// What the reader ignored or assumed, as messages for the user.
    pub notes: Vec<String>,
}

/// One surface and the space behind it.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Vertex curvature of the conic part, 1/mm.
    pub curvature: f64,
    /// Conic constant k: 0 sphere, −1 paraboloid.
    pub conic: f64,
    /// Coefficients of r², r⁴, r⁶, ... added to the conic's sag, mm^(1−power).
    pub even: Vec<f64>,
    /// Coefficients of r, r³, r⁵, ... added to the conic's sag.
    pub odd: Vec<f64>,
    /// Distance to the next vertex (after the last surface: to the image), mm.
    pub thickness: f64,
    /// The medium behind it.
    pub medium: Medium,
    /// Apertures here, the stop excepted.
    pub clips: Vec<Clip>,
}

/// The medium behind a surface.
#[derive(Clone, Debug, PartialEq)]
pub enum Medium {
    /// Air, index 1.
    Air,
    /// A glass.
    Glass(Glass),
    /// The surface reflects; the medium stays the one in front of it.
    Mirror,
}

/// An aperture: it passes `inner` ≤ r ≤ `outer`, mm. An infinite `outer` makes it a central
/// obscuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clip {
    /// Inner radius, mm.
    pub inner: f64,
    /// Outer radius, mm.
    pub outer: f64,
}

impl Clip {
    /// A clear aperture of this radius, mm.
    #[must_use]
    pub fn circle(radius: f64) -> Self {
        Self { inner: 0.0, outer: radius }
    }

    /// Relative excess of (x, y), mm, over the aperture: negative inside, 0 on the edge, smooth in
    /// x and y.
    #[inline(always)]
    #[must_use]
    pub fn excess(&self, x: f64, y: f64) -> f64 {
        let r2 = x * x + y * y;
        let out = r2 / (self.outer * self.outer) - 1.0;
        if self.inner > 0.0 { out.max(1.0 - r2 / (self.inner * self.inner)) } else { out }
    }
}

/// Where the object is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Object {
    /// At infinity.
    Infinity,
    /// A plane this far in front of the first surface, mm.
    Distance(f64),
}

/// What fixes the size of the stop. All but the first are paraxial, at the reference wavelength;
/// the *real* stop radius follows from them and is what is traced to and stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aperture {
    /// Radius of the stop itself, mm.
    StopRadius(f64),
    /// Diameter of the entrance pupil, mm.
    EntrancePupil(f64),
    /// Effective focal length over entrance-pupil diameter.
    FNumber(f64),
    /// 1/(2·u'), u' the slope of the marginal ray at the image of the actual object.
    WorkingFNumber(f64),
    /// Sine of the marginal ray's angle at the object.
    ObjectNa(f64),
    /// Sine of the marginal ray's angle at the image.
    ImageNa(f64),
}

/// Design fields: how far off the axis the lens is meant to be used.
#[derive(Clone, Debug, PartialEq)]
pub struct Fields {
    /// What `values` are.
    pub kind: FieldKind,
    /// Field values, not negative.
    pub values: Vec<f64>,
    /// Vignetting factors per field in CODE V's sense, [upper x, lower x, upper y, lower y]: the
    /// part of the pupil's half width that is lost on that side. Empty where there are none.
    pub vignetting: Vec<[f64; 4]>,
}

/// What a field value measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldKind {
    /// Angle of the chief ray at the entrance pupil, degrees.
    Angle,
    /// Height of the object, mm.
    ObjectHeight,
    /// Height of the paraxial image, mm.
    ParaxialImageHeight,
    /// Height at which the real chief ray lands, mm.
    RealImageHeight,
}

impl FieldKind {
    /// Distance from the axis of the field (x, y): of heights the length, of angles that of the
    /// direction whose projections on the planes of x and y have these angles.
    #[must_use]
    pub fn off_axis(self, x: f64, y: f64) -> f64 {
        if self != Self::Angle || x == 0.0 || y == 0.0 {
            return (x * x + y * y).sqrt();
        }
        let [x, y] = [x, y].map(|v| libm::tan(v.to_radians()));
        libm::atan((x * x + y * y).sqrt()).to_degrees()
    }
}

impl Surface {
    /// A plane in air; `thickness` in mm.
    #[must_use]
    pub fn plane(thickness: f64) -> Self {
        Self {
            curvature: 0.0,
            conic: 0.0,
            even: Vec::new(),
            odd: Vec::new(),
            thickness,
            medium: Medium::Air,
            clips: Vec::new(),
        }
    }
}

impl Prescription {
    /// Checks what ray tracing relies on.
    ///
    /// # Errors
    /// No surface, a stop that is not among them, values that are not finite or have the wrong
    /// sign, no wavelength, no field.
    pub fn validate(&self) -> Result<()> {
        if self.surfaces.is_empty() {
            return Err(Error::input("the prescription has no surface between object and image")
                .help("it needs at least the stop"));
        }
        if self.stop >= self.surfaces.len() {
            return Err(Error::input(format!("the stop is surface {}", self.stop + 1))
                .help(format!("surfaces are 1 to {}", self.surfaces.len())));
        }
        for (i, surface) in self.surfaces.iter().enumerate() {
            surface.validate().map_err(|e| e.at(format!("surface {}", i + 1)))?;
        }
        if let Object::Distance(d) = self.object {
            positive("object distance", d)?;
        }
        let (name, value) = match self.aperture {
            Aperture::StopRadius(v) => ("stop radius", v),
            Aperture::EntrancePupil(v) => ("entrance pupil diameter", v),
            Aperture::FNumber(v) => ("f-number", v),
            Aperture::WorkingFNumber(v) => ("working f-number", v),
            Aperture::ObjectNa(v) => ("object-side numerical aperture", v),
            Aperture::ImageNa(v) => ("image-side numerical aperture", v),
        };
        positive(name, value)?;
        if matches!(self.aperture, Aperture::ObjectNa(v) | Aperture::ImageNa(v) if v >= 1.0) {
            return Err(Error::input(format!("{name} {value}")).help("in air it is below 1"));
        }
        if self.wavelengths_nm.is_empty() {
            return Err(Error::input("no wavelength").help("give at least one, in nm"));
        }
        for nm in self.wavelengths_nm.iter().chain([&self.reference_nm]) {
            positive("wavelength", *nm)?;
        }
        let vignetting = &self.fields.vignetting;
        if self.fields.values.is_empty()
            || self.fields.values.iter().any(|v| !v.is_finite() || *v < 0.0)
            || !(vignetting.is_empty() || vignetting.len() == self.fields.values.len())
        {
            return Err(Error::input(format!("fields {:?}", self.fields.values))
                .help("give at least one field, each from 0 up"));
        }
        Ok(())
    }
}

impl Surface {
    fn validate(&self) -> Result<()> {
        let numbers = [self.curvature, self.conic, self.thickness];
        let mut all = numbers.iter().chain(&self.even).chain(&self.odd);
        if let Some(v) = all.find(|v| !v.is_finite()) {
            return Err(Error::input(format!("value {v}")).help("finite numbers only"));
        }
        for clip in &self.clips {
            if !(clip.inner >= 0.0 && clip.outer > clip.inner) {
                let what = format!("aperture from radius {} to {}", clip.inner, clip.outer);
                return Err(Error::input(what).help("the outer radius lies above the inner one"));
            }
        }
        Ok(())
    }
}

fn positive(name: &str, value: f64) -> Result<()> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(Error::input(format!("{name} {value}")).help("give a positive number"))
}
