//! Rows of merged and companded codes, for the vector units of this machine: the numbers are those of
//! [`Merge::linear`] and [`Companding::code`], which are the definition.
//!
//! Everything is done in f64 on whole numbers below 2^53, where sums and products are exact and a
//! quotient rounds down to the right number: it is further from the next one than its rounding.

use camrig_sensor_core::hdr::{Companding, Hand, Line, Merge};
use camrig_vector::vectorised;

/// Pixels in a step. Neighbours are alike, so that most steps need one capture and one line.
const STEP: usize = 64;

/// Parts of 1 in weights and gains.
const ONE: f64 = 256.0;

/// The linear signal of a row from the codes of its captures.
#[vectorised]
pub fn merge(merge: &Merge, captures: &[&[u16]], out: &mut [u32]) {
    let mut first = 0;
    for out in out.chunks_mut(STEP) {
        let codes = |capture: usize| &captures[capture][first..][..out.len()];
        let level = |capture: usize, to: &mut [f64; STEP]| {
            let level = merge.levels()[capture];
            let (black, gain) = (f64::from(level.black_dn), f64::from(level.gain));
            for (to, &code) in to.iter_mut().zip(codes(capture)) {
                *to = (((f64::from(code) - black) * gain + ONE / 2.0) / ONE).floor();
            }
        };
        // The last capture that all pixels have reached; those after it are mixed in where some
        // have.
        let reached = |hand: &Hand| {
            codes(hand.decide.into()).iter().fold(u16::MAX, |a, &b| a.min(b)) >= hand.high_dn
        };
        let first_capture = merge.hands().iter().rposition(reached).map_or(0, |k| k + 1);
        let mut merged = [0.0; STEP];
        level(first_capture, &mut merged);
        for (k, hand) in merge.hands().iter().enumerate().skip(first_capture) {
            let deciding = codes(hand.decide.into());
            if deciding.iter().fold(0, |a, &b| a.max(b)) <= hand.low_dn {
                continue;
            }
            let mut next = [0.0; STEP];
            level(k + 1, &mut next);
            let ramp = f64::from(hand.high_dn - hand.low_dn);
            let pixels = merged.iter_mut().zip(&next).zip(deciding);
            for ((merged, next), &code) in pixels {
                let above = f64::from(code.clamp(hand.low_dn, hand.high_dn) - hand.low_dn);
                let weight = (above * ONE / ramp).floor();
                *merged = ((*merged * (ONE - weight) + next * weight + ONE / 2.0) / ONE).floor();
            }
        }
        if let Some(flicker) = merge.flicker() {
            let mut lamp = [0.0; STEP];
            level(flicker.capture.into(), &mut lamp);
            let margin = f64::from(flicker.margin_dn);
            for (merged, lamp) in merged.iter_mut().zip(lamp) {
                *merged = if lamp > *merged + margin { lamp } else { *merged };
            }
        }
        let (pedestal, max) = (f64::from(merge.pedestal_dn()), f64::from(merge.max_dn()));
        for (out, merged) in out.iter_mut().zip(merged) {
            *out = (merged + pedestal).clamp(0.0, max) as i32 as u32;
        }
        first += out.len();
    }
}

/// The codes of linear signals. A step of pixels gets them line by line of the curve, from the lowest
/// that one of them is on: each line up to its end and beyond, where the next ones replace them.
#[vectorised]
pub fn compand(curve: &Companding, linear: &[u32], out: &mut [u16]) {
    let subtracted = i64::from(curve.subtract_dn);
    let max = f64::from((1u32 << u32::from(curve.bits).min(16)) - 1);
    for (out, linear) in out.chunks_mut(STEP).zip(linear.chunks(STEP)) {
        let smallest = linear.iter().fold(u32::MAX, |a, &b| a.min(b));
        let largest = linear.iter().fold(0, |a, &b| a.max(b));
        let mut start = i64::from(smallest) - subtracted;
        while start <= i64::from(largest) - subtracted {
            let Line { from, rise, run, end } = curve.curve.line_at(start);
            if rise >= 1 << 28 || from.abs() >= 1 << 52 {
                out.iter_mut().zip(linear).for_each(|(out, &linear)| *out = curve.code(linear));
                break;
            }
            let is_shift = run.count_ones() == 1;
            let [from, rise, run] = [from, rise, run].map(|v| v as f64);
            let (subtracted, pedestal) = (subtracted as f64, f64::from(curve.pedestal_dn));
            let first = (start + i64::from(curve.subtract_dn)) as f64;
            // A power of two has an exact inverse, and a product takes a quarter of a quotient's
            // time.
            let inverse = 1.0 / run;
            let above = |linear: u32| from + (f64::from(linear as i32) - subtracted) * rise;
            let code = |quotient: f64| (quotient.floor() + pedestal).clamp(0.0, max) as i32 as u16;
            let is_on = |linear: u32| f64::from(linear as i32) >= first;
            let pixels = out.iter_mut().zip(linear);
            match is_shift {
                true => pixels.for_each(|(out, &linear)| {
                    *out = if is_on(linear) { code(above(linear) * inverse) } else { *out };
                }),
                false => pixels.for_each(|(out, &linear)| {
                    *out = if is_on(linear) { code(above(linear) / run) } else { *out };
                }),
            }
            start = end;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_sensor_core::hdr::{Curve, Flicker, Level, Rounding};

    /// Codes of every size, in ramps and at random, through merges of 2 to 4 captures with gains to
    /// the largest: each pixel is that of the definition.
    #[test]
    fn rows_are_the_definition_pixel_by_pixel() {
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 33) as u32
        };
        for captures in 2..=4usize {
            for trial in 0..40u32 {
                let level = |gain| Level { black_dn: (gain % 300) as u16, gain };
                let gains: Vec<u32> =
                    (0..captures as u32).map(|c| 256 << (random() % 5 * c)).collect();
                let levels: Vec<Level> =
                    gains.iter().map(|&g| level(g + random() % 200)).collect();
                let hands: Vec<Hand> = (1..captures)
                    .map(|k| {
                        let low_dn = (random() % 60_000) as u16;
                        let high_dn = low_dn + 1 + (random() % 5000) as u16;
                        Hand { decide: (random() as usize % k) as u8, low_dn, high_dn }
                    })
                    .collect();
                let bits = [16, 20, 24][trial as usize % 3];
                let mut merge = Merge::new(&levels, &hands, bits, random() % 1000).unwrap();
                if trial % 4 == 0 {
                    let flicker = Flicker { capture: 1, margin_dn: random() % 5000 };
                    merge = merge.with_flicker(flicker).unwrap();
                }
                let width = 1000;
                let rows: Vec<Vec<u16>> = (0..captures)
                    .map(|c| {
                        let start = random() % 65_536;
                        let code = |x: u32| match trial % 2 {
                            0 => ((start + x * (3 + c as u32)) % 65_536) as u16,
                            _ => random() as u16,
                        };
                        (0..width).map(code).collect()
                    })
                    .collect();
                let rows: Vec<&[u16]> = rows.iter().map(Vec::as_slice).collect();
                let mut linear = vec![0; width as usize];
                super::merge(&merge, &rows, &mut linear);
                for (x, &linear) in linear.iter().enumerate() {
                    let codes: Vec<u16> = rows.iter().map(|row| row[x]).collect();
                    assert_eq!(linear, merge.linear(&codes), "{codes:?} of {merge:?}");
                }
                let knees = [(500, 500.0), (11_500, 671.875), (65_536, 4049.125)];
                let rounding = [Rounding::Floor, Rounding::Nearest][trial as usize % 2];
                let curve = Curve::new(&knees, rounding).unwrap();
                let subtract_dn = random() % 2 * 64;
                let curve = Companding { curve, bits: 12, subtract_dn, pedestal_dn: 3 };
                let mut codes = vec![0; linear.len()];
                compand(&curve, &linear, &mut codes);
                for (&linear, &code) in linear.iter().zip(&codes) {
                    assert_eq!(code, curve.code(linear), "{linear}");
                }
            }
        }
    }
}
