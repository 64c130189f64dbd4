//! `adc-nonlinearity`: bits of the converter with a wrong weight, from the histograms of the stacks
//! ([`camrig_estimates::converter`]).

use super::proposal::{MIN_STRENGTH, Proposal};
use crate::data::channels::Channels;
use crate::evidence::Evidence;
use crate::model::effects::current;
use crate::statistics::codes::is_clipped;
use crate::statistics::temporal::Temporal;
use camrig_estimates::converter::{Codes, KEYS, SIGNIFICANT, significant_errors};
use camrig_sensor_core::effects::adc_nonlinearity::AdcNonlinearity;

// No bit is named that would not be tried alone.
const _: () = assert!(SIGNIFICANT >= MIN_STRENGTH);

/// `adc-nonlinearity`: errors of the lowest bits, from the stacks that reach neither end of the
/// scale.
pub fn adc_steps(e: &Evidence<'_>) -> Option<Proposal> {
    if current(e.camera, "adc-nonlinearity").is_some() {
        return None;
    }
    let channels = Channels::new(e.camera);
    // What is cut off bends the density near the ends of the scale.
    let inside = e.stacks.iter().filter(|t| !is_clipped(t));
    let stacks: Vec<Codes<'_>> = inside.map(|t| codes(t, &channels)).collect();
    let found = significant_errors(&stacks);
    let strength = found.iter().map(|(_, error)| error.z().abs()).fold(0.0, f64::max);
    // None at random, and then the errors in their order.
    let mut values = [0.0; 1 + KEYS.len()];
    found.iter().for_each(|(bit, error)| values[1 + bit] = error.value as f32);
    let effect = AdcNonlinearity::from_values(&values);
    let mut proposal = Proposal::new("adc-nonlinearity", effect.into(), strength);
    proposal.parameters = found.into_iter().map(|(bit, error)| (KEYS[bit], error)).collect();
    Some(proposal)
}

/// The samples of a stack. A mixture of channels is as smooth as the narrowest of their laws, so
/// `sd` is that of the channel with the least.
fn codes<'a>(t: &'a Temporal, channels: &Channels) -> Codes<'a> {
    let means = channels.means(&t.mean.data);
    let mut squares = t.mean.data.clone();
    channels.change(&mut squares, &means, |v, mean| (v - mean) * (v - mean));
    let (fixed, noise) = (channels.means(&squares), channels.means(&t.pixel_variance));
    let variances = fixed.iter().zip(noise).map(|(fixed, noise)| fixed + noise);
    Codes { histogram: &t.histogram, sd: variances.fold(f64::MAX, f64::min).sqrt() }
}
