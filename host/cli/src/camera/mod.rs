//! `camrig camera`: makes camera files.

mod export;
mod files;
mod fit;
mod new;

use camrig_base::Result;
use std::process::ExitCode;

/// Make camera files
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand, Debug)]
enum Command {
    New(Box<new::NewArgs>),
    Fit(fit::FitArgs),
    Export(export::ExportArgs),
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    match &args.command {
        Command::New(args) => new::run(args),
        Command::Fit(args) => fit::run(args),
        Command::Export(args) => export::run(args),
    }
}
