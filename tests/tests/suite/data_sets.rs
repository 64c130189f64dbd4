//! Data sets for training: noisy frames with their expected signal and the labels of the
//! photographs, drawn at random, in files and in tar files.

use super::{batch, camrig, camrig_ok, small_camera};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const SWEEP: &str = r#"
format = "sweep/1"
frames = 2
files = "npy"
pictures_per_tar = 8

[grid]
camera = "c.toml"
exposure_s = 0.02

[random]
count = 10
seed = 3
[random.keys]
scene = { choice = ["photos/*.png"] }
lux = { log-range = [200, 400] }
"sensor.noise.read_e" = { range = [2, 6] }

[clean]
[labels]
folder = "labels"
"#;
/// Sides of the photographs and of the frames.
const PHOTO: [usize; 2] = [96, 72];
const FRAME: [usize; 2] = [48, 32];

/// Photograph `n`: a bright rectangle on black; its first column and row, columns and rows.
fn bright(n: usize) -> [usize; 4] {
    [8 + 16 * n, 16 + 8 * n, 30, 24]
}

fn grey_png(path: &Path, value: impl Fn(usize, usize) -> u8) {
    let file = std::fs::File::create(path).unwrap();
    let mut encoder = png::Encoder::new(file, PHOTO[0] as u32, PHOTO[1] as u32);
    encoder.set_color(png::ColorType::Grayscale);
    let data: Vec<u8> =
        (0..PHOTO[0] * PHOTO[1]).map(|i| value(i % PHOTO[0], i / PHOTO[0])).collect();
    encoder.write_header().unwrap().write_image_data(&data).unwrap();
}

/// A folder with three photographs, their labels, a lens that distorts, and the sweep.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let quiet = [
        ("bits", "12"),
        ("prnu", "0.0"),
        ("row_fpn_e", "0.0"),
        ("read_e_post", "0.0"),
        ("dark_current_e_per_s", "0.0"),
    ];
    let camera = small_camera(FRAME[0] as u32, FRAME[1] as u32, &quiet);
    let bent = "\n[[effect]]\nkind = \"distortion\"\nk1 = -0.1\n";
    std::fs::write(dir.path().join("c.toml"), camera + bent).unwrap();
    std::fs::write(dir.path().join("sweep.toml"), SWEEP).unwrap();
    std::fs::create_dir(dir.path().join("photos")).unwrap();
    std::fs::create_dir(dir.path().join("labels")).unwrap();
    for n in 0..3 {
        let [left, top, width, height] = bright(n);
        let inside = |x: usize, y: usize| {
            (left..left + width).contains(&x) && (top..top + height).contains(&y)
        };
        let photo = dir.path().join(format!("photos/{n}.png"));
        grey_png(&photo, |x, y| if inside(x, y) { 220 } else { 0 });
        let mask = dir.path().join(format!("labels/{n}.png"));
        grey_png(&mask, |x, y| if inside(x, y) { 7 } else { 0 });
        let corners = [[left, top], [left + width, top + height]];
        let shapes = json!({
            "imageWidth": PHOTO[0], "imageHeight": PHOTO[1], "imagePath": format!("{n}.png"),
            "shapes": [
                { "label": "bright", "points": corners, "shape_type": "rectangle" },
                { "label": "middle", "points": [[48, 36]], "shape_type": "point" },
                { "label": "corner", "points": [[0, 0]], "shape_type": "point" },
            ],
        });
        std::fs::write(dir.path().join(format!("labels/{n}.json")), shapes.to_string()).unwrap();
    }
    dir
}

/// Every file below a folder with its bytes, and every member of a tar file as if it were one.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = batch::files(folder);
    let mut members = BTreeMap::new();
    for (name, bytes) in all.iter().filter(|(name, _)| name.ends_with(".tar")) {
        for member in tar::Archive::new(&bytes[..]).entries().unwrap() {
            let mut member = member.unwrap();
            let mut content = Vec::new();
            member.read_to_end(&mut content).unwrap();
            let inside = member.path().unwrap().to_string_lossy().into_owned();
            members.insert(format!("{name}/{inside}"), content);
        }
    }
    all.extend(members);
    all
}

/// Little-endian samples after the header of an NPY file.
fn samples<const N: usize>(npy: &[u8]) -> Vec<[u8; N]> {
    let data = 10 + usize::from(u16::from_le_bytes([npy[8], npy[9]]));
    npy[data..].as_chunks().0.to_vec()
}

#[test]
fn triples_agree_with_each_other_and_each_can_be_made_again() {
    let dir = folder();
    let dir = dir.path();
    camrig_ok(dir, "batch sweep.toml -o set --no-cache");
    let all = files(&dir.join("set"));
    let member = |index: usize, ending: &str| {
        &all[&format!("tars/{:06}.tar/{index:06}.{ending}", index / 8)]
    };
    let manifest = std::fs::read_to_string(dir.join("set/manifest.jsonl")).unwrap();
    let records: Vec<Value> = manifest.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert_eq!(records.len(), 20);
    assert!(!all.contains_key("frames/000/000003.npy"), "it is in its tar file");
    let config = camrig::camera::Camera::load(&dir.join("c.toml").to_string_lossy()).unwrap();
    let config = config.sensor_config(&camrig::scene::Bands::VISIBLE).unwrap();
    let (dn_per_e, black_dn) = (f64::from(config.dn_per_e(1.0)), f64::from(config.black_level_dn));
    for (index, record) in records.iter().enumerate() {
        let parameters = &record["parameters"];
        let read_e = parameters["camera_keys"]["sensor.noise.read_e"].as_f64().unwrap();
        let lux = parameters["lux"].as_f64().unwrap();
        assert!((2.0..6.0).contains(&read_e) && (200.0..400.0).contains(&lux), "{record}");
        assert_eq!(record["tar"], format!("tars/{:06}.tar", index / 8));
        // Both frames of a burst are draws of noise about one signal.
        assert_eq!(member(index, "clean.npy"), member(index & !1, "clean.npy"));
        let raw = samples::<2>(member(index, "npy"));
        let raw: Vec<f64> = raw.into_iter().map(|b| u16::from_le_bytes(b).into()).collect();
        let clean = samples::<4>(member(index, "clean.npy"));
        let clean: Vec<f64> = clean.into_iter().map(|b| f32::from_le_bytes(b).into()).collect();
        assert_eq!((raw.len(), clean.len()), (FRAME[0] * FRAME[1], FRAME[0] * FRAME[1]));
        // Shot noise, read noise and rounding: mean and variance within 5 standard errors.
        let z: Vec<f64> = raw
            .iter()
            .zip(&clean)
            .map(|(raw, clean)| {
                let signal = (clean - black_dn) * dn_per_e;
                let variance = signal + (read_e * dn_per_e).powi(2) + 1.0 / 12.0;
                (raw - clean) / variance.sqrt()
            })
            .collect();
        let n = z.len() as f64;
        let (mean, square) = (z.iter().sum::<f64>() / n, z.iter().map(|z| z * z).sum::<f64>() / n);
        assert!(mean.abs() < 5.0 / n.sqrt(), "{index}: {mean}");
        assert!((square - 1.0).abs() < 5.0 * (2.0 / n).sqrt(), "{index}: {square}");
        // The labels lie where the light is: green pixels above half of the brightest.
        let brightest = clean.iter().fold(0.0f64, |m, v| m.max(*v)) - black_dn;
        let labels: Value = serde_json::from_slice(member(index, "labels.json")).unwrap();
        assert_eq!(labels["imageWidth"], FRAME[0]);
        let shapes = labels["shapes"].as_array().unwrap();
        let corner = |i: usize, k: usize| shapes[0]["points"][i][k].as_f64().unwrap();
        assert_eq!(shapes[1]["points"], json!([[24.0, 16.0]]), "on the axis");
        assert_eq!(shapes.len(), 2, "the corner is cut off: {shapes:?}");
        let mut reader = png::Decoder::new(std::io::Cursor::new(member(index, "mask.png")))
            .read_info()
            .unwrap();
        let mut mask = vec![0; FRAME[0] * FRAME[1]];
        reader.next_frame(&mut mask).unwrap();
        let (mut wrong, mut counted) = (0, 0);
        for y in 0..FRAME[1] {
            for x in (0..FRAME[0]).filter(|x| (x + y) % 2 == 0) {
                let lit = clean[y * FRAME[0] + x] - black_dn > 0.5 * 0.7 * brightest;
                let in_box = (corner(0, 0)..corner(1, 0)).contains(&(x as f64 + 0.5))
                    && (corner(0, 1)..corner(1, 1)).contains(&(y as f64 + 0.5));
                assert!(in_box || mask[y * FRAME[0] + x] == 0);
                counted += usize::from(lit);
                wrong += usize::from(lit != (mask[y * FRAME[0] + x] == 7));
            }
        }
        println!("picture {index}: {wrong} of {counted} bright pixels differ from the mask");
        assert!(counted > 30 && wrong * 8 < counted, "{index}: {wrong} of {counted}");
    }
    // Sample 13 alone, byte for byte.
    camrig_ok(dir, "batch sweep.toml -o one --only 13 --no-cache");
    let one = files(&dir.join("one"));
    for ending in ["npy", "clean.npy", "labels.json", "mask.png", "json"] {
        assert!(&one[&format!("frames/000/000013.{ending}")] == member(13, ending), "{ending}");
    }
    assert_eq!(one.len(), 6);
    let output = camrig(dir, "batch sweep.toml -o one --only 20");
    assert_eq!(output.status.code(), Some(2));
}

/// Parts in any order, and SIGKILL at ten moments, in the middle of tar files, too.
#[test]
fn tar_files_are_the_same_however_they_came_about() {
    let dir = folder();
    let dir = dir.path();
    let begun = Instant::now();
    camrig_ok(dir, "batch sweep.toml -o whole --no-cache");
    let span_s = begun.elapsed().as_secs_f64();
    let whole = files(&dir.join("whole"));
    for number in [3, 1, 2] {
        camrig_ok(dir, &format!("batch sweep.toml -o parts --shard {number}/3 --no-cache"));
    }
    assert!(whole == files(&dir.join("parts")));
    for i in 1..=10 {
        let mut child = Command::new(env!("CARGO_BIN_EXE_camrig-under-test"))
            .args(["batch", "sweep.toml", "-o", "killed", "--no-cache"])
            .current_dir(dir)
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_secs_f64(span_s * f64::from(i) / 20.0));
        child.kill().unwrap();
        child.wait().unwrap();
    }
    camrig_ok(dir, "batch sweep.toml -o killed --no-cache");
    assert!(whole == files(&dir.join("killed")));
}

#[test]
fn what_cannot_be_drawn_or_labelled_is_refused() {
    let dir = folder();
    let dir = dir.path();
    let refused = |from: &str, to: &str, says: &str| {
        assert!(SWEEP.contains(from), "{from}");
        std::fs::write(dir.join("wrong.toml"), SWEEP.replace(from, to)).unwrap();
        let output = camrig(dir, "batch wrong.toml --dry-run");
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && told.contains(says), "{says}: {told}");
    };
    refused("photos/*.png", "pictures/*.png", "no files");
    refused("\"labels\"", "\"elsewhere\"", "no labels of");
    refused("[200, 400]", "[0, 400]", "above zero");
    refused("[2, 6]", "[6, 2]", "lower end");
    refused("log-range", "logrange", "logrange");
    refused("noise.read_e", "noise.raed_e", "raed_e");
    refused("exposure_s = 0.02", "exposure_s = 0.02\nlux = 3", "give it once");
    refused("exposure_s = 0.02", "", "no exposure_s");
    // Two pictures of one name, and pictures beside their labels: none is the mask of itself.
    std::fs::create_dir(dir.join("more")).unwrap();
    std::fs::copy(dir.join("photos/1.png"), dir.join("more/1.png")).unwrap();
    let two = "scene = { choice = [\"photos/1.png\", \"more/1.png\"] }";
    let line = SWEEP.lines().find(|l| l.contains("photos/*.png")).unwrap();
    refused(line, two, "and of another scene");
    refused("\"labels\"", "\"photos\"", "no labels of");
    // A mask of another picture.
    std::fs::write(dir.join("labels/1.json"), "{\"imageWidth\": 5, \"imageHeight\": 5}").unwrap();
    let output = camrig(dir, "batch sweep.toml -o set --no-cache");
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && told.contains("96 x 72"), "{told}");
}
