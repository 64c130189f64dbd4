//! Imbalance of the two greens.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Green imbalance: green pixels in rows with red respond differently from those in rows with
    /// blue, because their neighbours' filters and circuits differ.
    ///
    /// µ *= 1 ± g/2 with g = g_0 + (g_1 − g_0) r², r the distance from the centre, 1 at the
    /// corners: + in rows with red (channel 0), − in the others. So g is the relative difference
    /// Gr − Gb. It acts before shot noise, on 2x2 patterns of three or four channels with red first
    /// and blue last, and on no others.
    ///
    /// Source: definition.
    ///
    /// Closed form: (Gr − Gb)/mean = g_0 in the centre and g_1 in the corners; variance of each as
    /// of its mean.
    GreenImbalance, "green-imbalance", Light, Pattern, Pixel {
        /// Difference g_0 in the centre
        centre: "1", -0.5..=0.5;
        /// Difference g_1 in the corners
        corner: "1", -0.5..=0.5, default 0.0;
    }
}

impl Stage for GreenImbalance {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let last = cx.pattern.channels.iter().fold(0, |a, &c| if c > a { c } else { a });
        if (cx.pattern.width, cx.pattern.height) != (2, 2) || last < 2 {
            return;
        }
        let row_of_red = cx.channel(0) == 0 || cx.channel(1) == 0;
        let sign = if row_of_red { 0.5 } else { -0.5 };
        let green = |c: usize| c != 0 && c != usize::from(last);
        let sites = [green(cx.channel(0)), green(cx.channel(1))];
        super::scale_by_place::<A>(cx, row, |x, u| {
            let g = self.centre + (self.corner - self.centre) * cx.field2(u);
            if sites[x % 2] { 1.0 + sign * g } else { 1.0 }
        });
    }
}
