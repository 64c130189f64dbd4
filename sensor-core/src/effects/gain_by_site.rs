//! Gains of the colour pattern's sites.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Gain by site: the places of a 2x2 pattern have system gains of their own, as where pixels
    /// share a floating diffusion, or where a read-out balances the colours before the converter.
    ///
    /// v *= g_p with p = 2 (y mod 2) + x mod 2, signal and noise alike, so that DN per electron
    /// differ from place to place. A green imbalance, in contrast, changes the charge. Put it after
    /// the other effects on the signal and before those of the converter.
    ///
    /// Source: K of EMVA 1288 release 4.0, section 6, for each place.
    ///
    /// Closed form: signal and standard deviation of a place g_p times those without it.
    GainBySite, "gain-by-site", Voltage, Response, Pixel {
        /// Gain at even columns of even rows (from 0), over that of the sensor
        plane_0: "1", 0.1..=10.0, default 1.0;
        /// Gain at odd columns of even rows
        plane_1: "1", 0.1..=10.0, default 1.0;
        /// Gain at even columns of odd rows
        plane_2: "1", 0.1..=10.0, default 1.0;
        /// Gain at odd columns of odd rows
        plane_3: "1", 0.1..=10.0, default 1.0;
    }
}

impl Stage for GainBySite {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let gains = match cx.row % 2 {
            0 => [self.plane_0, self.plane_1],
            _ => [self.plane_2, self.plane_3],
        };
        super::scale_by_place::<A>(cx, row, |x, _| gains[x % 2]);
    }
}
