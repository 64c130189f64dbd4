//! EMVA figures of real and synthetic sets, compared with those of the `emva1288` package.

use super::*;
use crate::synthetic::{Sensor, Shot};
use camrig_testing::shared;

fn near(found: Option<Value>, expected: f64, tolerance: f64, name: &str) {
    let found = found.unwrap_or_else(|| panic!("{name} not determined")).value;
    assert!((found / expected - 1.0).abs() < tolerance, "{name}: {found}, expected {expected}");
}

/// The real set: its documentation within 2 % (the subset's sampling), and the figures of the
/// `emva1288` package 1.0.2 for the levels with a dark of their exposure time
/// (tests/peers/emva1288_peer.py) within 0.5 %.
#[test]
fn reference_set_and_the_emva1288_package() {
    let Some(root) = shared("data/captures/emva1288_ref001_CCD_12Bit") else { return };
    let mut set = CaptureSet::load(&root).unwrap();
    let whole = measure(&set).unwrap();
    let f = &whole.channels[0].figures;
    near(f.overall_system_gain, 0.2808, 0.02, "K of the documentation");
    near(f.temporal_dark_noise_dn, 3.07, 0.02, "dark noise of the documentation");
    assert!(whole.warnings.iter().any(|w| w.contains("is nonlinear")));

    let darks: Vec<f64> =
        set.with_role(camrig_captures::Role::Dark).map(|c| c.exposure_s).collect();
    set.captures.retain(|c| darks.contains(&c.exposure_s));
    let result = measure(&set).unwrap();
    let f = &result.channels[0].figures;
    near(f.overall_system_gain, 0.285_366, 0.005, "K");
    near(f.quantum_efficiency, 0.445_340, 0.005, "quantum efficiency");
    near(f.responsivity_dn_per_photon, 0.127_085, 0.005, "responsivity");
    near(f.temporal_dark_noise_dn, 3.078_418, 0.005, "dark noise");
    near(f.temporal_dark_noise_e, 10.740_068, 0.005, "dark noise in electrons");
    near(f.saturation_capacity_p, 27_530.0, 0.005, "saturation");
    near(f.dsnu_1288_e, 0.488_336, 0.005, "DSNU");
    // The package has 0.443 for rows and 0.528 for columns, whose squares are twice the total's.
    let parts = [f.dsnu_1288_row_e, f.dsnu_1288_column_e, f.dsnu_1288_pixel_e];
    assert_eq!(parts, [None; 3], "parts above the total");
    let said = |w: &String| w.contains("the parts of DSNU1288 are not determined");
    assert!(result.warnings.iter().any(said), "{:?}", result.warnings);
    near(f.prnu_1288_percent, 0.432_784, 0.005, "PRNU");
    near(f.prnu_1288_row_percent, 0.323_621, 0.005, "PRNU of rows");
    near(f.prnu_1288_column_percent, 0.111_281, 0.005, "PRNU of columns");
    near(f.linearity_error_max_percent, 0.141_651, 0.01, "linearity error");
    // The package leaves the long dark stack out of the line over exposure time; the line's own
    // sampling error is 15 % (4.9 of 31 e⁻/s).
    near(f.dark_current_mean_e_per_s, 29.570, 0.15, "dark current");
}

/// One level, the least that a bench has, gives the closed forms of two points:
/// K = (V_f − V_d)/(µ_f − µ_d), and the patterns of the same stacks. What a saturation would give
/// is not determined, and named.
#[test]
fn one_level_gives_what_it_determines() {
    let sensor = Sensor { gain: 0.25, read_e: 5.0, dsnu_e_per_s: 200.0, ..Sensor::default() };
    let shot = |rate, frames| Shot {
        exposure_s: 0.01,
        rate,
        frames,
        temperature_c: 25.0,
        analog_gain: 1.0,
    };
    let measured = |frames| {
        let directory = tempfile::tempdir().unwrap();
        let rate = 5000.0 / sensor.qe[0] / 0.01;
        sensor.write(directory.path(), &[shot(0.0, frames), shot(rate, frames)]);
        let set = CaptureSet::load(directory.path()).unwrap();
        let [dark, flat] = [0, 1].map(|i| {
            let stack = Stack::read(&set, &set.captures[i]).unwrap();
            stack.channel_moments(0)
        });
        // The photon transfer has the same figure, as there is no slope over levels.
        let result = measure(&set).unwrap();
        let prnu = result.channels[0].figures.prnu_1288_percent.map(|v| v.value);
        let transfer = crate::ptc::measure(&set).unwrap().channels[0].figures.prnu;
        let transfer = transfer.map(|v| 100.0 * v.value);
        assert!(
            prnu == transfer || (prnu.unwrap() / transfer.unwrap() - 1.0).abs() < 1e-12,
            "{prnu:?} {transfer:?}"
        );
        (result, dark, flat)
    };
    let (whole, dark, flat) = measured(16);
    assert!(whole.channels[0].lower_limits().is_empty());
    let f = &whole.channels[0].figures;
    let k = (flat.temporal - dark.temporal) / (flat.mean() - dark.mean());
    near(f.overall_system_gain, k, 1e-12, "K");
    near(f.temporal_dark_noise_e, (dark.temporal - 1.0 / 12.0).sqrt() / k, 1e-12, "dark noise");
    near(f.dsnu_1288_e, dark.spatial().total.value.sqrt() / k, 1e-12, "DSNU");
    for (found, truth) in [
        (f.overall_system_gain, 0.25),
        // Read noise and the shot noise of 40 e⁻/s in 10 ms.
        (f.temporal_dark_noise_e, 25.4f64.sqrt()),
        (f.prnu_1288_percent, 100.0 * sensor.prnu),
    ] {
        let found = found.unwrap();
        assert!((found.value - truth).abs() < 4.0 * found.std_error, "{found:?}, {truth}");
        assert!(found.std_error < 0.05 * truth, "{found:?}");
    }
    let snr = whole.channels[0].levels[0].snr_db.unwrap();
    let closed = 20.0 * ((flat.mean() - dark.mean()) / flat.temporal.sqrt()).log10();
    near(Some(snr), closed, 1e-12, "SNR");
    assert_eq!((f.saturation_capacity_e, f.dynamic_range_db, f.snr_max), (None, None, None));
    let said = |w: &String| w.contains("no saturation capacity, maximum SNR, dynamic range");
    assert!(whole.warnings.iter().any(said), "{:?}", whole.warnings);

    // A pair of each has no spatial figures, and the gain to its own error.
    let (pair, ..) = measured(2);
    let f = &pair.channels[0].figures;
    let k = f.overall_system_gain.unwrap();
    assert!((k.value - 0.25).abs() < 4.0 * k.std_error && k.std_error < 0.02, "{k:?}");
    assert_eq!((f.dsnu_1288_e, f.prnu_1288_percent), (None, None));
    assert!(pair.warnings.iter().any(|w| w.contains("no DSNU and PRNU")), "{:?}", pair.warnings);
}

#[test]
fn levels_below_saturation_give_lower_limits() {
    let sensor = Sensor::default();
    let directory = tempfile::tempdir().unwrap();
    let shot = |electrons: f64| Shot {
        exposure_s: 0.01,
        rate: electrons / sensor.qe[0] / 0.01,
        frames: 4,
        temperature_c: 25.0,
        analog_gain: 1.0,
    };
    let full = sensor.full_well_e;
    sensor.write(directory.path(), &[0.0, 0.1, 0.2, 0.3].map(|part| shot(part * full)));
    let result = measure(&CaptureSet::load(directory.path()).unwrap()).unwrap().json().unwrap();
    for object in [&serde_json::json!(result), &result["channels"]["m"]] {
        let limits = object["lower_limits"].as_array().unwrap();
        assert!(limits.contains(&"dynamic_range_db".into()), "{limits:?}");
        assert!(
            limits.iter().all(|name| object[name.as_str().unwrap()].is_object()
                || name == "saturation_capacity_p")
        );
    }
}

/// Where rounding hides the dark noise, the threshold is an upper limit and has no error.
#[test]
fn hidden_noise_gives_no_error() {
    let (k, largest) = (Value::new(0.25, 0.001), Value::new(4000.0, 0.01));
    let of = |variance| {
        let dark = Value::new(variance, 0.01);
        [threshold_e(dark, 1.0, k), dynamic_range(largest, dark, 1.0, k)]
    };
    assert!(of(0.3).iter().all(|v| v.std_error > 0.0));
    assert!(of(0.1).iter().all(|v| v.std_error.is_nan()));
}

/// Exposure times of one light that is not stated: linearity over them; of levels at one exposure,
/// none.
#[test]
fn linearity_over_exposure_time_where_photons_are_unknown() {
    let sensor = Sensor { nonlinearity: 0.04, ..Sensor::default() };
    let directory = tempfile::tempdir().unwrap();
    let shot = |exposure_s: f64, rate| Shot {
        exposure_s,
        rate,
        frames: 4,
        temperature_c: 25.0,
        analog_gain: 1.0,
    };
    let full = sensor.full_well_e / sensor.qe[0];
    let times = (1..=11).map(|k| 0.01 * f64::from(k));
    let mut shots = vec![shot(0.01, 0.0), shot(0.05, 0.0), shot(0.1, 0.0)];
    shots.extend(times.map(|t| shot(t, full / 0.1)));
    sensor.write(directory.path(), &shots);
    let manifest = directory.path().join("captures.toml");
    let known = measure(&CaptureSet::load(directory.path()).unwrap()).unwrap();
    let text = std::fs::read_to_string(&manifest).unwrap();
    let rates = |line: &&str| !line.contains("photons_per_pixel_per_s");
    let unknown = text.lines().filter(rates).collect::<Vec<_>>().join("\n");
    std::fs::write(&manifest, unknown).unwrap();
    let found = measure(&CaptureSet::load(directory.path()).unwrap()).unwrap();
    let of = |checked: &Checked| checked.channels[0].figures.linearity_error_percent;
    near(of(&found), of(&known).unwrap().value, 1e-9, "linearity error");
    assert!(found.warnings.iter().any(|w| w.contains("over exposure time")));
    assert_eq!(found.channels[0].figures.responsivity_dn_per_photon, None);
}

fn shots(sensor: &Sensor) -> Vec<Shot> {
    let dark = |exposure_s, frames| Shot {
        exposure_s,
        rate: 0.0,
        frames,
        temperature_c: 25.0,
        analog_gain: 1.0,
    };
    let mut out = vec![dark(0.02, 2), dark(0.1, 2), dark(0.2, 2), dark(0.02, 16)];
    let rate = sensor.full_well_e / sensor.qe[0] / 0.02;
    let flat = |fill: f64, frames| Shot {
        exposure_s: 0.02,
        rate: fill * rate,
        frames,
        temperature_c: 25.0,
        analog_gain: 1.0,
    };
    out.extend((1..=22).map(|k| flat(0.05 * f64::from(k), 2)));
    out.push(flat(0.501, 16));
    out
}

fn measured(sensor: &Sensor) -> Checked {
    let directory = tempfile::tempdir().unwrap();
    sensor.write(directory.path(), &shots(sensor));
    measure(&CaptureSet::load(directory.path()).unwrap()).unwrap()
}

/// A hidden non-linearity of 2 % at full well: the standard's K is biased, with a warning.
#[test]
fn a_hidden_nonlinearity_causes_a_warning() {
    let honest = Sensor { width: 256, height: 192, dark_e_per_s: 20.0, ..Sensor::default() };
    let straight = measured(&honest);
    let f = &straight.channels[0].figures;
    near(f.overall_system_gain, 0.4, 0.005, "K");
    near(f.temporal_dark_noise_e, 4.0, 0.01, "dark noise");
    near(f.prnu_1288_percent, 1.0, 0.02, "PRNU");
    assert!(
        !straight.warnings.iter().any(|w| w.contains("is nonlinear")),
        "{:?}",
        straight.warnings
    );
    let bent = measured(&Sensor { nonlinearity: 0.02, ..honest });
    let f = &bent.channels[0].figures;
    let off = f.overall_system_gain.unwrap().value / 0.4 - 1.0;
    assert!(off < -0.015, "{off}");
    near(f.linearised_system_gain, 0.4, 0.01, "linearised K");
    assert!(bent.warnings.iter().any(|w| w.contains("is nonlinear")), "{:?}", bent.warnings);
}

#[test]
fn what_cannot_be_measured_is_refused() {
    let sensor = Sensor { width: 32, height: 32, ..Sensor::default() };
    let directory = tempfile::tempdir().unwrap();
    let said = |shots: &[Shot]| {
        sensor.write(directory.path(), shots);
        let set = CaptureSet::load(directory.path()).unwrap();
        measure(&set).unwrap_err().to_string()
    };
    let dark = |frames| Shot {
        exposure_s: 0.02,
        rate: 0.0,
        frames,
        temperature_c: 25.0,
        analog_gain: 1.0,
    };
    let flat = |rate, frames| Shot {
        exposure_s: 0.02,
        rate,
        frames,
        temperature_c: 25.0,
        analog_gain: 1.0,
    };
    assert!(said(&[dark(2)]).contains("no flat captures"));
    assert!(said(&[flat(1e4, 2)]).contains("no dark captures"));
    assert!(said(&[dark(1), flat(1e4, 2)]).contains("one frame"));
    assert!(said(&[dark(2), flat(1e4, 2), flat(2e4, 1), flat(3e4, 2)]).contains("one frame"));
    assert!(said(&[dark(2), flat(1e7, 2)]).contains("does not grow with the signal"));
    let saturated = [dark(2), flat(1e7, 2), flat(2e7, 2), flat(3e7, 2)];
    assert!(said(&saturated).contains("70 % of saturation"));
    // Mismatched sizes and a black level that the darks contradict.
    sensor.write(directory.path(), &[dark(2), flat(1e4, 2)]);
    let manifest = directory.path().join("captures.toml");
    let text = std::fs::read_to_string(&manifest).unwrap();
    let changed = |from: &str, to: &str| {
        std::fs::write(&manifest, text.replace(from, to)).unwrap();
        measure(&CaptureSet::load(directory.path()).unwrap()).unwrap_err().to_string()
    };
    assert!(changed("width = 32", "width = 31").contains("a frame of 32 x 32"));
    assert!(
        changed("black_level_dn = 64.0", "black_level_dn = 500.0").contains("darker than black")
    );
    let narrow = text.replace("bits = 12", "bits = 6");
    let narrow = narrow.replace("black_level_dn = 64.0", "black_level_dn = 10.0");
    std::fs::write(&manifest, narrow).unwrap();
    let said = measure(&CaptureSet::load(directory.path()).unwrap()).unwrap_err().to_string();
    assert!(said.contains("DN in 6 bits"), "{said}");
}

/// Left-justified samples: the same figures in electrons, and a note on the step.
#[test]
fn left_aligned_samples_are_measured_in_their_own_steps() {
    let figures = |moved_up| {
        let sensor = Sensor { gain: 0.15, read_e: 5.0, bits: 10, moved_up, ..Sensor::default() };
        let directory = tempfile::tempdir().unwrap();
        sensor.write(directory.path(), &shots(&sensor));
        let result = measure(&CaptureSet::load(directory.path()).unwrap()).unwrap();
        let told = result.warnings.iter().any(|w| w.contains("multiples of 64 DN"));
        let f = result.channels[0].figures.clone();
        (f.temporal_dark_noise_e, f.absolute_sensitivity_threshold_e, told)
    };
    let ((whole, threshold, untold), (moved, moved_threshold, told)) = (figures(0), figures(6));
    near(moved, whole.unwrap().value, 1e-9, "dark noise");
    near(moved_threshold, threshold.unwrap().value, 1e-9, "threshold");
    assert!(told && !untold);
}

/// Shots of a sensor whose green saturates first: one dark and 24 flats to three times its full
/// well or white level, of eight frames each.
fn colours(green: f64, frames: impl Fn(u32) -> usize) -> Vec<Shot> {
    let shot = |rate, frames| Shot {
        exposure_s: 0.02,
        rate,
        frames,
        temperature_c: 25.0,
        analog_gain: 1.0,
    };
    let mut shots = vec![shot(0.0, 8)];
    shots.extend((1..=24).map(|k| shot(green / 8.0 * f64::from(k) / 0.02, frames(k))));
    shots
}

/// Red and blue see a half of what green does; the PRNU of each is 2 %. Green saturates at the
/// white level, and at a full well below it.
#[test]
fn the_prnu_of_a_colour_that_saturates_first_is_right() {
    let full_wells = [(1e9, 4031.0), (2500.0, 2500.0)];
    for (full_well_e, green) in full_wells {
        let sensor = Sensor {
            cfa: "RGGB",
            gain: 1.0,
            prnu: 0.02,
            full_well_e,
            qe: [0.46, 1.0, 0.6],
            row_fpn_e: 0.0,
            ..Sensor::default()
        };
        let directory = tempfile::tempdir().unwrap();
        let measured = |shots: &[Shot]| {
            sensor.write(directory.path(), shots);
            measure(&CaptureSet::load(directory.path()).unwrap()).unwrap()
        };
        for channel in measured(&colours(green, |_| 8)).channels {
            // 1536 pixels of a colour determine it to 1.8 %.
            near(channel.figures.prnu_1288_percent, 2.0, 0.08, &channel.channel);
        }
        // The one long stack lies at 1.5 times what saturates green, 0.9 of blue's saturation.
        let late = measured(&colours(green, |k| if k == 12 { 8 } else { 2 }));
        let [red, lit, blue] = &late.channels[..] else { panic!("three channels") };
        assert_eq!(lit.figures.prnu_1288_percent, None);
        assert!(lit.histogram_dsnu.is_some() && lit.spectrogram_prnu.is_none());
        for channel in [red, blue] {
            near(channel.figures.prnu_1288_percent, 2.0, 0.08, &channel.channel);
        }
        let said = |w: &String| w.starts_with("channel g: PRNU1288 is not determined");
        assert!(late.warnings.iter().any(said), "{:?}", late.warnings);
    }
}
