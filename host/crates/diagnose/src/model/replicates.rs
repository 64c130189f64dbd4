//! Replicates of dark and flat stacks, kept: each is simulated once, however often the search
//! returns to its model.

use super::replicate;
use crate::data::design::Design;
use crate::statistics::battery::battery;
use crate::statistics::read::min_stacks_per_thread;
use crate::statistics::statistic::{Key, Place, Scale, Statistic, Values, What, by_key};
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_sensor_core::effects::Effect;
use rayon::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};

/// Excess kurtosis of the noise over the number of pixels from which few of them have most of its
/// power: a spectrum of few points has no highest line of many independent ones. Chosen: a power
/// from a hundred pixels has a relative variance of a hundredth more.
const FEW_PIXELS: f64 = 0.01;

/// Statistics of replicates under one design, of sensors that differ only in their effects.
#[derive(Default)]
pub struct Replicates {
    known: Mutex<Vec<Known>>,
}

/// The replicates of one chain of effects with its tables, in the order of their seeds.
struct Known {
    chain: (Vec<Effect>, Vec<f32>),
    replicates: Vec<Arc<Values>>,
}

impl Replicates {
    /// The statistics of `runs` replicates of a camera's dark and flat stacks, with the seeds from
    /// `first` on; always asked for with the same `design` and `first`.
    ///
    /// # Errors
    /// A model that the sensor refuses.
    pub fn of(
        &self,
        camera: &Camera,
        design: &Design,
        first: u64,
        runs: u64,
    ) -> Result<Vec<Arc<Values>>> {
        let chain = (camera.chain(), camera.table());
        let mut replicates = {
            let known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
            known.iter().find(|k| k.chain == chain).map_or_else(Vec::new, |k| k.replicates.clone())
        };
        let had = replicates.len();
        let pixels = (camera.sensor.width * camera.sensor.height) as usize;
        let more: Vec<Arc<Values>> = (had..(runs as usize).max(had))
            .into_par_iter()
            .with_min_len(min_stacks_per_thread(design, pixels))
            .map(|run| Ok(Arc::new(replicated(camera, design, first + run as u64)?)))
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
    let simulated = |planes: bool| -> Result<Values> {
        let stacks = replicate::simulate(camera, design, seed, planes)?;
        Ok(by_key(battery(camera, design, &stacks)))
    };
    if makes_lines(camera) {
        return simulated(true);
    }
    let mut values = simulated(false)?;
    let pixels = f64::from(camera.sensor.width * camera.sensor.height);
    let by_few =
        |(_, what): &Key, s: &Statistic| *what == What::Kurtosis && s.value > FEW_PIXELS * pixels;
    if values.iter().any(|(key, s)| by_few(key, s)) {
        return simulated(true);
    }
    add_flat_planes(&mut values, design);
    Ok(values)
}

/// Whether a model's frames may have lines in their spectrum over both frequencies, or no flat one:
/// periodic noise, offsets of every other column or of sites, light that differs from frame to
/// frame and is seen by pixels of several colours, noise of any shape.
fn makes_lines(camera: &Camera) -> bool {
    let colour = camera.sensor.channel_names.len() > 1;
    camera.effects.iter().any(|e| match e {
        Effect::PeriodicPatternNoise(_) | Effect::Empirical(_) | Effect::FrameOffsetBySite(_) => {
            true
        }
        Effect::RowTemporalNoise(rows) => rows.opposite_e > 0.0,
        Effect::LightFlicker(_) | Effect::FlickerBanding(_) => colour,
        _ => false,
    })
}

/// Adds what a model without such lines predicts for the highest one, which is a standard normal
/// deviate by construction: the spectrum need not be computed.
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
