//! Sets from equations of their own, of sensors as people have them.

use super::*;
use crate::report::{Evidence, Verdict};
use camrig_base::npy;
use rand_distr::{Distribution, Exp, Normal, Poisson};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use std::collections::BTreeSet;
use std::f64::consts::{LN_2, TAU};
use std::fmt::Write as _;
use std::path::PathBuf;

const BLACK: f64 = 100.0;
const GAIN: f64 = 0.5;
const READ_E: f64 = 5.0;
const DARK_E_PER_S: f64 = 4.0;
const PRNU: f64 = 0.007;
/// What neighbours share of it, where that is hidden.
const SHARED_PRNU: f64 = 0.012;
const EFFICIENCY: f64 = 0.6;

/// A stack: exposure, photo-electrons, temperature, frames.
#[derive(Clone, Copy)]
struct Taken {
    exposure_s: f64,
    light_e: f64,
    temperature_c: f64,
    analog_gain: f64,
    frames: usize,
}

fn dark(exposure_s: f64, frames: usize) -> Taken {
    Taken { exposure_s, light_e: 0.0, temperature_c: 20.0, analog_gain: 1.0, frames }
}

fn flat(light_e: f64) -> Taken {
    Taken { exposure_s: 0.01, light_e, ..dark(0.0, 8) }
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
    hidden: Hidden,
}

/// What else may be hidden.
#[derive(Clone, Default)]
struct Hidden {
    /// Colour pattern; none of a monochrome sensor.
    cfa: Option<&'static str>,
    /// Particles per second on the whole sensor, and the charge that they leave per pixel.
    hits_per_s: f64,
    charge_e: f64,
    /// Offset of the frame: standard deviation, DN, and correlation with the one before.
    offset_dn: f64,
    memory: f64,
    /// The same of each site, white.
    site_offset_dn: f64,
    /// Noise of rows of opposite sign in even and odd columns.
    opposite_e: f64,
    /// What stays behind at each transfer, along rows and down columns.
    inefficiency: [f64; 2],
    truncates: bool,
    /// Noise of pixels behind the gain, DN, and offsets of columns there.
    behind_dn: f64,
    columns_dn: Vec<f64>,
    /// Gain of each site relative to the mean, less 1.
    more_gain: [f64; 4],
    /// Black level of exposed frames above that of the bias, DN.
    clamp_dn: f64,
    /// Depth of the light's waves at each site and the angle in degrees by which they lag; their
    /// frequency, cycles per row.
    flicker: [[f64; 2]; 4],
    cycles_per_row: f64,
    /// Exposure of one more dark stack, s; none at 0.
    longest_s: f64,
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
            hidden: Hidden::default(),
            rng,
        }
    }

    /// So many pixels, anywhere.
    fn some(&mut self, count: usize) -> Vec<usize> {
        let law = rand_distr::Uniform::new(0, self.side * self.side).unwrap();
        (0..count).map(|_| law.sample(&mut self.rng)).collect()
    }

    fn normal(&mut self) -> f64 {
        Normal::new(0.0, 1.0).unwrap().sample(&mut self.rng)
    }

    fn uniform(&mut self) -> f64 {
        rand_distr::Uniform::new(0.0, 1.0).unwrap().sample(&mut self.rng)
    }

    fn poisson(&mut self, mean: f64) -> f64 {
        Poisson::new(mean).map_or(0.0, |law| law.sample(&mut self.rng))
    }

    /// Frames of a stack, one after the other.
    fn stack(&mut self, taken: Taken) -> Vec<u16> {
        let mut wandering = self.normal();
        let frame = |_| {
            let memory = self.hidden.memory;
            wandering = memory * wandering + (1.0 - memory * memory).sqrt() * self.normal();
            let offset = self.hidden.offset_dn * wandering;
            self.frame(taken, offset)
        };
        (0..taken.frames).flat_map(frame).collect()
    }

    fn frame(&mut self, taken: Taken, offset_dn: f64) -> Vec<u16> {
        let side = self.side;
        let mut charges = Vec::with_capacity(side * side);
        let flickers = self.hidden.cycles_per_row > 0.0;
        let start = if flickers { self.uniform() } else { 0.0 };
        for p in 0..side * side {
            let on = if self.jump[p] > 0.0 && self.uniform() < 0.5 { self.jump[p] } else { 0.0 };
            let (x, y) = (p % side, p / side);
            let turns = start + self.hidden.cycles_per_row * y as f64;
            let [depth, lag] = self.hidden.flicker[y % 2 * 2 + x % 2];
            let wave = depth * (TAU * turns - lag.to_radians()).sin();
            let mean = taken.light_e * (1.0 + wave) * self.response[p]
                + (self.rate[p] + on) * taken.exposure_s
                + self.wait_e * y as f64;
            charges.push(self.poisson(mean));
        }
        for _ in 0..self.poisson(self.hidden.hits_per_s * taken.exposure_s) as usize {
            self.hit(&mut charges);
        }
        self.transfer(&mut charges);
        let sites: Vec<f64> = (0..4).map(|_| self.hidden.site_offset_dn * self.normal()).collect();
        let clamp = if taken.exposure_s > 0.0 { self.hidden.clamp_dn } else { 0.0 };
        let black = BLACK + self.per_kelvin_dn * (taken.temperature_c - 20.0) + offset_dn + clamp;
        let mut frame = Vec::with_capacity(side * side);
        for y in 0..side {
            let row = self.row_noise_e * self.normal();
            let opposite = self.hidden.opposite_e;
            let opposite = if opposite > 0.0 { opposite * self.normal() } else { 0.0 };
            for x in 0..side {
                let row = row + if x % 2 == 0 { opposite } else { -opposite };
                let e = charges[y * side + x] + READ_E * self.normal() + row;
                let column = self.hidden.columns_dn.get(x).copied().unwrap_or(0.0);
                let behind = self.hidden.behind_dn * self.normal() + column;
                let site = y % 2 * 2 + x % 2;
                let gain = GAIN * taken.analog_gain * (1.0 + self.hidden.more_gain[site]);
                let level = black + sites[site] + behind + gain * e;
                let code = if self.hidden.truncates { level.floor() } else { level.round() };
                frame.push(code.clamp(0.0, 4095.0) as u16);
            }
        }
        frame
    }

    /// A particle: steps of a hundredth of a pixel along its way through a layer one pixel deep.
    fn hit(&mut self, charges: &mut [f64]) {
        let side = self.side as f64;
        let (mut x, mut y) = (self.uniform() * side, self.uniform() * side);
        // From above by cos²: what crosses a plane has the density cos³ θ sin θ.
        let cos = loop {
            let cos = self.uniform();
            if self.uniform() < cos.powi(3) {
                break cos;
            }
        };
        let turn = TAU * self.uniform();
        let sin = (1.0 - cos * cos).sqrt();
        let mut depth = 0.0;
        while depth < 1.0 {
            if (0.0..side).contains(&x) && (0.0..side).contains(&y) {
                charges[y as usize * self.side + x as usize] += 0.01 * self.hidden.charge_e;
            }
            x += 0.01 * sin * turn.cos();
            y += 0.01 * sin * turn.sin();
            depth += 0.01 * cos;
        }
    }

    /// Transfers one after the other: at each, every packet leaves its share to the one behind it.
    fn transfer(&self, charges: &mut [f64]) {
        let side = self.side;
        for (share, step) in self.hidden.inefficiency.into_iter().zip([1, side]) {
            if share == 0.0 {
                continue;
            }
            for line in 0..side {
                let start = if step == 1 { line * side } else { line };
                let at = |i: usize| start + i * step;
                // Packets still on their way; each transfer takes the first one out.
                for first in 0..side {
                    for i in (first..side).rev() {
                        let left = share * charges[at(i)];
                        charges[at(i)] -= left;
                        if i + 1 < side {
                            charges[at(i + 1)] += left;
                        }
                    }
                }
            }
        }
    }

    /// Takes a set, and writes it beside the file of a camera without what is hidden.
    fn take(&mut self, stacks: &[Taken]) -> (Camera, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        let side = self.side;
        let cfa = self.hidden.cfa.unwrap_or("mono");
        let sensor = format!(
            "width = {side}\nheight = {side}\nbits = 12\ncfa = \"{cfa}\"\nblack_level_dn = {BLACK}\n\
             pitch_um = 6.5\n"
        );
        let mut manifest = format!("format = \"captures/1\"\n[sensor]\n{sensor}");
        for (i, taken) in stacks.iter().enumerate() {
            let values = self.stack(*taken);
            let mut file = npy::header("<u2", &format!("({}, {side}, {side})", taken.frames));
            file.extend(values.iter().flat_map(|v| v.to_le_bytes()));
            std::fs::write(at.join(format!("{i}.npy")), file).unwrap();
            let role = if taken.light_e > 0.0 { "flat" } else { "dark" };
            write!(
                manifest,
                "[[capture]]\nid = \"s{i}\"\nrole = \"{role}\"\nfiles = \"{i}.npy\"\n\
                 exposure_s = {}\nanalog_gain = {}\ntemperature_c = {}\n",
                taken.exposure_s, taken.analog_gain, taken.temperature_c
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
        let (head, columns) = if cfa == "mono" { ("qe", 1) } else { ("r,g,b", 3) };
        let row = vec![EFFICIENCY.to_string(); columns].join(",");
        let qe: String = (300..=1100).step_by(20).map(|nm| format!("{nm},{row}\n")).collect();
        std::fs::write(at.join("qe.csv"), format!("wavelength_nm,{head}\n{qe}")).unwrap();
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

/// Offsets of frames that are the same at every gain are none of the pixels'.
#[test]
fn offsets_of_frames_behind_the_gain_are_told_from_those_before_it() {
    let mut sensor = Sensor::new(64, 11);
    sensor.hidden.offset_dn = 0.4;
    let high = |taken: Taken| Taken { analog_gain: 4.0, frames: 24, ..taken };
    let stacks = [dark(0.01, 24), dark(1.0, 24), flat(1500.0), flat(4000.0)];
    let diagnosis =
        found(&mut sensor, &[&stacks[..], &[high(dark(0.01, 24)), high(flat(500.0))]].concat());
    assert_eq!(diagnosis.report.verdict, Verdict::Explained);
    is_near(only_step(&diagnosis, "frame-offset-noise", "sigma_e"), 0.4 / GAIN);
    let exponent = diagnosis.report.steps[0].parameters.get("gain_exponent").map(|p| p.value);
    assert_eq!(exponent, Some(-1.0));
}

/// Greens that differ in their response and in what they see of light that flickers: even and odd
/// columns of green pixels differ, and nothing that reads them does.
#[test]
fn unequal_greens_are_not_channels_of_the_read_out() {
    let mut sensor = Sensor::new(64, 12);
    sensor.hidden.cfa = Some("GRBG");
    sensor.hidden.cycles_per_row = 0.0145;
    sensor.hidden.flicker = [[0.050, 0.0], [0.046, 8.0], [0.063, -12.5], [0.048, 2.0]];
    for p in 0..64 * 64 {
        let (x, y) = (p % 64 % 2, p / 64 % 2);
        sensor.response[p] *= [0.987, 1.0, 1.0, 1.013][y * 2 + x];
    }
    let stacks = [dark(0.01, 16), dark(1.0, 16), flat(2000.0), flat(5000.0)];
    let diagnosis = found(&mut sensor, &stacks);
    let steps: Vec<&str> = diagnosis.report.steps.iter().map(|s| &s.effect[..]).collect();
    assert!(steps.contains(&"green-imbalance"), "{steps:?}, {:?}", diagnosis.report.unexplained);
    assert!(!steps.contains(&"readout-channel-mismatch"), "{steps:?}");
}

/// Columns that two amplifiers read in turn.
#[test]
fn channels_of_the_read_out_are_named_by_the_pattern_that_they_have() {
    let mut sensor = Sensor::new(64, 13);
    sensor.hidden.columns_dn = (0..64).map(|x| [1.0, -1.0][x % 2]).collect();
    let stacks = [dark(0.01, 16), dark(1.0, 16), flat(2000.0), flat(5000.0)];
    let diagnosis = found(&mut sensor, &stacks);
    let (sigma, error) = only_step(&diagnosis, "readout-channel-mismatch", "offset_e");
    let left = &diagnosis.report.unexplained;
    assert_eq!(diagnosis.report.verdict, Verdict::Explained, "{left:?}");
    // Two numbers a contrast of 2 DN apart.
    assert!((sigma - 2.0f64.sqrt() / GAIN).abs() < 4.0 * error, "{sigma} ± {error}");
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

/// An effect hidden by a draw, and what its evidence must say.
struct Case {
    effect: &'static str,
    hide: fn(&mut Sensor),
    /// Other names that are right too.
    also: &'static [&'static str],
    check: fn(&Evidence, &Sensor) -> bool,
}

fn amount(evidence: &Evidence, name: &str) -> (f64, f64) {
    let found = evidence.amounts.iter().find(|a| a.name == name);
    let found = found.unwrap_or_else(|| panic!("{name}: {evidence:?}"));
    (found.value, found.std_error)
}

/// Whether an amount is within four errors of the right one.
fn is_right(evidence: &Evidence, name: &str, right: f64) -> bool {
    let (value, error) = amount(evidence, name);
    (value - right).abs() < 4.0 * error
}

/// A place between the edges of a sensor of so many pixels a side.
fn place(sensor: &mut Sensor) -> usize {
    4 + (sensor.uniform() * (sensor.side - 12) as f64) as usize
}

const SITES: [&str; 4] = ["site 0,0", "site 1,0", "site 0,1", "site 1,1"];

const CASES: [Case; 14] = [
    Case {
        effect: "particle-hits",
        hide: |s| {
            s.hidden.hits_per_s = 0.3 + 0.5 * s.uniform();
            s.hidden.charge_e = 800.0 + 800.0 * s.uniform();
        },
        also: &[],
        check: |e, s| {
            let per_mpx = 1e6 / (s.side * s.side) as f64;
            // The mean way through the layer is 4/3 of its depth.
            let charge = amount(e, "mean_charge_e").0 / s.hidden.charge_e;
            is_right(e, "rate_per_mpx_s", s.hidden.hits_per_s * per_mpx)
                && (0.9..2.2).contains(&charge)
        },
    },
    Case {
        effect: "frame-offset-noise",
        hide: |s| {
            s.hidden.offset_dn = 0.3 + 0.5 * s.uniform();
            s.hidden.memory = 0.75 + 0.15 * s.uniform();
        },
        also: &[],
        check: |e, s| {
            is_right(e, "correlation", s.hidden.memory)
                && is_right(e, "sigma", s.hidden.offset_dn)
                && amount(e, "time_constant").0 > 1.0
        },
    },
    Case {
        effect: "black-level-offset",
        hide: |s| s.hidden.truncates = true,
        also: &[],
        check: |e, _| e.description.contains("truncates"),
    },
    Case {
        effect: "frame-offset-by-site",
        hide: |s| {
            s.hidden.cfa = Some("GRBG");
            s.hidden.site_offset_dn = 0.3 + 0.5 * s.uniform();
        },
        // They are offsets of the converter's, not of the pixels.
        also: &["gain-stage"],
        check: |e, s| is_right(e, "sigma", s.hidden.site_offset_dn),
    },
    Case {
        effect: "row-noise-of-opposite-sign",
        hide: |s| s.hidden.opposite_e = 1.0 + s.uniform(),
        also: &[],
        check: |e, s| is_right(e, "sigma_e", s.hidden.opposite_e),
    },
    Case {
        effect: "dark-current-by-site",
        hide: |s| {
            s.hidden.cfa = Some("GRBG");
            let site = (s.uniform() * 4.0) as usize;
            let more = 1.0 + 2.0 * s.uniform();
            for p in 0..s.side * s.side {
                s.rate[p] += if p / s.side % 2 * 2 + p % s.side % 2 == site { more } else { 0.0 };
            }
        },
        // The median of all pixels moves with one site.
        also: &["dark-current"],
        check: |e, s| {
            SITES
                .into_iter()
                .enumerate()
                .all(|(site, name)| is_right(e, name, GAIN * s.rate[site / 2 * s.side + site % 2]))
        },
    },
    Case {
        effect: "defective-areas",
        hide: |s| {
            let (dead, hot, [x, y]) = (place(s), place(s), [place(s), place(s)]);
            let side = s.side;
            (0..side).for_each(|x| s.response[dead * side + x] *= 0.3);
            (0..side).for_each(|x| s.rate[hot * side + x] += 30.0);
            for i in 0..25 {
                s.rate[(y + i / 5) * side + x + i % 5] += 400.0;
            }
        },
        also: &[],
        check: |e, s| {
            let side = s.side;
            let of = |name: &str| {
                e.amounts.iter().filter(|a| a.name == name).map(|a| a.value).collect::<Vec<_>>()
            };
            let dead = (0..side).find(|y| s.response[y * side] < 0.5).unwrap();
            of("top")[0] == dead as f64
                && (of("gain")[0] - 0.3).abs() < 0.02
                && of("width").contains(&(side as f64))
                && of("width").contains(&5.0)
        },
    },
    Case {
        effect: "prnu-correlated",
        hide: |s| {
            let width = s.side + 1;
            let corners: Vec<f64> = (0..width * width).map(|_| s.normal()).collect();
            for p in 0..s.side * s.side {
                let at = p / s.side * width + p % s.side;
                let around = [0, 1, width, width + 1].map(|d| corners[at + d]);
                s.response[p] += 0.5 * SHARED_PRNU * around.iter().sum::<f64>();
            }
        },
        also: &[],
        check: |e, _| is_right(e, "sigma", SHARED_PRNU),
    },
    Case {
        effect: "charge-transfer-inefficiency",
        hide: |s| s.hidden.inefficiency = [0.001 + 0.001 * s.uniform(), 0.001],
        // Charge that comes with the next pixel evens out what pixels differ by.
        also: &["prnu"],
        check: |e, s| {
            is_right(e, "serial", s.hidden.inefficiency[0])
                && is_right(e, "parallel", s.hidden.inefficiency[1])
        },
    },
    Case {
        effect: "gain-stage",
        hide: |s| {
            s.hidden.behind_dn = 1.0 + s.uniform();
            s.hidden.columns_dn = (0..s.side).map(|_| 0.6 * s.normal()).collect();
        },
        // There is more of both at unity gain too.
        also: &["read-noise", "column-offset-fpn"],
        check: |e, s| {
            let n = s.side as f64;
            let columns = (s.hidden.columns_dn.iter().map(|c| c * c).sum::<f64>() / n).sqrt();
            is_right(e, "read_noise_behind", s.hidden.behind_dn)
                && is_right(e, "column_pattern_behind", columns)
        },
    },
    Case {
        effect: "gain-by-site",
        hide: |s| {
            s.hidden.cfa = Some("GRBG");
            let more = 0.12 + 0.06 * s.uniform();
            s.hidden.more_gain = [more, -more, -more, more];
        },
        // The same charge is more codes at some sites; the median lies among those of one half.
        also: &["dark-current-by-site", "dark-current", "read-noise-spread", "read-noise"],
        check: |e, s| {
            let gains = SITES.into_iter().zip(s.hidden.more_gain);
            gains.into_iter().all(|(name, more)| is_right(e, name, GAIN * (1.0 + more)))
        },
    },
    Case {
        effect: "flicker-by-site",
        hide: |s| {
            s.hidden.cfa = Some("GRBG");
            s.hidden.cycles_per_row = 0.03 + 0.02 * s.uniform();
            let [red, blue] = [0.05 + 0.02 * s.uniform(), 0.12 + 0.05 * s.uniform()];
            let lag = 5.0 + 10.0 * s.uniform();
            s.hidden.flicker = [[0.09, 0.0], [red, lag], [blue, -lag], [0.09, 2.0]];
        },
        also: &["flicker-banding"],
        check: |e, s| {
            // Against those of the first site, which have errors of their own.
            let near = |name: &str, right: f64, error: f64| {
                let (value, own) = amount(e, name);
                (value - right).abs() < 4.0 * own.hypot(error)
            };
            let (first, lag) = (amount(e, SITES[0]), amount(e, "lag of site 0,0"));
            SITES.into_iter().zip(s.hidden.flicker).all(|(name, [depth, later])| {
                let ratio = depth / s.hidden.flicker[0][0];
                near(name, first.0 * ratio, first.1 * ratio)
                    && near(&format!("lag of {name}"), lag.0 + later, lag.1)
            })
        },
    },
    Case {
        effect: "dark-current-telegraph-noise",
        hide: |s| {
            let law = Exp::new(1.0 / (30.0 + 30.0 * s.uniform())).unwrap();
            for p in s.some(40) {
                s.jump[p] = law.sample(&mut s.rng);
            }
            s.hidden.longest_s = 12.0;
        },
        // Their mean rate is higher too.
        also: &["hot-pixels"],
        check: |e, s| {
            let jumps = s.jump.iter().filter(|j| **j > 0.0);
            let mean = jumps.clone().sum::<f64>() / jumps.count() as f64;
            let median = amount(e, "median_jump").0 / (GAIN * LN_2 * mean);
            is_right(e, "exponent", 1.0) && (0.5..2.0).contains(&median)
        },
    },
    Case {
        effect: "black-level-over-exposure",
        hide: |s| s.hidden.clamp_dn = 0.3 + 0.5 * s.uniform(),
        also: &[],
        check: |e, s| is_right(e, "step", s.hidden.clamp_dn),
    },
];

/// Darks of three exposures and two gains, two flats.
fn plan(hidden: &Hidden) -> Vec<Taken> {
    let high = Taken { analog_gain: 4.0, ..dark(0.0, 16) };
    let all = [dark(0.0, 24), dark(2.0, 16), dark(6.0, 16), flat(2000.0), flat(5000.0), high];
    let longest = (hidden.longest_s > 0.0).then(|| dark(hidden.longest_s, 16));
    all.into_iter().chain(longest).collect()
}

/// What the frames of a sensor show of each effect, without a search.
fn evidence(sensor: &mut Sensor) -> Vec<Evidence> {
    let stacks = plan(&sensor.hidden);
    let (camera, folder) = sensor.take(&stacks);
    let set = CaptureSet::load(&folder).unwrap();
    let (camera, cleaned, measured) =
        measure(&camera, set, Keep::Moments, &Options::default()).unwrap();
    let names = Names::of(&camera, &cleaned, &measured).unwrap().unwrap();
    std::fs::remove_dir_all(folder).unwrap();
    names.evidence(&names.given, &[], false)
}

/// What is wrong in what is named of a hidden effect: that it is not, its amounts, other names.
fn wrong(case: &Case, draw: u64) -> Vec<String> {
    let mut sensor = Sensor::new(112, 1000 + draw);
    (case.hide)(&mut sensor);
    let found = evidence(&mut sensor);
    let is_own = |e: &&Evidence| e.effect == case.effect && e.is_named();
    let own = found.iter().find(is_own);
    let missed = own.is_none().then(|| "not named".into());
    let off = own.filter(|e| !(case.check)(e, &sensor)).map(|e| format!("{e:?}"));
    let is_false = |e: &&Evidence| {
        e.is_named() && e.effect != case.effect && !case.also.contains(&&e.effect[..])
    };
    let others = found.iter().filter(is_false).map(|e| format!("{e:?}"));
    let all = missed.into_iter().chain(off).chain(others);
    all.map(|what: String| format!("{}, draw {draw}: {what}", case.effect)).collect()
}

/// Names where nothing is hidden.
fn by_chance(cfa: Option<&'static str>, draw: u64) -> Vec<String> {
    let mut sensor = Sensor::new(112, 2000 + draw);
    sensor.hidden.cfa = cfa;
    let found = evidence(&mut sensor);
    found
        .iter()
        .filter(|e| e.is_named())
        .map(|e| format!("nothing, {draw}: {}", e.effect))
        .collect()
}

#[test]
fn what_real_sensors_do_is_named_by_its_evidence_and_nothing_else_is() {
    let mut all: Vec<String> = CASES.iter().flat_map(|case| wrong(case, 0)).collect();
    all.extend([None, Some("GRBG")].into_iter().flat_map(|cfa| by_chance(cfa, 0)));
    assert!(all.is_empty(), "{all:#?}");
}

#[test]
#[ignore = "a hundred sets, minutes: ci/full"]
fn each_is_named_in_nine_of_ten_draws() {
    let mut all = Vec::new();
    for case in &CASES {
        let of_draws: Vec<Vec<String>> = (1..=10).map(|draw| wrong(case, draw)).collect();
        let right = of_draws.iter().filter(|w| w.is_empty()).count();
        println!("{}: {right} of 10 {:#?}", case.effect, of_draws.concat());
        all.extend((right < 9).then_some(case.effect));
    }
    let by_chance =
        (1..=10).flat_map(|d| [by_chance(None, d), by_chance(Some("GRBG"), d)].concat());
    let by_chance: Vec<String> = by_chance.collect();
    assert!(all.is_empty() && by_chance.is_empty(), "{all:?} {by_chance:#?}");
}

/// Hidden, found, named, added: the gap of the model with it is smaller.
#[test]
#[ignore = "whole diagnoses, minutes: ci/full"]
fn each_is_added_to_the_model_and_the_gap_shrinks() {
    let mut all = Vec::new();
    // Gains of sites are told, and in no model yet: where other noise is missing too, the rest of it
    // was named wrongly beside them (a real sensor, 192 x 160 pixels).
    for case in CASES.iter().filter(|case| case.effect != "gain-by-site") {
        let mut sensor = Sensor::new(112, 3000);
        (case.hide)(&mut sensor);
        let stacks = plan(&sensor.hidden);
        let (camera, folder) = sensor.take(&stacks);
        let set = CaptureSet::load(&folder).unwrap();
        let found = diagnose(&camera, set, &Options::default()).unwrap();
        std::fs::remove_dir_all(folder).unwrap();
        let report = &found.report;
        let steps: Vec<&str> = report.steps.iter().map(|s| &s.effect[..]).collect();
        let line = format!(
            "{}: {steps:?}, gap {} to {}, {:?}",
            case.effect, report.gap_before, report.gap_after, report.verdict
        );
        println!("{line}");
        // Particles are left out of the frames: nothing else is there. What four sites of sixteen
        // frames scatter by is no sample: the model with it passes in part.
        let shrinks = report.gap_after < 0.5 * report.gap_before && !steps.is_empty();
        all.extend((!shrinks && report.verdict != Verdict::Agrees).then_some(line));
    }
    assert!(all.is_empty(), "{all:#?}");
}
