//! `camrig lens macro`: prints the script with which a lens-design program exports a lens.

use super::Wavelengths;
use crate::arguments;
use camrig_base::{Error, Result};
use camrig_lens::macros::{Export, Program};
use clap::builder::TypedValueParser;

/// Print the script with which OpticStudio or CODE V exports a lens for `lens import`
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig lens macro opticstudio --max-field 20 > export.py\n  \
    camrig lens macro codev --max-field 20 --wavelengths 400:50:700 --heights 11 > export.seq")]
pub(super) struct MacroArgs {
    /// Lens-design program
    #[arg(value_parser = design_program())]
    program: DesignProgram,
    /// OpticStudio: a ZPL macro instead of a Python script for the ZOS-API
    #[arg(long)]
    zpl: bool,
    /// Largest field, degrees: angle of the chief ray at the entrance pupil
    #[arg(long, value_name = "DEG", value_parser = arguments::positive)]
    max_field: f64,
    /// Image heights from the axis to the largest field, evenly spaced
    #[arg(long, default_value_t = 21, value_name = "N")]
    heights: u16,
    /// Wavelengths, nm, or first:step:last
    #[arg(
        long,
        value_name = "NM,...",
        value_delimiter = ',',
        default_value = "400:50:700",
        value_parser = super::wavelengths
    )]
    wavelengths: Vec<Wavelengths>,
    /// PSF samples per side: 32, 64, 128, 256, 512 or 1024
    #[arg(long, default_value_t = 128, value_name = "N")]
    psf_size: u16,
    /// Spacing of PSF samples, µm
    #[arg(
        long,
        default_value_t = 0.5,
        value_name = "UM",
        value_parser = arguments::positive
    )]
    psf_spacing: f64,
    /// Base name of the exported files
    #[arg(long, default_value = "lens")]
    name: String,
}

/// A lens-design program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum DesignProgram {
    OpticStudio,
    CodeV,
}

impl DesignProgram {
    const ALL: [Self; 2] = [Self::OpticStudio, Self::CodeV];

    const fn name(self) -> &'static str {
        match self {
            Self::OpticStudio => "opticstudio",
            Self::CodeV => "codev",
        }
    }
}

impl std::str::FromStr for DesignProgram {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        camrig_base::choice::by_name("lens-design program", text, &Self::ALL, Self::name)
    }
}

fn design_program() -> impl TypedValueParser<Value = DesignProgram> {
    arguments::choice(&DesignProgram::ALL, DesignProgram::name, |program| match program {
        DesignProgram::OpticStudio => "Ansys Zemax OpticStudio",
        DesignProgram::CodeV => "Synopsys CODE V",
    })
}

pub(super) fn print(args: &MacroArgs) -> Result<()> {
    let program = match (args.program, args.zpl) {
        (DesignProgram::OpticStudio, false) => Program::OpticStudio,
        (DesignProgram::OpticStudio, true) => Program::OpticStudioZpl,
        (DesignProgram::CodeV, false) => Program::CodeV,
        (DesignProgram::CodeV, true) => {
            return Err(Error::input("CODE V has no ZPL")
                .help("omit --zpl: the macro is in CODE V's own language"));
        }
    };
    let export = Export {
        name: args.name.clone(),
        heights: usize::from(args.heights),
        max_field_deg: args.max_field,
        wavelengths_nm: super::rising(&args.wavelengths),
        psf_size: usize::from(args.psf_size),
        psf_spacing_um: args.psf_spacing,
    };
    print!("{}", export.script(program)?);
    Ok(())
}
