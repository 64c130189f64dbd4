//! Gain pattern of columns.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Column gain fixed pattern: each column's amplifier has its own gain.
    ///
    /// v *= 1 + σ z(x), with z standard normal and fixed. EMVA 1288 release 4.0, column part of
    /// PRNU.
    ///
    /// Source: EMVA 1288 release 4.0, column part of PRNU.
    ///
    /// Closed form: of a flat of v, column means have the standard deviation σ v.
    ColumnGainFpn, "column-gain-fpn", Voltage, Pattern, Pixel {
        /// Standard deviation over columns of the relative gain
        sigma: "1", 0.0..=0.14;
    }
}

impl Stage for ColumnGainFpn {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        super::scale_by_normals::<A>(row, self.sigma, cx.per_column(0));
    }
}
