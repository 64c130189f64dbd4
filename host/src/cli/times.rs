//! Light that changes while rows collect it: what asks for it, and the windows of frame after
//! frame.

use super::arguments::choice;
use camrig_base::{Error, Result};
use camrig_camera::{Camera, FrameClock, RowWindows, SensorTiming};
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
    /// A lamp whose light changes with time: mains:hz=100,depth=0.3 (the light's frequency, twice
    /// that of the mains) or pulse:hz=90,duty=0.1; phase=PERIODS; share=PART of the light, the rest
    /// being steady or other lamps'; region=X,Y,WIDTH,HEIGHT, as parts of the frame, of a lamp that
    /// alone lights that part of a still scene, and no other region. Needs [sensor.timing] in the
    /// camera file
    #[arg(long = "lamp", value_name = "WAVE")]
    pub lamps: Vec<Lamp>,
}

/// What the light does while rows collect it.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct TimeArgs {
    #[command(flatten)]
    pub lamps: LampArgs,
    /// How light goes on from one frame of a sequence to the next, where the camera file has
    /// [sensor.timing] (linear unless given)
    #[arg(long, value_name = "HOW", value_parser = between())]
    pub between: Option<Between>,
}

fn between() -> impl TypedValueParser<Value = Between> {
    choice(&Between::ALL, Between::name, |between| match between {
        Between::Linear => "in a straight line",
        Between::Hold => "it stays until the next is shown",
    })
}

/// The windows in which rows collect light, frame after frame, and the light's own changes.
pub struct Times {
    clock: FrameClock,
    timing: SensorTiming,
    /// Frame period that was asked for, s.
    period_s: Option<f64>,
    /// Lamps on the scene.
    pub lamps: Lamps,
    /// Between frames of a sequence.
    pub between: Between,
}

/// Refuses lamps that fall on a part of what is no still scene.
pub fn refuse_regions(lamps: &Lamps, of: &str) -> Result<()> {
    match lamps.regions() {
        [] => Ok(()),
        _ => Err(Error::unsupported(format!("a lamp on a region of {of}"))
            .help("leave region= out, or let the scene stand still")),
    }
}

/// Gives a rig whose registers decide them its line time, ns, and frame length. In standby, so that
/// these and all that is written before the next frame take effect with it, also in a rig that has
/// run before.
pub fn program(rig: &mut Rig, (line_ns, lines): (u32, u32)) -> Result<()> {
    let mode = rig.read_register(address::MODE_SELECT)?;
    rig.write_register(address::MODE_SELECT, 0)?;
    rig.write_register(address::LINE_LENGTH_NS, line_ns)?;
    rig.write_register(address::FRAME_LENGTH_LINES, lines)?;
    rig.write_register(address::MODE_SELECT, mode)
}

/// Refuses a flag for a camera whose file does not say when rows collect light.
fn timing_for(flag: &str, camera: &Camera) -> Result<SensorTiming> {
    camera.sensor.timing.ok_or_else(|| {
        Error::input(format!("{flag} for {}, whose file has no timing", camera.name))
            .at("[sensor.timing]")
            .help("give the sensor's line time: --set sensor.timing.line_time_us=20")
    })
}

impl LampArgs {
    /// The lamps, in front of a camera whose rows have their times.
    pub fn of(&self, camera: &Camera) -> Result<Lamps> {
        if !self.lamps.is_empty() {
            timing_for("--lamp", camera)?;
        }
        Lamps::new(self.lamps.clone())
    }
}

impl TimeArgs {
    /// Whether anything is asked for.
    pub fn is_given(&self) -> bool {
        !self.lamps.lamps.is_empty() || self.between.is_some()
    }

    /// The times of a camera's frames at this rate; none of a camera whose file has no timing.
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
    /// The windows of the next frame, for its exposure.
    pub fn next(&mut self, exposure_s: f64) -> Result<RowWindows> {
        self.clock.next(exposure_s)
    }

    /// Lines and line time as a rig's registers have them from the next frame on.
    pub fn set(&mut self, lines: u16, line_ns: u32) {
        self.timing.line_time_us = 1e-3 * f64::from(line_ns);
        self.timing.frame_length_lines = lines.into();
        self.period_s = None;
        self.clock.set(self.timing);
    }

    /// Line time, ns, and frame length as a rig's registers take them.
    pub fn registers(&self) -> (u32, u32) {
        let SensorTiming { line_time_us, frame_length_lines, .. } = self.timing;
        let lines = self.period_s.map(|period_s| 1e6 * period_s / line_time_us);
        let lines = lines.map_or(frame_length_lines, |lines| lines.round() as u32);
        ((1e3 * line_time_us).round() as u32, lines)
    }

    /// Frame period of an exposure, s.
    pub fn period_s(&self, exposure_s: f64) -> f64 {
        self.period_s.unwrap_or_else(|| self.timing.period_s(exposure_s))
    }

    /// What falls on rows in the light of the lamps, and on `parts` in that of their regions'
    /// lamps; nothing where it is steady.
    pub fn lit(
        &self,
        cube: &IrradianceCube,
        parts: &[IrradianceCube],
        windows: &RowWindows,
    ) -> Result<Option<IrradianceCube>> {
        lamp_rows(cube, parts, windows, &self.lamps)
    }

    /// Figures for programs, of frames of that exposure.
    pub fn figures(&self, exposure_s: f64) -> Value {
        json!({
            "line_time_us": self.timing.line_time_us,
            "frame_period_s": self.period_s(exposure_s),
            "between": self.between.name(),
        })
    }
}
