//! Spectral OpenEXR images, one channel per band.
//!
//! Names of channels that are read, in any part and below the name of any layer (`Beauty.S0...`):
//!
//! | name | source | quantity |
//! | --- | --- | --- |
//! | `S0.550,000000nm` | Fichet et al. 2021 | radiance |
//! | `T.550,000000nm` | the same | reflectance |
//! | `545.00-555.00nm` | Mitsuba 0.6: a band from, to | radiance |
//! | `w550nm`, `550nm`, `550` | KAIST's hyperspectral set and others | reflectance |
//! | any, in natural order, where the user gives the wavelengths | Mitsuba 3: specfilm | reflectance |
//!
//! (A. Fichet, R. Pacanowski, A. Wilkie, "An OpenEXR Layout for Spectral Images", JCGT 10(3),
//! 2021.) Decimals have a comma or a point; units are metres or hertz with any prefix (nm, um,
//! THz), and nm where there is none. Stokes components `S1` to `S3` are left out. Channels are
//! decoded one at a time, so a cube needs the memory of one band.

use super::Quantity;
use super::cube::{BandSource, Cube};
use super::rgb::picture::{check_bytes, check_square};
use super::sidecar::{Own, Sidecar};
use super::units;
use ::exr::block::chunk::TileCoordinates;
use ::exr::block::reader::ChunksReader;
use ::exr::block::{self, BlockIndex};
use ::exr::meta::attribute::{AttributeValue, SampleType, Text};
use ::exr::meta::header::Header;
use ::exr::prelude::{MetaData, Vec2, f16};
use camrig_base::unit::Unit;
use camrig_base::{Error, Plane, Result, natural_order};
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

pub(super) fn refused(error: ::exr::error::Error) -> Error {
    let said = format!("not a readable OpenEXR image: {error}");
    if !said.contains("compression") {
        return Error::input(said);
    }
    Error::unsupported(said)
        .help("save it with another compression: none, RLE, ZIP, PIZ, PXR24, B44 and DWA are read")
}

/// Most pixels of a band: 2 GiB of memory.
const MAX_PIXELS: usize = 1 << 29;
/// Fewest bits of a sample: those of halves.
const MIN_BITS: usize = 16;

/// How the channels of a cube are named. Where a file has several, the first is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Naming {
    /// `S0.`: radiance.
    Radiance,
    /// `T.`: reflectance.
    Reflectance,
    /// `545.00-555.00nm`.
    Interval,
    /// A wavelength, perhaps behind a letter.
    Wavelength,
    /// Any names, of bands whose wavelengths the user gives.
    Order,
}

/// The channels of one cube: those of one naming in one layer of one part.
struct Cubes {
    naming: Naming,
    part: usize,
    layer: String,
    /// Wavelength in nm, and the number of the channel in its part.
    bands: Vec<(f64, usize)>,
}

/// Opens the spectral channels of an image.
pub(super) fn open(path: &Path, sidecar: &Sidecar) -> Result<Cube> {
    sidecar.without(&["axes"], "OpenEXR")?;
    let meta = MetaData::read_from_file(path, false).map_err(refused)?;
    let mut cubes = Vec::new();
    let mut others = Vec::new();
    for (part, header) in meta.headers.iter().enumerate() {
        for (index, channel) in header.channels.list.iter().enumerate() {
            let name = channel.name.to_string();
            match spectral(&name).filter(|_| !header.deep && channel.sampling == Vec2(1, 1)) {
                Some((layer, naming, nm)) => put(&mut cubes, (naming, part, layer), (nm, index)),
                None => others.push(name),
            }
        }
    }
    if cubes.is_empty() && sidecar.given(0).is_some() {
        cubes = in_order(&meta);
        others.retain(|name| COLOURS.contains(&after_layer(name)));
    }
    let wanted = sidecar.array.as_deref();
    let named = |cube: &Cubes| {
        let part = part_name(&meta.headers[cube.part]);
        wanted.is_none_or(|wanted| cube.layer == wanted || part.as_deref() == Some(wanted))
    };
    cubes.sort_by_key(|cube| (cube.naming, std::cmp::Reverse(cube.bands.len())));
    let Some(chosen) = cubes.iter().position(named) else {
        return Err(nothing(wanted, &cubes, &others));
    };
    let chosen = cubes.remove(chosen);
    let left = cubes.iter().flat_map(|cube| &cube.bands).count();
    let header = &meta.headers[chosen.part];
    let mut own = about(&chosen, header, left, &others, sidecar)?;
    own.stated.scale = scale(header, sidecar, &mut own)?;
    let (nm, channels): (Vec<f64>, Vec<usize>) = chosen.bands.into_iter().unzip();
    own.nm = (chosen.naming != Naming::Order).then_some(nm);
    let (window, note) = Window::of(path, header, 1, MAX_PIXELS)?.whole_part();
    own.notes.extend(note);
    let source = Channels {
        path: path.into(),
        window,
        part: chosen.part,
        channels,
        types: header.channels.list.iter().map(|c| c.sample_type).collect(),
    };
    sidecar.cube(Box::new(source), own)
}

fn put(cubes: &mut Vec<Cubes>, of: (Naming, usize, String), band: (f64, usize)) {
    let (naming, part, layer) = of;
    let same = |c: &&mut Cubes| (c.naming, c.part, &c.layer) == (naming, part, &layer);
    match cubes.iter_mut().find(same) {
        Some(cube) => cube.bands.push(band),
        None => cubes.push(Cubes { naming, part, layer, bands: vec![band] }),
    }
}

/// Names of channels that are no bands.
const COLOURS: [&str; 8] = ["R", "G", "B", "A", "X", "Y", "Z", "alpha"];

fn after_layer(name: &str) -> &str {
    name.rsplit('.').next().unwrap_or(name)
}

/// The channels of each layer of each part in natural order of their names, as Mitsuba 3's
/// specfilm writes them under names of the user's; without colours, depth and alpha.
fn in_order(meta: &MetaData) -> Vec<Cubes> {
    let mut cubes = Vec::new();
    for (part, header) in meta.headers.iter().enumerate().filter(|(_, header)| !header.deep) {
        let full =
            header.channels.list.iter().enumerate().filter(|(_, c)| c.sampling == Vec2(1, 1));
        let mut names: Vec<_> = full.map(|(index, c)| (c.name.to_string(), index)).collect();
        names.retain(|(name, _)| !COLOURS.contains(&after_layer(name)));
        names.sort_by_cached_key(|(name, _)| natural_order(name));
        for (name, index) in names {
            let layer = name.rsplit_once('.').map_or("", |(layer, _)| layer).to_string();
            put(&mut cubes, (Naming::Order, part, layer), (0.0, index));
        }
    }
    cubes
}

pub(super) fn part_name(header: &Header) -> Option<String> {
    header.own_attributes.layer_name.as_ref().map(Text::to_string)
}

fn nothing(wanted: Option<&str>, cubes: &[Cubes], others: &[String]) -> Error {
    if let (Some(wanted), false) = (wanted, cubes.is_empty()) {
        let layers: Vec<String> = cubes.iter().map(|c| format!("{:?}", c.layer)).collect();
        return Error::input(format!("no spectral channels in a layer or part {wanted:?}"))
            .help(format!("the layers with spectral channels are {}", layers.join(", ")));
    }
    Error::unsupported(format!("no spectral channel among {}", others.join(", "))).help(
        "name channels like S0.550,000000nm (radiance) or T.550,000000nm (reflectance), or R, G, B \
         of one resolution; or give start_nm and step_nm, or wavelength_nm: the channels are then its \
         bands, in natural order of their names",
    )
}

/// What is said of the channels that were chosen, and of the others.
fn about(
    chosen: &Cubes,
    header: &Header,
    left: usize,
    others: &[String],
    sidecar: &Sidecar,
) -> Result<Own> {
    let Cubes { naming, part, layer, bands } = chosen;
    let mut notes = Vec::new();
    let quantity = match naming {
        Naming::Radiance | Naming::Interval => Some(Quantity::Radiance),
        Naming::Reflectance => Some(Quantity::Reflectance),
        Naming::Wavelength | Naming::Order => {
            let first = &header.channels.list[bands[0].1];
            let has_unit = emissive_unit(header).is_some();
            units::quantity_of(&first.name.to_string(), has_unit, sidecar)?
        }
    };
    if quantity.is_none() {
        notes.push(
            "nothing says what its channels hold: reflectance is assumed (quantity=radiance if \
             they are not)"
                .into(),
        );
    }
    if *naming == Naming::Interval {
        notes.push(
            "channels named by intervals are taken as radiance, W m⁻² sr⁻¹ nm⁻¹, as Mitsuba \
             writes them (quantity=reflectance if they are not)"
                .into(),
        );
    }
    if left > 0 {
        notes.push(format!(
            "{left} more spectral channels in other layers, parts or of another kind were not \
             used (array=NAME chooses a layer or part)"
        ));
    }
    if !others.is_empty() {
        notes.push(format!("channels that were not used: {}", others.join(", ")));
    }
    let mut place = format!("part {}", part + 1);
    if let Some(name) = part_name(header) {
        place.push_str(&format!(" {name:?}"));
    }
    if !layer.is_empty() {
        place.push_str(&format!(", layer {layer:?}"));
    }
    let understood = vec![format!("OpenEXR, {place}, channels named by {}", naming.words())];
    Ok(Own { quantity, understood, notes, ..Own::default() })
}

/// What the library of the layout writes for radiance per nm (Fichet et al. 2021).
const LAYOUT_UNIT: &str = "W.m^-2.sr^-1";

/// The unit of radiance that a part states.
fn emissive_unit(header: &Header) -> Option<String> {
    let all = [&header.own_attributes.other, &header.shared_attributes.other];
    let unit = all.iter().find_map(|all| all.get(&Text::from("emissiveUnits")));
    match unit {
        Some(AttributeValue::Text(unit)) => Some(unit.to_string()),
        _ => None,
    }
}

/// What samples are multiplied by: radiance, as its unit demands.
fn scale(header: &Header, sidecar: &Sidecar, own: &mut Own) -> Result<Option<f32>> {
    match (emissive_unit(header), sidecar.quantity.or(own.quantity)) {
        (Some(unit), Some(Quantity::Radiance)) if unit == LAYOUT_UNIT => {
            own.notes.push(format!("emissiveUnits {unit:?} is per nm in this layout"));
            Ok(None)
        }
        (Some(unit), Some(Quantity::Radiance)) => {
            units::scale("emissiveUnits", &unit, sidecar, own)
        }
        _ => Ok(None),
    }
}

impl Naming {
    fn words(self) -> &'static str {
        match self {
            Naming::Radiance => "S0 and wavelength (radiance)",
            Naming::Reflectance => "T and wavelength (reflectance)",
            Naming::Interval => "intervals of wavelength",
            Naming::Wavelength => "wavelength",
            Naming::Order => "the user, in natural order",
        }
    }
}

/// Whether a channel's name is that of a band.
pub(super) fn is_spectral(name: &str) -> bool {
    spectral(name).is_some()
}

/// The layer, naming and wavelength in nm of a channel's name, where it is that of a band.
fn spectral(name: &str) -> Option<(String, Naming, f64)> {
    let starts = std::iter::once(0).chain(name.match_indices('.').map(|(dot, _)| dot + 1));
    let (start, (naming, nm)) = starts.into_iter().find_map(|i| Some((i, band(&name[i..])?)))?;
    let layer = name[..start].trim_end_matches('.');
    let stokes = ["S1", "S2", "S3"].contains(&layer.rsplit('.').next().unwrap_or(""));
    (!stokes).then(|| (layer.to_string(), naming, nm))
}

/// Naming and wavelength in nm of what follows the layer in a channel's name.
fn band(text: &str) -> Option<(Naming, f64)> {
    for (prefix, naming) in [("S0.", Naming::Radiance), ("T.", Naming::Reflectance)] {
        if let Some(nm) = text.strip_prefix(prefix) {
            return Some((naming, wavelength_nm(nm)?));
        }
    }
    if let Some(middle) = text.split_once('-').and_then(|(from, to)| middle_nm(from, to)) {
        return Some((Naming::Interval, middle));
    }
    let number = text.trim_start_matches(|c: char| c.is_alphabetic() || "_ ".contains(c));
    let word = text[..text.len() - number.len()].trim_end_matches(['_', ' ']).to_lowercase();
    let known = ["", "w", "wl", "wave", "wavelength", "lambda", "l", "band", "nm", "spectrum"];
    let nm = wavelength_nm(number).filter(|nm| BARE_NM.contains(nm))?;
    let with_unit = number.ends_with(char::is_alphabetic);
    (with_unit || known.contains(&word.as_str())).then_some((Naming::Wavelength, nm))
}

/// The middle of an interval such as `545.00-555.00nm`, nm.
fn middle_nm(from: &str, to: &str) -> Option<f64> {
    let unit = &to[to.trim_end_matches(char::is_alphabetic).len()..];
    let from_nm = wavelength_nm(from).filter(|_| from.ends_with(char::is_alphabetic));
    let from_nm = from_nm.or_else(|| wavelength_nm(&format!("{from}{unit}")))?;
    Some((from_nm + wavelength_nm(to)?) / 2.0)
}

/// Numbers that are wavelengths where the name says nothing else, nm.
const BARE_NM: std::ops::RangeInclusive<f64> = 200.0..=2500.0;

/// The wavelength in a text such as `550,000000nm` or `545,077THz`, in nm.
fn wavelength_nm(text: &str) -> Option<f64> {
    let last = text.rfind(|c: char| c.is_ascii_digit())?;
    let (number, unit) = text.split_at(last + 1);
    let number: f64 = number.replace(',', ".").parse().ok().filter(|n| *n > 0.0)?;
    if unit.is_empty() {
        return Some(number);
    }
    Unit::parse(unit).ok()?.to_nm(number)
}

/// Where the pixels of a part lie in the image: its data window in the display window, which is
/// what is seen of a picture.
#[derive(Clone, Copy)]
pub(super) struct Window {
    /// Width and height of the image.
    pub size: (usize, usize),
    /// Those of the part.
    stored: (usize, usize),
    /// Column and row of the part's first pixel.
    first: (i64, i64),
}

impl Window {
    /// That of a part with so many channels to be read.
    ///
    /// # Errors
    /// Pixels that are not square; sizes beyond `most` pixels, or that the file's bytes cannot
    /// hold.
    pub fn of(path: &Path, header: &Header, channels: usize, most: usize) -> Result<Self> {
        let shown = header.shared_attributes.display_window;
        let size = (shown.size.width(), shown.size.height());
        let stored = (header.layer_size.width(), header.layer_size.height());
        check_bytes(path, stored, MIN_BITS * channels)?;
        check_bytes(path, size, 1)?;
        for (width, height) in [stored, size] {
            if !width.checked_mul(height).is_some_and(|pixels| (1..=most).contains(&pixels)) {
                return Err(Error::limit(format!("an image of {width} x {height} pixels"))
                    .help(format!("at most {most} pixels are read")));
            }
        }
        check_square("pixelAspectRatio", header.shared_attributes.pixel_aspect.into())?;
        let at = header.own_attributes.layer_position;
        let from = |at: i32, shown: i32| i64::from(at) - i64::from(shown);
        let first = (from(at.x(), shown.position.x()), from(at.y(), shown.position.y()));
        Ok(Self { size, stored, first })
    }

    /// Which pixels the part has, in words; none where they are those of the image.
    fn other_pixels(&self) -> Option<String> {
        let Self { size, stored: (width, height), first: (column, row) } = *self;
        ((size, self.first) != ((width, height), (0, 0)))
            .then(|| format!("its pixels, {width} x {height} from column {column}, row {row} on,"))
    }

    /// What to say where the part is not the image.
    pub fn note(&self) -> Option<String> {
        let (width, height) = self.size;
        self.other_pixels().map(|pixels| {
            format!(
                "{pixels} are not those of its display window of {width} x {height}: black where \
                 there are none, left out beyond it"
            )
        })
    }

    /// The part by itself, as the scene of a cube is all that it holds, and what to say of that.
    fn whole_part(self) -> (Self, Option<String>) {
        let (width, height) = self.size;
        let note = self.other_pixels().map(|pixels| {
            format!("{pixels} are the scene, not its display window of {width} x {height}")
        });
        (Self { size: self.stored, first: (0, 0), ..self }, note)
    }

    /// The image of a plane of the part.
    fn shown(&self, part: Plane<f32>) -> Plane<f32> {
        if (self.size, self.first) == (self.stored, (0, 0)) {
            return part;
        }
        let stored = |at: usize, first: i64, end: usize| {
            usize::try_from(at as i64 - first).ok().filter(|at| *at < end)
        };
        Plane::from_fn(self.size.0, self.size.1, |x, y| {
            let x = stored(x, self.first.0, part.width);
            x.zip(stored(y, self.first.1, part.height)).map_or(0.0, |(x, y)| part.at(x, y))
        })
    }
}

/// Channels of an image, decoded one at a time.
pub(super) struct Channels {
    pub path: PathBuf,
    pub window: Window,
    pub part: usize,
    /// For each band the number of its channel in the part.
    pub channels: Vec<usize>,
    /// For each channel of the part the type of its samples.
    pub types: Vec<SampleType>,
}

impl BandSource for Channels {
    fn size(&self) -> (usize, usize) {
        self.window.size
    }

    fn bands(&self) -> usize {
        self.channels.len()
    }

    fn read(&self, band: usize) -> Result<Plane<f32>> {
        let file = File::open(&self.path).map_err(|e| Error::io("open", &self.path, e))?;
        let channel = self.channels[band];
        let (width, height) = self.window.stored;
        let mut plane = Plane::filled(width, height, 0.0f32);
        let whole = |_: &MetaData, tile: TileCoordinates, block: BlockIndex| {
            block.layer == self.part && tile.is_largest_resolution_level()
        };
        let reader = block::read(BufReader::new(file), false).map_err(refused)?;
        let chunks = reader.filter_chunks(false, whole).map_err(refused)?;
        chunks
            .decompress_parallel(false, |meta, block| {
                for line in block.lines(&meta.headers[self.part].channels) {
                    let at = line.location;
                    if at.channel != channel {
                        continue;
                    }
                    let start = at.position.y() * plane.width + at.position.x();
                    let samples = plane.data.get_mut(start..start + at.sample_count);
                    let samples = samples.ok_or(::exr::error::Error::Invalid("line".into()))?;
                    match self.types[channel] {
                        SampleType::F32 => line.read_samples_into_slice(samples)?,
                        SampleType::F16 => {
                            let halves = line.read_samples::<f16>();
                            for (sample, half) in samples.iter_mut().zip(halves) {
                                *sample = half?.to_f32();
                            }
                        }
                        SampleType::U32 => {
                            for (sample, n) in samples.iter_mut().zip(line.read_samples::<u32>()) {
                                *sample = n? as f32;
                            }
                        }
                    }
                }
                Ok(())
            })
            .map_err(refused)?;
        Ok(self.window.shown(plane))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::open as open_scene;
    use ::exr::prelude::*;
    use camrig_scene::Grid;

    #[test]
    fn spectral_channels_are_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("scene.exr");
        for (prefix, quantity) in [("S0", Quantity::Radiance), ("T", Quantity::Reflectance)] {
            let channels = (0..31).map(|b| {
                let name = format!("{prefix}.{},000000nm", 400 + 10 * b);
                let samples = (0..6).map(|i| i as f32 / 10.0 + b as f32 / 100.0).collect();
                AnyChannel::new(name.as_str(), FlatSamples::F32(samples))
            });
            let mut channels: Vec<_> = channels.collect();
            channels.push(AnyChannel::new("R", FlatSamples::F32(vec![9.0; 6])));
            let layer = Layer::new(
                (3, 2),
                LayerAttributes::named("scene"),
                Encoding::SMALL_LOSSLESS,
                AnyChannels::sort(channels.into()),
            );
            Image::from_layer(layer).write().to_file(&path).unwrap();
            let scene = open_scene(path.to_str().unwrap()).unwrap();
            assert_eq!(scene.quantity(), quantity);
            let grid = Grid { width: 3, height: 2, left: -0.5, top: -1.0 / 3.0, cell: 1.0 / 3.0 };
            let plane = scene.plane(20, &grid).unwrap();
            for (i, got) in plane.data.iter().enumerate() {
                assert!((got - (i as f32 / 10.0 + 0.2)).abs() < 1e-6);
            }
        }
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..100]).unwrap();
        assert!(open_scene(path.to_str().unwrap()).is_err());
        // A header that lies about the size: 20 million columns.
        let name = b"dataWindow\0box2i\0";
        let window = whole.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 4;
        let mut lying = whole.clone();
        lying[window + 8..][..4].copy_from_slice(&20_000_000i32.to_le_bytes());
        std::fs::write(&path, lying).unwrap();
        let error = open_scene(path.to_str().unwrap()).err().unwrap().to_string();
        assert!(error.contains("20000001 x 2 pixels in a file of"), "{error}");
    }

    #[test]
    fn names_in_use_are_understood() {
        for (name, layer, nm) in [
            ("S0.550,5nm", "", 550.5),
            ("T.0.55um", "", 550.0),
            ("Beauty.S0.550,000000nm", "Beauty", 550.0),
            ("View.left.T.550nm", "View.left", 550.0),
            ("S0.545,077196THz", "", 550.0),
            ("S0.5.5e-7m", "", 550.0),
            ("545.00-555.00nm", "", 550.0),
            ("layer.0.545um-0.555um", "layer", 550.0),
            ("w550nm", "", 550.0),
            ("wavelength_550", "", 550.0),
            ("Radiance_550nm", "", 550.0),
            ("cube.550.0", "cube", 550.0),
        ] {
            let (found, _, at) = spectral(name).unwrap_or_else(|| panic!("{name}"));
            assert!((at - nm).abs() < 1e-4 && found == layer, "{name}: {found:?} {at}");
        }
        for name in ["R", "Z", "S1.550nm", "AO_256", "band5", "albedo.B", "S0.x", "depth.Z", "-"] {
            assert!(spectral(name).is_none(), "{name}: {:?}", spectral(name));
        }
    }
}
