//! The catalogue of effects is sound, and any effect at any corner of its ranges yields a frame.

mod common;

use camrig_sensor_core::arith::Arith;
use camrig_sensor_core::config::FrameSettings;
use camrig_sensor_core::effects::{Effect, MAX_PARAMETERS};
use common::*;
use std::collections::BTreeSet;

in_both_arithmetics! { corners_of_the_ranges_give_frames }

#[test]
fn entries_are_sound() {
    let mut kinds = BTreeSet::new();
    for entry in Effect::CATALOGUE {
        assert!(kinds.insert(entry.kind), "{} is there twice", entry.kind);
        assert!(entry.kind.chars().all(|c| c.is_ascii_lowercase() || c == '-'), "{}", entry.kind);
        assert!(entry.doc.trim().len() > 40, "{} is not described", entry.kind);
        assert!(entry.doc.contains("\n Closed form: "), "{}: no closed form", entry.kind);
        assert!(entry.doc.contains("\n Source: "), "{}: no source", entry.kind);
        assert!(entry.parameters.len() <= MAX_PARAMETERS, "{}", entry.kind);
        for p in entry.parameters {
            let what = format!("{} of {}", p.key, entry.kind);
            assert!(!p.doc.trim().is_empty() && !p.unit.is_empty(), "{what}");
            assert!(p.min.is_finite() && p.max.is_finite() && p.min < p.max, "{what}");
            assert!(p.default.is_none_or(|d| (p.min..=p.max).contains(&d)), "{what}");
        }
    }
}

/// Each effect has a test of its name against its closed form, in both arithmetics.
#[test]
fn every_effect_has_its_test() {
    let lists = [
        include_str!("noise_laws.rs"),
        include_str!("effects_noise.rs"),
        include_str!("effects_pattern.rs"),
    ];
    let is_tested = |name: &str| {
        lists.iter().any(|file| {
            let list = file.split("in_both_arithmetics! {").nth(1).unwrap().split('}').next();
            list.unwrap().split_whitespace().any(|test| test == name)
        })
    };
    // That one has the file `empirical.rs`.
    for entry in catalogue().filter(|e| e.kind != "exact-shot-noise") {
        assert!(is_tested(&entry.kind.replace('-', "_")), "{}", entry.kind);
    }
}

/// Effects with all parameters at one end.
fn corners() -> impl Iterator<Item = Effect> {
    catalogue().flat_map(|entry| {
        let least: Vec<f32> = entry.parameters.iter().map(|p| p.min).collect();
        let most: Vec<f32> = entry.parameters.iter().map(|p| p.max).collect();
        let mixed: Vec<f32> = least.iter().zip(&most).map(|(a, b)| a + 0.37 * (b - a)).collect();
        [least, most, mixed].map(|v| Effect::new(entry.id, &v).expect(entry.kind))
    })
}

#[test]
fn effects_survive_the_wire() {
    for effect in corners() {
        let bytes = postcard::to_allocvec(&effect).unwrap();
        assert_eq!(postcard::from_bytes::<Effect>(&bytes).unwrap(), effect);
        assert_eq!(Effect::new(effect.entry().id, &effect.values()), Some(effect));
    }
}

#[test]
fn what_is_no_effect_is_refused() {
    assert_eq!(Effect::new(0, &[]), None);
    assert_eq!(Effect::new(255, &[]), None);
    for entry in Effect::CATALOGUE.iter().filter(|e| !e.parameters.is_empty()) {
        let with = |v: f32| {
            let mut values: Vec<f32> = entry.parameters.iter().map(|p| p.min).collect();
            values[0] = v;
            Effect::new(entry.id, &values)
        };
        let first = entry.parameters[0];
        for v in [f32::NAN, f32::INFINITY, first.min - 1.0, first.max * 1.01 + 1.0] {
            assert_eq!(with(v), None, "{} of {} = {v}", first.key, entry.kind);
        }
        // The last parameters may be missing where they have a default.
        let needed = entry.parameters.iter().rposition(|p| p.default.is_none());
        let values: Vec<f32> =
            entry.parameters.iter().map(|p| p.default.unwrap_or(p.min)).collect();
        let shortest = needed.map_or(0, |last| last + 1);
        let whole = Effect::new(entry.id, &values);
        assert_eq!(Effect::new(entry.id, &values[..shortest]), whole, "{}", entry.kind);
        if let Some(last) = needed {
            assert_eq!(Effect::new(entry.id, &values[..last]), None, "{}", entry.kind);
        }
        assert_eq!(Effect::new(entry.id, &[values, vec![0.0]].concat()), None, "{}", entry.kind);
    }
    // Number 2 with a value out of range, as a device might get it.
    let bytes = postcard::to_allocvec(&(2u8, vec![9.0f32])).unwrap();
    assert!(postcard::from_bytes::<Effect>(&bytes).is_err());
}

fn corners_of_the_ranges_give_frames<A: Arith>() {
    let scenes = [0.0, 7.0, 3000.0, 5e5];
    let settings = [
        SETTINGS,
        FrameSettings::new(1e-9).with_frame(u32::MAX).with_gain(1e-3).with_temperature(-273.0),
        FrameSettings::new(1e6).with_gain(1e6).with_temperature(1e4),
    ];
    for effect in corners() {
        for settings in settings {
            for config in [monochrome(1, 1, &[effect]), bayer(67, 3, &[effect])] {
                for mean in scenes {
                    let dn = frame::<A>(&config, &settings, &mut Means(|_, _| mean));
                    assert_eq!(dn.len(), (config.width * config.height) as usize);
                }
            }
        }
    }
}
