//! Error of the black level.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Black-level offset: the black level differs from the configured one, and changes with gain,
    /// exposure, colour plane and temperature.
    ///
    /// DN += b + b_G (G − 1) + b_t t + b_p + b_T (T − T_ref) before rounding, where G is the
    /// analogue gain, t the exposure, T the temperature, and p = 2 (y mod 2) + x mod 2 the colour
    /// plane of a 2x2 pattern. A converter that truncates gives the largest code below the signal,
    /// which is rounding half a code lower: b = −0.5 DN.
    ///
    /// Source: definition.
    ///
    /// Closed form: without light and noise every pixel reads b_0, the black level, and these terms,
    /// in DN, rounded.
    BlackLevelOffset, "black-level-offset", Voltage, Response, Pixel {
        /// Constant part
        offset_dn: "DN", -1e4..=1e4, default 0.0;
        /// Part per unit of analog gain above 1
        per_gain_dn: "DN", -1e4..=1e4, default 0.0;
        /// Part per second of exposure
        per_second_dn: "DN/s", -1e6..=1e6, default 0.0;
        /// Part of even columns of even rows (from 0)
        plane_0_dn: "DN", -1e4..=1e4, default 0.0;
        /// Part of odd columns of even rows
        plane_1_dn: "DN", -1e4..=1e4, default 0.0;
        /// Part of even columns of odd rows
        plane_2_dn: "DN", -1e4..=1e4, default 0.0;
        /// Part of odd columns of odd rows
        plane_3_dn: "DN", -1e4..=1e4, default 0.0;
        /// Part per kelvin above the reference temperature
        per_kelvin_dn: "DN/K", -1e3..=1e3, default 0.0;
        /// Reference temperature
        reference_c: "degC", -100.0..=150.0, default 25.0;
    }
}

impl Stage for BlackLevelOffset {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let common = self.offset_dn
            + self.per_gain_dn * (cx.at_gain.analog_gain - 1.0)
            + self.per_second_dn * cx.exposure_s
            + self.per_kelvin_dn * (cx.temperature_c - self.reference_c);
        let dn_per_e = cx.dn_per_e_here();
        let by_plane = [self.plane_0_dn, self.plane_1_dn, self.plane_2_dn, self.plane_3_dn];
        let first = cx.row as usize % 2 * 2;
        for (x, v) in row.as_flattened_mut().iter_mut().enumerate() {
            let own = by_plane.get(first + x % 2).copied().unwrap_or(0.0);
            *v = A::add(*v, A::signal((common + own) / dn_per_e));
        }
    }
}
