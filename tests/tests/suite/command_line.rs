//! The main task from the command line: scenes to raw files.

use super::{camrig, camrig_ok, small_camera};
use std::path::Path;

/// DN of an .npy frame.
fn frame(path: &Path) -> Vec<f64> {
    let frames = camrig::formats::read(path).expect("read");
    frames.planes[0].data.iter().map(|&v| f64::from(v)).collect()
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let (ma, mb) = (mean(a), mean(b));
    let dot = |x: &[f64], mx: f64, y: &[f64], my: f64| {
        x.iter().zip(y).map(|(x, y)| (x - mx) * (y - my)).sum::<f64>()
    };
    dot(a, ma, b, mb) / (dot(a, ma, a, ma) * dot(b, mb, b, mb)).sqrt()
}

#[test]
fn the_same_command_gives_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["a.dng", "b.dng"] {
        camrig_ok(
            dir.path(),
            &format!(
                "simulate --camera mt9t012 --scene colorchecker --illuminant D65 --lux 300 \
                 --exposure 20ms --oversample 1 -o {name}"
            ),
        );
    }
    let read = |name| std::fs::read(dir.path().join(name)).unwrap();
    assert!(read("a.dng") == read("b.dng"));
}

/// Frames of a flat scene share only the fixed pattern, so their correlation is the fixed part of
/// the variance. It is predicted from the camera file, with four standard errors of a correlation,
/// (1 - r²)/√n.
#[test]
fn another_frame_seed_changes_temporal_noise_only() {
    let dir = tempfile::tempdir().unwrap();
    let (w, h) = (256u32, 256u32);
    let camera = small_camera(w, h, &[("prnu", "0.03"), ("relative_illumination", "\"none\"")]);
    std::fs::write(dir.path().join("c.toml"), camera).unwrap();
    for (seed, name) in [(0, "a.npy"), (1, "b.npy")] {
        camrig_ok(
            dir.path(),
            &format!(
                "simulate --camera c.toml --scene uniform:0.5 --lux 300 --exposure 20ms \
                 --frame-seed {seed} -o {name}"
            ),
        );
    }
    let other = small_camera(
        w,
        h,
        &[("prnu", "0.03"), ("relative_illumination", "\"none\""), ("seed", "2")],
    );
    std::fs::write(dir.path().join("other.toml"), other).unwrap();
    camrig_ok(
        dir.path(),
        "simulate --camera other.toml --scene uniform:0.5 --lux 300 --exposure 20ms -o c.npy",
    );
    let [a, b, c] = ["a.npy", "b.npy", "c.npy"].map(|n| frame(&dir.path().join(n)));
    assert!(a != b);
    let dn_per_e = 1023.0 / 6500.0;
    let mean_e = (a.iter().sum::<f64>() / a.len() as f64 - 42.0) / dn_per_e;
    let quantisation = 1.0 / 12.0 / (dn_per_e * dn_per_e);
    let fixed = (0.03f64 * mean_e).powi(2) + 0.5f64.powi(2);
    let temporal = mean_e * (1.0 + 0.03f64.powi(2)) + 16.0 + quantisation;
    let expected = fixed / (fixed + temporal);
    let error = (1.0 - expected * expected) / f64::from(w * h).sqrt();
    let got = correlation(&a, &b);
    // PRNU and row pattern are one draw of 65,536 and of 256 values; their spread adds 1.2 % of
    // the fixed part.
    let draw = 0.012 * expected * (1.0 - expected);
    assert!((got - expected).abs() < 4.0 * error + draw, "{got} expected {expected} ± {error}");
    assert!(correlation(&a, &c).abs() < 0.03, "another sensor has another pattern");
}

#[test]
fn stored_irradiance_gives_the_same_frame_and_other_light_levels() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("c.toml"), small_camera(128, 96, &[])).unwrap();
    camrig_ok(
        dir.path(),
        "simulate --camera c.toml --scene colorchecker --lux 300 --exposure 20ms -o a.npy \
         --save-irradiance a.irr",
    );
    let again = "expose --camera c.toml --irradiance a.irr --exposure 20ms";
    camrig_ok(dir.path(), &format!("{again} -o b.npy"));
    camrig_ok(dir.path(), &format!("{again} --lux 600 -o c.npy"));
    let [a, b, c] = ["a.npy", "b.npy", "c.npy"].map(|n| frame(&dir.path().join(n)));
    assert_eq!(a, b);
    let signal = |f: &[f64]| f.iter().sum::<f64>() / f.len() as f64 - 42.0;
    let ratio = signal(&c) / signal(&a);
    assert!((ratio - 2.0).abs() < 0.05, "twice the light: {ratio}");
}

#[test]
fn thread_count_does_not_matter() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("c.toml"), small_camera(160, 120, &[])).unwrap();
    let mut digests = Vec::new();
    for threads in ["1", "3"] {
        let name = format!("{threads}.npy");
        let status = std::process::Command::new(env!("CARGO_BIN_EXE_camrig-under-test"))
            .args(["simulate", "--camera", "c.toml", "--scene", "slanted-edge"])
            .args(["--exposure", "20ms", "-o", &name])
            .env("RAYON_NUM_THREADS", threads)
            .current_dir(dir.path())
            .status();
        assert!(status.unwrap().success());
        digests.push(std::fs::read(dir.path().join(name)).unwrap());
    }
    assert!(digests[0] == digests[1]);
}

#[test]
fn several_frames_go_into_a_directory_whole() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("c.toml"), small_camera(64, 48, &[])).unwrap();
    let command = "simulate --camera c.toml --scene uniform:0.2 --exposure 10ms --frames 3 -o out";
    camrig_ok(dir.path(), command);
    let mut names: Vec<_> = std::fs::read_dir(dir.path().join("out"))
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .filter(|n| n.ends_with(".dng"))
        .collect();
    names.sort();
    assert_eq!(names, ["0000.dng", "0001.dng", "0002.dng"]);
    let again = camrig(dir.path(), command);
    assert_eq!(again.status.code(), Some(2), "an existing output stays");
    camrig_ok(dir.path(), &format!("{command} --force"));
}

#[test]
fn json_goes_to_standard_output_alone() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("c.toml"), small_camera(64, 48, &[])).unwrap();
    let output = camrig_ok(
        dir.path(),
        "simulate --camera c.toml --scene uniform:0.2 --exposure 10ms -o a.npy --json",
    );
    let object: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let mean = &object["frames"][0]["channels"]["g"]["mean_dn"];
    assert!(mean["value"].as_f64().unwrap() > 42.0 && mean["unit"] == "DN", "{mean}");
}

/// As a newcomer runs it; the page contains its pictures and requests nothing from the network.
#[test]
fn the_demo_makes_raws_pictures_and_a_page() {
    let dir = tempfile::tempdir().unwrap();
    camrig_ok(dir.path(), "demo -o out");
    let page = std::fs::read_to_string(dir.path().join("out/report.html")).unwrap();
    // Both frames, the first also as captured and sample by sample.
    assert_eq!(page.matches("<figure class=\"pic").count(), 4);
    for words in ["Headroom", "Longest exposure", "bit for bit", "colorchecker-10lx.dng"] {
        assert!(page.contains(words), "{words}");
    }
    // With the colon, because base64 contains any four letters now and then. The namespace of SVG
    // is a name, not an address.
    let page = page.replace("http://www.w3.org/2000/svg", "");
    assert!(!page.contains("http:") && !page.contains("https:"), "the page is self-contained");
    for name in ["colorchecker-300lx.dng", "colorchecker-10lx.png", "camera.toml"] {
        assert!(dir.path().join("out").join(name).exists(), "{name}");
    }
}

/// The demo's own commands write into a folder that gets its name at the end; nobody is told of it.
#[test]
fn the_demo_of_a_night_names_its_files_as_they_are_found() {
    let dir = tempfile::tempdir().unwrap();
    let made = camrig_ok(dir.path(), "demo hdr -o night");
    let told = String::from_utf8(made.stderr).unwrap() + &String::from_utf8(made.stdout).unwrap();
    assert!(told.contains("wrote night: report.html"), "{told}");
    assert!(!told.contains(".part"), "{told}");
    for name in ["report.html", "picture.png", "companded.dng", "captures", "linear.npy"] {
        assert!(dir.path().join("night").join(name).exists(), "{name}");
    }
}

/// Raw samples that end far below the range of 16 bits look black in a picture viewer; a PGM's
/// maximum says where they end.
#[test]
fn convert_tells_of_samples_that_look_dark_in_a_picture() {
    let dir = tempfile::tempdir().unwrap();
    let told = |maximum: u16, name: &str| {
        let mut pgm = format!("P5\n4 2\n{maximum}\n").into_bytes();
        let sample = (maximum / 2).to_be_bytes();
        pgm.extend(sample[usize::from(maximum < 256)..].repeat(8));
        std::fs::write(dir.path().join("in.pgm"), pgm).unwrap();
        let made =
            camrig_ok(dir.path(), &format!("convert in.pgm {name} --cfa RGGB --black 16 --force"));
        String::from_utf8(made.stderr).unwrap()
    };
    for name in ["out.tiff", "out.png"] {
        for maximum in [1023, 4095] {
            let dark = told(maximum, name);
            assert!(dark.contains(&format!("up to {maximum} of 65535")), "{dark}");
            assert!(dark.contains("show them dark") && dark.contains("--preview"), "{dark}");
        }
        assert_eq!(told(65535, name), "", "{name}");
    }
    // Eight bits fill a PNG of eight bits, and raw formats say where their samples end.
    for (maximum, name) in [(255, "out.png"), (1023, "out.npy"), (1023, "out.dng")] {
        assert!(!told(maximum, name).contains("dark"), "{name}");
    }
}
