//! What explains the captures: effects of the catalogue, and shapes that no effect has.
//!
//! Shapes are subtracted from what was measured, and the search names effects in the rest. Such an
//! attempt is kept or not by comparing it with the one before; at the end the model with both is
//! evaluated on the frames as they were measured.

use crate::measured::Measured;
use crate::search::evaluation::{Evaluation, RUNS};
use crate::search::{self, Known, Outcome};
use crate::shapes::detectors::{
    Detector, MEAN_DETECTORS, RESIDUAL_DETECTORS, SMOOTH_DETECTORS, detect,
};
use crate::shapes::{Shape, shown, stage, start_up};
use camrig_base::Result;
use camrig_camera::Camera;

/// Fall of the deviance from which a shape is kept beside named effects: what an effect of the
/// catalogue must gain too.
const GAIN: f64 = search::EVIDENCE_IN_ALL;

/// Finds the effects that the camera lacks, as [`search::run()`] does, and the shapes that no
/// effect has. Returns also what was measured as the models of the outcome are judged by it: with
/// the shapes in, and without the start-up that a model was given if the improved one has it.
///
/// # Errors
/// A model that cannot be simulated.
pub fn explain(
    measured: &Measured,
    camera: &Camera,
    known: &Known<'_>,
    trying: &(dyn Fn(&str) + Sync),
) -> Result<(Measured, Outcome)> {
    let search = |rest: &Measured| search::run(rest, camera, known, trying);
    if measured.processed {
        // Their noise is that of the processing, in which shapes would be found.
        return Ok((measured.clone(), search(measured)?));
    }
    trying("shapes");
    let of_means = detect(measured, camera, &MEAN_DETECTORS, None);
    let found = search(measured)?;
    let given = found.before.clone();
    let attempt = Attempt { measured: measured.clone(), camera, found, shapes: Vec::new() };
    let mut attempt = attempt.or_without(of_means, Keep::IfLikelier, &search)?;
    if attempt.found.after.passes() {
        let rivals = attempt.detect(&attempt.rivals(), Some(&given));
        attempt = attempt.or_without(rivals, Keep::IfSimulationImproves, &search)?;
    } else {
        trying("shapes of what is left");
        let rest = attempt.detect(&RESIDUAL_DETECTORS.map(|d| d.0), Some(&given));
        attempt = attempt.or_without(rest, Keep::Always, &search)?;
    }
    if !attempt.found.after.passes() {
        let smooth = attempt.detect(&SMOOTH_DETECTORS, None);
        attempt = attempt.or_without(smooth, Keep::IfLikelier, &search)?;
    }
    let Attempt { found, mut shapes, .. } = attempt;
    let mut found = Outcome { before: given, ..found };
    let mut measured = measured.clone();
    if let Some(curve) = measured.start_up
        && let Some(shape) = start_up::of(camera, &measured.fit.design, curve)
    {
        measured = measured.without_start_up();
        found.before = Evaluation::new(&measured, camera.clone(), Vec::new(), RUNS)?;
        shapes.push(shape);
    }
    if !shapes.is_empty() {
        trying("the model with the shapes");
        found = with_shapes(&measured, found, &shapes, known, trying)?;
    }
    Ok((measured, found))
}

/// Whether shapes stay subtracted from the frames.
#[derive(Clone, Copy)]
enum Keep {
    /// They do.
    Always,
    /// If the frames are likelier without them than with named effects alone, for as much as each
    /// name must gain too: a name that the shape makes needless counts.
    IfLikelier,
    /// If the model that simulates them, with the effects that are then named, makes the frames
    /// likelier than the names that explain them already.
    IfSimulationImproves,
}

/// Effects named in what is left of the frames without shapes.
struct Attempt<'a> {
    /// What the effects were named in.
    measured: Measured,
    /// The model as given.
    camera: &'a Camera,
    found: Outcome,
    shapes: Vec<Box<dyn Shape>>,
}

impl Attempt<'_> {
    fn detect(&self, detectors: &[Detector], model: Option<&Evaluation>) -> Vec<Box<dyn Shape>> {
        detect(&self.measured, self.camera, detectors, model)
    }

    /// Detectors of shapes that the named effects resemble.
    fn rivals(&self) -> Vec<Detector> {
        let named = |kind: &&str| self.found.after.named.iter().any(|p| p.kind == *kind);
        let resembled = RESIDUAL_DETECTORS.iter().filter(|(_, kinds)| kinds.iter().any(named));
        resembled.map(|d| d.0).collect()
    }

    /// The attempt that also subtracts `new` shapes and names effects in the rest, or this one if
    /// they are not kept.
    fn or_without(
        mut self,
        new: Vec<Box<dyn Shape>>,
        keep: Keep,
        search: &dyn Fn(&Measured) -> Result<Outcome>,
    ) -> Result<Self> {
        if new.is_empty() {
            return Ok(self);
        }
        let rest = self.measured.without(self.camera, &new);
        let mut found = search(&rest)?;
        let keeps = match keep {
            Keep::Always => {
                found = self.likelier_names(&rest, found)?;
                true
            }
            Keep::IfLikelier => cost(&found.after) + GAIN < cost(&self.found.after),
            Keep::IfSimulationImproves => {
                let simulated = simulating(&self.measured, &found.after, &new)?;
                simulated.deviance() < self.found.after.deviance()
            }
        };
        if !keeps {
            return Ok(self);
        }
        self.shapes.extend(new);
        Ok(Self { measured: rest, found, ..self })
    }

    /// Of the effects found in the rest and those found before the likelier ones, as a search with
    /// fewer statistics may end where the earlier one did not.
    fn likelier_names(&self, rest: &Measured, found: Outcome) -> Result<Outcome> {
        let Evaluation { camera, named, .. } = self.found.after.clone();
        let before = Evaluation::new(rest, camera, named, RUNS)?;
        match before.deviance() + GAIN >= found.after.deviance() {
            true => Ok(found),
            false => Ok(Outcome { after: before, ..self.found.clone() }),
        }
    }
}

/// Deviance of a model, and what its names must gain.
fn cost(model: &Evaluation) -> f64 {
    model.deviance() + GAIN * model.named.len() as f64
}

/// The outcome with models that simulate the shapes, on the frames as they were measured. What
/// shows only in statistics that a shape was subtracted from is named by a search that starts from
/// the model with the shapes, if it makes the frames likelier by as much as a name must gain.
fn with_shapes(
    measured: &Measured,
    found: Outcome,
    shapes: &[Box<dyn Shape>],
    known: &Known<'_>,
    trying: &(dyn Fn(&str) + Sync),
) -> Result<Outcome> {
    let shapes_alone = simulating(measured, &found.before, shapes)?;
    let gap_with_shapes = shapes_alone.gap;
    let after = simulating(measured, &found.after, shapes)?;
    let mut found = Outcome { after, gap_with_shapes, ..found };
    if !found.after.passes() {
        let other = search::run_from(measured, shapes_alone, known, trying)?;
        if cost(&other.after) + GAIN < cost(&found.after) {
            found = Outcome { before: found.before, gap_with_shapes, ..other };
        }
    }
    let cameras = [&found.before.camera, &found.after.camera];
    found.shapes = shown::findings(&measured.fit, cameras, &found.before.fit, shapes)?;
    Ok(found)
}

/// A model that simulates shapes too.
fn simulating(
    measured: &Measured,
    model: &Evaluation,
    shapes: &[Box<dyn Shape>],
) -> Result<Evaluation> {
    let camera = stage::with_stages(&model.camera, &measured.fit.design, shapes)?;
    Evaluation::new(measured, camera, model.named.clone(), RUNS)
}
