//! Frames that are copies of others, byte for byte. Two frames of a sensor never are, unless it has
//! no noise.

use super::finding::{Done, Finding, Kind, names};
use super::scan::Scan;
use camrig_base::copies::Print;
use camrig_captures::CaptureSet;
use std::collections::BTreeMap;

/// A frame of a set.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Place {
    capture: usize,
    frame: usize,
}

/// A frame of a stack, and the first frame that it is a copy of.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Copied {
    frame: usize,
    original: Place,
}

/// Frames that are copies of earlier ones: one finding for each stack.
pub fn copies(set: &CaptureSet, scans: &[Scan]) -> Vec<Finding> {
    let mut by_print: BTreeMap<Print, Vec<Place>> = BTreeMap::new();
    for scan in scans {
        for (frame, summary) in scan.frames.iter().enumerate() {
            if let Some(print) = summary.print {
                by_print.entry(print).or_default().push(Place { capture: scan.capture, frame });
            }
        }
    }
    let mut by_stack: BTreeMap<usize, Vec<Copied>> = BTreeMap::new();
    for places in by_print.values() {
        for &Place { capture, frame } in &places[1..] {
            by_stack.entry(capture).or_default().push(Copied { frame, original: places[0] });
        }
    }
    by_stack.into_iter().map(|(capture, copies)| finding(set, scans, capture, copies)).collect()
}

fn finding(set: &CaptureSet, scans: &[Scan], capture: usize, mut copies: Vec<Copied>) -> Finding {
    copies.sort_unstable();
    let id = |c: usize| set.captures[c].id.as_str();
    let total = scans.iter().find(|s| s.capture == capture).map_or(0, |s| s.frames.len());
    let Copied { frame, original } = copies[0];
    let mut others: Vec<&str> = copies.iter().map(|c| id(c.original.capture)).collect();
    others.sort_unstable();
    others.dedup();
    let mut finding = Finding::new(Kind::IdenticalFrames, id(capture), Done::Refused);
    finding.count = copies.len();
    finding.frames = copies.iter().map(|c| c.frame).collect();
    let of = match original.capture {
        same if same == capture => String::new(),
        other => format!(" of {}", id(other)),
    };
    finding.with_description(format!(
        "{} of {total} frames are copies, byte for byte, of frames of {}: frame {frame} equals \
         frame {}{of}. Copies have no noise of their own; take the frames again, or keep one of \
         each",
        copies.len(),
        names(&others),
        original.frame,
    ))
}
