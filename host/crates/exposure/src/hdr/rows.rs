//! Merged and companded codes, fast: the numbers are those of [`Merge::linear`] and
//! [`Companding::code`], which are the definition.
//!
//! A merge is for the vector units of this machine, in f64 on whole numbers below 2^53, where sums
//! and products are exact and a quotient rounds down to the right number: it is further from the
//! next one than its rounding.

use camrig_sensor_core::hdr::{Companding, Hand, Line, Merge};
use camrig_vector::vectorised;
use std::iter::successors;

/// Pixels in a step. Neighbours are alike, so that most steps need one capture or two.
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

/// Linear numbers of a cell of [`Compander`]. A trade: 64 KiB for curves of 24 bits, and few cells
/// with a knee in them.
const CELL: usize = 256;

/// A curve whose lines are found by a table instead of a search.
pub struct Compander {
    curve: Companding,
    lines: Vec<Line>,
    /// The line on which each cell of linear signals begins, up to the last line.
    of_cell: Vec<u8>,
}

impl Compander {
    pub fn new(curve: &Companding) -> Self {
        let next = |line: &Line| (line.end < i64::MAX).then(|| curve.curve.line_at(line.end));
        let lines: Vec<Line> = successors(Some(curve.curve.line_at(0)), next).collect();
        let mut of_cell = Vec::new();
        for (line, number) in lines[..lines.len() - 1].iter().zip(0..) {
            let end = line.end as usize + curve.subtract_dn as usize;
            of_cell.resize(end.div_ceil(CELL), number);
        }
        Self { curve: curve.clone(), lines, of_cell }
    }

    /// Bits of a code.
    pub fn bits(&self) -> u32 {
        self.curve.bits.into()
    }

    /// The code of a linear signal, DN.
    #[inline(always)]
    pub fn code(&self, linear: u32) -> u16 {
        let x = i64::from(linear) - i64::from(self.curve.subtract_dn);
        let of_cell = self.of_cell.get(linear as usize / CELL);
        let mut line = of_cell.map_or(self.lines.len() - 1, |&line| line.into());
        while x >= self.lines[line].end {
            line += 1;
        }
        self.curve.sent(self.lines[line].code(x))
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
            }
        }
    }

    /// Curves with knees in a cell of their own, several in one cell, and up to the ends of 24
    /// bits: a code is that of the definition beside each knee, at the ends of the signal and in
    /// between.
    #[test]
    fn codes_by_the_table_are_the_definition() {
        let several: Vec<(u32, f64)> = (1..64)
            .map(|i| (5 * i + i * i, f64::from(4 * i)))
            .chain([(1 << 24, 4095.0)])
            .collect();
        let curves: [&[(u32, f64)]; 4] = [
            &[(500, 500.0), (11_500, 671.875), (65_536, 4049.125)],
            &[(256, 256.0), (1 << 12, 512.0), (1 << 24, 4096.0)],
            &[(1 << 24, f64::from(1 << 24))],
            &several,
        ];
        for (knees, rounding) in curves.iter().flat_map(|&knees| {
            [Rounding::Floor, Rounding::Nearest].map(|rounding| (knees, rounding))
        }) {
            for (subtract_dn, pedestal_dn) in [(0, 0), (64, 3), ((1 << 24) - 1, 200)] {
                let curve = Curve::new(knees, rounding).unwrap();
                let curve = Companding { curve, bits: 12, subtract_dn, pedestal_dn };
                let compander = Compander::new(&curve);
                let knees = knees.iter().map(|&(x, _)| x + subtract_dn);
                let beside = knees.flat_map(|x| x.saturating_sub(300)..x + 300);
                let others = (0..1 << 25).step_by(4093);
                for linear in beside.chain(others).chain([0, (1 << 25) - 1]) {
                    assert_eq!(compander.code(linear), curve.code(linear), "{linear} {curve:?}");
                }
            }
        }
    }
}
