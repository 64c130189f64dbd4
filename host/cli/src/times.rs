//! Light that changes while rows collect it: its arguments, and the row windows of frames.

use super::arguments::choice;
use camrig_base::{Error, Result};
use camrig_camera::{Camera, FrameClock, FramePeriod, RowWindows, SensorTiming};
use camrig_exposure::IrradianceCube;
use camrig_light::{Lamp, Lamps};
use camrig_render::lamp_rows;
use camrig_rig::Rig;
use camrig_rig_link::registers::address;
use camrig_scene::sequence::Between;
use clap::builder::TypedValueParser;
use serde_json::{Value, json};

/// Lamps on a scene.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct LampArgs {
    /// Lamp whose light changes with time: mains:hz=100,depth=0.3 (frequency of the light, twice
    /// that of the mains) or pulse:hz=90,duty=0.1; phase=PERIODS; share=FRACTION of the light, the
    /// rest being steady or from other lamps; region=X,Y,WIDTH,HEIGHT in fractions of the frame: an
    /// area of a still scene lit by this lamp alone. Repeatable; needs [sensor.timing] in the
    /// camera file
    #[arg(long = "lamp", value_name = "WAVE")]
    pub lamps: Vec<Lamp>,
}

/// What the light does while rows collect it.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct TimeArgs {
    #[command(flatten)]
    pub lamps: LampArgs,
    /// How light changes from one scene frame to the next, if the camera file has [sensor.timing]
    /// [default: linear]
    #[arg(long, value_name = "HOW", value_parser = between())]
    pub between: Option<Between>,
}

fn between() -> impl TypedValueParser<Value = Between> {
    choice(&Between::ALL, Between::name, |between| match between {
        Between::Linear => "interpolated linearly",
        Between::Hold => "held until the next frame",
    })
}

/// The row windows of frame after frame, and the changes of the light.
pub struct Times {
    clock: FrameClock,
    timing: SensorTiming,
    /// Requested frame period, s.
    period_s: Option<f64>,
    /// Lamps on the scene.
    pub lamps: Lamps,
    /// Between frames of a sequence.
    pub between: Between,
}

/// Refuses lamps on regions unless the scene is still.
pub fn refuse_regions(lamps: &Lamps, of: &str) -> Result<()> {
    match lamps.regions() {
        [] => Ok(()),
        _ => Err(Error::unsupported(format!("a lamp on a region of {of}"))
            .help("omit region=, or use a still scene")),
    }
}

/// Writes line time, ns, and frame length to a rig's registers, in standby, so that these and all
/// later writes take effect with the next frame, even in a rig that has been running.
pub fn program(rig: &mut Rig, (line_ns, lines): (u32, u32)) -> Result<()> {
    let mode = rig.read_register(address::MODE_SELECT)?;
    rig.write_register(address::MODE_SELECT, 0)?;
    rig.write_register(address::LINE_LENGTH_NS, line_ns)?;
    rig.write_register(address::FRAME_LENGTH_LINES, lines)?;
    rig.write_register(address::MODE_SELECT, mode)
}

/// Refuses a flag for a camera without timing.
fn timing_for(flag: &str, camera: &Camera) -> Result<SensorTiming> {
    camera.sensor.timing.ok_or_else(|| {
        Error::input(format!("{flag} for {}, a camera without timing", camera.name))
            .at("[sensor.timing]")
            .help("give the sensor's line time: --set sensor.timing.line_time_us=20")
    })
}

/// How long the frames of a camera are, at this rate if it is given.
pub fn frame_period(camera: &Camera, fps: Option<f64>) -> Result<FramePeriod> {
    FramePeriod::new(camera.sensor.timing, camera.sensor.height, fps.map(|fps| 1.0 / fps))
}

impl LampArgs {
    /// The lamps, for a camera with timing.
    pub fn of(&self, camera: &Camera) -> Result<Lamps> {
        if !self.lamps.is_empty() {
            timing_for("--lamp", camera)?;
        }
        Lamps::new(self.lamps.clone())
    }
}

impl TimeArgs {
    /// Whether any option is given.
    pub fn is_given(&self) -> bool {
        !self.lamps.lamps.is_empty() || self.between.is_some()
    }

    /// The times of a camera's frames at this rate; `None` for a camera without timing.
    pub fn times(&self, camera: &Camera, fps: Option<f64>) -> Result<Option<Times>> {
        let lamps = self.lamps.of(camera)?;
        if self.between.is_some() {
            timing_for("--between", camera)?;
        }
        let Some(timing) = camera.sensor.timing else { return Ok(None) };
        let period_s = fps.map(|fps| 1.0 / fps);
        let clock = FrameClock::new(timing, camera.sensor.height, period_s)?;
        let between = self.between.unwrap_or_default();
        Ok(Some(Times { clock, timing, period_s, lamps, between }))
    }
}

impl Times {
    /// The row windows of the next frame, for its exposure.
    pub fn next(&mut self, exposure_s: f64) -> Result<RowWindows> {
        self.clock.next(exposure_s)
    }

    /// Sets lines and line time to those of a rig's registers, from the next frame on.
    pub fn set(&mut self, lines: u16, line_ns: u32) {
        self.timing.line_time_us = 1e-3 * f64::from(line_ns);
        self.timing.frame_length_lines = lines.into();
        self.period_s = None;
        self.clock.set(self.timing);
    }

    /// Line time, ns, and frame length for a rig's registers.
    pub fn registers(&self) -> (u32, u32) {
        let SensorTiming { line_time_us, frame_length_lines, .. } = self.timing;
        let lines = self.period_s.map(|period_s| 1e6 * period_s / line_time_us);
        let lines = lines.map_or(frame_length_lines, |lines| lines.round() as u32);
        ((1e3 * line_time_us).round() as u32, lines)
    }

    /// Frame period of an exposure, s.
    pub fn period_s(&self, exposure_s: f64) -> Result<f64> {
        Ok(self.clock.period().of(exposure_s)?.unwrap_or_default())
    }

    /// Irradiance of rows in the light of the lamps, with `parts` for the lamps of regions; `None`
    /// if the light is steady.
    pub fn lit(
        &self,
        cube: &IrradianceCube,
        parts: &[IrradianceCube],
        windows: &RowWindows,
    ) -> Result<Option<IrradianceCube>> {
        lamp_rows(cube, parts, windows, &self.lamps)
    }

    /// Figures for `--json`, of frames with that exposure.
    pub fn figures(&self, exposure_s: f64) -> Result<Value> {
        Ok(json!({
            "line_time_us": self.timing.line_time_us,
            "frame_period_s": self.period_s(exposure_s)?,
            "between": self.between.name(),
        }))
    }
}
