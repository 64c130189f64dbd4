//! The positions of the dots of a grid, their size, and the level between them, by centroids.

use super::measured::MeasuredFigure;
use super::picture::{Picture, densest_channel};
use crate::statistic::Figure;
use camrig_base::median::{SD_PER_MAD, median};
use camrig_base::{Cfa, Plane};
use camrig_camera::Camera;
use camrig_scene::chart::dots::Dots;
use std::collections::BTreeMap;

/// Rings of equal width from the centre to the corner.
pub const RINGS: usize = 5;
/// Share of the frame at its border without dots, so that a distortion of that size neither removes
/// dots nor adds any. Chosen: a wider border would lose the corners, where a lens shows most.
const BORDER: f64 = 0.06;
/// Radius, pitches, within which the light of a dot is summed; beyond is background. Chosen: a
/// blurred dot must fit in, and half a pitch would leave only the corners of the window as
/// background.
const REACH: f64 = 0.42;
/// Robust standard deviations from the median beyond which a dot does not count in the mean of its
/// ring: its window contains a defective pixel.
const OUTLIER: f64 = 5.0;
/// Radius of the smallest dots that are measured, periods of the colour filter pattern: smaller
/// ones have too few pixels of a channel for a centroid.
const MIN_RADIUS: f64 = 0.75;
/// Smallest ratio of the summed light of a dot to the noise of its window.
const MIN_SNR: f64 = 5.0;
/// Distance, pitches, from the expected position beyond which a dot is a neighbour.
const NEIGHBOUR: f64 = 0.4;
/// Number of times that the window is centred on the dot again.
const REFINEMENTS: usize = 3;
/// Samples from which a dot and its background are measured.
const MIN_SAMPLES: usize = 4;
/// Dots from which a ring has a mean.
const MIN_DOTS: usize = 3;

/// An estimate with its variance.
#[derive(Clone, Copy, Debug)]
struct Estimate {
    value: f64,
    variance: f64,
}

/// A dot in one channel.
#[derive(Clone, Copy, Debug)]
struct Dot {
    /// Centroid, pixels.
    at: [f64; 2],
    /// Variance of the centroid each way, pixels².
    variance: f64,
    /// RMS distance of its light from the centroid, pixels.
    radius: Estimate,
    /// Level around it, DN.
    background: Estimate,
}

/// The figures of a grid of dots.
pub fn figures(camera: &Camera, dots: &Dots, picture: &Picture) -> Vec<MeasuredFigure> {
    let cfa = &camera.sensor.cfa;
    let frame = &picture.mean;
    let pitch = dots.pitch * frame.width as f64;
    if dots.diameter * frame.width as f64 * 0.5 < MIN_RADIUS * cfa.width as f64 {
        return Vec::new();
    }
    let reference = densest_channel(camera);
    let channels = cfa.channels();
    let grid = Grid::new(frame, pitch);
    let own = grid.track(frame, cfa, channels[reference]);
    let mut out = rings(&grid, &own, camera.sensor.black_level_dn, reference);
    out.extend(skews(&grid, &own));
    for channel in (0..channels.len()).filter(|c| *c != reference) {
        let other = grid.around(frame, cfa, channels[channel], &own);
        out.extend(lateral_colour(&grid, &own, &other, camera.sensor.black_level_dn, channel));
    }
    out
}

/// Dots by their column and row from the centre.
type ByIndex = BTreeMap<(i32, i32), Dot>;

/// The ideal grid.
struct Grid {
    pitch: f64,
    centre: [f64; 2],
    /// Dots by column and row from the centre, those next to the centre first.
    indices: Vec<(i32, i32)>,
}

impl Grid {
    fn new(frame: &Plane<f32>, pitch: f64) -> Self {
        let (w, h) = (frame.width as f64, frame.height as f64);
        let reach = |side: f64| (((0.5 - BORDER) * side - 0.5 * pitch) / pitch).floor() as i32;
        let (columns, rows) = (reach(w), reach(h));
        let mut indices: Vec<(i32, i32)> = (-rows..=rows)
            .flat_map(|row| (-columns..=columns).map(move |column| (column, row)))
            .collect();
        indices.sort_by_key(|(c, r)| (c * c + r * r, *r, *c));
        Self { pitch, centre: [0.5 * (w - 1.0), 0.5 * (h - 1.0)], indices }
    }

    fn ideal(&self, (column, row): (i32, i32)) -> [f64; 2] {
        let [x, y] = self.centre;
        [x + f64::from(column) * self.pitch, y + f64::from(row) * self.pitch]
    }

    /// Distance from the centre, 1 in the frame's corner.
    fn field(&self, (column, row): (i32, i32)) -> f64 {
        let [x, y] = self.centre;
        (f64::from(column * column + row * row)).sqrt() * self.pitch
            / libm::hypot(x + 0.5, y + 0.5)
    }

    fn ring(&self, index: (i32, i32)) -> usize {
        ((self.field(index) * RINGS as f64) as usize).min(RINGS - 1)
    }

    /// Finds dots from the centre outwards, each at the position extrapolated from its neighbour
    /// towards the centre.
    fn track(&self, frame: &Plane<f32>, cfa: &Cfa, letter: char) -> ByIndex {
        let mut found: ByIndex = BTreeMap::new();
        for &index in &self.indices {
            let (column, row) = index;
            let step = |v: i32, u: i32| if v.abs() >= u.abs() { v - v.signum() } else { v };
            let inner = (step(column, row), step(row, column));
            let ideal = self.ideal(index);
            let shift = found.get(&inner).map_or([0.0; 2], |d| {
                let at = self.ideal(inner);
                // Displacement increases at least in proportion to the field height.
                let grown = self.field(index) / self.field(inner).max(1e-9);
                let grown = if inner == (0, 0) { 1.0 } else { grown };
                [0, 1].map(|k| (d.at[k] - at[k]) * grown)
            });
            let expected = [ideal[0] + shift[0], ideal[1] + shift[1]];
            if let Some(dot) = self.locate(frame, cfa, letter, expected) {
                found.insert(index, dot);
            }
        }
        found
    }

    /// Finds the dots of another channel near those found.
    fn around(&self, frame: &Plane<f32>, cfa: &Cfa, letter: char, found: &ByIndex) -> ByIndex {
        let near = |dot: &Dot| self.locate(frame, cfa, letter, dot.at);
        found.iter().filter_map(|(index, dot)| Some((*index, near(dot)?))).collect()
    }

    /// The centroid of the dot near a position, in a window that is centred on it.
    fn locate(&self, frame: &Plane<f32>, cfa: &Cfa, letter: char, near: [f64; 2]) -> Option<Dot> {
        let mut dot = self.centroid(frame, cfa, letter, near)?;
        for _ in 0..REFINEMENTS {
            dot = self.centroid(frame, cfa, letter, dot.at)?;
        }
        (0..2).all(|k| (dot.at[k] - near[k]).abs() < NEIGHBOUR * self.pitch).then_some(dot)
    }

    fn centroid(&self, frame: &Plane<f32>, cfa: &Cfa, letter: char, at: [f64; 2]) -> Option<Dot> {
        let half = 0.5 * self.pitch;
        let inside = |v: f64, side: usize| v - half >= 0.0 && v + half <= side as f64 - 1.0;
        if !inside(at[0], frame.width) || !inside(at[1], frame.height) {
            return None;
        }
        let span = |v: f64| (v - half).ceil() as usize..=(v + half).floor() as usize;
        let samples: Vec<[f64; 3]> = span(at[1])
            .flat_map(|y| span(at[0]).map(move |x| (x, y)))
            .filter(|&(x, y)| cfa.letter(x, y) == letter)
            .map(|(x, y)| [x as f64 - at[0], y as f64 - at[1], f64::from(frame.at(x, y))])
            .collect();
        let reach = REACH * self.pitch;
        let (near, far): (Vec<[f64; 3]>, Vec<[f64; 3]>) =
            samples.iter().copied().partition(|s| libm::hypot(s[0], s[1]) <= reach);
        let n = far.len() as f64;
        if far.len() < MIN_SAMPLES || near.len() < MIN_SAMPLES {
            return None;
        }
        let background = far.iter().map(|s| s[2]).sum::<f64>() / n;
        let noise = far.iter().map(|s| (s[2] - background).powi(2)).sum::<f64>() / (n - 1.0);
        let sum = |of: &dyn Fn(&[f64; 3]) -> f64| {
            near.iter().map(|s| (background - s[2]) * of(s)).sum::<f64>()
        };
        let mass = sum(&|_| 1.0);
        let spread = near.iter().map(|s| s[0] * s[0] + s[1] * s[1]).sum::<f64>();
        if mass.abs() < MIN_SNR * (noise * near.len() as f64).sqrt() {
            return None;
        }
        let offset = [sum(&|s| s[0]) / mass, sum(&|s| s[1]) / mass];
        let distance = |s: &[f64; 3]| (s[0] - offset[0]).powi(2) + (s[1] - offset[1]).powi(2);
        let square = (sum(&distance) / mass).max(1e-6);
        let scatter = near.iter().map(|s| (distance(s) - square).powi(2)).sum::<f64>();
        Some(Dot {
            at: [at[0] + offset[0], at[1] + offset[1]],
            variance: 0.5 * noise * spread / (mass * mass),
            // Var √q = Var q / 4q.
            radius: Estimate {
                value: square.sqrt(),
                variance: noise * scatter / (mass * mass) / (4.0 * square),
            },
            background: Estimate { value: background, variance: noise / n },
        })
    }
}

/// Mean of estimates without outliers, and its standard deviation.
fn mean(values: &[Estimate]) -> Option<(f64, f64)> {
    if values.len() < MIN_DOTS {
        return None;
    }
    let median = |of: &dyn Fn(&Estimate) -> f64| {
        median(&mut values.iter().map(of).collect::<Vec<_>>(), f64::total_cmp)
    };
    let middle = median(&|v| v.value);
    let mad = median(&|v| (v.value - middle).abs());
    let noise = median(&|v| v.variance).sqrt();
    let limit = OUTLIER * (SD_PER_MAD * mad).max(noise);
    let kept: Vec<Estimate> =
        values.iter().copied().filter(|v| (v.value - middle).abs() <= limit).collect();
    let n = kept.len() as f64;
    let sum = kept.iter().map(|v| v.value).sum::<f64>();
    Some((sum / n, kept.iter().map(|v| v.variance).sum::<f64>().sqrt() / n))
}

/// An estimate from a dot.
type OfDot<'a> = dyn Fn((i32, i32), &Dot) -> Estimate + 'a;

/// The figures of each ring in the reference channel.
fn rings(grid: &Grid, found: &ByIndex, black: f64, channel: usize) -> Vec<MeasuredFigure> {
    let mut out = Vec::new();
    for ring in 0..RINGS {
        let of = |value: &OfDot<'_>| -> Option<(f64, f64)> {
            let inside = found.iter().filter(|(i, _)| **i != (0, 0) && grid.ring(**i) == ring);
            mean(&inside.map(|(i, d)| value(*i, d)).collect::<Vec<_>>())
        };
        let shift = |i: (i32, i32), d: &Dot| {
            let at = grid.ideal(i);
            [d.at[0] - at[0], d.at[1] - at[1]]
        };
        let r = ring as u8;
        let of_position = |value, d: &Dot| Estimate { value, variance: d.variance };
        let figures = [
            (Figure::Radial(r), of(&|i, d| of_position(radial(i, shift(i, d)), d))),
            (Figure::Horizontal(r), of(&|i, d| of_position(shift(i, d)[0], d))),
            (Figure::Vertical(r), of(&|i, d| of_position(shift(i, d)[1], d))),
            (Figure::DotRadius(r), of(&|_, d| d.radius)),
            (
                Figure::Background { channel: channel as u8, ring: r },
                of(&|_, d| above(d.background, black)),
            ),
        ];
        for (figure, value) in figures {
            out.extend(value.map(|(v, sd)| MeasuredFigure::linear(figure, v, sd)));
        }
    }
    out
}

/// How far rows move to the right from row to row, and columns downwards from column to column, by
/// the dots in the outer halves, where distortion is the same on both sides.
fn skews(grid: &Grid, found: &ByIndex) -> Vec<MeasuredFigure> {
    let of = |figure, across: usize, along: fn((i32, i32)) -> i32| {
        let most = grid.indices.iter().map(|i| along(*i)).max()?;
        let outer = found.iter().filter(|(i, _)| 2 * along(**i).abs() > most);
        let per_line = outer.map(|(i, dot)| {
            let lines = f64::from(along(*i)) * grid.pitch;
            let value = (dot.at[across] - grid.ideal(*i)[across]) / lines;
            Estimate { value, variance: dot.variance / (lines * lines) }
        });
        let (value, sd) = mean(&per_line.collect::<Vec<_>>())?;
        Some(MeasuredFigure::linear(figure, value, sd))
    };
    let rows = of(Figure::SkewOfRows, 0, |(_, row)| row);
    rows.into_iter().chain(of(Figure::SkewOfColumns, 1, |(column, _)| column)).collect()
}

/// A level above black.
fn above(level: Estimate, black: f64) -> Estimate {
    Estimate { value: level.value - black, ..level }
}

/// The component of a displacement away from the centre.
fn radial((column, row): (i32, i32), shift: [f64; 2]) -> f64 {
    let (x, y) = (f64::from(column), f64::from(row));
    (x * shift[0] + y * shift[1]) / libm::hypot(x, y)
}

/// The figures of each ring in another channel.
fn lateral_colour(
    grid: &Grid,
    own: &ByIndex,
    other: &ByIndex,
    black: f64,
    channel: usize,
) -> Vec<MeasuredFigure> {
    let (mut shifts, mut backgrounds) = (vec![Vec::new(); RINGS], vec![Vec::new(); RINGS]);
    for (index, dot) in other.iter().filter(|(i, _)| **i != (0, 0)) {
        let Some(first) = own.get(index) else { continue };
        let shift = [dot.at[0] - first.at[0], dot.at[1] - first.at[1]];
        let ring = grid.ring(*index);
        let (value, variance) = (radial(*index, shift), dot.variance + first.variance);
        shifts[ring].push(Estimate { value, variance });
        backgrounds[ring].push(above(dot.background, black));
    }
    let mut out = Vec::new();
    for (ring, (shifts, backgrounds)) in shifts.iter().zip(&backgrounds).enumerate() {
        let (channel, ring) = (channel as u8, ring as u8);
        for (figure, values) in [
            (Figure::LateralColour { channel, ring }, shifts),
            (Figure::Background { channel, ring }, backgrounds),
        ] {
            out.extend(mean(values).map(|(v, sd)| MeasuredFigure::linear(figure, v, sd)));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Soft discs on a pitch of 12 pixels, moved outwards by `k1` of the height at the corner, and
    /// right by 0.3 pixels.
    fn grid_of_discs(k1: f64) -> Plane<f32> {
        let (w, h) = (240usize, 180usize);
        let (cx, cy) = (0.5 * (w as f64 - 1.0), 0.5 * (h as f64 - 1.0));
        let corner = (cx + 0.5).hypot(cy + 0.5);
        let mut frame = Plane { width: w, height: h, data: vec![800.0; w * h] };
        for row in -8i32..=8 {
            for column in -11i32..=11 {
                let (x, y) = (12.0 * f64::from(column), 12.0 * f64::from(row));
                let grown = 1.0 + k1 * (x.hypot(y) / corner).powi(2);
                let (x, y) = (cx + x * grown + 0.3, cy + y * grown);
                for py in (y - 7.0).max(0.0) as usize..((y + 8.0) as usize).min(h) {
                    for px in (x - 7.0).max(0.0) as usize..((x + 8.0) as usize).min(w) {
                        let r = (px as f64 - x).hypot(py as f64 - y);
                        // A radius of 3 with a soft rim of about a pixel.
                        frame.data[py * w + px] -= 700.0 / (1.0 + (4.0 * (r - 3.0)).exp()) as f32;
                    }
                }
            }
        }
        frame
    }

    /// Rows that a rolling shutter moves by 0.05 pixels each, of distorted dots 0.3 pixels off.
    #[test]
    fn the_skew_of_rows_is_told_from_shift_and_distortion() {
        let frame = grid_of_discs(0.03);
        let (w, h) = (frame.width, frame.height);
        let skewed = Plane::from_fn(w, h, |x, y| {
            let from = x as f64 - 0.05 * (y as f64 - 0.5 * (h as f64 - 1.0));
            let left = (from.floor().max(0.0) as usize).min(w - 2);
            let share = (from - left as f64).clamp(0.0, 1.0) as f32;
            frame.at(left, y) * (1.0 - share) + frame.at(left + 1, y) * share
        });
        for (frame, right) in [(&frame, 0.0), (&skewed, 0.05)] {
            let grid = Grid::new(frame, 12.0);
            let found = grid.track(frame, &Cfa::parse("mono").unwrap(), 'M');
            let [rows, columns] = &skews(&grid, &found)[..] else { panic!() };
            // A hundredth of a pixel for each dot, over some 50 rows.
            assert!((rows.value - right).abs() < 1e-3, "{}", rows.value);
            assert!(columns.value.abs() < 1e-3, "{}", columns.value);
        }
    }

    #[test]
    fn distorted_dots_are_followed_and_measured() {
        // 8 % at the corner: the outer dots are nearly a pitch from their position in an ideal
        // grid.
        for k1 in [0.0, -0.03, 0.08] {
            let frame = grid_of_discs(k1);
            let grid = Grid::new(&frame, 12.0);
            let found = grid.track(&frame, &Cfa::parse("mono").unwrap(), 'M');
            assert!(found.len() as f64 > 0.8 * grid.indices.len() as f64, "{k1}: {}", found.len());
            for MeasuredFigure { figure, value, .. } in rings(&grid, &found, 0.0, 0) {
                match figure {
                    Figure::Radial(r) => {
                        let inside = found
                            .keys()
                            .filter(|i| **i != (0, 0) && grid.ring(**i) == usize::from(r));
                        let (mut expected, mut n) = (0.0, 0.0);
                        for &i in inside {
                            let height = f64::from(i.0 * i.0 + i.1 * i.1).sqrt() * 12.0;
                            expected += height * k1 * grid.field(i).powi(2);
                            n += 1.0;
                        }
                        // Sampling shifts the centroid of a soft disc by a hundredth of a pixel.
                        assert!(
                            (value - expected / n).abs() < 0.02,
                            "{k1} ring {r}: {value} {}",
                            expected / n
                        );
                    }
                    Figure::Horizontal(_) => assert!((value - 0.3).abs() < 0.05, "{k1}: {value}"),
                    Figure::Background { .. } => assert!((value - 800.0).abs() < 8.0, "{value}"),
                    _ => {}
                }
            }
        }
    }
}
