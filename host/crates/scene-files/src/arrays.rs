//! Cubes from files of named arrays: MATLAB (versions 5 and 7.3) and HDF5.
//!
//! The cube is the array that the user names, or the only one of three axes, or that of a public
//! set's layout ([`LAYOUTS`]). A list of as many wavelengths as there are bands (`bands`, `wave`,
//! `wavelength`, ...) gives them and tells which axis is theirs; otherwise the axes are rows,
//! columns, bands, in the order in which MATLAB or h5py show them.

use super::cube::{BandSource, Cube};
use super::selection::Stated;
use super::sidecar::{Own, Sidecar};
use super::strided::{Bytes, Layout, Strided, three_axes};
use super::{hdf5, isetcam, matlab, units};
use camrig_base::unit::Unit;
use camrig_base::{Error, Result};
use std::path::Path;

/// Layouts of public sets: name of the array, bands, first wavelength (nm) where the files do not
/// say it, and whose set it is. Steps are 10 nm.
const LAYOUTS: &[(&str, usize, f64, &str)] = &[
    ("reflectances", 33, 400.0, "as in the set of Foster et al. of 2004"),
    ("hsi", 33, 400.0, "as in the set of Foster et al. of 2015"),
    ("ref", 31, 420.0, "as in Harvard's set (Chakrabarti and Zickler 2011)"),
    ("S", 31, 420.0, "as in TokyoTech's set"),
    ("S", 59, 420.0, "as in TokyoTech's set with near infrared"),
    ("rad", 31, 400.0, "as in ICVL's set (Arad and Ben-Shahar 2016)"),
    ("cube", 31, 400.0, "as in ARAD's sets (NTIRE 2020, 2022)"),
];

/// Parts of the names of lists of wavelengths.
const WAVELENGTH_NAMES: [&str; 7] = ["wave", "wl", "wvl", "lambda", "band", "nm", "list_cw"];
/// Whole names of such lists: as parts they may be those of places in the picture.
const CENTRES: [&str; 4] = ["center", "centers", "centre", "centres"];
/// Parts of the names of other lists: of the widths of bands, of wavenumbers.
const OTHER_NAMES: [&str; 3] = ["fwhm", "width", "number"];
/// Band centres in nm and in µm, to tell lists of wavelengths from lists of indices.
const NM: std::ops::RangeInclusive<f64> = 200.0..=3000.0;
const UM: std::ops::RangeInclusive<f64> = 0.2..=3.0;
/// Most entries of a list of wavelengths.
const MAX_BANDS: usize = 1 << 16;
/// Bands beyond which a last axis is more likely one of pixels, where the first is shorter.
const MANY_BANDS: usize = 300;

/// Attributes of packed samples in the CF conventions (1.11, section 8.1 and 2.5.1): gain, offset
/// and two names of the sample that means no data.
const CF: [&str; 4] = ["scale_factor", "add_offset", "_FillValue", "missing_value"];

/// A file of named arrays.
struct Arrays<'a> {
    path: &'a Path,
    kind: Kind,
    /// Names and shapes, as the file's own program shows them.
    list: Vec<(String, Vec<usize>)>,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Matlab5,
    Matlab73,
    Hdf5,
}

/// Whether a file is HDF5, whatever its name: NetCDF-4 and products of instruments are, too.
pub(super) fn is_hdf5(path: &Path) -> bool {
    super::starts_with(path, b"\x89HDF\r\n\x1a\n")
}

/// Opens a `.mat` or `.h5` file.
pub(super) fn open(path: &Path, sidecar: &Sidecar) -> Result<Cube> {
    let arrays = Arrays::of(path)?;
    let has = |name: &str| arrays.list.iter().any(|(n, _)| n == name);
    if sidecar.array.is_none() && (has("photons") || has("mcCOEF")) {
        return isetcam::open(path, sidecar);
    }
    let (name, shape) = choose(&arrays.list, sidecar.array.as_deref())?;
    let lengths = three_axes(name, shape)?;
    let wavelengths =
        wavelengths(&arrays.list, &lengths, sidecar, |name| arrays.list_of(name, sidecar))?;
    let stated = arrays.stated_wavelengths(name)?;
    let of_attribute = |attribute: &hdf5::Attribute| {
        let nm = match &attribute.numbers {
            Some(list) => in_nm(&attribute.name.to_lowercase(), list),
            None => units::wavelengths_in(names_in(&attribute.texts)).ok().flatten(),
        };
        let nm = nm.filter(|nm| lengths.contains(&nm.len()))?;
        Some((attribute.name.clone(), nm))
    };
    let of_attribute = match &wavelengths {
        Some(_) => None,
        None => stated.iter().find_map(of_attribute),
    };
    let used_attribute = of_attribute.as_ref().map(|(name, _)| name.clone());
    let wavelengths =
        wavelengths.or(of_attribute.map(|(name, nm)| (format!("attribute {name}"), nm)));
    let axes = match (&sidecar.axes, &wavelengths) {
        (Some(axes), _) => axes.clone(),
        (None, Some((_, nm))) => axes_of(name, &lengths, nm.len())?.to_string(),
        (None, None) if lengths[2] > MANY_BANDS && lengths[0] < lengths[2] => {
            return Err(
                Error::input(format!("array {name:?} of shape {lengths:?}")).help(NAME_THE_AXES)
            );
        }
        (None, None) => "yxb".into(),
    };
    let kind = ["MATLAB 5", "MATLAB 7.3", "HDF5"][arrays.kind as usize];
    let understood = vec![format!("{kind}, array {name:?} of {lengths:?}, axes {axes}")];
    let is_list = |numbers: &usize| *numbers > 1;
    let of_attributes = stated.iter().filter(|of| {
        of.numbers.as_ref().map_or(!of.texts.is_empty(), |list| is_list(&list.len()))
    });
    let named = |(name, shape): &&(String, Vec<usize>)| {
        word_of_wavelengths(name).is_some() && shape.iter().any(is_list)
    };
    let of_arrays = arrays.list.iter().filter(|of| of.0 != name).filter(named);
    let mut others = of_attributes.map(|of| &of.name).chain(of_arrays.map(|(name, _)| name));
    let other_wavelengths = others.next().cloned();
    let mut own = Own { understood, other_wavelengths, ..Own::default() };
    let scale = arrays.quantity(name, used_attribute.as_deref(), sidecar, &mut own)?;
    let source = arrays.cube(name, shape, &axes)?;
    let bands = source.bands();
    let packed = arrays.packing(name, bands, sidecar, &mut own)?;
    own.stated = Stated { scale, ..packed };
    let wavelengths = wavelengths.filter(|(_, nm)| nm.len() == bands);
    own.understood.extend(wavelengths.iter().map(|(of, _)| format!("wavelengths from {of:?}")));
    own.usual = usual(name, bands);
    if own.usual.is_none() && wavelengths.is_none() && name == "reflectances" && bands == 31 {
        sidecar.given(bands).ok_or_else(|| {
            Error::input("the wavelengths of the 31 bands are not known").help(
                "the scenes of Foster et al. of 2002 begin at 410 nm: give start_nm=410,step_nm=10",
            )
        })??;
    }
    let used = wavelengths.as_ref().map(|(of, _)| of.clone());
    let left: Vec<&str> = arrays.list.iter().map(|(n, _)| n.as_str()).collect();
    let left: Vec<&str> =
        left.into_iter().filter(|n| *n != name && used.as_deref() != Some(n)).collect();
    if !left.is_empty() {
        own.notes.push(format!("arrays that were not used: {}", left.join(", ")));
    }
    own.nm = wavelengths.map(|(_, nm)| nm);
    sidecar.cube(source, own)
}

fn usual(name: &str, bands: usize) -> Option<(f64, String)> {
    let found = LAYOUTS.iter().find(|(n, count, ..)| *n == name && *count == bands);
    found.map(|(_, _, start, of)| (*start, of.to_string()))
}

/// What to say where the axes of an array can be taken in several ways.
const NAME_THE_AXES: &str = "name the order of its axes: axes=yxb is rows, columns, bands";

/// The order of the axes of an array of which one has `bands` entries.
///
/// # Errors
/// Several axes that have.
pub(super) fn axes_of(name: &str, lengths: &[usize; 3], bands: usize) -> Result<&'static str> {
    if bands > 1 && lengths.iter().filter(|&&n| n == bands).count() > 1 {
        return Err(Error::input(format!(
            "array {name:?} of shape {lengths:?} has several axes as long as its {bands} \
             wavelengths"
        ))
        .help(NAME_THE_AXES));
    }
    Ok(match lengths.iter().rposition(|&n| n == bands) {
        Some(0) => "byx",
        Some(1) => "ybx",
        _ => "yxb",
    })
}

/// The array that holds the cube.
pub(super) fn choose<'a>(
    list: &'a [(String, Vec<usize>)],
    wanted: Option<&str>,
) -> Result<(&'a str, &'a [usize])> {
    let cubes = list.iter().filter(|(name, shape)| three_axes(name, shape).is_ok());
    let mut cubes: Vec<_> = cubes.filter(|(_, shape)| !shape.contains(&0)).collect();
    if cubes.len() > 1 {
        // Pictures of three colours next to the cube.
        let named = |name: &str| {
            let name = name.to_lowercase();
            ["rgb", "preview", "thumb", "picture", "color"].iter().any(|w| name.contains(w))
        };
        cubes.retain(|(name, shape)| !(shape.contains(&3) && named(name)));
    }
    let last = |name: &str| name.rsplit('/').next().unwrap_or(name).to_string();
    let chosen = match wanted {
        Some(wanted) => list.iter().find(|(n, _)| n == wanted || last(n) == wanted),
        None if cubes.len() == 1 => Some(cubes[0]),
        None => {
            let known = |n: &str| LAYOUTS.iter().any(|(layout, ..)| *layout == n);
            let mut known = cubes.into_iter().filter(|(n, _)| known(n));
            known.next().filter(|_| known.next().is_none())
        }
    };
    if list.is_empty() {
        return Err(Error::input("no array of numbers at the file's top").help(
            "save the cube as an array of its own, not within a struct or cell, and not as a \
                 link to another file",
        ));
    }
    let Some((name, shape)) = chosen else {
        let all: Vec<String> = list.iter().map(|(n, shape)| format!("{n} {shape:?}")).collect();
        let what = wanted.map_or("no single array of rows, columns and bands".into(), |n| {
            format!("no numeric array {n:?}")
        });
        return Err(Error::input(what)
            .help(format!("name one with array=NAME; the file has {}", all.join(", "))));
    };
    Ok((name, shape))
}

/// The name of the one cube with the most bands, where a list has an entry for each of them.
pub(super) fn of_most_wavelengths(list: &[(String, Vec<usize>)]) -> Option<&str> {
    let bands = |shape: &[usize]| shape.last().copied().unwrap_or(0);
    let cubes = || list.iter().filter(|(name, shape)| three_axes(name, shape).is_ok());
    let most = cubes().map(|(_, shape)| bands(shape)).max()?;
    let has_list = list
        .iter()
        .any(|(name, shape)| shape[..] == [most] && word_of_wavelengths(name).is_some());
    let mut of_most = cubes().filter(|(_, shape)| bands(shape) == most);
    of_most.next().filter(|_| of_most.next().is_none() && has_list).map(|(name, _)| &name[..])
}

/// The last part of an array's name, in small letters, if it may be of a list of wavelengths.
fn word_of_wavelengths(name: &str) -> Option<String> {
    let word = name.rsplit('/').next().unwrap_or(name).to_lowercase();
    let has = |parts: &[&str]| parts.iter().any(|part| word.contains(part));
    let may_be = has(&WAVELENGTH_NAMES) || CENTRES.contains(&&*word);
    (may_be && !has(&OTHER_NAMES)).then_some(word)
}

/// Refuses wavelengths among arrays that are not of numbers.
pub(super) fn refuse_wavelengths_in(names: &[String]) -> Result<()> {
    let found = names.iter().find(|name| word_of_wavelengths(name).is_some());
    found.map_or(Ok(()), |name| {
        Err(Error::input(format!("{name:?} is not of numbers, and not understood")).help(
            "save wavelengths as numbers in nm; or give wavelength_nm, or start_nm, step_nm",
        ))
    })
}

/// The list of wavelengths (nm) among the arrays of a `list` for one of a cube's axes, or for that
/// of its bands where the user names the axes; and the list's name. `numbers` reads an array.
pub(super) fn wavelengths(
    list: &[(String, Vec<usize>)],
    lengths: &[usize; 3],
    sidecar: &Sidecar,
    mut numbers: impl FnMut(&str) -> Result<Option<Vec<f64>>>,
) -> Result<Option<(String, Vec<f64>)>> {
    let of_bands = sidecar.axes.as_ref().and_then(|axes| lengths.get(axes.find('b')?));
    let fits = |shape: &[usize]| {
        let count = shape.iter().fold(1usize, |n, &length| n.saturating_mul(length));
        let one_axis = shape.iter().filter(|&&n| n != 1).count() <= 1;
        let fits = of_bands.map_or(lengths.contains(&count), |n| *n == count);
        one_axis && count <= MAX_BANDS && fits
    };
    let mut named = Vec::new();
    for (name, _) in list.iter().filter(|(_, shape)| fits(shape)) {
        named.extend(word_of_wavelengths(name).map(|word| (name, word)));
    }
    // Those that say it before those that may mean it.
    named.sort_by_key(|(_, word)| !word.starts_with("wave"));
    let mut not_read = None;
    for (name, word) in named {
        let Some(list) = numbers(name)? else { continue };
        if let Some(nm) = in_nm(&word, &list) {
            return Ok(Some((name.clone(), nm)));
        }
        if word.contains("wavelength") {
            not_read = not_read.or(Some(name));
        }
    }
    match not_read.filter(|_| sidecar.given(0).is_none()) {
        Some(name) => Err(Error::input(format!("{name:?} is no list of wavelengths in nm or µm"))
            .help(
                "they rise or fall, 200 to 3000 nm; else give wavelength_nm, or start_nm, step_nm",
            )),
        None => Ok(None),
    }
}

/// Wavelengths in nm, where a list of that name holds some: in nm, or in µm unless the name says
/// nm.
pub(super) fn in_nm(name: &str, list: &[f64]) -> Option<Vec<f64>> {
    let all = |step: fn(&[f64]) -> bool| list.windows(2).all(step);
    if !all(|w| w[0] < w[1]) && !all(|w| w[0] > w[1]) {
        return None;
    }
    if list.iter().all(|nm| NM.contains(nm)) {
        return Some(list.to_vec());
    }
    let in_um = !name.contains("nm") && list.iter().all(|um| UM.contains(um));
    in_um.then(|| list.iter().map(|um| um * 1000.0).collect())
}

/// The names in a list of texts, or in one text: between commas or semicolons, else blanks.
fn names_in(texts: &[String]) -> impl Iterator<Item = &str> {
    let one = match texts {
        [one] => &one[..],
        _ => "",
    };
    let mark = |c: char| c == ',' || c == ';';
    let by_marks = one.contains(mark);
    let parts = one.split(move |c: char| if by_marks { mark(c) } else { c.is_whitespace() });
    let parts = parts.map(str::trim).filter(|name| !name.is_empty());
    let several = texts.iter().map(String::as_str).filter(|_| texts.len() > 1);
    several.chain(parts)
}

/// The text of an attribute that names a unit.
fn unit(attribute: &hdf5::Attribute) -> Option<String> {
    let is_unit = ["unit", "units"].contains(&&*attribute.name.to_lowercase());
    attribute.texts.first().cloned().filter(|_| is_unit)
}

impl<'a> Arrays<'a> {
    fn of(path: &'a Path) -> Result<Self> {
        let mat = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mat"));
        if mat && matlab::is_version_5(path)? {
            return Ok(Self { path, kind: Kind::Matlab5, list: matlab::list(path)? });
        }
        let mut list = hdf5::list(path)?;
        // MATLAB stores columns first and shows rows first.
        if mat {
            list.iter_mut().for_each(|(_, shape)| shape.reverse());
        }
        Ok(Self { path, kind: if mat { Kind::Matlab73 } else { Kind::Hdf5 }, list })
    }

    /// The numbers of an array.
    fn numbers_of(&self, name: &str) -> Result<Option<Vec<f64>>> {
        if self.kind == Kind::Matlab5 {
            let found = matlab::read(self.path, &[name])?.pop();
            return Ok(found.and_then(|(_, v)| v.array().map(matlab::Array::numbers)));
        }
        hdf5::numbers(self.path, name).map(Some)
    }

    /// A list that may be of wavelengths: in nm, where its attributes name a unit.
    fn list_of(&self, name: &str, sidecar: &Sidecar) -> Result<Option<Vec<f64>>> {
        let list = self.numbers_of(name)?;
        let unit = self.attributes(name)?.iter().find_map(unit);
        let Some(unit) = unit.filter(|unit| !["", "1"].contains(&unit.trim())) else {
            return Ok(list);
        };
        let parsed = Unit::parse(&unit).ok().filter(|unit| unit.to_nm(1.0).is_some());
        match parsed {
            Some(unit) => {
                Ok(list.map(|list| list.into_iter().filter_map(|v| unit.to_nm(v)).collect()))
            }
            None if sidecar.given(0).is_some() => Ok(None),
            None => Err(Error::input(format!("{name:?} is in {unit:?}")).help(
                "wavelengths are in nm, um, angstrom or cm-1; else give wavelength_nm, or \
                 start_nm, step_nm",
            )),
        }
    }

    /// The attributes of an array of HDF5.
    fn attributes(&self, name: &str) -> Result<Vec<hdf5::Attribute>> {
        match self.kind {
            Kind::Hdf5 => hdf5::attributes(self.path, Some(name)),
            Kind::Matlab5 | Kind::Matlab73 => Ok(Vec::new()),
        }
    }

    /// The attributes of an array and of its file, and its lists of texts, that are wavelengths by
    /// their names, or are names that state some.
    fn stated_wavelengths(&self, name: &str) -> Result<Vec<hdf5::Attribute>> {
        if self.kind != Kind::Hdf5 {
            return Ok(Vec::new());
        }
        let mut all = self.attributes(name)?;
        all.extend(hdf5::attributes(self.path, None)?);
        all.extend(hdf5::text_lists(self.path)?);
        all.retain(|attribute| {
            let states = |name: &str| units::wavelength_in(name).is_some();
            let are_names = names_in(&attribute.texts).filter(|name| states(name)).count() > 1;
            are_names || word_of_wavelengths(&attribute.name).is_some()
        });
        Ok(all)
    }

    /// Finds what the samples are, by the array's name and unit, and what they are multiplied by.
    /// Tells which attributes are not used, beside one that is.
    fn quantity(
        &self,
        name: &str,
        used: Option<&str>,
        sidecar: &Sidecar,
        own: &mut Own,
    ) -> Result<Option<f32>> {
        let mut attributes = self.attributes(name)?;
        let unit = attributes.iter().find_map(unit).filter(|unit| !unit.trim().is_empty());
        own.quantity = units::quantity_of(name, unit.is_some(), sidecar)?;
        let scale = match &unit {
            Some(unit) => {
                attributes.retain(|of| self::unit(of).is_none());
                units::scale("units", unit, sidecar, own).map_err(|e| e.at(format!("{name:?}")))?
            }
            None => None,
        };
        attributes.retain(|of| !CF.contains(&&*of.name) && used != Some(of.name.as_str()));
        if !attributes.is_empty() {
            let names: Vec<String> = attributes.into_iter().map(|of| of.name).collect();
            let names = names.join(", ");
            own.notes.push(format!("attributes of {name:?} that were not used: {names}"));
        }
        Ok(scale)
    }

    /// How the samples of an array are packed, by the CF conventions.
    fn packing(
        &self,
        name: &str,
        bands: usize,
        sidecar: &Sidecar,
        own: &mut Own,
    ) -> Result<Stated> {
        let attributes = self.attributes(name)?;
        let number = |name: &str| {
            let attribute = attributes.iter().find(|attribute| attribute.name == name)?;
            attribute.numbers.as_ref()?.first().copied()
        };
        let [gain, offset, fill, missing] = CF.map(number);
        let ignored = fill.or(missing).map(|value| value as f32);
        let plain = Stated { ignored, ..Stated::default() };
        let (gain, offset) = (gain.unwrap_or(1.0), offset.unwrap_or(0.0));
        if gain == 1.0 && offset == 0.0 {
            return Ok(plain);
        }
        if sidecar.scales_samples() {
            own.notes.push("scale_factor and add_offset give way to the scale given".into());
            return Ok(plain);
        }
        own.understood.push(format!(
            "samples times {gain} plus {offset}, as scale_factor and add_offset say"
        ));
        let all = |value: f64| Some(vec![value; bands]);
        Ok(Stated { gain: all(gain), offset: all(offset), ..plain })
    }

    /// The array as a cube; `axes` in the order of `shape`.
    fn cube(&self, name: &str, shape: &[usize], axes: &str) -> Result<Box<dyn BandSource>> {
        let backwards: String = axes.chars().rev().collect();
        match self.kind {
            Kind::Hdf5 => hdf5::cube(self.path, name, axes),
            Kind::Matlab73 => hdf5::cube(self.path, name, &backwards),
            Kind::Matlab5 => {
                let mut lengths = three_axes(name, shape)?;
                lengths.reverse();
                let found = matlab::read(self.path, &[name])?.pop();
                let Some((_, matlab::Value::Array(array))) = found else {
                    return Err(Error::input(format!("array {name:?} is not of numbers")));
                };
                let layout = Layout::packed(&backwards, lengths)?;
                let bytes = Bytes::Memory(array.bytes);
                Ok(Box::new(Strided::new(bytes, 0, array.sample, false, layout)?))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::{Quantity, open_file};
    use std::path::{Path, PathBuf};
    use tempfile::TempDir;

    fn place(file: &str) -> String {
        let place = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(file);
        place.display().to_string()
    }

    /// Files written by scipy.io and h5py (`tests/data/make.py` holds the formula).
    #[test]
    fn arrays_are_read_by_name_and_layout() {
        for (file, options) in [
            ("array_v5.mat", ""),
            ("array_v5.mat", "array=hsi,"),
            ("array_v73.mat", ""),
            ("array.h5", "array=cube,"),
            ("array.h5", "array=scene/cube,"),
            ("array.h5", "array=other,start_nm=400,step_nm=100,"),
        ] {
            let cube = open_file(&format!("{}:{options}scale=0.001", place(file))).unwrap();
            assert_eq!(cube.size(), (3, 2), "{file} {options}");
            for band in 0..4 {
                let plane = cube.band(10 * band).unwrap();
                for (i, got) in plane.data.iter().enumerate() {
                    let expected = (1 + i % 3 + 3 * (i / 3) + band) as f32 / 10.0;
                    assert!((got - expected).abs() < 1e-6, "{file} {options}: {got}, {expected}");
                }
            }
        }
        let v5 = open_file(&format!("{}:scale=0.001", place("array_v5.mat"))).unwrap();
        let said = crate::Scene::notes(&v5).join("\n");
        assert!(said.contains("not used: rgb, lbl"), "{said}");
        assert!(v5.understood().join("\n").contains("from \"wavelengths\""));
    }

    /// Packed by the CF conventions: 0.1 + 0.001 · 250 = 0.35.
    #[test]
    fn packed_samples_are_unpacked_and_other_attributes_told() {
        use hdf5_pure::AttrValue::{F64, I64};
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cube.nc");
        let mut file = hdf5_pure::FileBuilder::new();
        let samples: Vec<f64> = (0..62).map(|i| if i < 31 { 250.0 } else { -999.0 }).collect();
        file.create_dataset("cube")
            .with_f64_data(&samples)
            .with_shape(&[1, 2, 31])
            .set_attr("scale_factor", F64(0.001))
            .set_attr("add_offset", F64(0.1))
            .set_attr("_FillValue", I64(-999))
            .set_attr("valid_max", I64(999));
        file.write(&path).unwrap();
        let cube = open_file(path.to_str().unwrap()).unwrap();
        let found = &cube.band(0).unwrap().data;
        assert!((found[0] - 0.35).abs() < 1e-6 && found[1] == 0.0, "{found:?}");
        let said = crate::Scene::notes(&cube).join("\n");
        assert!(said.contains("attributes of \"cube\" that were not used: valid_max"), "{said}");
        let scaled = open_file(&format!("{}:scale=0.002", path.display())).unwrap();
        assert!((scaled.band(0).unwrap().data[0] - 0.5).abs() < 1e-6);
        let said = crate::Scene::notes(&scaled).join("\n");
        assert!(said.contains("give way to the scale given"), "{said}");
    }

    /// An array of 1 x 2 x 3 with wavelengths, and units of both.
    fn with_units(name: &str, shape: &[u64], of: [&str; 2], list: &[f64]) -> (PathBuf, TempDir) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cube.h5");
        let unit = |unit: &str| hdf5_pure::AttrValue::String(unit.into());
        let mut file = hdf5_pure::FileBuilder::new();
        let samples = vec![0.5; shape.iter().product::<u64>() as usize];
        let cube = file.create_dataset(name).with_f64_data(&samples).with_shape(shape);
        cube.set_attr("units", unit(of[0]));
        file.create_dataset("wavelength").with_f64_data(list).set_attr("Units", unit(of[1]));
        file.write(&path).unwrap();
        (path, folder)
    }

    #[test]
    fn units_of_attributes_are_followed() {
        let list = [25e3, 2e4, 1e7 / 600.0];
        for (name, unit, quantity, value) in [
            ("cube", "mW/(cm2 sr um)", Quantity::Radiance, 0.005),
            ("cube", "1", Quantity::Reflectance, 0.5),
            ("cube", "%", Quantity::Reflectance, 0.005),
        ] {
            let (path, _folder) = with_units(name, &[1, 2, 3], [unit, "cm-1"], &list);
            let cube = open_file(path.to_str().unwrap()).unwrap();
            assert_eq!(crate::Scene::quantity(&cube), quantity, "{name} in {unit}");
            assert!((cube.band(0).unwrap().data[0] / value - 1.0).abs() < 1e-6, "{name}, {unit}");
            let said = cube.understood().join("\n");
            assert!(said.contains("3 bands, 400 to 600"), "{said}");
        }
        for (name, of, said) in [
            ("reflectance", ["W m-2 sr-1 nm-1", "nm"], "no unit of reflectance"),
            ("Radiance", ["counts", "nm"], "no unit of spectral radiance"),
            ("Radiance", ["", "nm"], "of unknown unit"),
            ("irradiance", ["W m-2 nm-1", "nm"], "irradiance by its name"),
            ("cube", ["1", "furlongs"], "is in \"furlongs\""),
        ] {
            let (path, _folder) = with_units(name, &[1, 2, 3], of, &[400.0, 500.0, 600.0]);
            let error = open_file(path.to_str().unwrap()).err().unwrap().to_string();
            assert!(error.contains(said), "{error}");
        }
    }

    #[test]
    fn attributes_state_wavelengths_or_are_asked_about() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cube.h5");
        let open = |values: Vec<f64>| {
            let mut file = hdf5_pure::FileBuilder::new();
            file.create_dataset("cube").with_f64_data(&[0.5; 31]).with_shape(&[1, 1, 31]);
            file.set_attr("wavelength", hdf5_pure::AttrValue::F64Array(values));
            file.write(&path).unwrap();
            open_file(path.to_str().unwrap())
        };
        let cube = open((0..31).map(|band| 420.0 + 10.0 * f64::from(band)).collect()).unwrap();
        let said = cube.understood().join("\n");
        assert!(said.contains("31 bands, 420 to 720") && said.contains("attribute"), "{said}");
        let error = open(vec![420.0, 720.0]).err().unwrap().to_string();
        assert!(error.contains("\"wavelength\"") && error.contains("start_nm"), "{error}");
        // Names of bands: several texts, or one; without a unit they are asked about.
        let named = |unit: &str, join: Option<&str>| {
            use hdf5_pure::AttrValue::{String as Text, StringArray};
            let names: Vec<String> =
                (0..31).map(|band| format!("B{}{unit}", 420 + 10 * band)).collect();
            let value = join.map_or(StringArray(names.clone()), |by| Text(names.join(by)));
            let mut file = hdf5_pure::FileBuilder::new();
            let cube = file.create_dataset("cube").with_f64_data(&[0.5; 31]);
            cube.with_shape(&[1, 1, 31]).set_attr("band_names", value);
            file.write(&path).unwrap();
            open_file(path.to_str().unwrap())
        };
        for join in [None, Some(","), Some("; "), Some(" ")] {
            let said = named("nm", join).unwrap().understood().join("\n");
            assert!(said.contains("31 bands, 420 to 720"), "{join:?}: {said}");
            let error = named("", join).err().unwrap().to_string();
            assert!(error.contains("\"band_names\""), "{join:?}: {error}");
        }
    }

    #[test]
    fn axes_as_long_as_the_wavelengths_are_not_guessed() {
        let (path, _folder) = with_units("cube", &[2, 3, 2], ["1", "nm"], &[400.0, 500.0]);
        let spec = path.display().to_string();
        let error = open_file(&spec).err().unwrap().to_string();
        assert!(error.contains("as long as its 2 wavelengths") && error.contains("axes=yxb"));
        assert_eq!(open_file(&format!("{spec}:axes=byx")).unwrap().size(), (2, 3));
        for (name, is_list) in [("centre_row", false), ("centres", true), ("band_nm", true)] {
            assert_eq!(super::word_of_wavelengths(name).is_some(), is_list, "{name}");
        }
    }

    #[test]
    fn what_cannot_be_told_is_asked_for() {
        let said = |spec: String| open_file(&spec).err().unwrap().to_string();
        let ambiguous = said(place("array.h5"));
        assert!(ambiguous.contains("array=NAME") && ambiguous.contains("scene/cube [4, 2, 3]"));
        let missing = said(format!("{}:array=cube", place("array_v73.mat")));
        assert!(
            missing.contains("no numeric array \"cube\"") && missing.contains("rad [2, 3, 4]")
        );
        let counts = open_file(&place("array_v73.mat")).unwrap().band(0).err().unwrap();
        assert!(counts.to_string().contains("1/65535"), "{counts}");
    }

    /// Cutting and corrupting a file gives an error or other values, never a panic.
    #[test]
    fn damage_is_survived() {
        let dir = tempfile::tempdir().unwrap();
        for file in ["array_v5.mat", "array_v73.mat", "array.h5"] {
            let whole = std::fs::read(place(file)).unwrap();
            let path = dir.path().join(file);
            let spec = format!("{}:start_nm=400,step_nm=10", path.display());
            let attempt = |bytes: &[u8]| {
                std::fs::write(&path, bytes).unwrap();
                open_file(&spec).and_then(|cube| cube.band(0)).is_err()
            };
            assert!(attempt(&whole[..whole.len() / 2]), "{file}");
            for i in (0..whole.len()).step_by(7) {
                attempt(&whole[..i]);
                let mut damaged = whole.clone();
                damaged[i] ^= 0x5a;
                attempt(&damaged);
            }
        }
    }
}
