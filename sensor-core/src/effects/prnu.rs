//! Photo-response non-uniformity.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Photo-response non-uniformity (PRNU): each pixel has its own gain, fixed over time.
    ///
    /// y = n (1 + σ z(x, y)), with z standard normal: N_gain of eq. 10 of Chen et al. 2009, with
    /// mean 1. It acts on photo-electrons with their shot noise and not on dark charge, as in eq.
    /// 10. Valid for σ well below 1; gains stay positive up to σ = 0.14.
    ///
    /// Source: Chen et al. 2009, eq. 10.
    ///
    /// Closed form: of a flat of µ, the standard deviation over pixels of the mean over frames is
    /// σµ; the temporal variance is µ(1 + σ²).
    Prnu, "prnu", Photo, Pattern, Pixel {
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
