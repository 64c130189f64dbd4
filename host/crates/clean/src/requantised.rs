//! Codes that were quantised again behind the converter, with a step that depends on the level: by a
//! table (square root, decompanded HDR) or by lossy compression, or codes of several captures of a
//! pixel that the sensor merged. The codes in use tell the step: where samples are dense, a code
//! that none has is not in the table. A table leaves photon transfer as it is but for the rounding
//! that it adds; merged captures of different exposures have one for each, and are refused.

use super::finding::{Done, Finding, Kind};
use super::scan::Scan;
use super::transfer::{Point, Transfer};
use camrig_base::median::median;
use camrig_captures::{CaptureSet, Role};

/// Width of the windows of codes in which the step is counted.
const WINDOW: usize = 32;
/// Samples of two codes in use from which on a code between them is in the table or not: of one
/// with a third of its neighbours' width, chance leaves none only once in 20,000 codes.
const MIN_SAMPLES: u64 = 30;
/// Part of a window over which codes must be so dense for it to have a step.
const MIN_COVERED: usize = WINDOW / 2;
/// Smallest step that is one: converters lack single codes, but not every third.
const MIN_STEP: f64 = 1.5;
/// Windows with a step, without which there is none.
const MIN_WINDOWS: usize = 3;

/// Noise over that of the photon transfer of the lower codes from which a level was read with
/// another exposure: with half of it, twice.
const MERGED: f64 = 1.5;
/// Variance over the dark's from which a level shows the gain of the lower codes.
const MIN_LIT: f64 = 1.5;
/// Codes on either side of a change of step by whose numbers the first code beyond is judged.
const BESIDE: usize = 4;
/// Standard errors by which that code must be wider than a rounded one.
const MIN_ERRORS: f64 = 4.0;

/// Most ranges that the effect `requantised` has.
const MAX_RANGES: usize = 5;
/// First codes of a range of which one is its begin, which the others judge: one that does not fit
/// counts as several that do, since half the codes of a smaller step fit. Chosen.
const JUDGED: usize = 64;
const MISFIT: i32 = 3;
/// What rounding of a step times its denominator may be.
const ROUNDING: f64 = 1e-9;

/// Neighbouring codes in use from one level to another, DN.
#[derive(Clone, Copy, Debug)]
struct Range {
    from: usize,
    to: usize,
    /// Pairs of neighbours, how far apart they are together, and how often one does not follow on
    /// another.
    pairs: usize,
    covered: usize,
    breaks: usize,
    /// Windows of these.
    windows: usize,
}

impl Range {
    fn mean(&self) -> f64 {
        self.covered as f64 / self.pairs as f64
    }

    /// The largest error of the mean: each run of codes that are rounded multiples of a step is
    /// within 1 DN as long as these.
    fn error(&self) -> f64 {
        (self.breaks + 1) as f64 / self.pairs as f64
    }

    /// Whether both may be of one step.
    fn is_like(&self, other: &Self) -> bool {
        libm::fabs(self.mean() - other.mean()) < self.error() + other.error()
    }

    fn is_wide(&self) -> bool {
        self.mean() + self.error() >= MIN_STEP
    }

    fn join(&mut self, next: Self) {
        self.to = next.to;
        self.pairs += next.pairs;
        self.covered += next.covered;
        self.breaks += next.breaks;
        self.windows += next.windows;
    }

    /// Its step, DN: the fraction of the smallest denominator that its codes allow.
    fn step(&self) -> f64 {
        let (low, high) = (self.mean() - self.error(), self.mean() + self.error());
        let of = |denominator: usize| {
            let d = denominator as f64;
            (low * d + ROUNDING).ceil() / d
        };
        (1..self.pairs).map(of).find(|step| *step < high).unwrap_or(self.mean()).max(1.0)
    }
}

/// How often the flats have each code below the top one, which holds what is saturated.
fn counts(set: &CaptureSet, scans: &[Scan]) -> Vec<u64> {
    let flats: Vec<&Scan> =
        scans.iter().filter(|s| set.captures[s.capture].role == Role::Flat).collect();
    let top = usize::from(set.sensor.white_level_dn);
    (0..top).map(|code| flats.iter().map(|s| s.codes[code]).sum::<u64>()).collect()
}

/// The steps of codes by level, where some are larger than 1 DN: at most as many as the effect
/// has, those joined whose steps are most alike.
fn ranges(codes: &[u64]) -> Vec<Range> {
    let used = used(codes);
    let dense = |code: usize| codes[code] >= MIN_SAMPLES;
    let window = |i: usize| {
        let from = i * WINDOW;
        Range { from, to: from + WINDOW, pairs: 0, covered: 0, breaks: 0, windows: 1 }
    };
    let mut windows: Vec<Range> = (0..=codes.len() / WINDOW).map(window).collect();
    // Neighbours in use, both dense.
    let mut last = 0;
    for pair in used.windows(2).filter(|pair| dense(pair[0]) && dense(pair[1])) {
        let window = &mut windows[pair[0] / WINDOW];
        window.pairs += 1;
        window.covered += pair[1] - pair[0];
        window.breaks += usize::from(pair[0] != last);
        last = pair[1];
    }
    windows.retain(|window| window.covered >= MIN_COVERED);
    let mut found = without_changes(joined(windows.into_iter()));
    // Steps that are none are of 1 DN.
    found.iter_mut().filter(|r| !r.is_wide()).for_each(|r| r.covered = r.pairs);
    let mut found = joined(found.into_iter());
    let wide: usize = found.iter().filter(|r| r.is_wide()).map(|r| r.windows).sum();
    if wide < MIN_WINDOWS {
        return Vec::new();
    }
    while found.len() > MAX_RANGES {
        let ratio = |i: usize| libm::fabs(libm::log2(found[i].mean() / found[i + 1].mean()));
        let alike = (0..found.len() - 1).min_by(|&a, &b| ratio(a).total_cmp(&ratio(b)));
        let Some(i) = alike else { break };
        let next = found.remove(i + 1);
        found[i].join(next);
    }
    found
}

/// Codes that samples have.
fn used(codes: &[u64]) -> Vec<usize> {
    (0..codes.len()).filter(|code| codes[*code] > 0).collect()
}

/// Neighbours of one step as one.
fn joined(ranges: impl Iterator<Item = Range>) -> Vec<Range> {
    let mut found: Vec<Range> = Vec::new();
    for range in ranges {
        match found.last_mut().filter(|last| last.is_like(&range)) {
            Some(last) => last.join(range),
            None => found.push(range),
        }
    }
    found
}

/// Without the windows in which one step changes to the next: these are part of the latter.
fn without_changes(mut ranges: Vec<Range>) -> Vec<Range> {
    let mut i = 1;
    while i + 1 < ranges.len() {
        let (before, here, after) = (ranges[i - 1], ranges[i], ranges[i + 1]);
        let between = (before.mean() < here.mean()) == (here.mean() < after.mean());
        if between && here.windows == 1 && before.windows > 1 && after.windows > 1 {
            ranges[i + 1].from = here.from;
            ranges.remove(i);
        }
        i += 1;
    }
    ranges
}

/// The ranges as the effect has them, where each begins and its step, DN. One begins with that of
/// its first codes from which on those that follow are most likely its own.
fn steps(ranges: &[Range], codes: &[u64]) -> Vec<[f64; 2]> {
    let used = used(codes);
    let begin = |range: &Range| {
        let step = range.step();
        let own: Vec<usize> =
            used.iter().copied().filter(|c| *c >= range.from).take(JUDGED).collect();
        let fit = |from: usize| {
            let rounded = |code: usize| {
                let n = ((code - from) as f64 / step).round();
                from + (n * step - 0.5).ceil() as usize
            };
            let fits = |code: &usize| if rounded(*code) == *code { 1 } else { -MISFIT };
            own.iter().filter(|code| **code >= from).map(fits).sum::<i32>()
        };
        own.iter().rev().max_by_key(|from| fit(**from)).map_or(0.0, |code| *code as f64)
    };
    let begins = |(i, range)| if i == 0 { 0.0 } else { begin(range) };
    ranges.iter().enumerate().map(|(i, range)| [begins((i, range)), range.step()]).collect()
}

/// Whether codes were cut to those that are left, and not rounded. Where the step grows from s₀ to
/// s, the first code a of the larger step is all that lay from a to a + s, s wide, if they were
/// cut, and (s₀ + s)/2 if they were rounded. Its share among its neighbours tells, where all are
/// dense and their steps even; `false` where none is or chance decides.
fn are_cut(codes: &[u64]) -> bool {
    let used = used(codes);
    let (mut found, mut cut, mut rounded) = (0.0, 0.0, 0.0);
    for window in used.windows(2 * BESIDE + 1) {
        let steps: Vec<usize> = window.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let (before, after) = steps.split_at(BESIDE);
        let even = |steps: &[usize]| steps.iter().all(|step| *step == steps[0]);
        let dense = window.iter().all(|code| codes[*code] >= MIN_SAMPLES);
        if !(even(before) && even(after) && before[0] < after[0] && dense) {
            continue;
        }
        let per_dn = |side: &[usize], step: usize| {
            side.iter().map(|code| codes[*code] as f64).sum::<f64>() / (BESIDE * step) as f64
        };
        // Samples per DN at a, on a line between those of both sides.
        let (low, high) =
            (per_dn(&window[..BESIDE], before[0]), per_dn(&window[BESIDE + 1..], after[0]));
        let here = low + (high - low) * before[0] as f64 / (before[0] + after[0]) as f64;
        found += codes[window[BESIDE]] as f64;
        cut += here * after[0] as f64;
        rounded += here * (before[0] + after[0]) as f64 / 2.0;
    }
    found - rounded > f64::max((cut - rounded) / 2.0, MIN_ERRORS * found.sqrt())
}

/// The largest ratio of the variance of a stack on wider codes to that of photon transfer with the
/// gain of the stacks of its analog gain on codes of 1 DN; none where either is missing.
fn excess(set: &CaptureSet, scans: &[Scan], transfer: &Transfer, ranges: &[Range]) -> Option<f64> {
    let step_at = |level: f64| {
        let below = ranges.iter().rev().find(|r| r.from as f64 <= level);
        below.or(ranges.first()).map_or(1.0, Range::step)
    };
    let stacks = |role: Role, gain: f64| {
        let of = move |(s, p): (&Scan, &Point)| {
            let c = &set.captures[s.capture];
            let own = c.role == role && c.analog_gain == gain && p.variance_dn2.is_finite();
            own.then_some(*p)
        };
        scans.iter().zip(&transfer.points).filter_map(of)
    };
    let gains = scans.iter().map(|s| set.captures[s.capture].analog_gain);
    let of_gain = |gain: f64| {
        let dark = stacks(Role::Dark, gain).min_by(|a, b| a.level_dn.total_cmp(&b.level_dn))?;
        let (narrow, wide): (Vec<Point>, Vec<Point>) =
            stacks(Role::Flat, gain).partition(|p| step_at(p.level_dn) <= 1.0);
        let lit = narrow.iter().filter(|p| p.variance_dn2 > MIN_LIT * dark.variance_dn2);
        let slope =
            |p: &Point| (p.variance_dn2 - dark.variance_dn2) / (p.level_dn - dark.level_dn);
        let mut slopes: Vec<f64> = lit.map(slope).collect();
        if slopes.is_empty() {
            return None;
        }
        let k = median(&mut slopes, f64::total_cmp);
        let ratio = |p: &Point| {
            let rounding = (step_at(p.level_dn).powi(2) - 1.0) / 12.0;
            let expected = dark.variance_dn2 + k * (p.level_dn - dark.level_dn) + rounding;
            p.variance_dn2 / expected
        };
        wide.iter().map(ratio).reduce(f64::max)
    };
    gains.filter_map(of_gain).reduce(f64::max)
}

/// The finding about them.
pub fn finding(set: &CaptureSet, scans: &[Scan], transfer: &Transfer) -> Option<Finding> {
    let codes = counts(set, scans);
    let ranges = ranges(&codes);
    let cut = are_cut(&codes);
    let largest = ranges.iter().map(Range::step).reduce(f64::max)?;
    let by_level = ranges.iter().map(|r| {
        let step = (1e3 * r.step()).round() / 1e3;
        let mean = if step.fract() > 0.0 { "in the mean " } else { "" };
        format!("{step} DN {mean}from {} to {} DN", r.from, r.to)
    });
    let by_level: Vec<String> = by_level.collect();
    let excess = excess(set, scans, transfer, &ranges).filter(|excess| *excess > MERGED);
    let (done, cause) = match excess {
        Some(excess) => (
            Done::Refused,
            format!(
                "where they are wide, the variance is {excess:.1} times that of the photon \
                 transfer of the others: the sensor merged captures of several exposures"
            ),
        ),
        None => (
            Done::Reported,
            format!(
                "a table or lossy compression quantised the samples again, which adds step²/12 to \
                 their variance{}. Take raw without compression, or undo the table; the effect \
                 requantised simulates it",
                match cut {
                    true =>
                        "; they were cut, not rounded, and lie (step − 1)/2 too low in the mean",
                    false => "",
                }
            ),
        ),
    };
    let mut finding = Finding::new(Kind::Requantised, "all captures", done)
        .with_amount(largest, 0.0, "DN")
        .with_description(format!("codes in use are {}: {cause}", by_level.join(", ")));
    (finding.steps, finding.cut) = (steps(&ranges, &codes), cut);
    Some(finding)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Codes of an even density about 500 DN, where the step grows from 1 to 4 DN.
    fn table(per_code: f64, again: impl Fn(usize) -> usize) -> Vec<u64> {
        let mut codes = vec![0; 1200];
        for code in 1..1100 {
            let z = (code as f64 - 500.0) / 150.0;
            codes[again(code)] += (per_code * libm::exp(-0.5 * z * z)) as u64;
        }
        codes
    }

    #[test]
    fn codes_that_were_cut_are_told_from_rounded_ones() {
        let from = |code: usize, up: usize| match code {
            0..500 => code,
            _ => 500 + (code - 500 + up) / 4 * 4,
        };
        let nearest = |code: usize| if code < 499 { code } else { 500 + (code - 498) / 4 * 4 };
        assert!(are_cut(&table(300.0, |code| from(code, 0))));
        assert!(!are_cut(&table(300.0, |code| from(code, 2))));
        assert!(!are_cut(&table(300.0, nearest)));
        assert!(!are_cut(&table(300.0, |code| code)));
        // 7 samples a code say nothing.
        assert!(!are_cut(&table(7.0, |code| from(code, 0))));
    }
}
