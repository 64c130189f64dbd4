//! A sequence as light on a sensor: each frame of the sensor shows one of the scene, or its rows
//! collect light from one frame of the scene to the next.

use super::notes::Notes;
use super::times::Times;
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_exposure::{IrradianceCube, displacement, weighted};
use camrig_render::{OpticsOutput, SequenceStage};
use camrig_scene::sequence::{
    Between, Moment, Playback, Rounds, SceneFrame, SceneSequence, Timeline,
};

/// What falls on the sensor in a frame.
pub enum NextLight {
    /// The same as in the frame before; in the first, what the scene was opened with.
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
    /// Pairs of frames in which things that move are still looked for.
    pairs: u32,
}

/// Pairs of frames in which things that move are looked for. A trade: each takes a few
/// milliseconds, and what moves does so soon.
const PAIRS: u32 = 16;

/// How a sequence is shown.
enum Shown {
    /// Each frame of the sensor shows one of the scene.
    Still(Playback),
    /// Rows collect light from one frame of the scene to the next.
    InTime(Timeline<IrradianceCube>),
}

/// Memory for frames of a scene that rows of one frame see, bytes. A trade: what a workstation has
/// to spare; more is refused with a word.
const MAX_BYTES: u64 = 4 << 30;

impl Sequence {
    /// Shows a sequence to a sensor of that frame rate, over and over where it `repeats`. With
    /// `times`, rows collect light in their windows.
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
                    "between frames of the scene its light goes in a straight line, which blends \
                     what moves: send several frames per exposure, or let it stand (--between \
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
            told.tell([format!(
                "{unknown}: each frame of the sensor shows the next of the scene"
            )]);
        }
        Self { shown: Shown::Still(playback), stage, told, pairs: 0 }
    }

    /// Its name and its frames, counted.
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

    /// Its first frame, as if it stood still.
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
        super::simulate::tell_optics(&output, told);
        Ok(output)
    }

    /// The frame of the scene that a frame of the sensor shows.
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

    /// What was told of it.
    pub fn notes(&self) -> &[String] {
        self.told.all()
    }

    /// Says what only the end shows.
    pub fn tell_end(&mut self) {
        let rounds = match &mut self.shown {
            Shown::Still(playback) => &mut playback.rounds,
            Shown::InTime(timeline) => &mut timeline.rounds,
        };
        self.told.tell(rounds.notes());
        self.told.tell_left();
    }
}

/// What is told of a thing that moves by so many pixels from one frame to the next.
fn moves(pixels: f64) -> String {
    let times = pixels.ceil();
    format!(
        "from one frame of the scene to the next something moves by {pixels:.0} pixels or more: \
         rows whose exposure has both frames see it twice, and no blur between; at {times} times \
         as many frames per second it moves by one (ffmpeg's minterpolate makes them of video)"
    )
}

/// What falls on the sensor from the first frame.
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

/// What falls on the sensor from a frame after the first.
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

/// The same irradiance once more.
fn copied(cube: &IrradianceCube) -> Result<IrradianceCube> {
    weighted(&[(cube, vec![1.0; cube.header.height])])
}
