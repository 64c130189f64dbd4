//! How a shape appears in moments, measured or simulated: a curve or a coarse map.

use super::view::View;
use crate::statistics::temporal::mean;
use camrig_base::Plane;

/// Most points of a curve.
const MAX_POINTS: usize = 64;
/// Most columns and rows of a map.
const MAX_COLUMNS: usize = 32;
const MAX_ROWS: usize = 24;

/// A curve or a map of a shape in some moments.
pub(crate) struct Seen {
    /// What lies along the curve, or the map, with its unit.
    pub x: &'static str,
    /// What is shown, with its unit.
    pub y: &'static str,
    /// Places on the curve; empty of a map.
    pub at: Vec<f64>,
    /// The values; those of a map row by row.
    pub values: Vec<f64>,
    /// Columns of a map.
    pub columns: Option<usize>,
}

impl Seen {
    /// A curve.
    pub fn curve(
        x: &'static str,
        y: &'static str,
        points: impl Iterator<Item = [f64; 2]>,
    ) -> Self {
        let (at, values) = points.map(|[x, y]| (x, y)).unzip();
        Self { x, y, at, values, columns: None }
    }

    /// A value for each of some lines, as means of few neighbours.
    pub fn lines(x: &'static str, y: &'static str, values: &[f64]) -> Self {
        let size = values.len().div_ceil(MAX_POINTS).max(1);
        let point = |(i, group): (usize, &[f64])| {
            let n = group.len() as f64;
            [(i * size) as f64 + (n - 1.0) / 2.0, group.iter().sum::<f64>() / n]
        };
        Self::curve(x, y, values.chunks(size).enumerate().map(point))
    }

    /// A map, as means of cells.
    pub fn map(y: &'static str, plane: &Plane<f32>, unit: f64) -> Self {
        let across = plane.width.div_ceil(MAX_COLUMNS).max(1);
        let down = plane.height.div_ceil(MAX_ROWS).max(1);
        let columns = plane.width.div_ceil(across);
        let mut values = Vec::new();
        for rows in plane.data.chunks(plane.width * down) {
            let mut sums = vec![(0.0, 0.0); columns];
            for row in rows.chunks(plane.width) {
                for (cell, sum) in row.chunks(across).zip(&mut sums) {
                    sum.0 += cell.iter().map(|&v| f64::from(v) * unit).sum::<f64>();
                    sum.1 += cell.len() as f64;
                }
            }
            values.extend(sums.iter().map(|(sum, n)| sum / n));
        }
        let x = "cells of the sensor, row by row";
        Self { x, y, at: Vec::new(), values, columns: Some(columns) }
    }

    /// The quantile function of some values, over standard normal deviates.
    pub fn quantiles(y: &'static str, mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        let n = values.len();
        // Half a sample from either end.
        let point = |i: i32| {
            let z = f64::from(i) / 8.0;
            let share = 0.5 * libm::erfc(-z / std::f64::consts::SQRT_2);
            let at = share * n as f64 - 0.5;
            (at >= 0.0 && at <= (n - 1) as f64).then(|| [z, values[at as usize]])
        };
        let points: Vec<[f64; 2]> =
            if n == 0 { Vec::new() } else { (-28..=28).filter_map(point).collect() };
        Self::curve("standard normal deviate of a pixel", y, points.into_iter())
    }
}

/// Standard deviation over the frames of a stack, e⁻, and its signal, e⁻, for each stack.
pub(crate) fn noise_over_signal(view: &View<'_>) -> Option<Seen> {
    let black = view.black()?;
    let mut points: Vec<[f64; 2]> = (view.stacks.iter().enumerate())
        .map(|(i, t)| {
            let k = view.gain(i);
            let variance = mean(&t.pixel_variance);
            [(t.level() - black) / k, variance.sqrt() / k]
        })
        .collect();
    points.sort_by(|a, b| a[0].total_cmp(&b[0]));
    Some(Seen::curve("signal, e⁻", "noise, e⁻", points.into_iter()))
}
