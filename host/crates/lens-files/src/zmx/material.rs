//! `GLAS`: catalogue glasses, model glasses, mirrors.

use super::{value, word};
use camrig_base::{ErrorCode, Result};
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

/// Difference of n_d, or of n_F - n_C = (n_d - 1) / V_d, from which on a line and a catalogue do not
/// mean the same glass: melts differ by less.
const SAME_INDEX: f64 = 1e-4;
/// What OpticStudio writes for n_d and V_d where the glass is one of a catalogue.
const PLACEHOLDER: (f64, f64) = (1.5, 40.0);

/// n_d and V_d of the line, where they are the glass's.
fn stated(words: &[&str]) -> Option<(f64, f64)> {
    let number = |i: usize| words.get(i)?.parse::<f64>().ok();
    let stated = (number(3)?, number(4)?);
    (stated != PLACEHOLDER && Glass::model(stated.0, stated.1).is_ok()).then_some(stated)
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
    let stated = stated(&words);
    let found = glasses.catalogue.find(name, glasses.makers).map_err(|e| match (stated, e) {
        (Some((nd, vd)), e) if e.code() == Some(ErrorCode::UnknownGlass) => {
            let help = e.remedy().unwrap_or_default();
            let help = format!("the line says n_d {nd} and V_d {vd}: {name}={nd}:{vd}; {help}");
            e.help(help)
        }
        (_, e) => e,
    })?;
    let glass = found.noted(glasses.wavelengths_nm, notes);
    let (nd, vd) = glass.nd_vd();
    let differs = |said: &(f64, f64)| {
        let dispersion = (said.0 - 1.0) / said.1 - (nd - 1.0) / vd;
        (said.0 - nd).abs().max(dispersion.abs()) > SAME_INDEX
    };
    if let Some((said_nd, said_vd)) = stated.filter(differs) {
        let note = format!(
            "glass {name}: n_d is {said_nd} and V_d {said_vd} by the file, {nd:.6} and {vd:.2} as \
             traced"
        );
        if !notes.contains(&note) {
            notes.push(note);
        }
    }
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
