//! When the frames of a stream began and ended, and whether a frame rate was kept.

use camrig_rig::Rig;
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// A frame is late when it begins later than it was due by more than this share of the period,
/// and by more than what an operating system may sleep too long, s.
const LATE_SHARE: f64 = 0.1;
const OVERSLEPT_S: f64 = 1e-3;
/// Share of the frame rate asked for below which it counts as missed: what a bench with a
/// tolerance of a few per cent can live with.
const KEPT_SHARE: f64 = 0.97;
/// Longest silence towards a rig between two frames: a third of what a server takes for a host
/// that has gone.
const SILENCE: Duration = Duration::from_secs(3);

/// The times of a stream's frames.
pub struct Pace {
    fps: Option<f64>,
    start: Instant,
    /// Seconds after the start at which each frame began, and its time to the last row, s.
    begun: Vec<f64>,
    latency: Vec<f64>,
    seconds: f64,
}

impl Pace {
    /// A stream at a frame rate, frames per second; as fast as it goes without one.
    pub fn new(fps: Option<f64>) -> Self {
        let (begun, latency) = (Vec::new(), Vec::new());
        Self { fps, start: Instant::now(), begun, latency, seconds: 0.0 }
    }

    /// The first frame is due.
    pub fn start(&mut self) {
        self.start = Instant::now();
    }

    /// Seconds after the start at which a frame is due.
    fn due(&self, frame: usize) -> Option<f64> {
        self.fps.map(|fps| frame as f64 / fps)
    }

    /// Waits until the next frame is due. In long pauses the rig hears that this host is there.
    pub fn wait(&self, rig: &mut Rig) {
        let Some(due) = self.due(self.begun.len()) else { return };
        let due = self.start + Duration::from_secs_f64(due);
        loop {
            let left = due.saturating_duration_since(Instant::now());
            if left <= SILENCE {
                return std::thread::sleep(left);
            }
            std::thread::sleep(SILENCE);
            // A link that has broken is opened again with the frame, which says so.
            let _ = rig.keep_alive();
        }
    }

    /// A frame begins.
    pub fn begin(&mut self) {
        self.begun.push(self.start.elapsed().as_secs_f64());
    }

    /// Its last row has come.
    pub fn end(&mut self) {
        let begun = self.begun.last().copied().unwrap_or(0.0);
        self.latency.push(self.start.elapsed().as_secs_f64() - begun);
    }

    /// The stream is over.
    pub fn finish(&mut self) {
        self.seconds = self.start.elapsed().as_secs_f64();
    }

    /// From the start to the end, s.
    pub fn seconds(&self) -> f64 {
        self.seconds
    }

    /// Frames per second: the periods between the beginnings of frames; of one frame, its time.
    pub fn frames_per_s(&self) -> f64 {
        match self.begun[..] {
            [first, .., last] => (self.begun.len() - 1) as f64 / (last - first),
            _ => self.begun.len() as f64 / self.seconds,
        }
    }

    /// How much later than due each frame began, s; 0 without a frame rate.
    fn lateness(&self) -> impl Iterator<Item = f64> + '_ {
        let frames = self.begun.iter().enumerate();
        frames.map(move |(i, begun)| self.due(i).map_or(0.0, |due| (begun - due).max(0.0)))
    }

    /// Frames that began late.
    pub fn late(&self) -> usize {
        let limit = self.fps.map_or(f64::INFINITY, |fps| LATE_SHARE / fps + OVERSLEPT_S);
        self.lateness().filter(|late| *late > limit).count()
    }

    /// Whether the frame rate asked for was reached; `None` where none was.
    pub fn is_kept(&self) -> Option<bool> {
        self.fps.map(|fps| self.late() == 0 || self.frames_per_s() >= KEPT_SHARE * fps)
    }

    /// Words about frames that came late.
    pub fn said(&self) -> Option<String> {
        let (fps, late, frames) = (self.fps?, self.late(), self.begun.len());
        let worst = 1e3 * self.lateness().fold(0.0, f64::max);
        let rate = self.frames_per_s();
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

    /// Latencies at these shares of the frames (nearest rank), ms.
    pub fn latency_ms<const N: usize>(&self, shares: [f64; N]) -> [f64; N] {
        let mut sorted = self.latency.clone();
        sorted.sort_by(f64::total_cmp);
        let rank = |p: f64| ((p * sorted.len() as f64).ceil() as usize).max(1) - 1;
        shares.map(|p| sorted.get(rank(p)).map_or(0.0, |s| 1e3 * s))
    }

    /// The times of each frame.
    pub fn json(&self) -> Vec<Value> {
        let times = self.begun.iter().zip(&self.latency).zip(self.lateness());
        let time = |((begun, latency), late): ((&f64, &f64), f64)| {
            let late_ms = self.fps.map(|_| 1e3 * late);
            json!({ "begin_s": begun, "latency_ms": 1e3 * latency, "late_ms": late_ms })
        };
        times.map(time).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stream(fps: Option<f64>, begun: &[f64]) -> Pace {
        let (begun, latency) = (begun.to_vec(), vec![0.01; begun.len()]);
        Pace { fps, start: Instant::now(), begun, latency, seconds: 10.0 }
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
    fn latencies_are_of_the_nearest_rank() {
        let mut pace = stream(None, &[0.0; 4]);
        pace.latency = vec![0.004, 0.001, 0.003, 0.002];
        let found = pace.latency_ms([0.5, 0.99, 1.0]).map(|ms| ms.round());
        assert_eq!(found, [2.0, 4.0, 4.0]);
    }
}
