//! Lines that may stand once. A second one of the same surface, or of the system, that says
//! otherwise is refused, since nobody knows which of them counts.

use camrig_base::{Error, Result};
use std::collections::HashMap;

/// Kinds of aperture, of which a lens has one; 0 says that a kind is not in use.
const APERTURE: [&str; 4] = ["ENPD", "FNUM", "OBNA", "FLOA"];
/// Of the system.
const SYSTEM: [&str; 16] = [
    "MODE", "UNIT", "FTYP", "XFLN", "YFLN", "XFLD", "YFLD", "VDXN", "VDYN", "VCXN", "VCYN",
    "WAVL", "WWGT", "WAVM", "PWAV", "GCAT",
];
/// Of a surface.
const SURFACE: [&str; 16] = [
    "TYPE", "CURV", "CONI", "DISZ", "GLAS", "DIAM", "FLAP", "CLAP", "OBSC", "OBDC", "SQAP",
    "ELAP", "SQOB", "ELOB", "PARM", "XDAT",
];
/// Those of which each has a number in front of its value.
const NUMBERED: [&str; 3] = ["WAVM", "PARM", "XDAT"];

/// Whether a line names a kind of aperture that is not in use.
pub(super) fn is_unused_aperture(keyword: &str, rest: &[&str]) -> bool {
    APERTURE.contains(&keyword) && rest.first().is_some_and(|w| w.parse() == Ok(0.0))
}

/// The lines so far, each with its number, by what they are about.
#[derive(Default)]
pub(super) struct Said(HashMap<String, (usize, String)>);

impl Said {
    /// Takes a line by its number, behind so many surfaces.
    pub(super) fn take(
        &mut self,
        keyword: &str,
        rest: &[&str],
        (line, surfaces): (usize, usize),
    ) -> Result<()> {
        let place = match SURFACE.contains(&keyword) {
            true => surfaces,
            false if SYSTEM.contains(&keyword) || APERTURE.contains(&keyword) => 0,
            false => return Ok(()),
        };
        if is_unused_aperture(keyword, rest) {
            return Ok(());
        }
        let name = if APERTURE.contains(&keyword) { "aperture" } else { keyword };
        let number = rest.first().filter(|_| NUMBERED.contains(&keyword)).unwrap_or(&"");
        let text = format!("{keyword} {}", rest.join(" "));
        let first = self.0.entry(format!("{name} {number} {place}"));
        let (before, said) = first.or_insert_with(|| (line, text.clone()));
        if *said == text {
            return Ok(());
        }
        Err(Error::input(format!("\"{text}\" contradicts line {before}, \"{said}\""))
            .help("keep the line that is meant"))
    }
}
