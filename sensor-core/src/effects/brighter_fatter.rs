//! Brighter-fatter effect.

use super::{Context, Inputs, Stage, beside, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Brighter-fatter effect: charge already collected repels later charge into the neighbouring
    /// pixels, so that bright spots widen and noise is correlated in proportion to the square of
    /// the signal.
    ///
    /// Across each edge between two neighbours a/2 (q² − q'²) passes from the fuller pixel to the
    /// other. The mean of a flat field does not change. With b = aµ small, its noise passes
    /// through the kernel 1 − 4b in the centre and b at the four neighbours: the variance is µ((1
    /// − 4b)² + 4b²) and the covariance of neighbours 2µ b(1 − 4b). Charge is conserved, except
    /// what crosses the edges of the array. Only nearest neighbours take part; valid for aµ < 0.1.
    /// Antilogus et al. 2014; Astier et al. 2019 (their a_01 is 2a here, their a_00 is −8a).
    ///
    /// Source: Antilogus et al. 2014; Astier et al. 2019.
    ///
    /// Closed form: with b = aµ, variance µ((1 − 4b)² + 4b²) and covariance of neighbours 2µ b(1 −
    /// 4b).
    BrighterFatter, "brighter-fatter", Charge, Response, Neighbours {
        /// Coefficient a
        coefficient: "1/e-", 0.0..=1e-4;
    }
}

impl Stage for BrighterFatter {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        inputs: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let half = 0.5 * self.coefficient;
        let at = |row: &[Block<A::Signal>], x: u32| {
            row.as_flattened().get(x as usize).copied().unwrap_or_default()
        };
        for (x, out) in (0..cx.width).zip(row.as_flattened_mut()) {
            let own = at(inputs.here, x);
            let [left, right] = beside(x, cx.width);
            let neighbours = [
                at(inputs.here, left),
                at(inputs.here, right),
                at(inputs.above, x),
                at(inputs.below, x),
            ];
            for other in neighbours {
                let share = half * (A::electrons(own) + A::electrons(other));
                *out = A::sub(*out, A::times(A::sub(own, other), share));
            }
        }
    }
}
