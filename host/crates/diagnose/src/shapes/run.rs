//! The search for names, with shapes taken out where there are any.

use super::view::View;
use super::{Finding, Shape, seam, wave};
use crate::search::session::{Half, Measured};
use crate::search::{self, Outcome, Session};
use crate::statistics::maps;
use crate::statistics::temporal::Temporal;
use camrig_base::Result;
use camrig_camera::Camera;

/// Twice the log-likelihood by which the frames must be likelier with shapes of the means taken
/// out and the names that are then given, than with names alone: what an effect of the catalogue
/// must gain too.
const GAIN: f64 = search::EVIDENCE_IN_ALL;

/// Finds shapes in the frames of a half, and asks those held out.
type Detector = fn(&View<'_>, &View<'_>) -> Vec<Box<dyn Shape>>;

/// Shapes that are in the means of the frames and nothing else. They are looked for first: laws of
/// the catalogue that are random may take them for their own.
const OF_MEANS: [Detector; 2] = [wave::find, seam::find];

/// Searches for the effects that the camera lacks, as [`search::run`], and for shapes that no
/// effect has. Where there are some, the moments that the session has at the end are without them.
///
/// # Errors
/// A model that cannot be simulated.
pub fn run(
    session: &mut Session,
    camera: &Camera,
    without: &[String],
    say: &(dyn Fn(&str) + Sync),
) -> Result<Outcome> {
    say("shapes");
    let shapes = find(session, camera, &OF_MEANS);
    let mut found = search::run(session, camera, without, say)?;
    if !shapes.is_empty() {
        found = without_shapes(session, camera, &shapes, found, &|s| {
            search::run(s, camera, without, say)
        })?;
    }
    Ok(found)
}

/// The outcome of the search on moments without some shapes, if the frames are likelier so;
/// otherwise the moments and the outcome are as they were.
fn without_shapes(
    session: &mut Session,
    camera: &Camera,
    shapes: &[Box<dyn Shape>],
    found: Outcome,
    search: &dyn Fn(&Session) -> Result<Outcome>,
) -> Result<Outcome> {
    let names_alone = session.deviance(&found.after);
    let had: Vec<Measured> = [&mut session.fit, &mut session.holdout]
        .into_iter()
        .map(|half| take_out(camera, half, shapes))
        .collect();
    let other = search(session)?;
    if session.deviance(&other.after) + GAIN < names_alone {
        let gaps = (found.gaps.0, other.gaps.1);
        let findings: Vec<Finding> = shapes.iter().flat_map(|s| s.findings()).collect();
        let findings = [found.shapes, findings].concat();
        return Ok(Outcome { gaps, shapes: findings, ..other });
    }
    for (half, had) in [&mut session.fit, &mut session.holdout].into_iter().zip(had) {
        half.exchange(had);
    }
    Ok(found)
}

/// Takes shapes out of the moments of a half; gives the moments that it had.
fn take_out(camera: &Camera, half: &mut Half, shapes: &[Box<dyn Shape>]) -> Measured {
    let mut stacks = half.stacks.clone();
    shapes.iter().for_each(|s| s.take_out(camera, &half.design, &mut stacks));
    let aside = |key: &_| shapes.iter().any(|s| s.sets_aside(&half.design, key));
    let measured = half.measured(camera, stacks, &aside);
    half.exchange(measured)
}

/// The shapes that some detectors find, each in what those before leave.
fn find(session: &Session, camera: &Camera, detectors: &[Detector]) -> Vec<Box<dyn Shape>> {
    let halves = [&session.fit, &session.holdout];
    let mut found: Vec<Box<dyn Shape>> = Vec::new();
    // Moments without what was found; none while nothing was.
    let mut left: Option<[Vec<Temporal>; 2]> = None;
    for detect in detectors {
        let maps = left
            .as_ref()
            .map(|stacks| [0, 1].map(|i| maps::maps(camera, &halves[i].design, &stacks[i])));
        let view = |i: usize| View {
            camera,
            design: &halves[i].design,
            stacks: left.as_ref().map_or(&halves[i].stacks, |l| &l[i]),
            maps: maps.as_ref().map_or(&halves[i].maps, |m| &m[i]),
        };
        let new = detect(&view(0), &view(1));
        if !new.is_empty() {
            let stacks = left.get_or_insert_with(|| halves.map(|h| h.stacks.clone()));
            for (half, stacks) in halves.iter().zip(stacks) {
                new.iter().for_each(|s| s.take_out(camera, &half.design, stacks));
            }
        }
        found.extend(new);
    }
    found
}
