//! The pixel grid's spectrum back to pixels.

use super::spectrum::BLOCK;
use crate::engine::sampling::Layout;
use camrig_base::Plane;
use camrig_fourier::lanes::{Fft, LANES, Lanes, Real, Split, transpose};
use camrig_vector::vectorised;
use rayon::prelude::*;

/// The frame's rows of an output, whose columns are back in space; `batches` holds every sixteen
/// horizontal frequencies of every output.
pub fn frame<T: Real>(batches: &[Vec<Split<T>>], output: usize, layout: &Layout) -> Plane<f32> {
    let (pixels, width) = (layout.padded_width, layout.width);
    let fft = Fft::<T>::new(pixels);
    let scale = T::of(1.0 / (layout.cells_across() as f64 * layout.cells_down() as f64));
    let mut plane = Plane::filled(width, layout.height, 0.0);
    plane.data.par_chunks_mut(BLOCK * width).enumerate().for_each_init(
        || (Split::zeros(pixels), Split::zeros(pixels)),
        |(data, scratch), (i, rows)| {
            load_rows(batches, output, layout.top() + i * BLOCK, data);
            fft.backward(data, scratch);
            store_rows(data, layout.left(), scale, (rows, width));
        },
    );
    plane
}

/// The spectra of 32 real rows from `first` on: of the first sixteen plus i times the others.
#[vectorised]
fn load_rows<T: Real>(
    batches: &[Vec<Split<T>>],
    output: usize,
    first: usize,
    data: &mut Split<T>,
) {
    let pixels = data.re.len();
    for (b, batch) in batches.iter().enumerate() {
        let Split { re, im } = &batch[output];
        let rows = |part: &[Lanes<T>], from: usize| {
            let block: [Lanes<T>; LANES] =
                std::array::from_fn(|r| part.get(from + r).copied().unwrap_or(Lanes::<T>::ZERO));
            let mut turned = [Lanes::<T>::ZERO; LANES];
            transpose(&block, &mut turned);
            turned
        };
        let (ar, ai) = (rows(re, first), rows(im, first));
        let (br, bi) = (rows(re, first + LANES), rows(im, first + LANES));
        for l in 0..LANES.min(pixels / 2 + 1 - b * LANES) {
            let k = b * LANES + l;
            let mirror = if k == 0 { 0 } else { pixels - k };
            if mirror == k {
                // 0 and the pixel grid's Nyquist frequency are real for real rows.
                (data.re[k], data.im[k]) = (ar[l], br[l]);
            } else {
                (data.re[k], data.im[k]) = (ar[l].minus(bi[l]), ai[l].plus(br[l]));
                (data.re[mirror], data.im[mirror]) = (ar[l].plus(bi[l]), br[l].minus(ai[l]));
            }
        }
    }
}

/// The frame's part, from column `left` on, of up to 32 rows of that width.
#[vectorised]
fn store_rows<T: Real>(
    data: &Split<T>,
    left: usize,
    scale: T,
    (rows, width): (&mut [f32], usize),
) {
    for x in (0..width).step_by(LANES) {
        let count = LANES.min(width - x);
        for (part, first) in [(&data.re, 0), (&data.im, LANES)] {
            let columns = &part[left + x..left + x + count];
            let block: [Lanes<T>; LANES] = std::array::from_fn(|l| {
                columns.get(l).map_or(Lanes::<T>::ZERO, |c| c.times(scale))
            });
            let mut turned = [Lanes::<T>::ZERO; LANES];
            transpose(&block, &mut turned);
            let targets = rows.chunks_exact_mut(width).skip(first);
            for (row, values) in targets.zip(&turned) {
                row[x..x + count].iter_mut().zip(values.0).for_each(|(p, v)| *p = v.narrow());
            }
        }
    }
}
