//! Error of the black level.

use crate::arith::{Arith, Block};
use super::{Context, Inputs, Stage, effect};

effect! {
    /// Black-level offset: the black level is another than the configuration says, and moves with gain,
    /// exposure and channel.
    ///
    /// DN += b + b_G (G − 1) + b_t t + b_c for channel c, before rounding.
    BlackLevelOffset, "black-level-offset", Voltage, Pixel {
        /// Constant part
        offset_dn: "DN", -1e4..=1e4, default 0.0;
        /// Part per unit of analog gain above 1
        per_gain_dn: "DN", -1e4..=1e4, default 0.0;
        /// Part per second of exposure
        per_second_dn: "DN/s", -1e6..=1e6, default 0.0;
        /// Part of the first channel
        channel_0_dn: "DN", -1e4..=1e4, default 0.0;
        /// Part of the second channel
        channel_1_dn: "DN", -1e4..=1e4, default 0.0;
        /// Part of the third channel
        channel_2_dn: "DN", -1e4..=1e4, default 0.0;
        /// Part of the fourth channel
        channel_3_dn: "DN", -1e4..=1e4, default 0.0;
    }
}

impl Stage for BlackLevelOffset {
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let common = self.offset_dn
            + self.per_gain_dn * (cx.analog_gain - 1.0)
            + self.per_second_dn * cx.exposure_s;
        let by_channel = [self.channel_0_dn, self.channel_1_dn, self.channel_2_dn, self.channel_3_dn];
        for (x, v) in row.as_flattened_mut().iter_mut().enumerate() {
            let own = by_channel.get(cx.channel(x)).copied().unwrap_or(0.0);
            *v = A::add(*v, A::signal((common + own) / cx.dn_per_e));
        }
    }
}
