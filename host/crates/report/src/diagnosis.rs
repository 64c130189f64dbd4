//! The report of a diagnosis: what gave each effect away, how the gap shrank, what is left.

use super::numbers::{self, amount, digits, fixed, number};
use super::page::{Page, Table, Tone};
use super::plot::{Colour, Mark, Plot, Scale, heat_map};
use camrig_base::Plane;
use camrig_camera::EffectKind;
use camrig_diagnose::report::{self, Finding, Report};
use camrig_diagnose::search::forward::{Observed, Step};
use camrig_diagnose::search::{Outcome, Session};
use camrig_diagnose::statistics::maps::Map;
use camrig_diagnose::statistics::{Key, Place};
use camrig_diagnose::verdict::words;
use std::collections::BTreeMap;

/// Frames of a finding that are listed, at most.
const FRAMES: usize = 8;
/// Side of the cells in pictures of maps, pixels.
const CELL: usize = 16;

/// The page of what was found. `improved` is the text of the improved camera file, `command` what
/// was typed.
pub fn page(
    session: &Session,
    outcome: &Outcome,
    found: &Report,
    improved: &str,
    command: &str,
) -> String {
    let mut page = Page::new("Diagnosis");
    page.kind("Diagnosis").command(command);
    let tone = if found.gap_after <= found.gap_limit { Tone::Good } else { Tone::Warning };
    let words = format!(
        "The gap on held-out frames went from {} to {}; 1 is what a replicate of the right model \
         scores, {} the limit that the right model passes once in some two hundred sets. {} \
         statistics.",
        number(found.gap_before),
        number(found.gap_after),
        number(found.gap_limit),
        found.statistics,
    );
    page.verdict(tone, found.verdict.word(), &words);
    page.change(&number(found.gap_before), &number(found.gap_after));
    for note in &found.notes {
        page.note(&format!("{note}."));
    }
    if !found.nuisances.is_empty() {
        nuisances(&mut page, &found.nuisances);
    }
    if !found.steps.is_empty() {
        page.heading("What was found").table(
            &["effect", "status", "parameters", "gap before", "after", "where"],
            &rows(&found.steps),
        );
        page.plot(&gaps(found));
    }
    if let Some(first) = &found.doubted {
        page.paragraph(&format!(
            "{first} was named first; a search that begins without it explains more."
        ));
    }
    for (i, step) in outcome.steps.iter().enumerate() {
        step_section(&mut page, session, outcome, (i + 1, step));
    }
    paper_measures(&mut page, &found.measures);
    page.heading("All statistics").plot(&deviations(session, outcome));
    page.heading("What is left");
    if found.unexplained.is_empty() {
        page.paragraph("No statistic is unexplained.");
    }
    for left in &found.unexplained {
        page.paragraph(&left.description);
    }
    if let Some(nearest) = found.nearest_in_words() {
        page.paragraph(&nearest);
    }
    for pair in &found.ambiguous {
        page.paragraph(&format!(
            "These captures hardly tell apart: {}. What would: {}.",
            pair.names(),
            pair.tie_breaker
        ));
    }
    page.heading("Maps of the captures").grid(|page| {
        for map in &session.fit.maps {
            page.plot(&picture(map));
        }
    });
    page.heading("Improved camera file").verbatim(improved);
    page.html()
}

/// What is in the captures that is not the sensor's steady behaviour.
fn nuisances(page: &mut Page, found: &[Finding]) {
    page.heading("What is in the captures beside the sensor");
    let rows: Vec<Vec<String>> = found
        .iter()
        .map(|f| {
            let amount = f.amount.map_or(String::new(), |a| amount(a, f.std_error, &f.unit));
            let frames: Vec<String> = f.frames.iter().take(FRAMES).map(usize::to_string).collect();
            let more = if f.frames.len() > FRAMES { ", ..." } else { "" };
            vec![
                f.kind.word().into(),
                f.place.clone(),
                f.count.to_string(),
                amount,
                frames.join(", ") + more,
                f.done.word().into(),
                f.description.clone(),
            ]
        })
        .collect();
    page.table(&["what", "where", "count", "amount", "frames", "done", "in words"], &rows);
}

/// The table of effects found.
fn rows(steps: &[report::Step]) -> Vec<Vec<String>> {
    let parameter = |effect: &str, key: &str, p: &report::Parameter| {
        let kind = EffectKind::all().find(|kind| kind.kind == effect);
        let unit = kind.and_then(|kind| kind.parameters.iter().find(|p| p.key == key));
        let unit = unit.map_or("", |parameter| parameter.unit);
        format!("{key} {}", amount(p.value, p.std_error, unit))
    };
    steps
        .iter()
        .map(|s| {
            vec![
                s.effect.clone(),
                s.status.word().into(),
                s.parameters
                    .iter()
                    .map(|(key, p)| parameter(&s.effect, key, p))
                    .collect::<Vec<_>>()
                    .join(", "),
                number(s.gap_before),
                number(s.gap_after),
                s.place.clone(),
            ]
        })
        .collect()
}

/// Drawing of the gap over the steps.
fn gaps(found: &Report) -> Plot {
    let mut points = vec![[0.0, found.gap_before]];
    points.extend(found.steps.iter().enumerate().map(|(i, s)| [i as f64 + 1.0, s.gap_after]));
    let names = (0..points.len()).map(|i| (i as f64, i.to_string())).collect();
    let end = points.len() as f64 - 1.0;
    let mut plot = Plot::new("Gap", "effects named", "gap on held-out frames");
    plot.log_y().x_range(-0.2, end + 0.2).x_names(names).note("Step by step.");
    plot.series("", Mark::LinePoints, Colour::Improved, points);
    plot.limit_y(found.gap_limit, "limit of the right model");
    plot
}

/// What one step did: the statistic that moved most, all that moved, and the candidates of the
/// round.
fn step_section(
    page: &mut Page,
    session: &Session,
    outcome: &Outcome,
    (number, step): (usize, &Step),
) {
    let design = &session.holdout.design;
    page.heading(&format!("Step {number}: {}", step.trial.proposal.kind));
    let name =
        step.moved.first().map(|m| words::name(&outcome.after.camera, m.0)).unwrap_or_default();
    if !step.observed.is_empty() {
        page.plot(&observed(&name, &step.observed));
        let mut places = Table::new(&["", "place"]).numbers(&[
            "measured",
            "model before",
            "model after",
            "standard deviation",
        ]);
        places.rows(step.observed.iter().enumerate().map(|(i, s)| {
            let figures = [s.measured, s.model[0], s.model[1], s.sd].map(|v| digits(v, 5));
            let mut cells = vec![(i + 1).to_string(), place(session, outcome, s.key)];
            cells.extend(figures);
            cells
        }));
        page.rows(&places);
    }
    let mut moved = Table::new(&["where", "statistic"]).numbers(&["z before", "z after"]);
    moved.rows(step.moved.iter().map(|(key, before, after)| {
        vec![
            words::place(design, *key),
            words::name(&outcome.after.camera, *key),
            fixed(*before, 1),
            fixed(*after, 1),
        ]
    }));
    page.rows(&moved);
    let mut candidates = Table::new(&["candidate"]).numbers(&["evidence", "held out", "gap left"]);
    candidates.rows(std::iter::once(&step.trial).chain(&step.others).map(|t| {
        vec![
            t.proposal.kind.into(),
            fixed(t.evidence, 1),
            fixed(t.confirmed, 1),
            numbers::number(t.gap),
        ]
    }));
    page.paragraph(
        "Candidates: twice the gain in log-likelihood of the frames to fit and of the held-out \
         ones, and the gap that would be left.",
    );
    page.rows(&candidates);
}

/// Drawing of a statistic over its places: measured, and the model before and after. The model
/// after is subtracted, since a step is small beside how the statistic runs over the places.
fn observed(name: &str, observed: &[Observed]) -> Plot {
    let series = |of: &dyn Fn(&Observed) -> f64| -> Vec<[f64; 2]> {
        observed.iter().enumerate().map(|(i, s)| [i as f64 + 1.0, of(s)]).collect()
    };
    // Of a single place the model is a level.
    let lines = |of: &dyn Fn(&Observed) -> f64| match series(of)[..] {
        [[x, y]] => vec![[x - 0.5, y], [x + 0.5, y]],
        _ => series(of),
    };
    let mut plot = Plot::new(name, "place (as in the table)", "less the model after");
    plot.note("The statistic that gave it away, held-out frames.");
    let sides = [2.0, -2.0].map(|side| lines(&|s: &Observed| side * s.sd));
    let band = sides[0].iter().zip(&sides[1]).map(|(h, l)| [h[0], l[1], h[1]]).collect();
    plot.band("± 2 standard deviations", Colour::Improved, band);
    let before = lines(&|s| s.model[0] - s.model[1]);
    plot.series("model before", Mark::Line, Colour::Given, before);
    plot.series("model after", Mark::Line, Colour::Improved, lines(&|_| 0.0));
    let measured = series(&|s| s.measured - s.model[1]);
    plot.series("measured", Mark::Points, Colour::Measured, measured);
    plot
}

/// Place of a statistic, with its name where one target gives many.
fn place(session: &Session, outcome: &Outcome, key: Key) -> String {
    let place = words::place(&session.holdout.design, key);
    match key.0 {
        Place::Target(_) => format!("{place}: {}", words::name(&outcome.after.camera, key)),
        _ => place,
    }
}

/// The paper's measures, where the set shows them.
fn paper_measures(page: &mut Page, m: &report::Measures) {
    if m.mtf_at_nyquist.is_empty() && m.luminance_scatter.is_empty() {
        return;
    }
    page.heading("MTF, patches and rows");
    page.paragraph(
        "The measures of Chen et al. 2009, section VI, on held-out frames: response of the edge \
         at half a cycle per pixel; mean absolute difference of the luminance's standard \
         deviation from the model's, all patches and without the dark ones; root mean square \
         difference of a row.",
    );
    let mut rows: Vec<Vec<String>> = Vec::new();
    for r in &m.mtf_at_nyquist {
        rows.push(vec![
            r.capture.clone(),
            format!(
                "MTF at Nyquist, channel {} (measured {})",
                r.channel,
                amount(r.measured, Some(r.std_dev), "")
            ),
            number(r.before),
            number(r.after),
        ]);
    }
    for s in &m.luminance_scatter {
        let percent = |[all, bright]: [f64; 2]| format!("{all:.1} %, {bright:.1} %");
        let what = format!(
            "scatter of the luminance, all patches and without the dark ones (two sensors of one \
             kind: {})",
            percent(s.expected)
        );
        rows.push(vec![s.capture.clone(), what, percent(s.before), percent(s.after)]);
    }
    for r in &m.row_profile {
        let dn = |v: f64| amount(v, None, "DN");
        rows.push(vec![r.capture.clone(), "row profile".into(), dn(r.before), dn(r.after)]);
    }
    page.table(&["capture", "measure", "model before", "after"], &rows);
}

/// Deviations before and after, in the order of those before.
fn deviations(session: &Session, outcome: &Outcome) -> Plot {
    let [before, after] = [&outcome.before, &outcome.after].map(|s| {
        let [_, holdout] = session.deviations(s);
        holdout
    });
    let mut keys: Vec<Key> = before.keys().copied().collect();
    keys.sort_by(|a, b| before[a].total_cmp(&before[b]));
    // Signed root scale: hundreds and units on one drawing.
    let scale = |z: f64| z.signum() * z.abs().sqrt();
    let series = |of: &BTreeMap<Key, f64>| -> Vec<[f64; 2]> {
        keys.iter().enumerate().filter_map(|(i, k)| Some([i as f64, scale(*of.get(k)?)])).collect()
    };
    let mut plot = Plot::new("Deviations", "statistic", "signed root of the deviation");
    plot.note(
        "Deviations of the held-out frames in standard deviations, in the order of the first \
         model's: before and after.",
    );
    plot.series("before", Mark::Points, Colour::Given, series(&before));
    plot.series("after", Mark::Points, Colour::Improved, series(&after));
    plot
}

/// A map in cells of 16x16 pixels.
fn picture(map: &Map) -> Plot {
    let (w, h) = (map.plane.width / CELL, map.plane.height / CELL);
    let data: Vec<f64> = (0..w * h)
        .map(|i| {
            let (x, y) = (i % w * CELL, i / w * CELL);
            let rows = map.plane.data.chunks(map.plane.width).skip(y).take(CELL);
            let sum: f64 = rows.flat_map(|r| &r[x..x + CELL]).map(|&v| f64::from(v)).sum();
            sum / (CELL * CELL) as f64
        })
        .collect();
    let plane = Plane { width: w, height: h, data };
    let ranges = [map.plane.width, map.plane.height].map(|n| [0.0, n as f64]);
    let ends = plane
        .data
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], &v| [a.min(v), b.max(v)]);
    let scale = Scale::light(ends, "");
    heat_map(words::map(map.kind), &plane, ["column", "row"], ranges, &scale)
}
