//! Types of numbers in files of arrays.

/// A type of numbers in files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Sample {
    /// Unsigned 8 bit.
    U8,
    /// Signed 8 bit.
    I8,
    /// Signed 16 bit.
    I16,
    /// Unsigned 16 bit.
    U16,
    /// Signed 32 bit.
    I32,
    /// Unsigned 32 bit.
    U32,
    /// Signed 64 bit.
    I64,
    /// Unsigned 64 bit.
    U64,
    /// IEEE half.
    F16,
    /// IEEE single.
    F32,
    /// IEEE double.
    F64,
}

impl Sample {
    /// Bytes per sample.
    pub fn bytes(self) -> usize {
        match self {
            Sample::U8 | Sample::I8 => 1,
            Sample::I16 | Sample::U16 | Sample::F16 => 2,
            Sample::I32 | Sample::U32 | Sample::F32 => 4,
            Sample::F64 | Sample::I64 | Sample::U64 => 8,
        }
    }

    /// The type of NumPy's name, such as `<f4`, and whether the big end comes first.
    pub fn of_numpy(descr: &str) -> Option<(Self, bool)> {
        let sample = match descr.trim_start_matches(['<', '>', '|', '=']) {
            "u1" => Self::U8,
            "i1" => Self::I8,
            "i2" => Self::I16,
            "u2" => Self::U16,
            "i4" => Self::I32,
            "u4" => Self::U32,
            "i8" => Self::I64,
            "u8" => Self::U64,
            "f2" => Self::F16,
            "f4" => Self::F32,
            "f8" => Self::F64,
            _ => return None,
        };
        Some((sample, descr.starts_with('>')))
    }

    /// The sample in the first bytes of `raw`, little-endian, as a double.
    pub fn number(self, raw: &[u8]) -> f64 {
        match self {
            Sample::U8 => f64::from(raw[0]),
            Sample::I8 => f64::from(raw[0].cast_signed()),
            Sample::I16 => f64::from(i16::from_le_bytes([raw[0], raw[1]])),
            Sample::U16 => f64::from(u16::from_le_bytes([raw[0], raw[1]])),
            Sample::F16 => f64::from(half_to_f32(u16::from_le_bytes([raw[0], raw[1]]))),
            Sample::I32 => f64::from(i32::from_le_bytes([raw[0], raw[1], raw[2], raw[3]])),
            Sample::U32 => f64::from(u32::from_le_bytes([raw[0], raw[1], raw[2], raw[3]])),
            Sample::F32 => f64::from(f32::from_le_bytes([raw[0], raw[1], raw[2], raw[3]])),
            Sample::F64 => f64::from_le_bytes(eight(raw)),
            // Beyond 2⁵³ the nearest double.
            Sample::I64 => i64::from_le_bytes(eight(raw)) as f64,
            Sample::U64 => u64::from_le_bytes(eight(raw)) as f64,
        }
    }

    /// The sample in the first bytes of `raw`, in either byte order.
    pub fn read(self, raw: &[u8], big_endian: bool) -> f64 {
        if !big_endian {
            return self.number(raw);
        }
        let mut swapped = [0; 8];
        let n = self.bytes();
        swapped[..n].copy_from_slice(&raw[..n]);
        swapped[..n].reverse();
        self.number(&swapped)
    }
}

fn eight(raw: &[u8]) -> [u8; 8] {
    [raw[0], raw[1], raw[2], raw[3], raw[4], raw[5], raw[6], raw[7]]
}

/// IEEE 754 binary16 to binary32, exact.
fn half_to_f32(bits: u16) -> f32 {
    let magnitude = u32::from(bits & 0x7fff);
    let value = if magnitude >= 0x7c00 {
        f32::from_bits(0x7f80_0000 | (magnitude & 0x3ff) << 13)
    } else {
        // Shift into place and correct the exponent bias by a multiplication, which also
        // normalises subnormals.
        f32::from_bits(magnitude << 13) * f32::from_bits((254 - 15) << 23)
    };
    if bits & 0x8000 == 0 { value } else { -value }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_exact() {
        for (bits, value) in [
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (0x0001, 2f32.powi(24).recip()),
            (0x03ff, 1023.0 * 2f32.powi(24).recip()),
            (0x3555, 0.333_251_95),
            (0x0000, 0.0),
        ] {
            assert_eq!(half_to_f32(bits), value);
        }
        assert!(half_to_f32(0x7e00).is_nan() && half_to_f32(0xfc00) == f32::NEG_INFINITY);
    }
}
