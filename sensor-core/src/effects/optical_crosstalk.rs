//! Neighbour coupling of light.

use crate::arith::{Arith, Block};
use super::charge_coupling::{convolve, kernel};
use super::{Context, Inputs, Stage, effect};

effect! {
    /// Optical crosstalk: part of the light that should go into a pixel is collected by its neighbours (by
    /// reflection below the microlens or diffusion of charge), before shot noise, so that it blurs and mixes
    /// colours but leaves the noise of pixels independent.
    ///
    /// µ' = µ ⊗ k, the kernel as in [`charge_coupling`](super::charge_coupling). Light is kept, but
    /// for what passes the array's edges. One kernel for all wavelengths: diffusion grows with wavelength, so
    /// figures hold for the light they were measured with.
    /// Chen et al. 2009, section IV-C.
    OpticalCrosstalk, "optical-crosstalk", Light, Neighbours {
        /// Fraction that goes to the left and to the right neighbour, each
        side: "1", 0.0..=0.125;
        /// Fraction that goes to the neighbour above and below, each
        vertical: "1", 0.0..=0.125;
        /// Fraction that goes to each diagonal neighbour
        diagonal: "1", 0.0..=0.125, default 0.0;
    }
}

impl Stage for OpticalCrosstalk {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        inputs: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let kernel = kernel::<A>(self.side, self.vertical, self.diagonal);
        convolve::<A>(cx.width, kernel, inputs, row);
    }
}
