//! Measured statistics, and those that the present model predicts.

use super::slopes::Slopes;
use crate::data::channels::Channels;
use crate::data::design::{Condition, Design};
use crate::model::effects::dn_per_e;
use crate::model::prediction::Prediction;
use crate::statistics::maps::{
    Map, MapKind, SATURATED_FLAT, black_level, reference_dark, saturated,
};
use crate::statistics::statistic::{Key, Place, Scale, Values, What};
use crate::statistics::temporal::Temporal;
use camrig_base::Result;
use camrig_base::Value;
use camrig_camera::Camera;
use camrig_captures::Role;
use std::collections::BTreeMap;

/// Measurement and model side by side.
pub struct Evidence<'a> {
    /// The present model.
    pub camera: &'a Camera,
    /// How the stacks were taken.
    pub design: &'a Design,
    /// Measured statistics.
    pub data: &'a Values,
    /// What the model predicts.
    pub model: &'a Prediction,
    /// Measured moments.
    pub stacks: &'a [Temporal],
    /// Measured maps.
    pub maps: &'a [Map],
    /// Scatter that comes from the set-up.
    pub allowance: &'a BTreeMap<Key, f64>,
    /// Simulates the statistics of targets for a camera, always with the same random numbers.
    pub simulate_targets: &'a dyn Fn(&Camera) -> Result<Values>,
    /// Derivatives of those statistics found so far.
    pub slopes: &'a Slopes,
    /// Kinds named already that captures of targets show.
    pub named: Vec<&'static str>,
}

impl Evidence<'_> {
    /// Columns and rows of a frame.
    pub fn size(&self) -> (f64, f64) {
        (f64::from(self.camera.sensor.width), f64::from(self.camera.sensor.height))
    }

    /// Measured value.
    pub fn measured(&self, place: Place, what: What) -> Option<f64> {
        self.data.get(&(place, what)).map(|s| s.value)
    }

    /// Predicted value.
    pub fn predicted(&self, place: Place, what: What) -> Option<f64> {
        self.model.of.get(&(place, what)).map(|p| p.value)
    }

    /// Measured less predicted, in the statistic's own unit, with the scatter that theory gives
    /// the measured value.
    pub fn difference(&self, place: Place, what: What) -> Option<Value> {
        let key = (place, what);
        let (s, p) = (self.data.get(&key)?, self.model.of.get(&key)?);
        // From the statistic's scale to its own unit, at the prediction: a scatter that followed
        // the measured value would give small values more weight.
        let factor = match p.scale {
            Scale::Linear => 1.0,
            Scale::Log => p.value,
            Scale::CubeRoot => 3.0 * libm::pow(p.value.max(0.0), 2.0 / 3.0),
            Scale::Count => s.value.max(p.value).max(1.0).sqrt() / p.sd,
        };
        let allowed = self.allowance.get(&key).copied().unwrap_or(0.0);
        Some(Value { value: s.value - p.value, std_error: libm::hypot(p.sd, allowed) * factor })
    }

    /// Mean of the channels' pixel variance, measured and predicted, DN².
    pub fn variance(&self, stack: usize) -> Option<(f64, f64)> {
        let (mut d, mut m, mut n) = (0.0, 0.0, 0.0);
        for class in 0..self.camera.sensor.channel_names.len() as u8 {
            let place = Place::Stack(stack);
            d += self.measured(place, What::Variance(class))?;
            m += self.predicted(place, What::Variance(class))?;
            n += 1.0;
        }
        Some((d / n, m / n))
    }

    /// Excess of the mean pixel variance over the model, DN².
    pub fn variance_excess(&self, stack: usize) -> Option<Value> {
        let classes = self.camera.sensor.channel_names.len() as u8;
        let place = Place::Stack(stack);
        let parts: Option<Vec<Value>> =
            (0..classes).map(|c| self.difference(place, What::Variance(c))).collect();
        let parts = parts?;
        let n = parts.len() as f64;
        let var = parts.iter().map(|p| p.std_error * p.std_error).sum::<f64>() / (n * n);
        Some(Value {
            value: parts.iter().map(|p| p.value).sum::<f64>() / n,
            std_error: var.sqrt(),
        })
    }

    /// Excess, DN², of a variance that is kept as its ratio to the pixel variance over `across`
    /// pixels.
    pub fn component(&self, stack: usize, what: What, across: f64) -> Option<Value> {
        let place = Place::Stack(stack);
        let (d, m) = (self.measured(place, what)?, self.predicted(place, what)?);
        let (vd, vm) = self.variance(stack)?;
        let relative = self.difference(place, what)?.std_error / m;
        let value = (d * vd - m * vm) / across;
        // The ratio of white noise is 1; a smaller one in a replicate is scatter.
        Some(Value { value, std_error: relative * m * vm / across })
    }

    /// Deviation of several statistics together from the model, Σ z/√n, each on the scale on which
    /// it is normal: a significance that holds even with few degrees of freedom, where an
    /// estimate's standard error is as uncertain as the estimate.
    pub fn stands_out(&self, keys: impl Iterator<Item = (Place, What)>) -> f64 {
        let z = keys.filter_map(|key| {
            let (s, p) = (self.data.get(&key)?, self.model.of.get(&key)?);
            let allowed = self.allowance.get(&key).copied().unwrap_or(0.0);
            Some((p.scale.of(s.value) - p.scaled) / libm::hypot(p.sd, allowed))
        });
        let (sum, n) = z.fold((0.0, 0.0), |(sum, n), z| (sum + z, n + 1.0));
        sum / f64::max(n, 1.0).sqrt()
    }

    /// Mean signal above dark, DN; of dark stacks about 0.
    pub fn signal(&self, stack: usize) -> Option<f64> {
        let black = black_level(self.camera, self.design, self.stacks);
        Some(self.stacks[stack].level() - black)
    }

    /// Mean signal of each channel above dark, DN.
    pub fn levels(&self, stack: usize) -> Vec<f64> {
        let channels = Channels::new(self.camera);
        let means = channels.means(&self.stacks[stack].mean.data);
        let black = match reference_dark(self.design) {
            Some(r) => channels.means(&self.stacks[r].mean.data),
            None => vec![self.camera.sensor.black_level_dn; means.len()],
        };
        means.iter().zip(black).map(|(m, b)| m - b).collect()
    }

    /// Stacks of a role, with their conditions.
    pub fn of_role(&self, role: Role) -> impl Iterator<Item = (usize, &Condition)> {
        self.design.conditions.iter().enumerate().filter(move |(_, c)| c.stack.role == role)
    }

    /// Flats below saturation.
    pub fn flats(&self) -> impl Iterator<Item = (usize, &Condition)> {
        self.of_role(Role::Flat).filter(|(i, _)| saturated(&self.stacks[*i]) < SATURATED_FLAT)
    }

    /// System gain in a stack, DN/e⁻.
    pub fn gain(&self, c: &Condition) -> f64 {
        dn_per_e(self.camera, c.stack.analog_gain)
    }

    /// A map of the measured frames.
    pub fn map(&self, kind: MapKind) -> Option<&Map> {
        self.maps.iter().find(|m| m.kind == kind)
    }

    /// System gain of the reference dark stack, DN/e⁻.
    pub fn reference_gain(&self) -> Option<f64> {
        let i = reference_dark(self.design)?;
        Some(self.gain(&self.design.conditions[i]))
    }
}

/// Slope of y over x of a line through the origin, weighted by inverse variance, for points (x,
/// y).
pub fn slope(points: impl IntoIterator<Item = (f64, Value)>) -> Option<Value> {
    let ratios = points.into_iter().filter(|(x, _)| *x != 0.0).map(|(x, y)| y.scaled(1.0 / x));
    Value::combine(ratios)
}
