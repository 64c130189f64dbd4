//! Photon shot noise.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block, EXPANSION_FROM_E};

effect! {
    /// Photon shot noise: the count of photo-electrons is Poisson distributed around its mean.
    ///
    /// n ~ Poisson(µ): N_shot of eq. 10 of Chen et al. 2009, in electrons.
    ///
    /// Method: below µ = 16 by inversion of the distribution function with 32 uniform bits; from
    /// there on by the floor of the third-order Cornish-Fisher expansion of the quantile in a
    /// normal number (Cornish & Fisher 1938; Giles 2016 gives it for the Poisson law). The total
    /// variation distance to the exact law is below 6e-5 at 16, below 3e-5 from 30 on, and about
    /// 1e-7 below 16, where counts rarer than 6e-8 do not occur. The bench `sensor` prints
    /// chi-square over 1e8 draws. For exact counts see the effect `exact-shot-noise` (feature of
    /// the same name).
    ///
    /// Source: Chen et al. 2009, eq. 10.
    ///
    /// Closed form: mean µ, variance µ, third central moment µ; pixels and frames independent.
    ShotNoise, "shot-noise", Light, Shot, Pixel {}
}

impl Stage for ShotNoise {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        #[cfg(feature = "exact-shot-noise")]
        if let Some(key) = cx.exact_shot_noise {
            return super::exact_shot_noise::counts::<A>(cx, key, row);
        }
        let bound = A::signal(EXPANSION_FROM_E);
        let (mut low, mut high) = (false, false);
        for &m in row.as_flattened() {
            low |= m < bound;
            high |= m >= bound;
        }
        let mut counts = cx.counts(0, low, high);
        A::poisson(row, &mut counts);
    }
}
