//! Taps: adjacent parts of the sensor with an amplifier each, whose gain, offset and noise differ.
//! Between two of them is a seam.
//!
//! A seam is a step in the column or row means of a map of the offset, the dark current or the
//! gain. Smooth models are the alternative hypotheses (`steps`). The levels of all parts are
//! corrected to that of the part that the camera file fits best.

use super::lines::Lines;
use super::parts::{MAPS, Parts, UNITS, differences};
use super::seen::Seen;
use super::stage::shortest_s;
use super::steps::{self, Steps};
use super::view::{View, change_mean, gain, scale_noise};
use super::{Shape, blocks, shapes};
use crate::data::design::Design;
use crate::finding::Finding;
use crate::report::{Domain, Form};
use crate::statistics::maps::{self, MapKind};
use crate::statistics::temporal::Temporal;
use camrig_base::Plane;
use camrig_base::Value;
use camrig_camera::Camera;
use camrig_camera::empirical::Empirical;
use camrig_captures::Role;

/// Profiles that are searched: three maps, two axes.
const PROFILES: usize = 6;
/// Tolerance of a seam's position between maps, lines.
const SAME_PLACE: usize = 2;
/// Standard errors by which the step in the held-out frames may differ. Both halves share the fixed
/// pattern, which makes most of a gain step's error, so that the difference is far smaller.
const MAX_DIFFERENCE: f64 = 4.0;
/// Share of the step that the held-out frames must show.
const MIN_CONFIRMED: f64 = 0.5;
/// Standard errors from which a step in another map at the same seam is reported.
const SIGNIFICANT: f64 = 4.0;

/// One seam.
struct Seam {
    /// First line of the second part.
    at: usize,
    /// Steps in the maps, in the order of [`MAPS`]; 0 where none is significant.
    steps: [Value; 3],
}

/// The seams between columns or between rows.
pub(crate) struct Taps {
    lines: Lines,
    /// How many the sensor has.
    count: usize,
    seams: Vec<Seam>,
    /// Index of the part that the camera file fits best.
    reference: usize,
    evidence: [f64; 2],
}

/// Seams that both halves show.
pub(crate) fn find(fit: &View<'_>, held_out: &View<'_>) -> Vec<Box<dyn Shape>> {
    let both = [Lines::Columns, Lines::Rows];
    let [columns, rows] = both.map(|lines| between(lines, fit, held_out));
    if let (Some(columns), Some(rows)) = (&columns, &rows) {
        let at = [columns, rows].map(|taps| taps.seams.iter().map(|s| s.at).collect());
        let evidence = [0, 1].map(|i: usize| columns.evidence[i] + rows.evidence[i]);
        if let Some(blocks) = blocks::of(fit, held_out, at, evidence) {
            return vec![Box::new(blocks)];
        }
    }
    shapes([columns, rows].into_iter().flatten())
}

/// Means of a map's lines in the unit of findings.
fn profile(view: &View<'_>, kind: MapKind, lines: Lines) -> Option<Vec<f64>> {
    let plane = view.levelled(view.plane(kind)?);
    let means = match lines {
        Lines::Columns => columns(&plane),
        Lines::Rows => rows(&plane),
    };
    let unit = view.unit(kind);
    Some(means.into_iter().map(|v| v * unit).collect())
}

fn columns(p: &Plane<f32>) -> Vec<f64> {
    let mut out = vec![0.0; p.width];
    for row in p.data.chunks(p.width) {
        out.iter_mut().zip(row).for_each(|(o, &v)| *o += f64::from(v) / p.height as f64);
    }
    out
}

fn rows(p: &Plane<f32>) -> Vec<f64> {
    let mean = |row: &[f32]| row.iter().map(|&v| f64::from(v)).sum::<f64>() / p.width as f64;
    p.data.chunks(p.width).map(mean).collect()
}

/// The seams between some lines.
fn between(lines: Lines, fit: &View<'_>, held_out: &View<'_>) -> Option<Taps> {
    let profiles = MAPS.map(|kind| profile(fit, kind, lines));
    let seen: [Option<Steps>; 3] =
        std::array::from_fn(|i| profiles[i].as_ref().and_then(|p| steps::find(p, PROFILES)));
    let all = seen.iter().flatten().cloned().reduce(|a, b| a.joined(b, SAME_PLACE))?;
    let mut seams: Vec<Seam> =
        all.at.iter().map(|&at| Seam { at, steps: [Value::chosen(0.0); 3] }).collect();
    let mut held = 0.0;
    for (i, kind) in MAPS.into_iter().enumerate() {
        let (Some(a), Some(b)) = (&profiles[i], profile(held_out, kind, lines)) else { continue };
        let of = all.with_smooth_of(seen[i].as_ref());
        for ((seam, a), b) in seams.iter_mut().zip(of.sizes(a)).zip(of.sizes(&b)) {
            let difference = (a.value - b.value).abs();
            let again = difference < MAX_DIFFERENCE * libm::hypot(a.std_error, b.std_error)
                && b.value * a.value.signum() > MIN_CONFIRMED * a.value.abs();
            if again && a.z().abs() > SIGNIFICANT {
                seam.steps[i] = Value { value: (a.value + b.value) / 2.0, std_error: a.std_error };
                held += b.z().powi(2);
            }
        }
    }
    seams.retain(|s| s.steps.iter().any(|e| e.value != 0.0));
    if seams.is_empty() {
        return None;
    }
    let count = profiles.iter().flatten().map(Vec::len).next()?;
    let mut taps = Taps { lines, count, seams, reference: 0, evidence: [all.evidence, held] };
    taps.reference = taps.fits_best(fit);
    Some(taps)
}

impl Taps {
    /// The part of a line.
    fn part(&self, line: usize) -> usize {
        self.seams.iter().take_while(|s| s.at <= line).count()
    }

    /// Level of a part in a map, minus the mean of all lines.
    fn level(&self, map: usize, part: usize) -> f64 {
        let before = |to: usize| self.seams[..to].iter().map(|s| s.steps[map].value).sum::<f64>();
        let starts = self.seams.iter().map(|s| s.at);
        let ends = starts.clone().skip(1).chain([self.count]);
        let parts = starts.zip(ends).enumerate();
        let sum: f64 = parts.map(|(i, (from, to))| before(i + 1) * (to - from) as f64).sum();
        before(part) - sum / self.count as f64
    }

    /// Gain of a part over the mean of all.
    fn gain(&self, part: usize) -> f64 {
        1.0 + self.level(0, part)
    }

    /// The part whose gain, or else whose offset, is nearest to the camera file's: it is likelier
    /// that one amplifier deviates than that all but one do.
    fn fits_best(&self, view: &View<'_>) -> usize {
        let Some(dark) = maps::reference_dark(view.design) else { return 0 };
        let black = view.stacks[dark].level();
        let (mut measured, mut predicted) = (0.0, 0.0);
        for i in view.stacks_of(Role::Flat) {
            let c = &view.design.conditions[i];
            if c.level_known {
                measured += (view.stacks[i].level() - black) / view.gain(i);
                predicted += c.photo_e.iter().sum::<f64>() / c.photo_e.len().max(1) as f64;
            }
        }
        let has = |map: usize| self.seams.iter().any(|s| s.steps[map].value != 0.0);
        let (map, mean) = match (has(0) && predicted > 0.0, has(1)) {
            (true, _) => (0, measured / predicted - 1.0),
            (_, true) => (1, (black - view.camera.sensor.black_level_dn) / view.gain(dark)),
            _ => return 0,
        };
        let off = |part: usize| (mean + self.level(map, part)).abs();
        (0..=self.seams.len()).min_by(|&a, &b| off(a).total_cmp(&off(b))).unwrap_or(0)
    }
}

impl Shape for Taps {
    fn subtract(&self, camera: &Camera, design: &Design, stacks: &mut [Temporal]) {
        let shortest = shortest_s(design);
        let black = camera.sensor.black_level_dn;
        for (c, t) in design.conditions.iter().zip(stacks) {
            let k = gain(camera, c);
            let changes: Vec<(f64, f64)> = (0..=self.seams.len())
                .map(|part| {
                    let of = |map| self.level(map, part) - self.level(map, self.reference);
                    let more = of(1) + of(2) * (c.stack.exposure_s - shortest);
                    (k * more, self.gain(self.reference) / self.gain(part))
                })
                .collect();
            let width = t.width;
            scale_noise(t, |i, _| {
                let factor = changes[self.part(self.lines.of(i, width))].1 as f32;
                let square = factor * factor;
                [square, square * factor, square * square]
            });
            change_mean(camera, t, &|x, y, v| {
                let (more, factor) = changes[self.part(self.lines.at(x, y))];
                black + (v - black - more) * factor
            });
        }
    }

    fn stages(&self, camera: &mut Camera, design: &Design) -> Vec<Empirical> {
        let starts: Vec<usize> = [0].into_iter().chain(self.seams.iter().map(|s| s.at)).collect();
        let levels = [0, 1, 2].map(|map| {
            let of = |part: usize| match map {
                0 => self.gain(part) / self.gain(self.reference) - 1.0,
                _ => self.level(map, part) - self.level(map, self.reference),
            };
            (0..starts.len()).map(of).collect()
        });
        let (columns, rows): (&[usize], &[usize]) = match self.lines {
            Lines::Columns => (&starts, &[0]),
            Lines::Rows => (&[0], &starts),
        };
        Parts { columns, rows, levels }.stages(camera, design)
    }

    fn seen(&self, view: &View<'_>) -> Option<Seen> {
        let stepped = |map: &usize| self.seams.iter().any(|s| s.steps[*map].value != 0.0);
        let map = (0..MAPS.len()).find(stepped)?;
        let profile = profile(view, MAPS[map], self.lines)?;
        Some(Seen::lines(self.lines.word(), UNITS[map], &profile))
    }

    fn findings(&self) -> Vec<Finding> {
        (1..=self.seams.len()).map(|part| self.finding(part)).collect()
    }
}

impl Taps {
    /// The seam before a part.
    fn finding(&self, part: usize) -> Finding {
        let key = match self.lines {
            Lines::Columns => "first_column",
            Lines::Rows => "first_row",
        };
        let seam = &self.seams[part - 1];
        let ratio = self.gain(part) / self.gain(part - 1);
        let ratio = Value { value: ratio, std_error: seam.steps[0].std_error };
        let (figures, words) = differences(ratio, seam.steps);
        let mut parameters = vec![(key, Value::chosen(seam.at as f64))];
        parameters.extend(figures);
        let domain = match seam.steps.map(|e| e.value != 0.0) {
            [true, ..] => Domain::Gain,
            [_, true, _] => Domain::Offset,
            _ => Domain::Dark,
        };
        Finding {
            parameters,
            description: format!(
                "a seam between two parts of the sensor with separate amplifiers (taps), at {} \
                 {}, the first of the second part: {words} against the part before",
                self.lines.word(),
                seam.at
            ),
            ..Finding::new(domain, Form::Seam, self.evidence)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::bench::{Hidden, WIDTH, figure, shoot};

    #[test]
    fn two_taps_have_a_seam_with_a_ratio_and_an_offset() {
        let volts = |e: &mut [f64], _: &mut crate::shapes::bench::Shot<'_>| {
            for row in e.chunks_mut(WIDTH) {
                row[40..].iter_mut().for_each(|v| *v = *v * 1.008 - 3.0);
            }
        };
        let bench = shoot(11, &Hidden { volts: Some(&volts), ..Hidden::default() });
        let found = find(&bench.view(0), &bench.view(1));
        let findings: Vec<Finding> = found.iter().flat_map(|s| s.findings()).collect();
        let [seam] = &findings[..] else { panic!("{findings:?}") };
        assert!((figure(seam, "first_column") - 40.0).abs() < 0.5, "{seam:?}");
        // Three errors: PRNU of the halves, 0.008 √(2/2016); read noise, 5 √(2/(2016 · 20)).
        assert!((figure(seam, "gain_ratio") - 1.008).abs() < 8e-4, "{seam:?}");
        assert!((figure(seam, "offset_e") + 3.0).abs() < 0.15, "{seam:?}");
        // Once it is subtracted, the maps have no seam.
        let mut stacks = bench.stacks[0].clone();
        found.iter().for_each(|s| s.subtract(&bench.camera, &bench.design, &mut stacks));
        let maps = maps::maps(&bench.camera, &bench.design, &stacks);
        let rest = View { maps: &maps, stacks: &stacks, ..bench.view(0) };
        assert!(find(&rest, &bench.view(1)).is_empty());
    }

    #[test]
    fn one_quadrant_that_is_off_is_a_part_of_its_own() {
        let volts = |e: &mut [f64], _: &mut crate::shapes::bench::Shot<'_>| {
            for row in e.chunks_mut(WIDTH).skip(24) {
                row[36..].iter_mut().for_each(|v| *v = *v * 1.012 + 4.0);
            }
        };
        let bench = shoot(13, &Hidden { volts: Some(&volts), ..Hidden::default() });
        let found = find(&bench.view(0), &bench.view(1));
        let findings: Vec<Finding> = found.iter().flat_map(|s| s.findings()).collect();
        let [_, _, last] = &findings[..] else { panic!("{findings:?}") };
        assert!((figure(last, "gain_ratio") - 1.012).abs() < 1.2e-3, "{last:?}");
        assert!((figure(last, "offset_e") - 4.0).abs() < 0.2, "{last:?}");
    }

    #[test]
    fn smooth_shading_and_nothing_have_no_seam() {
        let charge = |e: &mut [f64], _: &mut crate::shapes::bench::Shot<'_>| {
            for row in e.chunks_mut(WIDTH) {
                for (x, v) in row.iter_mut().enumerate() {
                    let u = 2.0 * x as f64 / WIDTH as f64 - 1.0;
                    *v *= 1.0 - 0.04 * u * u + 0.01 * (4.0 * u).sin();
                }
            }
        };
        for hidden in [Hidden::default(), Hidden { charge: Some(&charge), ..Hidden::default() }] {
            let bench = shoot(12, &hidden);
            assert!(find(&bench.view(0), &bench.view(1)).is_empty());
        }
    }
}
