//! Absolute light from relative spectra, and CIE 1931 colour.
//!
//! Luminance L_v = Km ∫ L(λ) V(λ) dλ over 360 to 830 nm with Km = 683 lm/W (CIE 018), exact for
//! spectra that are linear between their samples and V between those of its table of 1 nm, however
//! narrow a line is. A perfect white diffuser under an illuminance of E_v lx has the luminance L_v
//! = E_v / π; its spectral radiance is scaled to it.

use super::Illuminant;
use camrig_base::table::built_in;
use camrig_base::{Bands, Error, Result, Spectrum, integral_of_product};
use std::sync::LazyLock;

/// Luminous efficacy of radiation at 555 nm, lm/W (CIE 018; 683.002 divided by V(555.016 nm)).
pub const KM: f64 = 683.0;

/// CIE 1931 colour-matching functions x̄, ȳ = V, z̄ in 1 nm steps over [`OBSERVER_NM`].
static OBSERVER: LazyLock<[Spectrum; 3]> = LazyLock::new(|| {
    let table = built_in(include_str!("data/cie1931.csv"));
    let nm: Vec<f64> = (0..table.curves[0].1.len()).map(|i| OBSERVER_NM[0] + i as f64).collect();
    [0, 1, 2].map(|i| {
        Spectrum::new(nm.clone(), table.curves[i].1.clone()).expect("the observer's table rises")
    })
});

/// First and last wavelength of the observer's table, nm.
const OBSERVER_NM: [f64; 2] = [360.0, 830.0];

/// The light level of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum LightLevel {
    /// Illuminance on the scene, lx.
    Lux(f64),
    /// Luminance of a perfect white, cd/m².
    Luminance(f64),
    /// Irradiance on the scene from 300 to 1100 nm, W/m²: of lamps that the eye does not see.
    Irradiance(f64),
}

/// Wavelengths of [`LightLevel::Irradiance`], nm: those at which silicon sees.
const IRRADIANCE_NM: [f64; 2] = [300.0, 1100.0];

impl LightLevel {
    /// Luminance of a perfect white, cd/m².
    ///
    /// # Errors
    /// A negative or infinite level; an irradiance, whose luminance depends on the light.
    pub fn checked(self) -> Result<f64> {
        match self.finite()? {
            LightLevel::Lux(lux) => Ok(lux / std::f64::consts::PI),
            LightLevel::Luminance(luminance) => Ok(luminance),
            LightLevel::Irradiance(_) => Err(Error::input(format!("a light level of {self:?}"))
                .help("give lux or cd/m²: it is not known in which light")),
        }
    }

    fn finite(self) -> Result<Self> {
        let (LightLevel::Lux(level)
        | LightLevel::Luminance(level)
        | LightLevel::Irradiance(level)) = self;
        if level.is_finite() && level >= 0.0 {
            return Ok(self);
        }
        Err(Error::input(format!("a light level of {self:?}"))
            .help("give a number of lux, cd/m² or W/m² that is not negative"))
    }
}

/// Planck's constant times the speed of light, J m (exact by the SI's definition of both).
pub const HC: f64 = 6.626_070_15e-34 * 299_792_458.0;

/// Energy of a photon of wavelength `nm` (nm), h c / λ, J.
pub fn photons_to_energy(nm: f64) -> f64 {
    HC / (nm * 1e-9)
}

/// CIE 1931 tristimulus values X, Y, Z: ∫ S(λ) x̄(λ) dλ and so on, without a factor. [`KM`] times
/// Y of a spectral radiance (W m⁻² sr⁻¹ nm⁻¹) is its luminance, cd/m².
pub fn xyz(spectrum: &Spectrum) -> [f64; 3] {
    let [from_nm, to_nm] = OBSERVER_NM;
    OBSERVER.each_ref().map(|curve| integral_of_product(&[spectrum, curve], from_nm, to_nm))
}

/// CIE 1931 chromaticity (x, y).
pub fn chromaticity(spectrum: &Spectrum) -> [f64; 2] {
    let [x, y, z] = xyz(spectrum);
    [x / (x + y + z), y / (x + y + z)]
}

/// The CIE 1931 colour-matching functions in 1 nm steps.
pub fn observer() -> [Spectrum; 3] {
    OBSERVER.clone()
}

/// The colour-matching functions as means over bands, for spectra given in bands:
/// `X = Σ value[b] · observer[0][b] · step_nm`. The parts of the functions outside the bands are
/// left out.
pub fn observer_in_bands(bands: &Bands) -> [Vec<f64>; 3] {
    OBSERVER.each_ref().map(|curve| curve.in_bands(bands))
}

/// Spectral radiance of a perfect white under an illuminant, W m⁻² sr⁻¹ nm⁻¹, one value per band.
///
/// # Errors
/// A negative or infinite level, an illuminant without power between 360 and 830 nm.
pub fn white_radiance(light: &Illuminant, level: LightLevel, bands: &Bands) -> Result<Vec<f64>> {
    let scale = white_scale(light, level)?;
    Ok(light.in_bands(bands).into_iter().map(|power| power * scale).collect())
}

/// Spectral radiance of a perfect white over the relative power of its illuminant: what makes the
/// power W m⁻² sr⁻¹ nm⁻¹.
///
/// # Errors
/// Those of [`white_radiance`].
pub fn white_scale(light: &Illuminant, level: LightLevel) -> Result<f64> {
    if let LightLevel::Irradiance(irradiance) = level.finite()? {
        let [from_nm, to_nm] = IRRADIANCE_NM;
        let relative = light.power.mean(from_nm, to_nm) * (to_nm - from_nm);
        return Ok(irradiance / std::f64::consts::PI / relative);
    }
    let luminance = level.checked()?;
    let relative = KM * xyz(&light.power)[1];
    if relative <= 0.0 {
        return Err(Error::input(format!("illuminant {:?} has no visible light", light.name))
            .help(
                "a level in lux or cd/m² needs power between 360 and 830 nm; of other light, give \
                 the irradiance on the scene, W/m²",
            ));
    }
    Ok(luminance / relative)
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

    /// A line of a tenth of a nanometre between two samples of V: power times Km V(λ).
    #[test]
    fn a_line_narrower_than_the_table_s_step_has_its_luminance() {
        let v = &observer()[1];
        for nm in [450.3, 532.06, 632.816] {
            let line = Spectrum::new(vec![nm - 0.1, nm, nm + 0.1], vec![0.0, 30.0, 0.0]).unwrap();
            let luminance = KM * xyz(&line)[1];
            assert!((luminance / (KM * 3.0 * v.at(nm)) - 1.0).abs() < 1e-6, "{nm}: {luminance}");
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

    /// 2 W/m² of light of equal power over 800 nm, seen by a white: 2 / (800 π) W m⁻² sr⁻¹ nm⁻¹.
    #[test]
    fn light_that_the_eye_does_not_see_has_an_irradiance() {
        let even = Illuminant::parse("E").unwrap();
        let bands = Bands { start_nm: 850.0, step_nm: 10.0, count: 1 };
        let white = white_radiance(&even, LightLevel::Irradiance(2.0), &bands).unwrap()[0];
        assert!((white * 400.0 * std::f64::consts::PI - 1.0).abs() < 1e-12, "{white}");
        let power = Spectrum::new(vec![835.0, 850.0, 865.0], vec![0.0, 1.0, 0.0]).unwrap();
        let lamp = Illuminant { name: "lamp".into(), power };
        // All of its 15 nm of relative power in one band.
        let bands = Bands { step_nm: 30.0, ..bands };
        let white = white_radiance(&lamp, LightLevel::Irradiance(1.0), &bands).unwrap()[0];
        assert!((white * 30.0 * std::f64::consts::PI - 1.0).abs() < 1e-12, "{white}");
        let said = white_radiance(&lamp, LightLevel::Lux(1.0), &bands).unwrap_err().to_string();
        assert!(said.contains("no visible light") && said.contains("W/m²"), "{said}");
    }

    #[test]
    fn darkness_is_a_level_but_less_is_an_error() {
        let light = Illuminant::parse("D65").unwrap();
        let level = |lux| white_radiance(&light, LightLevel::Lux(lux), &Bands::VISIBLE);
        assert!(level(0.0).unwrap().iter().all(|&l| l == 0.0));
        assert!(level(-1.0).is_err() && level(f64::NAN).is_err());
    }

    /// ISETCam's figures for D65 at 100 cd/m², at the centres of its bands (100 V-weighted over
    /// 400:10:700 nm, ours over 1 nm steps of 360 to 830 nm: 2e-4), and the electrons of its sensor from them.
    #[test]
    fn agrees_with_isetcam() {
        let Some(golden) = camrig_testing::shared("golden/isetcam") else { return };
        let light = Illuminant::parse("D65").unwrap();
        let bands = Bands::VISIBLE;
        let at = |nm| {
            let line = Bands { start_nm: nm, step_nm: 1e-3, count: 1 };
            white_radiance(&light, LightLevel::Luminance(100.0), &line).unwrap()[0]
        };
        let white: Vec<f64> = bands.centres().map(at).collect();
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
