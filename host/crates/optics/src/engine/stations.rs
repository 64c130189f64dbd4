//! The field points at which the PSFs of a lens are tabulated, and the blend between them.

use super::over_field::PlaneFunction;

/// Field points of tabulated PSFs.
#[non_exhaustive]
pub enum Stations {
    /// Of a rotationally symmetric lens: real image heights, mm, rising from 0. Rows of PSFs rise
    /// along the radius, away from the axis.
    Heights(Vec<f64>),
    /// Of any other lens: a rectangular grid. PSFs lie as on the sensor: columns rise to the
    /// right, rows downwards.
    Lattice(Lattice),
}

/// A rectangular grid of field points, over ideal places; row by row.
pub struct Lattice {
    /// Ideal places of the columns right of the axis, mm, rising strictly.
    pub x_mm: Vec<f64>,
    /// Ideal places of the rows below the axis, mm, rising strictly.
    pub y_mm: Vec<f64>,
    /// Ideal place of a real one.
    pub ideal: PlaneFunction<'static, (f64, f64)>,
}

impl Stations {
    /// The number of the station in the middle of the field: of the axis, or nearest to it.
    #[must_use]
    pub fn middle(&self) -> usize {
        let nearest = |axis: &[f64]| {
            let distances = axis.iter().map(|v| v.abs()).enumerate();
            distances.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(i, _)| i)
        };
        match self {
            Self::Heights(_) => 0,
            Self::Lattice(l) => nearest(&l.y_mm) * l.x_mm.len() + nearest(&l.x_mm),
        }
    }
}

impl Lattice {
    /// The PSF at a real place: bilinear between the stations about its ideal place; beyond the
    /// grid, that of its edge.
    #[must_use]
    pub fn blend(&self, psfs: &[Vec<f32>], x_mm: f64, y_mm: f64) -> Vec<f32> {
        let (x, y) = (self.ideal)(x_mm, y_mm);
        let ([left, right], t) = about(&self.x_mm, x);
        let ([above, below], v) = about(&self.y_mm, y);
        self.between(psfs, [[left, right], [above, below]], [t, v])
    }

    /// The blend of the stations in two columns and two rows, the second ones by the parts `t` and
    /// `v`.
    #[must_use]
    pub fn between(
        &self,
        psfs: &[Vec<f32>],
        [columns, rows]: [[usize; 2]; 2],
        [t, v]: [f32; 2],
    ) -> Vec<f32> {
        let corner = |i: usize, j: usize| &psfs[rows[j] * self.x_mm.len() + columns[i]];
        let (a, b, c, d) = (corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1));
        let along = |a: f32, b: f32, t: f32| a + t * (b - a);
        (0..a.len()).map(|k| along(along(a[k], b[k], t), along(c[k], d[k], t), v)).collect()
    }
}

/// The nodes of a rising axis about `x`, and the part of the way from the first to the second.
fn about(axis: &[f64], x: f64) -> ([usize; 2], f32) {
    let after = axis.partition_point(|&v| v <= x);
    if after == 0 || after == axis.len() {
        let end = after.saturating_sub(1);
        return ([end, end], 0.0);
    }
    let before = after - 1;
    ([before, after], ((x - axis[before]) / (axis[after] - axis[before])) as f32)
}
