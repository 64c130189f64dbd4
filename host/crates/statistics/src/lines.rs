//! The means of the rows or of the columns of a map: variance, periods, spectral lines.

use crate::numerics::spectrum::Spectrum;
use camrig_base::median::median;
use camrig_linear::moments;

/// Number of lines over which uneven light is smooth. EMVA 1288 applies a high pass for the same
/// reason.
const SMOOTH_LINES: usize = 33;
/// Periods of columns and rows that are tested: those of converters shared by 2, 4 or 8 lines.
pub const PERIODS: [usize; 3] = [2, 4, 8];
/// Statistics of the means of a map's rows or columns.
#[derive(Clone, Debug, Default)]
pub struct Lines {
    /// The means, in the map's unit, without smooth terms.
    pub means: Vec<f64>,
    /// Their variance apart from what repeats after the longest of [`PERIODS`].
    pub variance: f64,
    /// Variance between the phases of each of [`PERIODS`] relative to that within: 1 where there is
    /// no period.
    pub periods: [f64; 3],
    /// Largest bin of their power relative to the median.
    pub peak: f64,
}

impl Lines {
    /// Of line means; where the light may be uneven, only of what changes within `SMOOTH_LINES`.
    pub fn new(means: Vec<f64>, even: bool) -> Self {
        let means = if even { means } else { without_smooth(&means) };
        Self {
            variance: aperiodic_variance(&means),
            periods: periods(&means),
            peak: peak(&means),
            means,
        }
    }
}

/// Degrees of freedom of this number of lines after subtraction of smooth terms and of the means of
/// the longest period.
pub fn aperiodic_dof(lines: f64) -> f64 {
    lines - PERIODS[PERIODS.len() - 1] as f64 - 2.0
}

/// Lines minus the mean of the `SMOOTH_LINES` around each; near the ends of fewer, equally many on
/// either side, so that a slope vanishes.
fn without_smooth(lines: &[f64]) -> Vec<f64> {
    let residual = |i: usize| {
        let reach = (SMOOTH_LINES / 2).min(i).min(lines.len() - 1 - i);
        let around = &lines[i - reach..=i + reach];
        lines[i] - around.iter().sum::<f64>() / around.len() as f64
    };
    (0..lines.len()).map(residual).collect()
}

/// Mean of the lines of each phase of a period.
pub fn phase_means(lines: &[f64], period: usize) -> Vec<f64> {
    let of = |phase: usize| lines.iter().skip(phase).step_by(period);
    (0..period).map(|phase| of(phase).sum::<f64>() / of(phase).count() as f64).collect()
}

/// Variance of lines about the means of the longest period, so that a period does not count as a
/// random pattern.
fn aperiodic_variance(lines: &[f64]) -> f64 {
    let period = PERIODS[PERIODS.len() - 1].min(lines.len());
    let mut sum = 0.0;
    for (phase, mean) in phase_means(lines, period).into_iter().enumerate() {
        let own = lines.iter().skip(phase).step_by(period);
        sum += own.map(|v| (v - mean).powi(2)).sum::<f64>();
    }
    sum / (lines.len() - period).max(1) as f64
}

/// Variance of lines between the phases of each period relative to that within: 1 where there is no
/// period.
fn periods(lines: &[f64]) -> [f64; 3] {
    let (mean, variance) = moments(lines);
    let var = variance.max(1e-300);
    PERIODS.map(|p| {
        let mut sum = 0.0;
        for phase in 0..p {
            let (mut total, mut count) = (0.0, 0.0);
            for v in lines.iter().skip(phase).step_by(p) {
                total += v - mean;
                count += 1.0;
            }
            sum += total * total / f64::max(count, 1.0);
        }
        let between = sum / (p as f64 - 1.0);
        let within = ((lines.len() as f64 - 1.0) * var - sum) / (lines.len() - p) as f64;
        between / within.max(1e-300)
    })
}

/// Largest bin of the power relative to the mean of an exponential distribution with the power's
/// median.
fn peak(lines: &[f64]) -> f64 {
    let mut power = Spectrum::of(lines);
    let highest = power.iter().copied().fold(0.0, f64::max);
    let mean = median(&mut power, f64::total_cmp) / std::f64::consts::LN_2;
    highest / mean.max(1e-300)
}
