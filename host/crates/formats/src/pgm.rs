//! Portable grey maps, after netpbm's pgm(5) and pam(5): `P5` (binary), `P2` (in figures) and `P7`
//! (arbitrary map of one channel). With a maximum above 255 binary samples take two bytes,
//! big-endian. Several images may follow one another. The bits are those of the maximum value,
//! which is the white level where it is not all that these bits hold.

use super::{Facts, Frames, area, check_range, full_scale, truncated};
use camrig_base::{Error, Plane, Result};

/// Frames as `P5` bytes, one image after another.
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

/// Reads PGM and PAM bytes.
///
/// # Errors
/// A damaged header, images of several channels or of different sizes, samples above the maximum,
/// a file shorter than its headers say.
pub fn decode(bytes: &[u8]) -> Result<Frames> {
    let mut frames = Frames { planes: Vec::new(), facts: Facts::default() };
    let mut bytes = bytes.trim_ascii_start();
    let mut maxima = Vec::new();
    while !bytes.is_empty() {
        let mut reader = Reader { bytes, facts: &mut frames.facts };
        let image = reader.image()?;
        // Some writers end an image with a newline.
        bytes = reader.bytes.trim_ascii_start();
        let (plane, top) = image;
        let size = (plane.width, plane.height);
        if frames.planes.first().is_some_and(|p| (p.width, p.height) != size) {
            return Err(Error::unsupported("images of different sizes in one PGM file"));
        }
        frames.planes.push(plane);
        maxima.push(top);
    }
    let Some(&top) = maxima.iter().max() else { return Err(Error::input("an empty file")) };
    levels(&mut frames.facts, top, maxima.iter().any(|other| *other != top));
    Ok(frames)
}

/// What the largest of the images' maxima says, where camrig's note does not.
fn levels(facts: &mut Facts, top: usize, differ: bool) {
    let bits = usize::BITS - top.leading_zeros();
    facts.bits = facts.bits.or(Some(bits));
    if differ {
        facts.notes.push(format!(
            "the images have different maxima: the largest, {top}, counts for all, and samples \
             stay as they are"
        ));
    }
    if facts.white_level_dn.is_none() && top != usize::from(full_scale(bits)) {
        facts.white_level_dn = Some(top as u16);
        facts.notes.push(format!(
            "samples go up to {top} by the header: that is taken as the white level, at which \
             they saturate (--white says another)"
        ));
    }
}

struct Reader<'a, 'f> {
    bytes: &'a [u8],
    facts: &'f mut Facts,
}

impl Reader<'_, '_> {
    /// The next image, and its maximum value.
    fn image(&mut self) -> Result<(Plane<u16>, usize)> {
        let magic = self.bytes.get(..2).unwrap_or(b"");
        self.bytes = self.bytes.get(2..).unwrap_or(b"");
        let (width, height, top) = match magic {
            b"P2" | b"P5" => (self.number()?, self.number()?, self.number()?),
            b"P7" => self.pam_header()?,
            _ => {
                return Err(Error::input("not a grey PGM or PAM image")
                    .help("it must begin with P2, P5 or P7"));
            }
        };
        let pixels = area(width, height)?;
        if !(1..=65535).contains(&top) {
            return Err(Error::input(format!("PGM maximum {top}")).help("it is 1 to 65535"));
        }
        let data = match magic {
            b"P2" => self.figures(pixels)?,
            _ => {
                let sample_size = if top < 256 { 1 } else { 2 };
                let needed = pixels.saturating_mul(sample_size);
                if magic == b"P5" {
                    self.separator(needed);
                }
                self.binary(needed, sample_size)?
            }
        };
        if let Some(above) = data.iter().find(|&&dn| usize::from(dn) > top) {
            return Err(Error::input(format!("DN {above} above the PGM maximum {top}"))
                .help("the file is damaged, or its header is of another one"));
        }
        Ok((Plane { width, height, data }, top))
    }

    /// Skips what separates the maximum from `needed` bytes of samples. By the standard that is
    /// exactly one white space. Some writers end the lines of the header with CR LF: that is taken
    /// as one where there is a byte too many otherwise.
    fn separator(&mut self, needed: usize) {
        let behind = self.bytes.get(needed.saturating_add(2)..).map(<[u8]>::trim_ascii_start);
        let whole = behind.is_some_and(|rest| rest.is_empty() || rest.starts_with(b"P"));
        let skipped = if self.bytes.starts_with(b"\r\n") && whole {
            let note =
                "the header's lines end with CR LF: both are taken as the end of the header";
            if !self.facts.notes.iter().any(|n| n == note) {
                self.facts.notes.push(note.into());
            }
            2
        } else {
            1
        };
        self.bytes = self.bytes.get(skipped..).unwrap_or(b"");
    }

    fn binary(&mut self, needed: usize, sample_size: usize) -> Result<Vec<u16>> {
        if self.bytes.len() < needed {
            return Err(truncated(needed, self.bytes.len()));
        }
        let (samples, rest) = self.bytes.split_at(needed);
        self.bytes = rest;
        Ok(match sample_size {
            1 => samples.iter().map(|&b| u16::from(b)).collect(),
            _ => samples.chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]])).collect(),
        })
    }

    /// Samples in figures; each takes two bytes at least, the last one.
    fn figures(&mut self, pixels: usize) -> Result<Vec<u16>> {
        if pixels > self.bytes.len().div_ceil(2) {
            return Err(truncated(2 * pixels, self.bytes.len()));
        }
        let sample = |_| {
            let value = self.number()?;
            u16::try_from(value).map_err(|_| {
                Error::input(format!("PGM sample {value}")).help("samples are 0 to 65535")
            })
        };
        (0..pixels).map(sample).collect()
    }

    /// Width, height and maximum of the lines of a PAM header.
    fn pam_header(&mut self) -> Result<(usize, usize, usize)> {
        let (mut width, mut height, mut depth, mut top) = (0, 0, 0, 0);
        loop {
            let end = self.bytes.iter().position(|&b| b == b'\n');
            let end = end.ok_or_else(|| Error::input("a PAM header without ENDHDR"))?;
            let line = String::from_utf8_lossy(&self.bytes[..end]).into_owned();
            self.bytes = &self.bytes[end + 1..];
            if let Some(comment) = line.strip_prefix('#') {
                self.facts.merge_note(comment);
                continue;
            }
            let (key, value) = line.trim().split_once(char::is_whitespace).unwrap_or((&line, ""));
            let number = || {
                value.trim().parse::<usize>().map_err(|_| {
                    Error::input(format!("PAM header: {key} {value:?}"))
                        .help("a whole number expected")
                })
            };
            match key.trim() {
                "ENDHDR" => break,
                "WIDTH" => width = number()?,
                "HEIGHT" => height = number()?,
                "DEPTH" => depth = number()?,
                "MAXVAL" => top = number()?,
                _ => {} // TUPLTYPE: one channel is grey whatever it is called
            }
        }
        if depth != 1 {
            return Err(Error::unsupported(format!("a PAM image of {depth} channels"))
                .help("raw frames have one"));
        }
        Ok((width, height, top))
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
            .ok_or_else(|| Error::input("PGM: a number expected").help("truncated?"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(bytes: &[u8]) -> String {
        match decode(bytes) {
            Ok(f) => {
                let planes: Vec<&[u16]> = f.planes.iter().map(|p| &p.data[..]).collect();
                format!("{} {} {:?} {planes:?}", f.width(), f.height(), f.facts.bits)
            }
            Err(e) => e.to_string(),
        }
    }

    #[test]
    fn the_kinds_of_grey_map_are_read() {
        let expected = "2 1 Some(10) [[5, 1023]]";
        assert_eq!(read(b"P2\n# figures\n2 1\n1023\n5 1023\n"), expected);
        assert_eq!(read(b"P2 2 1 1023 5 1023"), expected);
        assert_eq!(read(b"P5\n2 1\n1023\n\x00\x05\x03\xff\n"), expected);
        let pam = b"P7\nWIDTH 2\n# a line\nHEIGHT 1\nDEPTH 1\nMAXVAL 1023\nTUPLTYPE GRAYSCALE\n\
                    ENDHDR\n\x00\x05\x03\xff";
        assert_eq!(read(pam), expected);
        let two = b"P5 1 1 255\n\x20\nP5 1 1 255\n\x0a";
        assert_eq!(read(two), "1 1 Some(8) [[32], [10]]");
    }

    /// A line feed behind CR is the first sample where the file's size says so.
    #[test]
    fn headers_of_cr_lf_lines_are_read() {
        let crlf = b"P5\r\n2 1\r\n255\r\n\x05\x20";
        assert_eq!(read(crlf), "2 1 Some(8) [[5, 32]]");
        assert_eq!(read(&[&crlf[..], crlf].concat()), "2 1 Some(8) [[5, 32], [5, 32]]");
        let notes = decode(&[&crlf[..], crlf].concat()).unwrap().facts.notes;
        assert!(notes.len() == 1 && notes[0].contains("CR LF"), "{notes:?}");
        assert_eq!(read(b"P5 2 1 255\r\x0a\x05"), "2 1 Some(8) [[10, 5]]");
        assert_eq!(read(b"P5\r\n2 1\r\n1023\r\n\0\x05\x03\xff"), "2 1 Some(10) [[5, 1023]]");
    }

    /// netpbm: the maximum is white.
    #[test]
    fn a_maximum_below_what_its_bits_hold_is_the_white_level() {
        let facts = |bytes: &[u8]| decode(bytes).unwrap().facts;
        let found = facts(b"P2 2 1 1000 5 1000");
        assert_eq!((found.bits, found.white_level_dn), (Some(10), Some(1000)));
        assert!(found.notes[0].contains("up to 1000"), "{:?}", found.notes);
        let noted = facts(b"P2\n# camrig bits=12 white=900\n2 1 1000 5 1000");
        assert_eq!((noted.bits, noted.white_level_dn), (Some(12), Some(900)));
        let full = facts(b"P2 2 1 1023 5 1000");
        assert_eq!((full.white_level_dn, full.notes), (None, vec![]));
        let two = facts(b"P2 1 1 255 5\nP2 1 1 4000 6");
        assert_eq!((two.bits, two.white_level_dn), (Some(12), Some(4000)));
        assert!(two.notes[0].contains("different maxima"), "{:?}", two.notes);
    }

    #[test]
    fn what_is_no_grey_map_is_refused() {
        for (bytes, said) in [
            (&b"P7\nWIDTH 1\nHEIGHT 1\nDEPTH 3\nMAXVAL 255\nENDHDR\n123"[..], "3 channels"),
            (b"P7\nWIDTH 1\n", "ENDHDR"),
            (b"P2 99999999 99999999 255 1", "truncated"),
            (b"P2 2 1 255 1", "truncated"),
            (b"P2 2 1 255 1 x", "number expected"),
            (b"P2 1 1 255 256", "256 above"),
            (b"P5 1 1 100\n\xff", "255 above"),
            (b"P5 1 1 255\n\x01junk", "P2, P5 or P7"),
        ] {
            assert!(read(bytes).contains(said), "{}", read(bytes));
        }
    }
}
