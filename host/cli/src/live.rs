//! Frames that are written as they arrive: to a growing file, a named pipe or standard output.

use camrig_base::output::LiveOutput;
use camrig_base::{Error, RawFrame, Result};
use camrig_camera::Camera;
use camrig_formats::live::{Beside, LiveEncoder};
use camrig_formats::mcap::CameraInfo;
use camrig_formats::{Format, csi2};
use std::path::Path;

/// The format of an output: the one asked for, which its name must not contradict, or that of its
/// name. `None` if neither determines one.
pub fn format(path: &Path, to: Option<&str>) -> Result<Option<Format>> {
    let named = Format::from_path(path).ok();
    let Some(to) = to else { return Ok(named) };
    let asked = Format::parse(to).map_err(|e| e.at("--to"))?;
    match named {
        Some(named) if named != asked => {
            Err(Error::disagreement(format!("{asked} under a name of {named}"))
                .at(path.display())
                .help("change the name, or omit --to"))
        }
        _ => Ok(Some(asked)),
    }
}

/// Refuses figures on a standard output that carries frames.
pub fn check_figures(path: &Path, json: bool) -> Result<()> {
    if json && LiveOutput::is_stdout(path) {
        return Err(Error::input("frames and figures both on standard output")
            .help("write the frames to a file or a named pipe, or omit --json"));
    }
    Ok(())
}

/// Where frames go.
pub struct LiveFrames {
    output: LiveOutput,
    encoder: LiveEncoder,
    frames: u64,
}

impl LiveFrames {
    /// Opens an output; a named pipe waits for its reader.
    pub fn create(path: &Path, force: bool, encoder: LiveEncoder) -> Result<Self> {
        Ok(Self { output: LiveOutput::create(path, force)?, encoder, frames: 0 })
    }

    /// Sets the frame rate before the first frame.
    pub fn set_rate(&mut self, frames_per_s: Option<f64>) {
        self.encoder.set_rate(frames_per_s);
    }

    /// Whether the format stores a camera's intrinsics.
    pub fn has_camera(&self) -> bool {
        self.encoder.has_camera()
    }

    /// Sets the camera's intrinsics.
    pub fn set_camera(&mut self, figures: CameraInfo) {
        self.encoder.set_camera(figures);
    }

    /// Whether frames are written as packets of CSI-2.
    pub fn has_packets(&self) -> bool {
        self.encoder.has_packets()
    }

    /// Refuses frames that the format cannot hold.
    pub fn check(&self, like: &RawFrame) -> Result<()> {
        self.encoder.check(like)
    }

    /// Writes the next frame, whole.
    pub fn write(&mut self, frame: &RawFrame, beside: &Beside) -> Result<()> {
        if self.frames == 0 {
            tell(&self.encoder, frame);
        }
        self.output.push(&self.encoder.encode(frame, beside)?)?;
        self.frames += 1;
        Ok(())
    }

    /// Writes the next frame, of more than 16 bits.
    pub fn write_wide(&mut self, frame: &RawFrame<u32>, beside: &Beside) -> Result<()> {
        self.output.push(&self.encoder.encode_wide(frame, beside)?)?;
        self.frames += 1;
        Ok(())
    }

    /// Writes the captures of the next exposure on their virtual channels, and returns whether the
    /// format has such.
    pub fn write_captures(&mut self, captures: &[csi2::Sent<'_>]) -> Result<bool> {
        let Some(bytes) = self.encoder.encode_captures(captures)? else { return Ok(false) };
        self.output.push(&bytes)?;
        self.frames += 1;
        Ok(true)
    }

    /// Frames written.
    pub fn count(&self) -> u64 {
        self.frames
    }

    /// Writes what follows the last frame.
    pub fn finish(&mut self) -> Result<()> {
        match self.encoder.finish()? {
            end if end.is_empty() => Ok(()),
            end => self.output.push(&end),
        }
    }
}

/// The intrinsics of a camera; prints a note if they describe its lens badly.
pub fn figures(camera: &Camera) -> Result<CameraInfo> {
    /// Errors below this are beyond what calibration of a real camera reaches, pixels.
    const TOLD_PX: f64 = 0.1;
    let found = camrig_render::intrinsics(camera)?;
    if found.largest_error_px > TOLD_PX {
        eprintln!(
            "note: CameraInfo describes the lens's distortion to within {:.2} pixels: plumb_bob \
             has no more terms",
            found.largest_error_px
        );
    }
    Ok(found.info)
}

/// Prints what the format of a stream cannot store.
pub fn tell(encoder: &LiveEncoder, frame: &RawFrame) {
    encoder.notes(frame).iter().for_each(|note| eprintln!("note: {note}"));
}

/// An output's name in a message.
pub fn named(path: &Path) -> String {
    if LiveOutput::is_stdout(path) {
        return "standard output".into();
    }
    path.display().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_and_a_format_must_agree() {
        let of = |path: &str, to| format(Path::new(path), to).map(|f| f.map(|f| f.to_string()));
        let known = |format: &str| Some(format.to_string());
        assert_eq!(of("a.csi2", None).unwrap(), known("csi2"));
        assert_eq!(of("-", Some("SRGGB10P")).unwrap(), known("SRGGB10P"));
        assert_eq!(of("a.raw", Some("SRGGB10P")).unwrap(), known("SRGGB10P"));
        assert_eq!(of("-", None).unwrap(), None);
        let said = of("a.dng", Some("csi2")).unwrap_err().to_string();
        assert!(said.contains("csi2 under a name of dng"), "{said}");
        assert!(of("a_64x48_SGRBG10.raw", Some("SGRBG16")).is_err());
        assert!(check_figures(Path::new("-"), true).is_err());
        assert!(check_figures(Path::new("a.csi2"), true).is_ok());
    }
}
