//! A diffraction-limited lens given by its key parameters, in focus or out of focus.
//!
//! Source: Chen et al. 2009, eqs. 4-7; Hopkins 1955 (Proc. R. Soc. A 231, 91) for defocus.
//! Circular pupil without obscuration, incoherent light, scalar diffraction.

use super::engine::{Blur, Lens, Otf, OverField};
use super::interpolate::MonotoneCubic;
use camrig_base::Spectrum;
use std::f64::consts::{FRAC_PI_2, PI};

/// A lens without aberrations, of given f-number.
#[derive(Clone, Debug)]
pub struct Diffraction {
    /// f-number N: focal length over entrance-pupil diameter.
    pub f_number: f64,
    /// Focal length, mm.
    pub focal_length_mm: f64,
    /// |m|; 0 for an object at infinity.
    pub magnification: f64,
    /// Transmittance T(λ) of the lens.
    pub transmittance: Spectrum,
    /// Fall-off of illumination towards the corners.
    pub illumination: Illumination,
    /// Displacement of the sensor from the focus along the axis, µm; its sign has no effect.
    pub defocus_um: f64,
}

/// Relative illumination over the field.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Illumination {
    /// cos⁴ of the field angle atan(height / image distance).
    Cos4,
    /// No fall-off.
    Uniform,
    /// Ratio over real image height in mm.
    Table(MonotoneCubic),
}

impl Diffraction {
    /// Image-side f-number N(1+|m|): the cone that converges on the sensor (pupil magnification
    /// 1).
    #[must_use]
    pub fn working_f_number(&self) -> f64 {
        self.f_number * (1.0 + self.magnification)
    }

    /// Distance of the image plane from the rear principal plane, f(1+|m|), mm.
    #[must_use]
    pub fn image_distance_mm(&self) -> f64 {
        self.focal_length_mm * (1.0 + self.magnification)
    }

    /// Highest frequency that passes, 1/(λ·N(1+|m|)), cycles/mm (eq. 6 on the image side).
    #[must_use]
    pub fn cutoff_per_mm(&self, nm: f64) -> f64 {
        1e6 / (nm * self.working_f_number())
    }

    /// The optical transfer function at a frequency in cycles/mm: eqs. 4-5 in focus, Hopkins' with
    /// defocus. Real, since the pupil is symmetric.
    #[must_use]
    pub fn otf(&self, nm: f64, cycles_per_mm: f64) -> f64 {
        // W020 = δ/(8 Nw²), the wavefront error at the pupil's edge, in waves.
        let waves = self.defocus_um.abs() * 1e3 / (8.0 * self.working_f_number().powi(2) * nm);
        hopkins_otf(cycles_per_mm.abs() / self.cutoff_per_mm(nm), waves)
    }
}

/// The OTF of a circular pupil at x = f/fc with `waves` of defocus W020 at its edge.
///
/// Autocorrelation of the pupil e^(2πi·W020·ρ²): (4/π)∫ cos²θ·cos(8π·W020·x·(sin θ − x)) dθ from
/// asin x to π/2, which without defocus is eq. 5, (2/π)(acos x − x√(1−x²)).
#[must_use]
pub fn hopkins_otf(x: f64, waves: f64) -> f64 {
    if x >= 1.0 {
        return 0.0;
    }
    if waves == 0.0 {
        return 2.0 / PI * (libm::acos(x) - x * (1.0 - x * x).sqrt());
    }
    let rate = 8.0 * PI * waves * x;
    let (low, high) = (libm::asin(x), FRAC_PI_2);
    // Simpson's rule with at least 64 intervals; 16 per radian of phase keep its error below 1e-8.
    let intervals = 2 * (32 + (8.0 * rate * (1.0 - x)).ceil() as usize);
    let h = (high - low) / intervals as f64;
    let value = |i: usize| {
        let (s, c) = libm::sincos(low + h * i as f64);
        c * c * libm::cos(rate * (s - x))
    };
    let inner: f64 = (1..intervals).map(|i| if i % 2 == 1 { 4.0 } else { 2.0 } * value(i)).sum();
    4.0 / PI * h / 3.0 * (value(0) + inner + value(intervals))
}

/// Distance in λN beyond which the point-spread function is its tail: 0.6 % of the light, of
/// which the tail's closed form, over the mean of a ring of the Airy pattern, is 3/(8π²·32²) =
/// 4e-5 short. Beside the blur circle of defocus it is a choice, as there is no closed form: light
/// beyond it that is not the tail's is folded back.
const CENTRE_LAMBDA_N: f64 = 32.0;

impl Lens for Diffraction {
    fn steradians(&self, nm: f64) -> f64 {
        PI * self.transmittance.at(nm) / (1.0 + 4.0 * self.working_f_number().powi(2))
    }

    fn illumination(&self, _nm: f64) -> Option<OverField<'_, f64>> {
        let distance = self.image_distance_mm();
        match &self.illumination {
            Illumination::Uniform => None,
            Illumination::Cos4 => Some(OverField::Radial(Box::new(move |h| {
                1.0 / (1.0 + (h / distance).powi(2)).powi(2)
            }))),
            Illumination::Table(curve) => Some(OverField::Radial(Box::new(move |h| curve.at(h)))),
        }
    }

    fn ideal_place(&self, _nm: f64) -> Option<OverField<'_, (f64, f64)>> {
        None
    }

    fn principal_distance_mm(&self) -> f64 {
        self.image_distance_mm()
    }

    fn blur(&self, nm: f64) -> Blur<'_> {
        let lambda_n_um = 1e-3 * nm * self.working_f_number();
        // The geometric blur circle of defocus comes on top.
        let circle_um = self.defocus_um.abs() / (2.0 * self.working_f_number());
        Blur::Otf(Otf {
            cutoff_per_mm: self.cutoff_per_mm(nm),
            spread_um: CENTRE_LAMBDA_N * lambda_n_um + circle_um,
            // Whatever the defocus, the OTF of a circular pupil starts as 1 − (4/π)·λN·f.
            tail_um: 4.0 / PI * lambda_n_um,
            at: Box::new(move |f| self.otf(nm, f)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defocus_integral_without_defocus_is_equation_5() {
        for k in 0..100 {
            let x = f64::from(k) / 100.0;
            assert!((hopkins_otf(x, 1e-9) - hopkins_otf(x, 0.0)).abs() < 1e-7, "{x}");
        }
    }

    #[test]
    fn strong_defocus_tends_to_the_geometric_blur_circle() {
        // The OTF of a uniform disc of radius R is 2·J1(2πRf)/(2πRf), first zero at 2πRf = 3.8317.
        // With 10 waves the diffraction OTF has its first zero within 5 % of it (Hopkins 1955).
        let waves = 10.0;
        let zero = (1..10_000)
            .map(|k| f64::from(k) * 1e-5)
            .find(|&x| hopkins_otf(x, waves) < 0.0)
            .unwrap();
        // R = δ/(2N), δ = 8N²Wλ, f = x/(λN): 2πRf = 8πWx.
        let geometric = 3.8317 / (8.0 * PI * waves);
        assert!((zero / geometric - 1.0).abs() < 0.05, "{zero} against {geometric}");
    }
}
