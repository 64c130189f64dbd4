//! When the rows of a sensor collect light: `[sensor.timing]` of a camera file.
//!
//! The row with place o in the order of reading ends its exposure in frame k when it is read,
//!
//! close = t₀ + Σ_{j<k} P_j + o t_line, open = close − T,
//!
//! with line time t_line, exposure T, and the frame period P, the frame length times the line time.
//! A rolling shutter has o = row where it reads from the top and o = rows − 1 − row from the
//! bottom; a global one has o = 0. Time 0 is when the first window of frame 0 opens: t₀ = T of that
//! frame. A change of the exposure moves openings only. Frame length and line time are what a
//! sensor's registers of these names hold.

use camrig_base::{Error, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Whether rows collect light one after the other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(inline)]
#[non_exhaustive]
pub enum Shutter {
    /// Each row a line time after the one before.
    #[default]
    Rolling,
    /// All rows at once.
    Global,
}

/// `[sensor.timing]` of a camera file, checked.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct SensorTiming {
    /// Time from one row to the next, µs.
    pub line_time_us: f64,
    /// Lines of a frame, those without pixels included.
    pub frame_length_lines: u32,
    /// Whether rows collect light one after the other.
    pub shutter: Shutter,
    /// Whether rows are read from the bottom up.
    pub upwards: bool,
}

impl SensorTiming {
    /// Frame period for an exposure, s: its lines are at least those of the exposure.
    #[must_use]
    pub fn period_s(&self, exposure_s: f64) -> f64 {
        /// An exposure of whole lines may be off by its rounding, lines.
        const ROUNDING: f64 = 1e-3;
        let line_s = 1e-6 * self.line_time_us;
        let exposed = (exposure_s / line_s - ROUNDING).ceil();
        exposed.max(f64::from(self.frame_length_lines)) * line_s
    }

    /// Time in which so many rows are read, s.
    fn read_s(&self, rows: u32) -> f64 {
        f64::from(rows) * 1e-6 * self.line_time_us
    }
}

/// A number with as many digits as a person reads.
fn rounded(value: f64) -> f64 {
    (1e4 * value).round() / 1e4
}

/// When a row collects light, after the beginning of its frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// When it begins, s.
    pub start_s: f64,
    /// How long it lasts, s.
    pub exposure_s: f64,
}

impl Window {
    /// When it ends, s.
    #[must_use]
    pub fn end_s(&self) -> f64 {
        self.start_s + self.exposure_s
    }
}

/// When the rows of one frame collect light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowWindows {
    /// When the first row is read, s.
    first_close_s: f64,
    exposure_s: f64,
    /// Time from one row to the next, s; 0 for a global shutter.
    line_s: f64,
    rows: u32,
    upwards: bool,
}

impl RowWindows {
    /// When the rows open and close, s, from the top.
    pub fn rows(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        (0..self.rows).map(|row| self.row(row))
    }

    /// When a row opens and closes, s.
    #[must_use]
    pub fn row(&self, row: u32) -> [f64; 2] {
        let order = if self.upwards { self.rows - 1 - row } else { row };
        self.at(order.into())
    }

    /// When a place between the upper edge (0) and the lower edge (1) opens and closes, s.
    #[must_use]
    pub fn place(&self, place: f64) -> [f64; 2] {
        let row = place * f64::from(self.rows) - 0.5;
        let last = f64::from(self.rows - 1);
        self.at(if self.upwards { last - row } else { row }.clamp(0.0, last))
    }

    /// When the first row opens and the last one closes, s.
    #[must_use]
    pub fn span(&self) -> [f64; 2] {
        [self.at(0.0)[0], self.at(f64::from(self.rows - 1))[1]]
    }

    /// The windows of one of several exposures in these: each begins so long after these open.
    #[must_use]
    pub fn part(&self, window: &Window) -> Self {
        let before_the_end_s = self.exposure_s - window.end_s();
        let first_close_s = self.first_close_s - before_the_end_s;
        Self { first_close_s, exposure_s: window.exposure_s, ..*self }
    }

    /// Whether all rows collect light at once.
    #[must_use]
    pub fn are_one(&self) -> bool {
        self.line_s == 0.0
    }

    fn at(&self, order: f64) -> [f64; 2] {
        let close = self.first_close_s + order * self.line_s;
        [close - self.exposure_s, close]
    }
}

/// How long the frames of a sensor are: what was asked for, else as short as its timing allows.
#[derive(Clone, Copy, Debug)]
pub struct FramePeriod {
    timing: Option<SensorTiming>,
    /// Time in which all rows are read, s; 0 where it is not known.
    read_s: f64,
    asked_s: Option<f64>,
}

impl FramePeriod {
    /// Frames of `rows` rows, of a sensor whose timing may be unknown; one in `asked_s` seconds, if
    /// that is given.
    ///
    /// # Errors
    /// Fewer lines than rows, or a period that is too short for them.
    pub fn new(timing: Option<SensorTiming>, rows: u32, asked_s: Option<f64>) -> Result<Self> {
        if let Some(lines) = timing.map(|t| t.frame_length_lines).filter(|lines| *lines < rows) {
            return Err(Error::disagreement(format!("{lines} lines for a frame of {rows} rows"))
                .help("a frame length is the rows and those without pixels"));
        }
        let read_s = timing.map_or(0.0, |timing| timing.read_s(rows));
        if let Some(asked_s) = asked_s.filter(|asked_s| *asked_s < read_s * (1.0 - 1e-9)) {
            let [rate, read_ms] = [1.0 / asked_s, 1e3 * read_s].map(rounded);
            let what = format!("{rate} frames/s of {rows} rows in {read_ms} ms");
            return Err(Error::limit(what).help("lower the frame rate or the line time"));
        }
        Ok(Self { timing, read_s, asked_s })
    }

    /// From the begin of a frame of this exposure to that of the next, s; `None` where neither a
    /// period was asked for nor the timing is known.
    ///
    /// # Errors
    /// An exposure longer than the period that was asked for.
    pub fn of(&self, exposure_s: f64) -> Result<Option<f64>> {
        /// An exposure is stored in 32 bits.
        const ROUNDING: f64 = 1e-6;
        if let Some(asked_s) = self.asked_s.filter(|s| exposure_s > s * (1.0 + ROUNDING)) {
            let [exposure, rate, period] =
                [1e3 * exposure_s, 1.0 / asked_s, 1e3 * asked_s].map(rounded);
            return Err(Error::limit(format!(
                "an exposure of {exposure} ms is longer than a frame at {rate} frames/s, \
                 {period} ms"
            ))
            .help("shorten the exposure or lower the frame rate"));
        }
        let fastest = || self.timing.map(|timing| timing.period_s(exposure_s));
        Ok(self.asked_s.or_else(fastest).map(|period_s| period_s.max(self.read_s)))
    }
}

/// The windows of frame after frame.
#[derive(Clone, Debug)]
pub struct FrameClock {
    timing: SensorTiming,
    rows: u32,
    period: FramePeriod,
    /// When the first row of the frame before was read, s.
    last_close_s: Option<f64>,
}

impl FrameClock {
    /// Frames of `rows` rows, as fast as `timing` allows or one in `period_s` seconds.
    ///
    /// # Errors
    /// Those of [`FramePeriod::new`].
    pub fn new(timing: SensorTiming, rows: u32, period_s: Option<f64>) -> Result<Self> {
        let period = FramePeriod::new(Some(timing), rows, period_s)?;
        Ok(Self { timing, rows, period, last_close_s: None })
    }

    /// How long frames are.
    #[must_use]
    pub fn period(&self) -> FramePeriod {
        self.period
    }

    /// The windows of the next frame, for its exposure.
    ///
    /// # Errors
    /// An exposure longer than the frame period that was asked for.
    pub fn next(&mut self, exposure_s: f64) -> Result<RowWindows> {
        let period_s = self.period.of(exposure_s)?.unwrap_or_default();
        // Frame 0 opens at 0. A row opens when the frame before has been read from it, or later.
        let first_close_s = self.last_close_s.map_or(exposure_s, |last| last + period_s);
        self.last_close_s = Some(first_close_s);
        let rolling = self.timing.shutter == Shutter::Rolling;
        Ok(RowWindows {
            first_close_s,
            exposure_s,
            line_s: if rolling { 1e-6 * self.timing.line_time_us } else { 0.0 },
            rows: self.rows,
            upwards: self.timing.upwards,
        })
    }

    /// Another timing from the next frame on, as registers change it.
    pub fn set(&mut self, timing: SensorTiming) {
        let read_s = timing.read_s(self.rows);
        self.period = FramePeriod { timing: Some(timing), read_s, asked_s: None };
        self.timing = timing;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clock(line_us: f64, frame_lines: u32, rows: u32) -> FrameClock {
        let timing = SensorTiming {
            line_time_us: line_us,
            frame_length_lines: frame_lines,
            shutter: Shutter::Rolling,
            upwards: false,
        };
        FrameClock::new(timing, rows, None).unwrap()
    }

    /// Every window of golden/light/row_windows.csv, whose time 0 is the first row's reading.
    #[test]
    fn windows_are_those_of_the_equations() {
        let Some(file) = camrig_testing::shared("golden/light/row_windows.csv") else { return };
        let text = std::fs::read_to_string(file).unwrap();
        let mut lines = 0;
        for line in text.lines().skip(1) {
            let fields: Vec<&str> = line.split(',').collect();
            let number = |i: usize| fields[i].parse::<f64>().unwrap();
            let timing = SensorTiming {
                line_time_us: number(1),
                frame_length_lines: number(2) as u32,
                shutter: if fields[5] == "global" { Shutter::Global } else { Shutter::Rolling },
                upwards: fields[6] == "up",
            };
            let exposure_s = number(4) * number(1) * 1e-6;
            let mut clock = FrameClock::new(timing, number(3) as u32, None).unwrap();
            let frames = number(7) as usize;
            let windows = (0..=frames).map(|_| clock.next(exposure_s).unwrap()).last().unwrap();
            let [open, close] = windows.row(number(8) as u32).map(|s| s - exposure_s);
            assert!((open - 1e-6 * number(9)).abs() < 1e-9, "{line}");
            assert!((close - 1e-6 * number(10)).abs() < 1e-9, "{line}");
            assert!((timing.period_s(exposure_s) * number(11) - 1.0).abs() < 1e-9, "{line}");
            lines += 1;
        }
        assert_eq!(lines, 48);
    }

    /// How a thing that moves leans from row to row, and is stretched where it moves along the
    /// columns: golden/light/skew.csv.
    #[test]
    fn what_moves_leans_and_is_stretched_by_the_times_of_the_rows() {
        const ROWS: u32 = 480;
        let Some(file) = camrig_testing::shared("golden/light/skew.csv") else { return };
        let near = |a: f64, b: f64| (a - b).abs() < 1e-6 * b.abs();
        let mut lines = 0;
        for line in std::fs::read_to_string(file).unwrap().lines().skip(1) {
            let fields: Vec<&str> = line.split(',').collect();
            let number = |i: usize| fields[i].parse::<f64>().unwrap();
            let mut clock = clock(number(1), ROWS, ROWS);
            clock.timing.upwards = fields[2] == "up";
            let windows = clock.next(0.005).unwrap();
            let middle = |row: u32| windows.row(row).iter().sum::<f64>() / 2.0;
            // Pixels that it moves while row 0 and the last row have their turns.
            let moved = number(0) * (middle(ROWS - 1) - middle(0));
            let rows = f64::from(ROWS - 1);
            if fields[2] == "vertical" {
                assert!(near(rows / (rows - moved), number(3)), "{line}");
            } else {
                let lean = moved / rows;
                assert!(near(lean, number(3)), "{lean}: {line}");
                assert!(near(lean.atan().to_degrees(), number(4)), "{line}");
                assert!(near(lean * f64::from(ROWS), number(5)), "{line}");
            }
            lines += 1;
        }
        assert_eq!(lines, 8);
    }

    #[test]
    fn an_exposure_moves_openings_and_lengthens_frames_that_are_too_short_for_it() {
        let mut clock = clock(10.0, 100, 90);
        let [open, close] = clock.next(0.0005).unwrap().span();
        assert!(open == 0.0 && (close - (0.0005 + 89.0 * 1e-5)).abs() < 1e-12, "{open} {close}");
        let longer = clock.next(0.0009).unwrap().row(0);
        assert!((longer[1] - 0.0015).abs() < 1e-12 && (longer[0] - 0.0006).abs() < 1e-12);
        // 150 lines of exposure take a frame of 150 lines.
        clock.next(0.0015).unwrap();
        assert!((clock.next(0.0005).unwrap().row(0)[1] - (0.0015 + 0.001 + 0.0015)).abs() < 1e-12);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let timing = clock(10.0, 100, 100).timing;
        let said = |e: Result<FrameClock>| e.err().unwrap().to_string();
        assert!(said(FrameClock::new(timing, 101, None)).contains("100 lines for a frame of 101"));
        assert!(said(FrameClock::new(timing, 100, Some(0.0009))).contains("frames/s"));
        let mut fast = FrameClock::new(timing, 100, Some(0.001)).unwrap();
        assert!(fast.next(0.001).is_ok());
        assert!(fast.next(0.0011).unwrap_err().to_string().contains("exposure"));
        // Also of a sensor whose timing is not known, and as it was stated: 0.2 s in 32 bits is
        // 0.20000000298 s.
        let period = FramePeriod::new(None, 100, Some(0.05)).unwrap();
        assert_eq!(period.of(0.05).unwrap(), Some(0.05));
        let error = period.of(f64::from(0.2f32)).unwrap_err().to_string();
        assert!(error.contains("200 ms is longer than a frame at 20 frames/s, 50 ms"), "{error}");
        assert_eq!(FramePeriod::new(None, 100, None).unwrap().of(9.0).unwrap(), None);
    }
}
