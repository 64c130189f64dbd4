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
    /// v += Σ_L A_L s_L(y) z_L(cell, frame), z standard normal, over cells of L = 2, 4, 8 ... 2^K
    /// rows, as many as fit into the frame's H rows one after another, and one of all rows (of
    /// H − 1 where H is odd). In each cell a pulse is positive in one half and negative in the
    /// other (s = ±1, Haar's wavelet). The first cell begins at a random row, and cells go on at
    /// the top of the frame where they reach its end; the rows beyond the last whole cell, H mod L,
    /// have none of that length. Cells of L rows have the part S_L of the variance, in proportion
    /// to w_L L^(a−1), so that A_L² = S_L H/(H − H mod L); all parts together are σ². The
    /// weight w is 1 for an octave, log2(H/2^K) for the part of one from 2^K to all rows, and 1 −
    /// 0.4 a for two rows, which stand for still shorter cells near 1/2 cycle per row. At any
    /// height the power density falls as f^−a from 1/2 cycle per row to one cycle per frame (from
    /// 128 rows on within 5 % rms over ln f up to a = 0.7, 8 % at 1, 17 % at 1.4; steeper laws end
    /// in the f^−2 of steps), and the mean of a frame does not change. Slower noise belongs to
    /// `frame-offset-noise`, or is removed by the black-level clamp.
    ///
    /// Any row can be computed without the others, and frames are independent. Input-referred.
    /// After the octave sums of Voss (Gardner 1978) and the wavelet synthesis of 1/f noise (Wornell
    /// 1993).
    ///
    /// Source: Gardner 1978; Wornell 1993.
    ///
    /// Closed form: row means have variance σ² G^(2p), and at whole cycles per frame the power
    /// spectrum G^(2p) Σ_L S_L 4 sin⁴(πfL/2)/(L sin² πf), f in cycles per row: the square of
    /// a cell's Fourier transform over its length.
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

/// The weight of the shortest cells is 1 − this times the exponent: fitted so that the spectrum
/// near 1/2 cycle per row follows f^−a (test `row_correlated_noise`).
const SHORTEST_CELLS: f32 = 0.4;

impl Stage for RowCorrelatedNoise {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        // A single row is one of two.
        let height = cx.height.max(2);
        let (octaves, all_rows) = (height.ilog2(), height & !1);
        let part = math::ln(all_rows as f32) * core::f32::consts::LOG2_E - octaves as f32;
        let (mut sum, mut total) = (0.0, 0.0);
        for k in 1..=octaves + 1 {
            let length = (1 << k).min(all_rows);
            let weight = match k {
                1 => 1.0 - SHORTEST_CELLS * self.exponent,
                _ if k > octaves => part.max(0.0),
                _ => 1.0,
            };
            let variance = weight * math::pow(length as f32, self.exponent - 1.0);
            total += variance;
            let first = cx.per_frame(k, cx.frame).next_u32() % height;
            let at = (cx.row + first) % height;
            let covered = height - height % length;
            if at < covered {
                let sign = if at % length < length / 2 { 1.0 } else { -1.0 };
                let z = normal(&mut cx.per_row_and_frame(k, at / length));
                sum += math::sqrt(variance * height as f32 / covered as f32) * sign * z;
            }
        }
        let sigma_e = self.sigma_e * cx.power_of_gain(self.gain_exponent);
        super::add_offset::<A>(row, sigma_e * sum * math::rsqrt(total));
    }
}
