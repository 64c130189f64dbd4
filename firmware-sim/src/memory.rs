//! Memory of a rig, which the firmware lays out: its sizes are the rig's limits.

pub use crate::camera::CaptureMemory;
#[cfg(feature = "fixed")]
use camrig_sensor_core::arith::Fixed;
#[cfg(feature = "float")]
use camrig_sensor_core::arith::Float;
use camrig_sensor_core::arith::{Arith, Block};
use camrig_sensor_core::collect::Sums;
use camrig_sensor_core::spectral::GROUP;

/// Bytes of a unit of a spectral row: the exponent and the mantissas of a group.
pub const UNIT_BYTES: usize = 1 + 2 * GROUP;

/// Memory for rows in one arithmetic.
pub struct RowMemory<'m, A: Arith> {
    /// Mean photo-electrons of the rows around the one to compute, then the pipeline's memory. A
    /// camera with `n` effects that read neighbouring rows needs `(2 n + 1) + (1 + 3 n)` rows of
    /// [`blocks`](camrig_sensor_core::arith::blocks) each; with one that remembers the previous
    /// frame `1 + 3 m` more, `m` of the `n` standing before it.
    pub rows: &'m mut [Block<A::Signal>],
    /// Sums of the row that is arriving, [`groups`](camrig_sensor_core::spectral::groups) of the
    /// width.
    pub sums: &'m mut [Sums<A::Sum>],
}

/// Memory of a rig; its sizes are the rig's limits. It computes in the arithmetics that it has rows
/// for. A camera of several captures has that of rows in equal parts, and takes so many times as
/// much of it.
#[non_exhaustive]
pub struct Memory<'m> {
    /// Rows for [`camrig_rig_link::message::NumberFormat::F32`].
    #[cfg(feature = "float")]
    pub float: Option<RowMemory<'m, Float>>,
    /// Rows for [`camrig_rig_link::message::NumberFormat::Fixed`].
    #[cfg(feature = "fixed")]
    pub fixed: Option<RowMemory<'m, Fixed>>,
    /// Mantissas of the band that is arriving, and the DN of the row that is being sent. One per
    /// pixel and capture.
    pub mantissas: &'m mut [u16],
    /// Exponents of the band that is arriving, [`groups`](camrig_sensor_core::spectral::groups) of
    /// the width.
    pub exponents: &'m mut [i8],
    /// The crosstalk table: nodes of its three axes and all factors.
    pub crosstalk: &'m mut [f32],
    /// For the captures of a camera after its first.
    pub captures: &'m mut [CaptureMemory],
    /// Largest number of bands of a row.
    pub max_bands: u16,
}

impl<'m> Memory<'m> {
    /// Memory for bands, the crosstalk table and `max_bands` bands; rows are added for each
    /// arithmetic ([`Memory::with_float`], [`Memory::with_fixed`]), and captures after the first
    /// ([`Memory::with_captures`]).
    pub const fn new(
        mantissas: &'m mut [u16],
        exponents: &'m mut [i8],
        crosstalk: &'m mut [f32],
        max_bands: u16,
    ) -> Self {
        Self {
            #[cfg(feature = "float")]
            float: None,
            #[cfg(feature = "fixed")]
            fixed: None,
            mantissas,
            exponents,
            crosstalk,
            captures: &mut [],
            max_bands,
        }
    }

    /// The same for cameras of several captures: one more than there is memory for here.
    #[must_use]
    pub fn with_captures(self, captures: &'m mut [CaptureMemory]) -> Self {
        Self { captures, ..self }
    }

    /// The same with rows for f32.
    #[cfg(feature = "float")]
    #[must_use]
    pub fn with_float(self, rows: RowMemory<'m, Float>) -> Self {
        Self { float: Some(rows), ..self }
    }

    /// The same with rows for fixed point.
    #[cfg(feature = "fixed")]
    #[must_use]
    pub fn with_fixed(self, rows: RowMemory<'m, Fixed>) -> Self {
        Self { fixed: Some(rows), ..self }
    }
}
