//! Hot pixels.

use super::context::unit;
use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block, EXPANSION_FROM_E};
use crate::effects::dark_current::growth;
use crate::math;

effect! {
    /// Hot pixels: a few pixels have a far larger dark current than the rest, exponentially distributed.
    ///
    /// A fraction f of pixels, fixed, generates −s ln(u) e⁻/s more at the reference temperature, u uniform,
    /// with shot noise and the same growth with temperature as the dark current. Widenhorn et al. 2002.
    HotPixels, "hot-pixels", Charge, Pixel {
        /// Fraction of pixels
        fraction: "1", 0.0..=1.0;
        /// Mean of their extra dark current at the reference temperature
        mean_e_per_s: "e-/s", 0.0..=1e6;
        /// Rise of temperature that doubles it
        doubling_c: "K", 1.0..=100.0, default 7.0;
        /// Temperature of the figure
        reference_c: "degC", -100.0..=150.0, default 25.0;
    }
}

impl Stage for HotPixels {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let scale =
            self.mean_e_per_s * cx.exposure_s * growth(cx, self.reference_c, self.doubling_c);
        let mut pattern = cx.per_pixel(0);
        // −ln of the smallest uniform number is 17.3.
        let mut counts = cx.counts(0, true, 17.4 * scale >= EXPANSION_FROM_E);
        for block in row {
            let chosen = super::chosen(&mut pattern, self.fraction);
            let words = super::words(&mut pattern);
            let mut extra = [A::Signal::default(); crate::arith::BLOCK];
            for (i, extra) in extra.iter_mut().enumerate() {
                if chosen[i] {
                    *extra = A::signal(-scale * math::ln(unit(words[i])));
                }
            }
            A::poisson(core::slice::from_mut(&mut extra), &mut counts);
            for (v, e) in block.iter_mut().zip(extra) {
                *v = A::add(*v, e);
            }
        }
    }
}
