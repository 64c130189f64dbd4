//! Photon transfer of sensors whose parameters are known.

use super::*;
use crate::measure::synthetic::{Sensor, Shot};
use rand_xoshiro::rand_core::{Rng, SeedableRng};

fn shots(sensor: &Sensor) -> Vec<Shot> {
    let mut shots = Vec::new();
    for t in [0.001, 0.5, 2.0] {
        shots.push(Shot { exposure_s: t, rate: 0.0, frames: 8, temperature_c: 25.0 });
    }
    for t in [0.5, 2.0] {
        shots.push(Shot { exposure_s: t, rate: 0.0, frames: 8, temperature_c: 39.0 });
    }
    for k in 1..=10 {
        let electrons = sensor.full_well_e * 0.13 * f64::from(k);
        let rate = electrons / sensor.qe[0] / 0.02;
        shots.push(Shot { exposure_s: 0.02, rate, frames: 4, temperature_c: 25.0 });
    }
    shots
}

fn measured(sensor: &Sensor) -> Ptc {
    let directory = tempfile::tempdir().unwrap();
    sensor.write(directory.path(), &shots(sensor));
    measure(&CaptureSet::load(directory.path()).unwrap()).unwrap()
}

/// Twenty random cameras: every parameter within two standard errors in 90 to 98 % of all
/// cases (95.4 % is what two standard errors mean).
#[test]
fn random_cameras_come_back() {
    let mut rng = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(20);
    let mut between = |low: f64, high: f64| {
        low + (high - low) * (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut hits: std::collections::BTreeMap<&str, (u32, u32)> = Default::default();
    for seed in 0..20 {
        let bits = 12;
        let full_well_e = between(4000.0, 12000.0);
        let black_dn = between(60.0, 200.0).round();
        let sensor = Sensor {
            bits,
            full_well_e,
            black_dn,
            gain: between(0.6, 0.95) * (4095.0 - black_dn) / full_well_e,
            read_e: between(2.0, 8.0),
            prnu: between(0.005, 0.02),
            row_fpn_e: between(0.5, 2.0),
            dark_e_per_s: between(20.0, 80.0),
            dsnu_e_per_s: between(3.0, 10.0),
            qe: [between(0.2, 0.8); 3],
            seed: 100 * seed + 1,
            ..Sensor::default()
        };
        let f = measured(&sensor).figures;
        let truths = [
            ("gain", f.system_gain_dn_per_e, sensor.gain),
            ("read noise", f.read_noise_e, sensor.read_e),
            ("full well", f.full_well_e, sensor.full_well_e),
            ("prnu", f.prnu, sensor.prnu),
            ("dark current", f.dark_current_e_per_s, sensor.dark_e_per_s),
            ("dsnu", f.dsnu_e_per_s, sensor.dsnu_e_per_s),
            ("row fpn", f.row_fpn_e, sensor.row_fpn_e),
            ("black", f.black_level_dn, sensor.black_dn),
            ("efficiency", f.quantum_efficiency, sensor.qe[0]),
            ("doubling", f.dark_doubling_c, 7.0),
        ];
        for (name, found, truth) in truths {
            let found = found.unwrap_or_else(|| panic!("{name} not determined: {f:?}"));
            let z = (found.value - truth) / found.std_error;
            let entry = hits.entry(name).or_default();
            entry.1 += 1;
            entry.0 += u32::from(z.abs() <= 2.0);
            println!(
                "{seed} {name}: {:.5} ± {:.5}, truth {truth:.5}, z {z:.2}",
                found.value, found.std_error
            );
        }
    }
    let total: (u32, u32) = hits.values().fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    let share = f64::from(total.0) / f64::from(total.1);
    println!("{hits:?} {share:.3}");
    assert!((0.90..=0.98).contains(&share), "{share} {hits:?}");
}
