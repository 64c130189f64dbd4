//! Periodic patterns: the strongest line of the dark frames' power.

use super::flicker::sinc;
use super::{Proposal, list, lowest, minimum};
use crate::captures::Role;
use crate::diagnose::evidence::Evidence;
use crate::diagnose::statistics::{Place, What};
use crate::diagnose::temporal::Temporal;
use sensor_core::effects::periodic_pattern_noise::PeriodicPatternNoise;

/// Bins to either side of a line that a wave between two bins leaks into.
const LEAK: isize = 3;

/// Amplitude and frequencies of a plane wave.
pub fn periodic(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let (stack, c) = e.of_role(Role::Dark).max_by_key(|(_, c)| c.frames)?;
        let (t, place) = (&e.stacks[stack], Place::Stack(stack));
        let peaks = [What::PlanePeak, What::RowPeak, What::ColumnPeak].map(|w| (place, w));
        let z = |(place, what)| e.difference(place, what).map_or(0.0, |d| d.z());
        let strength = peaks.map(z).into_iter().fold(0.0, f64::max);
        // Each says by itself how rare it is in white noise.
        let [plane, row, column] = peaks.map(|(place, w)| e.measured(place, w).unwrap_or(0.0));
        let power = Power::of(t)?;
        let start = if plane >= row.max(column) {
            power.peak(|k, l| k > 0 && l > 0)?
        } else if row >= column {
            power.peak(|k, _| k == 0)?
        } else {
            power.peak(|_, l| l == 0)?
        };
        let [fx, fy, line] = power.fit(start);
        let k = e.gain(c);
        // A wave's power in its bin is A²wh/4.
        let (w, h) = e.size();
        let amplitude = (4.0 * line / (w * h)).sqrt() / k;
        // Relative error of an amplitude seen in `dof` frames against white noise.
        let v = e.variance(stack)?.0 / (k * k);
        let se = (2.0 * v / (w * h) / t.dof).sqrt();
        let effect = PeriodicPatternNoise {
            amplitude_e: amplitude as f32,
            cycles_per_column: fx as f32,
            cycles_per_row: fy as f32,
        };
        let mut p = Proposal::new("periodic-pattern-noise", effect.into(), strength)
            .with("amplitude_e", amplitude, se)
            .with("cycles_per_column", fx, f64::NAN)
            .with("cycles_per_row", fy, f64::NAN);
        p.beside = true;
        Some(p)
    })())
}

/// Power of frames over two frequencies: of the residuals of pixels, and of the means of rows and columns that they lack.
struct Power<'a> {
    t: &'a Temporal,
    plane: &'a [f32],
    /// Power without waves: of pixels, of row means, of column means, as that of pixels.
    white: [f64; 3],
}

/// A bin: frequency along a row, 0 to half the columns, and along a column, wrapped.
type Bin = (usize, usize);

impl<'a> Power<'a> {
    fn of(t: &'a Temporal) -> Option<Self> {
        let plane = t.power.as_deref()?;
        let middle = |power: &mut dyn Iterator<Item = f64>| {
            let mut sorted: Vec<f64> = power.collect();
            sorted.sort_by(f64::total_cmp);
            // The median of χ² of 2 `dof` degrees of freedom over its mean (Wilson & Hilferty 1931).
            sorted[sorted.len() / 2] / (1.0 - 1.0 / (9.0 * t.dof)).powi(3)
        };
        let white = [
            middle(&mut plane.iter().map(|&p| f64::from(p))),
            middle(&mut t.row_power.iter().map(|p| p * t.width as f64)),
            middle(&mut t.column_power.iter().map(|p| p * t.height as f64)),
        ];
        Some(Self { t, plane, white })
    }

    /// Power of a bin, and that without waves.
    fn at(&self, (k, l): Bin) -> (f64, f64) {
        let (w, h) = (self.t.width, self.t.height);
        // A mean's mirror image is in the list of means once.
        let mirrored = l.min(h - l);
        match (k, mirrored) {
            (0, 0) => (self.white[0], self.white[0]),
            (0, l) => (self.t.row_power[l - 1] * w as f64, self.white[1]),
            (k, 0) => (self.t.column_power[k - 1] * h as f64, self.white[2]),
            _ => (f64::from(self.plane[l * (w / 2 + 1) + k]), self.white[0]),
        }
    }

    fn bins(&self) -> impl Iterator<Item = Bin> {
        let (half, h) = (self.t.width / 2 + 1, self.t.height);
        (0..h).flat_map(move |l| (0..half).map(move |k| (k, l)))
    }

    /// The bin of a kind that is highest above what it has without waves.
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

    /// Cycles per column and per row, and power of the wave near a bin, by Whittle's likelihood of the bins around: a wave
    /// between bins leaks into them as (sin πd / πd)² of its distance along each axis.
    fn fit(&self, (k0, l0): Bin) -> [f64; 3] {
        let (w, h) = (self.t.width as f64, self.t.height as f64);
        let mut around = Vec::new();
        for dl in -LEAK..=LEAK {
            for dk in -LEAK..=LEAK {
                let (power, white) = self.at(self.wrapped(k0 as isize + dk, l0 as isize + dl));
                around.push((dk as f64, dl as f64, power, white));
            }
        }
        // Twice the negative logarithm of the likelihood, per frame, of a line of this power at (dk, dl) bins from the peak.
        let deviance = |dk: f64, dl: f64, line: f64| -> f64 {
            let of = |(x, y, power, white): &(f64, f64, f64, f64)| {
                let expected = white + line * (sinc(x - dk) * sinc(y - dl)).powi(2);
                expected.ln() + power / expected
            };
            around.iter().map(of).sum()
        };
        let line_at = |dk: f64, dl: f64| -> f64 {
            let (power, white) = self.at((k0, l0));
            let top = (power - white).max(white);
            let line = |x: f64| top * x.exp();
            let best = minimum(-2.0, 4.0, 24, |x| deviance(dk, dl, line(x)));
            line(best)
        };
        let at = lowest(|dk, dl| deviance(dk, dl, line_at(dk, dl)), [-0.6, 0.6], [-0.6, 0.6]);
        let (fx, fy) = ((k0 as f64 + at.0) / w, (l0 as f64 + at.1) / h);
        let sign = if fx < 0.0 { -1.0 } else { 1.0 };
        let within = |f: f64| (f - f.round()).clamp(-0.5, 0.5);
        [within(sign * fx), within(sign * fy), line_at(at.0, at.1)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Plane;
    use crate::diagnose::temporal::Collector;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;
    use std::f64::consts::TAU;

    /// Waves of 6 DN in noise of 8 DN, 16 frames of 64 x 48: a line of A²wh/4σ² = 432 times the white power. Power alone does
    /// not tell on which side of a bin a wave lies whose leak of 432 d² of the white power is below its scatter of a quarter:
    /// d < 0.025 bins, between the bins less; five of these. The batch's mean takes up to 1/16 of the power.
    #[test]
    fn a_wave_between_the_bins_is_found_wherever_it_lies() {
        let (w, h, frames) = (64usize, 48usize, 16);
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
        for (fx, fy) in [(0.2537, -0.1131), (0.1412, 0.0013), (0.0021, 0.2263), (0.4953, 0.31)] {
            let batch: Vec<Plane<u16>> = (0..frames)
                .map(|i| {
                    let phase = TAU * 0.618 * f64::from(i);
                    let data = (0..w * h).map(|p| {
                        let at = TAU * (fx * (p % w) as f64 + fy * (p / w) as f64) + phase;
                        let noise: f64 = StandardNormal.sample(&mut rng);
                        (500.5 + 6.0 * at.sin() + 8.0 * noise) as u16
                    });
                    Plane { width: w, height: h, data: data.collect() }
                })
                .collect();
            let mut collector = Collector::new(w, h, 10, true);
            collector.add(&batch);
            let t = collector.finish();
            let power = Power::of(&t).unwrap();
            let start = power.peak(|k, l| k + l > 0).unwrap();
            let [x, y, line] = power.fit(start);
            let off = |sign: f64| {
                let (dx, dy) = (sign * x - fx, sign * y - fy);
                ((dx - dx.round()) * w as f64).hypot((dy - dy.round()) * h as f64)
            };
            // Of a wave at the end of the band its mirror image may be the one that is found.
            let bins = off(1.0).min(off(-1.0));
            assert!(bins < 0.125, "{x} {y} for {fx} {fy}: {bins} bins");
            let amplitude = (4.0 * line / (w * h) as f64).sqrt();
            assert!((amplitude / 6.0 - 1.0).abs() < 0.08, "{amplitude}");
        }
    }
}
