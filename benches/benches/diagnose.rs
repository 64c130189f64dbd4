//! A diagnosis of 400 frames of 512 x 384: time, processor time and memory, compared with reading
//! the frames and with simulating the replicates of the model, which any diagnosis needs.
//!
//! `cargo bench -p camrig-benches --bench diagnose`. The set is the built-in plan `diagnosis` with
//! two and a half times its frames, taken with a sensor that has row noise, column offsets and
//! slight charge coupling, which the model lacks. No other program does this, so there is no peer;
//! the goal is 60 s on two cores. Peak memory is that of this process, which never holds the whole
//! set.

use camrig::camera::Camera;
use camrig::capture::{plan, take};
use camrig::captures::CaptureSet;
use camrig::clean::Cleaned;
use camrig::diagnose::data::design;
use camrig::diagnose::measured::{Keep, Measured};
use camrig::diagnose::model::replicate;
use camrig::diagnose::{Options, diagnose};
use camrig_benches::cost::{Time, memory, peak_bytes};
use camrig_benches::frames::read_all;
use std::path::Path;

const CAMERA: &str = r#"
[lens]
kind = "diffraction-limited"
f_number = 2.8
focal_length_mm = 4.9
[sensor]
width = 512
height = 384
pitch_um = 3.0
fill_factor = 1.0
cfa = "mono"
qe = 0.6
conversion_gain_uv_per_e = 75.0
full_well_e = 7500
bits = 12
black_level_dn = 64
[sensor.noise]
read_e = 3.0
dark_current_e_per_s = 4.0
dsnu_e_per_s = 1.2
prnu = 0.008
"#;

const HIDDEN: &str = r#"
[[effect]]
kind = "row-temporal-noise"
sigma_e = 0.3
[[effect]]
kind = "column-offset-fpn"
sigma_e = 0.3
[[effect]]
kind = "charge-coupling"
side = 0.004
vertical = 0.004
"#;

fn main() {
    let name = format!("camrig-bench-diagnose-{}", std::process::id());
    let folder = std::env::temp_dir().join(name);
    std::fs::create_dir_all(&folder).expect("a folder for 160 MB of frames");
    let set = folder.join("set");
    let load = |name: &str, text: &str| {
        let file = folder.join(name);
        std::fs::write(&file, text).expect("write");
        Camera::load(file.to_str().expect("utf-8")).expect("the camera loads")
    };
    let model = load("model.toml", CAMERA);
    frames(&load("sensor.toml", &format!("{CAMERA}{HIDDEN}")), &set);
    read_all(&set);
    let reading = Time::of(|| read_all(&set));
    let captures = CaptureSet::load(&set).expect("the set loads");
    let counts: Vec<usize> =
        captures.captures.iter().map(|c| captures.count(c).expect("frames")).collect();
    let halves = || design::divide(&model, &captures, &counts).expect("halves");
    let design = halves().fit;
    let replicate = Time::of(|| {
        drop(replicate::simulate(&model, &design, 1, false).expect("a replicate"));
    });
    let measuring = Time::of(|| {
        let cleaned = Cleaned::new(captures.clone(), &Default::default()).expect("a clean set");
        let keep = Keep::Moments;
        drop(Measured::new(&model, &cleaned, halves(), keep, &|_| ()).expect("a measurement"));
    });
    let mut report = None;
    let whole = Time::of(|| {
        let found = diagnose(&model, captures.clone(), &Options::default());
        report = Some(found.expect("a diagnosis").report);
    });
    let report = report.expect("a report");
    let names: Vec<&str> = report.steps.iter().map(|s| &*s.effect).collect();
    println!(
        "Diagnosis of {} frames of 512 x 384 (wall, processor time):",
        counts.iter().sum::<usize>()
    );
    println!("  reading all frames      {reading}");
    println!("  reading and measuring   {measuring}");
    println!("  one replicate, a half   {replicate}");
    println!("  camrig diagnose         {whole}, {} at most in memory", memory(peak_bytes()));
    println!("  {}: {}", report.verdict.word(), names.join(", "));
    println!(
        "  {:.0} replicates' time; {:.2} of the goal of 60 s",
        whole.cpu / replicate.cpu,
        whole.wall / 60.0
    );
    // The folder stays only if the run is interrupted.
    let _ = std::fs::remove_dir_all(&folder);
}

/// The built-in plan with two and a half times its frames.
fn frames(camera: &Camera, set: &Path) {
    let mut shots = plan::load("diagnosis").expect("a built-in plan");
    shots.iter_mut().for_each(|s| s.frames = s.frames * 5 / 2);
    take::take(camera, &shots, set, &take::TakeOptions::default(), || ()).expect("frames");
}
