//! ISETCam ray-trace sets: what its Zemax (`ISET_RT_ZEMAX*.ZPL`) and CODE V (`ISET_RT_CODEV.SEQ`)
//! macros write.
//!
//! `ISETPARMS.TXT` holds MATLAB assignments; `_DI_`, `_RI_`, `_CRA_` hold heights x wavelengths
//! values (real height in mm, ratio, radians), `_PSF_h_w` or `_2D_PSF_Fldh_Wavew` one PSF each.
//! PSFs may cover a part of heights and wavelengths, but all combinations of that part.

use super::decimals::with_points;
use super::listing::{self, PsfListing};
use super::{check, check_place};
use camrig_base::Spectrum;
use camrig_base::{Error, Result};
use camrig_glass::text::{number, read_text};
use camrig_optics::{Characterisation, PsfGrid};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The parameter file of a set: `path` itself, or the one `*ISETPARMS.TXT` in the directory
/// `path`.
///
/// # Errors
/// No such file in the directory, or more than one.
pub fn parameter_file(path: &Path) -> Result<PathBuf> {
    if path.is_file() {
        return Ok(path.to_owned());
    }
    let named = |p: &PathBuf| {
        let name = p.file_name().unwrap_or_default().to_string_lossy().to_ascii_uppercase();
        name.ends_with("ISETPARMS.TXT")
    };
    let mut found: Vec<PathBuf> = files(path)?.into_iter().filter(named).collect();
    match (found.pop(), found.is_empty()) {
        (Some(file), true) => Ok(file),
        (file, _) => Err(Error::input(format!(
            "{} {} ISETPARMS.TXT",
            path.display(),
            if file.is_some() { "holds more than one" } else { "holds no" }
        ))
        .help("give the parameter file of an ISETCam set, or a manifest (.toml)")),
    }
}

fn files(dir: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(dir).map_err(|e| Error::io("read", dir, e))?;
    let mut all: Vec<PathBuf> = entries.filter_map(|e| e.ok().map(|e| e.path())).collect();
    all.sort();
    Ok(all)
}

/// The values of `ISETPARMS.TXT`.
struct Parameters {
    values: BTreeMap<String, (usize, String)>,
}

impl Parameters {
    fn parse(text: &str) -> Self {
        let mut values = BTreeMap::new();
        for (i, line) in text.lines().enumerate() {
            let code = line.split('%').next().unwrap_or("");
            if let Some((name, value)) = code.split_once('=') {
                let value = value.trim().trim_end_matches(';').trim();
                values.insert(name.trim().to_owned(), (i + 1, value.to_owned()));
            }
        }
        Self { values }
    }

    fn text(&self, name: &str) -> Result<(usize, &str)> {
        self.values.get(name).map(|(line, v)| (*line, v.as_str())).ok_or_else(|| {
            Error::input(format!("no value of \"{name}\""))
                .help("the parameter file is not complete; run the export again")
        })
    }

    fn number(&self, name: &str) -> Result<f64> {
        let (line, value) = self.text(name)?;
        number(name, value).map_err(|e| e.at(format!("line {line}")))
    }

    /// `first:step:last`, or a list in brackets.
    fn range(&self, name: &str) -> Result<Vec<f64>> {
        let (line, value) = self.text(name)?;
        let at = |e: Error| e.at(format!("line {line}"));
        let inner = value.trim_matches(['[', ']']);
        let list = |text: &str, separators: &[char]| {
            let words = text.split(separators).filter(|w| !w.is_empty());
            words.map(|w| number(name, w)).collect::<Result<Vec<f64>>>().map_err(at)
        };
        if !inner.contains(':') {
            return list(inner, &[' ', ',', '\t']);
        }
        match list(inner, &[':'])?[..] {
            [first, step, last] if step > 0.0 && (last - first) / step < 1e4 => {
                let count = ((last - first) / step + 1e-6).floor().max(0.0) as usize;
                Ok((0..=count).map(|i| first + step * i as f64).collect())
            }
            _ => Err(at(Error::input(format!("{name}: \"{value}\""))
                .help("a range is written first:step:last"))),
        }
    }

    /// The paraxial heights: a number and the largest (Zemax), or a range (CODE V).
    fn heights(&self) -> Result<Vec<f64>> {
        if self.values.contains_key("imgHeight") {
            return self.range("imgHeight");
        }
        let (count, top) = (self.number("imgHeightNum")?, self.number("imgHeightMax")?);
        if !(count.fract() == 0.0 && (2.0..=1000.0).contains(&count) && top > 0.0) {
            return Err(Error::input(format!("{count} image heights up to {top} mm"))
                .help("imgHeightNum is 2 or more, imgHeightMax positive"));
        }
        Ok((0..count as usize).map(|i| top * i as f64 / (count - 1.0)).collect())
    }
}

/// Imports the set of a parameter file.
///
/// # Errors
/// Missing files and parameters, tables of another size, a PSF grid with gaps; the error names the
/// file.
pub fn read(parameter_file: &Path) -> Result<Characterisation> {
    let parameters = Parameters::parse(&read_text(parameter_file)?);
    read_set(parameter_file, &parameters).map_err(|e| e.at(parameter_file.display()))
}

fn read_set(parameter_file: &Path, parameters: &Parameters) -> Result<Characterisation> {
    let dir = parameter_file.parent().unwrap_or(Path::new("."));
    let (_, base) = parameters.text("baseLensFileName")?;
    // A Windows path of the machine the export ran on.
    let base = base.trim_matches(['\'', '"']).rsplit(['\\', '/']).next().unwrap_or("").to_owned();
    let wavelengths_nm = parameters.range("wave")?;
    let heights_mm = parameters.heights()?;
    let cells = heights_mm.len() * wavelengths_nm.len();
    let table = |kind: &str| {
        let path = file(dir, &format!("{base}_{kind}_.dat"))?;
        let text = read_text(&path)?;
        let values: Result<Vec<f64>> =
            super::words(&with_points(&text).replace(['\r', '\n'], " "))
                .into_iter()
                .map(|w| number("value", w))
                .collect();
        let values = values.map_err(|e| e.at(path.display()))?;
        if values.len() != cells {
            return Err(Error::input(format!("{} values instead of {cells}", values.len()))
                .at(path.display())
                .help(format!(
                    "one per height and wavelength: {} x {}; is the export cut short?",
                    heights_mm.len(),
                    wavelengths_nm.len()
                )));
        }
        Ok(values)
    };
    let real_height_mm: Vec<f64> = table("DI")?.into_iter().map(f64::abs).collect();
    let relative_illumination = table("RI")?;
    let chief_ray_angle_deg = match file(dir, &format!("{base}_CRA_.dat"))?.exists() {
        true => Some(table("CRA")?.into_iter().map(|v| v.abs().to_degrees()).collect()),
        false => None,
    };
    let spacing_um = parameters.number("psfSpacing")? * 1e3;
    let set = Set { base: &base, heights: &heights_mm, wavelengths: &wavelengths_nm, spacing_um };
    let psf = set.psf_grid(dir, &real_height_mm)?;
    Ok(Characterisation {
        name: base,
        source: format!(
            "imported by camrig {} from an ISETCam ray-trace set",
            env!("CARGO_PKG_VERSION")
        ),
        efl_mm: parameters.number("efl")?,
        f_number: parameters.number("fnumber")?,
        magnification: parameters.number("mag")?.abs(),
        pupil_magnification: 1.0,
        axis_solid_angle_sr: None,
        stop_radius_mm: None,
        transmittance: Spectrum::constant(1.0),
        wavelengths_nm,
        heights_mm,
        real_height_mm,
        relative_illumination,
        chief_ray_angle_deg,
        psf,
    })
}

/// The file of this name in a folder, in capitals or not.
fn file(dir: &Path, name: &str) -> Result<PathBuf> {
    let same = |path: &PathBuf| path.file_name().is_some_and(|own| own.eq_ignore_ascii_case(name));
    Ok(files(dir)?.into_iter().find(same).unwrap_or_else(|| dir.join(name)))
}

/// Height and wavelength numbers (from 1) in a PSF file's name.
fn psf_numbers(name: &str, base: &str) -> Option<(usize, usize)> {
    let rest = name.strip_prefix(base)?;
    let (rest, ending) = rest.split_at_checked(rest.len().checked_sub(4)?)?;
    if !ending.eq_ignore_ascii_case(".dat") {
        return None;
    }
    let numbers = match rest.strip_prefix("_2D_PSF_Fld") {
        Some(new) => new.split_once("_Wave")?,
        None => rest.strip_prefix("_PSF_")?.split_once('_')?,
    };
    Some((numbers.0.parse().ok()?, numbers.1.parse().ok()?))
}

/// What a parameter file announces of its PSFs.
struct Set<'a> {
    base: &'a str,
    heights: &'a [f64],
    wavelengths: &'a [f64],
    spacing_um: f64,
}

impl Set<'_> {
    /// The PSF files of a folder by the numbers, from 1, of their heights and wavelengths.
    fn psf_files(&self, dir: &Path) -> Result<BTreeMap<(usize, usize), PathBuf>> {
        let mut found = BTreeMap::new();
        for path in files(dir)? {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let Some((h, w)) = psf_numbers(&name, self.base) else { continue };
            let announced = (1..=self.heights.len()).contains(&h);
            if !announced || !(1..=self.wavelengths.len()).contains(&w) {
                return Err(Error::input(format!("PSF of height {h} and wavelength {w}"))
                    .at(path.display())
                    .help("the parameter file announces fewer"));
            }
            if let Some(other) = found.insert((h, w), path) {
                return Err(Error::input(format!("two PSFs of height {h} and wavelength {w}"))
                    .at(other.display())
                    .help("the exports of two macros lie in one folder; keep one of them"));
            }
        }
        Ok(found)
    }

    /// A PSF of which the chief ray meets the image at `real_mm`.
    fn listing(&self, path: &Path, nm: f64, real_mm: f64) -> Result<PsfListing> {
        let listing = listing::psf(&read_text(path)?).map_err(|e| e.at(path.display()))?;
        check(&listing, nm, self.spacing_um)
            .and_then(|()| check_place(&listing, Some(real_mm)))
            .map_err(|e| e.at(path.display()))?;
        Ok(listing)
    }

    /// The PSFs of the set, whose chief rays meet the image at these heights, mm.
    fn psf_grid(&self, dir: &Path, real_height_mm: &[f64]) -> Result<PsfGrid> {
        let Self { base, heights, wavelengths, spacing_um } = *self;
        let found = self.psf_files(dir)?;
        let mut h_used: Vec<usize> = found.keys().map(|k| k.0).collect();
        let mut w_used: Vec<usize> = found.keys().map(|k| k.1).collect();
        for used in [&mut h_used, &mut w_used] {
            used.sort_unstable();
            used.dedup();
        }
        if h_used.first() != Some(&1) {
            return Err(Error::input(format!(
                "no PSF file of the axis ({base}_2D_PSF_Fld1_Wave1.dat, ...)"
            ))
            .at(dir.display())
            .help("PSFs start on the axis, at height number 1"));
        }
        let (mut size, mut data, mut captured) = (0, Vec::new(), Vec::new());
        let mut from_below = None;
        for &h in &h_used {
            for &w in &w_used {
                let Some(path) = found.get(&(h, w)) else {
                    return Err(Error::input(format!(
                        "no PSF for height {} mm at {} nm",
                        heights[h - 1],
                        wavelengths[w - 1]
                    ))
                    .at(dir.display())
                    .help(format!(
                        "{base}_2D_PSF_Fld{h}_Wave{w}.dat is missing; export it, or remove that \
                     height or wavelength"
                    )));
                };
                let real_mm = real_height_mm[(h - 1) * wavelengths.len() + w - 1];
                let listing = self.listing(path, wavelengths[w - 1], real_mm)?;
                // The axis comes first, and decides for the set.
                let below = *from_below.get_or_insert_with(|| listing.counts_rows_from_below());
                let listing = if below { listing.counted_from_below() } else { listing };
                let (n, samples, kept) = listing.oriented(listing.runs_outwards());
                if size != 0 && n != size {
                    return Err(Error::input(format!(
                        "a PSF of {n} x {n} samples, others have {size}"
                    ))
                    .at(path.display())
                    .help("export all PSFs with the same grid"));
                }
                size = n;
                captured.push(kept);
                // A PSF without light stays without light; the check of the lens then refuses it by
                // its place.
                let sum = samples.iter().sum::<f64>().max(f64::MIN_POSITIVE);
                data.extend(samples.iter().map(|v| (v / sum) as f32));
            }
        }
        Ok(PsfGrid {
            heights_mm: h_used.iter().map(|h| heights[h - 1]).collect(),
            wavelengths_nm: w_used.iter().map(|w| wavelengths[w - 1]).collect(),
            size,
            spacing_um,
            data,
            captured: captured.iter().any(|v| *v < 1.0).then_some(captured),
            between: None,
        })
    }
}
