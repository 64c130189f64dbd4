//! What work costs: time and memory of this process.

use std::time::Instant;

/// Seconds of the clock, and of the processor over all threads.
#[derive(Clone, Copy)]
pub struct Time {
    /// Of the clock.
    pub wall: f64,
    /// Of the processor, over all threads.
    pub cpu: f64,
}

impl Time {
    /// Longer than any.
    pub fn most() -> Self {
        Self { wall: f64::MAX, cpu: f64::MAX }
    }

    /// What a piece of work takes.
    pub fn of(work: impl FnOnce()) -> Self {
        let (start, cpu) = (Instant::now(), processor_seconds());
        work();
        Self { wall: start.elapsed().as_secs_f64(), cpu: processor_seconds() - cpu }
    }

    /// The shorter of two, each by itself.
    #[must_use]
    pub fn best(self, other: Self) -> Self {
        Self { wall: self.wall.min(other.wall), cpu: self.cpu.min(other.cpu) }
    }
}

impl std::fmt::Display for Time {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:7.3} s, {:7.3} s", self.wall, self.cpu)
    }
}

/// Of this process, user and system, where Linux tells it (in hundredths of a second); else not a
/// number.
fn processor_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // After the program's name, which may hold blanks: state, then fields 4 on; 14 and 15 are the
    // times.
    let ticks = stat.rsplit_once(')').map(|(_, rest)| {
        rest.split_whitespace().skip(11).take(2).filter_map(|t| t.parse::<f64>().ok()).sum::<f64>()
    });
    ticks.map_or(f64::NAN, |t| t / 100.0)
}

/// This process's largest resident memory, where Linux tells it.
pub fn peak_bytes() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse::<f64>().ok().map(|kib| kib * 1024.0)
}

/// Bytes as a person reads them.
pub fn memory(bytes: Option<f64>) -> String {
    bytes.map_or("?".into(), |b| format!("{:.0} MiB", b / f64::from(1 << 20)))
}
