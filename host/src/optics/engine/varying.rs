//! Blur that varies over the field, in the Fourier domain, tile by tile.
//!
//! The cell grid is cut into square tiles; a kernel sits at every tile corner (*node*). A cell at
//! fraction (t, v) of its tile scatters its light with the bilinear blend of the tile's four kernels,
//!
//! out(p) = Σ_c in(c)·[(1−v)(1−t)·K00 + (1−v)t·K01 + v(1−t)·K10 + v·t·K11](p − c),
//!
//! which conserves energy, since the blend belongs to the *source* cell. So each tile costs four
//! forward transforms of weighted input (real, so two share one complex transform along y), four
//! products and one inverse, at pixel size: sampling every s-th cell is folding the spectrum.
//! (Denis et al. 2015, "Fast approximations of shift-variant blur", IJCV 115, 253.)
//!
//! Tiles of one row of tiles are summed in order, then rows of tiles in order, so the result does not
//! depend on the number of threads.

use super::super::fft::{Fft, LANES, Lanes, Split, good_length, lanes_are_vectors};
use crate::{Plane, Result};
use multiversion::multiversion;
use rayon::prelude::*;

/// Kernels at the corners of square tiles.
///
/// Entry (i, j) of a kernel is the fraction of a cell's light that a pixel receives whose centre lies
/// i − [`Tiling::before`] (rows) and j − `before` (columns) cells from the cell, counted as
/// s·(pixel index) − (cell index).
pub struct Kernels {
    /// Entries per side.
    pub size: usize,
    /// Row-major by node, each `size * size`, row-major.
    pub data: Vec<f32>,
}

/// How a cell grid is cut into tiles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tiling {
    /// Cells per pixel and direction, s.
    pub oversample: usize,
    /// Cells of the padded grid.
    pub width: usize,
    /// Cells of the padded grid.
    pub height: usize,
    /// Cells per tile side, a multiple of s.
    pub tile: usize,
    /// Kernel entries per side.
    pub kernel: usize,
    /// Kernel index of offset 0; a multiple of s.
    pub before: usize,
    /// Length of the transforms, a multiple of s.
    length: usize,
}

impl Tiling {
    /// The tiling that costs least with tiles of at most `largest_tile` cells.
    pub fn new(
        oversample: usize,
        (width, height): (usize, usize),
        kernel: usize,
        before: usize,
        largest_tile: usize,
    ) -> Self {
        let s = oversample;
        let most = largest_tile.max(s).min(width.max(height) + s);
        let candidate = |tile: usize| {
            let length = s * good_length((tile + kernel - 1).div_ceil(s));
            // Transforms per tile, sixteen at once, times n·log n; see `Tile::run`.
            let batches = tile.div_ceil(LANES) + 4 * (length / 2 + 1).div_ceil(LANES);
            let tiles = width.div_ceil(tile) * height.div_ceil(tile);
            let cost = (tiles * batches * length) as f64 * (length as f64).log2();
            (cost, tile, length)
        };
        let (_, tile, length) = (1..=most / s)
            .map(|n| candidate(n * s))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or_else(|| candidate(s));
        Self { oversample, width, height, tile, kernel, before, length }
    }

    /// Tiles across.
    pub fn across(&self) -> usize {
        self.width.div_ceil(self.tile)
    }

    /// Tiles down.
    pub fn down(&self) -> usize {
        self.height.div_ceil(self.tile)
    }

    /// Place of node (i across, j down) in cells from the top left corner of the padded grid.
    pub fn node(&self, i: usize, j: usize) -> (f64, f64) {
        ((i * self.tile) as f64, (j * self.tile) as f64)
    }

    /// Pixels that one tile's light reaches, per side.
    fn reach(&self) -> usize {
        (self.tile + self.kernel - 2) / self.oversample + 1
    }

    /// Fraction of the way across its tile of the i-th cell: its centre.
    pub fn fraction(&self, i: usize) -> f32 {
        ((i as f64 + 0.5) / self.tile as f64) as f32
    }
}

/// Blurs the cell grid that `rows(first, count)` gives, and samples it at the pixel centres of the
/// frame, which starts `left`, `top` pixels into the padded grid.
///
/// # Errors
/// Those of `rows`.
pub fn blur(
    rows: &(dyn Fn(usize, usize) -> Result<Plane<f32>> + Sync),
    tiling: &Tiling,
    kernels: &Kernels,
    (left, top): (usize, usize),
    (width, height): (usize, usize),
) -> Result<Plane<f32>> {
    let plan = Plan::new(tiling);
    let n2 = kernels.size * kernels.size;
    let spectra: Vec<Spectrum> = kernels
        .data
        .par_chunks_exact(n2)
        .map_init(|| plan.scratch(), |scratch, kernel| plan.spectrum(kernel, scratch))
        .collect();
    let nodes = tiling.across() + 1;
    // Pixel columns that any tile reaches, from `before / s` left of the padded grid.
    let columns = ((tiling.across() - 1) * tiling.tile) / tiling.oversample + tiling.reach();
    let strip = |j: usize| -> Result<Plane<f32>> {
        let first = j * tiling.tile;
        let source = rows(first, tiling.tile.min(tiling.height - first))?;
        let mut out = Plane::filled(columns, tiling.reach(), 0.0);
        let mut scratch = plan.scratch();
        for i in 0..tiling.across() {
            let corner = |di: usize, dj: usize| &spectra[(j + dj) * nodes + i + di];
            let corners = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
            let place = i * tiling.tile / tiling.oversample;
            plan.tile(&source, i * tiling.tile, corners, &mut scratch, &mut out, place);
        }
        Ok(out)
    };
    let mut plane = Plane::filled(width, height, 0.0);
    // A few rows of tiles at a time bound the memory; they are added in order.
    let group = 2 * rayon::current_num_threads();
    let shift = tiling.before / tiling.oversample;
    for start in (0..tiling.down()).step_by(group) {
        let end = tiling.down().min(start + group);
        let strips: Vec<Result<Plane<f32>>> = (start..end).into_par_iter().map(strip).collect();
        for (j, strip) in (start..end).zip(strips) {
            let strip = strip?;
            for q in 0..strip.height {
                // Padded pixel row of strip row q, then the frame's.
                let row = j * tiling.tile / tiling.oversample + q;
                let Some(y) = row.checked_sub(shift + top).filter(|&y| y < height) else {
                    continue;
                };
                let source = &strip.row(q)[left + shift..];
                for (o, v) in plane.row_mut(y).iter_mut().zip(source) {
                    *o += v;
                }
            }
        }
    }
    Ok(plane)
}

/// The spectrum of a kernel: per sixteen vertical frequencies, all horizontal ones.
struct Spectrum(Split);

/// Buffers of one worker.
struct Scratch {
    cells: Split,
    cells_spare: Split,
    pixels: Split,
    pixels_spare: Split,
    /// Per sixteen vertical frequencies (the lanes), the columns of the input weighted by 1−v.
    upper: Split,
    /// The same, weighted by v.
    lower: Split,
    /// Per sixteen vertical frequencies, the pixel columns of the result.
    result: Split,
}

struct Plan {
    tiling: Tiling,
    cells: Fft,
    pixels: Fft,
    /// Vertical frequencies in batches of sixteen.
    batches: usize,
    /// Columns of input or kernel, in whole pairs of batches.
    columns: usize,
    /// Weight 1−t of every column of a tile.
    left: Vec<f32>,
    /// Weight t.
    right: Vec<f32>,
}

impl Plan {
    fn new(tiling: &Tiling) -> Self {
        let right: Vec<f32> = (0..tiling.tile).map(|i| tiling.fraction(i)).collect();
        Self {
            tiling: *tiling,
            cells: Fft::new(tiling.length),
            pixels: Fft::new(tiling.length / tiling.oversample),
            batches: (tiling.length / 2 + 1).div_ceil(LANES),
            columns: tiling.tile.max(tiling.kernel).next_multiple_of(2 * LANES),
            left: right.iter().map(|t| 1.0 - t).collect(),
            right,
        }
    }

    /// Pixels across a transform's result, in whole pairs of batches.
    fn stride(&self) -> usize {
        self.pixels.length().next_multiple_of(2 * LANES)
    }

    fn scratch(&self) -> Scratch {
        let zeros = Split::zeros;
        Scratch {
            cells: zeros(self.cells.length()),
            cells_spare: zeros(self.cells.length()),
            pixels: zeros(self.pixels.length()),
            pixels_spare: zeros(self.pixels.length()),
            upper: zeros(self.batches * self.columns),
            lower: zeros(self.batches * self.columns),
            result: zeros(self.batches * self.stride()),
        }
    }

    /// Transforms a kernel, scaled so that forward and backward transforms together scale by 1.
    fn spectrum(&self, kernel: &[f32], scratch: &mut Scratch) -> Spectrum {
        let (n, size) = (self.tiling.length, self.tiling.kernel);
        let scale = 1.0 / (n * n) as f32;
        for x in (0..size).step_by(2 * LANES) {
            scratch.cells.clear();
            for (y, row) in kernel.chunks_exact(size).enumerate() {
                scratch.cells.re[y] = lanes_of(row, x).times(scale);
                scratch.cells.im[y] = lanes_of(row, x + LANES).times(scale);
            }
            self.cells.forward(&mut scratch.cells, &mut scratch.cells_spare);
            let Scratch { cells, upper, lower, .. } = scratch;
            split_columns(cells, self.batches, self.columns, x, upper, lower);
            // The two halves are neighbouring columns of one kernel.
            for b in 0..self.batches {
                let from = b * self.columns + x;
                let to = from + LANES;
                upper.re[to..to + LANES].copy_from_slice(&lower.re[from..to]);
                upper.im[to..to + LANES].copy_from_slice(&lower.im[from..to]);
            }
        }
        let mut data = Split::zeros(self.batches * n);
        for b in 0..self.batches {
            let from = b * self.columns;
            let Scratch { cells, cells_spare, upper, .. } = scratch;
            cells.clear();
            cells.re[..size].copy_from_slice(&upper.re[from..from + size]);
            cells.im[..size].copy_from_slice(&upper.im[from..from + size]);
            self.cells.forward(cells, cells_spare);
            data.re[b * n..(b + 1) * n].copy_from_slice(&cells.re);
            data.im[b * n..(b + 1) * n].copy_from_slice(&cells.im);
        }
        Spectrum(data)
    }

    /// Adds the light of the tile at cell column `first` to `out` from its column `place` on.
    fn tile(
        &self,
        source: &Plane<f32>,
        first: usize,
        corners: [&Spectrum; 4],
        scratch: &mut Scratch,
        out: &mut Plane<f32>,
        place: usize,
    ) {
        let (tile, n) = (self.tiling.tile, self.tiling.length);
        let wide = tile.min(source.width - first);
        let Scratch { cells, cells_spare, pixels, pixels_spare, upper, lower, result } = scratch;
        for x in (0..tile).step_by(LANES) {
            cells.clear();
            for y in 0..source.height {
                let value = lanes_of(&source.row(y)[first..first + wide], x);
                let v = self.right[y];
                cells.re[y] = value.times(1.0 - v);
                cells.im[y] = value.times(v);
            }
            self.cells.forward(cells, cells_spare);
            split_columns(cells, self.batches, self.columns, x, upper, lower);
        }
        for b in 0..self.batches {
            pixels.clear();
            let at = b * self.columns..b * self.columns + tile;
            for (side, half) in [&*upper, &*lower].into_iter().enumerate() {
                for (weights, corner) in [(&self.left, 2 * side), (&self.right, 2 * side + 1)] {
                    weigh(&half.re[at.clone()], weights, &mut cells.re);
                    weigh(&half.im[at.clone()], weights, &mut cells.im);
                    self.cells.forward(cells, cells_spare);
                    let Spectrum(kernel) = corners[corner];
                    let part = b * n..(b + 1) * n;
                    fold_product(cells, &kernel.re[part.clone()], &kernel.im[part], pixels);
                }
            }
            self.pixels.backward(pixels, pixels_spare);
            let target = b * self.stride();
            result.re[target..target + pixels.re.len()].copy_from_slice(&pixels.re);
            result.im[target..target + pixels.im.len()].copy_from_slice(&pixels.im);
        }
        for x in (0..self.tiling.reach()).step_by(2 * LANES) {
            pixels.clear();
            join_columns(result, self.stride(), x, n, pixels);
            self.pixels.backward(pixels, pixels_spare);
            let width = self.tiling.reach() - x;
            for y in 0..out.height {
                let row = &mut out.row_mut(y)[place + x..];
                let both = pixels.re[y].0.into_iter().chain(pixels.im[y].0);
                row.iter_mut().zip(both).take(width).for_each(|(o, v)| *o += v);
            }
        }
    }
}

/// Sixteen values from place x on, 0 beyond the end.
#[inline(always)]
fn lanes_of(row: &[f32], x: usize) -> Lanes {
    match row.get(x..x + LANES) {
        Some(whole) => {
            let mut lanes = Lanes::ZERO;
            lanes.0.copy_from_slice(whole);
            lanes
        }
        None => Lanes(std::array::from_fn(|l| row.get(x + l).copied().unwrap_or(0.0))),
    }
}

/// Exchanges rows and columns of sixteen by sixteen values, by four perfect shuffles.
#[inline(always)]
fn transpose(mut rows: [Lanes; LANES]) -> [Lanes; LANES] {
    for _ in 0..4 {
        let mut next = [Lanes::ZERO; LANES];
        for r in 0..LANES / 2 {
            let (a, b) = (rows[r].0, rows[r + LANES / 2].0);
            for i in 0..LANES / 2 {
                next[2 * r].0[2 * i] = a[i];
                next[2 * r].0[2 * i + 1] = b[i];
                next[2 * r + 1].0[2 * i] = a[i + LANES / 2];
                next[2 * r + 1].0[2 * i + 1] = b[i + LANES / 2];
            }
        }
        rows = next;
    }
    rows
}

/// Takes the transforms of two real inputs apart that shared one complex transform along y, and turns
/// them: from sixteen columns (lanes) to sixteen vertical frequencies (lanes) by columns x to x + 15.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx+avx2"))]
fn split_columns(
    both: &Split,
    batches: usize,
    columns: usize,
    x: usize,
    real: &mut Split,
    imaginary: &mut Split,
) {
    let n = both.re.len();
    for b in 0..batches {
        let mut parts = [[Lanes::ZERO; LANES]; 4];
        for i in 0..LANES.min(n / 2 + 1 - b * LANES) {
            lanes_are_vectors();
            let k = b * LANES + i;
            let mirror = if k == 0 { 0 } else { n - k };
            let (zr, zi, mr, mi) = (both.re[k], both.im[k], both.re[mirror], both.im[mirror]);
            parts[0][i] = zr.plus(mr).times(0.5);
            parts[1][i] = zi.minus(mi).times(0.5);
            parts[2][i] = zi.plus(mi).times(0.5);
            parts[3][i] = mr.minus(zr).times(0.5);
        }
        let at = b * columns + x..b * columns + x + LANES;
        real.re[at.clone()].copy_from_slice(&transpose(parts[0]));
        real.im[at.clone()].copy_from_slice(&transpose(parts[1]));
        imaginary.re[at.clone()].copy_from_slice(&transpose(parts[2]));
        imaginary.im[at].copy_from_slice(&transpose(parts[3]));
    }
}

/// The inverse of [`split_columns`] for pixel columns x to x + 15 (real part) and x + 16 to x + 31
/// (imaginary part), folding the n vertical frequencies onto the pixel grid's.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx+avx2"))]
fn join_columns(result: &Split, stride: usize, x: usize, n: usize, pixels: &mut Split) {
    let count = pixels.re.len();
    for b in 0..(n / 2 + 1).div_ceil(LANES) {
        let part = |values: &[Lanes], x: usize| {
            let mut block = [Lanes::ZERO; LANES];
            block.copy_from_slice(&values[b * stride + x..b * stride + x + LANES]);
            transpose(block)
        };
        let (ar, ai) = (part(&result.re, x), part(&result.im, x));
        let (br, bi) = (part(&result.re, x + LANES), part(&result.im, x + LANES));
        for i in 0..LANES.min(n / 2 + 1 - b * LANES) {
            lanes_are_vectors();
            let k = b * LANES + i;
            let place = k % count;
            pixels.re[place] = pixels.re[place].plus(ar[i].minus(bi[i]));
            pixels.im[place] = pixels.im[place].plus(ai[i].plus(br[i]));
            if k > 0 && 2 * k < n {
                // The negative frequency of a real column is the conjugate.
                let place = (count - place) % count;
                pixels.re[place] = pixels.re[place].plus(ar[i].plus(bi[i]));
                pixels.im[place] = pixels.im[place].plus(br[i].minus(ai[i]));
            }
        }
    }
}

/// `target[i] = values[i] * weights[i]`, 0 beyond.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx+avx2"))]
fn weigh(values: &[Lanes], weights: &[f32], target: &mut [Lanes]) {
    let (head, tail) = target.split_at_mut(values.len());
    for ((t, v), &w) in head.iter_mut().zip(values).zip(weights) {
        lanes_are_vectors();
        *t = v.times(w);
    }
    tail.fill(Lanes::ZERO);
}

/// Adds the product of two spectra to `folded`, frequencies folded onto its length.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx+avx2"))]
fn fold_product(a: &Split, b_re: &[Lanes], b_im: &[Lanes], folded: &mut Split) {
    let count = folded.re.len();
    for start in (0..a.re.len()).step_by(count) {
        for i in 0..count {
            lanes_are_vectors();
            let (ar, ai, br, bi) =
                (a.re[start + i], a.im[start + i], b_re[start + i], b_im[start + i]);
            folded.re[i] = folded.re[i].plus(ar.product(br).minus(ai.product(bi)));
            folded.im[i] = folded.im[i].plus(ar.product(bi).plus(ai.product(br)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(seed: usize) -> f32 {
        ((seed.wrapping_mul(2_654_435_761) >> 9) % 4096) as f32 / 4096.0
    }

    /// The defining sum in f64.
    fn direct(
        source: &Plane<f32>,
        t: &Tiling,
        kernels: &Kernels,
        (left, top): (usize, usize),
        (width, height): (usize, usize),
    ) -> Plane<f64> {
        let (size, nodes) = (kernels.size, t.across() + 1);
        let mut out = Plane::filled(width, height, 0.0);
        for cy in 0..source.height {
            for cx in 0..source.width {
                let (i, j) = (cx / t.tile, cy / t.tile);
                let x = ((cx % t.tile) as f64 + 0.5) / t.tile as f64;
                let y = ((cy % t.tile) as f64 + 0.5) / t.tile as f64;
                let corners = [
                    ((1.0 - y) * (1.0 - x), j * nodes + i),
                    ((1.0 - y) * x, j * nodes + i + 1),
                    (y * (1.0 - x), (j + 1) * nodes + i),
                    (y * x, (j + 1) * nodes + i + 1),
                ];
                for ky in 0..size {
                    for kx in 0..size {
                        let (py, px) = (cy + ky, cx + kx);
                        let s = t.oversample;
                        if py % s != t.before % s || px % s != t.before % s {
                            continue;
                        }
                        let place =
                            |p: usize, edge: usize| (p / s).checked_sub(t.before / s + edge);
                        let (Some(qy), Some(qx)) = (place(py, top), place(px, left)) else {
                            continue;
                        };
                        if qy < height && qx < width {
                            let k: f64 = corners
                                .iter()
                                .map(|&(w, n)| {
                                    w * f64::from(kernels.data[(n * size + ky) * size + kx])
                                })
                                .sum();
                            out.data[qy * width + qx] += k * f64::from(source.at(cx, cy));
                        }
                    }
                }
            }
        }
        out
    }

    #[test]
    fn equals_the_defining_sum() {
        for (s, size, before, tile, (w, h)) in [
            (1, 5, 2, 12, (40, 33)),
            (2, 8, 4, 14, (44, 30)),
            (3, 11, 3, 21, (60, 45)),
            (1, 35, 17, 40, (64, 70)),
        ] {
            let t = Tiling::new(s, (w, h), size, before, tile);
            let nodes = (t.across() + 1) * (t.down() + 1);
            let kernels = Kernels {
                size,
                data: (0..nodes * size * size).map(|i| noise(i) / (size * size) as f32).collect(),
            };
            let source = Plane::from_fn(w, h, |x, y| noise(x * 71 + y * 1009 + 5));
            let rows = |first: usize, count: usize| {
                Ok(Plane {
                    width: w,
                    height: count,
                    data: source.data[first * w..(first + count) * w].to_vec(),
                })
            };
            let edge = (size / s / 2, size / s / 2);
            let frame = (w / s - 2 * edge.0, h / s - 2 * edge.1);
            let fast = blur(&rows, &t, &kernels, edge, frame).unwrap();
            let exact = direct(&source, &t, &kernels, edge, frame);
            let peak = exact.data.iter().fold(0.0f64, |m, v| m.max(*v));
            let worst = fast.data.iter().zip(&exact.data).map(|(a, b)| (f64::from(*a) - b).abs());
            let worst = worst.fold(0.0, f64::max) / peak;
            println!("s {s} kernel {size} tile {}: {worst:.2e}", t.tile);
            // f32 arithmetic over log2(n) stages: a few 2⁻²⁴.
            assert!(worst < 1e-6, "s {s}, kernel {size}: {worst}");
        }
    }

    #[test]
    fn transposing_exchanges_rows_and_columns() {
        let rows = std::array::from_fn(|r| Lanes(std::array::from_fn(|c| (r * LANES + c) as f32)));
        let turned = transpose(rows);
        for r in 0..LANES {
            for c in 0..LANES {
                assert_eq!(turned[r].0[c], rows[c].0[r]);
            }
        }
    }
}
