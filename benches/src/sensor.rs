//! The sensor stage as the host runs it: rows in parallel, compiled for the vector units at hand.

use multiversion::multiversion;
use sensor_core::arith::{BLOCK, Block, Float};
use sensor_core::config::{FrameSettings, Pattern, SensorConfig};
use sensor_core::effects::{
    Effect, dark_current::DarkCurrent, full_well::FullWell, prnu::Prnu, read_noise::ReadNoise,
    row_offset_fpn::RowOffsetFpn, shot_noise::ShotNoise,
};
use sensor_core::pipeline::{MeanRows, Pipeline, memory_blocks};

/// Settings of all frames here.
pub const SETTINGS: FrameSettings =
    FrameSettings { frame: 3, exposure_s: 0.02, analog_gain: 1.0, temperature_c: 25.0 };

/// The chain that is timed: all of eq. 10 and 11.
pub fn chain() -> Vec<Effect> {
    vec![
        ShotNoise {}.into(),
        Prnu { sigma: 0.008 }.into(),
        DarkCurrent { mean_e_per_s: 20.0, dsnu_e_per_s: 5.0, doubling_c: 7.0, reference_c: 25.0 }
            .into(),
        FullWell { full_well_e: 10_000.0, knee: 0.0 }.into(),
        RowOffsetFpn { sigma_e: 0.8 }.into(),
        ReadNoise { read_e: 3.0, read_e_post: 1.0 }.into(),
    ]
}

/// A monochrome 12-bit sensor with this chain.
pub fn config(width: u32, height: u32, effects: &[Effect]) -> SensorConfig {
    SensorConfig {
        width,
        height,
        pattern: Pattern { width: 1, height: 1, channels: [0].into_iter().collect() },
        channels: 1,
        bands: 1,
        first_band_nm: 550.0,
        band_step_nm: 10.0,
        response: [1e6].into_iter().collect(),
        full_well_e: 10_000.0,
        bits: 12,
        black_level_dn: 64.0,
        seed: 1,
        effects: effects.iter().copied().collect(),
    }
}

/// Mean electrons of a scene: a ramp from 1 e⁻ to 8000 e⁻ along each row, so that blocks with small and
/// with large means occur as in a picture.
pub fn means(width: usize, height: usize) -> Vec<f32> {
    (0..width * height).map(|i| 1.0 + 8000.0 * (i % width) as f32 / width as f32).collect()
}

/// Mean electrons in memory.
struct Stored<'a> {
    means: &'a [f32],
    width: usize,
    first_row: u32,
}

impl MeanRows<Float> for Stored<'_> {
    #[inline(always)]
    fn mean_row(&mut self, row: u32, out: &mut [Block<f32>]) {
        let start = (row - self.first_row) as usize * self.width;
        let row = &self.means[start..start + self.width];
        for (block, values) in out.iter_mut().zip(row.chunks(BLOCK)) {
            match values.first_chunk() {
                Some(whole) => *block = *whole,
                None => block[..values.len()].copy_from_slice(values),
            }
        }
    }
}

/// Rows from `first_row` on, compiled for the vector units at hand.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
pub fn rows(config: &SensorConfig, first_row: u32, means: &[f32], dn: &mut [u16]) {
    rows_plain(config, first_row, means, dn);
}

/// Rows from `first_row` on, compiled for the build's target only.
#[inline(always)]
pub fn rows_plain(config: &SensorConfig, first_row: u32, means: &[f32], dn: &mut [u16]) {
    let width = config.width as usize;
    let mut memory = vec![[0.0; BLOCK]; memory_blocks(config)];
    let mut pipeline =
        Pipeline::<Float>::new(config, &SETTINGS, &mut memory).expect("valid configuration");
    let mut source = Stored { means, width, first_row };
    for (row, dn) in (first_row..).zip(dn.chunks_mut(width)) {
        pipeline.row(row, &mut source, dn);
    }
}

/// A frame on some threads.
pub fn frame(config: &SensorConfig, means: &[f32], dn: &mut [u16], threads: usize) {
    let width = config.width as usize;
    let per_thread = (config.height as usize).div_ceil(threads);
    std::thread::scope(|scope| {
        let parts = dn.chunks_mut(per_thread * width).zip(means.chunks(per_thread * width));
        for (i, (dn, means)) in parts.enumerate() {
            scope.spawn(move || rows(config, (i * per_thread) as u32, means, dn));
        }
    });
}
