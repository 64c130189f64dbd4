//! EMVA 1288 analysis of 100 frames of 3 Mpixel, against the `emva1288` package from PyPI in the
//! same run.
//!
//! `cargo bench -p camrig-benches --bench emva`. Both read the same NPY files (warm in the page
//! cache) and compute K, QE, noise, DSNU, PRNU, linearity, two histograms and four spectrograms.
//! The package runs if `EMVA1288_PYTHON` (or `python3`) has it, through
//! `tests/peers/emva1288_peer.py`, and is timed without the start of Python and its imports. The
//! third figure is the lower bound: reading the same bytes into a buffer that stays in the cache.
//! The two take turns, three times, and the best time of each counts. Processor time (of all
//! threads) depends less on other load. Our peak memory is that of this process, which also made
//! the frames, one at a time.

use camrig::camera::Camera;
use camrig::capture::{plan, take};
use camrig::captures::CaptureSet;
use camrig::measure::emva;
use camrig_benches::cost::{Time, memory, peak_bytes};
use camrig_benches::frames::read_all;
use std::path::Path;
use std::process::Command;

/// Ten light levels and a dark of two frames each, and a spatial pair of 39: 100 frames with one
/// exposure time.
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
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/peers/emva1288_peer.py");
    let python = std::env::var("EMVA1288_PYTHON").unwrap_or_else(|_| "python3".into());
    let (mut ours, mut floor) = (Time::most(), Time::most());
    let (mut peer, mut peer_bytes) = (Time::most(), None);
    // The first pass warms the page cache.
    read_all(&set);
    for _ in 0..3 {
        floor = floor.best(Time::of(|| read_all(&set)));
        ours = ours.best(Time::of(|| {
            let result = emva::measure(&CaptureSet::load(&set).expect("the set loads"));
            let figures = &result.expect("the set can be measured").channels[0].figures;
            assert!(figures.prnu_1288_percent.is_some());
        }));
        let output = Command::new(&python).arg(script).arg(&set).output();
        let output = output.ok().filter(|o| o.status.success());
        let text = output.map(|o| o.stdout).unwrap_or_default();
        let text = String::from_utf8_lossy(&text).into_owned();
        if let (Some(wall), Some(cpu)) = (number(&text, "seconds"), number(&text, "cpu_seconds")) {
            peer = peer.best(Time { wall, cpu });
            peer_bytes = number(&text, "peak_bytes");
        }
    }
    println!("EMVA 1288 analysis, 100 frames of 2048 x 1536 (wall, processor time):");
    println!("  reading   {floor}");
    println!("  camrig    {ours}, {} at most in memory", memory(peak_bytes()));
    if peer_bytes.is_some() {
        println!("  emva1288  {peer}, {} at most in memory", memory(peer_bytes));
        let (wall, cpu) = (peer.wall / ours.wall, peer.cpu / ours.cpu);
        println!("  camrig is {wall:.1} x as fast, with 1/{cpu:.1} of the processor time");
    } else {
        println!("  emva1288: SKIP, python3 has no emva1288 (pip install 'numpy<2' emva1288)");
    }
    // The folder stays only if the run is interrupted.
    let _ = std::fs::remove_dir_all(&folder);
}

fn frames(folder: &Path, set: &Path) {
    let camera = folder.join("camera.toml");
    std::fs::write(&camera, CAMERA).expect("write");
    let camera = Camera::load(camera.to_str().expect("utf-8")).expect("the camera loads");
    let shots = plan::parse(PLAN).expect("the plan is right");
    take::take(&camera, &shots, set, &take::TakeOptions::default(), || ()).expect("frames");
}

/// A number in the JSON of the peer script, which has one key per line.
fn number(text: &str, key: &str) -> Option<f64> {
    let line = text.lines().find(|l| l.trim_start().starts_with(&format!("\"{key}\"")))?;
    line.split_once(':')?.1.trim().trim_end_matches(',').parse().ok()
}
