//! Image heights at which PSFs are tabulated, chosen by a tolerance.
//!
//! Between two heights PSFs are blended linearly. Halfway between them, where the blend is worst,
//! the PSF is traced too, and the two are compared after integration over pixels, which is all
//! that a sensor sees. Where they differ most, the traced PSF is added to the table and both
//! halves are examined in turn, until the mean error over the field keeps the tolerance.

use camrig_base::Result;
use camrig_optics::Between;
use camrig_optics::engine::nodes::{Misplaced, misplaced};
use camrig_optics::engine::psf::{KernelGrid, PsfField, UPRIGHT};
use camrig_optics::engine::stations::Stations;
use rayon::prelude::*;

/// The tolerance that heights are chosen by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Density {
    /// Largest fraction of misplaced light halfway between two heights, as a mean over the area of
    /// the field. Infinite: no heights are added, and the error is only measured.
    pub tolerance: f64,
    /// Side of the pixels over which PSFs are compared, µm.
    pub pixel_um: f64,
}

/// Most halvings of the distance between heights: sixteen times the heights asked for. What is
/// left after the last one is reported.
pub const ROUNDS: usize = 4;

/// Share of the error that halving a distance is expected to leave: a quarter where PSFs change
/// smoothly between heights, a half where their detail moves by its own size. Only the number of
/// rounds depends on it.
const HALVING: f64 = 1.0 / 3.0;

/// The PSFs at one height, one for each probed wavelength.
pub struct Station<T> {
    /// Paraxial image height, mm.
    pub height_mm: f64,
    /// The traced PSFs, in the order of the wavelengths.
    pub traced: Vec<T>,
}

/// A traced PSF and its real image height.
pub trait Probe: Send + Sync {
    /// Real height of its chief ray, mm.
    fn real_height_mm(&self) -> f64;
    /// Samples, row-major, of unit sum.
    fn samples(&self) -> &[f32];
}

/// Stations at `heights_mm`, which are evenly spaced from 0, and at the heights added between
/// them. `trace` returns the PSFs at a height: `size` samples per side, `spacing_um` apart.
///
/// # Errors
/// Those of `trace`.
pub fn choose<T: Probe>(
    heights_mm: &[f64],
    density: &Density,
    (size, spacing_um): (usize, f64),
    trace: impl Fn(f64) -> Result<Vec<T>> + Sync,
) -> Result<(Vec<Station<T>>, Between)> {
    let station = |height_mm: f64| Ok(Station { height_mm, traced: trace(height_mm)? });
    let window = Window::new(size, spacing_um, density.pixel_um);
    let all: Result<Vec<Station<T>>> = heights_mm.par_iter().map(|&h| station(h)).collect();
    let mut stations = all?;
    let mut gaps: Vec<Option<Gap<T>>> = (1..stations.len()).map(|_| None).collect();
    let mut errors = Vec::new();
    for round in 0..=ROUNDS {
        gaps.par_iter_mut().zip(stations.par_windows(2)).try_for_each(|(gap, ends)| {
            if gap.is_none() {
                let middle = station(0.5 * (ends[0].height_mm + ends[1].height_mm))?;
                let error = window.error(&ends[0], &middle, &ends[1]);
                *gap = Some(Gap { middle, error });
            }
            Ok::<(), camrig_base::Error>(())
        })?;
        errors = gaps.iter().flatten().map(|gap| gap.error).collect();
        let split = worst_gaps(&areas(&stations), &errors, density.tolerance);
        if round == ROUNDS || split.is_empty() {
            break;
        }
        let (before, known) = (std::mem::take(&mut stations), std::mem::take(&mut gaps));
        let known = known.into_iter().enumerate().map(Some).chain([None]);
        for (left, gap) in before.into_iter().zip(known) {
            stations.push(left);
            match gap {
                Some((k, Some(gap))) if split.contains(&k) => {
                    stations.push(gap.middle);
                    gaps.extend([None, None]);
                }
                Some((_, gap)) => gaps.push(gap),
                None => {}
            }
        }
    }
    let weighted: Vec<(f64, f64)> = errors.into_iter().zip(areas(&stations)).collect();
    let Misplaced { mean, largest } = Misplaced::of(&weighted);
    let between =
        Between { misplaced_mean: mean, misplaced_largest: largest, pixel_um: density.pixel_um };
    Ok((stations, between))
}

/// The station halfway between two others, and the error of their blend there.
struct Gap<T> {
    middle: Station<T>,
    error: f64,
}

/// Areas of the rings between stations, up to a common factor.
fn areas<T>(stations: &[Station<T>]) -> Vec<f64> {
    stations.windows(2).map(|w| w[1].height_mm.powi(2) - w[0].height_mm.powi(2)).collect()
}

/// The gaps with the largest errors above `tolerance`, as many as it takes until halving them
/// should bring the mean below it.
fn worst_gaps(areas: &[f64], errors: &[f64], tolerance: f64) -> Vec<usize> {
    let allowed = tolerance * areas.iter().sum::<f64>();
    let mut sum: f64 = areas.iter().zip(errors).map(|(a, e)| a * e).sum();
    let mut gaps: Vec<usize> = (0..errors.len()).filter(|&gap| errors[gap] > tolerance).collect();
    gaps.sort_by(|&a, &b| errors[b].total_cmp(&errors[a]));
    gaps.into_iter()
        .take_while(|&gap| {
            let over = sum > allowed;
            sum -= (1.0 - HALVING) * areas[gap] * errors[gap];
            over
        })
        .collect()
}

/// The share of the light that one PSF of a window puts elsewhere than another, seen through
/// pixels.
pub(super) fn blend_error_window(
    size: usize,
    spacing_mm: f64,
    pixel_um: f64,
) -> impl Fn(&[f32], &[f32]) -> f64 + Sync {
    let window = Window::new(size, 1e3 * spacing_mm, pixel_um);
    move |blend, exact| window.misplaced(blend, exact)
}

/// Integrates PSFs over pixels.
struct Window {
    empty: PsfField,
    kernel: KernelGrid,
}

impl Window {
    fn new(size: usize, spacing_um: f64, pixel_um: f64) -> Self {
        let stations = Stations::Heights(Vec::new());
        let empty = PsfField { stations, size, spacing_um, psfs: Vec::new() };
        let radius_um = 0.5 * size as f64 * spacing_um * std::f64::consts::SQRT_2;
        Self { empty, kernel: KernelGrid::new(1, pixel_um, pixel_um, radius_um) }
    }

    /// The share of the light that one PSF puts elsewhere than the other.
    fn misplaced(&self, a: &[f32], b: &[f32]) -> f64 {
        let kernel = |psf: &[f32]| self.empty.projected(psf, UPRIGHT, &self.kernel);
        misplaced(&kernel(a), &kernel(b))
    }

    /// The largest share of the light, over the wavelengths, that the blend of two stations
    /// misplaces compared with the station between them.
    fn error<T: Probe>(&self, left: &Station<T>, middle: &Station<T>, right: &Station<T>) -> f64 {
        let each = left.traced.iter().zip(&middle.traced).zip(&right.traced);
        let errors = each.map(|((a, m), b)| {
            let [h0, h, h1] = [a, m, b].map(T::real_height_mm);
            let t = ((h - h0) / (h1 - h0)) as f32;
            let pair = a.samples().iter().zip(b.samples());
            let blend: Vec<f32> = pair.map(|(a, b)| a + t * (b - a)).collect();
            self.misplaced(&blend, m.samples())
        });
        errors.fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Spot {
        height_mm: f64,
        samples: Vec<f32>,
    }

    impl Probe for Spot {
        fn real_height_mm(&self) -> f64 {
            self.height_mm
        }
        fn samples(&self) -> &[f32] {
            &self.samples
        }
    }

    /// Gaussian spots that widen quickly beyond 1 mm.
    fn spot(height_mm: f64) -> Spot {
        let sigma = 2.0 + 6.0 * (height_mm - 1.0).max(0.0).powi(2);
        let value = |k: usize| {
            let (y, x) = ((k / 64) as f64 - 32.0, (k % 64) as f64 - 32.0);
            (-0.5 * (x * x + y * y) / (sigma * sigma)).exp()
        };
        let sum: f64 = (0..64 * 64).map(value).sum();
        Spot { height_mm, samples: (0..64 * 64).map(|k| (value(k) / sum) as f32).collect() }
    }

    #[test]
    fn heights_are_added_only_where_psfs_change_until_the_tolerance_is_kept() {
        let even: Vec<f64> = (0..5).map(|i| 0.5 * f64::from(i)).collect();
        let run = |tolerance: f64| {
            let density = Density { tolerance, pixel_um: 2.0 };
            choose(&even, &density, (64, 1.0), |h| Ok(vec![spot(h)])).unwrap()
        };
        let (as_given, before) = run(f64::INFINITY);
        let heights = |all: &[Station<Spot>]| all.iter().map(|s| s.height_mm).collect::<Vec<_>>();
        assert_eq!(heights(&as_given), even);
        let (more, after) = run(0.003);
        let found = heights(&more);
        assert!(found.windows(2).all(|w| w[0] < w[1]), "{found:?}");
        assert_eq!(found.iter().filter(|h| **h <= 1.0).count(), 3, "{found:?}");
        assert!(found.len() > 6 && before.misplaced_mean > 0.01, "{found:?}, {before:?}");
        assert!(after.misplaced_mean <= 0.003, "{after:?}");
        assert!(after.misplaced_largest < before.misplaced_largest, "{after:?}");
        // A tolerance that cannot be kept ends the search, and the error is reported.
        let (most, never) = run(0.0);
        assert!(most.len() <= 4 * (1 << ROUNDS) + 1 && never.misplaced_mean > 0.0);
    }
}
