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
//!
//! Several inputs may go into several outputs, each pair through kernels of its own ([`Blurrer::mix`]): the forward
//! transforms are shared by the outputs and the inverse one by the inputs. So a scene whose spectra are mixtures
//! of a few components, E(λ) = Σ_k b_k(λ)·(c_k ⊗ psf(λ)), comes to channels of spectral response q without its bands:
//! Σ_λ q(λ)·E(λ) = Σ_k c_k ⊗ [Σ_λ q(λ)·b_k(λ)·psf(λ)], exactly, with kernels as [`Kernels::combined`] makes them.

mod tile;

use super::super::fft::{LANES, good_length};
use crate::{Plane, Result};
use rayon::prelude::*;
use tile::{BlurTile, Plan, Spectrum, TransformKernel};

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

/// Rows `first..first + count` of a cell grid.
pub type Rows<'a> = dyn Fn(usize, usize) -> Result<Plane<f32>> + Sync + 'a;

impl Kernels {
    /// Σ weight · kernels: of several bands into one.
    ///
    /// # Panics
    /// When there are none, or they differ in size.
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
    plan: Plan,
    spectra: Vec<Spectrum>,
}

/// Bytes that spectra of kernels may take before fewer rows of tiles are done at once.
const SPECTRA: usize = 256 << 20;

impl Blurrer {
    /// Plans a tiling.
    pub fn new(tiling: &Tiling) -> Self {
        Self { plan: Plan::new(tiling), spectra: Vec::new() }
    }

    /// The tiling it was planned for.
    pub fn tiling(&self) -> &Tiling {
        &self.plan.tiling
    }

    /// Blurs the cell grid that `rows` gives with one kernel per node, and samples it at the pixel centres of the
    /// frame, which starts `corner` (left, top) pixels into the padded grid.
    ///
    /// # Errors
    /// Those of `rows`.
    pub fn blur(
        &mut self,
        rows: &Rows<'_>,
        kernels: &Kernels,
        corner: (usize, usize),
        size: (usize, usize),
    ) -> Result<Plane<f32>> {
        let planes = self.mix(&[rows], &[&[kernels]], corner, size)?;
        Ok(planes.into_iter().next().unwrap_or_else(|| Plane::filled(0, 0, 0.0)))
    }

    /// Blurs every input for every output and adds: output c gets input k through `kernels[c][k]`.
    ///
    /// # Errors
    /// Those of the inputs.
    pub fn mix(
        &mut self,
        inputs: &[&Rows<'_>],
        kernels: &[&[&Kernels]],
        corner: (usize, usize),
        (width, height): (usize, usize),
    ) -> Result<Vec<Plane<f32>>> {
        let Self { plan, spectra } = self;
        let (tiling, pairs) = (plan.tiling, inputs.len() * kernels.len());
        let (across, per_row) = (tiling.across() + 1, (tiling.across() + 1) * pairs);
        // A few rows of tiles at a time bound the memory; they are added in order.
        let threads = rayon::current_num_threads();
        let affordable = SPECTRA / (per_row * plan.spectrum_bytes());
        let group = affordable.saturating_sub(1).clamp(threads, 2 * threads);
        let rows_of_nodes = (group + 1).min(tiling.down() + 1);
        spectra.resize_with(rows_of_nodes * per_row, || plan.empty_spectrum());
        let mut planes = vec![Plane::filled(width, height, 0.0); kernels.len()];
        let shift = tiling.before / tiling.oversample;
        for start in (0..tiling.down()).step_by(group) {
            let end = tiling.down().min(start + group);
            // The last row of nodes of one group is the first of the next.
            let known = usize::from(start > 0);
            (0..known * per_row).for_each(|i| spectra.swap(i, group * per_row + i));
            let wanted = known * per_row..(end - start + 1) * per_row;
            spectra[wanted.clone()].par_iter_mut().zip(wanted).for_each_init(
                || plan.scratch(1, 1),
                |scratch, (spectrum, i)| {
                    let (node, pair) = (start * across + i / pairs, i % pairs);
                    let kernels = kernels[pair / inputs.len()][pair % inputs.len()];
                    let n2 = kernels.size * kernels.size;
                    let kernel = &kernels.data[node * n2..(node + 1) * n2];
                    pulp::Arch::new().dispatch(TransformKernel { plan, kernel, scratch, spectrum });
                },
            );
            let strips: Vec<Result<Vec<Plane<f32>>>> = (start..end)
                .into_par_iter()
                .map_init(
                    || plan.scratch(inputs.len(), kernels.len()),
                    |scratch, j| {
                        let nodes = &spectra[(j - start) * per_row..(j - start + 2) * per_row];
                        strip(plan, j, inputs, nodes, scratch, kernels.len())
                    },
                )
                .collect();
            for (j, strips) in (start..end).zip(strips) {
                for (plane, strip) in planes.iter_mut().zip(strips?) {
                    for q in 0..strip.height {
                        // Padded pixel row of strip row q, then the frame's.
                        let row = j * tiling.tile / tiling.oversample + q;
                        let Some(y) = row.checked_sub(shift + corner.1).filter(|&y| y < height)
                        else {
                            continue;
                        };
                        let source = &strip.row(q)[corner.0 + shift..];
                        plane.row_mut(y).iter_mut().zip(source).for_each(|(o, v)| *o += v);
                    }
                }
            }
        }
        Ok(planes)
    }
}

/// The light of row j of tiles in every output, from `before / s` pixels left of and above its corner on; `nodes` are
/// the spectra of its two rows of nodes.
fn strip(
    plan: &Plan,
    j: usize,
    inputs: &[&Rows<'_>],
    nodes: &[Spectrum],
    scratch: &mut tile::Scratch,
    outputs: usize,
) -> Result<Vec<Plane<f32>>> {
    let Tiling { tile, oversample, height, .. } = plan.tiling;
    let count = tile.min(height - j * tile);
    let sources: Result<Vec<Plane<f32>>> =
        inputs.iter().map(|rows| rows(j * tile, count)).collect();
    let (sources, pairs) = (&sources?, inputs.len() * outputs);
    let (across, reach) = (plan.tiling.across(), plan.tiling.reach());
    let columns = (across - 1) * tile / oversample + reach;
    let mut out = vec![Plane::filled(columns, reach, 0.0); outputs];
    for i in 0..across {
        let corner = |di: usize, dj: usize| &nodes[(dj * (across + 1) + i + di) * pairs..][..pairs];
        pulp::Arch::new().dispatch(BlurTile {
            plan,
            sources,
            first: i * tile,
            corners: [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)],
            scratch,
            out: &mut out,
            place: i * tile / oversample,
        });
    }
    Ok(out)
}

#[cfg(test)]
mod tests;
