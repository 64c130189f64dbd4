//! Taps in both directions, as of four amplifiers, one for each quadrant, whose gains and offsets
//! are no sums of a column's and a row's part.

use crate::Shape;
use crate::seam::{MAPS, UNITS};
use crate::seen::Seen;
use crate::stage::Parts;
use crate::view::{View, change_mean, gain};
use camrig_camera::Camera;
use camrig_camera::empirical::Empirical;
use camrig_diagnose::data::design::Design;
use camrig_diagnose::evidence::Estimated;
use camrig_diagnose::finding::{Dependence, Domain, Finding, Form, number};
use camrig_diagnose::statistics::maps::{self, MapKind};
use camrig_diagnose::statistics::temporal::Temporal;

/// Standard errors by which the parts differ from sums of a column's and a row's part where they
/// are parts of their own, and from which a level is told.
const APART: f64 = 5.0;

/// Parts of the sensor, each with its levels in the maps.
pub(crate) struct Blocks {
    /// First column of each column of parts, first row of each row of parts.
    columns: Vec<usize>,
    rows: Vec<usize>,
    size: (usize, usize),
    /// Levels over the mean of all parts, in the order of the maps, row-major.
    levels: [Vec<Estimated>; 3],
    evidence: [f64; 2],
}

/// Means of the parts of a map, less the mean of all, in the unit that is told.
fn levels(view: &View<'_>, kind: MapKind, columns: &[usize], rows: &[usize]) -> Vec<Estimated> {
    let parts = columns.len() * rows.len();
    let Some(plane) = view.plane(kind) else {
        return vec![Estimated { value: 0.0, se: f64::NAN }; parts];
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
        Estimated { value: mean - all, se: (variance / n).sqrt() }
    };
    (0..parts).map(of).collect()
}

/// The part of a line.
fn part(line: usize, starts: &[usize]) -> usize {
    starts.partition_point(|s| *s <= line).max(1) - 1
}

/// The parts between seams of columns and of rows, where they are no sums; `evidence` is that of
/// the seams.
pub(crate) fn of(
    fit: &View<'_>,
    held_out: &View<'_>,
    [columns, rows]: [Vec<usize>; 2],
    evidence: [f64; 2],
) -> Option<Blocks> {
    let t = fit.stacks.first()?;
    let starts = |seams: Vec<usize>| [vec![0], seams].concat();
    let (columns, rows) = (starts(columns), starts(rows));
    let mut apart = false;
    let levels = MAPS.map(|kind| {
        let [a, b] = [fit, held_out].map(|view| levels(view, kind, &columns, &rows));
        apart |= interacts(&a, columns.len()) && interacts(&b, columns.len());
        let both =
            a.iter().zip(&b).map(|(a, b)| Estimated { value: (a.value + b.value) / 2.0, ..*a });
        let told = a.iter().any(|e| e.z().abs() > APART);
        let all: Vec<Estimated> = both.collect();
        if told { all } else { vec![Estimated { value: 0.0, se: f64::NAN }; all.len()] }
    });
    apart.then_some(Blocks { columns, rows, size: (t.width, t.height), levels, evidence })
}

/// Whether levels are no sums of a column's and a row's part.
fn interacts(levels: &[Estimated], columns: usize) -> bool {
    let corner = |x: usize, y: usize| {
        let [a, b, c, d] = [0, x, y * columns, y * columns + x].map(|i| levels[i]);
        let se = libm::hypot(libm::hypot(libm::hypot(a.se, b.se), c.se), d.se);
        (a.value - b.value - c.value + d.value).abs() > APART * se
    };
    let rows = levels.len() / columns;
    (1..columns).any(|x| (1..rows).any(|y| corner(x, y)))
}

impl Blocks {
    /// Gain of a part over the mean of all.
    fn gain(&self, part: usize) -> f64 {
        1.0 + self.levels[0][part].value
    }

    /// Columns and rows of a part in words.
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
            Estimated { value: b.value - a.value, se: libm::hypot(a.se, b.se) }
        };
        let [relative, offset, dark] = [step(0), step(1), step(2)];
        let ratio = Estimated { value: self.gain(part) / self.gain(0), se: relative.se };
        let start =
            |i: usize, starts: &[usize]| Estimated { value: starts[i] as f64, se: f64::NAN };
        let mut parameters = vec![
            ("first_column", start(part % self.columns.len(), &self.columns)),
            ("first_row", start(part / self.columns.len(), &self.rows)),
        ];
        let mut said = Vec::new();
        let told = [
            (relative.se, "gain_ratio", ratio, "gain ratio", ""),
            (offset.se, "offset_e", offset, "offset", " e⁻"),
            (dark.se, "dark_current_e_per_s", dark, "dark current", " e⁻/s"),
        ];
        for (se, key, value, name, unit) in told {
            if se.is_finite() {
                parameters.push((key, value));
                said.push(format!("{name} {}{unit}", number(value)));
            }
        }
        Finding {
            domain: if relative.se.is_finite() { Domain::Gain } else { Domain::Offset },
            form: Form::Seam,
            dependence: Dependence {
                exposure: 0.0,
                signal: f64::from(u8::from(relative.se.is_finite())),
            },
            parameters,
            evidence: self.evidence,
            shown: None,
            description: format!(
                "a part of the sensor with an amplifier of its own (tap), {}: {} against {}",
                self.place(part),
                said.join(", "),
                self.place(0),
            ),
        }
    }
}

impl Shape for Blocks {
    fn take_out(&self, camera: &Camera, design: &Design, stacks: &mut [Temporal]) {
        let Some(dark) = maps::reference_dark(design) else { return };
        let shortest = design.conditions[dark].stack.exposure_s;
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
