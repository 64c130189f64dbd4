//! Error of the relative illumination.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Relative illumination: the fall-off towards the corners differs from the lens model's.
    ///
    /// µ *= 1 + k r², with r the distance from the centre, 1 at the corners; the same for all
    /// channels.
    ///
    /// Source: definition.
    ///
    /// Closed form: µ (1 + k r²) at a distance r.
    RelativeIllumination, "relative-illumination", Light, Response, Pixel {
        /// Change k at the corners
        corner: "1", -0.9..=2.0;
    }
}

impl Stage for RelativeIllumination {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        super::scale_by_place::<A>(cx, row, |_, u| 1.0 + self.corner * cx.field2(u));
    }
}
