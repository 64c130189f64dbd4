//! SNR of settings against light.

use super::MAX_LINES;
use super::compare::Axes;
use super::table::{
    ACCEPTABLE_DB, Figure, SNR, Setting, Settings, Swept, crossing, short, spoken_value,
};
use crate::numbers::number;
use crate::page::{Page, Table};
use crate::plot::{Colour, Mark, Plot, Size};

/// Maximum number of rows of the table next to the plot.
const MAX_ROWS: usize = 10;

/// SNR over light of the settings that need least of it, with the table of all; of many settings
/// small multiples.
pub(super) fn light(page: &mut Page, settings: &Settings, compared: &Settings) {
    let (Some(light), Some(snr)) = (settings.light(), Figure::of(SNR)) else { return };
    let mut lines = settings.lines(snr, light);
    lines.retain(|line| line.points.len() > 1);
    // Least light first; those that never reach it by their SNR at the end.
    let rank = |points: &[[f64; 2]]| match (crossing(points), points.first(), points.last()) {
        (Ok(lux), ..) => (1, lux),
        (_, Some(first), _) if first[1] >= ACCEPTABLE_DB => (0, -first[1]),
        (_, _, Some(last)) => (2, -last[1]),
        _ => (3, 0.0),
    };
    lines.sort_by(|a, b| {
        let (a, b) = (rank(&a.points), rank(&b.points));
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    let draw = |size: Size| {
        let mut plot =
            Plot::new("SNR against scene illuminance", "scene illuminance, lx", "SNR, dB");
        plot.size(size).log_x();
        for (i, line) in lines.iter().take(MAX_LINES).enumerate() {
            let label = settings.words(line.of, &[light]);
            plot.series(&label, Mark::LinePoints, Colour::Series(i), line.points.clone());
        }
        plot.limit_y(ACCEPTABLE_DB, "SNR 10: acceptable").limit_y(0.0, "SNR 1");
        if lines.len() > MAX_LINES {
            let all = lines.len();
            plot.note(&format!("The {MAX_LINES} of {all} settings that need least light."));
        }
        plot
    };
    let most = lines.iter().filter_map(|l| l.points.last()).map(|p| p[0]).fold(0.0, f64::max);
    let at_most = format!("SNR at {}\u{a0}lx, dB", short(most));
    let mut table = Table::new(&["setting"]).numbers(&["SNR 10 at, lx", &at_most]);
    for line in lines.iter().take(MAX_ROWS) {
        let at = line.points.iter().find(|p| p[0] == most);
        table.row(vec![
            settings.words(line.of, &[light]),
            crossing(&line.points).map_or_else(|words| words, number),
            at.map_or_else(String::new, |p| number(p[1])),
        ]);
    }
    page.heading("SNR against light").evidence(
        |page| {
            page.headline(draw);
        },
        |page| {
            page.rows(&table);
            page.small(match lines.len() > MAX_ROWS {
                true => "The settings that need least light; all settings are listed below.",
                false => "SNR of single pixels, with temporal and fixed-pattern noise; mean of the channels.",
            });
        },
    );
    if lines.len() > MAX_LINES {
        multiples(page, settings, compared, light);
    }
}

/// SNR over light for each value of a parameter, on equal axes.
fn multiples(page: &mut Page, settings: &Settings, compared: &Settings, light: usize) {
    let Some(snr) = Figure::of(SNR) else { return };
    let Some(around) = compared.all.first() else { return };
    let Some(axes) = Axes::of(compared, around).filter(|_| compared.names.len() == 2) else {
        return;
    };
    // Places in the table with the light.
    let with = |index: usize| if index >= light { index + 1 } else { index };
    let (row, column) = (with(axes.row), with(axes.column));
    let lines = settings.lines(snr, light);
    let ends = |of: usize| {
        let all = lines.iter().flat_map(|l| &l.points).map(|p| p[of]);
        all.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)])
    };
    let ([left, right], [low, high]) = (ends(0), ends(1));
    // Below an SNR of 1 is nothing to see.
    let [low, high] = [(low / 10.0).floor().max(0.0) * 10.0, (high / 10.0).ceil() * 10.0];
    let every = axes.rows.len().div_ceil(MAX_LINES - 2);
    page.heading("Each setting, with the same axes").small_multiples(|page| {
        for value in &axes.columns {
            let named =
                |index: usize, v: f64| spoken_value(&settings.names[index], &Swept::Number(v));
            let mut plot = Plot::new(&named(column, *value), "scene illuminance, lx", "SNR, dB");
            plot.size(Size::SMALL).log_x().x_range(left, right).y_range(low, high);
            for (i, of_row) in axes.rows.iter().step_by(every).enumerate() {
                let of = |s: &Setting| {
                    s.values[row].number() == Some(*of_row)
                        && s.values[column].number() == Some(*value)
                };
                if let Some(line) = lines.iter().find(|l| of(l.of)) {
                    let (name, colour) = (named(row, *of_row), Colour::Series(i));
                    plot.series(&name, Mark::Line, colour, line.points.clone());
                }
            }
            page.plot(plot.limit_y(ACCEPTABLE_DB, "SNR 10"));
        }
    });
}
