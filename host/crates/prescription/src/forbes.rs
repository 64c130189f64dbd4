//! Forbes' aspheres: departures from a conic or a sphere by orthogonal polynomials.
//!
//! With u the distance from the axis over the normalisation radius and x = u²:
//! - Q-con, "strong": conic + u⁴ Σ aₘ Qₘ(x), where Qₘ is the Jacobi polynomial
//!   P⁽⁰'⁴⁾ₘ(2x − 1);
//! - Q-bfs, "mild": sphere + u²(1 − u²)/φ · Σ aₘ Qₘ(x), φ = √(1 − c²r²), where the Qₘ make the
//!   slopes orthogonal. With a conic in place of the sphere φ is the cosine of the angle of its
//!   normal too, φ² = (1 − (1 + k)c²r²)/(1 − k·c²r²), as OpticStudio has it.
//!
//! Recurrences: G. W. Forbes, Optics Express 15, 5218 (2007) and 18, 19700 (2010). They are
//! evaluated as they stand, since in powers of r such polynomials lose all digits by order 20.

use camrig_base::{Error, Result};

/// Which polynomials.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// Departure from a conic.
    Con,
    /// Departure from a sphere or conic, normal to it.
    Bfs,
}

/// Most coefficients: more than any program takes.
pub const MOST: usize = 100;

/// The departure of a Forbes asphere.
#[derive(Clone, Debug, PartialEq)]
pub struct Forbes {
    /// Which polynomials.
    pub kind: Kind,
    /// Normalisation radius, mm.
    pub radius: f64,
    /// a₀, a₁, ..., mm.
    pub coefficients: Vec<f64>,
    /// Per term from the second on: Qₘ from Qₘ₋₁, Qₘ₋₂ and (of Q-bfs) an auxiliary polynomial.
    recurrence: Vec<[f64; 3]>,
}

impl Forbes {
    /// A departure with these coefficients, mm.
    ///
    /// # Errors
    /// A radius that is not positive; more than [`MOST`] coefficients.
    pub fn new(kind: Kind, radius: f64, coefficients: Vec<f64>) -> Result<Self> {
        if !(radius.is_finite() && radius > 0.0) {
            return Err(Error::input(format!("normalisation radius {radius}"))
                .help("give the radius that the coefficients refer to, above 0"));
        }
        if coefficients.len() > MOST {
            return Err(Error::input(format!("{} coefficients", coefficients.len()))
                .help(format!("Forbes aspheres have up to {MOST}")));
        }
        let recurrence = match kind {
            Kind::Con => con_recurrence(coefficients.len()),
            Kind::Bfs => bfs_recurrence(coefficients.len()),
        };
        Ok(Self { kind, radius, coefficients, recurrence })
    }

    /// Sag that is added at s = r², and its derivative by s, to the conic of this curvature and
    /// conic constant.
    #[inline]
    #[must_use]
    pub fn departure(&self, s: f64, curvature: f64, conic: f64) -> (f64, f64) {
        let per = 1.0 / (self.radius * self.radius);
        let x = s * per;
        match self.kind {
            Kind::Con => {
                let (sum, slope) = self.con_sum(x);
                (x * x * sum, (2.0 * x * sum + x * x * slope) * per)
            }
            Kind::Bfs => {
                let (sum, slope) = self.bfs_sum(x);
                let c2 = curvature * curvature;
                let slant = 1.0 - conic * c2 * s;
                let phi = ((1.0 - (1.0 + conic) * c2 * s) / slant).sqrt();
                let bump = x * (1.0 - x);
                let by_x = (1.0 - 2.0 * x) * sum + bump * slope;
                let by_phi = 0.5 * bump * sum * c2 / (phi * phi * phi * slant * slant);
                (bump * sum / phi, by_x * per / phi + by_phi)
            }
        }
    }

    /// What it adds to the curvature at the vertex, 1/mm.
    #[must_use]
    pub fn vertex_curvature(&self) -> f64 {
        2.0 * self.departure(0.0, 0.0, 0.0).1
    }

    /// Σ aₘ Qₘ(x) of Q-con and its derivative.
    fn con_sum(&self, x: f64) -> (f64, f64) {
        let (mut before, mut here) = ([0.0; 2], [1.0, 0.0]);
        let mut sum = [0.0; 2];
        for (m, a) in self.coefficients.iter().enumerate() {
            if m > 0 {
                let [p, q, r] = self.recurrence[m - 1];
                let next = [
                    (p * x + q) * here[0] - r * before[0],
                    (p * x + q) * here[1] + p * here[0] - r * before[1],
                ];
                (before, here) = (here, next);
            }
            sum = [sum[0] + a * here[0], sum[1] + a * here[1]];
        }
        (sum[0], sum[1])
    }

    /// Σ aₘ Qₘ(x) of Q-bfs and its derivative.
    fn bfs_sum(&self, x: f64) -> (f64, f64) {
        // P₀ = 2, P₁ = 6 − 8x, Pₘ₊₁ = (2 − 4x)Pₘ − Pₘ₋₁; Qₘ = (Pₘ − gQₘ₋₁ − hQₘ₋₂)/f.
        let (mut p_before, mut p_here) = ([2.0, 0.0], [6.0 - 8.0 * x, -8.0]);
        let (mut before, mut here) = ([0.0; 2], [1.0, 0.0]);
        let mut sum = [0.0; 2];
        for (m, a) in self.coefficients.iter().enumerate() {
            if m > 0 {
                let [f, g, h] = self.recurrence[m - 1];
                let next = [0, 1].map(|k| (p_here[k] - g * here[k] - h * before[k]) / f);
                (before, here) = (here, next);
                let t = 2.0 - 4.0 * x;
                let p_next =
                    [t * p_here[0] - p_before[0], t * p_here[1] - 4.0 * p_here[0] - p_before[1]];
                (p_before, p_here) = (p_here, p_next);
            }
            sum = [sum[0] + a * here[0], sum[1] + a * here[1]];
        }
        (sum[0], sum[1])
    }
}

/// Qₘ = (p·x + q)Qₘ₋₁ − r·Qₘ₋₂ for m = 1, 2, ...: Jacobi polynomials with α = 0, β = 4.
fn con_recurrence(count: usize) -> Vec<[f64; 3]> {
    const BETA: f64 = 4.0;
    let of = |m: usize| {
        if m == 1 {
            return [6.0, -5.0, 0.0];
        }
        let n = m as f64;
        let scale = (2.0 * n + BETA - 1.0) / (2.0 * n * (n + BETA) * (2.0 * n + BETA - 2.0));
        let t = scale * (2.0 * n + BETA) * (2.0 * n + BETA - 2.0);
        let last = (n - 1.0) * (n + BETA - 1.0) * (2.0 * n + BETA)
            / (n * (n + BETA) * (2.0 * n + BETA - 2.0));
        // The argument is 2x − 1.
        [2.0 * t, -t - scale * BETA * BETA, last]
    };
    (1..count).map(of).collect()
}

/// [f, g, h] of Qₘ = (Pₘ − g·Qₘ₋₁ − h·Qₘ₋₂)/f for m = 1, 2, ...
fn bfs_recurrence(count: usize) -> Vec<[f64; 3]> {
    let mut all = Vec::with_capacity(count);
    let (mut f_before, mut f, mut g) = (2.0, 0.5 * 19.0_f64.sqrt(), -0.5);
    for m in 1..count {
        let mut h = 0.0;
        if m > 1 {
            let n = m as f64;
            h = -n * (n - 1.0) / (2.0 * f_before);
            g = -(1.0 + g * h) / f;
            let next = (n * (n + 1.0) + 3.0 - g * g - h * h).sqrt();
            (f_before, f) = (f, next);
        }
        all.push([f, g, h]);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sum with a single coefficient 1 at place `m`.
    fn polynomial(kind: Kind, m: usize, x: f64) -> f64 {
        let mut coefficients = vec![0.0; m + 1];
        coefficients[m] = 1.0;
        let forbes = Forbes::new(kind, 1.0, coefficients).unwrap();
        match kind {
            Kind::Con => forbes.con_sum(x).0,
            Kind::Bfs => forbes.bfs_sum(x).0,
        }
    }

    /// The polynomials as Forbes prints them (2007, tables 1 and 2).
    #[test]
    fn first_polynomials_are_those_of_the_paper() {
        for x in [0.0, 0.17, 0.5, 0.83, 1.0_f64] {
            let con = [
                1.0,
                -(5.0 - 6.0 * x),
                15.0 - 14.0 * x * (3.0 - 2.0 * x),
                -(35.0 - 12.0 * x * (14.0 - x * (21.0 - 10.0 * x))),
            ];
            let bfs = [
                1.0,
                (13.0 - 16.0 * x) / 19.0_f64.sqrt(),
                (2.0_f64 / 95.0).sqrt() * (29.0 - 4.0 * x * (25.0 - 19.0 * x)),
                (2.0_f64 / 2545.0).sqrt() * (207.0 - 4.0 * x * (315.0 - x * (577.0 - 320.0 * x))),
            ];
            for m in 0..4 {
                assert!((polynomial(Kind::Con, m, x) - con[m]).abs() < 1e-12, "con {m} at {x}");
                assert!((polynomial(Kind::Bfs, m, x) - bfs[m]).abs() < 1e-12, "bfs {m} at {x}");
            }
        }
    }

    /// The normal of a paraboloid of radius 1/c has the slope c·r, so that a departure d along it
    /// is one of d·√(1 + c²r²) along the axis; u²(1 − u²) is 3/16 where u² is 1/4.
    #[test]
    fn a_mild_departure_lies_along_the_normal_of_a_conic() {
        let forbes = Forbes::new(Kind::Bfs, 4.0, vec![0.02]).unwrap();
        let sag = forbes.departure(4.0, 0.5, -1.0).0;
        assert!((sag - 0.02 * 3.0 / 16.0 * 2.0_f64.sqrt()).abs() < 1e-16, "{sag}");
    }

    /// What defines them, up to an order at which powers of r have lost all digits: ∫ x⁴QₐQᵦ dx
    /// over [0, 1] is 1/(2a + 5) or 0 for Q-con; the mean over θ, with u = sin θ, of the product of
    /// two slopes d/du of u²(1 − u²)Q is 1 or 0 for Q-bfs.
    #[test]
    fn polynomials_are_orthogonal_to_order_twenty() {
        let n = 4000;
        let mean = |f: &dyn Fn(f64) -> f64| {
            (0..n).map(|i| f((i as f64 + 0.5) / n as f64)).sum::<f64>() / n as f64
        };
        for (a, b) in [(3, 3), (20, 20), (20, 19), (20, 4)] {
            let product =
                |x: f64| x.powi(4) * polynomial(Kind::Con, a, x) * polynomial(Kind::Con, b, x);
            let right = if a == b { 1.0 / (2.0 * a as f64 + 5.0) } else { 0.0 };
            let found = mean(&product);
            assert!((found - right).abs() < 2e-5, "con {a} {b}: {found} instead of {right}");
            let slope = |m: usize, u: f64| {
                let mut coefficients = vec![0.0; m + 1];
                coefficients[m] = 1.0;
                let forbes = Forbes::new(Kind::Bfs, 1.0, coefficients).unwrap();
                2.0 * u * forbes.departure(u * u, 0.0, 0.0).1
            };
            let mean_slopes = (0..200)
                .map(|i| {
                    let theta = (i as f64 + 0.5) / 200.0 * std::f64::consts::FRAC_PI_2;
                    let u = libm::sin(theta);
                    slope(a, u) * slope(b, u)
                })
                .sum::<f64>()
                / 200.0;
            let right = if a == b { 1.0 } else { 0.0 };
            assert!((mean_slopes - right).abs() < 1e-9, "bfs {a} {b}: {mean_slopes}");
        }
    }

    /// Derivatives agree with differences of the sag, on a sphere and on conics too.
    #[test]
    fn derivatives_are_those_of_the_sag() {
        for (kind, conic) in [(Kind::Con, 0.0), (Kind::Bfs, 0.0), (Kind::Bfs, -0.7)] {
            let forbes = Forbes::new(kind, 4.0, vec![0.02, -0.01, 0.005, 0.001, -2e-4]).unwrap();
            for s in [0.0, 1.0, 6.0, 15.0] {
                let at = |s: f64| forbes.departure(s, 0.12, conic);
                let (step, slope) = (1e-5, at(s).1);
                assert!(((at(s + step).0 - at(s - step).0) / (2.0 * step) - slope).abs() < 1e-9);
            }
        }
        assert!(Forbes::new(Kind::Con, 0.0, vec![1.0]).is_err());
        assert!(Forbes::new(Kind::Con, 1.0, vec![0.0; MOST + 1]).is_err());
    }
}
