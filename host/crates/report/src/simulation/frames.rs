//! Pictures and levels of simulated frames, collected one by one.

use crate::numbers::factor;
use camrig_base::{Cfa, Plane, RawFrame, Result};
use camrig_formats::{DngInfo, png, preview};

/// Number of frames shown as pictures in addition to the first; others have figures only.
const OTHERS: usize = 3;
/// Frames whose figures are kept: a stream may go on for days.
const FIGURES: usize = 100;
/// Longest side of the first frame's pictures and of the others', pixels.
const PICTURE: usize = 512;
const SMALL: usize = 256;
/// Columns and rows of raw samples that are shown one by one.
const SAMPLES: [usize; 2] = [60, 44];
/// Part of the shown samples that may be at the end of the scale.
const WHITE: f64 = 0.002;

/// Pictures and levels, collected frame by frame.
#[derive(Default)]
pub struct Frames {
    pub(super) first: Option<First>,
    /// Pictures of further frames.
    pub(super) others: Vec<Captioned>,
    /// Levels of the first frames.
    pub(super) levels: Vec<FrameLevels>,
    pub(super) count: usize,
}

/// A picture (PNG) with its caption.
pub(super) struct Captioned {
    pub png: Vec<u8>,
    pub caption: String,
}

/// A brightened picture (PNG), and its factor on linear light.
pub(super) struct Brightened {
    pub png: Vec<u8>,
    pub factor: f64,
}

/// Levels of a named frame.
pub(super) struct FrameLevels {
    pub name: String,
    pub levels: Levels,
}

/// The first frame as a page shows it.
pub(super) struct First {
    pub as_captured: Vec<u8>,
    /// Brightened, if the factor is not 1.
    pub bright: Option<Brightened>,
    /// Raw samples in the colours of their filters.
    pub samples: Captioned,
    /// Columns and rows.
    pub sides: [usize; 2],
}

impl Frames {
    /// Adds a frame.
    ///
    /// # Errors
    /// A picture that cannot be encoded.
    pub fn add(&mut self, name: &str, frame: &RawFrame, info: &DngInfo) -> Result<()> {
        if self.first.is_none() {
            let (picture, factor) = preview::bright_thumbnail(frame, info, PICTURE);
            let bright = Brightened { png: png::encode_rgb(&picture)?, factor };
            self.first = Some(First {
                as_captured: png::encode_rgb(&preview::thumbnail(frame, info, PICTURE))?,
                bright: (factor > 1.0).then_some(bright),
                samples: samples(frame)?,
                sides: [frame.width, frame.height],
            });
        } else if self.others.len() < OTHERS {
            let (picture, times) = preview::bright_thumbnail(frame, info, SMALL);
            let caption = format!("{name}, brightened {}.", factor(times));
            self.others.push(Captioned { png: png::encode_rgb(&picture)?, caption });
        }
        if self.levels.len() < FIGURES {
            self.levels.push(FrameLevels { name: name.to_owned(), levels: Levels::of(frame) });
        }
        self.count += 1;
        Ok(())
    }
}

/// How often each DN occurs in each channel.
pub(super) struct Levels {
    /// Names of the channels, with the two greens of a Bayer pattern apart.
    pub channels: Vec<String>,
    /// Samples per DN, of each channel.
    counts: Vec<Vec<u32>>,
    pub bits: u32,
    pub black: f64,
    pub white: u16,
}

/// The channels of a pattern, and which of them each of its cells is.
fn channels(cfa: &Cfa) -> (Vec<String>, Vec<usize>) {
    const ORDER: [&str; 4] = ["R", "Gr", "Gb", "B"];
    let bayer = cfa.width == 2 && cfa.height == 2 && cfa.channels() == ['R', 'G', 'B'];
    let name = |i: usize| {
        let row = i / cfa.width * cfa.width;
        match cfa.letters[i] {
            'G' if bayer && cfa.letters[row..row + 2].contains(&'R') => "Gr".to_owned(),
            'G' if bayer => "Gb".to_owned(),
            letter => letter.to_string(),
        }
    };
    let of_cells: Vec<String> = (0..cfa.letters.len()).map(name).collect();
    let mut names = of_cells.clone();
    let place = |n: &String| ORDER.iter().position(|o| o == n).unwrap_or(ORDER.len());
    names.sort_by_key(|n| (place(n), n.clone()));
    names.dedup();
    let index = |n: &String| names.iter().position(|own| own == n).unwrap_or(0);
    let cells = of_cells.iter().map(index).collect();
    (names, cells)
}

impl Levels {
    fn of(frame: &RawFrame) -> Self {
        let (names, cells) = channels(&frame.cfa);
        let mut counts = vec![vec![0u32; 1 << frame.bits]; names.len()];
        for (y, row) in frame.data.chunks(frame.width).enumerate() {
            let row_cells = y % frame.cfa.height * frame.cfa.width;
            for (x, &dn) in row.iter().enumerate() {
                counts[cells[row_cells + x % frame.cfa.width]][usize::from(dn)] += 1;
            }
        }
        let (black, white) = (frame.black_level_dn, frame.white_level_dn);
        Self { channels: names, counts, bits: frame.bits, black, white }
    }

    /// Samples in each of the bins of `per_bin` DN from 0.
    pub fn binned(&self, channel: usize, per_bin: usize) -> Vec<f64> {
        let sum = |bin: &[u32]| bin.iter().map(|&n| f64::from(n)).sum();
        self.counts[channel].chunks(per_bin).map(sum).collect()
    }

    pub fn mean(&self, channel: usize) -> f64 {
        let of = self.counts[channel].iter().enumerate();
        let (sum, count) = of.fold((0.0, 0.0), |(sum, count), (dn, &n)| {
            (sum + dn as f64 * f64::from(n), count + f64::from(n))
        });
        sum / f64::max(count, 1.0)
    }

    /// The least DN that a share of a channel's samples does not exceed.
    pub fn quantile(&self, channel: usize, share: f64) -> f64 {
        quantile(self.counts[channel].iter().map(|&n| u64::from(n)), share)
    }

    /// The same of all channels together.
    pub fn quantile_of_all(&self, share: f64) -> f64 {
        let all = |dn: usize| self.counts.iter().map(|c| u64::from(c[dn])).sum::<u64>();
        let together: Vec<u64> = (0..1 << self.bits).map(all).collect();
        quantile(together.into_iter(), share)
    }

    /// Share of a channel's samples at or above the white level, and at or below the black one.
    pub fn at_ends(&self, channel: usize) -> [f64; 2] {
        let counts = &self.counts[channel];
        let all = counts.iter().map(|&n| u64::from(n)).sum::<u64>().max(1) as f64;
        let share = |of: &[u32]| of.iter().map(|&n| u64::from(n)).sum::<u64>() as f64 / all;
        let above_black = (self.black.max(-1.0).floor() as isize + 1) as usize;
        [
            share(&counts[usize::from(self.white).min(counts.len())..]),
            share(&counts[..above_black.min(counts.len())]),
        ]
    }

    pub fn samples(&self) -> u64 {
        self.counts.iter().flatten().map(|&n| u64::from(n)).sum()
    }

    /// Share of all samples at or above the white level.
    pub fn saturated(&self) -> f64 {
        let white = usize::from(self.white);
        let full: u64 =
            self.counts.iter().flat_map(|c| c.iter().skip(white)).map(|&n| u64::from(n)).sum();
        full as f64 / self.samples().max(1) as f64
    }
}

fn quantile(counts: impl Iterator<Item = u64> + Clone, share: f64) -> f64 {
    let wanted = share * counts.clone().sum::<u64>() as f64;
    let mut below = 0;
    let found = counts.enumerate().find(|(_, n)| {
        below += n;
        *n > 0 && below as f64 >= wanted
    });
    found.map_or(0.0, |(dn, _)| dn as f64)
}

/// Samples around the middle of a frame in the colours of their filters, brightened.
fn samples(frame: &RawFrame) -> Result<Captioned> {
    let [width, height] = [SAMPLES[0].min(frame.width), SAMPLES[1].min(frame.height)];
    let middle = |side: usize, shown: usize, cell: usize| (side - shown) / 2 / cell * cell;
    let left = middle(frame.width, width, frame.cfa.width);
    let top = middle(frame.height, height, frame.cfa.height);
    let dn = |x: usize, y: usize| frame.data[(top + y) * frame.width + left + x];
    let mut sorted: Vec<u16> = Plane::from_fn(width, height, dn).data;
    sorted.sort_unstable();
    let brightest = sorted[((1.0 - WHITE) * (sorted.len() - 1) as f64) as usize];
    let span = (f64::from(brightest) - frame.black_level_dn).max(1.0);
    let picture = Plane::from_fn(width, height, |x, y| {
        let level = ((f64::from(dn(x, y)) - frame.black_level_dn) / span).clamp(0.0, 1.0);
        let shade = (255.0 * level.sqrt()).round() as u8;
        match "RGB".find(frame.cfa.letter(left + x, top + y)) {
            Some(own) => std::array::from_fn(|c| if c == own { shade } else { 0 }),
            None => [shade; 3],
        }
    });
    let caption = format!(
        "Columns {left} to {}, rows {top} to {}; pattern {}; square root of the signal.",
        left + width - 1,
        top + height - 1,
        frame.cfa
    );
    Ok(Captioned { png: png::encode_rgb(&picture)?, caption })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(data: Vec<u16>) -> RawFrame {
        RawFrame {
            width: 4,
            height: 2,
            bits: 8,
            cfa: Cfa::parse("GRBG").unwrap(),
            black_level_dn: 10.0,
            white_level_dn: 250,
            data,
        }
    }

    #[test]
    fn levels_count_each_channel_with_the_greens_apart() {
        // Gr R Gr R over B Gb B Gb.
        let levels = Levels::of(&frame(vec![20, 250, 30, 100, 10, 9, 11, 255]));
        assert_eq!(levels.channels, ["R", "Gr", "Gb", "B"]);
        assert_eq!([0, 1, 2, 3].map(|c| levels.mean(c)), [175.0, 25.0, 132.0, 10.5]);
        assert_eq!(levels.at_ends(0), [0.5, 0.0]);
        assert_eq!(levels.at_ends(2), [0.5, 0.5]);
        assert_eq!(levels.at_ends(3), [0.0, 0.5]);
        assert_eq!((levels.samples(), levels.saturated()), (8, 0.25));
        assert_eq!([levels.quantile(1, 0.5), levels.quantile(1, 0.99)], [20.0, 30.0]);
        assert_eq!(levels.quantile_of_all(0.75), 100.0);
        assert_eq!(levels.binned(1, 16)[1], 2.0);
    }

    #[test]
    fn other_patterns_keep_their_letters() {
        let names = |text: &str| channels(&Cfa::parse(text).unwrap()).0;
        assert_eq!(names("mono").len(), 1);
        assert_eq!(names("RGGB"), ["R", "Gr", "Gb", "B"]);
    }
}
