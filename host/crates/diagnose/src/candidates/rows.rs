//! Noise that whole rows or columns share: `row-temporal-noise`, `column-temporal-noise`,
//! `row-correlated-noise`.
//!
//! White noise of lines comes from the variance V of row (column) means over frames, DN², and
//! what the model predicts of it, V', in every stack:
//!
//!   σ² = ⟨(σ₀² + V − V')/K²⟩, e⁻²,
//!
//! with K the system gain (DN/e⁻), of noise behind the analogue gain that of the gain 1, ⟨ ⟩ the
//! inverse-variance mean over stacks and σ₀ what the model has already, DN, by whichever law. V is kept as its ratio to
//! the variance of a mean of white noise ([`What::RowVariance`], [`What::ColumnVariance`]). The law
//! of correlated rows, power in proportion to f^−a, is the likeliest one of the periodograms of the
//! row means (Whittle 1953); σ in e⁻, a without unit.

use super::common::{Added, LN_SIGMA_REACH, present, present_dn};
use super::proposal::Proposal;
use crate::evidence::Evidence;
use crate::model::effects::current;
use crate::numerics::minimise::lowest;
use crate::statistics::statistic::What;
use crate::statistics::temporal::mean;
use camrig_base::Value;
use camrig_captures::Role;

/// Exponents of the spectrum that are searched. The upper end is that of the effect; at the lower
/// one the law is white to within the scatter of a spectrum.
const EXPONENTS: [f64; 2] = [0.05, 2.0];
/// Exponent below which noise that the model has not yet is left to `row-temporal-noise`: over the
/// two decades of a frame's frequencies its power changes by less than a factor of 2.5.
const WHITE_BELOW: f64 = 0.2;

/// White noise of lines of a kind, from the variance of their means of `across` pixels.
fn white(e: &Evidence<'_>, kind: &'static str, what: What, across: f64) -> Vec<Proposal> {
    Added::each(kind, e, |added| {
        let variance = added.variance(e, what, across)?;
        let mut law = vec![("sigma_e", variance.sqrt()?)];
        // What the model has of rows' other part stays.
        let opposite = present(e.camera, kind, "opposite_e").filter(|o| *o > 0.0);
        law.extend(opposite.map(|o| ("opposite_e", Value::chosen(o))));
        added.proposal(added.strength(e, variance), law)
    })
}

/// `row-temporal-noise`: the variance of row means that all stacks have more than the model.
pub fn row_temporal(e: &Evidence<'_>) -> Vec<Proposal> {
    white(e, "row-temporal-noise", What::RowVariance, e.size().0)
}

/// `column-temporal-noise`: the same of column means.
pub fn column_temporal(e: &Evidence<'_>) -> Vec<Proposal> {
    white(e, "column-temporal-noise", What::ColumnVariance, e.size().1)
}

/// `row-correlated-noise`: standard deviation and exponent of the likeliest power law.
pub fn row_correlated(e: &Evidence<'_>) -> Vec<Proposal> {
    Added::each("row-correlated-noise", e, |added| correlated(e, added))
}

fn correlated(e: &Evidence<'_>, added: Added) -> Option<Proposal> {
    let variance = added.variance(e, What::RowVariance, e.size().0)?;
    let present = added.present(e);
    let s = variance.sqrt()?;
    let spectra = spectra(e, added);
    let around = libm::log(s.value);
    let (ln_sigma, exponent) = lowest(
        |ln_sigma, a| negative_log_likelihood(&spectra, libm::exp(2.0 * ln_sigma), a),
        [around - LN_SIGMA_REACH, around + LN_SIGMA_REACH],
        EXPONENTS,
    );
    if present == 0.0 && exponent < WHITE_BELOW {
        return None;
    }
    let sigma = libm::exp(ln_sigma);
    // Where the model has none, the likelihood ratio has more information than the variance, most
    // of which is white.
    let strength = match present {
        0.0 => {
            let gain = negative_log_likelihood(&spectra, 0.0, exponent)
                - negative_log_likelihood(&spectra, sigma * sigma, exponent);
            (2.0 * gain.max(0.0)).sqrt().max(added.strength(e, variance))
        }
        _ => added.strength(e, variance),
    };
    let sigma = Value { value: sigma, ..s };
    added.proposal(strength, vec![("sigma_e", sigma), ("exponent", Value::chosen(exponent))])
}

/// Power of the row means of a stack.
struct RowSpectrum {
    /// Periodograms of which `power` is the mean.
    dof: f64,
    /// Power of a bin by white noise of pixels and rows, in squares of the effect's electrons.
    white: f64,
    /// Power of each bin from one cycle per frame to half a cycle per row, in the same unit.
    power: Vec<f64>,
}

/// Row spectra of the stacks; where the model has flicker, whose bands are lines as well, of the
/// dark ones alone.
fn spectra(e: &Evidence<'_>, added: Added) -> Vec<RowSpectrum> {
    let flicker = current(e.camera, "flicker-banding").is_some();
    let stacks = e.design.conditions.iter().zip(e.stacks);
    stacks
        .filter(|(c, _)| !flicker || c.stack.role == Role::Dark)
        .map(|(c, t)| {
            let square = added.unit(e, c).powi(2);
            let rows = present_dn(e, "row-temporal-noise", c).powi(2);
            RowSpectrum {
                dof: t.dof,
                white: (mean(&t.pixel_variance) / e.size().0 + rows) / square,
                power: t.row_power.iter().map(|p| p / square).collect(),
            }
        })
        .collect()
}

/// −ln of Whittle's likelihood Π S_k⁻ⁿ exp(−n P_k/S_k) of noise of a variance (e⁻²) whose power
/// falls as f^−a plus white noise (Whittle 1953; P_k is the mean of n periodograms, S_k what is
/// expected of it).
fn negative_log_likelihood(spectra: &[RowSpectrum], variance: f64, exponent: f64) -> f64 {
    let Some(first) = spectra.first() else { return f64::INFINITY };
    let bins = first.power.len();
    let law: Vec<f64> = (1..=bins).map(|k| libm::pow(k as f64, -exponent)).collect();
    let scale = variance * bins as f64 / law.iter().sum::<f64>();
    let mut sum = 0.0;
    for s in spectra {
        for (p, l) in s.power.iter().zip(&law) {
            let expected = s.white + scale * l;
            sum += s.dof * (libm::log(expected) + p / expected);
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, Exp1};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    /// 100 spectra of 128 bins of 4 periodograms: far above white noise every bin gives ln S to
    /// 1/√400, so ln σ² and the exponent (whose regressor ln k has a standard deviation of 0.9) to
    /// 0.4 and 0.5 %; with white noise, which hides two thirds of the bins, to some 1 % and 1.5 %.
    /// Four of these are allowed.
    #[test]
    fn the_likeliest_law_is_the_one_that_was_put_in() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(7);
        let (variance, exponent, white, bins) = (0.04, 1.3, 0.01, 128);
        let law: Vec<f64> = (1..=bins).map(|k| f64::from(k).powf(-exponent)).collect();
        let scale = variance * f64::from(bins) / law.iter().sum::<f64>();
        let mut mean_of_four =
            || -> f64 { (0..4).map(|_| -> f64 { Exp1.sample(&mut rng) }).sum::<f64>() / 4.0 };
        let spectra: Vec<RowSpectrum> = (0..100)
            .map(|_| RowSpectrum {
                dof: 4.0,
                white,
                power: law.iter().map(|l| (white + scale * l) * mean_of_four()).collect(),
            })
            .collect();
        let (ln_sigma, found) = lowest(
            |ln_sigma, a| negative_log_likelihood(&spectra, (2.0 * ln_sigma).exp(), a),
            [-3.0, 0.0],
            EXPONENTS,
        );
        let ratio = (2.0 * ln_sigma).exp() / variance;
        assert!((ratio - 1.0).abs() < 0.04, "{ratio}");
        assert!((found - exponent).abs() < 0.06, "{found}");
    }
}
