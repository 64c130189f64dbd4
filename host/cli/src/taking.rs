//! Frames of `simulate` and `expose`: the sensor stage, frame after frame.

use super::arguments::{self, FrameArgs};
use super::frame_sink::{FrameSink, Named, per_exposure};
use super::readout::ReadoutArgs;
use super::scene_lights::NextLight;
use super::times::frame_period;
use camrig_base::{Error, Plane, RawFrame, Result};
use camrig_camera::hdr::Hdr;
use camrig_camera::{Camera, Window};
use camrig_exposure::hdr::{HdrSensor, Sent};
use camrig_exposure::{CubeHeader, IrradianceCube};
use camrig_formats::csi2;
use camrig_light::Illuminant;
use camrig_render::{self as render, SimulatedSensor};
use camrig_rig::SensorStage;
use camrig_sensor_core::config::FrameSettings;

/// The light of frames 0, 1, ... in the windows of their captures: one for all, or one for each.
pub type Lights<'a> = dyn FnMut(u32, &[Window]) -> Result<Vec<NextLight>> + 'a;

/// The sensor of a camera: one that reads each pixel once, or several times.
pub enum Sensor {
    /// One capture.
    One(Box<SimulatedSensor>),
    /// Several.
    Several(Box<HdrSensor>),
}

impl Sensor {
    /// The sensor of `camera` in `light` times the light that a cube with this header was made for.
    /// Where pixels are binned, they are so before the curve.
    pub fn in_light(
        camera: &Camera,
        header: &CubeHeader,
        light: f64,
        readout: &ReadoutArgs,
    ) -> Result<Self> {
        if camera.sensor.hdr.is_none() {
            return Ok(Self::One(Box::new(SimulatedSensor::in_light(camera, header, light)?)));
        }
        let sensor = HdrSensor::in_light(camera, header, light)?;
        let sensor = if readout.bins() { sensor.before_curve() } else { sensor };
        Ok(Self::Several(Box::new(sensor)))
    }

    /// The sensor, or its most sensitive capture: what automatic exposure looks at.
    pub fn first(&self) -> &SimulatedSensor {
        match self {
            Self::One(sensor) => sensor,
            Self::Several(sensor) => &sensor.captures()[0],
        }
    }
}

/// What frames are taken of, and how they are described.
pub struct Subject<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Its sensor.
    pub sensor: &'a Sensor,
    /// Exposure before bracketing, s.
    pub exposure_s: f64,
    /// The scene's light.
    pub illuminant: Option<&'a Illuminant>,
    /// Irradiance of the first frame.
    pub first: &'a IrradianceCube,
}

/// Takes and writes the frames of a camera; returns how many. `next` computes the irradiance of
/// frames for which it differs from that of the first.
pub fn expose_frames(
    args: &FrameArgs,
    subject: &Subject<'_>,
    next: &mut Lights<'_>,
    sink: &mut FrameSink,
) -> Result<u64> {
    let Subject { camera, sensor, exposure_s, first, illuminant } = *subject;
    let stated = args.white.as_deref().map(Illuminant::parse).transpose();
    let stated = stated.map_err(|e| e.at("--white"))?;
    let white = stated.as_ref().or(illuminant);
    if white.is_none() && !camera.sensor.cfa.is_mono() {
        eprintln!("note: white is D65, as the scene's light is not known (--white says another)");
    }
    let subject = &Subject { camera, sensor, exposure_s, first, illuminant: white };
    let mut stage = match sensor {
        Sensor::One(sensor) => {
            let mut stage = opened(args)?;
            stage.set_camera(sensor)?;
            Stage::One(Box::new(stage), sensor)
        }
        Sensor::Several(sensor) => Stage::Several(Box::new(several(args, sensor)?), sensor),
    };
    sink.set_camera(|| args.readout.figures(camera))?;
    let begins = Begins::new(args, camera, exposure_s)?;
    sink.set_rate(begins.rate().filter(|_| per_exposure(camera) == 1));
    let bar = arguments::frames_bar(args.count());
    let mut taken = 0;
    // Irradiance of this frame and of the previous one, unless it is that of the first.
    let (mut now, mut last) = (Vec::new(), Vec::new());
    // Exposure of the frame before, s.
    let mut previous: Option<f32> = None;
    for i in 0..args.count() {
        if sink.is_asked_to_stop() {
            break;
        }
        let settings = args.settings(camera, exposure_s, i);
        let lights = next(i, &windows(camera, settings.exposure_s.into()))?;
        if lights.iter().any(|light| matches!(light, NextLight::Over)) {
            break;
        }
        let changed = lights.into_iter().filter_map(|light| match light {
            NextLight::Changed(cube) => Some(cube),
            NextLight::Same | NextLight::Over => None,
        });
        let changed: Vec<IrradianceCube> = changed.collect();
        let same = changed.is_empty();
        if !same {
            last = std::mem::replace(&mut now, changed);
        }
        let before = (i > 0).then_some(if same { &now[..] } else { &last[..] });
        let previous_s = previous.replace(settings.exposure_s);
        let light = Light { first, now: &now, before, previous_s };
        let is = Named { number: i, time_s: begins.of(i), ..Named::default() };
        match &mut stage {
            Stage::One(stage, sensor) => {
                let frame = one(args, stage, sensor, &light, &settings)?;
                let info = info(args, subject, camera, (light.of(0).cube, &settings))?;
                sink.write_named(&is, &args.readout.readout().of(frame)?, &info)?;
            }
            Stage::Several(stage, sensor) => {
                let sensor = (stage.as_mut(), *sensor);
                several_frames(args, subject, sensor, (&light, &settings), (&is, sink))?;
            }
        }
        taken += 1;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(taken)
}

/// When frames begin.
struct Begins {
    /// From each frame of the bracket to the next, s, where that is known.
    periods_s: Option<Vec<f64>>,
}

impl Begins {
    /// Refuses exposures longer than their frames.
    fn new(args: &FrameArgs, camera: &Camera, exposure_s: f64) -> Result<Self> {
        let period = frame_period(camera, args.fps)?;
        let steps = args.bracket.len().max(1) as u32;
        let of_step = |i| {
            let exposure_s = args.settings(camera, exposure_s, i).exposure_s.into();
            period.of(windows(camera, exposure_s).iter().map(Window::end_s).fold(0.0, f64::max))
        };
        Ok(Self { periods_s: (0..steps.min(args.count())).map(of_step).collect::<Result<_>>()? })
    }

    /// Frames/s, if all frames are equally long.
    fn rate(&self) -> Option<f64> {
        let periods_s = self.periods_s.as_ref()?;
        periods_s.iter().all(|s| *s == periods_s[0]).then(|| 1.0 / periods_s[0])
    }

    /// When frame `i` begins, s after the first.
    fn of(&self, i: u32) -> Option<f64> {
        let periods_s = self.periods_s.as_ref()?;
        let (rounds, step) = (i as usize / periods_s.len(), i as usize % periods_s.len());
        let sum = |steps: &[f64]| steps.iter().sum::<f64>();
        Some(rounds as f64 * sum(periods_s) + sum(&periods_s[..step]))
    }
}

enum Stage<'a> {
    One(Box<SensorStage>, &'a SimulatedSensor),
    Several(Box<SensorStage>, &'a HdrSensor),
}

/// When the captures of a camera collect light in a frame of this exposure.
fn windows(camera: &Camera, exposure_s: f64) -> Vec<Window> {
    match &camera.sensor.hdr {
        Some(hdr) => hdr.windows(exposure_s),
        None => vec![Window { start_s: 0.0, exposure_s }],
    }
}

/// What a sensor sees in a frame: irradiance of all its captures, or of each; none where it is
/// that of the first frame.
struct Light<'a> {
    first: &'a IrradianceCube,
    now: &'a [IrradianceCube],
    /// That of the frame before; `None` before the first.
    before: Option<&'a [IrradianceCube]>,
    /// Exposure of the frame before, s.
    previous_s: Option<f32>,
}

/// Irradiance that a capture sees.
struct Seen<'a> {
    cube: &'a IrradianceCube,
    /// That of the frame before, if there was one.
    before: Option<&'a IrradianceCube>,
}

impl<'a> Light<'a> {
    /// Irradiance of all captures, or of each.
    fn cubes(&self, cubes: &'a [IrradianceCube]) -> Vec<&'a IrradianceCube> {
        if cubes.is_empty() { vec![self.first] } else { cubes.iter().collect() }
    }

    /// What a capture sees.
    fn of(&self, capture: usize) -> Seen<'a> {
        let one = |cubes: &'a [IrradianceCube]| {
            cubes.get(capture).or(cubes.first()).unwrap_or(self.first)
        };
        Seen { cube: one(self.now), before: self.before.map(one) }
    }
}

/// The stage, here or on a rig.
fn opened(args: &FrameArgs) -> Result<SensorStage> {
    let mut stage = SensorStage::open(args.rig.as_deref(), args.arith)?;
    stage.on_broken_link(arguments::broken_link);
    if let Some(held) = stage.cleared() {
        eprintln!("note: cleared the rig's {held}, left by an earlier host");
    }
    Ok(stage)
}

/// The stage of a sensor with several captures.
fn several(args: &FrameArgs, sensor: &HdrSensor) -> Result<SensorStage> {
    if args.hdr.is_some() {
        return Err(Error::unsupported("--hdr of a sensor of several captures")
            .help("omit it: the camera's [sensor.hdr] says how they are taken"));
    }
    let mut stage = opened(args)?;
    stage.set_captures(sensor)?;
    Ok(stage)
}

/// A frame of a sensor with one capture.
fn one(
    args: &FrameArgs,
    stage: &mut SensorStage,
    sensor: &SimulatedSensor,
    light: &Light<'_>,
    settings: &FrameSettings,
) -> Result<RawFrame> {
    let (Seen { cube, before }, previous_s) = (light.of(0), light.previous_s);
    let mut take = |settings: &FrameSettings, (before, previous_s): (Option<_>, _)| {
        let mut settings = *settings;
        settings.previous_exposure_s = previous_s;
        stage.frame(sensor, cube, before, &settings)
    };
    let Some(hdr) = args.hdr else { return take(settings, (before, previous_s)) };
    if !hdr.reads_twice() && sensor.effects_with_traps() > 0 {
        return Err(Error::unsupported("persistence of rows of two exposures")
            .at("--hdr")
            .help("omit --hdr, or remove the effect from the camera file"));
    }
    let [long, short] = hdr.frames(settings.frame);
    let long = settings.with_frame(long);
    let exposure_s = settings.exposure_s / hdr.ratio() as f32;
    let short = settings.with_frame(short).with_exposure(exposure_s);
    let last_short = previous_s.map(|s| s / hdr.ratio() as f32);
    // What a pixel was exposed to before: one that is read twice, to the other of the two; others,
    // to the same of the frame before.
    let (first, second) = if hdr.reads_twice() {
        ((before, last_short), (Some(cube), Some(long.exposure_s)))
    } else {
        ((before, previous_s), (before, last_short))
    };
    let long = take(&long, first)?;
    let short = take(&short, second)?;
    hdr.interleave(&long, &short)
}

fn info(
    args: &FrameArgs,
    subject: &Subject<'_>,
    camera: &Camera,
    (cube, settings): (&IrradianceCube, &FrameSettings),
) -> Result<camrig_formats::DngInfo> {
    let (light, header) = (subject.illuminant, &cube.header);
    let mut info = render::frame_info(camera, settings, light, header, args.opcodes)?;
    let side = f64::from(args.readout.readout().side());
    info.pitch_um = info.pitch_um.map(|pitch| pitch * side);
    Ok(info)
}

/// Takes a frame of a sensor with several captures, and writes what it sends.
fn several_frames(
    args: &FrameArgs,
    subject: &Subject<'_>,
    (stage, sensor): (&mut SensorStage, &HdrSensor),
    (light, settings): (&Light<'_>, &FrameSettings),
    (named, sink): (&Named<'_>, &mut FrameSink),
) -> Result<()> {
    let mut own = *settings;
    own.previous_exposure_s = light.previous_s;
    let (now, before) = (light.cubes(light.now), light.before.map(|cubes| light.cubes(cubes)));
    let sent = stage.sent(sensor, &now, before.as_deref(), &own)?;
    let (hdr, readout) = (sensor.hdr(), args.readout.readout());
    let mut merged = info(args, subject, subject.camera, (light.of(0).cube, settings))?;
    render::describe_merged(&mut merged, hdr, &subject.camera.sensor.cfa);
    let is = |bits| Named {
        number: named.number,
        time_s: named.time_s,
        name: None,
        embedded: vec![render::embedded_line(hdr, settings, bits)],
    };
    let read = match sent {
        Sent::Merged(frame) => Sent::Merged(readout.of(frame)?),
        Sent::Wide(frame) => Sent::Wide(readout.of(frame)?),
        Sent::Captures(frames) => {
            let frames = frames.into_iter().map(|frame| readout.of(frame));
            Sent::Captures(frames.collect::<Result<_>>()?)
        }
    };
    match sensor.on_curve(read) {
        Sent::Merged(frame) => sink.write_named(&is(frame.bits), &frame, &merged),
        Sent::Wide(frame) => sink.write_wide(&is(frame.bits), &frame, &merged),
        Sent::Captures(frames) => {
            captures(args, subject, hdr, &frames, (light, settings), (named, sink))
        }
    }
}

/// Writes the captures of a frame: on virtual channels where the output has such, else each as a
/// frame with its name.
fn captures(
    args: &FrameArgs,
    subject: &Subject<'_>,
    hdr: &Hdr,
    frames: &[RawFrame],
    (light, settings): (&Light<'_>, &FrameSettings),
    (named, sink): (&Named<'_>, &mut FrameSink),
) -> Result<()> {
    let windows = hdr.windows(settings.exposure_s.into());
    let planes: Vec<Plane<u16>> = frames.iter().map(RawFrame::plane).collect();
    let sent = planes.iter().zip(&hdr.captures).map(|(plane, capture)| csi2::Sent {
        plane,
        bits: capture.bits.into(),
        virtual_channel: capture.virtual_channel,
        late_rows: hdr.late_rows(capture),
        embedded: vec![render::embedded_line(hdr, settings, capture.bits.into())],
    });
    let together = sink.write_captures(&sent.collect::<Vec<_>>())?;
    for (i, (frame, capture)) in frames.iter().zip(&hdr.captures).enumerate() {
        let plain = subject.camera.of_capture(i);
        let plain = plain.ok_or_else(|| Error::internal("a capture without a camera"))?;
        let own = hdr.settings(capture, settings);
        let info = info(args, subject, &plain, (light.of(i).cube, &own))?;
        let is = Named {
            number: named.number,
            time_s: named.time_s.map(|time_s| time_s + windows[i].start_s),
            name: Some(&capture.name),
            ..Named::default()
        };
        match together {
            true => sink.note(&is, frame, &info)?,
            false => sink.write_named(&is, frame, &info)?,
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        frames: FrameArgs,
    }

    /// Frames of 500 lines of 20 µs; those of the longer exposure of a bracket, 40 ms, have its
    /// lines.
    #[test]
    fn frames_begin_when_those_before_have_ended() {
        let changes = [
            camrig_camera::Change::new("sensor.timing.line_time_us", 20.0),
            camrig_camera::Change::new("sensor.timing.frame_length_lines", 500),
        ];
        let camera = Camera::load_with("mt9v024", changes).unwrap();
        let begins = |more: &str| {
            let line = format!("simulate --exposure 10ms --frames 4 -o x.mcap {more}");
            let args = Line::parse_from(line.split_whitespace()).frames;
            let begins = Begins::new(&args, &camera, 0.01)?;
            let ms = |i| begins.of(i).map(|s| (1e6 * s).round() / 1e3);
            Ok::<_, Error>(([0, 1, 2, 3].map(ms), begins.rate()))
        };
        let every = |ms: f64| [0.0, 1.0, 2.0, 3.0].map(|i| Some(i * ms));
        let (times, rate) = begins("").unwrap();
        assert_eq!((times, rate.map(f64::round)), (every(10.0), Some(100.0)));
        let (times, rate) = begins("--bracket 0,2").unwrap();
        assert_eq!((times, rate), ([0.0, 10.0, 50.0, 60.0].map(Some), None));
        let (times, rate) = begins("--fps 20 --bracket 0,2").unwrap();
        assert_eq!((times, rate), (every(50.0), Some(20.0)));
        let error = begins("--fps 50 --bracket 0,2").unwrap_err().to_string();
        assert!(error.contains("40 ms is longer than a frame at 50 frames/s"), "{error}");
    }
}
