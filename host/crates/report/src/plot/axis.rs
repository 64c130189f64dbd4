//! Axes: their range, and ticks at steps of 1, 2 or 5.

use crate::numbers::{fixed, power_of_ten};
use std::ops::RangeInclusive;

/// Decades below which 2 and 5 are labelled on a logarithmic axis too.
const FEW_DECADES: f64 = 2.0;
/// Most ticks that an axis has; more come of no range that is drawn.
const MAX_TICKS: f64 = 1000.0;
/// Powers of ten that are written out on axes.
const WRITTEN_OUT: RangeInclusive<i32> = -3..=4;

/// A place on an axis that has a mark, with its text if it is labelled.
pub type Tick = (f64, Option<String>);

/// A direction of a plot as it was asked for.
#[derive(Clone, Debug, Default)]
pub struct Axis {
    /// Name and unit.
    pub label: String,
    /// Whether decades are of one length.
    pub logarithmic: bool,
    /// From the left or bottom to the right or top; otherwise it follows the data.
    pub range: Option<[f64; 2]>,
    /// Places with names instead of numbers.
    pub names: Vec<(f64, String)>,
}

/// An axis with its range: from the left or bottom to the right or top.
#[derive(Clone, Debug)]
pub struct Span<'a> {
    pub axis: &'a Axis,
    pub low: f64,
    pub high: f64,
}

impl Axis {
    /// Whether a value has a place on the axis at all.
    pub fn takes(&self, value: f64) -> bool {
        value.is_finite() && (!self.logarithmic || value > 0.0)
    }

    /// The axis over data: to the next tick beyond them. `room` is how many labels it has room
    /// for.
    pub fn over(&self, data: impl Iterator<Item = f64>, room: usize) -> Span<'_> {
        if let Some([low, high]) = self.range.filter(|[a, b]| a != b) {
            return Span { axis: self, low, high };
        }
        let usable = data.filter(|v| self.takes(*v));
        let [low, high] =
            usable.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
        let [low, high] = match (low <= high, self.logarithmic) {
            (false, true) => [1.0, 10.0],
            (false, false) => [0.0, 1.0],
            (true, true) => [round_below(low), round_above(high)],
            (true, false) => whole_steps(low, high, room),
        };
        Span { axis: self, low, high }
    }
}

/// The largest 1, 2 or 5 times a power of ten that is not above a value.
fn round_below(value: f64) -> f64 {
    let decade = libm::pow(10.0, libm::log10(value).floor());
    [10.0, 5.0, 2.0].map(|m| m * decade).into_iter().find(|v| *v <= value).unwrap_or(decade)
}

/// The smallest 1, 2 or 5 times a power of ten that is not below a value.
fn round_above(value: f64) -> f64 {
    let decade = libm::pow(10.0, libm::log10(value).floor());
    [1.0, 2.0, 5.0].map(|m| m * decade).into_iter().find(|v| *v >= value).unwrap_or(10.0 * decade)
}

/// A range widened to whole steps; it reaches 0 where data come near it.
fn whole_steps(low: f64, high: f64, room: usize) -> [f64; 2] {
    let [mut low, mut high] = [low, high];
    if low == high {
        let side = if low == 0.0 { 1.0 } else { 0.1 * low.abs() };
        [low, high] = [low - side, high + side];
    }
    if low > 0.0 && low < 0.3 * high {
        low = 0.0;
    }
    if high < 0.0 && high > 0.3 * low {
        high = 0.0;
    }
    let step = step_of(high - low, room);
    [(low / step + 1e-9).floor() * step, (high / step - 1e-9).ceil() * step]
}

/// The smallest step of 1, 2 or 5 with at most `room` steps in a spread.
fn step_of(spread: f64, room: usize) -> f64 {
    let room = room.max(1) as f64;
    let decade = libm::pow(10.0, libm::log10(spread / room).floor());
    let steps = [1.0, 2.0, 5.0].map(|m| m * decade);
    steps.into_iter().find(|s| spread / s <= room * (1.0 + 1e-9)).unwrap_or(10.0 * decade)
}

impl Span<'_> {
    /// Position of a value, 0 to 1 from end to end and beyond; `None` where it has none.
    pub fn at(&self, value: f64) -> Option<f64> {
        if !self.axis.takes(value) {
            return None;
        }
        let [v, low, high] = match self.axis.logarithmic {
            true => [value, self.low, self.high].map(libm::log10),
            false => [value, self.low, self.high],
        };
        Some((v - low) / (high - low))
    }

    /// Marks and labels; `room` is how many labels there is room for.
    pub fn ticks(&self, room: usize) -> Vec<Tick> {
        let [low, high] = [self.low.min(self.high), self.low.max(self.high)];
        if !self.axis.names.is_empty() {
            let named = self.axis.names.iter().filter(|(at, _)| (low..=high).contains(at));
            return named.map(|(at, name)| (*at, Some(name.clone()))).collect();
        }
        if !self.axis.logarithmic {
            return steps(low, high, room);
        }
        let ticks = decades(low, high, room);
        // Of less than a decade, two labels or more need smaller steps.
        match ticks.iter().filter(|t| t.1.is_some()).count() < 2 {
            true => steps(low, high, room),
            false => ticks,
        }
    }
}

fn steps(low: f64, high: f64, room: usize) -> Vec<Tick> {
    let step = step_of(high - low, room);
    let first = (low / step - 1e-6).ceil();
    let last = (high / step + 1e-6).floor().min(first + MAX_TICKS);
    let power = libm::log10(step).floor() as i32;
    let most = first.abs().max(last.abs()) * step;
    let scale = libm::log10(most).floor() as i32;
    let text = |k: f64| match k {
        0.0 => "0".to_owned(),
        k if most < 99_999.5 && power >= -4 => fixed(k * step, (-power).max(0) as usize),
        k => {
            let decimals = (scale - power).max(0) as usize;
            format!(
                "{}·{}",
                fixed(k * step / libm::pow(10.0, f64::from(scale)), decimals),
                power_of_ten(scale)
            )
        }
    };
    // Counted by whole numbers: a sum of steps would miss the last tick.
    (0..=(last - first).max(0.0) as u32)
        .map(|i| first + f64::from(i))
        .map(|k| (k * step, Some(text(k))))
        .collect()
}

fn decades(low: f64, high: f64, room: usize) -> Vec<Tick> {
    let [a, b] = [low, high].map(libm::log10);
    let every = ((b - a) / room.max(1) as f64).ceil().max(1.0) as i32;
    let mut out = Vec::new();
    for decade in a.floor() as i32..=b.ceil() as i32 {
        for m in 1..10 {
            let value = f64::from(m) * libm::pow(10.0, f64::from(decade));
            if !(low * (1.0 - 1e-9)..=high * (1.0 + 1e-9)).contains(&value) {
                continue;
            }
            let whole = m == 1 && decade.rem_euclid(every) == 0;
            let between = b - a < FEW_DECADES && (m == 2 || m == 5);
            out.push((value, (whole || between).then(|| log_text(value, m, decade))));
        }
    }
    out
}

fn log_text(value: f64, m: i32, decade: i32) -> String {
    if WRITTEN_OUT.contains(&decade) {
        return fixed(value, (-decade).max(0) as usize);
    }
    match m {
        1 => power_of_ten(decade),
        m => format!("{m}·{}", power_of_ten(decade)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(low: f64, high: f64, logarithmic: bool) -> String {
        let axis = Axis { logarithmic, range: Some([low, high]), ..Axis::default() };
        let ticks = axis.over(std::iter::empty(), 6).ticks(6);
        ticks.into_iter().filter_map(|t| t.1).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn ticks_are_steps_of_1_2_or_5() {
        assert_eq!(texts(0.0, 1.0, false), "0 0.2 0.4 0.6 0.8 1.0");
        assert_eq!(texts(-0.013, 0.004, false), "−0.010 −0.005 0");
        assert_eq!(
            texts(0.0, 60_000.0, false),
            "0 10\u{202f}000 20\u{202f}000 30\u{202f}000 \
                    40\u{202f}000 50\u{202f}000 60\u{202f}000"
        );
        assert_eq!(texts(0.0, 5e6, false), "0 1·10⁶ 2·10⁶ 3·10⁶ 4·10⁶ 5·10⁶");
        assert_eq!(texts(240.0, 0.0, false), "0 50 100 150 200");
    }

    #[test]
    fn logarithmic_axes_have_decades_and_2_and_5_where_they_are_few() {
        assert_eq!(texts(1.0, 1e5, true), "1 10 100 1000 10\u{202f}000 10⁵");
        assert_eq!(texts(1.0, 50.0, true), "1 2 5 10 20 50");
        assert_eq!(texts(1e-6, 1e6, true), "10⁻⁶ 10⁻⁴ 0.01 1 100 10\u{202f}000 10⁶");
        // Within a decade and between its 2 and 5: smaller steps.
        assert_eq!(texts(2.1, 4.2, true), "2.5 3.0 3.5 4.0");
        let axis = Axis { logarithmic: true, ..Axis::default() };
        let span = axis.over([1.0, 100.0].into_iter(), 6);
        let minor = span.ticks(6).into_iter().filter(|t| t.1.is_none()).count();
        assert!(minor >= 14, "{minor} minor ticks");
    }

    #[test]
    fn ranges_follow_the_data_to_the_next_tick() {
        let axis = Axis::default();
        let over = |data: &[f64]| {
            let span = axis.over(data.iter().copied(), 5);
            [span.low, span.high]
        };
        assert_eq!(over(&[3.0, 97.0]), [0.0, 100.0]);
        assert_eq!(over(&[52.0, 97.0]), [50.0, 100.0]);
        let [low, high] = over(&[7.0]);
        assert!(low < 7.0 && high > 7.0);
        assert_eq!(over(&[f64::NAN, f64::INFINITY]), [0.0, 1.0]);
        assert_eq!(over(&[]), [0.0, 1.0]);
    }

    #[test]
    fn what_has_no_place_is_told() {
        let axis = Axis { logarithmic: true, ..Axis::default() };
        let span = axis.over([1.0, 100.0].into_iter(), 5);
        assert_eq!(span.at(0.0), None);
        assert_eq!(span.at(f64::NAN), None);
        assert!(span.at(0.1).unwrap() < 0.0);
    }
}
