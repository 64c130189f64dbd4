//! Numbers as people write them: as many digits as their error allows, powers of ten only where a
//! decimal would be long.

/// Significant digits of a value without an error.
const DIGITS: i32 = 4;

/// A value with two digits of its error; powers of ten below 0.001 and from 10000 on.
pub fn with_error(value: f64, std_error: Option<f64>) -> String {
    let power = |v: f64| libm::log10(v.abs()).floor() as i32;
    let std_error = std_error.filter(|se| *se > 0.0 && se.is_finite());
    let size = if value == 0.0 { std_error.unwrap_or(1.0) } else { value };
    let last = std_error.map_or(power(size) - DIGITS + 1, |se| power(se) - 1);
    let scale = if (1e-3..1e4).contains(&size.abs()) { 0 } else { power(size) };
    let digits = usize::try_from(scale - last).unwrap_or(0);
    let shown = |v: f64| format!("{:.digits$}", v / libm::pow(10.0, f64::from(scale)));
    let both = match std_error {
        Some(se) => format!("{} ± {}", shown(value), shown(se)),
        None => shown(value),
    };
    match (scale, std_error) {
        (0, _) => both,
        (_, Some(_)) => format!("({both})e{scale}"),
        (_, None) => format!("{both}e{scale}"),
    }
}

/// A value with four significant digits, like [`with_error`] without an error.
pub fn plain(value: f64) -> String {
    with_error(value, None)
}

/// A noun as it follows a count: `frame` after 1, `frames` after others. Only for nouns whose
/// plural is regular.
pub fn plural(count: usize, noun: &str) -> String {
    match (count, noun.ends_with('s')) {
        (1, _) => noun.to_owned(),
        (_, true) => format!("{noun}es"),
        (_, false) => format!("{noun}s"),
    }
}

/// A count with its noun: `1 frame`, `2 frames`.
pub fn counted(count: usize, noun: &str) -> String {
    format!("{count} {}", plural(count, noun))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_thing_has_no_plural() {
        assert_eq!(counted(1, "frame"), "1 frame");
        assert_eq!(counted(0, "frame"), "0 frames");
        assert_eq!(counted(12, "lens"), "12 lenses");
    }

    #[test]
    fn values_have_two_digits_of_their_error() {
        for (value, error, text) in [
            (8.8976, Some(0.13), "8.90 ± 0.13"),
            (3.0334, Some(0.037), "3.033 ± 0.037"),
            (0.01, Some(0.00042), "0.01000 ± 0.00042"),
            (9134.2, Some(250.0), "9134 ± 250"),
            (2.5e-5, Some(3.1e-6), "(2.50 ± 0.31)e-5"),
            (41_234.0, None, "4.123e4"),
            (0.8, None, "0.8000"),
            (-3.0, Some(0.2), "-3.00 ± 0.20"),
            (0.0, Some(0.2), "0.00 ± 0.20"),
        ] {
            assert_eq!(with_error(value, error), text);
        }
        assert_eq!(plain(0.00371), "0.003710");
    }
}
