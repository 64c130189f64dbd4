//! Colours of series, and scales of colours for maps.
//!
//! A series has a *role*, of which page and file know the colour: on a page it is a CSS variable,
//! so that one drawing serves light and dark pages and print. The light and dark values have a
//! contrast of 3 and more against the paper of the page (WCAG 2.1, 1.4.11); `tests/browser.rs`
//! looks at them.

use crate::numbers::number;
use camrig_base::Plane;
use std::fmt::Write;

/// What a series is, which decides its colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Colour {
    /// Red channel.
    Red,
    /// Green channel, or the green samples in rows with red ones.
    Green,
    /// The green samples in rows with blue ones.
    GreenInBlue,
    /// Blue channel.
    Blue,
    /// What was measured.
    Measured,
    /// The model as given.
    Given,
    /// The improved model.
    Improved,
    /// References and limits.
    Reference,
    /// One of several series without a role; counted from 0, six of them.
    Series(usize),
}

/// The form of a dot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Dot {
    Round,
    Square,
    Diamond,
    Triangle,
}

/// Class, light and dark colour of each role.
const ROLES: [(&str, &str, &str); 14] = [
    ("r", "#c44a00", "#ff8c55"),
    ("gr", "#007e5c", "#35c495"),
    ("gb", "#0094a0", "#4cd0dc"),
    ("bl", "#0062b1", "#63adff"),
    ("meas", "#15191e", "#e7eaee"),
    ("before", "#c44a00", "#ff8c55"),
    ("after", "#0062b1", "#63adff"),
    ("refc", "#5d6772", "#98a3ae"),
    ("s1", "#0062b1", "#63adff"),
    ("s2", "#c44a00", "#ff8c55"),
    ("s3", "#007e5c", "#35c495"),
    ("s4", "#a0458b", "#e08fcb"),
    ("s5", "#8a6d00", "#d8b83a"),
    ("s6", "#5b6b7a", "#9fb0c0"),
];
/// Place of the first of [`Colour::Series`] in [`ROLES`].
const FIRST_SERIES: usize = 8;

impl Colour {
    /// That of a sensor's channel by its name: `r`, `g`, `gr`, `gb`, `b`, in any case; others are
    /// as measured.
    pub fn of_channel(name: &str) -> Self {
        match &name.to_ascii_lowercase()[..] {
            "r" | "red" => Self::Red,
            "g" | "gr" | "green" => Self::Green,
            "gb" => Self::GreenInBlue,
            "b" | "blue" => Self::Blue,
            _ => Self::Measured,
        }
    }

    /// Near the colour of light of a wavelength, nm, as far as roles reach.
    pub fn of_wavelength(nm: f64) -> Self {
        match nm {
            nm if nm < 430.0 => Self::Series(3),
            nm if nm < 490.0 => Self::Blue,
            nm if nm < 570.0 => Self::Green,
            nm if nm < 610.0 => Self::Series(4),
            _ => Self::Red,
        }
    }

    /// The form of its dots: the two greens, and series without a role, are distinct without
    /// colours too.
    pub(crate) fn dot(self) -> Dot {
        match self {
            Self::GreenInBlue => Dot::Square,
            Self::Series(i) => [Dot::Round, Dot::Square, Dot::Diamond, Dot::Triangle][i % 4],
            _ => Dot::Round,
        }
    }

    fn role(self) -> usize {
        match self {
            Self::Red => 0,
            Self::Green => 1,
            Self::GreenInBlue => 2,
            Self::Blue => 3,
            Self::Measured => 4,
            Self::Given => 5,
            Self::Improved => 6,
            Self::Reference => 7,
            Self::Series(i) => FIRST_SERIES + i % (ROLES.len() - FIRST_SERIES),
        }
    }

    /// The class of elements in this colour.
    pub(crate) fn class(self) -> &'static str {
        ROLES[self.role()].0
    }
}

/// CSS of the roles: variables with a light and a dark value.
pub(crate) fn page_style() -> String {
    let mut out = String::from(":root{");
    for (class, light, dark) in ROLES {
        let _ = write!(out, "--{class}:light-dark({light},{dark});");
    }
    out.push('}');
    for (class, ..) in ROLES {
        let _ = write!(out, ".{class}{{--c:var(--{class})}}");
    }
    out
}

/// CSS of the roles for a separate file, without variables, which many programs do not support.
pub(crate) fn file_style() -> String {
    let mut out = String::new();
    for (c, light, _) in ROLES {
        let _ = write!(out, ".l.{c},.e.{c}{{stroke:{light}}}.f.{c},.b.{c}{{fill:{light}}}");
    }
    out
}

/// A sequence of colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Palette {
    /// Violet over green to yellow: amounts.
    Viridis,
    /// Black over red to near white: pictures of light and charge.
    Inferno,
    /// Blue over white to red: differences, nothing in the middle.
    Diverging,
}

/// Colours at even steps: matplotlib's viridis and inferno (CC0), and ColorBrewer's RdBu reversed,
/// darkened at its ends.
const VIRIDIS: [[f64; 3]; 10] = [
    [68.0, 1.0, 84.0],
    [72.0, 40.0, 120.0],
    [62.0, 74.0, 137.0],
    [49.0, 104.0, 142.0],
    [38.0, 130.0, 142.0],
    [31.0, 158.0, 137.0],
    [53.0, 183.0, 121.0],
    [110.0, 206.0, 88.0],
    [181.0, 222.0, 43.0],
    [253.0, 231.0, 37.0],
];
const INFERNO: [[f64; 3]; 9] = [
    [0.0, 0.0, 4.0],
    [31.0, 12.0, 72.0],
    [85.0, 15.0, 109.0],
    [136.0, 34.0, 106.0],
    [186.0, 54.0, 85.0],
    [227.0, 89.0, 51.0],
    [249.0, 140.0, 10.0],
    [249.0, 201.0, 50.0],
    [252.0, 255.0, 164.0],
];
const DIVERGING: [[f64; 3]; 7] = [
    [5.0, 60.0, 130.0],
    [60.0, 130.0, 190.0],
    [160.0, 200.0, 225.0],
    [246.0, 246.0, 246.0],
    [245.0, 190.0, 150.0],
    [210.0, 105.0, 60.0],
    [135.0, 30.0, 15.0],
];
/// Colour of a place without a value.
const NONE: [u8; 3] = [128, 128, 128];

impl Palette {
    /// The colour for t from 0 to 1; grey for what is not a number.
    pub fn colour(self, t: f64) -> [u8; 3] {
        let stops: &[[f64; 3]] = match self {
            Self::Viridis => &VIRIDIS,
            Self::Inferno => &INFERNO,
            Self::Diverging => &DIVERGING,
        };
        if t.is_nan() {
            return NONE;
        }
        let place = t.clamp(0.0, 1.0) * (stops.len() - 1) as f64;
        let i = (place as usize).min(stops.len() - 2);
        let f = place - i as f64;
        [0, 1, 2].map(|k| (stops[i][k] + f * (stops[i + 1][k] - stops[i][k])).round() as u8)
    }
}

/// How values become colours, with the unit of the values.
#[derive(Clone, Debug, PartialEq)]
pub struct Scale {
    palette: Palette,
    low: f64,
    high: f64,
    course: Course,
    reversed: bool,
    unit: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Course {
    Linear,
    Root,
    Logarithmic,
}

impl Scale {
    fn new(palette: Palette, [low, high]: [f64; 2], unit: &str) -> Self {
        let high = if high > low { high } else { low + 1.0 };
        Self { palette, low, high, course: Course::Linear, reversed: false, unit: unit.into() }
    }

    /// Amounts from one value to another, in viridis.
    pub fn amounts(range: [f64; 2], unit: &str) -> Self {
        Self::new(Palette::Viridis, range, unit)
    }

    /// Light or charge from one value to another, in inferno.
    pub fn light(range: [f64; 2], unit: &str) -> Self {
        Self::new(Palette::Inferno, range, unit)
    }

    /// Differences to `most` on both sides of 0, in blue, white and red.
    pub fn differences(most: f64, unit: &str) -> Self {
        let most = if most > 0.0 { most } else { 1.0 };
        Self::new(Palette::Diverging, [-most, most], unit)
    }

    /// Shows the square root, which makes faint parts visible.
    pub fn root(mut self) -> Self {
        self.course = Course::Root;
        self
    }

    /// Shows the logarithm, if all of the range is positive.
    pub fn logarithmic(mut self) -> Self {
        if self.low > 0.0 {
            self.course = Course::Logarithmic;
        }
        self
    }

    /// Swaps the ends of the colours, so that small values are the bright ones.
    pub fn reversed(mut self) -> Self {
        self.reversed = true;
        self
    }

    /// The colour of a value; those outside the range have that of its end.
    pub fn colour(&self, value: f64) -> [u8; 3] {
        let linear = (value - self.low) / (self.high - self.low);
        let t = match self.course {
            Course::Linear => linear,
            Course::Root => linear.max(0.0).sqrt(),
            Course::Logarithmic => {
                libm::log(value.max(self.low) / self.low) / libm::log(self.high / self.low)
            }
        };
        // `max` above takes what is not a number for the other number.
        let t = if value.is_nan() { f64::NAN } else { t };
        self.palette.colour(if self.reversed { 1.0 - t } else { t })
    }

    /// The colours of a plane of values.
    pub fn picture(&self, plane: &Plane<f64>) -> Plane<[u8; 3]> {
        let data = plane.data.iter().map(|&v| self.colour(v)).collect();
        Plane { width: plane.width, height: plane.height, data }
    }

    /// The colours from end to end, in some steps.
    pub(crate) fn bar(&self, steps: usize) -> Plane<[u8; 3]> {
        let last = (steps - 1) as f64;
        let at = |i: usize| match (self.course, i as f64 / last) {
            (Course::Logarithmic, t) => self.low * libm::pow(self.high / self.low, t),
            (_, t) => self.low + t * (self.high - self.low),
        };
        Plane::from_fn(steps, 1, |i, _| self.colour(at(i)))
    }

    /// Labels at the ends of the bar.
    pub(crate) fn ends(&self) -> [String; 2] {
        let unit = match &self.unit[..] {
            "" => String::new(),
            unit => format!("\u{a0}{unit}"),
        };
        [number(self.low), format!("{}{unit}", number(self.high))]
    }
}

/// Whether black text contrasts better with a colour than white text, from the relative luminance
/// where both have a contrast of 4.58 (WCAG 2.1).
pub(crate) fn is_light([r, g, b]: [u8; 3]) -> bool {
    let linear = |v: u8| match f64::from(v) / 255.0 {
        v if v <= 0.04045 => v / 12.92,
        v => libm::pow((v + 0.055) / 1.055, 2.4),
    };
    0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b) > 0.179
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_show_ends_and_middle_and_mark_what_is_not_a_number() {
        let difference = Scale::differences(9.0, "e⁻");
        assert_eq!(difference.colour(0.0), [246, 246, 246]);
        assert_eq!(difference.colour(-9.0), [5, 60, 130]);
        assert_eq!(difference.colour(f64::NAN), NONE);
        let log = Scale::amounts([1.0, 100.0], "lx").logarithmic();
        assert_eq!(log.colour(10.0), Palette::Viridis.colour(0.5));
        assert_eq!(log.clone().reversed().colour(1.0), [253, 231, 37]);
        assert_eq!(log.colour(f64::NAN), NONE);
        assert_eq!(log.ends()[1], "100\u{a0}lx");
        assert_eq!(Scale::light([0.0, 4.0], "").root().colour(1.0), Palette::Inferno.colour(0.5));
    }

    #[test]
    fn channels_have_their_colours_whatever_the_case() {
        assert_eq!(Colour::of_channel("Gb"), Colour::GreenInBlue);
        assert_eq!(Colour::of_channel("r").class(), "r");
        assert_eq!(Colour::of_channel("mono"), Colour::Measured);
        assert_eq!(Colour::Series(7).class(), "s2");
    }
}
