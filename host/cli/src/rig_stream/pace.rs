//! Timing of a stream's frames, and whether a frame rate was kept.

use crate::stop::Stoppable;
use camrig_rig::Rig;
use camrig_rig::trigger::Trigger;
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// A frame is late if it begins later than due by more than this fraction of the period plus the
/// time by which an operating system may oversleep, s.
pub const LATE_SHARE: f64 = 0.1;
pub const OVERSLEPT_S: f64 = 1e-3;
/// Fraction of the requested frame rate below which it counts as missed: a bench can tolerate a few
/// per cent.
const KEPT_SHARE: f64 = 0.97;
/// Longest silence towards a rig between two frames: a third of the time after which a server drops
/// a host.
const SILENCE: Duration = Duration::from_secs(3);
/// Number of the newest latencies that are kept: a stream may run for days, and 8 MiB of latencies
/// are nine hours at 30 frames/s.
const LATENCIES: u64 = 1 << 20;

/// The times of a stream's frames.
pub struct Pace {
    trigger: Option<Trigger>,
    start: Instant,
    frames: u64,
    /// Seconds after the start at which the first frame began, and the newest.
    first: f64,
    newest: f64,
    /// Frames that began late, and the largest delay of any, s.
    late: u64,
    worst: f64,
    /// Time to the last row of the newest frames, s, and the largest of all.
    latency: Vec<f64>,
    longest: f64,
    seconds: f64,
}

/// Waits until a frame is due, or a signal asks to stop; keeps the link alive in long pauses.
pub fn wait_until(due: Instant, rig: &mut Rig, stop: &Stoppable) {
    loop {
        let now = Instant::now();
        stop.sleep_until(due.min(now + SILENCE));
        if due <= now + SILENCE || stop.is_asked() {
            return;
        }
        // A broken link is reopened with the next frame, with a note.
        let _ = rig.keep_alive();
    }
}

/// The times of one frame, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameTime {
    /// After the start of the stream.
    pub begin: f64,
    /// From its beginning to its last row.
    pub latency: f64,
    /// After it was due; `None` without a frame rate.
    pub late: Option<f64>,
}

impl FrameTime {
    /// For `--json`.
    pub fn json(&self) -> Value {
        let (latency_ms, late_ms) = (1e3 * self.latency, self.late.map(|late| 1e3 * late));
        json!({ "begin_s": self.begin, "latency_ms": latency_ms, "late_ms": late_ms })
    }
}

impl Pace {
    /// A stream at the rate of a trigger; as fast as possible without one.
    pub fn new(trigger: Option<Trigger>) -> Self {
        Self {
            trigger,
            start: Instant::now(),
            frames: 0,
            first: 0.0,
            newest: 0.0,
            late: 0,
            worst: 0.0,
            latency: Vec::new(),
            longest: 0.0,
            seconds: 0.0,
        }
    }

    /// When the first trigger comes.
    pub fn start(&mut self, at: Instant) {
        self.start = at;
    }

    fn fps(&self) -> Option<f64> {
        self.trigger.map(|trigger| trigger.fps)
    }

    /// Seconds after the start at which a frame is due.
    pub fn due(&self, frame: u64) -> Option<f64> {
        self.trigger.map(|trigger| trigger.begin_s(frame))
    }

    /// Waits until the next frame is due, or a signal asks the stream to end.
    pub fn wait(&self, rig: &mut Rig, stop: &Stoppable) {
        if let Some(due) = self.due(self.frames) {
            wait_until(self.start + Duration::from_secs_f64(due), rig, stop);
        }
    }

    /// A frame begins.
    pub fn begin(&mut self) {
        self.begin_at(self.start.elapsed().as_secs_f64());
    }

    fn begin_at(&mut self, begin: f64) {
        if self.frames == 0 {
            self.first = begin;
        }
        self.newest = begin;
        let late = self.lateness().unwrap_or(0.0);
        let limit = self.fps().map_or(f64::INFINITY, |fps| LATE_SHARE / fps + OVERSLEPT_S);
        self.late += u64::from(late > limit);
        self.worst = self.worst.max(late);
    }

    /// By how much the newest frame began later than due, s; `None` without a frame rate.
    fn lateness(&self) -> Option<f64> {
        self.due(self.frames).map(|due| (self.newest - due).max(0.0))
    }

    /// Its last row has arrived.
    pub fn end(&mut self) -> FrameTime {
        self.end_after(self.start.elapsed().as_secs_f64() - self.newest)
    }

    fn end_after(&mut self, latency: f64) -> FrameTime {
        let late = self.lateness();
        match self.latency.get_mut((self.frames % LATENCIES) as usize) {
            Some(oldest) => *oldest = latency,
            None => self.latency.push(latency),
        }
        self.longest = self.longest.max(latency);
        self.frames += 1;
        FrameTime { begin: self.newest, latency, late }
    }

    /// The stream is over.
    pub fn finish(&mut self) {
        self.seconds = self.start.elapsed().as_secs_f64();
    }

    /// Frames taken.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// From the start to the end, s.
    pub fn seconds(&self) -> f64 {
        self.seconds
    }

    /// Frames per second: the periods between the beginnings of frames; of one frame, its time.
    pub fn frames_per_s(&self) -> f64 {
        match self.frames {
            0 | 1 => self.frames as f64 / self.seconds,
            n => (n - 1) as f64 / (self.newest - self.first),
        }
    }

    /// Number of frames that began late.
    pub fn late(&self) -> u64 {
        self.late
    }

    /// Whether the requested frame rate was reached; `None` without one.
    pub fn is_kept(&self) -> Option<bool> {
        self.fps().map(|fps| self.late == 0 || self.frames_per_s() >= KEPT_SHARE * fps)
    }

    /// Message about late frames.
    pub fn said(&self) -> Option<String> {
        let (fps, late, frames) = (self.fps()?, self.late, self.frames);
        let (worst, rate) = (1e3 * self.worst, self.frames_per_s());
        match self.is_kept()? {
            false => Some(format!(
                "the frame rate was not reached: {rate:.2} instead of {fps} frames/s; {late} of \
                 {frames} frames began late, by up to {worst:.1} ms"
            )),
            true if late > 0 => {
                Some(format!("note: {late} of {frames} frames began late, by up to {worst:.1} ms"))
            }
            true => None,
        }
    }

    /// Latencies at these shares of the newest million frames (nearest rank), ms.
    pub fn latency_ms<const N: usize>(&self, shares: [f64; N]) -> [f64; N] {
        let mut sorted = self.latency.clone();
        sorted.sort_by(f64::total_cmp);
        let rank = |p: f64| ((p * sorted.len() as f64).ceil() as usize).max(1) - 1;
        shares.map(|p| sorted.get(rank(p)).map_or(0.0, |s| 1e3 * s))
    }

    /// The largest latency of all frames, ms.
    pub fn longest_ms(&self) -> f64 {
        1e3 * self.longest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stream(fps: Option<f64>, begun: &[f64]) -> Pace {
        let mut pace = Pace { seconds: 10.0, ..Pace::new(fps.map(Trigger::steady)) };
        for &begin in begun {
            pace.begin_at(begin);
            pace.end_after(0.01);
        }
        pace
    }

    #[test]
    fn the_rate_counts_periods() {
        let pace = stream(Some(5.0), &[0.0, 0.2, 0.4, 0.6]);
        assert!((pace.frames_per_s() - 5.0).abs() < 1e-9);
        assert_eq!((pace.late(), pace.is_kept(), pace.said()), (0, Some(true), None));
        assert_eq!(stream(None, &[0.0]).frames_per_s(), 0.1);
        assert_eq!(stream(None, &[0.0, 1.0, 2.0]).is_kept(), None);
    }

    #[test]
    fn late_frames_are_counted_and_a_missed_rate_is_told() {
        // Period 0.2 s: late from 21 ms on.
        let one = stream(Some(5.0), &[0.0, 0.22, 0.45, 0.6]);
        assert_eq!((one.late(), one.is_kept()), (1, Some(true)));
        assert!(one.said().unwrap().starts_with("note: 1 of 4 frames began late, by up to 50.0"));
        let slow = stream(Some(5.0), &[0.0, 0.4, 0.8, 1.2]);
        assert_eq!((slow.late(), slow.is_kept()), (3, Some(false)));
        assert!(slow.said().unwrap().contains("2.50 instead of 5 frames/s; 3 of 4"));
    }

    #[test]
    fn each_frame_tells_how_late_it_was() {
        let mut pace = Pace::new(Some(Trigger::steady(5.0)));
        pace.begin_at(0.0);
        assert_eq!(pace.end_after(0.02).late, Some(0.0));
        pace.begin_at(0.25);
        let time = pace.end_after(0.03);
        assert!((time.late.unwrap() - 0.05).abs() < 1e-12 && time.latency == 0.03, "{time:?}");
        assert_eq!(pace.longest_ms(), 30.0);
    }

    #[test]
    fn latencies_are_of_the_nearest_rank() {
        let mut pace = Pace::new(None);
        pace.latency = vec![0.004, 0.001, 0.003, 0.002];
        let found = pace.latency_ms([0.5, 0.99, 1.0]).map(|ms| ms.round());
        assert_eq!(found, [2.0, 4.0, 4.0]);
    }

    /// What a stream of days needs to know of its frames does not grow with them.
    #[test]
    fn memory_does_not_follow_the_number_of_frames() {
        let mut pace = Pace::new(None);
        for frame in 0..LATENCIES + 10 {
            pace.begin_at(frame as f64);
            pace.end_after(if frame < 5 { 9.0 } else { 0.5 });
        }
        assert_eq!((pace.latency.len() as u64, pace.frames()), (LATENCIES, LATENCIES + 10));
        assert_eq!((pace.longest_ms(), pace.latency_ms([1.0])), (9000.0, [500.0]));
    }
}
