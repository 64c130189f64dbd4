//! EMVA 1288 figures from frames: those of the capture set in a folder (`captures.toml` and its
//! frames), or of a set that is taken here with a simulated camera.
//!
//! `cargo run --release -p camrig --example emva -- captures`

use camrig::capture::{plan, take};
use camrig::measure::emva;
use camrig::prelude::*;
use std::path::PathBuf;

fn main() -> Result<()> {
    let own = tempfile::tempdir().map_err(|e| Error::io("make", "a folder".as_ref(), e))?;
    let folder = match std::env::args().nth(1) {
        Some(folder) => PathBuf::from(folder),
        None => simulated(own.path().join("set"))?,
    };
    let set = CaptureSet::load(&folder)?;
    let measured = emva::measure(&set)?;
    for channel in &measured.channels {
        let f = &channel.figures;
        println!("channel {}:", channel.channel);
        for (name, figure, unit) in [
            ("overall system gain K", f.overall_system_gain, "DN/e⁻"),
            ("temporal dark noise", f.temporal_dark_noise_dn, "DN"),
            ("saturation capacity", f.saturation_capacity_e, "e⁻"),
            ("maximum SNR", f.snr_max_db, "dB"),
            ("dynamic range", f.dynamic_range_db, "dB"),
        ] {
            match figure {
                Some(v) => println!("  {name:25} {:.4} ± {:.4} {unit}", v.value, v.std_error),
                None => println!("  {name:25} not determined by these captures"),
            }
        }
    }
    for warning in &measured.warnings {
        println!("warning: {warning}");
    }
    Ok(())
}

/// The built-in plan `emva` taken with a preset of few pixels.
fn simulated(folder: PathBuf) -> Result<PathBuf> {
    let camera = Camera::load("mt9v024")?.with_size(96, 64)?;
    let plan = plan::load("emva")?;
    take::take(&camera, &plan, &folder, &take::TakeOptions::default(), || ())?;
    Ok(folder)
}
