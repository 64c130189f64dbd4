//! Blur that varies over the field, in the Fourier domain, tile by tile.
//!
//! The cell grid is cut into square tiles; a kernel sits at every tile corner (*node*). A cell at
//! fraction (t, v) of its tile scatters its light with the bilinear blend of the tile's four
//! kernels,
//!
//! out(p) = Σ_c in(c)·[(1−v)(1−t)·K00 + (1−v)t·K01 + v(1−t)·K10 + v·t·K11](p − c),
//!
//! which conserves energy, since the blend belongs to the *source* cell. So each tile costs four
//! forward transforms of weighted input (real, so two share one complex transform along y), four
//! products and one inverse, at pixel size: sampling every s-th cell is folding the spectrum.
//! (Denis et al. 2015, "Fast approximations of shift-variant blur", IJCV 115, 253.)
//!
//! Tiles of one row of tiles are summed in order, then rows of tiles in order, so the result does
//! not depend on the number of threads.
//!
//! Several inputs may go into several outputs, each pair through kernels of its own
//! ([`Blurrer::add`]): the forward transforms are shared by the outputs and the inverse one by the
//! inputs. So a scene whose spectra are mixtures of a few components, E(λ) = Σ_k b_k(λ)·(c_k ⊗
//! psf(λ)), comes to channels of spectral response q without its bands: Σ_λ q(λ)·E(λ) = Σ_k c_k ⊗
//! [Σ_λ q(λ)·b_k(λ)·psf(λ)], exactly, with kernels as [`Kernels::combined`] makes them.

mod tile;

use super::range::Range as Values;
pub use super::source::Rows;
use camrig_base::{Plane, Result};
use camrig_fourier::lanes::{LANES, Real, good_length, passes};
use rayon::prelude::*;
use std::collections::VecDeque;
use std::ops::Range;
use tile::{BlurTile, Plan, Spectrum, TransformKernel};

/// Kernels at the corners of square tiles.
///
/// Entry (i, j) of a kernel is the fraction of a cell's light that a pixel receives whose centre
/// lies i − [`Tiling::before`] (rows) and j − `before` (columns) cells from the cell, counted as
/// s·(pixel index) − (cell index).
#[derive(Clone)]
pub struct Kernels {
    /// Entries per side.
    pub size: usize,
    /// Row-major by node, each `size * size`, row-major.
    pub data: Vec<f32>,
}

/// Division of a cell grid into tiles.
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
    #[must_use]
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
            // Transforms per tile, sixteen at once, and of a kernel per tile, times passes over
            // memory: one more than stages, and dearer (measured) the less the first-level cache
            // holds of a transform.
            let batches = (length / 2 + 1).div_ceil(LANES);
            let transforms = 1.5 * tile as f64 / LANES as f64 + 6.0 * batches as f64;
            let pass = (passes(length) + 1) as f64 * (1.0 + length as f64 / 400.0);
            let tiles = width.div_ceil(tile) * height.div_ceil(tile);
            let cost = (tiles * length) as f64 * transforms * pass;
            (cost, tile, length)
        };
        let (_, tile, length) = (1..=most / s)
            .map(|n| candidate(n * s))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or_else(|| candidate(s));
        Self { oversample, width, height, tile, kernel, before, length }
    }

    /// Tiles across.
    #[must_use]
    pub fn across(&self) -> usize {
        self.width.div_ceil(self.tile)
    }

    /// Tiles down.
    #[must_use]
    pub fn down(&self) -> usize {
        self.height.div_ceil(self.tile)
    }

    /// Place of node (i across, j down) in cells from the top left corner of the padded grid.
    #[must_use]
    pub fn node(&self, i: usize, j: usize) -> (f64, f64) {
        ((i * self.tile) as f64, (j * self.tile) as f64)
    }

    /// Pixels that one tile's light reaches, per side.
    fn reach(&self) -> usize {
        (self.tile + self.kernel - 2) / self.oversample + 1
    }

    /// Fraction of the way across its tile of the i-th cell: its centre.
    #[must_use]
    pub fn fraction(&self, i: usize) -> f32 {
        ((i as f64 + 0.5) / self.tile as f64) as f32
    }
}

impl Kernels {
    /// Σ weight · kernels: kernels of several bands combined into one set.
    ///
    /// # Panics
    /// When `parts` is empty or the kernels differ in size.
    #[must_use]
    pub fn combined(parts: &[(f32, &Kernels)]) -> Self {
        let (_, first) = parts[0];
        let mut data = vec![0.0f32; first.data.len()];
        for (weight, kernels) in parts {
            assert_eq!(kernels.data.len(), data.len(), "kernels of one tiling");
            data.iter_mut().zip(&kernels.data).for_each(|(sum, v)| *sum += weight * v);
        }
        Self { size: first.size, data }
    }
}

/// Blurs bands of one tiling; keeps its plans and buffers from band to band.
pub struct Blurrer {
    narrow: Transforms<f32>,
    /// For scenes of wide range, once there is one.
    wide: Option<Box<Transforms<f64>>>,
}

/// Plans and buffers of one arithmetic.
struct Transforms<T> {
    plan: Plan<T>,
    spectra: Vec<Spectrum<T>>,
    /// Buffers of finished strips, for reuse.
    spare: Vec<Vec<Plane<f32>>>,
}

/// The light of a row of tiles in every output.
struct Strip {
    /// Its first row and the one after its last, in pixels of the padded grid, from `before / s`
    /// pixels above it on.
    rows: Range<usize>,
    light: Vec<Plane<f32>>,
}

/// Bytes that the spectra of kernels may take; beyond that they are not kept, and fewer rows of
/// tiles are processed at once.
const SPECTRA: usize = 256 << 20;

/// The kernels of every pair of an output and an input.
#[derive(Clone, Copy)]
#[non_exhaustive]
pub enum Pairs<'a> {
    /// As they are, `[output][input]`: transformed when they are needed.
    Kernels(&'a [&'a [&'a Kernels]]),
    /// Transformed before.
    Transformed(&'a Transformed),
}

/// Kernels transformed at every node, to blur many pictures.
pub struct Transformed {
    /// `[output][input]`.
    kernels: Vec<Vec<Kernels>>,
    spectra: Vec<Spectrum<f32>>,
}

impl Blurrer {
    /// Plans a tiling.
    #[must_use]
    pub fn new(tiling: &Tiling) -> Self {
        Self { narrow: Transforms::new(tiling), wide: None }
    }

    /// The tiling it was planned for.
    #[must_use]
    pub fn tiling(&self) -> &Tiling {
        &self.narrow.plan.tiling
    }

    /// Blurs the cell grid that `rows` gives with one kernel per node, and samples it at the pixel
    /// centres of the frame, which starts `corner` (left, top) pixels into the padded grid.
    ///
    /// # Errors
    /// Those of `rows`.
    pub fn blur(
        &mut self,
        rows: &Rows<'_>,
        kernels: &Kernels,
        corner: (usize, usize),
        (width, height): (usize, usize),
    ) -> Result<Plane<f32>> {
        let mut plane = Plane::filled(width, height, 0.0);
        let planes = std::slice::from_mut(&mut plane);
        self.add(&[rows], Pairs::Kernels(&[&[kernels]]), corner, &[&[1.0]], planes)?;
        Ok(plane)
    }

    /// Transforms kernels, `[output][input]`, for many pictures; none where that would take more
    /// memory than it is worth.
    #[must_use]
    pub fn transformed(&self, kernels: &[&[&Kernels]]) -> Option<Transformed> {
        let plan = &self.narrow.plan;
        let nodes = (plan.tiling.across() + 1) * (plan.tiling.down() + 1);
        let count = nodes * kernels.iter().map(|inputs| inputs.len()).sum::<usize>();
        if count * plan.spectrum_bytes() > SPECTRA {
            return None;
        }
        let mut spectra: Vec<Spectrum<f32>> = (0..count).map(|_| plan.empty_spectrum()).collect();
        transform(plan, kernels, 0, &mut spectra);
        let owned = |inputs: &&[&Kernels]| inputs.iter().map(|&k| k.clone()).collect();
        Some(Transformed { kernels: kernels.iter().map(owned).collect(), spectra })
    }

    /// Blurs every input for every output and adds, each pair through its own kernels; then adds
    /// to plane p every output c times `weights[p][c]`. The planes are as large as the frame.
    /// In f64 where the inputs have a wide range (`range.rs`).
    ///
    /// # Errors
    /// Those of the inputs.
    pub fn add(
        &mut self,
        inputs: &[&Rows<'_>],
        kernels: Pairs<'_>,
        corner: (usize, usize),
        weights: &[&[f32]],
        planes: &mut [Plane<f32>],
    ) -> Result<()> {
        let place = Place { corner, weights };
        let before = planes.to_vec();
        let borrowed: Vec<Vec<&Kernels>>;
        let all: Vec<&[&Kernels]>;
        let (all, transformed) = match kernels {
            Pairs::Kernels(all) => (all, None),
            Pairs::Transformed(transformed) => {
                borrowed = transformed.kernels.iter().map(|k| k.iter().collect()).collect();
                all = borrowed.iter().map(Vec::as_slice).collect();
                (&*all, Some(&*transformed.spectra))
            }
        };
        if self.narrow.add(inputs, all, transformed, &place, planes)?.is_wide() {
            planes.clone_from_slice(&before);
            let tiling = *self.tiling();
            let wide = self.wide.get_or_insert_with(|| Box::new(Transforms::new(&tiling)));
            wide.add(inputs, all, None, &place, planes)?;
        }
        Ok(())
    }
}

/// Where outputs go.
struct Place<'a> {
    /// The frame's left and top edge in the padded grid, pixels.
    corner: (usize, usize),
    weights: &'a [&'a [f32]],
}

impl<T: Real> Transforms<T> {
    fn new(tiling: &Tiling) -> Self {
        Self { plan: Plan::new(tiling), spectra: Vec::new(), spare: Vec::new() }
    }

    /// As [`Blurrer::add`], in this arithmetic; the range of the inputs.
    fn add(
        &mut self,
        inputs: &[&Rows<'_>],
        kernels: &[&[&Kernels]],
        transformed: Option<&[Spectrum<T>]>,
        place: &Place<'_>,
        planes: &mut [Plane<f32>],
    ) -> Result<Values> {
        let Self { plan, spectra, spare } = self;
        let (tiling, outputs) = (plan.tiling, kernels.len());
        let per_row = (tiling.across() + 1) * inputs.len() * outputs;
        // A few rows of tiles at a time bound the memory; they are added in order.
        let threads = rayon::current_num_threads();
        let group = match transformed {
            Some(_) => 8 * threads,
            None => {
                let affordable = SPECTRA / (per_row * plan.spectrum_bytes());
                let group = affordable.saturating_sub(1).clamp(threads, 2 * threads);
                let rows_of_nodes = (group + 1).min(tiling.down() + 1);
                spectra.resize_with(rows_of_nodes * per_row, || plan.empty_spectrum());
                group
            }
        };
        // The first row of row j of tiles, pixels.
        let top = |j: usize| j * tiling.tile / tiling.oversample;
        let shift = tiling.before / tiling.oversample;
        let (left, top_edge) = (place.corner.0 + shift, place.corner.1 + shift);
        let place = Place { corner: (left, top_edge), weights: place.weights };
        let mut range = Values::default();
        let mut strips: VecDeque<Strip> = VecDeque::new();
        for start in (0..tiling.down()).step_by(group) {
            let end = tiling.down().min(start + group);
            let spectra: &[Spectrum<T>] = match transformed {
                Some(all) => &all[start * per_row..(end + 1) * per_row],
                None => {
                    // The last row of nodes of one group is the first of the next.
                    let known = usize::from(start > 0) * per_row;
                    (0..known).for_each(|i| spectra.swap(i, group * per_row + i));
                    let wanted = known..(end - start + 1) * per_row;
                    transform(plan, kernels, start * per_row + known, &mut spectra[wanted]);
                    spectra
                }
            };
            strips.extend((start..end).map(|j| Strip {
                rows: top(j)..top(j) + tiling.reach(),
                light: spare.pop().unwrap_or_default(),
            }));
            let new = strips.len() - (end - start);
            let ranges = strips.make_contiguous()[new..].par_iter_mut().enumerate().map_init(
                || plan.scratch(inputs.len(), outputs),
                |scratch, (i, strip)| {
                    let nodes = &spectra[i * per_row..(i + 2) * per_row];
                    strip.light.resize_with(outputs, || plan.empty_strip());
                    fill(plan, start + i, inputs, nodes, scratch, &mut strip.light)
                },
            );
            let ranges: Vec<Values> = ranges.collect::<Result<_>>()?;
            range = ranges.into_iter().fold(range, Values::join);
            // Rows that no later strip reaches.
            let last = if end == tiling.down() { top(end) + tiling.reach() } else { top(end) };
            place.rows(strips.make_contiguous(), top(start)..last, planes);
            while strips.front().is_some_and(|strip| strip.rows.end <= last) {
                spare.extend(strips.pop_front().map(|strip| strip.light));
            }
        }
        Ok(range)
    }
}

/// The spectra from number `first` on of kernels, `[output][input]`: node by node, of each all
/// pairs.
fn transform<T: Real>(
    plan: &Plan<T>,
    kernels: &[&[&Kernels]],
    first: usize,
    spectra: &mut [Spectrum<T>],
) {
    let pairs: Vec<&Kernels> = kernels.iter().flat_map(|inputs| inputs.iter().copied()).collect();
    let of_pair = |scratch: &mut tile::Scratch<T>, (i, spectrum): (usize, &mut Spectrum<T>)| {
        let (node, pair) = ((first + i) / pairs.len(), (first + i) % pairs.len());
        let kernels = pairs[pair];
        let n2 = kernels.size * kernels.size;
        let kernel = &kernels.data[node * n2..(node + 1) * n2];
        pulp::Arch::new().dispatch(TransformKernel { plan, kernel, scratch, spectrum });
    };
    spectra.par_iter_mut().enumerate().for_each_init(|| plan.scratch(1, 0), of_pair);
}

impl Place<'_> {
    /// Adds the strips, in their order, to the planes' rows that lie in `rows` of the padded grid.
    fn rows(&self, strips: &[Strip], rows: Range<usize>, planes: &mut [Plane<f32>]) {
        let Some(Plane { width, height, .. }) = planes.first() else { return };
        let (width, (left, top)) = (*width, self.corner);
        let frame = |row: usize| row.saturating_sub(top).min(*height);
        let (first, last) = (frame(rows.start), frame(rows.end));
        let mut by_row: Vec<Vec<&mut [f32]>> = (first..last).map(|_| Vec::new()).collect();
        for plane in planes {
            let rows = plane.data[first * width..last * width].chunks_exact_mut(width);
            by_row.iter_mut().zip(rows).for_each(|(all, row)| all.push(row));
        }
        by_row.into_par_iter().enumerate().for_each_init(
            || vec![0.0f32; width],
            |sum, (i, mut targets)| {
                let row = first + i + top;
                for output in 0..self.weights[0].len() {
                    sum.fill(0.0);
                    for strip in strips.iter().filter(|strip| strip.rows.contains(&row)) {
                        let light = strip.light[output].row(row - strip.rows.start);
                        sum.iter_mut().zip(&light[left..]).for_each(|(s, v)| *s += v);
                    }
                    for (target, weights) in targets.iter_mut().zip(self.weights) {
                        let weight = weights[output];
                        target.iter_mut().zip(&*sum).for_each(|(t, v)| *t += weight * v);
                    }
                }
            },
        );
    }
}

/// The light of row j of tiles in every output, from `before / s` pixels left of and above its
/// corner on; `nodes` are the spectra of its two rows of nodes.
fn fill<T: Real>(
    plan: &Plan<T>,
    j: usize,
    inputs: &[&Rows<'_>],
    nodes: &[Spectrum<T>],
    scratch: &mut tile::Scratch<T>,
    out: &mut [Plane<f32>],
) -> Result<Values> {
    let Tiling { tile, oversample, height, .. } = plan.tiling;
    let count = tile.min(height - j * tile);
    let sources: Result<Vec<Plane<f32>>> =
        inputs.iter().map(|rows| rows(j * tile, count)).collect();
    let (sources, pairs) = (&sources?, inputs.len() * out.len());
    let across = plan.tiling.across();
    for i in 0..across {
        let corner =
            |di: usize, dj: usize| &nodes[(dj * (across + 1) + i + di) * pairs..][..pairs];
        pulp::Arch::new().dispatch(BlurTile {
            plan,
            sources,
            first: i * tile,
            corners: [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)],
            scratch,
            out: &mut *out,
            place: i * tile / oversample,
        });
    }
    let ranges = sources.iter().map(|plane| Values::of(&plane.data));
    Ok(ranges.fold(Values::default(), Values::join))
}

#[cfg(test)]
pub(super) mod tests;
