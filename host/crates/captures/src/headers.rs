//! What the files of a set say of themselves, held against its manifest.
//!
//! A manifest may well know better than a file: so a contradiction is told, and the manifest is
//! followed.

use super::frames::open_with_facts;
use super::{Capture, CaptureSet, SensorFacts};
use camrig_base::Cfa;
use camrig_base::numbers::counted;
use camrig_formats::{Facts, Taken};
use rayon::prelude::*;
use std::collections::HashSet;
use std::path::Path;

/// Difference of black levels that is told, DN: files round them.
const BLACK_DN: f64 = 0.5;
/// Difference of exposures that is told, as a part: cameras round them to their lines.
const EXPOSURE: f64 = 0.01;

/// Difference of temperatures that is told, °C: measurements take closer ones as equal.
const TEMPERATURE_C: f64 = 3.0;
/// Difference of gains that is told, as a part: nominal ISO speeds are rounded to thirds of a stop,
/// which are 26 % apart; this is less than half of that.
const GAIN: f64 = 0.1;

/// What one file says of how its frames were taken.
struct Seen<'a> {
    capture: &'a Capture,
    file: &'a Path,
    taken: Taken,
}

impl CaptureSet {
    /// Where a file of a capture says another exposure, gain or temperature than `captures.toml`,
    /// or the first file of one another filter pattern, black level or white level: a sentence for
    /// each of these, with the first capture that it is true of. Files that cannot be read are
    /// passed over.
    #[must_use]
    pub fn contradictions(&self) -> Vec<String> {
        let facts = |capture: &Capture| Some(open_with_facts(capture.files.first()?).ok()?.1);
        let firsts: Vec<(&Capture, Facts)> =
            self.captures.par_iter().filter_map(|c| Some((c, facts(c)?))).collect();
        let further: Vec<(&Capture, &Path)> = (self.captures.iter())
            .flat_map(|c| c.files.iter().skip(1).map(move |file| (c, &**file)))
            .collect();
        let further = further.into_par_iter().filter_map(|(capture, file)| {
            Some(Seen { capture, file, taken: camrig_formats::taken(file).ok()? })
        });
        let further: Vec<Seen> = further.collect();
        let seen = firsts.iter().map(|(capture, facts)| {
            let file = capture.files.first().map_or(Path::new(""), |file| file);
            Seen { capture, file, taken: facts.taken.clone() }
        });
        let seen: Vec<Seen> = seen.chain(further).collect();
        let sensor = &self.sensor;
        let of_firsts = [pattern, black, white].map(|kind| {
            told(firsts.iter().filter_map(|(c, facts)| Some((*c, kind(sensor, facts)?))))
        });
        let reference = seen.iter().find(|s| s.taken.analog_gain.is_some());
        let gain = |one: &Seen| gain(one, reference?);
        let of_files = |kind: &dyn Fn(&Seen) -> Option<String>| {
            told(seen.iter().filter_map(|one| Some((one.capture, kind(one)?))))
        };
        let of_files = [of_files(&exposure), of_files(&gain), of_files(&temperature)];
        of_firsts.into_iter().chain(of_files).flatten().collect()
    }
}

/// What is true of some captures, said of the first.
fn told<'a>(all: impl Iterator<Item = (&'a Capture, String)>) -> Option<String> {
    let mut all: Vec<(&Capture, String)> = all.collect();
    // Of several files of a capture, one is named.
    let mut ids = HashSet::new();
    all.retain(|(capture, _)| ids.insert(&capture.id));
    let (first, words) = all.first()?;
    let more = match all.len() - 1 {
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

impl Seen<'_> {
    /// The file in a sentence: its name where the capture has several.
    fn name(&self) -> String {
        match (self.capture.files.len(), self.file.file_name()) {
            (2.., Some(name)) => format!("its file {}", name.display()),
            _ => "its file".to_owned(),
        }
    }
}

fn exposure(one: &Seen) -> Option<String> {
    let said = one.taken.exposure_s.as_ref()?;
    let near = |ours: f64| (said.value - ours).abs() <= EXPOSURE * ours;
    let ours = one.capture.exposure_s;
    let requested = one.capture.exposure_requested_s.is_some_and(near);
    (!near(ours) && !requested).then(|| {
        format!(
            "{} says an exposure of {} s ({}); captures.toml, {ours} s, counts",
            one.name(),
            said.value,
            said.by
        )
    })
}

/// Which gain is 1 differs between files and manifests: their ratio is held against that of
/// another file of the set.
fn gain(one: &Seen, reference: &Seen) -> Option<String> {
    let said = one.taken.analog_gain.as_ref()?;
    let other = reference.taken.analog_gain.as_ref()?;
    let (ours, theirs) = (one.capture.analog_gain, reference.capture.analog_gain);
    let expected = other.value / theirs * ours;
    ((said.value - expected).abs() > GAIN * expected).then(|| {
        format!(
            "{} says a gain of {} ({}) where captures.toml has {ours}, but that of capture {:?} \
             says {} for {theirs}; captures.toml counts",
            one.name(),
            said.value,
            said.by,
            reference.capture.id,
            other.value
        )
    })
}

fn temperature(one: &Seen) -> Option<String> {
    let said = one.taken.temperature_c.as_ref()?;
    let ours = one.capture.temperature_c?;
    ((said.value - ours).abs() > TEMPERATURE_C).then(|| {
        format!(
            "{} says a temperature of {} °C ({}); captures.toml, {ours} °C, counts",
            one.name(),
            said.value,
            said.by
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

    /// A FITS file of 4 x 2 samples with these cards.
    fn fits(cards: &str) -> Vec<u8> {
        let head = "SIMPLE=T,BITPIX=16,NAXIS=2,NAXIS1=4,NAXIS2=2,BZERO=32768,BSCALE=1";
        let mut bytes = Vec::new();
        for card in head.split(',').chain(cards.split(',')) {
            let (key, value) = card.split_once('=').unwrap();
            bytes.extend(format!("{:<80}", format!("{key:<8}= {value:>20}")).bytes());
        }
        bytes.extend(b"END".iter());
        bytes.resize(2880, b' ');
        bytes.resize(2 * 2880, 0);
        bytes
    }

    #[test]
    fn every_file_of_a_capture_is_held_against_the_manifest() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, cards: &str| {
            std::fs::write(folder.path().join(name), fits(cards)).unwrap();
        };
        write("c_0.fits", "EXPTIME=0.01,CCD-TEMP=20");
        write("c_1.fits", "EXPTIME=0.02,CCD-TEMP=40");
        write("c_2.fits", "EXPTIME=0.03,CCD-TEMP=20");
        let text = "format = \"captures/1\"\n[sensor]\nwidth = 4\nheight = 2\nbits = 16\n\
                    [[capture]]\nid = \"c\"\nrole = \"dark\"\nfiles = \"c_*.fits\"\n\
                    exposure_s = 0.01\ntemperature_c = 20.0\n";
        std::fs::write(folder.path().join("captures.toml"), text).unwrap();
        let told = CaptureSet::load(folder.path()).unwrap().contradictions();
        assert_eq!(told.len(), 2, "{told:?}");
        let words = ["an exposure of 0.02 s", "a temperature of 40 °C"];
        for (line, words) in told.iter().zip(words) {
            let begins =
                line.starts_with(&format!("capture \"c\": its file c_1.fits says {words}"));
            assert!(begins, "{line}");
        }
    }

    #[test]
    fn gains_are_compared_within_the_set() {
        let capture = |gain: f64| Capture {
            analog_gain: gain,
            ..Capture::new("a", crate::Role::Flat, Vec::new(), 0.01)
        };
        let seen = |capture, iso: f64| {
            let analog_gain = Some(Said::new(iso / 100.0, format!("ISO {iso}")));
            let taken = Taken { analog_gain, ..Taken::default() };
            Seen { capture, file: Path::new("a.dng"), taken }
        };
        // A camera whose base is ISO 200.
        let (one, two) = (capture(1.0), capture(2.0));
        let base = seen(&one, 200.0);
        assert_eq!(gain(&seen(&two, 400.0), &base), None);
        let told = gain(&seen(&two, 200.0), &base).unwrap();
        assert!(told.contains("a gain of 2 (ISO 200) where captures.toml has 2"), "{told}");
    }
}
