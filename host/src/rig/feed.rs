//! The rows of an irradiance cube as they go over the link.

use crate::render::{Chunk, Exposure, IrradianceCube};
use crate::{Error, Result};
use firmware_sim::rig::UNIT_BYTES;
use sensor_core::arith::{Arith, Float};
use sensor_core::collect::{Collector, Sums};
use sensor_core::config::FrameSettings;
use sensor_core::spectral::{BandRow, GROUP, encode, groups};

/// Rows read from a cube at a time.
const ROWS: usize = 64;

/// Gives the spectral rows of a cube, unit by unit. The row at hand is kept in its form on the link.
pub struct Feed<'a> {
    cube: &'a IrradianceCube,
    collapse: Option<Collapse<'a>>,
    /// Rows of every band, from `first` to `end`.
    chunks: Vec<Chunk<'a>>,
    first: usize,
    end: usize,
    row: Option<usize>,
    bytes: Vec<u8>,
}

/// Integrates the bands on this side of the link.
struct Collapse<'a> {
    collector: Collector<'a, Float>,
    sums: Vec<Sums<<Float as Arith>::Sum>>,
}

impl<'a> Feed<'a> {
    /// All bands of a cube.
    pub fn spectral(cube: &'a IrradianceCube) -> Self {
        Self {
            cube,
            collapse: None,
            chunks: Vec::new(),
            first: 0,
            end: 0,
            row: None,
            bytes: Vec::new(),
        }
    }

    /// Mean electrons: the sum over the bands for this sensor, exposure included. Rounding to 16 bits
    /// per group of 16 pixels adds at most 2⁻¹⁷ of the group's largest value.
    pub fn collapsed(
        cube: &'a IrradianceCube,
        exposure: &'a Exposure,
        settings: &FrameSettings,
    ) -> Result<Self> {
        let collector = Collector::new(&exposure.config, settings, exposure.crosstalk())
            .map_err(|e| Error::input(format!("the sensor model refuses these settings: {e:?}")))?;
        let sums = vec![Default::default(); groups(cube.header.width)];
        Ok(Self { collapse: Some(Collapse { collector, sums }), ..Self::spectral(cube) })
    }

    /// Fills `out` with the units of row `row` from unit `first` on.
    pub fn units(&mut self, row: usize, first: usize, out: &mut [u8]) -> Result<()> {
        if self.row != Some(row) {
            self.load(row)?;
            self.row = Some(row);
        }
        let at = first * UNIT_BYTES;
        out.copy_from_slice(&self.bytes[at..at + out.len()]);
        Ok(())
    }

    fn load(&mut self, row: usize) -> Result<()> {
        let header = &self.cube.header;
        if !(self.first..self.end).contains(&row) {
            self.chunks.clear();
            (self.first, self.end) = (row, (row + ROWS).min(header.height));
            for band in 0..header.bands {
                self.chunks.push(self.cube.chunk(band, self.first, self.end - self.first)?);
            }
        }
        self.bytes.clear();
        let Some(Collapse { collector, sums }) = &mut self.collapse else {
            for chunk in &self.chunks {
                push_band(chunk.row(header.width, row), &mut self.bytes);
            }
            return Ok(());
        };
        sums.fill(Default::default());
        for (band, chunk) in self.chunks.iter().enumerate() {
            collector.add_band(row as u32, band, chunk.row(header.width, row), sums);
        }
        let sums = &sums.as_flattened()[..header.width];
        let electrons: Vec<f32> =
            sums.iter().map(|&s| Float::electrons(Float::collected(s))).collect();
        let (mut exponents, mut mantissas) = (vec![0; groups(header.width)], vec![0; header.width]);
        encode(&electrons, &mut exponents, &mut mantissas);
        let whole = BandRow { exponents: &exponents, mantissas: &mantissas };
        push_band(whole, &mut self.bytes);
        Ok(())
    }
}

/// A unit is a group's exponent and its mantissas; the last one of a row is padded with zeros.
fn push_band(band: BandRow<'_>, bytes: &mut Vec<u8>) {
    let start = bytes.len();
    bytes.resize(start + band.exponents.len() * UNIT_BYTES, 0);
    let units = bytes[start..].chunks_exact_mut(UNIT_BYTES);
    for ((unit, &exponent), mantissas) in
        units.zip(band.exponents).zip(band.mantissas.chunks(GROUP))
    {
        unit[0] = exponent as u8;
        for (bytes, m) in unit[1..].chunks_exact_mut(2).zip(mantissas) {
            bytes.copy_from_slice(&m.to_le_bytes());
        }
    }
}
