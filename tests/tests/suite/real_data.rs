//! Real scenes and real quantum efficiency through the main job.

use super::{camrig_ok, shared, small_camera};

#[test]
fn real_scenes_with_a_real_sensor() {
    let Some(scenes) = shared("data/scenes") else { return };
    let Some(qe) = shared("data/sensors/onsemi_aptina_MT9V024_RGB.csv") else { return };
    let dir = tempfile::tempdir().unwrap();
    let camera = small_camera(160, 120, &[("qe", "\"qe.csv\""), ("cfa", "\"RGGB\"")]);
    std::fs::write(dir.path().join("c.toml"), camera).unwrap();
    std::fs::copy(qe, dir.path().join("qe.csv")).unwrap();
    for (file, exposure) in [
        ("samson_hyperspectral_95x95.npz", "20ms"),
        ("fruitmcc_estimated_reflectance_316x338x31.npz", "20ms"),
    ] {
        let output = camrig_ok(
            dir.path(),
            &format!(
                "simulate --camera c.toml --scene {} --lux 300 --exposure {exposure} -o out.dng --force \
                 --json",
                scenes.join(file).display()
            ),
        );
        let object: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        for channel in ["r", "g", "b"] {
            let figures = &object["frames"][0]["channels"][channel];
            let mean = figures["mean_dn"].as_f64().unwrap();
            assert!(mean > 45.0 && mean < 1000.0, "{file} {channel}: {mean}");
        }
    }
}
