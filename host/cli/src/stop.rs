//! Work that a signal stops between two of its pieces, instead of ending the program at once: a
//! stream of frames, for instance, which ends with the frame in progress.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

struct State {
    /// Pieces of work under way that can stop.
    works: usize,
    /// The signal that asked them to.
    signal: Option<i32>,
}

static STATE: Mutex<State> = Mutex::new(State { works: 0, signal: None });
static CHANGED: Condvar = Condvar::new();

fn lock() -> MutexGuard<'static, State> {
    // Whole in any case: each change is one assignment.
    STATE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Work under way that can stop. While one exists, the first signal does not end the program.
#[derive(Debug)]
pub struct Stoppable(());

impl Stoppable {
    /// Work begins.
    #[allow(clippy::new_without_default, reason = "it is counted, not a value")]
    pub fn new() -> Self {
        lock().works += 1;
        Self(())
    }

    /// Whether it has been asked to stop.
    pub fn is_asked(&self) -> bool {
        lock().signal.is_some()
    }

    /// Sleeps until a time, or until it is asked to stop.
    pub fn sleep_until(&self, time: Instant) {
        let mut state = lock();
        loop {
            let left: Duration = time.saturating_duration_since(Instant::now());
            if state.signal.is_some() || left.is_zero() {
                return;
            }
            let woken = CHANGED.wait_timeout(state, left);
            state = woken.unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

impl Drop for Stoppable {
    fn drop(&mut self) {
        lock().works -= 1;
    }
}

/// Asks the work under way to stop for a signal; false where there is none that can.
#[cfg_attr(not(unix), allow(dead_code, reason = "there are no signals"))]
pub fn ask(signal: i32) -> bool {
    let mut state = lock();
    let can = state.works > 0;
    if can {
        state.signal = Some(signal);
        CHANGED.notify_all();
    }
    can
}

/// The signal that work has been asked to stop for.
#[cfg_attr(not(unix), allow(dead_code, reason = "there are no signals"))]
pub fn asked() -> Option<i32> {
    lock().signal
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_asked_once_it_is_there_and_sleepers_wake() {
        assert!(!ask(2), "nothing can stop");
        let work = Stoppable::new();
        assert!(!work.is_asked());
        let began = Instant::now();
        work.sleep_until(began + Duration::from_millis(30));
        assert!(began.elapsed() >= Duration::from_millis(30));
        std::thread::scope(|s| {
            s.spawn(|| work.sleep_until(Instant::now() + Duration::from_secs(60)));
            std::thread::sleep(Duration::from_millis(20));
            assert!(ask(2));
        });
        assert!(work.is_asked() && asked() == Some(2));
        assert!(began.elapsed() < Duration::from_secs(30));
    }
}
