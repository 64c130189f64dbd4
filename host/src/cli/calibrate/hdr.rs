//! `camrig scene hdr`.

use super::response::ResponseFile;
use super::{Output, Source, read_toml};
use camrig_base::Cfa;
use camrig_base::{Error, Plane, Result};
use camrig_calibrate::hdr;
use camrig_calibrate::view::{Region, View};
use camrig_scene::numpy;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::PathBuf;

/// Merge several exposures of a still view to one linear frame
///
/// Writes radiance.npy (DN/s), sigma.npy, flags.npy and hdr.toml.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:\n  camrig scene hdr exposures/ -o merged/")]
pub struct HdrArgs {
    #[command(flatten)]
    source: Source,
    /// response.toml of `scene response`, for a camera that is not linear
    #[arg(long, value_name = "FILE")]
    response: Option<PathBuf>,
    /// Luminance meter reading of a region, X,Y,W,H=CD: makes the scale absolute
    #[arg(long, value_name = "X,Y,W,H=CD")]
    luminance: Option<String>,
    #[command(flatten)]
    to: Output,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct HdrFile {
    format: String,
    pub(super) cfa: String,
    view: String,
    exposures: Vec<String>,
    shifts: Vec<[i64; 2]>,
    noise_gain_dn: f64,
    noise_read_dn2: f64,
    dynamic_range_db: f64,
    moved_fraction: f64,
    saturated_fraction: f64,
    /// cd/m² per DN/s of green, where a reading was given.
    #[serde(skip_serializing_if = "Option::is_none")]
    luminance_per_dn_s: Option<f64>,
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
        Some(path) => read_toml::<ResponseFile>(path)?.response,
        None => Vec::new(),
    };
    let merged = hdr::merge(series, &cfa, full_scale, &responses)?;
    let luminance_per_dn_s = args
        .luminance
        .as_deref()
        .map(|text| absolute_scale(text, &merged.radiance, &cfa))
        .transpose()?;
    let fraction = |flag: hdr::Flag| {
        let count = merged.flags.data.iter().filter(|&&f| f == flag as u8).count();
        count as f64 / merged.flags.data.len() as f64
    };
    let about = HdrFile {
        format: "hdr/1".into(),
        cfa: cfa.to_string(),
        view: series.name.clone(),
        exposures: series.exposures.iter().map(|e| e.id.clone()).collect(),
        shifts: merged.shifts.iter().map(|s| s.map(|v| v as i64)).collect(),
        noise_gain_dn: merged.noise.gain_dn,
        noise_read_dn2: merged.noise.read_dn2,
        dynamic_range_db: merged.dynamic_range_db,
        moved_fraction: fraction(hdr::Flag::Moved),
        saturated_fraction: fraction(hdr::Flag::Saturated),
        luminance_per_dn_s,
    };
    output.write("radiance.npy", &numpy::encode(&merged.radiance, "<f4", f32::to_le_bytes))?;
    output.write("sigma.npy", &numpy::encode(&merged.sigma, "<f4", f32::to_le_bytes))?;
    output.write("flags.npy", &numpy::encode(&merged.flags, "|u1", u8::to_le_bytes))?;
    let text = toml::to_string(&about).map_err(|e| Error::internal(format!("hdr.toml: {e}")))?;
    output.write("hdr.toml", text.as_bytes())?;
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
            "{}: {} exposures, {:.1} dB; noise {:.3} DN²/DN, {:.2} DN² read",
            about.view,
            about.exposures.len(),
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
