//! `camrig presets`: the built-in cameras.

use camrig_base::Result;
use camrig_camera::draft::{Draft, Entry, Grade};
use camrig_camera::facts::Sensor;
use camrig_camera::{Camera, presets};
use std::process::ExitCode;

/// List the built-in cameras, or print the file of one
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig presets\n  \
    camrig presets imx477 > my-camera.toml\n  \
    camrig explain imx477                     its values with their sources\n\n\
    `camrig camera new --like imx477 -o my-camera.toml` also writes the tables it refers to.")]
pub struct Args {
    /// Preset, or a file that a preset refers to
    name: Option<String>,
    /// Print the page of docs/sensors.md
    #[arg(long, conflicts_with = "name")]
    markdown: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    match &args.name {
        Some(name) => {
            let lower = name.to_ascii_lowercase();
            let text = presets::file(&format!("{lower}.toml")).or_else(|| presets::file(name));
            print!("{}", text.ok_or_else(|| presets::unknown("preset", name))?);
        }
        None if args.markdown => print!("{}", page()?),
        None => {
            for name in presets::names() {
                let camera = Camera::load(name)?;
                let s = &camera.sensor;
                let class = Sensor::of(name).map(|s| format!(", {}", s.text("class")));
                println!(
                    "{name:16} {} x {} pixels of {} µm, {}, {} bits{}",
                    s.width,
                    s.height,
                    s.pitch_um,
                    s.cfa,
                    s.bits,
                    class.unwrap_or_default()
                );
            }
        }
    }
    Ok(ExitCode::SUCCESS)
}

const HEAD: &str = "\
# Built-in sensors

Made by `camrig presets --markdown`. Each is a camera: `--camera imx219`. `camrig explain imx219` lists all its values
with their sources, `camrig presets imx219` prints its file, and `camrig camera new --like imx219` writes one of your
own.

Letters say what is behind a value: m measured, d the maker's data sheet, q quoted from another page, c computed from
such values, t typical: a rule of thumb, or borrowed from another sensor. Full well is the key of the camera file,
electrons per DN at unity gain times the largest DN; saturation lies a black level below it.

| name | sensor | class | shutter | pixels | µm | bits | colours | full well, e⁻ | read noise, e⁻ | peak QE |
|---|---|---|---|---|---|---|---|---|---|---|
";

/// The list as a page in Markdown.
fn page() -> Result<String> {
    let mut page = HEAD.to_string();
    for sensor in Sensor::all() {
        let draft = Draft::of_preset(sensor.name())?;
        let cell = |path: &str| draft.entry(path).map(graded).unwrap_or_default();
        let bare = |path: &str| draft.entry(path).map(bare).unwrap_or_default();
        page += &format!(
            "| `{}` | {} {} | {} | {} | {} × {} | {} | {} | {} | {} | {} | {} |\n",
            sensor.name(),
            sensor.text("maker"),
            sensor.name().to_uppercase(),
            sensor.text("class"),
            sensor.text("shutter"),
            bare("sensor.width"),
            cell("sensor.height"),
            cell("sensor.pitch_um"),
            cell("sensor.bits"),
            cell("sensor.cfa"),
            cell("sensor.full_well_e"),
            cell("sensor.noise.read_e"),
            cell("sensor.qe_peak"),
        );
    }
    Ok(page)
}

/// A value without quotation marks, and whole numbers without a point.
pub fn bare(entry: &Entry) -> String {
    match (entry.value.as_str(), entry.value.as_f64()) {
        (Some(text), _) => text.to_string(),
        (None, Some(number)) => number.to_string(),
        _ => entry.value.to_string(),
    }
}

/// A value with the letter of its grade.
fn graded(entry: &Entry) -> String {
    let letter = match entry.basis.grade {
        Grade::Given => "",
        Grade::Measured => " m",
        Grade::Datasheet => " d",
        Grade::Quoted => " q",
        Grade::Derived => " c",
        Grade::Typical => " t",
    };
    format!("{}{letter}", bare(entry))
}
