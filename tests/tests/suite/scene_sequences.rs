//! Scenes that change with time: folders of pictures, folders while they are written, video.

use super::pictures::radiance_picture;
use super::{camrig, camrig_ok, small_camera};
use std::io::Write;
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// A folder with a camera `c.toml` of 64 x 48 pixels.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let flat = [("relative_illumination", "\"none\"")];
    std::fs::write(dir.path().join("c.toml"), small_camera(64, 48, &flat)).unwrap();
    dir
}

fn png(path: &Path, (width, height): (u32, u32), colour: [u8; 3]) {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).unwrap();
    }
    let mut encoder = png::Encoder::new(std::fs::File::create(path).unwrap(), width, height);
    encoder.set_color(png::ColorType::Rgb);
    let data = colour.repeat((width * height) as usize);
    encoder.write_header().unwrap().write_image_data(&data).unwrap();
}

/// A sequence `seq` of three pictures whose greens differ.
fn three(dir: &Path) -> [&'static str; 3] {
    let names = ["a1.png", "a2.png", "a10.png"];
    for (name, green) in names.iter().zip([60, 120, 180]) {
        png(&dir.join("seq").join(name), (8, 6), [90, green, 100]);
    }
    names
}

fn refused(dir: &Path, arguments: &str, words: &[&str]) {
    let output = camrig(dir, arguments);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments}: {said}");
    for word in words {
        assert!(said.contains(word), "{arguments}: {said}");
    }
}

/// Runs camrig with bytes on standard input.
fn fed(dir: &Path, arguments: &str, bytes: &[u8]) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_camrig-under-test"))
        .args(arguments.split_whitespace())
        .current_dir(dir)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // It may end before it has read all.
    let _ = child.stdin.take().unwrap().write_all(bytes);
    child.wait_with_output().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Mean of each frame of headerless pixels of 64 x 48.
fn means(frames: &[u8]) -> Vec<f64> {
    let mean = |frame: &[u8]| {
        let sum: f64 =
            frame.chunks_exact(2).map(|b| f64::from(u16::from_le_bytes([b[0], b[1]]))).sum();
        sum / (64.0 * 48.0)
    };
    assert_eq!(frames.len() % (2 * 64 * 48), 0);
    frames.chunks_exact(2 * 64 * 48).map(mean).collect()
}

const SIMULATE: &str = "simulate --camera c.toml --exposure 8ms";

#[test]
fn frames_of_a_sequence_are_those_of_its_pictures_byte_for_byte() {
    let dir = folder();
    let dir = dir.path();
    let names = three(dir);
    camrig_ok(dir, &format!("{SIMULATE} --scene seq --lux 400 -o set"));
    for (number, name) in names.iter().enumerate() {
        let one = format!("--scene seq/{name} --lux 400 --frame-seed {number} -o {number}.dng");
        camrig_ok(dir, &format!("{SIMULATE} {one}"));
        let of_sequence = std::fs::read(dir.join(format!("set/{number:04}.dng"))).unwrap();
        assert!(
            of_sequence == std::fs::read(dir.join(format!("{number}.dng"))).unwrap(),
            "{name}"
        );
    }
    assert!(!dir.join("set/0003.dng").exists());
    // The same on a rig, twice over.
    let here =
        camrig_ok(dir, &format!("{SIMULATE} --scene seq --loop --frames 5 -o - --to SGRBG10"));
    let rig = "rig stream emulator: --camera c.toml --exposure 8ms --scene seq --loop --frames 5";
    let rig = camrig_ok(dir, &format!("{rig} -o - --to SGRBG10"));
    assert_eq!(here.stdout.len(), 5 * 2 * 64 * 48);
    assert!(here.stdout == rig.stdout);
    let to_its_end = "rig stream emulator: --camera c.toml --exposure 8ms --scene seq --json";
    let figures = camrig_ok(dir, to_its_end).stdout;
    let figures: serde_json::Value = serde_json::from_slice(&figures).unwrap();
    assert_eq!((&figures["frames"], &figures["scene_frames"]["used"]), (&3.into(), &3.into()));
}

#[test]
fn time_decides_which_frame_is_shown() {
    let dir = folder();
    let dir = dir.path();
    three(dir);
    let of = |more: &str| {
        let run = camrig_ok(dir, &format!("{SIMULATE} --scene seq {more} -o - --to SGRBG10"));
        means(&run.stdout)
    };
    let levels = of("");
    assert!(levels[1] - levels[0] > 10.0 && levels[2] - levels[1] > 10.0, "{levels:?}");
    let near = |mean: f64| levels.iter().position(|level| (level - mean).abs() < 3.0);
    let shown = |more: &str| -> Vec<usize> {
        of(more).into_iter().map(|mean| near(mean).expect("a level")).collect()
    };
    assert_eq!(shown("--scene-rate 24 --fps 60"), [0, 0, 0, 1, 1, 2, 2, 2]);
    assert_eq!(shown("--scene-rate 60 --fps 30"), [0, 2]);
    assert_eq!(shown("--scene-rate 30 --fps 30 --loop --frames 5"), [0, 1, 2, 0, 1]);
    let run = format!("{SIMULATE} --scene seq --scene-rate 24 --fps 60 --frames 9 -o s --json");
    let run = camrig_ok(dir, &run);
    let told = stderr(&run);
    assert!(told.contains("ended after 8 of 9 frames"), "{told}");
    let figures: serde_json::Value = serde_json::from_slice(&run.stdout).unwrap();
    let counts = &figures["scene_frames"];
    assert_eq!((&counts["received"], &counts["used"]), (&3.into(), &3.into()));
    assert_eq!((&counts["held"], &counts["skipped"]), (&5.into(), &0.into()));
    let fast = camrig_ok(dir, &format!("{SIMULATE} --scene seq --scene-rate 60 --fps 30 -o f"));
    assert!(stderr(&fast).contains("skipped: 1 frame of seq,"), "{}", stderr(&fast));
}

#[test]
fn what_makes_no_sequence_is_named_and_leaves_nothing_behind() {
    let dir = folder();
    let dir = dir.path();
    three(dir);
    let simulate = format!("{SIMULATE} -o set --scene");
    png(&dir.join("mixed/b1.png"), (8, 6), [90, 60, 50]);
    png(&dir.join("mixed/b2.png"), (9, 6), [90, 60, 50]);
    refused(dir, &format!("{simulate} mixed"), &["b2.png", "9 x 6", "8 x 6"]);
    std::fs::write(dir.join("mixed/b2.png"), b"\x89PNG\r\n\x1a\n").unwrap();
    refused(dir, &format!("{simulate} mixed"), &["b2.png"]);
    std::fs::write(dir.join("mixed/c.jpg"), b"").unwrap();
    refused(dir, &format!("{simulate} mixed"), &["several kinds"]);
    refused(dir, &format!("{simulate} ramp --loop"), &["--loop", "a still scene"]);
    refused(dir, &format!("{simulate} seq --motion 1,0"), &["moves by itself"]);
    let kept = format!("{simulate} seq --save-irradiance x.irr");
    refused(dir, &kept, &["--save-irradiance", "single file of the folder", "ffmpeg"]);
    refused(
        dir,
        &format!("{SIMULATE} --scene seq -o x.dng"),
        &["all frames of a sequence into x.dng"],
    );
    refused(dir, "scene info seq", &["one scene is wanted"]);
    refused(dir, &format!("{simulate} seq:as=film"), &["as=film", "a1.png"]);
    assert!(!dir.join("set").exists() && !dir.join("x.dng").exists());
}

/// A light level is that of the first frame: the second, twice as bright, is not scaled to it too.
#[test]
fn a_scene_that_becomes_brighter_does() {
    let dir = folder();
    let dir = dir.path();
    std::fs::create_dir(dir.join("seq")).unwrap();
    for (name, exponent) in [("r1.hdr", 130), ("r2.hdr", 131)] {
        radiance_picture(&dir.join("seq").join(name), [128, 128, 128, exponent]);
    }
    let simulate = "simulate --camera c.toml --exposure 8ms --scene";
    let run = camrig_ok(dir, &format!("{simulate} seq --lux 100 -o - --to SGRBG10"));
    let signal: Vec<f64> = means(&run.stdout).iter().map(|mean| mean - 42.0).collect();
    let white = camrig_ok(dir, &format!("{simulate} uniform:1 --lux 100 -o - --to SGRBG10"));
    // Rounding to 0.02 DN and shot noise of 3072 pixels are below a per cent of 50 DN.
    assert!(signal[0] > 50.0 && (signal[1] / signal[0] - 2.0).abs() < 0.04, "{signal:?}");
    let white = means(&white.stdout)[0] - 42.0;
    assert!((signal[0] / white - 1.0).abs() < 0.02, "{signal:?}, white {white}");
    refused(dir, &format!("{simulate} seq -o set"), &["r1.hdr", "absolute scale"]);
}

/// The stacks of a capture set keep one condition each: one stack for each frame.
#[test]
fn a_capture_set_has_a_stack_for_each_frame() {
    let dir = folder();
    let dir = dir.path();
    let names = three(dir);
    let plan = "format = \"plan/1\"\n[[stack]]\nid = \"s\"\nrole = \"scene\"\nframes = 2\n\
                exposure_s = 0.008\nscene = { scene = \"seq\" }\n";
    std::fs::write(dir.join("plan.toml"), plan).unwrap();
    camrig_ok(dir, "capture --camera c.toml --plan ./plan.toml -o set");
    let manifest = std::fs::read_to_string(dir.join("set/captures.toml")).unwrap();
    // A plan that names them one by one gives the same bytes.
    let mut plan = String::from("format = \"plan/1\"\n");
    for (number, name) in names.iter().enumerate() {
        assert!(manifest.contains(&format!("seq/{name}")), "{manifest}");
        plan.push_str(&format!(
            "[[stack]]\nid = \"s-{number:02}\"\nrole = \"scene\"\nframes = 2\n\
             exposure_s = 0.008\nscene = {{ scene = \"seq/{name}\" }}\n"
        ));
    }
    std::fs::write(dir.join("plan.toml"), plan).unwrap();
    camrig_ok(dir, "capture --camera c.toml --plan ./plan.toml -o one-by-one");
    for frame in ["captures.toml", "s-00/0000.npy", "s-01/0001.npy", "s-02/0001.npy"] {
        let read = |set: &str| std::fs::read(dir.join(set).join(frame)).unwrap();
        assert!(read("set") == read("one-by-one"), "{frame}");
    }
}

#[test]
fn a_folder_is_taken_while_it_is_written() {
    let dir = folder();
    let dir = dir.path();
    std::fs::create_dir(dir.join("seq")).unwrap();
    let arguments = format!("{SIMULATE} --scene seq --watch --wait 20 -o - --to SGRBG10");
    let child = Command::new(env!("CARGO_BIN_EXE_camrig-under-test"))
        .args(arguments.split_whitespace())
        .current_dir(dir)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    for green in [60, 120, 180] {
        std::thread::sleep(std::time::Duration::from_millis(300));
        png(&dir.join(format!("seq/a{green}.png")), (8, 6), [90, green, 100]);
        std::fs::rename(
            dir.join(format!("seq/a{green}.png")),
            dir.join(format!("seq/a{}.png", green / 60)),
        )
        .unwrap();
    }
    std::fs::write(dir.join("seq/end"), "").unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    std::fs::remove_file(dir.join("seq/end")).unwrap();
    let whole = camrig_ok(dir, &format!("{SIMULATE} --scene seq -o - --to SGRBG10"));
    assert!(output.stdout == whole.stdout && whole.stdout.len() == 3 * 2 * 64 * 48);
    let ended = camrig_ok(dir, &format!("{SIMULATE} --scene seq --watch --wait 0.3 -o late"));
    assert!(stderr(&ended).contains("nothing came after a3.png for 0.3 s"), "{}", stderr(&ended));
}

/// An animation is taken as Mitsuba renders it: a card of reflectance 0.5 is as bright as a chart
/// of it, and a red card moves by 0.3 units of 19.3 columns a frame.
#[test]
fn frames_are_taken_as_mitsuba_renders_them() {
    let Some(python) = camrig_tests::client("mitsuba") else { return };
    let dir = folder();
    let dir = dir.path();
    std::fs::create_dir(dir.join("seq")).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/suite/mitsuba_frames.py");
    let mut renderer =
        Command::new(python).arg(script).arg(dir.join("seq")).spawn().expect("python starts");
    let simulate = "simulate --camera c.toml --exposure 4ms --lux 300 --scene";
    let taken =
        camrig_ok(dir, &format!("{simulate} seq --watch --wait 60 -o - --to SGRBG10")).stdout;
    assert!(renderer.wait().unwrap().success());
    assert_eq!(taken.len(), 3 * 2 * 64 * 48);
    let chart = camrig_ok(dir, &format!("{simulate} uniform:0.5 -o - --to SGRBG10")).stdout;
    let signal = |frame: &[u8], columns: std::ops::Range<usize>| {
        let at = |x: usize, y: usize| 2 * (64 * y + x);
        let places = (16..32).flat_map(|y| columns.clone().map(move |x| at(x, y)));
        let dn: Vec<f64> = places
            .map(|i| f64::from(u16::from_le_bytes([frame[i], frame[i + 1]])) - 42.0)
            .collect();
        dn.iter().sum::<f64>() / dn.len() as f64
    };
    let frames: Vec<&[u8]> = taken.chunks(2 * 64 * 48).collect();
    for frame in &frames {
        // 64 samples a pixel and shot noise over 192 pixels leave less than a per cent.
        let ratio = signal(frame, 6..18) / signal(&chart, 6..18);
        assert!((ratio - 1.0).abs() < 0.03, "the still card: {ratio}");
    }
    // The red card covers columns 32 to 55, then 38 to 61, then 44 on; around it is white light.
    let (left, right) = (34..37, 57..60);
    let white = signal(&chart, 34..37) / 0.5;
    for (frame, [covered, clear]) in [(0, [&left, &right]), (2, [&right, &left])] {
        assert!(signal(frames[frame], covered.clone()) < 0.6 * white, "frame {frame}");
        let clear = signal(frames[frame], clear.clone()) / white;
        assert!((clear - 1.0).abs() < 0.03, "frame {frame}: {clear}");
    }
}

/// Grey video of the full range, 4:4:4: its codes are those of a picture.
fn y4m(codes: &[u8]) -> Vec<u8> {
    let mut bytes = b"YUV4MPEG2 W8 H6 F25:1 Ip A1:1 C444 XCOLORRANGE=FULL\n".to_vec();
    for &code in codes {
        bytes.extend(b"FRAME\n");
        bytes.extend([code; 48]);
        bytes.extend([128; 96]);
    }
    bytes
}

#[test]
fn video_on_standard_input_gives_the_frames_of_the_same_pictures() {
    let dir = folder();
    let dir = dir.path();
    for (number, code) in [60, 120, 180].into_iter().enumerate() {
        png(&dir.join(format!("seq/{number}.png")), (8, 6), [code; 3]);
    }
    let stream = y4m(&[60, 120, 180]);
    // Grey pictures stored as colours may be bands: say what they are.
    let of_files = camrig_ok(
        dir,
        &format!(
            "{SIMULATE} --scene seq:kind=sequence --scene-rate 25 --fps 50 -o - --to SGRBG10"
        ),
    );
    let video = fed(dir, &format!("{SIMULATE} --scene - --fps 50 -o - --to SGRBG10"), &stream);
    assert!(video.status.success(), "{}", stderr(&video));
    assert_eq!(of_files.stdout.len(), 6 * 2 * 64 * 48);
    assert!(of_files.stdout == video.stdout);
    let rig = "rig stream emulator: --camera c.toml --exposure 8ms --fps 50 --json --scene -";
    let rig = fed(dir, &format!("{rig} -o x.csi2"), &stream);
    let figures: serde_json::Value = serde_json::from_slice(&rig.stdout).unwrap();
    assert_eq!((&figures["frames"], &figures["scene_frames"]["held"]), (&6.into(), &3.into()));
    let raw = camrig::formats::read(&dir.join("x.csi2")).unwrap();
    let packed: Vec<u8> =
        raw.planes.iter().flat_map(|p| p.data.iter().flat_map(|v| v.to_le_bytes())).collect();
    assert!(packed == video.stdout);
    std::fs::write(dir.join("clip.y4m"), &stream).unwrap();
    let clip = camrig_ok(
        dir,
        &format!("{SIMULATE} --scene clip.y4m --fps 50 --loop --frames 8 -o - --to SGRBG10"),
    );
    assert!(clip.stdout[..video.stdout.len()] == video.stdout);
    assert!((means(&clip.stdout)[6] - means(&clip.stdout)[0]).abs() < 2.0);
}

#[test]
fn a_stream_that_breaks_off_stalls_or_is_none_is_said() {
    let dir = folder();
    let dir = dir.path();
    let simulate = format!("{SIMULATE} --scene - --fps 25");
    let stream = y4m(&[60, 120]);
    let cut = fed(dir, &format!("{simulate} -o set"), &stream[..stream.len() - 3]);
    assert_eq!(cut.status.code(), Some(2));
    assert!(stderr(&cut).contains("frame 1 of standard input"), "{}", stderr(&cut));
    assert!(stderr(&cut).contains("141 of 144 bytes"), "{}", stderr(&cut));
    assert!(!dir.join("set").exists(), "nothing half-written");
    // What goes out live is whole up to there.
    let live = fed(dir, &format!("{simulate} -o - --to SGRBG10"), &stream[..stream.len() - 3]);
    assert_eq!((live.status.code(), live.stdout.len()), (Some(2), 2 * 64 * 48));
    let none = fed(dir, &format!("{simulate} -o set"), b"GIF89a");
    assert!(stderr(&none).contains("yuv4mpegpipe"), "{}", stderr(&none));
    // Sizes that are lies take no memory and no time.
    let lie = b"YUV4MPEG2 W16384 H8192 C444p16\nFRAME\nabc";
    let lie = fed(dir, &format!("{simulate} -o set"), lie);
    assert!(stderr(&lie).contains("3 of 805306368 bytes came"), "{}", stderr(&lie));
    let mut child = Command::new(env!("CARGO_BIN_EXE_camrig-under-test"))
        .args(format!("{simulate} --stall 0.3 -o set").split_whitespace())
        .current_dir(dir)
        .stdin(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut writer = child.stdin.take().unwrap();
    writer.write_all(&stream[..stream.len() - 3]).unwrap();
    let output = child.wait_with_output().unwrap();
    drop(writer);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("nothing came for 0.3 s"), "{}", stderr(&output));
    assert!(!dir.join("set").exists());
}

/// Mean signal above black of R, G, B in columns of a frame of a GRBG sensor.
fn signal(frame: &camrig::RawFrame, columns: std::ops::Range<usize>) -> [f64; 3] {
    let (mut sums, mut counts) = ([0.0; 3], [0.0; 3]);
    for y in 8..frame.height - 8 {
        for x in columns.clone() {
            let channel = [[1, 0], [2, 1]][y % 2][x % 2];
            sums[channel] += f64::from(frame.data[y * frame.width + x]) - frame.black_level_dn;
            counts[channel] += 1.0;
        }
    }
    [0, 1, 2].map(|c| sums[c] / counts[c])
}

/// FFmpeg's bars through a pipe: the white one is as bright as a chart of reflectance 1, the
/// others, of 75 %, have the colours of FFmpeg's own picture of them.
#[test]
fn bars_from_ffmpeg_are_as_bright_and_as_coloured_as_they_should_be() {
    /// One code of 8 bits of luma and one of a colour difference, by which FFmpeg's rounding may be
    /// off (its white is 234, 127, 127 with subsampled colour), in light as a share of white: the
    /// slope of sRGB's curve at white is 2.275, blue has 1.8556 of its colour difference.
    const CODE: f64 = 2.275 * (1.0 / 219.0 + 1.8556 / 224.0);
    let Some(ffmpeg) = camrig_tests::client("ffmpeg") else { return };
    let dir = folder();
    let dir = dir.path();
    let quiet = [
        ("qe", "\"qe.csv\""),
        ("ir_cut", "\"cut.csv\""),
        ("read_e", "0.0"),
        ("read_e_post", "0.0"),
        ("prnu", "0.0"),
        ("row_fpn_e", "0.0"),
        ("relative_illumination", "\"none\""),
    ];
    std::fs::write(dir.join("b.toml"), small_camera(160, 48, &quiet)).unwrap();
    for (name, preset) in [("qe.csv", "mt9m131-qe.csv"), ("cut.csv", "ir-cut-690.csv")] {
        std::fs::write(dir.join(name), camrig::camera::presets::file(preset).unwrap()).unwrap();
    }
    let bars = ["-v", "error", "-f", "lavfi", "-i", "pal75bars=size=320x96:rate=25:duration=0.08"];
    for (layout, range) in [("yuv444p", "limited"), ("yuv420p", "limited"), ("yuv422p10", "full")]
    {
        let matrix = format!("scale=out_color_matrix=bt709:out_range={range},setsar=1");
        let mut source = Command::new(&ffmpeg)
            .args(bars)
            .args(["-vf", &matrix, "-pix_fmt", layout, "-strict", "-1", "-f", "yuv4mpegpipe", "-"])
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let simulate = format!(
            "simulate --camera b.toml --exposure 20ms --lux 300 --scene \
             -:matrix=bt709,range={range} -o {layout} --force"
        );
        let output = Command::new(env!("CARGO_BIN_EXE_camrig-under-test"))
            .args(simulate.split_whitespace())
            .current_dir(dir)
            .stdin(source.stdout.take().unwrap())
            .output()
            .unwrap();
        assert!(
            output.status.success() && source.wait().unwrap().success(),
            "{}",
            stderr(&output)
        );
        assert!(dir.join(layout).join("0001.dng").exists(), "two frames");
    }
    let of = |name: &str| camrig::formats::read(&dir.join(name)).unwrap().raw(0).unwrap();
    let simulate = "simulate --camera b.toml --exposure 20ms --lux 300 --scene";
    let picture = [&bars[..], &["-frames:v", "1", "-y", "bars.png"]].concat();
    assert!(Command::new(&ffmpeg).args(picture).current_dir(dir).status().unwrap().success());
    camrig_ok(dir, &format!("{simulate} bars.png -o picture.dng"));
    camrig_ok(dir, &format!("{simulate} uniform:1 -o white.dng"));
    let white = signal(&of("white.dng"), 20..140);
    let own = of("picture.dng");
    for layout in ["yuv444p", "yuv420p", "yuv422p10"] {
        let frame = of(&format!("{layout}/0000.dng"));
        // Eight bars of 20 columns.
        for bar in 0..8 {
            let columns = 20 * bar + 6..20 * bar + 14;
            let (found, expected) = (signal(&frame, columns.clone()), signal(&own, columns));
            for c in 0..3 {
                let off = (found[c] - expected[c]).abs() / white[c];
                assert!(off < CODE, "{layout} bar {bar}: {found:?}, not {expected:?}");
            }
        }
        let first = signal(&frame, 6..14);
        for c in 0..3 {
            assert!((first[c] / white[c] - 1.0).abs() < CODE, "{layout}: {first:?} {white:?}");
        }
        // White, yellow, cyan, green, magenta, red, blue, black: what is bright in each.
        let relative = |bar: usize| {
            let found = signal(&frame, 20 * bar + 6..20 * bar + 14);
            [0, 1, 2].map(|c| found[c] / white[c])
        };
        assert!(relative(1)[2] < 0.25 && relative(1)[0] > 0.4, "yellow {:?}", relative(1));
        assert!(relative(5)[0] > 2.0 * relative(5)[2], "red {:?}", relative(5));
        assert!(relative(6)[2] > 2.0 * relative(6)[0], "blue {:?}", relative(6));
        assert!(relative(7).iter().all(|v| *v < 0.01), "black {:?}", relative(7));
    }
}
