//! Neighbour coupling of collected charge.

use super::{Context, Inputs, Stage, beside, effect};
use crate::arith::{Arith, BLOCK, Block};

effect! {
    /// Charge coupling between neighbours: part of a pixel's signal appears in the eight pixels
    /// around it, after shot noise, so that the noise of neighbours is correlated (interpixel
    /// capacitance, electrical crosstalk).
    ///
    /// q' = q ⊗ k. The 3x3 kernel k has `side` to the left and right, `vertical` above and below,
    /// `diagonal` at the corners, and 1 minus their sum in the centre. Beyond the edges the array
    /// continues as its mirror image, so a flat field stays flat. Charge is conserved, except what
    /// crosses those edges. Moore, Ninkov & Forrest 2004.
    ///
    /// Source: Moore, Ninkov & Forrest 2004.
    ///
    /// Closed form: a spot becomes the kernel; in a flat the covariance of pixels at a distance is
    /// µ times the autocorrelation of the kernel there.
    ChargeCoupling, "charge-coupling", Charge, Response, Neighbours {
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
        cx: &Context<'_>,
        inputs: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let kernel = kernel::<A>(self.side, self.vertical, self.diagonal);
        convolve::<A>(cx.width, kernel, inputs, row);
    }
}

/// (centre, side, vertical, diagonal) of a kernel whose sum is 1.
#[inline(always)]
pub(crate) fn kernel<A: Arith>(side: f32, vertical: f32, diagonal: f32) -> [A::Factor; 4] {
    let centre = 1.0 - 2.0 * (side + vertical) - 4.0 * diagonal;
    [A::factor(centre), A::factor(side), A::factor(vertical), A::factor(diagonal)]
}

/// 3x3 convolution of a row with the kernel (centre, side, vertical, diagonal).
///
/// Each pixel's three rows make what it keeps and what it gives to either side; terms are scaled
/// before they are added, so that nothing saturates that would not in the end.
#[inline(always)]
pub(crate) fn convolve<A: Arith>(
    width: u32,
    [centre, side, vertical, diagonal]: [A::Factor; 4],
    inputs: &Inputs<'_, A::Signal>,
    row: &mut [Block<A::Signal>],
) {
    let weighted = |above, here, below, middle, outer| {
        let verticals = A::add(A::scale(above, outer), A::scale(below, outer));
        A::add(A::scale(here, middle), verticals)
    };
    // What a single column gives.
    let given = |x: u32| {
        let at = |row: &[Block<A::Signal>]| {
            row.as_flattened().get(x as usize).copied().unwrap_or_default()
        };
        weighted(at(inputs.above), at(inputs.here), at(inputs.below), side, diagonal)
    };
    let columns = inputs.above.iter().zip(inputs.here).zip(inputs.below);
    for ((block, ((above, here), below)), out) in columns.enumerate().zip(row) {
        let first = (block * BLOCK) as u32;
        let (mut kept, mut sides) = ([A::Signal::default(); BLOCK], [A::Signal::default(); BLOCK]);
        for i in 0..BLOCK {
            kept[i] = weighted(above[i], here[i], below[i], centre, vertical);
            sides[i] = weighted(above[i], here[i], below[i], side, diagonal);
        }
        let mut shifted = [A::Signal::default(); BLOCK + 2];
        shifted[0] = given(beside(first, width)[0]);
        shifted[1..=BLOCK].copy_from_slice(&sides);
        // The first column beyond this block, or beyond the array.
        let end = (width - first).min(BLOCK as u32);
        if let Some(next) = shifted.get_mut(end as usize + 1) {
            *next = given(beside(first + end - 1, width)[1]);
        }
        for i in 0..BLOCK {
            out[i] = A::add(kept[i], A::add(shifted[i], shifted[i + 2]));
        }
    }
}
