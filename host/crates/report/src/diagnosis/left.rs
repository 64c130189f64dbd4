//! What a diagnosis leaves unexplained, and disturbances in the captures.

use super::words::{kind, number_word, printed};
use crate::numbers::{amount, count, counted, digits, fixed, number};
use crate::page::{Page, Table};
use crate::plot::{Colour, Mark, Plot};
use camrig_diagnose::Diagnosis;
use camrig_diagnose::report::{Evidence, FamilyGap, Finding, Measures, Report};

/// Most frames listed of a finding.
const MAX_FRAMES: usize = 8;
/// Deviation from which statistics are counted, standard deviations.
const FAR: f64 = 3.0;
/// Fraction of normal deviates beyond it.
const BY_CHANCE: f64 = 0.0027;
/// Smallest deviation that is drawn, standard deviations.
const SMALLEST: f64 = 0.01;
/// Points of a curve of all deviations, at most.
const POINTS: usize = 300;

/// What is left: all deviations against chance, and the statistics that stay unexplained.
pub fn section(page: &mut Page, diagnosis: &Diagnosis) {
    let (found, outcome) = (&diagnosis.report, &diagnosis.outcome);
    page.heading("What is left");
    let [before, after] = [&outcome.before, &outcome.after].map(|model| {
        let [_, held_out] = &model.deviations;
        let mut sizes: Vec<f64> = held_out.values().map(|z| z.abs().max(SMALLEST)).collect();
        sizes.sort_by(f64::total_cmp);
        sizes
    });
    page.evidence(
        |page| {
            page.plot(&deviations(&before, &after, !outcome.steps.is_empty()));
        },
        |page| {
            page.subheading(&match found.unexplained.len() {
                0 => "No statistic is unexplained".to_owned(),
                1 => "One statistic is unexplained".to_owned(),
                n => format!("{} statistics are unexplained", number_word(n)),
            });
            let far = after.iter().filter(|z| **z > FAR).count();
            page.paragraph(&format!(
                "Of {} of the held-out frames, {far} {} beyond {FAR} standard deviations; {} are \
                 expected by chance. The largest is {}.",
                counted(after.len(), "statistic"),
                if far == 1 { "lies" } else { "lie" },
                digits(BY_CHANCE * after.len() as f64, 2),
                after.last().map_or_else(String::new, |z| digits(*z, 2)),
            ));
            open(page, found);
        },
    );
}

/// The statistics that stay unexplained, the worst first, and the nearest effects.
fn open(page: &mut Page, found: &Report) {
    if !found.unexplained.is_empty() {
        let mut table = Table::new(&[]).numbers(&["severity"]).words(&["what is left"]);
        table.rows(found.unexplained.iter().map(|left| {
            vec![format!("{}\u{a0}σ", digits(left.z.abs(), 2)), printed(&left.description)]
        }));
        page.rows(&table);
    }
    if !found.nearest.is_empty() {
        let kinds: Vec<String> = found.nearest.iter().map(|k| kind(k).to_lowercase()).collect();
        page.paragraph(&format!(
            "Nearest in the catalogue, but leaving too much unexplained to be named: {}.",
            kinds.join(", ")
        ));
    }
    for pair in &found.ambiguous {
        let [a, b] = pair.effects.each_ref().map(|k| kind(k).to_lowercase());
        page.note(&format!(
            "These captures cannot distinguish {a} from {b}. These would: {}.",
            pair.tie_breaker
        ));
    }
}

/// All deviations in order of size, before and after, against those of chance alone.
fn deviations(before: &[f64], after: &[f64], improved: bool) -> Plot {
    let n = after.len();
    let mut plot = Plot::new(
        "Every statistic, against chance",
        &format!("rank among the {} statistics", count(n as u64)),
        "deviation, standard deviations",
    );
    plot.log_y().x_range(0.0, n as f64);
    let every = n.div_ceil(POINTS).max(1);
    let curve = |sizes: &[f64]| -> Vec<[f64; 2]> {
        let last = sizes.len().saturating_sub(1);
        let kept = sizes.iter().enumerate().filter(|(i, _)| i % every == 0 || *i == last);
        kept.map(|(i, z)| [i as f64 + 0.5, *z]).collect()
    };
    plot.series("model as given", Mark::Line, Colour::Given, curve(before));
    if improved {
        plot.series("improved", Mark::Line, Colour::Improved, curve(after));
    }
    let chance = (0..64).map(|i| (f64::from(i) + 0.5) / 64.0);
    let chance = chance.map(|p| [p * n as f64, half_normal(p).max(SMALLEST)]).collect();
    plot.series("chance alone", Mark::Dashed, Colour::Reference, chance);
    plot.note("Sorted. Where a line follows the dashed one, the rest is noise.");
    plot
}

/// The size that a standard normal deviate stays below with a probability, by bisection.
fn half_normal(p: f64) -> f64 {
    let below = |z: f64| libm::erf(z / std::f64::consts::SQRT_2);
    let (mut low, mut high) = (0.0, 10.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if below(middle) < p { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Disturbances: what in the captures is not the sensor's steady behaviour.
pub fn nuisances(page: &mut Page, found: &[Finding]) {
    if found.is_empty() {
        return;
    }
    page.heading("Disturbances in the captures");
    let mut table = Table::new(&["what", "captures"]).numbers(&["count", "amount"]).words(&[
        "frames",
        "treatment",
        "description",
    ]);
    table.rows(found.iter().map(|f| {
        let frames: Vec<String> = f.frames.iter().take(MAX_FRAMES).map(usize::to_string).collect();
        let more = if f.frames.len() > MAX_FRAMES { ", ..." } else { "" };
        vec![
            f.kind.to_string().replace('-', " "),
            f.place.clone(),
            count(f.count as u64),
            f.amount.map_or(String::new(), |a| amount(a, f.std_error, &f.unit)),
            frames.join(", ") + more,
            f.done.to_string().replace('-', " "),
            printed(&f.description),
        ]
    }));
    page.rows(&table);
}

/// Effects by their own statistics: those that are there first.
pub fn evidence(page: &mut Page, found: &[Evidence]) {
    if found.is_empty() {
        return;
    }
    page.heading("Effects by their own evidence");
    page.paragraph(
        "Each effect from the statistic that shows it, captures against the same figure of \
         simulated frames: in standard errors, for the model as given and for the improved one. \
         The false-alarm rate is the chance that one of all these tests deviates by so much where \
         nothing is hidden.",
    );
    let mut table = Table::new(&["effect", "status"])
        .numbers(&["as given", "improved", "false alarms"])
        .words(&["amounts", "shown by"]);
    let mut sorted: Vec<&Evidence> = found.iter().collect();
    sorted.sort_by_key(|e| !e.is_named());
    table.rows(sorted.into_iter().map(|e| {
        let figure = |v: f64| if v.is_finite() { format!("{v:+.1}") } else { String::new() };
        vec![
            e.effect.replace('-', " "),
            e.status.words().to_owned(),
            figure(e.deviation),
            figure(e.deviation_after),
            if e.false_alarm < 1e-3 { "below 0.001".into() } else { number(e.false_alarm) },
            printed(&e.amounts_in_words()),
            printed(&e.description),
        ]
    }));
    page.rows(&table);
}

/// The gap by families of statistics, each with its furthest statistic in its unit.
pub fn families(page: &mut Page, found: &[FamilyGap]) {
    if found.is_empty() {
        return;
    }
    page.heading("By families of statistics");
    let mut table = Table::new(&["family"])
        .numbers(&["statistics", "gap as given", "gap improved"])
        .words(&["furthest from the improved model"]);
    table.rows(found.iter().map(|f| {
        let [before, after] = [f.gap_before, f.gap_after].map(number);
        vec![f.family.clone(), f.statistics.to_string(), before, after, printed(&f.worst)]
    }));
    page.rows(&table);
    page.small("Gap: mean square deviation of the held-out frames; a right model has about 1.");
}

/// The paper's measures, where the set shows them.
pub fn paper_measures(page: &mut Page, m: &Measures) {
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
    let mut table = Table::new(&["capture", "measure"]).numbers(&["model as given", "improved"]);
    for r in &m.mtf_at_nyquist {
        table.row(vec![
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
        let percent = |[all, bright]: [f64; 2]| {
            format!("{}\u{a0}%, {}\u{a0}%", fixed(all, 1), fixed(bright, 1))
        };
        let what = format!(
            "scatter of the luminance, all patches and without the dark ones (two sensors of one \
             kind: {})",
            percent(s.expected)
        );
        table.row(vec![s.capture.clone(), what, percent(s.before), percent(s.after)]);
    }
    for r in &m.row_profile {
        let dn = |v: f64| amount(v, None, "DN");
        table.row(vec![r.capture.clone(), "row profile".into(), dn(r.before), dn(r.after)]);
    }
    page.rows(&table);
}

#[cfg(test)]
mod tests {
    use super::half_normal;

    #[test]
    fn two_thirds_lie_within_one_standard_deviation() {
        assert!((half_normal(0.682_689_492_137) - 1.0).abs() < 1e-9);
        assert!((half_normal(0.997_300_203_937) - 3.0).abs() < 1e-9);
    }
}
