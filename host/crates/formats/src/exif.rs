//! What EXIF says of how a picture is to be shown: its orientation and colour space (EXIF 2.32).

use super::ifd::Tiff;

/// Tags, EXIF 2.32 and the TIFF specification.
const ORIENTATION: u16 = 274;
const EXIF_DIRECTORY: u16 = 34_665;
const COLOUR_SPACE: u16 = 40_961;
const INTEROPERABILITY_DIRECTORY: u16 = 40_965;
const INTEROPERABILITY_INDEX: u16 = 1;

/// The colour space that EXIF names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Colours {
    /// None.
    #[default]
    Nothing,
    /// sRGB.
    Srgb,
    /// Adobe RGB: an uncalibrated space with the interoperability index R03 of DCF 2.0, or the
    /// number 2, which some cameras write.
    AdobeRgb,
    /// One that is not named.
    Uncalibrated,
}

/// The facts of EXIF that show how a picture looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Exif {
    /// Where row 0 and column 0 lie, 1 to 8; 1 is top and left.
    pub orientation: u8,
    /// Its colour space.
    pub colours: Colours,
}

impl Default for Exif {
    fn default() -> Self {
        Self { orientation: 1, colours: Colours::Nothing }
    }
}

impl Exif {
    /// Reads what a JPEG or PNG carries: a TIFF file without a picture, perhaps behind `Exif\0\0`.
    /// What cannot be read says nothing.
    pub fn read(bytes: &[u8]) -> Self {
        let bytes = bytes.strip_prefix(b"Exif\0\0").unwrap_or(bytes);
        Self::directories(bytes).unwrap_or_default()
    }

    fn directories(bytes: &[u8]) -> Option<Self> {
        let file = Tiff::open(bytes).ok()?;
        let first = file.ifd(file.first().ok()?).ok()?;
        let orientation = first.uint(ORIENTATION).filter(|n| (1..=8).contains(n)).unwrap_or(1);
        let exif = first.uint(EXIF_DIRECTORY).and_then(|at| file.ifd(at as usize).ok());
        let colours = exif.map_or(Colours::Nothing, |exif| {
            let index = exif
                .uint(INTEROPERABILITY_DIRECTORY)
                .and_then(|at| file.ifd(at as usize).ok()?.text(INTEROPERABILITY_INDEX));
            match (exif.uint(COLOUR_SPACE), index.as_deref()) {
                (None, _) => Colours::Nothing,
                (Some(1), _) => Colours::Srgb,
                (Some(2), _) | (_, Some("R03")) => Colours::AdobeRgb,
                _ => Colours::Uncalibrated,
            }
        });
        Some(Self { orientation: orientation as u8, colours })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A TIFF of one directory with these short fields.
    fn directory(at: u32, fields: &[(u16, u32)]) -> Vec<u8> {
        let mut bytes = (fields.len() as u16).to_le_bytes().to_vec();
        for (tag, value) in fields {
            bytes.extend(tag.to_le_bytes());
            bytes.extend(4u16.to_le_bytes());
            bytes.extend(1u32.to_le_bytes());
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend(0u32.to_le_bytes());
        debug_assert!(at as usize >= 8);
        bytes
    }

    #[test]
    fn orientation_and_colour_space_are_read() {
        let mut bytes = b"II\x2a\0\x08\0\0\0".to_vec();
        bytes.extend(directory(8, &[(ORIENTATION, 6), (EXIF_DIRECTORY, 38)]));
        assert_eq!(bytes.len(), 38);
        bytes.extend(directory(38, &[(COLOUR_SPACE, 65_535), (INTEROPERABILITY_DIRECTORY, 68)]));
        let mut adobe = bytes.clone();
        adobe.extend(b"\x01\0\x01\0\x02\0\x04\0\0\0R03\0\0\0\0\0");
        let exif = Exif::read(&[b"Exif\0\0", &adobe[..]].concat());
        assert_eq!(exif, Exif { orientation: 6, colours: Colours::AdobeRgb });
        assert_eq!(Exif::read(&bytes).colours, Colours::Uncalibrated);
        bytes[38 + 2 + 8] = 1;
        bytes[38 + 2 + 9] = 0;
        assert_eq!(Exif::read(&bytes).colours, Colours::Srgb);
        for end in 0..adobe.len() {
            Exif::read(&adobe[..end]);
        }
        assert_eq!(Exif::read(b"nothing"), Exif::default());
    }
}
