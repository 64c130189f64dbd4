//! Place of the gain in the chain.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::math;

effect! {
    /// Gain stage: how much of the analogue gain lies before the effects that follow it in the
    /// list. What enters behind an amplifier, as the offsets and the noise of column converters do,
    /// is constant in DN: referred to the input it falls as the gain rises.
    ///
    /// v' = min(v G^s, 524 287 e⁻), with G the analogue gain and s its share; the converter's DN per
    /// electron is then that of G^(1 − s). With a gain table, G is its DN per electron over those at
    /// unity gain. Electrons of the effects that follow are those at unity gain; at another gain
    /// they are fewer by G^s, referred to the input. Where gain is
    /// applied in several places, or noise falls with a measured power of it, s is that power: Wei
    /// et al. 2021 (ELD) find 0.3 to 0.55 for read and row noise. Read noise and row offsets of
    /// `[sensor.noise]` stand before it, and a further gain stage adds its share to those before.
    /// EMVA 1288 release 4.0, section 2.2, for the chain with its gain in one place.
    ///
    /// Source: EMVA 1288 release 4.0, section 2.2; Wei et al. 2021.
    ///
    /// Closed form: behind a share s of the gain, offsets and noise in DN are G^(1 − s) times those
    /// at unity gain.
    GainStage, "gain-stage", Voltage, Response, Pixel {
        /// Share s of the gain, as a power of it
        share: "1", 0.0..=1.0, default 1.0;
    }
}

impl GainStage {
    /// The factor on the signal at an analogue gain.
    pub(crate) fn factor(&self, analog_gain: f32) -> f32 {
        if self.share == 1.0 { analog_gain } else { math::pow(analog_gain, self.share) }
    }
}

impl Stage for GainStage {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        super::scale_all::<A>(row, self.factor(cx.analog_gain));
    }
}
