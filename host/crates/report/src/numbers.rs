//! Numbers as pages write them: as many digits as their error allows, thin spaces between
//! thousands, a real minus sign, powers of ten only outside 0.001 to 99 999.
//!
//! ```
//! use camrig_report::numbers::{amount, number};
//! assert_eq!(amount(5.7031, Some(0.27), "e⁻"), "5.70\u{2009}±\u{2009}0.27\u{a0}e⁻");
//! assert_eq!(number(-28_075.2), "−28\u{202f}075");
//! ```

use camrig_base::numbers::plural;

/// Placeholder for a figure that the captures do not determine.
pub const NOT_DETERMINED: &str = "not determined";
/// Significant digits of a value without an error.
const DIGITS: usize = 3;
/// Size below which, and from which on, a number has a power of ten.
const PLAIN: std::ops::Range<f64> = 1e-3..99_999.5;

/// A value with three significant digits; whole numbers keep all of theirs.
pub fn number(value: f64) -> String {
    digits(value, DIGITS)
}

/// A value with some significant digits; whole numbers keep all of theirs.
pub fn digits(value: f64, digits: usize) -> String {
    if value == 0.0 {
        return "0".into();
    }
    if !value.is_finite() {
        return NOT_DETERMINED.into();
    }
    let (mantissa, exponent) = rounded(value, digits.max(1));
    if PLAIN.contains(&value.abs()) {
        let decimals = (digits.max(1) as i32 - 1 - exponent).max(0);
        return fixed(value, decimals as usize);
    }
    format!("{} · {}", sign(&mantissa), power_of_ten(exponent))
}

/// A setting: at most four digits, without trailing zeros.
pub fn setting(value: f64) -> String {
    let text = digits(value, 4);
    match text.contains('.') && !text.contains('·') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

/// A time that was set, in s, ms or µs.
pub fn seconds(value: f64) -> String {
    let (value, unit) = match value.abs() {
        v if v == 0.0 || v >= 1.0 => (value, "s"),
        v if v >= 1e-3 => (1e3 * value, "ms"),
        _ => (1e6 * value, "µs"),
    };
    format!("{}\u{a0}{unit}", setting(value))
}

/// A value with some digits behind the point.
pub fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    // Nothing but zeros has no sign.
    let zero = text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.');
    grouped(if zero { text.trim_start_matches('-') } else { &text })
}

/// A count, in full.
pub fn count(value: u64) -> String {
    grouped(&value.to_string())
}

/// A count, in full, with its noun: `1 frame`, `12\u{202f}000 frames`.
pub fn counted(value: usize, noun: &str) -> String {
    format!("{} {}", count(value as u64), plural(value, noun))
}

/// A standard error below this part of its value is one of rounding, which is none.
const ROUNDING: f64 = 1e-12;

/// A value and its standard error: two digits of the error, the value to the same place. Without
/// an error, or with one of 0 but for rounding, like [`number`].
pub fn with_error(value: f64, std_error: Option<f64>) -> String {
    let least = ROUNDING * value.abs();
    let Some(se) = std_error.filter(|se| *se > least && se.is_finite()) else {
        return number(value);
    };
    if !value.is_finite() {
        return NOT_DETERMINED.into();
    }
    let (_, error_power) = rounded(se, 2);
    let last = error_power - 1;
    let size = value.abs().max(se);
    if PLAIN.contains(&size) {
        let decimals = (-last).max(0) as usize;
        return format!("{}\u{2009}±\u{2009}{}", fixed(value, decimals), fixed(se, decimals));
    }
    let (_, power) = rounded(size, DIGITS);
    let decimals = (power - last).max(0) as usize;
    let part = |v: f64| fixed(v / libm::pow(10.0, f64::from(power)), decimals);
    format!("({}\u{2009}±\u{2009}{}) · {}", part(value), part(se), power_of_ten(power))
}

/// [`with_error`] and a unit, which stay in one line; a unit of `1` or none is left out.
pub fn amount(value: f64, std_error: Option<f64>, unit: &str) -> String {
    let text = with_error(value, std_error);
    match (unit, &text[..]) {
        ("" | "1", _) | (_, NOT_DETERMINED) => text,
        _ => format!("{text}\u{a0}{}", spoken_unit(unit)),
    }
}

/// A lower limit: `≥` and the value.
pub fn at_least(value: f64) -> String {
    format!("≥\u{2009}{}", number(value))
}

/// A factor: `×` and the value.
pub fn factor(value: f64) -> String {
    format!("×\u{2009}{}", number(value))
}

/// A unit of a camera file or catalogue in the signs of print: `e-/s` becomes `e⁻/s`.
pub fn spoken_unit(unit: &str) -> String {
    unit.replace("e-", "e⁻").replace("um", "µm").replace("^2", "²")
}

/// 10 to a power, with raised digits.
pub fn power_of_ten(exponent: i32) -> String {
    let raised = |c: char| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        // The others follow each other in Unicode.
        c => char::from_u32(0x2070 + u32::from(c) - u32::from('0')).unwrap_or(c),
    };
    format!("10{}", exponent.to_string().chars().map(raised).collect::<String>())
}

/// Mantissa of some digits and the power of ten that goes with it after rounding.
fn rounded(value: f64, digits: usize) -> (String, i32) {
    let text = format!("{value:.*e}", digits - 1);
    match text.split_once('e') {
        Some((mantissa, exponent)) => (mantissa.into(), exponent.parse().unwrap_or(0)),
        None => (text, 0),
    }
}

fn sign(text: &str) -> String {
    text.replacen('-', "−", 1)
}

/// Thin spaces between thousands from five digits on, and a real minus sign.
fn grouped(text: &str) -> String {
    let (whole, rest) = text.split_at(text.find('.').unwrap_or(text.len()));
    let (minus, whole) = match whole.strip_prefix('-') {
        Some(whole) => ("−", whole),
        None => ("", whole),
    };
    let apart = whole.len() > 4;
    let mut out = minus.to_owned();
    for (i, digit) in whole.chars().enumerate() {
        if apart && i > 0 && (whole.len() - i).is_multiple_of(3) {
            out.push('\u{202f}');
        }
        out.push(digit);
    }
    out + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_have_two_digits_of_their_error() {
        for (value, error, text) in [
            (5.7031, 0.27, "5.70 ± 0.27"),
            (58.523, 0.0981, "58.523 ± 0.098"),
            // The error rounds up to the next power: still two digits of it.
            (3.0, 0.0999, "3.00 ± 0.10"),
            (28_075.0, 141.0, "28_075 ± 141"),
            (-3.0, 0.2, "−3.00 ± 0.20"),
            (0.0, 0.2, "0.00 ± 0.20"),
            (-0.001, 0.2, "0.00 ± 0.20"),
            (2.5e-5, 3.1e-6, "(2.50 ± 0.31) · 10⁻⁵"),
            (3.123e7, 2.0e5, "(3.123 ± 0.020) · 10⁷"),
        ] {
            let text = text.replace(" ± ", "\u{2009}±\u{2009}").replace('_', "\u{202f}");
            assert_eq!(with_error(value, Some(error)), text);
        }
        assert_eq!(with_error(2.0, Some(0.0)), "2.00");
        assert_eq!(amount(f64::NAN, Some(1.0), "DN"), NOT_DETERMINED);
        assert_eq!(amount(2.0, None, "e-/s"), "2.00\u{a0}e⁻/s");
    }

    #[test]
    fn other_values_have_three_digits_and_powers_of_ten_only_at_the_ends() {
        for (value, text) in [
            (0.0, "0"),
            (9.996, "10.0"),
            (0.001, "0.00100"),
            (0.000_999, "9.99 · 10⁻⁴"),
            (1234.4, "1234"),
            (99_999.0, "99\u{202f}999"),
            (100_000.0, "1.00 · 10⁵"),
            (3.14e7, "3.14 · 10⁷"),
            (-4.5e-10, "−4.50 · 10⁻¹⁰"),
        ] {
            assert_eq!(number(value), text);
        }
        assert_eq!([10.0, 0.05, 1234.0, 2.125].map(setting), ["10", "0.05", "1234", "2.125"]);
        assert_eq!(
            [0.0, 2.0, 0.01, 3.2e-5].map(seconds).join("|"),
            "0 s|2 s|10 ms|32 µs".replace(' ', "\u{a0}")
        );
        assert_eq!(count(1_234_567), "1\u{202f}234\u{202f}567");
        assert_eq!(at_least(54_515.0), "≥\u{2009}54\u{202f}515");
    }
}
