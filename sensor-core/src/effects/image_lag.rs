//! Image lag.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Image lag: part of the photo-charge stays in the photodiode and appears in the next frame.
    ///
    /// n' = (1 − l) n + Poisson(l µ_before), with µ_before the pixel's mean photo-electrons in the
    /// previous frame. It reaches back one frame only: lag is not passed on a second time. A frame
    /// without a predecessor is taken to follow darkness. Janesick 2001; Fossum & Hondongwa 2014.
    ImageLag, "image-lag", Photo, Response, PreviousFrame {
        /// Fraction l that stays behind
        fraction: "1", 0.0..=0.5;
    }
}

impl Stage for ImageLag {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        inputs: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let (kept, left) = (A::factor(1.0 - self.fraction), A::factor(self.fraction));
        let mut counts = cx.counts(0, true, true);
        for (block, before) in row.iter_mut().zip(inputs.previous) {
            let mut extra = *before;
            for e in &mut extra {
                *e = A::scale(*e, left);
            }
            A::poisson(core::slice::from_mut(&mut extra), &mut counts);
            for (v, e) in block.iter_mut().zip(extra) {
                *v = A::add(A::scale(*v, kept), e);
            }
        }
    }
}
