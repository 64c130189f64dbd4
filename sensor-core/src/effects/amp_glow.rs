//! Amplifier glow.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::math;

effect! {
    /// Amplifier glow: circuits beside the array emit light while they run, which is strongest
    /// near one place.
    ///
    /// q += Poisson(t I exp(−d²/(2w²))), where t is the exposure and d the distance from that
    /// place in half widths of the array. It depends neither on temperature nor on the light.
    /// Janesick 2001, section 7.
    ///
    /// Source: Janesick 2001, section 7.
    ///
    /// Closed form: mean t I exp(−d²/(2w²)) e⁻ at a distance d, temporal variance the same.
    AmpGlow, "amp-glow", Charge, Dark, Pixel {
        /// Rate at the brightest place
        rate_e_per_s: "e-/s", 0.0..=1e5;
        /// Its column, -1 left edge, 1 right edge
        x: "half width", -2.0..=2.0, default 1.0;
        /// Its row, -1 top, 1 bottom
        y: "half height", -2.0..=2.0, default 1.0;
        /// Width w of the glow
        width: "half width", 0.01..=10.0, default 0.2;
    }
}

impl Stage for AmpGlow {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let peak = self.rate_e_per_s * cx.exposure_s;
        let dy = (cx.y() - self.y) * cx.height as f32 / cx.width as f32;
        let scale = -0.5 / (self.width * self.width);
        super::add_counts::<A>(cx, row, peak, |u| {
            let dx = u - self.x;
            peak * math::exp(scale * (dx * dx + dy * dy))
        });
    }
}
