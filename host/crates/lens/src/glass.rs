//! Optical glasses: refractive index over wavelength, by catalogue name, formula, table or n_d,
//! V_d.
//!
//! Indices are relative to air at 20 °C and 1 atm, as catalogues give them; the tracer takes air
//! as 1. Wavelengths are in air, nm at the interface and µm inside the formulas.

use super::text::number;
use camrig_base::{Error, Result};
use std::collections::BTreeMap;
use std::sync::OnceLock;

/// A refractive medium.
#[derive(Clone, Debug, PartialEq)]
pub struct Glass {
    /// Its name, as in the catalogue or the file.
    pub name: String,
    /// How the index follows from the wavelength.
    pub dispersion: Dispersion,
    /// Wavelengths over which the data hold, nm.
    pub range_nm: [f64; 2],
}

/// Dispersion formulas; λ in µm.
#[derive(Clone, Debug, PartialEq)]
pub enum Dispersion {
    /// The same index at all wavelengths.
    Constant(f64),
    /// n² = 1 + offset + Σ B·λ²/(λ² − C) + Σ D/(λ² − E): Sellmeier 1, 3, 4 and 5, and with `poles`
    /// Sellmeier 2.
    Sellmeier {
        /// Constant part above 1.
        offset: f64,
        /// Pairs B, C (µm²).
        terms: Vec<[f64; 2]>,
        /// Pairs D (µm²), E (µm²).
        poles: Vec<[f64; 2]>,
    },
    /// Σ a·λ^p of n² (Schott, extended 1 to 3) or of n (Cauchy, Conrady).
    PowerSeries {
        /// Whether the sum is n² rather than n.
        squared: bool,
        /// Pairs a, p.
        terms: Vec<[f64; 2]>,
    },
    /// Indices at wavelengths (nm, strictly rising): between them a cubic through the four nearest
    /// in 1/λ², which is exact for n = A + B/λ² + C/λ⁴ + D/λ⁶.
    Table(Vec<[f64; 2]>),
    /// n = n_d + ν₁ω + ν₂ω², ω = (λ − λ_d)/(1 + 2.5·(λ − λ_d)) (Buchdahl 1954). n_d and V_d give
    /// one equation for the two coefficients; the other is the line on which Schott's glasses lie,
    /// ν₁ = −0.064667 − 1.604048·ν₂ (Reardon and Chipman, Appl. Opt. 28, 3520 (1989); constants as
    /// in the `opticalglass` library). A real glass differs by up to 1e-3 in the far blue.
    Model {
        /// Index at 587.5618 nm.
        nd: f64,
        /// Abbe number at the d, F and C lines.
        vd: f64,
    },
}

/// Helium d, hydrogen F and C lines, µm.
const D_LINE: f64 = 0.587_561_8;
const F_LINE: f64 = 0.486_132_7;
const C_LINE: f64 = 0.656_272_5;

/// How far beyond its range a formula is still used, as a fraction of the limit: enough for 400 nm
/// with plastics measured from 436 nm, too little for the far ultraviolet and infrared, where
/// formulas diverge.
const BEYOND: f64 = 0.15;
/// Refractive indices that are accepted; germanium, the highest of common infrared materials, has
/// 4.
const INDICES: std::ops::RangeInclusive<f64> = 1.0..=5.0;
/// Abbe numbers that are accepted; glasses and plastics have 15 to 100.
const ABBE_NUMBERS: std::ops::RangeInclusive<f64> = 5.0..=200.0;
/// Wavelengths for which a model glass is used, nm: where optical glasses transmit.
const MODEL_RANGE_NM: [f64; 2] = [300.0, 2500.0];
/// Least index that a formula may give: below it the wavelength lies in an absorption band.
const LEAST_INDEX: f64 = 0.5;

impl Glass {
    /// A model glass from n_d and V_d ([`Dispersion::Model`]).
    ///
    /// # Errors
    /// An index outside 1..=5 or an Abbe number outside 5..=200.
    pub fn model(nd: f64, vd: f64) -> Result<Self> {
        if !INDICES.contains(&nd) || !ABBE_NUMBERS.contains(&vd) {
            return Err(Error::input(format!("model glass with n_d {nd}, V_d {vd}"))
                .help("n_d lies in 1..5, V_d in 5..200"));
        }
        let name = format!("{nd}:{vd}");
        Ok(Self { name, dispersion: Dispersion::Model { nd, vd }, range_nm: MODEL_RANGE_NM })
    }

    /// A medium of constant index.
    ///
    /// # Errors
    /// An index outside 1..=5.
    pub fn constant(n: f64) -> Result<Self> {
        if !INDICES.contains(&n) {
            return Err(Error::input(format!("refractive index {n}")).help("it lies in 1..5"));
        }
        let range_nm = [1.0, 1e6];
        Ok(Self { name: format!("n={n}"), dispersion: Dispersion::Constant(n), range_nm })
    }

    /// A medium from a table of wavelength (nm) and index.
    ///
    /// # Errors
    /// Fewer than one row, wavelengths that do not rise, indices outside 1..=5.
    pub fn table(name: &str, rows: Vec<[f64; 2]>) -> Result<Self> {
        let rising = rows.windows(2).all(|w| w[1][0] > w[0][0]);
        let sane = rows.iter().all(|r| r[0] > 0.0 && INDICES.contains(&r[1]));
        match (rows.first(), rows.last()) {
            (Some(first), Some(last)) if rising && sane => {
                let range_nm = [first[0], last[0]];
                Ok(Self { name: name.into(), dispersion: Dispersion::Table(rows), range_nm })
            }
            _ => Err(Error::input(format!("index table of \"{name}\""))
                .help("give rows of wavelength (nm, rising) and index (1..5)")),
        }
    }

    /// The index at a wavelength, nm.
    ///
    /// # Errors
    /// A wavelength far outside the glass's data, or a formula without a real index there.
    pub fn index(&self, nm: f64) -> Result<f64> {
        let [low, high] = self.range_nm;
        if !(nm >= low * (1.0 - BEYOND) && nm <= high * (1.0 + BEYOND)) {
            return Err(Error::input(format!(
                "{nm} nm is outside the data of glass {}",
                self.name
            ))
            .help(format!("its index is known from {low} to {high} nm")));
        }
        let n = self.dispersion.index(nm * 1e-3);
        if n.is_finite() && n > LEAST_INDEX {
            return Ok(n);
        }
        Err(Error::input(format!("glass {} has no real index at {nm} nm", self.name))
            .help("check its coefficients"))
    }

    /// n_d and V_d, for display.
    #[must_use]
    pub fn nd_vd(&self) -> (f64, f64) {
        let n = |um| self.dispersion.index(um);
        (n(D_LINE), (n(D_LINE) - 1.0) / (n(F_LINE) - n(C_LINE)))
    }
}

impl Dispersion {
    fn index(&self, um: f64) -> f64 {
        let l2 = um * um;
        match self {
            Self::Constant(n) => *n,
            Self::Sellmeier { offset, terms, poles } => {
                let sum: f64 = terms.iter().map(|[b, c]| b * l2 / (l2 - c)).sum();
                let rest: f64 = poles.iter().map(|[d, e]| d / (l2 - e)).sum();
                (1.0 + offset + sum + rest).sqrt()
            }
            Self::PowerSeries { squared, terms } => {
                let sum: f64 = terms.iter().map(|[a, p]| a * libm::pow(um, *p)).sum();
                if *squared { sum.sqrt() } else { sum }
            }
            Self::Table(rows) => cubic(rows, um * 1e3),
            Self::Model { nd, vd } => {
                let omega = |um: f64| (um - D_LINE) / (1.0 + 2.5 * (um - D_LINE));
                let (f, c, w) = (omega(F_LINE), omega(C_LINE), omega(um));
                // Reardon and Chipman's line, see the variant's documentation.
                let (b, m) = (-0.064667, -1.604048);
                let nu2 = ((nd - 1.0) / vd - b * (f - c)) / (m * (f - c) + (f * f - c * c));
                nd + (b + m * nu2) * w + nu2 * w * w
            }
        }
    }
}

/// Lagrange interpolation in 1/λ² through the (up to) four rows nearest to `nm`.
fn cubic(rows: &[[f64; 2]], nm: f64) -> f64 {
    let points = rows.len().min(4);
    let after = rows.partition_point(|r| r[0] <= nm);
    let start = after.saturating_sub(points / 2).min(rows.len() - points);
    let near = &rows[start..start + points];
    let x = |nm: f64| 1.0 / (nm * nm);
    let weight = |i: usize| {
        let others = near.iter().enumerate().filter(|(j, _)| *j != i);
        others.map(|(_, r)| (x(nm) - x(r[0])) / (x(near[i][0]) - x(r[0]))).product::<f64>()
    };
    near.iter().enumerate().map(|(i, r)| weight(i) * r[1]).sum()
}

/// The glasses that a name may refer to: the built-in table, and those that a file defines itself.
#[derive(Clone, Debug, Default)]
pub struct Catalogue {
    own: BTreeMap<String, Glass>,
}

/// Names that other programs use for glasses of the built-in table, and their names in the table.
/// The Chinese catalogue renamed its lead-free glasses H-…; the `C` names are those older files
/// use.
const ALIASES: &[(&str, &str)] = &[
    ("BK7", "N-BK7"),
    ("F_SILICA", "SILICA"),
    ("ACRYLIC", "PMMA"),
    ("POLYCARBONATE", "POLYCARB"),
    ("POLYSTYRENE", "POLYSTYR"),
    ("LAK1C", "H-LAK1"),
    ("LAK10C", "H-LAK10"),
    ("LAF1C", "H-LAF1"),
    ("ZF7C", "ZF7"),
    ("ZK9C", "H-ZK9A"),
    ("L-TIM28_MOLD", "L-TIM28"),
];

impl Catalogue {
    /// Adds a glass under a name; it takes precedence over built-in glasses.
    pub fn insert(&mut self, name: &str, glass: Glass) {
        self.own.insert(key(name), glass);
    }

    /// The glass called `name`; of two makers' glasses of that name the one whose maker comes
    /// first in `makers`. Case, dashes and spaces do not matter. Also understood: `1.5168:64.17`
    /// (n_d:V_d), six digits `517642` or `517.642` (n_d − 1 and V_d), `NAME_MAKER`.
    ///
    /// # Errors
    /// An unknown glass; the message names the most similar known ones.
    pub fn find(&self, name: &str, makers: &[String]) -> Result<Glass> {
        let wanted = key(name);
        if let Some(glass) = self.own.get(&wanted) {
            return Ok(glass.clone());
        }
        let named = |wanted: &str, makers: &[String]| {
            let all = built_in().get(wanted)?;
            let first = makers.iter().find_map(|m| {
                all.iter().find(|(maker, _)| m.to_ascii_lowercase().starts_with(maker.as_str()))
            });
            Some(first.or(all.first())?.1.clone())
        };
        let alias = |wanted: &str| {
            ALIASES.iter().find(|(other, _)| key(other) == wanted).map(|(_, ours)| key(ours))
        };
        if let Some(glass) = named(&wanted, makers) {
            return Ok(glass);
        }
        if let Some(glass) = alias(&wanted).and_then(|ours| named(&ours, makers)) {
            return Ok(Glass { name: name.to_owned(), ..glass });
        }
        if let Some((stem, maker)) = name.rsplit_once('_') {
            let makers = [&[maker.to_ascii_lowercase()], makers].concat();
            let stem = key(stem);
            let glass = named(&stem, &makers).or_else(|| named(&alias(&stem)?, &makers));
            if let Some(glass) = glass {
                return Ok(glass);
            }
        }
        if let Some(model) = model_from_name(name) {
            return model;
        }
        Err(Error::input(format!("no glass called \"{name}\""))
            .help(format!(
                "nearest known: {}; or give n_d:V_d in its place, or define it",
                self.nearest(&wanted).join(", ")
            ))
            .with_code("unknown-glass"))
    }

    fn nearest(&self, wanted: &str) -> Vec<String> {
        let own = self.own.values();
        let all = own.chain(built_in().values().flatten().map(|(_, glass)| glass));
        let mut scored: Vec<(usize, &str)> = all
            .map(|g| (strsim::damerau_levenshtein(wanted, &key(&g.name)), &g.name[..]))
            .collect();
        scored.sort();
        scored.dedup();
        scored.into_iter().take(3).map(|(_, name)| name.to_owned()).collect()
    }
}

/// `1.5168:64.17`, `517.642`, `517642`, `1.5168/64.17`.
fn model_from_name(name: &str) -> Option<Result<Glass>> {
    if let Some((nd, vd)) = name.split_once([':', '/']) {
        let pair = number("n_d", nd).and_then(|nd| Ok((nd, number("V_d", vd)?)));
        return Some(pair.and_then(|(nd, vd)| Glass::model(nd, vd)));
    }
    let (n, v) = match name.split_once('.') {
        Some(halves) => halves,
        None if name.len() == 6 && name.is_ascii() => name.split_at(3),
        None => return None,
    };
    let digits = |s: &str| s.len() >= 3 && s.bytes().all(|b| b.is_ascii_digit());
    let fraction = |s: &str| format!("0.{s}").parse::<f64>().ok();
    (digits(n) && digits(v))
        .then(|| Some(Glass::model(1.0 + fraction(n)?, 100.0 * fraction(v)?)))
        .flatten()
}

/// The form in which names are compared.
fn key(name: &str) -> String {
    name.chars().filter(|c| !"- _".contains(*c)).map(|c| c.to_ascii_uppercase()).collect()
}

type Makers = Vec<(String, Glass)>;

/// The built-in table, by [`key`]; makers in the table's order (Schott first).
fn built_in() -> &'static BTreeMap<String, Makers> {
    static TABLE: OnceLock<BTreeMap<String, Makers>> = OnceLock::new();
    TABLE.get_or_init(|| {
        let mut table = BTreeMap::<String, Makers>::new();
        let lines = include_str!("glasses.csv").lines().filter(|l| !l.starts_with('#'));
        for (maker, glass) in lines.filter_map(parse_row) {
            table.entry(key(&glass.name)).or_default().push((maker, glass));
        }
        for makers in table.values_mut() {
            makers.sort_by_key(|(maker, _)| maker != "schott");
        }
        table
    })
}

/// A row of `glasses.csv`; a test checks that every row is understood.
fn parse_row(line: &str) -> Option<(String, Glass)> {
    let fields: Vec<&str> = line.split(',').collect();
    let [maker, name, formula, low, high, coefficients] = fields[..] else { return None };
    let values: Vec<f64> =
        coefficients.split(' ').map(str::parse).collect::<std::result::Result<_, _>>().ok()?;
    let pairs = |v: &[f64]| v.chunks_exact(2).map(|p| [p[0], p[1]]).collect::<Vec<_>>();
    let series = |squared| {
        let terms = [vec![[values[0], 0.0]], pairs(&values[1..])].concat();
        Dispersion::PowerSeries { squared, terms }
    };
    let dispersion = match formula {
        "1" | "2" => {
            let mut terms = pairs(&values[1..]);
            if formula == "1" {
                terms.iter_mut().for_each(|t| t[1] *= t[1]);
            }
            Dispersion::Sellmeier { offset: values[0], terms, poles: Vec::new() }
        }
        "3" => series(true),
        "5" => series(false),
        "n" => Dispersion::Table(pairs(&values).iter().map(|p| [p[0] * 1e3, p[1]]).collect()),
        _ => return None,
    };
    let range_nm = [low.parse::<f64>().ok()? * 1e3, high.parse::<f64>().ok()? * 1e3];
    Some((maker.to_owned(), Glass { name: name.to_owned(), dispersion, range_nm }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_of_the_table_is_understood_and_physical() {
        let rows: Vec<&str> =
            include_str!("glasses.csv").lines().filter(|l| !l.starts_with('#')).collect();
        for row in &rows {
            let (_, glass) = parse_row(row).unwrap_or_else(|| panic!("{row}"));
            let middle = glass.range_nm[0].max(400.0).min(glass.range_nm[1]);
            let n = glass.index(middle).unwrap();
            assert!((1.3..4.2).contains(&n), "{row}: {n}");
        }
        assert!(rows.len() > 1000);
    }

    /// Data sheets: Schott 2017 (N-BK7, N-SF11, F2), Ohara (L-BAL35), Malitson 1965 (silica).
    #[test]
    fn indices_agree_with_data_sheets() {
        let known = [
            ("N-BK7", 587.5618, 1.51680),
            ("N-BK7", 486.1327, 1.52238),
            ("N-SF11", 587.5618, 1.78472),
            ("F2", 587.5618, 1.62004),
            ("SILICA", 587.5618, 1.458464),
            ("L-BAL35", 587.5618, 1.58913),
        ];
        for (name, nm, n) in known {
            let glass = Catalogue::default().find(name, &[]).unwrap();
            assert!((glass.index(nm).unwrap() - n).abs() < 6e-6, "{name}");
        }
    }

    #[test]
    fn a_model_glass_has_its_nd_and_vd() {
        for (nd, vd) in [(1.5168, 64.17), (1.471, 76.6), (1.8, 25.4)] {
            let (n, v) = Glass::model(nd, vd).unwrap().nd_vd();
            assert!((n - nd).abs() < 1e-12 && (v - vd).abs() < 1e-9);
        }
    }

    #[test]
    fn names_in_all_their_dialects() {
        let find = |name: &str, makers: &[&str]| {
            let makers: Vec<String> = makers.iter().map(|m| (*m).to_owned()).collect();
            Catalogue::default().find(name, &makers)
        };
        assert_eq!(find("NBK7_SCHOTT", &[]).unwrap().name, "N-BK7");
        assert_eq!(find("n-sk16_schott", &[]).unwrap().name, "N-SK16");
        assert_eq!(find("500.700", &[]).unwrap().nd_vd().0, 1.5);
        assert!((find("517642", &[]).unwrap().index(587.5618).unwrap() - 1.517).abs() < 1e-12);
        let own = find("SF5", &["hikari"]).unwrap();
        assert_ne!(own.dispersion, find("SF5", &[]).unwrap().dispersion);
        let error = find("N-BK8", &[]).unwrap_err().to_string();
        assert!(error.contains("N-BK7") && error.contains("define it"), "{error}");
    }

    #[test]
    fn a_table_is_exact_at_its_rows_and_for_cauchy_glasses() {
        let n = |nm: f64| 1.5 + 4e3 / (nm * nm);
        let rows = [400.0, 450.0, 500.0, 600.0, 700.0].map(|nm| [nm, n(nm)]);
        let glass = Glass::table("x", rows.to_vec()).unwrap();
        for nm in [400.0, 431.0, 450.0, 555.0, 700.0] {
            assert!((glass.index(nm).unwrap() - n(nm)).abs() < 1e-12);
        }
        assert!(glass.index(200.0).is_err());
    }
}
