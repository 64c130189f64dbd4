//! Blur by one optical transfer function, pixel aperture and decimation, in the Fourier domain.
//!
//! The padded cell grid is transformed (rows, then columns), multiplied by a transfer function and
//! by the phase that moves from cell centres to pixel centres, folded onto the pixel grid's
//! frequencies (sampling at pixel centres *is* folding, so the real pixel's aliasing is kept) and
//! transformed back at pixel size.
//!
//! The transfer function is that of a kernel of finite support, so that nothing wraps around: the
//! margin holds the whole kernel, which makes the cyclic convolution a linear one. A band-limited
//! PSF has no support of its own. What is used is H(f) =
//! OTF(|f|)·sinc(a·fx)/sinc(h·fx)·sinc(a·fy)/sinc(h·fy) at the multiples of 1/(L·h), L the cells
//! across the support: the transform of the one kernel of L x L cells that has exactly these
//! values there. Its light is all of the light; what the PSF has beyond the support is folded back
//! into it. Between the multiples it is
//!
//! T(f) = Σ_k H(k/(L·h))·D(h·f − k/L), D(u) = sin(πLu)/(L·sin(πu)), along x and along y.

use super::sampling::{self, Layout, sinc};
use super::source::Source;
use super::{Otf, SensorGrid};
use camrig_base::{Error, Plane, Result};
use camrig_fourier::lanes::{Fft, LANES, Lanes, Split};
use camrig_vector::vectorised;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Two rows share one complex transform: the first sixteen as real parts, the next as imaginary.
const BLOCK: usize = 2 * LANES;
/// Bound on the error at a sharp step that the cells under the wings of an OTF may cause, relative
/// to the step.
const WINGS_ERROR: f64 = 2e-4;
/// Rows requested from the scene at once.
const STRIP: usize = 4 * BLOCK;

/// The spatial side of one band: sizes in µm, frequencies in cycles/mm.
pub struct Geometry<'a> {
    /// Padded grids.
    pub layout: &'a Layout,
    /// Pixel pitch, µm.
    pub pitch_um: f64,
    /// Side of the photosensitive square, µm.
    pub aperture_um: f64,
    /// Frequency beyond which the OTF is 0.
    pub cutoff_per_mm: f64,
}

/// The padded frame for an OTF, nearly all of whose light falls within `spread_um`.
pub fn layout(grid: &SensorGrid, oversample: usize, spread_um: f64) -> Layout {
    // Room for the ringing that division by the cell's sinc, up to the cell grid's Nyquist
    // frequency, causes.
    const RINGING_PIXELS: f64 = 4.0;
    Layout::new(grid, oversample, spread_um + RINGING_PIXELS * grid.pitch_um)
}

/// The padded frame for the wings of an OTF. The light that they move across a pixel's cells may
/// be wrong by `WINGS_ERROR` of a step in the scene.
///
/// # Errors
/// When no grid keeps that.
pub fn wide_layout(grid: &SensorGrid, wings: &Otf) -> Result<Layout> {
    let (pitch, aperture) = (grid.pitch_um, grid.aperture_um());
    let (oversample, _) =
        sampling::oversample(WINGS_ERROR, pitch, aperture, wings.cutoff_per_mm, &wings.at)?;
    let furthest = 0.5 * grid.width.max(grid.height) as f64 * pitch;
    Ok(layout(grid, oversample, wings.spread_um.min(furthest)))
}

/// Bytes that the values of transfer functions may take that are kept.
const VALUES: usize = 256 << 20;

/// Spectrum of the padded cell grid: `stride` horizontal frequencies for each row, then each
/// column.
struct Spectrum {
    stride: usize,
    re: Vec<f32>,
    im: Vec<f32>,
}

/// Renders `source` through an OTF: mean radiance over each pixel's photosensitive square.
///
/// # Errors
/// Those of the scene, and values that are not finite.
pub fn blur(source: &Source, geometry: &Geometry, otf: &dyn Fn(f64) -> f64) -> Result<Plane<f32>> {
    let mut planes = Blurs::new(geometry, &[vec![otf]]).run(std::slice::from_ref(source))?;
    Ok(planes.remove(0))
}

/// Blur of several inputs into several outputs, each pair by a transfer function of its own:
/// inputs are transformed once, and so are outputs.
pub struct Blurs {
    layout: Layout,
    x: Axis,
    y: Axis,
    /// Per output, of every input.
    transfers: Vec<Vec<Transfer>>,
}

impl Blurs {
    /// Plans the blurs of a geometry; `otfs` has for every output one function per input.
    pub fn new(geometry: &Geometry, otfs: &[Vec<&dyn Fn(f64) -> f64>]) -> Self {
        let layout = *geometry.layout;
        let x = Axis::new(layout.cells_across(), geometry);
        let y = Axis::new(layout.cells_down(), geometry);
        let transfer = |otf: &&dyn Fn(f64) -> f64| Transfer::new(otf, geometry, &x, &y);
        let transfers = otfs.iter().map(|all| all.iter().map(transfer).collect()).collect();
        Self { layout, x, y, transfers }
    }

    /// Keeps the transfer functions at every frequency, for many pictures, unless that would take
    /// more memory than it is worth.
    pub fn kept(mut self) -> Self {
        let pairs = self.transfers.iter().map(Vec::len).sum::<usize>();
        if pairs * self.x.kept * self.y.kept * size_of::<f32>() <= VALUES {
            let all: Vec<&mut Transfer> = self.transfers.iter_mut().flatten().collect();
            all.into_par_iter().for_each(|transfer| transfer.keep(self.x.kept));
        }
        self
    }

    /// The outputs of these inputs, as [`blur`] gives them.
    ///
    /// # Errors
    /// Those of the scene, and values that are not finite.
    pub fn run(&self, sources: &[Source]) -> Result<Vec<Plane<f32>>> {
        let Self { layout, x, .. } = self;
        let batches = (layout.padded_width / 2 + 1).div_ceil(LANES);
        let empty = || (0..self.transfers.len()).map(|_| Split::zeros(layout.padded_height));
        let mut sums: Vec<Vec<Split>> = (0..batches).map(|_| empty().collect()).collect();
        for (input, source) in sources.iter().enumerate() {
            let spectrum = forward_rows(source, layout, x.kept)?;
            self.add_columns(&spectrum, input, &mut sums);
        }
        let backward = Fft::new(layout.padded_height);
        sums.par_iter_mut().for_each_init(
            || Split::zeros(layout.padded_height),
            |spare, outputs| outputs.iter_mut().for_each(|sum| backward.backward(sum, spare)),
        );
        Ok((0..self.transfers.len()).map(|out| backward_rows(&sums, out, layout)).collect())
    }
}

/// One direction of the cell grid.
struct Axis {
    /// Cells.
    cells: usize,
    /// Frequencies kept, from 0: all, but without the last of an even number of cells per pixel,
    /// whose pixel centres it has its zeros on.
    kept: usize,
    /// Per kept frequency cos and sin of the phase towards the pixel centre.
    phase: Vec<(f32, f32)>,
}

impl Axis {
    fn new(cells: usize, geometry: &Geometry) -> Self {
        let s = geometry.layout.oversample;
        let kept = cells / 2 + s % 2;
        let phase = |k: usize| {
            let (sin, cos) = libm::sincos(PI * (k * (s - 1)) as f64 / cells as f64);
            (cos as f32, sin as f32)
        };
        Self { cells, kept, phase: (0..kept).map(phase).collect() }
    }

    /// What each of `terms` samples of a transfer function, 1/`support` apart, adds to its value
    /// at every kept frequency, the sample at the negative frequency included.
    fn weights(&self, support: usize, terms: usize) -> Vec<Vec<f64>> {
        // sin πu below which u counts as a whole number, where the kernel is 1; neighbours are
        // 1e-6 away.
        const POLE: f64 = 1e-12;
        let turn = |n: usize, of: usize| libm::sincos(PI * (n % (2 * of)) as f64 / of as f64);
        let frequencies: Vec<(f64, f64)> = (0..self.kept).map(|k| turn(k, self.cells)).collect();
        // sin(πLu)/L at u = f, and but for the sign at f ± j/L.
        let wave = |k: usize| turn(k * support, self.cells).0 / support as f64;
        let waves: Vec<f64> = (0..self.kept).map(wave).collect();
        let weight = |k: usize, j: usize, (sin_j, cos_j): (f64, f64)| {
            let (sin, cos) = frequencies[k];
            let wave = if j.is_multiple_of(2) { waves[k] } else { -waves[k] };
            let dirichlet = |sine: f64| if sine.abs() < POLE { 1.0 } else { wave / sine };
            let mirrored = if j == 0 { 0.0 } else { dirichlet(sin * cos_j + cos * sin_j) };
            // The grid's Nyquist frequency is met twice, as positive and as negative one.
            let part = if 2 * k == self.cells { 0.5 } else { 1.0 };
            part * (dirichlet(sin * cos_j - cos * sin_j) + mirrored)
        };
        (0..terms)
            .map(|j| {
                let sample = turn(j, support);
                (0..self.kept).map(|k| weight(k, j, sample)).collect()
            })
            .collect()
    }
}

/// The transfer function T of the module's documentation.
struct Transfer {
    /// Samples along y.
    terms: usize,
    /// Per sample along y, its value at every kept frequency along x.
    samples: Vec<Vec<f32>>,
    /// Per kept frequency along y the weights of the samples.
    weights: Vec<f32>,
    /// Per kept frequency along y its values along x, where they are kept for many pictures.
    values: Option<Vec<f32>>,
}

impl Transfer {
    fn new(otf: &dyn Fn(f64) -> f64, geometry: &Geometry, x: &Axis, y: &Axis) -> Self {
        let layout = geometry.layout;
        let support = layout.support();
        let cell_mm = geometry.pitch_um * 1e-3 / layout.oversample as f64;
        let step = 1.0 / (support as f64 * cell_mm);
        let passed = (geometry.cutoff_per_mm / step).ceil() as usize;
        let terms = ((support - 1) / 2 + 1).min(passed).max(1);
        let gain = |k: usize| {
            let f = k as f64 * step;
            sinc(geometry.aperture_um * 1e-3 * f) / sinc(cell_mm * f)
        };
        let table: Vec<f64> = (0..terms * terms)
            .map(|k| {
                let (i, j) = (k / terms, k % terms);
                gain(i) * gain(j) * otf(step * (i as f64).hypot(j as f64))
            })
            .collect();
        let across = x.weights(support, terms);
        let samples = table.par_chunks(terms).map(|samples| {
            let mut row = vec![0.0f64; x.kept];
            for (sample, weights) in samples.iter().zip(&across) {
                row.iter_mut().zip(weights).for_each(|(sum, w)| *sum += sample * w);
            }
            row.into_iter().map(|v| v as f32).collect()
        });
        let samples: Vec<Vec<f32>> = samples.collect();
        let down = y.weights(support, terms);
        let weights = (0..y.kept).flat_map(|k| down.iter().map(move |w| w[k] as f32)).collect();
        Self { terms, samples, weights, values: None }
    }
}

impl Transfer {
    /// Tabulates its values at all frequencies, `across` of them along x.
    fn keep(&mut self, across: usize) {
        let mut values = vec![0.0f32; across * self.weights.len() / self.terms];
        let rows = values.chunks_exact_mut(across).zip(self.weights.chunks_exact(self.terms));
        for (row, weights) in rows {
            for (samples, weight) in self.samples.iter().zip(weights) {
                row.iter_mut().zip(samples).for_each(|(sum, v)| *sum += v * weight);
            }
        }
        self.values = Some(values);
    }

    /// Its values along y, for the horizontal frequencies that `at` takes from a row of them.
    #[inline(always)]
    fn along_y(&self, at: impl Fn(&[f32]) -> Lanes) -> Vec<Lanes> {
        if let Some(values) = &self.values {
            return values.chunks_exact(self.samples[0].len()).map(at).collect();
        }
        let samples: Vec<Lanes> = self.samples.iter().map(|row| at(row)).collect();
        let mut gains = Vec::with_capacity(self.weights.len() / self.terms);
        let groups = self.weights.chunks_exact(TOGETHER * self.terms);
        let rest = groups.remainder();
        for weights in groups {
            gains.extend(interpolated::<TOGETHER>(weights, &samples));
        }
        gains.extend(rest.chunks_exact(self.terms).flat_map(|w| interpolated::<1>(w, &samples)));
        gains
    }
}

fn forward_rows(source: &Source, layout: &Layout, kept: usize) -> Result<Spectrum> {
    let (across, down) = (layout.cells_across(), layout.cells_down());
    let fft = Fft::new(across);
    let mut spectrum =
        Spectrum { stride: kept, re: vec![0.0; kept * down], im: vec![0.0; kept * down] };
    let strips =
        spectrum.re.par_chunks_mut(STRIP * kept).zip(spectrum.im.par_chunks_mut(STRIP * kept));
    strips.enumerate().try_for_each_init(
        || (Split::zeros(across), Split::zeros(across)),
        |(data, scratch), (i, (re, im))| -> Result<()> {
            let rows = re.len() / kept;
            let strip = source.rows(i * STRIP, rows)?;
            if let Some(bad) = strip.data.iter().find(|v| !v.is_finite()) {
                return Err(Error::input(format!("the scene holds the radiance {bad}")).help(
                    "radiance must be finite; look for NaN or infinite values in the scene",
                ));
            }
            for first in (0..rows).step_by(BLOCK) {
                let count = BLOCK.min(rows - first);
                load_rows(&strip.data[first * across..(first + count) * across], data);
                fft.forward(data, scratch);
                let chunk = first * kept..(first + count) * kept;
                store_spectra(data, kept, &mut re[chunk.clone()], &mut im[chunk]);
            }
            Ok(())
        },
    )?;
    Ok(spectrum)
}

/// Up to 32 real rows into sixteen complex sequences.
fn load_rows(rows: &[f32], data: &mut Split) {
    let across = data.re.len();
    data.clear();
    for (r, row) in rows.chunks_exact(across).enumerate() {
        let part = if r < LANES { &mut data.re } else { &mut data.im };
        for (lanes, &v) in part.iter_mut().zip(row) {
            lanes.0[r % LANES] = v;
        }
    }
}

/// Takes the spectra of both rows of each sequence apart and stores their first `kept` values.
fn store_spectra(data: &Split, kept: usize, re: &mut [f32], im: &mut [f32]) {
    let n = data.re.len();
    let rows = re.len() / kept;
    for k in 0..kept {
        let mirror = if k == 0 { 0 } else { n - k };
        let (zr, zi, mr, mi) = (data.re[k], data.im[k], data.re[mirror], data.im[mirror]);
        for r in 0..rows {
            let l = r % LANES;
            let (a, b) = if r < LANES {
                (zr.0[l] + mr.0[l], zi.0[l] - mi.0[l])
            } else {
                (zi.0[l] + mi.0[l], mr.0[l] - zr.0[l])
            };
            re[r * kept + k] = 0.5 * a;
            im[r * kept + k] = 0.5 * b;
        }
    }
}

impl Blurs {
    /// Adds an input to the pixel grid's spectra: per batch of sixteen columns, of every output.
    fn add_columns(&self, spectrum: &Spectrum, input: usize, sums: &mut [Vec<Split>]) {
        let Self { layout, x, y, transfers } = self;
        let down = layout.cells_down();
        let forward = Fft::new(down);
        let outputs = layout.padded_width / 2 + 1;
        sums.par_iter_mut().enumerate().for_each_init(
            || (Split::zeros(down), Split::zeros(down)),
            |(data, scratch), (batch, sums)| {
                for alias in Alias::of_batch(batch * LANES, outputs, layout.padded_width, x.kept) {
                    load_columns(spectrum, &alias, data);
                    forward.forward(data, scratch);
                    for (sum, transfers) in sums.iter_mut().zip(transfers) {
                        fold(data, &alias, x, y, &transfers[input], sum);
                    }
                }
            },
        );
    }
}

/// Sixteen horizontal frequencies of the cell grid that fall on sixteen neighbouring ones of the
/// pixel grid: as they are, or as the mirror image of negative frequencies.
struct Alias {
    mirrored: bool,
    /// Frequency index of each lane; `None` where there is nothing.
    lanes: [Option<usize>; LANES],
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

fn load_columns(spectrum: &Spectrum, alias: &Alias, data: &mut Split) {
    let rows = data.re.len();
    let whole = match (alias.lanes[0], alias.lanes[LANES - 1]) {
        (Some(a), Some(b)) => Some(a.min(b)),
        _ => None,
    };
    for y in 0..rows {
        let at = y * spectrum.stride;
        for (source, target) in [(&spectrum.re, &mut data.re[y]), (&spectrum.im, &mut data.im[y])]
        {
            let row = &source[at..at + spectrum.stride];
            match whole {
                Some(k) => {
                    target.0.copy_from_slice(&row[k..k + LANES]);
                    if alias.mirrored {
                        target.0.reverse();
                    }
                }
                None => target.0 = alias.lanes.map(|k| k.map_or(0.0, |k| row[k])),
            }
        }
    }
}

/// Vertical frequencies whose transfer is computed together, to keep the processor's adders busy.
const TOGETHER: usize = 4;

/// Multiplies sixteen columns by the transfer function and adds them to the pixel grid's.
#[vectorised]
fn fold(data: &Split, alias: &Alias, x: &Axis, y: &Axis, transfer: &Transfer, folded: &mut Split) {
    let at = |values: &dyn Fn(usize) -> f32| {
        let mut out = Lanes::ZERO;
        for (o, k) in out.0.iter_mut().zip(&alias.lanes) {
            *o = k.map_or(0.0, values);
        }
        out
    };
    let (cx, sx) = (at(&|k| x.phase[k].0), at(&|k| x.phase[k].1));
    let gains = transfer.along_y(|row| at(&|k| row[k]));
    // The mirror image of X(kx, ky) is its conjugate at (−kx, −ky).
    let conjugate = if alias.mirrored { -1.0 } else { 1.0 };
    let pixels = folded.re.len();
    for (ky, gain) in gains.into_iter().enumerate() {
        let (cy, sy) = y.phase[ky];
        for negative in [false, true] {
            if negative && ky == 0 {
                continue;
            }
            let (row, sy) = if negative { (y.cells - ky, -sy) } else { (ky, sy) };
            let place = ky % pixels;
            let flipped = negative != alias.mirrored;
            let target = if flipped { (pixels - place) % pixels } else { place };
            // Transfer = gain · (cx + i·sx) · (cy + i·sy).
            let tr = gain.product(cx.times(cy).minus(sx.times(sy)));
            let ti = gain.product(cx.times(sy).plus(sx.times(cy)));
            let (zr, zi) = (data.re[row], data.im[row]);
            let re = zr.product(tr).minus(zi.product(ti));
            let im = zr.product(ti).plus(zi.product(tr)).times(conjugate);
            folded.re[target] = folded.re[target].plus(re);
            folded.im[target] = folded.im[target].plus(im);
        }
    }
}

/// Sums of samples by N rows of weights.
#[inline(always)]
fn interpolated<const N: usize>(weights: &[f32], samples: &[Lanes]) -> [Lanes; N] {
    let mut sums = [Lanes::ZERO; N];
    for (j, sample) in samples.iter().enumerate() {
        for (n, sum) in sums.iter_mut().enumerate() {
            *sum = sum.plus(sample.times(weights[n * samples.len() + j]));
        }
    }
    sums
}

/// The rows of an output, whose columns are back in space.
fn backward_rows(batches: &[Vec<Split>], output: usize, layout: &Layout) -> Plane<f32> {
    let (pixels, width) = (layout.padded_width, layout.width);
    let fft = Fft::new(pixels);
    let scale = (1.0 / (layout.cells_across() as f64 * layout.cells_down() as f64)) as f32;
    let left = layout.left();
    let mut plane = Plane::filled(width, layout.height, 0.0);
    plane.data.par_chunks_mut(BLOCK * width).enumerate().for_each_init(
        || (Split::zeros(pixels), Split::zeros(pixels)),
        |(data, scratch), (i, rows)| {
            data.clear();
            let count = rows.len() / width;
            for k in 0..=pixels / 2 {
                let (batch, lane) = (&batches[k / LANES][output], k % LANES);
                let mirror = if k == 0 { 0 } else { pixels - k };
                // 0 and the pixel grid's Nyquist frequency are real for real rows.
                let odd = if mirror == k { 0.0 } else { 1.0 };
                for r in 0..count {
                    let l = r % LANES;
                    let y = layout.top() + i * BLOCK + r;
                    let (re, im) = (batch.re[y].0[lane], odd * batch.im[y].0[lane]);
                    if r < LANES {
                        data.re[k].0[l] += re;
                        data.im[k].0[l] += im;
                    } else {
                        data.re[k].0[l] -= im;
                        data.im[k].0[l] += re;
                    }
                    if mirror != k {
                        if r < LANES {
                            data.re[mirror].0[l] += re;
                            data.im[mirror].0[l] -= im;
                        } else {
                            data.re[mirror].0[l] += im;
                            data.im[mirror].0[l] += re;
                        }
                    }
                }
            }
            fft.backward(data, scratch);
            for (r, row) in rows.chunks_exact_mut(width).enumerate() {
                let part = if r < LANES { &data.re } else { &data.im };
                for (value, lanes) in row.iter_mut().zip(&part[left..]) {
                    *value = scale * lanes.0[r % LANES];
                }
            }
        },
    );
    plane
}
