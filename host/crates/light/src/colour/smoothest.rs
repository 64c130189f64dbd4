//! The smoothest spectrum of a colour.
//!
//! A colour, in linear sRGB under D65, has many spectra. The one taken here is bounded and as
//! smooth as it can be: with ρ = ½ + u / (2 √(1 + u²)) it minimises
//!
//! > Σ (u_{i+1} − u_i)² + ε Σ u_i², so that Σ_i T_ci ρ_i = rgb_c
//!
//! over the bands i of [`Bands::VISIBLE`]. T is the CIE 1931 observer times D65, scaled so that
//! ρ = 1 has the colour 1, 1, 1: white is white and greys are flat on this grid of bands. No
//! spectra are learned from; of the methods compared (three bands, Smits 1999, Mallett and Yuksel
//! 2019, Otsu et al. 2018, Meng et al. 2015, Jakob and Hanika 2019) it comes nearest to measured
//! reflectances.
//!
//! An emission is L = W e^u in place of ρ, with W the spectrum of D65: positive, and of any range,
//! as it is solved for the colour over its largest component.
//!
//! Solved by Gauss-Newton on the constraint: with C the inverse of DᵀD + ε (D the differences) and
//! J = T diag(ρ'), u becomes C Jᵀ (J C Jᵀ)⁻¹ (J u − f), f = T ρ − rgb, the step halved while the
//! residual grows. C is the inverse of a tridiagonal matrix, so a step takes a few hundred
//! operations. All in f64, with no function that differs between machines.

use super::space;
use crate::Illuminant;
use crate::photometry::{KM, observer};
use camrig_base::color::{Matrix, inverse, multiply};
use camrig_base::{Bands, Result};

/// Bands of the spectra.
pub const COUNT: usize = Bands::VISIBLE.count;
/// A value per band.
pub type Curve = [f64; COUNT];

/// Weight of u itself relative to its steps: it decides where neither colour nor smoothness does,
/// beyond the observer's ends.
const EPSILON: f64 = 1e-4;
/// Reflectances asked for keep this distance from 0 and 1, which u reaches at infinity only: a
/// tenth of a code of 8 bits near black.
const LEAST: f64 = 2e-5;
/// Least component of an emission's colour, relative to the largest: e^u is never 0.
const MIN_EMISSION: f64 = 1e-4;
/// Bounds of u. A reflectance is within 6e-6 of 0 and 1 there, an emission at e⁻³⁰ is black.
const BOUND: f64 = 200.0;
const DARKEST_EMISSION: f64 = -30.0;
/// Steps after which the search ends: beside the faces of the cube u goes on to move where it is
/// large, and reflectances hardly change.
const MAX_STEPS: usize = 60;
/// Steps after which a residual that is still large means that no spectrum has the colour: those
/// that have one come within it in ten.
const TRIED_STEPS: usize = 20;
const FAR: f64 = 1e-2;
/// Halvings of a step before it is given up.
const MAX_HALVINGS: usize = 14;
/// Residual and change of u at which a solution is taken: some ten-thousandths of reflectance from
/// what further steps would give.
const SOLVED: (f64, f64) = (1e-6, 1e-4);
/// Residual up to which a spectrum has its colour: ΔE2000 below 0.1 down to black.
pub const REACHED: f64 = 1e-4;

/// What spectra are made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Domain {
    /// Reflectance, 0 to 1.
    Reflectance,
    /// Emission relative to the light of white.
    Emission,
}

/// A spectrum with the colour that it has.
#[derive(Clone, Copy)]
pub struct Solution {
    /// The value in each band: reflectance, or emission over that of white.
    pub values: Curve,
    /// Largest difference of a component from the colour asked for, or from the nearest one within
    /// reach of u where it lies on a bound; for an emission relative to the largest component.
    pub residual: f64,
}

/// Solves colours of one domain.
pub struct Smoothest {
    domain: Domain,
    /// Rows of T: linear sRGB of a curve of values.
    to_rgb: [Curve; 3],
    /// One over the diagonal of the tridiagonal matrix after elimination; its other diagonals are
    /// −1.
    pivots: Curve,
}

impl Smoothest {
    /// Colours of surfaces under D65, or of light over D65.
    ///
    /// # Errors
    /// None in practice: the tables are built in.
    pub fn new(domain: Domain) -> Result<Self> {
        Ok(Self::under(domain, &white()?))
    }

    /// Colours under another light, whose white counts as D65.
    pub fn under(domain: Domain, light: &Curve) -> Self {
        let mut pivots = [0.0; COUNT];
        for i in 0..COUNT {
            let ends = if i == 0 || i == COUNT - 1 { 1.0 } else { 2.0 };
            let before = if i == 0 { 0.0 } else { pivots[i - 1] };
            pivots[i] = 1.0 / (ends + EPSILON - before);
        }
        Self { domain, to_rgb: colour_of_bands(light), pivots }
    }

    /// Linear sRGB of a curve of values.
    pub fn colour(&self, values: &Curve) -> [f64; 3] {
        [0, 1, 2].map(|c| dot(&self.to_rgb[c], values))
    }

    /// The spectrum of a colour, which for a colour of none is the nearest one found.
    pub fn solve(&self, rgb: [f64; 3]) -> Solution {
        let largest = rgb.iter().copied().fold(0.0, f64::max);
        let reflects = self.domain == Domain::Reflectance;
        if largest <= 0.0 && rgb.iter().all(|&c| c > -LEAST) {
            return Solution { values: [0.0; COUNT], residual: 0.0 };
        }
        if reflects && rgb.iter().all(|c| (1.0..1.0 + LEAST).contains(c)) {
            return Solution { values: [1.0; COUNT], residual: 0.0 };
        }
        // Colours at the bounds themselves come within reach; those beyond stay what they are.
        let within = |c: f64, least: f64, most: f64| match c {
            c if (0.0..least).contains(&c) => least,
            c if c > most && c <= 1.0 => most,
            c => c,
        };
        let (scale, goal) = if reflects {
            (1.0, rgb.map(|c| within(c, LEAST, 1.0 - LEAST)))
        } else {
            (largest, rgb.map(|c| within(c / largest, MIN_EMISSION, 1.0)))
        };
        let u = self.iterate(goal);
        let values = u.map(|u| scale * self.value(u).0);
        let colour = self.colour(&values);
        let miss = |c: usize| (colour[c] / scale - goal[c]).abs();
        Solution { values, residual: miss(0).max(miss(1)).max(miss(2)) }
    }

    /// The value of u in this domain, and its derivative.
    fn value(&self, u: f64) -> (f64, f64) {
        match self.domain {
            Domain::Reflectance => {
                let square = 1.0 + u * u;
                let root = square.sqrt();
                (0.5 + u / (2.0 * root), 0.5 / (square * root))
            }
            Domain::Emission => {
                let value = libm::exp(u);
                (value, value)
            }
        }
    }

    /// The flat u that Gauss-Newton begins at.
    fn start(&self, goal: [f64; 3]) -> f64 {
        let mean = goal.iter().sum::<f64>() / 3.0;
        match self.domain {
            Domain::Reflectance => {
                let s = 2.0 * mean.clamp(0.02, 0.98) - 1.0;
                s / (1.0 - s * s).sqrt()
            }
            Domain::Emission => libm::log(mean.max(MIN_EMISSION)),
        }
    }

    fn iterate(&self, goal: [f64; 3]) -> Curve {
        let least = if self.domain == Domain::Reflectance { -BOUND } else { DARKEST_EMISSION };
        let residual = |u: &Curve| {
            let colour = self.colour(&u.map(|u| self.value(u).0));
            [0, 1, 2].map(|c| colour[c] - goal[c])
        };
        let solved = |off: [f64; 3]| off.iter().all(|v| v.abs() < SOLVED.0);
        let mut u = [self.start(goal); COUNT];
        for step in 0..MAX_STEPS {
            let off = residual(&u);
            let Some(target) = self.target(&u, off) else { break };
            let before = square(off);
            let mut part = 1.0;
            let mut found = None;
            for _ in 0..MAX_HALVINGS {
                let mut next = u;
                for i in 0..COUNT {
                    next[i] = (u[i] + part * (target[i] - u[i])).clamp(least, BOUND);
                }
                let off = residual(&next);
                if solved(off) || square(off) <= before * (1.0 - 0.05 * part) {
                    found = Some((next, off));
                    break;
                }
                part /= 2.0;
            }
            let Some((next, off)) = found else { break };
            let change = (0..COUNT).fold(0.0f64, |m, i| m.max((next[i] - u[i]).abs()));
            u = next;
            let without = step >= TRIED_STEPS && off.iter().any(|v| v.abs() > FAR);
            if without || solved(off) && change < SOLVED.1 {
                break;
            }
        }
        u
    }

    /// Where a whole step from `u` leads, whose colour is `off` the goal.
    fn target(&self, u: &Curve, off: [f64; 3]) -> Option<Curve> {
        let slopes = u.map(|u| self.value(u).1);
        let jacobian: [Curve; 3] = self.to_rgb.map(|mut row| {
            row.iter_mut().zip(&slopes).for_each(|(t, s)| *t *= s);
            row
        });
        let smooth = jacobian.map(|row| self.smoothed(row));
        let mut system = [[0.0; 3]; 3];
        for (row, j) in system.iter_mut().zip(&jacobian) {
            for (k, s) in row.iter_mut().zip(&smooth) {
                *k = dot(j, s);
            }
        }
        // Keeps the system solvable where colours at the bounds leave almost no slope.
        let trace: f64 = (0..3).map(|c| system[c][c]).sum();
        (0..3).for_each(|c| system[c][c] += 1e-9 * trace + 1e-14);
        let inverse = inverse(&system)?;
        let right = [0, 1, 2].map(|c| dot(&jacobian[c], u) - off[c]);
        let weights = inverse.map(|row| row.iter().zip(&right).map(|(m, r)| m * r).sum::<f64>());
        let mut target = [0.0; COUNT];
        for i in 0..COUNT {
            target[i] = (0..3).map(|c| weights[c] * smooth[c][i]).sum();
        }
        target.iter().all(|v: &f64| v.is_finite()).then_some(target)
    }

    /// C times a curve: the tridiagonal system solved.
    fn smoothed(&self, mut curve: Curve) -> Curve {
        for i in 1..COUNT {
            curve[i] += curve[i - 1] * self.pivots[i - 1];
        }
        curve[COUNT - 1] *= self.pivots[COUNT - 1];
        for i in (0..COUNT - 1).rev() {
            curve[i] = (curve[i] + curve[i + 1]) * self.pivots[i];
        }
        curve
    }
}

/// Σ a·b.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn square(v: [f64; 3]) -> f64 {
    v.iter().map(|v| v * v).sum()
}

/// The spectrum of white, D65 in W m⁻² sr⁻¹ nm⁻¹, for a luminance of 1 cd/m² by the sum over the
/// bands.
///
/// # Errors
/// None in practice: the tables are built in.
pub fn white() -> Result<Curve> {
    let light = Illuminant::parse("D65")?.power;
    let [_, visibility, _] = observer();
    let mut curve = [0.0; COUNT];
    let mut luminance = 0.0;
    for (i, nm) in Bands::VISIBLE.centres().enumerate() {
        curve[i] = light.at(nm);
        luminance += KM * curve[i] * visibility.at(nm) * Bands::VISIBLE.step_nm;
    }
    Ok(curve.map(|v| v / luminance))
}

/// T: the linear sRGB of a reflectance of 1 in each band and 0 elsewhere, in this light.
fn colour_of_bands(light: &Curve) -> [Curve; 3] {
    let mut sums = observer().map(|curve| {
        let mut row = [0.0; COUNT];
        for (i, nm) in Bands::VISIBLE.centres().enumerate() {
            row[i] = curve.at(nm) * light[i];
        }
        row
    });
    // X, Y and Z of these bands' white become those of D65.
    let white = space::xyz_of(space::D65);
    for (row, white) in sums.iter_mut().zip(white) {
        let sum: f64 = row.iter().sum();
        row.iter_mut().for_each(|v| *v *= white / sum);
    }
    let srgb = space::srgb_from_xyz();
    let mut rows = [[0.0; COUNT]; 3];
    for i in 0..COUNT {
        let xyz: Matrix = [0, 1, 2].map(|c| [sums[c][i], 0.0, 0.0]);
        let rgb = multiply(&srgb, &xyz);
        (0..3).for_each(|c| rows[c][i] = rgb[c][0]);
    }
    rows
}
