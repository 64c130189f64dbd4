//! Natural order of names: runs of digits count as numbers, so `a2` comes before `a10`.

/// What a name is sorted by, as the key of `sort_by_cached_key`: its text and its runs of digits,
/// of up to 38 each, as numbers.
#[must_use]
pub fn natural_order(name: &str) -> Vec<(String, u128)> {
    let mut parts = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let text = rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len());
        let (text, after) = rest.split_at(text);
        let digits = after.find(|c: char| !c.is_ascii_digit()).unwrap_or(after.len());
        let (digits, after) = after.split_at(digits);
        let number = if digits.is_empty() { Ok(0) } else { digits.parse() };
        parts.push((text.to_string(), number.unwrap_or(u128::MAX)));
        rest = after;
    }
    parts.push((name.to_string(), 0));
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_sorted_by_the_numbers_in_them() {
        let mut names = ["b1", "a10.irr", "a2.irr", "a1.irr", "a02.irr", "a"];
        names.sort_by_cached_key(|name| natural_order(name));
        assert_eq!(names, ["a", "a1.irr", "a02.irr", "a2.irr", "a10.irr", "b1"]);
    }
}
