//! Without noise the raw is within 1 DN of a reference in f64, in both arithmetics: 12 bits, the
//! whole range, full wells of 2 ke⁻ to 100 ke⁻, gains of 1 to 16, 31 bands with crosstalk factors.
//!
//! Held to is not the rounded reference but its distance: |DN − reference| ≤ ½ + budget, so the
//! budget is what the arithmetic itself costs.

mod common;

use camrig_sensor_core::arith::{Arith, Fixed, Float};
use camrig_sensor_core::config::{FrameSettings, Pattern, SensorConfig};
use camrig_sensor_core::effects::{charge_coupling::ChargeCoupling, full_well::FullWell};
use common::light::{Band, Collected, Table, mean_electrons};
use common::{frame, uniforms};

const WIDTH: usize = 1000;
const HEIGHT: usize = 6;
const BANDS: usize = 31;

fn config(full_well_e: f32) -> SensorConfig {
    // QE curves of a red, a green and a blue filter, roughly.
    let response = (0..3).flat_map(|c| {
        (0..BANDS).map(move |b| {
            let d = (b as f32 - [20.0, 14.0, 6.0][c]) / 4.0;
            3.3e8 * (0.02 + 0.6 * (-d * d).exp())
        })
    });
    let mut config = SensorConfig::new(WIDTH as u32, HEIGHT as u32);
    config.pattern = Pattern::new(2, 2, [0, 1, 1, 2]);
    config.channels = 3;
    config.bands = BANDS as u8;
    config.first_band_nm = 400.0;
    config.response = response.collect();
    config.full_well_e = full_well_e;
    config.seed = 1;
    config.effects = [
        ChargeCoupling { side: 0.012, vertical: 0.009, diagonal: 0.002 }.into(),
        FullWell { full_well_e, knee: 0.0 }.into(),
    ]
    .into_iter()
    .collect();
    config
}

fn table() -> Table {
    let mut next = uniforms(7);
    let (x, y, nm) =
        (vec![-0.93, -0.4, 0.013, 0.5, 1.0], vec![-1.0, 0.1, 0.9], vec![450.0, 660.0]);
    let factors =
        (0..3 * x.len() * y.len() * nm.len()).map(|_| (0.7 + 0.6 * next()) as f32).collect();
    Table { x, y, nm, factors }
}

/// A ramp over the columns to 1.1 of the range with some structure from band to band and pixel to
/// pixel.
fn cube(config: &SensorConfig, settings: &FrameSettings) -> Vec<Vec<Band>> {
    let mut next = uniforms(11);
    let response: f64 = config.response[BANDS..2 * BANDS].iter().map(|&r| f64::from(r)).sum();
    let range_e = f64::from(config.full_well_e) / f64::from(settings.analog_gain);
    let top = 1.1 * range_e / (response * f64::from(settings.exposure_s));
    let row = |_| {
        let mut band = |b: usize| {
            let tint = 0.6 + 0.8 * b as f64 / BANDS as f64;
            let ramp = |x| top * tint * (x as f64 / WIDTH as f64) * (0.9 + 0.2 * next());
            Band::new((0..WIDTH).map(ramp).map(|v| v as f32).collect())
        };
        (0..BANDS).map(&mut band).collect()
    };
    (0..HEIGHT).map(row).collect()
}

/// Not rounded, black level included, not clamped below the converter's top.
fn reference(
    config: &SensorConfig,
    settings: &FrameSettings,
    table: &Table,
    cube: &[Vec<Band>],
) -> Vec<f64> {
    let e = mean_electrons(config, settings, Some(table), cube);
    let at = |x: i64, y: i64| {
        // The mirror image beyond the edges.
        let within = |i: i64, count: usize| {
            let last = count - 1;
            last.abs_diff(last.abs_diff(i.unsigned_abs() as usize))
        };
        e[within(y, HEIGHT) * WIDTH + within(x, WIDTH)]
    };
    // The parameters as the configuration holds them.
    let (side, vertical, diagonal) =
        (f64::from(0.012f32), f64::from(0.009f32), f64::from(0.002f32));
    let gain = f64::from(settings.analog_gain) * 4095.0 / f64::from(config.full_well_e);
    (0..e.len())
        .map(|i| {
            let (x, y) = ((i % WIDTH) as i64, (i / WIDTH) as i64);
            let coupled = (1.0 - 2.0 * (side + vertical) - 4.0 * diagonal) * at(x, y)
                + side * (at(x - 1, y) + at(x + 1, y))
                + vertical * (at(x, y - 1) + at(x, y + 1))
                + diagonal
                    * (at(x - 1, y - 1) + at(x + 1, y - 1) + at(x - 1, y + 1) + at(x + 1, y + 1));
            (coupled.min(f64::from(config.full_well_e)) * gain + 64.0).min(4095.0)
        })
        .collect()
}

fn simulate<A: Arith>(
    config: &SensorConfig,
    settings: &FrameSettings,
    table: &Table,
    cube: &[Vec<Band>],
) -> Vec<u16> {
    let mut means = Collected::<A>::new(config, settings, Some(table), cube);
    frame::<A>(config, settings, &mut means)
}

/// Largest distance beyond ½ DN, and the share of pixels that differ from the rounded reference.
fn cost<A: Arith>() -> (f64, f64) {
    let table = table();
    let (mut worst, mut differ, mut pixels) = (0.0f64, 0, 0);
    for full_well_e in [2e3, 7e3, 3e4, 1e5] {
        for analog_gain in [1.0, 2.7, 16.0] {
            let config = config(full_well_e);
            let settings = FrameSettings::new(0.013).with_gain(analog_gain);
            let cube = cube(&config, &settings);
            let want = reference(&config, &settings, &table, &cube);
            for (dn, want) in simulate::<A>(&config, &settings, &table, &cube).iter().zip(want) {
                worst = worst.max((f64::from(*dn) - want).abs() - 0.5);
                differ += usize::from(f64::from(*dn) != want.round());
                pixels += 1;
            }
        }
    }
    (worst, differ as f64 / pixels as f64)
}

#[test]
fn fixed_point_is_within_its_budget() {
    let (worst, differ) = cost::<Fixed>();
    println!("fixed: {worst:.4} DN beyond the half, {differ:.1e} of pixels differ");
    assert!(worst < 0.05, "{worst} DN");
}

#[test]
fn f32_is_within_its_budget() {
    // 31 additions and products of 24 bits on 4095 DN: 40 x 2⁻²⁴ x 4095 = 0.01 DN.
    let (worst, differ) = cost::<Float>();
    println!("f32: {worst:.4} DN beyond the half, {differ:.1e} of pixels differ");
    assert!(worst < 0.01, "{worst} DN");
}
