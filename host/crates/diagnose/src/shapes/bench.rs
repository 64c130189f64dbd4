//! A plain sensor on a bench, for tests: frames from equations that share nothing with
//! `sensor-core`, as moments.

use super::view::View;
use crate::data::design::{Condition, Design, Stack};
use crate::data::variation::FrameVariation;
use crate::model::prediction::Prediction;
use crate::model::replicate;
use crate::statistics::battery::battery;
use crate::statistics::maps::{self, Map};
use crate::statistics::statistic::by_key;
use crate::statistics::temporal::{Collector, Temporal};
use camrig_base::Plane;
use camrig_camera::Camera;
use camrig_captures::Role;
use rand_distr::{Distribution, Normal, Poisson};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;

pub(crate) const WIDTH: usize = 72;
pub(crate) const HEIGHT: usize = 56;
/// DN/e⁻, DN, e⁻, e⁻/s.
const GAIN: f64 = 0.4;
const BLACK: f64 = 100.0;
const READ_E: f64 = 5.0;
const DARK_E_PER_S: f64 = 12.0;
const PRNU: f64 = 0.008;
/// Exposure and photo-electrons of each stack; frames of a half.
const PLAN: [(f64, f64); 7] = [
    (0.02, 0.0),
    (3.0, 0.0),
    (0.02, 350.0),
    (0.02, 1600.0),
    (0.02, 3900.0),
    (0.02, 6600.0),
    (0.02, 8900.0),
];
const FRAMES: usize = 10;

/// A frame as it is made.
pub(crate) struct Shot<'a> {
    pub rng: &'a mut Xoshiro256PlusPlus,
    /// Mean photo-electrons.
    pub signal: f64,
    pub exposure_s: f64,
}

impl Shot<'_> {
    /// A standard normal deviate.
    pub fn normal(&mut self) -> f64 {
        Normal::new(0.0, 1.0).unwrap().sample(self.rng)
    }
}

/// A change of a frame's pixels, e⁻.
type Change<'a> = dyn Fn(&mut [f64], &mut Shot<'_>) + 'a;

/// What a test hides: on the mean electrons before shot noise, and on electrons after read noise.
#[derive(Default)]
pub(crate) struct Hidden<'a> {
    pub charge: Option<&'a Change<'a>>,
    pub volts: Option<&'a Change<'a>>,
    /// Read noise, where it is not the model's, e⁻.
    pub read_e: Option<f64>,
}

/// Both halves of a set.
pub(crate) struct Bench {
    pub camera: Camera,
    pub design: Design,
    pub stacks: [Vec<Temporal>; 2],
    maps: [Vec<Map>; 2],
    prediction: Prediction,
}

fn camera() -> Camera {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bench.toml");
    let text = format!(
        "name = \"bench\"\n[lens]\nkind = \"diffraction-limited\"\nf_number = 2.8\n\
         focal_length_mm = 8.0\n[sensor]\nwidth = {WIDTH}\nheight = {HEIGHT}\npitch_um = 5.0\n\
         fill_factor = 1.0\ncfa = \"mono\"\nqe = 0.55\nconversion_gain_uv_per_e = 50.0\n\
         full_well_e = {}\nbits = 12\nblack_level_dn = {BLACK}\ntemperature_c = 20.0\nseed = 1\n\
         [sensor.noise]\nread_e = {READ_E}\ndark_current_e_per_s = {DARK_E_PER_S}\n\
         dark_doubling_c = 7.0\ntemperature_ref_c = 20.0\ndsnu_e_per_s = 0.0\nprnu = {PRNU}\n\
         row_fpn_e = 0.0\n",
        4095.0 / GAIN
    );
    std::fs::write(&path, text).unwrap();
    Camera::load(path.to_str().unwrap()).unwrap()
}

fn design() -> Design {
    let condition = |(i, &(exposure_s, photo_e)): (usize, &(f64, f64))| Condition {
        stack: Stack {
            capture: i,
            id: format!("stack-{i}"),
            role: if photo_e > 0.0 { Role::Flat } else { Role::Dark },
            skip: 0,
            frames: FRAMES,
            total: FRAMES,
            variation: FrameVariation::default(),
            first_number: 10_000 * (i as u32 + 1),
            exposure_s,
            analog_gain: 1.0,
            temperature_c: 20.0,
        },
        photo_e: vec![photo_e],
        before_e: vec![photo_e],
        level_known: true,
        even: true,
        wavelength_nm: Some(530.0),
    };
    let conditions = PLAN.iter().enumerate().map(condition).collect();
    Design { conditions, targets: Vec::new(), white_level_dn: 4095 }
}

/// A set in which something is hidden.
pub(crate) fn shoot(seed: u64, hidden: &Hidden<'_>) -> Bench {
    let (camera, design) = (camera(), design());
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let normal = Normal::new(0.0, 1.0).unwrap();
    let response: Vec<f64> =
        (0..WIDTH * HEIGHT).map(|_| 1.0 + PRNU * normal.sample(&mut rng)).collect();
    let read_e = hidden.read_e.unwrap_or(READ_E);
    let mut stack = |exposure_s: f64, photo_e: f64| {
        let mut collector = Collector::new(WIDTH, HEIGHT, 4095, true);
        let frames: Vec<Plane<u16>> = (0..FRAMES)
            .map(|_| {
                let mut shot = Shot { rng: &mut rng, signal: photo_e, exposure_s };
                let mut e: Vec<f64> =
                    response.iter().map(|r| photo_e * r + DARK_E_PER_S * exposure_s).collect();
                hidden.charge.iter().for_each(|change| change(&mut e, &mut shot));
                for v in &mut e {
                    let charge: f64 = Poisson::new(v.max(1e-9)).unwrap().sample(shot.rng);
                    *v = charge + read_e * shot.normal();
                }
                hidden.volts.iter().for_each(|change| change(&mut e, &mut shot));
                let code = |v: &f64| (BLACK + GAIN * v).round().clamp(0.0, 4095.0) as u16;
                Plane { width: WIDTH, height: HEIGHT, data: e.iter().map(code).collect() }
            })
            .collect();
        collector.add(&frames);
        collector.finish().without_border(&camera.sensor.pattern())
    };
    let stacks = [0, 1].map(|_| PLAN.map(|(t, e)| stack(t, e)).to_vec());
    let maps = [0, 1].map(|i: usize| maps::maps(&camera, &design, &stacks[i]));
    let replicates: Vec<_> = (0..3)
        .map(|seed| {
            let stacks = replicate::simulate(&camera, &design, seed, true).unwrap();
            by_key(battery(&camera, &design, &stacks))
        })
        .collect();
    let prediction = Prediction::new(&replicates);
    Bench { camera, design, stacks, maps, prediction }
}

impl Bench {
    /// One half.
    pub fn view(&self, half: usize) -> View<'_> {
        View {
            camera: &self.camera,
            design: &self.design,
            stacks: &self.stacks[half],
            maps: &self.maps[half],
            prediction: Some(&self.prediction),
        }
    }
}

/// The figure of a finding.
pub(crate) fn figure(finding: &crate::finding::Finding, key: &str) -> f64 {
    finding.parameters.iter().find(|p| p.0 == key).unwrap_or_else(|| panic!("{key}")).1.value
}
