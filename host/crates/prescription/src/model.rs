//! A lens prescription: surfaces, glasses, stop, fields and wavelengths, checked, in mm.
//!
//! # Conventions
//! Light travels along +z. A surface with positive curvature has its centre on the +z side; its
//! thickness leads to the next surface (negative after a mirror). Surface 0 is the first one light
//! meets; object and image are not in the list. The last thickness leads to the image plane. In a
//! file's own numbering the first surface is usually 1, and messages call it so.

use super::Pose;
use super::forbes::Forbes;
use camrig_base::{Error, Result};
use camrig_glass::Glass;

/// A sequential lens.
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
    /// The medium from the object to the first surface; `None`: air.
    pub object_glass: Option<Glass>,
    /// What fixes the size of the stop.
    pub aperture: Aperture,
    /// Whether chief rays run parallel to the axis in object space whatever the stop, so that the
    /// aperture is a cone there and the stop lets all of it pass.
    pub telecentric: bool,
    /// Design wavelengths, nm, in the file's order.
    pub wavelengths_nm: Vec<f64>,
    /// What each of them counts in figures of several wavelengths, in their order; empty: all the
    /// same.
    pub wavelength_weights: Vec<f64>,
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
    /// What it is beyond conic and polynomials.
    pub form: Form,
    /// Its own coordinates in those that the thickness in front leads to, where it is tilted or
    /// decentred.
    pub entry: Option<Pose>,
    /// The coordinates behind it, in which its thickness is measured, in its own.
    pub exit: Option<Pose>,
}

/// What a surface is beyond conic and polynomials.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Form {
    /// Nothing more.
    #[default]
    Plain,
    /// The departure of a Forbes asphere is added.
    Forbes(Forbes),
    /// A biconic, curvature and conic constant being those in y; polynomials do not apply.
    Biconic {
        /// Curvature in x, 1/mm.
        curvature: f64,
        /// Conic constant in x.
        conic: f64,
    },
    /// A curve in y (conic and even polynomial), turned about an axis parallel to y.
    Toroid {
        /// One over the distance of that axis behind the vertex, 1/mm; 0 makes it a cylinder.
        curvature: f64,
    },
    /// An ideal thin lens in air, with this focal length, mm.
    Ideal {
        /// Focal length, mm.
        focal_mm: f64,
    },
    /// No surface, only a change of coordinates; the medium in front of it goes on behind.
    Break,
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

/// The shape of an aperture, in x and y of its surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Shape {
    /// A circle or an ellipse.
    #[default]
    Ellipse,
    /// A square or a rectangle.
    Rectangle,
}

/// An aperture: it passes what lies between `inner` and `outer`, two outlines of its shape around
/// its centre. An infinite `outer` makes it an obscuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clip {
    /// Inner radius, or half of the width in x, mm.
    pub inner: f64,
    /// Outer radius, or half of the width in x, mm.
    pub outer: f64,
    /// Its centre, (x, y) from the vertex, mm.
    pub centre: [f64; 2],
    /// Its shape.
    pub shape: Shape,
    /// Width in y over that in x.
    pub aspect: f64,
}

impl Clip {
    /// A clear aperture of this radius, mm.
    #[must_use]
    pub fn circle(radius: f64) -> Self {
        Self::ring(0.0, radius)
    }

    /// What passes between these radii around the vertex, mm.
    #[must_use]
    pub fn ring(inner: f64, outer: f64) -> Self {
        Self { inner, outer, centre: [0.0; 2], shape: Shape::Ellipse, aspect: 1.0 }
    }

    /// A clear aperture of this shape and half of these widths, mm.
    #[must_use]
    pub fn opening(shape: Shape, [x, y]: [f64; 2]) -> Self {
        Self { shape, aspect: y / x, ..Self::circle(x) }
    }

    /// What stops the light that this clear aperture passes.
    #[must_use]
    pub fn obstacle(self) -> Self {
        Self { inner: self.outer, outer: f64::INFINITY, ..self }
    }

    /// The same in another unit, at a place in the new one.
    #[must_use]
    pub fn placed(self, scale: f64, centre: [f64; 2]) -> Self {
        Self { inner: self.inner * scale, outer: self.outer * scale, centre, ..self }
    }

    /// Whether this obscures all that an opening about the same centre passes.
    fn covers(&self, opening: &Self) -> bool {
        if self.inner == 0.0 || opening.outer.is_infinite() || self.centre != opening.centre {
            return false;
        }
        let obstacle = Self { outer: f64::INFINITY, centre: [0.0; 2], ..*self };
        let (x, y) = (opening.outer, opening.outer * opening.aspect);
        let beside = if opening.shape == Shape::Rectangle { y } else { 0.0 };
        obstacle.excess(x, beside) >= 0.0 && obstacle.excess(0.0, y) >= 0.0
    }

    /// Whether its outlines are circles.
    #[must_use]
    pub fn is_round(&self) -> bool {
        self.shape == Shape::Ellipse && self.aspect == 1.0
    }

    /// Relative excess of (x, y), mm, over the aperture: negative inside, 0 on the edge, smooth in
    /// x and y.
    #[inline(always)]
    #[must_use]
    pub fn excess(&self, x: f64, y: f64) -> f64 {
        let (x, y) = (x - self.centre[0], (y - self.centre[1]) / self.aspect);
        let r2 = match self.shape {
            Shape::Ellipse => x * x + y * y,
            Shape::Rectangle => (x * x).max(y * y),
        };
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
    /// Field values, not negative: distances from the axis.
    pub values: Vec<f64>,
    /// The fields' (x, y), signed, as a file gives them; empty where all lie on y.
    pub places: Vec<[f64; 2]>,
    /// Vignetting factors per field in CODE V's sense, [upper x, lower x, upper y, lower y]: the
    /// part of the pupil's half width that is lost on that side. Empty where there are none.
    pub vignetting: Vec<[f64; 4]>,
    /// Whether the factors make an ellipse of the pupil, as in OpticStudio. Otherwise surfaces get
    /// the clear apertures that follow from them, as in CODE V, where such apertures cut the light
    /// so.
    pub elliptical: bool,
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
    /// direction whose projections on the planes of x and y have these angles (NaN for angles of
    /// 90° or more, unless one of them is 0).
    #[must_use]
    pub fn off_axis(self, x: f64, y: f64) -> f64 {
        if self != Self::Angle || x == 0.0 || y == 0.0 {
            return (x * x + y * y).sqrt();
        }
        if x.abs() >= 90.0 || y.abs() >= 90.0 {
            return f64::NAN;
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
            form: Form::Plain,
            entry: None,
            exit: None,
        }
    }

    /// Why it is not symmetric about the axis; `None` if it is.
    #[must_use]
    pub fn asymmetry(&self) -> Option<&'static str> {
        if self.entry.is_some() || self.exit.is_some() {
            return Some("is tilted or decentred");
        }
        if self.clips.iter().any(|clip| clip.centre != [0.0; 2]) {
            return Some("has a decentred aperture");
        }
        if !self.clips.iter().all(Clip::is_round) {
            return Some("has an aperture that is not circular");
        }
        match self.form {
            Form::Biconic { .. } => Some("is a biconic"),
            Form::Toroid { .. } => Some("is a toroid"),
            _ => None,
        }
    }
}

/// Part of a wavelength by which it may miss the end of a glass's data and still belongs to them.
const LIMITS_ALIKE: f64 = 1e-5;

impl Prescription {
    /// The design wavelengths that count, nm, with their shares of figures of several wavelengths.
    #[must_use]
    pub fn shares(&self) -> Vec<(f64, f64)> {
        let all: f64 = self.wavelength_weights.iter().sum();
        let even = 1.0 / self.wavelengths_nm.len() as f64;
        let share = |i: usize| if all > 0.0 { self.wavelength_weights[i] / all } else { even };
        let waves = self.wavelengths_nm.iter().enumerate().map(|(i, nm)| (*nm, share(i)));
        waves.filter(|(_, share)| *share > 0.0).collect()
    }

    /// The glasses that light goes through, in its order.
    pub fn glasses<'a>(&'a self) -> impl Iterator<Item = &'a Glass> {
        let of_surface = |surface: &'a Surface| match &surface.medium {
            Medium::Glass(glass) => Some(glass),
            _ => None,
        };
        self.object_glass.iter().chain(self.surfaces.iter().filter_map(of_surface))
    }

    /// What to tell of glasses whose data end before these wavelengths, nm, and whose formula or
    /// table is carried on to them: a sentence for each glass, unless it is among the notes.
    #[must_use]
    pub fn beyond_data(&self, wavelengths_nm: &[f64]) -> Vec<String> {
        let mut told = Vec::<String>::new();
        for glass in self.glasses() {
            let [low, high] = glass.range_nm;
            // Limits of catalogues are printed in µm.
            let outside =
                |nm: &f64| *nm < low * (1.0 - LIMITS_ALIKE) || *nm > high * (1.0 + LIMITS_ALIKE);
            let out = wavelengths_nm.iter().copied().filter(outside);
            let away = |nm: &f64| (low - nm).max(nm - high);
            let Some(farthest) = out.max_by(|a, b| away(a).total_cmp(&away(b))) else { continue };
            let [low, high, farthest] = [low, high, farthest].map(|nm| (1e3 * nm).round() / 1e3);
            let note = format!(
                "glass {} is known from {low} to {high} nm: its index is carried on to \
                 {farthest} nm, and uncertain there",
                glass.name
            );
            if !told.contains(&note) && !self.notes.contains(&note) {
                told.push(note);
            }
        }
        told
    }

    /// The first surface that is not symmetric about the axis, and why; `None` for a lens that is
    /// rotationally symmetric.
    #[must_use]
    pub fn asymmetry(&self) -> Option<String> {
        let mut reasons = self.surfaces.iter().map(Surface::asymmetry).enumerate();
        reasons.find_map(|(i, why)| why.map(|why| format!("surface {} {why}", i + 1)))
    }

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
        let mut in_air = self.object_glass.is_none();
        for (i, surface) in self.surfaces.iter().enumerate() {
            surface.validate(in_air).map_err(|e| e.at(format!("surface {}", i + 1)))?;
            in_air = match surface.medium {
                Medium::Air => in_air || surface.form != Form::Break,
                Medium::Glass(_) => false,
                Medium::Mirror => in_air,
            };
        }
        let stop = &self.surfaces[self.stop];
        if stop.form == Form::Break || stop.clips.iter().any(|clip| clip.centre != [0.0; 2]) {
            return Err(Error::unsupported(
                "the stop is decentred by its aperture, or no surface",
            )
            .at(format!("surface {}", self.stop + 1))
            .help("make a plane the stop, and decentre that surface"));
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
        let in_air = match self.aperture {
            Aperture::ObjectNa(_) => self.object_glass.is_none(),
            Aperture::ImageNa(_) => true,
            _ => false,
        };
        if in_air && value >= 1.0 {
            return Err(Error::input(format!("{name} {value}")).help("in air it is below 1"));
        }
        if self.wavelengths_nm.is_empty() {
            return Err(Error::input("no wavelength").help("give at least one, in nm"));
        }
        for nm in self.wavelengths_nm.iter().chain([&self.reference_nm]) {
            positive("wavelength", *nm)?;
        }
        let (weights, waves) = (&self.wavelength_weights, self.wavelengths_nm.len());
        let any = weights.is_empty() || weights.iter().any(|w| *w > 0.0);
        if !(weights.is_empty() || weights.len() == waves)
            || !(any && weights.iter().all(|w| w.is_finite() && *w >= 0.0))
        {
            return Err(Error::input(format!("weights {weights:?} of {waves} wavelengths"))
                .help("give one for each wavelength, none below 0 and one above it"));
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
    /// Checks the surface, which light reaches through air or not.
    fn validate(&self, in_air: bool) -> Result<()> {
        let numbers = [self.curvature, self.conic, self.thickness];
        let form = match &self.form {
            Form::Biconic { curvature, conic } => vec![*curvature, *conic],
            Form::Toroid { curvature } => vec![*curvature],
            Form::Forbes(forbes) => forbes.coefficients.clone(),
            Form::Ideal { focal_mm } => vec![*focal_mm, 1.0 / focal_mm],
            Form::Plain | Form::Break => Vec::new(),
        };
        let frames = [&self.entry, &self.exit].into_iter().flatten();
        let placed = frames.flat_map(|f| f.origin.into_iter().chain(f.axes.concat()));
        let placed: Vec<f64> = placed.collect();
        let more = form.iter().chain(&placed);
        let mut all = numbers.iter().chain(&self.even).chain(&self.odd).chain(more);
        if let Some(v) = all.find(|v| !v.is_finite()) {
            return Err(Error::input(format!("value {v}")).help("finite numbers only"));
        }
        self.check_form(in_air)?;
        for clip in &self.clips {
            let placed = clip.centre.iter().all(|v| v.is_finite());
            let sized = clip.aspect.is_finite() && clip.aspect > 0.0;
            if !(clip.inner >= 0.0 && clip.outer > clip.inner && placed && sized) {
                let (inner, outer) = (clip.inner, clip.outer);
                let what = format!("aperture from {inner} to {outer}, y {} times x", clip.aspect);
                return Err(Error::input(what).help(
                    "the outer radius lies above the inner one, and widths in x and y are given",
                ));
            }
            if self.clips.iter().any(|other| other.covers(clip)) {
                return Err(Error::input("an obscuration covers the whole aperture")
                    .help("no light passes: is it smaller than the aperture?"));
            }
        }
        Ok(())
    }
}

impl Surface {
    /// Refuses what does not go with the surface's form.
    fn check_form(&self, in_air: bool) -> Result<()> {
        let polynomial = !(self.even.is_empty() && self.odd.is_empty());
        let wrong = |what: &str| Err(Error::unsupported(what).help("give another surface"));
        match &self.form {
            Form::Biconic { .. } if polynomial => wrong("a biconic has no polynomial"),
            Form::Toroid { .. } if !self.odd.is_empty() => {
                wrong("the curve of a toroid has even powers only")
            }
            Form::Ideal { .. } if self.curvature != 0.0 || polynomial => {
                wrong("a paraxial surface is plane")
            }
            Form::Ideal { .. } if !in_air || self.medium != Medium::Air => wrong(
                "a paraxial surface lies in glass or is a mirror: what its focal length \
                       means there is not defined",
            ),
            _ => Ok(()),
        }
    }
}

fn positive(name: &str, value: f64) -> Result<()> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(Error::input(format!("{name} {value}")).help("give a positive number"))
}
