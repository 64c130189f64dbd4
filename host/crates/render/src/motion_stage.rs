//! The optics stage of a scene that moves as a whole: irradiance on the sensor, frame by frame,
//! through one lens.

use super::kept_optics::KeptOptics;
use super::lighting::{SceneInLight, frame_height};
use super::optics_stage::{Motion, OpticsOutput, OpticsStage};
use camrig_base::{Error, Result};
use camrig_camera::{Camera, RowWindows};
use camrig_light::Lamps;
use camrig_scene::Scene;
use camrig_scene::moving::{self, Moments, Moving};
use std::sync::Arc;

/// Makes irradiance of the frames that look at a moving scene.
pub struct MotionStage {
    motion: Motion,
    name: String,
    /// The scene at time 0.
    at_rest: Arc<dyn Scene>,
    /// The scene as a frame sees it.
    opened: SceneInLight,
    optics: KeptOptics,
}

impl MotionStage {
    /// Opens the scene of `stage`, which moves.
    ///
    /// # Errors
    /// Those of [`OpticsStage::run`]; a stage whose scene stands still.
    pub fn open(stage: &OpticsStage, camera: &Camera) -> Result<Self> {
        let motion =
            stage.motion.ok_or_else(|| Error::internal("a moving scene that stands still"))?;
        let opened = stage.open(camera)?;
        Ok(Self {
            motion,
            name: stage.scene.clone(),
            at_rest: Arc::clone(&opened.scene),
            opened,
            optics: KeptOptics::new(stage),
        })
    }

    /// What falls on the sensor at frame `frame`; `progress` hears of bands done and bands in all.
    ///
    /// # Errors
    /// Those of [`OpticsStage::run`].
    pub fn run_frame(
        &mut self,
        camera: &Camera,
        frame: u32,
        progress: impl FnMut(usize, usize),
    ) -> Result<OpticsOutput> {
        let Motion { velocity_pixels, rolling } = self.motion;
        let start = f64::from(frame);
        let moments = move |place: f64| {
            let read = if rolling == 0.0 { 0.0 } else { rolling * place };
            vec![(start + read, 1.0)]
        };
        let moved = (velocity_pixels, rolling != 0.0);
        self.run_moved(camera, moved, Arc::new(moments), progress)
    }

    /// The same where the rows of a frame collect light in these windows while the scene moves by
    /// its motion in `period_s`. Lamps decide when things are seen; how bright their light makes a
    /// row is left to who exposes it.
    ///
    /// # Errors
    /// Those of [`OpticsStage::run`].
    pub fn run_exposed(
        &mut self,
        camera: &Camera,
        (windows, period_s): (&RowWindows, f64),
        lamps: &Lamps,
        progress: impl FnMut(usize, usize),
    ) -> Result<OpticsOutput> {
        let (windows, lamps) = (*windows, lamps.clone());
        let velocity_pixels = self.motion.velocity_pixels.map(|pixels| pixels / period_s);
        let speed = velocity_pixels.iter().map(|v| v * v).sum::<f64>().sqrt();
        let moments = move |place| {
            let [open, close] = windows.place(place);
            moving::moments([open, close], speed * (close - open), &lamps)
        };
        let moved = (velocity_pixels, !windows.are_one());
        self.run_moved(camera, moved, Arc::new(moments), progress)
    }

    /// The scene displaced by pixels per unit of time; see [`Moving`].
    fn run_moved(
        &mut self,
        camera: &Camera,
        (velocity_pixels, by_row): ([f64; 2], bool),
        moments: Arc<dyn Fn(f64) -> Moments + Send + Sync>,
        progress: impl FnMut(usize, usize),
    ) -> Result<OpticsOutput> {
        let width = f64::from(camera.sensor.width);
        self.opened.scene = Arc::new(Moving {
            scene: Arc::clone(&self.at_rest),
            velocity: velocity_pixels.map(|v| v / width),
            height: frame_height(camera),
            by_row,
            moments,
        });
        self.optics.see(camera, &self.opened, progress).map_err(|e| e.at(&self.name))
    }
}
