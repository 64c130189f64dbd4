//! ENVI cubes: a text header `.hdr` next to a raw data file.
//!
//! Format: the ENVI header description of NV5 Geospatial (keys `samples`, `lines`, `bands`, `data
//! type`, `interleave`, `byte order`, `header offset`, `wavelength`, `wavelength units`,
//! `reflectance scale factor`, `data gain values`, `data offset values`, `bbl`, `data ignore
//! value`). The reader takes interleave bsq, bil and bip, both byte orders and
//! data types 1 to 5 and 12 to 15. The writer makes bsq of little-endian floats, with the
//! additional key `quantity`.

use super::Quantity;
use super::cube::Cube;
use super::envi_header::Header;
use super::sidecar::{Own, Sidecar};
use super::strided::{Bytes, Layout, Sample, Strided};
use super::units::{self, STATE_THE_UNIT};
use camrig_base::{Bands, Error, Plane, Result};
use std::io::Write;
use std::path::{Path, PathBuf};

/// The header beside a data file: `cube.img.hdr` or `cube.hdr` of `cube.img`.
pub(super) fn header_beside(data: &Path) -> Option<PathBuf> {
    let mut appended = data.as_os_str().to_owned();
    appended.push(".hdr");
    let beside = [PathBuf::from(appended), data.with_extension("hdr")];
    beside.into_iter().find(|path| path != data && super::starts_with(path, b"ENVI"))
}

/// Opens the cube whose header or data file is `path`.
pub(super) fn open(path: &Path, sidecar: &Sidecar) -> Result<Cube> {
    sidecar.without(&["axes", "array"], "an ENVI file, whose header says it")?;
    let beside = header_beside(path);
    let (header_file, named) = (beside.as_deref().unwrap_or(path), beside.is_some());
    let text = std::fs::read(header_file).map_err(|e| Error::io("read", header_file, e))?;
    let header = Header::parse(&String::from_utf8_lossy(&text))?;
    let [width, height, bands] =
        [header.size("samples")?, header.size("lines")?, header.size("bands")?];
    header.refuse_other_layouts()?;
    let mut notes: Vec<String> = header.ignored().into_iter().collect();
    if header.text("interleave").is_none() {
        notes.push("the header has no interleave: bsq is assumed".into());
    }
    let (axes, lengths) =
        match header.text("interleave").unwrap_or("bsq").to_ascii_lowercase().as_str() {
            "bsq" => ("byx", [bands, height, width]),
            "bil" => ("ybx", [height, bands, width]),
            "bip" => ("yxb", [height, width, bands]),
            other => {
                return Err(
                    Error::input(format!("interleave = {other}")).help("use bsq, bil or bip")
                );
            }
        };
    let sample = sample_of(&header)?;
    let offset = header.text("header offset").map_or(Ok(0), |_| header.size("header offset"))?;
    let big_endian = big_endian(&header, sample, &mut notes)?;
    let reflectance_scale = header.number("reflectance scale factor")?;
    let data = match named {
        true => path.to_owned(),
        false => data_file(header_file, &mut notes)?,
    };
    let size = lengths.iter().fold(sample.bytes() as u64, |n, &l| n.saturating_mul(l as u64));
    let left = std::fs::metadata(&data)
        .map_or(0, |found| found.len().saturating_sub(size.saturating_add(offset as u64)));
    if left > 0 {
        notes.push(format!("{left} bytes behind the samples that the header states are not used"));
    }
    let mut understood =
        vec![format!("ENVI, {axes} from slowest to fastest, {sample:?}, in {}", data.display())];
    let reflectance_scale = reflectance_scale.filter(|_| !sidecar.scales_samples());
    if let Some(s) = reflectance_scale {
        understood.push(format!("reflectance scale factor {s}: samples times {}", 1.0 / s));
        header.refuse_gains("reflectance scale factor")?;
    }
    for key in ["data gain values", "data offset values"] {
        understood.extend(header.text(key).map(|_| format!("{key}, band by band")));
    }
    let quantity = header.text("quantity").map(|text| {
        Quantity::parse(text).ok_or_else(|| {
            Error::input(format!("quantity = {text}")).help("use reflectance or radiance")
        })
    });
    let (nm, quantity) = (header.wavelengths(&mut notes)?, quantity.transpose()?);
    let title = header.title_of_values().filter(|_| quantity.is_none()).unwrap_or_default();
    let unit = header.unit_of_values().filter(|_| reflectance_scale.is_none());
    let quantity = match quantity {
        Some(quantity) => Some(quantity),
        None => units::quantity_of(title, unit.is_some(), sidecar)?,
    };
    let other_wavelengths = header.other_wavelengths();
    let mut own = Own { nm, quantity, other_wavelengths, understood, notes, ..Own::default() };
    let unit = match unit {
        Some(unit) => units::scale("z plot titles", unit, sidecar, &mut own)?,
        None => None,
    };
    if header.unit_of_values().is_none() {
        refuse_gains_of_unknown_unit(&header, sidecar, quantity)?;
    }
    let unit = unit.or(sidecar.scale).unwrap_or(1.0);
    let scale = (f64::from(unit) / reflectance_scale.unwrap_or(1.0)) as f32;
    own.stated = header.stated(scale)?;
    let data = Bytes::File(data);
    let layout = Layout::packed(axes, lengths)?;
    let cube = Strided::new(data, offset as u64, sample, big_endian, layout)?;
    sidecar.cube(Box::new(cube), own)
}

/// Refuses gains that make radiance of the samples, where nothing says in which unit.
fn refuse_gains_of_unknown_unit(
    header: &Header,
    sidecar: &Sidecar,
    quantity: Option<Quantity>,
) -> Result<()> {
    let is_radiance = sidecar.quantity.or(quantity) == Some(Quantity::Radiance);
    if is_radiance && header.text("data gain values").is_some() && sidecar.scale.is_none() {
        return Err(Error::input("the header gives gains of radiance, and not of which unit")
            .help(format!("{STATE_THE_UNIT}; those of ENVI's own make W/m2/sr/um")));
    }
    Ok(())
}

fn sample_of(header: &Header) -> Result<Sample> {
    Ok(match header.size("data type")? {
        1 => Sample::U8,
        2 => Sample::I16,
        3 => Sample::I32,
        4 => Sample::F32,
        5 => Sample::F64,
        12 => Sample::U16,
        13 => Sample::U32,
        14 => Sample::I64,
        15 => Sample::U64,
        other => {
            return Err(Error::unsupported(format!("data type = {other}"))
                .help("read are 1 to 5 and 12 to 15: real numbers, not the complex of 6 and 9"));
        }
    })
}

fn big_endian(header: &Header, sample: Sample, notes: &mut Vec<String>) -> Result<bool> {
    Ok(match header.text("byte order") {
        Some("0") => false,
        Some("1") => true,
        None if sample.bytes() == 1 => false,
        None => {
            notes.push("the header has no byte order: 0 (little end first) is assumed".into());
            false
        }
        Some(other) => {
            return Err(Error::input(format!("byte order = {other}"))
                .help("use 0 (little end first) or 1 (big end first)"));
        }
    })
}

/// The data file of a header: its name without `.hdr`, or with one of the usual extensions. Notes
/// that there are several.
fn data_file(header: &Path, notes: &mut Vec<String>) -> Result<PathBuf> {
    let bare = header.with_extension("");
    let endings = ["img", "dat", "raw", "bsq", "bil", "bip", "bin", "cube"];
    let candidates = endings.iter().map(|ending| bare.with_extension(ending));
    let mut files = std::iter::once(bare.clone()).chain(candidates).filter(|path| path.is_file());
    let found = files.next();
    if let (Some(first), Some(second)) = (&found, files.next()) {
        notes.push(format!(
            "the samples are those of {}, and {} lies beside the header, too",
            first.display(),
            second.display()
        ));
    }
    // In capitals, or as some file systems leave them.
    let alike = |path: &PathBuf| {
        let ending = path.extension().and_then(|e| e.to_str()).unwrap_or("");
        path.file_stem() == bare.file_stem() && endings.contains(&&*ending.to_ascii_lowercase())
    };
    let listed = || {
        let folder = header.parent().filter(|folder| !folder.as_os_str().is_empty());
        let files = std::fs::read_dir(folder.unwrap_or(Path::new("."))).ok()?;
        files.filter_map(|entry| Some(entry.ok()?.path())).filter(alike).min()
    };
    found.or_else(listed).ok_or_else(|| {
        Error::input(format!("no data file {} (.img, .dat, .raw, ...)", bare.display()))
            .help("the data file lies beside the header and has its name")
    })
}

/// Writes a cube as `STEM.hdr` and `STEM.img`, band by band, in the unit of the quantity. `size`
/// is width and height in pixels.
///
/// # Errors
/// Those of `band`, and files that cannot be written.
pub fn write(
    header: &Path,
    size: (usize, usize),
    bands: &Bands,
    quantity: Quantity,
    mut band: impl FnMut(usize) -> Result<Plane<f32>>,
) -> Result<()> {
    let image = header.with_extension("img");
    let failed = |e: std::io::Error| Error::io("write", &image, e);
    let mut out = std::io::BufWriter::new(std::fs::File::create(&image).map_err(failed)?);
    for index in 0..bands.count {
        for value in band(index)?.data {
            out.write_all(&value.to_le_bytes()).map_err(failed)?;
        }
    }
    out.flush().map_err(failed)?;
    let wavelengths: Vec<String> = bands.centres().map(|nm| nm.to_string()).collect();
    let (units, quantity) = match quantity {
        Quantity::Reflectance => ("1", "reflectance"),
        Quantity::Radiance => ("W/(m^2 sr nm)", "radiance"),
    };
    let text = format!(
        "ENVI\ndescription = {{camrig scene, {quantity} in {units}}}\nsamples = {}\nlines = {}\n\
         bands = {}\nheader offset = 0\nfile type = ENVI Standard\ndata type = 4\n\
         interleave = bsq\nbyte order = 0\nwavelength units = Nanometers\nquantity = {quantity}\n\
         wavelength = {{{}}}\n",
        size.0,
        size.1,
        bands.count,
        wavelengths.join(", ")
    );
    std::fs::write(header, text).map_err(|e| Error::io("write", header, e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::open;
    use camrig_scene::Grid;

    const BANDS: Bands = Bands { start_nm: 400.0, step_nm: 100.0, count: 4 };

    fn value(x: usize, y: usize, band: usize) -> f32 {
        (x + 3 * y) as f32 / 10.0 + band as f32 / 100.0
    }

    fn check(spec: &str) {
        let scene = open(spec).unwrap();
        let grid = Grid { width: 3, height: 2, left: -0.5, top: -1.0 / 3.0, cell: 1.0 / 3.0 };
        // 400, 500, 600, 700 nm; a step of 100 nm becomes 10 nm bands.
        for band in 0..4 {
            let plane = scene.plane(band * 10, &grid).unwrap();
            for (got, expected) in
                plane.data.iter().zip(Plane::from_fn(3, 2, |x, y| value(x, y, band)).data)
            {
                assert!((got - expected).abs() < 1e-6, "{spec}: {got} for {expected}");
            }
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("cube.hdr");
        write(&path, (3, 2), &BANDS, Quantity::Radiance, |band| {
            Ok(Plane::from_fn(3, 2, |x, y| value(x, y, band)))
        })
        .unwrap();
        assert_eq!(open(path.to_str().unwrap()).unwrap().quantity(), Quantity::Radiance);
        check(path.to_str().unwrap());
    }

    #[test]
    fn interleaves_byte_orders_and_types() {
        let dir = tempfile::tempdir().unwrap();
        for (interleave, axes) in [("BSQ", "byx"), ("bil", "ybx"), ("bip", "yxb")] {
            for byte_order in [0, 1] {
                let lengths: Vec<usize> =
                    axes.chars().map(|c| [3, 2, 4]["xyb".find(c).unwrap()]).collect();
                let layout = Layout::packed(axes, [lengths[0], lengths[1], lengths[2]]).unwrap();
                let mut samples = [0u16; 24];
                for band in 0..4 {
                    for y in 0..2 {
                        for x in 0..3 {
                            let index = band * layout.band + y * layout.row + x * layout.column;
                            samples[index] = (value(x, y, band) * 1000.0).round() as u16;
                        }
                    }
                }
                let mut data = vec![0; 7];
                data.extend(samples.iter().flat_map(|s| {
                    if byte_order == 1 { s.to_be_bytes() } else { s.to_le_bytes() }
                }));
                let path = dir.path().join(format!("{interleave}{byte_order}.hdr"));
                std::fs::write(path.with_extension("dat"), data).unwrap();
                let header = format!(
                    "ENVI\nsamples=3\nLines = 2\nbands = 4\nheader offset = 7\ndata type = 12\n\
                     interleave = {interleave}\nbyte order = {byte_order}\n\
                     reflectance scale factor = 1000\nwavelength units = Micrometers\n\
                     wavelength = {{\n 0.4, 0.5,\n 0.6, 0.7}}\n"
                );
                std::fs::write(&path, header).unwrap();
                check(path.to_str().unwrap());
            }
        }
    }
}
