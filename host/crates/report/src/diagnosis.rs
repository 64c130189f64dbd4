//! The report of a diagnosis: what gave each effect away, how the gap shrank, what is left.

use super::page::Page;
use super::plot::{Mark, Plot, heat_map};
use camrig_base::Plane;
use camrig_diagnose::maps::Map;
use camrig_diagnose::search::{Outcome, Step};
use camrig_diagnose::session::Session;
use camrig_diagnose::statistics::Place;
use camrig_diagnose::{measures, prediction, verdict, words};
use serde_json::Value;

/// Colours of measured, model before, model after.
const COLOURS: [&str; 3] = ["#1c1f23", "#d55e00", "#009e73"];
/// Side of the cells in pictures of maps, pixels.
const CELL: usize = 16;

/// The page. `improved` is the text of the improved camera file, `command` what was typed.
pub fn page(session: &Session, outcome: &Outcome, improved: &str, command: &str) -> String {
    let mut page = Page::new("Diagnosis");
    let found = verdict::report(session, outcome);
    let text = |key: &str| found[key].as_str().unwrap_or("").to_string();
    let number = |key: &str| found[key].as_f64().unwrap_or(f64::NAN);
    page.paragraph(&format!(
        "Verdict: {}. The gap on held-out frames went from {:.2} to {:.2}; 1 is what a replicate of the right model scores, \
         {:.2} the limit that the right model passes once in some two hundred sets. {} statistics.",
        text("verdict"),
        number("gap_before"),
        number("gap_after"),
        number("gap_limit"),
        number("statistics"),
    ));
    for note in &session.notes {
        page.paragraph(&format!("Note: {note}."));
    }
    if !outcome.steps.is_empty() {
        page.heading("What was found").table(
            &["effect", "status", "parameters", "gap before", "after", "where"],
            &rows(&found["steps"]),
        );
        page.drawing(&gaps(outcome), "Gap on held-out frames, step by step");
    }
    if let Some(doubted) = found["doubted"].as_str() {
        page.paragraph(&format!(
            "{doubted} was named first; a search that begins without it explains more."
        ));
    }
    for (i, step) in outcome.steps.iter().enumerate() {
        step_section(&mut page, session, outcome, step, i + 1);
    }
    paper_measures(&mut page, session, outcome);
    page.heading("All statistics").drawing(
        &deviations(session, outcome),
        "Deviations of the held-out frames in standard deviations, in the order of the first model's: before and after",
    );
    let left = found["unexplained"].as_array().cloned().unwrap_or_default();
    page.heading("What is left");
    if left.is_empty() {
        page.paragraph("No statistic is unexplained.");
    }
    for item in &left {
        page.paragraph(item["description"].as_str().unwrap_or(""));
    }
    if let Some(nearest) = verdict::nearest(&found) {
        page.paragraph(&nearest);
    }
    for item in found["ambiguous"].as_array().into_iter().flatten() {
        page.paragraph(&format!(
            "These captures hardly tell apart: {}. What would: {}.",
            item["effects"],
            item["tie_breaker"].as_str().unwrap_or("")
        ));
    }
    page.heading("Maps of the captures");
    for map in &session.fit.maps {
        page.drawing(&picture(map), words::map(map.kind));
    }
    page.heading("Improved camera file").verbatim(improved);
    page.heading("Command").verbatim(command);
    page.html()
}

fn rows(steps: &Value) -> Vec<Vec<String>> {
    let figure = |v: &Value| v.as_f64().map_or("-".to_string(), |v| format!("{v:.2}"));
    steps
        .as_array()
        .into_iter()
        .flatten()
        .map(|s| {
            let parameters: Vec<String> = s["parameters"]
                .as_object()
                .into_iter()
                .flatten()
                .map(|(key, p)| {
                    let value = p["value"].as_f64().unwrap_or(f64::NAN);
                    match p["std_error"].as_f64() {
                        Some(se) => format!("{key} {value:.4e} ± {se:.1e}"),
                        None => format!("{key} {value:.4}"),
                    }
                })
                .collect();
            vec![
                s["effect"].as_str().unwrap_or("").into(),
                s["status"].as_str().unwrap_or("").into(),
                parameters.join(", "),
                figure(&s["gap_before"]),
                figure(&s["gap_after"]),
                s["where"].as_str().unwrap_or("").into(),
            ]
        })
        .collect()
}

fn gaps(outcome: &Outcome) -> String {
    let mut points = vec![[0.0, outcome.gaps.0]];
    points.extend(outcome.steps.iter().enumerate().map(|(i, s)| [i as f64 + 1.0, s.gap_after]));
    let end = points.len() as f64 - 1.0;
    let limit = outcome.after.limit();
    let mut plot = Plot::new("Gap", "effects named", "held-out gap");
    plot.log_y().coloured("gap", Mark::Line, points.clone(), COLOURS[2]);
    plot.coloured("", Mark::Points, points, COLOURS[2]);
    plot.coloured(
        "limit of the right model",
        Mark::Dashed,
        vec![[0.0, limit], [end, limit]],
        COLOURS[1],
    );
    plot.svg()
}

fn step_section(page: &mut Page, session: &Session, outcome: &Outcome, step: &Step, number: usize) {
    let design = &session.holdout.design;
    page.heading(&format!("Step {number}: {}", step.trial.proposal.kind));
    let name =
        step.gave_away.first().map(|g| words::name(&outcome.after.camera, g.0)).unwrap_or_default();
    if !step.seen.is_empty() {
        let series = |of: &dyn Fn(&camrig_diagnose::search::Seen) -> f64| -> Vec<[f64; 2]> {
            step.seen.iter().enumerate().map(|(i, s)| [i as f64 + 1.0, of(s)]).collect()
        };
        // Of a single place the model is a level.
        let lines = |of: &dyn Fn(&camrig_diagnose::search::Seen) -> f64| match series(of)[..] {
            [[x, y]] => vec![[x - 0.5, y], [x + 0.5, y]],
            _ => series(of),
        };
        // Less the model after: what a step adds is small beside how the statistic runs over the places.
        let mut plot = Plot::new(&name, "place (as in the table)", "less the model after");
        plot.coloured("measured", Mark::Points, series(&|s| s.measured - s.model[1]), COLOURS[0]);
        plot.coloured("model before", Mark::Line, lines(&|s| s.model[0] - s.model[1]), COLOURS[1]);
        plot.coloured("model after", Mark::Line, lines(&|_| 0.0), COLOURS[2]);
        for (name, side) in [("± 2 standard deviations", 2.0), ("", -2.0)] {
            plot.coloured(name, Mark::Dashed, lines(&|s| side * s.sd), "#9ad0bd");
        }
        page.drawing(
            &plot.svg(),
            &format!("{name}: the statistic that gave it away, held-out frames"),
        );
        let places: Vec<Vec<String>> = step
            .seen
            .iter()
            .enumerate()
            .map(|(i, s)| {
                let figure = |v: f64| format!("{v:.5}");
                vec![
                    (i + 1).to_string(),
                    of_look(session, outcome, s.key),
                    figure(s.measured),
                    figure(s.model[0]),
                    figure(s.model[1]),
                    figure(s.sd),
                ]
            })
            .collect();
        page.table(
            &["", "place", "measured", "model before", "after", "standard deviation"],
            &places,
        );
    }
    let moved: Vec<Vec<String>> = step
        .gave_away
        .iter()
        .map(|(key, before, after)| {
            vec![
                words::place(design, *key),
                words::name(&outcome.after.camera, *key),
                format!("{before:+.1}"),
                format!("{after:+.1}"),
            ]
        })
        .collect();
    page.table(&["where", "statistic", "z before", "z after"], &moved);
    let candidates: Vec<Vec<String>> = std::iter::once(&step.trial)
        .chain(&step.others)
        .map(|t| {
            vec![
                t.proposal.kind.into(),
                format!("{:.1}", t.evidence),
                format!("{:.1}", t.confirmed),
                format!("{:.2}", t.gap),
            ]
        })
        .collect();
    page.paragraph("Candidates: twice the gain in log-likelihood of the frames to fit and of the held-out ones, and the gap that would be left.");
    page.table(&["candidate", "evidence", "held out", "gap"], &candidates);
}

/// Place of a statistic, with its name where one picture gives many.
fn of_look(session: &Session, outcome: &Outcome, key: prediction::Key) -> String {
    let place = words::place(&session.holdout.design, key);
    match key.0 {
        Place::Look(_) => format!("{place}: {}", words::name(&outcome.after.camera, key)),
        _ => place,
    }
}

/// The paper's measures, where the set shows them.
fn paper_measures(page: &mut Page, session: &Session, outcome: &Outcome) {
    let m = measures::measures(session, outcome);
    if m.mtf_at_nyquist.is_empty() && m.luminance_scatter.is_empty() {
        return;
    }
    page.heading("MTF, patches and rows");
    page.paragraph(
        "The measures of Chen et al. 2009, section VI, on held-out frames: response of the edge at half a cycle per pixel; mean \
         absolute difference of the luminance's standard deviation from the model's, all patches and without the dark \
         ones; root mean square difference of a row.",
    );
    let mut rows: Vec<Vec<String>> = Vec::new();
    for r in &m.mtf_at_nyquist {
        rows.push(vec![
            r.capture.clone(),
            format!(
                "MTF at Nyquist, channel {} (measured {:.3} ± {:.3})",
                r.channel, r.measured, r.std_dev
            ),
            format!("{:.3}", r.before),
            format!("{:.3}", r.after),
        ]);
    }
    for s in &m.luminance_scatter {
        let percent = |[all, bright]: [f64; 2]| format!("{all:.1} %, {bright:.1} %");
        let what = format!(
            "scatter of the luminance, all patches and without the dark ones (two sensors of one kind: {})",
            percent(s.expected)
        );
        rows.push(vec![s.capture.clone(), what, percent(s.before), percent(s.after)]);
    }
    for r in &m.row_profile {
        let dn = |v: f64| format!("{v:.2} DN");
        rows.push(vec![r.capture.clone(), "row profile".into(), dn(r.before), dn(r.after)]);
    }
    page.table(&["capture", "measure", "model before", "after"], &rows);
}

/// Deviations before and after, in the order of those before.
fn deviations(session: &Session, outcome: &Outcome) -> String {
    let [before, after] = [&outcome.before, &outcome.after].map(|s| {
        let [_, holdout] = session.deviations(s);
        holdout
    });
    let mut keys: Vec<prediction::Key> = before.keys().copied().collect();
    keys.sort_by(|a, b| before[a].total_cmp(&before[b]));
    // Signed root scale: hundreds and units on one drawing.
    let scale = |z: f64| z.signum() * z.abs().sqrt();
    let series = |of: &std::collections::BTreeMap<prediction::Key, f64>| -> Vec<[f64; 2]> {
        keys.iter().enumerate().filter_map(|(i, k)| Some([i as f64, scale(*of.get(k)?)])).collect()
    };
    let mut plot = Plot::new("Deviations", "statistic", "signed root of the deviation");
    plot.coloured("before", Mark::Points, series(&before), COLOURS[1]);
    plot.coloured("after", Mark::Points, series(&after), COLOURS[2]);
    plot.svg()
}

/// A map in cells of 16x16 pixels.
fn picture(map: &Map) -> String {
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
    heat_map(
        words::map(map.kind),
        &plane,
        [0.0, map.plane.width as f64],
        [0.0, map.plane.height as f64],
        "column, row",
        false,
    )
}
