//! Errors of the converter's bits.

use super::context::normal;
use super::{Context, Inputs, Stage, effect};
use crate::arith::{Arith, Block};
use crate::math;

effect! {
    /// Converter non-linearity: the weights of the converter's bits are not exact powers of two,
    /// so some codes are wide, some are narrow and some are missing.
    ///
    /// The model is a successive-approximation converter that tries the bits from the highest
    /// down. Code c begins at T(c) = c − 1/2 + Σ_b (ε_b − g 2^b) bit_b(c) DN. ε_b = σ 2^(b/2) z_b
    /// is the error of bit b (in an array of matched unit elements the error of a weight grows
    /// with its root), with z standard normal and fixed. The common gain error g = Σ ε_b 2^b / Σ
    /// 4^b is taken out. Known errors of the lowest bits are added afterwards; beside those of the
    /// two lowest one of both together, as these may come from a flash stage, whose three
    /// thresholds err one by one. The largest random step lies at the middle of the scale and is
    /// about σ 2^(bits/2). Put this effect last of those on the signal. IEEE 1241.
    ///
    /// Source: IEEE 1241.
    ///
    /// Closed form: code c is as wide as T(c + 1) − T(c) of the equation, in DN.
    AdcNonlinearity, "adc-nonlinearity", Voltage, Response, Pixel {
        /// Standard deviation of the error of the lowest bit's weight
        sigma_lsb: "DN", 0.0..=1.0, default 0.0;
        /// Known error of the weight of the lowest bit
        bit_0_lsb: "DN", -64.0..=64.0, default 0.0;
        /// Known error of the weight of the second bit
        bit_1_lsb: "DN", -64.0..=64.0, default 0.0;
        /// Known error of the weight of the third bit
        bit_2_lsb: "DN", -64.0..=64.0, default 0.0;
        /// Known error of the weight of the fourth bit
        bit_3_lsb: "DN", -64.0..=64.0, default 0.0;
        /// Known error of the weight of the fifth bit
        bit_4_lsb: "DN", -64.0..=64.0, default 0.0;
        /// Known error of the weight of the sixth bit
        bit_5_lsb: "DN", -64.0..=64.0, default 0.0;
        /// Known error of the weight of the seventh bit
        bit_6_lsb: "DN", -64.0..=64.0, default 0.0;
        /// Known error of the two lowest bits together, beside that of each
        bits_0_1_lsb: "DN", -64.0..=64.0, default 0.0;
    }
}

impl Stage for AdcNonlinearity {
    #[inline(always)]
    fn apply<A: Arith>(
        &self,
        cx: &Context<'_>,
        _: &Inputs<'_, A::Signal>,
        row: &mut [Block<A::Signal>],
    ) {
        let mut rng = cx.per_sensor(0);
        let (mut errors, mut sum, mut power) = ([0.0f32; 16], 0.0, 0.0);
        let bits = 16 - cx.max_dn.leading_zeros() as usize;
        for (b, error) in errors.iter_mut().enumerate().take(bits) {
            let weight = (1u32 << b) as f32;
            *error = self.sigma_lsb * math::sqrt(weight) * normal(&mut rng);
            sum += *error * weight;
            power += weight * weight;
        }
        let known = [
            self.bit_0_lsb,
            self.bit_1_lsb,
            self.bit_2_lsb,
            self.bit_3_lsb,
            self.bit_4_lsb,
            self.bit_5_lsb,
            self.bit_6_lsb,
        ];
        for (b, error) in errors.iter_mut().enumerate().take(bits) {
            let weight = (1u32 << b) as f32;
            // From here on whole weights.
            *error += weight - sum / power * weight + known.get(b).copied().unwrap_or(0.0);
        }
        let dn_per_e = cx.dn_per_e_here();
        let e_per_dn = 1.0 / dn_per_e;
        for v in row.as_flattened_mut() {
            let mut left = A::electrons(*v) * dn_per_e + cx.black_level_dn + 0.5;
            let mut code = 0u32;
            for (b, weight) in errors.iter().enumerate().take(bits).rev() {
                let beside_the_next = b == 0 && code & 2 != 0;
                let weight = *weight + if beside_the_next { self.bits_0_1_lsb } else { 0.0 };
                let set = left >= weight;
                left -= if set { weight } else { 0.0 };
                code |= u32::from(set) << b;
            }
            *v = A::signal((code as f32 - cx.black_level_dn) * e_per_dn);
        }
    }
}
