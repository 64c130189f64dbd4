//! The catalogue under any choice of features. Runs with every choice: `cargo test -p
//! camrig-sensor-core --no-default-features --features hot-pixels --test features`.

use camrig_sensor_core::effects::Effect;

/// Largest number of the base model, which every build has.
const BASE: u8 = 7;

#[test]
fn the_base_model_is_always_there() {
    assert!(Effect::CATALOGUE.iter().take(BASE.into()).map(|e| e.id).eq(1..=BASE));
}

#[test]
fn the_catalogue_is_what_can_be_made() {
    for id in 0..=u8::MAX {
        let Some(entry) = Effect::CATALOGUE.iter().find(|e| e.id == id) else {
            for parameters in 0..=8 {
                assert_eq!(Effect::new(id, &vec![0.5; parameters]), None, "{id}");
            }
            continue;
        };
        let values: Vec<f32> = entry.parameters.iter().map(|p| p.min).collect();
        let effect = Effect::new(id, &values).expect(entry.kind);
        assert_eq!(effect.entry(), entry);
    }
}

/// `catalogue` has every effect beyond the base model but the one that is not the same on every
/// machine. That each feature has the name of its effect is checked where the catalogue is
/// declared.
#[test]
#[cfg(feature = "catalogue")]
fn the_feature_catalogue_has_every_effect() {
    let manifest = include_str!("../Cargo.toml");
    let features = manifest.split_once("\n[features]").expect("features").1;
    let features = features.split_once("\n[").expect("their end").0;
    let (list, rest) = features
        .split_once("catalogue = [")
        .expect("the feature")
        .1
        .split_once(']')
        .expect("its end");
    let listed: Vec<&str> = list.split('"').skip(1).step_by(2).collect();
    let own: Vec<&str> =
        rest.lines().filter_map(|line| line.split_once(" = []")).map(|(name, _)| name).collect();
    let beyond = Effect::CATALOGUE.iter().filter(|e| e.id > BASE && e.kind != "exact-shot-noise");
    let kinds: Vec<&str> = beyond.map(|e| e.kind).collect();
    assert_eq!((listed, own), (kinds.clone(), kinds));
}
