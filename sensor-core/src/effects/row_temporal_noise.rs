//! Temporal noise common to a row.

use super::context::normal;
use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Row temporal noise: each row of each frame has its own offset (noise of the row's sampling
    /// or reference).
    ///
    /// v += σ z(y, frame), with z standard normal, white over rows and frames. Input-referred. Wei
    /// et al. 2020.
    ///
    /// Closed form: over frames the variance of a row mean is σ² G^(2p) above that of its white
    /// noise; other rows and frames are independent.
    RowTemporalNoise, "row-temporal-noise", Voltage, Temporal, Pixel {
        /// Standard deviation over frames of a row's offset
        sigma_e: "e-", 0.0..=1e5;
        /// Power p of the analogue gain to which it is proportional, σ G^p: 0 before the gain, −1
        /// behind it
        gain_exponent: "1", -2.0..=2.0, default 0.0;
    }
}

impl Stage for RowTemporalNoise {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let z = normal(&mut cx.per_row_and_frame(0, cx.row));
        super::add_offset::<A>(row, self.sigma_e * cx.power_of_gain(self.gain_exponent) * z);
    }
}
