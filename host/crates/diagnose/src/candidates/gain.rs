//! Patterns of the gain: `prnu`, `prnu-correlated`, `column-gain-fpn`, `green-imbalance`,
//! `defective-pixels`.
//!
//! The gain map is the response of each pixel over the mean of its channel, without unit; standard
//! deviations come from the variance V of its pixels or column means and what the model
//! predicts, V', as σ² = σ₀² + V − V' with σ₀ what the model has. Correlated response is a pixel's
//! fraction of its neighbours: their covariance is a half (horizontal, vertical) and a quarter
//! (diagonal) of σ². Greens differ by the contrast of every other row and column; defects are the
//! low outliers of the map.

use super::common::{Count, of_excess, present};
use super::proposal::Proposal;
use crate::data::design::Design;
use crate::evidence::Evidence;
use crate::statistics::maps::MapKind;
use crate::statistics::statistic::{Place, What};
use camrig_base::{Cfa, Value};
use camrig_sensor_core::effects::{green_imbalance::GreenImbalance, prnu::Prnu};

/// Where the statistics of this file are taken.
const GAIN: Place = Place::Map(MapKind::Gain);
/// Fraction of the variance of correlated response that horizontal, vertical and diagonal
/// neighbours have in common: the weights of the effect.
const SHARED: [f64; 3] = [0.5, 0.5, 0.25];
/// Deviation, in standard errors, from which the pixels' own spread is changed along with their
/// correlation. Below it both figures are taken to have one cause, and are pooled.
const OWN_SPREAD_CHANGES: f64 = 2.0;

/// `prnu`: variance of the pixels.
pub fn prnu(e: &Evidence<'_>) -> Option<Proposal> {
    let x = e.difference(GAIN, What::PixelPattern)?;
    of_excess("prnu", "sigma", e.camera.sensor.noise.prnu, x)
}

/// `prnu-correlated`: covariance of neighbours, and what the variance of the pixels has more.
/// Where it has not as much more, the pixels' own spread is as much less.
pub fn prnu_correlated(e: &Evidence<'_>) -> Option<Proposal> {
    let variance = e.map(MapKind::Gain)?.spatial.pixel_variance;
    // Least squares over the three neighbours.
    let squares: f64 = SHARED.iter().map(|s| s * s).sum();
    let (mut value, mut error) = (0.0, 0.0);
    for (i, share) in SHARED.into_iter().enumerate() {
        let d = e.difference(GAIN, What::MapCovariance(i as u8))?;
        value += variance * share * d.value / squares;
        error += (variance * share * d.std_error / squares).powi(2);
    }
    let shared = Value { value, std_error: error.sqrt() };
    let more = e.difference(GAIN, What::PixelPattern)?;
    let own = Value {
        value: more.value - shared.value,
        std_error: libm::hypot(more.std_error, shared.std_error),
    };
    let own_changes = own.z().abs() > OWN_SPREAD_CHANGES;
    let added = if own_changes { shared } else { Value::combine([shared, more])? };
    let present = present(e.camera, "prnu-correlated", "sigma").unwrap_or(0.0);
    let p = of_excess("prnu-correlated", "sigma", present, added)?;
    let prnu = e.camera.sensor.noise.prnu;
    Some(match own_changes {
        true => p.and(Prnu { sigma: (prnu * prnu + own.value).max(0.0).sqrt() as f32 }.into()),
        false => p,
    })
}

/// `column-gain-fpn`: variance of the column means.
pub fn column_gain(e: &Evidence<'_>) -> Option<Proposal> {
    let x = e.difference(GAIN, What::ColumnPattern)?;
    let present = present(e.camera, "column-gain-fpn", "sigma").unwrap_or(0.0);
    of_excess("column-gain-fpn", "sigma", present, x)
}

/// `green-imbalance`: contrast of the two greens of a 2 x 2 colour filter pattern.
pub fn green_imbalance(e: &Evidence<'_>) -> Option<Proposal> {
    let cfa = &e.camera.sensor.cfa;
    let first_in_even_column = green_of_even_rows_is_in_even_columns(cfa)?;
    let columns = e.difference(GAIN, What::EveryOtherColumn)?;
    let rows = e.difference(GAIN, What::EveryOtherRow)?;
    // Each shows half of it; light that flickers leaves the rows uncertain, but not the columns.
    let columns = columns.scaled(if first_in_even_column { 2.0 } else { -2.0 });
    let d = Value::combine([rows.scaled(2.0), columns])?;
    // The effect's parameter is green next to red minus green next to blue.
    let red_in_even_row = (0..2).any(|x| cfa.letter(x, 0) == 'R');
    let sign = if red_in_even_row { 1.0 } else { -1.0 };
    let value = present(e.camera, "green-imbalance", "centre").unwrap_or(0.0) + sign * d.value;
    let effect = GreenImbalance { centre: value as f32, corner: value as f32 };
    let p = Proposal::new("green-imbalance", effect.into(), d.z().abs());
    Some(p.with("centre", Value { value, ..d }))
}

/// The greens of a 2 x 2 pattern lie on one of its two diagonals. The map has the contrasts of even
/// rows and columns to odd ones: the green of the even row is in the even column on one diagonal, in
/// the odd column on the other.
fn green_of_even_rows_is_in_even_columns(cfa: &Cfa) -> Option<bool> {
    let green = |x, y| cfa.letter(x, y) == 'G';
    let of_two = (cfa.width, cfa.height) == (2, 2);
    match of_two {
        true if green(0, 0) && green(1, 1) => Some(true),
        true if green(1, 0) && green(0, 1) => Some(false),
        _ => None,
    }
}

/// Whether columns of alternating gain look like unequal greens: they do but in light of a known
/// spectrum, in which they move red against blue.
pub(crate) fn greens_look_like_columns(cfa: &Cfa, design: &Design) -> bool {
    green_of_even_rows_is_in_even_columns(cfa).is_some()
        && !design.conditions.iter().any(|c| c.is_flat() && c.level_known)
}

/// `defective-pixels`: number and mean response of the low outliers.
pub fn defects(e: &Evidence<'_>) -> Option<Proposal> {
    let s = &e.map(MapKind::Gain)?.spatial;
    let n = (s.rows.means.len() * s.columns.means.len()) as f64;
    let low = Count::new(s.low, e.predicted(GAIN, What::Low)?);
    if low.seen < 1.0 {
        return None;
    }
    let gain = (1.0 + s.low_sum / low.seen).clamp(0.0, 1.0);
    let fraction = match present(e.camera, "defective-pixels", "fraction") {
        Some(f) => f * low.seen / low.expected.max(1.0),
        None => (low.seen - low.expected).max(0.0) / n,
    };
    let root = low.seen.sqrt();
    let fraction = Value { value: fraction, std_error: fraction / root };
    let gain = Value { value: gain, std_error: s.pixel_variance.sqrt() / root };
    Proposal::of("defective-pixels", low.z, [("fraction", fraction), ("gain", gain)])
}
