//! The command line: one file per command, each with `Args` (what a person types) and
//! `run(args) -> Result<ExitCode>` (parse, call the library, print). Data go to standard output,
//! talk to standard error. Exit status: 0 success, 1 a comparison says no, 2 bad input.

mod measure;

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
    /// Figures from captures or frames
    Measure(measure::Args),
}

/// Runs the program on the process's arguments.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let outcome: crate::Result<ExitCode> = match cli.command {
        Command::Measure(args) => measure::run(args),
    };
    outcome.unwrap_or_else(|error| {
        eprintln!("error: {error}");
        ExitCode::from(2)
    })
}
