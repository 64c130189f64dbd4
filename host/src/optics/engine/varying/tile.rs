//! One tile and one kernel through their transforms, in vector registers.

use super::super::super::fft::{Complex, Fft, LANES, Lanes, Split, registers};
use super::Tiling;
use crate::Plane;
use bytemuck::{cast_slice, cast_slice_mut};
use pulp::{Simd, WithSimd, bytemuck};

/// The spectrum of a kernel: per sixteen vertical frequencies, all horizontal ones.
pub struct Spectrum(Split);

/// Buffers of one worker.
pub struct Scratch {
    cells: Split,
    cells_spare: Split,
    pixels: Split,
    pixels_spare: Split,
    halves: Vec<Halves>,
    /// Of every output, sixteen vertical frequencies at a time.
    sums: Vec<Split>,
    /// Of every output, per sixteen vertical frequencies, the pixel columns of the result.
    results: Vec<Split>,
}

/// An input, half transformed: per sixteen vertical frequencies (the lanes), its columns.
struct Halves {
    /// Weighted by 1−v.
    upper: Split,
    /// Weighted by v.
    lower: Split,
}

pub struct Plan {
    pub tiling: Tiling,
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
    /// Plans a tiling.
    pub fn new(tiling: &Tiling) -> Self {
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

    /// Buffers for so many inputs and outputs.
    pub fn scratch(&self, inputs: usize, outputs: usize) -> Scratch {
        let zeros = Split::zeros;
        let half = || zeros(self.batches * self.columns);
        Scratch {
            cells: zeros(self.cells.length()),
            cells_spare: zeros(self.cells.length()),
            pixels: zeros(self.pixels.length()),
            pixels_spare: zeros(self.pixels.length()),
            halves: (0..inputs).map(|_| Halves { upper: half(), lower: half() }).collect(),
            sums: vec![zeros(self.pixels.length()); outputs],
            results: vec![zeros(self.batches * self.stride()); outputs],
        }
    }

    /// Room for the spectrum of a kernel.
    pub fn empty_spectrum(&self) -> Spectrum {
        Spectrum(Split::zeros(self.batches * self.tiling.length))
    }

    /// Bytes of the spectrum of a kernel.
    pub fn spectrum_bytes(&self) -> usize {
        2 * self.batches * self.tiling.length * size_of::<Lanes>()
    }
}

/// Transforms a kernel, scaled so that forward and backward transforms together scale by 1.
pub struct TransformKernel<'a> {
    pub plan: &'a Plan,
    pub kernel: &'a [f32],
    pub scratch: &'a mut Scratch,
    pub spectrum: &'a mut Spectrum,
}

impl WithSimd for TransformKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { plan, kernel, scratch, spectrum: Spectrum(spectrum) } = self;
        let (n, size) = (plan.tiling.length, plan.tiling.kernel);
        let scale = 1.0 / (n * n) as f32;
        let Scratch { cells, cells_spare, halves, .. } = scratch;
        let Halves { upper, lower } = &mut halves[0];
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

/// Adds the light of the tile at cell column `first` to every output from its column `place` on.
pub struct BlurTile<'a> {
    pub plan: &'a Plan,
    /// One strip per input.
    pub sources: &'a [Plane<f32>],
    pub first: usize,
    /// At every corner the spectra of all outputs, and of each those of all inputs.
    pub corners: [&'a [Spectrum]; 4],
    pub scratch: &'a mut Scratch,
    pub out: &'a mut [Plane<f32>],
    pub place: usize,
}

impl WithSimd for BlurTile<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { plan, sources, first, corners, scratch, out, place } = self;
        let (tile, n, reach) = (plan.tiling.tile, plan.tiling.length, plan.tiling.reach());
        let Scratch { cells, cells_spare, pixels, pixels_spare, halves, sums, results } = scratch;
        for (source, Halves { upper, lower }) in sources.iter().zip(&mut *halves) {
            let wide = tile.min(source.width - first);
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
        }
        for b in 0..plan.batches {
            sums.iter_mut().for_each(Split::clear);
            let (at, part) = (b * plan.columns..b * plan.columns + tile, b * n..(b + 1) * n);
            for (input, Halves { upper, lower }) in halves.iter().enumerate() {
                for (corner, spectra) in corners.iter().enumerate() {
                    let half = if corner < 2 { upper } else { lower };
                    let weights = if corner % 2 == 0 { &plan.left } else { &plan.right };
                    weigh(simd, &half.re[at.clone()], weights, &mut cells.re);
                    weigh(simd, &half.im[at.clone()], weights, &mut cells.im);
                    plan.cells.forward(cells, cells_spare);
                    for (sum, spectra) in sums.iter_mut().zip(spectra.chunks_exact(sources.len())) {
                        let Spectrum(kernel) = &spectra[input];
                        let (re, im) = (&kernel.re[part.clone()], &kernel.im[part.clone()]);
                        fold_product(simd, cells, re, im, sum);
                    }
                }
            }
            let target = b * plan.stride();
            for (sum, result) in sums.iter_mut().zip(&mut *results) {
                plan.pixels.backward(sum, pixels_spare);
                result.re[target..target + sum.re.len()].copy_from_slice(&sum.re);
                result.im[target..target + sum.im.len()].copy_from_slice(&sum.im);
            }
        }
        for (result, out) in results.iter().zip(out) {
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
