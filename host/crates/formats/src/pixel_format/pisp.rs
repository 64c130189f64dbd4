//! Raw as a Raspberry Pi 5 stores it by default: compressed with loss to 8 bits a sample (PiSP
//! compression mode 1).
//!
//! Sources: Linux, `pixfmt-srggb8-pisp-comp.rst`, for the words; the decoder of rpicam-apps
//! (`image/dng.cpp`, BSD-2) for the levels of mode 3, of which that text has others.
//!
//! Eight samples take eight bytes: a word of 32 bits, low byte first, of the even ones and a word
//! of the odd ones. A word has a mode and four levels, as differences or, in mode 3, each by
//! itself; the mode sets the steps of levels: 16 and 32, 64, 128, 256 and 512, of 65536.

/// Samples that are coded together.
pub const GROUP: usize = 8;
/// What is taken off each sample before it is coded, and set to it where that is below.
const OFFSET: u32 = 2048;
/// Levels of mode 3.
const COARSE_LEVELS: u32 = 176;
/// Field 0 from which a word of mode 2 has both inner levels by themselves.
const HIGH_PAIR: u32 = 384;

/// Unpacks a row of whole groups.
pub fn unpack(bytes: &[u8], row: &mut [u16]) {
    for (bytes, samples) in bytes.chunks_exact(GROUP).zip(row.chunks_mut(GROUP)) {
        for phase in 0..2 {
            let word: [u8; 4] = std::array::from_fn(|i| bytes[4 * phase + i]);
            let decoded = samples_of(u32::from_le_bytes(word));
            for (i, sample) in decoded.into_iter().enumerate() {
                if let Some(place) = samples.get_mut(2 * i + phase) {
                    *place = sample;
                }
            }
        }
    }
}

fn samples_of(word: u32) -> [u16; 4] {
    let mode = word & 3;
    let levels = if mode == 3 { coarse(word) } else { differences(word, mode) };
    levels.map(|level| {
        let value = match mode {
            0 if level < 320 => 16 * level,
            0 => 32 * (level - 160),
            1 => 64 * level,
            2 => 128 * level,
            _ if level < 94 => 256 * level,
            _ => 512 * (level - 47),
        };
        (value + OFFSET).min(u16::MAX.into()) as u16
    })
}

/// The levels of a word as a base of the inner two, their difference, and those of the outer ones
/// from them.
fn differences(word: u32, mode: u32) -> [u32; 4] {
    let field = |shift: u32| (word >> shift) & 127;
    let (base, first, second, third) = ((word >> 2) & 511, field(11), field(18), field(25));
    let [b, c] = if mode == 2 && base >= HIGH_PAIR {
        [base, first + HIGH_PAIR]
    } else if first >= 64 {
        [base, base + first - 64]
    } else {
        [base + 64 - first, base]
    };
    let below = |level: u32| {
        let least = level.saturating_sub(64);
        if mode == 2 { least.min(HIGH_PAIR) } else { least }
    };
    [below(b) + second, b, c, below(c) + third]
}

/// Two pairs of levels of [`COARSE_LEVELS`] each, 15 bits a pair.
fn coarse(word: u32) -> [u32; 4] {
    let pair = |shift: u32| {
        let k = (word >> shift) & 0x7fff;
        [(k & 15) + 16 * ((k >> 8) / 11), (k >> 4) % COARSE_LEVELS]
    };
    let ([a, b], [c, d]) = (pair(2), pair(17));
    [a, b, c, d]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Words of all modes, decoded by the program of the sources.
    #[test]
    fn words_of_all_modes_are_decoded() {
        for (word, samples) in WORDS {
            let mut row = [0; GROUP];
            unpack(&[word.to_le_bytes(), word.to_le_bytes()].concat(), &mut row);
            let both: Vec<u16> = samples.iter().flat_map(|&s| [s, s]).collect();
            assert_eq!(row[..], both[..], "{word:08x}");
        }
    }

    const WORDS: [(u32, [u16; 4]); 5] = [
        (0x88ce01fc, [3872, 4080, 4080, 4144]),
        (0x7921d6b9, [30464, 29952, 29568, 29312]),
        (0x8b15ef36, [60032, 61056, 59008, 59648]),
        (0x145001e3, [4096, 3840, 4096, 60928]),
        (0xa12a3f26, [60672, 60544, 60288, 61440]),
    ];
}
