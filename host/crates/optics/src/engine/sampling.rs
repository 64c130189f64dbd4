//! The cell grid: how finely the scene is sampled, and how far beyond the frame.
//!
//! A scene averaged over cells of side h and sampled at their centres holds, apart from its own
//! spectrum, replicas shifted by multiples of 1/h. The engine divides out the cell's own sinc, so
//! the baseband is exact, and what remains of the replicas is the error. For the hardest scene, a
//! unit step (spectrum 1/(2πif)), replica k at frequency f has the size f/(f+k/h)² /(2π); summed
//! over k and frequencies in the worst case of phases,
//!
//! error ≤ (1/π) ∫₀^{1/2h} A(f)·f·Σ_{k≠0} (f+k/h)⁻² df + (1/π) ∫_{1/2h}^{fc} A(f)/f df,
//!
//! with A = |OTF · pixel aperture sinc|; the second term is what lies beyond the grid's Nyquist
//! frequency. The sum over k is h²(π²/sin²(πfh) − 1/(fh)²).

use super::SensorGrid;
use camrig_base::{Error, Result};
use camrig_fourier::lanes::good_length;
pub use camrig_fourier::sinc;
use std::f64::consts::PI;

/// The bound above for `oversample` cells per pixel.
pub fn step_error(
    oversample: usize,
    pitch_um: f64,
    aperture_um: f64,
    cutoff_per_mm: f64,
    otf: &dyn Fn(f64) -> f64,
) -> f64 {
    // The integrands are smooth over the passband: the midpoint rule needs no more for a
    // bound.
    const POINTS: usize = 256;
    let h = pitch_um * 1e-3 / oversample as f64;
    let passed = |f: f64| (otf(f) * sinc(aperture_um * 1e-3 * f)).abs();
    let replicas =
        |f: f64| h * h * (PI * PI / libm::sin(PI * f * h).powi(2) - 1.0 / (f * h).powi(2));
    let integral = |from: f64, to: f64, term: &dyn Fn(f64) -> f64| -> f64 {
        let step = (to - from) / POINTS as f64;
        (0..POINTS).map(|i| term(from + step * (i as f64 + 0.5)) * step).sum::<f64>() / PI
    };
    let nyquist = 0.5 / h;
    let inside = integral(0.0, nyquist.min(cutoff_per_mm), &|f| passed(f) * f * replicas(f));
    let beyond = match cutoff_per_mm > nyquist {
        true => integral(nyquist, cutoff_per_mm, &|f| passed(f) / f),
        false => 0.0,
    };
    inside + beyond
}

/// Cells per pixel that are tried: products of 2, 3 and 5, for which transforms are fast, up to 16
/// (256 cells for each pixel).
const CANDIDATES: [usize; 11] = [1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 16];

/// The smallest number of cells per pixel whose bound is at most `tolerance`, and that bound.
///
/// # Errors
/// When even 16 cells per pixel do not keep the tolerance.
pub fn oversample(
    tolerance: f64,
    pitch_um: f64,
    aperture_um: f64,
    cutoff_per_mm: f64,
    otf: &dyn Fn(f64) -> f64,
) -> Result<(usize, f64)> {
    CANDIDATES
        .into_iter()
        .map(|s| (s, step_error(s, pitch_um, aperture_um, cutoff_per_mm, otf)))
        .find(|&(_, error)| error <= tolerance)
        .ok_or_else(|| {
            Error::limit(format!(
                "no grid up to 16 cells per pixel keeps a step error of {tolerance}"
            ))
            .help("allow a larger step error, or set the oversampling by hand")
        })
}

/// The padded grids of one band: a frame of pixels with a margin, and its cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Cells per pixel and direction, s.
    pub oversample: usize,
    /// Least margin on each side, pixels.
    pub margin: usize,
    /// Pixels of the frame.
    pub width: usize,
    /// Pixels of the frame.
    pub height: usize,
    /// Pixels of the padded frame; its cells are s times as many.
    pub padded_width: usize,
    /// Pixels of the padded frame.
    pub padded_height: usize,
}

impl Layout {
    /// A margin of `spread_um` on each side, enlarged to lengths that transform fast.
    #[must_use]
    pub fn new(grid: &SensorGrid, oversample: usize, spread_um: f64) -> Self {
        // The transform wraps around. No kernel reaches further than the margin, so what wraps
        // comes out of one margin into the other, never into the frame.
        let margin = (spread_um / grid.pitch_um).ceil() as usize;
        Self {
            oversample,
            margin,
            width: grid.width,
            height: grid.height,
            padded_width: good_length(grid.width + 2 * margin),
            padded_height: good_length(grid.height + 2 * margin),
        }
    }

    /// Cells across the largest kernel about a pixel's centre that the margin holds on each side.
    #[must_use]
    pub fn support(&self) -> usize {
        // The centre is a cell's where their number in a pixel is odd, else it lies between two.
        2 * self.margin * self.oversample + self.oversample % 2
    }

    /// Pixels between the padded frame's left edge and the frame's.
    #[must_use]
    pub fn left(&self) -> usize {
        (self.padded_width - self.width) / 2
    }

    /// Pixels between the padded frame's top edge and the frame's.
    #[must_use]
    pub fn top(&self) -> usize {
        (self.padded_height - self.height) / 2
    }

    /// Cells across the padded frame.
    #[must_use]
    pub fn cells_across(&self) -> usize {
        self.padded_width * self.oversample
    }

    /// Cells down the padded frame.
    #[must_use]
    pub fn cells_down(&self) -> usize {
        self.padded_height * self.oversample
    }

    /// Its cells; `grid` has its pixels.
    #[must_use]
    pub fn cells(&self, grid: &SensorGrid) -> Cells {
        let (s, w) = (self.oversample, grid.width as f64);
        let margin = (self.padded_width - self.width).max(self.padded_height - self.height);
        Cells {
            across: self.cells_across(),
            down: self.cells_down(),
            left: self.left() * s,
            top: self.top() * s,
            frame: (self.width * s, self.height * s),
            side: 1.0 / (w * s as f64),
            corner: (
                -0.5 - self.left() as f64 / w,
                -0.5 * grid.height as f64 / w - self.top() as f64 / w,
            ),
            margin_mm: margin as f64 * grid.pitch_um * 1e-3,
        }
    }
}

/// Square cells on which a scene is rendered: those of a frame and of what lies around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cells {
    /// All across.
    pub across: usize,
    /// All down.
    pub down: usize,
    /// Those left of the frame.
    pub left: usize,
    /// Those above the frame.
    pub top: usize,
    /// Those of the frame across and down; the last may reach beyond its edge.
    pub frame: (usize, usize),
    /// Side of one, sensor widths.
    pub side: f64,
    /// Top left corner of them all, sensor widths from the image centre.
    pub corner: (f64, f64),
    /// They end within this distance from the frame, mm.
    pub margin_mm: f64,
}

impl Cells {
    /// Cells as large as `pixels` of the sensor each way: `all` across and down, of which `before`
    /// lie left of and above the frame, which has `frame`.
    #[must_use]
    pub fn coarse(
        sensor: &SensorGrid,
        pixels: usize,
        frame: (usize, usize),
        before: usize,
        all: (usize, usize),
    ) -> Self {
        let w = sensor.width as f64;
        let side = pixels as f64 / w;
        let beyond = before as f64 * side;
        let margin = (all.0 - frame.0).max(all.1 - frame.1);
        Self {
            across: all.0,
            down: all.1,
            left: before,
            top: before,
            frame,
            side,
            corner: (-0.5 - beyond, -0.5 * sensor.height as f64 / w - beyond),
            margin_mm: (margin * pixels) as f64 * sensor.pitch_um * 1e-3,
        }
    }
}
