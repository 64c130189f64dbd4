//! The row loop of a camera firmware: spectral rows in, raw rows out, in memory of fixed size.
//!
//! Everything but `main` is what a `no_std` firmware has: no allocator, no file, no thread. On a
//! microcontroller [`Memory`] lies in a `static`, `receive_band` reads from the link (USB, a
//! serial line, a DMA buffer) and `send_row` writes to it. A part without FPU takes `Fixed`
//! instead of `Float`.
//!
//! ```text
//! cargo run -p camrig-sensor-core --example row_loop
//! ```

use camrig_sensor_core::arith::{Arith, BLOCK, Block, Float as Arithmetic, blocks};
use camrig_sensor_core::collect::{Collector, Sums};
use camrig_sensor_core::config::{ConfigError, FrameSettings, Pattern, SensorConfig};
use camrig_sensor_core::effects::charge_coupling::ChargeCoupling;
use camrig_sensor_core::effects::dark_current::DarkCurrent;
use camrig_sensor_core::effects::full_well::FullWell;
use camrig_sensor_core::effects::prnu::Prnu;
use camrig_sensor_core::effects::read_noise::ReadNoise;
use camrig_sensor_core::effects::row_offset_fpn::RowOffsetFpn;
use camrig_sensor_core::effects::shot_noise::ShotNoise;
use camrig_sensor_core::pipeline::{Pipeline, memory_blocks};
use camrig_sensor_core::spectral::{BandRow, GROUP, encode, groups};

type Signal = <Arithmetic as Arith>::Signal;
type Sum = <Arithmetic as Arith>::Sum;

/// Pixels in a row.
const WIDTH: usize = 200;
/// Rows.
const HEIGHT: u32 = 16;
/// Spectral bands, each 50 nm wide.
const BANDS: usize = 6;
/// Rows of signals: one, and three for the one effect that reads neighbouring rows
/// ([`memory_blocks`] says how many blocks a sensor needs).
const ROWS: usize = 4;

/// All memory of the row loop: 5.7 kB for rows of 200 pixels.
struct Memory {
    /// Working rows of the signal chain.
    rows: [Block<Signal>; ROWS * blocks(WIDTH)],
    /// Mean photo-electrons of the row that is being collected.
    sums: [Sums<Sum>; groups(WIDTH)],
    /// The band that has just arrived: an exponent for 16 pixels, a mantissa for each.
    exponents: [i8; groups(WIDTH)],
    mantissas: [u16; WIDTH],
    /// The row that leaves, DN.
    dn: [u16; WIDTH],
}

impl Memory {
    const fn new() -> Self {
        Self {
            rows: [[0.0; BLOCK]; ROWS * blocks(WIDTH)],
            sums: [[0.0; GROUP]; groups(WIDTH)],
            exponents: [0; groups(WIDTH)],
            mantissas: [0; WIDTH],
            dn: [0; WIDTH],
        }
    }
}

/// A Bayer sensor, 12 bits. On a rig it arrives over the link, in postcard.
fn sensor() -> SensorConfig {
    let mut config = SensorConfig::new(WIDTH as u32, HEIGHT);
    config.pattern = Pattern::new(2, 2, [0, 1, 1, 2]);
    config.channels = 3;
    config.bands = BANDS as u8;
    config.first_band_nm = 425.0;
    config.band_step_nm = 50.0;
    config.response = [
        [1e6, 1e6, 2e6, 8e6, 2e7, 1.8e7],
        [2e6, 1.2e7, 2.2e7, 1.5e7, 4e6, 2e6],
        [1.6e7, 1.8e7, 6e6, 1e6, 5e5, 5e5],
    ]
    .into_iter()
    .flatten()
    .collect();
    config.seed = 1;
    config.effects = [
        ShotNoise {}.into(),
        Prnu { sigma: 0.01 }.into(),
        DarkCurrent { mean_e_per_s: 20.0, dsnu_e_per_s: 5.0, doubling_c: 7.0, reference_c: 25.0 }
            .into(),
        ChargeCoupling { side: 0.01, vertical: 0.01, diagonal: 0.0 }.into(),
        FullWell { full_well_e: 10_000.0, knee: 0.0 }.into(),
        RowOffsetFpn::from_values(&[0.5]).into(),
        ReadNoise { read_e: 2.5, read_e_post: 1.0 }.into(),
    ]
    .into_iter()
    .collect();
    config
}

/// One frame, row by row.
///
/// `receive_band` fills in band `band` of spectral row `row`; `send_row` takes the DN of a raw
/// row. Rows are asked for in rising order, once each; with an effect that reads its neighbours
/// one row ahead of the raw row that they make.
///
/// # Errors
/// What the sensor model refuses about the sensor, the settings or the size of the memory.
fn frame(
    config: &SensorConfig,
    settings: &FrameSettings,
    memory: &mut Memory,
    mut receive_band: impl FnMut(u32, usize, &mut [i8], &mut [u16]),
    mut send_row: impl FnMut(u32, &[u16]),
) -> Result<(), ConfigError> {
    let Memory { rows, sums, exponents, mantissas, dn } = memory;
    let mut collector = Collector::<Arithmetic>::new(config, settings, None)?;
    let mut pipeline = Pipeline::<Arithmetic>::new(config, settings, rows)?;
    // Called by the pipeline for each row that it needs: mean photo-electrons per pixel.
    let mut light = |row: u32, out: &mut [Block<Signal>]| {
        sums.fill([Sum::default(); GROUP]);
        for band in 0..usize::from(config.bands) {
            receive_band(row, band, exponents, mantissas);
            collector.add_band(row, band, BandRow { exponents, mantissas }, sums);
        }
        for (mean, sum) in out.as_flattened_mut().iter_mut().zip(sums.as_flattened()) {
            *mean = Arithmetic::collected(*sum);
        }
    };
    for row in 0..config.height {
        pipeline.row(row, &mut light, dn);
        send_row(row, dn);
    }
    Ok(())
}

/// Irradiance of the test scene, W m⁻² nm⁻¹: a ramp from left to right, the same in each band.
fn irradiance(x: usize) -> f32 {
    0.002 * (x + 1) as f32 / WIDTH as f32
}

fn main() -> Result<(), ConfigError> {
    let config = sensor();
    let settings = FrameSettings::new(0.02);
    let mut memory = Memory::new();
    assert_eq!(memory.rows.len(), memory_blocks(&config));
    println!("{} bytes of memory", size_of::<Memory>());

    let receive_band = |_row: u32, _band: usize, exponents: &mut [i8], mantissas: &mut [u16]| {
        let values: [f32; WIDTH] = core::array::from_fn(irradiance);
        encode(&values, exponents, mantissas);
    };
    // Mean DN of the right half of the rows with red and green.
    let (mut sum, mut count) = (0.0, 0.0);
    let send_row = |row: u32, dn: &[u16]| {
        println!("row {row:2}: {:?} ... {:?}", &dn[..6], &dn[WIDTH - 6..]);
        if row.is_multiple_of(2) {
            for &d in &dn[WIDTH / 2..] {
                (sum, count) = (sum + f64::from(d), count + 1.0);
            }
        }
    };
    frame(&config, &settings, &mut memory, receive_band, send_row)?;

    // Electrons per second and unit of irradiance, summed over the bands.
    let response = |channel: usize| {
        config.response[channel * BANDS..][..BANDS].iter().map(|&r| f64::from(r)).sum::<f64>()
    };
    // Red keeps 0.96 and has four green neighbours; green has two red and two blue ones.
    let coupled = 0.49 * response(0) + 0.5 * response(1) + 0.01 * response(2);
    let light = f64::from(irradiance(3 * WIDTH / 4)) * f64::from(settings.exposure_s);
    let expected = 64.0 + light * coupled * f64::from(config.dn_per_e(settings.analog_gain));
    println!("mean of the right half: {:.1} DN, expected {expected:.1}", sum / count);
    assert!((sum / count - expected).abs() < 0.01 * expected);
    Ok(())
}
