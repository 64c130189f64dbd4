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

/// What the samples of one channel are on average.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelMean {
    /// Name of the channel, its letter in small.
    pub name: String,
    /// Mean, DN.
    pub mean_dn: f64,
    /// Fraction of the samples at or above the white level, 0 to 1.
    pub saturated: f64,
}

impl RawFrame {
    /// Mean and saturated fraction of each channel, in channel order.
    pub fn channel_means(&self) -> Vec<ChannelMean> {
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
            ChannelMean {
                name: c.to_lowercase().to_string(),
                mean_dn: sum as f64 / n,
                saturated: full as f64 / n,
            }
        };
        channels.iter().zip(sums).map(figures).collect()
    }
}
