//! Dead and weak pixels.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Dead and weak pixels: a few pixels respond with a fraction of the others' gain, or not at
    /// all.
    ///
    /// µ *= g for a fixed fraction f of the pixels: they collect less light, and their shot noise
    /// is that of what they collect. Chen et al. 2009, section VI: defects that only the captures
    /// show.
    ///
    /// Source: Chen et al. 2009, section VI.
    ///
    /// Closed form: a share f of the pixels has mean and temporal variance gµ.
    DefectivePixels, "defective-pixels", Light, Defect, Pixel {
        /// Fraction of pixels
        fraction: "1", 0.0..=1.0;
        /// Their gain relative to the rest; 0 is dead
        gain: "1", 0.0..=2.0, default 0.0;
    }
}

impl Stage for DefectivePixels {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let mut lanes = cx.per_pixel(0);
        for block in row {
            let chosen = super::chosen(&mut lanes, self.fraction);
            for (v, chosen) in block.iter_mut().zip(chosen) {
                *v = if chosen { A::times(*v, self.gain) } else { *v };
            }
        }
    }
}
