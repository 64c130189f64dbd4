//! Pixels that change once within a stack: radiation damage, a hot plug, a defect map that was
//! switched on.
//!
//! Of each pixel the largest of T_i = |c_i|/√(v i (N − i)/N), c the cumulative sum of its
//! residuals about their mean (Page 1954), the two frames at either end left out, with what is
//! left of the residuals passing for noise. A pixel of telegraph noise that switches once looks
//! alike; but such pixels do not switch together. So a frame is taken for one at which something
//! happened where more pixels change than chance puts there (Poisson).

use super::band::{Band, Levels, Residuals, bands};
use super::finding::{Done, Finding, Kind, MAX_PIXELS, names};
use super::hits::{FALSE_EVENTS, Search, stand_in};
use super::scan::Scan;
use super::transfer::Transfer;
use camrig_base::Result;
use camrig_base::numbers::counted;
use camrig_base::tails;
use camrig_captures::CaptureSet;

/// Frames from which a change within a stack is looked for.
const MIN_FRAMES: usize = 6;
/// Frames at either end that no change is looked for in: one sample alone is an event.
const END: usize = 2;
/// Residuals count at most so many standard deviations.
const CLIP: f32 = 50.0;
/// Normal deviate of the squares that a step may leave, as rarely as once in 10⁴.
const REST: f64 = 3.72;
/// Share of the changes at one frame that must go the same way.
const SAME_WAY: f64 = 0.9;

/// A pixel that changes once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// Index of the pixel in the frame.
    pub pixel: usize,
    /// The first frame that is changed.
    pub from: usize,
    /// By how much, DN.
    pub by_dn: f64,
}

/// Pixels of a band that change once; `masked` are samples (frame, pixel of the frame) of events.
pub fn changes(search: &Search, r: &Residuals, masked: &[(usize, usize)]) -> Vec<Change> {
    let n = r.frames;
    if n < MIN_FRAMES {
        return Vec::new();
    }
    let first = search.first_row * r.width;
    let limit = tails::deviate(libm::log(FALSE_EVENTS / search.samples.max(1.0)));
    let expected = r.expected(search.dn_per_e);
    let mut out = Vec::new();
    let mut residuals = vec![0.0f32; n];
    for (p, values) in r.values.chunks(n).enumerate() {
        let v = expected[p];
        let end = CLIP * v.sqrt();
        residuals.iter_mut().zip(values).for_each(|(o, &x)| *o = x.clamp(-end, end));
        let (at, best) = steepest(&residuals, f64::from(v));
        if best < limit {
            continue;
        }
        for &(frame, pixel) in masked {
            if pixel == first + p {
                residuals[frame] = 0.0;
            }
        }
        let (at_now, best) =
            if masked.is_empty() { (at, best) } else { steepest(&residuals, f64::from(v)) };
        let (before, after) = residuals.split_at(at_now);
        let mean = |r: &[f32]| r.iter().map(|&x| f64::from(x)).sum::<f64>() / r.len() as f64;
        let (low, high) = (mean(before), mean(after));
        let of = |r: &[f32], m: f64| r.iter().map(|&x| (f64::from(x) - m).powi(2)).sum::<f64>();
        let more = search.dn_per_e * (high - low).abs();
        let dof = n as f64 - 2.0;
        let rest = (of(before, low) + of(after, high)) / dof / (f64::from(v) + more);
        if best > limit && rest < tails::quantile_of_squares(REST, dof) {
            out.push(Change { pixel: first + p, from: at_now, by_dn: high - low });
        }
    }
    out
}

/// Where the cumulative sum of residuals about their mean stands out most, and by how many
/// standard deviations.
fn steepest(residuals: &[f32], variance: f64) -> (usize, f64) {
    let n = residuals.len();
    let mean = residuals.iter().map(|&x| f64::from(x)).sum::<f64>() / n as f64;
    let (mut sum, mut best) = (0.0, (0, 0.0));
    for (i, &x) in residuals.iter().enumerate() {
        let k = i as f64;
        if i >= END && i + END <= n {
            let z = f64::abs(sum) / (variance * k * (n as f64 - k) / n as f64).sqrt();
            if z > best.1 {
                best = (i, z);
            }
        }
        sum += f64::from(x) - mean;
    }
    best
}

/// The frame at which pixels of a stack of `frames` change together, with its pixels.
pub fn together(changes: &[Change], frames: usize) -> Option<(usize, Vec<Change>)> {
    let possible = frames.saturating_sub(2 * END).max(1) as f64;
    let mean = changes.len() as f64 / possible;
    let of = |from: usize| changes.iter().filter(|c| c.from == from).copied().collect::<Vec<_>>();
    let (from, most) = (END..frames).map(|i| (i, of(i))).max_by_key(|f| f.1.len())?;
    let chance = tails::poisson_least(most.len(), mean) * possible;
    let up = most.iter().filter(|c| c.by_dn > 0.0).count() as f64 / most.len().max(1) as f64;
    (chance < FALSE_EVENTS && !(1.0 - SAME_WAY..SAME_WAY).contains(&up)).then_some((from, most))
}

/// What becomes of pixels that change, in one stack.
pub struct Changed {
    /// Index of the scan.
    pub stack: usize,
    /// The first frame that is changed.
    pub from: usize,
    /// Mean change, DN, and its standard error.
    pub by_dn: (f64, f64),
    /// For each pixel, what its samples from that frame on were, and what stands in for them.
    pub values: Vec<(u32, Vec<[u16; 2]>)>,
}

/// Looks at known pixels in every stack, all of them together, and gives values for those of their
/// samples that are changed: those of the next pixel of the same filter in its row, moved to their
/// own level before.
///
/// # Errors
/// Files that cannot be read.
pub fn follow(
    set: &CaptureSet,
    scans: &[Scan],
    transfer: &Transfer,
    pixels: &[usize],
) -> Result<Vec<Changed>> {
    let width = set.sensor.width;
    let cfa = set.cfa();
    let mut out = Vec::new();
    for (stack, scan) in scans.iter().enumerate() {
        let n = scan.frames.len();
        if n < MIN_FRAMES {
            continue;
        }
        let capture = &set.captures[scan.capture];
        let levels = Levels::new(set, scan, transfer.black);
        let mut pooled = vec![0.0f32; n];
        let mut kept: Vec<(usize, Vec<f32>, Vec<[u16; 2]>)> = Vec::new();
        for rows in bands(width, set.sensor.height, n, cfa.height) {
            let inside = |p: &&usize| rows.contains(&(**p / width));
            let here: Vec<usize> = pixels.iter().filter(inside).copied().collect();
            if here.is_empty() {
                continue;
            }
            let band = Band::read(set, capture, &rows)?;
            let r = Residuals::new(&band, &levels);
            let expected = r.expected(transfer.gain(capture.analog_gain));
            for pixel in here {
                let p = pixel - rows.start * width;
                let values = r.values[p * n..(p + 1) * n].to_vec();
                let sd = expected[p].sqrt();
                pooled.iter_mut().zip(&values).for_each(|(s, v)| *s += v / sd);
                let q =
                    stand_in(p, width, cfa.width, |q| pixels.contains(&(q + rows.start * width)));
                let of = |p: usize| band.samples[p * n..(p + 1) * n].iter().copied();
                let apart = r.median[p] - r.median[q];
                let other = of(q).map(|v| (f32::from(v) + apart).round().max(0.0) as u16);
                kept.push((pixel, values, of(p).zip(other).map(|(was, is)| [was, is]).collect()));
            }
        }
        let (from, z) = steepest(&pooled, kept.len() as f64);
        if z < tails::deviate(libm::log(FALSE_EVENTS / (n * scans.len()) as f64)) {
            continue;
        }
        let mean = |v: &[f32]| v.iter().map(|&x| f64::from(x)).sum::<f64>() / v.len() as f64;
        let rises: Vec<f64> =
            kept.iter().map(|(_, v, _)| mean(&v[from..]) - mean(&v[..from])).collect();
        let count = rises.len() as f64;
        let by = rises.iter().sum::<f64>() / count;
        let scatter = rises.iter().map(|r| (r - by).powi(2)).sum::<f64>();
        let values = kept.into_iter().map(|(pixel, values, other)| {
            // The median lies between the two levels: down to the one before.
            let down = mean(&values[..from]).round();
            let moved = |v: u16| (f64::from(v) + down).clamp(0.0, f64::from(u16::MAX)) as u16;
            let stand_ins = other[from..].iter().map(|&[was, is]| [was, moved(is)]);
            (pixel as u32, stand_ins.collect())
        });
        let by_dn = (by, (scatter / (count * (count - 1.0).max(1.0))).sqrt());
        out.push(Changed { stack, from, by_dn, values: values.collect() });
    }
    Ok(out)
}

/// What is said of pixels that changed.
pub fn finding(
    set: &CaptureSet,
    scans: &[Scan],
    transfer: &Transfer,
    pixels: &[usize],
    changed: &[Changed],
) -> Finding {
    let id = |c: &Changed| set.captures[scans[c.stack].capture].id.as_str();
    let ids: Vec<&str> = changed.iter().map(id).collect();
    let weight: f64 = changed.iter().map(|c| 1.0 / c.by_dn.1.max(1e-6).powi(2)).sum();
    let by = changed.iter().map(|c| c.by_dn.0 / c.by_dn.1.max(1e-6).powi(2)).sum::<f64>() / weight;
    let mut by_frame: Vec<(usize, Vec<&str>)> = Vec::new();
    for c in changed {
        match by_frame.iter_mut().find(|(from, _)| *from == c.from) {
            Some((_, ids)) => ids.push(id(c)),
            None => by_frame.push((c.from, vec![id(c)])),
        }
    }
    let frames: Vec<String> =
        by_frame.iter().map(|(from, ids)| format!("frame {from} of {}", names(ids))).collect();
    let electrons = transfer.dn_per_e.filter(|k| *k > 0.0).map(|k| by / k);
    let of_gain = electrons.map_or(String::new(), |e| format!(" ({e:.1} e⁻)"));
    let mut finding = Finding::new(Kind::DefectsAppear, ids.join(", "), Done::LeftOut);
    finding.count = pixels.len();
    finding.frames = by_frame.iter().map(|f| f.0).collect();
    let width = set.sensor.width;
    finding.pixels = pixels.iter().map(|p| [p % width, p / width]).take(MAX_PIXELS).collect();
    finding.amount(by, weight.sqrt().recip(), "DN").says(format!(
        "{} {} by {by:.2} ± {:.2} DN{of_gain} together, from {} on (counted from 0): \
         damage, or a camera that changed, not noise. Their samples from there on are left out",
        counted(pixels.len(), "pixel"),
        if pixels.len() == 1 { "changes" } else { "change" },
        weight.sqrt().recip(),
        frames.join(", from "),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_that_change_at_one_frame_are_told_from_those_that_change_anywhere() {
        let change = |pixel, from| Change { pixel, from, by_dn: 30.0 };
        let shared: Vec<Change> = (0..12).map(|p| change(p, 7)).collect();
        assert_eq!(together(&shared, 16).unwrap().0, 7);
        let spread: Vec<Change> = (0..12).map(|p| change(p, 2 + p % 12)).collect();
        assert_eq!(together(&spread, 16), None);
        assert_eq!(together(&shared[..2], 16), None);
        let both_ways: Vec<Change> = (0..12)
            .map(|p| Change { by_dn: if p % 2 == 0 { 30.0 } else { -30.0 }, ..change(p, 7) })
            .collect();
        assert_eq!(together(&both_ways, 16), None);
    }
}
