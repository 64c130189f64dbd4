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
        println!("  overall system gain K     {:.4} DN/e⁻", f.overall_system_gain);
        println!("  temporal dark noise       {:.3} DN", f.temporal_dark_noise_dn);
        println!("  saturation capacity       {:.0} e⁻", f.saturation_capacity_e);
        println!("  maximum SNR               {:.1} dB", f.snr_max_db);
        println!("  dynamic range             {:.1} dB", f.dynamic_range_db);
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
