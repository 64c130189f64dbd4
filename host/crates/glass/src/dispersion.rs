//! Dispersion formulas.

use crate::conrady;

/// Dispersion formulas; λ in µm.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Dispersion {
    /// The same index at all wavelengths.
    Constant(f64),
    /// n² = 1 + offset + Σ B·λ²/(λ² − C) + Σ D/(λ² − E) + square·λ²: Sellmeier 1, 3, 4 and 5,
    /// with `poles` Sellmeier 2, with `square` those of the Handbook of Optics.
    Sellmeier {
        /// Constant part above 1.
        offset: f64,
        /// Pairs B, C (µm²).
        terms: Vec<[f64; 2]>,
        /// Pairs D (µm²), E (µm²).
        poles: Vec<[f64; 2]>,
        /// Coefficient of λ², µm⁻².
        square: f64,
    },
    /// Σ a·λ^p of n² (Schott, extended 1 to 3) or of n (Cauchy, Conrady).
    PowerSeries {
        /// Whether the sum is n² rather than n.
        squared: bool,
        /// Pairs a, p.
        terms: Vec<[f64; 2]>,
    },
    /// Indices at wavelengths (nm, strictly rising): between them a cubic through the four nearest
    /// in 1/λ², which is exact for n = A + B/λ² + C/λ⁴ + D/λ⁶.
    Table(Vec<[f64; 2]>),
    /// n = n₀ + A/λ + B/λ^3.5 (Conrady) through n_d, V_d and P_gF = 0.6438 − 0.001682·V_d + ΔP_gF.
    /// A real glass differs by some 1e-4 at 420 nm and 3e-4 at 1000 nm (medians).
    Model {
        /// Index at 587.5618 nm.
        nd: f64,
        /// Abbe number at the d, F and C lines.
        vd: f64,
        /// ΔP_gF, how far P_gF lies above the normal line.
        dpgf: f64,
    },
    /// Herzberger: n = A + B·L + C·L² + D·λ² + E·λ⁴ + F·λ⁶ with L = 1/(λ² − 0.028).
    Herzberger([f64; 6]),
    /// Buchdahl: n = c₀ + c₁·ω + c₂·ω² with ω = (λ − λ₀)/(1 + 2.5·(λ − λ₀)), λ₀ = 0.574 µm
    /// (Robb and Mercado, Appl. Opt. 22, 1198 (1983)).
    Buchdahl([f64; 3]),
    /// Another glass with its n_d and V_d moved: n_d + shift + factor·(n − n_d).
    Moved {
        /// The glass.
        of: Box<Dispersion>,
        /// Its n_d.
        nd: f64,
        /// What is added to n_d.
        shift: f64,
        /// Dispersion over that of the glass.
        factor: f64,
    },
}

/// Powers of λ in Schott's formula.
const SCHOTT: [f64; 6] = [0.0, 2.0, -2.0, -4.0, -6.0, -8.0];

impl Dispersion {
    /// Schott's formula of 1967, the Laurent series of CODE V: n² = Σ a·λ^p with p = 0, 2, -2,
    /// -4, -6 and -8.
    #[must_use]
    pub fn schott(coefficients: [f64; 6]) -> Self {
        let terms = std::array::from_fn::<_, 6, _>(|i| [coefficients[i], SCHOTT[i]]);
        Self::PowerSeries { squared: true, terms: terms.to_vec() }
    }

    /// The index at a wavelength, µm; not a number where the formula has none.
    pub(super) fn index(&self, um: f64) -> f64 {
        let l2 = um * um;
        match self {
            Self::Constant(n) => *n,
            Self::Sellmeier { offset, terms, poles, square } => {
                let sum: f64 = terms.iter().map(|[b, c]| b * l2 / (l2 - c)).sum();
                let rest: f64 = poles.iter().map(|[d, e]| d / (l2 - e)).sum();
                (1.0 + offset + sum + rest + square * l2).sqrt()
            }
            Self::PowerSeries { squared, terms } => {
                let sum: f64 = terms.iter().map(|[a, p]| a * libm::pow(um, *p)).sum();
                if *squared { sum.sqrt() } else { sum }
            }
            Self::Table(rows) => cubic(rows, um * 1e3),
            Self::Model { nd, vd, dpgf } => conrady::index(*nd, *vd, *dpgf, um),
            Self::Herzberger([a, b, c, d, e, f]) => {
                let l = 1.0 / (l2 - 0.028);
                a + b * l + c * l * l + l2 * (d + l2 * (e + l2 * f))
            }
            Self::Buchdahl([c0, c1, c2]) => {
                let away = um - 0.574;
                let omega = away / (1.0 + 2.5 * away);
                c0 + omega * (c1 + omega * c2)
            }
            Self::Moved { of, nd, shift, factor } => nd + shift + factor * (of.index(um) - nd),
        }
    }
}

/// Lagrange interpolation in 1/λ² through the (up to) four rows nearest to `nm`.
fn cubic(rows: &[[f64; 2]], nm: f64) -> f64 {
    let points = rows.len().min(4);
    let after = rows.partition_point(|r| r[0] <= nm);
    let start = after.saturating_sub(points / 2).min(rows.len() - points);
    let near = &rows[start..start + points];
    let x = |nm: f64| 1.0 / (nm * nm);
    let weight = |i: usize| {
        let others = near.iter().enumerate().filter(|(j, _)| *j != i);
        others.map(|(_, r)| (x(nm) - x(r[0])) / (x(near[i][0]) - x(r[0]))).product::<f64>()
    };
    near.iter().enumerate().map(|(i, r)| weight(i) * r[1]).sum()
}
