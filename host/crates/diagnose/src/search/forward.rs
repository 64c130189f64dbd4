//! Forward selection: adds the candidate that makes the frames to fit most likely, if the held-out
//! frames confirm it, until no candidate is significant.

use super::estimate::{fitted, propose};
use super::evaluation::{Evaluation, RUNS_ON_THE_WAY};
use super::trial::{EVIDENCE_IN_ALL, EVIDENCE_TO_FIT, TRIAL_RUNS, Trial, settle, try_out};
use super::veto;
use crate::candidates::proposal::{MIN_STRENGTH, Proposal, with_all};
use crate::measured::{Half, Measured};
use crate::model::prediction::bounded;
use crate::statistics::statistic::{Key, Place, What};
use camrig_base::Result;

/// Most candidates simulated in a round: the strongest by their estimators, which rank the right
/// one high; each costs two replicates, and those that are not hopeless two more.
const MAX_TRIALS: usize = 10;
/// Most of these that are estimated from targets: their strengths are likelihoods already, and each
/// takes a run of the optics stage.
const MAX_TARGET_TRIALS: usize = 4;
/// Replicates of every candidate, which show whether it is hopeless.
const FIRST_RUNS: u64 = TRIAL_RUNS / 2;
/// A candidate is hopeless if its evidence is less than that of the best by more than this, which
/// is the significance limit, and less than [`HOPELESS_FRACTION`] of it, and if it predicts the
/// held-out frames less well.
const HOPELESS_DEFICIT: f64 = EVIDENCE_IN_ALL;
/// Two pairs of replicates shrink the change of noisy statistics: on an STL-1001E they showed 0.57
/// of the evidence for hot pixels that four did.
const HOPELESS_FRACTION: f64 = 0.5;
/// Candidates whose parameters are refined in a round: the most likely after their trial.
const MAX_SETTLED: usize = 3;
/// Most effects added. Hidden sets contain up to six; real sensors have shown nine.
const MAX_EFFECTS: usize = 10;
/// Difference in deviance up to which a rival is as good as the winner: 3² for three standard
/// deviations.
pub(super) const RIVAL_MARGIN: f64 = 9.0;
/// Most statistics listed among those that a step changed.
const MAX_MOVED: usize = 8;

/// A statistic of the held-out frames and the predictions before and after a step, on its scale.
#[derive(Clone, Debug)]
pub struct Observed {
    /// Its name.
    pub key: Key,
    /// Measured.
    pub measured: f64,
    /// Predicted, before and after.
    pub model: [f64; 2],
    /// Standard deviation predicted by the model after the step.
    pub sd: f64,
}

/// One effect that was added.
#[derive(Clone)]
pub struct Step {
    /// The trial that won.
    pub trial: Trial,
    /// Held-out gap before.
    pub gap_before: f64,
    /// Held-out gap after.
    pub gap_after: f64,
    /// The other trials of the round, best first, one of each kind.
    pub others: Vec<Trial>,
    /// The statistic whose deviation fell most, in all captures.
    pub observed: Vec<Observed>,
    /// The held-out statistics whose deviation fell most.
    pub moved: Vec<Moved>,
}

/// A held-out statistic with its deviations before and after a step, standard deviations.
#[derive(Clone, Copy, Debug)]
pub struct Moved {
    /// Its name.
    pub key: Key,
    /// Deviation before the step.
    pub before: f64,
    /// Deviation after the step.
    pub after: f64,
}

/// Kinds that the captures cannot distinguish.
#[derive(Clone, Debug)]
pub struct Rivals {
    /// The one that was added.
    pub taken: String,
    /// The one that explains as much.
    pub rival: String,
}

/// Effects that were selected, and the model with them.
#[derive(Clone)]
pub struct Selection {
    /// The model.
    pub model: Evaluation,
    /// Effects in the order in which they were found.
    pub steps: Vec<Step>,
    /// Kinds that the captures cannot distinguish.
    pub confounded: Vec<Rivals>,
    /// Kinds that explain much, but do harm elsewhere, when nothing else was left to add.
    pub barred: Vec<String>,
}

impl Selection {
    /// No effects beside those of a model.
    pub(super) fn empty(model: Evaluation) -> Self {
        Self { model, steps: Vec::new(), confounded: Vec::new(), barred: Vec::new() }
    }

    /// What was found, with a rival in the place of an effect that it had lost to: the search goes
    /// on from there. `own` is the model with that effect, `model` the one with the rival.
    pub(super) fn exchanged(
        measured: &Measured,
        found: Found<'_>,
        own: &Evaluation,
        model: Evaluation,
        (displaced, rival): (&Step, &Trial),
    ) -> Self {
        let kind = displaced.trial.proposal.kind;
        let mut others = displaced.others.clone();
        others.retain(|t| t.proposal.kind != rival.proposal.kind);
        others.insert(0, displaced.trial.clone());
        let mut steps = found.steps.to_vec();
        steps.retain(|s| s.trial.proposal.kind != kind);
        steps.push(step(&measured.holdout, own, &model, rival.clone(), others));
        Self { model, steps, confounded: found.confounded.to_vec(), barred: Vec::new() }
    }
}

/// What a search has found so far.
#[derive(Clone, Copy)]
pub(super) struct Found<'a> {
    pub model: &'a Evaluation,
    pub steps: &'a [Step],
    pub confounded: &'a [Rivals],
}

/// The effects that stand out by their own evidence, put in together. Where they do harm, or explain
/// nothing, those are left out without which the frames are likelier; one alone must do no harm.
pub(super) fn seeded(
    measured: &Measured,
    before: &Evaluation,
    mut seeds: Vec<Proposal>,
) -> Result<Selection> {
    if seeds.is_empty() {
        return Ok(Selection::empty(before.clone()));
    }
    let given = before.by(measured, RUNS_ON_THE_WAY)?.deviance();
    let with = |seeds: &[Proposal]| {
        let camera = with_all(&before.camera, seeds);
        Evaluation::new(measured, camera, seeds.to_vec(), RUNS_ON_THE_WAY)
    };
    seeds.sort_by(|a, b| b.strength.total_cmp(&a.strength));
    let mut model = with(&seeds)?;
    let is_better = |m: &Evaluation| m.deviance() < given;
    while !is_better(&model) || veto::bars(measured, before, &model) {
        let alone = model.named.len() == 1;
        let without = |i: usize| {
            let mut rest = model.named.clone();
            rest.remove(i);
            with(&rest)
        };
        let all = (0..model.named.len()).map(without).collect::<Result<Vec<_>>>()?;
        let likeliest = all.into_iter().min_by(|a, b| a.deviance().total_cmp(&b.deviance()));
        let Some(rest) = likeliest else { break };
        if is_better(&model) && !alone && rest.deviance() > model.deviance() {
            break;
        }
        model = rest;
    }
    if model.named.is_empty() {
        return Ok(Selection::empty(before.clone()));
    }
    let seeded = |proposal: &Proposal| {
        // The square of a deviation is the deviance that it makes, in both halves together.
        let each = 0.5 * proposal.strength.powi(2);
        let trial = Trial {
            proposal: proposal.clone(),
            evidence: each,
            confirmed: each,
            gap: model.gap,
            explains: f64::NAN,
        };
        step(&measured.holdout, before, &model, trial, Vec::new())
    };
    let steps = model.named.iter().map(seeded).collect();
    Ok(Selection { steps, ..Selection::empty(model) })
}

/// Adds the best candidate of each round until none is significant. `wanted` is whether a kind may
/// be added; `trying` receives what is being tried.
pub(super) fn select(
    measured: &Measured,
    start: Selection,
    wanted: &dyn Fn(&str) -> bool,
    trying: &(dyn Fn(&str) + Sync),
) -> Result<Selection> {
    let mut selection = start;
    for _ in 0..MAX_EFFECTS {
        let model = &selection.model;
        let mut brief = brief_trials(measured, model, wanted, trying)?;
        selection.barred.clear();
        // What does harm must not hide what does none.
        let held = loop {
            let trials = hopeful(measured, model, &brief)?;
            let settled = settled(measured, model, &trials)?;
            let barred = &mut selection.barred;
            let known = barred.len();
            if let Some(held) = first_that_holds(measured, model, &settled, barred)? {
                break Some((held, settled, trials));
            }
            if barred.len() == known {
                break None;
            }
            brief.retain(|t| !barred.iter().any(|kind| kind == t.proposal.kind));
        };
        let Some(((best, next), settled, trials)) = held else { break };
        let others = others(&best, settled, trials);
        if let Some(rival) = others.first().filter(|r| is_rival(&best, r)) {
            let [taken, rival] = [&best, rival].map(|t| t.proposal.kind.to_string());
            selection.confounded.push(Rivals { taken, rival });
        }
        let mut added = step(&measured.holdout, model, &next, best, others);
        let Proposal { kind, beside, .. } = added.trial.proposal;
        // What has evidence of its own has it with other values too.
        added.trial.proposal.by_evidence |=
            next.named.iter().any(|p| p.kind == kind && p.by_evidence);
        selection.steps.retain(|s| beside || s.trial.proposal.kind != kind);
        selection.steps.push(added);
        selection.model = next;
    }
    Ok(selection)
}

/// The candidates of a round, simulated by few replicates.
fn brief_trials(
    measured: &Measured,
    model: &Evaluation,
    wanted: &dyn Fn(&str) -> bool,
    trying: &(dyn Fn(&str) + Sync),
) -> Result<Vec<Trial>> {
    let mut proposals = propose(&measured.fit, model.model(), wanted, MIN_STRENGTH);
    prune(&mut proposals);
    let try_briefly = |p: &Proposal| {
        trying(p.kind);
        Ok(try_out(measured, model, p, FIRST_RUNS)?.0)
    };
    proposals.iter().map(try_briefly).collect()
}

/// Those that are not hopeless, simulated by all replicates, the most likely first: a sequential
/// design (Wald 1945).
fn hopeful(measured: &Measured, model: &Evaluation, brief: &[Trial]) -> Result<Vec<Trial>> {
    let ahead = brief.iter().max_by(|a, b| a.evidence.total_cmp(&b.evidence));
    let Some((most, gap)) = ahead.map(|t| (t.evidence, t.gap)) else { return Ok(Vec::new()) };
    let least = (most - HOPELESS_DEFICIT).min(most * HOPELESS_FRACTION);
    let hopeful = brief.iter().filter(|t| t.evidence > least || t.gap <= gap);
    let try_fully = |t: &Trial| Ok(try_out(measured, model, &t.proposal, TRIAL_RUNS)?.0);
    let mut trials = hopeful.map(try_fully).collect::<Result<Vec<_>>>()?;
    trials.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    Ok(trials)
}

/// Keeps the strongest proposals, and of those that targets gave no more than
/// [`MAX_TARGET_TRIALS`].
fn prune(proposals: &mut Vec<Proposal>) {
    let mut kept = 0;
    proposals.retain(|p| {
        kept += usize::from(p.of_targets);
        !p.of_targets || kept <= MAX_TARGET_TRIALS
    });
    proposals.truncate(MAX_TRIALS);
}

/// The most likely trials with refined parameters, the most likely first.
fn settled(measured: &Measured, model: &Evaluation, trials: &[Trial]) -> Result<Vec<Trial>> {
    let mut settled = Vec::new();
    for trial in trials.iter().filter(|t| t.evidence > 0.0).take(MAX_SETTLED) {
        settled.push(settle(measured, model, &trial.proposal)?);
    }
    settled.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    Ok(settled)
}

/// The first of the refined trials that is significant and that no statistic bars, and the model
/// with it; the kinds of those before it are `barred`.
fn first_that_holds(
    measured: &Measured,
    model: &Evaluation,
    settled: &[Trial],
    barred: &mut Vec<String>,
) -> Result<Option<(Trial, Evaluation)>> {
    for trial in settled.iter().filter(|t| t.is_significant(model.gap)) {
        let mut named = model.named.clone();
        trial.proposal.clone().join(&mut named);
        let camera = trial.proposal.applied(&model.camera);
        let next = fitted(measured, camera, named, RUNS_ON_THE_WAY)?;
        if !veto::bars(measured, model, &next) {
            return Ok(Some((trial.clone(), next)));
        }
        barred.push(trial.proposal.kind.to_string());
    }
    Ok(None)
}

/// All trials of a round except of the winner's kind, the first of each kind.
fn others(best: &Trial, settled: Vec<Trial>, trials: Vec<Trial>) -> Vec<Trial> {
    let mut others: Vec<Trial> = settled.into_iter().chain(trials).collect();
    let mut seen = vec![best.proposal.kind];
    others.retain(|t| {
        let new = !seen.contains(&t.proposal.kind);
        seen.push(t.proposal.kind);
        new
    });
    others
}

/// Whether the captures cannot distinguish a second candidate from the best. One that predicts the
/// held-out frames as well is worse only by chance in its random pattern.
fn is_rival(best: &Trial, second: &Trial) -> bool {
    (best.evidence - second.evidence < RIVAL_MARGIN || second.gap <= best.gap)
        && second.evidence > EVIDENCE_TO_FIT
}

/// A step with the changes that it made.
pub(super) fn step(
    held_out: &Half,
    before: &Evaluation,
    after: &Evaluation,
    trial: Trial,
    others: Vec<Trial>,
) -> Step {
    let moved = moved(before, after);
    Step {
        observed: observed(held_out, moved.first().map(|m| m.key), before, after),
        moved,
        gap_before: before.gap,
        gap_after: after.gap,
        trial,
        others,
    }
}

/// The held-out statistics whose deviation fell most.
fn moved(before: &Evaluation, after: &Evaluation) -> Vec<Moved> {
    let [old, new] = [&before.deviations[1], &after.deviations[1]];
    let moved = |(k, z): (&Key, &f64)| Some(Moved { key: *k, before: *z, after: *new.get(k)? });
    let mut out: Vec<Moved> = old.iter().filter_map(moved).collect();
    let fall = |m: &Moved| bounded(m.before) - bounded(m.after);
    out.sort_by(|a, b| fall(b).total_cmp(&fall(a)));
    out.truncate(MAX_MOVED);
    out
}

/// The statistic of `key` in all places like its own, before and after a step.
fn observed(
    held_out: &Half,
    key: Option<Key>,
    before: &Evaluation,
    after: &Evaluation,
) -> Vec<Observed> {
    let Some((place, what)) = key else { return Vec::new() };
    let alike = |p: &Place, w: &What| match (place, what, w) {
        // Figures of one sort of the same target.
        (Place::Target(_), What::Of(a), What::Of(b)) => {
            *p == place && std::mem::discriminant(&a) == std::mem::discriminant(b)
        }
        (Place::Stack(_), ..) => *w == what && matches!(p, Place::Stack(_)),
        _ => *w == what && *p == place,
    };
    held_out
        .values
        .iter()
        .filter(|((p, w), _)| alike(p, w))
        .filter_map(|(key, s)| {
            let (a, b) = (before.holdout.of.get(key)?, after.holdout.of.get(key)?);
            let measured = b.scale.of(s.value);
            Some(Observed { key: *key, measured, model: [a.scaled, b.scaled], sd: b.sd })
        })
        .collect()
}
