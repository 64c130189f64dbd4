//! Rice coding of integers (FITS Standard 4.0, section 10.4.1): differences of neighbours, in
//! blocks that each have a number of low bits stored as they are.

use camrig_base::{Error, Result};

/// Decodes `count` values of `bits` bits (8, 16 or 32) in blocks of `block` values.
///
/// # Errors
/// Bytes that end before the last value.
pub(super) fn decode(bytes: &[u8], count: usize, block: usize, bits: u32) -> Result<Vec<i64>> {
    // Bits of a block's number of low bits, and the numbers that mark other codings.
    let (width, raw) = match bits {
        8 => (3, 6),
        16 => (4, 14),
        _ => (5, 25),
    };
    let mut source = Bits { bytes, at: 0 };
    let mask = u64::MAX >> (64 - bits);
    let mut last = source.take(bits)?;
    let mut values = Vec::with_capacity(count.min(bytes.len().saturating_mul(8 * block)));
    while values.len() < count {
        let low = source.take(width)?;
        for _ in 0..block.min(count - values.len()) {
            let folded = match low {
                0 => 0, // all differences are zero
                n if n == raw + 1 => source.take(bits)?,
                n if n > raw + 1 => return Err(damaged()),
                n => {
                    let zeros = source.zeros()?;
                    let shift = n as u32 - 1;
                    (zeros << shift & mask) | source.take(shift)?
                }
            };
            // Differences are folded: 0, -1, 1, -2, ...
            let difference = if folded & 1 == 0 { folded >> 1 } else { !(folded >> 1) };
            last = last.wrapping_add(difference) & mask;
            values.push(signed(last, bits));
        }
    }
    Ok(values)
}

/// Bytes are unsigned in FITS, wider integers signed.
fn signed(value: u64, bits: u32) -> i64 {
    match bits {
        8 => value as i64,
        16 => i64::from(value as i16),
        _ => i64::from(value as i32),
    }
}

fn damaged() -> Error {
    Error::input("Rice-coded FITS data end early or are damaged").help("get the file again")
}

struct Bits<'a> {
    bytes: &'a [u8],
    /// The next bit, counted from the first.
    at: usize,
}

impl Bits<'_> {
    fn bit(&mut self) -> Result<u64> {
        let byte = *self.bytes.get(self.at / 8).ok_or_else(damaged)?;
        let bit = byte >> (7 - self.at % 8) & 1;
        self.at += 1;
        Ok(bit.into())
    }

    fn take(&mut self, count: u32) -> Result<u64> {
        (0..count).try_fold(0, |value, _| Ok(value << 1 | self.bit()?))
    }

    /// The number of zeros before the next one.
    fn zeros(&mut self) -> Result<u64> {
        let mut count = 0;
        while self.bit()? == 0 {
            count += 1;
        }
        Ok(count)
    }
}
