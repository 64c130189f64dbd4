//! Column-wise fixed pattern.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Column offset fixed pattern: each column's amplifier or converter has its own offset.
    ///
    /// v += σ z(x), with z standard normal and fixed. Input-referred. EMVA 1288 release 4.0,
    /// column part of DSNU.
    ColumnOffsetFpn, "column-offset-fpn", Voltage, Pattern, Pixel {
        /// Standard deviation over columns
        sigma_e: "e-", 0.0..=1e5;
    }
}

impl Stage for ColumnOffsetFpn {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        super::add_normals::<A>(row, self.sigma_e, cx.per_column(0));
    }
}
