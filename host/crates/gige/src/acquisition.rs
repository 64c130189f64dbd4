//! When frames begin: by the frame rate, or by triggers.

use std::time::Duration;

/// An acquisition under way.
#[derive(Clone, Copy, Debug)]
pub struct Acquisition {
    /// Frames left, if they are limited.
    left: Option<u32>,
    /// When the next frame may begin.
    due: Duration,
    /// A trigger has come for the next frame; one that comes before that frame has begun counts
    /// for it too.
    triggered: bool,
    is_first: bool,
}

/// What begins a frame.
#[derive(Clone, Copy, Debug)]
pub enum Start {
    /// The time of a period.
    Period(Duration),
    /// A trigger.
    Trigger,
}

impl Acquisition {
    /// Begins now, with so many frames if they are limited.
    pub fn new(now: Duration, frames: Option<u32>) -> Self {
        Self { left: frames, due: now, triggered: false, is_first: true }
    }

    /// A trigger.
    pub fn trigger(&mut self) {
        self.triggered = true;
    }

    /// Whether its last frame has begun.
    pub fn is_over(&self) -> bool {
        self.left == Some(0)
    }

    /// Begins a frame if it is time, and returns whether the sensor stood by before it.
    pub fn begin(&mut self, now: Duration, start: Start) -> Option<bool> {
        let is_due = match start {
            Start::Period(_) => now >= self.due,
            Start::Trigger => self.triggered,
        };
        if self.is_over() || !is_due {
            return None;
        }
        self.triggered = false;
        self.left = self.left.map(|left| left - 1);
        let stood_by = self.is_first || matches!(start, Start::Trigger);
        self.is_first = false;
        if let Start::Period(period) = start {
            // A frame that was late does not delay the next ones, but they do not pile up.
            self.due = (self.due + period).max(now.saturating_sub(period));
        }
        Some(stood_by)
    }

    /// When the next frame begins by its period.
    pub fn due(&self) -> Duration {
        self.due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn frames_follow_their_period_and_do_not_pile_up() {
        let start = Start::Period(10 * MS);
        let mut a = Acquisition::new(5 * MS, None);
        assert_eq!((a.begin(4 * MS, start), a.begin(5 * MS, start)), (None, Some(true)));
        assert_eq!((a.begin(14 * MS, start), a.begin(16 * MS, start)), (None, Some(false)));
        assert_eq!(a.due(), 25 * MS, "late by 1 ms: the next is not");
        assert_eq!(a.begin(500 * MS, start), Some(false));
        assert_eq!(a.due(), 490 * MS);
    }

    #[test]
    fn triggered_frames_wait_for_their_trigger() {
        let mut a = Acquisition::new(Duration::ZERO, Some(2));
        assert_eq!(a.begin(MS, Start::Trigger), None);
        a.trigger();
        a.trigger();
        assert_eq!(a.begin(MS, Start::Trigger), Some(true));
        assert_eq!(a.begin(MS, Start::Trigger), None, "two before it began are one");
        a.trigger();
        assert_eq!(a.begin(MS, Start::Trigger), Some(true));
        assert!(a.is_over());
        a.trigger();
        assert_eq!(a.begin(MS, Start::Trigger), None);
    }
}
