//! What a model predicts for every statistic, from replicates, and how far a measurement is from
//! it.

use crate::numerics::tails;
use crate::statistics::statistic::{Key, Scale, Statistic, Values};
use camrig_linear::moments;
use std::collections::BTreeMap;

/// Replicates count as scattering more than theory predicts only where their variance exceeds this
/// multiple of it: the 80 % point of the F distribution for 15 degrees of freedom.
const SCATTER_MARGIN: f64 = 1.3;
/// The same for the four replicates of a trial, for which only gross scatter counts: the 99.9 %
/// point of F for 3 degrees of freedom.
const GROSS_SCATTER: f64 = 5.4;
/// Standard deviations by which a prediction must change to be different: four pairs of replicates
/// do not resolve less.
const MOVED_SD: f64 = 3.0;
/// Ratio of predicted standard deviations from which predictions are different: above the 80 %
/// point of the uncertainty of a scatter from few replicates.
const WIDENED: f64 = 1.5;
/// Variance below which a statistic has no scatter but that of rounding.
const MIN_VARIANCE: f64 = 1e-24;
/// Deviations beyond this, standard deviations, count by their logarithm, so that a single gross
/// one does not hide all others.
const GROSS_DEVIATION: f64 = 10.0;

/// Prediction of one statistic.
#[derive(Clone, Copy, Debug)]
pub struct Predicted {
    /// Mean over replicates, in its own unit.
    pub value: f64,
    /// Mean over replicates, on its scale.
    pub scaled: f64,
    /// Standard deviation of one measurement on its scale.
    pub sd: f64,
    /// The standard deviation predicted by theory.
    theory: f64,
    /// Variance over replicates on its scale.
    scatter: f64,
    /// Its scale.
    pub scale: Scale,
    /// Sum over replicates (counts).
    total: f64,
    /// Replicates.
    pub runs: f64,
}

impl Predicted {
    /// Whether it has no scatter, neither in theory nor over replicates.
    fn is_constant(&self) -> bool {
        self.scale != Scale::Count && self.sd * self.sd < MIN_VARIANCE
    }

    /// How far a measurement is from it, standard deviations, of which `allowed` comes from the
    /// set-up.
    pub fn deviation(&self, measured: &Statistic, allowed: f64) -> f64 {
        if self.scale == Scale::Count {
            return tails::count(measured.value, self.total, self.runs);
        }
        let own = if measured.what.has_own_uncertainty() { measured.sd } else { 0.0 };
        let variance = self.sd.max(own).powi(2) * (1.0 + 1.0 / self.runs) + allowed * allowed;
        (self.scale.of(measured.value) - self.scaled) / variance.sqrt().max(1e-15)
    }

    /// Whether a model predicts another value than `old`, or a much wider scatter, as of a pattern
    /// that differs from sensor to sensor.
    pub fn differs(&self, old: &Self) -> bool {
        ((self.scaled - old.scaled) / old.sd).abs() > MOVED_SD || self.sd > WIDENED * old.sd
    }
}

/// Prediction of every statistic.
#[derive(Clone, Debug, Default)]
pub struct Prediction {
    /// By name.
    pub of: BTreeMap<Key, Predicted>,
}

impl Prediction {
    /// From replicates of the model.
    pub fn new(replicates: &[Values]) -> Self {
        let mut of = BTreeMap::new();
        let Some(first) = replicates.first() else { return Self::default() };
        for (key, statistic) in first {
            let all: Vec<&Statistic> = replicates.iter().filter_map(|r| r.get(key)).collect();
            if all.len() < replicates.len() {
                continue;
            }
            let runs = all.len() as f64;
            let scale = statistic.scale;
            let scaled: Vec<f64> = all.iter().map(|s| scale.of(s.value)).collect();
            let (mean, scatter) = moments(&scaled);
            let theory = all.iter().map(|s| s.sd * s.sd).sum::<f64>() / runs;
            let variance = theory.max(scatter / SCATTER_MARGIN);
            let value = all.iter().map(|s| s.value).sum::<f64>() / runs;
            let sd = variance.sqrt();
            let theory = theory.sqrt();
            let total = value * runs;
            let p = Predicted { value, scaled: mean, sd, theory, scatter, scale, total, runs };
            of.insert(*key, p);
        }
        Self { of }
    }

    /// This prediction plus the difference that a change of the model makes to replicates with the
    /// same random numbers. Effects that draw more random numbers differ by chance in many
    /// statistics, which together would decide for or against them: such differences are shrunk.
    pub fn moved(&self, before: &[Values], after: &[Values]) -> Self {
        let changed = Self::new(after);
        let unchanged = Self::new(before);
        let mut of = self.of.clone();
        for (key, p) in &mut of {
            let (a, b) = (changed.of.get(key), unchanged.of.get(key));
            let (Some(a), Some(b)) = (a, b) else { continue };
            let share = share_that_is_real(key, p.scale, before, after);
            p.scaled += share * (a.scaled - b.scaled);
            p.value += share * (a.value - b.value);
            p.total = p.value.max(0.0) * p.runs;
            // Gross scatter in one of the two: a random pattern that differs from sensor to sensor
            // is new, or gone.
            let gross = |p: &Predicted| p.scatter > GROSS_SCATTER * p.theory * p.theory;
            p.sd = match (gross(b), gross(a)) {
                (false, true) => p.sd.max(a.scatter.sqrt()),
                (true, false) => a.theory,
                _ => p.sd * a.theory / b.theory.max(1e-30),
            };
        }
        Self { of }
    }

    /// Statistics that never change in the model, for example because all its samples have one
    /// code, and were measured to be different: the deviation cannot be expressed in standard
    /// deviations.
    pub fn never_changes(&self, values: &Values) -> Vec<Key> {
        let differs = |(key, s): (&Key, &Statistic)| {
            let p = self.of.get(key)?;
            (p.is_constant() && p.scale.of(s.value) != p.scaled).then_some(*key)
        };
        values.iter().filter(|(key, _)| !key.1.only_bars()).filter_map(differs).collect()
    }

    /// Deviation, standard deviations, of every statistic that both have, that has a scatter, and
    /// that does more than bar effects. `allowance` holds standard deviations that come from the
    /// set-up, not from the sensor.
    pub fn deviations(
        &self,
        values: &Values,
        allowance: &BTreeMap<Key, f64>,
    ) -> BTreeMap<Key, f64> {
        let mut out = BTreeMap::new();
        for (key, s) in values.iter().filter(|(key, _)| !key.1.only_bars()) {
            let Some(p) = self.of.get(key) else { continue };
            if p.is_constant() && p.scale.of(s.value) != p.scaled {
                continue;
            }
            let z = p.deviation(s, allowance.get(key).copied().unwrap_or(0.0));
            if z.is_finite() {
                out.insert(*key, z);
            }
        }
        out
    }

    /// Deviance: Σ ρ(z) + 2 Σ ln σ over statistics, twice the negative log-likelihood but for a
    /// constant, with ρ the [`bounded`] square.
    pub fn deviance(&self, values: &Values, allowance: &BTreeMap<Key, f64>) -> f64 {
        let mut sum = 0.0;
        for (key, z) in self.deviations(values, allowance) {
            sum += bounded(z);
            if let Some(p) = self.of.get(&key).filter(|p| p.scale != Scale::Count) {
                let allowed = allowance.get(&key).copied().unwrap_or(0.0);
                sum += libm::log((p.sd * p.sd + allowed * allowed).max(1e-30));
            }
        }
        sum
    }
}

/// The share 1 − 2 s²/δ², at least 0, of the mean difference δ of pairs of replicates, with s its
/// standard error: the positive-part estimate, which shrinks to nothing what may be chance (James
/// & Stein 1961; 2 for the few pairs).
fn share_that_is_real(key: &Key, scale: Scale, before: &[Values], after: &[Values]) -> f64 {
    let pairs = before.iter().zip(after);
    let differences: Vec<f64> = pairs
        .filter_map(|(b, a)| Some(scale.of(a.get(key)?.value) - scale.of(b.get(key)?.value)))
        .collect();
    let n = differences.len() as f64;
    let mean = differences.iter().sum::<f64>() / n;
    let squares = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>();
    let variance = squares / (n * (n - 1.0)).max(1.0);
    if mean == 0.0 { 0.0 } else { (1.0 - 2.0 * variance / (mean * mean)).max(0.0) }
}

/// z² up to `GROSS_DEVIATION` g, beyond it g² (1 + ln (z/g)²).
pub fn bounded(z: f64) -> f64 {
    let square = z * z;
    let gross = GROSS_DEVIATION * GROSS_DEVIATION;
    if square < gross { square } else { gross * (1.0 + libm::log(square / gross)) }
}

/// Mean of squared deviations, each [`bounded`].
pub fn mean_square<'a>(deviations: impl IntoIterator<Item = &'a f64>) -> f64 {
    let (sum, count) =
        deviations.into_iter().fold((0.0, 0), |(sum, n), z| (sum + bounded(*z), n + 1));
    sum / f64::from(count.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::statistic::{Figure, Place, What, by_key};

    #[test]
    fn a_patch_in_which_one_pixel_stands_out_is_as_uncertain_as_it_says() {
        let place = Place::Target(0);
        let at = |what, value: f64, sd| Statistic { place, what, value, sd, scale: Scale::Log };
        let z = |what, sd| {
            let model = Prediction::new(&vec![by_key(vec![at(what, 1.0, 0.05)]); 16]);
            let measured = by_key(vec![at(what, 0.5f64.exp(), sd)]);
            model.deviations(&measured, &BTreeMap::new())[&(place, what)]
        };
        // 0.5 on the scale; sixteen replicates add a sixteenth of the variance.
        let of = |sd: f64| 0.5 / sd / (17.0f64 / 16.0).sqrt();
        let scatter = What::Of(Figure::PatchScatter(1));
        assert!((z(scatter, 0.05) - of(0.05)).abs() < 1e-9);
        assert!((z(scatter, 0.25) - of(0.25)).abs() < 1e-9);
        // The uncertainty of a mean is the model's.
        assert!(
            (z(What::Of(Figure::PatchMean { patch: 1, channel: 0 }), 0.25) - of(0.05)).abs()
                < 1e-9
        );
    }
}
