//! What the values of a table's column are, by the words of its header, and their conversion to
//! fractions or powers.

use crate::table::SpectralTable;
use crate::{Error, Result};

/// e⁻ per photon over A/W at 1 nm: hc/e in W·nm/A (CODATA 2018).
const AMPERES_PER_WATT_NM: f64 = 1_239.841_984;
/// Energy of a photon of 1 nm, J: hc.
const PHOTON_J_NM: f64 = 1.986_445_857e-16;
/// Photons in a µmol.
const MICROMOLE: f64 = 6.022_140_76e17;

/// What the values of a column are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Quantity {
    /// Fractions, or power: what the table is read for.
    #[default]
    Plain,
    /// Per cent.
    Percent,
    /// Photocurrent over power, in so many A/W.
    Responsivity(f64),
    /// Minus the decimal logarithm of a transmittance: absorbance or optical density.
    Absorbance,
    /// Ten times the decimal logarithm of a transmittance.
    Decibels,
    /// Ten times the decimal logarithm of a power in mW.
    DecibelMilliwatts,
    /// Numbers of so many photons.
    Photons(f64),
    /// Relative to an unknown scale.
    Relative,
}

/// What a table is read for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// Electrons per photon.
    Efficiency,
    /// Electrons per photon up to a factor.
    EfficiencyShape,
    /// Transmittances and other fractions of light.
    Fraction,
    /// Spectral power.
    Power,
}

impl Quantity {
    /// The quantity that a column's header names.
    pub(crate) fn of(header: &str) -> Self {
        let header = header.to_lowercase();
        let words: Vec<&str> = header
            .split(|c: char| !(c.is_alphanumeric() || c == '%' || c == '/'))
            .filter(|word| !word.is_empty())
            .collect();
        let has = |names: &[&str]| words.iter().any(|word| names.contains(word));
        let starts = |names: &[&str]| words.first().is_some_and(|word| names.contains(word));
        let responsivity = [("a/w", 1.0), ("ma/w", 1e-3), ("ua/w", 1e-6), ("µa/w", 1e-6)];
        if let Some((_, amperes)) = responsivity.into_iter().find(|(name, _)| has(&[name])) {
            return Self::Responsivity(amperes);
        }
        if has(&["absorbance", "absorption", "od"]) || starts(&["abs", "optical", "extinction"]) {
            return Self::Absorbance;
        }
        if has(&["dbm"]) {
            return Self::DecibelMilliwatts;
        }
        if has(&["db", "decibel", "decibels"]) {
            return Self::Decibels;
        }
        let moles =
            |word: &&str| ["umol", "µmol", "μmol"].iter().any(|unit| word.starts_with(unit));
        if words.iter().any(moles) {
            return Self::Photons(MICROMOLE);
        }
        if has(&["photons", "quanta"]) || has(&["photon"]) && has(&["flux", "irradiance"]) {
            return Self::Photons(1.0);
        }
        if has(&["percent"]) || words.iter().any(|w| w.contains('%') && !is_error(w)) {
            return Self::Percent;
        }
        if has(&["relative", "normalised", "normalized", "arb", "arbitrary", "rel"]) {
            return Self::Relative;
        }
        Self::Plain
    }

    /// A value at a wavelength, nm, as what is wanted; `None` where it cannot be that.
    fn convert(self, wanted: Wanted, value: f64, nm: f64) -> Option<f64> {
        let efficiency = matches!(wanted, Wanted::Efficiency | Wanted::EfficiencyShape);
        match (self, wanted) {
            (Self::Plain | Self::Relative, _) => Some(value),
            (Self::Percent, Wanted::Power) => Some(value),
            (Self::Percent, _) => Some(value / 100.0),
            (Self::Responsivity(amperes), _) if efficiency => {
                Some(value * amperes * AMPERES_PER_WATT_NM / nm)
            }
            (Self::Absorbance, Wanted::Fraction) => Some(libm::exp10(-value)),
            (Self::Decibels, Wanted::Fraction) => Some(libm::exp10(0.1 * value)),
            (Self::DecibelMilliwatts, Wanted::Power) => Some(1e-3 * libm::exp10(0.1 * value)),
            (Self::Photons(each), Wanted::Power) => Some(value * each * PHOTON_J_NM / nm),
            // "Photon detection efficiency" and its like.
            (Self::Photons(_), _) if efficiency => Some(value),
            _ => None,
        }
    }

    /// Whether the user is told what is made of it.
    fn is_told(self, wanted: Wanted) -> bool {
        match (self, wanted) {
            (Self::Plain, _)
            | (Self::Percent | Self::Relative, Wanted::Power)
            | (Self::Relative, Wanted::EfficiencyShape) => false,
            (Self::Photons(_), _) => wanted == Wanted::Power,
            _ => true,
        }
    }

    /// The quantity in words.
    fn name(self) -> &'static str {
        match self {
            Self::Plain => "plain values",
            Self::Percent => "per cent",
            Self::Responsivity(_) => "responsivity in A/W",
            Self::Absorbance => "absorbance or optical density",
            Self::Decibels => "decibels",
            Self::DecibelMilliwatts => "dBm",
            Self::Photons(_) => "numbers of photons",
            Self::Relative => "relative values",
        }
    }
}

/// Whether a word such as `5%` is the size of an error, not a unit.
fn is_error(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_digit())
}

impl Wanted {
    fn help(self) -> &'static str {
        match self {
            Self::Efficiency | Self::EfficiencyShape => {
                "give electrons per photon as a fraction or per cent, or A/W"
            }
            Self::Fraction => {
                "give fractions or per cent; absorbance and negative decibels are read too"
            }
            Self::Power => "give spectral power, numbers of photons, or dBm",
        }
    }
}

impl SpectralTable {
    /// Converts the columns to what is wanted, and remarks on it.
    ///
    /// # Errors
    /// A column of another quantity.
    pub fn convert(&mut self, wanted: Wanted) -> Result<()> {
        let quantities = self.quantities.clone();
        for ((name, values), quantity) in self.curves.iter_mut().zip(&quantities) {
            for (value, nm) in values.iter_mut().zip(&self.wavelength_nm) {
                *value = quantity.convert(wanted, *value, *nm).ok_or_else(|| {
                    Error::input(format!("column {name:?} holds {}", quantity.name()))
                        .help(wanted.help())
                })?;
            }
        }
        let alike = quantities.windows(2).all(|pair| pair[0] == pair[1]);
        let told = quantities.iter().enumerate().filter(|(_, quantity)| quantity.is_told(wanted));
        for (column, quantity) in told.take(if alike { 1 } else { usize::MAX }) {
            let name = &self.curves[column].0;
            let values = if alike { "its values".into() } else { format!("those of {name:?}") };
            self.remark(match quantity {
                Quantity::Relative => {
                    format!("{values} are relative, as its header says, and taken as they stand")
                }
                _ => format!("{values} are taken as {}, as its header says", quantity.name()),
            });
        }
        self.quantities.fill(Quantity::Plain);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn converted(header: &str, value: f64, wanted: Wanted) -> Result<f64> {
        let mut table = SpectralTable::parse(&format!("wavelength_nm,{header}\n500,{value}\n"))?;
        table.convert(wanted)?;
        Ok(table.curves[0].1[0])
    }

    #[test]
    fn values_are_what_their_header_says() {
        for (header, value, wanted, right) in [
            ("QE", 0.5, Wanted::Efficiency, 0.5),
            ("QE (%)", 50.0, Wanted::Efficiency, 0.5),
            ("QE%", 50.0, Wanted::Efficiency, 0.5),
            ("QE (+/- 5%)", 0.5, Wanted::Efficiency, 0.5),
            // 0.2 A/W at 500 nm: 0.2·1239.84/500.
            ("Responsivity (A/W)", 0.2, Wanted::Efficiency, 0.495_937),
            ("Responsivity [mA/W]", 200.0, Wanted::EfficiencyShape, 0.495_937),
            ("Photon detection efficiency", 0.3, Wanted::Efficiency, 0.3),
            ("Absorbance", 0.602_06, Wanted::Fraction, 0.25),
            ("OD", 2.0, Wanted::Fraction, 0.01),
            ("Abs", 1.0, Wanted::Fraction, 0.1),
            ("Transmission (dB)", -6.0206, Wanted::Fraction, 0.25),
            ("%T", 25.0, Wanted::Fraction, 0.25),
            ("Power (dBm)", 3.0103, Wanted::Power, 2e-3),
            // A µmol of photons of 500 nm: 0.119627 J·m/mol / 500 nm.
            ("Photon flux [umol/m2/s/nm]", 1.0, Wanted::Power, 0.239_253),
            ("Relative power", 0.7, Wanted::Power, 0.7),
        ] {
            let found = converted(header, value, wanted).unwrap();
            assert!((found / right - 1.0).abs() < 1e-5, "{header}: {found}, not {right}");
        }
    }

    #[test]
    fn values_of_another_kind_are_refused() {
        for (header, wanted) in [
            ("Responsivity (A/W)", Wanted::Fraction),
            ("Absorbance", Wanted::Efficiency),
            ("Transmission (dB)", Wanted::Power),
            ("Power (dBm)", Wanted::Fraction),
        ] {
            let error = converted(header, 0.5, wanted).unwrap_err().to_string();
            assert!(error.contains("holds") && error.contains("give"), "{error}");
        }
    }

    #[test]
    fn per_cent_is_of_its_column() {
        let mut table = SpectralTable::parse("wavelength_nm,r (%),g\n500,50,0.4\n").unwrap();
        table.convert(Wanted::Efficiency).unwrap();
        assert_eq!([table.curves[0].1[0], table.curves[1].1[0]], [0.5, 0.4]);
        assert!(
            table.remarks[0].contains("those of \"r\" are taken as per cent"),
            "{:?}",
            table.remarks
        );
    }
}
