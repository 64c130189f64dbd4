//! Full-well saturation.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Full well: a pixel holds no more charge than this. Charge above is lost.
    ///
    /// q = min(q, W). W of eq. 11 of Chen et al. 2009.
    FullWell, "full-well", Charge, Pixel {
        /// Linear full well
        full_well_e: "e-", 1.0..=524287.0;
    }
}

impl Stage for FullWell {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        _: &Context,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let full = A::signal(self.full_well_e);
        for v in row.as_flattened_mut() {
            *v = if *v < full { *v } else { full };
        }
    }
}
