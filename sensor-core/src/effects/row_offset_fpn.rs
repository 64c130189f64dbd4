//! Row-wise fixed pattern.

use super::context::normal;
use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Row-wise fixed pattern: each row has its own offset, the same in every frame.
    ///
    /// v += σ z(y), with z standard normal: N_fpn of eq. 10 of Chen et al. 2009, a vector over
    /// rows with zero mean. Input-referred.
    RowOffsetFpn, "row-offset-fpn", Voltage, Pattern, Pixel {
        /// Standard deviation over rows
        sigma_e: "e-", 0.0..=1e5;
    }
}

impl Stage for RowOffsetFpn {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        super::add_offset::<A>(row, self.sigma_e * normal(&mut cx.per_row(0, cx.row)));
    }
}
