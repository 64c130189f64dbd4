//! Absolute light from relative spectra, and CIE 1931 colour.
//!
//! Luminance L_v = Km ∫ L(λ) V(λ) dλ with Km = 683 lm/W (CIE 018), taken as the sum over 360 to
//! 830 nm in steps of 1 nm, the spectrum linear between its samples. A perfect white diffuser
//! under an illuminance of E_v lx has the luminance L_v = E_v / π; its spectral radiance is scaled
//! to it.

use super::Illuminant;
use camrig_base::table::built_in;
use camrig_base::{Bands, Error, Result, Spectrum};
use std::sync::LazyLock;

/// Luminous efficacy of radiation at 555 nm, lm/W (CIE 018; 683.002 divided by V(555.016 nm)).
pub const KM: f64 = 683.0;

/// CIE 1931 colour-matching functions x̄, ȳ = V, z̄ in 1 nm steps from 360 nm.
static OBSERVER: LazyLock<[Vec<f64>; 3]> = LazyLock::new(|| {
    let table = built_in(include_str!("data/cie1931.csv"));
    [0, 1, 2].map(|i| table.curves[i].1.clone())
});

/// The light level of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum LightLevel {
    /// Illuminance on the scene, lx.
    Lux(f64),
    /// Luminance of a perfect white, cd/m².
    Luminance(f64),
}

impl LightLevel {
    /// Luminance of a perfect white, cd/m².
    pub fn white_luminance(self) -> f64 {
        match self {
            LightLevel::Lux(lux) => lux / std::f64::consts::PI,
            LightLevel::Luminance(luminance) => luminance,
        }
    }

    /// Luminance of a perfect white, cd/m².
    ///
    /// # Errors
    /// A negative or infinite level.
    pub fn checked(self) -> Result<f64> {
        let luminance = self.white_luminance();
        if luminance.is_finite() && luminance >= 0.0 {
            return Ok(luminance);
        }
        Err(Error::input(format!("a light level of {self:?}"))
            .help("give a number of lux or cd/m² that is not negative"))
    }
}

/// Planck's constant times the speed of light, J m (exact by the SI's definition of both).
pub const HC: f64 = 6.626_070_15e-34 * 299_792_458.0;

/// Energy of a photon of wavelength `nm` (nm), h c / λ, J.
pub fn photons_to_energy(nm: f64) -> f64 {
    HC / (nm * 1e-9)
}

/// First wavelength of the observer's table, nm; its step is 1 nm.
const OBSERVER_START_NM: f64 = 360.0;

/// CIE 1931 tristimulus values X, Y, Z: Σ S(λ) x̄(λ) · 1 nm and so on, without a factor. [`KM`]
/// times Y of a spectral radiance (W m⁻² sr⁻¹ nm⁻¹) is its luminance, cd/m².
pub fn xyz(spectrum: &Spectrum) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for i in 0..OBSERVER[0].len() {
        let value = spectrum.at(OBSERVER_START_NM + i as f64);
        for (sum, curve) in sums.iter_mut().zip(OBSERVER.iter()) {
            *sum += value * curve[i];
        }
    }
    sums
}

/// CIE 1931 chromaticity (x, y).
pub fn chromaticity(spectrum: &Spectrum) -> [f64; 2] {
    let [x, y, z] = xyz(spectrum);
    [x / (x + y + z), y / (x + y + z)]
}

/// The CIE 1931 colour-matching functions in 1 nm steps.
pub fn observer() -> [Spectrum; 3] {
    let nm = |i: usize| OBSERVER_START_NM + i as f64;
    let wavelengths: Vec<f64> = (0..OBSERVER[0].len()).map(nm).collect();
    [0, 1, 2].map(|i| {
        Spectrum::new(wavelengths.clone(), OBSERVER[i].clone())
            .expect("the observer's table rises")
    })
}

/// The colour-matching functions as means over bands, for spectra given in bands:
/// `X = Σ value[b] · observer[0][b] · step_nm`. The parts of the functions outside the bands are
/// left out.
pub fn observer_in_bands(bands: &Bands) -> [Vec<f64>; 3] {
    observer().map(|curve| curve.in_bands(bands))
}

/// Spectral radiance of a perfect white under an illuminant, W m⁻² sr⁻¹ nm⁻¹, one value per band.
///
/// # Errors
/// A negative or infinite level, an illuminant without power between 360 and 830 nm.
pub fn white_radiance(light: &Illuminant, level: LightLevel, bands: &Bands) -> Result<Vec<f64>> {
    let luminance = level.checked()?;
    let relative = KM * xyz(&light.power)[1];
    if relative <= 0.0 {
        return Err(Error::input(format!("illuminant {:?} has no visible light", light.name))
            .help("a level in lux or cd/m² needs power between 360 and 830 nm"));
    }
    let scale = luminance / relative;
    Ok(light.in_bands(bands).into_iter().map(|power| power * scale).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::table::SpectralTable;

    #[test]
    fn efficacy_of_radiation_of_known_spectra() {
        // Equal power: the sums of the 1 nm tables, CIE 15 (106.865, 106.857, 106.892).
        for (sum, table) in xyz(&Spectrum::constant(1.0)).iter().zip([106.865, 106.857, 106.892]) {
            assert!((sum - table).abs() < 1e-3, "{sum}, table {table}");
        }
    }

    #[test]
    fn lux_and_luminance_agree() {
        let light = Illuminant::parse("F11").unwrap();
        let lux = LightLevel::Lux(300.0);
        let luminance = LightLevel::Luminance(300.0 / std::f64::consts::PI);
        let bands = Bands::VISIBLE;
        assert_eq!(
            white_radiance(&light, lux, &bands).unwrap(),
            white_radiance(&light, luminance, &bands).unwrap()
        );
    }

    /// The luminance of the banded radiance is what was asked for, for lines as well. What the 31
    /// bands of 400 to 700 nm lack: V outside 395..705 nm, below 1e-3 for these lights; F11's
    /// lines fall where V changes by up to 2 % per nm, which a 10 nm band keeps to 1 %.
    #[test]
    fn bands_keep_the_luminance() {
        let bands = Bands::VISIBLE;
        let observer = observer_in_bands(&bands);
        for (name, tolerance) in [
            ("A", 2e-3),
            ("D65", 1e-3),
            ("E", 1e-3),
            ("F2", 4e-3),
            ("F11", 1e-2),
            ("LED-B1", 2e-3),
        ] {
            let light = Illuminant::parse(name).unwrap();
            let white = white_radiance(&light, LightLevel::Luminance(100.0), &bands).unwrap();
            let sum: f64 = white.iter().zip(&observer[1]).map(|(l, v)| l * v).sum();
            let luminance = KM * sum * bands.step_nm;
            assert!((luminance / 100.0 - 1.0).abs() < tolerance, "{name}: {luminance}");
        }
    }

    #[test]
    fn darkness_is_a_level_but_less_is_an_error() {
        let light = Illuminant::parse("D65").unwrap();
        let level = |lux| white_radiance(&light, LightLevel::Lux(lux), &Bands::VISIBLE);
        assert!(level(0.0).unwrap().iter().all(|&l| l == 0.0));
        assert!(level(-1.0).is_err() && level(f64::NAN).is_err());
    }

    /// ISETCam's figures for D65 at 100 cd/m² (100 V-weighted over 400:10:700 nm, ours over 1 nm
    /// steps of 360 to 830 nm: 2e-4), and the electrons of its sensor from them.
    #[test]
    fn agrees_with_isetcam() {
        let Some(golden) = camrig_testing::shared("golden/isetcam") else { return };
        let light = Illuminant::parse("D65").unwrap();
        let bands = Bands::VISIBLE;
        let white = white_radiance(&light, LightLevel::Luminance(100.0), &bands).unwrap();
        let columns = |file: &str| {
            SpectralTable::read(&golden.join(file)).unwrap().curves.into_iter().map(|(_, v)| v)
        };
        let scene: Vec<Vec<f64>> = columns("a_scene_and_oi_spectrum_100cdm2_f4.csv").collect();
        for (band, (ours, theirs)) in white.iter().zip(&scene[1]).enumerate() {
            assert!((ours / theirs - 1.0).abs() < 1e-3, "band {band}: {ours}, ISETCam {theirs}");
        }
        // Photons per joule at 1 nm: 1/(hc); irradiance factor, pixel area and time as in
        // a_sensor_means.json.
        let photons = 1e-9 / HC;
        let factor = 0.048_015_433_515_941_4 * 2.2e-6 * 2.2e-6 * 0.8 * 0.01;
        let electrons = |qe: &dyn Fn(usize) -> f64| -> f64 {
            let sum: f64 = (0..31).map(|b| white[b] * bands.nm(b) * qe(b)).sum();
            sum * 10.0 * photons * factor
        };
        let qe: Vec<Vec<f64>> = columns("a_bayer_qe_inputs.csv").collect();
        let results = [
            (electrons(&|_| 0.6), 1242.199),
            (electrons(&|b| qe[0][b]), 436.175),
            (electrons(&|b| qe[1][b]), 435.267),
            (electrons(&|b| qe[2][b]), 366.357),
        ];
        for (ours, theirs) in results {
            assert!((ours / theirs - 1.0).abs() < 1e-3, "{ours} e-, ISETCam {theirs}");
        }
    }
}
