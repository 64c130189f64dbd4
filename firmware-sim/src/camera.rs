//! A camera as bytes on the link: the configuration of the sensor in the encoding of the
//! `postcard` crate, then the crosstalk table and the tables of empirical effects as f32.
//!
//! ```text
//! u16  bytes of the configuration       u16 x 3  crosstalk columns, rows, wavelengths (0 without)
//! ...  SensorConfig in postcard         f32 ...  x, y, wavelengths in nm, factors
//! u8 x 3  photodiode, window, capture   f32 ...  tables of empirical effects, up to the end
//! ```
//! All numbers are little-endian. Photodiode, window and capture stand there for the captures of a
//! sensor that has several, where they are not all 0. Such a sensor is several cameras:
//!
//! ```text
//! u16  0                                u16  bytes of the readout
//! ...  Readout in postcard
//! for each capture:  u32  its bytes     ...  the camera that it is, as above
//! ```
//! The bytes arrive in pieces; configurations and tables have their own memory. Only the tables of
//! empirical effects are stored twice, as the configuration takes them with it.

use camrig_rig_link::message::Refusal;
use camrig_sensor_core::config::{MAX_BANDS, MAX_CHANNELS, SensorConfig, Streams};
use camrig_sensor_core::crosstalk::Crosstalk;
use camrig_sensor_core::hdr::{MAX_CAPTURES, Readout};
use core::iter;

/// Bytes of the four lengths at the front.
const HEAD_BYTES: usize = 8;
/// Bytes at the front of a sensor of several captures.
const SEVERAL_BYTES: usize = 4;
/// Bytes of a capture's length.
const LENGTH_BYTES: usize = 4;

/// Longest configuration in postcard, bytes: a full chain of effects with all their parameters,
/// and as many channels and bands as a sensor may have. A readout is shorter.
pub const CONFIG_BYTES: usize = 2048 + 4 * MAX_CHANNELS * MAX_BANDS;

/// Memory for a capture of a camera.
pub struct CaptureMemory(Option<Held>);

impl CaptureMemory {
    /// No capture yet.
    pub const EMPTY: Self = Self(None);
}

/// A capture that has arrived.
struct Held {
    config: SensorConfig,
    /// Where its crosstalk table begins, and its columns, rows and wavelengths.
    table_at: usize,
    table_size: [usize; 3],
}

/// What the bytes that arrive belong to.
#[derive(Clone, Copy)]
enum Section {
    /// A camera of one capture, up to the end of the bytes.
    Only,
    /// The readout, of so many bytes.
    Readout(usize),
    /// The length of a capture.
    Length,
    /// A capture of so many bytes.
    Capture(usize),
}

/// A received camera.
pub struct CameraStore<'m> {
    first: CaptureMemory,
    others: &'m mut [CaptureMemory],
    readout: Option<Readout>,
    /// Captures that have arrived.
    captures: usize,
    /// Whether they are in force.
    ready: bool,
    table: &'m mut [f32],
    /// Words of the table that these captures use.
    words: usize,
    section: Section,
    /// Bytes of the section that have arrived.
    received: usize,
    head: [u8; HEAD_BYTES],
    bytes: [u8; CONFIG_BYTES],
    word: [u8; 4],
}

/// A capture of a camera in force.
#[derive(Clone, Copy)]
pub struct Capture<'c> {
    /// Its sensor.
    pub config: &'c SensorConfig,
    /// Its crosstalk table.
    pub crosstalk: Option<Crosstalk<'c>>,
}

impl<'m> CameraStore<'m> {
    /// An empty store with this memory for the crosstalk tables (axes and factors), and for the
    /// captures after the first.
    pub const fn new(table: &'m mut [f32], others: &'m mut [CaptureMemory]) -> Self {
        Self {
            first: CaptureMemory::EMPTY,
            others,
            readout: None,
            captures: 0,
            ready: false,
            table,
            words: 0,
            section: Section::Only,
            received: 0,
            head: [0; HEAD_BYTES],
            bytes: [0; CONFIG_BYTES],
            word: [0; 4],
        }
    }

    /// Most captures of a camera.
    pub fn max_captures(&self) -> usize {
        (1 + self.others.len()).min(MAX_CAPTURES)
    }

    /// Longest camera that fits, bytes.
    pub fn max_bytes(&self) -> u32 {
        let more = match self.max_captures() {
            1 => 0,
            n => SEVERAL_BYTES + LENGTH_BYTES + n * (LENGTH_BYTES + HEAD_BYTES + CONFIG_BYTES),
        };
        (HEAD_BYTES + CONFIG_BYTES + more + 4 * self.table.len()) as u32
    }

    /// The captures of the camera in force, in order: one of a plain camera, none without a camera.
    pub fn captures(&self) -> impl Iterator<Item = Capture<'_>> {
        let held = iter::once(&self.first).chain(self.others.iter());
        let held = held.take(if self.ready { self.captures } else { 0 });
        held.filter_map(|memory| memory.0.as_ref())
            .map(|held| Capture { config: &held.config, crosstalk: self.crosstalk(held) })
    }

    /// Configuration of the camera in force, or of its first capture: all have its size.
    pub fn config(&self) -> Option<&SensorConfig> {
        self.captures().next().map(|capture| capture.config)
    }

    /// What a camera of several captures makes of them.
    pub fn readout(&self) -> Option<&Readout> {
        self.readout.as_ref()
    }

    fn crosstalk(&self, held: &Held) -> Option<Crosstalk<'_>> {
        let [columns, rows, wavelengths] = held.table_size;
        let (x, rest) = self.table.get(held.table_at..)?.split_at_checked(columns)?;
        let (y, rest) = rest.split_at_checked(rows)?;
        let (wavelength_nm, rest) = rest.split_at_checked(wavelengths)?;
        let factors = rest.get(..factors(held.config.channels, held.table_size))?;
        (columns > 0).then_some(Crosstalk { x, y, wavelength_nm, factors })
    }

    fn word16(&self, at: usize) -> usize {
        usize::from(u16::from_le_bytes([self.head[at], self.head[at + 1]]))
    }

    /// Takes the bytes from `offset` on, which follow those before; offset 0 discards the camera in
    /// force.
    pub(crate) fn piece(&mut self, offset: u32, piece: &[u8]) -> Result<(), Refusal> {
        if offset == 0 {
            (self.ready, self.readout) = (false, None);
            (self.captures, self.words) = (0, 0);
            (self.section, self.received) = (Section::Only, 0);
        }
        piece.iter().try_for_each(|&byte| self.byte(byte))
    }

    /// Takes the next byte.
    fn byte(&mut self, byte: u8) -> Result<(), Refusal> {
        let too_long = Refusal::CameraTooLong { max: self.max_bytes() };
        match self.section {
            Section::Only | Section::Capture(_) => self.of_capture(byte).ok_or(too_long)?,
            Section::Readout(_) => *self.bytes.get_mut(self.received).ok_or(too_long)? = byte,
            Section::Length => self.head[self.received % HEAD_BYTES] = byte,
        }
        self.received += 1;
        let next = match self.section {
            Section::Only if self.received == SEVERAL_BYTES && self.word16(0) == 0 => {
                Section::Readout(self.word16(2))
            }
            Section::Readout(bytes) if self.received == bytes => {
                let readout = self.bytes.get(..bytes).ok_or(Refusal::BadCamera)?;
                let (readout, rest): (Readout, _) =
                    postcard::take_from_bytes(readout).map_err(|_| Refusal::BadCamera)?;
                readout.check().map_err(|_| Refusal::BadCamera)?;
                if !rest.is_empty() {
                    return Err(Refusal::BadCamera);
                }
                self.readout = Some(readout);
                Section::Length
            }
            Section::Length if self.received == LENGTH_BYTES => {
                Section::Capture(self.word16(0) | self.word16(2) << 16)
            }
            Section::Capture(bytes) if self.received == bytes => {
                self.end_of_capture()?;
                Section::Length
            }
            _ => return Ok(()),
        };
        (self.section, self.received) = (next, 0);
        Ok(())
    }

    /// Puts a byte of a capture where it belongs; `None` where there is no memory for it.
    fn of_capture(&mut self, byte: u8) -> Option<()> {
        let Some(at) = self.received.checked_sub(HEAD_BYTES) else {
            self.head[self.received] = byte;
            return Some(());
        };
        let config_bytes = self.word16(0);
        let Some(at) = at.checked_sub(config_bytes) else {
            *self.bytes.get_mut(at)? = byte;
            return Some(());
        };
        self.word[at % 4] = byte;
        if at % 4 == 3 {
            *self.table.get_mut(self.words + at / 4)? = f32::from_le_bytes(self.word);
        }
        Some(())
    }

    /// The bytes of a capture have arrived: keeps it if it is valid.
    fn end_of_capture(&mut self) -> Result<(), Refusal> {
        // A camera that was cut short would be completed by bytes of an earlier one.
        let table_bytes = self.received.checked_sub(HEAD_BYTES + self.word16(0));
        let table_bytes =
            table_bytes.filter(|bytes| self.received >= HEAD_BYTES && bytes % 4 == 0);
        let end = self.words + table_bytes.ok_or(Refusal::BadCamera)? / 4;
        let bytes = self.bytes.get(..self.word16(0)).ok_or(Refusal::BadCamera)?;
        let (mut config, streams): (SensorConfig, _) =
            postcard::take_from_bytes(bytes).map_err(|_| Refusal::BadCamera)?;
        config.streams = match *streams {
            [] => Streams::default(),
            [photodiode, window, capture] => Streams { photodiode, window, capture },
            _ => return Err(Refusal::BadCamera),
        };
        let table_size = [self.word16(2), self.word16(4), self.word16(6)];
        let sizes = table_size.into_iter();
        let crosstalk = sizes.fold(factors(config.channels, table_size), usize::saturating_add);
        let own = self.words.saturating_add(crosstalk)..end;
        let empirical = self.table.get(own).ok_or(Refusal::BadCamera)?;
        config.table.extend_from_slice(empirical).map_err(|_| Refusal::BadCamera)?;
        config.check().map_err(|_| Refusal::BadCamera)?;
        let channels = usize::from(config.channels);
        let held = Held { config, table_at: self.words, table_size };
        let sound = match self.crosstalk(&held) {
            Some(table) => table.check(channels).is_ok(),
            None => table_size == [0; 3],
        };
        if !sound {
            return Err(Refusal::BadCamera);
        }
        let max = self.max_captures();
        let place = match self.captures.checked_sub(1) {
            None => Some(&mut self.first),
            Some(i) => self.others.get_mut(i).filter(|_| i + 1 < max),
        };
        place.ok_or(Refusal::Captures { max: max as u8 })?.0 = Some(held);
        (self.captures, self.words) = (self.captures + 1, end);
        Ok(())
    }

    /// All bytes have arrived: puts the camera in force if it is valid.
    pub(crate) fn end(&mut self) -> Result<(), Refusal> {
        let whole = match (self.section, &self.readout) {
            (Section::Only, _) => {
                self.end_of_capture()?;
                true
            }
            (Section::Length, Some(readout)) => {
                self.received == 0 && self.captures == readout.merge.captures()
            }
            _ => false,
        };
        self.ready = whole;
        let first = self.config();
        let same = |other: Capture<'_>| {
            first.is_some_and(|first| {
                (first.width, first.height, first.bands)
                    == (other.config.width, other.config.height, other.config.bands)
            })
        };
        self.ready = whole && self.captures().all(same);
        if self.ready { Ok(()) } else { Err(Refusal::BadCamera) }
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

/// Writes a camera of several captures into `out` and returns the number of bytes; `None` if it
/// does not fit.
pub fn encode_captures<'c>(
    readout: &Readout,
    captures: impl Iterator<Item = Capture<'c>>,
    out: &mut [u8],
) -> Option<usize> {
    let (head, rest) = out.split_at_mut_checked(SEVERAL_BYTES)?;
    let bytes = postcard::to_slice(readout, rest).ok()?.len();
    head.copy_from_slice(&u32::from(u16::try_from(bytes).ok()?).rotate_left(16).to_le_bytes());
    let mut end = SEVERAL_BYTES + bytes;
    for capture in captures {
        let (length, rest) = out.get_mut(end..)?.split_first_chunk_mut()?;
        let bytes = encode(capture.config, capture.crosstalk, rest)?;
        *length = u32::try_from(bytes).ok()?.to_le_bytes();
        end += LENGTH_BYTES + bytes;
    }
    Some(end)
}
