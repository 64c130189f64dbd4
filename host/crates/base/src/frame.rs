//! A raw frame: digital numbers with what is needed to interpret them.

use crate::Cfa;

/// A raw frame: digital numbers (DN), and what file formats say about them.
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

impl RawFrame {
    /// Name, mean (DN) and saturated fraction (0 to 1) of each channel, in channel order.
    pub fn channel_means(&self) -> Vec<(String, f64, f64)> {
        let channels = self.cfa.channels();
        let mut sums = vec![(0u64, 0u64, 0u64); channels.len()];
        for (y, row) in self.data.chunks(self.width).enumerate() {
            let of_column: Vec<usize> =
                (0..self.cfa.width).map(|x| self.cfa.channel(x, y)).collect();
            for (x, &dn) in row.iter().enumerate() {
                let (sum, count, full) = &mut sums[of_column[x % self.cfa.width]];
                *sum += u64::from(dn);
                *count += 1;
                *full += u64::from(dn >= self.white_level_dn);
            }
        }
        let figures = |(c, (sum, count, full)): (&char, (u64, u64, u64))| {
            let n = count.max(1) as f64;
            (c.to_lowercase().to_string(), sum as f64 / n, full as f64 / n)
        };
        channels.iter().zip(sums).map(figures).collect()
    }
}
