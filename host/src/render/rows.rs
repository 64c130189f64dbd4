//! Rows of the sensor, compiled for the vector instructions of this machine.
//!
//! A pipeline inlines every effect of the catalogue, which is much code: it is made here once for each
//! arithmetic, and takes its light from whoever has some.

use super::irradiance::Chunk;
use crate::{Error, Result};
use multiversion::multiversion;
use sensor_core::arith::{Arith, BLOCK, Block, Fixed, Float, blocks};
use sensor_core::collect::{Collector, Sums};
use sensor_core::config::{ConfigError, FrameSettings, SensorConfig};
use sensor_core::pipeline::{MeanRows, Pipeline, memory_blocks};
use sensor_core::spectral::GROUP;

/// An arithmetic whose rows are compiled here.
pub trait Vector: Arith {
    /// One row of a frame.
    fn row(
        pipeline: &mut Pipeline<'_, Self>,
        row: u32,
        source: &mut dyn MeanRows<Self>,
        out: &mut [u16],
    );

    /// Mean photo-electrons of row `y` from its bands.
    fn collect(
        collector: &mut Collector<'_, Self>,
        bands: &[Chunk<'_>],
        sums: &mut [Sums<Self::Sum>],
        width: usize,
        y: u32,
        out: &mut [Block<Self::Signal>],
    );
}

macro_rules! vector {
    ($arith:ty, $row:ident, $collect:ident) => {
        #[multiversion(targets(
            "x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl",
            "x86_64+avx2"
        ))]
        fn $row(
            pipeline: &mut Pipeline<'_, $arith>,
            row: u32,
            source: &mut dyn MeanRows<$arith>,
            out: &mut [u16],
        ) {
            pipeline.row(row, source, out);
        }

        #[multiversion(targets(
            "x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl",
            "x86_64+avx2"
        ))]
        fn $collect(
            collector: &mut Collector<'_, $arith>,
            bands: &[Chunk<'_>],
            sums: &mut [Sums<<$arith as Arith>::Sum>],
            width: usize,
            y: u32,
            out: &mut [Block<<$arith as Arith>::Signal>],
        ) {
            collect(collector, bands, sums, width, y, out);
        }

        impl Vector for $arith {
            fn row(
                pipeline: &mut Pipeline<'_, Self>,
                row: u32,
                source: &mut dyn MeanRows<Self>,
                out: &mut [u16],
            ) {
                $row(pipeline, row, source, out);
            }

            fn collect(
                collector: &mut Collector<'_, Self>,
                bands: &[Chunk<'_>],
                sums: &mut [Sums<Self::Sum>],
                width: usize,
                y: u32,
                out: &mut [Block<Self::Signal>],
            ) {
                $collect(collector, bands, sums, width, y, out);
            }
        }
    };
}

vector!(Float, row_float, collect_float);
vector!(Fixed, row_fixed, collect_fixed);

#[inline(always)]
fn collect<A: Arith>(
    collector: &mut Collector<'_, A>,
    bands: &[Chunk<'_>],
    sums: &mut [Sums<A::Sum>],
    width: usize,
    y: u32,
    out: &mut [Block<A::Signal>],
) {
    sums.fill([A::Sum::default(); GROUP]);
    for (band, rows) in bands.iter().enumerate() {
        collector.add_band(y, band, rows.row(width, y as usize), sums);
    }
    let mut groups = sums.iter();
    for block in out.iter_mut().take(blocks(width)) {
        for half in block.chunks_mut(GROUP) {
            let sums = groups.next().copied().unwrap_or([A::Sum::default(); GROUP]);
            half.iter_mut().zip(sums).for_each(|(v, s)| *v = A::collected(s));
        }
    }
}

/// Computes the rows from `first` on that fill `out`.
///
/// # Errors
/// A configuration or settings that the sensor refuses.
pub fn rows<A: Vector>(
    config: &SensorConfig,
    settings: &FrameSettings,
    source: &mut dyn MeanRows<A>,
    first: usize,
    out: &mut [u16],
) -> Result<()> {
    let mut memory = vec![[A::Signal::default(); BLOCK]; memory_blocks(config)];
    let mut pipeline = Pipeline::<A>::new(config, settings, &mut memory).map_err(refused)?;
    for (y, out) in (first..).zip(out.chunks_mut(config.width as usize)) {
        A::row(&mut pipeline, y as u32, source, out);
    }
    Ok(())
}

/// What the sensor model objects to, in words.
pub fn refused(e: ConfigError) -> Error {
    match e {
        ConfigError::Settings => Error::input("exposure, gain or temperature is out of range")
            .help("exposure and gain are positive numbers"),
        e => Error::input(format!("the sensor model refuses this configuration: {e:?}")),
    }
}
