//! What the photon transfer and EMVA 1288 both have to say about a ladder of levels.

use super::dark::{SAME_EXPOSURE, distinct, spans};
use super::ladder::{Level, SAME_TEMPERATURE_C, Selection};
use super::moments::SATURATED_SHARE;
use super::value::Value;
use camrig_captures::{CaptureSet, Role};

/// Standard errors from which a figure is significantly above a limit: chance puts one in 700
/// there.
const SIGNIFICANT: f64 = 3.0;

/// Remarks on the levels of a selection. `line`: exposure times of darks from which a line gives
/// the dark at other ones.
pub fn of_ladder(
    set: &CaptureSet,
    selection: &Selection,
    darks: &[Level],
    flats: &[Level],
    line: usize,
) -> Vec<String> {
    let cut_off = darks.iter().find_map(|d| Some((d, d.cut_off?)));
    let notes = [
        elsewhere(set, selection),
        temperatures(flats),
        dark_exposures(darks, flats, line),
        cut_off.map(|(d, cut_off)| cut_off.note(&format!("dark {:?}", d.id))),
        beyond_white(set, darks, flats),
    ];
    notes.into_iter().flatten().collect()
}

/// Flats of other gains or lights than the selection's.
fn elsewhere(set: &CaptureSet, selection: &Selection) -> Option<String> {
    let elsewhere = set.with_role(Role::Flat).count() - selection.flats.len();
    let light = selection.wavelength_nm.map_or(String::new(), |nm| format!(" and {nm} nm"));
    (elsewhere > 0).then(|| {
        format!(
            "figures of analog gain {}{light} only, which has most levels: {elsewhere} flat \
             captures of other gains or lights are left out (they are figures of one operating \
             point; keep the captures of one in the set to measure another)",
            selection.analog_gain
        )
    })
}

/// Flats that the sensor saw at different temperatures.
fn temperatures(flats: &[Level]) -> Option<String> {
    let of = |f: &Level| f.temperature_c;
    let coldest = flats.iter().filter_map(of).min_by(f64::total_cmp)?;
    let warmest = flats.iter().filter_map(of).max_by(f64::total_cmp)?;
    (warmest - coldest > SAME_TEMPERATURE_C).then(|| {
        format!(
            "the flats' temperatures lie from {coldest} to {warmest} °C, which is one operating \
             point no more: the darks are those of one temperature, and what dark current differs \
             counts as light; keep the flats of one temperature"
        )
    })
}

/// Flats whose exposure time no dark has, unless a line through the darks gives it.
fn dark_exposures(darks: &[Level], flats: &[Level], line: usize) -> Option<String> {
    let times: Vec<f64> = darks.iter().map(|d| d.exposure_s).collect();
    let shortest = times.iter().copied().min_by(f64::total_cmp)?;
    let longest = times.iter().copied().max_by(f64::total_cmp)?;
    let same = |f: &Level, t: f64| (t - f.exposure_s).abs() <= SAME_EXPOSURE * f.exposure_s;
    let alone = flats.iter().filter(|f| !times.iter().any(|&t| same(f, t)));
    let has_line = spans(&times) && distinct(&times) >= line;
    let outside = |f: &&Level| !(shortest..=longest).contains(&f.exposure_s);
    let count = alone.filter(|f| !has_line || outside(f)).count();
    let what = if has_line {
        format!(
            "lie outside the darks' {shortest} to {longest} s: a line through the darks is carried \
             on to them"
        )
    } else {
        let at = if shortest < longest {
            format!("{shortest} to {longest} s")
        } else {
            format!("{shortest} s")
        };
        format!(
            "are of another exposure time than the darks ({at}), too few for a line: a dark of \
             another exposure is taken off, and the dark current of the difference counts as light"
        )
    };
    (count > 0).then(|| {
        format!(
            "{count} of {} flat levels have no dark of their own and {what}; EMVA 1288 takes a \
             dark at each exposure time",
            flats.len()
        )
    })
}

/// Samples above the level at which the manifest says that they saturate.
fn beyond_white(set: &CaptureSet, darks: &[Level], flats: &[Level]) -> Option<String> {
    let worst = |l: &Level| l.channels.iter().map(|m| m.beyond_white).fold(0.0, f64::max);
    let levels = darks.iter().chain(flats).map(|l| (worst(l), l));
    let (share, level) = levels.max_by(|a, b| a.0.total_cmp(&b.0))?;
    (share > SATURATED_SHARE).then(|| {
        format!(
            "{:.1} % of the samples of {:?} lie above white_level_dn = {}: levels that are not \
             saturated may be left out, and the full well is too low; correct white_level_dn",
            100.0 * share,
            level.id,
            set.sensor.white_level_dn
        )
    })
}

/// A quantum efficiency above 1 by more than its error, which no sensor has.
pub fn efficiency(name: &str, efficiency: Value) -> Option<String> {
    (efficiency.value - SIGNIFICANT * efficiency.std_error > 1.0).then(|| {
        format!(
            "channel {name}: a quantum efficiency of {:.3} is impossible, as a photon gives one \
             electron at most: the frames were smoothed or otherwise processed, so that K is too \
             low, or the irradiance, the photons or the pixel pitch are wrong",
            efficiency.value
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Sensor, Shot, write_npy};
    use crate::{emva, ptc};
    use camrig_captures::open;

    const SENSOR: Sensor = Sensor {
        width: 64,
        height: 48,
        gain: 0.5,
        full_well_e: 7000.0,
        row_fpn_e: 0.0,
        dark_e_per_s: 0.0,
        dsnu_e_per_s: 0.0,
        ..Sensor::USUAL
    };

    fn shot(exposure_s: f64, electrons: f64) -> Shot {
        let rate = electrons / SENSOR.qe[0] / exposure_s;
        Shot { exposure_s, rate, frames: 2, temperature_c: 25.0, analog_gain: 1.0 }
    }

    /// A set of darks and ten flats of two frames each, and what both measurements say about it
    /// after `change`.
    fn told(
        sensor: &Sensor,
        (darks, flats): (&[f64], &[f64]),
        change: impl FnOnce(&mut CaptureSet),
    ) -> [Result<String, String>; 2] {
        let directory = tempfile::tempdir().unwrap();
        let mut shots: Vec<Shot> = darks.iter().map(|&t| shot(t, 0.0)).collect();
        let level = |(i, &t): (usize, &f64)| shot(t, 850.0 * (i + 1) as f64);
        shots.extend(flats.iter().enumerate().map(level));
        sensor.write(directory.path(), &shots);
        let mut set = CaptureSet::load(directory.path()).unwrap();
        change(&mut set);
        [
            ptc::measure(&set).map(|p| p.notes.join("\n")).map_err(|e| e.to_string()),
            emva::measure(&set).map(|e| e.warnings.join("\n")).map_err(|e| e.to_string()),
        ]
    }

    /// Both measurements say all of these.
    fn both(said: &[Result<String, String>; 2], words: &[&str]) {
        for said in said {
            let said = said.as_ref().unwrap_or_else(|e| e);
            for words in words {
                assert!(said.contains(words), "{words:?} in {said}");
            }
        }
    }

    fn refused(said: &[Result<String, String>; 2], words: &[&str]) {
        assert!(said.iter().all(Result::is_err), "{said:?}");
        both(said, words);
    }

    const ONE: (&[f64], &[f64]) = (&[0.01], &[0.01; 10]);

    fn flats(set: &mut CaptureSet) -> impl Iterator<Item = &mut camrig_captures::Capture> {
        set.captures.iter_mut().filter(|c| c.role == Role::Flat)
    }

    #[test]
    fn a_set_that_meets_the_assumptions_has_none_of_these_remarks() {
        for said in told(&SENSOR, ONE, |_| ()) {
            let said = said.unwrap();
            for words in ["of their own", "left out (", "temperatures", "cut off", "lie above"] {
                assert!(!said.contains(words), "{said}");
            }
        }
    }

    #[test]
    fn flats_without_a_dark_of_their_exposure_are_told() {
        let glowing = Sensor { dark_e_per_s: 20_000.0, ..SENSOR };
        let times: Vec<f64> = (1..=10).map(|k| 0.008 * f64::from(k)).collect();
        let of = |darks: &[f64]| told(&glowing, (darks, &times), |_| ());
        both(&of(&[0.008]), &["9 of 10 flat levels have no dark of their own", "(0.008 s)"]);
        let outside = of(&[0.008, 0.02, 0.04]);
        both(&outside, &["5 of 10 flat levels", "outside the darks' 0.008 to 0.04 s"]);
        for said in of(&[0.008, 0.04, 0.08]) {
            assert!(!said.as_ref().unwrap().contains("of their own"), "{said:?}");
        }
    }

    #[test]
    fn a_dark_that_light_reached_is_refused() {
        // The sixth flat, 5100 e⁻, as a dark.
        let lit = told(&SENSOR, ONE, |set| set.captures[6].role = Role::Dark);
        refused(
            &lit,
            &["dark capture \"flat-6\"", "flat capture \"flat-1\"", "no flat is darker"],
        );
    }

    #[test]
    fn darks_cut_off_at_a_pedestal_are_told() {
        let cut = told(&SENSOR, ONE, |set| {
            let file = &set.captures[0].files[0];
            let frames = open(file).unwrap();
            let samples: Vec<u16> = frames.iter().flat_map(|f| f.plane().unwrap().data).collect();
            let cut: Vec<u16> = samples.iter().map(|&v| v.max(64)).collect();
            write_npy(file, &[2, 48, 64], &cut);
        });
        both(&cut, &["dark \"dark-0\" are 64 DN", "cut off"]);
    }

    #[test]
    fn frames_that_occur_twice_are_refused() {
        for capture in [0, 4] {
            let twice = told(&SENSOR, ONE, |set| {
                let files = &mut set.captures[capture].files;
                files.push(files[0].clone());
            });
            refused(&twice, &["frame 2 is a copy of frame 0", "keep one of each"]);
        }
    }

    #[test]
    fn flats_of_other_lights_and_temperatures_are_told() {
        let lights = told(&SENSOR, ONE, |set| {
            for (k, flat) in flats(set).enumerate() {
                let light = flat.light.as_mut().unwrap();
                light.wavelength_nm = Some(if k < 7 { 450.0 } else { 650.0 });
            }
        });
        both(&lights, &["analog gain 1 and 450 nm only", "3 flat captures of other gains"]);
        let warmer = told(&SENSOR, ONE, |set| {
            flats(set).skip(5).for_each(|flat| flat.temperature_c = Some(40.0));
        });
        both(&warmer, &["temperatures lie from 25 to 40 °C"]);
    }

    #[test]
    fn samples_above_white_and_an_impossible_efficiency_are_told() {
        let beyond = told(&SENSOR, ONE, |set| set.sensor.white_level_dn = 2500);
        both(&beyond, &["above white_level_dn = 2500"]);
        // Electrons per photon: 0.5 / 0.3.
        let dim = told(&SENSOR, ONE, |set| {
            for flat in flats(set) {
                *flat.light.as_mut().unwrap().photons_per_pixel_per_s.as_mut().unwrap() *= 0.3;
            }
        });
        both(&dim, &["channel m: a quantum efficiency of 1.", "is impossible"]);
    }
}
