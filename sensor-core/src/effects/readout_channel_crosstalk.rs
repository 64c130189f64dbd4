//! Crosstalk of read-out channels.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Read-out channel crosstalk: the two halves of a row are read at the same time, one from
    /// either side, and couple into each other.
    ///
    /// v(x) += c v(W − 1 − x): a faint mirror image. Freyhammer et al. 2001.
    ///
    /// Source: Freyhammer et al. 2001.
    ///
    /// Closed form: a spot of v at column x has an image of c v at column W − 1 − x.
    ReadoutChannelCrosstalk, "readout-channel-crosstalk", Voltage, Response, Pixel {
        /// Coupling c
        coupling: "1", -0.1..=0.1;
    }
}

impl Stage for ReadoutChannelCrosstalk {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let coupling = A::factor(self.coupling);
        let row = row.as_flattened_mut();
        let width = row.len().min(cx.width as usize);
        let (row, _) = row.split_at_mut(width);
        let (left, right) = row.split_at_mut(width / 2);
        for (l, r) in left.iter_mut().zip(right.iter_mut().rev()) {
            (*l, *r) = (A::add(*l, A::scale(*r, coupling)), A::add(*r, A::scale(*l, coupling)));
        }
    }
}
