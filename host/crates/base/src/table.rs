//! Tables over wavelength, one line per wavelength: `wavelength_nm,NAME,NAME...`, lines that start
//! with `#` are remarks.
//!
//! Tables are read as other programs write them: separated by commas, semicolons, tabs or blanks,
//! with a decimal comma where the comma does not separate; with any header or none; in nm, µm or Å;
//! from short to long wavelengths or back; and exports of light meters. What was assumed is in
//! [`SpectralTable::remarks`]. A
//! line `# outside: held` or `# outside: zero` says what the curves are outside their wavelengths.
//!
//! What the values are is read from names of a closed list and from units
//! ([`unit`](mod@crate::unit)); what is not understood is refused. A line `# unit: W/m2/nm` says
//! it in place of the header, and `# column: NAME` which of several columns is meant.

use crate::spectrum::Outside;
use crate::table_column::{Column, Keys};
use crate::table_exports;
use crate::table_form::{Form, content};
use crate::table_marks::Marks;
use crate::table_quantity::Quantity;
pub use crate::table_quantity::Wanted;
use crate::{Error, Result, Spectrum};
use std::borrow::Cow;
use std::path::Path;

/// Negative readings that are taken as 0, as a part of the largest value: the noise of a
/// spectrometer in the dark ends of its range.
const NOISE_FLOOR: f64 = 0.01;

/// Named curves over common wavelengths.
#[derive(Clone, Debug)]
pub struct SpectralTable {
    /// Rising wavelengths, nm.
    pub wavelength_nm: Vec<f64>,
    /// Curve names and values in the order of the file's columns.
    pub curves: Vec<(String, Vec<f64>)>,
    /// What the header says of each curve, in full; [`SpectralTable::convert`] goes by it.
    pub(crate) headers: Vec<String>,
    /// A line above the header that says per cent.
    pub(crate) percent_above: Option<String>,
    /// The unit that the table states in place of its header.
    unit: Option<String>,
    /// Whether the table names the column that is meant.
    is_chosen: bool,
    /// What the file says of wavelengths outside.
    pub outside: Option<Outside>,
    /// What was assumed, for the user.
    pub remarks: Vec<String>,
    /// What remarks call the table.
    name: Option<String>,
}

impl SpectralTable {
    /// Reads a file.
    ///
    /// # Errors
    /// A file that cannot be read, and those of [`SpectralTable::parse`].
    pub fn read(path: &Path) -> Result<Self> {
        Self::read_column(path, None)
    }

    /// Reads a file of which only the column of a name is meant, where one is given.
    ///
    /// # Errors
    /// Those of [`SpectralTable::read`], no column or several of that name.
    pub fn read_column(path: &Path, column: Option<&str>) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|e| Error::io("read", path, e))?;
        let table = Self::parse_column(&text_of(bytes), column);
        Ok(table.map_err(|e| e.at(path.display()))?.named(path.display()))
    }

    /// Parses the text of a file.
    ///
    /// # Errors
    /// A unit that is not one of wavelength, a field that is not a finite number, commas that may
    /// stand between thousands, wavelengths that neither rise nor fall, no lines. The error names
    /// the line.
    pub fn parse(text: &str) -> Result<Self> {
        Self::parse_column(text, None)
    }

    /// Parses the text of a file of which only the column of a name is meant, where one is given.
    pub(crate) fn parse_column(text: &str, column: Option<&str>) -> Result<Self> {
        let text = text.trim_start_matches('\u{feff}');
        let text = &with_line_feeds(text)[..];
        let export = table_exports::table_of(text)?;
        let text = export.as_ref().map_or(text, |export| &export.text);
        let (form, mut remarks) = Form::of(text)?;
        remarks.extend(export.as_ref().and_then(|export| export.remark.clone()));
        let columns = form.names.len();
        let mut wavelength: Vec<f64> = Vec::new();
        let mut curves: Vec<(String, Vec<f64>)> =
            form.names.iter().map(|name| (name.clone(), Vec::new())).collect();
        let (mut lines, mut marks) = (Vec::new(), Marks::default());
        for (line, text) in content(text).skip(form.header_lines) {
            let fields = form.fields(text);
            let place = || format!("line {line}");
            if fields.len() != columns + 1 {
                let found = fields.len();
                return Err(Error::input(format!("not a table: {found} fields"))
                    .at(place())
                    .help(format!("every line has {} numbers, as the first", columns + 1)));
            }
            let number = |column: usize| -> Result<f64> {
                form.number(&fields[column]).ok_or_else(|| {
                    let name = if column == 0 { "wavelength" } else { &form.names[column - 1] };
                    let field = &fields[column];
                    Error::input(format!("{field:?} in column {name} is not a number"))
                        .at(place())
                        .help("lines that are not part of the table begin with #")
                })
            };
            wavelength.push(number(0)?);
            lines.push(line);
            for (column, (_, values)) in curves.iter_mut().enumerate() {
                values.push(number(column + 1)?);
            }
            fields.iter().for_each(|field| marks.see(line, field));
        }
        marks.check()?;
        if wavelength.is_empty() {
            return Err(Error::input("the table has no lines below its header"));
        }
        let falls = wavelength.len() > 1 && wavelength[1] < wavelength[0];
        let wrong = |w: &[f64]| if falls { w[1] >= w[0] } else { w[1] <= w[0] };
        if let Some(i) = wavelength.windows(2).position(wrong) {
            let (before, after) = (wavelength[i], wavelength[i + 1]);
            return Err(Error::input(format!("wavelength {after} follows {before}"))
                .at(format!("line {}", lines[i + 1]))
                .help("wavelengths must rise strictly, or fall strictly"));
        }
        let mut wavelength_nm = form.nm(&wavelength, &mut remarks)?;
        if falls {
            wavelength_nm.reverse();
            curves.iter_mut().for_each(|(_, values)| values.reverse());
        }
        let mut keys = Keys::of(text)?;
        keys.column = column.map(str::to_string).or(keys.column);
        let Form { headers, percent_above, .. } = form;
        let mut table = Self {
            wavelength_nm,
            curves,
            headers,
            percent_above,
            unit: keys.unit,
            is_chosen: keys.column.is_some(),
            outside: outside(keys.outside)?,
            remarks,
            name: None,
        };
        if let Some(name) = keys.column {
            let column = table.only_column(&name)?.ok_or_else(|| {
                let known: Vec<&str> = table.curves.iter().map(|(name, _)| &name[..]).collect();
                Error::input(format!("no column {name:?}"))
                    .help(format!("the table has {}", known.join(", ")))
            })?;
            table.keep(|i| i == column);
        }
        Ok(table)
    }

    /// Drops the columns but those.
    fn keep(&mut self, is_kept: impl Fn(usize) -> bool) {
        let mut kept = (0..self.curves.len()).map(&is_kept);
        self.curves.retain(|_| kept.next().unwrap_or(false));
        let mut kept = (0..self.headers.len()).map(&is_kept);
        self.headers.retain(|_| kept.next().unwrap_or(false));
    }

    /// What the values of the columns are. Columns with names that are not known are left out,
    /// with a remark, where another's is.
    ///
    /// # Errors
    /// Those of [`SpectralTable::convert`].
    pub(crate) fn quantities(&mut self, wanted: Wanted) -> Result<Vec<Quantity>> {
        let of = |header: &String| {
            Quantity::of(&Column::of(header), self.unit.as_deref(), self.is_chosen, wanted)
        };
        let found: Vec<Option<Quantity>> = self.headers.iter().map(of).collect::<Result<_>>()?;
        if found.iter().all(Option::is_none) {
            return Err(Error::input(format!(
                "the header {:?} names no quantity that is known",
                self.headers[0]
            ))
            .help(wanted.help()));
        }
        let unknown = (0..found.len()).filter(|i| found[*i].is_none());
        for header in unknown.map(|i| self.headers[i].clone()).collect::<Vec<_>>() {
            self.remark(format!(
                "its column {header:?} is left out: the header names no quantity that is known"
            ));
        }
        self.keep(|i| found[i].is_some());
        Ok(found.into_iter().flatten().collect())
    }

    /// Converts the columns to what is wanted, and remarks on it.
    ///
    /// # Errors
    /// A column of another quantity, or in a unit that is not understood; names of which none is
    /// known.
    pub fn convert(&mut self, wanted: Wanted) -> Result<()> {
        let quantities = self.quantities(wanted)?;
        self.convert_each(&quantities, wanted);
        Ok(())
    }

    pub(crate) fn convert_each(&mut self, quantities: &[Quantity], wanted: Wanted) {
        for ((_, values), quantity) in self.curves.iter_mut().zip(quantities) {
            for (value, nm) in values.iter_mut().zip(&self.wavelength_nm) {
                *value = quantity.convert(*value, *nm);
            }
        }
        let alike = quantities.windows(2).all(|pair| pair[0] == pair[1]);
        for (column, quantity) in
            quantities.iter().enumerate().take(if alike { 1 } else { usize::MAX })
        {
            let name = &self.curves[column].0;
            let values = if alike { "its values".into() } else { format!("those of {name:?}") };
            if let Some(told) = quantity.told(wanted) {
                self.remark(format!("{values} {told}"));
            }
        }
    }

    /// The table with the name that remarks call it by.
    #[must_use]
    pub fn named(mut self, name: impl std::fmt::Display) -> Self {
        self.remarks.iter_mut().for_each(|remark| *remark = format!("{name}: {remark}"));
        self.name = Some(name.to_string());
        self
    }

    /// Adds what else was assumed of the table.
    pub fn remark(&mut self, text: impl std::fmt::Display) {
        self.remarks.push(match &self.name {
            Some(name) => format!("{name}: {text}"),
            None => text.to_string(),
        });
    }

    /// Takes negative values within the noise of a spectrometer as 0, and remarks on it. Larger
    /// ones stay.
    pub fn clip_noise(&mut self) {
        let (mut count, mut least) = (0, 0.0f64);
        for (_, values) in &mut self.curves {
            let largest = values.iter().fold(0.0f64, |m, &v| m.max(v));
            let noise = -NOISE_FLOOR * largest..0.0;
            for value in values.iter_mut().filter(|value| noise.contains(*value)) {
                (count, least) = (count + 1, least.min(*value));
                *value = 0.0;
            }
        }
        if count > 0 {
            self.remark(format!(
                "{count} slightly negative values, down to {least}, are taken as 0"
            ));
        }
    }

    /// The curve of one column, counted from 0 without the wavelengths.
    ///
    /// # Errors
    /// Those of [`Spectrum::new`], which a table that was read has not.
    pub fn spectrum(&self, column: usize) -> Result<Spectrum> {
        let curve = Spectrum::new(self.wavelength_nm.clone(), self.curves[column].1.clone())?;
        Ok(curve.remarked(&self.remarks).outside(self.outside.unwrap_or_default()))
    }

    /// The column of that name (any letter case).
    pub fn column(&self, name: &str) -> Option<usize> {
        self.columns(name).next()
    }

    /// The column of that name, where only one may have it.
    ///
    /// # Errors
    /// Two columns of that name.
    pub fn only_column(&self, name: &str) -> Result<Option<usize>> {
        let mut columns = self.columns(name);
        let (Some(one), Some(other)) = (columns.next(), columns.next()) else {
            return Ok(self.column(name));
        };
        // Wavelengths are the first column of the file.
        let told = |i: usize| format!("{} ({:?})", i + 2, self.headers[i]);
        let (one, other) = (told(one), told(other));
        Err(Error::input(format!("columns {one} and {other} are both named {name:?}"))
            .help("leave out or rename all of them but the one that is meant"))
    }

    fn columns(&self, name: &str) -> impl Iterator<Item = usize> {
        let named = |i: &usize| self.curves[*i].0.eq_ignore_ascii_case(name);
        (0..self.curves.len()).filter(named)
    }
}

/// What the line `# outside: ...` of a table says, with the line's number.
fn outside(said: Option<(usize, String)>) -> Result<Option<Outside>> {
    let Some((line, said)) = said else { return Ok(None) };
    match &said[..] {
        "held" => Ok(Some(Outside::Held)),
        "zero" => Ok(Some(Outside::Zero)),
        _ => Err(Error::input(format!("outside: {said:?}"))
            .at(format!("line {line}"))
            .help("the values outside the table are `held` or `zero`")),
    }
}

/// The text of a table's file: UTF-8, UTF-16 with its mark (a spreadsheet's "Unicode text"), else
/// Latin-1, for units such as µm in the encodings of old programs.
pub fn text_of(bytes: Vec<u8>) -> String {
    let words = |from: fn([u8; 2]) -> u16| {
        let pairs = bytes[2..].chunks_exact(2).map(|pair| from([pair[0], pair[1]]));
        String::from_utf16_lossy(&pairs.collect::<Vec<u16>>())
    };
    match bytes[..] {
        [0xff, 0xfe, ..] => words(u16::from_le_bytes),
        [0xfe, 0xff, ..] => words(u16::from_be_bytes),
        _ => String::from_utf8(bytes)
            .unwrap_or_else(|e| e.into_bytes().iter().map(|&byte| char::from(byte)).collect()),
    }
}

/// The text with lines that end with LF or CR LF: a CR alone, as of old Macs, becomes LF, and CR
/// CR LF, as in a file that was converted twice, CR LF.
pub fn with_line_feeds(text: &str) -> Cow<'_, str> {
    if !text.contains('\r') {
        return text.into();
    }
    let lines = text.replace("\r\r\n", "\r\n");
    let lines: Vec<String> = lines.split("\r\n").map(|line| line.replace('\r', "\n")).collect();
    lines.join("\r\n").into()
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
            ("wavelength_nm,power\n400,1\n390,2\n395,1\n", "line 4"),
            ("wavelength_nm,power\n400,1\n400,2\n", "line 3"),
            ("# remark\nwavelength_nm,power\n400,1\n410,x\n", "line 4"),
            ("wavelength_nm,power\n400,1\n410\n", "line 3"),
            ("wavelength_nm,power\n400,inf\n", "line 2"),
            ("wavelength_nm,power\n4OO,1\n410,2\n", "line 2"),
            ("wavenumber,power\n25000,1\n", "wavenumber"),
            ("x,y\n1,2\n5,2\n", "unit"),
            ("wavelength_um,y\n380,2\n780,2\n", "380000 nm"),
            ("##TITLE=filter\n##XYDATA=(X++(Y..Y))\n400 1 2\n", "JCAMP-DX"),
            ("PK\u{3}\u{4}....", "Excel"),
            ("wavelength_nm,power\n", "no lines"),
            ("", "no lines"),
        ] {
            let message = SpectralTable::parse(text).unwrap_err().to_string();
            assert!(message.contains(expected), "{text:?} gives {message}");
        }
    }

    #[test]
    fn a_table_says_what_is_outside_it() {
        let table = |remark: &str| SpectralTable::parse(&format!("{remark}\n400,1\n410,2\n"));
        assert_eq!(table("# a remark").unwrap().outside, None);
        assert_eq!(table("# outside: zero").unwrap().spectrum(0).unwrap().at(411.0), 0.0);
        assert_eq!(table("# outside: held").unwrap().spectrum(0).unwrap().at(411.0), 2.0);
        assert!(table("# outside: nil").unwrap_err().to_string().contains("line 1"));
    }

    /// The same table as different programs write it.
    #[test]
    fn tables_of_other_programs_are_read() {
        for text in [
            "wavelength_nm,power\n400,0.5\n410.5,0.25\n",
            "\u{feff}Wavelength (nm),Power\r\n400,0.5\r\n410.5,0.25\r\n",
            "400,0.5\n410.5,0.25\n",
            "400.0 0.5\n410.5   0.25\n",
            "Wavelength [nm]\tIrradiance (W/m2/nm)\n400\t0,5\n410,5\t0,25\n",
            "lambda;power\n400;0,5\n410,5;0,25\n",
            "400,0 0,5\n410,5 0,25\n",
            "\"Wavelength, nm\",\"Power\"\n400,0.5\n410.5,0.25\n",
            "wavelength_um,power\n0.4,0.5\n0.4105,0.25\n",
            "Wavelength (µm) Power\n0.4 0.5\n0.4105 0.25\n",
            "angstrom,power\n4000,0.5\n4105,0.25\n",
            "nm,power,\n410.5,0.25,\n400,0.5,\n",
            "wavelength_nm,power\r400,0.5\r410.5,0.25\r",
            "sep=;\nnm;power\n400;0,5\n410,5;0,25\n",
            "Wavelength,Power\nnm,W/m2\n400,0.5\n410.5,0.25\n",
            "Spectrometer 1\nDate: today\n>>>Begin Spectral Data<<<\n400 0.5\n410.5 0.25\n",
            "wavelength, power\n0.4, 5e-1\n0.4105, 0.25\n",
            ">>>>>Begin Spectral Data<<<<<\n400 0.5\n410.5 0.25\n>>>>>End Spectral Data<<<<<\n",
            "400 0.5\n410.5 0.25\n>>>>>End Processed Spectral Data<<<<<\n\n",
        ] {
            let table = SpectralTable::parse(text).unwrap_or_else(|e| panic!("{text:?}: {e}"));
            assert_eq!(table.wavelength_nm.len(), 2, "{text:?}");
            for (got, expected) in table.wavelength_nm.iter().zip([400.0, 410.5]) {
                assert!((got - expected).abs() < 1e-9, "{text:?}: {got}");
            }
            assert_eq!(table.curves[0].1, [0.5, 0.25], "{text:?}");
        }
        let assumed = SpectralTable::parse("0.4 1\n0.5 2\n").unwrap().remarks;
        assert!(assumed[0].contains("no header") && assumed[0].contains("µm"), "{assumed:?}");
        let two = "Wavelength,r,g\nnm,%,A/W\n400,50,0.1\n";
        let two = SpectralTable::parse(two).unwrap();
        assert_eq!(two.headers, ["r (%)", "g (A/W)"]);
        assert!(two.column("g") == Some(1) && two.remarks.is_empty(), "{two:?}");
        let table = SpectralTable::parse("nm,r (%),g (%)\n400,50,60\n").unwrap();
        assert_eq!((&table.headers[1][..], table.column("g")), ("g (%)", Some(1)));
    }

    #[test]
    fn a_name_that_two_columns_have_is_refused() {
        let text = "wavelength_nm,r (min),R (typ),g\n400,0.1,0.2,0.3\n";
        let table = SpectralTable::parse(text).unwrap();
        let error = table.only_column("r").unwrap_err().to_string();
        assert!(error.contains("columns 2 (\"r (min)\") and 3 (\"R (typ)\")"), "{error}");
        assert_eq!(table.only_column("g").unwrap(), Some(2));
        assert_eq!(table.only_column("b").unwrap(), None);
    }

    #[test]
    fn what_stands_below_the_end_of_a_table_is_told() {
        let text = "nm,power\n400,1\n410,2\n>>>>>End Spectral Data<<<<<\n400,3\n410,4\n";
        let table = SpectralTable::parse(text).unwrap();
        assert_eq!(table.curves[0].1, [1.0, 2.0]);
        assert!(table.remarks[0].contains("2 lines, is passed over"), "{:?}", table.remarks);
        let none = SpectralTable::parse("nm,power\n>>>End<<<\n400,3\n").unwrap_err().to_string();
        assert!(none.contains("no lines below its header"), "{none}");
    }

    #[test]
    fn texts_of_any_encoding_are_read() {
        let words: Vec<u8> = "\u{feff}nm µ".encode_utf16().flat_map(u16::to_le_bytes).collect();
        assert_eq!(text_of(words), "nm µ");
        assert_eq!(text_of(b"\xb5m,1".to_vec()), "µm,1");
        assert_eq!(text_of("µm,1".into()), "µm,1");
        assert_eq!(text_of(vec![0xff, 0xfe, 0x41]), "");
    }

    #[test]
    fn noise_below_zero_is_taken_as_zero_and_more_is_not() {
        let text = "wavelength_nm,power\n380,-0.002\n400,1\n410,-0.5\n";
        let mut table = SpectralTable::parse(text).unwrap();
        table.clip_noise();
        assert_eq!(table.curves[0].1, [0.0, 1.0, -0.5]);
        assert!(table.remarks[0].contains("1 slightly negative"), "{:?}", table.remarks);
    }

    /// No text makes the parser panic.
    #[test]
    fn damage_is_survived() {
        let text = "\u{feff}Wavelength (nm);\"QE, %\"\r\n400;0,5\r\n410,5;-0,25\r\n";
        for (i, _) in text.char_indices() {
            for piece in ["", ",", ";", "\t", "\"", "\n", "µ", "(", "1e999", "-", "#", "İ-1"] {
                let damaged = format!("{}{piece}{}", &text[..i], &text[i..]);
                for text in [&damaged[..], &text[..i], &text[i..]] {
                    if let Ok(mut table) = SpectralTable::parse(text) {
                        table.clip_noise();
                        let _ = (table.spectrum(0), table.convert(Wanted::Power));
                    }
                }
            }
        }
    }
}
