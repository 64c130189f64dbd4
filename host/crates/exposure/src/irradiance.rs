//! Spectral irradiance on the sensor grid, in memory or in a file.
//!
//! Samples are in the 16-bit block floating point of [`camrig_sensor_core::spectral`]: what a
//! sensor takes in, on a workstation and over a rig's link alike.
//!
//! # File
//! `CAMRIGIR`, the length of the header as u32 little-endian, the header (JSON, [`CubeHeader`]),
//! then for each band for each row: one exponent (i8) per 16 pixels, one mantissa (u16
//! little-endian) per pixel. Irradiance in W m⁻² nm⁻¹ is mantissa x 2^exponent, but for groups of
//! high dynamic range, whose exponents are 112 and above. Nothing follows.

use camrig_base::output::OutputFile;
use camrig_base::platform::read_at;
use camrig_base::{Bands, Spectrum};
use camrig_base::{Error, ErrorCode, Plane, Result};
use camrig_sensor_core::spectral::{BandRow, decode, encode, groups};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 8] = b"CAMRIGIR";

/// Longest header that is read: curves of thousands of samples, with room to spare.
const MAX_HEADER_BYTES: u64 = 1 << 24;

/// What a cube is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CubeHeader {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Centre of band 0, nm.
    pub first_band_nm: f64,
    /// Distance of bands, nm.
    pub band_step_nm: f64,
    /// Number of bands.
    pub bands: usize,
    /// Factor on the samples that makes them W m⁻² nm⁻¹. Lets one result of the optics stage, kept
    /// for a white of 1, serve every light level.
    #[serde(default = "one")]
    pub level: f64,
    /// Scene illuminance for which it was made, lx, where there is one.
    pub lux: Option<f64>,
    /// Illuminant of a reflectance scene.
    pub illuminant: Option<String>,
    /// Spectrum of the light on the sensor within a band, up to a factor per band, as a product of
    /// curves: the illuminant and what it passes. It decides what a sensor makes of a band. Empty
    /// where light is even within each band, and in files of older versions.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub light: Vec<Spectrum>,
    /// Scene and lens in words, for people.
    pub made_of: String,
    /// The part of a camera that is in the samples already, lens, pixel and effects of the optics:
    /// keys of a camera file and their values. Empty where it is not known, as in files of older
    /// versions.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub made_for: BTreeMap<String, String>,
}

fn one() -> f64 {
    1.0
}

impl CubeHeader {
    /// Key of the response in [`Self::made_for`] of cubes of electrons per second.
    pub const RESPONSE: &str = "sensor.response";

    /// Of a cube of irradiance of `size` (columns, rows) in some bands, made of what it says; in
    /// W m⁻² nm⁻¹ as the samples are, with light that is even within each band.
    pub fn new(size: (usize, usize), bands: &Bands, made_of: impl Into<String>) -> Self {
        Self {
            width: size.0,
            height: size.1,
            first_band_nm: bands.start_nm,
            band_step_nm: bands.step_nm,
            bands: bands.count,
            level: 1.0,
            lux: None,
            illuminant: None,
            light: Vec::new(),
            made_of: made_of.into(),
            made_for: BTreeMap::new(),
        }
    }

    /// Whether the cube holds electrons per second, made for one response, in place of irradiance.
    pub fn holds_electrons(&self) -> bool {
        self.made_for.contains_key(Self::RESPONSE)
    }

    /// The bands.
    pub fn spectral_bands(&self) -> Bands {
        Bands { start_nm: self.first_band_nm, step_nm: self.band_step_nm, count: self.bands }
    }

    fn row_bytes(&self) -> usize {
        groups(self.width) + 2 * self.width
    }

    /// Bytes of the samples.
    pub fn payload_bytes(&self) -> u64 {
        self.row_bytes() as u64 * self.height as u64 * self.bands as u64
    }

    #[allow(clippy::nonminimal_bool, reason = "a step that is no number must be refused")]
    fn check(&self) -> Result<()> {
        let side = 1..=camrig_sensor_core::config::MAX_SIDE as usize;
        if !side.contains(&self.width)
            || !side.contains(&self.height)
            || !(1..=camrig_sensor_core::config::MAX_BANDS).contains(&self.bands)
            || !self.first_band_nm.is_finite()
            || !(self.band_step_nm > 0.0)
            || !(self.level > 0.0 && self.level.is_finite())
        {
            return Err(Error::limit(format!(
                "an irradiance cube of {} x {} pixels in {} bands of {} nm",
                self.width, self.height, self.bands, self.band_step_nm
            ))
            .help(format!(
                "sides of 1 to {} pixels, 1 to {} bands",
                camrig_sensor_core::config::MAX_SIDE,
                camrig_sensor_core::config::MAX_BANDS
            )));
        }
        Ok(())
    }
}

/// Least number of rows that are encoded by one task.
const ROWS_AT_ONCE: usize = 32;

/// Some rows of one band.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BandRows {
    exponents: Vec<i8>,
    mantissas: Vec<u16>,
}

impl BandRows {
    fn row(&self, width: usize, row: usize) -> BandRow<'_> {
        let per_row = groups(width);
        BandRow {
            exponents: &self.exponents[row * per_row..(row + 1) * per_row],
            mantissas: &self.mantissas[row * width..(row + 1) * width],
        }
    }

    /// Encodes rows of `width` values each.
    fn encoded(values: &[f32], width: usize) -> Self {
        let rows = values.len() / width;
        let mut encoded =
            Self { exponents: vec![0; rows * groups(width)], mantissas: vec![0; rows * width] };
        let targets = encoded
            .exponents
            .par_chunks_exact_mut(groups(width))
            .zip(encoded.mantissas.par_chunks_exact_mut(width));
        values
            .par_chunks_exact(width)
            .zip(targets)
            .with_min_len(ROWS_AT_ONCE)
            .for_each(|(values, (exponents, mantissas))| encode(values, exponents, mantissas));
        encoded
    }

    fn to_bytes(&self, width: usize) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(self.exponents.len() + 2 * self.mantissas.len());
        let rows = self.exponents.chunks(groups(width)).zip(self.mantissas.chunks(width));
        for (exponents, mantissas) in rows {
            bytes.extend(exponents.iter().map(|&e| e as u8));
            bytes.extend(mantissas.iter().flat_map(|m| m.to_le_bytes()));
        }
        bytes
    }

    fn from_bytes(bytes: &[u8], width: usize) -> Self {
        let mut rows = Self::default();
        for row in bytes.chunks_exact(groups(width) + 2 * width) {
            let (exponents, mantissas) = row.split_at(groups(width));
            rows.exponents.extend(exponents.iter().map(|&e| e as i8));
            rows.mantissas
                .extend(mantissas.chunks_exact(2).map(|m| u16::from_le_bytes([m[0], m[1]])));
        }
        rows
    }
}

enum Store {
    /// Every band in memory.
    Memory(Vec<BandRows>),
    /// One row per band that serves for all rows.
    Uniform(Vec<BandRows>),
    /// A file; samples start at the offset.
    File { file: File, path: PathBuf, offset: u64 },
}

/// Spectral irradiance on a sensor grid.
pub struct IrradianceCube {
    /// What it is.
    pub header: CubeHeader,
    store: Store,
}

impl IrradianceCube {
    /// The same irradiance on every pixel, one value (W m⁻² nm⁻¹) per band.
    pub fn uniform(header: CubeHeader, per_band: &[f32]) -> Result<Self> {
        header.check()?;
        let rows =
            per_band.iter().map(|&v| BandRows::encoded(&vec![v; header.width], header.width));
        Ok(Self { store: Store::Uniform(rows.collect()), header })
    }

    /// Opens a file. Its size must be what its header says; the samples are read when asked for.
    pub fn open(path: &Path) -> Result<Self> {
        Self::open_checked(path).map_err(|e| e.at(path.display()))
    }

    fn open_checked(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|e| Error::io("open", path, e))?;
        let size = file.metadata().map_err(|e| Error::io("read", path, e))?.len();
        let no_cube = |what: &str| {
            Error::input(format!("not an irradiance cube: {what}"))
                .help("give a file in which irradiance was saved")
                .with_code(ErrorCode::NoIrradiance)
        };
        let mut start = [0; 12];
        read_at(&file, &mut start, 0).map_err(|_| no_cube("the file is too short"))?;
        let (magic, length) = start.split_at(8);
        if magic != MAGIC {
            return Err(no_cube("it does not begin with CAMRIGIR"));
        }
        let length = u64::from(u32::from_le_bytes([length[0], length[1], length[2], length[3]]));
        if length > MAX_HEADER_BYTES || 12 + length > size {
            return Err(no_cube("the header is longer than the file"));
        }
        let mut text = vec![0; length as usize];
        read_at(&file, &mut text, 12).map_err(|e| Error::io("read", path, e))?;
        let header: CubeHeader =
            serde_json::from_slice(&text).map_err(|e| no_cube(&format!("header: {e}")))?;
        header.check()?;
        let offset = 12 + length;
        if size != offset + header.payload_bytes() {
            return Err(no_cube(&format!(
                "{size} bytes where {} x {} pixels in {} bands take {}: the file is truncated or \
                 damaged",
                header.width,
                header.height,
                header.bands,
                offset + header.payload_bytes()
            )));
        }
        Ok(Self { header, store: Store::File { file, path: path.to_owned(), offset } })
    }

    /// Writes the cube to a file.
    pub fn save(&self, path: &Path, force: bool) -> Result<()> {
        let mut output = OutputFile::create(path, force)?;
        let text = serde_json::to_vec(&self.header)
            .map_err(|e| Error::input(format!("header of the irradiance cube: {e}")))?;
        let failed = |e| Error::io("write", path, e);
        output.write_all(MAGIC).map_err(failed)?;
        output.write_all(&(text.len() as u32).to_le_bytes()).map_err(failed)?;
        output.write_all(&text).map_err(failed)?;
        const ROWS: usize = 64;
        for band in 0..self.header.bands {
            for first in (0..self.header.height).step_by(ROWS) {
                let rows = ROWS.min(self.header.height - first);
                let chunk = self.chunk(band, first, rows)?;
                for y in first..first + rows {
                    let row = chunk.row(self.header.width, y);
                    let rows = BandRows {
                        exponents: row.exponents.to_vec(),
                        mantissas: row.mantissas.to_vec(),
                    };
                    output.write_all(&rows.to_bytes(self.header.width)).map_err(failed)?;
                }
            }
        }
        output.finish()
    }

    /// One band, in W m⁻² nm⁻¹ (electrons per second where [`CubeHeader::holds_electrons`] says so).
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn plane(&self, band: usize) -> Result<Plane<f32>> {
        let CubeHeader { width, height, level, .. } = self.header;
        let mut plane = Plane::filled(width, height, 0.0);
        let chunk = self.chunk(band, 0, height)?;
        for (y, row) in plane.data.chunks_mut(width).enumerate() {
            decode(chunk.row(width, y), row);
            row.iter_mut().for_each(|value| *value *= level as f32);
        }
        Ok(plane)
    }

    /// Some rows of one band.
    pub fn chunk(&self, band: usize, first: usize, rows: usize) -> Result<Chunk<'_>> {
        let width = self.header.width;
        Ok(match &self.store {
            Store::Memory(bands) => {
                Chunk { first: 0, only: false, rows: Cow::Borrowed(&bands[band]) }
            }
            Store::Uniform(bands) => {
                Chunk { first: 0, only: true, rows: Cow::Borrowed(&bands[band]) }
            }
            Store::File { file, path, offset } => {
                let row_bytes = self.header.row_bytes();
                let mut bytes = vec![0; rows * row_bytes];
                let row = band as u64 * self.header.height as u64 + first as u64;
                read_at(file, &mut bytes, offset + row * row_bytes as u64)
                    .map_err(|e| Error::io("read", path, e))?;
                Chunk { first, only: false, rows: Cow::Owned(BandRows::from_bytes(&bytes, width)) }
            }
        })
    }
}

/// Rows of one band of a cube.
pub struct Chunk<'a> {
    first: usize,
    only: bool,
    rows: Cow<'a, BandRows>,
}

impl Chunk<'_> {
    /// Row `y` of the cube.
    pub fn row(&self, width: usize, y: usize) -> BandRow<'_> {
        self.rows.row(width, if self.only { 0 } else { y - self.first })
    }
}

/// Takes a cube band by band from the optics stage.
pub struct IrradianceWriter {
    header: CubeHeader,
    bands: Vec<BandRows>,
    spill: Option<File>,
}

/// Cubes above this size are kept in an unnamed temporary file.
const MEMORY_LIMIT_BYTES: u64 = 512 << 20;

impl IrradianceWriter {
    /// A writer for a cube of this header.
    pub fn new(header: CubeHeader) -> Result<Self> {
        header.check()?;
        let spill = if header.payload_bytes() > MEMORY_LIMIT_BYTES {
            let temporary = std::env::temp_dir();
            Some(tempfile::tempfile().map_err(|e| Error::io("write a file in", &temporary, e))?)
        } else {
            None
        };
        Ok(Self { header, bands: Vec::new(), spill })
    }

    /// Adds the next band, W m⁻² nm⁻¹.
    pub fn push(&mut self, plane: &Plane<f32>) -> Result<()> {
        let (w, h) = (self.header.width, self.header.height);
        if (plane.width, plane.height) != (w, h) || plane.data.len() != w * h {
            return Err(Error::input(format!(
                "a band of {} x {} in a cube of {w} x {h}",
                plane.width, plane.height
            )));
        }
        let rows = BandRows::encoded(&plane.data, w);
        match &mut self.spill {
            Some(file) => file
                .write_all(&rows.to_bytes(w))
                .map_err(|e| Error::io("write a file in", &std::env::temp_dir(), e))?,
            None => self.bands.push(rows),
        }
        Ok(())
    }

    /// The finished cube.
    pub fn finish(self) -> Result<IrradianceCube> {
        let store = match self.spill {
            Some(file) => Store::File { file, path: std::env::temp_dir(), offset: 0 },
            None if self.bands.len() == self.header.bands => Store::Memory(self.bands),
            None => {
                return Err(Error::input(format!(
                    "{} of {} bands",
                    self.bands.len(),
                    self.header.bands
                )));
            }
        };
        Ok(IrradianceCube { header: self.header, store })
    }
}
