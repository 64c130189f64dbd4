//! `periodic-pattern-noise`: the strongest line of the power of dark frames.
//!
//! The power over two frequencies of the frames' residuals, and that of the row and column means
//! that the residuals lack, DN², has lines above a background without waves. The frequencies of
//! the strongest one, cycles per column and per row, are the likeliest of the bins around it by
//! Whittle's likelihood; its amplitude comes from its power A²wh/4 in all stacks:
//!
//!   A² = Σ ω_i A_i²/K² / Σ ω_i, e⁻², ω_i = n K²/v,
//!
//! n the frames of a stack, v the variance of its pixels (DN²), K the system gain (DN/e⁻).

use super::proposal::Proposal;
use crate::evidence::Evidence;
use crate::numerics::minimise::{lowest, minimum};
use crate::numerics::spectrum::Background;
use crate::numerics::tails::median_of_squares;
use crate::statistics::statistic::{Place, What};
use crate::statistics::temporal::Temporal;
use camrig_base::Value;
use camrig_base::median::median;
use camrig_captures::Role;
use camrig_fourier::sinc;

/// Bins to either side of a line that a wave between two bins leaks into: beyond three the leakage
/// (sin πd/πd)² is below 1 % of the line.
const LEAK: isize = 3;
/// Distance from the highest bin within which the wave is looked for, bins: half a bin and what
/// noise may add.
const WITHIN_BINS: f64 = 0.6;
/// Range of ln of a line's power over that of its highest bin: 0.25 % for a line that is none, to
/// 55 times, beyond what a wave between four bins (6.1 times) needs.
const LN_POWER: [f64; 2] = [-6.0, 4.0];
/// Steps of the golden section over that range, each 0.62 of the one before: 5e-6 is left.
const STEPS: usize = 30;

/// `periodic-pattern-noise`: amplitude and frequencies of a plane wave, in addition to others that
/// the model has.
pub fn periodic(e: &Evidence<'_>) -> Option<Proposal> {
    let (stack, _) = e.of_role(Role::Dark).max_by_key(|(_, c)| c.stack.frames)?;
    let place = Place::Stack(stack);
    let peaks = [What::PlanePeak, What::RowPeak, What::ColumnPeak].map(|w| (place, w));
    let z = |(place, what)| e.difference(place, what).map_or(0.0, |d| d.z());
    let strength = peaks.map(z).into_iter().fold(0.0, f64::max);
    let [fx, fy] = strongest_line(e, stack)?;
    let wave = [
        ("amplitude_e", amplitude(e, [fx, fy])),
        ("cycles_per_column", Value::chosen(fx)),
        ("cycles_per_row", Value::chosen(fy)),
    ];
    Some(Proposal { beside: true, ..Proposal::of("periodic-pattern-noise", strength, wave)? })
}

/// Cycles per column and per row of the strongest line of a stack.
fn strongest_line(e: &Evidence<'_>, stack: usize) -> Option<[f64; 2]> {
    // Each peak is given as how rare it is in white noise, so that they compare.
    let rarity = |what| e.measured(Place::Stack(stack), what).unwrap_or(0.0);
    let [plane, row, column] = [What::PlanePeak, What::RowPeak, What::ColumnPeak].map(rarity);
    let power = Power::of(&e.stacks[stack])?;
    let start = if plane >= row.max(column) {
        power.peak(|k, l| k > 0 && l > 0)?
    } else if row >= column {
        power.peak(|k, _| k == 0)?
    } else {
        power.peak(|_, l| l == 0)?
    };
    Some(power.fit(start))
}

/// Amplitude of a wave over all stacks, e⁻.
fn amplitude(e: &Evidence<'_>, frequencies: [f64; 2]) -> Value {
    let (w, h) = e.size();
    let (mut square, mut weight) = (0.0, 0.0);
    for (i, c) in e.design.conditions.iter().enumerate() {
        let (t, k) = (&e.stacks[i], e.gain(c));
        let (Some(power), Some((v, _))) = (Power::of(t), e.variance(i)) else { continue };
        let known = t.frames as f64 * k * k / v;
        square += known * power.square_amplitude(frequencies) / (k * k);
        weight += known;
    }
    Value { value: (square / weight).sqrt(), std_error: (2.0 / (w * h) / weight).sqrt() }
}

/// Power of the frames of a stack over two frequencies, DN².
struct Power<'a> {
    t: &'a Temporal,
    /// That of the residuals of pixels.
    plane: &'a [f32],
    /// Median of that without waves.
    background: Background,
    /// The mean of a power without waves over its median.
    to_mean: f64,
    /// Power without waves of row means and of column means, on the scale of that of pixels.
    lines: [f64; 2],
}

/// A bin: frequency along a row, 0 to half the columns, and along a column, wrapped.
type Bin = (usize, usize);

impl<'a> Power<'a> {
    fn of(t: &'a Temporal) -> Option<Self> {
        let plane = t.power.as_deref()?;
        let to_mean = 1.0 / median_of_squares(2.0 * t.dof);
        let white = |power: &[f64], across: usize| {
            median(&mut power.to_vec(), f64::total_cmp) * across as f64 * to_mean
        };
        let lines = [white(&t.row_power, t.width), white(&t.column_power, t.height)];
        Some(Self { t, plane, background: Background::of(plane, t.width), to_mean, lines })
    }

    /// Power of a bin, and what it has without waves, DN².
    fn at(&self, (k, l): Bin) -> (f64, f64) {
        let (w, h) = (self.t.width, self.t.height);
        // The power of means lists a frequency and its mirror image once.
        let mirrored = l.min(h - l);
        match (k, mirrored) {
            (0, l) if l > 0 => (self.t.row_power[l - 1] * w as f64, self.lines[0]),
            (k, 0) if k > 0 => (self.t.column_power[k - 1] * h as f64, self.lines[1]),
            _ => {
                let bin = l * (w / 2 + 1) + k;
                let white = f64::from(self.background.at(bin)) * self.to_mean;
                // A frame's mean was taken out.
                (if bin == 0 { white } else { f64::from(self.plane[bin]) }, white)
            }
        }
    }

    fn bins(&self) -> impl Iterator<Item = Bin> {
        let (half, h) = (self.t.width / 2 + 1, self.t.height);
        (0..h).flat_map(move |l| (0..half).map(move |k| (k, l)))
    }

    /// Of the bins wanted the one with most power over what it has without waves.
    fn peak(&self, wanted: impl Fn(usize, usize) -> bool) -> Option<Bin> {
        let over = |b: &Bin| {
            let (power, white) = self.at(*b);
            power / white
        };
        let wanted = self.bins().filter(|&(k, l)| wanted(k, l));
        wanted.max_by(|a, b| over(a).total_cmp(&over(b)))
    }

    /// The bin of frequencies of any sign: that of a wave is that of its mirror image.
    fn wrapped(&self, k: isize, l: isize) -> Bin {
        let (w, h) = (self.t.width as isize, self.t.height as isize);
        let k = k.rem_euclid(w);
        let (k, l) = if k > w / 2 { (w - k, -l) } else { (k, l) };
        (k as usize, l.rem_euclid(h) as usize)
    }

    /// The bins around a bin.
    fn around(&self, (k0, l0): Bin) -> Around {
        let mut bins = Vec::new();
        for dl in -LEAK..=LEAK {
            for dk in -LEAK..=LEAK {
                let (power, white) = self.at(self.wrapped(k0 as isize + dk, l0 as isize + dl));
                bins.push((dk as f64, dl as f64, power, white));
            }
        }
        let (power, white) = self.at((k0, l0));
        Around { bins, top: (power - white).max(white) }
    }

    /// Cycles per column and per row of the wave near a bin.
    fn fit(&self, (k0, l0): Bin) -> [f64; 2] {
        let (w, h) = (self.t.width as f64, self.t.height as f64);
        let around = self.around((k0, l0));
        let left = |dk: f64, dl: f64| around.deviance(dk, dl, around.line(dk, dl));
        let at = lowest(left, [-WITHIN_BINS, WITHIN_BINS], [-WITHIN_BINS, WITHIN_BINS]);
        let (fx, fy) = ((k0 as f64 + at.0) / w, (l0 as f64 + at.1) / h);
        let sign = if fx < 0.0 { -1.0 } else { 1.0 };
        let within = |f: f64| (f - f.round()).clamp(-0.5, 0.5);
        [within(sign * fx), within(sign * fy)]
    }

    /// Square of the amplitude of a wave (0 to half a cycle per column) that has another phase in
    /// each frame, DN². Of n frames the residuals lack what the mean frame has: Σ |a|² = Σ |a −
    /// ā|² + n |ā|².
    fn square_amplitude(&self, [fx, fy]: [f64; 2]) -> f64 {
        let t = self.t;
        let (w, h, n) = (t.width as f64, t.height as f64, t.frames as f64);
        let (x, y) = (fx * w, fy * h);
        let bin = self.wrapped(x.round() as isize, y.round() as isize);
        let line = self.around(bin).line(x - x.round(), y - y.round());
        // A wave's power in its bin is A²wh/4.
        let residual = 4.0 * line / (w * h);
        // The mean frame has patterns of rows and columns as well; and where frames were taken
        // against the means of several batches, the residuals lack more than it.
        if bin.0 == 0 || bin.1 == 0 || t.dof != n - 1.0 {
            return residual;
        }
        let mean = 4.0 * (wave(t, [fx, fy]) - t.fixed_variance() / (w * h));
        ((n - 1.0) * residual + n * mean.max(0.0)) / n
    }
}

/// |Fourier coefficient|² of the mean frame at cycles per column and per row, DN².
fn wave(t: &Temporal, [fx, fy]: [f64; 2]) -> f64 {
    let turn = |f: f64| std::f64::consts::TAU * f;
    let level = t.level();
    let columns: Vec<(f64, f64)> =
        (0..t.width).map(|x| libm::sincos(turn(fx * x as f64))).collect();
    let (mut re, mut im) = (0.0, 0.0);
    for (y, row) in t.mean.data.chunks(t.width).enumerate() {
        let (mut c, mut s) = (0.0, 0.0);
        for (&v, (sin, cos)) in row.iter().zip(&columns) {
            let v = f64::from(v) - level;
            c += v * cos;
            s += v * sin;
        }
        let (sin, cos) = libm::sincos(turn(fy * y as f64));
        re += c * cos - s * sin;
        im += c * sin + s * cos;
    }
    let n = (t.width * t.height) as f64;
    (re * re + im * im) / (n * n)
}

/// The bins around a peak.
struct Around {
    /// Distance from the peak along each axis in bins, power and power without waves in DN².
    bins: Vec<(f64, f64, f64, f64)>,
    /// What the peak has above that, DN².
    top: f64,
}

impl Around {
    /// −2 ln of Whittle's likelihood, per frame, of a line of this power (DN²) at (dk, dl) bins
    /// from the peak: a wave between bins leaks into those around as (sin πd/πd)² of its distance
    /// along each axis.
    fn deviance(&self, dk: f64, dl: f64, line: f64) -> f64 {
        let of = |(x, y, power, white): &(f64, f64, f64, f64)| {
            let expected = white + line * (sinc(x - dk) * sinc(y - dl)).powi(2);
            libm::log(expected) + power / expected
        };
        self.bins.iter().map(of).sum()
    }

    /// The likeliest power of a line there, DN².
    fn line(&self, dk: f64, dl: f64) -> f64 {
        let line = |x: f64| self.top * libm::exp(x);
        line(minimum(LN_POWER[0], LN_POWER[1], STEPS, |x| self.deviance(dk, dl, line(x))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::temporal::Collector;
    use camrig_base::Plane;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;
    use std::f64::consts::TAU;

    /// Waves of 6 DN in noise of 8 DN, 16 frames of 64 x 48: a line of A²wh/4σ² = 432 times the
    /// white power. Power alone does not show on which side of a bin a wave lies whose leakage of
    /// 432 d² of the white power is below its scatter of a quarter: d < 0.025 bins, between the
    /// bins less; five of these are allowed. The phases of the last wave lie within half a turn:
    /// the mean frame has 44 % of its power. Off the axes an amplitude is known to σ √(2/whn) =
    /// 0.9 %, and five of these are allowed; on them the mean takes up to 1/16 of the power.
    #[test]
    fn a_wave_between_the_bins_is_found_wherever_it_lies() {
        let (w, h, frames) = (64usize, 48usize, 16);
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
        for (fx, fy, step) in [
            (0.2537, -0.1131, 0.618),
            (0.1412, 0.0013, 0.618),
            (0.0021, 0.2263, 0.618),
            (0.4953, 0.31, 0.618),
            (0.2436, -0.2359, 0.03),
        ] {
            let batch: Vec<Plane<u16>> = (0..frames)
                .map(|i| {
                    let phase = TAU * step * f64::from(i);
                    let data = (0..w * h).map(|p| {
                        let at = TAU * (fx * (p % w) as f64 + fy * (p / w) as f64) + phase;
                        let noise: f64 = StandardNormal.sample(&mut rng);
                        (500.5 + 6.0 * at.sin() + 8.0 * noise) as u16
                    });
                    Plane { width: w, height: h, data: data.collect() }
                })
                .collect();
            let mut collector = Collector::new(w, h, 1023, true);
            collector.add(&batch);
            let t = collector.finish();
            let power = Power::of(&t).unwrap();
            let start = power.peak(|k, l| k + l > 0).unwrap();
            let [x, y] = power.fit(start);
            let off = |sign: f64| {
                let (dx, dy) = (sign * x - fx, sign * y - fy);
                ((dx - dx.round()) * w as f64).hypot((dy - dy.round()) * h as f64)
            };
            // Of a wave at the end of the band the mirror image may be found.
            let bins = off(1.0).min(off(-1.0));
            assert!(bins < 0.125, "{x} {y} for {fx} {fy}: {bins} bins");
            let amplitude = power.square_amplitude([x, y]).sqrt();
            let on_axis = fx < 0.01 || fy.abs() < 0.01;
            let allowed = if on_axis { 0.08 } else { 0.045 };
            assert!((amplitude / 6.0 - 1.0).abs() < allowed, "{fx} {fy}: {amplitude}");
        }
    }
}
