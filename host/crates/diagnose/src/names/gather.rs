//! The stacks that names are read from, of the captures and of a model under their conditions.

use crate::data::design::{Condition, Stack as Taken};
use crate::measured::{Measured, SEED};
use crate::model::effects::dn_per_e;
use crate::model::replicate;
use camrig_base::{Plane, Result, Value};
use camrig_camera::Camera;
use camrig_captures::Role;
use camrig_clean::Cleaned;
use camrig_estimates::{Estimates, Sites, Stack, estimate};
use rayon::prelude::*;

/// Most samples in memory, from which a gain is known to 0.1 %; of larger sets the middle of the
/// frames is used.
const MAX_SAMPLES: usize = 1 << 25;
/// Seed of the simulated frames, apart from those of replicates.
const FRAMES_SEED: u64 = SEED + 500;
/// Samples from which a model's gains of sites are taken: one simulation of small frames scatters
/// as much as the captures do, and hides what they show. Chosen: two seconds of one processor.
const MIN_SIMULATED: usize = 1 << 21;
/// Most simulations: with eight, the model adds a sixteenth to the error of a difference.
const MAX_SIMULATIONS: usize = 8;

/// What the stacks have in common.
#[derive(Clone, Copy)]
pub(super) struct Given {
    pub temperature_c: f64,
    pub analog_gain: f64,
    /// DN per electron of the model.
    pub dn_per_e: f64,
}

/// Whole stacks of one gain, the darks of one temperature, the shortest dark stack of each other
/// gain, and the part of the frames that is used.
pub(super) struct Gathered {
    conditions: Vec<Condition>,
    sites: Sites,
    /// DN per electron of the model, where the captures show none.
    dn_per_e: f64,
    /// First column and row, columns and rows.
    part: [usize; 4],
}

impl Gathered {
    /// Of the gain and temperature with the most stacks, and of them the lowest gain.
    pub(super) fn of(camera: &Camera, set: &Cleaned, measured: &Measured) -> Option<Self> {
        let mut all: Vec<Condition> = Vec::new();
        for c in [&measured.fit, &measured.holdout].iter().flat_map(|h| &h.design.conditions) {
            if !all.iter().any(|a| a.stack.capture == c.stack.capture) {
                let stack = Taken { skip: 0, frames: c.stack.total, ..c.stack.clone() };
                all.push(Condition { stack, ..c.clone() });
            }
        }
        let alike = |a: &Condition, b: &Condition| {
            a.stack.analog_gain == b.stack.analog_gain
                && (a.stack.temperature_c - b.stack.temperature_c).abs() < f64::EPSILON
        };
        let count = |c: &Condition| all.iter().filter(|o| alike(c, o)).count();
        let first = all
            .iter()
            .filter(|c| !c.is_flat())
            .max_by(|a, b| {
                (count(a), -a.stack.analog_gain)
                    .partial_cmp(&(count(b), -b.stack.analog_gain))
                    .unwrap_or(std::cmp::Ordering::Equal)
            })?
            .clone();
        let same_temperature = |c: &&Condition| {
            (c.stack.temperature_c - first.stack.temperature_c).abs() < f64::EPSILON
        };
        let mut others: Vec<Condition> =
            all.iter().filter(|c| !c.is_flat()).filter(same_temperature).cloned().collect();
        others.sort_by(|a, b| a.stack.exposure_s.total_cmp(&b.stack.exposure_s));
        // The spread of gains, and shot noise, are those of any temperature.
        let same_gain = |c: &Condition| c.stack.analog_gain == first.stack.analog_gain;
        all.retain(|c| alike(c, &first) || c.is_flat() && same_gain(c));
        // The temperature is that of the darks.
        all.sort_by_key(Condition::is_flat);
        for other in others {
            let gain = other.stack.analog_gain;
            if !all.iter().any(|c| c.stack.analog_gain == gain) {
                all.push(other);
            }
        }
        let cfa = set.set().cfa();
        let (width, height) = (set.set().sensor.width, set.set().sensor.height);
        let frames: usize = all.iter().map(|c| c.stack.frames).sum();
        let most = (MAX_SAMPLES / frames.max(1)) as f64 / (width * height) as f64;
        let part = |all: usize, period: usize| {
            let kept = (all as f64 * most.min(1.0).sqrt()) as usize / period * period;
            let kept = if kept >= all / period * period { all } else { kept };
            ((all - kept) / 2 / period * period, kept)
        };
        let ((x, w), (y, h)) = (part(width, cfa.width), part(height, cfa.height));
        let sites = Sites { across: cfa.width, down: cfa.height };
        let dn_per_e = dn_per_e(camera, first.stack.analog_gain);
        Some(Self { conditions: all, sites, dn_per_e, part: [x, y, w, h] })
    }

    pub(super) fn given(&self) -> Given {
        let Taken { temperature_c, analog_gain, .. } = self.conditions[0].stack;
        Given { temperature_c, analog_gain, dn_per_e: self.dn_per_e }
    }

    /// The figures of the captures. The inner error says why there are none.
    pub(super) fn measured(&self, set: &Cleaned) -> Result<Result<Estimates>> {
        let read = |c: &Condition| {
            let mut frames = Vec::with_capacity(c.stack.frames);
            set.for_each_batch_with_torn(c.stack.capture, |planes| {
                frames.extend(planes.iter().map(|p| self.cut(p)));
                Ok(())
            })?;
            Ok(self.stack(c, frames))
        };
        let stacks = self.conditions.iter().map(read).collect::<Result<Vec<_>>>()?;
        Ok(estimate(&stacks, self.sites, self.dn_per_e))
    }

    /// The same figures of frames that a camera simulates. Gains of sites are means over several
    /// simulations of small frames, so that what differs from them scatters as the captures do.
    pub(super) fn modelled(&self, camera: &Camera) -> Result<Result<Estimates>> {
        let mut model = match self.simulated(camera, 0)? {
            Ok(model) => model,
            Err(why) => return Ok(Err(why)),
        };
        let more = (1..self.simulations()).into_par_iter();
        let more = more.map(|run| self.simulated(camera, run)).collect::<Result<Vec<_>>>()?;
        for (i, flat) in model.flats.iter_mut().enumerate() {
            for (s, site) in flat.sites.iter_mut().enumerate() {
                let of = |e: &Estimates| Some(e.flats.get(i)?.sites.get(s)?.gain);
                let gains = more.iter().flatten().filter_map(of).chain([site.gain]);
                site.gain = Value::combine(gains).unwrap_or(site.gain);
            }
        }
        Ok(Ok(model))
    }

    /// How many simulations a model's gains of sites are taken from: one of a sensor without sites.
    fn simulations(&self) -> u64 {
        let frames: usize = self.conditions.iter().map(|c| c.stack.frames).sum();
        let samples = (self.part[2] * self.part[3] * frames).max(1);
        let needed = MIN_SIMULATED.div_ceil(samples).min(MAX_SIMULATIONS);
        if self.sites.count() > 1 { needed as u64 } else { 1 }
    }

    /// The same figures of one simulation.
    pub(super) fn simulated(&self, camera: &Camera, run: u64) -> Result<Result<Estimates>> {
        let simulate = |c: &Condition| {
            let cut = |p: Plane<u16>| self.cut(&p);
            Ok(self.stack(c, replicate::frames(camera, c, FRAMES_SEED + run, &cut)?))
        };
        let stacks = self.conditions.iter().map(simulate).collect::<Result<Vec<_>>>()?;
        Ok(estimate(&stacks, self.sites, self.dn_per_e))
    }

    fn cut(&self, plane: &Plane<u16>) -> Plane<u16> {
        let [x0, y0, width, height] = self.part;
        match (plane.width, plane.height) == (width, height) {
            true => plane.clone(),
            false => Plane::from_fn(width, height, |x, y| plane.row(y0 + y)[x0 + x]),
        }
    }

    fn stack(&self, c: &Condition, frames: Vec<Plane<u16>>) -> Stack {
        let role = if c.is_flat() { Role::Flat } else { Role::Dark };
        Stack::new(&c.stack.id, role, c.stack.exposure_s, frames).at_gain(c.stack.analog_gain)
    }
}
