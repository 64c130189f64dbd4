//! Headers of ENVI cubes: keys and values in text.

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

    /// The second of `z plot titles`: what the values are.
    pub fn title_of_values(&self) -> Option<&str> {
        let title = self.text("z plot titles")?.split_once(',')?.1;
        Some(title.trim_matches(['}', ' ']))
    }

    /// The unit in the title of the values: in brackets, the whole title, or the words at its end
    /// that are a unit of radiance or per cent.
    pub fn unit_of_values(&self) -> Option<&str> {
        let title = self.title_of_values()?;
        let is_unit = |text: &str| {
            let unit = Unit::parse(text).ok();
            let fits = |u: Unit| u.radiance().is_some() || text == title || text.trim() == "%";
            unit.is_some_and(fits)
        };
        let starts = std::iter::once(0).chain(title.match_indices(' ').map(|(at, _)| at + 1));
        if let Some(unit) = starts.map(|at| &title[at..]).find(|text| is_unit(text)) {
            let inner = |[open, close]: [char; 2]| unit.strip_prefix(open)?.strip_suffix(close);
            return Some(inner(['(', ')']).or_else(|| inner(['[', ']'])).unwrap_or(unit));
        }
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

    fn band_names(&self) -> impl Iterator<Item = &str> {
        let names = self.text("band names").unwrap_or_default();
        names.trim_matches(['{', '}', ' ']).trim_end_matches([',', ' ']).split(',')
    }

    /// The wavelengths that the names of the bands state, nm.
    fn of_band_names(&self, notes: &mut Vec<String>) -> Result<Option<Vec<f64>>> {
        let nm = units::wavelengths_in(self.band_names())?;
        if nm.is_some() {
            notes.push("the wavelengths are those that the band names state".into());
        }
        Ok(nm)
    }

    /// A key that is not read and may state wavelengths: also names of bands.
    pub fn other_wavelengths(&self) -> Option<String> {
        if units::may_state_wavelengths(self.band_names()) {
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
        let lettered = header("band names = {L420, L430, L440}");
        assert_eq!(lettered.other_wavelengths().as_deref(), Some("band names"));
        let other = header("center wavelengths = {1, 2}");
        assert_eq!(other.wavelengths(&mut notes).unwrap(), None);
        assert_eq!(other.other_wavelengths().as_deref(), Some("center wavelengths"));
    }

    #[test]
    fn the_title_of_the_values_has_their_unit() {
        for (title, unit) in [
            ("Wavelength (nm), Radiance (uW/cm^2/SR/nm)", Some("uW/cm^2/SR/nm")),
            ("Wavelength, Value [mW/(m2 sr nm)]", Some("mW/(m2 sr nm)")),
            ("Wavelength, uW/cm^2/SR/nm", Some("uW/cm^2/SR/nm")),
            ("Wavelength, Radiance in W m-2 sr-1 um-1", Some("W m-2 sr-1 um-1")),
            ("Wavelength, mW/(m2 sr nm)", Some("mW/(m2 sr nm)")),
            ("Wavelength, Reflectance %", Some("%")),
            ("Wavelength, Reflectance (%)", Some("%")),
            ("Wavelength, Value (counts)", Some("counts")),
            ("Wavelength, Radiance", None),
            ("Wavelength, Value", None),
            ("Wavelength, Scan 2", None),
        ] {
            let header = Header::parse(&format!("ENVI\nz plot titles = {{{title}}}\n")).unwrap();
            assert_eq!(header.unit_of_values(), unit, "{title}");
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
