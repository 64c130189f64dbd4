//! Spatial variance over the pixels of a plane, split into rows, columns and pixels (EMVA 1288).

use super::site::Site;
use camrig_base::Value;
use rayon::prelude::*;

/// Rows per parallel task: large enough to outweigh the cost of a task.
const BLOCK_ROWS: usize = 64;

/// Moments over the pixels of a plane, including its remaining temporal noise; DN and DN² for a
/// mean frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneMoments {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
    /// Mean over the pixels.
    pub mean: f64,
    /// Variance over the pixels (divisor: pixels - 1).
    pub measured: f64,
    /// Variance of the rows' means (divisor: rows).
    pub of_rows: f64,
    /// Variance of the columns' means (divisor: columns).
    pub of_columns: f64,
}

/// Variance over pixels, split as in EMVA 1288 R4, section 8.2. A part that is smaller than its
/// error can be negative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpatialVariance {
    /// Total variance.
    pub total: Value,
    /// Variance of rows: of offsets common to the pixels of a row.
    pub row: Value,
    /// Variance of columns.
    pub column: Value,
    /// Variance of pixels.
    pub pixel: Value,
}

impl PlaneMoments {
    /// Moments of a site's pixels of the plane `value(index)` of `width` x `height` values. Rows
    /// are summed in parallel, their sums in order.
    pub fn of(
        site: Site,
        width: usize,
        height: usize,
        value: impl Fn(usize) -> f64 + Sync,
    ) -> Self {
        let (rows, columns) = (site.rows(height), site.columns(width));
        let at =
            |i: usize, j: usize| (site.y0 + j * site.step_y) * width + site.x0 + i * site.step_x;
        let sums: Vec<f64> = (0..rows)
            .into_par_iter()
            .map(|j| (0..columns).map(|i| value(at(i, j))).sum())
            .collect();
        let n = (rows * columns) as f64;
        let mean = sums.iter().sum::<f64>() / n;
        // Blocks of rows read memory in order; their sums are added in order.
        let blocks: Vec<(f64, Vec<f64>)> = (0..rows.div_ceil(BLOCK_ROWS))
            .into_par_iter()
            .map(|block| {
                let (mut square, mut sums) = (0.0, vec![0.0; columns]);
                for j in block * BLOCK_ROWS..((block + 1) * BLOCK_ROWS).min(rows) {
                    for (i, sum) in sums.iter_mut().enumerate() {
                        let deviation = value(at(i, j)) - mean;
                        square += deviation * deviation;
                        *sum += deviation;
                    }
                }
                (square, sums)
            })
            .collect();
        let square: f64 = blocks.iter().map(|b| b.0).sum();
        let mut column_means = vec![0.0; columns];
        for (_, sums) in &blocks {
            for (mean, sum) in column_means.iter_mut().zip(sums) {
                *mean += sum / rows as f64;
            }
        }
        Self {
            rows,
            columns,
            mean,
            measured: square / (n - 1.0).max(1.0),
            of_rows: sums.iter().map(|s| (s / columns as f64 - mean).powi(2)).sum::<f64>()
                / rows as f64,
            of_columns: column_means.iter().map(|c| c * c).sum::<f64>() / columns as f64,
        }
    }

    /// Pools planes of one size: the means of their moments.
    pub fn pool(planes: &[Self]) -> Self {
        let k = planes.len() as f64;
        let mean_of = |f: fn(&Self) -> f64| planes.iter().map(f).sum::<f64>() / k;
        Self {
            rows: planes[0].rows,
            columns: planes[0].columns,
            mean: mean_of(|m| m.mean),
            measured: mean_of(|m| m.measured),
            of_rows: mean_of(|m| m.of_rows),
            of_columns: mean_of(|m| m.of_columns),
        }
    }

    /// Number of pixels.
    pub fn pixels(&self) -> f64 {
        (self.rows * self.columns) as f64
    }

    /// Splits the variance less the pixels' temporal noise variance `noise` into its parts (EMVA
    /// 1288 R4, section 8). `sites` is the number of pooled planes. Errors are those of Gaussian
    /// patterns: a variance over k samples has a relative error of sqrt(2/k).
    pub fn split(&self, noise: f64, sites: usize) -> SpatialVariance {
        let (m, n) = (self.rows as f64, self.columns as f64);
        let total = self.measured - noise;
        let cav = self.of_columns - noise / m;
        let rav = self.of_rows - noise / n;
        let d = m * n - m - n;
        let row = (m * n - n) / d * rav - m / d * (total - cav);
        let column = (m * n - m) / d * cav - n / d * (total - rav);
        let pixel = m * n / d * (total - cav - rav);
        let k = sites as f64;
        let pixel_error = (pixel.max(0.0) + noise) * (2.0 / (m * n * k)).sqrt();
        let row_error = self.of_rows * (2.0 / (m * k)).sqrt();
        let column_error = self.of_columns * (2.0 / (n * k)).sqrt();
        // The row and column parts of the total have the errors of few rows and columns.
        let total_error = libm::hypot(
            libm::hypot(pixel_error, row.max(0.0) * (2.0 / (m * k)).sqrt()),
            column.max(0.0) * (2.0 / (n * k)).sqrt(),
        );
        SpatialVariance {
            total: Value::new(total, total_error),
            row: Value::new(row, row_error),
            column: Value::new(column, column_error),
            pixel: Value::new(pixel, pixel_error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_columns_and_pixels_come_apart() {
        // A row pattern and a column pattern without pixel part: sum of squares of two-level
        // patterns of amplitudes 3 and 2.
        let (w, h) = (64, 48);
        let site = Site { x0: 0, y0: 0, step_x: 1, step_y: 1, channel: 0 };
        let value = |at: usize| {
            let (x, y) = (at % w, at / w);
            3.0 * (f64::from((y % 2) as u32) - 0.5) * 2.0
                + 2.0 * (f64::from((x % 2) as u32) - 0.5) * 2.0
                + 100.0
        };
        let m = PlaneMoments::of(site, w, h, value);
        let s = m.split(0.0, 1);
        assert!((m.mean - 100.0).abs() < 1e-12);
        // Divisor n - 1 in the total (as in the standard) shifts the parts by parts in n.
        assert!((s.row.value - 9.0).abs() < 13.0 * 2.0 / 48.0, "{s:?}");
        assert!((s.column.value - 4.0).abs() < 13.0 * 2.0 / 48.0, "{s:?}");
        assert!(s.pixel.value.abs() < 0.01, "{s:?}");
    }
}
