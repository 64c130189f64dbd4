//! `camrig demo`: the main job on built-in data.

use super::arguments;
use camrig_base::output::OutputDir;
use camrig_base::{RawFrame, Result};
use camrig_camera::Camera;
use camrig_formats::{Facts, Format, Frames, png, preview};
use camrig_optics::Options;
use camrig_render::{self as render, Arithmetic, SimulatedSensor};
use camrig_report::page::Page;
use camrig_rig::{FrameRequest, Rig};
use camrig_scene::{self as scene, Illuminant, LightLevel, LitScene, photometry};
use std::path::PathBuf;
use std::process::ExitCode;

/// The main job on built-in data: a ColorChecker under D65 to raw files, pictures and a page
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  camrig demo -o demo && open demo/report.html")]
pub struct Args {
    /// Directory for the results
    #[arg(short, long, default_value = "camrig-demo", value_name = "DIR")]
    output: PathBuf,
    /// Replace an earlier demo
    #[arg(long)]
    force: bool,
}

const CAMERA: &str = "mt9t012";
const SCENE: &str = "colorchecker";
/// Scene illuminance (lx) and exposure (s) of the frames: the two light levels of Chen et al.
/// 2009.
const SHOTS: [(f64, f64); 2] = [(300.0, 0.040), (10.0, 0.120)];

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    let directory = OutputDir::create(&args.output, args.force)?;
    let camera = Camera::load(CAMERA)?;
    let scene = scene::open(SCENE)?;
    let light = Illuminant::parse("D65")?;
    let base_lux = SHOTS[0].0;
    let white = photometry::white_radiance(&light, LightLevel::Lux(base_lux), &scene.bands())?;
    let bar = arguments::progress("optics", scene.bands().count as u64);
    let (cube, optics) = render::irradiance(
        &camera,
        &LitScene { scene: &*scene, white },
        &Options::default(),
        render::About {
            lux: Some(base_lux),
            illuminant: Some(light.name.clone()),
            made_of: format!("scene {SCENE}, lens of {CAMERA}"),
        },
        |done, _| bar.set_position(done as u64),
    )?;
    bar.finish_and_clear();
    let mut page = Page::new("camrig demo");
    page.paragraph(
        "A ColorChecker under D65, 31 spectral bands, through a diffraction-limited lens onto \
         the sensor of Chen et al. 2009. The optics ran once; its irradiance was streamed row by \
         row to the embedded rig's emulator, which sent the raw rows back.",
    );
    let mut rig = Rig::open("emulator:")?;
    let (mut same, mut link) = (true, Vec::new());
    for (lux, exposure_s) in SHOTS {
        let sensor = SimulatedSensor::new(&camera, &cube.header, lux / base_lux)?;
        let settings = camera.settings(0, exposure_s, None);
        rig.set_camera(&sensor)?;
        let request = FrameRequest {
            settings,
            arithmetic: Arithmetic::F32,
            collapse: false,
            lit_before: false,
            by_registers: false,
            rows_stay: false,
        };
        let frame = rig.frame(&cube, &sensor, &request)?.to_raw(&sensor)?;
        same &= frame == sensor.frame(&cube, None, &settings, Arithmetic::F32)?;
        let (sent, received) = rig.link_bytes();
        link.push(vec![format!("{lux} lx"), mebibytes(sent), mebibytes(received)]);
        let name = format!("colorchecker-{lux}lx");
        let info = render::dng_info(&camera, &settings, Some(&light), &cube.header.made_of)?;
        let facts = Facts { dng: Some(info.clone()), ..Facts::of(&frame) };
        let raw = Format::Dng.encode(&Frames { facts, ..Frames::from_raw(&frame) })?;
        directory.write(format!("{name}.dng"), &raw)?;
        let picture = png::encode_rgb(&preview::bright(&frame, &info).0)?;
        directory.write(format!("{name}.png"), &picture)?;
        let (small, factor) = preview::bright_thumbnail(&frame, &info, 1024);
        page.heading(&format!("{lux} lx, {} ms", exposure_s * 1e3));
        let words = preview::brightness_words(factor);
        let caption = format!("{name}.dng, simple demosaicing, white balance, sRGB, {words}");
        page.picture(&png::encode_rgb(&small)?, &caption);
        page.table(&["channel", "mean DN above black", "saturated"], &channel_rows(&frame));
    }
    page.heading("Rig");
    page.paragraph(if same {
        "The rig's rows and those of the sensor stage in this process are the same, bit for bit."
    } else {
        "The rig's rows differ from those of the sensor stage in this process: this must not be."
    });
    page.table(&["frame", "sent in all, MiB", "received in all, MiB"], &link);
    page.heading("Camera");
    page.paragraph(&format!(
        "Optics: {} cells per pixel and direction, margin of {} pixels. Sensor seed {}.",
        optics.oversample.iter().max().unwrap_or(&1),
        optics.margin_pixels,
        camera.sensor.seed
    ));
    page.verbatim(&camera.text);
    directory.write("report.html", page.html().as_bytes())?;
    directory.write("camera.toml", camera.text.as_bytes())?;
    directory.finish()?;
    eprintln!("wrote {}", args.output.join("report.html").display());
    if !same {
        eprintln!("the rig's frames differ from those of the sensor stage in this process");
    }
    Ok(if same { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn mebibytes(bytes: u64) -> String {
    format!("{:.1}", bytes as f64 / f64::from(1 << 20))
}

fn channel_rows(frame: &RawFrame) -> Vec<Vec<String>> {
    frame
        .channel_means()
        .into_iter()
        .map(|(name, mean_dn, saturated)| {
            vec![
                name,
                format!("{:.1}", mean_dn - frame.black_level_dn),
                format!("{:.2} %", 100.0 * saturated),
            ]
        })
        .collect()
}
