//! Pixel formats as GenICam's PFNC 2.4 numbers them. Bits 16 to 23 of a code are the bits of a
//! pixel in memory; `p` is packed without gaps, lowest bits first.

/// Colour filters by the first two pixels of the first row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pattern {
    /// None.
    Mono,
    /// RGGB.
    BayerRg,
    /// GRBG.
    BayerGr,
    /// GBRG.
    BayerGb,
    /// BGGR.
    BayerBg,
}

/// Depths with their suffix: bits of a sample, packed or in words, and the codes of `Mono`, of the
/// first Bayer pattern and the step to the next. Words are numbered GR, RG, GB, BG, packed ones BG,
/// GB, GR, RG.
const DEPTHS: [(u32, bool, u32, u32, u32); 7] = [
    (8, false, 0x0108_0001, 0x0108_0008, 1),
    (10, false, 0x0110_0003, 0x0110_000C, 1),
    (10, true, 0x010A_0046, 0x010A_0052, 2),
    (12, false, 0x0110_0005, 0x0110_0010, 1),
    (12, true, 0x010C_0047, 0x010C_0053, 2),
    (14, false, 0x0110_0025, 0x0110_0109, 1),
    (16, false, 0x0110_0007, 0x0110_002E, 1),
];

/// A pixel format.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PixelFormat {
    /// Its name in PFNC, such as `BayerRG12p`.
    pub name: String,
    /// Its number there.
    pub code: u32,
}

impl PixelFormat {
    /// The formats of a sensor with samples of `bits` bits, the sensor's own first. Of 14 bits
    /// there is the sensor's own alone.
    pub fn of_sensor(pattern: Pattern, bits: u32) -> Vec<Self> {
        let own = |depth: u32, packed: bool| depth == bits && !packed;
        let mut depths: Vec<_> =
            DEPTHS.into_iter().filter(|&(depth, ..)| depth != 14 || bits == 14).collect();
        depths.sort_by_key(|&(depth, packed, ..)| !own(depth, packed));
        depths
            .into_iter()
            .map(|(depth, packed, mono, first, step)| {
                let place = |order: [Pattern; 4]| {
                    order.iter().position(|p| *p == pattern).map(|i| first + step * i as u32)
                };
                use Pattern::{BayerBg, BayerGb, BayerGr, BayerRg};
                let order = match packed {
                    false => [BayerGr, BayerRg, BayerGb, BayerBg],
                    true => [BayerBg, BayerGb, BayerGr, BayerRg],
                };
                let suffix = if packed { "p" } else { "" };
                let name = format!("{}{depth}{suffix}", pattern.name());
                Self { name, code: place(order).unwrap_or(mono) }
            })
            .collect()
    }

    /// Bytes of an image.
    pub fn image_bytes(&self, width: u32, height: u32) -> u64 {
        u64::from(width) * u64::from(height) * u64::from(self.code >> 16 & 0xff) / 8
    }
}

impl Pattern {
    fn name(self) -> &'static str {
        match self {
            Self::Mono => "Mono",
            Self::BayerRg => "BayerRG",
            Self::BayerGr => "BayerGR",
            Self::BayerGb => "BayerGB",
            Self::BayerBg => "BayerBG",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Codes of PFNC's list (emva.org, PFNC.h).
    #[test]
    fn codes_are_those_of_pfnc() {
        let code = |pattern, name: &str| {
            let formats = PixelFormat::of_sensor(pattern, 12);
            formats.iter().find(|f| f.name == name).map(|f| f.code)
        };
        for (pattern, name, expected) in [
            (Pattern::BayerRg, "BayerRG8", 0x0108_0009),
            (Pattern::BayerGb, "BayerGB10", 0x0110_000E),
            (Pattern::BayerGr, "BayerGR10p", 0x010A_0056),
            (Pattern::BayerBg, "BayerBG12p", 0x010C_0053),
            (Pattern::BayerRg, "BayerRG12p", 0x010C_0059),
            (Pattern::BayerBg, "BayerBG16", 0x0110_0031),
            (Pattern::Mono, "Mono12p", 0x010C_0047),
            (Pattern::Mono, "Mono16", 0x0110_0007),
        ] {
            assert_eq!(code(pattern, name), Some(expected), "{name}");
        }
        assert_eq!(code(Pattern::Mono, "Mono14"), None);
    }

    #[test]
    fn the_sensors_own_format_comes_first_and_sizes_count_bits() {
        let formats = PixelFormat::of_sensor(Pattern::BayerGr, 14);
        assert_eq!(
            (&*formats[0].name, formats[0].code, formats.len()),
            ("BayerGR14", 0x0110_0109, 7)
        );
        assert_eq!(formats[0].image_bytes(8, 2), 32);
        let packed = PixelFormat::of_sensor(Pattern::Mono, 10);
        assert_eq!(packed[2].name, "Mono10p");
        assert_eq!(packed[2].image_bytes(8, 2), 20);
    }
}
