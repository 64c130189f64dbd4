//! Several exposures of a static view to one linear radiance frame, per raw pixel.
//!
//! With the linearised signal x_j of exposure j (time t_j, n_j frames averaged) and its variance
//! v_j = (read² + K E t_j) / n_j, the estimate of E in DN/s is the weighted mean
//! E = Σ x_j t_j / v_j / Σ t_j² / v_j with standard deviation (Σ t_j² / v_j)^-½ over the exposures that
//! are not saturated. The weights take E from a first pass with v ∝ t (the optimum of pure shot
//! noise), not from the noisy x_j, which would pull the mean down. K (DN² per DN) and read² are
//! measured on the exposures themselves ([`Noise::measure`]).
//!
//! What an exposure as a whole departs by from the merged frame (a black that is off, a shutter that is
//! not exact) is found first, [`Departure`]. A pixel whose neighbourhood (9 x 9) disagrees by more than
//! that, its noise and 5 % shows something that moved: it is taken from one exposure instead, the
//! reference, or the longest shorter one where that is saturated.

use super::align;
use super::exposures::{Exposure, Series};
use super::response::{Response, SATURATION};
use crate::camera::Cfa;
use crate::{Error, Plane, Result};
use rayon::prelude::*;

/// Variance of a pixel of one frame: read² + K · signal, DN.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Noise {
    /// Variance per signal, DN (the system gain, DN per electron).
    pub gain_dn: f64,
    /// Variance without light, DN².
    pub read_dn2: f64,
}

/// What became of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
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

/// A systematic difference between exposures that is no movement, relative: real shutters, lamps and
/// clipped blacks leave 1.5 to 5 %.
const ALLOWANCE: f64 = 0.05;
/// Least signal that is compared to find shifts, of full scale: above noise.
const DETAIL: f32 = 0.02;
/// Half of the neighbourhood's edge.
const AROUND: usize = 4;

/// Merges a series. `full_scale_dn` is the saturation level above black, `responses` the curves of the
/// channels where the camera is not linear.
pub fn merge(
    series: &Series,
    cfa: &Cfa,
    full_scale_dn: f64,
    responses: &[Response],
) -> Result<Merged> {
    let limit = (SATURATION * full_scale_dn) as f32;
    let mut exposures = series.exposures.clone();
    check_sizes(&exposures)?;
    // Saturation is a matter of DN: it is marked before anything is linearised or shifted.
    for exposure in &mut exposures {
        exposure.signal.data.iter_mut().filter(|v| **v > limit).for_each(|v| *v = f32::INFINITY);
        linearise(&mut exposure.signal, cfa, responses);
    }
    let shifts = align_all(&mut exposures, cfa, DETAIL * limit)?;
    let noise = Noise::measure(&exposures, limit)?;
    let (width, height) = (exposures[0].signal.width, exposures[0].signal.height);

    let mut radiance = Plane::filled(width, height, 0.0f32);
    let mut sigma = Plane::filled(width, height, 0.0f32);
    let lines = radiance.data.par_chunks_mut(width).zip(sigma.data.par_chunks_mut(width));
    lines.enumerate().for_each(|(y, (radiance, sigma))| {
        for x in 0..width {
            let estimate = noise.estimate(&exposures, |e| f64::from(e.signal.at(x, y)));
            (radiance[x], sigma[x]) = (estimate.value as f32, estimate.sigma as f32);
        }
    });
    let departures: Vec<Vec<Departure>> =
        exposures.par_iter().map(|e| Departure::of(e, &radiance, cfa)).collect();
    let cell: Vec<usize> =
        (0..cfa.width * cfa.height).map(|i| cfa.channel(i % cfa.width, i / cfa.width)).collect();
    let mut disagreement = Plane::filled(width, height, [0.0f32; 2]);
    disagreement.data.par_chunks_mut(width).enumerate().for_each(|(y, line)| {
        for (x, sum) in line.iter_mut().enumerate() {
            let channel = cell[y % cfa.height * cfa.width + x % cfa.width];
            let light = f64::from(radiance.at(x, y));
            for (e, departures) in exposures.iter().zip(&departures) {
                let signal = f64::from(e.signal.at(x, y));
                if signal.is_finite() {
                    let expected = light * e.seconds;
                    let rest = signal - departures[channel].seen(expected);
                    let variance =
                        noise.variance(expected, e.frames) + (ALLOWANCE * expected).powi(2);
                    sum[0] += (rest * rest / variance) as f32;
                    sum[1] += 1.0;
                }
            }
            sum[1] = (sum[1] - 1.0).max(0.0);
        }
    });

    let moved = moved(&disagreement);
    let reference = reference(&exposures);
    let mut flags = Plane::filled(width, height, Flag::Merged as u8);
    let brightest = exposures.iter().map(|e| f64::from(limit) / e.seconds).fold(0.0, f64::max);
    for i in 0..width * height {
        if sigma.data[i].is_infinite() {
            flags.data[i] = Flag::Saturated as u8;
            radiance.data[i] = brightest as f32;
        } else if moved[i] {
            flags.data[i] = Flag::Moved as u8;
            let usable = |e: &&Exposure| e.signal.data[i].is_finite();
            if let Some(single) = exposures[..=reference].iter().rev().find(usable) {
                let alone =
                    noise.estimate(std::slice::from_ref(single), |e| f64::from(e.signal.data[i]));
                (radiance.data[i], sigma.data[i]) = (alone.value as f32, alone.sigma as f32);
            }
        }
    }
    let floor = noise.estimate(&exposures, |_| 0.0).sigma;
    let dynamic_range_db = 20.0 * libm::log10(brightest / floor);
    Ok(Merged { radiance, sigma, flags, noise, shifts, dynamic_range_db })
}

fn check_sizes(exposures: &[Exposure]) -> Result<()> {
    let size = |e: &Exposure| (e.signal.width, e.signal.height);
    let first = size(&exposures[0]);
    if let Some(other) = exposures.iter().find(|e| size(e) != first) {
        return Err(Error::input(format!(
            "capture {:?} is {:?} pixels, {:?} is {first:?}",
            other.id,
            size(other),
            exposures[0].id
        ))
        .help("all exposures of a view have one size"));
    }
    Ok(())
}

fn linearise(signal: &mut Plane<f32>, cfa: &Cfa, responses: &[Response]) {
    if responses.is_empty() {
        return;
    }
    let width = signal.width;
    signal.data.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, value) in row.iter_mut().enumerate().filter(|(_, v)| v.is_finite()) {
            let letter = cfa.letter(x, y);
            if let Some(response) = responses.iter().find(|r| r.channel == letter) {
                *value = response.linear_dn(f64::from(*value)) as f32;
            }
        }
    });
}

/// Moves exposures by whole cells of the pattern onto the middle one; refuses other shifts.
fn align_all(exposures: &mut [Exposure], cfa: &Cfa, least_dn: f32) -> Result<Vec<[isize; 2]>> {
    let cell = cfa.width.max(cfa.height);
    let middle = exposures.len() / 2;
    let mut shifts = vec![[0isize; 2]; exposures.len()];
    // Neighbours share most of their range, so shifts are chained outwards from the middle.
    let outwards = (0..middle).rev().map(|i| (i, i + 1));
    let pairs: Vec<(usize, usize)> =
        outwards.chain((middle + 1..exposures.len()).map(|i| (i, i - 1))).collect();
    for (index, next) in pairs {
        let rate = |e: &Exposure| Plane {
            width: e.signal.width,
            height: e.signal.height,
            data: e.signal.data.iter().map(|v| v / e.seconds as f32).collect(),
        };
        let (still, moved) = (rate(&exposures[next]), rate(&exposures[index]));
        let usable =
            |e: &Exposure, i: usize| e.signal.data[i].is_finite() && e.signal.data[i] > least_dn;
        let both: [&dyn Fn(usize) -> bool; 2] =
            [&|i| usable(&exposures[next], i), &|i| usable(&exposures[index], i)];
        let found = align::shift(&still, &moved, both, cell);
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
                "only shifts of whole {cell}-pixel cells of the pattern can be corrected; use a tripod, \
                 or leave the capture out"
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
            exposures[index].signal = moved;
            shifts[index] = by;
        }
    }
    Ok(shifts)
}

/// The estimate of one pixel.
struct Estimate {
    value: f64,
    sigma: f64,
}

impl Noise {
    fn variance(&self, signal: f64, frames: usize) -> f64 {
        (self.read_dn2 + self.gain_dn * signal.max(0.0)) / frames as f64
    }

    /// Merges the signals `at` gives for the exposures; infinite ones are saturated.
    fn estimate(&self, exposures: &[Exposure], at: impl Fn(&Exposure) -> f64) -> Estimate {
        let usable = || exposures.iter().map(|e| (e, at(e))).filter(|(_, x)| x.is_finite());
        let (mut signal, mut time) = (0.0, 0.0);
        for (e, x) in usable() {
            signal += x * e.frames as f64;
            time += e.seconds * e.frames as f64;
        }
        if time == 0.0 {
            return Estimate { value: 0.0, sigma: f64::INFINITY };
        }
        let first = signal / time;
        let (mut weighted, mut weights) = (0.0, 0.0);
        for (e, x) in usable() {
            let variance = self.variance(first * e.seconds, e.frames);
            weighted += x * e.seconds / variance;
            weights += e.seconds * e.seconds / variance;
        }
        Estimate { value: weighted / weights, sigma: 1.0 / weights.sqrt() }
    }

    /// Measures the noise on neighbouring exposures: the shorter one's difference from what the
    /// longer one says, in 24 classes of signal, its variance from the median absolute difference
    /// (which what moved does not change), fitted by a line.
    pub fn measure(exposures: &[Exposure], limit_dn: f32) -> Result<Self> {
        const CLASSES: usize = 24;
        // Per class: weight, signal and variance of one frame, summed over pairs.
        let (mut a, mut b, mut c, mut d, mut e) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for pair in exposures.windows(2) {
            let (short, long) = (&pair[0], &pair[1]);
            let ratio = short.seconds / long.seconds;
            let mut classes: Vec<Vec<f32>> = vec![Vec::new(); CLASSES];
            let mut signals = [0.0f64; CLASSES];
            let top = (f64::from(limit_dn) * ratio) as f32;
            for (&x, &y) in short.signal.data.iter().zip(&long.signal.data) {
                let expected = y * ratio as f32;
                if x.is_finite() && y.is_finite() && expected < top {
                    // Narrower classes in the dark, where most of a wide range lies.
                    let class = ((expected / top).max(0.0).sqrt() * CLASSES as f32) as usize;
                    let class = class.min(CLASSES - 1);
                    classes[class].push(x - expected);
                    signals[class] += f64::from(expected);
                }
            }
            for (index, mut differences) in classes.into_iter().enumerate() {
                if differences.len() < 100 {
                    continue;
                }
                let count = differences.len() as f64;
                let centre = median(&mut differences);
                differences.iter_mut().for_each(|v| *v = (*v - centre).abs());
                let deviation = 1.4826 * f64::from(median(&mut differences));
                let signal = (signals[index] / count).max(0.0);
                // variance = read² (1/n + ratio²/m) + K signal (1/n + ratio/m)
                let p = 1.0 / short.frames as f64 + ratio * ratio / long.frames as f64;
                let q = signal * (1.0 / short.frames as f64 + ratio / long.frames as f64);
                let variance = deviation * deviation;
                // A variance from n values is uncertain by its own size.
                let weight = count / (variance + p / 12.0).powi(2);
                a += weight * p * p;
                b += weight * p * q;
                c += weight * q * q;
                d += weight * p * variance;
                e += weight * q * variance;
            }
        }
        let determinant = a * c - b * b;
        if a == 0.0 || determinant <= 1e-12 * a * c {
            return Err(Error::input("no two exposures share enough unsaturated pixels")
                .help("shoot exposures a factor of 2 to 8 apart"));
        }
        // Rounding alone gives 1/12; a noise-free series has no more.
        let read = ((c * d - b * e) / determinant).max(1.0 / 12.0);
        let gain = ((e - b * read) / c).max(0.0);
        Ok(Self { gain_dn: gain, read_dn2: read })
    }
}

fn median(values: &mut [f32]) -> f32 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

/// What one exposure sees of a channel where the merged frame says s: offset + slope · s.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Departure {
    offset_dn: f64,
    slope: f64,
}

impl Departure {
    fn seen(self, expected: f64) -> f64 {
        self.offset_dn + self.slope * expected
    }

    /// The line of each channel: least absolute deviations over the medians of 64 classes of equally many
    /// pixels, which a minority that moved does not change.
    fn of(exposure: &Exposure, radiance: &Plane<f32>, cfa: &Cfa) -> Vec<Self> {
        const CLASSES: usize = 64;
        const SAMPLES: usize = 1 << 16;
        let width = radiance.width;
        // An odd step visits every column and channel.
        let step = (radiance.data.len() / SAMPLES) | 1;
        let mut pairs: Vec<Vec<(f32, f32)>> = vec![Vec::new(); cfa.channels().len()];
        for i in (0..radiance.data.len()).step_by(step) {
            let signal = exposure.signal.data[i];
            if signal.is_finite() {
                let expected = (f64::from(radiance.data[i]) * exposure.seconds) as f32;
                pairs[cfa.channel(i % width, i / width)].push((expected, signal));
            }
        }
        let line = |mut pairs: Vec<(f32, f32)>| {
            pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
            let points: Vec<(f64, f64)> = pairs
                .chunks((pairs.len() / CLASSES).max(1))
                .map(|class| {
                    let expected = f64::from(class[class.len() / 2].0);
                    let mut rest: Vec<f32> = class.iter().map(|p| p.1 - p.0).collect();
                    (expected, f64::from(median(&mut rest)))
                })
                .collect();
            Self::least_absolute(&points)
        };
        pairs.into_iter().map(line).collect()
    }

    /// The line s + offset + slope·s of least absolute deviation from (s, rest), by reweighted least squares.
    fn least_absolute(points: &[(f64, f64)]) -> Self {
        let (mut offset, mut slope) = (0.0, 0.0);
        for _ in 0..30 {
            let (mut n, mut x, mut y, mut xx, mut xy) = (0.0, 0.0, 0.0, 0.0, 0.0);
            for &(s, rest) in points {
                // A thousandth of a DN keeps a point on the line from having all the say.
                let w = 1.0 / (rest - offset - slope * s).abs().max(1e-3);
                n += w;
                x += w * s;
                y += w * rest;
                xx += w * s * s;
                xy += w * s * rest;
            }
            let spread = n * xx - x * x;
            if n == 0.0 || spread <= 1e-9 * n * xx {
                break; // one brightness: neither can be told
            }
            slope = (n * xy - x * y) / spread;
            offset = (y - slope * x) / n;
        }
        Self { offset_dn: offset, slope: 1.0 + slope }
    }
}

/// Where exposures disagree within the neighbourhood: the mean χ² per degree of freedom is above 1.5
/// by six of its own standard deviations.
fn moved(disagreement: &Plane<[f32; 2]>) -> Vec<bool> {
    let (width, height) = (disagreement.width, disagreement.height);
    let mut across = vec![[0.0f32; 2]; width * height];
    across.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        let row = disagreement.row(y);
        for (x, out) in out.iter_mut().enumerate() {
            let around = &row[x.saturating_sub(AROUND)..(x + AROUND + 1).min(width)];
            *out = around.iter().fold([0.0; 2], |s, v| [s[0] + v[0], s[1] + v[1]]);
        }
    });
    let mut moved = vec![false; width * height];
    moved.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        let rows = y.saturating_sub(AROUND)..(y + AROUND + 1).min(height);
        for (x, out) in out.iter_mut().enumerate() {
            let [chi, freedom] = rows
                .clone()
                .map(|v| across[v * width + x])
                .fold([0.0; 2], |s, v| [s[0] + v[0], s[1] + v[1]]);
            *out = freedom > 0.0 && chi / freedom > 1.5 + 6.0 * (2.0 / freedom).sqrt();
        }
    });
    moved
}

/// The exposure that a moving thing is taken from: the longest with less than 1 % saturated, else the
/// shortest.
fn reference(exposures: &[Exposure]) -> usize {
    let saturated = |e: &Exposure| e.signal.data.iter().filter(|v| v.is_infinite()).count();
    exposures.iter().rposition(|e| saturated(e) * 100 < e.signal.data.len()).unwrap_or(0)
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
        // Patch by patch: mean ratio within 2 %, and the spread is what sigma says.
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
        let shifted = |dx: usize| {
            series(
                &times,
                light,
                move |j, x, y| if j == 2 { (x + 20 + dx, y + 20) } else { (x + 20, y + 20) },
            )
        };
        let merged = merge(&shifted(4), &bayer, FULL, &[]).unwrap();
        assert_eq!(merged.shifts, [[0, 0], [0, 0], [-4, 0]]);
        let message = merge(&shifted(3), &bayer, FULL, &[]).err().unwrap().to_string();
        assert!(message.contains("\"e2\"") && message.contains("-3"), "{message}");
    }

    /// A black that is 2 DN off and a shutter that is 8 % off in one exposure are no movement.
    #[test]
    fn what_departs_as_a_whole_has_not_moved() {
        let mono = Cfa::parse("mono").unwrap();
        let mut series = series(&TIMES, patches, |_, x, y| (x, y));
        for v in &mut series.exposures[3].signal.data {
            *v = (*v * 1.08 + 2.0).min(FULL as f32);
        }
        let merged = merge(&series, &mono, FULL, &[]).unwrap();
        let flagged = merged.flags.data.iter().filter(|&&f| f != Flag::Merged as u8).count();
        assert!(flagged == 0, "{flagged} flagged");
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
