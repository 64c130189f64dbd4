//! Names of pixel formats.
//!
//! Sources: Linux `include/uapi/linux/videodev2.h` (names and four-character codes), libcamera
//! `src/libcamera/formats.yaml`, GenICam PFNC 2.4, FFmpeg `libavutil/pixdesc.c`.

use super::{Layout, PixelFormat};
use camrig_base::Cfa;

/// The patterns that names know.
pub(super) const BAYER: [&str; 4] = ["RGGB", "GRBG", "GBRG", "BGGR"];
/// GenICam's names of them, by the first two pixels.
const GENICAM: [&str; 4] = ["BayerRG", "BayerGR", "BayerGB", "BayerBG"];

/// Four-character codes of V4L2 that are not words of a name: code, pattern (`Y` without colour
/// filters), bits, layout. Codes that are only the letters of a pattern (`RGGB` for 8 bits) are
/// left out: in a file's name they stand for the pattern.
const CODES: [(&str, &str, u32, Layout); 37] = [
    ("BA81", "BGGR", 8, Layout::Words),
    ("BG10", "BGGR", 10, Layout::Words),
    ("GB10", "GBRG", 10, Layout::Words),
    ("BA10", "GRBG", 10, Layout::Words),
    ("RG10", "RGGB", 10, Layout::Words),
    ("pBAA", "BGGR", 10, Layout::Mipi),
    ("pGAA", "GBRG", 10, Layout::Mipi),
    ("pgAA", "GRBG", 10, Layout::Mipi),
    ("pRAA", "RGGB", 10, Layout::Mipi),
    ("BG12", "BGGR", 12, Layout::Words),
    ("GB12", "GBRG", 12, Layout::Words),
    ("BA12", "GRBG", 12, Layout::Words),
    ("RG12", "RGGB", 12, Layout::Words),
    ("pBCC", "BGGR", 12, Layout::Mipi),
    ("pGCC", "GBRG", 12, Layout::Mipi),
    ("pgCC", "GRBG", 12, Layout::Mipi),
    ("pRCC", "RGGB", 12, Layout::Mipi),
    ("BG14", "BGGR", 14, Layout::Words),
    ("GB14", "GBRG", 14, Layout::Words),
    ("GR14", "GRBG", 14, Layout::Words),
    ("RG14", "RGGB", 14, Layout::Words),
    ("pBEE", "BGGR", 14, Layout::Mipi),
    ("pGEE", "GBRG", 14, Layout::Mipi),
    ("pgEE", "GRBG", 14, Layout::Mipi),
    ("pREE", "RGGB", 14, Layout::Mipi),
    ("BYR2", "BGGR", 16, Layout::Words),
    ("GB16", "GBRG", 16, Layout::Words),
    ("GR16", "GRBG", 16, Layout::Words),
    ("RG16", "RGGB", 16, Layout::Words),
    ("PC1R", "RGGB", 16, Layout::Pisp),
    ("PC1G", "GRBG", 16, Layout::Pisp),
    ("PC1g", "GBRG", 16, Layout::Pisp),
    ("PC1B", "BGGR", 16, Layout::Pisp),
    ("PC1M", "Y", 16, Layout::Pisp),
    ("GREY", "Y", 8, Layout::Words),
    ("GRAY", "Y", 8, Layout::Words),
    ("GRAY8", "Y", 8, Layout::Words),
];

/// The pixel format of a name.
pub(super) fn find(name: &str) -> Option<PixelFormat> {
    if let Some(&(_, pattern, bits, layout)) = CODES.iter().find(|(code, ..)| *code == name) {
        return format(pattern, bits, layout);
    }
    let upper = name.to_ascii_uppercase();
    if let Some(pattern) = upper.strip_suffix("_PISP_COMP1") {
        let pattern = if pattern == "MONO" { "Y" } else { pattern };
        return format(pattern, 16, Layout::Pisp);
    }
    genicam(&upper).or_else(|| ffmpeg(&upper)).or_else(|| linux(&upper))
}

/// V4L2's four-character code of a pixel format, padded with spaces.
pub(super) fn code(pixels: &PixelFormat) -> Option<[u8; 4]> {
    let name = pixels.cfa.to_string();
    let pattern = if pixels.cfa.is_mono() { "Y" } else { &name };
    let is = |(_, of, bits, layout): &&(&str, &str, u32, Layout)| {
        (*of, *bits, *layout) == (pattern, pixels.bits, pixels.layout)
    };
    let code = match (pattern, pixels.bits, pixels.layout) {
        ("RGGB" | "GRBG" | "GBRG", 8, Layout::Words) => pattern.to_string(),
        ("Y", bits @ (10 | 12 | 14 | 16), Layout::Words) => format!("Y{bits} "),
        ("Y", bits @ (10 | 12 | 14), Layout::Mipi) => format!("Y{bits}P"),
        _ => CODES.iter().find(is)?.0.to_string(),
    };
    code.into_bytes().try_into().ok()
}

/// `S` and a pattern, or `Y` or `R` (libcamera), bits, and the layout.
fn linux(upper: &str) -> Option<PixelFormat> {
    let upper = if upper == "GREY" { "Y8" } else { upper };
    let (body, layout) = match upper {
        u if u.ends_with("_CSI2P") => (u.strip_suffix("_CSI2P")?, Layout::Mipi),
        u if u.ends_with("_BE") || u.ends_with("-BE") => (&u[..u.len() - 3], Layout::WordsBig),
        u => u.strip_suffix('P').map_or((u, Layout::Words), |body| (body, Layout::Mipi)),
    };
    let digits = body.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    let bits = body[digits..].parse().ok()?;
    let pattern = match &body[..digits] {
        "Y" | "R" => "Y",
        other => other.strip_prefix('S')?,
    };
    format(pattern, bits, layout)
}

/// `Mono12`, `BayerRG10p`, `BayerGB12Packed`.
fn genicam(upper: &str) -> Option<PixelFormat> {
    let prefixes = GENICAM.iter().zip(BAYER).map(|(g, b)| (*g, b)).chain([("Mono", "Y")]);
    let (rest, pattern) = prefixes.into_iter().find_map(|(prefix, pattern)| {
        upper.strip_prefix(&prefix.to_ascii_uppercase()).map(|rest| (rest, pattern))
    })?;
    let digits = rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len());
    let layout = match &rest[digits..] {
        "" => Layout::Words,
        "P" => Layout::LowestFirst,
        "PACKED" => Layout::GigE,
        _ => return None,
    };
    format(pattern, rest[..digits].parse().ok()?, layout)
}

/// `bayer_rggb16le`, `gray12be`.
fn ffmpeg(upper: &str) -> Option<PixelFormat> {
    let (body, layout) = match upper {
        u if u.ends_with("LE") => (&u[..u.len() - 2], Layout::Words),
        u if u.ends_with("BE") && !u.ends_with("_BE") => (&u[..u.len() - 2], Layout::WordsBig),
        u => (u, Layout::Words),
    };
    let digits = body.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    let bits: u32 = body[digits..].parse().ok()?;
    // Words of more than 8 bits name their byte order.
    if (bits > 8) == (body == upper) {
        return None;
    }
    match &body[..digits] {
        "GRAY" => format("Y", bits, layout),
        other => format(other.strip_prefix("BAYER_")?, bits, layout),
    }
}

fn format(pattern: &str, bits: u32, layout: Layout) -> Option<PixelFormat> {
    let pattern = match pattern {
        "Y" => "mono",
        bayer => BAYER.into_iter().find(|name| *name == bayer)?,
    };
    layout.has(bits).then_some(PixelFormat { cfa: Cfa::parse(pattern).ok()?, bits, layout })
}

/// Whether a word behind a pixel format names a layout that is not read: compressed ones, and
/// those of one maker's hardware.
pub(super) fn is_other_layout(word: &str) -> bool {
    let upper = word.to_ascii_uppercase();
    ["IPU3", "PISP", "CSI2", "DPCM", "ALAW"].iter().any(|other| upper.starts_with(other))
}

/// A name that [`find`] understands: V4L2's where it has one.
pub(super) fn name(format: &PixelFormat) -> String {
    let PixelFormat { cfa, bits, layout } = format;
    let index = BAYER.iter().position(|name| cfa.to_string() == *name);
    let linux = if index.is_some() { format!("S{cfa}{bits}") } else { format!("Y{bits}") };
    let genicam = index.map_or("Mono", |i| GENICAM[i]);
    match layout {
        Layout::Pisp if index.is_none() => "MONO_PISP_COMP1".into(),
        Layout::Pisp => format!("{cfa}_PISP_COMP1"),
        Layout::Words => linux,
        Layout::WordsBig => format!("{linux}_BE"),
        Layout::Mipi => format!("{linux}P"),
        Layout::LowestFirst => format!("{genicam}{bits}p"),
        Layout::GigE => format!("{genicam}{bits}Packed"),
    }
}
