//! From the captures of a pixel to its code: merge and companding, in integers.
//!
//! A sensor for high dynamic range reads each pixel several times: charge of one exposure at two
//! gains, several exposures, two photodiodes. Each such **capture** is a sensor of its own here, a
//! [`SensorConfig`](crate::config::SensorConfig) with a [`Pipeline`](crate::pipeline::Pipeline)
//! that ends at a converter. Two captures of one exposure (**window**) have the same charge, drawn
//! once: their [`Streams`](crate::config::Streams) name the same photodiode and window, so that
//! both pipelines compute the same electrons up to the first effect on the voltage.
//!
//! What follows is exact: [`Merge`] makes one linear number of the captures' codes, [`Curve`] a
//! shorter code of that number. Both are integers on every machine, since a linear number of 24
//! bits times a weight has more digits than `f32` or fixed point keep. [`Readout`] says what of a
//! row is sent.
//!
//! **Memory.** A row of a capture is a row of a plain sensor. Codes take 2 bytes for each pixel and
//! capture until the row is sent, and what is sent takes their place.
//!
//! ```
//! use camrig_sensor_core::hdr::{Curve, Hand, Level, Merge, Rounding};
//!
//! // Two gains of one charge, 16:1, each of 12 bits above a black level of 50 DN.
//! let merge = Merge::new(
//!     &[Level { black_dn: 50, gain: 256 }, Level { black_dn: 50, gain: 16 * 256 }],
//!     &[Hand { decide: 0, low_dn: 3000, high_dn: 3600 }],
//!     16,
//!     3200,
//! )?;
//! assert_eq!(merge.linear(&[150, 56]), 3200 + 100);
//! assert_eq!(merge.linear(&[4095, 1050]), 3200 + 16_000);
//!
//! // 16 bits to 12, as the IMX585 does it.
//! let knees = [(500, 500.0), (11_500, 671.875), (65_536, 4049.125)];
//! let curve = Curve::new(&knees, Rounding::Floor)?;
//! assert_eq!(curve.code(16_000), 671 + 282);
//! # Ok::<(), camrig_sensor_core::hdr::HdrError>(())
//! ```

mod curve;
mod merge;
mod readout;

pub use curve::{Companding, Curve, Line, MAX_KNEES, Rounding};
pub use merge::{Flicker, Hand, Level, MAX_CAPTURES, Merge};
pub use readout::{Output, Ratios, Readout};

use core::fmt;

/// Why a merge or a curve was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum HdrError {
    /// Captures are fewer than 2 or more than [`MAX_CAPTURES`], or there is not one hand-over
    /// fewer than captures.
    Captures,
    /// A hand-over of this position is decided by a capture that is not merged yet, or ends where
    /// it begins or below.
    HandOver(usize),
    /// The linear signal has neither 16 nor 20 nor 24 bits, or its pedestal or what is taken off it
    /// lies beyond them.
    Linear,
    /// Knees are none or more than [`MAX_KNEES`].
    Knees,
    /// The knee of this position does not rise, or rises faster than 1:1, or lies beyond 24 bits, or
    /// its code is no multiple of 1/256.
    Knee(usize),
    /// Codes have neither 10 nor 12, 14 or 16 bits.
    Bits,
}

impl fmt::Display for HdrError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Captures => write!(
                f,
                "a merge has 2 to {MAX_CAPTURES} captures and one hand-over fewer than captures"
            ),
            Self::HandOver(i) => {
                write!(f, "hand-over {i}: an earlier capture decides, and high_dn is above low_dn")
            }
            Self::Linear => f.write_str(
                "the linear signal has 16, 20 or 24 bits, and its pedestal and what is taken off it \
                 lie within them",
            ),
            Self::Knees => write!(f, "a curve has 1 to {MAX_KNEES} knees after (0, 0)"),
            Self::Knee(i) => write!(
                f,
                "knee {i}: both its numbers are above those of the knee before, the code by no \
                 more than the linear number, which ends at 2^24, and the code is a multiple of \
                 1/256"
            ),
            Self::Bits => f.write_str("codes have 10, 12, 14 or 16 bits"),
        }
    }
}

impl core::error::Error for HdrError {}
