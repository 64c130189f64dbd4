//! DNG files with a black level for each place of their pattern.

use super::{camrig, camrig_ok};
use camrig::formats::{DngInfo, dng};
use camrig::prelude::{Cfa, Plane, RawFrame};
use std::path::Path;

/// Levels of the places of the pattern, DN.
const LEVELS: [u16; 4] = [61, 64, 65, 70];

/// Every sample 20 DN above the black of its place.
fn write(path: &Path) {
    let level = |x: usize, y: usize| LEVELS[y % 2 * 2 + x % 2];
    let raw = RawFrame {
        width: 240,
        height: 160,
        bits: 12,
        cfa: Cfa::parse("RGGB").unwrap(),
        black_level_dn: 65.0,
        white_level_dn: 4095,
        data: Plane::from_fn(240, 160, |x, y| level(x, y) + 20).data,
    };
    let black_levels_dn = LEVELS.map(f64::from).to_vec();
    let info = DngInfo { black_levels_dn, ..DngInfo::default() };
    std::fs::write(path, dng::encode(&raw, &info).unwrap()).unwrap();
}

#[test]
fn each_place_of_the_pattern_has_its_own() {
    let folder = tempfile::tempdir().unwrap();
    write(&folder.path().join("a.dng"));
    let found = camrig_ok(folder.path(), "measure patches a.dng --json");
    let json: serde_json::Value = serde_json::from_slice(&found.stdout).unwrap();
    for patch in json["patches"].as_array().unwrap() {
        let means = patch["mean_dn"].as_array().unwrap();
        assert!(means.len() == 3 && means.iter().all(|m| m["value"] == 20.0), "{patch}");
    }
    let words = |arguments: &str| {
        String::from_utf8_lossy(&camrig(folder.path(), arguments).stderr).into_owned()
    };
    let told = words("convert a.dng a.pgm");
    assert!(
        told.contains("black levels differ by place of the pattern, 61, 64, 65, 70"),
        "{told}"
    );
    assert!(!words("convert a.dng b.dng").contains("black levels differ"));
}

/// A draft of a manifest has no black level then: camrig's own would be wrong for three places.
#[test]
fn a_draft_of_a_manifest_leaves_it_to_the_darks() {
    let folder = tempfile::tempdir().unwrap();
    write(&folder.path().join("dark-1.dng"));
    camrig_ok(folder.path(), "captures new .");
    let text = std::fs::read_to_string(folder.path().join("captures.toml")).unwrap();
    assert!(text.contains("the files have 61, 64, 65, 70 by position of the pattern"), "{text}");
    assert!(!text.lines().any(|line| line.starts_with("black_level_dn")), "{text}");
}
