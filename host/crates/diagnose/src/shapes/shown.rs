//! Findings with plots: the shape as measured, and as simulated without and with it.

use super::Shape;
use super::seen::Seen;
use super::view::View;
use crate::finding::Finding;
use crate::measured::{Half, SEED};
use crate::model::prediction::Prediction;
use crate::model::replicate;
use crate::report::Shown;
use crate::statistics::maps;
use camrig_base::Result;
use camrig_camera::Camera;

/// The findings of shapes, each with its plot from the frames to fit, and from frames simulated by
/// the model as given and by the improved one. `prediction` is that of the model as given.
pub(crate) fn findings(
    half: &Half,
    [given, improved]: [&Camera; 2],
    prediction: &Prediction,
    shapes: &[Box<dyn Shape>],
) -> Result<Vec<Finding>> {
    let design = &half.design;
    let simulate = |camera| replicate::simulate(camera, design, SEED, true);
    let simulated = [simulate(given)?, simulate(improved)?];
    let moments = [&*half.stacks, &simulated[0], &simulated[1]];
    let maps = moments.map(|stacks| maps::maps(given, design, stacks));
    let views = [0, 1, 2].map(|i| View {
        camera: given,
        design,
        stacks: moments[i],
        maps: &maps[i],
        prediction: Some(prediction),
    });
    let found = shapes.iter().flat_map(|shape| {
        let shown = shown(views.map(|view| shape.seen(&view)));
        shape.findings().into_iter().map(move |f| Finding { shown: shown.clone(), ..f })
    });
    Ok(found.collect())
}

/// A plot from those of the measured frames, the model as given and the improved one.
fn shown(seen: [Option<Seen>; 3]) -> Option<Shown> {
    let [Some(measured), Some(before), Some(after)] = seen else { return None };
    let rounded = |v: &[f64]| -> Vec<Option<f64>> {
        let finite = |v: &f64| v.is_finite().then(|| camrig_base::toml_text::seven_figures(*v));
        v.iter().map(finite).collect()
    };
    Some(Shown {
        at: measured.at.clone(),
        columns: measured.columns,
        measured: rounded(&measured.values),
        model_after: rounded(&after.values),
        model_before: rounded(&before.values),
        x: measured.x.into(),
        y: measured.y.into(),
    })
}
