//! Codes that are all multiples of a step, as those of 10-bit samples left-justified in 16-bit
//! words. The step is the greatest common divisor of the differences of the codes that occur.

use super::finding::{Done, Finding, Kind};
use super::scan::Scan;
use camrig_captures::{CaptureSet, Role, SensorFacts};
use std::borrow::Borrow;

/// Number of different codes from which a step is accepted: by chance, eleven are all even once in
/// a thousand sets.
const MIN_CODES: usize = 11;
/// Share of the samples on multiples of a step from which it is reported although others lie
/// between.
const NEARLY_ALL: f64 = 0.999;

/// The step of a set's codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    /// Distance of neighbouring codes, DN.
    pub step: u16,
    /// The lowest code modulo the step.
    pub offset: u16,
    /// Number of samples between multiples of the step.
    pub between: u64,
    /// Number of all samples.
    pub samples: u64,
}

impl Step {
    /// Number of bits that never vary, where the step is a power of two and all samples lie on it.
    pub fn idle_bits(&self) -> Option<u32> {
        let whole = self.step.is_power_of_two() && self.between == 0;
        whole.then(|| self.step.trailing_zeros())
    }

    /// What all samples are, in words.
    fn multiples(&self) -> String {
        match self.offset {
            0 => format!("multiples of {} DN", self.step),
            offset => format!("multiples of {} DN plus {offset}", self.step),
        }
    }

    /// A sample in units of the step.
    pub fn code(&self, sample: u16) -> u16 {
        (sample - self.offset.min(sample)) / self.step
    }

    /// The facts of the sensor in units of the step.
    pub fn facts(&self, sensor: &SensorFacts) -> SensorFacts {
        let bits = sensor.bits.saturating_sub(self.step.ilog2()).max(1);
        let level = |dn: f64| ((dn - f64::from(self.offset)) / f64::from(self.step)).max(0.0);
        SensorFacts {
            bits,
            black_level_dn: sensor.black_level_dn.map(level),
            white_level_dn: self.code(sensor.white_level_dn),
            ..sensor.clone()
        }
    }
}

/// The codes that occur in all of the scans, with their numbers.
fn occurring<S: Borrow<Scan>>(scans: &[S]) -> Vec<(u16, u64)> {
    let scans = scans.iter().map(S::borrow);
    let count = |code: usize| scans.clone().map(|s| s.codes[code]).sum::<u64>();
    (0..=u16::MAX).map(|c| (c, count(c.into()))).filter(|c| c.1 > 0).collect()
}

/// The largest step that all codes have.
fn common_step(codes: &[(u16, u64)]) -> Option<Step> {
    let differences = codes.windows(2).map(|p| p[1].0 - p[0].0);
    let step = differences.fold(0, greatest_common_divisor);
    let samples = codes.iter().map(|c| c.1).sum();
    (step > 1 && codes.len() >= MIN_CODES).then(|| Step {
        step,
        offset: codes[0].0 % step,
        between: 0,
        samples,
    })
}

/// The step of a set's codes, where it is more than one DN.
pub fn step(scans: &[Scan]) -> Option<Step> {
    let codes = occurring(scans);
    if codes.len() < MIN_CODES {
        return None;
    }
    if let Some(step) = common_step(&codes) {
        return Some(step);
    }
    let all: u64 = codes.iter().map(|c| c.1).sum();
    // A few samples between the codes may come from the correction of defective pixels.
    (1..16).rev().map(|bit| 1u16 << bit).find_map(|step| {
        let mut by_offset = vec![0u64; usize::from(step)];
        let mut used = vec![0usize; usize::from(step)];
        for &(code, n) in &codes {
            by_offset[usize::from(code % step)] += n;
            used[usize::from(code % step)] += 1;
        }
        let (offset, &most) = by_offset.iter().enumerate().max_by_key(|o| o.1)?;
        let enough = most as f64 > NEARLY_ALL * all as f64 && used[offset] >= MIN_CODES;
        enough.then_some(Step { step, offset: offset as u16, between: all - most, samples: all })
    })
}

/// Steps of all stacks of a gain, a dark among them, where the set as a whole has none: their codes
/// were multiplied. Samples at either end of the scale were clamped, and are left out.
pub fn digital_gains(set: &CaptureSet, scans: &[Scan]) -> Vec<Finding> {
    let capture = |scan: &Scan| &set.captures[scan.capture];
    let mut sorted: Vec<&Scan> = scans.iter().collect();
    sorted.sort_by(|a, b| capture(a).analog_gain.total_cmp(&capture(b).analog_gain));
    let of_gain = |scans: &[&Scan]| {
        scans.iter().find(|scan| capture(scan).role == Role::Dark)?;
        let mut codes = occurring(scans);
        codes.retain(|c| (1..set.sensor.white_level_dn).contains(&c.0));
        let step = common_step(&codes)?;
        let ids: Vec<&str> = scans.iter().map(|scan| capture(scan).id.as_str()).collect();
        let (dn, gain) = (f64::from(step.step), capture(scans[0]).analog_gain);
        let mut finding = Finding::new(Kind::CodeStep, ids.join(", "), Done::Reported);
        finding.count = step.samples as usize;
        Some(finding.with_amount(dn, 0.0, "DN").with_description(format!(
            "at gain {gain} all samples within the scale are {}: codes were multiplied by {dn} \
             (digital gain). Rounding adds {dn}²/12 = {:.4} DN², not 1/12",
            step.multiples(),
            dn * dn / 12.0
        )))
    };
    let alike = |a: &&Scan, b: &&Scan| capture(a).analog_gain == capture(b).analog_gain;
    sorted.chunk_by(alike).filter_map(of_gain).collect()
}

/// The finding about a step.
pub fn finding(set: &CaptureSet, step: &Step) -> Finding {
    let Step { step: dn, between, samples: all, .. } = *step;
    let true_bits = step.facts(&set.sensor).bits;
    let of = step.multiples();
    let rounding = f64::from(dn).powi(2) / 12.0;
    let (done, more) = match step.idle_bits() {
        Some(idle) => (
            Done::Corrected,
            format!(
                "all samples are {of}: {true_bits} bits, left-justified in {}; the lowest {idle} \
                 bits never vary. Rounding adds {dn}²/12 = {rounding:.4} DN², not 1/12. Samples \
                 are divided by {dn}; from here on, DN refer to {true_bits} bits",
                set.sensor.bits
            ),
        ),
        None if between > 0 => (
            Done::Reported,
            format!(
                "{:.3} % of the samples are {of}, {between} of {all} lie between: left-justified \
                 data in which some samples were interpolated or corrected",
                100.0 * (1.0 - between as f64 / all as f64)
            ),
        ),
        None => (
            Done::Refused,
            format!(
                "all samples are {of}, which is not a shift of bits: they were scaled. Divide \
                 them by {dn}, and set bits, black_level_dn and white_level_dn accordingly"
            ),
        ),
    };
    let mut finding = Finding::new(Kind::CodeStep, "all captures", done);
    finding.count = (all - between) as usize;
    finding.with_amount(f64::from(dn), 0.0, "DN").with_description(more)
}

fn greatest_common_divisor(mut a: u16, mut b: u16) -> u16 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan(codes: impl IntoIterator<Item = (u16, u64)>) -> Scan {
        let mut counts = vec![0; 1 << 16];
        codes.into_iter().for_each(|(c, n)| counts[usize::from(c)] = n);
        let sample = crate::band::Band::of(1, 0, &[]);
        Scan { capture: 0, frames: Vec::new(), codes: counts, sample }
    }

    #[test]
    fn the_step_divides_all_differences() {
        let shifted = scan((20..60).map(|c| (c * 16, 5)));
        let found = step(&[shifted]).unwrap();
        assert_eq!((found.step, found.offset, found.idle_bits()), (16, 0, Some(4)));
        // An offset is kept; codes of several stacks count together.
        let found =
            step(&[scan((3..9).map(|c| (c * 4 + 3, 1))), scan((20..30).map(|c| (c * 4 + 3, 1)))]);
        let found = found.unwrap();
        assert_eq!((found.step, found.offset, found.code(4 * 25 + 3)), (4, 3, 25));
        // Not a power of two: found, but not divided by.
        assert_eq!(step(&[scan((5..40).map(|c| (c * 5, 1)))]).unwrap().idle_bits(), None);
        assert_eq!(step(&[scan((5..40).map(|c| (c, 1)))]), None);
        // Few codes show no step.
        assert_eq!(step(&[scan((5..12).map(|c| (c * 2, 1)))]), None);
    }

    #[test]
    fn an_odd_sample_does_not_hide_the_step() {
        let mut codes: Vec<(u16, u64)> = (20..60).map(|c| (c * 64, 1000)).collect();
        codes.push((1501, 3));
        let found = step(&[scan(codes)]).unwrap();
        assert_eq!((found.step, found.between, found.samples), (64, 3, 40_003));
        assert_eq!(found.idle_bits(), None);
    }

    #[test]
    fn facts_are_in_units_of_the_step() {
        let found = Step { step: 64, offset: 0, between: 0, samples: 1 };
        let sensor = SensorFacts {
            width: 2,
            height: 2,
            bits: 16,
            cfa: None,
            black_level_dn: Some(2560.0),
            white_level_dn: 65535,
            pitch_um: None,
            window: None,
        };
        let facts = found.facts(&sensor);
        assert_eq!(
            (facts.bits, facts.black_level_dn, facts.white_level_dn),
            (10, Some(40.0), 1023)
        );
    }
}
