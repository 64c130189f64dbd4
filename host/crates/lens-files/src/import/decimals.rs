//! Numbers with a decimal comma, as programs write them where the computer's language has one.

use std::borrow::Cow;

/// Separators between numbers that may contain a comma.
const SEPARATORS: [char; 3] = [' ', '\t', ';'];

/// The text with decimal points: unchanged, unless its rows of numbers have decimal commas.
pub(super) fn with_points(text: &str) -> Cow<'_, str> {
    if !has_decimal_commas(text) {
        return text.into();
    }
    let letters: Vec<char> = text.chars().collect();
    let digit =
        |i: Option<usize>| i.and_then(|i| letters.get(i)).is_some_and(char::is_ascii_digit);
    let points = letters.iter().enumerate().map(|(i, &letter)| match letter {
        ',' if digit(i.checked_sub(1)) && digit(i.checked_add(1)) => '.',
        other => other,
    });
    points.collect::<String>().into()
}

/// Whether rows of two numbers and more have commas between digits, at most one in each number,
/// and no points. Commas that separate numbers are alone between them, or at their ends.
fn has_decimal_commas(text: &str) -> bool {
    let (mut commas, mut others) = (false, false);
    for line in text.lines() {
        let words: Vec<&str> = line.split(SEPARATORS).filter(|w| !w.is_empty()).collect();
        let is_number = |word: &&str| {
            let numeric = |c: char| c.is_ascii_digit() || "+-.,eE%".contains(c);
            word.chars().all(numeric) && word.contains(|c: char| c.is_ascii_digit())
        };
        if words.len() < 2 || !words.iter().all(is_number) {
            continue;
        }
        for word in words {
            match word.matches(',').count() {
                1 if !word.starts_with(',') && !word.ends_with(',') => commas = true,
                0 => {}
                _ => others = true,
            }
            others |= word.contains('.');
        }
    }
    commas && !others
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commas_are_decimals_only_in_rows_that_something_else_separates() {
        let points = |text: &str| with_points(text).into_owned();
        assert_eq!(
            points("Date: 05.03.2026\n0,5 1,25\n0 2,5E-3\n").lines().nth(2),
            Some("0 2.5E-3")
        );
        assert_eq!(points("height;550\n0;1\n1,2;0,98\n"), "height;550\n0;1\n1.2;0.98\n");
        for kept in ["0,1\n1,2\n", "0,1,2\n3,4,5\n", "0, 1\n1, 2\n", "0.5 1,2\n", "1,2,3 4,5,6\n"]
        {
            assert_eq!(points(kept), kept);
        }
        assert!(matches!(with_points("1 2\n"), Cow::Borrowed(_)));
    }
}
