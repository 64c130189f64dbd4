//! A capture set without what was found in it.

use super::codes::Step;
use super::curves::Curve;
use super::finding::{Done, Finding, Kind};
use super::inspect::inspect;
use camrig_base::{Error, Plane, Result};
use camrig_captures::CaptureSet;
use std::collections::BTreeMap;

/// A capture set, what was found in it, and its frames without that.
pub struct Cleaned {
    /// As it was.
    raw: CaptureSet,
    /// With corrected labels, and its facts in steps of the codes.
    set: CaptureSet,
    pub(crate) findings: Vec<Finding>,
    pub(crate) changes: Changes,
}

/// What is done to the frames of a set.
#[derive(Default)]
pub(crate) struct Changes {
    /// By capture: samples that others stand in for, in the order of frames.
    pub replaced: BTreeMap<usize, Vec<Replaced>>,
    /// By capture: stated over true light × exposure.
    pub labels: BTreeMap<usize, f64>,
    /// A step that is taken off the codes.
    pub step: Option<Step>,
    /// What runs over the frames of all stacks.
    pub curve: Option<Curve>,
}

/// A sample that another value stands in for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Replaced {
    pub frame: usize,
    pub pixel: u32,
    pub value: u16,
}

impl Cleaned {
    /// Looks at a set and cleans it. `progress` hears how many frames were read; each is read a
    /// few times.
    ///
    /// # Errors
    /// Files that cannot be read, and sets of which nothing can be judged: copies of frames, and
    /// samples that something scaled.
    pub fn new(set: CaptureSet, progress: &(dyn Fn(usize) + Sync)) -> Result<Self> {
        let cleaned = Self::look(set, progress)?;
        cleaned.refused().map_or(Ok(cleaned), Err)
    }

    /// Looks at a set, and cleans it of what can be cleaned. The rest is among the findings.
    ///
    /// # Errors
    /// Files that cannot be read.
    pub fn look(set: CaptureSet, progress: &(dyn Fn(usize) + Sync)) -> Result<Self> {
        let (findings, changes) = inspect(&set, progress)?;
        let mut clean = set.clone();
        if let Some(step) = &changes.step {
            clean.sensor = step.facts(&set.sensor);
        }
        for (&index, &ratio) in &changes.labels {
            if let Some(light) = &mut clean.captures[index].light {
                let amounts = [
                    &mut light.irradiance_w_m2,
                    &mut light.photons_per_pixel_per_s,
                    &mut light.lux,
                ];
                amounts.into_iter().flatten().for_each(|a| *a /= ratio);
            }
        }
        Ok(Self { raw: set, set: clean, findings, changes })
    }

    /// The set: labels corrected, and where a step was taken off the codes, `bits`, black and
    /// white level in steps.
    pub fn set(&self) -> &CaptureSet {
        &self.set
    }

    /// What was found.
    pub fn findings(&self) -> &[Finding] {
        &self.findings
    }

    /// The step that was taken off the codes.
    pub fn step(&self) -> Option<Step> {
        self.changes.step
    }

    /// What runs over the frames of all stacks, which a model has to have too.
    pub fn curve(&self) -> Option<Curve> {
        self.changes.curve
    }

    /// Whether a camera processed the frames, so that their noise is not that of its sensor.
    pub fn is_processed(&self) -> bool {
        self.findings.iter().any(|f| f.kind == Kind::ProcessedFrames)
    }

    /// Why nothing can be judged of the set, where that is so.
    pub fn refused(&self) -> Option<Error> {
        let refused: Vec<&Finding> =
            self.findings.iter().filter(|f| f.done == Done::Refused).collect();
        let first = refused.first()?;
        let more = match refused.len() {
            1 => String::new(),
            n => format!("; {} more captures have such frames", n - 1),
        };
        let help = match first.kind {
            Kind::IdenticalFrames => {
                "take frames anew, or keep one of each; copies of a frame \
                                      (identical bytes) look like a sensor without noise"
            }
            _ => "undo what was done to the samples",
        };
        let what = Error::input(format!("{}: {}{more}", first.kind.word(), first.description));
        Some(what.at(format!("capture {:?}", first.place)).help(help))
    }

    /// Calls `each` with the frames of a capture in order of time, a few at a time, without what
    /// was found in them. Returns their number.
    ///
    /// # Errors
    /// Those of [`CaptureSet::for_each_batch`].
    pub fn for_each_batch(
        &self,
        index: usize,
        mut each: impl FnMut(&[Plane<u16>]) -> Result<()>,
    ) -> Result<usize> {
        let replaced = self.changes.replaced.get(&index).map_or(&[][..], Vec::as_slice);
        let capture = &self.raw.captures[index];
        if replaced.is_empty() && self.changes.step.is_none() {
            return self.raw.for_each_batch(capture, each);
        }
        let mut first = 0;
        self.raw.for_each_batch(capture, |planes| {
            let mut planes = planes.to_vec();
            for (i, plane) in planes.iter_mut().enumerate() {
                let start = replaced.partition_point(|r| r.frame < first + i);
                for r in replaced[start..].iter().take_while(|r| r.frame == first + i) {
                    plane.data[r.pixel as usize] = r.value;
                }
                if let Some(step) = &self.changes.step {
                    plane.data.iter_mut().for_each(|v| *v = step.code(*v));
                }
            }
            first += planes.len();
            each(&planes)
        })
    }
}
