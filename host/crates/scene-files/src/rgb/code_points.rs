//! Colour spaces by their code points in ITU-T H.273, as PNG and ICC profiles state them.

use camrig_base::{Error, Result};
use camrig_light::colour::space::{DISPLAY_P3, REC2020, SRGB, Space};
use camrig_light::colour::transfer::Transfer;

/// The space of code points of ITU-T H.273.
pub fn code_points(primaries: u8, transfer: u8) -> Result<Space> {
    let unknown = || {
        Error::unsupported(format!(
            "colours of code points {primaries} (primaries) and {transfer} (transfer)"
        ))
        .help("say what they are by primaries= and transfer=, or convert the picture to sRGB")
    };
    let primaries = match primaries {
        1 => SRGB,
        9 => REC2020,
        12 => DISPLAY_P3,
        _ => return Err(unknown()),
    };
    let transfer = match transfer {
        1 | 6 | 14 | 15 => Transfer::Bt2020,
        4 => Transfer::Gamma(2.2),
        5 => Transfer::Gamma(2.8),
        8 => Transfer::Linear,
        13 => Transfer::Srgb,
        _ => return Err(unknown()),
    };
    Space::of("its chunk cICP", &primaries, transfer)
}
