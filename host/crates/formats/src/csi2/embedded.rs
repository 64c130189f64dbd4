//! Embedded data lines.

/// An embedded data line in the tagged format of MIPI CCS (chapter "Embedded data"; SMIA's
/// simplified 2-byte tags): the register values from which drivers learn the settings of a frame.
///
/// `registers` are pairs of address and value; `bits` are those of the image's samples. Filler
/// bytes 0x55 stand where the image's lines have bits below the upper eight of a sample (V4L2's
/// `metafmt-generic`): behind every 4th byte for 10 bits, every 2nd for 12, one behind each for
/// 16, one and two in turn for 20, two for 24. With 14 bits bytes follow each other.
pub fn ccs_line(registers: &[(u16, u8)], bits: u32) -> Vec<u8> {
    const FORMAT: u8 = 0x0A;
    const ADDRESS_HIGH: u8 = 0xAA;
    const ADDRESS_LOW: u8 = 0xA5;
    const VALUE: u8 = 0x5A;
    const END: u8 = 0x07;
    const FILLER: u8 = 0x55;
    let mut plain = vec![FORMAT];
    let mut next = None;
    for &(address, value) in registers {
        if next != Some(address) {
            let [high, low] = address.to_be_bytes();
            plain.extend([ADDRESS_HIGH, high, ADDRESS_LOW, low]);
        }
        plain.extend([VALUE, value]);
        next = address.checked_add(1);
    }
    plain.push(END);
    // Bytes of data, and fillers behind them, in turn.
    let groups: &[(usize, usize)] = match bits {
        10 => &[(4, 1)],
        12 => &[(2, 1)],
        16 => &[(1, 1)],
        20 => &[(1, 1), (1, 2)],
        24 => &[(1, 2)],
        _ => return plain,
    };
    plain.resize(plain.len().next_multiple_of(groups.iter().map(|(data, _)| data).sum()), END);
    let mut line = Vec::new();
    let mut rest = &plain[..];
    for &(data, fillers) in groups.iter().cycle() {
        let Some((first, behind)) = rest.split_at_checked(data).filter(|_| !rest.is_empty())
        else {
            break;
        };
        line.extend_from_slice(first);
        line.resize(line.len() + fillers, FILLER);
        rest = behind;
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tags as libcamera's SMIA parser reads them, with a filler after every 4 bytes.
    #[test]
    fn ccs_lines_have_tags_and_fillers() {
        assert_eq!(
            ccs_line(&[(0x0202, 1), (0x0203, 2)], 10),
            [
                0x0A, 0xAA, 0x02, 0xA5, 0x55, 0x02, 0x5A, 0x01, 0x5A, 0x55, 0x02, 0x07, 0x07,
                0x07, 0x55
            ]
        );
    }

    /// The layouts of V4L2's `metafmt-generic`, of the bytes 0A AA 00 A5 05 5A 07 07.
    #[test]
    fn fillers_stand_for_low_bits() {
        let line = |bits| ccs_line(&[(0x0005, 7)], bits);
        let plain = [0x0A, 0xAA, 0x00, 0xA5, 0x05, 0x5A, 0x07, 0x07];
        assert_eq!(line(8), plain);
        let every = |step: usize| line(4 * step as u32 + 8).chunks(2).next().map(<[u8]>::to_vec);
        assert_eq!(every(2), Some(vec![0x0A, 0x55]));
        assert_eq!(line(20)[..10], [0x0A, 0x55, 0xAA, 0x55, 0x55, 0x00, 0x55, 0xA5, 0x55, 0x55]);
        assert_eq!(line(24)[..6], [0x0A, 0x55, 0x55, 0xAA, 0x55, 0x55]);
    }
}
