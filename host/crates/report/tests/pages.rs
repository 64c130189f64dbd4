//! The pages of simulations, trade-offs, lenses and measurements, made from small data, in the
//! browsers of this machine.

use camrig_base::{Cfa, Plane, RawFrame};
use camrig_camera::Camera;
use camrig_captures::{CaptureSet, SensorFacts};
use camrig_formats::DngInfo;
use camrig_lens::characterise::{self, Plan, PsfMethod};
use camrig_lens::prescription::toml;
use camrig_lens::{Catalogue, Conditions, System};
use camrig_light::Illuminant;
use camrig_measure::Value as Measured;
use camrig_measure::mtf::Roi;
use camrig_measure::{mtf, ptc};
use camrig_report::{lens, measurement, simulation, tradeoff};
use camrig_testing::browser;
use serde_json::{Value, json};

/// Noise of about unit variance that is the same everywhere.
fn noise(i: usize) -> f64 {
    let mut x = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mut next = || {
        x ^= x >> 31;
        x = x.wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (x >> 40) as f64 / f64::from(1 << 24)
    };
    // A sum of four uniform numbers has the variance 1/3.
    ((0..4).map(|_| next()).sum::<f64>() - 2.0) * 1.732
}

/// A frame of an edge (5° off the columns) between two grey sides, with shot noise.
fn edge_frame(width: usize, height: usize, levels: [f64; 2], gain: f64) -> RawFrame {
    let (black, cfa) = (42.0, Cfa::parse("GRBG").unwrap());
    let data = Plane::from_fn(width, height, |x, y| {
        let across = (x as f64 - 0.5 * width as f64) - 0.0875 * (y as f64 - 0.5 * height as f64);
        let t = 0.5 + 0.5 * libm::tanh(across / 0.8);
        let tint = if cfa.letter(x, y) == 'G' { 1.0 } else { 0.6 };
        let signal = tint * (levels[0] + t * (levels[1] - levels[0]));
        let sigma = (gain * signal + 0.5).sqrt();
        (black + signal + sigma * noise(y * width + x)).clamp(0.0, 1023.0).round() as u16
    });
    RawFrame {
        width,
        height,
        bits: 10,
        cfa,
        black_level_dn: black,
        white_level_dn: 1023,
        data: data.data,
    }
}

fn dng_info() -> DngInfo {
    DngInfo { as_shot_neutral: Some([0.6, 1.0, 0.6]), ..DngInfo::default() }
}

fn simulated(levels: [f64; 2], frames: usize) -> String {
    let mut camera = Camera::load("mt9t012").unwrap();
    (camera.sensor.width, camera.sensor.height) = (240, 180);
    let settings = camera.settings(0, 0.03, None);
    let mut shown = simulation::Frames::default();
    for i in 0..frames {
        let frame = edge_frame(240, 180, levels.map(|v| v * (1.0 + 0.2 * i as f64)), 0.157);
        shown.add(&format!("{i:04}.dng"), &frame, &dng_info()).unwrap();
    }
    let light = Illuminant::parse("D65").unwrap();
    let made_of = [("scene", "edge".to_owned()), ("scene illuminance", "300 lx".to_owned())];
    let title = "edge through mt9t012";
    simulation::page(title, &camera, Some(&light), &settings, &made_of, &shown).html()
}

/// A sweep of pitch, f-number and light: SNR by shot and read noise, MTF50 by pixel and
/// diffraction.
fn sweep(pitches_um: &[f64], f_numbers: &[f64], lux: &[f64]) -> Vec<Value> {
    let mut records = Vec::new();
    for &pitch in pitches_um {
        for &f_number in f_numbers {
            for &lux in lux {
                let e = 40.0 * lux * (pitch / f_number).powi(2);
                let snr_db = 20.0 * libm::log10(e / (e + 9.0 + (0.01 * e).powi(2)).sqrt());
                let blur = (0.8 * pitch).hypot(0.55 * f_number);
                let mtf50 = 0.5 * pitch / blur;
                let parameters = json!({
                    "camera": "mobile", "scene": "x", "lux": lux, "frame": 0, "exposure_s": 0.033,
                    "camera_keys": { "sensor.pitch_um": pitch, "lens.f_number": f_number }
                });
                let figure = |value: f64, std_error: Option<f64>| json!({ "value": value, "std_error": std_error });
                let sharp = json!({ "mtf50_cycles_per_pixel": figure(mtf50, Some(0.01 * mtf50)) });
                for green in [json!({ "snr_db": figure(snr_db, None) }), sharp] {
                    records.push(json!({ "parameters": parameters, "channels": { "g": green } }));
                }
            }
        }
    }
    records
}

fn traded(choice: Option<&tradeoff::Choice>) -> String {
    let records = sweep(
        &[1.0, 1.4, 2.0, 2.8, 4.0, 5.6],
        &[1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0],
        &[0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0],
    );
    tradeoff::page("Pixel pitch, f-number and light", &records, "[grid]\nlux = 1", choice).html()
}

const TRIPLET: &str = r#"
    format = "camrig-prescription/1"
    name = "Triplet"
    wavelengths_nm = [486.1, 587.6, 656.3]
    fields_deg = [0.0, 8.0]
    [aperture]
    f_number = 5.0
    [[surface]]
    radius_mm = 22.014
    thickness_mm = 3.259
    glass = "1.620:60.3"
    [[surface]]
    radius_mm = -435.76
    thickness_mm = 6.008
    [[surface]]
    radius_mm = -22.213
    thickness_mm = 1.0
    glass = "1.620:36.4"
    [[surface]]
    radius_mm = 20.292
    thickness_mm = 4.75
    stop = true
    [[surface]]
    radius_mm = 79.684
    thickness_mm = 2.952
    glass = "1.620:60.3"
    [[surface]]
    radius_mm = -18.395
    thickness_mm = 42.5
"#;

/// Cooke's triplet (Zemax's sample, EFL 50 mm), of a traced lens and of its tables alone.
fn lenses() -> [String; 2] {
    let prescription = toml::read(TRIPLET, &Catalogue::default()).unwrap();
    let system = System::new(prescription, Conditions::default()).unwrap();
    let plan = Plan {
        heights: 4,
        density: None,
        max_field_deg: 8.0,
        wavelengths_nm: system.prescription.wavelengths_nm.clone(),
        psf_size: 48,
        psf_spacing_um: None,
        method: PsfMethod::Auto,
    };
    let found = characterise::characterise(&system, &plan, &|_, _| ()).unwrap();
    let traced = lens::Traced { system: &system, max_field_deg: 8.0 };
    [
        lens::page(&found, Some(traced), Some(4.0)).unwrap().html(),
        lens::page(&found, None, None).unwrap().html(),
    ]
}

fn edges() -> String {
    let frame = edge_frame(120, 100, [80.0, 600.0], 0.05);
    let plane = Plane { width: frame.width, height: frame.height, data: frame.data.clone() };
    let roi = Roi { x: 20, y: 10, width: 80, height: 80 };
    let of = |c| mtf::measure(&plane, &frame.cfa, c, roi, Some(1023), Some(2.2)).unwrap();
    let edges = ['R', 'G', 'B'].map(of).into();
    measurement::mtf("edge.dng", &mtf::Responses { edges, excluded: Vec::new() }).html()
}

fn transfer() -> String {
    let cfa = Some(Cfa::parse("GRBG").unwrap());
    let sensor = SensorFacts {
        width: 64,
        height: 48,
        bits: 10,
        cfa,
        black_level_dn: Some(42.0),
        white_level_dn: 1023,
        pitch_um: Some(2.2),
        window: None,
    };
    let set = CaptureSet { root: ".".into(), camera: None, sensor, captures: Vec::new() };
    let figures = |i: usize| ptc::Figures {
        system_gain_dn_per_e: Some(Measured::new(0.157 + 1e-3 * noise(i), 2e-3)),
        read_noise_e: Some(Measured::new(4.7, 0.12)),
        full_well_e: Some(Measured::new(6400.0, 40.0)),
        ..ptc::Figures::default()
    };
    let point = |i: usize, gain: f64| {
        let signal_dn = 10.0 * libm::pow(1.6, i as f64);
        let variance = 0.5 + gain * signal_dn;
        ptc::CurvePoint {
            id: format!("flat-{i}"),
            signal_dn,
            variance_dn2: Measured::new(variance * (1.0 + 0.02 * noise(i)), 0.05 * variance),
            used: i < 9,
        }
    };
    let channel = |(i, name): (usize, &str)| ptc::ChannelPtc {
        channel: name.into(),
        figures: figures(i),
        reduced_chi2: 1.0,
        curve: (0..10).map(|k| point(k, 0.157 + 0.01 * i as f64)).collect(),
    };
    let result = ptc::Ptc {
        figures: figures(7),
        channels: ["r", "g", "b"].into_iter().enumerate().map(channel).collect(),
        analog_gain: 1.0,
        dsnu_exposure_s: 1.0,
        notes: vec!["flat-9 is near saturation and left out".into()],
    };
    measurement::ptc(&set, &result).html()
}

#[test]
fn pages_hold_in_browsers() {
    let choice = tradeoff::Choice {
        best: "snr_10_lux".into(),
        need: [("mtf50_cycles_per_mm".to_owned(), 150.0)].into(),
    };
    let [traced, tables] = lenses();
    let pages = [
        ("simulation", simulated([20.0, 300.0], 3)),
        ("simulation-dark", simulated([0.0, 0.0], 1)),
        ("simulation-saturated", simulated([600.0, 2500.0], 1)),
        ("tradeoff", traded(Some(&choice))),
        ("tradeoff-without-choice", traded(None)),
        ("lens", traced),
        ("lens-tables", tables),
        ("mtf", edges()),
        ("ptc", transfer()),
    ];
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR"));
    for (name, page) in &pages {
        // For a look at them.
        std::fs::write(folder.join(format!("{name}.html")), page).unwrap();
        assert!(page.len() < 1_000_000, "{name}: {} bytes", page.len());
    }
    for browser in browser::installed() {
        let found = browser.complaints(&pages).unwrap();
        assert!(found.is_empty(), "{}:\n{}", browser.program.display(), found.join("\n"));
    }
}

#[test]
fn headroom_and_exposure_follow_from_the_brightest_samples() {
    // 80 % of the range above black: log2(1/0.8) = 0.32 EV are left, less what noise takes.
    let top = 0.8 * (1023.0 - 42.0);
    let html = simulated([top, top], 1);
    let shown = |name: &str| {
        let part = html.split(&format!("{name}</span><b class=\"big\">")).nth(1).unwrap();
        part.split('<').next().unwrap().to_owned()
    };
    assert_eq!(shown("Headroom"), "0.3\u{a0}EV");
    assert_eq!(shown("Saturated"), "0.00\u{a0}%");
    let longest: f64 = shown("Longest exposure").split('\u{a0}').next().unwrap().parse().unwrap();
    assert!((longest - 36.0).abs() < 1.5, "noise takes a part of 37.5 ms: {longest}");
    assert!(simulated([2000.0, 2000.0], 1).contains("0.1 % or more is saturated"));
}
