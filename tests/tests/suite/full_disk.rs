//! Full and read-only disks: a message, exit status 2, whole files or none, and work that can be
//! resumed.

use super::{camrig_ok, small_camera};
use std::path::Path;
use std::process::{Command, Output};

const SWEEP: &str = r#"
format = "sweep/1"
files = "npy"

[grid]
camera = "c.toml"
scene = ["slanted-edge:angle=5", "uniform:0.4"]
lux = [30, 300]
exposure_s = [0.005, 0.02]
"#;

/// Runs a script with `camrig` as `$camrig` in a folder whose `disk` is a file system of its own
/// (mounted with `options`) that no other process sees. `None`, with a line that says so, where
/// the system does not allow that.
fn on_a_disk(folder: &Path, options: &str, script: &str) -> Option<Output> {
    let mount = format!("mkdir -p disk && mount -t tmpfs -o {options} tmpfs disk");
    let bash = |script: &str| {
        Command::new("unshare")
            .args(["-rm", "bash", "-c", script])
            .env("camrig", env!("CARGO_BIN_EXE_camrig-under-test"))
            .current_dir(folder)
            .output()
    };
    if !bash(&mount).is_ok_and(|o| o.status.success()) {
        println!("SKIP: no file system of its own for a test (unshare, tmpfs)");
        return None;
    }
    Some(bash(&format!("{mount}\n{script}")).unwrap())
}

fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("c.toml"), small_camera(64, 48, &[])).unwrap();
    std::fs::write(dir.path().join("sweep.toml"), SWEEP).unwrap();
    camrig_ok(dir.path(), "simulate --camera c.toml --scene ramp --exposure 1ms -o a.dng");
    camrig_ok(dir.path(), "capture --camera c.toml --plan ptc --frames 2 -o captures");
    camrig_ok(dir.path(), "scene export ramp -o cube --width 32");
    dir
}

/// Every kind of output, on a disk with room for a little of it and on one without any.
#[test]
fn every_command_says_so_and_leaves_no_half_file() {
    let dir = folder();
    let commands = [
        "simulate --camera c.toml --scene ramp --exposure 1ms -o disk/out.dng",
        "simulate --camera c.toml --scene ramp --exposure 1ms -o disk/out.tiff \
        --save-irradiance disk/e.irr",
        "simulate --camera c.toml --scene ramp --exposure 1ms --frames 9 -o disk/frames",
        "simulate --camera c.toml --scene ramp --exposure 1ms -o rest.npy \
        --report disk/page.html --force",
        "capture --camera c.toml --plan ptc -o disk/captures",
        "batch sweep.toml -o disk/set",
        "convert a.dng disk/out.npy",
        "scene export ramp -o disk/ramp",
        "scene add cube/ramp.hdr --library disk/library --name ramp",
        "measure ptc captures --report disk/page.html",
        "man -o disk/man",
    ];
    // A page of the disk holds 4 KiB; the part of a file written before the disk fills must not
    // remain.
    for (options, cause) in
        [("size=4k,nr_inodes=64", "No space left"), ("ro", "Read-only file system")]
    {
        for command in commands {
            let script = format!(
                "\"$camrig\" {command}; echo status $? >&2; find disk -type f -size -1k >&2; \
                find disk -name '.tmp*' >&2"
            );
            let Some(output) = on_a_disk(dir.path(), options, &script) else { return };
            let told = String::from_utf8_lossy(&output.stderr);
            let (words, left) = told.split_once("status ").expect("the status");
            assert_eq!(left.trim(), "2", "camrig {command} ({options}):\n{told}");
            assert!(words.contains(cause), "camrig {command} ({options}):\n{words}");
            assert!(!words.contains("panicked"), "{words}");
        }
    }
}

/// A data set whose disk fills up is resumed when there is room, and then equals one that had room
/// from the start.
#[test]
fn a_batch_goes_on_when_there_is_room() {
    let dir = folder();
    camrig_ok(dir.path(), "batch sweep.toml -o whole");
    let script = "\"$camrig\" batch sweep.toml -o disk/set; echo status $? >&2
        find disk -name '*.npy' | grep -q . || echo nothing was done >&2
        mount -o remount,size=1m,nr_inodes=1000 disk
        \"$camrig\" batch sweep.toml -o disk/set 2>/dev/null; echo then $? >&2
        diff -r whole disk/set >&2 && echo same >&2";
    let Some(output) = on_a_disk(dir.path(), "size=32k,nr_inodes=100", script) else { return };
    let told = String::from_utf8_lossy(&output.stderr);
    for part in ["No space left", "status 2", "then 0", "same"] {
        assert!(told.contains(part), "should say {part:?}:\n{told}");
    }
    assert!(!told.contains("nothing was done") && !told.contains("panicked"), "{told}");
}
