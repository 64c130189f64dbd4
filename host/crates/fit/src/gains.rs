//! What the gains are made of: a part before the converter and one that multiplies its codes, and
//! the law of the read noise over the former.

use super::stacks::AtGain;
use camrig_base::Value;
use camrig_base::tails::misfit;
use camrig_camera::typical::rounded;
use camrig_linear::{LeastSquares, Matrix, Vector};

/// Relative difference up to which analog gains are one.
const SAME: f64 = 1e-3;
/// Fewest places on either side of a step: two determine a law, and more test it.
const MIN_PLACES: usize = 2;

/// An analog gain, and which of the gains have it.
pub struct Place {
    /// The analog gain.
    pub analog: f64,
    /// Positions of these.
    pub of: Vec<usize>,
}

impl Place {
    /// The analog gains of a sensor, rising. A gain is analog as a whole unless its codes were
    /// multiplied, and all digital gains begin at one analog gain, the largest.
    pub fn all(gains: &[AtGain]) -> Vec<Self> {
        let above = digital_above(gains);
        let mut places: Vec<Self> = Vec::new();
        for (i, g) in gains.iter().enumerate() {
            let analog = above.map_or(g.gain, |above| g.gain.min(above));
            // As sensors have them: single precision.
            let analog = rounded(analog, 7);
            match places.iter_mut().find(|p| same(p.analog, analog)) {
                Some(place) => place.of.push(i),
                None => places.push(Self { analog, of: vec![i] }),
            }
        }
        places
    }

    /// The mean of the values of its gains.
    pub fn mean(&self, each: &[Value]) -> Value {
        let own = || self.of.iter().map(|i| each[*i]);
        Value::combine(own()).unwrap_or_else(|| each[self.of[0]])
    }
}

fn same(a: f64, b: f64) -> bool {
    (a / b - 1.0).abs() < SAME
}

/// The analog gain from which on the rest is digital; none where no codes were multiplied, or not
/// in one way.
pub fn digital_above(gains: &[AtGain]) -> Option<f64> {
    let analog = |g: &AtGain| g.gain / g.digital;
    let above = gains.iter().find(|g| g.digital > 1.0).map(analog)?;
    let fits = |g: &AtGain| match g.digital > 1.0 {
        true => same(analog(g), above),
        false => g.gain <= above * (1.0 + SAME),
    };
    gains.iter().all(fits).then_some(above)
}

/// Read noise over the analog gain g: σ²(g) = pre² + post²/g² (Janesick, *Photon Transfer*, 2007,
/// ch. 11), below a step of the conversion gain and above it.
pub struct Law {
    /// pre² and post², e⁻², below the step.
    below: LeastSquares,
    /// The place from which on another pair holds, and the pair.
    pub step: Option<Step>,
}

/// A step of the conversion gain.
pub struct Step {
    /// The first place above it.
    pub first: usize,
    above: LeastSquares,
}

/// The sum of the two parts at a gain.
fn variance(pair: &LeastSquares, gain: f64) -> Value {
    let [a, b] = [1.0, gain.powi(2).recip()];
    let c = &pair.covariance;
    let error = a * a * c[(0, 0)] + 2.0 * a * b * c[(0, 1)] + b * b * c[(1, 1)];
    Value::new(a * pair.coefficients[0] + b * pair.coefficients[1], error.sqrt())
}

impl Law {
    /// Read noise at unity gain below the step, e⁻; none of no positive variance, as below.
    pub fn at_unity(&self) -> Option<Value> {
        variance(&self.below, 1.0).sqrt()
    }

    /// Its part behind the gain stage below the step, e⁻ at unity gain.
    pub fn post(&self) -> Option<Value> {
        Value::new(self.below.coefficients[1], self.below.covariance[(1, 1)].sqrt()).sqrt()
    }

    /// The columns `at` and `read_e` of a camera file with the step: the gain of its place stands
    /// twice, with what either law gives there.
    pub fn table(&self, places: &[Place]) -> Option<(Vec<f64>, Vec<Value>)> {
        let step = self.step.as_ref()?;
        let read = |pair: &LeastSquares, gain: f64| {
            let v = variance(pair, gain);
            v.sqrt().unwrap_or(Value::new(0.0, v.std_error.sqrt()))
        };
        let below = places[..=step.first].iter().map(|p| (p.analog, read(&self.below, p.analog)));
        let above = places[step.first..].iter().map(|p| (p.analog, read(&step.above, p.analog)));
        Some(below.chain(above).unzip())
    }
}

/// The law of variances at places, e⁻²: one pair, or two with a step before the place that
/// explains them best, by χ² + k ln n of k parameters and n places (Schwarz 1978). None of one
/// place, and where none fits.
pub fn law(places: &[Place], variances: &[Value]) -> Option<Law> {
    let n = places.len();
    let pair = |from: usize, to: usize| {
        let weight = |i: usize| variances[i].std_error.recip();
        let row = |r: usize, c: usize| {
            let i = from + r;
            weight(i) * if c == 0 { 1.0 } else { places[i].analog.powi(2).recip() }
        };
        let design = Matrix::from_fn(to - from, 2, row);
        let target =
            Vector::from_fn(to - from, |r, _| variances[from + r].value * weight(from + r));
        LeastSquares::of(&design, &target)
    };
    let one = pair(0, n).map(|below| (2.0, Law { below, step: None }));
    let steps = (MIN_PLACES..n).filter(|first| n - first >= MIN_PLACES);
    let steps = steps.filter_map(|first| {
        let step = Some(Step { first, above: pair(first, n)? });
        // Two pairs, and the place of the step.
        Some((5.0, Law { below: pair(0, first)?, step }))
    });
    let chi2 = |law: &Law| law.below.chi2 + law.step.as_ref().map_or(0.0, |s| s.above.chi2);
    let score = |(k, law): &(f64, Law)| chi2(law) + k * libm::log(n as f64);
    let all = (n > 1).then(|| one.into_iter().chain(steps))?;
    let (_, law) = all.min_by(|a, b| score(a).total_cmp(&score(b)))?;
    let pairs = if law.step.is_some() { 2 } else { 1 };
    let freedom = (n - 2 * pairs) as f64;
    (freedom == 0.0 || misfit(chi2(&law), freedom).is_none()).then_some(law)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(analog: &[f64]) -> Vec<Place> {
        analog.iter().enumerate().map(|(i, g)| Place { analog: *g, of: vec![i] }).collect()
    }

    fn measured(pairs: &[[f64; 2]], places: &[Place], first: usize) -> Vec<Value> {
        let of = |(i, place): (usize, &Place)| {
            let [pre, post] = pairs[usize::from(i >= first)];
            let v = pre * pre + (post / place.analog).powi(2);
            // Half a per cent of the read noise, up and down.
            Value::new(v * (1.0 + 0.01 * [0.5, -0.8, 0.3, -0.4, 0.7][i % 5]), 0.01 * v)
        };
        places.iter().enumerate().map(of).collect()
    }

    #[test]
    fn a_step_of_the_conversion_gain_is_found_where_it_is_and_no_other() {
        let places = places(&[1.0, 2.0, 3.333, 6.667, 10.0]);
        let one = law(&places, &measured(&[[3.0, 5.0]; 2], &places, 5)).unwrap();
        assert!(one.step.is_none());
        assert!((one.at_unity().unwrap().value / 34f64.sqrt() - 1.0).abs() < 0.01);
        assert!((one.post().unwrap().value / 5.0 - 1.0).abs() < 0.02);
        let two = [[3.317, 5.0], [1.109, 6.333]];
        for first in [2, 3] {
            let found = law(&places, &measured(&two, &places, first)).unwrap();
            assert_eq!(found.step.as_ref().unwrap().first, first);
            let (at, read) = found.table(&places).unwrap();
            assert_eq!(at.len(), places.len() + 1);
            assert_eq!(at[first], at[first + 1]);
            let [pre, post] = two[1];
            let wanted = (pre * pre + (post / at[first]).powi(2)).sqrt();
            assert!((read[first + 1].value / wanted - 1.0).abs() < 0.02, "{read:?}");
        }
        // Three places determine no step: what no pair fits has no law.
        assert!(law(&places[..3], &measured(&two, &places[..3], 2)).is_none());
    }
}
