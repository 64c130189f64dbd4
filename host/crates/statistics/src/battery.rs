//! The battery: every statistic of the dark and flat stacks of a set, with its theoretical standard
//! deviation.
//!
//! Values are in their own unit, so that those of replicates can be averaged and parameters be
//! estimated from them; the [`Scale`](super::statistic::Scale) is the one on which they are
//! normally distributed. Standard deviations are those of the sampling distributions (χ² for
//! variances, binomial for counts), not of replicates, and so hold for a single set.

use super::collect::Collected;
use super::maps::{self, MapKind};
use super::noise::{self, Summary};
use super::statistic::{Place, Statistic};
use super::temporal::Temporal;
use super::{codes, levels, patterns, quantiles, ratios, shading};
use crate::data::channels::Channels;
use crate::data::design::Design;
use camrig_camera::Camera;
use camrig_captures::Role;

/// The statistics of a design's dark and flat stacks.
pub fn battery(camera: &Camera, design: &Design, stacks: &[Temporal]) -> Vec<Statistic> {
    let channels = Channels::new(camera);
    let mut out = Vec::new();
    let reference = maps::reference_dark(design);
    let summaries: Vec<_> = stacks.iter().map(|t| Summary::new(t, &channels)).collect();
    for (i, (t, c)) in stacks.iter().zip(&design.conditions).enumerate() {
        let mut here = Collected::at(Place::Stack(i));
        if c.stack.role == Role::Dark || c.level_known {
            let against = reference.filter(|&r| r != i).map(|r| &stacks[r]);
            levels::means(t, against, &channels, &mut here);
        }
        noise::statistics(t, c, &summaries[i], &mut here);
        quantiles::statistics(t, c, &camera.sensor.cfa, &mut here);
        out.extend(here.statistics);
    }
    out.extend(ratios::ratios(design, stacks, reference, &channels));
    let mut set = Collected::at(Place::Set);
    codes::statistics(stacks, &summaries, &mut set);
    out.extend(set.statistics);
    for map in maps::maps(camera, design, stacks) {
        let mut here = Collected::at(Place::Map(map.kind));
        patterns::statistics(&map, &mut here);
        out.extend(here.statistics);
        if map.kind == MapKind::Gain {
            out.extend(shading::fall_offs(&map, &channels));
        }
    }
    out
}
