//! Runs the optics stage: a scene at rest, part of one, or the first frame of one that moves.

use super::cache;
use super::collapse::OpticsPath;
use super::kept_optics::KeptOptics;
use super::lighting::{SceneInLight, frame_height};
use super::motion_stage::MotionStage;
use super::optics_stage::{OpticsOutput, OpticsStage};
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_light::lamp::Region;
use camrig_scene::part::Part;
use std::sync::Arc;

impl OpticsStage {
    /// What falls on the sensor of `camera`, of a scene that moves in its first frame; `progress`
    /// hears of bands done and bands in all.
    ///
    /// # Errors
    /// A scene, light or lens that cannot be read; an illuminant for a scene that holds radiance.
    pub fn run(
        &self,
        camera: &Camera,
        progress: impl FnMut(usize, usize),
    ) -> Result<OpticsOutput> {
        match self.motion {
            Some(_) => MotionStage::open(self, camera)?.run_frame(camera, 0, progress),
            None => self.run_opened(camera, self.open(camera)?, progress),
        }
    }

    /// What falls on the sensor from a part of the scene alone.
    ///
    /// # Errors
    /// Those of [`OpticsStage::run`].
    pub fn run_part(&self, camera: &Camera, region: Region) -> Result<OpticsOutput> {
        let mut opened = self.open(camera)?;
        let height = frame_height(camera);
        opened.scene = Arc::new(Part { scene: opened.scene, region, height });
        // It is seen once: nothing to keep.
        let once = Self { cache: None, ..self.clone() };
        once.run_opened(camera, opened, |_, _| ())
    }

    fn run_opened(
        &self,
        camera: &Camera,
        opened: SceneInLight,
        progress: impl FnMut(usize, usize),
    ) -> Result<OpticsOutput> {
        if self.path != OpticsPath::Bands {
            let mut optics = KeptOptics::new(self);
            return optics.see(camera, &opened, progress).map_err(|e| e.at(&self.scene));
        }
        let directory = self.cache.as_deref();
        let about = opened.about(camera);
        let cache::Rendered { cube, report, hit, traced, notes: of_lens } =
            cache::irradiance(camera, &opened.lit(), &self.options, about, directory, progress)
                .map_err(|e| e.at(&self.scene))?;
        let mut notes = opened.notes(camera);
        notes.extend(of_lens);
        let (light, shown) = (opened.illuminant, opened.scene.shown());
        Ok(OpticsOutput {
            light,
            cube,
            optics: report,
            cached: hit,
            rebinned: opened.rebinned,
            lens_traced: traced,
            collapse: None,
            shown,
            notes,
        })
    }
}
