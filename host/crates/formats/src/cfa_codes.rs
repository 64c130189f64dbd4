//! Colours of a filter pattern in DNG's numbering (CFAPlaneColor).

use camrig_base::Cfa;

/// CFA colour codes of TIFF/EP and DNG.
const COLOR_CODES: [char; 7] = ['R', 'G', 'B', 'C', 'M', 'Y', 'W'];

/// The CFA colour code of white: a pixel without a filter (DNG 1.4, CFAPlaneColor).
const WHITE: u8 = 6;

/// The CFA colour code of a letter of a pattern. `C` is cyan together with magenta or yellow, and
/// clear in the patterns of cars (RCCC, RCCB, RCCG). A letter without a code of its own is written
/// as white, the least misleading of them.
pub(super) fn color_code(cfa: &Cfa, letter: char) -> u8 {
    let complementary = cfa.letters.iter().any(|l| matches!(l, 'M' | 'Y'));
    if letter == 'C' && !complementary {
        return WHITE;
    }
    COLOR_CODES.iter().position(|&c| c == letter).map_or(WHITE, |code| code as u8)
}

/// The letter of a CFA colour code.
pub(super) fn color_letter(code: u8) -> Option<char> {
    COLOR_CODES.get(usize::from(code)).copied()
}
