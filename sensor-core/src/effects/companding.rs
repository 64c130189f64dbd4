//! Piecewise linear response.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Companding: a piecewise linear response that compresses highlights before the converter, as
    /// in many automotive sensors.
    ///
    /// The response has slope 1 up to the first knee, the first slope between the knees, and the
    /// second slope beyond the second knee. Knees are given on the scale before compression; in DN
    /// they are the same at any gain. Receivers undo curves of this kind (AMD Vitis Vision,
    /// `hdr_decompand`).
    ///
    /// Source: definition.
    ///
    /// Closed form: for a ramp three straight lines, which meet at the knees.
    Companding, "companding", Voltage, Response, Pixel {
        /// First knee as a fraction of the converter's range
        knee_1: "1", 0.0..=1.0;
        /// Slope from there on
        slope_1: "1", 0.0..=1.0;
        /// Second knee as a fraction of the converter's range, not below the first
        knee_2: "1", 0.0..=1.0, default 1.0;
        /// Slope from there on
        slope_2: "1", 0.0..=1.0, default 1.0;
    }
}

impl Stage for Companding {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let first = A::signal(self.knee_1 * cx.range_e());
        let second = A::signal(self.knee_2.max(self.knee_1) * cx.range_e());
        let slopes = [A::factor(self.slope_1), A::factor(self.slope_2)];
        let zero = A::Signal::default();
        let beyond = |v, knee| if v > knee { A::sub(v, knee) } else { zero };
        for v in row.as_flattened_mut() {
            let (over, far) = (beyond(*v, first), beyond(*v, second));
            let middle = A::scale(A::sub(over, far), slopes[0]);
            *v = A::add(A::add(A::sub(*v, over), middle), A::scale(far, slopes[1]));
        }
    }
}
