//! Positional crosstalk: factors by position, channel and wavelength (section IV-C of Chen et al.
//! 2009).

use crate::config::ConfigError;

/// Largest number of columns of a crosstalk grid.
pub const MAX_NODES: usize = 33;

/// Factors on a rectangular grid, relative to the sensor's centre; bilinear in position, linear in
/// wavelength, constant beyond the grid. They scale the spectral bands of a channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crosstalk<'a> {
    /// Columns, -1..1 over the sensor's half width, rising.
    pub x: &'a [f32],
    /// Rows, -1..1 over the sensor's half height, down, rising.
    pub y: &'a [f32],
    /// Wavelengths, nm, rising.
    pub wavelength_nm: &'a [f32],
    /// Factors (1 = no crosstalk) `[((channel * wavelengths + wavelength) * rows + row) * columns
    /// + column]`.
    pub factors: &'a [f32],
}

/// Place between two nodes: the lower one and the fraction of the way to the next.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    pub node: usize,
    pub t: f32,
}

/// Where `v` lies between rising nodes.
pub(crate) fn place(nodes: &[f32], v: f32) -> Place {
    let above = nodes.iter().take_while(|&&n| n <= v).count();
    let node = above.saturating_sub(1).min(nodes.len().saturating_sub(2));
    match nodes.get(node..node + 2) {
        Some(&[a, b]) => Place { node, t: ((v - a) / (b - a)).clamp(0.0, 1.0) },
        _ => Place { node: 0, t: 0.0 },
    }
}

impl<'a> Crosstalk<'a> {
    /// Checks that the table is complete for this number of channels, its positions and
    /// wavelengths finite and rising, its factors finite and 0 or more.
    ///
    /// # Errors
    /// [`ConfigError::Crosstalk`].
    pub fn check(&self, channels: usize) -> Result<(), ConfigError> {
        let rising = |v: &[f32]| {
            !v.is_empty() && v.iter().all(|n| n.is_finite()) && v.windows(2).all(|w| w[0] < w[1])
        };
        let whole = channels * self.wavelength_nm.len() * self.x.len() * self.y.len();
        let good = rising(self.x)
            && rising(self.y)
            && rising(self.wavelength_nm)
            && self.x.len() <= MAX_NODES
            && self.factors.len() == whole
            && self.factors.iter().all(|f| f.is_finite() && *f >= 0.0);
        if good { Ok(()) } else { Err(ConfigError::Crosstalk) }
    }

    /// The factor at a column node, between rows and wavelengths.
    #[inline(always)]
    pub(crate) fn at(&self, channel: usize, wavelength: Place, row: Place, column: usize) -> f32 {
        let node = |w: usize, r: usize| {
            let w = w.min(self.wavelength_nm.len() - 1);
            let r = r.min(self.y.len() - 1);
            let plane = channel * self.wavelength_nm.len() + w;
            let index = (plane * self.y.len() + r) * self.x.len() + column;
            self.factors.get(index).copied().unwrap_or(1.0)
        };
        let between = |w: usize| {
            let (a, b) = (node(w, row.node), node(w, row.node + 1));
            a + row.t * (b - a)
        };
        let (a, b) = (between(wavelength.node), between(wavelength.node + 1));
        a + wavelength.t * (b - a)
    }
}
