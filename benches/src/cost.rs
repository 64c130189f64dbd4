//! Cost of work: time and memory of this process.

use std::time::Instant;

/// Wall time and processor time over all threads, s.
#[derive(Clone, Copy)]
pub struct Time {
    /// Wall time, s.
    pub wall: f64,
    /// Processor time over all threads, s.
    pub cpu: f64,
}

impl Time {
    /// Longer than any measured time.
    pub fn most() -> Self {
        Self { wall: f64::MAX, cpu: f64::MAX }
    }

    /// Runs a piece of work and measures it.
    pub fn of(work: impl FnOnce()) -> Self {
        let (start, cpu) = (Instant::now(), processor_seconds());
        work();
        Self { wall: start.elapsed().as_secs_f64(), cpu: processor_seconds() - cpu }
    }

    /// The shorter of two, wall time and processor time each by itself.
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

/// User and system time of this process, s, in steps of 10 ms on Linux; NaN elsewhere.
fn processor_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The name of the program may contain blanks. After it come state and fields 4 and following;
    // 14 and 15 are the times.
    let ticks = stat.rsplit_once(')').map(|(_, rest)| {
        rest.split_whitespace().skip(11).take(2).filter_map(|t| t.parse::<f64>().ok()).sum::<f64>()
    });
    ticks.map_or(f64::NAN, |t| t / 100.0)
}

/// The largest resident memory of this process, on Linux.
pub fn peak_bytes() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse::<f64>().ok().map(|kib| kib * 1024.0)
}

/// Bytes in a readable unit.
pub fn memory(bytes: Option<f64>) -> String {
    bytes.map_or("?".into(), |b| format!("{:.0} MiB", b / f64::from(1 << 20)))
}
