//! Power spectra of lines and frames.

use camrig_base::median::median;
use camrig_fourier::plans::{Complex, Fft, RealToComplex, forward, real_forward};
use std::sync::Arc;

/// Power spectra of lines of one length.
pub struct Spectrum {
    plan: Arc<dyn RealToComplex<f32>>,
    line: Vec<f32>,
    out: Vec<Complex<f32>>,
}

impl Spectrum {
    /// For lines of `length` samples.
    pub fn new(length: usize) -> Self {
        let plan = real_forward(length);
        Self { line: plan.make_input_vec(), out: plan.make_output_vec(), plan }
    }

    /// Adds |F_k|²/n, k from 1, of a line to `power`: white noise of variance v adds v to each bin.
    pub fn add(&mut self, line: &[f64], power: &mut [f64]) {
        let n = line.len() as f64;
        // Without the mean, which is no part of these bins, f32 resolves 1e-7 of the scatter.
        let mean = line.iter().sum::<f64>() / n;
        self.line.iter_mut().zip(line).for_each(|(to, from)| *to = (from - mean) as f32);
        // Lengths are those of the plan, so this cannot fail.
        let _ = self.plan.process(&mut self.line, &mut self.out);
        let added = |f: &Complex<f32>| f64::from(f.norm_sqr()) / n;
        power.iter_mut().zip(&self.out[1..]).for_each(|(p, f)| *p += added(f));
    }

    /// |F_k|²/n, k from 1, of one line.
    pub fn of(line: &[f64]) -> Vec<f64> {
        let mut power = vec![0.0; line.len() / 2];
        Self::new(line.len()).add(line, &mut power);
        power
    }
}

/// Two-dimensional power spectra of frames of one size.
pub struct Spectrum2 {
    width: usize,
    height: usize,
    rows: Arc<dyn RealToComplex<f32>>,
    columns: Arc<dyn Fft<f32>>,
    /// The half spectrum, column after column.
    half: Vec<Complex<f32>>,
}

impl Spectrum2 {
    /// For frames of this size.
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            rows: real_forward(width),
            columns: forward(height),
            half: vec![Complex::default(); (width / 2 + 1) * height],
        }
    }

    /// Adds |F|²/(w h) of a frame to `power`, laid out as `height` rows (frequency along a column,
    /// wrapped) of `width`/2 + 1 (frequency along a row): white noise of variance v adds v to
    /// each bin.
    pub fn add(&mut self, frame: &[f32], power: &mut [f32]) {
        let (w, h) = (self.width, self.height);
        let (mut line, mut out) = (self.rows.make_input_vec(), self.rows.make_output_vec());
        for (y, row) in frame.chunks(w).enumerate() {
            line.copy_from_slice(row);
            // Lengths are those of the plan, so this cannot fail.
            let _ = self.rows.process(&mut line, &mut out);
            for (x, f) in out.iter().enumerate() {
                self.half[x * h + y] = *f;
            }
        }
        self.columns.process(&mut self.half);
        let scale = 1.0 / (w * h) as f32;
        for (x, column) in self.half.chunks(h).enumerate() {
            for (y, f) in column.iter().enumerate() {
                power[y * (w / 2 + 1) + x] += f.norm_sqr() * scale;
            }
        }
    }
}

/// The continuum of a two-dimensional power spectrum in the layout of [`Spectrum2`]: the larger of
/// the median of each bin's tile and that of all bins. Spectral lines are relative to it.
pub struct Background {
    /// Bins along a row.
    width: usize,
    height: usize,
    /// Tiles along a row and along a column.
    across: usize,
    down: usize,
    tiles: Vec<f32>,
}

impl Background {
    /// Side of a tile, bins: large enough that a line and its leakage are few of them.
    const SIDE: usize = 8;

    /// Of the power spectrum of frames with `columns` columns.
    pub fn of(power: &[f32], columns: usize) -> Self {
        let width = columns / 2 + 1;
        let height = power.len() / width;
        let (across, down) = ((width / Self::SIDE).max(1), (height / Self::SIDE).max(1));
        let all = median(&mut power.to_vec(), f32::total_cmp);
        let side = |i: usize, tiles: usize, n: usize| i * n / tiles..(i + 1) * n / tiles;
        let mut bins = Vec::with_capacity(4 * Self::SIDE * Self::SIDE);
        let tiles = (0..across * down).map(|i| {
            bins.clear();
            for row in side(i / across, down, height) {
                bins.extend_from_slice(&power[row * width..][side(i % across, across, width)]);
            }
            median(&mut bins, f32::total_cmp).max(all)
        });
        let tiles = tiles.collect();
        Self { width, height, across, down, tiles }
    }

    /// At a bin.
    pub fn at(&self, bin: usize) -> f32 {
        // The tile whose bounds, rounded down, enclose the bin.
        let tile = |at: usize, tiles: usize, n: usize| ((at + 1) * tiles - 1) / n;
        let (x, y) = (bin % self.width, bin / self.width);
        let row = tile(y, self.down, self.height);
        self.tiles[row * self.across + tile(x, self.across, self.width)]
    }

    /// The bin of a power spectrum that is highest relative to it, and this ratio.
    pub fn highest(&self, power: &[f32]) -> (usize, f32) {
        let over = power.iter().enumerate().map(|(i, p)| (i, p / self.at(i)));
        over.fold((0, 0.0), |a, b| if b.1 > a.1 { b } else { a })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_found_on_a_continuum() {
        let (columns, height) = (256, 192);
        let width = columns / 2 + 1;
        // A peak at low frequencies of a hundred times the rest, and a line of a tenth of it
        // elsewhere.
        let mut power: Vec<f32> = (0..width * height)
            .map(|i| {
                let (k, l) = (i % width, i / width);
                let l = l.min(height - l);
                1.0 + 100.0 * (-((k * k + l * l) as f32) / 800.0).exp()
            })
            .collect();
        let at = 100 * width + 90;
        power[at] = 10.0;
        let background = Background::of(&power, columns);
        let (bin, times) = background.highest(&power);
        assert_eq!(bin, at);
        assert!((times - 10.0).abs() < 0.1, "{times}");
        // Every bin is assigned to the tile whose median includes it.
        for i in (0..width).chain((0..height).map(|l| l * width + 128)) {
            let (x, y) = (i % width, i / width);
            let (tx, ty) = (16, 24);
            let within = |at: usize, n: usize, tiles: usize| {
                (0..tiles).find(|t| (t * n / tiles..(t + 1) * n / tiles).contains(&at)).unwrap()
            };
            let tile = within(y, height, ty) * tx + within(x, width, tx);
            assert_eq!(background.at(i), background.tiles[tile], "{x} {y}");
        }
    }
}
