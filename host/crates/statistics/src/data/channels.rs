//! Which pixels of a frame belong to which channel of the colour filter array.

use camrig_camera::Camera;

/// Number of columns after which every pattern (1, 2, 3, 4, 6 or 8 columns wide) repeats.
const PERIOD: usize = 24;

/// The channel of each pixel of a camera's frames.
pub struct Channels {
    /// The channels of the first columns of each row of the pattern.
    rows: Vec<[usize; PERIOD]>,
    width: usize,
    count: usize,
}

impl Channels {
    /// The channels of a camera.
    pub fn new(camera: &Camera) -> Self {
        let pattern = camera.sensor.pattern();
        let row = |y| std::array::from_fn(|x| pattern.channel(x, y));
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
        let one = 1.0 / (self.rows.len() * PERIOD) as f64;
        self.rows.iter().flatten().for_each(|&c| shares[c] += one);
        shares
    }

    /// Share of the pixels of every `every`th column from column `phase` on that belong to each
    /// channel; `every` divides 24.
    pub fn shares_of_columns(&self, phase: usize, every: usize) -> Vec<f64> {
        let mut shares = vec![0.0; self.count];
        let one = every as f64 / (self.rows.len() * PERIOD) as f64;
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
        let down = self.rows.len();
        for y in 0..down {
            for x in 0..PERIOD {
                let at = |x: usize, y: usize| self.rows[y % down][x % PERIOD];
                let around =
                    [at(x + 1, y), at(x + PERIOD - 1, y), at(x, y + 1), at(x, y + down - 1)];
                let own = at(x, y);
                sums[own] += around.iter().map(|&n| levels[n] - levels[own]).sum::<f64>();
                counts[own] += 1.0;
            }
        }
        sums.iter().zip(counts).map(|(s, n): (&f64, f64)| s / n.max(1.0)).collect()
    }

    fn row(&self, y: usize) -> [usize; PERIOD] {
        self.rows[y % self.rows.len()]
    }

    /// Mean of a frame's values in each channel, 0 where it has no pixel.
    pub fn means(&self, values: &[f32]) -> Vec<f64> {
        let (mut sums, mut counts) = (vec![0.0; self.count], vec![0usize; self.count]);
        for (y, row) in values.chunks(self.width).enumerate() {
            let mut by_column = [0.0f64; PERIOD];
            let (whole, rest) = row.as_chunks::<PERIOD>();
            for chunk in whole {
                by_column.iter_mut().zip(chunk).for_each(|(s, &v)| *s += f64::from(v));
            }
            by_column.iter_mut().zip(rest).for_each(|(s, &v)| *s += f64::from(v));
            for (x, (channel, sum)) in self.row(y).into_iter().zip(by_column).enumerate() {
                sums[channel] += sum;
                counts[channel] += whole.len() + usize::from(x < rest.len());
            }
        }
        sums.iter().zip(counts).map(|(s, n): (&f64, _)| s / n.max(1) as f64).collect()
    }

    /// Calls `visit(value, its channel)` for each value of a frame.
    pub fn visit(&self, values: &[f32], mut visit: impl FnMut(f32, usize)) {
        for (y, row) in values.chunks(self.width).enumerate() {
            let channels = self.row(y);
            for chunk in row.chunks(PERIOD) {
                chunk.iter().zip(channels).for_each(|(&v, c)| visit(v, c));
            }
        }
    }

    /// Replaces each value by `change(value, its channel's parameter)`.
    pub fn change(&self, values: &mut [f32], by: &[f64], change: impl Fn(f32, f32) -> f32) {
        for (y, row) in values.chunks_mut(self.width).enumerate() {
            let by = self.row(y).map(|c| by[c] as f32);
            for chunk in row.chunks_mut(PERIOD) {
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
        let mut camera = Camera::load("mt9v024").unwrap();
        (camera.sensor.width, camera.sensor.height) = (61, 7);
        let channels = Channels::new(&camera);
        let pattern = camera.sensor.pattern();
        let of = |i: usize| pattern.channel(i % 61, i / 61);
        // Whole numbers: sums are exact in any order.
        let mut values: Vec<f32> = (0..61 * 7).map(|i| (i * i % 97) as f32).collect();
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
