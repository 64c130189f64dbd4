//! A prescription prepared for tracing: paraxial figures, the real radius of the stop, and the
//! lens at each wavelength. How it is prepared is in `prepare`.

use super::paraxial::{self, Paraxial};
use super::prescription::{Clip, FieldKind, Form, Medium, Object, Prescription, Surface};
use super::pupil::Beam;
use super::real_height;
use super::trace::TrainSurface;
use super::train::{FieldPupil, Train};
use super::vergence;
use camrig_base::{Error, Result};
use camrig_glass::Glass;

/// A lens ready to trace.
#[derive(Clone, Debug)]
pub struct System {
    /// The prescription, with the object distance and last thickness that were asked for.
    pub prescription: Prescription,
    /// Paraxial figures at the reference wavelength.
    pub paraxial: Paraxial,
    /// Real radius of the stop, mm: the paraxial image of the entrance pupil in the stop at the
    /// reference wavelength (not the height of a real marginal ray: the two differ by the pupil's
    /// spherical aberration).
    pub stop_radius_mm: f64,
    /// Diameter of the paraxial entrance pupil, mm.
    pub entrance_pupil_mm: f64,
    /// What vignetting factors leave of the pupil at the design fields, which rise; empty where
    /// there are none, or apertures follow from them.
    pub vignetted: Vec<FieldPupil>,
}

impl System {
    /// The same lens with the sensor farther away from it, mm.
    ///
    /// # Errors
    /// A shift that is not finite.
    pub fn with_sensor_shift(&self, shift_mm: f64) -> Result<Self> {
        let mut shifted = self.clone();
        move_sensor(&mut shifted.prescription, shift_mm)?;
        Ok(shifted)
    }

    /// The lens at a wavelength, nm.
    ///
    /// # Errors
    /// A glass without data there.
    pub fn at(&self, nm: f64) -> Result<Train> {
        let p = &self.prescription;
        let mut surfaces = surfaces_at(p, nm)?;
        let paraxial = paraxial_of(p, &surfaces)?;
        vergence::set_vergences(&mut surfaces, p.object)?;
        if !p.telecentric {
            surfaces[p.stop].prescribed.clips.push(Clip::circle(self.stop_radius_mm));
        }
        Ok(Train {
            nm,
            surfaces,
            stop: p.stop,
            stop_radius_mm: self.stop_radius_mm,
            paraxial,
            object: p.object,
            entrance_z_mm: self.paraxial.entrance_z_mm,
            entrance_pupil_mm: self.entrance_pupil_mm,
            telecentric: self.paraxial.telecentric,
            vignetted: self.vignetted.clone(),
            cone_mm: p.telecentric.then_some(0.5 * self.entrance_pupil_mm),
            asymmetry: p.asymmetry(),
        })
    }

    /// Effective focal length in the plane of x and z at the reference wavelength, mm; that in y
    /// and z is [`Paraxial::efl_mm`]. They differ with biconics and toroids.
    ///
    /// # Errors
    /// A glass without data there.
    pub fn efl_x_mm(&self) -> Result<f64> {
        let p = &self.prescription;
        Ok(paraxial::efl_x_mm(&surfaces_at(p, p.reference_nm)?, p.stop))
    }

    /// Effective focal length over entrance-pupil diameter.
    #[must_use]
    pub fn f_number(&self) -> f64 {
        self.paraxial.efl_mm.abs() / self.entrance_pupil_mm
    }

    /// Height of the paraxial image of the field point at `field_deg`, mm, at the reference
    /// wavelength: n·EFL·tan θ for an object at infinity in a medium of index n, |m| times the
    /// object's height otherwise.
    #[must_use]
    pub fn paraxial_height_mm(&self, field_deg: f64) -> f64 {
        let tangent = libm::tan(field_deg.to_radians());
        match self.prescription.object {
            Object::Infinity => self.paraxial.front_efl_mm().abs() * tangent,
            Object::Distance(d) => {
                (self.paraxial.magnification * (d + self.paraxial.entrance_z_mm) * tangent).abs()
            }
        }
    }

    /// The field angle (degrees) of the field point with this paraxial image height.
    #[must_use]
    pub fn field_of_paraxial_height(&self, mm: f64) -> f64 {
        libm::atan(mm / self.paraxial_height_mm(45.0)).to_degrees()
    }

    /// The design fields as chief-ray angles at the paraxial entrance pupil, degrees.
    ///
    /// # Errors
    /// A real image height that no ray reaches; a pupil at infinity.
    pub fn fields_deg(&self) -> Result<Vec<f64>> {
        let values = self.prescription.fields.values.iter();
        values.map(|value| self.field_deg(*value)).collect()
    }

    /// A design field as chief-ray angle, degrees.
    pub(super) fn field_deg(&self, value: f64) -> Result<f64> {
        let degrees = match (self.prescription.fields.kind, self.prescription.object) {
            (FieldKind::Angle, _) => Ok(value),
            (FieldKind::ObjectHeight, Object::Infinity) => {
                Err(Error::input("fields are object heights, the object is at infinity")
                    .help("give angles"))
            }
            (FieldKind::ObjectHeight, Object::Distance(d)) => {
                Ok(libm::atan(value / (d + self.paraxial.entrance_z_mm).abs()).to_degrees())
            }
            (FieldKind::ParaxialImageHeight, _) => Ok(self.field_of_paraxial_height(value)),
            (FieldKind::RealImageHeight, _) => self.field_of_real_height(value),
        };
        degrees.map_err(|e| e.at("fields"))
    }

    /// The design fields of a lens that is not rotationally symmetric, (x, y) in degrees
    /// ([`super::field`]).
    ///
    /// # Errors
    /// Fields given by image heights; object heights with the object at infinity.
    pub fn field_places_deg(&self) -> Result<Vec<[f64; 2]>> {
        let fields = &self.prescription.fields;
        let on_y = || fields.values.iter().map(|&y| [0.0, y]).collect();
        let places = if fields.places.is_empty() { on_y() } else { fields.places.clone() };
        let wrong = |what: &str| Error::unsupported(what).at("fields").help("give field angles");
        match (fields.kind, self.prescription.object) {
            (FieldKind::Angle, _) => Ok(places),
            (FieldKind::ObjectHeight, Object::Distance(d)) => {
                // Object heights and image run in opposite senses: a field angle is positive
                // where light runs upwards, from below the axis.
                let far = d + self.paraxial.entrance_z_mm;
                let angle = |h: f64| libm::atan(-h / far).to_degrees();
                Ok(places.into_iter().map(|place| place.map(angle)).collect())
            }
            (FieldKind::ObjectHeight, Object::Infinity) => {
                Err(wrong("fields are object heights, the object is at infinity"))
            }
            _ => {
                Err(wrong("fields by image heights, of a lens that is not rotationally symmetric"))
            }
        }
    }

    /// The field angle, degrees, whose real chief ray lands at this height, mm, at the reference
    /// wavelength.
    ///
    /// # Errors
    /// A height that no chief ray reaches.
    pub fn field_of_real_height(&self, mm: f64) -> Result<f64> {
        let train = self.at(self.prescription.reference_nm)?;
        let height = |deg: f64| Ok(Beam::aim(&train, deg)?.height_mm().abs());
        real_height::first_field(mm, height)
    }
}

pub(super) fn finite(name: &str, v: f64) -> Result<f64> {
    match v.is_finite() {
        true => Ok(v),
        false => Err(Error::input(format!("{name} {v}")).help("give a finite number, in mm")),
    }
}

/// 1 where "away from the lens" is towards +z; −1 behind an odd number of mirrors.
pub(super) fn away_from_lens(prescription: &Prescription) -> f64 {
    match mirrors(prescription) % 2 {
        0 => 1.0,
        _ => -1.0,
    }
}

/// Moves the sensor away from the lens.
pub(super) fn move_sensor(prescription: &mut Prescription, shift_mm: f64) -> Result<()> {
    let last = prescription.surfaces.len() - 1;
    prescription.surfaces[last].thickness +=
        away_from_lens(prescription) * finite("sensor shift", shift_mm)?;
    Ok(())
}

pub(super) fn paraxial_of(
    prescription: &Prescription,
    surfaces: &[TrainSurface],
) -> Result<Paraxial> {
    let p = prescription;
    Paraxial::of(surfaces, p.stop, p.object, p.telecentric)
}

fn mirrors(prescription: &Prescription) -> usize {
    prescription.surfaces.iter().filter(|s| s.medium == Medium::Mirror).count()
}

/// The surfaces with their indices at a wavelength.
pub(super) fn surfaces_at(prescription: &Prescription, nm: f64) -> Result<Vec<TrainSurface>> {
    let index = |glass: &Glass| glass.index(nm);
    let object_glass = prescription.object_glass.as_ref();
    let in_front = object_glass.map(index).transpose().map_err(|e| e.at("the object"))?;
    let (mut before, mut forward) = (in_front.unwrap_or(1.0), true);
    let mut train = Vec::with_capacity(prescription.surfaces.len());
    for (i, s) in prescription.surfaces.iter().enumerate() {
        let after = match &s.medium {
            _ if s.form == Form::Break => before,
            Medium::Air => 1.0,
            Medium::Glass(glass) => {
                index(glass).map_err(|e| e.at(format!("surface {}", i + 1)))?
            }
            Medium::Mirror => before,
        };
        forward &= s.entry.is_none();
        let prescribed = Surface { even: trimmed(&s.even), odd: trimmed(&s.odd), ..s.clone() };
        train.push(TrainSurface { prescribed, before, after, forward, vergence: 0.0 });
        before = after;
        forward &= s.exit.is_none() && s.medium != Medium::Mirror;
    }
    Ok(train)
}

/// Coefficients without the zeros at the end.
fn trimmed(coefficients: &[f64]) -> Vec<f64> {
    let used = coefficients.iter().rposition(|v| *v != 0.0).map_or(0, |i| i + 1);
    coefficients[..used].to_vec()
}
