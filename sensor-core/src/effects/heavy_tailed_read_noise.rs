//! Read noise with heavy tails.

use super::context::unit;
use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::math;

effect! {
    /// Heavy-tailed read noise: a part of the read noise that follows a Tukey lambda distribution.
    ///
    /// v += σ Q(u)/s, with u uniform per pixel and frame, Q(u) = (u^λ − (1−u)^λ)/λ and s² = 2/λ²
    /// (1/(1+2λ) − B(1+λ, 1+λ)) its variance. λ = 0.14 is close to normal, 0 is logistic (kurtosis
    /// 4.2), −0.2 has very heavy tails. For |λ| below 0.01 the logistic limit is used. It adds to
    /// the white read noise; set that to 0 to have this alone. Tukey 1962; Wei et al. 2020.
    ///
    /// Source: Tukey 1962; Wei et al. 2020.
    ///
    /// Closed form: variance σ² G^(2p); quantiles σ G^p Q(u)/s.
    HeavyTailedReadNoise, "heavy-tailed-read-noise", Voltage, Temporal, Pixel {
        /// Standard deviation
        sigma_e: "e-", 0.0..=1e5;
        /// Shape λ
        lambda: "1", -0.22..=0.3, default -0.1;
        /// Power p of the analogue gain to which it is proportional, σ G^p: 0 before the gain, −1
        /// behind it
        gain_exponent: "1", -2.0..=2.0, default 0.0;
    }
}

/// Shape |λ| below which the logistic limit stands for Q: (u^λ − (1−u)^λ)/λ then loses two digits
/// in f32, and the quantile is off by λ/2 |ln u| of itself at most, 1 % at |ln u| = 2.
const LOGISTIC_BELOW: f64 = 0.01;

impl HeavyTailedReadNoise {
    /// Variance of Q.
    fn variance(&self) -> f32 {
        let l = f64::from(self.lambda);
        if l.abs() < LOGISTIC_BELOW {
            // Of the logistic law with scale 1.
            return core::f32::consts::PI * core::f32::consts::PI / 3.0;
        }
        let gamma = libm::tgamma(1.0 + l);
        let beta = gamma * gamma / libm::tgamma(2.0 + 2.0 * l);
        (2.0 / (l * l) * (1.0 / (1.0 + 2.0 * l) - beta)) as f32
    }
}

impl Stage for HeavyTailedReadNoise {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let lambda = self.lambda;
        let logistic = lambda.abs() < LOGISTIC_BELOW as f32;
        let sigma_e = self.sigma_e * cx.power_of_gain(self.gain_exponent);
        let scale = sigma_e * math::rsqrt(self.variance());
        let mut lanes = cx.per_pixel_and_frame(0);
        for block in row {
            let words = super::words(&mut lanes);
            for (v, word) in block.iter_mut().zip(words) {
                let u = unit(word);
                let (low, high) = (math::ln(u), math::ln(1.0 - u));
                let q = if logistic {
                    low - high
                } else {
                    (math::exp(lambda * low) - math::exp(lambda * high)) / lambda
                };
                *v = A::add(*v, A::signal(scale * q));
            }
        }
    }
}
