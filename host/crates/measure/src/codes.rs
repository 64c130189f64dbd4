//! The codes that occur in samples, and their step in DN.
//!
//! A converter of 10 bits whose samples are stored at the top of 16-bit words (left-aligned) has
//! steps of 64 DN, and rounding adds 64²/12 DN² instead of 1/12. Codes that a digital gain r
//! multiplied are r DN apart: r²/12 DN², and 1/12 more where r is not whole, so that the products
//! were rounded.

use super::rounding::{self, QUANTISATION, QUANTISATION_LIMITED, sensitivity};
use camrig_base::Value;
use std::collections::BTreeMap;

/// Variance of the noise, in squares of the step, above which rounding adds 1/12 independent of the
/// mean, to 1e-7.
const MIN_RESOLVED: f64 = 1.0;
/// Smallest variance of the noise, in squares of the step, for which the first harmonic describes
/// rounding (a standard deviation of 0.3).
const MIN_DESCRIBED: f64 = 0.09;
/// Steps of the fixed-point iteration for the variance of rounding. Each multiplies the error by
/// 2 |1 − 4π²v| exp(−2π²v) for a variance of v steps²: 0.15 at 0.24 and 0.8 at 0.1.
const ITERATIONS: usize = 50;

/// Codes in use, fewer than which tell no step but one of idle low bits: a few levels have any
/// number in common.
const MIN_CODES: usize = 8;
/// Samples of a code in use from which on a code that none has beside it is no chance: of one with
/// a third of its neighbours' width, once in 20,000 codes.
const MIN_SAMPLES: u32 = 30;
/// Codes in a row that tell a step that is not whole, and how often both distances occur among
/// them.
const MIN_RUN: usize = 32;
const MIN_EACH: usize = 4;
/// Codes of a row that are looked at: their step is known to its inverse square.
const MAX_RUN: usize = 512;

/// How often each code occurs, from a lowest one on. Codes at the ends of the scale, to which
/// samples are clamped, do not count.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CodeCounts {
    lowest: u16,
    counts: Vec<u32>,
}

impl CodeCounts {
    /// Of samples of a scale from 0 to `white`, DN.
    pub fn of(samples: &[u16], white: u16) -> Self {
        let inside = || samples.iter().copied().filter(|v| (1..white).contains(v));
        let (Some(lowest), Some(highest)) = (inside().min(), inside().max()) else {
            return Self::default();
        };
        let mut counts = vec![0; usize::from(highest - lowest) + 1];
        inside().for_each(|v| counts[usize::from(v - lowest)] += 1);
        Self { lowest, counts }
    }

    /// Codes in use, each with its number of samples.
    fn used(&self) -> impl Iterator<Item = (u16, u32)> + '_ {
        (self.lowest..).zip(self.counts.iter().copied()).filter(|used| used.1 > 0)
    }
}

/// The codes of samples: `offset + n step`, to the nearest DN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Codes {
    /// Mean distance of neighbouring codes, DN: whole where idle low bits or a whole digital gain
    /// make it, any number above 1 where codes were multiplied by it.
    pub step_dn: f64,
    /// The lowest code, DN, less than a step.
    offset_dn: f64,
}

impl Codes {
    /// Of samples; a step of 1 DN where none differ.
    pub fn of<'a>(counts: impl IntoIterator<Item = &'a CodeCounts>) -> Self {
        let mut together = BTreeMap::new();
        for (code, n) in counts.into_iter().flat_map(CodeCounts::used) {
            *together.entry(code).or_insert(0u32) += n;
        }
        let codes: Vec<(u16, u32)> = together.into_iter().collect();
        let first = codes.first().map_or(0, |used| used.0);
        let step =
            codes.iter().fold(0, |step, used| greatest_common_divisor(step, used.0 - first));
        let idle_bits = 1 << step.trailing_zeros().min(15);
        let whole = match step {
            0 => 1,
            _ if codes.len() < MIN_CODES => idle_bits,
            step => step,
        };
        let whole = Self { step_dn: whole.into(), offset_dn: (first % whole).into() };
        if whole.step_dn > 1.0 { whole } else { multiplied(&codes).unwrap_or(whole) }
    }

    /// Variance that codes get where they were rounded again after a multiplication, DN².
    fn again(&self) -> f64 {
        if self.step_dn.fract() == 0.0 { 0.0 } else { QUANTISATION }
    }

    /// Square of the step, DN²: the unit of variances in codes.
    pub fn square(&self) -> f64 {
        self.step_dn * self.step_dn
    }

    /// Variance of rounding to codes, DN².
    pub fn quantisation(&self) -> f64 {
        QUANTISATION * self.square() + self.again()
    }

    /// Variance that rounding to codes adds to Gaussian noise, DN²: [`rounding::rounding`] in
    /// units of codes.
    pub fn rounding(&self, variance: f64, mean: f64, spread: f64) -> f64 {
        let square = self.square();
        let mean = (mean - self.offset_dn) / self.step_dn;
        square * rounding::rounding(variance / square, mean, spread / square) + self.again()
    }

    /// Corrects a measured variance of samples for the dependence of rounding on the mean, so that
    /// rounding adds [`quantisation`](Self::quantisation), DN². With noise of less than a step,
    /// rounding changes the variance by anything from a negative amount (all samples have one
    /// code) to a quarter of the step's square (two codes). `None` where the noise is too small to
    /// be determined.
    pub fn as_if_resolved(&self, measured: Value, mean: f64, spread: f64) -> Option<Value> {
        let square = self.square();
        if measured.value - self.quantisation() > MIN_RESOLVED * square {
            return Some(measured);
        }
        let mut noise = measured.value - self.quantisation();
        for _ in 0..ITERATIONS {
            noise = measured.value - self.rounding(noise.max(0.0), mean, spread);
        }
        if noise < MIN_DESCRIBED * square {
            return None;
        }
        let slope =
            sensitivity(noise / square, (mean - self.offset_dn) / self.step_dn, spread / square);
        let error = if slope > 0.0 { measured.std_error / slope } else { f64::INFINITY };
        let error = error.min(self.quantisation()).max(measured.std_error);
        Some(Value::new(noise + self.quantisation(), error))
    }

    /// Whether the noise of a measured variance is so small that the effect of rounding depends on
    /// the mean.
    pub fn hides(&self, measured: f64) -> bool {
        measured < QUANTISATION_LIMITED * self.square() + self.quantisation()
    }

    /// A remark where the step is more than one DN.
    pub fn note(&self) -> Option<String> {
        let step = self.step_dn;
        let subtracted = self.quantisation();
        if step.fract() != 0.0 {
            return Some(format!(
                "codes are {step:.4} DN apart in the mean, so that they were multiplied by it and \
                 rounded again (digital gain): ({step:.4}² + 1)/12 = {subtracted:.4} DN² are \
                 subtracted for quantisation, not 1/12"
            ));
        }
        (step > 1.0).then(|| {
            format!(
                "all samples differ by multiples of {step} DN (left-aligned, or a digital gain): \
                 {step}²/12 = {subtracted:.4} DN² are subtracted for quantisation, not 1/12"
            )
        })
    }
}

fn greatest_common_divisor(a: u16, b: u16) -> u16 {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}

/// Codes that were multiplied by a number that is not whole and rounded again: the k-th code in
/// use lies within half a DN of a line over k, and both whole distances about its slope occur.
fn multiplied(codes: &[(u16, u32)]) -> Option<Codes> {
    let dense = |a: &(u16, u32), b: &(u16, u32)| a.1.min(b.1) >= MIN_SAMPLES;
    let run = codes.chunk_by(dense).max_by_key(|run| run.len())?;
    let run = &run[..run.len().min(MAX_RUN)];
    if run.len() < MIN_RUN {
        return None;
    }
    let place = |k: usize| f64::from(run[k].0);
    let (mut low, mut high) = (1.0, f64::INFINITY);
    for (i, j) in (0..run.len()).flat_map(|i| (i + 1..run.len()).map(move |j| (i, j))) {
        let (apart, codes) = (place(j) - place(i), (j - i) as f64);
        low = f64::max(low, (apart - 1.0) / codes);
        high = f64::min(high, (apart + 1.0) / codes);
    }
    let step_dn = f64::midpoint(low, high);
    let short = (1..run.len()).filter(|&k| place(k) - place(k - 1) < step_dn).count();
    let long = run.len() - 1 - short;
    if low >= high || short.min(long) < MIN_EACH {
        return None;
    }
    let offsets = (0..run.len()).map(|k| place(k) - step_dn * k as f64);
    let offset_dn = (offsets.sum::<f64>() / run.len() as f64).rem_euclid(step_dn);
    Some(Codes { step_dn, offset_dn })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(samples: &[u16]) -> CodeCounts {
        CodeCounts::of(samples, u16::MAX)
    }

    #[test]
    fn the_step_is_the_lowest_bit_that_varies() {
        for (samples, step) in [
            (&[64u16, 65, 70][..], 1.0),
            (&[64, 128, 640], 64.0),
            // A constant offset, as some converters add, is no smaller step.
            (&[1027, 1031, 2047], 4.0),
            (&[500, 500], 1.0),
            (&[], 1.0),
        ] {
            let codes = Codes::of([&seen(samples)]);
            assert_eq!(codes.step_dn, step, "{samples:?}");
            assert_eq!(codes.note().is_some(), step > 1.0);
        }
        // Constant stacks of different levels together determine the step.
        assert_eq!(Codes::of([&seen(&[64]), &seen(&[96]), &CodeCounts::default()]).step_dn, 32.0);
    }

    /// Codes n of a converter that became round(r (n − 64)) + 64, clamped at 4095: r is found, with
    /// r²/12 DN², and 1/12 more where the products had to be rounded. Codes that a converter never
    /// gives are no digital gain.
    #[test]
    fn codes_that_were_multiplied_have_the_step_of_the_digital_gain() {
        let gaussian = |middle: u16, code: u16| {
            let z = (f64::from(code) - f64::from(middle)) / 20.0;
            (4000.0 * (-0.5 * z * z).exp()) as usize
        };
        let samples = |of: &dyn Fn(u16) -> u16| -> Vec<u16> {
            [200u16, 900]
                .into_iter()
                .flat_map(|m| (m - 100..m + 100).flat_map(move |c| vec![c; gaussian(m, c)]))
                .map(of)
                .chain([4095; 50])
                .collect()
        };
        for (gain, again) in
            [(1.0, 0.0), (2.0, 0.0), (3.0, 0.0), (1.5, 1.0), (2.4, 1.0), (1.0625, 1.0)]
        {
            let multiplied = |c: u16| ((f64::from(c) - 64.0) * gain).round() as u16 + 64;
            let codes = Codes::of([&CodeCounts::of(&samples(&multiplied), 4095)]);
            assert!((codes.step_dn - gain).abs() < 1e-3, "{gain}: {codes:?}");
            let expected = (gain * gain + again) / 12.0;
            assert!((codes.quantisation() - expected).abs() < 3e-4, "{gain}: {codes:?}");
        }
        let holes = |c: u16| if [190, 195, 199, 207, 208, 895].contains(&c) { c + 1 } else { c };
        assert_eq!(Codes::of([&CodeCounts::of(&samples(&holes), 4095)]).step_dn, 1.0);
    }

    #[test]
    fn rounding_scales_with_the_step() {
        let fine = Codes::of([&seen(&[3, 4])]);
        let coarse = Codes::of([&seen(&[3 * 64 + 5, 4 * 64 + 5])]);
        assert_eq!(fine.rounding(0.3, 7.25, 0.0), rounding::rounding(0.3, 7.25, 0.0));
        let expected = 4096.0 * fine.rounding(0.3, 7.25, 0.1);
        let found = coarse.rounding(0.3 * 4096.0, 7.25 * 64.0 + 5.0, 0.1 * 4096.0);
        assert!((found / expected - 1.0).abs() < 1e-12);
        assert_eq!(coarse.quantisation(), 4096.0 / 12.0);
    }

    /// Rounded samples of Gaussian noise of 0.35 to 1.2 steps around means between two codes: the
    /// noise is recovered for every mean.
    #[test]
    fn rounding_is_corrected_for_any_mean() {
        let codes = Codes::of([&seen(&[64, 68, 72])]);
        for (sigma, mean) in [(0.35, 10.0), (0.35, 10.25), (0.4, 10.5), (0.5, 10.1), (1.2, 10.5)] {
            let density = |x: f64| (-0.5 * ((x - mean) / sigma).powi(2)).exp();
            let (mut n, mut sum, mut square) = (0.0, 0.0, 0.0);
            for k in 0..200_000 {
                let x = f64::from(k) * 1e-4;
                let (w, code) = (density(x), x.round() - mean);
                n += w;
                sum += w * code;
                square += w * code * code;
            }
            let variance = 16.0 * (square / n - (sum / n).powi(2));
            let measured = Value::new(variance, 0.01);
            let resolved = codes.as_if_resolved(measured, 4.0 * mean, 0.0).unwrap();
            let noise = (resolved.value - codes.quantisation()).sqrt() / 4.0;
            assert!((noise - sigma).abs() < 0.02, "{sigma} around {mean}: {noise}");
        }
        // With one or two codes, the noise is unknown.
        for (variance, mean) in [(0.0, 40.0), (4.0, 42.0)] {
            assert!(codes.as_if_resolved(Value::new(variance, 1e-3), mean, 0.0).is_none());
            assert!(codes.hides(variance));
        }
    }
}
