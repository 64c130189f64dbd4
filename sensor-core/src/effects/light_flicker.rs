//! Jitter of the light.

use super::context::normal;
use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Light flicker: the light differs from frame to frame (jitter of lamp or shutter).
    ///
    /// µ *= 1 + σ z(frame), with z standard normal. EMVA 1288 release 4.0, section 6.6.
    ///
    /// Source: EMVA 1288 release 4.0, section 6.6.
    ///
    /// Closed form: over frames the relative standard deviation of the frame mean is σ.
    LightFlicker, "light-flicker", Light, Response, Pixel {
        /// Standard deviation over frames of the relative light
        sigma: "1", 0.0..=0.14;
    }
}

impl Stage for LightFlicker {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        super::scale_all::<A>(row, 1.0 + self.sigma * normal(&mut cx.per_frame(0, cx.frame)));
    }
}
