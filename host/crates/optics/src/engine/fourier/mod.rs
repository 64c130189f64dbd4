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

mod pixels;
mod spectrum;
mod transfer;

use super::SensorGrid;
use super::sampling::Layout;
use super::source::Source;
use camrig_base::{Plane, Result};
use camrig_fourier::lanes::{Fft, Lanes, Split};
use camrig_vector::vectorised;
use rayon::prelude::*;
use spectrum::{Alias, Aliases, Spectrum};
use transfer::{Axis, Transfer};

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

/// Bytes that the values of transfer functions may take that are kept.
const VALUES: usize = 256 << 20;

/// Memory that is kept from picture to picture.
#[derive(Default)]
pub struct Buffers(Spectrum);

/// Renders `source` through an OTF: mean radiance over each pixel's photosensitive square.
///
/// # Errors
/// Those of the scene, and values that are not finite.
pub fn blur(
    source: &Source,
    geometry: &Geometry,
    otf: &dyn Fn(f64) -> f64,
    buffers: &mut Buffers,
) -> Result<Plane<f32>> {
    let blurs = Blurs::new(geometry, &[vec![otf]]);
    Ok(blurs.run(std::slice::from_ref(source), buffers)?.remove(0))
}

/// Blur of several inputs into several outputs, each pair by a transfer function of its own:
/// inputs are transformed once, and so are outputs.
pub struct Blurs {
    layout: Layout,
    x: Axis,
    y: Axis,
    aliases: Aliases,
    /// Per output, of every input.
    transfers: Vec<Vec<Transfer>>,
}

impl Blurs {
    /// Plans the blurs of a geometry; `otfs` has for every output one function per input.
    pub fn new(geometry: &Geometry, otfs: &[Vec<&dyn Fn(f64) -> f64>]) -> Self {
        let layout = *geometry.layout;
        let x = Axis::new(layout.cells_across(), geometry);
        let y = Axis::new(layout.cells_down(), geometry);
        let aliases = Aliases::new(&layout, &x);
        let transfer = |otf: &&dyn Fn(f64) -> f64| Transfer::new(otf, geometry, &x);
        let transfers = otfs.iter().map(|all| all.iter().map(transfer).collect()).collect();
        Self { layout, x, y, aliases, transfers }
    }

    /// Keeps the transfer functions at every frequency, for many pictures, unless that would take
    /// more memory than it is worth.
    pub fn kept(mut self) -> Self {
        let pairs = self.transfers.iter().map(Vec::len).sum::<usize>();
        if pairs * self.x.kept * self.y.kept * size_of::<f32>() <= VALUES {
            let all = self.transfers.iter_mut().flatten();
            all.for_each(|transfer| transfer.keep(&self.aliases, &self.y));
        }
        self
    }

    /// The outputs of these inputs, as [`blur`] gives them.
    ///
    /// # Errors
    /// Those of the scene, and values that are not finite.
    pub fn run(&self, sources: &[Source], buffers: &mut Buffers) -> Result<Vec<Plane<f32>>> {
        let Self { layout, aliases, .. } = self;
        let Buffers(spectrum) = buffers;
        let outputs = 0..self.transfers.len();
        let empty = || outputs.clone().map(|_| Split::zeros(layout.padded_height)).collect();
        let mut sums: Vec<Vec<Split>> = aliases.batches.iter().map(|_| empty()).collect();
        for (input, source) in sources.iter().enumerate() {
            spectrum.fill(source, aliases, layout)?;
            self.add_columns(spectrum, input, &mut sums);
        }
        let backward = Fft::new(layout.padded_height);
        sums.par_iter_mut().for_each_init(
            || Split::zeros(layout.padded_height),
            |spare, outputs| outputs.iter_mut().for_each(|sum| backward.backward(sum, spare)),
        );
        Ok(outputs.map(|out| pixels::frame(&sums, out, layout)).collect())
    }

    /// Adds an input to the pixel grid's spectra: per batch of sixteen columns, of every output.
    fn add_columns(&self, spectrum: &Spectrum, input: usize, sums: &mut [Vec<Split>]) {
        let Self { layout, x, y, aliases, transfers } = self;
        let down = layout.cells_down();
        let forward = Fft::new(down);
        let kept = transfers.iter().all(|inputs| inputs[input].is_kept());
        let gains = || Split::zeros(if kept { 0 } else { down });
        sums.par_iter_mut().zip(&aliases.batches).for_each_init(
            || (Split::zeros(down), Split::zeros(down), vec![gains(); transfers.len()]),
            |(data, scratch, gains), (sums, batch)| {
                for (n, i) in batch.clone().enumerate() {
                    spectrum.columns(i, aliases, data);
                    forward.forward(data, scratch);
                    for ((sum, of_output), gains) in
                        sums.iter_mut().zip(transfers).zip(&mut *gains)
                    {
                        let transfer = &of_output[input];
                        let gains = transfer.kept(i, y).unwrap_or_else(|| {
                            if n % 2 == 0 {
                                let pair = &aliases.all[i..batch.end.min(i + 2)];
                                transfer.along_y(pair, y, gains, scratch);
                            }
                            if n % 2 == 0 { &gains.re } else { &gains.im }
                        });
                        fold(data, &aliases.all[i], (x, y), gains, sum);
                    }
                }
            },
        );
    }
}

/// Multiplies sixteen columns by `gains`, the transfer function at every kept frequency along y,
/// and adds them to the pixel grid's.
#[vectorised]
fn fold(data: &Split, alias: &Alias, (x, y): (&Axis, &Axis), gains: &[Lanes], folded: &mut Split) {
    let at = |values: &dyn Fn(usize) -> f32| {
        let mut out = Lanes::ZERO;
        for (o, k) in out.0.iter_mut().zip(&alias.lanes) {
            *o = k.map_or(0.0, values);
        }
        out
    };
    let (cx, sx) = (at(&|k| x.phase[k].0), at(&|k| x.phase[k].1));
    // The mirror image of X(kx, ky) is its conjugate at (−kx, −ky).
    let conjugate = if alias.mirrored { -1.0 } else { 1.0 };
    let pixels = folded.re.len();
    for (ky, (gain, &(cy, sy))) in gains.iter().zip(&y.phase).enumerate() {
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
