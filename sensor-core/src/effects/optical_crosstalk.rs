//! Neighbour coupling of light.

use super::charge_coupling::{convolve, kernel};
use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};

effect! {
    /// Optical crosstalk: part of the light meant for a pixel is collected by its neighbours
    /// (reflection below the microlens, diffusion of charge). It acts before shot noise, so it
    /// blurs and mixes colours but leaves the noise of pixels independent.
    ///
    /// µ' = µ ⊗ k, with the kernel of `charge-coupling`. Light is
    /// conserved, except what crosses the edges of the array. There is one kernel for all
    /// wavelengths: as diffusion grows with wavelength, the parameters hold for the light with
    /// which they were measured. Chen et al. 2009, section IV-C.
    ///
    /// Source: Chen et al. 2009, section IV-C.
    ///
    /// Closed form: a spot becomes the kernel; in a flat neighbours stay independent, with variance
    /// µ.
    OpticalCrosstalk, "optical-crosstalk", Light, Response, Neighbours {
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
