//! Fringes.

use super::context::unit;
use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::math;
use rand_core::Rng;

effect! {
    /// Fringing (etalon): interference in a thin layer modulates the response across the array
    /// where the layer's thickness changes.
    ///
    /// µ *= 1 + A cos(2π(φ + f (u cos θ + v sin θ)/2)), with u, v in −1..1 over the array and φ
    /// fixed: a wedge with f fringes across. f is 2 n Δd/λ for a change of thickness Δd, so the
    /// parameters hold for one wavelength.
    ///
    /// Source: two-beam interference, Born & Wolf 1999, section 7.5.
    ///
    /// Closed form: a flat becomes a wave of f periods across and relative amplitude A.
    Fringing, "fringing", Light, Pattern, Pixel {
        /// Amplitude A
        amplitude: "1", 0.0..=0.9;
        /// Fringes f across the array
        fringes: "1", 0.0..=1e3;
        /// Direction of the wedge, 0 to the right, 90 down
        direction_deg: "deg", -360.0..=360.0, default 0.0;
    }
}

impl Stage for Fringing {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let turns = self.direction_deg / 360.0;
        let by_x = 0.5 * self.fringes * math::sin_turns(turns + 0.25);
        let by_y = 0.5 * self.fringes * math::sin_turns(turns);
        let start = unit(cx.per_sensor(0).next_u32()) + by_y * cx.y();
        super::scale_by_place::<A>(cx, row, |_, u| {
            1.0 + self.amplitude * math::sin_turns(start + by_x * u)
        });
    }
}
