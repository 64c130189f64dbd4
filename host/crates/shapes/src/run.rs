//! The search for names, with shapes taken out where there are any.

use crate::Shape;
use crate::seen::shown;
use crate::view::View;
use crate::{dark_law, droop, line_noise, outliers, profile};
use crate::{seam, serial, stage, start_up, stitch, wave};
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_camera::empirical::Empirical;
use camrig_diagnose::data::design::Design;
use camrig_diagnose::finding::Finding;
use camrig_diagnose::model::replicate;
use camrig_diagnose::search::session::{Half, Measured, RUNS, SEED};
use camrig_diagnose::search::{self, Outcome, Session, State};
use camrig_diagnose::statistics::maps;
use camrig_diagnose::statistics::statistic::Key;
use camrig_diagnose::statistics::temporal::Temporal;
use std::collections::BTreeSet;

/// Twice the log-likelihood by which the frames must be likelier with shapes of the means taken
/// out and the names that are then given, than with names alone: what an effect of the catalogue
/// must gain too.
const GAIN: f64 = search::EVIDENCE_IN_ALL;

/// Finds shapes in the frames of a half, and asks those held out.
type Detector = fn(&View<'_>, &View<'_>) -> Vec<Box<dyn Shape>>;

/// Shapes that are in the means of the frames and nothing else. They are looked for first: laws of
/// the catalogue that are random may take them for their own.
const OF_MEANS: [Detector; 2] = [seam::find, wave::find];

/// Shapes of pixels, of the response and of the noise, for sets that no names explain: what the
/// catalogue explains is left to it. With each the effects of the catalogue that pass for it where
/// it is faint: where one of them is named, the shape is looked for all the same.
const OF_THE_REST: [(Detector, &[&str]); 6] = [
    (outliers::find, &[]),
    (dark_law::find, &[]),
    (stitch::find, &["nonlinearity", "full-well", "adc-nonlinearity"]),
    (droop::find, &["row-temporal-noise", "column-temporal-noise", "row-correlated-noise"]),
    (line_noise::find, &["row-temporal-noise", "column-temporal-noise"]),
    (serial::find, &[]),
];

/// Smooth shapes, of which laws of the catalogue are parts: for what names and the other shapes
/// leave.
const SMOOTH: [Detector; 1] = [profile::find];

/// Searches for the effects that the camera lacks, as [`search::run()`], and for shapes that no
/// effect has. Names are given to moments without the shapes; at the end the session has the
/// moments as they were measured, and the model that is judged on them runs the shapes too.
///
/// # Errors
/// A model that cannot be simulated.
pub fn run(
    session: &mut Session,
    camera: &Camera,
    without: &[String],
    say: &(dyn Fn(&str) + Sync),
) -> Result<Outcome> {
    let names = |s: &Session| search::run(s, camera, without, say);
    if session.processed {
        // A camera made what their noise is like.
        return names(session);
    }
    say("shapes");
    let of_means = find(session, camera, &OF_MEANS, None);
    let found = names(session)?;
    let mut so_far = SoFar { camera, found, shapes: Vec::new(), as_measured: None };
    so_far.take(session, of_means, Stay::IfLikelier, &names)?;
    if so_far.explains(session) {
        let rivals = find(session, camera, &so_far.rivals(), Some(&so_far.found.before));
        so_far.take(session, rivals, Stay::IfTheyRunBetter, &names)?;
    } else {
        say("shapes of what is left");
        let rest = find(session, camera, &OF_THE_REST.map(|d| d.0), Some(&so_far.found.before));
        so_far.take(session, rest, Stay::Always, &names)?;
    }
    if !so_far.explains(session) {
        let smooth = find(session, camera, &SMOOTH, None);
        so_far.take(session, smooth, Stay::IfLikelier, &names)?;
    }
    let SoFar { mut found, mut shapes, as_measured, .. } = so_far;
    if let Some(had) = as_measured {
        put_back(session, had);
    }
    if let Some(curve) = session.start_up
        && let Some(shape) = start_up::of(camera, &session.fit.design, curve)
    {
        session.expect_no_start_up();
        found.before = session.state(camera.clone(), Vec::new(), RUNS)?;
        found.gaps.0 = session.gap(&found.before);
        shapes.push(shape);
    }
    if !shapes.is_empty() {
        say("the model with the shapes");
        let alone = judge(session, &mut found, &shapes)?;
        if !session.accepts(&found.after, found.gaps.1) {
            let other = search::run_from(session, alone, without, say)?;
            found = likelier(session, found, other);
        }
        draw(session, &mut found, &shapes)?;
    }
    Ok(found)
}

/// The search for names.
type Names<'a> = dyn Fn(&Session) -> Result<Outcome> + 'a;

/// Whether shapes stay out of the frames.
#[derive(Clone, Copy)]
enum Stay {
    /// They do.
    Always,
    /// If the frames are likelier so than with names alone, for as much as each name must gain too:
    /// a name that the shape makes needless counts.
    IfLikelier,
    /// If the model that runs them, with the names that are then given, makes the frames likelier
    /// than the names that explain them already.
    IfTheyRunBetter,
}

/// What was found so far.
struct SoFar<'a> {
    camera: &'a Camera,
    found: Outcome,
    shapes: Vec<Box<dyn Shape>>,
    /// The moments as they were measured, where shapes were taken out.
    as_measured: Option<[Measured; 2]>,
}

impl SoFar<'_> {
    /// Whether the names explain what the shapes leave.
    fn explains(&self, session: &Session) -> bool {
        session.accepts(&self.found.after, self.found.gaps.1)
    }

    /// Takes shapes out and searches for names in the rest; puts them back where they do not stay.
    fn take(
        &mut self,
        session: &mut Session,
        new: Vec<Box<dyn Shape>>,
        stay: Stay,
        names: &Names<'_>,
    ) -> Result<()> {
        if new.is_empty() {
            return Ok(());
        }
        let names_alone = cost(session, &self.found.after);
        let mut had = take_out(session, self.camera, &new);
        let mut other = names(session)?;
        let stays = match stay {
            Stay::Always => {
                other = self.or_as_before(session, other)?;
                true
            }
            Stay::IfLikelier => cost(session, &other.after) + GAIN < names_alone,
            Stay::IfTheyRunBetter => {
                let without = put_back(session, had);
                let State { camera, named, .. } = &other.after;
                let camera = with_stages(camera, &session.fit.design, &new)?;
                let runs = session.state(camera, named.clone(), RUNS)?;
                let better = session.deviance(&runs) < session.deviance(&self.found.after);
                had = put_back(session, without);
                better
            }
        };
        if stays {
            self.found = Outcome { gaps: (self.found.gaps.0, other.gaps.1), ..other };
            self.as_measured.get_or_insert(had);
            self.shapes.extend(new);
        } else {
            put_back(session, had);
        }
        Ok(())
    }

    /// What names explain of the rest: those of the search in it, or those found before if it is
    /// likelier with them, as a search with fewer statistics may end where that one did not.
    fn or_as_before(&self, session: &Session, other: Outcome) -> Result<Outcome> {
        let State { camera, named, .. } = self.found.after.clone();
        let as_before = session.state(camera, named, RUNS)?;
        if session.deviance(&as_before) + GAIN >= session.deviance(&other.after) {
            return Ok(other);
        }
        let gaps = (other.gaps.0, session.gap(&as_before));
        Ok(Outcome { after: as_before, gaps, ..self.found.clone() })
    }

    /// Detectors of the shapes for which the effects that were named pass.
    fn rivals(&self) -> Vec<Detector> {
        let named = |kind: &&str| self.found.after.named.iter().any(|p| p.kind == *kind);
        let passed_for = OF_THE_REST.into_iter().filter(|(_, kinds)| kinds.iter().any(named));
        passed_for.map(|(detect, _)| detect).collect()
    }
}

/// Deviance of a model, and what its names must gain.
fn cost(session: &Session, state: &State) -> f64 {
    session.deviance(state) + GAIN * state.named.len() as f64
}

/// Of the names found without the shapes and of those found on the moments as they were measured,
/// with a model that runs the shapes: what shows in statistics that a shape sets aside is found so.
/// The first stay where the frames are not likelier with the others, for as much as a name must
/// gain.
fn likelier(session: &Session, found: Outcome, other: Outcome) -> Outcome {
    if cost(session, &other.after) + GAIN >= cost(session, &found.after) {
        return found;
    }
    Outcome {
        before: found.before,
        gaps: (found.gaps.0, other.gaps.1),
        gap_with_shapes: found.gap_with_shapes,
        ..other
    }
}

/// Judges the model that runs the shapes, with what was named beside them and without, on the
/// moments as they were measured; gives it without.
fn judge(session: &Session, found: &mut Outcome, shapes: &[Box<dyn Shape>]) -> Result<State> {
    let design = &session.fit.design;
    let alone =
        session.state(with_stages(&found.before.camera, design, shapes)?, Vec::new(), RUNS)?;
    found.gap_with_shapes = session.gap(&alone);
    let improved = with_stages(&found.after.camera, design, shapes)?;
    found.after = session.state(improved, found.after.named.clone(), RUNS)?;
    found.gaps.1 = session.gap(&found.after);
    Ok(alone)
}

/// What the shapes look like in the frames, in the model at the start and in that at the end.
fn draw(session: &Session, found: &mut Outcome, shapes: &[Box<dyn Shape>]) -> Result<()> {
    let design = &session.fit.design;
    let cameras = [&found.before.camera, &found.after.camera];
    let simulated: Vec<Vec<Temporal>> = cameras
        .into_iter()
        .map(|camera| replicate::simulate(camera, design, SEED, true))
        .collect::<Result<_>>()?;
    let moments = [&session.fit.stacks, &simulated[0], &simulated[1]];
    let camera = &found.before.camera;
    let maps = moments.map(|stacks| maps::maps(camera, design, stacks));
    let views = [0, 1, 2].map(|i| View {
        camera,
        design,
        stacks: moments[i],
        maps: &maps[i],
        prediction: Some(&found.before.fit),
    });
    found.shapes = Vec::new();
    for shape in shapes {
        let shown = shown(views.map(|view| shape.seen(&view)));
        let findings = shape.findings().into_iter();
        found.shapes.extend(findings.map(|f| Finding { shown: shown.clone(), ..f }));
    }
    Ok(())
}

/// A camera whose model runs the shapes.
fn with_stages(camera: &Camera, design: &Design, shapes: &[Box<dyn Shape>]) -> Result<Camera> {
    let mut camera = camera.clone();
    for shape in shapes {
        let findings = shape.findings();
        let description: Vec<&str> = findings.iter().map(|f| f.description.as_str()).collect();
        let description = Some(description.join("; "));
        let evidence = findings.first().map(|f| f.evidence[0]);
        for stage in shape.stages(&mut camera, design) {
            let description = description.clone();
            stage::add(&mut camera, Empirical { description, evidence, ..stage })?;
        }
    }
    camera.check_chain()?;
    Ok(camera)
}

/// Takes shapes out of the moments of both halves; gives the moments that they had.
fn take_out(session: &mut Session, camera: &Camera, shapes: &[Box<dyn Shape>]) -> [Measured; 2] {
    [&mut session.fit, &mut session.holdout].map(|half: &mut Half| {
        let mut stacks = half.stacks.clone();
        shapes.iter().for_each(|s| s.take_out(camera, &half.design, &mut stacks));
        let was: BTreeSet<Key> = half.values.keys().copied().collect();
        let aside = |key: &Key| {
            !was.contains(key) || shapes.iter().any(|s| s.sets_aside(&half.design, key))
        };
        let measured = half.measured(camera, stacks, &aside);
        half.exchange(measured)
    })
}

/// Puts moments back; gives those that stood in their place.
fn put_back(session: &mut Session, [fit, held_out]: [Measured; 2]) -> [Measured; 2] {
    [session.fit.exchange(fit), session.holdout.exchange(held_out)]
}

/// The shapes that some detectors find, each in what those before leave.
/// `model` is that as given, where what it predicts matters.
fn find(
    session: &Session,
    camera: &Camera,
    detectors: &[Detector],
    model: Option<&State>,
) -> Vec<Box<dyn Shape>> {
    let halves = [&session.fit, &session.holdout];
    let predictions = model.map(|m| [&m.fit, &m.holdout]);
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
            prediction: predictions.map(|p| p[i]),
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
