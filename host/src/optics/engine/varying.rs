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

use super::super::fft::{Complex, Fft, LANES, Lanes, Split, good_length, registers};
use crate::{Plane, Result};
use bytemuck::{cast_slice, cast_slice_mut};
use pulp::{Arch, Simd, WithSimd, bytemuck};
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

/// Blurs bands of one tiling; keeps its plans and buffers from band to band.
pub struct Blurrer {
    plan: Plan,
    spectra: Vec<Spectrum>,
}

impl Blurrer {
    /// Plans a tiling.
    pub fn new(tiling: &Tiling) -> Self {
        Self { plan: Plan::new(tiling), spectra: Vec::new() }
    }

    /// The tiling it was planned for.
    pub fn tiling(&self) -> &Tiling {
        &self.plan.tiling
    }

    /// Blurs the cell grid that `rows(first, count)` gives with one kernel per node, and samples it at
    /// the pixel centres of the frame, which starts `corner` (left, top) pixels into the padded grid.
    ///
    /// # Errors
    /// Those of `rows`.
    pub fn blur(
        &mut self,
        rows: &(dyn Fn(usize, usize) -> Result<Plane<f32>> + Sync),
        kernels: &Kernels,
        corner: (usize, usize),
        (width, height): (usize, usize),
    ) -> Result<Plane<f32>> {
        let Self { plan, spectra } = self;
        let tiling = plan.tiling;
        let n2 = kernels.size * kernels.size;
        spectra.resize_with(kernels.data.len() / n2, || plan.empty_spectrum());
        spectra.par_iter_mut().zip(kernels.data.par_chunks_exact(n2)).for_each_init(
            || plan.scratch(),
            |scratch, (spectrum, kernel)| {
                Arch::new().dispatch(TransformKernel { plan, kernel, scratch, spectrum });
            },
        );
        let (plan, spectra) = (&*plan, &*spectra);
        let mut plane = Plane::filled(width, height, 0.0);
        // A few rows of tiles at a time bound the memory; they are added in order.
        let group = 2 * rayon::current_num_threads();
        let shift = tiling.before / tiling.oversample;
        for start in (0..tiling.down()).step_by(group) {
            let end = tiling.down().min(start + group);
            let strips: Vec<Result<Plane<f32>>> = (start..end)
                .into_par_iter()
                .map_init(|| plan.scratch(), |scratch, j| plan.strip(j, rows, spectra, scratch))
                .collect();
            for (j, strip) in (start..end).zip(strips) {
                let strip = strip?;
                for q in 0..strip.height {
                    // Padded pixel row of strip row q, then the frame's.
                    let row = j * tiling.tile / tiling.oversample + q;
                    let Some(y) = row.checked_sub(shift + corner.1).filter(|&y| y < height) else {
                        continue;
                    };
                    let source = &strip.row(q)[corner.0 + shift..];
                    plane.row_mut(y).iter_mut().zip(source).for_each(|(o, v)| *o += v);
                }
            }
        }
        Ok(plane)
    }
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

    fn empty_spectrum(&self) -> Spectrum {
        Spectrum(Split::zeros(self.batches * self.tiling.length))
    }

    /// The light of row j of tiles, from `before / s` pixels left of and above its corner on.
    fn strip(
        &self,
        j: usize,
        rows: &(dyn Fn(usize, usize) -> Result<Plane<f32>> + Sync),
        spectra: &[Spectrum],
        scratch: &mut Scratch,
    ) -> Result<Plane<f32>> {
        let Tiling { tile, oversample, height, .. } = self.tiling;
        let source = &rows(j * tile, tile.min(height - j * tile))?;
        let (across, reach) = (self.tiling.across(), self.tiling.reach());
        let columns = (across - 1) * tile / oversample + reach;
        let mut out = Plane::filled(columns, reach, 0.0);
        for i in 0..across {
            let corner = |di: usize, dj: usize| &spectra[(j + dj) * (across + 1) + i + di];
            Arch::new().dispatch(BlurTile {
                plan: self,
                source,
                first: i * tile,
                corners: [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)],
                scratch,
                out: &mut out,
                place: i * tile / oversample,
            });
        }
        Ok(out)
    }
}

/// Transforms a kernel, scaled so that forward and backward transforms together scale by 1.
struct TransformKernel<'a> {
    plan: &'a Plan,
    kernel: &'a [f32],
    scratch: &'a mut Scratch,
    spectrum: &'a mut Spectrum,
}

impl WithSimd for TransformKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { plan, kernel, scratch, spectrum: Spectrum(spectrum) } = self;
        let (n, size) = (plan.tiling.length, plan.tiling.kernel);
        let scale = 1.0 / (n * n) as f32;
        let Scratch { cells, cells_spare, upper, lower, .. } = scratch;
        for x in (0..size).step_by(2 * LANES) {
            cells.clear();
            for (y, row) in kernel.chunks_exact(size).enumerate() {
                cells.re[y] = lanes_of(row, x);
                cells.im[y] = lanes_of(row, x + LANES);
            }
            plan.cells.forward(cells, cells_spare);
            split_columns(simd, cells, plan, x, upper, lower);
            // The two halves are neighbouring columns of one kernel.
            for b in 0..plan.batches {
                let from = b * plan.columns + x;
                let to = from + LANES;
                upper.re[to..to + LANES].copy_from_slice(&lower.re[from..to]);
                upper.im[to..to + LANES].copy_from_slice(&lower.im[from..to]);
            }
        }
        let scales = vec![scale; size];
        for b in 0..plan.batches {
            let part = b * plan.columns..b * plan.columns + size;
            weigh(simd, &upper.re[part.clone()], &scales, &mut cells.re);
            weigh(simd, &upper.im[part], &scales, &mut cells.im);
            plan.cells.forward(cells, cells_spare);
            spectrum.re[b * n..(b + 1) * n].copy_from_slice(&cells.re);
            spectrum.im[b * n..(b + 1) * n].copy_from_slice(&cells.im);
        }
    }
}

/// Adds the light of the tile at cell column `first` to `out` from its column `place` on.
struct BlurTile<'a> {
    plan: &'a Plan,
    source: &'a Plane<f32>,
    first: usize,
    corners: [&'a Spectrum; 4],
    scratch: &'a mut Scratch,
    out: &'a mut Plane<f32>,
    place: usize,
}

impl WithSimd for BlurTile<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { plan, source, first, corners, scratch, out, place } = self;
        let (tile, n, reach) = (plan.tiling.tile, plan.tiling.length, plan.tiling.reach());
        let wide = tile.min(source.width - first);
        let Scratch { cells, cells_spare, pixels, pixels_spare, upper, lower, result } = scratch;
        for x in (0..tile).step_by(LANES) {
            for y in 0..source.height {
                cells.im[y] = lanes_of(&source.row(y)[first..first + wide], x);
            }
            cells.im[source.height..].fill(Lanes::ZERO);
            // 1−v weighs the real parts, v the imaginary ones.
            weigh(simd, &cells.im[..source.height], &plan.left, &mut cells.re);
            weigh_in_place(simd, &mut cells.im[..source.height], &plan.right);
            plan.cells.forward(cells, cells_spare);
            split_columns(simd, cells, plan, x, upper, lower);
        }
        for b in 0..plan.batches {
            pixels.clear();
            let at = b * plan.columns..b * plan.columns + tile;
            for (side, half) in [&*upper, &*lower].into_iter().enumerate() {
                for (weights, corner) in [(&plan.left, 2 * side), (&plan.right, 2 * side + 1)] {
                    weigh(simd, &half.re[at.clone()], weights, &mut cells.re);
                    weigh(simd, &half.im[at.clone()], weights, &mut cells.im);
                    plan.cells.forward(cells, cells_spare);
                    let Spectrum(kernel) = corners[corner];
                    let part = b * n..(b + 1) * n;
                    fold_product(simd, cells, &kernel.re[part.clone()], &kernel.im[part], pixels);
                }
            }
            plan.pixels.backward(pixels, pixels_spare);
            let target = b * plan.stride();
            result.re[target..target + pixels.re.len()].copy_from_slice(&pixels.re);
            result.im[target..target + pixels.im.len()].copy_from_slice(&pixels.im);
        }
        for x in (0..reach).step_by(2 * LANES) {
            pixels.clear();
            join_columns(simd, result, plan, x, pixels);
            plan.pixels.backward(pixels, pixels_spare);
            for y in 0..out.height {
                let row = &mut out.row_mut(y)[place + x..place + reach];
                let (re, im) = row.split_at_mut(LANES.min(row.len()));
                re.iter_mut().zip(pixels.re[y].0).for_each(|(o, v)| *o += v);
                im.iter_mut().zip(pixels.im[y].0).for_each(|(o, v)| *o += v);
            }
        }
    }
}

/// Sixteen values from place x on, 0 beyond the end.
#[inline(always)]
fn lanes_of(row: &[f32], x: usize) -> Lanes {
    let mut lanes = Lanes::ZERO;
    match row.get(x..x + LANES) {
        Some(whole) => lanes.0.copy_from_slice(whole),
        None => {
            let rest = row.get(x..).unwrap_or_default();
            lanes.0[..rest.len()].copy_from_slice(rest);
        }
    }
    lanes
}

#[inline(always)]
fn vectors<S: Simd>(lanes: &[Lanes]) -> &[S::f32s] {
    S::as_simd_f32s(cast_slice(lanes)).0
}

#[inline(always)]
fn vectors_mut<S: Simd>(lanes: &mut [Lanes]) -> &mut [S::f32s] {
    S::as_mut_simd_f32s(cast_slice_mut(lanes)).0
}

/// Sixteen elements from place `at` on, rows and columns exchanged.
#[inline(always)]
fn block_at(values: &[Lanes], at: usize) -> [Lanes; LANES] {
    let mut block = [Lanes::ZERO; LANES];
    block.copy_from_slice(&values[at..at + LANES]);
    transpose(block)
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
#[inline(always)]
fn split_columns<S: Simd>(
    simd: S,
    both: &Split,
    plan: &Plan,
    x: usize,
    real: &mut Split,
    imaginary: &mut Split,
) {
    let (n, w) = (both.re.len(), registers::<S>());
    let (re, im) = (vectors::<S>(&both.re), vectors::<S>(&both.im));
    let half = simd.splat_f32s(0.5);
    for b in 0..plan.batches {
        let mut parts = [[Lanes::ZERO; LANES]; 4];
        let [ar, ai, br, bi] = parts.each_mut().map(|p| vectors_mut::<S>(p));
        for i in 0..LANES.min(n / 2 + 1 - b * LANES) {
            let k = b * LANES + i;
            let mirror = if k == 0 { 0 } else { n - k };
            for j in 0..w {
                let (k, m, i) = (k * w + j, mirror * w + j, i * w + j);
                let halved = |v| simd.mul_f32s(half, v);
                ar[i] = halved(simd.add_f32s(re[k], re[m]));
                ai[i] = halved(simd.sub_f32s(im[k], im[m]));
                br[i] = halved(simd.add_f32s(im[k], im[m]));
                bi[i] = halved(simd.sub_f32s(re[m], re[k]));
            }
        }
        let at = b * plan.columns + x..b * plan.columns + x + LANES;
        real.re[at.clone()].copy_from_slice(&transpose(parts[0]));
        real.im[at.clone()].copy_from_slice(&transpose(parts[1]));
        imaginary.re[at.clone()].copy_from_slice(&transpose(parts[2]));
        imaginary.im[at].copy_from_slice(&transpose(parts[3]));
    }
}

/// The inverse of [`split_columns`] for pixel columns x to x + 15 (real part) and x + 16 to x + 31
/// (imaginary part), folding the vertical frequencies onto the pixel grid's.
#[inline(always)]
fn join_columns<S: Simd>(simd: S, result: &Split, plan: &Plan, x: usize, pixels: &mut Split) {
    let (n, count, w) = (plan.tiling.length, pixels.re.len(), registers::<S>());
    let (re, im) = (vectors_mut::<S>(&mut pixels.re), vectors_mut::<S>(&mut pixels.im));
    for b in 0..plan.batches {
        let from = b * plan.stride() + x;
        let blocks = [
            block_at(&result.re, from),
            block_at(&result.im, from),
            block_at(&result.re, from + LANES),
            block_at(&result.im, from + LANES),
        ];
        let [ar, ai, br, bi] = blocks.each_ref().map(|p| vectors::<S>(p));
        for i in 0..LANES.min(n / 2 + 1 - b * LANES) {
            let k = b * LANES + i;
            let place = k % count;
            let mirror = (count - place) % count;
            for j in 0..w {
                let (p, m, i) = (place * w + j, mirror * w + j, i * w + j);
                re[p] = simd.add_f32s(re[p], simd.sub_f32s(ar[i], bi[i]));
                im[p] = simd.add_f32s(im[p], simd.add_f32s(ai[i], br[i]));
                if k > 0 && 2 * k < n {
                    // The negative frequency of a real column is the conjugate.
                    re[m] = simd.add_f32s(re[m], simd.add_f32s(ar[i], bi[i]));
                    im[m] = simd.add_f32s(im[m], simd.sub_f32s(br[i], ai[i]));
                }
            }
        }
    }
}

/// `target[i] = values[i] * weights[i]`, 0 beyond.
#[inline(always)]
fn weigh<S: Simd>(simd: S, values: &[Lanes], weights: &[f32], target: &mut [Lanes]) {
    let w = registers::<S>();
    let (head, tail) = target.split_at_mut(values.len());
    let elements =
        vectors_mut::<S>(head).chunks_exact_mut(w).zip(vectors::<S>(values).chunks_exact(w));
    for ((t, v), &weight) in elements.zip(weights) {
        let weight = simd.splat_f32s(weight);
        t.iter_mut().zip(v).for_each(|(t, &v)| *t = simd.mul_f32s(v, weight));
    }
    tail.fill(Lanes::ZERO);
}

/// `values[i] *= weights[i]`.
#[inline(always)]
fn weigh_in_place<S: Simd>(simd: S, values: &mut [Lanes], weights: &[f32]) {
    let w = registers::<S>();
    for (v, &weight) in vectors_mut::<S>(values).chunks_exact_mut(w).zip(weights) {
        let weight = simd.splat_f32s(weight);
        v.iter_mut().for_each(|v| *v = simd.mul_f32s(*v, weight));
    }
}

/// Adds the product of two spectra to `folded`, frequencies folded onto its length.
#[inline(always)]
fn fold_product<S: Simd>(simd: S, a: &Split, b_re: &[Lanes], b_im: &[Lanes], folded: &mut Split) {
    let (re, im) = (vectors_mut::<S>(&mut folded.re), vectors_mut::<S>(&mut folded.im));
    let n = re.len();
    let parts = |lanes| vectors::<S>(lanes).chunks_exact(n);
    for (((ar, ai), br), bi) in parts(&a.re).zip(parts(&a.im)).zip(parts(b_re)).zip(parts(b_im)) {
        for i in 0..n {
            let (a, b) = (Complex { re: ar[i], im: ai[i] }, Complex { re: br[i], im: bi[i] });
            let sum = Complex { re: re[i], im: im[i] }.add(simd, a.mul(simd, b));
            (re[i], im[i]) = (sum.re, sum.im);
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
            let fast = Blurrer::new(&t).blur(&rows, &kernels, edge, frame).unwrap();
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
