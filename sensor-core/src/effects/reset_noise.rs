//! Reset noise.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::math;

effect! {
    /// Reset (kTC) noise: charge left on the sense node when its reset switch opens.
    ///
    /// v += z √(k T C)/q, with z standard normal per pixel and frame, and T the sensor's absolute
    /// temperature. Correlated double sampling removes all but a part of it. Janesick 2007,
    /// section
    /// 7.
    ///
    /// Source: Janesick 2007, section 7.
    ///
    /// Closed form: variance k T C/q² times the square of the part that remains.
    ResetNoise, "reset-noise", Voltage, Temporal, Pixel {
        /// Capacitance of the sense node
        capacitance_ff: "fF", 0.0..=1e3;
        /// Part that correlated double sampling leaves
        remaining: "1", 0.0..=1.0, default 1.0;
    }
}

/// k/q² for a capacitance in fF, e⁻² per K and fF (SI values, exact).
const E2_PER_K_FF: f32 = (1.380_649e-23 * 1e-15 / (1.602_176_634e-19 * 1.602_176_634e-19)) as f32;

impl ResetNoise {
    /// Its standard deviation at a temperature of the sensor, e⁻.
    #[inline(always)]
    pub fn sigma_e(&self, temperature_c: f32) -> f32 {
        let kelvin = (temperature_c + 273.15).max(0.0);
        self.remaining * math::sqrt(E2_PER_K_FF * kelvin * self.capacitance_ff)
    }
}

impl Stage for ResetNoise {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let sigma_e = self.sigma_e(cx.temperature_c);
        super::add_normals::<A>(row, sigma_e, cx.per_pixel_and_frame(0));
    }
}
