//! Radiance pictures (`.hdr`): colours with a common exponent.
//!
//! Lines of the header that are read: FORMAT (RGBE or XYZE), EXPOSURE and COLORCORR (divided by,
//! as the format demands), PRIMARIES, PIXASPECT; only in the first column. Without PRIMARIES they
//! are taken as those of sRGB, which almost all programs write.

use super::picture::{Picture, Said, Samples, check_size, check_square};
use camrig_base::{Error, Result};
use camrig_light::colour::space::Space;
use image::ImageDecoder;
use image::codecs::hdr::{HdrDecoder, HdrMetadata};
use std::path::Path;

/// First bytes of the format.
const MAGIC: &[u8] = b"#?";
/// The lines that name the coding of samples, of the same length.
const XYZE: &[u8] = b"FORMAT=32-bit_rle_xyze";
const RGBE: &[u8] = b"FORMAT=32-bit_rle_rgbe";
/// Axes of a line of resolution, and those of rows from the top and columns from the left.
const AXES: [&str; 4] = ["-Y", "+Y", "-X", "+X"];
const UPRIGHT: [&str; 2] = ["-Y", "+X"];

/// Whether a file is a Radiance picture; ENVI's headers have the same ending.
pub fn is_picture(path: &Path) -> bool {
    crate::starts_with(path, MAGIC)
}

pub fn read(path: &Path) -> Result<Picture> {
    let mut bytes = std::fs::read(path).map_err(|e| Error::io("read", path, e))?;
    let failed = |e| Error::input(format!("not a readable Radiance picture: {e}"));
    let xyz = for_the_decoder(&mut bytes)?;
    let decoder = HdrDecoder::new_nonstrict(&bytes[..]).map_err(failed)?;
    let about = decoder.metadata();
    let size = (about.width as usize, about.height as usize);
    check_size(path, size)?;
    check_square("PIXASPECT", about.pixel_aspect_ratio.unwrap_or(1.0).into())?;
    let divisor = divisor(&about)?;
    let mut samples = vec![0; 12 * size.0 * size.1];
    decoder.read_image(&mut samples).map_err(failed)?;
    let values = samples.chunks_exact(4).map(|b| f32::from_ne_bytes([b[0], b[1], b[2], b[3]]));
    let data = values.enumerate().map(|(i, v)| v / divisor[i % 3]).collect();
    let mut understood = vec!["Radiance picture".to_string()];
    if divisor != [1.0; 3] {
        understood.push(format!("divided by its EXPOSURE and COLORCORR, {divisor:?}"));
    }
    // A hint of some programs for those that show the picture.
    let gamma = about.custom_attributes.iter().filter(|(key, _)| key.trim() == "GAMMA");
    let notes = gamma
        .filter(|(_, value)| value.trim().parse() != Ok(1.0))
        .map(|(_, value)| {
            format!("its line GAMMA={value} is not used: samples are linear, as the format says")
        })
        .collect();
    Ok(Picture {
        size,
        samples: Samples::Floats(data),
        said: if xyz { Said::Space(Space::xyz()) } else { said(&about)? },
        orientation: 1,
        white_luminance: None,
        understood,
        notes,
    })
}

/// Makes of the header one that the decoder takes, and says whether the samples are X, Y and Z:
/// their coding is that of red, green and blue. Lines that do not begin in the first column are
/// those of other pictures, which Radiance's programs repeat; they become remarks.
fn for_the_decoder(bytes: &mut [u8]) -> Result<bool> {
    let (mut xyz, mut at) = (false, 0);
    while let Some(length) = bytes[at..].iter().position(|byte| *byte == b'\n') {
        let line = &mut bytes[at..at + length];
        at += length + 1;
        if line.is_empty() {
            break;
        } else if line.starts_with(XYZE) {
            line[..XYZE.len()].copy_from_slice(RGBE);
            xyz = true;
        } else if matches!(line[0], b' ' | b'\t') {
            line[0] = b'#';
        }
    }
    let line = bytes[at..].split(|byte| *byte == b'\n').next().unwrap_or_default();
    let line = String::from_utf8_lossy(line);
    let axes: Vec<&str> = line.split_whitespace().step_by(2).collect();
    if axes.len() == 2 && axes != UPRIGHT && axes.iter().all(|axis| AXES.contains(axis)) {
        return Err(Error::unsupported("a Radiance picture that does not begin at the top left")
            .at(line)
            .help("turn it first, to a resolution line of -Y HEIGHT +X WIDTH"));
    }
    Ok(xyz)
}

/// What to divide by: all lines of EXPOSURE and COLORCORR multiply.
fn divisor(about: &HdrMetadata) -> Result<[f32; 3]> {
    let mut divisor = [1.0f32; 3];
    for (key, value) in &about.custom_attributes {
        let numbers: Vec<f32> = value.split_whitespace().map_while(|n| n.parse().ok()).collect();
        let factors = match (key.as_str(), &numbers[..]) {
            ("EXPOSURE", [all]) => [*all; 3],
            ("COLORCORR", [r, g, b]) => [*r, *g, *b],
            ("EXPOSURE" | "COLORCORR", _) => [f32::NAN; 3],
            _ => continue,
        };
        if !factors.iter().all(|f| *f > 0.0 && f.is_finite()) {
            return Err(Error::input(format!("a line {key}={value}")).help("numbers above 0"));
        }
        divisor.iter_mut().zip(factors).for_each(|(d, f)| *d *= f);
    }
    Ok(divisor)
}

fn said(about: &HdrMetadata) -> Result<Said> {
    let line = |key: &str| {
        let mut lines = about.custom_attributes.iter().rev();
        lines.find(|(k, _)| k.trim() == key).map(|(_, value)| value.trim().to_string())
    };
    let Some(line) = line("PRIMARIES") else { return Ok(Said::Nothing) };
    let numbers: Vec<f64> = line.split_whitespace().filter_map(|n| n.parse().ok()).collect();
    let [rx, ry, gx, gy, bx, by, x, y] = numbers[..] else {
        return Err(Error::input(format!("PRIMARIES of {line:?}")).help("they are eight numbers"));
    };
    let primaries = [[rx, ry], [gx, gy], [bx, by], [x, y]];
    Ok(Said::of_linear("its line PRIMARIES", &primaries))
}
