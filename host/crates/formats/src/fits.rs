//! FITS after the FITS Standard 4.0. Several frames are a third axis.
//!
//! Written is the primary image, 16 bits: unsigned samples are stored as signed ones with
//! BZERO = 32768 (section 5.2.5). Read is the first image of the file, primary or extension, plain
//! or compressed in tiles (section 10), of integers or floats of any size whose values are whole.
//! Keywords of camera programs that are understood: BAYERPAT (COLORTYP) with XBAYROFF and
//! YBAYROFF, ROWORDER, and what [`Taken`] holds. Written are EXPTIME, GAIN (1 is
//! unity), XPIXSZ and YPIXSZ where they are known, ROWORDER, and of a 2 x 2 pattern BAYERPAT. An
//! extension without one of these keywords takes it from a primary header without data
//! unless it says INHERIT = F (the INHERIT convention of the FITS registry), which a note says:
//! programs that compress an image move it behind such a header.
//!
//! The top row is stored first. The standard leaves the direction open; astronomical viewers show
//! the first row at the bottom, and ROWORDER = 'BOTTOM-UP' says that a file is made for them: its
//! rows are turned, and its pattern is that of the turned frame (Siril's documentation, "Row
//! order").

mod header;
mod rice;
mod tiles;

use self::header::Header;
use super::taken::ISO_OF_UNITY;
use super::{Facts, Frames, Taken, area, narrow, truncated};
use camrig_base::{Cfa, Error, Plane, Result};

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
    let facts = &frames.facts;
    let gain = facts.iso_to_say().map(|iso| iso / ISO_OF_UNITY);
    for (key, number) in
        [("EXPTIME", facts.exposure_to_say()), ("GAIN", gain), ("XPIXSZ", facts.pitch_to_say())]
    {
        if let Some(number) = number {
            value(key, &number.to_string());
        }
    }
    if let Some(pitch) = facts.pitch_to_say() {
        value("YPIXSZ", &pitch.to_string());
    }
    // Texts begin in column 11 and have eight characters at least (section 4.2.1.1).
    let mut text = |key: &str, text: &str| value(key, &format!("{:<20}", format!("'{text:<8}'")));
    text("ROWORDER", "TOP-DOWN");
    if let Some(cfa) = facts.cfa.as_ref().filter(|cfa| is_bayer(cfa)) {
        text("BAYERPAT", &cfa.to_string());
        value("XBAYROFF", "0");
        value("YBAYROFF", "0");
    }
    notes(&frames.facts.note()).into_iter().for_each(&mut card);
    card("END".into());
    let mut bytes = head.into_bytes();
    bytes.resize(bytes.len().next_multiple_of(BLOCK), b' ');
    for plane in &frames.planes {
        bytes.extend(plane.data.iter().flat_map(|dn| (dn ^ 0x8000).to_be_bytes()));
    }
    bytes.resize(bytes.len().next_multiple_of(BLOCK), 0);
    Ok(bytes)
}

/// Whether other programs know a pattern by its four letters.
fn is_bayer(cfa: &Cfa) -> bool {
    (cfa.width, cfa.height) == (2, 2) && cfa.letters.iter().all(|c| "RGB".contains(*c))
}

/// The cards of a note: several where it is too long for one, without words too long for a card,
/// which would be cut.
fn notes(note: &str) -> Vec<String> {
    let mut cards: Vec<String> = Vec::new();
    for word in note.split(' ').skip(1) {
        match cards.last_mut() {
            Some(card) if card.len() + 1 + word.len() <= CARD => *card += &format!(" {word}"),
            _ => cards.push(format!("COMMENT camrig {word}")),
        }
    }
    cards.retain(|card| card.len() <= CARD);
    if cards.is_empty() { vec!["COMMENT camrig".into()] } else { cards }
}

/// Reads the first image of FITS bytes, with BZERO and BSCALE applied.
///
/// # Errors
/// A damaged header, a file without images, values that are not DN from 0 to 65535, compressions
/// that lose values, data that are shorter than the header says.
pub fn decode(bytes: &[u8]) -> Result<Frames> {
    let mut rest = bytes;
    let mut facts = Facts::default();
    let mut found = None;
    let mut others = 0;
    let mut primary = None;
    while rest.len() >= BLOCK {
        let mut header = match Header::read(rest) {
            Ok(header) => header,
            Err(error) if found.is_none() => return Err(error),
            Err(_) => break, // what follows the image is none of ours
        };
        let data = &rest[header.bytes.min(rest.len())..];
        let length = header.data_bytes();
        if header.has_image() {
            if found.is_none() {
                facts = facts_of(&mut header, primary.as_ref());
                found = Some(planes(&header, data, &mut facts)?);
            } else {
                others += 1;
            }
        } else if rest.len() == bytes.len() {
            primary = Some(header);
        }
        let Ok(length) = length else { break };
        rest = data.get(length.next_multiple_of(BLOCK)..).unwrap_or(&[]);
    }
    if others > 0 {
        facts.notes.push(format!("the file has {others} more image(s), which are not read"));
    }
    let planes = found.ok_or_else(|| {
        Error::input("a FITS file without an image").help("is it a table, or truncated?")
    })?;
    Ok(Frames { planes, facts })
}

/// How the first image of a file was taken, from the headers alone.
pub fn taken(bytes: &[u8]) -> Result<Taken> {
    let (mut rest, mut primary) = (bytes, None);
    loop {
        let mut header = Header::read(rest)?;
        if header.has_image() {
            return Ok(facts_of(&mut header, primary.as_ref()).taken);
        }
        let length = header.bytes + header.data_bytes()?.next_multiple_of(BLOCK);
        rest = rest.get(length..).unwrap_or(&[]);
        primary.get_or_insert(header);
    }
}

/// What the header of an image says, and the primary header in front of it.
fn facts_of(header: &mut Header, primary: Option<&Header>) -> Facts {
    let mut facts = Facts::default();
    facts.notes.extend(primary.and_then(|primary| header.inherit(primary)));
    facts.taken = header.taken();
    header.comments.iter().for_each(|comment| facts.merge_note(comment));
    facts
}

/// The frames of an image.
fn planes(header: &Header, data: &[u8], facts: &mut Facts) -> Result<Vec<Plane<u16>>> {
    let image = header.image()?;
    let [width, height, count] = image.axes;
    let pixels = area(width, height)?;
    let total = pixels.saturating_mul(count);
    let stored = if header.is_compressed() {
        tiles::read(header, &image, data)?
    } else {
        let needed = total.saturating_mul(image.sample_bytes());
        if count == 0 || needed > data.len() {
            return Err(truncated(needed, data.len()));
        }
        image.values(&data[..needed])?
    };
    let samples = samples(&image, stored, facts)?;
    let mut planes: Vec<_> = samples
        .chunks_exact(pixels)
        .map(|data| Plane { width, height, data: data.to_vec() })
        .collect();
    let turned = header.text("ROWORDER").is_some_and(|t| t.eq_ignore_ascii_case("BOTTOM-UP"));
    if turned {
        for plane in &mut planes {
            plane.data = plane.data.rchunks(width).flatten().copied().collect();
        }
        facts.notes.push(
            "the rows are turned: the file stores the bottom row first (ROWORDER BOTTOM-UP)"
                .into(),
        );
    }
    if facts.cfa.is_none() {
        facts.cfa = pattern(header, turned, facts);
    }
    Ok(planes)
}

/// Values of an image, as they are stored.
enum Stored {
    Integers(Vec<i64>),
    Floats(Vec<f64>),
}

/// Samples below this in 16-bit words without BZERO are the upper half of unsigned words, not
/// negative: a quarter of the range. Signed data go below zero by their noise, by far less.
const UNSIGNED_BELOW: i64 = -16384;

/// The values with BZERO and BSCALE applied, as DN.
fn samples(image: &header::Image, stored: Stored, facts: &mut Facts) -> Result<Vec<u16>> {
    let help = |e: Error| e.at("FITS image");
    let values = match stored {
        Stored::Floats(values) => {
            let dn = |v: f64| narrow::float(image.bzero + image.bscale * v);
            return values.into_iter().map(dn).collect::<Result<_>>().map_err(help);
        }
        Stored::Integers(values) => values,
    };
    if let Some(blank) = image.blank
        && values.contains(&blank)
    {
        return Err(Error::unsupported("a FITS image with undefined pixels (BLANK)")
            .help("raw frames have a value at every pixel"));
    }
    let least = values.iter().copied().min().unwrap_or(0);
    if image.bitpix == 16 && !image.scaled && least < UNSIGNED_BELOW {
        facts.notes.push(format!(
            "16-bit samples down to {least} without BZERO: taken as unsigned, as the file's \
             writer left out BZERO = 32768"
        ));
        return Ok(values.into_iter().map(|v| v as i16 as u16).collect());
    }
    let dn = |v: i64| match (image.bzero, image.bscale) {
        (0.0, 1.0) => narrow::integer(v.into()),
        (bzero, bscale) => narrow::float(bzero + bscale * v as f64),
    };
    values.into_iter().map(dn).collect::<Result<_>>().map_err(help)
}

/// The colour filter pattern that camera programs write; a note where it is not understood.
fn pattern(header: &Header, turned: bool, facts: &mut Facts) -> Option<Cfa> {
    let text = header.text("BAYERPAT").or_else(|| header.text("COLORTYP"))?;
    let mut unknown = |why: String| {
        facts.notes.push(format!("the colour filter pattern is not taken over: {why}"));
        None
    };
    let bayer = Cfa::parse(text.trim()).ok().filter(|c| (c.width, c.height) == (2, 2));
    let Some(mut cfa) = bayer else { return unknown(format!("BAYERPAT = {text:?}")) };
    let offset = |key: &str| header.number(key).unwrap_or(0.0);
    let (right, down) = (offset("XBAYROFF"), offset("YBAYROFF"));
    if right.fract() != 0.0 || down.fract() != 0.0 || (turned && down % 2.0 != 0.0) {
        return unknown(format!("XBAYROFF = {right}, YBAYROFF = {down}, in rows that are turned"));
    }
    let odd = |v: f64| v.rem_euclid(2.0) as usize;
    let at = |i: usize| cfa.letter(i % 2 + odd(right), i / 2 + odd(down));
    let letters = (0..4).map(at).collect();
    cfa.letters = letters;
    let order = header.text("ROWORDER").map(str::trim);
    if !turned && order.is_none_or(|order| !order.eq_ignore_ascii_case("TOP-DOWN")) {
        let order = order.map_or("no ROWORDER".into(), |order| format!("ROWORDER = {order:?}"));
        facts.notes.push(format!(
            "the file has the pattern {} and {order}: the row stored first is taken as the top \
             one; if it is the bottom one, the pattern is another",
            text.trim()
        ));
    }
    Some(cfa)
}

#[cfg(test)]
mod tests;
