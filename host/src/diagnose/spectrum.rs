//! Power spectra of lines and of frames.

use realfft::num_complex::Complex;
use realfft::{RealFftPlanner, RealToComplex};
use rustfft::{Fft, FftPlanner};
use std::sync::Arc;

/// Power of lines of one length.
pub struct Spectrum {
    plan: Arc<dyn RealToComplex<f64>>,
    line: Vec<f64>,
    out: Vec<Complex<f64>>,
}

impl Spectrum {
    /// For lines of `length` samples.
    pub fn new(length: usize) -> Self {
        let plan = RealFftPlanner::new().plan_fft_forward(length);
        Self { line: plan.make_input_vec(), out: plan.make_output_vec(), plan }
    }

    /// Adds |F_k|²/n, k from 1, of a line to `power`: a white line of variance v adds v to each.
    pub fn add(&mut self, line: &[f64], power: &mut [f64]) {
        self.line.copy_from_slice(line);
        // Lengths are those of the plan, so this cannot fail.
        let _ = self.plan.process(&mut self.line, &mut self.out);
        let n = line.len() as f64;
        power.iter_mut().zip(&self.out[1..]).for_each(|(p, f)| *p += f.norm_sqr() / n);
    }

    /// |F_k|²/n, k from 1, of one line.
    pub fn of(line: &[f64]) -> Vec<f64> {
        let mut power = vec![0.0; line.len() / 2];
        Self::new(line.len()).add(line, &mut power);
        power
    }
}

/// Power of frames of one size over two frequencies.
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
            rows: RealFftPlanner::new().plan_fft_forward(width),
            columns: FftPlanner::new().plan_fft_forward(height),
            half: vec![Complex::default(); (width / 2 + 1) * height],
        }
    }

    /// Adds |F|²/(w h) of a frame to `power`, laid out as `height` rows (frequency along a column, wrapped) of
    /// `width`/2 + 1 (frequency along a row): white pixels of variance v add v to each.
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
