//! A camera as bytes on the link: the configuration of the sensor in the encoding of the
//! `postcard` crate, then the crosstalk table and the tables of empirical effects as f32.
//!
//! ```text
//! u16  bytes of the configuration       u16 x 3  crosstalk columns, rows, wavelengths (0 without)
//! ...  SensorConfig in postcard         f32 ...  x, y, wavelengths in nm, factors
//! u8 x 3  photodiode, window, capture   f32 ...  tables of empirical effects, up to the end
//! ```
//! All numbers are little-endian. Photodiode, window and capture stand there for the captures of a
//! sensor that has several, where they are not all 0. The bytes arrive in pieces; configuration and table each have
//! their own memory. Only the tables of empirical effects are stored twice, as the configuration
//! takes them with it.

use camrig_rig_link::message::Refusal;
use camrig_sensor_core::config::{MAX_BANDS, MAX_CHANNELS, SensorConfig, Streams};
use camrig_sensor_core::crosstalk::Crosstalk;

/// Bytes of the four lengths at the front.
const HEAD_BYTES: usize = 8;

/// Longest configuration in postcard, bytes: a full chain of effects with all their parameters,
/// and as many channels and bands as a sensor may have.
pub const CONFIG_BYTES: usize = 2048 + 4 * MAX_CHANNELS * MAX_BANDS;

/// A received camera.
pub struct CameraStore<'m> {
    head: [u8; HEAD_BYTES],
    config_bytes: [u8; CONFIG_BYTES],
    config: Option<SensorConfig>,
    table: &'m mut [f32],
    /// Bytes that have arrived.
    received: usize,
    word: [u8; 4],
}

impl<'m> CameraStore<'m> {
    /// An empty store with this memory for the crosstalk table (axes and factors).
    pub const fn new(table: &'m mut [f32]) -> Self {
        let (head, config_bytes) = ([0; HEAD_BYTES], [0; CONFIG_BYTES]);
        Self { head, config_bytes, config: None, table, received: 0, word: [0; 4] }
    }

    /// Longest camera that fits, bytes.
    pub fn max_bytes(&self) -> u32 {
        (HEAD_BYTES + CONFIG_BYTES + 4 * self.table.len()) as u32
    }

    /// Configuration of the camera in force.
    pub fn config(&self) -> Option<&SensorConfig> {
        self.config.as_ref()
    }

    /// Its crosstalk table.
    pub fn crosstalk(&self) -> Option<Crosstalk<'_>> {
        let config = self.config.as_ref()?;
        let [columns, rows, wavelengths] = self.table_size();
        let (x, rest) = self.table.split_at_checked(columns)?;
        let (y, rest) = rest.split_at_checked(rows)?;
        let (wavelength_nm, rest) = rest.split_at_checked(wavelengths)?;
        let factors = rest.get(..factors(config.channels, self.table_size()))?;
        (columns > 0).then_some(Crosstalk { x, y, wavelength_nm, factors })
    }

    fn word16(&self, at: usize) -> usize {
        usize::from(u16::from_le_bytes([self.head[at], self.head[at + 1]]))
    }

    fn table_size(&self) -> [usize; 3] {
        [self.word16(2), self.word16(4), self.word16(6)]
    }

    /// Takes the bytes from `offset` on; offset 0 discards the camera in force.
    pub(crate) fn piece(&mut self, offset: u32, piece: &[u8]) -> Result<(), Refusal> {
        if offset == 0 {
            self.config = None;
        }
        self.received = offset as usize + piece.len();
        let too_long = Refusal::CameraTooLong { max: self.max_bytes() };
        for (at, &byte) in (offset as usize..).zip(piece) {
            let after_head = at.wrapping_sub(HEAD_BYTES);
            let config_bytes = self.word16(0);
            let place = if at < HEAD_BYTES {
                self.head.get_mut(at)
            } else if after_head < config_bytes {
                self.config_bytes.get_mut(after_head)
            } else {
                let at = after_head - config_bytes;
                self.word[at % 4] = byte;
                if at % 4 == 3 {
                    *self.table.get_mut(at / 4).ok_or(too_long)? = f32::from_le_bytes(self.word);
                }
                continue;
            };
            *place.ok_or(too_long)? = byte;
        }
        Ok(())
    }

    /// All bytes have arrived: puts the camera in force if it is valid.
    pub(crate) fn end(&mut self) -> Result<(), Refusal> {
        // A camera that was cut short would be completed by bytes of an earlier one.
        let table_bytes = self.received.checked_sub(HEAD_BYTES + self.word16(0));
        let table_bytes =
            table_bytes.filter(|bytes| self.received >= HEAD_BYTES && bytes % 4 == 0);
        let words = table_bytes.ok_or(Refusal::BadCamera)? / 4;
        let bytes = self.config_bytes.get(..self.word16(0)).ok_or(Refusal::BadCamera)?;
        let (mut config, streams): (SensorConfig, _) =
            postcard::take_from_bytes(bytes).map_err(|_| Refusal::BadCamera)?;
        config.streams = match *streams {
            [] => Streams::default(),
            [photodiode, window, capture] => Streams { photodiode, window, capture },
            _ => return Err(Refusal::BadCamera),
        };
        let size = self.table_size();
        let crosstalk =
            size.into_iter().fold(factors(config.channels, size), usize::saturating_add);
        let empirical = self.table.get(crosstalk..words).ok_or(Refusal::BadCamera)?;
        config.table.extend_from_slice(empirical).map_err(|_| Refusal::BadCamera)?;
        config.check().map_err(|_| Refusal::BadCamera)?;
        let channels = usize::from(config.channels);
        self.config = Some(config);
        let sound = match self.crosstalk() {
            Some(table) => table.check(channels).is_ok(),
            None => self.table_size() == [0; 3],
        };
        if sound {
            return Ok(());
        }
        self.config = None;
        Err(Refusal::BadCamera)
    }
}

/// Number of factors of a crosstalk table.
fn factors(channels: u8, size: [usize; 3]) -> usize {
    size.into_iter().fold(channels.into(), usize::saturating_mul)
}

/// Writes a camera into `out` and returns the number of bytes; `None` if it does not fit.
pub fn encode(
    config: &SensorConfig,
    crosstalk: Option<Crosstalk<'_>>,
    out: &mut [u8],
) -> Option<usize> {
    let (head, rest) = out.split_at_mut_checked(HEAD_BYTES)?;
    let mut config_bytes = postcard::to_slice(config, rest).ok()?.len();
    let Streams { photodiode, window, capture } = config.streams;
    if config.streams != Streams::default() {
        let streams = rest.get_mut(config_bytes..)?.first_chunk_mut()?;
        *streams = [photodiode, window, capture];
        config_bytes += streams.len();
    }
    let mut rest = rest.get_mut(config_bytes..)?;
    let (mut sizes, mut table_bytes) = ([config_bytes, 0, 0, 0], 0);
    let mut tables: [&[f32]; 5] = [&[], &[], &[], &[], &config.table];
    if let Some(c) = crosstalk {
        sizes[1..].copy_from_slice(&[c.x.len(), c.y.len(), c.wavelength_nm.len()]);
        tables[..4].copy_from_slice(&[c.x, c.y, c.wavelength_nm, c.factors]);
    }
    for &value in tables.into_iter().flatten() {
        let (word, left) = rest.split_first_chunk_mut::<4>()?;
        *word = value.to_le_bytes();
        (rest, table_bytes) = (left, table_bytes + 4);
    }
    for (out, size) in head.chunks_exact_mut(2).zip(sizes) {
        out.copy_from_slice(&u16::try_from(size).ok()?.to_le_bytes());
    }
    Some(HEAD_BYTES + config_bytes + table_bytes)
}
