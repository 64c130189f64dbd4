//! One raw frame and what is needed to read it.

use crate::camera::Cfa;

/// A raw frame: DN per pixel with the facts that its file formats carry.
#[derive(Clone, Debug, PartialEq)]
pub struct RawFrame {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Bits per sample; every DN is below `1 << bits`.
    pub bits: u32,
    /// Colour filter pattern.
    pub cfa: Cfa,
    /// Mean DN of no light.
    pub black_level_dn: f64,
    /// DN at which the signal saturates (not always `(1 << bits) - 1`).
    pub white_level_dn: u16,
    /// Row-major DN.
    pub data: Vec<u16>,
}
