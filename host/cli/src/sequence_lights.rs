//! A sequence as light on a sensor: each sensor frame shows one scene frame, or its rows collect
//! light from one scene frame to the next.

use super::notes::Notes;
use super::times::Times;
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_exposure::{IrradianceCube, displacement, weighted};
use camrig_render::{OpticsOutput, SequenceStage};
use camrig_scene::sequence::{
    Between, Moment, Playback, Rounds, SceneFrame, SceneSequence, Timeline,
};

/// The light of a frame.
pub enum NextLight {
    /// The same as in the previous frame; in the first, the light with which the scene was opened.
    Same,
    /// Other irradiance.
    Changed(IrradianceCube),
    /// The scene has ended.
    Over,
}

/// A sequence in front of a sensor.
pub struct Sequence {
    shown: Shown,
    stage: SequenceStage,
    told: Notes,
    /// Pairs of frames in which motion is still searched for.
    pairs: u32,
}

/// Pairs of frames in which motion is searched for. A trade-off: each takes a few milliseconds, and
/// what moves usually does so soon.
const PAIRS: u32 = 16;

/// How a sequence is shown.
enum Shown {
    /// Each sensor frame shows one scene frame.
    Still(Playback),
    /// Rows collect light from one scene frame to the next.
    InTime(Timeline<IrradianceCube>),
}

/// Memory for scene frames seen by the rows of one sensor frame, bytes. A trade-off: what a
/// workstation can spare; more is refused.
const MAX_BYTES: u64 = 4 << 30;

impl Sequence {
    /// Shows a sequence to a sensor with that frame rate, endlessly if it `repeats`. With `times`,
    /// rows collect light in their windows.
    pub fn new(
        (sequence, repeats): (Box<dyn SceneSequence>, bool),
        stage: SequenceStage,
        sensor_hz: Option<f64>,
        times: Option<&Times>,
        mut told: Notes,
    ) -> Self {
        let timed = sequence.is_timed();
        if let Some(times) = times.filter(|_| timed) {
            if times.between == Between::Linear {
                told.tell([
                    "light is interpolated linearly between scene frames, which blends moving \
                     objects: send several frames per exposure, or hold it (--between \
                     hold)"
                        .into(),
                ]);
            }
            let (between, lamps) = (times.between, times.lamps.clone());
            let shown = Shown::InTime(Timeline::new(sequence, repeats, between, lamps));
            let pairs = if times.lamps.are_steady() { PAIRS } else { 0 };
            return Self { shown, stage, told, pairs };
        }
        let playback = Playback::new(sequence, sensor_hz, repeats);
        if !playback.is_timed() {
            let unknown = match (timed, sensor_hz) {
                (false, None) => "no frame rate is known",
                (false, Some(_)) => "the scene's frame rate is not known (--scene-rate)",
                (true, _) => "the sensor's frame rate is not known (--fps)",
            };
            told.tell([format!("{unknown}: each sensor frame shows the next scene frame")]);
        }
        Self { shown: Shown::Still(playback), stage, told, pairs: 0 }
    }

    /// Its name and the counts of its frames.
    pub fn rounds(&self) -> &Rounds {
        match &self.shown {
            Shown::Still(playback) => &playback.rounds,
            Shown::InTime(timeline) => &timeline.rounds,
        }
    }

    /// Whether rows collect light from frame to frame.
    pub fn is_in_time(&self) -> bool {
        matches!(self.shown, Shown::InTime(_))
    }

    /// Whether its frames are shown by their time stamps.
    pub fn is_by_time(&self) -> bool {
        match &self.shown {
            Shown::Still(playback) => playback.is_timed(),
            Shown::InTime(_) => true,
        }
    }

    /// Its first frame as a still scene.
    pub fn first(&mut self, camera: &Camera) -> Result<OpticsOutput> {
        let Self { shown, stage, told, .. } = self;
        let output = match shown {
            Shown::Still(playback) => {
                let moment = playback.at(0);
                told.tell(playback.rounds.notes());
                let Moment::Next(frame) = moment? else {
                    return Err(Error::internal("a sequence without a first frame"));
                };
                lit_first(stage, camera, frame, told)?
            }
            Shown::InTime(timeline) => {
                let mut output = None;
                timeline.first(|frame| {
                    let made = lit_first(stage, camera, frame, told)?;
                    let kept = copied(&made.cube)?;
                    output = Some(made);
                    Ok(kept)
                })?;
                told.tell(timeline.rounds.notes());
                output.ok_or_else(|| Error::internal("a sequence without a first frame"))?
            }
        };
        told.tell(output.notes.iter().cloned());
        super::view_args::tell_optics(&output, told);
        Ok(output)
    }

    /// The scene frame shown in a sensor frame.
    pub fn next(&mut self, camera: &Camera, number: u32) -> Result<NextLight> {
        let Self { shown: Shown::Still(playback), stage, told, .. } = self else {
            return Err(Error::internal("a sequence in time that stands still"));
        };
        let moment = playback.at(number.into());
        told.tell(playback.rounds.notes());
        Ok(match moment? {
            Moment::Same => NextLight::Same,
            Moment::Over => NextLight::Over,
            Moment::Next(frame) => NextLight::Changed(seen(stage, camera, frame, told)?),
        })
    }

    /// The light of rows whose windows open and close at these times.
    pub fn exposed(&mut self, camera: &Camera, rows: &[[f64; 2]]) -> Result<NextLight> {
        let Self { shown: Shown::InTime(timeline), stage, told, pairs } = self else {
            return Err(Error::internal("a sequence that stands still, in time"));
        };
        let most = MAX_BYTES / stage.cube_bytes(camera).max(1);
        let most = most.clamp(4, 100_000) as usize;
        let views = timeline.views(rows, most, |frame| seen(stage, camera, frame, told));
        let light = match views? {
            None => NextLight::Over,
            Some(views) => {
                for pair in views.windows(2).take(*pairs as usize) {
                    *pairs -= 1;
                    let pixels = displacement(pair[0].0, pair[1].0)?;
                    if pixels > 1.0 {
                        told.tell([moves(pixels)]);
                        *pairs = 0;
                        break;
                    }
                }
                NextLight::Changed(weighted(&views)?)
            }
        };
        told.tell(timeline.rounds.notes());
        Ok(light)
    }

    /// Its notes.
    pub fn notes(&self) -> &[String] {
        self.told.all()
    }

    /// Prints the notes that are known only at the end.
    pub fn tell_end(&mut self) {
        let rounds = match &mut self.shown {
            Shown::Still(playback) => &mut playback.rounds,
            Shown::InTime(timeline) => &mut timeline.rounds,
        };
        self.told.tell(rounds.notes());
        self.told.tell_left();
    }
}

/// A note about motion by so many pixels from one scene frame to the next.
fn moves(pixels: f64) -> String {
    let times = pixels.ceil();
    format!(
        "something moves by {pixels:.0} pixels or more from one scene frame to the next: rows \
         whose exposure spans both frames see it twice instead of blurred; at {times} times the \
         frame rate it would move by one (ffmpeg's minterpolate raises that of video)"
    )
}

/// Irradiance of the first frame.
fn lit_first(
    stage: &mut SequenceStage,
    camera: &Camera,
    frame: SceneFrame,
    told: &Notes,
) -> Result<OpticsOutput> {
    let name = frame.name.clone();
    told.wait_for(|| format!("computing {name}"));
    stage.run(camera, frame, |done, bands| {
        told.wait_for(|| format!("computing {name}: {done} of {bands} bands"));
    })
}

/// Irradiance of a later frame.
fn seen(
    stage: &mut SequenceStage,
    camera: &Camera,
    frame: SceneFrame,
    told: &mut Notes,
) -> Result<IrradianceCube> {
    let name = frame.name.clone();
    let output = stage.run(camera, frame, |_, _| ())?;
    output.notes.into_iter().for_each(|note| told.tell_of(&name, note));
    Ok(output.cube)
}

/// A copy of irradiance.
fn copied(cube: &IrradianceCube) -> Result<IrradianceCube> {
    weighted(&[(cube, vec![1.0; cube.header.height])])
}
