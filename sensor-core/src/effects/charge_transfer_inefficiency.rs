//! Charge that a CCD leaves behind as it is transferred.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::math;

effect! {
    /// Charge-transfer inefficiency of a CCD: at each transfer a share of a packet stays behind and
    /// follows with the next one, so that bright pixels have trails away from the output, the
    /// longer the way the stronger.
    ///
    /// Down a column, a packet of row y is transferred y + 1 times and loses the share
    /// l(y) = 1 − (1 − ε_p)^(y+1) to the row that follows: q'(y) = q(y) (1 − l(y)) +
    /// q(y−1) l(y−1); then along the row with ε_s and the column x. The output lies at the upper
    /// left. All that is left behind comes with the next packet: trails of slow traps are longer.
    /// Janesick 2001, section 5.2.
    ///
    /// Source: Janesick 2001, section 5.2.
    ///
    /// Closed form: a spot keeps (1 − l) of its charge and the next pixel has l of it; in a flat of
    /// mean and variance µ the covariance of a pixel with the next is l (1 − l) µ.
    ChargeTransferInefficiency, "charge-transfer-inefficiency", Charge, Response, Neighbours {
        /// Share ε_s that stays behind at each transfer along a row
        serial: "1", 0.0..=0.01, default 0.0;
        /// Share ε_p that stays behind at each transfer down a column
        parallel: "1", 0.0..=0.01, default 0.0;
    }
}

/// The share that a packet loses in so many transfers, 1 − (1 − ε)^n.
fn lost(inefficiency: f32, transfers: f32) -> f32 {
    // −n ln(1 − ε) by its series: 1 − ε has few digits of a small ε.
    let e = inefficiency;
    let t = transfers * e * (1.0 + e * (0.5 + e / 3.0));
    if t < 1e-3 { t * (1.0 - 0.5 * t) } else { 1.0 - math::exp(-t) }
}

impl Stage for ChargeTransferInefficiency {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        inputs: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        if self.parallel > 0.0 {
            let own = A::factor(1.0 - lost(self.parallel, cx.row as f32 + 1.0));
            // No packet is before the first row's.
            let before = if cx.row == 0 { 0.0 } else { lost(self.parallel, cx.row as f32) };
            let before = A::factor(before);
            for (v, above) in row.as_flattened_mut().iter_mut().zip(inputs.above.as_flattened()) {
                *v = A::add(A::scale(*v, own), A::scale(*above, before));
            }
        }
        if self.serial > 0.0 {
            let mut behind = A::Signal::default();
            for (x, v) in row.as_flattened_mut().iter_mut().enumerate() {
                let leaves = A::scale(*v, A::factor(lost(self.serial, x as f32 + 1.0)));
                *v = A::add(A::sub(*v, leaves), behind);
                behind = leaves;
            }
        }
    }
}
