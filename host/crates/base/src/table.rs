//! Tables over wavelength in CSV: `wavelength_nm,NAME,NAME...`, lines that start with `#` are
//! remarks.

use crate::{Error, Result, Spectrum};
use std::path::Path;

/// Named curves over common wavelengths.
#[derive(Clone, Debug)]
pub struct SpectralTable {
    /// Rising wavelengths, nm.
    pub wavelength_nm: Vec<f64>,
    /// Curve names and values in the order of the file's columns.
    pub curves: Vec<(String, Vec<f64>)>,
}

impl SpectralTable {
    /// Reads a file.
    ///
    /// # Errors
    /// A file that cannot be read, and those of [`SpectralTable::parse`].
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::io("read", path, e))?;
        Self::parse(&text).map_err(|e| e.at(path.display()))
    }

    /// Parses the text of a file.
    ///
    /// # Errors
    /// Another header, a field that is not a finite number, wavelengths that do not rise, no
    /// lines. The error names the line.
    pub fn parse(text: &str) -> Result<Self> {
        let mut reader = csv::ReaderBuilder::new()
            .comment(Some(b'#'))
            .trim(csv::Trim::All)
            .from_reader(text.as_bytes());
        let malformed = |e: csv::Error| {
            let line = e.position().map_or(1, csv::Position::line);
            Error::input(format!("not a table: {e}")).at(format!("line {line}")).help(
                "give a CSV with a header line wavelength_nm,NAME,... and as many numbers in \
                 every line as the header has names",
            )
        };
        let header = reader.headers().map_err(malformed)?.clone();
        if header.get(0) != Some("wavelength_nm") || header.len() < 2 {
            return Err(Error::input(format!(
                "the first column is {:?}, of {} columns",
                header.get(0).unwrap_or(""),
                header.len()
            ))
            .at("header")
            .help("the header must be wavelength_nm,NAME[,NAME...]"));
        }
        let mut wavelength_nm: Vec<f64> = Vec::new();
        let mut curves: Vec<(String, Vec<f64>)> =
            header.iter().skip(1).map(|name| (name.to_string(), Vec::new())).collect();
        for record in reader.records() {
            let record = record.map_err(malformed)?;
            let line = record.position().map_or(0, csv::Position::line);
            let number = |column: usize| -> Result<f64> {
                let field = &record[column];
                field.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| {
                    Error::input(format!(
                        "{field:?} in column {} is not a number",
                        &header[column]
                    ))
                    .at(format!("line {line}"))
                })
            };
            let nm = number(0)?;
            if let Some(&previous) = wavelength_nm.last()
                && nm <= previous
            {
                return Err(Error::input(format!("wavelength {nm} nm follows {previous} nm"))
                    .at(format!("line {line}"))
                    .help("wavelengths must rise strictly"));
            }
            wavelength_nm.push(nm);
            for (column, (_, values)) in curves.iter_mut().enumerate() {
                values.push(number(column + 1)?);
            }
        }
        if wavelength_nm.is_empty() {
            return Err(Error::input("the table has no lines below its header"));
        }
        Ok(Self { wavelength_nm, curves })
    }

    /// The curve of one column, counted from 0 without the wavelengths.
    ///
    /// # Errors
    /// Those of [`Spectrum::new`], which a table that was read has not.
    pub fn spectrum(&self, column: usize) -> Result<Spectrum> {
        Spectrum::new(self.wavelength_nm.clone(), self.curves[column].1.clone())
    }

    /// The column of that name (any letter case).
    pub fn column(&self, name: &str) -> Option<usize> {
        self.curves.iter().position(|(n, _)| n.eq_ignore_ascii_case(name))
    }
}

/// A table compiled into the program; its content is fixed, so a fault in it is a fault of the
/// build that the tests of this module's users catch.
pub fn built_in(text: &'static str) -> SpectralTable {
    SpectralTable::parse(text).expect("tables of the program are checked by its tests")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_name_the_line() {
        for (text, expected) in [
            ("wavelength_nm,power\n400,1\n390,2\n", "line 3"),
            ("# remark\nwavelength_nm,power\n400,1\n410,x\n", "line 4"),
            ("wavelength_nm,power\n400,1\n410\n", "line 3"),
            ("wavelength_nm,power\n400,inf\n", "line 2"),
            ("nm,power\n400,1\n", "header"),
            ("wavelength_nm,power\n", "no lines"),
        ] {
            let message = SpectralTable::parse(text).unwrap_err().to_string();
            assert!(message.contains(expected), "{text:?} gives {message}");
        }
    }
}
