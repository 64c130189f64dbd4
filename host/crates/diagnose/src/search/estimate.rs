//! Estimates of effects from frames, measured or simulated, and all named effects estimated anew.

use super::evaluation::{Evaluation, Model};
use crate::candidates;
use crate::candidates::proposal::{Proposal, with_all};
use crate::evidence::Evidence;
use crate::measured::{Frames, Half, Measured};
use crate::model::replicate;
use crate::statistics::battery::battery;
use crate::statistics::maps::maps;
use crate::statistics::statistic::by_key;
use camrig_base::Result;
use camrig_camera::{AnyEffect, Camera};

/// Rounds of estimates of several names, which depend on each other; a single name was settled
/// when it was tried.
const ROUNDS: usize = 2;
/// Standard errors by which a parameter must differ for its estimate to be taken.
const MIN_CHANGE: f64 = 1.0;

/// Proposals of the kinds `wanted` that the frames of a half give against a model, strongest
/// first; those weaker than `least` standard errors are left out.
pub(super) fn propose(
    half: &Half,
    model: Model<'_>,
    wanted: &dyn Fn(&str) -> bool,
    least: f64,
) -> Vec<Proposal> {
    from_frames(half, half.frames(), model, wanted, least)
}

/// The same from a replicate of a model, taken as a half was: every proposal, however weak.
pub(super) fn propose_from_replicate(
    half: &Half,
    model: Model<'_>,
    wanted: &(dyn Fn(&str) -> bool + Sync),
    seed: u64,
) -> Result<Vec<Proposal>> {
    let (camera, design) = (model.camera, &half.design);
    let planes = wanted("periodic-pattern-noise");
    let stacks = replicate::simulate(camera, design, seed, planes)?;
    let values = by_key(battery(camera, design, &stacks));
    let maps = maps(camera, design, &stacks);
    let frames = Frames { values: &values, stacks: &stacks, maps: &maps, ..half.frames() };
    Ok(from_frames(half, frames, model, &wanted, f64::NEG_INFINITY))
}

fn from_frames(
    half: &Half,
    frames: Frames<'_>,
    model: Model<'_>,
    wanted: &dyn Fn(&str) -> bool,
    least: f64,
) -> Vec<Proposal> {
    let named = model.named.iter().map(|p| p.kind);
    let evidence = Evidence {
        camera: model.camera,
        design: frames.design,
        data: frames.values,
        model: model.prediction,
        stacks: frames.stacks,
        maps: frames.maps,
        allowance: frames.allowance,
        simulate_targets: &|camera| half.replicated_targets(camera),
        slopes: &half.optics.slopes,
        named: named.filter(|k| candidates::shown_by_targets(k)).collect(),
    };
    candidates::propose(&evidence, wanted, least)
}

/// Estimates every named effect again with all of them in the model, as long as that makes the
/// frames to fit likelier. Other models get as many replicates as this one has.
pub(super) fn refit(measured: &Measured, mut model: Evaluation) -> Result<Evaluation> {
    for _ in 0..if model.named.len() > 1 { ROUNDS } else { 1 } {
        let is_named = |kind: &str| model.named.iter().any(|p| p.kind == kind);
        let all = propose(&measured.fit, model.model(), &is_named, MIN_CHANGE);
        let mut named = model.named.clone();
        let mut moved = false;
        // What stands out by its own evidence has its values from there.
        for p in named.iter_mut().filter(|p| !p.by_evidence) {
            if let Some(next) = all.iter().find(|a| estimates(a, p)) {
                // Each name gets its own new values; those that it would revise are named too.
                *p = Proposal { revised: Vec::new(), ..p.updated(next.clone()) };
                moved = true;
            }
        }
        if !moved {
            break;
        }
        let camera = with_all(&without_added(&model), &named);
        let next = Evaluation::new(measured, camera, named, model.runs())?;
        if next.deviances[0] >= model.deviances[0] {
            break;
        }
        model = next;
    }
    Ok(model)
}

/// A camera with named effects, evaluated by so many replicates and refitted.
pub(super) fn fitted(
    measured: &Measured,
    camera: Camera,
    named: Vec<Proposal>,
    runs: u64,
) -> Result<Evaluation> {
    refit(measured, Evaluation::new(measured, camera, named, runs)?)
}

/// Whether a proposal is an estimate of a named effect.
pub(super) fn estimates(proposal: &Proposal, named: &Proposal) -> bool {
    proposal.kind == named.kind && !proposal.beside && proposal.has_parameters_of(named)
}

/// The camera of a model without the effects that were added to others of their kind, so that the
/// named ones can be put in again: all others replace those of their kind.
pub(super) fn without_added(model: &Evaluation) -> Camera {
    let mut camera = model.camera.clone();
    for p in model.named.iter().filter(|p| p.beside) {
        for effect in &p.effects {
            if let AnyEffect::Sensor(effect) = effect
                && let Some(at) = camera.effects.iter().position(|x| x == effect)
            {
                camera.effects.remove(at);
            }
        }
    }
    camera
}
