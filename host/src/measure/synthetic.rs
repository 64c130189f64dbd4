//! An independent little sensor for the tests of this module: the textbook noise model written
//! with `rand_distr`, sharing nothing with the product's sensor.

use rand_distr::{Distribution, Normal, Poisson};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
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
    pub seed: u64,
}

impl Default for Sensor {
    fn default() -> Self {
        Self {
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
            seed: 1,
        }
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
            self.width, self.height, self.bits, self.cfa, self.black_dn
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
        let cfa = crate::camera::Cfa::parse(self.cfa).unwrap();
        // At gain g the part after the stage counts 1/g of what it counts at unity gain.
        let post = self.read_post_e.powi(2);
        let read_e = (self.read_e.powi(2) - post + post / shot.analog_gain.powi(2)).sqrt();
        let read = Normal::new(0.0, read_e).unwrap();
        let doubled = ((shot.temperature_c - 25.0) / 7.0).exp2();
        let white = f64::from((1u32 << self.bits) - 1);
        let mut out = Vec::with_capacity(self.width * self.height);
        for y in 0..self.height {
            for x in 0..self.width {
                let at = y * self.width + x;
                let light = shot.rate * shot.exposure_s * self.qe[cfa.channel(x, y)];
                let mean = light + (dark[at] * doubled * shot.exposure_s).max(0.0);
                let shot_e = if mean > 0.0 { Poisson::new(mean).unwrap().sample(rng) } else { 0.0 };
                let mut e = (shot_e * gain[at]).min(self.full_well_e);
                e -= self.nonlinearity * e * e / self.full_well_e;
                let dn =
                    (e + read.sample(rng) + row[y]) * self.gain * shot.analog_gain + self.black_dn;
                out.push(dn.round().clamp(0.0, white) as u16);
            }
        }
        out
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

/// The read-only material beside the repository, or `None` with a line that says so.
pub fn shared() -> Option<std::path::PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let path = std::env::var_os("CAMRIG_SHARED").map_or(beside, Into::into);
    let found = path.is_dir().then_some(path);
    if found.is_none() {
        println!("SKIP: no shared material (set CAMRIG_SHARED)");
    }
    found
}
