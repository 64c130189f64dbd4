//! Shading of single channels.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Colour shading: the channels fall off differently towards the corners, because filters and
    /// microlenses receive oblique light there.
    ///
    /// µ *= 1 + k_c r² for channel c, with r the distance from the centre, 1 at the corners.
    ///
    /// Source: definition.
    ///
    /// Closed form: µ (1 + k_c r²) at a distance r.
    ColourShading, "colour-shading", Light, Response, Pixel {
        /// Change at the corners, first channel
        channel_0: "1", -0.9..=2.0, default 0.0;
        /// Change at the corners, second channel
        channel_1: "1", -0.9..=2.0, default 0.0;
        /// Change at the corners, third channel
        channel_2: "1", -0.9..=2.0, default 0.0;
        /// Change at the corners, fourth channel
        channel_3: "1", -0.9..=2.0, default 0.0;
    }
}

impl Stage for ColourShading {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let by_channel = [self.channel_0, self.channel_1, self.channel_2, self.channel_3];
        super::scale_by_place::<A>(cx, row, |x, u| {
            1.0 + by_channel.get(cx.channel(x)).copied().unwrap_or(0.0) * cx.field2(u)
        });
    }
}
