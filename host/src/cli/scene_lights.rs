//! The light of frame after frame: a scene that stands still, one that moves, or a sequence.

use super::arguments::{duration, frames_per_s};
use super::simulate::ViewArgs;
use camrig_base::numbers::counted;
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_exposure::IrradianceCube;
use camrig_render::{OpticsOutput, OpticsStage, SequenceStage};
use camrig_scene::sequence::{self, Moment, Playback, Reading};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::time::Duration;

/// How a scene that changes with time is read and shown.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct SequenceArgs {
    /// Frames per second of a scene that is a sequence (24, 29.97, 30000/1001), where it does not
    /// say its own
    #[arg(long, value_name = "HZ", value_parser = frames_per_s)]
    pub scene_rate: Option<f64>,
    /// Show a sequence over and over
    #[arg(long = "loop")]
    pub repeats: bool,
    /// Take the files of a folder while another program writes them, until a file called `end`
    /// lies there or nothing new has come for as long as --wait says
    #[arg(long)]
    pub watch: bool,
    /// How long --watch waits for the next file, s or with a unit (60 s unless given)
    #[arg(long, value_name = "TIME", value_parser = seconds, requires = "watch")]
    pub wait: Option<f64>,
    /// Longest silence of a stream, s or with a unit (5 s unless given)
    #[arg(long, value_name = "TIME", value_parser = seconds)]
    pub stall: Option<f64>,
}

/// How long a watched folder may stand still unless asked otherwise, s. A trade: renderers take
/// minutes for a frame, but one that was stopped should not be waited for much longer.
const WAIT_S: f64 = 60.0;

/// Reads seconds, with a unit or without.
fn seconds(text: &str) -> Result<f64, String> {
    text.parse::<f64>().map_or_else(|_| duration(text), |_| duration(&format!("{text}s")))
}

impl SequenceArgs {
    fn reading(&self) -> Reading {
        let usual = Reading::default();
        Reading {
            rate_hz: self.scene_rate,
            watch: self.watch.then(|| Duration::from_secs_f64(self.wait.unwrap_or(WAIT_S))),
            stall: self.stall.map_or(usual.stall, Duration::from_secs_f64),
        }
    }

    /// Whether the scene of that name is a sequence. Options of one are refused for a scene that
    /// stands still.
    pub fn is_sequence(&self, scene: &str) -> Result<bool> {
        if sequence::is_sequence(scene, &self.reading())? {
            return Ok(true);
        }
        let given = [
            (self.scene_rate.is_some(), "--scene-rate"),
            (self.repeats, "--loop"),
            (self.watch, "--watch"),
            (self.stall.is_some(), "--stall"),
        ];
        match given.into_iter().find(|(given, _)| *given) {
            None => Ok(false),
            Some((_, flag)) => {
                Err(Error::input(format!("{flag} for {scene:?}, which stands still"))
                    .help("it is for a folder of pictures or cubes, or video"))
            }
        }
    }
}

/// What falls on the sensor in a frame after the first.
pub enum NextLight {
    /// The same as in the frame before.
    Same,
    /// Other irradiance.
    Changed(IrradianceCube),
    /// The scene has ended.
    Over,
}

/// The light of the frames that look at a scene.
pub struct SceneLights {
    camera: Camera,
    changes: Changes,
}

enum Changes {
    Never,
    Motion(OpticsStage),
    Sequence(Box<Sequence>),
}

struct Sequence {
    playback: Playback,
    stage: SequenceStage,
    told: Told,
}

impl SceneLights {
    /// Opens the scene of `view` for a sensor of that frame rate, and gives the light of the first
    /// frame.
    pub fn open(
        view: &ViewArgs,
        camera: &Camera,
        sensor_hz: Option<f64>,
    ) -> Result<(Self, OpticsOutput)> {
        let stage = view.optics_stage()?;
        let camera = camera.clone();
        if view.sequence.is_sequence(&view.scene)? {
            let mut sequence = Sequence::open(view, stage, sensor_hz)?;
            let first = sequence.first(&camera)?;
            return Ok((Self { camera, changes: Changes::Sequence(Box::new(sequence)) }, first));
        }
        let first = view.view_with(&camera)?;
        let moves = stage.motion.is_some();
        let changes = if moves { Changes::Motion(stage) } else { Changes::Never };
        Ok((Self { camera, changes }, first))
    }

    /// Whether each frame has the light of the one before.
    pub fn stand_still(&self) -> bool {
        matches!(self.changes, Changes::Never)
    }

    /// Whether the scene is a sequence, which ends.
    pub fn is_sequence(&self) -> bool {
        matches!(self.changes, Changes::Sequence(_))
    }

    /// The light of frame `frame`; they are asked for in order, from 1 on.
    pub fn next(&mut self, frame: u32) -> Result<NextLight> {
        match &mut self.changes {
            Changes::Never => Ok(NextLight::Same),
            Changes::Motion(stage) => {
                Ok(NextLight::Changed(stage.run_frame(&self.camera, frame, |_, _| ())?.cube))
            }
            Changes::Sequence(sequence) => sequence.next(&self.camera, frame),
        }
    }

    /// Says what only the end shows; `frames` were taken of those `asked` for.
    pub fn tell_end(&mut self, frames: u64, asked: Option<u32>) {
        let Changes::Sequence(sequence) = &mut self.changes else { return };
        sequence.tell_notes();
        sequence.told.tell_left();
        let name = sequence.playback.name();
        if let Some(asked) = asked.filter(|asked| u64::from(*asked) > frames) {
            eprintln!(
                "note: {name} has ended after {frames} of {} (--loop repeats it)",
                counted(asked as usize, "frame")
            );
        }
        let skipped = sequence.playback.counts().skipped;
        if skipped > 0 {
            eprintln!(
                "note: shown in no frame: {} of {name}, as the next was due already",
                counted(skipped as usize, "frame")
            );
        }
    }

    /// Frames of the scene, counted; null of a scene that is no sequence.
    pub fn counts(&self) -> Value {
        let Changes::Sequence(sequence) = &self.changes else { return Value::Null };
        let counts = sequence.playback.counts();
        json!({
            "received": counts.received,
            "used": counts.used,
            "skipped": counts.skipped,
            "held": counts.held,
            "by_time": sequence.playback.is_timed(),
        })
    }
}

impl Sequence {
    fn open(view: &ViewArgs, stage: OpticsStage, sensor_hz: Option<f64>) -> Result<Self> {
        let stage = SequenceStage::new(stage)?;
        let sequence = sequence::open(&view.scene, &view.sequence.reading())?
            .ok_or_else(|| Error::internal("a sequence that is none"))?;
        let timed = sequence.is_timed();
        let playback = Playback::new(sequence, sensor_hz, view.sequence.repeats);
        let mut told = Told::default();
        if !playback.is_timed() {
            let unknown = match (timed, sensor_hz) {
                (false, None) => "no frame rate is known",
                (false, Some(_)) => "the scene's frame rate is not known (--scene-rate)",
                (true, _) => "the sensor's frame rate is not known (--fps)",
            };
            told.tell(format!("{unknown}: each frame of the sensor shows the next of the scene"));
        }
        Ok(Self { playback, stage, told })
    }

    fn first(&mut self, camera: &Camera) -> Result<OpticsOutput> {
        let moment = self.playback.at(0);
        self.tell_notes();
        let Moment::Next(frame) = moment? else {
            return Err(Error::internal("a sequence without a first frame"));
        };
        let output = self.stage.run(camera, frame, |_, _| ())?;
        output.notes.iter().for_each(|note| self.told.tell(note.clone()));
        super::simulate::tell_optics(&output);
        Ok(output)
    }

    fn next(&mut self, camera: &Camera, number: u32) -> Result<NextLight> {
        let moment = self.playback.at(number.into());
        self.tell_notes();
        Ok(match moment? {
            Moment::Same => NextLight::Same,
            Moment::Over => NextLight::Over,
            Moment::Next(frame) => {
                let name = frame.name.clone();
                let output = self.stage.run(camera, frame, |_, _| ())?;
                for note in output.notes {
                    self.told.tell_of(&name, note);
                }
                NextLight::Changed(output.cube)
            }
        })
    }

    fn tell_notes(&mut self) {
        for note in self.playback.notes() {
            self.told.tell(note);
        }
    }
}

/// Notes, each told once; frames of a long sequence could fill the screen with theirs.
#[derive(Default)]
struct Told {
    all: BTreeSet<String>,
    /// Notes of frames that were told, and that were not.
    of_frames: usize,
    left: usize,
}

/// Most notes of single frames that are told.
const TOLD_OF_FRAMES: usize = 3;

impl Told {
    fn tell(&mut self, note: String) {
        if !self.all.contains(&note) {
            eprintln!("note: {note}");
            self.all.insert(note);
        }
    }

    /// Tells a note of a frame after the first.
    fn tell_of(&mut self, name: &str, note: String) {
        if self.all.contains(&note) {
            return;
        }
        if self.of_frames == TOLD_OF_FRAMES {
            self.left += 1;
            return;
        }
        self.of_frames += 1;
        eprintln!("note: {name}: {note}");
        self.all.insert(note);
    }

    fn tell_left(&mut self) {
        if self.left > 0 {
            eprintln!("note: {} more notes of single frames were not told", self.left);
        }
    }
}
