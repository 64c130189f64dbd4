//! Lamps whose light changes periodically: mains flicker and pulsed diodes.
//!
//! A lamp multiplies the light of a scene by a waveform P(t) of mean 1:
//!
//! - mains: 1 + m cos(2π(f t + φ));
//! - pulse: 1/d for φ ≤ f t < φ + d in each period, 0 else.
//!
//! Means over an exposure are closed forms: 1 + m sinc(f T) cos(2π(f(a + T/2) + φ)) from a on, and
//! the pulses' time on over d T. [`Lamps::moments`] gives the integral of P and that of s P, s the
//! time since the window opened, so that light that changes at a constant rate is integrated
//! exactly, too. A lamp may fall on a part of the scene alone. Phases are in periods. Times are
//! reduced to a period before anything else, so that long streams lose nothing.

use camrig_base::{Error, Result, options};
use serde::Deserialize;
use std::f64::consts::TAU;

/// Highest frequency, Hz: above it light is steady for any exposure.
const MAX_HZ: f64 = 1e6;

/// A rectangle of the frame: columns and rows from the upper left corner, width and height, as
/// parts of the frame's.
pub type Region = [f64; 4];

/// How light changes with time.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Waveform {
    /// A sine around the mean.
    Mains {
        /// Frequency of the light, twice that of the mains, Hz.
        hz: f64,
        /// Amplitude over mean, 0 to 1.
        depth: f64,
        /// Periods by which it is early.
        phase: f64,
    },
    /// On and off.
    Pulse {
        /// Pulses per second, Hz.
        hz: f64,
        /// Part of the period for which it is on, above 0 to 1.
        duty: f64,
        /// Periods after time 0 at which it goes on.
        phase: f64,
    },
}

/// A lamp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Its light.
    pub waveform: Waveform,
    /// Its part of the light on the scene; the rest is steady, or other lamps'.
    pub share: f64,
    /// What alone it falls on, with other lamps of the same region; those without fall on the rest.
    pub region: Option<Region>,
}

/// What may stand behind the name of a waveform.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    hz: f64,
    depth: Option<f64>,
    duty: Option<f64>,
    #[serde(default)]
    phase: f64,
    share: Option<f64>,
    region: Option<String>,
}

impl std::str::FromStr for Lamp {
    type Err = Error;

    /// Reads `mains:hz=100,depth=0.3,phase=0.1,share=0.5` or `pulse:hz=90,duty=0.1`.
    fn from_str(text: &str) -> Result<Self> {
        const HELP: &str = "write mains:hz=100,depth=0.3 or pulse:hz=90,duty=0.1, with phase= in \
                            periods and share= of the light where they are not 0 and 1, and \
                            region=X,Y,WIDTH,HEIGHT as parts of the frame";
        let wrong = |what: String| Error::input(what).help(HELP);
        let (kind, options) = text.split_once(':').unwrap_or((text, ""));
        let keys: Keys = options::read(None, options, HELP)
            .map_err(|e| wrong(format!("lamp {text:?}: {e}")))?;
        let Keys { hz, phase, .. } = keys;
        let (waveform, part) = match (kind, keys.depth, keys.duty) {
            ("mains", Some(depth), None) => (Waveform::Mains { hz, depth, phase }, depth),
            ("pulse", None, Some(duty)) => (Waveform::Pulse { hz, duty, phase }, duty),
            _ => return Err(wrong(format!("lamp {text:?}"))),
        };
        let share = keys.share.unwrap_or(1.0);
        let region = keys.region.as_deref().map(region);
        let least = if kind == "pulse" { f64::MIN_POSITIVE } else { 0.0 };
        let sound = hz > 0.0
            && hz <= MAX_HZ
            && phase.is_finite()
            && (least..=1.0).contains(&part)
            && (0.0..=1.0).contains(&share)
            && region != Some(None);
        if !sound {
            return Err(wrong(format!("lamp {text:?} with a number out of its range")));
        }
        Ok(Self { waveform, share, region: region.flatten() })
    }
}

/// Reads a rectangle within the frame.
fn region(text: &str) -> Option<Region> {
    let numbers: Vec<f64> = text.split(',').map_while(|n| n.trim().parse().ok()).collect();
    let region @ [x, y, width, height] = Region::try_from(numbers).ok()?;
    let inside = |begin: f64, length: f64| begin >= 0.0 && length > 0.0 && begin + length <= 1.0;
    (inside(x, width) && inside(y, height)).then_some(region)
}

/// Whether two rectangles share more than an edge, but for rounding.
fn overlap(a: Region, b: Region) -> bool {
    let shared = |i: usize| (a[i] + a[i + 2]).min(b[i] + b[i + 2]) - a[i].max(b[i]);
    shared(0) > 1e-9 && shared(1) > 1e-9
}

/// The lamps of a scene. Without any its light is steady.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lamps {
    /// On all that is in no region.
    lamps: Vec<Lamp>,
    regions: Vec<(Region, Lamps)>,
}

impl Lamps {
    /// Lamps that light a scene together.
    ///
    /// # Errors
    /// Shares that are more than all of the light; regions that overlap.
    pub fn new(lamps: Vec<Lamp>) -> Result<Self> {
        let mut all = Self::default();
        for lamp in lamps {
            let lamps = match lamp.region {
                None => &mut all.lamps,
                Some(region) => all.of_region(region)?,
            };
            lamps.push(lamp);
            let sum: f64 = lamps.iter().map(|lamp| lamp.share).sum();
            if sum > 1.0 + 1e-9 {
                return Err(Error::input(format!("lamps with {sum} of the light"))
                    .help("give each its share=: together at most 1"));
            }
        }
        Ok(all)
    }

    /// The lamps of a region, which begins with none.
    fn of_region(&mut self, region: Region) -> Result<&mut Vec<Lamp>> {
        let mut others = self.regions.iter().map(|(other, _)| *other);
        if let Some(other) = others.find(|other| *other != region && overlap(*other, region)) {
            return Err(Error::input(format!(
                "lamps on regions that overlap: {other:?}, {region:?}"
            ))
            .help("a place is lit by the lamps of one region: let the regions meet, or be one"));
        }
        let place = self.regions.iter().position(|(other, _)| *other == region);
        let place = place.unwrap_or_else(|| {
            self.regions.push((region, Self::default()));
            self.regions.len() - 1
        });
        Ok(&mut self.regions[place].1.lamps)
    }

    /// Whether the light is steady.
    #[must_use]
    pub fn are_steady(&self) -> bool {
        self.lamps.is_empty() && self.regions.is_empty()
    }

    /// Regions with lamps of their own.
    #[must_use]
    pub fn regions(&self) -> &[(Region, Lamps)] {
        &self.regions
    }

    /// The integrals of P and of s P over `span_s` seconds from `open_s` on, with s the time since
    /// then: s and s². Like [`Lamps::mean`], outside the regions.
    #[must_use]
    pub fn moments(&self, open_s: f64, span_s: f64) -> [f64; 2] {
        let steady = [span_s, 0.5 * span_s * span_s];
        self.lamps.iter().fold(steady, |sum, lamp| {
            let of_lamp = lamp.waveform.moments(open_s, span_s);
            [0, 1].map(|i| sum[i] + lamp.share * (of_lamp[i] - steady[i]))
        })
    }

    /// Mean over a window that opens and closes at these times, s.
    #[must_use]
    pub fn mean(&self, [open_s, close_s]: [f64; 2]) -> f64 {
        self.moments(open_s, close_s - open_s)[0] / (close_s - open_s)
    }
}

impl Waveform {
    fn moments(self, open_s: f64, span_s: f64) -> [f64; 2] {
        match self {
            Self::Mains { hz, depth, phase } => {
                let (begin, rate) = (TAU * (fraction(hz * open_s) + phase), TAU * hz);
                let (end, half) = (begin + rate * span_s, 0.5 * rate * span_s);
                let half_sine = 2.0 * libm::sin(half);
                let sine = half_sine * libm::cos(begin + half) / rate;
                let first =
                    (span_s * libm::sin(end) - half_sine * libm::sin(begin + half) / rate) / rate;
                [span_s + depth * sine, 0.5 * span_s * span_s + depth * first]
            }
            Self::Pulse { hz, duty, phase } => {
                let begin = fraction(hz * open_s - phase);
                let [from, to] = [begin, begin + hz * span_s].map(|x| on(x, duty));
                let on = to[0] - from[0];
                [on / (hz * duty), (to[1] - from[1] - begin * on) / (hz * hz * duty)]
            }
        }
    }
}

fn fraction(periods: f64) -> f64 {
    periods - periods.floor()
}

/// The integrals of p and of u p from 0 to x periods, p a pulse of height 1 for the first `duty` of
/// each period.
fn on(x: f64, duty: f64) -> [f64; 2] {
    let whole = x.floor();
    let part = (x - whole).min(duty);
    let first = 0.5 * duty * whole * (whole - 1.0) + 0.5 * duty * duty * whole;
    [whole * duty + part, first + whole * part + 0.5 * part * part]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lamps(spec: &str) -> Lamps {
        Lamps::new(vec![spec.parse().unwrap()]).unwrap()
    }

    fn alone(waveform: Waveform) -> Lamps {
        Lamps::new(vec![Lamp { waveform, share: 1.0, region: None }]).unwrap()
    }

    /// How bright exposures of any phase see a pulsed lamp, over its mean: golden/hdr/led.csv.
    #[test]
    fn pulses_are_seen_or_missed_by_exposures() {
        let Some(file) = camrig_testing::shared("golden/hdr/led.csv") else { return };
        let mut lines = 0;
        for line in std::fs::read_to_string(file).unwrap().lines().skip(1) {
            let number: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
            let (hz, duty) = (number[0], number[1]);
            // The table has the periods of an exposure in eight digits.
            let exposure = if number[2] == 11.111111 { 1.0 / 90.0 } else { 1e-3 * number[2] };
            let lamps = alone(Waveform::Pulse { hz, duty, phase: 0.0 });
            let seen = |begin: f64| lamps.mean([begin / hz, begin / hz + exposure]);
            // Linear in the beginning between those at which an edge of a pulse meets an end of
            // the window, so that Simpson's rule is exact for squares.
            let turn = |begin: f64| begin - begin.floor();
            let periods = hz * exposure;
            let mut turns = [0.0, duty, turn(-periods), turn(duty - periods), 1.0];
            turns.sort_by(f64::total_cmp);
            let extremes = turns.map(seen);
            let brightest = extremes.into_iter().fold(0.0, f64::max);
            let darkest = extremes.into_iter().fold(f64::INFINITY, f64::min);
            let modulation = (brightest - darkest) / (brightest + darkest);
            let (mut squares, mut share) = (0.0, 0.0);
            for pair in turns.windows(2) {
                let width = pair[1] - pair[0];
                let values = [pair[0], 0.5 * (pair[0] + pair[1]), pair[1]].map(seen);
                let square = values.map(|value| (value - 1.0).powi(2));
                squares += width * (square[0] + 4.0 * square[1] + square[2]) / 6.0;
                share += if values[1] < 1e-9 { width } else { 0.0 };
            }
            let rms = squares.sqrt();
            for (i, found) in [(4, brightest), (5, darkest), (6, modulation), (7, rms), (9, share)]
            {
                let close = (found - number[i]).abs() < 1e-6 * number[i].max(1.0);
                assert!(close, "{found} for column {i}: {line}");
            }
            lines += 1;
        }
        assert!(lines > 20);
    }

    /// Rows of a rolling shutter under mains and pulses: golden/light/lamp_rows.csv, whose mains
    /// phase is in radians.
    #[test]
    fn means_over_rows_are_closed_forms() {
        let Some(file) = camrig_testing::shared("golden/light/lamp_rows.csv") else { return };
        let mut lines = 0;
        for line in std::fs::read_to_string(file).unwrap().lines().skip(1) {
            let fields: Vec<&str> = line.split(',').collect();
            let number = |i: usize| fields[i].parse::<f64>().unwrap();
            let (hz, part, phase) = (number(2), number(3), number(4));
            let waveform = match fields[1] {
                "mains" => Waveform::Mains { hz, depth: part, phase: phase / TAU },
                _ => Waveform::Pulse { hz, duty: part, phase },
            };
            // The table gives 1/90 s in ten digits.
            let exposure = if fields[0] == "led90_11ms" { 1.0 / 90.0 } else { number(5) };
            let open = number(7) * number(6) * 1e-6;
            let lamps = alone(waveform);
            let mean = lamps.mean([open, open + exposure]);
            assert!((mean - number(8)).abs() < 1e-6, "{mean}: {line}");
            // Any number of whole periods later it is the same.
            let late = open + 1e4 * 90.0 / hz;
            assert!((lamps.mean([late, late + exposure]) - number(8)).abs() < 1e-6, "{line}");
            lines += 1;
        }
        assert_eq!(lines, 840);
    }

    /// Brightest, darkest, modulation, root mean square and share of dark exposures over all phases
    /// of a pulsed diode: golden/hdr/led.csv.
    #[test]
    fn pulsed_diodes_modulate_and_go_dark_as_they_should() {
        const PHASES: u32 = 20_000;
        let Some(file) = camrig_testing::shared("golden/hdr/led.csv") else { return };
        let mut lines = 0;
        for line in std::fs::read_to_string(file).unwrap().lines().skip(1) {
            let fields: Vec<f64> = line.split(',').map(|f| f.parse().unwrap()).collect();
            let [hz, duty, exposure_ms] = fields[..3] else { panic!("{line}") };
            // The table gives 1/f in eight digits.
            let whole = (fields[3] - 1.0).abs() < 1e-7;
            let exposure = if whole { 1.0 / hz } else { 1e-3 * exposure_ms };
            let lamps = alone(Waveform::Pulse { hz, duty, phase: 0.0 });
            let mean_from = |open: f64| lamps.mean([open, open + exposure]);
            let count = f64::from(PHASES);
            let means: Vec<f64> =
                (0..PHASES).map(|i| mean_from((f64::from(i) + 0.5) / count / hz)).collect();
            // Brightest from where a pulse begins, darkest from where it ends.
            let (most, least) = (mean_from(0.0), mean_from(duty / hz));
            assert!(means.iter().all(|m| (least - 1e-9..=most + 1e-9).contains(m)), "{line}");
            let modulation = (most - least) / (most + least);
            for (value, expected) in [(most, 4), (least, 5), (modulation, 6)] {
                assert!((value - fields[expected]).abs() < 1e-6, "{value}: {line}");
            }
            // Sums over phases are off where the mean has a kink, by slope x step² / 8 at each.
            let kinks = (duty * hz * exposure).recip() / (count * count);
            let mean = means.iter().sum::<f64>() / count;
            assert!((mean - 1.0).abs() < kinks + 1e-9, "{mean}: {line}");
            let square = means.iter().map(|m| (m - 1.0).powi(2)).sum::<f64>() / count;
            assert!((square - fields[7].powi(2)).abs() < 2.0 * most * kinks + 1e-6, "{line}");
            let dark = means.iter().filter(|m| **m < 1e-9).count() as f64 / count;
            assert!((dark - fields[9]).abs() < 2.0 / count, "{dark}: {line}");
            lines += 1;
        }
        assert!(lines > 100);
    }

    #[test]
    fn lamps_share_the_light() {
        let half = lamps("pulse:hz=100,duty=0.1,share=0.5");
        assert!((half.mean([0.0, 0.001]) - 5.5).abs() < 1e-12);
        assert!((half.mean([0.002, 0.003]) - 0.5).abs() < 1e-12);
        let both = ["pulse:hz=100,duty=0.1,share=0.5", "mains:hz=100,depth=1,share=0.6"];
        let both = both.iter().map(|lamp| lamp.parse().unwrap()).collect();
        assert!(Lamps::new(both).unwrap_err().to_string().contains("1.1 of the light"));
        // A region has all of the light once more.
        let led = "pulse:hz=90,duty=0.5,region=0.5,0,0.5,0.25".parse().unwrap();
        let room = "mains:hz=100,depth=1,share=0.6".parse().unwrap();
        let both = Lamps::new(vec![led, room]).unwrap();
        let [(region, led)] = both.regions() else { panic!("{both:?}") };
        assert_eq!(*region, [0.5, 0.0, 0.5, 0.25]);
        assert!((led.mean([0.0, 0.001]) - 2.0).abs() < 1e-12);
        assert!((both.mean([0.0, 1e-6]) - 1.6).abs() < 1e-6);
        // What two regions would light is neither's; they may meet.
        let lamps = |other: &str| {
            let one = "pulse:hz=90,duty=0.5,region=0.1,0,0.2,1".parse().unwrap();
            let other = format!("pulse:hz=60,duty=0.5,region={other}").parse().unwrap();
            Lamps::new(vec![one, other])
        };
        assert_eq!(lamps("0.3,0,0.5,1").unwrap().regions().len(), 2);
        let said = lamps("0.29,0.5,0.5,0.5").unwrap_err().to_string();
        assert!(said.contains("overlap: [0.1, 0.0, 0.2, 1.0], [0.29, 0.5, 0.5, 0.5]"), "{said}");
        assert!(Lamps::default().are_steady());
        assert_eq!(Lamps::default().mean([0.1, 0.3]), 1.0);
    }

    #[test]
    fn what_is_no_lamp_is_refused() {
        for spec in [
            "mains",
            "mains:hz=100",
            "mains:hz=100,depth=1.5",
            "mains:hz=0,depth=0.5",
            "mains:hz=100,depth=nan",
            "pulse:hz=100,duty=0",
            "pulse:hz=100,duty=0.1,depth=0.2",
            "pulse:hz=100,duty=0.1,share=2",
            "pulse:hz=100,duty=0.1,colour=3",
            "pulse:hz=100,duty=0.1,region=0.5,0,0.6,1",
            "pulse:hz=100,duty=0.1,region=0.5,0,0.5",
            "strobe:hz=100,duty=0.1",
        ] {
            let said = spec.parse::<Lamp>().unwrap_err().to_string();
            assert!(said.contains(spec) || said.contains("mains:hz=100"), "{said}");
        }
    }
}
