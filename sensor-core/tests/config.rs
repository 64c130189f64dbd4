//! What [`SensorConfig::check`] accepts and refuses, and in which words.

mod common;

use camrig_sensor_core::arith::{BLOCK, Float};
use camrig_sensor_core::collect::Collector;
use camrig_sensor_core::config::MAX_WINDOWS;
use camrig_sensor_core::config::{ConfigError, SensorConfig};
use camrig_sensor_core::effects::*;
use camrig_sensor_core::pipeline::{Pipeline, memory_blocks};
use common::*;

fn check(effects: &[Effect]) -> Result<(), ConfigError> {
    monochrome(8, 2, effects).check()
}

/// An effect with each parameter at its default, or else its least value.
fn plain(entry: &Entry) -> Effect {
    let values: Vec<f32> = entry.parameters.iter().map(|p| p.default.unwrap_or(p.min)).collect();
    Effect::new(entry.id, &values).expect(entry.kind)
}

#[test]
fn domains_must_not_fall_along_the_chain() {
    for a in catalogue() {
        for b in catalogue() {
            let result = check(&[plain(a), plain(b)]);
            // What changes light comes before its shot noise.
            let is_late = a.kind == "shot-noise" && b.domain == Domain::Light;
            if a.domain <= b.domain && (!is_late || b.class == Class::Shot) {
                assert_eq!(result, Ok(()), "{} then {}", a.kind, b.kind);
            } else {
                let order = ConfigError::Order {
                    position: 1,
                    effect: (b, b.domain),
                    after: (a, a.domain),
                };
                assert_eq!(result, Err(order), "{} then {}", a.kind, b.kind);
            }
        }
    }
}

#[test]
fn order_within_a_domain_is_free() {
    let (a, b) = (prnu::Prnu { sigma: 0.01 }.into(), black_sun::BlackSun { onset: 10.0 }.into());
    assert_eq!(check(&[a, b]), Ok(()));
    assert_eq!(check(&[b, a]), Ok(()));
}

#[test]
fn every_range_is_accepted_to_its_ends() {
    for entry in catalogue() {
        for end in [|p: &Parameter| p.min, |p: &Parameter| p.max] {
            let values: Vec<f32> = entry.parameters.iter().map(end).collect();
            let effect = Effect::new(entry.id, &values).expect(entry.kind);
            assert_eq!(check(&[effect]), Ok(()), "{}", entry.kind);
        }
    }
}

/// Fields are public, so values that `Effect::new` refuses can be written down.
#[test]
fn a_parameter_out_of_its_range_is_named() {
    let shot: Effect = shot_noise::ShotNoise {}.into();
    let cases: [(Effect, &str, f32); 6] = [
        (prnu::Prnu { sigma: f32::NAN }.into(), "sigma", f32::NAN),
        (prnu::Prnu { sigma: 0.15 }.into(), "sigma", 0.15),
        (prnu::Prnu { sigma: -1e-9 }.into(), "sigma", -1e-9),
        (
            full_well::FullWell { full_well_e: f32::INFINITY, knee: 0.0 }.into(),
            "full_well_e",
            f32::INFINITY,
        ),
        (full_well::FullWell { full_well_e: 1e4, knee: 0.6 }.into(), "knee", 0.6),
        (read_noise::ReadNoise { read_e: 3.0, read_e_post: -1.0 }.into(), "read_e_post", -1.0),
    ];
    for (bad, key, bad_value) in cases {
        match check(&[shot, bad]) {
            Err(ConfigError::Parameter { position: 1, effect, parameter, value }) => {
                assert_eq!((effect, parameter.key), (bad.entry(), key));
                assert_eq!(value.to_bits(), bad_value.to_bits());
            }
            other => panic!("{bad:?}: {other:?}"),
        }
    }
}

#[test]
fn messages_say_what_where_and_what_is_accepted() {
    let shot: Effect = shot_noise::ShotNoise {}.into();
    let said = |effects: &[Effect]| check(effects).unwrap_err().to_string();
    assert_eq!(
        said(&[shot, read_noise::ReadNoise { read_e: -2.0, read_e_post: 0.0 }.into()]),
        "effect 1 (read-noise): read_e = -2; it must be 0 to 100000 e-"
    );
    assert_eq!(
        said(&[read_noise::ReadNoise { read_e: 2.0, read_e_post: 0.0 }.into(), shot]),
        "effect 1 (shot-noise) acts on light, but follows read-noise, which acts on voltage; the \
         order is light, shot noise, photo-electrons, charge, voltage"
    );
    let coupling = charge_coupling::ChargeCoupling { side: 0.01, vertical: 0.0, diagonal: 0.0 };
    assert_eq!(
        said(&[coupling.into(); MAX_WINDOWS + 1]),
        "5 effects read neighbouring rows; a chain takes at most 4"
    );
}

#[test]
fn other_figures_out_of_range_are_refused() {
    let with = |change: fn(&mut SensorConfig)| {
        let mut config = monochrome(8, 2, &[]);
        change(&mut config);
        config
    };
    let cases: [(SensorConfig, ConfigError); 8] = [
        (with(|c| c.width = 0), ConfigError::Size),
        (with(|c| c.channels = 0), ConfigError::Pattern),
        (with(|c| c.first_band_nm = f32::NAN), ConfigError::Bands),
        (with(|c| c.band_step_nm = f32::INFINITY), ConfigError::Bands),
        (with(|c| c.bands = 2), ConfigError::Response),
        (with(|c| c.full_well_e = f32::NAN), ConfigError::Converter),
        (with(|c| c.bits = 7), ConfigError::Converter),
        (with(|c| c.black_level_dn = 65_535.0), ConfigError::Converter),
    ];
    for (config, error) in cases {
        assert_eq!(config.check(), Err(error), "{config:?}");
        assert!(!error.to_string().is_empty());
    }
}

#[test]
fn pipeline_and_collector_check_first() {
    let bad = monochrome(8, 2, &[prnu::Prnu { sigma: f32::NAN }.into()]);
    let mut memory = vec![[0.0; BLOCK]; memory_blocks(&bad)];
    let pipeline = Pipeline::<Float>::new(&bad, &SETTINGS, &mut memory).map(|_| ());
    assert!(matches!(pipeline, Err(ConfigError::Parameter { .. })));
    let collector = Collector::<Float>::new(&bad, &SETTINGS, None).map(|_| ());
    assert!(matches!(collector, Err(ConfigError::Parameter { .. })));
    let good = monochrome(8, 2, &[]);
    let pipeline = Pipeline::<Float>::new(&good, &SETTINGS, &mut []).map(|_| ());
    assert_eq!(pipeline, Err(ConfigError::Memory));
}
