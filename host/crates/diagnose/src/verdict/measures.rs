//! The measures of Chen et al. 2009, section VI, on a diagnosed set: MTF at the Nyquist frequency,
//! scatter of the luminance in the patches of a ColorChecker (Table I), the profile of a row.
//! Held-out frames, the model before and after.

use crate::data::design::Target;
use crate::measured::Measured;
use crate::report::{LuminanceScatter, Measures, MtfAtNyquist, RowProfile};
use crate::search::{Evaluation, Outcome};
use crate::statistics::statistic::{Figure, Key, Place, What};
use crate::statistics::targets::densest_channel;
use camrig_base::Plane;
use camrig_camera::Camera;
use camrig_captures::Role;
use camrig_measure::patches::{COUNT, DARK};
use camrig_measure::profile::{self, Along};

/// The part of an edge in the middle of the frame.
const MIDDLE_PART: u8 = 1;
/// Half a cycle per pixel, in tenths.
const NYQUIST_TENTHS: u8 = 5;
/// The paper's row, and the rows of its sensor.
const ROW: (usize, usize) = (510, 1536);

/// The measures of an outcome.
pub(super) fn measures(measured: &Measured, outcome: &Outcome) -> Measures {
    let mut out = Measures::default();
    for (i, target) in measured.holdout.design.targets.iter().enumerate() {
        let seen = Seen { measured, outcome, target, index: i };
        out.mtf_at_nyquist.extend(seen.mtf());
        if target.stack.role == Role::Chart {
            out.luminance_scatter.extend(seen.scatter());
            out.row_profile.extend(seen.row());
        }
    }
    out
}

/// A target of the held-out frames.
struct Seen<'a> {
    measured: &'a Measured,
    outcome: &'a Outcome,
    target: &'a Target,
    index: usize,
}

impl Seen<'_> {
    /// A figure: measured, by the model before and after, and its standard deviation on its scale.
    fn figure(&self, figure: Figure) -> Option<(f64, [f64; 2], f64)> {
        let key: Key = (Place::Target(self.index), What::Of(figure));
        let model = |s: &Evaluation| s.holdout.of.get(&key).map(|p| p.value);
        let sd = self.outcome.after.holdout.of.get(&key)?.sd;
        let measured = self.measured.holdout.values.get(&key)?.value;
        Some((measured, [model(&self.outcome.before)?, model(&self.outcome.after)?], sd))
    }

    fn capture(&self) -> String {
        self.target.stack.id.clone()
    }

    fn mtf(&self) -> Vec<MtfAtNyquist> {
        let channels = self.outcome.before.camera.sensor.channel_names.iter().enumerate();
        let of = |(c, name): (usize, &String)| {
            let channel = c as u8;
            let figure = Figure::Response { part: MIDDLE_PART, channel, tenths: NYQUIST_TENTHS };
            let (measured, [before, after], std_dev) = self.figure(figure)?;
            let (capture, channel) = (self.capture(), name.clone());
            Some(MtfAtNyquist { after, before, capture, channel, measured, std_dev })
        };
        channels.filter_map(of).collect()
    }

    fn scatter(&self) -> Option<LuminanceScatter> {
        let patches: Vec<(usize, [f64; 3])> = (1..=COUNT)
            .filter_map(|n| {
                let (measured, model, sd) = self.figure(Figure::PatchScatter(n as u8))?;
                let off = |k: usize| 100.0 * (measured / model[k] - 1.0).abs();
                // Mean of |z| of a normal deviate.
                let luck = 100.0 * sd * (2.0 / std::f64::consts::PI).sqrt();
                Some((n, [off(0), off(1), luck]))
            })
            .collect();
        let mean = |k: usize, keep: &dyn Fn(usize) -> bool| {
            let kept: Vec<f64> = patches.iter().filter(|p| keep(p.0)).map(|p| p.1[k]).collect();
            kept.iter().sum::<f64>() / kept.len() as f64
        };
        (!patches.is_empty()).then(|| {
            let [before, after, expected] =
                [0, 1, 2].map(|k| [mean(k, &|_| true), mean(k, &|n| !DARK.contains(&n))]);
            LuminanceScatter { after, before, capture: self.capture(), expected }
        })
    }

    fn row(&self) -> Option<RowProfile> {
        let off = |s: &Evaluation| {
            let model = self.measured.holdout.picture(&s.camera, self.target).ok()?;
            let measured = self.measured.holdout.pictures.get(self.index)?;
            row_difference(&s.camera, &measured.mean, &model)
        };
        let (before, after) = (off(&self.outcome.before)?, off(&self.outcome.after)?);
        Some(RowProfile { after, before, capture: self.capture() })
    }
}

/// Root mean square difference, DN, of the row in two pictures: over as many lines as the colour
/// filter pattern has, so that the channel is among them.
fn row_difference(camera: &Camera, seen: &Plane<f32>, model: &Plane<f32>) -> Option<f64> {
    let cfa = &camera.sensor.cfa;
    let letter = *cfa.channels().get(densest_channel(camera))?;
    let first = ROW.0 * seen.height / ROW.1 / cfa.height * cfa.height;
    let black = camera.sensor.black_level_dn;
    let of = |frame| profile::along(frame, cfa, letter, black, Along::Row, first, cfa.height).ok();
    Some(profile::difference(&of(seen)?, &of(model)?).ok()?.rms_dn)
}
