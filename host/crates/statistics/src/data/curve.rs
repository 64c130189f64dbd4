//! Gives a design the start-up or lamp drift that [`camrig_clean`] found in its captures, so that a
//! model is simulated with the same.

use super::design::{Condition, Design};
use camrig_clean::{CurveShape, FrameCurve};

/// Gives the stacks of a design the variation of a curve. Where the light drifts, the light of each
/// stack becomes the mean over its frames; the mean over the whole capture is taken to be the
/// stated light.
pub fn apply(design: &mut Design, curve: &FrameCurve) {
    for c in &mut design.conditions {
        if curve.of_light {
            apply_drift(c, curve);
        } else {
            let (first, n) = (c.stack.skip, c.stack.total);
            c.stack.variation.offset_dn = (first..first + c.stack.frames)
                .map(|i| curve.amplitude * offset(curve.shape, i, n))
                .collect();
        }
    }
}

/// The shape of an offset: a decay ends at zero, a line is zero at its centre.
fn offset(shape: CurveShape, frame: usize, n: usize) -> f64 {
    match shape {
        CurveShape::Line => shape.at(frame, n) - 0.5,
        _ => shape.at(frame, n),
    }
}

fn apply_drift(c: &mut Condition, curve: &FrameCurve) {
    if !c.is_flat() {
        return;
    }
    let factors = factors(curve, (c.stack.skip, c.stack.frames), c.stack.total);
    let mean = factors.iter().sum::<f64>() / factors.len().max(1) as f64;
    c.stack.variation.light = factors.iter().map(|f| f / mean).collect();
    if c.level_known {
        c.photo_e.iter_mut().chain(&mut c.before_e).for_each(|e| *e *= mean);
    }
}

/// Light of `frames` frames after the first `skip` of `n`, relative to the mean of all n.
fn factors(curve: &FrameCurve, (skip, frames): (usize, usize), n: usize) -> Vec<f64> {
    let shape = |i: usize| curve.shape.at(i, n);
    let mean = (0..n).map(shape).sum::<f64>() / n.max(1) as f64;
    (skip..skip + frames).map(|i| 1.0 + curve.amplitude * (shape(i) - mean)).collect()
}

/// Lowest and highest ratio of the light of a frame to the mean light.
fn range(curve: &FrameCurve, n: usize) -> (f64, f64) {
    let factors = factors(curve, (0, n), n);
    let low = factors.iter().copied().fold(f64::INFINITY, f64::min);
    (low, factors.iter().copied().fold(0.0, f64::max))
}

/// Where the light drifts, takes the stated light as that of the frame at which the model's
/// response agrees best; `ratios` are those of the measured to the model's signal. Such a set
/// determines the response no better than the range of the drift.
pub fn set_stated_light(design: &mut Design, curve: &FrameCurve, ratios: &mut [f64]) {
    if !curve.of_light || ratios.is_empty() {
        return;
    }
    let median = camrig_base::median::median(ratios, f64::total_cmp);
    let total = design.conditions.iter().map(|c| c.stack.total).max().unwrap_or(0);
    let (low, high) = range(curve, total);
    // Stated = mean × factor of a frame, so the mean is the stated light over that factor.
    let mean = median.clamp(1.0 / high, 1.0 / low);
    for c in design.conditions.iter_mut().filter(|c| c.is_known_flat()) {
        c.photo_e.iter_mut().chain(&mut c.before_e).for_each(|e| *e *= mean);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_relative_to_all_frames_and_offsets_decay_to_zero() {
        let line = FrameCurve {
            shape: CurveShape::Line,
            of_light: true,
            amplitude: 0.02,
            std_error: 0.001,
            tau_std_error: f64::NAN,
        };
        let factors = factors(&line, (5, 5), 10);
        // From 5/9 to 1 of the way, relative to the centre.
        assert!((factors[0] - (1.0 + 0.02 * (5.0 / 9.0 - 0.5))).abs() < 1e-12);
        assert!((factors[4] - 1.01).abs() < 1e-12);
        assert_eq!(offset(CurveShape::Decay(2.0), 0, 10), 1.0);
        assert!((range(&line, 10).0 - 0.99).abs() < 1e-12);
    }
}
