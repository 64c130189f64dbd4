//! The rig's limits, which are the sizes of its static memory.

/// Longest row, pixels.
pub const WIDTH: usize = 2048;
/// Largest number of spectral bands; the memory does not depend on it, as bands are summed as they
/// arrive.
pub const BANDS: u16 = 64;
/// Rows: three of means and a pipeline of four, for one effect that reads its neighbours.
pub const ROWS: usize = 7;
/// Longest packed raw row, bytes.
pub const RAW_BYTES: usize = 2 * WIDTH;
/// Longest packet received: a band of 2048 pixels is 4224 bytes.
pub const PACKET: usize = 4400;
/// Packets that the host may have under way.
pub const CREDIT: u16 = 32;
/// Longest packet sent.
pub const ANSWER: usize = 1100;
/// Values of the crosstalk table: 13 x 17 nodes, 7 wavelengths, 3 channels, and the axes.
pub const CROSSTALK: usize = 13 * 17 * 7 * 3 + 37;
/// Most captures of a pixel. They have the memory of rows in equal parts: rows of four captures have a
/// quarter of the pixels at most.
pub const CAPTURES: usize = 4;
