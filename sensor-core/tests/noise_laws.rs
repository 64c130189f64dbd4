//! The laws of the base model's noise (eq. 10 of Chen et al. 2009), in both arithmetics.

mod common;

use camrig_sensor_core::arith::Arith;
use camrig_sensor_core::config::SensorConfig;
use camrig_sensor_core::effects::{
    Effect, charge_coupling::ChargeCoupling, dark_current::DarkCurrent, prnu::Prnu,
    read_noise::ReadNoise, row_offset_fpn::RowOffsetFpn, row_temporal_noise::RowTemporalNoise,
    shot_noise::ShotNoise,
};
use common::*;

in_both_arithmetics! {
    shot_noise prnu read_noise dark_current
    dark_pattern_has_the_stated_spread row_offset_fpn row_temporal_noise fixed_and_temporal_parts charge_coupling
    noise_variance_agrees_with_isetcam quantisation_agrees_with_isetcam
}

/// Counts as DN: no black level, one DN per electron.
fn counter(width: u32, height: u32) -> SensorConfig {
    let mut config = monochrome(width, height, &[ShotNoise {}.into()]);
    config.full_well_e = 65_535.0;
    config.black_level_dn = 0.0;
    config
}

fn shot_noise<A: Arith>() {
    check_counts::<A>(&counter(1024, 1024));
}

#[cfg(feature = "exact-shot-noise")]
#[test]
fn exact_shot_noise() {
    use camrig_sensor_core::effects::exact_shot_noise::ExactShotNoise;
    let usual = counter(512, 512);
    let mut config = usual.clone();
    config.effects.push(ExactShotNoise {}.into()).unwrap();
    check_counts::<camrig_sensor_core::arith::Float>(&config);
    check_counts::<camrig_sensor_core::arith::Fixed>(&config);
    let counts = |c| flat::<camrig_sensor_core::arith::Float>(c, &SETTINGS, 100.0);
    assert_ne!(counts(&config), counts(&usual), "another method");
}

/// Mean, variance and chi-square against the exact law, a frame of draws for each mean.
fn check_counts<A: Arith>(config: &SensorConfig) {
    // Means that the fixed-point arithmetic holds exactly.
    for lambda in [0.0625f64, 0.75, 3.0, 9.5, 15.9375, 16.0, 20.0, 64.25, 400.0, 5000.0, 30_000.0]
    {
        let dn = frame::<A>(config, &SETTINGS, &mut Means(|_, _| lambda as f32));
        let n = dn.len() as f64;
        let counts: Vec<f64> = dn.iter().map(|&d| f64::from(d)).collect();
        near("mean", mean(&counts), lambda, (lambda / n).sqrt());
        near_variance("variance", variance(&counts), lambda, dn.len(), 1.0 / lambda);
        let top = (lambda + 8.0 * lambda.sqrt() + 12.0) as usize;
        let mut seen = vec![0.0; top + 1];
        dn.iter().for_each(|&d| seen[usize::from(d).min(top)] += 1.0);
        // Cells of at least 20 expected counts, from the left; the last takes the rest.
        let (mut chi2, mut cells, mut log_p) = (0.0, 0.0, -lambda);
        let (mut expected, mut observed, mut left, mut left_seen) = (0.0, 0.0, n, n);
        for (k, seen) in seen.iter().enumerate() {
            expected += n * log_p.exp();
            observed += seen;
            log_p += (lambda / (k as f64 + 1.0)).ln();
            if expected >= 20.0 && left - expected >= 20.0 {
                chi2 += (observed - expected).powi(2) / expected;
                cells += 1.0;
                (left, left_seen) = (left - expected, left_seen - observed);
                (expected, observed) = (0.0, 0.0);
            }
        }
        chi2 += (left_seen - left).powi(2) / left;
        near("chi-square", chi2 / cells, 1.0, (2.0 / cells).sqrt());
    }
}

fn prnu<A: Arith>() {
    let config = monochrome(512, 256, &[Prnu { sigma: 0.02 }.into()]);
    let v = flat::<A>(&config, &SETTINGS, 4000.0);
    near("mean gain", mean(&v), 4000.0, 80.0 / (v.len() as f64).sqrt());
    near_variance("variance of gains", variance(&v), 6400.0, v.len(), 0.0);
    let half = flat::<A>(&config, &SETTINGS.with_frame(5), 2000.0);
    // Both rounded to 1/8 e⁻.
    assert!(v.iter().zip(half).all(|(a, b)| (a - 2.0 * b).abs() < 0.2), "a gain, fixed");
}

fn read_noise<A: Arith>() {
    let effects = [ReadNoise { read_e: 20.0, read_e_post: 16.0 }.into()];
    let config = monochrome(512, 128, &effects);
    for analog_gain in [1.0f64, 2.0, 8.0] {
        let settings = SETTINGS.with_gain(analog_gain as f32);
        let v = flat::<A>(&config, &settings, 0.0);
        let rounding = (1.0 / DN_PER_E / analog_gain).powi(2) / 12.0;
        let expected = 400.0 - 256.0 + 256.0 / (analog_gain * analog_gain) + rounding;
        near_variance("read noise", variance(&v), expected, v.len(), 0.0);
    }
}

fn dark(mean_e_per_s: f32, dsnu_e_per_s: f32) -> DarkCurrent {
    DarkCurrent { mean_e_per_s, dsnu_e_per_s, doubling_c: 6.0, reference_c: 20.0 }
}

fn dark_current<A: Arith>() {
    let config = monochrome(256, 256, &[dark(3000.0, 0.0).into()]);
    for (exposure_s, temperature_c, expected) in [
        (0.01, 20.0, 30.0),
        (0.02, 20.0, 60.0),
        (0.01, 26.0, 60.0),
        (0.01, 44.0, 480.0),
        (0.01, 2.0, 3.75),
    ] {
        let settings = SETTINGS.with_exposure(exposure_s).with_temperature(temperature_c);
        let v = flat::<A>(&config, &settings, 0.0);
        let n = v.len();
        near("mean", mean(&v), expected, (expected / n as f64).sqrt());
        near_variance("shot noise", variance(&v), expected, n, 1.0 / expected);
    }
}

fn dark_pattern_has_the_stated_spread<A: Arith>() {
    // The last reaches below zero for one pixel in six.
    for (mean_e, spread_e) in [(200.0f64, 30.0f64), (10.0, 10.0)] {
        let effect = dark(100.0 * mean_e as f32, 100.0 * spread_e as f32);
        let config = monochrome(512, 256, &[effect.into()]);
        let settings = SETTINGS.with_temperature(20.0);
        let a = flat::<A>(&config, &settings, 0.0);
        let b = flat::<A>(&config, &settings.with_frame(1), 0.0);
        let n = a.len() as f64;
        let total = variance(&a);
        near("mean", mean(&a), mean_e, (total / n).sqrt());
        let fixed = covariance(&a, &b);
        near("variance of the pattern", fixed, spread_e * spread_e, total * (2.0 / n).sqrt());
        // Shot noise of the positive part only: E max(d, 0).
        let t = mean_e / spread_e;
        let density = (-t * t / 2.0).exp() / (2.0 * core::f64::consts::PI).sqrt();
        let share = if t > 5.0 { 1.0 } else { 0.841_344_746 };
        let positive = mean_e * share + spread_e * density;
        near("shot noise", total - fixed, positive, 2.0 * total / n.sqrt());
    }
}

fn row_offset_fpn<A: Arith>() {
    check_rows::<A>(&[RowOffsetFpn::from_values(&[12.0]).into()], [144.0, 0.0]);
}

/// New in every frame, beside what stays.
fn row_temporal_noise<A: Arith>() {
    let temporal = RowTemporalNoise { sigma_e: 5.0, gain_exponent: 0.0, opposite_e: 0.0 };
    check_rows::<A>(&[temporal.into()], [0.0, 25.0]);
    check_rows::<A>(&[RowOffsetFpn::from_values(&[12.0]).into(), temporal.into()], [144.0, 25.0]);
}

/// The variances of what rows have in common in all frames and in one, e⁻².
fn check_rows<A: Arith>(effects: &[Effect], [fixed, temporal]: [f64; 2]) {
    let config = monochrome(2, 8192, effects);
    let rows = |frame| row_means(&flat::<A>(&config, &SETTINGS.with_frame(frame), 0.0), 2);
    let (a, b) = (rows(0), rows(1));
    let (n, all) = (a.len(), fixed + temporal);
    near_variance("variance of rows", variance(&a), all, n, 0.0);
    near("fixed part", covariance(&a, &b), fixed, all * (2.0 / n as f64).sqrt());
    let (even, odd): (Vec<f64>, Vec<f64>) = a.chunks(2).map(|c| (c[0], c[1])).unzip();
    near("white over rows", correlation(&even, &odd), 0.0, (2.0 / n as f64).sqrt());
}

/// Another frame number: the same fixed pattern, other temporal noise.
fn fixed_and_temporal_parts<A: Arith>() {
    let effects = [
        ShotNoise {}.into(),
        Prnu { sigma: 0.01 }.into(),
        RowOffsetFpn::from_values(&[15.0]).into(),
        ReadNoise { read_e: 10.0, read_e_post: 0.0 }.into(),
    ];
    let config = monochrome(256, 512, &effects);
    let v = |frame, seed| {
        let mut config = config.clone();
        config.seed = seed;
        flat::<A>(&config, &SETTINGS.with_frame(frame), 3000.0)
    };
    let (a, b, other) = (v(0, 1), v(1, 1), v(0, 2));
    assert_eq!(a, v(0, 1), "repeatable");
    let (fixed, temporal) = (900.0 + 225.0, 3000.0 * 1.0001 + 100.0);
    // The row part is known from 512 rows only.
    let error =
        (2f64 / a.len() as f64).sqrt() * (fixed + temporal) + 225.0 * (2f64 / 512.0).sqrt();
    near("fixed part", covariance(&a, &b), fixed, error);
    let difference: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a - b).collect();
    near_variance("temporal part", variance(&difference) / 2.0, temporal, a.len(), 0.0);
    near("another sensor", covariance(&a, &other), 0.0, error);
}

/// White noise through a kernel: its autocorrelation is the kernel's.
fn charge_coupling<A: Arith>() {
    let (side, vertical, diagonal) = (0.03f64, 0.02f64, 0.005f64);
    let coupling =
        ChargeCoupling { side: side as f32, vertical: vertical as f32, diagonal: diagonal as f32 };
    let config = monochrome(512, 400, &[ShotNoise {}.into(), coupling.into()]);
    let mu = 2000.0;
    let v = flat::<A>(&config, &SETTINGS, mu as f32);
    let kernel = |x: i32, y: i32| match (x.abs(), y.abs()) {
        (0, 0) => 1.0 - 2.0 * (side + vertical) - 4.0 * diagonal,
        (1, 0) => side,
        (0, 1) => vertical,
        (1, 1) => diagonal,
        _ => 0.0,
    };
    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2)] {
        let pairs = (-1..=1).flat_map(|y| (-1..=1).map(move |x| (x, y)));
        let k: f64 = pairs.map(|(x, y)| kernel(x, y) * kernel(x + dx, y + dy)).sum();
        let value = lag_covariance(&v, 512, dx as usize, dy as usize);
        near(&format!("covariance {dx} {dy}"), value, mu * k, mu * (2.0 / v.len() as f64).sqrt());
    }
    near("charge is kept", mean(&v), mu, (mu / v.len() as f64).sqrt());
}

/// Rows of a golden table, or nothing with a word when it is not there.
fn golden(name: &str) -> Vec<Vec<f64>> {
    let root = std::env::var("CAMRIG_SHARED")
        .unwrap_or_else(|_| concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared").to_owned());
    let path = format!("{root}/golden/isetcam/{name}");
    let Ok(text) = std::fs::read_to_string(&path) else {
        println!("SKIP: no {path}");
        return Vec::new();
    };
    text.lines().skip(1).map(|l| l.split(',').map(|v| v.parse().unwrap()).collect()).collect()
}

/// Variance over pixels of a frame as another simulator's closed form has it: (µ + r²)(1 + p²) +
/// (µp)² + offsets² + (µ column gain)², µ with dark charge. There PRNU acts on dark charge and
/// read noise as well; here, as in eq. 10, on photo-electrons only, so those terms are subtracted.
fn noise_variance_agrees_with_isetcam<A: Arith>() {
    use camrig_sensor_core::effects::{
        column_gain_fpn::*, column_offset_fpn::*, pixel_offset_fpn::*,
    };
    const V_PER_E: f64 = 5e-5;
    let (width, height) = (2048, 64);
    for case in golden("e_noise_variance.csv") {
        let (read_e, dsnu_e, p) = (case[1], case[2] / V_PER_E, case[3] / 100.0);
        let (offset_e, gain, exposure_s) = (case[5] / V_PER_E, case[6], case[7]);
        let (signal, dark_e) = (case[8], case[9]);
        let effects = [
            ShotNoise {}.into(),
            Prnu { sigma: p as f32 }.into(),
            dark((case[4] / V_PER_E) as f32, 0.0).into(),
            PixelOffsetFpn { sigma_e: dsnu_e as f32 }.into(),
            ColumnOffsetFpn::from_values(&[offset_e as f32]).into(),
            ColumnGainFpn { sigma: gain as f32 }.into(),
            ReadNoise { read_e: read_e as f32, read_e_post: 0.0 }.into(),
        ];
        // Steps of 1/8 e⁻ for small signals, so that rounding is no matter.
        let full_well_e = 8191.0f32.max(2.5 * (signal + dark_e) as f32);
        let mut config = monochrome(width, height, &effects);
        config.full_well_e = full_well_e;
        let settings = SETTINGS.with_exposure(exposure_s as f32).with_temperature(20.0);
        let v = flat::<A>(&config, &settings, signal as f32);
        let theirs_only =
            p * p * (2.0 * signal * dark_e + dark_e * dark_e + dark_e + read_e * read_e);
        let columns = offset_e * offset_e + (gain * (signal + dark_e)).powi(2);
        let expected = case[12] - theirs_only;
        let n = v.len() as f64;
        let excess = 1.0 / (signal + dark_e).max(1.0);
        let error =
            expected * ((2.0 + excess) / n).sqrt() + columns * (2.0 / f64::from(width)).sqrt();
        if expected > 0.0 {
            near(&format!("case {} at {signal} e", case[0]), variance(&v), expected, error);
        }
    }
}

/// DN for voltages with eq. 11's step, swing / (2^bits − 1).
fn quantisation_agrees_with_isetcam<A: Arith>() {
    for row in golden("g_quantization.csv") {
        let mut config = monochrome(1, 1, &[]);
        config.bits = row[0] as u8;
        config.full_well_e = 16_000.0;
        config.black_level_dn = 0.0;
        let dn = frame::<A>(&config, &SETTINGS, &mut Means(|_, _| (row[2] / 5e-5) as f32));
        // Where the voltage is half way between two codes either will do.
        let exact = row[2] / 0.8 * f64::from(config.max_dn());
        let tie = (exact.fract() - 0.5).abs() < 1e-4;
        let got = f64::from(dn[0]);
        assert!(got == row[5] || tie && (got - exact).abs() < 0.51, "{got} for {row:?}");
    }
}
