//! Portable grey map `P5`, after netpbm's pgm(5): with a maximum above 255 samples take two bytes,
//! big-endian. Several images may follow one another. The bits are those of the maximum value.

use super::{Facts, Frames, area, check_range, full_scale, truncated};
use camrig_base::{Error, Plane, Result};

/// Frames as PGM bytes, one image after another.
///
/// # Errors
/// Samples beyond the bits.
pub fn encode(frames: &Frames) -> Result<Vec<u8>> {
    let bits = frames.facts.bits.unwrap_or(16);
    let top = full_scale(bits);
    let mut bytes = Vec::new();
    for plane in &frames.planes {
        check_range(&plane.data, bits)?;
        let note = frames.facts.note();
        let head = format!("P5\n# {note}\n{} {}\n{top}\n", plane.width, plane.height);
        bytes.extend(head.into_bytes());
        if top < 256 {
            bytes.extend(plane.data.iter().map(|&dn| dn as u8));
        } else {
            bytes.extend(plane.data.iter().flat_map(|dn| dn.to_be_bytes()));
        }
    }
    Ok(bytes)
}

/// Reads PGM bytes.
///
/// # Errors
/// A damaged header, images of different sizes, a file shorter than its headers say.
pub fn decode(mut bytes: &[u8]) -> Result<Frames> {
    let mut frames = Frames { planes: Vec::new(), facts: Facts::default() };
    while !bytes.is_empty() {
        let mut header = Header { bytes, facts: &mut frames.facts };
        header.magic()?;
        let (width, height, top) = (header.number()?, header.number()?, header.number()?);
        // Exactly one white space separates the maximum from the samples.
        let data = header.bytes.get(1..).unwrap_or(&[]);
        let pixels = area(width, height)?;
        if !(1..=65535).contains(&top) {
            return Err(Error::input(format!("PGM maximum {top}")).help("it is 1 to 65535"));
        }
        let sample_size = if top < 256 { 1 } else { 2 };
        let needed = pixels.saturating_mul(sample_size);
        if data.len() < needed {
            return Err(truncated(needed, data.len()));
        }
        let (samples, rest) = data.split_at(needed);
        let data = match sample_size {
            1 => samples.iter().map(|&b| u16::from(b)).collect(),
            _ => samples.chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]])).collect(),
        };
        if frames.planes.first().is_some_and(|p| (p.width, p.height) != (width, height)) {
            return Err(Error::unsupported("images of different sizes in one PGM file"));
        }
        frames.planes.push(Plane { width, height, data });
        frames.facts.bits = frames.facts.bits.or(Some(usize::BITS - top.leading_zeros()));
        bytes = rest;
    }
    if frames.planes.is_empty() {
        return Err(Error::input("an empty file"));
    }
    Ok(frames)
}

struct Header<'a, 'f> {
    bytes: &'a [u8],
    facts: &'f mut Facts,
}

impl Header<'_, '_> {
    fn magic(&mut self) -> Result<()> {
        self.bytes = self
            .bytes
            .strip_prefix(b"P5")
            .ok_or_else(|| Error::input("not a binary PGM image").help("it must begin with P5"))?;
        Ok(())
    }

    /// The next number after white space and comments; camrig's own comment carries the facts.
    fn number(&mut self) -> Result<usize> {
        loop {
            match self.bytes {
                [b'#', ..] => {
                    let end = self.bytes.iter().position(|&b| b == b'\n');
                    let (comment, rest) = self.bytes.split_at(end.unwrap_or(self.bytes.len()));
                    self.facts.merge_note(&String::from_utf8_lossy(&comment[1..]));
                    self.bytes = rest;
                }
                [b, rest @ ..] if b.is_ascii_whitespace() => self.bytes = rest,
                _ => break,
            }
        }
        let digits = self.bytes.iter().take_while(|b| b.is_ascii_digit()).count();
        let (text, rest) = self.bytes.split_at(digits);
        self.bytes = rest;
        std::str::from_utf8(text)
            .ok()
            .and_then(|t| t.parse().ok())
            .ok_or_else(|| Error::input("PGM header: width, height and maximum expected"))
    }
}
