//! The statistic by which each temporal effect shows itself, against its closed form, in both
//! arithmetics.
//!
//! Tolerances are 4.5 standard errors of the sample (`near`); where the error has no simple form
//! it is taken from the scatter over independent frames or pixels.

mod common;

use camrig_sensor_core::arith::{Arith, BLOCK};
use camrig_sensor_core::config::{FrameSettings, SensorConfig};
use camrig_sensor_core::effects::*;
use common::*;
use std::collections::BTreeMap;

/// Variance of rounding to the test sensor's DN, e⁻².
const ROUNDING: f64 = 1.0 / 12.0 / (DN_PER_E * DN_PER_E);

in_both_arithmetics! {
    noise_follows_a_power_of_the_gain row_noise_of_opposite_sign column_temporal_noise row_correlated_noise periodic_pattern_noise read_noise_spread
    random_telegraph_noise dark_current_telegraph_noise telegraph_noise_of_two_samples
    heavy_tailed_read_noise reset_noise frame_offset_noise flicker_banding
    what_lags_is_charge_that_was_held crosstalk_of_the_frame_before_lags
    less_light_has_its_own_shot_noise much_light_has_the_law_of_poisson
    light_flicker brighter_fatter optical_crosstalk colours_of_the_border image_lag
    amp_glow dark_current_gradient particle_hits tracks_cross_rows_and_columns frame_offset_by_site
    dark_current_by_site charge_transfer_inefficiency
    persistence traps_of_two_time_constants
}

fn at(frame: u32) -> FrameSettings {
    SETTINGS.with_frame(frame)
}

/// Mean of independent estimates and its standard error.
fn estimate(values: &[f64]) -> (f64, f64) {
    (mean(values), (variance(values) / values.len() as f64).sqrt())
}

/// The mean of even and odd columns has one part, half their difference the other; rounding of each
/// adds half of its variance to both.
fn row_noise_of_opposite_sign<A: Arith>() {
    let noise = row_temporal_noise::RowTemporalNoise {
        sigma_e: 30.0,
        gain_exponent: 0.0,
        opposite_e: 20.0,
    }
    .into();
    let config = monochrome(4, 4096, &[noise]);
    let frame = |f: u32| flat::<A>(&config, &at(f), 4000.0);
    let part = |frame: &[f64], sign: f64| -> Vec<f64> {
        frame.chunks(4).map(|row| 0.5 * (row[0] + sign * row[1])).collect()
    };
    let (a, b) = (frame(0), frame(1));
    assert!(a.chunks(4).all(|row| row[0] == row[2] && row[1] == row[3]), "two offsets per row");
    let (common, opposite) = (part(&a, 1.0), part(&a, -1.0));
    near_variance("common", variance(&common), 900.0 + 0.5 * ROUNDING, 4096, 0.0);
    near_variance("opposite", variance(&opposite), 400.0 + 0.5 * ROUNDING, 4096, 0.0);
    let chance = 4096f64.powf(-0.5);
    near("parts are independent", correlation(&common, &opposite), 0.0, chance);
    near("frames are independent", correlation(&opposite, &part(&b, -1.0)), 0.0, chance);
}

fn column_temporal_noise<A: Arith>() {
    let config = monochrome(
        4096,
        2,
        &[column_temporal_noise::ColumnTemporalNoise { sigma_e: 20.0, gain_exponent: 0.0 }.into()],
    );
    let (a, b) = (flat::<A>(&config, &at(0), 0.0), flat::<A>(&config, &at(1), 0.0));
    let (first, second) = a.split_at(4096);
    assert_eq!(first, second, "one offset per column");
    near_variance("variance over columns", variance(first), 400.0 + ROUNDING, 4096, 0.0);
    near("frames are independent", correlation(first, &b[..4096]), 0.0, 4096f64.powf(-0.5));
}

/// σ G^p: at gain 4, the same frame with p has σ 4^p times as large.
fn noise_follows_a_power_of_the_gain<A: Arith>() {
    let kinds = [
        "row-temporal-noise",
        "column-temporal-noise",
        "row-correlated-noise",
        "periodic-pattern-noise",
        "heavy-tailed-read-noise",
        "frame-offset-noise",
    ];
    for kind in kinds {
        let entry = Effect::CATALOGUE.iter().find(|e| e.kind == kind).unwrap();
        let of = |amplitude_e: f32, p: f32| {
            let mut values: Vec<f32> =
                entry.parameters.iter().map(|p| p.default.unwrap_or(0.1)).collect();
            let exponent = entry.parameters.iter().position(|p| p.key == "gain_exponent");
            (values[0], values[exponent.unwrap()]) = (amplitude_e, p);
            let effect = Effect::new(entry.id, &values).unwrap();
            flat::<A>(&monochrome(64, 32, &[effect]), &SETTINGS.with_gain(4.0), 0.0)
        };
        for p in [-1.0f32, -0.4, 1.0] {
            let right = of(6.0 * 4f32.powf(p), 0.0);
            let far =
                of(6.0, p).iter().zip(&right).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(far <= 1.0 / DN_PER_E / 4.0, "{kind}, exponent {p}: {far} e- off");
        }
    }
}

/// The power spectrum of rows' offsets, octave by octave, against its closed form at heights near a
/// power of two, far from one and odd, and that form against the law.
fn row_correlated_noise<A: Arith>() {
    // Most that the closed form is off the law, rms over ln f, as the effect's documentation has
    // it.
    for (exponent, limit) in [(0.7, 0.05), (1.0, 0.08), (1.4, 0.17)] {
        for height in [75, 192, 256, 480, 1000] {
            let power = power_of_rows(f64::from(height), exponent);
            // Its ratio to f^-a and the square of that, over ln f.
            let bins: Vec<f64> = (1..).zip(&power).map(|(k, _)| f64::from(k)).collect();
            let over_ln_f = |degree: i32| {
                let all = bins.iter().zip(&power);
                let each = all.map(|(k, p)| (p * k.powf(exponent)).powi(degree) / k);
                each.sum::<f64>() / bins.iter().map(|k| 1.0 / k).sum::<f64>()
            };
            let off = (over_ln_f(2) / over_ln_f(1).powi(2) - 1.0).sqrt();
            assert!(off < limit, "{height} rows, exponent {exponent}: {off} off the law");
            follows_spectrum::<A>(height, exponent, &power);
        }
    }
}

/// Power of rows' offsets of variance 1, at 1, 2 ... cycles per frame.
fn power_of_rows(height: f64, exponent: f64) -> Vec<f64> {
    let octaves = height.log2().floor();
    let mut cells: Vec<(f64, f64)> = (1..=octaves as i32).map(|k| (2f64.powi(k), 1.0)).collect();
    cells[0].1 = 1.0 - 0.4 * exponent;
    let all_rows = (height / 2.0).floor() * 2.0;
    cells.push((all_rows, all_rows.log2() - octaves));
    let share = |(length, weight): (f64, f64)| weight * length.powf(exponent - 1.0);
    let total: f64 = cells.iter().map(|c| share(*c)).sum();
    let at = |k: i32| {
        let angle = core::f64::consts::PI * f64::from(k) / height;
        let of = |length: f64| 4.0 * (angle * length / 2.0).sin().powi(4) / length;
        let sum: f64 = cells.iter().map(|c| share(*c) * of(c.0)).sum();
        sum / angle.sin().powi(2) / total
    };
    (1..=(height / 2.0) as i32).map(at).collect()
}

fn follows_spectrum<A: Arith>(height: u32, exponent: f64, power: &[f64]) {
    let (sigma_e, rows) = (30.0, f64::from(height));
    let effect = row_correlated_noise::RowCorrelatedNoise {
        sigma_e,
        exponent: exponent as f32,
        gain_exponent: 0.0,
    };
    let config = monochrome(1, height, &[effect.into()]);
    let square = f64::from(sigma_e).powi(2);
    let mut variances = Vec::new();
    // Means of measured over expected power over octaves of frequency, of each frame.
    let mut octaves = vec![Vec::new(); height.ilog2() as usize];
    for frame in 0..100 {
        let offsets = flat::<A>(&config, &at(frame), 0.0);
        near("mean of a frame", mean(&offsets), 0.0, (ROUNDING / rows).sqrt());
        variances.push(offsets.iter().map(|v| v * v).sum::<f64>() / rows);
        let ratio = |k: usize| {
            // Goertzel 1958: the Fourier transform's square at one frequency.
            let twice_cos = 2.0 * (core::f64::consts::TAU * k as f64 / rows).cos();
            let (a, b) = offsets.iter().fold((0.0, 0.0), |(a, b), v| (v + twice_cos * a - b, a));
            (a * a + b * b - twice_cos * a * b) / rows / (square * power[k - 1] + ROUNDING)
        };
        for (octave, ratios) in octaves.iter_mut().enumerate() {
            let bins = 1 << octave..(2 << octave).min(power.len() + 1);
            ratios.push(mean(&bins.map(ratio).collect::<Vec<_>>()));
        }
    }
    for (octave, ratios) in octaves.iter().enumerate() {
        let (value, error) = estimate(ratios);
        let from = 1 << octave;
        let what =
            format!("{height} rows, exponent {exponent}, power from {from} cycles per frame");
        near(&what, value, 1.0, error);
    }
    let (value, error) = estimate(&variances);
    near("variance of rows", value, square + ROUNDING, error);
}

fn periodic_pattern_noise<A: Arith>() {
    let effect = periodic_pattern_noise::PeriodicPatternNoise {
        amplitude_e: 40.0,
        cycles_per_column: 37.0 / 256.0,
        cycles_per_row: -11.0 / 64.0,
        gain_exponent: 0.0,
    };
    let config = monochrome(256, 64, &[effect.into()]);
    let phase = |frame| {
        let v = flat::<A>(&config, &at(frame), 0.0);
        let (mut s, mut c) = (0.0, 0.0);
        for (i, v) in v.iter().enumerate() {
            let (x, y) = ((i % 256) as f64, (i / 256) as f64);
            let angle = core::f64::consts::TAU * (37.0 / 256.0 * x - 11.0 / 64.0 * y);
            s += v * angle.sin();
            c += v * angle.cos();
        }
        let n = v.len() as f64 / 2.0;
        let amplitude = s.hypot(c) / n;
        // Rounding to DN (0.036 e⁻) averages out over the 256 phases.
        assert!((amplitude - 40.0).abs() < 0.02, "{amplitude}");
        assert!((variance(&v) - 800.0).abs() < 0.6, "nothing but the wave: {}", variance(&v));
        c.atan2(s)
    };
    assert!((phase(0) - phase(1)).abs() > 1e-3, "another phase in each frame");
}

fn read_noise_spread<A: Arith>() {
    let (r, s, n) = (40.0f64, 0.3f64, 48usize);
    let effects = [
        read_noise::ReadNoise { read_e: r as f32, read_e_post: 0.0 }.into(),
        read_noise_spread::ReadNoiseSpread { spread: s as f32 }.into(),
    ];
    let config = monochrome(128, 64, &effects);
    let frames: Vec<Vec<f64>> = (0..n as u32).map(|f| flat::<A>(&config, &at(f), 0.0)).collect();
    let variances: Vec<f64> = (0..frames[0].len())
        .map(|i| variance(&frames.iter().map(|f| f[i]).collect::<Vec<_>>()) - ROUNDING)
        .collect();
    let (value, error) = estimate(&variances);
    near("mean variance", value, r * r * (2.0 * s * s).exp(), error);
    let squares: Vec<f64> = variances.iter().map(|v| v * v).collect();
    let (value, error) = estimate(&squares);
    let expected = r.powi(4) * (8.0 * s * s).exp() * (1.0 + 2.0 / (n as f64 - 1.0));
    near("mean square of variances", value, expected, error);
}

fn random_telegraph_noise<A: Arith>() {
    let (f, q, d) = (0.1, 0.25f64, 0.4f64);
    let effect = random_telegraph_noise::RandomTelegraphNoise {
        fraction: f as f32,
        amplitude_e: 100.0,
        renewal: q as f32,
        duty: d as f32,
        spread: 1.0,
        between_samples: 0.0,
        down: 0.0,
    };
    let config = monochrome(128, 64, &[effect.into()]);
    let frames: Vec<Vec<f64>> = (0..160).map(|f| flat::<A>(&config, &at(f), 0.0)).collect();
    let series = (0..frames[0].len()).map(|i| frames.iter().map(|f| f[i]).collect::<Vec<f64>>());
    // Above a few DN: traps that can be seen, as series of 0 and 1.
    let traps: Vec<(f64, Vec<f64>)> = series
        .filter_map(|v| {
            let top = v.iter().fold(0.0f64, |a, &b| a.max(b));
            (top > 1.0).then(|| (top, v.iter().map(|v| f64::from(*v > top / 2.0)).collect()))
        })
        .collect();
    let n = frames[0].len() as f64;
    let seen = f * (-1.0f64 / 100.0).exp();
    near("pixels with a trap", traps.len() as f64, n * seen, (n * seen).sqrt());
    let amplitudes: Vec<f64> = traps.iter().map(|t| t.0).collect();
    let (value, error) = estimate(&amplitudes);
    near("mean amplitude", value, 101.0, error);
    let (value, error) = estimate(&traps.iter().map(|t| mean(&t.1)).collect::<Vec<_>>());
    near("time in the upper level", value, d, error);
    for lag in [1usize, 3] {
        let products: Vec<f64> = traps
            .iter()
            .map(|(_, b)| {
                mean(&b.iter().zip(&b[lag..]).map(|(a, b)| (a - d) * (b - d)).collect::<Vec<_>>())
            })
            .collect();
        let (value, error) = estimate(&products);
        near("autocovariance", value, d * (1.0 - d) * (1.0 - q).powi(lag as i32), error);
    }
}

/// Correlated double sampling of a trap: the levels −A, 0 and A, the outer ones with probability
/// s d(1 − d) each; and of one sample, jumps of which a share goes down.
fn telegraph_noise_of_two_samples<A: Arith>() {
    let (s, d) = (0.3f64, 0.4f64);
    let shares = |down: f32, between_samples: f32| {
        let effect = random_telegraph_noise::RandomTelegraphNoise {
            fraction: 1.0,
            amplitude_e: 100.0,
            renewal: 0.5,
            duty: d as f32,
            spread: 0.0,
            between_samples,
            down,
        };
        let v = flat::<A>(&monochrome(512, 128, &[effect.into()]), &at(3), 0.0);
        assert!(v.iter().all(|v| [-100.0, 0.0, 100.0].contains(v)));
        [-100.0, 100.0].map(|level| v.iter().filter(|v| **v == level).count() as f64 / 65_536.0)
    };
    let near_all = |got: [f64; 2], right: [f64; 2]| {
        for (got, p) in got.into_iter().zip(right) {
            near("share of a level", got, p, (p * (1.0 - p) / 65_536.0).sqrt());
        }
    };
    let outer = s * d * (1.0 - d);
    near_all(shares(0.0, s as f32), [outer, outer]);
    near_all(shares(0.0, 1.0), [d * (1.0 - d), d * (1.0 - d)]);
    near_all(shares(0.25, 0.0), [0.25 * d, 0.75 * d]);
}

/// Of the chosen pixels' excess m = a t, on in the share d of the frames: mean f d m, and between
/// exposures of 1 : 4 the variance over frames grows as f m² (2 d − d²) + …, with the exposure
/// squared where the charge is large.
fn dark_current_telegraph_noise<A: Arith>() {
    let (f, d, rate) = (0.05, 0.4f64, 20_000.0f64);
    let effect = dark_current_telegraph_noise::DarkCurrentTelegraphNoise {
        fraction: f as f32,
        mean_e_per_s: rate as f32,
        renewal: 0.5,
        duty: d as f32,
        doubling_c: 7.0,
        reference_c: 25.0,
    };
    let config = monochrome(128, 64, &[effect.into()]);
    let of = |exposure_s: f32| {
        let take = |i| flat::<A>(&config, &at(i).with_exposure(exposure_s), 0.0);
        let frames: Vec<Vec<f64>> = (0..60).map(take).collect();
        let pixels = (0..frames[0].len()).map(|i| frames.iter().map(|f| f[i]).collect::<Vec<_>>());
        let pixels: Vec<Vec<f64>> = pixels.filter(|v| v.iter().any(|v| *v > 4.0)).collect();
        let means: Vec<f64> = pixels.iter().map(|v| mean(v)).collect();
        let variances: Vec<f64> = pixels.iter().map(|v| variance(v)).collect();
        (pixels.len() as f64, estimate(&means), estimate(&variances))
    };
    let [(count, (short, error), (low, low_error)), (_, (long, _), (high, high_error))] =
        [0.01, 0.04].map(of);
    // Those whose jump is above the limit: e^(−4/200).
    let expected = f * 128.0 * 64.0 * (-4.0f64 / 200.0).exp();
    near("pixels that blink", count, expected, expected.sqrt());
    near("mean", short, d * (rate * 0.01 + 4.0), error);
    assert!((long / short / 4.0 - 1.0).abs() < 0.1, "{long} {short}");
    // Variance of a switched charge, ⟨m²⟩ d (1 − d) with ⟨m²⟩ = 2 ⟨m⟩², and its shot noise.
    let expected = |m: f64| 2.0 * m * m * d * (1.0 - d) + d * m;
    near("variance, short", low, expected(rate * 0.01), low_error + 0.04 * low);
    near("variance, long", high, expected(rate * 0.04), high_error + 0.04 * high);
}

fn heavy_tailed_read_noise<A: Arith>() {
    for lambda in [-0.2f64, 0.0, 0.14] {
        let effect = heavy_tailed_read_noise::HeavyTailedReadNoise {
            sigma_e: 50.0,
            lambda: lambda as f32,
            gain_exponent: 0.0,
        };
        let config = monochrome(512, 256, &[effect.into()]);
        let v = flat::<A>(&config, &at(0), 0.0);
        let quantile = |u: f64| {
            if lambda == 0.0 {
                (u / (1.0 - u)).ln()
            } else {
                (u.powf(lambda) - (1.0 - u).powf(lambda)) / lambda
            }
        };
        // Moments and tail of the law by the midpoint rule.
        let points = 1 << 20;
        let q: Vec<f64> =
            (0..points).map(|i| quantile((i as f64 + 0.5) / points as f64)).collect();
        let var = mean(&q.iter().map(|q| q * q).collect::<Vec<_>>());
        let kurtosis = mean(&q.iter().map(|q| q.powi(4)).collect::<Vec<_>>()) / (var * var);
        let tail = q.iter().filter(|q| q.abs() > 3.0 * var.sqrt()).count() as f64 / points as f64;
        let n = v.len() as f64;
        near("variance", variance(&v), 2500.0 + ROUNDING, 2500.0 * ((kurtosis - 1.0) / n).sqrt());
        let beyond = v.iter().filter(|v| v.abs() > 150.0).count() as f64;
        near("beyond three deviations", beyond, n * tail, (n * tail).sqrt());
    }
}

fn reset_noise<A: Arith>() {
    let effect = reset_noise::ResetNoise { capacitance_ff: 10.0, remaining: 1.0 };
    let config = monochrome(512, 128, &[effect.into()]);
    for celsius in [-25.0f64, 25.0] {
        let settings = SETTINGS.with_temperature(celsius as f32);
        let v = flat::<A>(&config, &settings, 0.0);
        let (k, q) = (1.380_649e-23, 1.602_176_634e-19);
        let expected = k * (celsius + 273.15) * 10e-15 / (q * q);
        near_variance("kTC", variance(&v), expected + ROUNDING, v.len(), 0.0);
    }
}

fn frame_offset_noise<A: Arith>() {
    for phi in [0.0f64, 0.8] {
        let effect = frame_offset_noise::FrameOffsetNoise {
            sigma_e: 25.0,
            correlation: phi as f32,
            gain_exponent: 0.0,
        };
        let config = monochrome(2, 2, &[effect.into()]);
        let n = 4000;
        let o: Vec<f64> = (0..n)
            .map(|f| {
                let v = flat::<A>(&config, &at(f), 0.0);
                assert!(v.iter().all(|&x| x == v[0]), "one offset per frame");
                v[0]
            })
            .collect();
        // Variance of moments of a first-order autoregression (Bartlett).
        let spread = (2.0 * (1.0 + phi * phi) / (1.0 - phi * phi) / f64::from(n)).sqrt();
        near(
            "variance",
            mean(&o.iter().map(|o| o * o).collect::<Vec<_>>()),
            625.0,
            625.0 * spread,
        );
        let error = ((1.0 - phi * phi) / f64::from(n)).sqrt();
        near("correlation of frames", correlation(&o[1..], &o[..o.len() - 1]), phi, error);
    }
}

fn flicker_banding<A: Arith>() {
    // 24 whole periods over the rows; the exposure is a third of a period.
    let (f, row_time) = (100.0, 1.0 / 100.0 / 16.0);
    let effect = flicker_banding::FlickerBanding {
        depth: 0.5,
        frequency_hz: f as f32,
        row_time_us: (row_time * 1e6) as f32,
        plane_0: 0.6,
        plane_1: 1.0,
        plane_2: 1.5,
        plane_3: 0.0,
        plane_1_lag_deg: 8.0,
        plane_2_lag_deg: -12.5,
        plane_3_lag_deg: 0.0,
    };
    let settings = SETTINGS.with_exposure(1.0 / 300.0);
    // Of the wave of every second row from `first` on: amplitude, and angle in degrees.
    let wave = |v: &[f64], first: usize| {
        let (mut s, mut c) = (0.0, 0.0);
        for (i, v) in v.iter().enumerate() {
            let angle = core::f64::consts::TAU * f * row_time * (first + 2 * i) as f64;
            s += v * angle.sin();
            c += v * angle.cos();
        }
        [s.hypot(c) / (0.5 * v.len() as f64), c.atan2(s).to_degrees()]
    };
    let third = core::f64::consts::PI / 3.0;
    let expected = 2000.0 * 0.5 * third.sin() / third;
    let v = flat::<A>(&bayer(2, 384, &[effect.into()]), &settings, 2000.0);
    let waves = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[x, y]: [usize; 2]| {
        let site: Vec<f64> = v.iter().skip(2 * y + x).step_by(4).copied().collect();
        assert!((mean(&site) - 2000.0).abs() < 0.05);
        wave(&site, y)
    });
    for (own, [ratio, lag]) in waves.into_iter().zip([[0.6, 0.0], [1.0, 8.0], [1.5, -12.5]]) {
        assert!((own[0] - ratio * expected).abs() < 0.05, "{waves:?}, {ratio}, {expected}");
        let later = (waves[0][1] - own[1] + 540.0).rem_euclid(360.0) - 180.0;
        assert!((later - lag).abs() < 0.02, "{waves:?}, {lag}");
    }
    assert!(waves[3][0] < 0.05, "{waves:?}");
    let config = monochrome(4, 384, &[effect.into()]);
    let whole_period = SETTINGS.with_exposure(0.01);
    let v = flat::<A>(&config, &whole_period, 2000.0);
    assert!(variance(&v) < 0.01, "a whole period averages out");
}

fn light_flicker<A: Arith>() {
    let config = monochrome(2, 2, &[light_flicker::LightFlicker { sigma: 0.02 }.into()]);
    let v: Vec<f64> = (0..2000).map(|f| mean(&flat::<A>(&config, &at(f), 3000.0))).collect();
    near_variance("variance over frames", variance(&v), 3600.0, v.len(), 0.0);
}

fn brighter_fatter<A: Arith>() {
    let (mu, a) = (3000.0f64, 1e-5f64);
    let effects = [
        shot_noise::ShotNoise {}.into(),
        brighter_fatter::BrighterFatter { coefficient: a as f32 }.into(),
    ];
    let config = monochrome(512, 400, &effects);
    let v = flat::<A>(&config, &at(0), mu as f32);
    let plain = flat::<A>(&monochrome(512, 400, &effects[..1]), &at(0), mu as f32);
    assert!((mean(&v) - mean(&plain)).abs() < 0.01, "charge is kept");
    let b = a * mu;
    let var = mu * ((1.0 - 4.0 * b).powi(2) + 4.0 * b * b);
    let cov = mu * 2.0 * b * (1.0 - 4.0 * b);
    let n = v.len() as f64;
    // Second order in the noise: below a tenth of a percent at 3000 e⁻.
    near("variance", variance(&v), var, var * (2.0 / n).sqrt() + 1e-3 * var);
    let (side, below) = (lag_covariance(&v, 512, 1, 0), lag_covariance(&v, 512, 0, 1));
    near("covariance of columns", side, cov, var / n.sqrt());
    near("covariance of rows", below, cov, var / n.sqrt());
}

fn optical_crosstalk<A: Arith>() {
    let effects = [
        optical_crosstalk::OpticalCrosstalk { side: 0.05, vertical: 0.03, diagonal: 0.01 }.into(),
        shot_noise::ShotNoise {}.into(),
    ];
    let spot = |x: u32, y: u32| if (x, y) == (65, 2) { 4000.0 } else { 0.0 };
    let config = monochrome(130, 5, &effects[..1]);
    let v = electrons(&config, &SETTINGS, &frame::<A>(&config, &SETTINGS, &mut Means(spot)));
    let around = |y: usize| v[y * 130 + 64..y * 130 + 67].to_vec();
    let near_all = |a: Vec<f64>, b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.07);
    assert!(near_all(around(1), [40.0, 120.0, 40.0]), "{:?}", around(1));
    assert!(near_all(around(2), [200.0, 0.80 * 4000.0, 200.0]), "{:?}", around(2));
    assert!((v.iter().sum::<f64>() - 4000.0).abs() < 0.5, "light is kept");
    let config = monochrome(512, 200, &effects);
    let v = flat::<A>(&config, &at(0), 1000.0);
    let (side, below) = (lag_covariance(&v, 512, 1, 0), lag_covariance(&v, 512, 0, 1));
    let error = 1000.0 / (v.len() as f64).sqrt();
    near("noise stays independent", side, 0.0, error);
    near("noise stays independent", below, 0.0, error);
}

/// Beyond its edges the array goes on as its mirror image: in even light of a colour a Bayer
/// sensor's pixels at the border are as those of their channel inside.
fn colours_of_the_border<A: Arith>() {
    let effects: [Effect; 4] = [
        optical_crosstalk::OpticalCrosstalk { side: 0.05, vertical: 0.03, diagonal: 0.01 }.into(),
        charge_coupling::ChargeCoupling { side: 0.04, vertical: 0.06, diagonal: 0.02 }.into(),
        brighter_fatter::BrighterFatter { coefficient: 1e-5 }.into(),
        blooming::Blooming { fraction: 0.5 }.into(),
    ];
    // Of four channels one is beyond full well, for blooming.
    let mosaic = |x: u32, y: u32| [500.0, 1000.0, 3000.0, 9000.0][(x % 2 + 2 * (y % 2)) as usize];
    for effect in effects {
        for (width, height) in [(BLOCK as u32 + 3, 6), (2 * BLOCK as u32, 7), (5, 4)] {
            let config = bayer(width, height, &[effect]);
            let dn = frame::<A>(&config, &SETTINGS, &mut Means(mosaic));
            for (i, v) in (0..).zip(&dn) {
                let (x, y) = (i % width, i / width);
                let inside = dn[((2 + y % 2) * width + 2 + x % 2) as usize];
                assert_eq!(
                    *v,
                    inside,
                    "{} of {width} x {height} at {x}, {y}",
                    effect.entry().kind
                );
            }
        }
    }
}

/// One level now, another in the light of the frame before.
struct AfterLight<F>(f32, F);

impl<A: Arith, F: Fn(u32) -> f32> camrig_sensor_core::pipeline::MeanRows<A> for AfterLight<F> {
    fn mean_row(&mut self, _: u32, out: &mut [[A::Signal; BLOCK]]) {
        out.as_flattened_mut().fill(A::Light::signal(self.0));
    }

    fn previous_mean_row(&mut self, row: u32, out: &mut [[A::Signal; BLOCK]]) {
        out.as_flattened_mut().fill(A::Light::signal((self.1)(row)));
    }
}

/// What lags is thinned: its law is that of Poisson, so that the variance is the mean and photon
/// transfer reads the true gain, where a share of the counts would leave (1 − l)² µ + l µ_before.
fn image_lag<A: Arith>() {
    let lag = image_lag::ImageLag { fraction: 0.1 };
    let config = monochrome(512, 128, &[lag.into(), shot_noise::ShotNoise {}.into()]);
    for (now, before) in [(100.0, 5000.0), (1000.0, 1000.0), (2000.0, 0.0)] {
        let dn = frame::<A>(&config, &SETTINGS, &mut AfterLight(now, |_| before));
        let v = electrons(&config, &SETTINGS, &dn);
        let expected = f64::from(0.9 * now + 0.1 * before);
        near("mean", mean(&v), expected, (expected / v.len() as f64).sqrt());
        near_variance("variance", variance(&v), expected + ROUNDING, v.len(), 0.01);
    }
}

/// Electrons of a flat under effects of light, without noise.
fn after<A: Arith>(effects: &[Effect], settings: &FrameSettings, before: f32) -> f64 {
    let config = monochrome(8, 8, effects);
    let dn = frame::<A>(&config, settings, &mut AfterLight(1000.0, |_| before));
    mean(&electrons(&config, settings, &dn))
}

/// l min(µ_before, W), with µ_before of the previous frame's own exposure and after the effects of
/// light that stand before.
fn what_lags_is_charge_that_was_held<A: Arith>() {
    let lag: Effect = image_lag::ImageLag { fraction: 0.05 }.into();
    let half: Effect = quantum_efficiency::QuantumEfficiency { ratio: 0.5 }.into();
    let full = 65_535.0 / DN_PER_E;
    let near = |what: &str, got: f64, want: f64| {
        assert!((got - want).abs() < 1.0 / DN_PER_E, "{what}: {got}, expected {want}");
    };
    for before in [1e5, 1e8] {
        near("above full well", after::<A>(&[lag], &SETTINGS, before), 950.0 + 0.05 * full);
    }
    let bracket = SETTINGS.after_exposure(4.0 * SETTINGS.exposure_s);
    near("longer before", after::<A>(&[lag], &bracket, 1000.0), 950.0 + 0.05 * 4000.0);
    let short = SETTINGS.after_exposure(0.25 * SETTINGS.exposure_s);
    near("shorter before", after::<A>(&[lag], &short, 1e8), 950.0 + 0.05 * full);
    near("half of both", after::<A>(&[half, lag], &bracket, 1000.0), 475.0 + 0.05 * 2000.0);
    // An exposure that is off by a constant is off in both frames.
    let offset = exposure_offset::ExposureOffset { offset_us: 1000.0, step_us: 0.0 };
    let expected = 0.95 * 1100.0 + 0.05 * 4100.0;
    near("offset of both", after::<A>(&[offset.into(), lag], &bracket, 1000.0), expected);
}

/// A bright row before: crosstalk spreads it in the frame in which it was there.
fn crosstalk_of_the_frame_before_lags<A: Arith>() {
    let spread = optical_crosstalk::OpticalCrosstalk { side: 0.0, vertical: 0.1, diagonal: 0.0 };
    let lag = image_lag::ImageLag { fraction: 0.1 };
    let config = monochrome(70, 9, &[spread.into(), lag.into()]);
    let bright = |row| if row == 4 { 4000.0 } else { 0.0 };
    let dn = frame::<A>(&config, &SETTINGS, &mut AfterLight(100.0, bright));
    for (i, v) in electrons(&config, &SETTINGS, &dn).into_iter().enumerate() {
        let before = match i / 70 {
            4 => 3200.0,
            3 | 5 => 400.0,
            _ => 0.0,
        };
        assert!((v - (90.0 + 0.1 * before)).abs() < 1.0 / DN_PER_E, "{i}: {v}");
    }
    // Rows on request are those of the frame.
    for row in [8, 3, 4, 0] {
        let light = &mut AfterLight(100.0, bright);
        let alone = rows_of::<A>(&config, &SETTINGS, light, &[row]);
        assert_eq!(alone, dn[row as usize * 70..][..70], "row {row}");
    }
}

/// Light that changes from frame to frame, for sensors with traps: their charge by effect and row.
struct Exposed<A: Arith, F> {
    light: F,
    before: BTreeMap<(usize, u32), Vec<[A::Signal; BLOCK]>>,
    after: BTreeMap<(usize, u32), Vec<[A::Signal; BLOCK]>>,
}

impl<A: Arith, F: FnMut(u32) -> f32> camrig_sensor_core::pipeline::MeanRows<A> for Exposed<A, F> {
    fn mean_row(&mut self, row: u32, out: &mut [[A::Signal; BLOCK]]) {
        out.as_flattened_mut().fill(A::Light::signal((self.light)(row)));
    }

    fn traps(&mut self, effect: usize, row: u32, out: &mut [[A::Signal; BLOCK]]) {
        match self.before.get(&(effect, row)) {
            Some(held) => out.copy_from_slice(held),
            None => out.as_flattened_mut().fill(A::Signal::default()),
        }
    }

    fn keep_traps(&mut self, effect: usize, row: u32, held: &[[A::Signal; BLOCK]]) {
        self.after.insert((effect, row), held.to_vec());
    }
}

/// Frames of rows of even light one after the other, their rows in the given order.
fn one_after_the_other<A: Arith>(
    config: &SensorConfig,
    light: &[&dyn Fn(u32) -> f32],
    order: &[u32],
) -> Vec<Vec<f64>> {
    let mut before = BTreeMap::new();
    let mut frames = Vec::new();
    for (i, light) in (0..).zip(light) {
        let mut source = Exposed::<A, _> { light, before, after: BTreeMap::new() };
        let dn = rows_of::<A>(config, &at(i), &mut source, order);
        frames.push(electrons(config, &at(i), &dn));
        before = source.after;
    }
    frames
}

/// A frame of light, then darkness: f min(µ, W) (1 − d) d^(k−1); no charge is lost; what is read
/// has the law of Poisson, so that photon transfer reads the true gain.
fn persistence<A: Arith>() {
    let (f, tau) = (0.25f64, 1.5f64);
    let traps = persistence::Persistence { fraction: f as f32, time_constant_frames: tau as f32 };
    let d = (-1.0 / tau).exp();
    let full = 65_535.0 / DN_PER_E;
    let rows: Vec<u32> = (0..4).collect();
    let half_a_dn = 0.51 / DN_PER_E;
    for light in [4000.0f32, 1e6] {
        let config = monochrome(70, 4, &[traps.into()]);
        let (on, off) = (move |_| light, |_| 0.0);
        let frames =
            one_after_the_other::<A>(&config, &[&on, &off, &off, &off, &off, &off], &rows);
        let held = f64::from(light).min(full);
        for (k, frame) in (1..).zip(&frames[1..]) {
            let right = f * held * (1.0 - d) * d.powi(k - 1);
            assert!((mean(frame) - right).abs() < half_a_dn, "{k}: {}, {right}", mean(frame));
        }
    }
    // Crosstalk before, charge coupling behind: rows on request are those of the frame.
    let spread = optical_crosstalk::OpticalCrosstalk { side: 0.0, vertical: 0.1, diagonal: 0.0 };
    let coupled = charge_coupling::ChargeCoupling { side: 0.0, vertical: 0.05, diagonal: 0.0 };
    let config = monochrome(70, 9, &[spread.into(), traps.into(), coupled.into()]);
    let (bright, off) = (|row| if row == 4 { 4000.0 } else { 0.0 }, |_| 0.0);
    let orders = [vec![0, 1, 2, 3, 4, 5, 6, 7, 8], vec![8, 3, 4, 0, 7, 1, 2, 5, 6]];
    let [whole, mixed] =
        orders.each_ref().map(|rows| one_after_the_other::<A>(&config, &[&bright, &off], rows));
    for (at, &row) in orders[1].iter().enumerate() {
        for (a, b) in whole.iter().zip(&mixed) {
            assert_eq!(a[row as usize * 70..][..70], b[at * 70..][..70], "row {row}");
        }
    }
    let total: f64 = whole[1].iter().sum();
    assert!((total / 70.0 - f * 4000.0 * (1.0 - d)).abs() < 9.0 * half_a_dn, "{total}");
    // Photon transfer, in light that has just come: the variance is the mean.
    let shot = shot_noise::ShotNoise {}.into();
    let config = monochrome(512, 128, &[traps.into(), shot]);
    let rows: Vec<u32> = (0..128).collect();
    let (on, off) = (|_| 2000.0, |_| 0.0);
    let frames = one_after_the_other::<A>(&config, &[&on, &on, &on, &off], &rows);
    let means = [2000.0 * (1.0 - f), 2000.0 * (1.0 - f * d), 2000.0 * (1.0 - f * d * d)];
    let released = 2000.0 * f * (1.0 - d.powi(3));
    for (v, right) in frames.iter().zip(means.into_iter().chain([released])) {
        near("mean", mean(v), right, (right / v.len() as f64).sqrt());
        near_variance("variance", variance(v), right + ROUNDING, v.len(), 0.01);
    }
    near("frames", correlation(&frames[0], &frames[1]), 0.0, 65_536f64.powf(-0.5));
}

/// Two kinds of traps: the recursion of both in f64 over six frames of changing light, and the sum
/// of what is read and what is held is the light.
fn traps_of_two_time_constants<A: Arith>() {
    let kinds = [(0.1f32, 0.7f32), (0.02, 12.0)];
    let effects = kinds.map(|(fraction, time_constant_frames)| {
        persistence::Persistence { fraction, time_constant_frames }.into()
    });
    let config = monochrome(8, 2, &effects);
    let light = [3000.0f32, 0.0, 5000.0, 1e5, 0.0, 100.0];
    let steady = light.map(|light| move |_: u32| light);
    let steady = steady.each_ref().map(|f| f as &dyn Fn(u32) -> f32);
    let frames = one_after_the_other::<A>(&config, &steady, &[0, 1]);
    let full = 65_535.0 / DN_PER_E;
    let (mut held, mut read) = ([0.0; 2], 0.0);
    for (light, frame) in light.into_iter().zip(frames) {
        let mut signal = f64::from(light);
        for (held, (fraction, tau)) in held.iter_mut().zip(kinds) {
            let kept = *held * (-1.0 / f64::from(tau)).exp();
            let caught = (signal.min(full) * f64::from(fraction)).min(full - kept);
            signal += *held - kept - caught;
            *held = kept + caught;
        }
        read += signal;
        let shown = signal.min((65_535.0 - BLACK) / DN_PER_E);
        assert!((mean(&frame) - shown).abs() < 0.51 / DN_PER_E, "{}, {shown}", mean(&frame));
    }
    let given: f64 = light.iter().map(|&e| f64::from(e)).sum();
    assert!((read + held.iter().sum::<f64>() - given).abs() < 1e-6);
}

/// Covered and weak pixels collect less light, and that has its own shot noise.
fn less_light_has_its_own_shot_noise<A: Arith>() {
    let covered = pdaf_pattern::PdafPattern {
        period_x: 1.0,
        period_y: 1.0,
        first_x: 0.0,
        first_y: 0.0,
        gain: 0.25,
    };
    let weak = defective_pixels::DefectivePixels { fraction: 1.0, gain: 0.25 };
    for effect in [Effect::from(covered), weak.into()] {
        let config = monochrome(256, 128, &[effect, shot_noise::ShotNoise {}.into()]);
        let v = flat::<A>(&config, &SETTINGS, 4000.0);
        near("mean", mean(&v), 1000.0, (1000.0 / v.len() as f64).sqrt());
        near_variance("variance", variance(&v), 1000.0 + ROUNDING, v.len(), 0.0);
    }
}

/// Counts of much light, which gains below 1 bring back into the range of charge.
fn much_light_has_the_law_of_poisson<A: Arith>() {
    for light in [3e5f32, 9e5, 1.6e7] {
        let gain = 1.0 + (4000.0 / light - 1.0); // as the effect computes it
        let mut config = monochrome(256, 128, &[shot_noise::ShotNoise {}.into()]);
        // A gain on photo-electrons with their noise.
        let table = [4.0, 0.0, gain - 1.0, 1.0, gain - 1.0];
        config.table = table.into_iter().collect();
        let reduce = empirical::Empirical {
            quantity: 1.0,
            shape: 2.0,
            amount: 1.0,
            on_signal: 0.0,
            signal_e: 1.0,
            doubling_c: 7.0,
            reference_c: 25.0,
            start: 0.0,
        };
        config.effects.push(reduce.into()).unwrap();
        let v = flat::<A>(&config, &SETTINGS, light);
        let expected = f64::from(light) * f64::from(gain).powi(2) + ROUNDING;
        let mean_e = f64::from(light) * f64::from(gain);
        near("mean", mean(&v), mean_e, (expected / v.len() as f64).sqrt() + 0.01);
        near_variance("variance", variance(&v), expected, v.len(), 0.01);
    }
}

fn totals<A: Arith>(config: &SensorConfig, settings: &FrameSettings) -> Vec<f64> {
    column_means(&flat::<A>(config, settings, 0.0), config.width as usize)
}

fn amp_glow<A: Arith>() {
    let effect = amp_glow::AmpGlow { rate_e_per_s: 20_000.0, x: 1.0, y: 0.5, width: 0.3 };
    let config = monochrome(200, 120, &[effect.into()]);
    let v = flat::<A>(&config, &SETTINGS, 0.0);
    let expected = |x: usize, y: usize| {
        let u = (x as f64 + 0.5) / 100.0 - 1.0;
        let dy = ((y as f64 + 0.5) / 60.0 - 1.0 - 0.5) * 0.6;
        200.0 * (-((u - 1.0).powi(2) + dy * dy) / (2.0 * 0.09)).exp()
    };
    // Chi-square of Poisson counts: one per pixel, but for the scarce ones.
    let (mut chi2, mut n) = (0.0, 0.0);
    for (i, v) in v.iter().enumerate() {
        let mu = expected(i % 200, i / 200);
        if mu > 5.0 {
            chi2 += (v - mu).powi(2) / mu;
            n += 1.0;
        }
    }
    near("chi-square per pixel", chi2 / n, 1.0, (2.05f64 / n).sqrt());
    let sum: f64 = (0..v.len()).map(|i| expected(i % 200, i / 200)).sum();
    near("total", v.iter().sum(), sum, sum.sqrt());
}

fn dark_current_gradient<A: Arith>() {
    let effect = dark_current_gradient::DarkCurrentGradient {
        rate_e_per_s: 10_000.0,
        direction_deg: 180.0,
        doubling_c: 8.0,
        reference_c: 25.0,
    };
    let config = monochrome(64, 256, &[effect.into()]);
    let warm = SETTINGS.with_temperature(33.0);
    for (settings, rate) in [(SETTINGS, 100.0), (warm, 200.0)] {
        for (x, v) in totals::<A>(&config, &settings).into_iter().enumerate() {
            let mu = rate * (1.0 - ((x as f64 + 0.5) / 32.0 - 1.0)) / 2.0;
            near("mean of a column", v, mu, (mu / 256.0).sqrt() + 1e-3);
        }
    }
}

/// Charge of a frame: of n hits of charge Q, mean n ⟨Q⟩ and variance n ⟨Q²⟩.
fn particle_hits<A: Arith>() {
    let (a, d, w) = (60.0f64, 1.5f64, 0.1f64);
    let effect = particle_hits::ParticleHits {
        rate_per_mpx_s: 5000.0,
        charge_e_per_px: a as f32,
        depth_px: d as f32,
        width: w as f32,
    };
    let config = monochrome(256, 256, &[effect.into()]);
    let hits = 5000.0 * 256.0 * 256.0 / 1e6;
    let take = |i| flat::<A>(&config, &at(i).with_exposure(1.0), 0.0).iter().sum::<f64>();
    let frames: Vec<f64> = (0..60).map(take).collect();
    let one = 1.0 + 1.270_36 * w;
    let squares = 2.0 * (a * d).powi(2) * (one * one + 4.934_8 * w * w);
    near("charge", mean(&frames), 4.0 / 3.0 * hits * a * d * one, (hits * squares / 60.0).sqrt());
    near_variance("variance of frames", variance(&frames), hits * squares, 60, 0.0);
    let none = flat::<A>(&config, &at(0).with_exposure(1e-9), 0.0);
    assert!(none.iter().all(|v| *v == 0.0));
}

/// ⟨tan θ⟩ is π/4 and ⟨|sin φ|⟩ 2/π: tracks cross 1 + d/2 rows, and as many columns.
fn tracks_cross_rows_and_columns<A: Arith>() {
    let effect = particle_hits::ParticleHits {
        rate_per_mpx_s: 100.0,
        charge_e_per_px: 400.0,
        depth_px: 4.0,
        width: 0.0,
    };
    let config = monochrome(128, 128, &[effect.into()]);
    let mut crossed = [0.0; 2];
    for i in 0..400 {
        let v = flat::<A>(&config, &at(i).with_exposure(0.2), 0.0);
        let lit = |x: usize, y: usize| v[y * 128 + x] > 0.0;
        crossed[0] += (0..128).filter(|y| (0..128).any(|x| lit(x, *y))).count() as f64;
        crossed[1] += (0..128).filter(|x| (0..128).any(|y| lit(*x, y))).count() as f64;
    }
    let hits = 400.0 * 100.0 * 0.2 * 128.0 * 128.0 / 1e6;
    // ⟨(1 + d tan θ |sin φ|)²⟩ = 1 + d + d²/2, and its Poisson number.
    let error = (hits * (1.0f64 + 4.0 + 8.0)).sqrt();
    near("rows", crossed[0], 3.0 * hits, error);
    near("columns", crossed[1], 3.0 * hits, error);
}

fn frame_offset_by_site<A: Arith>() {
    let phi = 0.6f64;
    let effect = frame_offset_by_site::FrameOffsetBySite {
        sigma_e: 25.0,
        correlation: phi as f32,
        gain_exponent: 0.0,
    };
    let config = monochrome(4, 4, &[effect.into()]);
    let n = 3000;
    let mut places = [const { Vec::new() }; 4];
    for frame in 0..n {
        let v = flat::<A>(&config, &at(frame), 0.0);
        for (p, place) in places.iter_mut().enumerate() {
            place.push(v[p / 2 * 4 + p % 2]);
        }
        assert!((0..16).all(|i| v[i] == v[i / 4 % 2 * 4 + i % 2]), "one offset per place");
    }
    let spread = (2.0 * (1.0 + phi * phi) / (1.0 - phi * phi) / f64::from(n)).sqrt();
    for place in &places {
        near("variance", variance(place), 625.0, 625.0 * spread);
        let error = ((1.0 - phi * phi) / f64::from(n)).sqrt();
        near("frames", correlation(&place[1..], &place[..place.len() - 1]), phi, error);
    }
    near("places", correlation(&places[0], &places[3]), 0.0, spread / 2f64.sqrt());
}

fn dark_current_by_site<A: Arith>() {
    let rates = [1000.0f32, 4000.0, 0.0, 200_000.0];
    let [plane_0_e_per_s, plane_1_e_per_s, plane_2_e_per_s, plane_3_e_per_s] = rates;
    let effect = dark_current_by_site::DarkCurrentBySite {
        plane_0_e_per_s,
        plane_1_e_per_s,
        plane_2_e_per_s,
        plane_3_e_per_s,
        doubling_c: 10.0,
        reference_c: 15.0,
    };
    let config = monochrome(128, 128, &[effect.into()]);
    let v = flat::<A>(&config, &at(0), 0.0);
    for (p, rate) in rates.iter().enumerate() {
        // Ten kelvins above the reference: twice as much, in 10 ms.
        let mean_e = f64::from(*rate) * 0.01 * 2.0;
        let own: Vec<f64> =
            (0..64 * 64).map(|i| v[(i / 64 * 2 + p / 2) * 128 + i % 64 * 2 + p % 2]).collect();
        let n = own.len();
        near("mean", mean(&own), mean_e, (mean_e / n as f64).sqrt() + 1e-9);
        // No charge has no rounding either.
        let rounding = if *rate > 0.0 { ROUNDING } else { 0.0 };
        near(
            "variance",
            variance(&own),
            mean_e + rounding,
            mean_e * (2.5 / n as f64).sqrt() + 1e-9,
        );
    }
}

/// A spot, and the covariance of the noise of a flat, far from the output.
fn charge_transfer_inefficiency<A: Arith>() {
    let (s, p) = (0.001f64, 0.003f64);
    let cti = charge_transfer_inefficiency::ChargeTransferInefficiency {
        serial: s as f32,
        parallel: p as f32,
    };
    let lost = |e: f64, transfers: i32| 1.0 - (1.0 - e).powi(transfers);
    let config = monochrome(128, 64, &[cti.into()]);
    let (x, y) = (90, 40);
    let spot = |sx: u32, sy: u32| if (sx, sy) == (x, y) { 6000.0 } else { 0.0 };
    let v = electrons(&config, &SETTINGS, &frame::<A>(&config, &SETTINGS, &mut Means(spot)));
    let of = |dx: u32, dy: u32| v[((y + dy) * 128 + x + dx) as usize];
    let (across, down) = (lost(s, 91), lost(p, 41));
    let (kept, trail) = ((1.0 - across) * (1.0 - down), across * (1.0 - down));
    for (got, share) in [
        (of(0, 0), kept),
        (of(1, 0), trail),
        (of(0, 1), (1.0 - across) * down),
        (of(1, 1), across * down),
    ] {
        assert!((got - 6000.0 * share).abs() < 0.2, "{got}, expected {}", 6000.0 * share);
    }
    assert!((v.iter().sum::<f64>() - 6000.0).abs() < 0.5);
    // Nothing is before the first pixel: a flat has its edge there.
    let v = flat::<A>(&config, &SETTINGS, 1000.0);
    assert!((v[0] - 1000.0 * (1.0 - s) * (1.0 - p)).abs() < 0.2);
    let last = (1.0 - s * (1.0 - s).powi(127)) * (1.0 - p * (1.0 - p).powi(63));
    assert!((v[64 * 128 - 1] - 1000.0 * last).abs() < 0.2);

    let serial =
        charge_transfer_inefficiency::ChargeTransferInefficiency { serial: 0.002, parallel: 0.0 };
    let config = monochrome(128, 2048, &[shot_noise::ShotNoise {}.into(), serial.into()]);
    let v = flat::<A>(&config, &SETTINGS, 1000.0);
    let columns: Vec<Vec<f64>> =
        (0..128).map(|x| v.iter().skip(x).step_by(128).copied().collect()).collect();
    for x in [20, 60, 120] {
        let own: Vec<f64> =
            (x - 4..x + 4).map(|x| covariance(&columns[x], &columns[x + 1])).collect();
        let l = lost(0.002, x as i32 + 1);
        near("covariance", mean(&own), 1000.0 * l * (1.0 - l), 1000.0 / (8.0f64 * 2048.0).sqrt());
    }
}
