//! Text of lens programs: the encodings they write, and their numbers.

use camrig_base::table::with_line_feeds;
use camrig_base::{Error, Result};
use std::path::Path;

/// Reads a text file written as UTF-8, UTF-16 (with or without byte-order mark) or Latin-1.
///
/// # Errors
/// The file cannot be read.
pub fn read_text(path: &Path) -> Result<String> {
    std::fs::read(path).map(|b| decode(&b)).map_err(|e| Error::io("read", path, e))
}

/// Text from bytes. A byte-order mark decides; without one, zero bytes in every other place mean
/// UTF-16; what is not UTF-8 is Latin-1 (µ in Zemax listings), in which every byte is a character.
/// A CR alone ends a line too ([`with_line_feeds`]).
#[must_use]
pub fn decode(bytes: &[u8]) -> String {
    with_line_feeds(&characters(bytes)).into_owned()
}

fn characters(bytes: &[u8]) -> String {
    let head = &bytes[..bytes.len().min(256)];
    let zeros = |parity: usize| head.iter().skip(parity).step_by(2).filter(|b| **b == 0).count();
    let half = head.len() / 4;
    let utf16 = |bytes: &[u8], unit: fn([u8; 2]) -> u16| {
        let units: Vec<u16> = bytes.chunks_exact(2).map(|c| unit([c[0], c[1]])).collect();
        String::from_utf16_lossy(&units)
    };
    match bytes {
        [0xFF, 0xFE, rest @ ..] => utf16(rest, u16::from_le_bytes),
        [0xFE, 0xFF, rest @ ..] => utf16(rest, u16::from_be_bytes),
        _ if half > 0 && zeros(1) > half => utf16(bytes, u16::from_le_bytes),
        _ if half > 0 && zeros(0) > half => utf16(bytes, u16::from_be_bytes),
        _ => match std::str::from_utf8(bytes) {
            Ok(text) => text.trim_start_matches('\u{feff}').to_owned(),
            Err(_) => bytes.iter().map(|&b| char::from(b)).collect(),
        },
    }
}

/// A finite number; accepts the comma-free forms lens programs write (`1.5E-002`, `.5`, `1D3`).
///
/// # Errors
/// Text that is no finite number; the message names `what`.
pub fn number(what: &str, token: &str) -> Result<f64> {
    let wrong = || {
        Error::input(format!("{what}: \"{token}\" is not a number"))
            .help("write a finite decimal number, like -12.5 or 1.2e-3")
    };
    let plain = token.trim().replace(['d', 'D'], "e");
    plain.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(wrong)
}

/// All words of a line as numbers.
///
/// # Errors
/// As [`number`].
pub fn numbers(what: &str, words: &[&str]) -> Result<Vec<f64>> {
    words.iter().map(|w| number(what, w)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_encoding_gives_the_same_text() {
        let text = "0.5500 µm at 3 deg.\r\nx";
        let le: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        let be: Vec<u8> = text.encode_utf16().flat_map(u16::to_be_bytes).collect();
        let latin: Vec<u8> = text.chars().map(|c| c as u8).collect();
        let marked = [&[0xFF, 0xFE], &le[..]].concat();
        for bytes in [text.as_bytes(), &le, &be, &latin, &marked] {
            assert_eq!(decode(bytes), text);
        }
    }

    #[test]
    fn a_lone_carriage_return_ends_a_line() {
        for (text, lines) in [
            ("a b\rc\r", &["a b", "c"][..]),
            ("a\r\nb\rc\nd", &["a", "b", "c", "d"]),
            ("a\r\r\nb\r\n", &["a", "b"]),
        ] {
            let le: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
            for bytes in [text.as_bytes(), &[&[0xFF, 0xFE], &le[..]].concat()] {
                assert_eq!(decode(bytes).lines().collect::<Vec<_>>(), lines, "{text:?}");
            }
        }
    }

    #[test]
    fn numbers_are_finite() {
        assert_eq!(number("x", "1.5D-002").unwrap(), 0.015);
        for bad in ["inf", "NaN", "", "1,5", "abc", "1e999"] {
            assert!(number("x", bad).is_err(), "{bad}");
        }
    }
}
