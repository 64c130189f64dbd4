//! Sensors that read each pixel several times, as a user meets them.

use super::{camrig, camrig_ok};
use camrig_testing::hdr;
use std::path::Path;

const SIZE: [u32; 2] = [64, 48];

/// Writes the camera and simulates a checkerboard in an output of the sensor; the codes by frame.
fn simulate(folder: &Path, output: &str, scene: &str) -> Vec<Vec<u16>> {
    let text = hdr::camera("split4", SIZE, output);
    std::fs::write(folder.join(format!("{output}.toml")), text).unwrap();
    camrig_ok(
        folder,
        &format!("simulate --camera {output}.toml --scene {scene} -o {output}.npy --force"),
    );
    let bytes = std::fs::read(folder.join(format!("{output}.npy"))).unwrap();
    let planes = camrig::formats::decode(&bytes).unwrap().planes;
    planes.into_iter().map(|plane| plane.data).collect()
}

/// From the codes of split4's captures to its companded code, by the words of its camera file.
fn merged(codes: [u16; 4]) -> i64 {
    const GAINS: [i64; 4] = [1, 4, 64, 4096];
    let level = |i: usize| (i64::from(codes[i]) - 64) * GAINS[i];
    let mut linear = level(0);
    for k in 1..4 {
        let share = (256 * (i64::from(codes[k - 1]) - 3000)).div_euclid(600).clamp(0, 256);
        linear = (linear * (256 - share) + level(k) * share + 128) >> 8;
    }
    (linear + 64).clamp(0, (1 << 24) - 1)
}

/// The ends of the lines of split4's curve: linear DN and code.
const ENDS: [(i64, i64); 15] = [
    (0, 0),
    (640, 640),
    (1024, 832),
    (2048, 1088),
    (4096, 1344),
    (8192, 1600),
    (16_384, 1856),
    (32_768, 2112),
    (65_536, 2368),
    (131_072, 2624),
    (262_144, 2880),
    (2_097_152, 3328),
    (4_194_304, 3584),
    (8_388_608, 3840),
    (16_777_216, 4096),
];

/// The linear numbers of a code of split4's curve: the first, and how many.
fn decompanded(code: i64) -> (i64, i64) {
    let line = ENDS.windows(2).find(|w| code < w[1].1).unwrap();
    let step = (line[1].0 - line[0].0) / (line[1].1 - line[0].1);
    (line[0].0 + (code - line[0].1) * step, step)
}

#[test]
fn what_is_sent_is_the_merge_of_the_captures() {
    let folder = tempfile::tempdir().unwrap();
    // From dark to beyond the end of the last capture.
    for lux in ["3", "3000", "300000", "30000000"] {
        let scene = format!("colorchecker --lux {lux} --exposure 11.264ms");
        let captures = simulate(folder.path(), "captures", &scene);
        let sent = simulate(folder.path(), "companded", &scene);
        assert_eq!((captures.len(), sent.len()), (4, 1));
        for (i, &code) in sent[0].iter().enumerate() {
            let linear = merged([0, 1, 2, 3].map(|c| captures[c][i]));
            let (first, step) = decompanded(code.into());
            assert!((first..first + step).contains(&linear), "{lux} lx, {i}: {linear}, {code}");
        }
    }
}

/// Curves of 64 pieces: widths that are powers of two, and steps that are no whole numbers.
fn knees_64(more: i64) -> Vec<(i64, i64)> {
    let piece = |(x, y): &mut (i64, i64), i: i64| {
        (*x, *y) = (*x + (64 << (i.min(59) / 4)) + more * (i - 3).max(0), *y + 64);
        Some((*x, *y))
    };
    (0..64).scan((0, 0), piece).collect()
}

/// Receivers written from their publications (tests/peers/decompand.py) give back the linear
/// numbers as far as the curve keeps them.
#[test]
fn receivers_give_back_the_linear_signal() {
    let Some(python) = camrig_tests::client("python3") else { return };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("peers/decompand.py");
    let folder = tempfile::tempdir().unwrap();
    let (whole, broken) = (knees_64(0), knees_64(3));
    for knees in [&ENDS[1..], &whole, &broken] {
        for rounding in ["floor", "nearest"] {
            let text = hdr::camera("split4", SIZE, "companded");
            let (start, list) = (text.find("knees = ").unwrap(), serde_json::json!(knees));
            let text = format!("{}knees = {list}\n", &text[..start]);
            let text = text.replace("\"floor\"", &format!("{rounding:?}"));
            std::fs::write(folder.path().join("c.toml"), text).unwrap();
            let curve = serde_json::json!({
                "knees": knees, "bits": 12, "linear_bits": 24, "rounding": rounding,
            });
            std::fs::write(folder.path().join("curve.json"), curve.to_string()).unwrap();
            for lux in ["30", "3000", "300000"] {
                for output in ["companded", "linear"] {
                    camrig_ok(
                        folder.path(),
                        &format!(
                            "simulate --camera c.toml --set sensor.hdr.output={output} --scene \
                             colorchecker --lux {lux} --exposure 11.264ms -o {output}.npy --force"
                        ),
                    );
                }
                let said = std::process::Command::new(&python)
                    .arg(&script)
                    .args(["curve.json", "companded.npy", "linear.npy"])
                    .current_dir(folder.path())
                    .output()
                    .unwrap();
                let words = String::from_utf8_lossy(&said.stdout).into_owned()
                    + &String::from_utf8_lossy(&said.stderr);
                assert!(said.status.success(), "{rounding} {lux} lx: {words}");
                println!("{rounding} {lux} lx\n{words}");
            }
        }
    }
}

/// Pixels are binned before the curve, here and with a rig.
#[test]
fn binned_codes_are_those_of_the_binned_signal() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "colorchecker --lux 30000 --exposure 11.264ms";
    std::fs::write(folder.path().join("l.toml"), hdr::camera("split4", SIZE, "linear")).unwrap();
    camrig_ok(folder.path(), &format!("simulate --camera l.toml --scene {scene} -o l.npy"));
    let bytes = std::fs::read(folder.path().join("l.npy")).unwrap();
    let linear = camrig::formats::wide::decode(&bytes).unwrap().unwrap().planes.remove(0).data;
    for rig in ["", " --rig emulator:"] {
        let binned = simulate(folder.path(), "companded", &format!("{scene} --binning 2x2{rig}"));
        let width = SIZE[0] as usize;
        assert_eq!(binned[0].len(), linear.len() / 4);
        for (i, &code) in binned[0].iter().enumerate() {
            let at = 2 * (i / (width / 2)) * width + 2 * (i % (width / 2));
            let sum: u32 = [0, 1, width, width + 1].iter().map(|beside| linear[at + beside]).sum();
            let (first, step) = decompanded(code.into());
            let mean = i64::from((sum + 2) / 4);
            assert!((first..first + step).contains(&mean), "{rig} {i}: {mean}, {code}");
        }
    }
}

/// The linear signal of 24 bits, and the captures on virtual channels.
#[test]
fn wide_samples_and_channels_are_the_same_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "colorchecker --lux 300000 --exposure 11.264ms";
    let captures = simulate(folder.path(), "captures", scene);
    std::fs::write(folder.path().join("linear.toml"), hdr::camera("split4", SIZE, "linear"))
        .unwrap();
    let run = |camera: &str, file: &str| {
        camrig_ok(folder.path(), &format!("simulate --camera {camera} --scene {scene} -o {file}"));
        std::fs::read(folder.path().join(file)).unwrap()
    };
    for file in ["a.npy", "a.tiff", "a.csi2"] {
        let bytes = run("linear.toml", file);
        let frames = camrig::formats::wide::decode(&bytes).unwrap().unwrap();
        for (i, &dn) in frames.planes[0].data.iter().enumerate() {
            assert_eq!(i64::from(dn), merged([0, 1, 2, 3].map(|c| captures[c][i])), "{file} {i}");
        }
    }
    camrig_ok(folder.path(), "convert a.csi2 b.npy");
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert_eq!(read("a.npy"), read("b.npy"));
    let bytes = run("captures.toml", "channels.csi2");
    let stream = camrig::formats::csi2::decode_stream::<u16>(&bytes).unwrap();
    assert_eq!(stream.channels.len(), 4);
    for (channel, capture) in stream.channels.iter().zip(&captures) {
        assert_eq!(&channel.frames.planes[0].data, capture);
        assert_eq!((channel.embedded[0].len(), &channel.frame_numbers[..]), (1, &[1][..]));
    }
    camrig_ok(folder.path(), "convert channels.csi2 second.npy --virtual-channel 1");
    assert_eq!(camrig::formats::decode(&read("second.npy")).unwrap().planes[0].data, captures[1]);
    let output = camrig(folder.path(), "convert channels.csi2 all.npy");
    assert!(String::from_utf8_lossy(&output.stderr).contains("--virtual-channel"));
}

/// The page has the dynamic range, and no figures that hold for one capture alone.
#[test]
fn the_page_says_what_holds_for_merged_codes() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("c.toml"), hdr::camera("split4", SIZE, "companded"))
        .unwrap();
    let scene = "--camera c.toml --scene colorchecker --lux 300 --exposure 11.264ms";
    camrig_ok(folder.path(), &format!("simulate {scene} -o a.dng --report a.html"));
    let page = std::fs::read_to_string(folder.path().join("a.html")).unwrap();
    assert!(page.contains("with an SNR nowhere below 25 dB") && page.contains("Saturated"));
    assert!(!page.contains("Longest exposure") && !page.contains("SNR of the model"));
    let linear = "--set sensor.hdr.output=linear -o a.npy --report b.html";
    let output = camrig(folder.path(), &format!("simulate {scene} {linear}"));
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && said.contains("omit --report"), "{said}");
}

/// A rig merges and compands, and takes one capture alone.
#[test]
fn a_rig_gives_the_codes_of_this_process() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("c.toml"), hdr::camera("split4", SIZE, "companded"))
        .unwrap();
    for arith in ["f32", "fixed"] {
        for capture in ["", "--capture small"] {
            let made = |file: &str, where_to: &str| {
                camrig_ok(
                    folder.path(),
                    &format!(
                        "simulate --camera c.toml --scene colorchecker --lux 30000 \
                         --exposure 11.264ms {capture} --arith {arith} {where_to} -o {file} --force"
                    ),
                );
                std::fs::read(folder.path().join(file)).unwrap()
            };
            assert!(made("here.npy", "") == made("there.npy", "--rig emulator:"), "{capture}");
        }
    }
}

/// A window of 11 µs sees a lamp of 100 Hz that is on for a tenth of the time at ten times its
/// mean, or not at all; one of 11 ms sees a pulse either way.
#[test]
fn windows_see_pulsed_lamps_each_for_itself() {
    let folder = tempfile::tempdir().unwrap();
    let mean = |lamp: &str| -> Vec<f64> {
        let timing = "--set sensor.timing.line_time_us=11 --set sensor.timing.shutter=global \
                      --set sensor.timing.frame_length_lines=3000";
        let scene = format!("colorchecker --lux 30000 --exposure 11.264ms --noise none {timing}");
        let captures = simulate(folder.path(), "captures", &format!("{scene} {lamp}"));
        let above_black = |frame: &Vec<u16>| {
            frame.iter().map(|dn| f64::from(*dn) - 64.0).sum::<f64>() / frame.len() as f64
        };
        captures.iter().map(above_black).collect()
    };
    let steady = mean("");
    let [on, off] = [0.0, 0.5].map(|p| mean(&format!("--lamp pulse:hz=100,duty=0.1,phase={p}")));
    assert!(steady[3] > 50.0 && off[3] == 0.0, "{steady:?} {off:?}");
    assert!((on[3] / steady[3] - 10.0).abs() < 0.1, "{on:?} {steady:?}");
    assert!(off[2] > 0.5 * steady[2], "{off:?} {steady:?}");
}

/// A lamp that is on for a tenth of the time, at 100 Hz: a window of 3 ms misses it at most phases,
/// the small photodiode's of 12 ms at none, and the flicker rule takes that where the others are
/// dark.
#[test]
fn a_flicker_free_pixel_sees_every_pulse() {
    let folder = tempfile::tempdir().unwrap();
    let darkest = |flicker: &str| -> f64 {
        let means = [0.05, 0.25, 0.45, 0.65, 0.85].map(|phase| {
            camrig_ok(
                folder.path(),
                &format!(
                    "simulate --camera split-pixel-lfm --set sensor.width=32 --set sensor.height=24 \
                     --set sensor.hdr.output=linear {flicker} --set sensor.timing.line_time_us=12.01 \
                     --set sensor.timing.shutter=global --set sensor.timing.frame_length_lines=2775 \
                     --scene uniform:0.5 --lux 30000 --exposure 3ms \
                     --lamp pulse:hz=100,duty=0.1,phase={phase} -o a.csi2 --force"
                ),
            );
            let bytes = std::fs::read(folder.path().join("a.csi2")).unwrap();
            let frames = camrig::formats::wide::decode(&bytes).unwrap().unwrap();
            let dn = frames.planes[0].data.iter().map(|&dn| f64::from(dn) - 64.0);
            dn.sum::<f64>() / frames.planes[0].data.len() as f64
        });
        let brightest = means.iter().copied().fold(0.0, f64::max);
        means.iter().copied().fold(f64::MAX, f64::min) / brightest
    };
    let (with, without) = (darkest(""), darkest("--set sensor.hdr.merge.flicker_capture=none"));
    // In 12 ms one pulse of 1 ms at least, two at most.
    assert!(with > 0.2 && without < 0.01, "{with} {without}");
}

#[test]
fn times_of_a_row_that_differ_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("c.toml"), hdr::camera("split4", SIZE, "captures")).unwrap();
    let output = camrig(
        folder.path(),
        "simulate --camera c.toml --set sensor.timing.line_time_us=20 --scene colorchecker \
         --exposure 1ms -o a",
    );
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("row_time_us = 11") && output.status.code() == Some(2), "{said}");
}

#[test]
fn captures_are_files_with_their_names_exposures_and_noise() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("c.toml"), hdr::camera("split4", SIZE, "captures")).unwrap();
    let scene = "--scene colorchecker --lux 100 --exposure 11.264ms";
    camrig_ok(folder.path(), &format!("simulate --camera c.toml {scene} --frames 2 -o all"));
    for (i, name) in ["hcg", "lcg", "small", "very-short"].iter().enumerate() {
        for frame in 0..2 {
            let bytes = std::fs::read(at(&format!("all/{frame:04}-{name}.dng"))).unwrap();
            let dng = camrig::formats::decode(&bytes).unwrap().facts.dng.unwrap();
            let wanted = if i == 3 { 11e-6 } else { 0.011_264 };
            assert!((dng.exposure_s.unwrap() / wanted - 1.0).abs() < 1e-6, "{name}");
        }
    }
    // One capture alone is a plain camera with the same codes.
    camrig_ok(
        folder.path(),
        &format!("simulate --camera c.toml --capture lcg {scene} -o lcg.dng"),
    );
    let samples = |name: &str| {
        let frames = camrig::formats::decode(&std::fs::read(at(name)).unwrap()).unwrap();
        frames.planes[0].data.clone()
    };
    assert_eq!(samples("lcg.dng"), samples("all/0000-lcg.dng"));
}

#[test]
fn what_does_not_go_with_several_captures_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("c.toml"), hdr::camera("split4", SIZE, "linear")).unwrap();
    let scene_of = |file: &str| {
        format!("simulate --camera c.toml --scene colorchecker --exposure 11.264ms -o {file}")
    };
    let scene = "--camera c.toml --scene colorchecker --exposure 11.264ms -o a.npy";
    for (arguments, words) in [
        (format!("simulate {scene} --hdr rows:4"), "[sensor.hdr]"),
        (format!("simulate {scene} --binning 2x2:charge"), "several captures"),
        (scene_of("a.dng"), "more than 16 bits"),
        (format!("simulate {scene} --capture none"), "captures are hcg, lcg, small, very-short"),
        (format!("simulate {scene} --path components"), "in bands"),
        (
            "simulate --camera mobile --capture hcg --scene dots --exposure 1ms -o a.npy".into(),
            "omit it",
        ),
        ("isp --camera c.toml --exposure 1ms".into(), "--capture"),
    ] {
        let output = camrig(folder.path(), &arguments);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments}: {said}");
        assert!(said.contains(words), "{arguments}: {said}");
        assert!(!folder.path().join("a.npy").exists());
    }
}

/// One reading is what a model is compared with: a camera with several is refused, and the plain
/// camera of one capture is not.
#[test]
fn a_diagnosis_looks_at_one_capture() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("c.toml"), hdr::camera("split4", SIZE, "captures")).unwrap();
    std::fs::write(
        folder.path().join("plan.toml"),
        "format = \"plan/1\"\n[[stack]]\nid = \"dark\"\nrole = \"dark\"\nframes = 2\n\
         exposure_s = 0.01\n",
    )
    .unwrap();
    camrig_ok(folder.path(), "capture --camera c.toml --capture hcg --plan plan.toml -o hcg");
    for command in ["compare c.toml hcg", "diagnose c.toml hcg -o diagnosis"] {
        let output = camrig(folder.path(), command);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(
            said.contains("hcg, lcg, small, very-short") && said.contains("camera fit"),
            "{said}"
        );
    }
}
