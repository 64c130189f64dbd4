//! Drift of the whole frame's offset.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Frame offset noise: the offset of the whole frame wanders from frame to frame.
    ///
    /// v += o_n with o_n = φ o_(n−1) + σ √(1−φ²) z_n, a first-order autoregression with variance
    /// σ² and autocorrelation φ^|h|. Any frame can be computed without the others: o_n is the sum
    /// of the last frames' innovations until their weight falls below 0.001. Input-referred. EMVA
    /// 1288 release 4.0, section 2.5.
    ///
    /// Source: EMVA 1288 release 4.0, section 2.5.
    ///
    /// Closed form: the frames' means have variance σ² G^(2p) and autocorrelation φ^|h|.
    FrameOffsetNoise, "frame-offset-noise", Voltage, Temporal, Pixel {
        /// Standard deviation over frames
        sigma_e: "e-", 0.0..=1e5;
        /// Correlation φ of one frame with the next
        correlation: "1", 0.0..=0.95, default 0.0;
        /// Power p of the analogue gain to which it is proportional, σ G^p: 0 before the gain, −1
        /// behind it
        gain_exponent: "1", -2.0..=2.0, default 0.0;
    }
}

impl Stage for FrameOffsetNoise {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let sigma_e = self.sigma_e * cx.power_of_gain(self.gain_exponent);
        super::add_offset::<A>(row, sigma_e * cx.wandering(0, self.correlation));
    }
}
