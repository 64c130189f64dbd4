//! Grey TIFF: words of 16 bits, or of 32 for more, uncompressed, one page per frame.
//!
//! The reader takes grey pages of whole numbers from 0 to 65535, stored as integers or floats of 8
//! to 64 bits, classic or BigTIFF, uncompressed or with one of the compressions of the `tiff`
//! crate (LZW, Deflate, PackBits); uncompressed ones also packed, of 9 to 15 bits. Samples of
//! pages whose white is 0 stay as stored, and a note says so. Frames without a page of their own
//! (module `stack`) are read too.

mod stack;

use super::ifd::{Tiff, without_idle_predictors};
use super::{Facts, Frames, Taken, check_range, narrow, tiff_samples};
use camrig_base::{Dn, Error, Plane, Result};
use std::borrow::Cow;
use std::io::{Cursor, ErrorKind};
use tiff::decoder::{Decoder, DecodingResult};
use tiff::encoder::{TiffEncoder, TiffKind, TiffKindBig, TiffKindStandard, colortype};
use tiff::tags::Tag;

/// Bytes reserved per page for its directory when choosing between TIFF and BigTIFF: twice what a
/// directory of a dozen tags and the note take.
const DIRECTORY: usize = 1024;

/// Frames as TIFF bytes; BigTIFF where 4 GiB are not enough.
///
/// # Errors
/// Samples beyond the bits.
pub fn encode<S: Dn>(frames: &Frames<S>) -> Result<Vec<u8>> {
    if let Some(bits) = frames.facts.bits {
        frames.planes.iter().try_for_each(|p| check_range(&p.data, bits))?;
    }
    let pixels: usize = frames.planes.iter().map(|p| p.data.len()).sum();
    let bytes = pixels * size_of::<S>() + frames.planes.len() * DIRECTORY;
    let written = if bytes >= u32::MAX as usize {
        write::<S, TiffKindBig>(frames)
    } else {
        write::<S, TiffKindStandard>(frames)
    };
    written.map_err(|e| Error::input(format!("TIFF: {e}")))
}

fn write<S: Dn, K: TiffKind>(frames: &Frames<S>) -> std::result::Result<Vec<u8>, tiff::TiffError> {
    let mut bytes = Cursor::new(Vec::new());
    let mut file = TiffEncoder::<_, K>::new_generic(&mut bytes)?;
    let note = frames.facts.note();
    for plane in &frames.planes {
        let (width, height) = (plane.width.try_into()?, plane.height.try_into()?);
        let words = plane.data.iter().map(|dn| (*dn).into());
        if S::MAX_BITS == 16 {
            let mut page = file.new_image::<colortype::Gray16>(width, height)?;
            page.encoder().write_tag(Tag::ImageDescription, note.as_str())?;
            page.write_data(&words.map(|word: u32| word as u16).collect::<Vec<_>>())?;
        } else {
            let mut page = file.new_image::<colortype::Gray32>(width, height)?;
            page.encoder().write_tag(Tag::ImageDescription, note.as_str())?;
            page.write_data(&words.collect::<Vec<_>>())?;
        }
    }
    Ok(bytes.into_inner())
}

/// Whether samples of the first page are of more than 16 bits.
pub(super) fn is_wide(bytes: &[u8]) -> bool {
    let colour = Decoder::new(Cursor::new(bytes)).and_then(|mut file| file.colortype());
    matches!(colour, Ok(tiff::ColorType::Gray(17..)))
}

/// Reads TIFF bytes.
///
/// # Errors
/// Pages that are not grey or differ in size or kind, values that are not whole
/// numbers of the samples' type, a damaged or truncated file.
pub fn decode<S: Dn>(bytes: &[u8]) -> Result<Frames<S>> {
    let plain = without_idle_predictors(bytes);
    let bytes = &*plain;
    let mut file = Decoder::new(Cursor::new(bytes)).map_err(failed)?;
    let mut frames = Frames { planes: Vec::new(), facts: Facts::default() };
    let description = file.get_tag_ascii_string(Tag::ImageDescription).unwrap_or_default();
    let mut kind = None;
    loop {
        let page = Page::read(&mut file, bytes)?;
        let this = (page.bits, page.white_is_zero);
        if *kind.get_or_insert(this) != this {
            let what = "pages of different depth or PhotometricInterpretation in one TIFF file";
            return Err(Error::unsupported(what).help(
                "the frames of a file are of one kind: write each kind to a file of its own",
            ));
        }
        if frames.planes.is_empty() {
            frames.facts.bits = page.bits;
            frames.facts.taken = Taken::of_tiff(bytes);
            frames.facts.merge_note(&description);
            frames.facts.notes.extend(tiff_samples::orientation(page.orientation));
            if page.white_is_zero {
                frames.facts.notes.push(
                    "the file calls 0 white (PhotometricInterpretation WhiteIsZero): its samples \
                     are taken as stored, not inverted"
                        .into(),
                );
            }
        } else if (frames.width(), frames.height()) != (page.plane.width, page.plane.height) {
            return Err(Error::unsupported("pages of different sizes in one TIFF file"));
        }
        frames.planes.push(page.plane);
        if !file.more_images() {
            break;
        }
        file.next_image().map_err(failed)?;
    }
    if matches!(plain, Cow::Owned(_)) {
        frames.facts.notes.push(
            "the file states a Predictor for samples that are not compressed, which means nothing: \
             they are taken as stored"
                .into(),
        );
    }
    stack::further(&mut frames, &description, bytes)?;
    Ok(frames)
}

fn failed(e: tiff::TiffError) -> Error {
    match e {
        tiff::TiffError::IoError(e) if e.kind() == ErrorKind::UnexpectedEof => {
            Error::input("a truncated TIFF or DNG").help("the file is incomplete; get it again")
        }
        e => Error::input(format!("TIFF: {e}")),
    }
}

/// One page.
struct Page<S> {
    plane: Plane<S>,
    /// Bits per sample, where samples are unsigned integers of at most 16.
    bits: Option<u32>,
    white_is_zero: bool,
    orientation: u64,
}

impl<S: Dn> Page<S> {
    /// The current page of the file.
    fn read(file: &mut Decoder<Cursor<&[u8]>>, bytes: &[u8]) -> Result<Self> {
        let (width, height) = file.dimensions().map_err(failed)?;
        let (width, height) = (width as usize, height as usize);
        let color = file.colortype().map_err(failed)?;
        let tiff::ColorType::Gray(depth @ (8..=16 | 32 | 64)) = color else {
            return Err(Error::unsupported(format!("a TIFF of colour type {color:?}"))
                .help("raw frames are grey, 8 to 16 bits, or of whole numbers in 32 or 64"));
        };
        let mut number = |tag, missing| {
            let value = file.find_tag(tag).ok().flatten();
            value.map_or(Some(missing), |v| v.into_u16().ok())
        };
        let uncompressed = number(Tag::Compression, 1) == Some(1);
        let white_is_zero = number(Tag::PhotometricInterpretation, 1) == Some(0);
        let orientation = number(Tag::Orientation, 1).unwrap_or(1).into();
        tiff_samples::check_fill_order(number(Tag::FillOrder, 1).unwrap_or(0).into())?;
        // Checked before the pixels are read, so that a forged size costs no memory.
        if uncompressed {
            let bits = super::area(width, height)?.saturating_mul(usize::from(depth));
            if bits / 8 > bytes.len() {
                return Err(super::truncated(bits / 8, bytes.len()));
            }
        }
        let bits = (depth <= 16).then_some(u32::from(depth));
        if !matches!(depth, 8 | 16 | 32 | 64) {
            let plane = packed(file, bytes, depth, uncompressed)?;
            return Ok(Self { plane, bits, white_is_zero, orientation });
        }
        let image = file.read_image().map_err(failed)?;
        let whole = matches!(image, DecodingResult::U8(_) | DecodingResult::U16(_));
        let data = samples(image, white_is_zero)?;
        if data.len() != width * height {
            let text = format!("TIFF: {} of {} pixels", data.len(), width * height);
            return Err(Error::input(text));
        }
        let plane = Plane { width, height, data };
        Ok(Self { plane, bits: bits.filter(|_| whole), white_is_zero, orientation })
    }
}

/// The samples as stored: where white is 0, the `tiff` crate has inverted them.
fn samples<S: Dn>(image: DecodingResult, inverted: bool) -> Result<Vec<S>> {
    let integers = |values: &mut dyn Iterator<Item = i128>| values.map(narrow::integer).collect();
    let floats = |values: &mut dyn Iterator<Item = f64>| values.map(narrow::float).collect();
    match image {
        DecodingResult::U8(data) => {
            integers(&mut data.into_iter().map(|v| i128::from(if inverted { !v } else { v })))
        }
        DecodingResult::U16(data) => {
            integers(&mut data.into_iter().map(|v| i128::from(if inverted { !v } else { v })))
        }
        DecodingResult::U32(data) => {
            integers(&mut data.into_iter().map(|v| i128::from(if inverted { !v } else { v })))
        }
        DecodingResult::U64(data) => {
            integers(&mut data.into_iter().map(|v| i128::from(if inverted { !v } else { v })))
        }
        // The crate refuses signed samples whose white is 0.
        DecodingResult::I8(data) => integers(&mut data.into_iter().map(i128::from)),
        DecodingResult::I16(data) => integers(&mut data.into_iter().map(i128::from)),
        DecodingResult::I32(data) => integers(&mut data.into_iter().map(i128::from)),
        DecodingResult::I64(data) => integers(&mut data.into_iter().map(i128::from)),
        DecodingResult::F32(data) => {
            let stored = |v| f64::from(if inverted { 1.0 - v } else { v });
            floats(&mut data.into_iter().map(stored))
        }
        DecodingResult::F64(data) => {
            floats(&mut data.into_iter().map(|v| if inverted { 1.0 - v } else { v }))
        }
        DecodingResult::F16(data) => floats(&mut data.into_iter().map(f64::from)),
    }
}

/// A page of packed samples, which the `tiff` crate does not read.
fn packed<S: Dn>(
    file: &mut Decoder<Cursor<&[u8]>>,
    bytes: &[u8],
    depth: u8,
    uncompressed: bool,
) -> Result<Plane<S>> {
    let refused = |what: &str| {
        Error::unsupported(format!("a TIFF of {depth} bits per sample, {what}"))
            .help("samples of 9 to 15 bits are read from uncompressed TIFF files")
    };
    if !uncompressed {
        return Err(refused("compressed"));
    }
    let signed = file.find_tag(Tag::SampleFormat).ok().flatten();
    if signed.is_some_and(|v| v.into_u16().ok() != Some(1)) {
        return Err(refused("not unsigned integers"));
    }
    let directory = file.ifd_pointer().ok_or_else(|| refused("without a directory"))?;
    let tiff = Tiff::open(bytes)?;
    let plane = tiff_samples::read(&tiff, &tiff.ifd(directory.0 as usize)?)?;
    let data = plane.data.iter().map(|dn| S::of((*dn).into()).unwrap_or_default());
    Ok(Plane { width: plane.width, height: plane.height, data: data.collect() })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A little-endian page of 3 x 2 with one strip.
    fn page(bits: u16, photometric: u16, format: u16, strip: &[u8]) -> Vec<u8> {
        described([bits, photometric, format], strip, strip.len(), "images")
    }

    /// Such a page of six words with one more field of a value.
    fn with_field(tag: u16, kind: u16, count: u32, value: u32) -> Vec<u8> {
        let mut bytes = page(16, 1, 1, &bytes_of(DN.map(u16::to_le_bytes)));
        // In place of the description, field 5 of the directory, the last one: SampleFormat.
        let at = 10 + 10 * 12;
        let field = [
            &tag.to_le_bytes()[..],
            &kind.to_le_bytes(),
            &count.to_le_bytes(),
            &value.to_le_bytes(),
        ];
        bytes[at..at + 12].copy_from_slice(&field.concat());
        bytes
    }

    /// Such a page with a description and then `data`, of which the first `length` bytes are its
    /// strip.
    fn described(how: [u16; 3], data: &[u8], length: usize, text: &str) -> Vec<u8> {
        let [bits, photometric, format] = how;
        // Behind the header and a directory of 11 fields.
        let at = 8 + 2 + 11 * 12 + 4;
        let tags = [
            (256u16, 3u16),
            (257, 2),
            (258, bits),
            (259, 1),
            (262, photometric),
            (270, at),
            (273, at + text.len() as u16),
            (277, 1),
            (278, 2),
            (279, length as u16),
            (339, format),
        ];
        let mut bytes = b"II*\0\x08\0\0\0".to_vec();
        bytes.extend((tags.len() as u16).to_le_bytes());
        for (tag, value) in tags {
            bytes.extend(tag.to_le_bytes());
            let (kind, count) = if tag == 270 { (2u16, text.len()) } else { (3, 1) };
            bytes.extend(kind.to_le_bytes());
            bytes.extend((count as u32).to_le_bytes());
            bytes.extend(u32::from(value).to_le_bytes());
        }
        bytes.extend([0; 4]);
        bytes.extend(text.as_bytes());
        bytes.extend(data);
        bytes
    }

    fn bytes_of<const N: usize>(values: impl IntoIterator<Item = [u8; N]>) -> Vec<u8> {
        values.into_iter().flatten().collect()
    }

    const DN: [u16; 6] = [0, 1, 500, 4095, 32767, 70];

    /// A TIFF of grey words with these fields, each of one SHORT, behind its samples.
    fn with_fields(samples: &[u16; 6], more: &[(u16, u16)]) -> Vec<u8> {
        let mut fields = vec![(256, 3), (257, 2), (258, 16), (259, 1), (262, 1), (273, 8)];
        fields.extend([(277, 1), (278, 2), (279, 12)]);
        fields.extend(more);
        fields.sort_unstable();
        let mut bytes = b"II*\0\x14\0\0\0".to_vec();
        bytes.extend(samples.iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend((fields.len() as u16).to_le_bytes());
        for (tag, value) in fields {
            let words: [u16; 6] = [tag, 3, 1, 0, value, 0];
            bytes.extend(words.iter().flat_map(|w| w.to_le_bytes()));
        }
        bytes.extend([0; 4]);
        bytes
    }

    /// Samples that are not compressed are no differences, whatever Predictor says: so libtiff.
    #[test]
    fn a_predictor_of_uncompressed_samples_means_nothing() {
        let samples = [7, 300, 20, 4000, 5, 60_000];
        let read = |more: &[(u16, u16)]| decode::<u16>(&with_fields(&samples, more)).unwrap();
        let plain = read(&[]);
        assert_eq!((&plain.planes[0].data[..], plain.facts.notes.len()), (&samples[..], 0));
        let stated = read(&[(317, 2)]);
        assert_eq!(stated.planes[0].data, samples);
        assert!(stated.facts.notes[0].contains("Predictor"), "{:?}", stated.facts.notes);
    }

    #[test]
    fn samples_whose_white_is_zero_stay_as_stored() {
        let words = bytes_of(DN.map(u16::to_le_bytes));
        let floats = bytes_of(DN.map(|v| f32::from(v).to_le_bytes()));
        let wide = bytes_of(DN.map(|v| u32::from(v).to_le_bytes()));
        for (bits, format, strip) in [(16, 1, words), (32, 3, floats), (32, 1, wide)] {
            let white = decode::<u16>(&page(bits, 0, format, &strip)).unwrap();
            assert_eq!(white.planes[0].data, DN, "{bits} bits, format {format}");
            assert!(white.facts.notes[0].contains("as stored"), "{:?}", white.facts.notes);
            let black = decode::<u16>(&page(bits, 1, format, &strip)).unwrap();
            assert_eq!((black.planes, black.facts.notes), (white.planes, vec![]));
        }
        let small = decode::<u16>(&page(8, 0, 1, &[0, 1, 2, 3, 254, 255])).unwrap();
        assert_eq!(small.planes[0].data, [0, 1, 2, 3, 254, 255]);
    }

    /// The bits of the first page would set the white level of all.
    #[test]
    fn pages_of_different_depth_are_refused() {
        let mut bytes = Cursor::new(Vec::new());
        let mut file = TiffEncoder::new(&mut bytes).unwrap();
        file.write_image::<tiff::encoder::colortype::Gray8>(3, 2, &[9; 6]).unwrap();
        file.write_image::<colortype::Gray16>(3, 2, &DN).unwrap();
        let said = decode::<u16>(&bytes.into_inner()).unwrap_err().to_string();
        assert!(said.contains("pages of different depth"), "{said}");
    }

    #[test]
    fn whole_numbers_in_other_types_are_read_and_others_refused() {
        let signed = bytes_of(DN.map(|v| (v as i16).to_le_bytes()));
        assert_eq!(decode::<u16>(&page(16, 1, 2, &signed)).unwrap().planes[0].data, DN);
        for (bits, format, strip, said) in [
            (16, 2, bytes_of([0i16, 1, -1, 3, 4, 5].map(i16::to_le_bytes)), "-1"),
            (32, 3, bytes_of([0f32, 1.0, 0.5, 3.0, 4.0, 5.0].map(f32::to_le_bytes)), "0.5"),
            (32, 3, bytes_of([f32::NAN; 6].map(f32::to_le_bytes)), "NaN"),
            (32, 1, bytes_of([65536u32; 6].map(u32::to_le_bytes)), "65536"),
        ] {
            let error = decode::<u16>(&page(bits, 1, format, &strip)).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }

    /// Three frames and one page, as ImageJ and tifffile write them; files that have fewer frames
    /// than they say are refused.
    #[test]
    fn frames_without_a_page_are_read_where_the_description_counts_them() {
        let words = bytes_of(
            [DN, DN.map(|v| v / 2), DN.map(|v| v / 3)]
                .as_flattened()
                .iter()
                .map(|v| v.to_le_bytes()),
        );
        let file = |data: &[u8], text: &str| described([16, 1, 1], data, 12, text);
        let imagej = "ImageJ=1.11a\nimages=3\nchannels=3\nhyperstack=true\n\0";
        for text in [imagej, "{\"shape\": [3, 2, 3], \"truncated\": true}\0"] {
            let frames = decode::<u16>(&file(&words, text)).unwrap();
            let data: Vec<_> = frames.planes.iter().map(|p| p.data.to_vec()).collect();
            assert_eq!(data, [DN, DN.map(|v| v / 2), DN.map(|v| v / 3)], "{text}");
            assert!(frames.facts.notes[0].contains("3 frames"), "{:?}", frames.facts.notes);
            let short = file(&words[..35], text);
            // The description (field 5 of the directory) where the third frame should be.
            let mut behind = file(&words[..24], text);
            behind[78] = behind.len() as u8;
            behind.extend(text.as_bytes());
            for (bytes, said) in [(short, "ends before"), (behind, "other data behind")] {
                let error = decode::<u16>(&bytes).unwrap_err().to_string();
                assert!(error.contains("3 frames") && error.contains(said), "{error}");
            }
        }
        for text in ["ImageJ=1.11a\nimages=1\n\0", "{\"shape\": [2, 3]}\0", "images=3\0"] {
            let frames = decode::<u16>(&file(&words, text)).unwrap();
            assert_eq!((frames.planes.len(), frames.facts.notes), (1, vec![]), "{text}");
        }
    }

    /// Fields that would change the samples are refused; an orientation has a note.
    #[test]
    fn fields_that_samples_depend_on_are_refused_or_told() {
        let reversed = decode::<u16>(&with_field(266, 3, 1, 2)).unwrap_err().to_string();
        assert!(reversed.contains("reversed bits (FillOrder 2)"), "{reversed}");
        assert_eq!(decode::<u16>(&with_field(266, 3, 1, 1)).unwrap().planes[0].data, DN);
        // Two fractions; the first bytes of the file will do.
        let stack = decode::<u16>(&with_field(33629, 5, 2, 0)).unwrap_err().to_string();
        assert!(stack.contains("2 planes in 1 page"), "{stack}");
        assert_eq!(decode::<u16>(&with_field(33629, 5, 1, 0)).unwrap().planes[0].data, DN);
        let turned = decode::<u16>(&with_field(274, 3, 1, 6)).unwrap();
        assert_eq!(turned.planes[0].data, DN);
        assert!(turned.facts.notes[0].contains("Orientation 6"), "{:?}", turned.facts.notes);
        assert_eq!(decode::<u16>(&with_field(274, 3, 1, 1)).unwrap().facts.notes, [""; 0]);
    }

    #[test]
    fn packed_samples_are_read() {
        // 0x123 0x456 0x789, then a row that begins on a byte.
        let strip = [0x12, 0x34, 0x56, 0x78, 0x90, 0xAB, 0xCD, 0xEF, 0x01, 0x20];
        let frames = decode::<u16>(&page(12, 1, 1, &strip)).unwrap();
        assert_eq!(frames.planes[0].data, [0x123, 0x456, 0x789, 0xABC, 0xDEF, 0x012]);
        assert_eq!(frames.facts.bits, Some(12));
        assert!(decode::<u16>(&page(12, 1, 1, &strip[..9])).is_err());
    }
}
