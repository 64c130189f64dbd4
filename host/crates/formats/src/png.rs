//! PNG: grey of 16 bits for raw DN (of 8 bits for up to 8 bits), and 8-bit RGB for pictures.

use super::{Facts, Frames, area, check_range};
use ::png as codec;
use camrig_base::{Error, Plane, Result};
use std::io::Cursor;

/// Keyword of the text chunk that carries the facts.
const KEYWORD: &str = "Description";

/// The first frame as a grey PNG of 8 or 16 bits.
///
/// # Errors
/// Samples beyond the bits, sides that PNG cannot express.
pub fn encode(frames: &Frames) -> Result<Vec<u8>> {
    let plane = &frames.planes[0];
    let bits = frames.facts.bits.unwrap_or(16);
    check_range(&plane.data, bits)?;
    let (depth, data) = if bits <= 8 {
        (codec::BitDepth::Eight, plane.data.iter().map(|&dn| dn as u8).collect::<Vec<u8>>())
    } else {
        let bytes = plane.data.iter().flat_map(|dn| dn.to_be_bytes());
        (codec::BitDepth::Sixteen, bytes.collect())
    };
    let note = frames.facts.note();
    write(plane.width, plane.height, codec::ColorType::Grayscale, depth, Some(note), &data)
}

/// A picture of 8-bit sRGB triples as a PNG.
///
/// # Errors
/// Sides that PNG cannot express.
pub fn encode_rgb(picture: &Plane<[u8; 3]>) -> Result<Vec<u8>> {
    let data = picture.data.as_flattened();
    let (width, height) = (picture.width, picture.height);
    write(width, height, codec::ColorType::Rgb, codec::BitDepth::Eight, None, data)
}

fn write(
    width: usize,
    height: usize,
    color: codec::ColorType,
    depth: codec::BitDepth,
    note: Option<String>,
    data: &[u8],
) -> Result<Vec<u8>> {
    let failed = |e: codec::EncodingError| Error::input(format!("PNG: {e}"));
    let side = |n: usize| {
        u32::try_from(n).map_err(|_| Error::limit(format!("PNG: a side of {n} pixels")))
    };
    let mut bytes = Vec::new();
    let mut encoder = codec::Encoder::new(&mut bytes, side(width)?, side(height)?);
    encoder.set_color(color);
    encoder.set_depth(depth);
    if color == codec::ColorType::Rgb {
        encoder.set_source_srgb(codec::SrgbRenderingIntent::Perceptual);
    }
    if let Some(note) = note {
        encoder.add_text_chunk(KEYWORD.into(), note).map_err(failed)?;
    }
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(data).map_err(failed)?;
    writer.finish().map_err(failed)?;
    Ok(bytes)
}

/// Reads a grey PNG of 8 or 16 bits.
///
/// # Errors
/// Other colour types, interlacing, a damaged or truncated file.
pub fn decode(bytes: &[u8]) -> Result<Frames> {
    let failed = |e: codec::DecodingError| Error::input(format!("PNG: {e}"));
    let mut reader = codec::Decoder::new(Cursor::new(bytes)).read_info().map_err(failed)?;
    let info = reader.info();
    let grey = info.color_type == codec::ColorType::Grayscale && info.bit_depth as u8 >= 8;
    if !grey || info.interlaced {
        return Err(Error::unsupported(format!(
            "a PNG of type {:?}, {} bits{}",
            info.color_type,
            info.bit_depth as u8,
            if info.interlaced { ", interlaced" } else { "" }
        ))
        .help("raw frames are grey, 8 or 16 bits, not interlaced"));
    }
    let (width, height) = (info.width as usize, info.height as usize);
    let depth = info.bit_depth as u32;
    let significant = info.sbit.as_ref().and_then(|bits| bits.first()).map(|&b| u32::from(b));
    let mut facts = Facts { bits: Some(depth), ..Facts::default() };
    for chunk in &info.uncompressed_latin1_text {
        if chunk.keyword == KEYWORD {
            facts.merge_note(&chunk.text);
        }
    }
    area(width, height)?;
    // The buffer grows with the rows present: a forged size costs no memory.
    let mut data = Vec::new();
    while let Some(row) = reader.next_row().map_err(failed)? {
        match depth {
            8 => data.extend(row.data().iter().map(|&b| u16::from(b))),
            _ => data.extend(row.data().chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]]))),
        }
    }
    if data.len() != width * height {
        return Err(Error::input(format!("PNG: {} of {} pixels", data.len(), width * height))
            .help("the file is truncated"));
    }
    // Camrig's own note says the bits better.
    if let Some(bits) = significant.filter(|bits| *bits < depth && !facts.taken.noted) {
        facts.notes.push(significance(bits, depth, &data));
    }
    Ok(Frames { planes: vec![Plane { width, height, data }], facts })
}

/// What `sBIT` says: the samples of fewer bits are to be scaled to the file's (PNG 1.2, section
/// 4.2.6). They are taken as stored, as those of every format are.
fn significance(bits: u32, depth: u32, data: &[u16]) -> String {
    let step = 1u16 << (depth - bits);
    let how = if data.iter().all(|dn| dn.is_multiple_of(step)) {
        format!(": all are multiples of {step} DN (left-aligned)")
    } else if data.iter().all(|dn| dn >> bits == 0) {
        format!(": none is above what {bits} bits hold")
    } else {
        String::new()
    };
    format!(
        "the file says that {bits} of its {depth} bits are significant (sBIT); its samples are \
         taken as stored, as {depth} bits{how}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grey PNG of 16 bits, of which as many are significant as `sBIT` says.
    fn notes(significant: u8, samples: &[u16], note: Option<&str>) -> Vec<String> {
        let data: Vec<u8> = samples.iter().flat_map(|dn| dn.to_be_bytes()).collect();
        let (color, depth) = (codec::ColorType::Grayscale, codec::BitDepth::Sixteen);
        let note = note.map(str::to_string);
        let mut bytes = write(samples.len(), 1, color, depth, note, &data).unwrap();
        // The chunk behind the header, which the encoder does not write: length, name, value, CRC.
        let chunk = [b's', b'B', b'I', b'T', significant];
        let sum = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&chunk);
        bytes.splice(33..33, [&[0, 0, 0, 1], &chunk[..], &sum.to_be_bytes()].concat());
        let frames = decode(&bytes).unwrap();
        assert_eq!(frames.planes[0].data, samples);
        frames.facts.notes
    }

    #[test]
    fn significant_bits_fewer_than_the_samples_are_told() {
        let of = |significant, samples: &[u16]| notes(significant, samples, None).join("; ");
        assert!(of(12, &[0x10, 0xFFF0]).contains("12 of its 16 bits"));
        assert!(of(12, &[0x10, 0xFFF0]).contains("multiples of 16 DN (left-aligned)"));
        assert!(of(12, &[0x11, 0xFFF]).contains("none is above what 12 bits hold"));
        assert!(of(12, &[0x11, 0xFFFF]).ends_with("as stored, as 16 bits"));
        assert_eq!(of(16, &[0x10, 0xFFF0]), "");
        assert!(notes(12, &[0x11, 0xFFF], Some("camrig bits=12")).is_empty());
    }
}
