//! A lens that is kept from frame to frame, on the path asked for.

use super::SceneInLight;
use super::cache::OneLens;
use super::collapse::{Collapse, OpticsPath};
use super::optics_stage::{OpticsOutput, OpticsStage};
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_optics::Options;
use std::path::PathBuf;

/// Sees scene after scene of the same bands through one lens. Of these no irradiance is kept: each
/// is seen once.
pub(crate) struct KeptOptics {
    options: Options,
    /// Where a traced lens is kept, if anywhere.
    directory: Option<PathBuf>,
    path: OpticsPath,
    through: Option<Through>,
}

enum Through {
    Bands(OneLens),
    Collapsed(Box<Collapse>),
}

impl KeptOptics {
    /// As `stage` says, without a lens so far.
    pub fn new(stage: &OpticsStage) -> Self {
        let OpticsStage { options, cache, path, .. } = stage;
        Self { options: *options, directory: cache.clone(), path: *path, through: None }
    }

    /// The path asked for.
    pub fn path(&self) -> OpticsPath {
        self.path
    }

    /// What falls on the sensor from a scene; `progress` hears of bands done and bands in all.
    ///
    /// # Errors
    /// A lens that cannot be read, a scene that cannot be rendered, or not on this path.
    pub fn see(
        &mut self,
        camera: &Camera,
        opened: &SceneInLight,
        progress: impl FnMut(usize, usize),
    ) -> Result<OpticsOutput> {
        let Self { options, directory, path, through } = self;
        let (bands, directory) = (opened.scene.bands(), directory.as_deref());
        let light = opened.illuminant.as_ref();
        let new = through.is_none();
        let through = match through {
            Some(through) => through,
            None => through.insert(match path {
                OpticsPath::Bands => {
                    Through::Bands(OneLens::new(camera, &bands, light, options, directory)?)
                }
                path => {
                    let collapse =
                        Collapse::new(camera, &bands, light, options, directory, *path)?;
                    Through::Collapsed(Box::new(collapse))
                }
            }),
        };
        let about = opened.about(camera);
        let mut notes = opened.notes(camera);
        let ((cube, optics), collapse, lens) = match through {
            Through::Bands(lens) => {
                let seen = lens.irradiance(camera, &opened.lit(), options, about, progress)?;
                (seen, None, &*lens)
            }
            Through::Collapsed(collapse) => {
                let (cube, optics, report) = collapse.run(camera, opened, options, about)?;
                ((cube, optics), Some(report), &collapse.lens)
            }
        };
        notes.extend(lens.notes.iter().cloned());
        notes.extend(collapse.iter().map(|report| report.words()));
        Ok(OpticsOutput {
            light: opened.illuminant.clone(),
            cube,
            optics,
            cached: false,
            rebinned: opened.rebinned || collapse.is_some(),
            lens_traced: new && lens.traced,
            collapse,
            shown: opened.scene.shown(),
            notes,
        })
    }
}
