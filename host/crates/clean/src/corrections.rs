//! What is corrected in the frames and labels of a set, so that they show the sensor alone.

use super::codes::Step;
use super::curves::FrameCurve;
use camrig_base::Plane;
use camrig_captures::CaptureSet;
use std::collections::BTreeMap;

/// The corrections of a set.
#[derive(Default)]
pub(crate) struct Corrections {
    /// By capture: samples that get another value, in the order of frames.
    pub replaced: BTreeMap<usize, Vec<Replaced>>,
    /// By capture: stated over true light × exposure.
    pub labels: BTreeMap<usize, f64>,
    /// The step that all samples are multiples of, and are divided by.
    pub step: Option<Step>,
    /// Code at which samples saturate, where it is below the white level of the manifest.
    pub top_code: Option<u16>,
    /// A curve over the frames of all stacks. Frames keep it; a model must include it.
    pub curve: Option<FrameCurve>,
}

/// The value of a sample before and after it was replaced, DN.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Substitution {
    pub from: u16,
    pub to: u16,
}

/// A sample that was replaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Replaced {
    pub frame: usize,
    pub pixel: u32,
    pub value: u16,
}

impl Corrections {
    /// A set with its labels corrected, and bits and levels in units of the step.
    pub fn apply_to_set(&self, set: &CaptureSet) -> CaptureSet {
        let mut out = set.clone();
        if let Some(top) = self.top_code {
            out.sensor.white_level_dn = top;
        }
        if let Some(step) = &self.step {
            out.sensor = step.facts(&out.sensor);
        }
        for (&index, &ratio) in &self.labels {
            if let Some(light) = &mut out.captures[index].light {
                let amounts = [
                    &mut light.irradiance_w_m2,
                    &mut light.photons_per_pixel_per_s,
                    &mut light.lux,
                ];
                amounts.into_iter().flatten().for_each(|a| *a /= ratio);
            }
        }
        out
    }

    /// Whether the frames of a capture are to be changed.
    pub fn change_frames_of(&self, capture: usize) -> bool {
        self.step.is_some() || self.replaced.get(&capture).is_some_and(|r| !r.is_empty())
    }

    /// Corrects a frame of a capture, whose number none has that is left out.
    pub fn apply_to_frame(&self, capture: usize, frame: Option<usize>, plane: &mut Plane<u16>) {
        let frame = frame.unwrap_or(usize::MAX);
        let replaced = self.replaced.get(&capture).map_or(&[][..], Vec::as_slice);
        let start = replaced.partition_point(|r| r.frame < frame);
        for r in replaced[start..].iter().take_while(|r| r.frame == frame) {
            plane.data[r.pixel as usize] = r.value;
        }
        if let Some(step) = &self.step {
            plane.data.iter_mut().for_each(|v| *v = step.code(*v));
        }
    }
}
