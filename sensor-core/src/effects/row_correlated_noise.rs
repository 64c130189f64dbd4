//! 1/f noise over rows.

use super::context::normal;
use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::math;
use rand_core::Rng;

effect! {
    /// Row-correlated noise (banding): the offsets of rows drift, with a spectrum that falls as a
    /// power of frequency (1/f noise).
    ///
    /// v += Σ_j σ_j s_j(y) z_j(cell, frame), z standard normal: octaves j = 0.. of 2^j cells per
    /// frame. In each cell a pulse is positive in one half and negative in the other (s = ±1,
    /// Haar's wavelet); cells wrap around the frame from a random row d_j on. σ_j² is proportional
    /// to L^(a−1), where L = H/2^j is the length of a cell in rows; the shortest octave (two rows)
    /// has 1 − 0.4 a times that, which stands for still shorter ones near 1/2 cycle per row.
    /// Together they are σ². The power density falls as f^−a from 1/2 cycle per row to one cycle
    /// per frame (within 4 % rms over ln f up to a = 0.8, 7 % at 1, 16 % at 1.4; steeper laws end
    /// in the f^−2 of steps), and the mean of a frame does not change. Slower noise belongs to
    /// `frame-offset-noise`, or is removed by the black-level clamp.
    ///
    /// The autocovariance of an octave is σ_j² (1 − 3h/L) up to h = L/2 and σ_j² (h/L − 1) from
    /// there to h = L (for j = 0 it is that of a square wave). Any row can be computed without the
    /// others, and frames are independent. Input-referred. After the octave sums of Voss (Gardner
    /// 1978) and the wavelet synthesis of 1/f noise (Wornell 1993).
    ///
    /// Source: Gardner 1978; Wornell 1993.
    ///
    /// Closed form: row means have variance σ² G^(2p), and the sum of the octaves' autocovariances
    /// as theirs.
    RowCorrelatedNoise, "row-correlated-noise", Voltage, Temporal, Pixel {
        /// Standard deviation of a row's offset
        sigma_e: "e-", 0.0..=1e5;
        /// Exponent a of the spectrum; 0 is white
        exponent: "1", 0.0..=2.0, default 1.0;
        /// Power p of the analogue gain to which it is proportional, σ G^p: 0 before the gain, −1
        /// behind it
        gain_exponent: "1", -2.0..=2.0, default 0.0;
    }
}

/// Most octaves: 2^14 cells of two rows are the tallest sensor (`MAX_SIDE`).
const OCTAVES: u32 = 14;
/// The shortest octave's variance is 1 − this times the exponent, in units of the law's: fitted so
/// that the spectrum near 1/2 cycle per row follows f^−a (test `row_correlated_noise`).
const SHORTEST_OCTAVE: f32 = 0.4;

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
        // From the shortest cells, of two rows or a little more, to the longest.
        let height = u64::from(cx.height.max(1));
        let octaves = (31 - cx.height.max(2).leading_zeros()).min(OCTAVES);
        let (mut variance, mut share) = (1.0, 1.0 - SHORTEST_OCTAVE * self.exponent);
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
        let sigma_e = self.sigma_e * cx.power_of_gain(self.gain_exponent);
        super::add_offset::<A>(row, sigma_e * sum * math::rsqrt(total));
    }
}
