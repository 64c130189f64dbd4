//! A ColorChecker under D65 at 300 lx to a raw file and the mean DN of each channel.
//!
//! `cargo run --release -p camrig --example simulate -- chart.dng`

use camrig::light::photometry::white_radiance;
use camrig::prelude::*;
use camrig::{formats, output::OutputFile, render};
use std::io::Write;
use std::path::Path;

fn main() -> Result<()> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "chart.dng".into());

    // One physical camera: a built-in preset with a smaller sensor, or the path of a camera file.
    let camera = Camera::load("mt9v024")?.with_size(320, 240)?;

    // The scene, and the spectral radiance (W m⁻² sr⁻¹ nm⁻¹) of a perfect white in it.
    let scene = camrig::scene_files::open("colorchecker")?;
    let light = Illuminant::parse("D65")?;
    let white = white_radiance(&light, LightLevel::Lux(300.0), &scene.bands())?;
    let lit = LitScene { scene: &*scene, white };

    // The optics stage: spectral irradiance (W m⁻² nm⁻¹) on the sensor. It does not depend on
    // exposure, gain or noise, so one cube serves many frames.
    let (cube, _) = render::irradiance(&camera, &lit, &Options::default())?;

    // The sensor stage: 20 ms at the camera's own gain and temperature.
    let sensor = SimulatedSensor::new(&camera, &cube.header)?;
    let settings = camera.settings(0, 0.020, None);
    let frame = sensor.frame(&cube, &settings)?;
    for channel in frame.channel_means() {
        let saturated = 100.0 * channel.saturated;
        println!("{}: {:.1} DN, {saturated:.1} % saturated", channel.name, channel.mean_dn);
    }

    let info = render::dng_info(&camera, &settings, Some(&light), "colorchecker")?;
    let facts = formats::Facts { dng: Some(info), ..formats::Facts::of(&frame) };
    let bytes = Format::Dng.encode(&Frames { facts, ..Frames::from_raw(&frame) })?;
    let mut file = OutputFile::create(Path::new(&path), true)?;
    file.write_all(&bytes).map_err(|e| Error::io("write", Path::new(&path), e))?;
    file.finish()?;
    println!("wrote {path}");
    Ok(())
}
