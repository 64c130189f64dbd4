//! A scene in its light: from what a person names to radiance in the scene's bands.
//!
//! A scene of reflectances takes an illuminant and a level. A scene of radiance holds its own
//! light: a level scales it as a whole ([`radiance_at`]), an illuminant is refused. Whoever
//! renders a scene opens it here, so that no program records a light that was not applied.

use super::About;
use super::reach::Sight;
use camrig_base::{Bands, Error, Result};
use camrig_camera::Camera;
use camrig_exposure::IrradianceCube;
use camrig_light::photometry::{self, KM, xyz};
use camrig_light::{Illuminant, LightLevel};
use camrig_optics::{Options, Report};
use camrig_scene::{self as scene, LitScene, Quantity, Scene, level};
use std::f64::consts::PI;
use std::sync::Arc;

/// Illuminant of a scene of reflectances where none is asked for: the daylight of ISO 12233 and of
/// Chen et al. 2009.
pub const DEFAULT_ILLUMINANT: &str = "D65";

/// Scene illuminance where none is asked for, lx: the brighter of the two levels of Chen et al.
/// 2009.
pub const DEFAULT_LUX: f64 = 300.0;

/// Mean reflectance that a scene of radiance is taken to have where a light level is asked for:
/// the grey of 18 % to which exposure indices refer (ISO 12232). Its mean luminance over the frame
/// becomes that of such a grey in this light.
pub const MEAN_REFLECTANCE: f64 = 0.18;

/// The light asked for on a scene. The default asks for none, which is [`DEFAULT_ILLUMINANT`] at
/// [`DEFAULT_LUX`] on a scene of reflectances, and the scene's own light where it holds radiance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SceneLight<'a> {
    /// Name of a built-in illuminant, or a CSV file; none for a scene that holds radiance.
    pub illuminant: Option<&'a str>,
    /// How much light: of the illuminant, or of the scene's own (see [`radiance_at`]).
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
    pub scene: Arc<dyn Scene>,
    /// The illuminant of a scene of reflectances.
    pub illuminant: Option<Illuminant>,
    /// The illuminance asked for, lx; none for a scene of radiance in its own light.
    pub lux: Option<f64>,
    /// What the scene's values are multiplied by in each band: radiance of a perfect white,
    /// W m⁻² sr⁻¹ nm⁻¹; for a scene of radiance, 1 or the ratio of the level asked for to its own.
    pub white: Vec<f64>,
    /// What the illuminant's relative power, or a scene of radiance, is multiplied by.
    pub(crate) scale: f64,
    /// Whether bands of the scene were joined to fewer.
    pub(crate) rebinned: bool,
    pub(crate) spec: String,
    /// What was done to the scene for its light or for a sensor.
    pub(crate) done: Vec<String>,
}

impl SceneInLight {
    /// Opens what `spec` names for a frame of that aspect (width over height), in the light asked
    /// for.
    ///
    /// # Errors
    /// A scene or illuminant that cannot be read; an illuminant for a scene that holds radiance.
    pub fn open(spec: &str, frame_aspect: f64, light: &SceneLight<'_>) -> Result<Self> {
        Self::of(camrig_scene_files::open(spec)?, spec, frame_aspect, light)
    }

    /// The same of a scene that is open already, of the name `spec`.
    ///
    /// # Errors
    /// Those of [`SceneInLight::open`], but for the scene's.
    pub fn of(
        scene: Box<dyn Scene>,
        spec: &str,
        frame_aspect: f64,
        light: &SceneLight<'_>,
    ) -> Result<Self> {
        let scene: Arc<dyn Scene> = scene::filling(scene, frame_aspect).into();
        if scene.quantity() == Quantity::Radiance {
            return Self::of_radiance(scene, spec, frame_aspect, light);
        }
        let illuminant = Illuminant::parse(light.illuminant.unwrap_or(DEFAULT_ILLUMINANT))?;
        let level = light.level.unwrap_or(LightLevel::Lux(DEFAULT_LUX));
        let scale = photometry::white_scale(&illuminant, level)?;
        // Light that the eye does not see has no illuminance.
        let lux = match level {
            LightLevel::Irradiance(_) => {
                Some(PI * scale * KM * xyz(&illuminant.power)[1]).filter(|lux| *lux > 0.0)
            }
            _ => Some(illuminance(level)?),
        };
        let (illuminant, lux) = (Some(illuminant), lux);
        Ok(Self::lit_by(scene, illuminant, lux, scale, spec))
    }

    fn of_radiance(
        scene: Arc<dyn Scene>,
        spec: &str,
        frame_aspect: f64,
        light: &SceneLight<'_>,
    ) -> Result<Self> {
        if light.illuminant.is_some() {
            return Err(Error::input(format!("an illuminant for {spec:?}")).help(
                "this scene holds radiance, light included; leave the illuminant out (a level \
                 scales the scene as a whole), or say as=reflectance behind a picture's name",
            ));
        }
        let (mut factor, mut lux, mut done) = (1.0, None, Vec::new());
        if light.level.is_none() {
            level::check_absolute(&*scene).map_err(|e| e.at(format!("scene {spec:?}")))?;
        }
        if let Some(level) = light.level {
            let (times, note) = radiance_at(&*scene, spec, frame_aspect, level)?;
            (factor, lux) = (times, Some(illuminance(level)?));
            done.push(note);
        }
        Ok(Self { done, ..Self::lit_by(scene, None, lux, factor, spec) })
    }

    /// A scene in its own bands.
    pub(crate) fn lit_by(
        scene: Arc<dyn Scene>,
        illuminant: Option<Illuminant>,
        lux: Option<f64>,
        scale: f64,
        spec: &str,
    ) -> Self {
        let bands = scene.bands();
        let dark = Self {
            scene,
            illuminant,
            lux,
            white: Vec::new(),
            scale,
            rebinned: false,
            spec: spec.to_owned(),
            done: Vec::new(),
        };
        Self { white: dark.white_in(&bands), ..dark }
    }

    /// What the scene's values are multiplied by in other bands.
    pub(crate) fn white_in(&self, bands: &Bands) -> Vec<f64> {
        match &self.illuminant {
            Some(light) => light.in_bands(bands).iter().map(|power| power * self.scale).collect(),
            None => vec![self.scale; bands.count],
        }
    }

    /// What a user should know: of the scene so far as it was read, its light, and where `camera`
    /// holds tables beyond their ends.
    pub fn notes(&self, camera: &Camera) -> Vec<String> {
        let bands = with_visible(&self.scene.bands());
        let mut notes = self.scene.notes();
        notes.extend(self.done.iter().cloned());
        notes.extend(camera.notes(&bands));
        let seen = Sight::new(camera, None).bands([0.0, f64::INFINITY]).unwrap_or(bands);
        let seen = with_visible(&seen);
        notes.extend(self.illuminant.iter().flat_map(|light| light.notes(&seen)));
        notes
    }

    /// The scene as the optics engine takes it.
    pub fn lit(&self) -> LitScene<'_> {
        LitScene { scene: &*self.scene, white: self.white.clone() }
    }

    /// What the header of a cube of it says, seen by `camera`.
    pub fn about(&self, camera: &Camera) -> About {
        About {
            lux: self.lux,
            illuminant: self.illuminant.clone(),
            made_of: format!("scene {}, lens of {}", self.spec, camera.name),
        }
    }
}

/// What a scene of radiance, called `spec`, is multiplied by for a light level, and what to tell
/// the user: a picture's white becomes a perfect white in the light; the mean luminance of another
/// scene over a frame of that aspect becomes that of [`MEAN_REFLECTANCE`].
///
/// # Errors
/// A level that is none; a scene that is black in visible light, or cannot be read.
pub fn radiance_at(
    scene: &dyn Scene,
    spec: &str,
    frame_aspect: f64,
    level: LightLevel,
) -> Result<(f64, String)> {
    if let Some(white) = scene.white() {
        let (own, asked) = (white.luminance, level.checked()?);
        let note = format!("{spec} holds radiance: {} has {asked:.4} cd/m²", white.words);
        return Ok((asked / own, note));
    }
    let asked = MEAN_REFLECTANCE * level.checked()?;
    let own = level::mean_luminance(scene, frame_aspect)?;
    if own <= 0.0 {
        return Err(Error::input(format!("a light level for {spec:?}"))
            .help("this scene of radiance is black in visible light"));
    }
    let note = format!(
        "{spec} holds radiance: all of it times {:.4e}, so that its mean luminance of {own:.4} \
         cd/m² becomes the {asked:.4} cd/m² of {:.0} % grey at the level asked for",
        asked / own,
        100.0 * MEAN_REFLECTANCE
    );
    Ok((asked / own, note))
}

/// Bands about all of the others and of visible light: those of a chart end where a table of
/// camera or light does, which is worth a note.
fn with_visible(bands: &Bands) -> Bands {
    let (visible, last) = (Bands::VISIBLE, |bands: &Bands| bands.nm(bands.count - 1));
    let start_nm = bands.start_nm.min(visible.start_nm);
    let end_nm = last(bands).max(last(&visible));
    Bands { start_nm, step_nm: end_nm - start_nm, count: 2 }
}

/// A perfect diffuser of L cd/m² is lit by π L lux.
fn illuminance(level: LightLevel) -> Result<f64> {
    Ok(level.checked()? * PI)
}

/// Width over height of a camera's frames.
pub(crate) fn frame_aspect(camera: &Camera) -> f64 {
    f64::from(camera.sensor.width) / f64::from(camera.sensor.height)
}

/// Height of a camera's frames in sensor widths.
pub(crate) fn frame_height(camera: &Camera) -> f64 {
    f64::from(camera.sensor.height) / f64::from(camera.sensor.width)
}

/// What falls on a sensor from a scene.
pub struct SceneIrradiance {
    /// Spectral irradiance per band and pixel, W m⁻² nm⁻¹.
    pub cube: IrradianceCube,
    /// Figures of the optics stage.
    pub optics: Report,
    /// What a user should know of the scene, its light, the lens and the camera's tables.
    pub notes: Vec<String>,
}

/// What falls on the sensor of `camera` when it looks at the scene that `spec` names: spectral
/// irradiance per band and pixel, W m⁻² nm⁻¹, with the figures of the optics stage and what a user
/// should know. Bands are those that the camera sees ([`SceneInLight::seen_by`]).
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
/// let seen = scene_irradiance(&camera, "colorchecker", &light, &Options::default(), |_, _| ())?;
/// let cube = seen.cube;
/// let sensor = SimulatedSensor::new(&camera, &cube.header)?;
/// let settings = camera.settings(0, 10e-3, None);
/// let frame = sensor.frame(&cube, &settings)?;
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
) -> Result<SceneIrradiance> {
    let opened = SceneInLight::open(spec, frame_aspect(camera), light)?.seen_by(camera);
    let about = opened.about(camera);
    let (cube, optics, of_lens) =
        super::irradiance_with(camera, &opened.lit(), options, about, progress)?;
    let mut notes = opened.notes(camera);
    notes.extend(of_lens);
    Ok(SceneIrradiance { cube, optics, notes })
}

/// What [`scene_irradiance`] tells, without the optics stage: of a scene so far as opening it says.
///
/// # Errors
/// Those of [`SceneInLight::open`], and a lens that cannot be read.
pub fn scene_notes(camera: &Camera, spec: &str, light: &SceneLight<'_>) -> Result<Vec<String>> {
    let opened = SceneInLight::open(spec, frame_aspect(camera), light)?.seen_by(camera);
    let mut notes = opened.notes(camera);
    notes.extend(super::lens_notes(camera, &opened.scene.bands())?);
    Ok(notes)
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
    fn a_level_scales_a_scene_of_radiance_and_an_illuminant_is_refused() {
        let (_folder, spec) = radiance_scene();
        let open = |light: SceneLight<'_>| SceneInLight::open(&spec, 4.0 / 3.0, &light);
        let opened = open(SceneLight::default()).unwrap();
        assert!(opened.illuminant.is_none() && opened.lux.is_none() && opened.done.is_empty());
        assert!(opened.white.iter().all(|&factor| factor == 1.0), "{:?}", opened.white);
        let own = level::mean_luminance(&*opened.scene, 4.0 / 3.0).unwrap();
        // 0.01 W m⁻² sr⁻¹ nm⁻¹ from 475 to 625 nm, and dark beyond: 683 lm/W times V there.
        let visible = photometry::observer()[1].mean(475.0, 625.0) * 150.0;
        assert!(visible < 104.0, "{visible} nm of 106.86");
        assert!((own / (0.01 * 683.0 * visible) - 1.0).abs() < 1e-6, "{own}");

        let level = Some(LightLevel::Lux(100.0));
        let lit = open(SceneLight { illuminant: None, level }).unwrap();
        assert_eq!((lit.lux, lit.illuminant.is_none()), (Some(100.0), true));
        let mean = own * lit.white[0];
        assert!((mean - 0.18 * 100.0 / PI).abs() < 1e-9, "{mean}");
        assert!(lit.done[0].contains("holds radiance"), "{:?}", lit.done);
        let level = Some(LightLevel::Luminance(200.0 / PI));
        let twice = open(SceneLight { illuminant: None, level }).unwrap();
        assert!((twice.white[0] / lit.white[0] - 2.0).abs() < 1e-12);

        for light in
            [SceneLight { illuminant: Some("A"), level: None }, SceneLight::lux("A", 20.0)]
        {
            let said = open(light).err().unwrap().to_string();
            assert!(said.contains("an illuminant") && said.contains("holds radiance"), "{said}");
        }
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
