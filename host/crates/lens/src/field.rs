//! Figures over a two-dimensional field, for lenses that are not rotationally symmetric.
//!
//! # Conventions
//! A field point is given by two angles, degrees: the projections on the planes of x–z and y–z of
//! the chief ray's direction at the paraxial entrance pupil, as lens programs have them. For a
//! finite object they name the object point at −(distance to the pupil)·(tan θx, tan θy). x and y
//! are those of the first surface's coordinates before any tilt of its own; landing places and
//! angles at the image are in coordinates of the image plane.
//!
//! Paraxial figures (pupils, stop radius, focal length) are those of the lens without its tilts
//! and decentres, in the plane of y and z. Distortion refers to the real lens instead: the
//! linear map that chief rays next to the field point (0, 0) have, at the reference wavelength.

mod characterise;

pub use characterise::{PlanePlan, characterise};

use super::prescription::{Clip, Object};
use super::pupil::{
    Bundle, EdgePoint, Extent, Outline, STEPS_PER_DIAMETER, check_obstacles, edges_along,
};
use super::system::System;
use super::trace::{LANES, Rays, Start, lost_at, trace_lanes, trace_one};
use super::train::Train;
use camrig_base::{Error, Result};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Azimuths of the pupil's outline: the inscribed polygon's area is too small by (2π/512)²/6 =
/// 2.5e-5 of itself, on the axis alike.
const AZIMUTHS: usize = 512;
/// Rays along each azimuth for the size of the spot.
const RINGS: usize = 32;
/// Projected solid angle, sr, below which rays run parallel in a plane and make a line of a point:
/// rounding of direction cosines leaves 1e-16 of it.
const LEAST_SR: f64 = 1e-12;
/// Tangent of the field angles from whose chief rays the linear map is taken: the map's own
/// curvature then errs by some 1e-8 of a length.
const NEAR: f64 = 1e-4;

/// Figures of a field point at one wavelength.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Field angles in x and y, degrees.
    pub field_deg: [f64; 2],
    /// Wavelength, nm.
    pub wavelength_nm: f64,
    /// Where the chief ray lands on the image plane, (x, y) from its origin, mm.
    pub chief_mm: [f64; 2],
    /// Angles of the chief ray with the image plane's normal, in x and y, degrees.
    pub cra_deg: [f64; 2],
    /// Where the linear map of the field's middle puts it, mm.
    pub linear_mm: [f64; 2],
    /// Projected solid angle of the clipped pupil seen from the image point over that at the field
    /// point (0, 0); NaN where the image is a line, the solid angle being 0.
    pub relative_illumination: f64,
    /// Projected solid angle of the pupil seen from the image point, sr.
    pub projected_solid_angle_sr: f64,
    /// Root-mean-square distance of the rays from their centroid, mm.
    pub spot_rms_mm: f64,
}

impl Point {
    /// Distance of the chief ray from where the linear map puts it over that from the middle of
    /// the field, percent; `middle` is the linear map's own place of the field point (0, 0), mm.
    #[must_use]
    pub fn distortion_percent(&self, middle: [f64; 2]) -> f64 {
        let far = distance(self.linear_mm, middle);
        if far == 0.0 { 0.0 } else { 100.0 * distance(self.chief_mm, self.linear_mm) / far }
    }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    ((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)).sqrt()
}

/// The map from the tangents of field angles to the image plane near the field point (0, 0).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Map {
    /// Where the chief ray of the field point (0, 0) lands, mm.
    pub middle_mm: [f64; 2],
    /// Derivatives of the landing place by tan θx and by tan θy, mm.
    pub slopes_mm: [[f64; 2]; 2],
}

impl Map {
    /// The map of a lens at its reference wavelength.
    ///
    /// # Errors
    /// Chief rays that are lost.
    pub fn of(system: &System) -> Result<Self> {
        let train = system.at(system.prescription.reference_nm)?;
        let at = |x: f64, y: f64| Ok(Beam::aim(&train, [x, y])?.landing());
        let slope = |x: f64, y: f64| -> Result<[f64; 2]> {
            let (ahead, behind): ([f64; 2], [f64; 2]) = (at(x, y)?, at(-x, -y)?);
            Ok([0, 1].map(|k| (ahead[k] - behind[k]) / (2.0 * NEAR)))
        };
        Ok(Self { middle_mm: at(0.0, 0.0)?, slopes_mm: [slope(NEAR, 0.0)?, slope(0.0, NEAR)?] })
    }

    /// The principal distance of the lens as it is: the square root of the area that the map
    /// gives to a unit of both tangents, mm.
    #[must_use]
    pub fn principal_distance_mm(&self) -> f64 {
        let [by_x, by_y] = self.slopes_mm;
        (by_x[0] * by_y[1] - by_x[1] * by_y[0]).abs().sqrt()
    }

    /// Sides of the square frame whose corners are at a field, degrees, mm.
    #[must_use]
    pub fn square_frame_mm(&self, corner_deg: f64) -> [f64; 2] {
        let corner = self.principal_distance_mm() * libm::tan(corner_deg.to_radians());
        [corner * std::f64::consts::SQRT_2; 2]
    }

    /// Where it puts the field point with these tangents, mm.
    #[must_use]
    pub fn place(&self, tangents: [f64; 2]) -> [f64; 2] {
        let [by_x, by_y] = self.slopes_mm;
        [0, 1].map(|k| self.middle_mm[k] + tangents[0] * by_x[k] + tangents[1] * by_y[k])
    }
}

/// Figures at every field point (angles in x and y, degrees) and wavelength (nm), fields
/// outermost.
///
/// # Errors
/// Field angles of 90° or more; rays that are lost, light that does not get through, glasses
/// without data.
pub fn points(
    system: &System,
    map: &Map,
    fields: &[[f64; 2]],
    wavelengths: &[f64],
) -> Result<Vec<Point>> {
    let trains: Result<Vec<(Train, f64)>> = wavelengths
        .iter()
        .map(|&nm| {
            let train = system.at(nm)?;
            let middle = Beam::aim(&train, [0.0; 2])?.outline()?.projected_solid_angle();
            Ok((train, middle))
        })
        .collect();
    let trains = trains?;
    let points: Result<Vec<Vec<Point>>> = fields
        .par_iter()
        .map(|&field| trains.iter().map(|(t, middle)| point(t, map, field, *middle)).collect())
        .collect();
    Ok(points?.concat())
}

fn point(train: &Train, map: &Map, field_deg: [f64; 2], middle_sr: f64) -> Result<Point> {
    if !field_deg.iter().all(|deg| deg.abs() < 90.0) {
        return Err(Error::input(format!("field angles {field_deg:?}°"))
            .help("field angles lie between -90° and 90°"));
    }
    let tangents = field_deg.map(|deg| libm::tan(deg.to_radians()));
    let beam = Beam::aim(train, tangents)?;
    let outline = beam.outline()?;
    let solid_angle = outline.projected_solid_angle();
    let (_, d) = beam.chief.get(0);
    Ok(Point {
        field_deg,
        wavelength_nm: train.nm,
        chief_mm: beam.landing(),
        cra_deg: [0, 1].map(|k| libm::atan2(d[k], d[2].abs()).to_degrees()),
        linear_mm: map.place(tangents),
        relative_illumination: if middle_sr < LEAST_SR {
            f64::NAN
        } else {
            solid_angle / middle_sr
        },
        projected_solid_angle_sr: if solid_angle < LEAST_SR { f64::NAN } else { solid_angle },
        spot_rms_mm: beam.spot_rms_mm(&outline),
    })
}

/// Checks that light from a field, degrees, arrives.
///
/// # Errors
/// Where its chief ray or all of its light is lost.
pub(super) fn check(train: &Train, field_deg: [f64; 2]) -> Result<()> {
    let tangents = field_deg.map(|deg| libm::tan(deg.to_radians()));
    Beam::aim(train, tangents)?.outline().map(|_| ())
}

/// Where rays of a field point start, and where to.
struct Launcher {
    /// Towards the middle of the pupil, and two directions across.
    along: [f64; 3],
    across: [[f64; 3]; 2],
    pupil_z: f64,
    /// For a finite object: the place that rays are launched around, in x and y, and its distance
    /// from the object point.
    object: Option<([f64; 2], f64)>,
    /// Index of the object's medium.
    index: f64,
}

impl Launcher {
    fn new(train: &Train, [tx, ty]: [f64; 2]) -> Result<Self> {
        let pupil_z = train.entrance_z_mm;
        let slant = (tx * tx + ty * ty + 1.0).sqrt();
        let mut along = [tx, ty, 1.0].map(|v| v / slant);
        let object = match train.object {
            Object::Infinity => None,
            Object::Distance(d) if d + pupil_z > 0.0 => {
                let to_pupil = d + pupil_z;
                Some(match train.telecentric {
                    true => {
                        along = [0.0, 0.0, 1.0];
                        ([-to_pupil * tx, -to_pupil * ty], to_pupil)
                    }
                    false => ([0.0; 2], to_pupil * slant),
                })
            }
            Object::Distance(d) => {
                return Err(Error::input(format!(
                    "the entrance pupil lies behind the object at {d} mm"
                ))
                .help("such lenses are not supported"));
            }
        };
        let flat = (along[0] * along[0] + along[2] * along[2]).sqrt();
        let x = [along[2] / flat, 0.0, -along[0] / flat];
        let y = [
            along[1] * x[2] - along[2] * x[1],
            along[2] * x[0] - along[0] * x[2],
            along[0] * x[1] - along[1] * x[0],
        ];
        Ok(Self { along, across: [x, y], pupil_z, object, index: train.paraxial.object_index })
    }

    /// The ray through a place (px, py) in the plane across the beam through the pupil's middle,
    /// mm. Its path is counted from the sphere around the object point through the plane's middle,
    /// so that a far object costs no digits.
    fn ray(&self, [px, py]: [f64; 2]) -> Start {
        let [x, y] = self.across;
        let aside = [0, 1, 2].map(|k| px * x[k] + py * y[k]);
        let from = |[x, y]: [f64; 2]| [x + aside[0], y + aside[1], self.pupil_z + aside[2]];
        match self.object {
            None => Start { position: from([0.0; 2]), direction: self.along, path: 0.0 },
            Some((centre, far)) => {
                let aim = [0, 1, 2].map(|k| far * self.along[k] + aside[k]);
                let length = aim.iter().map(|v| v * v).sum::<f64>().sqrt();
                Start {
                    position: from(centre),
                    direction: aim.map(|v| v / length),
                    path: self.index * (px * px + py * py) / (length + far),
                }
            }
        }
    }

    /// Radiant power per launch area, up to a factor: see the beams of rotational lenses.
    fn power(&self, place: [f64; 2]) -> f64 {
        match self.object {
            None => 1.0,
            Some((_, far)) => {
                let cosine = self.ray(place).direction[2];
                let r2 = 1.0 + (place[0].powi(2) + place[1].powi(2)) / (far * far);
                cosine / (r2 * r2.sqrt())
            }
        }
    }
}

/// The beam from a field point, its chief ray aimed through the centre of the stop.
struct Beam<'a> {
    train: &'a Train,
    launcher: Launcher,
    chief_launch: [f64; 2],
    chief: Rays<1>,
    tangents: [f64; 2],
}

impl<'a> Beam<'a> {
    /// Follows the chief ray from the field point (0, 0) outwards, in steps of the tangents, so
    /// that it is the one continuously connected with it.
    fn aim(train: &'a Train, tangents: [f64; 2]) -> Result<Self> {
        // Parts of the way; a step that fails is divided by SHRINK.
        const STEP: f64 = 0.25;
        const SMALLEST: f64 = 1e-4;
        const SHRINK: f64 = 4.0;

        let at = |part: f64| Launcher::new(train, tangents.map(|t| t * part));
        let (mut done, mut step) = (0.0, STEP);
        let first = at(0.0)?;
        let mut launch = centre_of_stop(train, &first, [0.0; 2])
            .ok_or_else(|| chief_lost(train, [0.0; 2], &first.ray([0.0; 2])))?;
        while done < 1.0 {
            let next = f64::min(done + step, 1.0);
            match centre_of_stop(train, &at(next)?, launch) {
                Some(found) => (launch, done, step) = (found, next, STEP),
                None if step > SMALLEST => step /= SHRINK,
                None => {
                    let ray = at(next)?.ray(launch);
                    return Err(chief_lost(train, tangents.map(|t| t * next), &ray));
                }
            }
        }
        let launcher = at(1.0)?;
        let start = launcher.ray(launch);
        let mut chief = Rays::nowhere();
        chief.launch(0, &start);
        trace_one(&train.surfaces, &mut chief);
        if !chief.alive(0) {
            return Err(chief_lost(train, tangents, &start));
        }
        Ok(Self { train, launcher, chief_launch: launch, chief, tangents })
    }

    /// Where the chief ray lands, mm.
    fn landing(&self) -> [f64; 2] {
        [self.chief.position[0][0], self.chief.position[1][0]]
    }

    fn outline(&self) -> Result<Outline> {
        let centre = self.trace(&[[0.0; 2]; LANES]);
        let middle = EdgePoint::of(&centre, 0, [0.0; 2]);
        let here = || place(self.train, self.tangents);
        check_obstacles(self.train, centre.excess[0] <= 0.0, &here)?;
        let step = self.train.entrance_pupil_mm / STEPS_PER_DIAMETER;
        let trace = |places: &[[f64; 2]; LANES]| self.trace(places);
        let mut edges = Vec::with_capacity(AZIMUTHS);
        for block in 0..AZIMUTHS / LANES {
            let ways = std::array::from_fn(|i| way((block * LANES + i) as f64));
            edges.extend(edges_along(&trace, step, &ways, centre.excess[0], middle));
        }
        // Closed: the last azimuth is the first.
        edges.push(edges[0]);
        Outline::new(Extent::Whole, edges, &here)?.resolved(&here)
    }

    /// Root-mean-square distance of the rays from their centroid, mm: rays at even steps between
    /// the pupil's edges, each with the area it represents.
    fn spot_rms_mm(&self, outline: &Outline) -> f64 {
        let mut sums = [0.0; 4];
        let origin = self.landing();
        for (azimuth, edge) in outline.edges.iter().take(AZIMUTHS).enumerate() {
            let Some([inner, outer]) = edge else { continue };
            let reach = |p: &EdgePoint| distance(p.launch, [0.0; 2]);
            let (from, to) = (reach(inner), reach(outer));
            let ring = (to - from) / RINGS as f64;
            let direction = way(azimuth as f64);
            for block in 0..RINGS / LANES {
                let radius = |i: usize| from + ring * ((block * LANES + i) as f64 + 0.5);
                let places = std::array::from_fn(|i| direction.map(|w| w * radius(i)));
                let rays = self.trace(&places);
                for i in (0..LANES).filter(|&i| rays.alive(i)) {
                    let weight = radius(i) * ring * self.power(places[i]);
                    let [x, y] = [0, 1].map(|k| rays.position[k][i] - origin[k]);
                    let here = [1.0, x, y, x * x + y * y];
                    sums = [0, 1, 2, 3].map(|k| sums[k] + weight * here[k]);
                }
            }
        }
        let [power, x, y, square] = sums;
        (square / power - (x / power).powi(2) - (y / power).powi(2)).max(0.0).sqrt()
    }
}

/// The direction across the beam with this number.
fn way(azimuth: f64) -> [f64; 2] {
    let (sine, cosine) = libm::sincos(TAU * azimuth / AZIMUTHS as f64);
    [cosine, sine]
}

impl Bundle for Beam<'_> {
    fn train(&self) -> &Train {
        self.train
    }

    fn chief(&self) -> &Rays<1> {
        &self.chief
    }

    fn trace(&self, places: &[[f64; 2]; LANES]) -> Rays<LANES> {
        let mut rays = Rays::nowhere();
        for (i, place) in places.iter().enumerate() {
            let place = [0, 1].map(|k| self.chief_launch[k] + place[k]);
            rays.launch(i, &self.launcher.ray(place));
            if let Some(radius) = self.train.cone_mm {
                rays.excess[i] = Clip::circle(radius).excess(place[0], place[1]);
            }
        }
        trace_lanes(&self.train.surfaces, &mut rays);
        rays
    }

    fn power(&self, place: [f64; 2]) -> f64 {
        self.launcher.power([0, 1].map(|k| self.chief_launch[k] + place[k]))
    }
}

/// The launch place whose ray meets the centre of the stop, by Newton's method from `guess`; `None`
/// where that fails.
fn centre_of_stop(train: &Train, launcher: &Launcher, guess: [f64; 2]) -> Option<[f64; 2]> {
    // A few rounding errors of a height at the stop end the search; 1e-9 of its radius is success.
    const ROUNDS: usize = 30;
    if train.cone_mm.is_some() {
        return Some([0.0; 2]);
    }
    let miss = |place: [f64; 2]| {
        let ray = train.at_stop(&launcher.ray(place));
        let (p, _) = ray.get(0);
        let alive = ray.path[0].is_finite() && p[0].is_finite();
        alive.then_some([p[0], p[1]])
    };
    let size = |v: [f64; 2]| distance(v, [0.0; 2]);
    let step = 1e-4 * train.entrance_pupil_mm;
    let (mut place, mut off) = (guess, miss(guess)?);
    for _ in 0..ROUNDS {
        if size(off) <= 4.0 * f64::EPSILON * train.stop_radius_mm {
            break;
        }
        let slope = |k: usize| -> Option<[f64; 2]> {
            let beside = |by: f64| {
                let mut other = place;
                other[k] += by;
                miss(other)
            };
            let (ahead, behind) = (beside(step)?, beside(-step)?);
            Some([0, 1].map(|j| (ahead[j] - behind[j]) / (2.0 * step)))
        };
        let ([a, c], [b, d]) = (slope(0)?, slope(1)?);
        let determinant = a * d - b * c;
        let next = [
            place[0] - (d * off[0] - b * off[1]) / determinant,
            place[1] - (a * off[1] - c * off[0]) / determinant,
        ];
        match miss(next) {
            Some(new) if size(new) < size(off) => (place, off) = (next, new),
            _ => break,
        }
    }
    (size(off) <= 1e-9 * train.stop_radius_mm).then_some(place)
}

fn place(train: &Train, tangents: [f64; 2]) -> String {
    let [x, y] = tangents.map(|t| libm::atan(t).to_degrees());
    format!("field ({x:.4}°, {y:.4}°), {} nm", train.nm)
}

fn chief_lost(train: &Train, tangents: [f64; 2], start: &Start) -> Error {
    let mut ray = Rays::nowhere();
    ray.launch(0, start);
    let error = match lost_at(&train.surfaces, &ray) {
        Some((surface, how)) => {
            Error::input(format!("a ray meant for surface {} {how}", surface + 1))
        }
        None => Error::input("no ray reaches the centre of the stop"),
    };
    error
        .at(place(train, tangents))
        .help("the field is larger than the lens takes: give smaller fields, or check the surface")
}

#[cfg(test)]
mod tests;
