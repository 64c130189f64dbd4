//! Departures of a lens from its description: aberrations and losses added to those of its model.
//!
//! [`Departed`] wraps a lens; `camrig-render` makes departures of the effects that a camera names.

use super::engine::over_field::scaled;
use super::engine::stations::Stations;
use super::engine::{Blur, Lens, OverField};
use camrig_base::Spectrum;

/// Departures of a lens from its description; none by default. Defocus is not among them: it
/// changes the wavefront, which each lens model treats on its own.
#[derive(Clone, Debug, PartialEq)]
pub struct Departures {
    /// Factor on the transmittance over wavelength.
    pub transmittance: Spectrum,
    /// Distortion on top of the lens's own.
    pub distortion: Distortion,
    /// Lateral colour: factor of the image's size at each wavelength.
    pub lateral_colour: Spectrum,
    /// Fraction of the light that is spread evenly over the frame.
    pub veiling_glare: f64,
    /// Where the optical axis meets the sensor, mm right of and below where it should.
    pub axis_mm: (f64, f64),
}

impl Default for Departures {
    fn default() -> Self {
        Self {
            transmittance: Spectrum::constant(1.0),
            distortion: Distortion::default(),
            lateral_colour: Spectrum::constant(1.0),
            veiling_glare: 0.0,
            axis_mm: (0.0, 0.0),
        }
    }
}

/// Radial distortion (Brown 1966): real height = h·(size + k1·r² + k2·r⁴), r = h / unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distortion {
    /// Size of the image near the axis, relative.
    pub size: f64,
    /// Change at r = 1, third order.
    pub k1: f64,
    /// Change at r = 1, fifth order.
    pub k2: f64,
    /// Height at which r is 1, mm.
    pub unit_mm: f64,
}

impl Default for Distortion {
    fn default() -> Self {
        Self { size: 1.0, k1: 0.0, k2: 0.0, unit_mm: 1.0 }
    }
}

impl Distortion {
    /// Least slope of real over undistorted height at which the mapping still counts as
    /// invertible: the inverse is then at most twenty times as steep as the image.
    const MIN_SLOPE: f64 = 0.05;
    /// Largest r that is examined: four times the height at which the coefficients are given,
    /// which no margin of a blur reaches.
    const LARGEST_R: f64 = 4.0;

    /// Whether it changes anything.
    fn is_none(&self) -> bool {
        self.size == 1.0 && self.k1 == 0.0 && self.k2 == 0.0
    }

    fn slope(&self, r: f64) -> f64 {
        let r2 = r * r;
        self.size + r2 * (3.0 * self.k1 + 5.0 * r2 * self.k2)
    }

    /// Real height over undistorted height, mm.
    #[must_use]
    pub fn real(&self, ideal_mm: f64) -> f64 {
        let r2 = (ideal_mm / self.unit_mm).powi(2);
        ideal_mm * (self.size + r2 * (self.k1 + r2 * self.k2))
    }

    /// Largest r, at most [`Self::LARGEST_R`], up to which the image does not fold.
    fn fold(&self) -> f64 {
        const STEPS: u32 = 400;
        let at = |i: u32| Self::LARGEST_R * f64::from(i) / f64::from(STEPS);
        (1..=STEPS)
            .find(|&i| self.slope(at(i)) < Self::MIN_SLOPE)
            .map_or(Self::LARGEST_R, |i| at(i - 1))
    }

    /// Undistorted height over real height, mm. Beyond the height at which the image would fold,
    /// it continues with the slope of the centre.
    pub fn inverse(&self) -> impl Fn(f64) -> f64 + Send + Sync + use<> {
        let this = *self;
        let fold_mm = this.fold() * this.unit_mm;
        let fold_real = this.real(fold_mm);
        move |real| {
            if real.abs() >= fold_real {
                return (fold_mm + (real.abs() - fold_real) / this.size).copysign(real);
            }
            // Newton's method from the undistorted height, kept inside the rising part. It doubles
            // the digits per step; fifty bound it where the slope is least.
            let mut ideal = (real / this.size).clamp(-fold_mm, fold_mm);
            for _ in 0..50 {
                let step = (this.real(ideal) - real) / this.slope(ideal / this.unit_mm);
                ideal = (ideal - step).clamp(-fold_mm, fold_mm);
                if step.abs() < 1e-14 * (this.unit_mm + ideal.abs()) {
                    break;
                }
            }
            ideal
        }
    }
}

/// A lens with departures.
pub struct Departed {
    /// The lens as described.
    pub lens: Box<dyn Lens>,
    /// Departures from it.
    pub departures: Departures,
}

impl Lens for Departed {
    fn steradians(&self, nm: f64) -> f64 {
        self.lens.steradians(nm) * self.departures.transmittance.at(nm)
    }

    fn illumination(&self, nm: f64) -> Option<OverField<'_, f64>> {
        self.lens.illumination(nm)
    }

    fn ideal_place(&self, nm: f64) -> Option<OverField<'_, (f64, f64)>> {
        let own = self.lens.ideal_place(nm);
        let (size, distortion) =
            (self.departures.lateral_colour.at(nm), self.departures.distortion);
        if size == 1.0 && distortion.is_none() {
            return own;
        }
        let inverse = distortion.inverse();
        let height = move |real: f64| inverse(real / size);
        Some(match own {
            None => OverField::Radial(Box::new(height)),
            Some(OverField::Radial(own)) => {
                OverField::Radial(Box::new(move |real| own(height(real))))
            }
            Some(OverField::Plane(own)) => OverField::Plane(Box::new(move |x, y| {
                let (x, y) = scaled(x, y, &height);
                own(x, y)
            })),
        })
    }

    fn principal_distance_mm(&self) -> f64 {
        self.lens.principal_distance_mm()
    }

    fn axis_mm(&self) -> (f64, f64) {
        let (own, more) = (self.lens.axis_mm(), self.departures.axis_mm);
        (own.0 + more.0, own.1 + more.1)
    }

    fn veiling_glare(&self) -> f64 {
        1.0 - (1.0 - self.lens.veiling_glare()) * (1.0 - self.departures.veiling_glare)
    }

    fn blur(&self, nm: f64) -> Blur<'_> {
        match self.lens.blur(nm) {
            Blur::Field { mut psfs, cutoff_per_mm } => {
                // PSFs stay with their field point, which the distortion moves.
                match &mut psfs.stations {
                    Stations::Heights(heights_mm) => {
                        for height in heights_mm {
                            *height = self.departures.distortion.real(*height);
                        }
                    }
                    Stations::Lattice(lattice) => {
                        let undistorted = self.departures.distortion.inverse();
                        let own = std::mem::replace(&mut lattice.ideal, Box::new(|x, y| (x, y)));
                        lattice.ideal = Box::new(move |x, y| {
                            let (x, y) = scaled(x, y, &undistorted);
                            own(x, y)
                        });
                    }
                }
                Blur::Field { psfs, cutoff_per_mm }
            }
            otf => otf,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distortion_is_inverted_and_goes_on_where_it_would_fold() {
        for (k1, k2) in [(-0.1, 0.02), (0.2, 0.0), (-0.02, -0.01), (0.0, 0.0)] {
            let distortion = Distortion { size: 1.03, k1, k2, unit_mm: 2.0 };
            let inverse = distortion.inverse();
            for k in 0..=24 {
                let h = f64::from(k) * 0.1;
                assert!((inverse(distortion.real(h)) - h).abs() < 1e-12, "{k1} {k2} {h}");
                assert!((inverse(-distortion.real(h)) + h).abs() < 1e-12, "{k1} {k2} {h}");
            }
        }
        // Barrel so strong that the image folds inside the frame: still rising, still finite.
        let inverse = Distortion { size: 1.0, k1: -0.3, k2: -0.1, unit_mm: 1.0 }.inverse();
        let places: Vec<f64> = (0..300).map(|k| inverse(f64::from(k) * 0.01)).collect();
        assert!(places.windows(2).all(|w| w[1] > w[0]) && places.iter().all(|p| p.is_finite()));
    }
}
