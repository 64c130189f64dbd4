//! A scene in its light: from what a person names to radiance in the scene's bands.
//!
//! A scene of reflectances takes an illuminant and a level; a scene of radiance holds its own
//! light and takes neither. Whoever renders a scene opens it here, so that no program records a
//! light that was not applied.

use super::About;
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_exposure::IrradianceCube;
use camrig_optics::{Options, Report};
use camrig_scene::{self as scene, Illuminant, LightLevel, LitScene, Quantity, Scene, photometry};
use std::f64::consts::PI;

/// Illuminant of a scene of reflectances where none is asked for: the daylight of ISO 12233 and of
/// Chen et al. 2009.
pub const DEFAULT_ILLUMINANT: &str = "D65";

/// Scene illuminance where none is asked for, lx: the brighter of the two levels of Chen et al.
/// 2009.
pub const DEFAULT_LUX: f64 = 300.0;

/// The light asked for on a scene of reflectances. The default asks for none, which is
/// [`DEFAULT_ILLUMINANT`] at [`DEFAULT_LUX`] there, and the scene's own light where it holds
/// radiance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SceneLight<'a> {
    /// Name of a built-in illuminant, or a CSV file.
    pub illuminant: Option<&'a str>,
    /// How much of it.
    pub level: Option<LightLevel>,
}

impl<'a> SceneLight<'a> {
    /// An illuminant of so many lux.
    pub fn lux(illuminant: &'a str, lux: f64) -> Self {
        Self { illuminant: Some(illuminant), level: Some(LightLevel::Lux(lux)) }
    }
}

/// A scene opened for a frame, in its light.
pub struct SceneInLight {
    /// The scene, enlarged to fill the frame.
    pub scene: Box<dyn Scene>,
    /// The illuminant of a scene of reflectances.
    pub illuminant: Option<Illuminant>,
    /// Its illuminance, lx.
    pub lux: Option<f64>,
    /// What the scene's values are multiplied by in each band: radiance of a perfect white,
    /// W m⁻² sr⁻¹ nm⁻¹; 1 for a scene of radiance.
    pub white: Vec<f64>,
    spec: String,
}

impl SceneInLight {
    /// Opens what `spec` names for a frame of that aspect (width over height), in the light asked
    /// for.
    ///
    /// # Errors
    /// A scene or illuminant that cannot be read; light asked for on a scene that holds radiance.
    pub fn open(spec: &str, frame_aspect: f64, light: &SceneLight<'_>) -> Result<Self> {
        Self::new(scene::open_filling(spec, frame_aspect)?, spec, light)
    }

    /// An opened scene, called `spec`, in the light asked for.
    ///
    /// # Errors
    /// An illuminant that cannot be read; light asked for on a scene that holds radiance.
    pub fn new(scene: Box<dyn Scene>, spec: &str, light: &SceneLight<'_>) -> Result<Self> {
        let bands = scene.bands();
        let spec = spec.to_owned();
        if scene.quantity() == Quantity::Radiance {
            refuse_light(&spec, light)?;
            return Ok(Self {
                scene,
                illuminant: None,
                lux: None,
                white: vec![1.0; bands.count],
                spec,
            });
        }
        let illuminant = Illuminant::parse(light.illuminant.unwrap_or(DEFAULT_ILLUMINANT))?;
        let level = light.level.unwrap_or(LightLevel::Lux(DEFAULT_LUX));
        let white = photometry::white_radiance(&illuminant, level, &bands)?;
        // A perfect diffuser of L cd/m² is lit by π L lux.
        let lux = level.white_luminance() * PI;
        Ok(Self { scene, illuminant: Some(illuminant), lux: Some(lux), white, spec })
    }

    /// The scene as the optics engine takes it.
    pub fn lit(&self) -> LitScene<'_> {
        LitScene { scene: &*self.scene, white: self.white.clone() }
    }

    /// What the header of a cube of it says, seen by `camera`.
    pub fn about(&self, camera: &Camera) -> About {
        About {
            lux: self.lux,
            illuminant: self.illuminant.as_ref().map(|light| light.name.clone()),
            made_of: format!("scene {}, lens of {}", self.spec, camera.name),
        }
    }
}

fn refuse_light(spec: &str, light: &SceneLight<'_>) -> Result<()> {
    let asked_for = match light {
        SceneLight { level: Some(_), .. } => "a light level",
        SceneLight { illuminant: Some(_), .. } => "an illuminant",
        SceneLight { illuminant: None, level: None } => return Ok(()),
    };
    Err(Error::input(format!("{asked_for} for {spec:?}")).help(
        "this scene holds radiance, light included; leave illuminant, lux and luminance out",
    ))
}

/// Width over height of a camera's frames.
pub(crate) fn frame_aspect(camera: &Camera) -> f64 {
    f64::from(camera.sensor.width) / f64::from(camera.sensor.height)
}

/// What falls on the sensor of `camera` when it looks at the scene that `spec` names: spectral
/// irradiance per band and pixel, W m⁻² nm⁻¹, and the figures of the optics stage.
///
/// Unlike [`super::OpticsStage`] it keeps no results on disk, and the cube's samples hold the
/// light level themselves (its header's level is 1).
///
/// ```
/// use camrig_camera::Camera;
/// use camrig_optics::Options;
/// use camrig_render::{SceneLight, SimulatedSensor, scene_irradiance};
///
/// let mut camera = Camera::load("mt9v024")?;
/// (camera.sensor.width, camera.sensor.height) = (32, 24);
/// let light = SceneLight::lux("D65", 300.0);
/// let (cube, _) =
///     scene_irradiance(&camera, "colorchecker", &light, &Options::default(), |_, _| ())?;
/// let sensor = SimulatedSensor::new(&camera, &cube.header, 1.0)?;
/// let settings = camera.settings(0, 10e-3, None);
/// let frame = sensor.frame(&cube, None, &settings, Default::default())?;
/// assert_eq!((frame.width, frame.height), (32, 24));
/// # Ok::<(), camrig_base::Error>(())
/// ```
///
/// # Errors
/// Those of [`SceneInLight::open`], and a lens that cannot be read or traced.
pub fn scene_irradiance(
    camera: &Camera,
    spec: &str,
    light: &SceneLight<'_>,
    options: &Options,
    progress: impl FnMut(usize, usize),
) -> Result<(IrradianceCube, Report)> {
    let opened = SceneInLight::open(spec, frame_aspect(camera), light)?;
    super::irradiance(camera, &opened.lit(), options, opened.about(camera), progress)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn radiance_scene() -> (tempfile::TempDir, String) {
        let folder = tempfile::tempdir().unwrap();
        let mut bytes = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
        let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 2, 3), }";
        bytes.extend(format!("{header:<117}\n").bytes());
        bytes.extend([0.01f32; 12].iter().flat_map(|v| v.to_le_bytes()));
        std::fs::write(folder.path().join("street.npy"), bytes).unwrap();
        let spec = format!(
            "{}:quantity=radiance,start_nm=500,step_nm=50",
            folder.path().join("street.npy").display()
        );
        (folder, spec)
    }

    #[test]
    fn a_scene_of_radiance_is_opened_without_light_and_refused_with_any() {
        let (_folder, spec) = radiance_scene();
        let opened = SceneInLight::open(&spec, 4.0 / 3.0, &SceneLight::default()).unwrap();
        assert!(opened.illuminant.is_none() && opened.lux.is_none());
        assert!(opened.white.iter().all(|&factor| factor == 1.0), "{:?}", opened.white);
        let said = |light: SceneLight<'_>| match SceneInLight::open(&spec, 4.0 / 3.0, &light) {
            Ok(_) => panic!("{light:?} must be refused"),
            Err(error) => error.to_string(),
        };
        let level = Some(LightLevel::Luminance(80.0));
        let alone = said(SceneLight { illuminant: None, level });
        assert!(alone.contains("a light level") && alone.contains("holds radiance"), "{alone}");
        let named = said(SceneLight { illuminant: Some("A"), level: None });
        assert!(named.contains("an illuminant") && named.contains("holds radiance"), "{named}");
        assert!(said(SceneLight::lux("A", 20.0)).contains("a light level"));
    }

    #[test]
    fn a_scene_of_reflectances_has_the_default_light_unless_told_otherwise() {
        let open = |light| SceneInLight::open("uniform:0.18", 1.0, &light).unwrap();
        let default = open(SceneLight::default());
        assert_eq!(default.white, open(SceneLight::lux("D65", 300.0)).white);
        assert_eq!(default.lux, Some(300.0));
        let level = Some(LightLevel::Luminance(100.0));
        let of_luminance = open(SceneLight { illuminant: Some("A"), level });
        assert_eq!(of_luminance.illuminant.as_ref().unwrap().name, "A");
        assert!((of_luminance.lux.unwrap() - 314.159_265).abs() < 1e-6);
    }
}
