//! Role and exposure from the names of files and folders.

use crate::Role;
use camrig_base::unit::Unit;
use std::path::Path;

/// Words in names and in FITS's IMAGETYP, with the role that they mean. If a name has several, the
/// first of this list applies: a `flat-dark` is a dark.
const WORDS: [(&str, Role); 16] = [
    ("dark", Role::Dark),
    ("darks", Role::Dark),
    ("darkflat", Role::Dark),
    ("bias", Role::Dark),
    ("biases", Role::Dark),
    ("zero", Role::Dark),
    ("flatdark", Role::Dark),
    ("flat", Role::Flat),
    ("flats", Role::Flat),
    ("edge", Role::Edge),
    ("edges", Role::Edge),
    ("colorchecker", Role::Chart),
    ("chart", Role::Chart),
    ("dots", Role::Dots),
    ("light", Role::Scene),
    ("scene", Role::Scene),
];
/// Words that mean zero exposure.
const BIAS: [&str; 3] = ["bias", "biases", "zero"];
/// The words of a text: runs of letters, in lower case.
fn words(text: &str) -> Vec<String> {
    let split = text.split(|c: char| !c.is_alphabetic()).filter(|word| !word.is_empty());
    split.map(str::to_lowercase).collect()
}

/// The components of a path, beginning with the file's name without its extension.
fn parts(path: &Path) -> Vec<String> {
    let stem = path.with_extension("");
    let mut parts: Vec<String> =
        stem.components().map(|c| c.as_os_str().to_string_lossy().into_owned()).collect();
    parts.reverse();
    parts
}

/// A role found in a text.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NamedRole {
    /// The role.
    pub role: Role,
    /// Whether the frames are bias frames, without exposure.
    pub bias: bool,
}

/// A value found in a part of a path.
pub struct Found<T> {
    /// The value.
    pub value: T,
    /// The part.
    pub part: String,
}

/// The role that a text names.
pub fn role_of(text: &str) -> Option<NamedRole> {
    let words = words(text);
    let (_, role) = WORDS.iter().find(|(word, _)| words.iter().any(|w| w == word))?;
    Some(NamedRole { role: *role, bias: words.iter().any(|w| BIAS.contains(&&w[..])) })
}

/// The role that a path names, in the part nearest to the file.
pub fn role(path: &Path) -> Option<Found<NamedRole>> {
    parts(path).into_iter().find_map(|part| Some(Found { value: role_of(&part)?, part }))
}

/// The exposure time that a path names (`dark-010ms`, `6300us`, `flat_1.5s`), s, in the part
/// nearest to the file that has exactly one.
pub fn exposure_s(path: &Path) -> Option<Found<f64>> {
    parts(path).into_iter().find_map(|part| match durations(&part)[..] {
        [value] => Some(Found { value, part }),
        _ => None,
    })
}

fn durations(text: &str) -> Vec<f64> {
    let number = |c: char| c.is_ascii_digit() || c == '.';
    let mut found = Vec::new();
    let mut rest = text;
    while let Some(start) = rest.find(|c: char| c.is_ascii_digit()) {
        // `f2s` is more likely a name than two seconds.
        let separate = !rest[..start].ends_with(char::is_alphabetic);
        let digits = rest[start..].find(|c| !number(c)).unwrap_or(rest.len() - start);
        let (value, after) = rest[start..].split_at(digits);
        let unit = after.find(|c: char| !c.is_alphabetic()).unwrap_or(after.len());
        let seconds = Unit::parse(&after[..unit].to_lowercase()).ok().and_then(|u| u.seconds());
        if let (Ok(value), Some(seconds)) = (value.parse::<f64>(), seconds)
            && (separate || seconds < 1.0)
        {
            found.push(value * seconds);
        }
        rest = after;
    }
    found.retain(|seconds| *seconds > 0.0);
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn role_and_exposure_are_found_in_names() {
        for (name, role_name, seconds) in [
            ("dark-010ms/0001.dng", Some(Role::Dark), Some(0.01)),
            ("dark-stack-6300us/a.tiff", Some(Role::Dark), Some(0.0063)),
            ("l2-dark-flat-360.npy", Some(Role::Dark), None),
            ("flats/Flat_1.5s_003.fits", Some(Role::Flat), Some(1.5)),
            ("flat-level00/1.tiff", Some(Role::Flat), None),
            ("bias-m10.npy", Some(Role::Dark), None),
            ("edge/dark/f.png", Some(Role::Dark), None),
            ("exp20ms_10ms.dng", None, None),
            ("series2/IMG_0012.dng", None, None),
            ("d1_dark_3916ms.npy", Some(Role::Dark), Some(3.916)),
            ("dark10ms/f2s.npy", Some(Role::Dark), Some(0.01)),
        ] {
            let path = Path::new(name);
            assert_eq!(role(path).map(|r| r.value.role), role_name, "{name}");
            let found = exposure_s(path).map(|e| e.value);
            let near = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-12;
            let same = match (found, seconds) {
                (Some(a), Some(b)) => near(a, b),
                (a, b) => a == b,
            };
            assert!(same, "{name}: {found:?}");
        }
        let named = |role, bias| Some(NamedRole { role, bias });
        assert_eq!(role_of("Bias Frame"), named(Role::Dark, true));
        assert_eq!(role_of("Flat Dark"), named(Role::Dark, false));
        assert_eq!(role_of("Master"), None);
    }
}
