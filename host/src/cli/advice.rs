//! Errors in terms of the command line.
//!
//! The library says what would be right in terms of its calls; here the flag or the command that
//! does so is added, found by the error's code.

use camrig_base::Error;

/// What to type, by the code of an error ([`Error::code`]): flags of the command, or a sentence
/// about another command.
const ADVICE: &[(&str, &str)] = &[
    ("asymmetric-lens", "camrig lens trace --fields X:Y,X:Y, or -o DIR"),
    ("built-without-graphics", "--features gpu; --device cpu"),
    (
        "camera-keys",
        "--pixels, --pitch-um, --cfa, --bits; or --like NAME, a built-in sensor of camrig presets",
    ),
    ("chart-not-drawn", "camrig scene export CHART -o FILE draws it"),
    ("exposure-time", "--only, --response"),
    ("frame-too-large", "--collapse"),
    ("graphics-processor", "--device cpu"),
    ("largest-field", "--max-field"),
    ("missing-facts", "--bits, --cfa, --black, --white"),
    ("no-edge-capture", "camrig capture --plan paper shows what is needed"),
    ("no-irradiance", "camrig simulate --save-irradiance FILE makes one"),
    ("no-library", "camrig scene add --library DIR makes one"),
    ("no-pseudo-terminals", "--tcp HOST:PORT"),
    ("output-exists", "--force"),
    ("patch-outside", "--corners X1,Y1,...,X4,Y4"),
    ("path-unsupported", "--path bands"),
    ("psf-method", "--psf auto, --psf geometric"),
    ("psf-window", "--psf-spacing, --sensor-shift"),
    ("region-outside", "--roi X,Y,WIDTH,HEIGHT, --region X,Y,WIDTH,HEIGHT"),
    ("rig-arithmetic", "--arith"),
    ("rig-not-found", "camrig rig list shows what is connected"),
    ("rig-register", "camrig rig register --help lists the registers"),
    ("rig-unreachable", "camrig rig serve --tcp HOST:PORT starts one"),
    ("rotation-stacks", "camrig crosstalk bench makes such captures"),
    ("row-padding", "--stride BYTES"),
    ("saturated-capture", "camrig scene hdr merges captures"),
    ("several-frames", "--frame N"),
    ("stop-radius", "--stop-radius MM, in a camera file stop_radius_mm = MM"),
    ("unknown-glass", "--glass NAME=ND:VD, in a camera file glass = \"NAME=ND:VD\""),
];

/// The error with what to type behind its help.
pub fn advised(error: Error) -> Error {
    let advice = ADVICE.iter().find(|(code, _)| error.code() == Some(code));
    let Some((_, advice)) = advice else { return error };
    let help = match error.remedy() {
        Some(help) if advice.starts_with("camrig") => format!("{help}; {advice}"),
        Some(help) => format!("{help} ({advice})"),
        None => (*advice).to_string(),
    };
    error.help(help)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use std::path::Path;

    #[test]
    fn the_flag_stands_behind_the_help() {
        let error = Error::input("a.npy exists").help("replace it").with_code("output-exists");
        assert_eq!(advised(error).to_string(), "a.npy exists\n  help: replace it (--force)");
        let unmade = Error::input("no library").help("add a scene").with_code("no-library");
        let told = "no library\n  help: add a scene; camrig scene add --library DIR makes one";
        assert_eq!(advised(unmade).to_string(), told);
        let bare = Error::input("a.npy exists").with_code("output-exists");
        assert_eq!(advised(bare).to_string(), "a.npy exists\n  help: --force");
        assert_eq!(advised(Error::input("-3 lx")).to_string(), "-3 lx");
    }

    /// Codes that the library gives, from its source.
    fn codes(folder: &Path, found: &mut BTreeSet<String>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                codes(&path, found);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let text = std::fs::read_to_string(&path).unwrap();
                let given = text.split(".with_code(\"").skip(1);
                found.extend(given.filter_map(|rest| Some(rest.split_once('"')?.0.to_string())));
            }
        }
    }

    #[test]
    fn every_code_of_the_library_has_advice_and_the_other_way_round() {
        let mut given = BTreeSet::new();
        codes(&Path::new(env!("CARGO_MANIFEST_DIR")).join("crates"), &mut given);
        let advised: BTreeSet<String> = ADVICE.iter().map(|(code, _)| code.to_string()).collect();
        assert_eq!(given, advised);
    }
}
