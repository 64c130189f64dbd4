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
    /// v += Σ_j σ_j s_j(y) z_j(cell, frame): octaves j = 0.. of 2^j cells per frame, in each cell a pulse that is up in
    /// one half and down in the other (s = ±1, Haar's wavelet), wrapped around the frame from a random row d_j on;
    /// z standard normal. σ_j² in proportion to L^(a−1), L = H/2^j rows the length of a cell, 1 − 0.4 a times that for the
    /// shortest (two rows, which has what shorter ones would add near 1/2 cycle per row), together σ²: power density falls
    /// as f^−a from 1/2 cycle per row to one per frame (within 4 % rms over ln f up to a = 0.8, 7 % at 1, 16 % at 1.4;
    /// steeper laws end in the f^−2 of steps), and the mean of a frame stays.
    /// Slower noise is [`frame_offset_noise`](super::frame_offset_noise)'s, or is clamped away. The autocovariance
    /// of an octave is σ_j² (1 − 3h/L) up to h = L/2, then σ_j² (h/L − 1), for h < L (of j = 0 it is that of a square wave). Any row can be had without the
    /// others. Frames are independent. Input-referred. After the octave sums of Voss (Gardner 1978) and the wavelet
    /// synthesis of 1/f noise (Wornell 1993).
    RowCorrelatedNoise, "row-correlated-noise", Voltage, Pixel {
        /// Standard deviation of a row's offset
        sigma_e: "e-", 0.0..=1e5;
        /// Exponent a of the spectrum; 0 is white
        exponent: "1", 0.0..=2.0, default 1.0;
    }
}

/// Most octaves of rows.
const OCTAVES: u32 = 14;

impl Stage for RowCorrelatedNoise {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let (mut sum, mut total) = (0.0, 0.0);
        let ratio = math::exp(core::f32::consts::LN_2 * (self.exponent - 1.0));
        // 2^j cells of two rows or a little more, then longer ones.
        let height = u64::from(cx.height.max(1));
        let octaves = (31 - cx.height.max(2).leading_zeros()).min(OCTAVES);
        let (mut variance, mut share) = (1.0, 1.0 - 0.4 * self.exponent);
        for k in 1..=octaves {
            let j = octaves - k;
            let first = u64::from(cx.per_frame(k, cx.frame).next_u32()) % height;
            let at = (u64::from(cx.row) + first) % height;
            let halves = (at << j) * 2 / height;
            let sign = if halves & 1 == 0 { 1.0 } else { -1.0 };
            let z = normal(&mut cx.per_row_and_frame(k, (halves >> 1) as u32));
            sum += math::sqrt(variance * share) * sign * z;
            total += variance * share;
            variance *= ratio;
            share = 1.0;
        }
        super::add_offset::<A>(row, self.sigma_e * sum * math::rsqrt(total));
    }
}
