//! Noise of whole rows and columns.

use super::{Proposal, deviation, list, lowest};
use crate::evidence::{Estimated, Evidence, pooled};
use crate::model::current;
use crate::statistics::What;
use crate::temporal::mean;
use camrig_captures::Role;
use camrig_sensor_core::effects::{
    Effect, column_temporal_noise::ColumnTemporalNoise, row_correlated_noise::RowCorrelatedNoise,
    row_temporal_noise::RowTemporalNoise,
};

/// Excess of a component that is the same in every stack, e⁻².
pub(super) fn common(e: &Evidence<'_>, what: What, across: f64) -> Option<Estimated> {
    pooled(e.design.conditions.iter().enumerate().filter_map(|(i, c)| {
        let k = e.gain(c).powi(2);
        let x = e.component(i, what, across)?;
        Some(Estimated { value: x.value / k, se: x.se / k })
    }))
}

/// Standard deviation of rows that differ from frame to frame, in the model, e⁻.
pub(super) fn present_rows(e: &Evidence<'_>) -> f64 {
    match current(e.camera, "row-temporal-noise") {
        Some(Effect::RowTemporalNoise(x)) => f64::from(x.sigma_e),
        _ => 0.0,
    }
}

/// The same of columns.
pub(super) fn present_columns(e: &Evidence<'_>) -> f64 {
    match current(e.camera, "column-temporal-noise") {
        Some(Effect::ColumnTemporalNoise(x)) => f64::from(x.sigma_e),
        _ => 0.0,
    }
}

/// Variance of row means beyond white noise / pixels.
pub fn row_temporal(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let excess = common(e, What::RowVariance, e.size().0)?;
        let s = deviation(present_rows(e), excess)?;
        let effect = RowTemporalNoise { sigma_e: s.value as f32 };
        Some(
            Proposal::new("row-temporal-noise", effect.into(), excess.z().abs())
                .with("sigma_e", s.value, s.se),
        )
    })())
}

/// The same over columns.
pub fn column_temporal(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let excess = common(e, What::ColumnVariance, e.size().1)?;
        let s = deviation(present_columns(e), excess)?;
        let effect = ColumnTemporalNoise { sigma_e: s.value as f32 };
        Some(
            Proposal::new("column-temporal-noise", effect.into(), excess.z().abs())
                .with("sigma_e", s.value, s.se),
        )
    })())
}

/// Row means whose power falls with frequency: likeliest variance and exponent.
pub fn row_correlated(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let excess = common(e, What::RowVariance, e.size().0)?;
        let present = match current(e.camera, "row-correlated-noise") {
            Some(Effect::RowCorrelatedNoise(x)) => f64::from(x.sigma_e),
            _ => 0.0,
        };
        let s = deviation(present, excess)?;
        let spectra = spectra(e);
        let around = s.value.ln();
        let (ln_sigma, exponent) = lowest(
            |ln_sigma, a| unlikeliness(&spectra, (2.0 * ln_sigma).exp(), a),
            [around - 1.5, around + 1.5],
            [0.05, 2.0],
        );
        // Flatter than this it is white.
        if present == 0.0 && exponent < 0.2 {
            return None;
        }
        let sigma = ln_sigma.exp();
        // Where the model has none, what the law makes likelier shows more than the variance, most of which is white.
        let strength = match present {
            0.0 => {
                let gain = unlikeliness(&spectra, 0.0, exponent)
                    - unlikeliness(&spectra, sigma * sigma, exponent);
                (2.0 * gain.max(0.0)).sqrt().max(excess.z().abs())
            }
            _ => excess.z().abs(),
        };
        let effect = RowCorrelatedNoise { sigma_e: sigma as f32, exponent: exponent as f32 };
        Some(
            Proposal::new("row-correlated-noise", effect.into(), strength)
                .with("sigma_e", sigma, s.se)
                .with("exponent", exponent, f64::NAN),
        )
    })())
}

/// Power of row means, e⁻²: degrees of freedom, the white part, and the bins.
struct RowSpectrum {
    dof: f64,
    white: f64,
    power: Vec<f64>,
}

/// Row spectra of the stacks; where the model has flicker, of the dark ones.
fn spectra(e: &Evidence<'_>) -> Vec<RowSpectrum> {
    let flicker = current(e.camera, "flicker-banding").is_some();
    let stacks = e.design.conditions.iter().zip(e.stacks);
    stacks
        .filter(|(c, _)| !flicker || c.role == Role::Dark)
        .map(|(c, t)| {
            let k2 = e.gain(c).powi(2);
            RowSpectrum {
                dof: t.dof,
                white: mean(&t.pixel_variance) / e.size().0 / k2 + present_rows(e).powi(2),
                power: t.row_power.iter().map(|p| p / k2).collect(),
            }
        })
        .collect()
}

/// −ln of Whittle's likelihood Π S_k⁻ⁿ exp(−n P_k/S_k) of noise of variance σ² whose power falls as f^−a beside white
/// noise (Whittle 1953; P_k is the mean of n periodograms).
fn unlikeliness(spectra: &[RowSpectrum], variance: f64, exponent: f64) -> f64 {
    let Some(first) = spectra.first() else { return f64::INFINITY };
    let bins = first.power.len();
    let law: Vec<f64> = (1..=bins).map(|k| (k as f64).powf(-exponent)).collect();
    let scale = variance * bins as f64 / law.iter().sum::<f64>();
    let mut sum = 0.0;
    for s in spectra {
        for (p, l) in s.power.iter().zip(&law) {
            let expected = s.white + scale * l;
            sum += s.dof * (expected.ln() + p / expected);
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

    /// 100 spectra of 128 bins of 4 periodograms: far above white noise every bin tells ln S to 1/√400, so ln σ² and the
    /// exponent (whose regressor ln k has a standard deviation of 0.9) to 0.4 and 0.5 %; with white noise, which hides two
    /// thirds of the bins, some 1 % and 1.5 %. Four of these are allowed.
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
            |ln_sigma, a| unlikeliness(&spectra, (2.0 * ln_sigma).exp(), a),
            [-3.0, 0.0],
            [0.05, 2.0],
        );
        let ratio = (2.0 * ln_sigma).exp() / variance;
        assert!((ratio - 1.0).abs() < 0.04, "{ratio}");
        assert!((found - exponent).abs() < 0.06, "{found}");
    }
}
