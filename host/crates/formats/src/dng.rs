//! DNG writer: IFD 0 with an RGB thumbnail and the camera's colour, a SubIFD with the raw, an Exif
//! IFD with the exposure.
//!
//! Source: Adobe Digital Negative Specification 1.4. Every client of the test suite reads this
//! structure correctly; tools that look for the white level only in a SubIFD, or for the ISO speed
//! only in an Exif IFD, are common. Samples are stored as uncompressed 16-bit words.

use super::cfa_codes::color_code;
use super::dng_info::{CARRIED, DngInfo, black_levels, linearized};
use super::opcodes;
use super::{Facts, check_range, preview};
use camrig_base::{Error, RawFrame, Result};
use std::io::Cursor;
use tiff::encoder::{
    DirectoryEncoder, Rational, SRational, TiffEncoder, TiffKindStandard, TiffValue,
};
use tiff::tags::Tag;

/// The fields of [`CARRIED`] that are unsigned fractions; the others are signed.
const UNSIGNED: [u16; 6] = [50727, 50729, 50731, 50732, 50734, 50739];
/// Longest side of the thumbnail, pixels: enough for a file browser, at most 197 kB in the file.
const THUMBNAIL: usize = 256;
/// Bytes that dcraw reads of a description, whatever its length; it fails where the file ends
/// before.
const DCRAW_DESCRIPTION: usize = 512;
/// Colour planes of a raw image (`kMaxColorPlanes` of Adobe's DNG SDK); the codes of CFAPlaneColor
/// name seven colours.
const MAX_PLANES: usize = 4;
/// Denominator of the fractions that decimal values are written as.
const DENOMINATOR: u32 = 1_000_000_000;

type Directory<'a, 'b> = DirectoryEncoder<'a, &'b mut Cursor<Vec<u8>>, TiffKindStandard>;
type Written = std::result::Result<(), tiff::TiffError>;

/// One frame as DNG bytes.
///
/// # Errors
/// Samples beyond the bits, more channels than a DNG names, black levels that are not one per cell
/// of the pattern, sizes that a classic TIFF cannot express.
pub fn encode(frame: &RawFrame, info: &DngInfo) -> Result<Vec<u8>> {
    check_range(&frame.data, frame.bits)?;
    let channels = frame.cfa.channels().len();
    if channels > MAX_PLANES {
        return Err(Error::unsupported(format!("{channels} channels in a DNG")).help(format!(
            "it has at most {MAX_PLANES}; write .tiff, whose description names the pattern"
        )));
    }
    let cells = frame.cfa.width * frame.cfa.height;
    if !info.black_levels_dn.is_empty() && info.black_levels_dn.len() != cells {
        return Err(Error::input(format!("{} black levels", info.black_levels_dn.len()))
            .help(format!("give one for each of the pattern's {cells} cells, row by row")));
    }
    let mut bytes = Cursor::new(Vec::new());
    write(&mut bytes, frame, info).map_err(|e| Error::internal(format!("DNG: {e}")))?;
    let mut bytes = bytes.into_inner();
    bytes.resize(bytes.len() + DCRAW_DESCRIPTION, 0);
    Ok(bytes)
}

fn write(bytes: &mut Cursor<Vec<u8>>, frame: &RawFrame, info: &DngInfo) -> Written {
    let mut file = TiffEncoder::new(bytes)?;
    let mut exif = file.extra_directory()?;
    write_exif(&mut exif, info)?;
    let exif = exif.finish_with_offsets()?;
    let mut raw = file.extra_directory()?;
    write_raw(&mut raw, frame, info)?;
    let raw = raw.finish_with_offsets()?;
    let mut main = file.image_directory()?;
    write_thumbnail(&mut main, frame, info)?;
    write_camera(&mut main, frame, info)?;
    put(&mut main, 330, raw.offset)?; // SubIFDs
    put(&mut main, 34665, exif.offset)?; // Exif IFD
    main.finish()
}

fn write_exif(d: &mut Directory, info: &DngInfo) -> Written {
    put(d, 36864, Undefined(b"0230"))?; // ExifVersion
    let rationals = [
        (33434, info.exposure_s),      // ExposureTime
        (33437, info.f_number),        // FNumber
        (37386, info.focal_length_mm), // FocalLength
    ];
    for (tag, value) in rationals {
        if let Some(value) = value {
            put(d, tag, rational(value))?;
        }
    }
    if let Some(iso) = info.iso {
        put(d, 34855, iso.min(65535) as u16)?; // ISOSpeedRatings; Exif: 65535 for more
    }
    if let Some(datetime) = &info.datetime {
        put(d, 36867, Ascii::new(datetime))?; // DateTimeOriginal
    }
    Ok(())
}

fn write_raw(d: &mut Directory, frame: &RawFrame, info: &DngInfo) -> Written {
    let (width, height) = (frame.width as u32, frame.height as u32);
    let offset = d.write_data(&frame.data[..])?;
    write_image_tags(d, 0, [width, height], &[16], offset, frame.data.len() as u32 * 2)?;
    put(d, 270, Ascii::new(&Facts::of(&linearized(frame, info)).note()))?; // ImageDescription
    let cfa = &frame.cfa;
    if cfa.is_mono() {
        put(d, 262, 34892u16)?; // PhotometricInterpretation: LinearRaw
    } else {
        put(d, 262, 32803u16)?; // PhotometricInterpretation: CFA
        let codes: Vec<u8> = cfa.letters.iter().map(|&c| color_code(cfa, c)).collect();
        // Filters that share a code, such as white and infrared, share a plane.
        let mut planes: Vec<u8> = Vec::new();
        for code in cfa.channels().into_iter().map(|c| color_code(cfa, c)) {
            if !planes.contains(&code) {
                planes.push(code);
            }
        }
        put(d, 33421, [cfa.height as u16, cfa.width as u16])?; // CFARepeatPatternDim
        put(d, 33422, &codes[..])?; // CFAPattern
        put(d, 50710, &planes[..])?; // CFAPlaneColor
        put(d, 50711, 1u16)?; // CFALayout: rectangular
    }
    if !info.linearization.is_empty() {
        put(d, 50712, &info.linearization[..])?; // LinearizationTable
    }
    let black = black_levels(frame, info);
    put(d, 50713, [cfa.height as u16, cfa.width as u16])?; // BlackLevelRepeatDim
    if black.iter().all(|b| b.fract() == 0.0) {
        put(d, 50714, &black.iter().map(|&b| b as u32).collect::<Vec<_>>()[..])?; // BlackLevel
    } else {
        // LibRaw, dcraw and others cut the fraction of a level, and round the mean of the deltas:
        // half a DN more here and less there, and they round the level; the sum is exact.
        let levels: Vec<Rational> = black.iter().map(|&b| rational(b + 0.5)).collect();
        put(d, 50714, &levels[..])?;
        put(d, 50716, &vec![SRational { n: -1, d: 2 }; frame.height][..])?; // BlackLevelDeltaV
    }
    put(d, 50717, u32::from(linearized(frame, info).white_level_dn))?; // WhiteLevel
    put(d, 50719, [0u32, 0])?; // DefaultCropOrigin
    put(d, 50720, [width, height])?; // DefaultCropSize
    put(d, 50829, [0, 0, height, width])?; // ActiveArea
    for (tag, list) in [(51008, &info.opcode_list1), (51009, &info.opcode_list2)] {
        if !list.is_empty() {
            put(d, tag, Undefined(&opcodes::encode(list)))?; // OpcodeList1, OpcodeList2
        }
    }
    if !info.noise_profile.is_empty() {
        let profile: Vec<f64> = info.noise_profile.iter().flat_map(|&(s, o)| [s, o]).collect();
        put(d, 51041, &profile[..])?; // NoiseProfile
    }
    Ok(())
}

fn write_thumbnail(d: &mut Directory, frame: &RawFrame, info: &DngInfo) -> Written {
    let picture = preview::thumbnail(frame, info, THUMBNAIL);
    let mut data = picture.data.as_flattened().to_vec();
    let size = data.len() as u32;
    data.resize(data.len().next_multiple_of(2), 0); // offsets stay even
    let offset = d.write_data(&data[..])?;
    let sides = [picture.width as u32, picture.height as u32];
    write_image_tags(d, 1, sides, &[8, 8, 8], offset, size)?;
    put(d, 262, 2u16) // PhotometricInterpretation: RGB
}

fn write_image_tags(
    d: &mut Directory,
    subfile: u32,
    [width, height]: [u32; 2],
    bits: &[u16],
    offset: u64,
    size: u32,
) -> Written {
    put(d, 254, subfile)?; // NewSubfileType: 0 full, 1 reduced
    put(d, 256, width)?; // ImageWidth
    put(d, 257, height)?; // ImageLength
    put(d, 258, bits)?; // BitsPerSample
    put(d, 259, 1u16)?; // Compression: none
    put(d, 273, u32::try_from(offset)?)?; // StripOffsets
    put(d, 277, bits.len() as u16)?; // SamplesPerPixel
    put(d, 278, height)?; // RowsPerStrip
    put(d, 279, size)?; // StripByteCounts
    put(d, 284, 1u16) // PlanarConfiguration: chunky
}

fn write_camera(d: &mut Directory, frame: &RawFrame, info: &DngInfo) -> Written {
    if !info.description.is_empty() {
        put(d, 270, Ascii::new(&info.description))?; // ImageDescription
    }
    put(d, 271, Ascii::new(&info.make))?; // Make
    put(d, 272, Ascii::new(&info.model))?; // Model
    put(d, 274, 1u16)?; // Orientation: as stored
    put(d, 305, Ascii::new(concat!("camrig ", env!("CARGO_PKG_VERSION"))))?; // Software
    if let Some(datetime) = &info.datetime {
        put(d, 306, Ascii::new(datetime))?; // DateTime
    }
    let has_opcodes = !(info.opcode_list1.is_empty() && info.opcode_list2.is_empty());
    put(d, 50706, [1u8, 4, 0, 0])?; // DNGVersion
    put(d, 50707, [1u8, if has_opcodes { 3 } else { 1 }, 0, 0])?; // DNGBackwardVersion
    put(d, 50708, Ascii::new(&format!("{} {}", info.make, info.model)))?; // UniqueCameraModel
    if frame.cfa.channels() != ['R', 'G', 'B'] {
        return Ok(()); // colour matrices have a row per channel: ours are for R, G, B
    }
    // ColorMatrix1 and 2, CalibrationIlluminant1 and 2.
    for ((tag, light_tag), matrix) in
        [(50721, 50778), (50722, 50779)].iter().zip(&info.color_matrices)
    {
        put(d, *tag, &srationals(matrix.camera_from_xyz.as_flattened())[..])?;
        put(d, *light_tag, matrix.illuminant)?;
    }
    if let Some(neutral) = info.as_shot_neutral {
        put(d, 50728, neutral.map(rational))?; // AsShotNeutral
    }
    for (tag, values) in info.carried.iter().filter(|(tag, _)| CARRIED.contains(tag)) {
        if UNSIGNED.contains(tag) {
            put(d, *tag, &values.iter().map(|&v| rational(v)).collect::<Vec<_>>()[..])?;
        } else {
            put(d, *tag, &srationals(values)[..])?;
        }
    }
    Ok(())
}

fn put(d: &mut Directory, tag: u16, value: impl TiffValue) -> Written {
    d.write_tag(Tag::from_u16_exhaustive(tag), value)
}

/// The closest fraction with a power of ten as denominator that fits, in lowest terms; 0 for
/// negative values.
fn rational(value: f64) -> Rational {
    let (n, d) = fraction(value.max(0.0), u32::MAX);
    Rational { n, d }
}

fn srationals(values: &[f64]) -> Vec<SRational> {
    let signed = |&value: &f64| {
        let (n, d) = fraction(value.abs(), i32::MAX as u32);
        SRational { n: if value < 0.0 { -(n as i32) } else { n as i32 }, d: d as i32 }
    };
    values.iter().map(signed).collect()
}

fn fraction(value: f64, top: u32) -> (u32, u32) {
    let mut d = DENOMINATOR;
    while d > 1 && (value * f64::from(d)).round() > f64::from(top) {
        d /= 10;
    }
    let n = (value * f64::from(d)).round().min(f64::from(top)) as u32;
    let (mut a, mut b) = (n, d);
    while b != 0 {
        (a, b) = (b, a % b);
    }
    (n / a, d / a)
}

/// Bytes of TIFF type UNDEFINED.
struct Undefined<'a>(&'a [u8]);

impl TiffValue for Undefined<'_> {
    const BYTE_LEN: u8 = 1;
    const FIELD_TYPE: tiff::tags::Type = tiff::tags::Type::UNDEFINED;

    fn count(&self) -> usize {
        self.0.len()
    }

    fn data(&self) -> std::borrow::Cow<'_, [u8]> {
        self.0.into()
    }
}

/// TIFF text: printable ASCII, NUL-terminated and of even length, so that later offsets stay even.
struct Ascii(Vec<u8>);

impl Ascii {
    fn new(text: &str) -> Self {
        let printable = |c: char| if matches!(c, ' '..='~') { c as u8 } else { b'?' };
        let mut bytes: Vec<u8> = text.chars().map(printable).collect();
        bytes.resize((bytes.len() + 1).next_multiple_of(2), 0);
        Self(bytes)
    }
}

impl TiffValue for Ascii {
    const BYTE_LEN: u8 = 1;
    const FIELD_TYPE: tiff::tags::Type = tiff::tags::Type::ASCII;

    fn count(&self) -> usize {
        self.0.len()
    }

    fn data(&self) -> std::borrow::Cow<'_, [u8]> {
        self.0.as_slice().into()
    }
}
