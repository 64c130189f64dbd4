//! A capture set whose frames show the steady behaviour of its sensor, with what was found.

use super::codes::Step;
use super::corrections::Corrections;
use super::curves::FrameCurve;
use super::finding::{Done, Finding, Kind};
use super::inspect::inspect;
use super::options::Options;
use super::torn;
use camrig_base::{Error, Plane, Result};
use camrig_captures::{Capture, CaptureSet, Role};

/// A capture set with its findings; its frames are corrected as they are read.
pub struct Cleaned {
    /// As it was.
    raw: CaptureSet,
    /// With corrected labels, and bits and levels in units of the step of the codes.
    set: CaptureSet,
    pub(crate) findings: Vec<Finding>,
    corrections: Corrections,
}

impl Cleaned {
    /// Inspects a set and corrects what can be corrected.
    ///
    /// # Errors
    /// Files that cannot be read, and sets from which nothing can be measured: copied frames,
    /// scaled samples ([`Cleaned::refused`]).
    pub fn new(set: CaptureSet, options: &Options<'_>) -> Result<Self> {
        let cleaned = Self::inspect(set, options)?;
        cleaned.refused().map_or(Ok(cleaned), Err)
    }

    /// As [`Cleaned::new`], but sets from which nothing can be measured are accepted too, for
    /// their findings.
    ///
    /// # Errors
    /// Files that cannot be read.
    pub fn inspect(set: CaptureSet, options: &Options<'_>) -> Result<Self> {
        let (set, torn) = torn::left_out(set)?;
        let (mut findings, corrections) = inspect(&set, options)?;
        findings.iter_mut().for_each(|f| torn::number_all_frames(&set, f));
        findings.splice(0..0, torn);
        Ok(Self { set: corrections.apply_to_set(&set), raw: set, findings, corrections })
    }

    /// A set as measurements of its sensor take it, and what was found in words: labels of light
    /// that contradict the frames are mended and torn frames left out.
    ///
    /// # Errors
    /// Files that cannot be read; captures that the sensor merged.
    pub fn for_measurements(
        set: CaptureSet,
        options: &Options<'_>,
    ) -> Result<(CaptureSet, Vec<String>)> {
        let cleaned = Self::inspect(set.clone(), options)?;
        let refused = |f: &Finding| f.kind == Kind::Requantised && f.done == Done::Refused;
        let merged = cleaned.findings.iter().any(refused).then(|| cleaned.refused()).flatten();
        if let Some(error) = merged {
            return Err(error);
        }
        // A model's temperature is none of a measurement's, which refuses copies itself.
        let of_model = [Kind::Temperature, Kind::IdenticalFrames];
        let told = cleaned.findings.iter().filter(|f| !of_model.contains(&f.kind));
        let told = told.map(Finding::line).collect();
        Ok((CaptureSet { captures: cleaned.set.captures, ..set }, told))
    }

    /// Frames that [`Options::progress`] receives in all: those of dark and flat stacks, each
    /// twice.
    ///
    /// # Errors
    /// Files that cannot be read.
    pub fn frames_to_read(set: &CaptureSet) -> Result<usize> {
        let of_light = set.captures.iter().filter(|c| matches!(c.role, Role::Dark | Role::Flat));
        Ok(2 * of_light.map(|c| set.count(c)).sum::<Result<usize>>()?)
    }

    /// The set with corrected labels and, where samples were divided by a step, with bits, black
    /// and white level in units of that step.
    pub fn set(&self) -> &CaptureSet {
        &self.set
    }

    /// What was found.
    pub fn findings(&self) -> &[Finding] {
        &self.findings
    }

    /// The step that the samples were divided by.
    pub fn step(&self) -> Option<Step> {
        self.corrections.step
    }

    /// The curve over the frames of all stacks, which the frames keep and a model must include.
    pub fn curve(&self) -> Option<FrameCurve> {
        self.corrections.curve
    }

    /// Whether a camera processed the frames, so that their noise is not that of its sensor.
    pub fn is_processed(&self) -> bool {
        self.findings.iter().any(|f| f.kind == Kind::ProcessedFrames)
    }

    /// Why nothing can be measured from the set; `None` where it can be used.
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
                "take the frames again, or keep one of each; copies of a frame (identical bytes) \
                 look like a sensor without noise"
            }
            Kind::Requantised => {
                "photon transfer holds for one reading of a pixel: have the sensor send its \
                 captures one by one (simulated: sensor.hdr.output = \"captures\", or --capture \
                 NAME), and measure each"
            }
            _ => "undo the scaling of the samples",
        };
        let what = Error::input(format!("{}: {}{more}", first.kind, first.description));
        Some(what.at(format!("capture {:?}", first.place)).help(help))
    }

    /// Calls `each` with the corrected frames of a capture in order of time, a few at a time.
    /// Returns their number.
    ///
    /// # Errors
    /// Those of [`CaptureSet::for_each_batch`].
    pub fn for_each_batch(
        &self,
        index: usize,
        each: impl FnMut(&[Plane<u16>]) -> Result<()>,
    ) -> Result<usize> {
        let capture = &self.raw.captures[index];
        if !self.corrections.change_frames_of(index) {
            return self.raw.for_each_batch(capture, each);
        }
        self.corrected(index, capture, each)
    }

    /// As [`Cleaned::for_each_batch`], with the torn frames among them.
    ///
    /// # Errors
    /// Those of [`CaptureSet::for_each_batch`].
    pub fn for_each_batch_with_torn(
        &self,
        index: usize,
        each: impl FnMut(&[Plane<u16>]) -> Result<()>,
    ) -> Result<usize> {
        let capture = Capture { left_out: Vec::new(), ..self.raw.captures[index].clone() };
        self.corrected(index, &capture, each)
    }

    /// The frames of a capture, corrected: samples are replaced by the numbers of frames that are
    /// not torn.
    fn corrected(
        &self,
        index: usize,
        capture: &Capture,
        mut each: impl FnMut(&[Plane<u16>]) -> Result<()>,
    ) -> Result<usize> {
        let torn = match capture.left_out.is_empty() {
            true => &self.raw.captures[index].left_out[..],
            false => &[],
        };
        let (mut all, mut whole) = (0, 0);
        self.raw.for_each_batch(capture, |planes| {
            let mut planes = planes.to_vec();
            for plane in &mut planes {
                let number = (!torn.contains(&all)).then_some(whole);
                self.corrections.apply_to_frame(index, number, plane);
                whole += usize::from(number.is_some());
                all += 1;
            }
            each(&planes)
        })
    }
}
