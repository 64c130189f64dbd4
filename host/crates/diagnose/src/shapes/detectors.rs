//! All detectors, in groups that run one after the other.

use super::view::View;
use super::{Shape, dark_law, droop, line_noise, outliers, profile, seam, serial, stitch, wave};
use crate::measured::{Half, Measured};
use crate::search::Evaluation;
use crate::statistics::maps;
use crate::statistics::temporal::Temporal;
use camrig_camera::Camera;

/// Finds shapes in the frames to fit, and confirms them in the held-out frames.
pub(crate) type Detector = fn(&View<'_>, &View<'_>) -> Vec<Box<dyn Shape>>;

/// Shapes that are in the means of the frames and nothing else. They are looked for first, since
/// random effects of the catalogue may be mistaken for them.
pub(crate) const MEAN_DETECTORS: [Detector; 2] = [seam::find, wave::find];

/// Shapes of pixels, of the response and of the noise, for sets that named effects do not explain:
/// what the catalogue explains is left to it. With each the effects of the catalogue that resemble
/// it where it is faint: where one of them is named, the shape is looked for all the same.
pub(crate) const RESIDUAL_DETECTORS: [(Detector, &[&str]); 6] = [
    (outliers::find, &[]),
    (dark_law::find, &[]),
    (stitch::find, &["nonlinearity", "full-well", "adc-nonlinearity"]),
    (droop::find, &["row-temporal-noise", "column-temporal-noise", "row-correlated-noise"]),
    (line_noise::find, &["row-temporal-noise", "column-temporal-noise"]),
    (serial::find, &[]),
];

/// Smooth shapes, of which effects of the catalogue are parts: for what is left in the end.
pub(crate) const SMOOTH_DETECTORS: [Detector; 1] = [profile::find];

/// The shapes that some detectors find, each in what those before leave. `model` is the model as
/// given, for detectors that compare with what it predicts.
pub(crate) fn detect(
    measured: &Measured,
    camera: &Camera,
    detectors: &[Detector],
    model: Option<&Evaluation>,
) -> Vec<Box<dyn Shape>> {
    let halves = [&measured.fit, &measured.holdout];
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
            stacks: left.as_ref().map_or(&*halves[i].stacks, |l| &l[i]),
            maps: maps.as_ref().map_or(&*halves[i].maps, |m| &m[i]),
            prediction: predictions.map(|p| p[i]),
        };
        let new = detect(&view(0), &view(1));
        if !new.is_empty() {
            let moments = |half: &Half| half.stacks.to_vec();
            let stacks = left.get_or_insert_with(|| halves.map(moments));
            for (half, stacks) in halves.iter().zip(stacks) {
                new.iter().for_each(|s| s.subtract(camera, &half.design, stacks));
            }
        }
        found.extend(new);
    }
    found
}
