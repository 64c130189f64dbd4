//! Headers of FITS units: cards of keyword and value (FITS Standard 4.0, chapter 4).

use super::{BLOCK, CARD, Stored};
use crate::{Said, Taken, truncated};
use camrig_base::{Error, Result};
use std::collections::BTreeMap;

/// Keywords that an extension takes over from a primary header without data, with their synonyms:
/// one of them in the extension replaces all.
const INHERITED: [&[&str]; 10] = [
    &["BAYERPAT", "COLORTYP"],
    &["XBAYROFF"],
    &["YBAYROFF"],
    &["ROWORDER"],
    &["EXPTIME", "EXPOSURE"],
    &["CCD-TEMP"],
    &["XPIXSZ"],
    &["IMAGETYP", "FRAME"],
    &["GAIN"],
    &["EGAIN"],
];

/// The header of one unit.
#[derive(Default)]
pub(super) struct Header {
    values: BTreeMap<String, String>,
    /// Texts of its COMMENT cards.
    pub comments: Vec<String>,
    /// Bytes of the header with its padding.
    pub bytes: usize,
}

/// How an image is stored.
pub(super) struct Image {
    /// Bits per value, negative for floats.
    pub bitpix: i64,
    /// Width, height and number of frames.
    pub axes: [usize; 3],
    pub bzero: f64,
    pub bscale: f64,
    /// Whether the header has BZERO or BSCALE.
    pub scaled: bool,
    /// The integer that marks an undefined pixel.
    pub blank: Option<i64>,
}

impl Header {
    /// Reads the header at the start of `bytes`.
    pub fn read(bytes: &[u8]) -> Result<Self> {
        let mut header = Self::default();
        for (index, card) in bytes.chunks_exact(CARD).enumerate() {
            let text = String::from_utf8_lossy(card);
            let (key, rest) = text.split_at_checked(8).unwrap_or((&text, ""));
            match key.trim_end() {
                "END" => {
                    header.bytes = ((index + 1) * CARD).next_multiple_of(BLOCK);
                    return Ok(header);
                }
                "COMMENT" => header.comments.push(rest.trim().to_string()),
                key => {
                    if let Some(value) = rest.strip_prefix("= ") {
                        header.values.entry(key.to_string()).or_insert_with(|| value_of(value));
                    }
                }
            }
        }
        Err(Error::input("a FITS header without END").help("truncated?"))
    }

    /// Takes over what an extension lacks from a primary header without data; a note of what that
    /// is.
    pub fn inherit(&mut self, primary: &Self) -> Option<String> {
        if self.text("INHERIT") == Some("F") {
            return None;
        }
        // The extension's own come last, so that they prevail.
        self.comments.splice(0..0, primary.comments.iter().cloned());
        let mut taken = Vec::new();
        for synonyms in INHERITED {
            if synonyms.iter().any(|key| self.values.contains_key(*key)) {
                continue;
            }
            for &key in synonyms {
                if let Some(value) = primary.text(key) {
                    self.values.insert(key.into(), value.into());
                    taken.push(key);
                }
            }
        }
        (!taken.is_empty()).then(|| {
            format!(
                "{}: from the file's primary header, as the image's has none",
                taken.join(", ")
            )
        })
    }

    fn bad(&self, key: &str) -> Error {
        let value = self.values.get(key).map_or("", |v| v.as_str());
        Error::input(format!("FITS keyword {key}: {value:?}"))
    }

    /// The text of a keyword.
    pub fn text(&self, key: &str) -> Option<&str> {
        self.values.get(key).map(|v| v.as_str())
    }

    /// A number, `None` where the keyword is missing or no number.
    pub fn number(&self, key: &str) -> Option<f64> {
        // The standard allows D for the exponent.
        self.text(key)?.replace('D', "E").parse().ok()
    }

    /// An integer that the image needs.
    pub fn integer(&self, key: &str) -> Result<i64> {
        self.text(key).and_then(|v| v.parse().ok()).ok_or_else(|| self.bad(key))
    }

    /// A length that the image needs.
    pub fn length(&self, key: &str) -> Result<usize> {
        usize::try_from(self.integer(key)?).map_err(|_| self.bad(key))
    }

    /// A number with its value where the keyword is missing.
    fn real(&self, key: &str, missing: f64) -> Result<f64> {
        match self.text(key) {
            None => Ok(missing),
            Some(_) => self.number(key).filter(|v| v.is_finite()).ok_or_else(|| self.bad(key)),
        }
    }

    /// How the frames were taken, by the keywords of camera programs (MaxIm DL's list, which
    /// N.I.N.A., SharpCap and others follow): s, °C and µm. GAIN is in units of each camera's own.
    pub fn taken(&self) -> Taken {
        let said = |keys: &[&str]| {
            keys.iter().find_map(|key| Some(Said::new(self.number(key)?, format!("FITS {key}"))))
        };
        let kind = self.text("IMAGETYP").or_else(|| self.text("FRAME"));
        let own = ["GAIN", "EGAIN"].into_iter();
        let remarks = own.filter_map(|key| Some(format!("{key} = {}", self.text(key)?)));
        Taken {
            exposure_s: said(&["EXPTIME", "EXPOSURE"]),
            temperature_c: said(&["CCD-TEMP"]),
            pitch_um: said(&["XPIXSZ"]),
            kind: kind.map(|kind| Said::new(kind.trim().to_string(), "FITS IMAGETYP")),
            remarks: remarks.collect(),
            ..Taken::default()
        }
    }

    /// Whether the unit is a table that holds an image compressed in tiles.
    pub fn is_compressed(&self) -> bool {
        self.text("ZIMAGE") == Some("T")
    }

    /// Whether the unit holds an image.
    pub fn has_image(&self) -> bool {
        let kind = self.text("XTENSION").map_or("IMAGE", str::trim);
        let empty = self.text("NAXIS").is_none_or(|n| n == "0");
        self.is_compressed() || (kind == "IMAGE" && !empty)
    }

    /// Bytes of the unit's data without padding (section 4.4.1.1, eq. 1 and 2).
    pub fn data_bytes(&self) -> Result<usize> {
        let axes = self.length("NAXIS")?;
        if axes == 0 {
            return Ok(0);
        }
        let values = (1..=axes.min(999)).try_fold(1usize, |product, axis| {
            Ok::<_, Error>(product.saturating_mul(self.length(&format!("NAXIS{axis}"))?))
        })?;
        let heap = self.length("PCOUNT").unwrap_or(0);
        let groups = self.length("GCOUNT").unwrap_or(1);
        let size = self.integer("BITPIX")?.unsigned_abs() as usize / 8;
        let bytes = values.saturating_add(heap).saturating_mul(groups).saturating_mul(size);
        // Room for the padding to the next block.
        Ok(bytes.min(isize::MAX as usize))
    }

    /// Refuses planes of red, green and blue, which are a developed picture, not three frames.
    fn check_colours(&self, axes: [usize; 3]) -> Result<()> {
        let rgb = |key: &str| self.text(key).is_some_and(|t| t.trim().eq_ignore_ascii_case("RGB"));
        let of_axis = (1..).zip(axes).filter(|(_, length)| *length == 3);
        let mut keys: Vec<String> = of_axis.map(|(axis, _)| format!("CTYPE{axis}")).collect();
        if axes[2] == 3 {
            keys.push("COLORTYP".into());
        }
        match keys.into_iter().find(|key| rgb(key)) {
            None => Ok(()),
            Some(key) => Err(Error::unsupported("a FITS image of colour planes (RGB)")
                .at(format!("FITS keyword {key}"))
                .help(
                    "developed colours are not raw: save the frame before its colours are \
                     interpolated, or each plane as an image of its own if they are frames",
                )),
        }
    }

    /// How the image is stored.
    pub fn image(&self) -> Result<Image> {
        let z = if self.is_compressed() { "Z" } else { "" };
        let naxis = self.length(&format!("{z}NAXIS"))?;
        if !(2..=999).contains(&naxis) {
            let error = self.bad(&format!("{z}NAXIS"));
            return Err(error.help("an image has two axes, a stack three"));
        }
        let mut axes = [0, 0, 1];
        for axis in 0..naxis {
            let key = format!("{z}NAXIS{}", axis + 1);
            let length = self.length(&key)?;
            match axes.get_mut(axis) {
                Some(place) => *place = length,
                None if length == 1 => {}
                None => {
                    let error = self.bad(&key);
                    return Err(
                        error.help("an image has two axes, a stack three, others one value")
                    );
                }
            }
        }
        self.check_colours(axes)?;
        let bitpix = self.integer(&format!("{z}BITPIX"))?;
        if !matches!(bitpix, 8 | 16 | 32 | 64 | -32 | -64) {
            return Err(self.bad(&format!("{z}BITPIX")).help("it is 8, 16, 32, 64, -32 or -64"));
        }
        let blank = self.text("BLANK").or_else(|| self.text("ZBLANK"));
        Ok(Image {
            bitpix,
            axes,
            bzero: self.real("BZERO", 0.0)?,
            bscale: self.real("BSCALE", 1.0)?,
            scaled: self.text("BZERO").is_some() || self.text("BSCALE").is_some(),
            blank: blank.and_then(|v| v.parse().ok()),
        })
    }
}

/// The value of a card, without its comment; of a text, without its quotes.
fn value_of(text: &str) -> String {
    let text = text.trim_start();
    let Some(quoted) = text.strip_prefix('\'') else {
        return text.split('/').next().unwrap_or("").trim().to_string();
    };
    // A quote within the text is doubled.
    let quoted = quoted.replace("''", "\0");
    let value = quoted.split('\'').next().unwrap_or("");
    value.replace('\0', "'").trim_end().to_string()
}

impl Image {
    /// Bytes per value.
    pub fn sample_bytes(&self) -> usize {
        self.bitpix.unsigned_abs() as usize / 8
    }

    /// The values in some bytes, most significant byte first.
    pub fn values(&self, bytes: &[u8]) -> Result<Stored> {
        let size = self.sample_bytes();
        if !bytes.len().is_multiple_of(size) {
            return Err(truncated(bytes.len().next_multiple_of(size), bytes.len()));
        }
        let word = |b: &[u8]| b.iter().fold(0u64, |w, &b| w << 8 | u64::from(b));
        let words = bytes.chunks_exact(size).map(word);
        Ok(match self.bitpix {
            8 => Stored::Integers(words.map(|w| w as i64).collect()),
            16 => Stored::Integers(words.map(|w| i64::from(w as i16)).collect()),
            32 => Stored::Integers(words.map(|w| i64::from(w as i32)).collect()),
            -32 => Stored::Floats(words.map(|w| f32::from_bits(w as u32).into()).collect()),
            -64 => Stored::Floats(words.map(f64::from_bits).collect()),
            _ => Stored::Integers(words.map(|w| w as i64).collect()),
        })
    }
}
