//! Spectrograms and histograms of a mean frame (EMVA 1288 R4, sections 8.3 to 8.5).

use super::stack::Site;
use crate::{Error, Result};
use realfft::RealFftPlanner;
use serde::Serialize;

/// Mean power spectra of a plane along rows and columns; frequencies from 0 to 0.5 cycles per
/// sample of the plane in equal steps. The units are those of the plane, squared; white noise of
/// variance σ² has a flat spectrum at σ².
#[derive(Clone, Debug, Serialize)]
pub struct Spectrogram {
    /// Along rows, averaged over rows.
    pub horizontal: Vec<f64>,
    /// Along columns, averaged over columns.
    pub vertical: Vec<f64>,
}

/// Values of one site as a plane of its own, row-major.
pub struct SitePlane {
    /// Columns.
    pub columns: usize,
    /// Rows.
    pub rows: usize,
    /// Values.
    pub data: Vec<f64>,
}

impl SitePlane {
    /// The values of `site` of a frame `width` x `height`.
    pub fn of(
        site: Site,
        width: usize,
        height: usize,
        value: impl Fn(usize, usize) -> f64,
    ) -> Self {
        let (columns, rows) = (site.columns(width), site.rows(height));
        let mut data = Vec::with_capacity(columns * rows);
        for y in (site.y0..height).step_by(site.step_y) {
            data.extend((site.x0..width).step_by(site.step_x).map(|x| value(x, y)));
        }
        Self { columns, rows, data }
    }

    fn mean(&self) -> f64 {
        self.data.iter().sum::<f64>() / self.data.len() as f64
    }

    /// Spectra along rows and columns, the plane's mean taken out.
    ///
    /// # Errors
    /// None but what the transform refuses.
    pub fn spectrogram(&self) -> Result<Spectrogram> {
        let mean = self.mean();
        let along = |lines: usize, length: usize, at: &dyn Fn(usize, usize) -> usize| {
            let plan = RealFftPlanner::<f64>::new().plan_fft_forward(length);
            let (mut line, mut out) = (plan.make_input_vec(), plan.make_output_vec());
            let mut power = vec![0.0; length / 2 + 1];
            for l in 0..lines {
                for (i, v) in line.iter_mut().enumerate() {
                    *v = self.data[at(l, i)] - mean;
                }
                plan.process(&mut line, &mut out)
                    .map_err(|e| Error::input(format!("Fourier transform: {e}")))?;
                for (p, v) in power.iter_mut().zip(&out) {
                    *p += v.norm_sqr() / (length * lines) as f64;
                }
            }
            Ok(power)
        };
        Ok(Spectrogram {
            horizontal: along(self.rows, self.columns, &|l, i| l * self.columns + i)?,
            vertical: along(self.columns, self.rows, &|l, i| i * self.columns + l)?,
        })
    }

    /// What is left of the plane without its mean over 5 x 5 samples (the standard's high-pass);
    /// two samples are lost at every border.
    #[must_use]
    pub fn high_pass(&self) -> Vec<f64> {
        let mut out = Vec::new();
        for y in 2..self.rows.saturating_sub(2) {
            for x in 2..self.columns.saturating_sub(2) {
                let mut sum = 0.0;
                for row in self.data.chunks(self.columns).skip(y - 2).take(5) {
                    sum += row[x - 2..=x + 2].iter().sum::<f64>();
                }
                out.push(self.data[y * self.columns + x] - sum / 25.0);
            }
        }
        out
    }
}

/// Logarithmic histogram's data: values around zero, and how many pixels lie far out.
#[derive(Clone, Debug, Serialize)]
pub struct Histogram {
    /// Left end of the first bin.
    pub start: f64,
    /// Width of a bin.
    pub step: f64,
    /// Counts.
    pub counts: Vec<u64>,
    /// Standard deviation from the quartiles: what a Gaussian core has.
    pub core_sigma: f64,
    /// Values more than five core standard deviations from the median.
    pub outliers: u64,
    /// Values in all.
    pub values: u64,
}

impl Histogram {
    /// Of at most 256 bins.
    pub fn of(values: &[f64]) -> Self {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let at = |q: f64| sorted[((sorted.len() - 1) as f64 * q) as usize];
        if sorted.is_empty() {
            let counts = Vec::new();
            return Self { start: 0.0, step: 0.0, counts, core_sigma: 0.0, outliers: 0, values: 0 };
        }
        let (low, high, median) = (at(0.0), at(1.0), at(0.5));
        // A Gaussian's quartiles lie 0.6745 standard deviations from its median.
        let core_sigma = (at(0.75) - at(0.25)) / (2.0 * 0.674_489_75);
        let step = if high > low { (high - low) / 255.0 } else { 1.0 };
        let mut counts = vec![0u64; if high > low { 256 } else { 1 }];
        for v in &sorted {
            counts[((v - low) / step) as usize] += 1;
        }
        let far = |v: &&f64| (**v - median).abs() > 5.0 * core_sigma && core_sigma > 0.0;
        Self {
            start: low,
            step,
            outliers: sorted.iter().filter(far).count() as u64,
            core_sigma,
            values: sorted.len() as u64,
            counts,
        }
    }
}
