//! `camrig demo hdr`: a road at night, seen by a sensor for cars.
//!
//! It runs `camrig simulate` as one would type it, and makes a picture of the linear signal.

use crate::simulate;
use camrig_base::output::OutputDir;
use camrig_base::{Cfa, Error, RawFrame, Result};
use camrig_formats::{DngInfo, png, preview, wide};
use clap::Parser;
use std::path::Path;
use std::process::ExitCode;

/// What is common to the commands: headlights of 1e6 cd/m², a sign of 15 000 whose diodes pulse at
/// 90 Hz for a tenth of the time, a pedestrian of 0.1.
const NIGHT: &str = "--camera ox03c10 --set sensor.width=640 --set sensor.height=400 \
                     --set sensor.timing.line_time_us=12.01 \
                     --set sensor.timing.frame_length_lines=2775 \
                     --scene night-road:sign=4.8e4 --lux 1 --illuminant D65 --exposure 16ms \
                     --lamp pulse:hz=90,duty=0.1,phase=0.6,region=0.7,0.18,0.1,0.16";
/// Share of the picture's range that a tenfold of light takes: six decades are seen.
const PER_DECADE: f64 = 1.0 / 6.0;

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    args: simulate::Args,
}

/// Runs the demo.
pub fn run(folder: &Path, force: bool) -> Result<ExitCode> {
    let directory = OutputDir::create(folder, force)?;
    for (output, more) in [
        ("companded.dng", "--report report.html"),
        ("captures", "--set sensor.hdr.output=captures"),
        ("linear.npy", "--set sensor.hdr.output=linear"),
    ] {
        eprintln!("camrig simulate {NIGHT} {more} -o {output}");
        simulate(directory.path(), output, more)?;
    }
    let linear = std::fs::read(directory.path().join("linear.npy"))
        .map_err(|e| Error::io("read", &folder.join("linear.npy"), e))?;
    directory.write("picture.png", &png::encode_rgb(&picture(&linear)?)?)?;
    directory.finish()?;
    eprintln!(
        "wrote {}: report.html has the dynamic range, picture.png the merged signal with its \
         brightness logarithmic, captures the four readings of each pixel: those of 16 ms see the \
         sign's pulses, the very short one misses them, so that the merged sign is dark where the \
         others saturate",
        folder.display()
    );
    Ok(ExitCode::SUCCESS)
}

/// Runs one of the commands with its files in `folder`, whose name is none to be printed.
fn simulate(folder: &Path, output: &str, more: &str) -> Result<()> {
    let placed = |name: &str| folder.join(name).into_os_string();
    let words = ["simulate"].into_iter().chain(NIGHT.split_whitespace());
    let mut arguments: Vec<std::ffi::OsString> = words.map(Into::into).collect();
    let is_file = |word: &str| word.ends_with(".html");
    arguments.extend(more.split_whitespace().map(|word| match is_file(word) {
        true => placed(word),
        false => word.into(),
    }));
    arguments.extend(["-o".into(), placed(output)]);
    let line = Line::try_parse_from(arguments).map_err(|e| Error::internal(e.to_string()))?;
    simulate::written(&line.args).map(|_| ())
}

/// The merged signal as a picture: its logarithm, from the noise in the dark up.
fn picture(npy: &[u8]) -> Result<camrig_base::Plane<[u8; 3]>> {
    /// Pedestal of the signal, DN.
    const PEDESTAL: f64 = 64.0;
    /// Signal of white balance 1 at which the picture begins to be grey, DN.
    const DARK: f64 = 2.0;
    let frames =
        wide::decode(npy)?.ok_or_else(|| Error::internal("a linear signal of 16 bits"))?;
    let plane = &frames.planes[0];
    let logarithm = |dn: u32| {
        let above = (f64::from(dn) - PEDESTAL).max(0.0) / DARK;
        let share = PER_DECADE * libm::log10(1.0 + above);
        // sRGB's curve is applied to what is linear.
        (libm::pow(share.min(1.0), 2.2) * f64::from(u16::MAX)) as u16
    };
    let frame = RawFrame {
        width: plane.width,
        height: plane.height,
        bits: 16,
        cfa: Cfa::parse("GRBG")?,
        black_level_dn: 0.0,
        white_level_dn: u16::MAX,
        data: plane.data.iter().map(|dn| logarithm(*dn)).collect(),
    };
    Ok(preview::bright(&frame, &DngInfo::default()).0)
}
