//! What the values of a table's column are, by a closed list of names and the grammar of units, and
//! their conversion to fractions or powers. What is in neither is refused, and the line `# unit:`
//! of the table says what it is.

use crate::table_column::Column;
use crate::unit::{Base, PHOTON_EV_NM, Unit};
use crate::{Error, Result};

/// Energy of a photon of 1 nm, J: hc.
const PHOTON_J_NM: f64 = 1.986_445_857e-16;
/// Photons in a mole.
const MOLE_PHOTONS: f64 = 6.022_140_76e23;
/// Times a power per Hz over the square of the wavelength in nm it is a power per nm: c in nm/s.
const LIGHT_NM_PER_S: f64 = 2.997_924_58e17;
/// The same of a power per 1/cm: nm in a cm.
const CM_NM: f64 = 1e7;
/// Absorbance on the scale of natural logarithms in absorbance: log10 e.
const NAPIERIAN: f64 = std::f64::consts::LOG10_E;

/// What a table is read for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Wanted {
    /// Electrons per photon.
    Efficiency,
    /// Electrons per photon up to a factor.
    EfficiencyShape,
    /// Reflectances and other fractions of light; columns have names of materials.
    Fraction,
    /// Transmittances.
    Transmittance,
    /// Spectral power.
    Power,
}

/// What a name means.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Transmittance,
    Reflectance,
    Efficiency,
    Responsivity,
    /// Minus the decimal logarithm of a transmittance, in units of this size.
    Absorbance(f64),
    Power,
    Photons,
    /// Something that is not read.
    Other(&'static str),
    /// A name that says nothing of the values.
    Label,
}

const COUNTS: &str = "counts of a spectrometer, each wavelength with a scale of its own";
const WEIGHTED: &str = "light weighted by the eye";
const ABSORBED: &str =
    "absorbance, or fractions of light that are absorbed: its header does not say which";
const LOSS: &str = "a loss of unknown scale";
const REST: &str = "what is left of the whole, or inverse values";

/// The names that are known, in small letters, without units and adjectives.
const NAMES: &[(&[&str], Kind)] = &[
    (
        &["t", "trans", "transmittance", "transmission", "transmissivity", "throughput"],
        Kind::Transmittance,
    ),
    (
        &["r", "refl", "reflectance", "reflectance factor", "reflectivity", "reflection"],
        Kind::Reflectance,
    ),
    (
        &[
            "qe",
            "eqe",
            "pde",
            "efficiency",
            "quantum efficiency",
            "external quantum efficiency",
            "photon detection efficiency",
        ],
        Kind::Efficiency,
    ),
    (&["responsivity"], Kind::Responsivity),
    (
        &[
            "a",
            "abs",
            "absorbance",
            "extinction",
            "density",
            "optical density",
            "transmission density",
            "transmittance density",
            "od",
            "o.d.",
            "-log(t)",
            "-log10(t)",
            "log(1/t)",
            "log10(1/t)",
        ],
        Kind::Absorbance(1.0),
    ),
    (&["log(t)", "log10(t)", "log10(transmittance)"], Kind::Absorbance(-1.0)),
    (
        &["optical depth", "optical thickness", "napierian absorbance", "-ln(t)", "ln(1/t)"],
        Kind::Absorbance(NAPIERIAN),
    ),
    (
        &[
            "power",
            "power distribution",
            "spd",
            "energy",
            "emission",
            "exitance",
            "flux",
            "intensity",
            "irradiance",
            "radiance",
            "radiant exitance",
            "radiant flux",
            "radiant intensity",
            "radiant power",
            "spectrum",
            "value",
            "values",
            "i",
            "l",
            "p",
            "s",
            "y",
            // Names of the CIE's illuminants.
            "c",
            "d50",
            "d55",
            "d65",
            "d75",
            "e",
        ],
        Kind::Power,
    ),
    (
        &[
            "pfd",
            "photons",
            "photon count",
            "photon counts",
            "photon exitance",
            "photon fluence",
            "photon flux",
            "photon flux density",
            "photon intensity",
            "photon irradiance",
            "photon number",
            "photon radiance",
            "photon rate",
            "quantum flux",
            "quantum irradiance",
        ],
        Kind::Photons,
    ),
    (&["counts", "count", "cps", "adu", "dn"], Kind::Other(COUNTS)),
    (&["illuminance", "luminance", "luminous flux", "luminous intensity"], Kind::Other(WEIGHTED)),
    (&["absorption", "absorptance", "absorptivity", "absorbed"], Kind::Other(ABSORBED)),
    (&["attenuation", "insertion loss", "loss"], Kind::Other(LOSS)),
    (&["1-t", "1-r", "1-qe", "1/t", "1/r", "100-t", "100-r"], Kind::Other(REST)),
];

/// Names of the columns of a quantum efficiency other than single letters.
const CHANNELS: &[&str] =
    &["red", "green", "blue", "gr", "gb", "mono", "monochrome", "clear", "white", "nir", "ir"];

/// Scales that are no units, in small letters.
const ARBITRARY: &[&str] = &[
    "a.u.",
    "au",
    "arb",
    "arb.",
    "arb. unit",
    "arb. units",
    "arb. u.",
    "arbitrary units",
    "normalised",
    "normalized",
    "rel",
    "rel.",
    "relative",
    "relative units",
];

/// What a column's name means.
struct Named {
    kind: Kind,
    /// Whether it says that the values are relative.
    is_relative: bool,
    /// Whether the whole header is a name, brackets too: `-log(T)`.
    is_whole: bool,
}

/// What values are measured in.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Scale {
    Linear(Unit),
    /// Minus the decimal logarithm, in units of this size.
    Absorbance(f64),
    Decibels,
    DecibelMilliwatts,
    /// Relative to an unknown unit.
    Arbitrary,
}

impl Scale {
    fn parse(text: &str) -> Result<Self> {
        Ok(match &*text.to_lowercase() {
            "od" | "o.d." | "abs" | "absorbance" => Self::Absorbance(1.0),
            "mod" | "mabs" | "mau" => Self::Absorbance(1e-3),
            "db" => Self::Decibels,
            "dbm" | "dbm/nm" => Self::DecibelMilliwatts,
            other if ARBITRARY.contains(&other) => Self::Arbitrary,
            _ => Self::Linear(Unit::parse(text)?),
        })
    }
}

/// What the values of a column are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Quantity {
    /// Fractions, or power: what the table is read for.
    Plain,
    /// Fractions in a unit such as per cent.
    Fraction(Unit),
    /// Photocurrent over power; size of its unit in A/W.
    Responsivity(f64),
    /// Minus the decimal logarithm of a transmittance (absorbance, optical density); size of its
    /// unit.
    Absorbance(f64),
    /// Ten times the decimal logarithm of a transmittance.
    Decibels,
    /// Ten times the decimal logarithm of a power in mW.
    DecibelMilliwatts,
    /// Numbers of photons; how many its unit is.
    Photons(f64),
    /// Power per frequency, wavenumber or energy: times which it is a power per nm over the square
    /// of the wavelength in nm.
    PerFrequency(f64),
    /// Relative to an unknown scale.
    Relative,
}

impl Quantity {
    /// The quantity of a column in a table that is read for what is wanted; `unit` replaces what
    /// the header says, and a column that was `chosen` by its name need not have a known one.
    /// `None` for a name that is not known.
    ///
    /// # Errors
    /// A unit that is not understood, a quantity that is not read, a name and a unit that
    /// contradict each other.
    pub fn of(
        column: &Column<'_>,
        unit: Option<&str>,
        is_chosen: bool,
        wanted: Wanted,
    ) -> Result<Option<Self>> {
        let (kind, unit, is_relative) = match unit {
            Some(unit) => (Kind::Label, Some(unit), false),
            None => match named(column, wanted) {
                Some(Named { kind, is_whole: true, .. }) => (kind, None, false),
                Some(Named { kind, is_relative, .. }) => {
                    (kind, column.unit.as_deref(), is_relative)
                }
                // `W/m2/nm`: a unit in place of a name.
                None if Scale::parse(column.header).is_ok() => {
                    (Kind::Label, Some(column.header), false)
                }
                None if is_chosen => (Kind::Label, column.unit.as_deref(), false),
                None => return Ok(None),
            },
        };
        let refused = |what: String| {
            Error::input(format!("column {:?} holds {what}", column.header)).help(wanted.help())
        };
        let scale = unit.filter(|unit| !unit.is_empty()).map(Scale::parse).transpose();
        let scale = scale.map_err(|e| {
            Error::input(format!("column {:?}: {}", column.header, e.what())).help(wanted.help())
        })?;
        if let Kind::Other(what) = kind {
            return Err(refused(what.into()));
        }
        let found = match wanted {
            Wanted::Efficiency | Wanted::EfficiencyShape => efficiency(kind, scale),
            Wanted::Fraction | Wanted::Transmittance => fraction(kind, scale, wanted),
            Wanted::Power => power(kind, scale),
        };
        let found = found.map_err(|what| match unit {
            Some(unit) => refused(format!("{what} (unit {unit:?})")),
            None => refused(what.into()),
        })?;
        Ok(Some(if found == Self::Plain && is_relative { Self::Relative } else { found }))
    }

    /// A value at a wavelength, nm, as what is wanted.
    pub fn convert(self, value: f64, nm: f64) -> f64 {
        match self {
            Self::Plain | Self::Relative => value,
            Self::Fraction(unit) => unit.of(value),
            Self::Responsivity(amperes) => value * amperes * PHOTON_EV_NM / nm,
            Self::Absorbance(size) => libm::exp10(-size * value),
            Self::Decibels => libm::exp10(0.1 * value),
            Self::DecibelMilliwatts => 1e-3 * libm::exp10(0.1 * value),
            Self::Photons(each) => value * each * PHOTON_J_NM / nm,
            Self::PerFrequency(times) => value * times / (nm * nm),
        }
    }

    /// The note on what the values are taken as, if that is not what was wanted.
    pub fn told(self, wanted: Wanted) -> Option<String> {
        let name = match self {
            Self::Plain => return None,
            Self::Relative if matches!(wanted, Wanted::Power | Wanted::EfficiencyShape) => {
                return None;
            }
            Self::Relative => {
                return Some("are relative, as its header says, and taken as they stand".into());
            }
            Self::Fraction(unit) if unit.factor() == 0.01 => "per cent".to_string(),
            Self::Fraction(unit) => format!("multiples of {}", unit.factor()),
            Self::Responsivity(_) => "responsivity in A/W".into(),
            Self::Absorbance(1.0) => "absorbance or optical density".into(),
            Self::Absorbance(1e-3) => "absorbance in thousandths (mAU)".into(),
            Self::Absorbance(size) if size < 0.0 => "logarithms of a transmittance".into(),
            Self::Absorbance(_) => "absorbance on the scale of natural logarithms".into(),
            Self::Decibels => "decibels".into(),
            Self::DecibelMilliwatts => "dBm".into(),
            Self::Photons(_) => "numbers of photons".into(),
            Self::PerFrequency(_) => "power per frequency or wavenumber".into(),
        };
        Some(format!("are taken as {name}, as its header says"))
    }
}

/// What a column's name means.
fn named(column: &Column<'_>, wanted: Wanted) -> Option<Named> {
    let is_letter = column.name().chars().count() == 1;
    let of_channel = matches!(wanted, Wanted::Efficiency | Wanted::EfficiencyShape)
        && (is_letter || CHANNELS.contains(&&*column.name().to_lowercase()));
    let label = Named { kind: Kind::Label, is_relative: false, is_whole: false };
    if column.header.is_empty() || of_channel || is_letter && wanted == Wanted::Fraction {
        return Some(label);
    }
    // The CIE's illuminant, not absorbance.
    if column.name() == "A" && wanted == Wanted::Power {
        return Some(Named { kind: Kind::Power, ..label });
    }
    let known = |name: &str| {
        let (_, kind) = NAMES.iter().find(|(names, _)| names.contains(&name))?;
        Some(*kind)
    };
    if let Some(kind) = known(&column.whole()) {
        return Some(Named { kind, is_whole: true, ..label });
    }
    let mut spellings = column.spellings();
    let found = spellings.find_map(|(name, is_relative)| {
        Some(Named { kind: known(&name)?, is_relative, is_whole: false })
    });
    // A material's name.
    found.or_else(|| (wanted == Wanted::Fraction).then_some(label))
}

fn efficiency(kind: Kind, scale: Option<Scale>) -> Result<Quantity, &'static str> {
    use Base::{Count, Current, Electron, Energy, Length, Luminous, Photon, Time, Voltage};
    let Some(scale) = scale else {
        return match kind {
            Kind::Efficiency | Kind::Label => Ok(Quantity::Plain),
            Kind::Responsivity => Err("a responsivity of unknown unit"),
            _ => Err("no quantum efficiency"),
        };
    };
    let plain = matches!(kind, Kind::Efficiency | Kind::Label);
    match scale {
        Scale::Linear(unit)
            if unit.is_dimensionless() || unit.is(&[(Electron, 1), (Photon, -1)]) =>
        {
            plain.then(|| Quantity::in_fractions(unit)).ok_or("no quantum efficiency by its name")
        }
        Scale::Linear(unit) if unit.is(&[(Current, 1), (Energy, -1), (Time, 1)]) => match kind {
            Kind::Responsivity | Kind::Label => Ok(Quantity::Responsivity(unit.factor())),
            _ => Err("no responsivity by its name"),
        },
        Scale::Linear(unit)
            if [Voltage, Count, Current].iter().any(|base| unit.power(*base) > 0)
                && [Energy, Length, Luminous].iter().any(|base| unit.power(*base) != 0) =>
        {
            Err("a responsivity that takes the pixel's area and gain to be electrons per photon")
        }
        Scale::Arbitrary if plain => Ok(Quantity::Relative),
        _ => Err("no quantum efficiency by its unit"),
    }
}

fn fraction(kind: Kind, scale: Option<Scale>, wanted: Wanted) -> Result<Quantity, &'static str> {
    let is_filter = wanted == Wanted::Transmittance;
    match (kind, scale) {
        (Kind::Absorbance(size), None | Some(Scale::Arbitrary)) => Ok(Quantity::Absorbance(size)),
        (Kind::Absorbance(size), Some(Scale::Absorbance(times))) => {
            Ok(Quantity::Absorbance(size * times))
        }
        (Kind::Absorbance(size), Some(Scale::Linear(unit)))
            if unit.is_dimensionless() && unit.factor() == 1.0 =>
        {
            Ok(Quantity::Absorbance(size))
        }
        (Kind::Absorbance(_), _) => Err("absorbance by its name, and something else by its unit"),
        (Kind::Reflectance, _) if is_filter => Err("reflectances, not transmittances"),
        (Kind::Power | Kind::Photons | Kind::Responsivity, _) => Err("no fractions of light"),
        (Kind::Efficiency, _) if is_filter => Err("efficiencies, not transmittances"),
        (_, None) => Ok(Quantity::Plain),
        (_, Some(Scale::Linear(unit))) if unit.is_dimensionless() => {
            Ok(Quantity::in_fractions(unit))
        }
        (_, Some(Scale::Absorbance(size))) => Ok(Quantity::Absorbance(size)),
        (_, Some(Scale::Decibels)) => Ok(Quantity::Decibels),
        (_, Some(Scale::Arbitrary)) => Ok(Quantity::Relative),
        _ => Err("no fractions of light by its unit"),
    }
}

fn power(kind: Kind, scale: Option<Scale>) -> Result<Quantity, &'static str> {
    use Base::{
        Amount, Count, Energy, Frequency, Length, Luminous, Photon, PhotonEnergy, SolidAngle,
        Time, Wavelength, Wavenumber,
    };
    if !matches!(kind, Kind::Power | Kind::Photons | Kind::Label) {
        return Err("no spectral power");
    }
    let of_name = if kind == Kind::Photons { Quantity::Photons(1.0) } else { Quantity::Plain };
    let unit = match scale {
        None => return Ok(of_name),
        Some(Scale::Linear(unit)) if unit.is_dimensionless() => return Ok(of_name),
        Some(Scale::Linear(unit)) => unit,
        Some(Scale::DecibelMilliwatts) if kind != Kind::Photons => {
            return Ok(Quantity::DecibelMilliwatts);
        }
        Some(Scale::Arbitrary) if kind == Kind::Photons => return Ok(of_name),
        Some(Scale::Arbitrary) => return Ok(Quantity::Relative),
        _ => return Err("no spectral power by its unit"),
    };
    let power = |base| unit.power(base);
    if power(Luminous) > 0 {
        return Err(WEIGHTED);
    }
    if power(Count) > 0 {
        return Err(COUNTS);
    }
    // How much light, of what area and time: a factor that is that of all wavelengths.
    let is_even = matches!(power(Length), 0 | -2)
        && matches!(power(SolidAngle), 0 | -1)
        && matches!(power(Time), 0 | -1)
        && matches!(power(Luminous), 0 | -1);
    let per = [Wavelength, Wavenumber, Frequency, PhotonEnergy].map(power);
    let photons = match (power(Photon), power(Amount)) {
        (0, 0) => None,
        (1, 0) => Some(1.0),
        (0 | 1, 1) => Some(MOLE_PHOTONS),
        _ => return Err("no spectral power by its unit"),
    };
    let energy = power(Energy) == 1 && photons.is_none();
    let of_photons = photons.filter(|_| power(Energy) == 0);
    match (energy, of_photons, per) {
        _ if !is_even => Err("no spectral power by its unit"),
        (true, _, [0 | -1, 0, 0, 0]) if kind != Kind::Photons => Ok(Quantity::Plain),
        (true, _, _) if kind == Kind::Photons => {
            Err("numbers of photons by its name, power by its unit")
        }
        (true, _, [0, -1, 0, 0]) => Ok(Quantity::PerFrequency(CM_NM * unit.factor())),
        (true, _, [0, 0, -1, 0]) => Ok(Quantity::PerFrequency(LIGHT_NM_PER_S * unit.factor())),
        (true, _, [0, 0, 0, -1]) => Ok(Quantity::PerFrequency(PHOTON_EV_NM * unit.factor())),
        (_, Some(each), [0 | -1, 0, 0, 0]) => Ok(Quantity::Photons(unit.factor() * each)),
        (_, Some(_), _) => Err("numbers of photons per frequency or wavenumber"),
        _ => Err("no spectral power by its unit"),
    }
}

impl Quantity {
    fn in_fractions(unit: Unit) -> Self {
        if unit.factor() == 1.0 { Self::Plain } else { Self::Fraction(unit) }
    }
}

impl Wanted {
    /// What to do where a table is not understood.
    pub fn help(self) -> &'static str {
        match self {
            Self::Efficiency | Self::EfficiencyShape => {
                "give electrons per photon, in a column named QE or by its channel; or a line such \
                 as \"# unit: %\" or \"# unit: A/W\" that says what the values are in"
            }
            Self::Fraction => {
                "give fractions or per cent; or a line such as \"# unit: %\", \"# unit: OD\" or \
                 \"# unit: dB\" that says what the values are in"
            }
            Self::Transmittance => {
                "name the column transmittance or optical density; or give a line such as \
                 \"# unit: 1\", \"# unit: %\", \"# unit: OD\" or \"# unit: dB\" that says which \
                 transmittance it holds"
            }
            Self::Power => {
                "name the column power or photon flux; or give a line such as \"# unit: W/m2/nm\", \
                 \"# unit: photons/s/nm\" or \"# unit: 1\" that says what the values are in"
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::SpectralTable;

    fn converted(header: &str, value: f64, wanted: Wanted) -> Result<f64> {
        let mut table = SpectralTable::parse(&format!("wavelength_nm,{header}\n500,{value}\n"))?;
        table.convert(wanted)?;
        Ok(table.curves[0].1[0])
    }

    fn check(wanted: Wanted, cases: &[(&str, f64, f64)]) {
        for &(header, value, right) in cases {
            let found =
                converted(header, value, wanted).unwrap_or_else(|e| panic!("{header}: {e}"));
            assert!((found / right - 1.0).abs() < 1e-5, "{header}: {found}, not {right}");
        }
    }

    fn refused(wanted: Wanted, headers: &[&str], says: &str) {
        for header in headers {
            let error = converted(header, 0.5, wanted).expect_err(header).to_string();
            let shown = format!("{header:?}");
            assert!(error.contains(&shown) && error.contains(says), "{header}: {error}");
            assert!(error.contains("# unit: "), "{header}: {error}");
        }
    }

    #[test]
    fn efficiencies_are_what_their_header_says() {
        check(
            Wanted::Efficiency,
            &[
                ("QE", 0.5, 0.5),
                ("mono", 0.5, 0.5),
                ("QE (%)", 50.0, 0.5),
                ("QE%", 50.0, 0.5),
                ("Abs. QE (per cent)", 50.0, 0.5),
                ("QE (e-/photon)", 0.5, 0.5),
                ("QE (electrons per photon)", 0.5, 0.5),
                ("QE (‰)", 500.0, 0.5),
                ("Photon detection efficiency", 0.3, 0.3),
                ("m", 0.3, 0.3),
                // 0.2 A/W at 500 nm: 0.2·1239.84/500.
                ("Responsivity (A/W)", 0.2, 0.495_937),
                ("Responsivity [mA/W]", 200.0, 0.495_937),
                ("R (A W-1)", 0.2, 0.495_937),
                ("R (A·W^-1)", 0.2, 0.495_937),
                ("R (A.W⁻¹)", 0.2, 0.495_937),
                ("R / A W^{-1}", 0.2, 0.495_937),
                ("R (mAW-1)", 200.0, 0.495_937),
                ("R (µA/mW)", 200.0, 0.495_937),
            ],
        );
        refused(
            Wanted::Efficiency,
            &["Absorbance", "Responsivity", "Responsivity (%)", "QE (A/W)", "R (V/(uJ/cm2))"],
            "holds",
        );
        refused(Wanted::Efficiency, &["DN/(nJ/cm2)", "V/lx/s", "R (A/(W/cm2))"], "area and gain");
        refused(Wanted::Efficiency, &["QE (+/- 5%)", "QE (electrons, 100 lux)"], "not understood");
        refused(Wanted::Efficiency, &["QE*1000", "QE x 100", "Sensitivity"], "no quantity");
    }

    #[test]
    fn fractions_are_what_their_header_says() {
        check(
            Wanted::Fraction,
            &[
                ("Absorbance", 0.602_06, 0.25),
                ("OD", 2.0, 0.01),
                ("Transmission (dB)", -6.0206, 0.25),
                ("%T", 25.0, 0.25),
                // Names of materials.
                ("A", 0.3, 0.3),
                ("R (%)", 30.0, 0.3),
                ("Reflectance (%)", 30.0, 0.3),
                ("patch 100", 0.25, 0.25),
                ("1-A", 0.25, 0.25),
                ("dark skin", 0.25, 0.25),
            ],
        );
        refused(Wanted::Fraction, &["Responsivity (A/W)", "Power (dBm)", "1-R"], "holds");
    }

    #[test]
    fn transmittances_are_what_their_header_says() {
        check(
            Wanted::Transmittance,
            &[
                ("Transmittance", 0.25, 0.25),
                ("T (‰)", 250.0, 0.25),
                ("O.D.", 2.0, 0.01),
                ("Optical density", 2.0, 0.01),
                ("Optical transmission (%)", 25.0, 0.25),
                ("Density", 2.0, 0.01),
                ("A", 2.0, 0.01),
                ("A (a.u.)", 2.0, 0.01),
                ("Absorbance [mAU]", 602.06, 0.25),
                ("mOD", 602.06, 0.25),
                ("-log(T)", 0.602_06, 0.25),
                ("−log₁₀(T)", 0.602_06, 0.25),
                ("log10(1/T)", 0.602_06, 0.25),
                ("log10(transmittance)", -0.602_06, 0.25),
                ("-ln(T)", 1.386_294, 0.25),
            ],
        );
        refused(
            Wanted::Transmittance,
            &["T*1000", "T × 100", "100-%T", "OD6 bandpass", "Neutral density", "foo"],
            "no quantity that is known",
        );
        refused(
            Wanted::Transmittance,
            &["Absorption (%)", "Absorptance", "%R", "Reflectivity", "Attenuation", "1-T", "1/T"],
            "holds",
        );
        refused(Wanted::Transmittance, &["Optical density (dB)", "Absorbance (%)"], "by its name");
        refused(
            Wanted::Transmittance,
            &[
                "T (% or dB)",
                "T (with reflection losses)",
                "T (x10^-2)",
                "Optical density (10 kg)",
            ],
            "not understood",
        );
        refused(Wanted::Transmittance, &["T (10 mm)"], "by its unit");
    }

    #[test]
    fn powers_are_what_their_header_says() {
        check(
            Wanted::Power,
            &[
                ("Relative power", 0.7, 0.7),
                ("A", 0.7, 0.7),
                ("D65", 0.7, 0.7),
                ("Abs. irradiance (µW/cm²/nm)", 0.7, 0.7),
                ("Irradiance (W/m2/nm/lx)", 0.7, 0.7),
                ("Power (dBm)", 3.0103, 2e-3),
                ("Optical power (dBm/nm)", 3.0103, 2e-3),
                // A µmol of photons of 500 nm: 0.119627 J·m/mol / 500 nm.
                ("Photon flux [umol/m2/s/nm]", 1.0, 0.239_253),
                ("PFD (μmol·m⁻²·s⁻¹·nm⁻¹)", 1.0, 0.239_253),
                ("PFD (umolm-2s-1nm-1)", 1.0, 0.239_253),
                ("PFD / mmol m-2 s-1 nm-1", 1e-3, 0.239_253),
                ("PFD (mol m-2 s-1 nm-1)", 1e-6, 0.239_253),
                ("PFD (µmol photons m-2 s-1)", 1.0, 0.239_253),
                ("Quantum irradiance (uE/m2/s/nm)", 1.0, 0.239_253),
                // A photon of 500 nm: 6.62607e-34·2.99792e8/500e-9 J.
                ("Spectral flux (photons/s/cm2/nm)", 1e15, 3.972_892),
                ("photons/cm²/s/nm", 1e15, 3.972_892),
                ("Flux (ph/s/nm)", 1e19, 3.972_892),
                ("Photon counts", 1e19, 3.972_892),
                ("photon number", 1e19, 3.972_892),
                ("Photon radiance", 1e19, 3.972_892),
                ("I(λ)", 0.7, 0.7),
                ("Irradiance (W·m⁻²·nm⁻¹)", 0.7, 0.7),
                // c/λ²: 2.99792e8/(500e-9)² Hz/m; 1e7/500²; 1239.84/500².
                ("W/m2/Hz", 1e-12, 1.199_170),
                ("Spectral power (mW/THz)", 1e3, 1.199_170),
                ("Radiance (W/m2/sr/cm-1)", 1.0, 40.0),
                ("W m⁻² sr⁻¹ (cm⁻¹)⁻¹", 1.0, 40.0),
                ("W/m2/eV", 100.0, 0.495_937),
            ],
        );
        refused(
            Wanted::Power,
            &["lm/nm", "Luminous flux", "Illuminance (lx)"],
            "weighted by the eye",
        );
        refused(
            Wanted::Power,
            &["Counts", "Intensity (counts)", "DN"],
            "counts of a spectrometer",
        );
        refused(Wanted::Power, &["photons/s/Hz"], "per frequency");
        refused(Wanted::Power, &["Photon flux (W/nm)"], "by its name, power by its unit");
        refused(Wanted::Power, &["Transmission (dB)", "Power (OD)", "Power (W/m)"], "holds no");
        refused(Wanted::Power, &["Power (furlongs)", "Power (W/nm, per Hz)"], "not understood");
        refused(
            Wanted::Power,
            &[
                "λI(λ)",
                "I(λ)·λ",
                "lambda*I(lambda)",
                "log10(W/m2/nm)",
                "F_nu",
                "Lamp 3",
                "dBm/THz",
            ],
            "no quantity",
        );
    }

    /// What the header does not say, the table may.
    #[test]
    fn the_unit_of_a_table_stands_for_its_header() {
        for (unit, wanted, value, right) in [
            ("%", Wanted::Transmittance, 25.0, 0.25),
            ("\"OD\"", Wanted::Transmittance, 2.0, 0.01),
            ("A/W", Wanted::Efficiency, 0.2, 0.495_937),
            ("photons/s/nm", Wanted::Power, 1e19, 3.972_892),
            ("1", Wanted::Power, 0.7, 0.7),
        ] {
            for key in ["unit:", "unit ="] {
                let text = format!("# {key} {unit}\nwavelength_nm,Loss of lamp 3\n500,{value}\n");
                let mut table = SpectralTable::parse(&text).unwrap();
                table.convert(wanted).unwrap_or_else(|e| panic!("{unit}: {e}"));
                assert!((table.curves[0].1[0] / right - 1.0).abs() < 1e-5, "{unit}: {table:?}");
            }
        }
        let text = "# unit: furlongs\nnm,T\n500,1\n";
        let error =
            SpectralTable::parse(text).unwrap().convert(Wanted::Transmittance).unwrap_err();
        assert!(error.to_string().contains("\"furlongs\" is not understood"), "{error}");
        let twice = SpectralTable::parse("# unit: 1\n# unit: %\nnm,T\n500,1\n").unwrap_err();
        assert!(twice.to_string().contains("line 2"), "{twice}");
    }

    #[test]
    fn one_of_several_columns_is_chosen_or_the_only_one_known() {
        let text = "Wavelength [nm],Irradiance [W/m2/nm],Std dev\n500,0.7,0.1\n";
        let mut table = SpectralTable::parse(text).unwrap();
        table.convert(Wanted::Power).unwrap();
        assert_eq!(table.curves.len(), 1);
        assert!(table.remarks[0].contains("\"Std dev\" is left out"), "{:?}", table.remarks);
        let chosen = "# column: lamp 2\nnm,Lamp 1 (W/nm),Lamp 2 (W/nm)\n500,0.7,0.1\n";
        let mut table = SpectralTable::parse(chosen).unwrap();
        table.convert(Wanted::Power).unwrap();
        assert_eq!(table.curves, [("Lamp 2".to_string(), vec![0.1])]);
        let none = SpectralTable::parse(&chosen.replace("lamp 2", "lamp 3")).unwrap_err();
        assert!(none.to_string().contains("Lamp 1, Lamp 2"), "{none}");
    }

    /// A header separated by blanks may not divide into its two columns.
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
