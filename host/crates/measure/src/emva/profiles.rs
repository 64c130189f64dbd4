//! Profiles of a mean frame along its rows and columns (EMVA 1288 R4, section 8.6).

use crate::spectrogram::SitePlane;

/// Profiles of a channel's pixels in both directions.
#[derive(Clone, Debug, PartialEq)]
pub struct Profiles {
    /// Over the columns: of each column its pixels.
    pub horizontal: Profile,
    /// Over the rows: of each row its pixels.
    pub vertical: Profile,
}

/// Of each line of pixels mean, lowest and highest, DN.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Means.
    pub mean: Vec<f64>,
    /// Lowest pixels.
    pub lowest: Vec<f64>,
    /// Highest pixels.
    pub highest: Vec<f64>,
}

impl Profiles {
    /// Of the values of one site.
    #[must_use]
    pub fn of(plane: &SitePlane) -> Self {
        let (mut horizontal, mut vertical) =
            (Profile::new(plane.columns), Profile::new(plane.rows));
        for (y, row) in plane.data.chunks_exact(plane.columns.max(1)).enumerate() {
            for (x, &deviation) in row.iter().enumerate() {
                let value = plane.mean + f64::from(deviation);
                horizontal.add(x, value, plane.rows);
                vertical.add(y, value, plane.columns);
            }
        }
        Self { horizontal, vertical }
    }
}

impl Profile {
    fn new(lines: usize) -> Self {
        Self {
            mean: vec![0.0; lines],
            lowest: vec![f64::INFINITY; lines],
            highest: vec![f64::NEG_INFINITY; lines],
        }
    }

    /// Adds one of `count` pixels of a line.
    fn add(&mut self, line: usize, value: f64, count: usize) {
        self.mean[line] += value / count as f64;
        self.lowest[line] = self.lowest[line].min(value);
        self.highest[line] = self.highest[line].max(value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_have_their_mean_and_ends() {
        // Rows 10 11 12 and 20 21 28.
        let data = [-7.0, -6.0, -5.0, 3.0, 4.0, 11.0].to_vec();
        let plane = SitePlane { columns: 3, rows: 2, mean: 17.0, data };
        let Profiles { horizontal, vertical } = Profiles::of(&plane);
        assert_eq!(vertical.lowest, [10.0, 20.0]);
        assert_eq!(vertical.highest, [12.0, 28.0]);
        assert!((vertical.mean[1] - 23.0).abs() < 1e-12);
        assert_eq!(horizontal.highest, [20.0, 21.0, 28.0]);
        assert!((horizontal.mean[2] - 20.0).abs() < 1e-12);
    }
}
