//! Frames that go out as they come: from a rig and from `simulate`, in every format of streams,
//! and what stays when a stream is interrupted.

use super::bad_input::refuses;
use super::{camrig, camrig_ok, small_camera};
use camrig::formats::{self, csi2};
use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const RIG: &str = "rig stream emulator: --camera c.toml --exposure 8ms";

fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("c.toml"), small_camera(64, 48, &[])).unwrap();
    dir
}

fn start(dir: &Path, arguments: &str) -> Child {
    Command::new(env!("CARGO_BIN_EXE_camrig-under-test"))
        .args(arguments.split_whitespace())
        .current_dir(dir)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Waits for something that a child does.
fn until(child: &mut Child, wanted: impl Fn() -> bool) {
    let end = Instant::now() + Duration::from_secs(60);
    while !wanted() {
        assert!(child.try_wait().unwrap().is_none(), "it ended first");
        assert!(Instant::now() < end, "not in a minute");
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn said(child: Child) -> (Option<i32>, String) {
    let output = child.wait_with_output().unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

fn words(bytes: &[u8]) -> Vec<u16> {
    bytes.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect()
}

#[test]
fn every_stream_format_has_the_frames_of_this_process() {
    let dir = folder();
    let light = "--scene ramp --frames 3";
    let rig = |to: &str| camrig_ok(dir.path(), &format!("{RIG} {light} -o - --to {to}")).stdout;
    let here = "simulate --camera c.toml --exposure 8ms";
    let own = camrig_ok(dir.path(), &format!("{here} {light} -o - --to SGRBG10")).stdout;
    assert_eq!(own.len(), 3 * 64 * 48 * 2);
    let dn = words(&own);
    assert_eq!(rig("SGRBG10"), own);
    // Full scale: shifted left by 16 - 10, right by 10 - 8.
    assert!(words(&rig("SGRBG16")).iter().zip(&dn).all(|(full, dn)| *full == dn << 6));
    assert!(rig("SGRBG8").iter().zip(&dn).all(|(byte, dn)| u16::from(*byte) == dn >> 2));
    for to in ["SGRBG16", "SGRBG8", "SGRBG10P", "pgm"] {
        let here = camrig_ok(dir.path(), &format!("{here} {light} -o - --to {to}"));
        assert_eq!(rig(to), here.stdout, "{to}");
        let told = String::from_utf8_lossy(&here.stderr).into_owned();
        assert_eq!(told.contains("at full scale"), to == "SGRBG16" || to == "SGRBG8", "{told}");
    }
    // On standard output packets unless asked otherwise.
    let packets = camrig_ok(dir.path(), &format!("{RIG} {light} -o -")).stdout;
    let planes = csi2::decode::<u16>(&packets).unwrap().planes;
    assert!(planes.iter().map(|p| &p.data[..]).eq(dn.chunks(64 * 48)));
}

#[test]
fn names_and_formats_that_mislead_are_refused() {
    let dir = folder();
    let refuses = |more: &str, says: &[&str]| {
        refuses(dir.path(), &format!("{RIG} --scene ramp --frames 2 {more}"), says);
    };
    refuses("-o out.dng", &["a stream of frames as dng", ".csi2"]);
    refuses("-o x.dng --to csi2", &["csi2 under a name of dng"]);
    refuses("-o x", &["no raw format"]);
    refuses("-o - --json", &["--json"]);
    // A mosaic is no grey picture.
    refuses("-o x.y4m", &["colour filters (GRBG)"]);
    refuses("-o - --to SRGGB8", &["GRBG"]);
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "no empty files");
}

#[cfg(unix)]
#[test]
fn a_file_grows_frame_by_frame_and_a_signal_leaves_whole_ones() {
    for (signal, name) in [("INT", "x.csi2"), ("TERM", "x_64x48_SGRBG10P.raw"), ("INT", "x.mcap")]
    {
        let dir = folder();
        let path = dir.path().join(name);
        // At most a minute, where whoever started this has signals ignored.
        let mut child = start(
            dir.path(),
            &format!("{RIG} --scene ramp --frames 3000 --fps 50 --collapse -o {name}"),
        );
        let bytes = || std::fs::metadata(&path).map_or(0, |m| m.len());
        // More than three frames, and what comes before the first in a recording.
        until(&mut child, || bytes() > 30_000);
        let kill = Command::new("kill").args(["-s", signal, &child.id().to_string()]).status();
        assert!(kill.unwrap().success());
        let (status, told) = said(child);
        assert_eq!(status, None, "ended by the signal: {told}");
        let frames = formats::read(&path).unwrap().planes.len();
        assert!(frames >= 3 && told.contains(&format!("interrupted: {frames} whole")), "{told}");
    }
}

#[test]
fn a_reader_that_leaves_ends_a_stream_with_words() {
    for command in [
        format!("{RIG} --scene ramp --frames 100000 --collapse -o -"),
        "simulate --camera c.toml --exposure 1ms --scene ramp --frames 100000 -o - --to SGRBG16"
            .into(),
    ] {
        let dir = folder();
        let mut child = start(dir.path(), &command);
        let mut reader = child.stdout.take().unwrap();
        reader.read_exact(&mut [0; 20_000]).unwrap();
        drop(reader);
        // As other programs in a pipe: ended by the pipe's signal, without an error.
        let (status, told) = said(child);
        assert_eq!(status, None, "{told}");
        assert!(!told.contains("error"), "{told}");
    }
}

#[cfg(unix)]
#[test]
fn a_named_pipe_has_frames_while_the_stream_runs() {
    let dir = folder();
    let pipe = dir.path().join("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let mut child =
        start(dir.path(), &format!("{RIG} --scene ramp --frames 100000 -o pipe --to SGRBG10"));
    let mut frames = vec![0; 5 * 64 * 48 * 2];
    std::fs::File::open(&pipe).unwrap().read_exact(&mut frames).unwrap();
    assert!(child.try_wait().unwrap().is_none(), "it goes on");
    child.kill().unwrap();
    child.wait().unwrap();
    let here = camrig_ok(
        dir.path(),
        "simulate --camera c.toml --exposure 8ms --scene ramp --frames 5 -o - --to SGRBG10",
    );
    assert_eq!(frames, here.stdout);
}

#[test]
fn a_moving_scene_and_changing_light_stream_as_they_are_simulated() {
    let dir = folder();
    let moving = "--scene checkerboard --motion 3,-1 --rolling 0.5 --frames 3 -o - --to SGRBG10";
    let rig = camrig_ok(dir.path(), &format!("{RIG} {moving}")).stdout;
    let here = format!("simulate --camera c.toml --exposure 8ms {moving}");
    assert!(rig == camrig_ok(dir.path(), &here).stdout);
    assert!(rig[..64 * 48 * 2] != rig[64 * 48 * 2..2 * 64 * 48 * 2]);

    // 200 lx, then 50: a quarter of the signal above black. The radiometry is linear; the scatter
    // of the mean of 3072 pixels is below 0.01 of it.
    for (name, lux) in [("light/a2.irr", 200), ("light/a10.irr", 50)] {
        std::fs::create_dir_all(dir.path().join("light")).unwrap();
        camrig_ok(
            dir.path(),
            &format!(
                "simulate --camera c.toml --scene uniform:0.4 --lux {lux} --exposure 8ms \
                 -o x.npy --force --save-irradiance {name}"
            ),
        );
    }
    std::fs::write(dir.path().join("light/notes.txt"), "taken on Tuesday").unwrap();
    let stream =
        camrig_ok(dir.path(), &format!("{RIG} --irradiance light --frames 2 -o - --to SGRBG10"));
    let dn = words(&stream.stdout);
    let signal = |frame: &[u16]| {
        frame.iter().map(|&v| f64::from(v)).sum::<f64>() / frame.len() as f64 - 42.0
    };
    let ratio = signal(&dn[64 * 48..]) / signal(&dn[..64 * 48]);
    assert!((ratio - 0.25).abs() < 0.02, "{ratio}");
    let told = String::from_utf8_lossy(&stream.stderr).into_owned();
    assert!(told.contains("skipped") && told.contains("notes.txt"), "{told}");

    // An effect that remembers the frame before knows only light that stands still.
    let lag = small_camera(64, 48, &[]) + "[[effect]]\nkind = \"image-lag\"\nfraction = 0.02\n";
    std::fs::write(dir.path().join("lag.toml"), lag).unwrap();
    let refused = camrig(
        dir.path(),
        "rig stream emulator: --camera lag.toml --exposure 8ms --scene ramp --motion 1,0",
    );
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("image-lag"));
}

/// The figures of a stream, by the names that outside scripts use.
#[test]
fn figures_of_a_stream_have_their_names() {
    let dir = folder();
    let told =
        camrig_ok(dir.path(), &format!("{RIG} --scene ramp --frames 4 --fps 20 --json -o x.csi2"));
    let told: serde_json::Value = serde_json::from_slice(&told.stdout).unwrap();
    assert_eq!((told["frames"].as_u64(), told["frames_dropped"].as_u64()), (Some(4), Some(0)));
    assert!(told["frames_late"].is_u64() && told["rate_hz"].is_f64(), "{told}");
    assert_eq!(told["settings_missed"], 0, "{told}");
    assert!(["p50", "p99", "max"].iter().all(|p| told["latency_us"][p].is_f64()), "{told}");
    let frames = told["settings"].as_array().unwrap();
    assert!(frames.len() == 4 && frames.iter().all(|f| f["late_us"].is_f64()), "{told}");
}

/// Without `--fps`, frames of a sensor with timing follow one another as it reads them: 500 lines of
/// 20 µs, or, where the exposure is longer, its lines.
#[test]
fn a_video_has_the_rate_of_the_sensor() {
    let dir = folder();
    let camera = small_camera(64, 48, &[("cfa", "\"mono\"")]);
    let timing = "\n[sensor.timing]\nline_time_us = 20\nframe_length_lines = 500\n";
    std::fs::write(dir.path().join("t.toml"), camera + timing).unwrap();
    for (exposure, more, rate) in [
        ("5ms", "", "F100000:1000 "),
        ("40ms", "", "F25000:1000 "),
        ("5ms", "--fps 30", "F30:1 "),
        ("5ms", "--bracket 0,3", "F0:0 "),
    ] {
        camrig_ok(
            dir.path(),
            &format!(
                "simulate --camera t.toml --scene uniform:0.2 --exposure {exposure} --frames 2 \
                 {more} -o v.y4m --force"
            ),
        );
        let video = std::fs::read(dir.path().join("v.y4m")).unwrap();
        let head = String::from_utf8_lossy(&video[..60]).into_owned();
        assert!(head.contains(rate), "{exposure} {more}: {head}");
    }
}

/// Both readers find the frames of this process, when they began and the camera's figures.
#[test]
fn recordings_are_read_by_two_readers_of_ros() {
    let Some(python) = camrig_tests::client("rosbags") else { return };
    let dir = folder();
    let lens = "\n[[effect]]\nkind = \"distortion\"\nk1 = -0.05\n";
    let camera = small_camera(64, 48, &[]) + lens;
    std::fs::write(dir.path().join("c.toml"), camera).unwrap();
    let light = "--scene ramp --frames 3";
    camrig_ok(dir.path(), &format!("{RIG} {light} --fps 20 -o a.mcap --json"));
    let here = format!("simulate --camera c.toml --exposure 8ms {light} -o - --to SGRBG10");
    let own = camrig_ok(dir.path(), &here).stdout;
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/peers/ros_recording.py");
    let found = camrig_tests::run(&python, &[&script, &dir.path().join("a.mcap")]);
    let found: serde_json::Value = serde_json::from_slice(&found).unwrap();
    for reader in ["mcap-ros2-support", "rosbags"] {
        let messages = found[reader].as_array().unwrap();
        assert_eq!(messages.len(), 6, "{reader}: an image and its CameraInfo, three times");
        for (i, pair) in messages.chunks(2).enumerate() {
            let of = |topic: &str| pair.iter().find(|m| m["topic"] == topic).unwrap();
            let (image, info) = (of("/camera/image_raw"), of("/camera/camera_info"));
            for message in [image, info] {
                assert_eq!(message["stamp_ns"], i as u64 * 50_000_000, "{reader}");
                assert_eq!(message["header_ns"], message["stamp_ns"], "{reader}");
                assert_eq!(message["size"], serde_json::json!([64, 48]), "{reader}");
            }
            assert_eq!(image["encoding"], "bayer_grbg16");
            let frame = &own[i * 64 * 48 * 2..][..64 * 48 * 2];
            let hex: String = frame.iter().map(|byte| format!("{byte:02x}")).collect();
            assert!(image["data"] == hex.as_str(), "{reader}");
            // The axis is at the centre: between the two middle pixels.
            assert_eq!(info["k"][2], 31.5);
            assert_eq!(info["k"][5], 23.5);
            assert!(info["d"][0].as_f64().unwrap() < 0.0, "barrel: {info}");
        }
    }
    // And it comes back as it went out.
    camrig_ok(dir.path(), "convert a.mcap back_64x48_SGRBG10.raw");
    assert_eq!(std::fs::read(dir.path().join("back_64x48_SGRBG10.raw")).unwrap(), own);
}

/// The protocol's reference implementation finds the frames of this process, and would have written
/// the same bytes.
#[test]
fn frames_on_a_display_link_are_those_of_the_reference() {
    let Some(python) = camrig_tests::client("bayerlink") else { return };
    let dir = folder();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/peers/bayerlink_frames.py");
    for (bits, cfa, code, own) in [
        (8, "BGGR", "BA81", "SBGGR8"),
        (10, "GRBG", "pgAA", "SGRBG10"),
        (12, "RGGB", "pRCC", "SRGGB12"),
        (12, "mono", "Y12P", "Y12"),
        (14, "GBRG", "pGEE", "SGBRG14"),
        (16, "mono", "Y16 ", "Y16"),
    ] {
        let keys = [("bits", format!("{bits}")), ("cfa", format!("\"{cfa}\""))];
        let keys = keys.each_ref().map(|(key, value)| (*key, value.as_str()));
        std::fs::write(dir.path().join("b.toml"), small_camera(64, 48, &keys)).unwrap();
        let light = "--camera b.toml --exposure 8ms --scene ramp --frames 2";
        let to = "-o frames --to bayerlink:128x50";
        camrig_ok(dir.path(), &format!("rig stream emulator: {light} {to}"));
        let found =
            camrig_tests::run(&python, &[&script, &dir.path().join("frames"), &"128", &"50"]);
        let found: Vec<serde_json::Value> = serde_json::from_slice(&found).unwrap();
        let here = camrig_ok(dir.path(), &format!("simulate {light} -o - --to {own}")).stdout;
        let own: Vec<u16> = match bits {
            8 => here.iter().map(|&dn| dn.into()).collect(),
            _ => words(&here),
        };
        for (i, (frame, own)) in found.iter().zip(own.chunks(64 * 48)).enumerate() {
            assert_eq!((&frame["fourcc"], &frame["frame_seq"]), (&code.into(), &i.into()));
            assert_eq!(frame["samples"], serde_json::json!(own), "{cfa} {bits}");
            assert_eq!(frame["equal"], true, "{cfa} {bits}");
        }
        assert_eq!(found.len(), 2);
        std::fs::remove_file(dir.path().join("frames")).unwrap();
    }
    refuses(
        dir.path(),
        &format!("{RIG} --scene ramp -o x --to bayerlink:16x9"),
        &["10 bits", "bayerlink:WIDTHxHEIGHT"],
    );
}

/// Two cameras on one trigger: each one's frames are those of this process, and 1 ms between them,
/// with a jitter of 20 µs in each, comes back from the stamps of 60 frames within 10 µs (the mean
/// is known to 3.7 µs).
#[test]
fn cameras_on_one_trigger_are_recorded_together() {
    let Some(python) = camrig_tests::client("rosbags") else { return };
    let dir = folder();
    let camera = |name: &str, more: &str, seed: u32| {
        format!(
            "[[camera]]\nname = \"{name}\"\njitter_s = 20e-6\n{more}\noptions = [\"--camera\", \
             \"c.toml\", \"--scene\", \"ramp\", \"--exposure\", \"8ms\", \"--seed\", \"{seed}\"]\n"
        )
    };
    let both = camera("left", "", 1) + &camera("right", "offset_s = 0.001", 2);
    let file = format!("format = \"rig-cameras/1\"\nfps = 50\nframes = 60\n{both}");
    std::fs::write(dir.path().join("both.toml"), &file).unwrap();
    camrig_ok(dir.path(), "rig record both.toml -o both.mcap --log both.jsonl");
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/peers/ros_recording.py");
    let found = camrig_tests::run(&python, &[&script, &dir.path().join("both.mcap")]);
    let found: serde_json::Value = serde_json::from_slice(&found).unwrap();
    let log = std::fs::read_to_string(dir.path().join("both.jsonl")).unwrap();
    assert_eq!(log.lines().count(), 120);
    for reader in ["mcap-ros2-support", "rosbags"] {
        let images = |name: &str| {
            let topic = format!("/{name}/image_raw");
            let all = found[reader].as_array().unwrap().iter();
            all.filter(|m| m["topic"] == topic.as_str()).cloned().collect::<Vec<_>>()
        };
        let (left, right) = (images("left"), images("right"));
        assert_eq!((left.len(), right.len()), (60, 60), "{reader}");
        let stamp = |m: &serde_json::Value| m["stamp_ns"].as_u64().unwrap() as f64;
        let later = std::iter::zip(&left, &right).map(|(l, r)| stamp(r) - stamp(l));
        let mean_ns = later.sum::<f64>() / 60.0;
        assert!((mean_ns - 1e6).abs() < 10e3, "{reader}: {mean_ns} ns");
    }
    for (name, seed) in [("left", 1), ("right", 2)] {
        let light = format!("--scene ramp --frames 60 --seed {seed}");
        let here = format!("simulate --camera c.toml --exposure 8ms {light} -o - --to SGRBG10");
        let own = camrig_ok(dir.path(), &here).stdout;
        let hex: String = own.iter().map(|byte| format!("{byte:02x}")).collect();
        let topic = format!("/{name}/image_raw");
        let all = found["rosbags"].as_array().unwrap().iter();
        let data =
            all.filter(|m| m["topic"] == topic.as_str()).map(|m| m["data"].as_str().unwrap());
        assert!(data.collect::<String>() == hex, "{name}");
    }
    // One camera that cannot begin ends the others, and its reason is told.
    let replaced = |from: &str, to: &str| {
        std::fs::write(dir.path().join("wrong.toml"), file.replacen(from, to, 1)).unwrap();
    };
    replaced("ramp", "nonesuch");
    refuses(dir.path(), "rig record wrong.toml -o wrong.mcap", &["nonesuch", "camera \"left\""]);
    assert!(!dir.path().join("wrong.mcap").exists());
    replaced("\"--seed\", \"1\"", "\"--fps\", \"30\"");
    refuses(dir.path(), "rig record wrong.toml -o wrong.mcap", &["--fps", "leave it out"]);
}

/// A region and binned pixels of a rig's frames are those of `simulate`; a capture set says what
/// was read.
#[test]
fn regions_and_binning_are_those_of_this_process() {
    let dir = folder();
    let part = "--roi 8,4,32,24 --binning 2x2";
    let light = "--scene ramp --frames 2";
    let rig = camrig_ok(dir.path(), &format!("{RIG} {light} {part} -o - --to SGRBG10")).stdout;
    let here = format!("simulate --camera c.toml --exposure 8ms {light} {part} -o - --to SGRBG10");
    assert_eq!(rig.len(), 2 * 16 * 12 * 2);
    assert_eq!(rig, camrig_ok(dir.path(), &here).stdout);
    camrig_ok(dir.path(), &format!("capture --camera c.toml --plan ptc {part} --frames 2 -o set"));
    let manifest = std::fs::read_to_string(dir.path().join("set/captures.toml")).unwrap();
    let manifest: toml::Table = manifest.parse().unwrap();
    let sensor = &manifest["sensor"];
    assert_eq!(sensor["width"].as_integer(), Some(16));
    assert_eq!(sensor["height"].as_integer(), Some(12));
    // Twice the pitch of the mt9t012, 2.2 µm.
    assert_eq!(sensor["pitch_um"].as_float(), Some(4.4));
    refuses(
        dir.path(),
        "capture --camera c.toml --plan ptc --roi 60,0,32,16 -o other",
        &["region 60,0,32,16"],
    );
    refuses(
        dir.path(),
        &format!("{RIG} {light} --roi 0,0,8,8 --binning 2x2:charge -o -"),
        &["charge binning of a region"],
    );
}

/// Dark frames straight from a rig's stream give the figures of the same frames in a file.
#[test]
fn a_stream_of_dark_frames_is_measured() {
    let dir = folder();
    let dark = format!("{RIG} --scene uniform:0 --frames 8 -o x.csi2");
    camrig_ok(dir.path(), &dark);
    let of_file = camrig_ok(dir.path(), "measure dark x.csi2 --json").stdout;
    let mut child = Command::new(env!("CARGO_BIN_EXE_camrig-under-test"))
        .args(["measure", "dark", "-", "--json"])
        .current_dir(dir.path())
        .stdin(std::fs::File::open(dir.path().join("x.csi2")).unwrap())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut of_stream = Vec::new();
    child.stdout.take().unwrap().read_to_end(&mut of_stream).unwrap();
    assert_eq!(said(child).0, Some(0));
    assert!(!of_stream.is_empty() && of_stream == of_file);
}
