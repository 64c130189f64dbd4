//! Zemax OpticStudio text listings: Huygens and FFT PSF, grid distortion, relative illumination;
//! and bare grids of numbers (CODE V PSFs, CSV).

use super::decimals::with_points;
use super::{rows_of_numbers, words};
use camrig_base::{Error, Result};
use camrig_glass::text::number;

/// A PSF as a file stores it.
#[derive(Clone, Debug, PartialEq)]
pub struct PsfListing {
    /// Wavelength, nm, where the file states it.
    pub wavelength_nm: Option<f64>,
    /// Field as printed, x and y, where the file states it.
    pub field: Option<[f64; 2]>,
    /// Whether the field is a length, not an angle.
    pub field_is_length: bool,
    /// Where the chief ray meets the image, x and y in the lens's own unit, where the file states
    /// it.
    pub image: Option<[f64; 2]>,
    /// Distance between samples, µm, where the file states it.
    pub spacing_um: Option<f64>,
    /// Rows and columns.
    pub shape: [usize; 2],
    /// Row and column (from 0) of the chief ray.
    pub centre: [usize; 2],
    /// Samples, row-major, in the file's order and normalisation.
    pub data: Vec<f64>,
}

/// Reads a PSF: a Zemax listing, or a bare grid of numbers with the chief ray at row and column
/// N/2 + 1 (as CODE V writes it).
///
/// # Errors
/// A listing that is cut short, of several wavelengths or of a field off both axes; values that are
/// negative or no numbers; with the line.
pub fn psf(text: &str) -> Result<PsfListing> {
    let text = with_points(text);
    let header = text.lines().take(3).any(|l| l.contains("Listing of") || l.contains("PSF Data"));
    if header { zemax_psf(&text)?.turned_to_y() } else { bare_psf(&text) }
}

fn bare_psf(text: &str) -> Result<PsfListing> {
    let rows = rows_of_numbers(text)?;
    let shape = [rows.len(), rows[0].len()];
    if shape[0] != shape[1] {
        return Err(Error::input(format!("a PSF of {} rows and {} columns", shape[0], shape[1]))
            .help("PSFs are square; is the file cut short?"));
    }
    if let Some(row) = rows.iter().position(|r| r.iter().any(|v| *v < 0.0)) {
        return Err(negative().at(format!("row {}", row + 1)));
    }
    Ok(PsfListing::bare(shape, rows.concat()))
}

fn negative() -> Error {
    Error::input("a negative PSF value")
        .help("PSFs are intensities; export the PSF itself, not an amplitude or a logarithm")
}

/// What follows a label on its line; blanks in and around the label, and its capitals, do not
/// matter.
fn labelled<'a>(line: &'a str, label: &str) -> Option<&'a str> {
    let mut rest = line;
    for wanted in label.chars().filter(|c| !c.is_whitespace()) {
        let mut left = rest.trim_start().chars();
        if !left.next()?.eq_ignore_ascii_case(&wanted) {
            return None;
        }
        rest = left.as_str();
    }
    Some(rest)
}

/// The lines of a PSF listing in front of its values.
#[derive(Default)]
struct Header {
    wavelength_nm: Option<f64>,
    field: Option<[f64; 2]>,
    field_is_length: bool,
    image: Option<[f64; 2]>,
    spacing_um: Option<f64>,
    shape: Option<[usize; 2]>,
    centre: Option<[usize; 2]>,
}

impl Header {
    fn line(&mut self, line: &str) -> Result<()> {
        if let Some(rest) = labelled(line, "Data spacing is") {
            self.spacing_um = Some(length_um(rest)?);
        } else if let Some(rest) = labelled(line, "Image grid size:") {
            self.shape = Some(two(rest, "by")?);
        } else if let Some(rest) = labelled(line, "Center point is:") {
            self.centre = Some(two(rest, ",")?);
        } else if let Some(rest) = labelled(line, "Center coordinates:") {
            // Their signs tell which way is up.
            let words = words(rest);
            let read = |i: usize| number("image position", words.get(i).copied().unwrap_or(""));
            self.image = Some([read(0)?, read(1)?]);
        } else if ["µm at ", "μm at ", "um at "].iter().any(|words| line.contains(words)) {
            self.wavelength_and_field(line)?;
        }
        Ok(())
    }

    /// `0.5500 µm at -27.38 deg.`; FFT: `0.4500 to 0.4500 µm at 4.0000, 0.0000 mm.`
    fn wavelength_and_field(&mut self, line: &str) -> Result<()> {
        let words: Vec<&str> = line.split([' ', ',']).filter(|w| !w.is_empty()).collect();
        let first = number("wavelength", words[0])?;
        if words.get(1) == Some(&"to") {
            let last = number("wavelength", words.get(2).copied().unwrap_or(""))?;
            if last != first {
                return Err(Error::input(format!("a PSF of {first} to {last} µm"))
                    .help("export one PSF for each wavelength"));
            }
        }
        self.wavelength_nm = Some(first * 1e3);
        let after: Vec<&str> = words.into_iter().skip_while(|w| *w != "at").skip(1).collect();
        let field: Vec<f64> = after.iter().map_while(|w| w.parse().ok()).collect();
        let unit = after.get(field.len()).map_or("", |unit| unit.trim_matches(['(', ')', '.']));
        self.field_is_length = match unit {
            "mm" => true,
            "" | "deg" | "degrees" | "°" => false,
            _ => {
                return Err(Error::unsupported(format!("a field in {unit}"))
                    .help("fields are given in degrees or mm: choose lens units of mm"));
            }
        };
        self.field = match field[..] {
            [y] => Some([0.0, y]),
            [x, y, ..] => Some([x, y]),
            [] => None,
        };
        Ok(())
    }
}

fn zemax_psf(text: &str) -> Result<PsfListing> {
    let mut header = Header::default();
    let mut rows: Vec<(usize, Vec<f64>)> = Vec::new();
    let mut values_follow = false;
    for (i, raw) in text.lines().enumerate() {
        let line = raw.trim();
        let at = |e: Error| e.at(format!("line {}", i + 1));
        if values_follow {
            let words = words(line);
            if words.is_empty() {
                continue;
            }
            let row: Result<Vec<f64>> = words.iter().map(|w| number("PSF value", w)).collect();
            let row = row.map_err(at)?;
            if row.iter().any(|v| *v < 0.0) {
                return Err(at(negative()));
            }
            rows.push((i + 1, row));
        } else if labelled(line, "Values are").is_some() {
            values_follow = true;
        } else {
            header.line(line).map_err(at)?;
        }
    }
    header.listing(rows)
}

impl Header {
    /// The listing with these rows of values and their lines.
    fn listing(self, rows: Vec<(usize, Vec<f64>)>) -> Result<PsfListing> {
        let columns = rows.first().map_or(0, |(_, r)| r.len());
        // FFT listings give no grid size; theirs are square.
        let shape = self.shape.unwrap_or([columns, columns]);
        if columns == 0 || shape[0] == 0 {
            return Err(Error::input(
                "the listing has no line \"Values are ...\" with values behind it",
            )
            .help("export it again as text in English, with its header"));
        }
        if let Some((line, row)) = rows.iter().find(|(_, r)| r.len() != shape[1]) {
            return Err(Error::input(format!("{} values instead of {}", row.len(), shape[1]))
                .at(format!("line {line}"))
                .help("the export is cut short or damaged; export it again"));
        }
        if rows.len() != shape[0] {
            return Err(Error::input(format!(
                "{} rows of values instead of {}",
                rows.len(),
                shape[0]
            ))
            .at(format!("line {}", rows.last().map_or(0, |(line, _)| *line)))
            .help("the export is cut short; export it again"));
        }
        let centre = self.centre.unwrap_or([shape[0] / 2 + 1, shape[1] / 2 + 1]);
        if centre.iter().zip(shape).any(|(c, n)| *c < 1 || *c > n) {
            return Err(Error::input(format!(
                "the centre point {centre:?} lies outside the grid"
            ))
            .help("export it again"));
        }
        Ok(PsfListing {
            wavelength_nm: self.wavelength_nm,
            field: self.field,
            field_is_length: self.field_is_length,
            image: self.image,
            spacing_um: self.spacing_um,
            shape,
            centre: [centre[0] - 1, centre[1] - 1],
            data: rows.into_iter().flat_map(|(_, r)| r).collect(),
        })
    }
}

/// ` 0.25 µm.` as µm.
fn length_um(text: &str) -> Result<f64> {
    let words = words(text);
    let value = number("length", words.first().copied().unwrap_or(""))?;
    match words.get(1).map(|u| u.trim_end_matches('.')) {
        None | Some("" | "µm" | "μm" | "um" | "micrometers") => Ok(value),
        Some("mm") => Ok(value * 1e3),
        Some("nm") => Ok(value * 1e-3),
        Some(unit) => Err(Error::unsupported(format!("a data spacing in {unit}"))
            .help("export the PSF of a focal system, whose spacing is in µm")),
    }
}

/// ` 128 by 128`, ` 65, 65`, ` row 129, column 128`.
fn two(text: &str, between: &str) -> Result<[usize; 2]> {
    let wrong = || {
        Error::input(format!("\"{}\" does not hold two whole numbers", text.trim()))
            .help("export it again as text")
    };
    let (a, b) = text.split_once(between).ok_or_else(wrong)?;
    let read = |t: &str| {
        let digits: String = t.chars().filter(char::is_ascii_digit).collect();
        digits.parse::<usize>().ok().filter(|n| *n <= 16384).ok_or_else(wrong)
    };
    Ok([read(a)?, read(b)?])
}

impl PsfListing {
    /// A grid that says nothing of itself.
    pub(super) fn bare(shape: [usize; 2], data: Vec<f64>) -> Self {
        Self {
            wavelength_nm: None,
            field: None,
            field_is_length: false,
            image: None,
            spacing_um: None,
            shape,
            centre: [shape[0] / 2, shape[1] / 2],
            data,
        }
    }

    /// Where the field lies, by its image or, where the listing does not say, as printed.
    fn side(&self) -> Option<[f64; 2]> {
        // On the axis, rounding errors of a trace are printed, in units of mm or inches.
        const AXIS: f64 = 1e-6;
        self.image.filter(|&[x, y]| libm::hypot(x, y) > AXIS).or(self.field)
    }

    /// The listing with its field on the y axis: one on the x axis is turned, so that its rows run
    /// from +x to −x.
    fn turned_to_y(self) -> Result<Self> {
        // Where a field is on one axis, the other coordinate is a rounding error.
        const NOTHING: f64 = 1e-6;
        let Some([x, y]) = self.side() else { return Ok(self) };
        if x.abs() <= NOTHING * y.abs() {
            return Ok(self);
        }
        if y.abs() > NOTHING * x.abs() {
            return Err(Error::unsupported(format!("a field off both axes, at ({x}, {y})"))
                .help("a lens over image height takes PSFs of fields along y or along x"));
        }
        let [rows, columns] = self.shape;
        let turned = |i: usize| (0..rows).map(move |j| j * columns + (columns - 1 - i));
        let data = (0..columns).flat_map(turned).map(|k| self.data[k]).collect();
        Ok(Self {
            field: self.field.map(|[x, y]| [y, x]),
            image: self.image.map(|[x, y]| [y, x]),
            shape: [columns, rows],
            centre: [columns - 1 - self.centre[1], self.centre[0]],
            data,
            ..self
        })
    }

    /// Whether the rows, which run from +y to −y, run away from the axis: where the image lies at
    /// negative y. On the axis, or where the listing does not say, so that the chief ray's row
    /// comes to n/2 without losing one.
    #[must_use]
    pub fn runs_outwards(&self) -> bool {
        match self.side() {
            Some([_, y]) if y != 0.0 => y < 0.0,
            _ => self.centre[0] >= self.shape[0] / 2,
        }
    }

    /// Whether the centre row of a PSF on the axis is counted from the last row upwards.
    ///
    /// The programs print "centre 65, 65" of 128; some writers count y from the bottom. On the
    /// axis the PSF is symmetric about the chief ray, which decides.
    #[must_use]
    pub fn counts_rows_from_below(&self) -> bool {
        let [rows, columns] = self.shape;
        let asymmetry = |centre: usize| {
            let reach = centre.min(rows - 1 - centre);
            let pairs = (1..=reach).flat_map(|k| (0..columns).map(move |c| (k, c)));
            let differences = pairs.map(|(k, c)| {
                (self.data[(centre + k) * columns + c] - self.data[(centre - k) * columns + c])
                    .abs()
            });
            differences.sum::<f64>()
        };
        asymmetry(rows - 1 - self.centre[0]) < asymmetry(self.centre[0])
    }

    /// The listing with its centre row counted from the other end.
    #[must_use]
    pub fn counted_from_below(mut self) -> Self {
        self.centre[0] = self.shape[0] - 1 - self.centre[0];
        self
    }

    /// The samples on a square grid of the listing's (even or odd) size with the chief ray at
    /// sample n/2 and rows rising away from the axis, and the fraction of the light that stays
    /// inside.
    ///
    /// `outwards`: whether the file's rows run away from the axis already.
    #[must_use]
    pub fn oriented(&self, outwards: bool) -> (usize, Vec<f64>, f64) {
        let [rows, columns] = self.shape;
        let n = rows.min(columns);
        let place = |centre: usize, i: usize, forward: bool, limit: usize| {
            let step = i as i64 - (n / 2) as i64;
            let at = centre as i64 + if forward { step } else { -step };
            usize::try_from(at).ok().filter(|v| *v < limit)
        };
        let mut out = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..n {
                let row = place(self.centre[0], i, outwards, rows);
                if let (Some(r), Some(c)) = (row, place(self.centre[1], j, true, columns)) {
                    out[i * n + j] = self.data[r * columns + c];
                }
            }
        }
        let (kept, all): (f64, f64) = (out.iter().sum(), self.data.iter().sum());
        (n, out, if all > 0.0 { kept / all } else { 0.0 })
    }
}

/// The wavelength that a listing of a table states, nm: `Wavelength: 0.5500 µm`.
///
/// # Errors
/// One that is no number.
pub fn wavelength_nm(text: &str) -> Result<Option<f64>> {
    let text = with_points(text);
    let mut stated = text.lines().filter_map(|line| labelled(line.trim(), "Wavelength:"));
    let Some(rest) = stated.next() else { return Ok(None) };
    let um = number("wavelength", words(rest).first().copied().unwrap_or(""))?;
    Ok(Some(um * 1e3))
}

/// Millimetres in the unit that a line `Units are Inches.` names.
fn unit_mm(text: &str) -> Result<f64> {
    let Some(unit) = text.lines().find_map(|line| labelled(line.trim(), "Units are")) else {
        return Ok(1.0);
    };
    match unit.trim_matches([' ', '.']).to_ascii_lowercase().as_str() {
        "millimeters" | "millimetres" | "mm" => Ok(1.0),
        "centimeters" | "centimetres" | "cm" => Ok(10.0),
        "inches" | "in" => Ok(25.4),
        "meters" | "metres" | "m" => Ok(1000.0),
        other => Err(Error::unsupported(format!("Units are {other}"))
            .help("known are millimeters, centimeters, inches and meters")),
    }
}

/// Reads a grid-distortion listing into pairs of predicted and real image height, mm, rising.
///
/// # Errors
/// A listing without its rows, or with rows that are cut short; an unknown unit.
pub fn grid_distortion(text: &str) -> Result<Vec<[f64; 2]>> {
    let text = with_points(text);
    let unit_mm = unit_mm(&text)?;
    let mut pairs: Vec<[f64; 2]> = Vec::new();
    let mut table = false;
    for (i, line) in text.lines().enumerate() {
        let words = words(line);
        if words.first() == Some(&"i") && words.get(1) == Some(&"j") {
            table = true;
            continue;
        }
        let index = |w: &str| w.parse::<i64>().is_ok();
        if !table || words.len() < 2 || !index(words[0]) || !index(words[1]) {
            continue;
        }
        // i j X-Field Y-Field R-Field Predicted X Predicted Y Real X Real Y Distortion
        if words.len() < 9 {
            return Err(Error::input(format!("{} columns instead of 10", words.len()))
                .at(format!("line {}", i + 1))
                .help("the export is cut short; export it again"));
        }
        let read = |k: usize| {
            number("grid distortion", words[k]).map_err(|e| e.at(format!("line {}", i + 1)))
        };
        let radius = |x: f64, y: f64| (x * x + y * y).sqrt() * unit_mm;
        pairs.push([radius(read(5)?, read(6)?), radius(read(7)?, read(8)?)]);
    }
    pairs.sort_by(|a, b| a[0].total_cmp(&b[0]));
    // Symmetric grid points have the same radius to the printed digits.
    let top = pairs.last().map_or(0.0, |p| p[0]);
    pairs.dedup_by(|b, a| b[0] - a[0] < 1e-4 * top);
    if pairs.len() < 2 {
        return Err(Error::input("no rows of grid distortion")
            .help("a Zemax grid-distortion listing with its table is expected"));
    }
    if pairs[0][0] > 0.0 {
        pairs.insert(0, [0.0, 0.0]);
    }
    Ok(pairs)
}

/// Reads a relative-illumination listing into pairs of field (as printed) and relative
/// illumination.
///
/// # Errors
/// A listing without its rows.
pub fn relative_illumination(text: &str) -> Result<Vec<[f64; 2]>> {
    let text = with_points(text);
    let mut pairs = Vec::new();
    let mut table = false;
    for line in text.lines() {
        if line.contains("Rel. Ill") {
            table = true;
            continue;
        }
        let words = words(line);
        let values: Vec<f64> = words.iter().map_while(|w| w.parse().ok()).collect();
        if table && values.len() >= 2 {
            pairs.push([values[0].abs(), values[1]]);
        }
    }
    if pairs.len() < 2 {
        return Err(Error::input("no rows of relative illumination")
            .help("a Zemax relative-illumination listing with its table is expected"));
    }
    Ok(pairs)
}
