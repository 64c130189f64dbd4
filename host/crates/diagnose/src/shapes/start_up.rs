//! The first frames after a start, whose level deviates in the dark and in light equally. They are
//! found in all stacks together before anything is measured (`camrig_clean`); here they become a
//! stage of the model.

use super::Shape;
use super::seen::Seen;
use super::view::{View, gain};
use crate::data::design::Design;
use crate::finding::{Finding, number};
use crate::report::{Domain, Form};
use crate::statistics::temporal::Temporal;
use camrig_base::Value;
use camrig_camera::Camera;
use camrig_camera::empirical::{Curve as Knots, Empirical, Table};
use camrig_clean::{CurveShape, FrameCurve};
use camrig_sensor_core::effects::empirical::Quantity;

/// Time constants after which a decay has ended: a thousandth is left.
const TIME_CONSTANTS: f64 = 7.0;
/// Longest decay, frames: what a quarter of a sensor's tables can store.
const MAX_FRAMES: usize = 128;

struct StartUp {
    curve: FrameCurve,
    /// DN per electron.
    gain: f64,
    /// Frames of each stack.
    frames: usize,
}

/// The curve as a shape, where a single amplitude in electrons describes it: at one gain, and, if
/// it does not decay, with stacks of one length.
pub(crate) fn of(camera: &Camera, design: &Design, curve: FrameCurve) -> Option<Box<dyn Shape>> {
    let first = design.conditions.first()?;
    let (gain, frames) = (gain(camera, first), first.stack.total);
    let alike = |c: &crate::data::design::Condition| {
        c.stack.analog_gain == first.stack.analog_gain
            && (matches!(curve.shape, CurveShape::Decay(_)) || c.stack.total == frames)
    };
    let short = match curve.shape {
        CurveShape::Decay(tau) => TIME_CONSTANTS * tau < MAX_FRAMES as f64,
        CurveShape::Line => true,
    };
    let sound = short && design.conditions.iter().all(alike);
    sound.then(|| Box::new(StartUp { curve, gain, frames }) as Box<dyn Shape>)
}

impl StartUp {
    fn knots(&self) -> Knots {
        match self.curve.shape {
            // Every frame up to its end is a knot, so that nothing is interpolated.
            CurveShape::Decay(tau) => {
                let end = (TIME_CONSTANTS * tau).ceil() as usize;
                let value = |i| if i < end { self.curve.shape.at(i, self.frames) } else { 0.0 };
                let (at, values) = (0..=end).map(|i| (i as f64, value(i))).unzip();
                Knots { at, values }
            }
            CurveShape::Line => {
                let last = self.frames.saturating_sub(1).max(1) as f64;
                Knots { at: vec![0.0, last], values: vec![-0.5, 0.5] }
            }
        }
    }

    fn amount_e(&self) -> Value {
        let FrameCurve { amplitude, std_error, .. } = self.curve;
        Value { value: amplitude, std_error }.scaled(1.0 / self.gain)
    }
}

impl Shape for StartUp {
    /// The moments keep it: the model that is searched with has the same curve.
    fn subtract(&self, _: &Camera, _: &Design, _: &mut [Temporal]) {}

    fn stages(&self, _: &mut Camera, _: &Design) -> Vec<Empirical> {
        let table = Table::FrameCurve(self.knots());
        vec![Empirical::new(Quantity::Offset, table, self.amount_e().value)]
    }

    fn seen(&self, view: &View<'_>) -> Option<Seen> {
        let frames = view.stacks.iter().map(|t| t.frame_means.len()).max()?;
        let skip = view.design.conditions.first()?.stack.skip;
        let level = |i: usize| -> f64 {
            let own = view.stacks.iter().filter(|t| i < t.frame_means.len());
            let off: Vec<f64> = own.map(|t| t.frame_means[i] - t.level()).collect();
            off.iter().sum::<f64>() / off.len().max(1) as f64 / self.gain
        };
        let points = (0..frames).map(|i| [(skip + i) as f64, level(i)]);
        let y = "level of a frame over the mean of its stack, e⁻";
        Some(Seen::curve("frames since the start", y, points))
    }

    fn findings(&self) -> Vec<Finding> {
        let amount = self.amount_e();
        let mut parameters = vec![("amplitude_e", amount)];
        let how = match self.curve.shape {
            CurveShape::Decay(tau) => {
                let tau = Value { value: tau, std_error: self.curve.tau_std_error };
                parameters.push(("length_frames", tau));
                format!("at the first frame, falling by a factor e every {} frames", number(tau))
            }
            CurveShape::Line => "from the first frame of a stack to its last".to_string(),
        };
        // It was fitted to all frames together: none are held out.
        let evidence = [(amount.value / amount.std_error).powi(2), f64::NAN];
        vec![Finding {
            parameters,
            description: format!(
                "the level of frames after a start of the sensor, equal in the dark and in light: {} \
                 e⁻ {how}",
                number(amount)
            ),
            ..Finding::new(Domain::Offset, Form::FrameCurve, evidence)
        }]
    }
}
