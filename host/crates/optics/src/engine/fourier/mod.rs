//! Blur by one optical transfer function, pixel aperture and decimation, in the Fourier domain.
//!
//! The padded cell grid is transformed (rows, then columns), multiplied by a transfer function and
//! by the phase that moves from cell centres to pixel centres, folded onto the pixel grid's
//! frequencies (sampling at pixel centres *is* folding, so the real pixel's aliasing is kept) and
//! transformed back at pixel size.
//!
//! The transfer function is that of a [`Kernel`] of finite support, so that nothing wraps around:
//! the margin holds the whole kernel, which makes the cyclic convolution a linear one.

mod kernel;
mod pixels;
mod spectrum;
mod transfer;

use super::SensorGrid;
use super::sampling::Layout;
use super::source::Rows;
use camrig_base::{Error, Plane, Result};
use camrig_fourier::lanes::{Fft, Lanes, Real, Split};
use camrig_vector::vectorised;
pub use kernel::Kernel;
use rayon::prelude::*;
use spectrum::{Alias, Aliases, Spectrum};
use std::sync::OnceLock;
use transfer::{Axis, Transfer};

/// The spatial side of one band: sizes in µm, frequencies in cycles/mm.
pub struct Geometry<'a> {
    /// Padded grids.
    pub layout: &'a Layout,
    /// Pixel pitch, µm.
    pub pitch_um: f64,
    /// Side of the photosensitive square, µm.
    pub aperture_um: f64,
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
pub struct Buffers {
    narrow: Spectrum<f32>,
    wide: Spectrum<f64>,
}

/// Blurs the cells of `rows` through a kernel: mean radiance over each pixel's photosensitive
/// square.
///
/// # Errors
/// Those of the scene, and values that are not finite.
pub fn blur(
    rows: &Rows<'_>,
    kernel: Kernel,
    layout: &Layout,
    buffers: &mut Buffers,
) -> Result<Plane<f32>> {
    let blurs = Blurs::new(layout, vec![vec![kernel]]);
    Ok(blurs.run(&[rows], buffers)?.remove(0))
}

/// Blur of several inputs into several outputs, each pair by a transfer function of its own:
/// inputs are transformed once, and so are outputs.
pub struct Blurs {
    layout: Layout,
    aliases: Aliases,
    /// Per output, of every input.
    kernels: Vec<Vec<Kernel>>,
    narrow: Transfers<f32>,
    /// For scenes of wide range, once there is one.
    wide: OnceLock<Transfers<f64>>,
    kept: bool,
}

/// The kernels' transfer functions in one arithmetic.
struct Transfers<T> {
    x: Axis<T>,
    y: Axis<T>,
    /// Per output, of every input.
    all: Vec<Vec<Transfer<T>>>,
}

impl<T: Real> Transfers<T> {
    fn new(layout: &Layout, kernels: &[Vec<Kernel>]) -> Self {
        let x = Axis::new(layout.cells_across(), layout);
        let y = Axis::new(layout.cells_down(), layout);
        let of_output = |all: &Vec<Kernel>| all.iter().map(|k| Transfer::new(k, &x)).collect();
        let all = kernels.iter().map(of_output).collect();
        Self { x, y, all }
    }

    /// Keeps their values at every frequency, for many pictures, unless that would take more
    /// memory than it is worth.
    fn keep(&mut self, aliases: &Aliases) {
        let pairs = self.all.iter().map(Vec::len).sum::<usize>();
        if pairs * self.x.kept * self.y.kept * size_of::<T>() <= VALUES {
            let all = self.all.iter_mut().flatten();
            all.for_each(|transfer| transfer.keep(aliases, &self.y));
        }
    }
}

impl Blurs {
    /// Plans blurs; there is for every output one kernel per input.
    pub fn new(layout: &Layout, kernels: Vec<Vec<Kernel>>) -> Self {
        let aliases = Aliases::new(layout, transfer::kept(layout.cells_across(), layout));
        let narrow = Transfers::new(layout, &kernels);
        Self { layout: *layout, aliases, kernels, narrow, wide: OnceLock::new(), kept: false }
    }

    /// Keeps the transfer functions at every frequency, for many pictures, where there is room.
    pub fn kept(mut self) -> Self {
        self.kept = true;
        self.narrow.keep(&self.aliases);
        self
    }

    /// The outputs of these inputs, as [`blur`] gives them; in f64 where the inputs have a wide
    /// [`range`](super::range).
    ///
    /// # Errors
    /// Those of the scene, and values that are not finite.
    pub fn run<R>(&self, inputs: &[R], buffers: &mut Buffers) -> Result<Vec<Plane<f32>>>
    where
        R: Fn(usize, usize) -> Result<Plane<f32>> + Sync,
    {
        let inputs: Vec<&Rows<'_>> = inputs.iter().map(|rows| rows as &Rows<'_>).collect();
        let inputs = inputs.as_slice();
        if let Some(planes) = self.through(&self.narrow, inputs, &mut buffers.narrow, false)? {
            return Ok(planes);
        }
        let wide = self.wide.get_or_init(|| {
            let mut wide = Transfers::new(&self.layout, &self.kernels);
            if self.kept {
                wide.keep(&self.aliases);
            }
            wide
        });
        let planes = self.through(wide, inputs, &mut buffers.wide, true)?;
        planes.ok_or_else(|| Error::internal("no arithmetic for a scene"))
    }

    /// The outputs, or nothing where an input has a wider range than is accepted.
    fn through<T: Real>(
        &self,
        transfers: &Transfers<T>,
        inputs: &[&Rows<'_>],
        spectrum: &mut Spectrum<T>,
        accepts_wide: bool,
    ) -> Result<Option<Vec<Plane<f32>>>> {
        let Self { layout, aliases, .. } = self;
        let outputs = 0..transfers.all.len();
        let empty = || outputs.clone().map(|_| Split::zeros(layout.padded_height)).collect();
        let mut sums: Vec<Vec<Split<T>>> = aliases.batches.iter().map(|_| empty()).collect();
        for (input, rows) in inputs.iter().enumerate() {
            let range = spectrum.fill(rows, aliases, layout)?;
            if range.is_wide() && !accepts_wide {
                return Ok(None);
            }
            self.add_columns(transfers, spectrum, input, &mut sums);
        }
        let backward = Fft::<T>::new(layout.padded_height);
        sums.par_iter_mut().for_each_init(
            || Split::zeros(layout.padded_height),
            |spare, outputs| outputs.iter_mut().for_each(|sum| backward.backward(sum, spare)),
        );
        Ok(Some(outputs.map(|out| pixels::frame(&sums, out, layout)).collect()))
    }

    /// Adds an input to the pixel grid's spectra: per batch of sixteen columns, of every output.
    fn add_columns<T: Real>(
        &self,
        transfers: &Transfers<T>,
        spectrum: &Spectrum<T>,
        input: usize,
        sums: &mut [Vec<Split<T>>],
    ) {
        let (Self { layout, aliases, .. }, Transfers { x, y, all }) = (self, transfers);
        let down = layout.cells_down();
        let forward = Fft::<T>::new(down);
        let kept = all.iter().all(|inputs| inputs[input].is_kept());
        let gains = || Split::zeros(if kept { 0 } else { down });
        sums.par_iter_mut().zip(&aliases.batches).for_each_init(
            || (Split::zeros(down), Split::zeros(down), vec![gains(); all.len()]),
            |(data, scratch, gains), (sums, batch)| {
                for (n, i) in batch.clone().enumerate() {
                    spectrum.columns(i, aliases, data);
                    forward.forward(data, scratch);
                    for ((sum, of_output), gains) in sums.iter_mut().zip(all).zip(&mut *gains) {
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
fn fold<T: Real>(
    data: &Split<T>,
    alias: &Alias,
    (x, y): (&Axis<T>, &Axis<T>),
    gains: &[Lanes<T>],
    folded: &mut Split<T>,
) {
    let at = |values: &dyn Fn(usize) -> T| {
        let mut out = Lanes::<T>::ZERO;
        for (o, k) in out.0.iter_mut().zip(&alias.lanes) {
            *o = k.map_or(T::ZERO, values);
        }
        out
    };
    let (cx, sx) = (at(&|k| x.phase[k].0), at(&|k| x.phase[k].1));
    // The mirror image of X(kx, ky) is its conjugate at (−kx, −ky).
    let conjugate = T::of(if alias.mirrored { -1.0 } else { 1.0 });
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
