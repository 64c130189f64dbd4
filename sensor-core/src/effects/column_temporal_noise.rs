//! Temporal noise common to a column.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Column temporal noise: each column of each frame has its own offset (noise of the
    /// references of column amplifiers or converters).
    ///
    /// v += σ z(x, frame), with z standard normal, white over columns and frames. Input-referred.
    /// Janesick 2007. The counterpart for rows is
    /// `row-temporal-noise`.
    ///
    /// Source: Janesick 2007.
    ///
    /// Closed form: over frames the variance of a column mean is σ² G^(2p) above that of its white
    /// noise.
    ColumnTemporalNoise, "column-temporal-noise", Voltage, Temporal, Pixel {
        /// Standard deviation over frames of a column's offset
        sigma_e: "e-", 0.0..=1e5;
        /// Power p of the analogue gain to which it is proportional, σ G^p: 0 before the gain, −1
        /// behind it
        gain_exponent: "1", -2.0..=2.0, default 0.0;
    }
}

impl Stage for ColumnTemporalNoise {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let sigma_e = self.sigma_e * cx.power_of_gain(self.gain_exponent);
        super::add_normals::<A>(row, sigma_e, cx.per_column_and_frame(0));
    }
}
