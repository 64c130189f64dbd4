//! Empirical effects against their closed forms, in both arithmetics.

mod common;

use camrig_sensor_core::arith::Arith;
use camrig_sensor_core::config::{ConfigError, SensorConfig};
use camrig_sensor_core::effects::empirical::{Empirical, Quantity, Shape};
use camrig_sensor_core::effects::{Domain, Effect};
use common::*;
use std::f64::consts::TAU;

/// A value over column and row, and a correlation over distance.
type Place<'a> = &'a dyn Fn(f64, f64) -> f64;
type Lag<'a> = &'a dyn Fn(usize) -> f64;

/// Half a step of the test sensor and a little, e⁻.
const HALF: f64 = 0.5 / DN_PER_E + 0.01;

in_both_arithmetics! {
    seams_step_where_they_begin waves_stand_still profiles_and_maps_lie_over_the_frame
    gains_multiply_and_dark_current_has_shot_noise a_law_over_pixels_is_its_quantile_function
    line_noise_has_its_profile_and_its_exponent taps_and_lengths_give_their_covariance
    a_curve_of_the_signal_steps_and_adds_noise frames_count_from_the_start
    rows_do_not_depend_on_their_order
}

fn effect(quantity: Quantity, shape: Shape, amount: f32) -> Empirical {
    let number = |i: Option<usize>| i.unwrap() as f32;
    Empirical {
        quantity: number(Quantity::ALL.iter().position(|q| *q == quantity)),
        shape: number(Shape::ALL.iter().position(|s| *s == shape)),
        amount,
        on_signal: 0.0,
        signal_e: 1.0,
        doubling_c: 7.0,
        reference_c: 25.0,
        start: 0.0,
    }
}

/// A sensor with one empirical effect and its table.
fn sensor(width: u32, height: u32, effect: Empirical, words: &[f32]) -> SensorConfig {
    let mut config = monochrome(width, height, &[effect.into()]);
    config.table.push(words.len() as f32).unwrap();
    config.table.extend_from_slice(words).unwrap();
    config
}

/// A frame over a flat mean, e⁻.
fn shot<A: Arith>(config: &SensorConfig, frame: u32, mean_e: f32) -> Vec<f64> {
    flat::<A>(config, &SETTINGS.with_frame(frame), mean_e)
}

fn seams_step_where_they_begin<A: Arith>() {
    let words = [40.0, 0.0, 1.0, 70.0, 10.0, -0.5];
    let config = sensor(100, 20, effect(Quantity::Offset, Shape::Seam, 6.0), &words);
    for (i, v) in shot::<A>(&config, 0, 100.0).iter().enumerate() {
        let (x, y) = (i % 100, i / 100);
        let first = if x >= 40 { 6.0 } else { 0.0 };
        let second = if x >= 70 && y >= 10 { -3.0 } else { 0.0 };
        assert!((v - 100.0 - first - second).abs() < HALF, "{x}, {y}: {v}");
    }
}

fn waves_stand_still<A: Arith>() {
    let words = [0.11, 0.27, 0.1, 1.0, -0.3, 0.0, 0.0, 0.5];
    let config = sensor(130, 30, effect(Quantity::Offset, Shape::Wave, 30.0), &words);
    let first = shot::<A>(&config, 0, 100.0);
    for (i, v) in first.iter().enumerate() {
        let (x, y) = ((i % 130) as f64, (i / 130) as f64);
        let wave = (TAU * (0.11 * x + 0.27 * y + 0.1)).sin() - 0.5 * (TAU * 0.3 * x).sin();
        assert!((v - 100.0 - 30.0 * wave).abs() < HALF, "{x}, {y}: {v}");
    }
    assert_eq!(first, shot::<A>(&config, 7, 100.0));
}

fn profiles_and_maps_lie_over_the_frame<A: Arith>() {
    let profile = [0.0, 1.0, 10.0, 0.5, 99.0, 0.0];
    let along = |at: f64| {
        if at <= 10.0 { 1.0 - 0.05 * at } else { 0.5 * (99.0 - at) / 89.0 }
    };
    // Two terms: a line across times a line down, and a constant times a tent.
    let map = [2.0, 3.0, -1.0, 1.0, 0.0, 0.5, 1.0, 2.0, 2.0, 0.0, 1.0, 0.0];
    let of_map = |x: f64, y: f64| {
        let tent = 1.0 - (2.0 * y / 99.0 - 1.0).abs();
        (2.0 * x / 99.0 - 1.0) * (y / 99.0) + 2.0 * tent
    };
    let kinds: [(Shape, &[f32], Place<'_>); 3] = [
        (Shape::RowProfile, &profile, &|x, _| along(x)),
        (Shape::ColumnProfile, &profile, &|_, y| along(y)),
        (Shape::Map, &map, &of_map),
    ];
    for (shape, words, expected) in kinds {
        let config = sensor(100, 100, effect(Quantity::Offset, shape, 40.0), words);
        for (i, v) in shot::<A>(&config, 0, 200.0).iter().enumerate() {
            let want = 200.0 + 40.0 * expected((i % 100) as f64, (i / 100) as f64);
            assert!((v - want).abs() < HALF, "{shape:?}, pixel {i}: {v}, expected {want}");
        }
    }
}

fn gains_multiply_and_dark_current_has_shot_noise<A: Arith>() {
    let seam = [32.0, 0.0, 1.0];
    let config = sensor(64, 4, effect(Quantity::Gain, Shape::Seam, 0.01), &seam);
    for (i, v) in shot::<A>(&config, 0, 1000.0).iter().enumerate() {
        let want = if i % 64 < 32 { 1000.0 } else { 1010.0 };
        assert!((v - want).abs() < HALF, "{i}: {v}");
    }
    // The dark current of the right half doubles in 7 K: 2 · 50 e⁻/s · 0.2 s = 20 e⁻ more.
    let rate = effect(Quantity::Dark, Shape::Seam, 50.0);
    let config = sensor(512, 64, rate, &[256.0, 0.0, 1.0]);
    let settings = SETTINGS.with_exposure(0.2).with_temperature(32.0);
    let v = flat::<A>(&config, &settings, 100.0);
    let right: Vec<f64> = v.chunks(512).flat_map(|r| r[256..].iter().copied()).collect();
    let n = right.len();
    near("mean", mean(&right), 120.0, (20.0 / n as f64).sqrt());
    near_variance("variance", variance(&right), 20.0, n, 1.0 / 20.0);
    assert!(v.chunks(512).all(|r| r[..256].iter().all(|v| (v - 100.0).abs() < HALF)));
    // What takes charge away has no noise.
    let less = sensor(64, 2, effect(Quantity::Dark, Shape::Seam, -500.0), &seam);
    let v = shot::<A>(&less, 0, 100.0);
    assert!(
        v.iter()
            .enumerate()
            .all(|(i, v)| { (v - if i % 64 < 32 { 100.0 } else { 95.0 }).abs() < HALF })
    );
}

fn a_law_over_pixels_is_its_quantile_function<A: Arith>() {
    // e^(z/2) at knots: log-normal of spread ½, mean e^(1/8).
    let words: Vec<f32> = (-40..=40)
        .map(|i| f64::from(i) * 0.1)
        .flat_map(|z| [z as f32, (z / 2.0).exp() as f32])
        .collect();
    let config = sensor(256, 128, effect(Quantity::Offset, Shape::Distribution, 100.0), &words);
    let mut v = shot::<A>(&config, 0, 0.0);
    assert_eq!(v, shot::<A>(&config, 5, 0.0));
    let n = v.len() as f64;
    let (m, s2) = (100.0 * 0.125f64.exp(), 1e4 * 0.25f64.exp() * (0.25f64.exp() - 1.0));
    near("mean", mean(&v), m, (s2 / n).sqrt() * 1.1);
    v.sort_by(f64::total_cmp);
    // Quantiles at −1, 0 and 1: their errors are √(p(1−p)/n)/density.
    for (z, p) in [(-1.0, 0.158_655), (0.0, 0.5), (1.0, 0.841_345)] {
        let value = 100.0 * f64::exp(z / 2.0);
        let density = (-z * z / 2.0).exp() / TAU.sqrt() / (value / 2.0);
        near("quantile", v[(p * n) as usize], value, (p * (1.0 - p) / n).sqrt() / density);
    }
}

/// Covariance over frames of pixels of a row with the first, and of neighbouring rows.
fn line_noise_has_its_profile_and_its_exponent<A: Arith>() {
    let words = [0.0, 1.0, 32.0, 0.25];
    let noise = Empirical {
        on_signal: 0.5,
        signal_e: 400.0,
        ..effect(Quantity::Temporal, Shape::RowProfile, 20.0)
    };
    let config = sensor(64, 4000, noise, &words);
    for (signal, sigma) in [(100.0, 10.0f64), (400.0, 20.0)] {
        let v: Vec<f64> =
            shot::<A>(&config, 3, signal).iter().map(|v| v - f64::from(signal)).collect();
        let column = |x: usize| -> Vec<f64> { v.chunks(64).map(|r| r[x]).collect() };
        for (x, share) in [(0, 1.0), (16, 0.625), (63, 0.25)] {
            near_variance("column", variance(&column(x)), (sigma * share).powi(2), 4000, 0.0);
        }
        // One number for all pixels of a row.
        assert!(correlation(&column(0), &column(40)) > 0.999);
        near("rows", lag_covariance(&v, 64, 0, 1), 0.0, sigma * sigma / 4000f64.sqrt());
    }
    let config = sensor(4096, 40, effect(Quantity::Temporal, Shape::ColumnFlat, 5.0), &[]);
    let v = shot::<A>(&config, 1, 100.0);
    near_variance("columns", variance(&v[..4096]), 25.0, 4096, 0.0);
    assert!(v.chunks(4096).all(|r| r == &v[..4096]));
}

fn taps_and_lengths_give_their_covariance<A: Arith>() {
    let (w, h) = (512usize, 128usize);
    let n = (w * h) as f64;
    // √0.84 (1, 0.4, 0.16, 0.064): nearly the correlation 0.4^h, exactly that of the taps.
    let taps = [1.0, 0.4, 0.16, 0.064f64];
    let power: f64 = taps.iter().map(|t| t * t).sum();
    let of_taps = |lag: usize| {
        taps.iter().zip(taps.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>() / power
    };
    let of_length = |lag: usize| (-(lag as f64) / 9.0).exp();
    let tap_words = taps.map(|t| t as f32);
    let laws: [(&[f32], Lag<'_>, f64); 2] =
        [(&tap_words, &of_taps, 1.7), (&[9.0], &of_length, 18.0)];
    for (i, (values, expected, apart)) in laws.into_iter().enumerate() {
        for down in [0.0, 1.0] {
            let words = [&[down, i as f32], values].concat();
            let noise = effect(Quantity::Temporal, Shape::Correlation, 12.0);
            let config = sensor(w as u32, h as u32, noise, &words);
            let v: Vec<f64> = shot::<A>(&config, 2, 500.0).iter().map(|v| v - 500.0).collect();
            // Correlated pixels carry less information: Σ ρ² over lags of both signs.
            let error = 144.0 * (2.0 * apart / n).sqrt();
            near("mean", mean(&v), 0.0, 12.0 * (2.0 * apart / n).sqrt());
            for lag in [0, 1, 2, 3, 9, 18] {
                let (dx, dy) = if down == 0.0 { (lag, 0) } else { (0, lag) };
                let want = 144.0 * expected(lag);
                near("covariance", lag_covariance(&v, w, dx, dy), want, error);
            }
            let (dx, dy) = if down == 0.0 { (0, 1) } else { (1, 0) };
            near("across", lag_covariance(&v, w, dx, dy), 0.0, error);
            let other = shot::<A>(&config, 3, 500.0);
            near("frames", correlation(&v, &other), 0.0, (apart / n).sqrt());
        }
    }
}

fn a_curve_of_the_signal_steps_and_adds_noise<A: Arith>() {
    // Above 5000 e⁻: 1.005 times, with 24 e⁻ of noise.
    let words = [5000.0, 0.0, 0.0, 5000.0, 25.0, 24.0, 8000.0, 40.0, 24.0];
    let config = sensor(512, 64, effect(Quantity::Response, Shape::SignalCurve, 1.0), &words);
    assert!(shot::<A>(&config, 0, 4999.0).iter().all(|v| (v - 4999.0).abs() < HALF));
    let v = shot::<A>(&config, 0, 7000.0);
    near("mean", mean(&v), 7035.0, 24.0 / (v.len() as f64).sqrt());
    near_variance("variance", variance(&v), 576.0, v.len(), 0.0);
}

fn frames_count_from_the_start<A: Arith>() {
    // The first frame has the number 0xfffffffe: numbers go on from 0.
    let words = [65_535.0, 65_534.0, 0.0, 1.0, 4.0, 0.2, 4.0, 0.0];
    let config = sensor(40, 3, effect(Quantity::Offset, Shape::FrameCurve, 50.0), &words);
    for (i, more) in [50.0, 40.0, 30.0, 20.0, 0.0, 0.0].into_iter().enumerate() {
        let v = shot::<A>(&config, 0xffff_fffe_u32.wrapping_add(i as u32), 100.0);
        assert!(v.iter().all(|v| (v - 100.0 - more).abs() < HALF), "{i}: {}", v[0]);
    }
    assert!((shot::<A>(&config, 7, 100.0)[0] - 100.0).abs() < HALF);
}

fn rows_do_not_depend_on_their_order<A: Arith>() {
    for words in [&[0.0, 1.0, 7.0][..], &[1.0, 1.0, 7.0], &[1.0, 0.0, 0.9, 0.3, 0.1]] {
        let config = sensor(200, 8, effect(Quantity::Temporal, Shape::Correlation, 30.0), words);
        let mut light = Means(|_, _| 500.0);
        let rising = frame::<A>(&config, &SETTINGS, &mut light);
        let rows = [5, 2, 7, 0, 1, 6, 3, 4];
        let mixed = rows_of::<A>(&config, &SETTINGS, &mut light, &rows);
        for (row, found) in rows.into_iter().zip(mixed.chunks(200)) {
            assert_eq!(found, &rising[row as usize * 200..][..200], "row {row}");
        }
    }
}

#[test]
fn tables_that_are_none_are_refused() {
    let good = sensor(8, 2, effect(Quantity::Offset, Shape::Seam, 1.0), &[4.0, 0.0, 1.0]);
    assert_eq!(good.check(), Ok(()));
    let refused = |quantity, shape, words: &[f32]| {
        sensor(8, 2, effect(quantity, shape, 1.0), words).check()
            == Err(ConfigError::Table { position: 0 })
    };
    use Quantity::*;
    assert!(refused(Offset, Shape::Seam, &[]) && refused(Offset, Shape::Seam, &[4.0, 0.0]));
    assert!(refused(Offset, Shape::Seam, &[4.0, 0.0, f32::NAN]));
    assert!(refused(Temporal, Shape::Seam, &[4.0, 0.0, 1.0]));
    assert!(refused(Offset, Shape::RowFlat, &[]) && refused(Gain, Shape::SignalCurve, &[0.0; 3]));
    assert!(refused(Dark, Shape::Wave, &[0.1; 3]));
    assert!(refused(Offset, Shape::RowProfile, &[2.0, 0.0, 1.0, 0.0]));
    assert!(refused(Offset, Shape::Map, &[2.0, 2.0, 1.0, 1.0, 1.0]));
    assert!(refused(Offset, Shape::Map, &[-2.0, 2.0, 1.0, 1.0]));
    assert!(refused(Temporal, Shape::Correlation, &[0.0, 1.0, 0.0]));
    assert!(refused(Temporal, Shape::Correlation, &[0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0]));
    assert!(refused(Response, Shape::SignalCurve, &[1.0, 1.0]));
    assert!(refused(Offset, Shape::FrameCurve, &[0.0, 0.0, 1.0]));
    assert!(refused(Offset, Shape::FrameCurve, &[0.5, 0.0, 0.0, 1.0]));
    assert!(refused(Offset, Shape::FrameCurve, &[0.0, 65_536.0, 0.0, 1.0]));
    assert!(refused(Gain, Shape::FrameCurve, &[0.0, 0.0, 0.0, 1.0]));
    // The number of words reaches beyond the table, or the table begins beyond its end.
    for start in [1.0, 1023.0] {
        let mut bad = good.clone();
        bad.effects[0] = Empirical { start, ..effect(Offset, Shape::Seam, 1.0) }.into();
        assert_eq!(bad.check(), Err(ConfigError::Table { position: 0 }), "{start}");
    }
    let said = ConfigError::Table { position: 3 }.to_string();
    assert!(said.contains("effect 3 has no table of its form"), "{said}");
}

#[test]
fn each_acts_where_its_quantity_is() {
    let of = |quantity, shape| Effect::from(effect(quantity, shape, 1.0)).domain();
    assert_eq!(of(Quantity::Offset, Shape::Wave), Domain::Voltage);
    assert_eq!(of(Quantity::Gain, Shape::Wave), Domain::Photo);
    assert_eq!(of(Quantity::Gain, Shape::Seam), Domain::Voltage);
    assert_eq!(of(Quantity::Dark, Shape::Seam), Domain::Charge);
    for (i, quantity) in Quantity::ALL.into_iter().enumerate() {
        assert_eq!(
            Empirical { quantity: i as f32, ..effect(quantity, Shape::Seam, 1.0) }.quantity(),
            quantity
        );
    }
    for shape in Shape::ALL {
        assert_eq!(effect(Quantity::Offset, shape, 1.0).shape(), shape);
    }
}
