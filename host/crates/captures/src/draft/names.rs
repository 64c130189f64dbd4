//! What names of files and folders say.

use crate::Role;
use std::path::Path;

/// Words of names and of FITS's IMAGETYP, and the role they stand for. Of several in one name the
/// first of this list counts: a `flat-dark` is a dark.
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
/// Words of frames without exposure.
const BIAS: [&str; 3] = ["bias", "biases", "zero"];
/// Units of durations in names, in seconds.
const UNITS: [(&str, f64); 4] = [("us", 1e-6), ("ms", 1e-3), ("sec", 1.0), ("s", 1.0)];

/// Words of a text: runs of letters, in lower case.
fn words(text: &str) -> Vec<String> {
    let split = text.split(|c: char| !c.is_alphabetic()).filter(|word| !word.is_empty());
    split.map(str::to_lowercase).collect()
}

/// The parts of a path, the file's name without its ending first.
fn parts(path: &Path) -> Vec<String> {
    let stem = path.with_extension("");
    let mut parts: Vec<String> =
        stem.components().map(|c| c.as_os_str().to_string_lossy().into_owned()).collect();
    parts.reverse();
    parts
}

/// The role that a text names, and whether it is a bias.
pub fn role_of(text: &str) -> Option<(Role, bool)> {
    let words = words(text);
    let (_, role) = WORDS.iter().find(|(word, _)| words.iter().any(|w| w == word))?;
    Some((*role, words.iter().any(|w| BIAS.contains(&&w[..]))))
}

/// The role that the nearest part of a path names, that part, and whether it is a bias.
pub fn role(path: &Path) -> Option<(Role, bool, String)> {
    parts(path).into_iter().find_map(|part| {
        let (role, bias) = role_of(&part)?;
        Some((role, bias, part))
    })
}

/// The exposure time in the nearest part of a path that has one (`dark-010ms`, `6300us`,
/// `flat_1.5s`), s, and that part. A part with two is taken for none.
pub fn exposure_s(path: &Path) -> Option<(f64, String)> {
    parts(path).into_iter().find_map(|part| match durations(&part)[..] {
        [seconds] => Some((seconds, part)),
        _ => None,
    })
}

fn durations(text: &str) -> Vec<f64> {
    let number = |c: char| c.is_ascii_digit() || c == '.';
    let mut found = Vec::new();
    let mut rest = text;
    while let Some(start) = rest.find(|c: char| c.is_ascii_digit()) {
        // `f2s` is more likely a name than two seconds.
        let apart = !rest[..start].ends_with(char::is_alphabetic);
        let digits = rest[start..].find(|c| !number(c)).unwrap_or(rest.len() - start);
        let (value, after) = rest[start..].split_at(digits);
        let unit = after.find(|c: char| !c.is_alphabetic()).unwrap_or(after.len());
        let unit = UNITS.iter().find(|(name, _)| after[..unit].eq_ignore_ascii_case(name));
        if let (Ok(value), Some((_, seconds))) = (value.parse::<f64>(), unit)
            && (apart || *seconds < 1.0)
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
    fn names_say_role_and_exposure() {
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
            assert_eq!(role(path).map(|r| r.0), role_name, "{name}");
            let found = exposure_s(path).map(|e| e.0);
            let near = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-12;
            let same = match (found, seconds) {
                (Some(a), Some(b)) => near(a, b),
                (a, b) => a == b,
            };
            assert!(same, "{name}: {found:?}");
        }
        assert_eq!(role_of("Bias Frame"), Some((Role::Dark, true)));
        assert_eq!(role_of("Flat Dark"), Some((Role::Dark, false)));
        assert_eq!(role_of("Master"), None);
    }
}
