//! Stacks of which only the first frame has a page. ImageJ (above 4 GiB) and tifffile
//! (`truncate=True`) write all frames one behind another, and a directory of the first, whose
//! description says how many they are. MetaMorph's stacks, which count them in a tag, are refused.

use super::{Page, failed};
use crate::Frames;
use crate::ifd::Tiff;
use camrig_base::{Dn, Error, Result};
use std::io::Cursor;
use tiff::decoder::Decoder;
use tiff::tags::Tag;

/// What tifffile writes into the description of a stack of one page.
const TRUNCATED: &str = "\"truncated\": true";

/// MetaMorph's tag of the times and distances of its planes, one value per plane.
const UIC2: u16 = 33629;

/// Reads the frames behind those of the pages, where the first page's description says that there
/// are more of them than pages.
///
/// # Errors
/// Frames that are not there, or not uncompressed behind the only page's.
pub(super) fn further<S: Dn>(
    frames: &mut Frames<S>,
    description: &str,
    bytes: &[u8],
) -> Result<()> {
    let pages = frames.planes.len();
    let first = Tiff::open(bytes).and_then(|tiff| tiff.ifd(tiff.first()?));
    let planes = first.as_ref().ok().and_then(|first| first.count(UIC2));
    if let Some(planes) = planes.filter(|planes| *planes > pages) {
        return Err(Error::unsupported(format!(
            "a MetaMorph stack (STK) of {planes} planes in {pages} page(s)"
        ))
        .at(format!("UIC2Tag (tag {UIC2})"))
        .help("save it as a TIFF with a page per frame, for instance with ImageJ"));
    }
    let Some(said) = announced(description, frames.planes[0].data.len()) else { return Ok(()) };
    let hidden = pages > 1 && said > 1 && description.contains(TRUNCATED);
    if said <= pages && !hidden {
        return Ok(());
    }
    let refused = |why: &str| {
        Err(Error::unsupported(format!(
            "a TIFF of {pages} page(s) whose description says {said} frames, {why}"
        ))
        .at("ImageDescription")
        .help(
            "save it with a page per frame; frames without one are read where they lie \
             uncompressed, without gaps, behind the frame of the only page",
        ))
    };
    if pages > 1 {
        return refused("in a file of several pages");
    }
    let mut file = Decoder::new(Cursor::new(bytes)).map_err(failed)?;
    let Some((start, length)) = extent(&mut file) else {
        return refused("whose first is not stored in one uncompressed piece");
    };
    let end = said.checked_mul(length).and_then(|all| all.checked_add(start));
    if end.is_none_or(|end| end > bytes.len()) {
        return refused("and that ends before them");
    }
    // Both programs write the directory first: behind the frame it would be taken for samples.
    if first?.reach > start {
        return refused("with other data behind the first");
    }
    // The page is read again with each frame's bytes in place of its own.
    let mut moved = bytes.to_vec();
    for frame in 1..said {
        let from = start + frame * length;
        moved.copy_within(from..from + length, start);
        let mut file = Decoder::new(Cursor::new(&moved[..])).map_err(failed)?;
        frames.planes.push(Page::read(&mut file, &moved)?.plane);
    }
    frames.facts.notes.push(format!(
        "the file has one page and {said} frames by its description: they are read from behind \
         the page's"
    ));
    Ok(())
}

/// The number of frames of `pixels` that ImageJ's description or tifffile's says.
fn announced(description: &str, pixels: usize) -> Option<usize> {
    if description.starts_with("ImageJ=") {
        let images = |line: &str| line.trim().strip_prefix("images=")?.parse().ok();
        return description.lines().find_map(images);
    }
    let (shape, _) = description.strip_prefix("{\"shape\": [")?.split_once(']')?;
    let mut sides = shape.split(',').map(|side| side.trim().parse::<usize>().ok());
    let values = sides.try_fold(1usize, |product, side| product.checked_mul(side?))?;
    values.is_multiple_of(pixels).then_some(values / pixels)
}

/// Where the strips of an uncompressed page begin, and their bytes; `None` where they do not
/// follow each other or are not what the page takes.
fn extent(file: &mut Decoder<Cursor<&[u8]>>) -> Option<(usize, usize)> {
    let compression = file.find_tag(Tag::Compression).ok()?;
    if compression.is_some_and(|value| value.into_u16().ok() != Some(1)) {
        return None;
    }
    let offsets = file.get_tag_u64_vec(Tag::StripOffsets).ok()?;
    let lengths = file.get_tag_u64_vec(Tag::StripByteCounts).ok()?;
    let start = *offsets.first()?;
    let mut end = start;
    for (offset, length) in offsets.into_iter().zip(lengths) {
        if offset != end {
            return None;
        }
        end = end.checked_add(length)?;
    }
    let (width, height) = file.dimensions().ok()?;
    let tiff::ColorType::Gray(bits) = file.colortype().ok()? else { return None };
    let row = (u64::from(width) * u64::from(bits)).div_ceil(8);
    let whole = row.checked_mul(height.into()) == Some(end - start);
    whole.then_some((usize::try_from(start).ok()?, usize::try_from(end - start).ok()?))
}
