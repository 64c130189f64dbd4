//! Noise that a whole frame shares: `frame-offset-noise` and `light-flicker`.
//!
//! Both come from the variance V of frame means, DN², and the model's prediction of it, V':
//!
//!   offset: σ² = ⟨(σ₀² + V − V')/K²⟩, e⁻², over all stacks;
//!   light:  σ² = σ₀² + ⟨(V − V')/s²⟩, without unit, over the flats,
//!
//! with K the system gain (DN/e⁻), of an offset behind the analogue gain that of the gain 1, s the
//! signal of a flat above dark (DN), ⟨ ⟩ inverse-variance means and σ₀ what the model has already.
//! The offset's correlation from one frame to the next is the likeliest one of a first-order
//! autoregression plus white noise (Kalman's filter).

use super::common::{Added, present, present_dn};
use super::proposal::{Proposal, deviation};
use crate::evidence::Evidence;
use crate::statistics::statistic::{Place, What};
use crate::statistics::temporal::mean;
use camrig_base::Value;
use camrig_estimates::drift::{Levels, likeliest};

/// Largest correlation of the effect.
const MAX_CORRELATION: f64 = 0.95;

/// Standard deviation of the light's factor in the model.
fn present_flicker(e: &Evidence<'_>) -> f64 {
    present(e.camera, "light-flicker", "sigma").unwrap_or(0.0)
}

/// `frame-offset-noise`: standard deviation and correlation of the likeliest drift.
pub fn frame_offset(e: &Evidence<'_>) -> Vec<Proposal> {
    Added::each("frame-offset-noise", e, |added| {
        let (w, h) = e.size();
        let variance = added.variance(e, What::FrameVariance, w * h)?;
        let drift = likeliest(&levels(e, added)).filter(|_| variance.value > 0.0)?;
        let stacks = 0..e.stacks.len();
        let frames = stacks.map(|i| (Place::Stack(i), What::FrameVariance));
        let strength = e.stands_out(frames).abs().max(added.strength(e, variance));
        // The effect reaches as far as its own limit.
        let correlation = Value::chosen(drift.correlation.value.min(MAX_CORRELATION));
        added.proposal(strength, vec![("sigma_e", drift.sd), ("correlation", correlation)])
    })
}

/// The frame means of every stack, in the effect's electrons.
fn levels(e: &Evidence<'_>, added: Added) -> Vec<Levels> {
    let (w, h) = e.size();
    let of_stack = |i: usize| {
        let (c, t) = (&e.design.conditions[i], &e.stacks[i]);
        let unit = added.unit(e, c);
        let light = present_flicker(e) * e.signal(i).unwrap_or(0.0);
        let white = mean(&t.pixel_variance) / (w * h)
            + present_dn(e, "row-temporal-noise", c).powi(2) / h
            + present_dn(e, "column-temporal-noise", c).powi(2) / w
            + light * light;
        Levels {
            means: t.frame_means.iter().map(|m| m / unit).collect(),
            white: white / (unit * unit),
        }
    };
    (0..e.stacks.len()).map(of_stack).collect()
}

/// `light-flicker`: variance of the frame means of flats in proportion to the square of the
/// signal.
pub fn light_flicker(e: &Evidence<'_>) -> Option<Proposal> {
    let (w, h) = e.size();
    let excess = Value::combine(e.flats().filter_map(|(i, _)| {
        Some(e.component(i, What::FrameVariance, w * h)?.scaled(1.0 / e.signal(i)?.powi(2)))
    }))?;
    let s = deviation(present_flicker(e), excess)?;
    let frames = e.flats().map(|(i, _)| (Place::Stack(i), What::FrameVariance));
    let strength = e.stands_out(frames).abs().max(excess.z().abs());
    Proposal::of("light-flicker", strength, [("sigma", s)])
}
