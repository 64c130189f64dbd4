//! Frames that are copies: the same bytes twice. Two frames of a sensor never are, unless it has
//! no noise.

use super::finding::{Done, Finding, Kind, names};
use super::scan::Scan;
use camrig_base::copies::Print;
use camrig_captures::CaptureSet;
use std::collections::BTreeMap;

/// A place in a set: capture and frame.
type Place = (usize, usize);

/// Frames that are copies of others: for each stack one finding.
pub fn copies(set: &CaptureSet, scans: &[Scan]) -> Vec<Finding> {
    let mut seen: BTreeMap<Print, Vec<Place>> = BTreeMap::new();
    for scan in scans {
        for (i, frame) in scan.frames.iter().enumerate() {
            if let Some(print) = frame.print {
                seen.entry(print).or_default().push((scan.capture, i));
            }
        }
    }
    // Copies beyond the first, by stack.
    let mut again: BTreeMap<usize, Vec<(usize, Place)>> = BTreeMap::new();
    for places in seen.values() {
        for &(capture, frame) in &places[1..] {
            again.entry(capture).or_default().push((frame, places[0]));
        }
    }
    again.into_iter().map(|(capture, copies)| finding(set, scans, capture, copies)).collect()
}

fn finding(
    set: &CaptureSet,
    scans: &[Scan],
    capture: usize,
    mut copies: Vec<(usize, Place)>,
) -> Finding {
    copies.sort_unstable();
    let id = |c: usize| set.captures[c].id.as_str();
    let total = scans.iter().find(|s| s.capture == capture).map_or(0, |s| s.frames.len());
    let (frame, (of, of_frame)) = copies[0];
    let mut others: Vec<&str> = copies.iter().map(|c| id(c.1.0)).collect();
    others.sort_unstable();
    others.dedup();
    let mut finding = Finding::new(Kind::IdenticalFrames, id(capture), Done::Refused);
    finding.count = copies.len();
    finding.frames = copies.iter().map(|c| c.0).collect();
    let from = if of == capture { String::new() } else { format!(" of {}", id(of)) };
    finding.says(format!(
        "copies in {} of {total} frames, the same bytes as frames of {}: frame {frame} is frame \
         {of_frame}{from}. Copies hold no noise of their own; take frames anew, or keep one of \
         each",
        copies.len(),
        names(&others),
    ))
}
