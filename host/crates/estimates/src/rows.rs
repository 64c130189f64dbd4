//! Noise of rows by the spectrum of their means: white, and 1/f noise.
//!
//! Of H rows bin k has the power
//!
//!   S_k = v/w + σ² + τ² B k^−a / Σ j^−a,  k, j = 1..B, B = H/2,
//!
//! v/w that of white noise of the pixels, σ² that of white noise of rows, τ² the variance of 1/f
//! noise, a its exponent. A mean P_k of n periodograms scatters about it as a mean of 2n squares. The
//! likeliest parameters (Whittle 1953) solve Σ n (P_k − S_k) ∂S_k/S_k² = 0, for σ² and τ² by least
//! squares with weights that are repeated; their errors are those of the information matrix, wider
//! where the spectrum is of no such law. Lines, which are over their neighbours, are left out.

use super::robust::median;
use camrig_base::Value;
use camrig_base::tails::{chi_square, median_of_squares};
use camrig_fourier::plans::real_forward;
use camrig_linear::{Matrix, Vector, inverse, solve_positive};

/// Exponents that are searched: of smaller ones the law is white to within the scatter of a
/// spectrum, larger ones no sensor of ours has.
const EXPONENTS: [f64; 2] = [0.2, 2.0];
/// Step of the first search.
const STEP: f64 = 0.1;
/// Normal deviate from which noise is 1/f noise rather than white.
const MIN_DEVIATION: f64 = 3.0;
/// Normal deviate of a bin over those beside it from which it is a line, and how many are beside it
/// to either side.
const LINE: f64 = 5.0;
const BESIDE: usize = 8;
/// Searches for lines: what a line hides, or leaks into, is seen without it.
const ROUNDS: usize = 4;
/// Repetitions of the least squares.
const TURNS: usize = 30;

/// Power of the means of rows over frequency.
#[derive(Clone, Debug)]
pub struct RowSpectrum {
    /// Periodograms of which it is the mean.
    pub dof: f64,
    /// Power of white noise of the pixels.
    pub white: f64,
    /// Power of bin 1 and up; none of bins that tell nothing.
    pub power: Vec<Option<f64>>,
}

impl RowSpectrum {
    /// Of the means of the rows in each frame, less the mean over frames and, in each frame, that
    /// of each of `period` rows in turn.
    pub(crate) fn of(frames: impl ExactSizeIterator<Item = Vec<f64>>, period: usize) -> Self {
        let dof = frames.len() as f64 - 1.0;
        let mut power: Vec<Option<f64>> = Vec::new();
        for rows in frames {
            let height = rows.len();
            let plan = real_forward(height);
            let mut line: Vec<f32> = rows.iter().map(|v| *v as f32).collect();
            let mut out = plan.make_output_vec();
            // Lengths are those of the plan, so this cannot fail.
            let _ = plan.process(&mut line, &mut out);
            let told = |k: usize| !(k * period).is_multiple_of(height) && 2 * k != height;
            power.resize(height / 2, Some(0.0));
            for (i, sum) in power.iter_mut().enumerate() {
                let own = f64::from(out[i + 1].norm_sqr()) / (height as f64 * dof);
                *sum = sum.filter(|_| told(i + 1)).map(|sum| sum + own);
            }
        }
        Self { dof, white: 0.0, power }
    }

    /// In units whose square is this in DN².
    #[must_use]
    pub fn over(&self, square: f64) -> Self {
        let power = self.power.iter().map(|p| p.map(|p| p / square)).collect();
        Self { dof: self.dof, white: self.white / square, power }
    }

    /// Its bins with a power.
    fn bins(&self) -> impl Iterator<Item = (usize, f64)> {
        self.power.iter().enumerate().filter_map(|(i, p)| Some((i, (*p)?)))
    }

    /// Without the bins that are over those beside them, each relative to a law, and whether there
    /// are any.
    fn without_lines(&mut self, law: &Law) -> bool {
        let expected = law.power(self);
        let ratios: Vec<(usize, f64)> = self.bins().map(|(i, p)| (i, p / expected[i])).collect();
        let mut found = false;
        for (j, (i, ratio)) in ratios.iter().enumerate() {
            let near = ratios[j.saturating_sub(BESIDE)..(j + BESIDE + 1).min(ratios.len())].iter();
            let near = median(near.filter(|(n, _)| n != i).map(|(_, r)| *r).collect());
            let over = ratio * median_of_squares(2.0 * self.dof) / near;
            if chi_square(over, 2.0 * self.dof) > LINE {
                self.power[*i] = None;
                found = true;
            }
        }
        found
    }
}

/// 1/f noise of rows beside white noise.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct RowNoise {
    /// Variance of white noise of rows, in the unit of the spectra.
    pub white: Value,
    /// Variance of 1/f noise.
    pub correlated: Value,
    /// Exponent of its spectrum.
    pub exponent: Value,
}

impl RowNoise {
    /// Power of the means of rows in bin 1 and up, without that of noise of pixels.
    pub fn power(&self, bins: usize) -> Vec<f64> {
        let parts = [self.white.value, self.correlated.value];
        let law = Law { parts, exponent: self.exponent.value };
        law.power(&RowSpectrum { dof: 1.0, white: 0.0, power: vec![None; bins] })
    }

    /// Of spectra with the same noise of rows; none where white noise is as likely.
    pub fn of(spectra: &[RowSpectrum]) -> Option<Self> {
        let mut spectra = spectra.to_vec();
        let mut best = Law::likeliest(&spectra, true)?;
        for _ in 0..ROUNDS {
            let lines = spectra.iter_mut().map(|s| s.without_lines(&best));
            if lines.filter(|found| *found).count() == 0 {
                break;
            }
            best = Law::likeliest(&spectra, true)?;
        }
        let gained = Law::white(&spectra).cost(&spectra) - best.cost(&spectra);
        // Twice what ln of the likelihood gains by two parameters is χ² of as many.
        let stands_out = chi_square(gained.max(0.0), 2.0) > MIN_DEVIATION;
        let found = best.with_errors(&spectra).filter(|_| stands_out && best.parts[1] > 0.0)?;
        if found.white.z() > MIN_DEVIATION {
            return Some(found);
        }
        // White noise that does not stand out is part of the other.
        let alone = Law::likeliest(&spectra, false)?.with_errors(&spectra)?;
        Some(Self { white: Value::new(0.0, found.white.std_error), ..alone })
    }
}

/// Variances of white and of 1/f noise, and the exponent of the latter.
#[derive(Clone, Copy)]
struct Law {
    parts: [f64; 2],
    exponent: f64,
}

impl Law {
    fn white(spectra: &[RowSpectrum]) -> Self {
        Self { parts: [0.0; 2], exponent: EXPONENTS[0] }.solved(spectra, &[0])
    }

    fn likeliest(spectra: &[RowSpectrum], with_white: bool) -> Option<Self> {
        let all: Vec<usize> = spectra.iter().map(|s| s.power.len()).collect();
        if all.iter().any(|n| *n != all[0]) || spectra.iter().all(|s| s.bins().next().is_none()) {
            return None;
        }
        let [first, last] = EXPONENTS;
        let of = |exponent: f64| {
            let start = Self { parts: [0.0; 2], exponent };
            if !with_white {
                return start.solved(spectra, &[1]);
            }
            let both = start.solved(spectra, &[0, 1]);
            match both.parts {
                [white, _] if white < 0.0 => start.solved(spectra, &[1]),
                [_, correlated] if correlated < 0.0 => start.solved(spectra, &[0]),
                _ => both,
            }
        };
        let lowest = |laws: Vec<Self>| {
            laws.into_iter()
                .map(|law| (law.cost(spectra), law))
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .map(|(_, law)| law)
        };
        let steps = ((last - first) / STEP).round() as usize;
        let coarse = lowest((0..=steps).map(|i| of(first + STEP * i as f64)).collect())?;
        let near = |i: i32| coarse.exponent + 0.1 * STEP * f64::from(i);
        lowest((-10..=10).map(|i| of(near(i).clamp(first, last))).collect())
    }

    /// How 1/f noise of variance 1 is spread over the bins, and the slope of that over the exponent.
    fn shape(&self, bins: usize) -> Vec<[f64; 2]> {
        let logs: Vec<f64> = (1..=bins).map(|k| libm::log(k as f64)).collect();
        let law: Vec<f64> = logs.iter().map(|l| libm::exp(-self.exponent * l)).collect();
        let sum = law.iter().sum::<f64>();
        let centre = law.iter().zip(&logs).map(|(p, l)| p * l).sum::<f64>() / sum;
        let each = law.iter().zip(&logs).map(|(p, l)| (p * bins as f64 / sum, centre - l));
        each.map(|(c, slope)| [c, c * slope]).collect()
    }

    fn power(&self, spectrum: &RowSpectrum) -> Vec<f64> {
        let [white, correlated] = self.parts;
        let shape = self.shape(spectrum.power.len()).into_iter();
        shape.map(|[c, _]| spectrum.white + white + correlated * c).collect()
    }

    /// −ln of Whittle's likelihood.
    fn cost(&self, spectra: &[RowSpectrum]) -> f64 {
        let of = |s: &RowSpectrum| {
            let power = self.power(s);
            let each = s.bins().map(|(i, p)| libm::log(power[i]) + p / power[i]);
            s.dof * each.sum::<f64>()
        };
        spectra.iter().map(of).sum()
    }

    /// Slopes of the power of a bin over both variances and the exponent.
    fn slopes(&self, [c, over_exponent]: [f64; 2]) -> [f64; 3] {
        [1.0, c, self.parts[1] * over_exponent]
    }

    /// With the likeliest variances of these parts; the others stay.
    fn solved(mut self, spectra: &[RowSpectrum], parts: &[usize]) -> Self {
        for turn in 0..TURNS {
            let mut matrix = Matrix::zeros(parts.len(), parts.len());
            let mut right = Vector::zeros(parts.len());
            for s in spectra {
                let (power, shape) = (self.power(s), self.shape(s.power.len()));
                let level = s.bins().map(|(_, p)| p).sum::<f64>() / s.bins().count().max(1) as f64;
                for (i, p) in s.bins() {
                    // The first turn weighs all bins alike.
                    let expected = if turn == 0 { level } else { power[i].max(0.1 * s.white) };
                    let weight = s.dof / expected.powi(2);
                    let slopes = self.slopes(shape[i]);
                    for (a, x) in parts.iter().enumerate() {
                        right[a] += weight * slopes[*x] * (p - s.white);
                        for (b, y) in parts.iter().enumerate() {
                            matrix[(a, b)] += weight * slopes[*x] * slopes[*y];
                        }
                    }
                }
            }
            let Some(found) = solve_positive(matrix, &right) else { return self };
            let before = self.parts;
            parts.iter().enumerate().for_each(|(a, x)| self.parts[*x] = found[a]);
            let change = |x: usize| (self.parts[x] - before[x]).abs() > 1e-9 * self.parts[x].abs();
            if !change(0) && !change(1) {
                break;
            }
        }
        self
    }

    fn with_errors(&self, spectra: &[RowSpectrum]) -> Option<RowNoise> {
        let (mut information, mut chi2, mut count) = (Matrix::zeros(3, 3), 0.0, 0.0);
        for s in spectra {
            let (power, shape) = (self.power(s), self.shape(s.power.len()));
            for (i, p) in s.bins() {
                let slopes = self.slopes(shape[i]);
                let weight = s.dof / power[i].powi(2);
                for a in 0..3 {
                    for b in 0..3 {
                        information[(a, b)] += weight * slopes[a] * slopes[b];
                    }
                }
                chi2 += weight * (p - power[i]).powi(2);
                count += 1.0;
            }
        }
        let covariance = inverse(information)?;
        let wider = (chi2 / (count - 3.0)).max(1.0);
        let value = |v: f64, i: usize| Value::new(v, (wider * covariance[(i, i)]).sqrt());
        let [white, correlated] = self.parts;
        Some(RowNoise {
            white: value(white, 0),
            correlated: value(correlated, 1),
            exponent: value(self.exponent, 2),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, Exp1};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    /// A mean of 15 periodograms of a law over 128 bins, and what rises over it.
    fn spectrum(law: &Law, lines: &[(usize, f64)], seed: u64) -> RowSpectrum {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut mean = || (0..15).map(|_| -> f64 { Exp1.sample(&mut rng) }).sum::<f64>() / 15.0;
        let flat = RowSpectrum { dof: 15.0, white: 0.01, power: vec![Some(0.0); 128] };
        let mut power: Vec<Option<f64>> =
            law.power(&flat).into_iter().map(|p| Some(p * mean())).collect();
        for (k, own) in lines {
            power[*k] = power[*k].map(|p| p + own);
        }
        RowSpectrum { power, ..flat }
    }

    #[test]
    fn white_and_1_f_noise_come_back_beside_lines() {
        let truth = Law { parts: [0.08, 0.08], exponent: 1.1 };
        let mut off = Vec::new();
        for seed in 0..20 {
            let lines: &[_] = if seed % 2 == 0 { &[] } else { &[(6, 2.0), (40, 0.3), (41, 0.1)] };
            let found = RowNoise::of(&[spectrum(&truth, lines, seed)]).unwrap();
            let z = |v: Value, truth: f64| (v.value - truth) / v.std_error;
            off.push([z(found.white, 0.08), z(found.correlated, 0.08), z(found.exponent, 1.1)]);
        }
        for i in 0..3 {
            let of = || off.iter().map(|z| z[i]);
            let (mean, square) =
                (of().sum::<f64>() / 20.0, of().map(|z| z * z).sum::<f64>() / 20.0);
            println!("{i}: {mean} {square}");
            assert!(mean.abs() < 3.5 / 20f64.sqrt() && square < 2.2, "{i}: {mean} {square}");
        }
    }

    #[test]
    fn white_noise_of_rows_is_no_1_f_noise() {
        let white = Law { parts: [0.02, 0.0], exponent: 1.0 };
        let found = |seed| RowNoise::of(&[spectrum(&white, &[(6, 2.0)], seed)]).is_some();
        // One in 700 by chance.
        assert!((0..40).filter(|seed| found(*seed)).count() < 2);
    }
}
