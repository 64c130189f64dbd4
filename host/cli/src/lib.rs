//! The command line: one file per command, each with `Args` (what is typed) and
//! `run(args) -> Result<ExitCode>` (parse, call the library, print). Data go to standard output,
//! notes and errors to standard error. Exit status: 0 success, 1 a comparison found a difference,
//! 2 bad input.
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

/// `println!` of this program: a closed standard output is an error with a message, not a panic.
macro_rules! println {
    () => { $crate::stdout::print(format_args!("\n")) };
    ($($what:tt)*) => {
        $crate::stdout::print(format_args!("{}\n", format_args!($($what)*)))
    };
}

/// `print!`, likewise.
macro_rules! print {
    ($($what:tt)*) => { $crate::stdout::print(format_args!($($what)*)) };
}

/// `eprintln!`, which `--quiet` limits to errors and warnings.
macro_rules! eprintln {
    ($($what:tt)*) => { $crate::stdout::tell(format_args!($($what)*)) };
}

mod advice;
pub mod arguments;
mod batch;
mod calibrate;
mod camera;
mod capture;
mod captures;
mod compare;
mod convert;
mod crosstalk;
mod datasheet;
mod demo;
mod diagnose;
mod effects;
#[cfg(test)]
mod examples;
mod explain;
mod expose;
mod frame_sink;
mod isp;
mod lens;
mod listen;
mod live;
mod measure;
mod notes;
mod presets;
mod readout;
mod rig;
mod rig_camera;
mod rig_frames;
mod rig_sensor;
mod rig_stream;
mod rig_view;
mod scene;
mod scene_info;
mod scene_lights;
mod schema;
mod screen;
mod sequence_lights;
mod shell;
mod signals;
mod simulate;
mod stdout;
mod stop;
mod taking;
mod times;
mod validate;
mod view;
mod view_args;

use camrig_base::{Result, output};
use clap::{Parser, Subcommand};
use std::ffi::OsString;
use std::process::ExitCode;

#[derive(Parser)]
#[command(name = "camrig", version, about, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Print no notes and no progress, only warnings and errors
    #[arg(long, global = true)]
    quiet: bool,
}

#[derive(Subcommand)]
enum Command {
    Simulate(Box<simulate::Args>),
    Expose(expose::Args),
    Demo(demo::Args),
    Batch(batch::Args),
    Capture(capture::Args),
    Captures(captures::Args),
    Scene(scene::Args),
    Lens(lens::Args),
    Camera(camera::Args),
    Crosstalk(crosstalk::Args),
    /// Measure captures or frames
    Measure(measure::Args),
    Compare(compare::Args),
    Diagnose(diagnose::Args),
    Validate(validate::Args),
    Datasheet(datasheet::Args),
    Rig(rig::Args),
    Convert(convert::Args),
    Isp(isp::Args),
    Presets(presets::Args),
    Effects(effects::Args),
    Explain(explain::Args),
    Schema(schema::Args),
    Completions(shell::CompletionsArgs),
    Man(shell::ManArgs),
}

/// Runs the program on the process's arguments.
pub fn main() -> ExitCode {
    main_of(std::env::args_os())
}

/// Runs the program on arguments, of which the first is its name.
pub fn main_of(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let Cli { command, quiet } = Cli::parse_from(arguments);
    if quiet {
        stdout::be_quiet();
    }
    let stopping = || eprintln!("stopping after the current frame; a second signal stops at once");
    signals::before_signals_end(stopping, output::remove_unfinished);
    let status = stdout::guard(|| run(command)).unwrap_or_else(|error| {
        stdout::end_if_unread(&error);
        eprintln!("error: {}", advice::advised(error));
        ExitCode::from(2)
    });
    signals::end_if_asked();
    status
}

fn run(command: Command) -> Result<ExitCode> {
    match command {
        Command::Simulate(args) => simulate::run(&args),
        Command::Expose(args) => expose::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::Batch(args) => batch::run(&args),
        Command::Capture(args) => capture::run(&args),
        Command::Captures(args) => captures::run(&args),
        Command::Scene(args) => scene::run(&args),
        Command::Lens(args) => lens::run(&args),
        Command::Camera(args) => camera::run(&args),
        Command::Crosstalk(args) => crosstalk::run(&args),
        Command::Measure(args) => measure::run(args),
        Command::Compare(args) => compare::run(&args),
        Command::Diagnose(args) => diagnose::run(&args),
        Command::Validate(args) => validate::run(&args),
        Command::Datasheet(args) => datasheet::run(&args),
        Command::Rig(args) => rig::run(&args),
        Command::Convert(args) => convert::run(&args),
        Command::Isp(args) => isp::run(&args),
        Command::Presets(args) => presets::run(&args),
        Command::Effects(args) => effects::run(&args),
        Command::Explain(args) => explain::run(&args),
        Command::Schema(args) => schema::run(&args),
        Command::Completions(args) => shell::run_completions(&args),
        Command::Man(args) => shell::run_man(&args),
    }
}
