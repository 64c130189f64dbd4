//! The figures of targets, and their statistics.

use super::measured::MeasuredFigure;
use super::picture::Picture;
use super::{chart, dots, edge};
use crate::data::design::{Design, Target};
use crate::statistic::{Place, Statistic, What};
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_scene::chart::Geometry;

/// The figures of a target.
///
/// # Errors
/// A target that is not where its scene places it.
pub fn figures(
    camera: &Camera,
    target: &Target,
    picture: &Picture,
) -> Result<Vec<MeasuredFigure>> {
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

/// The statistics of a design's targets; none for a picture in which the target is not found.
pub fn battery(camera: &Camera, design: &Design, pictures: &[Picture]) -> Vec<Statistic> {
    let mut out = Vec::new();
    for (i, (target, picture)) in design.targets.iter().zip(pictures).enumerate() {
        for found in figures(camera, target, picture).unwrap_or_default() {
            let MeasuredFigure { figure, value, sd, scale } = found;
            let comparable = target.lux.is_some() || !figure.is_level();
            if value.is_finite() && sd.is_finite() && comparable {
                let (place, what) = (Place::Target(i), What::Of(figure));
                out.push(Statistic { place, what, value, sd, scale });
            }
        }
    }
    out
}
