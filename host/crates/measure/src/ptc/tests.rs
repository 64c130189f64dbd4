//! Photon transfer of sensors whose parameters are known.

use super::*;
use crate::synthetic::{Hits, Sensor, Shot};
use rand_xoshiro::rand_core::{Rng, SeedableRng};

fn shots(sensor: &Sensor) -> Vec<Shot> {
    let mut shots = Vec::new();
    for t in [0.001, 0.5, 2.0] {
        shots.push(Shot {
            exposure_s: t,
            rate: 0.0,
            frames: 8,
            temperature_c: 25.0,
            analog_gain: 1.0,
        });
    }
    for t in [0.5, 2.0] {
        shots.push(Shot {
            exposure_s: t,
            rate: 0.0,
            frames: 8,
            temperature_c: 39.0,
            analog_gain: 1.0,
        });
    }
    for k in 1..=10 {
        let electrons = sensor.full_well_e * 0.13 * f64::from(k);
        let rate = electrons / sensor.qe[0] / 0.02;
        shots.push(Shot {
            exposure_s: 0.02,
            rate,
            frames: 4,
            temperature_c: 25.0,
            analog_gain: 1.0,
        });
    }
    shots
}

fn measured(sensor: &Sensor) -> Ptc {
    let directory = tempfile::tempdir().unwrap();
    sensor.write(directory.path(), &shots(sensor));
    measure(&CaptureSet::load(directory.path()).unwrap()).unwrap()
}

/// A random camera, the same for the same seed.
fn random(seed: u64) -> Sensor {
    let mut rng = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(2000 + seed);
    let mut between = |low: f64, high: f64| {
        low + (high - low) * (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    };
    let full_well_e = between(4000.0, 12000.0);
    let black_dn = between(60.0, 200.0).round();
    let read_e = between(2.0, 8.0);
    // Dark currents below 0 are none: they must be rare for their spread to be what was asked for.
    let dark_e_per_s = between(20.0, 80.0);
    Sensor {
        full_well_e,
        black_dn,
        gain: between(0.6, 0.95) * (4095.0 - black_dn) / full_well_e,
        read_e,
        read_post_e: between(0.5, 0.9) * read_e,
        prnu: between(0.005, 0.02),
        row_fpn_e: between(0.5, 2.0),
        dark_e_per_s,
        dsnu_e_per_s: between(0.1, 0.25) * dark_e_per_s,
        qe: [between(0.2, 0.8); 3],
        seed: 100 * seed + 1,
        ..Sensor::default()
    }
}

/// Twenty random cameras: every parameter that captures at one gain determine.
#[test]
fn random_cameras_come_back() {
    let mut hits = Hits::default();
    for seed in 0..20 {
        let sensor = random(seed);
        let f = measured(&sensor).figures;
        hits.add("gain", f.system_gain_dn_per_e, sensor.gain);
        hits.add("read noise", f.read_noise_e, sensor.read_e);
        hits.add("full well", f.full_well_e, sensor.full_well_e);
        hits.add("prnu", f.prnu, sensor.prnu);
        hits.add("dark current", f.dark_current_e_per_s, sensor.dark_e_per_s);
        hits.add("dsnu", f.dsnu_e_per_s, sensor.dsnu_e_per_s);
        hits.add("row fpn", f.row_fpn_e, sensor.row_fpn_e);
        hits.add("black", f.black_level_dn, sensor.black_dn);
        hits.add("efficiency", f.quantum_efficiency, sensor.qe[0]);
        hits.add("doubling", f.dark_doubling_c, 7.0);
    }
    hits.check();
}

/// The same cameras, their response bent by up to 2 % at full well.
#[test]
fn bent_random_cameras_come_back() {
    let mut hits = Hits::default();
    for seed in 0..20 {
        let bend = 0.001 * (seed + 1) as f64;
        let sensor = Sensor { nonlinearity: bend, width: 160, height: 120, ..random(seed) };
        let result = measured(&sensor);
        let f = &result.figures;
        hits.add("gain", f.system_gain_dn_per_e, sensor.gain);
        hits.add("read noise", f.read_noise_e, sensor.read_e);
        hits.add("efficiency", f.quantum_efficiency, sensor.qe[0]);
        // The share lost at the brightest level fitted, which sees a signal S = K (e - bend e²/W).
        let used = result.channels[0].curve.iter().filter(|p| p.used);
        let brightest = used.map(|p| p.signal_dn).fold(0.0, f64::max) / sensor.gain;
        let well = sensor.full_well_e / bend;
        let straight = 0.5 * well * (1.0 - (1.0 - 4.0 * brightest / well).sqrt());
        let lost = 100.0 * (brightest / straight - 1.0);
        hits.add("nonlinearity", f.nonlinearity_percent, lost);
    }
    hits.check();
}

/// The same cameras at four gains: what is added before and after the gain stage, and the gains
/// themselves.
#[test]
fn random_cameras_come_back_over_gains() {
    let mut hits = Hits::default();
    for seed in 0..20 {
        let sensor = random(seed);
        let mut shots = Vec::new();
        for analog_gain in [1.0, 2.0, 4.0, 8.0] {
            for t in [0.001, 0.5] {
                shots.push(Shot {
                    exposure_s: t,
                    rate: 0.0,
                    frames: 16,
                    temperature_c: 25.0,
                    analog_gain,
                });
            }
            for k in 1..=6 {
                let rate =
                    sensor.full_well_e * 0.1 * f64::from(k) / analog_gain / sensor.qe[0] / 0.02;
                shots.push(Shot {
                    exposure_s: 0.02,
                    rate,
                    frames: 6,
                    temperature_c: 25.0,
                    analog_gain,
                });
            }
        }
        let directory = tempfile::tempdir().unwrap();
        sensor.write(directory.path(), &shots);
        let set = CaptureSet::load(directory.path()).unwrap();
        let found = crate::gains::measure(&set).unwrap().unwrap();
        hits.add("read_e", found.read_e, sensor.read_e);
        hits.add("read_e_post", found.read_e_post, sensor.read_post_e);
        for (name, at) in ["gain 2", "gain 4", "gain 8"].into_iter().zip(&found.gains[1..]) {
            hits.add(name, at.gain_ratio, 1.0);
        }
    }
    hits.check();
}

/// Left-justified samples: the same figures in electrons, and a note on the step.
#[test]
fn left_aligned_samples_are_measured_in_their_own_steps() {
    let sensor = Sensor { gain: 0.1, read_e: 5.0, row_fpn_e: 0.0, bits: 10, ..Sensor::default() };
    let whole = measured(&sensor);
    let moved = measured(&Sensor { moved_up: 6, ..sensor });
    type Figure = fn(&Figures) -> Option<Value>;
    let figures: [(&str, f64, Figure); 3] = [
        ("read noise", 1.0, |f| f.read_noise_e),
        ("full well", 1.0, |f| f.full_well_e),
        ("gain", 64.0, |f| f.system_gain_dn_per_e),
    ];
    for (name, scale, get) in figures {
        let (a, b) = (get(&whole.figures).unwrap(), get(&moved.figures).unwrap());
        assert!((b.value / (scale * a.value) - 1.0).abs() < 1e-6, "{name}: {a:?} {b:?}");
    }
    let told = |ptc: &Ptc| ptc.notes.iter().any(|n| n.contains("multiples of 64 DN"));
    assert!(told(&moved) && !told(&whole), "{:?}", moved.notes);
    let hidden = |ptc: &Ptc| ptc.notes.iter().filter(|n| n.contains("not determined")).count();
    assert_eq!(hidden(&moved), hidden(&whole), "{:?} {:?}", moved.notes, whole.notes);
}

/// Two frames of 12 x 8 pixels at six levels: the variances scatter by 14 %, and now and then one
/// lies below 0.7 of those before it. None of the levels is past the full well, so none may be
/// lost; of the brightest, chance takes one in 4000 fits.
#[test]
fn noisy_ladders_lose_no_level_to_chance() {
    let mut lost = 0;
    for seed in 0..60 {
        let sensor = Sensor { width: 12, height: 8, row_fpn_e: 0.0, seed, ..Sensor::default() };
        let level = |rate| Shot {
            exposure_s: 0.02,
            rate,
            frames: 2,
            temperature_c: 25.0,
            analog_gain: 1.0,
        };
        let rate = |k: i32| 0.12 * f64::from(k) * sensor.full_well_e / sensor.qe[0] / 0.02;
        let shots: Vec<Shot> = (0..=6).map(|k| level(rate(k))).collect();
        let directory = tempfile::tempdir().unwrap();
        sensor.write(directory.path(), &shots);
        let result = measure(&CaptureSet::load(directory.path()).unwrap()).unwrap();
        lost += result.channels[0].curve.iter().filter(|p| !p.used).count();
    }
    assert!(lost <= 1, "{lost} of 360 levels lost");
}

/// Four levels beyond the full well, whose variance is gone, are found in a ladder as noisy.
#[test]
fn a_full_well_shows_in_a_noisy_ladder() {
    for seed in 0..20 {
        let sensor = Sensor { width: 24, height: 16, row_fpn_e: 0.0, seed, ..Sensor::default() };
        let level = |share: f64| Shot {
            exposure_s: 0.02,
            rate: share * sensor.full_well_e / sensor.qe[0] / 0.02,
            frames: 2,
            temperature_c: 25.0,
            analog_gain: 1.0,
        };
        let shares = [0.0, 0.2, 0.4, 0.6, 0.8, 1.2, 1.5, 1.8];
        let directory = tempfile::tempdir().unwrap();
        sensor.write(directory.path(), &shares.map(level));
        let result = measure(&CaptureSet::load(directory.path()).unwrap()).unwrap();
        let used: Vec<bool> = result.channels[0].curve.iter().map(|p| p.used).collect();
        assert_eq!(used, [true, true, true, true, false, false, false], "seed {seed}");
    }
}
