//! Finds regions of slanted edges in a frame.

use super::{MIN_SIDE, Roi, find, measure};
use camrig_base::{Cfa, Plane};
use rayon::prelude::*;

/// Side of a region, pixels: room for the tails of a blurred edge, and enough rows for its noise.
const SIDE: usize = 80;
/// Number of search steps per side: an edge that is cut off in one region is complete in the next.
const STEPS: usize = 4;
/// Smallest contrast of an edge relative to the largest in the frame: texture has less than a
/// target.
const MIN_CONTRAST: f64 = 0.3;

/// Non-overlapping regions with one slanted edge each that [`measure`] accepts in this channel,
/// from the top of the frame down.
pub fn find_edges(
    frame: &Plane<u16>,
    cfa: &Cfa,
    channel: char,
    white_level_dn: Option<u16>,
) -> Vec<Roi> {
    let whole = frame.width.min(frame.height);
    let side = SIDE.min(whole / 2).max(MIN_SIDE.min(whole));
    let starts =
        |length: usize| (0..=length - side).step_by((side / STEPS).max(1)).chain([length - side]);
    let places: Vec<[usize; 2]> =
        starts(frame.height).flat_map(|y| starts(frame.width).map(move |x| [x, y])).collect();
    let at = |[x, y]: [usize; 2]| Roi { x, y, width: side, height: side };
    let look = |place: &[usize; 2]| {
        // The edge in the middle has equal room on both sides.
        let first = find(frame, cfa, channel, at(*place), white_level_dn).ok()?;
        let (across, along) = first.line.centre();
        let centre = if first.near_rows { [along, across] } else { [across, along] };
        let start = |centre: f64, length: usize| {
            let start = (centre - 0.5 * side as f64).round().max(0.0) as usize;
            start.min(length - side)
        };
        let roi = at([start(centre[0], frame.width), start(centre[1], frame.height)]);
        let edge = measure(frame, cfa, channel, roi, white_level_dn, None).ok()?;
        let error = edge.mtf50_cycles_per_pixel.std_error / edge.mtf50_cycles_per_pixel.value;
        Some((roi, edge.levels_dn[1] - edge.levels_dn[0], error))
    };
    let mut found: Vec<(Roi, f64, f64)> = places.par_iter().filter_map(look).collect();
    let most = found.iter().map(|f| f.1).fold(0.0, f64::max);
    found.retain(|(_, contrast, _)| *contrast >= MIN_CONTRAST * most);
    // Of those that overlap, the one with the smallest error: others contain ends or corners.
    found.sort_by(|a, b| a.2.total_cmp(&b.2));
    let mut apart: Vec<Roi> = Vec::new();
    for (roi, ..) in found {
        let overlaps =
            |other: &Roi| roi.x.abs_diff(other.x) < side && roi.y.abs_diff(other.y) < side;
        if !apart.iter().any(overlaps) {
            apart.push(roi);
        }
    }
    apart.sort_by_key(|roi| (roi.y, roi.x));
    apart
}
