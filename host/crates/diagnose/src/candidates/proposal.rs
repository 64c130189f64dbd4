//! A proposal: one kind of effect with the parameters that an estimator gave it, and how it is put
//! into a camera.

use crate::model::effects;
use camrig_base::Value;
use camrig_camera::{AnyEffect, Camera};
use camrig_sensor_core::effects::{Effect, Parameter};

/// Significance, standard errors, from which a candidate is simulated, and that a named effect
/// must keep against replicates without it. With some 45 estimators a normal deviate of 4 occurs
/// by chance in one set of 350; what it lets through is judged by simulation.
pub const MIN_STRENGTH: f64 = 4.0;

/// Standard errors by which chance may put an estimate beyond the range of its parameter: it is the
/// end of the range then.
const BEYOND_RANGE: f64 = 3.0;

/// A change of the model that would explain deviations.
#[derive(Clone, Debug)]
pub struct Proposal {
    /// Name of the effect in the catalogue.
    pub kind: &'static str,
    /// Effects that are put into the model.
    pub effects: Vec<AnyEffect>,
    /// New values of effects named earlier, whose parameters had absorbed part of this one.
    pub revised: Vec<AnyEffect>,
    /// Whether the estimate comes from captures of targets (edges, dots, charts) rather than from
    /// dark and flat stacks.
    pub of_targets: bool,
    /// Whether it stands out in its own statistic, whatever the model leaves elsewhere.
    pub by_evidence: bool,
    /// Whether the effects are added to others of their kind instead of replacing them.
    pub beside: bool,
    /// Parameters by key, in the units of the catalogue, with standard errors; the standard error
    /// of a value that was chosen rather than fitted is NaN.
    pub parameters: Vec<(&'static str, Value)>,
    /// Distance of the amplitude from what the model has, standard errors.
    pub strength: f64,
}

impl Proposal {
    /// An effect of the sensor with estimates of its parameters, by key, from dark and flat stacks;
    /// other parameters have their default. `None` where one is out of its range.
    pub(crate) fn of(
        kind: &'static str,
        strength: f64,
        parameters: impl Into<Vec<(&'static str, Value)>>,
    ) -> Option<Self> {
        let mut parameters = parameters.into();
        let entry = Effect::CATALOGUE.iter().find(|entry| entry.kind == kind)?;
        for (key, value) in &mut parameters {
            let declared = entry.parameters.iter().find(|declared| declared.key == *key)?;
            let inside = value.value.clamp(declared.min.into(), declared.max.into());
            if (value.value - inside).abs() < BEYOND_RANGE * value.std_error {
                value.value = inside;
            }
        }
        let value = |declared: &Parameter| {
            let own = parameters.iter().find(|(key, _)| *key == declared.key);
            own.map(|(_, e)| e.value as f32).or(declared.default)
        };
        let values: Vec<f32> = entry.parameters.iter().map(value).collect::<Option<_>>()?;
        let effect = Effect::new(entry.id, &values)?;
        Some(Self { parameters, ..Self::new(kind, effect, strength) })
    }

    /// One effect of the sensor, estimated from dark and flat stacks, without its parameters yet.
    pub(crate) fn new(kind: &'static str, effect: Effect, strength: f64) -> Self {
        let effects = vec![AnyEffect::Sensor(effect)];
        Self { effects, of_targets: false, ..Self::from_targets(kind, strength) }
    }

    /// A kind estimated from captures of targets, without its effects yet.
    pub(super) fn from_targets(kind: &'static str, strength: f64) -> Self {
        Self {
            kind,
            effects: Vec::new(),
            revised: Vec::new(),
            of_targets: true,
            by_evidence: false,
            beside: false,
            parameters: Vec::new(),
            strength,
        }
    }

    /// The same with a parameter, in the catalogue's unit.
    pub(crate) fn with(mut self, key: &'static str, value: Value) -> Self {
        self.parameters.push((key, value));
        self
    }

    /// The same with another effect of the sensor.
    pub(super) fn and(mut self, effect: Effect) -> Self {
        self.effects.push(AnyEffect::Sensor(effect));
        self
    }

    /// The camera with this change.
    pub fn applied(&self, camera: &Camera) -> Camera {
        let mut camera = camera.clone();
        self.revised.iter().for_each(|effect| effects::put(&mut camera, effect));
        for effect in &self.effects {
            match effect {
                AnyEffect::Sensor(effect) if self.beside => effects::add(&mut camera, *effect),
                _ => effects::put(&mut camera, effect),
            }
        }
        camera
    }

    /// Adds this to the named effects, in place of an earlier one of its kind, whose other
    /// parameters it keeps, and gives those that it revises their new values.
    pub fn join(mut self, named: &mut Vec<Proposal>) {
        if let Some(at) = named.iter().position(|p| p.kind == self.kind && !self.beside) {
            let earlier = named.remove(at);
            let others = |key: &str| self.parameters.iter().all(|(own, _)| *own != key);
            let mut kept = Proposal { parameters: earlier.parameters, ..self.clone() };
            kept.parameters.retain(|(key, _)| others(key));
            self.effects.iter().for_each(|effect| kept.take_values(effect));
            self.parameters.extend(kept.parameters);
            self.by_evidence |= earlier.by_evidence;
        }
        for new in std::mem::take(&mut self.revised) {
            if let Some(p) = named.iter_mut().find(|p| p.kind == new.kind()) {
                p.take_values(&new);
                p.effects = vec![new];
            }
        }
        named.push(self);
    }

    /// Whether two proposals of one kind have the same free parameters.
    pub fn has_parameters_of(&self, other: &Proposal) -> bool {
        self.effects.len() == other.effects.len()
            && self.parameters.iter().map(|p| p.0).eq(other.parameters.iter().map(|p| p.0))
    }

    /// A later estimate of this proposal: its values, with the strength found first.
    pub fn updated(&self, later: Proposal) -> Proposal {
        let Self { strength, beside, by_evidence, .. } = *self;
        Proposal { strength, beside, by_evidence, ..later }
    }

    /// Gives the parameters the values of an effect.
    fn take_values(&mut self, effect: &AnyEffect) {
        let declared = effects::declared(effect.kind()).iter().zip(effect.values());
        for (declared, value) in declared {
            let own = self.parameters.iter_mut().filter(|(key, _)| *key == declared.key);
            own.for_each(|(_, parameter)| parameter.value = value.into());
        }
    }

    /// Whether every parameter is within the catalogue's range.
    pub(crate) fn is_possible(&self) -> bool {
        let in_range = |e: &AnyEffect| AnyEffect::new(e.kind(), &e.values()).is_some();
        self.strength.is_finite() && self.effects.iter().chain(&self.revised).all(in_range)
    }
}

/// A camera with every one of some proposals put in, in their order.
pub fn with_all(base: &Camera, proposals: &[Proposal]) -> Camera {
    proposals.iter().fold(base.clone(), |camera, p| p.applied(&camera))
}

/// New standard deviation from the present one and an excess of variance, in the unit of the first
/// and its square; `None` where the variance is not positive.
pub(super) fn deviation(present: f64, excess: Value) -> Option<Value> {
    let value = present * present + excess.value;
    Value { value, ..excess }.sqrt()
}

#[cfg(test)]
mod tests {
    use super::{AnyEffect, Proposal, Value};
    use camrig_sensor_core::effects::dark_current::DarkCurrent;
    use camrig_sensor_core::effects::quantum_efficiency::QuantumEfficiency;
    use camrig_sensor_core::effects::relative_illumination::RelativeIllumination;

    #[test]
    fn a_kind_that_is_named_again_keeps_its_other_parameters() {
        let law = |mean, dsnu| DarkCurrent {
            mean_e_per_s: mean,
            dsnu_e_per_s: dsnu,
            doubling_c: 7.0,
            reference_c: 20.0,
        };
        let mean = Value { value: 2.0, std_error: 0.1 };
        let first = Proposal::new("dark-current", law(2.0, 0.0).into(), 9.0);
        let mut named = vec![first.with("mean_e_per_s", mean)];
        let dsnu = Value { value: 0.5, std_error: 0.02 };
        let second = Proposal::new("dark-current", law(2.5, 0.5).into(), 9.0);
        second.with("dsnu_e_per_s", dsnu).join(&mut named);
        let [only] = &named[..] else { panic!("{named:?}") };
        let of = |key| only.parameters.iter().find(|p| p.0 == key).unwrap().1;
        assert_eq!((of("dsnu_e_per_s").value, of("mean_e_per_s").value), (0.5, 2.5));
        assert_eq!(of("mean_e_per_s").std_error, 0.1);
    }

    #[test]
    fn an_estimate_that_chance_put_beyond_its_range_is_the_end_of_it() {
        let dead = |gain, std_error| {
            let gain = Value { value: gain, std_error };
            let law = [("fraction", Value::chosen(0.03)), ("gain", gain)];
            Proposal::of("defective-columns", 9.0, law)
        };
        assert_eq!(dead(-2e-5, 5e-4).unwrap().parameters[1].1.value, 0.0);
        assert!(!dead(-0.1, 5e-4).is_some_and(|p| p.is_possible()));
    }

    #[test]
    fn a_revised_effect_has_its_new_value_among_effects_and_parameters() {
        let efficiency = |ratio: f32| QuantumEfficiency { ratio }.into();
        let old = Proposal::new("quantum-efficiency", efficiency(0.9993), 9.0);
        let mut named = vec![old.with("ratio", Value { value: 0.9993, std_error: 4e-5 })];
        let mut shading = Proposal::new(
            "relative-illumination",
            RelativeIllumination { corner: -0.006 }.into(),
            9.0,
        );
        shading.revised.push(AnyEffect::Sensor(efficiency(1.0013)));
        shading.join(&mut named);
        let [efficiency, shading] = &named[..] else { panic!("{named:?}") };
        assert!((efficiency.parameters[0].1.value - 1.0013).abs() < 1e-7);
        assert!((efficiency.effects[0].values()[0] - 1.0013).abs() < 1e-7);
        assert!(shading.revised.is_empty());
    }
}
