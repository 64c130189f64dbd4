//! Forward selection: adds the candidate that makes the frames to fit likeliest, if the held-out
//! frames agree, until none earns its place.

use super::refit::refit;
use super::session::{RUNS_ON_THE_WAY, Session, State};
use super::trial::{EVIDENCE_IN_ALL, EVIDENCE_TO_FIT, TRIAL_RUNS, Trial, settle, try_out};
use super::veto;
use crate::candidates::proposal::{MIN_STRENGTH, Proposal};
use crate::model::prediction::bounded;
use crate::statistics::statistic::{Key, Place, What};
use camrig_base::Result;

/// Candidates simulated in a round, at most: the strongest by their estimators, which rank the
/// right one high; each costs two replicates, and those that are not hopeless two more.
const TRIALS: usize = 10;
/// Of these, candidates estimated from targets, at most: their strengths are likelihoods already,
/// and each takes a run of the optics stage.
const TARGET_TRIALS: usize = 4;
/// Replicates of every candidate, from which it is seen whether it is hopeless.
const FIRST_RUNS: u64 = TRIAL_RUNS / 2;
/// A candidate is hopeless that is behind the best by more than this deviance, what earns a place,
/// has less than this share of its evidence, and does not predict the held-out frames as well. Two
/// pairs shrink what an effect does to noisy statistics: on an STL-1001E they showed 0.57 of the
/// evidence for hot pixels that four did.
const HOPELESS: (f64, f64) = (EVIDENCE_IN_ALL, 0.5);
/// Candidates whose parameters are settled in a round: those likeliest after their trial.
const SETTLED: usize = 3;
/// Effects named, at most. Hidden sets hold up to six; real sensors have shown nine.
const MAX_EFFECTS: usize = 10;
/// Mean square deviation of a model's replicates from each other, over that of the model at the
/// start, from which the model explains nothing: replicates that scatter so agree with anything
/// (`docs/diagnosis.md`).
const DIVERGED: f64 = 3.0;
/// Deviance within which a rival's is not worse than the winner's: 3² for three standard
/// deviations.
const RIVAL_MARGIN: f64 = 9.0;
/// Statistics kept of those that a step moved.
const MOVED_KEPT: usize = 8;

/// A statistic of the held-out frames beside the model before and after a step, on its own scale.
#[derive(Clone, Debug)]
pub struct Observed {
    /// Its name.
    pub key: Key,
    /// Measured.
    pub measured: f64,
    /// Predicted, before and after.
    pub model: [f64; 2],
    /// Standard deviation that the model after the step gives it.
    pub sd: f64,
}

/// One effect that earned its place.
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
    /// Statistics whose prediction it moves.
    pub(super) touches: Vec<Key>,
    /// The statistic whose deviation fell most, wherever it was taken.
    pub observed: Vec<Observed>,
    /// The held-out statistics whose deviation fell most: name, deviation before and after.
    pub moved: Vec<(Key, f64, f64)>,
}

/// Effects that were selected, and the model with them.
pub struct Selection {
    /// The model.
    pub state: State,
    /// Effects in the order in which they were found.
    pub steps: Vec<Step>,
    /// Kinds that the captures cannot tell apart: one that was taken, and its rival.
    pub confounded: Vec<(String, String)>,
}

/// Takes the best candidate of each round until none earns its place. `wanted` tells whether a
/// kind may be taken beside so many names; `say` hears what is being tried.
pub(super) fn select(
    session: &Session,
    before: &State,
    wanted: &dyn Fn(&str, usize) -> bool,
    say: &(dyn Fn(&str) + Sync),
) -> Result<Selection> {
    let mut selection =
        Selection { state: before.clone(), steps: Vec::new(), confounded: Vec::new() };
    while selection.steps.len() < MAX_EFFECTS {
        let wanted = |kind: &str| wanted(kind, selection.steps.len());
        let trials = trials(session, &selection.state, &wanted, say)?;
        let settled = settled(session, &selection.state, &trials)?;
        let Some((best, next)) = first_that_holds(session, before, &selection.state, &settled)?
        else {
            break;
        };
        let others = others(&best, settled, trials);
        if let Some(rival) = others.first().filter(|r| is_rival(&best, r)) {
            let names = [&best, rival].map(|t| t.proposal.kind.to_string());
            selection.confounded.push(names.into());
        }
        selection.steps.push(step(session, &selection.state, &next, best, others));
        selection.state = next;
    }
    Ok(selection)
}

/// The candidates of a round, simulated, the likeliest first: all of them briefly, those that are
/// not hopeless then in full, a sequential design (Wald 1945). What is hopeless is left out.
fn trials(
    session: &Session,
    state: &State,
    wanted: &dyn Fn(&str) -> bool,
    say: &(dyn Fn(&str) + Sync),
) -> Result<Vec<Trial>> {
    let mut proposals = session.propose(session.fit.frames(), state.model(), wanted, MIN_STRENGTH);
    prune(&mut proposals);
    let (behind, share) = HOPELESS;
    let mut brief = Vec::new();
    for p in &proposals {
        say(p.kind);
        brief.push(try_out(session, state, p, FIRST_RUNS)?.0);
    }
    let ahead = brief.iter().max_by(|a, b| a.evidence.total_cmp(&b.evidence));
    let Some((most, gap)) = ahead.map(|t| (t.evidence, t.gap)) else { return Ok(brief) };
    let mut trials = Vec::new();
    let least = (most - behind).min(most * share);
    for t in brief.iter().filter(|t| t.evidence > least || t.gap <= gap) {
        trials.push(try_out(session, state, &t.proposal, TRIAL_RUNS)?.0);
    }
    trials.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    Ok(trials)
}

/// Keeps the strongest proposals, and of those that targets gave no more than [`TARGET_TRIALS`].
fn prune(proposals: &mut Vec<Proposal>) {
    let mut kept = 0;
    proposals.retain(|p| {
        kept += usize::from(p.of_targets);
        !p.of_targets || kept <= TARGET_TRIALS
    });
    proposals.truncate(TRIALS);
}

/// The likeliest trials with their parameters settled, the likeliest first.
fn settled(session: &Session, state: &State, trials: &[Trial]) -> Result<Vec<Trial>> {
    let mut settled = Vec::new();
    for trial in trials.iter().filter(|t| t.evidence > 0.0).take(SETTLED) {
        settled.push(settle(session, state, &trial.proposal)?);
    }
    settled.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    Ok(settled)
}

/// The first of the settled trials that earns its place with a model that does not diverge and
/// that no statistic contradicts, and the model with it.
fn first_that_holds(
    session: &Session,
    before: &State,
    state: &State,
    settled: &[Trial],
) -> Result<Option<(Trial, State)>> {
    let gap = session.gap(state);
    for trial in settled.iter().filter(|t| t.earns_place(gap)) {
        let mut named = state.named.clone();
        trial.proposal.clone().join(&mut named);
        let camera = trial.proposal.applied(&state.camera);
        let next = session.state(camera, named, RUNS_ON_THE_WAY)?;
        let next = refit(session, next)?;
        let holds = !veto::contradicts(session, state, &next);
        if next.norm.0 < DIVERGED * before.norm.0 && holds {
            return Ok(Some((trial.clone(), next)));
        }
    }
    Ok(None)
}

/// All trials of a round but the winner's kind, the first of each kind.
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

/// Whether the captures cannot tell a second candidate from the best. One that predicts the
/// held-out frames as well loses only by what its random pattern might have been.
fn is_rival(best: &Trial, second: &Trial) -> bool {
    (best.evidence - second.evidence < RIVAL_MARGIN || second.gap <= best.gap)
        && second.evidence > EVIDENCE_TO_FIT
}

/// What a step did.
fn step(
    session: &Session,
    before: &State,
    after: &State,
    trial: Trial,
    others: Vec<Trial>,
) -> Step {
    let moved = moved(session, before, after);
    Step {
        observed: observed(session, moved.first().map(|m| m.0), before, after),
        moved,
        touches: touched(before, after),
        gap_before: session.gap(before),
        gap_after: session.gap(after),
        trial,
        others,
    }
}

/// Statistics whose prediction is another one after a step.
fn touched(before: &State, after: &State) -> Vec<Key> {
    let moved = |k: &Key| Some(after.fit.of.get(k)?.differs(before.fit.of.get(k)?));
    before.fit.of.keys().filter(|k| moved(k) == Some(true)).copied().collect()
}

/// The held-out statistics whose deviation fell most.
fn moved(session: &Session, before: &State, after: &State) -> Vec<(Key, f64, f64)> {
    let old = session.holdout.deviations(&before.holdout);
    let new = session.holdout.deviations(&after.holdout);
    let mut out: Vec<(Key, f64, f64)> =
        old.iter().filter_map(|(k, z)| Some((*k, *z, *new.get(k)?))).collect();
    let fall = |m: &(Key, f64, f64)| bounded(m.1) - bounded(m.2);
    out.sort_by(|a, b| fall(b).total_cmp(&fall(a)));
    out.truncate(MOVED_KEPT);
    out
}

/// The statistic of `key` in all places like its own, before and after a step.
fn observed(session: &Session, key: Option<Key>, before: &State, after: &State) -> Vec<Observed> {
    let Some((place, what)) = key else { return Vec::new() };
    let alike = |p: &Place, w: &What| match (place, what, w) {
        // Figures of one sort of the same target.
        (Place::Target(_), What::Of(a), What::Of(b)) => {
            *p == place && std::mem::discriminant(&a) == std::mem::discriminant(b)
        }
        (Place::Stack(_), ..) => *w == what && matches!(p, Place::Stack(_)),
        _ => *w == what && *p == place,
    };
    session
        .holdout
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
