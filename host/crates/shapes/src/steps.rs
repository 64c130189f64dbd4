//! Steps in a profile of lines: does it change at a line, rather than smoothly?
//!
//! Smooth laws of several degrees stand against the same laws with steps, by the scatter of the
//! lines about each: n ln(scatter) + free parameters ln n (Schwarz 1978).

use crate::FALSE_ALARMS;
use camrig_diagnose::evidence::Estimated;
use camrig_diagnose::numerics::tails;
use std::f64::consts::PI;

/// Smooth laws: degree of the polynomial, and cosines for what is steep at an edge.
const SMOOTH: [(usize, usize); 4] = [(0, 0), (4, 0), (4, 6), (4, 19)];
/// Lines for each free parameter of a smooth law, without which it is not tried.
const LINES_PER_TERM: usize = 4;
/// Steps of a profile, at most: sensors with 8 taps side by side.
const MAX_STEPS: usize = 7;
/// Share of the lines at each end, and their least number, in which no step is looked for: a border
/// that settles is no tap.
const END: (usize, usize) = (32, 4);

/// Steps of a profile with the smooth law beside them.
#[derive(Clone, Debug)]
pub(crate) struct Steps {
    /// First line after each step, ascending.
    pub at: Vec<usize>,
    /// Twice the gain in log-likelihood of all steps together.
    pub evidence: f64,
    law: (usize, usize),
}

/// A basis of orthonormal columns.
struct Basis(Vec<Vec<f64>>);

impl Basis {
    /// A constant and a smooth law over `n` lines.
    fn of((degree, cosines): (usize, usize), n: usize) -> Self {
        let mut basis = Self(Vec::new());
        let u = |i: usize| (2 * i + 1) as f64 / n as f64 - 1.0;
        for power in 0..=degree {
            basis.add((0..n).map(|i| u(i).powi(power as i32)).collect());
        }
        for k in 1..=cosines {
            basis.add((0..n).map(|i| libm::cos(PI * k as f64 * (u(i) + 1.0) / 2.0)).collect());
        }
        basis
    }

    /// What a column has beside the basis.
    fn apart(&self, mut column: Vec<f64>) -> Vec<f64> {
        // Twice, against rounding.
        for _ in 0..2 {
            for b in &self.0 {
                let share = dot(b, &column);
                column.iter_mut().zip(b).for_each(|(c, b)| *c -= share * b);
            }
        }
        column
    }

    /// Adds a column, unless the basis has it already.
    fn add(&mut self, column: Vec<f64>) {
        let whole = dot(&column, &column);
        let mut apart = self.apart(column);
        let norm = dot(&apart, &apart);
        if norm > 1e-9 * whole {
            let scale = norm.sqrt().recip();
            apart.iter_mut().for_each(|v| *v *= scale);
            self.0.push(apart);
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// 1 from a line on, 0 before.
fn step(at: usize, n: usize) -> Vec<f64> {
    (0..n).map(|i| if i < at { 0.0 } else { 1.0 }).collect()
}

/// Lines that tell as much as these, which follow each other: n (1 − r)/(1 + r), r the correlation
/// of neighbours.
fn independent(rest: &[f64]) -> f64 {
    let lag: f64 = rest.windows(2).map(|p| p[0] * p[1]).sum();
    let r = (lag / dot(rest, rest).max(1e-300)).clamp(0.0, 0.99);
    rest.len() as f64 * (1.0 - r) / (1.0 + r)
}

/// The steps of a profile; `profiles` is how many are searched in all. None where a smooth law
/// does as well.
pub(crate) fn find(profile: &[f64], profiles: usize) -> Option<Steps> {
    let n = profile.len();
    let end = (n / END.0).max(END.1);
    if n < 4 * end {
        return None;
    }
    // Two-sided, for the best of so many lines.
    let z = tails::normal_quantile(libm::log(FALSE_ALARMS / (2.0 * (profiles * n) as f64)));
    let limit = z * z;
    let smooth = SMOOTH.iter().filter(|(d, c)| LINES_PER_TERM * (d + c) < n);
    let mut best: Option<(f64, Steps)> = None;
    let mut without = f64::INFINITY;
    for &law in smooth {
        let mut basis = Basis::of(law, n);
        let mut rest = basis.apart(profile.to_vec());
        let mut at: Vec<usize> = Vec::new();
        let cost = |rest: &[f64], terms: usize| {
            n as f64 * libm::log(dot(rest, rest).max(1e-300)) + terms as f64 * libm::log(n as f64)
        };
        loop {
            // A step has its place and its size.
            let now = cost(&rest, basis.0.len() + at.len());
            if at.is_empty() {
                without = without.min(now);
            } else if best.as_ref().is_none_or(|b| now < b.0) {
                best = Some((now, Steps { at: at.clone(), evidence: 0.0, law }));
            }
            let gain = |j: usize| {
                let t = basis.apart(step(j, n));
                let norm = dot(&t, &t);
                if norm < 1e-6 { 0.0 } else { dot(&t, &rest).powi(2) / norm }
            };
            let free = |j: &usize| at.iter().all(|a| a.abs_diff(*j) >= end);
            let most = (end..n - end).filter(free).map(|j| (j, gain(j)));
            let Some((j, _)) = most.max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
            basis.add(step(j, n));
            let next = basis.apart(profile.to_vec());
            // By as many lines as what is left tells of: the step itself makes them follow.
            let ratio = dot(&rest, &rest) / dot(&next, &next).max(1e-300);
            if independent(&next) * libm::log(ratio) < limit || at.len() == MAX_STEPS {
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
    /// The sizes of these steps in a profile, by least squares beside the smooth law.
    pub fn sizes(&self, profile: &[f64]) -> Vec<Estimated> {
        let n = profile.len();
        let mut basis = Basis::of(self.law, n);
        self.at.iter().for_each(|&at| basis.add(step(at, n)));
        let rest = basis.apart(profile.to_vec());
        let dof = (n as f64 - basis.0.len() as f64).max(1.0);
        let variance = dot(&rest, &rest) / dof * n as f64 / independent(&rest);
        let of = |one: usize| {
            let mut others = Basis::of(self.law, n);
            let rivals = self.at.iter().enumerate().filter(|(i, _)| *i != one);
            rivals.for_each(|(_, &at)| others.add(step(at, n)));
            let t = others.apart(step(self.at[one], n));
            let norm = dot(&t, &t).max(1e-300);
            Estimated { value: dot(&t, profile) / norm, se: (variance / norm).sqrt() }
        };
        (0..self.at.len()).map(of).collect()
    }

    /// The same steps with those of another profile; one place within so many lines of another is
    /// the same.
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

    /// The law under which a profile's steps were found.
    pub fn under_law_of(&self, other: Option<&Steps>) -> Self {
        let law = other.map_or(SMOOTH[0], |o| o.law);
        Self { law, ..self.clone() }
    }
}
