//! Rows of spectral irradiance in block floating point: the input of a sensor.
//!
//! A band of a row holds one 16-bit mantissa per pixel and one exponent for each [`GROUP`] pixels:
//! irradiance = mantissa x 2^exponent, W m⁻² nm⁻¹, mean over the pixel's photosensitive area. The
//! largest mantissa of a group uses all 16 bits, so the rounding error is at most 2⁻¹⁷ of the
//! group's largest value (for shot-noise limited pixels of similar brightness, about 1 % of their
//! own noise or less). The same rows are used in memory, in files and on a rig's link, so results
//! do not depend on where a sensor runs.
//!
//! # Groups of high dynamic range
//! Beside a lamp the largest value of a group would leave the others nothing of 16 bits. Where a
//! value is below 2⁻¹² of the largest, each pixel has an exponent of its own: a mantissa is then a
//! floating-point number, x in its upper 5 bits and f in its lower 11, that stands for f where x is
//! 0, else for (2048 + f) 2^(x − 1), and the group's exponent e, 112 to 127, for the unit 2^(8 (e −
//! 112) − 96). Each value is then right to 2⁻¹², down to 2⁻²³ (138 dB) of the largest at least.

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

/// First exponent of groups of high dynamic range: no others are above 111.
const WIDE: i8 = 112;
/// Exponent of their unit at [`WIDE`], and from one to the next.
const WIDE_FROM: i32 = -96;
const WIDE_STEP: i32 = 8;
/// Largest exponent of values in such groups: bits of the largest number of units, less one.
const WIDE_OCTAVES: i32 = 41;
/// Bits of f.
const FRACTION_BITS: u32 = 11;
/// A group of which a value is below this share of the largest is one of high dynamic range. There
/// the rounding of other groups would be 3 % of the value, and that of such a group is half of what
/// it is for the largest value, 2⁻¹².
const WIDE_BELOW: f32 = 1.0 / 4096.0;

/// Whether an exponent, as on the link, is that of a group of high dynamic range.
pub const fn is_wide(exponent: i8) -> bool {
    exponent >= WIDE
}

/// Exponent of the unit of a group of high dynamic range.
#[inline(always)]
fn wide_unit(exponent: i8) -> i32 {
    WIDE_FROM + WIDE_STEP * (i32::from(exponent) - i32::from(WIDE))
}

/// A pixel of a group of high dynamic range as one of a plain group: its mantissa and exponent.
#[inline(always)]
pub(crate) fn plain(exponent: i8, mantissa: u16) -> (u16, i32) {
    let (x, f) = (mantissa >> FRACTION_BITS, mantissa & ((1 << FRACTION_BITS) - 1));
    let unit = wide_unit(exponent);
    if x == 0 { (f, unit) } else { (f | 1 << FRACTION_BITS, unit + i32::from(x) - 1) }
}

/// The exponent of a group of high dynamic range with this largest value, if it has one.
#[inline(always)]
fn wide_exponent_for(largest: f32) -> Option<i8> {
    let floor_log2 = (largest.to_bits() >> 23) as i32 - 127;
    let steps = (floor_log2 - WIDE_OCTAVES - WIDE_FROM + WIDE_STEP - 1).div_euclid(WIDE_STEP);
    (0..=i32::from(i8::MAX - WIDE)).contains(&steps).then_some(WIDE + steps as i8)
}

/// Mantissa for so many units: the nearest.
#[inline(always)]
fn wide_mantissa(units: f32) -> u16 {
    let floor_log2 = (units.to_bits() >> 23) as i32 - 127;
    let shift = (floor_log2 - FRACTION_BITS as i32).max(0);
    // A number that rounds up to the next power of two is its code, too.
    let integer = math::round(units * power_of_two(-shift)) as u32;
    let code = integer + ((shift as u32) << FRACTION_BITS);
    code.min(u16::MAX.into()) as u16
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
        let small = largest * WIDE_BELOW;
        let is_wide = values.iter().fold(false, |any, &v| any | (v > 0.0 && v < small));
        if is_wide && let Some(e) = wide_exponent_for(largest) {
            let per_unit = power_of_two(-wide_unit(e));
            for (m, &v) in mantissas.iter_mut().zip(values) {
                *m = wide_mantissa(positive(v) * per_unit);
            }
            *exponent = e;
            continue;
        }
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
        if is_wide(e) {
            for (v, &m) in values.iter_mut().zip(mantissas) {
                let (integer, exponent) = plain(e, m);
                *v = f32::from(integer) * power_of_two(exponent);
            }
            continue;
        }
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
            let values: [f32; 40] = core::array::from_fn(|_| (0.1 + next() * next()) * scale);
            let (mut e, mut m, mut back) = ([0; 3], [0; 40], [0.0; 40]);
            encode(&values, &mut e, &mut m);
            decode(BandRow { exponents: &e, mantissas: &m }, &mut back);
            for (v, b) in values.chunks(GROUP).zip(back.chunks(GROUP)) {
                let largest = v.iter().fold(0.0f32, |a, &b| a.max(b));
                for (v, b) in v.iter().zip(b) {
                    assert!((v - b).abs() <= largest * 2f32.powi(16).recip(), "{v} {b}");
                }
            }
        }
    }

    /// A lamp of 10⁴ to 10⁷ times its surroundings: both are right to 2⁻¹² of themselves.
    #[test]
    fn what_lies_beside_a_lamp_keeps_its_value() {
        for lamp in [4e4f32, 1e5, 1e6, 8e6] {
            for scale in [1e-17f32, 3.3e-9, 1.0, 7e5, 1e10] {
                let values: [f32; 16] = core::array::from_fn(|i| match i {
                    3 => lamp * scale,
                    7 => 0.0,
                    i => (1.0 + i as f32 / 7.0) * scale,
                });
                let (mut e, mut m, mut back) = ([0; 1], [0; 16], [0.0; 16]);
                encode(&values, &mut e, &mut m);
                decode(BandRow { exponents: &e, mantissas: &m }, &mut back);
                for (v, b) in values.iter().zip(back) {
                    assert!((v - b).abs() <= v * 2f32.powi(12).recip(), "{lamp} {scale}: {v} {b}");
                }
            }
        }
        // Without one, or with nothing at all beside it, a group has one exponent.
        for dark in [0.0, 1.0] {
            let (mut e, mut m) = ([0; 1], [0; 16]);
            encode(&[4000.0, dark], &mut e, &mut m);
            assert!(!is_wide(e[0]));
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
