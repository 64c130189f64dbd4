//! How the lines of a spectral table are written: separator, decimals, header and unit.

use crate::numbers::counted;
use crate::table_column::{Column, without_wavelength};
use crate::unit::{Base, Unit};
use crate::{Error, Result};

/// Wavelengths in nm and in µm, to tell one unit from the other where nothing says it.
const NM: std::ops::RangeInclusive<f64> = 200.0..=3000.0;
const UM: std::ops::RangeInclusive<f64> = 0.2..=3.0;
/// Wavelengths in nm from hard ultraviolet to far infrared: others are in a unit other than the
/// one stated.
const OPTICAL_NM: std::ops::RangeInclusive<f64> = 10.0..=100_000.0;
/// What the lines around a spectrometer's table begin with: `>>>>>Begin Spectral Data<<<<<`.
const MARK: &str = ">>>";
/// Lines that an instrument may write above its table.
const MAX_HEADER_LINES: usize = 100;

/// The lines of a table that are neither blank nor remarks, with their numbers from 1: those above
/// the line that ends it, if there is one.
pub fn content(text: &str) -> impl Iterator<Item = (usize, &str)> {
    lines(text).take_while(|(_, line)| !is_end(line))
}

/// Describes the lines after the one that ends a table.
fn below_end(text: &str) -> Option<String> {
    let mut rest = lines(text).skip_while(|(_, line)| !is_end(line));
    let (_, end) = rest.next()?;
    let below = rest.count();
    let lines = counted(below, "line");
    (below > 0).then(|| format!("what stands below {end:?}, {lines}, is passed over"))
}

/// Whether a line ends a table, as that of a spectrometer: `>>>>>End Spectral Data<<<<<`.
fn is_end(line: &str) -> bool {
    let words = line.trim_start_matches('>');
    line.starts_with(MARK) && words.get(..3).is_some_and(|end| end.eq_ignore_ascii_case("end"))
}

/// The lines of a text that are neither blank nor remarks, with their numbers from 1.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let lines = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    // `sep=;` is a word of spreadsheets to each other.
    let remark = |line: &str| line.starts_with(['#', '%']) || line.starts_with("sep=");
    lines.filter(move |(_, line)| !line.is_empty() && !remark(line))
}

/// How a table is written.
pub struct Form {
    separator: Separator,
    /// Lines before the numbers.
    pub header_lines: usize,
    /// Names of the columns behind that of wavelengths.
    pub names: Vec<String>,
    /// What the header says of those columns: names, units, remarks; empty without one.
    pub headers: Vec<String>,
    /// A line above the header that ends with per cent in brackets.
    pub percent_above: Option<String>,
    unit: Option<Unit>,
}

/// The separator between the fields of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Separator {
    Character(char),
    Blanks,
}

impl Separator {
    /// In the order in which they are tried: a semicolon or tab is never part of a number.
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
        refuse_other_formats(text)?;
        let Some((_, first)) = content(text).next() else {
            return Err(Error::input("the table has no lines"));
        };
        if let Some(separator) = separator_of(first) {
            let columns = separator.fields(first).len() - 1;
            let names = (1..=columns).map(|n| format!("column {n}")).collect();
            let headers = vec![String::new(); columns];
            let (header_lines, percent_above, unit) = (0, None, None);
            let form = Self { separator, header_lines, names, headers, percent_above, unit };
            return Ok((form, below_end(text).into_iter().collect()));
        }
        let (header_lines, numbers, separator) = first_numbers(text)?;
        let columns = separator.fields(numbers).len() - 1;
        let above: Vec<&str> = content(text).map(|(_, line)| line).take(header_lines).collect();
        let (used, header) = joined(&above, separator, columns);
        let (mut form, mut remarks) =
            Self::with_header(&header, header_lines, separator, columns)?;
        let mut passed = above.iter().take(header_lines - used);
        let percent = passed.find(|line| Column::of(line).unit.as_deref() == Some("%"));
        form.percent_above = percent.map(|line| line.to_string());
        remarks.extend(below_end(text));
        if header_lines > used {
            let passed = header_lines - used;
            remarks.push(format!("its first {passed} lines are passed over, down to {header:?}"));
        }
        Ok((form, remarks))
    }

    fn with_header(
        header: &str,
        header_lines: usize,
        separator: Separator,
        columns: usize,
    ) -> Result<(Self, Vec<String>)> {
        let fields = separator.fields(header);
        let whole = separator == Separator::Blanks || fields.len() != columns + 1;
        let of_wavelength = if whole { header } else { &fields[0] };
        let unit = unit(of_wavelength)?;
        let headers = match fields.len() == columns + 1 {
            true => fields[1..].to_vec(),
            // A line that begins a table, as that of a spectrometer, names no column.
            false if header.starts_with(MARK) => vec![String::new(); columns],
            false => vec![without_wavelength(header).to_string(); columns],
        };
        let bare = |name: &String| Column::of(name).name().to_string();
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
        let percent_above = None;
        Ok((Self { separator, header_lines, names, headers, percent_above, unit }, remarks))
    }

    /// The fields of a line.
    pub fn fields(&self, line: &str) -> Vec<String> {
        self.separator.fields(line)
    }

    /// A field as a finite number.
    pub fn number(&self, field: &str) -> Option<f64> {
        self.separator.number(field)
    }

    /// The wavelengths in nm: by the header's unit, else by the one that makes them light.
    pub fn nm(&self, wavelengths: &[f64], remarks: &mut Vec<String>) -> Result<Vec<f64>> {
        let all = |range: &std::ops::RangeInclusive<f64>| {
            wavelengths.iter().all(|wavelength| range.contains(wavelength))
        };
        let (unit, assumed) = match self.unit {
            Some(unit) => (unit, None),
            None if all(&NM) => (Unit::parse("nm")?, Some("nm")),
            None if all(&UM) => (Unit::parse("µm")?, Some("µm")),
            None => {
                return Err(Error::input("the unit of the wavelengths is not known")
                    .help("name the first column wavelength_nm or wavelength_um"));
            }
        };
        if let Some(name) = assumed {
            let of = match self.header_lines {
                0 => "it has no header",
                _ => "the header names no unit",
            };
            remarks.push(format!("{of}: its first column is taken as wavelength in {name}"));
        }
        let nm: Vec<f64> = wavelengths.iter().map(|wavelength| unit.of(*wavelength)).collect();
        match nm.iter().find(|nm| !OPTICAL_NM.contains(nm)) {
            None => Ok(nm),
            Some(nm) => Err(Error::input(format!("a wavelength of {nm} nm"))
                .help("does the header name the unit of the wavelengths?")),
        }
    }
}

/// What separates the numbers of a line, if it is two numbers or more.
fn separator_of(line: &str) -> Option<Separator> {
    Separator::ALL.into_iter().find(|s| s.splits(line))
}

/// The first line of numbers, how many lines are above it, and what separates them.
fn first_numbers(text: &str) -> Result<(usize, &str, Separator)> {
    let numbers = content(text)
        .take(MAX_HEADER_LINES + 1)
        .enumerate()
        .find_map(|(i, (_, line))| Some((i, line, separator_of(line)?)));
    // A line of numbers with a mistake in it is no header.
    let damaged = |line: &str, separator: Separator, numbers: &str| {
        let fields = separator.fields(line);
        let any = fields.iter().any(|field| separator.number(field).is_some());
        any && fields.len() == separator.fields(numbers).len()
    };
    let wrong = match numbers {
        None => content(text).nth(1),
        Some((count, numbers, separator)) => {
            let mut below = content(text).take(count).skip(1);
            below.find(|(_, line)| damaged(line, separator, numbers))
        }
    };
    if let Some((line, wrong)) = wrong {
        return Err(Error::input(format!("not a table: {wrong:?} is not numbers"))
            .at(format!("line {line}"))
            .help(
                "give a line wavelength_nm,NAME,... and below it a wavelength and a value for \
                 each name in every line; other lines begin with #",
            ));
    }
    numbers.ok_or_else(|| Error::input("the table has no lines below its header"))
}

/// The header among the lines above a table, and of how many lines it is: the last, or two that
/// name each column and its unit.
fn joined(lines: &[&str], separator: Separator, columns: usize) -> (usize, String) {
    let last = lines[lines.len() - 1];
    let fields = separator.fields(last);
    let above = lines.len().checked_sub(2).map(|i| separator.fields(lines[i]));
    match (above, separator) {
        (Some(names), Separator::Character(separator))
            if names.len() == columns + 1 && fields.len() == columns + 1 =>
        {
            let named = names.iter().zip(&fields).map(|(name, unit)| format!("{name} ({unit})"));
            (2, named.collect::<Vec<_>>().join(&separator.to_string()))
        }
        _ => (1, last.to_string()),
    }
}

/// Refuses files that are no table but look like one, or like nothing.
fn refuse_other_formats(text: &str) -> Result<()> {
    let start = text.trim_start();
    let what = if start.starts_with("PK\u{3}\u{4}") {
        "an Excel workbook"
    } else if ["##title=", "##jcamp"]
        .iter()
        .any(|mark| start.get(..mark.len()).is_some_and(|head| head.eq_ignore_ascii_case(mark)))
    {
        "a JCAMP-DX file"
    } else {
        return Ok(());
    };
    Err(Error::unsupported(format!("{what} is no table in text"))
        .help("export it as CSV: wavelength_nm,NAME,... and below it a line per wavelength"))
}

/// The unit that the header of the wavelengths names.
fn unit(header: &str) -> Result<Option<Unit>> {
    let refused = |word: &str| {
        Error::unsupported(format!("a table over {word}"))
            .at("header")
            .help("give wavelengths in nm; those of 1/cm are 1e7 over the wavenumber")
    };
    for word in header.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()) {
        let lower = word.to_lowercase();
        let Ok(unit) = Unit::parse(word) else {
            match &*lower {
                "frequency" | "energy" => return Err(refused(&lower)),
                _ => continue,
            }
        };
        if unit.is(&[(Base::Wavelength, 1)]) {
            return Ok(Some(unit));
        }
        let others = [Base::Wavenumber, Base::Frequency, Base::PhotonEnergy];
        if lower == "cm" || others.iter().any(|base| unit.is(&[(*base, 1)])) {
            return Err(refused(&lower));
        }
    }
    Ok(None)
}
