//! The gain of the captures, DN per electron, from their own noise: a robust line through the
//! variances of stacks over their levels. No camera file is asked.

use super::band::{Levels, Residuals};
use super::scan::Scan;
use camrig_base::median::median;
use camrig_captures::{CaptureSet, Role};

/// Rise of the variance over that of a darker stack, relative, from which the two tell a gain.
const RISE: f64 = 0.2;
/// Standard deviations above the typical level from which dark pixels are hot, and how many of
/// them tell a gain.
const HOT: (f64, usize) = (8.0, 20);
/// Share of saturated samples from which a stack's noise is not that of its light.
const SATURATED: f64 = 1e-3;

/// What the stacks of a set say of its sensor as a whole.
pub struct Transfer {
    /// System gain at an analog gain of 1, DN/e⁻; `None` where the captures do not tell.
    pub dn_per_e: Option<f64>,
    /// Mean level without light, DN.
    pub black: f64,
    /// Level, DN, and variance over time, DN², of each scan.
    pub points: Vec<(f64, f64)>,
}

impl Transfer {
    /// Of the stacks of a set.
    pub fn of(set: &CaptureSet, scans: &[Scan]) -> Self {
        let black = black(set, scans);
        let several = |s: &Scan| s.sample.frames > 1;
        let residuals: Vec<Option<Residuals>> = scans
            .iter()
            .map(|s| several(s).then(|| Residuals::new(&s.sample, &Levels::new(set, s, black))))
            .collect();
        let points: Vec<(f64, f64)> = (scans.iter().zip(&residuals))
            .map(|(s, r)| (s.mean(), r.as_ref().map_or(f64::NAN, Residuals::mean_variance)))
            .collect();
        let gain = |s: &Scan| set.captures[s.capture].analog_gain;
        let usable: Vec<usize> = (0..scans.len())
            .filter(|&i| {
                points[i].1.is_finite()
                    && scans[i].saturated(set.sensor.white_level_dn) < SATURATED
            })
            .collect();
        let mut slopes: Vec<f64> = Vec::new();
        for &i in &usable {
            for &j in &usable {
                let ((low, quiet), (high, noisy)) = (points[i], points[j]);
                if gain(&scans[i]) == gain(&scans[j]) && high > low && noisy > quiet * (1.0 + RISE)
                {
                    slopes.push((noisy - quiet) / (high - low) / gain(&scans[i]));
                }
            }
        }
        // A line that most pairs agree on is a gain; none where the light never rises.
        let dn_per_e = match slopes.is_empty() {
            false => Some(median(&mut slopes, f64::total_cmp)),
            true => residuals.iter().flatten().find_map(of_hot_pixels),
        };
        Self { dn_per_e, black, points }
    }

    /// DN per electron at an analog gain, 0 where it is not known.
    pub fn gain(&self, analog_gain: f64) -> f64 {
        self.dn_per_e.unwrap_or(0.0) * analog_gain
    }
}

/// Level without light: of the shortest dark, else what the manifest says.
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

/// Gain from the pixels of a dark that have much dark current: their shot noise over their signal.
fn of_hot_pixels(r: &Residuals) -> Option<f64> {
    let limit = r.level + HOT.0 * r.typical.sqrt();
    let dof = (r.frames as f64 - 1.0).max(1.0);
    let scale = camrig_base::tails::median_of_squares(dof);
    let mut slopes: Vec<f64> = (r.median.iter().zip(&r.variance))
        .filter(|(m, _)| f64::from(**m) > limit)
        .map(|(&m, &v)| (f64::from(v) / scale - r.typical) / (f64::from(m) - r.level))
        .collect();
    (slopes.len() >= HOT.1).then(|| median(&mut slopes, f64::total_cmp).max(0.0))
}
