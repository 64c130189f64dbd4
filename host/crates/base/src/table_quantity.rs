//! What the values of a table's column are, by the words of its header, and their conversion to
//! fractions or powers.

use crate::table::SpectralTable;
use crate::table_header::Header;
use crate::{Error, Result};

/// e⁻ per photon over A/W at 1 nm: hc/e in W·nm/A (CODATA 2018).
const AMPERES_PER_WATT_NM: f64 = 1_239.841_984;
/// Energy of a photon of 1 nm, J: hc.
const PHOTON_J_NM: f64 = 1.986_445_857e-16;
const PER_FREQUENCY: &str = "power per frequency or wavenumber";
const LOGARITHM: Quantity = Quantity::Refused("logarithms", "give the values themselves");

/// What the values of a column are.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Quantity {
    /// Fractions, or power: what the table is read for.
    Plain,
    /// Per cent.
    Percent,
    /// Photocurrent over power, in so many A/W.
    Responsivity(f64),
    /// Minus the decimal logarithm of a transmittance (absorbance, optical density), in so many.
    Absorbance(f64),
    /// Ten times the decimal logarithm of a transmittance.
    Decibels,
    /// Ten times the decimal logarithm of a power in mW.
    DecibelMilliwatts,
    /// Numbers of so many photons.
    Photons(f64),
    /// Power per frequency, wavenumber or energy: times which it is a power per nm over the square
    /// of the wavelength in nm.
    PerFrequency(f64),
    /// Relative to an unknown scale.
    Relative,
    /// Something that is not read, and what to give instead.
    Refused(&'static str, &'static str),
    /// Two that contradict each other.
    Both(&'static str, &'static str),
}

/// What a table is read for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// Electrons per photon.
    Efficiency,
    /// Electrons per photon up to a factor.
    EfficiencyShape,
    /// Reflectances and other fractions of light.
    Fraction,
    /// Transmittances.
    Transmittance,
    /// Spectral power.
    Power,
}

impl Quantity {
    /// The quantity that a column's header names, of a table that is read for what is wanted.
    fn of(header: &str, wanted: Wanted) -> Self {
        let header = Header::of(header);
        let fraction = matches!(wanted, Wanted::Fraction | Wanted::Transmittance);
        let refused = match wanted {
            _ if header.is_times_light() => Some(Self::Refused(
                "values times their wavelength or frequency",
                "divide them by it, and name the column by what is left",
            )),
            Wanted::Power => no_power(&header),
            _ if header.is_scaled() => {
                Some(Self::Refused("values of another scale", wanted.help()))
            }
            _ if header.is_complement() => {
                Some(Self::Refused("what is left of the whole, or inverse values", wanted.help()))
            }
            Wanted::Efficiency | Wanted::EfficiencyShape => no_efficiency(&header, wanted),
            Wanted::Fraction | Wanted::Transmittance => no_fraction(&header, wanted),
        };
        if let Some(refused) = refused {
            return refused;
        }
        match header.logarithm() {
            Some(Some(size)) if fraction && !header.is_percent() => return Self::Absorbance(size),
            Some(_) => return LOGARITHM,
            None => {}
        }
        let decibels = |of_milliwatt| match of_milliwatt {
            true => Self::DecibelMilliwatts,
            false => Self::Decibels,
        };
        let power = wanted == Wanted::Power;
        let photons = header.photons().filter(|_| power).map(Self::Photons);
        let per_frequency = header.per_frequency().filter(|_| power).map(Self::PerFrequency);
        // Per cent of a power is a power of another scale.
        let percent = header.is_percent() && photons.or(per_frequency).is_none();
        let found = [
            header.amperes_per_watt().map(Self::Responsivity),
            header.absorbance().map(Self::Absorbance),
            header.decibels().map(decibels),
            photons,
            per_frequency,
            percent.then_some(Self::Percent),
        ];
        let mut found = found.into_iter().flatten();
        match (found.next(), found.next()) {
            (Some(one), Some(other)) => Self::Both(one.name(), other.name()),
            (Some(one), None) => one,
            _ if wanted == Wanted::Transmittance && header.is_named_density() => {
                Self::Absorbance(1.0)
            }
            _ if header.is_relative() => Self::Relative,
            _ => Self::Plain,
        }
    }

    /// A value at a wavelength, nm, as what is wanted; `None` where it cannot be that.
    fn convert(self, wanted: Wanted, value: f64, nm: f64) -> Option<f64> {
        let efficiency = matches!(wanted, Wanted::Efficiency | Wanted::EfficiencyShape);
        let fraction = matches!(wanted, Wanted::Fraction | Wanted::Transmittance);
        match (self, wanted) {
            (Self::Plain | Self::Relative, _) => Some(value),
            (Self::Percent, Wanted::Power) => Some(value),
            (Self::Percent, _) => Some(value / 100.0),
            (Self::Responsivity(amperes), _) if efficiency => {
                Some(value * amperes * AMPERES_PER_WATT_NM / nm)
            }
            (Self::Absorbance(size), _) if fraction => Some(libm::exp10(-size * value)),
            (Self::Decibels, _) if fraction => Some(libm::exp10(0.1 * value)),
            (Self::DecibelMilliwatts, Wanted::Power) => Some(1e-3 * libm::exp10(0.1 * value)),
            (Self::Photons(each), Wanted::Power) => Some(value * each * PHOTON_J_NM / nm),
            (Self::PerFrequency(times), Wanted::Power) => Some(value * times / (nm * nm)),
            _ => None,
        }
    }

    /// Whether the user is told what is made of it.
    fn is_told(self, wanted: Wanted) -> bool {
        !matches!(
            (self, wanted),
            (Self::Plain, _)
                | (Self::Percent | Self::Relative, Wanted::Power)
                | (Self::Relative, Wanted::EfficiencyShape)
        )
    }

    /// Why a column of that name is not read.
    fn refusal(self, name: &str, wanted: Wanted) -> Error {
        match self {
            Self::Both(one, other) => Error::input(format!(
                "column {name:?} holds both {one} and {other}, by its header"
            ))
            .help("let its header name one of them"),
            Self::Refused(what, help) => {
                Error::input(format!("column {name:?} holds {what}")).help(help)
            }
            _ => {
                Error::input(format!("column {name:?} holds {}", self.name())).help(wanted.help())
            }
        }
    }

    /// The quantity in words.
    fn name(self) -> &'static str {
        match self {
            Self::Plain => "plain values",
            Self::Percent => "per cent",
            Self::Responsivity(_) => "responsivity in A/W",
            Self::Absorbance(1.0) => "absorbance or optical density",
            Self::Absorbance(1e-3) => "absorbance in thousandths (mAU)",
            Self::Absorbance(size) if size < 0.0 => "logarithms of a transmittance",
            Self::Absorbance(_) => "absorbance on the scale of natural logarithms",
            Self::Decibels => "decibels",
            Self::DecibelMilliwatts => "dBm",
            Self::Photons(_) => "numbers of photons",
            Self::PerFrequency(_) => PER_FREQUENCY,
            Self::Relative => "relative values",
            Self::Refused(what, _) | Self::Both(what, _) => what,
        }
    }
}

/// What a header names that is not read as a power.
fn no_power(header: &Header) -> Option<Quantity> {
    let (photons, per_frequency) = (header.photons().is_some(), header.per_frequency().is_some());
    if header.is_luminous() {
        Some(Quantity::Refused(
            "light weighted by the eye (lm, lx)",
            "give spectral power, per nm, or numbers of photons",
        ))
    } else if photons && header.is_watts() {
        Some(Quantity::Both(Quantity::Photons(1.0).name(), "power in W"))
    } else if per_frequency && header.is_per_nm() {
        Some(Quantity::Both(PER_FREQUENCY, "power per nm"))
    } else if per_frequency && (photons || header.decibels().is_some()) {
        Some(Quantity::Refused(
            "photons or decibels per frequency or wavenumber",
            "give them per nm",
        ))
    } else if header.is_spectral_by_frequency() && !per_frequency {
        Some(Quantity::Refused(PER_FREQUENCY, "give it per nm, or name the unit of the values"))
    } else if header.is_counts() {
        Some(Quantity::Refused(
            "counts of a spectrometer, each wavelength with a scale of its own",
            "correct them by the spectrometer's calibration; name the column power if they are \
             corrected",
        ))
    } else {
        None
    }
}

/// What a header names that electrons per photon are not made of.
fn no_efficiency(header: &Header, wanted: Wanted) -> Option<Quantity> {
    if header.is_per_exposure() {
        Some(Quantity::Refused(
            "a responsivity that takes the pixel's area and gain to be electrons per photon",
            Wanted::Efficiency.help(),
        ))
    } else if wanted == Wanted::Efficiency
        && header.is_bare_responsivity()
        && header.amperes_per_watt().is_none()
    {
        Some(Quantity::Refused("a responsivity of unknown unit", wanted.help()))
    } else {
        None
    }
}

/// What a header names that fractions of light are not made of, above all transmittances.
fn no_fraction(header: &Header, wanted: Wanted) -> Option<Quantity> {
    let of_filter = wanted == Wanted::Transmittance;
    let what = if header.is_coefficient() {
        "absorption per length or concentration"
    } else if header.is_absorbed() {
        "fractions of light that are absorbed"
    } else if of_filter && header.is_reflectance() {
        "reflectances, not transmittances"
    } else if of_filter && header.is_loss() && header.decibels().is_none() {
        "a loss of unknown scale"
    } else if of_filter && header.is_rating_alone() {
        return Some(Quantity::Refused(
            "transmittances or optical densities: its header does not say which",
            "name it transmittance or optical density",
        ));
    } else {
        return None;
    };
    Some(Quantity::Refused(what, wanted.help()))
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
            Self::Transmittance => {
                "give transmittances as fractions or per cent; absorbance and negative decibels \
                 are read too"
            }
            Self::Power => "give spectral power, numbers of photons, or dBm",
        }
    }
}

impl SpectralTable {
    /// What the values of the columns are.
    fn quantities(&self, wanted: Wanted) -> Vec<Quantity> {
        if self.is_converted {
            return vec![Quantity::Plain; self.headers.len()];
        }
        self.headers.iter().map(|header| Quantity::of(header, wanted)).collect()
    }

    /// Whether no column's header says that its values are other than what is wanted.
    pub fn is_plain(&self, wanted: Wanted) -> bool {
        self.quantities(wanted).iter().all(|quantity| *quantity == Quantity::Plain)
    }

    /// Converts the columns to what is wanted, and remarks on it.
    ///
    /// # Errors
    /// A column of another quantity, or of two.
    pub fn convert(&mut self, wanted: Wanted) -> Result<()> {
        let quantities = self.quantities(wanted);
        for ((name, values), quantity) in self.curves.iter_mut().zip(&quantities) {
            for (value, nm) in values.iter_mut().zip(&self.wavelength_nm) {
                *value = quantity
                    .convert(wanted, *value, *nm)
                    .ok_or_else(|| quantity.refusal(name, wanted))?;
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
        self.is_converted = true;
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

    fn check(cases: &[(&str, f64, Wanted, f64)]) {
        for &(header, value, wanted, right) in cases {
            let found =
                converted(header, value, wanted).unwrap_or_else(|e| panic!("{header}: {e}"));
            assert!((found / right - 1.0).abs() < 1e-5, "{header}: {found}, not {right}");
        }
    }

    #[test]
    fn efficiencies_are_what_their_header_says() {
        let wanted = Wanted::Efficiency;
        check(&[
            ("QE", 0.5, wanted, 0.5),
            ("QE (%)", 50.0, wanted, 0.5),
            ("QE%", 50.0, wanted, 0.5),
            ("QE (+/- 5%)", 0.5, wanted, 0.5),
            ("Abs. QE (per cent)", 50.0, wanted, 0.5),
            ("QE (e-/photon)", 0.5, wanted, 0.5),
            ("QE (electrons per photon, 100 lux)", 0.5, wanted, 0.5),
            ("Photon detection efficiency", 0.3, wanted, 0.3),
            ("A", 0.3, wanted, 0.3),
            // 0.2 A/W at 500 nm: 0.2·1239.84/500.
            ("Responsivity (A/W)", 0.2, wanted, 0.495_937),
            ("Responsivity [mA/W]", 200.0, Wanted::EfficiencyShape, 0.495_937),
            ("R (A W-1)", 0.2, wanted, 0.495_937),
            ("R (A·W^-1)", 0.2, wanted, 0.495_937),
            ("R (A.W⁻¹)", 0.2, wanted, 0.495_937),
            ("R / A W^{-1}", 0.2, wanted, 0.495_937),
            ("R (mAW-1)", 200.0, wanted, 0.495_937),
            ("R (µA/mW)", 200.0, wanted, 0.495_937),
        ]);
    }

    #[test]
    fn fractions_are_what_their_header_says() {
        let (wanted, filter) = (Wanted::Fraction, Wanted::Transmittance);
        check(&[
            ("Absorbance", 0.602_06, wanted, 0.25),
            ("OD", 2.0, wanted, 0.01),
            ("Abs", 1.0, wanted, 0.1),
            ("Transmission (dB)", -6.0206, wanted, 0.25),
            ("%T", 25.0, wanted, 0.25),
            // Names of materials.
            ("A", 0.3, wanted, 0.3),
            ("R (%)", 30.0, wanted, 0.3),
            ("Reflectance (%)", 30.0, wanted, 0.3),
            ("density", 0.3, wanted, 0.3),
            ("O.D.", 2.0, filter, 0.01),
            ("Optical density (10 mm)", 2.0, filter, 0.01),
            ("Optical transmission (%)", 25.0, filter, 0.25),
            ("Density", 2.0, filter, 0.01),
            ("A", 2.0, filter, 0.01),
            ("A (a.u.)", 2.0, filter, 0.01),
            ("Absorbance [mAU]", 602.06, filter, 0.25),
            ("mOD", 602.06, filter, 0.25),
            ("-log(T)", 0.602_06, filter, 0.25),
            ("−log₁₀(T)", 0.602_06, filter, 0.25),
            ("log10(1/T)", 0.602_06, filter, 0.25),
            ("log10(transmittance)", -0.602_06, filter, 0.25),
            ("-ln(T)", 1.386_294, filter, 0.25),
            ("Absorbance, -log10(T)", 0.602_06, filter, 0.25),
            // What a filter is sold as says nothing of its values.
            ("OD6 bandpass (%)", 25.0, filter, 0.25),
            ("Transmittance, OD > 4", 0.25, filter, 0.25),
            ("Transmittance (with reflection losses)", 0.25, filter, 0.25),
        ]);
    }

    #[test]
    fn powers_are_what_their_header_says() {
        let wanted = Wanted::Power;
        check(&[
            ("Relative power", 0.7, wanted, 0.7),
            ("A", 0.7, wanted, 0.7),
            ("Abs. irradiance (µW/cm²/nm)", 0.7, wanted, 0.7),
            ("Irradiance (W/m2/nm/lx)", 0.7, wanted, 0.7),
            ("LED 100 Hz, 800 lm", 0.7, wanted, 0.7),
            ("Power (dBm)", 3.0103, wanted, 2e-3),
            ("Optical power (dBm/nm)", 3.0103, wanted, 2e-3),
            // A µmol of photons of 500 nm: 0.119627 J·m/mol / 500 nm.
            ("Photon flux [umol/m2/s/nm]", 1.0, wanted, 0.239_253),
            ("PFD (μmol·m⁻²·s⁻¹·nm⁻¹)", 1.0, wanted, 0.239_253),
            ("PFD (umolm-2s-1nm-1)", 1.0, wanted, 0.239_253),
            ("PFD / mmol m-2 s-1 nm-1", 1e-3, wanted, 0.239_253),
            ("PFD (mol m-2 s-1 nm-1)", 1e-6, wanted, 0.239_253),
            ("Quantum irradiance (uE/m2/s/nm)", 1.0, wanted, 0.239_253),
            // A photon of 500 nm: 6.62607e-34·2.99792e8/500e-9 J.
            ("Spectral flux (photons/s/cm2/nm)", 1e19, wanted, 3.972_892),
            ("photons/cm²/s/nm", 1e19, wanted, 3.972_892),
            ("Flux (ph/s/nm)", 1e19, wanted, 3.972_892),
            ("Photon counts", 1e19, wanted, 3.972_892),
            ("photon number", 1e19, wanted, 3.972_892),
            ("F_nu (W/m2/Hz)", 1e-12, wanted, 1.199_170),
            ("I(λ)", 0.7, wanted, 0.7),
            ("Irradiance (W·m⁻²·nm⁻¹)", 0.7, wanted, 0.7),
            ("Photon radiance", 1e19, wanted, 3.972_892),
            // c/λ²: 2.99792e8/(500e-9)² Hz/m; 1e7/500²; 1239.84/500².
            ("W/m2/Hz", 1e-12, wanted, 1.199_170),
            ("Spectral power (mW/THz)", 1.0, wanted, 1.199_170),
            ("Radiance (W/m2/sr/cm-1)", 1.0, wanted, 40.0),
            ("W m⁻² sr⁻¹ (cm⁻¹)⁻¹", 1.0, wanted, 40.0),
            ("W/m2/eV", 100.0, wanted, 0.495_937),
        ]);
    }

    fn refused(header: &str, wanted: Wanted, says: &str) {
        let error = converted(header, 0.5, wanted).expect_err(header).to_string();
        assert!(error.contains("holds") && error.contains(says), "{header}: {error}");
    }

    #[test]
    fn values_of_another_kind_are_refused() {
        for (header, wanted, says) in [
            ("Responsivity (A/W)", Wanted::Fraction, "give fractions"),
            ("Absorbance", Wanted::Efficiency, "give electrons per photon"),
            ("Transmission (dB)", Wanted::Power, "give spectral power"),
            ("Power (dBm)", Wanted::Fraction, "give fractions"),
            ("R (V/(uJ/cm2))", Wanted::Efficiency, "area and gain"),
            ("DN/(nJ/cm2)", Wanted::EfficiencyShape, "area and gain"),
            ("V/lx/s", Wanted::Efficiency, "area and gain"),
            ("R (A/(W/cm2))", Wanted::Efficiency, "area and gain"),
            ("Responsivity", Wanted::Efficiency, "unknown unit"),
            ("log10(W/m2/nm)", Wanted::Power, "logarithms"),
            ("lm/nm", Wanted::Power, "weighted by the eye"),
            ("dBm/THz", Wanted::Power, "give them per nm"),
            ("photons/s/Hz", Wanted::Power, "give them per nm"),
            ("F_nu", Wanted::Power, "per frequency"),
            ("Counts", Wanted::Power, "counts of a spectrometer"),
            ("Intensity (counts)", Wanted::Power, "counts of a spectrometer"),
            ("Luminous flux", Wanted::Power, "weighted by the eye"),
            ("lambda*I(lambda)", Wanted::Power, "times their wavelength"),
            ("I(λ)·λ", Wanted::Power, "times their wavelength"),
            ("λI(λ)", Wanted::Power, "times their wavelength"),
        ] {
            refused(header, wanted, says);
        }
    }

    #[test]
    fn values_of_another_scale_are_refused() {
        for header in [
            "T (‰)",
            "T (ppm)",
            "T (per mille)",
            "T*1000",
            "T × 100",
            "T x 100",
            "T (x10^-2)",
            "T (×10⁻²)",
            "T (10^-3)",
            "T (1e-3)",
        ] {
            refused(header, Wanted::Transmittance, "another scale");
            refused(&header.replace('T', "QE"), Wanted::Efficiency, "another scale");
        }
        for header in ["1-T", "1/T", "100-%T", "Loss (1-T)", "1 - Transmission"] {
            refused(header, Wanted::Transmittance, "left of the whole");
        }
        refused("1-R", Wanted::Fraction, "left of the whole");
    }

    #[test]
    fn numbers_that_are_no_scale_are_names_and_sizes() {
        check(&[
            ("T (10 x 10 mm)", 0.25, Wanted::Transmittance, 0.25),
            ("T (10 mm)", 0.25, Wanted::Transmittance, 0.25),
            ("x10", 0.25, Wanted::Fraction, 0.25),
            ("patch 100", 0.25, Wanted::Fraction, 0.25),
            ("1-A", 0.25, Wanted::Fraction, 0.25),
            ("reflectance10", 0.25, Wanted::Fraction, 0.25),
            ("QE (100x100 pixels)", 0.25, Wanted::Efficiency, 0.25),
        ]);
    }

    #[test]
    fn filters_tell_transmittance() {
        for (header, says) in [
            ("Absorption (%)", "absorbed"),
            ("A (%)", "absorbed"),
            ("Absorptance", "absorbed"),
            ("%R", "reflectances"),
            ("R%", "reflectances"),
            ("R (%)", "reflectances"),
            ("Reflectivity", "reflectances"),
            ("OD6", "does not say which"),
            ("OD 0.3", "does not say which"),
            ("Neutral density", "does not say which"),
            ("Absorption coefficient (1/cm)", "per length"),
            ("ε (L mol-1 cm-1)", "per length"),
            ("Attenuation", "a loss"),
            ("2-log10(%T)", "logarithms"),
        ] {
            refused(header, Wanted::Transmittance, says);
        }
    }

    #[test]
    fn headers_that_contradict_themselves_are_refused() {
        for (header, wanted, says) in [
            ("T (% or dB)", Wanted::Transmittance, "both decibels and per cent"),
            ("Optical density (dB)", Wanted::Fraction, "both absorbance"),
            ("R (%, A/W)", Wanted::Efficiency, "both responsivity in A/W and per cent"),
            ("Photon flux (W/nm)", Wanted::Power, "both numbers of photons and power in W"),
            ("W/nm (per Hz)", Wanted::Power, "both power per frequency"),
        ] {
            refused(header, wanted, says);
        }
    }

    /// Headers of blanks may stand undivided above two columns of numbers.
    #[test]
    fn the_words_of_wavelength_are_not_of_the_values() {
        let text = "Wavelength (nm) Optical density\n500 2\n510 2\n";
        let mut table = SpectralTable::parse(text).unwrap();
        table.convert(Wanted::Transmittance).unwrap();
        assert!((table.curves[0].1[0] - 0.01).abs() < 1e-12, "{table:?}");
        let told = "its values are taken as absorbance or optical density, as its header says";
        assert_eq!(table.remarks, [told]);
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
