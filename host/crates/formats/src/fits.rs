//! FITS: the primary image, 16 bits, after the FITS Standard 4.0. Unsigned samples are stored
//! as signed ones with BZERO = 32768 (section 5.2.5). Several frames are a third axis.
//!
//! The top row is stored first. The standard leaves the direction open; astronomical viewers show
//! the first row at the bottom.

use super::{Facts, Frames, area, truncated};
use camrig_base::{Error, Plane, Result};

/// Bytes of a header card (section 3.3.1).
const CARD: usize = 80;
/// Bytes of a block, to which header and data are padded (section 3.1).
const BLOCK: usize = 2880;

/// Frames as FITS bytes.
pub fn encode(frames: &Frames) -> Result<Vec<u8>> {
    let (width, height, count) = (frames.width(), frames.height(), frames.planes.len());
    let mut head = String::new();
    let mut card = |text: String| head.push_str(&format!("{text:<CARD$.CARD$}"));
    let mut value = |key: &str, value: &str| card(format!("{key:<8}= {value:>20}"));
    value("SIMPLE", "T");
    value("BITPIX", "16");
    value("NAXIS", if count == 1 { "2" } else { "3" });
    value("NAXIS1", &width.to_string());
    value("NAXIS2", &height.to_string());
    if count > 1 {
        value("NAXIS3", &count.to_string());
    }
    value("BZERO", "32768");
    value("BSCALE", "1");
    card(format!("COMMENT {}", frames.facts.note()));
    card("END".into());
    let mut bytes = head.into_bytes();
    bytes.resize(bytes.len().next_multiple_of(BLOCK), b' ');
    for plane in &frames.planes {
        bytes.extend(plane.data.iter().flat_map(|dn| (dn ^ 0x8000).to_be_bytes()));
    }
    bytes.resize(bytes.len().next_multiple_of(BLOCK), 0);
    Ok(bytes)
}

/// Reads the primary image of FITS bytes, of 8 or 16 bits, with BZERO and BSCALE applied.
///
/// # Errors
/// A header without END, other types of samples, values that are not DN from 0 to 65535, data that
/// are shorter than the header says.
pub fn decode(bytes: &[u8]) -> Result<Frames> {
    let mut header = Header::default();
    let mut facts = Facts::default();
    let mut cards = bytes.chunks(CARD);
    let mut used = 0;
    loop {
        let card = cards.next().filter(|c| c.len() == CARD);
        let card =
            card.ok_or_else(|| Error::input("a FITS header without END").help("truncated?"))?;
        used += CARD;
        let text = String::from_utf8_lossy(card);
        let (key, rest) = text.split_at_checked(8).unwrap_or((&text, ""));
        match key.trim_end() {
            "END" => break,
            "COMMENT" => facts.merge_note(rest),
            key => header.take(key, rest)?,
        }
    }
    let [width, height, count] = header.axes;
    let sample_size = match header.bitpix {
        8 => 1,
        16 => 2,
        other => {
            return Err(Error::unsupported(format!("FITS BITPIX {other}"))
                .help("images of 8 or 16 bits are read"));
        }
    };
    let pixels = area(width, height)?;
    let data = &bytes[used.next_multiple_of(BLOCK).min(bytes.len())..];
    let frame_bytes = pixels.saturating_mul(sample_size);
    let needed = frame_bytes.saturating_mul(count);
    if count == 0 || needed > data.len() {
        return Err(truncated(needed, data.len()));
    }
    let sample = |b: &[u8]| {
        let stored = match *b {
            [a] => f64::from(a),
            [a, b] => f64::from(i16::from_be_bytes([a, b])),
            _ => f64::NAN, // chunks_exact gives no other sizes
        };
        let dn = header.bzero + header.bscale * stored;
        if dn.fract() != 0.0 || !(0.0..=65535.0).contains(&dn) {
            return Err(Error::input(format!("FITS value {dn}")).help("raw DN are 0 to 65535"));
        }
        Ok(dn as u16)
    };
    let planes = data[..needed]
        .chunks_exact(frame_bytes)
        .map(|frame| {
            let data = frame.chunks_exact(sample_size).map(sample).collect::<Result<_>>()?;
            Ok(Plane { width, height, data })
        })
        .collect::<Result<_>>()?;
    Ok(Frames { planes, facts })
}

/// The keywords that describe the data.
struct Header {
    bitpix: i64,
    naxis: i64,
    axes: [usize; 3],
    bzero: f64,
    bscale: f64,
}

impl Default for Header {
    fn default() -> Self {
        Self { bitpix: 0, naxis: 0, axes: [0, 0, 1], bzero: 0.0, bscale: 1.0 }
    }
}

impl Header {
    fn take(&mut self, key: &str, rest: &str) -> Result<()> {
        let value = rest.strip_prefix("= ").unwrap_or("").split('/').next().unwrap_or("").trim();
        let bad = || Error::input(format!("FITS keyword {key}: {value:?}"));
        let integer = || value.parse::<i64>().map_err(|_| bad());
        // The standard allows D for the exponent.
        let real = || value.replace('D', "E").parse::<f64>().map_err(|_| bad());
        match key {
            "BITPIX" => self.bitpix = integer()?,
            "NAXIS" => {
                self.naxis = integer()?;
                if !(2..=3).contains(&self.naxis) {
                    return Err(bad().help("the primary image has two axes, or three for a stack"));
                }
            }
            "NAXIS1" | "NAXIS2" | "NAXIS3" => {
                let axis = usize::from(key.as_bytes()[5] - b'1');
                self.axes[axis] = usize::try_from(integer()?).map_err(|_| bad())?;
            }
            "BZERO" => self.bzero = real()?,
            "BSCALE" => self.bscale = real()?,
            _ => {}
        }
        Ok(())
    }
}
