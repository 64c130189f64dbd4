//! EMVA 1288 analysis of 100 frames of 3 Mpixel against the `emva1288` package from PyPI, in one run.
//!
//! `cargo bench -p camrig-benches --bench emva`. Both read the same NPY files (warm in the page cache) and
//! give K, QE, noise, DSNU, PRNU, linearity; the package runs where `EMVA1288_PYTHON` (or `python3`) has it,
//! by `tests/peers/emva1288_peer.py`, timed without Python's start and imports. Our peak memory is that of
//! this process, which also made the frames one at a time.

use camrig::camera::Camera;
use camrig::captures::{CaptureSet, plan, take};
use camrig::measure::emva;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

/// Ten light levels and a dark of two frames, and a spatial pair of 39: 100 frames of one exposure time.
const PLAN: &str = r#"
format = "plan/1"
[[stack]]
id = "dark"
role = "dark"
frames = 2
exposure_s = 0.01
[[stack]]
id = "flat"
role = "flat"
frames = 2
exposure_s = 0.01
fill = { from = 0.11, to = 1.1, count = 10 }
light = { wavelength_nm = 550.0 }
saturates = true
[[stack]]
id = "dark-spatial"
role = "dark"
frames = 39
exposure_s = 0.01
[[stack]]
id = "flat-spatial"
role = "flat"
frames = 39
exposure_s = 0.01
fill = 0.5
light = { wavelength_nm = 550.0 }
"#;

const CAMERA: &str = r#"
[lens]
kind = "diffraction-limited"
f_number = 2.8
focal_length_mm = 4.9
[sensor]
width = 2048
height = 1536
pitch_um = 2.2
fill_factor = 1.0
cfa = "mono"
qe = 0.5
conversion_gain_uv_per_e = 75.0
full_well_e = 10000
bits = 12
black_level_dn = 64
[sensor.noise]
read_e = 4.0
dark_current_e_per_s = 20.0
dsnu_e_per_s = 6.0
prnu = 0.01
row_fpn_e = 0.5
"#;

fn main() {
    let folder = std::env::temp_dir().join(format!("camrig-bench-emva-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder for 600 MB of frames");
    let set = folder.join("set");
    frames(&folder, &set);
    // The first pass warms the page cache.
    let mut seconds = f64::MAX;
    for _ in 0..3 {
        let start = Instant::now();
        let result = emva::measure(&CaptureSet::load(&set).expect("the set loads"));
        let figures = &result.expect("the set can be measured").channels[0].figures;
        seconds = seconds.min(start.elapsed().as_secs_f64());
        assert!(figures.prnu_1288_percent.is_some());
    }
    println!("EMVA 1288 analysis, 100 frames of 2048 x 1536:");
    println!("  camrig    {seconds:7.2} s, {} at most in memory", memory(peak_bytes()));
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/peers/emva1288_peer.py");
    let python = std::env::var("EMVA1288_PYTHON").unwrap_or_else(|_| "python3".into());
    let output = Command::new(python).arg(script).arg(&set).output();
    let text = output.ok().filter(|o| o.status.success()).map(|o| o.stdout).unwrap_or_default();
    let text = String::from_utf8_lossy(&text).into_owned();
    match (number(&text, "seconds"), number(&text, "peak_bytes")) {
        (Some(peer), bytes) => {
            println!("  emva1288  {peer:7.2} s, {} at most in memory", memory(bytes));
            println!("  camrig is {:.1} x as fast", peer / seconds);
        }
        _ => println!("  emva1288: SKIP, python3 has no emva1288 (pip install 'numpy<2' emva1288)"),
    }
    // Left behind only where the run was broken off.
    let _ = std::fs::remove_dir_all(&folder);
}

fn frames(folder: &Path, set: &Path) {
    let camera = folder.join("camera.toml");
    std::fs::write(&camera, CAMERA).expect("write");
    let camera = Camera::load(camera.to_str().expect("utf-8")).expect("the camera loads");
    let shots = plan::parse(PLAN).expect("the plan is right");
    take::take(&camera, &shots, set, &take::TakeOptions::default(), || ()).expect("frames");
}

/// A number in the JSON of the peer's script, one key per line.
fn number(text: &str, key: &str) -> Option<f64> {
    let line = text.lines().find(|l| l.trim_start().starts_with(&format!("\"{key}\"")))?;
    line.split_once(':')?.1.trim().trim_end_matches(',').parse().ok()
}

/// This process's largest resident memory, where Linux tells it.
fn peak_bytes() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse::<f64>().ok().map(|kib| kib * 1024.0)
}

fn memory(bytes: Option<f64>) -> String {
    bytes.map_or("?".into(), |b| format!("{:.0} MiB", b / f64::from(1 << 20)))
}
