//! Tests of the program, its files and its figures, as a user meets them.

mod bad_input;
mod batch;
mod black_levels;
mod calibration;
mod cameras;
mod captures;
mod command_line;
mod console_scenes;
mod control;
mod data_sets;
mod diagnosis;
mod empirical;
mod examples;
mod file_circles;
mod full_disk;
mod gige;
mod glass_catalogues;
mod guide;
mod hdr_sensors;
mod interfaces;
mod lens;
mod light_in_time;
mod live;
mod measuring;
mod mosaics;
mod photon_transfer;
mod pictures;
mod powers;
mod profiles;
mod radiometry;
mod real_data;
mod scene_frames;
mod scene_sequences;
mod sequences;
mod statistics;
mod usbip;

use std::path::Path;
use std::process::{Command, Output};

/// Runs camrig with arguments split at blanks, in a directory.
fn camrig(directory: &Path, arguments: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_camrig-under-test"))
        .args(arguments.split_whitespace())
        .current_dir(directory)
        .output()
        .expect("the program starts")
}

/// Runs camrig, which must succeed.
fn camrig_ok(directory: &Path, arguments: &str) -> Output {
    let output = camrig(directory, arguments);
    assert!(
        output.status.success(),
        "camrig {arguments}\n{}",
        String::from_utf8_lossy(&output.stderr)
    );
    output
}

/// A camera file: the text of a preset with a small sensor and some lines replaced.
fn small_camera(width: u32, height: u32, changes: &[(&str, &str)]) -> String {
    let text = camrig::camera::presets::file("mt9t012.toml").expect("preset");
    let mut out = String::new();
    for line in text.lines() {
        let key = line.split('=').next().unwrap_or("").trim();
        let changed = match key {
            "width" => Some(format!("width = {width}")),
            "height" => Some(format!("height = {height}")),
            "qe" => Some("qe = 0.5".to_string()),
            "ir_cut" => Some(String::new()),
            _ => None,
        };
        let changed =
            changes.iter().find(|(k, _)| *k == key).map(|(k, v)| format!("{k} = {v}")).or(changed);
        out.push_str(changed.as_deref().unwrap_or(line));
        out.push('\n');
    }
    out
}

/// The camera that a file of this text describes.
fn camera(text: &str) -> camrig::camera::Camera {
    let directory = tempfile::tempdir().expect("temporary directory");
    let path = directory.path().join("camera.toml");
    std::fs::write(&path, text).expect("write");
    camrig::camera::Camera::load(path.to_str().expect("utf-8")).expect("the camera loads")
}

/// A file or folder of real inputs and independent figures. `None` where it is absent.
fn shared(path: &str) -> Option<std::path::PathBuf> {
    let root = std::env::var_os("CAMRIG_SHARED").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared"),
        std::path::PathBuf::from,
    );
    let path = root.join(path);
    if path.exists() {
        return Some(path);
    }
    println!("SKIP: {} is not here", path.display());
    None
}
