//! Illuminants: relative spectral power per wavelength (W nm⁻¹ up to a factor).
//!
//! | name | source |
//! | --- | --- |
//! | `A` | ISO/CIE 11664-2: Planck's law with the convention of that standard, 100 at 560 nm |
//! | `D50` `D55` `D65` `D75` | ISO/CIE 11664-2, CIE 15: daylight, 5000 K ... times 1.4388/1.4380 |
//! | `D5600K` | the same method at exactly that correlated colour temperature, 4000 K to 25000 K |
//! | `E` | equal power at all wavelengths |
//! | `F1` ... `F12` | CIE 15 table of fluorescent lamps, 380 to 780 nm |
//! | `LED-B1` ... `LED-V2` | CIE 15:2018 table of LED lamps, 380 to 780 nm |
//! | `blackbody:3200` | Planck's law, c2 = 1.438776877e-2 m K (CODATA 2018) |
//! | `FILE` | `wavelength_nm,power`, or as other programs and light meters write such tables |
//! | `FILE:column=NAME` | one of several curves in such a file |
//!
//! Those of the CIE's tables are dark outside them (daylight from 300 to 830 nm): beyond, the
//! standard says nothing. A table in a file keeps its end values unless it says `# outside: zero`.
//! A note says so where a camera sees beyond a table.

use camrig_base::table::{SpectralTable, Wanted, built_in};
use camrig_base::{Bands, Error, Outside, Result, Spectrum};
use std::path::Path;

const DAYLIGHT: &str = include_str!("data/daylight.csv");
const FLUORESCENT: &str = include_str!("data/fluorescent.csv");
const LED: &str = include_str!("data/led.csv");

/// Wavelengths at which illuminants given by a formula are tabulated, nm: the response of silicon.
const FORMULA_NM: std::ops::RangeInclusive<u32> = 300..=1100;
/// Step of that table, nm.
const FORMULA_STEP_NM: usize = 5;
/// Wavelength at which relative spectral powers are 100, nm (ISO/CIE 11664-2).
const REFERENCE_NM: f64 = 560.0;

/// A named illuminant.
#[derive(Clone, Debug, PartialEq)]
pub struct Illuminant {
    /// The name it was parsed from.
    pub name: String,
    /// Relative power per wavelength, 100 at 560 nm for the built-in ones.
    pub power: Spectrum,
}

impl Illuminant {
    /// Finds a built-in illuminant (see the module's table) or reads a CSV file.
    ///
    /// # Errors
    /// An unknown name, temperatures out of range, a file that is not a table of
    /// `wavelength_nm,power` or has negative values.
    pub fn parse(text: &str) -> Result<Self> {
        let power = match text.to_ascii_uppercase().as_str() {
            "A" => standard_a(),
            "E" => Spectrum::constant(100.0),
            "D50" | "D55" | "D65" | "D75" => {
                let nominal: f64 = text[1..].parse::<f64>().unwrap_or(65.0) * 100.0;
                daylight(nominal * 1.4388 / 1.4380)?
            }
            name => match (daylight_kelvin(name), name.strip_prefix("BLACKBODY:")) {
                (Some(kelvin), _) => daylight(kelvin).map_err(|e| e.at(text))?,
                (_, Some(kelvin)) => blackbody_of(kelvin).map_err(|e| e.at(text))?,
                _ => match lamp(name)? {
                    Some(power) => power,
                    None => {
                        return Ok(Self { name: text.to_string(), power: from_file(text)? });
                    }
                },
            },
        };
        // Equal power has one sample, which is no table's end.
        let table = !text.eq_ignore_ascii_case("E");
        let power = if table { power.from_table(format!("illuminant {text}")) } else { power };
        Ok(Self { name: text.to_string(), power })
    }

    /// Whether `text` is the name of a file.
    pub fn is_file(text: &str) -> bool {
        Path::new(text).extension().is_some() || text.contains(['/', '\\'])
    }

    /// The names of the built-in tables and standard illuminants.
    pub fn names() -> Vec<String> {
        let mut names: Vec<String> =
            ["A", "D50", "D55", "D65", "D75", "E"].map(String::from).into();
        for text in [FLUORESCENT, LED] {
            names.extend(built_in(text).curves.into_iter().map(|(name, _)| name));
        }
        names
    }

    /// Remarks for the user on this light in `bands`.
    pub fn notes(&self, bands: &Bands) -> Vec<String> {
        self.power.notes(bands)
    }

    /// Mean relative power in each band, exact: emission lines keep their power.
    pub fn in_bands(&self, bands: &Bands) -> Vec<f64> {
        self.power.means(bands)
    }
}

/// CIE standard illuminant A (ISO/CIE 11664-2): Planck's law at 2848 K with the constant c2 =
/// 1.435e7 nm K of that standard.
fn standard_a() -> Spectrum {
    planck(1.435e7, 2848.0)
}

/// Planck's law at a temperature in kelvin with the second radiation constant of CODATA 2018.
fn blackbody(kelvin: f64) -> Spectrum {
    planck(1.438_776_877e7, kelvin)
}

/// Planck's law, 100 at 560 nm: S = 100 (560/λ)^5 (e^(c2/(T·560)) − 1) / (e^(c2/(T λ)) − 1).
fn planck(c2_nm_k: f64, kelvin: f64) -> Spectrum {
    let relative =
        |nm: f64| libm::pow(REFERENCE_NM / nm, 5.0) / libm::expm1(c2_nm_k / (kelvin * nm));
    from_formula(|nm| 100.0 * relative(nm) / relative(REFERENCE_NM))
}

fn blackbody_of(kelvin: &str) -> Result<Spectrum> {
    let number = kelvin.trim_end_matches('K').parse().ok();
    match number.filter(|k: &f64| (500.0..=50_000.0).contains(k)) {
        Some(kelvin) => Ok(blackbody(kelvin)),
        None => Err(Error::input(format!("a black body at {kelvin:?} kelvin"))
            .help("give 500 to 50000, for instance blackbody:3200")),
    }
}

fn from_formula(f: impl Fn(f64) -> f64) -> Spectrum {
    let nm: Vec<f64> = FORMULA_NM.step_by(FORMULA_STEP_NM).map(f64::from).collect();
    let power = nm.iter().map(|&nm| f(nm)).collect();
    Spectrum::new(nm, power).expect("rising wavelengths and finite values by construction")
}

/// The correlated colour temperature in a name like `D5600K`.
fn daylight_kelvin(name: &str) -> Option<f64> {
    name.strip_prefix('D')?.strip_suffix('K')?.parse().ok()
}

/// CIE daylight of a correlated colour temperature (CIE 15, section 3.1, with M1 and M2 rounded to
/// three decimals as there).
fn daylight(kelvin: f64) -> Result<Spectrum> {
    if !(4000.0..=25_000.0).contains(&kelvin) {
        return Err(Error::input(format!("daylight of {kelvin} K"))
            .help("CIE daylight is defined from 4000 K to 25000 K; below, use blackbody:KELVIN"));
    }
    let t = 1000.0 / kelvin;
    let x = if kelvin <= 7000.0 {
        -4.6070 * t * t * t + 2.9678 * t * t + 0.09911 * t + 0.244063
    } else {
        -2.0064 * t * t * t + 1.9018 * t * t + 0.24748 * t + 0.237040
    };
    let y = -3.000 * x * x + 2.870 * x - 0.275;
    let m = 0.0241 + 0.2562 * x - 0.7341 * y;
    let round = |v: f64| (v * 1000.0).round() / 1000.0;
    let m1 = round((-1.3515 - 1.7703 * x + 5.9114 * y) / m);
    let m2 = round((0.0300 - 31.4424 * x + 30.0717 * y) / m);
    let basis = built_in(DAYLIGHT);
    let [s0, s1, s2] = [0, 1, 2].map(|i| &basis.curves[i].1);
    // Far in the ultraviolet the components can leave a tiny negative power.
    let power = (0..s0.len()).map(|i| (s0[i] + m1 * s1[i] + m2 * s2[i]).max(0.0)).collect();
    Ok(Spectrum::new(basis.wavelength_nm, power)?.outside(Outside::Zero))
}

/// A lamp of the fluorescent and LED tables.
fn lamp(name: &str) -> Result<Option<Spectrum>> {
    for table in [built_in(FLUORESCENT), built_in(LED)] {
        if let Some(column) = table.column(name) {
            return Ok(Some(table.spectrum(column)?.outside(Outside::Zero)));
        }
    }
    Ok(None)
}

fn from_file(text: &str) -> Result<Spectrum> {
    if !Illuminant::is_file(text) {
        return Err(unknown(text));
    }
    let (file, column) = match text.split_once(":column=") {
        Some((file, column)) => (file, Some(column)),
        None => (text, None),
    };
    let path = Path::new(file);
    let mut table = SpectralTable::read_column(path, column)?;
    let names: Vec<String> = table.curves.iter().map(|(name, _)| name.clone()).collect();
    let converted = table.convert(Wanted::Power).map_err(|e| e.at(path.display()));
    if table.curves.len() != 1 {
        return Err(Error::input(format!("{} curves in an illuminant", table.curves.len()))
            .at(path.display())
            .help(format!("choose one by {file}:column=NAME: {}", names.join(", "))));
    }
    converted?;
    table.clip_noise();
    let power = &table.curves[0].1;
    if let Some(i) = power.iter().position(|&p| p < 0.0) {
        return Err(Error::input(format!("power {} at {} nm", power[i], table.wavelength_nm[i]))
            .at(path.display())
            .help("spectral power cannot be negative"));
    }
    Ok(table.spectrum(0)?.from_table(text))
}

fn unknown(text: &str) -> Error {
    let names = Illuminant::names();
    let upper = text.to_ascii_uppercase();
    let nearest = camrig_base::toml_text::nearest(&upper, names.iter().map(String::as_str));
    Error::input(format!("unknown illuminant {text:?}; did you mean {nearest}?")).help(format!(
        "use {}, D4000K to D25000K, blackbody:KELVIN, or a CSV file wavelength_nm,power",
        names.join(", ")
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photometry::chromaticity;

    /// CIE 15:2018: chromaticity under the 2 degree observer, printed to four or five decimals.
    /// Those of lamps are sums at 5 nm; ours at 1 nm with the lamp linear between samples differ
    /// by 2e-4.
    #[test]
    fn chromaticities_are_those_of_the_cie_tables() {
        for (name, x, y) in [
            ("A", 0.44758, 0.40745),
            ("D50", 0.34567, 0.35851),
            ("D55", 0.33243, 0.34744),
            ("D65", 0.31272, 0.32903),
            ("D75", 0.29903, 0.31488),
            ("E", 0.33333, 0.33333),
            ("F2", 0.3721, 0.3751),
            ("F7", 0.3129, 0.3292),
            ("F11", 0.3805, 0.3769),
            ("F12", 0.4370, 0.4042),
            ("LED-B1", 0.4560, 0.4078),
            ("LED-B5", 0.3118, 0.3236),
            ("LED-RGB1", 0.4557, 0.4211),
        ] {
            let got = chromaticity(&Illuminant::parse(name).unwrap().power);
            let tolerance = if name.starts_with(['F', 'L']) { 3e-4 } else { 1e-4 };
            assert!(
                (got[0] - x).abs() < tolerance && (got[1] - y).abs() < tolerance,
                "{name}: {got:?}, table {x} {y}"
            );
        }
    }

    /// CIE 15 table T.1.
    #[test]
    fn values_of_the_standard_tables() {
        let at = |name: &str, nm: f64| Illuminant::parse(name).unwrap().power.at(nm);
        for (name, nm, power, tolerance) in [
            ("A", 400.0, 14.7080, 1e-4),
            ("A", 700.0, 198.261, 1e-3),
            ("D65", 400.0, 82.7549, 6e-3),
            ("D65", 450.0, 117.008, 6e-3),
            ("D65", 700.0, 71.6091, 6e-3),
            ("D50", 450.0, 87.2467, 6e-3),
            ("blackbody:6500", 560.0, 100.0, 1e-9),
        ] {
            let got = at(name, nm);
            assert!((got - power).abs() < tolerance, "{name} at {nm}: {got}, table {power}");
        }
    }

    #[test]
    fn a_daylight_without_a_name_has_its_colour_temperature() {
        // D5002.78K is D50's own; its chromaticity must be D50's.
        let named = chromaticity(&Illuminant::parse("D50").unwrap().power);
        let by_kelvin = chromaticity(&Illuminant::parse("D5002.78K").unwrap().power);
        assert!((named[0] - by_kelvin[0]).abs() < 1e-6);
    }

    #[test]
    fn wrong_names_say_what_would_be_right() {
        let message = |text: &str| Illuminant::parse(text).unwrap_err().to_string();
        assert!(message("D66").contains("did you mean D65"), "{}", message("D66"));
        assert!(message("led-b9").contains("LED-B1"));
        assert!(message("D3000K").contains("4000 K"));
        assert!(message("blackbody:hot").contains("blackbody:3200"));
        assert!(message("none.csv").contains("none.csv"));
    }
}
