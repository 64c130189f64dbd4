//! The place of the sensor at which the MTF on the axis is largest.
//!
//! On the axis a lens is rotationally symmetric: its pupil function is a(r)·exp(2πi φ(r)), r the
//! sine of the angle at the image. The OTF at frequency ν is the pupil function's correlation with
//! itself displaced by λν (Goodman, Introduction to Fourier Optics, 2005, ch. 6). A plane wave of
//! direction cosine N = √(1 − r²) gains the phase n·s·N/λ where the sensor moves by s, so that one
//! trace gives the OTF at every place of the sensor.

use super::pupil::{Beam, Bundle};
use super::system::System;
use super::trace::LANES;
use camrig_base::{Error, Result};
use std::f64::consts::TAU;

/// Rays from the axis to the rim: between two of them the phase of a wavefront of 100 waves bends
/// by 1e-4 waves.
const RAYS: usize = 1024;
/// Azimuths in which the rim is looked for: the nearest to y misses it by 1e-5 of its radius.
const AZIMUTHS: usize = 256;
/// Samples of the displaced pupil over its radius: the rim makes the sum over its overlap err by
/// some 1e-3.
const SAMPLES: usize = 64;
/// Places of the sensor per cycle of the fastest phase in the sum.
const PLACES_PER_CYCLE: f64 = 16.0;
/// Most places that are tried; a longer range is searched more coarsely.
const MAX_PLACES: usize = 4000;
/// Depths of focus λ/r² beyond the crossings of the rays within which the best place is looked
/// for.
const DEPTHS: f64 = 2.0;
/// Steps of the golden section from two places to one: 0.618^40 is 4e-9 of their distance.
const SECTIONS: usize = 40;

/// The best place of the sensor.
pub(super) struct Best {
    /// Its z from the present one, mm.
    pub shift_mm: f64,
    /// The OTF there, in the weighted mean over the design wavelengths.
    pub mtf: f64,
}

/// Finds the place of the sensor with the largest OTF on the axis at `per_mm` cycles per mm, in
/// the weighted mean over the design wavelengths.
///
/// # Errors
/// A frequency that is not positive or beyond the cut-off; rays that are lost; rays from different
/// zones of the pupil in one direction.
pub(super) fn find(system: &System, per_mm: f64) -> Result<Best> {
    if !(per_mm.is_finite() && per_mm > 0.0) {
        return Err(Error::input(format!("frequency {per_mm} cycles/mm"))
            .help("give the frequency at which the MTF is to be largest, above 0"));
    }
    let waves: Result<Vec<(Wave, f64)>> = system
        .prescription
        .shares()
        .into_iter()
        .map(|(nm, share)| {
            let wave = Wave::new(system, nm, per_mm).map_err(|e| e.at(format!("{nm} nm")))?;
            Ok((wave, share))
        })
        .collect();
    let waves = waves?;
    let mtf = |shift: f64| waves.iter().map(|(w, share)| share * w.otf(shift)).sum::<f64>();
    let low = waves.iter().map(|(w, _)| w.crossings[0]).fold(f64::INFINITY, f64::min);
    let high = waves.iter().map(|(w, _)| w.crossings[1]).fold(f64::NEG_INFINITY, f64::max);
    let fastest = waves.iter().map(|(w, _)| w.fastest_per_mm).fold(0.0, f64::max);
    let places = ((high - low) * fastest * PLACES_PER_CYCLE).ceil() as usize;
    let places = places.clamp(2, MAX_PLACES);
    let step = (high - low) / places as f64;
    let place = |i: usize| low + step * i as f64;
    let best = (0..=places).map(|i| (mtf(place(i)), i)).max_by(|a, b| a.0.total_cmp(&b.0));
    let middle = place(best.map_or(0, |b| b.1));
    // Golden section: the larger half keeps the larger of its two inner places.
    let part = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut a, mut b) = (middle - step, middle + step);
    for _ in 0..SECTIONS {
        let (c, d) = (b - part * (b - a), a + part * (b - a));
        if mtf(c) < mtf(d) { a = c } else { b = d }
    }
    let shift_mm = 0.5 * (a + b);
    Ok(Best { shift_mm, mtf: mtf(shift_mm) })
}

/// A pair of places of the displaced pupil.
struct Pair {
    /// Product of the amplitudes over the whole pupil's power.
    weight: f64,
    /// Difference of the phases at the paraxial focus, waves.
    phase: f64,
    /// Difference of phases per mm of the sensor's way, waves.
    per_mm: f64,
}

/// The pupil at one wavelength, correlated with itself.
struct Wave {
    pairs: Vec<Pair>,
    /// z of the paraxial focus from the sensor, mm.
    focus_mm: f64,
    /// Within which the best place lies, mm from the sensor.
    crossings: [f64; 2],
    fastest_per_mm: f64,
}

impl Wave {
    fn new(system: &System, nm: f64, per_mm: f64) -> Result<Self> {
        let train = system.at(nm)?;
        let last = train.surfaces.last().map_or((0.0, 1.0), |s| (s.prescribed.thickness, s.after));
        let focus_mm = train.paraxial.image_distance_mm - last.0;
        let beam = Beam::aim(&train, 0.0)?;
        beam.check_rim()?;
        let waves_per_mm = 1e6 * last.1 / nm;
        let pupil = Pupil::trace(&beam, focus_mm * waves_per_mm)?;
        let displaced = per_mm / waves_per_mm;
        let rim = pupil.r.last().copied().unwrap_or(0.0);
        if displaced >= 2.0 * rim {
            let cut_off = 2.0 * rim * waves_per_mm;
            return Err(Error::input(format!("the MTF at {per_mm} cycles/mm is 0")).help(
                format!("give a frequency well below the cut-off, {cut_off:.4} cycles/mm"),
            ));
        }
        // Behind an odd number of mirrors light travels towards −z.
        let forwards = beam.chief.direction[2][0].signum();
        let pairs = pupil.pairs(displaced, forwards * waves_per_mm);
        let depth = DEPTHS * nm * 1e-6 / (rim * rim);
        let [near, far] = pupil.crossings;
        Ok(Self {
            fastest_per_mm: pairs.iter().map(|p| p.per_mm.abs()).fold(0.0, f64::max),
            crossings: [near.min(focus_mm) - depth, far.max(focus_mm) + depth],
            focus_mm,
            pairs,
        })
    }

    /// The OTF where the sensor is moved by `shift` mm.
    fn otf(&self, shift: f64) -> f64 {
        let way = shift - self.focus_mm;
        self.pairs.iter().map(|p| p.weight * libm::cos(TAU * (p.phase + p.per_mm * way))).sum()
    }
}

/// The pupil along a radius.
struct Pupil {
    /// Sine of the angle at the image, rising.
    r: Vec<f64>,
    amplitude: Vec<f64>,
    /// Phase at the paraxial focus relative to the chief ray, waves.
    phase: Vec<f64>,
    /// z, from the sensor, between which the rays cross the axis.
    crossings: [f64; 2],
}

impl Pupil {
    /// `focus_waves`: the way from the sensor to the paraxial focus, in waves.
    fn trace(beam: &Beam<'_>, focus_waves: f64) -> Result<Self> {
        let ([_, rim], _) = beam.outline(AZIMUTHS)?.bounds();
        let step = rim / RAYS as f64;
        let chief = beam.chief.direction[2][0];
        let mut pupil = Self {
            r: Vec::with_capacity(RAYS),
            amplitude: Vec::with_capacity(RAYS),
            phase: Vec::with_capacity(RAYS),
            crossings: [f64::INFINITY, f64::NEG_INFINITY],
        };
        let mut power = Vec::with_capacity(RAYS);
        for block in (0..RAYS).step_by(LANES) {
            let places: [[f64; 2]; LANES] =
                std::array::from_fn(|i| [0.0, (block + i) as f64 * step + 0.5 * step]);
            let rays = beam.trace(&places);
            for (i, place) in places.iter().enumerate() {
                if !rays.alive(i) {
                    return Err(Error::input("a ray inside the pupil is lost")
                        .help("check the surfaces, or give a smaller stop"));
                }
                let (p, d) = rays.get(i);
                let phase = beam.plane_wave_phase(&rays, i);
                pupil.r.push(d[1].abs());
                pupil.phase.push(phase + focus_waves * (d[2] - chief));
                let passes = rays.excess[i] <= 0.0;
                power.push(if passes { beam.power(*place) * place[1] } else { 0.0 });
                // Next to the axis the crossing is 0/0; these rays cross at the paraxial focus.
                if passes && block + i > RAYS / 8 {
                    let z = -p[1] * d[2] / d[1];
                    pupil.crossings = [pupil.crossings[0].min(z), pupil.crossings[1].max(z)];
                }
            }
        }
        if pupil.r.windows(2).any(|r| r[1] <= r[0]) {
            return Err(Error::unsupported(
                "rays from several zones of the pupil leave in one direction",
            )
            .help("such a lens is too strongly aberrated; move the sensor by a given distance"));
        }
        // dE = power·p dp = amplitude²·r dr.
        let slope = |i: usize| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(RAYS - 1));
            (b - a) as f64 * step / (pupil.r[b] - pupil.r[a])
        };
        pupil.amplitude =
            (0..RAYS).map(|i| (power[i] * slope(i) / pupil.r[i]).max(0.0).sqrt()).collect();
        Ok(pupil)
    }

    /// Amplitude and phase at r, by straight lines; `None` outside the pupil.
    fn at(&self, r: f64) -> Option<(f64, f64)> {
        let rim = self.r.len() - 1;
        if r > self.r[rim] {
            return None;
        }
        let i = self.r.partition_point(|v| *v <= r).clamp(1, rim);
        let part = (r - self.r[i - 1]) / (self.r[i] - self.r[i - 1]);
        let between = |v: &[f64]| v[i - 1] + part.max(0.0) * (v[i] - v[i - 1]);
        Some((between(&self.amplitude), between(&self.phase)))
    }

    /// The pupil and itself, displaced along M, on a grid over a quarter of their overlap; the
    /// others are mirror images.
    fn pairs(&self, displaced: f64, waves_per_mm: f64) -> Vec<Pair> {
        let rim = self.r[self.r.len() - 1];
        let cell = rim / SAMPLES as f64;
        let (mut pairs, mut power) = (Vec::new(), 0.0);
        for row in 0..SAMPLES {
            for column in 0..SAMPLES {
                let [l, m] = [column, row].map(|i| (i as f64 + 0.5) * cell);
                let radius = |m: f64| (l * l + m * m).sqrt();
                power += self.at(radius(m)).map_or(0.0, |(a, _)| a * a);
                let (upper, lower) = (radius(m + 0.5 * displaced), radius(m - 0.5 * displaced));
                let (Some(a), Some(b)) = (self.at(upper), self.at(lower)) else { continue };
                let along = |r: f64| (1.0 - r * r).max(0.0).sqrt();
                pairs.push(Pair {
                    weight: a.0 * b.0,
                    phase: a.1 - b.1,
                    per_mm: waves_per_mm * (along(upper) - along(lower)),
                });
            }
        }
        pairs.iter_mut().for_each(|p| p.weight /= power);
        pairs
    }
}
