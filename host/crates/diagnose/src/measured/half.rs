//! One half of a set as it was measured.

use super::{assumed_light, consistency};
use crate::data::curve;
use crate::data::design::{Design, Target};
use crate::evidence::Slopes;
use crate::model::light::{Electrons, Lights};
use crate::model::prediction::Prediction;
use crate::model::replicate;
use crate::model::replicates::Replicates;
use crate::shapes::Shape;
use crate::statistics::battery::battery;
use crate::statistics::maps::{self, Map};
use crate::statistics::statistic::{Key, Place, Values, by_key};
use crate::statistics::targets::{self, Picture};
use crate::statistics::temporal::Temporal;
use crate::statistics::{allowances, read};
use camrig_base::{Plane, Result};
use camrig_camera::Camera;
use camrig_clean::{Cleaned, FrameCurve, Kind};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Seed of the first replicate; the others follow it.
pub const SEED: u64 = 0x5eed;

/// What was measured in one half of a set. It never changes; copies share frames and maps.
#[derive(Clone)]
pub struct Half {
    /// How it was taken.
    pub design: Design,
    /// Moments of its dark and flat stacks; none where only statistics were kept.
    pub stacks: Arc<[Temporal]>,
    /// Pictures of its targets.
    pub pictures: Arc<[Picture]>,
    /// Its statistics.
    pub values: Values,
    /// Standard deviations that come from the set-up, not from the sensor.
    pub allowance: BTreeMap<Key, f64>,
    /// Maps of its dark and flat stacks.
    pub maps: Arc<[Map]>,
    /// Replicates of its dark and flat stacks by the models tried.
    replicates: Arc<Replicates>,
    /// Simulations of targets by the models tried.
    pub(crate) optics: Arc<Optics>,
}

/// Simulations of targets that both halves share.
#[derive(Default)]
pub(crate) struct Optics {
    /// Light of targets through the lenses tried.
    lights: Lights,
    /// Derivatives of the figures of targets.
    pub slopes: Slopes,
}

/// Statistics, moments and maps of a half, measured or simulated: what estimators read.
#[derive(Clone, Copy)]
pub(crate) struct Frames<'a> {
    pub design: &'a Design,
    pub allowance: &'a BTreeMap<Key, f64>,
    pub values: &'a Values,
    pub stacks: &'a [Temporal],
    pub maps: &'a [Map],
}

impl Half {
    pub(super) fn measure(
        camera: &Camera,
        set: &Cleaned,
        mut design: Design,
        curve: Option<FrameCurve>,
        optics: &Arc<Optics>,
        progress: &(dyn Fn(usize) + Sync),
    ) -> Result<Self> {
        if let Some(curve) = curve {
            curve::apply(&mut design, &curve);
        }
        let stacks = read::moments(set, &camera.sensor.pattern(), &design, true, progress)?;
        if let Some(curve) = curve {
            assumed_light::of_drifting_lamp(camera, &mut design, &stacks, &curve);
        }
        assumed_light::of_flats(camera, &mut design, &stacks);
        let pictures = read::pictures(camera, set, &design.targets, progress)?;
        assumed_light::of_targets(camera, &mut design.targets, &pictures, &optics.lights)?;
        let mut values = by_key(battery(camera, &design, &stacks));
        for i in of_unknown_light(&design, &stacks) {
            values.retain(|(place, _), _| *place != Place::Stack(i));
        }
        values.extend(by_key(targets::battery(camera, &design, &pictures)));
        let mut allowance = allowances::of_light(camera, &design, &values);
        if set.findings().iter().any(|f| f.kind == Kind::ParticleHits) {
            allowance.extend(allowances::of_hits(camera, &design));
        }
        let maps = maps::maps(camera, &design, &stacks).into();
        Ok(Half {
            design,
            stacks: stacks.into(),
            pictures: pictures.into(),
            values,
            allowance,
            maps,
            replicates: Arc::default(),
            optics: Arc::clone(optics),
        })
    }

    /// The half with its statistics alone.
    pub(super) fn without_moments(self) -> Self {
        Self { stacks: Arc::default(), maps: Arc::default(), ..self }
    }

    /// The half without shapes: they are subtracted from the moments, and statistics that show
    /// them all the same are left out.
    pub(super) fn without(&self, camera: &Camera, shapes: &[Box<dyn Shape>]) -> Self {
        let mut stacks = self.stacks.to_vec();
        shapes.iter().for_each(|s| s.subtract(camera, &self.design, &mut stacks));
        let mut values = by_key(battery(camera, &self.design, &stacks));
        let of_targets = self.values.iter().filter(|(k, _)| matches!(k.0, Place::Target(_)));
        values.extend(of_targets.map(|(k, s)| (*k, *s)));
        let mut allowance = allowances::of_light(camera, &self.design, &values);
        // The allowance for hits does not depend on the moments.
        for (key, sd) in &self.allowance {
            allowance.entry(*key).or_insert(*sd);
        }
        values.retain(|key, _| {
            self.values.contains_key(key) && !shapes.iter().any(|s| s.shows_in(&self.design, key))
        });
        let maps = maps::maps(camera, &self.design, &stacks).into();
        Self { stacks: stacks.into(), values, allowance, maps, ..self.clone() }
    }

    /// The half as a model without a start-up of its frames predicts it.
    pub(super) fn without_start_up(&self) -> Self {
        let mut half = Self { replicates: Arc::default(), ..self.clone() };
        half.design.conditions.iter_mut().for_each(|c| c.stack.variation.offset_dn.clear());
        half
    }

    /// What was measured, as estimators read it.
    pub(crate) fn frames(&self) -> Frames<'_> {
        Frames {
            design: &self.design,
            allowance: &self.allowance,
            values: &self.values,
            stacks: &self.stacks,
            maps: &self.maps,
        }
    }

    /// Deviance of this half from a prediction.
    pub(crate) fn deviance(&self, prediction: &Prediction) -> f64 {
        prediction.deviance(&self.values, &self.allowance)
    }

    /// Deviations of this half from a prediction, standard deviations.
    pub(crate) fn deviations(&self, prediction: &Prediction) -> BTreeMap<Key, f64> {
        prediction.deviations(&self.values, &self.allowance)
    }

    /// Statistics of so many replicates of this half by a camera.
    pub(crate) fn replicates(&self, camera: &Camera, runs: u64) -> Result<Vec<Values>> {
        let lights = self.lights(camera)?;
        self.replicates
            .of(camera, &self.design, SEED, runs)?
            .into_par_iter()
            .enumerate()
            .map(|(run, stacks)| {
                let mut values = Values::clone(&stacks);
                let seed = SEED + run as u64;
                values.extend(simulate_targets(camera, &self.design, &lights, seed)?);
                Ok(values)
            })
            .collect()
    }

    /// Statistics of the targets in the first replicate by a camera.
    pub(crate) fn replicated_targets(&self, camera: &Camera) -> Result<Values> {
        simulate_targets(camera, &self.design, &self.lights(camera)?, SEED)
    }

    fn lights(&self, camera: &Camera) -> Result<Vec<Electrons>> {
        self.optics.lights.of(camera, &self.design.targets)
    }

    /// The mean frame of a target as a camera would take it, DN.
    ///
    /// # Errors
    /// Those of rendering.
    pub fn picture(&self, camera: &Camera, target: &Target) -> Result<Plane<f32>> {
        let targets = std::slice::from_ref(target);
        let lights = self.optics.lights.of(camera, targets)?;
        let mut pictures = replicate::pictures(camera, targets, &lights, SEED)?;
        Ok(pictures.swap_remove(0).mean)
    }

    /// The maps as another sensor of a camera's make would give them.
    ///
    /// # Errors
    /// A model that the sensor refuses.
    pub fn replicated_maps(&self, camera: &Camera) -> Result<Vec<Map>> {
        let stacks = replicate::simulate(camera, &self.design, SEED, false)?;
        Ok(maps::maps(camera, &self.design, &stacks))
    }
}

/// Statistics of the targets in a replicate.
fn simulate_targets(
    camera: &Camera,
    design: &Design,
    lights: &[Electrons],
    seed: u64,
) -> Result<Values> {
    let pictures = replicate::pictures(camera, &design.targets, lights, seed)?;
    Ok(by_key(targets::battery(camera, design, &pictures)))
}

/// Saturated flats whose light is taken from their own mean: what a model would predict for them
/// is not known.
fn of_unknown_light(design: &Design, stacks: &[Temporal]) -> Vec<usize> {
    let flats = design.conditions.iter().zip(stacks).enumerate();
    let unknown = flats.filter(|(_, (c, t))| {
        c.is_flat() && !c.level_known && maps::saturated(t) >= consistency::SATURATED
    });
    unknown.map(|(i, _)| i).collect()
}
