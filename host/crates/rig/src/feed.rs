//! The rows of an irradiance cube as they go over the link.

use camrig_base::{Error, Result};
use camrig_exposure::SimulatedSensor;
use camrig_exposure::{Chunk, CubeHeader, IrradianceCube};
use camrig_firmware_sim::memory::UNIT_BYTES;
use camrig_rig_link::message::{Codec, WIDE_GROUPS};
use camrig_sensor_core::arith::{Arith, Float};
use camrig_sensor_core::collect::Collector;
use camrig_sensor_core::config::FrameSettings;
use camrig_sensor_core::spectral::{BandRow, GROUP, encode, groups, is_wide};
use camrig_vector::vectorised;
use rayon::prelude::*;

/// Rows made at a time. A trade: enough for all cores to have some, few enough to stay in the
/// cache.
const ROWS: usize = 64;

/// Gives the spectral rows of a cube, or of the cubes of several captures, unit by unit. Rows at hand
/// are kept in their form on the link.
pub struct Feed<'a> {
    cubes: Vec<&'a IrradianceCube>,
    collapse: Option<&'a SimulatedSensor>,
    /// Rows made at a time: [`ROWS`], or all.
    at_once: usize,
    /// Whether the rig reads groups of high dynamic range.
    reads_wide: bool,
    /// First of the rows in `bytes`.
    first: usize,
    bytes: Vec<u8>,
}

impl<'a> Feed<'a> {
    /// All bands of a cube.
    pub fn spectral(cube: &'a IrradianceCube) -> Self {
        Self::of_captures(vec![cube])
    }

    /// All bands of what all captures of a sensor see, or of what each of them sees; at least one,
    /// all of one size and with the same bands.
    pub fn of_captures(cubes: Vec<&'a IrradianceCube>) -> Self {
        Self {
            cubes,
            collapse: None,
            at_once: ROWS,
            reads_wide: true,
            first: 0,
            bytes: Vec::new(),
        }
    }

    fn header(&self) -> &'a CubeHeader {
        &self.cubes[0].header
    }

    /// Mean electrons per second: the sum over the bands for this sensor. Rounding to 16 bits per
    /// group of 16 pixels adds at most 2⁻¹⁷ of the group's largest value.
    pub fn collapsed(cube: &'a IrradianceCube, sensor: &'a SimulatedSensor) -> Self {
        Self { collapse: Some(sensor), ..Self::spectral(cube) }
    }

    /// Makes all rows at once and keeps them for further frames: [`Feed::bytes`] of memory.
    pub fn kept(self) -> Self {
        Self { at_once: self.header().height, ..self }
    }

    /// Bytes of a frame on the link.
    pub fn bytes(&self) -> usize {
        self.header().height * self.row_bytes()
    }

    /// How its rows are coded.
    pub fn codec(&self) -> Codec {
        if self.collapse.is_some() { Codec::Electrons16 } else { Codec::Bfp16 }
    }

    /// Bands of a row.
    pub fn bands(&self) -> usize {
        if self.collapse.is_some() { 1 } else { self.cubes.len() * self.header().bands }
    }

    fn row_bytes(&self) -> usize {
        self.bands() * groups(self.header().width) * UNIT_BYTES
    }

    /// For a rig with these codecs, as [`Capabilities::codecs`] has them.
    ///
    /// [`Capabilities::codecs`]: camrig_rig_link::message::Capabilities::codecs
    pub fn for_codecs(&mut self, codecs: u8) {
        self.reads_wide = codecs & WIDE_GROUPS != 0;
    }

    /// Fills `out` with the units of row `row` from unit `first` on.
    ///
    /// # Errors
    /// A cube that cannot be read, a sensor that the model refuses; a group of high dynamic range
    /// for a rig that does not read it.
    pub fn units(&mut self, row: usize, first: usize, out: &mut [u8]) -> Result<()> {
        let row_bytes = self.row_bytes();
        if row < self.first || (row - self.first) * row_bytes >= self.bytes.len() {
            self.make(row)?;
        }
        let at = (row - self.first) * row_bytes + first * UNIT_BYTES;
        out.copy_from_slice(&self.bytes[at..at + out.len()]);
        let exponents = || out.iter().step_by(UNIT_BYTES).map(|&byte| byte as i8);
        if !self.reads_wide && exponents().any(is_wide) {
            return Err(Error::unsupported(format!(
                "row {row} has light beside a lamp that is below 1/4096 of it, which this rig does \
                 not read"
            ))
            .help("update the rig's firmware, or expose these frames in this process"));
        }
        Ok(())
    }

    /// Makes rows from `row` on, or all of them.
    fn make(&mut self, row: usize) -> Result<()> {
        let header = self.header();
        let first = if self.at_once == header.height { 0 } else { row };
        let count = self.at_once.min(header.height - first);
        let row_bytes = self.row_bytes();
        self.bytes.resize(count * row_bytes, 0);
        let (cubes, collapse) = (&self.cubes, self.collapse);
        let rows = self.bytes.par_chunks_mut(ROWS.min(count) * row_bytes).enumerate();
        rows.try_for_each(|(i, out)| {
            let first = first + i * ROWS;
            let bands = cubes.iter().flat_map(|cube| (0..header.bands).map(move |b| (cube, b)));
            let load =
                |(cube, b): (&&'a IrradianceCube, _)| cube.chunk(b, first, out.len() / row_bytes);
            let bands = bands.map(load).collect::<Result<Vec<_>>>()?;
            match collapse {
                Some(sensor) => collapsed_rows(sensor, &bands, first, out),
                None => {
                    spectral_rows(&bands, header.width, first, out);
                    Ok(())
                }
            }
        })?;
        self.first = first;
        Ok(())
    }
}

/// Rows from `first` on: band after band.
fn spectral_rows(bands: &[Chunk<'_>], width: usize, first: usize, out: &mut [u8]) {
    let places = out.chunks_mut(groups(width) * UNIT_BYTES);
    for (i, place) in places.enumerate() {
        let row = bands[i % bands.len()].row(width, first + i / bands.len());
        write_units(row, place);
    }
}

/// Rows from `first` on, integrated over the bands.
#[vectorised]
fn collapsed_rows(
    sensor: &SimulatedSensor,
    bands: &[Chunk<'_>],
    first: usize,
    out: &mut [u8],
) -> Result<()> {
    let width = sensor.config.width as usize;
    let one_second = FrameSettings::new(1.0).with_temperature(0.0);
    let mut collector = Collector::<Float>::new(&sensor.config, &one_second, sensor.crosstalk())
        .map_err(|e| {
        Error::unsupported(format!("the sensor model refuses this camera: {e:?}"))
    })?;
    let mut sums = vec![[<Float as Arith>::Sum::default(); GROUP]; groups(width)];
    let (mut exponents, mut mantissas) = (vec![0; groups(width)], vec![0; width]);
    for (row, out) in (first..).zip(out.chunks_mut(groups(width) * UNIT_BYTES)) {
        sums.fill(Default::default());
        for (band, chunk) in bands.iter().enumerate() {
            collector.add_band(row as u32, band, chunk.row(width, row), &mut sums);
        }
        // In f32 a sum is the electrons themselves.
        encode(&sums.as_flattened()[..width], &mut exponents, &mut mantissas);
        write_units(BandRow { exponents: &exponents, mantissas: &mantissas }, out);
    }
    Ok(())
}

/// A unit is a group's exponent and its mantissas; the last one of a row is padded with zeros.
#[inline(always)]
fn write_units(band: BandRow<'_>, out: &mut [u8]) {
    let units = out.chunks_exact_mut(UNIT_BYTES);
    for ((unit, &exponent), mantissas) in
        units.zip(band.exponents).zip(band.mantissas.chunks(GROUP))
    {
        let mut padded = [0; GROUP];
        let mantissas = mantissas.first_chunk().unwrap_or_else(|| {
            padded[..mantissas.len()].copy_from_slice(mantissas);
            &padded
        });
        unit[0] = exponent as u8;
        for (bytes, m) in unit[1..].as_chunks_mut::<2>().0.iter_mut().zip(mantissas) {
            *bytes = m.to_le_bytes();
        }
    }
}
