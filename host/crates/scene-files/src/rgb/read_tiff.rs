//! TIFF pictures of one page: grey or red, green and blue, of 8 to 64 bits or real numbers.

use super::icc;
use super::picture::{Picture, Said, Samples, about_channels, check_size, check_square, three};
use crate::images::decoder;
use crate::tiff_tags::{check_pages, image_j, unreadable};
use camrig_base::{Error, Result};
use camrig_light::colour::space::{Chromaticities, Space};
use camrig_light::colour::transfer::Transfer;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use tiff::ColorType;
use tiff::decoder::ifd::Value;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;

/// Whether a TIFF is a picture: of colours, or of a single grey page.
pub fn is_picture(path: &Path) -> Result<bool> {
    let mut decoder = decoder(path, 0)?;
    let kind = decoder.colortype().map_err(|e| unreadable(path, e))?;
    Ok(match kind {
        ColorType::Multiband { .. } => false,
        ColorType::Gray(_) => !decoder.more_images(),
        _ => true,
    })
}

pub fn read(path: &Path) -> Result<Picture> {
    let failed = |e| unreadable(path, e);
    let (width, height) = decoder(path, 0)?.dimensions().map_err(failed)?;
    let size = (width as usize, height as usize);
    check_size(path, size)?;
    // Four samples in a pixel at most.
    let mut decoder = decoder(path, 4 * size.0 * size.1)?;
    let kind = decoder.colortype().map_err(failed)?;
    let channels = match kind {
        ColorType::Gray(8..) => 1,
        ColorType::GrayA(8..) => 2,
        ColorType::RGB(8..) => 3,
        ColorType::RGBA(8..) => 4,
        _ => {
            return Err(Error::unsupported(format!("a TIFF of {kind:?}"))
                .help("save it as grey or as red, green and blue of 8 bits or more"));
        }
    };
    let mut tag = |tag| decoder.find_tag_unsigned::<u16>(tag).map_err(failed);
    if tag(Tag::PhotometricInterpretation)? == Some(0) {
        return Err(Error::unsupported("a TIFF in which 0 is white")
            .help("save it with 0 as black (PhotometricInterpretation 1)"));
    }
    if tag(Tag::PlanarConfiguration)?.is_some_and(|p| p != 1) && channels > 1 {
        return Err(Error::unsupported("a TIFF with a plane per colour")
            .help("save it with the colours of a pixel together (PlanarConfiguration 1)"));
    }
    let orientation = tag(Tag::Orientation)?.filter(|n| (1..=8).contains(n)).unwrap_or(1) as u8;
    let mut notes = Vec::new();
    about_channels(channels, &mut notes);
    let all = tag(Tag::SamplesPerPixel)?.map_or(channels, usize::from);
    if all > channels {
        notes.push(format!("of the {all} samples of a pixel the first {channels} are taken"));
    }
    if image_j(&mut decoder)?.is_some() {
        notes.push("ImageJ's calibration is not used: samples are taken as stored".into());
    }
    if !decoder.more_images() {
        check_pages(&mut decoder, channels * size.0 * size.1, 1)?;
    } else {
        notes.push("of several pages the first is taken".into());
    }
    let mut resolution = |tag| numbers(&mut decoder, tag);
    if let ([x], [y]) = (&resolution(Tag::XResolution)[..], &resolution(Tag::YResolution)[..]) {
        check_square("XResolution, YResolution", y / x)?;
    }
    let said = said(&mut decoder);
    let samples = samples(decoder.read_image().map_err(failed)?, channels)?;
    let found = match &samples {
        Samples::Codes { data, .. } => data.len(),
        Samples::Floats(data) => data.len(),
    };
    if found != 3 * size.0 * size.1 {
        return Err(Error::input(format!("{found} samples of {width} x {height} pixels")));
    }
    let understood = vec![format!("TIFF of {kind:?}")];
    Ok(Picture { size, samples, said, orientation, white_luminance: None, understood, notes })
}

fn samples(data: DecodingResult, channels: usize) -> Result<Samples> {
    let floats = |data: Vec<f32>| Samples::Floats(three(data, channels));
    let codes = |data: Vec<u16>, most| Samples::Codes { data: three(data, channels), most };
    Ok(match data {
        DecodingResult::U8(data) => codes(data.into_iter().map(u16::from).collect(), 255),
        DecodingResult::U16(data) => codes(data, u16::MAX),
        // More than the 16 bits that are kept, no sensor and no spectrum can tell apart.
        DecodingResult::U32(data) => {
            codes(data.into_iter().map(|v| (v >> 16) as u16).collect(), u16::MAX)
        }
        DecodingResult::F16(data) => floats(data.into_iter().map(|v| v.to_f32()).collect()),
        DecodingResult::F32(data) => floats(data),
        DecodingResult::F64(data) => floats(data.into_iter().map(|v| v as f32).collect()),
        _ => {
            return Err(Error::unsupported("a TIFF of signed or 64-bit numbers")
                .help("save it with 8, 16 or 32 bits without sign, or with real numbers"));
        }
    })
}

/// The numbers of a tag, which are rational by the standard; none where it is not there.
fn numbers(decoder: &mut Decoder<BufReader<File>>, tag: Tag) -> Vec<f64> {
    let number = |value: &Value| match *value {
        Value::Rational(n, d) => Some(f64::from(n) / f64::from(d)),
        Value::Float(v) => Some(v.into()),
        Value::Double(v) => Some(v),
        _ => None,
    };
    match decoder.get_tag(tag) {
        Ok(Value::List(all)) => all.iter().filter_map(number).collect(),
        one => one.iter().filter_map(number).collect(),
    }
}

/// An ICC profile, else the tags of TIFF 6.0, section 20.
fn said(decoder: &mut Decoder<BufReader<File>>) -> Said {
    if let Ok(profile) = decoder.get_tag_u8_vec(Tag::IccProfile) {
        return icc::said(&profile);
    }
    let mut list = |number| numbers(decoder, Tag::Unknown(number));
    let (white, primaries) = (list(318), list(319));
    let ([x, y], [rx, ry, gx, gy, bx, by]) = (&white[..], &primaries[..]) else {
        return Said::Nothing;
    };
    let primaries: Chromaticities = [[*rx, *ry], [*gx, *gy], [*bx, *by], [*x, *y]];
    let name = "its tags of primaries and white, with the curve of sRGB";
    Space::of(name, &primaries, Transfer::Srgb).map_or_else(Said::Refused, Said::Space)
}
