//! Gradient of dark current.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::effects::dark_current::growth;
use crate::math;

effect! {
    /// Dark-current gradient: dark current rises across the array, for instance because one side
    /// is warmer.
    ///
    /// q += Poisson(t g I (1 + u cos θ + v sin θ)/2), not below 0, with u, v in −1..1 over the
    /// array and g the growth with temperature as in `dark-current`. It
    /// adds to the uniform dark current.
    ///
    /// Source: definition.
    ///
    /// Closed form: mean t g I (1 + u cos θ + v sin θ)/2, temporal variance the same.
    DarkCurrentGradient, "dark-current-gradient", Charge, Dark, Pixel {
        /// Rate at the middle of the far edge, at the reference temperature
        rate_e_per_s: "e-/s", 0.0..=1e6;
        /// Direction in which it rises, 0 to the right, 90 down
        direction_deg: "deg", -360.0..=360.0, default 0.0;
        /// Temperature rise that doubles it; in a camera file, left out, that of sensor.noise
        doubling_c: "K", 1.0..=100.0, default 7.0;
        /// Reference temperature; in a camera file, left out, that of sensor.noise
        reference_c: "degC", -100.0..=150.0, default 25.0;
    }
}

/// At least the largest value of 1 + u cos θ + v sin θ over the array, 1 + √2 in a corner.
const LARGEST_SLOPE: f32 = 2.5;

impl Stage for DarkCurrentGradient {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let rate = 0.5 * self.rate_e_per_s * cx.exposure_s;
        let rate = rate * growth(cx, self.reference_c, self.doubling_c);
        let turns = self.direction_deg / 360.0;
        let by_x = math::sin_turns(turns + 0.25);
        let base = 1.0 + math::sin_turns(turns) * cx.y();
        super::add_counts::<A>(cx, row, LARGEST_SLOPE * rate, |u| {
            (rate * (base + by_x * u)).max(0.0)
        });
    }
}
