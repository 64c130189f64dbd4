//! Areas of pixels that stand out together: rows, parts of rows and columns, clusters.
//!
//! Pixels that stand out one by one meet by chance: of a share p of all N pixels, at most
//! N (λ p)ⁿ groups of n that touch along their sides, λ = 4.06 the growth of such shapes with n
//! (Jensen 2003). Larger groups than chance makes, that fill a rectangle and end at its edges, are
//! areas: a glow or a shading falls off.

use super::robust::{mad_sd, mean, median};
use camrig_base::Value;
use std::collections::BTreeMap;

/// A rectangle of pixels.
#[derive(Clone, Debug)]
pub struct Area {
    /// First column.
    pub left: usize,
    /// First row.
    pub top: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Mean of what stands out.
    pub value: Value,
}

/// Expected number of areas where there are none.
const FALSE_AREAS: f64 = 1e-4;
/// Growth of the number of connected shapes with their pixels.
const SHAPES: f64 = 4.0626;
/// Fewest pixels of an area.
const MIN_PIXELS: f64 = 4.0;
/// Part of its rectangle that an area fills.
const MIN_FILLED: f64 = 0.8;
/// Part of what stands out along the inside of an area's edges that may be left just outside.
const MAX_OUTSIDE: f64 = 0.5;
/// Lines on each side of a line that it is compared with.
const NEAR: usize = 3;

impl Area {
    fn has(&self, place: usize, columns: usize) -> bool {
        let (x, y) = (place % columns, place / columns);
        (self.left..self.left + self.width).contains(&x)
            && (self.top..self.top + self.height).contains(&y)
    }

    /// Whether little of what stands out is left in the pixels around it.
    fn ends_at_its_edges(&self, map: &[f64], columns: usize) -> bool {
        let rows = map.len() / columns;
        let (right, bottom) = (self.left + self.width, self.top + self.height);
        let across = self.left.saturating_sub(1)..(right + 1).min(columns);
        let down = self.top.saturating_sub(1)..(bottom + 1).min(rows);
        let ring = down.flat_map(|y| across.clone().map(move |x| y * columns + x));
        let outside: Vec<f64> = ring.filter(|p| !self.has(*p, columns)).map(|p| map[p]).collect();
        let is_edge = |p: &usize| {
            let (x, y) = (p % columns, p / columns);
            x == self.left || x + 1 == right || y == self.top || y + 1 == bottom
        };
        let inside: Vec<f64> = self.places(columns).filter(is_edge).map(|p| map[p]).collect();
        if outside.is_empty() {
            return false;
        }
        let level = median(map.to_vec());
        let [outside, inside] = [outside, inside].map(|values| median(values) - level);
        outside / inside < MAX_OUTSIDE
    }

    /// The places of its pixels in a row-major map of so many columns.
    pub(crate) fn places(&self, columns: usize) -> impl Iterator<Item = usize> + use<> {
        let (left, right) = (self.left, self.left + self.width);
        (self.top..self.top + self.height)
            .flat_map(move |y| (left..right).map(move |x| y * columns + x))
    }
}

/// The areas of the pixels of a map that stand out.
pub(crate) fn find(map: &[f64], columns: usize, stands_out: impl Fn(f64) -> bool) -> Vec<Area> {
    let mut out: Vec<bool> = map.iter().map(|v| stands_out(*v)).collect();
    let count = out.iter().filter(|o| **o).count() as f64;
    let growth = libm::log(SHAPES * count / map.len() as f64);
    let least = libm::log(FALSE_AREAS / map.len() as f64) / growth;
    if count < MIN_PIXELS || growth >= 0.0 {
        return Vec::new();
    }
    let mut areas = Vec::new();
    for first in 0..out.len() {
        let group = taken(&mut out, first, columns);
        let n = group.len() as f64;
        if n < least.max(MIN_PIXELS) {
            continue;
        }
        let ((left, width), (top, height)) =
            (extent(group.iter().map(|p| p % columns)), extent(group.iter().map(|p| p / columns)));
        let mut area = Area { left, top, width, height, value: Value::new(0.0, 0.0) };
        let inside: Vec<f64> =
            group.iter().filter(|p| area.has(**p, columns)).map(|p| map[*p]).collect();
        let filled = inside.len() as f64 >= MIN_FILLED * (width * height) as f64;
        if filled && area.ends_at_its_edges(map, columns) {
            area.value = mean(&inside);
            areas.push(area);
        }
    }
    areas
}

/// The first line and the number of the lines that hold at least half as many pixels as the
/// fullest: single pixels that touch the area are no part of it.
fn extent(lines: impl Iterator<Item = usize>) -> (usize, usize) {
    let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
    lines.for_each(|line| *counts.entry(line).or_default() += 1);
    let most = counts.values().copied().max().unwrap_or(0);
    let full = || counts.iter().filter(|(_, n)| 2 * **n >= most).map(|(line, _)| *line);
    let (first, last) = (full().min().unwrap_or(0), full().max().unwrap_or(0));
    (first, last - first + 1)
}

/// The pixels that touch one that stands out, itself among them; none are left of them.
fn taken(out: &mut [bool], first: usize, columns: usize) -> Vec<usize> {
    let mut group = Vec::new();
    let mut open = vec![first];
    while let Some(p) = open.pop() {
        if !std::mem::take(&mut out[p]) {
            continue;
        }
        group.push(p);
        let x = p % columns;
        open.extend((x > 0).then(|| p - 1));
        open.extend((x + 1 < columns).then_some(p + 1));
        open.extend(p.checked_sub(columns));
        open.extend(Some(p + columns).filter(|q| *q < out.len()));
    }
    group
}

/// The median of the lines around each line. The window of the first and the last ones is that of
/// those further in, carried on by its slope (Theil 1950).
pub(crate) fn running_median(lines: &[f64]) -> Vec<f64> {
    let side = (2 * NEAR + 1).min(lines.len());
    let around = |i: usize| {
        let first = i.saturating_sub(NEAR).min(lines.len() - side);
        let near = &lines[first..first + side];
        let outwards = i as f64 - (first as f64 + 0.5 * (side - 1) as f64);
        let middle = median(near.to_vec());
        if outwards == 0.0 { middle } else { middle + outwards * slope(near) }
    };
    (0..lines.len()).map(around).collect()
}

/// The median of the slopes between any two lines; 0 of a single one.
fn slope(lines: &[f64]) -> f64 {
    let pairs = (0..lines.len()).flat_map(|i| (0..i).map(move |k| (k, i)));
    let slopes: Vec<f64> = pairs.map(|(k, i)| (lines[i] - lines[k]) / (i - k) as f64).collect();
    if slopes.is_empty() { 0.0 } else { median(slopes) }
}

/// Lines whose departure is `sds` robust standard deviations of all, and at least `least`.
pub(crate) fn far(departures: &[f64], sds: f64, least: f64) -> Vec<usize> {
    let limit = (sds * mad_sd(departures)).max(least);
    (0..departures.len()).filter(|i| departures[*i].abs() > limit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Bernoulli, Distribution};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    fn scattered(share: f64, seed: u64) -> Vec<f64> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let law = Bernoulli::new(share).unwrap();
        (0..96 * 96).map(|_| f64::from(u8::from(law.sample(&mut rng)))).collect()
    }

    #[test]
    fn the_median_around_a_line_follows_a_slope_to_the_edges() {
        let mut lines: Vec<f64> = (0..20).map(|i| 5.0 + 0.3 * i as f64).collect();
        let straight = lines.clone();
        (lines[0], lines[10]) = (50.0, 0.0);
        for (found, expected) in running_median(&lines).iter().zip(&straight) {
            assert!((found - expected).abs() < 0.31, "{found} {expected}");
        }
        assert_eq!(running_median(&[2.0]), [2.0]);
    }

    #[test]
    fn pixels_that_meet_by_chance_are_no_area() {
        for (k, share) in [3e-4, 1e-3, 0.01, 0.03, 0.08, 0.2, 0.5].into_iter().enumerate() {
            for seed in 0..50 {
                let map = scattered(share, 100 * k as u64 + seed);
                assert!(find(&map, 96, |v| v > 0.5).is_empty(), "share {share}, seed {seed}");
            }
        }
    }

    #[test]
    fn a_cluster_and_a_part_of_a_row_are_found_among_single_pixels() {
        let mut map = scattered(0.01, 7);
        for (x, y) in (0..16).map(|i| (40 + i % 4, 20 + i / 4)).chain((30..90).map(|x| (x, 70))) {
            map[y * 96 + x] = 3.0;
        }
        let found = find(&map, 96, |v| v > 0.5);
        let places: Vec<[usize; 4]> =
            found.iter().map(|a| [a.left, a.top, a.width, a.height]).collect();
        assert_eq!(places, [[40, 20, 4, 4], [30, 70, 60, 1]]);
        assert!(found[0].places(96).eq((0..16).map(|i| (20 + i / 4) * 96 + 40 + i % 4)));
    }

    #[test]
    fn what_falls_off_is_no_area() {
        let far =
            |x: usize, y: usize| ((x as f64 - 90.0).powi(2) + (y as f64 - 20.0).powi(2)) / 400.0;
        let map: Vec<f64> = (0..96 * 96).map(|p| 10.0 * (-far(p % 96, p / 96)).exp()).collect();
        for limit in [0.5, 2.0, 6.0] {
            assert!(find(&map, 96, |v| v > limit).is_empty(), "{limit}");
        }
    }

    #[test]
    fn a_line_is_compared_with_those_around_it() {
        let mut lines: Vec<f64> = (0..40).map(|i| 1.0 + 0.01 * f64::from(i)).collect();
        lines[12] *= 0.5;
        let around = running_median(&lines);
        let ratios: Vec<f64> = lines.iter().zip(&around).map(|(l, a)| l / a - 1.0).collect();
        assert_eq!(far(&ratios, 8.0, 0.05), [12]);
    }
}
