//! Headers of ENVI cubes: keys and values in text.

use super::Quantity;
use super::selection::Stated;
use super::units;
use camrig_base::unit::Unit;
use camrig_base::{Error, Result};
use std::collections::BTreeMap;

/// Keys that the reader uses, or that say nothing of the samples.
const KNOWN: &[&str] = &[
    "samples",
    "lines",
    "bands",
    "data type",
    "interleave",
    "byte order",
    "header offset",
    "file compression",
    "major frame offsets",
    "minor frame offsets",
    "wavelength",
    "wavelengths",
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

/// The keys of a header and their values.
pub struct Header(BTreeMap<String, String>);

impl Header {
    /// `key = value` lines after a first line `ENVI`; a value in braces may span lines.
    pub fn parse(text: &str) -> Result<Self> {
        // A byte order mark, which some editors put before UTF-8.
        let mut lines = text.trim_start_matches('\u{feff}').lines().enumerate();
        if lines.next().is_none_or(|(_, first)| !first.trim().eq_ignore_ascii_case("ENVI")) {
            return Err(Error::input("the first line is not ENVI").help("this is no ENVI header"));
        }
        let mut keys = BTreeMap::new();
        while let Some((number, line)) = lines.next() {
            let Some((key, value)) = line.split_once('=') else { continue };
            if line.starts_with(';') {
                continue; // a remark
            }
            let mut value = value.trim().to_string();
            while value.starts_with('{') && !value.contains('}') {
                let Some((_, next)) = lines.next() else {
                    return Err(Error::input(format!("no closing brace for {:?}", key.trim()))
                        .at(format!("line {}", number + 1)));
                };
                value.push(' ');
                value.push_str(next);
            }
            let key = key.trim().to_ascii_lowercase();
            if keys.insert(key.clone(), value.clone()).is_some_and(|before| before != value) {
                return Err(Error::input(format!("the key {key:?} has another value before"))
                    .at(format!("line {}", number + 1))
                    .help("give each key once"));
            }
        }
        Ok(Self(keys))
    }

    pub fn text(&self, key: &str) -> Option<&str> {
        self.0.get(key).map(String::as_str)
    }

    pub fn number(&self, key: &str) -> Result<Option<f64>> {
        let Some(text) = self.text(key) else { return Ok(None) };
        match text.parse() {
            Ok(number) if number > 0.0 => Ok(Some(number)),
            _ => Err(Error::input(format!("{key} = {text}")).help("give a positive number")),
        }
    }

    pub fn size(&self, key: &str) -> Result<usize> {
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

    /// Refuses gains other than 1 together with another key that scales the samples.
    pub fn refuse_gains(&self, beside: &str) -> Result<()> {
        let gains = self.list("data gain values")?.unwrap_or_default();
        if gains.iter().all(|gain| *gain == 1.0) {
            return Ok(());
        }
        Err(Error::input(format!("{beside} and data gain values would both scale the samples"))
            .help("take one of them out of the header, or give scale=FACTOR instead of the first"))
    }

    /// Radiance, where the title of the values names it or has a unit of it.
    pub fn quantity_of_title(&self) -> Option<Quantity> {
        let title = self.title_of_values()?.to_lowercase();
        let named = title.contains(Quantity::Radiance.name()) && !title.contains("irradiance");
        let has_unit = || Unit::parse(self.unit_of_values()?).ok()?.radiance();
        (named || has_unit().is_some()).then_some(Quantity::Radiance)
    }

    /// The second of `z plot titles`.
    fn title_of_values(&self) -> Option<&str> {
        Some(self.text("z plot titles")?.split_once(',')?.1)
    }

    /// The unit in the brackets of the title of the values.
    pub fn unit_of_values(&self) -> Option<&str> {
        let title = self.title_of_values()?;
        let (from, to) = (title.find(['(', '['])? + 1, title.rfind([')', ']'])?);
        title.get(from..to).map(str::trim).filter(|unit| !unit.is_empty())
    }

    /// Keys that would place samples elsewhere than packed from the header's offset, or make
    /// something else of them.
    pub fn refuse_other_layouts(&self) -> Result<()> {
        for key in ["file compression", "major frame offsets", "minor frame offsets"] {
            let zero = |text: &str| !text.contains(|c: char| c.is_ascii_digit() && c != '0');
            if let Some(text) = self.text(key).filter(|text| !zero(text)) {
                return Err(Error::unsupported(format!("{key} = {text}"))
                    .help("save the cube again, uncompressed and without gaps"));
            }
        }
        // What else has such headers: transforms, lists of classes, lists of other files.
        let kind = self.text("file type").unwrap_or("").to_ascii_lowercase();
        if kind.contains("spectral library") {
            return Err(Error::unsupported("an ENVI spectral library: curves, and no image").help(
                "save a curve as a table of wavelength_nm,value; a scene is an ENVI Standard file",
            ));
        }
        if ["fft", "classification", "meta", "mosaic"].iter().any(|other| kind.contains(other)) {
            return Err(Error::unsupported(format!("file type = {kind}"))
                .help("a scene is an ENVI Standard file"));
        }
        Ok(())
    }

    /// Keys that the reader does not know, most of which say where and when the scene was taken.
    pub fn ignored(&self) -> Option<String> {
        let unknown: Vec<&str> =
            self.0.keys().map(String::as_str).filter(|key| !KNOWN.contains(key)).collect();
        (!unknown.is_empty())
            .then(|| format!("keys of the header that were not used: {}", unknown.join(", ")))
    }

    /// The wavelengths, nm. Where the header does not say their unit, `notes` get what is assumed.
    pub fn wavelengths(&self, notes: &mut Vec<String>) -> Result<Option<Vec<f64>>> {
        let key = ["wavelength", "wavelengths"].into_iter().find(|key| self.text(key).is_some());
        let Some(key) = key else { return self.of_band_names(notes) };
        let Some(list) = self.list(key)? else { return Ok(None) };
        let said = self.text("wavelength units").unwrap_or("").trim().to_lowercase();
        let unit = match said.as_str() {
            "" | "unknown" => {
                let unit = if list[0] < 100.0 { "micrometres" } else { "nanometres" };
                notes.push(format!(
                    "the header does not say the unit of its wavelengths: {unit}, by their size"
                ));
                unit
            }
            said => said,
        };
        let wrong = || {
            Error::unsupported(format!("wavelength units = {unit}"))
                .help("write the wavelengths in nanometres or micrometres, or give wavelength_nm")
        };
        let parsed = Unit::parse(unit).map_err(|_| wrong())?;
        let nm: Option<Vec<f64>> = list.into_iter().map(|value| parsed.to_nm(value)).collect();
        nm.map(Some).ok_or_else(wrong)
    }

    /// The wavelengths that the names of the bands state, nm.
    fn of_band_names(&self, notes: &mut Vec<String>) -> Result<Option<Vec<f64>>> {
        let Some(names) = self.text("band names") else { return Ok(None) };
        let names = names.trim_matches(['{', '}', ' ']).trim_end_matches([',', ' ']);
        let nm = units::wavelengths_in(names.split(','))?;
        if nm.is_some() {
            notes.push("the wavelengths are those that the band names state".into());
        }
        Ok(nm)
    }

    /// A key that is not read and may state wavelengths: also names of bands that are rising
    /// numbers of their size.
    pub fn other_wavelengths(&self) -> Option<String> {
        let names = self.list("band names").ok().flatten().unwrap_or_default();
        let like_nm = |nm: &f64| units::NAMED_NM.contains(nm);
        if names.len() > 1 && names.iter().all(like_nm) && names.is_sorted_by(|a, b| a < b) {
            return Some("band names".into());
        }
        let other = |key: &&String| key.contains("wave") && !KNOWN.contains(&key.as_str());
        self.0.keys().find(other).cloned()
    }

    /// What is said of the bands, which `scale` makes values of the scene.
    pub fn stated(&self, scale: f32) -> Result<Stated> {
        let good = self.list("bbl")?.map(|list| list.iter().map(|v| *v != 0.0).collect());
        let ignored = match self.text("data ignore value") {
            Some(text) => Some(text.parse::<f32>().map_err(|_| {
                Error::input(format!("data ignore value = {text}")).help("give a number")
            })?),
            None => None,
        };
        Ok(Stated {
            gain: self.list("data gain values")?,
            offset: self.list("data offset values")?,
            scale: Some(scale),
            good,
            ignored,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn band_names_state_wavelengths() {
        let header = |lines: &str| Header::parse(&format!("ENVI\n{lines}\n")).unwrap();
        let mut notes = Vec::new();
        let named = header("band names = {\n420 nm,\n430 nm}").wavelengths(&mut notes).unwrap();
        assert_eq!(named, Some(vec![420.0, 430.0]));
        assert!(notes[0].contains("band names"), "{notes:?}");
        let plural = header("wavelengths = {0.42, 0.43}").wavelengths(&mut notes).unwrap();
        assert_eq!(plural, Some(vec![420.0, 430.0]));
        // Bare numbers state no unit: they are not assumed, nor are other wavelengths.
        let numbers = header("band names = {420, 430}");
        assert_eq!(numbers.wavelengths(&mut notes).unwrap(), None);
        assert_eq!(numbers.other_wavelengths().as_deref(), Some("band names"));
        assert_eq!(header("band names = {1, 2}").other_wavelengths(), None);
        let other = header("center wavelengths = {1, 2}");
        assert_eq!(other.wavelengths(&mut notes).unwrap(), None);
        assert_eq!(other.other_wavelengths().as_deref(), Some("center wavelengths"));
    }

    #[test]
    fn the_title_of_the_values_says_radiance() {
        for (title, radiance) in [
            ("Wavelength (nm), Radiance (uW/cm^2/SR/nm)", true),
            ("Wavelength, Value [mW/(m2 sr nm)]", true),
            ("Wavelength, Radiance", true),
            ("Wavelength, Reflectance (%)", false),
            ("Wavelength, Irradiance (W/m2/nm)", false),
            ("Wavelength, Value", false),
        ] {
            let header = Header::parse(&format!("ENVI\nz plot titles = {{{title}}}\n")).unwrap();
            let found = header.quantity_of_title();
            assert_eq!(found, radiance.then_some(Quantity::Radiance), "{title}");
        }
    }

    #[test]
    fn wavelengths_of_all_units() {
        for (units, list) in [
            ("Nanometers", "400, 500"),
            ("Micrometers", "0.4, 0.5"),
            ("Angstroms", "4000, 5000"),
            ("Wavenumber", "25000, 20000"),
            ("1/cm", "25000, 20000"),
            ("cm-1", "25000, 20000"),
            ("GHz", "749481.145, 599584.916"),
            ("Unknown", "400, 500"),
            ("Unknown", "0.4, 0.5"),
        ] {
            let text = format!("ENVI\nwavelength units = {units}\nwavelength = {{{list}}}\n");
            let found = Header::parse(&text).unwrap();
            let mut notes = Vec::new();
            let found = found.wavelengths(&mut notes).unwrap().unwrap();
            assert_eq!(notes.len(), usize::from(units == "Unknown"), "{units}: {notes:?}");
            for (got, expected) in found.iter().zip([400.0, 500.0]) {
                assert!((got - expected).abs() < 1e-6, "{units}: {got}");
            }
        }
    }
}
