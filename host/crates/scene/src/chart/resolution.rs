//! A resolution chart with the elements of ISO 12233: slanted squares, hyperbolic wedges, bar
//! groups and a Siemens star. Dark (0.04) on bright (0.8); it fits frames from 4:3 to 16:9.
//!
//! - Siemens star: in the centre, radius 0.1, 36 cycles, so that f = 36 / (2π r) cycles per sensor
//!   width at radius r.
//! - Wedges: from ±0.17 to ±0.37, right and left (lines along u), below and above (lines along v);
//!   5 dark lines whose frequency rises linearly from 50 to 1000 cycles per sensor width.
//! - Bars: a row of groups at the top (across u) and at the bottom (across v); 5 dark bars of 100,
//!   200, 300, 400, 600, 800, 1000 and 1500 cycles per sensor width.
//! - Slanted squares: in the corners, 0.09 wide, turned by 5°, for slanted-edge measurement.

use super::BANDS;
use crate::painting::{Material, Painting};
use crate::shape::{Point, Shape};
use camrig_base::Spectrum;

/// Reflectance of the ground.
const BRIGHT: f64 = 0.8;
/// Reflectance of the elements.
const DARK: f64 = 0.04;
/// Frequencies of the bar groups, cycles per sensor width.
pub const BAR_FREQUENCIES: [f64; 8] = [100.0, 200.0, 300.0, 400.0, 600.0, 800.0, 1000.0, 1500.0];

/// The chart.
pub(super) fn chart() -> Painting {
    let mut painting = Painting::new(BANDS, &Spectrum::constant(BRIGHT));
    let dark = painting.material(&Spectrum::constant(DARK));
    let lay = |painting: &mut Painting, points: Vec<Point>| {
        painting.lay(Shape::Polygon(points), dark, Painting::GROUND);
    };
    for points in star(36, 0.1) {
        lay(&mut painting, points);
    }
    for points in wedge(50.0, 1000.0, 0.17, 0.2) {
        // To the right and left along u; above and below along v, half as long.
        lay(&mut painting, points.clone());
        lay(&mut painting, points.iter().map(|p| [-p[0], p[1]]).collect());
        let turned =
            |sign: f64| points.iter().map(move |p| [p[1], sign * (0.115 + (p[0] - 0.17) * 0.4)]);
        lay(&mut painting, turned(1.0).collect());
        lay(&mut painting, turned(-1.0).collect());
    }
    for (index, frequency) in BAR_FREQUENCIES.iter().enumerate() {
        let centre = (index as f64 - 3.5) * 0.08;
        bars(&mut painting, dark, [centre, -0.24], *frequency, false);
        bars(&mut painting, dark, [centre, 0.24], *frequency, true);
    }
    for centre in [[-0.42, -0.2], [0.42, -0.2], [-0.42, 0.2], [0.42, 0.2]] {
        lay(&mut painting, square(centre, 0.09, 5.0));
    }
    painting
}

fn square(centre: Point, edge: f64, degrees: f64) -> Vec<Point> {
    let (sin, cos) = (libm::sin(degrees.to_radians()), libm::cos(degrees.to_radians()));
    let half = edge / 2.0;
    let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
    corners
        .iter()
        .map(|[x, y]| [centre[0] + x * cos - y * sin, centre[1] + x * sin + y * cos])
        .collect()
}

/// Dark sectors about the origin, each bounded by a chord.
fn star(cycles: usize, radius: f64) -> impl Iterator<Item = Vec<Point>> {
    let corner = move |half_cycle: usize| {
        let angle = std::f64::consts::PI * half_cycle as f64 / cycles as f64;
        [radius * libm::cos(angle), radius * libm::sin(angle)]
    };
    (0..cycles).map(move |i| vec![[0.0, 0.0], corner(2 * i), corner(2 * i + 1)])
}

/// Five dark lines along u from `start`, whose frequency across them rises linearly over `length`.
fn wedge(from: f64, to: f64, start: f64, length: f64) -> impl Iterator<Item = Vec<Point>> {
    // Segments of an edge. A chord leaves the hyperbola by (Δf/f)²/4 of its distance from the
    // axis: 2 % at 50 cycles per sensor width, 0.006 % at 1000.
    const STATIONS: usize = 64;
    let edge = move |half_periods: f64, station: usize| {
        let t = station as f64 / STATIONS as f64;
        [start + t * length, half_periods / 2.0 / (from + t * (to - from))]
    };
    (0..5).map(move |line| {
        let first = 2.0 * f64::from(line) - 4.5;
        let there = (0..=STATIONS).map(|s| edge(first, s));
        let back = (0..=STATIONS).rev().map(|s| edge(first + 1.0, s));
        there.chain(back).collect()
    })
}

fn bars(painting: &mut Painting, dark: Material, centre: Point, frequency: f64, along_u: bool) {
    // Length of a bar, sensor widths: half the distance between groups.
    const LENGTH: f64 = 0.04;
    for bar in 0..5 {
        let width = 0.5 / frequency;
        let across = (2.0 * f64::from(bar) - 4.5) * width;
        let (left, top, width, height) = if along_u {
            (centre[0] - LENGTH / 2.0, centre[1] + across, LENGTH, width)
        } else {
            (centre[0] + across, centre[1] - LENGTH / 2.0, width, LENGTH)
        };
        painting.lay(Shape::Rect { left, top, width, height }, dark, Painting::GROUND);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Grid, Scene};

    /// No two elements overlap: nothing is darker than dark, and the dark area is the same at any
    /// resolution.
    #[test]
    fn elements_lie_apart_and_keep_their_area() {
        let chart = chart();
        let mut areas = Vec::new();
        for width in [160usize, 1280] {
            let cell = 1.0 / width as f64;
            let height = width * 9 / 16;
            let top = -0.5 * height as f64 * cell;
            let plane = chart.plane(0, &Grid { width, height, left: -0.5, top, cell }).unwrap();
            assert!(plane.data.iter().all(|&v| f64::from(v) > DARK - 1e-5));
            let dark: f64 = plane.data.iter().map(|&v| BRIGHT - f64::from(v)).sum();
            areas.push(dark * cell * cell / (BRIGHT - DARK));
        }
        assert!((areas[0] - areas[1]).abs() < 1e-6, "{areas:?}");
    }

    #[test]
    fn bars_have_their_frequency() {
        let (cell, centre) = (1.0 / 8000.0, -3.5 * 0.08);
        let grid = Grid { width: 800, height: 1, left: centre - 400.0 * cell, top: -0.24, cell };
        let plane = chart().plane(0, &grid).unwrap();
        // 100 cycles per width: dark bars of 40 cells at a period of 80, the third one centred.
        for (i, &value) in plane.data.iter().enumerate() {
            let phase = (i + 40 * 10 - 380) % 80;
            let inside = (220..580).contains(&i);
            let dark = inside && phase < 40;
            assert_eq!(value < 0.4, dark, "cell {i}");
        }
    }
}
