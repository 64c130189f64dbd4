//! The code at which a converter saturates, where it is not the largest of its bits: samples of a
//! bright stack pile up at the highest code that occurs, more than at any code near below it.

use super::finding::{Done, Finding, Kind, names};
use super::scan::Scan;
use camrig_captures::{CaptureSet, Role};

/// Least share of a stack's samples at the highest code that is a pile; saturated maps and noise
/// are judged by no smaller shares.
const MIN_SHARE: f64 = 1e-3;
/// Ratio of the number of samples at the highest code to that at the next lower code in use from
/// which they are a pile. A distribution that is not clipped falls towards its end, and codes that
/// stand for several differ in width by a factor of 2 from one to the next. Chosen.
const PILE: u64 = 3;
/// Codes in use below the highest in other flats: with fewer, one code may be a whole stack.
const MIN_CODES: usize = 11;

/// The code where samples pile up below the white level of the manifest.
pub fn of(set: &CaptureSet, scans: &[Scan]) -> Option<u16> {
    let highest = |s: &Scan| s.codes.iter().rposition(|&n| n > 0);
    let top = scans.iter().filter_map(highest).max()?;
    if top >= usize::from(set.sensor.white_level_dn) {
        return None;
    }
    let flats = || scans.iter().filter(|s| set.captures[s.capture].role == Role::Flat);
    let other = |s: &&Scan| s.codes[top] == 0;
    let used = |s: &Scan| s.codes.iter().filter(|&&n| n > 0).count() >= MIN_CODES;
    (flats().any(|s| piles_up(s, top)) && flats().filter(other).any(used))
        .then(|| u16::try_from(top).ok())
        .flatten()
}

fn piles_up(scan: &Scan, top: usize) -> bool {
    let all: u64 = scan.codes.iter().sum();
    let next = scan.codes[..top].iter().rfind(|&&n| n > 0).copied().unwrap_or(0);
    let count = scan.codes[top];
    count as f64 > MIN_SHARE * all as f64 && count > PILE * next
}

/// The finding about it.
pub fn finding(set: &CaptureSet, scans: &[Scan], top: u16) -> Finding {
    let reach: Vec<&Scan> = scans.iter().filter(|s| piles_up(s, top.into())).collect();
    let ids: Vec<&str> = reach.iter().map(|s| set.captures[s.capture].id.as_str()).collect();
    let count: u64 = reach.iter().map(|s| s.codes[usize::from(top)]).sum();
    Finding::new(Kind::TopCode, names(&ids), Done::Corrected)
        .with_count(count as usize)
        .with_amount(f64::from(top), 0.0, "DN")
        .with_description(format!(
            "{count} samples are {top} DN and none is larger, although the white level is {} DN: \
             they are read as saturated. Set white_level_dn = {top} in captures.toml",
            set.sensor.white_level_dn
        ))
}
