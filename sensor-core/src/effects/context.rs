//! What a stage knows about the row it works on, and its random streams.

use crate::arith::{BLOCK, Counts};
use crate::math;
use crate::stream::{Key, Lanes};
use rand_core::Rng;

/// The facts of one row of one frame, as a stage sees them.
#[derive(Clone, Copy, Debug)]
pub struct Context {
    /// Pixels in a row.
    pub width: u32,
    /// Rows in a frame.
    pub height: u32,
    /// This row, 0 at the top.
    pub row: u32,
    /// Frame number.
    pub frame: u32,
    /// Integration time, s.
    pub exposure_s: f32,
    /// Sensor temperature, °C.
    pub temperature_c: f32,
    /// Analog gain.
    pub analog_gain: f32,
    /// DN per input-referred electron at this gain.
    pub dn_per_e: f32,
    /// Full well, e⁻.
    pub full_well_e: f32,
    /// Root of this stage's streams on this physical sensor.
    pub(crate) key: Key,
}

/// What a stream depends on beside sensor and stage.
#[derive(Clone, Copy)]
enum Over {
    Pixel = 1,
    PixelFrame,
    Column,
    Row,
    RowFrame,
    Frame,
    Sensor,
    ColumnFrame,
    Count,
    CountNormal,
}

impl Context {
    fn stream(&self, part: u32, over: Over) -> Key {
        self.key.with(part).with(over as u32)
    }

    /// Fixed pattern: values per pixel of this physical sensor. `part` tells a stage's draws apart.
    #[inline(always)]
    pub fn per_pixel(&self, part: u32) -> Lanes {
        self.stream(part, Over::Pixel).with(self.row).lanes()
    }

    /// Temporal noise: values per pixel and frame.
    #[inline(always)]
    pub fn per_pixel_and_frame(&self, part: u32) -> Lanes {
        self.stream(part, Over::PixelFrame).with(self.frame).with(self.row).lanes()
    }

    /// Poisson counts per pixel and frame; see [`Counts::new`].
    #[inline(always)]
    pub fn counts(&self, part: u32, low: bool, high: bool) -> Counts {
        let stream = |over| self.stream(part, over).with(self.frame).with(self.row).lanes();
        Counts::new(stream(Over::Count), stream(Over::CountNormal), low, high)
    }

    /// Values per column, the same in each row and frame.
    #[inline(always)]
    pub fn per_column(&self, part: u32) -> Lanes {
        self.stream(part, Over::Column).lanes()
    }

    /// Values per column and frame, the same in each row.
    #[inline(always)]
    pub fn per_column_and_frame(&self, part: u32) -> Lanes {
        self.stream(part, Over::ColumnFrame).with(self.frame).lanes()
    }

    /// Stream of a row (any row: correlated noise asks for its neighbours'), the same in each frame.
    pub fn per_row(&self, part: u32, row: u32) -> impl Rng + use<> {
        self.stream(part, Over::Row).with(row).scalar()
    }

    /// Stream of a row and frame.
    pub fn per_row_and_frame(&self, part: u32, row: u32) -> impl Rng + use<> {
        self.stream(part, Over::RowFrame).with(self.frame).with(row).scalar()
    }

    /// Stream of a frame (any frame), for the whole sensor.
    pub fn per_frame(&self, part: u32, frame: u32) -> impl Rng + use<> {
        self.stream(part, Over::Frame).with(frame).scalar()
    }

    /// Stream of the sensor.
    pub fn per_sensor(&self, part: u32) -> impl Rng + use<> {
        self.stream(part, Over::Sensor).scalar()
    }

    /// Position of pixel `i` of block `block` in -1..1 over the sensor's half width.
    #[inline(always)]
    pub fn x(&self, block: usize, i: usize) -> f32 {
        ((block * BLOCK + i) as f32 + 0.5) / self.width as f32 * 2.0 - 1.0
    }

    /// Position of the row in -1..1 over the sensor's half height, down.
    #[inline(always)]
    pub fn y(&self) -> f32 {
        (self.row as f32 + 0.5) / self.height as f32 * 2.0 - 1.0
    }
}

/// One standard normal number from a scalar stream.
pub(crate) fn normal(rng: &mut impl Rng) -> f32 {
    math::box_muller(rng.next_u32(), rng.next_u32()).0
}
