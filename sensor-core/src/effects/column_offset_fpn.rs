//! Column-wise fixed pattern.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::effects::dark_current::growth;

effect! {
    /// Column offset fixed pattern: each column's amplifier or converter has its own offset.
    ///
    /// v += σ z(x) + d z'(x), d = t 2^((T − T_ref)/T_d) σ_d, with z and z' standard normal and fixed:
    /// the second part is that of dark current in the columns' storage, which grows with exposure
    /// and temperature as `dark-current` does, without shot noise.
    /// Input-referred. EMVA 1288 release 4.0, column part of DSNU.
    ///
    /// Source: EMVA 1288 release 4.0, column part of DSNU.
    ///
    /// Closed form: variance of column means σ² + d², of their differences between frames 0.
    ColumnOffsetFpn, "column-offset-fpn", Voltage, Pattern, Pixel {
        /// Standard deviation over columns
        sigma_e: "e-", 0.0..=1e5;
        /// Standard deviation over columns of the part that dark current makes, at the reference
        /// temperature
        sigma_e_per_s: "e-/s", 0.0..=1e6, default 0.0;
        /// Temperature rise that doubles that part; in a camera file, left out, that of
        /// sensor.noise
        doubling_c: "K", 1.0..=100.0, default 7.0;
        /// Reference temperature; in a camera file, left out, that of sensor.noise
        reference_c: "degC", -100.0..=150.0, default 25.0;
    }
}

impl Stage for ColumnOffsetFpn {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        super::add_normals::<A>(row, self.sigma_e, cx.per_column(0));
        if self.sigma_e_per_s > 0.0 {
            let growth = growth(cx, self.reference_c, self.doubling_c);
            let sigma_e = self.sigma_e_per_s * cx.exposure_s * growth;
            super::add_normals::<A>(row, sigma_e, cx.per_column(1));
        }
    }
}
