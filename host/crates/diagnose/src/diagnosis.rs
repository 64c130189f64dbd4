//! The diagnosis from a capture set to its report.

use crate::candidates::proposal::{MIN_STRENGTH, Proposal};
use crate::data::codes;
use crate::data::design::{self, Design, Halves};
use crate::explanation::explain;
use crate::measured::{Keep, Measured};
use crate::names::Names;
use crate::options::{Options, Progress};
use crate::report::{Comparison, Report};
use crate::search::evaluation::{Evaluation, RUNS};
use crate::search::{Known, Outcome};
use crate::verdict;
use crate::verdict::improved::{self, ImprovedFile};
use camrig_base::{Bands, Error, Result, Value};
use camrig_camera::Camera;
use camrig_captures::CaptureSet;
use camrig_clean::{Cleaned, Finding};

/// A diagnosis: its report, and what pages and camera files are made from.
pub struct Diagnosis {
    /// The report: what `diagnosis.json` contains.
    pub report: Report,
    /// What was measured.
    pub measured: Measured,
    /// What explains it: the models before and after, and how the search came to them.
    pub outcome: Outcome,
}

/// Finds where captures and a camera file disagree and which effects explain it: removes from the
/// frames what is not the sensor's steady behaviour, divides them into frames to fit and held-out
/// frames, measures both, and searches for effects of the catalogue and for shapes that no effect
/// has. The set may hold a region of the camera's sensor.
///
/// # Errors
/// Files that cannot be read, captures that cannot be the camera's or that contradict their
/// manifest, and models that cannot be simulated.
pub fn diagnose(camera: &Camera, set: CaptureSet, options: &Options<'_>) -> Result<Diagnosis> {
    let (camera, cleaned, measured) = measure(camera, set, Keep::Moments, options)?;
    let trying = |what: &str| options.report(Progress::Trying(what));
    trying("effects by their own evidence");
    let names = match measured.processed {
        true => None,
        false => Names::of(&camera, &cleaned, &measured)?,
    };
    let mut seeds = names.as_ref().map_or_else(|| Ok(Vec::new()), |n| n.proposals(&camera))?;
    seeds.extend(measured.findings.iter().filter_map(|f| requantised(&camera, f)));
    let known = Known { seeds: &seeds, without: &options.without };
    let (measured, outcome) = explain(&measured, &camera, &known, &trying)?;
    let evidence = names.map_or_else(|| Ok(Vec::new()), |n| n.judge(&outcome))?;
    let report = verdict::report(&measured, &outcome, evidence);
    Ok(Diagnosis { report, measured, outcome })
}

/// Compares a camera file with captures, statistic by statistic, and searches for nothing.
///
/// # Errors
/// Those of [`diagnose()`].
pub fn compare(camera: &Camera, set: CaptureSet, options: &Options<'_>) -> Result<Comparison> {
    let (camera, _, measured) = measure(camera, set, Keep::Statistics, options)?;
    let model = Evaluation::new(&measured, camera, Vec::new(), RUNS)?;
    Ok(verdict::comparison(&measured, &model))
}

impl Diagnosis {
    /// The camera with the effects and shapes that were found.
    pub fn improved(&self) -> &Camera {
        &self.outcome.after.camera
    }

    /// The improved camera as a file; `given` is how the camera was named when it was loaded: a
    /// path or a preset.
    ///
    /// # Errors
    /// Tables of the camera file that cannot be read.
    pub fn improved_file(&self, given: &str) -> Result<ImprovedFile> {
        let Outcome { before, after, .. } = &self.outcome;
        improved::file(&before.camera.text, given, &after.camera, &after.named)
    }

    /// Name of the built-in plan with the captures that would show more; none where nothing is
    /// left open.
    pub fn next_plan(&self) -> Option<&'static str> {
        let open =
            !self.outcome.confounded.is_empty() || !self.outcome.after.unexplained.is_empty();
        open.then(|| verdict::next_plan(&self.outcome))
    }
}

/// The effect of codes that were quantised again, where the camera has none; their table is what
/// the codes in use are.
fn requantised(camera: &Camera, finding: &Finding) -> Option<Proposal> {
    const KEYS: [[&str; 2]; 5] = [
        ["", "step_0_dn"],
        ["from_1_dn", "step_1_dn"],
        ["from_2_dn", "step_2_dn"],
        ["from_3_dn", "step_3_dn"],
        ["from_4_dn", "step_4_dn"],
    ];
    const KIND: &str = "requantised";
    if finding.steps.is_empty() || camera.effects.iter().any(|e| e.entry().kind == KIND) {
        return None;
    }
    let pairs = KEYS.into_iter().zip(&finding.steps);
    let values = pairs.flat_map(|(keys, words)| keys.into_iter().zip(words));
    let values = values.filter(|(key, _)| !key.is_empty());
    let values = values.map(|(key, &word)| (key, word));
    let values = values.chain(finding.cut.then_some(("rounding", 0.0)));
    let parameters: Vec<(&'static str, Value)> =
        values.map(|(key, value)| (key, Value::new(value, 0.0))).collect();
    // A code that none of many samples has is no matter of chance.
    let certain = 2.0 * MIN_STRENGTH;
    Proposal::of(KIND, certain, parameters).map(|p| Proposal { by_evidence: true, ..p })
}

/// Least columns and rows: twice the longest period that is looked for in them.
const MIN_SIDE: u32 = 16;

/// Cleans, divides and measures a set. Returns also the camera in the digital numbers of the
/// cleaned frames, and with their size, and these frames.
fn measure(
    camera: &Camera,
    mut set: CaptureSet,
    keep: Keep,
    options: &Options<'_>,
) -> Result<(Camera, Cleaned, Measured)> {
    if let Some(region) = options.region {
        set = set.within(region)?;
    }
    let mut camera = camera.clone();
    let (w, h) = (set.sensor.width as u32, set.sensor.height as u32);
    if w.min(h) < MIN_SIDE {
        return Err(Error::limit(format!("frames of {w} x {h} pixels"))
            .help(format!("a comparison needs {MIN_SIDE} columns and rows at least")));
    }
    if w <= camera.sensor.width && h <= camera.sensor.height {
        (camera.sensor.width, camera.sensor.height) = (w, h);
    }
    let mut notes = table_notes(&camera, &set);
    notes.iter().for_each(|note| options.report(Progress::Note(note)));
    let total = Cleaned::frames_to_read(&set)?;
    let checked = |frames| options.report(Progress::Checked { frames, total });
    let cleaned = Cleaned::new(set, &camrig_clean::Options::default().with_progress(&checked))?;
    let (camera, set) = (codes::camera_of(&camera, &cleaned), cleaned.set());
    let counts = set.captures.iter().map(|c| set.count(c)).collect::<Result<Vec<_>>>()?;
    let halves = design::divide(&camera, set, &counts)?;
    let total = frames_to_measure(&halves);
    let report = |frames| options.report(Progress::Measured { frames, total });
    let mut measured = Measured::new(&camera, &cleaned, halves, keep, &report)?;
    let of_set: Vec<String> =
        measured.notes.into_iter().filter(|note| !notes.contains(note)).collect();
    of_set.iter().for_each(|note| options.report(Progress::Note(note)));
    measured.findings.iter().map(Finding::line).for_each(|l| options.report(Progress::Note(&l)));
    notes.extend(of_set);
    measured.notes = notes;
    Ok((camera, cleaned, measured))
}

/// Notes on the tables of a camera file in the light of a set, each once.
fn table_notes(camera: &Camera, set: &CaptureSet) -> Vec<String> {
    let wavelengths = set.captures.iter().filter_map(|c| c.light.as_ref()?.wavelength_nm);
    let lit = wavelengths.map(|nm| Bands { start_nm: nm, step_nm: 10.0, count: 1 });
    let mut notes: Vec<String> = Vec::new();
    for note in lit.chain([Bands::VISIBLE]).flat_map(|bands| camera.notes(&bands)) {
        if !notes.contains(&note) {
            notes.push(note);
        }
    }
    notes
}

/// The stacks of a set are read once for each half.
fn frames_to_measure(halves: &Halves) -> usize {
    let of = |d: &Design| {
        let stacks = d.conditions.iter().map(|c| c.stack.frames);
        stacks.chain(d.targets.iter().map(|t| t.stack.frames)).sum::<usize>()
    };
    of(&halves.fit) + halves.holdout.as_ref().map_or(0, of)
}

#[cfg(test)]
mod synthetic;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::{Amount, Evidence};
    use serde_json::Value as Json;
    use std::collections::BTreeSet;

    /// The table that codes in use are becomes the effect's, unless the camera has one.
    #[test]
    fn requantised_codes_give_the_model_their_table() {
        let mut finding =
            Finding::new(camrig_clean::Kind::Requantised, "all", camrig_clean::Done::Reported);
        finding.steps = vec![[0.0, 1.0], [952.0, 2.0], [2416.0, 8.0]];
        let mut camera = camera();
        let found = requantised(&camera, &finding).unwrap();
        let values: Vec<(&str, f64)> =
            found.parameters.iter().map(|(key, v)| (*key, v.value)).collect();
        let table = [("step_0_dn", 1.0), ("from_1_dn", 952.0), ("step_1_dn", 2.0)];
        assert_eq!(values[..3], table);
        assert_eq!(values[3..], [("from_2_dn", 2416.0), ("step_2_dn", 8.0)]);
        finding.cut = true;
        let cut = requantised(&camera, &finding).unwrap();
        let last = cut.parameters.last().map(|(key, v)| (*key, v.value));
        assert_eq!(last, Some(("rounding", 0.0)));
        let [camrig_camera::AnyEffect::Sensor(effect)] = found.effects[..] else { panic!() };
        camera.effects.push(effect);
        assert!(requantised(&camera, &finding).is_none());
    }

    const CAMERA: &str = r#"
name = "like an ASI120"
[lens]
kind = "diffraction-limited"
f_number = 2.8
focal_length_mm = 8.0
[sensor]
width = 320
height = 240
pitch_um = 3.75
fill_factor = 1.0
cfa = "GRBG"
qe = "qe.csv"
conversion_gain_uv_per_e = 50.0
full_well_e = 15166.7
bits = 12
black_level_dn = 144
temperature_c = 25.0
seed = 1
[sensor.noise]
read_e = 6.0
dark_current_e_per_s = 0.0
dark_doubling_c = 7.0
temperature_ref_c = 25.0
dsnu_e_per_s = 0.0
prnu = 0.008
row_fpn_e = 0.0
"#;

    const CROPS: [(&str, [usize; 2]); 4] = [
        ("64x64", [64, 64]),
        ("128x128", [128, 128]),
        ("192x160", [192, 160]),
        ("320x240", [320, 240]),
    ];

    /// Effects that `golden/asi120` has figures of, or that follow from them: dark currents and
    /// noise over pixels, patterns of the bias and of the gain, the light.
    const IN_THE_MODEL: [&str; 16] = [
        "black-level-offset",
        "column-gain-fpn",
        "column-offset-fpn",
        "dark-current",
        "dark-current-by-site",
        "dark-current-telegraph-noise",
        "flicker-banding",
        "frame-offset-by-site",
        "green-imbalance",
        "hot-pixels",
        "pixel-offset-fpn",
        "prnu",
        "random-telegraph-noise",
        "read-noise",
        "read-noise-spread",
        "row-temporal-noise",
    ];

    fn camera() -> Camera {
        let folder = tempfile::tempdir().unwrap();
        let qe: String =
            (300..=1100).step_by(20).map(|nm| format!("{nm},0.5,0.6,0.3\n")).collect();
        std::fs::write(folder.path().join("qe.csv"), format!("wavelength_nm,r,g,b\n{qe}"))
            .unwrap();
        let path = folder.path().join("camera.toml");
        std::fs::write(&path, CAMERA).unwrap();
        Camera::load(path.to_str().unwrap()).unwrap()
    }

    /// Collects amounts that are more than three errors of another program's figure from it.
    fn compare(golden: &Json, crop: &str, found: &[Evidence], wrong: &mut Vec<String>) {
        let mut check = |effect: &str, amount: &str, quantity: &str, root: bool| {
            let right = &golden["quantities"][quantity][crop];
            let (value, error) =
                (right["value"].as_f64().unwrap(), right["error"].as_f64().unwrap());
            let right = match root {
                true => [value.sqrt(), 0.5 * error / value.sqrt()],
                false => [value, error],
            };
            let of = |e: &&Evidence| e.effect == effect;
            let amounts = found.iter().find(of).map_or(&[][..], |e| &e.amounts);
            let own = amounts.iter().find(|a: &&Amount| a.name == amount).map(|a| a.value);
            if !own.is_some_and(|own| (own - right[0]).abs() <= 3.0 * right[1]) {
                wrong.push(format!("{crop}: {effect} {amount}: {own:?}, right {right:?}"));
            }
        };
        let sites = ["site 0,0", "site 1,0", "site 0,1", "site 1,1"];
        for (amount, site) in sites.iter().zip(["G(0,0)", "R(0,1)", "B(1,0)", "G(1,1)"]) {
            check("gain-by-site", amount, &format!("gain {site}"), false);
            check("prnu", amount, &format!("prnu {site}"), false);
            check("black-level-offset", amount, &format!("black bias {site}"), false);
            check("dark-current-by-site", amount, &format!("dark current median {site}"), false);
        }
        check("dark-current", "median", "dark_median_dn_s", false);
        check("row-temporal-noise", "sigma", "row_common_var", true);
        check("row-noise-of-opposite-sign", "sigma", "row_anti_var", true);
        check("frame-offset-by-site", "sigma", "frame_site_offset_var", true);
        check("random-telegraph-noise", "share", "read_noisy_share", false);
        check("flicker-banding", "cycles_per_row", "flicker_cycles_per_row_flat", false);
        check("flicker-banding", "depth_after_exposure", "flicker_depth_flat", false);
        check("hot-pixels", "share", "hot_share", false);
    }

    /// Captures of a real sensor, and another program's figures of them.
    fn real_sensor() -> Option<(std::path::PathBuf, Json)> {
        let folder = camrig_testing::shared("data/captures/asi120_zwo")?;
        let golden = std::fs::read(camrig_testing::shared("golden/asi120/asi120.json")?).unwrap();
        Some((folder, serde_json::from_slice(&golden).unwrap()))
    }

    /// What the search names at every crop: the greens differ, and no read-out channels do.
    #[test]
    #[ignore = "whole diagnoses, minutes: ci/full"]
    fn a_real_sensor_has_no_false_name_in_its_model_at_any_crop() {
        let Some((folder, golden)) = real_sensor() else { return };
        let mut wrong = Vec::new();
        for (crop, [width, height]) in CROPS {
            let at = |axis: &str| golden["crops"][crop][axis].as_u64().unwrap() as usize;
            let region = Some([at("x"), at("y"), width, height]);
            let options = Options { region, ..Options::default() };
            let set = CaptureSet::load(&folder).unwrap();
            let report = diagnose(&camera(), set, &options).unwrap().report;
            let named: Vec<&str> = report.steps.iter().map(|s| &s.effect[..]).collect();
            println!("{crop}: gap {} to {}, {named:?}", report.gap_before, report.gap_after);
            let is_right = |name: &&str| IN_THE_MODEL.contains(name);
            if !named.iter().all(is_right) || !named.contains(&"green-imbalance") {
                wrong.push(format!("{crop}: {named:?}"));
            }
        }
        assert!(wrong.is_empty(), "{wrong:#?}");
    }

    #[test]
    fn a_real_sensor_has_its_names_by_evidence_at_every_crop_and_never_fewer_at_a_larger_one() {
        let Some((folder, golden)) = real_sensor() else { return };
        let (camera, mut wrong) = (camera(), Vec::new());
        let mut smaller: BTreeSet<String> = BTreeSet::new();
        for (crop, [width, height]) in CROPS {
            let at = |axis: &str| golden["crops"][crop][axis].as_u64().unwrap() as usize;
            let set = CaptureSet::load(&folder).unwrap();
            let set = set.within([at("x"), at("y"), width, height]).unwrap();
            let options = Options::default();
            let (camera, cleaned, measured) =
                measure(&camera, set, Keep::Moments, &options).unwrap();
            let names = Names::of(&camera, &cleaned, &measured).unwrap().unwrap();
            let found = names.evidence(&names.given, &[], false);
            compare(&golden, crop, &found, &mut wrong);
            for seed in 1..=if width == 64 { 20 } else { 0 } {
                let (most, effect) = names.by_chance(&camera, seed);
                if most > 5.0 {
                    wrong.push(format!("nothing hidden, seed {seed}: {effect} by {most}"));
                }
            }
            let named = found.iter().filter(|e| e.is_named()).map(|e| e.effect.clone());
            let named: BTreeSet<String> = named.collect();
            let lost: Vec<&String> = smaller.difference(&named).collect();
            if !lost.is_empty() {
                wrong.push(format!("{crop}: no longer named: {lost:?}"));
            }
            // Greens have 1.12 times the gain of red and blue: six errors of the smallest crop.
            if !named.contains("gain-by-site") {
                wrong.push(format!("{crop}: no gain by site"));
            }
            let blinking = found.iter().find(|e| e.effect == "dark-current-telegraph-noise");
            println!("{crop}: {named:?}; {blinking:?}");
            // The lamp is a white LED: numpy finds amplitudes of 0.2433 in blue and 0.1783 in red.
            let flicker = found.iter().find(|e| e.effect == "flicker-by-site").unwrap();
            let blue_over_red = flicker.amounts[2].value / flicker.amounts[1].value;
            if (blue_over_red - 0.2433 / 0.1783).abs() > 0.03 {
                wrong.push(format!("{crop}: {flicker:?}"));
            }
            smaller = named;
        }
        for name in [
            "torn-frames",
            "dark-current",
            "row-temporal-noise",
            "row-noise-of-opposite-sign",
            "frame-offset-by-site",
            "random-telegraph-noise",
            "flicker-banding",
            "flicker-by-site",
            "prnu",
            "dark-current-telegraph-noise",
        ] {
            if !smaller.contains(name) {
                wrong.push(format!("{name} is not named"));
            }
        }
        assert!(wrong.is_empty(), "{wrong:#?}");
    }
}
