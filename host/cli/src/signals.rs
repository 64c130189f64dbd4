//! Signals that end the program.

/// Time that work which can stop ([`super::stop`]) has for it after a signal: enough for a frame
/// in progress.
#[cfg(unix)]
const GRACE: std::time::Duration = std::time::Duration::from_secs(5);

/// Runs `last` before Ctrl-C, a request to end (SIGTERM) or a lost terminal (SIGHUP) ends this
/// program as it would have done anyway. Work under way that can stop ([`super::stop`]) is asked
/// to, `stopping` says so, and the program ends with the work ([`end_if_asked`]), with a second
/// signal, or after 5 s. Signals that the caller has it ignore, as `nohup` does, stay ignored.
/// Without Unix signals it does nothing.
pub fn before_signals_end(
    stopping: impl FnOnce() + Send + 'static,
    last: impl FnOnce() + Send + 'static,
) {
    #[cfg(unix)]
    {
        use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
        use signal_hook::{iterator::Signals, low_level::emulate_default_handler};
        use std::time::{Duration, Instant};
        const LOOK: Duration = Duration::from_millis(20);
        let ignored = ignored_signals();
        let ends = [SIGHUP, SIGINT, SIGTERM].into_iter().filter(|s| ignored >> (s - 1) & 1 == 0);
        // Without handlers the signals end the program all the same.
        let Ok(mut signals) = Signals::new(ends) else { return };
        std::thread::spawn(move || {
            let Some(signal) = signals.forever().next() else { return };
            if super::stop::ask(signal) {
                stopping();
                let end = Instant::now() + GRACE;
                while Instant::now() < end && signals.pending().next().is_none() {
                    std::thread::sleep(LOOK);
                }
            }
            last();
            let _ = emulate_default_handler(signal);
        });
    }
    #[cfg(not(unix))]
    drop((stopping, last));
}

/// Ends this program by the signal that its work has stopped for, if one has come: its caller sees
/// that it was interrupted.
pub fn end_if_asked() {
    #[cfg(unix)]
    if let Some(signal) = super::stop::asked() {
        let _ = signal_hook::low_level::emulate_default_handler(signal);
    }
}

/// The signals that this process ignores, bit n - 1 for signal n; none where Linux' `/proc` is
/// not there to say it.
#[cfg(unix)]
fn ignored_signals() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}
