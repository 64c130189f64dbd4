//! Hot pixels.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::effects::dark_current::growth;
use crate::math;
use crate::stream::LANES;

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
        cx: &Context,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let scale =
            self.mean_e_per_s * cx.exposure_s * growth(cx, self.reference_c, self.doubling_c);
        let (mut pattern, mut lanes) = (cx.per_pixel(0), cx.per_pixel_and_frame(0));
        for block in row {
            let chosen = super::chosen(&mut pattern, self.fraction);
            let (a, b) = (pattern.draw(), pattern.draw());
            let mut extra = [A::Signal::default(); crate::arith::BLOCK];
            for (i, extra) in extra.iter_mut().enumerate() {
                let word = if i < LANES { a[i] } else { b[i - LANES] };
                if chosen[i] {
                    let u = (word as f32 + 0.5) * (1.0 / 4_294_967_296.0);
                    *extra = A::signal(-scale * math::ln(u));
                }
            }
            A::poisson(&mut extra, &mut lanes);
            for (v, e) in block.iter_mut().zip(extra) {
                *v = A::add(*v, e);
            }
        }
    }
}
