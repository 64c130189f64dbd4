//! Taps in both directions, such as four amplifiers, one per quadrant, whose gains and offsets are
//! not sums of a term per column of parts and a term per row of parts.

use super::Shape;
use super::parts::{MAPS, Parts, UNITS, differences};
use super::seen::Seen;
use super::stage::shortest_s;
use super::view::{View, change_mean, gain};
use crate::data::design::Design;
use crate::finding::Finding;
use crate::report::{Domain, Form};
use crate::statistics::maps::MapKind;
use crate::statistics::temporal::Temporal;
use camrig_base::Value;
use camrig_camera::Camera;
use camrig_camera::empirical::Empirical;

/// Standard errors of the interaction from which parts are not additive, and of a level from which
/// it is reported.
const SIGNIFICANT: f64 = 5.0;

/// Parts of the sensor with their levels in the maps.
pub(crate) struct Blocks {
    /// First column of each column of parts, first row of each row of parts.
    columns: Vec<usize>,
    rows: Vec<usize>,
    size: (usize, usize),
    /// Levels minus the mean of all parts, in the order of the maps, row-major.
    levels: [Vec<Value>; 3],
    evidence: [f64; 2],
}

/// Means of the parts of a map minus the mean of all, in the unit of findings.
fn levels(view: &View<'_>, kind: MapKind, columns: &[usize], rows: &[usize]) -> Vec<Value> {
    let parts = columns.len() * rows.len();
    let Some(plane) = view.plane(kind) else {
        return vec![Value::chosen(0.0); parts];
    };
    let (w, unit) = (plane.width, view.unit(kind));
    let map = view.levelled(plane);
    let [mut sums, mut squares, mut counts] = [0; 3].map(|_| vec![0.0; parts]);
    for (i, &v) in map.data.iter().enumerate() {
        let part = part(i / w, rows) * columns.len() + part(i % w, columns);
        sums[part] += f64::from(v) * unit;
        squares[part] += (f64::from(v) * unit).powi(2);
        counts[part] += 1.0;
    }
    let all = sums.iter().sum::<f64>() / map.data.len() as f64;
    let of = |i: usize| {
        let n: f64 = counts[i];
        let mean = sums[i] / n;
        let variance = (squares[i] / n - mean * mean).max(0.0);
        Value { value: mean - all, std_error: (variance / n).sqrt() }
    };
    (0..parts).map(of).collect()
}

/// The part that a line belongs to.
fn part(line: usize, starts: &[usize]) -> usize {
    starts.partition_point(|s| *s <= line).max(1) - 1
}

/// The parts between seams of columns and of rows, where their levels are not additive; `evidence`
/// is that of the seams.
pub(crate) fn of(
    fit: &View<'_>,
    held_out: &View<'_>,
    [columns, rows]: [Vec<usize>; 2],
    evidence: [f64; 2],
) -> Option<Blocks> {
    let t = fit.stacks.first()?;
    let starts = |seams: Vec<usize>| [vec![0], seams].concat();
    let (columns, rows) = (starts(columns), starts(rows));
    let mut interact = false;
    let levels = MAPS.map(|kind| {
        let [a, b] = [fit, held_out].map(|view| levels(view, kind, &columns, &rows));
        interact |= interacts(&a, columns.len()) && interacts(&b, columns.len());
        let both = a.iter().zip(&b).map(|(a, b)| Value { value: (a.value + b.value) / 2.0, ..*a });
        let significant = a.iter().any(|e| e.z().abs() > SIGNIFICANT);
        let all: Vec<Value> = both.collect();
        if significant { all } else { vec![Value::chosen(0.0); all.len()] }
    });
    interact.then_some(Blocks { columns, rows, size: (t.width, t.height), levels, evidence })
}

/// Whether levels are not sums of a term per column of parts and a term per row of parts.
fn interacts(levels: &[Value], columns: usize) -> bool {
    let corner = |x: usize, y: usize| {
        let [a, b, c, d] = [0, x, y * columns, y * columns + x].map(|i| levels[i]);
        let se = libm::hypot(
            libm::hypot(libm::hypot(a.std_error, b.std_error), c.std_error),
            d.std_error,
        );
        (a.value - b.value - c.value + d.value).abs() > SIGNIFICANT * se
    };
    let rows = levels.len() / columns;
    (1..columns).any(|x| (1..rows).any(|y| corner(x, y)))
}

impl Blocks {
    /// Gain of a part over the mean of all.
    fn gain(&self, part: usize) -> f64 {
        1.0 + self.levels[0][part].value
    }

    /// Columns and rows of a part, in words.
    fn place(&self, part: usize) -> String {
        let of = |i: usize, starts: &[usize], end: usize| {
            (starts[i], starts.get(i + 1).copied().unwrap_or(end) - 1)
        };
        let (x0, x1) = of(part % self.columns.len(), &self.columns, self.size.0);
        let (y0, y1) = of(part / self.columns.len(), &self.rows, self.size.1);
        format!("columns {x0} to {x1} and rows {y0} to {y1}")
    }

    /// A part against the first.
    fn finding(&self, part: usize) -> Finding {
        let step = |map: usize| {
            let (a, b) = (self.levels[map][0], self.levels[map][part]);
            Value { value: b.value - a.value, std_error: libm::hypot(a.std_error, b.std_error) }
        };
        let steps = [step(0), step(1), step(2)];
        let ratio = Value { value: self.gain(part) / self.gain(0), std_error: steps[0].std_error };
        let start = |i: usize, starts: &[usize]| Value::chosen(starts[i] as f64);
        let mut parameters = vec![
            ("first_column", start(part % self.columns.len(), &self.columns)),
            ("first_row", start(part / self.columns.len(), &self.rows)),
        ];
        let (figures, words) = differences(ratio, steps);
        parameters.extend(figures);
        let domain = if ratio.std_error.is_finite() { Domain::Gain } else { Domain::Offset };
        Finding {
            parameters,
            description: format!(
                "a part of the sensor with its own amplifier (tap), {}: {words} against {}",
                self.place(part),
                self.place(0),
            ),
            ..Finding::new(domain, Form::Seam, self.evidence)
        }
    }
}

impl Shape for Blocks {
    fn subtract(&self, camera: &Camera, design: &Design, stacks: &mut [Temporal]) {
        let shortest = shortest_s(design);
        let black = camera.sensor.black_level_dn;
        for (c, t) in design.conditions.iter().zip(stacks) {
            let k = gain(camera, c);
            change_mean(camera, t, &|x, y, v| {
                let i = part(y, &self.rows) * self.columns.len() + part(x, &self.columns);
                let of = |map: usize| self.levels[map][i].value - self.levels[map][0].value;
                let more = of(1) + of(2) * (c.stack.exposure_s - shortest);
                black + (v - black - k * more) * self.gain(0) / self.gain(i)
            });
        }
    }

    fn stages(&self, camera: &mut Camera, design: &Design) -> Vec<Empirical> {
        let parts = self.columns.len() * self.rows.len();
        let levels = [0, 1, 2].map(|map| {
            let of = |part: usize| match map {
                0 => self.gain(part) / self.gain(0) - 1.0,
                _ => self.levels[map][part].value - self.levels[map][0].value,
            };
            (0..parts).map(of).collect()
        });
        Parts { columns: &self.columns, rows: &self.rows, levels }.stages(camera, design)
    }

    fn seen(&self, view: &View<'_>) -> Option<Seen> {
        let map = (0..MAPS.len()).find(|m| self.levels[*m].iter().any(|e| e.value != 0.0))?;
        let plane = view.levelled(view.plane(MAPS[map])?);
        Some(Seen::map(UNITS[map], &plane, view.unit(MAPS[map])))
    }

    fn findings(&self) -> Vec<Finding> {
        (1..self.columns.len() * self.rows.len()).map(|part| self.finding(part)).collect()
    }
}
