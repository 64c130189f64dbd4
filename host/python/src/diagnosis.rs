//! What a camera model and captures disagree about.

use crate::camera::Camera;
use crate::captures::Captures;
use crate::errors::OrRaise;
use crate::working::{self, Step};
use camrig::diagnose::{self as library, Options, Progress};
use pyo3::prelude::*;
use std::sync::Mutex;

/// A diagnosis: its report, and the camera with what it found.
#[pyclass(frozen, module = "camrig", name = "_Diagnosis")]
pub struct Diagnosis {
    #[pyo3(get)]
    report: String,
    #[pyo3(get)]
    improved: String,
}

/// Searches for the effects that a camera lacks.
#[pyfunction]
#[pyo3(signature = (camera, captures, *, region = None, without, progress = None))]
pub fn diagnose(
    py: Python<'_>,
    camera: &Bound<'_, Camera>,
    captures: &Bound<'_, Captures>,
    region: Option<[usize; 4]>,
    without: Vec<String>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Diagnosis> {
    let (camera, set) = (&camera.get().camera, captures.get().set.clone());
    working::run(py, progress, |step| {
        let mut options = Options::default().without(without).or_raise()?;
        options.region = region;
        let told = telling(step);
        let found = library::diagnose(camera, set, &options.with_progress(&told)).or_raise()?;
        let improved = found.improved_file(&camera.name).or_raise()?.text;
        Ok(Diagnosis { report: found.report.json(), improved })
    })
}

/// Compares a camera with captures, and searches nothing.
#[pyfunction]
#[pyo3(signature = (camera, captures, *, region = None, progress = None))]
pub fn compare(
    py: Python<'_>,
    camera: &Bound<'_, Camera>,
    captures: &Bound<'_, Captures>,
    region: Option<[usize; 4]>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let (camera, set) = (&camera.get().camera, captures.get().set.clone());
    working::run(py, progress, |step| {
        let mut options = Options::default();
        options.region = region;
        let told = telling(step);
        Ok(library::compare(camera, set, &options.with_progress(&told)).or_raise()?.json())
    })
}

/// Steps of a diagnosis, frames counted.
fn telling<'a>(step: &'a (dyn Fn(Step) + Sync)) -> impl Fn(Progress<'_>) + Sync + 'a {
    let counts = Mutex::new((0, 0));
    move |progress| {
        let counted = |checked, frames| {
            let mut counts = counts.lock().unwrap_or_else(|e| e.into_inner());
            let count = if checked { &mut counts.0 } else { &mut counts.1 };
            *count += frames;
            *count
        };
        let of = |what: &str, done, total| Step { what: what.to_owned(), done, total };
        match progress {
            Progress::Checked { frames, total } => step(of("check", counted(true, frames), total)),
            Progress::Measured { frames, total } => {
                step(of("measure", counted(false, frames), total));
            }
            Progress::Note(text) | Progress::Trying(text) => step(of(text, 0, 0)),
            _ => {}
        }
    }
}
