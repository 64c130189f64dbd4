//! Full-well saturation.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Full well: a pixel holds no more charge than this; charge above it is lost.
    ///
    /// q = min(q, W), with W as in eq. 11 of Chen et al. 2009. With a knee k the transition is
    /// soft, as the pixel loses charge before it is full: q − kW ln(1 + exp((q − W)/(kW))), which
    /// at W lies below W by kW ln 2. Janesick 2007.
    ///
    /// Source: Chen et al. 2009, eq. 11; Janesick 2007.
    ///
    /// Closed form: min(q, W); with a knee, W − kW ln 2 at q = W.
    FullWell, "full-well", Charge, Response, Pixel {
        /// Linear full well
        full_well_e: "e-", 1.0..=524287.0;
        /// Width of the soft transition as a fraction of full well; 0 is a sharp one
        knee: "1", 0.0..=0.5, default 0.0;
    }
}

impl Stage for FullWell {
    fn prepare(&self, cx: &mut Context<'_>) {
        cx.full_well_e = self.full_well_e;
    }

    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        _: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let full = A::signal(self.full_well_e);
        let width = self.knee * self.full_well_e;
        if width > 0.0 {
            for v in row.as_flattened_mut() {
                *v = A::signal(super::soft_min(A::electrons(*v), self.full_well_e, width));
            }
        }
        for v in row.as_flattened_mut() {
            *v = if *v < full { *v } else { full };
        }
    }
}
