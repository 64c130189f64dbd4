//! A scene that changes while the page shows it: its light is made beside the stream, so that a
//! writer who is silent and optics that are slow hold up no frame.
//!
//! The scene's clock goes on with the light that is shown. While the next light is awaited, frames
//! are exposed to the one before, are counted, and the scene stands still.

use crate::cli::scene_lights::{NextLight, SceneLights};
use crate::cli::times;
use crate::view::{Progress, Shared};
use camrig_base::{Error, Result};
use camrig_exposure::IrradianceCube;
use camrig_render::OpticsOutput;
use camrig_rig::mirror::Coming;
use camrig_rig::{Mirror, Rig};
use serde_json::Value;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time after which the page is told in words that light is awaited. A trade: optics that are
/// slower than the frame rate are a figure, a writer who does nothing is a message.
const PATIENCE: Duration = Duration::from_secs(1);

/// The scene, and what is known of its next light.
pub struct Scene {
    asks: Sender<Ask>,
    made: Receiver<Made>,
    maker: JoinHandle<SceneLights>,
    /// Where rows collect light in time.
    in_time: Option<InTime>,
    /// The light that is asked for next.
    next: u32,
    awaited: Option<Awaited>,
    /// Whether the frame that begins next has had its turn to ask.
    has_asked: bool,
    over: bool,
}

/// What decides when rows are open.
struct InTime {
    /// Line time, ns, and frame length for the rig's registers.
    registers: (u32, u32),
    mirror: Mirror,
    /// Whether some frame has been lit in time.
    lit: bool,
    /// The exposure that the newest light was made for, s.
    made_for: Option<f32>,
    /// Another exposure at which frames show it, s, once that was told.
    missed: Option<f32>,
}

/// Asks for the light of a frame, for its exposure where that counts.
struct Ask {
    number: u32,
    coming: Option<Coming>,
}

/// Light, and the scene's frames so far.
struct Made {
    light: Result<NextLight>,
    exposure_s: Option<f32>,
    frames: Value,
}

/// Light that has been asked for.
struct Awaited {
    since: Instant,
    told: bool,
}

/// Makes light as it is asked for, until nobody asks any more.
fn make(
    mut lights: SceneLights,
    first: &OpticsOutput,
    asks: &Receiver<Ask>,
    made: &Sender<Made>,
) -> SceneLights {
    for Ask { number, coming } in asks {
        if let (Some(times), Some(coming)) = (lights.times(), coming) {
            times.set(coming.lines, coming.line_ns);
        }
        let exposure_s = coming.map(|coming| coming.exposure_s);
        let light = lights.next(number, exposure_s.unwrap_or(0.0).into(), &first.cube);
        if made.send(Made { light, exposure_s, frames: lights.counts() }).is_err() {
            break;
        }
    }
    lights
}

impl Scene {
    /// A scene that was opened with `first`; none where it never changes.
    pub fn new(
        mut lights: SceneLights,
        first: Arc<OpticsOutput>,
        shared: &Shared,
    ) -> Option<Self> {
        if lights.stand_still() {
            return None;
        }
        let progress = Progress { late: 0, frames: lights.counts() };
        shared.change(|state| state.scene = Some(progress));
        let in_time = lights.times().map(|times| InTime {
            registers: times.registers(),
            mirror: Mirror::default(),
            lit: false,
            made_for: None,
            missed: None,
        });
        // What it was opened with is the first light, but in time.
        let next = u32::from(in_time.is_none());
        let (asks, asked) = channel();
        let (sender, made) = channel();
        let maker = std::thread::spawn(move || make(lights, &first, &asked, &sender));
        let (awaited, has_asked) = (None, in_time.is_none());
        Some(Self { asks, made, maker, in_time, next, awaited, has_asked, over: false })
    }

    /// Gives a rig that was just opened the line time and frame length of the camera file, where
    /// they count.
    ///
    /// # Errors
    /// A rig without these registers, values that they do not take.
    pub fn program(&mut self, rig: &mut Rig) -> Result<()> {
        let Some(in_time) = &mut self.in_time else { return Ok(()) };
        times::program(rig, in_time.registers)?;
        (in_time.mirror, self.has_asked) = (Mirror::default(), false);
        Ok(())
    }

    /// Whether rows are lit for an exposure that is to be looked up, once registers are written.
    pub fn looks(&self) -> bool {
        self.in_time.is_some() && !self.over && !self.has_asked
    }

    /// Whether it has been looked up, and registers are written after the frame.
    pub fn has_looked(&self) -> bool {
        self.in_time.is_some() && !self.over && self.has_asked
    }

    /// Asks for the light of the frame that begins next, unless the one before is still awaited.
    ///
    /// # Errors
    /// A link that fails.
    pub fn ask(&mut self, rig: &mut Rig) -> Result<()> {
        if self.over || self.has_asked {
            return Ok(());
        }
        let looked = self.in_time.as_mut().map(|in_time| in_time.mirror.next_frame(rig));
        let coming = looked.transpose()?;
        self.has_asked = true;
        if self.awaited.is_none() {
            // One who has broken off is noticed where the light is taken.
            let _ = self.asks.send(Ask { number: self.next, coming });
            self.next += 1;
            self.awaited = Some(Awaited { since: Instant::now(), told: false });
        }
        Ok(())
    }

    /// The light that the frame which begins now is the first to show. That it is late, has ended
    /// or cannot be made is told to the page.
    pub fn light(&mut self, shared: &Shared) -> Option<IrradianceCube> {
        let awaited = self.awaited.as_mut()?;
        let made = match self.made.try_recv() {
            Ok(made) => made,
            Err(TryRecvError::Empty) => {
                let is_first = self.in_time.as_ref().is_some_and(|in_time| !in_time.lit);
                awaited.tell_late(shared, is_first);
                return None;
            }
            Err(TryRecvError::Disconnected) => {
                let light = Err(Error::internal("the light of the scene broke off"));
                Made { light, exposure_s: None, frames: Value::Null }
            }
        };
        if awaited.told && made.light.is_ok() {
            let seconds = awaited.since.elapsed().as_secs_f64();
            let text = format!("its next light has come after {seconds:.1} s");
            shared.change(|state| state.note("scene", text));
        }
        self.awaited = None;
        if !made.frames.is_null() {
            shared.change(|state| state.scene.get_or_insert_default().frames = made.frames);
        }
        let light = match made.light {
            Ok(NextLight::Same) => None,
            Ok(NextLight::Changed(cube)) => Some(cube),
            Ok(NextLight::Over) => {
                self.end(shared);
                return None;
            }
            Err(error) => {
                shared.change(|state| state.fault("scene", &error));
                self.end(shared);
                return None;
            }
        };
        if let Some(in_time) = &mut self.in_time {
            (in_time.lit, in_time.made_for) = (true, made.exposure_s);
        }
        light
    }

    fn end(&mut self, shared: &Shared) {
        self.over = true;
        let text = match self.in_time.as_ref().is_some_and(|in_time| !in_time.lit) {
            true => "it has ended; its first frame stays, as if it stood still",
            false => "it has ended; its last light stays",
        };
        shared.change(|state| state.note("scene", text));
    }

    /// Whether no frame can begin, since its rows have no light yet.
    pub fn is_dark(&self) -> bool {
        !self.over && self.in_time.as_ref().is_some_and(|in_time| !in_time.lit)
    }

    /// A frame has been taken at an exposure; what to tell where its light was made for another.
    pub fn taken(&mut self, exposure_s: f32) -> Option<String> {
        self.has_asked = false;
        let in_time = self.in_time.as_mut()?;
        let made_for = in_time.made_for?;
        let missed = (made_for != exposure_s).then_some(exposure_s);
        let before = std::mem::replace(&mut in_time.missed, missed);
        missed.filter(|_| before != missed).map(|_| {
            format!(
                "frames of {exposure_s} s have rows that were lit for {made_for} s: the exposure \
                 has changed since their light was asked for"
            )
        })
    }

    /// Says what only the end shows, after so many frames.
    pub fn finish(self, frames: u32) {
        let Self { asks, made, maker, awaited, .. } = self;
        drop(asks);
        if awaited.is_some() && matches!(made.try_recv(), Err(TryRecvError::Empty)) {
            // It may be for ever.
            eprintln!("note: the scene's next light was awaited when the page ended");
            return;
        }
        if let Ok(mut lights) = maker.join() {
            lights.tell_end(frames.into(), None);
        }
    }
}

impl Awaited {
    /// Counts a frame that shows the light before again, or tells of the first light.
    fn tell_late(&mut self, shared: &Shared, is_first: bool) {
        let tells = !self.told && self.since.elapsed() >= PATIENCE;
        self.told |= tells;
        let text = match is_first {
            true => "its first light is awaited",
            false => "its next light is awaited; frames show the one before",
        };
        shared.change(|state| {
            state.scene.get_or_insert_default().late += u64::from(!is_first);
            if tells {
                state.note("scene", text);
            }
        });
    }
}
