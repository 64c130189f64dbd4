//! The catalogue under any choice of features: each effect is there exactly with its own feature,
//! and its number never changes. Runs with every choice: `cargo test -p camrig-sensor-core
//! --no-default-features --features hot-pixels --test features`.

use camrig_sensor_core::effects::Effect;

/// Number, name, and whether this build has it. Numbers name random streams and travel over the
/// link, so this list only grows.
const fn expected() -> [(u8, &'static str, bool); 50] {
    [
        (1, "shot-noise", true),
        (2, "prnu", true),
        (3, "dark-current", true),
        (4, "full-well", true),
        (5, "row-offset-fpn", true),
        (6, "read-noise", true),
        (7, "charge-coupling", true),
        (8, "hot-pixels", cfg!(feature = "hot-pixels")),
        (9, "defective-pixels", cfg!(feature = "defective-pixels")),
        (10, "stuck-pixels", cfg!(feature = "stuck-pixels")),
        (11, "row-temporal-noise", cfg!(feature = "row-temporal-noise")),
        (12, "column-offset-fpn", cfg!(feature = "column-offset-fpn")),
        (13, "column-temporal-noise", cfg!(feature = "column-temporal-noise")),
        (14, "row-correlated-noise", cfg!(feature = "row-correlated-noise")),
        (15, "periodic-pattern-noise", cfg!(feature = "periodic-pattern-noise")),
        (16, "read-noise-spread", cfg!(feature = "read-noise-spread")),
        (17, "random-telegraph-noise", cfg!(feature = "random-telegraph-noise")),
        (18, "heavy-tailed-read-noise", cfg!(feature = "heavy-tailed-read-noise")),
        (19, "reset-noise", cfg!(feature = "reset-noise")),
        (20, "frame-offset-noise", cfg!(feature = "frame-offset-noise")),
        (21, "readout-channel-mismatch", cfg!(feature = "readout-channel-mismatch")),
        (22, "readout-channel-crosstalk", cfg!(feature = "readout-channel-crosstalk")),
        (23, "pixel-offset-fpn", cfg!(feature = "pixel-offset-fpn")),
        (24, "amp-glow", cfg!(feature = "amp-glow")),
        (25, "dark-current-gradient", cfg!(feature = "dark-current-gradient")),
        (26, "black-level-offset", cfg!(feature = "black-level-offset")),
        (27, "column-gain-fpn", cfg!(feature = "column-gain-fpn")),
        (28, "prnu-low-frequency", cfg!(feature = "prnu-low-frequency")),
        (29, "nonlinearity", cfg!(feature = "nonlinearity")),
        (30, "brighter-fatter", cfg!(feature = "brighter-fatter")),
        (31, "optical-crosstalk", cfg!(feature = "optical-crosstalk")),
        (32, "adc-nonlinearity", cfg!(feature = "adc-nonlinearity")),
        (33, "companding", cfg!(feature = "companding")),
        (34, "image-lag", cfg!(feature = "image-lag")),
        (35, "black-sun", cfg!(feature = "black-sun")),
        (36, "exposure-offset", cfg!(feature = "exposure-offset")),
        (37, "fringing", cfg!(feature = "fringing")),
        (38, "green-imbalance", cfg!(feature = "green-imbalance")),
        (39, "pdaf-pattern", cfg!(feature = "pdaf-pattern")),
        (40, "flicker-banding", cfg!(feature = "flicker-banding")),
        (41, "light-flicker", cfg!(feature = "light-flicker")),
        (42, "colour-shading", cfg!(feature = "colour-shading")),
        (43, "relative-illumination", cfg!(feature = "relative-illumination")),
        (44, "offset-clipping", cfg!(feature = "offset-clipping")),
        (45, "blooming", cfg!(feature = "blooming")),
        (46, "exact-shot-noise", cfg!(feature = "exact-shot-noise")),
        (47, "system-gain", cfg!(feature = "system-gain")),
        (48, "quantum-efficiency", cfg!(feature = "quantum-efficiency")),
        (49, "prnu-correlated", cfg!(feature = "prnu-correlated")),
        (50, "empirical", cfg!(feature = "empirical")),
    ]
}

#[test]
fn effects_are_there_with_their_features() {
    let want: Vec<(u8, &str)> =
        expected().into_iter().filter(|(_, _, on)| *on).map(|(id, kind, _)| (id, kind)).collect();
    let got: Vec<(u8, &str)> = Effect::CATALOGUE.iter().map(|e| (e.id, e.kind)).collect();
    assert_eq!(got, want);
}

#[test]
fn the_bit_set_of_the_handshake_tells_each_effect() {
    for (id, kind, on) in expected() {
        assert_eq!(Effect::AVAILABLE >> id & 1 == 1, on, "{kind}");
    }
    assert_eq!(Effect::AVAILABLE.count_ones() as usize, Effect::CATALOGUE.len());
}

#[test]
fn an_effect_that_is_not_compiled_in_is_refused() {
    for entry in Effect::CATALOGUE {
        let values: Vec<f32> = entry.parameters.iter().map(|p| p.min).collect();
        assert!(Effect::new(entry.id, &values).is_some(), "{}", entry.kind);
    }
    for (id, kind, _) in expected().into_iter().filter(|(_, _, on)| !on) {
        for parameters in 0..=8 {
            assert_eq!(Effect::new(id, &vec![0.5; parameters]), None, "{kind}");
        }
    }
}

/// Every optional effect has a feature of its name, and `catalogue` has them all but the exact
/// method.
#[test]
fn the_manifest_lists_every_effect() {
    let manifest = include_str!("../Cargo.toml");
    let (_, rest) = manifest.split_once("catalogue = [").expect("the feature");
    let (list, _) = rest.split_once(']').expect("its end");
    let listed: Vec<&str> = list.split('"').skip(1).step_by(2).collect();
    let base = ["shot-noise", "prnu", "dark-current", "full-well", "row-offset-fpn", "read-noise"];
    let optional: Vec<&str> = (expected().into_iter().map(|(_, kind, _)| kind))
        .filter(|kind| !base.contains(kind) && *kind != "charge-coupling")
        .collect();
    let in_catalogue: Vec<&str> =
        optional.iter().copied().filter(|kind| *kind != "exact-shot-noise").collect();
    assert_eq!(listed, in_catalogue);
    for kind in optional {
        assert!(manifest.contains(&format!("\n{kind} = [")), "no feature {kind}");
    }
}
