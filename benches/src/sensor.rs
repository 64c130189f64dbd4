//! The sensor stage of the product, with light in memory.

use camrig::Plane;
use camrig::exposure::rows::{self as product, BandSums, Vector};
use camrig::exposure::{Chunk, CubeHeader, IrradianceCube, IrradianceWriter};
use camrig::scene::Bands;
use camrig_sensor_core::arith::{BLOCK, Block, Float};
use camrig_sensor_core::config::{FrameSettings, Pattern, SensorConfig};
use camrig_sensor_core::crosstalk::Crosstalk;
use camrig_sensor_core::effects::{
    Effect, dark_current::DarkCurrent, full_well::FullWell, prnu::Prnu, read_noise::ReadNoise,
    row_offset_fpn::RowOffsetFpn, shot_noise::ShotNoise,
};
use camrig_sensor_core::pipeline::MeanRows;

/// Settings of all frames of the benches.
pub const SETTINGS: FrameSettings = FrameSettings::new(0.02).with_frame(3);

/// The chain that is timed: all effects of eq. 10 and 11.
pub fn chain() -> Vec<Effect> {
    vec![
        ShotNoise {}.into(),
        Prnu { sigma: 0.008 }.into(),
        DarkCurrent { mean_e_per_s: 20.0, dsnu_e_per_s: 5.0, doubling_c: 7.0, reference_c: 25.0 }
            .into(),
        FullWell { full_well_e: 10_000.0, knee: 0.0 }.into(),
        RowOffsetFpn::from_values(&[0.8]).into(),
        ReadNoise { read_e: 3.0, read_e_post: 1.0 }.into(),
    ]
}

/// A monochrome 12-bit sensor with this chain.
pub fn config(width: u32, height: u32, effects: &[Effect]) -> SensorConfig {
    let mut config = SensorConfig::new(width, height);
    config.response = [1e6].into_iter().collect();
    config.seed = 1;
    config.effects = effects.iter().copied().collect();
    config
}

/// Mean electrons of a scene: a ramp from 1 e⁻ to 8000 e⁻ along each row, so that blocks with
/// small and with large means occur, as in a picture.
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

/// Computes rows from `first_row` on, as `camrig expose` does.
pub fn rows(config: &SensorConfig, first_row: u32, means: &[f32], dn: &mut [u16]) {
    let mut source = Stored { means, width: config.width as usize, first_row };
    product::rows::<Float>(config, &SETTINGS, &mut source, first_row as usize, dn)
        .expect("valid configuration");
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

/// Bands of [`spectral_config`] and [`cube`].
const BANDS: usize = 31;
/// Nodes of the crosstalk table, columns x rows.
const NODES: (usize, usize) = (17, 13);

/// A Bayer sensor for 31 bands with this chain.
pub fn spectral_config(width: u32, height: u32, effects: &[Effect]) -> SensorConfig {
    let mut config = config(width, height, effects);
    config.pattern = Pattern::new(2, 2, [0, 1, 1, 2]);
    config.channels = 3;
    config.bands = BANDS as u8;
    config.first_band_nm = 400.0;
    config.response = [1e6; 3 * BANDS].into_iter().collect();
    config
}

/// Irradiance for some 4000 e⁻ in the brightest column.
pub fn cube(width: usize, height: usize) -> IrradianceCube {
    let header = CubeHeader::new(
        (width, height),
        &Bands { start_nm: 400.0, step_nm: 10.0, count: BANDS },
        "ramp",
    );
    let ramp = Plane::from_fn(width, height, |x, _| 6.4e-3 * x as f32 / width as f32);
    let mut writer = IrradianceWriter::new(header).expect("valid header");
    (0..BANDS).for_each(|_| writer.push(&ramp).expect("a plane of the header's size"));
    writer.finish().expect("all bands")
}

/// Mean electrons from a cube.
struct FromCube<'a> {
    sums: BandSums<'a, Float>,
    bands: Vec<Chunk<'a>>,
}

impl MeanRows<Float> for FromCube<'_> {
    fn mean_row(&mut self, y: u32, out: &mut [Block<f32>]) {
        Float::COLLECT(&mut self.sums, &self.bands, y, out);
    }
}

/// The whole path from a cube to DN, with positional crosstalk factors, as in `camrig expose`.
pub fn collected_rows(config: &SensorConfig, cube: &IrradianceCube, dn: &mut [u16]) {
    let nodes =
        |n: usize| (0..n).map(|i| i as f32 / (n - 1) as f32 * 2.0 - 1.0).collect::<Vec<_>>();
    let (x, y, nm) = (nodes(NODES.0), nodes(NODES.1), [400.0, 500.0, 600.0, 700.0]);
    let factors: Vec<f32> =
        (0..3 * nm.len() * x.len() * y.len()).map(|i| 0.9 + 0.2 * (i % 7) as f32 / 7.0).collect();
    let crosstalk = Crosstalk { x: &x, y: &y, wavelength_nm: &nm, factors: &factors };
    let bands = (0..BANDS).map(|b| cube.chunk(b, 0, cube.header.height).expect("in memory"));
    let mut source = FromCube {
        bands: bands.collect(),
        sums: BandSums::new(config, &SETTINGS, Some(crosstalk)).expect("valid table"),
    };
    product::rows::<Float>(config, &SETTINGS, &mut source, 0, dn).expect("valid configuration");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_give_the_same_bytes() {
        let config = config(200, 37, &chain());
        let means = means(200, 37);
        let (mut one, mut three) = (vec![0; means.len()], vec![0; means.len()]);
        frame(&config, &means, &mut one, 1);
        frame(&config, &means, &mut three, 3);
        assert_eq!(one, three);
    }
}
