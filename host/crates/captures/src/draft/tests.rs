//! Drafts for folders with known frames.

use super::*;
use crate::{CaptureSet, Role};
use camrig_base::Plane;
use camrig_formats::{DngInfo, Facts, Format, Frames};

/// A frame of 64 x 48 pixels around a level, with a pattern that no two frames share.
fn plane(level: u16, number: u16) -> Plane<u16> {
    Plane::from_fn(64, 48, |x, y| level + ((x * 7 + y * 13) as u16 + number) % 4)
}

fn put(folder: &Path, name: &str, format: &Format, planes: Vec<Plane<u16>>, facts: Facts) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, format.encode(&Frames { planes, facts }).unwrap()).unwrap();
}

/// The metadata of a camera's file: 12 bits, black at 64.
fn facts(exposure_s: f64) -> Facts {
    Facts {
        bits: Some(12),
        cfa: Cfa::parse("RGGB").ok(),
        black_level_dn: Some(64.0),
        white_level_dn: Some(4095),
        dng: Some(DngInfo { exposure_s: Some(exposure_s), iso: Some(200), ..DngInfo::default() }),
        ..Facts::default()
    }
}

fn draft(folder: &Path, known: &Known) -> Draft {
    Draft::of(folder, known, &|_| {}).unwrap()
}

fn load(folder: &Path, draft: &Draft) -> Result<CaptureSet> {
    std::fs::write(folder.join("captures.toml"), draft.text(&["made by a test"])).unwrap();
    CaptureSet::load(folder)
}

#[test]
fn files_with_all_metadata_need_nothing_more() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for n in 0..3 {
        let (dark, flat) = (plane(62, n), plane(1500, n));
        put(folder, &format!("darks/{n:03}.dng"), &Format::Dng, vec![dark], facts(0.01));
        put(folder, &format!("{n}_flat.dng"), &Format::Dng, vec![flat.clone()], facts(0.01));
        put(folder, &format!("{n}_flat.tiff"), &Format::Tiff, vec![flat], facts(0.02));
    }
    std::fs::write(folder.join("notes.txt"), "lamp 3").unwrap();
    std::fs::write(folder.join("preview.jpg"), "no frame").unwrap();
    let draft = draft(folder, &Known::default());
    assert!(draft.unknown().is_empty(), "{}", draft.text(&[]));
    assert_eq!(draft.count(), [3, 9]);
    assert_eq!(draft.skipped.len(), 1);
    let text = draft.text(&[]);
    for line in [
        "exposure_s = 0.01               # EXIF ExposureTime",
        "exposure_s = 0.02               # camrig's note in the file",
        "analog_gain = 2                 # ISO 200, with ISO 100 as gain 1",
        "role = \"dark\"                   # the name \"darks\"",
        "bits = 12                       # the files",
        "# temperature_c: omitted, not in the files",
    ] {
        assert!(text.contains(line), "{line}\n{text}");
    }
    let set = load(folder, &draft).unwrap();
    assert_eq!(set.sensor.cfa, Cfa::parse("RGGB").ok());
    let dark = set.with_role(Role::Dark).next().unwrap();
    assert_eq!((dark.files.len(), dark.exposure_s, dark.analog_gain), (3, 0.01, 2.0));
    let flats: Vec<f64> = set.with_role(Role::Flat).map(|c| c.exposure_s).collect();
    assert_eq!(flats, [0.01, 0.02]);
}

/// Files without metadata and names with little: exactly the missing values are placeholders, and
/// values from the caller replace them.
#[test]
fn only_missing_values_are_placeholders() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let nothing = Facts::default();
    for n in 0..2 {
        put(folder, &format!("a{n}.npy"), &Format::Npy, vec![plane(62, n)], nothing.clone());
    }
    put(folder, "flat-5ms.npy", &Format::Npy, vec![plane(900, 1), plane(900, 2)], nothing);
    let draft = draft(folder, &Known::default());
    let unknown: Vec<_> = draft.unknown().into_iter().collect();
    // The flat's name has its exposure, and its levels show one filter; black is unknown.
    assert_eq!(
        unknown,
        [("analog_gain", 2), ("bits", 1), ("exposure_s", 1), ("role", 1)],
        "{}",
        draft.text(&[])
    );
    let message = load(folder, &draft).unwrap_err().to_string();
    assert!(message.contains("5 things to put right"), "{message}");
    assert_eq!(message.matches("is not known").count(), 5, "{message}");
    assert!(message.contains("id \"a\": role is not known"), "{message}");

    let known = Known {
        exposure_s: Some(0.001),
        analog_gain: Some(1.0),
        bits: Some(12),
        black_level_dn: Some(63.0),
        ..Known::default()
    };
    let draft = self::draft(folder, &known);
    assert!(draft.unknown().is_empty(), "{}", draft.text(&[]));
    let set = load(folder, &draft).unwrap();
    let roles: Vec<_> = set.captures.iter().map(|c| (c.role, c.exposure_s)).collect();
    // Values from the caller take precedence over names.
    assert_eq!(roles, [(Role::Dark, 0.001), (Role::Flat, 0.001)]);
    assert!(set.cfa().is_mono());
}

/// Pairs at several levels, as for EMVA 1288, in one folder: only the level separates them.
#[test]
fn pairs_are_separated_by_their_level() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for pair in 0..6 {
        for n in 0..2 {
            let frame = vec![plane(62 + 300 * pair, n)];
            let name = format!("IMG_{}.dng", 8 + 2 * pair + n);
            put(folder, &name, &Format::Dng, frame, facts(0.01));
        }
    }
    let draft = draft(folder, &Known::default());
    assert_eq!(draft.count(), [6, 12], "{}", draft.text(&[]));
    let set = load(folder, &draft).unwrap();
    let roles: Vec<Role> = set.captures.iter().map(|c| c.role).collect();
    assert_eq!(roles[..2], [Role::Dark, Role::Flat]);
    let ids: std::collections::BTreeSet<&str> = set.captures.iter().map(|c| &c.id[..]).collect();
    assert_eq!(ids.len(), 6, "{ids:?}");
    for (pair, capture) in set.captures.iter().enumerate() {
        let mut means = Vec::new();
        set.for_each_batch(capture, |planes| {
            let mean = |p: &Plane<u16>| {
                p.data.iter().map(|v| f64::from(*v)).sum::<f64>() / p.data.len() as f64
            };
            means.extend(planes.iter().map(mean));
            Ok(())
        })
        .unwrap();
        let level = (62 + 300 * pair) as f64 + 1.5;
        assert!(means.iter().all(|m| (m - level).abs() < 1.0), "{pair}: {means:?}");
    }
}

/// The means of darks wander by more than half a per cent of their own range.
#[test]
fn darks_alone_are_one_stack() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for n in 0..6 {
        let frame = vec![plane(200 + n % 3, n)];
        let name = format!("dark_{n:03}.fits");
        put(folder, &name, &Format::Fits, frame, Facts::default());
    }
    let draft = draft(folder, &Known::default());
    assert_eq!(draft.count(), [1, 6], "{}", draft.text(&[]));
}

#[test]
fn bias_frames_sidecars_and_edges() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let bare = |bits| Facts { bits: Some(bits), ..Facts::default() };
    put(folder, "bias.pgm", &Format::Pgm, vec![plane(62, 0), plane(62, 1)], bare(12));
    let edge = Plane::from_fn(64, 48, |x, y| if x + y / 8 < 32 { 300 } else { 3000 });
    put(folder, "x.pgm", &Format::Pgm, vec![edge], bare(12));
    std::fs::write(
        folder.join("x.json"),
        r#"{"ExposureTime": 8000, "AnalogueGain": 4.0, "SensorTemperature": 41.0,
            "SensorBlackLevels": [1024, 1024, 1024, 1024]}"#,
    )
    .unwrap();
    let known = Known { cfa: Cfa::parse("mono").ok(), analog_gain: Some(1.0), ..Known::default() };
    let draft = draft(folder, &known);
    assert!(draft.unknown().is_empty(), "{}", draft.text(&[]));
    let set = load(folder, &draft).unwrap();
    let [bias, edge] = &set.captures[..] else { panic!("{}", draft.text(&[])) };
    assert_eq!((bias.role, bias.exposure_s, bias.analog_gain), (Role::Dark, 0.0, 1.0));
    assert_eq!((edge.role, edge.exposure_s, edge.analog_gain), (Role::Edge, 0.008, 4.0));
    assert_eq!(edge.temperature_c, Some(41.0));
    // libcamera's black levels have 16 bits: 1024 of 65536 is 64 of 4096.
    assert_eq!(set.sensor.black_level_dn, Some(64.0));
}

#[test]
fn frames_of_two_sizes_and_none_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let error =
        |folder: &Path| Draft::of(folder, &Known::default(), &|_| {}).unwrap_err().to_string();
    std::fs::write(folder.join("a.jpg"), "no frame").unwrap();
    assert!(error(folder).contains("no frames") && error(folder).contains("a.jpg"));
    put(folder, "a.dng", &Format::Dng, vec![plane(62, 0)], facts(0.01));
    let small = Plane::filled(32, 48, 64);
    put(folder, "b.dng", &Format::Dng, vec![small], facts(0.01));
    assert!(error(folder).contains("several sizes"), "{}", error(folder));
    assert!(error(&folder.join("nowhere")).contains("nowhere"));
}
