//! The scene's cells, transformed along their rows and laid out for the transforms along columns.

use crate::engine::range::Range as Values;
use crate::engine::sampling::Layout;
use crate::engine::source::Rows;
use camrig_base::{Error, Result};
use camrig_fourier::lanes::{Fft, LANES, Lanes, Real, Split, transpose};
use camrig_vector::vectorised;
use rayon::prelude::*;
use std::ops::Range;

/// Two rows share one complex transform: the first sixteen as real parts, the next as imaginary.
pub const BLOCK: usize = 2 * LANES;
/// Rows requested from the scene at once.
const STRIP: usize = 4 * BLOCK;

/// Sixteen horizontal frequencies of the cell grid that fall on sixteen neighbouring ones of the
/// pixel grid: as they are, or as the mirror image of negative frequencies.
pub struct Alias {
    pub mirrored: bool,
    /// Frequency index of each lane; `None` where there is nothing.
    pub lanes: [Option<usize>; LANES],
}

/// Every [`Alias`] of a grid, in the order of the pixel grid's frequencies.
pub struct Aliases {
    pub all: Vec<Alias>,
    /// For every sixteen frequencies of the pixel grid, those that fall on them.
    pub batches: Vec<Range<usize>>,
}

impl Aliases {
    pub fn new(layout: &Layout, kept: usize) -> Self {
        let pixels = layout.padded_width;
        let outputs = pixels / 2 + 1;
        let (mut all, mut batches) = (Vec::new(), Vec::new());
        for first in (0..outputs).step_by(LANES) {
            let start = all.len();
            all.extend(Alias::of_batch(first, outputs, pixels, kept));
            batches.push(start..all.len());
        }
        Self { all, batches }
    }
}

impl Alias {
    fn of_batch(first: usize, outputs: usize, pixels: usize, kept: usize) -> Vec<Alias> {
        let mut out = Vec::new();
        for m in 0..=kept / pixels {
            for mirrored in [false, true] {
                let lanes = std::array::from_fn(|l| {
                    let j = first + l;
                    let k =
                        if mirrored { (m + 1) * pixels - j.min(pixels) } else { m * pixels + j };
                    (j < outputs && k < kept && !(mirrored && k == 0)).then_some(k)
                });
                if lanes.iter().any(Option::is_some) {
                    out.push(Alias { mirrored, lanes });
                }
            }
        }
        out
    }
}

/// A padded cell grid, transformed along its rows: strip by strip, of each alias by alias the
/// strip's rows. Memory is kept from picture to picture.
pub struct Spectrum<T> {
    re: Vec<Lanes<T>>,
    im: Vec<Lanes<T>>,
}

impl<T> Default for Spectrum<T> {
    fn default() -> Self {
        Self { re: Vec::new(), im: Vec::new() }
    }
}

impl<T: Real> Spectrum<T> {
    /// Transforms the rows of the cells of `layout`, in place of those before; the
    /// range of its values.
    ///
    /// # Errors
    /// Those of the scene, and values that are not finite.
    pub fn fill(&mut self, rows: &Rows<'_>, aliases: &Aliases, layout: &Layout) -> Result<Values> {
        let (across, down) = (layout.cells_across(), layout.cells_down());
        let fft = Fft::<T>::new(across);
        let strip = aliases.all.len() * STRIP;
        let needed = down.div_ceil(STRIP) * strip;
        if self.re.len() < needed {
            self.re.resize(needed, Lanes::<T>::ZERO);
            self.im.resize(needed, Lanes::<T>::ZERO);
        }
        let strips = self.re[..needed]
            .par_chunks_exact_mut(strip)
            .zip(self.im[..needed].par_chunks_exact_mut(strip));
        let ranges = strips.enumerate().map_init(
            || (Split::zeros(across), Split::zeros(across)),
            |(data, scratch), (i, (re, im))| -> Result<Values> {
                let cells = rows(i * STRIP, STRIP.min(down - i * STRIP))?;
                check(&cells.data)?;
                for (block, rows) in cells.data.chunks(BLOCK * across).enumerate() {
                    load_rows(rows, data);
                    fft.forward(data, scratch);
                    store_rows(data, &aliases.all, block * BLOCK, re, im);
                }
                Ok(Values::of(&cells.data))
            },
        );
        Ok(ranges.collect::<Result<Vec<_>>>()?.into_iter().fold(Values::default(), Values::join))
    }

    /// The columns of one of `aliases`, as many rows as `data` has.
    pub fn columns(&self, alias: usize, aliases: &Aliases, data: &mut Split<T>) {
        for (from, to) in [(&self.re, &mut data.re), (&self.im, &mut data.im)] {
            for (i, rows) in to.chunks_mut(STRIP).enumerate() {
                let first = (i * aliases.all.len() + alias) * STRIP;
                rows.copy_from_slice(&from[first..first + rows.len()]);
            }
        }
    }
}

fn check(cells: &[f32]) -> Result<()> {
    if cells.iter().fold(true, |all, v| all & v.is_finite()) {
        return Ok(());
    }
    let bad = cells.iter().find(|v| !v.is_finite()).copied().unwrap_or(f32::NAN);
    Err(Error::input(format!("the scene holds the radiance {bad}"))
        .help("radiance must be finite; look for NaN or infinite values in the scene"))
}

/// Up to 32 real rows into sixteen complex sequences.
#[vectorised]
fn load_rows<T: Real>(rows: &[f32], data: &mut Split<T>) {
    let across = data.re.len();
    let row = |r: usize| rows.get(r * across..(r + 1) * across).unwrap_or_default();
    for (part, first) in [(&mut data.re, 0), (&mut data.im, LANES)] {
        for (i, columns) in part.chunks_mut(LANES).enumerate() {
            let block: [Lanes<T>; LANES] =
                std::array::from_fn(|r| Lanes::of_row(row(first + r), i * LANES));
            let mut turned = [Lanes::<T>::ZERO; LANES];
            transpose(&block, &mut turned);
            columns.copy_from_slice(&turned[..columns.len()]);
        }
    }
}

/// Takes the spectra of both rows of each sequence apart, and stores every alias of them as rows
/// from `first` on of a strip.
#[vectorised]
fn store_rows<T: Real>(
    data: &Split<T>,
    aliases: &[Alias],
    first: usize,
    re: &mut [Lanes<T>],
    im: &mut [Lanes<T>],
) {
    let half = T::of(0.5);
    let n = data.re.len();
    for (i, alias) in aliases.iter().enumerate() {
        let mut parts = [[Lanes::<T>::ZERO; LANES]; 4];
        for (l, k) in alias.lanes.iter().enumerate() {
            let Some(k) = *k else { continue };
            let mirror = if k == 0 { 0 } else { n - k };
            let (zr, zi) = (data.re[k], data.im[k]);
            let (mr, mi) = (data.re[mirror], data.im[mirror]);
            parts[0][l] = zr.plus(mr).times(half);
            parts[1][l] = zi.minus(mi).times(half);
            parts[2][l] = zi.plus(mi).times(half);
            parts[3][l] = mr.minus(zr).times(half);
        }
        let at = i * STRIP + first;
        let (upper, lower) = (at..at + LANES, at + LANES..at + BLOCK);
        transpose(&parts[0], &mut re[upper.clone()]);
        transpose(&parts[1], &mut im[upper]);
        transpose(&parts[2], &mut re[lower.clone()]);
        transpose(&parts[3], &mut im[lower]);
    }
}
