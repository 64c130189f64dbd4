//! Candidates: for each kind of the catalogue, how large it would have to be to explain what is seen.
//!
//! An estimator reads its own statistic: measured less predicted, turned into the effect's parameter. What the
//! present model already has of the effect is part of the prediction, so estimators give the whole new value and
//! may be repeated until nothing moves. Whether the effect is the true one is not theirs to say: the search judges
//! by all statistics.

mod fixed;
mod noise;
mod response;

use super::evidence::{Estimated, Evidence};
use super::model;
use crate::camera::Camera;
use sensor_core::effects::Effect;

/// A change of the model that would explain something.
#[derive(Clone, Debug)]
pub struct Proposal {
    /// Name in the catalogue.
    pub kind: &'static str,
    /// What is put in the model.
    pub effects: Vec<Effect>,
    /// Whether the effects stand beside others of their kind.
    pub beside: bool,
    /// Parameters with standard errors.
    pub parameters: Vec<(&'static str, Estimated)>,
    /// How far the amplitude is from what the model has, in standard errors.
    pub strength: f64,
}

impl Proposal {
    fn new(kind: &'static str, effect: Effect, strength: f64) -> Self {
        Self { kind, effects: vec![effect], beside: false, parameters: Vec::new(), strength }
    }

    fn with(mut self, key: &'static str, value: f64, se: f64) -> Self {
        self.parameters.push((key, Estimated { value, se }));
        self
    }

    fn and(mut self, effect: Effect) -> Self {
        self.effects.push(effect);
        self
    }

    /// The camera with this change.
    pub fn applied(&self, camera: &Camera) -> Camera {
        let mut camera = camera.clone();
        for effect in &self.effects {
            if self.beside {
                model::add(&mut camera, *effect);
            } else {
                model::put(&mut camera, *effect);
            }
        }
        camera
    }

    /// Whether every parameter is within the catalogue's range.
    fn is_possible(&self) -> bool {
        self.strength.is_finite()
            && self.effects.iter().all(|e| Effect::new(e.entry().id, &e.values()).is_some())
    }
}

/// An estimator: proposals of one kind, none where the captures do not show it.
type Estimator = fn(&Evidence<'_>) -> Vec<Proposal>;

/// Every kind that is looked for.
pub const CATALOGUE: [(&str, Estimator); 37] = [
    ("row-temporal-noise", noise::row_temporal),
    ("column-temporal-noise", noise::column_temporal),
    ("row-correlated-noise", noise::row_correlated),
    ("periodic-pattern-noise", noise::periodic),
    ("frame-offset-noise", noise::frame_offset),
    ("light-flicker", noise::light_flicker),
    ("flicker-banding", noise::flicker_banding),
    ("read-noise", noise::read_noise),
    ("read-noise-spread", noise::read_noise_spread),
    ("random-telegraph-noise", noise::telegraph),
    ("heavy-tailed-read-noise", noise::heavy_tails),
    ("charge-coupling", noise::charge_coupling),
    ("brighter-fatter", noise::brighter_fatter),
    ("row-offset-fpn", fixed::row_offset),
    ("column-offset-fpn", fixed::column_offset),
    ("pixel-offset-fpn", fixed::pixel_offset),
    ("readout-channel-mismatch", fixed::readout_channels),
    ("hot-pixels", fixed::hot_pixels),
    ("dark-current", fixed::dark_current),
    ("dark-current-temperature", fixed::doubling),
    ("amp-glow", fixed::amp_glow),
    ("dark-current-gradient", fixed::gradient),
    ("prnu", fixed::prnu),
    ("column-gain-fpn", fixed::column_gain),
    ("prnu-low-frequency", fixed::smooth_gain),
    ("relative-illumination", fixed::relative_illumination),
    ("green-imbalance", fixed::green_imbalance),
    ("defective-pixels", fixed::defects),
    ("black-level-offset", response::black_level),
    ("system-gain", response::system_gain),
    ("quantum-efficiency", response::quantum_efficiency),
    ("nonlinearity", response::nonlinearity),
    ("full-well", response::full_well),
    ("optical-crosstalk", response::optical_crosstalk),
    ("adc-nonlinearity", response::adc_steps),
    ("image-lag", response::image_lag),
    ("exposure-offset", response::exposure_offset),
];

/// Every proposal that the evidence gives, strongest first, weaker than `least` standard errors left out.
pub fn propose(evidence: &Evidence<'_>, without: &[String], least: f64) -> Vec<Proposal> {
    let mut out: Vec<Proposal> = CATALOGUE
        .iter()
        .filter(|(kind, _)| !without.iter().any(|w| w == kind))
        .flat_map(|(_, estimate)| estimate(evidence))
        .filter(|p| p.is_possible() && p.strength >= least)
        .collect();
    out.sort_by(|a, b| b.strength.total_cmp(&a.strength));
    out
}

/// One proposal, or none.
fn list(p: Option<Proposal>) -> Vec<Proposal> {
    p.into_iter().collect()
}

/// New standard deviation from the present one and an excess of variance; `None` where none is left.
fn deviation(present: f64, excess: Estimated) -> Option<Estimated> {
    let variance = present * present + excess.value;
    (variance > 0.0).then(|| {
        let value = variance.sqrt();
        Estimated { value, se: excess.se / (2.0 * value) }
    })
}
