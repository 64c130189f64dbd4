//! High dynamic range as sensors read it out: two exposures of one scene in one raw frame.

use camrig_base::Cfa;
use camrig_base::{Error, RawFrame, Result};

/// How long and short exposures share a frame. The long one is the frame's exposure, the short one
/// a `ratio`-th of it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Hdr {
    /// Every pixel is exposed once: pairs of rows of the filter pattern are long and short in
    /// turn, the first pair long (interleaved or "zigzag-free" row HDR). The frame keeps its size.
    Rows {
        /// Long over short exposure.
        ratio: f64,
    },
    /// Every pixel is exposed twice, one after the other, and rows leave the sensor in turn: long
    /// row y, then short row y − `offset` (digital overlap, staggered HDR). The frame has twice
    /// the rows; rows of the short exposure that are not there yet, or no more, hold the black
    /// level.
    Staggered {
        /// Long over short exposure.
        ratio: f64,
        /// Rows by which the short exposure is read later; a multiple of the pattern's height.
        offset: usize,
    },
}

impl Hdr {
    /// Reads `rows:16`, `staggered:16` or `staggered:16:32` (the offset in rows).
    pub fn parse(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "{text:?}: use rows:RATIO, staggered:RATIO or staggered:RATIO:OFFSET, e.g. \
                 staggered:16:32"
            )
        };
        let mut parts = text.split(':');
        let form = parts.next().unwrap_or_default();
        let ratio = parts.next().and_then(|r| r.parse::<f64>().ok()).filter(|r| *r > 1.0);
        let ratio = ratio.filter(|r| r.is_finite()).ok_or_else(wrong)?;
        let offset = parts.next().map(str::parse::<usize>);
        match (form, offset, parts.next()) {
            ("rows", None, None) => Ok(Self::Rows { ratio }),
            ("staggered", offset, None) => {
                let offset = offset.unwrap_or(Ok(0)).map_err(|_| wrong())?;
                Ok(Self::Staggered { ratio, offset })
            }
            _ => Err(wrong()),
        }
    }

    /// Long over short exposure.
    pub fn ratio(&self) -> f64 {
        match *self {
            Self::Rows { ratio } | Self::Staggered { ratio, .. } => ratio,
        }
    }

    /// Whether each pixel is read twice, the long exposure first.
    pub fn reads_twice(&self) -> bool {
        matches!(self, Self::Staggered { .. })
    }

    /// Frame numbers of the long and the short exposure of frame `frame`: a pixel that is read
    /// twice has new temporal noise the second time.
    pub fn frames(&self, frame: u32) -> [u32; 2] {
        match self {
            Self::Rows { .. } => [frame, frame],
            Self::Staggered { .. } => {
                [frame.wrapping_mul(2), frame.wrapping_mul(2).wrapping_add(1)]
            }
        }
    }

    /// Puts the two exposures into one frame.
    ///
    /// # Errors
    /// An offset that would put the filter pattern out of step.
    pub fn interleave(&self, long: &RawFrame, short: &RawFrame) -> Result<RawFrame> {
        let (width, height, period) = (long.width, long.height, long.cfa.height);
        let row = |frame: &RawFrame, y: usize| frame.data[y * width..(y + 1) * width].to_vec();
        match *self {
            Self::Rows { .. } => {
                // A mono sensor has a pattern of one row; pairs of rows stay the unit.
                let unit = period.max(2);
                let of = |y: usize| if (y / unit).is_multiple_of(2) { long } else { short };
                let data = (0..height).flat_map(|y| row(of(y), y)).collect();
                Ok(RawFrame { data, ..long.clone() })
            }
            Self::Staggered { offset, .. } => {
                if !offset.is_multiple_of(period) {
                    return Err(Error::input(format!("an offset of {offset} rows")).help(
                        format!("use a multiple of {period}, the height of the filter pattern"),
                    ));
                }
                let black = vec![long.black_level_dn.round() as u16; width];
                let late = |y: usize| match y.checked_sub(offset) {
                    Some(y) if y < height => row(short, y),
                    _ => black.clone(),
                };
                let data = (0..height).flat_map(|y| [row(long, y), late(y)].concat()).collect();
                Ok(RawFrame { height: 2 * height, cfa: doubled(&long.cfa)?, data, ..long.clone() })
            }
        }
    }
}

/// The pattern with each row twice.
fn doubled(cfa: &Cfa) -> Result<Cfa> {
    if cfa.is_mono() {
        return Ok(cfa.clone());
    }
    let row = |y: usize| (0..cfa.width).map(|x| cfa.letter(x, y)).collect::<String>();
    let rows: Vec<String> = (0..2 * cfa.height).map(|y| row(y / 2)).collect();
    Cfa::parse(&rows.join("/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(dn: u16) -> RawFrame {
        RawFrame {
            width: 4,
            height: 8,
            bits: 10,
            cfa: Cfa::parse("GRBG").unwrap(),
            black_level_dn: 42.0,
            white_level_dn: 1023,
            data: (0..32).map(|i| dn + i as u16 / 4).collect(),
        }
    }

    #[test]
    fn rows_alternate_in_pairs() {
        let out = Hdr::parse("rows:8").unwrap().interleave(&frame(100), &frame(500)).unwrap();
        let firsts: Vec<u16> = out.data.chunks(4).map(|row| row[0]).collect();
        assert_eq!(firsts, [100, 101, 502, 503, 104, 105, 506, 507]);
        assert_eq!((out.height, out.cfa.to_string()), (8, frame(0).cfa.to_string()));
    }

    #[test]
    fn staggered_rows_come_late_and_keep_their_colours() {
        let hdr = Hdr::parse("staggered:16:2").unwrap();
        let out = hdr.interleave(&frame(100), &frame(500)).unwrap();
        let firsts: Vec<u16> = out.data.chunks(4).map(|row| row[0]).collect();
        assert_eq!(firsts[..8], [100, 42, 101, 42, 102, 500, 103, 501]);
        assert_eq!(out.height, 16);
        // Long row y and short row y lie on rows of the same colours as row y of the sensor.
        let plain = frame(0).cfa;
        for y in 0..16 {
            assert_eq!(out.cfa.letter(0, y), plain.letter(0, y / 2));
        }
        assert_eq!(hdr.frames(3), [6, 7]);
        let odd = Hdr::parse("staggered:16:3").unwrap();
        assert!(odd.interleave(&frame(0), &frame(0)).is_err());
        for wrong in ["rows", "rows:1", "rows:2:2", "zigzag:4", "staggered:nan", "staggered:4:-2"]
        {
            assert!(Hdr::parse(wrong).is_err(), "{wrong}");
        }
    }
}
