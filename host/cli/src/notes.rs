//! Notes: what a user should know about a result. Each is printed once on standard error, and kept
//! for `--json`. A console page gets every occurrence, and counts them.

use camrig_base::{Bands, Result};
use camrig_camera::Camera;
use camrig_exposure::CubeHeader;
use camrig_render as render;

/// Notes printed so far.
#[derive(Default)]
pub struct Notes {
    all: Vec<String>,
    /// Number of notes about single frames that were printed, and that were suppressed.
    of_frames: usize,
    left: usize,
    page: Option<Box<dyn Page>>,
}

/// A page that shows the notes printed on the terminal.
pub trait Page: Send {
    /// A note, or a warning.
    fn note(&self, text: &str);

    /// What the program is waiting for, until the next call.
    fn waits_for(&self, what: String);
}

/// Maximum number of notes about single frames: those of a long sequence could fill the screen.
const TOLD_OF_FRAMES: usize = 3;

impl Notes {
    /// Notes that also appear on `page`.
    pub fn on_page(page: impl Page + 'static) -> Self {
        Self { page: Some(Box::new(page)), ..Self::default() }
    }

    /// Notes after these have been printed.
    pub fn after(self, told: Vec<String>) -> Self {
        Self { all: told, ..self }
    }

    /// Shows on the page what the program is waiting for.
    pub fn wait_for(&self, what: impl FnOnce() -> String) {
        if let Some(page) = &self.page {
            page.waits_for(what());
        }
    }

    fn show(&self, text: &str) {
        self.page.iter().for_each(|page| page.note(text));
    }

    /// Prints a warning, which is not a note about the result.
    pub fn warn(&self, warning: &str) {
        eprintln!("warning: {warning}");
        self.show(warning);
    }

    /// Prints the notes that have not been printed yet; those that begin with `warning: ` as such.
    pub fn tell(&mut self, notes: impl IntoIterator<Item = String>) {
        for note in notes {
            self.show(&note);
            if !self.all.contains(&note) {
                match note.starts_with("warning: ") {
                    true => eprintln!("{note}"),
                    false => eprintln!("note: {note}"),
                }
                self.all.push(note);
            }
        }
    }

    /// Prints what was assumed about a camera's tables in this light.
    pub fn tell_tables(&mut self, camera: &Camera, light: impl IntoIterator<Item = Bands>) {
        self.tell(light.into_iter().flat_map(|bands| camera.notes(&bands)));
    }

    /// Prints the notes about irradiance made for `camera`: what could not be checked, and what was
    /// assumed about the camera's tables and lens.
    ///
    /// # Errors
    /// A lens that cannot be read.
    pub fn tell_irradiance(&mut self, camera: &Camera, header: &CubeHeader) -> Result<()> {
        self.tell(render::unchecked(camera, header));
        self.tell(render::missing(camera, header));
        let bands = render::light_bands(header);
        self.tell_tables(camera, [bands]);
        if !header.made_for.is_empty() {
            self.tell(render::lens_notes(camera, &bands)?);
        }
        Ok(())
    }

    /// Prints a note about a later frame, up to a maximum number.
    pub fn tell_of(&mut self, frame: &str, note: String) {
        if self.all.contains(&note) {
            return self.show(&note);
        }
        if self.of_frames == TOLD_OF_FRAMES {
            self.left += 1;
            return self.show("further notes about single frames are not shown");
        }
        self.of_frames += 1;
        eprintln!("note: {frame}: {note}");
        self.show(&note);
        self.all.push(note);
    }

    /// Prints how many notes about single frames were suppressed.
    pub fn tell_left(&self) {
        if self.left > 0 {
            eprintln!("note: {} more notes about single frames were not shown", self.left);
        }
    }

    /// The notes printed, in order.
    pub fn all(&self) -> &[String] {
        &self.all
    }
}
