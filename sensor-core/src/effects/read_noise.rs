//! Read noise.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::math;
use core::ops::{Add, Div, Mul, Sub};

effect! {
    /// Read noise: white Gaussian noise of the read-out chain, one part before and one after the
    /// gain stage.
    ///
    /// v += z √(r² − r_post² + (r_post/G)²), with z standard normal, r the total at unity gain,
    /// r_post the part after the gain stage and G the analogue gain. Input-referred. N_read of eq.
    /// 10 of Chen et al. 2009 (white part, which falls as the analogue gain rises). For a
    /// different value in each pixel see the effect `read-noise-spread`; a `gain-table` may give it
    /// gain by gain.
    ///
    /// Source: Chen et al. 2009, eq. 10.
    ///
    /// Closed form: variance r² − r_post² + (r_post/G)² in every pixel, input-referred; 0 between
    /// pixels and frames.
    ReadNoise, "read-noise", Voltage, Temporal, Pixel {
        /// Standard deviation at unity gain
        read_e: "e-", 0.0..=1e5;
        /// The part added after the gain stage, at most the whole
        read_e_post: "e-", 0.0..=1e5, default 0.0;
    }
}

/// Variance at an analogue gain G of a read noise r, of which r_post comes after the gain stage:
/// r² − r_post² + (r_post/G)², input-referred.
pub fn variance<T>(read_e: T, read_e_post: T, analog_gain: T) -> T
where
    T: Copy + Default + PartialOrd + Add<Output = T> + Sub<Output = T>,
    T: Mul<Output = T> + Div<Output = T>,
{
    let post = read_e_post * read_e_post;
    let pre = read_e * read_e - post;
    let pre = if pre > T::default() { pre } else { T::default() };
    pre + post / (analog_gain * analog_gain)
}

impl Stage for ReadNoise {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let sigma_e = match cx.at_gain.read_e {
            Some(read_e) => read_e * cx.passed_gain,
            None => math::sqrt(variance(self.read_e, self.read_e_post, cx.gain_to_come())),
        };
        #[cfg(feature = "read-noise-spread")]
        if let Some((spread, key)) = cx.read_noise_spread {
            return super::read_noise_spread::add::<A>(cx, key, spread, sigma_e, row);
        }
        super::add_normals::<A>(row, sigma_e, cx.per_pixel_and_frame(0));
    }
}
