//! Sweeps rendered to data sets: the same pictures however the work is split, interrupted or
//! repeated.

use super::{camrig, camrig_ok, small_camera};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const SWEEP: &str = r#"
format = "sweep/1"
frames = 2
files = "npy"

[grid]
camera = "c.toml"
scene = ["slanted-edge:angle=5", "uniform:0.4"]
lux = [30, 300]
exposure_s = [0.005, 0.02]
sensor_seed = [1, 7]

[grid.camera_keys]
"sensor.noise.read_e" = [3.0, 9.0]
"#;

/// A folder with a sweep of 64 pictures of 32 x 24 pixels.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("c.toml"), small_camera(32, 24, &[])).unwrap();
    std::fs::write(dir.path().join("sweep.toml"), SWEEP).unwrap();
    dir
}

/// Every file below a folder with its bytes.
pub fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            all.extend(files(&path).into_iter().map(|(k, v)| (format!("{name}/{k}"), v)));
        } else {
            all.insert(name, std::fs::read(path).unwrap());
        }
    }
    all
}

#[test]
fn shards_in_any_order_make_what_one_process_makes() {
    let dir = folder();
    let output = camrig_ok(dir.path(), "batch sweep.toml -o whole --no-cache --json");
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((told["done"].as_u64(), told["complete"].as_bool()), (Some(64), Some(true)));
    for number in [5, 2, 7, 1, 3, 6, 4] {
        assert!(!dir.path().join("parts/manifest.jsonl").exists());
        camrig_ok(dir.path(), &format!("batch sweep.toml -o parts --shard {number}/7 --no-cache"));
    }
    let whole = files(&dir.path().join("whole"));
    assert!(whole == files(&dir.path().join("parts")));
    assert_eq!(whole.len(), 2 * 64 + 2, "{:?}", whole.keys());
    // From another working directory, and again over the finished set.
    let above = dir.path().parent().unwrap();
    let name = dir.path().file_name().unwrap().to_string_lossy();
    camrig_ok(above, &format!("batch {name}/sweep.toml -o {name}/there --no-cache"));
    camrig_ok(above, &format!("batch {name}/sweep.toml -o {name}/there --no-cache"));
    assert!(whole == files(&dir.path().join("there")));
}

#[test]
fn the_manifest_says_what_each_picture_is() {
    let dir = folder();
    camrig_ok(dir.path(), "batch sweep.toml -o set --no-cache");
    let manifest = std::fs::read_to_string(dir.path().join("set/manifest.jsonl")).unwrap();
    let records: Vec<serde_json::Value> =
        manifest.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(records.len(), 64);
    // A picture is the frame that `simulate` gives for the parameters of its record.
    for record in records.iter().step_by(21) {
        let p = &record["parameters"];
        let number = |key: &str| p[key].as_f64().unwrap();
        camrig_ok(
            dir.path(),
            &format!(
                "simulate --camera c.toml --scene {} --lux {} --exposure {}s --gain {} \
                 --frame-seed {} --set sensor.seed={} --set sensor.noise.read_e={} --no-cache \
                 --force -o one.npy",
                p["scene"].as_str().unwrap(),
                number("lux"),
                number("exposure_s"),
                number("analog_gain"),
                p["frame"],
                p["sensor_seed"],
                p["camera_keys"]["sensor.noise.read_e"],
            ),
        );
        let batch = std::fs::read(dir.path().join("set").join(record["file"].as_str().unwrap()));
        assert!(batch.unwrap() == std::fs::read(dir.path().join("one.npy")).unwrap(), "{record}");
    }
}

#[test]
fn a_data_set_is_not_mixed_from_different_inputs() {
    let dir = folder();
    let refused = |says: &[&str]| {
        let output = camrig(dir.path(), "batch sweep.toml -o set --shard 2/2 --no-cache");
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{told}");
        says.iter().for_each(|s| assert!(told.contains(s), "{s}: {told}"));
    };
    camrig_ok(dir.path(), "batch sweep.toml -o set --shard 1/2 --no-cache");
    std::fs::write(dir.path().join("c.toml"), small_camera(32, 24, &[("prnu", "0.02")])).unwrap();
    refused(&["c.toml has changed", "new directory"]);
    std::fs::write(dir.path().join("c.toml"), small_camera(32, 24, &[])).unwrap();
    std::fs::write(dir.path().join("sweep.toml"), SWEEP.replace("0.02", "0.03")).unwrap();
    refused(&["sweep file is not the one"]);
    std::fs::remove_dir_all(dir.path().join("set")).unwrap();
    std::fs::create_dir(dir.path().join("set")).unwrap();
    std::fs::write(dir.path().join("set/mine.txt"), "precious").unwrap();
    refused(&["holds something else"]);
}

/// SIGKILL 200 times, at moments spread over the whole run. After each there are only whole files,
/// each with the bytes of an undisturbed run. When a data set is complete, a new one begins.
#[cfg(unix)]
#[test]
fn a_batch_killed_at_any_moment_loses_and_repeats_nothing() {
    kill_batches(40);
}

#[test]
#[ignore = "half a minute; forty kills, above, prove the same more coarsely: ci/full"]
fn a_batch_killed_at_two_hundred_moments_loses_and_repeats_nothing() {
    kill_batches(200);
}

fn kill_batches(kills: u32) {
    let dir = folder();
    let begun = Instant::now();
    camrig_ok(dir.path(), "batch sweep.toml -o whole --no-cache");
    let mut span_s = begun.elapsed().as_secs_f64();
    let whole = files(&dir.path().join("whole"));
    let set = dir.path().join("set");
    let (mut caught, mut pictures, mut completed) = (0, 0, 0);
    for i in 0..kills {
        let mut child = Command::new(env!("CARGO_BIN_EXE_camrig-under-test"))
            .args(["batch", "sweep.toml", "-o", "set", "--no-cache"])
            .current_dir(dir.path())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // Multiples of 0.618... modulo 1 fill the run evenly, whatever their number.
        let moment = f64::from(i) * 0.618_033_988_75 % 1.0;
        std::thread::sleep(Duration::from_secs_f64(moment * span_s));
        child.kill().unwrap();
        match child.wait().unwrap().success() {
            true => span_s *= 0.95, // the machine is less busy than it was: strike sooner
            false => caught += 1,
        }
        let now = files(&set);
        for (name, bytes) in &now {
            assert!(whole.get(name) == Some(bytes), "after kill {i}: {name} is not whole");
        }
        pictures = pictures.max(now.len());
        if now.contains_key("manifest.jsonl") {
            assert!(now == whole);
            completed += 1;
            std::fs::remove_dir_all(&set).unwrap();
        }
    }
    println!("{caught} of {kills} killed under way, {completed} data sets completed in spite");
    assert!(caught > kills / 2, "the kills must strike: {caught}");
    assert!(completed > 0 || pictures > 2, "some work must have been under way");
    camrig_ok(dir.path(), "batch sweep.toml -o set --no-cache");
    assert!(files(&set) == whole);
}

/// Pixel size against SNR and resolution, after the textbook: shot noise makes the SNR proportional
/// to the pitch, 6.02 dB for each doubling; a pixel of half the size resolves more per millimetre.
#[test]
fn pixel_size_against_snr_and_mtf() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let changes = [("bits", "14"), ("full_well_e", "200000"), ("prnu", "0.0")];
    std::fs::write(dir.join("c.toml"), small_camera(192, 144, &changes)).unwrap();
    let sweep = "format = \"sweep/1\"\n[grid]\ncamera = \"c.toml\"\nlux = 600\nexposure_s = 0.04\n\
                 scene = [\"uniform:0.4\", \"slanted-edge:angle=5\"]\n[grid.camera_keys]\n\
                 \"sensor.pitch_um\" = [2, 4]\n[figures]\nsnr_db = true\n\
                 dynamic_range_db = true\nmtf50_cycles_per_pixel = true\n";
    std::fs::write(dir.join("pixels.toml"), sweep).unwrap();
    camrig_ok(dir, "batch pixels.toml -o out --no-cache");
    let table = std::fs::read_to_string(dir.join("out/figures.csv")).unwrap();
    let mut lines = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let head = lines.next().unwrap();
    let place = |name: &str| head.iter().position(|h| *h == name).unwrap();
    let rows: Vec<Vec<&str>> = lines.collect();
    let figure = |name: &str, pitch: &str| {
        let (pitch_at, at) = (place("sensor.pitch_um"), place(name));
        let of_pitch = |row: &&Vec<&str>| {
            row[pitch_at].parse::<f64>() == pitch.parse() && row[place("channel")] == "g"
        };
        let values = rows.iter().filter(of_pitch).filter_map(|row| row[at].parse::<f64>().ok());
        values.collect::<Vec<_>>()[0]
    };
    let gain_db = figure("snr_db", "4") - figure("snr_db", "2");
    assert!((gain_db - 6.02).abs() < 0.3, "{gain_db} dB for twice the pitch");
    let per_mm = |pitch: &str| {
        figure("mtf50_cycles_per_pixel", pitch) / (1e-3 * pitch.parse::<f64>().unwrap())
    };
    assert!(per_mm("2") > 1.3 * per_mm("4"), "{} and {} per mm", per_mm("2"), per_mm("4"));
    // The sensor's dark noise does not know its pitch.
    assert_eq!(figure("dynamic_range_db", "2"), figure("dynamic_range_db", "4"));
    let page = std::fs::read_to_string(dir.join("out/figures.html")).unwrap();
    for words in ["SNR against pixel pitch", "everywhere", "MTF50 on the sensor against SNR"] {
        assert!(page.contains(words), "{words}");
    }
}

/// What `measure` and `isp` give of the frames of a data set is what its table says, to the last
/// digit: SNR, MTF50, colour error, dynamic range, each with its standard error.
#[test]
fn the_figures_of_a_data_set_are_those_of_measure_to_the_last_digit() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    std::fs::write(dir.join("c.toml"), small_camera(192, 144, &[("bits", "12")])).unwrap();
    let sweep = "format = \"sweep/1\"\n[grid]\ncamera = \"c.toml\"\nlux = 150\nexposure_s = 0.04\n\
                 scene = [\"colorchecker\", \"uniform:0.3\", \"slanted-edge:angle=5\"]\n\
                 [figures]\nsnr_db = true\ndynamic_range_db = true\n\
                 mtf50_cycles_per_pixel = true\ndelta_e_2000 = true\n";
    std::fs::write(dir.join("all.toml"), sweep).unwrap();
    camrig_ok(dir, "batch all.toml -o out --no-cache");
    let table = std::fs::read_to_string(dir.join("out/figures.csv")).unwrap();
    let mut lines = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let head = lines.next().unwrap();
    let place = |name: &str| head.iter().position(|h| *h == name).unwrap();
    let manifest = std::fs::read_to_string(dir.join("out/manifest.jsonl")).unwrap();
    let records: Vec<serde_json::Value> =
        manifest.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    // The dark frames have the two highest numbers; the chart has number 0, as that of `isp`.
    let lit = "--camera c.toml --scene uniform:0.3 --lux 150 --exposure 40ms";
    let unlit = lit.replace("--lux 150", "--lux 1e-12");
    camrig_ok(dir, &format!("simulate {unlit} --frames 2 --frame-seed 4294967294 -o dark"));
    let camera = camrig::camera::Camera::load(&dir.join("c.toml").to_string_lossy()).unwrap();
    let config = camera.sensor_config(&camrig::scene::Bands::VISIBLE).unwrap();
    let dn_per_e = f64::from(config.dn_per_e(1.0));
    let json = |dir: &Path, words: &str| -> serde_json::Value {
        serde_json::from_slice(&camrig_ok(dir, words).stdout).unwrap()
    };
    let dark = json(dir, &format!("measure dark dark --dn-per-e {dn_per_e} --json"));
    let isp = json(dir, "isp --camera c.toml --lux 150 --exposure 40ms --json");
    let mut seen = std::collections::BTreeSet::new();
    for row in lines {
        let channel = row[place("channel")];
        let record = &records[row[place("index")].parse::<usize>().unwrap()];
        let file = format!("out/frames/000/{:06}.dng", record["index"].as_u64().unwrap());
        let scene = row[place("scene")].split(':').next().unwrap();
        let mut same = |name: &str, error: Option<&str>, found: &serde_json::Value| {
            assert!(found["unit"].is_string(), "{name}: {found}");
            assert_eq!(row[place(name)], found["value"].to_string(), "{file} {name}");
            if let Some(error) = error {
                assert_eq!(row[place(error)], found["std_error"].to_string(), "{file} {error}");
                assert_eq!(&record["channels"][channel][name], found, "{file} {name}");
            }
            seen.insert(name.to_owned());
        };
        let range = &dark["channels"][channel]["dynamic_range_db"];
        same("dynamic_range_db", Some("dynamic_range_std_error"), range);
        match scene {
            "uniform" => {
                let found = json(dir, &format!("measure snr {file} --json"));
                same("snr_db", Some("snr_std_error"), &found["channels"][channel]["snr_db"]);
            }
            "slanted-edge" => {
                let found = json(dir, &format!("measure mtf {file} --roi 48,36,96,72 --json"));
                let edges = found["edges"].as_array().unwrap();
                let edge = edges.iter().find(|e| e["channel"] == channel).unwrap();
                let name = "mtf50_cycles_per_pixel";
                same(name, Some("mtf50_std_error"), &edge[name]);
            }
            // The colours are those of the picture, in the row of its first channel.
            _ if !row[place("delta_e_2000")].is_empty() => {
                let found = &isp["isps"]["camrig"];
                same("delta_e_2000", None, &found["delta_e_2000_mean"]);
                let [own, theirs] = ["delta_e_2000_max", "delta_e_2000_mean"];
                assert_eq!(record["figures"][own], found[own]);
                assert_eq!(record["figures"][theirs], found[theirs]);
            }
            _ => {}
        }
    }
    assert_eq!(seen.len(), 4, "{seen:?}");
}

/// Dark frames are of a sensor at its exposure, whatever it looks at and in which light: pictures
/// of all scenes and levels share them, and a sweep of some of these pictures has the same.
#[test]
fn pictures_of_one_sensor_share_its_dark_frames() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    // No noise is cut off at 0 DN.
    let changes = [
        ("bits", "14"),
        ("black_level_dn", "400"),
        ("read_e_post", "0.0"),
        ("dark_current_e_per_s", "0.0"),
    ];
    std::fs::write(dir.join("c.toml"), small_camera(64, 48, &changes)).unwrap();
    // For each read noise and channel, the different dynamic ranges.
    let ranges = |name: &str, scenes: &str, lux: &str| -> BTreeMap<(String, String), Vec<f64>> {
        let sweep = format!(
            "format = \"sweep/1\"\n[grid]\ncamera = \"c.toml\"\nscene = [{scenes}]\n\
             lux = [{lux}]\nexposure_s = 0.01\n[grid.camera_keys]\n\
             \"sensor.noise.read_e\" = [3.0, 9.0]\n[figures]\ndynamic_range_db = true\n"
        );
        std::fs::write(dir.join(format!("{name}.toml")), sweep).unwrap();
        camrig_ok(dir, &format!("batch {name}.toml -o {name} --no-cache"));
        let table = std::fs::read_to_string(dir.join(name).join("figures.csv")).unwrap();
        let mut lines = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let head = lines.next().unwrap();
        let place = |name: &str| head.iter().position(|h| *h == name).unwrap();
        let [read, channel, range] =
            ["sensor.noise.read_e", "channel", "dynamic_range_db"].map(place);
        let mut found = BTreeMap::new();
        for line in lines {
            let key = (line[read].to_string(), line[channel].to_string());
            let all: &mut Vec<f64> = found.entry(key).or_default();
            let range = line[range].parse().unwrap();
            if !all.contains(&range) {
                all.push(range);
            }
        }
        found
    };
    let all = ranges("all", "\"uniform:0.1\", \"ramp\", \"dots\"", "30, 300");
    assert!(all.len() >= 6 && all.values().all(|ranges| ranges.len() == 1), "{all:?}");
    assert_eq!(all, ranges("some", "\"dots\"", "300"));
    // Thresholds of EMVA 1288 (eq. 27), beside steps of 0.4 electrons, in the same random numbers:
    // 0.1 dB is what 8 % does, three standard errors of 768 samples.
    let threshold = |read: f64| (read * read + 0.25).sqrt() + 0.5;
    let of = |read: f64| {
        let of_read = all.iter().filter(move |((r, _), _)| r.parse::<f64>() == Ok(read));
        of_read.map(|(_, ranges)| ranges[0])
    };
    for (less, more) in of(3.0).zip(of(9.0)) {
        let lost = less - more;
        assert!(
            (lost - 20.0 * (threshold(9.0) / threshold(3.0)).log10()).abs() < 0.1,
            "{lost} dB: {all:?}"
        );
    }
}
