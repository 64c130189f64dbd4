//! Photo-response non-uniformity.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Photo-response non-uniformity: each pixel has its own gain, fixed over time.
    ///
    /// y = n (1 + σ z(x, y)), z standard normal: eq. 10 of Chen et al. 2009, N_gain with mean 1. Acts on
    /// photo-electrons with their shot noise, not on dark charge, as eq. 10 has it. Range: σ well below 1;
    /// gains stay positive up to σ = 0.14.
    Prnu, "prnu", Photo, Pixel {
        /// Standard deviation over pixels of the relative gain
        sigma: "1", 0.0..=0.14;
    }
}

impl Stage for Prnu {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        super::scale_by_normals::<A>(row, self.sigma, cx.per_pixel(0));
    }
}
