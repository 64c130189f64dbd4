//! How a prescription becomes a [`System`]: object and sensor are moved, the stop's radius, clear
//! apertures and the best focus are found.

use super::System;
use super::best_focus;
use super::field;
use super::fold;
use super::paraxial::{self, Paraxial};
use super::prescription::{Clip, Conditions, FieldKind, Focus, Medium, Object, Prescription};
use super::pupil::Beam;
use super::system::{away_from_lens, finite, move_sensor, paraxial_of, surfaces_at};
use super::trace::TrainSurface;
use super::train::{FieldPupil, Train};
use camrig_base::{Error, ErrorCode, ErrorKind, Result};

/// Width of a point's spot over that of the exit pupil from which on a sensor is reported as far
/// out of focus. Chosen: a camera focused at infinity sees an object at ten focal lengths so.
const WIDEST_SPOT: f64 = 0.1;
/// Relative difference of light up to which apertures cut as vignetting factors say: they cut
/// segments off a pupil, factors make an ellipse of it.
const SAME_LIGHT: f64 = 0.1;
/// Relative difference of stop radii from which on they are not one.
const SAME_STOP: f64 = 1e-6;

impl System {
    /// Prepares a prescription for use under `conditions`.
    ///
    /// # Errors
    /// An invalid prescription, glasses without data at the reference wavelength, a lens without
    /// power, a stop that light does not fill.
    pub fn new(prescription: Prescription, conditions: Conditions) -> Result<Self> {
        prescription.validate()?;
        let mut prescription = fold::unfolded(prescription);
        let designed = prescription.object;
        if let Some(distance) = conditions.object_distance_mm {
            prescription.object = object_at(distance);
        }
        let reference_nm = conditions.reference_nm.unwrap_or(prescription.reference_nm);
        prescription.reference_nm = reference_nm;
        prescription.validate()?;
        if conditions.reference_nm.is_some() {
            // Another one is no substitute for a wavelength that a person gave.
            surfaces_at(&prescription, reference_nm).map_err(|e| e.at("reference wavelength"))?;
        }
        keep_known_wavelengths(&mut prescription);
        if let Focus::At(distance) = conditions.focus {
            focus_at(&mut prescription, designed, distance)?;
        }
        if !matches!(conditions.focus, Focus::BestMtf(_)) {
            move_sensor(&mut prescription, conditions.sensor_shift_mm)?;
        }
        let surfaces = surfaces_at(&prescription, prescription.reference_nm)?;
        let paraxial = paraxial_of(&prescription, &surfaces)?;
        let from_file = paraxial::stop_radius(&paraxial, &prescription)?;
        let stop_radius_mm = match conditions.stop_radius_mm {
            Some(radius) => finite("stop radius", radius)?,
            None => from_file,
        };
        if !(stop_radius_mm.is_finite() && stop_radius_mm > 0.0) {
            return Err(Error::input(format!("the stop radius comes out as {stop_radius_mm} mm"))
                .help("give another aperture, or the radius of the stop")
                .with_code(ErrorCode::StopRadius));
        }
        if conditions.stop_radius_mm.is_none() {
            let note = stop_for_another_object(&prescription, &surfaces, designed, from_file);
            prescription.notes.extend(note);
        }
        let entrance_pupil_mm = 2.0 * stop_radius_mm * paraxial.entrance_magnification.abs();
        let vignetted = Vec::new();
        let mut system =
            Self { prescription, paraxial, stop_radius_mm, entrance_pupil_mm, vignetted };
        system.keep_reachable_fields()?;
        system.apply_vignetting()?;
        if let Focus::BestMtf(per_mm) = conditions.focus {
            system.focus_by_mtf(per_mm)?;
            move_sensor(&mut system.prescription, conditions.sensor_shift_mm)?;
        }
        system.tell_of_no_image();
        system.tell_of_media();
        Ok(system)
    }

    /// Notes an object or an image that does not lie in air.
    fn tell_of_media(&mut self) {
        let lens = &mut self.prescription;
        if let Some(glass) = &lens.object_glass {
            lens.notes.push(format!(
                "the object lies in {}: angles of fields are those in it, and the focal length is \
                 that on the image's side, in air",
                glass.name
            ));
        }
        if let Some(Medium::Glass(glass)) = lens.surfaces.last().map(|s| &s.medium) {
            lens.notes.push(format!(
                "the image lies in {}: chief ray angles are those in it, and focal length and \
                 f-number those in air, 1 over the power",
                glass.name
            ));
        }
    }

    /// Notes a sensor so far from the paraxial image that there is none on it, as behind a lens
    /// that is nearly afocal.
    fn tell_of_no_image(&mut self) {
        let image = self.paraxial.image_distance_mm;
        let sensor = self.prescription.surfaces.last().map_or(0.0, |s| s.thickness);
        let part = ((image - sensor) / (image - self.paraxial.exit_z_mm)).abs();
        // Paraxial figures know of no tilts.
        if part > WIDEST_SPOT && self.prescription.asymmetry().is_none() {
            self.prescription.notes.push(format!(
                "the sensor is far out of focus, {sensor:.6} mm behind the last surface, with the \
                 paraxial image at {image:.6} mm: a point on the axis makes a spot of {:.0} % of \
                 the exit pupil's width",
                100.0 * part
            ));
        }
    }

    /// Moves the sensor to the best MTF on the axis, and notes by how much.
    fn focus_by_mtf(&mut self, per_mm: f64) -> Result<()> {
        let best = best_focus::find(self, per_mm).map_err(|e| e.at("best focus"))?;
        let away = best.shift_mm * away_from_lens(&self.prescription);
        let last = self.prescription.surfaces.len() - 1;
        self.prescription.surfaces[last].thickness += best.shift_mm;
        self.prescription.notes.push(format!(
            "the sensor is {} the lens than in the file: best MTF at {per_mm} cycles/mm on the \
             axis ({:.4}, mean over the design wavelengths)",
            moved(away),
            best.mtf
        ));
        Ok(())
    }

    /// Leaves out design fields from which no light arrives, with a note, as long as others remain.
    fn keep_reachable_fields(&mut self) -> Result<()> {
        let fields = &self.prescription.fields;
        let trains: Result<Vec<Train>> =
            self.prescription.wavelengths_nm.iter().map(|nm| self.at(*nm)).collect();
        let trains = trains?;
        let check = |i: usize, train: &Train| -> Result<()> {
            match self.prescription.asymmetry() {
                Some(_) => field::check(train, self.field_places_deg()?[i]),
                None => {
                    let beam = Beam::aim(train, self.field_deg(fields.values[i])?)?;
                    beam.fine_outline().map(|_| ())
                }
            }
        };
        let lost = |i: usize| {
            let of_rays = || trains.iter().find_map(|train| check(i, train).err());
            self.without_pupil(i).or_else(of_rays)
        };
        let lost: Vec<Option<Error>> = (0..fields.values.len()).map(lost).collect();
        if lost.iter().all(Option::is_some) {
            return self.without_pupil(0).map_or(Ok(()), Err);
        }
        let unit = if fields.kind == FieldKind::Angle { "°" } else { " mm" };
        let mut notes = Vec::new();
        for (value, error) in fields.values.iter().zip(&lost) {
            if let Some(error) = error {
                let why = error.to_string();
                let why = why.lines().next().unwrap_or_default();
                let cause = match error.kind() {
                    ErrorKind::Unsupported => "as it cannot be traced",
                    _ => "since no light of it arrives",
                };
                notes.push(format!("the field {value}{unit} is left out, {cause}: {why}"));
            }
        }
        let fields = &mut self.prescription.fields;
        keep(&mut fields.values, &lost);
        keep(&mut fields.places, &lost);
        keep(&mut fields.vignetting, &lost);
        self.prescription.notes.extend(notes);
        Ok(())
    }

    /// Why vignetting factors are passed over, if they are.
    fn passes_over_vignetting(&self) -> Option<&'static str> {
        let p = &self.prescription;
        if p.surfaces.iter().any(|s| !s.clips.is_empty()) {
            Some("as surfaces have apertures, which alone cut the light")
        } else if p.asymmetry().is_some() {
            Some("as the lens is not rotationally symmetric: give apertures")
        } else {
            None
        }
    }

    /// An error where vignetting factors leave a field no pupil: opposite rims meet, or cross.
    fn without_pupil(&self, i: usize) -> Option<Error> {
        let [ux, lx, uy, ly] = *self.prescription.fields.vignetting.get(i)?;
        if ux + lx < 2.0 && uy + ly < 2.0 || self.passes_over_vignetting().is_some() {
            return None;
        }
        let what = format!(
            "vignetting factors of {ux} and {lx} in x, and {uy} and {ly} in y, leave no pupil"
        );
        Some(Error::input(what).help("those of opposite rims are below 2 together"))
    }

    /// Applies vignetting factors. As in OpticStudio the pupil is an ellipse, or as in CODE V every
    /// surface gets the smallest aperture that passes the reference rays (upper, lower and side
    /// rims of each field's vignetted pupil, at every design wavelength). Where such apertures cut
    /// other light than the factors say, as behind a stop in front, the pupil is the ellipse too.
    fn apply_vignetting(&mut self) -> Result<()> {
        let p = &self.prescription;
        if !p.fields.vignetting.iter().flatten().any(|v| *v != 0.0) {
            return Ok(());
        }
        if let Some(why) = self.passes_over_vignetting() {
            let note = format!("vignetting factors are passed over, {why}");
            self.prescription.notes.push(note);
            return Ok(());
        }
        let fields = self.fields_deg()?;
        let bounded = Self { vignetted: self.vignetted_pupils(&fields), ..self.clone() };
        let cut = (!p.fields.elliptical).then(|| self.with_apertures_of_rims(&fields));
        let follows = |cut: &Self| cut.passes_as(&bounded, &fields).unwrap_or(false);
        let note = match cut.and_then(Result::ok).filter(follows) {
            Some(cut) => {
                *self = cut;
                "clear apertures follow from the vignetting factors (the file gives no apertures)"
            }
            None => {
                *self = bounded;
                "vignetting factors make an ellipse of the pupil at each field (the file gives no \
                 apertures)"
            }
        };
        self.prescription.notes.push(note.into());
        Ok(())
    }

    /// The lens with the smallest apertures that pass the rims of its vignetted pupils.
    fn with_apertures_of_rims(&self, fields: &[f64]) -> Result<Self> {
        let mut cut = self.clone();
        let mut radii = vec![0.0_f64; self.prescription.surfaces.len()];
        for nm in &self.prescription.wavelengths_nm {
            let train = self.at(*nm)?;
            for (i, deg) in fields.iter().enumerate() {
                let beam = Beam::aim(&train, *deg)?;
                for [x, y] in self.rim_of_vignetted_pupil(i) {
                    let heights = beam.heights_of_pupil_ray(x, y)?;
                    radii.iter_mut().zip(heights).for_each(|(r, h)| *r = r.max(h));
                }
            }
        }
        let stop = self.prescription.stop;
        for (i, (surface, radius)) in cut.prescription.surfaces.iter_mut().zip(radii).enumerate() {
            if i != stop && radius > 0.0 {
                surface.clips.push(Clip::circle(radius));
            }
        }
        Ok(cut)
    }

    /// Whether as much light of all fields arrives as in another lens.
    fn passes_as(&self, other: &Self, fields: &[f64]) -> Result<bool> {
        let reference_nm = self.prescription.reference_nm;
        let (here, there) = (self.at(reference_nm)?, other.at(reference_nm)?);
        for deg in fields {
            let light = |train: &Train| -> Result<f64> {
                Ok(Beam::aim(train, *deg)?.fine_outline()?.projected_solid_angle())
            };
            if (light(&here)? / light(&there)? - 1.0).abs() > SAME_LIGHT {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// The ellipses that vignetting factors leave of the pupil, by rising field.
    fn vignetted_pupils(&self, fields: &[f64]) -> Vec<FieldPupil> {
        let pupil = |(i, deg): (usize, &f64)| {
            let [_, right, left, upper, lower] = self.rim_of_vignetted_pupil(i);
            let half =
                |k: usize| libm::hypot(0.5 * (right[k] - left[k]), 0.5 * (upper[k] - lower[k]));
            let centre = 0.5 * (right[1] + left[1] + upper[1] + lower[1]);
            FieldPupil { field_deg: *deg, half: [half(0), half(1)], centre }
        };
        let mut pupils: Vec<FieldPupil> = fields.iter().enumerate().map(pupil).collect();
        pupils.sort_by(|a, b| a.field_deg.total_cmp(&b.field_deg));
        pupils
    }

    /// Middle and rim, right, left, upper and lower, of the pupil of field `i` that its vignetting
    /// factors leave, in the pupil's radius, turned so that the chief ray comes from below the
    /// axis.
    fn rim_of_vignetted_pupil(&self, i: usize) -> [[f64; 2]; 5] {
        let fields = &self.prescription.fields;
        let [ux, lx, uy, ly] = fields.vignetting[i];
        let upwards = match (fields.kind, self.prescription.object) {
            (FieldKind::Angle, _) => 1.0,
            (FieldKind::ObjectHeight, _) => -1.0,
            (_, Object::Infinity) => self.paraxial.efl_mm.signum(),
            (_, Object::Distance(_)) => -self.paraxial.magnification.signum(),
        };
        let [x, y] = fields.places.get(i).copied().unwrap_or_default().map(|v| v * upwards);
        let length = (x * x + y * y).sqrt();
        let [sine, cosine] = if length > 0.0 { [x / length, y / length] } else { [0.0, 1.0] };
        let rim = [[0.0; 2], [1.0 - ux, 0.0], [lx - 1.0, 0.0], [0.0, 1.0 - uy], [0.0, ly - 1.0]];
        rim.map(|[x, y]| [x * cosine - y * sine, x * sine + y * cosine])
    }
}

/// Keeps the items that are not lost; a list without items stays so.
fn keep<T>(items: &mut Vec<T>, lost: &[Option<Error>]) {
    let mut lost = lost.iter();
    items.retain(|_| lost.next().is_none_or(Option::is_none));
}

fn object_at(distance_mm: f64) -> Object {
    match distance_mm.is_infinite() && distance_mm > 0.0 {
        true => Object::Infinity,
        false => Object::Distance(distance_mm),
    }
}

/// A word on an aperture that makes another stop, mm, than it does for the object of the file:
/// numerical apertures and working f-numbers are kept where the object moves.
fn stop_for_another_object(
    prescription: &Prescription,
    surfaces: &[TrainSurface],
    designed: Object,
    stop_mm: f64,
) -> Option<String> {
    let own = Prescription { object: designed, ..prescription.clone() };
    let paraxial = paraxial_of(&own, surfaces).ok()?;
    let own_mm = paraxial::stop_radius(&paraxial, &own).ok()?;
    ((own_mm - stop_mm).abs() > SAME_STOP * own_mm).then(|| {
        format!(
            "the file's aperture is kept for another object than the file's: the stop's radius is \
             {stop_mm:.6} mm instead of {own_mm:.6} mm"
        )
    })
}

/// Focuses at a distance by moving the sensor ([`Focus::At`]), and notes by how much.
fn focus_at(prescription: &mut Prescription, designed: Object, distance_mm: f64) -> Result<()> {
    let wrong = |what: String| {
        Error::input(what)
            .help("focus at a distance beyond the front focus, in mm in front of the lens")
    };
    if distance_mm.is_nan() || distance_mm <= 0.0 {
        return Err(wrong(format!("focus distance {distance_mm}")));
    }
    let surfaces = surfaces_at(prescription, prescription.reference_nm)?;
    let image_of = |object| Paraxial::of(&surfaces, prescription.stop, object, false);
    let image = image_of(object_at(distance_mm))?;
    // Up to the front focus the image is virtual, and magnification and focal length have one
    // sign.
    if image.magnification * image.efl_mm > 0.0 {
        return Err(wrong(format!("an object at {distance_mm} mm has no real image")));
    }
    let shift_mm = image.image_distance_mm - image_of(designed)?.image_distance_mm;
    let away = away_from_lens(prescription);
    let last = prescription.surfaces.len() - 1;
    prescription.surfaces[last].thickness += shift_mm;
    prescription.notes.push(format!(
        "focused at {distance_mm} mm: the sensor is {} the lens than in the file",
        moved(shift_mm * away)
    ));
    Ok(())
}

/// By how much the sensor is away from where the file has it, in words before "the lens".
fn moved(away_mm: f64) -> String {
    let way = if away_mm < 0.0 { "nearer to" } else { "farther from" };
    format!("{:.6} mm {way}", away_mm.abs())
}

/// Leaves out design wavelengths at which a glass has no data, with a note, as long as others
/// remain; the one nearest to it takes the place of such a reference wavelength.
fn keep_known_wavelengths(prescription: &mut Prescription) {
    let lacking = |nm: f64| {
        let unknown = prescription.glasses().find(|glass| glass.index(nm).is_err())?;
        let [low, high] = unknown.range_nm;
        Some(format!("glass {} is known from {low} to {high} nm", unknown.name))
    };
    let mut notes = Vec::new();
    let (mut known, mut weights) = (Vec::new(), Vec::new());
    for (i, &nm) in prescription.wavelengths_nm.iter().enumerate() {
        match lacking(nm) {
            None => {
                known.push(nm);
                weights.extend(prescription.wavelength_weights.get(i));
            }
            Some(why) => notes.push(format!("the wavelength {nm} nm is left out: {why}")),
        }
    }
    let old = prescription.reference_nm;
    let distance = |nm: &f64| (nm - old).abs();
    let nearest = known.iter().copied().min_by(|a, b| distance(a).total_cmp(&distance(b)));
    // With nothing left the tracer says at which surface the data end.
    let Some(nearest) = nearest else { return };
    if let Some(why) = lacking(old) {
        notes.push(format!("the reference wavelength is {nearest} nm instead of {old} nm: {why}"));
        prescription.reference_nm = nearest;
    }
    notes.extend(prescription.beyond_data(&known));
    prescription.wavelengths_nm = known;
    prescription.wavelength_weights = weights;
    prescription.notes.extend(notes);
}
