//! The gain of the captures, DN per electron, from their own noise: a robust line (Theil & Sen) of
//! the variances of stacks against their levels. It needs no camera file.

use super::residuals::{FrameLevels, Residuals};
use super::scan::Scan;
use camrig_base::median::median;
use camrig_captures::{CaptureSet, Role};

/// Relative increase of the variance over that of a darker stack from which the two determine a
/// gain.
const MIN_INCREASE: f64 = 0.2;
/// Standard deviations above the typical level from which a pixel of a dark is hot.
const HOT: f64 = 8.0;
/// Number of hot pixels from which they determine a gain.
const MIN_HOT_PIXELS: usize = 20;
/// Share of saturated samples from which a stack's noise is not that of its light.
const SATURATED: f64 = 1e-3;

/// What the stacks of a set together show of its sensor.
pub struct Transfer {
    /// System gain at an analog gain of 1, DN/e⁻; `None` where the captures do not determine it.
    pub dn_per_e: Option<f64>,
    /// Mean level without light, DN.
    pub black: f64,
    /// Level and variance of each scan.
    pub points: Vec<Point>,
}

/// A point of the photon transfer curve.
#[derive(Clone, Copy)]
pub struct Point {
    /// Mean, DN.
    pub level_dn: f64,
    /// Variance over time, DN²; NaN for a stack of one frame.
    pub variance_dn2: f64,
}

impl Transfer {
    /// Of the stacks of a set.
    pub fn of(set: &CaptureSet, scans: &[Scan]) -> Self {
        let black = black(set, scans);
        let several = |s: &Scan| s.sample.frames > 1;
        let residuals: Vec<Option<Residuals>> = scans
            .iter()
            .map(|s| {
                several(s).then(|| Residuals::new(&s.sample, &FrameLevels::new(set, s, black)))
            })
            .collect();
        let points: Vec<Point> = (scans.iter().zip(&residuals))
            .map(|(s, r)| Point {
                level_dn: s.mean(),
                variance_dn2: r.as_ref().map_or(f64::NAN, Residuals::mean_variance),
            })
            .collect();
        let gain = |s: &Scan| set.captures[s.capture].analog_gain;
        let usable: Vec<usize> = (0..scans.len())
            .filter(|&i| {
                points[i].variance_dn2.is_finite()
                    && scans[i].saturated(set.sensor.white_level_dn) < SATURATED
            })
            .collect();
        let mut slopes: Vec<f64> = Vec::new();
        for &i in &usable {
            for &j in &usable {
                let (a, b) = (points[i], points[j]);
                if gain(&scans[i]) == gain(&scans[j])
                    && b.level_dn > a.level_dn
                    && b.variance_dn2 > a.variance_dn2 * (1.0 + MIN_INCREASE)
                {
                    let slope = (b.variance_dn2 - a.variance_dn2) / (b.level_dn - a.level_dn);
                    slopes.push(slope / gain(&scans[i]));
                }
            }
        }
        // The median slope over all pairs; hot pixels where no pair has a slope.
        let dn_per_e = match slopes.is_empty() {
            false => Some(median(&mut slopes, f64::total_cmp)),
            true => residuals.iter().flatten().find_map(gain_of_hot_pixels),
        };
        Self { dn_per_e, black, points }
    }

    /// DN per electron at an analog gain, 0 where it is unknown.
    pub fn gain(&self, analog_gain: f64) -> f64 {
        self.dn_per_e.unwrap_or(0.0) * analog_gain
    }
}

/// Level without light: of the shortest dark, otherwise that of the manifest.
fn black(set: &CaptureSet, scans: &[Scan]) -> f64 {
    let exposure = |s: &Scan| set.captures[s.capture].exposure_s;
    let plain = |s: &&Scan| {
        let c = &set.captures[s.capture];
        c.role == Role::Dark && c.preceded_by.is_none()
    };
    let darks = scans.iter().filter(plain);
    let shortest = darks.min_by(|a, b| exposure(a).total_cmp(&exposure(b)));
    shortest.map_or(set.sensor.black_level_dn.unwrap_or(0.0), Scan::mean)
}

/// Gain from the pixels of a dark with high dark current: their shot noise over their signal.
fn gain_of_hot_pixels(r: &Residuals) -> Option<f64> {
    let limit = r.level + HOT * r.typical_variance.sqrt();
    let dof = (r.frames as f64 - 1.0).max(1.0);
    let scale = camrig_base::tails::median_of_squares(dof);
    let mut slopes: Vec<f64> = (r.median.iter().zip(&r.variance))
        .filter(|(m, _)| f64::from(**m) > limit)
        .map(|(&m, &v)| (f64::from(v) / scale - r.typical_variance) / (f64::from(m) - r.level))
        .collect();
    (slopes.len() >= MIN_HOT_PIXELS).then(|| median(&mut slopes, f64::total_cmp).max(0.0))
}
