//! JPEG pictures, of 8 bits.
//!
//! Decoded by the portable code of the decoder, so that all machines have the same samples. What
//! says the colours: an ICC profile, else the colour space of EXIF.

use super::icc;
use super::picture::{Picture, Said, Samples, check_size, check_square, three};
use camrig_base::{Error, Result};
use camrig_formats::exif::{Colours, Exif};
use camrig_light::colour::space::{ADOBE_GAMMA, ADOBE_RGB, Space};
use camrig_light::colour::transfer::Transfer;
use std::path::Path;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Largest side of a JPEG, by its format.
const LARGEST: usize = 65_535;

pub fn read(path: &Path) -> Result<Picture> {
    let bytes = std::fs::read(path).map_err(|e| Error::io("read", path, e))?;
    let failed = |e: zune_jpeg::errors::DecodeErrors| {
        Error::input(format!("not a readable JPEG: {e}"))
            .help("the file is cut off or damaged, or of a rare kind; save it anew, or as PNG")
    };
    let options = DecoderOptions::default()
        .set_use_unsafe(false)
        .set_strict_mode(true)
        .set_max_width(LARGEST)
        .set_max_height(LARGEST);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(&bytes[..]), options);
    decoder.decode_headers().map_err(failed)?;
    let info = decoder.info().ok_or_else(|| Error::input("a JPEG without a frame"))?;
    let size = (usize::from(info.width), usize::from(info.height));
    check_size(path, size)?;
    check_square("JFIF", aspect(&bytes))?;
    let (colours, channels) = match decoder.input_colorspace() {
        Some(ColorSpace::Luma) => (ColorSpace::Luma, 1),
        Some(ColorSpace::YCbCr | ColorSpace::RGB) => (ColorSpace::RGB, 3),
        other => {
            return Err(Error::unsupported(format!("a JPEG of {other:?}"))
                .help("a picture for print, of four inks: convert it to sRGB"));
        }
    };
    decoder.set_options(options.jpeg_set_out_colorspace(colours));
    let data: Vec<u16> = decoder.decode().map_err(failed)?.into_iter().map(u16::from).collect();
    if data.len() != size.0 * size.1 * channels {
        return Err(Error::input(format!("{} samples of {size:?} pixels", data.len())));
    }
    let exif = decoder.exif().map(|bytes| Exif::read(bytes)).unwrap_or_default();
    let said = match decoder.icc_profile() {
        Some(profile) => icc::said(&profile),
        None => of_exif(exif.colours)?,
    };
    Ok(Picture {
        size,
        samples: Samples::Codes { data: three(data, channels), most: 255 },
        said,
        orientation: exif.orientation,
        white_luminance: None,
        understood: vec![format!("JPEG of {}", if channels == 1 { "grey" } else { "colours" })],
        notes: Vec::new(),
    })
}

/// Width over height of a pixel by the header of JFIF 1.02, with which a file begins that has one.
fn aspect(bytes: &[u8]) -> f64 {
    match bytes {
        [0xff, 0xd8, 0xff, 0xe0, _, _, b'J', b'F', b'I', b'F', 0, _, _, _, x1, x0, y1, y0, ..] => {
            let [across, down] = [[*x1, *x0], [*y1, *y0]].map(u16::from_be_bytes);
            f64::from(down) / f64::from(across)
        }
        _ => 1.0,
    }
}

fn of_exif(colours: Colours) -> Result<Said> {
    Ok(match colours {
        Colours::Nothing => Said::Nothing,
        Colours::Srgb => {
            Said::Space(Space { name: "sRGB, as its EXIF says".into(), ..Space::srgb() })
        }
        Colours::AdobeRgb => Said::Space(Space::of(
            "Adobe RGB, as its EXIF says",
            &ADOBE_RGB,
            Transfer::Gamma(ADOBE_GAMMA),
        )?),
        Colours::Uncalibrated => Said::Unknown("EXIF of an uncalibrated colour space".into()),
    })
}
