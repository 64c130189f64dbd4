//! Bad input ends with exit status 2, a message that says what is wrong, where, and what would be
//! right, and no output.

use super::{camrig, camrig_ok, small_camera};
use std::path::Path;

/// Runs a command that must fail with status 2, and checks its message.
pub fn refuses(dir: &Path, arguments: &str, says: &[&str]) {
    let output = camrig(dir, arguments);
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "camrig {arguments}\n{told}");
    for expected in says {
        assert!(told.contains(expected), "camrig {arguments}\nshould say {expected:?}:\n{told}");
    }
    assert!(!told.contains("panicked"), "{told}");
    assert!(!dir.join("out.npy").exists() && !dir.join("out.dng").exists(), "half-written output");
    let left = std::fs::read_dir(dir)
        .unwrap()
        .filter(|e| e.as_ref().unwrap().file_name().to_string_lossy().starts_with(".tmp"));
    assert_eq!(left.count(), 0, "camrig {arguments} leaves temporary files");
}

fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("c.toml"), small_camera(64, 48, &[])).unwrap();
    dir
}

const GOOD: &str = "simulate --camera c.toml --scene uniform:0.5 -o out.npy --exposure";

#[test]
fn wrong_arguments_are_refused() {
    let dir = folder();
    let refuses = |arguments: &str, says: &[&str]| refuses(dir.path(), arguments, says);
    refuses(&format!("{GOOD} 0ms"), &["above zero", "20ms"]);
    refuses(&format!("{GOOD} 20"), &["not a duration", "20ms"]);
    refuses(&format!("{GOOD} -20ms"), &["\"-20ms\"", "above zero"]);
    refuses(&format!("{GOOD} 20ms --lux -1"), &["lux"]);
    refuses(&format!("{GOOD} 20ms --illuminant D66x"), &["D66x"]);
    refuses(&format!("{GOOD} 20ms --gain nan"), &["above zero"]);
    refuses(
        "simulate --camera c.toml --scene colorcheker --exposure 1ms -o out.npy",
        &["colorcheker", "colorchecker"],
    );
    refuses("simulate --camera mt9t01 --scene ramp --exposure 1ms -o out.npy", &["mt9t012"]);
    refuses("simulate --camera no.toml --scene ramp --exposure 1ms -o out.npy", &["no.toml"]);
    refuses("simulate --camera c.toml --scene ramp --exposure 1ms -o out.xyz", &["xyz"]);
    refuses("simulate --camera c.toml --scene ramp --exposure 1ms -o no/out.npy", &["no"]);
    refuses(
        "simulate --camera c.toml --scene ramp --exposure 1ms --frames 2 -o out.dng",
        &["directory"],
    );
}

/// Ctrl-C, a scheduler's SIGTERM and a lost terminal leave nothing of a directory half written.
#[cfg(unix)]
#[test]
fn signals_leave_nothing_behind() {
    use std::process::{Command, Stdio};
    for signal in ["INT", "TERM", "HUP"] {
        let dir = tempfile::tempdir().unwrap();
        let names = || std::fs::read_dir(dir.path()).unwrap().count();
        let mut child = Command::new(env!("CARGO_BIN_EXE_camrig-under-test"))
            .args("capture --camera mt9t012 --plan emva --size 1024,768 -o set".split(' '))
            .current_dir(dir.path())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        while names() == 0 {
            assert!(child.try_wait().unwrap().is_none(), "it ended before it wrote anything");
            std::thread::yield_now();
        }
        let kill = Command::new("kill").args(["-s", signal, &child.id().to_string()]).status();
        assert!(kill.unwrap().success());
        let status = child.wait().unwrap();
        assert_eq!(status.code(), None, "SIG{signal} ends it as a signal does: {status}");
        assert_eq!(names(), 0, "SIG{signal} leaves something behind");
    }
}

/// A standard output that is closed or full ends a command with a message and status 2, not with a
/// panic.
#[cfg(target_os = "linux")]
#[test]
fn closed_or_full_standard_output_ends_with_a_message() {
    let dir = folder();
    let commands = [
        "presets",
        "presets mt9t012",
        "--help",
        "simulate --camera c.toml --scene ramp --exposure 1ms -o a.npy --json --force",
        "simulate --camera c.toml --scene ramp --exposure 1ms -o - --to npy",
        "simulate --camera c.toml --scene ramp --exposure 1ms -o - --to SGRBG10 --frames 2",
        "convert a.npy - --to npy",
        "lens --help",
        "scene info ramp",
    ];
    for command in commands {
        let run = |stdout: std::process::Stdio| {
            let program = env!("CARGO_BIN_EXE_camrig-under-test");
            let output = std::process::Command::new(program)
                .args(command.split_whitespace())
                .current_dir(dir.path())
                .stdout(stdout)
                .output()
                .unwrap();
            let told = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(!told.contains("panicked"), "camrig {command}: {told}");
            (output.status.code(), told)
        };
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let closed = run(writer.into());
        let full = run(std::fs::File::create("/dev/full").unwrap().into());
        if command.ends_with("--help") {
            continue; // help that nobody reads is no failure
        }
        let (status, told) = full;
        assert_eq!(status, Some(2), "camrig {command}: {told}");
        assert!(told.contains("No space left"), "camrig {command}: {told}");
        // Ended by SIGPIPE, as by a reader that has enough, without a word.
        let (status, told) = closed;
        assert_eq!((status, told.contains("error")), (None, false), "camrig {command}: {told}");
    }
}

#[test]
fn faulty_camera_files_are_refused() {
    let dir = folder();
    let good = small_camera(64, 48, &[]);
    for (from, to, says) in [
        ("pitch_um", "pitch_mm", ["pitch_mm", "pitch_um"]),
        ("exposure", "exposure", ["", ""]),
        ("full_well_e = 6500", "full_well_e = -5", ["full_well_e", "line"]),
        ("full_well_e = 6500", "full_well_e = \"many\"", ["line", "many"]),
        ("qe = 0.5", "qe = 1.5", ["qe", "0 to 1"]),
        ("qe = 0.5", "qe = \"qe.csv\"", ["qe.csv", "read"]),
    ] {
        if from == to {
            continue;
        }
        assert!(good.contains(from), "{from}");
        std::fs::write(dir.path().join("bad.toml"), good.replace(from, to)).unwrap();
        let command = "simulate --camera bad.toml --scene ramp --exposure 1ms -o out.npy";
        refuses(dir.path(), command, &says);
    }
}

#[test]
fn faulty_quantum_efficiency_files_are_refused() {
    let dir = folder();
    let camera = small_camera(64, 48, &[("qe", "\"qe.csv\"")]);
    std::fs::write(dir.path().join("c.toml"), camera).unwrap();
    let table = |values: &dyn Fn(u32) -> Option<f64>| {
        let mut text = "wavelength_nm,r,g,b\n".to_string();
        for nm in (400..=700).step_by(10) {
            if let Some(v) = values(nm) {
                text.push_str(&format!("{nm},{v},{v},{v}\n"));
            }
        }
        text
    };
    for (text, says) in [
        (table(&|nm| if nm > 500 && nm < 550 { None } else { Some(0.5) }), ["500", "550"]),
        (table(&|nm| Some(if nm == 600 { 1.2 } else { 0.5 })), ["1.2", "600"]),
        (table(&|nm| if nm > 650 { None } else { Some(0.5) }), ["650", "400 to 700"]),
        ("wavelength_nm,x,y\n400,0.1,0.1\n700,0.1,0.1\n".to_string(), ["700", "qe.csv"]),
        ("nonsense".to_string(), ["qe.csv", "header"]),
    ] {
        std::fs::write(dir.path().join("qe.csv"), text).unwrap();
        refuses(dir.path(), &format!("{GOOD} 20ms"), &says);
    }
}

#[test]
fn faulty_scene_files_are_refused() {
    use std::io::Write;
    let dir = folder();
    let command = "simulate --camera c.toml --scene s.npy --exposure 1ms -o out.npy";
    let write = |values: &[f32], bands: usize| {
        let mut header =
            format!("{{'descr': '<f4', 'fortran_order': False, 'shape': (2, 2, {bands}), }}");
        while (header.len() + 11) % 64 != 0 {
            header.push(' ');
        }
        let mut file = std::fs::File::create(dir.path().join("s.npy")).unwrap();
        file.write_all(b"\x93NUMPY\x01\x00").unwrap();
        file.write_all(&(header.len() as u16 + 1).to_le_bytes()).unwrap();
        file.write_all(header.as_bytes()).unwrap();
        file.write_all(b"\n").unwrap();
        for v in values {
            file.write_all(&v.to_le_bytes()).unwrap();
        }
    };
    let side = "quantity = \"reflectance\"\nstart_nm = 400.0\nstep_nm = 10.0\n";
    std::fs::write(dir.path().join("s.toml"), side).unwrap();
    let mut values = vec![0.5f32; 4 * 31];
    write(&values[..100], 31);
    refuses(dir.path(), command, &["s.npy"]);
    values[40] = f32::NAN;
    write(&values, 31);
    refuses(dir.path(), command, &["s.npy"]);
    values[40] = -0.25;
    write(&values, 31);
    refuses(dir.path(), command, &["s.npy", "-0.25"]);
}

#[test]
fn faulty_irradiance_files_are_refused() {
    let dir = folder();
    camrig_ok(
        dir.path(),
        "simulate --camera c.toml --scene ramp --exposure 1ms -o first.npy \
        --save-irradiance a.irr",
    );
    let whole = std::fs::read(dir.path().join("a.irr")).unwrap();
    let command = "expose --camera c.toml --irradiance a.irr --exposure 1ms -o out.npy";
    for (bytes, says) in [
        (&whole[..whole.len() - 1], "truncated"),
        (&whole[..40], "header"),
        (&whole[..5], "too short"),
        (&b"something else entirely"[..], "CAMRIGIR"),
    ] {
        std::fs::write(dir.path().join("a.irr"), bytes).unwrap();
        refuses(dir.path(), command, &[says, "a.irr"]);
    }
    std::fs::write(dir.path().join("a.irr"), &whole).unwrap();
    std::fs::write(dir.path().join("c.toml"), small_camera(32, 48, &[])).unwrap();
    refuses(dir.path(), command, &["sensor.width: 64, of the camera 32"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_reported_and_nothing_is_written() {
    let dir = folder();
    let output = camrig(
        dir.path(),
        "simulate --camera c.toml --scene ramp --exposure 1ms --save-irradiance /dev/full \
        -o out.npy",
    );
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(told.contains("/dev/full") && told.contains("space"), "{told}");
    assert!(!dir.path().join("out.npy").exists());
}
