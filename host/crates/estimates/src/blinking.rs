//! Telegraph noise of the read-out: its pixels' share, amplitudes and levels, from one dark stack.
//!
//! A trap moves a pixel's value by A. A read-out of one sample is up or not, with probability d; of
//! correlated double sampling the difference of two has three levels, −A, 0 and A. Either has the
//! variance cA², with c = d(1 − d) or 2s d(1 − d), s the chance of a renewal in between, and the
//! spectrum of the trap. With v the variance of a pixel over the frames, v₀ that of the median
//! pixel and x = √(v − v₀):
//!
//!   share and amplitude: of an exponential law of A, values of x beyond any limit x₁ exceed it by
//!       √c⟨A⟩ in the mean, and their share of all pixels is f exp(−x₁/(√c⟨A⟩));
//!   levels: κ₄/κ₂² = 1/d(1−d) − 6 of two levels, 1/2s d(1−d) − 3 of three, and κ₃²/κ₂³ = κ₄/κ₂² + 2
//!       of two, 0 of three;
//!   renewal: the covariance of a pixel with itself one frame later.
//!
//! Cumulants come from k-statistics (Kendall & Stuart, *The Advanced Theory of Statistics* I, ch.
//! 12) of the half of the frames in which the pixels were not chosen.

use super::Stack;
use super::robust::{Sorted, clipped_mean, mean};
use camrig_base::Value;
use camrig_base::tails::median_of_squares;

/// Standard deviations of the logarithm of pixels' variances, from the lower half, beyond which a
/// pixel blinks: those of a normal law, of a spread of the read noise too, end before.
const LIMIT: f64 = 5.0;
/// Frames from which variances tell a law, and pixels that blink.
const MIN_FRAMES: usize = 12;
const MIN_PIXELS: usize = 30;
/// Standard errors from which their share is known.
const MIN_DEVIATION: f64 = 3.0;
/// Robust standard deviations at which the values of a row are clipped before their mean.
const CLIP: f64 = 4.0;
/// Least variance whose logarithm is taken, DN².
const LEAST: f64 = 1e-3;

/// Pixels that blink in the read-out.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Blinking {
    /// Their share of all pixels.
    pub share: Value,
    /// Mean amplitude A, DN.
    pub amplitude: Value,
    /// Chance that a trap is renewed from one frame to the next.
    pub renewal: f64,
    /// Share d of the time in the upper level.
    pub duty: f64,
    /// Chance s of a renewal between the two samples of correlated double sampling; 0 of one
    /// sample.
    pub between_samples: f64,
}

impl Blinking {
    /// Of a dark stack in which no charge gathers to speak of; none of few frames or pixels.
    pub fn of(dark: &Stack) -> Option<Self> {
        let n = dark.frames.len();
        if n < MIN_FRAMES {
            return None;
        }
        let residuals = residuals(dark);
        let variances = |from: usize, to: usize| -> Vec<f64> {
            let of = |p: usize| Cumulants::of(residuals[from..to].iter().map(|f| f[p])).second;
            (0..residuals[0].len()).map(of).collect()
        };
        let all = variances(0, n);
        let (white, limit) = core(&all, n);
        let over: Vec<f64> =
            all.iter().filter(|v| **v > limit).map(|v| (v - white).sqrt()).collect();
        if over.len() < MIN_PIXELS {
            return None;
        }
        let levels = Levels::of(&residuals, &variances)?;
        // Their variances are known to (2 + κ₄/κ₂²)/n, which stretches the law of x.
        let scatter = 0.25 * (2.0 + levels.fourth).max(0.0) / n as f64;
        let from = (limit - white).sqrt();
        let excess = mean(&over.iter().map(|x| x - from).collect::<Vec<_>>());
        let width = (excess.value - scatter * from).max(0.5 * excess.value);
        let count = over.len() as f64;
        let pixels = all.len() as f64;
        let share = count / pixels * libm::exp(from / width);
        // The share follows from the width too, as the pixels below the limit do.
        let of_width = excess.std_error / width;
        let error = libm::hypot(count.sqrt().recip(), of_width * from / width);
        if error * MIN_DEVIATION > 1.0 {
            return None;
        }
        let (seen, _) = seen(n, levels.correlation);
        let to_amplitude = (levels.variance() * seen).sqrt().recip();
        Some(Self {
            share: Value::new(share.min(1.0), share * error),
            amplitude: Value::new(width, width * of_width).scaled(to_amplitude),
            renewal: levels.renewal(),
            duty: levels.duty,
            between_samples: levels.between_samples,
        })
    }
}

/// Each frame less the mean frame and the means of its rows.
fn residuals(dark: &Stack) -> Vec<Vec<f64>> {
    let (map, _) = dark.mean_map(|_, _| true);
    let width = dark.size().0;
    let of_frame = |i: usize| {
        let mut rest: Vec<f64> = dark.values(i).iter().zip(&map).map(|(v, m)| v - m).collect();
        for row in rest.chunks_mut(width) {
            let offset = clipped_mean(row.to_vec(), CLIP).value;
            row.iter_mut().for_each(|v| *v -= offset);
        }
        rest
    };
    (0..dark.frames.len()).map(of_frame).collect()
}

/// The variance that ordinary pixels have, and that from which a pixel blinks, both of `n` frames.
fn core(variances: &[f64], n: usize) -> (f64, f64) {
    let sorted = Sorted::new(variances.iter().map(|v| libm::log(v.max(LEAST))));
    let middle = sorted.quantile(0.5);
    let limit = libm::exp(middle + LIMIT * sorted.lower_sd().value);
    (libm::exp(middle) / median_of_squares(n as f64 - 1.0), limit)
}

/// k-statistics of a sample.
struct Cumulants {
    second: f64,
    third: f64,
    fourth: f64,
    /// Unbiased for the square of the second cumulant.
    square: f64,
}

impl Cumulants {
    fn of(values: impl Iterator<Item = f64> + Clone) -> Self {
        let n = values.clone().count() as f64;
        let centre = values.clone().sum::<f64>() / n;
        let [m2, m3, m4] = values.map(|v| v - centre).fold([0.0; 3], |[a, b, c], v| {
            let square = v * v;
            [a + square / n, b + square * v / n, c + square * square / n]
        });
        let second = n / (n - 1.0) * m2;
        let fourth = n * n * ((n + 1.0) * m4 - 3.0 * (n - 1.0) * m2 * m2)
            / ((n - 1.0) * (n - 2.0) * (n - 3.0));
        Self {
            second,
            third: n * n * m3 / ((n - 1.0) * (n - 2.0)),
            fourth,
            square: (n - 1.0) / (n + 1.0) * (second * second - fourth / n),
        }
    }
}

/// What pixels that blink do between their levels.
struct Levels {
    /// κ₄/κ₂².
    fourth: f64,
    duty: f64,
    between_samples: f64,
    /// Of a pixel's excess with that one frame later.
    correlation: f64,
}

impl Levels {
    /// Of pixels chosen in one half of the frames, by the other half.
    fn of(residuals: &[Vec<f64>], variances: &dyn Fn(usize, usize) -> Vec<f64>) -> Option<Self> {
        let (n, middle) = (residuals.len(), residuals.len() / 2);
        // Sums over pixels of κ₂², κ₄, κ₃² and κ₂, and of the covariance with the frame after;
        // each pixel weighted so that all count alike.
        let [mut square, mut fourth, mut cube, mut cubes] = [0.0; 4];
        let (mut own, mut next, mut signed) = (0.0, 0.0, 0.0);
        for (chosen_in, seen_in) in [([0, middle], [middle, n]), ([middle, n], [0, middle])] {
            let chosen = variances(chosen_in[0], chosen_in[1]);
            let (white, limit) = core(&chosen, chosen_in[1] - chosen_in[0]);
            for p in (0..chosen.len()).filter(|p| chosen[*p] > limit) {
                let of = |[from, to]: [usize; 2]| {
                    Cumulants::of(residuals[from..to].iter().map(|f| f[p]))
                };
                let (there, here) = (of(chosen_in), of(seen_in));
                let weight = (chosen[p] - white).recip();
                let rest: Vec<f64> =
                    residuals[seen_in[0]..seen_in[1]].iter().map(|f| f[p]).collect();
                let level = rest.iter().sum::<f64>() / rest.len() as f64;
                let products = rest.windows(2).map(|w| (w[0] - level) * (w[1] - level));
                let product = products.sum::<f64>() / (rest.len() - 1) as f64;
                let excess = here.second - white;
                own += weight * excess;
                next += weight * (product + white / rest.len() as f64);
                let weight = weight * weight;
                square += weight * (here.square - 2.0 * white * here.second + white * white);
                fourth += weight * here.fourth;
                cube += weight * chosen[p].recip() * here.third * there.third;
                cubes += weight * chosen[p].recip() * excess.powi(3);
                signed += weight * chosen[p].recip().sqrt() * here.third;
            }
        }
        if !(square > 0.0 && own > 0.0) {
            return None;
        }
        let fourth = fourth / square;
        let correlation = correlation(n - middle, next / own);
        // Two levels have the skewness that goes with their fourth cumulant.
        let of_two = (fourth + 2.0).max(0.0);
        if fourth > -1.5 && cube < 0.5 * of_two * cubes {
            let between_samples = (2.0 / (fourth + 3.0)).clamp(0.0, 1.0);
            return Some(Self { fourth, duty: 0.5, between_samples, correlation });
        }
        let rare = 0.5 * (1.0 - (1.0 - 4.0 / (of_two + 4.0)).sqrt());
        let duty = if signed < 0.0 { 1.0 - rare } else { rare };
        Some(Self { fourth, duty, between_samples: 0.0, correlation })
    }

    /// Variance over the square of the amplitude.
    fn variance(&self) -> f64 {
        let two = self.duty * (1.0 - self.duty);
        if self.between_samples > 0.0 { 2.0 * self.between_samples * two } else { two }
    }

    /// Of a difference of two samples, of which the second forgets the first with probability s,
    /// the correlation is (1 − q) s/2, else 1 − q.
    fn renewal(&self) -> f64 {
        const LEAST: f64 = 0.03;
        let kept = match self.between_samples > 0.0 {
            true => 2.0 * self.correlation / self.between_samples,
            false => self.correlation,
        };
        (1.0 - kept).clamp(LEAST, 1.0)
    }
}

/// Of values with the correlation ρ^|i−j|, less the mean of n: the variance with n − 1 degrees of
/// freedom and the covariance of neighbours, over the variance.
fn seen(n: usize, correlation: f64) -> (f64, f64) {
    let of = |i: usize, j: usize| libm::pow(correlation, i.abs_diff(j) as f64);
    let count = n as f64;
    let rows: Vec<f64> = (0..n).map(|i| (0..n).map(|j| of(i, j)).sum::<f64>() / count).collect();
    let all = rows.iter().sum::<f64>() / count;
    let less_mean = |i: usize, j: usize| of(i, j) - rows[i] - rows[j] + all;
    let own: f64 = (0..n).map(|i| less_mean(i, i)).sum();
    let next: f64 = (1..n).map(|i| less_mean(i - 1, i)).sum();
    (own / (count - 1.0), next / (count - 1.0))
}

/// The correlation with which the covariance over the variance is this, of `n` values less their
/// mean.
fn correlation(n: usize, ratio: f64) -> f64 {
    let (mut low, mut high) = (0.0, 0.999);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        let (own, next) = seen(n, middle);
        if next / own < ratio { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::Plane;
    use camrig_captures::Role;
    use rand_distr::{Distribution, Exp1, StandardNormal, StandardUniform};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    /// 200 x 200 pixels of 24 frames, a share of which blinks about an exponential law of mean 8 DN
    /// in noise of 1.5 DN.
    fn stack(share: f64, renewal: f64, between: f64, duty: f64, spread: f64, seed: u64) -> Stack {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let (side, n) = (200, 24);
        let mut frames = vec![Plane::from_fn(side, side, |_, _| 0u16); n];
        for p in 0..side * side {
            let mut uniform = || -> f64 { StandardUniform.sample(&mut rng) };
            let blinks = uniform() < share;
            let mut up = uniform() < duty;
            let states: Vec<f64> = (0..n)
                .map(|_| {
                    up = if uniform() < renewal { uniform() < duty } else { up };
                    let before = if uniform() < between { uniform() < duty } else { up };
                    let second = f64::from(u8::from(up));
                    second - if between > 0.0 { f64::from(u8::from(before)) } else { 0.0 }
                })
                .collect();
            let amplitude: f64 = Exp1.sample(&mut rng);
            let own: f64 = StandardNormal.sample(&mut rng);
            let sd = 1.5 * (spread * own).exp();
            for (frame, state) in frames.iter_mut().zip(states) {
                let noise: f64 = StandardNormal.sample(&mut rng);
                let jump = if blinks { 8.0 * amplitude * state } else { 0.0 };
                frame.data[p] = (100.0 + sd * noise + jump).round().max(0.0) as u16;
            }
        }
        Stack::new("dark", Role::Dark, 0.0, frames)
    }

    #[test]
    fn share_amplitude_and_levels_come_back() {
        for (share, renewal, between, duty) in [
            (0.02, 1.0, 0.6, 0.5),
            (0.04, 1.0, 0.3, 0.5),
            (0.02, 0.8, 0.0, 0.5),
            (0.03, 1.0, 0.0, 0.2),
        ] {
            let found = Blinking::of(&stack(share, renewal, between, duty, 0.1, 5)).unwrap();
            println!("{share} {renewal} {between} {duty}: {found:?}");
            let off = |v: Value, truth: f64| ((v.value - truth) / v.std_error).abs();
            assert!(off(found.share, share) < 3.0, "{found:?} for {share}");
            let (is, wanted) = (found.between_samples, between);
            assert!((is - wanted).abs() < 0.15 * wanted.max(0.1), "{found:?} for {between}");
            // About a half, the variance says little of the share of the time.
            let of_duty = |d: f64| d * (1.0 - d);
            let ratio = of_duty(found.duty) / of_duty(duty);
            assert!((ratio - 1.0).abs() < 0.15, "{found:?} for {duty}");
            assert!((found.renewal - renewal).abs() < 0.15, "{found:?} for {renewal}");
            assert!((found.amplitude.value / 8.0 - 1.0).abs() < 0.12, "{found:?}");
        }
    }

    #[test]
    fn a_spread_of_the_read_noise_does_not_blink() {
        for spread in [0.0, 0.1, 0.3] {
            assert!(Blinking::of(&stack(0.0, 1.0, 0.0, 0.5, spread, 6)).is_none(), "{spread}");
        }
    }
}
