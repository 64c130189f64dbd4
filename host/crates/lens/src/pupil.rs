//! Beams: the real chief ray through the centre of the stop, and the part of the pupil that light
//! passes.
//!
//! # Launch coordinates
//! For an object at infinity (px, py) is the place, in mm, where a ray pierces the plane through
//! the centre of the paraxial entrance pupil perpendicular to the field direction; for a finite
//! object it is the place at which the ray is aimed, in the plane through the pupil's centre
//! perpendicular to the line from the object point, or, for a lens that is telecentric in object
//! space, at this distance on a parallel to the axis. The field lies on +y: the object point is
//! below the axis, the image above it (for a positive lens).

use super::prescription::{Clip, Object};
use super::trace::{LANES, Rays, Start, TrainSurface, lost_at, trace_lanes, trace_one};
use super::train::Train;
use camrig_base::{Error, ErrorCode, Result};
use std::borrow::Cow;
use std::f64::consts::PI;

/// The rays of a field point at one wavelength, around its chief ray.
pub trait Bundle {
    /// The lens.
    fn train(&self) -> &Train;
    /// The chief ray on the image plane.
    fn chief(&self) -> &Rays<1>;
    /// Traces [`LANES`] rays from launch coordinates relative to the chief ray, mm.
    fn trace(&self, places: &[[f64; 2]; LANES]) -> Rays<LANES>;
    /// Radiant power per launch area at a place relative to the chief ray.
    fn power(&self, place: [f64; 2]) -> f64;

    /// Phase of ray `i` as a plane wave at the chief ray's image point, in waves: its optical path
    /// carried to that point's wavefront.
    #[inline]
    fn plane_wave_phase<const N: usize>(&self, rays: &Rays<N>, i: usize) -> f64 {
        let (p, d) = rays.get(i);
        let (q, _) = self.chief().get(0);
        let advance = d[0] * (p[0] - q[0]) + d[1] * (p[1] - q[1]);
        (rays.path[i] - self.chief().path[0] - advance) * 1e6 / self.train().nm
    }

    /// Optical path difference of ray `i` to the chief ray on the reference sphere, in waves.
    #[must_use]
    fn opd_waves<const N: usize>(&self, rays: &Rays<N>, i: usize) -> f64 {
        let (p, d) = rays.get(i);
        let (q, _) = self.chief().get(0);
        let r = self.reference_sphere_mm();
        let away = [p[0] - q[0], p[1] - q[1]];
        let along = away[0] * d[0] + away[1] * d[1];
        let inside = along * along - away[0] * away[0] - away[1] * away[1] + r * r;
        let back = along + inside.sqrt().copysign(r);
        (rays.path[i] - back - (self.chief().path[0] - r)) * 1e6 / self.train().nm
    }

    /// Projected solid angle of the exit pupil, which `outline` bounds, seen from where the chief
    /// ray lands, sr. It is [`Outline::projected_solid_angle`] where the rays of the field point
    /// meet there. Elsewhere, out of focus or where the image is curved, it is that of the rays
    /// which arrive there from all of the scene, to first order in how far the rays of one point
    /// miss it.
    #[must_use]
    fn solid_angle_from_sensor(&self, outline: &Outline) -> f64 {
        let thickness = self.train().surfaces.last().map_or(0.0, |s| s.prescribed.thickness);
        let behind = thickness - self.train().paraxial.exit_z_mm;
        let (place, direction) = self.chief().get(0);
        let pupil_mm =
            if behind.is_finite() { behind * direction[2].signum() } else { f64::INFINITY };
        outline.extent.copies() * outline.area(|p| p.towards([place[0], place[1]], pupil_mm))
    }

    /// Radius of the reference sphere, mm: centred on the chief ray's image point, through the
    /// place where the chief ray meets the plane of the paraxial exit pupil (of this wavelength).
    /// Negative where that lies behind the image.
    #[must_use]
    fn reference_sphere_mm(&self) -> f64 {
        let thickness = self.train().surfaces.last().map_or(0.0, |s| s.prescribed.thickness);
        (thickness - self.train().paraxial.exit_z_mm) / self.chief().direction[2][0]
    }
}

/// The beam from one field point at one wavelength, aimed through the centre of the stop.
#[derive(Clone, Debug)]
pub struct Beam<'a> {
    /// The lens.
    pub train: &'a Train,
    /// Field angle, degrees.
    pub field_deg: f64,
    /// Launch coordinate py of the chief ray, mm (its px is 0).
    pub chief_launch: f64,
    /// The chief ray on the image plane.
    pub chief: Rays<1>,
    launcher: Launcher,
    /// The surfaces with the stop as it is for this field.
    surfaces: Cow<'a, [TrainSurface]>,
}

/// Start points and directions of the rays of a field point.
#[derive(Clone, Copy, Debug)]
struct Launcher {
    sine: f64,
    cosine: f64,
    /// z of the paraxial entrance pupil.
    pupil_z: f64,
    /// For a finite object: the y of the place that rays are launched around, and its distance from
    /// the object point.
    object: Option<(f64, f64)>,
    /// Index of the object's medium.
    index: f64,
}

impl Launcher {
    fn new(train: &Train, field_deg: f64) -> Result<Self> {
        let (sine, cosine) = libm::sincos(field_deg.to_radians());
        let (pupil_z, index) = (train.entrance_z_mm, train.paraxial.object_index);
        let object = match train.object {
            Object::Infinity => None,
            Object::Distance(d) if d + pupil_z > 0.0 && train.telecentric => {
                // Rays around the parallel to the axis, aimed in a plane at the pupil's distance.
                let to_pupil = d + pupil_z;
                let object = Some((-to_pupil * sine / cosine, to_pupil));
                return Ok(Self { sine: 0.0, cosine: 1.0, pupil_z, object, index });
            }
            Object::Distance(d) if d + pupil_z > 0.0 => Some((0.0, (d + pupil_z) / cosine)),
            Object::Distance(d) => {
                return Err(Error::input(format!(
                    "the entrance pupil lies behind the object at {d} mm"
                ))
                .help("such lenses are not supported"));
            }
        };
        Ok(Self { sine, cosine, pupil_z, object, index })
    }

    /// A ray through a place of the pupil's plane. Its path is counted from the sphere around the
    /// object point through the pupil's centre, so that a far object costs no digits.
    #[inline(always)]
    fn ray(&self, px: f64, py: f64) -> Start {
        let (s, c) = (self.sine, self.cosine);
        let aside = [px, py * c, -py * s];
        match self.object {
            None => Start {
                position: [aside[0], aside[1], self.pupil_z + aside[2]],
                direction: [0.0, s, c],
                path: 0.0,
            },
            Some((centre_y, distance)) => {
                let aim = [aside[0], distance * s + aside[1], distance * c + aside[2]];
                let length = (aim[0] * aim[0] + aim[1] * aim[1] + aim[2] * aim[2]).sqrt();
                Start {
                    position: [aside[0], centre_y + aside[1], self.pupil_z + aside[2]],
                    direction: aim.map(|v| v / length),
                    path: self.index * (px * px + py * py) / (length + distance),
                }
            }
        }
    }

    /// Radiant power per launch area, relative to that at the pupil's centre on the axis of the
    /// beam: 1 for a plane wave; for a Lambertian object point its projected solid angle.
    fn power(&self, px: f64, py: f64) -> f64 {
        match self.object {
            None => 1.0,
            Some((_, distance)) => {
                let cosine = self.ray(px, py).direction[2];
                let r2 = 1.0 + (px * px + py * py) / (distance * distance);
                cosine / self.cosine / (r2 * r2.sqrt())
            }
        }
    }
}

impl<'a> Beam<'a> {
    /// Aims the beam of a field point: its chief ray goes through the centre of the stop.
    ///
    /// The ray is followed from the axis outwards in steps of the field angle, each solved by the
    /// secant method, so that it is the one continuously connected with the axis.
    ///
    /// # Errors
    /// A field angle of 180° or more, of a finite object 90°; a chief ray that is lost on its way:
    /// the error names the surface.
    pub fn aim(train: &'a Train, field_deg: f64) -> Result<Self> {
        if let Some(why) = &train.asymmetry {
            return Err(Error::unsupported(format!(
                "the lens is not rotationally symmetric: {why}"
            ))
            .help(
                "its figures are traced at field points (x, y), and its characterisation over the \
                     plane of the image",
            )
            .with_code(ErrorCode::AsymmetricLens));
        }
        let most = match train.object {
            Object::Infinity => 180.0,
            Object::Distance(_) => 90.0,
        };
        if !(field_deg.abs() < most) {
            return Err(Error::input(format!("field angle {field_deg}°"))
                .help(format!("field angles lie between -{most}° and {most}° here")));
        }
        // Degrees. A step that fails is divided by SHRINK; where one of SMALLEST fails, the ray
        // counts as lost.
        const STEP: f64 = 4.0;
        const SMALLEST: f64 = 0.01;
        const SHRINK: f64 = 4.0;

        let sign = field_deg.signum();
        // With the cone in place of the stop, chief rays are parallel to the axis.
        let goal = if train.cone_mm.is_some() { 0.0 } else { field_deg.abs() };
        let (mut done, mut launch, mut slope, mut step) = (0.0, 0.0, 0.0, STEP);
        while done < goal {
            let next = (done + step).min(goal);
            let guess = launch + slope * (next - done);
            match centre_of_stop(train, sign * next, guess)? {
                Some(found) => {
                    slope = (found - launch) / (next - done);
                    (done, launch, step) = (next, found, STEP);
                }
                None if step > SMALLEST => step /= SHRINK,
                None => return Err(chief_lost(train, field_deg, sign * next, guess)),
            }
        }
        let launcher = Launcher::new(train, field_deg)?;
        let surfaces = train.surfaces_for(field_deg);
        let mut chief = Rays::nowhere();
        chief.launch(0, &launcher.ray(0.0, launch));
        trace_one(&surfaces, &mut chief);
        if !chief.alive(0) {
            return Err(chief_lost(train, field_deg, field_deg, launch));
        }
        Ok(Self { train, field_deg, chief_launch: launch, chief, launcher, surfaces })
    }

    /// Height of the chief ray on the image plane, mm, signed.
    #[must_use]
    pub fn height_mm(&self) -> f64 {
        self.chief.position[1][0]
    }

    /// Angle of the chief ray with the axis at the image plane, degrees, signed.
    #[must_use]
    pub fn chief_ray_angle_deg(&self) -> f64 {
        let (_, d) = self.chief.get(0);
        libm::atan2(d[1], d[2].abs()).to_degrees()
    }

    /// Heights at which a ray meets the surfaces, mm. The ray is aimed at (x, y) in the plane of
    /// the paraxial entrance pupil, in units of the pupil's radius from its centre.
    ///
    /// # Errors
    /// A field of 90° or more, to which the paraxial pupil shows no face; a ray that is lost on its
    /// way.
    pub(super) fn heights_of_pupil_ray(&self, x: f64, y: f64) -> Result<Vec<f64>> {
        if self.field_deg.abs() >= 90.0 {
            let what = format!("vignetting factors at the field angle {}°", self.field_deg);
            return Err(Error::unsupported(what).help("give clear apertures in their place"));
        }
        let radius = 0.5 * self.train.entrance_pupil_mm;
        let mut ray = Rays::<1>::nowhere();
        ray.launch(0, &self.launcher.ray(x * radius, y * radius * self.launcher.cosine));
        let start = ray.clone();
        let mut heights = Vec::with_capacity(self.train.surfaces.len());
        for surface in &self.train.surfaces {
            surface.meet(&mut ray);
            let (p, _) = ray.get(0);
            heights.push((p[0] * p[0] + p[1] * p[1]).sqrt());
            surface.bend(&mut ray);
        }
        match lost_at(&self.train.surfaces, &start) {
            None => Ok(heights),
            Some((surface, how)) => Err(lost(self.field_deg, self.train.nm, surface, how)
                .help("check the vignetting factors")),
        }
    }

    /// Checks that the ray to the rim of the pupil arrives or is stopped by an aperture.
    ///
    /// # Errors
    /// The ray is lost at a surface: the lens cannot have the aperture that its prescription
    /// gives.
    pub(super) fn check_rim(&self) -> Result<()> {
        let radius = 0.5 * self.train.entrance_pupil_mm;
        let mut ray = Rays::<1>::nowhere();
        ray.launch(0, &self.launcher.ray(0.0, radius * self.launcher.cosine));
        let start = ray.clone();
        for surface in &self.train.surfaces {
            surface.meet(&mut ray);
            surface.bend(&mut ray);
        }
        match lost_at(&self.train.surfaces, &start) {
            Some((surface, how)) if ray.excess[0] <= 0.0 => {
                Err(lost(self.field_deg, self.train.nm, surface, how).help(
                    "the aperture is larger than this surface takes: give a smaller one, or check \
                     radius, conic and polynomial of the surface",
                ))
            }
            _ => Ok(()),
        }
    }

    /// The ray at a place relative to the chief ray, mm.
    pub(super) fn start(&self, place: [f64; 2]) -> Start {
        self.launcher.ray(place[0], self.chief_launch + place[1])
    }

    /// Places (z from the first vertex, y), mm, of a ray in the plane of the section: `lead` before
    /// the first surface (of steep rays nearer), on each surface, on the image plane. It is
    /// launched `y` from the chief ray, mm. `None` for a ray that is lost or stopped.
    pub(super) fn path(&self, y: f64, lead: f64) -> Option<Vec<[f64; 2]>> {
        // Cosine of the angle with the axis up to which rays are drawn from one plane.
        const STEEPEST: f64 = 0.5;
        let start = self.launcher.ray(0.0, self.chief_launch + y);
        let direction = start.direction;
        let mut ray = Rays::<1>::nowhere();
        ray.launch(0, &start);
        let mut places = Vec::with_capacity(self.train.surfaces.len() + 2);
        let mut vertex = 0.0;
        for surface in self.surfaces.iter() {
            surface.meet(&mut ray);
            let (p, _) = ray.get(0);
            if places.is_empty() {
                let along = lead / direction[2].max(STEEPEST);
                places.push([p[2] - along * direction[2], p[1] - along * direction[1]]);
            }
            places.push([vertex + p[2], p[1]]);
            surface.bend(&mut ray);
            vertex += surface.prescribed.thickness;
        }
        let (p, d) = ray.get(0);
        places.push([vertex, p[1] - p[2] * d[1] / d[2]]);
        ray.passes(0).then_some(places)
    }

    /// Field and wavelength, for errors.
    pub(super) fn place(&self) -> String {
        format!("field {:.4}°, {} nm", self.field_deg, self.train.nm)
    }

    /// The pupil's outline, fine enough for figures.
    ///
    /// # Errors
    /// Those of [`Self::outline`]; a pupil too narrow for it.
    pub(super) fn fine_outline(&self) -> Result<Outline> {
        self.outline(AZIMUTHS)?.resolved(&|| self.place())
    }

    /// The outline of the pupil along `azimuths` directions (at least 8, and a multiple of
    /// [`LANES`]).
    ///
    /// # Errors
    /// A field point from which no light reaches the image.
    pub fn outline(&self, azimuths: usize) -> Result<Outline> {
        Outline::find(self, azimuths)
    }
}

impl Bundle for Beam<'_> {
    fn train(&self) -> &Train {
        self.train
    }

    fn chief(&self) -> &Rays<1> {
        &self.chief
    }

    #[inline]
    fn trace(&self, places: &[[f64; 2]; LANES]) -> Rays<LANES> {
        let mut rays = Rays::nowhere();
        for (i, [x, y]) in places.iter().enumerate() {
            let py = self.chief_launch + *y;
            rays.launch(i, &self.launcher.ray(*x, py));
            if let Some(radius) = self.train.cone_mm {
                rays.excess[i] = Clip::circle(radius).excess(*x, py);
            }
        }
        trace_lanes(&self.surfaces, &mut rays);
        rays
    }

    fn power(&self, place: [f64; 2]) -> f64 {
        self.launcher.power(place[0], self.chief_launch + place[1])
    }
}

/// The launch coordinate at which a ray meets the centre of the stop; `None` when the search
/// fails.
fn centre_of_stop(train: &Train, field_deg: f64, guess: f64) -> Result<Option<f64>> {
    let launcher = Launcher::new(train, field_deg)?;
    let miss = |py: f64| {
        let ray = train.at_stop(&launcher.ray(0.0, py));
        if ray.path[0].is_finite() { ray.position[1][0] } else { f64::NAN }
    };
    // The search ends at a few rounding errors of a height at the stop, and has succeeded within
    // 1e-9 of the stop's radius: far below what any figure of a lens is compared to, far above
    // rounding.
    let enough = 4.0 * f64::EPSILON * train.stop_radius_mm;
    let good = 1e-9 * train.stop_radius_mm;
    // The second start of the secant method: a small part of the pupil away, where the ray's
    // height at the stop still grows linearly.
    let (mut a, mut b) = (guess, guess + 1e-3 * train.entrance_pupil_mm);
    let (mut fa, mut fb) = (miss(a), miss(b));
    if fa.abs() < fb.abs() {
        (a, b, fa, fb) = (b, a, fb, fa);
    }
    // A bound only: the secant method multiplies the number of correct digits by 1.6 per step.
    for _ in 0..30 {
        if fb.abs() <= enough || fa == fb {
            break;
        }
        let c = b - fb * (b - a) / (fb - fa);
        let fc = miss(c);
        if fc.is_nan() || fc.abs() >= fb.abs() {
            break;
        }
        (a, fa, b, fb) = (b, fb, c, fc);
    }
    Ok((fb.abs() <= good).then_some(b))
}

fn lost(field_deg: f64, nm: f64, surface: usize, how: &str) -> Error {
    Error::input(format!("a ray meant for surface {} {how}", surface + 1))
        .at(format!("field {field_deg:.4}°, {nm} nm"))
}

/// The chief ray of a field is lost, as that of the field `at_deg` on the way to it is.
fn chief_lost(train: &Train, field_deg: f64, at_deg: f64, launch: f64) -> Error {
    let ray = Launcher::new(train, at_deg).map(|l| l.ray(0.0, launch));
    let found = ray.ok().and_then(|start| {
        let mut ray = Rays::nowhere();
        ray.launch(0, &start);
        lost_at(&train.surfaces, &ray)
    });
    let error = match found {
        Some((surface, how)) => lost(field_deg, train.nm, surface, how),
        None => Error::input("no ray reaches the centre of the stop")
            .at(format!("field {field_deg:.4}°, {} nm", train.nm)),
    };
    error.help(format!(
        "the field is larger than the lens takes (chief rays are lost from {at_deg:.4}° on): give \
         smaller fields, or check the surface"
    ))
}

/// Refuses a pupil whose middle is `open` though a surface has an obscuration: an outline around
/// the middle cannot tell what light passes beyond an obstacle beside it.
pub(super) fn check_obstacles(
    train: &Train,
    open: bool,
    place: &dyn Fn() -> String,
) -> Result<()> {
    let mut clips = train.surfaces.iter().flat_map(|surface| &surface.prescribed.clips);
    if !open || clips.all(|clip| clip.inner == 0.0) {
        return Ok(());
    }
    Err(Error::unsupported("an obscuration that does not cover the middle of the pupil")
        .at(place())
        .help("give fields at which it does, or leave the obscuration out"))
}

/// Azimuths over half of the pupil's outline. The inscribed polygon's area is too small by
/// (π/255)²/6 = 2.5e-5 of itself; the ratio to the area on the axis errs by the difference of two
/// such errors.
const AZIMUTHS: usize = 256;

/// How much of a pupil an outline and rays run over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Extent {
    /// The half x ≥ 0 of a mirror-symmetric one, azimuths from −y to +y.
    MirrorHalf,
    /// All of it, once around; the last azimuth is the first.
    Whole,
}

impl Extent {
    /// How often each ray counts: with its mirror image, or alone.
    pub(super) fn copies(self) -> f64 {
        match self {
            Self::MirrorHalf => 2.0,
            Self::Whole => 1.0,
        }
    }
}

/// The part of the pupil that light passes, along azimuths around the chief ray.
#[derive(Clone, Debug)]
pub struct Outline {
    /// What the azimuths run over.
    pub extent: Extent,
    /// Per azimuth the inner and the outer edge; `None` where nothing passes. The inner edge is
    /// the chief ray itself where the middle is open.
    pub edges: Vec<Option<[EdgePoint; 2]>>,
}

/// A ray on the edge of the pupil.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgePoint {
    /// Launch place relative to the chief ray, mm.
    pub launch: [f64; 2],
    /// Direction cosines x and y at the image.
    pub direction: [f64; 2],
    /// Where it lands, mm.
    pub landing: [f64; 2],
}

impl EdgePoint {
    /// The ray in lane `i` of `rays`, launched at `launch`.
    pub(super) fn of<const N: usize>(rays: &Rays<N>, i: usize, launch: [f64; 2]) -> Self {
        let in_plane = |vector: &[[f64; N]; 3]| [vector[0][i], vector[1][i]];
        Self { launch, direction: in_plane(&rays.direction), landing: in_plane(&rays.position) }
    }

    /// Direction cosines of the line from where the ray crosses the exit pupil, `pupil_mm` in front
    /// of the sensor, to a place of the sensor.
    fn towards(&self, place: [f64; 2], pupil_mm: f64) -> [f64; 2] {
        let [l, m] = self.direction;
        let forward = (1.0 - l * l - m * m).sqrt();
        let aside = |k: usize| (self.landing[k] - place[k]) / pupil_mm;
        let slopes = [0, 1].map(|k| self.direction[k] / forward - aside(k));
        let length = (1.0 + slopes[0] * slopes[0] + slopes[1] * slopes[1]).sqrt();
        slopes.map(|slope| slope / length)
    }
}

impl Outline {
    fn find(beam: &Beam, azimuths: usize) -> Result<Self> {
        let count = azimuths.max(8).next_multiple_of(LANES);
        let centre = beam.trace(&[[0.0; 2]; LANES]);
        let middle = EdgePoint::of(&centre, 0, [0.0; 2]);
        let place = || beam.place();
        check_obstacles(beam.train, centre.excess[0] <= 0.0, &place)?;
        let mut edges = Vec::with_capacity(count);
        for block in 0..count / LANES {
            let ways: [[f64; 2]; LANES] = std::array::from_fn(|i| {
                let step = (block * LANES + i) as f64 / (count - 1) as f64;
                let (sine, cosine) = libm::sincos(PI * (step - 0.5));
                [cosine.max(0.0), sine]
            });
            let step = beam.train.entrance_pupil_mm / STEPS_PER_DIAMETER;
            let trace = |places: &[[f64; 2]; LANES]| beam.trace(places);
            edges.extend(edges_along(&trace, step, &ways, centre.excess[0], middle));
        }
        Self::new(Extent::MirrorHalf, edges, &place)
    }

    /// The outline with these edges; `place` names the field point.
    ///
    /// # Errors
    /// A pupil without light. Between edges that differ by no more than rounding there is none:
    /// ratios to its area would be of noise.
    pub(super) fn new(
        extent: Extent,
        edges: Vec<Option<[EdgePoint; 2]>>,
        place: &dyn Fn() -> String,
    ) -> Result<Self> {
        let radius = |point: &EdgePoint| libm::hypot(point.launch[0], point.launch[1]);
        let wide = |[from, to]: &[EdgePoint; 2]| radius(to) - radius(from) > THINNEST * radius(to);
        match edges.iter().flatten().any(wide) {
            true => Ok(Self { extent, edges }),
            false => Err(Error::input("no light gets through the apertures")
                .at(place())
                .help("give smaller fields, or check the apertures")),
        }
    }

    /// The outline, where its azimuths are close enough.
    ///
    /// # Errors
    /// A pupil so narrow that its ends lie between azimuths.
    pub(super) fn resolved(self, place: &dyn Fn() -> String) -> Result<Self> {
        let launch = |point: &EdgePoint| point.launch;
        let corners = self.edges.windows(3).filter_map(|w| match w {
            [Some(a), Some(b), Some(c)] => {
                Some(strip(a, b, &launch) + strip(b, c, &launch) - strip(a, c, &launch))
            }
            _ => None,
        });
        let (hangs, area) = (corners.map(f64::abs).sum::<f64>(), self.area(launch));
        match area > 0.0 && hangs <= CORNERS * area {
            true => Ok(self),
            false => {
                Err(Error::unsupported("the pupil is too narrow: its outline is not resolved")
                    .at(place())
                    .help("widen the apertures that make a slit of it, or give smaller fields"))
            }
        }
    }

    /// Area of the pupil in image-side direction cosines: its projected solid angle, sr.
    #[must_use]
    pub fn projected_solid_angle(&self) -> f64 {
        self.extent.copies() * self.area(|point| point.direction)
    }

    /// Area over the extent of the polygon through the edge points, in the coordinates `of`.
    fn area(&self, of: impl Fn(&EdgePoint) -> [f64; 2]) -> f64 {
        let strips = self.edges.windows(2).filter_map(|w| Some((w[0].as_ref()?, w[1].as_ref()?)));
        strips.map(|(a, b)| strip(a, b, &of)).sum::<f64>().abs()
    }

    /// The least and largest launch y, and the largest launch x.
    #[must_use]
    pub fn bounds(&self) -> ([f64; 2], f64) {
        let points = self.edges.iter().flatten().flatten();
        points.fold(([f64::INFINITY, f64::NEG_INFINITY], 0.0), |([low, high], x), p| {
            ([low.min(p.launch[1]), high.max(p.launch[1])], x.max(p.launch[0]))
        })
    }

    /// The least launch x; 0 for a half.
    pub(super) fn left(&self) -> f64 {
        let points = self.edges.iter().flatten().flatten();
        match self.extent {
            Extent::MirrorHalf => 0.0,
            Extent::Whole => points.fold(0.0, |x, p| x.min(p.launch[0])),
        }
    }
}

/// Least width of a pupil with light, over the distance of its edge from the chief ray: edges are
/// found to 1e-12 of it.
const THINNEST: f64 = 1e-9;
/// Share of a pupil's area that may hang on single azimuths, and would be lost without them.
/// Corners that fall between azimuths cut off a quarter of it at most: 1 %, of a slit of 1:27.
const CORNERS: f64 = 0.04;

/// Signed area of the quadrangle between the edges at two azimuths, in the coordinates `of`.
fn strip(
    [a0, a1]: &[EdgePoint; 2],
    [b0, b1]: &[EdgePoint; 2],
    of: &impl Fn(&EdgePoint) -> [f64; 2],
) -> f64 {
    let corners = [a0, a1, b1, b0].map(of);
    let doubled = (0..4).map(|i| {
        let ([x0, y0], [x1, y1]) = (corners[i], corners[(i + 1) % 4]);
        x0 * y1 - x1 * y0
    });
    0.5 * doubled.sum::<f64>()
}

/// Steps over the pupil's diameter in which its edge is looked for, up to four times its radius:
/// an obstacle thinner than a step is missed, and a pupil that grows by more with the field is cut
/// off.
pub(super) const STEPS_PER_DIAMETER: f64 = 12.0;
const STEPS: usize = 24;

/// Edges of the pupil along [`LANES`] directions, looked for in steps of `step` mm from its middle;
/// `trace` gives the rays at places relative to the middle.
pub(super) fn edges_along(
    trace: &impl Fn(&[[f64; 2]; LANES]) -> Rays<LANES>,
    step: f64,
    ways: &[[f64; 2]; LANES],
    excess_in_middle: f64,
    middle: EdgePoint,
) -> [Option<[EdgePoint; 2]>; LANES] {
    let at = |distance: &[f64; LANES]| {
        trace(&std::array::from_fn(|i| ways[i].map(|w| w * distance[i])))
    };
    let open = excess_in_middle <= 0.0;
    // Per lane: brackets [inside, outside] of the inner and the outer edge.
    let mut entry = [open.then_some([0.0, 0.0]); LANES];
    let mut exit = [None; LANES];
    for k in 1..=STEPS {
        if exit.iter().all(Option::is_some) {
            break;
        }
        let here = k as f64 * step;
        let rays = at(&[here; LANES]);
        for i in 0..LANES {
            match (rays.passes(i), entry[i], exit[i]) {
                (true, None, _) => entry[i] = Some([here, here - step]),
                (false, Some(_), None) => exit[i] = Some([here - step, here]),
                _ => {}
            }
        }
    }
    let zero = [[0.0; 2]; LANES];
    let bracket =
        |edge: &[Option<[f64; 2]>; LANES]| std::array::from_fn(|i| edge[i].unwrap_or(zero[i]));
    let outer = refine(&at, bracket(&exit));
    let outer_rays = at(&outer);
    let inner = if open { [0.0; LANES] } else { refine(&at, bracket(&entry)) };
    let inner_rays = if open { None } else { Some(at(&inner)) };
    let point = |distance: f64, i: usize, rays: &Rays<LANES>| {
        EdgePoint::of(rays, i, ways[i].map(|w| w * distance))
    };
    std::array::from_fn(|i| {
        exit[i]?;
        let from = inner_rays.as_ref().map_or(middle, |rays| point(inner[i], i, rays));
        Some([from, point(outer[i], i, &outer_rays)])
    })
}

/// Where the excess changes sign between `inside` and `outside`, in each lane: regula falsi
/// (Illinois variant), and bisection next to rays that are lost.
fn refine(at: &impl Fn(&[f64; LANES]) -> Rays<LANES>, bracket: [[f64; 2]; LANES]) -> [f64; LANES] {
    // An excess is relative to a squared radius, a width to a launch coordinate: both end some
    // rounding errors above what f64 resolves. Bisection alone needs 44 rounds for that.
    const ENOUGH_EXCESS: f64 = 1e-12;
    const ENOUGH_WIDTH: f64 = 1e-13;
    const ROUNDS: usize = 60;
    let mut inside = bracket.map(|b| b[0]);
    let mut outside = bracket.map(|b| b[1]);
    let value = |rays: &Rays<LANES>, i: usize| match rays.alive(i) {
        true => rays.excess[i],
        false => f64::NAN,
    };
    let (low, high) = (at(&inside), at(&outside));
    let mut f_in: [f64; LANES] = std::array::from_fn(|i| value(&low, i));
    let mut f_out: [f64; LANES] = std::array::from_fn(|i| value(&high, i));
    let mut last_inside = [None; LANES];
    for _ in 0..ROUNDS {
        let guess: [f64; LANES] = std::array::from_fn(|i| {
            let secant = inside[i] - f_in[i] * (outside[i] - inside[i]) / (f_out[i] - f_in[i]);
            if secant.is_finite() { secant } else { 0.5 * (inside[i] + outside[i]) }
        });
        let rays = at(&guess);
        let mut settled = true;
        for i in 0..LANES {
            let f = value(&rays, i);
            let passes = f <= 0.0;
            if passes {
                (inside[i], f_in[i]) = (guess[i], f);
            } else {
                (outside[i], f_out[i]) = (guess[i], f);
            }
            // Illinois variant: an end that stays twice in a row has its value halved.
            if last_inside[i] == Some(passes) {
                *(if passes { &mut f_out[i] } else { &mut f_in[i] }) *= 0.5;
            }
            last_inside[i] = Some(passes);
            let width = (outside[i] - inside[i]).abs();
            settled &= f.abs() < ENOUGH_EXCESS || width <= ENOUGH_WIDTH * outside[i].abs();
            if f.abs() < ENOUGH_EXCESS {
                (inside[i], outside[i], f_in[i]) = (guess[i], guess[i], 0.0);
            }
        }
        if settled {
            break;
        }
    }
    inside
}
