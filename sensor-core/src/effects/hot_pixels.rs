//! Hot pixels.

use super::context::{MAX_EXPONENTIAL, unit};
use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, BLOCK, Block, EXPANSION_FROM_E};
use crate::effects::dark_current::growth;
use crate::math;

effect! {
    /// Hot pixels: a few pixels have a far larger dark current than the rest; the excess is
    /// exponentially distributed.
    ///
    /// A fixed fraction f of the pixels generates −s ln(u) e⁻/s more at the reference temperature,
    /// with u uniform, with shot noise, and growing with temperature as the dark current does.
    /// Widenhorn et al. 2002.
    ///
    /// Source: Widenhorn et al. 2002.
    ///
    /// Closed form: a share f exp(−x/s) of the pixels has an excess rate above x at the reference
    /// temperature.
    HotPixels, "hot-pixels", Charge, Defect, Pixel {
        /// Fraction of pixels
        fraction: "1", 0.0..=1.0;
        /// Mean of their extra dark current at the reference temperature
        mean_e_per_s: "e-/s", 0.0..=1e6;
        /// Temperature rise that doubles it; in a camera file, left out, that of sensor.noise
        doubling_c: "K", 1.0..=100.0, default 7.0;
        /// Reference temperature; in a camera file, left out, that of sensor.noise
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
        let mut counts = cx.counts(0, true, MAX_EXPONENTIAL * scale >= EXPANSION_FROM_E);
        for block in row {
            let chosen = super::chosen(&mut pattern, self.fraction);
            let words = super::words(&mut pattern);
            let mut extra = [A::Signal::default(); BLOCK];
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
