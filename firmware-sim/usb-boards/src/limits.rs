//! The rig's limits, which are the sizes of its static memory: 287 KiB of the 512 KiB that both
//! chips have.

/// Longest row, pixels: a row of 4096 pixels takes 16 KiB for each row of means.
pub const WIDTH: usize = 4096;
/// Largest number of spectral bands; the memory does not depend on it, as bands are summed as they
/// arrive. 64 is what a camera's configuration can hold.
pub const BANDS: u16 = 64;
/// Rows: five of means and a pipeline of seven, for two effects that read their neighbours.
pub const ROWS: usize = 12;
/// Longest packed raw row, bytes.
pub const RAW_BYTES: usize = 2 * WIDTH;
/// Longest packet received, as the host sends them on serial lines.
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
