//! A diagnosis: captures of a sensor with row noise, and a camera that lacks it.
//!
//! `cargo run --release -p camrig --example diagnosis`; takes about a minute.

use camrig::capture::{plan, take};
use camrig::diagnose::{Options, Progress, diagnose};
use camrig::prelude::*;
use camrig_sensor_core::effects::row_temporal_noise::RowTemporalNoise;

fn main() -> Result<()> {
    let model = Camera::load("mt9v024")?.with_size(96, 64)?;

    // The sensor as built: the model, and row noise of 6 e⁻ that is new in every frame.
    let mut built = model.clone();
    built
        .effects
        .push(RowTemporalNoise { sigma_e: 6.0, gain_exponent: 0.0, opposite_e: 0.0 }.into());
    let folder = tempfile::tempdir().map_err(|e| Error::io("make", "a folder".as_ref(), e))?;
    let captures = folder.path().join("captures");
    take::take(&built, &plan::load("ptc")?, &captures, &take::TakeOptions::default(), || ())?;

    // Half of the frames are fitted, the others are held out and only judge.
    let show = |progress: Progress<'_>| {
        if let Progress::Trying(effect) = progress {
            println!("trying {effect}");
        }
    };
    let options = Options::default().with_progress(&show);
    let report = diagnose(&model, CaptureSet::load(&captures)?, &options)?.report;
    println!(
        "{}: gap {:.2} → {:.2} on held-out frames (1.0 for the right model)",
        report.verdict.word(),
        report.gap_before,
        report.gap_after
    );
    for step in &report.steps {
        for (name, parameter) in &step.parameters {
            let value = parameter.value;
            let error = parameter.std_error.map_or("unknown".into(), |e| format!("{e:.3}"));
            println!("{} ({}): {name} = {value:.3?} ± {error}", step.effect, step.status.word());
        }
    }
    Ok(())
}
