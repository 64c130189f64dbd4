//! Fixed pattern of single pixels.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Pixel offset fixed pattern: each pixel has its own offset, whatever the exposure.
    ///
    /// v += σ z(x, y), with z standard normal and fixed. Input-referred. The part of EMVA 1288's
    /// DSNU that does not grow with exposure.
    ///
    /// Source: EMVA 1288 release 4.0, part of DSNU.
    ///
    /// Closed form: spread of the pixels' means σ at any exposure.
    PixelOffsetFpn, "pixel-offset-fpn", Voltage, Pattern, Pixel {
        /// Standard deviation over pixels
        sigma_e: "e-", 0.0..=1e5;
    }
}

impl Stage for PixelOffsetFpn {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        super::add_normals::<A>(row, self.sigma_e, cx.per_pixel(0));
    }
}
