//! Companding: fewer codes for bright light, along straight lines between knees.

use super::HdrError;
use serde::{Deserialize, Serialize};

/// Largest number of knees after (0, 0).
pub const MAX_KNEES: usize = 64;

/// The end of the longest linear signal, 24 bits.
const END: i64 = 1 << 24;

/// Codes of knees are multiples of 1 over this.
const PARTS: i64 = 256;

/// How a code becomes a whole number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Rounding {
    /// The whole number at or below it.
    #[default]
    Floor,
    /// The nearest whole number, the upper one from a half on.
    Nearest,
}

/// A knee: a linear number, and its code in 1/256.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Knee {
    x: i64,
    y: i64,
}

/// A straight line of a curve: the code of x is ⌊(from + x rise)/run⌋.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line {
    /// Its value at 0, times `run`.
    pub from: i64,
    /// Its rise over a `run`.
    pub rise: i64,
    /// Linear numbers of a run.
    pub run: i64,
    /// The first number of the next line, beyond every number for the last.
    pub end: i64,
}

impl Line {
    /// The code of a linear number that is on it.
    #[inline(always)]
    pub fn code(&self, x: i64) -> i64 {
        let above = self.from + x * self.rise;
        // Most lines are as wide as a power of two: a shift is a division that rounds down.
        match self.run & (self.run - 1) {
            0 => above >> self.run.trailing_zeros(),
            _ => above.div_euclid(self.run),
        }
    }
}

/// A curve of straight lines from linear numbers to codes.
///
/// Between the knees (x_i, y_i) and (x_j, y_j) the code of x is ⌊(y_i Δx + (x − x_i) Δy)/Δx⌋, with
/// half a code added before where it is rounded. A knee is the first number of the line above it;
/// the first line goes on below 0, the last beyond its end. Receivers undo it with the lowest
/// number of a code, x_i + ⌈(y − y_i) Δx/Δy⌉, as AMD's Vitis `hdr_decompand` and TI's
/// `Rfe_PwlConfig` do.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Curve {
    knees: heapless::Vec<Knee, MAX_KNEES>,
    rounding: Rounding,
}

impl Curve {
    /// A curve from (0, 0) through these knees: linear numbers and their codes, multiples of 1/256.
    ///
    /// # Errors
    /// [`HdrError::Knees`], [`HdrError::Knee`].
    pub fn new(knees: &[(u32, f64)], rounding: Rounding) -> Result<Self, HdrError> {
        if knees.len() > MAX_KNEES {
            return Err(HdrError::Knees);
        }
        let parts = |y: f64| y * PARTS as f64;
        if let Some(i) = knees.iter().position(|&(_, y)| (parts(y) as i64) as f64 != parts(y)) {
            return Err(HdrError::Knee(i));
        }
        let knee = |&(x, y): &(u32, f64)| Knee { x: i64::from(x), y: parts(y) as i64 };
        let curve = Self { knees: knees.iter().map(knee).collect(), rounding };
        curve.check().map(|()| curve)
    }

    /// Checks a curve that came from elsewhere, as [`Self::new`] does.
    ///
    /// # Errors
    /// [`HdrError::Knees`], [`HdrError::Knee`].
    pub fn check(&self) -> Result<(), HdrError> {
        if self.knees.is_empty() {
            return Err(HdrError::Knees);
        }
        let mut before = Knee { x: 0, y: 0 };
        for (i, knee) in self.knees.iter().enumerate() {
            let rises = knee.x > before.x && knee.y > before.y && knee.x <= END;
            if !rises || knee.y - before.y > (knee.x - before.x) * PARTS {
                return Err(HdrError::Knee(i));
            }
            before = *knee;
        }
        Ok(())
    }

    /// The line whose knees' `key` encloses a value: its lower and its upper knee.
    #[inline(always)]
    fn line(&self, value: i64, key: impl Fn(&Knee) -> i64) -> [Knee; 2] {
        let last = self.knees.len().saturating_sub(1);
        let inner = self.knees.get(..last).unwrap_or_default();
        let i = inner.partition_point(|knee| key(knee) <= value);
        let zero = Knee { x: 0, y: 0 };
        let at = |i: usize| self.knees.get(i).copied().unwrap_or(zero);
        [i.checked_sub(1).map_or(zero, at), at(i)]
    }

    /// The code of a linear number.
    #[inline(always)]
    pub fn code(&self, x: i64) -> i64 {
        self.line_at(x).code(x)
    }

    /// The line that a linear number is on.
    #[inline(always)]
    pub fn line_at(&self, x: i64) -> Line {
        let [a, b] = self.line(x, |knee| knee.x);
        let (dx, rise) = (b.x - a.x, b.y - a.y);
        let half = match self.rounding {
            Rounding::Floor => 0,
            Rounding::Nearest => PARTS / 2 * dx,
        };
        let is_last = self.knees.last() == Some(&b);
        let end = if is_last { i64::MAX } else { b.x };
        Line { from: a.y * dx - a.x * rise + half, rise, run: PARTS * dx, end }
    }

    /// The lowest linear number of a code, where codes are the whole numbers below.
    pub fn lowest(&self, code: i64) -> i64 {
        let y = code * PARTS;
        let [a, b] = self.line(y, |knee| knee.y);
        a.x - ((a.y - y) * (b.x - a.x)).div_euclid(b.y - a.y)
    }

    /// Linear numbers per code at a linear number.
    pub fn step(&self, x: f64) -> f64 {
        let [a, b] = self.line(libm::floor(x) as i64, |knee| knee.x);
        (b.x - a.x) as f64 / ((b.y - a.y) as f64 / PARTS as f64)
    }
}

/// What a sensor sends of its linear signal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Companding {
    /// The curve.
    pub curve: Curve,
    /// Bits of a code, at most 16.
    pub bits: u8,
    /// Taken off the linear signal before the curve, linear DN.
    pub subtract_dn: u32,
    /// Added to the code.
    pub pedestal_dn: u16,
}

impl Companding {
    /// Checks bits, curve and what is taken off.
    ///
    /// # Errors
    /// [`HdrError::Bits`], [`HdrError::Linear`], and those of [`Curve::check`].
    pub fn check(&self) -> Result<(), HdrError> {
        if ![10, 12, 14, 16].contains(&self.bits) {
            return Err(HdrError::Bits);
        }
        if i64::from(self.subtract_dn) >= END {
            return Err(HdrError::Linear);
        }
        self.curve.check()
    }

    /// The code of a linear signal, DN: that of the curve with its pedestal, within its bits.
    #[inline(always)]
    pub fn code(&self, linear: u32) -> u16 {
        self.sent(self.curve.code(i64::from(linear) - i64::from(self.subtract_dn)))
    }

    /// What is sent of a code of the curve: that with the pedestal, within its bits.
    #[inline(always)]
    pub fn sent(&self, code: i64) -> u16 {
        let max = (1 << u32::from(self.bits).min(16)) - 1;
        (code + i64::from(self.pedestal_dn)).clamp(0, max) as u16
    }

    /// The lowest linear signal of a code, as receivers decompand it, DN.
    pub fn lowest(&self, code: u16) -> i64 {
        let of_curve = i64::from(code) - i64::from(self.pedestal_dn);
        self.curve.lowest(of_curve) + i64::from(self.subtract_dn)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_is_that_of_the_line_above_a_knee() {
        let curve = Curve::new(&[(4, 4.0), (20, 8.0), (84, 12.0)], Rounding::Floor).unwrap();
        let codes: [i64; 12] = [-2, 0, 3, 4, 7, 8, 19, 20, 35, 36, 83, 100].map(|x| curve.code(x));
        assert_eq!(codes, [-2, 0, 3, 4, 4, 5, 7, 8, 8, 9, 11, 13]);
        assert_eq!([3.5, 4.0, 20.0].map(|x| curve.step(x)), [1.0, 4.0, 16.0]);
    }

    #[test]
    fn the_lowest_number_of_a_code_is_the_first_that_has_it() {
        let knees = [(500, 500.0), (11_500, 671.875), (65_536, 4049.125)];
        let curve = Curve::new(&knees, Rounding::Floor).unwrap();
        for code in 1..4049 {
            let lowest = curve.lowest(code);
            assert_eq!(curve.code(lowest), code);
            assert!(curve.code(lowest - 1) < code);
        }
    }

    #[test]
    fn rounding_moves_by_half_a_code() {
        let knees = [(512, 512.0), (1024, 576.0)];
        let floor = Curve::new(&knees, Rounding::Floor).unwrap();
        let nearest = Curve::new(&knees, Rounding::Nearest).unwrap();
        for x in 512..1020 {
            assert_eq!(nearest.code(x), floor.code(x + 4), "{x}");
        }
    }

    #[test]
    fn what_is_no_curve_is_refused() {
        let new = |knees: &[(u32, f64)]| Curve::new(knees, Rounding::Floor);
        assert_eq!(new(&[]), Err(HdrError::Knees));
        assert_eq!(new(&[(1, 1.0); MAX_KNEES + 1]), Err(HdrError::Knees));
        assert_eq!(new(&[(4, 5.0)]), Err(HdrError::Knee(0)), "faster than 1:1");
        assert_eq!(new(&[(4, 4.0), (4, 5.0)]), Err(HdrError::Knee(1)));
        assert_eq!(new(&[(4, 4.0), (9, 4.0)]), Err(HdrError::Knee(1)));
        assert_eq!(new(&[(4, 0.001)]), Err(HdrError::Knee(0)), "no multiple of 1/256");
        assert_eq!(new(&[(4, f64::NAN)]), Err(HdrError::Knee(0)));
        assert_eq!(new(&[(1 << 24, 1.0), (1 << 25, 2.0)]), Err(HdrError::Knee(1)), "25 bits");
    }
}
