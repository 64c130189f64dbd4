//! Dark current of the colour pattern's sites.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, BLOCK, Block, EXPANSION_FROM_E};
use crate::effects::dark_current::growth;

effect! {
    /// Dark current by site: the places of a 2x2 pattern have dark currents of their own, as where
    /// pixels share transistors or lie beside them.
    ///
    /// q += Poisson(t g I_p) with p = 2 (y mod 2) + x mod 2, t the exposure and g the growth with
    /// temperature as in `dark-current`. It adds to the uniform dark
    /// current. EMVA 1288 release 4.0, section 7, for each place.
    ///
    /// Source: EMVA 1288 release 4.0, section 7.
    ///
    /// Closed form: mean and temporal variance of a place t g I_p.
    DarkCurrentBySite, "dark-current-by-site", Charge, Dark, Pixel {
        /// Rate of even columns of even rows (from 0), at the reference temperature
        plane_0_e_per_s: "e-/s", 0.0..=1e6, default 0.0;
        /// Rate of odd columns of even rows
        plane_1_e_per_s: "e-/s", 0.0..=1e6, default 0.0;
        /// Rate of even columns of odd rows
        plane_2_e_per_s: "e-/s", 0.0..=1e6, default 0.0;
        /// Rate of odd columns of odd rows
        plane_3_e_per_s: "e-/s", 0.0..=1e6, default 0.0;
        /// Temperature rise that doubles it; in a camera file, left out, that of sensor.noise
        doubling_c: "K", 1.0..=100.0, default 7.0;
        /// Reference temperature; in a camera file, left out, that of sensor.noise
        reference_c: "degC", -100.0..=150.0, default 25.0;
    }
}

impl Stage for DarkCurrentBySite {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let scale = cx.exposure_s * growth(cx, self.reference_c, self.doubling_c);
        let [even, odd] = match cx.row % 2 {
            0 => [self.plane_0_e_per_s, self.plane_1_e_per_s],
            _ => [self.plane_2_e_per_s, self.plane_3_e_per_s],
        };
        let means = [scale * even, scale * odd].map(A::signal);
        let largest_e = scale * even.max(odd);
        let mut counts = cx.counts(0, true, largest_e >= EXPANSION_FROM_E);
        for block in row {
            let mut extra: Block<A::Signal> = core::array::from_fn(|i| means[i % 2]);
            A::poisson(core::slice::from_mut(&mut extra), &mut counts);
            for i in 0..BLOCK {
                block[i] = A::add(block[i], extra[i]);
            }
        }
    }
}
