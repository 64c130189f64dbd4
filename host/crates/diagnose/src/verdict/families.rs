//! The gap by families of statistics: few extreme pixels make a gap of millions, which tells
//! nothing of the means.

use super::describe::describe;
use crate::measured::Measured;
use crate::model::prediction::mean_square;
use crate::report::FamilyGap;
use crate::search::{Evaluation, Outcome};
use crate::statistics::statistic::{Key, Place, What};

const MEANS: &str = "means";
const TEMPORAL: &str = "noise over time";
const SPATIAL: &str = "patterns over the sensor";
const OUTLIERS: &str = "outliers";
const TARGETS: &str = "edges, dots and charts";

/// The family of a statistic.
fn family((place, what): &Key) -> &'static str {
    match (place, what) {
        (Place::Target(_), _) => TARGETS,
        (
            _,
            What::Skewness
            | What::Kurtosis
            | What::TopKurtosis
            | What::TopTimeLag
            | What::NoisyPixels
            | What::Tails
            | What::High
            | What::Low,
        ) => OUTLIERS,
        (Place::Map(_), _) => SPATIAL,
        (_, What::Mean(_) | What::Ratio(_)) => MEANS,
        _ => TEMPORAL,
    }
}

/// The gaps of both models on the held-out frames in each family that the set shows, and the
/// statistic of the frames to fit that is furthest from the improved model.
pub(super) fn families(measured: &Measured, outcome: &Outcome) -> Vec<FamilyGap> {
    let of = |name: &'static str| {
        let own = |model: &Evaluation, half: usize| -> Vec<(Key, f64)> {
            let all = model.deviations[half].iter().map(|(k, z)| (*k, *z));
            all.filter(|(k, _)| family(k) == name).collect()
        };
        let gap = |model: &Evaluation| {
            mean_square(own(model, 1).iter().map(|(_, z)| z)) / model.norm.mean.max(1e-9)
        };
        let (before, after) = (&outcome.before, &outcome.after);
        let to_fit = own(after, 0);
        let (key, z) = *to_fit.iter().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
        Some(FamilyGap {
            family: name.into(),
            gap_after: gap(after),
            gap_before: gap(before),
            statistics: own(after, 1).len(),
            worst: describe(measured, after, key, z),
        })
    };
    [MEANS, TEMPORAL, SPATIAL, OUTLIERS, TARGETS].into_iter().filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::maps::MapKind;

    #[test]
    fn a_family_does_not_hide_the_others() {
        for (key, name) in [
            ((Place::Stack(0), What::Mean(0)), MEANS),
            ((Place::Stack(0), What::Variance(0)), TEMPORAL),
            ((Place::Stack(0), What::Kurtosis), OUTLIERS),
            ((Place::Map(MapKind::Gain), What::PixelPattern), SPATIAL),
            ((Place::Map(MapKind::Gain), What::High), OUTLIERS),
        ] {
            assert_eq!(family(&key), name);
        }
    }
}
