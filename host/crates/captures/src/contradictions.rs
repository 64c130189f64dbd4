//! Compares the metadata in the files of a set with its manifest.
//!
//! Contradictions are reported; the manifest takes precedence, since it may be better informed
//! than a file.

use super::frames::open_with_facts;
use super::{Capture, CaptureSet, SensorFacts};
use camrig_base::Cfa;
use camrig_base::numbers::counted;
use camrig_formats::{Facts, Taken};
use rayon::prelude::*;
use std::collections::HashSet;
use std::path::Path;

/// Smallest difference of black levels that is reported, DN: files round them.
const MIN_BLACK_DN: f64 = 0.5;
/// Smallest relative difference of exposures that is reported: cameras round them to their line
/// time.
const MIN_EXPOSURE: f64 = 0.01;

/// Smallest difference of temperatures that is reported, °C: measurements treat smaller ones as
/// equal.
const MIN_TEMPERATURE_C: f64 = 3.0;
/// Smallest relative difference of gains that is reported: nominal ISO speeds are rounded to thirds
/// of a stop, 26 %; this is less than half of that.
const MIN_GAIN: f64 = 0.1;

/// The metadata of one file.
struct FileMetadata<'a> {
    capture: &'a Capture,
    file: &'a Path,
    taken: Taken,
}

impl CaptureSet {
    /// Contradictions between files and `captures.toml`: exposure, gain or temperature of any file,
    /// filter pattern, black level or white level of the first file of a capture. Each is a
    /// sentence with the first capture concerned. Files that cannot be read are skipped.
    #[must_use]
    pub fn contradictions(&self) -> Vec<String> {
        let facts = |capture: &Capture| Some(open_with_facts(capture.files.first()?).ok()?.1);
        let firsts: Vec<(&Capture, Facts)> =
            self.captures.par_iter().filter_map(|c| Some((c, facts(c)?))).collect();
        let further: Vec<(&Capture, &Path)> = (self.captures.iter())
            .flat_map(|c| c.files.iter().skip(1).map(move |file| (c, &**file)))
            .collect();
        let further = further.into_par_iter().filter_map(|(capture, file)| {
            Some(FileMetadata { capture, file, taken: camrig_formats::taken(file).ok()? })
        });
        let further: Vec<FileMetadata> = further.collect();
        let files = firsts.iter().map(|(capture, facts)| {
            let file = capture.files.first().map_or(Path::new(""), |file| file);
            FileMetadata { capture, file, taken: facts.taken.clone() }
        });
        let files: Vec<FileMetadata> = files.chain(further).collect();
        let sensor = &self.sensor;
        let of_firsts = [pattern, black, white].map(|kind| {
            summary(firsts.iter().filter_map(|(c, facts)| Some((*c, kind(sensor, facts)?))))
        });
        let reference = files.iter().find(|s| s.taken.analog_gain.is_some());
        let gain = |one: &FileMetadata| gain(one, reference?);
        let of_files = |kind: &dyn Fn(&FileMetadata) -> Option<String>| {
            summary(files.iter().filter_map(|one| Some((one.capture, kind(one)?))))
        };
        let of_files = [of_files(&exposure), of_files(&gain), of_files(&temperature)];
        of_firsts.into_iter().chain(of_files).flatten().collect()
    }
}

/// One sentence for all captures concerned, with the message of the first.
fn summary<'a>(all: impl Iterator<Item = (&'a Capture, String)>) -> Option<String> {
    let mut all: Vec<(&Capture, String)> = all.collect();
    // One file per capture.
    let mut ids = HashSet::new();
    all.retain(|(capture, _)| ids.insert(&capture.id));
    let (first, message) = all.first()?;
    let more = match all.len() - 1 {
        0 => String::new(),
        n => format!(" and {} more", counted(n, "capture")),
    };
    Some(format!("capture {:?}{more}: {message}", first.id))
}

fn pattern(sensor: &SensorFacts, facts: &Facts) -> Option<String> {
    let found = facts.cfa.as_ref()?;
    match &sensor.cfa {
        Some(cfa) if cfa == found => None,
        Some(cfa) => {
            Some(format!("its file has cfa = \"{found}\"; that of captures.toml, {cfa}, is used"))
        }
        None if is_mono(found) => None,
        None => Some(format!(
            "its file has cfa = \"{found}\", captures.toml has none: the sensor is treated as monochrome"
        )),
    }
}

fn is_mono(cfa: &Cfa) -> bool {
    cfa.channels().len() == 1
}

fn black(sensor: &SensorFacts, facts: &Facts) -> Option<String> {
    let (found, ours) = (facts.black_level_dn?, sensor.black_level_dn?);
    ((found - ours).abs() > MIN_BLACK_DN).then(|| {
        format!(
            "its file has a black level of {found} DN; that of captures.toml, {ours} DN, is used"
        )
    })
}

fn white(sensor: &SensorFacts, facts: &Facts) -> Option<String> {
    let (found, ours) = (facts.white_level_dn?, sensor.white_level_dn);
    (found != ours).then(|| {
        format!(
            "its file has a white level of {found} DN; white_level_dn of captures.toml, {ours} DN \
             (full scale if omitted), is used"
        )
    })
}

impl FileMetadata<'_> {
    /// The file in a sentence, with its name where the capture has several.
    fn name(&self) -> String {
        match (self.capture.files.len(), self.file.file_name()) {
            (2.., Some(name)) => format!("its file {}", name.display()),
            _ => "its file".to_owned(),
        }
    }
}

fn exposure(one: &FileMetadata) -> Option<String> {
    let found = one.taken.exposure_s.as_ref()?;
    let near = |ours: f64| (found.value - ours).abs() <= MIN_EXPOSURE * ours;
    let ours = one.capture.exposure_s;
    let requested = one.capture.exposure_requested_s.is_some_and(near);
    (!near(ours) && !requested).then(|| {
        format!(
            "{} has an exposure of {} s ({}); that of captures.toml, {ours} s, is used",
            one.name(),
            found.value,
            found.by
        )
    })
}

/// Files and manifests may define unity gain differently, so ratios to another file of the set are
/// compared.
fn gain(one: &FileMetadata, reference: &FileMetadata) -> Option<String> {
    let found = one.taken.analog_gain.as_ref()?;
    let other = reference.taken.analog_gain.as_ref()?;
    let (ours, theirs) = (one.capture.analog_gain, reference.capture.analog_gain);
    let expected = other.value / theirs * ours;
    ((found.value - expected).abs() > MIN_GAIN * expected).then(|| {
        format!(
            "{} has a gain of {} ({}) where captures.toml has {ours}, but that of capture {:?} has \
             {} for {theirs}; those of captures.toml are used",
            one.name(),
            found.value,
            found.by,
            reference.capture.id,
            other.value
        )
    })
}

fn temperature(one: &FileMetadata) -> Option<String> {
    let found = one.taken.temperature_c.as_ref()?;
    let ours = one.capture.temperature_c?;
    ((found.value - ours).abs() > MIN_TEMPERATURE_C).then(|| {
        format!(
            "{} has a temperature of {} °C ({}); that of captures.toml, {ours} °C, is used",
            one.name(),
            found.value,
            found.by
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::Plane;
    use camrig_formats::{Format, Frames, Said};

    /// The contradictions of frames with metadata RGGB, black 64, white 1000 and 10 ms.
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
    fn contradictions_between_files_and_manifest_are_reported() {
        let same = "cfa = \"RGGB\"\nwhite_level_dn = 1000\nblack_level_dn = 64.25";
        assert_eq!(set(same, "exposure_s = 0.01005"), [""; 0]);
        let requested = "exposure_s = 0.0123\nexposure_requested_s = 0.01";
        assert_eq!(set("cfa = \"RGGB\"\nwhite_level_dn = 1000", requested), [""; 0]);
        let other = "cfa = \"BGGR\"\nblack_level_dn = 63";
        let found = set(other, "exposure_s = 10.0");
        let words = [
            "cfa = \"RGGB\"; that of captures.toml, BGGR",
            "black level of 64 DN; that of captures.toml, 63 DN",
            "white level of 1000 DN; white_level_dn of captures.toml, 4095 DN",
            "an exposure of 0.01 s",
        ];
        assert_eq!(found.len(), 4, "{found:?}");
        for (line, words) in found.iter().zip(words) {
            let begins = line.starts_with("capture \"a\" and 1 capture more: its file has");
            assert!(begins && line.contains(words), "{line}");
        }
        assert!(
            set("white_level_dn = 1000", "exposure_s = 0.01")[0].contains("treated as monochrome")
        );
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
    fn every_file_of_a_capture_is_compared_with_the_manifest() {
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
        let found = CaptureSet::load(folder.path()).unwrap().contradictions();
        assert_eq!(found.len(), 2, "{found:?}");
        let words = ["an exposure of 0.02 s", "a temperature of 40 °C"];
        for (line, words) in found.iter().zip(words) {
            let begins =
                line.starts_with(&format!("capture \"c\": its file c_1.fits has {words}"));
            assert!(begins, "{line}");
        }
    }

    #[test]
    fn gains_are_compared_within_the_set() {
        let capture = |gain: f64| Capture {
            analog_gain: gain,
            ..Capture::new("a", crate::Role::Flat, Vec::new(), 0.01)
        };
        let with_iso = |capture, iso: f64| {
            let analog_gain = Some(Said::new(iso / 100.0, format!("ISO {iso}")));
            let taken = Taken { analog_gain, ..Taken::default() };
            FileMetadata { capture, file: Path::new("a.dng"), taken }
        };
        // A camera whose base is ISO 200.
        let (one, two) = (capture(1.0), capture(2.0));
        let base = with_iso(&one, 200.0);
        assert_eq!(gain(&with_iso(&two, 400.0), &base), None);
        let found = gain(&with_iso(&two, 200.0), &base).unwrap();
        assert!(found.contains("a gain of 2 (ISO 200) where captures.toml has 2"), "{found}");
    }
}
