//! Stuck pixels.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Stuck pixels: a few pixels give the same signal whatever the light.
    ///
    /// A fixed fraction f of the pixels reads black level + `level` x (2^bits − 1) DN at any
    /// analogue gain, since what is stuck lies at the converter's input; 1 and above is stuck white.
    ///
    /// Source: definition.
    ///
    /// Closed form: a share f of the pixels reads black level + level x (2^bits − 1) DN, rounded,
    /// without noise.
    StuckPixels, "stuck-pixels", Voltage, Defect, Pixel {
        /// Fraction of pixels
        fraction: "1", 0.0..=1.0;
        /// Their signal as a fraction of the converter's range
        level: "1", 0.0..=2.0, default 1.0;
    }
}

impl Stage for StuckPixels {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let level = A::signal(self.level * cx.range_e());
        let mut lanes = cx.per_pixel(0);
        for block in row {
            let chosen = super::chosen(&mut lanes, self.fraction);
            for (v, chosen) in block.iter_mut().zip(chosen) {
                *v = if chosen { level } else { *v };
            }
        }
    }
}
