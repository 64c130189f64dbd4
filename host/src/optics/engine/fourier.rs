//! Blur by one optical transfer function, pixel aperture and decimation, in the Fourier domain.
//!
//! The padded cell grid is transformed (rows, then columns up to the cut-off), multiplied by
//! OTF(|f|)·sinc(a·fx)/sinc(h·fx)·sinc(a·fy)/sinc(h·fy) and by the phase that moves from cell centres
//! to pixel centres, folded onto the pixel grid's frequencies (sampling at pixel centres *is* folding,
//! so the real pixel's aliasing is kept) and transformed back at pixel size.
//! The cells' own Nyquist bins are dropped: half a cell's shift has no meaning for them.

use super::super::fft::{Fft, LANES, Lanes, Split};
use super::sampling::{Layout, sinc};
use super::source::Source;
use crate::{Error, Plane, Result};
use multiversion::multiversion;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Two rows share one complex transform: the first sixteen as real parts, the next as imaginary.
const BLOCK: usize = 2 * LANES;
/// Rows asked of the scene at once.
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

/// Spectrum of the padded cell grid: `stride` horizontal frequencies for each row, then each column.
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
    let layout = geometry.layout;
    let x = Axis::new(layout.cells_across(), layout.padded_width, geometry);
    let y = Axis::new(layout.cells_down(), layout.padded_height, geometry);
    let spectrum = forward_rows(source, layout, x.kept)?;
    let radial = RadialOtf::new(otf, geometry.cutoff_per_mm);
    let batches = columns(&spectrum, layout, &x, &y, &radial);
    Ok(backward_rows(&batches, layout))
}

/// One direction of the cell grid: per kept frequency its value, gain and phase.
struct Axis {
    /// Frequencies kept, from 0.
    kept: usize,
    /// Cycles/mm.
    frequency: Vec<f32>,
    /// sinc(a·f)/sinc(h·f) times cos and sin of the phase towards the pixel centre.
    gain: Vec<(f32, f32)>,
}

impl Axis {
    fn new(cells: usize, pixels: usize, geometry: &Geometry) -> Self {
        let s = (cells / pixels) as f64;
        let cell_mm = geometry.pitch_um * 1e-3 / s;
        let step = 1.0 / (cells as f64 * cell_mm);
        let kept =
            ((cells - 1) / 2 + 1).min((geometry.cutoff_per_mm / step).ceil() as usize).max(1);
        let gain = |k: usize| {
            let f = k as f64 * step;
            let ratio = sinc(geometry.aperture_um * 1e-3 * f) / sinc(cell_mm * f);
            let (sin, cos) = libm::sincos(PI * k as f64 * (s - 1.0) / cells as f64);
            ((ratio * cos) as f32, (ratio * sin) as f32)
        };
        Self {
            kept,
            frequency: (0..kept).map(|k| (k as f64 * step) as f32).collect(),
            gain: (0..kept).map(gain).collect(),
        }
    }
}

/// The OTF over frequency, linear between 4096 samples up to the cut-off.
struct RadialOtf {
    per_frequency: f32,
    values: Vec<f32>,
}

impl RadialOtf {
    const STEPS: usize = 4096;

    fn new(otf: &dyn Fn(f64) -> f64, cutoff: f64) -> Self {
        let at = |i: usize| {
            if i < Self::STEPS { otf(cutoff * i as f64 / Self::STEPS as f64) } else { 0.0 }
        };
        Self {
            per_frequency: (Self::STEPS as f64 / cutoff) as f32,
            values: (0..Self::STEPS + 2).map(|i| at(i) as f32).collect(),
        }
    }

    #[inline(always)]
    fn at(&self, frequency: f32) -> f32 {
        let t = (frequency * self.per_frequency).min(Self::STEPS as f32);
        let i = (t as usize).min(Self::STEPS);
        self.values[i] + (t - i as f32) * (self.values[i + 1] - self.values[i])
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

/// Sixteen output columns: after the backward column transform, `height` rows of the frame.
type Batch = Split;

fn columns(
    spectrum: &Spectrum,
    layout: &Layout,
    x: &Axis,
    y: &Axis,
    otf: &RadialOtf,
) -> Vec<Batch> {
    let (down, pixels) = (layout.cells_down(), layout.padded_height);
    let (forward, backward) = (Fft::new(down), Fft::new(pixels));
    let outputs = layout.padded_width / 2 + 1;
    (0..outputs.div_ceil(LANES))
        .into_par_iter()
        .map_init(
            || (Split::zeros(down), Split::zeros(down), Split::zeros(pixels), Split::zeros(pixels)),
            |(data, scratch, folded, spare), batch| {
                folded.clear();
                for alias in Alias::of_batch(batch * LANES, outputs, layout.padded_width, x.kept) {
                    load_columns(spectrum, &alias, data);
                    forward.forward(data, scratch);
                    fold(data, &alias, x, y, otf, folded);
                }
                backward.backward(folded, spare);
                let rows = layout.top()..layout.top() + layout.height;
                Split { re: folded.re[rows.clone()].to_vec(), im: folded.im[rows].to_vec() }
            },
        )
        .collect()
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
        for (source, target) in [(&spectrum.re, &mut data.re[y]), (&spectrum.im, &mut data.im[y])] {
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

/// Multiplies sixteen columns by the transfer function and adds them to the pixel grid's.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx+avx2"))]
fn fold(data: &Split, alias: &Alias, x: &Axis, y: &Axis, otf: &RadialOtf, folded: &mut Split) {
    let (cells, pixels) = (data.re.len(), folded.re.len());
    let at = |values: &dyn Fn(usize) -> f32| Lanes(alias.lanes.map(|k| k.map_or(0.0, values)));
    let (fx, cx, sx) = (at(&|k| x.frequency[k]), at(&|k| x.gain[k].0), at(&|k| x.gain[k].1));
    // The mirror image of X(kx, ky) is its conjugate at (−kx, −ky).
    let conjugate = if alias.mirrored { -1.0 } else { 1.0 };
    for ky in 0..y.kept {
        let (fy, (cy, sy)) = (y.frequency[ky], y.gain[ky]);
        let mut gain = Lanes::ZERO;
        for (g, fx) in gain.0.iter_mut().zip(fx.0) {
            *g = otf.at((fx * fx + fy * fy).sqrt());
        }
        for negative in [false, true] {
            if negative && ky == 0 {
                continue;
            }
            let (row, sy) = if negative { (cells - ky, -sy) } else { (ky, sy) };
            let place = ky % pixels;
            let target = if negative != alias.mirrored { (pixels - place) % pixels } else { place };
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

fn backward_rows(batches: &[Batch], layout: &Layout) -> Plane<f32> {
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
                let (batch, lane) = (&batches[k / LANES], k % LANES);
                let mirror = if k == 0 { 0 } else { pixels - k };
                // 0 and the pixel grid's Nyquist frequency are real for real rows.
                let odd = if mirror == k { 0.0 } else { 1.0 };
                for r in 0..count {
                    let l = r % LANES;
                    let y = i * BLOCK + r;
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
