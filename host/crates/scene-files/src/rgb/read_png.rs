//! PNG pictures.
//!
//! What says the colours, in the order of the standard (PNG third edition, 4.3): the chunks cICP,
//! iCCP, sRGB, then gAMA and cHRM.

use super::code_points::code_points;
use super::icc;
use super::picture::{Picture, Said, Samples, about_channels, check_size, check_square, three};
use camrig_base::{Error, Result};
use camrig_formats::exif::Exif;
use camrig_light::colour::space::{Chromaticities, SRGB, Space};
use camrig_light::colour::transfer::Transfer;
use png::{ColorType, Info, Transformations};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

pub fn read(path: &Path) -> Result<Picture> {
    let file = File::open(path).map_err(|e| Error::io("open", path, e))?;
    let failed = |e: png::DecodingError| Error::input(format!("not a readable PNG: {e}"));
    let mut decoder = png::Decoder::new(BufReader::new(file));
    // Palettes become colours, bits fewer than 8 become 8, transparent colours an alpha.
    decoder.set_transformations(Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(failed)?;
    let size = (reader.info().width as usize, reader.info().height as usize);
    check_size(path, size)?;
    check_samples(reader.info())?;
    check_palette(reader.info())?;
    let (kind, depth) = reader.output_color_type();
    let channels = match kind {
        ColorType::Grayscale => 1,
        ColorType::GrayscaleAlpha => 2,
        ColorType::Rgb | ColorType::Indexed => 3,
        ColorType::Rgba => 4,
    };
    let bytes = reader.output_buffer_size().ok_or_else(|| Error::limit("too large a picture"))?;
    let mut bytes = vec![0; bytes];
    reader.next_frame(&mut bytes).map_err(failed)?;
    let wide = depth == png::BitDepth::Sixteen;
    let samples = if wide {
        let pairs = bytes.chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]]));
        Samples::Codes { data: three(pairs.collect(), channels), most: u16::MAX }
    } else {
        let codes: Vec<u16> = bytes.iter().map(|&b| b.into()).collect();
        Samples::Codes { data: three(codes, channels), most: 255 }
    };
    let info = reader.info();
    let mut notes = Vec::new();
    about_channels(channels, &mut notes);
    if info.animation_control.is_some() {
        notes.push("an animation of which the first frame is taken".into());
    }
    let exif = info.exif_metadata.as_deref().map(Exif::read).unwrap_or_default();
    Ok(Picture {
        size,
        samples,
        said: said(info),
        orientation: exif.orientation,
        white_luminance: None,
        understood: vec![format!("PNG, {:?} of {} bits", info.color_type, info.bit_depth as u8)],
        notes,
    })
}

/// Refuses pixels that are not square, and samples whose range is that of video.
fn check_samples(info: &Info<'_>) -> Result<()> {
    if let Some(per_unit) = info.pixel_dims {
        check_square("pHYs", f64::from(per_unit.yppu) / f64::from(per_unit.xppu))?;
    }
    match info.coding_independent_code_points {
        Some(code) if !code.is_video_full_range_image => {
            Err(Error::unsupported("samples of a limited range (cICP)")
                .help("convert it to the full range, 0 for black and the largest for white"))
        }
        _ => Ok(()),
    }
}

/// Refuses a palette that is no list of colours, at which the decoder panics (png 0.18.1).
fn check_palette(info: &Info<'_>) -> Result<()> {
    match info.palette.as_ref().map_or(0, |palette| palette.len()) {
        bytes if bytes % 3 == 0 && bytes <= 3 * 256 => Ok(()),
        bytes => Err(Error::input(format!("a palette (PLTE) of {bytes} bytes"))
            .help("it has 3 bytes for each of at most 256 colours: the file is damaged")),
    }
}

/// Refuses a band of a cube that is not as it is stored, and says what its file calls its colours
/// where that is not linear.
pub fn check_band(info: &Info<'_>) -> Result<Option<String>> {
    check_samples(info)?;
    let exif = info.exif_metadata.as_deref().map(Exif::read).unwrap_or_default();
    if exif.orientation != 1 {
        return Err(Error::unsupported("a band that its EXIF turns (Orientation)")
            .help("save it upright, without EXIF"));
    }
    let linear = |transfer: &Transfer| match transfer {
        Transfer::Linear => true,
        Transfer::Gamma(power) => (power - 1.0).abs() < 1e-3,
        _ => false,
    };
    Ok(match said(info) {
        Said::Nothing => None,
        Said::Space(space) => (!space.transfer.iter().all(linear)).then_some(space.name),
        Said::Unknown(what) => Some(what),
        Said::Refused(error) => Some(error.what().into()),
    })
}

fn said(info: &Info<'_>) -> Said {
    if let Some(code) = &info.coding_independent_code_points {
        return match code_points(code.color_primaries, code.transfer_function) {
            Ok(space) => Said::Space(space),
            Err(error) => Said::Refused(error),
        };
    }
    if let Some(profile) = &info.icc_profile {
        return icc::said(profile);
    }
    if info.srgb.is_some() {
        return Said::Space(Space {
            name: "sRGB, as its chunk sRGB says".into(),
            ..Space::srgb()
        });
    }
    let transfer = info.gama_chunk.map(|g| Transfer::Gamma(1.0 / f64::from(g.into_value())));
    let primaries: Option<Chromaticities> = info.chrm_chunk.map(|c| {
        [c.red, c.green, c.blue, c.white].map(|(x, y)| [x, y].map(|v| f64::from(v.into_value())))
    });
    let (name, primaries, transfer) = match (primaries, transfer) {
        (None, None) => return Said::Nothing,
        (Some(p), Some(t)) => ("its chunks cHRM and gAMA", p, t),
        (Some(p), None) => ("its chunk cHRM, with the curve of sRGB", p, Transfer::Srgb),
        (None, Some(t)) => ("the primaries of sRGB with its chunk gAMA", SRGB, t),
    };
    if transfer == Transfer::Gamma(f64::INFINITY) {
        return Said::Unknown("a chunk gAMA of 0".into());
    }
    Space::of(name, &primaries, transfer).map_or_else(Said::Refused, Said::Space)
}
