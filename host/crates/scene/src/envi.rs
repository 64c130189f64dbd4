//! ENVI cubes: a text header `.hdr` beside a raw data file.
//!
//! Format: the ENVI header description of NV5 Geospatial (keys `samples`, `lines`, `bands`, `data
//! type`, `interleave`, `byte order`, `header offset`, `wavelength`, `wavelength units`,
//! `reflectance scale factor`, `data gain values`, `data offset values`, `bbl`, `data ignore
//! value`). The reader takes interleave bsq, bil and bip, both byte orders and
//! data types 1 to 5 and 12 to 15. The writer makes bsq of little-endian floats, with the
//! additional key `quantity`.

use super::Quantity;
use super::cube::Cube;
use super::selection::Stated;
use super::sidecar::{Own, Sidecar};
use super::strided::{Bytes, Layout, Sample, Strided};
use camrig_base::{Bands, Error, Plane, Result};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Opens the cube whose header is `path`.
pub(super) fn open(path: &Path, sidecar: &Sidecar) -> Result<Cube> {
    let text = std::fs::read(path).map_err(|e| Error::io("read", path, e))?;
    let header = Header::parse(&String::from_utf8_lossy(&text))?;
    let [width, height, bands] =
        [header.size("samples")?, header.size("lines")?, header.size("bands")?];
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
    let sample = match header.size("data type")? {
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
    };
    let offset = header.text("header offset").map_or(Ok(0), |_| header.size("header offset"))?;
    let big_endian = header.text("byte order") == Some("1");
    let reflectance_scale = header.number("reflectance scale factor")?;
    let scale = sidecar.scale.unwrap_or(reflectance_scale.map_or(1.0, |s| 1.0 / s) as f32);
    let data = data_file(path)?;
    let mut understood =
        vec![format!("ENVI, {axes} from slowest to fastest, {sample:?}, in {}", data.display())];
    if let (Some(s), None) = (reflectance_scale, sidecar.scale) {
        understood.push(format!("reflectance scale factor {s}: samples times {scale}"));
    }
    for key in ["data gain values", "data offset values"] {
        understood.extend(header.text(key).map(|_| format!("{key}, band by band")));
    }
    let own = Own {
        nm: header.wavelengths()?,
        quantity: header.text("quantity").and_then(Quantity::parse),
        stated: header.stated(scale)?,
        understood,
        notes: header.ignored().into_iter().collect(),
        ..Own::default()
    };
    let data = Bytes::File(data);
    let layout = Layout::packed(axes, lengths)?;
    let cube = Strided::new(data, offset as u64, sample, big_endian, layout, scale)?;
    sidecar.cube(Box::new(cube), own)
}

/// The data file of a header: its name without `.hdr`, or with one of the usual extensions.
fn data_file(header: &Path) -> Result<PathBuf> {
    let bare = header.with_extension("");
    let endings = ["img", "dat", "raw", "bsq", "bil", "bip", "bin", "cube"];
    let mut candidates = vec![bare.clone()];
    for ending in endings {
        candidates.push(bare.with_extension(ending));
        candidates.push(bare.with_extension(ending.to_uppercase()));
    }
    let found = candidates.into_iter().find(|candidate| candidate.is_file());
    found.ok_or_else(|| {
        Error::input(format!("no data file {} (.img, .dat, .raw, ...)", bare.display()))
            .help("the data file lies beside the header and has its name")
    })
}

/// Keys that the reader uses, or that say nothing of the samples.
const KNOWN: &[&str] = &[
    "samples",
    "lines",
    "bands",
    "data type",
    "interleave",
    "byte order",
    "header offset",
    "wavelength",
    "wavelength units",
    "reflectance scale factor",
    "data gain values",
    "data offset values",
    "bbl",
    "data ignore value",
    "quantity",
    "description",
    "file type",
    "fwhm",
    "band names",
    "default bands",
    "sensor type",
    "map info",
    "coordinate system string",
    "acquisition time",
    "x start",
    "y start",
    "z plot titles",
    "z plot range",
    "default stretch",
    "geo points",
    "projection info",
    "cloud cover",
    "sun azimuth",
    "sun elevation",
];

/// Speed of light in nm · GHz (exact by the SI's definition of the metre).
const LIGHT_NM_GHZ: f64 = 299_792_458.0;

struct Header(BTreeMap<String, String>);

impl Header {
    /// `key = value` lines after a first line `ENVI`; a value in braces may span lines.
    fn parse(text: &str) -> Result<Self> {
        // A byte order mark, which some editors put before UTF-8.
        let mut lines = text.trim_start_matches('\u{feff}').lines().enumerate();
        if lines.next().is_none_or(|(_, first)| first.trim() != "ENVI") {
            return Err(Error::input("the first line is not ENVI").help("this is no ENVI header"));
        }
        let mut keys = BTreeMap::new();
        while let Some((number, line)) = lines.next() {
            let Some((key, value)) = line.split_once('=') else { continue };
            let mut value = value.trim().to_string();
            while value.starts_with('{') && !value.contains('}') {
                let Some((_, next)) = lines.next() else {
                    return Err(Error::input(format!("no closing brace for {:?}", key.trim()))
                        .at(format!("line {}", number + 1)));
                };
                value.push(' ');
                value.push_str(next);
            }
            keys.insert(key.trim().to_ascii_lowercase(), value);
        }
        Ok(Self(keys))
    }

    fn text(&self, key: &str) -> Option<&str> {
        self.0.get(key).map(String::as_str)
    }

    fn number(&self, key: &str) -> Result<Option<f64>> {
        let Some(text) = self.text(key) else { return Ok(None) };
        match text.parse() {
            Ok(number) if number > 0.0 => Ok(Some(number)),
            _ => Err(Error::input(format!("{key} = {text}")).help("give a positive number")),
        }
    }

    fn size(&self, key: &str) -> Result<usize> {
        let text = self.text(key).ok_or_else(|| Error::input(format!("no key {key:?}")))?;
        text.parse()
            .map_err(|_| Error::input(format!("{key} = {text}")).help("give a whole number"))
    }

    /// A list of numbers in braces; a comma behind the last is no further entry.
    fn list(&self, key: &str) -> Result<Option<Vec<f64>>> {
        let Some(text) = self.text(key) else { return Ok(None) };
        let text = text.trim_matches(['{', '}', ' ']).trim_end_matches([',', ' ']);
        let numbers = text.split(',').map(str::trim);
        let number =
            |n: &str| n.parse().map_err(|_| Error::input(format!("{key} {n:?} is no number")));
        numbers.map(number).collect::<Result<Vec<f64>>>().map(Some)
    }

    /// Keys that the reader does not know, most of which say where and when the scene was taken.
    fn ignored(&self) -> Option<String> {
        let unknown: Vec<&str> =
            self.0.keys().map(String::as_str).filter(|key| !KNOWN.contains(key)).collect();
        (!unknown.is_empty())
            .then(|| format!("keys of the header that were not used: {}", unknown.join(", ")))
    }

    fn wavelengths(&self) -> Result<Option<Vec<f64>>> {
        let Some(list) = self.list("wavelength")? else { return Ok(None) };
        let units = self.text("wavelength units").unwrap_or("").trim().to_lowercase();
        let to_nm: fn(f64) -> f64 = match units.as_str() {
            "nanometers" | "nanometres" | "nanometer" | "nm" => |nm| nm,
            "micrometers" | "micrometres" | "micrometer" | "microns" | "um" | "µm" => {
                |um| um * 1e3
            }
            "angstroms" | "angstrom" => |angstroms| angstroms * 0.1,
            "wavenumber" => |per_cm| 1e7 / per_cm,
            "ghz" => |ghz| LIGHT_NM_GHZ / ghz,
            "" | "unknown" if list[0] < 100.0 => |um| um * 1e3,
            "" | "unknown" => |nm| nm,
            other => {
                return Err(Error::unsupported(format!("wavelength units = {other}")).help(
                    "write the wavelengths in nanometres or micrometres, or give wavelength_nm",
                ));
            }
        };
        Ok(Some(list.into_iter().map(to_nm).collect()))
    }

    /// What is said of the bands. Samples come multiplied by `scale`, which is for what gain and
    /// offset make of them.
    fn stated(&self, scale: f32) -> Result<Stated> {
        let offset = self.list("data offset values")?;
        let good = self.list("bbl")?.map(|list| list.iter().map(|v| *v != 0.0).collect());
        let ignored = match self.text("data ignore value") {
            Some(text) => Some(text.parse::<f32>().map(|v| v * scale).map_err(|_| {
                Error::input(format!("data ignore value = {text}")).help("give a number")
            })?),
            None => None,
        };
        Ok(Stated {
            gain: self.list("data gain values")?,
            offset: offset.map(|list| list.iter().map(|v| v * f64::from(scale)).collect()),
            good,
            ignored,
        })
    }
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
    use crate::{Grid, open};

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

    #[test]
    fn wrong_headers_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("cube.hdr");
        std::fs::write(dir.path().join("cube"), [0; 23]).unwrap();
        let good = "ENVI\nsamples = 3\nlines = 2\nbands = 4\ndata type = 1\nstart\n\
                    wavelength = {400, 500, 600, 700}\n";
        let message = |text: &str| {
            std::fs::write(&path, text).unwrap();
            open(path.to_str().unwrap()).err().unwrap().to_string()
        };
        assert!(message(good).contains("23 bytes of data where 24"));
        assert!(message(&good.replace("ENVI", "IVNE")).contains("no ENVI header"));
        assert!(message(&good.replace("bands = 4", "")).contains("no key \"bands\""));
        assert!(message(&good.replace("type = 1", "type = 6")).contains("data type = 6"));
        assert!(message(&good.replace("= 3", "= many")).contains("samples = many"));
        assert!(message(&good.replace('}', "")).contains("closing brace"));
        std::fs::write(dir.path().join("cube"), [0; 24]).unwrap();
        assert!(message(&good.replace(", 700", "")).contains("3 wavelengths for 4 bands"));
        std::fs::remove_file(dir.path().join("cube")).unwrap();
        assert!(message(good).contains("no data file"));
    }

    #[test]
    fn gains_offsets_bad_bands_and_missing_data_count() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("cube.hdr");
        // Reflectance 0.1, 0.2, 0.3, 0.4 from 400 to 700 nm as 2 sample - 0.1; one sample of 255.
        std::fs::write(path.with_extension("IMG"), [10, 15, 20, 25, 10, 15, 255, 25]).unwrap();
        let header = "\u{feff}ENVI\nsamples = 1\nlines = 2\nbands = 4\ndata type = 1\n\
                      interleave = bip\nwavelength = {400, 500, 600, 700,\n}\n\
                      data gain values = {0.02, 0.02, 0.02, 0.02}\n\
                      data offset values = {-0.1, -0.1, -0.1, -0.1}\n\
                      data ignore value = 255\nbbl = {1, 0, 1, 1}\n";
        std::fs::write(&path, header).unwrap();
        let scene = open(path.to_str().unwrap()).unwrap();
        assert_eq!(scene.notes().len(), 2, "{:?}", scene.notes());
        let grid = Grid { width: 1, height: 2, left: -0.5, top: -1.0, cell: 1.0 };
        // The bad band at 500 nm lies between its neighbours: on the line, as the truth does.
        for (band, expected) in [(10, [0.2, 0.05]), (25, [0.35, 0.2])] {
            let plane = scene.plane(band, &grid).unwrap();
            for (got, expected) in plane.data.iter().zip(expected) {
                assert!((got - expected).abs() < 1e-6, "{band}: {got} for {expected}");
            }
        }
    }
}
