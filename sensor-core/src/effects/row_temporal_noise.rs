//! Temporal noise common to a row.

use super::context::normal;
use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Row temporal noise: each row of each frame has its own offset (noise of the row's sampling
    /// or reference), and one more of opposite sign in even and odd columns, where these are read
    /// through paths of their own that share a reference.
    ///
    /// v += σ z(y, frame) + (−1)^x τ w(y, frame), with z and w standard normal, white over rows and
    /// frames. Input-referred. Wei et al. 2020.
    ///
    /// Source: Wei et al. 2020.
    ///
    /// Closed form: over frames the variance of a row mean is σ² G^(2p) above that of its white
    /// noise, that of half the difference of its even and odd columns τ² G^(2p); other rows and
    /// frames are independent.
    RowTemporalNoise, "row-temporal-noise", Voltage, Temporal, Pixel {
        /// Standard deviation over frames of a row's offset
        sigma_e: "e-", 0.0..=1e5;
        /// Power p of the analogue gain to which it is proportional, σ G^p: 0 before the gain, −1
        /// behind it
        gain_exponent: "1", -2.0..=2.0, default 0.0;
        /// Standard deviation over frames, τ, of a row's offset of opposite sign in even and odd
        /// columns
        opposite_e: "e-", 0.0..=1e5, default 0.0;
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
        let growth = cx.power_of_gain(self.gain_exponent);
        let z = normal(&mut cx.per_row_and_frame(0, cx.row));
        super::add_offset::<A>(row, self.sigma_e * growth * z);
        if self.opposite_e > 0.0 {
            let w = self.opposite_e * growth * normal(&mut cx.per_row_and_frame(1, cx.row));
            let own = [w, -w].map(A::signal);
            for (x, v) in row.as_flattened_mut().iter_mut().enumerate() {
                *v = A::add(*v, own[x % 2]);
            }
        }
    }
}
