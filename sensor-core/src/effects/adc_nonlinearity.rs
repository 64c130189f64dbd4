//! Errors of the converter's bits.

use crate::arith::{Arith, Block};
use crate::math;
use super::context::normal;
use super::{Context, Inputs, Stage, effect};

effect! {
    /// Converter non-linearity: the weights of the converter's bits are not exact powers of two, so some codes
    /// are wide, some narrow, some missing.
    ///
    /// With c the code of the signal, v += Σ_b (ε_b − g 2^b) bit_b(c) in DN, ε_b = σ 2^(b/2) z_b (matched unit elements:
    /// the error of a weight grows with its root), z standard normal and fixed, and g the common gain error that
    /// is taken out, Σ ε_b 2^b / Σ 4^b. IEEE 1241. Largest step at the middle of the scale, about σ 2^(bits/2). Put it
    /// last of the effects on the signal.
    AdcNonlinearity, "adc-nonlinearity", Voltage, Pixel {
        /// Standard deviation of the error of the lowest bit's weight
        sigma_lsb: "DN", 0.0..=1.0;
    }
}

impl Stage for AdcNonlinearity {
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
        for (b, error) in errors.iter_mut().enumerate().take(bits) {
            *error -= sum / power * (1u32 << b) as f32;
        }
        let e_per_dn = 1.0 / cx.dn_per_e;
        for v in row.as_flattened_mut() {
            let dn = A::electrons(*v) * cx.dn_per_e + cx.black_level_dn;
            let code = math::round(dn.clamp(0.0, f32::from(cx.max_dn))) as u32;
            let mut inl = 0.0;
            for (b, error) in errors.iter().enumerate() {
                inl += if code >> b & 1 != 0 { *error } else { 0.0 };
            }
            *v = A::add(*v, A::signal(inl * e_per_dn));
        }
    }
}
