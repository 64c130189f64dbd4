//! 1/f noise over rows.

use crate::arith::{Arith, Block};
use crate::math;
use rand_core::Rng;
use super::context::normal;
use super::{Context, Inputs, Stage, effect};

effect! {
    /// Row-correlated noise (banding): rows' offsets drift, with a spectrum that falls as a power of
    /// frequency.
    ///
    /// v += Σ_k σ_k z_k(⌊(y + s_k)/2^k⌋, frame): octaves k = 0..12 of independent offsets that hold for 2^k rows,
    /// shifted by a random s_k in each frame; σ_k² in proportion to 2^(k(a−1)), together σ². Voss' sum of
    /// octaves (Gardner 1978): power density falls as f^−a from 1/2 to 1/4096 cycles per row. The
    /// autocovariance is Σ_k σ_k² max(0, 1 − |h|/2^k). Any row can be had without the others. Frames are
    /// independent. Input-referred.
    RowCorrelatedNoise, "row-correlated-noise", Voltage, Pixel {
        /// Standard deviation of a row's offset
        sigma_e: "e-", 0.0..=1e5;
        /// Exponent a of the spectrum; 0 is white
        exponent: "1", 0.0..=2.0, default 1.0;
    }
}

/// Octaves of rows.
const OCTAVES: u32 = 13;

impl Stage for RowCorrelatedNoise {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let (mut sum, mut total, mut variance) = (0.0, 0.0, 1.0);
        let ratio = math::exp(core::f32::consts::LN_2 * (self.exponent - 1.0));
        for k in 0..OCTAVES {
            let shift = cx.per_frame(k, cx.frame).next_u32() & ((1 << k) - 1);
            let cell = (cx.row + shift) >> k;
            sum += math::sqrt(variance) * normal(&mut cx.per_row_and_frame(k, cell));
            total += variance;
            variance *= ratio;
        }
        super::add_offset::<A>(row, self.sigma_e * sum * math::rsqrt(total));
    }
}
