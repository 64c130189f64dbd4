//! A change of the signal, and noise, that depend on the signal itself.

use super::Context;
use super::curve::Curve;
use crate::arith::{Arith, Block};

/// v += A f(v) + σ(v) z, from knots (v, f, σ).
#[inline(always)]
pub(super) fn change<A: Arith>(
    cx: &Context<'_>,
    row: &mut [Block<A::Signal>],
    amount: f32,
    words: &[f32],
) {
    let curve = Curve::<3>::new(words);
    let mut lanes = cx.per_pixel_and_frame(0);
    for block in row {
        for (v, z) in block.iter_mut().zip(A::normals(&mut lanes)) {
            let [_, change, sigma] = curve.at(A::electrons(*v));
            let noise = A::scale(A::signal(sigma), z);
            *v = A::add(*v, A::add(A::signal(amount * change), noise));
        }
    }
}
