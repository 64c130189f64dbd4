//! Pages of real measurements of small simulated captures.

use camrig_camera::{Camera, EffectKind};
use camrig_capture::{plan, take};
use camrig_captures::CaptureSet;
use camrig_diagnose::{Options, diagnose};
use camrig_report::{datasheet, diagnosis, emva};
use camrig_sensor_core::effects::{amp_glow::AmpGlow, column_offset_fpn::ColumnOffsetFpn};
use camrig_validate::datasheet::Datasheet;
use std::path::Path;

/// A built-in camera with a few pixels in the middle of its sensor.
fn small(width: u32, height: u32) -> Camera {
    let mut camera = Camera::load("mt9v024").unwrap();
    (camera.sensor.width, camera.sensor.height) = (width, height);
    camera
}

fn taken(camera: &Camera, name: &str, folder: &Path) -> CaptureSet {
    let shots = plan::load(name).unwrap();
    take::take(camera, &shots, folder, &take::TakeOptions::default(), || ()).unwrap();
    CaptureSet::load(folder).unwrap()
}

/// The data sheet of a camera, and the page of its EMVA 1288 measurement.
pub fn data_sheets() -> [(&'static str, String); 2] {
    let camera = small(64, 48);
    let sheet = Datasheet::measure(&camera, (64, 48)).unwrap();
    let measured =
        emva::page("mt9v024 · EMVA 1288", "captures", &sheet.emva, "camrig measure emva captures");
    [("data sheet", datasheet::page(&camera, &sheet)), ("emva", measured)]
}

/// A diagnosis that finds a glow and a pattern of columns, and what it says.
pub fn diagnosed() -> (String, String) {
    let model = small(64, 48);
    let mut built = model.clone();
    built.effects.push(AmpGlow { rate_e_per_s: 900.0, x: 1.0, y: 0.05, width: 0.35 }.into());
    built.effects.push(ColumnOffsetFpn::from_values(&[9.0]).into());
    let folder = tempfile::tempdir().unwrap();
    let set = taken(&built, "ptc", &folder.path().join("set"));
    let found = diagnose(&model, set, &Options::default()).unwrap();
    let improved = found.improved_file("mt9v024").unwrap();
    let command = "camrig diagnose mt9v024 captures -o diagnosis";
    let page = diagnosis::page(&found, &improved, command).unwrap();
    for step in &found.report.steps {
        assert!(EffectKind::all().any(|kind| kind.kind == step.effect), "{}", step.effect);
    }
    (page, found.report.json())
}
