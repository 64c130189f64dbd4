//! Steps in a profile of lines: does it change abruptly at a line, or smoothly?
//!
//! Smooth models of several degrees are compared with the same models with steps by the Bayesian
//! information criterion: n ln(residual sum of squares) + free parameters × ln n (Schwarz 1978).

use super::FALSE_ALARMS;
use crate::numerics::tails;
use camrig_base::Value;
use camrig_linear::dot;
use std::f64::consts::PI;

/// A smooth model of a profile.
#[derive(Clone, Copy, Debug)]
struct Smooth {
    /// Degree of the polynomial.
    degree: usize,
    /// Number of cosines, for what is steep at an edge.
    cosines: usize,
}

const CONSTANT: Smooth = Smooth { degree: 0, cosines: 0 };
/// The smooth models that are tried.
const SMOOTH: [Smooth; 4] = [
    CONSTANT,
    Smooth { degree: 4, cosines: 0 },
    Smooth { degree: 4, cosines: 6 },
    Smooth { degree: 4, cosines: 19 },
];
/// Lines that a smooth model needs for each of its free parameters.
const MIN_LINES_PER_TERM: usize = 4;
/// Steps of a profile, at most: sensors with 8 taps side by side.
const MAX_STEPS: usize = 7;
/// No step is looked for within this fraction of the lines from either end, and within
/// [`MIN_END`] lines: a transient at the border is not a tap.
const END_FRACTION: usize = 32;
const MIN_END: usize = 4;

/// Steps of a profile, found together with a smooth model.
#[derive(Clone, Debug)]
pub(crate) struct Steps {
    /// First line after each step, ascending.
    pub at: Vec<usize>,
    /// Twice the gain in log-likelihood of all steps together.
    pub evidence: f64,
    smooth: Smooth,
}

/// A basis of orthonormal columns.
struct Basis(Vec<Vec<f64>>);

impl Basis {
    /// A smooth model over `n` lines.
    fn of(Smooth { degree, cosines }: Smooth, n: usize) -> Self {
        let mut basis = Self(Vec::new());
        let u = |i: usize| (2 * i + 1) as f64 / n as f64 - 1.0;
        for power in 0..=degree {
            basis.add((0..n).map(|i| libm::pow(u(i), power as f64)).collect());
        }
        for k in 1..=cosines {
            basis.add((0..n).map(|i| libm::cos(PI * k as f64 * (u(i) + 1.0) / 2.0)).collect());
        }
        basis
    }

    /// The residual of a column after projection onto the basis.
    fn residual(&self, mut column: Vec<f64>) -> Vec<f64> {
        // Twice, to reduce rounding errors.
        for _ in 0..2 {
            for b in &self.0 {
                let share = dot(b, &column);
                column.iter_mut().zip(b).for_each(|(c, b)| *c -= share * b);
            }
        }
        column
    }

    /// Adds a column, unless it depends linearly on the basis.
    fn add(&mut self, column: Vec<f64>) {
        let whole = dot(&column, &column);
        let mut residual = self.residual(column);
        let norm = dot(&residual, &residual);
        if norm > 1e-9 * whole {
            let scale = norm.sqrt().recip();
            residual.iter_mut().for_each(|v| *v *= scale);
            self.0.push(residual);
        }
    }
}

/// 0 before a line, 1 from it on.
fn step(at: usize, n: usize) -> Vec<f64> {
    (0..n).map(|i| if i < at { 0.0 } else { 1.0 }).collect()
}

/// Number of independent samples with the information of these residuals, whose neighbours have the
/// correlation r: n (1 − r)/(1 + r).
fn effective_sample_size(residuals: &[f64]) -> f64 {
    let lag: f64 = residuals.windows(2).map(|p| p[0] * p[1]).sum();
    let r = (lag / dot(residuals, residuals).max(1e-300)).clamp(0.0, 0.99);
    residuals.len() as f64 * (1.0 - r) / (1.0 + r)
}

/// The steps of a profile; `profiles` is how many are searched in all. None where a smooth model
/// describes it as well.
pub(crate) fn find(profile: &[f64], profiles: usize) -> Option<Steps> {
    let n = profile.len();
    let end = (n / END_FRACTION).max(MIN_END);
    if n < 4 * end {
        return None;
    }
    // Two-sided, for the best of so many lines.
    let z = tails::normal_quantile(libm::log(FALSE_ALARMS / (2.0 * (profiles * n) as f64)));
    let limit = z * z;
    let smooth = SMOOTH.iter().filter(|s| MIN_LINES_PER_TERM * (s.degree + s.cosines) < n);
    let mut best: Option<(f64, Steps)> = None;
    let mut without = f64::INFINITY;
    for &smooth in smooth {
        let mut basis = Basis::of(smooth, n);
        let mut rest = basis.residual(profile.to_vec());
        let mut at: Vec<usize> = Vec::new();
        let cost = |rest: &[f64], terms: usize| {
            n as f64 * libm::log(dot(rest, rest).max(1e-300)) + terms as f64 * libm::log(n as f64)
        };
        loop {
            // A step has two parameters, its position and its size.
            let now = cost(&rest, basis.0.len() + at.len());
            if at.is_empty() {
                without = without.min(now);
            } else if best.as_ref().is_none_or(|b| now < b.0) {
                best = Some((now, Steps { at: at.clone(), evidence: 0.0, smooth }));
            }
            let gain = |j: usize| {
                let t = basis.residual(step(j, n));
                let norm = dot(&t, &t);
                if norm < 1e-6 { 0.0 } else { dot(&t, &rest).powi(2) / norm }
            };
            let free = |j: &usize| at.iter().all(|a| a.abs_diff(*j) >= end);
            let most = (end..n - end).filter(free).map(|j| (j, gain(j)));
            let Some((j, _)) = most.max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
            basis.add(step(j, n));
            let next = basis.residual(profile.to_vec());
            // The sample size is that of the residuals without the step, which correlates them.
            let ratio = dot(&rest, &rest) / dot(&next, &next).max(1e-300);
            if effective_sample_size(&next) * libm::log(ratio) < limit || at.len() == MAX_STEPS {
                break;
            }
            at.push(j);
            rest = next;
        }
    }
    let (cost, mut steps) = best?;
    steps.evidence = without - cost;
    steps.at.sort_unstable();
    (steps.evidence > limit).then_some(steps)
}

impl Steps {
    /// The sizes of these steps in a profile, by least squares together with the smooth model.
    pub fn sizes(&self, profile: &[f64]) -> Vec<Value> {
        let n = profile.len();
        let mut basis = Basis::of(self.smooth, n);
        self.at.iter().for_each(|&at| basis.add(step(at, n)));
        let rest = basis.residual(profile.to_vec());
        let dof = (n as f64 - basis.0.len() as f64).max(1.0);
        let variance = dot(&rest, &rest) / dof * n as f64 / effective_sample_size(&rest);
        let of = |one: usize| {
            let mut others = Basis::of(self.smooth, n);
            let rivals = self.at.iter().enumerate().filter(|(i, _)| *i != one);
            rivals.for_each(|(_, &at)| others.add(step(at, n)));
            let t = others.residual(step(self.at[one], n));
            let norm = dot(&t, &t).max(1e-300);
            Value { value: dot(&t, profile) / norm, std_error: (variance / norm).sqrt() }
        };
        (0..self.at.len()).map(of).collect()
    }

    /// The union with the steps of another profile; positions within `same` lines are one step.
    pub fn joined(mut self, other: Steps, same: usize) -> Self {
        for at in other.at {
            if self.at.iter().all(|a| a.abs_diff(at) > same) {
                self.at.push(at);
            }
        }
        self.at.sort_unstable();
        self.evidence += other.evidence;
        self
    }

    /// The same steps with the smooth model of another profile's steps.
    pub fn with_smooth_of(&self, other: Option<&Steps>) -> Self {
        let smooth = other.map_or(CONSTANT, |o| o.smooth);
        Self { smooth, ..self.clone() }
    }
}
