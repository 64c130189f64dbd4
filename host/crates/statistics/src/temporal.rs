//! Moments over time of one stack of frames, streamed in batches.
//!
//! Residuals are relative to the mean of their own batch, and are divided into components of frame,
//! row, column and pixel. Sums are divided by the degrees of freedom that the batches' means leave.

use crate::numerics::lanes;
use crate::numerics::spectrum::{Spectrum, Spectrum2};
use camrig_base::Plane;
use camrig_sensor_core::config::Pattern;
use camrig_vector::vectorised;

/// Side of the blocks whose means show large-scale noise, pixels.
pub const BLOCK: usize = 8;
/// Distances in columns and rows of the neighbours whose covariance is computed.
pub const LAGS: [(isize, usize); 6] = [(1, 0), (0, 1), (1, 1), (-1, 1), (2, 0), (0, 2)];

/// Moments of a stack, in DN and its powers.
#[derive(Clone, Debug)]
pub struct Temporal {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Frames.
    pub frames: usize,
    /// Degrees of freedom: the number of frames minus one for each batch.
    pub dof: f64,
    /// Mean frame.
    pub mean: Plane<f32>,
    /// Mean of each frame in order of time.
    pub frame_means: Vec<f64>,
    /// Means of the rows of each frame, minus the mean of the frame.
    pub row_means: Vec<f32>,
    /// Variance over time of each pixel, without the components of frame, row and column.
    pub pixel_variance: Vec<f32>,
    /// Third moment over time of each pixel.
    pub pixel_third: Vec<f32>,
    /// Fourth moment over time of each pixel.
    pub pixel_fourth: Vec<f32>,
    /// Covariance of each pixel in successive frames.
    pub pixel_lag: Vec<f32>,
    /// Covariance of pixels at the distances [`LAGS`].
    pub covariance: [f64; 6],
    /// Variance of means over 8x8 pixels, times 64; of white noise, the pixel variance.
    pub block_variance: f64,
    /// Power spectrum of row means, bins 1 and up: v in each for white row means of variance v.
    pub row_power: Vec<f64>,
    /// Power spectrum of column means.
    pub column_power: Vec<f64>,
    /// Covariance of the means of adjacent rows.
    pub row_lag: f64,
    /// Number of samples of each code up to full scale.
    pub histogram: Vec<u32>,
    /// Two-dimensional power spectrum of pixel residuals, if requested.
    pub power: Option<Vec<f32>>,
}

impl Temporal {
    /// Replaces the moments of the outermost pixels by those of the nearest inner ones at the same
    /// position in the colour filter pattern: no model knows how the outermost pixels share light
    /// and charge with the surroundings of the array.
    pub fn without_border(mut self, pattern: &Pattern) -> Self {
        let (w, h) = (self.width, self.height);
        let (across, down) = (usize::from(pattern.width), usize::from(pattern.height));
        if w <= 2 * across || h <= 2 * down {
            return self;
        }
        for plane in [
            &mut self.mean.data,
            &mut self.pixel_variance,
            &mut self.pixel_third,
            &mut self.pixel_fourth,
            &mut self.pixel_lag,
        ] {
            for row in plane.chunks_mut(w) {
                row[0] = row[across];
                row[w - 1] = row[w - 1 - across];
            }
            plane.copy_within(down * w..(down + 1) * w, 0);
            plane.copy_within((h - 1 - down) * w..(h - down) * w, (h - 1) * w);
        }
        self
    }

    /// Mean of all pixels and frames, DN.
    pub fn level(&self) -> f64 {
        mean(&self.mean.data)
    }

    /// Distance, DN, of the values that the mean of a pixel can have: codes are whole numbers.
    pub fn step(&self) -> f64 {
        1.0 / self.frames.max(1) as f64
    }

    /// Variance of the mean frame over its pixels, DN².
    pub fn fixed_variance(&self) -> f64 {
        let level = self.level();
        let squares = self.mean.data.iter().map(|&m| (f64::from(m) - level).powi(2)).sum::<f64>();
        squares / self.mean.data.len() as f64
    }
}

/// Mean of values.
pub fn mean(values: &[f32]) -> f64 {
    values.chunks(1 << 12).map(lanes::sum).sum::<f64>() / values.len() as f64
}

/// The mean of a batch, to which its frames are relative.
struct Batch {
    mean: Vec<f32>,
    /// Mean of all pixels.
    level: f64,
    /// Means of rows minus `level`.
    rows: Vec<f64>,
}

/// Collects [`Temporal`].
pub struct Collector {
    /// Its mean is that of the first batch until [`Collector::finish`].
    t: Temporal,
    /// Sums over several batches; empty while there is one.
    sum: Vec<f64>,
    full_scale_dn: u16,
    /// Number of samples of each code in four histograms, for every fourth column: as the same code
    /// often repeats along a row, this avoids reading a counter right after writing it.
    histogram: Vec<[u32; 4]>,
    rows: Spectrum,
    columns: Spectrum,
    plane: Option<Spectrum2>,
    lag_dof: f64,
}

impl Collector {
    /// For frames of this size whose samples saturate at `full_scale_dn`: larger ones are read as
    /// that, so that frames whose scale ends elsewhere can be compared. `plane` requests the
    /// two-dimensional power spectrum.
    pub fn new(width: usize, height: usize, full_scale_dn: u16, plane: bool) -> Self {
        let n = width * height;
        let t = Temporal {
            width,
            height,
            frames: 0,
            dof: 0.0,
            mean: Plane { width, height, data: Vec::new() },
            frame_means: Vec::new(),
            row_means: Vec::new(),
            pixel_variance: vec![0.0; n],
            pixel_third: vec![0.0; n],
            pixel_fourth: vec![0.0; n],
            pixel_lag: vec![0.0; n],
            covariance: [0.0; 6],
            block_variance: 0.0,
            row_power: vec![0.0; height / 2],
            column_power: vec![0.0; width / 2],
            row_lag: 0.0,
            histogram: Vec::new(),
            power: plane.then(|| vec![0.0; height * (width / 2 + 1)]),
        };
        Self {
            t,
            sum: Vec::new(),
            full_scale_dn,
            histogram: vec![[0; 4]; usize::from(full_scale_dn) + 1],
            rows: Spectrum::new(height),
            columns: Spectrum::new(width),
            plane: plane.then(|| Spectrum2::new(width, height)),
            lag_dof: 0.0,
        }
    }

    /// Adds a batch of at least two frames.
    pub fn add(&mut self, frames: &[Plane<u16>]) {
        let (w, h) = (self.t.width, self.t.height);
        let n = frames.len();
        let (mut mean, top) = (vec![0.0f32; w * h], self.full_scale_dn);
        for frame in frames {
            mean.iter_mut().zip(&frame.data).for_each(|(m, &v)| *m += f32::from(v.min(top)));
        }
        if self.t.frames > 0 {
            self.sum_first_batch();
            self.sum.iter_mut().zip(&mean).for_each(|(s, &m)| *s += f64::from(m));
        }
        mean.iter_mut().for_each(|m| *m /= n as f32);
        let level = self::mean(&mean);
        let rows = mean.chunks(w).map(|row| lanes::sum(row) / w as f64 - level).collect();
        let batch = Batch { mean, level, rows };
        let (mut here, mut before) = (vec![0.0f32; w * h], vec![0.0f32; w * h]);
        for (i, frame) in frames.iter().enumerate() {
            add_frame(self, frame, &batch, &mut here);
            if i > 0 {
                let lags = self.t.pixel_lag.iter_mut();
                lags.zip(&here).zip(&before).for_each(|((l, a), b)| *l += a * b);
            }
            std::mem::swap(&mut here, &mut before);
        }
        if self.t.frames == 0 {
            self.t.mean.data = batch.mean;
        }
        self.t.frames += n;
        self.t.dof += n as f64 - 1.0;
        self.lag_dof += n as f64 - 1.0;
    }

    /// Computes the sums of the first batch from its mean: they are integers small enough that the
    /// mean determines them.
    fn sum_first_batch(&mut self) {
        if self.sum.is_empty() {
            let n = self.t.frames as f64;
            self.sum = self.t.mean.data.iter().map(|&m| (f64::from(m) * n).round()).collect();
        }
    }

    /// Adds one frame and writes its residuals to `out`.
    #[inline(always)]
    fn frame(&mut self, frame: &Plane<u16>, batch: &Batch, out: &mut [f32]) {
        let t = &mut self.t;
        let (w, h, top) = (t.width, t.height, self.full_scale_dn);
        let mut row_means = vec![0.0f64; h];
        let mut column_sums = vec![0.0f32; w];
        let rows = frame.data.chunks(w).zip(batch.mean.chunks(w)).zip(out.chunks_mut(w));
        for (((codes, mean), out), row_mean) in rows.zip(&mut row_means) {
            for (x, &c) in codes.iter().enumerate() {
                self.histogram[usize::from(c.min(top))][x % 4] += 1;
            }
            for (((o, &c), &m), s) in out.iter_mut().zip(codes).zip(mean).zip(&mut column_sums) {
                *o = f32::from(c.min(top)) - m;
                *s += *o;
            }
            *row_mean = lanes::sum(out) / w as f64;
        }
        let offset = row_means.iter().sum::<f64>() / h as f64;
        t.frame_means.push(batch.level + offset);
        row_means.iter_mut().for_each(|r| *r -= offset);
        t.row_means.extend(row_means.iter().zip(&batch.rows).map(|(r, b)| (r + b) as f32));
        let column_means: Vec<f64> =
            column_sums.iter().map(|&s| f64::from(s) / h as f64 - offset).collect();
        self.rows.add(&row_means, &mut t.row_power);
        self.columns.add(&column_means, &mut t.column_power);
        t.row_lag += row_means.windows(2).map(|p| p[0] * p[1]).sum::<f64>() / (h - 1) as f64;
        let columns: Vec<f32> = column_means.iter().map(|&c| c as f32).collect();
        for (y, out) in out.chunks_mut(w).enumerate() {
            let row = (row_means[y] + offset) as f32;
            out.iter_mut().zip(&columns).for_each(|(o, c)| *o -= row + c);
            let at = y * w..(y + 1) * w;
            let second = t.pixel_variance[at.clone()].iter_mut();
            let third = t.pixel_third[at.clone()].iter_mut();
            let fourth = t.pixel_fourth[at].iter_mut();
            for (((s2, s3), s4), &o) in second.zip(third).zip(fourth).zip(out.iter()) {
                let o2 = o * o;
                *s2 += o2;
                *s3 += o2 * o;
                *s4 += o2 * o2;
            }
        }
        for ((dx, dy), sum) in LAGS.iter().zip(&mut t.covariance) {
            *sum += covariance(out, w, h, *dx, *dy);
        }
        t.block_variance += block_variance(out, w, h);
        if let (Some(plane), Some(power)) = (&mut self.plane, &mut t.power) {
            plane.add(out, power);
        }
    }

    /// The moments.
    pub fn finish(self) -> Temporal {
        let mut t = self.t;
        let dof = t.dof.max(1.0);
        let frames = t.frames.max(1) as f64;
        t.histogram = self.histogram.iter().map(|bins| bins.iter().sum()).collect();
        // After one batch the mean is already computed, with the same rounding.
        t.mean.data.iter_mut().zip(&self.sum).for_each(|(m, s)| *m = (s / frames) as f32);
        let by =
            |v: &mut Vec<f32>, d: f64| v.iter_mut().for_each(|x| *x = (f64::from(*x) / d) as f32);
        by(&mut t.pixel_variance, dof);
        by(&mut t.pixel_third, dof);
        by(&mut t.pixel_fourth, dof);
        by(&mut t.pixel_lag, self.lag_dof.max(1.0));
        t.covariance.iter_mut().for_each(|c| *c /= dof);
        t.row_power.iter_mut().chain(&mut t.column_power).for_each(|p| *p /= dof);
        t.row_lag /= dof;
        t.block_variance /= dof;
        if let Some(power) = &mut t.power {
            by(power, dof);
        }
        t
    }
}

/// Vectorised where the processor can.
#[vectorised]
fn add_frame(collector: &mut Collector, frame: &Plane<u16>, batch: &Batch, out: &mut [f32]) {
    collector.frame(frame, batch, out);
}

/// Mean product of pixels at a distance of `dx` columns and `dy` rows.
#[inline(always)]
pub fn covariance(v: &[f32], w: usize, h: usize, dx: isize, dy: usize) -> f64 {
    let reach = dx.unsigned_abs();
    if reach >= w || dy >= h {
        return 0.0;
    }
    let (from, to) = if dx < 0 { (reach, 0) } else { (0, reach) };
    let len = w - reach;
    let mut sum = 0.0;
    for y in 0..h - dy {
        let a = &v[y * w + from..][..len];
        let b = &v[(y + dy) * w + to..][..len];
        sum += lanes::dot(a, b);
    }
    sum / (len * (h - dy)) as f64
}

/// Mean square of the means of blocks of pixels, times the pixels of a block.
#[inline(always)]
fn block_variance(v: &[f32], w: usize, h: usize) -> f64 {
    let (across, down) = (w / BLOCK, h / BLOCK);
    let mut sum = 0.0;
    for by in 0..down {
        let mut columns = vec![0.0f32; across * BLOCK];
        for row in v[by * BLOCK * w..].chunks(w).take(BLOCK) {
            columns.iter_mut().zip(row).for_each(|(c, v)| *c += v);
        }
        let blocks = columns.chunks_exact(BLOCK).map(|c| c.iter().sum::<f32>());
        sum += blocks.map(|b| f64::from(b * b)).sum::<f64>();
    }
    sum / (across * down).max(1) as f64 / (BLOCK * BLOCK) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_camera::Camera;

    #[test]
    fn the_mean_is_that_of_all_samples_in_one_batch_and_in_several() {
        let (w, h) = (16, 16);
        let frame =
            |k: usize| Plane::from_fn(w, h, |x, y| ((x * 31 + y * 17 + k * k) % 4093) as u16);
        let frames: Vec<Plane<u16>> = (0..37).map(frame).collect();
        for sizes in [vec![37], vec![13, 12, 12]] {
            let mut collector = Collector::new(w, h, 4095, false);
            let mut rest = &frames[..];
            for n in sizes {
                let (batch, later) = rest.split_at(n);
                collector.add(batch);
                rest = later;
            }
            let mean = collector.finish().mean;
            for i in 0..w * h {
                let sum: u32 = frames.iter().map(|f| u32::from(f.data[i])).sum();
                assert_eq!(mean.data[i], (f64::from(sum) / 37.0) as f32);
            }
        }
    }

    #[test]
    fn border_pixels_get_the_moments_of_the_next_pixels_of_its_own_channel() {
        let camera = Camera::load("mt9t012").unwrap();
        let (pattern, w, h) = (camera.sensor.pattern(), 7, 6);
        let inside = |i: usize| (1..w - 1).contains(&(i % w)) && (1..h - 1).contains(&(i / w));
        // Levels by channel; the border has wrong values.
        let level = |i: usize| 100 + 10 * pattern.channel(i % w, i / w) as u16;
        let frame = |wrong: u16| {
            let value = |i| if inside(i) { level(i) } else { wrong };
            Plane { width: w, height: h, data: (0..w * h).map(value).collect() }
        };
        let mut collector = Collector::new(w, h, 4095, false);
        collector.add(&[frame(0), frame(400), frame(0), frame(400)]);
        let t = collector.finish().without_border(&pattern);
        let expected: Vec<f32> = (0..w * h).map(|i| f32::from(level(i))).collect();
        assert_eq!(t.mean.data, expected);
        // Rows and columns at the border change by 200 DN, which affects the inner pixels only
        // through the mean of the frame.
        let corner = t.pixel_variance[0];
        assert_eq!(corner, t.pixel_variance[2 * w + 2]);
        assert_eq!(t.pixel_variance[w - 1], t.pixel_variance[2 * w + w - 3]);
        assert_eq!(t.pixel_fourth[(h - 1) * w + 3], t.pixel_fourth[(h - 3) * w + 3]);
    }
}
