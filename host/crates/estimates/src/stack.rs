//! Frames of one exposure in memory, and the sites of the colour filter pattern.

use camrig_base::Plane;
use camrig_captures::Role;

/// A stack of repeated frames.
#[derive(Clone, Debug)]
pub struct Stack {
    /// Its name.
    pub id: String,
    /// Dark or flat.
    pub role: Role,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Analog gain, 1 = unity.
    pub analog_gain: f64,
    /// Samples in DN, frame after frame in order of time.
    pub frames: Vec<Plane<u16>>,
}

impl Stack {
    /// A stack of these frames, at unity gain.
    pub fn new(
        id: impl Into<String>,
        role: Role,
        exposure_s: f64,
        frames: Vec<Plane<u16>>,
    ) -> Self {
        Self { id: id.into(), role, exposure_s, analog_gain: 1.0, frames }
    }

    /// The same at another analog gain.
    #[must_use]
    pub fn at_gain(self, analog_gain: f64) -> Self {
        Self { analog_gain, ..self }
    }

    /// Width and height; 0 of a stack without frames.
    pub fn size(&self) -> (usize, usize) {
        self.frames.first().map_or((0, 0), |f| (f.width, f.height))
    }

    /// A frame as numbers, row-major.
    pub(crate) fn values(&self, frame: usize) -> Vec<f64> {
        self.frames[frame].data.iter().map(|v| f64::from(*v)).collect()
    }

    /// Mean over the frames for which `takes(frame, row)` holds, and how many these are for each
    /// row; NaN in rows without any.
    pub(crate) fn mean_map(&self, takes: impl Fn(usize, usize) -> bool) -> (Vec<f64>, Vec<usize>) {
        let (width, height) = self.size();
        let mut sum = vec![0.0; width * height];
        let mut counts = vec![0; height];
        for (i, frame) in self.frames.iter().enumerate() {
            for y in (0..height).filter(|y| takes(i, *y)) {
                counts[y] += 1;
                let row = sum[y * width..(y + 1) * width].iter_mut();
                row.zip(frame.row(y)).for_each(|(s, v)| *s += f64::from(*v));
            }
        }
        for (row, n) in sum.chunks_mut(width).zip(&counts) {
            row.iter_mut().for_each(|v| *v /= *n as f64);
        }
        (sum, counts)
    }
}

/// The places within a period of the colour filter pattern: 2 x 2 of a Bayer pattern, 1 x 1 of a
/// monochrome sensor. Figures by site are in row-major order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sites {
    /// Columns of a period.
    pub across: usize,
    /// Rows of a period.
    pub down: usize,
}

impl Sites {
    /// How many there are.
    pub fn count(&self) -> usize {
        self.across * self.down
    }

    /// The site of a pixel.
    pub fn of(&self, x: usize, y: usize) -> usize {
        (y % self.down) * self.across + x % self.across
    }

    /// The values of a row-major map at each site.
    pub(crate) fn split(&self, map: &[f64], width: usize) -> Vec<Vec<f64>> {
        let mut sites = vec![Vec::with_capacity(map.len() / self.count() + 1); self.count()];
        for (y, row) in map.chunks(width).enumerate() {
            row.iter().enumerate().for_each(|(x, v)| sites[self.of(x, y)].push(*v));
        }
        sites
    }
}
