//! Frames of a rig in the light of a scene or of irradiance files, one after another.

use super::scene_lights::{NextLight, SceneLights};
use crate::stop::Stoppable;
use camrig_base::output::LiveOutput;
use camrig_base::{Error, Result};
use camrig_exposure::IrradianceCube;
use camrig_render::SimulatedSensor;
use camrig_rig::{Faults, FrameRequest, Mirror, Rig, RigFrame, feed::Feed};
use serde_json::json;
use std::path::PathBuf;
use std::time::Instant;

/// Memory for rows encoded for the link, bytes: if all cubes fit, their rows are encoded once for
/// all frames. A trade-off: any workstation can spare a gibibyte.
pub const KEPT_BYTES: usize = 1 << 30;

/// Faults by schedule.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct FaultArgs {
    /// Schedule of faults: lines such as `17: drop`, `100-130: freeze`, `140: row 30 corrupt` and
    /// `every 50 from 200: late 4 ms`, by the number of the frame from 0. Others: repeat; black;
    /// white; rows 10-19 lost; bit errors 1e-5; stuck counter; stuck registers (what is written
    /// before the frame is lost). Of CSI-2 packets: row 30 ecc 1 (one wrong bit in its header), ecc
    /// 2, crc, no packet, short, word count, channel, data type; no frame start; no frame end
    #[arg(long, value_name = "FILE")]
    faults: Option<PathBuf>,
    /// Write what the schedule did to each frame, a JSON object on a line
    #[arg(long, value_name = "FILE", requires = "faults")]
    fault_log: Option<PathBuf>,
}

/// A schedule, and where it is written what it did.
pub struct Injection {
    faults: Faults,
    log: Option<LiveOutput>,
}

impl FaultArgs {
    /// Whether there is a schedule.
    pub fn is_given(&self) -> bool {
        self.faults.is_some()
    }

    /// The faults of a sensor's frames, which go out as packets or not; an existing log is replaced
    /// only with `force`.
    pub fn open(
        &self,
        sensor: &SimulatedSensor,
        as_packets: bool,
        force: bool,
    ) -> Result<Option<Injection>> {
        let Some(path) = &self.faults else { return Ok(None) };
        let faults = Faults::load(path, sensor.config.height)?;
        if let (false, Some(fault)) = (as_packets, faults.of_packets()) {
            return Err(Error::input(format!("{fault:?} of frames that are no packets"))
                .at(path.display())
                .help("it shows in CSI-2 alone: camrig rig stream ... -o FILE.csi2"));
        }
        let log = self.fault_log.as_ref().map(|path| LiveOutput::create(path, force));
        Ok(Some(Injection { faults, log: log.transpose()? }))
    }
}

impl Injection {
    fn apply(&mut self, frame: u32, taken: &mut RigFrame, sensor: &SimulatedSensor) -> Result<()> {
        let shape = (sensor.config.width as usize, sensor.config.bits.into());
        let faults = self.faults.apply(frame, taken, shape)?;
        if !taken.dropped {
            Stoppable::new().sleep_until(Instant::now() + self.faults.delay(frame));
        }
        let Some(log) = &mut self.log else { return Ok(()) };
        log.push(
            format!("{}\n", json!({ "frame": frame, "dropped": taken.dropped, "faults": faults }))
                .as_bytes(),
        )
    }
}

/// The light of the frames, and what of it a rig has been given.
pub struct RigFrames<'a> {
    /// Irradiance of the frames, repeated in turn; that of frame 0 for a changing scene.
    cubes: &'a [IrradianceCube],
    /// A sensor for each of the cubes.
    sensors: &'a [SimulatedSensor],
    feeds: Vec<Feed<'a>>,
    scene: Option<&'a mut SceneLights>,
    collapse: bool,
    /// Whether all frames have the same light.
    still: bool,
    /// Irradiance of a scene that has changed since the first frame.
    changed: Option<IrradianceCube>,
    /// Cubes of one light level have one sensor on the rig; another level is another one.
    level: f64,
    previous_exposure_s: Option<f32>,
    /// For light that changes while rows collect it, in exposures from registers.
    mirror: Option<Mirror>,
    /// The exposure that such light was made for, s.
    made_for_s: Option<f32>,
    injection: Option<Injection>,
}

fn feed<'a>(cube: &'a IrradianceCube, sensor: &'a SimulatedSensor, collapse: bool) -> Feed<'a> {
    if collapse { Feed::collapsed(cube, sensor) } else { Feed::spectral(cube) }
}

impl<'a> RigFrames<'a> {
    /// Frames in the light of `cubes`, or of `scene` with its first cube; with `collapse` as mean
    /// electrons.
    pub fn new(
        cubes: &'a [IrradianceCube],
        sensors: &'a [SimulatedSensor],
        scene: Option<&'a mut SceneLights>,
        collapse: bool,
    ) -> Self {
        let mut feeds: Vec<Feed<'_>> =
            cubes.iter().zip(sensors).map(|(cube, s)| feed(cube, s, collapse)).collect();
        if feeds.iter().map(Feed::bytes).sum::<usize>() <= KEPT_BYTES {
            feeds = feeds.into_iter().map(Feed::kept).collect();
        }
        let still = cubes.len() == 1 && scene.as_ref().is_none_or(|s| s.stand_still());
        Self {
            cubes,
            sensors,
            feeds,
            scene,
            collapse,
            still,
            changed: None,
            level: cubes[0].header.level,
            previous_exposure_s: None,
            mirror: None,
            made_for_s: None,
            injection: None,
        }
    }

    /// The same with faults.
    #[must_use]
    pub fn with_faults(self, injection: Option<Injection>) -> Self {
        Self { injection, ..self }
    }

    /// Gives the rig the sensor of the first frame.
    ///
    /// # Errors
    /// Those of [`Rig::set_camera`].
    pub fn begin(&self, rig: &mut Rig) -> Result<()> {
        rig.set_camera(&self.sensors[0])
    }

    /// The sensor of a frame.
    pub fn sensor(&self, frame: u32) -> &'a SimulatedSensor {
        &self.sensors[frame as usize % self.sensors.len()]
    }

    /// Whether what is written to the sensor before a frame is lost.
    pub fn has_stuck_registers(&self, frame: u32) -> bool {
        self.injection.as_ref().is_some_and(|i| i.faults.has_stuck_registers(frame))
    }

    /// The sensor has stood by: what was written takes effect at once.
    pub fn stood_by(&mut self) {
        self.mirror = None;
    }

    /// Makes the light of a frame; false if the scene is over. The exposure, s, is that of the
    /// rig's registers if none is given.
    ///
    /// # Errors
    /// A scene that cannot be read, a link that fails.
    pub fn light(&mut self, rig: &mut Rig, frame: u32, exposure_s: Option<f64>) -> Result<bool> {
        let Some(scene) = &mut self.scene else { return Ok(true) };
        let in_time = scene.change_within_frames();
        self.made_for_s = in_time.then_some(exposure_s.unwrap_or(1.0) as f32);
        if let (true, None, Some(times)) = (in_time, exposure_s, scene.times()) {
            let coming = self.mirror.get_or_insert_default().next_frame(rig)?;
            times.set(coming.lines, coming.line_ns);
            self.made_for_s = Some(coming.exposure_s);
        }
        let exposure_s = self.made_for_s.unwrap_or(1.0);
        match scene.next(frame, exposure_s.into(), &self.cubes[0])? {
            NextLight::Same => {}
            NextLight::Changed(cube) => self.changed = Some(cube),
            NextLight::Over => return Ok(false),
        }
        Ok(true)
    }

    /// Takes a frame whose light has been made. What the request says of the light is overwritten.
    ///
    /// # Errors
    /// Those of [`Rig::frame_from`].
    pub fn take(
        &mut self,
        rig: &mut Rig,
        frame: u32,
        mut request: FrameRequest,
    ) -> Result<RigFrame> {
        let at = frame as usize % self.cubes.len();
        let sensor = self.sensor(frame);
        if self.level != self.cubes[at].header.level {
            self.level = self.cubes[at].header.level;
            rig.set_camera(sensor)?;
        }
        request.collapse = self.collapse;
        request.lit_before = self.previous_exposure_s.is_some() && self.still;
        request.settings.previous_exposure_s = self.previous_exposure_s;
        let mut taken = match &self.changed {
            Some(cube) => rig.frame_from(&mut feed(cube, sensor, self.collapse), sensor, &request),
            None => rig.frame_from(&mut self.feeds[at], sensor, &request),
        }?;
        self.previous_exposure_s = Some(taken.start.exposure.exposure_s);
        if let Some(injection) = &mut self.injection {
            injection.apply(frame, &mut taken, sensor)?;
        }
        Ok(taken)
    }

    /// Whether light was made for another exposure than the frame got.
    pub fn missed(&self, frame: &RigFrame) -> bool {
        self.made_for_s.is_some_and(|made_for| made_for != frame.start.exposure.exposure_s)
    }
}
