//! Zemax OpticStudio text listings: Huygens and FFT PSF, grid distortion, relative illumination;
//! and bare grids of numbers (CODE V PSFs, CSV).

use super::{rows_of_numbers, words};
use camrig_base::{Error, Result};
use camrig_glass::text::number;

/// A PSF as a file stores it.
#[derive(Clone, Debug, PartialEq)]
pub struct PsfListing {
    /// Wavelength, nm, where the file states it.
    pub wavelength_nm: Option<f64>,
    /// Field as printed (degrees or mm, signed), where the file states it.
    pub field: Option<f64>,
    /// Height y of the chief ray in the image, signed, in the file's unit, where the file states
    /// it.
    pub image_y: Option<f64>,
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
/// A listing that is cut short, values that are negative or no numbers; with the line.
pub fn psf(text: &str) -> Result<PsfListing> {
    let header = text.lines().take(3).any(|l| l.contains("Listing of") || l.contains("PSF Data"));
    let listing = if header { zemax_psf(text)? } else { bare_psf(text)? };
    Ok(listing)
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
    Ok(PsfListing {
        wavelength_nm: None,
        field: None,
        image_y: None,
        spacing_um: None,
        shape,
        centre: [shape[0] / 2, shape[1] / 2],
        data: rows.concat(),
    })
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

fn zemax_psf(text: &str) -> Result<PsfListing> {
    let (mut wavelength_nm, mut field, mut image_y, mut spacing_um) = (None, None, None, None);
    let (mut shape, mut centre) = (None, None);
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
            continue;
        }
        if labelled(line, "Values are").is_some() {
            values_follow = true;
        } else if let Some(rest) = labelled(line, "Data spacing is") {
            spacing_um = Some(length_um(rest).map_err(at)?);
        } else if let Some(rest) = labelled(line, "Image grid size:") {
            shape = Some(two(rest, "by").map_err(at)?);
        } else if let Some(rest) = labelled(line, "Center point is:") {
            centre = Some(two(rest, ",").map_err(at)?);
        } else if let Some(rest) = labelled(line, "Center coordinates:") {
            // Its sign tells which way is up.
            let y = words(rest).get(1).copied().unwrap_or("");
            image_y = Some(number("image position y", y).map_err(at)?);
        } else if ["µm at ", "μm at ", "um at "].iter().any(|words| line.contains(words)) {
            // `0.5500 µm at -27.38 deg.`; FFT: `0.4500 to 0.4500 µm at 4.0000, 0.0000 mm.`
            let words: Vec<&str> = line.split([' ', ',']).filter(|w| !w.is_empty()).collect();
            wavelength_nm = Some(number("wavelength", words[0]).map_err(at)? * 1e3);
            let after: Vec<f64> = words
                .iter()
                .skip_while(|w| **w != "at")
                .skip(1)
                .map_while(|w| w.parse().ok())
                .collect();
            field = after.iter().copied().max_by(|a, b| a.abs().total_cmp(&b.abs()));
        }
    }
    let whole = |what: &str| {
        Error::input(format!("the listing has no line \"{what}\""))
            .help("export it again as text, with its header")
    };
    let columns = rows.first().map_or(0, |(_, r)| r.len());
    // FFT listings give no grid size; theirs are square.
    let shape = shape.unwrap_or([columns, columns]);
    if !values_follow || shape[0] == 0 {
        return Err(whole("Values are ..."));
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
    let centre = centre.unwrap_or([shape[0] / 2 + 1, shape[1] / 2 + 1]);
    if centre.iter().zip(shape).any(|(c, n)| *c < 1 || *c > n) {
        return Err(Error::input(format!("the centre point {centre:?} lies outside the grid"))
            .help("export it again"));
    }
    Ok(PsfListing {
        wavelength_nm,
        field,
        image_y,
        spacing_um,
        shape,
        centre: [centre[0] - 1, centre[1] - 1],
        data: rows.into_iter().flat_map(|(_, r)| r).collect(),
    })
}

/// ` 0.25 µm.` as µm.
fn length_um(text: &str) -> Result<f64> {
    let words = words(text);
    let value = number("length", words.first().copied().unwrap_or(""))?;
    match words.get(1).map(|u| u.trim_end_matches('.')) {
        Some("mm") => Ok(value * 1e3),
        Some("nm") => Ok(value * 1e-3),
        _ => Ok(value),
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
    /// Whether the rows, which run from +y to −y, run away from the axis: where the image lies at
    /// negative y. On the axis, or where the listing does not say, so that the chief ray's row
    /// comes to n/2 without losing one.
    #[must_use]
    pub fn runs_outwards(&self) -> bool {
        match self.image_y.or(self.field) {
            Some(y) if y != 0.0 => y < 0.0,
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

/// Reads a grid-distortion listing into pairs of predicted and real image height, mm, rising.
///
/// # Errors
/// A listing without its rows, or with rows that are cut short.
pub fn grid_distortion(text: &str) -> Result<Vec<[f64; 2]>> {
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
        let radius = |x: f64, y: f64| (x * x + y * y).sqrt();
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
