//! The scene and light in front of the rig, and how they change while it runs.

use super::Args;
use crate::view::{Light, Settings, Shared, Source, State};
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_exposure::IrradianceCube;
use camrig_render::{self as render, OpticsOutput, OpticsStage, SimulatedSensor};
use camrig_rig::Url;
use camrig_scene::chart;
use std::sync::Arc;
use std::thread::JoinHandle;

/// Lights offered for reflectance scenes, besides the scene's own.
const ILLUMINANTS: [&str; 8] = ["D65", "D50", "A", "E", "F2", "F11", "LED-B1", "LED-B5"];

/// A scene in its light in front of a sensor.
pub struct Lit {
    /// Output of the optics stage for its first frame.
    view: Arc<OpticsOutput>,
    /// Irradiance of a later frame.
    later: Option<Arc<IrradianceCube>>,
    /// Facts about the light for frames.
    pub light: Arc<Light>,
    /// The sensor under this level of light.
    pub sensor: Arc<SimulatedSensor>,
}

impl Lit {
    /// A scene at the level it was made for.
    ///
    /// # Errors
    /// A sensor that the model refuses.
    pub fn new(camera: &Camera, view: OpticsOutput) -> Result<Self> {
        let header = view.cube.header.clone();
        Self::of(camera, Arc::new(view), None, header)
    }

    /// The same scene at another level, lx.
    ///
    /// # Errors
    /// A scene that includes its light.
    pub fn at(&self, camera: &Camera, lux: f64) -> Result<Self> {
        Self::of(camera, self.view.clone(), self.later.clone(), self.view.header_at(lux)?)
    }

    fn of(
        camera: &Camera,
        view: Arc<OpticsOutput>,
        later: Option<Arc<IrradianceCube>>,
        header: render::CubeHeader,
    ) -> Result<Self> {
        let sensor = Arc::new(SimulatedSensor::new(camera, &header)?);
        let settings = camera.settings(0, 1.0, None);
        let illuminant = view.light.clone();
        let info = render::frame_info(camera, &settings, illuminant.as_ref(), &header, false)?;
        Ok(Self { view, later, light: Arc::new(Light { illuminant, header, info }), sensor })
    }

    /// A later frame of the scene in the same light.
    pub fn later(&self, cube: IrradianceCube) -> Self {
        Self {
            view: self.view.clone(),
            later: Some(Arc::new(cube)),
            light: self.light.clone(),
            sensor: self.sensor.clone(),
        }
    }

    /// Output of the optics stage for the scene's first frame.
    pub fn first(&self) -> Arc<OpticsOutput> {
        self.view.clone()
    }

    /// Irradiance on the sensor at the light level that the scene was made for.
    pub fn cube(&self) -> &IrradianceCube {
        self.later.as_deref().unwrap_or(&self.view.cube)
    }

    /// Puts scene and light into the page's settings.
    pub fn tell(&self, scene: &str, settings: &mut Settings) {
        settings.scene = scene.to_owned();
        settings.lux = self.light.header.lux;
        settings.illuminant = self.light.header.illuminant.clone();
    }
}

/// Contents of the page before the scene is open.
///
/// # Errors
/// A text that is not the address of a rig.
pub fn description(args: &Args, camera: &Camera) -> Result<(Source, Settings)> {
    let scene = args.view.scene.clone();
    let source = Source {
        camera: camera.name.clone(),
        rig: Url::parse(&args.url)?.to_string(),
        fps: args.fps,
        scenes: vec![scene.clone()],
        illuminants: Vec::new(),
    };
    let (exposure_s, analog_gain) = (args.exposure, args.gain);
    Ok((source, Settings { exposure_s, analog_gain, scene, ..Settings::default() }))
}

/// Shows the scene's first light on the page, and the choices of scenes and lights. A changing
/// scene is the only choice.
pub fn tell_first(shared: &Shared, lit: &Lit, stands_still: bool) {
    shared.change(|state| {
        let State { source, settings, busy, .. } = state;
        let scene = settings.scene.clone();
        lit.tell(&scene, settings);
        let with = |own: Option<&str>, names: &[&str]| {
            let names = if stands_still { names } else { &[] };
            let own = own.filter(|own| !names.contains(own));
            own.into_iter().chain(names.iter().copied()).map(str::to_owned).collect()
        };
        source.scenes = with(Some(&scene), chart::NAMES);
        source.illuminants = with(settings.illuminant.as_deref(), &ILLUMINANTS);
        *busy = None;
    });
}

/// A choice of scene and light, for which the optics stage must run.
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// The scene.
    pub scene: String,
    /// The light on it; `None` for its own.
    pub illuminant: Option<String>,
}

/// Runs the optics stage in the background, one scene after the other.
pub struct Workshop {
    camera: Camera,
    stage: OpticsStage,
    /// Scenes and lights that may be chosen: a page may not open files.
    source: Source,
    /// The choice at the start.
    first: Wanted,
    /// The choice shown, and the latest one.
    shown: Wanted,
    latest: Wanted,
    at_work: Option<(Wanted, JoinHandle<Result<OpticsOutput>>)>,
}

/// A scene that the optics stage has computed.
pub struct Ready {
    /// The choice.
    pub wanted: Wanted,
    /// Output of the optics stage.
    pub view: OpticsOutput,
}

impl Workshop {
    /// Works like `stage`, for other scenes and lights than those at the start.
    pub fn new(camera: Camera, stage: OpticsStage, state: &State) -> Self {
        let Settings { scene, illuminant, .. } = state.settings.clone();
        let first = Wanted { scene, illuminant };
        let (shown, latest, source) = (first.clone(), first.clone(), state.source.clone());
        Self { camera, stage, source, first, shown, latest, at_work: None }
    }

    /// Chooses another scene.
    ///
    /// # Errors
    /// A name that is not in the list.
    pub fn want_scene(&mut self, scene: String) -> Result<()> {
        if !self.source.scenes.contains(&scene) {
            return Err(Error::input(format!("scene {scene}"))
                .help("choose a built-in chart, or the initial scene"));
        }
        let own_light = scene == self.first.scene && self.first.illuminant.is_none();
        let illuminant = self.latest.illuminant.take().filter(|_| !own_light);
        self.latest = Wanted { scene, illuminant };
        Ok(())
    }

    /// Chooses another light.
    ///
    /// # Errors
    /// A name that is not in the list.
    pub fn want_light(&mut self, name: String) -> Result<()> {
        if !self.source.illuminants.contains(&name) {
            return Err(Error::input(format!("light {name}")).help("choose one from the list"));
        }
        self.latest.illuminant = Some(name);
        Ok(())
    }

    /// A finished scene, if any; starts the next one chosen.
    pub fn ready(&mut self, shared: &Shared) -> Option<Result<Ready>> {
        if self.at_work.as_ref().is_some_and(|(_, work)| work.is_finished()) {
            let (wanted, work) = self.at_work.take()?;
            shared.change(|state| state.busy = None);
            let broke = || Error::internal(format!("the optics stage of {} failed", wanted.scene));
            let view = work.join().unwrap_or_else(|_| Err(broke()));
            match view {
                Ok(_) => self.shown.clone_from(&wanted),
                // Not tried again.
                Err(_) if self.latest == wanted => self.latest.clone_from(&self.shown),
                Err(_) => {}
            }
            return Some(view.map(|view| Ready { wanted, view }));
        }
        if self.at_work.is_none() && self.latest != self.shown {
            self.begin(shared);
        }
        None
    }

    fn begin(&mut self, shared: &Shared) {
        let wanted = self.latest.clone();
        let light = wanted.illuminant.as_ref().map_or(String::new(), |name| format!(" in {name}"));
        shared.change(|state| state.busy = Some(format!("computing {}{light}", wanted.scene)));
        let stage = OpticsStage {
            scene: wanted.scene.clone(),
            illuminant: wanted.illuminant.clone(),
            ..self.stage.clone()
        };
        let camera = self.camera.clone();
        let work = std::thread::spawn(move || stage.run(&camera, |_, _| ()));
        self.at_work = Some((wanted, work));
    }
}
