//! What differs from frame to frame of a stack beside noise: the lamp, and the first frames after
//! a start. The captures show it ([`camrig_clean`]); the model is given the same.

use super::design::{Condition, Design};
use camrig_clean::{CurveShape, FrameCurve};

/// What differs over the frames that are used of a stack; empty where nothing does.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Course {
    /// Light of each frame over the mean of all.
    pub light: Vec<f64>,
    /// Offset of each frame, DN.
    pub offset_dn: Vec<f64>,
}

impl Course {
    /// Whether all frames are alike.
    pub fn is_even(&self) -> bool {
        self.light.is_empty() && self.offset_dn.is_empty()
    }

    /// Light of a frame over the mean of all.
    pub fn light_of(&self, frame: usize) -> f64 {
        self.light.get(frame).copied().unwrap_or(1.0)
    }

    /// Offset of a frame, DN.
    pub fn offset_of(&self, frame: usize) -> f64 {
        self.offset_dn.get(frame).copied().unwrap_or(0.0)
    }
}

/// Gives the stacks of a design the course of a curve. Where the light drifts, that of each stack
/// becomes the mean over its frames, those of the whole capture taken to have the stated light in
/// the mean.
pub fn follow(design: &mut Design, curve: &FrameCurve) {
    for c in &mut design.conditions {
        if curve.of_light {
            drift(c, curve);
        } else {
            let (first, n) = (c.stack.skip, c.stack.total);
            c.stack.course.offset_dn = (first..first + c.stack.frames)
                .map(|i| curve.amplitude * offset(curve.shape, i, n))
                .collect();
        }
    }
}

/// The shape of an offset: a decay ends at the level of the dark, a line has it in the middle.
fn offset(shape: CurveShape, frame: usize, n: usize) -> f64 {
    match shape {
        CurveShape::Decay(_) => shape.at(frame, n),
        CurveShape::Line => shape.at(frame, n) - 0.5,
    }
}

fn drift(c: &mut Condition, curve: &FrameCurve) {
    if !c.is_flat() {
        return;
    }
    let factors = factors(curve, (c.stack.skip, c.stack.frames), c.stack.total);
    let mean = factors.iter().sum::<f64>() / factors.len().max(1) as f64;
    c.stack.course.light = factors.iter().map(|f| f / mean).collect();
    if c.level_known {
        c.photo_e.iter_mut().chain(&mut c.before_e).for_each(|e| *e *= mean);
    }
}

/// Light of `frames` frames after the first `skip` of `n` over the mean of all.
fn factors(curve: &FrameCurve, (skip, frames): (usize, usize), n: usize) -> Vec<f64> {
    let shape = |i: usize| curve.shape.at(i, n);
    let middle = (0..n).map(shape).sum::<f64>() / n.max(1) as f64;
    (skip..skip + frames).map(|i| 1.0 + curve.amplitude * (shape(i) - middle)).collect()
}

/// The range of the stated over the mean light of captures: it was read at one of their frames.
fn range(curve: &FrameCurve, n: usize) -> (f64, f64) {
    let factors = factors(curve, (0, n), n);
    let low = factors.iter().copied().fold(f64::INFINITY, f64::min);
    (low, factors.iter().copied().fold(0.0, f64::max))
}

/// Where the light drifts, takes the stated light for that of the frame at which the model's
/// response agrees best; `ratios` are those of the measured to the model's signal. No response is
/// told from such a set better than the drift.
pub fn set_stated(design: &mut Design, curve: &FrameCurve, ratios: &mut [f64]) {
    if !curve.of_light || ratios.is_empty() {
        return;
    }
    let middle = camrig_base::median::median(ratios, f64::total_cmp);
    let total = design.conditions.iter().map(|c| c.stack.total).max().unwrap_or(0);
    let (low, high) = range(curve, total);
    // Stated = mean × factor of the frame, so that the mean is the stated over that factor.
    let mean = middle.clamp(1.0 / high, 1.0 / low);
    for c in design.conditions.iter_mut().filter(|c| c.is_known_flat()) {
        c.photo_e.iter_mut().chain(&mut c.before_e).for_each(|e| *e *= mean);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_relative_to_the_frames_used_and_offsets_end_at_the_dark() {
        let line = FrameCurve {
            shape: CurveShape::Line,
            of_light: true,
            amplitude: 0.02,
            std_error: 0.001,
            tau_std_error: f64::NAN,
        };
        let factors = factors(&line, (5, 5), 10);
        // From 5/9 to 1 of the way, the middle of the whole taken off.
        assert!((factors[0] - (1.0 + 0.02 * (5.0 / 9.0 - 0.5))).abs() < 1e-12);
        assert!((factors[4] - 1.01).abs() < 1e-12);
        assert_eq!(offset(CurveShape::Decay(2.0), 0, 10), 1.0);
        assert!((range(&line, 10).0 - 0.99).abs() < 1e-12);
    }
}
