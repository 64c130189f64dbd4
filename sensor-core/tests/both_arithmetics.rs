//! A thousand sensors and lights drawn from the ranges of their parameters, often at an end: f32
//! and fixed point agree within one DN, from darkness to lamps of a million full wells.
//!
//! Where nothing is counted, the scale is at most 64 DN per electron with all gains, so that the
//! 2⁻¹³ e⁻ by which a stage of fixed point rounds is at most 0.01 DN. A count that is rounded to
//! the next whole electron may differ by one, so that the scale is less than a DN for all counts of
//! a sensor together.

mod common;

use camrig_sensor_core::arith::{Arith, BLOCK, Block, Fixed, Float};
use camrig_sensor_core::config::{FrameSettings, SensorConfig};
use camrig_sensor_core::effects::*;
use camrig_sensor_core::pipeline::MeanRows;
use common::*;

/// DN per electron, all gains together.
const MAX_DN_PER_E: f64 = 64.0;
/// The same of all counts together.
const MAX_DN_PER_COUNT: f64 = 0.9;
const SENSORS: usize = 1000;

/// Effects that count nothing; those of normal numbers have their own tests.
const KINDS: [&str; 18] = [
    "quantum-efficiency",
    "exposure-offset",
    "colour-shading",
    "relative-illumination",
    "pdaf-pattern",
    "defective-pixels",
    "optical-crosstalk",
    "image-lag",
    "persistence",
    "blooming",
    "charge-coupling",
    "full-well",
    "companding",
    "system-gain",
    "gain-by-site",
    "gain-stage",
    "random-telegraph-noise",
    "black-level-offset",
];

/// Dark charge and its patterns, at any temperature.
const COUNTED: [&str; 5] = [
    "dark-current",
    "hot-pixels",
    "dark-current-gradient",
    "dark-current-telegraph-noise",
    "amp-glow",
];

/// Light of a column and row, and what the traps of every pixel hold, e⁻.
struct Light<F> {
    at: F,
    trapped_e: f32,
}

impl<A: Arith, F: Fn(u32, u32) -> f32> MeanRows<A> for Light<F> {
    fn mean_row(&mut self, row: u32, out: &mut [Block<A::Signal>]) {
        for (x, v) in out.as_flattened_mut().iter_mut().enumerate() {
            *v = A::Light::signal((self.at)(x as u32, row));
        }
    }

    fn traps(&mut self, _: usize, _: u32, out: &mut [Block<A::Signal>]) {
        out.fill([A::Light::signal(self.trapped_e); BLOCK]);
    }
}

/// A number of 0 to 1, at one of the ends in a third of the draws.
fn somewhere(next: &mut impl FnMut() -> f64) -> f64 {
    let (place, value) = (next(), next());
    if place < 1.0 / 6.0 {
        0.0
    } else if place < 1.0 / 3.0 {
        1.0
    } else {
        value
    }
}

/// Effects of some of these kinds, with parameters from their ranges.
fn some_of(kinds: &[&str], next: &mut impl FnMut() -> f64) -> Vec<Effect> {
    let mut chosen: Vec<Effect> = Vec::new();
    for entry in kinds.iter().filter_map(|k| Effect::CATALOGUE.iter().find(|e| e.kind == *k)) {
        if next() < 0.3 {
            let draw = |p: &Parameter| p.min + somewhere(next) as f32 * (p.max - p.min);
            let values: Vec<f32> = entry.parameters.iter().map(draw).collect();
            chosen.push(Effect::new(entry.id, &values).expect(entry.kind));
        }
    }
    chosen
}

/// Light from an electron to 10⁴ full wells, with a lamp of 10⁶ on some pixels: both agree on it.
#[track_caller]
fn agree(
    sensor: usize,
    config: &SensorConfig,
    settings: &FrameSettings,
    next: &mut impl FnMut() -> f64,
) {
    let full = f64::from(config.full_well_e);
    let light = (1e4 * full).powf(next());
    let lamp = (light * 1e6f64.powf(next())).min(1e9);
    let at = |x: u32, y: u32| if (x * 7 + y * 5).is_multiple_of(23) { lamp } else { light } as f32;
    let mut light_of = Light { at, trapped_e: (full * somewhere(next)) as f32 };
    let float = frame::<Float>(config, settings, &mut light_of);
    let fixed = frame::<Fixed>(config, settings, &mut light_of);
    for (i, (a, b)) in float.iter().zip(&fixed).enumerate() {
        assert!(
            a.abs_diff(*b) <= 1,
            "sensor {sensor}, pixel {i}: {a} and {b} DN of {light:e} and {lamp:e} e-, {settings:?}, \
             full well {full} e-, {} bits: {:?}",
            config.bits,
            config.effects
        );
    }
}

/// At most what a pixel collects in the dark by an effect, e⁻: 7 standard deviations above the mean
/// of dark currents, and 17 times that of exponential ones.
fn most_dark_e(effect: &Effect, settings: &FrameSettings) -> f64 {
    let value = |key: &str| {
        let at = effect.entry().parameters.iter().position(|p| p.key == key)?;
        Some(f64::from(effect.values()[at]))
    };
    let rate = value("mean_e_per_s").or(value("rate_e_per_s")).unwrap_or(0.0);
    let spread = value("dsnu_e_per_s").map_or(16.4 * rate, |dsnu| 6.8 * dsnu);
    let doublings = value("doubling_c").map_or(0.0, |doubling| {
        (f64::from(settings.temperature_c) - value("reference_c").unwrap_or(0.0)) / doubling
    });
    f64::from(settings.exposure_s) * (rate + spread) * doublings.exp2()
}

/// Dark charge at temperatures of −60 to 100 °C, as far as it is charge that a pixel may have.
#[test]
fn they_count_alike() {
    let mut next = uniforms(2_027);
    let mut taken = 0;
    while taken < SENSORS / 4 {
        let mut chosen = some_of(&COUNTED, &mut next);
        let scale = MAX_DN_PER_COUNT / chosen.len().max(1) as f64;
        // As in the chain of every camera: charge beyond it saturates in fixed point alone.
        let full_well_e = 524_287f64.powf(somewhere(&mut next)) as f32;
        chosen.push(full_well::FullWell { full_well_e, knee: 0.0 }.into());
        chosen.extend(some_of(&["random-telegraph-noise", "black-level-offset"], &mut next));
        let mut config = bayer(1 + (140.0 * next()) as u32, 5, &chosen);
        config.bits = 8 + (8.99 * next()) as u8;
        config.black_level_dn = (next() * f64::from(config.max_dn()) * 0.2) as f32;
        let most_gain = scale * 524_287.0 / f64::from(config.max_dn());
        let gain = 16f64.powf(somewhere(&mut next)).min(most_gain);
        config.full_well_e = (f64::from(config.max_dn()) * gain / scale).max(1.0) as f32;
        let settings = FrameSettings::new((1e-4 * 1e4f64.powf(next())) as f32)
            .with_frame((1e3 * next()) as u32)
            .with_gain(gain as f32)
            .with_temperature((160.0 * somewhere(&mut next) - 60.0) as f32);
        if chosen.iter().all(|effect| most_dark_e(effect, &settings) < 524_287.0) {
            agree(taken, &config, &settings, &mut next);
            taken += 1;
        }
    }
}

#[test]
fn they_agree_over_the_ranges_of_their_parameters() {
    let mut next = uniforms(2_026);
    for sensor in 0..SENSORS {
        let mut chosen = some_of(&KINDS, &mut next);
        let has_table = next() < 0.3;
        if has_table {
            chosen.push(gain_table::GainTable { digital_above: 1e6, start: 0.0 }.into());
        }
        chosen.sort_by_key(Effect::domain);
        let gain = |e: &Effect| match e {
            Effect::SystemGain(e) => f64::from(e.ratio),
            Effect::GainBySite(e) => {
                f64::from([e.plane_1, e.plane_2, e.plane_3].into_iter().fold(e.plane_0, f32::max))
            }
            _ => 1.0,
        };
        let system_gain: f64 = chosen.iter().map(gain).product();
        let mut config = bayer(1 + (140.0 * next()) as u32, 5, &chosen);
        config.bits = 8 + (8.99 * next()) as u8;
        config.black_level_dn = (next() * f64::from(config.max_dn()) * 0.2) as f32;
        let analog_gain = 16f64.powf(somewhere(&mut next));
        if has_table {
            // At gains 1, 4 with a step, and 16; the scale within its limit.
            let top = f64::from(config.max_dn());
            let scale = MAX_DN_PER_E / system_gain.max(1.0);
            let place = |gain| {
                let black = 0.2 * top * next();
                [gain, 1.0, scale * next().max(1e-3), black, 524_287f64.powf(somewhere(&mut next))]
            };
            let words = [1.0, 4.0, 4.0, 16.0].map(place).concat();
            config.table = [20.0].into_iter().chain(words).map(|w| w as f32).collect();
        }
        let most = f64::from(config.max_dn()) * analog_gain * system_gain.max(1.0);
        let least = (most / MAX_DN_PER_E).clamp(1.0, 524_287.0);
        config.full_well_e = (least * (524_287.0 / least).powf(somewhere(&mut next))) as f32;
        let settings = FrameSettings::new((1e-4 * 1e4f64.powf(next())) as f32)
            .with_gain(analog_gain as f32)
            .after_exposure((1e-4 * 1e4f64.powf(next())) as f32);
        agree(sensor, &config, &settings, &mut next);
    }
}
