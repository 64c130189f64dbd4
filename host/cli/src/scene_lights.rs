//! The light of frame after frame: of a still scene, a moving one, or a sequence.

use super::notes::Notes;
pub use super::sequence_lights::NextLight;
use super::sequence_lights::Sequence;
use super::times::{Times, refuse_regions};
use super::view_args::ViewArgs;
use camrig_base::numbers::counted;
use camrig_base::{Error, Result};
use camrig_camera::{Camera, RowWindows, Window};
use camrig_exposure::IrradianceCube;
use camrig_light::Lamps;
use camrig_light::lamp::Region;
use camrig_render::{MotionStage, OpticsOutput, SequenceStage};
use camrig_scene_files::sequence;
use serde_json::{Value, json};

/// Name of a sequence in messages before it is open.
fn named(scene: &str) -> &str {
    if scene == "-" || scene.starts_with("-:") { "standard input" } else { scene }
}

/// The light of a scene's frames.
pub struct SceneLights {
    camera: Camera,
    changes: Changes,
    times: Option<Times>,
    /// Notes about a scene that is not a sequence.
    notes: Vec<String>,
}

enum Changes {
    /// Only lamps change, some of them on regions, whose irradiance is stored here.
    Never(Vec<IrradianceCube>),
    Motion(Box<MotionStage>),
    Sequence(Box<Sequence>),
}

impl SceneLights {
    /// Opens the scene of `view` for a sensor with that frame rate, and returns the light of the
    /// first frame as a still scene. With `times`, rows collect light in their windows. Notes go to
    /// `told`, now and later.
    pub fn open(
        view: &ViewArgs,
        camera: &Camera,
        sensor_hz: Option<f64>,
        times: Option<Times>,
        mut told: Notes,
    ) -> Result<(Self, OpticsOutput)> {
        let stage = view.optics_stage()?;
        let camera = camera.clone();
        let lamps = times.as_ref().map(|times| &times.lamps);
        if view.sequence.is_sequence(&view.scene)? {
            lamps.map_or(Ok(()), |lamps| refuse_regions(lamps, "a sequence"))?;
            let stage = SequenceStage::new(stage)?;
            told.wait_for(|| format!("waiting for the first frame of {}", named(&view.scene)));
            let opened = sequence::open(&view.scene, &view.sequence.reading())?
                .ok_or_else(|| Error::internal("not a sequence"))?;
            let opened = (opened, view.sequence.repeats);
            let mut sequence = Sequence::new(opened, stage, sensor_hz, times.as_ref(), told);
            let first = sequence.first(&camera)?;
            let changes = Changes::Sequence(Box::new(sequence));
            return Ok((Self { camera, changes, times, notes: Vec::new() }, first));
        }
        if times.is_some() && view.rolling != 0.0 {
            return Err(Error::input("--rolling for a camera with timing")
                .at("[sensor.timing]")
                .help("omit --rolling"));
        }
        let first = view.view_with(&camera, &mut told)?;
        let changes = if stage.motion.is_some() {
            lamps.map_or(Ok(()), |lamps| refuse_regions(lamps, "a moving scene"))?;
            Changes::Motion(Box::new(MotionStage::open(&stage, &camera)?))
        } else {
            let regions = lamps.map_or(&[][..], Lamps::regions).iter();
            let part = |(region, _): &(Region, Lamps)| Ok(stage.run_part(&camera, *region)?.cube);
            Changes::Never(regions.map(part).collect::<Result<_>>()?)
        };
        let notes = first.notes.clone();
        Ok((Self { camera, changes, times, notes }, first))
    }

    /// Whether all frames have the same light.
    pub fn stand_still(&self) -> bool {
        let steady = self.times.as_ref().is_none_or(|times| times.lamps.are_steady());
        matches!(self.changes, Changes::Never(_)) && steady
    }

    /// Whether the light changes while rows collect it.
    pub fn change_within_frames(&self) -> bool {
        self.times.is_some() && !self.stand_still()
    }

    /// Whether the scene is a sequence, which has an end.
    pub fn is_sequence(&self) -> bool {
        matches!(self.changes, Changes::Sequence(_))
    }

    /// When rows collect light, if that is known.
    pub fn times(&mut self) -> Option<&mut Times> {
        self.times.as_mut()
    }

    /// The light of frame `frame` at its exposure, of a sensor with one capture; as
    /// [`Self::in_windows`].
    pub fn next(
        &mut self,
        frame: u32,
        exposure_s: f64,
        first: &IrradianceCube,
    ) -> Result<NextLight> {
        let mut one = self.in_windows(frame, &[Window { start_s: 0.0, exposure_s }], first)?;
        Ok(one.swap_remove(0))
    }

    /// The light of frame `frame` in the windows of its captures; frames must be asked for in
    /// order, from 0. `first` is the light with which the scene was opened. One light for all
    /// windows where it does not change within a frame, else one for each.
    pub fn in_windows(
        &mut self,
        frame: u32,
        windows: &[Window],
        first: &IrradianceCube,
    ) -> Result<Vec<NextLight>> {
        if self.stand_still() {
            return Ok(vec![NextLight::Same]);
        }
        let Some(times) = &mut self.times else {
            let light = match &mut self.changes {
                _ if frame == 0 => NextLight::Same,
                Changes::Never(_) => NextLight::Same,
                Changes::Motion(stage) => {
                    NextLight::Changed(stage.run_frame(&self.camera, frame, |_, _| ())?.cube)
                }
                Changes::Sequence(sequence) => sequence.next(&self.camera, frame)?,
            };
            return Ok(vec![light]);
        };
        let end_s = windows.iter().map(Window::end_s).fold(0.0, f64::max);
        let (rows, period_s) = (times.next(end_s)?, times.period_s(end_s)?);
        windows.iter().map(|w| self.in_rows(frame, &rows.part(w), period_s, first)).collect()
    }

    /// The light of a frame whose rows collect it in `windows`.
    fn in_rows(
        &mut self,
        frame: u32,
        windows: &RowWindows,
        period_s: f64,
        first: &IrradianceCube,
    ) -> Result<NextLight> {
        let Some(times) = &self.times else { return Ok(NextLight::Same) };
        let lit = |cube: IrradianceCube| {
            Ok(NextLight::Changed(times.lit(&cube, &[], windows)?.unwrap_or(cube)))
        };
        let still = |parts: &[IrradianceCube]| {
            let cube = times.lit(first, parts, windows)?;
            Ok(cube.map_or(NextLight::Same, NextLight::Changed))
        };
        match &mut self.changes {
            Changes::Never(parts) => still(parts),
            Changes::Motion(stage) => {
                let of = (windows, period_s);
                lit(stage.run_exposed(&self.camera, of, &times.lamps, |_, _| ())?.cube)
            }
            Changes::Sequence(sequence) if sequence.is_in_time() => {
                sequence.exposed(&self.camera, &windows.rows().collect::<Vec<_>>())
            }
            Changes::Sequence(_) if frame == 0 => still(&[]),
            Changes::Sequence(sequence) => match sequence.next(&self.camera, frame)? {
                NextLight::Changed(cube) => lit(cube),
                other => Ok(other),
            },
        }
    }

    /// Prints the notes that are known only at the end; `frames` of those `asked` for were taken.
    pub fn tell_end(&mut self, frames: u64, asked: Option<u32>) {
        let Changes::Sequence(sequence) = &mut self.changes else { return };
        sequence.tell_end();
        let rounds = sequence.rounds();
        let name = rounds.name();
        if let Some(asked) = asked.filter(|asked| u64::from(*asked) > frames) {
            eprintln!(
                "note: {name} has ended after {frames} of {} (--loop repeats it)",
                counted(asked as usize, "frame")
            );
        }
        let skipped = rounds.counts().skipped;
        if skipped > 0 {
            eprintln!(
                "note: skipped: {} of {name}, because the next was already due",
                counted(skipped as usize, "frame")
            );
        }
    }

    /// Notes about the scene, its light, the lens and the camera's tables so far.
    pub fn notes(&self) -> &[String] {
        match &self.changes {
            Changes::Sequence(sequence) => sequence.notes(),
            _ => &self.notes,
        }
    }

    /// Counts of scene frames; null if the scene is not a sequence.
    pub fn counts(&self) -> Value {
        let Changes::Sequence(sequence) = &self.changes else { return Value::Null };
        let counts = sequence.rounds().counts();
        json!({
            "received": counts.received,
            "used": counts.used,
            "skipped": counts.skipped,
            "held": counts.held,
            "by_time": sequence.is_by_time(),
        })
    }

    /// When rows collect light, for `--json`; null if that is not known.
    pub fn timing(&self, exposure_s: f64) -> Result<Value> {
        self.times.as_ref().map_or(Ok(Value::Null), |times| times.figures(exposure_s))
    }
}
