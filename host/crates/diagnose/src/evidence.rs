//! What an estimator sees: the measured statistics, what the present model predicts for them, and the stacks.

use super::candidates::Slopes;
use super::channels::Channels;
use super::design::{Condition, Design};
use super::maps::Map;
use super::model::dn_per_e;
use super::prediction::{Key, Prediction, Values};
use super::statistics::{Place, What};
use super::temporal::Temporal;
use camrig_base::Result;
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
    /// What a replicate of a camera would show of edges, dots and charts, always with the same random numbers.
    pub imagine: &'a dyn Fn(&Camera) -> Result<Values>,
    /// What parameters do to them, as far as it was asked.
    pub slopes: &'a Slopes,
    /// Kinds named already that edges, dots and charts show.
    pub named: Vec<&'static str>,
}

/// A value with its standard error.
#[derive(Clone, Copy, Debug)]
pub struct Estimated {
    /// The value.
    pub value: f64,
    /// Its standard error.
    pub se: f64,
}

impl Estimated {
    /// Distance from zero in standard errors.
    pub fn z(&self) -> f64 {
        self.value / self.se
    }
}

/// Inverse-variance mean.
pub fn pooled(values: impl IntoIterator<Item = Estimated>) -> Option<Estimated> {
    let (mut sum, mut weight) = (0.0, 0.0);
    for e in values {
        let w = 1.0 / (e.se * e.se);
        if w.is_finite() && e.value.is_finite() {
            sum += w * e.value;
            weight += w;
        }
    }
    (weight > 0.0).then(|| Estimated { value: sum / weight, se: weight.sqrt().recip() })
}

/// Slope of y over x through the origin, weighted.
pub fn slope(points: impl IntoIterator<Item = (f64, Estimated)>) -> Option<Estimated> {
    pooled(
        points
            .into_iter()
            .filter(|(x, _)| *x != 0.0)
            .map(|(x, y)| Estimated { value: y.value / x, se: y.se / x.abs() }),
    )
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

    /// Measured less predicted, with the scatter that theory gives the measured value.
    pub fn difference(&self, place: Place, what: What) -> Option<Estimated> {
        let key = (place, what);
        let (s, p) = (self.data.get(&key)?, self.model.of.get(&key)?);
        // From the statistic's scale to its own, where the prediction is: a scatter that followed the measured value would
        // favour the small ones.
        let factor = match p.scale {
            super::statistics::Scale::Linear => 1.0,
            super::statistics::Scale::Log => p.value,
            super::statistics::Scale::CubeRoot => 3.0 * p.value.max(0.0).powf(2.0 / 3.0),
            super::statistics::Scale::Count => s.value.max(p.value).max(1.0).sqrt() / p.sd,
        };
        let allowed = self.allowance.get(&key).copied().unwrap_or(0.0);
        Some(Estimated { value: s.value - p.value, se: p.sd.hypot(allowed) * factor })
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
    pub fn variance_excess(&self, stack: usize) -> Option<Estimated> {
        let classes = self.camera.sensor.channel_names.len() as u8;
        let parts: Option<Vec<Estimated>> =
            (0..classes).map(|c| self.difference(Place::Stack(stack), What::Variance(c))).collect();
        let parts = parts?;
        let n = parts.len() as f64;
        let var = parts.iter().map(|p| p.se * p.se).sum::<f64>() / (n * n);
        Some(Estimated { value: parts.iter().map(|p| p.value).sum::<f64>() / n, se: var.sqrt() })
    }

    /// Excess of a variance that is kept as a ratio to the pixel variance over `across` pixels, DN².
    pub fn component(&self, stack: usize, what: What, across: f64) -> Option<Estimated> {
        let place = Place::Stack(stack);
        let (d, m) = (self.measured(place, what)?, self.predicted(place, what)?);
        let (vd, vm) = self.variance(stack)?;
        let relative = self.difference(place, what)?.se / m;
        let value = (d * vd - m * vm) / across;
        // The ratio of white noise is 1: a smaller ratio in a replicate is its scatter.
        Some(Estimated { value, se: relative * m * vm / across })
    }

    /// Deviation of statistics from the model, each on the scale on which it is normal, together: Σ z/√n. Few degrees of
    /// freedom make the standard error of an estimate as uncertain as the estimate; this is what chance gives.
    pub fn stands_out(&self, keys: impl Iterator<Item = (Place, What)>) -> f64 {
        let z = keys.filter_map(|key| {
            let (s, p) = (self.data.get(&key)?, self.model.of.get(&key)?);
            let allowed = self.allowance.get(&key).copied().unwrap_or(0.0);
            Some((p.scale.of(s.value) - p.scaled) / p.sd.hypot(allowed))
        });
        let (sum, n) = z.fold((0.0, 0.0), |(sum, n), z| (sum + z, n + 1.0));
        sum / f64::max(n, 1.0).sqrt()
    }

    /// Signal above dark, mean of the channels, DN; of dark stacks about 0.
    pub fn signal(&self, stack: usize) -> Option<f64> {
        let black = match super::maps::reference_dark(self.design) {
            Some(r) => self.stacks[r].level(),
            None => self.camera.sensor.black_level_dn,
        };
        Some(self.stacks[stack].level() - black)
    }

    /// Signal of each channel above dark, DN.
    pub fn levels(&self, stack: usize) -> Vec<f64> {
        let channels = Channels::new(self.camera);
        let means = channels.means(&self.stacks[stack].mean.data);
        let black = match super::maps::reference_dark(self.design) {
            Some(r) => channels.means(&self.stacks[r].mean.data),
            None => vec![self.camera.sensor.black_level_dn; means.len()],
        };
        means.iter().zip(black).map(|(m, b)| m - b).collect()
    }

    /// Stacks of a role, with their conditions.
    pub fn of_role(&self, role: Role) -> impl Iterator<Item = (usize, &Condition)> {
        self.design.conditions.iter().enumerate().filter(move |(_, c)| c.role == role)
    }

    /// Flats below saturation.
    pub fn flats(&self) -> impl Iterator<Item = (usize, &Condition)> {
        self.of_role(Role::Flat).filter(|(i, _)| super::maps::saturated(&self.stacks[*i]) < 1e-5)
    }

    /// DN per electron in a stack.
    pub fn gain(&self, c: &Condition) -> f64 {
        dn_per_e(self.camera, c.analog_gain)
    }

    /// A map of the measured frames.
    pub fn map(&self, kind: super::maps::MapKind) -> Option<&Map> {
        self.maps.iter().find(|m| m.kind == kind)
    }

    /// DN per electron of the reference dark stack.
    pub fn reference_gain(&self) -> Option<f64> {
        let i = super::maps::reference_dark(self.design)?;
        Some(self.gain(&self.design.conditions[i]))
    }
}
