//! Candidates: for each kind of the catalogue, how large it would have to be to explain what is seen.
//!
//! An estimator reads its own statistic: measured less predicted, turned into the effect's parameter. What the
//! present model already has of the effect is part of the prediction, so estimators give the whole new value and
//! may be repeated until nothing moves. Whether the effect is the true one is not theirs to say: the search judges
//! by all statistics.

mod converter;
mod fixed;
mod flicker;
mod frames;
mod glow;
mod neighbours;
mod noise;
mod optics;
mod periodic;
mod response;
mod rows;
mod smooth;
mod well;

use super::evidence::{Estimated, Evidence};
use super::model;
use camrig_camera::Camera;
use camrig_optics::OpticalEffect;
use camrig_sensor_core::effects::{Effect, Parameter};
pub use optics::{Slopes, shown_by_looks};

/// A change of the model that would explain something.
#[derive(Clone, Debug)]
pub struct Proposal {
    /// Name in the catalogue.
    pub kind: &'static str,
    /// What is put in the model: effects of the sensor.
    pub effects: Vec<Effect>,
    /// Effects of the optics.
    pub optical: Vec<OpticalEffect>,
    /// New values of effects that are named already, which had stood for this one.
    pub along: (Vec<Effect>, Vec<OpticalEffect>),
    /// Whether edges, dots and charts gave it.
    pub of_looks: bool,
    /// Whether the effects stand beside others of their kind.
    pub beside: bool,
    /// Parameters with standard errors.
    pub parameters: Vec<(&'static str, Estimated)>,
    /// How far the amplitude is from what the model has, in standard errors.
    pub strength: f64,
}

impl Proposal {
    pub(super) fn new(kind: &'static str, effect: Effect, strength: f64) -> Self {
        Self { effects: vec![effect], of_looks: false, ..Self::of_looks(kind, strength) }
    }

    fn of_looks(kind: &'static str, strength: f64) -> Self {
        Self {
            kind,
            effects: Vec::new(),
            optical: Vec::new(),
            along: (Vec::new(), Vec::new()),
            of_looks: true,
            beside: false,
            parameters: Vec::new(),
            strength,
        }
    }

    pub(super) fn with(mut self, key: &'static str, value: f64, se: f64) -> Self {
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
        for effect in &self.along.0 {
            model::put(&mut camera, *effect);
        }
        for effect in self.along.1.iter().chain(&self.optical) {
            model::put_optical(&mut camera, effect.clone());
        }
        for effect in &self.effects {
            if self.beside {
                model::add(&mut camera, *effect);
            } else {
                model::put(&mut camera, *effect);
            }
        }
        camera
    }

    /// Adds this to what is named; those that gave way for it get their new values.
    pub fn join(mut self, named: &mut Vec<Proposal>) {
        for p in named.iter_mut() {
            for new in self.along.0.drain(..).collect::<Vec<_>>() {
                if new.entry().kind == p.kind {
                    p.take_values(new.entry().parameters, &new.values());
                    p.effects = vec![new];
                } else {
                    self.along.0.push(new);
                }
            }
            for new in self.along.1.drain(..).collect::<Vec<_>>() {
                if new.entry().kind == p.kind {
                    p.take_values(new.entry().parameters, new.values());
                    p.optical = vec![new];
                } else {
                    self.along.1.push(new);
                }
            }
        }
        self.along = (Vec::new(), Vec::new());
        named.push(self);
    }

    /// Gives the parameters the values of an effect, in the order of its declaration.
    fn take_values(&mut self, declared: &[Parameter], values: &[f32]) {
        for (key, parameter) in &mut self.parameters {
            if let Some(at) = declared.iter().position(|d| d.key == *key) {
                parameter.value = f64::from(values[at]);
            }
        }
    }

    /// Whether every parameter is within the catalogue's range.
    fn is_possible(&self) -> bool {
        self.strength.is_finite()
            && self.effects.iter().all(|e| Effect::new(e.entry().id, &e.values()).is_some())
    }
}

/// The estimator of one kind. It proposes nothing where the captures do not show the effect.
#[derive(Clone, Copy)]
pub enum Estimator {
    /// One estimate at most.
    One(fn(&Evidence<'_>) -> Option<Proposal>),
    /// Several: alternative laws, or parts of the effect by themselves.
    Several(fn(&Evidence<'_>) -> Vec<Proposal>),
}
use Estimator::{One, Several};

impl Estimator {
    fn estimate(self, evidence: &Evidence<'_>) -> Vec<Proposal> {
        match self {
            One(of) => of(evidence).into_iter().collect(),
            Several(of) => of(evidence),
        }
    }
}

/// Every kind that is looked for.
pub const CATALOGUE: [(&str, Estimator); 45] = [
    ("row-temporal-noise", Several(rows::row_temporal)),
    ("column-temporal-noise", Several(rows::column_temporal)),
    ("row-correlated-noise", Several(rows::row_correlated)),
    ("periodic-pattern-noise", Several(periodic::periodic)),
    ("frame-offset-noise", Several(frames::frame_offset)),
    ("light-flicker", Several(frames::light_flicker)),
    ("flicker-banding", Several(flicker::flicker_banding)),
    ("read-noise", Several(noise::read_noise)),
    ("read-noise-spread", Several(noise::read_noise_spread)),
    ("random-telegraph-noise", Several(noise::telegraph)),
    ("heavy-tailed-read-noise", Several(noise::heavy_tails)),
    ("charge-coupling", Several(neighbours::charge_coupling)),
    ("brighter-fatter", Several(neighbours::brighter_fatter)),
    ("row-offset-fpn", Several(fixed::row_offset)),
    ("column-offset-fpn", Several(fixed::column_offset)),
    ("pixel-offset-fpn", Several(fixed::pixel_offset)),
    ("readout-channel-mismatch", Several(fixed::readout_channels)),
    ("hot-pixels", Several(fixed::hot_pixels)),
    ("dark-current", Several(fixed::dark_current)),
    ("dark-current-temperature", Several(fixed::doubling)),
    ("amp-glow", Several(glow::amp_glow)),
    ("dark-current-gradient", Several(fixed::gradient)),
    ("prnu", Several(fixed::prnu)),
    ("prnu-correlated", Several(fixed::prnu_correlated)),
    ("column-gain-fpn", Several(fixed::column_gain)),
    ("prnu-low-frequency", Several(smooth::low_frequency)),
    ("relative-illumination", One(|e| optics::estimate(e, "relative-illumination"))),
    ("colour-shading", One(|e| optics::estimate(e, "colour-shading"))),
    ("green-imbalance", Several(fixed::green_imbalance)),
    ("defective-pixels", Several(fixed::defects)),
    ("black-level-offset", Several(response::black_level)),
    ("system-gain", Several(response::system_gain)),
    ("quantum-efficiency", Several(response::quantum_efficiency)),
    ("nonlinearity", Several(response::nonlinearity)),
    ("full-well", Several(well::full_well)),
    (
        "optical-crosstalk",
        Several(|e| {
            let of_targets = optics::estimate(e, "optical-crosstalk");
            neighbours::optical_crosstalk(e).into_iter().chain(of_targets).collect()
        }),
    ),
    ("adc-nonlinearity", Several(converter::adc_steps)),
    ("image-lag", Several(response::image_lag)),
    ("exposure-offset", Several(response::exposure_offset)),
    ("defocus", One(|e| optics::estimate(e, "defocus"))),
    ("distortion", One(|e| optics::estimate(e, "distortion"))),
    ("lateral-colour", One(|e| optics::estimate(e, "lateral-colour"))),
    ("decentre-tilt", One(|e| optics::estimate(e, "decentre-tilt"))),
    ("lens-transmittance", One(|e| optics::estimate(e, "lens-transmittance"))),
    ("veiling-glare", One(|e| optics::estimate(e, "veiling-glare"))),
];

/// Every proposal of the kinds `wanted` that the evidence gives, strongest first, weaker than `least` standard
/// errors left out.
pub fn propose(
    evidence: &Evidence<'_>,
    wanted: &dyn Fn(&str) -> bool,
    least: f64,
) -> Vec<Proposal> {
    let mut out: Vec<Proposal> = CATALOGUE
        .iter()
        .filter(|(kind, _)| wanted(kind))
        .flat_map(|(_, estimate)| estimate.estimate(evidence))
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

/// Where a function of two variables is least within ranges: nine by nine points, then as many around the least of
/// them, closer together.
fn lowest(of: impl Fn(f64, f64) -> f64, [x0, x1]: [f64; 2], [y0, y1]: [f64; 2]) -> (f64, f64) {
    let (mut x, mut y) = ((x0 + x1) / 2.0, (y0 + y1) / 2.0);
    let (mut dx, mut dy) = ((x1 - x0) / 8.0, (y1 - y0) / 8.0);
    for _ in 0..8 {
        let around = |m: f64, d: f64, [from, to]: [f64; 2]| {
            (-4..=4).map(move |i| (m + f64::from(i) * d).clamp(from, to))
        };
        let mut least = f64::INFINITY;
        let (mx, my) = (x, y);
        for i in around(mx, dx, [x0, x1]) {
            for j in around(my, dy, [y0, y1]) {
                let value = of(i, j);
                if value < least {
                    (least, x, y) = (value, i, j);
                }
            }
        }
        (dx, dy) = (dx * 0.4, dy * 0.4);
    }
    (x, y)
}

/// Where a function with one minimum between `low` and `high` has it, by golden section.
fn minimum(mut low: f64, mut high: f64, turns: usize, f: impl Fn(f64) -> f64) -> f64 {
    let golden = 0.5 * (5f64.sqrt() - 1.0);
    for _ in 0..turns {
        let (a, b) = (high - golden * (high - low), low + golden * (high - low));
        if f(a) < f(b) { high = b } else { low = a }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::Proposal;
    use camrig_sensor_core::effects::quantum_efficiency::QuantumEfficiency;
    use camrig_sensor_core::effects::relative_illumination::RelativeIllumination;

    #[test]
    fn what_gives_way_has_its_new_value_wherever_it_is_told() {
        let efficiency = |ratio: f32| QuantumEfficiency { ratio }.into();
        let old = Proposal::new("quantum-efficiency", efficiency(0.9993), 9.0);
        let mut named = vec![old.with("ratio", 0.9993, 4e-5)];
        let mut shading = Proposal::new(
            "relative-illumination",
            RelativeIllumination { corner: -0.006 }.into(),
            9.0,
        );
        shading.along.0.push(efficiency(1.0013));
        shading.join(&mut named);
        let [efficiency, shading] = &named[..] else { panic!("{named:?}") };
        assert!((efficiency.parameters[0].1.value - 1.0013).abs() < 1e-7);
        assert!((efficiency.effects[0].values()[0] - 1.0013).abs() < 1e-7);
        assert!(shading.along.0.is_empty());
    }

    #[test]
    fn a_bent_valley_is_followed_to_its_lowest_place() {
        let valley = |x: f64, y: f64| (x - 0.3).powi(2) + 10.0 * (y - x * x).powi(2);
        let (x, y) = super::lowest(valley, [-1.0, 1.0], [-1.0, 1.0]);
        // The last step is 0.25 · 0.4⁷.
        assert!((x - 0.3).abs() < 1e-3 && (y - 0.09).abs() < 1e-3, "{x} {y}");
        // On an edge too.
        assert_eq!(super::lowest(|x, y| x - y, [0.0, 1.0], [2.0, 3.0]), (0.0, 3.0));
        let root = super::minimum(0.0, 2.0, 60, |x| (x * x - 2.0).powi(2));
        assert!((root - 2f64.sqrt()).abs() < 1e-6, "{root}");
    }
}
