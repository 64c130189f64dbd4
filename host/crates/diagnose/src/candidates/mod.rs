//! Candidates: how large each effect of the catalogue would have to be to explain the deviations.
//!
//! An estimator reads the statistics that its effect moves most: measured less predicted, turned
//! into the effect's parameters. What the present model already has of the effect is part of the
//! prediction, so that an estimator gives the whole new value and may be repeated until it
//! settles. Whether the effect is the true one it does not decide: the search judges by all
//! statistics.

mod blocks;
mod common;
mod converter;
mod dark;
mod fixed;
mod flicker;
mod frames;
pub(crate) mod gain;
mod glow;
mod neighbours;
mod noise;
mod optics;
mod periodic;
pub mod proposal;
mod response;
mod rows;
mod smooth;
mod well;

use crate::evidence::Evidence;
use proposal::Proposal;

pub use optics::shown_by_targets;

/// The estimator of one kind. It proposes nothing where the captures do not show the effect.
#[derive(Clone, Copy)]
#[non_exhaustive]
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

/// Every effect that is looked for, by its kind, with its estimator.
pub const CATALOGUE: [(&str, Estimator); 46] = [
    ("row-temporal-noise", Several(rows::row_temporal)),
    ("column-temporal-noise", Several(rows::column_temporal)),
    ("row-correlated-noise", Several(rows::row_correlated)),
    ("periodic-pattern-noise", One(periodic::periodic)),
    ("frame-offset-noise", Several(frames::frame_offset)),
    ("light-flicker", One(frames::light_flicker)),
    ("flicker-banding", One(flicker::flicker_banding)),
    ("read-noise", One(noise::read_noise)),
    ("read-noise-spread", Several(noise::read_noise_spread)),
    ("random-telegraph-noise", Several(noise::telegraph)),
    ("heavy-tailed-read-noise", Several(noise::heavy_tails)),
    ("charge-coupling", One(neighbours::charge_coupling)),
    ("brighter-fatter", One(neighbours::brighter_fatter)),
    ("row-offset-fpn", One(fixed::row_offset)),
    ("column-offset-fpn", One(fixed::column_offset)),
    ("pixel-offset-fpn", One(fixed::pixel_offset)),
    ("readout-channel-mismatch", Several(fixed::readout_channels)),
    ("hot-pixels", One(dark::hot_pixels)),
    ("dark-current", Several(dark::dark_current)),
    ("dark-current-temperature", One(dark::doubling)),
    ("amp-glow", One(glow::amp_glow)),
    ("dark-current-gradient", One(dark::gradient)),
    ("prnu", One(gain::prnu)),
    ("prnu-correlated", One(gain::prnu_correlated)),
    ("column-gain-fpn", One(gain::column_gain)),
    ("prnu-low-frequency", One(smooth::low_frequency)),
    ("relative-illumination", One(|e| optics::estimate(e, "relative-illumination"))),
    ("colour-shading", One(|e| optics::estimate(e, "colour-shading"))),
    ("green-imbalance", One(gain::green_imbalance)),
    ("defective-pixels", One(gain::defects)),
    ("black-level-offset", Several(response::black_level)),
    ("system-gain", One(response::system_gain)),
    ("quantum-efficiency", One(response::quantum_efficiency)),
    ("nonlinearity", Several(response::nonlinearity)),
    ("full-well", Several(well::full_well)),
    (
        "optical-crosstalk",
        Several(|e| {
            let of_targets = optics::estimate(e, "optical-crosstalk");
            neighbours::optical_crosstalk(e).into_iter().chain(of_targets).collect()
        }),
    ),
    ("adc-nonlinearity", One(converter::adc_steps)),
    ("image-lag", One(response::image_lag)),
    ("exposure-offset", One(response::exposure_offset)),
    ("defocus", One(|e| optics::estimate(e, "defocus"))),
    ("distortion", One(|e| optics::estimate(e, "distortion"))),
    ("lateral-colour", One(|e| optics::estimate(e, "lateral-colour"))),
    ("decentre-tilt", One(|e| optics::estimate(e, "decentre-tilt"))),
    ("lens-transmittance", One(|e| optics::estimate(e, "lens-transmittance"))),
    ("f-number", One(|e| optics::estimate(e, "f-number"))),
    ("veiling-glare", One(|e| optics::estimate(e, "veiling-glare"))),
];

/// Every proposal of the kinds `wanted` that the evidence gives, the strongest first; those weaker
/// than `least` standard errors are left out.
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
