//! A frame in progress: units of spectral rows in, packed raw rows out.
//!
//! Bands are added one after the other, in their order, to the sums of the row that is arriving,
//! so a rig stores one band and not a spectral row. The mean photo-electrons of complete rows are
//! kept in a ring of as many rows as one raw row depends on. A camera of several captures has sums
//! and a ring for each.

use crate::camera::{CameraStore, Capture};
use crate::memory::{Memory, RowMemory, UNIT_BYTES};
use crate::raw_row::RawRow;
use camrig_rig_link::message::*;
use camrig_rig_link::registers::{Registers, address};
#[cfg(feature = "fixed")]
use camrig_sensor_core::arith::Fixed;
#[cfg(feature = "float")]
use camrig_sensor_core::arith::Float;
use camrig_sensor_core::arith::{Arith, BLOCK, Block, blocks};
use camrig_sensor_core::collect::{Collector, Exposed, Sums};
use camrig_sensor_core::config::{FrameSettings, SensorConfig};
use camrig_sensor_core::hdr::{MAX_CAPTURES, Readout};
use camrig_sensor_core::pipeline::{MeanRows, Pipeline, memory_blocks};
use camrig_sensor_core::spectral::{BandRow, GROUP, groups};

/// Largest number of rows of the ring: for two effects that read their neighbours.
pub(crate) const MAX_RING: usize = 5;

/// One row of a chain: as [`Pipeline::row`], compiled for other instructions than the rest.
pub type RowFn<A> = fn(&mut Pipeline<'_, A>, u32, &mut dyn MeanRows<A>, &mut [u16]);

/// Settings of a frame: enough to continue it after other messages.
#[derive(Clone, Debug)]
pub struct Frame {
    begin: FrameBegin,
    settings: FrameSettings,
    halo: usize,
    /// Lights of a spectral row: 1, or one for each capture.
    lights: usize,
    raw_row: RawRow,
    test_pattern: u16,
    test_data: u16,
}

impl Frame {
    pub(crate) fn new(
        begin: FrameBegin,
        settings: FrameSettings,
        shape: &FrameShape,
        (lights, raw_row): (usize, RawRow),
        registers: &Registers,
    ) -> Self {
        let read = |address| registers.read(address).unwrap_or(0) as u16;
        Self {
            begin,
            settings,
            halo: shape.halo.into(),
            lights,
            raw_row,
            test_pattern: read(address::TEST_PATTERN),
            test_data: read(address::TEST_DATA),
        }
    }
}

/// The ring of mean rows, as the pipeline reads it.
struct Ring<'a, S> {
    rows: &'a mut [Block<S>],
    /// Blocks of a row.
    len: usize,
    /// Whether the previous frame had the same light; its exposure is the pipeline's concern.
    lit_before: bool,
}

impl<S> Ring<'_, S> {
    #[inline(always)]
    fn slot(&mut self, row: u32) -> &mut [Block<S>] {
        let count = (self.rows.len() / self.len.max(1)).max(1);
        let at = row as usize % count * self.len;
        self.rows.get_mut(at..at + self.len).unwrap_or_default()
    }
}

impl<A: Arith> MeanRows<A> for Ring<'_, A::Signal> {
    fn mean_row(&mut self, row: u32, out: &mut [Block<A::Signal>]) {
        for (out, mean) in out.iter_mut().zip(self.slot(row)) {
            *out = *mean;
        }
    }

    fn previous_mean_row(&mut self, row: u32, out: &mut [Block<A::Signal>]) {
        if self.lit_before {
            <Self as MeanRows<A>>::mean_row(self, row, out);
        } else {
            out.fill([A::Signal::default(); BLOCK]);
        }
    }
}

/// One capture of a frame in progress.
struct Chain<'r, A: Arith> {
    config: &'r SensorConfig,
    exposed: Exposed<'r>,
    exposure_s: f32,
    pipeline: Pipeline<'r, A>,
    ring: Ring<'r, A::Signal>,
    sums: &'r mut [Sums<A::Sum>],
}

/// A frame in progress, in one arithmetic.
pub struct Running<'c, 'r, A: Arith> {
    frame: &'r Frame,
    readout: Option<&'r Readout>,
    collector: &'c mut Collector<'r, A>,
    chains: &'c mut [Chain<'r, A>],
    width: usize,
    /// Bands of a light.
    bands: usize,
    /// Of a row of all captures; a band takes the first of it.
    mantissas: &'r mut [u16],
    exponents: &'r mut [i8],
}

/// The first `count` of a memory, which it loses.
fn take<'r, T>(memory: &mut &'r mut [T], count: usize) -> Option<&'r mut [T]> {
    let (taken, rest) = core::mem::take(memory).split_at_mut_checked(count)?;
    *memory = rest;
    Some(taken)
}

impl<'r, A: Arith> Chain<'r, A> {
    /// The chain of a capture, which takes its memory from the beginning of these.
    fn new(
        capture: Capture<'r>,
        frame: &Frame,
        settings: &FrameSettings,
        rows: &mut &'r mut [Block<A::Signal>],
        sums: &mut &'r mut [Sums<A::Sum>],
    ) -> Option<Self> {
        let Capture { config, crosstalk } = capture;
        let width = config.width as usize;
        let len = blocks(width);
        let ring = take(rows, (2 * frame.halo + 1) * len)?;
        let memory = take(rows, memory_blocks(config))?;
        Some(Self {
            config,
            exposed: Exposed::new(config, settings, crosstalk).ok()?,
            exposure_s: settings.exposure_s,
            pipeline: Pipeline::new(config, settings, memory).ok()?,
            ring: Ring { rows: ring, len, lit_before: frame.begin.before != Before::Dark },
            sums: take(sums, groups(width))?,
        })
    }

    /// Adds a band of a row of the light that the capture sees.
    #[inline(always)]
    fn add_band(
        &mut self,
        collector: &mut Collector<'r, A>,
        codec: Codec,
        (row, band): (u32, usize),
        groups: impl Iterator<Item = (i8, impl core::borrow::Borrow<[u16; GROUP]>)>,
    ) {
        if codec == Codec::Bfp16 {
            collector.turn_to(&self.exposed);
            collector.add_groups(row, band, groups, self.sums);
        } else {
            collector.add_rates(groups, self.exposure_s, self.sums);
        }
    }

    /// Puts the row that has just become complete into the ring.
    #[inline(always)]
    fn keep(&mut self, row: u32) {
        let slot = self.ring.slot(row);
        for (mean, sum) in slot.as_flattened_mut().iter_mut().zip(self.sums.as_flattened()) {
            *mean = A::collected(*sum);
        }
    }
}

impl<'c, 'r, A: Arith> Running<'c, 'r, A> {
    /// Calls `work` with the frame. What is large of it lies here, so that nobody moves it.
    fn with<T>(
        camera: &'r CameraStore<'_>,
        frame: &'r Frame,
        memory: &'r mut RowMemory<'_, A>,
        (mantissas, exponents): (&'r mut [u16], &'r mut [i8]),
        work: impl FnOnce(Running<'_, 'r, A>) -> T,
    ) -> Option<T> {
        let (mut rows, mut sums) = (&mut *memory.rows, &mut *memory.sums);
        let readout = camera.readout();
        let mut chains: heapless::Vec<Chain<'r, A>, MAX_CAPTURES> = heapless::Vec::new();
        for (i, capture) in camera.captures().enumerate() {
            let ratios = readout.and_then(|readout| readout.ratios.get(i));
            let settings = ratios.map_or(frame.settings, |own| own.settings(&frame.settings));
            let chain = Chain::new(capture, frame, &settings, &mut rows, &mut sums)?;
            chains.push(chain).ok()?;
        }
        let first = chains.first()?;
        let width = first.config.width as usize;
        let mut collector = Collector::of(first.exposed.clone());
        Some(work(Running {
            frame,
            readout,
            collector: &mut collector,
            width,
            bands: usize::from(frame.begin.bands) / frame.lights,
            mantissas: mantissas.get_mut(..width * chains.len())?,
            exponents: exponents.get_mut(..groups(width))?,
            chains: &mut chains,
        }))
    }

    #[inline(always)]
    fn units(&mut self, row: u16, first: u16, units: &[u8]) {
        let groups = self.exponents.len();
        let bands = usize::from(self.frame.begin.bands);
        if first == 0 {
            self.clear();
        }
        let (mut at, mut units) = (usize::from(first), units.as_chunks::<UNIT_BYTES>().0);
        while !units.is_empty() {
            // Units up to the end of the band.
            let (band, group) = (at / groups, at % groups);
            let (now, later) = units.split_at(units.len().min(groups - group));
            let exponents = self.exponents.iter_mut().skip(group);
            let mantissas = self.mantissas[..self.width].chunks_mut(GROUP).skip(group);
            for ((unit, exponent), mantissas) in now.iter().zip(exponents).zip(mantissas) {
                take_unit(unit, exponent, mantissas);
            }
            if group + now.len() == groups {
                let mantissas = &self.mantissas[..self.width];
                let whole = BandRow { exponents: self.exponents, mantissas };
                let codec = self.frame.begin.codec;
                for chain in seen(self.chains, self.frame.lights, band / self.bands) {
                    let place = (row.into(), band % self.bands);
                    let mut padded = [0; GROUP];
                    chain.add_band(self.collector, codec, place, whole.groups(&mut padded));
                }
                if band + 1 == bands {
                    self.keep(row.into());
                }
            }
            (at, units) = (at + now.len(), later);
        }
    }

    /// Takes a whole spectral row at once, and stores no band of it.
    #[inline(always)]
    fn whole_row(&mut self, row: u16, units: &[u8]) {
        self.clear();
        let (units, _) = units.as_chunks::<UNIT_BYTES>();
        let codec = self.frame.begin.codec;
        for (band, units) in units.chunks_exact(self.exponents.len()).enumerate() {
            for chain in seen(self.chains, self.frame.lights, band / self.bands) {
                let place = (row.into(), band % self.bands);
                chain.add_band(self.collector, codec, place, units.iter().map(group_of));
            }
        }
        self.keep(row.into());
    }

    /// A row begins.
    #[inline(always)]
    fn clear(&mut self) {
        for chain in &mut *self.chains {
            chain.sums.fill([A::Sum::default(); GROUP]);
        }
    }

    /// A row is complete.
    #[inline(always)]
    fn keep(&mut self, row: u32) {
        for chain in &mut *self.chains {
            chain.keep(row);
        }
    }

    #[inline(always)]
    fn raw_row(
        &mut self,
        row: u16,
        out: &mut [u8],
        mut compute: impl FnMut(&mut Pipeline<'r, A>, u32, &mut Ring<'r, A::Signal>, &mut [u16]),
    ) {
        // Between rows no band is partly received, so its memory is free.
        let codes = &mut *self.mantissas;
        for (chain, dn) in self.chains.iter_mut().zip(codes.chunks_exact_mut(self.width)) {
            let Chain { config, pipeline, ring, .. } = chain;
            if self.frame.test_pattern == 0 {
                compute(pipeline, row.into(), ring, dn);
            } else {
                let max = config.max_dn();
                test_pattern(self.frame.test_pattern, self.frame.test_data.min(max), max, row, dn);
            }
        }
        if let Some(readout) = self.readout {
            readout.send(self.width, codes);
        }
        // The sizes were agreed at the beginning of the frame.
        let packed = self.frame.raw_row.pack(self.width, codes, out);
        debug_assert!(packed.is_ok());
    }
}

/// The captures that see a light: all see a single one.
#[inline(always)]
fn seen<'c, 'r, A: Arith>(
    chains: &'c mut [Chain<'r, A>],
    lights: usize,
    light: usize,
) -> &'c mut [Chain<'r, A>] {
    let own = if lights == 1 { 0..chains.len() } else { light..light + 1 };
    chains.get_mut(own).unwrap_or_default()
}

/// A unit's exponent and mantissas.
#[inline(always)]
fn group_of(unit: &[u8; UNIT_BYTES]) -> (i8, [u16; GROUP]) {
    let [exponent, bytes @ ..] = unit;
    let (words, _) = bytes.as_chunks::<2>();
    (*exponent as i8, core::array::from_fn(|i| u16::from_le_bytes(words[i])))
}

/// Decodes a unit; the last one of a row may have fewer pixels.
#[inline(always)]
fn take_unit(unit: &[u8; UNIT_BYTES], exponent: &mut i8, mantissas: &mut [u16]) {
    let [first, bytes @ ..] = unit;
    *exponent = *first as i8;
    let words = bytes.as_chunks::<2>().0.iter().map(|word| u16::from_le_bytes(*word));
    match mantissas.first_chunk_mut::<GROUP>() {
        Some(whole) => whole.iter_mut().zip(words).for_each(|(m, word)| *m = word),
        None => mantissas.iter_mut().zip(words).for_each(|(m, word)| *m = word),
    }
}

/// Test patterns of MIPI CCS: 1 solid, 2 colour bars (eight, from white to black), 4 PN9 (the
/// pseudo-random sequence of x⁹ + x⁵ + 1, which starts with all ones in each row).
fn test_pattern(pattern: u16, solid: u16, max: u16, row: u16, dn: &mut [u16]) {
    // White, yellow, cyan, green, magenta, red, blue, black as R, G, B bits.
    const BARS: [u8; 8] = [0b111, 0b110, 0b011, 0b010, 0b101, 0b100, 0b001, 0b000];
    let width = dn.len();
    let mut shift = 0x1ffu16;
    for (x, dn) in dn.iter_mut().enumerate() {
        *dn = match pattern {
            1 => solid,
            2 => {
                let bar = BARS[(x * 8 / width).min(7)];
                // As on an RGGB sensor.
                let bit = match (row % 2, x % 2) {
                    (0, 0) => 2,
                    (1, 1) => 0,
                    _ => 1,
                };
                if bar >> bit & 1 == 1 { max } else { 0 }
            }
            _ => {
                let mut word = 0u16;
                for _ in 0..16 {
                    let next = (shift ^ shift >> 4) & 1;
                    word = word << 1 | shift & 1;
                    shift = shift >> 1 | next << 8;
                }
                word & max
            }
        };
    }
}

/// A frame in progress, in the arithmetic that it asked for.
#[non_exhaustive]
pub enum AnyRunning<'c, 'r> {
    /// In f32.
    #[cfg(feature = "float")]
    Float(Running<'c, 'r, Float>),
    /// In fixed point.
    #[cfg(feature = "fixed")]
    Fixed(Running<'c, 'r, Fixed>),
}

/// [`AnyRunning::units`] as a separate function, so that a firmware contains it once.
#[inline(never)]
pub(crate) fn units(running: &mut AnyRunning<'_, '_>, row: u16, first: u16, bytes: &[u8]) {
    running.units(row, first, bytes);
}

/// [`AnyRunning::raw_row`] as a separate function, so that a firmware contains it once.
#[inline(never)]
pub(crate) fn raw_row(running: &mut AnyRunning<'_, '_>, row: u16, out: &mut [u8]) {
    running.raw_row(row, out);
}

impl<'r> AnyRunning<'_, 'r> {
    /// Calls `work` with the frame; `None` where the memory does not do for it.
    pub(crate) fn with<T>(
        camera: &'r CameraStore<'_>,
        frame: &'r Frame,
        memory: &'r mut Memory<'_>,
        work: impl FnOnce(AnyRunning<'_, 'r>) -> T,
    ) -> Option<T> {
        let bands = (&mut *memory.mantissas, &mut *memory.exponents);
        match frame.begin.arithmetic {
            #[cfg(feature = "float")]
            NumberFormat::F32 => {
                let rows = memory.float.as_mut()?;
                Running::with(camera, frame, rows, bands, |own| work(AnyRunning::Float(own)))
            }
            #[cfg(feature = "fixed")]
            NumberFormat::Fixed => {
                let rows = memory.fixed.as_mut()?;
                Running::with(camera, frame, rows, bands, |own| work(AnyRunning::Fixed(own)))
            }
            _ => None,
        }
    }

    /// Takes units of a spectral row, see [`camrig_rig_link::device::Model::units`].
    #[inline(always)]
    pub fn units(&mut self, row: u16, first: u16, units: &[u8]) {
        match self {
            #[cfg(feature = "float")]
            Self::Float(running) => running.units(row, first, units),
            #[cfg(feature = "fixed")]
            Self::Fixed(running) => running.units(row, first, units),
        }
    }

    /// Takes a whole spectral row at once: faster than by [`Self::units`], to the same sums.
    #[inline(always)]
    pub fn whole_row(&mut self, row: u16, units: &[u8]) {
        match self {
            #[cfg(feature = "float")]
            Self::Float(running) => running.whole_row(row, units),
            #[cfg(feature = "fixed")]
            Self::Fixed(running) => running.whole_row(row, units),
        }
    }

    /// Computes a raw row, see [`camrig_rig_link::device::Model::raw_row`].
    #[inline(always)]
    pub fn raw_row(&mut self, row: u16, out: &mut [u8]) {
        match self {
            #[cfg(feature = "float")]
            Self::Float(running) => running.raw_row(row, out, |p, r, ring, dn| p.row(r, ring, dn)),
            #[cfg(feature = "fixed")]
            Self::Fixed(running) => running.raw_row(row, out, |p, r, ring, dn| p.row(r, ring, dn)),
        }
    }

    /// [`Self::raw_row`] with row functions that the caller has compiled.
    #[cfg(all(feature = "float", feature = "fixed"))]
    #[inline(always)]
    pub fn raw_row_by(
        &mut self,
        row: u16,
        out: &mut [u8],
        (float, fixed): (RowFn<Float>, RowFn<Fixed>),
    ) {
        match self {
            Self::Float(running) => {
                running.raw_row(row, out, |p, r, ring, dn| float(p, r, ring, dn))
            }
            Self::Fixed(running) => {
                running.raw_row(row, out, |p, r, ring, dn| fixed(p, r, ring, dn))
            }
        }
    }
}
