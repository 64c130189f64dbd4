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
#[derive(Default)]
pub(super) struct Exchanges {
    /// The selection with the best of them, if it is likelier, and the kind that it displaces.
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
    let mut out = Exchanges::default();
    let mut least = own.deviance();
    for step in &found.steps[..found.steps.len().saturating_sub(1)] {
        for rival in close_rivals(step, found.model) {
            let taken = step.trial.proposal.kind.to_string();
            let other = with_rival(measured, base, &own, step, rival)?;
            if (other.deviance() - own.deviance()).abs() < RIVAL_MARGIN {
                let rival = rival.proposal.kind.to_string();
                out.as_good.push(Rivals { taken: taken.clone(), rival });
            }
            if other.deviance() < least {
                least = other.deviance();
                let exchanged = Selection::exchanged(measured, found, &own, other, (step, rival));
                out.best = Some((exchanged, taken));
            }
        }
    }
    Ok(out)
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
