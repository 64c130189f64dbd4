//! `camrig scene hdr`.

use super::{Output, Source};
use camrig_base::Cfa;
use camrig_base::numbers::counted;
use camrig_base::{Error, Plane, Result};
use camrig_calibrate::files::{HdrFile, ResponseFile};
use camrig_calibrate::hdr;
use camrig_calibrate::view::{Region, View};
use camrig_scene_files::numpy;
use serde_json::json;
use std::path::PathBuf;

/// Merge several exposures of a still scene into one linear frame
///
/// Writes radiance.npy (DN/s), sigma.npy, flags.npy and hdr.toml.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  camrig scene hdr exposures/ -o merged/")]
pub struct HdrArgs {
    #[command(flatten)]
    source: Source,
    /// response.toml from `scene response`, for a non-linear camera
    #[arg(long, value_name = "FILE")]
    response: Option<PathBuf>,
    /// Luminance meter reading of a region in cd/m², X,Y,W,H=CD: makes the scale absolute
    #[arg(long, value_name = "X,Y,W,H=CD")]
    luminance: Option<String>,
    #[command(flatten)]
    to: Output,
}

/// Runs `scene hdr`.
pub fn hdr(args: &HdrArgs) -> Result<()> {
    let output = args.to.create()?;
    let (series, cfa, full_scale) = args.source.read()?;
    let [series] = &series[..] else {
        let names: Vec<&str> = series.iter().map(|s| s.name.as_str()).collect();
        return Err(Error::input(format!("{} views in the capture set", series.len())).help(
            format!("choose the captures of one with --only; there are {}", names.join("; ")),
        ));
    };
    let responses = match &args.response {
        Some(path) => ResponseFile::read(path)?.response,
        None => Vec::new(),
    };
    let merged = hdr::merge(series, &cfa, full_scale, &responses)?;
    let luminance_per_dn_s = args
        .luminance
        .as_deref()
        .map(|text| absolute_scale(text, &merged.radiance, &cfa))
        .transpose()?;
    let about = HdrFile::of(&merged, series, &cfa, luminance_per_dn_s);
    output.write("radiance.npy", &numpy::encode(&merged.radiance, "<f4", f32::to_le_bytes))?;
    output.write("sigma.npy", &numpy::encode(&merged.sigma, "<f4", f32::to_le_bytes))?;
    output.write("flags.npy", &numpy::encode(&merged.flags, "|u1", u8::to_le_bytes))?;
    output.write("hdr.toml", about.text()?.as_bytes())?;
    output.finish()?;
    for (id, shift) in about.exposures.iter().zip(&about.shifts).filter(|(_, s)| **s != [0, 0]) {
        eprintln!("note: capture {id} was shifted by {shift:?} pixels, corrected");
    }
    if about.moved_fraction > 0.0 {
        eprintln!(
            "note: {:.2} % of the pixels show movement and come from one exposure (flags.npy = 1)",
            100.0 * about.moved_fraction
        );
    }
    if args.to.json {
        println!("{}", json!(about));
    } else {
        println!(
            "{}: {}, {:.1} dB; noise {:.3} DN²/DN, {:.2} DN² read",
            about.view,
            counted(about.exposures.len(), "exposure"),
            about.dynamic_range_db,
            about.noise_gain_dn,
            about.noise_read_dn2
        );
    }
    args.to.say_written();
    Ok(())
}

/// cd/m² per DN/s from `X,Y,W,H=CD`, by the green channel (the only one of a mono camera).
fn absolute_scale(text: &str, radiance: &Plane<f32>, cfa: &Cfa) -> Result<f64> {
    let wrong = || {
        Error::input(format!("--luminance {text}"))
            .help("give X,Y,W,H=CD, for instance 10,10,50,50=80")
    };
    let (region, reading) = text.split_once('=').ok_or_else(wrong)?;
    let region: Region = region.parse().map_err(|_| wrong())?;
    let reading: f64 = reading.parse().ok().filter(|v| *v > 0.0).ok_or_else(wrong)?;
    let view = View::new(radiance, cfa);
    let green = view.letters.iter().position(|&l| l == 'G').unwrap_or(0);
    Ok(reading / view.mean(&region, "the reading's region")?[green])
}
