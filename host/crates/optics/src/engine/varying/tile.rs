//! One tile and one kernel through their transforms, in vector registers.

use super::Tiling;
use camrig_base::Plane;
use camrig_fourier::lanes::{
    Fft, KernelPart, LANES, Lanes, Products, Real, Split, Weighted, transpose,
};
use pulp::{Simd, WithSimd};

/// The spectrum of a kernel: per sixteen vertical frequencies, all horizontal ones.
pub struct Spectrum<T>(Vec<Split<T>>);

/// Buffers of one worker.
pub struct Scratch<T> {
    cells: Split<T>,
    cells_spare: Split<T>,
    /// Thirty-two columns of the result in each.
    pixels: Vec<Split<T>>,
    pixels_spare: Split<T>,
    /// The tile, sixteen columns after another.
    columns: Vec<Lanes<T>>,
    halves: Vec<Halves<T>>,
    /// Of every output, sixteen vertical frequencies at a time.
    sums: Vec<Split<T>>,
    /// Of every output, per sixteen vertical frequencies, the pixel columns of the result.
    results: Vec<Vec<Split<T>>>,
}

/// An input, half transformed: per sixteen vertical frequencies (the lanes), its columns.
struct Halves<T> {
    /// Weighted by 1−v.
    upper: Split<T>,
    /// Weighted by v.
    lower: Split<T>,
}

pub struct Plan<T> {
    pub tiling: Tiling,
    cells: Fft<T>,
    pixels: Fft<T>,
    /// Vertical frequencies in batches of sixteen.
    batches: usize,
    /// Columns of input or kernel, in whole pairs of batches.
    columns: usize,
    /// Weight 1−t of every column of a tile.
    left: Vec<T>,
    /// Weight t.
    right: Vec<T>,
}

impl<T: Real> Plan<T> {
    /// Plans a tiling.
    pub fn new(tiling: &Tiling) -> Self {
        let right: Vec<T> = (0..tiling.tile).map(|i| T::wide(tiling.fraction(i))).collect();
        Self {
            tiling: *tiling,
            cells: Fft::new(tiling.length),
            pixels: Fft::new(tiling.length / tiling.oversample),
            batches: (tiling.length / 2 + 1).div_ceil(LANES),
            columns: tiling.tile.max(tiling.kernel).next_multiple_of(2 * LANES),
            left: right.iter().map(|&t| T::of(1.0) - t).collect(),
            right,
        }
    }

    /// Pixels across a transform's result, in whole pairs of batches.
    fn stride(&self) -> usize {
        self.pixels.length().next_multiple_of(2 * LANES)
    }

    /// Buffers for this many inputs and outputs.
    pub fn scratch(&self, inputs: usize, outputs: usize) -> Scratch<T> {
        let zeros = Split::<T>::zeros;
        let half = || zeros(self.batches * self.columns);
        Scratch {
            cells: zeros(self.cells.length()),
            cells_spare: zeros(self.cells.length()),
            pixels: vec![zeros(self.stride()); self.tiling.reach().div_ceil(2 * LANES)],
            pixels_spare: zeros(self.stride()),
            columns: vec![Lanes::ZERO; self.tiling.tile.div_ceil(LANES) * self.tiling.tile],
            halves: (0..inputs).map(|_| Halves { upper: half(), lower: half() }).collect(),
            sums: vec![zeros(self.cells.length().max(self.stride())); outputs],
            results: vec![vec![zeros(self.stride()); self.batches]; outputs],
        }
    }

    /// An empty plane for the light of a row of tiles.
    pub fn empty_strip(&self) -> Plane<f32> {
        let Tiling { tile, oversample, .. } = self.tiling;
        let reach = self.tiling.reach();
        Plane::filled((self.tiling.across() - 1) * tile / oversample + reach, reach, 0.0)
    }

    /// An empty spectrum of a kernel.
    pub fn empty_spectrum(&self) -> Spectrum<T> {
        Spectrum(vec![Split::zeros(self.tiling.length); self.batches])
    }

    /// Bytes of the spectrum of a kernel.
    pub fn spectrum_bytes(&self) -> usize {
        2 * self.batches * self.tiling.length * size_of::<Lanes<T>>()
    }
}

/// Transforms a kernel, scaled so that forward and backward transforms together scale by 1.
pub struct TransformKernel<'a, T> {
    pub plan: &'a Plan<T>,
    pub kernel: &'a [f32],
    pub scratch: &'a mut Scratch<T>,
    pub spectrum: &'a mut Spectrum<T>,
}

impl<T: Real> WithSimd for TransformKernel<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { plan, kernel, scratch, spectrum: Spectrum(spectrum) } = self;
        let (n, size) = (plan.tiling.length, plan.tiling.kernel);
        let scale = T::of(1.0 / (n * n) as f64);
        let Scratch { cells, cells_spare, halves, .. } = scratch;
        let Halves { upper, lower } = &mut halves[0];
        for x in (0..size).step_by(2 * LANES) {
            cells.clear();
            for (y, row) in kernel.chunks_exact(size).enumerate() {
                cells.re[y] = Lanes::of_row(row, x);
                cells.im[y] = Lanes::of_row(row, x + LANES);
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
        for (b, spectrum) in spectrum.iter_mut().enumerate() {
            let part = b * plan.columns..b * plan.columns + size;
            let input =
                Weighted::new((&upper.re[part.clone()], &scales), (&upper.im[part], &scales));
            plan.cells.forward_from(simd, input, spectrum, cells_spare);
        }
    }
}

/// Adds the light of the tile at cell column `first` to every output from its column `place` on.
pub struct BlurTile<'a, T> {
    pub plan: &'a Plan<T>,
    /// One strip per input.
    pub sources: &'a [Plane<f32>],
    pub first: usize,
    /// At every corner the spectra of all outputs, and of each those of all inputs.
    pub corners: [&'a [Spectrum<T>]; 4],
    pub scratch: &'a mut Scratch<T>,
    pub out: &'a mut [Plane<f32>],
    pub place: usize,
}

impl<T: Real> WithSimd for BlurTile<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { plan, sources, first, corners, scratch, out, place } = self;
        let (tile, reach) = (plan.tiling.tile, plan.tiling.reach());
        let Scratch { cells, cells_spare, pixels, pixels_spare, columns, halves, sums, results } =
            scratch;
        for (source, Halves { upper, lower }) in sources.iter().zip(&mut *halves) {
            // Rows are read as they lie in memory, and then taken sixteen columns at a time.
            let (wide, height) = (tile.min(source.width - first), source.height);
            for y in 0..height {
                let row = &source.row(y)[first..first + wide];
                for (x, column) in columns.chunks_exact_mut(tile).enumerate() {
                    column[y] = Lanes::of_row(row, x * LANES);
                }
            }
            for (x, column) in columns.chunks_exact(tile).enumerate() {
                // 1−v weighs the real parts, v the imaginary ones.
                let (column, left, right) =
                    (&column[..height], &plan.left[..height], &plan.right[..height]);
                let input = Weighted::new((column, left), (column, right));
                plan.cells.forward_from(simd, input, cells, cells_spare);
                split_columns(simd, cells, plan, x * LANES, upper, lower);
            }
        }
        for b in 0..plan.batches {
            let at = b * plan.columns..b * plan.columns + tile;
            for (input, Halves { upper, lower }) in halves.iter().enumerate() {
                for (corner, spectra) in corners.iter().enumerate() {
                    let half = if corner < 2 { upper } else { lower };
                    let weights = if corner % 2 == 0 { &plan.left } else { &plan.right };
                    let kernels: Vec<KernelPart<'_, T>> = spectra
                        .iter()
                        .skip(input)
                        .step_by(sources.len())
                        .map(|Spectrum(kernel)| (&*kernel[b].re, &*kernel[b].im))
                        .collect();
                    let output =
                        Products { kernels: &kernels, sums, first: input == 0 && corner == 0 };
                    let (re, im) = (&half.re[at.clone()], &half.im[at.clone()]);
                    let input = Weighted::new((re, weights), (im, weights));
                    plan.cells.forward_into(simd, input, cells, cells_spare, output);
                }
            }
            for (sum, result) in sums.iter_mut().zip(&mut *results) {
                match plan.tiling.oversample {
                    1 => std::mem::swap(sum, &mut result[b]),
                    s => fold(simd, sum, s, plan.pixels.length(), &mut result[b]),
                }
                plan.pixels.backward(&mut result[b], pixels_spare);
            }
        }
        for (result, out) in results.iter().zip(out) {
            for (pair, pixels) in pixels.iter_mut().enumerate() {
                pixels.clear();
                join_columns(simd, result, plan, pair * 2 * LANES, pixels);
                plan.pixels.backward(pixels, pixels_spare);
            }
            // What the tile before has written is added to, the rest is new.
            let written = if first == 0 { 0 } else { reach - tile / plan.tiling.oversample };
            for y in 0..out.height {
                let row = &mut out.row_mut(y)[place..place + reach];
                for (block, values) in row.chunks_mut(LANES).enumerate() {
                    let Split { re, im } = &pixels[block / 2];
                    let lanes = if block % 2 == 0 { re[y].0 } else { im[y].0 };
                    let old = written.saturating_sub(block * LANES).min(values.len());
                    let (added, new) = values.split_at_mut(old);
                    added.iter_mut().zip(lanes).for_each(|(o, v)| *o += v.narrow());
                    new.iter_mut().zip(&lanes[old..]).for_each(|(o, v)| *o = v.narrow());
                }
            }
        }
    }
}

/// Takes the transforms of two real inputs apart that shared one complex transform along y, and
/// turns them: from sixteen columns (lanes) to sixteen vertical frequencies (lanes) by columns x
/// to x + 15.
#[inline(always)]
fn split_columns<S: Simd, T: Real>(
    simd: S,
    both: &Split<T>,
    plan: &Plan<T>,
    x: usize,
    real: &mut Split<T>,
    imaginary: &mut Split<T>,
) {
    let (n, w) = (both.re.len(), T::registers::<S>());
    let (re, im) = (T::vectors::<S>(&both.re), T::vectors::<S>(&both.im));
    let half = T::splat(simd, T::of(0.5));
    // Beyond the last frequency lanes hold what nobody reads.
    let mut parts = [[Lanes::<T>::ZERO; LANES]; 4];
    for b in 0..plan.batches {
        let [ar, ai, br, bi] = &mut parts;
        let (ar, ai) = (T::vectors_mut::<S>(ar), T::vectors_mut::<S>(ai));
        let (br, bi) = (T::vectors_mut::<S>(br), T::vectors_mut::<S>(bi));
        for i in 0..LANES.min(n / 2 + 1 - b * LANES) {
            let k = b * LANES + i;
            let mirror = if k == 0 { 0 } else { n - k };
            for j in 0..w {
                let (k, m, i) = (k * w + j, mirror * w + j, i * w + j);
                ar[i] = T::times(simd, half, T::plus(simd, re[k], re[m]));
                ai[i] = T::times(simd, half, T::minus(simd, im[k], im[m]));
                br[i] = T::times(simd, half, T::plus(simd, im[k], im[m]));
                bi[i] = T::times(simd, half, T::minus(simd, re[m], re[k]));
            }
        }
        let at = b * plan.columns + x..b * plan.columns + x + LANES;
        transpose(&parts[0], &mut real.re[at.clone()]);
        transpose(&parts[1], &mut real.im[at.clone()]);
        transpose(&parts[2], &mut imaginary.re[at.clone()]);
        transpose(&parts[3], &mut imaginary.im[at]);
    }
}

/// The inverse of [`split_columns`] for pixel columns x to x + 15 (real part) and x + 16 to x + 31
/// (imaginary part), folding the vertical frequencies onto the pixel grid's.
#[inline(always)]
fn join_columns<S: Simd, T: Real>(
    simd: S,
    result: &[Split<T>],
    plan: &Plan<T>,
    x: usize,
    pixels: &mut Split<T>,
) {
    let (n, count, w) = (plan.tiling.length, plan.pixels.length(), T::registers::<S>());
    let (re, im) = (T::vectors_mut::<S>(&mut pixels.re), T::vectors_mut::<S>(&mut pixels.im));
    let mut blocks = [[Lanes::<T>::ZERO; LANES]; 4];
    for (b, part) in result.iter().enumerate() {
        let [ar, ai, br, bi] = &mut blocks;
        transpose(&part.re[x..], ar);
        transpose(&part.im[x..], ai);
        transpose(&part.re[x + LANES..], br);
        transpose(&part.im[x + LANES..], bi);
        let (ar, ai) = (T::vectors::<S>(ar), T::vectors::<S>(ai));
        let (br, bi) = (T::vectors::<S>(br), T::vectors::<S>(bi));
        for i in 0..LANES.min(n / 2 + 1 - b * LANES) {
            let k = b * LANES + i;
            let place = k % count;
            let mirror = (count - place) % count;
            for j in 0..w {
                let (p, m, i) = (place * w + j, mirror * w + j, i * w + j);
                re[p] = T::plus(simd, re[p], T::minus(simd, ar[i], bi[i]));
                im[p] = T::plus(simd, im[p], T::plus(simd, ai[i], br[i]));
                if k > 0 && 2 * k < n {
                    // The negative frequency of a real column is the conjugate.
                    re[m] = T::plus(simd, re[m], T::plus(simd, ar[i], bi[i]));
                    im[m] = T::plus(simd, im[m], T::minus(simd, br[i], ai[i]));
                }
            }
        }
    }
}

/// Adds `parts` runs of `count` frequencies: those of the cell grid fall on those of the pixel
/// grid.
#[inline(always)]
fn fold<S: Simd, T: Real>(
    simd: S,
    spectrum: &Split<T>,
    parts: usize,
    count: usize,
    folded: &mut Split<T>,
) {
    let run = count * T::registers::<S>();
    for (from, to) in [(&spectrum.re, &mut folded.re), (&spectrum.im, &mut folded.im)] {
        let (from, to) = (T::vectors::<S>(from), &mut T::vectors_mut::<S>(to)[..run]);
        to.copy_from_slice(&from[..run]);
        for part in from[run..parts * run].chunks_exact(run) {
            to.iter_mut().zip(part).for_each(|(sum, &v)| *sum = T::plus(simd, *sum, v));
        }
    }
}
