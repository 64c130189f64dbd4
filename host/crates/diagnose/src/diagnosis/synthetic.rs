//! Sets from equations of their own, of sensors as people have them.

use super::*;
use crate::report::{Evidence, Verdict};
use camrig_base::npy;
use rand_distr::{Distribution, Exp, Normal, Poisson};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::PathBuf;

const BLACK: f64 = 100.0;
const GAIN: f64 = 0.5;
const READ_E: f64 = 5.0;
const DARK_E_PER_S: f64 = 4.0;
const PRNU: f64 = 0.007;
const EFFICIENCY: f64 = 0.6;

/// A stack: exposure, photo-electrons, temperature, frames.
#[derive(Clone, Copy)]
struct Taken {
    exposure_s: f64,
    light_e: f64,
    temperature_c: f64,
    frames: usize,
}

fn dark(exposure_s: f64, frames: usize) -> Taken {
    Taken { exposure_s, light_e: 0.0, temperature_c: 20.0, frames }
}

fn flat(light_e: f64) -> Taken {
    Taken { exposure_s: 0.01, light_e, temperature_c: 20.0, frames: 8 }
}

/// A sensor with what is hidden in it.
struct Sensor {
    side: usize,
    rng: Xoshiro256PlusPlus,
    /// Of each pixel: relative response, dark current in e⁻/s, jump of its dark current.
    response: Vec<f64>,
    rate: Vec<f64>,
    jump: Vec<f64>,
    row_noise_e: f64,
    per_kelvin_dn: f64,
    /// Charge that each row gathers while it waits, e⁻.
    wait_e: f64,
}

impl Sensor {
    fn new(side: usize, seed: u64) -> Self {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let law = Normal::new(1.0, PRNU).unwrap();
        let n = side * side;
        Self {
            side,
            response: (0..n).map(|_| law.sample(&mut rng)).collect(),
            rate: vec![DARK_E_PER_S; n],
            jump: vec![0.0; n],
            row_noise_e: 0.0,
            per_kelvin_dn: 0.0,
            wait_e: 0.0,
            rng,
        }
    }

    /// So many pixels, anywhere.
    fn some(&mut self, count: usize) -> Vec<usize> {
        let law = rand_distr::Uniform::new(0, self.side * self.side).unwrap();
        (0..count).map(|_| law.sample(&mut self.rng)).collect()
    }

    fn frame(&mut self, taken: Taken) -> Vec<u16> {
        let normal = Normal::new(0.0, 1.0).unwrap();
        let half = rand_distr::Bernoulli::new(0.5).unwrap();
        let mut frame = Vec::with_capacity(self.side * self.side);
        for y in 0..self.side {
            let row = self.row_noise_e * normal.sample(&mut self.rng);
            for x in 0..self.side {
                let p = y * self.side + x;
                let on = f64::from(u8::from(half.sample(&mut self.rng)));
                let mean = taken.light_e * self.response[p]
                    + (self.rate[p] + on * self.jump[p]) * taken.exposure_s
                    + self.wait_e * y as f64;
                let e = match Poisson::new(mean) {
                    Ok(law) => law.sample(&mut self.rng),
                    Err(_) => 0.0,
                } + READ_E * normal.sample(&mut self.rng)
                    + row;
                let black = BLACK + self.per_kelvin_dn * (taken.temperature_c - 20.0);
                frame.push((black + GAIN * e).round().clamp(0.0, 4095.0) as u16);
            }
        }
        frame
    }

    /// Takes a set, and writes it beside the file of a camera without what is hidden.
    fn take(&mut self, stacks: &[Taken]) -> (Camera, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        let side = self.side;
        let sensor = format!(
            "width = {side}\nheight = {side}\nbits = 12\ncfa = \"mono\"\nblack_level_dn = {BLACK}\n\
             pitch_um = 6.5\n"
        );
        let mut manifest = format!("format = \"captures/1\"\n[sensor]\n{sensor}");
        for (i, taken) in stacks.iter().enumerate() {
            let values: Vec<u16> = (0..taken.frames).flat_map(|_| self.frame(*taken)).collect();
            let mut file = npy::header("<u2", &format!("({}, {side}, {side})", taken.frames));
            file.extend(values.iter().flat_map(|v| v.to_le_bytes()));
            std::fs::write(at.join(format!("{i}.npy")), file).unwrap();
            let role = if taken.light_e > 0.0 { "flat" } else { "dark" };
            write!(
                manifest,
                "[[capture]]\nid = \"s{i}\"\nrole = \"{role}\"\nfiles = \"{i}.npy\"\n\
                 exposure_s = {}\nanalog_gain = 1.0\ntemperature_c = {}\n",
                taken.exposure_s, taken.temperature_c
            )
            .unwrap();
            if taken.light_e > 0.0 {
                let photons = taken.light_e / EFFICIENCY / taken.exposure_s;
                write!(
                    manifest,
                    "[capture.light]\nphotons_per_pixel_per_s = {photons}\nwavelength_nm = 550.0\n\
                     uniformity = \"flat\"\n"
                )
                .unwrap();
            }
        }
        std::fs::write(at.join("captures.toml"), manifest).unwrap();
        let qe: String =
            (300..=1100).step_by(20).map(|nm| format!("{nm},{EFFICIENCY}\n")).collect();
        std::fs::write(at.join("qe.csv"), format!("wavelength_nm,qe\n{qe}")).unwrap();
        let full_well = 4095.0 / GAIN;
        std::fs::write(
            at.join("camera.toml"),
            format!(
                "name = \"own\"\n[lens]\nkind = \"diffraction-limited\"\nf_number = 2.8\n\
                 focal_length_mm = 8.0\n[sensor]\n{sensor}fill_factor = 1.0\nqe = \"qe.csv\"\n\
                 conversion_gain_uv_per_e = 50.0\nfull_well_e = {full_well}\ntemperature_c = 20.0\n\
                 seed = 1\n[sensor.noise]\nread_e = {READ_E}\n\
                 dark_current_e_per_s = {DARK_E_PER_S}\ndark_doubling_c = 7.0\n\
                 temperature_ref_c = 20.0\ndsnu_e_per_s = 0.0\nprnu = {PRNU}\nrow_fpn_e = 0.0\n"
            ),
        )
        .unwrap();
        let camera = Camera::load(at.join("camera.toml").to_str().unwrap()).unwrap();
        // Frames are read later: the caller removes the folder.
        (camera, folder.keep())
    }
}

/// A parameter of the only step of a report, in standard errors from the right value.
fn only_step(found: &Diagnosis, effect: &str, parameter: &str) -> (f64, f64) {
    let [step] = &found.report.steps[..] else {
        panic!("{:?}", found.report.steps.iter().map(|s| &s.effect).collect::<Vec<_>>())
    };
    assert_eq!(step.effect, effect);
    let p = &step.parameters[parameter];
    (p.value, p.std_error.unwrap_or(0.0))
}

fn found(sensor: &mut Sensor, stacks: &[Taken]) -> Diagnosis {
    let (camera, folder) = sensor.take(stacks);
    let set = CaptureSet::load(&folder).unwrap();
    let found = diagnose(&camera, set, &Options::default()).unwrap();
    std::fs::remove_dir_all(folder).unwrap();
    found
}

fn is_near((value, error): (f64, f64), right: f64) {
    assert!((value - right).abs() < 4.0 * error, "{value} ± {error}, right {right}");
}

#[test]
fn a_few_very_hot_pixels_are_named_and_nothing_else() {
    let mut sensor = Sensor::new(64, 5);
    for p in sensor.some(14) {
        sensor.rate[p] += 700.0;
    }
    let diagnosis = found(&mut sensor, &[dark(0.01, 16), dark(4.0, 16)]);
    assert_eq!(diagnosis.report.verdict, Verdict::Explained);
    is_near(only_step(&diagnosis, "hot-pixels", "fraction"), 14.0 / 4096.0);
}

#[test]
fn columns_that_do_not_respond_are_named_with_their_places() {
    let mut sensor = Sensor::new(80, 6);
    let dead = [11, 40, 66];
    for p in (0..80 * 80).filter(|p| dead.contains(&(p % 80))) {
        sensor.response[p] = 0.0;
    }
    let flats = [300.0, 1500.0, 3000.0, 5000.0].map(flat);
    let diagnosis = found(&mut sensor, &[&[dark(0.01, 16), dark(4.0, 16)], &flats[..]].concat());
    let named = |e: &&Evidence| e.effect == "defective-columns";
    let evidence = diagnosis.report.evidence.iter().find(named).unwrap();
    let columns = evidence.amounts.iter().filter(|a| a.name == "column").map(|a| a.value);
    assert!(columns.eq(dead.map(|x| x as f64)));
    let gain = evidence.amounts.iter().find(|a| a.name == "gain").unwrap();
    is_near((gain.value, gain.std_error), 0.0);
    assert!(evidence.is_named());
}

#[test]
fn a_black_level_that_follows_the_temperature_is_named() {
    let mut sensor = Sensor::new(64, 7);
    sensor.per_kelvin_dn = 0.09;
    let mut stacks: Vec<Taken> = [1500.0, 4000.0].map(flat).to_vec();
    for temperature_c in [5.0, 20.0, 35.0] {
        // The dark current of this sensor is the same at all: too little of it to matter.
        stacks.push(Taken { temperature_c, ..dark(0.001, 16) });
    }
    let diagnosis = found(&mut sensor, &stacks);
    assert_eq!(diagnosis.report.verdict, Verdict::Explained);
    is_near(only_step(&diagnosis, "black-level-offset", "per_kelvin_dn"), 0.09);
}

#[test]
fn pixels_whose_dark_current_switches_are_told_from_noise_of_the_read_out() {
    let mut sensor = Sensor::new(112, 8);
    let law = Exp::new(1.0 / 40.0).unwrap();
    for p in sensor.some(40) {
        sensor.jump[p] = law.sample(&mut sensor.rng);
    }
    let stacks = [dark(0.0, 16), dark(10.0, 8), dark(40.0, 8), dark(80.0, 8)];
    let diagnosis = found(&mut sensor, &stacks);
    let steps: Vec<&str> = diagnosis.report.steps.iter().map(|s| &s.effect[..]).collect();
    assert_eq!(steps, ["dark-current-telegraph-noise"]);
    let parameters = &diagnosis.report.steps[0].parameters;
    // Forty pixels: a sixth of the share, as much of the mean.
    assert!((parameters["fraction"].value / (40.0 / 12544.0) - 1.0).abs() < 0.5);
    assert!((parameters["mean_e_per_s"].value / 40.0 - 1.0).abs() < 0.5);
}

#[test]
fn charge_that_grows_from_row_to_row_is_one_slope_and_no_wave() {
    let mut sensor = Sensor::new(96, 9);
    sensor.wait_e = 0.1;
    let flats = [1500.0, 4000.0].map(flat);
    let diagnosis = found(&mut sensor, &[&[dark(0.01, 16), dark(1.0, 16)], &flats[..]].concat());
    let shapes: Vec<_> = diagnosis.report.steps.iter().filter_map(|s| s.shape).collect();
    assert_eq!(shapes, [crate::report::Form::ColumnProfile]);
    let named = |e: &&Evidence| e.effect == "offset-slope";
    let evidence = diagnosis.report.evidence.iter().find(named).unwrap();
    let down = evidence.amounts.iter().find(|a| a.name == "top_to_bottom").unwrap();
    is_near((down.value, down.std_error), 0.1 * 95.0 * GAIN);
    assert!(
        !diagnosis.report.evidence.iter().any(|e| e.effect == "row-offset-fpn" && e.is_named())
    );
}

/// The same frames cropped at five sizes: what a part shows the whole shows too, and neither shows
/// what is not there.
#[test]
fn more_pixels_never_give_fewer_names() {
    const SIDE: usize = 160;
    let mut sensor = Sensor::new(SIDE, 10);
    sensor.row_noise_e = 2.0;
    let law = Exp::new(1.0 / 60.0).unwrap();
    for p in sensor.some(SIDE * SIDE / 50) {
        sensor.rate[p] += law.sample(&mut sensor.rng);
    }
    for p in sensor.some(SIDE * SIDE / 250) {
        sensor.jump[p] = 30.0 + law.sample(&mut sensor.rng);
    }
    sensor.rate.iter_mut().for_each(|r| *r += 2.0);
    let stacks =
        [dark(0.0, 16), dark(5.0, 8), dark(20.0, 8), dark(40.0, 8), flat(2000.0), flat(5000.0)];
    let (camera, folder) = sensor.take(&stacks);
    let right: BTreeSet<&str> =
        ["row-temporal-noise", "dark-current", "hot-pixels", "dark-current-telegraph-noise"]
            .into();
    let mut smaller = BTreeSet::new();
    for side in [48, 64, 96, 128, SIDE] {
        let at = (SIDE - side) / 2;
        let part = CaptureSet::load(&folder).unwrap().within([at, at, side, side]).unwrap();
        let (camera, cleaned, measured) =
            measure(&camera, part, Keep::Moments, &Options::default()).unwrap();
        let names = Names::of(&camera, &cleaned, &measured).unwrap().unwrap();
        let found = names.evidence(&names.given, &[], false);
        let named = found.iter().filter(|e| e.is_named()).map(|e| e.effect.clone());
        let named: BTreeSet<String> = named.collect();
        assert!(smaller.is_subset(&named), "{side}: {named:?}, before {smaller:?}");
        assert!(named.iter().all(|n| right.contains(&n[..])), "{side}: {named:?}");
        smaller = named;
    }
    std::fs::remove_dir_all(folder).unwrap();
    assert_eq!(smaller.len(), right.len(), "{smaller:?}");
}
