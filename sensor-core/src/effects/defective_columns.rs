//! Dead and weak columns.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use rand_core::Rng;

effect! {
    /// Dead and weak columns: a few columns respond with a fraction of the others' gain, or not at
    /// all, over their whole length or from a break on.
    ///
    /// µ *= g for n = f W of the W columns, rounded, in the last share l of their rows: one anywhere
    /// in each of n strips of equal width, so that a sensor has as many as is said. What a column
    /// lacks it lacks before shot noise, as in `defective-pixels`. Chen et al. 2009, section VI:
    /// defects that only the captures show.
    ///
    /// Source: Chen et al. 2009, section VI.
    ///
    /// Closed form: the n columns have mean and temporal variance gµ in the last share l
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
        let count = (self.fraction * cx.width as f32 + 0.5) as u64;
        let mut places = cx.per_sensor(0);
        let row = row.as_flattened_mut();
        for strip in 0..count {
            // In units of 2⁻¹⁶ strips.
            let at = (strip << 16) + u64::from(places.next_u32() >> 16);
            let column = (at * u64::from(cx.width) / count) >> 16;
            if let Some(v) = row.get_mut(column as usize) {
                *v = A::times(*v, self.gain);
            }
        }
    }
}
