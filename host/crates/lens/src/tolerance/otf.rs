//! The optical transfer function of a lens without symmetry, from pairs of rays.
//!
//! The OTF at frequency ν is the pupil function's correlation with itself displaced by λν in
//! direction cosines (Goodman, Introduction to Fourier Optics, 2005, ch. 6). Rays are traced on a
//! grid of the pupil whose step moves the direction at the image by λ·Δν (Hopkins's method of ray
//! pairs), so that nodes m steps apart give the OTF at m·Δν. A pair whose directions are not quite
//! λν apart is corrected to second order: the phase of a plane wave of direction d at a point
//! changes by −x·Δd/λ, x being where its ray lands.

use super::displaced::{Displacement, displaced};
use crate::pupil::{Beam, Bundle};
use crate::system::System;
use crate::trace::{LANES, Rays, TrainSurface, trace_lanes};
use crate::train::Train;
use camrig_base::{Error, Result};
use std::f64::consts::TAU;

/// Azimuths over half of the undisplaced pupil's outline: its extent is wanted, no more.
const AZIMUTHS: usize = 16;
/// Part of the pupil's half width by which the grid reaches beyond it, for displaced pupils.
const MARGIN: f64 = 0.12;
/// Part of the pupil's half width over which the directions at the image are differenced.
const SLOPE: f64 = 0.05;

/// A lens, its surfaces displaced, seen from one field point: the waves at all wavelengths.
pub(super) struct Waves {
    /// With the share of each.
    waves: Vec<(Wave, f64)>,
    step_per_mm: f64,
}

/// Which way the light and dark bars follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Azimuth {
    /// Along y, radially.
    Tangential,
    /// Along x.
    Sagittal,
}

/// The pupil at one wavelength on its grid.
struct Wave {
    columns: usize,
    rows: usize,
    nodes: Vec<Node>,
    /// Sum of the nodes' power.
    power: f64,
    /// λ·Δν, the step of direction cosines L and M; negative where they fall with the launch place.
    step: [f64; 2],
    waves_per_mm: f64,
}

#[derive(Clone, Copy)]
struct Node {
    direction: [f64; 2],
    landing: [f64; 2],
    phase: f64,
    /// Share of the node's cell that light passes.
    share: f64,
    amplitude: f64,
}

/// Largest frequency at which the axis has any contrast, at the reference wavelength, cycles/mm.
pub(super) fn cut_off_per_mm(system: &System) -> Result<f64> {
    let nm = system.prescription.reference_nm;
    let train = system.at(nm)?;
    let beam = Beam::aim(&train, 0.0)?;
    let outline = beam.outline(AZIMUTHS)?;
    let rim = outline.edges.iter().flatten().map(|e| e[1].direction[1].abs()).fold(0.0, f64::max);
    Ok(2.0 * rim * waves_per_mm(&train))
}

fn waves_per_mm(train: &Train) -> f64 {
    1e6 * train.surfaces.last().map_or(1.0, |s| s.after) / train.nm
}

impl Waves {
    /// Traces a field point at all design wavelengths; `step_per_mm` is the distance of
    /// frequencies.
    pub fn trace(
        system: &System,
        displacements: &[Displacement],
        field_deg: f64,
        step_per_mm: f64,
    ) -> Result<Self> {
        // All waves are referred to one image point, so that lateral colour counts.
        let reference = system.at(system.prescription.reference_nm)?;
        let chief = Beam::aim(&reference, field_deg)?;
        let mut ray = Rays::<LANES>::nowhere();
        ray.launch(0, &chief.start([0.0; 2]));
        trace_lanes(&displaced(&reference.surfaces, displacements), &mut ray);
        let point = [ray.position[0][0], ray.position[1][0]];
        let wave = |(nm, share): (f64, f64)| {
            let train = system.at(nm)?;
            let beam = Beam::aim(&train, field_deg)?;
            let surfaces = displaced(&train.surfaces, displacements);
            let wave = Wave::trace(&beam, &surfaces, point, step_per_mm)
                .map_err(|e| e.at(format!("field {field_deg:.4}°, {nm} nm")))?;
            Ok((wave, share))
        };
        let waves: Result<Vec<(Wave, f64)>> =
            system.prescription.shares().into_iter().map(wave).collect();
        Ok(Self { waves: waves?, step_per_mm })
    }

    /// The MTF m steps of frequency up, in the weighted mean over the wavelengths.
    pub fn mtf(&self, azimuth: Azimuth, m: usize) -> f64 {
        let sum = self.waves.iter().fold([0.0; 2], |sum, (wave, share)| {
            let otf = wave.otf(azimuth, m);
            [sum[0] + share * otf[0], sum[1] + share * otf[1]]
        });
        (sum[0] * sum[0] + sum[1] * sum[1]).sqrt()
    }

    /// The frequency at which the MTF first falls to 1/2, cycles/mm.
    pub fn mtf50(&self, azimuth: Azimuth) -> f64 {
        let mut before = 1.0;
        let last = self.waves.iter().map(|(w, _)| w.columns.max(w.rows)).max().unwrap_or(0);
        for m in 1..=last {
            let here = self.mtf(azimuth, m);
            if here <= 0.5 {
                let steps = match m {
                    // From 1 at frequency 0 a curve falls like a Gaussian.
                    1 => (std::f64::consts::LN_2 / -libm::log(here)).sqrt(),
                    _ => (m - 1) as f64 + (before - 0.5) / (before - here),
                };
                return steps * self.step_per_mm;
            }
            before = here;
        }
        last as f64 * self.step_per_mm
    }
}

impl Wave {
    fn trace(
        beam: &Beam,
        surfaces: &[TrainSurface],
        point: [f64; 2],
        step_per_mm: f64,
    ) -> Result<Self> {
        let train = beam.train;
        let waves_per_mm = waves_per_mm(train);
        let step = step_per_mm / waves_per_mm;
        let ([low, high], widest) = beam.outline(AZIMUTHS)?.bounds();
        let reach = [widest, 0.5 * (high - low)];
        let slopes = slopes(beam, surfaces, reach);
        let cell = slopes.map(|slope| (step / slope).abs());
        let step = slopes.map(|slope| step.copysign(slope));
        let margin = reach.map(|r| r * (1.0 + MARGIN));
        let columns = 2 * (margin[0] / cell[0]).ceil() as usize + 1;
        let rows = 2 * (margin[1] / cell[1]).ceil() as usize + 1;
        if !(cell[0] > 0.0 && cell[1] > 0.0) || columns * rows > 1 << 20 {
            return Err(Error::unsupported("the pupil cannot be sampled")
                .help("the lens is too strongly aberrated for its MTF to be computed"));
        }
        let middle = 0.5 * (low + high);
        let place = |k: usize| {
            let at = |i: usize, count: usize, cell: f64| (i as f64 - (count / 2) as f64) * cell;
            [at(k % columns, columns, cell[0]), middle + at(k / columns, rows, cell[1])]
        };
        let (mut nodes, mut excess) = (Vec::new(), Vec::new());
        for block in (0..columns * rows).step_by(LANES) {
            let mut rays = Rays::<LANES>::nowhere();
            for i in 0..LANES {
                rays.launch(i, &beam.start(place(block + i)));
            }
            trace_lanes(surfaces, &mut rays);
            for i in (0..LANES).filter(|i| block + i < columns * rows) {
                let (p, d) = rays.get(i);
                let landing = [p[0] - point[0], p[1] - point[1]];
                let last = train.surfaces.last().map_or(1.0, |s| s.after);
                let advance = last * (d[0] * landing[0] + d[1] * landing[1]);
                nodes.push(Node {
                    direction: [d[0], d[1]],
                    landing,
                    phase: (rays.path[i] - beam.chief.path[0] - advance) * 1e6 / train.nm,
                    share: 0.0,
                    amplitude: beam.power(place(block + i)).sqrt(),
                });
                excess.push(if rays.alive(i) { rays.excess[i] } else { f64::NAN });
            }
        }
        let on_rim = |k: usize| {
            let (column, row) = (k % columns, k / columns);
            column == 0 || row == 0 || column + 1 == columns || row + 1 == rows
        };
        if (0..columns * rows).any(|k| on_rim(k) && excess[k] <= 0.0) {
            return Err(Error::unsupported(format!(
                "the pupil moves by more than {} % of its half width",
                100.0 * MARGIN
            ))
            .help("give smaller tolerances of decentre and tilt"));
        }
        let mut wave = Self { columns, rows, nodes, power: 0.0, step, waves_per_mm };
        wave.share_cells(&excess);
        match wave.power > 0.0 {
            true => Ok(wave),
            false => Err(Error::input("no light gets through the apertures")
                .help("give smaller fields or tolerances, or check the apertures")),
        }
    }

    /// The share of each cell inside the apertures: the excess crosses 0 in a straight line.
    fn share_cells(&mut self, excess: &[f64]) {
        for row in 1..self.rows - 1 {
            for column in 1..self.columns - 1 {
                let k = row * self.columns + column;
                let change = |step: usize| {
                    let change = 0.5 * (excess[k + step] - excess[k - step]).abs();
                    if change.is_nan() { 0.0 } else { change }
                };
                let width = (change(1) + change(self.columns)).max(f64::MIN_POSITIVE);
                let node = &mut self.nodes[k];
                let share = (0.5 - excess[k] / width).clamp(0.0, 1.0);
                node.share = if share.is_nan() { 0.0 } else { share };
                self.power += node.share * node.amplitude * node.amplitude;
            }
        }
    }

    /// The OTF m steps of frequency up.
    fn otf(&self, azimuth: Azimuth, m: usize) -> [f64; 2] {
        let (right, up) = match azimuth {
            Azimuth::Sagittal => (m, 0),
            Azimuth::Tangential => (0, m),
        };
        let apart = [right as f64 * self.step[0], up as f64 * self.step[1]];
        let mut sum = [0.0; 2];
        for row in 0..self.rows.saturating_sub(up) {
            for column in 0..self.columns.saturating_sub(right) {
                let a = &self.nodes[row * self.columns + column];
                let b = &self.nodes[(row + up) * self.columns + column + right];
                let share = a.share.min(b.share);
                if share <= 0.0 {
                    continue;
                }
                let lacking = |k: usize| apart[k] - (b.direction[k] - a.direction[k]);
                let landing = |k: usize| 0.5 * (a.landing[k] + b.landing[k]);
                let way = landing(0) * lacking(0) + landing(1) * lacking(1);
                let phase = b.phase - a.phase - way * self.waves_per_mm;
                let (s, c) = libm::sincos(TAU * phase.fract());
                let weight = share * a.amplitude * b.amplitude;
                sum[0] += weight * c;
                sum[1] += weight * s;
            }
        }
        sum.map(|v| v / self.power)
    }
}

/// How far the direction at the image moves per mm of the launch place, along x and y.
fn slopes(beam: &Beam, surfaces: &[TrainSurface], reach: [f64; 2]) -> [f64; 2] {
    let away = reach.map(|r| SLOPE * r);
    let mut rays = Rays::<LANES>::nowhere();
    let places = [[away[0], 0.0], [-away[0], 0.0], [0.0, away[1]], [0.0, -away[1]]];
    for (i, place) in places.into_iter().enumerate() {
        rays.launch(i, &beam.start(place));
    }
    trace_lanes(surfaces, &mut rays);
    [0, 1].map(|axis| {
        let d = &rays.direction[axis];
        let (plus, minus) = (d[2 * axis], d[2 * axis + 1]);
        (plus - minus) / (2.0 * away[axis])
    })
}
