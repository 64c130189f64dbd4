//! Optical glasses. The principal type is [`Glass`]: refractive index over wavelength, by catalogue
//! name, formula, table or n_d and V_d. A [`Catalogue`] finds glasses by name, built in or from
//! files.
//!
//! Indices are relative to air at 20 °C and 1 atm, as catalogues give them; ray tracers take air
//! as 1. Wavelengths are in air, nm at the interface and µm inside the formulas.
//!
//! ```
//! use camrig_glass::{Catalogue, Glass};
//!
//! // Two makers sell different glasses as F6; a lens file names the maker.
//! let found = Catalogue::default().find("F6", &["schott".into()])?;
//! assert!((found.glass.index(587.5618)? - 1.63636).abs() < 5e-6);
//!
//! // What a patent states: n_d and V_d.
//! let model = Glass::model(1.5168, 64.17)?;
//! assert!((model.index(486.1327)? - 1.5224).abs() < 1e-4);
//! # Ok::<(), camrig_base::Error>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod agf;
mod catalogue;
mod conrady;
mod dispersion;
pub mod files;
mod lines;
mod table;
pub mod text;

pub use catalogue::{Catalogue, Found, Replaced};
pub use dispersion::Dispersion;

use camrig_base::{Error, Result};
use lines::{C_LINE, D_LINE, F_LINE};

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

/// How far beyond its range a formula is still used, as a fraction of the limit: enough for 400 nm
/// with plastics measured from 436 nm, too little for the far ultraviolet and infrared, where
/// formulas diverge.
const BEYOND: f64 = 0.15;
/// Refractive indices that are accepted; germanium, the highest of common infrared materials, has
/// 4.
const INDICES: std::ops::RangeInclusive<f64> = 1.0..=5.0;
/// Abbe numbers that are accepted; glasses and plastics have 15 to 100.
const ABBE_NUMBERS: std::ops::RangeInclusive<f64> = 5.0..=200.0;
/// P_gF above the normal line that is accepted; glasses have -0.03 to 0.06.
const DEVIATIONS: std::ops::RangeInclusive<f64> = -0.1..=0.1;
/// Wavelengths for which a model glass is used, nm: n_d, V_d and P_gF tell its index there to some
/// 5e-4; farther in the infrared the error grows to 1e-2.
const MODEL_RANGE_NM: [f64; 2] = [350.0, 1100.0];
/// Least index that a formula may give: below it the wavelength lies in an absorption band.
const MIN_INDEX: f64 = 0.5;

impl Glass {
    /// A model glass and its name from `NAME=n_d:V_d`.
    ///
    /// # Errors
    /// Another shape; those of [`Self::model`].
    pub fn named(text: &str) -> Result<(String, Self)> {
        let wrong = || {
            Error::input(format!("{text:?} is not NAME=n_d:V_d"))
                .help("write for instance RESIN=1.53:56")
        };
        let (name, values) = text.split_once('=').ok_or_else(wrong)?;
        let (nd, vd) = values.split_once(':').ok_or_else(wrong)?;
        let read = |v: &str| v.trim().parse::<f64>().map_err(|_| wrong());
        let glass = Self::model(read(nd)?, read(vd)?)?;
        let name = name.trim().to_owned();
        if name.is_empty() {
            return Err(wrong());
        }
        Ok((name.clone(), Self { name, ..glass }))
    }

    /// A model glass from n_d and V_d ([`Dispersion::Model`]) on the normal line.
    ///
    /// # Errors
    /// An index outside 1..=5 or an Abbe number outside 5..=200.
    pub fn model(nd: f64, vd: f64) -> Result<Self> {
        Self::model_off_line(nd, vd, 0.0)
    }

    /// A model glass whose P_gF lies `dpgf` above the normal line.
    ///
    /// # Errors
    /// As [`Self::model`]; a `dpgf` beyond ±0.1.
    pub fn model_off_line(nd: f64, vd: f64, dpgf: f64) -> Result<Self> {
        if !INDICES.contains(&nd) || !ABBE_NUMBERS.contains(&vd) {
            return Err(Error::input(format!("model glass with n_d {nd}, V_d {vd}"))
                .help("n_d lies in 1..5, V_d in 5..200"));
        }
        if !DEVIATIONS.contains(&dpgf) {
            return Err(Error::input(format!("model glass with ΔP_gF {dpgf}"))
                .help("it lies in -0.1..0.1"));
        }
        Ok(model(nd, vd, dpgf))
    }

    /// This glass with its n_d and V_d moved, as melts differ from the catalogue.
    ///
    /// # Errors
    /// Values that no glass has.
    pub fn moved(&self, shift_nd: f64, shift_vd: f64) -> Result<Self> {
        let (nd, vd) = self.nd_vd();
        let (new_nd, new_vd) = (nd + shift_nd, vd + shift_vd);
        if !INDICES.contains(&new_nd) || !ABBE_NUMBERS.contains(&new_vd) {
            return Err(Error::input(format!(
                "glass {} moved to n_d {new_nd}, V_d {new_vd}",
                self.name
            ))
            .help("n_d lies in 1..5, V_d in 5..200"));
        }
        let factor = (new_nd - 1.0) / new_vd * vd / (nd - 1.0);
        let of = Box::new(self.dispersion.clone());
        let dispersion = Dispersion::Moved { of, nd, shift: shift_nd, factor };
        Ok(Self { dispersion, ..self.clone() })
    }

    /// This glass with the same amount added to its index at all wavelengths.
    #[must_use]
    pub fn with_index_shifted(&self, shift: f64) -> Self {
        let of = Box::new(self.dispersion.clone());
        Self { dispersion: Dispersion::Moved { of, nd: 0.0, shift, factor: 1.0 }, ..self.clone() }
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
        if n.is_finite() && n > MIN_INDEX {
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

/// A model glass of values known to be sane.
fn model(nd: f64, vd: f64, dpgf: f64) -> Glass {
    let name = format!("{nd}:{vd}");
    Glass { name, dispersion: Dispersion::Model { nd, vd, dpgf }, range_nm: MODEL_RANGE_NM }
}

/// The form in which names are compared.
fn key(name: &str) -> String {
    name.chars().filter(|c| !"- _".contains(*c)).map(|c| c.to_ascii_uppercase()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

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
            let glass = Catalogue::default().find(name, &[]).unwrap().glass;
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
    fn a_table_is_exact_at_its_rows_and_for_cauchy_glasses() {
        let n = |nm: f64| 1.5 + 4e3 / (nm * nm);
        let rows = [400.0, 450.0, 500.0, 600.0, 700.0].map(|nm| [nm, n(nm)]);
        let glass = Glass::table("x", rows.to_vec()).unwrap();
        for nm in [400.0, 431.0, 450.0, 555.0, 700.0] {
            assert!((glass.index(nm).unwrap() - n(nm)).abs() < 1e-12);
        }
        assert!(glass.index(200.0).is_err());
    }

    /// N-BK7, N-K5 and F2 by Schott's formulas against model glasses of their n_d and V_d (and
    /// P_gF of N-LAK8), in the violet and in the infrared.
    #[test]
    fn model_glasses_are_near_the_catalogue() {
        for (name, nd, vd, dpgf, nm, most) in [
            ("N-BK7", 1.5168, 64.17, 0.0, 404.6561, 4e-5),
            ("N-K5", 1.52249, 59.48, 0.0, 404.6561, 4e-5),
            ("F2", 1.62004, 36.37, 0.0, 404.6561, 1e-4),
            ("N-LAK8", 1.713, 53.83, -0.0083, 435.8343, 1e-5),
            ("N-BK7", 1.5168, 64.17, 0.0, 1000.0, 1e-3),
            ("F2", 1.62004, 36.37, 0.0, 1000.0, 1e-3),
        ] {
            let glass = Catalogue::default().find(name, &[]).unwrap().glass;
            let model = Glass::model_off_line(nd, vd, dpgf).unwrap();
            let difference = model.index(nm).unwrap() - glass.index(nm).unwrap();
            assert!(difference.abs() < most, "{name} at {nm} nm: {difference:e}");
        }
        assert!(Glass::model(1.5, 60.0).unwrap().index(1550.0).is_err());
    }

    #[test]
    fn a_moved_glass_has_the_new_nd_and_vd() {
        let glass = Catalogue::default().find("N-BK7", &[]).unwrap().glass;
        let (nd, vd) = glass.nd_vd();
        let (n, v) = glass.moved(0.01, -0.5).unwrap().nd_vd();
        assert!((n - nd - 0.01).abs() < 1e-12 && (v - vd + 0.5).abs() < 1e-9);
        assert!(glass.moved(-0.9, 0.0).is_err());
    }
}
