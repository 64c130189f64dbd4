//! Signal rates, DN/s, per position of the colour filter pattern, from exposure series of a scene.
//!
//! The rate of a pixel is its signal above dark over the exposure time, at the longest exposure
//! below saturation. The means over the pixels of each position give the channel ratios of a
//! camera under each narrow-band filter (the product of quantum efficiency and crosstalk).

use super::site::Site;
use super::stack::Stack;
use super::tolerance::SAME_EXPOSURE;
use camrig_base::{Error, Result};
use camrig_captures::{Capture, CaptureSet, Light, Role};
use serde::Serialize;
use std::fmt;

/// Largest signal used, as a share of the white level: near it the response is not linear.
const MAX_SHARE_OF_WHITE: f64 = 0.95;

/// Rates of one scene under one light.
#[derive(Clone, Debug, Serialize)]
pub struct Series {
    /// What the captures show.
    pub role: Role,
    /// Wavelength of narrow-band light, nm.
    pub wavelength_nm: Option<f64>,
    /// The light, from the manifest: each light is a series of its own.
    pub light: Option<Light>,
    /// Analog gain.
    pub analog_gain: f64,
    /// Exposure times, s.
    pub exposures_s: Vec<f64>,
    /// The positions of the pattern, row by row.
    pub positions: Vec<Position>,
    /// The rates relative to the largest.
    pub ratios: Vec<Option<f64>>,
    /// Remarks for the reader, such as clipped darks.
    pub notes: Vec<String>,
}

/// A position of the colour filter pattern. In JSON, a pair of letter and rate.
#[derive(Clone, Copy, Debug, Serialize)]
#[serde(into = "(char, Option<f64>)")]
pub struct Position {
    /// Letter of its filter; `?` where unknown.
    pub letter: char,
    /// Rate, DN/s; `None` where every pixel is saturated at every exposure.
    pub rate_dn_per_s: Option<f64>,
}

impl From<Position> for (char, Option<f64>) {
    fn from(p: Position) -> Self {
        (p.letter, p.rate_dn_per_s)
    }
}

impl fmt::Display for Series {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let positions = self.positions.iter().zip(&self.ratios);
        let text: Vec<String> = positions
            .map(|(Position { letter, rate_dn_per_s }, ratio)| match (rate_dn_per_s, ratio) {
                (Some(rate), Some(ratio)) => format!("{letter} {rate:.2} DN/s ({ratio:.4})"),
                (Some(rate), None) => format!("{letter} {rate:.2} DN/s"),
                (None, _) => format!("{letter} saturated"),
            })
            .collect();
        write!(f, "{}: {}", name(self.role, self.light.as_ref()), text.join(", "))
    }
}

/// A name for a series.
fn name(role: Role, light: Option<&Light>) -> String {
    let light = light.cloned().unwrap_or_default();
    let words = [
        light.wavelength_nm.map(|nm| format!("{nm} nm")),
        light.illuminant,
        light.lux.map(|lx| format!("{lx} lx")),
        light.irradiance_w_m2.map(|e| format!("{e} W/m²")),
        light.photons_per_pixel_per_s.map(|n| format!("{n} photons per pixel and s")),
    ];
    let words: Vec<String> = words.into_iter().flatten().collect();
    let words = if words.is_empty() { "light".to_owned() } else { words.join(", ") };
    format!("{role:?}, {words}")
}

/// Share of dark samples at 0 DN from which the offset counts as clipped: half of a symmetric
/// noise lies below its mean, and the black level of a working camera is above 0.
const CLIPPED: f64 = 0.5;

/// Measures every exposure series of the set except darks. A set without a pattern is treated as 2
/// x 2 positions of unknown colour.
///
/// # Errors
/// A series without a dark of its exposure times and without a black level.
pub fn measure(set: &CaptureSet) -> Result<Vec<Series>> {
    let mut kinds: Vec<Vec<&Capture>> = Vec::new();
    for capture in set.captures.iter().filter(|c| c.role != Role::Dark) {
        let key = |c: &Capture| (c.role, c.light.clone(), c.analog_gain);
        match kinds.iter_mut().find(|kind| key(kind[0]) == key(capture)) {
            Some(kind) => kind.push(capture),
            None => kinds.push(vec![capture]),
        }
    }
    if kinds.is_empty() {
        return Err(Error::input("no captures with light").help("add flats, charts or scenes"));
    }
    kinds.into_iter().map(|captures| series(set, captures)).collect()
}

/// The series of captures of one scene under one light.
fn series(set: &CaptureSet, mut captures: Vec<&Capture>) -> Result<Series> {
    captures.sort_by(|a, b| a.exposure_s.total_cmp(&b.exposure_s));
    let (role, light) = (captures[0].role, captures[0].light.clone());
    let unknown = |x0, y0| Site { x0, y0, step_x: 2, step_y: 2, channel: 0 };
    let sites: Vec<Site> = match &set.sensor.cfa {
        Some(cfa) => Site::all(cfa),
        None => vec![unknown(0, 0), unknown(1, 0), unknown(0, 1), unknown(1, 1)],
    };
    let (rates, mut notes) = pixel_rates(set, &captures, &sites)?;
    let mut positions = Vec::with_capacity(sites.len());
    for site in &sites {
        let letter = set.sensor.cfa.as_ref().map_or('?', |c| c.letter(site.x0, site.y0));
        let pixels = site.pixels(set.sensor.width, set.sensor.height);
        let all: Vec<Option<f64>> = pixels.map(|(x, y)| rates[y * set.sensor.width + x]).collect();
        let known: Vec<f64> = all.iter().copied().flatten().collect();
        let mean = known.iter().sum::<f64>() / known.len() as f64;
        let rate_dn_per_s = (!known.is_empty()).then_some(mean);
        positions.push(Position { letter, rate_dn_per_s });
        let what = format!(
            "{}, {letter} at column {}, row {} of the pattern",
            name(role, light.as_ref()),
            site.x0,
            site.y0
        );
        notes.extend(saturation_note(&what, all.len() - known.len(), all.len()));
    }
    let rates = || positions.iter().map(|p| p.rate_dn_per_s);
    let largest = rates().flatten().reduce(f64::max).filter(|r| *r > 0.0);
    Ok(Series {
        role,
        wavelength_nm: light.as_ref().and_then(|l| l.wavelength_nm),
        light,
        analog_gain: captures[0].analog_gain,
        exposures_s: captures.iter().map(|c| c.exposure_s).collect(),
        ratios: rates().map(|rate| Some(rate? / largest?)).collect(),
        positions,
        notes,
    })
}

/// A note on the pixels of a position without a rate.
fn saturation_note(what: &str, saturated: usize, all: usize) -> Option<String> {
    let near = "near the white level at every exposure";
    match saturated {
        0 => None,
        n if n == all => Some(format!("{what}: all pixels are {near}: expose less")),
        n => Some(format!(
            "{what}: {n} of {all} pixels are {near} and excluded; if they get more light than the \
             others, the rate is too small: expose less"
        )),
    }
}

/// Rate of each pixel, DN/s, at its longest exposure well below the white level, `None` where there
/// is none; and notes on the black levels. The captures are in order of exposure.
fn pixel_rates(
    set: &CaptureSet,
    captures: &[&Capture],
    sites: &[Site],
) -> Result<(Vec<Option<f64>>, Vec<String>)> {
    let (width, height) = (set.sensor.width, set.sensor.height);
    let clear = MAX_SHARE_OF_WHITE * f64::from(set.sensor.white_level_dn);
    let mut rates: Vec<Option<f64>> = vec![None; width * height];
    let (mut clipped, mut nominal) = (0.0f64, Vec::new());
    for capture in captures {
        let black = Black::of(set, capture, sites)?;
        clipped = clipped.max(black.zeros);
        if !black.measured {
            nominal.push(format!("{} s", capture.exposure_s));
        }
        let stack = Stack::read(set, capture)?;
        for (site, black) in sites.iter().zip(black.dn) {
            for (x, y) in site.pixels(width, height) {
                let mean = stack.mean_at(x, y);
                if mean < clear {
                    rates[y * width + x] = Some((mean - black) / capture.exposure_s);
                }
            }
        }
    }
    let mut notes = Vec::new();
    if !nominal.is_empty() {
        nominal.dedup();
        notes.push(format!(
            "no dark of {} at analog gain {}: black_level_dn of captures.toml is subtracted, \
             without the dark current",
            nominal.join(", "),
            captures[0].analog_gain
        ));
    }
    if clipped > CLIPPED {
        notes.push(format!(
            "{:.0} % of the dark samples are at 0 DN: the offset clips small signals, so rates of \
             faint positions are too small, mostly where only short exposures are below \
             saturation",
            100.0 * clipped
        ));
    }
    Ok((rates, notes))
}

/// The black level of a capture.
struct Black {
    /// Of each position, DN.
    dn: Vec<f64>,
    /// Whether it is from a dark of the capture's exposure; otherwise it is the nominal one.
    measured: bool,
    /// Share of dark samples at 0 DN.
    zeros: f64,
}

impl Black {
    /// The mean of the dark of the capture's exposure, otherwise the nominal black level.
    fn of(set: &CaptureSet, capture: &Capture, sites: &[Site]) -> Result<Self> {
        let dark = set.with_role(Role::Dark).find(|d| {
            d.analog_gain == capture.analog_gain
                && (d.exposure_s / capture.exposure_s - 1.0).abs() < SAME_EXPOSURE
        });
        let Some(dark) = dark else {
            return match set.sensor.black_level_dn {
                Some(black) => {
                    Ok(Self { dn: vec![black; sites.len()], measured: false, zeros: 0.0 })
                }
                None => Err(Error::input("no dark of this exposure time, and no black_level_dn")
                    .at(format!("capture {:?}", capture.id))),
            };
        };
        let stack = Stack::read(set, dark)?;
        let mean = |site: &Site| {
            let means = site.pixels(stack.width, stack.height).map(|(x, y)| stack.mean_at(x, y));
            let (sum, n) = means.fold((0.0, 0u32), |(sum, n), mean| (sum + mean, n + 1));
            sum / f64::from(n.max(1))
        };
        let zeros = (0..set.cfa().channels().len()).map(|c| stack.channel_moments(c).zeros);
        let zeros = zeros.fold(0.0, f64::max);
        Ok(Self { dn: sites.iter().map(mean).collect(), measured: true, zeros })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Real captures through seven filters: at 550 nm another program finds G, B, R in the ratios
    /// 1, 0.040, 0.014 and the greens 0.9954, to 0.005. The chart series agrees. The dot series has
    /// 0.046 for blue: in this camera the offset is some 2 DN below 0 and clips, so that a ratio
    /// depends on the exposures used (0.038 from 25 ms alone, 0.050 from 50 ms), as the note
    /// states.
    #[test]
    fn real_seven_filter_captures() {
        let Some(root) = camrig_testing::shared("data/captures/bllanos_narrowband_7x7") else {
            return;
        };
        let set = CaptureSet::load(&root).unwrap();
        let all = measure(&set).unwrap();
        assert_eq!(all.iter().filter(|s| s.role == Role::Chart).count(), 7);
        let at =
            |role| all.iter().find(|s| s.role == role && s.wavelength_nm == Some(550.0)).unwrap();
        let known = |ratios: &[Option<f64>]| ratios.iter().map(|r| r.unwrap()).collect::<Vec<_>>();
        let ratios = known(&at(Role::Chart).ratios);
        assert!((ratios[0] / ratios[3] - 0.9954).abs() < 0.005, "{ratios:?}");
        assert!((ratios[1] - 0.040).abs() < 0.005, "{ratios:?}");
        assert!((ratios[2] - 0.014).abs() < 0.005, "{ratios:?}");
        let dots = known(&at(Role::Dots).ratios);
        assert!((0.038..0.050).contains(&dots[1]), "{dots:?}");
        assert!(all.iter().all(|s| s.notes.iter().any(|n| n.contains("at 0 DN"))));
    }

    /// Id, keys and samples of a capture.
    type Taken<'a> = (&'a str, &'a str, fn(usize, usize) -> u16);

    /// The series of captures of one 8 x 8 frame each.
    fn of(sensor: &str, captures: &[Taken]) -> Vec<Series> {
        let folder = tempfile::tempdir().unwrap();
        let head = "format = \"captures/1\"\n[sensor]\nwidth = 8\nheight = 8\nbits = 12\n";
        let mut text = format!("{head}{sensor}\n");
        for (id, entry, value) in captures {
            let samples: Vec<u16> = (0..64).map(|at| value(at % 8, at / 8)).collect();
            crate::synthetic::write_npy(
                &folder.path().join(format!("{id}.npy")),
                &[8, 8],
                &samples,
            );
            text += &format!("[[capture]]\nid = \"{id}\"\nfiles = \"{id}.npy\"\n");
            text += &format!("exposure_s = 0.01\n{entry}\n");
        }
        std::fs::write(folder.path().join("captures.toml"), text).unwrap();
        measure(&CaptureSet::load(folder.path()).unwrap()).unwrap()
    }

    const DARK: (&str, &str, fn(usize, usize) -> u16) = ("d", "role = \"dark\"", |_, _| 64);

    /// Both greens are saturated, and a quarter of the blue.
    #[test]
    fn saturated_positions_have_no_rate() {
        let light = |x: usize, y: usize| match (x % 2, y % 2) {
            (0, 0) => 2064,
            (1, 1) if x < 3 => 4095,
            (1, 1) => 1564,
            _ => 4095,
        };
        let series = of("cfa = \"RGGB\"", &[DARK, ("a", "role = \"flat\"", light)]);
        let series = &series[0];
        let rates: Vec<Option<i64>> =
            series.positions.iter().map(|p| p.rate_dn_per_s.map(|r| r.round() as i64)).collect();
        assert_eq!(rates, [Some(200_000), None, None, Some(150_000)]);
        assert_eq!(series.ratios, [Some(1.0), None, None, Some(0.75)]);
        assert_eq!(series.notes.len(), 3, "{:?}", series.notes);
        assert!(series.notes[2].contains("4 of 16 pixels"), "{:?}", series.notes);
        let text = "Flat, light: R 200000.00 DN/s (1.0000), G saturated, G saturated, B 150000.00 \
                    DN/s (0.7500)";
        assert_eq!(series.to_string(), text);
    }

    #[test]
    fn every_light_has_its_own_series() {
        let flat = |light: &str| format!("role = \"flat\"\nlight = {{ {light}, lux = 100.0 }}");
        let (a, d65) = (flat("illuminant = \"A\""), flat("illuminant = \"D65\""));
        let series = of("", &[DARK, ("A", &a, |_, _| 564), ("D", &d65, |_, _| 3064)]);
        let rates: Vec<f64> =
            series.iter().map(|s| s.positions[0].rate_dn_per_s.unwrap().round()).collect();
        assert_eq!(rates, [50_000.0, 300_000.0]);
        assert!(series[0].to_string().starts_with("Flat, A, 100 lx: ?"), "{}", series[0]);
    }

    #[test]
    fn use_of_the_nominal_black_level_is_noted() {
        let series = of("black_level_dn = 64", &[("a", "role = \"flat\"", |_, _| 1064)]);
        assert_eq!(series[0].positions[0].rate_dn_per_s.map(f64::round), Some(100_000.0));
        let notes = series[0].notes.join("\n");
        assert!(notes.contains("no dark of 0.01 s at analog gain 1: black_level_dn"), "{notes}");
    }
}
