//! Spectral lines that glasses are described at.

/// Helium d, hydrogen F and C, mercury g lines, µm.
pub(super) const D_LINE: f64 = 0.587_561_8;
pub(super) const F_LINE: f64 = 0.486_132_7;
pub(super) const C_LINE: f64 = 0.656_272_5;
pub(super) const G_LINE: f64 = 0.435_834_3;
