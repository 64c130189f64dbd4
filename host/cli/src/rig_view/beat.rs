//! Frame timing of the console.

use crate::rig_stream::pace;
use crate::stop::Stoppable;
use camrig_rig::Rig;
use std::time::{Duration, Instant};

/// The beat of the frames. Unlike a stream's, it does not catch up: after a late frame the next is
/// due one period later.
pub struct Beat {
    period: Duration,
    /// When the next frame is due; `None` for immediately.
    due: Option<Instant>,
}

impl Beat {
    /// A beat of `fps` frames per second.
    pub fn new(fps: f64) -> Self {
        Self { period: Duration::from_secs_f64(1.0 / fps), due: None }
    }

    /// Makes the next frame due immediately.
    pub fn restart(&mut self) {
        self.due = None;
    }

    /// Waits until the next frame is due, or a signal asks to stop.
    pub fn wait(&self, rig: &mut Rig, stop: &Stoppable) {
        if let Some(due) = self.due {
            pace::wait_until(due, rig, stop);
        }
    }

    /// Begins a frame; returns whether it is late.
    pub fn begin(&mut self, now: Instant) -> bool {
        let due = self.due.unwrap_or(now);
        let tolerance =
            self.period.mul_f64(pace::LATE_SHARE) + Duration::from_secs_f64(pace::OVERSLEPT_S);
        let late = now > due + tolerance;
        self.due = Some(if late { now } else { due } + self.period);
        late
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_frame_is_counted_once_and_small_delays_do_not_add_up() {
        let mut beat = Beat::new(10.0);
        let start = Instant::now();
        let mut begins = |ms: u64| beat.begin(start + Duration::from_millis(ms));
        // Tolerance: 10 ms and 1 ms.
        assert!(!begins(0) && !begins(110) && !begins(211));
        assert!(begins(312), "12 ms after it was due at 300");
        assert!(!begins(412), "it was due again one period after the late one");
        assert!(begins(1000) && !begins(1100));
    }
}
