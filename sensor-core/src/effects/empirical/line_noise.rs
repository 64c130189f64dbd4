//! Temporal noise common to a row or a column, with a profile along it and a dependence on the
//! signal.

use super::curve::Curve;
use super::{Context, Empirical, Shape};
use crate::arith::{Arith, BLOCK, Block};
use crate::effects::context::normal;

/// v += A z(y, frame) f(x) (s/S)^e, or with x and y exchanged.
#[inline(always)]
pub(super) fn add<A: Arith>(
    effect: &Empirical,
    cx: &Context<'_>,
    row: &mut [Block<A::Signal>],
    words: &[f32],
) {
    let scale = effect.amount * effect.share_of::<A>(cx, row);
    let curve = Curve::<2>::new(words);
    let at = |line: usize| if words.is_empty() { 1.0 } else { curve.at(line as f32)[1] };
    match effect.shape() {
        Shape::ColumnFlat | Shape::ColumnProfile => {
            let sigma = scale * at(cx.row as usize);
            let (sigma, mut lanes) = (A::signal(sigma), cx.per_column_and_frame(0));
            for block in row {
                for (v, z) in block.iter_mut().zip(A::normals(&mut lanes)) {
                    *v = A::add(*v, A::scale(sigma, z));
                }
            }
        }
        _ => {
            let offset = scale * normal(&mut cx.per_row_and_frame(0, cx.row));
            for (b, block) in row.iter_mut().enumerate() {
                for (v, x) in block.iter_mut().zip(b * BLOCK..) {
                    *v = A::add(*v, A::signal(offset * at(x)));
                }
            }
        }
    }
}
