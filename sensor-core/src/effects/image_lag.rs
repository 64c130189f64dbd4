//! Image lag.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Image lag: part of the charge that a photodiode held stays behind when it is read, and is
    /// read with the next frame.
    ///
    /// µ' = µ + l (min(µ_before, W) − min(µ, W)), with µ the mean photo-electrons of this frame,
    /// µ_before those of the frame before in its own light and exposure, and W the full well: what
    /// can lag is charge that was held. Each electron stays or leaves by chance, so that what is
    /// read has the Poisson law of its mean (thinning), without correlation of frames: µ' is
    /// settled before shot noise, and photon transfer of a lagging sensor shows its system gain. A
    /// pixel whose light exceeds the full well reads as full. Other effects of light act on both
    /// frames, so this one is the last of them. It reaches back one frame only: lag is not passed
    /// on a second time. A frame without a predecessor follows darkness. Janesick 2001; Fossum &
    /// Hondongwa 2014.
    ///
    /// Source: Janesick 2001; Fossum & Hondongwa 2014.
    ///
    /// Closed form: mean and variance µ + l (min(µ_before, W) − min(µ, W)); frames independent.
    ImageLag, "image-lag", Light, Response, PreviousFrame {
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
        let (full, fraction) = (A::signal(cx.full_well_e), A::factor(self.fraction));
        let stays = |light: A::Signal| A::scale(if light < full { light } else { full }, fraction);
        for (light, before) in
            row.as_flattened_mut().iter_mut().zip(inputs.previous.as_flattened())
        {
            *light = A::add(A::sub(*light, stays(*light)), stays(*before));
        }
    }
}
