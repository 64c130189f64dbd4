//! Non-linear response.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::math;

effect! {
    /// Non-linearity: the gain of the source follower falls as the signal rises.
    ///
    /// v' = v (1 − a (v/W)^n) for v > 0, with W the full well. Janesick 2007.
    ///
    /// Source: Janesick 2007.
    ///
    /// Closed form: v (1 − a (v/W)^n) for a ramp.
    Nonlinearity, "nonlinearity", Voltage, Response, Pixel {
        /// Loss a at full well
        loss: "1", -0.5..=0.5;
        /// Exponent n
        exponent: "1", 0.5..=6.0, default 1.0;
    }
}

/// Fraction of full well up to which the response is taken as linear: that is less than an
/// electron for any full well, and `math::pow` needs a positive number.
const LINEAR_BELOW: f32 = 1e-6;

impl Stage for Nonlinearity {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        for v in row.as_flattened_mut() {
            let ratio = A::electrons(*v) / cx.full_well_e;
            if ratio > LINEAR_BELOW {
                let loss = self.loss * math::pow(ratio, self.exponent);
                *v = A::times(*v, 1.0 - loss);
            }
        }
    }
}
