//! A thousand sensors and lights drawn from the ranges of their parameters, often at an end: f32
//! and fixed point agree within one DN, from darkness to lamps of a million full wells.
//!
//! Without noise, as a count that is rounded to the next whole electron differs by many DN. The
//! scale is at most 64 DN per electron with all gains, so that the 2⁻¹³ e⁻ by which a stage of
//! fixed point rounds is at most 0.01 DN.

mod common;

use camrig_sensor_core::arith::{Fixed, Float};
use camrig_sensor_core::config::FrameSettings;
use camrig_sensor_core::effects::*;
use common::*;

/// DN per electron, all gains together.
const MAX_DN_PER_E: f64 = 64.0;
const SENSORS: usize = 1000;

/// Effects without noise; those of thresholds and of random patterns have their own tests.
const KINDS: [&str; 15] = [
    "quantum-efficiency",
    "exposure-offset",
    "colour-shading",
    "relative-illumination",
    "pdaf-pattern",
    "defective-pixels",
    "optical-crosstalk",
    "image-lag",
    "blooming",
    "charge-coupling",
    "full-well",
    "companding",
    "system-gain",
    "gain-stage",
    "black-level-offset",
];

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

#[test]
fn they_agree_over_the_ranges_of_their_parameters() {
    let mut next = uniforms(2_026);
    for sensor in 0..SENSORS {
        let mut chosen: Vec<Effect> = Vec::new();
        for entry in KINDS.iter().filter_map(|k| Effect::CATALOGUE.iter().find(|e| e.kind == *k)) {
            if next() < 0.3 {
                let draw = |p: &Parameter| p.min + somewhere(&mut next) as f32 * (p.max - p.min);
                let values: Vec<f32> = entry.parameters.iter().map(draw).collect();
                let effect = Effect::new(entry.id, &values).expect(entry.kind);
                chosen.push(effect);
            }
        }
        let has_table = next() < 0.3;
        if has_table {
            chosen.push(gain_table::GainTable { digital_above: 1e6, start: 0.0 }.into());
        }
        chosen.sort_by_key(Effect::domain);
        let gain = |e: &Effect| match e {
            Effect::SystemGain(e) => f64::from(e.ratio),
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
        // From an electron to 10⁴ full wells, with a lamp of 10⁶ on some pixels.
        let full = f64::from(config.full_well_e);
        let light = (1e4 * full).powf(next());
        let lamp = (light * 1e6f64.powf(next())).min(1e9);
        let at =
            |x: u32, y: u32| if (x * 7 + y * 5).is_multiple_of(23) { lamp } else { light } as f32;
        let float = frame::<Float>(&config, &settings, &mut Means(at));
        let fixed = frame::<Fixed>(&config, &settings, &mut Means(at));
        for (i, (a, b)) in float.iter().zip(&fixed).enumerate() {
            assert!(
                a.abs_diff(*b) <= 1,
                "sensor {sensor}, pixel {i}: {a} and {b} DN of {light:e} and {lamp:e} e-, full \
                 well {full} e-, {} bits, gain {analog_gain}: {chosen:?}",
                config.bits
            );
        }
    }
}
