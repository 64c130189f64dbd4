//! Non-uniformity of response that neighbouring pixels share.

use super::context::normal;
use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, BLOCK, Block};

effect! {
    /// Correlated PRNU: structures of about the size of a pixel above the array (microlenses,
    /// light shields, filters) change the response of neighbouring pixels together.
    ///
    /// n *= 1 + σ (z(x, y) + z(x+1, y) + z(x, y+1) + z(x+1, y+1))/2, with z standard normal at the
    /// corners of pixels, fixed. Pixels side by side are correlated by 1/2, diagonal ones by 1/4,
    /// and others not at all: the autocovariance of a box of one pixel's area (Bartlett's triangle
    /// along rows and columns). `prnu` is added for the part that is independent from pixel to
    /// pixel. Valid where `prnu` is.
    ///
    /// Source: definition.
    ///
    /// Closed form: relative response of variance σ², correlated by 1/2 between neighbours in rows
    /// and columns, 1/4 over the diagonal, 0 beyond.
    PrnuCorrelated, "prnu-correlated", Photo, Pattern, Pixel {
        /// Standard deviation over pixels of the relative gain
        sigma: "1", 0.0..=0.14;
    }
}

impl Stage for PrnuCorrelated {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let half = 0.5 * self.sigma;
        let [mut above, mut below] = [cx.row, cx.row + 1].map(|row| cx.per_pixel_of(0, row));
        // The corners left of the first pixel; those right of a pixel are left of the next.
        let mut left = normal(&mut cx.per_row(1, cx.row)) + normal(&mut cx.per_row(1, cx.row + 1));
        for block in row {
            let (a, b) = (A::normals(&mut above), A::normals(&mut below));
            for i in 0..BLOCK {
                let right = A::number(a[i]) + A::number(b[i]);
                block[i] = A::times(block[i], 1.0 + half * (left + right));
                left = right;
            }
        }
    }
}
