//! What a TIFF says of its bands apart from their samples: the tags of GDAL (42112, 42113),
//! ImageJ's calibration, and how many pictures the descriptions of ImageJ and tifffile announce.

use super::arrays::in_nm;
use super::selection::Stated;
use super::sidecar::{Own, Sidecar};
use super::units;
use camrig_base::{Error, Result};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use tiff::decoder::Decoder;
use tiff::tags::Tag;

type Reader = Decoder<BufReader<File>>;

/// What the library says of a TIFF that it cannot read.
pub(super) fn unreadable(path: &Path, error: tiff::TiffError) -> Error {
    Error::input(format!("not a readable TIFF: {error}")).at(path.display())
}

/// A tag's text; none where it is not there.
fn text(decoder: &mut Reader, path: &Path, tag: Tag) -> Result<Option<String>> {
    let found = decoder.find_tag(tag).and_then(|v| v.map(|v| v.into_string()).transpose());
    found.map_err(|e| unreadable(path, e))
}

/// Refuses a file with fewer pages than its description announces pictures: the samples of the
/// others lie where no page says so.
pub(super) fn check_pages(
    decoder: &mut Reader,
    samples_per_page: usize,
    pages: usize,
) -> Result<()> {
    let described = decoder.get_tag_ascii_string(Tag::ImageDescription).unwrap_or_default();
    let due = match described.split_once("\"shape\":") {
        Some((_, shape)) if described.starts_with('{') => {
            let lengths =
                shape.trim_start().trim_start_matches('[').split(']').next().unwrap_or("");
            let lengths = lengths.split(',').map(|n| n.trim().parse::<usize>().ok());
            let all = lengths.reduce(|all, n| all?.checked_mul(n?)).flatten();
            all.unwrap_or(0) / samples_per_page.max(1)
        }
        _ if described.starts_with("ImageJ") => {
            let images = described.lines().find_map(|line| line.strip_prefix("images="));
            images.and_then(|n| n.trim().parse().ok()).unwrap_or(0)
        }
        _ => 0,
    };
    if due <= pages {
        return Ok(());
    }
    Err(Error::unsupported(format!(
        "{due} pictures, says its description, and {pages} with a page"
    ))
    .help("save it with a page per band: not above 4 GiB from ImageJ, nor truncated"))
}

/// The offset and the factor that ImageJ's calibration gives to samples, where there is one that
/// changes them.
///
/// # Errors
/// A calibration that is no straight line.
pub(super) fn image_j(decoder: &mut Reader) -> Result<Option<[f64; 2]>> {
    let described = decoder.get_tag_ascii_string(Tag::ImageDescription).unwrap_or_default();
    let line = |key: &str| described.lines().find_map(|line| line.strip_prefix(key));
    let number = |key: &str| line(key)?.trim().parse::<f64>().ok().filter(|n| n.is_finite());
    // 20 is none, by ij.measure.Calibration.
    let curve =
        line("cf=").filter(|curve| described.starts_with("ImageJ") && curve.trim() != "20");
    match (curve.map(str::trim), number("c0="), number("c1=")) {
        (None, ..) => Ok(None),
        (Some("0"), Some(offset), Some(gain)) => {
            Ok(Some([offset, gain]).filter(|line| *line != [0.0, 1.0]))
        }
        (Some(curve), ..) => {
            Err(Error::unsupported(format!("a calibration of ImageJ by a curve (cf={curve})"))
                .help("save the values themselves: Image, Type, 32-bit in ImageJ"))
        }
    }
}

/// What the tags of GDAL, or a calibration of ImageJ, say of the bands.
#[derive(Default)]
pub(super) struct Gdal {
    /// Band by band; not a number where nothing is said, and below.
    gain: Vec<f64>,
    offset: Vec<f64>,
    nm: Vec<f64>,
    /// What names the wavelengths and their unit.
    words: String,
    no_data: Option<String>,
    not_used: BTreeSet<String>,
    /// Whether gain and offset are ImageJ's.
    image_j: bool,
    /// What OME-XML says of each channel.
    channels: Vec<String>,
}

impl Gdal {
    /// Takes in the tags of a page that has `bands`.
    pub(super) fn page(&mut self, decoder: &mut Reader, path: &Path, bands: usize) -> Result<()> {
        let first = self.gain.len();
        let all = first + bands;
        self.gain.resize(all, f64::NAN);
        self.offset.resize(all, f64::NAN);
        self.nm.resize(all, f64::NAN);
        if let Some(no_data) = text(decoder, path, Tag::GdalNodata)? {
            let no_data = no_data.trim_matches(['\0', ' ']).to_string();
            if *self.no_data.get_or_insert(no_data.clone()) != no_data {
                return Err(Error::unsupported("pages with several values of GDAL_NODATA")
                    .help("save them with one value for missing samples"));
            }
        }
        let items = text(decoder, path, Tag::Unknown(42112))?.unwrap_or_default();
        for item in items.split("<Item ").skip(1) {
            self.item(item, first, bands)?;
        }
        Ok(())
    }

    /// Takes in what ImageJ and OME-XML say of all bands, where GDAL says nothing.
    pub(super) fn calibrate(&mut self, decoder: &mut Reader) -> Result<()> {
        let described = decoder.get_tag_ascii_string(Tag::ImageDescription).unwrap_or_default();
        self.channels = ome_channels(&described);
        if let (Some([offset, gain]), false) = (image_j(decoder)?, self.changes_samples()) {
            self.gain.fill(gain);
            self.offset.fill(offset);
            self.image_j = true;
        }
        Ok(())
    }

    /// Takes in `name="SCALE" sample="0" role="scale">0.5</Item>`.
    fn item(&mut self, item: &str, first: usize, bands: usize) -> Result<()> {
        let (keys, value) = item.split_once('>').unwrap_or((item, ""));
        let value = value.split("</").next().unwrap_or("").trim();
        let key = |key: &str| keys.split_once(&format!("{key}=\""))?.1.split('"').next();
        let name = key("name").unwrap_or("").to_lowercase();
        let sample = key("sample").and_then(|n| n.parse::<usize>().ok());
        let band = sample.filter(|n| *n < bands).map(|n| first + n);
        // A unit may follow the number.
        let number = value.split(|c: char| c.is_whitespace() || c == 'n' || c == 'u').next();
        let number = number.and_then(|n| n.parse::<f64>().ok()).filter(|n| n.is_finite());
        let list = match name.as_str() {
            "scale" => &mut self.gain,
            "offset" => &mut self.offset,
            "wavelength" | "central_wavelength_um" => &mut self.nm,
            "wavelength_units" => {
                self.words += &value.to_lowercase();
                return Ok(());
            }
            _ => {
                self.not_used.insert(name);
                return Ok(());
            }
        };
        let (Some(band), Some(number)) = (band, number) else {
            return Err(Error::input(format!(
                "{name} {value:?} of band {sample:?} in GDAL_METADATA"
            ))
            .help("each band has one number"));
        };
        list[band] = number;
        if name.contains("wavelength") {
            self.words += &value.to_lowercase();
        }
        Ok(())
    }

    /// Whether the tags say that the samples are not the values.
    pub(super) fn changes_samples(&self) -> bool {
        self.no_data.is_some()
            || self.gain.iter().any(|v| !v.is_nan() && *v != 1.0)
            || self.offset.iter().any(|v| !v.is_nan() && *v != 0.0)
    }

    /// Adds what is said to what the file says, where the user does not say otherwise.
    pub(super) fn tell(self, sidecar: &Sidecar, own: &mut Own) -> Result<()> {
        let ignored = match &self.no_data {
            Some(text) => Some(text.parse::<f32>().map_err(|_| {
                Error::input(format!("GDAL_NODATA {text:?}")).help("it is a number")
            })?),
            None => None,
        };
        let changes = Self { no_data: None, ..self };
        let scaled = changes.changes_samples();
        let Self { gain, offset, nm, words, not_used, image_j, channels, .. } = changes;
        let of = if image_j { "ImageJ's calibration" } else { "GDAL_METADATA" };
        if scaled && sidecar.scale.is_some() {
            own.notes.push(format!("scale and offset of {of} give way to the scale given"));
        } else if scaled {
            own.understood.push(format!("scale and offset of {of}, band by band"));
            let [gain, offset] = [all_or_none("scale", gain)?, all_or_none("offset", offset)?];
            own.stated = Stated { gain, offset, ..Stated::default() };
        }
        own.stated.ignored = ignored;
        own.nm = if nm.iter().any(|nm| nm.is_nan()) { None } else { in_nm(&words, &nm) };
        if own.nm.is_none() && !nm.iter().all(|nm| nm.is_nan()) {
            own.notes.push(
                "wavelengths of GDAL_METADATA were not used: not one per band in nm or µm".into(),
            );
        }
        if own.nm.is_none() && channels.iter().any(|channel| !channel.is_empty()) {
            own.nm = units::wavelengths_in(channels.iter().map(|channel| &channel[..]))?;
            match &own.nm {
                Some(_) => {
                    own.notes.push("the wavelengths are those of the OME-XML's channels".into());
                }
                None => own.other_wavelengths = Some(format!("channels {}", channels.join(", "))),
            }
        }
        if !not_used.is_empty() {
            let names = not_used.into_iter().collect::<Vec<_>>().join(", ");
            own.notes.push(format!("items of GDAL_METADATA that were not used: {names}"));
        }
        Ok(())
    }
}

/// What the channels of OME-XML are: the wavelength that each detects (`EmissionWavelength`, whose
/// unit is nm by the schema unless it says another), else its name.
fn ome_channels(described: &str) -> Vec<String> {
    let channel = |tag: &str| {
        let tag = format!(" {}", tag.split('>').next().unwrap_or_default());
        let key = |name: &str| {
            let value = tag.split_once(&format!(" {name}=\""))?.1.split('"').next()?;
            Some(value.to_owned())
        };
        match key("EmissionWavelength") {
            Some(nm) => {
                let unit = key("EmissionWavelengthUnit").unwrap_or_else(|| "nm".into());
                format!("{nm} {unit}")
            }
            None => key("Name").unwrap_or_default(),
        }
    };
    let is_ome = described.contains("<OME");
    let tags = described.split("<Channel ").skip(1).filter(|_| is_ome);
    tags.map(channel).collect()
}

/// A list that says something of every band, or of none.
fn all_or_none(what: &str, list: Vec<f64>) -> Result<Option<Vec<f64>>> {
    let said = list.iter().filter(|v| !v.is_nan()).count();
    if said == 0 || said == list.len() {
        return Ok((said > 0).then_some(list));
    }
    let bands = list.len();
    Err(Error::input(format!("GDAL_METADATA gives a {what} to {said} of {bands} bands"))
        .help("give one to each band, or say scale= for all"))
}
