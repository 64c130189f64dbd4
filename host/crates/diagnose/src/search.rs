//! The search: which effects of the catalogue, put in the model, make it agree with the captures?
//!
//! Each round estimates every candidate, simulates the most significant ones and takes the one with which the
//! frames to fit are most likely, if the held-out frames agree; repeats until none earns its place; then drops
//! what is not missed. Where something is left, or a rival of an early name explains more beside the later ones, it looks
//! again without that name.

use super::candidates::Proposal;
use super::prediction::{Key, Prediction, bounded};
use super::session::{Half, Session, State};
use super::statistics::{Place, What};
use super::verdict::passes;
use camrig_base::Result;
use camrig_camera::Camera;

/// Replicates of a candidate, with the random numbers of the model's first ones.
pub(super) const TRIAL_RUNS: u64 = 4;
/// Most candidates simulated in a round.
const TRIALS: usize = 10;
/// Most of them that edges, dots and charts gave.
const LOOK_TRIALS: usize = 4;
/// Mean square deviation of a model's replicates from each other, in units of that of the model at the start, from which on
/// it explains nothing.
const WILD: f64 = 3.0;
/// Most effects named.
const MOST: usize = 10;
/// Most names of which each is doubted where something is left: a sensor with many effects leaves something of each.
pub(super) const FEW: usize = 2;
/// Significance (standard errors) from which a candidate is tried.
pub(super) const LEAST: f64 = 4.0;
/// Fall of the deviance that earns a place: on the frames to fit, on the held-out ones, and together (5.3 standard
/// deviations of a single statistic).
pub(super) const EARNS: [f64; 3] = [14.0, 3.0, 28.0];
/// Share of the held-out gap that named effects must close where something is left.
const ENOUGH: f64 = 0.75;
/// Held-out gap from which one or two names fit nothing: deviations of twice what chance gives.
const UNFIT: f64 = 4.0;

/// A candidate that was simulated.
#[derive(Clone, Debug)]
pub struct Trial {
    /// What was put in.
    pub proposal: Proposal,
    /// Fall of the deviance of the frames to fit.
    pub evidence: f64,
    /// The same of the held-out frames.
    pub confirmed: f64,
    /// Held-out gap with it.
    pub gap: f64,
    /// Share of the deviations it touches that it explains.
    pub explains: f64,
}

/// A statistic of the held-out frames beside the model before and after a step, on its own scale.
#[derive(Clone, Debug)]
pub struct Seen {
    /// Its name.
    pub key: Key,
    /// Measured.
    pub measured: f64,
    /// Predicted before and after.
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
    /// The others, best first.
    pub others: Vec<Trial>,
    /// Statistics whose prediction it moves.
    pub(super) touches: Vec<Key>,
    /// The statistic that moved most, in every place where it was taken.
    pub seen: Vec<Seen>,
    /// Statistics that moved most by it: key, deviation before and after (held-out).
    pub gave_away: Vec<(Key, f64, f64)>,
}

/// What the search found.
pub struct Outcome {
    /// The model at the start.
    pub before: State,
    /// The model at the end: what it predicts is of the parameters that the frames to fit gave; those named are of all.
    pub after: State,
    /// Effects in the order in which they were found.
    pub steps: Vec<Step>,
    /// Held-out gap at the start and at the end.
    pub gaps: (f64, f64),
    /// Kinds that came nearest where none explains enough.
    pub nearest: Vec<String>,
    /// Kinds that the captures cannot tell apart: one that was named, and its rival.
    pub twins: Vec<(String, String)>,
    /// The kind that was named at first; the search that begins without it explains more.
    pub doubted: Option<String>,
}

impl Session {
    /// Runs the search. `without` names kinds left out of the catalogue; `say` hears what is being tried.
    pub fn search(
        &self,
        camera: &Camera,
        without: &[String],
        say: &(dyn Fn(&str) + Sync),
    ) -> Result<Outcome> {
        say("replicates of the model");
        let before = self.state(camera.clone(), Vec::new())?;
        let known = |kind: &str| !without.iter().any(|w| w == kind);
        let mut found = self.climb(camera, &before, &|kind, _| known(kind), say)?;
        // A name taken early may have stood for two that are better together: the search with it as a later name only.
        if let Some((hasty, at)) = self.outdone(camera, &found)? {
            let wanted = |kind: &str, names| known(kind) && (kind != hasty || names > at);
            let other = self.climb(camera, &before, &wanted, say)?;
            if self.deviance(&other.after) < self.deviance(&found.after) {
                found = Outcome { doubted: Some(hasty), ..other };
            }
        }
        // One effect may take at once what two others explain better together, or what it explains only beside another: the
        // search without it, and with it as a later name only.
        if found.steps.len() <= FEW && !passes(self, &found.after, found.gaps.1) {
            let named = found.steps.iter().map(|s| s.trial.proposal.kind.to_string());
            let doubted: Vec<String> = named.chain(found.nearest.iter().cloned()).collect();
            let doubts = |kind: String| [(kind.clone(), usize::MAX), (kind, 1)];
            for (doubted, from) in doubted.into_iter().take(FEW).flat_map(doubts) {
                let wanted = |kind: &str, names| known(kind) && (kind != doubted || names >= from);
                let other = self.climb(camera, &before, &wanted, say)?;
                if !other.steps.is_empty() && passes(self, &other.after, other.gaps.1) {
                    found = Outcome { doubted: Some(doubted), ..other };
                    break;
                }
            }
        }
        say("standard errors");
        self.settle_parameters(&mut found.after)?;
        for step in &mut found.steps {
            let kind = step.trial.proposal.kind;
            if let Some(p) = found.after.named.iter().find(|p| p.kind == kind) {
                step.trial.proposal = p.clone();
            }
        }
        Ok(found)
    }

    /// Takes the best candidate after the other until none earns its place, then takes back what does not keep it. `wanted`
    /// tells whether a kind may be taken beside so many names.
    fn climb(
        &self,
        camera: &Camera,
        before: &State,
        wanted: &dyn Fn(&str, usize) -> bool,
        say: &(dyn Fn(&str) + Sync),
    ) -> Result<Outcome> {
        let gap_before = self.gap(&before.holdout, before.norm.0);
        let mut state = before.clone();
        let mut steps: Vec<Step> = Vec::new();
        let mut twins = Vec::new();
        while steps.len() < MOST {
            let wanted = |kind: &str| wanted(kind, steps.len());
            let mut proposals = self.propose(
                self.fit.frames(),
                &state.camera,
                &state.fit,
                &state.named,
                &wanted,
                LEAST,
            );
            thin(&mut proposals);
            proposals.truncate(TRIALS);
            if proposals.is_empty() {
                break;
            }
            let mut trials = Vec::new();
            for p in &proposals {
                say(p.kind);
                trials.push(self.try_out(&state, p)?.0);
            }
            trials.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
            // The best three, each at its best.
            let mut settled = Vec::new();
            for trial in trials.iter().filter(|t| t.evidence > 0.0).take(3) {
                settled.push(self.settle(&state, &trial.proposal)?);
            }
            settled.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
            let mut taken = None;
            for trial in settled.iter().filter(|t| earns(t)) {
                let mut named = state.named.clone();
                trial.proposal.clone().join(&mut named);
                let next = self.state(trial.proposal.applied(&state.camera), named)?;
                let next = self.refit(next)?;
                // Replicates that are far from each other agree with anything.
                if next.norm.0 < WILD * before.norm.0 {
                    taken = Some((trial.clone(), next));
                    break;
                }
            }
            let Some((best, next)) = taken else { break };
            let mut others: Vec<Trial> = settled.drain(..).chain(trials).collect();
            let mut seen = vec![best.proposal.kind];
            others.retain(|t| {
                let new = !seen.contains(&t.proposal.kind);
                seen.push(t.proposal.kind);
                new
            });
            // A rival that predicts the held-out frames as well loses by what its random pattern might have been only.
            if let Some(second) = others.first()
                && (best.evidence - second.evidence < 9.0 || second.gap <= best.gap)
                && second.evidence > EARNS[0]
            {
                twins.push((best.proposal.kind.to_string(), second.proposal.kind.to_string()));
            }
            let gaps = [&state, &next].map(|s| self.gap(&s.holdout, s.norm.0));
            let gave_away = self.moved(&state, &next);
            steps.push(Step {
                seen: self.seen(gave_away.first().map(|m| m.0), &state, &next),
                gave_away,
                touches: self.touched(&state, &next),
                gap_before: gaps[0],
                gap_after: gaps[1],
                trial: best,
                others,
            });
            state = next;
        }
        // A lone name of pictures was asked for by its likelihood.
        if steps.len() > 1 || steps.iter().any(|s| !s.trial.proposal.of_looks) {
            state = self.drop_idle(camera, state, &mut steps)?;
        }
        if state.named.iter().any(|p| p.of_looks) {
            // Derivatives where the search has come to.
            self.slopes.forget();
            state = self.refit(state)?;
        }
        let mut nearest = Vec::new();
        state = self.withdraw(camera, state, &mut steps, &mut nearest)?;
        let mut gap_after = self.gap(&state.holdout, state.norm.0);
        let share = (gap_before - gap_after) / (gap_before - 1.0).max(1e-9);
        let unfit = share < ENOUGH || steps.len() <= FEW && gap_after > UNFIT;
        if !steps.is_empty() && !self.unexplained(&state).is_empty() && unfit {
            // Names that leave that much are pressed on the data, not found in them.
            nearest.extend(steps.drain(..).map(|s| s.trial.proposal.kind.to_string()));
            state = before.clone();
            gap_after = gap_before;
        }
        // Names that were taken back, and rivals that have a place of their own, are no question.
        let named = |kind: &String| steps.iter().any(|s| s.trial.proposal.kind == kind);
        twins.retain(|(taken, rival)| named(taken) && !named(rival));
        let (before, gaps) = (before.clone(), (gap_before, gap_after));
        Ok(Outcome { nearest, before, after: state, steps, gaps, twins, doubted: None })
    }

    /// Simulates a proposal on top of a model and scores it.
    fn try_out(&self, state: &State, proposal: &Proposal) -> Result<(Trial, Prediction, Camera)> {
        let camera = proposal.applied(&state.camera);
        let before = &state.replicates[..TRIAL_RUNS as usize];
        let after = self.replicates(&camera, &self.fit, TRIAL_RUNS)?;
        let fit = state.fit.moved(before, &after);
        let holdout = state.holdout.moved(before, &after);
        let fall = |half: &Half, old: &Prediction, new: &Prediction| {
            old.deviance(&half.values, &half.allowance)
                - new.deviance(&half.values, &half.allowance)
        };
        let evidence = fall(&self.fit, &state.fit, &fit);
        let confirmed = fall(&self.holdout, &state.holdout, &holdout);
        let explains =
            explained(&[(&self.fit, &state.fit, &fit), (&self.holdout, &state.holdout, &holdout)]);
        let gap = self.gap(&holdout, state.norm.0);
        Ok((Trial { proposal: proposal.clone(), evidence, confirmed, gap, explains }, fit, camera))
    }

    /// Tries a proposal and moves its parameters until they stay.
    fn settle(&self, state: &State, proposal: &Proposal) -> Result<Trial> {
        let (mut best, mut prediction, mut camera) = self.try_out(state, proposal)?;
        for _ in 0..3 {
            let own = |kind: &str| kind == proposal.kind;
            let again = self
                .propose(self.fit.frames(), &camera, &prediction, &state.named, &own, 1.0)
                .into_iter()
                .find(|p| !p.beside && same_shape(p, &best.proposal));
            let Some(next) = again.filter(|p| p.strength > 1.0) else { break };
            let (trial, p, c) = self.try_out(state, &merged(&best.proposal, next))?;
            (prediction, camera) = (p, c);
            if trial.evidence > best.evidence {
                best = trial;
            }
        }
        Ok(best)
    }

    /// Statistics whose prediction differs by three standard deviations and more.
    fn touched(&self, before: &State, after: &State) -> Vec<Key> {
        let moved = |k: &Key| Some(after.fit.of.get(k)?.differs(before.fit.of.get(k)?));
        before.fit.of.keys().filter(|k| moved(k) == Some(true)).copied().collect()
    }

    /// The held-out statistics whose deviation fell most.
    fn moved(&self, before: &State, after: &State) -> Vec<(Key, f64, f64)> {
        let z = |s: &State| s.holdout.deviations(&self.holdout.values, &self.holdout.allowance);
        let (old, new) = (z(before), z(after));
        let mut out: Vec<(Key, f64, f64)> =
            old.iter().filter_map(|(k, z)| Some((*k, *z, *new.get(k)?))).collect();
        let fall = |m: &(Key, f64, f64)| bounded(m.1) - bounded(m.2);
        out.sort_by(|a, b| fall(b).total_cmp(&fall(a)));
        out.truncate(8);
        out
    }

    /// The statistic of `key` in all places like its own, before and after.
    fn seen(&self, key: Option<Key>, before: &State, after: &State) -> Vec<Seen> {
        let Some((place, what)) = key else { return Vec::new() };
        let alike = |p: &Place, w: &What| match (place, what, w) {
            // Figures of one sort of the same picture.
            (Place::Look(_), What::Of(a), What::Of(b)) => {
                *p == place && std::mem::discriminant(&a) == std::mem::discriminant(b)
            }
            (Place::Stack(_), ..) => *w == what && matches!(p, Place::Stack(_)),
            _ => *w == what && *p == place,
        };
        self.holdout
            .values
            .iter()
            .filter(|((p, w), _)| alike(p, w))
            .filter_map(|(key, s)| {
                let (a, b) = (before.holdout.of.get(key)?, after.holdout.of.get(key)?);
                let measured = b.scale.of(s.value);
                Some(Seen { key: *key, measured, model: [a.scaled, b.scaled], sd: b.sd })
            })
            .collect()
    }
}

/// Of the deviance of the statistics that a change moves, the share it removes; all, if it moves none by much. Halves with
/// the prediction before and after.
fn explained(halves: &[(&Half, &Prediction, &Prediction)]) -> f64 {
    let (mut had, mut left) = (0.0, 0.0);
    for (half, before, after) in halves {
        let z_after = after.deviations(&half.values, &half.allowance);
        for (key, z) in before.deviations(&half.values, &half.allowance) {
            let (Some(a), Some(b)) = (before.of.get(&key), after.of.get(&key)) else { continue };
            if b.differs(a)
                && let Some(z_after) = z_after.get(&key)
            {
                had += bounded(z);
                left += bounded(*z_after);
            }
        }
    }
    if had > 0.0 { 1.0 - left / had } else { 1.0 }
}

/// Leaves of the proposals that pictures gave the strongest: their strengths are those of likelihoods already, and
/// each takes the optics stage to try.
fn thin(proposals: &mut Vec<Proposal>) {
    let mut kept = 0;
    proposals.retain(|p| {
        kept += usize::from(p.of_looks);
        !p.of_looks || kept <= LOOK_TRIALS
    });
}

fn earns(t: &Trial) -> bool {
    // The two halves of a look share the sensor's pattern: each must say what elsewhere both say together.
    t.evidence > EARNS[if t.proposal.of_looks { 2 } else { 0 }]
        && t.confirmed > EARNS[1]
        && t.evidence + t.confirmed > EARNS[2]
        && t.explains > 0.3
}

/// Whether two proposals of one kind have the same free parameters.
pub(super) fn same_shape(a: &Proposal, b: &Proposal) -> bool {
    a.effects.len() == b.effects.len()
        && a.parameters.iter().map(|p| p.0).eq(b.parameters.iter().map(|p| p.0))
}

/// The second proposal in the place of the first.
pub(super) fn merged(first: &Proposal, second: Proposal) -> Proposal {
    Proposal { strength: first.strength, beside: first.beside, ..second }
}
