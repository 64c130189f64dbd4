//! Codes that were quantised again behind the converter, with a step that depends on the level: by a
//! table (square root, decompanded HDR) or by lossy compression. The codes in use tell the step: where
//! samples are dense, a code that none has is not in the table.

use super::finding::{Done, Finding, Kind};
use super::scan::Scan;
use camrig_captures::{CaptureSet, Role};

/// Width of the windows of codes in which the step is counted.
const WINDOW: usize = 32;
/// Mean number of samples per code of a window in which codes are counted: of a code in use, even
/// one with a third of its neighbours' width, chance leaves none only once in 20,000 codes.
const MIN_DENSITY: f64 = 30.0;
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
    let mut found: Vec<Range> = Vec::new();
    let mut wide = 0;
    for from in (0..top.saturating_sub(WINDOW)).step_by(WINDOW) {
        let counts =
            (from..from + WINDOW).map(|code| flats.iter().map(|s| s.codes[code]).sum::<u64>());
        let counts: Vec<u64> = counts.collect();
        if (counts.iter().sum::<u64>() as f64) < MIN_DENSITY * WINDOW as f64 {
            continue;
        }
        let used = counts.iter().filter(|n| **n > 0).count();
        let step = WINDOW as f64 / used as f64;
        // The window's ends cut off part of a step.
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
