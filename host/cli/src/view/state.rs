//! What the console knows: the newest frame, figures over frames, events. The streaming thread
//! writes it, the pages' threads read it.

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
/// Time over which the frame rate is counted, s. A trade: the figure follows a change and still
/// can be read.
const RATE_OVER_S: f64 = 2.0;
/// Events that are kept for pages that come later.
const EVENTS: usize = 100;

/// What a frame was exposed to.
pub struct Light {
    /// The light on a scene of reflectances.
    pub illuminant: Option<Illuminant>,
    /// What the irradiance was made from.
    pub header: CubeHeader,
    /// Colour and white of such frames.
    pub info: DngInfo,
}

/// A frame and how it came about.
pub struct Frame {
    /// Counted from 1.
    pub number: u64,
    /// The samples.
    pub raw: RawFrame,
    /// Exposure and gain in force.
    pub settings: FrameSettings,
    /// The sensor's frame counter.
    pub counter: u16,
    /// What the rig did to it on request of its registers.
    pub injected: Option<String>,
    /// What it was exposed to.
    pub light: Arc<Light>,
}

/// What does not change.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Source {
    /// The camera's name.
    pub camera: String,
    /// The rig's address, without its token.
    pub rig: String,
    /// Frames per second that are asked for.
    pub fps: f64,
    /// Scenes to choose from.
    pub scenes: Vec<String>,
    /// Lights to choose from.
    pub illuminants: Vec<String>,
}

/// What was asked for last.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Settings {
    /// Exposure, s.
    pub exposure_s: f64,
    /// Gain.
    pub analog_gain: f64,
    /// Whether the exposure follows the light.
    pub auto_exposure: bool,
    /// Illuminance, lx; `None` for a scene in its own light.
    pub lux: Option<f64>,
    /// The light's name; `None` for a scene in its own light.
    pub illuminant: Option<String>,
    /// The scene's name.
    pub scene: String,
}

/// How the stream is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// No frame has come yet.
    #[default]
    Starting,
    /// Frames come.
    Streaming,
    /// The link is down and is being opened again.
    Reconnecting,
}

/// When a frame began.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Timing {
    /// The frame's number.
    pub frame: u64,
    /// After the start of the stream, s.
    pub at_s: f64,
    /// After the beginning of the frame before, ms.
    pub period_ms: f64,
    /// Whether it began late.
    pub late: bool,
}

/// Something to be told.
#[derive(Clone, Debug, Serialize)]
pub struct Event {
    /// Counted from 1; one that is repeated gets a new number.
    pub number: u64,
    /// Frames that had come before it.
    pub frame: u64,
    /// What it is about: `rig`, `link`, `page`, `optics`, `scene`.
    pub source: &'static str,
    /// In words.
    pub text: String,
    /// Whether something went wrong.
    pub error: bool,
    /// How often it happened: in a row, or at all where there is cause for it again and again.
    pub count: u32,
}

/// A register of the rig.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Register {
    /// Its address.
    pub address: u16,
    /// What it is, with its unit.
    pub name: &'static str,
    /// What it holds.
    pub value: u32,
    /// Whether it takes values.
    pub writable: bool,
}

/// A recording under way.
#[derive(Clone, Debug, Serialize)]
pub struct Recording {
    /// The file.
    pub path: String,
    /// Frames in it.
    pub frames: u64,
}

/// A scene that changes, so far.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Progress {
    /// Frames that showed the light before once more, as the next was not there in time.
    pub late: u64,
    /// Its own frames, counted; null of a scene that is no sequence.
    pub frames: Value,
}

/// The stream so far.
#[derive(Default)]
pub struct State {
    /// What does not change.
    pub source: Source,
    /// What was asked for.
    pub settings: Settings,
    /// How the stream is.
    pub status: Status,
    /// What is being computed, in words.
    pub busy: Option<String>,
    /// The newest frame.
    pub newest: Option<Arc<Frame>>,
    /// Frames begun, those that were dropped included.
    pub frames: u64,
    /// Frames that began late.
    pub late: u64,
    /// Frames that the rig dropped on request.
    pub dropped: u64,
    /// The scene, where it changes.
    pub scene: Option<Progress>,
    /// The registers as read last.
    pub registers: Vec<Register>,
    /// The recording under way.
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

    /// Times of frames after one.
    pub fn times_after(&self, frame: u64) -> Vec<Timing> {
        self.times.iter().filter(|t| t.frame > frame).copied().collect()
    }

    /// Events after one.
    pub fn events_after(&self, number: u64) -> Vec<&Event> {
        self.events.iter().filter(|e| e.number > number).collect()
    }

    /// Tells something.
    pub fn note(&mut self, source: &'static str, text: impl Into<String>) {
        self.tell(source, text.into(), false, 1);
    }

    /// Tells something for which there is cause again and again, between other things: it stays one
    /// event, which counts.
    pub fn note_again(&mut self, source: &'static str, text: impl Into<String>) {
        self.tell(source, text.into(), false, EVENTS);
    }

    /// Tells that something went wrong: what, where, and what would be right.
    pub fn fault(&mut self, source: &'static str, error: &Error) {
        let place = error.place().map_or(String::new(), |place| format!(" ({place})"));
        let remedy = error.remedy().map_or(String::new(), |remedy| format!(": {remedy}"));
        self.tell(source, format!("{}{place}{remedy}", error.what()), true, 1);
    }

    /// Tells something, which is one event with the same among the last ones.
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
    /// A stream that has not begun.
    pub fn new(source: Source, settings: Settings) -> Self {
        let state = State { source, settings, ..State::default() };
        Self { state: Mutex::new(state), changed: Condvar::new() }
    }

    /// The state as it is.
    pub fn lock(&self) -> MutexGuard<'_, State> {
        // A thread that panicked has left the figures as they were.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the state and wakes who waits for news.
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
