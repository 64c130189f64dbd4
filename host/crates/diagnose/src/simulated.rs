//! Replicates of the dark and flat stacks that were simulated: each once, however often the search comes by its model.

use super::design::Design;
use super::prediction::{Values, by_key};
use super::replicate;
use super::statistics::{Place, Scale, Statistic, What, battery};
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_sensor_core::effects::Effect;
use rayon::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};

/// What replicates of sensors that differ in nothing but their chains showed, under one design.
#[derive(Default)]
pub(super) struct Simulated {
    known: Mutex<Vec<Known>>,
}

/// Of one chain, replicate after replicate.
struct Known {
    chain: Vec<Effect>,
    replicates: Vec<Arc<Values>>,
}

impl Simulated {
    /// The statistics of the first `runs` replicates of a camera's stacks, the first with this seed.
    ///
    /// # Errors
    /// A model that the sensor refuses.
    pub(super) fn of(
        &self,
        camera: &Camera,
        design: &Design,
        first: u64,
        runs: u64,
    ) -> Result<Vec<Arc<Values>>> {
        let chain = camera.chain();
        let mut replicates = {
            let known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
            known.iter().find(|k| k.chain == chain).map_or_else(Vec::new, |k| k.replicates.clone())
        };
        let had = replicates.len();
        let more: Vec<Arc<Values>> = (had as u64..runs)
            .into_par_iter()
            .map(|run| Ok(Arc::new(replicated(camera, design, first + run)?)))
            .collect::<Result<_>>()?;
        if !more.is_empty() {
            replicates.extend(more);
            let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
            known.retain(|k| k.chain != chain);
            known.push(Known { chain, replicates: replicates.clone() });
        }
        replicates.truncate(runs as usize);
        Ok(replicates)
    }
}

/// The statistics of one replicate.
fn replicated(camera: &Camera, design: &Design, seed: u64) -> Result<Values> {
    let planes = makes_lines(camera);
    let stacks = replicate::simulate(camera, design, seed, planes)?;
    let mut values = by_key(battery(camera, design, &stacks));
    if !planes {
        add_flat_planes(&mut values, design);
    }
    Ok(values)
}

/// Whether a model's frames have lines over both frequencies: waves, or light that is another in each frame and is seen by
/// pixels of several colours.
fn makes_lines(camera: &Camera) -> bool {
    let colour = camera.sensor.channel_names.len() > 1;
    camera.effects.iter().any(|e| match e.entry().kind {
        "periodic-pattern-noise" => true,
        "light-flicker" | "flicker-banding" => colour,
        _ => false,
    })
}

/// Adds what a model without waves predicts for the peak of the power: a standard normal deviate, by construction.
fn add_flat_planes(values: &mut Values, design: &Design) {
    for i in 0..design.conditions.len() {
        let place = Place::Stack(i);
        if values.contains_key(&(place, What::RowPeak)) {
            let what = What::PlanePeak;
            let flat = Statistic { place, what, value: 0.0, sd: 1.0, scale: Scale::Linear };
            values.insert((place, what), flat);
        }
    }
}
