//! Row-wise fixed pattern.

use super::context::normal;
use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::effects::dark_current::growth;

effect! {
    /// Row-wise fixed pattern: each row has its own offset, the same in every frame.
    ///
    /// v += σ z(y) + d z'(y), d = t 2^((T − T_ref)/T_d) σ_d, with z and z' standard normal. The first
    /// part is N_fpn of eq. 10 of Chen et al. 2009, a vector over rows with zero mean; the second
    /// is that of dark current, as of the columns (`column-offset-fpn`). Input-referred.
    ///
    /// Source: Chen et al. 2009, eq. 10.
    ///
    /// Closed form: variance of row means σ² + d², of their differences between frames 0.
    RowOffsetFpn, "row-offset-fpn", Voltage, Pattern, Pixel {
        /// Standard deviation over rows
        sigma_e: "e-", 0.0..=1e5;
        /// Standard deviation over rows of the part that dark current makes, at the reference
        /// temperature
        sigma_e_per_s: "e-/s", 0.0..=1e6, default 0.0;
        /// Temperature rise that doubles that part; in a camera file, left out, that of
        /// sensor.noise
        doubling_c: "K", 1.0..=100.0, default 7.0;
        /// Reference temperature; in a camera file, left out, that of sensor.noise
        reference_c: "degC", -100.0..=150.0, default 25.0;
    }
}

impl Stage for RowOffsetFpn {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        super::add_offset::<A>(row, self.sigma_e * normal(&mut cx.per_row(0, cx.row)));
        if self.sigma_e_per_s > 0.0 {
            let growth = growth(cx, self.reference_c, self.doubling_c);
            let sigma_e = self.sigma_e_per_s * cx.exposure_s * growth;
            super::add_offset::<A>(row, sigma_e * normal(&mut cx.per_row(1, cx.row)));
        }
    }
}
