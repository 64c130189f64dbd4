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

/// Step of the codes from one level to another, DN.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Range {
    from: usize,
    to: usize,
    step: f64,
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
    let mut windows = vec![(0usize, 0usize); top / WINDOW + 1];
    for pair in used.windows(2).filter(|pair| dense(pair[0]) && dense(pair[1])) {
        let (pairs, covered) = &mut windows[pair[0] / WINDOW];
        *pairs += 1;
        *covered += pair[1] - pair[0];
    }
    let mut found: Vec<Range> = Vec::new();
    let mut wide = 0;
    for (i, (pairs, covered)) in windows.into_iter().enumerate() {
        if covered < MIN_COVERED {
            continue;
        }
        let (from, step) = (i * WINDOW, covered as f64 / pairs as f64);
        let step = if step < MIN_STEP { 1.0 } else { step.round() };
        wide += usize::from(step > 1.0);
        match found.last_mut().filter(|last| last.step == step) {
            Some(last) => last.to = from + WINDOW,
            None => found.push(Range { from, to: from + WINDOW, step }),
        }
    }
    if wide < MIN_WINDOWS { Vec::new() } else { found }
}

/// The finding about them.
pub fn finding(set: &CaptureSet, scans: &[Scan]) -> Option<Finding> {
    let ranges = ranges(set, scans);
    let largest = ranges.iter().map(|r| r.step).reduce(f64::max)?;
    let by_level: Vec<String> =
        ranges.iter().map(|r| format!("{} DN from {} to {} DN", r.step, r.from, r.to)).collect();
    let finding = Finding::new(Kind::Requantised, "all captures", Done::Reported)
        .with_amount(largest, 0.0, "DN")
        .with_description(format!(
            "codes in use are {}: a table or lossy compression quantised the samples again, which \
             adds step²/12 to their variance. Take raw without compression, or undo the table",
            by_level.join(", ")
        ));
    Some(finding)
}
