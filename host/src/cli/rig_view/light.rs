//! What the rig is shown, and how it changes while it runs.

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

/// Lights that a scene of reflectances may be put into, beside its own.
const ILLUMINANTS: [&str; 8] = ["D65", "D50", "A", "E", "F2", "F11", "LED-B1", "LED-B5"];

/// A scene in its light in front of a sensor.
pub struct Lit {
    /// What the optics stage gave of its first frame.
    view: Arc<OpticsOutput>,
    /// What falls on the sensor in a later one.
    later: Option<Arc<IrradianceCube>>,
    /// What is told of frames.
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
    /// A scene that is in its own light.
    pub fn at(&self, camera: &Camera, lux: f64) -> Result<Self> {
        Self::of(camera, self.view.clone(), self.later.clone(), self.view.header_at(lux)?)
    }

    fn of(
        camera: &Camera,
        view: Arc<OpticsOutput>,
        later: Option<Arc<IrradianceCube>>,
        header: render::CubeHeader,
    ) -> Result<Self> {
        let sensor = Arc::new(SimulatedSensor::new(camera, &header, 1.0)?);
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

    /// What the optics stage gave of the scene's first frame.
    pub fn first(&self) -> Arc<OpticsOutput> {
        self.view.clone()
    }

    /// What falls on the sensor at the level of light that the scene was made for.
    pub fn cube(&self) -> &IrradianceCube {
        self.later.as_deref().unwrap_or(&self.view.cube)
    }

    /// Says what is shown.
    pub fn tell(&self, scene: &str, settings: &mut Settings) {
        settings.scene = scene.to_owned();
        settings.lux = self.light.header.lux;
        settings.illuminant = self.light.header.illuminant.clone();
    }
}

/// What the page is told before the scene is open.
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

/// Tells the page of the scene's first light, and what to choose from. A scene that changes with
/// time is the only one.
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

/// What is shown, where the optics stage must run for it.
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// The scene.
    pub scene: String,
    /// The light on it; `None` for its own.
    pub illuminant: Option<String>,
}

/// Runs the optics stage beside the stream, one scene after the other.
pub struct Workshop {
    camera: Camera,
    stage: OpticsStage,
    /// Scenes and lights that may be wanted: a page may not open files.
    source: Source,
    /// What the stream began with.
    first: Wanted,
    /// What is shown, and what was wanted last.
    shown: Wanted,
    latest: Wanted,
    at_work: Option<(Wanted, JoinHandle<Result<OpticsOutput>>)>,
}

/// A scene that the optics stage has computed.
pub struct Ready {
    /// What was wanted.
    pub wanted: Wanted,
    /// What it gave.
    pub view: OpticsOutput,
}

impl Workshop {
    /// Works as a stage would, for other scenes and lights than those of the start.
    pub fn new(camera: Camera, stage: OpticsStage, state: &State) -> Self {
        let Settings { scene, illuminant, .. } = state.settings.clone();
        let first = Wanted { scene, illuminant };
        let (shown, latest, source) = (first.clone(), first.clone(), state.source.clone());
        Self { camera, stage, source, first, shown, latest, at_work: None }
    }

    /// Wants another scene.
    ///
    /// # Errors
    /// A name that is not in the list.
    pub fn want_scene(&mut self, scene: String) -> Result<()> {
        if !self.source.scenes.contains(&scene) {
            return Err(Error::input(format!("scene {scene}"))
                .help("choose a built-in chart, or the scene of the start"));
        }
        let own_light = scene == self.first.scene && self.first.illuminant.is_none();
        let illuminant = self.latest.illuminant.take().filter(|_| !own_light);
        self.latest = Wanted { scene, illuminant };
        Ok(())
    }

    /// Wants another light.
    ///
    /// # Errors
    /// A name that is not in the list.
    pub fn want_light(&mut self, name: String) -> Result<()> {
        if !self.source.illuminants.contains(&name) {
            return Err(Error::input(format!("light {name}")).help("choose one of the list"));
        }
        self.latest.illuminant = Some(name);
        Ok(())
    }

    /// What has become ready; begins what is wanted.
    pub fn ready(&mut self, shared: &Shared) -> Option<Result<Ready>> {
        if self.at_work.as_ref().is_some_and(|(_, work)| work.is_finished()) {
            let (wanted, work) = self.at_work.take()?;
            shared.change(|state| state.busy = None);
            let broke = || Error::internal(format!("the optics of {} broke off", wanted.scene));
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
