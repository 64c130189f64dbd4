//! Long calls: without the interpreter's lock, with progress, and ended by Ctrl-C.
//!
//! The work runs on a thread of its own and says how far it is. The calling thread, which Python
//! gives its signals to, passes this on and looks for Ctrl-C; then the work is unwound where it
//! next says how far it is.

use pyo3::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

/// How often Ctrl-C is looked for.
const LOOK: Duration = Duration::from_millis(50);

/// What unwinds the work: no error, so that nothing is printed.
struct Stopped;

/// How far the work is: what it does, and how many parts of how many are done.
pub struct Step {
    /// What it does, in words.
    pub what: String,
    /// Parts that are done; 0 where nothing is counted.
    pub done: usize,
    /// Parts in all; 0 where nothing is counted.
    pub total: usize,
}

/// Runs `work`, which calls its argument at every step; `progress`, if any, is a Python function of
/// what is done (str), done and total (int).
///
/// # Errors
/// What `work` returns, an exception of `progress`, and `KeyboardInterrupt`.
pub fn run<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&(dyn Fn(Step) + Sync)) -> PyResult<T> + Send,
) -> PyResult<T> {
    let stop = AtomicBool::new(false);
    let progress = progress.map(|function| function.clone().unbind());
    let (steps, told) = channel::<Step>();
    py.detach(move || {
        std::thread::scope(|scope| {
            let stop = &stop;
            let worker = scope.spawn(move || {
                let steps = std::sync::Mutex::new(steps);
                let step = |step: Step| {
                    if stop.load(Ordering::Relaxed) {
                        resume_unwind(Box::new(Stopped));
                    }
                    if let Ok(steps) = steps.lock() {
                        // Nobody listens any more where the caller has an exception.
                        let _ = steps.send(step);
                    }
                };
                catch_unwind(AssertUnwindSafe(|| work(&step)))
            });
            let mut ended: PyResult<()> = Ok(());
            loop {
                let step = match told.recv_timeout(LOOK) {
                    Ok(step) => Some(step),
                    Err(RecvTimeoutError::Timeout) => None,
                    Err(RecvTimeoutError::Disconnected) => break,
                };
                let passed_on = Python::attach(|py| {
                    py.check_signals()?;
                    if let (Some(step), Some(function)) = (step, &progress) {
                        function.call1(py, (step.what, step.done, step.total))?;
                    }
                    Ok(())
                });
                if let (Ok(()), Err(exception)) = (&ended, passed_on) {
                    ended = Err(exception);
                    stop.store(true, Ordering::Relaxed);
                }
            }
            let result = worker.join().unwrap_or_else(|panic| resume_unwind(panic));
            ended?;
            result.unwrap_or_else(|panic| resume_unwind(panic))
        })
    })
}
