//! `[sensor.hdr]`: what it describes, what is refused and remarked, and its closed forms against
//! the figures of `golden/hdr`.

use super::expected::Expected;
use crate::{Camera, Folder};
use camrig_base::Bands;
use camrig_sensor_core::hdr::{Curve, Rounding};
use camrig_testing::{hdr, shared};
use std::path::Path;

fn read(text: &str) -> camrig_base::Result<Camera> {
    Camera::parse(text, "camera", &Folder::Directory(Path::new(".")))
}

fn camera(name: &str) -> Camera {
    read(&hdr::camera(name, [4, 2], "companded")).unwrap()
}

/// What is said of split4 with a piece of its text replaced.
fn said(from: &str, to: &str) -> String {
    let text = hdr::camera("split4", [4, 2], "companded");
    assert!(text.contains(from), "{from}");
    match read(&text.replacen(from, to, 1)) {
        Ok(camera) => camera.notes(&Bands::VISIBLE).join("\n"),
        Err(e) => format!("{e}; {}", e.remedy().unwrap_or_default()),
    }
}

/// The rows of a table of golden/hdr, each as its columns by name.
fn golden(file: &str) -> Option<Vec<std::collections::HashMap<String, String>>> {
    let mut table = csv::Reader::from_path(shared("golden/hdr")?.join(file)).unwrap();
    Some(table.deserialize().map(Result::unwrap).collect())
}

#[test]
fn a_capture_is_a_plain_camera() {
    let camera = camera("split4");
    let small = camera.of_capture(2).unwrap();
    let sensor = &small.sensor;
    assert_eq!((sensor.full_well_e, sensor.full_scale_e), (7900.0, 8190.0));
    assert_eq!((sensor.noise.read_e, sensor.noise.dark_current_e_per_s), (1.5, 4.0));
    let streams = sensor.streams;
    assert_eq!((streams.photodiode, streams.window, streams.capture), (1, 1, 2));
    let large = camera.of_capture(0).unwrap();
    let band = Bands { start_nm: 550.0, step_nm: 10.0, count: 1 };
    let ratio = sensor.response(&band)[0][0] / large.sensor.response(&band)[0][0];
    assert!((ratio - 3.0 / 128.0).abs() < 1e-12);
    assert!(camera.of_capture(4).is_none());
    assert!(large.of_capture(0).is_none(), "a capture has none");
}

#[test]
fn light_of_the_other_photodiode_leaks_in() {
    let text = hdr::camera("split4", [4, 2], "linear");
    let (first, second) = text.split_at(text.find("name = \"small\"").unwrap());
    let leaking =
        format!("{first}{}", second.replacen("optical_leak = 0", "optical_leak = 0.001", 1));
    let camera = read(&leaking).unwrap();
    let ratio = camera.sensor.hdr.as_ref().unwrap().photodiodes[1].response.at(550.0);
    assert!((ratio - (3.0 / 128.0 + 0.001)).abs() < 1e-15);
}

#[test]
fn effects_may_be_those_of_some_captures() {
    let text = hdr::camera("split4", [4, 2], "companded");
    let with = |effect: &str| read(&format!("{text}\n[[effect]]\n{effect}"));
    let noise = "kind = \"row-temporal-noise\"\nsigma_e = 1.0\non = [\"small\"]";
    let camera = with(noise).unwrap();
    let count = |i: usize| camera.of_capture(i).unwrap().effects.len();
    assert_eq!([0, 1, 2, 3].map(count), [0, 0, 1, 0]);
    let hot = "kind = \"hot-pixels\"\nfraction = 0.01\nmean_e_per_s = 10.0\non = [\"large\"]";
    let camera = with(hot).unwrap();
    let count = |i: usize| camera.of_capture(i).unwrap().effects.len();
    assert_eq!([0, 1, 2, 3].map(count), [1, 1, 0, 1]);
    let wrong = |effect: &str| {
        let e = with(effect).unwrap_err();
        format!("{e}; {}", e.remedy().unwrap_or_default())
    };
    let named = wrong(&noise.replace("small", "large"));
    assert!(named.contains("captures: hcg, lcg, small, very-short"), "{named}");
    let named = wrong(&hot.replace("large", "hcg"));
    assert!(named.contains("names photodiodes: large"), "{named}");
    let twice = "kind = \"companding\"\nknee_1 = 0.5\nslope_1 = 0.5\nknee_2 = 0.8\nslope_2 = 0.1";
    assert!(wrong(twice).contains("companding beside"), "{}", wrong(twice));
}

#[test]
fn what_cannot_be_is_refused_with_the_reason() {
    for (from, to, words) in [
        ("name = \"lcg\"", "name = \"hcg\"", "stands twice"),
        ("photodiode = \"small\"", "photodiode = \"medium\"", "there are large, small"),
        ("decide = \"small\"", "decide = \"tiny\"", "no capture \"tiny\""),
        ("window = 1\n", "window = 0\n", "window 0 is not that of capture \"hcg\""),
        ("window = 2\n", "window = 0\n", "start_us and exposure_ratio"),
        ("window = 2\nstart_us = 20000\n", "window = 0\nstart_us = 0\n", "same photodiode"),
        ("low_dn = 3000\nhigh_dn = 3600", "low_dn = 3600\nhigh_dn = 3600", "high_dn is above"),
        ("high_dn = 3600", "high_dn = 3950", "standard deviations"),
        ("[1024, 832]", "[640, 832]", "knee 1"),
        ("[640, 640]", "[640, 700]", "knee 0"),
        ("[16777216, 4096]", "[16777217, 4096]", "ends below 16777216"),
        ("overflow_e = 0", "overflow_e = 600000", "600000"),
        ("overflow_e = 0", "overflow_e = 510000", "at most 524287"),
        ("linear_bits = 24", "linear_bits = 22", "16, 20 or 24"),
        ("gains = [1, 4, 64, 4096]", "gains = [1, 4, 64]", "3 gains"),
        ("gains = [1, 4, 64, 4096]", "gains = [1, 4, 64.001, 4096]", "multiples of 1/256"),
        ("to = \"lcg\"", "to = \"small\"", "to \"lcg\""),
        ("overflow_leak = 0", "overflow_leak = 0.1", "use 0"),
        ("subtract_dn = 0", "subtract_dn = 16777216", "subtract_dn"),
        ("bits = 12\nsubtract", "bits = 11\nsubtract", "10, 12, 14 or 16"),
        ("flicker_capture = \"none\"", "flicker_capture = \"led\"", "no capture \"led\""),
    ] {
        let said = said(from, to);
        assert!(said.contains(words), "{to}: {said}");
    }
}

#[test]
fn what_is_doubtful_is_remarked() {
    let as_it_is = said("bits = 12", "bits = 12");
    assert!(
        !as_it_is.contains("% off") && as_it_is.contains("small (32 and 64.0000 linear DN)"),
        "{as_it_is}"
    );
    let off = said("gains = [1, 4, 64, 4096]", "gains = [1, 4.125, 64, 4096]");
    assert!(off.contains("+3.1 % off") && off.contains("a gain of 4.0000"), "{off}");
    let fine = camera("dol3").notes(&Bands::VISIBLE).join("\n");
    assert!(fine.contains("short (64 and 256.0000 linear DN)"), "{fine}");
}

#[test]
fn windows_of_a_photodiode_follow_each_other() {
    let camera = camera("dol3");
    let hdr = camera.sensor.hdr.as_ref().unwrap();
    assert!(hdr.check_exposure(0.016).is_ok());
    let e = hdr.check_exposure(0.021).unwrap_err().to_string();
    assert!(e.contains("long from 0 to 21000.000 µs"), "{e}");
}

#[test]
fn curves_are_those_of_published_sensors_and_receivers() {
    let (Some(knees), Some(codes)) = (golden("pwl_knees.csv"), golden("pwl_forward.csv")) else {
        return;
    };
    let mut compared = 0;
    for name in ["own13", "vitis20", "ox03c10", "imx585", "brilliant24"] {
        let own = knees.iter().filter(|row| row["curve"] == name);
        let points: Vec<(u32, f64)> = own
            .map(|row| (row["x"].parse().unwrap(), row["y"].parse().unwrap()))
            .filter(|(x, _)| *x > 0)
            .collect();
        let [floor, nearest] =
            [Rounding::Floor, Rounding::Nearest].map(|r| Curve::new(&points, r).unwrap());
        for row in codes.iter().filter(|row| row["curve"] == name) {
            let number = |column: &str| row[column].parse::<i64>().unwrap();
            let x = number("x");
            assert_eq!(floor.code(x), number("y_floor"), "{name} {x}");
            assert_eq!(nearest.code(x), number("y_nearest"), "{name} {x}");
            let lowest = floor.lowest(floor.code(x));
            assert_eq!(lowest, number("lowest_x_of_y_floor"), "{name} {x}");
            compared += 1;
        }
    }
    assert!(compared > 300, "{compared}");
    let Some(inverse) = golden("pwl_own13_inverse.csv") else { return };
    let camera = camera("split4");
    let companding = camera.sensor.hdr.unwrap().companding.unwrap();
    for row in inverse {
        let number = |column: &str| row[column].parse::<i64>().unwrap();
        let (code, lowest) = (number("code"), number("lowest_x"));
        assert_eq!(companding.lowest(code as u16), lowest);
        assert_eq!(i64::from(companding.code(lowest as u32)), code);
        assert_eq!(i64::from(companding.code(number("highest_x") as u32)), code);
    }
}

/// Decibels of a ratio of signals.
fn db(ratio: f64) -> f64 {
    20.0 * libm::log10(ratio)
}

#[test]
fn the_snr_is_that_of_the_closed_form() {
    for name in hdr::CAMERAS {
        let Some(rows) = golden(&format!("snr_{name}.csv")) else { return };
        let camera = camera(name);
        let expected = Expected::new(&camera, hdr::exposure_s(name), 1.0).unwrap();
        let captures = &camera.sensor.hdr.as_ref().unwrap().captures;
        for row in &rows {
            // Golden figures have eight digits; SNR changes with the square root of light.
            let near = |got: f64, column: &str| {
                let wanted: f64 = row[column].parse().unwrap();
                let tolerance = 1e-6 * wanted.abs().max(1.0);
                assert!((got - wanted).abs() < tolerance, "{name} {column} {row:?}: {got}");
            };
            let mu: f64 = row["mu_e"].parse().unwrap();
            let merged = expected.merged(mu);
            near(db(merged.snr()), "snr_merged_db");
            near(db(expected.companded_snr(mu).unwrap()), "snr_companded_db");
            for (i, capture) in captures.iter().enumerate() {
                match expected.capture_snr(i, mu) {
                    Some(snr) => near(db(snr), &format!("snr_{}_db", capture.name)),
                    None => assert_eq!(row[&format!("snr_{}_db", capture.name)], ""),
                }
                if i > 0 {
                    near(merged.weights[i - 1], &format!("weight_{}", capture.name));
                }
            }
        }
    }
}

#[test]
fn dynamic_range_and_hand_overs_are_those_of_the_closed_form() {
    let Some(folder) = shared("golden/hdr") else { return };
    let text = std::fs::read_to_string(folder.join("dynamic_range.json")).unwrap();
    let golden: serde_json::Value = serde_json::from_str(&text).unwrap();
    for name in hdr::CAMERAS {
        let camera = camera(name);
        let expected = Expected::new(&camera, hdr::exposure_s(name), 1.0).unwrap();
        let near = |got: f64, wanted: &serde_json::Value| {
            let wanted = wanted.as_f64().unwrap();
            assert!((got - wanted).abs() < 1e-6 * wanted.abs(), "{name}: {got}, {wanted}");
        };
        let own = &golden[name];
        let (least, most) = (expected.threshold_e(), expected.saturation_e());
        near(least, &own["mu_min_snr1_e"]);
        near(most, &own["mu_sat_e"]);
        near(db(most / least), &own["dr_snr1_db"]);
        let range = expected.dynamic_range();
        near(range.snr_1_db, &own["dr_snr1_db"]);
        near(range.read_noise_db.unwrap(), &own["dr_read_noise_db"]);
        for (limit, got) in range.above {
            let wanted = own[format!("dr_snr_{limit}db_contiguous")].as_f64().unwrap();
            // The table counts from point to point of a grid of 0.4 dB.
            let beyond = got - wanted;
            assert!((-0.02..0.8).contains(&beyond), "{name} above {limit} dB: {got}, {wanted}");
        }
        for (got, wanted) in expected.hand_overs().iter().zip(own["handovers"].as_array().unwrap())
        {
            assert_eq!(got.to, wanted["to"]);
            near(got.light_e[0], &wanted["mu_low"]);
            near(got.light_e[1], &wanted["mu_high"]);
            near(db(got.snr[0]), &wanted["snr_before_db"]);
            near(db(got.snr[1]), &wanted["snr_after_db"]);
        }
    }
}
