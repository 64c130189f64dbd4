//! The output of a stream, to which each raw frame is written as soon as it arrives.

use super::Args;
use crate::live::{self, LiveFrames};
use camrig_base::output::LiveOutput;
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_formats::Format;
use camrig_formats::live::{Beside, LiveEncoder};
use camrig_render::SimulatedSensor;
use camrig_render::readout::Readout;
use camrig_rig::RigFrame;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Who takes the frames of a stream.
pub trait Takes {
    /// All is ready: when the first trigger comes.
    fn begin(&mut self) -> Result<Instant> {
        Ok(Instant::now())
    }

    /// A frame that began `time_s` after the first was due, or that the sensor dropped.
    fn take(&mut self, frame: &RigFrame, sensor: &SimulatedSensor, time_s: f64) -> Result<()>;

    /// Whether frames are written as packets of CSI-2.
    fn has_packets(&self) -> bool;
}

/// An output of frames.
pub struct Output {
    path: PathBuf,
    frames: LiveFrames,
    readout: Readout,
    numbers: Numbers,
}

impl Output {
    /// Opens the output that the arguments name, if any.
    ///
    /// # Errors
    /// A format that is not a stream of frames, and those of [`LiveFrames::create`].
    pub fn open(args: &Args) -> Result<Option<Self>> {
        let Some(path) = &args.output else { return Ok(None) };
        live::check_figures(path, args.json)?;
        let encoder = LiveEncoder::new(format(path, args.to.as_deref())?, args.fps);
        let encoder = encoder.map_err(|e| {
            e.at(path.display()).help(
                "write a rig's frames as .csi2, .mcap, .pgm, .y4m or headerless pixels \
                 (NAME_640x480_SGRBG10P.raw); `camrig convert` converts them to other formats",
            )
        })?;
        let frames = LiveFrames::create(path, args.force, encoder)?;
        Ok(Some(Self {
            path: path.clone(),
            frames,
            readout: Readout::default(),
            numbers: Numbers::default(),
        }))
    }

    /// A recording that begins within a stream of `fps` frames per second.
    ///
    /// # Errors
    /// Those of [`Self::open`], a file that exists.
    pub fn recording(path: PathBuf, fps: f64, camera: &Camera) -> Result<Self> {
        let encoder = LiveEncoder::new(format(&path, None)?, Some(fps))?;
        let mut frames = LiveFrames::create(&path, false, encoder)?;
        if frames.has_camera() {
            frames.set_camera(live::figures(camera)?);
        }
        Ok(Self { path, frames, readout: Readout::default(), numbers: Numbers::default() })
    }

    /// Sets the camera's intrinsics if the format stores them, and refuses a sensor whose frames it
    /// cannot store.
    pub fn prepare(
        &mut self,
        args: &Args,
        camera: &Camera,
        sensor: &SimulatedSensor,
    ) -> Result<()> {
        self.readout = args.readout.readout();
        if self.frames.has_camera() {
            self.frames.set_camera(args.readout.figures(camera)?);
        }
        let pixels = sensor.config.width as usize * sensor.config.height as usize;
        self.frames.check(&self.readout.of(sensor.raw_frame(vec![0; pixels], 1.0))?)
    }

    /// Refuses an output that received no frame.
    pub fn check_any(&self) -> Result<()> {
        match self.count() {
            0 => Err(Error::input("every frame was dropped, as requested")),
            _ => Ok(()),
        }
    }

    /// Writes what follows the last frame.
    pub fn finish(&mut self) -> Result<()> {
        self.frames.finish()
    }

    /// Frames written.
    pub fn count(&self) -> u64 {
        self.frames.count()
    }

    /// The path of the output.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Takes for Output {
    fn take(&mut self, frame: &RigFrame, sensor: &SimulatedSensor, time_s: f64) -> Result<()> {
        let number = self.numbers.of(frame.start.counter);
        if frame.dropped {
            return Ok(());
        }
        let beside = Beside {
            number: Some(number),
            embedded: vec![frame.embedded_line()],
            line_packets: true,
            damage: frame.damage.clone(),
            time_s: Some(time_s),
        };
        self.frames.write(&self.readout.of(frame.to_raw(sensor)?)?, &beside)
    }

    fn has_packets(&self) -> bool {
        self.frames.has_packets()
    }
}

/// The format asked for, or that of the name; on standard output CSI-2.
fn format(path: &Path, to: Option<&str>) -> Result<Format> {
    match live::format(path, to)? {
        Some(format) => Ok(format),
        None if LiveOutput::is_stdout(path) => Ok(Format::Csi2),
        None => Format::from_path(path).map_err(|e| e.help("end the name in .csi2, or give --to")),
    }
}

/// CSI-2 frame numbers that follow the sensor's counter: 1 for the first frame of the stream, up
/// to 65535 and then 1 again. A lost frame leaves a gap, a stuck counter repeats.
#[derive(Default)]
struct Numbers {
    counted: u64,
    last: Option<u16>,
}

impl Numbers {
    fn of(&mut self, counter: u16) -> u16 {
        self.counted += u64::from(counter.wrapping_sub(self.last.unwrap_or(counter)));
        self.last = Some(counter);
        (self.counted % u64::from(u16::MAX) + 1) as u16
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_numbers_follow_the_counter() {
        let numbers = |counters: &[u16]| {
            let mut numbers = Numbers::default();
            counters.iter().map(|&c| numbers.of(c)).collect::<Vec<_>>()
        };
        assert_eq!(numbers(&[57, 58, 60, 60, 61]), [1, 2, 4, 4, 5]);
        let mut of = Numbers { counted: 65533, last: Some(65534) };
        assert_eq!([65535, 0, 1].map(|counter| of.of(counter)), [65535, 1, 2]);
    }

    #[test]
    fn the_format_is_that_of_the_name() {
        let encoder = |name: &str, to| LiveEncoder::new(format(Path::new(name), to)?, None);
        for name in ["a/x.csi2", "x.mcap", "x.pgm", "x.y4m", "x_64x48_SGRBG10P.raw", "-"] {
            assert!(encoder(name, None).is_ok(), "{name}");
        }
        for name in ["x.dng", "x.npy", "x.raw10", "x", ".csi2", "x.tiff"] {
            assert!(encoder(name, None).is_err(), "{name}");
        }
        assert!(encoder("pipe", Some("SGRBG16")).is_ok());
        assert!(encoder("x.dng", Some("csi2")).is_err());
        assert!(encoder("-", Some("npy")).is_err());
    }
}
