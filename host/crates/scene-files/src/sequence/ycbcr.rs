//! Frames of Y'CbCr, subsampled or not, as pictures of R'G'B'.
//!
//! Codes become Y' of 0 to 1 and Cb, Cr of ±½ by ITU-R BT.601, 2.5.3 (limited range, whose black
//! and white are 16 and 235 of 8 bits), or by JFIF (full range), and R'G'B' by the luma
//! coefficients of the matrix. Chroma between its samples is interpolated linearly, from where the
//! siting says they are; beyond the last ones it stays. R'G'B' outside 0 to 1 is clipped and
//! counted.

use crate::rgb::picture::{Picture, Said, Samples};
use camrig_base::numbers::counted;

/// Luma coefficients of red and blue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Matrix {
    pub name: &'static str,
    red: f32,
    blue: f32,
}

/// The matrices, by name: ITU-R BT.601, BT.709, BT.2020 (non-constant luminance).
pub(super) const MATRICES: [Matrix; 3] = [
    Matrix { name: "bt601", red: 0.299, blue: 0.114 },
    Matrix { name: "bt709", red: 0.2126, blue: 0.0722 },
    Matrix { name: "bt2020", red: 0.2627, blue: 0.0593 },
];

/// Where the first sample of chroma lies, in samples of luma to the right of and below the first
/// of luma, as a share of the space from there to the middle of those that share it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Siting {
    pub name: &'static str,
    across: f32,
    down: f32,
}

/// In the middle of the samples of luma, as in JPEG and MPEG-1.
pub(super) const CENTER: Siting = Siting { name: "center", across: 1.0, down: 1.0 };
/// In their left column, as in MPEG-2 and H.264 unless stated.
pub(super) const LEFT: Siting = Siting { name: "left", across: 0.0, down: 1.0 };
/// On the first of them, as in BT.2020.
pub(super) const TOP_LEFT: Siting = Siting { name: "topleft", across: 0.0, down: 0.0 };
/// The sitings, by name.
pub(super) const SITINGS: [Siting; 3] = [CENTER, LEFT, TOP_LEFT];

/// How a frame is stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Layout {
    pub width: usize,
    pub height: usize,
    /// Bits of a sample: one byte up to 8, two above, low byte first.
    pub bits: u32,
    /// Samples of luma to one of chroma, across and down; none where there is no chroma.
    pub chroma: Option<[usize; 2]>,
    /// Whether a plane of opacity follows, which is not used.
    pub alpha: bool,
    /// Whether codes go from 0 to the largest.
    pub full: bool,
    pub matrix: Matrix,
    pub siting: Siting,
}

/// Components of R'G'B' beyond 0 or 1 by more than this are reported, for codes of 8 bits: what
/// their rounding makes of a saturated colour, half a step of Y' and of Cb times the largest factor
/// of it (1.8814, BT.2020).
const ROUNDING: f32 = 0.5 / 219.0 + 1.8814 * 0.5 / 224.0;
/// The 16-bit code of 1.
const ONE: f32 = 65535.0;

impl Layout {
    fn sample_bytes(&self) -> usize {
        if self.bits > 8 { 2 } else { 1 }
    }

    /// Width and height of the planes of chroma.
    fn chroma_size(&self) -> Option<(usize, usize)> {
        let [across, down] = self.chroma?;
        Some((self.width.div_ceil(across), self.height.div_ceil(down)))
    }

    /// Bytes of a frame; none where they are more than can be counted.
    pub fn bytes(&self) -> Option<u64> {
        let plane = |w: usize, h: usize| (w as u64).checked_mul(h as u64);
        let luma = plane(self.width, self.height)?;
        let chroma = self.chroma_size().map_or(Some(0), |(w, h)| plane(w, h))?;
        let alpha = if self.alpha { luma } else { 0 };
        let samples = luma.checked_add(chroma.checked_mul(2)?)?.checked_add(alpha)?;
        samples.checked_mul(self.sample_bytes() as u64)
    }

    /// The picture of a frame of [`Layout::bytes`].
    pub fn picture(&self, bytes: &[u8]) -> Picture {
        let (width, height) = (self.width, self.height);
        let luma_bytes = width * height * self.sample_bytes();
        let (luma, rest) = bytes.split_at(luma_bytes);
        let mut clipped = Clipped::beyond(ROUNDING / self.steps().0);
        let mut data = Vec::with_capacity(3 * width * height);
        match self.chroma_size() {
            None => {
                for at in 0..width * height {
                    let code = clipped.code(self.luma(self.code(luma, at)));
                    data.extend([code; 3]);
                    clipped.end_pixel();
                }
            }
            Some((w, h)) => {
                let (blue, rest) = rest.split_at(w * h * self.sample_bytes());
                let planes = [self.plane(blue, w * h), self.plane(rest, w * h)];
                self.colours(luma, &planes, (w, h), |rgb| {
                    data.extend(rgb.map(|v| clipped.code(v)));
                    clipped.end_pixel();
                });
            }
        }
        Picture {
            size: (width, height),
            samples: Samples::Codes { data, most: u16::MAX },
            said: Said::Nothing,
            orientation: 1,
            white_luminance: None,
            understood: Vec::new(),
            notes: clipped.note(width * height).into_iter().collect(),
        }
    }

    fn code(&self, plane: &[u8], at: usize) -> f32 {
        match self.sample_bytes() {
            1 => f32::from(plane[at]),
            _ => f32::from(u16::from_le_bytes([plane[2 * at], plane[2 * at + 1]])),
        }
    }

    /// Steps of the code beyond 8 bits, and the largest code.
    fn steps(&self) -> (f32, f32) {
        ((1u32 << (self.bits - 8)) as f32, ((1u32 << self.bits) - 1) as f32)
    }

    fn luma(&self, code: f32) -> f32 {
        let (step, most) = self.steps();
        if self.full { code / most } else { (code - 16.0 * step) / (219.0 * step) }
    }

    /// Cb or Cr of a plane.
    fn plane(&self, bytes: &[u8], count: usize) -> Vec<f32> {
        let (step, most) = self.steps();
        let range = if self.full { most } else { 224.0 * step };
        (0..count).map(|at| (self.code(bytes, at) - 128.0 * step) / range).collect()
    }

    /// Gives R'G'B' of each pixel in turn.
    fn colours(
        &self,
        luma: &[u8],
        [blue, red]: &[Vec<f32>; 2],
        (w, h): (usize, usize),
        mut give: impl FnMut([f32; 3]),
    ) {
        let [across, down] = self.chroma.unwrap_or([1, 1]);
        let columns: Vec<Between> =
            (0..self.width).map(|x| between(x, across, self.siting.across, w)).collect();
        let Matrix { red: kr, blue: kb, .. } = self.matrix;
        let kg = 1.0 - kr - kb;
        for y in 0..self.height {
            let row = between(y, down, self.siting.down, h);
            for (x, column) in columns.iter().enumerate() {
                let chroma = |plane: &[f32]| {
                    let along = |y: usize| {
                        column.mix(plane[y * w + column.first], plane[y * w + column.second])
                    };
                    row.mix(along(row.first), along(row.second))
                };
                let (cb, cr) = (chroma(blue), chroma(red));
                let l = self.luma(self.code(luma, y * self.width + x));
                let (r, b) = (l + 2.0 * (1.0 - kr) * cr, l + 2.0 * (1.0 - kb) * cb);
                give([r, (l - kr * r - kb * b) / kg, b]);
            }
        }
    }
}

/// Two samples and the weight of the second.
struct Between {
    first: usize,
    second: usize,
    share: f32,
}

impl Between {
    fn mix(&self, first: f32, second: f32) -> f32 {
        first + self.share * (second - first)
    }
}

/// The samples of chroma around sample `at` of luma.
fn between(at: usize, step: usize, siting: f32, count: usize) -> Between {
    let first_at = siting * (step as f32 - 1.0) / 2.0;
    let place = ((at as f32 - first_at) / step as f32).clamp(0.0, (count - 1) as f32);
    let first = place as usize;
    Between { first, second: (first + 1).min(count - 1), share: place - first as f32 }
}

/// Components outside 0 to 1.
struct Clipped {
    /// What does not count.
    rounding: f32,
    pixels: usize,
    by: f32,
    this: bool,
}

impl Clipped {
    fn beyond(rounding: f32) -> Self {
        Self { rounding, pixels: 0, by: 0.0, this: false }
    }

    fn code(&mut self, value: f32) -> u16 {
        let beyond = (value - 1.0).max(-value);
        if beyond > self.rounding {
            self.by = self.by.max(beyond);
            self.this = true;
        }
        (ONE * value.clamp(0.0, 1.0)).round() as u16
    }

    fn end_pixel(&mut self) {
        self.pixels += usize::from(std::mem::take(&mut self.this));
    }

    fn note(&self, of: usize) -> Option<String> {
        (self.pixels > 0).then(|| {
            format!(
                "clipped: {} ({:.2} %) with R'G'B' outside 0 to 1, by up to {:.3}",
                counted(self.pixels, "pixel"),
                100.0 * self.pixels as f64 / of as f64,
                self.by
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout(width: usize, height: usize, chroma: Option<[usize; 2]>) -> Layout {
        Layout {
            width,
            height,
            bits: 8,
            chroma,
            alpha: false,
            full: false,
            matrix: MATRICES[1],
            siting: CENTER,
        }
    }

    fn rgb(layout: &Layout, bytes: &[u8]) -> Vec<[f32; 3]> {
        assert_eq!(layout.bytes(), Some(bytes.len() as u64));
        let Samples::Codes { data, .. } = layout.picture(bytes).samples else { panic!() };
        data.chunks_exact(3).map(|p| [0, 1, 2].map(|c| f32::from(p[c]) / ONE)).collect()
    }

    /// BT.709's own colour bars of 75 % (ITU-R BT.709, ARIB STD-B28): Y, Cb, Cr of 8 bits.
    #[test]
    fn colour_bars_have_their_colours() {
        for (code, expected) in [
            ([180, 128, 128], [0.75, 0.75, 0.75]),
            ([168, 44, 136], [0.75, 0.75, 0.0]),
            ([145, 147, 44], [0.0, 0.75, 0.75]),
            ([133, 63, 52], [0.0, 0.75, 0.0]),
            ([63, 193, 204], [0.75, 0.0, 0.75]),
            ([51, 109, 212], [0.75, 0.0, 0.0]),
            ([28, 212, 120], [0.0, 0.0, 0.75]),
        ] {
            let found = rgb(&layout(1, 1, Some([1, 1])), &code)[0];
            for c in 0..3 {
                assert!((found[c] - expected[c]).abs() < 0.006, "{code:?}: {found:?}");
            }
        }
        let full = Layout { full: true, ..layout(1, 1, None) };
        assert_eq!(rgb(&full, &[51]), [[0.2; 3]]);
        let ten = Layout { bits: 10, ..layout(1, 1, None) };
        assert_eq!(rgb(&ten, &[0xac, 0x03]), [[1.0; 3]], "940");
    }

    /// Chroma that rises linearly is met exactly between its samples, wherever they are sited.
    #[test]
    fn chroma_lies_where_its_siting_says() {
        for (siting, at) in [(CENTER, [0.5, 0.5]), (LEFT, [0.0, 0.5]), (TOP_LEFT, [0.0, 0.0])] {
            let layout = Layout { siting, full: true, ..layout(8, 8, Some([2, 2])) };
            let cr = |x: f32, y: f32| 100.0 + 4.0 * x + 2.0 * y;
            let mut bytes = vec![128u8; 64 + 16];
            bytes
                .extend((0..16).map(|i| {
                    cr(2.0 * (i % 4) as f32 + at[0], 2.0 * (i / 4) as f32 + at[1]) as u8
                }));
            let found = rgb(&layout, &bytes);
            for (x, y) in [(2, 2), (3, 2), (2, 5), (5, 4)] {
                let expected = 128.0 / 255.0
                    + 2.0 * (1.0 - 0.2126) * (cr(x as f32, y as f32) - 128.0) / 255.0;
                let red = found[8 * y + x][0];
                assert!((red - expected).abs() < 1e-4, "{siting:?} {x} {y}: {red} {expected}");
            }
        }
    }

    #[test]
    fn sizes_are_rounded_up_and_clipping_is_told() {
        let odd = layout(3, 3, Some([2, 2]));
        assert_eq!(odd.bytes(), Some(9 + 8));
        let mut bytes = vec![255; 9];
        bytes.extend([128; 8]);
        let note = odd.picture(&bytes).notes.join("");
        assert!(note.contains("9 pixels (100.00 %)") && note.contains("0.091"), "{note}");
        let huge = layout(usize::MAX, 2, None);
        assert_eq!(huge.bytes(), None);
    }
}
