//! Codes that were quantised again behind the converter, with a step that depends on the level: by a
//! table (square root, decompanded HDR) or by lossy compression. The codes in use tell the step: where
//! samples are dense, a code that none has is not in the table.

use super::finding::{Done, Finding, Kind};
use super::scan::Scan;
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

/// Most ranges that the effect `requantised` has.
const MAX_RANGES: usize = 5;

/// Step of the codes from one level to another, DN.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Range {
    from: usize,
    to: usize,
    step: f64,
    /// The lowest code in use of it.
    first: usize,
}

/// The steps of the flats' codes by level, where some are larger than 1 DN.
fn ranges(set: &CaptureSet, scans: &[Scan]) -> Vec<Range> {
    let flats: Vec<&Scan> =
        scans.iter().filter(|s| set.captures[s.capture].role == Role::Flat).collect();
    // The top code holds what is saturated.
    let top = usize::from(set.sensor.white_level_dn);
    let codes = (0..top).map(|code| flats.iter().map(|s| s.codes[code]).sum::<u64>());
    let codes: Vec<u64> = codes.collect();
    let used: Vec<usize> = (0..top).filter(|code| codes[*code] > 0).collect();
    let dense = |code: usize| codes[code] >= MIN_SAMPLES;
    // Neighbours in use, both dense: how many pairs a window has, and how far apart together.
    let mut windows = vec![(0usize, 0usize, 0usize); top / WINDOW + 1];
    for pair in used.windows(2).filter(|pair| dense(pair[0]) && dense(pair[1])) {
        let (pairs, covered, first) = &mut windows[pair[0] / WINDOW];
        if *pairs == 0 {
            *first = pair[0];
        }
        *pairs += 1;
        *covered += pair[1] - pair[0];
    }
    let mut found: Vec<Range> = Vec::new();
    let mut wide = 0;
    for (i, (pairs, covered, first)) in windows.into_iter().enumerate() {
        if covered < MIN_COVERED {
            continue;
        }
        let (from, step) = (i * WINDOW, covered as f64 / pairs as f64);
        let step = if step < MIN_STEP { 1.0 } else { step.round() };
        wide += usize::from(step > 1.0);
        match found.last_mut().filter(|last| last.step == step) {
            Some(last) => last.to = from + WINDOW,
            None => found.push(Range { from, to: from + WINDOW, step, first }),
        }
    }
    if wide < MIN_WINDOWS { Vec::new() } else { found }
}

/// The ranges as the effect has them, where each begins and its step, DN: of more than it has,
/// those whose steps are most alike are joined to one of their mean step. The first is from 0 on,
/// whose step must be that of its codes from there.
fn steps(mut ranges: Vec<Range>) -> Vec<[u16; 2]> {
    while ranges.len() > MAX_RANGES {
        let ratio = |i: usize| libm::fabs(libm::log2(ranges[i].step / ranges[i + 1].step));
        let alike = (0..ranges.len() - 1).min_by(|&a, &b| ratio(a).total_cmp(&ratio(b)));
        let Some(i) = alike else { break };
        let next = ranges.remove(i + 1);
        let (a, b) = (ranges[i], next);
        let weight = |r: &Range| (r.to - r.from) as f64;
        let codes = weight(&a) / a.step + weight(&b) / b.step;
        let step = ((weight(&a) + weight(&b)) / codes).round();
        ranges[i] = Range { to: b.to, step, ..a };
    }
    let begins =
        |(i, r): (usize, &Range)| if i == 0 { r.first % r.step as usize } else { r.first };
    let words = |v: usize| u16::try_from(v).unwrap_or(u16::MAX);
    ranges.iter().enumerate().map(|r| [words(begins(r)), words(r.1.step as usize)]).collect()
}

/// The finding about them.
pub fn finding(set: &CaptureSet, scans: &[Scan]) -> Option<Finding> {
    let ranges = ranges(set, scans);
    let largest = ranges.iter().map(|r| r.step).reduce(f64::max)?;
    let by_level: Vec<String> =
        ranges.iter().map(|r| format!("{} DN from {} to {} DN", r.step, r.from, r.to)).collect();
    let mut finding = Finding::new(Kind::Requantised, "all captures", Done::Reported)
        .with_amount(largest, 0.0, "DN")
        .with_description(format!(
            "codes in use are {}: a table or lossy compression quantised the samples again, which \
             adds step²/12 to their variance. Take raw without compression, or undo the table; the \
             effect requantised simulates it",
            by_level.join(", ")
        ));
    finding.steps = steps(ranges);
    Some(finding)
}
