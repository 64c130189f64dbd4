//! Spread of read noise over pixels.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, BLOCK, Block};
use crate::math;
use crate::stream::Key;

effect! {
    /// Read-noise spread: each pixel has its own read noise, distributed log-normally.
    ///
    /// σ(x, y) = r exp(s z(x, y)), with z standard normal and fixed, and r as in
    /// `read-noise`. So r is the median, and the mean square is r² exp(2s²).
    /// This effect only alters the read-noise stage; alone it does nothing. Noise maps of
    /// scientific CMOS sensors (for example Huang et al. 2013).
    ///
    /// Source: definition; maps as of Huang et al. 2013.
    ///
    /// Closed form: pixels' variances have mean r² exp(2s²) and mean square r⁴ exp(8s²).
    ReadNoiseSpread, "read-noise-spread", Voltage, Temporal, Pixel {
        /// Standard deviation of the logarithm of a pixel's read noise
        spread: "1", 0.0..=0.6;
    }
}

impl Stage for ReadNoiseSpread {
    fn prepare(&self, cx: &mut Context<'_>) {
        cx.read_noise_spread = Some((self.spread, cx.key));
    }

    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        _: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        _: &mut [Block<A::Signal>],
    ) {
    }
}

/// Read noise of `sigma_e` (e⁻) at the median; `key` is the root of the spread's streams.
#[inline(always)]
pub(super) fn add<A: Arith>(
    cx: &Context<'_>,
    key: Key,
    spread: f32,
    sigma_e: f32,
    row: &mut [Block<A::Signal>],
) {
    let mut lanes = cx.per_pixel_and_frame(0);
    let mut pattern = Context { key, ..*cx }.per_pixel(0);
    for block in row {
        let (z, p) = (A::normals(&mut lanes), A::normals(&mut pattern));
        for i in 0..BLOCK {
            let sigma = A::signal(sigma_e * math::exp(spread * A::number(p[i])));
            block[i] = A::add(block[i], A::scale(sigma, z[i]));
        }
    }
}
