//! Keywords of `.zmx` files without effect on the image. One that is neither read nor in these
//! lists is reported with its line, since nothing is known of it.
//!
//! From the files of makers and patents that rayoptics (M. Hayford) and optiland (K. Harrison) come
//! with, the grammar of zmxtools (T. Vettenburg), and the lists of other public readers.

use super::configurations::PLAIN;

/// The system, in front of the surfaces. What follows them belongs to the editors of
/// configurations, tolerances and merit functions.
const SYSTEM: &[&[&str]] = &[SET, COPIES, WEIGHTS, COMPUTATION];
/// The file as a data set: version, author, remarks, language, catalogue number, files of coatings.
const SET: &[&str] =
    &["VERS", "AUTH", "NOTE", "PFIL", "LANG", "LUID", "DBDT", "COFN", "BLNK", "MODE", "MNUM"];
/// What other lines say, in an older form, or what follows from them.
const COPIES: &[&str] = &["XFLD", "YFLD", "WAVL", "WAVN", "PUPD"];
/// Weights of fields in merit functions, and those of wavelengths in an older form.
const WEIGHTS: &[&str] = &["FWGN", "FWGT", "WWGN", "WWGT"];
/// How its program computes: guesses for aimed rays, margins of semi-diameters, the reference of
/// path differences, paraxial rays, polarisation, the origin of coordinates, non-sequential rays.
const COMPUTATION: &[&str] = &[
    "RAIM", "PUSH", "SDMA", "OMMA", "ROPD", "PICB", "POLS", "GLRS", "GSTD", "NSCD", "GFAC", "ENVD",
];

/// Those that ask for nothing where all their numbers are 0.
const NOTHING_AT_ZERO: &[&str] = &["VANN", "ZVAN", "HYPR", "IWDP", "EERA", "IGNR"];

/// A surface: names, drawing, coatings, mechanics, pickups and variables, whose values stand in the
/// file.
const SURFACE: &[&[&str]] = &[NAMES, MECHANICS, SOLVES];
const NAMES: &[&str] = &["COMM", "HIDE", "SLAB", "SSID", "POPS", "COAT", "COFN", "FIMP"];
const MECHANICS: &[&str] = &["MIRR", "OEMA", "NEXT", "MEMA", "DIAM", "SCBD"];
const SOLVES: &[&str] = &["MAZH", "PPAR", "PZUP", "VCON", "VCUR", "VDSZ", "VPAR"];

/// Whether a line behind `SURF` is the surface's by its keyword, indented or not.
pub(super) fn is_of_surface(keyword: &str) -> bool {
    PLAIN.contains(&keyword) || within(SURFACE, keyword)
}

/// Whether a line in front of the surfaces changes nothing.
pub(super) fn harmless_of_system(keyword: &str, rest: &[&str]) -> bool {
    within(SYSTEM, keyword) || is_nothing(keyword, rest)
}

/// Whether a line of a surface changes nothing.
pub(super) fn harmless_of_surface(keyword: &str, rest: &[&str]) -> bool {
    within(SURFACE, keyword) || is_nothing(keyword, rest)
}

fn within(groups: &[&[&str]], keyword: &str) -> bool {
    groups.iter().any(|group| group.contains(&keyword))
}

fn is_nothing(keyword: &str, rest: &[&str]) -> bool {
    let zero = |word: &&str| word.parse::<f64>() == Ok(0.0);
    NOTHING_AT_ZERO.contains(&keyword) && rest.iter().all(zero)
}
