//! Error of the system gain.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// System gain: the read-out chain amplifies more or less than full well and bit depth imply.
    ///
    /// v *= g, signal and noise alike, so that DN per electron are g G (2^bits − 1)/W. K of EMVA
    /// 1288. Put it after the other effects on the signal and before those of the converter.
    ///
    /// Source: EMVA 1288.
    ///
    /// Closed form: signal and standard deviation g times those without it.
    SystemGain, "system-gain", Voltage, Response, Pixel {
        /// Gain relative to that of eq. 11
        ratio: "1", 0.1..=10.0;
    }
}

impl Stage for SystemGain {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        _: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        super::scale_all::<A>(row, self.ratio);
    }
}
