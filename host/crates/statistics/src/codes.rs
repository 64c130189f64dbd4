//! Nonlinearity of the converter, from the histograms of codes: waves with the periods of wrong
//! bits, roughness, and missing codes.

use super::collect::Collected;
use super::noise::Summary;
use super::statistic::{Scale, What};
use super::temporal::Temporal;

/// A period of codes.
#[derive(Clone, Copy, Debug)]
pub struct CodePeriod {
    /// Cycles per code.
    pub frequency: f64,
    /// The period in codes, for people.
    pub name: &'static str,
}

const fn period(frequency: f64, name: &'static str) -> CodePeriod {
    CodePeriod { frequency, name }
}

/// The periods that are tested. A wrong bit k of the converter has a period of 2^(k+1) codes and
/// odd harmonics.
pub const CODE_PERIODS: [CodePeriod; 5] = [
    period(0.5, "2"),
    period(0.25, "4"),
    period(0.125, "8"),
    period(0.375, "8/3"),
    period(0.0625, "16"),
];

/// Standard deviation of a histogram, cycles of a wave, from which the amplitude of a smooth
/// distribution itself, exp(−2π²σ²f²), is below its Poisson scatter: at 0.75 it is 1.5·10⁻⁵.
const MIN_WIDTH_FOR_WAVES: f64 = 0.75;
/// Share of samples at the ends of the scale above which a histogram is clipped and not used.
const CLIPPED: f64 = 1e-4;
/// Standard deviation of a histogram, codes, from which its fourth differences are noise alone.
const MIN_WIDTH_FOR_DIFFERENCES: f64 = 4.0;
/// Samples in five codes from which their fourth difference is nearly normally distributed.
const MIN_SAMPLES_FOR_DIFFERENCES: f64 = 250.0;
/// Samples of both neighbours above which a code that never occurs is missing: a Poisson variate of
/// mean 30 is zero once in 10¹³.
const MIN_SAMPLES_AROUND_MISSING: f64 = 30.0;
/// Number of fourth differences above which their mean square is a statistic.
const MIN_DIFFERENCES: f64 = 30.0;
/// Ratio of the number of fourth differences to the effective sample size: 1 + 2 Σ ρ², as they
/// share codes.
const CORRELATION_FACTOR: f64 = 2.3;

/// The statistics of the codes of all stacks whose histograms are wide enough to be smooth.
pub(super) fn statistics(stacks: &[Temporal], summaries: &[Summary], out: &mut Collected) {
    let bins = stacks.first().map_or(0, |t| t.histogram.len());
    // Clipped samples at an end of the scale are not a nonlinearity of the converter.
    let inside: Vec<(&Temporal, &Summary)> =
        stacks.iter().zip(summaries).filter(|(t, _)| !is_clipped(t)).collect();
    for (k, CodePeriod { frequency, .. }) in CODE_PERIODS.iter().enumerate() {
        let (mut re, mut im, mut n) = (0.0, 0.0, 0.0);
        for (t, _) in inside.iter().filter(|(_, s)| s.width * frequency >= MIN_WIDTH_FOR_WAVES) {
            for (code, &count) in t.histogram.iter().enumerate().filter(|c| *c.1 > 0) {
                let angle = std::f64::consts::TAU * ((code as f64 * frequency) % 1.0);
                re += f64::from(count) * libm::cos(angle);
                im += f64::from(count) * libm::sin(angle);
                n += f64::from(count);
            }
        }
        if n > 0.0 {
            let dof = if *frequency == 0.5 { 1.0 } else { 2.0 };
            let value = (re * re + im * im) * 2.0 / dof / n;
            out.add(What::Codes(k as u8), value, (2.0f64 / (9.0 * dof)).sqrt(), Scale::CubeRoot);
        }
    }
    // Fourth differences, which vanish for a smooth density, relative to their Poisson scatter.
    let mut pooled = vec![0.0f64; bins];
    for (t, _) in inside.iter().filter(|(_, s)| s.width > MIN_WIDTH_FOR_DIFFERENCES) {
        pooled.iter_mut().zip(&t.histogram).for_each(|(p, &h)| *p += f64::from(h));
    }
    let (mut sum, mut count, mut missing) = (0.0, 0.0, 0.0);
    for w in pooled.windows(5).filter(|w| w.iter().sum::<f64>() > MIN_SAMPLES_FOR_DIFFERENCES) {
        let d = w[0] - 4.0 * w[1] + 6.0 * w[2] - 4.0 * w[3] + w[4];
        let var = w[0] + 16.0 * w[1] + 36.0 * w[2] + 16.0 * w[3] + w[4];
        sum += d * d / var;
        count += 1.0;
        missing += f64::from(w[2] == 0.0 && w[1].min(w[3]) > MIN_SAMPLES_AROUND_MISSING);
    }
    if count > MIN_DIFFERENCES {
        let sd = (2.0 * CORRELATION_FACTOR / count).sqrt();
        out.add(What::Roughness, sum / count, sd, Scale::Log);
        out.add(What::MissingCodes, missing, 1.0, Scale::Count);
    }
}

/// Whether too many samples lie at either end of the scale.
pub fn is_clipped(t: &Temporal) -> bool {
    let ends = [t.histogram.first(), t.histogram.last()].into_iter().flatten();
    let ends: f64 = ends.map(|&h| f64::from(h)).sum();
    ends > CLIPPED * (t.mean.data.len() * t.frames) as f64
}
