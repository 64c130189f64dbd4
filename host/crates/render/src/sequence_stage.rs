//! The optics stage of a scene that changes with time: irradiance on the sensor, frame by frame.
//!
//! Every frame is seen by one lens, in one light. A level (lux or cd/m²) is that of the first
//! frame: what scales its radiance to the level scales all others, so that a scene that becomes
//! brighter does. Light that frames state themselves is taken where none is asked for. All frames
//! have the size, the bands and the quantity of the first.

use super::collapse::OpticsPath;
use super::kept_optics::KeptOptics;
use super::lighting::{SceneInLight, SceneLight, frame_aspect};
use super::optics_stage::{OpticsOutput, OpticsStage};
use camrig_base::{Bands, Error, Result};
use camrig_camera::Camera;
use camrig_light::Illuminant;
use camrig_scene::sequence::{FrameLight, SceneFrame};
use camrig_scene::{self as scene, Quantity, Scene, level};

/// Makes irradiance of the frames of a sequence.
pub struct SequenceStage {
    stage: OpticsStage,
    first: Option<First>,
    optics: KeptOptics,
}

/// What the first frame decides for all.
struct First {
    name: String,
    size: (usize, usize),
    bands: Bands,
    quantity: Quantity,
    illuminant: Option<Illuminant>,
    lux: Option<f64>,
    scale: f64,
}

impl SequenceStage {
    /// Frames as `stage` says, whose scene is the sequence. It keeps a traced lens where `stage`
    /// keeps results, and no irradiance.
    ///
    /// # Errors
    /// A stage that moves its scene: a sequence has its own movement.
    pub fn new(stage: OpticsStage) -> Result<Self> {
        if stage.motion.is_some() {
            return Err(Error::unsupported(format!("motion of the sequence {:?}", stage.scene))
                .help("a sequence moves by itself; leave the motion out"));
        }
        Ok(Self { optics: KeptOptics::new(&stage), stage, first: None })
    }

    /// What falls on the sensor of `camera` from a frame; `progress` hears of bands done and bands
    /// in all.
    ///
    /// # Errors
    /// A frame that cannot be read, or is not like the first; those of [`OpticsStage::run`].
    pub fn run(
        &mut self,
        camera: &Camera,
        frame: SceneFrame,
        progress: impl FnMut(usize, usize),
    ) -> Result<OpticsOutput> {
        let (name, light) = (frame.name.clone(), frame.light.clone());
        let cube = frame.open()?;
        let size = cube.size();
        let opened = self.opened((Box::new(cube), size), &name, &light, frame_aspect(camera))?;
        let opened = opened.seen_by(camera);
        self.optics.see(camera, &opened, progress).map_err(|e| e.at(&name))
    }

    /// Bytes of irradiance that a frame makes, at most; 0 before the first.
    #[must_use]
    pub fn cube_bytes(&self, camera: &Camera) -> u64 {
        let pixels = u64::from(camera.sensor.width) * u64::from(camera.sensor.height);
        let of_scene = self.first.as_ref().map_or(0, |first| first.bands.count as u64);
        let bands = if self.optics.path() == OpticsPath::Bands { of_scene } else { 1 };
        size_of::<u16>() as u64 * pixels * bands
    }

    /// A frame's scene in the light of the sequence.
    fn opened(
        &mut self,
        (cube, size): (Box<dyn Scene>, (usize, usize)),
        name: &str,
        own: &FrameLight,
        frame_aspect: f64,
    ) -> Result<SceneInLight> {
        let (bands, quantity) = (cube.bands(), cube.quantity());
        let Some(first) = &self.first else {
            let OpticsStage { illuminant, level, .. } = &self.stage;
            let illuminant = illuminant.as_ref().or(own.illuminant.as_ref());
            let light = SceneLight {
                illuminant: illuminant.map(String::as_str),
                level: level.or(own.level),
            };
            let opened = SceneInLight::of(cube, name, frame_aspect, &light)?;
            self.first = Some(First {
                name: name.to_owned(),
                size,
                bands,
                quantity,
                illuminant: opened.illuminant.clone(),
                lux: opened.lux,
                scale: opened.scale,
            });
            return Ok(opened);
        };
        if (size, bands, quantity) != (first.size, first.bands, first.quantity) {
            let words = |(width, height): (usize, usize), bands: &Bands, quantity: Quantity| {
                let Bands { start_nm, step_nm, count } = bands;
                format!(
                    "{width} x {height} pixels of {}, {count} bands of {step_nm} nm from \
                     {start_nm} nm on",
                    quantity.name()
                )
            };
            let this = words(size, &bands, quantity);
            let other = words(first.size, &first.bands, first.quantity);
            return Err(Error::disagreement(format!("{this}; {} has {other}", first.name))
                .at(name)
                .help("all frames of a sequence have the same size, bands and quantity"));
        }
        if quantity == Quantity::Radiance && first.lux.is_none() {
            level::check_absolute(&*cube).map_err(|e| e.at(name))?;
        }
        let scene = scene::filling(cube, frame_aspect).into();
        Ok(SceneInLight::lit_by(scene, first.illuminant.clone(), first.lux, first.scale, name))
    }
}
