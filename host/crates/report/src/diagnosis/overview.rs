//! What a sensor engineer looks at first: measured less model as maps, profiles of columns and rows,
//! dark level and variance over exposure, photon transfer, histograms, the level of each frame.

use super::pictures::{LESS_GIVEN, LESS_IMPROVED, Maps, Planes, in_cells, maps, profile};
use crate::emva::capitalised;
use crate::page::Page;
use crate::plot::{Colour, Mark, Plot, triple};
use camrig_base::{Plane, Result};
use camrig_diagnose::data::design::Condition;
use camrig_diagnose::measured::Half;
use camrig_diagnose::search::Evaluation;
use camrig_diagnose::statistics::maps::MapKind;
use camrig_diagnose::statistics::statistic::{Place, What};

/// Maps that are shown.
const MAPS: [MapKind; 3] = [MapKind::Offset, MapKind::DarkCurrent, MapKind::Gain];
/// Most stacks in one plot of histograms or of frames' levels, by their colours.
const STACKS: usize = 6;
/// Cells across a picture of a target, at most.
const CELLS: usize = 120;
/// Steps of a histogram, at most.
const BINS: usize = 200;

/// The pictures that open the page, explained or not.
///
/// # Errors
/// Models that the sensor refuses.
pub fn section(page: &mut Page, shown: &Maps<'_>) -> Result<()> {
    page.heading("Measured and model");
    let (half, outcome) = (&shown.diagnosis.measured.holdout, &shown.diagnosis.outcome);
    let models = [&outcome.before, &outcome.after];
    page.grid(|page| {
        for plot in curves(half, models) {
            page.plot(&plot);
        }
    });
    for planes in MAPS.into_iter().filter_map(|kind| shown.planes(kind)) {
        of_map(page, &planes);
    }
    for (target, picture) in half.design.targets.iter().zip(half.pictures.iter()) {
        let [before, after] = models.map(|m| half.picture(&m.camera, target));
        of_target(page, &target.stack.id, [&picture.mean, &before?, &after?]);
    }
    Ok(())
}

/// A map less both models, and its profiles.
fn of_map(page: &mut Page, planes: &Planes) {
    page.subheading(&capitalised(planes.name));
    page.grid(|page| {
        for plot in &maps(planes) {
            page.plot(plot);
        }
    });
    page.grid(|page| {
        page.plot(&profile(planes, true)).plot(&profile(planes, false));
    });
}

/// The mean picture of a target less both models.
fn of_target(page: &mut Page, id: &str, planes: [&Plane<f32>; 3]) {
    let [width, height] = [planes[0].width, planes[0].height];
    let side = width.div_ceil(CELLS).next_multiple_of(2);
    let cells = planes.map(|p| {
        let data = p.data.iter().map(|v| f64::from(*v)).collect();
        in_cells(&Plane { width, height, data }, side)
    });
    let ranges = [width, height].map(|n| [0.0, (n / side * side) as f64]);
    let name = id.replace('-', " ");
    let [measured, before, after] = &cells;
    let titles = [&name[..], LESS_GIVEN, LESS_IMPROVED];
    let plots = triple(titles, [measured, before, after], ["column", "row"], ranges, "DN");
    page.subheading(&format!("Picture of {name}"));
    page.grid(|page| {
        for plot in &plots {
            page.plot(plot);
        }
    });
}

/// A statistic of a stack, the mean of its channels.
type OfStack<'a> = dyn Fn(usize, fn(u8) -> What) -> Option<f64> + 'a;
/// A point of a plot from a stack and its statistics.
type Point<'a> = dyn Fn(usize, &Condition, &OfStack<'_>) -> Option<[f64; 2]> + 'a;

/// Level and noise of the stacks, and what is in their frames.
fn curves(half: &Half, models: [&Evaluation; 2]) -> Vec<Plot> {
    let level = |i: usize, of: &dyn Fn((Place, What)) -> Option<f64>, what: fn(u8) -> What| {
        let values: Vec<f64> =
            (0..u8::MAX).map_while(|c| of((Place::Stack(i), what(c)))).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    };
    let over = |title: &str,
                [x, y]: [&str; 2],
                pick: &dyn Fn(&Condition) -> bool,
                points: &Point<'_>| {
        let mut plot = Plot::new(title, x, y);
        let all = |of: &dyn Fn((Place, What)) -> Option<f64>| -> Vec<[f64; 2]> {
            let stacks = half.design.conditions.iter().enumerate().filter(|(_, c)| pick(c));
            let mut out: Vec<[f64; 2]> =
                stacks.filter_map(|(i, c)| points(i, c, &|i, what| level(i, of, what))).collect();
            out.sort_by(|a, b| a[0].total_cmp(&b[0]));
            out
        };
        let measured = all(&|key| half.values.get(&key).map(|s| s.value));
        let [before, after] = models.map(|m| all(&|key| m.holdout.of.get(&key).map(|p| p.value)));
        let several = measured.len() > 1;
        plot.series("model as given", Mark::Dashed, Colour::Given, before);
        plot.series("improved", Mark::Line, Colour::Improved, after);
        plot.series("measured", Mark::Points, Colour::Measured, measured);
        several.then_some(plot)
    };
    let is_dark = |c: &Condition| !c.is_flat();
    let plots = [
        over(
            "Dark level over exposure",
            ["exposure, s", "level less the shortest dark's, DN"],
            &is_dark,
            &|i, c, of| Some([c.stack.exposure_s, of(i, What::Mean)?]),
        ),
        over(
            "Dark variance over exposure",
            ["exposure, s", "variance over time, DN²"],
            &is_dark,
            &|i, c, of| Some([c.stack.exposure_s, of(i, What::Variance)?]),
        ),
        over(
            "Photon transfer",
            ["level above dark, DN", "variance over time, DN²"],
            &Condition::is_flat,
            &|i, _, of| Some([of(i, What::Mean)?, of(i, What::Variance)?]),
        ),
    ];
    let stacks = [histograms(half), frames(half)];
    plots.into_iter().chain(stacks).flatten().collect()
}

/// How often each code occurs.
fn histograms(half: &Half) -> Option<Plot> {
    let mut plot = Plot::new("Histogram of codes", "code, DN", "samples per code");
    plot.log_y();
    for (k, (c, t)) in
        half.design.conditions.iter().zip(half.stacks.iter()).enumerate().take(STACKS)
    {
        let first = t.histogram.iter().position(|n| *n > 0)?;
        let last = t.histogram.iter().rposition(|n| *n > 0)?;
        let step = (last - first + 1).div_ceil(BINS);
        let counts: Vec<f64> = t.histogram[first..=last]
            .chunks(step)
            .map(|c| f64::from(c.iter().sum::<u32>()) / c.len() as f64)
            .collect();
        let name = c.stack.id.replace('-', " ");
        plot.bins(&name, Colour::Series(k), [first as f64 - 0.5, step as f64], &counts);
    }
    (!half.stacks.is_empty()).then_some(plot)
}

/// The level of each frame against its stack's: the worst frames stand out.
fn frames(half: &Half) -> Option<Plot> {
    let mut plot =
        Plot::new("Level of each frame", "frame of the stack", "less the stack's mean, DN");
    for (k, (c, t)) in
        half.design.conditions.iter().zip(half.stacks.iter()).enumerate().take(STACKS)
    {
        let mean = t.frame_means.iter().sum::<f64>() / t.frame_means.len().max(1) as f64;
        let points = t.frame_means.iter().enumerate().map(|(i, m)| [i as f64, m - mean]).collect();
        plot.series(&c.stack.id.replace('-', " "), Mark::LinePoints, Colour::Series(k), points);
    }
    (!half.stacks.is_empty()).then_some(plot)
}
