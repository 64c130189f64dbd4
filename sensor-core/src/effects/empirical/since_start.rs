//! What a sensor does in its first frames after a start, alike over the frame.

use super::curve::Curve;

/// Words before the knots: the upper and the lower 16 bits of the number of the frame with which
/// the sensor starts, which one word could not hold.
const HEAD: usize = 2;

/// Whether words are a table of this shape.
pub(super) fn is_one(table: &[f32]) -> bool {
    let half = |w: &f32| (0.0..=65_535.0).contains(w) && *w == (*w as u32) as f32;
    table
        .split_first_chunk::<HEAD>()
        .is_some_and(|(start, knots)| start.iter().all(half) && Curve::<2>::is_one(knots))
}

/// The curve at a frame. Frames before the start are as those long after it.
pub(super) fn level(frame: u32, table: &[f32]) -> f32 {
    let Some(([high, low], knots)) = table.split_first_chunk::<HEAD>() else { return 0.0 };
    let start = ((*high as u32) << 16) | *low as u32;
    Curve::<2>::new(knots).at(frame.wrapping_sub(start) as f32)[1]
}
