//! What a model predicts for every statistic, from replicates, and how far a measurement is from it.

use super::statistics::{Place, Scale, Statistic, What};
use super::tails;
use std::collections::BTreeMap;

/// Names a statistic.
pub type Key = (Place, What);
/// Statistics by name.
pub type Values = BTreeMap<Key, Statistic>;

/// Statistics by name.
pub fn by_key(statistics: Vec<Statistic>) -> Values {
    statistics.into_iter().map(|s| ((s.place, s.what), s)).collect()
}

/// Prediction of one statistic.
#[derive(Clone, Copy, Debug)]
pub struct Predicted {
    /// Mean in its own unit.
    pub value: f64,
    /// Mean on its scale.
    pub scaled: f64,
    /// Standard deviation of one measurement on its scale.
    pub sd: f64,
    /// The part of it that theory gives.
    theory: f64,
    /// Variance over replicates on its scale.
    scatter: f64,
    /// Its scale.
    pub scale: Scale,
    /// Sum over replicates (counts).
    total: f64,
    /// Replicates.
    runs: f64,
}

impl Predicted {
    /// Whether a model predicts another value than `old`, or a much wider scatter (a pattern that is another on each sensor).
    pub fn differs(&self, old: &Self) -> bool {
        ((self.scaled - old.scaled) / old.sd).abs() > 3.0 || self.sd > 1.5 * old.sd
    }
}

/// Prediction of every statistic.
#[derive(Clone, Debug, Default)]
pub struct Prediction {
    /// By name.
    pub of: BTreeMap<Key, Predicted>,
}

/// Replicates scatter more than theory says only if their variance passes this multiple of it: for 15 degrees of freedom
/// the 80 % point of the F distribution.
const SCATTER_MARGIN: f64 = 1.3;

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
            let mean = scaled.iter().sum::<f64>() / runs;
            let scatter =
                scaled.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (runs - 1.0).max(1.0);
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

    /// This prediction moved by what a change of the model does to replicates with the same random numbers. Effects that
    /// draw others leave differences of chance, on which many statistics together would judge them: see `share_that_is_real`.
    pub fn moved(&self, before: &[Values], after: &[Values]) -> Self {
        let changed = Self::new(after);
        let unchanged = Self::new(before);
        let mut of = self.of.clone();
        for (key, p) in &mut of {
            let (Some(a), Some(b)) = (changed.of.get(key), unchanged.of.get(key)) else { continue };
            let share = share_that_is_real(key, p.scale, before, after);
            p.scaled += share * (a.scaled - b.scaled);
            p.value += share * (a.value - b.value);
            p.total = p.value.max(0.0) * p.runs;
            // The scatter of few replicates counts only where it is gross (the 99.9 % point of F for 3 degrees of freedom
            // is 5.4): a random pattern, that is another on each sensor, is new or gone.
            let gross = |p: &Predicted| p.scatter > 5.4 * p.theory * p.theory;
            p.sd = match (gross(b), gross(a)) {
                (false, true) => p.sd.max(a.scatter.sqrt()),
                (true, false) => a.theory,
                _ => p.sd * a.theory / b.theory.max(1e-30),
            };
        }
        Self { of }
    }

    /// Deviations in standard deviations, of every statistic that both have. `allowance` holds standard deviations
    /// that come from the set-up, not the sensor.
    pub fn deviations(
        &self,
        values: &Values,
        allowance: &BTreeMap<Key, f64>,
    ) -> BTreeMap<Key, f64> {
        let mut out = BTreeMap::new();
        for (key, s) in values {
            let Some(p) = self.of.get(key) else { continue };
            let z = match p.scale {
                Scale::Count => tails::count(s.value, p.total, p.runs),
                _ => {
                    let allowed = allowance.get(key).copied().unwrap_or(0.0);
                    let own = if key.1.tells_its_scatter() { s.sd * s.sd } else { 0.0 };
                    let variance =
                        (p.sd * p.sd).max(own) * (1.0 + 1.0 / p.runs) + allowed * allowed;
                    (p.scale.of(s.value) - p.scaled) / variance.sqrt().max(1e-15)
                }
            };
            if z.is_finite() {
                out.insert(*key, z);
            }
        }
        out
    }

    /// Σ ρ(z) + 2 Σ ln σ over statistics: twice the negative log-likelihood but for a constant. ρ is z² up to 10 standard
    /// deviations and grows slower beyond, so that one gross deviation does not hide all others.
    pub fn deviance(&self, values: &Values, allowance: &BTreeMap<Key, f64>) -> f64 {
        let mut sum = 0.0;
        for (key, z) in self.deviations(values, allowance) {
            sum += bounded(z);
            if let Some(p) = self.of.get(&key).filter(|p| p.scale != Scale::Count) {
                let allowed = allowance.get(&key).copied().unwrap_or(0.0);
                sum += (p.sd * p.sd + allowed * allowed).max(1e-30).ln();
            }
        }
        sum
    }
}

/// Of the mean difference δ of pairs of replicates, the share 1 − 2 s²/δ² (none below 0), s being its standard error: the
/// positive-part estimate that shrinks what may be chance to nothing (James & Stein 1961; 2 for the few pairs).
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

/// z² up to 10, then 100 (1 + ln (z/10)²).
pub fn bounded(z: f64) -> f64 {
    let square = z * z;
    if square < 100.0 { square } else { 100.0 * (1.0 + (square / 100.0).ln()) }
}

/// Mean of squared deviations.
pub fn mean_square(deviations: &BTreeMap<Key, f64>) -> f64 {
    deviations.values().map(|z| z * z).sum::<f64>() / deviations.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::super::looks::Figure;
    use super::*;

    #[test]
    fn a_patch_in_which_one_pixel_stands_out_is_as_uncertain_as_it_says() {
        let place = Place::Look(0);
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
        // What a mean's own scatter is, the model knows.
        assert!((z(What::Of(Figure::PatchMean(1, 0)), 0.25) - of(0.05)).abs() < 1e-9);
    }
}
