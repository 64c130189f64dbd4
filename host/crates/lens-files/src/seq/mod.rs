//! CODE V lens files (`.seq`).
//!
//! Read: spherical, conic and aspheric surfaces (`ASP` with K, A to J; odd polynomials `SPS ODD`),
//! biconics (`AAS`) and cylinders (`CYL`), tilts and decentres (`XDE` to `CDE`, `DAR`, `BEN`,
//! `REV`), mirrors, catalogue, private (`PRV`), fictitious and n_d:V_d glasses, EPD/FNO/NA/NAO,
//! angular and height fields, vignetting factors, circular, elliptical and rectangular apertures
//! and obscurations, zoom positions (`ZOO`). Solves are not solved again: their values stand in the
//! file. A command that is not known to be without effect on the image is refused with its line:
//! toroids, other special surfaces, turned apertures. `RDM` says that surfaces are given by
//! radius, `RDM N` or nothing by curvature; where nothing is said and curvatures do not make a
//! lens, they are taken as radii, with a note.

mod apertures;
mod commands;
mod decentre;
mod finish;
mod known;
mod lexer;
mod private;
mod radii;
mod zoom;

use apertures::Apertures;
use camrig_base::{Error, Result};
use camrig_glass::{Catalogue, text};
use camrig_prescription::{Aperture, FieldKind, Prescription};
use decentre::Decentre;
use lexer::Word;
use private::Private;
use zoom::Zoom;

/// Distances that CODE V takes for infinity, in the file's unit (its own default is 1e13).
const INFINITE: f64 = 1e10;

/// A file as far as it is read.
#[derive(Default)]
struct File {
    title: String,
    radius_mode: Option<bool>,
    scale: f64,
    aperture: Option<Aperture>,
    waves: Vec<f64>,
    weights: Vec<f64>,
    reference: Option<usize>,
    /// Kind of the fields, and their x and y.
    fields: Option<(FieldKind, [Vec<f64>; 2])>,
    vignetting: [Vec<f64>; 4],
    object: Option<(f64, f64)>,
    object_glass: Option<String>,
    surfaces: Vec<Draft>,
    image: Option<f64>,
    image_bent: bool,
    image_decentre: Decentre,
    stop: Option<usize>,
    zoom: Zoom,
    private: Private,
    notes: Vec<String>,
}

/// A surface as the file describes it.
#[derive(Default)]
struct Draft {
    line: usize,
    bend: f64,
    thickness: f64,
    glass: Option<String>,
    conic: f64,
    even: Vec<f64>,
    odd_terms: Vec<f64>,
    apertures: Apertures,
    /// Curvature and conic constant in x, of a biconic or cylinder.
    across: Option<Across>,
    decentre: Decentre,
}

/// A biconic or cylinder as far as it is read.
#[derive(Default)]
struct Across {
    /// Curvature in x, in the file's unit.
    curvature: Option<f64>,
    conic: f64,
}

/// A prescription from the text of a `.seq` file.
///
/// # Errors
/// What is unsupported or wrong, with its line.
pub fn read(text: &str, glasses: &Catalogue) -> Result<Prescription> {
    read_position(text, glasses, None)
}

/// A prescription from the text of a `.seq` file in one of its zoom positions, by number from 1
/// or by title; `None` takes the first.
///
/// # Errors
/// Those of [`read`]; a position that the file does not have.
pub fn read_position(
    text: &str,
    glasses: &Catalogue,
    position: Option<&str>,
) -> Result<Prescription> {
    let commands = lexer::commands(text)?;
    let zoom = Zoom::of(&commands, position);
    let mut file = File { scale: 1.0, zoom, ..File::default() };
    for command in &commands {
        file.command(command).map_err(|e| e.at(format!("line {}", command.line)))?;
    }
    file.zoom.check(&mut file.notes)?;
    file.finish(glasses)
}

/// The number at the start of a command's words.
fn first(words: &[Word], what: &str) -> Result<f64> {
    let word = words.first().ok_or_else(|| {
        Error::input(format!("{what} has no value")).help("the line is cut short")
    })?;
    text::number(what, &word.text)
}

/// All words as numbers.
fn numbers(what: &str, words: &[Word]) -> Result<Vec<f64>> {
    words.iter().map(|w| text::number(what, &w.text)).collect()
}

/// Refuses words behind those that are taken.
fn no_more(keyword: &str, words: &[Word], taken: usize) -> Result<()> {
    let Some(word) = words.get(taken) else { return Ok(()) };
    Err(Error::unsupported(format!("{keyword}: \"{}\" is not understood", word.text))
        .help("nothing is expected there"))
}
