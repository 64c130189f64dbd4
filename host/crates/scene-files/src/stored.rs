//! Stored scenes: a directory with
//!
//! - `scene.toml`: name, origin, quantity, size and bands,
//! - `bands.tiff`: one 32-bit float page per band, in order of wavelength,
//! - `preview.png`: a preview under D65.
//!
//! BigTIFF is the most widely read format that can be chunked (strips), compressed (deflate),
//! larger than 4 GiB and read band by band. Values are rounded to 13 significant bits before
//! compression (relative error 1.2e-4, far below the noise of measured scenes), which lets deflate
//! halve the size.

use super::cube::{BandSource, Cube};
use super::images::read_page;
use super::{Beyond, Quantity};
use camrig_base::{Bands, Error, Plane, Result, toml_text};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use tiff::encoder::compression::DeflateLevel;
use tiff::encoder::{Compression, TiffEncoder, colortype};

/// Name of the description in a scene's directory.
pub const DESCRIPTION: &str = "scene.toml";
const DATA: &str = "bands.tiff";
const FORMAT: &str = "scene/1";
/// Rows per strip: 64 rows of a 16-megapixel scene are 1.2 MB, enough for deflate to compress well
/// and little enough to hold in memory.
const STRIP_ROWS: usize = 64;

/// The content of `scene.toml`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Description {
    /// `scene/1`.
    pub format: String,
    /// A short name.
    pub name: String,
    /// What the scene shows.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// Where it comes from.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub source: String,
    /// Terms under which it may be used.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub licence: String,
    /// `reflectance` or `radiance` (W m⁻² sr⁻¹ nm⁻¹).
    pub quantity: String,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Centre of the first band, nm.
    pub start_nm: f64,
    /// Distance of the bands, nm.
    pub step_nm: f64,
    /// Number of bands.
    pub bands: usize,
    /// What lies outside them: `dark` where it says nothing, or `hold` of a reflectance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beyond: Option<String>,
}

impl Description {
    /// A description of a scene's content, `size` being width and height in pixels; description,
    /// source and licence are left empty.
    pub fn new(name: &str, quantity: Quantity, size: (usize, usize), bands: &Bands) -> Self {
        Self {
            format: FORMAT.into(),
            name: name.into(),
            description: String::new(),
            source: String::new(),
            licence: String::new(),
            quantity: quantity.name().into(),
            width: size.0,
            height: size.1,
            start_nm: bands.start_nm,
            step_nm: bands.step_nm,
            bands: bands.count,
            beyond: None,
        }
    }

    /// What it says of the scene, in words.
    fn understood(&self) -> Vec<String> {
        let Self { name, description, source, licence, .. } = self;
        let said = [("", description), ("source: ", source), ("terms: ", licence)];
        let said = said.iter().filter(|(_, text)| !text.is_empty());
        std::iter::once(format!("stored scene {name:?}, samples of 13 significant bits"))
            .chain(said.map(|(what, text)| format!("{what}{text}")))
            .collect()
    }

    /// Reads the description in a scene's directory.
    ///
    /// # Errors
    /// A file that cannot be read or has another format.
    pub fn read(directory: &Path) -> Result<Self> {
        let path = directory.join(DESCRIPTION);
        let description: Self = toml_text::read_file(&path)?;
        if description.format != FORMAT {
            return Err(Error::unsupported(format!("format = {:?}", description.format))
                .at(path.display())
                .help(format!("this program reads {FORMAT}")));
        }
        Ok(description)
    }
}

/// Writes description and bands into an existing directory. `band` fills the plane of each band;
/// the same plane is used for all of them.
///
/// # Errors
/// Those of `band`, and files that cannot be written.
pub fn write(
    directory: &Path,
    description: &Description,
    mut band: impl FnMut(usize, &mut Plane<f32>) -> Result<()>,
) -> Result<()> {
    let path = directory.join(DATA);
    let file = File::create(&path).map_err(|e| Error::io("write", &path, e))?;
    let failed =
        |e: tiff::TiffError| Error::device(format!("cannot write {}: {e}", path.display()));
    let mut encoder = TiffEncoder::new_big(BufWriter::new(file))
        .map_err(failed)?
        .with_compression(Compression::Deflate(DeflateLevel::Fast));
    let mut plane = Plane::filled(description.width, description.height, 0.0);
    for index in 0..description.bands {
        band(index, &mut plane)?;
        plane.data.iter_mut().for_each(|v| *v = round(*v));
        let (width, height) = (plane.width as u32, plane.height as u32);
        let mut page =
            encoder.new_image::<colortype::Gray32Float>(width, height).map_err(failed)?;
        page.rows_per_strip(STRIP_ROWS as u32).map_err(failed)?;
        page.write_data(&plane.data).map_err(failed)?;
    }
    let path = directory.join(DESCRIPTION);
    let text = toml::to_string(description)
        .map_err(|e| Error::input(format!("cannot write {}: {e}", path.display())))?;
    std::fs::write(&path, text).map_err(|e| Error::io("write", &path, e))
}

/// Rounds to 13 significant bits, ties away from zero.
fn round(value: f32) -> f32 {
    const DROPPED: u32 = 23 - 12;
    let rounded = value.to_bits().wrapping_add(1 << (DROPPED - 1)) & !((1 << DROPPED) - 1);
    let rounded = f32::from_bits(rounded);
    if rounded.is_finite() { rounded } else { value }
}

/// Opens a stored scene.
pub(super) fn open(directory: &Path) -> Result<Cube> {
    let about = Description::read(directory)?;
    let place = directory.join(DESCRIPTION);
    let wrong = |what: String| Error::input(what).at(place.display());
    let quantity = Quantity::parse(&about.quantity).ok_or_else(|| {
        wrong(format!("quantity = {:?}", about.quantity)).help("reflectance or radiance")
    })?;
    if about.bands == 0 || about.width == 0 || about.height == 0 {
        return Err(wrong("a scene without pixels or bands".into()));
    }
    let bands = Bands { start_nm: about.start_nm, step_nm: about.step_nm, count: about.bands };
    let source = Pages {
        path: directory.join(DATA),
        size: (about.width, about.height),
        bands: about.bands,
    };
    let cube = Cube::new(Box::new(source), bands.centres().collect(), quantity)
        .map_err(|e| e.at(place.display()))?;
    let beyond = match &about.beyond {
        None => Beyond::default(),
        Some(name) => Beyond::parse(name)
            .ok_or_else(|| wrong(format!("beyond = {name:?}")).help(Beyond::NAMES.join(" or ")))?,
    };
    cube.with(false, about.understood(), Vec::new()).with_beyond(beyond)
}

struct Pages {
    path: PathBuf,
    size: (usize, usize),
    bands: usize,
}

impl BandSource for Pages {
    fn size(&self) -> (usize, usize) {
        self.size
    }

    fn bands(&self) -> usize {
        self.bands
    }

    fn read(&self, band: usize) -> Result<Plane<f32>> {
        let (width, height) = self.size;
        let data = read_page(&self.path, band, width.saturating_mul(height))
            .map_err(|e| e.help("the scene is damaged or cut off; add it to the library again"))?;
        Ok(Plane { width, height, data })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::open as open_scene;
    use camrig_scene::Grid;

    #[test]
    fn what_is_stored_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let value = |x: usize, y: usize, b: usize| ((1 + x + 7 * y) * (b + 1)) as f32 * 1e-3;
        let size = (9, 150);
        let about = Description::new("test", Quantity::Radiance, size, &Bands::VISIBLE);
        let fill = |b: usize, plane: &mut Plane<f32>| {
            *plane = Plane::from_fn(9, 150, |x, y| value(x, y, b));
            Ok(())
        };
        write(dir.path(), &about, fill).unwrap();
        let scene = open_scene(dir.path().to_str().unwrap()).unwrap();
        assert_eq!((scene.bands(), scene.quantity()), (Bands::VISIBLE, Quantity::Radiance));
        let cell = 1.0 / 9.0;
        let grid = Grid { width: 9, height: 150, left: -0.5, top: -75.0 * cell, cell };
        for band in [0, 13, 30] {
            let plane = scene.plane(band, &grid).unwrap();
            let expected = Plane::from_fn(9, 150, |x, y| value(x, y, band));
            for (got, expected) in plane.data.iter().zip(&expected.data) {
                // 13 bits: half a unit of 2^-12.
                assert!((got / expected - 1.0).abs() < 1.3e-4, "{got} for {expected}");
            }
        }
        let data = dir.path().join(DATA);
        let whole = std::fs::read(&data).unwrap();
        std::fs::write(&data, &whole[..whole.len() / 2]).unwrap();
        let message = scene.plane(30, &grid).unwrap_err().to_string();
        assert!(message.contains("bands.tiff") && message.contains("damaged"), "{message}");
    }

    #[test]
    fn rounding_keeps_what_is_exact_and_never_overflows() {
        for exact in [0.0, 1.0, 0.5, 0.18f32.to_bits() as f32, 4096.0, 4095.0] {
            assert!((round(exact) - exact).abs() <= exact * 1.3e-4);
        }
        assert_eq!((round(0.0), round(1.0), round(8191.0)), (0.0, 1.0, 8191.0));
        assert_eq!(round(f32::MAX), f32::MAX);
    }
}
