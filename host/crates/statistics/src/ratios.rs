//! Double ratios of the channels, in which the scatter of the lamp and the mean gain of each
//! channel cancel.
//!
//! With D_ic the mean above dark of channel c in flat i, r a reference flat, and g the channel
//! with most light in i, (D_ic / D_rc) / (D_ig / D_rg) depends neither on the amount of light in
//! the two flats nor on the mean of the gain pattern over a channel's pixels. It shows shot noise,
//! crosstalk between the channels and nonlinearity of their response.

use super::statistic::{Place, Scale, Statistic, What};
use super::temporal::Temporal;
use crate::data::channels::Channels;
use crate::data::design::{Condition, Design};

/// Largest level of the reference flat relative to the brightest. Chosen between the brightest,
/// which may be nonlinear near the full well, and much darker ones, which would add shot noise to
/// every ratio.
const MAX_REFERENCE_LEVEL: f64 = 0.6;
/// Relative variance of a ratio's denominators above which the ratio is not normally distributed: a
/// standard deviation of a tenth.
const MAX_RELATIVE_VARIANCE: f64 = 0.01;

/// The reference flat: of the flats of known light up to `MAX_REFERENCE_LEVEL` of the brightest,
/// the one with most light in its weakest channel. It depends on the design alone, so that
/// measurement and replicates have the same one.
pub fn reference_flat(design: &Design) -> Option<usize> {
    let known = || design.conditions.iter().enumerate().filter(|(_, c)| c.is_known_flat());
    let most = |c: &Condition| c.photo_e.iter().copied().fold(0.0, f64::max);
    let least = |c: &Condition| c.photo_e.iter().copied().fold(f64::MAX, f64::min);
    let top = known().map(|(_, c)| most(c)).fold(0.0, f64::max);
    known()
        .filter(|(_, c)| most(c) <= MAX_REFERENCE_LEVEL * top && least(c) > 0.0)
        .max_by(|(_, a), (_, b)| least(a).total_cmp(&least(b)))
        .map(|(i, _)| i)
}

/// The channel with most light in a flat.
pub fn strongest(c: &Condition) -> usize {
    (0..c.photo_e.len()).max_by(|&a, &b| c.photo_e[a].total_cmp(&c.photo_e[b])).unwrap_or(0)
}

/// A mean above dark.
#[derive(Clone, Copy)]
struct Level {
    mean: f64,
    variance: f64,
}

impl Level {
    fn relative_variance(&self) -> f64 {
        self.variance / (self.mean * self.mean)
    }
}

/// Ratios of each channel except the strongest, in each flat of known light except the reference;
/// none for a monochrome sensor.
pub fn ratios(
    design: &Design,
    stacks: &[Temporal],
    dark: Option<usize>,
    channels: &Channels,
) -> Vec<Statistic> {
    let (Some(dark), Some(reference)) = (dark, reference_flat(design)) else { return Vec::new() };
    if channels.count() < 2 {
        return Vec::new();
    }
    // The mean of each channel, with the variance from the noise of its pixels.
    let of = |t: &Temporal| -> Vec<Level> {
        let samples = (t.mean.data.len() / channels.count() * t.frames) as f64;
        let variance = channels.means(&t.pixel_variance);
        channels
            .means(&t.mean.data)
            .into_iter()
            .zip(variance)
            .map(|(mean, v)| Level { mean, variance: v / samples })
            .collect()
    };
    let black = of(&stacks[dark]);
    let above = |i: usize| -> Vec<Level> {
        let difference = |(a, b): (&Level, &Level)| Level {
            mean: a.mean - b.mean,
            variance: a.variance + b.variance,
        };
        of(&stacks[i]).iter().zip(&black).map(difference).collect()
    };
    let by = above(reference);
    let mut out = Vec::new();
    for (i, c) in design.conditions.iter().enumerate().filter(|(_, c)| c.is_known_flat()) {
        if i == reference {
            continue;
        }
        let (own, g) = (above(i), strongest(c));
        for channel in (0..channels.count()).filter(|&k| k != g) {
            let scale = by[g].mean / (by[channel].mean * own[g].mean);
            let value = own[channel].mean * scale;
            let others = by[channel].relative_variance()
                + own[g].relative_variance()
                + by[g].relative_variance();
            let sd = (own[channel].variance * scale * scale + others * value * value).sqrt();
            if value.is_finite() && others < MAX_RELATIVE_VARIANCE {
                let (place, what) = (Place::Stack(i), What::Ratio(channel as u8));
                out.push(Statistic { place, what, value, sd, scale: Scale::Linear });
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::design::Stack;
    use crate::data::variation::FrameVariation;
    use crate::temporal::Collector;
    use camrig_base::Plane;
    use camrig_camera::Camera;
    use camrig_captures::Role;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    fn flat(light: &[f64]) -> Condition {
        Condition {
            stack: Stack {
                capture: 0,
                id: String::new(),
                role: if light[0] > 0.0 { Role::Flat } else { Role::Dark },
                skip: 0,
                frames: 4,
                total: 4,
                variation: FrameVariation::default(),
                first_number: 0,
                exposure_s: 0.01,
                analog_gain: 1.0,
                temperature_c: 20.0,
            },
            photo_e: light.to_vec(),
            before_e: Vec::new(),
            level_known: true,
            even: true,
            wavelength_nm: None,
        }
    }

    /// Four frames of 48x32 pixels whose channels have these means, with noise of `sd`.
    fn stack(camera: &Camera, levels: &[f64], sd: f64, rng: &mut Xoshiro256PlusPlus) -> Temporal {
        let pattern = camera.sensor.pattern();
        let mut collector = Collector::new(48, 32, 4095, false);
        let frames: Vec<Plane<u16>> = (0..4)
            .map(|_| {
                let mut value = |i: usize| {
                    let noise: f64 = StandardNormal.sample(rng);
                    (levels[pattern.channel(i % 48, i / 48)] + sd * noise).round() as u16
                };
                Plane { width: 48, height: 32, data: (0..48 * 32).map(&mut value).collect() }
            })
            .collect();
        collector.add(&frames);
        collector.finish()
    }

    #[test]
    fn lamp_and_gains_cancel_and_the_standard_deviation_is_correct() {
        let mut camera = Camera::load("mt9t012").unwrap();
        (camera.sensor.width, camera.sensor.height) = (48, 32);
        let channels = Channels::new(&camera);
        let n = channels.count();
        let (white, blue) = ([500.0, 1000.0, 250.0, 1000.0], [50.0, 400.0, 800.0, 400.0]);
        // The first flat, the brightest, is not the reference.
        let lights = [[0.0; 4], white.map(|v| 2.0 * v), white, blue];
        let conditions = lights.iter().map(|l| flat(&l[..n])).collect();
        let design = Design { conditions, ..Design::default() };
        assert_eq!(reference_flat(&design), Some(2));
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(5);
        let mut z = Vec::new();
        for round in 0..50 {
            // Lamp and gains differ in each round; the first is without noise.
            let gain: [f64; 4] = std::array::from_fn(|c| 1.0 + 0.04 * (c * round % 3) as f64);
            let lamps = [1.0, 0.5, 1.0 + 0.02 * (round % 10) as f64, 1.5];
            let sd = if round == 0 { 0.0 } else { 6.0 };
            let stacks: Vec<Temporal> = std::iter::zip(&lights, lamps)
                .map(|(light, lamp)| {
                    let level = |c: usize| 100.0 + lamp * gain[c] * light[c];
                    stack(&camera, &(0..n).map(level).collect::<Vec<_>>(), sd, &mut rng)
                })
                .collect();
            let found = ratios(&design, &stacks, Some(0), &channels);
            assert_eq!(found.len(), 2 * (n - 1));
            for s in found {
                let (Place::Stack(i), What::Ratio(c)) = (s.place, s.what) else { panic!() };
                let (c, g) = (usize::from(c), strongest(&design.conditions[i]));
                let truth = lights[i][c] * white[g] / (white[c] * lights[i][g]);
                match round {
                    0 => assert!((s.value - truth).abs() < 1e-12, "{s:?} {truth}"),
                    _ => z.push((s.value - truth) / s.sd),
                }
            }
        }
        // The ratios of a round share noise, so the sample size is the number of rounds.
        let rms = (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt();
        assert!((rms - 1.0).abs() < 4.0 / (2.0 * 49.0f64).sqrt(), "{rms}");
    }
}
