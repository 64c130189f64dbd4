//! What a camera file asks of effects that do nothing there, or leave the range in which their
//! model holds: for people, with the reason.

use super::{Camera, KeptNoise};
use camrig_sensor_core::effects::{Domain, Effect};

/// Charge times coefficient up to which the brighter-fatter model holds: its first order in aµ.
const MAX_BRIGHTER_FATTER: f64 = 0.1;

/// Effects of which the first has to stand before the second, and why.
const ORDER: [(&str, &str, &str); 2] = [
    ("black-sun", "blooming", "what blooming leaves at full well no longer shows the sun"),
    ("system-gain", "stuck-pixels", "a stuck pixel lies at the converter's input"),
];

/// Warnings of the effects of a camera, in their order.
pub(super) fn of(camera: &Camera) -> Vec<String> {
    let about = |effect: &Effect| {
        let reason = reason(camera, effect)?;
        Some(format!("the effect {} {reason}", effect.entry().kind))
    };
    let single = camera.effects.iter().filter_map(about);
    let of_hdr = camera.sensor.hdr.iter().flat_map(super::hdr::remarks::of);
    let all = single
        .chain(out_of_order(camera))
        .chain(behind_the_converter(camera))
        .chain(beyond_the_gains(camera))
        .chain(behind_the_table(camera))
        .chain(of_hdr);
    all.map(|remark| format!("warning: {remark}")).collect()
}

fn out_of_order(camera: &Camera) -> impl Iterator<Item = String> + '_ {
    let place = |kind: &str| camera.effects.iter().position(|e| e.entry().kind == kind);
    ORDER.iter().filter(move |(first, second, _)| place(second) < place(first)).filter_map(
        move |(first, second, why)| {
            place(second)?;
            Some(format!("the effect {second} stands before {first}: {why}; list it after"))
        },
    )
}

/// A gain beyond a table of DN per electron, where more of it has no effect.
fn beyond_the_gains(camera: &Camera) -> Option<String> {
    let (gain, gains) = (camera.sensor.analog_gain, camera.sensor.gains.as_ref()?);
    let last = *gains.at.last()?;
    let analog = gains.digital_above.map_or(gain, |above| gain.min(above));
    (gains.dn_per_e.is_some() && analog > last).then(|| {
        format!(
            "analog_gain = {gain}: dn_per_e of [sensor.gains] ends at gain {last} and stays beyond; \
             add a gain, or digital_above = {last}"
        )
    })
}

/// A part of the read noise that is not read, since a table gives the whole.
fn behind_the_table(camera: &Camera) -> Option<String> {
    let post = camera.sensor.noise.read_e_post;
    let by_table = camera.sensor.gains.as_ref().is_some_and(|gains| gains.read_e.is_some());
    (by_table && post > 0.0).then(|| {
        format!(
            "read_e_post = {post} of [sensor.noise] does nothing: read_e of [sensor.gains] is all \
             of the read noise; omit it"
        )
    })
}

/// Why an effect does nothing here, or leaves the range in which its model holds.
fn reason(camera: &Camera, effect: &Effect) -> Option<String> {
    let sensor = &camera.sensor;
    let (width, height) = (sensor.width, sensor.height);
    match effect {
        Effect::GreenImbalance(_) => {
            let cfa = &sensor.cfa;
            let bayer = (cfa.width, cfa.height) == (2, 2) && sensor.channel_names.len() >= 3;
            (!bayer).then(|| {
                format!(
                    "does nothing: the pattern {cfa} has no rows of 2 x 2 pixels with one green \
                     each"
                )
            })
        }
        Effect::ColourShading(e) => {
            let by_channel = [e.channel_0, e.channel_1, e.channel_2, e.channel_3];
            beyond_the_channels(camera, by_channel)
        }
        Effect::FlickerBanding(e) => {
            let places = [e.plane_0, e.plane_1, e.plane_2, e.plane_3];
            let most = places.into_iter().fold(0.0, f32::max) * e.depth;
            (most > 1.0).then(|| {
                format!(
                    "leaves the range of its model: a place sees a depth of {most:.2}, and light \
                     is cut at 0 where it is above 1"
                )
            })
        }
        Effect::ReadNoiseSpread(_) => {
            let by_table = sensor.gains.as_ref().is_some_and(|gains| gains.read_e.is_some());
            let without =
                !by_table && sensor.noise.read_e == 0.0 && sensor.noise.read_e_post == 0.0;
            without.then(|| "does nothing: there is no read noise to spread (read_e = 0)".into())
        }
        Effect::ExactShotNoise(_) => (sensor.kept_noise == KeptNoise::None)
            .then(|| "does nothing: shot noise is switched off".into()),
        Effect::PdafPattern(e) => {
            let beyond = |first: f32, period: f32, pixels: u32| {
                first as u32 % (period as u32).max(1) >= pixels
            };
            (beyond(e.first_x, e.period_x, width) || beyond(e.first_y, e.period_y, height)).then(
                || {
                    format!(
                        "does nothing: its first pixel lies outside the {width} x {height} pixels \
                         of the sensor"
                    )
                },
            )
        }
        Effect::FullWell(e) => {
            let full_well_e = sensor.full_well_e;
            (f64::from(e.full_well_e) > full_well_e && e.knee == 0.0).then(|| {
                format!(
                    "does nothing: the sensor's full well, {full_well_e} e-, is below its {} e-",
                    e.full_well_e
                )
            })
        }
        Effect::BrighterFatter(e) => brighter_fatter(camera, f64::from(e.coefficient)),
        Effect::Nonlinearity(e) => {
            // The slope at full well, 1 − a (n + 1).
            let loss = e.loss * (e.exponent + 1.0);
            (loss > 1.0).then(|| {
                format!(
                    "leaves the range of its model: the response falls before full well where \
                     loss x (exponent + 1) is above 1, and it is {loss:.2}"
                )
            })
        }
        Effect::Fringing(e) => {
            let (sine, cosine) = libm::sincos(f64::from(e.direction_deg).to_radians());
            let across =
                |part: f64, pixels: u32| f64::from(e.fringes) * part.abs() / f64::from(pixels);
            let per_pixel = across(cosine, width).max(across(sine, height));
            (per_pixel > 0.5).then(|| {
                format!(
                    "leaves the range of its model: {per_pixel:.2} fringes per pixel, above 0.5"
                )
            })
        }
        Effect::DefectiveColumns(e) => {
            let count = f64::from(e.fraction) * f64::from(width);
            (e.fraction > 0.0 && count < 0.5).then(|| {
                format!("does nothing: a fraction of {} of {width} columns is none", e.fraction)
            })
        }
        Effect::GainStage(_) => gain_stage(camera, effect),
        _ => None,
    }
}

/// A value other than 0 for a channel that the sensor lacks.
fn beyond_the_channels(camera: &Camera, by_channel: [f32; 4]) -> Option<String> {
    let channels = camera.sensor.channel_names.len();
    let beyond = (channels..by_channel.len()).find(|&c| by_channel[c] != 0.0)?;
    Some(format!(
        "does nothing with channel_{beyond}: the sensor has {channels} channels, from 0 on"
    ))
}

fn brighter_fatter(camera: &Camera, coefficient: f64) -> Option<String> {
    let lower = camera.effects.iter().filter_map(|e| match e {
        Effect::FullWell(e) => Some(f64::from(e.full_well_e)),
        _ => None,
    });
    let full_well_e = lower.fold(camera.sensor.full_well_e, f64::min);
    let strength = coefficient * full_well_e;
    (strength > MAX_BRIGHTER_FATTER).then(|| {
        format!(
            "leaves the range of its model: coefficient x full well is {strength:.2}, and it holds \
             up to {MAX_BRIGHTER_FATTER}, which is a coefficient of {:.1e} here",
            MAX_BRIGHTER_FATTER / full_well_e
        )
    })
}

fn gain_stage(camera: &Camera, effect: &Effect) -> Option<String> {
    let place = camera.effects.iter().position(|e| std::ptr::eq(e, effect))?;
    let (upto, behind) = camera.effects.split_at(place + 1);
    if behind.iter().all(|e| e.domain() < Domain::Voltage) {
        return Some("does nothing: no effect stands behind it".into());
    }
    let shares = upto.iter().filter_map(|e| match e {
        Effect::GainStage(stage) => Some(stage.share),
        _ => None,
    });
    let passed: f32 = shares.sum();
    (passed > 1.0 + 1e-6).then(|| {
        format!("leaves the range of its model: the shares of the gain add up to {passed}")
    })
}

/// Effects on the signal that stand behind the converter's own.
fn behind_the_converter(camera: &Camera) -> impl Iterator<Item = String> + '_ {
    let voltage = camera.effects.iter().filter(|e| e.domain() == Domain::Voltage);
    let codes = |e: &Effect| matches!(e, Effect::AdcNonlinearity(_) | Effect::Requantised(_));
    let mut behind = voltage.skip_while(move |e| !codes(e));
    let converter = behind.next().map_or("", |e| e.entry().kind);
    // What is done to numbers.
    let digital = move |e: &&Effect| {
        codes(e) || matches!(e, Effect::OffsetClipping(_) | Effect::BlackLevelOffset(_))
    };
    behind.filter(move |e| !digital(e)).map(move |effect| {
        format!(
            "the effect {} acts on the signal before the converter, but follows {converter}, so \
             that codes are not where the converter has them; list it before",
            effect.entry().kind
        )
    })
}

#[cfg(test)]
mod tests {
    use super::super::Change;
    use super::*;

    fn remarks(preset: &str, changes: &[(&str, f64)]) -> Vec<String> {
        let changes = changes.iter().map(|&(key, value)| Change::new(key, value));
        of(&Camera::load_with(preset, changes).unwrap())
    }

    #[test]
    fn effects_without_effect_are_told_with_the_reason() {
        for (preset, key, value, reason) in [
            ("s5kgn1", "effect.green-imbalance.centre", 0.2, "no rows of 2 x 2 pixels"),
            ("imx174", "effect.green-imbalance.centre", 0.2, "no rows of 2 x 2 pixels"),
            ("mt9t012", "effect.colour-shading.channel_3", 0.1, "has 3 channels"),
            ("mt9t012", "effect.full-well.full_well_e", 5e5, "is below its 500000 e-"),
        ] {
            let told = remarks(preset, &[(key, value)]);
            assert!(told.len() == 1 && told[0].contains(reason), "{key}: {told:?}");
        }
        let spread = ("effect.read-noise-spread.spread", 0.3);
        let without = [("sensor.noise.read_e", 0.0), ("sensor.noise.read_e_post", 0.0), spread];
        assert!(remarks("mt9t012", &without)[0].contains("no read noise"));
        assert_eq!(remarks("mt9t012", &[spread]), [] as [String; 0]);
        for works in ["effect.green-imbalance.centre", "effect.colour-shading.channel_2"] {
            assert_eq!(remarks("mt9t012", &[(works, 0.1)]), [] as [String; 0], "{works}");
        }
    }

    #[test]
    fn what_the_effects_beside_one_another_make_of_them_is_told() {
        let told = |changes: &[(&str, f64)], reason: &str| {
            let told = remarks("mt9t012", changes);
            assert!(told.len() == 1 && told[0].contains(reason), "{changes:?}: {told:?}");
        };
        let silent = |changes: &[(&str, f64)]| {
            assert_eq!(remarks("mt9t012", changes), [] as [String; 0], "{changes:?}");
        };
        let sun = ("effect.black-sun.onset", 50.0);
        let bloom = ("effect.blooming.fraction", 0.2);
        told(&[bloom, sun], "blooming stands before black-sun");
        silent(&[sun, bloom]);
        let row = ("effect.row-temporal-noise.sigma_e", 1.0);
        told(&[("effect.requantised.step_0_dn", 4.0), row], "follows requantised");
        let depth = ("effect.flicker-banding.depth", 0.5);
        told(&[depth, ("effect.flicker-banding.plane_1", 2.1)], "a depth of 1.05");
        silent(&[depth, ("effect.flicker-banding.plane_1", 2.0)]);
        told(&[("effect.gain-stage.share", 1.0)], "no effect stands behind it");
        silent(&[("effect.gain-stage.share", 1.0), row]);
        told(
            &[
                ("effect.fringing.amplitude", 0.1),
                ("effect.fringing.fringes", 1000.0),
                ("effect.fringing.direction_deg", 90.0),
            ],
            "0.65 fringes per pixel",
        );
        told(&[("effect.defective-columns.fraction", 1e-4)], "is none");
    }

    #[test]
    fn parameters_beyond_a_models_validity_are_told() {
        let full_well_e = Camera::load("mt9t012").unwrap().sensor.full_well_e;
        let strength = |aw: f64| ("effect.brighter-fatter.coefficient", aw / full_well_e);
        assert_eq!(remarks("mt9t012", &[strength(0.099)]), [] as [String; 0]);
        let told = remarks("mt9t012", &[strength(0.11)]);
        assert!(told[0].contains("is 0.11, and it holds up to 0.1"), "{told:?}");
        let fall = [("effect.nonlinearity.loss", 0.4), ("effect.nonlinearity.exponent", 2.0)];
        assert!(remarks("mt9t012", &fall)[0].contains("it is 1.20"));
    }

    #[test]
    fn a_gain_beyond_the_table_is_told() {
        let gains = "\n[sensor.gains]\nat = [1, 4]\ndn_per_e = [0.1, 0.4]\n";
        let text = include_str!("../presets/mt9t012.toml").to_string() + gains;
        let mut camera = Camera::parse(&text, "test", &super::super::Folder::BuiltIn).unwrap();
        assert_eq!(of(&camera), [] as [String; 0]);
        camera.sensor.analog_gain = 8.0;
        assert!(of(&camera)[0].contains("ends at gain 4"));
    }

    #[test]
    fn noise_behind_the_converter_is_told() {
        let adc = ("effect.adc-nonlinearity.sigma_lsb", 0.1);
        let noise = ("effect.row-temporal-noise.sigma_e", 1.0);
        assert_eq!(remarks("mt9t012", &[noise, adc]), [] as [String; 0]);
        let told = remarks("mt9t012", &[adc, noise]);
        assert!(told.len() == 1 && told[0].contains("row-temporal-noise"), "{told:?}");
    }
}
