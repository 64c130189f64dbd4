//! Transfer functions of kernels of finite support, at the frequencies of a grid. Even real sequences
//! have real transforms, so two share one complex transform.

use super::Kernel;
use super::spectrum::{Alias, Aliases};
use crate::engine::sampling::Layout;
use camrig_fourier::lanes::{Fft, LANES, Lanes, Real, Split};
use rayon::prelude::*;
use std::f64::consts::PI;

/// One direction of the cell grid.
pub struct Axis<T> {
    /// Cells.
    pub cells: usize,
    /// Frequencies kept, from 0: all, but without the last of an even number of cells per pixel,
    /// whose pixel centres it has its zeros on.
    pub kept: usize,
    /// Per kept frequency cos and sin of the phase towards the pixel centre.
    pub phase: Vec<(T, T)>,
    fft: Fft<T>,
    /// Of kernels whose centre lies between two cells: per kept frequency cos and sin of the phase
    /// of half a cell.
    half_cell: Option<Vec<(T, T)>>,
}

/// Frequencies of `cells` that are kept, from 0.
pub fn kept(cells: usize, layout: &Layout) -> usize {
    cells / 2 + layout.oversample % 2
}

impl<T: Real> Axis<T> {
    pub fn new(cells: usize, layout: &Layout) -> Self {
        let s = layout.oversample;
        let kept = kept(cells, layout);
        let phases = |half_cells: usize| {
            let phase = |k: usize| {
                let (sin, cos) = libm::sincos(PI * (k * half_cells) as f64 / cells as f64);
                (T::of(cos), T::of(sin))
            };
            (0..kept).map(phase).collect()
        };
        let between = layout.support().is_multiple_of(2);
        Self {
            cells,
            kept,
            phase: phases(s - 1),
            fft: Fft::new(cells),
            half_cell: between.then(|| phases(1)),
        }
    }

    /// Transforms even kernels: `half` gives their values from the centre outwards, in the real
    /// and the imaginary part of every lane another. The transforms are left in `data`, at the
    /// kept frequencies.
    fn transform(&self, half: &[[Lanes<T>; 2]], data: &mut Split<T>, scratch: &mut Split<T>) {
        data.clear();
        let beyond = if self.half_cell.is_some() { self.cells - 1 } else { self.cells };
        for (i, [re, im]) in half.iter().enumerate() {
            for place in [i, (beyond - i) % self.cells] {
                (data.re[place], data.im[place]) = (*re, *im);
            }
        }
        self.fft.forward(data, scratch);
        for (k, (cos, sin)) in self.half_cell.iter().flatten().enumerate() {
            let (re, im) = (data.re[k], data.im[k]);
            data.re[k] = re.times(*cos).plus(im.times(*sin));
            data.im[k] = im.times(*cos).minus(re.times(*sin));
        }
        if 2 * (self.kept - 1) == self.cells {
            // The grid's Nyquist frequency is met twice, as positive and as negative one.
            for part in [&mut data.re, &mut data.im] {
                part[self.kept - 1] = part[self.kept - 1].times(T::of(0.5));
            }
        }
    }
}

/// The transfer function T that [`super`] defines.
pub struct Transfer<T> {
    /// Per row of the kernel, from its centre outwards, the transform along x at every kept
    /// frequency.
    rows: Vec<Vec<T>>,
    /// Alias by alias, the values at every kept frequency along y, where they are kept for many
    /// pictures.
    values: Option<Vec<Lanes<T>>>,
}

impl<T: Real> Transfer<T> {
    pub fn new(kernel: &Kernel, x: &Axis<T>) -> Self {
        Self { rows: along_x(kernel.rows(), x), values: None }
    }

    /// Tabulates its values at all frequencies.
    pub fn keep(&mut self, aliases: &Aliases, y: &Axis<T>) {
        let mut values = vec![Lanes::<T>::ZERO; aliases.all.len() * y.kept];
        values.par_chunks_mut(2 * y.kept).zip(aliases.all.par_chunks(2)).for_each_init(
            || (Split::zeros(y.cells), Split::zeros(y.cells)),
            |(gains, scratch), (values, pair)| {
                self.along_y(pair, y, gains, scratch);
                for (values, part) in values.chunks_exact_mut(y.kept).zip([&gains.re, &gains.im]) {
                    values.copy_from_slice(&part[..y.kept]);
                }
            },
        );
        self.values = Some(values);
    }

    pub fn is_kept(&self) -> bool {
        self.values.is_some()
    }

    /// Its values along y at the horizontal frequencies of an alias, where they are kept.
    pub fn kept(&self, alias: usize, y: &Axis<T>) -> Option<&[Lanes<T>]> {
        self.values.as_ref().map(|values| &values[alias * y.kept..(alias + 1) * y.kept])
    }

    /// Its values along y at the horizontal frequencies of one or two aliases, into the real and
    /// the imaginary parts of `gains`.
    pub fn along_y(
        &self,
        pair: &[Alias],
        y: &Axis<T>,
        gains: &mut Split<T>,
        scratch: &mut Split<T>,
    ) {
        let at = |row: &Vec<T>, alias: Option<&Alias>| {
            alias.map_or(Lanes::<T>::ZERO, |alias| {
                Lanes(alias.lanes.map(|k| k.map_or(T::ZERO, |k| row[k])))
            })
        };
        let half: Vec<[Lanes<T>; 2]> =
            self.rows.iter().map(|row| [at(row, pair.first()), at(row, pair.get(1))]).collect();
        y.transform(&half, gains, scratch);
    }
}

/// Transforms the rows of a kernel, thirty-two at once.
fn along_x<T: Real>(kernel: &[Vec<f64>], x: &Axis<T>) -> Vec<Vec<T>> {
    let blocks = kernel.par_chunks(2 * LANES).map_init(
        || (Split::zeros(x.cells), Split::zeros(x.cells)),
        |(data, scratch), rows| {
            let at = |i: usize, first: usize| {
                Lanes(std::array::from_fn(|l| {
                    rows.get(first + l).map_or(T::ZERO, |r| T::of(r[i]))
                }))
            };
            let half: Vec<[Lanes<T>; 2]> =
                (0..kernel.len()).map(|i| [at(i, 0), at(i, LANES)]).collect();
            x.transform(&half, data, scratch);
            let row = |r: usize| {
                let part = if r < LANES { &data.re } else { &data.im };
                part[..x.kept].iter().map(|v| v.0[r % LANES]).collect()
            };
            (0..rows.len()).map(row).collect::<Vec<Vec<T>>>()
        },
    );
    blocks.flatten().collect()
}
