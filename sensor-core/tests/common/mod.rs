//! What the tests of the sensor model share: configurations, runs and sample statistics.
#![allow(dead_code, missing_docs)]

pub mod light;

use camrig_sensor_core::arith::{Arith, BLOCK, Block};
use camrig_sensor_core::config::{FrameSettings, Pattern, SensorConfig};
use camrig_sensor_core::effects::{Effect, Entry};
use camrig_sensor_core::pipeline::{MeanRows, Pipeline, memory_blocks};

/// DN of an electron in [`monochrome`] at unity gain: fine enough that rounding is 1/12/8² e⁻².
pub const DN_PER_E: f64 = 8.0;
pub const BLACK: f64 = 2048.0;

pub const SETTINGS: FrameSettings = FrameSettings::new(0.01);

/// A monochrome sensor with a 16-bit converter of 1/8 e⁻ per step, so that DN resolve electrons.
pub fn monochrome(width: u32, height: u32, effects: &[Effect]) -> SensorConfig {
    let mut config = SensorConfig::new(width, height);
    config.response = [1e6].into_iter().collect();
    config.full_well_e = (65_535.0 / DN_PER_E) as f32;
    config.bits = 16;
    config.black_level_dn = BLACK as f32;
    config.seed = 20_260_101;
    config.effects = effects.iter().copied().collect();
    config
}

/// The effects that their parameters alone describe: all but those with a table.
pub fn catalogue() -> impl Iterator<Item = &'static Entry> {
    Effect::CATALOGUE.iter().filter(|e| !["empirical", "gain-table"].contains(&e.kind))
}

/// A Bayer sensor with the same converter.
pub fn bayer(width: u32, height: u32, effects: &[Effect]) -> SensorConfig {
    let mut config = monochrome(width, height, effects);
    config.pattern = Pattern::new(2, 2, [0, 1, 1, 2]);
    config.channels = 3;
    config.response = [1e6; 3].into_iter().collect();
    config
}

/// Mean electrons from a function of column and row.
pub struct Means<F>(pub F);

impl<A: Arith, F: Fn(u32, u32) -> f32> MeanRows<A> for Means<F> {
    fn mean_row(&mut self, row: u32, out: &mut [Block<A::Signal>]) {
        for (x, v) in out.as_flattened_mut().iter_mut().enumerate() {
            *v = A::Light::signal((self.0)(x as u32, row));
        }
    }
}

/// A frame's DN, row by row. The source is dynamic, so that the chain is compiled once, not per
/// light.
pub fn frame<A: Arith>(
    config: &SensorConfig,
    settings: &FrameSettings,
    source: &mut dyn MeanRows<A>,
) -> Vec<u16> {
    let rows: Vec<u32> = (0..config.height).collect();
    rows_of::<A>(config, settings, source, &rows)
}

/// The DN of some rows in that order.
pub fn rows_of<A: Arith>(
    config: &SensorConfig,
    settings: &FrameSettings,
    source: &mut dyn MeanRows<A>,
    rows: &[u32],
) -> Vec<u16> {
    let mut memory = vec![[A::Signal::default(); BLOCK]; memory_blocks(config)];
    let mut pipeline = Pipeline::<A>::new(config, settings, &mut memory).unwrap();
    let width = config.width as usize;
    let mut dn = vec![0; width * rows.len()];
    for (&row, out) in rows.iter().zip(dn.chunks_mut(width)) {
        pipeline.row(row, source, out);
    }
    dn
}

/// A frame in electrons above the black level, for a flat mean.
pub fn flat<A: Arith>(config: &SensorConfig, settings: &FrameSettings, mean_e: f32) -> Vec<f64> {
    electrons(config, settings, &frame::<A>(config, settings, &mut Means(|_, _| mean_e)))
}

/// DN as input-referred electrons.
pub fn electrons(config: &SensorConfig, settings: &FrameSettings, dn: &[u16]) -> Vec<f64> {
    let gain = f64::from(config.dn_per_e(settings.analog_gain));
    dn.iter().map(|&d| (f64::from(d) - f64::from(config.black_level_dn)) / gain).collect()
}

pub fn mean(v: &[f64]) -> f64 {
    v.iter().sum::<f64>() / v.len() as f64
}

pub fn variance(v: &[f64]) -> f64 {
    covariance(v, v)
}

pub fn covariance(a: &[f64], b: &[f64]) -> f64 {
    let (ma, mb) = (mean(a), mean(b));
    a.iter().zip(b).map(|(a, b)| (a - ma) * (b - mb)).sum::<f64>() / (a.len() - 1) as f64
}

pub fn correlation(a: &[f64], b: &[f64]) -> f64 {
    covariance(a, b) / (variance(a) * variance(b)).sqrt()
}

/// Means of the rows of a frame.
pub fn row_means(v: &[f64], width: usize) -> Vec<f64> {
    v.chunks(width).map(mean).collect()
}

/// Means of the columns of a frame.
pub fn column_means(v: &[f64], width: usize) -> Vec<f64> {
    let mut sums = vec![0.0; width];
    for row in v.chunks(width) {
        sums.iter_mut().zip(row).for_each(|(s, v)| *s += v);
    }
    let rows = (v.len() / width) as f64;
    sums.into_iter().map(|s| s / rows).collect()
}

/// Runs a test function in each arithmetic.
#[macro_export]
macro_rules! in_both_arithmetics {
    ($($name:ident)+) => {
        mod float {
            use camrig_sensor_core::arith::Float;
            $(#[test] fn $name() { super::$name::<Float>(); })+
        }
        mod fixed {
            use camrig_sensor_core::arith::Fixed;
            $(#[test] fn $name() { super::$name::<Fixed>(); })+
        }
    };
}

/// Covariance of pixels `dx` columns and `dy` rows apart.
pub fn lag_covariance(v: &[f64], width: usize, dx: usize, dy: usize) -> f64 {
    let height = v.len() / width;
    let index = (0..height - dy).flat_map(|y| (0..width - dx).map(move |x| y * width + x));
    let (a, b): (Vec<f64>, Vec<f64>) = index.map(|i| (v[i], v[i + dy * width + dx])).unzip();
    covariance(&a, &b)
}

/// |value - expected| within 4.5 standard errors: one false alarm in 150 000 checks.
#[track_caller]
pub fn near(what: &str, value: f64, expected: f64, standard_error: f64) {
    let z = (value - expected) / standard_error;
    assert!(z.abs() < 4.5, "{what}: {value}, expected {expected} ± {standard_error} (z = {z:.1})");
}

/// A variance of n values, at most `excess` kurtosis (0 for normal), near the expected one.
#[track_caller]
pub fn near_variance(what: &str, value: f64, expected: f64, n: usize, excess: f64) {
    near(what, value, expected, expected * ((2.0 + excess) / n as f64).sqrt());
}

/// Uniform numbers in 0..1 for inputs of tests (SplitMix64).
pub fn uniforms(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// FNV-1a of DN as little-endian bytes.
pub fn digest(dn: &[u16]) -> u64 {
    dn.iter().flat_map(|d| d.to_le_bytes()).fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}
