//! `prnu-low-frequency`: smooth structure of the gain map.
//!
//! The block means of the map (without unit) are developed in the products of cosines of i half
//! waves across and j down of which the effect consists. If the amplitudes a_ij up to an order n
//! are normal with the variance s_ij due to σ plus the variance n_ij of pixels, rows
//! and columns, the likeliest σ (without unit) and order minimise
//!
//!   Σ_ij ln(n_ij + p_ij s_ij) + a_ij²/(n_ij + p_ij s_ij),
//!
//! p_ij being what the means over blocks leave of the power.

use super::blocks::{self, block_means};
use super::proposal::Proposal;
use crate::evidence::Evidence;
use crate::model::effects::current;
use crate::numerics::minimise::minimum;
use crate::statistics::maps::MapKind;
use crate::statistics::statistic::{Place, What};
use camrig_base::Value;
use camrig_fourier::sinc;
use std::f64::consts::{PI, SQRT_2};

/// Largest order that is tried, half waves over the map: that of the effect.
const MAX_ORDER: usize = 4;
/// Range of σ that is searched, up to the largest that the effect allows.
const SIGMAS: [f64; 2] = [1e-6, 0.14];
/// Steps of the golden section over ln σ, each 0.62 of the range before: 4e-10 of it is left.
const STEPS: usize = 50;
/// Values further than this from the median of their block are held: defective pixels.
const CLIP: f64 = 0.5;

/// What a map shows of a product of two cosines.
struct Wave {
    /// Half waves across and down.
    order: (usize, usize),
    /// Amplitude of the product scaled to a mean square of 1.
    amplitude: f64,
    /// Variance of the amplitude by the model's patterns of pixels, rows and columns.
    noise: f64,
    /// What means over blocks leave of its square.
    passed: f64,
}

/// `prnu-low-frequency`: σ and order with which the cosines of the map are most likely.
pub fn low_frequency(e: &Evidence<'_>) -> Option<Proposal> {
    let waves = waves(e)?;
    let (order, sigma, left) = likeliest(&waves)?;
    let strength = (deviance(&waves, order, 0.0) - left).max(0.0).sqrt();
    // The scatter of a standard deviation from so many normal numbers.
    let count = ((order + 1).pow(2) - 1) as f64;
    let sigma = Value { value: sigma, std_error: sigma / (2.0 * count).sqrt() };
    let law = [("sigma", sigma), ("order", Value::chosen(order as f64))];
    Proposal::of("prnu-low-frequency", strength, law)
}

/// Order and σ of the likeliest law, and its deviance.
fn likeliest(waves: &[Wave]) -> Option<(usize, f64, f64)> {
    (1..=MAX_ORDER)
        .map(|order| {
            let deviance = |ln_sigma: f64| deviance(waves, order, libm::exp(ln_sigma));
            let ln_sigma = minimum(libm::log(SIGMAS[0]), libm::log(SIGMAS[1]), STEPS, deviance);
            (order, libm::exp(ln_sigma), deviance(ln_sigma))
        })
        .min_by(|a, b| a.2.total_cmp(&b.2))
}

/// −2 ln of the likelihood of all cosines if those up to `order` share the variance σ².
fn deviance(waves: &[Wave], order: usize, sigma: f64) -> f64 {
    let within = |w: &Wave| w.order.0.max(w.order.1) <= order;
    // The mean square of a cosine is a half: the effect's scale.
    let share = |w: &Wave| if w.order.0 == 0 || w.order.1 == 0 { 0.5 } else { 0.25 };
    let power: f64 = waves.iter().filter(|w| within(w)).map(share).sum();
    waves
        .iter()
        .map(|w| {
            let signal = if within(w) { sigma * sigma * share(w) / power * w.passed } else { 0.0 };
            let variance = w.noise + signal;
            libm::log(variance) + w.amplitude * w.amplitude / variance
        })
        .sum()
}

/// The cosines in the block means of the gain map. `None` under light that may be uneven.
fn waves(e: &Evidence<'_>) -> Option<Vec<Wave>> {
    let map = e.map(MapKind::Gain).filter(|m| m.even)?;
    let (w, h) = (map.plane.width, map.plane.height);
    let (across, down) = (w / blocks::SIDE, h / blocks::SIDE);
    let blocks = block_means(&map.plane, CLIP);
    let predicted = |what| e.predicted(Place::Map(MapKind::Gain), what);
    let pixels = predicted(What::PixelPattern)? / (w * h) as f64;
    // A model with smooth structure has it in its rows and columns too.
    let lines = match current(e.camera, "prnu-low-frequency") {
        Some(_) => [pixels; 2],
        None => {
            [predicted(What::RowPattern)? / h as f64, predicted(What::ColumnPattern)? / w as f64]
        }
    };
    let mut out = Vec::new();
    for j in 0..=MAX_ORDER.min(down.saturating_sub(1)) {
        for i in 0..=MAX_ORDER.min(across.saturating_sub(1)) {
            if i + j == 0 {
                continue;
            }
            let wave = |k: usize, at: f64| match k {
                0 => 1.0,
                k => SQRT_2 * libm::cos(0.5 * PI * k as f64 * (at + 1.0)),
            };
            // Cosines at the centres of a grid are orthogonal, of mean square 1.
            let sum: f64 = blocks.iter().map(|b| b.mean * wave(i, b.u) * wave(j, b.v)).sum();
            let noise = match (i, j) {
                (0, _) => lines[0],
                (_, 0) => lines[1],
                _ => pixels,
            };
            let passed = |k: usize, n: usize| sinc(0.5 * k as f64 / n as f64).powi(2);
            out.push(Wave {
                order: (i, j),
                amplitude: sum / blocks.len() as f64,
                noise,
                passed: passed(i, across) * passed(j, down),
            });
        }
    }
    (!out.is_empty()).then_some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Amplitudes at exactly their standard deviations: the likeliest law is the one they follow.
    #[test]
    fn the_number_of_half_waves_and_the_size_are_those_put_in() {
        let (sigma, noise) = (0.003, 1e-8);
        for order in 1..=3 {
            let mut waves: Vec<Wave> = (0..=MAX_ORDER)
                .flat_map(|j| (0..=MAX_ORDER).map(move |i| (i, j)))
                .filter(|o| o.0 + o.1 > 0)
                .map(|order| Wave { order, amplitude: 0.0, noise, passed: 0.9 })
                .collect();
            let share = |o: (usize, usize)| if o.0 == 0 || o.1 == 0 { 0.5 } else { 0.25 };
            let within = |o: (usize, usize)| o.0.max(o.1) <= order;
            let power: f64 = waves.iter().map(|w| w.order).filter(|o| within(*o)).map(share).sum();
            for w in &mut waves {
                let signal =
                    if within(w.order) { sigma * sigma * share(w.order) / power } else { 0.0 };
                w.amplitude = (noise + 0.9 * signal).sqrt();
            }
            let (found, size, _) = likeliest(&waves).unwrap();
            assert_eq!(found, order);
            // Golden section of ln σ over 12, fifty times.
            assert!((size / sigma - 1.0).abs() < 1e-6, "{size}");
        }
    }
}
