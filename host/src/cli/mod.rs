//! The command line: one file per command, each with `Args` (what a person types) and
//! `run(args) -> Result<ExitCode>` (parse, call the library, print). Data go to standard output,
//! talk to standard error. Exit status: 0 success, 1 a comparison says no, 2 bad input.

pub mod arguments;
mod calibrate;
mod capture;
mod compare;
mod convert;
mod crosstalk;
mod datasheet;
mod demo;
mod diagnose;
mod effects;
mod expose;
mod lens;
mod measure;
mod presets;
mod rig;
mod scene;
mod simulate;
mod validate;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

#[derive(Parser)]
#[command(name = "camrig", version, about, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Simulate(simulate::Args),
    Expose(expose::Args),
    Demo(demo::Args),
    Capture(capture::Args),
    Scene(scene::Args),
    Lens(lens::Args),
    Crosstalk(crosstalk::Args),
    /// Figures from captures or frames
    Measure(measure::Args),
    Compare(compare::Args),
    Diagnose(diagnose::Args),
    Validate(validate::Args),
    Datasheet(datasheet::Args),
    Rig(rig::Args),
    Convert(convert::Args),
    Presets(presets::Args),
    Effects(effects::Args),
}

/// Runs the program on the process's arguments.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let outcome = match cli.command {
        Command::Simulate(args) => simulate::run(&args),
        Command::Expose(args) => expose::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::Capture(args) => capture::run(&args),
        Command::Scene(args) => scene::run(&args),
        Command::Lens(args) => lens::run(&args),
        Command::Crosstalk(args) => crosstalk::run(&args),
        Command::Measure(args) => measure::run(args),
        Command::Compare(args) => compare::run(&args),
        Command::Diagnose(args) => diagnose::run(&args),
        Command::Validate(args) => validate::run(&args),
        Command::Datasheet(args) => datasheet::run(&args),
        Command::Rig(args) => rig::run(&args),
        Command::Convert(args) => convert::run(&args),
        Command::Presets(args) => presets::run(&args),
        Command::Effects(args) => effects::run(&args),
    };
    outcome.unwrap_or_else(|error| {
        eprintln!("error: {error}");
        ExitCode::from(2)
    })
}
