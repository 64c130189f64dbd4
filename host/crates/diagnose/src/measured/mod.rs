//! What was measured of a capture set, as a value that never changes.

mod assumed_light;
mod consistency;
mod half;

pub(crate) use half::Frames;
pub use half::{Half, SEED};

use crate::data::design::{Design, Halves, same_settings};
use crate::model::light;
use crate::shapes::Shape;
use crate::statistics::allowances;
use crate::statistics::statistic::{Key, Place, What};
use crate::statistics::targets;
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_captures::Role;
use camrig_clean::{Cleaned, Finding, FrameCurve, Kind};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A capture set as it was measured. It never changes: without shapes it is another value, and
/// copies share frames and maps.
#[derive(Clone)]
pub struct Measured {
    /// Frames to fit.
    pub fit: Half,
    /// Held-out frames; where the set has none, the same as `fit`, and nothing is confirmed.
    pub holdout: Half,
    /// Whether there are held-out frames.
    pub can_confirm: bool,
    /// Notes for people.
    pub notes: Vec<String>,
    /// What was found in the captures that is not the sensor's steady behaviour.
    pub findings: Vec<Finding>,
    /// The first frames after a start, which the model is given since its camera has no start-up.
    pub start_up: Option<FrameCurve>,
    /// Whether a camera processed the frames: then no effect is named from them.
    pub processed: bool,
}

/// What is kept of dark and flat frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Keep {
    /// Everything that estimators of effects read, some hundred bytes per pixel.
    Moments,
    /// Statistics alone, which a comparison reads.
    Statistics,
}

impl Measured {
    /// Measures the frames of a set. `progress` receives how many were read.
    ///
    /// # Errors
    /// Files that cannot be read; captures that contradict their manifest.
    pub fn new(
        camera: &Camera,
        set: &Cleaned,
        halves: Halves,
        keep: Keep,
        progress: &(dyn Fn(usize) + Sync),
    ) -> Result<Self> {
        let (optics, curve) = (Arc::default(), followed(camera, set));
        let half = |design| Half::measure(camera, set, design, curve, &optics, progress);
        let kept = |half: Half| match keep {
            Keep::Moments => half,
            Keep::Statistics => half.without_moments(),
        };
        let mut notes = halves.notes;
        notes.extend(light::notes(camera, &halves.fit.targets)?);
        if halves.fit.conditions.iter().any(|c| c.stack.role == Role::Flat && !c.even) {
            notes.push(
                "the light of flats may be uneven (uniformity = \"unknown\"): smooth shading is \
                 not judged"
                    .into(),
            );
        }
        let fit = half(halves.fit)?;
        consistency::check(camera, &fit.design, &fit.stacks)?;
        let fit = kept(fit);
        for (target, picture) in fit.design.targets.iter().zip(&*fit.pictures) {
            let why = match targets::figures(camera, target, picture) {
                Err(e) => e.to_string(),
                Ok(figures) if figures.is_empty() => {
                    "what it shows is too small in these frames to be measured".into()
                }
                Ok(_) => continue,
            };
            notes.push(format!("{}: {why}; left out", target.stack.id));
        }
        let can_confirm = halves.holdout.is_some();
        let holdout = match halves.holdout {
            Some(design) => kept(half(design)?),
            None => {
                notes.push("no held-out frames: names stay tentative".into());
                kept(half(fit.design.clone())?)
            }
        };
        notes.extend(saturated_note([&fit, &holdout]));
        notes.extend(allowances::note(&fit.design, &fit.allowance, &fit.values));
        let findings = set.findings().to_vec();
        if findings.iter().any(|f| f.kind == Kind::Temperature) {
            let assumed = camera.sensor.temperature_c;
            notes.push(format!("temperature not given: {assumed} °C, the camera file's, assumed"));
        }
        let start_up = curve.filter(|c| !c.of_light);
        let processed = set.is_processed();
        Ok(Self { fit, holdout, can_confirm, notes, findings, start_up, processed })
    }

    /// The same without shapes: they are subtracted from the moments, and statistics that show
    /// them all the same are left out.
    pub(crate) fn without(&self, camera: &Camera, shapes: &[Box<dyn Shape>]) -> Self {
        let [fit, holdout] = [&self.fit, &self.holdout].map(|half| half.without(camera, shapes));
        Self { fit, holdout, ..self.clone() }
    }

    /// The same for models that get no start-up: their camera has one, or is judged as lacking it.
    pub(crate) fn without_start_up(&self) -> Self {
        let [fit, holdout] = [&self.fit, &self.holdout].map(Half::without_start_up);
        Self { fit, holdout, start_up: None, ..self.clone() }
    }

    /// Whether both halves are as many frames of the same captures and a camera is the same in
    /// both, so that one prediction serves both.
    pub(crate) fn halves_are_alike(&self, camera: &Camera) -> bool {
        let frames = |d: &Design| -> Vec<(usize, usize)> {
            let conditions = d.conditions.iter().map(|c| &c.stack);
            let stacks = conditions.chain(d.targets.iter().map(|t| &t.stack));
            stacks.map(|s| (s.capture, s.frames)).collect()
        };
        let even = |d: &Design| d.conditions.iter().all(|c| c.stack.variation.is_none());
        !camera.changes_after_its_start()
            && even(&self.fit.design)
            && even(&self.holdout.design)
            && frames(&self.fit.design) == frames(&self.holdout.design)
    }

    /// A statistic of the frames to fit as the held-out half numbers it; none where that has no
    /// such stack: short stacks belong to one half as a whole.
    pub(crate) fn held_out(&self, (place, what): Key) -> Option<Key> {
        let Place::Stack(i) = place else { return Some((place, what)) };
        let own = &self.fit.design.conditions.get(i)?.stack;
        let others = || self.holdout.design.conditions.iter().map(|c| &c.stack);
        let same = others().position(|s| s.capture == own.capture);
        let alike = || others().nth(i).is_some_and(|s| same_settings(s, own)).then_some(i);
        Some((Place::Stack(same.or_else(alike)?), what))
    }
}

/// What varies over the frames of a set and the model is given too. A camera that has a start-up
/// is given no other.
fn followed(camera: &Camera, set: &Cleaned) -> Option<FrameCurve> {
    set.curve().filter(|c| c.of_light || !camera.changes_after_its_start())
}

/// The note on saturated flats that were left out since their light is not known.
fn saturated_note(halves: [&Half; 2]) -> Option<String> {
    let without = |half: &Half| -> Vec<(usize, String)> {
        let flats = half.design.conditions.iter().enumerate().filter(|(_, c)| c.is_flat());
        let all =
            flats.filter(|(i, _)| !half.values.contains_key(&(Place::Stack(*i), What::Saturated)));
        all.map(|(_, c)| (c.stack.capture, c.stack.id.clone())).collect()
    };
    let all: BTreeMap<usize, String> = halves.into_iter().flat_map(without).collect();
    let ids: Vec<&str> = all.values().map(String::as_str).collect();
    (!ids.is_empty()).then(|| {
        format!(
            "{}: saturated, and the manifest does not say how much light they had (wavelength_nm \
             with its amount): left out",
            ids.join(", ")
        )
    })
}
