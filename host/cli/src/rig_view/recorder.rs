//! Recording of the console's frames.

use super::{Args, files};
use crate::rig_stream::output::{Output, Takes};
use crate::view::{Recording, Shared};
use camrig_base::Result;
use camrig_base::numbers::counted;
use camrig_camera::Camera;
use camrig_render::SimulatedSensor;
use camrig_rig::RigFrame;

/// Records frames while it is switched on.
pub struct Recorder<'a> {
    args: &'a Args,
    camera: &'a Camera,
    shared: &'a Shared,
    output: Option<Output>,
}

impl<'a> Recorder<'a> {
    /// A recorder that is switched off.
    pub fn new(args: &'a Args, camera: &'a Camera, shared: &'a Shared) -> Self {
        Self { args, camera, shared, output: None }
    }

    /// Starts recording, unless it runs already. The page reports errors.
    pub fn begin(&mut self) {
        if self.output.is_some() {
            return;
        }
        let Args { output, to, fps, .. } = self.args;
        match files::record(self.camera, output, to, *fps) {
            Ok(output) => self.output = Some(output),
            Err(error) => self.shared.change(|state| state.fault("page", &error)),
        }
        self.tell();
    }

    /// Writes a frame that began `time_s` after the start. A full disk ends the recording, not the
    /// stream.
    pub fn take(&mut self, frame: &RigFrame, sensor: &SimulatedSensor, time_s: f64) {
        let Some(output) = &mut self.output else { return };
        if let Err(error) = output.take(frame, sensor, time_s) {
            self.shared.change(|state| state.fault("page", &error));
            self.end();
        }
        self.tell();
    }

    /// Ends the recording, and reports where it is.
    pub fn end(&mut self) {
        let Some(mut output) = self.output.take() else { return };
        let finished = output.finish();
        let (frames, path) = (output.count(), output.path().display());
        self.shared.change(|state| match finished {
            Ok(()) => state
                .note("page", format!("{} recorded: {path}", counted(frames as usize, "frame"))),
            Err(error) => state.fault("page", &error),
        });
        self.tell();
    }

    /// Completes a recording at the end of the stream.
    ///
    /// # Errors
    /// What the operating system refuses.
    pub fn finish(&mut self) -> Result<()> {
        self.output.as_mut().map_or(Ok(()), Output::finish)
    }

    fn tell(&self) {
        let recording = self.output.as_ref().map(|output| Recording {
            path: output.path().display().to_string(),
            frames: output.count(),
        });
        self.shared.change(|state| state.recording = recording);
    }
}
