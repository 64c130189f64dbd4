//! Dead and weak columns.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Dead and weak columns: a few columns respond with a fraction of the others' gain, or not at
    /// all, over their whole length or from a break on.
    ///
    /// µ *= g for a fixed fraction f of the columns, in the last share l of their rows. What a
    /// column lacks it lacks before shot noise, as in `defective-pixels`. Chen et al. 2009,
    /// section VI: defects that only the captures show.
    ///
    /// Closed form: a share f of the columns has mean and temporal variance gµ in the last share l
    /// of their rows, µ above.
    DefectiveColumns, "defective-columns", Light, Defect, Pixel {
        /// Fraction of columns
        fraction: "1", 0.0..=1.0;
        /// Their gain relative to the rest; 0 is dead
        gain: "1", 0.0..=2.0, default 0.0;
        /// Share of their rows, counted from the last
        length: "1", 0.0..=1.0, default 1.0;
    }
}

impl Stage for DefectiveColumns {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        if (cx.row as f32 + 0.5) < cx.height as f32 * (1.0 - self.length) {
            return;
        }
        let mut lanes = cx.per_column(0);
        for block in row {
            let chosen = super::chosen(&mut lanes, self.fraction);
            for (v, chosen) in block.iter_mut().zip(chosen) {
                *v = if chosen { A::times(*v, self.gain) } else { *v };
            }
        }
    }
}
