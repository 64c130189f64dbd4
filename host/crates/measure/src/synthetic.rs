//! An independent little sensor for the tests of this module: the textbook noise model written
//! with `rand_distr`, sharing nothing with the product's sensor.

use camrig_base::Value;
use rand_distr::{Distribution, Normal, Poisson};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

/// A sensor in electrons and DN.
#[derive(Clone, Debug)]
pub struct Sensor {
    pub width: usize,
    pub height: usize,
    pub bits: u32,
    pub cfa: &'static str,
    /// DN per electron.
    pub gain: f64,
    pub read_e: f64,
    /// Part of the read noise that is added after the gain stage, e⁻ at unity gain.
    pub read_post_e: f64,
    pub full_well_e: f64,
    pub black_dn: f64,
    pub prnu: f64,
    pub row_fpn_e: f64,
    pub dark_e_per_s: f64,
    pub dsnu_e_per_s: f64,
    pub qe: [f64; 3],
    /// Signal lost at full well, as a fraction, growing with the signal.
    pub nonlinearity: f64,
    /// Shares of a pixel's charge that each neighbour in its row and in its column gets.
    pub coupling: [f64; 2],
    /// Bits by which the stored samples are moved up.
    pub moved_up: u32,
    pub seed: u64,
}

impl Sensor {
    /// A sensor of no special kind.
    pub const USUAL: Self = Self {
        width: 96,
        height: 64,
        bits: 12,
        cfa: "mono",
        gain: 0.4,
        read_e: 4.0,
        read_post_e: 0.0,
        full_well_e: 9000.0,
        black_dn: 64.0,
        prnu: 0.01,
        row_fpn_e: 1.0,
        dark_e_per_s: 40.0,
        dsnu_e_per_s: 10.0,
        qe: [0.5; 3],
        nonlinearity: 0.0,
        coupling: [0.0; 2],
        moved_up: 0,
        seed: 1,
    };
}

impl Default for Sensor {
    fn default() -> Self {
        Self::USUAL
    }
}

/// One stack to make.
pub struct Shot {
    pub exposure_s: f64,
    /// Photons per pixel and second; 0 for a dark.
    pub rate: f64,
    pub frames: usize,
    pub temperature_c: f64,
    pub analog_gain: f64,
}

impl Sensor {
    /// Writes a capture set of these stacks.
    pub fn write(&self, directory: &Path, shots: &[Shot]) {
        let mut toml = format!(
            "format = \"captures/1\"\n[sensor]\nwidth = {}\nheight = {}\nbits = {}\ncfa = \"{}\"\n\
             black_level_dn = {:?}\npitch_um = 2.0\n",
            self.width,
            self.height,
            self.bits + self.moved_up,
            self.cfa,
            self.black_dn * f64::from(1u32 << self.moved_up)
        );
        let fixed = self.fixed();
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(self.seed + 1000);
        for (k, shot) in shots.iter().enumerate() {
            let (role, light) = if shot.rate > 0.0 {
                let light = format!(
                    "[capture.light]\nphotons_per_pixel_per_s = {:?}\nuniformity = \"flat\"\n",
                    shot.rate
                );
                ("flat", light)
            } else {
                ("dark", String::new())
            };
            writeln!(
                toml,
                "[[capture]]\nid = \"{role}-{k}\"\nrole = \"{role}\"\nfiles = \"{role}-{k}.npy\"\n\
                 exposure_s = {:?}\ntemperature_c = {:?}\nanalog_gain = {:?}\n{light}",
                shot.exposure_s, shot.temperature_c, shot.analog_gain
            )
            .unwrap();
            let mut data = Vec::new();
            for _ in 0..shot.frames {
                data.extend(self.frame(shot, &fixed, &mut rng));
            }
            let shape = [shot.frames, self.height, self.width];
            write_npy(&directory.join(format!("{role}-{k}.npy")), &shape, &data);
        }
        std::fs::write(directory.join("captures.toml"), toml).unwrap();
    }

    fn fixed(&self) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(self.seed);
        let mut draw = |n: usize, mean: f64, sd: f64| -> Vec<f64> {
            let d = Normal::new(mean, sd).unwrap();
            (0..n).map(|_| d.sample(&mut rng)).collect()
        };
        let n = self.width * self.height;
        (
            draw(n, 1.0, self.prnu),
            draw(n, self.dark_e_per_s, self.dsnu_e_per_s),
            draw(self.height, 0.0, self.row_fpn_e),
        )
    }

    fn frame(
        &self,
        shot: &Shot,
        (gain, dark, row): &(Vec<f64>, Vec<f64>, Vec<f64>),
        rng: &mut Xoshiro256PlusPlus,
    ) -> Vec<u16> {
        let cfa = camrig_base::Cfa::parse(self.cfa).unwrap();
        // At gain g the part after the stage counts 1/g of what it counts at unity gain.
        let post = self.read_post_e.powi(2);
        let read_e = (self.read_e.powi(2) - post + post / shot.analog_gain.powi(2)).sqrt();
        let read = Normal::new(0.0, read_e).unwrap();
        let doubled = ((shot.temperature_c - 25.0) / 7.0).exp2();
        let (mut charge, mut noise) = (Vec::new(), Vec::new());
        for y in 0..self.height {
            for x in 0..self.width {
                let at = y * self.width + x;
                let light = shot.rate * shot.exposure_s * self.qe[cfa.channel(x, y)];
                let mean = light + (dark[at] * doubled * shot.exposure_s).max(0.0);
                let shot_e =
                    if mean > 0.0 { Poisson::new(mean).unwrap().sample(rng) } else { 0.0 };
                let mut e = (shot_e * gain[at]).min(self.full_well_e);
                e -= self.nonlinearity * e * e / self.full_well_e;
                charge.push(e);
                noise.push(read.sample(rng) + row[y]);
            }
        }
        let [side, vertical] = self.coupling;
        let white = f64::from((1u32 << self.bits) - 1);
        let dn = |at: usize| {
            let (x, y) = (at % self.width, at / self.width);
            // What a pixel at the border would get from outside it gets from itself.
            let in_row =
                charge[at - usize::from(x > 0)] + charge[at + usize::from(x + 1 < self.width)];
            let in_column = charge[at - self.width * usize::from(y > 0)]
                + charge[at + self.width * usize::from(y + 1 < self.height)];
            let kept = (1.0 - 2.0 * side - 2.0 * vertical) * charge[at];
            let e = kept + side * in_row + vertical * in_column;
            (e + noise[at]) * self.gain * shot.analog_gain + self.black_dn
        };
        let stored = |at| (dn(at).round().clamp(0.0, white) as u16) << self.moved_up;
        (0..charge.len()).map(stored).collect()
    }
}

/// How often a parameter came back within two standard errors, of how many.
#[derive(Default, Debug)]
pub struct Hits(BTreeMap<&'static str, (u32, u32)>);

impl Hits {
    pub fn add(&mut self, name: &'static str, found: Option<Value>, truth: f64) {
        let found = found.unwrap_or_else(|| panic!("{name} not determined"));
        let z = (found.value - truth) / found.std_error;
        let entry = self.0.entry(name).or_default();
        entry.1 += 1;
        entry.0 += u32::from(z.abs() <= 2.0);
        println!(
            "{name}: {:.5} ± {:.5}, truth {truth:.5}, z {z:.2}",
            found.value, found.std_error
        );
    }

    /// 95.4 % is what two standard errors mean; a single parameter of twenty cameras comes to 15
    /// or fewer once in 900 times.
    pub fn check(&self) {
        let total: (u32, u32) = self.0.values().fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        let share = f64::from(total.0) / f64::from(total.1);
        println!("{:?} {share:.3}", self.0);
        assert!((0.90..=0.98).contains(&share), "{share} {:?}", self.0);
        assert!(self.0.values().all(|h| 5 * h.0 >= 4 * h.1), "{:?}", self.0);
    }
}

/// Writes a little-endian uint16 NPY (format version 1.0).
pub fn write_npy(path: &Path, shape: &[usize], data: &[u16]) {
    let shape: Vec<String> = shape.iter().map(usize::to_string).collect();
    let mut header =
        format!("{{'descr': '<u2', 'fortran_order': False, 'shape': ({},), }}", shape.join(", "));
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data.iter().flat_map(|v| v.to_le_bytes()));
    std::fs::write(path, bytes).unwrap();
}
