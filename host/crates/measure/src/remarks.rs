//! Remarks on a series of levels that photon transfer and EMVA 1288 share.

use super::dark::{distinct, spans};
use super::ladder::{Level, Selection};
use super::moments::SATURATED_SHARE;
use super::tolerance::{SAME_EXPOSURE, SAME_TEMPERATURE_C};
use camrig_base::Value;
use camrig_captures::{CaptureSet, Role};

/// Standard errors above which a figure significantly exceeds a limit: by chance, one in 700 does.
const SIGNIFICANT: f64 = 3.0;

/// Remarks on the levels of a selection. `line` is the number of exposure times of darks from which
/// the dark at other exposure times is on a line.
pub fn of_ladder(
    set: &CaptureSet,
    selection: &Selection,
    darks: &[Level],
    flats: &[Level],
    line: usize,
) -> Vec<String> {
    let cut_off = darks.iter().find_map(|d| Some((d, d.cut_off?)));
    let notes = [
        other_conditions(set, selection),
        temperatures(flats),
        dark_exposures(darks, flats, line),
        cut_off.map(|(d, cut_off)| cut_off.note(&format!("dark {:?}", d.id))),
        beyond_white(set, darks, flats),
    ];
    notes.into_iter().flatten().collect()
}

/// Flats of other gains or lights than the selection's.
fn other_conditions(set: &CaptureSet, selection: &Selection) -> Option<String> {
    let others = set.with_role(Role::Flat).count() - selection.flats.len();
    let light = selection.wavelength_nm.map_or(String::new(), |nm| format!(" and {nm} nm"));
    (others > 0).then(|| {
        format!(
            "figures of analog gain {}{light} only, which has most levels: {others} flat captures \
             of other gains or lights are not used (figures apply to one operating point; to \
             measure another, keep only its captures in the set)",
            selection.analog_gain
        )
    })
}

/// Flats at different temperatures.
fn temperatures(flats: &[Level]) -> Option<String> {
    let of = |f: &Level| f.temperature_c;
    let coldest = flats.iter().filter_map(of).min_by(f64::total_cmp)?;
    let warmest = flats.iter().filter_map(of).max_by(f64::total_cmp)?;
    (warmest - coldest > SAME_TEMPERATURE_C).then(|| {
        format!(
            "the flats' temperatures range from {coldest} to {warmest} °C, which is not one \
             operating point: the darks have one temperature, and differences of the dark current \
             count as light; keep the flats of one temperature"
        )
    })
}

/// Flats without a dark of their exposure time, unless it is on a line through the darks.
fn dark_exposures(darks: &[Level], flats: &[Level], line: usize) -> Option<String> {
    let times: Vec<f64> = darks.iter().map(|d| d.exposure_s).collect();
    let shortest = times.iter().copied().min_by(f64::total_cmp)?;
    let longest = times.iter().copied().max_by(f64::total_cmp)?;
    let same = |f: &Level, t: f64| (t - f.exposure_s).abs() <= SAME_EXPOSURE * f.exposure_s;
    let unmatched = flats.iter().filter(|f| !times.iter().any(|&t| same(f, t)));
    let has_line = spans(&times) && distinct(&times) >= line;
    let outside = |f: &&Level| !(shortest..=longest).contains(&f.exposure_s);
    let count = unmatched.filter(|f| !has_line || outside(f)).count();
    let what = if has_line {
        format!(
            "are outside the darks' {shortest} to {longest} s: a line through the darks is \
             extrapolated"
        )
    } else {
        let at = if shortest < longest {
            format!("{shortest} to {longest} s")
        } else {
            format!("{shortest} s")
        };
        format!(
            "have another exposure time than the darks ({at}), too few for a line: a dark of \
             another exposure is subtracted, and the dark current of the difference counts as light"
        )
    };
    (count > 0).then(|| {
        format!(
            "{count} of {} flat levels have no dark of their exposure time and {what}; EMVA 1288 \
             requires a dark at each exposure time",
            flats.len()
        )
    })
}

/// Samples above the saturation level of the manifest.
fn beyond_white(set: &CaptureSet, darks: &[Level], flats: &[Level]) -> Option<String> {
    let worst = |l: &Level| l.channels.iter().map(|m| m.beyond_white).fold(0.0, f64::max);
    let levels = darks.iter().chain(flats).map(|l| (worst(l), l));
    let (share, level) = levels.max_by(|a, b| a.0.total_cmp(&b.0))?;
    (share > SATURATED_SHARE).then(|| {
        format!(
            "{:.1} % of the samples of {:?} are above white_level_dn = {}: unsaturated levels may be \
             excluded, and the full well is too low; correct white_level_dn",
            100.0 * share,
            level.id,
            set.sensor.white_level_dn
        )
    })
}

/// A quantum efficiency significantly above 1, which is impossible.
pub fn efficiency(name: &str, efficiency: Value) -> Option<String> {
    (efficiency.value - SIGNIFICANT * efficiency.std_error > 1.0).then(|| {
        format!(
            "channel {name}: a quantum efficiency of {:.3} is impossible, as a photon generates one \
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

    /// The remarks of both measurements on a set of darks and ten flats of two frames each, after
    /// `change`.
    fn remarks(
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

    /// Both measurements have all of these remarks.
    fn both(remarks: &[Result<String, String>; 2], words: &[&str]) {
        for remarks in remarks {
            let remarks = remarks.as_ref().unwrap_or_else(|e| e);
            for words in words {
                assert!(remarks.contains(words), "{words:?} in {remarks}");
            }
        }
    }

    fn refused(remarks: &[Result<String, String>; 2], words: &[&str]) {
        assert!(remarks.iter().all(Result::is_err), "{remarks:?}");
        both(remarks, words);
    }

    const ONE: (&[f64], &[f64]) = (&[0.01], &[0.01; 10]);

    fn flats(set: &mut CaptureSet) -> impl Iterator<Item = &mut camrig_captures::Capture> {
        set.captures.iter_mut().filter(|c| c.role == Role::Flat)
    }

    #[test]
    fn a_set_that_meets_the_assumptions_has_none_of_these_remarks() {
        for remarks in remarks(&SENSOR, ONE, |_| ()) {
            let remarks = remarks.unwrap();
            for words in
                ["of their exposure", "not used (", "temperatures", "cut off", "are above"]
            {
                assert!(!remarks.contains(words), "{remarks}");
            }
        }
    }

    #[test]
    fn flats_without_a_dark_of_their_exposure_are_reported() {
        let glowing = Sensor { dark_e_per_s: 20_000.0, ..SENSOR };
        let times: Vec<f64> = (1..=10).map(|k| 0.008 * f64::from(k)).collect();
        let of = |darks: &[f64]| remarks(&glowing, (darks, &times), |_| ());
        both(
            &of(&[0.008]),
            &["9 of 10 flat levels have no dark of their exposure time", "(0.008 s)"],
        );
        let outside = of(&[0.008, 0.02, 0.04]);
        both(&outside, &["5 of 10 flat levels", "outside the darks' 0.008 to 0.04 s"]);
        for remarks in of(&[0.008, 0.04, 0.08]) {
            assert!(!remarks.as_ref().unwrap().contains("of their exposure"), "{remarks:?}");
        }
    }

    #[test]
    fn a_dark_that_light_reached_is_refused() {
        // The sixth flat, 5100 e⁻, as a dark.
        let lit = remarks(&SENSOR, ONE, |set| set.captures[6].role = Role::Dark);
        refused(
            &lit,
            &["dark capture \"flat-6\"", "flat capture \"flat-1\"", "must not be darker"],
        );
    }

    #[test]
    fn darks_cut_off_at_a_pedestal_are_reported() {
        let cut = remarks(&SENSOR, ONE, |set| {
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
            let twice = remarks(&SENSOR, ONE, |set| {
                let files = &mut set.captures[capture].files;
                files.push(files[0].clone());
            });
            refused(&twice, &["frame 2 is a copy of frame 0", "keep one of each"]);
        }
    }

    #[test]
    fn flats_of_other_lights_and_temperatures_are_reported() {
        let lights = remarks(&SENSOR, ONE, |set| {
            for (k, flat) in flats(set).enumerate() {
                let light = flat.light.as_mut().unwrap();
                light.wavelength_nm = Some(if k < 7 { 450.0 } else { 650.0 });
            }
        });
        both(&lights, &["analog gain 1 and 450 nm only", "3 flat captures of other gains"]);
        let warmer = remarks(&SENSOR, ONE, |set| {
            flats(set).skip(5).for_each(|flat| flat.temperature_c = Some(40.0));
        });
        both(&warmer, &["temperatures range from 25 to 40 °C"]);
    }

    #[test]
    fn samples_above_white_and_an_impossible_efficiency_are_reported() {
        let beyond = remarks(&SENSOR, ONE, |set| set.sensor.white_level_dn = 2500);
        both(&beyond, &["above white_level_dn = 2500"]);
        // Electrons per photon: 0.5 / 0.3.
        let dim = remarks(&SENSOR, ONE, |set| {
            for flat in flats(set) {
                *flat.light.as_mut().unwrap().photons_per_pixel_per_s.as_mut().unwrap() *= 0.3;
            }
        });
        both(&dim, &["channel m: a quantum efficiency of 1.", "is impossible"]);
    }
}
