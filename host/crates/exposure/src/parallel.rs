//! Several rigs that compute the rows of a frame side by side, and to their host are one.
//!
//! Spectral rows are kept as they come until the link has nothing more to give, or [`Parallel`]
//! holds as many as it may; then each rig takes a run of raw rows and the spectral rows around it.
//! Raw rows depend on nothing else, so they are the same whoever computes them.

use crate::rows::Vector;
use camrig_firmware_sim::Rig;
use camrig_firmware_sim::running::AnyRunning;
use camrig_rig_link::device::{Begun, Model};
use camrig_rig_link::message::{Capabilities, Exposure, FrameBegin, FrameShape, Refusal};
use camrig_rig_link::registers::Registers;
use camrig_sensor_core::arith::{Fixed, Float};
use camrig_vector::vectorised;
use rayon::prelude::*;
use std::ops::Range;

/// Memory for spectral rows that wait, bytes, and most of them. A trade: rows enough for all cores,
/// and little enough to stay in their caches.
const AHEAD_BYTES: usize = 2 << 20;
const MAX_AHEAD: usize = 96;
/// Fewest rows for which a further rig is set to work.
const MIN_ROWS: usize = 4;

/// See the module.
pub struct Parallel<'m> {
    rigs: Vec<Rig<'m>>,
    shape: Option<FrameShape>,
    /// Spectral rows as on the link, row `r` in place `r % slots`.
    spectral: Vec<u8>,
    row_bytes: usize,
    slots: usize,
    ahead: u16,
    /// First row beyond those that have arrived.
    arrived: u16,
    /// Raw rows that are computed, and their bytes.
    computed: Range<u16>,
    raw: Vec<u8>,
}

impl<'m> Parallel<'m> {
    /// Joins rigs of like memory, at least one.
    pub fn new(rigs: Vec<Rig<'m>>) -> Self {
        Self {
            rigs,
            shape: None,
            spectral: Vec::new(),
            row_bytes: 0,
            slots: 1,
            ahead: 0,
            arrived: 0,
            computed: 0..0,
            raw: Vec::new(),
        }
    }

    /// Computes the raw rows from `first` on whose spectral rows are there.
    fn compute(&mut self, first: u16, shape: &FrameShape) {
        let last = if self.arrived == shape.rows {
            shape.rows
        } else {
            self.arrived.saturating_sub(shape.halo.into())
        };
        let count = usize::from(last.saturating_sub(first));
        let workers = self.rigs.len().min(count.div_ceil(MIN_ROWS)).max(1);
        let share = count.div_ceil(workers).max(1);
        let raw_bytes = usize::from(shape.raw_bytes);
        self.raw.resize(count * raw_bytes, 0);
        let (spectral, row_bytes, slots) = (&self.spectral, self.row_bytes, self.slots);
        let spectral_row = |row: u16| {
            let at = usize::from(row) % slots * row_bytes;
            &spectral[at..at + row_bytes]
        };
        let shares = self.raw.par_chunks_mut(share * raw_bytes).zip(&mut self.rigs).enumerate();
        shares.for_each(|(i, (out, rig))| {
            let from = first + (i * share) as u16; // below `last`, a u16
            let _ = rig.with_running(|running, _| rows(running, from, shape, spectral_row, out));
        });
        self.computed = first..first + count as u16;
    }
}

/// Computes the raw rows from `first` on that fill `out`.
fn rows<'a>(
    running: &mut AnyRunning<'_, '_>,
    first: u16,
    shape: &FrameShape,
    spectral_row: impl Fn(u16) -> &'a [u8],
    out: &mut [u8],
) {
    let halo = u16::from(shape.halo);
    let mut fed = first.saturating_sub(halo);
    for (row, out) in (first..).zip(out.chunks_mut(shape.raw_bytes.into())) {
        while fed < shape.rows.min(row.saturating_add(halo + 1)) {
            whole_row(running, fed, spectral_row(fed));
            fed += 1;
        }
        raw_row(running, row, out);
    }
}

// Sums of bands and packing, compiled for the vector instructions of this machine; the chain
// itself is that of `rows`.

#[vectorised]
fn whole_row(running: &mut AnyRunning<'_, '_>, row: u16, units: &[u8]) {
    running.whole_row(row, units);
}

#[vectorised]
fn raw_row(running: &mut AnyRunning<'_, '_>, row: u16, out: &mut [u8]) {
    running.raw_row_by(row, out, (Float::ROW, Fixed::ROW));
}

impl Model for Parallel<'_> {
    fn rows_ahead(&self) -> u16 {
        self.ahead
    }

    fn capabilities(&self) -> Capabilities {
        self.rigs.first().map(Model::capabilities).unwrap_or_default()
    }

    fn camera_piece(&mut self, offset: u32, piece: &[u8]) -> Result<(), Refusal> {
        self.shape = None;
        self.rigs.iter_mut().try_for_each(|rig| rig.camera_piece(offset, piece))
    }

    fn camera_end(&mut self) -> Result<(), Refusal> {
        self.rigs.iter_mut().try_for_each(Model::camera_end)
    }

    fn begin(
        &mut self,
        frame: &FrameBegin,
        exposure: Exposure,
        registers: &Registers,
    ) -> Result<Begun, Refusal> {
        self.shape = None;
        let mut begun = Err(Refusal::NoCamera);
        for rig in &mut self.rigs {
            begun = Ok(rig.begin(frame, exposure, registers)?);
        }
        let shape = begun?.shape;
        self.row_bytes = usize::from(shape.units) * usize::from(shape.unit_bytes);
        let ahead = (AHEAD_BYTES / self.row_bytes.max(1)).min(MAX_AHEAD);
        self.ahead = ahead as u16; // at most MAX_AHEAD
        self.slots = 2 * usize::from(shape.halo) + 2 + ahead;
        self.spectral.resize(self.slots * self.row_bytes, 0);
        (self.arrived, self.computed) = (0, 0..0);
        self.shape = Some(shape);
        begun
    }

    fn units(&mut self, row: u16, first: u16, units: &[u8]) {
        let Some(shape) = self.shape else { return };
        let offset = usize::from(first) * usize::from(shape.unit_bytes);
        let at = usize::from(row) % self.slots * self.row_bytes + offset;
        let end = offset + units.len();
        if end <= self.row_bytes {
            self.spectral[at..at + units.len()].copy_from_slice(units);
        }
        self.arrived = if end == self.row_bytes { row + 1 } else { row };
    }

    fn raw_row(&mut self, row: u16, out: &mut [u8]) {
        let Some(shape) = self.shape else { return };
        if !self.computed.contains(&row) {
            self.compute(row, &shape);
        }
        let at = usize::from(row.saturating_sub(self.computed.start)) * out.len();
        if let Some(bytes) = self.raw.get(at..at + out.len()) {
            out.copy_from_slice(bytes);
        }
    }
}
