//! Each effect against the rivals of its round once more, with all that was found since in place:
//! what was added early may have taken what a rival explains better together with later ones.

use super::estimate::fitted;
use super::evaluation::{Evaluation, RUNS_ON_THE_WAY};
use super::forward::{Found, RIVAL_MARGIN, Rivals, Selection, Step};
use super::trial::Trial;
use crate::candidates::proposal::with_all;
use crate::measured::Measured;
use camrig_base::Result;
use camrig_camera::Camera;

/// Fraction of the winner's evidence from which a rival of its round is tried in its place.
const CLOSE_RIVAL: f64 = 0.5;

/// What the rivals of named effects come to in their places.
pub(super) struct Exchanges {
    /// The selection with the best of them, if it explains more, and the kind that it displaces.
    pub best: Option<(Selection, String)>,
    /// Those that explain as much as the effect that was named.
    pub as_good: Vec<Rivals>,
}

/// Puts every close rival in the place of the effect that it lost to. The rivals of the last one
/// lost with all others in place.
pub(super) fn exchanges(
    measured: &Measured,
    base: &Camera,
    found: Found<'_>,
) -> Result<Exchanges> {
    let own = found.model.by(measured, RUNS_ON_THE_WAY)?;
    let mut as_good = Vec::new();
    let mut best: Option<(Evaluation, &Step, &Trial)> = None;
    for step in &found.steps[..found.steps.len().saturating_sub(1)] {
        for rival in close_rivals(step, found.model) {
            let other = with_rival(measured, base, &own, step, rival)?;
            if (other.deviance() - own.deviance()).abs() < RIVAL_MARGIN {
                let [taken, rival] = [&step.trial, rival].map(|t| t.proposal.kind.to_string());
                as_good.push(Rivals { taken, rival });
            }
            let least = best.as_ref().map_or(own.deviance() - RIVAL_MARGIN, |b| b.0.deviance());
            if other.deviance() < least {
                best = Some((other, step, rival));
            }
        }
    }
    let best = best.map(|(model, displaced, rival)| {
        let kind = displaced.trial.proposal.kind.to_string();
        (Selection::exchanged(measured, found, &own, model, (displaced, rival)), kind)
    });
    Ok(Exchanges { best, as_good })
}

fn close_rivals<'a>(step: &'a Step, model: &'a Evaluation) -> impl Iterator<Item = &'a Trial> {
    let is_named = |t: &Trial| model.named.iter().any(|p| p.kind == t.proposal.kind);
    let close = CLOSE_RIVAL * step.trial.evidence;
    step.others.iter().filter(move |t| t.evidence > close && !is_named(t))
}

/// The model with a rival in place of an effect, all others estimated again.
fn with_rival(
    measured: &Measured,
    base: &Camera,
    own: &Evaluation,
    step: &Step,
    rival: &Trial,
) -> Result<Evaluation> {
    let mut named = own.named.clone();
    named.retain(|p| p.kind != step.trial.proposal.kind);
    rival.proposal.clone().join(&mut named);
    // With as many replicates: more of them make every deviation larger.
    fitted(measured, with_all(base, &named), named, RUNS_ON_THE_WAY)
}
