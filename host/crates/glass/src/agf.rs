//! Zemax glass catalogues (`.agf`): `NM` starts a glass with its name and the number of its
//! formula, `CD` has the coefficients and `LD` the wavelengths, in µm. The rest (heat, prices,
//! transmission) is not used.
//!
//! Formulas as in the program's manual (Glass Catalogs, "The glass dispersion formulas").

use crate::text::number;
use crate::{D_LINE, Dispersion, Found, Glass, key};
use camrig_base::{Error, Result};
use std::collections::BTreeMap;

/// Difference of n_d between a glass's formula and the value printed with it from which on the
/// two are not the same glass.
const MISPRINT: f64 = 1e-3;

/// A catalogue file: its glasses, right or wrong.
#[derive(Clone, Debug)]
pub(super) struct File {
    /// Name of the catalogue, in small letters.
    pub name: String,
    /// By their names in the form of [`key`]; more than one where names repeat.
    glasses: BTreeMap<String, Vec<Entry>>,
}

/// A glass as the file has it.
#[derive(Clone, Debug, Default)]
struct Entry {
    line: usize,
    name: String,
    formula: String,
    nd: String,
    coefficients: Vec<String>,
    range: Vec<String>,
}

/// Reads a catalogue. A glass that is wrong is reported when it is asked for.
pub(super) fn read(name: &str, text: &str) -> File {
    let mut glasses: BTreeMap<String, Vec<Entry>> = BTreeMap::new();
    let mut entry = Entry::default();
    let mut keep = |entry: Entry| {
        if !entry.name.is_empty() {
            glasses.entry(key(&entry.name)).or_default().push(entry);
        }
    };
    for (i, line) in text.lines().enumerate() {
        let mut words = line.split_whitespace();
        let keyword = words.next().unwrap_or("");
        let values = || words.clone().map(str::to_owned);
        match keyword {
            "NM" => {
                let mut values = values();
                let mut next = || values.next().unwrap_or_default();
                let (name, formula, _code, nd) = (next(), next(), next(), next());
                let line = i + 1;
                keep(std::mem::replace(
                    &mut entry,
                    Entry { line, name, formula, nd, ..Entry::default() },
                ));
            }
            "CD" => entry.coefficients = values().collect(),
            "LD" => entry.range = values().collect(),
            _ => {}
        }
    }
    keep(entry);
    File { name: name.to_ascii_lowercase(), glasses }
}

impl File {
    /// The glass of a name in the form of [`key`].
    pub fn find(&self, wanted: &str) -> Option<Result<Found>> {
        let (last, before) = self.glasses.get(wanted)?.split_last()?;
        let one = || {
            let found = last.found()?;
            for other in before {
                if other.found()?.glass.dispersion != found.glass.dispersion {
                    return Err(last.differs(other));
                }
            }
            Ok(found)
        };
        Some(one())
    }
}

impl Entry {
    fn place(&self) -> String {
        format!("{} (line {})", self.name, self.line)
    }

    /// That another glass of the file has this one's name.
    fn differs(&self, other: &Self) -> Error {
        Error::input(format!("{} and {} are different glasses", other.place(), self.place()))
            .help("names are compared without case, dashes and blanks: take one out of the file")
    }

    fn found(&self) -> Result<Found> {
        self.read().map_err(|e| e.at(self.place()))
    }

    fn read(&self) -> Result<Found> {
        let coefficients: Result<Vec<f64>> =
            self.coefficients.iter().map(|w| number("CD", w)).collect();
        let coefficients = coefficients?;
        if coefficients.iter().all(|v| *v == 0.0) {
            return Err(Error::input("the glass has no coefficients (CD)")
                .help("its index is not known: give its CD line, or n_d:V_d in its place"));
        }
        let formula = number("formula", &self.formula)?;
        let dispersion = dispersion(formula, &coefficients)?;
        let [low, high] = &self.range[..] else {
            return Err(Error::input("the glass has no LD line of two wavelengths")
                .help("without the range of its data it is not used"));
        };
        let range_nm = [number("LD", low)? * 1e3, number("LD", high)? * 1e3];
        if !(range_nm[0] > 0.0 && range_nm[1] > range_nm[0]) {
            return Err(Error::input(format!("LD {low} {high}"))
                .help("the shorter wavelength comes first, in µm"));
        }
        let glass = Glass { name: self.name.clone(), dispersion, range_nm };
        let note = self.misprint(&glass);
        Ok(Found { glass, note, replaced: None })
    }

    /// A note on a formula that does not give the n_d printed with it.
    fn misprint(&self, glass: &Glass) -> Option<String> {
        let printed: f64 = self.nd.parse().ok().filter(|n| *n > 1.0)?;
        let inside = (glass.range_nm[0]..=glass.range_nm[1]).contains(&(D_LINE * 1e3));
        let nd = glass.dispersion.index(D_LINE);
        let differs = (nd - printed).is_nan() || (nd - printed).abs() > MISPRINT;
        (inside && differs).then(|| {
            format!(
                "glass {}: its formula gives n_d {nd:.5}, the catalogue prints {printed}; the \
                 formula is used",
                self.name
            )
        })
    }
}

fn dispersion(formula: f64, given: &[f64]) -> Result<Dispersion> {
    // A catalogue may leave zeros at the end out.
    let c = |i: usize| given.get(i).copied().unwrap_or(0.0);
    let sellmeier = |offset: f64, terms: Vec<[f64; 2]>| Dispersion::Sellmeier {
        offset,
        terms,
        poles: Vec::new(),
        square: 0.0,
    };
    let pairs = |n: usize| (0..n).map(|i| [c(2 * i), c(2 * i + 1)]).collect::<Vec<_>>();
    let series = |squared: bool, powers: &[f64]| Dispersion::PowerSeries {
        squared,
        terms: powers.iter().enumerate().map(|(i, p)| [c(i), *p]).collect(),
    };
    let (used, dispersion) = match formula {
        1.0 => (6, Dispersion::schott([c(0), c(1), c(2), c(3), c(4), c(5)])),
        2.0 => (6, sellmeier(0.0, pairs(3))),
        3.0 => (6, Dispersion::Herzberger([c(0), c(1), c(2), c(3), c(4), c(5)])),
        4.0 => (
            5,
            Dispersion::Sellmeier {
                offset: c(0),
                terms: vec![[c(1), c(2) * c(2)]],
                poles: vec![[c(3), c(4) * c(4)]],
                square: 0.0,
            },
        ),
        5.0 => (3, series(false, &[0.0, -1.0, -3.5])),
        6.0 => (8, sellmeier(0.0, pairs(4))),
        7.0 => (
            4,
            Dispersion::Sellmeier {
                offset: c(0) - 1.0,
                terms: Vec::new(),
                poles: vec![[c(1), c(2)]],
                square: -c(3),
            },
        ),
        8.0 => (
            4,
            Dispersion::Sellmeier {
                offset: c(0) - 1.0,
                terms: vec![[c(1), c(2)]],
                poles: Vec::new(),
                square: -c(3),
            },
        ),
        9.0 => (5, sellmeier(c(0) - 1.0, vec![[c(1), c(2)], [c(3), c(4)]])),
        10.0 => (8, series(true, &[0.0, 2.0, -2.0, -4.0, -6.0, -8.0, -10.0, -12.0])),
        11.0 => (10, sellmeier(0.0, pairs(5))),
        12.0 => (8, series(true, &[0.0, 2.0, -2.0, -4.0, -6.0, -8.0, 4.0, 6.0])),
        13.0 => (9, series(true, &[0.0, 2.0, 4.0, -2.0, -4.0, -6.0, -8.0, -10.0, -12.0])),
        other => {
            return Err(Error::unsupported(format!("dispersion formula {other}"))
                .help("formulas 1 to 13 are known; give the glass as a table"));
        }
    };
    check_count(formula, given, used)?;
    Ok(dispersion)
}

/// Refuses coefficients that a formula of `used` does not have, and those that end within a pair.
fn check_count(formula: f64, given: &[f64], used: usize) -> Result<()> {
    // The first place of pairs whose second number is the square of a resonance's wavelength.
    let pairs_from = match formula {
        2.0 | 6.0 | 11.0 => Some(0),
        4.0 | 7.0 | 8.0 | 9.0 => Some(1),
        _ => None,
    };
    if let Some(from) = pairs_from
        && given.len() < used
        && given.len() > from
        && (given.len() - from) % 2 == 1
    {
        return Err(Error::input(format!("formula {formula} with {} coefficients", given.len()))
            .help("they come in pairs, and the last has no partner: is the CD line cut short?"));
    }
    if given.iter().skip(used).any(|v| *v != 0.0) {
        return Err(Error::input(format!("formula {formula} with {} coefficients", given.len()))
            .help(format!("it has {used}: is the number of the formula right?")));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn glass(formula: u8, coefficients: &str) -> Result<Found> {
        let text = format!(
            "CC x\r\nNM OWN {formula} 517642 1.5168 64.1 0 1 0\r\nED 7 8 2 0 0\r\nCD \
             {coefficients}\r\nTD 0 0 0\r\nLD 3.5E-01 2.0E+00\r\n"
        );
        read("own", &text).find("OWN").unwrap()
    }

    /// Each formula at 0.5 µm (λ² = 1/4), by hand.
    #[test]
    fn every_formula() {
        for (formula, coefficients, squared) in [
            (
                1,
                "2.25 0.04 0.01 0.002 0.0003 0.00004",
                2.25 + 0.01 + 0.04 + 0.032 + 0.0192 + 0.01024,
            ),
            (2, "1.25 0.01 0.15 0.03 0.9 100", {
                1.0 + 1.25 * 0.25 / 0.24 + 0.15 * 0.25 / 0.22 + 0.9 * 0.25 / (0.25 - 100.0)
            }),
            (4, "1.2 0.1 0.1 0.2 10", 2.2 + 0.1 * 0.25 / 0.24 + 0.2 / (0.25 - 100.0)),
            (6, "1.2 0.01 0 0 0 0 0.3 0.05", 1.0 + 1.2 * 0.25 / 0.24 + 0.3 * 0.25 / 0.2),
            (7, "2.3 0.01 0.05 0.02", 2.3 + 0.01 / 0.2 - 0.005),
            (8, "1.3 0.9 0.05 0.02", 1.3 + 0.9 * 0.25 / 0.2 - 0.005),
            (9, "1.3 0.9 0.05 0.1 0.15", 1.3 + 0.9 * 0.25 / 0.2 + 0.1 * 0.25 / 0.1),
            (10, "2.25 0 0 0 0 0 1e-5 1e-6", 2.25 + 1.024e-2 + 4.096e-3),
            (11, "1.2 0.01 0 0 0 0 0 0 0.3 0.05", 1.0 + 1.2 * 0.25 / 0.24 + 0.3 * 0.25 / 0.2),
            (12, "2.25 0 0 0 0 0 0.16 0.64", 2.25 + 0.01 + 0.01),
            (13, "2.25 0 0.16 0.01 0 0 0 0 1e-6", 2.25 + 0.01 + 0.04 + 4.096e-3),
        ] {
            let n = glass(formula, coefficients).unwrap().glass.index(500.0).unwrap();
            assert!((n - f64::sqrt(squared)).abs() < 1e-12, "{formula}: {n}");
        }
        let n = glass(5, "1.5 0.01 0.001").unwrap().glass.index(500.0).unwrap();
        assert!((n - (1.52 + 0.001 * 11.313_708_498_984_761)).abs() < 1e-12);
        let n = glass(3, "1.5 0.01 0 0.04 0.16 0.64").unwrap().glass.index(500.0).unwrap();
        assert!((n - (1.5 + 0.01 / 0.222 + 0.03)).abs() < 1e-12);
    }

    /// n² = 1 + 1.25 without the zeros at the end.
    #[test]
    fn zeros_at_the_end_may_be_left_out() {
        let found = glass(2, "1.25 0").unwrap();
        assert_eq!(found.glass.index(500.0).unwrap(), 1.5);
    }

    /// A name that stands twice is one glass, or none.
    #[test]
    fn a_name_that_stands_twice_is_refused_with_both_lines_where_the_glasses_differ() {
        let find = |second: &str| {
            let text = format!(
                "NM OWN 2 0 0\nCD 1.25 0 0 0 0 0\nLD 0.35 2\nNM O-wn 2 0 0\n{second}LD 0.35 2\n"
            );
            read("own", &text).find("OWN").unwrap()
        };
        assert_eq!(find("CD 1.25 0\n").unwrap().glass.index(550.0).unwrap(), 1.5);
        let error = find("CD 1.26 0\n").unwrap_err().to_string();
        assert!(error.contains("OWN (line 1) and O-wn (line 4) are different"), "{error}");
        let error = find("").unwrap_err().to_string();
        assert!(error.contains("line 4") && error.contains("no coefficients"), "{error}");
    }

    #[test]
    fn what_is_wrong_is_said_when_the_glass_is_asked_for() {
        for (formula, coefficients, word) in [
            (14, "1 2", "formula 14"),
            (2, "1 2 3 4 5 6 7", "it has 6"),
            (2, "1 x", "CD"),
            (2, "1.25 0.01 0.2", "pairs"),
            (9, "1.3 0.9", "pairs"),
            (2, "", "no coefficients"),
            (2, "0 0", "no coefficients"),
        ] {
            let error = glass(formula, coefficients).unwrap_err().to_string();
            assert!(error.contains(word) && error.contains("line 2"), "{error}");
        }
        assert!(read("x", "nothing").find("OWN").is_none());
        let note = glass(5, "1.6").unwrap().note.unwrap();
        assert!(note.contains("1.60000") && note.contains("1.5168"), "{note}");
    }
}
