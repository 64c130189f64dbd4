//! Errors in terms of the command line.
//!
//! The library says what would be right in terms of its calls; here the flag or the command that
//! does so is added, found by the error's code.

use camrig_base::{Error, ErrorCode};

/// What to type, by the code of an error ([`Error::code`]): flags of the command, or a sentence
/// about another command.
const ADVICE: &[(ErrorCode, &str)] = &[
    (ErrorCode::AsymmetricLens, "camrig lens trace --fields X:Y,X:Y, or -o DIR"),
    (ErrorCode::BuiltWithoutGraphics, "--features gpu; --device cpu"),
    (
        ErrorCode::CameraKeys,
        "--pixels, --pitch-um, --cfa, --bits; or --like NAME, a built-in sensor of camrig presets",
    ),
    (ErrorCode::ChartNotDrawn, "camrig scene export CHART -o FILE draws it"),
    (ErrorCode::ExposureTime, "--only, --response"),
    (ErrorCode::FrameTooLarge, "--collapse"),
    (ErrorCode::GraphicsProcessor, "--device cpu"),
    (ErrorCode::LargestField, "--max-field"),
    (ErrorCode::MissingFacts, "--bits, --cfa, --black, --white"),
    (ErrorCode::NoEdgeCapture, "camrig capture --plan paper shows what is needed"),
    (ErrorCode::NoIrradiance, "camrig simulate --save-irradiance FILE makes one"),
    (ErrorCode::NoLibrary, "camrig scene add --library DIR makes one"),
    (ErrorCode::NoPseudoTerminals, "--tcp HOST:PORT"),
    (ErrorCode::OutputExists, "--force"),
    (ErrorCode::PatchOutside, "--corners X1,Y1,...,X4,Y4"),
    (ErrorCode::PathUnsupported, "--path bands"),
    (ErrorCode::PsfMethod, "--psf auto, --psf geometric"),
    (ErrorCode::PsfWindow, "--psf-spacing, --sensor-shift"),
    (ErrorCode::RegionOutside, "--roi X,Y,WIDTH,HEIGHT, --region X,Y,WIDTH,HEIGHT"),
    (ErrorCode::RigArithmetic, "--arith"),
    (ErrorCode::RigNotFound, "camrig rig list shows what is connected"),
    (ErrorCode::RigRegister, "camrig rig register --help lists the registers"),
    (ErrorCode::RigUnreachable, "camrig rig serve --tcp HOST:PORT starts one"),
    (ErrorCode::RotationStacks, "camrig crosstalk bench makes such captures"),
    (ErrorCode::RowPadding, "--stride BYTES"),
    (ErrorCode::SaturatedCapture, "camrig scene hdr merges captures"),
    (ErrorCode::SeveralFrames, "--frame N"),
    (ErrorCode::StopRadius, "--stop-radius MM, in a camera file stop_radius_mm = MM"),
    (ErrorCode::UnknownGlass, "--glass NAME=ND:VD, in a camera file glass = \"NAME=ND:VD\""),
];

/// The error with what to type behind its help.
pub fn advised(error: Error) -> Error {
    let advice = ADVICE.iter().find(|(code, _)| error.code() == Some(*code));
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

    #[test]
    fn the_flag_stands_behind_the_help() {
        let error =
            Error::input("a.npy exists").help("replace it").with_code(ErrorCode::OutputExists);
        assert_eq!(advised(error).to_string(), "a.npy exists\n  help: replace it (--force)");
        let unmade =
            Error::input("no library").help("add a scene").with_code(ErrorCode::NoLibrary);
        let told = "no library\n  help: add a scene; camrig scene add --library DIR makes one";
        assert_eq!(advised(unmade).to_string(), told);
        let bare = Error::input("a.npy exists").with_code(ErrorCode::OutputExists);
        assert_eq!(advised(bare).to_string(), "a.npy exists\n  help: --force");
        assert_eq!(advised(Error::input("-3 lx")).to_string(), "-3 lx");
    }

    #[test]
    fn every_code_has_advice() {
        let advised: Vec<ErrorCode> = ADVICE.iter().map(|(code, _)| *code).collect();
        assert_eq!(advised, ErrorCode::ALL);
    }
}
