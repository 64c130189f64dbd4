//! `camrig demo`: the main job on built-in data.

use super::arguments;
use crate::camera::Camera;
use crate::formats::output::OutputDir;
use crate::formats::{Facts, Format, Frames, png, preview};
use crate::optics::Options;
use crate::render::{self, Arithmetic, Exposure};
use crate::report::page::Page;
use crate::scene::{self, Illuminant, LightLevel, LitScene, photometry};
use crate::{RawFrame, Result};
use std::path::PathBuf;
use std::process::ExitCode;

/// The main job on built-in data: a ColorChecker under D65 to raw files, pictures and a page
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:\n  camrig demo -o demo && open demo/report.html")]
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
/// Scene illuminance (lx) and exposure (s) of the frames: the two light levels of Chen et al. 2009.
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
        "A ColorChecker under D65, 31 spectral bands, through a diffraction-limited lens onto the sensor \
         of Chen et al. 2009. The optics ran once; each frame below is the sensor stage alone.",
    );
    for (lux, exposure_s) in SHOTS {
        let exposure = Exposure::new(&camera, &cube.header, lux / base_lux)?;
        let settings = camera.settings(0, exposure_s, None);
        let frame = exposure.frame(&cube, None, &settings, Arithmetic::F32)?;
        let name = format!("colorchecker-{lux}lx");
        let info = render::dng_info(&camera, &settings, Some(&light), &cube.header.made_of)?;
        let facts = Facts { dng: Some(info.clone()), ..Facts::of(&frame) };
        let raw = Format::Dng.encode(&Frames { facts, ..Frames::from_raw(&frame) })?;
        directory.write(format!("{name}.dng"), &raw)?;
        let picture = png::encode_rgb(&preview::render(&frame, &info))?;
        directory.write(format!("{name}.png"), &picture)?;
        let small = png::encode_rgb(&preview::thumbnail(&frame, &info, 1024))?;
        page.heading(&format!("{lux} lx, {} ms", exposure_s * 1e3));
        page.picture(&small, &format!("{name}.dng, simple demosaicing, white balance, sRGB"));
        page.table(&["channel", "mean DN above black", "saturated"], &channel_rows(&frame));
    }
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
    Ok(ExitCode::SUCCESS)
}

fn channel_rows(frame: &RawFrame) -> Vec<Vec<String>> {
    arguments::channel_means(frame)
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
