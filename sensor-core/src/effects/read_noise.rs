//! Read noise.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::math;

effect! {
    /// Read noise: white Gaussian noise of the read-out chain, one part before and one after the
    /// gain stage.
    ///
    /// v += z √(r² − r_post² + (r_post/G)²), with z standard normal, r the total at unity gain,
    /// r_post the part after the gain stage and G the analogue gain. Input-referred. N_read of eq.
    /// 10 of Chen et al. 2009 (white part, which falls as the analogue gain rises). For a
    /// different value in each pixel see the effect `read-noise-spread`.
    ReadNoise, "read-noise", Voltage, Temporal, Pixel {
        /// Standard deviation at unity gain
        read_e: "e-", 0.0..=1e5;
        /// The part added after the gain stage, at most the whole
        read_e_post: "e-", 0.0..=1e5, default 0.0;
    }
}

impl Stage for ReadNoise {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let gain = cx.gain_to_come();
        let post = self.read_e_post * self.read_e_post;
        let pre = self.read_e * self.read_e - post;
        let variance = pre.max(0.0) + post / (gain * gain);
        let sigma_e = math::sqrt(variance);
        #[cfg(feature = "read-noise-spread")]
        if let Some((spread, key)) = cx.read_noise_spread {
            return super::read_noise_spread::add::<A>(cx, key, spread, sigma_e, row);
        }
        super::add_normals::<A>(row, sigma_e, cx.per_pixel_and_frame(0));
    }
}
