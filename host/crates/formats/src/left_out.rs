//! What stands for the formats whose feature is switched off: errors that say so.

use camrig_base::{Error, Result};

fn left_out<T>(format: &str, feature: &str) -> Result<T> {
    Err(Error::unsupported(format!("{format}: this build leaves it out"))
        .help(format!("build camrig-formats with its feature \"{feature}\"")))
}

/// Without `mcap`.
#[cfg(not(feature = "mcap"))]
pub mod mcap {
    use super::left_out;
    pub use crate::ros::CameraInfo;
    use crate::{Frames, RawFrame, Result};

    /// A recording, of which there is none.
    pub enum Recording {}

    impl Recording {
        /// Refused.
        ///
        /// # Errors
        /// Always.
        pub fn new(_: &RawFrame, _: Option<CameraInfo>) -> Result<Self> {
            left_out("MCAP", "mcap")
        }

        /// Nothing.
        ///
        /// # Errors
        /// None.
        pub fn frame(&mut self, _: &RawFrame, _: u64) -> Result<Vec<u8>> {
            match *self {}
        }

        /// Nothing.
        ///
        /// # Errors
        /// None.
        pub fn finish(self) -> Result<Vec<u8>> {
            match self {}
        }
    }

    /// Refused.
    ///
    /// # Errors
    /// Always.
    pub fn encode(_: &Frames) -> Result<Vec<u8>> {
        left_out("MCAP", "mcap")
    }

    /// Refused.
    ///
    /// # Errors
    /// Always.
    pub fn decode(_: &[u8]) -> Result<Frames> {
        left_out("MCAP", "mcap")
    }
}

/// Without `png`.
#[cfg(not(feature = "png"))]
pub mod png {
    use super::left_out;
    use crate::{Frames, Plane, Result};

    /// Refused.
    ///
    /// # Errors
    /// Always.
    pub fn encode(_: &Frames) -> Result<Vec<u8>> {
        left_out("PNG", "png")
    }

    /// Refused.
    ///
    /// # Errors
    /// Always.
    pub fn encode_rgb(_: &Plane<[u8; 3]>) -> Result<Vec<u8>> {
        left_out("PNG", "png")
    }

    /// Refused.
    ///
    /// # Errors
    /// Always.
    pub fn decode(_: &[u8]) -> Result<Frames> {
        left_out("PNG", "png")
    }
}

/// Without `tiff`.
#[cfg(not(feature = "tiff"))]
pub mod tiff16 {
    use super::left_out;
    use crate::{Frames, Result};

    /// Refused.
    ///
    /// # Errors
    /// Always.
    pub fn encode(_: &Frames) -> Result<Vec<u8>> {
        left_out("TIFF", "tiff")
    }

    /// Refused.
    ///
    /// # Errors
    /// Always.
    pub fn decode(_: &[u8]) -> Result<Frames> {
        left_out("TIFF", "tiff")
    }
}

/// Without `tiff`: what writes a DNG.
#[cfg(not(feature = "tiff"))]
pub mod dng {
    use super::left_out;
    use crate::{DngInfo, RawFrame, Result};

    /// Refused.
    ///
    /// # Errors
    /// Always.
    pub fn encode(_: &RawFrame, _: &DngInfo) -> Result<Vec<u8>> {
        left_out("writing DNG", "tiff")
    }
}

/// Without `gzip`.
#[cfg(not(feature = "gzip"))]
pub(crate) mod gzip {
    use super::left_out;
    use crate::Result;

    pub(crate) const LARGEST: usize = 0;

    pub(crate) fn is_gzip(bytes: &[u8]) -> bool {
        bytes.starts_with(&[0x1F, 0x8B, 8])
    }

    pub(crate) fn inflate(_: &[u8], _: usize) -> Result<Vec<u8>> {
        left_out("gzip", "gzip")
    }
}
