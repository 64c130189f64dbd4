//! Without noise the raw is within 1 DN of a reference in f64, in both arithmetics: 12 bits, the whole
//! range, full wells of 2 ke⁻ to 100 ke⁻, gains of 1 to 16, 31 bands with crosstalk factors.
//!
//! Held to is not the rounded reference but its distance: |DN − reference| ≤ ½ + budget, so the budget is
//! what the arithmetic itself costs.

mod common;

use common::{rows_of, uniforms};
use sensor_core::arith::{Arith, Fixed, Float};
use sensor_core::collect::{Collector, Sums};
use sensor_core::config::{FrameSettings, Pattern, SensorConfig};
use sensor_core::crosstalk::Crosstalk;
use sensor_core::effects::{charge_coupling::ChargeCoupling, full_well::FullWell};
use sensor_core::spectral::{BandRow, GROUP, decode, encode, groups};

const WIDTH: usize = 1000;
const HEIGHT: usize = 6;
const BANDS: usize = 31;

/// One band of a row, encoded, and what it means.
struct Band {
    exponents: Vec<i8>,
    mantissas: Vec<u16>,
    values: Vec<f32>,
}

struct Table {
    x: Vec<f32>,
    y: Vec<f32>,
    nm: Vec<f32>,
    factors: Vec<f32>,
}

impl Table {
    /// Bilinear in position, linear in wavelength, in f64.
    fn at(&self, channel: usize, nm: f64, u: f64, v: f64) -> f64 {
        let place = |nodes: &[f32], p: f64| {
            let k = nodes.iter().rposition(|&n| f64::from(n) <= p).unwrap_or(0);
            let k = k.min(nodes.len() - 2);
            let (a, b) = (f64::from(nodes[k]), f64::from(nodes[k + 1]));
            (k, ((p - a) / (b - a)).clamp(0.0, 1.0))
        };
        let (w, tw) = place(&self.nm, nm);
        let (r, tr) = place(&self.y, v);
        let (c, tc) = place(&self.x, u);
        let mut sum = 0.0;
        for (dw, fw) in [(0, 1.0 - tw), (1, tw)] {
            for (dr, fr) in [(0, 1.0 - tr), (1, tr)] {
                for (dc, fc) in [(0, 1.0 - tc), (1, tc)] {
                    let plane = channel * self.nm.len() + w + dw;
                    let i = (plane * self.y.len() + r + dr) * self.x.len() + c + dc;
                    sum += fw * fr * fc * f64::from(self.factors[i]);
                }
            }
        }
        sum
    }
}

fn config(full_well_e: f32) -> SensorConfig {
    // QE curves of a red, a green and a blue filter, roughly.
    let response = (0..3).flat_map(|c| {
        (0..BANDS).map(move |b| {
            let d = (b as f32 - [20.0, 14.0, 6.0][c]) / 4.0;
            3.3e8 * (0.02 + 0.6 * (-d * d).exp())
        })
    });
    SensorConfig {
        width: WIDTH as u32,
        height: HEIGHT as u32,
        pattern: Pattern { width: 2, height: 2, channels: [0, 1, 1, 2].into_iter().collect() },
        channels: 3,
        bands: BANDS as u8,
        first_band_nm: 400.0,
        band_step_nm: 10.0,
        response: response.collect(),
        full_well_e,
        bits: 12,
        black_level_dn: 64.0,
        seed: 1,
        effects: [
            ChargeCoupling { side: 0.012, vertical: 0.009, diagonal: 0.002 }.into(),
            FullWell { full_well_e, knee: 0.0 }.into(),
        ]
        .into_iter()
        .collect(),
    }
}

fn table() -> Table {
    let mut next = uniforms(7);
    let (x, y, nm) = (vec![-0.93, -0.4, 0.013, 0.5, 1.0], vec![-1.0, 0.1, 0.9], vec![450.0, 660.0]);
    let factors =
        (0..3 * x.len() * y.len() * nm.len()).map(|_| (0.7 + 0.6 * next()) as f32).collect();
    Table { x, y, nm, factors }
}

/// A ramp over the columns to 1.1 of the range with some structure from band to band and pixel to pixel.
fn cube(config: &SensorConfig, settings: &FrameSettings) -> Vec<Vec<Band>> {
    let mut next = uniforms(11);
    let response: f64 = config.response[BANDS..2 * BANDS].iter().map(|&r| f64::from(r)).sum();
    let range_e = f64::from(config.full_well_e) / f64::from(settings.analog_gain);
    let top = 1.1 * range_e / (response * f64::from(settings.exposure_s));
    let row = |_| {
        let band = |b: usize| {
            let tint = 0.6 + 0.8 * b as f64 / BANDS as f64;
            let values: Vec<f32> = (0..WIDTH)
                .map(|x| (top * tint * (x as f64 / WIDTH as f64) * (0.9 + 0.2 * next())) as f32)
                .collect();
            let (mut exponents, mut mantissas) = (vec![0; groups(WIDTH)], vec![0; WIDTH]);
            encode(&values, &mut exponents, &mut mantissas);
            let mut values = vec![0.0; WIDTH];
            decode(BandRow { exponents: &exponents, mantissas: &mantissas }, &mut values);
            Band { exponents, mantissas, values }
        };
        (0..BANDS).map(band).collect()
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
    let mut e = vec![0.0; WIDTH * HEIGHT];
    for (i, e) in e.iter_mut().enumerate() {
        let (x, y) = (i % WIDTH, i / WIDTH);
        let channel = config.pattern.channel(x, y);
        let u = (x as f64 + 0.5) / WIDTH as f64 * 2.0 - 1.0;
        let v = (y as f64 + 0.5) / HEIGHT as f64 * 2.0 - 1.0;
        for (b, band) in cube[y].iter().enumerate() {
            let response = f64::from(config.response[channel * BANDS + b]);
            let factor = table.at(channel, 400.0 + 10.0 * b as f64, u, v);
            *e += f64::from(settings.exposure_s) * f64::from(band.values[x]) * response * factor;
        }
    }
    let at = |x: i64, y: i64| {
        let (x, y) = (x.clamp(0, WIDTH as i64 - 1), y.clamp(0, HEIGHT as i64 - 1));
        e[y as usize * WIDTH + x as usize]
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
    let crosstalk =
        Crosstalk { x: &table.x, y: &table.y, wavelength_nm: &table.nm, factors: &table.factors };
    let mut collector = Collector::<A>::new(config, settings, Some(crosstalk)).unwrap();
    let mut means = |y: u32, out: &mut [[A::Signal; sensor_core::arith::BLOCK]]| {
        let mut sums: Vec<Sums<A::Sum>> = vec![[A::Sum::default(); GROUP]; groups(WIDTH)];
        for (b, band) in cube[y as usize].iter().enumerate() {
            let row = BandRow { exponents: &band.exponents, mantissas: &band.mantissas };
            collector.add_band(y, b, row, &mut sums);
        }
        for (out, sum) in out.as_flattened_mut().iter_mut().zip(sums.as_flattened()) {
            *out = A::collected(*sum);
        }
    };
    let rows: Vec<u32> = (0..HEIGHT as u32).collect();
    rows_of::<A>(config, settings, &mut means, &rows)
}

/// Largest distance beyond ½ DN, and the share of pixels that differ from the rounded reference.
fn cost<A: Arith>() -> (f64, f64) {
    let table = table();
    let (mut worst, mut differ, mut pixels) = (0.0f64, 0, 0);
    for full_well_e in [2e3, 7e3, 3e4, 1e5] {
        for analog_gain in [1.0, 2.7, 16.0] {
            let config = config(full_well_e);
            let settings =
                FrameSettings { frame: 0, exposure_s: 0.013, analog_gain, temperature_c: 25.0 };
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
