//! Frames of a scene from another program: `camrig-frames/1` from `docs/frames.py`.

use super::pictures::radiance_picture;
use super::{camrig_ok, small_camera};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const ARGUMENTS: &str = "simulate --camera c.toml --exposure 4ms --fps 50 -o - --to SGRBG10";

/// The producer's three frames as pictures: a grey of 0.25, 0.5 and 1.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("c.toml"), small_camera(64, 48, &[])).unwrap();
    std::fs::create_dir(dir.path().join("seq")).unwrap();
    for (number, exponent) in [127, 128, 129].into_iter().enumerate() {
        let path = dir.path().join(format!("seq/{number}.hdr"));
        radiance_picture(&path, [128, 128, 128, exponent]);
    }
    dir
}

fn start(dir: &Path, scene: &str, stdin: Stdio) -> Child {
    Command::new(env!("CARGO_BIN_EXE_camrig-under-test"))
        .args(ARGUMENTS.split_whitespace())
        .args(["--stall", "20", "--scene", scene])
        .current_dir(dir)
        .stdin(stdin)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn producer() -> Option<(PathBuf, PathBuf)> {
    let python = camrig_tests::client("python3")?;
    Some((python, Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/frames.py")))
}

/// Runs the producer until camrig listens to it.
fn produce(python: &Path, script: &Path, address: &str) {
    let end = Instant::now() + Duration::from_secs(60);
    loop {
        let sent = Command::new(python).arg(script).arg(address).stderr(Stdio::null()).status();
        if sent.unwrap().success() {
            return;
        }
        assert!(Instant::now() < end, "nobody listens at {address}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn frames_of_a_stream_are_those_of_files_byte_for_byte() {
    let Some((python, script)) = producer() else { return };
    let dir = folder();
    let dir = dir.path();
    let files = "--scene-rate 25 --scene seq:scale=100,primaries=linear-srgb";
    let of_files = camrig_ok(dir, &format!("{ARGUMENTS} {files}")).stdout;
    assert_eq!(of_files.len(), 6 * 2 * 64 * 48);
    let pipe = Command::new(&python).arg(&script).arg("-").stdout(Stdio::piped()).spawn();
    let mut pipe = pipe.unwrap();
    let stdout = pipe.stdout.take().unwrap();
    let of_pipe = start(dir, "-", stdout.into()).wait_with_output().unwrap();
    assert!(of_pipe.status.success() && pipe.wait().unwrap().success(), "{}", stderr(&of_pipe));
    assert!(of_pipe.stdout == of_files, "{}", stderr(&of_pipe));
    let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let mut addresses = vec![format!("tcp://{free}")];
    if cfg!(unix) {
        addresses.push(format!("unix:{}", dir.join("socket").display()));
    }
    for address in addresses {
        let child = start(dir, &address, Stdio::null());
        produce(&python, &script, &address);
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success(), "{address}: {}", stderr(&output));
        assert!(output.stdout == of_files, "{address}");
    }
    assert!(!dir.join("socket").exists());
}

#[test]
fn a_producer_that_dies_or_lies_is_said_and_its_whole_frames_stay() {
    let Some((python, script)) = producer() else { return };
    let dir = folder();
    let dir = dir.path();
    let whole = camrig_tests::run(&python, &[&script, &"-"]);
    // Header and 8 x 6 pixels of three floats.
    let message = 256 + 12 * 48;
    assert_eq!(whole.len(), 3 * message + 256);
    let mut lie = whole[..message + 256].to_vec();
    lie[message + 41] = 9;
    for (bytes, frames, words) in [
        (&whole[..2 * message], 2, "without the message that ends it"),
        (&whole[..2 * message - 1], 0, "frame 1 of standard input"),
        (&lie[..], 0, "checksum is wrong"),
    ] {
        let path = dir.join("stream");
        std::fs::write(&path, bytes).unwrap();
        let file = std::fs::File::open(&path).unwrap();
        let output = start(dir, "-", file.into()).wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains(words), "{}", stderr(&output));
        assert_eq!(output.stdout.len() % (2 * 64 * 48), 0);
        assert!(output.stdout.len() >= frames * 2 * 64 * 48, "{words}");
    }
    let far = start(dir, "tcp://192.0.2.1:7500", Stdio::null()).wait_with_output().unwrap();
    assert!(stderr(&far).contains("no port of this machine"), "{}", stderr(&far));
}

/// What Mitsuba renders, as pictures and as bands, gives the same frames from files and through the
/// stream.
#[test]
fn an_animation_of_mitsuba_is_the_same_from_files_and_through_the_stream() {
    let Some(python) = camrig_tests::client("mitsuba") else { return };
    let suite = Path::new(env!("CARGO_MANIFEST_DIR"));
    let renderer = suite.join("tests/suite/mitsuba_frames.py");
    let producer = suite.join("../docs/frames.py");
    let dir = folder();
    let dir = dir.path();
    for (kind, options) in [
        ("rgb", "as=radiance,scale=100,primaries=linear-srgb"),
        ("spectral", "quantity=radiance,scale=0.1"),
    ] {
        std::fs::create_dir(dir.join(kind)).unwrap();
        let arguments: [&dyn AsRef<std::ffi::OsStr>; 4] =
            [&renderer, &dir.join(kind), &kind, &producer];
        std::fs::write(dir.join("stream"), camrig_tests::run(&python, &arguments)).unwrap();
        let stream = std::fs::File::open(dir.join("stream")).unwrap();
        let of_stream = start(dir, "-", stream.into()).wait_with_output().unwrap();
        assert!(of_stream.status.success(), "{kind}: {}", stderr(&of_stream));
        let files = format!("--scene-rate 25 --scene {kind}:{options}");
        let of_files = camrig_ok(dir, &format!("{ARGUMENTS} {files}")).stdout;
        assert_eq!(of_files.len(), 6 * 2 * 64 * 48, "{kind}");
        assert!(of_stream.stdout == of_files, "{kind}: {}", stderr(&of_stream));
    }
}
