//! What the files of a set say of themselves, held against its manifest.
//!
//! A manifest may well know better than a file: so a contradiction is told, and the manifest is
//! followed.

use super::frames::open_with_facts;
use super::{Capture, CaptureSet, SensorFacts};
use camrig_base::Cfa;
use camrig_base::numbers::counted;
use camrig_formats::Facts;
use rayon::prelude::*;

/// Difference of black levels that is told, DN: files round them.
const BLACK_DN: f64 = 0.5;
/// Difference of exposures that is told, as a part: cameras round them to their lines.
const EXPOSURE: f64 = 0.01;

impl CaptureSet {
    /// Where the first file of a capture says another filter pattern, black level, white level or
    /// exposure than `captures.toml`: a sentence for each of these, with the first capture that it
    /// is true of. Files that cannot be read are passed over.
    #[must_use]
    pub fn contradictions(&self) -> Vec<String> {
        let facts = |capture: &Capture| Some(open_with_facts(capture.files.first()?).ok()?.1);
        let seen: Vec<(&Capture, Facts)> =
            self.captures.par_iter().filter_map(|c| Some((c, facts(c)?))).collect();
        let sensor = &self.sensor;
        [pattern, black, white]
            .map(|kind| told(&seen, |_, facts| kind(sensor, facts)))
            .into_iter()
            .chain([told(&seen, exposure)])
            .flatten()
            .collect()
    }
}

/// What is true of some captures, said of the first.
fn told(
    seen: &[(&Capture, Facts)],
    words: impl Fn(&Capture, &Facts) -> Option<String>,
) -> Option<String> {
    let mut all = seen.iter().filter_map(|(c, facts)| Some((*c, words(c, facts)?)));
    let (first, words) = all.next()?;
    let more = match all.count() {
        0 => String::new(),
        n => format!(" (and so {} more)", counted(n, "capture")),
    };
    Some(format!("capture {:?}{more}: {words}", first.id))
}

fn pattern(sensor: &SensorFacts, facts: &Facts) -> Option<String> {
    let said = facts.cfa.as_ref()?;
    match &sensor.cfa {
        Some(cfa) if cfa == said => None,
        Some(cfa) => Some(format!("its file says cfa = \"{said}\"; captures.toml, {cfa}, counts")),
        None if is_mono(said) => None,
        None => Some(format!(
            "its file says cfa = \"{said}\", captures.toml has no cfa: the sensor is taken as mono"
        )),
    }
}

fn is_mono(cfa: &Cfa) -> bool {
    cfa.channels().len() == 1
}

fn black(sensor: &SensorFacts, facts: &Facts) -> Option<String> {
    let (said, ours) = (facts.black_level_dn?, sensor.black_level_dn?);
    ((said - ours).abs() > BLACK_DN).then(|| {
        format!("its file says a black level of {said} DN; captures.toml, {ours} DN, counts")
    })
}

fn white(sensor: &SensorFacts, facts: &Facts) -> Option<String> {
    let (said, ours) = (facts.white_level_dn?, sensor.white_level_dn);
    (said != ours).then(|| {
        format!(
            "its file says a white level of {said} DN; white_level_dn of captures.toml, {ours} \
             DN (full scale where it is not given), counts"
        )
    })
}

fn exposure(capture: &Capture, facts: &Facts) -> Option<String> {
    let said = facts.taken.exposure_s.as_ref()?;
    let near = |ours: f64| (said.value - ours).abs() <= EXPOSURE * ours;
    let ours = capture.exposure_s;
    let requested = capture.exposure_requested_s.is_some_and(near);
    (!near(ours) && !requested).then(|| {
        format!(
            "its file says an exposure of {} s ({}); captures.toml, {ours} s, counts",
            said.value, said.by
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::Plane;
    use camrig_formats::{Format, Frames, Said};

    /// Frames that say RGGB, black 64, white 1000 and 10 ms.
    fn set(sensor: &str, exposure: &str) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        let mut facts = Facts {
            bits: Some(12),
            cfa: Cfa::parse("RGGB").ok(),
            black_level_dn: Some(64.0),
            white_level_dn: Some(1000),
            ..Facts::default()
        };
        facts.taken.exposure_s = Some(Said::new(0.01, "a test"));
        let frames = Frames { planes: vec![Plane::filled(8, 6, 70)], facts };
        for name in ["a.pgm", "b.pgm"] {
            let bytes = Format::Pgm.encode(&frames).unwrap();
            std::fs::write(folder.path().join(name), bytes).unwrap();
        }
        let entry = |id: &str| {
            format!(
                "[[capture]]\nid = \"{id}\"\nrole = \"flat\"\nfiles = \"{id}.pgm\"\n{exposure}\n"
            )
        };
        let head = "format = \"captures/1\"\n[sensor]\nwidth = 8\nheight = 6\nbits = 12\n";
        let text = format!("{head}{sensor}\n{}{}", entry("a"), entry("b"));
        std::fs::write(folder.path().join("captures.toml"), text).unwrap();
        CaptureSet::load(folder.path()).unwrap().contradictions()
    }

    #[test]
    fn what_files_say_against_the_manifest_is_told() {
        let same = "cfa = \"RGGB\"\nwhite_level_dn = 1000\nblack_level_dn = 64.25";
        assert_eq!(set(same, "exposure_s = 0.01005"), [""; 0]);
        let requested = "exposure_s = 0.0123\nexposure_requested_s = 0.01";
        assert_eq!(set("cfa = \"RGGB\"\nwhite_level_dn = 1000", requested), [""; 0]);
        let other = "cfa = \"BGGR\"\nblack_level_dn = 63";
        let told = set(other, "exposure_s = 10.0");
        let words = [
            "cfa = \"RGGB\"; captures.toml, BGGR",
            "black level of 64 DN; captures.toml, 63 DN",
            "white level of 1000 DN; white_level_dn of captures.toml, 4095 DN",
            "an exposure of 0.01 s",
        ];
        assert_eq!(told.len(), 4, "{told:?}");
        for (line, words) in told.iter().zip(words) {
            let begins = line.starts_with("capture \"a\" (and so 1 capture more): its file says");
            assert!(begins && line.contains(words), "{line}");
        }
        assert!(set("white_level_dn = 1000", "exposure_s = 0.01")[0].contains("taken as mono"));
    }
}
