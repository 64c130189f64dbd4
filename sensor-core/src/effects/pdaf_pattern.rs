//! Pattern of focus pixels.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Pattern of phase-detection pixels: the pixels of a lattice are partly covered and receive
    /// less light.
    ///
    /// µ *= g where x mod P_x = x_0 and y mod P_y = y_0. It is light that does not arrive, so the
    /// shot noise is that of what does: the variance of a covered pixel is gµ.
    ///
    /// Source: definition.
    ///
    /// Closed form: pixels of the lattice have mean and variance gµ, the others µ.
    PdafPattern, "pdaf-pattern", Light, Pattern, Pixel {
        /// Columns P_x from one to the next
        period_x: "px", 1.0..=1024.0, default 16.0;
        /// Rows P_y from one to the next
        period_y: "px", 1.0..=1024.0, default 16.0;
        /// First column x_0
        first_x: "px", 0.0..=1023.0, default 0.0;
        /// First row y_0
        first_y: "px", 0.0..=1023.0, default 0.0;
        /// Their response g relative to the rest
        gain: "1", 0.0..=2.0, default 0.5;
    }
}

impl Stage for PdafPattern {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let (period_x, period_y) =
            ((self.period_x as usize).max(1), (self.period_y as u32).max(1));
        if cx.row % period_y == self.first_y as u32 % period_y {
            let first = self.first_x as usize % period_x;
            for v in row.as_flattened_mut().iter_mut().skip(first).step_by(period_x) {
                *v = A::times(*v, self.gain);
            }
        }
    }
}
