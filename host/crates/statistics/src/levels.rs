//! Mean levels of a stack.

use super::collect::Collected;
use super::noise::frame_variance;
use super::statistic::{Scale, What};
use super::temporal::{Temporal, mean};
use crate::data::channels::Channels;

/// Mean of each channel: absolute where `reference` is `None`, otherwise relative to that stack,
/// the reference dark, so that the mean of the offset pattern, which differs between sensors,
/// counts once. The standard deviation is from the frames' means, rows and columns, and pixels.
pub(super) fn means(
    t: &Temporal,
    reference: Option<&Temporal>,
    channels: &Channels,
    out: &mut Collected,
) {
    let difference: Vec<f32> = match reference {
        Some(r) => t.mean.data.iter().zip(&r.mean.data).map(|(a, b)| a - b).collect(),
        None => t.mean.data.clone(),
    };
    let (w, h) = (t.width, t.height);
    let frames = |t: &Temporal| frame_variance(t) / t.frames as f64;
    let mut variance = frames(t) + reference.map_or(0.0, frames);
    let by_channel = channels.means(&difference);
    let mut residual = difference;
    channels.change(&mut residual, &by_channel, |v, mean| v - mean);
    let rows: Vec<f64> = residual.chunks(w).map(mean).collect();
    let mut columns = vec![0.0f64; w];
    for row in residual.chunks(w) {
        columns.iter_mut().zip(row).for_each(|(c, &v)| *c += f64::from(v) / h as f64);
    }
    variance += difference_variance(&rows) / h as f64 + difference_variance(&columns) / w as f64;
    let share = channels.count() as f64 / residual.len() as f64;
    residual.iter_mut().for_each(|v| *v *= *v);
    let squares = channels.means(&residual);
    for (channel, (value, square)) in by_channel.iter().zip(squares).enumerate() {
        // Where no sample changes, the uncertainty is the effect of a single change.
        let sd = (variance + square * share).sqrt().max(share / t.frames as f64);
        out.add(What::Mean(channel as u8), *value, sd, Scale::Linear);
    }
}

/// Variance of lines from the differences between every other line, which have the same colour
/// filters: smooth structure hardly counts (von Neumann 1941).
fn difference_variance(lines: &[f64]) -> f64 {
    let squares = lines.windows(3).map(|w| (w[2] - w[0]).powi(2)).sum::<f64>();
    squares / (2.0 * lines.len().saturating_sub(2).max(1) as f64)
}
