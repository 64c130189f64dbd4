//! Which pixels of a frame belong to which channel of the colour filter array.

use camrig_camera::Camera;

/// Number of columns after which every pattern repeats that is 1, 2, 3, 4, 6 or 8 columns wide; one
/// of 5 columns does after five times as many.
const PERIOD: usize = 24;

/// The channel of each pixel of a camera's frames.
pub struct Channels {
    /// The channels of the first columns of each row of the pattern: a whole number of periods.
    rows: Vec<Vec<usize>>,
    width: usize,
    count: usize,
}

impl Channels {
    /// The channels of a camera.
    pub fn new(camera: &Camera) -> Self {
        let pattern = camera.sensor.pattern();
        let period = if pattern.width == 5 { 5 * PERIOD } else { PERIOD };
        let row = |y| (0..period).map(|x| pattern.channel(x, y)).collect();
        Self {
            rows: (0..pattern.height.max(1).into()).map(row).collect(),
            width: camera.sensor.width as usize,
            count: camera.sensor.channel_names.len(),
        }
    }

    /// Number of channels.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Share of all pixels that belong to each channel.
    pub fn shares(&self) -> Vec<f64> {
        let mut shares = vec![0.0; self.count];
        let one = 1.0 / (self.rows.len() * self.period()) as f64;
        self.rows.iter().flatten().for_each(|&c| shares[c] += one);
        shares
    }

    /// Share of the pixels of every `every`th column from column `phase` on that belong to each
    /// channel; `every` divides 24.
    pub fn shares_of_columns(&self, phase: usize, every: usize) -> Vec<f64> {
        let mut shares = vec![0.0; self.count];
        let one = every as f64 / (self.rows.len() * self.period()) as f64;
        for row in &self.rows {
            row.iter().skip(phase).step_by(every).for_each(|&c| shares[c] += one);
        }
        shares
    }

    /// The channel with most pixels, the first of several.
    pub fn densest(&self) -> usize {
        let shares = self.shares();
        (0..self.count).rev().max_by(|&a, &b| shares[a].total_cmp(&shares[b])).unwrap_or(0)
    }

    /// For each channel, the mean over its pixels of the Laplacian: the sum of the differences
    /// between the levels of the four neighbours and its own, for one level per channel.
    pub fn mean_laplacian(&self, levels: &[f64]) -> Vec<f64> {
        let (mut sums, mut counts) = (vec![0.0; self.count], vec![0.0; self.count]);
        let (across, down) = (self.period(), self.rows.len());
        for y in 0..down {
            for x in 0..across {
                let at = |x: usize, y: usize| self.rows[y % down][x % across];
                let around =
                    [at(x + 1, y), at(x + across - 1, y), at(x, y + 1), at(x, y + down - 1)];
                let own = at(x, y);
                sums[own] += around.iter().map(|&n| levels[n] - levels[own]).sum::<f64>();
                counts[own] += 1.0;
            }
        }
        sums.iter().zip(counts).map(|(s, n): (&f64, f64)| s / n.max(1.0)).collect()
    }

    fn row(&self, y: usize) -> &[usize] {
        &self.rows[y % self.rows.len()]
    }

    fn period(&self) -> usize {
        self.rows[0].len()
    }

    /// Mean of a frame's values in each channel, 0 where it has no pixel.
    pub fn means(&self, values: &[f32]) -> Vec<f64> {
        let (mut sums, mut counts) = (vec![0.0; self.count], vec![0usize; self.count]);
        let mut by_column = vec![0.0f64; self.period()];
        for (y, row) in values.chunks(self.width).enumerate() {
            by_column.fill(0.0);
            for chunk in row.chunks(by_column.len()) {
                by_column.iter_mut().zip(chunk).for_each(|(s, &v)| *s += f64::from(v));
            }
            let (whole, rest) = (row.len() / by_column.len(), row.len() % by_column.len());
            for (x, (&channel, sum)) in self.row(y).iter().zip(&by_column).enumerate() {
                sums[channel] += sum;
                counts[channel] += whole + usize::from(x < rest);
            }
        }
        sums.iter().zip(counts).map(|(s, n): (&f64, _)| s / n.max(1) as f64).collect()
    }

    /// Calls `visit(value, its channel)` for each value of a frame.
    pub fn visit(&self, values: &[f32], mut visit: impl FnMut(f32, usize)) {
        for (y, row) in values.chunks(self.width).enumerate() {
            let channels = self.row(y);
            for chunk in row.chunks(channels.len()) {
                chunk.iter().zip(channels).for_each(|(&v, &c)| visit(v, c));
            }
        }
    }

    /// Replaces each value by `change(value, its channel's parameter)`.
    pub fn change(&self, values: &mut [f32], by: &[f64], change: impl Fn(f32, f32) -> f32) {
        for (y, row) in values.chunks_mut(self.width).enumerate() {
            let by: Vec<f32> = self.row(y).iter().map(|&c| by[c] as f32).collect();
            for chunk in row.chunks_mut(by.len()) {
                chunk.iter_mut().zip(&by).for_each(|(v, &b)| *v = change(*v, b));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_and_changes_are_those_of_each_pixels_channel() {
        for cfa in ["GRBG", "ABCDE/FGHIJ/KLMNO/PQRST/UVWXY"] {
            of_each_pixels_channel(cfa);
        }
    }

    fn of_each_pixels_channel(cfa: &str) {
        let rows = camrig_camera::Change::new("sensor.cfa", cfa);
        let qe = camrig_camera::Change::new("sensor.qe", 0.5);
        let mut camera = Camera::load_with("mt9v024", [rows, qe]).unwrap();
        (camera.sensor.width, camera.sensor.height) = (161, 7);
        let channels = Channels::new(&camera);
        let pattern = camera.sensor.pattern();
        let of = |i: usize| pattern.channel(i % 161, i / 161);
        // Whole numbers: sums are exact in any order.
        let mut values: Vec<f32> = (0..161 * 7).map(|i| (i * i % 97) as f32).collect();
        let mean = |c: usize| {
            let own: Vec<f64> =
                (0..values.len()).filter(|&i| of(i) == c).map(|i| f64::from(values[i])).collect();
            own.iter().sum::<f64>() / own.len().max(1) as f64
        };
        let expected: Vec<f64> = (0..channels.count()).map(mean).collect();
        assert_eq!(channels.means(&values), expected);
        let mut i = 0;
        channels.visit(&values, |v, c| {
            assert_eq!((v, c), (values[i], of(i)));
            i += 1;
        });
        assert_eq!(i, values.len());
        assert!((channels.shares().iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert!(channels.shares().iter().all(|&s| s <= channels.shares()[channels.densest()]));
        // Each difference between neighbours counts once with either sign.
        let levels: Vec<f64> = (0..channels.count()).map(|c| (c * c) as f64).collect();
        let laplacian = channels.mean_laplacian(&levels);
        let sum: f64 = laplacian.iter().zip(channels.shares()).map(|(l, s)| l * s).sum();
        assert!(sum.abs() < 1e-12 && laplacian[0] > 0.0, "{laplacian:?}");
        let by: Vec<f64> = (0..channels.count()).map(|c| c as f64).collect();
        let before = values.clone();
        channels.change(&mut values, &by, |v, b| v + b);
        assert!((0..values.len()).all(|i| values[i] == before[i] + of(i) as f32));
    }
}
