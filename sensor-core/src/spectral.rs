//! Rows of spectral irradiance in block floating point: the input of a sensor.
//!
//! A band of a row holds one 16-bit mantissa per pixel and one exponent for each [`GROUP`] pixels:
//! irradiance = mantissa x 2^exponent, W m⁻² nm⁻¹, mean over the pixel's photosensitive area. The
//! largest mantissa of a group uses all 16 bits, so the rounding error is at most 2⁻¹⁷ of the
//! group's largest value (for shot-noise limited pixels of similar brightness, about 1 % of their
//! own noise or less). The same rows are used in memory, in files and on a rig's link, so results
//! do not depend on where a sensor runs.

use crate::math;

/// Pixels that share an exponent.
pub const GROUP: usize = 16;

/// One band of a row of irradiance: mantissa x 2^exponent, W m⁻² nm⁻¹.
#[derive(Clone, Copy, Debug)]
pub struct BandRow<'a> {
    /// One exponent per group of pixels.
    pub exponents: &'a [i8],
    /// One mantissa per pixel.
    pub mantissas: &'a [u16],
}

impl<'a> BandRow<'a> {
    /// Exponents and mantissas group by group; the last group, if it has fewer pixels, stands in
    /// `padded` with zeros behind them.
    #[inline(always)]
    pub fn groups(
        self,
        padded: &'a mut [u16; GROUP],
    ) -> impl Iterator<Item = (i8, &'a [u16; GROUP])> {
        let (whole, rest) = self.mantissas.as_chunks::<GROUP>();
        padded.iter_mut().zip(rest).for_each(|(p, m)| *p = *m);
        let last = (!rest.is_empty()).then_some(&*padded);
        self.exponents.iter().copied().zip(whole.iter().chain(last))
    }
}

/// Number of groups in a row of `width` pixels.
pub const fn groups(width: usize) -> usize {
    width.div_ceil(GROUP)
}

/// The exponent of a group with this largest value.
#[inline(always)]
fn exponent_for(largest: f32) -> i8 {
    // So that the largest mantissa lies in 2^15..2^16.
    let floor_log2 = (largest.to_bits() >> 23) as i32 - 127;
    (floor_log2 - 15).clamp(-126, 111) as i8
}

/// 2^exponent for -126..=127.
#[inline(always)]
pub(crate) fn power_of_two(exponent: i32) -> f32 {
    f32::from_bits(((exponent.clamp(-126, 127) + 127) as u32) << 23)
}

/// Encodes non-negative values (W m⁻² nm⁻¹) of one band of a row. `exponents` holds [`groups`] of
/// the row's length, `mantissas` its length. Values that are not finite and positive become 0;
/// values below 2⁻¹²⁶ are lost.
#[inline(always)]
pub fn encode(values: &[f32], exponents: &mut [i8], mantissas: &mut [u16]) {
    let groups = values.chunks(GROUP).zip(mantissas.chunks_mut(GROUP)).zip(exponents);
    for ((values, mantissas), exponent) in groups {
        let positive = |v: f32| if v > 0.0 && v < f32::MAX { v } else { 0.0 };
        let largest = values.iter().fold(0.0, |a: f32, &v| if positive(v) > a { v } else { a });
        let mut e = exponent_for(largest);
        // A mantissa that would round up to 2^16 needs the next exponent.
        if largest * power_of_two(-i32::from(e)) >= 65_535.5 {
            e += 1;
        }
        let unit = power_of_two(-i32::from(e));
        for (m, &v) in mantissas.iter_mut().zip(values) {
            *m = math::round(positive(v) * unit) as u16;
        }
        *exponent = e;
    }
}

/// Decodes one band of a row into irradiance, W m⁻² nm⁻¹.
pub fn decode(row: BandRow<'_>, values: &mut [f32]) {
    let groups = values.chunks_mut(GROUP).zip(row.mantissas.chunks(GROUP)).zip(row.exponents);
    for ((values, mantissas), &e) in groups {
        let unit = power_of_two(i32::from(e));
        for (v, &m) in values.iter_mut().zip(mantissas) {
            *v = f32::from(m) * unit;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_trip_is_within_half_a_unit_of_the_largest() {
        let mut seed = 1u32;
        let mut next = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 8) as f32 / 16_777_216.0
        };
        for scale in [1e-30f32, 1e-6, 0.999_999_9, 1.0, 3e4] {
            let values: [f32; 40] = core::array::from_fn(|_| next() * next() * scale);
            let (mut e, mut m, mut back) = ([0; 3], [0; 40], [0.0; 40]);
            encode(&values, &mut e, &mut m);
            decode(BandRow { exponents: &e, mantissas: &m }, &mut back);
            for (v, b) in values.chunks(GROUP).zip(back.chunks(GROUP)) {
                let largest = v.iter().fold(0.0f32, |a, &b| a.max(b));
                for (v, b) in v.iter().zip(b) {
                    assert!((v - b).abs() <= largest * 2f32.powi(-16), "{v} {b}");
                }
            }
        }
    }

    #[test]
    fn rounding_up_to_the_next_power_of_two_keeps_the_value() {
        let (mut e, mut m, mut back) = ([0], [0], [0.0]);
        encode(&[0.999_999_9], &mut e, &mut m);
        decode(BandRow { exponents: &e, mantissas: &m }, &mut back);
        assert_eq!(back, [1.0]);
    }

    #[test]
    fn what_is_no_irradiance_becomes_zero() {
        let (mut e, mut m) = ([0], [7; 4]);
        encode(&[f32::NAN, -1.0, 0.0, f32::INFINITY], &mut e, &mut m);
        assert_eq!(m, [0; 4]);
    }
}
