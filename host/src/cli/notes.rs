//! Notes: what a user should know of a result. Each is told once on standard error, and kept for
//! `--json`.

use camrig_base::{Bands, Result};
use camrig_camera::Camera;
use camrig_exposure::CubeHeader;
use camrig_render as render;

/// Notes that were told.
#[derive(Default)]
pub struct Notes {
    all: Vec<String>,
    /// Notes of single frames that were told, and that were not.
    of_frames: usize,
    left: usize,
}

/// Most notes of single frames that are told: those of a long sequence could fill the screen.
const TOLD_OF_FRAMES: usize = 3;

impl Notes {
    /// After these were told.
    pub fn after(told: Vec<String>) -> Self {
        Self { all: told, ..Self::default() }
    }

    /// Tells what has not been told yet.
    pub fn tell(&mut self, notes: impl IntoIterator<Item = String>) {
        for note in notes {
            if !self.all.contains(&note) {
                eprintln!("note: {note}");
                self.all.push(note);
            }
        }
    }

    /// Tells what was assumed of a camera's tables in some light.
    pub fn tell_tables(&mut self, camera: &Camera, light: impl IntoIterator<Item = Bands>) {
        self.tell(light.into_iter().flat_map(|bands| camera.notes(&bands)));
    }

    /// Tells what there is to know of irradiance that was made for `camera`: what could not be
    /// checked, and what was assumed of the camera's tables and of its lens.
    ///
    /// # Errors
    /// A lens that cannot be read.
    pub fn tell_irradiance(&mut self, camera: &Camera, header: &CubeHeader) -> Result<()> {
        self.tell(render::unchecked(camera, header));
        let bands = render::light_bands(header);
        self.tell_tables(camera, [bands]);
        if !header.made_for.is_empty() {
            self.tell(render::lens_notes(camera, &bands)?);
        }
        Ok(())
    }

    /// Tells a note of a frame after the first, the first few of them.
    pub fn tell_of(&mut self, frame: &str, note: String) {
        if self.all.contains(&note) {
            return;
        }
        if self.of_frames == TOLD_OF_FRAMES {
            self.left += 1;
            return;
        }
        self.of_frames += 1;
        eprintln!("note: {frame}: {note}");
        self.all.push(note);
    }

    /// Says how many notes of single frames were not told.
    pub fn tell_left(&self) {
        if self.left > 0 {
            eprintln!("note: {} more notes of single frames were not told", self.left);
        }
    }

    /// What was told, in its order.
    pub fn all(&self) -> &[String] {
        &self.all
    }
}
