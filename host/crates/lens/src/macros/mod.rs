//! Scripts for lens-design programs: they take a lens through a grid of image heights and
//! wavelengths and leave the files that [`crate::import`] reads.
//!
//! The files are an ISETCam ray-trace set ([`crate::import::iset`]). Heights are even steps of the
//! paraxial image height at the design's reference wavelength, up to that of the largest field, as
//! in a characterisation of our own.

use camrig_base::{Error, Result};

/// A lens-design program and the language of its script.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    /// Ansys Zemax OpticStudio, by its ZOS-API in Python.
    OpticStudio,
    /// Ansys Zemax OpticStudio, by a macro in ZPL.
    OpticStudioZpl,
    /// Synopsys CODE V, by a macro.
    CodeV,
}

impl Program {
    fn template(self) -> &'static str {
        match self {
            Self::OpticStudio => include_str!("opticstudio.py"),
            Self::OpticStudioZpl => include_str!("opticstudio.zpl"),
            Self::CodeV => include_str!("codev.seq"),
        }
    }

    /// Assignment of an array's element, counted from 1.
    fn assignment(self, array: &str, index: usize, value: f64) -> String {
        match self {
            Self::CodeV => format!("^{array}({index}) == {value}\n"),
            _ => format!("{array}({index}) = {value}\n"),
        }
    }
}

/// What a script exports.
#[derive(Clone, Debug, PartialEq)]
pub struct Export {
    /// Base name of the files: letters, digits, `-` and `_`.
    pub name: String,
    /// Image heights from the axis to the largest field, evenly spaced; two or more.
    pub heights: usize,
    /// Largest field, degrees: angle of the chief ray at the entrance pupil.
    pub max_field_deg: f64,
    /// Wavelengths, nm, strictly rising.
    pub wavelengths_nm: Vec<f64>,
    /// Samples per side of a PSF: a power of two from 32 to 1024, which both programs take.
    pub psf_size: usize,
    /// Distance between PSF samples, µm.
    pub psf_spacing_um: f64,
}

impl Export {
    /// The script for a program.
    ///
    /// # Errors
    /// A grid that the program or the import cannot have; a name with other characters.
    pub fn script(&self, program: Program) -> Result<String> {
        self.check()?;
        let waves = &self.wavelengths_nm;
        let assignments = |array: &str, values: &[f64]| {
            let lines = values.iter().enumerate();
            let text: String = lines.map(|(i, v)| program.assignment(array, i + 1, *v)).collect();
            text.trim_end().to_owned()
        };
        let array = if program == Program::CodeV { "wls" } else { "WLN" };
        let tangent = libm::tan(self.max_field_deg.to_radians());
        let part = |i: usize| i as f64 / (self.heights - 1) as f64;
        let angles: Vec<f64> =
            (0..self.heights).map(|i| libm::atan(part(i) * tangent).to_degrees()).collect();
        let values = [
            ("VERSION", env!("CARGO_PKG_VERSION").to_owned()),
            ("NAME", self.name.clone()),
            ("HEIGHTS", self.heights.to_string()),
            ("MAX_FIELD", self.max_field_deg.to_string()),
            ("TANGENT", tangent.to_string()),
            ("COUNT", waves.len().to_string()),
            ("WAVELENGTHS", joined(waves, ", ")),
            ("WAVE", matlab(waves)),
            ("ASSIGN_WAVES", assignments(array, waves)),
            ("ASSIGN_ANGLES", assignments("angles", &angles)),
            ("PSF_SIZE", self.psf_size.to_string()),
            ("PSF_CODE", (self.psf_size.ilog2() - 4).to_string()),
            ("PSF_SPACING_UM", self.psf_spacing_um.to_string()),
            ("PSF_SPACING_MM", (self.psf_spacing_um * 1e-3).to_string()),
        ];
        let fill =
            |text: String, (key, value): &(&str, String)| text.replace(&format!("@{key}@"), value);
        Ok(values.iter().fold(program.template().to_owned(), fill))
    }

    fn check(&self) -> Result<()> {
        let wrong = |what: String, help: &str| Err(Error::input(what).help(help));
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
        if self.name.is_empty() || !self.name.chars().all(plain) {
            return wrong(
                format!("the name {:?}", self.name),
                "letters, digits, - and _ are understood by every program",
            );
        }
        if !(2..=1000).contains(&self.heights) {
            return wrong(format!("{} image heights", self.heights), "give 2 to 1000");
        }
        if !(self.max_field_deg > 0.0 && self.max_field_deg < 90.0) {
            return wrong(
                format!("a largest field of {}°", self.max_field_deg),
                "it lies between 0 and 90 degrees",
            );
        }
        let waves = &self.wavelengths_nm;
        let rising = waves.windows(2).all(|w| w[1] > w[0]);
        if waves.is_empty() || !rising || waves.iter().any(|nm| !(*nm > 0.0 && nm.is_finite())) {
            return wrong(format!("wavelengths {waves:?}"), "give them in nm, rising");
        }
        if !(self.psf_size.is_power_of_two() && (32..=1024).contains(&self.psf_size)) {
            return wrong(
                format!("PSFs of {} samples", self.psf_size),
                "the programs make PSFs of 32, 64, 128, 256, 512 or 1024 samples per side",
            );
        }
        if !(self.psf_spacing_um > 0.0 && self.psf_spacing_um.is_finite()) {
            return wrong(
                format!("PSF samples {} µm apart", self.psf_spacing_um),
                "give a positive distance, in µm",
            );
        }
        Ok(())
    }
}

fn joined(values: &[f64], between: &str) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(between)
}

/// The list as the parameter file has it: `first:step:last` where steps are even, else in brackets.
fn matlab(values: &[f64]) -> String {
    let step = |pair: &[f64]| pair[1] - pair[0];
    match (values, values.windows(2).next().map(step)) {
        ([first, .., last], Some(even)) if values.windows(2).all(|pair| step(pair) == even) => {
            format!("{first}:{even}:{last}")
        }
        _ => format!("[{}]", joined(values, " ")),
    }
}
