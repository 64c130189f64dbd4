//! Offsets of the colour pattern's sites that change from frame to frame.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Frame offset by site: each place of a 2x2 pattern has an offset of its own that wanders from
    /// frame to frame, as where the four are read through paths of their own, each with its clamp.
    ///
    /// v += o_p,n with p = 2 (y mod 2) + x mod 2 and o_p,n = φ o_p,(n−1) + σ √(1−φ²) z_p,n: four
    /// offsets of the law of `frame-offset-noise`, independent of each
    /// other. Input-referred. EMVA 1288 release 4.0, section 2.5.
    ///
    /// Source: EMVA 1288 release 4.0, section 2.5.
    ///
    /// Closed form: a place's means over frames have variance σ² G^(2p) and autocorrelation φ^|h|;
    /// places are independent.
    FrameOffsetBySite, "frame-offset-by-site", Voltage, Temporal, Pixel {
        /// Standard deviation over frames of each place
        sigma_e: "e-", 0.0..=1e5;
        /// Correlation φ of one frame with the next
        correlation: "1", 0.0..=0.95, default 0.0;
        /// Power p of the analogue gain to which it is proportional, σ G^p: 0 before the gain, −1
        /// behind it
        gain_exponent: "1", -2.0..=2.0, default 0.0;
    }
}

impl Stage for FrameOffsetBySite {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let sigma_e = self.sigma_e * cx.power_of_gain(self.gain_exponent);
        let first = cx.row % 2 * 2;
        let own =
            [first, first + 1].map(|p| A::signal(sigma_e * cx.wandering(p, self.correlation)));
        for (x, v) in row.as_flattened_mut().iter_mut().enumerate() {
            *v = A::add(*v, own[x % 2]);
        }
    }
}
