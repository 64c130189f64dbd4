//! What a user should know of a model's lens comes with its frames.

use camrig_camera::{Camera, LensKind};
use camrig_optics::Characterisation;
use camrig_validate::paper::{LEVELS, take};

#[test]
fn a_sensor_beyond_the_tables_of_its_lens_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small");
    // To an image height of 0.5 mm; the corner of chart and edge lies farther out.
    Characterisation::example(17, 0.5).write(&path, false).unwrap();
    let mut model = Camera::load("mt9t012").unwrap();
    model.lens.kind = LensKind::Characterised(path);
    (model.sensor.width, model.sensor.height, model.sensor.pitch_um) = (64, 48, 20.0);
    let taken = take(&[&model], &LEVELS, || ()).unwrap();
    let told = |note: &String| note.contains("small: ") && note.contains("end at 0.500 mm");
    assert!(taken[0].notes.iter().any(told), "{:?}", taken[0].notes);
}
