//! The pictures of an effect: the measurement, and the models without and with it. A smooth
//! effect is seen in maps, a pattern of lines in a profile, one of pixels in their distribution,
//! noise in a statistic over the captures.

use super::words;
use crate::plot::{Colour, Mark, Plot, Size, triple};
use camrig_base::{Plane, Result};
use camrig_diagnose::Diagnosis;
use camrig_diagnose::model::effects::dn_per_e;
use camrig_diagnose::report::Shown;
use camrig_diagnose::search::forward::{Observed, Step};
use camrig_diagnose::statistics::maps::{Map, MapKind, reference_dark};
use camrig_diagnose::statistics::statistic::{Key, Place, Scale, What};
use camrig_diagnose::verdict::words as statistics;

/// Cells of a map across, at most.
const CELLS: usize = 80;
/// Lines of a profile, at most; of larger sensors the first are shown.
const LINES: usize = 600;
/// Points of a distribution.
const POINTS: usize = 120;
/// Share of the pixels at which a distribution begins.
const BEGIN: f64 = 0.5;
/// Height of the frame around rows of points, and of a row, px; the range of the whole.
const FRAME: f64 = 112.0;
const ROW: f64 = 16.0;
const HEIGHTS: [f64; 2] = [200.0, 520.0];
/// Largest value over smallest from which an axis is logarithmic.
const WIDE: f64 = 30.0;

/// Broadest over narrowest gap up to which places along a curve are even steps.
const EVEN: f64 = 3.0;
/// Titles of what the models leave of a map.
pub(super) const LESS_GIVEN: &str = "Measured less the model as given";
pub(super) const LESS_IMPROVED: &str = "Measured less the improved model";

/// Maps of the held-out frames, and of replicates of the model before and after.
pub struct Maps<'a> {
    pub diagnosis: &'a Diagnosis,
    before: Vec<Map>,
    after: Vec<Map>,
}

/// What is shown of an effect.
#[non_exhaustive]
pub enum Picture {
    /// Maps: measured, less the model before, less the model after.
    Maps(Box<[Plot; 3]>),
    /// A plot.
    Plot(Box<Plot>),
}

/// The planes of a map, in the unit that is shown: measured, before, after.
pub(super) struct Planes {
    pub name: &'static str,
    unit: &'static str,
    all: [Plane<f64>; 3],
}

impl<'a> Maps<'a> {
    /// Simulates both models once.
    pub fn new(diagnosis: &'a Diagnosis) -> Result<Self> {
        let held_out = &diagnosis.measured.holdout;
        Ok(Self {
            diagnosis,
            before: held_out.replicated_maps(&diagnosis.outcome.before.camera)?,
            after: held_out.replicated_maps(diagnosis.improved())?,
        })
    }

    /// Columns and rows of the frames.
    pub fn sides(&self) -> [usize; 2] {
        self.diagnosis
            .measured
            .fit
            .stacks
            .first()
            .map_or([0, 0], |s| [s.mean.width, s.mean.height])
    }

    /// Where the effect of a step is visible.
    pub fn picture(&self, step: &Step) -> Option<Picture> {
        let mut keys = step.moved.iter().map(|m| m.key);
        // Means and variances over the sensor show that there is more, a map shows where.
        let in_map = |key: &Key| matches!(key.0, Place::Map(_));
        let first = step.moved.first()?.key;
        let vague = matches!(first.1, What::Mean(_) | What::Variance(_));
        let shown = keys.find(|key| in_map(key) && (vague || *key == first));
        if let Some((Place::Map(kind), what)) = shown
            && let Some(planes) = self.planes(kind)
        {
            return Some(of_map(&planes, what));
        }
        let points = self.observed(&step.observed)?;
        Some(Picture::Plot(Box::new(points)))
    }

    /// A map measured and by both models; none where the set has no such map.
    pub(super) fn planes(&self, kind: MapKind) -> Option<Planes> {
        let of = |maps: &[Map]| Some(self.in_unit(maps.iter().find(|m| m.kind == kind)?));
        let (name, unit) = words::map(kind);
        let all =
            [of(&self.diagnosis.measured.holdout.maps)?, of(&self.before)?, of(&self.after)?];
        Some(Planes { name, unit, all })
    }

    /// A map in e⁻, e⁻/s or per cent. The gain is that of the model as given, for all alike.
    fn in_unit(&self, map: &Map) -> Plane<f64> {
        let design = &self.diagnosis.measured.holdout.design;
        let camera = &self.diagnosis.outcome.before.camera;
        let gain = reference_dark(design)
            .map_or(1.0, |i| dn_per_e(camera, design.conditions[i].stack.analog_gain));
        let black = camera.sensor.black_level_dn;
        let value = |v: f32| match map.kind {
            MapKind::Offset => (f64::from(v) - black) / gain,
            MapKind::AfterLight => f64::from(v) / gain,
            MapKind::DarkCurrent => f64::from(v),
            MapKind::Gain | MapKind::Curvature => 100.0 * f64::from(v),
        };
        let data = map.plane.data.iter().map(|&v| value(v)).collect();
        Plane { width: map.plane.width, height: map.plane.height, data }
    }

    /// The statistic that shows an effect best, in all captures: measured, and both models.
    fn observed(&self, observed: &[Observed]) -> Option<Plot> {
        let first = observed.first()?.key;
        let camera = &self.diagnosis.outcome.after.camera;
        let scale = self.diagnosis.measured.holdout.values.get(&first)?.scale;
        let value = |v: f64| match scale {
            Scale::Linear | Scale::Count => v,
            Scale::Log => libm::exp(v),
            Scale::CubeRoot => v.powi(3),
        };
        let name = statistics::name(camera, first);
        let unit = words::unit(first);
        let axis = if unit.is_empty() { name.clone() } else { format!("{name}, {unit}") };
        let mut plot = Plot::new(&crate::emva::capitalised(&name), &axis, "capture");
        let n = observed.len() as f64;
        let row = |shift: f64, of: &dyn Fn(&Observed) -> f64| -> Vec<[f64; 2]> {
            let place = |(i, s): (usize, &Observed)| [value(of(s)), i as f64 + shift];
            observed.iter().enumerate().map(place).collect()
        };
        let height = (FRAME + ROW * n).clamp(HEIGHTS[0], HEIGHTS[1]);
        plot.size(Size::FIGURE.high(height)).y_range(n - 0.4, -0.6).y_names(self.names(observed));
        let measured = row(0.0, &|s| s.measured);
        let before = row(-0.22, &|s| s.model[0]);
        let after = row(0.22, &|s| s.model[1]);
        let all: Vec<f64> =
            [&measured, &before, &after].into_iter().flatten().map(|p| p[0]).collect();
        let [low, high] = ends(&all);
        if low > 0.0 && high > WIDE * low {
            plot.log_x();
        }
        plot.series("model as given", Mark::Hollow, Colour::Given, before);
        plot.series("measured", Mark::Points, Colour::Measured, measured);
        plot.series("improved", Mark::Points, Colour::Improved, after);
        let bars = [-1.0, 1.0].map(|side| row(0.22, &|s: &Observed| s.model[1] + side * s.sd));
        for (from, to) in bars[0].iter().zip(&bars[1]) {
            plot.series("", Mark::Line, Colour::Improved, vec![*from, *to]);
        }
        plot.note("Held-out frames. Bars: one standard deviation of the improved model.");
        Some(plot)
    }

    /// Names of the places of a statistic: captures, or numbers as in the table below.
    fn names(&self, observed: &[Observed]) -> Vec<(f64, String)> {
        let design = &self.diagnosis.measured.holdout.design;
        let name = |(i, s): (usize, &Observed)| {
            let name = match s.key.0 {
                Place::Stack(at) => {
                    design.conditions.get(at).map(|c| c.stack.id.replace('-', " "))
                }
                _ => None,
            };
            (i as f64, name.unwrap_or_else(|| (i + 1).to_string()))
        };
        observed.iter().enumerate().map(name).collect()
    }
}

/// What was proposed, as the report has it: its curve, or its map over a sensor of some columns and
/// rows, in the frames to fit and in both models.
pub fn proposed(shown: &Shown, [width, height]: [usize; 2]) -> Option<Picture> {
    let values = [&shown.measured, &shown.model_before, &shown.model_after]
        .map(|all| all.iter().map(|v| v.unwrap_or(f64::NAN)).collect::<Vec<f64>>());
    let Some(columns) = shown.columns else {
        return Some(Picture::Plot(Box::new(curve(shown, values))));
    };
    let rows = values[0].len().checked_div(columns)?;
    let [measured, before, after] =
        values.map(|data| Plane { width: columns, height: rows, data });
    let (name, unit) = shown.y.rsplit_once(", ").unwrap_or((&shown.y, ""));
    let title = crate::emva::capitalised(name);
    let titles = [&title[..], LESS_GIVEN, LESS_IMPROVED];
    let ranges = [width, height].map(|n| [0.0, n as f64]);
    let names = ["column", "row"];
    let mut plots = triple(titles, [&measured, &before, &after], names, ranges, unit);
    plots[0].note("Frames to fit, means of cells.");
    Some(Picture::Maps(Box::new(plots)))
}

/// Measured values along a curve, beside both models.
fn curve(shown: &Shown, [measured, before, after]: [Vec<f64>; 3]) -> Plot {
    let name = |words: &str| words.split(", ").next().unwrap_or(words).to_owned();
    let title = crate::emva::capitalised(&format!("{} over {}", name(&shown.y), name(&shown.x)));
    let mut plot = Plot::new(&title, &shown.x, &shown.y);
    let [low, high] = ends(&shown.at);
    let gaps: Vec<f64> = shown.at.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let [narrow, broad] = ends(&gaps);
    // Columns and phases are even steps; light levels are not.
    if low > 0.0 && high > WIDE * low && broad > EVEN * narrow {
        plot.log_x();
    }
    let points = |values: Vec<f64>| shown.at.iter().zip(values).map(|(x, y)| [*x, y]).collect();
    plot.series("measured", Mark::Points, Colour::Measured, points(measured));
    plot.series("model as given", Mark::Dashed, Colour::Given, points(before));
    plot.series("improved", Mark::Line, Colour::Improved, points(after));
    plot.note("Frames to fit, and the same of frames simulated by either model.");
    plot
}

fn of_map(planes: &Planes, what: What) -> Picture {
    let plot = match what {
        What::ColumnPattern
        | What::ColumnPatternPeak
        | What::ColumnPeriod(_)
        | What::EveryOtherColumn => profile(planes, true),
        What::RowPattern | What::RowPatternPeak | What::RowPeriod(_) | What::EveryOtherRow => {
            profile(planes, false)
        }
        What::PixelPattern
        | What::Tails
        | What::High
        | What::Low
        | What::Skewness
        | What::Kurtosis => distribution(planes),
        _ => return Picture::Maps(Box::new(maps(planes))),
    };
    Picture::Plot(Box::new(plot))
}

/// Three maps in cells.
pub(super) fn maps(planes: &Planes) -> [Plot; 3] {
    let [width, height] = [planes.all[0].width, planes.all[0].height];
    let side = width.div_ceil(CELLS).next_multiple_of(2);
    let cells = planes.all.each_ref().map(|plane| in_cells(plane, side));
    let name = crate::emva::capitalised(planes.name);
    let titles = [&name[..], LESS_GIVEN, LESS_IMPROVED];
    let ranges = [width, height].map(|n| [0.0, (n / side * side) as f64]);
    let [measured, before, after] = &cells;
    let mut plots =
        triple(titles, [measured, before, after], ["column", "row"], ranges, planes.unit);
    plots[0].note(&format!("Held-out frames, means of cells of {side} × {side} pixels."));
    for (plot, model) in plots[1..].iter_mut().zip([before, after]) {
        let left: Vec<f64> = measured.data.iter().zip(&model.data).map(|(a, b)| a - b).collect();
        let text = crate::numbers::amount(spread(&left), None, planes.unit);
        plot.note(&format!("Standard deviation {text}."));
    }
    plots
}

pub(super) fn in_cells(plane: &Plane<f64>, side: usize) -> Plane<f64> {
    Plane::from_fn(plane.width / side, plane.height / side, |x, y| {
        let rows = (y * side..(y + 1) * side).map(|row| &plane.row(row)[x * side..(x + 1) * side]);
        rows.flatten().sum::<f64>() / (side * side) as f64
    })
}

/// Means of columns, or rows, less the frame's.
pub(super) fn profile(planes: &Planes, of_columns: bool) -> Plot {
    let [line, lines] = if of_columns { ["column", "columns"] } else { ["row", "rows"] };
    let [measured, before, after] = planes.all.each_ref().map(|p| line_means(p, of_columns));
    let axis = format!("mean of a {line} less the frame's, {}", planes.unit);
    let mut plot = Plot::new(&format!("{} of the {lines}", first_word(planes.name)), line, &axis);
    let sigma = spread(&after);
    let shown = measured.len().min(LINES);
    let last = shown as f64 - 1.0;
    let side = 2.0 * sigma;
    plot.x_range(0.0, last);
    let band = vec![[0.0, -side, side], [last, -side, side]];
    plot.band("improved, ± 2 σ", Colour::Improved, band);
    let of = |values: &[f64]| {
        values[..shown].iter().enumerate().map(|(i, v)| [i as f64, *v]).collect::<Vec<_>>()
    };
    plot.series("measured", Mark::Line, Colour::Measured, of(&measured));
    plot.series("model as given", Mark::Line, Colour::Given, of(&before));
    let part = match shown < measured.len() {
        true => format!(" The first {shown} of {}.", measured.len()),
        false => String::new(),
    };
    plot.note(&format!(
        "A pattern is the sensor's own: the model predicts its width, not its values.{part}"
    ));
    plot
}

fn first_word(name: &str) -> String {
    crate::emva::capitalised(name.split([' ', ',']).next().unwrap_or_default())
}

fn line_means(plane: &Plane<f64>, of_columns: bool) -> Vec<f64> {
    let (w, h) = (plane.width, plane.height);
    let mut sums = vec![0.0; if of_columns { w } else { h }];
    for (i, v) in plane.data.iter().enumerate() {
        sums[if of_columns { i % w } else { i / w }] += v;
    }
    let count = if of_columns { h } else { w } as f64;
    let mean = sums.iter().sum::<f64>() / (w * h) as f64;
    sums.iter().map(|s| s / count - mean).collect()
}

/// Share of the pixels that deviate by so much or more.
fn distribution(planes: &Planes) -> Plot {
    let axis = format!("deviation from the median, at least, {}", planes.unit);
    let title = format!("Pixels: {}", planes.name);
    let mut plot = Plot::new(&title, &axis, "share of the pixels, %");
    plot.log_x().log_y().note("How many pixels deviate by so much or more, to either side.");
    let roles = [
        ("measured", Mark::Points, Colour::Measured),
        ("model as given", Mark::Dashed, Colour::Given),
        ("improved", Mark::Line, Colour::Improved),
    ];
    for (plane, (name, mark, colour)) in planes.all.iter().zip(roles) {
        plot.series(name, mark, colour, shares(&plane.data));
    }
    plot
}

/// Deviation and share of the pixels that reach it, per cent, from the commonest to the rarest.
fn shares(values: &[f64]) -> Vec<[f64; 2]> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let Some(&median) = sorted.get(sorted.len() / 2) else { return Vec::new() };
    let mut sides: Vec<f64> = values.iter().map(|v| (v - median).abs()).collect();
    sides.sort_by(|a, b| b.total_cmp(a));
    let n = sides.len() as f64;
    let ranks = (0..=POINTS).map(|i| libm::pow(BEGIN * n, 1.0 - i as f64 / POINTS as f64));
    let mut ranks: Vec<usize> =
        ranks.map(|r| (r.round() as usize).clamp(1, sides.len())).collect();
    ranks.dedup();
    ranks.into_iter().map(|r| [sides[r - 1], 100.0 * r as f64 / n]).collect()
}

/// Standard deviation.
fn spread(values: &[f64]) -> f64 {
    let n = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / n;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()
}

fn ends(values: &[f64]) -> [f64; 2] {
    values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], &v| [a.min(v), b.max(v)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn profiles_and_cells_are_means() {
        let plane = Plane::from_fn(4, 2, |x, y| (x + 10 * y) as f64);
        assert_eq!(line_means(&plane, true), [-1.5, -0.5, 0.5, 1.5]);
        assert_eq!(line_means(&plane, false), [-5.0, 5.0]);
        assert_eq!(in_cells(&plane, 2).data, [5.5, 7.5]);
    }

    fn shown(columns: Option<usize>) -> Shown {
        let values = |v: f64| vec![Some(v), None, Some(2.0 * v), Some(v)];
        Shown {
            at: if columns.is_some() { Vec::new() } else { vec![0.0, 1.0, 2.0, 3.0] },
            columns,
            measured: values(3.0),
            model_after: values(3.0),
            model_before: values(0.0),
            x: "column".into(),
            y: "offset, e⁻".into(),
        }
    }

    #[test]
    fn what_was_proposed_is_drawn_as_its_curve_or_map() {
        let Some(Picture::Plot(plot)) = proposed(&shown(None), [64, 32]) else {
            panic!("a curve");
        };
        assert_eq!(plot.title(), "Offset over column");
        let svg = plot.svg();
        assert_eq!(svg.matches("<circle").count(), 4, "3 values and the legend: {svg}");
        let Some(Picture::Maps(maps)) = proposed(&shown(Some(2)), [64, 32]) else {
            panic!("maps");
        };
        assert_eq!(maps[0].title(), "Offset");
        assert!(proposed(&shown(Some(0)), [64, 32]).is_none());
    }

    #[test]
    fn shares_fall_to_one_pixel() {
        let values: Vec<f64> = (0..1000).map(f64::from).collect();
        let all = shares(&values);
        assert_eq!(all.last().unwrap(), &[500.0, 0.1]);
        assert!(all.windows(2).all(|p| p[0][0] <= p[1][0] && p[0][1] > p[1][1]));
    }
}
