//! What each fixed effect does to known signals, against its equation, in both arithmetics.
//!
//! Signals are read back through a converter of 1/8 e⁻ per step, so equality means within half a
//! step ([`HALF`]) plus the arithmetic's own error.

mod common;

use camrig_sensor_core::arith::Arith;
use camrig_sensor_core::config::{FrameSettings, SensorConfig};
use camrig_sensor_core::effects::*;
use common::*;

/// Half a step of the test sensor and a little, e⁻.
const HALF: f64 = 0.5 / DN_PER_E + 0.005;

in_both_arithmetics! {
    full_well nonlinearity companding black_sun blooming offset_clipping exposure_offset
    readout_channel_mismatch readout_channel_crosstalk pixel_offset_fpn column_gain_fpn
    prnu_low_frequency prnu_correlated black_level_offset gain_stage gain_stage_with_a_table gain_table
    green_imbalance pdaf_pattern
    colour_shading
    relative_illumination fringing adc_nonlinearity requantised defective_pixels hot_pixels column_offset_fpn
    light_is_not_cut_before_its_effects black_sun_sets_in_anywhere_in_its_range
    system_gain gain_by_site quantum_efficiency stuck_pixels defective_columns defective_areas
    a_converter_that_truncates_is_half_a_code_low
}

/// Output over input for a ramp of `top` e⁻ over 1000 columns; `expected` maps input to output.
fn check_response<A: Arith>(effect: Effect, top: f32, expected: impl Fn(f64) -> f64) {
    let config = monochrome(1000, 1, &[effect]);
    let ramp = |x: u32, _| top * x as f32 / 1000.0;
    let v = electrons(&config, &SETTINGS, &frame::<A>(&config, &SETTINGS, &mut Means(ramp)));
    let limit = (65_535.0 - BLACK) / DN_PER_E;
    for (x, v) in v.iter().enumerate() {
        let want = expected(f64::from(ramp(x as u32, 0))).min(limit);
        assert!(
            (v - want).abs() < HALF,
            "{}: column {x}: {v}, expected {want}",
            effect.entry().kind
        );
    }
}

/// Full well of the test sensor, e⁻.
fn well_e() -> f64 {
    f64::from(monochrome(1, 1, &[]).full_well_e)
}

fn full_well<A: Arith>() {
    let sharp = full_well::FullWell { full_well_e: 5000.0, knee: 0.0 };
    check_response::<A>(sharp.into(), 7000.0, |q| q.min(5000.0));
    let soft = full_well::FullWell { full_well_e: 5000.0, knee: 0.05 };
    check_response::<A>(soft.into(), 7000.0, |q| {
        q - 250.0 * (1.0 + ((q - 5000.0) / 250.0).exp()).ln()
    });
}

fn nonlinearity<A: Arith>() {
    let w = well_e();
    for (loss, n) in [(0.05f64, 1.0), (0.02, 2.5), (-0.03, 1.0)] {
        let effect = nonlinearity::Nonlinearity { loss: loss as f32, exponent: n as f32 };
        check_response::<A>(effect.into(), 7000.0, |v| v * (1.0 - loss * (v / w).powf(n)));
    }
}

fn companding<A: Arith>() {
    let effect =
        companding::Companding { knee_1: 0.25, slope_1: 0.5, knee_2: 0.5, slope_2: 0.125 };
    let (a, b) = (0.25 * well_e(), 0.5 * well_e());
    check_response::<A>(effect.into(), 8000.0, |v| {
        v.min(a) + 0.5 * (v.min(b) - a).max(0.0) + 0.125 * (v - b).max(0.0)
    });
    // The same light in DN, at any gain, in front of the gain and behind it, and with a table.
    let knees = [(0.1, 0.2, 1.0, 1.0), (0.05, 0.5, 0.4, 0.0), (0.3, 0.0, 0.3, 1.0)];
    for (knee_1, slope_1, knee_2, slope_2) in knees {
        let effect = companding::Companding { knee_1, slope_1, knee_2, slope_2 };
        let stage = gain_stage::GainStage { share: 1.0 };
        let table = gain_table::GainTable { digital_above: 1e6, start: 0.0 };
        let alone = monochrome(64, 1, &[effect.into()]);
        let behind = monochrome(64, 1, &[stage.into(), effect.into()]);
        let mut with_table = monochrome(64, 1, &[table.into(), effect.into()]);
        let words = [10.0, 1.0, -1.0, 4.0, -1.0, -1.0, 8.0, -1.0, 64.0, -1.0, -1.0];
        with_table.table = words.into_iter().collect();
        for gain in [1.0, 2.0, 4.0, 8.0] {
            for config in [&alone, &behind, &with_table] {
                let settings = SETTINGS.with_gain(gain);
                let full = 65_535.0 / config.dn_per_e(gain);
                let dn = frame::<A>(config, &settings, &mut Means(|x, _| full * x as f32 / 64.0));
                for (x, dn) in dn.iter().enumerate() {
                    let v = x as f64 / 64.0;
                    let [a, b, s, t] =
                        [knee_1, knee_2.max(knee_1), slope_1, slope_2].map(f64::from);
                    let want = v.min(a) + s * (v.min(b) - a).max(0.0) + t * (v - b).max(0.0);
                    let want = (BLACK + 65_535.0 * want).min(65_535.0);
                    let off = (f64::from(*dn) - want).abs();
                    let step = f64::from(config.dn_per_e(gain)) / 4096.0 + 1.0;
                    assert!(off <= step, "gain {gain}, column {x}: {dn}, expected {want}");
                }
            }
        }
    }
}

fn black_sun<A: Arith>() {
    let w = well_e();
    let effect = black_sun::BlackSun { onset: 10.0 };
    check_response::<A>(effect.into(), 100_000.0, |n| if n > 10.0 * w { 0.0 } else { n });
}

fn offset_clipping<A: Arith>() {
    let effects = [
        read_noise::ReadNoise { read_e: 10.0, read_e_post: 0.0 }.into(),
        offset_clipping::OffsetClipping { level_e: -2.0 }.into(),
    ];
    let config = monochrome(256, 64, &effects);
    let v = flat::<A>(&config, &SETTINGS, 0.0);
    let clipped = v.iter().filter(|v| (**v + 2.0).abs() < HALF).count() as f64;
    assert!(v.iter().all(|v| *v > -2.0 - HALF));
    // Half the rounding step beyond -0.2 deviations.
    let share = 0.4232;
    let n = v.len() as f64;
    near("share at the clipping level", clipped, n * share, (n * share * (1.0 - share)).sqrt());
}

fn blooming<A: Arith>() {
    let config = monochrome(8, 5, &[blooming::Blooming { fraction: 0.5 }.into()]);
    let w = well_e();
    let spot = |x: u32, y: u32| if (x, y) == (3, 2) { 10_000.0 } else { 100.0 };
    let v = electrons(&config, &SETTINGS, &frame::<A>(&config, &SETTINGS, &mut Means(spot)));
    let spill = 0.25 * (10_000.0 - w);
    for (i, v) in v.iter().enumerate() {
        let want = match (i % 8, i / 8) {
            (3, 2) => w.min((65_535.0 - BLACK) / DN_PER_E),
            (3, 1 | 3) => 100.0 + spill,
            _ => 100.0,
        };
        assert!((v - want).abs() < HALF, "{i}: {v} {want}");
    }
}

fn exposure_offset<A: Arith>() {
    for times in [0.5f32, 8.0, 12.0, 15.0] {
        let offset_us = 500.0 * (times - 1.0);
        let effect = exposure_offset::ExposureOffset { offset_us, step_us: 0.0 };
        check_gain::<A>(effect.into(), times);
    }
    let dark = dark_current::DarkCurrent {
        mean_e_per_s: 1e6,
        dsnu_e_per_s: 0.0,
        doubling_c: 7.0,
        reference_c: 25.0,
    };
    let offset = exposure_offset::ExposureOffset { offset_us: 2.0, step_us: 8.0 };
    let config = monochrome(256, 64, &[offset.into()]);
    let both = monochrome(256, 64, &[offset.into(), dark.into()]);
    for (asked, given) in [(25.0f64, 26.0f64), (29.0, 34.0), (1.0, 2.0)] {
        let settings = SETTINGS.with_exposure((asked * 1e-6) as f32);
        let v = flat::<A>(&config, &settings, 1000.0);
        assert!((v[0] - 1000.0 * given / asked).abs() < HALF, "{} {asked}", v[0]);
        let v = flat::<A>(&both, &settings, 0.0);
        near("dark charge", mean(&v), given, (given / v.len() as f64).sqrt());
    }
}

fn readout_channel_mismatch<A: Arith>() {
    let effect = |channels, offset_e, gain| readout_channel_mismatch::ReadoutChannelMismatch {
        channels,
        offset_e,
        gain,
    };
    let (mut offsets, mut gains) = (Vec::new(), Vec::new());
    for seed in 0..200 {
        let with = |e: readout_channel_mismatch::ReadoutChannelMismatch| {
            let mut config = monochrome(70, 2, &[e.into()]);
            config.seed = seed;
            config
        };
        let v = flat::<A>(&with(effect(4.0, 10.0, 0.0)), &SETTINGS, 0.0);
        assert!((0..140).all(|i| v[i] == v[i % 70 % 4]), "repeats over columns and rows");
        offsets.extend_from_slice(&v[..4]);
        let v = flat::<A>(&with(effect(4.0, 0.0, 0.01)), &SETTINGS, 4000.0);
        gains.extend(v[..4].iter().map(|v| v / 4000.0));
    }
    near_variance("variance of offsets", variance(&offsets), 100.0, 800, 0.0);
    near_variance("variance of gains", variance(&gains), 1e-4, 800, 0.0);
}

fn readout_channel_crosstalk<A: Arith>() {
    let effect = readout_channel_crosstalk::ReadoutChannelCrosstalk { coupling: 0.001 };
    for width in [100, 129] {
        let config = monochrome(width, 1, &[effect.into()]);
        let line = |x: u32, _| if x == 20 { 6000.0 } else { 0.0 };
        let v = electrons(&config, &SETTINGS, &frame::<A>(&config, &SETTINGS, &mut Means(line)));
        for (x, v) in v.iter().enumerate() {
            let mirrored = x as u32 == width - 21;
            let want = if x == 20 {
                6000.0
            } else if mirrored {
                6.0
            } else {
                0.0
            };
            assert!((v - want).abs() < HALF, "{x}: {v} {want}");
        }
    }
}

fn pixel_offset_fpn<A: Arith>() {
    let config =
        monochrome(256, 256, &[pixel_offset_fpn::PixelOffsetFpn { sigma_e: 30.0 }.into()]);
    let v = flat::<A>(&config, &SETTINGS, 0.0);
    near_variance("variance over pixels", variance(&v), 900.0, v.len(), 0.0);
    let later = SETTINGS.with_frame(9).with_exposure(1.0);
    assert_eq!(v, flat::<A>(&config, &later, 0.0), "in each frame and exposure");
}

fn column_gain_fpn<A: Arith>() {
    let config = monochrome(8192, 2, &[column_gain_fpn::ColumnGainFpn { sigma: 0.02 }.into()]);
    let v = flat::<A>(&config, &SETTINGS, 4000.0);
    assert_eq!(v[..8192], v[8192..]);
    near_variance("variance over columns", variance(&v[..8192]), 6400.0, 8192, 0.0);
}

fn prnu_low_frequency<A: Arith>() {
    let powers: Vec<f64> = (0..300)
        .map(|seed| {
            let effect = prnu_low_frequency::PrnuLowFrequency { sigma: 0.02, order: 3.0 };
            let mut config = monochrome(48, 32, &[effect.into()]);
            config.seed = seed;
            let v = flat::<A>(&config, &SETTINGS, 4000.0);
            let m: Vec<f64> = v.iter().map(|v| v / 4000.0 - 1.0).collect();
            assert!(mean(&m).abs() < 1e-4, "waves without the constant one");
            let step = m.windows(2).step_by(48).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
            assert!(step < 0.03, "smooth: {step}");
            mean(&m.iter().map(|m| m * m).collect::<Vec<_>>())
        })
        .collect();
    near("mean square", mean(&powers), 4e-4, (variance(&powers) / 300.0).sqrt());
}

fn prnu_correlated<A: Arith>() {
    let (w, h) = (512usize, 256usize);
    let effect = prnu_correlated::PrnuCorrelated { sigma: 0.02 };
    let config = monochrome(w as u32, h as u32, &[effect.into()]);
    let v = flat::<A>(&config, &SETTINGS, 4000.0);
    let m: Vec<f64> = v.iter().map(|v| (v / 4000.0 - 1.0) / 0.02).collect();
    assert_eq!(v, flat::<A>(&config, &SETTINGS.with_frame(5), 4000.0));
    // Variance of a covariance over n pixels (Bartlett 1946): at most 2 Σ ρ²/n, and Σ ρ² over all
    // lags is (1 + 2/4)².
    let sd = (2.0 * 2.25 / (w * h) as f64).sqrt();
    for (dx, dy, expected) in [
        (0, 0, 1.0),
        (1, 0, 0.5),
        (0, 1, 0.5),
        (1, 1, 0.25),
        (2, 0, 0.0),
        (0, 2, 0.0),
        (2, 1, 0.0),
    ] {
        let products = (0..h - dy)
            .flat_map(|y| (0..w - dx).map(move |x| (y * w + x, (y + dy) * w + x + dx)))
            .map(|(a, b)| m[a] * m[b]);
        near("covariance", mean(&products.collect::<Vec<_>>()), expected, sd);
    }
    // The left edge is as any other column.
    let edge: Vec<f64> = m.iter().step_by(w).copied().collect();
    near_variance("variance of the left edge", variance(&edge), 1.0, h / 2, 0.0);
}

/// Offsets of columns and rows in front of the gain and behind it, at gains 1 and 8: in DN they
/// are G^(1 − s) times those at unity gain, the signal G times what it is there.
fn gain_stage<A: Arith>() {
    let columns = |share: f32, analog_gain: f32| {
        let offsets = column_offset_fpn::ColumnOffsetFpn::from_values(&[9.0]);
        let stage = gain_stage::GainStage { share };
        let mut config = monochrome(4096, 1, &[stage.into(), offsets.into()]);
        config.full_well_e *= 8.0;
        let settings = SETTINGS.with_gain(analog_gain);
        let dn = frame::<A>(&config, &settings, &mut Means(|_, _| 400.0));
        let dn: Vec<f64> = dn.iter().map(|&d| f64::from(d) - BLACK).collect();
        (mean(&dn), variance(&dn).sqrt())
    };
    for share in [0.0, 0.3, 1.0] {
        let (at_one, at_eight) = (columns(share, 1.0), columns(share, 8.0));
        let rise = 8f64.powf(1.0 - f64::from(share));
        assert!((at_eight.1 / at_one.1 / rise - 1.0).abs() < 5e-3, "{share}: {at_eight:?}");
        assert!((at_eight.0 / at_one.0 - 8.0).abs() < 0.02, "{share}: {at_eight:?}");
    }
    // Behind the whole gain, read noise and stuck pixels are those of unity gain in DN.
    let read = read_noise::ReadNoise { read_e: 5.0, read_e_post: 0.0 };
    let stuck = stuck_pixels::StuckPixels { fraction: 1.0, level: 0.25 };
    let stage = gain_stage::GainStage { share: 1.0 };
    let at_gain = |effect: Effect, analog_gain| {
        let config = monochrome(4096, 1, &[stage.into(), effect]);
        let dn = frame::<A>(&config, &SETTINGS.with_gain(analog_gain), &mut Means(|_, _| 0.0));
        dn.into_iter().map(f64::from).collect::<Vec<f64>>()
    };
    assert_eq!(at_gain(read.into(), 1.0), at_gain(read.into(), 4.0));
    assert_eq!(at_gain(stuck.into(), 4.0)[0], BLACK + (0.25 * 65_535.0f64).round_ties_even());
}

/// Behind the whole gain, where a table has a step of the conversion gain: offsets, noise after a
/// power of the gain and stuck pixels in DN are those at unity gain, at any place of the table.
fn gain_stage_with_a_table<A: Arith>() {
    let table = gain_table::GainTable { digital_above: 1e6, start: 0.0 };
    let stage = gain_stage::GainStage { share: 1.0 };
    let offsets = column_offset_fpn::ColumnOffsetFpn::from_values(&[9.0]);
    let stuck = stuck_pixels::StuckPixels { fraction: 1.0, level: 0.25 };
    let at = |effects: &[Effect], gain| {
        let mut config = monochrome(1024, 1, effects);
        #[rustfmt::skip]
        let words = [
            20.0,
            1.0, -1.0,  0.5, -1.0, -1.0,
            4.0, -1.0,  2.0, -1.0, -1.0,
            4.0, -1.0,  8.0, -1.0, -1.0,
            16.0, -1.0, 32.0, -1.0, -1.0,
        ];
        config.table = words.into_iter().collect();
        let dn = frame::<A>(&config, &SETTINGS.with_gain(gain), &mut Means(|_, _| 0.0));
        dn.into_iter().map(|dn| f64::from(dn) - BLACK).collect::<Vec<f64>>()
    };
    for gain in [2.0, 3.999, 4.0, 16.0] {
        let behind = [table.into(), stage.into(), offsets.into()];
        let [own, unity] = [gain, 1.0].map(|gain| variance(&at(&behind, gain)).sqrt());
        assert!((own - unity).abs() < 0.02 * unity, "{gain}: {own}, {unity}");
        let before = [table.into(), offsets.into()];
        let rise = f64::from(if gain < 4.0 { gain } else { 4.0 * gain });
        let own = variance(&at(&before, gain)).sqrt();
        assert!((own - rise * unity).abs() < 0.02 * rise * unity, "{gain}: {own}, {unity}");
        let level = at(&[table.into(), stuck.into()], gain)[0];
        assert!((level - 0.25 * 65_535.0).abs() < 2.0, "{gain}: {level}");
    }
}

/// Two conversion gains, the second from gain 4 on, and a digital gain above 8: at the places, in
/// the middle of two and beyond them. Read noise of the chain's own is replaced.
fn gain_table<A: Arith>() {
    let read = read_noise::ReadNoise { read_e: 99.0, read_e_post: 0.0 };
    let table = gain_table::GainTable { digital_above: 8.0, start: 0.0 };
    let mut config = monochrome(16_384, 1, &[table.into(), read.into()]);
    #[rustfmt::skip]
    let words = [
        20.0,
        1.0, 6.0,  8.0, 2048.0, 5000.0,
        4.0, 3.0, 32.0, 1024.0, 5000.0,
        4.0, 1.5, 40.0,  500.0, 1200.0,
        8.0, 1.0, 80.0,    0.0, 1200.0,
    ];
    config.table = words.into_iter().collect();
    // Gain; read noise, e⁻; DN per electron; black level, DN; step of the codes, DN.
    for (gain, read_e, dn_per_e, black, step) in [
        (0.5, 6.0, 8.0, 2048.0, 1.0),
        (1.0, 6.0, 8.0, 2048.0, 1.0),
        (2.0, 18f64.sqrt(), 16.0, 2048.0 / 2f64.sqrt(), 1.0),
        (4.0, 1.5, 40.0, 500.0, 1.0),
        (4.0 * 2f64.sqrt(), 1.5f64.sqrt(), 40.0 * 2f64.sqrt(), 250.0, 1.0),
        (8.0, 1.0, 80.0, 0.0, 1.0),
        (24.0, 1.0, 240.0, 0.0, 3.0),
    ] {
        let settings = SETTINGS.with_gain(gain as f32);
        let dn = frame::<A>(&config, &settings, &mut Means(|_, _| 100.0));
        let e: Vec<f64> = dn.iter().map(|&d| (f64::from(d) - black) / dn_per_e).collect();
        let rounding = step * step / (12.0 * dn_per_e * dn_per_e);
        near("mean", mean(&e), 100.0, read_e / 128.0);
        near_variance("read noise", variance(&e), read_e * read_e + rounding, 16_384, 0.0);
        if step > 1.0 {
            assert!(dn.iter().all(|&d| (f64::from(d) - black) % step == 0.0), "gain {gain}");
        }
    }
    // Full: of the first conversion gain the well, of the second the node, with digital gain the
    // converter.
    config.effects.retain(|e| !matches!(e, Effect::ReadNoise(_)));
    for (gain, dn) in [(1.0, 2048 + 8 * 5000), (4.0, 500 + 40 * 1200), (24.0, 65_535)] {
        let full = frame::<A>(&config, &SETTINGS.with_gain(gain), &mut Means(|_, _| 2e5));
        assert_eq!(full[0], dn, "gain {gain}");
    }
    // What is below 0 is as without the table, in proportion.
    config.table = [5.0, 1.0, -1.0, -1.0, -1.0, -1.0].into_iter().collect();
    let same = monochrome(16_384, 1, &[read.into()]);
    config.effects.push(read.into()).unwrap();
    let settings = SETTINGS.with_gain(3.0);
    let of = |config: &SensorConfig| frame::<A>(config, &settings, &mut Means(|_, _| 100.0));
    assert_eq!(of(&config), of(&same));
    // Tables that are none.
    let falling = [10.0, 2.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0];
    for words in [&[] as &[f32], &[4.0, 1.0, 1.0, 1.0, 1.0], &falling] {
        config.table = words.iter().copied().collect();
        assert!(config.check().is_err(), "{words:?}");
    }
}

fn black_level_offset<A: Arith>() {
    let effect = black_level_offset::BlackLevelOffset {
        offset_dn: 5.0,
        per_gain_dn: 2.0,
        per_second_dn: 100.0,
        plane_0_dn: 0.0,
        plane_1_dn: -3.0,
        plane_2_dn: 7.0,
        plane_3_dn: 0.0,
        per_kelvin_dn: 0.5,
        reference_c: 15.0,
    };
    let config = bayer(70, 2, &[effect.into()]);
    for (analog_gain, exposure_s, kelvins) in [(1.0, 0.01, 10.0), (4.0, 0.05, -20.0)] {
        let settings = SETTINGS.with_gain(analog_gain).with_exposure(exposure_s);
        let settings = settings.with_temperature(15.0 + kelvins);
        let dn = frame::<A>(&config, &settings, &mut Means(|_, _| 0.0));
        let common =
            BLACK + 5.0 + 2.0 * f64::from(analog_gain - 1.0) + 100.0 * f64::from(exposure_s);
        let common = common + 0.5 * f64::from(kelvins);
        for (i, dn) in dn.iter().enumerate() {
            let own = [0.0, -3.0, 7.0, 0.0][i / 70 % 2 * 2 + i % 2];
            assert_eq!(f64::from(*dn), (common + own).round(), "{i}");
        }
    }
}

fn green_imbalance<A: Arith>() {
    let effect = green_imbalance::GreenImbalance { centre: 0.02, corner: 0.06 };
    let config = bayer(202, 102, &[effect.into()]);
    let v = flat::<A>(&config, &SETTINGS, 4000.0);
    let at = |x: usize, y: usize| v[y * 202 + x] / 4000.0;
    let tolerance = HALF / 4000.0 + 2e-4;
    assert!((at(0, 0) - 1.0).abs() < tolerance && (at(1, 1) - 1.0).abs() < tolerance);
    assert!((at(101, 50) - at(100, 51) - 0.02).abs() < 2.0 * tolerance, "centre");
    assert!((at(201, 0) - at(0, 101) - 0.06).abs() < 0.002, "corners, one pixel in");
    let mono = monochrome(16, 16, &[effect.into()]);
    assert!(flat::<A>(&mono, &SETTINGS, 4000.0).iter().all(|v| (v - 4000.0).abs() < HALF));
}

fn pdaf_pattern<A: Arith>() {
    let effect = pdaf_pattern::PdafPattern {
        period_x: 12.0,
        period_y: 8.0,
        first_x: 5.0,
        first_y: 3.0,
        gain: 0.4,
    };
    let config = monochrome(100, 40, &[effect.into()]);
    for (i, v) in flat::<A>(&config, &SETTINGS, 1000.0).iter().enumerate() {
        let covered = i % 100 % 12 == 5 && i / 100 % 8 == 3;
        assert!((v - if covered { 400.0 } else { 1000.0 }).abs() < HALF, "{i}: {v}");
    }
}

/// r² of a pixel, 1 in the corners.
fn field2(x: usize, y: usize, width: usize, height: usize) -> f64 {
    let (w, h) = (width as f64 / 2.0, height as f64 / 2.0);
    ((x as f64 + 0.5 - w).powi(2) + (y as f64 + 0.5 - h).powi(2)) / (w * w + h * h)
}

fn colour_shading<A: Arith>() {
    let effect = colour_shading::ColourShading {
        channel_0: -0.3,
        channel_1: 0.0,
        channel_2: 0.2,
        channel_3: 0.0,
    };
    let config = bayer(150, 100, &[effect.into()]);
    for (i, v) in flat::<A>(&config, &SETTINGS, 3000.0).iter().enumerate() {
        let (x, y) = (i % 150, i / 150);
        let k = [-0.3, 0.0, 0.2][config.pattern.channel(x, y)];
        assert!((v - 3000.0 * (1.0 + k * field2(x, y, 150, 100))).abs() < HALF, "{i}: {v}");
    }
}

fn relative_illumination<A: Arith>() {
    let effect = relative_illumination::RelativeIllumination { corner: -0.1 };
    let config = monochrome(150, 100, &[effect.into()]);
    for (i, v) in flat::<A>(&config, &SETTINGS, 3000.0).iter().enumerate() {
        let want = 3000.0 * (1.0 - 0.1 * field2(i % 150, i / 150, 150, 100));
        assert!((v - want).abs() < HALF, "{i}: {v} {want}");
    }
}

fn fringing<A: Arith>() {
    let effect = fringing::Fringing { amplitude: 0.1, fringes: 8.0, direction_deg: 0.0 };
    let config = monochrome(800, 2, &[effect.into()]);
    let v = flat::<A>(&config, &SETTINGS, 3000.0);
    // Whole fringes: amplitude²/2, and the first harmonic only.
    let m: Vec<f64> = v[..800].iter().map(|v| v / 3000.0 - 1.0).collect();
    assert!((mean(&m.iter().map(|m| m * m).collect::<Vec<_>>()) - 0.005).abs() < 2e-6);
    assert!((0..700).all(|x| (m[x] - m[x + 100]).abs() < 1e-4), "eight fringes");
    assert!((0..750).all(|x| (m[x] + m[x + 50]).abs() < 1e-4), "of opposite halves");
}

/// Codes of a ramp of 32 levels per code, from −1/2 on, over an 8-bit converter.
fn converted<A: Arith>(effect: adc_nonlinearity::AdcNonlinearity, seed: u64) -> Vec<u16> {
    let mut config = monochrome(256 * 32, 1, &[effect.into()]);
    config.bits = 8;
    config.full_well_e = 255.0;
    config.black_level_dn = 0.0;
    config.seed = seed;
    let ramp = |x: u32, _| (x as f32 + 0.5) / 32.0 - 0.5;
    frame::<A>(&config, &SETTINGS, &mut Means(ramp))
}

fn adc_nonlinearity<A: Arith>() {
    let sigma = 0.12f64;
    let mut lowest = Vec::new();
    for seed in 0..60 {
        let effect = adc_nonlinearity::AdcNonlinearity::from_values(&[sigma as f32]);
        let dn = converted::<A>(effect, seed);
        // A bit is set first where the signal and a half reach its weight.
        let weights: Vec<f64> = (0..8)
            .map(|b| dn.iter().position(|&d| d >= 1 << b).map_or(0.0, |x| x as f64 / 32.0))
            .collect();
        // The other codes follow from the weights by successive approximation, but for the ramp's
        // steps.
        let differ = dn.iter().enumerate().filter(|(x, d)| {
            let mut left = (*x as f64 + 0.5) / 32.0;
            let mut code = 0;
            for (b, weight) in weights.iter().enumerate().rev() {
                if left >= *weight {
                    left -= weight;
                    code |= 1u16 << b;
                }
            }
            code != **d
        });
        // Eight weights known to 1/64 in the mean, so about four levels of 32 for each code.
        assert!(differ.count() < 4 * 256, "{seed}");
        lowest.push(weights[0] - 1.0);
    }
    // ε_0 less the common gain error, a quarter per mille of it; levels of 1/32 DN.
    near_variance("weight of the lowest bit", variance(&lowest), sigma * sigma, 60, 0.0);

    // One known error: the code before the bit is set is wider, the last code with it set
    // narrower.
    let effect = adc_nonlinearity::AdcNonlinearity::from_values(&[0.0, 0.0, 0.0, 0.25]);
    let dn = converted::<A>(effect, 1);
    widths_are(&dn, |code| match code % 8 {
        3 => 40,
        7 => 24,
        _ => 32,
    });
    // One of both lowest bits together: they are set later, and what has the second alone is wider.
    let values = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.25];
    let dn = converted::<A>(adc_nonlinearity::AdcNonlinearity::from_values(&values), 1);
    widths_are(&dn, |code| match code % 4 {
        2 => 40,
        3 => 24,
        _ => 32,
    });
}

/// A ramp over four ranges: the codes that are left are those of each range, and the code nearest
/// to a level, or the one below where codes are cut, so that each is as wide as its step; noise
/// gets s²/12 more.
fn requantised<A: Arith>() {
    let range = |code: u16| match code {
        0..40 => (0.0, 1.0),
        40..101 => (40.0, 2.0),
        101..180 => (101.0, 2.5),
        _ => (180.0, 16.0),
    };
    for rounding in [0.5, 0.0] {
        let none = 65536.0;
        let values = [1.0, 40.0, 2.0, 101.0, 2.5, 180.0, 16.0, none, 1.0, rounding];
        let effect = requantised::Requantised::from_values(&values);
        let mut config = monochrome(256 * 32, 1, &[effect.into()]);
        (config.bits, config.full_well_e, config.black_level_dn) = (8, 255.0, 0.0);
        let ramp = |x: u32, _| (x as f32 + 0.5) / 32.0 - 0.5;
        let dn = frame::<A>(&config, &SETTINGS, &mut Means(ramp));
        for (x, &found) in dn.iter().enumerate() {
            let code = (x / 32) as u16;
            let (from, step) = range(code);
            // The code at or above the edge between two multiples of the step, and that of it.
            let multiple = ((f64::from(code) - from) / step + f64::from(rounding)).floor();
            let again = from + (multiple * step - f64::from(rounding)).ceil();
            let again = (again as u16).min(255);
            // The ramp's levels next to a change of code may round to either.
            if x % 32 > 0 && x % 32 < 31 {
                assert_eq!(found, again, "{code}");
            }
        }
        // 101, 103, 106, 108, 111 ...: rounded halves down, or 101, 104, 106, 109, 111 cut.
        let steps = if rounding > 0.0 { [2, 3, 2, 3] } else { [3, 2, 3, 2] };
        let mut used: Vec<u16> =
            dn.iter().copied().filter(|dn| (101..=111).contains(dn)).collect();
        used.dedup();
        let found: Vec<u16> = used.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert_eq!(found, steps);
    }
    let step = 64.0f64;
    let effect = requantised::Requantised::from_values(&[step as f32]);
    let read = read_noise::ReadNoise { read_e: (2.0 * step / DN_PER_E) as f32, read_e_post: 0.0 };
    let noisy = flat::<A>(&monochrome(512, 256, &[read.into(), effect.into()]), &SETTINGS, 4000.0);
    let expected = (4.0 + 1.0 / 12.0) * (step / DN_PER_E).powi(2);
    near_variance("noise of more than a step", variance(&noisy), expected, noisy.len(), 0.0);
}

/// Codes occur as often as expected, but for rounding at their ends.
fn widths_are(dn: &[u16], expected: impl Fn(u16) -> usize) {
    for code in 1..200u16 {
        let width = dn.iter().filter(|&&d| d == code).count();
        assert!(width.abs_diff(expected(code)) <= 1, "{code}: {width}");
    }
}

/// Pixels of a flat field of 1000 e⁻ that are as `is` says, of those that are expected to be.
fn check_share<A: Arith>(effect: Effect, is: fn(f64) -> bool, expected: f64) {
    let v = flat::<A>(&monochrome(512, 256, &[effect]), &SETTINGS, 1000.0);
    let (n, count) = (v.len() as f64, v.iter().filter(|v| is(**v)).count() as f64);
    let error = (n * expected * (1.0 - expected)).sqrt();
    near(effect.entry().kind, count, n * expected, error);
}

fn defective_pixels<A: Arith>() {
    let weak = defective_pixels::DefectivePixels { fraction: 0.01, gain: 0.25 };
    check_share::<A>(weak.into(), |v| (v - 250.0).abs() < HALF, 0.01);
}

fn defective_columns<A: Arith>() {
    let effect = defective_columns::DefectiveColumns { fraction: 0.1, gain: 0.25, length: 0.5 };
    let v = flat::<A>(&monochrome(512, 64, &[effect.into()]), &SETTINGS, 1000.0);
    let weak = |y: usize, x: usize| (v[y * 512 + x] - 250.0).abs() < HALF;
    let columns: Vec<usize> = (0..512).filter(|x| weak(63, *x)).collect();
    // One in each of 51 strips of 512/51 columns.
    let strips = columns.iter().map(|x| (*x as f64 + 0.5) * 51.0 / 512.0);
    assert!(strips.enumerate().all(|(i, at)| (at - i as f64 - 0.5).abs() < 0.6), "{columns:?}");
    assert_eq!(columns.len(), 51);
    for y in 0..64 {
        let own: Vec<usize> = (0..512).filter(|x| weak(y, *x)).collect();
        assert_eq!(own, if y < 32 { Vec::new() } else { columns.clone() }, "row {y}");
    }
}

/// Rows, a cluster that is hot, and both on one sensor.
fn defective_areas<A: Arith>() {
    let areas = |count, [width_px, height_px]: [f32; 2], gain, rate_e_per_s| {
        let (doubling_c, reference_c) = (10.0, 15.0);
        defective_areas::DefectiveAreas {
            count,
            width_px,
            height_px,
            gain,
            rate_e_per_s,
            doubling_c,
            reference_c,
        }
        .into()
    };
    let rows =
        flat::<A>(&monochrome(100, 64, &[areas(3.0, [0.0, 1.0], 0.5, 0.0)]), &SETTINGS, 800.0);
    let level = |y: usize| rows[y * 100];
    assert!(rows.chunks(100).all(|row| row.iter().all(|v| *v == row[0])), "whole rows");
    let weak: f64 = (0..64).map(|y| (800.0 / level(y)).log2().round()).sum();
    assert_eq!(weak, 3.0, "rows at half, or at a quarter where two meet");

    let hot = monochrome(100, 64, &[areas(1.0, [5.0, 3.0], 0.25, 10_000.0)]);
    // In 10 ms at ten kelvins above the reference: 200 e⁻ beside a quarter of the light.
    let v = flat::<A>(&hot, &SETTINGS, 400.0);
    let own: Vec<usize> = (0..v.len()).filter(|i| (v[*i] - 300.0).abs() < HALF).collect();
    let (x, y) = (own[0] % 100, own[0] / 100);
    let expected: Vec<usize> = (0..15).map(|i| (y + i / 5) * 100 + x + i % 5).collect();
    assert_eq!(own, expected);
    assert_eq!(v.iter().filter(|v| (**v - 400.0).abs() < HALF).count(), v.len() - 15);
    let larger = areas(1.0, [500.0, 0.0], 0.5, 0.0);
    let v = flat::<A>(&monochrome(100, 64, &[larger]), &SETTINGS, 800.0);
    assert!(v.iter().all(|v| (*v - 400.0).abs() < HALF), "as large as the sensor at most");
}

/// Rounding half a code lower is the largest whole code below: of a ramp through several codes.
fn a_converter_that_truncates_is_half_a_code_low<A: Arith>() {
    let low = black_level_offset::BlackLevelOffset {
        offset_dn: -0.5,
        per_gain_dn: 0.0,
        per_second_dn: 0.0,
        plane_0_dn: 0.0,
        plane_1_dn: 0.0,
        plane_2_dn: 0.0,
        plane_3_dn: 0.0,
        per_kelvin_dn: 0.0,
        reference_c: 25.0,
    };
    let config = monochrome(1000, 1, &[low.into()]);
    // Between codes, so that neither arithmetic's own rounding decides.
    let dn = |x: u32| f64::from(x) / 100.0 + 0.005;
    let ramp = |x: u32, _| (dn(x) / DN_PER_E) as f32;
    let codes = frame::<A>(&config, &SETTINGS, &mut Means(ramp));
    for (x, code) in codes.iter().enumerate() {
        assert_eq!(f64::from(*code), BLACK + dn(x as u32).floor(), "column {x}");
    }
}

fn hot_pixels<A: Arith>() {
    let hot = hot_pixels::HotPixels {
        fraction: 0.01,
        mean_e_per_s: 50_000.0,
        doubling_c: 7.0,
        reference_c: 25.0,
    };
    // Exponential tail above a mean of 500 e⁻, blurred by its shot noise (by less than its error).
    check_share::<A>(hot.into(), |v| v > 1500.0, 0.01 * (-1f64).exp());
}

/// A sensor of 16 bits and the largest full well but one, with effects.
fn deep(effects: &[Effect]) -> SensorConfig {
    let mut config = monochrome(70, 7, effects);
    config.full_well_e = 524_280.0;
    config.black_level_dn = 0.0;
    config
}

/// A spot of `light` on one pixel, e⁻: (the spot, beside it, above it).
fn spot<A: Arith>(effect: Effect, light: f32) -> [f64; 3] {
    let config = deep(&[effect]);
    let at = |x: u32, y: u32| if (x, y) == (64, 3) { light } else { 10.0 };
    let v = electrons(&config, &SETTINGS, &frame::<A>(&config, &SETTINGS, &mut Means(at)));
    [v[3 * 70 + 64], v[3 * 70 + 63], v[2 * 70 + 64]]
}

/// Effects of light act on all of it: a share of 10⁻³ of 10⁸ e⁻ is 10⁵ e⁻, beside 10 e⁻.
fn light_is_not_cut_before_its_effects<A: Arith>() {
    // 8 e⁻ are a step of the converter; the gains as f32 have 24 bits.
    let near = |what: &str, got: f64, want: f64| {
        assert!((got - want).abs() < 4.1 + 1e-6 * want, "{what}: {got}, expected {want}");
    };
    for light in [6e5f32, 1e6, 3.3e7, 1e8] {
        let (wide, share) = (f64::from(light), 1e-3);
        let side = share as f32;
        let crosstalk =
            optical_crosstalk::OpticalCrosstalk { side, vertical: 2.0 * side, diagonal: 0.0 };
        let [_, beside, above] = spot::<A>(crosstalk.into(), light);
        near("crosstalk beside", beside, share * wide + 10.0);
        near("crosstalk above", above, 2.0 * share * wide + 10.0);
        let blooming = blooming::Blooming { fraction: 4e-3 };
        let [_, beside, above] = spot::<A>(blooming.into(), light);
        near("blooming above", above, 2.0 * share * (wide - 524_280.0).max(0.0) + 10.0);
        near("blooming beside", beside, 10.0);
        let gain = 4e5 / light;
        let efficiency = quantum_efficiency::QuantumEfficiency { ratio: gain };
        near("efficiency", spot::<A>(efficiency.into(), light)[0], 4e5);
        let weak = defective_pixels::DefectivePixels { fraction: 1.0, gain };
        near("weak pixels", spot::<A>(weak.into(), light)[0], 4e5);
        let shorter = 1e6 * SETTINGS.exposure_s * (gain - 1.0);
        let exposure = exposure_offset::ExposureOffset { offset_us: shorter, step_us: 0.0 };
        let [exposed, ..] = spot::<A>(exposure.into(), light);
        // A difference of f32 of 10 ms.
        assert!((exposed / 4e5 - 1.0).abs() < 1e-6 / f64::from(gain), "exposure: {exposed}");
    }
}

/// Onsets and full wells at the ends of their ranges.
fn black_sun_sets_in_anywhere_in_its_range<A: Arith>() {
    for full_well_e in [1000.0f32, 20_000.0, 524_287.0] {
        for onset in [1.0f32, 100.0, 1e4] {
            let mut config = deep(&[black_sun::BlackSun { onset }.into()]);
            config.full_well_e = full_well_e;
            let dn = |light: f32| frame::<A>(&config, &SETTINGS, &mut Means(|_, _| light))[0];
            let sets_in = onset * full_well_e;
            assert!(dn(0.999 * sets_in) > 65_400, "white up to {onset} of {full_well_e}");
            assert_eq!(dn(1.001 * sets_in), 0, "black from {onset} of {full_well_e} on");
        }
    }
}

/// A gain, over the range of its parameter, multiplies the signal.
fn check_gain<A: Arith>(effect: Effect, gain: f32) {
    let config = monochrome(70, 4, &[effect]);
    let (v, gain) = (flat::<A>(&config, &FrameSettings::new(5e-4), 400.0), f64::from(gain));
    let off = v.iter().fold(0.0, |a: f64, v| a.max((v - 400.0 * gain).abs()));
    assert!(off < HALF + 1e-6 * gain, "{}: {off} off {gain}", effect.entry().kind);
}

/// Up to the largest ratio and across 8, where a factor of fixed point ends.
const RATIOS: [f32; 6] = [0.1, 1.0, 7.99, 8.0, 8.01, 10.0];

fn system_gain<A: Arith>() {
    RATIOS
        .into_iter()
        .for_each(|ratio| check_gain::<A>(system_gain::SystemGain { ratio }.into(), ratio));
}

fn gain_by_site<A: Arith>() {
    for gains in [[0.1, 1.0, 7.99, 10.0], [8.01, 8.0, 0.5, 1.0]] {
        let [plane_0, plane_1, plane_2, plane_3] = gains;
        let effect = gain_by_site::GainBySite { plane_0, plane_1, plane_2, plane_3 };
        let config = bayer(70, 4, &[effect.into()]);
        for (p, v) in flat::<A>(&config, &FrameSettings::new(5e-4), 400.0).iter().enumerate() {
            let right = 400.0 * f64::from(gains[p / 70 % 2 * 2 + p % 2]);
            assert!((v - right).abs() < HALF + 1e-6 * right, "pixel {p}: {v}, not {right}");
        }
    }
}

fn quantum_efficiency<A: Arith>() {
    let effect = |ratio| quantum_efficiency::QuantumEfficiency { ratio }.into();
    RATIOS.into_iter().for_each(|ratio| check_gain::<A>(effect(ratio), ratio));
}

/// The offsets of columns are the same in each row and frame.
fn column_offset_fpn<A: Arith>() {
    let effect = column_offset_fpn::ColumnOffsetFpn::from_values(&[9.0]);
    let config = monochrome(8192, 2, &[effect.into()]);
    let v = flat::<A>(&config, &SETTINGS, 0.0);
    near_variance("variance of columns", variance(&v[..8192]), 81.0, 8192, 0.0);
    assert_eq!(v[..8192], v[8192..]);
    assert_eq!(v, flat::<A>(&config, &SETTINGS.with_frame(7), 0.0));
    // The part of dark current: 1000 e⁻/s in 10 ms, four times that after two doublings, rows alike.
    let of = |effect: Effect, width: u32, height: u32, temperature_c: f32| {
        let config = monochrome(width, height, &[effect]);
        let v = flat::<A>(&config, &SETTINGS.with_temperature(temperature_c), 0.0);
        variance(&v)
    };
    let columns = column_offset_fpn::ColumnOffsetFpn::from_values(&[9.0, 1000.0, 6.0, 20.0]);
    let rows = row_offset_fpn::RowOffsetFpn::from_values(&[9.0, 1000.0, 6.0, 20.0]);
    for (temperature_c, dark_e) in [(20.0, 10.0), (32.0, 40.0)] {
        let right = 81.0 + dark_e * dark_e;
        near_variance("columns", of(columns.into(), 8192, 1, temperature_c), right, 8192, 0.0);
        near_variance("rows", of(rows.into(), 1, 8192, temperature_c), right, 8192, 0.0);
    }
}

/// Stuck at the converter's input: the same code whatever the gain before it.
fn stuck_pixels<A: Arith>() {
    for (level, above) in [(0.1, 6553.5), (0.5, 32_767.5), (1.0, 65_535.0)] {
        let config =
            monochrome(16, 1, &[stuck_pixels::StuckPixels { fraction: 1.0, level }.into()]);
        for gain in [0.5, 1.0, 4.0, 16.0] {
            let settings = SETTINGS.with_gain(gain);
            let dn = frame::<A>(&config, &settings, &mut Means(|_, _| 100.0));
            let want = (BLACK + above).min(65_535.0);
            assert!((f64::from(dn[0]) - want).abs() <= 1.0, "{level} at {gain}: {}", dn[0]);
        }
    }
}
