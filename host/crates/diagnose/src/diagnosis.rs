//! The diagnosis from a capture set to its report.

use crate::data::codes;
use crate::data::design::{self, Design, Halves};
use crate::explanation::explain;
use crate::measured::{Keep, Measured};
use crate::options::{Options, Progress};
use crate::report::{Comparison, Report};
use crate::search::Outcome;
use crate::search::evaluation::{Evaluation, RUNS};
use crate::verdict;
use crate::verdict::improved::{self, ImprovedFile};
use camrig_base::{Bands, Result};
use camrig_camera::Camera;
use camrig_captures::CaptureSet;
use camrig_clean::{Cleaned, Finding};

/// A diagnosis: its report, and what pages and camera files are made from.
pub struct Diagnosis {
    /// The report: what `diagnosis.json` contains.
    pub report: Report,
    /// What was measured.
    pub measured: Measured,
    /// What explains it: the models before and after, and how the search came to them.
    pub outcome: Outcome,
}

/// Finds where captures and a camera file disagree and which effects explain it: removes from the
/// frames what is not the sensor's steady behaviour, divides them into frames to fit and held-out
/// frames, measures both, and searches for effects of the catalogue and for shapes that no effect
/// has. The set may hold a region of the camera's sensor.
///
/// # Errors
/// Files that cannot be read, captures that cannot be the camera's or that contradict their
/// manifest, and models that cannot be simulated.
pub fn diagnose(camera: &Camera, set: CaptureSet, options: &Options<'_>) -> Result<Diagnosis> {
    let (camera, measured) = measure(camera, set, Keep::Moments, options)?;
    let trying = |what: &str| options.report(Progress::Trying(what));
    let (measured, outcome) = explain(&measured, &camera, &options.without, &trying)?;
    let report = verdict::report(&measured, &outcome);
    Ok(Diagnosis { report, measured, outcome })
}

/// Compares a camera file with captures, statistic by statistic, and searches for nothing.
///
/// # Errors
/// Those of [`diagnose()`].
pub fn compare(camera: &Camera, set: CaptureSet, options: &Options<'_>) -> Result<Comparison> {
    let (camera, measured) = measure(camera, set, Keep::Statistics, options)?;
    let model = Evaluation::new(&measured, camera, Vec::new(), RUNS)?;
    Ok(verdict::comparison(&measured, &model))
}

impl Diagnosis {
    /// The camera with the effects and shapes that were found.
    pub fn improved(&self) -> &Camera {
        &self.outcome.after.camera
    }

    /// The improved camera as a file; `given` is how the camera was named when it was loaded: a
    /// path or a preset.
    ///
    /// # Errors
    /// Tables of the camera file that cannot be read.
    pub fn improved_file(&self, given: &str) -> Result<ImprovedFile> {
        let Outcome { before, after, .. } = &self.outcome;
        improved::file(&before.camera.text, given, &after.camera, &after.named)
    }

    /// Name of the built-in plan with the captures that would show more; none where nothing is
    /// left open.
    pub fn next_plan(&self) -> Option<&'static str> {
        let open =
            !self.outcome.confounded.is_empty() || !self.outcome.after.unexplained.is_empty();
        open.then(|| verdict::next_plan(&self.outcome))
    }
}

/// Cleans, divides and measures a set. Returns also the camera in the digital numbers of the
/// cleaned frames, and with their size.
fn measure(
    camera: &Camera,
    mut set: CaptureSet,
    keep: Keep,
    options: &Options<'_>,
) -> Result<(Camera, Measured)> {
    if let Some(region) = options.region {
        set = set.within(region)?;
    }
    let mut camera = camera.clone();
    let (w, h) = (set.sensor.width as u32, set.sensor.height as u32);
    if w <= camera.sensor.width && h <= camera.sensor.height {
        (camera.sensor.width, camera.sensor.height) = (w, h);
    }
    let mut notes = table_notes(&camera, &set);
    notes.iter().for_each(|note| options.report(Progress::Note(note)));
    let total = Cleaned::frames_to_read(&set)?;
    let checked = |frames| options.report(Progress::Checked { frames, total });
    let cleaned = Cleaned::new(set, &camrig_clean::Options::default().with_progress(&checked))?;
    let (camera, set) = (codes::camera_of(&camera, &cleaned), cleaned.set());
    let counts = set.captures.iter().map(|c| set.count(c)).collect::<Result<Vec<_>>>()?;
    let halves = design::divide(&camera, set, &counts)?;
    let total = frames_to_measure(&halves);
    let report = |frames| options.report(Progress::Measured { frames, total });
    let mut measured = Measured::new(&camera, &cleaned, halves, keep, &report)?;
    let of_set: Vec<String> =
        measured.notes.into_iter().filter(|note| !notes.contains(note)).collect();
    of_set.iter().for_each(|note| options.report(Progress::Note(note)));
    measured.findings.iter().map(Finding::line).for_each(|l| options.report(Progress::Note(&l)));
    notes.extend(of_set);
    measured.notes = notes;
    Ok((camera, measured))
}

/// Notes on the tables of a camera file in the light of a set, each once.
fn table_notes(camera: &Camera, set: &CaptureSet) -> Vec<String> {
    let wavelengths = set.captures.iter().filter_map(|c| c.light.as_ref()?.wavelength_nm);
    let lit = wavelengths.map(|nm| Bands { start_nm: nm, step_nm: 10.0, count: 1 });
    let mut notes: Vec<String> = Vec::new();
    for note in lit.chain([Bands::VISIBLE]).flat_map(|bands| camera.notes(&bands)) {
        if !notes.contains(&note) {
            notes.push(note);
        }
    }
    notes
}

/// The stacks of a set are read once for each half.
fn frames_to_measure(halves: &Halves) -> usize {
    let of = |d: &Design| {
        let stacks = d.conditions.iter().map(|c| c.stack.frames);
        stacks.chain(d.targets.iter().map(|t| t.stack.frames)).sum::<usize>()
    };
    of(&halves.fit) + halves.holdout.as_ref().map_or(0, of)
}
