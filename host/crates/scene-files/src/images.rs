//! Cubes of pictures, one per band: a TIFF with a page per band, or a folder with a PNG or TIFF per
//! band (as in the CAVE set, Yasuma et al. 2010), named by numbers at the end of their names: a
//! wavelength in nm, or the band.

use super::cube::{BandSource, Cube};
use super::rgb::picture::turned;
use super::rgb::read_png::check_band;
use super::sidecar::{Own, Sidecar};
use super::tiff_tags::{Gdal, check_pages, unreadable};
use camrig_base::numbers::counted;
use camrig_base::{Error, Plane, Result};
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;

/// Most pages of a stack.
const MAX_PAGES: usize = 4096;
/// Most pixels of a page: 2 GiB of memory as floats.
const MAX_PIXELS: usize = 1 << 29;
/// Memory that a page may take beyond its samples.
const MARGIN_BYTES: usize = 64 << 20;
/// Numbers at the end of names that are wavelengths, nm.
const NM: std::ops::RangeInclusive<f64> = 200.0..=2500.0;
const COLOUR: &str =
    "a band is a grey picture; one of red, green and blue has no spectra and is no scene";

/// Opens a TIFF: a page per band, or one page with a sample per band in each pixel.
pub(super) fn open_stack(path: &Path, sidecar: &Sidecar) -> Result<Cube> {
    let Pages { size, samples, pages, orientation, gdal, .. } = stack(path)?;
    let (bands, of) = if samples > 1 { (samples, "samples") } else { (pages, "pages") };
    if bands < 2 {
        return Err(Error::input("a single grey picture").help("a scene has a page for each band"));
    }
    let understood = vec![format!("TIFF of {bands} {of}, one per band")];
    let mut own = Own { understood, ..Own::default() };
    gdal.tell(sidecar, &mut own)?;
    if own.nm.as_ref().is_some_and(|nm| nm.len() != bands) {
        let count = own.nm.take().map_or(0, |nm| nm.len());
        own.other_wavelengths = Some(format!("{count} channels of OME-XML"));
    }
    let source = Stack { path: path.into(), size, bands, samples, orientation };
    sidecar.cube(Box::new(source), own)
}

/// Opens a folder of pictures, or the only such folder in it; `None` where there are no pictures.
pub(super) fn open_folder(folder: &Path, sidecar: &Sidecar) -> Result<Option<Cube>> {
    let (mut files, mut folders) = listed(folder)?;
    if files.is_empty() && folders.len() == 1 {
        files = listed(&folders.remove(0))?.0;
    }
    let (mut bands, mut left) = (Vec::new(), Vec::new());
    for file in files {
        match number(&file) {
            Some(n) => bands.push((n, file)),
            None => left.push(file),
        }
    }
    if bands.is_empty() {
        return Ok(None);
    }
    bands.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (numbers, files): (Vec<f64>, Vec<PathBuf>) = bands.into_iter().unzip();
    let named_by_nm = numbers.iter().all(|n| NM.contains(n));
    let steps: Vec<f64> = numbers.windows(2).map(|w| w[1] - w[0]).collect();
    if let Some(i) = steps.iter().position(|&s| if named_by_nm { s <= 0.0 } else { s != 1.0 }) {
        return Err(Error::input(format!("number {} follows {}", numbers[i + 1], numbers[i]))
            .at(folder.display())
            .help(
                "the pictures of a scene have their wavelength in the name (450nm), or end in the \
                 number of the band, none twice or missing",
            ));
    }
    let (size, about) = alike(&files)?;
    let names = if named_by_nm { "wavelengths" } else { "bands" };
    let understood = vec![format!("folder of {} pictures, named by {names}", files.len())];
    let mut notes: Vec<String> = about.into_iter().collect();
    if !left.is_empty() {
        let name = |p: &PathBuf| p.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let left: Vec<String> = left.iter().map(name).collect();
        notes.push(format!("pictures that were not used: {}", left.join(", ")));
    }
    let nm = named_by_nm.then_some(numbers);
    let source = Folder { files, size };
    sidecar.cube(Box::new(source), Own { nm, understood, notes, ..Own::default() }).map(Some)
}

/// The size that all bands of a folder have, and what to say of their samples.
fn alike(files: &[PathBuf]) -> Result<((usize, usize), Option<String>)> {
    let bands = files.iter().map(|file| band_of(file).map_err(|e| e.at(file.display())));
    let bands = bands.collect::<Result<Vec<Band>>>()?;
    let Band { size, kind, .. } = &bands[0];
    for (file, band) in files.iter().zip(&bands) {
        let other = Error::input(match (band.size == *size, band.kind == *kind) {
            (true, true) => continue,
            (false, _) => format!("{:?} pixels where others have {size:?}", band.size),
            (true, false) => format!("{} where others have {kind}", band.kind),
        });
        return Err(other
            .at(file.display())
            .help("all bands are of one size and kind of samples"));
    }
    let mut said = bands.iter().filter_map(|band| band.said.as_ref());
    let first = said.next().map(|first| {
        let count = counted(1 + said.count(), "band");
        format!("{count} not linear by what the file says ({first}): taken as linear all the same")
    });
    Ok((*size, first))
}

/// Whether the pictures of a folder are the bands of a cube.
pub(super) enum Bands {
    /// They are.
    Yes,
    /// They are grey and numbered, and nothing says the wavelengths.
    Perhaps,
    /// They have colours, or no numbers; or there are none.
    No,
}

/// Whether the pictures of a folder, or of the only folder in it, are the bands of a cube, by
/// their colours, their names and what the sidecar and `options` say.
pub(super) fn bands_in(folder: &Path, options: &str) -> Result<Bands> {
    /// Keys that only pictures have.
    const OF_PICTURES: [&str; 4] = ["as", "primaries", "transfer", "white"];
    /// Bands where nothing says their wavelengths.
    const USUAL_BANDS: usize = 31;
    let (mut files, mut folders) = listed(folder)?;
    if files.is_empty() && folders.len() == 1 {
        files = listed(&folders.remove(0))?.0;
    }
    let key = |option: &str| option.split('=').next().unwrap_or("").trim().to_owned();
    let pictures = options.split(',').map(key).any(|key| OF_PICTURES.contains(&key.as_str()));
    let mut numbers: Vec<f64> = files.iter().filter_map(|file| number(file)).collect();
    if pictures || numbers.is_empty() {
        return Ok(Bands::No);
    }
    for file in &files {
        if has_colours(file)? {
            return Ok(Bands::No);
        }
    }
    numbers.sort_by(f64::total_cmp);
    let said = Sidecar::read(folder, options)?.given(numbers.len()).is_some();
    let is_nm = |file: &PathBuf| wavelength(file).is_some();
    // Wavelengths come in steps; frames are numbered by ones.
    let in_steps = numbers.windows(2).all(|w| w[1] - w[0] > 1.0);
    let differ = numbers.windows(2).all(|w| w[1] > w[0]);
    let named_by_nm =
        numbers.iter().all(|n| NM.contains(n)) && (in_steps || differ && files.iter().any(is_nm));
    Ok(if said || named_by_nm || numbers.len() == USUAL_BANDS {
        Bands::Yes
    } else {
        Bands::Perhaps
    })
}

/// Whether a picture has colours: not whether it is stored in channels, as grey ones are too.
fn has_colours(path: &Path) -> Result<bool> {
    if is_png(path) {
        return match png_reader(path)?.info().color_type {
            png::ColorType::Grayscale | png::ColorType::GrayscaleAlpha => Ok(false),
            png::ColorType::Indexed => Ok(true),
            png::ColorType::Rgb | png::ColorType::Rgba => Ok(png_samples(path)?.is_none()),
        };
    }
    let kind = decoder(path, 0)?.colortype().map_err(|e| unreadable(path, e))?;
    Ok(!matches!(kind, tiff::ColorType::Gray(_)))
}

/// The PNG and TIFF files of a folder, and the folders in it.
fn listed(folder: &Path) -> Result<(Vec<PathBuf>, Vec<PathBuf>)> {
    let failed = |e| Error::io("read", folder, e);
    let (mut files, mut folders) = (Vec::new(), Vec::new());
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let picture = is_png(&path) || is_tiff(&path);
        if path.is_dir() {
            folders.push(path);
        } else if picture {
            files.push(path);
        }
    }
    files.sort();
    Ok((files, folders))
}

pub(super) fn has_ending(path: &Path, endings: &[&str]) -> bool {
    path.extension().is_some_and(|e| endings.iter().any(|ending| e.eq_ignore_ascii_case(ending)))
}

fn is_png(path: &Path) -> bool {
    has_ending(path, &["png"])
}

fn is_tiff(path: &Path) -> bool {
    has_ending(path, &["tif", "tiff"])
}

/// The number of a picture's name: a wavelength anywhere in it, else the number at its end.
fn number(path: &Path) -> Option<f64> {
    let stem = path.file_stem()?.to_str()?;
    let digits = stem.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    wavelength(path).or_else(|| stem[digits..].parse().ok())
}

/// The number before `nm` in a picture's name.
fn wavelength(path: &Path) -> Option<f64> {
    let stem = path.file_stem()?.to_str()?;
    stem.match_indices("nm").find_map(|(at, _)| {
        let text = stem[..at].trim_end_matches(['_', ' ']);
        let start = text.trim_end_matches(|c: char| c.is_ascii_digit() || c == '.').len();
        text[start..].trim_start_matches('.').parse().ok()
    })
}

/// A picture that is a band.
struct Band {
    size: (usize, usize),
    /// Its samples, in words.
    kind: String,
    /// What it says of samples that are not linear.
    said: Option<String>,
}

fn band_of(path: &Path) -> Result<Band> {
    if is_png(path) {
        let reader = png_reader(path)?;
        let info = reader.info();
        let size = (info.width as usize, info.height as usize);
        let kind = kind_of(1, info.bit_depth as u8);
        return Ok(Band { size, kind, said: check_band(info)? });
    }
    let Pages { size, kind, samples, pages, orientation, gdal } = stack(path)?;
    if (samples, pages) != (1, 1) {
        return Err(Error::input("more than one page or sample in a pixel").help(COLOUR));
    }
    if orientation != 1 || gdal.changes_samples() {
        return Err(Error::unsupported(
            "a band whose tags turn it (Orientation), scale it (GDAL_METADATA, ImageJ) or say \
             which samples are missing (GDAL_NODATA)",
        )
        .help("save it upright, with its values as samples; or all bands as one TIFF"));
    }
    Ok(Band { size, kind, said: None })
}

/// Samples of a format of TIFF and so many bits, in words.
fn kind_of(format: u16, bits: u8) -> String {
    let kind = match format {
        2 => "signed integers",
        3 => "real numbers",
        _ => "integers",
    };
    format!("{kind} of {bits} bits")
}

fn png_reader(path: &Path) -> Result<png::Reader<BufReader<File>>> {
    let file = File::open(path).map_err(|e| Error::io("open", path, e))?;
    png::Decoder::new(BufReader::new(file))
        .read_info()
        .map_err(|e| Error::input(format!("not a readable PNG: {e}")).at(path.display()))
}

/// The grey picture in a PNG, as counts.
fn read_png(path: &Path) -> Result<Vec<f32>> {
    let coloured =
        || Error::input("a picture of red, green and blue").at(path.display()).help(COLOUR);
    png_samples(path)?.ok_or_else(coloured)
}

/// The grey picture in a PNG, as counts; none where it has colours.
fn png_samples(path: &Path) -> Result<Option<Vec<f32>>> {
    let wrong = |what: String| Error::input(what).at(path.display());
    let mut reader = png_reader(path)?;
    let info = reader.info();
    let pixels = (info.width as usize).checked_mul(info.height as usize);
    if pixels.is_none_or(|n| n > MAX_PIXELS) {
        return Err(Error::limit("a picture of too many pixels").at(path.display()));
    }
    let channels = match (info.color_type, info.bit_depth) {
        (png::ColorType::Grayscale, png::BitDepth::Eight | png::BitDepth::Sixteen) => 1,
        (png::ColorType::GrayscaleAlpha, _) => 2,
        // Some grey pictures are stored in three equal channels, or with an opacity.
        (png::ColorType::Rgb, _) => 3,
        (png::ColorType::Rgba, _) => 4,
        (kind, depth) => return Err(wrong(format!("{kind:?} of {depth:?} bits")).help(COLOUR)),
    };
    let wide = info.bit_depth == png::BitDepth::Sixteen;
    let size = reader.output_buffer_size().ok_or_else(|| wrong("too large".into()))?;
    let mut bytes = vec![0; size];
    reader.next_frame(&mut bytes).map_err(|e| wrong(format!("not a readable PNG: {e}")))?;
    let samples: Vec<f32> = if wide {
        bytes.chunks_exact(2).map(|b| f32::from(u16::from_be_bytes([b[0], b[1]]))).collect()
    } else {
        bytes.iter().map(|&b| f32::from(b)).collect()
    };
    if channels >= 3 && samples.chunks_exact(channels).any(|p| p[0] != p[1] || p[0] != p[2]) {
        return Ok(None);
    }
    Ok(Some(samples.into_iter().step_by(channels).collect()))
}

pub(super) fn decoder(path: &Path, pixels: usize) -> Result<Decoder<BufReader<File>>> {
    let file = File::open(path).map_err(|e| Error::io("open", path, e))?;
    let mut limits = Limits::default();
    // A tile or strip may reach beyond the page.
    limits.decoding_buffer_size = pixels.saturating_mul(8).saturating_add(MARGIN_BYTES);
    limits.intermediate_buffer_size = limits.decoding_buffer_size;
    let failed = |e| unreadable(path, e);
    let mut decoder = Decoder::new(BufReader::new(file)).map_err(failed)?.with_limits(limits);
    let mut tag = |tag| decoder.find_tag_unsigned::<u16>(tag).map_err(failed);
    if tag(Tag::Compression)?.is_none_or(|compression| compression == 1)
        && tag(Tag::Predictor)?.is_some_and(|predictor| predictor > 1)
    {
        return Err(Error::unsupported("a Predictor for samples that are not compressed")
            .at(path.display())
            .help(
                "programs disagree on whether its samples are differences: save it again, \
                 compressed or without a predictor",
            ));
    }
    Ok(decoder)
}

/// The pages of a TIFF, all being alike.
struct Pages {
    /// Size in pixels, as stored.
    size: (usize, usize),
    /// Their samples, in words.
    kind: String,
    samples: usize,
    pages: usize,
    /// How they are turned, 1 to 8 (TIFF 6.0, `Orientation`).
    orientation: u8,
    gdal: Gdal,
}

fn stack(path: &Path) -> Result<Pages> {
    let failed = |e| unreadable(path, e);
    let mut decoder = decoder(path, 0)?;
    let (mut pages, mut gdal) = (0, Gdal::default());
    let first = page_of(&mut decoder, path)?;
    loop {
        let page = page_of(&mut decoder, path)?;
        let Page { size: (width, height), samples, orientation, .. } = page;
        gdal.page(&mut decoder, path, samples)?;
        pages += 1;
        if page != first || (samples > 1 && pages > 1) {
            let (page, first) = (page.words(), first.words());
            return Err(Error::input(format!("page {pages} is of {page}, the first of {first}"))
                .help("all pages are alike: size, kind of samples, one in a pixel, Orientation"));
        }
        if !decoder.more_images() {
            let total = width.checked_mul(height).and_then(|n| n.checked_mul(samples));
            if total.is_none_or(|n| n > MAX_PIXELS) {
                return Err(Error::limit("pages of too many pixels"));
            }
            decoder.seek_to_image(0).map_err(failed)?;
            check_pages(&mut decoder, samples * width * height, pages)?;
            gdal.calibrate(&mut decoder)?;
            let (size, kind) = (page.size, page.kind);
            return Ok(Pages { size, kind, samples, pages, orientation, gdal });
        }
        if pages == MAX_PAGES {
            return Err(Error::limit(format!("more than {MAX_PAGES} pages")));
        }
        decoder.next_image().map_err(failed)?;
    }
}

/// A page of a TIFF.
#[derive(PartialEq)]
struct Page {
    size: (usize, usize),
    samples: usize,
    orientation: u8,
    kind: String,
}

impl Page {
    fn words(&self) -> String {
        let Self { size: (width, height), samples, orientation, kind } = self;
        let samples = counted(*samples, "sample");
        format!("{width} x {height} pixels, {samples} in each, {kind}, Orientation {orientation}")
    }
}

fn page_of(decoder: &mut Decoder<BufReader<File>>, path: &Path) -> Result<Page> {
    let failed = |e| unreadable(path, e);
    let (width, height) = decoder.dimensions().map_err(failed)?;
    let (samples, bits) = match decoder.colortype().map_err(failed)? {
        tiff::ColorType::Gray(bits) => (1, bits),
        tiff::ColorType::Multiband { num_samples, bit_depth } => {
            (usize::from(num_samples), bit_depth)
        }
        other => return Err(Error::input(format!("a picture of {other:?}")).help(COLOUR)),
    };
    let mut tag = |tag| decoder.find_tag_unsigned::<u16>(tag).map_err(failed);
    if tag(Tag::PhotometricInterpretation)? == Some(0) {
        return Err(Error::unsupported("a TIFF in which 0 is white")
            .help("save it with 0 as black (PhotometricInterpretation 1)"));
    }
    if samples > 1 && tag(Tag::PlanarConfiguration)?.is_some_and(|p| p != 1) {
        return Err(Error::unsupported("a TIFF with a plane per sample")
            .help("save it with a page per band"));
    }
    let orientation = tag(Tag::Orientation)?.filter(|n| (1..=8).contains(n)).unwrap_or(1) as u8;
    let mut list = |tag| decoder.find_tag_unsigned_vec::<u16>(tag).map_err(failed);
    // 1 and 2 are kinds of opacity.
    if list(Tag::ExtraSamples)?.unwrap_or_default().iter().any(|kind| [1, 2].contains(kind)) {
        return Err(Error::unsupported("a TIFF of bands with an opacity (alpha, ExtraSamples)")
            .help("save it without alpha, or with 0 in ExtraSamples if it is a band"));
    }
    let format = list(Tag::SampleFormat)?.and_then(|all| all.first().copied()).unwrap_or(1);
    let size = (width as usize, height as usize);
    Ok(Page { size, samples, orientation, kind: kind_of(format, bits) })
}

/// The samples of a page of a TIFF, as stored.
pub(super) fn read_page(path: &Path, page: usize, samples: usize) -> Result<Vec<f32>> {
    let failed = |e| unreadable(path, e);
    let mut decoder = decoder(path, samples)?;
    decoder.seek_to_image(page).map_err(failed)?;
    let data: Vec<f32> = match decoder.read_image().map_err(failed)? {
        DecodingResult::U8(data) => data.into_iter().map(f32::from).collect(),
        DecodingResult::U16(data) => data.into_iter().map(f32::from).collect(),
        DecodingResult::U32(data) => data.into_iter().map(|v| v as f32).collect(),
        DecodingResult::U64(data) => data.into_iter().map(|v| v as f32).collect(),
        DecodingResult::I8(data) => data.into_iter().map(f32::from).collect(),
        DecodingResult::I16(data) => data.into_iter().map(f32::from).collect(),
        DecodingResult::I32(data) => data.into_iter().map(|v| v as f32).collect(),
        DecodingResult::I64(data) => data.into_iter().map(|v| v as f32).collect(),
        DecodingResult::F16(data) => data.into_iter().map(|v| v.to_f32()).collect(),
        DecodingResult::F32(data) => data,
        DecodingResult::F64(data) => data.into_iter().map(|v| v as f32).collect(),
    };
    if data.len() != samples {
        return Err(Error::input(format!("{} samples where {samples} are due", data.len()))
            .at(format!("{}, page {page}", path.display())));
    }
    Ok(data)
}

/// A TIFF with a page per band, or with a sample per band in each pixel.
struct Stack {
    path: PathBuf,
    size: (usize, usize),
    bands: usize,
    samples: usize,
    orientation: u8,
}

impl BandSource for Stack {
    fn size(&self) -> (usize, usize) {
        let (width, height) = self.size;
        if self.orientation > 4 { (height, width) } else { (width, height) }
    }

    fn bands(&self) -> usize {
        self.bands
    }

    fn read(&self, band: usize) -> Result<Plane<f32>> {
        let (width, height) = self.size;
        let (page, first) = if self.samples > 1 { (0, band) } else { (band, 0) };
        let data = read_page(&self.path, page, width * height * self.samples)?;
        let data = data.into_iter().skip(first).step_by(self.samples).collect();
        let ((width, height), data) = turned(self.orientation, self.size, data);
        Ok(Plane { width, height, data })
    }
}

/// A folder with a picture per band.
struct Folder {
    files: Vec<PathBuf>,
    size: (usize, usize),
}

impl BandSource for Folder {
    fn size(&self) -> (usize, usize) {
        self.size
    }

    fn bands(&self) -> usize {
        self.files.len()
    }

    fn read(&self, band: usize) -> Result<Plane<f32>> {
        let (width, height) = self.size;
        let file = &self.files[band];
        let data =
            if is_png(file) { read_png(file)? } else { read_page(file, 0, width * height)? };
        if data.len() != width * height {
            return Err(Error::input("a picture of another size than before").at(file.display()));
        }
        Ok(Plane { width, height, data })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Scene, open_file};
    use tiff::encoder::{TiffEncoder, colortype};

    fn grey(path: &Path, samples: &[u16; 6], kind: png::ColorType) {
        let file = File::create(path).unwrap();
        let mut encoder = png::Encoder::new(file, 3, 2);
        encoder.set_color(kind);
        encoder.set_depth(png::BitDepth::Sixteen);
        let repeat = if kind == png::ColorType::Rgb { 3 } else { 1 };
        let bytes: Vec<u8> = samples.iter().flat_map(|v| v.to_be_bytes().repeat(repeat)).collect();
        encoder.write_header().unwrap().write_image_data(&bytes).unwrap();
    }

    #[test]
    fn a_folder_of_pictures_is_a_cube() {
        let dir = tempfile::tempdir().unwrap();
        let inner = dir.path().join("toys_ms");
        std::fs::create_dir(&inner).unwrap();
        for band in 0..31u16 {
            let kind = if band == 3 { png::ColorType::Rgb } else { png::ColorType::Grayscale };
            let samples = [0, 1, 2, 3, 4, 5].map(|i| 1000 * i + band);
            grey(&inner.join(format!("toys_ms_{:02}.png", band + 1)), &samples, kind);
        }
        grey(&inner.join("preview.png"), &[0; 6], png::ColorType::Grayscale);
        let spec = format!("{}:scale=1e-4", dir.path().display());
        let cube = open_file(&spec).unwrap();
        assert_eq!((cube.size(), cube.bands().count), ((3, 2), 31));
        assert!((cube.band(3).unwrap().data[5] - 0.5003).abs() < 1e-6);
        let notes = cube.notes().join("\n");
        assert!(notes.contains("400 to 700 nm is assumed"), "{notes}");
        assert!(notes.contains("not used: preview.png"), "{notes}");
        std::fs::remove_file(inner.join("toys_ms_07.png")).unwrap();
        let message = open_file(&spec).err().unwrap().to_string();
        assert!(message.contains("number 8 follows 6"), "{message}");
    }

    /// Pages of 31 bands whose OME-XML names the channels: by the wavelength they detect, by their
    /// names; names that state none are asked about, where 400 to 700 nm would be usual.
    #[test]
    fn channels_of_ome_tiff_state_wavelengths_or_are_asked_about() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("cube.ome.tif");
        let opened = |channel: &dyn Fn(u32) -> String| {
            let channels: String = (0..31)
                .map(|i| format!("<Channel ID=\"Channel:0:{i}\"{}/>", channel(i)))
                .collect();
            let xml = format!(
                "<?xml version=\"1.0\"?><OME><Image ID=\"Image:0\"><Pixels SizeC=\"31\">\
                 {channels}</Pixels></Image></OME>"
            );
            let mut encoder = TiffEncoder::new(File::create(&path).unwrap()).unwrap();
            for _ in 0..31 {
                let mut image = encoder.new_image::<colortype::Gray16>(3, 2).unwrap();
                image.encoder().write_tag(Tag::ImageDescription, &xml[..]).unwrap();
                image.write_data(&[1, 2, 3, 4, 5, 6]).unwrap();
            }
            open_file(&format!("{}:scale=1e-4", path.display()))
        };
        let bands = |cube: Cube| (cube.bands().start_nm, cube.bands().step_nm);
        let emission = |i: u32| format!(" Name=\"C{i}\" EmissionWavelength=\"{}\"", 430 + 12 * i);
        assert_eq!(bands(opened(&emission).unwrap()), (430.0, 12.0));
        let named = |i: u32| format!(" Name=\"band {} nm\"", 500 + 5 * i);
        assert_eq!(bands(opened(&named).unwrap()), (500.0, 5.0));
        let other = |i: u32| format!(" Name=\"channel {i}\"");
        let error = opened(&other).err().unwrap().to_string();
        assert!(error.contains("channel 30") && error.contains("wavelength_nm"), "{error}");
        let nothing = |_: u32| String::new();
        assert_eq!(bands(opened(&nothing).unwrap()), (400.0, 10.0));
    }

    /// Cutting and corrupting a file gives an error or other values, never a panic.
    #[test]
    fn damage_is_survived() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("stack.tif");
        let mut encoder = TiffEncoder::new(File::create(&path).unwrap()).unwrap();
        for _ in 0..2 {
            encoder.write_image::<colortype::Gray16>(3, 2, &[1, 2, 3, 4, 5, 6]).unwrap();
        }
        let folder = dir.path().join("bands");
        std::fs::create_dir(&folder).unwrap();
        let picture = folder.join("b_550.png");
        grey(&picture, &[1, 2, 3, 4, 5, 6], png::ColorType::Grayscale);
        for (file, spec) in [(&path, &path), (&picture, &folder)] {
            let whole = std::fs::read(file).unwrap();
            let spec = format!("{}:start_nm=400,step_nm=10,scale=1e-4", spec.display());
            let attempt = |bytes: &[u8]| {
                std::fs::write(file, bytes).unwrap();
                open_file(&spec).and_then(|cube| cube.band(0)).is_err()
            };
            assert!(!attempt(&whole) && attempt(&whole[..whole.len() / 2]), "{spec}");
            for i in 0..whole.len() {
                attempt(&whole[..i]);
                for flip in [0x01, 0x5a, 0xff] {
                    let mut damaged = whole.clone();
                    damaged[i] ^= flip;
                    attempt(&damaged);
                }
            }
        }
    }
}
