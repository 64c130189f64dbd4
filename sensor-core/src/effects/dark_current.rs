//! Dark current with its shot noise and non-uniformity.

use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, BLOCK, Block, EXPANSION_FROM_E, MAX_NORMAL};
use crate::math;

effect! {
    /// Dark current: thermally generated charge, with its shot noise and its non-uniformity over
    /// pixels (DSNU).
    ///
    /// A pixel's mean is d = t 2^((T − T_ref)/T_d) (I + σ z(x, y)), with z standard normal and
    /// fixed. The charge is Poisson(max(d, 0)) + min(d, 0), so that mean and spread over pixels
    /// are as stated even where the normal law reaches below zero. N_dark of eq. 10 of Chen et al.
    /// 2009; doubling temperature as in EMVA 1288. Valid over some 40 K, where one doubling
    /// temperature holds.
    ///
    /// Source: Chen et al. 2009, eq. 10; EMVA 1288 for the temperature.
    ///
    /// Closed form: mean t I 2^((T − T_ref)/T_d), temporal variance the same, spread of the pixels'
    /// means t σ 2^((T − T_ref)/T_d).
    DarkCurrent, "dark-current", Charge, Dark, Pixel {
        /// Mean over pixels at the reference temperature
        mean_e_per_s: "e-/s", 0.0..=1e6;
        /// Standard deviation over pixels at the reference temperature
        dsnu_e_per_s: "e-/s", 0.0..=1e6, default 0.0;
        /// Temperature rise that doubles it
        doubling_c: "K", 1.0..=100.0, default 7.0;
        /// Reference temperature
        reference_c: "degC", -100.0..=150.0, default 25.0;
    }
}

/// Growth of dark current from the reference temperature to the sensor's.
pub(crate) fn growth(cx: &Context<'_>, reference_c: f32, doubling_c: f32) -> f32 {
    math::exp(core::f32::consts::LN_2 * (cx.temperature_c - reference_c) / doubling_c)
}

impl Stage for DarkCurrent {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let growth = cx.exposure_s * growth(cx, self.reference_c, self.doubling_c);
        let mean = A::signal(self.mean_e_per_s * growth);
        let sigma = A::signal(self.dsnu_e_per_s * growth);
        let zero = A::Signal::default();
        let mut pattern = cx.per_pixel(0);
        let reach = MAX_NORMAL * A::electrons(sigma);
        let mean_e = A::electrons(mean);
        let mut counts =
            cx.counts(0, mean_e - reach < EXPANSION_FROM_E, mean_e + reach >= EXPANSION_FROM_E);
        for block in row {
            let z = A::normals(&mut pattern);
            let mut dark = [zero; BLOCK];
            for i in 0..BLOCK {
                let d = A::add(mean, A::scale(sigma, z[i]));
                let below = if d < zero { d } else { zero };
                block[i] = A::add(block[i], below);
                dark[i] = A::sub(d, below);
            }
            A::poisson(core::slice::from_mut(&mut dark), &mut counts);
            for i in 0..BLOCK {
                block[i] = A::add(block[i], dark[i]);
            }
        }
    }
}
