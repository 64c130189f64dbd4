//! The dark against exposure time and temperature: black level in DN, dark current in DN per
//! second, and the temperature step that doubles it.

use super::fit::Fit;
use super::ladder::Level;
use super::rounding::QUANTISATION;
use super::tolerance::{SAME_EXPOSURE, SAME_TEMPERATURE_C};
use camrig_base::Value;

/// Smallest ratio of abscissas (exposure times, signals) for a line extrapolated to zero. Two
/// points at t and 1.5 t give 3 y₁ − 2 y₂ there, with 3.6 times the error of one.
pub(crate) const MIN_SPAN: f64 = 1.5;
/// Smallest dark current in standard errors for the fit of the doubling temperature: the logarithm
/// of a less certain rate is biased.
const MIN_RATE: f64 = 3.0;
/// Smallest number of exposure times for a line.
pub(crate) const MIN_EXPOSURES: usize = 2;

/// The mean of a dark at an exposure time.
#[derive(Clone, Copy, Debug)]
struct DarkPoint {
    exposure_s: f64,
    mean_dn: Value,
}

/// Mean of the dark against exposure time.
#[derive(Clone, Debug)]
pub struct DarkLine {
    points: Vec<DarkPoint>,
    /// Line through the means, where the exposure times span [`MIN_SPAN`].
    line: Option<Fit>,
}

impl DarkLine {
    /// The dark of one channel.
    pub fn of(darks: &[Level], channel: usize) -> Self {
        let points: Vec<DarkPoint> = darks
            .iter()
            .map(|d| {
                let m = &d.channels[channel];
                // A constant frame has no scatter; its mean is still uncertain by rounding.
                let floor = (QUANTISATION / (m.pixels() * m.frames as f64)).sqrt();
                let mean_dn = Value::new(m.mean(), m.mean_error().max(floor));
                DarkPoint { exposure_s: d.exposure_s, mean_dn }
            })
            .collect();
        let datum = |p: &DarkPoint| (vec![1.0, p.exposure_s], p.mean_dn);
        let line = Fit::new(&points.iter().map(datum).collect::<Vec<_>>()).ok();
        let exposures: Vec<f64> = points.iter().map(|p| p.exposure_s).collect();
        Self { line: line.filter(|_| spans(&exposures)), points }
    }

    /// Mean of the dark at an exposure time (s), DN: of the darks of that exposure, otherwise on
    /// the line through all darks, otherwise of the first dark.
    pub fn mean_at(&self, exposure_s: f64) -> Value {
        let same: Vec<Value> = self
            .points
            .iter()
            .filter(|p| (p.exposure_s - exposure_s).abs() <= SAME_EXPOSURE * exposure_s)
            .map(|p| p.mean_dn)
            .collect();
        if let Some(mean) = Value::combine(same) {
            return mean;
        }
        match &self.line {
            Some(fit) => {
                let c = &fit.coefficients;
                let variance = fit.covariance(0, 0)
                    + 2.0 * exposure_s * fit.covariance(0, 1)
                    + exposure_s * exposure_s * fit.covariance(1, 1);
                let error = (variance * fit.reduced_chi2().max(1.0)).sqrt();
                Value::new(c[0] + c[1] * exposure_s, error)
            }
            None => self.points[0].mean_dn,
        }
    }

    /// Mean at zero exposure, DN, and its increase, DN/s; the latter is `None` without a line.
    pub fn offset_and_rate(&self) -> (Value, Option<Value>) {
        match &self.line {
            Some(fit) => {
                let of = |j| Value::new(fit.coefficients[j], fit.std_error(j));
                (of(0), Some(of(1)))
            }
            None => (self.mean_at(self.points[0].exposure_s), None),
        }
    }
}

/// The temperature step that doubles the dark current, °C: from a line through ln(dark current)
/// against temperature, with one point for each temperature that has two or more exposure times.
/// `None` with one temperature, or where the current does not rise.
pub fn doubling(darks: &[Level], others: &[Level], channel: usize) -> Option<Value> {
    let mut groups: Vec<Vec<Level>> = Vec::new();
    for level in darks.iter().chain(others) {
        let t = level.temperature_c?;
        let near = |g: &&mut Vec<Level>| {
            g[0].temperature_c.is_some_and(|u| (u - t).abs() <= SAME_TEMPERATURE_C)
        };
        match groups.iter_mut().find(near) {
            Some(group) => group.push(level.clone()),
            None => groups.push(vec![level.clone()]),
        }
    }
    let mut logs = Vec::new();
    for group in &groups {
        let Some(rate) = DarkLine::of(group, channel).offset_and_rate().1 else { continue };
        if rate.value > MIN_RATE * rate.std_error {
            let sum: f64 = group.iter().filter_map(|l| l.temperature_c).sum();
            let log = Value::new(libm::log(rate.value), rate.std_error / rate.value);
            logs.push((vec![1.0, sum / group.len() as f64], log));
        }
    }
    let fit = Fit::new(&logs).ok()?;
    let slope = fit.coefficients[1];
    let step = std::f64::consts::LN_2 / slope;
    (slope > 0.0).then(|| Value::new(step, step * fit.std_error(1) / slope))
}

/// Number of different exposure times.
pub(crate) fn distinct(exposures: &[f64]) -> usize {
    let mut sorted = exposures.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup_by(|a, b| (*a / *b - 1.0).abs() < SAME_EXPOSURE);
    sorted.len()
}

/// Whether exposure times span [`MIN_SPAN`].
pub(crate) fn spans(exposures: &[f64]) -> bool {
    let longest = exposures.iter().copied().fold(0.0, f64::max);
    exposures.iter().any(|t| longest >= MIN_SPAN * t)
}
