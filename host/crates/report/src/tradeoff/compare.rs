//! Settings against each other: heat maps or lines over what was swept, and the frontier.

use super::table::{Figure, Setting, Settings, Swept, short, spoken, spoken_value};
use super::{Chosen, MAX_LINES, capital, in_sentence};
use crate::numbers::number;
use crate::page::Page;
use crate::plot::{Cells, Colour, Mark, Plot, Scale, Size};

/// Maximum number of rows and columns of a table of two parameters.
const MAX_CELLS: usize = 12;
/// Ratio of the largest to the smallest value from which an axis is logarithmic.
const DECADE: f64 = 10.0;

/// Two parameters that were swept, rows and columns of a table, and the setting whose others
/// are kept.
pub(super) struct Axes<'a> {
    pub row: usize,
    pub column: usize,
    pub rows: Vec<f64>,
    pub columns: Vec<f64>,
    around: &'a Setting,
}

impl<'a> Axes<'a> {
    /// The first two parameters that are numbers, around a setting.
    pub fn of(settings: &'a Settings, around: &'a Setting) -> Option<Self> {
        let numeric = (0..settings.names.len())
            .filter_map(|i| settings.numbers(i).map(|values| (i, values)))
            .filter(|(_, values)| values.len() <= MAX_CELLS);
        let mut numeric: Vec<(usize, Vec<f64>)> = numeric.collect();
        numeric.truncate(2);
        let (column, columns) = numeric.pop()?;
        let (row, rows) = numeric.pop()?;
        Some(Self { row, column, rows, columns, around })
    }

    /// The setting of each cell, row by row.
    pub fn cells(&self, settings: &'a Settings) -> Vec<Option<&'a Setting>> {
        let at = |row: f64, column: f64| {
            settings.all.iter().find(|s| {
                (0..s.values.len()).all(|i| match i {
                    i if i == self.row => s.values[i].number() == Some(row),
                    i if i == self.column => s.values[i].number() == Some(column),
                    i => s.values[i] == self.around.values[i],
                })
            })
        };
        self.rows.iter().flat_map(|&r| self.columns.iter().map(move |&c| at(r, c))).collect()
    }
}

/// Heat maps of two parameters or lines over one, and the frontier.
pub(super) fn comparison(
    page: &mut Page,
    settings: &Settings,
    differ: &[&Figure],
    ranked: &[&Figure],
    chosen: Option<&Chosen<'_>>,
) {
    let best = ranked.first().and_then(|f| Settings::best(settings.all.iter(), f));
    let around = chosen.and_then(|c| c.setting).or(best);
    let axes = around.and_then(|around| Axes::of(settings, around));
    let mut plots: Vec<Plot> = Vec::new();
    match &axes {
        Some(axes) => {
            plots.extend(ranked.iter().map(|f| heat_map(settings, axes, f, chosen)));
        }
        None => {
            for figure in differ {
                plots.extend(
                    (0..settings.names.len()).filter_map(|over| draw(settings, figure, over)),
                );
            }
        }
    }
    plots.extend(frontier(settings, axes.as_ref(), ranked, chosen));
    if plots.is_empty() {
        return;
    }
    page.heading("Comparison of settings");
    if let (Some(axes), Some(around)) = (&axes, around) {
        let others = settings.words(around, &[axes.row, axes.column]);
        let others = match &others[..] {
            "" => String::new(),
            others => format!(" All with {others}."),
        };
        let region = match chosen.is_some_and(|c| !c.needs.is_empty()) {
            true => " Heavy border: settings that meet the need.",
            false => "",
        };
        let outlined = match chosen {
            Some(_) => "Outlined: the optimum.",
            None => "Outlined: the best value of each figure.",
        };
        page.paragraph(&format!("{outlined}{region}{others}"));
    }
    page.grid(|page| {
        plots.iter().for_each(|plot| {
            page.plot(plot);
        });
    });
}

fn is_wide(values: impl Iterator<Item = f64>) -> bool {
    let [low, high] =
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
    low > 0.0 && high / low >= DECADE
}

/// A figure over two parameters with the numbers in the cells.
fn heat_map(
    settings: &Settings,
    axes: &Axes<'_>,
    figure: &Figure,
    chosen: Option<&Chosen<'_>>,
) -> Plot {
    let of_cells = axes.cells(settings);
    let values: Vec<Option<f64>> =
        of_cells.iter().map(|s| Some(s.as_ref()?.mean(figure)?.value)).collect();
    let names = |index: usize, values: &[f64]| {
        let name = &settings.names[index];
        let text = |&v: &f64| match &name[..] {
            "lens.f_number" => format!("f/{}", short(v)),
            _ => short(v),
        };
        values.iter().map(text).collect::<Vec<_>>()
    };
    let mut cells =
        Cells::new(names(axes.column, &axes.columns), names(axes.row, &axes.rows), values.clone());
    let own = || Settings::best(of_cells.iter().flatten().copied(), figure);
    let best = match chosen {
        Some(chosen) => chosen.setting,
        None => own(),
    };
    let place = best
        .and_then(|best| of_cells.iter().position(|s| s.is_some_and(|s| s.values == best.values)));
    if let Some(i) = place {
        cells.best(i % axes.columns.len(), i / axes.columns.len());
    }
    if let Some(chosen) = chosen.filter(|c| !c.needs.is_empty()) {
        let inside = of_cells.iter().map(|s| s.is_some_and(|s| chosen.meets(s)));
        cells.region(&inside.collect::<Vec<_>>());
    }
    let known = || values.iter().flatten().copied();
    let ends = known().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
    let mut scale = Scale::amounts(ends, figure.unit);
    if is_wide(known()) {
        scale = scale.logarithmic();
    }
    if figure.less_is_better == Some(true) {
        scale = scale.reversed();
    }
    let axis = |index: usize| spoken(&settings.names[index]);
    let mut plot = cells.plot(figure.name, [&axis(axes.column), &axis(axes.row)], &scale);
    if values.iter().any(Option::is_none) {
        plot.note("Empty: not determined, or outside the range of light.");
    }
    plot
}

/// A figure over a parameter that is a number.
fn draw(settings: &Settings, figure: &Figure, over: usize) -> Option<Plot> {
    let values = settings.numbers(over)?;
    let x = spoken(&settings.names[over]);
    let short_x = x.split(", ").next().unwrap_or(&x);
    let mut plot = Plot::new(&format!("{} against {short_x}", figure.name), &x, &figure.words());
    if is_wide(values.into_iter()) {
        plot.log_x();
    }
    let mut lines = settings.lines(figure, over);
    lines.retain(|line| line.points.len() > 1);
    let all = lines.len();
    let peak = |points: &[[f64; 2]]| {
        points.iter().map(|p| figure.sign() * p[1]).fold(f64::NEG_INFINITY, f64::max)
    };
    if all > MAX_LINES {
        lines.sort_by(|a, b| peak(&b.points).total_cmp(&peak(&a.points)));
        lines.truncate(MAX_LINES);
    }
    for (i, line) in lines.iter().enumerate() {
        let label = settings.words(line.of, &[over]);
        plot.series(&label, Mark::LinePoints, Colour::Series(i), line.points.clone());
    }
    if all > MAX_LINES {
        plot.note(&format!("The best {MAX_LINES} of {all} settings."));
    }
    (!lines.is_empty()).then_some(plot)
}

/// Two figures against each other: what more of one costs of the other. They are those of the
/// choice, or the first two of which each has a best.
fn frontier(
    settings: &Settings,
    axes: Option<&Axes<'_>>,
    ranked: &[&Figure],
    chosen: Option<&Chosen<'_>>,
) -> Option<Plot> {
    let x = chosen.map(|c| c.best).or(ranked.first().copied())?;
    let need = chosen.and_then(|c| c.needs.first());
    let others = ranked.iter().copied().find(|f| f.key != x.key);
    let y = need.map(|n| n.0).filter(|f| f.key != x.key).or(others)?;
    let place = |s: &Setting| Some([s.mean(x)?.value, s.mean(y)?.value]);
    let points: Vec<[f64; 2]> = settings.all.iter().filter_map(place).collect();
    let beats = |a: &[f64; 2], b: &[f64; 2]| {
        let ahead = [x.sign() * (a[0] - b[0]), y.sign() * (a[1] - b[1])];
        ahead[0] >= 0.0 && ahead[1] >= 0.0 && ahead[0] + ahead[1] > 0.0
    };
    let mut front: Vec<[f64; 2]> =
        points.iter().filter(|p| !points.iter().any(|other| beats(other, p))).copied().collect();
    if points.len() < 2 {
        return None;
    }
    front.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let title = format!("{} against {}", y.name, in_sentence(x.name));
    let mut plot = Plot::new(&title, &x.words(), &y.words());
    if is_wide(points.iter().map(|p| p[0])) {
        plot.log_x();
    }
    let height = 262.0 + if axes.is_some() { 60.0 } else { 0.0 };
    plot.size(Size::FIGURE.high(height));
    let bars = match axes.filter(|a| a.columns.len() <= MAX_LINES && settings.names.len() == 2) {
        Some(axes) => {
            by_column(&mut plot, settings, axes, [x, y]);
            " Bars: one standard error."
        }
        None => {
            plot.series("settings", Mark::Points, Colour::Reference, points);
            ""
        }
    };
    plot.series("Pareto frontier", Mark::Dashed, Colour::Reference, front);
    if let Some((figure, need)) = need.filter(|n| n.0.key == y.key) {
        plot.limit_y(*need, &format!("needed: {} {}", number(*need), figure.unit));
    }
    if let Some(at) = chosen.and_then(|c| c.setting).and_then(place) {
        plot.ring(at);
    }
    let better = |f: &Figure, less: &'static str, more: &'static str| {
        if f.less_is_better == Some(true) { less } else { more }
    };
    let ring =
        if chosen.is_some_and(|c| c.setting.is_some()) { " Ring: the optimum." } else { "" };
    plot.note(&format!(
        "{} and {} is better.{ring}{bars}",
        capital(better(y, "down", "up")),
        better(x, "left", "right"),
    ));
    Some(plot)
}

/// A line of settings for each column of a table, with bars of the errors of y.
fn by_column(plot: &mut Plot, settings: &Settings, axes: &Axes<'_>, [x, y]: [&Figure; 2]) {
    let cells = axes.cells(settings);
    for (i, column) in axes.columns.iter().enumerate() {
        let of_column = cells.iter().skip(i).step_by(axes.columns.len()).flatten();
        let point = |s: &&Setting| {
            let y = s.mean(y)?;
            Some([s.mean(x)?.value, y.value, y.std_error.unwrap_or(0.0)])
        };
        let points: Vec<[f64; 3]> = of_column.filter_map(point).collect();
        let name = spoken_value(&settings.names[axes.column], &Swept::Number(*column));
        plot.with_errors(&name, Mark::LinePoints, Colour::Series(i), &points);
    }
}
