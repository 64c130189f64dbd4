//! Glasses that a `.seq` file defines itself: `PRV`, wavelengths (`PWL`), a row of indices for
//! each glass, or `LAU` and the coefficients of its Laurent series, `END`.
//!
//! The series is Schott's ([`Dispersion::schott`]) with λ in µm: a file of CODE V 11.1 gives
//! NOA61 by it, and its coefficients are those of the square of the maker's (Norland)
//! n = 1.5375 + 0.00829045/λ² − 0.000211046/λ⁴. The order of other forms is not known.

use super::lexer::Word;
use super::{first, numbers};
use camrig_base::{Error, Result};
use camrig_glass::{Catalogue, Dispersion, Glass};

/// The private glasses of a file.
#[derive(Default)]
pub(super) struct Private {
    open: bool,
    waves_nm: Vec<f64>,
    glasses: Vec<(String, Glass)>,
}

impl Private {
    /// Takes a command if it belongs to the catalogue; whether it does.
    ///
    /// # Errors
    /// A row of another length than its wavelengths; what is no table of indices.
    pub(super) fn takes(&mut self, keyword: &str, words: &[Word]) -> Result<bool> {
        match keyword {
            "PRV" => self.open = true,
            _ if !self.open => return Ok(false),
            "END" => self.open = false,
            "PWL" => {
                first(words, keyword)?;
                self.waves_nm = numbers(keyword, words)?;
            }
            name => {
                let glass = self.glass(name, words).map_err(|e| e.at(format!("glass {name}")))?;
                self.glasses.push((name.to_owned(), glass));
            }
        }
        Ok(true)
    }

    fn glass(&self, name: &str, words: &[Word]) -> Result<Glass> {
        if let Some((form, rest)) = words.split_first()
            && form.text.eq_ignore_ascii_case("LAU")
        {
            return laurent(name, &numbers("LAU", rest)?);
        }
        if let Some(word) = words.iter().find(|w| w.text.parse::<f64>().is_err()) {
            return Err(Error::unsupported(format!("private glass by \"{}\"", word.text))
                .help("tables of indices (PWL) and Laurent series (LAU) are read: give a table"));
        }
        let indices = numbers(name, words)?;
        if indices.len() != self.waves_nm.len() {
            return Err(Error::input(format!(
                "{} indices for {} wavelengths",
                indices.len(),
                self.waves_nm.len()
            ))
            .help("a private glass has one index for each wavelength of PWL"));
        }
        let waves = self.waves_nm.iter().copied();
        let mut rows: Vec<[f64; 2]> = waves.zip(indices).map(|(nm, n)| [nm, n]).collect();
        rows.sort_by(|a, b| a[0].total_cmp(&b[0]));
        Glass::table(name, rows)
    }

    /// `glasses` and these, which count first.
    ///
    /// # Errors
    /// A catalogue without its `END`.
    pub(super) fn catalogue(&self, glasses: &Catalogue) -> Result<Catalogue> {
        if self.open {
            return Err(
                Error::input("PRV without END").help("is the private catalogue cut short?")
            );
        }
        let mut glasses = glasses.clone();
        for (name, glass) in &self.glasses {
            glasses.insert(name, glass.clone());
        }
        Ok(glasses)
    }
}

/// A glass by its Laurent series. The file does not say for which wavelengths it holds.
fn laurent(name: &str, coefficients: &[f64]) -> Result<Glass> {
    let Ok(coefficients) = <[f64; 6]>::try_from(coefficients) else {
        return Err(Error::input(format!("LAU with {} coefficients", coefficients.len()))
            .help("a Laurent series has six, those of λ to 0, 2, -2, -4, -6 and -8"));
    };
    let dispersion = Dispersion::schott(coefficients);
    Ok(Glass { name: name.into(), dispersion, ..Glass::constant(1.0)? })
}
