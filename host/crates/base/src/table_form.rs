//! How the lines of a spectral table are written: separator, decimals, header and unit.

use crate::{Error, Result};

/// Wavelengths in nm and in µm, to tell one unit from the other where nothing says it.
const NM: std::ops::RangeInclusive<f64> = 200.0..=3000.0;
const UM: std::ops::RangeInclusive<f64> = 0.2..=3.0;

/// The lines of a text that are neither blank nor remarks, with their numbers from 1.
pub fn content(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let lines = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    lines.filter(|(_, line)| !line.is_empty() && !line.starts_with(['#', '%']))
}

/// How a table is written.
pub struct Form {
    separator: Separator,
    /// Whether its first line is a header.
    pub header: bool,
    /// Names of the columns behind that of wavelengths.
    pub names: Vec<String>,
    /// Whether the header says that values are per cent.
    pub percent: bool,
    unit: Option<Unit>,
}

/// What stands between the fields of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Separator {
    Character(char),
    Blanks,
}

/// Unit of wavelength.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unit {
    Nm,
    Um,
    Angstrom,
}

impl Unit {
    /// A wavelength of this unit in nm.
    pub fn nm(self, wavelength: f64) -> f64 {
        match self {
            Unit::Nm => wavelength,
            Unit::Um => wavelength * 1000.0,
            Unit::Angstrom => wavelength / 10.0,
        }
    }
}

impl Separator {
    /// Those that are tried, most telling first: a semicolon or tab never stands in a number.
    const ALL: [Separator; 4] = [
        Separator::Character(';'),
        Separator::Character('\t'),
        Separator::Character(','),
        Separator::Blanks,
    ];

    /// The fields of a line without quotes; empty ones at its end are dropped.
    fn fields(self, line: &str) -> Vec<String> {
        let mut fields: Vec<String> = match self {
            Separator::Blanks => line.split_whitespace().map(str::to_string).collect(),
            Separator::Character(separator) => {
                let mut reader = csv::ReaderBuilder::new()
                    .delimiter(separator as u8)
                    .has_headers(false)
                    .flexible(true)
                    .trim(csv::Trim::All)
                    .from_reader(line.as_bytes());
                let record = reader.records().next().and_then(|record| record.ok());
                record.iter().flatten().map(str::to_string).collect()
            }
        };
        while fields.last().is_some_and(String::is_empty) {
            fields.pop();
        }
        fields
    }

    fn number(self, field: &str) -> Option<f64> {
        let decimal_comma = self != Separator::Character(',');
        let number = match decimal_comma && !field.contains('.') {
            true => field.replacen(',', ".", 1).parse(),
            false => field.parse(),
        };
        number.ok().filter(|v: &f64| v.is_finite())
    }

    /// Whether a line is two numbers or more.
    fn splits(self, line: &str) -> bool {
        let fields = self.fields(line);
        fields.len() >= 2 && fields.iter().all(|field| self.number(field).is_some())
    }
}

impl Form {
    /// The form of a table, and what is assumed of it.
    pub fn of(text: &str) -> Result<(Self, Vec<String>)> {
        let mut lines = content(text);
        let Some((_, first)) = lines.next() else {
            return Err(Error::input("the table has no lines"));
        };
        if let Some(separator) = Separator::ALL.into_iter().find(|s| s.splits(first)) {
            let columns = separator.fields(first).len() - 1;
            let names = (1..=columns).map(|n| format!("column {n}")).collect();
            return Ok((
                Self { separator, header: false, names, percent: false, unit: None },
                vec![],
            ));
        }
        let Some((line, second)) = lines.next() else {
            return Err(Error::input("the table has no lines below its header"));
        };
        let Some(separator) = Separator::ALL.into_iter().find(|s| s.splits(second)) else {
            return Err(Error::input(format!("not a table: {second:?} is not numbers"))
                .at(format!("line {line}"))
                .help(
                    "give a line wavelength_nm,NAME,... and below it a wavelength and a value for \
                     each name in every line; other lines begin with #",
                ));
        };
        Self::with_header(first, separator, separator.fields(second).len() - 1)
    }

    fn with_header(
        header: &str,
        separator: Separator,
        columns: usize,
    ) -> Result<(Self, Vec<String>)> {
        let fields = separator.fields(header);
        let whole = separator == Separator::Blanks || fields.len() != columns + 1;
        let of_wavelength = if whole { header } else { &fields[0] };
        let unit = unit(of_wavelength)?;
        let percent = header.contains('%') || header.to_lowercase().contains("percent");
        // Without a unit or a remark in brackets.
        let bare = |name: &String| {
            let end = name.find(['(', '[']).unwrap_or(name.len());
            name[..end].trim_end_matches('%').trim().to_string()
        };
        let mut remarks = Vec::new();
        let names: Vec<String> = if fields.len() == columns + 1 {
            fields.iter().skip(1).map(bare).collect()
        } else if columns == 1 {
            vec!["value".into()]
        } else {
            return Err(Error::input(format!(
                "{} names in the header, {} numbers below it",
                fields.len(),
                columns + 1
            ))
            .at("header")
            .help("give each column a name: wavelength_nm,NAME,..."));
        };
        let words = of_wavelength.to_lowercase();
        let known = ["wave", "lambda", "λ", "wl", "nm"].iter().any(|word| words.contains(word));
        if unit.is_none() && !known {
            remarks.push(format!("its first column, {of_wavelength:?}, is taken as wavelength"));
        }
        Ok((Self { separator, header: true, names, percent, unit }, remarks))
    }

    /// The fields of a line.
    pub fn fields(&self, line: &str) -> Vec<String> {
        self.separator.fields(line)
    }

    /// A field as a finite number.
    pub fn number(&self, field: &str) -> Option<f64> {
        self.separator.number(field)
    }

    /// The unit of these wavelengths: the header's, else the one that makes them light.
    pub fn unit(&self, wavelengths: &[f64], remarks: &mut Vec<String>) -> Result<Unit> {
        if let Some(unit) = self.unit {
            return Ok(unit);
        }
        let all = |range: &std::ops::RangeInclusive<f64>| {
            wavelengths.iter().all(|wavelength| range.contains(wavelength))
        };
        let (unit, name) = if all(&NM) {
            (Unit::Nm, "nm")
        } else if all(&UM) {
            (Unit::Um, "µm")
        } else {
            return Err(Error::input("the unit of the wavelengths is not known"))
                .map_err(|e| e.help("name the first column wavelength_nm or wavelength_um"));
        };
        let of = if self.header { "the header names no unit" } else { "it has no header" };
        remarks.push(format!("{of}: its first column is taken as wavelength in {name}"));
        Ok(unit)
    }
}

/// The unit that the header of the wavelengths names.
fn unit(header: &str) -> Result<Option<Unit>> {
    let header = header.to_lowercase();
    let words = || header.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty());
    for word in words() {
        match word {
            "nm" => return Ok(Some(Unit::Nm)),
            "um" | "µm" | "μm" => return Ok(Some(Unit::Um)),
            "å" | "angstrom" | "angstroms" | "ångström" => return Ok(Some(Unit::Angstrom)),
            "wavenumber" | "cm" | "thz" | "ghz" | "hz" | "ev" | "frequency" | "energy" => {
                return Err(Error::unsupported(format!("a table over {word}"))
                    .at("header")
                    .help("give wavelengths in nm; those of 1/cm are 1e7 over the wavenumber"));
            }
            _ if word.starts_with("nanomet") => return Ok(Some(Unit::Nm)),
            _ if word.starts_with("micro") => return Ok(Some(Unit::Um)),
            _ => {}
        }
    }
    Ok(None)
}
