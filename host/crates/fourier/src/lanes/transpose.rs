//! Rows of lanes into columns.

use super::real::Real;
use super::real::{LANES, Lanes};

/// Exchanges rows and columns of sixteen by sixteen values, by four perfect shuffles.
#[inline(always)]
pub fn transpose<T: Real>(from: &[Lanes<T>], to: &mut [Lanes<T>]) {
    let (mut a, mut b) = ([Lanes::ZERO; LANES], [Lanes::ZERO; LANES]);
    shuffle(from, &mut a);
    shuffle(&a, &mut b);
    shuffle(&b, &mut a);
    shuffle(&a, to);
}

/// Row r of the first half and its counterpart in the second become, value by value in turn, rows
/// 2r and 2r + 1.
#[inline(always)]
fn shuffle<T: Real>(from: &[Lanes<T>], to: &mut [Lanes<T>]) {
    let (from, to) = (&from[..LANES], &mut to[..LANES]);
    for r in 0..LANES / 2 {
        let (a, b) = (from[r].0, from[r + LANES / 2].0);
        for i in 0..LANES / 2 {
            to[2 * r].0[2 * i] = a[i];
            to[2 * r].0[2 * i + 1] = b[i];
            to[2 * r + 1].0[2 * i] = a[i + LANES / 2];
            to[2 * r + 1].0[2 * i + 1] = b[i + LANES / 2];
        }
    }
}
