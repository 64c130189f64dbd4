//! Error of the exposure time.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::math;

effect! {
    /// Exposure offset: the sensor exposes in discrete steps, and for slightly longer or shorter
    /// than requested.
    ///
    /// t' = s round(t/s) + δ, not below 0; light and dark charge follow t'. Several of
    /// these in a chain act one after the other.
    ///
    /// Source: definition.
    ///
    /// Closed form: max(s round(t/s) + δ, 0)/t times the light and the dark charge.
    ExposureOffset, "exposure-offset", Light, Response, Pixel {
        /// Error δ
        offset_us: "us", -1e4..=1e4, default 0.0;
        /// Step s of exposure times; 0 for any time
        step_us: "us", 0.0..=1e6, default 0.0;
    }
}

/// Steps of exposure from which the time is not rounded to whole ones: `math::round` holds up to
/// 2²², and a step is then below the rounding of the time in f32.
const MAX_STEPS: f32 = 4e6;

impl ExposureOffset {
    /// The actual exposure time for a requested one, s.
    pub(crate) fn actual(&self, exposure_s: f32) -> f32 {
        let step_s = self.step_us * 1e-6;
        let steps = exposure_s / step_s;
        let whole = if steps < MAX_STEPS { math::round(steps) * step_s } else { exposure_s };
        (whole + self.offset_us * 1e-6).max(0.0)
    }
}

impl Stage for ExposureOffset {
    fn prepare(&self, cx: &mut Context<'_>) {
        cx.exposure_s = self.actual(cx.exposure_s);
    }

    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        super::scale_all::<A>(row, self.actual(cx.nominal_exposure_s) / cx.nominal_exposure_s);
    }
}
