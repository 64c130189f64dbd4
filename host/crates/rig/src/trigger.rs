//! Cameras on one trigger: which rigs take frames together, and when each of their frames begins.
//!
//! ```toml
//! format = "rig-cameras/1"
//! fps = 30
//! frames = 60
//!
//! [[camera]]
//! name = "left"
//! options = ["--camera", "mt9v024", "--scene", "dots", "--exposure", "5ms"]
//!
//! [[camera]]
//! name = "right"
//! rig = "tcp://127.0.0.1:7420"
//! offset_s = 0.001                # begins 1 ms after the trigger,
//! jitter_s = 20e-6                # scattered by 20 µs,
//! drift_ppm = 50                  # on a clock that is 50 µs/s slow
//! options = ["--camera", "imx219", "--scene", "dots", "--exposure", "5ms"]
//! ```

use camrig_base::{Error, Result, mistakes};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::SplitMix64;
use rand_xoshiro::rand_core::SeedableRng;
use schemars::{JsonSchema, Schema, schema_for};
use serde::Deserialize;
use std::path::Path;

/// Rigs that take frames together.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct File {
    /// `"rig-cameras/1"`.
    format: String,
    /// Triggers per second.
    #[schemars(range(min = 0.001, max = 100000.0))]
    fps: f64,
    /// Number of triggers.
    #[schemars(range(min = 1))]
    frames: u32,
    /// The cameras.
    camera: Vec<Entry>,
}

/// A camera on the trigger.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Entry {
    /// Its name, of letters, digits and `_`, in the names of its topics.
    name: String,
    /// Address of its rig.
    #[serde(default = "emulator")]
    rig: String,
    /// Begin of its exposure after the trigger, s.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 3600.0))]
    offset_s: f64,
    /// Standard deviation of that begin, normal and of each frame alone, s. No frame begins before
    /// the first trigger.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 3600.0))]
    jitter_s: f64,
    /// By how much its clock is slow: a frame begins this fraction of the time since the first
    /// trigger later, parts per million.
    #[serde(default)]
    #[schemars(range(min = -100000.0, max = 100000.0))]
    drift_ppm: f64,
    /// Its camera, scene, exposure and so on, as after `camrig rig stream`.
    options: Vec<String>,
}

fn emulator() -> String {
    "emulator:".to_string()
}

/// The JSON schema of a file of cameras.
pub fn schema() -> Schema {
    schema_for!(File)
}

/// Rigs that take frames together.
#[derive(Clone, Debug, PartialEq)]
pub struct Together {
    /// Number of triggers.
    pub frames: u32,
    /// The cameras.
    pub cameras: Vec<Triggered>,
}

/// A camera on the trigger.
#[derive(Clone, Debug, PartialEq)]
pub struct Triggered {
    /// Its name.
    pub name: String,
    /// Address of its rig.
    pub rig: String,
    /// When its frames begin.
    pub trigger: Trigger,
    /// Options of `camrig rig stream`.
    pub options: Vec<String>,
}

/// When the frames of a camera begin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trigger {
    /// Triggers per second.
    pub fps: f64,
    /// Begin after the trigger, s.
    offset_s: f64,
    /// Its standard deviation, s.
    jitter_s: f64,
    /// By how much the camera's clock is slow, parts per million.
    drift_ppm: f64,
    /// Of the jitter.
    seed: u32,
}

impl Trigger {
    /// Frames that begin with the trigger.
    pub fn steady(fps: f64) -> Self {
        Self { fps, offset_s: 0.0, jitter_s: 0.0, drift_ppm: 0.0, seed: 0 }
    }

    /// When the trigger of a frame comes, s after the first.
    pub fn trigger_s(&self, frame: u64) -> f64 {
        frame as f64 / self.fps
    }

    /// When a frame begins, s after the first trigger: the same in every run.
    pub fn begin_s(&self, frame: u64) -> f64 {
        let seed = frame ^ u64::from(self.seed) << 32 ^ 0x7169 << 48;
        let normal: f64 = StandardNormal.sample(&mut SplitMix64::from_seed(seed.to_le_bytes()));
        let slow = 1.0 + 1e-6 * self.drift_ppm;
        (self.trigger_s(frame) * slow + self.offset_s + self.jitter_s * normal).max(0.0)
    }
}

impl Together {
    /// Reads a file of cameras.
    ///
    /// # Errors
    /// Unknown keys, values out of range, names that are none or are given twice.
    pub fn load(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::io("read", path, e))?;
        Self::parse(&text).map_err(|e| e.at(path.display()))
    }

    fn parse(text: &str) -> Result<Self> {
        let file: File = mistakes::read(text)?;
        if file.format != "rig-cameras/1" {
            return Err(Error::unsupported(format!("cameras format {:?}", file.format))
                .help("this program reads format = \"rig-cameras/1\""));
        }
        let mut cameras: Vec<Triggered> = Vec::new();
        for (seed, entry) in (0..).zip(file.camera) {
            let is_name = entry.name.starts_with(|c: char| c.is_ascii_alphabetic())
                && entry.name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
            if !is_name || cameras.iter().any(|camera| camera.name == entry.name) {
                return Err(Error::input(format!("name = {:?} of a camera", entry.name))
                    .help("a letter, then letters, digits and _; each camera has its own"));
            }
            let Entry { name, rig, offset_s, jitter_s, drift_ppm, options } = entry;
            let trigger = Trigger { fps: file.fps, offset_s, jitter_s, drift_ppm, seed };
            cameras.push(Triggered { name, rig, trigger, options });
        }
        if cameras.is_empty() {
            return Err(Error::input("no camera").help("add [[camera]] tables"));
        }
        Ok(Self { frames: file.frames, cameras })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cameras(entries: &str) -> Result<Together> {
        Together::parse(&format!("format = 'rig-cameras/1'\nfps = 100\nframes = 9\n{entries}"))
    }

    #[test]
    fn frames_begin_as_the_file_says() {
        let text = "[[camera]]\nname = 'a'\noptions = ['--camera', 'x']\n\
                    [[camera]]\nname = 'b'\nrig = 'tcp://h:1'\noffset_s = 0.001\ndrift_ppm = 50\n\
                    options = []";
        let both = cameras(text).unwrap();
        let [a, b] = &both.cameras[..] else { unreachable!() };
        assert_eq!((&*a.rig, &*b.rig, both.frames), ("emulator:", "tcp://h:1", 9));
        assert_eq!([a.trigger.begin_s(0), a.trigger.begin_s(100)], [0.0, 1.0]);
        assert_eq!(b.trigger.begin_s(0), 0.001);
        assert!((b.trigger.begin_s(1000) - (10.0 * 1.00005 + 0.001)).abs() < 1e-12);
    }

    /// 10,000 frames: the mean is known to 1 % of the jitter, the standard deviation to 0.7 %.
    #[test]
    fn jitter_is_normal_of_its_size_and_each_cameras_own() {
        let entry = |name: &str| {
            format!("[[camera]]\nname = '{name}'\noffset_s = 1\njitter_s = 1e-3\noptions = []\n")
        };
        let both = cameras(&(entry("a") + &entry("b"))).unwrap();
        let rest = |i: usize| -> Vec<f64> {
            let trigger = both.cameras[i].trigger;
            let rest = |n| (trigger.begin_s(n) - trigger.trigger_s(n) - 1.0) / 1e-3;
            (0..10_000).map(rest).collect()
        };
        let (a, b) = (rest(0), rest(1));
        let mean = |of: &dyn Fn(usize) -> f64| (0..10_000).map(of).sum::<f64>() / 1e4;
        assert!(mean(&|i| a[i]).abs() < 0.05 && mean(&|i| b[i]).abs() < 0.05);
        assert!((mean(&|i| a[i] * a[i]) - 1.0).abs() < 0.07);
        assert!(mean(&|i| a[i] * b[i]).abs() < 0.05);
        assert!(mean(&|i| a[i] * a[(i + 1) % 10_000]).abs() < 0.05);
    }

    #[test]
    fn what_is_no_file_of_cameras_is_refused() {
        for (entries, said) in [
            ("camera = []", "no camera"),
            ("[[camera]]\nname = 'a b'\noptions = []", "a b"),
            (
                "[[camera]]\nname = 'a'\noptions = []\n[[camera]]\nname = 'a'\noptions = []",
                "its own",
            ),
            ("[[camera]]\nname = 'a'\noptions = []\noffset_s = -1", "offset_s"),
        ] {
            let error = cameras(entries).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }
}
