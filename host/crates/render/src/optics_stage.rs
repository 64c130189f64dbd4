//! The optics stage as a person asks for it: a scene by name, its light, its movement, and whether
//! results are kept on disk. It gives irradiance on the sensor, W m⁻² nm⁻¹ per band and pixel.

use super::cache;
use super::collapse::{Collapse, CollapseReport, OpticsPath};
use super::lighting::{SceneInLight, SceneLight, frame_aspect};
use camrig_base::{Error, Result};
use camrig_camera::{Camera, RowWindows};
use camrig_exposure::{CubeHeader, IrradianceCube};
use camrig_light::lamp::Region;
use camrig_light::{Illuminant, Lamps, LightLevel, photometry};
use camrig_optics::{Options, Report};
use camrig_scene::Scene;
use camrig_scene::moving::{self, Moments, Moving};
use camrig_scene::part::Part;
use std::path::PathBuf;

/// A scene and its light, ready to be seen by a camera.
#[derive(Clone, Debug)]
pub struct OpticsStage {
    /// A chart, a spectral cube or a scene directory.
    pub scene: String,
    /// The light on a scene of reflectances, [`super::DEFAULT_ILLUMINANT`] unless given; one of
    /// radiance has its own and takes none.
    pub illuminant: Option<String>,
    /// How much of it: on a scene of reflectances 300 lx unless given; one of radiance is scaled to
    /// it, see [`super::MEAN_REFLECTANCE`].
    pub level: Option<LightLevel>,
    /// Options of the optics engine.
    pub options: Options,
    /// Directory in which results are kept, if any.
    pub cache: Option<PathBuf>,
    /// How the scene moves, if it does.
    pub motion: Option<Motion>,
    /// How light comes from the scene to the sensor.
    pub path: OpticsPath,
}

/// Movement of a whole scene over the frames of a sequence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// To the right and down, pixels per frame.
    pub velocity_pixels: [f64; 2],
    /// Part of the frame period in which a rolling shutter reads its rows; 0 for a global shutter.
    pub rolling: f64,
}

/// What is done to a scene for one frame, of that width and height in pixels.
type Change = Box<dyn FnOnce(Box<dyn Scene>, [f64; 2]) -> Box<dyn Scene>>;

/// A scene displaced by pixels per unit of time; see [`Moving`].
fn moved(
    velocity_pixels: [f64; 2],
    by_row: bool,
    moments: Box<dyn Fn(f64) -> Moments + Send + Sync>,
) -> Change {
    Box::new(move |scene, [width, height]| {
        let velocity = velocity_pixels.map(|v| v / width);
        Box::new(Moving { scene, velocity, height: height / width, by_row, moments })
    })
}

/// What the optics stage gave, and what it was made from.
pub struct OpticsOutput {
    /// The light, where the scene is one of reflectances.
    pub light: Option<Illuminant>,
    /// Irradiance on the sensor.
    pub cube: IrradianceCube,
    /// Figures of the optics engine.
    pub optics: Report,
    /// Whether they came from the cache.
    pub cached: bool,
    /// Whether the scene's bands were joined to fewer, or to electrons.
    pub rebinned: bool,
    /// Whether a lens was traced for them now.
    pub lens_traced: bool,
    /// What a fast path leaves out, where one was taken.
    pub collapse: Option<CollapseReport>,
    /// What a user should know about the scene and the lens.
    pub notes: Vec<String>,
}

impl OpticsStage {
    /// What falls on the sensor of `camera`; `progress` hears of bands done and bands in all.
    ///
    /// # Errors
    /// A scene, light or lens that cannot be read; an illuminant for a scene that holds radiance.
    pub fn run(
        &self,
        camera: &Camera,
        progress: impl FnMut(usize, usize),
    ) -> Result<OpticsOutput> {
        self.run_frame(camera, 0, progress)
    }

    /// The same at frame `frame` of a sequence in which the scene moves.
    ///
    /// # Errors
    /// Those of [`OpticsStage::run`].
    pub fn run_frame(
        &self,
        camera: &Camera,
        frame: u32,
        progress: impl FnMut(usize, usize),
    ) -> Result<OpticsOutput> {
        let change = self.motion.map(|Motion { velocity_pixels, rolling }| {
            let start = f64::from(frame);
            let moments = move |place: f64| {
                let read = if rolling == 0.0 { 0.0 } else { rolling * place };
                vec![(start + read, 1.0)]
            };
            moved(velocity_pixels, rolling != 0.0, Box::new(moments))
        });
        self.run_changed(camera, change, progress)
    }

    /// The same where the rows of a frame collect light in these windows while the scene moves by
    /// its motion in `period_s`. Lamps decide when things are seen; how bright their light makes a
    /// row is left to who exposes it.
    ///
    /// # Errors
    /// Those of [`OpticsStage::run`].
    pub fn run_exposed(
        &self,
        camera: &Camera,
        (windows, period_s): (&RowWindows, f64),
        lamps: &Lamps,
        progress: impl FnMut(usize, usize),
    ) -> Result<OpticsOutput> {
        let (windows, lamps) = (*windows, lamps.clone());
        let change = self.motion.map(|motion| {
            let velocity_pixels = motion.velocity_pixels.map(|pixels| pixels / period_s);
            let speed = velocity_pixels.iter().map(|v| v * v).sum::<f64>().sqrt();
            let moments = move |place| {
                let [open, close] = windows.place(place);
                moving::moments([open, close], speed * (close - open), &lamps)
            };
            moved(velocity_pixels, !windows.are_one(), Box::new(moments))
        });
        self.run_changed(camera, change, progress)
    }

    /// What falls on the sensor from a part of the scene alone.
    ///
    /// # Errors
    /// Those of [`OpticsStage::run`].
    pub fn run_part(&self, camera: &Camera, region: Region) -> Result<OpticsOutput> {
        let part: Change = Box::new(move |scene, [width, height]| {
            Box::new(Part { scene, region, height: height / width })
        });
        self.run_changed(camera, Some(part), |_, _| ())
    }

    fn run_changed(
        &self,
        camera: &Camera,
        change: Option<Change>,
        progress: impl FnMut(usize, usize),
    ) -> Result<OpticsOutput> {
        let light = SceneLight { illuminant: self.illuminant.as_deref(), level: self.level };
        let opened = SceneInLight::open(&self.scene, frame_aspect(camera), &light)?;
        let count = opened.scene.bands().count;
        let mut opened = opened.binned_for(camera);
        let rebinned = opened.scene.bands().count != count;
        // A changed scene is seen once: nothing to keep.
        let directory = self.cache.as_deref().filter(|_| change.is_none());
        if let Some(change) = change {
            let size = [camera.sensor.width, camera.sensor.height].map(f64::from);
            opened.scene = change(opened.scene, size);
        }
        if self.path != OpticsPath::Bands {
            return self.collapsed(camera, &opened);
        }
        let about = opened.about(camera);
        let cache::Rendered { cube, report, hit, traced, notes: of_lens } =
            cache::irradiance(camera, &opened.lit(), &self.options, about, directory, progress)
                .map_err(|e| e.at(&self.scene))?;
        let mut notes = opened.notes(camera);
        notes.extend(of_lens);
        let light = opened.illuminant;
        Ok(OpticsOutput {
            light,
            cube,
            optics: report,
            cached: hit,
            rebinned,
            lens_traced: traced,
            collapse: None,
            notes,
        })
    }

    /// What falls on the sensor on a fast path.
    fn collapsed(&self, camera: &Camera, opened: &SceneInLight) -> Result<OpticsOutput> {
        let bands = opened.scene.bands();
        let directory = self.cache.as_deref();
        let mut collapse = Collapse::new(camera, &bands, &self.options, directory, self.path)?;
        OpticsOutput::collapsed(&mut collapse, camera, opened, &self.options)
            .map_err(|e| e.at(&self.scene))
    }
}

impl OpticsOutput {
    /// What falls on the sensor from a scene, on a fast path.
    pub(crate) fn collapsed(
        collapse: &mut Collapse,
        camera: &Camera,
        opened: &SceneInLight,
        options: &Options,
    ) -> Result<Self> {
        let about = opened.about(camera);
        let (cube, optics, report) = collapse.run(camera, opened, options, about)?;
        let mut notes = opened.notes(camera);
        notes.extend(collapse.lens.notes.iter().cloned());
        notes.push(report.words());
        Ok(Self {
            light: opened.illuminant.clone(),
            cube,
            optics,
            cached: false,
            rebinned: true,
            lens_traced: collapse.lens.traced,
            collapse: Some(report),
            notes,
        })
    }

    /// The cube's header for another level of the same light: the samples serve them all.
    ///
    /// # Errors
    /// A scene of radiance that was not scaled to a level.
    pub fn header_at(&self, lux: f64) -> Result<CubeHeader> {
        let header = &self.cube.header;
        let level = match (&self.light, header.lux) {
            (Some(light), _) if !self.rebinned => {
                let bands = header.spectral_bands();
                let white = photometry::white_radiance(light, LightLevel::Lux(lux), &bands)?;
                white.iter().fold(0.0f64, |m, &w| m.max(w))
            }
            (_, Some(own)) => header.level * lux / own,
            (_, None) => return Err(Error::input("the scene is in its own light")),
        };
        Ok(CubeHeader { level, lux: Some(lux), ..header.clone() })
    }
}
