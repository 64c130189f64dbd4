//! The page of a diagnosis: what differed and by how much, what explains it, where it is visible,
//! what is left.

mod left;
mod overview;
mod pictures;
mod words;

use self::pictures::{Maps, Picture};
use super::numbers::{counted, fixed, number};
use super::page::{KeyFigure, Page, Table, Tone};
use super::plot::{Colour, Mark, Plot, Size};
use camrig_base::Result;
use camrig_diagnose::Diagnosis;
use camrig_diagnose::measured::{Half, Measured};
use camrig_diagnose::report::{self, EMPIRICAL, Report, Status, Verdict};
use camrig_diagnose::search::forward::Step;
use camrig_diagnose::statistics::statistic::{Key, Place};
use camrig_diagnose::verdict::improved::ImprovedFile;
use camrig_diagnose::verdict::words as statistics;

/// Most statistics listed as evidence of an effect.
const MAX_EVIDENCE: usize = 5;
/// Most letters of an effect's name next to the headline on a phone.
const MAX_SHORT_NAME: usize = 18;
/// Room on the axis of gaps, as factors: below the least for its figure, and above the largest.
const ROOM: [f64; 2] = [6.0, 2.0];
/// Height of a row of the headline and of what is around the rows, px.
const ROW: f64 = 40.0;
const FRAME: f64 = 76.0;

/// The page of a diagnosis with its improved camera file; `command` is what was typed.
///
/// # Errors
/// Models that the sensor refuses.
pub fn page(diagnosis: &Diagnosis, improved: &ImprovedFile, command: &str) -> Result<String> {
    let (found, outcome) = (&diagnosis.report, &diagnosis.outcome);
    let camera = &outcome.before.camera;
    let mut page = Page::new(&format!("Diagnosis of {}", camera.name));
    page.kind("Diagnosis").command(command).subtitle(&subtitle(&diagnosis.measured));
    page.opening(
        |page| {
            let (tone, word) = verdict(found.verdict);
            page.badge(tone, word);
            page.change(&number(found.gap_before), &number(found.gap_after));
            page.paragraph(&in_words(found));
        },
        |page| {
            page.headline(|size| gaps(found, size));
        },
    );
    let maps = Maps::new(diagnosis)?;
    overview::section(&mut page, &maps)?;
    page.key_figures(&cards(found));
    left::families(&mut page, &found.families);
    for note in &found.notes {
        page.note(&format!("{}.", super::emva::capitalised(&words::printed(note))));
    }
    if let Some(first) = &found.superseded {
        page.note(&format!(
            "{} was named first; another in its place explains more.",
            words::kind(first)
        ));
    }
    left::evidence(&mut page, &found.evidence);
    // Shapes come first in the report, and are not steps of the search.
    let proposed = found.steps.iter().filter(|s| s.effect == EMPIRICAL).count();
    for (i, step) in found.steps.iter().enumerate() {
        let of_search = i.checked_sub(proposed).and_then(|i| outcome.steps.get(i));
        effect(&mut page, &maps, (i + 1, step), of_search);
    }
    left::section(&mut page, diagnosis);
    left::nuisances(&mut page, &found.nuisances);
    left::paper_measures(&mut page, &found.measures);
    page.heading("Improved camera file");
    match &*improved.additions {
        "" => page.paragraph("Nothing was added to the camera file."),
        added => page
            .paragraph("Written to camera-improved.toml; what was added or changed:")
            .verbatim(added),
    };
    page.folded_on_screen("The whole file", |page| {
        page.verbatim(&improved.text);
    });
    Ok(page.html())
}

/// How many frames of what size.
fn subtitle(measured: &Measured) -> String {
    let halves = match measured.can_confirm {
        true => vec![&measured.fit.design, &measured.holdout.design],
        false => vec![&measured.fit.design],
    };
    let stacks = |d: &camrig_diagnose::data::design::Design| -> Vec<(usize, usize)> {
        let conditions = d.conditions.iter().map(|c| &c.stack);
        let all = conditions.chain(d.targets.iter().map(|t| &t.stack));
        all.map(|s| (s.capture, s.frames)).collect()
    };
    let all: Vec<(usize, usize)> = halves.into_iter().flat_map(stacks).collect();
    let frames: usize = all.iter().map(|s| s.1).sum();
    let mut captures: Vec<usize> = all.iter().map(|s| s.0).collect();
    captures.sort_unstable();
    captures.dedup();
    let size =
        measured.fit.stacks.first().map_or_else(String::new, |s| {
            format!(" of {} × {} pixels", s.mean.width, s.mean.height)
        });
    let captures = counted(captures.len(), "capture");
    format!("{}{size} in {captures}", counted(frames, "frame"))
}

fn verdict(verdict: Verdict) -> (Tone, &'static str) {
    match verdict {
        Verdict::Agrees => (Tone::Good, "the model agrees"),
        Verdict::Explained => (Tone::Good, "explained"),
        Verdict::PartlyExplained => (Tone::Warning, "partly explained"),
        Verdict::Unexplained => (Tone::Bad, "not explained"),
    }
}

/// The difference, its explanation and the rest, in a few sentences.
fn in_words(found: &Report) -> String {
    let (before, after) = (number(found.gap_before), number(found.gap_after));
    let limit = number(found.gap_limit);
    let n = found.steps.len();
    let (effects, account) = match n {
        1 => ("effect", "accounts"),
        _ => ("effects", "account"),
    };
    let scale = format!("a right model scores about 1 and passes up to {limit}");
    let fell = format!(
        "The gap on frames that took no part in the fit went from {before} to {after}; {scale}."
    );
    let first = match found.verdict {
        Verdict::Agrees => {
            return format!(
                "Camera file and captures agree: nothing is missing. The gap on held-out frames \
                 is {after}; {scale}."
            );
        }
        Verdict::Explained => format!(
            "{} {effects} {account} for the whole disagreement of camera file and captures.",
            words::number_word(n)
        ),
        Verdict::PartlyExplained => format!(
            "{} {effects} {account} for a part of the disagreement of camera file and captures; \
             the rest is below.",
            words::number_word(n)
        ),
        Verdict::Unexplained => {
            "Camera file and captures disagree, and no effect of the catalogue explains it.".into()
        }
    };
    format!("{first} {fell}")
}

/// The gap after each effect.
fn gaps(found: &Report, size: Size) -> Plot {
    let mut values = vec![found.gap_before];
    values.extend(found.steps.iter().map(|s| s.gap_after));
    let names =
        found.steps.iter().enumerate().map(|(i, s)| format!("{} · {}", i + 1, words::name(s)));
    let names = std::iter::once("model as given".to_owned()).chain(names);
    let names = names.map(|name| match size == Size::NARROW {
        true => shortened(&name),
        false => name,
    });
    let n = values.len();
    let axis = match size == Size::NARROW {
        true => "gap on held-out frames, right model 1",
        false => "gap on held-out frames, in units of a replicate of the right model",
    };
    let mut plot = Plot::new("", axis, "model, effect by effect");
    let known = values.iter().copied().filter(|v| v.is_finite() && *v > 0.0);
    let [least, most] =
        known.fold([found.gap_limit.min(1.0), found.gap_limit], |[a, b], v| [a.min(v), b.max(v)]);
    plot.size(size.high(FRAME + ROW * n as f64)).log_x();
    plot.x_range(least / ROOM[0], most * ROOM[1]).y_range(n as f64 - 0.4, -0.6);
    plot.y_names(names.enumerate().map(|(i, name)| (i as f64, name)).collect());
    for (i, pair) in values.windows(2).enumerate() {
        let row = i as f64 + 1.0;
        let [high, low] = [pair[0].max(pair[1]), pair[0].min(pair[1])];
        let bar = [low, high].map(|gap| [gap, row - 0.14, row + 0.14]);
        plot.band("", Colour::Reference, bar.to_vec());
    }
    let points: Vec<[f64; 2]> = values.iter().enumerate().map(|(i, v)| [*v, i as f64]).collect();
    let (given, improved) = points.split_at(1);
    plot.series("", Mark::Points, Colour::Given, given.to_vec());
    plot.series("", Mark::Points, Colour::Improved, improved.to_vec());
    for point in &points {
        plot.tag(*point, &number(point[0]));
    }
    plot.limit_x(found.gap_limit, &format!("limit {}", number(found.gap_limit)));
    plot.note("Each effect is added to those above it. Left of the limit a model passes.");
    plot
}

/// A name that a phone has room for.
fn shortened(name: &str) -> String {
    if name.chars().count() <= MAX_SHORT_NAME {
        return name.to_owned();
    }
    let kept: String = name.chars().take(MAX_SHORT_NAME - 1).collect();
    format!("{}…", kept.trim_end())
}

/// A card per effect: its name, its main amount, what it did to the gap.
fn cards(found: &Report) -> Vec<KeyFigure> {
    let card = |(i, step): (usize, &report::Step)| {
        let amounts = words::amounts(step);
        let name = format!("{} · {}", i + 1, words::name(step));
        let value = amounts.first().map_or("", |a| &a.value);
        let (tone, word) = match step.status {
            Status::Confirmed => (Tone::Good, "confirmed"),
            Status::Tentative => (Tone::Warning, "tentative"),
            Status::Proposed => (Tone::Warning, "proposed"),
        };
        let of = amounts.first().map_or_else(String::new, |a| lowered(&a.name) + " · ");
        let gap = format!("gap {} → {}", number(step.gap_before), number(step.gap_after));
        KeyFigure::new(&name, value).below(&format!("{of}{gap}")).status(tone, word)
    };
    found.steps.iter().enumerate().map(card).collect()
}

/// With a small first letter, unless the word is an abbreviation.
fn lowered(text: &str) -> String {
    let mut letters = text.chars();
    let second = text.chars().nth(1);
    match letters.next() {
        Some(first) if second.is_none_or(|c| !c.is_uppercase()) => {
            first.to_lowercase().chain(letters).collect()
        }
        _ => text.to_owned(),
    }
}

/// An effect: what it is, where it is visible, its amounts, the evidence for it.
fn effect(
    page: &mut Page,
    maps: &Maps<'_>,
    (number, step): (usize, &report::Step),
    of_search: Option<&Step>,
) {
    let evidence = |page: &mut Page| {
        if let Some(of_search) = of_search {
            moved(page, maps.diagnosis, of_search);
            candidates(page, of_search);
        }
    };
    let side = |page: &mut Page| {
        amounts(page, step);
        evidence(page);
    };
    let proposed = || pictures::proposed(step.shown.as_ref()?, maps.sides());
    page.together(|page| {
        page.heading(&format!("{number} · {}", words::name(step)));
        page.paragraph(&words::sentence(step));
        match of_search.and_then(|s| maps.picture(s)).or_else(proposed) {
            Some(Picture::Maps(plots)) => {
                page.grid(|page| {
                    for plot in plots.iter() {
                        page.plot(plot);
                    }
                });
                page.beside(|page| amounts(page, step), evidence);
            }
            Some(Picture::Plot(plot)) => {
                page.evidence(
                    |page| {
                        page.plot(&plot);
                    },
                    side,
                );
            }
            None => side(page),
        }
    });
}

fn amounts(page: &mut Page, step: &report::Step) {
    let facts: Vec<(String, String)> =
        words::amounts(step).into_iter().map(|a| (a.name, a.value)).collect();
    if !facts.is_empty() {
        page.subheading("Amount").facts(&facts);
    }
}

/// The statistics whose deviation fell most.
fn moved(page: &mut Page, diagnosis: &Diagnosis, step: &Step) {
    let (camera, held_out) = (diagnosis.improved(), &diagnosis.measured.holdout);
    let mut table = Table::new(&["where", "statistic"]).numbers(&["σ before", "σ after"]);
    table.rows(step.moved.iter().take(MAX_EVIDENCE).map(|m| {
        vec![
            place(held_out, m.key),
            statistics::name(camera, m.key),
            fixed(m.before, 1),
            fixed(m.after, 1),
        ]
    }));
    page.subheading("Evidence").rows(&table);
    page.small("Deviation of the held-out frames from the model, standard deviations σ.");
    if step.observed.iter().any(|s| !matches!(s.key.0, Place::Stack(_))) && step.observed.len() > 1
    {
        places(page, diagnosis, step);
    }
}

/// The places of the statistic that shows an effect best, by the numbers of its plot.
fn places(page: &mut Page, diagnosis: &Diagnosis, step: &Step) {
    page.folded(&format!("The statistic at {} places", step.observed.len()), |page| {
        let mut table = Table::new(&["", "where", "statistic"]);
        table.rows(step.observed.iter().enumerate().map(|(i, s)| {
            let name = statistics::name(diagnosis.improved(), s.key);
            vec![(i + 1).to_string(), place(&diagnosis.measured.holdout, s.key), name]
        }));
        page.rows(&table);
    });
}

fn place(half: &Half, key: Key) -> String {
    let text = statistics::place(&half.design, key);
    text.strip_prefix("capture ").map_or(text.clone(), |id| id.replace('-', " "))
}

/// All candidates of the round.
fn candidates(page: &mut Page, step: &Step) {
    let all = std::iter::once(&step.trial).chain(&step.others);
    let compared = counted(step.others.len() + 1, "candidate");
    page.folded(&format!("{compared} compared"), |page| {
        let mut table =
            Table::new(&["candidate"]).numbers(&["gain, fit", "gain, held out", "gap left"]);
        table.rows(all.map(|t| {
            let gains = [t.evidence, t.confirmed].map(|gain| fixed(gain, 1));
            let [fit, held_out] = gains;
            vec![words::kind(t.proposal.kind), fit, held_out, number(t.gap)]
        }));
        page.rows(&table);
        page.small("Gain: twice the increase of the log-likelihood.");
    });
}
