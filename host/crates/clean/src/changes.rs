//! Pixels that change once within a stack: radiation damage, a hot plug, a defect map that was
//! switched on.
//!
//! Change-point detection by the cumulative sum (Page 1954): for each pixel the largest
//! T_i = |c_i|/√(v i (N − i)/N), c the cumulative sum of its residuals about their mean, v its
//! expected variance, without the two frames at either end; what remains about the two levels must
//! be consistent with noise. A pixel of telegraph noise that switches once looks the same, but such
//! pixels do not switch together. A change is therefore accepted only at a frame at which more
//! pixels change than chance explains (Poisson).

use super::band::{Band, bands};
use super::corrections::Substitution;
use super::events::{FALSE_EVENTS, Search, substitute};
use super::finding::{Done, Finding, Kind, MAX_PIXELS, names};
use super::residuals::{FrameLevels, Residuals};
use super::scan::Scan;
use super::transfer::Transfer;
use camrig_base::Result;
use camrig_base::numbers::counted;
use camrig_base::tails;
use camrig_captures::CaptureSet;

/// Shortest stack that is searched for a change, frames.
const MIN_FRAMES: usize = 6;
/// Frames at either end without a change: a single deviating sample is an event.
const END: usize = 2;
/// Residuals are clipped to this many standard deviations.
const CLIP: f32 = 50.0;
/// Normal quantile of the mean square that may remain about a step, exceeded with a probability of
/// 10⁻⁴.
const MAX_REMAINDER: f64 = 3.72;
/// Share of the changes at one frame that must have the same sign.
const SAME_SIGN: f64 = 0.9;

/// A pixel that changes once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// Index of the pixel in the frame.
    pub pixel: usize,
    /// The first changed frame.
    pub from: usize,
    /// Change of its level, DN.
    pub by_dn: f64,
}

/// A candidate for the frame at which a series changes.
#[derive(Clone, Copy)]
struct ChangePoint {
    /// The first changed frame.
    from: usize,
    /// Its T, standard deviations.
    z: f64,
}

/// Pixels of a band that change once; samples of events, `masked` as (frame, pixel of the frame),
/// do not count.
pub fn changes(search: &Search, r: &Residuals, masked: &[(usize, usize)]) -> Vec<Change> {
    let n = r.frames;
    if n < MIN_FRAMES {
        return Vec::new();
    }
    let first = search.first_row * r.width;
    let limit = tails::normal_quantile(libm::log(FALSE_EVENTS / search.samples.max(1.0)));
    let expected = r.expected_variance(search.dn_per_e);
    let mut out = Vec::new();
    let mut residuals = vec![0.0f32; n];
    for (p, values) in r.values.chunks(n).enumerate() {
        let v = expected[p];
        let end = CLIP * v.sqrt();
        residuals.iter_mut().zip(values).for_each(|(o, &x)| *o = x.clamp(-end, end));
        let unmasked = change_point(&residuals, f64::from(v));
        if unmasked.z < limit {
            continue;
        }
        for &(frame, pixel) in masked {
            if pixel == first + p {
                residuals[frame] = 0.0;
            }
        }
        let found = match masked.is_empty() {
            true => unmasked,
            false => change_point(&residuals, f64::from(v)),
        };
        let (before, after) = residuals.split_at(found.from);
        let mean = |r: &[f32]| r.iter().map(|&x| f64::from(x)).sum::<f64>() / r.len() as f64;
        let (low, high) = (mean(before), mean(after));
        let squares =
            |r: &[f32], m: f64| r.iter().map(|&x| (f64::from(x) - m).powi(2)).sum::<f64>();
        let shot = search.dn_per_e * (high - low).abs();
        let dof = n as f64 - 2.0;
        let remainder =
            (squares(before, low) + squares(after, high)) / dof / (f64::from(v) + shot);
        if found.z > limit && remainder < tails::quantile_of_squares(MAX_REMAINDER, dof) {
            out.push(Change { pixel: first + p, from: found.from, by_dn: high - low });
        }
    }
    out
}

/// The frame at which the cumulative sum of residuals about their mean is most significant.
fn change_point(residuals: &[f32], variance: f64) -> ChangePoint {
    let n = residuals.len();
    let mean = residuals.iter().map(|&x| f64::from(x)).sum::<f64>() / n as f64;
    let (mut sum, mut best) = (0.0, ChangePoint { from: 0, z: 0.0 });
    for (i, &x) in residuals.iter().enumerate() {
        let k = i as f64;
        if i >= END && i + END <= n {
            let z = f64::abs(sum) / (variance * k * (n as f64 - k) / n as f64).sqrt();
            if z > best.z {
                best = ChangePoint { from: i, z };
            }
        }
        sum += f64::from(x) - mean;
    }
    best
}

/// The changes of a stack of `frames` frames that happen together, at one frame.
pub fn simultaneous(changes: &[Change], frames: usize) -> Option<Vec<Change>> {
    let possible = frames.saturating_sub(2 * END).max(1) as f64;
    let mean = changes.len() as f64 / possible;
    let at = |from: usize| changes.iter().filter(|c| c.from == from).copied().collect::<Vec<_>>();
    let most = (END..frames).map(at).max_by_key(Vec::len)?;
    let chance = tails::poisson_at_least(most.len(), mean) * possible;
    let up = most.iter().filter(|c| c.by_dn > 0.0).count() as f64 / most.len().max(1) as f64;
    (chance < FALSE_EVENTS && !(1.0 - SAME_SIGN..SAME_SIGN).contains(&up)).then_some(most)
}

/// How known pixels change in one stack.
pub struct Changed {
    /// Index of the scan.
    pub stack: usize,
    /// The first changed frame.
    pub from: usize,
    /// Mean change, DN.
    pub by_dn: f64,
    /// Its standard error, DN.
    pub std_error_dn: f64,
    /// The pixels.
    pub pixels: Vec<ChangedPixel>,
}

/// A pixel that changes, with the values that its changed samples get.
pub struct ChangedPixel {
    /// Index of the pixel in the frame.
    pub pixel: u32,
    /// Its samples from the first changed frame on.
    pub samples: Vec<Substitution>,
}

/// Examines known pixels in every stack, pooled, and estimates what their changed samples would
/// have been: the next pixel of the same filter in the row, shifted to the level before the change.
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
        let levels = FrameLevels::new(set, scan, transfer.black);
        let mut pooled = vec![0.0f32; n];
        // For each pixel: its residuals, and its samples with those of its neighbour.
        let mut series: Vec<(usize, Vec<f32>, Vec<Substitution>)> = Vec::new();
        for rows in bands(width, set.sensor.height, n, cfa.height) {
            let inside = |p: &&usize| rows.contains(&(**p / width));
            let here: Vec<usize> = pixels.iter().filter(inside).copied().collect();
            if here.is_empty() {
                continue;
            }
            let band = Band::read(set, capture, &rows)?;
            let r = Residuals::new(&band, &levels);
            let expected = r.expected_variance(transfer.gain(capture.analog_gain));
            for pixel in here {
                let p = pixel - rows.start * width;
                let values = r.values[p * n..(p + 1) * n].to_vec();
                let sd = expected[p].sqrt();
                pooled.iter_mut().zip(&values).for_each(|(s, v)| *s += v / sd);
                let also_changed = |q: usize| pixels.contains(&(q + rows.start * width));
                let q = substitute(p, width, cfa.width, also_changed);
                let of = |p: usize| band.samples[p * n..(p + 1) * n].iter().copied();
                let difference = r.median[p] - r.median[q];
                let other = of(q).map(|v| (f32::from(v) + difference).round().max(0.0) as u16);
                let samples = of(p).zip(other).map(|(from, to)| Substitution { from, to });
                series.push((pixel, values, samples.collect()));
            }
        }
        let ChangePoint { from, z } = change_point(&pooled, series.len() as f64);
        let chance = FALSE_EVENTS / (n * scans.len()) as f64;
        if z < tails::normal_quantile(libm::log(chance)) {
            continue;
        }
        let mean = |v: &[f32]| v.iter().map(|&x| f64::from(x)).sum::<f64>() / v.len() as f64;
        let rises: Vec<f64> =
            series.iter().map(|(_, v, _)| mean(&v[from..]) - mean(&v[..from])).collect();
        let count = rises.len() as f64;
        let by_dn = rises.iter().sum::<f64>() / count;
        let scatter = rises.iter().map(|r| (r - by_dn).powi(2)).sum::<f64>();
        let pixels = series.into_iter().map(|(pixel, values, samples)| {
            // The median lies between the two levels: down to the one before.
            let down = mean(&values[..from]).round();
            let shifted = |v: u16| (f64::from(v) + down).clamp(0.0, f64::from(u16::MAX)) as u16;
            let samples = samples[from..].iter();
            let samples = samples.map(|s| Substitution { to: shifted(s.to), ..*s }).collect();
            ChangedPixel { pixel: pixel as u32, samples }
        });
        let std_error_dn = (scatter / (count * (count - 1.0).max(1.0))).sqrt();
        out.push(Changed { stack, from, by_dn, std_error_dn, pixels: pixels.collect() });
    }
    Ok(out)
}

/// The finding about pixels that changed.
pub fn finding(
    set: &CaptureSet,
    scans: &[Scan],
    transfer: &Transfer,
    pixels: &[usize],
    changed: &[Changed],
) -> Finding {
    let id = |c: &Changed| set.captures[scans[c.stack].capture].id.as_str();
    let ids: Vec<&str> = changed.iter().map(id).collect();
    let variance = |c: &Changed| c.std_error_dn.max(1e-6).powi(2);
    let weight: f64 = changed.iter().map(|c| 1.0 / variance(c)).sum();
    let by = changed.iter().map(|c| c.by_dn / variance(c)).sum::<f64>() / weight;
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
    let in_electrons = electrons.map_or(String::new(), |e| format!(" ({e:.1} e⁻)"));
    let mut finding = Finding::new(Kind::DefectsAppear, ids.join(", "), Done::Excluded);
    finding.count = pixels.len();
    finding.frames = by_frame.iter().map(|f| f.0).collect();
    let width = set.sensor.width;
    finding.pixels = pixels.iter().map(|p| [p % width, p / width]).take(MAX_PIXELS).collect();
    finding.with_amount(by, weight.sqrt().recip(), "DN").with_description(format!(
        "{} {} by {by:.2} ± {:.2} DN{in_electrons} together, from {} on (counted from 0): \
         damage, or a change in the camera, not noise. Their samples from there on are excluded",
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
    fn only_pixels_that_change_at_one_frame_in_one_direction_are_accepted() {
        let change = |pixel, from| Change { pixel, from, by_dn: 30.0 };
        let shared: Vec<Change> = (0..12).map(|p| change(p, 7)).collect();
        assert_eq!(simultaneous(&shared, 16).unwrap()[0].from, 7);
        let spread: Vec<Change> = (0..12).map(|p| change(p, 2 + p % 12)).collect();
        assert_eq!(simultaneous(&spread, 16), None);
        assert_eq!(simultaneous(&shared[..2], 16), None);
        let both_signs: Vec<Change> = (0..12)
            .map(|p| Change { by_dn: if p % 2 == 0 { 30.0 } else { -30.0 }, ..change(p, 7) })
            .collect();
        assert_eq!(simultaneous(&both_signs, 16), None);
    }
}
