//! `camrig demo`: the main workflow on built-in data.

mod hdr;

use super::arguments;
use camrig_base::Result;
use camrig_base::output::OutputDir;
use camrig_camera::Camera;
use camrig_formats::{Facts, Format, Frames, png, preview};
use camrig_light::Illuminant;
use camrig_optics::{Options, Report};
use camrig_render::{self as render, SceneLight, SimulatedSensor};
use camrig_report::page::{Page, Table};
use camrig_report::simulation;
use camrig_rig::{FrameRequest, Rig};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Simulate a ColorChecker in D65 with built-in data: raw files, pictures and a report
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  camrig demo -o demo && open demo/report.html
  camrig demo hdr && open camrig-demo-hdr/report.html")]
pub struct Args {
    /// Which demo [default: the main workflow]
    #[arg(value_enum)]
    demo: Option<Demo>,
    /// Directory for the results [default: camrig-demo, or camrig-demo-hdr]
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Replace an existing demo
    #[arg(long)]
    force: bool,
}

/// A demo beside that of the main workflow.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Demo {
    /// A road at night, headlights and a pulsed sign, seen by a sensor with four captures.
    Hdr,
}

const CAMERA: &str = "mt9t012";
const SCENE: &str = "colorchecker";
/// Scene illuminance (lx) and exposure (s) of the frames: the two light levels of Chen et al.
/// 2009.
const SHOTS: [(f64, f64); 2] = [(300.0, 0.040), (10.0, 0.120)];

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    let folder = |name: &str| args.output.clone().unwrap_or_else(|| PathBuf::from(name));
    match args.demo {
        Some(Demo::Hdr) => hdr::run(&folder("camrig-demo-hdr"), args.force),
        None => main_workflow(&folder("camrig-demo"), args.force),
    }
}

fn main_workflow(output: &Path, force: bool) -> Result<ExitCode> {
    let directory = OutputDir::create(output, force)?;
    let camera = Camera::load(CAMERA)?;
    let light = Illuminant::parse("D65")?;
    let base_lux = SHOTS[0].0;
    let bar = arguments::progress("optics", 0);
    let in_light = SceneLight::lux("D65", base_lux);
    let seen = render::scene_irradiance(
        &camera,
        SCENE,
        &in_light,
        &Options::default(),
        |done, bands| {
            bar.set_length(bands as u64);
            bar.set_position(done as u64);
        },
    )?;
    let (cube, optics) = (seen.cube, seen.optics);
    bar.finish_and_clear();
    let mut rig = Rig::open("emulator:")?;
    let (mut same, mut link, mut frames) = (true, Vec::new(), simulation::Frames::default());
    for (lux, exposure_s) in SHOTS {
        let sensor = SimulatedSensor::in_light(&camera, &cube.header, lux / base_lux)?;
        let settings = camera.settings(0, exposure_s, None);
        rig.set_camera(&sensor)?;
        let request = FrameRequest::new(settings);
        let frame = rig.frame(&cube, &sensor, &request)?.to_raw(&sensor)?;
        same &= frame == sensor.frame(&cube, &settings)?;
        let (sent, received) = rig.link_bytes();
        link.push(vec![format!("{lux} lx"), mebibytes(sent), mebibytes(received)]);
        let name = format!("colorchecker-{lux}lx");
        let info = render::dng_info(&camera, &settings, Some(&light), &cube.header.made_of)?;
        let facts = Facts { dng: Some(info.clone()), ..Facts::of(&frame) };
        let raw = Format::Dng.encode(&Frames { facts, ..Frames::from_raw(&frame) })?;
        directory.write(format!("{name}.dng"), &raw)?;
        let picture = png::encode_rgb(&preview::bright(&frame, &info).0)?;
        directory.write(format!("{name}.png"), &picture)?;
        frames.add(&format!("{name}.dng"), &frame, &info)?;
    }
    let page = page(&camera, &light, &optics, &frames, same, &link);
    directory.write("report.html", page.html().as_bytes())?;
    directory.write("camera.toml", camera.text.as_bytes())?;
    directory.finish()?;
    eprintln!("wrote {}", output.join("report.html").display());
    if !same {
        eprintln!("the rig's frames differ from those of the sensor stage in this process");
    }
    Ok(if same { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// The report: the frames, and the comparison with the rig.
fn page(
    camera: &Camera,
    light: &Illuminant,
    optics: &Report,
    frames: &simulation::Frames,
    same: bool,
    link: &[Vec<String>],
) -> Page {
    let cells = optics.oversample.iter().max().unwrap_or(&1);
    let shots = SHOTS.map(|(lux, exposure_s)| format!("{lux} lx, {} ms", exposure_s * 1e3));
    let made_of = [
        ("scene", format!("ColorChecker, {} spectral bands", optics.oversample.len())),
        ("illuminant", light.name.clone()),
        ("frames", shots.join("; ")),
        ("camera", format!("{CAMERA}, the sensor of Chen et al. 2009")),
        ("lens", "diffraction-limited".to_owned()),
        ("cells per pixel and direction", cells.to_string()),
        ("margin of the optics", format!("{} pixels", optics.margin_pixels)),
    ];
    let settings = camera.settings(0, SHOTS[0].1, None);
    let mut page =
        simulation::page("camrig demo", camera, Some(light), &settings, &made_of, frames);
    page.command("camrig demo").heading("Rig");
    page.paragraph(
        "The optics ran once; its irradiance was streamed row by row to the rig's \
         emulator, which sent the raw rows back.",
    );
    page.paragraph(if same {
        "The rig's rows are identical, bit for bit, to those of the sensor stage in this process."
    } else {
        "The rig's rows differ from those of the sensor stage in this process, which is a fault."
    });
    let mut table = Table::new(&["frame"]).numbers(&["total sent, MiB", "total received, MiB"]);
    table.rows(link.iter().cloned());
    page.rows(&table);
    page
}

fn mebibytes(bytes: u64) -> String {
    format!("{:.1}", bytes as f64 / f64::from(1 << 20))
}
