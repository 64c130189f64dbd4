//! State of the console: the newest frame, figures over frames, events. The streaming thread writes
//! it, the pages' threads read it.

use camrig_base::{Error, RawFrame};
use camrig_exposure::CubeHeader;
use camrig_formats::DngInfo;
use camrig_light::Illuminant;
use camrig_sensor_core::config::FrameSettings;
use serde::Serialize;
use serde_json::Value;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Frames whose times are kept: more than a page plots.
const TIMES: usize = 1024;
/// Time over which the frame rate is averaged, s. A trade-off: the figure follows changes and is
/// still readable.
const RATE_OVER_S: f64 = 2.0;
/// Number of events kept for pages that connect later.
const EVENTS: usize = 100;

/// The light of a frame.
pub struct Light {
    /// The light on a scene of reflectances.
    pub illuminant: Option<Illuminant>,
    /// What the irradiance was made from.
    pub header: CubeHeader,
    /// Colour matrices and white of such frames.
    pub info: DngInfo,
}

/// A frame with its settings and light.
pub struct Frame {
    /// Counted from 1.
    pub number: u64,
    /// The samples.
    pub raw: RawFrame,
    /// Exposure and gain in force.
    pub settings: FrameSettings,
    /// The sensor's frame counter.
    pub counter: u16,
    /// Faults or patterns that the rig's registers injected.
    pub injected: Option<String>,
    /// Its light.
    pub light: Arc<Light>,
}

/// Constants of a stream.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Source {
    /// The camera's name.
    pub camera: String,
    /// The rig's address, without its token.
    pub rig: String,
    /// Requested frame rate, frames/s.
    pub fps: f64,
    /// Scenes to choose from.
    pub scenes: Vec<String>,
    /// Lights to choose from.
    pub illuminants: Vec<String>,
}

/// The latest settings.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Settings {
    /// Exposure, s.
    pub exposure_s: f64,
    /// Gain.
    pub analog_gain: f64,
    /// Automatic exposure.
    pub auto_exposure: bool,
    /// Illuminance, lx; `None` for a scene that includes its light.
    pub lux: Option<f64>,
    /// The light's name; `None` for a scene that includes its light.
    pub illuminant: Option<String>,
    /// The scene's name.
    pub scene: String,
}

/// Status of the stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// No frame has arrived yet.
    #[default]
    Starting,
    /// Frames arrive.
    Streaming,
    /// The link is down and is being reopened.
    Reconnecting,
}

/// When a frame began.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Timing {
    /// The frame's number.
    pub frame: u64,
    /// After the start of the stream, s.
    pub at_s: f64,
    /// After the beginning of the previous frame, ms.
    pub period_ms: f64,
    /// Whether it began late.
    pub late: bool,
}

/// An event.
#[derive(Clone, Debug, Serialize)]
pub struct Event {
    /// Counted from 1; a repeated one gets a new number.
    pub number: u64,
    /// Number of frames before it.
    pub frame: u64,
    /// What it is about: `rig`, `link`, `page`, `optics`, `scene`.
    pub source: &'static str,
    /// The message.
    pub text: String,
    /// Whether it is an error.
    pub error: bool,
    /// How often it happened: in a row, or in total for recurring events.
    pub count: u32,
}

/// A register of the rig.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Register {
    /// Its address.
    pub address: u16,
    /// Its name, with its unit.
    pub name: &'static str,
    /// Its value.
    pub value: u32,
    /// Whether it is writable.
    pub writable: bool,
}

/// A recording in progress.
#[derive(Clone, Debug, Serialize)]
pub struct Recording {
    /// The file.
    pub path: String,
    /// Frames in it.
    pub frames: u64,
}

/// Progress of a changing scene.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Progress {
    /// Frames that repeated the previous light, because the next was not ready in time.
    pub late: u64,
    /// Counts of its frames; null if the scene is not a sequence.
    pub frames: Value,
}

/// The stream so far.
#[derive(Default)]
pub struct State {
    /// Constants of the stream.
    pub source: Source,
    /// The latest settings.
    pub settings: Settings,
    /// Status of the stream.
    pub status: Status,
    /// What is being computed, in words.
    pub busy: Option<String>,
    /// The newest frame.
    pub newest: Option<Arc<Frame>>,
    /// Frames begun, including dropped ones.
    pub frames: u64,
    /// Frames that began late.
    pub late: u64,
    /// Frames that the rig dropped on request.
    pub dropped: u64,
    /// Progress of the scene, if it changes.
    pub scene: Option<Progress>,
    /// The registers as read last.
    pub registers: Vec<Register>,
    /// The recording in progress.
    pub recording: Option<Recording>,
    times: VecDeque<Timing>,
    events: VecDeque<Event>,
    /// Events so far.
    told: u64,
}

impl State {
    /// Counts a frame.
    pub fn count(&mut self, timing: Timing) {
        self.frames = timing.frame;
        self.late += u64::from(timing.late);
        if self.times.len() == TIMES {
            self.times.pop_front();
        }
        self.times.push_back(timing);
    }

    /// Frames per second over the last two seconds; `None` before two frames.
    pub fn frames_per_s(&self) -> Option<f64> {
        let newest = self.times.back()?.at_s;
        let first = self.times.iter().find(|t| t.at_s >= newest - RATE_OVER_S)?;
        let first = if first.at_s < newest { first } else { self.times.iter().nth_back(1)? };
        let frames = self.times.back()?.frame - first.frame;
        Some(frames as f64 / (newest - first.at_s))
    }

    /// Times of frames after a given one.
    pub fn times_after(&self, frame: u64) -> Vec<Timing> {
        self.times.iter().filter(|t| t.frame > frame).copied().collect()
    }

    /// Events after a given one.
    pub fn events_after(&self, number: u64) -> Vec<&Event> {
        self.events.iter().filter(|e| e.number > number).collect()
    }

    /// Adds an event.
    pub fn note(&mut self, source: &'static str, text: impl Into<String>) {
        self.tell(source, text.into(), false, 1);
    }

    /// Adds a recurring event: it stays a single one with a count, even with others in between.
    pub fn note_again(&mut self, source: &'static str, text: impl Into<String>) {
        self.tell(source, text.into(), false, EVENTS);
    }

    /// Adds an error: what is wrong, where, and what would be right.
    pub fn fault(&mut self, source: &'static str, error: &Error) {
        let place = error.place().map_or(String::new(), |place| format!(" ({place})"));
        let remedy = error.remedy().map_or(String::new(), |remedy| format!(": {remedy}"));
        self.tell(source, format!("{}{place}{remedy}", error.what()), true, 1);
    }

    /// Adds an event, or counts it if the same is among the last ones.
    fn tell(&mut self, source: &'static str, text: String, error: bool, last: usize) {
        self.told += 1;
        let same = |e: &Event| e.text == text && e.source == source;
        let before = self.events.len().saturating_sub(last);
        let at = (before..self.events.len()).rev().find(|at| same(&self.events[*at]));
        let again = at.and_then(|at| self.events.remove(at));
        if self.events.len() == EVENTS {
            self.events.pop_front();
        }
        let (number, frame, count) = (self.told, self.frames, again.map_or(1, |e| e.count + 1));
        self.events.push_back(Event { number, frame, source, text, error, count });
    }
}

/// The state between threads.
#[derive(Default)]
pub struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

impl Shared {
    /// A stream before its first frame.
    pub fn new(source: Source, settings: Settings) -> Self {
        let state = State { source, settings, ..State::default() };
        Self { state: Mutex::new(state), changed: Condvar::new() }
    }

    /// The current state.
    pub fn lock(&self) -> MutexGuard<'_, State> {
        // A thread that panicked has left the figures as they were.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the state and wakes the waiting pages.
    pub fn change<T>(&self, how: impl FnOnce(&mut State) -> T) -> T {
        let result = how(&mut self.lock());
        self.changed.notify_all();
        result
    }

    /// The state, as soon as there is a frame or an event after these, or after `patience`.
    pub fn news(&self, frame: u64, event: u64, patience: Duration) -> MutexGuard<'_, State> {
        let until = Instant::now() + patience;
        let mut state = self.lock();
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if state.frames > frame || state.told > event || left.is_zero() {
                return state;
            }
            let woken = self.changed.wait_timeout(state, left);
            state = woken.unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timing(frame: u64, at_s: f64) -> Timing {
        Timing { frame, at_s, period_ms: 0.0, late: frame.is_multiple_of(2) }
    }

    #[test]
    fn the_rate_is_counted_over_the_last_two_seconds() {
        let mut state = State::default();
        assert_eq!(state.frames_per_s(), None);
        state.count(timing(1, 0.0));
        assert_eq!(state.frames_per_s(), None);
        state.count(timing(2, 4.0));
        assert_eq!(state.frames_per_s(), Some(0.25));
        (3..=60).for_each(|n| state.count(timing(n, 4.0 + (n - 2) as f64 / 16.0)));
        assert_eq!((state.frames_per_s(), state.late), (Some(16.0), 30));
        assert_eq!(state.times_after(58).iter().map(|t| t.frame).collect::<Vec<_>>(), [59, 60]);
    }

    #[test]
    fn events_are_counted_where_they_repeat_and_old_ones_go() {
        let mut state = State::default();
        let error = Error::device("no answer").at("tcp://x").help("is it there?");
        state.fault("link", &error);
        state.fault("link", &error);
        state.note("rig", "it is back");
        let told: Vec<_> = state.events_after(0).iter().map(|e| (e.number, e.count)).collect();
        assert_eq!(told, [(2, 2), (3, 1)]);
        assert_eq!(state.events_after(0)[0].text, "no answer (tcp://x): is it there?");
        // Between other events, and moved behind them, so that numbers rise.
        state.note_again("scene", "clipped");
        state.note("rig", "it is back");
        state.note_again("scene", "clipped");
        let told: Vec<_> = state.events_after(2).iter().map(|e| (e.number, e.count)).collect();
        assert_eq!(told, [(3, 1), (5, 1), (6, 2)]);
        (0..2 * EVENTS).for_each(|i| state.note("rig", i.to_string()));
        assert_eq!(state.events_after(0).len(), EVENTS);
    }

    #[test]
    fn who_waits_is_woken_by_news_or_after_a_while() {
        let shared = Shared::default();
        let began = Instant::now();
        drop(shared.news(0, 0, Duration::from_millis(20)));
        assert!(began.elapsed() >= Duration::from_millis(20));
        std::thread::scope(|s| {
            let waiting = s.spawn(|| shared.news(0, 0, Duration::from_secs(60)).frames);
            shared.change(|state| state.count(timing(1, 0.0)));
            assert_eq!(waiting.join().unwrap(), 1);
        });
    }
}
