//! The figures of targets as statistics.

use super::picture::Picture;
use super::{chart, dots, edge};
use crate::data::design::{Design, Target};
use crate::statistic::{Figure, Place, Scale, Statistic, What};
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_scene::chart::Geometry;

/// The figures of a target: what, value, standard deviation on its scale, scale.
///
/// # Errors
/// A target that is not where its scene has it.
pub fn figures(
    camera: &Camera,
    target: &Target,
    picture: &Picture,
) -> Result<Vec<(Figure, f64, f64, Scale)>> {
    match &target.geometry {
        Geometry::Edge { angle_deg, horizontal } => {
            edge::figures(camera, *angle_deg, *horizontal, picture)
        }
        Geometry::Patches { card_width } => {
            chart::figures(camera, *card_width, picture, target.lux.is_some())
        }
        Geometry::Dots(dots) => Ok(dots::figures(camera, dots, picture)),
    }
}

/// The statistics of a design's targets. A picture in which its target is not found gives none.
pub fn battery(camera: &Camera, design: &Design, pictures: &[Picture]) -> Vec<Statistic> {
    let mut out = Vec::new();
    for (i, (target, picture)) in design.targets.iter().zip(pictures).enumerate() {
        for (figure, value, sd, scale) in figures(camera, target, picture).unwrap_or_default() {
            let comparable = target.lux.is_some() || !figure.is_level();
            if value.is_finite() && sd.is_finite() && comparable {
                let (place, what) = (Place::Target(i), What::Of(figure));
                out.push(Statistic { place, what, value, sd, scale });
            }
        }
    }
    out
}
