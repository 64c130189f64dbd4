//! Graphics processors in a program built without the feature `gpu`: none can be opened.

use super::source::Rows;
use super::varying::{Kernels, Tiling};
use camrig_base::{Error, ErrorCode, Plane, Result};

/// None.
#[derive(Debug)]
#[non_exhaustive]
pub enum Gpu {}

impl Gpu {
    /// Says that there is none.
    ///
    /// # Errors
    /// Always.
    pub fn open(_any: bool) -> Result<&'static Self> {
        Err(Error::unsupported("this camrig was built without graphics processors")
            .help("build it with the feature `gpu`, or use the processor")
            .with_code(ErrorCode::BuiltWithoutGraphics))
    }

    pub fn name(&self) -> &str {
        match *self {}
    }
}

/// None.
#[non_exhaustive]
pub enum Blurrer {}

impl Blurrer {
    pub fn new(gpu: &'static Gpu, _tiling: &Tiling) -> Result<Self> {
        match *gpu {}
    }

    pub fn tiling(&self) -> &Tiling {
        match *self {}
    }

    pub fn blur(
        &self,
        _rows: &Rows<'_>,
        _kernels: &Kernels,
        _corner: (usize, usize),
        _size: (usize, usize),
    ) -> Result<Plane<f32>> {
        match *self {}
    }
}
