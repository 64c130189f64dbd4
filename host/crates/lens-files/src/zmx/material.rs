//! `GLAS`: catalogue glasses, model glasses, mirrors.

use super::{value, word};
use camrig_base::Result;
use camrig_glass::{Catalogue, Glass};
use camrig_prescription::Medium;

/// The glasses that a file may mean.
pub(super) struct Glasses<'a> {
    pub catalogue: &'a Catalogue,
    /// The catalogues that the file names (`GCAT`).
    pub makers: &'a [String],
    /// The wavelengths of the lens, nm.
    pub wavelengths_nm: &'a [f64],
}

/// Whether the words of a `GLAS` line are those of air, which most files do not write.
pub(super) fn is_air(words: &[String]) -> bool {
    words.first().is_some_and(|name| name.eq_ignore_ascii_case("AIR"))
        && words.get(1).is_none_or(|mode| mode == "0")
}

/// `GLAS name mode pickup n_d V_d ΔP_gF . . . Δn_d ΔV_d`: a catalogue glass, a mirror, a model
/// glass (mode 1), or a catalogue glass with offsets (mode 4); or air.
pub(super) fn medium(
    words: &[String],
    glasses: &Glasses<'_>,
    notes: &mut Vec<String>,
) -> Result<Medium> {
    if is_air(words) {
        return Ok(Medium::Air);
    }
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let name = word(&words, 0, "GLAS")?;
    if name == "MIRROR" {
        return Ok(Medium::Mirror);
    }
    let optional = |i: usize| match words.len() > i {
        true => value(&words, i, "GLAS"),
        false => Ok(0.0),
    };
    let mode = words.get(1).copied().unwrap_or("0");
    if mode == "1" || name.starts_with("___BLANK") {
        let (nd, vd) = (value(&words, 3, "GLAS")?, value(&words, 4, "GLAS")?);
        // Zemax writes V_d = 0 for "no dispersion".
        return Ok(Medium::Glass(match vd == 0.0 {
            true => Glass::constant(nd)?,
            false => Glass::model_off_line(nd, vd, optional(5)?)?,
        }));
    }
    let found = glasses.catalogue.find(name, glasses.makers)?;
    let glass = found.noted(glasses.wavelengths_nm, notes);
    if mode != "4" {
        return Ok(Medium::Glass(glass));
    }
    let (shift_nd, shift_vd) = (optional(9)?, optional(10)?);
    if shift_nd == 0.0 && shift_vd == 0.0 {
        return Ok(Medium::Glass(glass));
    }
    notes.push(format!(
        "glass {name} has offsets: n_d {shift_nd:+}, V_d {shift_vd:+}; its dispersion is scaled"
    ));
    Ok(Medium::Glass(glass.moved(shift_nd, shift_vd)?))
}
