//! The colour filter array: which channel each pixel of a sensor belongs to.

use crate::{Error, Result};
use std::fmt;

/// Letters of filters in four-letter names: red, green, blue, cyan, magenta, yellow, white
/// (clear, also C) and infrared.
const FILTERS: &str = "RGBCMYWI";

/// A colour filter pattern that repeats over the sensor: which channel each pixel belongs to.
///
/// Channels are numbered in order R, G, B (0, 1, 2) for Bayer patterns, 0 for mono, and in order
/// of first appearance of their letter for other patterns. `Gr` and `Gb` greens share channel 1
/// unless the quantum-efficiency table gives them apart.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cfa {
    /// Columns of the repeating pattern.
    pub width: usize,
    /// Rows of the repeating pattern.
    pub height: usize,
    /// Channel letters, row-major.
    pub letters: Vec<char>,
}

impl Cfa {
    /// Reads `mono`, four letters, which are two rows of two (`RGGB` and `RCCC` are short for
    /// `RG/GB` and `RC/CC`), or rows of letters separated by `/`. After `quad-` each letter is a cell
    /// of 2 x 2 pixels: `quad-RGGB` is short for `RRGG/RRGG/GGBB/GGBB`.
    ///
    /// # Errors
    /// Rows of different lengths, sides other than 1 to 6 or 8, and other letters.
    pub fn parse(text: &str) -> Result<Self> {
        if let Some(cells) = text.strip_prefix("quad-") {
            let cells = Self::parse(cells)?;
            let row =
                |y: usize| (0..2 * cells.width).map(|x| cells.letter(x / 2, y / 2)).collect();
            let rows: Vec<String> = (0..2 * cells.height).map(row).collect();
            return Self::parse(&rows.join("/"));
        }
        // Other words of four letters might be meant otherwise.
        let bayer = ["RGGB", "GRBG", "GBRG", "BGGR"].into_iter();
        let text = bayer.chain(["mono"]).find(|b| b.eq_ignore_ascii_case(text)).unwrap_or(text);
        let rows: Vec<&str> = match text {
            "mono" => vec!["M"],
            four if four.len() == 4 && four.chars().all(|c| FILTERS.contains(c)) => {
                vec![&four[..2], &four[2..]]
            }
            other => other.split('/').collect(),
        };
        let (width, height) = (rows[0].len(), rows.len());
        let allowed = [1, 2, 3, 4, 5, 6, 8];
        let letters: Vec<char> = rows.concat().chars().collect();
        if !rows.iter().all(|r| r.len() == width)
            || !allowed.contains(&width)
            || !allowed.contains(&height)
            || !letters.iter().all(|c| c.is_ascii_uppercase())
            // A word: TRUE, BAYER.
            || matches!((width, height), (4 | 5, 1))
        {
            return Err(Error::input(format!("colour filter pattern {text:?}")).help(
                "use RGGB, GRBG, GBRG, BGGR, RCCC or other four letters, quad-RGGB and the like, mono, \
                 or equal rows of 1 to 6 or 8 capital letters separated by '/', for instance \
                 \"RGRG/GBGB\" or \"ABC/DEF/GHI\"",
            ));
        }
        Ok(Self { width, height, letters })
    }

    /// The channel letters in channel order.
    pub fn channels(&self) -> Vec<char> {
        let mut seen = Vec::new();
        for &c in &self.letters {
            if !seen.contains(&c) {
                seen.push(c);
            }
        }
        if seen.iter().all(|c| "RGB".contains(*c)) {
            seen.sort_by_key(|c| "RGB".find(*c));
        }
        seen
    }

    /// The letter at a pixel.
    pub fn letter(&self, x: usize, y: usize) -> char {
        self.letters[(y % self.height) * self.width + x % self.width]
    }

    /// The channel number at a pixel.
    pub fn channel(&self, x: usize, y: usize) -> usize {
        let letter = self.letter(x, y);
        self.channels().iter().position(|&c| c == letter).unwrap_or(0)
    }

    /// Whether all pixels belong to one channel.
    pub fn is_mono(&self) -> bool {
        self.channels().len() == 1
    }
}

impl fmt::Display for Cfa {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_mono() {
            return f.write_str("mono");
        }
        let rows: Vec<String> =
            self.letters.chunks(self.width).map(|r| r.iter().collect()).collect();
        match (self.width, self.height) {
            (2, 2) => f.write_str(&rows.concat()),
            // Four letters alone are two rows of two, five a word: the same pattern, as two rows.
            (4 | 5, 1) => write!(f, "{0}/{0}", rows[0]),
            _ => f.write_str(&rows.join("/")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_letters_are_two_rows_of_two() {
        for (text, rows) in [("RCCC", "RC/CC"), ("RCCB", "RC/CB"), ("RGGB", "RG/GB")] {
            let cfa = Cfa::parse(text).unwrap();
            assert_eq!(cfa, Cfa::parse(rows).unwrap());
            assert_eq!((cfa.width, cfa.height, cfa.to_string()), (2, 2, text.to_string()));
        }
        for (text, named) in [("rggb", "RGGB"), ("Bggr", "BGGR"), ("MONO", "mono")] {
            assert_eq!(Cfa::parse(text).unwrap(), Cfa::parse(named).unwrap());
        }
        let quad = Cfa::parse("quad-GRBG").unwrap();
        assert_eq!(quad, Cfa::parse("GGRR/GGRR/BBGG/BBGG").unwrap());
        for word in [
            "quad-",
            "quad-ABC/DEF/GHI/JKL/MNO",
            "rccc",
            "RÄG",
            "TRUE",
            "GREY",
            "BAYER",
            "ABCDEFG/ABCDEFG",
        ] {
            assert!(Cfa::parse(word).is_err(), "{word}");
        }
    }

    #[test]
    fn what_is_written_is_read_as_the_same_pattern() {
        let line = Cfa { width: 4, height: 1, letters: "RGCB".chars().collect() };
        let five = Cfa { width: 5, height: 1, letters: "ABCDE".chars().collect() };
        let parsed = ["RG", "RGRG/GBGB", "ABC/DEF/GHI", "ABCDE/FGHIJ/KLMNO/PQRST/UVWXY"];
        let parsed = parsed.map(|text| Cfa::parse(text).unwrap());
        for cfa in [line, five].into_iter().chain(parsed) {
            let back = Cfa::parse(&cfa.to_string()).unwrap();
            let places = (0..100).map(|i| (i % 10, i / 10));
            assert!(places.clone().all(|(x, y)| back.letter(x, y) == cfa.letter(x, y)), "{cfa}");
        }
    }
}
