//! Grey TIFF: 16-bit words, uncompressed, one page per frame.
//!
//! The reader takes grey pages of 8 or 16 bits, classic or BigTIFF, uncompressed or with one of
//! the compressions of the `tiff` crate (LZW, Deflate, PackBits).

use super::{Facts, Frames, check_range};
use camrig_base::{Error, Plane, Result};
use std::io::{Cursor, ErrorKind};
use tiff::decoder::{Decoder, DecodingResult};
use tiff::encoder::{TiffEncoder, TiffKind, TiffKindBig, TiffKindStandard, colortype::Gray16};
use tiff::tags::Tag;

/// Bytes reserved per page for its directory when choosing between TIFF and BigTIFF: twice what a
/// directory of a dozen tags and the note take.
const DIRECTORY: usize = 1024;

/// Frames as TIFF bytes; BigTIFF where 4 GiB are not enough.
///
/// # Errors
/// Samples beyond the bits.
pub fn encode(frames: &Frames) -> Result<Vec<u8>> {
    if let Some(bits) = frames.facts.bits {
        frames.planes.iter().try_for_each(|p| check_range(&p.data, bits))?;
    }
    let pixels: usize = frames.planes.iter().map(|p| p.data.len()).sum();
    let big = pixels * 2 + frames.planes.len() * DIRECTORY >= u32::MAX as usize;
    let written =
        if big { write::<TiffKindBig>(frames) } else { write::<TiffKindStandard>(frames) };
    written.map_err(|e| Error::input(format!("TIFF: {e}")))
}

fn write<K: TiffKind>(frames: &Frames) -> std::result::Result<Vec<u8>, tiff::TiffError> {
    let mut bytes = Cursor::new(Vec::new());
    let mut file = TiffEncoder::<_, K>::new_generic(&mut bytes)?;
    let note = frames.facts.note();
    for plane in &frames.planes {
        let (width, height) = (plane.width.try_into()?, plane.height.try_into()?);
        let mut page = file.new_image::<Gray16>(width, height)?;
        page.encoder().write_tag(Tag::ImageDescription, note.as_str())?;
        page.write_data(&plane.data)?;
    }
    Ok(bytes.into_inner())
}

/// Reads TIFF bytes.
///
/// # Errors
/// Pages that are not grey of 8 or 16 bits or differ in size, a damaged or truncated file.
pub fn decode(bytes: &[u8]) -> Result<Frames> {
    let failed = |e: tiff::TiffError| match e {
        tiff::TiffError::IoError(e) if e.kind() == ErrorKind::UnexpectedEof => {
            Error::input("a truncated TIFF or DNG").help("the file is incomplete; get it again")
        }
        e => Error::input(format!("TIFF: {e}")),
    };
    let mut file = Decoder::new(Cursor::new(bytes)).map_err(failed)?;
    let mut frames = Frames { planes: Vec::new(), facts: Facts::default() };
    loop {
        let (width, height) = file.dimensions().map_err(failed)?;
        let (width, height) = (width as usize, height as usize);
        let color = file.colortype().map_err(failed)?;
        let tiff::ColorType::Gray(depth @ (8 | 16)) = color else {
            return Err(Error::unsupported(format!("a TIFF of colour type {color:?}"))
                .help("raw frames are grey, 8 or 16 bits"));
        };
        // Checked before the pixels are read, so that a forged size costs no memory.
        if file
            .find_tag(Tag::Compression)
            .is_ok_and(|c| c.is_none_or(|c| c.into_u16().is_ok_and(|c| c == 1)))
        {
            let needed = super::area(width, height)?.saturating_mul(usize::from(depth) / 8);
            if needed > bytes.len() {
                return Err(super::truncated(needed, bytes.len()));
            }
        }
        let data = match file.read_image().map_err(failed)? {
            DecodingResult::U8(data) => data.into_iter().map(u16::from).collect(),
            DecodingResult::U16(data) => data,
            _ => {
                return Err(Error::unsupported(
                    "a TIFF of samples that are not unsigned integers",
                ));
            }
        };
        if data.len() != width * height {
            return Err(Error::input(format!(
                "TIFF: {} of {} pixels",
                data.len(),
                width * height
            )));
        }
        if frames.planes.is_empty() {
            frames.facts.bits = Some(depth.into());
            if let Ok(note) = file.get_tag_ascii_string(Tag::ImageDescription) {
                frames.facts.merge_note(&note);
            }
        } else if (frames.width(), frames.height()) != (width, height) {
            return Err(Error::unsupported("pages of different sizes in one TIFF file"));
        }
        frames.planes.push(Plane { width, height, data });
        if !file.more_images() {
            return Ok(frames);
        }
        file.next_image().map_err(failed)?;
    }
}
