//! Neighbour coupling of collected charge.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, BLOCK, Block};

effect! {
    /// Charge coupling between neighbours: part of a pixel's signal shows in the eight around it, after
    /// shot noise, so that neighbours' noise is correlated (interpixel capacitance, electrical crosstalk).
    ///
    /// q' = q ⊗ k with the 3x3 kernel k of `side` left and right, `vertical` above and below, `diagonal` at
    /// the corners and 1 minus their sum in the centre. Moore, Ninkov & Forrest 2004. Charge is kept: beyond
    /// the array's edge the edge pixel itself stands in.
    ChargeCoupling, "charge-coupling", Charge, Neighbours {
        /// Fraction that goes to the left and to the right neighbour, each
        side: "1", 0.0..=0.125;
        /// Fraction that goes to the neighbour above and below, each
        vertical: "1", 0.0..=0.125;
        /// Fraction that goes to each diagonal neighbour
        diagonal: "1", 0.0..=0.125, default 0.0;
    }
}

impl Stage for ChargeCoupling {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context,
        inputs: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let kernel = [
            A::factor(1.0 - 2.0 * (self.side + self.vertical) - 4.0 * self.diagonal),
            A::factor(self.side),
            A::factor(self.vertical),
            A::factor(self.diagonal),
        ];
        convolve::<A>(cx.width as usize, kernel, inputs, row);
    }
}

/// 3x3 convolution of a row with the kernel (centre, side, vertical, diagonal).
#[inline(always)]
pub(crate) fn convolve<A: Arith>(
    width: usize,
    [centre, side, vertical, diagonal]: [A::Factor; 4],
    inputs: &Inputs<'_, A::Signal>,
    row: &mut [Block<A::Signal>],
) {
    let columns = inputs.above.iter().zip(inputs.here).zip(inputs.below);
    for ((block, ((above, here), below)), out) in columns.enumerate().zip(row) {
        let first = block * BLOCK;
        let outer = [A::Signal::default(); BLOCK];
        // What stands left and right of the block; at the array's edges the edge column itself.
        let at = |rows: &[Block<A::Signal>], x: usize| {
            let x = x.min(width - 1);
            rows.get(x / BLOCK).map_or(A::Signal::default(), |b| b[x % BLOCK])
        };
        let sum = |a: A::Signal, b: A::Signal| A::add(a, b);
        let mut vertical_pairs = outer;
        for i in 0..BLOCK {
            vertical_pairs[i] = sum(above[i], below[i]);
        }
        let left = first.saturating_sub(1);
        let right = first + BLOCK;
        for i in 0..BLOCK {
            let (l, lv) = if i == 0 {
                (at(inputs.here, left), sum(at(inputs.above, left), at(inputs.below, left)))
            } else {
                (here[i - 1], vertical_pairs[i - 1])
            };
            let (r, rv) = if i + 1 == BLOCK {
                (at(inputs.here, right), sum(at(inputs.above, right), at(inputs.below, right)))
            } else if first + i + 1 >= width {
                (here[i], vertical_pairs[i])
            } else {
                (here[i + 1], vertical_pairs[i + 1])
            };
            let own = A::scale(here[i], centre);
            let sides = A::scale(sum(l, r), side);
            let verticals = A::scale(vertical_pairs[i], vertical);
            let corners = A::scale(sum(lv, rv), diagonal);
            out[i] = sum(sum(own, sides), sum(verticals, corners));
        }
    }
}
