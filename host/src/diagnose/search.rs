//! The search: which effects of the catalogue, put in the model, make it agree with the captures?
//!
//! Each round estimates every candidate, simulates the most significant ones and takes the one with which the
//! frames to fit are most likely, if the held-out frames agree; repeats until none earns its place; then drops
//! what is not missed.

use super::candidates::{self, Proposal, Slopes};
use super::channels::Channels;
use super::design::{Design, Halves};
use super::evidence::Evidence;
use super::looks::light::{self, Electrons, Lights};
use super::looks::{self, Look, Picture};
use super::maps::{self, Map};
use super::prediction::{Key, Prediction, Values, bounded, by_key, mean_square};
use super::statistics::{Place, What, battery};
use super::temporal::{Temporal, mean};
use super::{allowance, model, plausible, replicate};
use crate::camera::Camera;
use crate::captures::{CaptureSet, Role};
use crate::{Plane, Result};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Replicates of a model that is judged.
const RUNS: u64 = 16;
/// Replicates of a candidate, with the random numbers of the model's first ones.
const TRIAL_RUNS: u64 = 4;
/// Seed of the first replicate.
const SEED: u64 = 0x5eed;
/// Most candidates simulated in a round.
const TRIALS: usize = 10;
/// Most of them that edges, dots and charts gave.
const LOOK_TRIALS: usize = 4;
/// Most effects named.
const MOST: usize = 10;
/// Significance (standard errors) from which a candidate is tried.
const LEAST: f64 = 4.0;
/// Fall of the deviance that earns a place: on the frames to fit, on the held-out ones, and together (5.3 standard
/// deviations of a single statistic).
const EARNS: [f64; 3] = [14.0, 3.0, 28.0];
/// Deviation (standard deviations, both halves) that is gross, and the share of a name's evidence that gross deviations in
/// what it touches may have.
const GROSS: f64 = 10.0;
/// See [`GROSS`].
const GROSS_SHARE: f64 = 0.1;
/// Share of the held-out gap that named effects must close where something is left.
const ENOUGH: f64 = 0.75;
/// Standard deviations, both halves together, from which a single statistic is unexplained: by the model as given, and by one
/// with named effects, whose laws (of tails, of spectra) are never quite the sensor's.
pub const UNEXPLAINED: [f64; 2] = [5.2, 6.0];
/// Held-out gap of the right model that is passed once in two hundred replicates (../../docs): see [`State::limit`].
const GAP_LIMIT: f64 = 1.27;

/// Measured moments of one half.
pub struct Half {
    /// How it was taken.
    pub design: Design,
    /// Its dark and flat stacks.
    pub stacks: Vec<Temporal>,
    /// Its edges, dots and charts.
    pub pictures: Vec<Picture>,
    /// Its statistics.
    pub values: Values,
    /// Scatter that comes from the set-up.
    pub allowance: BTreeMap<Key, f64>,
}

/// A model with what it predicts.
#[derive(Clone)]
pub struct State {
    /// The camera.
    pub camera: Camera,
    /// What was named so far.
    pub named: Vec<Proposal>,
    /// Its replicates under the fit design.
    replicates: Vec<Values>,
    /// What it predicts for the frames to fit.
    pub fit: Prediction,
    /// What it predicts for the held-out frames.
    pub holdout: Prediction,
    /// Mean square deviation of a replicate, and its standard deviation over replicates.
    norm: (f64, f64),
}

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
    touches: Vec<Key>,
    /// The statistic that moved most, in every place where it was taken.
    pub seen: Vec<Seen>,
    /// Statistics that moved most by it: key, deviation before and after (held-out).
    pub gave_away: Vec<(Key, f64, f64)>,
}

/// What the search found.
pub struct Outcome {
    /// The model at the start.
    pub before: State,
    /// The model at the end.
    pub after: State,
    /// Effects in the order in which they were found.
    pub steps: Vec<Step>,
    /// Held-out gap at the start and at the end.
    pub gaps: (f64, f64),
    /// Kinds that came nearest where none explains enough.
    pub nearest: Vec<String>,
    /// Twins that the captures cannot tell apart: kinds.
    pub twins: Vec<(String, String)>,
}

/// A set ready to be searched.
pub struct Session {
    /// Frames to fit.
    pub fit: Half,
    /// Frames to judge with; where the set has none, the same as `fit` and nothing is confirmed.
    pub holdout: Half,
    /// Whether there are held-out frames.
    pub can_confirm: bool,
    /// Maps of the frames to fit.
    pub maps: Vec<Map>,
    /// Words for people.
    pub notes: Vec<String>,
    /// Light of edges, dots and charts through the lenses tried.
    lights: Lights,
    /// What parameters do to edges, dots and charts.
    slopes: Slopes,
}

impl Session {
    /// Measures the frames.
    pub fn open(
        camera: &Camera,
        set: &CaptureSet,
        halves: Halves,
        progress: &(dyn Fn(usize) + Sync),
    ) -> Result<Self> {
        let lights = Lights::default();
        let half = |mut design: Design| -> Result<Half> {
            let stacks = replicate::measure(set, &design, true, progress)?;
            set_unknown_levels(camera, &mut design, &stacks);
            let pictures = replicate::seen(camera, set, &design.looks, progress)?;
            set_unknown_light(camera, &mut design.looks, &pictures, &lights)?;
            let mut values = by_key(battery(camera, &design, &stacks));
            values.extend(by_key(looks::battery(camera, &design, &pictures)));
            let allowance = allowance::allowances(camera, &design, &values);
            Ok(Half { design, stacks, pictures, values, allowance })
        };
        let mut notes = halves.notes;
        if halves.fit.conditions.iter().any(|c| c.role == Role::Flat && !c.even) {
            notes.push("the light of flats may be uneven (uniformity = \"unknown\"): smooth shading is not judged".into());
        }
        let fit = half(halves.fit)?;
        for (look, picture) in fit.design.looks.iter().zip(&fit.pictures) {
            if let Err(e) = looks::figures(camera, look, picture) {
                notes.push(format!("{}: {e}; left out", look.id));
            }
        }
        let can_confirm = halves.holdout.is_some();
        let holdout = match halves.holdout {
            Some(design) => half(design)?,
            None => {
                notes.push("no held-out frames: names stay tentative".into());
                half(fit.design.clone())?
            }
        };
        plausible::check(camera, &fit.design, &fit.stacks)?;
        let maps = maps::maps(camera, &fit.design, &fit.stacks);
        let slopes = Slopes::default();
        Ok(Self { fit, holdout, can_confirm, maps, notes, lights, slopes })
    }

    /// The model with what it predicts.
    fn state(&self, camera: Camera, named: Vec<Proposal>) -> Result<State> {
        let replicates = self.replicates(&camera, &self.fit.design, RUNS, None)?;
        let fit = Prediction::new(&replicates);
        let same = self.fit.design.conditions.len() == self.holdout.design.conditions.len()
            && self
                .fit
                .design
                .conditions
                .iter()
                .zip(&self.holdout.design.conditions)
                .all(|(a, b)| a.capture == b.capture && a.frames == b.frames)
            && self.fit.design.looks.len() == self.holdout.design.looks.len()
            && self
                .fit
                .design
                .looks
                .iter()
                .zip(&self.holdout.design.looks)
                .all(|(a, b)| a.capture == b.capture && a.frames == b.frames);
        let judged = match same {
            true => None,
            false => Some(self.replicates(&camera, &self.holdout.design, RUNS, None)?),
        };
        let own = judged.as_ref().unwrap_or(&replicates);
        let holdout = judged.as_ref().map_or_else(|| fit.clone(), |r| Prediction::new(r));
        // Each replicate against the others, as if it were measured.
        let squares: Vec<f64> = (0..own.len())
            .map(|i| {
                let others: Vec<Values> = own
                    .iter()
                    .enumerate()
                    .filter(|(j, _)| *j != i)
                    .map(|(_, r)| r.clone())
                    .collect();
                let none = BTreeMap::new();
                mean_square(&Prediction::new(&others).deviations(&own[i], &none))
            })
            .collect();
        let n = squares.len() as f64;
        let mean = squares.iter().sum::<f64>() / n;
        let sd = (squares.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
        Ok(State { camera, named, replicates, fit, holdout, norm: (mean, sd) })
    }

    /// Replicates of a camera under a design; of its dark and flat stacks those `known`, where it has the same.
    fn replicates(
        &self,
        camera: &Camera,
        design: &Design,
        runs: u64,
        known: Option<&[Values]>,
    ) -> Result<Vec<Values>> {
        let planes = camera.effects.iter().any(|e| e.entry().kind == "periodic-pattern-noise");
        let lights = self.lights.of(camera, &design.looks)?;
        (0..runs)
            .into_par_iter()
            .map(|run| {
                let seed = SEED + run;
                let mut values = match known.and_then(|k| k.get(run as usize)) {
                    Some(values) => values.clone(),
                    None => {
                        let stacks = replicate::simulate(camera, design, seed, planes)?;
                        let mut values = by_key(battery(camera, design, &stacks));
                        if !planes {
                            super::add_flat_planes(&mut values, design);
                        }
                        values
                    }
                };
                values.extend(imagined(camera, design, &lights, seed)?);
                Ok(values)
            })
            .collect()
    }

    /// Held-out gap of a prediction.
    fn gap(&self, prediction: &Prediction, norm: f64) -> f64 {
        let z = prediction.deviations(&self.holdout.values, &self.holdout.allowance);
        mean_square(&z) / norm.max(1e-9)
    }

    /// Proposals of the kinds `wanted` against a model.
    fn propose(
        &self,
        camera: &Camera,
        model: &Prediction,
        named: &[Proposal],
        wanted: &dyn Fn(&str) -> bool,
        least: f64,
    ) -> Vec<Proposal> {
        let imagine = |camera: &Camera| {
            let design = &self.fit.design;
            imagined(camera, design, &self.lights.of(camera, &design.looks)?, SEED)
        };
        let evidence = Evidence {
            camera,
            design: &self.fit.design,
            data: &self.fit.values,
            model,
            stacks: &self.fit.stacks,
            maps: &self.maps,
            allowance: &self.fit.allowance,
            imagine: &imagine,
            slopes: &self.slopes,
            named: named.iter().map(|p| p.kind).filter(|k| candidates::shown_by_looks(k)).collect(),
        };
        candidates::propose(&evidence, wanted, least)
    }

    /// Simulates a proposal on top of a model and scores it.
    fn try_out(&self, state: &State, proposal: &Proposal) -> Result<(Trial, Prediction, Camera)> {
        let camera = proposal.applied(&state.camera);
        let before = &state.replicates[..TRIAL_RUNS as usize];
        let known = proposal.is_of_optics().then_some(before);
        let after = self.replicates(&camera, &self.fit.design, TRIAL_RUNS, known)?;
        let fit = state.fit.moved(before, &after);
        let holdout = state.holdout.moved(before, &after);
        let fall = |half: &Half, old: &Prediction, new: &Prediction| {
            old.deviance(&half.values, &half.allowance)
                - new.deviance(&half.values, &half.allowance)
        };
        let evidence = fall(&self.fit, &state.fit, &fit);
        let confirmed = fall(&self.holdout, &state.holdout, &holdout);
        let explains = self.explained(state, &fit);
        let gap = self.gap(&holdout, state.norm.0);
        Ok((Trial { proposal: proposal.clone(), evidence, confirmed, gap, explains }, fit, camera))
    }

    /// Of the deviance of statistics that a change moves by three standard deviations or more, the share it removes.
    fn explained(&self, state: &State, new: &Prediction) -> f64 {
        let old = state.fit.deviations(&self.fit.values, &self.fit.allowance);
        let after = new.deviations(&self.fit.values, &self.fit.allowance);
        let (mut had, mut left) = (0.0, 0.0);
        for (key, z) in &old {
            let (Some(a), Some(b)) = (state.fit.of.get(key), new.of.get(key)) else { continue };
            if ((b.scaled - a.scaled) / a.sd).abs() > 3.0
                && let Some(z_after) = after.get(key)
            {
                had += bounded(*z);
                left += bounded(*z_after);
            }
        }
        if had > 0.0 { 1.0 - left / had } else { 0.0 }
    }

    /// Tries a proposal and moves its parameters until they stay.
    fn settle(&self, state: &State, proposal: &Proposal) -> Result<Trial> {
        let (mut best, mut prediction, mut camera) = self.try_out(state, proposal)?;
        for _ in 0..3 {
            let own = |kind: &str| kind == proposal.kind;
            let again = self
                .propose(&camera, &prediction, &state.named, &own, 1.0)
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

    /// A model as it is: what it predicts, and its held-out gap.
    pub fn compare(&self, camera: &Camera) -> Result<(State, f64)> {
        let state = self.state(camera.clone(), Vec::new())?;
        let gap = self.gap(&state.holdout, state.norm.0);
        Ok((state, gap))
    }

    /// Runs the search. `without` names kinds left out of the catalogue; `say` hears what is being tried.
    pub fn search(
        &self,
        camera: &Camera,
        without: &[String],
        say: &(dyn Fn(&str) + Sync),
    ) -> Result<Outcome> {
        say("replicates of the model");
        let before = self.state(camera.clone(), Vec::new())?;
        let gap_before = self.gap(&before.holdout, before.norm.0);
        let mut state = before.clone();
        let mut steps: Vec<Step> = Vec::new();
        let mut twins = Vec::new();
        while steps.len() < MOST {
            let wanted = |kind: &str| !without.iter().any(|w| w == kind);
            let mut proposals =
                self.propose(&state.camera, &state.fit, &state.named, &wanted, LEAST);
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
            let Some(best) = settled.first().filter(|t| earns(t)).cloned() else { break };
            let mut others: Vec<Trial> = settled.drain(..).chain(trials).collect();
            let mut seen = vec![best.proposal.kind];
            others.retain(|t| {
                let new = !seen.contains(&t.proposal.kind);
                seen.push(t.proposal.kind);
                new
            });
            if let Some(second) = others.first()
                && best.evidence - second.evidence < 9.0
                && second.evidence > EARNS[0]
            {
                twins.push((best.proposal.kind.to_string(), second.proposal.kind.to_string()));
            }
            let mut named = state.named.clone();
            best.proposal.clone().join(&mut named);
            let next = self.state(best.proposal.applied(&state.camera), named)?;
            let next = self.refit(next)?;
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
        if steps.len() > 1 {
            state = self.drop_idle(camera, state, &mut steps)?;
        }
        if state.named.iter().any(|p| p.of_looks) {
            // Derivatives where the search has come to.
            self.slopes.forget();
            state = self.refit(state)?;
        }
        for step in &mut steps {
            let kind = step.trial.proposal.kind;
            if let Some(p) = state.named.iter().find(|p| p.kind == kind) {
                step.trial.proposal = p.clone();
            }
        }
        let mut nearest = Vec::new();
        state = self.withdraw(camera, state, &mut steps, &mut nearest)?;
        let mut gap_after = self.gap(&state.holdout, state.norm.0);
        let share = (gap_before - gap_after) / (gap_before - 1.0).max(1e-9);
        if !steps.is_empty() && !self.unexplained(&state).is_empty() && share < ENOUGH {
            // Names that leave that much are pressed on the data, not found in them.
            nearest.extend(steps.drain(..).map(|s| s.trial.proposal.kind.to_string()));
            twins.clear();
            state = before.clone();
            gap_after = gap_before;
        }
        Ok(Outcome { nearest, before, after: state, steps, gaps: (gap_before, gap_after), twins })
    }

    /// Statistics whose prediction differs by three standard deviations and more.
    fn touched(&self, before: &State, after: &State) -> Vec<Key> {
        let moved = |k: &Key| {
            let (a, b) = (before.fit.of.get(k)?, after.fit.of.get(k)?);
            Some(((b.scaled - a.scaled) / a.sd).abs() > 3.0 || b.sd > 3.0 * a.sd)
        };
        before.fit.of.keys().filter(|k| moved(k) == Some(true)).copied().collect()
    }

    /// Takes back names that leave gross deviations in the very statistics, or the very map, that gave them away: another
    /// thing is there, of which the name was the nearest in the catalogue.
    fn withdraw(
        &self,
        base: &Camera,
        mut state: State,
        steps: &mut Vec<Step>,
        nearest: &mut Vec<String>,
    ) -> Result<State> {
        // A sensor with many effects leaves something of each; one or two names must fit.
        if steps.len() > 2 {
            return Ok(state);
        }
        let gross: Vec<(Key, f64)> =
            self.unexplained(&state).into_iter().filter(|(_, z)| z.abs() > GROSS).collect();
        let before = steps.len();
        steps.retain(|step| {
            let near = |key: &Key| {
                let same_map = |k: &Key| k.0 == key.0 && matches!(k.0, Place::Map(_));
                step.touches.iter().any(|k| k == key || same_map(k))
            };
            let left: f64 = gross.iter().filter(|(k, _)| near(k)).map(|(_, z)| bounded(*z)).sum();
            let keep = left < GROSS_SHARE * step.trial.evidence;
            if !keep {
                nearest.push(step.trial.proposal.kind.to_string());
            }
            keep
        });
        if steps.len() < before {
            let named: Vec<Proposal> = state
                .named
                .iter()
                .filter(|p| steps.iter().any(|s| s.trial.proposal.kind == p.kind))
                .cloned()
                .collect();
            let camera = named.iter().fold(base.clone(), |c, p| p.applied(&c));
            state = self.refit(self.state(camera, named)?)?;
        }
        Ok(state)
    }

    /// Estimates every named effect again with all of them in the model.
    fn refit(&self, mut state: State) -> Result<State> {
        // A single name was settled when it was tried.
        for _ in 0..if state.named.len() > 1 { 2 } else { 1 } {
            let is_named = |kind: &str| state.named.iter().any(|p| p.kind == kind);
            let all = self.propose(&state.camera, &state.fit, &state.named, &is_named, 1.0);
            let mut named = state.named.clone();
            let mut moved = false;
            for p in &mut named {
                let next = all.iter().find(|a| a.kind == p.kind && !a.beside && same_shape(a, p));
                if let Some(next) = next {
                    // Each gets its own new values; what gave way for it is among the named.
                    *p = Proposal { along: Default::default(), ..merged(p, next.clone()) };
                    moved = true;
                }
            }
            if !moved {
                break;
            }
            let camera = named.iter().fold(self.base(&state), |c, p| p.applied(&c));
            let next = self.state(camera, named)?;
            let of = |s: &State| s.fit.deviance(&self.fit.values, &self.fit.allowance);
            if of(&next) >= of(&state) {
                break;
            }
            state = next;
        }
        Ok(state)
    }

    /// The camera that the named effects are put on: their parameters replace each other.
    fn base(&self, state: &State) -> Camera {
        let mut camera = state.camera.clone();
        // Effects that stand beside others of their kind must not be put twice.
        for p in state.named.iter().filter(|p| p.beside) {
            for effect in &p.effects {
                if let Some(at) = camera.effects.iter().position(|x| x == effect) {
                    camera.effects.remove(at);
                }
            }
        }
        camera
    }

    /// Leaves out effects, the weakest first, whose absence nobody would notice.
    fn drop_idle(&self, base: &Camera, mut state: State, steps: &mut Vec<Step>) -> Result<State> {
        let mut i = 0;
        while i < state.named.len() && state.named.len() > 1 {
            let mut named = state.named.clone();
            let left_out = named.remove(i);
            let camera = named.iter().fold(base.clone(), |c, p| p.applied(&c));
            let before = &state.replicates[..TRIAL_RUNS as usize];
            let known = left_out.is_of_optics().then_some(before);
            let after = self.replicates(&camera, &self.fit.design, TRIAL_RUNS, known)?;
            let rise = |half: &Half, with: &Prediction| {
                with.moved(before, &after).deviance(&half.values, &half.allowance)
                    - with.deviance(&half.values, &half.allowance)
            };
            let missed = rise(&self.fit, &state.fit) + rise(&self.holdout, &state.holdout);
            if missed < EARNS[2] / 2.0 {
                if let Some(at) = steps.iter().position(|s| s.trial.proposal.kind == left_out.kind)
                {
                    steps.remove(at);
                }
                state = self.refit(self.state(camera, named)?)?;
            } else {
                i += 1;
            }
        }
        Ok(state)
    }

    /// The mean frame of a look as a camera would take it.
    ///
    /// # Errors
    /// Those of rendering.
    pub fn picture(&self, camera: &Camera, look: &Look) -> Result<Plane<f32>> {
        let looks = std::slice::from_ref(look);
        let lights = self.lights.of(camera, looks)?;
        let mut pictures = replicate::pictures(camera, looks, &lights, SEED)?;
        Ok(pictures.swap_remove(0).mean)
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

    /// Deviations of both halves from a model: fit and held-out.
    pub fn deviations(&self, state: &State) -> [BTreeMap<Key, f64>; 2] {
        [
            state.fit.deviations(&self.fit.values, &self.fit.allowance),
            state.holdout.deviations(&self.holdout.values, &self.holdout.allowance),
        ]
    }

    /// Statistics that a model leaves unexplained: key and deviation of both halves together.
    pub fn unexplained(&self, state: &State) -> Vec<(Key, f64)> {
        let [fit, holdout] = self.deviations(state);
        let limit = UNEXPLAINED[usize::from(!state.named.is_empty())];
        let mut out: Vec<(Key, f64)> = fit
            .iter()
            .filter_map(|(k, a)| {
                let b = holdout.get(k).copied().unwrap_or(*a);
                let same_side = a.signum() == b.signum() && b.abs() > 2.0;
                // Two halves of a look share the sensor's pattern and say hardly more than one.
                let halves =
                    if matches!(k.0, Place::Look(_)) { 2.0 } else { std::f64::consts::SQRT_2 };
                let both = (a + b) / halves;
                (same_side && both.abs() > limit).then_some((*k, both))
            })
            .collect();
        out.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
        out
    }
}

impl State {
    /// Held-out gap that the right model passes once in some two hundred replicates.
    pub fn limit(&self) -> f64 {
        GAP_LIMIT.max(1.0 + 3.5 * self.norm.1 / self.norm.0)
    }
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
fn same_shape(a: &Proposal, b: &Proposal) -> bool {
    a.effects.len() == b.effects.len()
        && a.parameters.iter().map(|p| p.0).eq(b.parameters.iter().map(|p| p.0))
}

/// The second proposal in the place of the first.
fn merged(first: &Proposal, second: Proposal) -> Proposal {
    Proposal { strength: first.strength, beside: first.beside, ..second }
}

/// What a replicate shows of edges, dots and charts.
fn imagined(camera: &Camera, design: &Design, lights: &[Electrons], seed: u64) -> Result<Values> {
    let pictures = replicate::pictures(camera, &design.looks, lights, seed)?;
    Ok(by_key(looks::battery(camera, design, &pictures)))
}

/// Where the manifest does not tell the illuminance of a scene, the measured mean does.
fn set_unknown_light(
    camera: &Camera,
    looks: &mut [Look],
    pictures: &[Picture],
    lights: &Lights,
) -> Result<()> {
    for (look, picture) in looks.iter_mut().zip(pictures).filter(|(l, _)| l.lux.is_none()) {
        let electrons = &lights.of(camera, std::slice::from_ref(look))?[0].data;
        let predicted =
            mean(electrons) * light::share(look) * model::dn_per_e(camera, look.analog_gain);
        let measured = mean(&picture.mean.data) - camera.sensor.black_level_dn;
        look.light = (measured / predicted.max(1e-12)).max(0.0);
    }
    Ok(())
}

/// Where the manifest does not tell the light, the measured mean does.
fn set_unknown_levels(camera: &Camera, design: &mut Design, stacks: &[Temporal]) {
    let black =
        maps::reference_dark(design).map_or(camera.sensor.black_level_dn, |i| stacks[i].level());
    let channels = Channels::new(camera);
    for (c, t) in design.conditions.iter_mut().zip(stacks) {
        if c.role == Role::Flat && !c.level_known {
            let k = super::model::dn_per_e(camera, c.analog_gain);
            let by_channel = channels.means(&t.mean.data);
            c.photo_e = by_channel.iter().map(|m| ((m - black) / k).max(0.0)).collect();
            c.before_e.clone_from(&c.photo_e);
        }
    }
}
