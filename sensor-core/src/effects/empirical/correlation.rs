//! Temporal noise that follows itself along rows or down columns.
//!
//! Either taps: Σ t_k w(x − k) of white normal numbers w, Σ t² = 1; its correlation is that of the
//! taps. Or a length L, whose correlation is e^(−h/L) without any memory from pixel to pixel: each
//! line of each frame is cut into cells of a length ℓ of its own, from a random phase on, and has
//! a normal number in each cell. Two pixels h apart are in one cell with the chance (1 − h/ℓ)₊,
//! and ∫(1 − h/ℓ)₊ (ℓ/L²) e^(−ℓ/L) dℓ = e^(−h/L): with ℓ of the law Gamma(2, L) the covariance
//! is exact. Three of these over √3 make the law of differences nearly normal.

use super::Context;
use crate::arith::{Arith, BLOCK, Block};
use crate::effects::context::{normal, unit};
use crate::effects::words;
use crate::math;
use rand_core::Rng;

/// Taps, at most.
const TAPS: usize = 4;
/// Cuts of a line into cells that are added.
const CUTS: u32 = 3;
/// Words of the table before taps or a length: whether down columns, whether a length.
const HEAD: usize = 2;

/// Whether words are a table of this shape.
pub(super) fn is_one(table: &[f32]) -> bool {
    match table.split_first_chunk::<HEAD>() {
        Some(([_, 1.0], [length])) => *length > 0.0,
        Some(([_, 0.0], taps)) => {
            (1..=TAPS).contains(&taps.len()) && taps.iter().any(|t| *t != 0.0)
        }
        _ => false,
    }
}

/// v += A c(x, y, frame), c of variance 1.
#[inline(always)]
pub(super) fn add<A: Arith>(
    cx: &Context<'_>,
    row: &mut [Block<A::Signal>],
    amount: f32,
    table: &[f32],
) {
    let Some(([down, length], values)) = table.split_first_chunk::<HEAD>() else { return };
    if *length != 0.0 {
        let length = values.first().copied().unwrap_or(1.0);
        let amount = amount * math::rsqrt(CUTS as f32);
        for part in 0..CUTS {
            match *down == 0.0 {
                true => cells_along::<A>(cx, row, amount, length, part),
                false => cells_down::<A>(cx, row, amount, length, part),
            }
        }
        return;
    }
    let power = values.iter().fold(0.0, |sum, t| sum + t * t);
    let mut taps = [0.0; TAPS];
    for (tap, value) in taps.iter_mut().zip(values) {
        *tap = amount * value * math::rsqrt(power);
    }
    match *down == 0.0 {
        true => taps_along::<A>(cx, row, taps),
        false => taps_down::<A>(cx, row, taps),
    }
}

fn taps_along<A: Arith>(cx: &Context<'_>, row: &mut [Block<A::Signal>], taps: [f32; TAPS]) {
    /// Pixels before the first that reach it.
    const BEFORE: usize = TAPS - 1;
    let mut lanes = cx.per_pixel_and_frame(0);
    // The block before the first is one that no pixel shows.
    let mut white = [0.0; BLOCK + BEFORE];
    for n in 0..=row.len() {
        // The last of the block before come first.
        white.rotate_left(BLOCK);
        let fresh = white.iter_mut().skip(BEFORE);
        fresh.zip(A::normals(&mut lanes)).for_each(|(w, z)| *w = A::number(z));
        let Some(block) = n.checked_sub(1).and_then(|n| row.get_mut(n)) else { continue };
        for (v, near) in block.iter_mut().zip(white.windows(TAPS)) {
            let sum = near.iter().rev().zip(taps).fold(0.0, |sum, (w, tap)| sum + tap * w);
            *v = A::add(*v, A::signal(sum));
        }
    }
}

fn taps_down<A: Arith>(cx: &Context<'_>, row: &mut [Block<A::Signal>], taps: [f32; TAPS]) {
    for (back, tap) in (0..).zip(taps).filter(|(_, tap)| *tap != 0.0) {
        let mut lanes = cx.per_pixel_and_frame_of(0, cx.row.wrapping_sub(back));
        let tap = A::signal(tap);
        for block in row.iter_mut() {
            for (v, z) in block.iter_mut().zip(A::normals(&mut lanes)) {
                *v = A::add(*v, A::scale(tap, z));
            }
        }
    }
}

/// A length of the law Gamma(2, L) from two words.
#[inline(always)]
fn cell_length(length: f32, a: u32, b: u32) -> f32 {
    -length * (math::ln(unit(a)) + math::ln(unit(b)))
}

/// Cells along the row: one cut for all of it.
fn cells_along<A: Arith>(
    cx: &Context<'_>,
    row: &mut [Block<A::Signal>],
    amount: f32,
    length: f32,
    part: u32,
) {
    let mut rng = cx.per_row_and_frame(part, cx.row);
    let per_pixel = 1.0 / cell_length(length, rng.next_u32(), rng.next_u32());
    let phase = unit(rng.next_u32());
    let (mut cell, mut value) = (0, A::signal(amount * normal(&mut rng)));
    for (b, block) in row.iter_mut().enumerate() {
        for (v, x) in block.iter_mut().zip(b * BLOCK..) {
            let now = (x as f32 * per_pixel + phase) as u32;
            if now != cell {
                (cell, value) = (now, A::signal(amount * normal(&mut rng)));
            }
            *v = A::add(*v, value);
        }
    }
}

/// Cells down the columns: each column has its own cut.
fn cells_down<A: Arith>(
    cx: &Context<'_>,
    row: &mut [Block<A::Signal>],
    amount: f32,
    length: f32,
    part: u32,
) {
    let mut lanes = cx.per_column_and_frame(part);
    for (b, block) in row.iter_mut().enumerate() {
        let cuts = words(&mut lanes).into_iter().zip(words(&mut lanes)).zip(words(&mut lanes));
        for ((v, ((first, second), phase)), x) in block.iter_mut().zip(cuts).zip(b * BLOCK..) {
            let place = cx.row as f32 / cell_length(length, first, second) + unit(phase);
            let z = cx.normal_of_cell(part, place as u32, x as u32);
            *v = A::add(*v, A::signal(amount * z));
        }
    }
}
