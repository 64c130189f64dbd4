//! Profiles of a frame along rows or columns, their comparison with those of another frame, and
//! relative illumination over the radius.

use camrig_base::median::median;
use camrig_base::{Cfa, Error, Plane, Result};
use camrig_linear::dot;
use serde::Serialize;

/// Rings of the relative illumination: the width of one is a twentieth of the half diagonal.
pub const RINGS: usize = 20;

/// Direction of a profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Along {
    /// Along rows, one value per column.
    Row,
    /// Along columns, one value per row.
    Column,
}

/// One channel's samples along a line.
#[derive(Clone, Debug, Serialize)]
pub struct Profile {
    /// Column (row) and mean above black, DN, wherever the channel has samples in the lines.
    pub points: Vec<[f64; 2]>,
}

/// Mean above `black` (DN) of a channel over `count` rows (columns) from `first` on.
///
/// # Errors
/// Lines outside the frame, or without a sample of the channel.
pub fn along<T: Copy + Into<f64>>(
    frame: &Plane<T>,
    cfa: &Cfa,
    channel: char,
    black: f64,
    direction: Along,
    first: usize,
    count: usize,
) -> Result<Profile> {
    let (length, lines) = match direction {
        Along::Row => (frame.width, frame.height),
        Along::Column => (frame.height, frame.width),
    };
    if count == 0 || first.saturating_add(count) > lines {
        return Err(Error::input(format!(
            "lines {first} to {} of a frame with {lines}",
            first.saturating_add(count.max(1) - 1)
        ))
        .help(format!("lines run from 0 to {}", lines - 1)));
    }
    let mut points = Vec::with_capacity(length);
    for p in 0..length {
        let (mut sum, mut n) = (0.0, 0u32);
        for line in first..first + count {
            let (x, y) = if direction == Along::Row { (p, line) } else { (line, p) };
            if cfa.letter(x, y) == channel {
                sum += frame.at(x, y).into() - black;
                n += 1;
            }
        }
        if n > 0 {
            points.push([p as f64, sum / f64::from(n)]);
        }
    }
    if points.is_empty() {
        return Err(Error::input(format!("no sample of channel {channel} in these lines"))
            .help("take two lines of a Bayer pattern, or another first line"));
    }
    Ok(Profile { points })
}

/// Whether a channel has samples in `count` lines from `first` on.
pub fn passes(cfa: &Cfa, channel: char, direction: Along, first: usize, count: usize) -> bool {
    let period = if direction == Along::Row { cfa.width } else { cfa.height };
    // Two periods of the pattern contain every channel that more lines contain.
    let lines = first..first.saturating_add(count.min(2 * cfa.width.max(cfa.height)));
    let mut places = lines.flat_map(|line| (0..period).map(move |p| (p, line)));
    places.any(|(p, line)| match direction {
        Along::Row => cfa.letter(p, line) == channel,
        Along::Column => cfa.letter(line, p) == channel,
    })
}

/// Comparison of a profile with a reference at the same pixels.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Difference {
    /// Mean of the profile over mean of the reference.
    pub ratio_of_means: f64,
    /// Root mean square of profile minus reference, DN.
    pub rms_dn: f64,
    /// Root mean square of profile minus reference, with the reference scaled to the profile's
    /// mean, DN: differences other than brightness.
    pub rms_scaled_dn: f64,
    /// Pearson correlation coefficient.
    pub correlation: f64,
}

/// Compares two profiles.
///
/// # Errors
/// Profiles of different places, or a reference without signal.
pub fn difference(profile: &Profile, reference: &Profile) -> Result<Difference> {
    let same = profile.points.len() == reference.points.len()
        && profile.points.iter().zip(&reference.points).all(|(a, b)| a[0] == b[0]);
    if !same {
        return Err(Error::disagreement("the two frames differ in size or filter pattern")
            .help("compare frames of one format"));
    }
    let values = |p: &Profile| -> Vec<f64> { p.points.iter().map(|v| v[1]).collect() };
    let (a, b) = (values(profile), values(reference));
    let n = a.len() as f64;
    let (ma, mb) = (a.iter().sum::<f64>() / n, b.iter().sum::<f64>() / n);
    if mb == 0.0 {
        return Err(Error::input("the reference has no signal above black"));
    }
    let rms = |scale: f64| {
        let square: f64 = a.iter().zip(&b).map(|(a, b)| (a - scale * b).powi(2)).sum();
        (square / n).sqrt()
    };
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (a, b) in a.iter().zip(&b) {
        ab += (a - ma) * (b - mb);
        aa += (a - ma).powi(2);
        bb += (b - mb).powi(2);
    }
    let scale = (aa * bb).sqrt();
    Ok(Difference {
        ratio_of_means: ma / mb,
        rms_dn: rms(1.0),
        rms_scaled_dn: rms(ma / mb),
        correlation: if scale > 0.0 { ab / scale } else { 0.0 },
    })
}

/// Samples to either side of an edge that are correlated: the width of a blurred edge.
const WINDOW: usize = 10;
/// Largest displacement that is searched for, samples.
const FARTHEST: usize = 10;
/// Step of an edge over the median step of the profile, which is that of its noise. Noise exceeds
/// eight times its median once in 10⁷ samples.
const CLEAR_STEP: f64 = 8.0;
/// Smallest correlation coefficient of a matched edge: noise of the same window stays below.
const MATCHED: f64 = 0.9;

/// Displacements of the edges of a profile from those of a reference: (position, displacement),
/// both in pixels, for every edge of the reference that exceeds its noise and is found in the
/// profile.
///
/// The displacement is the position of the largest correlation of the windows, by a parabola
/// through its peak.
pub fn displacements(profile: &Profile, reference: &Profile) -> Vec<[f64; 2]> {
    let (a, b) = (&profile.points, &reference.points);
    let n = a.len().min(b.len());
    if n < 2 * (WINDOW + FARTHEST) + 1 {
        return Vec::new();
    }
    let step = (b[n - 1][0] - b[0][0]) / (n - 1) as f64;
    // Difference of the means of three samples on either side.
    let jump =
        |i: usize| -> f64 { (1..=3).map(|k| b[i + k][1] - b[i - k][1]).sum::<f64>().abs() / 3.0 };
    let range = WINDOW + FARTHEST..n - WINDOW - FARTHEST;
    let mut jumps: Vec<f64> = range.clone().map(jump).collect();
    // Most of a profile has no edge, so the median jump is that of the noise.
    let clear = CLEAR_STEP * median(&mut jumps, f64::total_cmp);
    let is_edge = |&i: &usize| {
        let around = i.saturating_sub(WINDOW).max(3)..(i + WINDOW).min(n - 3);
        jump(i) > clear && around.into_iter().all(|k| k == i || jump(k) < jump(i))
    };
    let correlation = |at: usize, shift: isize| {
        let window = |points: &[[f64; 2]], middle: usize| -> Vec<f64> {
            let part: Vec<f64> =
                points[middle - WINDOW..=middle + WINDOW].iter().map(|p| p[1]).collect();
            let mean = part.iter().sum::<f64>() / part.len() as f64;
            part.iter().map(|v| v - mean).collect()
        };
        let (p, q) = (window(a, at.saturating_add_signed(shift)), window(b, at));
        dot(&p, &q) / (dot(&p, &p) * dot(&q, &q)).sqrt()
    };
    let found = range.filter(is_edge).filter_map(|i| {
        let reach = FARTHEST as isize;
        let values: Vec<f64> = (-reach..=reach).map(|s| correlation(i, s)).collect();
        let best = (1..values.len() - 1).max_by(|&p, &q| values[p].total_cmp(&values[q]))?;
        let [left, peak, right] = [values[best - 1], values[best], values[best + 1]];
        let vertex = 0.5 * (left - right) / (left - 2.0 * peak + right);
        let shift = best as f64 - reach as f64 + vertex;
        (peak > MATCHED && vertex.abs() <= 1.0).then_some([b[i][0], shift * step])
    });
    found.collect()
}

/// The ring of equal width around the frame's centre that a pixel is in, and its radius over the
/// half diagonal.
fn ring(frame: &Plane<u16>, x: usize, y: usize, rings: usize) -> (usize, f64) {
    let (cx, cy) = (0.5 * (frame.width as f64 - 1.0), 0.5 * (frame.height as f64 - 1.0));
    let radius = libm::hypot(x as f64 - cx, y as f64 - cy) / libm::hypot(cx, cy).max(1.0);
    (((radius * rings as f64) as usize).min(rings.max(1) - 1), radius)
}

/// Relative illumination: a channel's mean over rings of equal width around the frame's centre,
/// relative to the innermost ring, as (radius over the half diagonal, ratio, standard error).
///
/// # Errors
/// No signal at the centre.
pub fn relative_illumination(
    frame: &Plane<u16>,
    cfa: &Cfa,
    channel: char,
    black: f64,
    rings: usize,
) -> Result<Vec<[f64; 3]>> {
    let mut sums = vec![(0.0f64, 0.0f64, 0.0f64, 0u64); rings.max(1)];
    for y in 0..frame.height {
        for x in 0..frame.width {
            if cfa.letter(x, y) == channel {
                let (ring, radius) = ring(frame, x, y, rings);
                let v = f64::from(frame.at(x, y)) - black;
                let s = &mut sums[ring];
                *s = (s.0 + v, s.1 + v * v, s.2 + radius, s.3 + 1);
            }
        }
    }
    let (sum, _, _, n) = sums[0];
    let centre = sum / n.max(1) as f64;
    if n == 0 || centre <= 0.0 {
        return Err(Error::input(format!("no signal of channel {channel} at the centre"))
            .help("check the black level and the channel"));
    }
    Ok(sums
        .iter()
        .filter(|s| s.3 > 1)
        .map(|&(sum, square, radius, n)| {
            let n = n as f64;
            let mean = sum / n;
            let sd = ((square / n - mean * mean).max(0.0) / n).sqrt();
            [radius / n, mean / centre, sd / centre]
        })
        .collect())
}

/// A note on a channel's samples that may be clipped: all at the white level and at
/// 0 DN; where the white level is not known, a ring around the frame's centre half of whose samples
/// or more have the largest value. Of symmetric noise, half lies above its mean, and a level at
/// which a ring is cut off there or below has at least as many samples.
#[must_use]
pub fn clipped(
    frame: &Plane<u16>,
    cfa: &Cfa,
    channel: char,
    white: Option<u16>,
    rings: usize,
) -> Option<String> {
    let places = (0..frame.height).flat_map(|y| (0..frame.width).map(move |x| (x, y)));
    let own = || places.clone().filter(|&(x, y)| cfa.letter(x, y) == channel);
    let largest = own().map(|(x, y)| frame.at(x, y)).max()?;
    let top = white.unwrap_or(largest);
    // Samples of each ring, and those of them at the top.
    let mut counts = vec![(0usize, 0usize); rings.max(1)];
    let mut zeros = 0;
    for (x, y) in own() {
        let ring = &mut counts[ring(frame, x, y, rings).0];
        *ring = (ring.0 + 1, ring.1 + usize::from(frame.at(x, y) >= top));
        zeros += usize::from(frame.at(x, y) == 0);
    }
    let all: usize = counts.iter().map(|c| c.0).sum();
    let at_top: usize = counts.iter().map(|c| c.1).sum();
    let mut words = Vec::new();
    if white.is_some() && at_top > 0 {
        words.push(format!("{at_top} at the white level, {top} DN, or above"));
    }
    if white.is_none() && counts.iter().any(|c| c.0 > 0 && 2 * c.1 >= c.0) {
        words.push(format!(
            "{at_top} at the largest value, {top} DN, which may be the white level"
        ));
    }
    if zeros > 0 {
        words.push(format!("{zeros} at 0 DN"));
    }
    let words = words.join(", ");
    (!words.is_empty()).then(|| {
        format!(
            "of {all} samples of channel {channel}, {words}: where they are clipped, the profile \
             and the relative illumination are wrong"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn profile_and_rings_of_a_known_frame() {
        let cfa = Cfa::parse("RGGB").unwrap();
        let frame = Plane::from_fn(40, 30, |x, _| 10 + x as u16);
        let p = along(&frame, &cfa, 'G', 10.0, Along::Row, 4, 2).unwrap();
        assert_eq!(p.points.len(), 40);
        assert!(p.points.iter().all(|v| v[0] == v[1]));
        let doubled = Plane::from_fn(40, 30, |x, _| 10 + 2 * x as u16);
        let q = along(&doubled, &cfa, 'G', 10.0, Along::Row, 4, 2).unwrap();
        let d = difference(&q, &p).unwrap();
        assert!((d.ratio_of_means - 2.0).abs() < 1e-12);
        assert!(d.rms_scaled_dn < 1e-9 && (d.correlation - 1.0).abs() < 1e-12);
        assert!(along(&frame, &cfa, 'G', 0.0, Along::Row, 29, 2).is_err());

        // Stripes of 60 pixels with soft edges, stretched by 0.5 % about the middle.
        let stripes = |stretch: f64| {
            let points = (0..600).map(|x| {
                let x = f64::from(x);
                let u = (x - 300.0) / stretch + 300.0;
                [x, 100.0 + 50.0 * (8.0 * (u * std::f64::consts::PI / 60.0).sin()).tanh()]
            });
            Profile { points: points.collect() }
        };
        let shifts = displacements(&stripes(1.005), &stripes(1.0));
        assert!(shifts.len() >= 7, "{shifts:?}");
        for [x, shift] in shifts {
            assert!((shift - 0.005 * (x - 300.0)).abs() < 0.05, "{x} {shift}");
        }

        let flat = Plane::filled(40, 30, 110u16);
        let rings = relative_illumination(&flat, &cfa, 'R', 10.0, 8).unwrap();
        assert!(rings.iter().all(|r| (r[1] - 1.0).abs() < 1e-12));
    }

    /// Light that falls off to the corners, the middle of it cut off at 1023 DN.
    #[test]
    fn clipped_samples_are_told() {
        let mono = Cfa::parse("mono").unwrap();
        let light = |x: usize, y: usize| {
            let r2 = (x as f64 - 31.5).powi(2) + (y as f64 - 23.5).powi(2);
            64.0 + 1500.0 * (1.0 - 0.6 * r2 / 1544.5)
        };
        let whole = Plane::from_fn(64, 48, |x, y| light(x, y) as u16);
        let cut = Plane::from_fn(64, 48, |x, y| (light(x, y) as u16).min(1023));
        let count = cut.data.iter().filter(|v| **v == 1023).count();
        for white in [None, Some(1023)] {
            let told = clipped(&cut, &mono, 'M', white, 20).unwrap();
            assert!(told.contains(&format!("of 3072 samples of channel M, {count} at")), "{told}");
        }
        assert_eq!(clipped(&whole, &mono, 'M', Some(4095), 20), None);
        let dark = Plane::from_fn(64, 48, |x, y| (light(x, y) as u16).saturating_sub(1000));
        assert!(clipped(&dark, &mono, 'M', Some(4095), 20).unwrap().contains("at 0 DN"));
    }
}
