//! Black sun.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Black sun: light so strong that the pixel fills while its reset level is being sampled.
    /// Double sampling then subtracts signal from signal, and the brightest spots turn dark.
    ///
    /// n = 0 where the photo-electrons of the exposure exceed k W, with W the full well.
    ///
    /// Source: definition.
    ///
    /// Closed form: 0 above k W, the light as it was below.
    BlackSun, "black-sun", Photo, Response, Pixel {
        /// Light k in full wells from which pixels turn dark
        onset: "full wells", 1.0..=1e4;
    }
}

impl Stage for BlackSun {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let onset = A::signal(self.onset * cx.full_well_e);
        let zero = A::Signal::default();
        for v in row.as_flattened_mut() {
            *v = if *v > onset { zero } else { *v };
        }
    }
}
