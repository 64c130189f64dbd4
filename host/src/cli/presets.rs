//! `camrig presets`: the cameras that come with the program.

use camrig_base::{Error, Result, toml_text};
use camrig_camera::{Camera, presets};
use std::process::ExitCode;

/// List the built-in cameras, or print the file of one
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:\n  camrig presets mt9t012 > my-camera.toml")]
pub struct Args {
    /// A preset, or a file that a preset names
    name: Option<String>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    match &args.name {
        Some(name) => {
            let text = presets::file(&format!("{name}.toml")).or_else(|| presets::file(name));
            let text = text.ok_or_else(|| {
                Error::input(format!("unknown preset {name:?}"))
                    .help(toml_text::did_you_mean(name, &presets::NAMES))
            })?;
            print!("{text}");
        }
        None => {
            for name in presets::NAMES {
                let camera = Camera::load(name)?;
                let s = &camera.sensor;
                println!(
                    "{name:10} {} x {} pixels of {} µm, {}, {} bits",
                    s.width, s.height, s.pitch_um, s.cfa, s.bits
                );
            }
        }
    }
    Ok(ExitCode::SUCCESS)
}
