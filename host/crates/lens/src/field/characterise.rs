//! From a lens without rotational symmetry to a whole [`PlaneCharacterisation`].
//!
//! # Conventions
//! The sensor lies about the origin of the image plane, its rows along x and its columns along y.
//! Its frame shows the scene upright and not mirrored, as cameras do: x and y of the image plane
//! are turned round where the lens, or a mirror in it, puts the image upside down.
//!
//! The principal distance is that of the lens as it stands, tilts and all
//! ([`Map::principal_distance_mm`]). The f-number is the one
//! with which eq. 7 gives the light in the middle of the field.
//!
//! Between places PSFs are blended bilinearly. In the middle of every cell, where that is worst,
//! the PSF is traced too, and compared after integration over pixels. Cells are halved all over
//! the frame until the mean error keeps the tolerance.

use super::{Beam, Map};
use crate::characterise::{PsfMethod, samples_upright, spacing_um, traced_psf};
use crate::heights::{Density, blend_error_window};
use crate::psf::{PROBE_CELLS, Window};
use crate::pupil::Bundle;
use crate::samples::PupilSamples;
use crate::system::System;
use crate::train::Train;
use camrig_base::Spectrum;
use camrig_base::{Error, Result};
use camrig_optics::engine::nodes::Misplaced;
use camrig_optics::{Between, PlaneCharacterisation};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What a characterisation over the plane is to contain.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanePlan {
    /// Width and height of the sensor's frame, mm.
    pub frame_mm: [f64; 2],
    /// How places are added; `None` keeps the first ones and does not measure the error between
    /// them.
    pub density: Option<Density>,
    /// Wavelengths, nm, strictly rising.
    pub wavelengths_nm: Vec<f64>,
    /// Samples per side of a PSF.
    pub psf_size: usize,
    /// Distance between PSF samples, µm; `None` chooses it so that the spots fit into the window
    /// and diffraction is resolved.
    pub psf_spacing_um: Option<f64>,
    /// How PSFs are computed.
    pub method: PsfMethod,
}

/// Steps of the finest lattice that places lie on, each way; the first places have
/// [`FIRST_STEP`] of them between each other, the last ones two (their middles lie between).
const STEPS: usize = 64;
const FIRST_STEP: usize = 16;
const LAST_STEP: usize = 2;
/// Most PSF samples of a characterisation, of four bytes each: places are not added beyond.
const MAX_SAMPLES: usize = 1 << 28;
/// Points along each side of the frame whose field angles are looked for.
const OUTLINE_POINTS: usize = 8;

/// A place on the finest lattice: column and row.
type Place = (usize, usize);

/// What is traced at a place and a wavelength.
struct Traced {
    real_mm: [f64; 2],
    relative_illumination: f64,
    psf: Vec<f32>,
    captured: f64,
}

/// The lens at a wavelength, with the solid angle of the light in the middle of the sensor.
struct MiddleTrain {
    train: Train,
    middle_sr: f64,
}

impl MiddleTrain {
    fn new(system: &System, nm: f64) -> Result<Self> {
        let train = system.at(nm)?;
        let beam = Beam::aim(&train, [0.0; 2])?;
        let middle_sr = beam.solid_angle_from_sensor(&beam.outline()?);
        Ok(Self { train, middle_sr })
    }
}

/// The upright picture: how places of the image plane and field angles become places of it.
#[derive(Clone, Copy, Debug)]
struct Picture {
    principal_distance_mm: f64,
    /// Signs of right over x and of down over y of the image plane.
    signs: [f64; 2],
}

impl Picture {
    fn new(map: &Map) -> Result<Self> {
        let [by_x, by_y] = map.slopes_mm;
        if by_x[1].abs() >= by_x[0].abs() || by_y[0].abs() >= by_y[1].abs() {
            return Err(Error::unsupported(
                "the lens turns the image about its axis by 45° or more",
            )
            .help("turn the image surface with it, so that the scene lies upright on it"));
        }
        // The object of positive tangents lies left of and below the axis, seen from behind the
        // camera, with y upwards.
        let signs = [-by_x[0].signum(), by_y[1].signum()];
        Ok(Self { principal_distance_mm: map.principal_distance_mm(), signs })
    }

    fn of_image(&self, place: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|k| self.signs[k] * place[k])
    }

    fn ideal(&self, tangents: [f64; 2]) -> [f64; 2] {
        [-tangents[0], tangents[1]].map(|t| t * self.principal_distance_mm)
    }

    fn tangents(&self, ideal_mm: [f64; 2]) -> [f64; 2] {
        [-ideal_mm[0], ideal_mm[1]].map(|v| v / self.principal_distance_mm)
    }
}

/// Characterises a lens over the plane of the image.
///
/// Places are chosen by the PSFs at the first, middle and last wavelength. Then
/// `progress(done, total)` is called after each place, from any thread.
///
/// # Errors
/// Chief rays that do not reach the frame's corners; an image turned by 45° or more; distortion
/// that folds the image; a PSF window that no light reaches.
pub fn characterise(
    system: &System,
    plan: &PlanePlan,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<PlaneCharacterisation> {
    let trains: Result<Vec<MiddleTrain>> =
        plan.wavelengths_nm.iter().map(|&nm| MiddleTrain::new(system, nm)).collect();
    let trains = trains?;
    if trains.is_empty() {
        return Err(Error::input("no wavelength").help("give at least one, in nm"));
    }
    let reference = MiddleTrain::new(system, system.prescription.reference_nm)?;
    let map = Map::of(system)?;
    let picture = Picture::new(&map)?;
    let [x, y] = ideal_frame(&reference.train, &map, &picture, plan.frame_mm)?;
    let spacing = match plan.psf_spacing_um {
        Some(spacing) => spacing,
        None => spacing_for(&trains, &picture, [x, y], plan.psf_size)?,
    };
    let window = Window { size: plan.psf_size, spacing_mm: spacing * 1e-3 };
    let tracer = Tracer { plan, trains: &trains, picture, window, x, y };
    let last = trains.len() - 1;
    // The engine judges interpolation at the same three bands.
    let mut probes = vec![0, last / 2, last];
    probes.dedup();
    let Chosen { mut known, step, between } = tracer.choose(&probes)?;
    let places = lattice(step);
    let done = AtomicUsize::new(0);
    let rest: Result<Vec<Vec<Traced>>> = places
        .par_iter()
        .map(|&place| {
            let others = (0..trains.len()).filter(|w| between.is_none() || !probes.contains(w));
            let traced = others.map(|w| tracer.trace(place, w)).collect();
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, places.len());
            traced
        })
        .collect();
    let axis = |[from, to]: [f64; 2]| -> Vec<f64> {
        (0..=STEPS).step_by(step).map(|i| part_of_way(from, to, i)).collect()
    };
    let mut lens = PlaneCharacterisation {
        name: system.prescription.name.clone(),
        source: format!("traced by camrig {}", env!("CARGO_PKG_VERSION")),
        principal_distance_mm: picture.principal_distance_mm,
        working_f_number: (0.25 * (PI / reference.middle_sr - 1.0)).sqrt(),
        // Of light that comes from another medium, radiance over n² stays the same.
        transmittance: Spectrum::constant(system.paraxial.object_index.powi(2).recip()),
        wavelengths_nm: plan.wavelengths_nm.clone(),
        x_mm: axis(x),
        y_mm: axis(y),
        real_x_mm: Vec::new(),
        real_y_mm: Vec::new(),
        relative_illumination: Vec::new(),
        psf_size: window.size,
        psf_spacing_um: spacing,
        psf: Vec::new(),
        captured: Vec::new(),
        between,
    };
    for (place, others) in places.iter().zip(rest?) {
        let mut probed = known.remove(place).unwrap_or_default().into_iter();
        let mut others = others.into_iter();
        for w in 0..trains.len() {
            let kept = if probes.contains(&w) { probed.next() } else { None };
            let Some(traced) = kept.or_else(|| others.next()) else {
                return Err(Error::internal("a place was not traced"));
            };
            lens.real_x_mm.push(traced.real_mm[0]);
            lens.real_y_mm.push(traced.real_mm[1]);
            lens.relative_illumination.push(traced.relative_illumination);
            lens.captured.push(traced.captured);
            lens.psf.extend(traced.psf);
        }
    }
    lens.validate()?;
    Ok(lens)
}

/// The places of the lattice with this step, row by row.
fn lattice(step: usize) -> Vec<Place> {
    let along = || (0..=STEPS).step_by(step);
    along().flat_map(|j| along().map(move |i| (i, j))).collect()
}

fn part_of_way(from: f64, to: f64, step: usize) -> f64 {
    from + (to - from) * step as f64 / STEPS as f64
}

/// The least and largest ideal places, right and below, of the frame's outline at the reference
/// wavelength.
fn ideal_frame(
    train: &Train,
    map: &Map,
    picture: &Picture,
    frame_mm: [f64; 2],
) -> Result<[[f64; 2]; 2]> {
    if !frame_mm.iter().all(|side| side.is_finite() && *side > 0.0) {
        return Err(Error::input(format!("a frame of {frame_mm:?} mm"))
            .help("give width and height of the sensor, above 0"));
    }
    let [half_x, half_y] = frame_mm.map(|side| 0.5 * side);
    let mut range = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    for k in 0..OUTLINE_POINTS {
        let part = 2.0 * k as f64 / OUTLINE_POINTS as f64 - 1.0;
        let (x, y) = (part * half_x, part * half_y);
        for corner in [[x, -half_y], [half_x, y], [-x, half_y], [-half_x, -y]] {
            let tangents = field_of(train, map, picture.of_image(corner))?;
            let ideal = picture.ideal(tangents);
            for (range, v) in range.iter_mut().zip(ideal) {
                *range = [range[0].min(v), range[1].max(v)];
            }
        }
    }
    Ok(range)
}

/// The tangents of the field point whose chief ray lands at a place of the image plane, mm: by
/// steps that the linear map foretells.
fn field_of(train: &Train, map: &Map, wanted: [f64; 2]) -> Result<[f64; 2]> {
    // mm: far below a pixel; the bound serves distortion of some tens of per cent.
    const ENOUGH: f64 = 1e-6;
    const ROUNDS: usize = 60;
    let [by_x, by_y] = map.slopes_mm;
    let determinant = by_x[0] * by_y[1] - by_x[1] * by_y[0];
    let mut tangents = [0.0; 2];
    let mut here = map.middle_mm;
    for _ in 0..ROUNDS {
        let off = [wanted[0] - here[0], wanted[1] - here[1]];
        if super::distance(here, wanted) < ENOUGH {
            return Ok(tangents);
        }
        tangents[0] += (by_y[1] * off[0] - by_y[0] * off[1]) / determinant;
        tangents[1] += (by_x[0] * off[1] - by_x[1] * off[0]) / determinant;
        here = Beam::aim(train, tangents)?.landing();
    }
    Err(Error::input(format!(
        "no field point was found whose chief ray lands at ({:.3}, {:.3}) mm",
        wanted[0], wanted[1]
    ))
    .help("the lens distorts strongly, or does not reach the sensor's edge: use a smaller one"))
}

/// Distance between PSF samples, µm, by the spots in the middle and at the corners of the frame.
fn spacing_for(
    trains: &[MiddleTrain],
    picture: &Picture,
    [x, y]: [[f64; 2]; 2],
    size: usize,
) -> Result<f64> {
    let (first, last) = (&trains[0], &trains[trains.len() - 1]);
    let mut reach = 0.0_f64;
    let corners = [[x[0], y[0]], [x[1], y[0]], [x[0], y[1]], [x[1], y[1]], [0.0, 0.0]];
    for corner in corners {
        for train in [first, last] {
            let beam = Beam::aim(&train.train, picture.tangents(corner))?;
            let probe = PupilSamples::trace(&beam, &beam.outline()?, PROBE_CELLS);
            let far = probe.rays.iter().map(|r| r.landing[0].abs().max(r.landing[1].abs()));
            reach = far.fold(reach, f64::max);
        }
    }
    Ok(spacing_um(reach, first.middle_sr, first.train.nm, size))
}

/// Traces the PSFs of a characterisation.
struct Tracer<'a> {
    plan: &'a PlanePlan,
    trains: &'a [MiddleTrain],
    picture: Picture,
    window: Window,
    /// Least and largest ideal places of columns and rows, mm.
    x: [f64; 2],
    y: [f64; 2],
}

impl Tracer<'_> {
    /// The PSF and figures at a place and the wavelength with this index.
    fn trace(&self, (i, j): Place, wavelength: usize) -> Result<Traced> {
        let MiddleTrain { train, middle_sr } = &self.trains[wavelength];
        let ideal = [part_of_way(self.x[0], self.x[1], i), part_of_way(self.y[0], self.y[1], j)];
        let tangents = self.picture.tangents(ideal);
        let beam = Beam::aim(train, tangents)?;
        let outline = beam.outline()?;
        let place = || super::place(train, tangents);
        let psf = traced_psf(&beam, &outline, &self.window, self.plan.method, &place)?;
        Ok(Traced {
            real_mm: self.picture.of_image(beam.landing()),
            relative_illumination: beam.solid_angle_from_sensor(&outline) / middle_sr,
            psf: samples_upright(&psf, self.window.size, self.picture.signs.map(|s| s < 0.0)),
            captured: psf.captured,
        })
    }

    /// The PSFs at the probed wavelengths of enough places that those between are blends.
    fn choose(&self, probes: &[usize]) -> Result<Chosen> {
        let mut known = Known::new();
        let mut step = FIRST_STEP;
        let Some(density) = &self.plan.density else {
            return Ok(Chosen { known, step, between: None });
        };
        let error = blend_error_window(self.window.size, self.window.spacing_mm, density.pixel_um);
        loop {
            let middles = middles(step);
            self.trace_all(probes, lattice(step).into_iter().chain(middles.clone()), &mut known)?;
            let errors: Vec<(f64, f64)> = middles
                .par_iter()
                .map(|&middle| (blend_error(&known, middle, step, &error), 1.0))
                .collect();
            let Misplaced { mean, largest } = Misplaced::of(&errors);
            let next = step / 2;
            let psfs = lattice(next).len() * self.trains.len();
            let fits = psfs.saturating_mul(self.window.size.pow(2)) <= MAX_SAMPLES;
            if mean <= density.tolerance || next < LAST_STEP || !fits {
                let between = Between {
                    misplaced_mean: mean,
                    misplaced_largest: largest,
                    pixel_um: density.pixel_um,
                };
                return Ok(Chosen { known, step, between: Some(between) });
            }
            step = next;
        }
    }

    /// Traces those of some places that are not known yet, at the probed wavelengths.
    fn trace_all(
        &self,
        probes: &[usize],
        places: impl Iterator<Item = Place>,
        known: &mut Known,
    ) -> Result<()> {
        let missing: Vec<Place> = places.filter(|place| !known.contains_key(place)).collect();
        let traced: Result<Vec<(Place, Vec<Traced>)>> = missing
            .into_par_iter()
            .map(|place| {
                let all: Result<_> = probes.iter().map(|&w| self.trace(place, w)).collect();
                Ok((place, all?))
            })
            .collect();
        known.extend(traced?);
        Ok(())
    }
}

/// What was traced at places, by wavelength.
type Known = BTreeMap<Place, Vec<Traced>>;

/// Places that suffice, which are `step` apart, with what was traced on the way and how far blends
/// of them are from the truth.
struct Chosen {
    known: Known,
    step: usize,
    between: Option<Between>,
}

/// Places in the middle of four of a lattice.
fn middles(step: usize) -> Vec<Place> {
    let first = lattice(step).into_iter().filter(|&(i, j)| i < STEPS && j < STEPS);
    first.map(|(i, j)| (i + step / 2, j + step / 2)).collect()
}

/// The largest error over wavelengths of a PSF as the mean of those at the corners about it.
fn blend_error(
    known: &Known,
    (i, j): Place,
    step: usize,
    error: &(impl Fn(&[f32], &[f32]) -> f64 + Sync),
) -> f64 {
    let half = step / 2;
    let corners =
        [(i - half, j - half), (i + half, j - half), (i - half, j + half), (i + half, j + half)]
            .map(|place| &known[&place]);
    let each = known[&(i, j)].iter().enumerate().map(|(w, middle)| {
        let mean = |s| 0.25 * corners.iter().map(|corner| corner[w].psf[s]).sum::<f32>();
        let blend: Vec<f32> = (0..middle.psf.len()).map(mean).collect();
        error(&blend, &middle.psf)
    });
    each.fold(0.0, f64::max)
}

#[cfg(test)]
#[path = "characterise_tests.rs"]
mod tests;
