//! Several exposures of a static view to one linear radiance frame, per raw pixel.
//!
//! With the linearised signal x_j of exposure j (time t_j, n_j frames averaged) and its variance
//! v_j = (read² + K E t_j) / n_j, the estimate of E in DN/s is the weighted mean E = Σ x_j t_j /
//! v_j / Σ t_j² / v_j with standard deviation (Σ t_j² / v_j)^-½ over the exposures that are not
//! saturated. The weights take E from a first pass with v ∝ t (the optimum of pure shot noise),
//! not from the noisy x_j, which would pull the mean down. K (DN² per DN) and read² are measured
//! on the exposures themselves (`Noise::measure`).
//!
//! What an exposure as a whole departs by from the merged frame (a black that is off, a shutter
//! that is not exact) is found first, see `movement`. A pixel whose neighbourhood (9 x 9)
//! disagrees by more than that, its noise and 5 % shows something that moved: it is taken from one
//! exposure instead, the reference, or the longest shorter one where that is saturated.

mod movement;
mod noise;

use super::align;
use super::exposures::{Exposure, Series};
use super::response::{Response, SATURATION};
use camrig_base::Cfa;
use camrig_base::{Error, Plane, Result};
use movement::Still;
use noise::Seen;
use rayon::prelude::*;
use std::borrow::Cow;

pub use noise::Noise;

/// What became of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[non_exhaustive]
pub enum Flag {
    /// Merged from all exposures that are not saturated.
    Merged = 0,
    /// Something moved: from one exposure.
    Moved = 1,
    /// Saturated in every exposure: the radiance is a lower bound.
    Saturated = 2,
}

/// A merged frame.
#[derive(Clone, Debug)]
pub struct Merged {
    /// Linear signal per time, DN/s.
    pub radiance: Plane<f32>,
    /// Its standard deviation, DN/s; infinite where saturated.
    pub sigma: Plane<f32>,
    /// [`Flag`] per pixel.
    pub flags: Plane<u8>,
    /// The noise that weights and flags rest on.
    pub noise: Noise,
    /// Shift of each exposure that was corrected, pixels.
    pub shifts: Vec<[isize; 2]>,
    /// 20 log10 of the largest signal over the noise floor.
    pub dynamic_range_db: f64,
}

/// Least signal that is compared to find shifts, of full scale: above noise.
const DETAIL: f32 = 0.02;

/// Rows that one task merges, with [`movement::AROUND`] more on either side for what moved: enough
/// that these are few.
const STRIP_ROWS: usize = 64;

/// Merges a series. `full_scale_dn` is the saturation level above black, `responses` the curves of
/// the channels where the camera is not linear.
///
/// Every strip of rows is read once and written once: merged, searched for what moved, flagged.
pub fn merge(
    series: &Series,
    cfa: &Cfa,
    full_scale_dn: f64,
    responses: &[Response],
) -> Result<Merged> {
    let limit = (SATURATION * full_scale_dn) as f32;
    check_sizes(&series.exposures)?;
    let mut shots = Shots::linear(series, limit, cfa, responses);
    let shifts = align_all(&mut shots, cfa, DETAIL * limit)?;
    let noise = Noise::measure(&shots, limit)?;
    let still = Still::measure(&shots, cfa, noise, limit)?;

    let (width, height) = shots.size();
    let brightest =
        shots.exposures.iter().map(|e| f64::from(limit) / e.seconds).fold(0.0, f64::max);
    let mut radiance = Plane::filled(width, height, 0.0f32);
    let mut sigma = Plane::filled(width, height, 0.0f32);
    let mut flags = Plane::filled(width, height, Flag::Merged as u8);
    let strip = STRIP_ROWS * width;
    let strips = radiance.data.par_chunks_mut(strip).zip(sigma.data.par_chunks_mut(strip));
    strips.zip(flags.data.par_chunks_mut(strip)).enumerate().for_each_init(
        || still.around(width, height),
        |around, (strip, ((radiance, sigma), flags))| {
            let first = strip * STRIP_ROWS;
            let count = flags.len() / width;
            let (mut other_radiance, mut other_sigma) = (vec![0.0; width], vec![0.0; width]);
            let mut next = first;
            for y in around.rows(first, count) {
                let seen = shots.row(y);
                let (value, deviation) = if (first..first + count).contains(&y) {
                    let row = (y - first) * width..(y - first + 1) * width;
                    (&mut radiance[row.clone()], &mut sigma[row])
                } else {
                    (&mut other_radiance[..], &mut other_sigma[..])
                };
                noise.merge(&seen, value, deviation);
                around.add(y, &seen, value);
                while next < first + count && around.knows(next, y) {
                    let row = (next - first) * width..(next - first + 1) * width;
                    around.find_moved(next, &mut flags[row.clone()]);
                    mark_saturated(
                        &mut radiance[row.clone()],
                        &sigma[row.clone()],
                        &mut flags[row],
                        brightest as f32,
                    );
                    next += 1;
                }
            }
        },
    );
    if flags.data.par_iter().any(|&f| f == Flag::Moved as u8) {
        take_one(&shots, noise, &mut radiance, &mut sigma, &flags);
    }
    let mut floor = [0.0];
    let black: Vec<Seen<'_>> = shots.exposures.iter().map(|e| shots.pixels(e, &[0.0])).collect();
    noise.merge(&black, &mut [0.0], &mut floor);
    let dynamic_range_db = 20.0 * libm::log10(brightest / f64::from(floor[0]));
    Ok(Merged { radiance, sigma, flags, noise, shifts, dynamic_range_db })
}

/// Pixels that no exposure measures: at least as bright as `brightest`.
fn mark_saturated(radiance: &mut [f32], sigma: &[f32], flags: &mut [u8], brightest: f32) {
    for ((value, sigma), flag) in radiance.iter_mut().zip(sigma).zip(flags) {
        if sigma.is_infinite() {
            (*value, *flag) = (brightest, Flag::Saturated as u8);
        }
    }
}

/// Takes what moved from one exposure: the reference, or the longest shorter one where that is
/// saturated.
fn take_one(
    shots: &Shots<'_>,
    noise: Noise,
    radiance: &mut Plane<f32>,
    sigma: &mut Plane<f32>,
    flags: &Plane<u8>,
) {
    let width = flags.width;
    let exposures = &shots.exposures[..=shots.reference()];
    let lines = radiance.data.par_chunks_mut(width).zip(sigma.data.par_chunks_mut(width));
    lines.zip(flags.data.par_chunks(width)).enumerate().for_each(
        |(y, ((radiance, sigma), flags))| {
            for x in (0..width).filter(|&x| flags[x] == Flag::Moved as u8) {
                let usable = |e: &&Cow<'_, Exposure>| e.signal.at(x, y) <= shots.top;
                if let Some(single) = exposures.iter().rev().find(usable) {
                    let alone = shots.pixels(single, &single.signal.row(y)[x..=x]);
                    noise.merge(&[alone], &mut radiance[x..=x], &mut sigma[x..=x]);
                }
            }
        },
    );
}

/// The exposures of a series on the scale of a linear camera; those that are so already are not
/// copied.
struct Shots<'a> {
    exposures: Vec<Cow<'a, Exposure>>,
    /// Signals above are saturated.
    top: f32,
}

impl<'a> Shots<'a> {
    /// Saturation is a matter of DN, so before anything else: at `limit`.
    fn linear(series: &'a Series, limit: f32, cfa: &Cfa, responses: &[Response]) -> Self {
        if responses.is_empty() {
            return Self {
                exposures: series.exposures.iter().map(Cow::Borrowed).collect(),
                top: limit,
            };
        }
        let exposures = series.exposures.iter();
        let exposures = exposures.map(|e| Cow::Owned(linear(e, limit, cfa, responses)));
        Self { exposures: exposures.collect(), top: f32::MAX }
    }

    fn size(&self) -> (usize, usize) {
        (self.exposures[0].signal.width, self.exposures[0].signal.height)
    }

    /// Pixels of an exposure.
    fn pixels<'p>(&self, exposure: &Exposure, signals: &'p [f32]) -> Seen<'p> {
        let (seconds, frames) = (exposure.seconds as f32, exposure.frames as f32);
        Seen { seconds, frames, top: self.top, signals }
    }

    /// A row of each exposure.
    fn row(&self, y: usize) -> Vec<Seen<'_>> {
        self.exposures.iter().map(|e| self.pixels(e, e.signal.row(y))).collect()
    }

    /// The exposure that a moving thing is taken from: the longest with less than 1 % saturated,
    /// else the shortest.
    fn reference(&self) -> usize {
        let few = |e: &Cow<'_, Exposure>| {
            let saturated = e.signal.data.par_iter().filter(|v| **v > self.top).count();
            saturated * 100 < e.signal.data.len()
        };
        self.exposures.iter().rposition(few).unwrap_or(0)
    }
}

/// The exposure with saturated pixels infinite and the others on the scale of a linear camera.
fn linear(exposure: &Exposure, limit: f32, cfa: &Cfa, responses: &[Response]) -> Exposure {
    let width = exposure.signal.width;
    let mut data = vec![0.0; exposure.signal.data.len()];
    let rows = data.par_chunks_mut(width).zip(exposure.signal.data.par_chunks(width));
    rows.enumerate().for_each(|(y, (out, row))| {
        for (o, &v) in out.iter_mut().zip(row) {
            *o = if v > limit { f32::INFINITY } else { v };
        }
        for (x, value) in out.iter_mut().enumerate().filter(|(_, v)| v.is_finite()) {
            let letter = cfa.letter(x, y);
            if let Some(response) = responses.iter().find(|r| r.channel == letter) {
                *value = response.linear_dn(f64::from(*value)) as f32;
            }
        }
    });
    Exposure {
        id: exposure.id.clone(),
        signal: Plane { width, height: exposure.signal.height, data },
        ..*exposure
    }
}

fn check_sizes(exposures: &[Exposure]) -> Result<()> {
    let size = |e: &Exposure| (e.signal.width, e.signal.height);
    let first = size(&exposures[0]);
    if let Some(other) = exposures.iter().find(|e| size(e) != first) {
        return Err(Error::disagreement(format!(
            "capture {:?} is {:?} pixels, {:?} is {first:?}",
            other.id,
            size(other),
            exposures[0].id
        ))
        .help("all exposures of a view have one size"));
    }
    Ok(())
}

/// Moves exposures by whole cells of the pattern onto the middle one; refuses other shifts.
fn align_all(shots: &mut Shots<'_>, cfa: &Cfa, least_dn: f32) -> Result<Vec<[isize; 2]>> {
    let top = shots.top;
    let exposures = &mut shots.exposures;
    let cell = cfa.width.max(cfa.height);
    let middle = exposures.len() / 2;
    let mut shifts = vec![[0isize; 2]; exposures.len()];
    // Neighbours share most of their range, so shifts are chained outwards from the middle.
    let outwards = (0..middle).rev().map(|i| (i, i + 1));
    let pairs: Vec<(usize, usize)> =
        outwards.chain((middle + 1..exposures.len()).map(|i| (i, i - 1))).collect();
    for (index, next) in pairs {
        let rate = |e: &Exposure, i: usize| {
            let signal = e.signal.data[i];
            let usable = signal <= top && signal > least_dn;
            if usable { signal / e.seconds as f32 } else { f32::NAN }
        };
        let size = (exposures[index].signal.width, exposures[index].signal.height);
        let found = align::shift(
            size,
            [&|i| rate(&exposures[next], i), &|i| rate(&exposures[index], i)],
            cell,
        );
        let Some(found) = found else { continue };
        let cells = found.map(|d| (d / cell as f64).round() as isize);
        let rest = [0, 1].map(|i| found[i] - (cells[i] * cell as isize) as f64);
        // A quarter of a pixel is what noise and the parabola leave on a static view.
        if rest.iter().any(|r| r.abs() > 0.25 * cell as f64) {
            return Err(Error::input(format!(
                "capture {:?} is shifted by {:.1}, {:.1} pixels against {:?}",
                exposures[index].id, found[0], found[1], exposures[next].id
            ))
            .help(format!(
                "only shifts of whole {cell}-pixel cells of the pattern can be corrected; use a \
                 tripod,                  or leave the capture out"
            )));
        }
        let by = cells.map(|c| c * cell as isize);
        if by != [0, 0] {
            let signal = &exposures[index].signal;
            let clamp = |i: usize, d: isize, n: usize| {
                i.saturating_add_signed(d).min(n - 1 - (n - 1 - i) % cell)
            };
            let (width, height) = (signal.width, signal.height);
            let moved = Plane::from_fn(width, height, |x, y| {
                signal.at(clamp(x, by[0], width), clamp(y, by[1], height))
            });
            exposures[index].to_mut().signal = moved;
            shifts[index] = by;
        }
    }
    Ok(shifts)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Normal deviates from a counter (sum of 12 hashed uniforms).
    fn normal(key: u64) -> f64 {
        let uniform = |i: u64| {
            let mut z = (key * 12 + i).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..12).map(uniform).sum::<f64>() - 6.0
    }

    const FULL: f64 = 4095.0;
    const NOISE: Noise = Noise { gain_dn: 0.4, read_dn2: 4.0 };

    /// A view of `light` DN/s by a 12-bit camera; `view` says where a pixel looks in exposure j.
    fn series(
        times: &[f64],
        light: impl Fn(usize, usize) -> f64,
        view: impl Fn(usize, usize, usize) -> (usize, usize),
    ) -> Series {
        let exposures = times.iter().enumerate().map(|(j, &seconds)| {
            let signal = Plane::from_fn(120, 96, |x, y| {
                let (u, v) = view(j, x, y);
                let mean = light(u, v) * seconds;
                let deviation = (NOISE.read_dn2 + NOISE.gain_dn * mean).sqrt();
                let noise = normal(((j * 1000 + y) * 1000 + x) as u64);
                (mean + deviation * noise).round().min(FULL) as f32
            });
            Exposure { id: format!("e{j}"), seconds, frames: 1, signal }
        });
        Series { name: "test".into(), exposures: exposures.collect() }
    }

    /// Radiance over 100 dB in 40 x 24 patches.
    fn patches(x: usize, y: usize) -> f64 {
        let patch = (x / 10 + 12 * (y / 8)) as f64 / 143.0;
        20.0 * 1e5f64.powf(patch) * (1.0 + 0.2 * ((x * 7 + y * 3) % 5) as f64)
    }

    const TIMES: [f64; 7] = [0.001, 0.004, 0.015, 0.06, 0.25, 1.0, 4.0];

    #[test]
    fn radiance_is_recovered_over_100_db() {
        let series = series(&TIMES, patches, |_, x, y| (x, y));
        let mono = Cfa::parse("mono").unwrap();
        let merged = merge(&series, &mono, FULL, &[]).unwrap();
        assert!(merged.dynamic_range_db > 100.0, "{}", merged.dynamic_range_db);
        assert!((merged.noise.gain_dn / NOISE.gain_dn - 1.0).abs() < 0.15, "{:?}", merged.noise);
        assert!(merged.shifts.iter().all(|s| *s == [0, 0]), "{:?}", merged.shifts);
        let flagged = merged.flags.data.iter().filter(|&&f| f != Flag::Merged as u8).count();
        assert!(flagged == 0, "{flagged} flagged");
        // Patch by patch: mean ratio within 2 %, and the spread is what sigma predicts.
        let mut pull = 0.0;
        for row in 0..12 {
            for column in 0..12 {
                let (mut sum, mut count) = (0.0, 0.0);
                for y in row * 8..row * 8 + 8 {
                    for x in column * 10..column * 10 + 10 {
                        let ratio = f64::from(merged.radiance.at(x, y)) / patches(x, y);
                        sum += ratio;
                        count += 1.0;
                        let sigma = f64::from(merged.sigma.at(x, y)) / patches(x, y);
                        pull += ((ratio - 1.0) / sigma).powi(2);
                    }
                }
                let mean = sum / count;
                assert!((mean - 1.0).abs() < 0.02, "patch {row} {column}: {mean}");
            }
        }
        let pull = (pull / (120.0 * 96.0)).sqrt();
        assert!((0.8..1.2).contains(&pull), "{pull}");
    }

    #[test]
    fn shifts_of_cells_are_corrected_and_others_refused() {
        let bayer = Cfa::parse("RGGB").unwrap();
        // A texture that does not repeat within reach.
        let light = |x: usize, y: usize| {
            let (x, y) = (x as f64, y as f64);
            let waves = (0.31 * x + 0.05 * y).sin()
                + (0.27 * y - 0.08 * x).sin()
                + (0.11 * x + 0.13 * y).cos()
                + (0.004 * x * y).sin();
            400.0 * (2.0 + 0.3 * waves)
        };
        let times = [0.1, 0.4, 1.6];
        let shifted =
            |dx: usize| {
                series(&times, light, move |j, x, y| {
                    if j == 2 { (x + 20 + dx, y + 20) } else { (x + 20, y + 20) }
                })
            };
        let merged = merge(&shifted(4), &bayer, FULL, &[]).unwrap();
        assert_eq!(merged.shifts, [[0, 0], [0, 0], [-4, 0]]);
        let message = merge(&shifted(3), &bayer, FULL, &[]).err().unwrap().to_string();
        assert!(message.contains("\"e2\"") && message.contains("-3"), "{message}");
    }

    /// A black that is 2 DN off and a shutter that is 4 % off in one exposure are no movement.
    #[test]
    fn what_departs_as_a_whole_has_not_moved() {
        let mono = Cfa::parse("mono").unwrap();
        let mut series = series(&TIMES, patches, |_, x, y| (x, y));
        for v in &mut series.exposures[3].signal.data {
            *v = (*v * 1.04 + 2.0).min(FULL as f32);
        }
        let merged = merge(&series, &mono, FULL, &[]).unwrap();
        let flagged = merged.flags.data.iter().filter(|&&f| f != Flag::Merged as u8).count();
        assert!(flagged == 0, "{flagged} flagged");
    }

    /// 8 bits without noise to hide their steps, and a black that lies a step below 0: a dark spot
    /// is 0 where the line of the exposure says less, the same all over it.
    #[test]
    fn steps_of_dark_spots_have_not_moved() {
        let mono = Cfa::parse("mono").unwrap();
        // 48 spots from 0.2 to 9.6 DN/s on a brighter ground.
        let light = |x: usize, y: usize| {
            let spot = x / 15 + 8 * (y / 16) + 1;
            let inside = (2..13).contains(&(x % 15)) && (2..14).contains(&(y % 16));
            if inside { 0.2 * spot as f64 } else { 30.0 + 0.2 * x as f64 }
        };
        let exposures = [0.25, 0.5, 1.0, 2.0].iter().enumerate().map(|(j, &seconds)| {
            let signal = Plane::from_fn(120, 96, |x, y| {
                let mean = light(x, y) * seconds;
                let noise =
                    (0.01 + 0.02 * mean).sqrt() * normal(((j * 1000 + y) * 1000 + x) as u64);
                (mean + noise - 1.0).round().clamp(0.0, 255.0) as f32
            });
            Exposure { id: format!("e{j}"), seconds, frames: 1, signal }
        });
        let series = Series { name: "test".into(), exposures: exposures.collect() };
        let merged = merge(&series, &mono, 255.0, &[]).unwrap();
        let flagged = merged.flags.data.iter().filter(|&&f| f != Flag::Merged as u8).count();
        assert!(flagged == 0, "{flagged} flagged");
    }

    /// Whichever exposure's time is said to be twice what it was, that one is named.
    #[test]
    fn a_wrong_exposure_time_is_named() {
        let mono = Cfa::parse("mono").unwrap();
        for wrong in 0..TIMES.len() {
            let mut series = series(&TIMES, patches, |_, x, y| (x, y));
            series.exposures[wrong].seconds *= 2.0;
            let message = merge(&series, &mono, FULL, &[]).err().unwrap().to_string();
            assert!(message.contains(&format!("\"e{wrong}\"")), "{wrong}: {message}");
        }
    }

    #[test]
    fn what_moves_is_taken_from_one_exposure() {
        let mono = Cfa::parse("mono").unwrap();
        let light = |x: usize, y: usize| {
            if (40..60).contains(&x) && (40..60).contains(&y) { 900.0 } else { 200.0 }
        };
        // The bright square is elsewhere in the last exposure; the rest stands still.
        let series = series(&[0.25, 1.0, 4.0], light, |j, x, y| {
            let there = (70..90).contains(&x) && (40..60).contains(&y);
            match j {
                2 if there => (x - 30, y),
                2 if (40..60).contains(&x) && (40..60).contains(&y) => (0, 0),
                _ => (x, y),
            }
        });
        let merged = merge(&series, &mono, FULL, &[]).unwrap();
        for (x, y, expected, flag) in [
            (50, 50, 900.0, Flag::Moved),
            (80, 50, 900.0, Flag::Moved),
            (20, 20, 200.0, Flag::Merged),
        ] {
            assert_eq!(merged.flags.at(x, y), flag as u8, "{x}, {y}");
            // At (80, 50) the reference exposure, the longest, sees the square.
            let got = merged.radiance.at(x, y);
            let single = flag == Flag::Moved && x == 50;
            let expected = if single { 200.0 } else { expected };
            assert!((got / expected - 1.0).abs() < 0.1, "{x}, {y}: {got}");
        }
    }
}
