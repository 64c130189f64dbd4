//! Clipping at the black level.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Offset clipping: the camera subtracts its black level and clips what falls below zero,
    /// before the black level of the file is added.
    ///
    /// v = max(v, level), with the level relative to the black level.
    ///
    /// Source: definition.
    ///
    /// Closed form: max(v, level); of normal noise σ around m, mean and variance are those of a
    /// censored normal law.
    OffsetClipping, "offset-clipping", Voltage, Response, Pixel {
        /// Lowest signal
        level_e: "e-", -1e4..=1e4, default 0.0;
    }
}

impl Stage for OffsetClipping {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        _: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let level = A::signal(self.level_e);
        for v in row.as_flattened_mut() {
            *v = if *v > level { *v } else { level };
        }
    }
}
