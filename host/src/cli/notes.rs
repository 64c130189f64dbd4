//! Notes: what a user should know of a result. Each is told once on standard error, and kept for
//! `--json`. Where a page is open beside the terminal, it hears of each as often as there is cause
//! for it, and counts.

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
    page: Option<Box<dyn Page>>,
}

/// A page that shows what the terminal is told.
pub trait Page: Send {
    /// A note, or a warning.
    fn note(&self, text: &str);

    /// What is waited for, until the next call of it.
    fn waits_for(&self, what: String);
}

/// Most notes of single frames that are told: those of a long sequence could fill the screen.
const TOLD_OF_FRAMES: usize = 3;

impl Notes {
    /// Notes that `page` hears, too.
    pub fn on_page(page: impl Page + 'static) -> Self {
        Self { page: Some(Box::new(page)), ..Self::default() }
    }

    /// After these were told.
    pub fn after(self, told: Vec<String>) -> Self {
        Self { all: told, ..self }
    }

    /// Says on the page what is waited for.
    pub fn wait_for(&self, what: impl FnOnce() -> String) {
        if let Some(page) = &self.page {
            page.waits_for(what());
        }
    }

    fn show(&self, text: &str) {
        self.page.iter().for_each(|page| page.note(text));
    }

    /// Tells a warning, which is no note of the result.
    pub fn warn(&self, warning: &str) {
        eprintln!("warning: {warning}");
        self.show(warning);
    }

    /// Tells what has not been told yet.
    pub fn tell(&mut self, notes: impl IntoIterator<Item = String>) {
        for note in notes {
            self.show(&note);
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
            return self.show(&note);
        }
        if self.of_frames == TOLD_OF_FRAMES {
            self.left += 1;
            return self.show("notes of single frames beyond these are not told");
        }
        self.of_frames += 1;
        eprintln!("note: {frame}: {note}");
        self.show(&note);
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
