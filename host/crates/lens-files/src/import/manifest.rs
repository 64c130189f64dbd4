//! The import manifest: a TOML file that names the files with the data of a lens.
//!
//! ```toml
//! format = "camrig-lens-import/1"
//! name = "asphere"
//! efl_mm = 2.0
//! f_number = 4.0
//! # magnification = 0.0
//!
//! # Tables over paraxial image height: CSV with a first column of heights in mm and a header row
//! # of wavelengths (height_mm,450,500,...), or per wavelength a Zemax listing.
//! distortion = ["real_height.csv"]              # real chief-ray height, mm; or grid distortion
//! relative_illumination = ["illumination.csv"]  # ratio; or listings over the field in degrees
//! chief_ray_angle = ["cra.csv"]                 # degrees; optional
//!
//! # Point-spread functions: every height with every wavelength. Zemax listing, CODE V listing,
//! CSV
//! # or NPY (n x n).
//! [[psf]]
//! height_mm = 0.0
//! wavelength_nm = 550.0                         # may be left out where the listing says it
//! file = "psf_axis.txt"
//! spacing_um = 0.25                             # may be left out where the listing says it
//! outwards = true                               # whether rows run away from the axis; absent: as
//!                                               #   the listing says, true where it says nothing
//! ```
//!
//! Listings that cover one wavelength are written `{ file = "grid.txt", wavelength_nm = 550.0 }`;
//! a single one without a wavelength holds for all, several have those that they state.

use super::decimals::with_points;
use super::listing::{self, PsfListing};
use super::{Table, WAVELENGTH_TOLERANCE_NM, check, check_place, words};
use camrig_base::Spectrum;
use camrig_base::{Error, Result, npy, toml_text};
use camrig_glass::text::{number, read_text};
use camrig_optics::{Characterisation, PsfGrid};
use serde::Deserialize;
use std::path::Path;

const FORMAT: &str = "camrig-lens-import/1";

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    format: String,
    name: String,
    efl_mm: f64,
    f_number: f64,
    #[serde(default)]
    magnification: f64,
    distortion: Vec<Source>,
    relative_illumination: Vec<Source>,
    #[serde(default)]
    chief_ray_angle: Vec<Source>,
    psf: Vec<PsfEntry>,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "a file's name, or { file = \"...\", wavelength_nm = ... }")]
enum Source {
    File(String),
    Of(OfWavelength),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OfWavelength {
    file: String,
    wavelength_nm: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PsfEntry {
    height_mm: f64,
    wavelength_nm: Option<f64>,
    file: String,
    spacing_um: Option<f64>,
    outwards: Option<bool>,
}

/// Imports the lens that a manifest describes.
///
/// # Errors
/// What is wrong in the manifest or a file it names, with the line.
pub fn read(path: &Path) -> Result<Characterisation> {
    let text = read_text(path)?;
    let manifest: Manifest = toml_text::read(&text).map_err(|e| e.at(path.display()))?;
    if manifest.format != FORMAT {
        return Err(Error::unsupported(format!("format \"{}\"", manifest.format))
            .at(path.display())
            .help(format!("an import manifest has format = \"{FORMAT}\"")));
    }
    let dir = path.parent().unwrap_or(Path::new("."));
    let table = |what: &str, sources: &[Source]| {
        tables(dir, sources, &manifest).map_err(|e| e.at(what).at(path.display()))
    };
    let distortion = table("distortion", &manifest.distortion)?;
    let illumination = table("relative_illumination", &manifest.relative_illumination)?;
    let real_height_mm = |height_mm: f64, nm: f64| {
        let reach = distortion.heights.last().copied().unwrap_or(0.0);
        distortion.onto(&[height_mm.min(reach)], &[nm]).ok().map(|found| found[0])
    };
    let psf = psf_grid(dir, &manifest, &real_height_mm).map_err(|e| e.at(path.display()))?;
    let wavelengths_nm = match distortion.wavelengths[..] {
        [0.0] => psf.wavelengths_nm.clone(),
        _ => distortion.wavelengths.clone(),
    };
    let heights_mm = distortion.heights.clone();
    let onto = |what: &str, table: &Table| {
        table.onto(&heights_mm, &wavelengths_nm).map_err(|e| e.at(what).at(path.display()))
    };
    let chief_ray_angle_deg = match manifest.chief_ray_angle.is_empty() {
        true => None,
        false => {
            Some(onto("chief_ray_angle", &table("chief_ray_angle", &manifest.chief_ray_angle)?)?)
        }
    };
    Ok(Characterisation {
        real_height_mm: onto("distortion", &distortion)?,
        relative_illumination: onto("relative_illumination", &illumination)?,
        chief_ray_angle_deg,
        name: manifest.name,
        source: format!("imported by camrig {}", env!("CARGO_PKG_VERSION")),
        efl_mm: manifest.efl_mm,
        f_number: manifest.f_number,
        magnification: manifest.magnification,
        pupil_magnification: 1.0,
        axis_solid_angle_sr: None,
        stop_radius_mm: None,
        transmittance: Spectrum::constant(1.0),
        wavelengths_nm,
        heights_mm,
        psf,
    })
}

/// One table from its sources: a CSV of all wavelengths, or a file per wavelength on the heights
/// of the first.
fn tables(dir: &Path, sources: &[Source], manifest: &Manifest) -> Result<Table> {
    let alone = sources.len() == 1;
    let mut all: Vec<Table> = Vec::with_capacity(sources.len());
    for source in sources {
        let (file, stated) = match source {
            Source::File(file) => (file, None),
            Source::Of(of) => (&of.file, Some(of.wavelength_nm)),
        };
        let path = dir.join(file);
        let text = read_text(&path)?;
        let read = || table(&text, wavelength(&text, stated, alone)?, manifest);
        all.push(read().map_err(|e| e.at(path.display()))?);
    }
    if alone {
        return Ok(all.remove(0));
    }
    if all.iter().any(|table| table.wavelengths.contains(&0.0)) {
        return Err(Error::input("several files, of which one does not say its wavelength").help(
            "write { file = \"...\", wavelength_nm = ... } for each, or give one file for all",
        ));
    }
    all.sort_by(|a, b| a.wavelengths[0].total_cmp(&b.wavelengths[0]));
    let Some(first) = all.first() else {
        return Err(Error::input("no file").help("name at least one"));
    };
    let heights = first.heights.clone();
    let wavelengths: Vec<f64> = all.iter().flat_map(|t| t.wavelengths.iter().copied()).collect();
    let columns: Result<Vec<Vec<f64>>> =
        all.iter().map(|t| t.onto(&heights, &t.wavelengths)).collect();
    let columns = columns?;
    let mut values = Vec::with_capacity(heights.len() * wavelengths.len());
    for h in 0..heights.len() {
        for (table, column) in all.iter().zip(&columns) {
            let n = table.wavelengths.len();
            values.extend_from_slice(&column[h * n..(h + 1) * n]);
        }
    }
    Ok(Table { heights, wavelengths, values })
}

/// The wavelength of a source, nm; 0 where one that is `alone` holds for all.
fn wavelength(text: &str, stated: Option<f64>, alone: bool) -> Result<f64> {
    let own = listing::wavelength_nm(text)?;
    match (stated, own) {
        (Some(nm), Some(own)) if (own - nm).abs() > WAVELENGTH_TOLERANCE_NM => {
            Err(Error::input(format!("a listing of {own} nm where {nm} nm is stated"))
                .help("the files do not belong together, or their wavelengths are mixed up"))
        }
        (Some(nm), _) => Ok(nm),
        (None, Some(own)) if !alone => Ok(own),
        (None, _) => Ok(0.0),
    }
}

fn table(text: &str, nm: f64, manifest: &Manifest) -> Result<Table> {
    let of_pairs = |pairs: Vec<[f64; 2]>| Table {
        heights: pairs.iter().map(|p| p[0]).collect(),
        wavelengths: vec![nm],
        values: pairs.iter().map(|p| p[1]).collect(),
    };
    let head: String = text.lines().take(12).collect::<Vec<_>>().join("\n");
    let table = if head.contains("Grid Distortion") {
        of_pairs(thinned(listing::grid_distortion(text)?))
    } else if text.contains("Rel. Ill") {
        if manifest.magnification != 0.0 {
            return Err(Error::unsupported(
                "a listing of relative illumination over the field of a near object",
            )
            .help("its place in the image is not known: give a table over height_mm"));
        }
        let mut pairs = listing::relative_illumination(text)?;
        let degrees = text.to_ascii_lowercase().contains("deg");
        if degrees {
            let place = |degrees: f64| manifest.efl_mm * libm::tan(degrees.to_radians());
            pairs.iter_mut().for_each(|p| p[0] = place(p[0]));
        }
        of_pairs(pairs)
    } else {
        csv(text, nm)?
    };
    let rising = table.heights.windows(2).all(|w| w[1] > w[0]);
    if table.heights.first() != Some(&0.0) || !rising {
        return Err(Error::input("heights do not rise from 0")
            .help("the first row is the axis, and every row lies further out"));
    }
    Ok(table)
}

/// At most 64 of the pairs, the first and the last among them.
fn thinned(pairs: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let last = pairs.len() - 1;
    let keep = last.min(63);
    (0..=keep).map(|i| pairs[i * last / keep]).collect()
}

/// `height_mm,450,500,...` and rows of values; without a header row one column for the wavelength
/// `nm`.
fn csv(text: &str, nm: f64) -> Result<Table> {
    let text = with_points(text);
    let mut lines = text
        .lines()
        .enumerate()
        .map(|(i, l)| (i + 1, l.trim()))
        .filter(|(_, l)| !l.is_empty() && !l.starts_with('#'))
        .peekable();
    let (mut wavelengths, mut unit_mm) = (vec![nm], 1.0);
    if let Some((line, header)) = lines.peek().copied()
        && words(header).first().is_some_and(|w| w.parse::<f64>().is_err())
    {
        lines.next();
        (wavelengths, unit_mm) = columns(header, nm).map_err(|e| e.at(format!("line {line}")))?;
    }
    let (mut heights, mut values) = (Vec::new(), Vec::new());
    for (line, text) in lines {
        let row: Result<Vec<f64>> = words(text).iter().map(|w| number("value", w)).collect();
        let row = row.map_err(|e| e.at(format!("line {line}")))?;
        if row.len() != wavelengths.len() + 1 {
            return Err(Error::input(format!(
                "{} values instead of {}",
                row.len(),
                wavelengths.len() + 1
            ))
            .at(format!("line {line}"))
            .help("a row holds a height and a value per wavelength"));
        }
        heights.push(row[0] * unit_mm);
        values.extend_from_slice(&row[1..]);
    }
    Ok(Table { heights, wavelengths, values })
}

/// Wavelengths of the columns that a header names, nm, and millimetres in the unit of its heights.
fn columns(header: &str, nm: f64) -> Result<(Vec<f64>, f64)> {
    // Below it there is no light for a lens: such numbers are in µm.
    const MIN_NM: f64 = 100.0;
    let names = words(header);
    let first = names[0].to_ascii_lowercase();
    let unit_mm = match first.rsplit(['_', '(', '[']).next().unwrap_or("").trim_matches([')', ']'])
    {
        "mm" | "height" | "h" | "r" | "y" => 1.0,
        "um" | "µm" | "μm" => 1e-3,
        _ => {
            return Err(Error::input(format!("the first column is \"{}\"", names[0]))
                .help("it holds paraxial heights in the image: height_mm or height_um"));
        }
    };
    let read: Result<Vec<f64>> = names[1..].iter().map(|w| number("wavelength", w)).collect();
    // A single column may carry a name instead of a wavelength.
    let wavelengths = match (read, names.len()) {
        (Ok(list), _) => list,
        (Err(_), 2) => vec![nm],
        (Err(e), _) => return Err(e),
    };
    match wavelengths.iter().find(|nm| **nm != 0.0 && **nm < MIN_NM) {
        Some(nm) => Err(Error::input(format!("a column for {nm} nm"))
            .help("wavelengths in the header are in nm")),
        None => Ok((wavelengths, unit_mm)),
    }
}

/// A PSF with its height (mm), wavelength (nm), sample distance (µm), and what
/// [`PsfListing::oriented`] gave.
type LoadedPsf = (f64, f64, f64, (usize, Vec<f64>, f64));

/// A listing by its entry, which must not contradict it; `near`: whether the object is.
fn placed(
    listing: &PsfListing,
    entry: &PsfEntry,
    near: bool,
    real_height_mm: &dyn Fn(f64, f64) -> Option<f64>,
) -> Result<LoadedPsf> {
    let unknown = |what: &str| {
        Error::input(format!("the file does not say its {what}"))
            .help(format!("add {what} to its [[psf]] entry"))
    };
    let nm = entry.wavelength_nm.or(listing.wavelength_nm);
    let spacing = entry.spacing_um.or(listing.spacing_um);
    let nm = nm.ok_or_else(|| unknown("wavelength_nm"))?;
    let spacing = spacing.ok_or_else(|| unknown("spacing_um"))?;
    check(listing, nm, spacing)?;
    // A PSF on the axis may be one of another field, by the user's word.
    if entry.height_mm != 0.0 {
        check_place(listing, real_height_mm(entry.height_mm, nm))?;
    }
    // The height of a near object and that of its image have opposite signs.
    let of_object = near && listing.field_is_length && listing.image.is_none();
    if of_object && entry.outwards.is_none() && listing.field != Some([0.0; 2]) {
        return Err(Error::input("the file does not say on which side its image lies")
            .help("add outwards = true or false to its [[psf]] entry"));
    }
    let outwards = entry.outwards.unwrap_or(listing.runs_outwards());
    Ok((entry.height_mm, nm, spacing, listing.oriented(outwards)))
}

fn psf_grid(
    dir: &Path,
    manifest: &Manifest,
    real_height_mm: &dyn Fn(f64, f64) -> Option<f64>,
) -> Result<PsfGrid> {
    let mut loaded: Vec<LoadedPsf> = Vec::with_capacity(manifest.psf.len());
    for entry in &manifest.psf {
        let path = dir.join(&entry.file);
        let psf = load(&path).and_then(|listing| {
            placed(&listing, entry, manifest.magnification != 0.0, real_height_mm)
        });
        loaded.push(psf.map_err(|e| e.at(path.display()))?);
    }
    let Some((_, _, spacing_um, (size, _, _))) = loaded.first().cloned() else {
        return Err(Error::input("no [[psf]]").help("name one PSF at least"));
    };
    let axis = |pick: &dyn Fn(&LoadedPsf) -> f64| {
        let mut all: Vec<f64> = loaded.iter().map(pick).collect();
        all.sort_by(f64::total_cmp);
        all.dedup();
        all
    };
    let (heights_mm, wavelengths_nm) = (axis(&|p| p.0), axis(&|p| p.1));
    if let Some((h, nm, ..)) = (1..loaded.len())
        .find(|&i| loaded[..i].iter().any(|p| (p.0, p.1) == (loaded[i].0, loaded[i].1)))
        .map(|i| &loaded[i])
    {
        return Err(Error::input(format!("two PSFs of height {h} mm and {nm} nm"))
            .help("name one [[psf]] for each height and wavelength"));
    }
    let (mut data, mut captured) = (Vec::new(), Vec::new());
    for &h in &heights_mm {
        for &nm in &wavelengths_nm {
            let Some((_, _, spacing, (n, samples, kept))) =
                loaded.iter().find(|p| p.0 == h && p.1 == nm)
            else {
                return Err(Error::input(format!("no PSF for height {h} mm at {nm} nm"))
                    .help("give every height at every wavelength"));
            };
            if *n != size || *spacing != spacing_um {
                return Err(Error::unsupported(format!(
                    "PSF of {n} samples {spacing} µm apart at height {h} mm, {nm} nm; \
                     the first has {size}, {spacing_um} µm"
                ))
                .help("export all PSFs on the same grid"));
            }
            // A PSF without light stays without light; the check of the lens then refuses it by
            // its place.
            let sum = samples.iter().sum::<f64>().max(f64::MIN_POSITIVE);
            data.extend(samples.iter().map(|v| (v / sum) as f32));
            captured.push(*kept);
        }
    }
    let captured = captured.iter().any(|v| *v < 1.0).then_some(captured);
    Ok(PsfGrid { heights_mm, wavelengths_nm, size, spacing_um, data, captured, between: None })
}

/// A PSF file: NPY by its extension, text otherwise.
fn load(path: &Path) -> Result<PsfListing> {
    if !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npy")) {
        return listing::psf(&read_text(path)?);
    }
    let bytes = std::fs::read(path).map_err(|e| Error::io("read", path, e))?;
    let bad = |what: String| Error::input(what).help("a PSF is an n x n array of f4 or f8");
    let file = &mut &bytes[..];
    let header = npy::Header::read(file)?;
    let [rows, columns] = header.shape[..] else {
        return Err(bad(format!("array of shape {:?}", header.shape)));
    };
    let length = bytes.len() as u64;
    let data: Vec<f64> = match header.descr.ends_with("f8") {
        true => header.samples(file, length)?,
        false => header.samples::<f32>(file, length)?.into_iter().map(f64::from).collect(),
    };
    if let Some(v) = data.iter().find(|v| !v.is_finite() || **v < 0.0) {
        return Err(bad(format!("PSF value {v}")));
    }
    Ok(PsfListing::bare([rows, columns], data))
}
