//! Second thoughts of the search: estimates made anew together, names taken back.

use super::candidates::Proposal;
use super::prediction::{Key, Prediction, bounded};
use super::search::{EARNS, FEW, LEAST, Outcome, Step, TRIAL_RUNS, Trial, merged, same_shape};
use super::session::{Half, Session, State};
use super::statistics::{Place, What};
use camrig_base::Result;
use camrig_camera::Camera;
use std::f64::consts::FRAC_1_SQRT_2;

/// Deviation (standard deviations, both halves, and its part in each) that is gross, and the share of a name's evidence that gross deviations in
/// what it touches may have.
const GROSS: f64 = 10.0;
/// Most names of which each is left out with the others estimated anew, which costs their replicates.
const SOME: usize = 4;
/// See [`GROSS`].
const GROSS_SHARE: f64 = 0.1;
/// Standard errors by which a parameter must change to take over what a name explained.
const MOVED: f64 = 2.0;
/// Share of the winner's evidence from which a rival may win beside names that were not yet taken.
const CLOSE: f64 = 0.5;

impl Session {
    /// Estimates every named effect again with all of them in the model.
    pub(super) fn refit(&self, mut state: State) -> Result<State> {
        // A single name was settled when it was tried.
        for _ in 0..if state.named.len() > 1 { 2 } else { 1 } {
            let is_named = |kind: &str| state.named.iter().any(|p| p.kind == kind);
            let all = self.propose(
                self.fit.frames(),
                &state.camera,
                &state.fit,
                &state.named,
                &is_named,
                1.0,
            );
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
    pub(super) fn base(&self, state: &State) -> Camera {
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

    /// Leaves out effects, the first named first, whose absence nobody would notice.
    pub(super) fn drop_idle(
        &self,
        base: &Camera,
        mut state: State,
        steps: &mut Vec<Step>,
    ) -> Result<State> {
        let mut i = 0;
        while i < state.named.len() {
            let mut named = state.named.clone();
            let left_out = named.remove(i);
            let camera = named.iter().fold(base.clone(), |c, p| p.applied(&c));
            let before = &state.replicates[..TRIAL_RUNS as usize];
            let after = self.replicates(&camera, &self.fit, TRIAL_RUNS)?;
            let without = state.fit.moved(before, &after);
            let rise = |half: &Half, with: &Prediction, without: &Prediction| {
                without.deviance(&half.values, &half.allowance)
                    - with.deviance(&half.values, &half.allowance)
            };
            let missed = rise(&self.fit, &state.fit, &without)
                + rise(&self.holdout, &state.holdout, &state.holdout.moved(before, &after));
            let idle = missed < EARNS[2] / 2.0
                || !left_out.of_looks && self.stands_out(&left_out, &camera, &named)? < LEAST;
            // What it seems to explain the others may explain, once they are estimated without it, if that moves them.
            let some = state.named.len() <= SOME && !left_out.of_looks;
            let without = match idle || some && self.would_move(&camera, &without, &named) {
                true => Some(self.refit(self.state(camera, named)?)?),
                false => None,
            };
            let missed = |w: &State| self.deviance(w) - self.deviance(&state);
            match without.filter(|w| idle || missed(w) < EARNS[2] / 2.0) {
                Some(without) => {
                    let own = |s: &Step| s.trial.proposal.kind == left_out.kind;
                    if let Some(at) = steps.iter().position(own) {
                        steps.remove(at);
                    }
                    state = without;
                }
                None => i += 1,
            }
        }
        Ok(state)
    }

    /// Whether the frames to fit would give some of these names other parameters beside such a model.
    fn would_move(&self, camera: &Camera, model: &Prediction, named: &[Proposal]) -> bool {
        let wanted = |kind: &str| named.iter().any(|p| p.kind == kind);
        let anew = self.propose(self.fit.frames(), camera, model, named, &wanted, 0.0);
        named.iter().any(|p| {
            let same = |a: &&Proposal| a.kind == p.kind && !a.beside && same_shape(a, p);
            anew.iter().find(same).is_some_and(|a| {
                std::iter::zip(&a.parameters, &p.parameters)
                    .any(|((_, a), (_, p))| (a.value - p.value).abs() > MOVED * a.se)
            })
        })
    }

    /// A name, and how many were taken before it, in whose stead a close rival of its round explains more beside those taken
    /// later.
    pub(super) fn outdone(
        &self,
        base: &Camera,
        found: &Outcome,
    ) -> Result<Option<(String, usize)>> {
        let steps = &found.steps;
        if steps.len() > SOME {
            return Ok(None);
        }
        // To the last name taken its rivals lost with all others in place.
        for (at, step) in steps.iter().enumerate().take(steps.len().saturating_sub(1)) {
            let own = step.trial.proposal.kind;
            let close = |t: &&Trial| {
                t.evidence > CLOSE * step.trial.evidence
                    && !found.after.named.iter().any(|p| p.kind == t.proposal.kind)
            };
            let Some(rival) = step.others.iter().find(close) else { continue };
            let mut named = found.after.named.clone();
            named.retain(|p| p.kind != own);
            rival.proposal.clone().join(&mut named);
            let camera = named.iter().fold(base.clone(), |c, p| p.applied(&c));
            let other = self.refit(self.state(camera, named)?)?;
            if self.deviance(&other) < self.deviance(&found.after) {
                return Ok(Some((own.to_string(), at)));
            }
        }
        Ok(None)
    }

    /// Deviance of both halves.
    pub(super) fn deviance(&self, state: &State) -> f64 {
        state.fit.deviance(&self.fit.values, &self.fit.allowance)
            + state.holdout.deviance(&self.holdout.values, &self.holdout.allowance)
    }

    /// Takes back names that leave gross deviations in the very statistics, or the very map, that gave them away: another
    /// thing is there, of which the name was the nearest in the catalogue.
    pub(super) fn withdraw(
        &self,
        base: &Camera,
        mut state: State,
        steps: &mut Vec<Step>,
        nearest: &mut Vec<String>,
    ) -> Result<State> {
        // One or two names must fit.
        if steps.len() > FEW {
            return Ok(state);
        }
        // What the law of a map's pixels is like beyond its width is said, but takes no name back.
        let shape = |(place, what): &Key| {
            matches!((place, what), (Place::Map(_), What::Skewness | What::Kurtosis))
        };
        // One pixel's luck in one half is no other thing: few hot pixels have most of the scatter of a stack.
        let halves = self.deviations(&state);
        let in_each = |key: &Key| {
            halves.iter().all(|half| half.get(key).is_none_or(|z| z.abs() > GROSS * FRAC_1_SQRT_2))
        };
        let gross: Vec<(Key, f64)> = self
            .unexplained(&state)
            .into_iter()
            .filter(|(key, z)| z.abs() > GROSS && in_each(key) && !shape(key))
            .collect();
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
}
