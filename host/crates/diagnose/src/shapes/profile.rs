//! Smooth profiles of offset or dark current along columns or rows, of any form: glow at several
//! edges, a transient at the start of each row in every frame.
//!
//! The means of a map's columns (rows) are fitted by a line and cosines. Each mean is one
//! observation, so that differences of single columns are noise; of dark current the line is left to
//! the catalogue's `dark-current-gradient`.

use super::lines::Lines;
use super::seen::Seen;
use super::stage;
use super::view::{View, change_mean, gain, scale_noise};
use super::{FALSE_ALARMS, Shape, shapes};
use crate::data::design::Design;
use crate::finding::{Finding, number};
use crate::report::Domain;
use crate::statistics::maps::MapKind;
use crate::statistics::temporal::Temporal;
use camrig_base::Plane;
use camrig_base::Value;
use camrig_base::median::robust_sd;
use camrig_camera::Camera;
use camrig_camera::empirical::{Curve, Empirical, Table};
use camrig_sensor_core::effects::empirical::Quantity;
use std::f64::consts::PI;

/// Maps that are searched, each along both axes.
const MAPS: [MapKind; 2] = [MapKind::DarkCurrent, MapKind::Offset];
/// Numbers of cosines: none for a straight slope of the offset, for a smooth profile, and for one that is steep at an edge.
const COSINES: [usize; 3] = [0, 6, 19];
/// Lines that a profile needs for each of its cosines.
const MIN_LINES_PER_COSINE: usize = 3;
/// Comparisons: maps, axes, numbers of cosines.
const COMPARISONS: f64 = 12.0;
/// Robust standard deviations from the profile beyond which a pixel is an outlier.
const OUTLIER_Z: f64 = 4.0;
/// Rounds in which outliers are found.
const ROUNDS: usize = 3;
/// Knots of the stage's table, at most.
const KNOTS: usize = 64;

/// A profile of one map along one axis.
struct Profile {
    kind: MapKind,
    lines: Lines,
    /// For each line, e⁻ or e⁻/s; their mean is 0.
    values: Vec<f64>,
    /// Standard error of a value.
    std_error: f64,
    evidence: [f64; 2],
}

/// Profiles that both halves show.
pub(crate) fn find(fit: &View<'_>, held_out: &View<'_>) -> Vec<Box<dyn Shape>> {
    let places = MAPS.into_iter().flat_map(|kind| [(kind, Lines::Columns), (kind, Lines::Rows)]);
    shapes(places.filter_map(|(kind, lines)| profile(fit, held_out, kind, lines)))
}

/// Means of a map's lines in the unit of findings, without outliers.
fn line_means(view: &View<'_>, kind: MapKind, lines: Lines) -> Option<Vec<f64>> {
    let map = view.about_median(view.plane(kind)?);
    let n = lines.count(map.width, map.height);
    let mut means = vec![0.0; n];
    for _ in 0..ROUNDS {
        let rest = about(&map, lines, &means);
        let limit = OUTLIER_Z * robust_sd(rest.iter().copied());
        let (mut sums, mut counts) = (vec![0.0; n], vec![0.0; n]);
        for (i, (v, r)) in map.data.iter().zip(&rest).enumerate() {
            if f64::from(r.abs()) <= limit {
                let line = lines.of(i, map.width);
                sums[line] += f64::from(*v);
                counts[line] += 1.0;
            }
        }
        means =
            sums.iter().zip(&counts).map(|(s, n)| if *n > 0.0 { s / n } else { 0.0 }).collect();
    }
    let middle = means.iter().sum::<f64>() / n as f64;
    Some(means.into_iter().map(|m| (m - middle) * view.unit(kind)).collect())
}

/// A map minus a value for each line.
fn about(map: &Plane<f32>, lines: Lines, values: &[f64]) -> Vec<f32> {
    let of = |(i, v): (usize, &f32)| v - values[lines.of(i, map.width)] as f32;
    map.data.iter().enumerate().map(of).collect()
}

/// The line of least squares through a profile whose mean is 0.
pub(super) fn slope(profile: &[f64]) -> Vec<f64> {
    let n = profile.len() as f64;
    let at = |i: usize| i as f64 - (n - 1.0) / 2.0;
    let square: f64 = (0..profile.len()).map(|i| at(i).powi(2)).sum();
    let by = profile.iter().enumerate().map(|(i, v)| at(i) * v).sum::<f64>() / square.max(1e-300);
    (0..profile.len()).map(|i| by * at(i)).collect()
}

/// Projection of a profile onto the first cosines, which are orthogonal over whole lines.
pub(super) fn smooth(profile: &[f64], cosines: usize) -> Vec<f64> {
    let n = profile.len() as f64;
    let mut out = vec![0.0; profile.len()];
    for j in 1..=cosines {
        let basis = |i: usize| libm::cos(PI * j as f64 * (i as f64 + 0.5) / n);
        let amplitude =
            profile.iter().enumerate().map(|(i, v)| basis(i) * v).sum::<f64>() * 2.0 / n;
        out.iter_mut().enumerate().for_each(|(i, v)| *v += amplitude * basis(i));
    }
    out
}

fn less(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

fn square(v: &[f64]) -> f64 {
    v.iter().map(|v| v * v).sum::<f64>().max(1e-300)
}

fn profile(fit: &View<'_>, held_out: &View<'_>, kind: MapKind, lines: Lines) -> Option<Profile> {
    let (a, b) = (line_means(fit, kind, lines)?, line_means(held_out, kind, lines)?);
    let n = a.len() as f64;
    let (line_a, line_b) = (slope(&a), slope(&b));
    let least = -2.0 * libm::log(FALSE_ALARMS / COMPARISONS);
    let of = |cosines: usize| {
        let bent = smooth(&less(&a, &line_a), cosines);
        let values: Vec<f64> = line_a.iter().zip(&bent).map(|(l, c)| l + c).collect();
        let rest = less(&a, &values);
        // ln n for each cosine (Schwarz 1978); none was fitted to the held-out frames.
        let straight = match kind {
            MapKind::Offset => [square(&a), square(&b)],
            _ => [square(&less(&a, &line_a)), square(&less(&b, &line_b))],
        };
        let evidence = [
            n * libm::log(straight[0] / square(&rest)) - cosines as f64 * libm::log(n),
            n * libm::log(straight[1] / square(&less(&b, &values))),
        ];
        let left = square(&rest) / (n - cosines as f64 - 2.0);
        let se = (left * (cosines as f64 + 1.0) / n).sqrt();
        Profile { kind, lines, values, std_error: se, evidence }
    };
    COSINES
        .into_iter()
        .filter(|cosines| cosines * MIN_LINES_PER_COSINE <= a.len())
        .map(of)
        .filter(|p| p.evidence.iter().all(|e| *e > least))
        .max_by(|p, q| p.evidence[0].total_cmp(&q.evidence[0]))
}

impl Profile {
    /// The value at a pixel.
    fn at(&self, x: usize, y: usize) -> f64 {
        self.values.get(self.lines.at(x, y)).copied().unwrap_or(0.0)
    }

    /// The largest and the smallest value, with their lines.
    fn ends(&self) -> [(usize, f64); 2] {
        let all = || self.values.iter().copied().enumerate();
        let greatest = all().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or_default();
        [greatest, all().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or_default()]
    }

    /// The profile above a base as knots, and its largest value.
    fn table(&self, base: f64) -> (Table, f64) {
        let last = self.values.len().saturating_sub(1);
        let count = self.values.len().min(KNOTS);
        let knot = |i: usize| i * last / (count - 1).max(1);
        let from_base = self.values.iter().map(|v| v - base);
        let amount = from_base.max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(1.0);
        let at: Vec<f64> = (0..count).map(|i| knot(i) as f64).collect();
        let values = (0..count).map(|i| (self.values[knot(i)] - base) / amount).collect();
        (self.lines.table(Curve { at, values }), amount)
    }

    fn unit(&self) -> &'static str {
        if self.kind == MapKind::Offset { "e⁻" } else { "e⁻/s" }
    }
}

impl Shape for Profile {
    fn subtract(&self, camera: &Camera, design: &Design, stacks: &mut [Temporal]) {
        let shortest = stage::shortest_s(design);
        for (c, t) in design.conditions.iter().zip(stacks) {
            let k = gain(camera, c);
            let electrons = |x: usize, y: usize| match self.kind {
                MapKind::Offset => self.at(x, y),
                _ => self.at(x, y) * (c.stack.exposure_s - shortest),
            };
            if self.kind == MapKind::DarkCurrent {
                // Charge has shot noise.
                let width = t.width;
                scale_noise(t, |i, v| {
                    let more = (k * k * electrons(i % width, i / width)) as f32;
                    let square = (1.0 - more / v.max(1e-12)).max(0.0);
                    [square, square * square.sqrt(), square * square]
                });
            }
            change_mean(camera, t, &|x, y, v| v - k * electrons(x, y));
        }
    }

    fn stages(&self, camera: &mut Camera, design: &Design) -> Vec<Empirical> {
        if self.kind == MapKind::Offset {
            let (table, amount) = self.table(0.0);
            return vec![Empirical::new(Quantity::Offset, table, amount)];
        }
        // What is below the mean was part of the camera's mean dark current.
        let [_, (_, least)] = self.ends();
        let taken = stage::take_dark(camera, design, -least);
        let (table, amount) = self.table(-taken);
        vec![stage::dark(camera, design, table, amount)]
    }

    fn seen(&self, view: &View<'_>) -> Option<Seen> {
        let y = if self.kind == MapKind::Offset { "offset, e⁻" } else { "dark current, e⁻/s" };
        Some(Seen::lines(self.lines.word(), y, &line_means(view, self.kind, self.lines)?))
    }

    fn findings(&self) -> Vec<Finding> {
        let dark = self.kind == MapKind::DarkCurrent;
        let line = self.lines.word();
        let [greatest, least] = self.ends();
        let estimated = |value| Value { value, std_error: self.std_error };
        let place = |line: usize| Value::chosen(line as f64);
        let range = Value { value: greatest.1 - least.1, std_error: self.std_error * 2f64.sqrt() };
        let unit = self.unit();
        let domain = if dark { Domain::Dark } else { Domain::Offset };
        vec![Finding {
            parameters: vec![
                (if dark { "range_e_per_s" } else { "range_e" }, range),
                ("highest_line", place(greatest.0)),
                ("lowest_line", place(least.0)),
            ],
            description: format!(
                "{} that changes smoothly over the {line}s: {} {unit} at {line} {} and {} {unit} \
                 at {line} {}, about the mean",
                if dark { "dark current" } else { "an offset" },
                number(estimated(greatest.1)),
                greatest.0,
                number(estimated(least.1)),
                least.0,
            ),
            ..Finding::new(domain, self.lines.profile(), self.evidence)
        }]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::Form;
    use crate::shapes::bench::{HEIGHT, Hidden, Shot, WIDTH, shoot};
    use crate::statistics::maps;

    fn found(rate: &dyn Fn(f64, f64) -> f64) -> Vec<Finding> {
        let charge = |e: &mut [f64], shot: &mut Shot<'_>| {
            for (i, v) in e.iter_mut().enumerate() {
                *v += rate((i % WIDTH) as f64, (i / WIDTH) as f64) * shot.exposure_s;
            }
        };
        let bench = shoot(71, &Hidden { charge: Some(&charge), ..Hidden::default() });
        let shapes = find(&bench.view(0), &bench.view(1));
        let mut stacks = bench.stacks[0].clone();
        shapes.iter().for_each(|s| s.subtract(&bench.camera, &bench.design, &mut stacks));
        let maps = maps::maps(&bench.camera, &bench.design, &stacks);
        let rest = View { maps: &maps, stacks: &stacks, ..bench.view(0) };
        assert!(find(&rest, &bench.view(1)).is_empty(), "taken out, nothing is left");
        shapes.iter().flat_map(|s| s.findings()).collect()
    }

    #[test]
    fn a_glow_of_four_edges_is_a_profile_over_columns_and_one_over_rows() {
        let last = (WIDTH as f64 - 1.0, HEIGHT as f64 - 1.0);
        let edge = |d: f64| (-d / 7.0).exp();
        let findings = found(&|x, y| {
            2.5 * edge(x) + 3.0 * edge(last.0 - x) + 2.0 * edge(y) + 2.5 * edge(last.1 - y)
        });
        let [columns, rows] = &findings[..] else { panic!("{findings:?}") };
        for (finding, form, highest) in
            [(columns, Form::RowProfile, last.0), (rows, Form::ColumnProfile, last.1)]
        {
            assert_eq!((finding.domain, finding.form), (Domain::Dark, form));
            let range = finding.parameters[0].1;
            let greatest = if form == Form::RowProfile { 3.0 } else { 2.5 };
            assert!((range.value - greatest).abs() < 0.6, "{finding:?}");
            assert!((finding.parameters[1].1.value - highest).abs() < 3.0, "{finding:?}");
        }
        assert_eq!(found(&|_, _| 0.0).len(), 0);
    }

    #[test]
    fn a_slope_and_columns_of_their_own_are_none() {
        assert!(found(&|x, _| 0.1 * x).is_empty());
        let own = |x: f64| 3.0 * (x * 12.9898).sin() * (x * 78.233).cos();
        assert!(found(&|x, _| 4.0 + own(x)).is_empty());
    }
}
