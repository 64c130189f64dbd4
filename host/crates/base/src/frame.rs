//! A raw frame: digital numbers with what is needed to interpret them.

use crate::{Cfa, Plane};
use std::fmt;
use std::str::FromStr;

/// The type of a digital number: `u16`, or `u32` for signals of more than 16 bits, which sensors
/// make that merge several readings of a pixel.
pub trait Dn:
    Copy + Default + Ord + fmt::Debug + fmt::Display + FromStr + Into<u32> + Send + Sync + 'static
{
    /// Most bits of a sample.
    const MAX_BITS: u32;

    /// A number as DN; `None` beyond the type's range.
    fn of(number: i128) -> Option<Self>;
}

impl Dn for u16 {
    const MAX_BITS: u32 = 16;

    fn of(number: i128) -> Option<Self> {
        number.try_into().ok()
    }
}

impl Dn for u32 {
    const MAX_BITS: u32 = 32;

    fn of(number: i128) -> Option<Self> {
        number.try_into().ok()
    }
}

/// A raw frame: digital numbers (DN), and what file formats say about them.
#[derive(Clone, Debug, PartialEq)]
pub struct RawFrame<S = u16> {
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
    pub white_level_dn: S,
    /// Row-major DN.
    pub data: Vec<S>,
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

impl<S: Dn> RawFrame<S> {
    /// The samples alone.
    pub fn plane(&self) -> Plane<S> {
        Plane { width: self.width, height: self.height, data: self.data.clone() }
    }

    /// Mean and saturated fraction of each channel, in channel order.
    pub fn channel_means(&self) -> Vec<ChannelMean> {
        let channels = self.cfa.channels();
        let mut sums = vec![(0u64, 0u64, 0u64); channels.len()];
        for (y, row) in self.data.chunks(self.width).enumerate() {
            let of_column: Vec<usize> =
                (0..self.cfa.width).map(|x| self.cfa.channel(x, y)).collect();
            for (x, &dn) in row.iter().enumerate() {
                let (sum, count, full) = &mut sums[of_column[x % self.cfa.width]];
                *sum += u64::from(dn.into());
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

impl RawFrame<u32> {
    /// The samples in 16 bits, as many of the lower ones left out as the brightest demands, and how
    /// many times nearer full scale they are.
    pub fn in_16_bits(&self) -> (RawFrame, f64) {
        let brightest = self.data.iter().copied().max().unwrap_or(0);
        let used =
            (u32::BITS - brightest.leading_zeros()).clamp(u16::BITS, self.bits.max(u16::BITS));
        let (shift, unused) = (used - u16::BITS, self.bits.saturating_sub(used));
        let lower = |dn: u32| u16::try_from(dn >> shift).unwrap_or(u16::MAX);
        let frame = RawFrame {
            width: self.width,
            height: self.height,
            bits: self.bits.min(u16::BITS),
            cfa: self.cfa.clone(),
            black_level_dn: self.black_level_dn / f64::from(1u32 << shift),
            white_level_dn: lower(self.white_level_dn),
            data: self.data.iter().map(|dn| lower(*dn)).collect(),
        };
        (frame, f64::from(1u32 << unused))
    }
}
