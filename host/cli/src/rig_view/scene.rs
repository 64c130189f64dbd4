//! A changing scene on the page: its light is computed in the background, so that a silent writer
//! or slow optics do not hold up frames.
//!
//! The scene's clock advances with the light shown. While the next light is pending, frames repeat
//! the previous light and are counted, and the scene's clock stands still.

use crate::scene_lights::{NextLight, SceneLights};
use crate::times;
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

/// Time after which the page shows a message about pending light. A trade-off: optics slower than
/// the frame rate are a counter, a silent writer is a message.
const PATIENCE: Duration = Duration::from_secs(1);

/// The scene, and what is known of its next light.
pub struct Scene {
    asks: Sender<Ask>,
    made: Receiver<Made>,
    maker: JoinHandle<SceneLights>,
    /// If rows collect light in time.
    in_time: Option<InTime>,
    /// Number of the next light to ask for.
    next: u32,
    awaited: Option<Awaited>,
    /// Whether the light of the next frame has been asked for.
    has_asked: bool,
    over: bool,
}

/// The timing of rows.
struct InTime {
    /// Line time, ns, and frame length for the rig's registers.
    registers: (u32, u32),
    mirror: Mirror,
    /// Whether some frame has been lit in time.
    lit: bool,
    /// The exposure that the newest light was made for, s.
    made_for: Option<f32>,
    /// Another exposure with which frames show it, s, once that was reported.
    missed: Option<f32>,
}

/// A request for the light of a frame, and for its exposure if rows collect light in time.
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
    /// A scene that was opened with `first`; `None` if it never changes.
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
        // The scene was opened with its first light, unless rows collect it in time.
        let next = u32::from(in_time.is_none());
        let (asks, asked) = channel();
        let (sender, made) = channel();
        let maker = std::thread::spawn(move || make(lights, &first, &asked, &sender));
        let (awaited, has_asked) = (None, in_time.is_none());
        Some(Self { asks, made, maker, in_time, next, awaited, has_asked, over: false })
    }

    /// Writes line time and frame length of the camera file to a rig that was just opened, if rows
    /// collect light in time.
    ///
    /// # Errors
    /// A rig without these registers, values that do not fit into them.
    pub fn program(&mut self, rig: &mut Rig) -> Result<()> {
        let Some(in_time) = &mut self.in_time else { return Ok(()) };
        times::program(rig, in_time.registers)?;
        (in_time.mirror, self.has_asked) = (Mirror::default(), false);
        Ok(())
    }

    /// Whether the exposure must still be read before the light is asked for, after pending orders.
    pub fn looks(&self) -> bool {
        self.in_time.is_some() && !self.over && !self.has_asked
    }

    /// Whether the exposure has been read, so that orders wait until after the frame.
    pub fn has_looked(&self) -> bool {
        self.in_time.is_some() && !self.over && self.has_asked
    }

    /// Asks for the light of the next frame, unless the previous one is still pending.
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
            // If the maker has failed, that is noticed where the light is taken.
            let _ = self.asks.send(Ask { number: self.next, coming });
            self.next += 1;
            self.awaited = Some(Awaited { since: Instant::now(), told: false });
        }
        Ok(())
    }

    /// The new light for the frame that begins now, if any. The page reports light that is late,
    /// has ended or cannot be made.
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
                let light = Err(Error::internal("computing the scene's light failed"));
                Made { light, exposure_s: None, frames: Value::Null }
            }
        };
        if awaited.told && made.light.is_ok() {
            let seconds = awaited.since.elapsed().as_secs_f64();
            let text = format!("its next light arrived after {seconds:.1} s");
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
            true => "it has ended; its first frame stays, as a still scene",
            false => "it has ended; its last light stays",
        };
        shared.change(|state| state.note("scene", text));
    }

    /// Whether no frame can begin yet, because its rows have no light.
    pub fn is_dark(&self) -> bool {
        !self.over && self.in_time.as_ref().is_some_and(|in_time| !in_time.lit)
    }

    /// After a frame with this exposure: a note if its light was made for another one.
    pub fn taken(&mut self, exposure_s: f32) -> Option<String> {
        self.has_asked = false;
        let in_time = self.in_time.as_mut()?;
        let made_for = in_time.made_for?;
        let missed = (made_for != exposure_s).then_some(exposure_s);
        let before = std::mem::replace(&mut in_time.missed, missed);
        missed.filter(|_| before != missed).map(|_| {
            format!(
                "the light of frames of {exposure_s} s was computed for {made_for} s: the exposure \
                 has changed since"
            )
        })
    }

    /// Prints the notes that are known only at the end.
    pub fn finish(self, frames: u32) {
        let Self { asks, made, maker, awaited, .. } = self;
        drop(asks);
        if awaited.is_some() && matches!(made.try_recv(), Err(TryRecvError::Empty)) {
            // It might never arrive.
            eprintln!("note: the scene's next light was still pending when the console ended");
            return;
        }
        if let Ok(mut lights) = maker.join() {
            lights.tell_end(frames.into(), None);
        }
    }
}

impl Awaited {
    /// Counts a frame that repeats the previous light, or reports that the first is pending.
    fn tell_late(&mut self, shared: &Shared, is_first: bool) {
        let tells = !self.told && self.since.elapsed() >= PATIENCE;
        self.told |= tells;
        let text = match is_first {
            true => "waiting for its first light",
            false => "waiting for its next light; frames repeat the previous one",
        };
        shared.change(|state| {
            state.scene.get_or_insert_default().late += u64::from(!is_first);
            if tells {
                state.note("scene", text);
            }
        });
    }
}
