//! Blooming.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Blooming: charge that a full pixel cannot hold spills into the pixels above and below.
    ///
    /// n' = min(n, W) + s/2 (excess above + excess below), with excess = max(n − W, 0) and W the
    /// full well. Charge spills one pixel far; the rest is drained.
    ///
    /// Source: definition.
    ///
    /// Closed form: min(n, W) in a full pixel, s/2 of its excess above and below.
    Blooming, "blooming", Photo, Response, Neighbours {
        /// Fraction s of the excess that spills
        fraction: "1", 0.0..=1.0;
    }
}

impl Stage for Blooming {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        inputs: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let full = A::signal(cx.full_well_e);
        let half = A::factor(0.5 * self.fraction);
        let spill = |n: A::Signal| {
            if n > full { A::scale(A::sub(n, full), half) } else { A::Signal::default() }
        };
        let beside = inputs.above.as_flattened().iter().zip(inputs.below.as_flattened());
        let here = inputs.here.as_flattened();
        for ((out, here), (above, below)) in
            row.as_flattened_mut().iter_mut().zip(here).zip(beside)
        {
            let kept = if *here < full { *here } else { full };
            *out = A::add(kept, A::add(spill(*above), spill(*below)));
        }
    }
}
