//! A few curves of which the spectra of pictures are mixtures, chosen for a sensor.
//!
//! The curves are orthonormal. First come those that span what the channels see of each band: so a
//! channel sees of a mixture, its weights the least squares, exactly what it sees of the spectrum,
//! and even areas are what they are. Then, of the spectra of a lattice of colours, the one of which
//! most is left out, time after time. The lattice, and so the basis, does not depend on the
//! picture: kernels that were collapsed for one frame of a sequence serve all.
//!
//! What is left out of a spectrum sums to nothing in every channel; a blur that differs between
//! bands brings out at most half its absolute sum, and at an edge between two spectra at most the
//! sum of both halves.

use super::channel_planes::over_white;
use super::gamut::reach;
use super::lattice::{SIDE, node};
use super::smoothest::{Curve, Domain, Smoothest, dot};
use camrig_base::Result;
use rayon::prelude::*;

/// Nodes of the lattice of spectra from one sample to the next.
const STEP: usize = 6;
/// Part of a curve's length below which it lies in the span of those before, but for rounding.
const DEPENDENT: f64 = 1e-9;
/// Part of white below which nothing more is left out.
const ENOUGH: f64 = 1e-6;

/// Curves for the spectra of pictures seen by a sensor.
pub struct Basis {
    /// The curves, by band.
    pub curves: Vec<Vec<f64>>,
    /// What each channel sees of each band, over what it sees of white.
    seen: Vec<Vec<f64>>,
}

impl Basis {
    /// About `count` curves for the spectra of a domain, in the unit that makes white `units`;
    /// `seen` is per channel what it sees of a value of 1 in each band. All that channels see is
    /// kept, if it takes more curves.
    ///
    /// # Errors
    /// None in practice: the tables are built in.
    pub fn of(domain: Domain, units: &Curve, seen: &[Vec<f64>], count: usize) -> Result<Self> {
        Ok(Self::of_samples(&samples(domain, units)?, units, seen, count))
    }

    /// The same for these spectra in place of those of a domain.
    pub fn of_samples(
        samples: &[Vec<f64>],
        units: &[f64],
        seen: &[Vec<f64>],
        count: usize,
    ) -> Self {
        let seen = seen.iter().filter_map(|channel| over_white(channel, units)).collect();
        let mut basis = Self { curves: Vec::new(), seen };
        for channel in basis.seen.clone() {
            basis.add(&channel);
        }
        while basis.curves.len() < count.min(units.len()) {
            let left: Vec<f64> = samples.par_iter().map(|s| basis.mix(s).1).collect();
            let most = (0..left.len()).max_by(|&a, &b| left[a].total_cmp(&left[b]));
            let Some(most) = most.filter(|&most| left[most] > ENOUGH) else { break };
            if !basis.add(&samples[most]) {
                break;
            }
        }
        basis
    }

    /// Adds what is new of a curve; false where nothing is.
    fn add(&mut self, curve: &[f64]) -> bool {
        let length = |c: &[f64]| dot(c, c).sqrt();
        // Twice: the first pass leaves rounding of the size of what it takes off.
        let rest = self.rest(&self.rest(curve));
        let new = length(&rest);
        if new <= DEPENDENT * length(curve) {
            return false;
        }
        self.curves.push(rest.into_iter().map(|v| v / new).collect());
        true
    }

    /// What no curve has of a spectrum.
    fn rest(&self, spectrum: &[f64]) -> Vec<f64> {
        let mut rest = spectrum.to_vec();
        for curve in &self.curves {
            let weight = dot(curve, &rest);
            rest.iter_mut().zip(curve).for_each(|(r, c)| *r -= weight * c);
        }
        rest
    }

    /// The weights of the curves in a spectrum, and the most that they leave out of it at an edge,
    /// as a part of what a channel sees of white.
    pub fn mix(&self, spectrum: &[f64]) -> (Vec<f64>, f64) {
        let weights = self.curves.iter().map(|curve| dot(curve, spectrum)).collect();
        let rest = self.rest(spectrum);
        let seen = |channel: &Vec<f64>| -> f64 {
            channel.iter().zip(&rest).map(|(seen, r)| (seen * r).abs()).sum()
        };
        (weights, self.seen.iter().map(seen).fold(0.0, f64::max))
    }
}

/// Spectra over the colours of the domain.
fn samples(domain: Domain, units: &Curve) -> Result<Vec<Vec<f64>>> {
    let smoothest = Smoothest::new(domain)?;
    let side = (SIDE - 1) / STEP + 1;
    let colours: Vec<[usize; 3]> = (0..side * side * side)
        .map(|n| [n % side, n / side % side, n / (side * side)])
        .filter(|steps| domain == Domain::Reflectance || steps.contains(&(side - 1)))
        .collect();
    let spectrum = |steps: &[usize; 3]| -> Vec<f64> {
        let values = reach(&smoothest, domain, steps.map(|step| node(step * STEP))).values;
        values.iter().zip(units).map(|(value, unit)| value * unit).collect()
    };
    Ok(colours.par_iter().map(spectrum).collect())
}

#[cfg(test)]
mod tests {
    use super::super::smoothest::COUNT;
    use super::*;

    /// Three bell curves.
    fn seen() -> Vec<Vec<f64>> {
        let bell = |centre: f64| (0..COUNT).map(move |b| -((b as f64 - centre) / 4.0).powi(2));
        [20.0, 14.0, 6.0].map(|centre| bell(centre).map(f64::exp).collect()).to_vec()
    }

    #[test]
    fn even_areas_are_kept_and_more_curves_leave_less_out() {
        let samples = samples(Domain::Reflectance, &[1.0; COUNT]).unwrap();
        let mut before = f64::MAX;
        for count in [3, 6, 12, 20] {
            let basis = Basis::of(Domain::Reflectance, &[1.0; COUNT], &seen(), count).unwrap();
            assert_eq!(basis.curves.len(), count);
            let mut most = 0.0f64;
            for spectrum in &samples {
                let (weights, left) = basis.mix(spectrum);
                let mixed = |b| weights.iter().zip(&basis.curves).map(|(w, c)| w * c[b]).sum();
                let mixture: Vec<f64> = (0..COUNT).map(mixed).collect();
                for channel in &basis.seen {
                    assert!((dot(channel, &mixture) - dot(channel, spectrum)).abs() < 1e-12);
                }
                most = most.max(left);
            }
            println!("{count} curves leave out {most:.1e} of white at most");
            assert!(most < before);
            before = most;
        }
        assert!(before < 1e-2, "{before}");
    }

    #[test]
    fn curves_are_orthonormal_and_channels_that_see_the_same_count_once() {
        let twice = [seen(), seen()].concat();
        let basis = Basis::of(Domain::Emission, &[2.0; COUNT], &twice, 10).unwrap();
        for (i, a) in basis.curves.iter().enumerate() {
            for (j, b) in basis.curves.iter().enumerate() {
                let expected = f64::from(u8::from(i == j));
                assert!((dot(a, b) - expected).abs() < 1e-12);
            }
        }
        let least = Basis::of(Domain::Emission, &[2.0; COUNT], &twice, 1).unwrap();
        assert_eq!(least.curves.len(), 3);
    }
}
