//! First-order figures by the y-nu trace (Welford 1986, ch. 3). Signed quantities: behind a mirror
//! the index counts negative, so the same equations hold.

use super::prescription::{Aperture, Object, Prescription};
use super::trace::TrainSurface;
use camrig_base::{Error, Result};

/// First-order figures at one wavelength, mm; z from the first vertex, or from the last where
/// said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Paraxial {
    /// Effective focal length on the image's side, in air.
    pub efl_mm: f64,
    /// Index of the medium that the object lies in.
    pub object_index: f64,
    /// From the last vertex to the paraxial focus of an object at infinity.
    pub bfl_mm: f64,
    /// From the last vertex to the paraxial image of the actual object.
    pub image_distance_mm: f64,
    /// Transverse magnification of the actual object, signed; 0 for an object at infinity.
    pub magnification: f64,
    /// The entrance pupil's z from the first vertex.
    pub entrance_z_mm: f64,
    /// Diameter of the entrance pupil over that of the stop.
    pub entrance_magnification: f64,
    /// The exit pupil's z from the **last** vertex.
    pub exit_z_mm: f64,
    /// Diameter of the exit pupil over that of the stop.
    pub exit_magnification: f64,
    /// Whether the lens is telecentric in object space: its entrance pupil is at infinity. Then
    /// the cross-section of the axial cone in the front principal plane stands for the entrance
    /// pupil above: image heights and f-numbers follow from it as from a pupil there.
    pub telecentric: bool,
}

/// Power below which a lens counts as afocal, 1/mm: a focal length of 1000 km. Rounding leaves
/// some 1e-16 of a surface's power in an afocal system.
const AFOCAL_PER_MM: f64 = 1e-12;
/// Magnification from the entrance pupil to the stop below which the pupil counts as at infinity
/// (the rear matrix starts at the stop's own plane, before its refraction).
const TELECENTRIC: f64 = 1e-9;
/// Reciprocal magnification below which the object counts as in the front focus.
const AT_FOCUS: f64 = 1e-12;

/// A 2x2 system matrix on (y, n·u): heights and reduced slopes.
#[derive(Clone, Copy)]
struct Matrix {
    a: f64,
    b: f64,
    c: f64,
    d: f64,
}

impl Matrix {
    const UNIT: Self = Self { a: 1.0, b: 0.0, c: 0.0, d: 1.0 };

    /// Followed by refraction with power `phi`, 1/mm.
    fn refract(self, phi: f64) -> Self {
        Self { c: self.c - phi * self.a, d: self.d - phi * self.b, ..self }
    }

    /// Followed by another system.
    fn then(self, rear: Self) -> Self {
        Self {
            a: rear.a * self.a + rear.b * self.c,
            b: rear.a * self.b + rear.b * self.d,
            c: rear.c * self.a + rear.d * self.c,
            d: rear.c * self.b + rear.d * self.d,
        }
    }

    /// Followed by transfer over the reduced distance t/n, mm.
    fn transfer(self, reduced: f64) -> Self {
        Self { a: self.a + reduced * self.c, b: self.b + reduced * self.d, ..self }
    }
}

/// Matrices from just in front of the first surface to the stop surface (not yet refracted there),
/// and from just in front of the stop surface to just behind the last; the signed last index.
/// In the plane of x and z (`meridian` 0) or y and z (1).
fn halves(surfaces: &[TrainSurface], stop: usize, meridian: usize) -> (Matrix, Matrix, f64) {
    let (mut front, mut rear) = (Matrix::UNIT, Matrix::UNIT);
    let mut sign = 1.0;
    for (i, s) in surfaces.iter().enumerate() {
        let before = sign * s.before;
        if s.is_mirror() {
            sign = -sign;
        }
        let after = sign * s.after;
        let half = if i < stop { &mut front } else { &mut rear };
        *half = half.refract(s.power(before, after)[meridian]);
        if i + 1 < surfaces.len() {
            *half = half.transfer(s.prescribed.thickness / after);
        }
    }
    (front, rear, sign * surfaces.last().map_or(1.0, |s| s.after))
}

impl Paraxial {
    /// The figures of a train of surfaces, in the plane of y and z; tilts and decentres do not
    /// count. `telecentric` says that chief rays run parallel to the axis whatever the stop.
    ///
    /// # Errors
    /// A lens without power, an object in the front focus, a telecentric lens with its object at
    /// infinity.
    pub fn of(
        surfaces: &[TrainSurface],
        stop: usize,
        object: Object,
        telecentric: bool,
    ) -> Result<Self> {
        let (front, rear, index) = halves(surfaces, stop, 1);
        let whole = front.then(rear);
        let power = -whole.c;
        if !(power.is_finite() && power.abs() > AFOCAL_PER_MM) {
            return Err(Error::unsupported("the lens has no focal length (it is afocal)")
                .help("only lenses that form an image are traced"));
        }
        let n = surfaces.first().map_or(1.0, |s| s.before);
        let (image_distance_mm, magnification) = match object {
            Object::Infinity => (whole.a / power * index, 0.0),
            Object::Distance(d) => {
                let slope = whole.c * d / n + whole.d;
                let height = whole.a * d / n + whole.b;
                if slope.abs() < AT_FOCUS {
                    return Err(Error::input(format!(
                        "the object at {d} mm is in the front focus"
                    ))
                    .help("its image is at infinity; choose another object distance"));
                }
                (-height / slope * index, 1.0 / slope)
            }
        };
        let telecentric = telecentric || front.a.abs() < TELECENTRIC;
        let (entrance_z_mm, entrance_magnification) = match (telecentric, object) {
            (false, _) => (n * front.b / front.a, 1.0 / front.a),
            (true, Object::Infinity) => {
                return Err(Error::unsupported(
                    "the entrance pupil and the object are both at infinity (telecentric in \
                     object space)",
                )
                .help("such a lens needs an object distance"));
            }
            (true, Object::Distance(d)) => {
                let to_principal = n * (1.0 - 1.0 / magnification) / power;
                (to_principal - d, to_principal / (front.a * d + n * front.b))
            }
        };
        Ok(Self {
            efl_mm: 1.0 / power,
            object_index: n,
            bfl_mm: whole.a / power * index,
            image_distance_mm,
            magnification,
            entrance_z_mm,
            entrance_magnification,
            exit_z_mm: -rear.b / rear.d * index,
            exit_magnification: 1.0 / rear.d,
            telecentric,
        })
    }

    /// Focal length on the object's side, in its medium, mm: what makes image heights of angles.
    #[must_use]
    pub fn front_efl_mm(&self) -> f64 {
        self.object_index * self.efl_mm
    }

    /// Diameter of the exit pupil over that of the entrance pupil; 1 for a telecentric lens, with
    /// what stands for its entrance pupil.
    #[must_use]
    pub fn pupil_magnification(&self) -> f64 {
        match self.telecentric {
            true => 1.0,
            false => (self.exit_magnification / self.entrance_magnification).abs(),
        }
    }
}

/// Effective focal length in the plane of x and z, mm; infinite where it has no power there.
pub(super) fn efl_x_mm(surfaces: &[TrainSurface], stop: usize) -> f64 {
    let (front, rear, _) = halves(surfaces, stop, 0);
    -1.0 / front.then(rear).c
}

/// The stop radius that a prescription's aperture asks for, mm.
///
/// # Errors
/// An object-side aperture for an object at infinity.
pub(super) fn stop_radius(paraxial: &Paraxial, prescription: &Prescription) -> Result<f64> {
    let p = paraxial;
    // tan of the marginal angle whose sine is the numerical aperture.
    let slope_of_na = |na: f64| na / (1.0 - na * na).sqrt();
    // Slope in the image of a ray through the axial object point, per unit of pupil radius.
    let image_slope_per_radius = match prescription.object {
        Object::Infinity => 1.0 / p.efl_mm,
        Object::Distance(d) => p.object_index / ((d + p.entrance_z_mm) * p.magnification),
    }
    .abs();
    let pupil_radius = match prescription.aperture {
        Aperture::StopRadius(radius) => return Ok(radius),
        Aperture::EntrancePupil(_) if p.telecentric => {
            return Err(Error::input(
                "a lens that is telecentric in object space has no entrance \
                                     pupil of finite diameter",
            )
            .help("give the numerical aperture, the f-number or the stop's radius"));
        }
        Aperture::EntrancePupil(diameter) => diameter / 2.0,
        Aperture::FNumber(n) => p.efl_mm.abs() / n / 2.0,
        Aperture::WorkingFNumber(n) => 0.5 / n / image_slope_per_radius,
        Aperture::ImageNa(na) => slope_of_na(na) / image_slope_per_radius,
        Aperture::ObjectNa(na) => match prescription.object {
            Object::Distance(d) => (d + p.entrance_z_mm).abs() * slope_of_na(na / p.object_index),
            Object::Infinity => {
                return Err(Error::input(
                    "an object-side aperture needs an object at finite distance",
                )
                .help("give the entrance pupil's diameter or the f-number"));
            }
        },
    };
    Ok(pupil_radius / p.entrance_magnification.abs())
}
