//! Error of the exposure time.

use crate::arith::{Arith, Block};
use crate::math;
use super::{Context, Inputs, Stage, effect};

effect! {
    /// Exposure offset: the sensor exposes in steps, and for a little longer or shorter than told.
    ///
    /// t' = s round(t/s) + δ, not below 0; light and dark charge follow t'. Fixed point: t'/t up to 8. Of several
    /// in a chain each works on what those before it make of t.
    ExposureOffset, "exposure-offset", Light, Pixel {
        /// Error δ
        offset_us: "us", -1e4..=1e4, default 0.0;
        /// Step s of exposure times; 0 for any time
        step_us: "us", 0.0..=1e6, default 0.0;
    }
}

impl ExposureOffset {
    /// The exposure time that comes of the one asked for, s.
    pub(crate) fn actual(&self, exposure_s: f32) -> f32 {
        let step_s = self.step_us * 1e-6;
        let steps = exposure_s / step_s;
        // Beyond 2²² steps their rounding is below that of the time.
        let whole = if steps < 4e6 { math::round(steps) * step_s } else { exposure_s };
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
