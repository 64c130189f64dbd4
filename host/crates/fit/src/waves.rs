//! The strongest plane wave of dark frames, whose phase is another in each.
//!
//! Of the power spectrum of the frames less their mean, over both frequencies, a bin stands out
//! where its power P is above the medians P₀ of the bins beside it in its row and in its column of
//! the spectrum, so that noise which rows or columns share is none; nor are offsets of sites. Power
//! of 1/f noise of rows, which falls faster than the bins beside one show, is in P₀ too. The wave's distance from the higher of two bins is d = √P₁/(√P + √P₁), P₁ the
//! power of the other. Of frames of N pixels with the Fourier coefficients F at its frequencies its
//! amplitude A has
//!
//!   A² = 4 (⟨|F|²⟩/N − P₀)/N,
//!
//! and half of that where it is its own mirror image, at the ends of both bands.

use camrig_base::Value;
use camrig_base::tails::{chi_square, median_of_squares};
use camrig_estimates::robust::median;
use camrig_estimates::rows::RowNoise;
use camrig_estimates::{Sites, Stack};
use camrig_statistics::numerics::spectrum::Spectrum2;
use std::f64::consts::TAU;

/// Normal deviate of the power of a bin from which it is a wave: beyond what the largest of
/// millions of bins reaches by chance.
const MIN_DEVIATION: f64 = 8.0;
/// Bins to either side of a line into which it leaks.
const LEAK: isize = 3;
/// Bins to either side, beyond those, whose median is the power without waves.
const BESIDE: isize = 16;

/// A plane wave.
#[derive(Clone, Copy, Debug)]
pub struct Wave {
    /// Its amplitude, DN.
    pub amplitude: Value,
    /// Cycles per column and per row.
    pub cycles: [f64; 2],
}

/// The strongest wave of dark stacks of one gain, beside this noise of rows in DN; none where
/// nothing stands out.
pub fn strongest(darks: &[&Stack], sites: Sites, rows: Option<&RowNoise>) -> Option<Wave> {
    let power = Power::of(darks, darks.first()?.size(), sites, rows);
    let (bin, z) = power.highest();
    (z > MIN_DEVIATION).then(|| power.wave(bin, darks, sites))
}

/// The frames of a stack less their mean, each less the means of its sites.
fn residuals(stack: &Stack, sites: Sites) -> impl Iterator<Item = Vec<f32>> {
    let (width, height) = stack.size();
    let n = stack.frames.len() as f32;
    let pixel = move |p: usize| stack.frames.iter().map(|f| f32::from(f.data[p])).sum::<f32>() / n;
    let mean: Vec<f32> = (0..width * height).map(pixel).collect();
    let site = move |i: usize| sites.of(i % width, i / width);
    stack.frames.iter().map(move |frame| {
        let values = frame.data.iter().zip(&mean);
        let mut rest: Vec<f32> = values.map(|(v, m)| f32::from(*v) - m).collect();
        let mut sums = vec![[0.0f64; 2]; sites.count()];
        for (i, v) in rest.iter().enumerate() {
            let [sum, count] = &mut sums[site(i)];
            (*sum, *count) = (*sum + f64::from(*v), *count + 1.0);
        }
        for (i, v) in rest.iter_mut().enumerate() {
            let [sum, count] = sums[site(i)];
            *v -= (sum / count) as f32;
        }
        rest
    })
}

/// |F|² of a frame at cycles per column and per row.
fn square(rest: &[f32], width: usize, [across, down]: [f64; 2]) -> f64 {
    let turn: Vec<(f64, f64)> =
        (0..width).map(|x| libm::sincos(TAU * across * x as f64)).collect();
    let (mut re, mut im) = (0.0, 0.0);
    for (y, row) in rest.chunks(width).enumerate() {
        let (mut s, mut c) = (0.0, 0.0);
        for (v, (sin, cos)) in row.iter().zip(&turn) {
            s += f64::from(*v) * sin;
            c += f64::from(*v) * cos;
        }
        let (sin, cos) = libm::sincos(TAU * down * y as f64);
        re += c * cos - s * sin;
        im += c * sin + s * cos;
    }
    re * re + im * im
}

/// Power of dark frames over both frequencies: white noise of variance v has v in each bin.
struct Power {
    width: usize,
    height: usize,
    /// Spectra of which it is the mean.
    count: f64,
    /// Rows of `width`/2 + 1 bins, by frequency along a column, wrapped.
    power: Vec<f32>,
    /// What it is without waves.
    white: Vec<f64>,
}

impl Power {
    fn of(
        darks: &[&Stack],
        (width, height): (usize, usize),
        sites: Sites,
        rows: Option<&RowNoise>,
    ) -> Self {
        let half = width / 2 + 1;
        let mut power = vec![0.0f32; half * height];
        let mut spectrum = Spectrum2::new(width, height);
        let mut count = 0.0;
        for stack in darks {
            residuals(stack, sites).for_each(|rest| spectrum.add(&rest, &mut power));
            count += stack.frames.len() as f64 - 1.0;
        }
        power.iter_mut().for_each(|p| *p /= count as f32);
        let mut all = Self { width, height, count, power, white: Vec::new() };
        let to_mean = median_of_squares(2.0 * count).recip();
        let white = |i: usize| all.beside([(i % half) as isize, (i / half) as isize]) * to_mean;
        all.white = (0..all.power.len()).map(white).collect();
        // What is the same in all columns is in the first of each row of bins.
        let of_rows = rows.map_or(Vec::new(), |rows| rows.power(height / 2));
        for (bin, of_rows) in (1..=height / 2).zip(of_rows) {
            for l in [bin, height - bin] {
                let white = &mut all.white[l * half];
                *white = white.max(of_rows * width as f64);
            }
        }
        all
    }

    /// The larger of the medians of the bins beside one in its row and in its column.
    fn beside(&self, bin: [isize; 2]) -> f64 {
        let of_axis = |axis: usize| {
            let away = (LEAK + 1..=BESIDE).flat_map(|d| [-d, d]);
            let power = away.map(|d| {
                let mut near = bin;
                near[axis] += d;
                f64::from(self.power[self.place(near)])
            });
            median(power.collect())
        };
        of_axis(0).max(of_axis(1))
    }

    /// The place of frequencies of any sign.
    fn place(&self, bin: [isize; 2]) -> usize {
        let [k, l] = self.wrapped(bin);
        let (k, l) = if k > self.width / 2 {
            (self.width - k, (self.height - l) % self.height)
        } else {
            (k, l)
        };
        l * (self.width / 2 + 1) + k
    }

    /// Power of frequencies of any sign, and what it has without waves.
    fn at(&self, bin: [isize; 2]) -> (f64, f64) {
        let place = self.place(bin);
        (f64::from(self.power[place]), self.white[place])
    }

    fn wrapped(&self, [k, l]: [isize; 2]) -> [usize; 2] {
        [k.rem_euclid(self.width as isize) as usize, l.rem_euclid(self.height as isize) as usize]
    }

    /// The bin that stands out most, and its normal deviate.
    fn highest(&self) -> ([isize; 2], f64) {
        let half = self.width / 2 + 1;
        let over = |i: usize| {
            let bin = [(i % half) as isize, (i / half) as isize];
            let (power, white) = self.at(bin);
            (bin, power / white)
        };
        let bins = (1..self.power.len()).map(over);
        let (bin, ratio) = bins.fold(([0, 0], 0.0), |a, b| if b.1 > a.1 { b } else { a });
        // Of a bin that is its own mirror image, the power has one degree of freedom a spectrum.
        (bin, chi_square(ratio, self.count))
    }

    fn wave(&self, bin: [isize; 2], darks: &[&Stack], sites: Sites) -> Wave {
        let over = |bin: [isize; 2]| {
            let (power, white) = self.at(bin);
            (power - white, white)
        };
        let off = |axis: usize| {
            let beside = [-1, 1].map(|step| {
                let mut near = bin;
                near[axis] += step;
                let (excess, white) = over(near);
                (
                    step as f64,
                    if excess > MIN_DEVIATION * white / self.count.sqrt() { excess } else { 0.0 },
                )
            });
            let (step, next) = if beside[0].1 > beside[1].1 { beside[0] } else { beside[1] };
            let [own, next] = [over(bin).0.sqrt(), next.sqrt()];
            let other = beside.iter().map(|b| b.1).fold(f64::INFINITY, f64::min);
            // A line on a bin of its own leaks evenly.
            if next <= 1.5 * other.sqrt() { 0.0 } else { step * next / (own + next) }
        };
        let turns = |at: f64, n: usize| {
            let cycles = at / n as f64;
            if cycles > 0.5 { cycles - 1.0 } else { cycles }
        };
        let cycles = [
            turns(bin[0] as f64 + off(0), self.width).min(0.5),
            turns(bin[1] as f64 + off(1), self.height),
        ];
        let frames = darks.iter().flat_map(|stack| residuals(stack, sites));
        let sum = frames.map(|rest| square(&rest, self.width, cycles)).sum::<f64>();
        let (pixels, white) = ((self.width * self.height) as f64, self.at(bin).1);
        let line = sum / self.count / pixels - white;
        let is_own = self.wrapped(bin) == self.wrapped(bin.map(|b| -b));
        let per_line = if is_own { 2.0 } else { 4.0 } / pixels;
        let of_noise = white * ((1.0 + 2.0 * (line / white).max(0.0)) / self.count).sqrt();
        // By chance the mean frame has a part of the wave, by an exponential law of which one in
        // twenty is over three times the mean; one that is its own mirror image is the sine of its
        // phase in each.
        let of_phases = if is_own { (2.0 * self.count).sqrt().recip() } else { 3.0 / self.count };
        let square = Value::new(line, libm::hypot(of_noise, of_phases * line)).scaled(per_line);
        let amplitude = square.sqrt().unwrap_or(Value::new(0.0, square.std_error.sqrt()));
        Wave { amplitude, cycles }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::Plane;
    use camrig_captures::Role;

    const MONO: Sites = Sites { across: 1, down: 1 };

    /// Frames of a wave with another phase in each, in noise of 3 DN of rows and of pixels.
    fn dark(amplitude: f64, [fx, fy]: [f64; 2]) -> Stack {
        let mut state = 7u64;
        let mut normal = || {
            let mut uniform = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (state >> 11) as f64 / (1u64 << 53) as f64
            };
            (0..12).map(|_| uniform()).sum::<f64>() - 6.0
        };
        let frames = (0..16).map(|i| {
            let phase = TAU * 0.618 * f64::from(i);
            let rows: Vec<f64> = (0..96).map(|_| 0.5 * normal()).collect();
            Plane::from_fn(128, 96, |x, y| {
                let wave = amplitude * (TAU * (fx * x as f64 + fy * y as f64) + phase).sin();
                (100.0 + wave + rows[y] + 3.0 * normal()).round() as u16
            })
        });
        Stack::new("dark", Role::Dark, 0.0, frames.collect())
    }

    #[test]
    fn amplitude_and_frequencies_come_back() {
        for cycles in [[0.25, 0.125], [0.5, 0.5], [0.2537, -0.1131], [0.013, 0.33]] {
            let wave = strongest(&[&dark(0.8, cycles)], MONO, None).unwrap();
            println!("{cycles:?} {wave:?}");
            let off = wave.cycles.iter().zip(cycles).zip([128.0, 96.0]);
            let bins = off.map(|((a, b), n)| (a - b).abs() * n).fold(0.0, f64::max);
            assert!(bins < 0.2, "{wave:?} for {cycles:?}");
            let off = (wave.amplitude.value - 0.8).abs();
            assert!(off < 3.0 * wave.amplitude.std_error, "{wave:?} for {cycles:?}");
            assert!(wave.amplitude.std_error < 0.1, "{wave:?}");
        }
    }

    #[test]
    fn noise_of_rows_is_no_wave() {
        assert!(strongest(&[&dark(0.0, [0.0, 0.0])], MONO, None).is_none());
    }
}
