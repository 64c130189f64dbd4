//! What a device shows: a sensor, and frames that are taken as it asks for them.

use crate::pixel::Pattern;
use std::time::Duration;

/// Gain code of unity gain: `gain = code / 256`, as in CCS with gain type 0.
pub const UNITY_GAIN_CODE: u16 = 256;

/// A sensor, its values at power-on included.
#[derive(Clone, Debug)]
pub struct Sensor {
    /// Name of the model, at most 31 bytes.
    pub model: String,
    /// Serial number, at most 15 bytes.
    pub serial: String,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Colour filters.
    pub pattern: Pattern,
    /// Bits of a sample.
    pub bits: u32,
    /// Line time, ns: exposure and frame length are whole lines.
    pub line_ns: u32,
    /// Shortest frame, lines.
    pub min_frame_lines: u16,
    /// Timing at power-on.
    pub timing: Timing,
}

/// Timing and gain as a sensor's registers hold them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timing {
    /// Exposure, lines, at least 1.
    pub exposure_lines: u16,
    /// Frame length, lines; a longer exposure makes a longer frame.
    pub frame_lines: u16,
    /// [`UNITY_GAIN_CODE`] times the gain, at least 1.
    pub gain_code: u16,
}

impl Timing {
    /// The timing whose frames are as long as their exposure.
    #[must_use]
    pub fn in_force(self) -> Self {
        Self { frame_lines: self.frame_lines.max(self.exposure_lines), ..self }
    }
}

/// Part of the sensor that is sent, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// The fault that lasts until another one, or none, is asked for: the stuck counter.
pub const STUCK_COUNTER: u16 = 3;

/// A frame that the device asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Order {
    /// Number of the frame since the device was switched on, from 0.
    pub frame: u32,
    /// The sensor stood by before this frame, so that its settings act at once: it is the first of
    /// an acquisition, or was triggered. Else they act with the sensor's delay.
    pub after_standby: bool,
    /// Whether an application has written timing or test pattern since the order before.
    pub is_written: bool,
    /// Timing as last written.
    pub timing: Timing,
    /// Test pattern: 0 none, 1 solid, 2 colour bars, 4 PN9 (MIPI CCS).
    pub test_pattern: u16,
    /// DN of the solid pattern.
    pub test_value: u16,
    /// Fault of this frame: 0 none, 1 drop it, 2 corrupt a row, 3 stuck counter, 4 late.
    pub fault: u16,
    /// The corrupt row, or the delay in ms.
    pub fault_argument: u16,
    /// What is sent.
    pub region: Region,
    /// PFNC name of the pixel format.
    pub pixel_format: String,
    /// Bytes of the image: pixels of the region, row after row, without gaps.
    pub image_bytes: usize,
}

/// What became of an order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Taken {
    /// An image, and the sensor's frame counter.
    Image(Vec<u8>, u16),
    /// The frame was lost in the sensor, as asked for: a gap in the numbers of blocks.
    Dropped(u16),
    /// There are no more frames: the acquisition ends.
    End,
}

/// How frames follow one another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// By the frame length that the device orders.
    AsOrdered,
    /// By registers of the source: the next frame lasts so long.
    Every(Duration),
    /// The source stands by: there are no frames.
    Standby,
}

/// A source of frames.
pub trait Camera {
    /// Why no frame can be taken.
    type Error;

    /// How frames follow one another. USB cameras ask before each frame; GigE Vision has frame
    /// rate and triggers among its features.
    fn pace(&mut self) -> Pace {
        Pace::AsOrdered
    }

    /// Takes a frame. Called with numbers that count up; may take as long as the frame lasts.
    ///
    /// # Errors
    /// A fault after which there are no frames: the device ends with it.
    fn take(&mut self, order: &Order) -> Result<Taken, Self::Error>;
}
