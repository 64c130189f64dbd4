//! What the commas within the numbers of a table are: decimal marks, or marks between thousands.

use crate::{Error, Result};

const REMEDY: &str =
    "write all numbers with one decimal mark, and without marks between thousands";

/// The marks that were seen in a table's numbers.
#[derive(Default)]
pub struct Marks {
    /// The first number with a point, and its line.
    point: Option<(usize, String)>,
    /// The first number with a comma, and its line.
    comma: Option<(usize, String)>,
    /// Whether a comma is where none separates thousands.
    is_decimal: bool,
}

impl Marks {
    /// Takes note of a number's mark.
    pub fn see(&mut self, line: usize, number: &str) {
        let first = if number.contains(',') {
            self.is_decimal |= !looks_like_thousands(number);
            &mut self.comma
        } else if number.contains('.') {
            &mut self.point
        } else {
            return;
        };
        first.get_or_insert_with(|| (line, number.to_string()));
    }

    /// Refuses a table of which the marks do not tell the numbers.
    pub fn check(&self) -> Result<()> {
        let Some((line, comma)) = &self.comma else { return Ok(()) };
        let what = match &self.point {
            Some((other, point)) => {
                format!("{comma:?} has a comma, and {point:?} in line {other} a point")
            }
            None if self.is_decimal => return Ok(()),
            None => format!("{comma:?} may be a number of thousands, or one with decimals"),
        };
        Err(Error::input(what).at(format!("line {line}")).help(REMEDY))
    }
}

/// Whether a number is as those of thousands are written: `1,234`, and neither `0,512` nor `12,5`.
fn looks_like_thousands(number: &str) -> bool {
    let all_digits = |text: &str| text.chars().all(|c| c.is_ascii_digit());
    let number = number.trim_start_matches(['+', '-']);
    number.split_once(',').is_some_and(|(before, after)| {
        (1..=3).contains(&before.len())
            && !before.starts_with('0')
            && all_digits(before)
            && after.len() == 3
            && all_digits(after)
    })
}

#[cfg(test)]
mod tests {
    use crate::table::SpectralTable;

    #[test]
    fn numbers_with_marks_between_thousands_are_refused() {
        for (text, says) in [
            (
                "nm\tpower\n380.0\t987\n500.0\t1,234\n",
                "\"1,234\" has a comma, and \"380.0\" in line 2 a point",
            ),
            ("nm;power\n380;1.234\n500;987,5\n", "\"1.234\" in line 2 a point"),
            ("nm;power\n380;987\n500;1,234\n", "\"1,234\" may be a number of thousands"),
            ("nm power\n380 -1,234\n500 10,500\n", "without marks between thousands"),
        ] {
            let error = SpectralTable::parse(text).expect_err(text).to_string();
            assert!(error.contains(says), "{text:?}: {error}");
        }
    }

    #[test]
    fn decimal_commas_are_told_from_thousands() {
        for (text, right) in [
            ("nm;power\n380;1,234\n500;0,512\n", [1.234, 0.512]),
            ("nm;power\n380;1,234\n500;12,5\n", [1.234, 12.5]),
            ("nm;power\n380,5;1,234\n500,5;2,345\n", [1.234, 2.345]),
            ("nm;power\n380;1,234e3\n500;2,345e3\n", [1234.0, 2345.0]),
            ("nm,power\n380,1.234\n500,987.5\n", [1.234, 987.5]),
        ] {
            let table = SpectralTable::parse(text).unwrap_or_else(|e| panic!("{text:?}: {e}"));
            assert_eq!(table.curves[0].1, right, "{text:?}");
        }
    }
}
