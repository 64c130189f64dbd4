//! A quick picture of a raw frame: black and white level, white balance, bilinear demosaicing,
//! camera colour to sRGB. A preview only; a raw converter does better.
//!
//! Brightness is as captured, the white level becoming white, or automatic ([`bright`]), as raw
//! converters show a picture that nobody has developed yet.

use super::dng_info::{DngInfo, black_levels, linearized};
use camrig_base::color::{Matrix, XYZ_FROM_SRGB, inverse, multiply, srgb_byte};
use camrig_base::{Cfa, Plane, RawFrame};
use rayon::prelude::*;

/// Smallest share of white that a channel's neutral counts as: bounds the white-balance gain of a
/// channel that sees almost nothing.
const MIN_NEUTRAL: f64 = 1e-6;

/// Share of the pixels that automatic brightness lets be white: dcraw and LibRaw take 1 %
/// (`auto_bright_thr` 0.01).
const WHITE_SHARE: f64 = 0.01;
/// Largest factor of automatic brightness: 4 EV. Beyond it a picture shows noise rather than the
/// scene, and a dark frame stays dark.
const MAX_BRIGHTENING: f64 = 16.0;
/// The same of companded frames, whose white is that of the brightest lamp: 12 EV.
const MAX_BRIGHTENING_COMPANDED: f64 = 4096.0;
/// Levels of linear light in which the share of white pixels is counted.
const LEVELS: usize = 65536;

/// The frame in full size, 8-bit sRGB, demosaiced bilinearly, with brightness as captured.
pub fn render(frame: &RawFrame, info: &DngInfo) -> Plane<[u8; 3]> {
    demosaiced(frame, info, |to_srgb, rgb| to_srgb.encode(rgb))
}

/// The frame as [`render`] shows it, brightened so that the brightest 1 % of the pixels are white
/// in one channel, and the factor on linear light. Nothing is darkened.
pub fn bright(frame: &RawFrame, info: &DngInfo) -> (Plane<[u8; 3]>, f64) {
    let linear = demosaiced(frame, info, |to_srgb, rgb| to_srgb.linear(rgb));
    brightened(&linear, info)
}

/// The frame as [`thumbnail`] shows it, brightened as [`bright`] does it, and the factor on linear
/// light.
pub fn bright_thumbnail(
    frame: &RawFrame,
    info: &DngInfo,
    longest: usize,
) -> (Plane<[u8; 3]>, f64) {
    brightened(&averaged(frame, info, longest, |to_srgb, rgb| to_srgb.linear(rgb)), info)
}

/// What is said about the brightness of a picture, `factor` times that of the frame.
#[must_use]
pub fn brightness_words(factor: f64) -> String {
    match factor > 1.0 {
        true => format!("automatic brightness ({factor:.1} times as captured)"),
        false => "brightness as captured".into(),
    }
}

/// A picture of linear sRGB with automatic brightness.
fn brightened(linear: &Plane<[f64; 3]>, info: &DngInfo) -> (Plane<[u8; 3]>, f64) {
    let white = (WHITE_SHARE * linear.data.len() as f64).ceil() as usize;
    let brightest = (0..3).map(|c| {
        let mut counts = vec![0usize; LEVELS];
        for pixel in &linear.data {
            counts[(pixel[c].clamp(0.0, 1.0) * (LEVELS - 1) as f64) as usize] += 1;
        }
        let mut above = 0;
        let level = (0..LEVELS).rev().find(|level| {
            above += counts[*level];
            above > white
        });
        level.unwrap_or(0) as f64 / (LEVELS - 1) as f64
    });
    let brightest = brightest.fold(0.0, f64::max);
    let most =
        if info.linearization.is_empty() { MAX_BRIGHTENING } else { MAX_BRIGHTENING_COMPANDED };
    let factor = (1.0 / brightest.max(1.0 / most)).max(1.0);
    let encode = |pixel: &[f64; 3]| pixel.map(|v| srgb_byte((v * factor).clamp(0.0, 1.0)));
    let data = linear.data.par_iter().map(encode).collect();
    (Plane { width: linear.width, height: linear.height, data }, factor)
}

/// The frame in full size, demosaiced bilinearly; `encode` makes samples of white-balanced camera
/// colour.
fn demosaiced<T: Copy + Default + Send>(
    frame: &RawFrame,
    info: &DngInfo,
    encode: impl Fn(&ToSrgb, [f32; 3]) -> [T; 3] + Sync,
) -> Plane<[T; 3]> {
    let frame = &*linearized(frame, info);
    let to_srgb = ToSrgb::new(frame, info);
    let signal: Vec<f32> = (0..frame.data.len())
        .map(|i| to_srgb.signal(frame, i % frame.width, i / frame.width))
        .collect();
    // Distance within which every pixel has neighbours of every channel.
    let reach = (frame.cfa.width.max(frame.cfa.height) / 2).max(1);
    let columns = continued(frame.width, frame.cfa.width, reach);
    let rows = continued(frame.height, frame.cfa.height, reach);
    let mut picture = Plane::filled(frame.width, frame.height, [T::default(); 3]);
    picture.data.par_chunks_mut(frame.width).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            let mut mean = Mean::default();
            for (j, &v) in rows[y..=y + 2 * reach].iter().enumerate() {
                for (i, &u) in columns[x..=x + 2 * reach].iter().enumerate() {
                    let weight = (reach + 1 - i.abs_diff(reach)) * (reach + 1 - j.abs_diff(reach));
                    mean.add(to_srgb.channel(u, v), weight as f32, signal[v * frame.width + u]);
                }
            }
            *pixel = encode(&to_srgb, mean.rgb());
        }
    });
    picture
}

/// The places along an axis of `size` samples that are read from `reach` before its first sample to
/// `reach` after its last. Beyond an edge it is the sample a period of the pattern further in,
/// which has the same filter.
fn continued(size: usize, period: usize, reach: usize) -> Vec<usize> {
    let place = |k: usize| match k.checked_sub(reach) {
        None => (k + period).saturating_sub(reach),
        Some(inside) if inside < size => inside,
        Some(beyond) => beyond.saturating_sub(period),
    };
    (0..size + 2 * reach).map(|k| place(k).min(size - 1)).collect()
}

/// The frame averaged over squares of whole pattern cells, 8-bit sRGB, no side longer than
/// `longest` pixels. It is always smaller than the frame: DNG readers take the larger of two
/// images for the raw.
pub fn thumbnail(frame: &RawFrame, info: &DngInfo, longest: usize) -> Plane<[u8; 3]> {
    averaged(frame, info, longest, |to_srgb, rgb| to_srgb.encode(rgb))
}

fn averaged<T: Copy>(
    frame: &RawFrame,
    info: &DngInfo,
    longest: usize,
    encode: impl Fn(&ToSrgb, [f32; 3]) -> [T; 3],
) -> Plane<[T; 3]> {
    let frame = &*linearized(frame, info);
    let to_srgb = ToSrgb::new(frame, info);
    let cell = frame.cfa.width.max(frame.cfa.height);
    let longer = frame.width.max(frame.height);
    let step = longer.div_ceil(longest).max(2).next_multiple_of(cell);
    let (width, height) = ((frame.width / step).max(1), (frame.height / step).max(1));
    Plane::from_fn(width, height, |x, y| {
        let mut mean = Mean::default();
        for v in y * step..((y + 1) * step).min(frame.height) {
            for u in x * step..((x + 1) * step).min(frame.width) {
                mean.add(to_srgb.channel(u, v), 1.0, to_srgb.signal(frame, u, v));
            }
        }
        encode(&to_srgb, mean.rgb())
    })
}

/// Weighted mean per channel.
#[derive(Default)]
struct Mean {
    sum: [f32; 3],
    weight: [f32; 3],
}

impl Mean {
    /// Adds a signal of channel R, G or B; a signal without colour counts for all three.
    fn add(&mut self, channel: Option<usize>, weight: f32, signal: f32) {
        for c in 0..3 {
            if channel.is_none_or(|own| own == c) {
                self.sum[c] += weight * signal;
                self.weight[c] += weight;
            }
        }
    }

    fn rgb(&self) -> [f32; 3] {
        std::array::from_fn(
            |c| if self.weight[c] > 0.0 { self.sum[c] / self.weight[c] } else { 0.0 },
        )
    }
}

/// What makes a frame's DN linear sRGB, for programs that develop it themselves.
#[derive(Clone, Debug, PartialEq)]
pub struct Development {
    /// Black level of each cell of the pattern, DN.
    pub black_dn: Vec<f64>,
    /// White-balance gain over (white - black) of each cell of the pattern, 1/DN.
    pub scale_per_dn: Vec<f64>,
    /// White-balanced camera colour to linear sRGB.
    pub srgb_from_camera: Matrix,
}

impl Development {
    /// How a frame is developed.
    #[must_use]
    pub fn new(frame: &RawFrame, info: &DngInfo) -> Self {
        let black_dn = black_levels(frame, info);
        let neutral = info.as_shot_neutral.unwrap_or([1.0; 3]);
        let gain = |c: Option<usize>| c.map_or(1.0, |c| 1.0 / neutral[c].max(MIN_NEUTRAL));
        let white = f64::from(frame.white_level_dn);
        let scale =
            |(colour, black): (Option<usize>, &f64)| gain(colour) / (white - black).max(1.0);
        let scale_per_dn = colours(&frame.cfa).into_iter().zip(&black_dn).map(scale).collect();
        let color = frame.cfa.channels() == ['R', 'G', 'B'];
        let matrix = info.daylight_matrix().filter(|_| color).and_then(srgb_from_camera);
        let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        Self { black_dn, scale_per_dn, srgb_from_camera: matrix.unwrap_or(identity) }
    }
}

/// Channel R, G or B of each filter of a pattern; `None` for one without colour, as all are where
/// the letters of more than four channels number bands.
fn colours(cfa: &Cfa) -> Vec<Option<usize>> {
    let bands = cfa.channels().len() > 4;
    cfa.letters.iter().map(|&c| "RGB".find(c).filter(|_| !bands)).collect()
}

/// Conversion of a frame's DN to sRGB.
struct ToSrgb {
    cfa_width: usize,
    cfa_height: usize,
    channel: Vec<Option<usize>>,
    development: Development,
    gamma: Vec<u8>,
}

impl ToSrgb {
    fn new(frame: &RawFrame, info: &DngInfo) -> Self {
        Self {
            cfa_width: frame.cfa.width,
            cfa_height: frame.cfa.height,
            channel: colours(&frame.cfa),
            development: Development::new(frame, info),
            gamma: (0..=u16::MAX).map(|v| srgb_byte(f64::from(v) / 65535.0)).collect(),
        }
    }

    fn cell(&self, x: usize, y: usize) -> usize {
        (y % self.cfa_height) * self.cfa_width + x % self.cfa_width
    }

    fn channel(&self, x: usize, y: usize) -> Option<usize> {
        self.channel[self.cell(x, y)]
    }

    /// White-balanced signal, clipped where the first channel of a white saturates.
    fn signal(&self, frame: &RawFrame, x: usize, y: usize) -> f32 {
        let cell = self.cell(x, y);
        let dn = f64::from(frame.data[y * frame.width + x]);
        let Development { black_dn, scale_per_dn, .. } = &self.development;
        ((dn - black_dn[cell]) * scale_per_dn[cell]).min(1.0) as f32
    }

    /// Linear sRGB, white 1.
    fn linear(&self, camera: [f32; 3]) -> [f64; 3] {
        self.development
            .srgb_from_camera
            .map(|row| row.iter().zip(&camera).map(|(m, c)| m * f64::from(*c)).sum())
    }

    fn encode(&self, camera: [f32; 3]) -> [u8; 3] {
        let level = |v: f64| self.gamma[(v.clamp(0.0, 1.0) * 65535.0).round() as usize];
        self.linear(camera).map(level)
    }
}

/// White-balanced camera colour to linear sRGB: the inverse of (XYZ → camera) · (sRGB → XYZ) with
/// rows scaled so that white stays white. `None` for a singular matrix.
fn srgb_from_camera(camera_from_xyz: Matrix) -> Option<Matrix> {
    let mut camera_from_srgb = multiply(&camera_from_xyz, &XYZ_FROM_SRGB);
    for row in &mut camera_from_srgb {
        let sum: f64 = row.iter().sum();
        row.iter_mut().for_each(|v| *v /= sum);
    }
    inverse(&camera_from_srgb)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ColorMatrix;

    const MATRIX: Matrix = [[0.9, -0.2, -0.1], [-0.5, 1.3, 0.2], [-0.1, 0.3, 0.6]];

    fn frame(cfa: &str, dn: impl Fn(usize, usize, usize) -> f64) -> RawFrame {
        let cfa = Cfa::parse(cfa).unwrap();
        let at = |i: usize| dn(i % 16, i / 16, cfa.channel(i % 16, i / 16)).round() as u16;
        let data = (0..16 * 12).map(at).collect();
        let (width, height, bits) = (16, 12, 12);
        RawFrame { width, height, bits, cfa, black_level_dn: 64.0, white_level_dn: 4064, data }
    }

    /// Edges are made of their own filters: where each filter has one signal, every pixel is that
    /// colour.
    #[test]
    fn edges_are_made_of_their_own_filters() {
        for cfa in ["GRBG", "RRGG/RRGG/GGBB/GGBB", "RGB"] {
            let raw = frame(cfa, |_, _, channel| 64.0 + 1000.0 * (channel + 1) as f64);
            let picture = render(&raw, &DngInfo::default());
            let expected = [1.0, 2.0, 3.0].map(|v| srgb_byte(v / 4.0));
            assert!(picture.data.iter().all(|p| *p == expected), "{cfa}: {:?}", picture.data);
        }
    }

    /// A grey of half the range in camera colour is sRGB 188 in every channel (0.5 encodes to
    /// 0.7354), whatever the pattern, the white balance and the matrix.
    #[test]
    fn grey_stays_grey() {
        let neutral = [0.5, 1.0, 0.625];
        let info = DngInfo {
            as_shot_neutral: Some(neutral),
            color_matrices: vec![ColorMatrix::of_d65(MATRIX)],
            ..DngInfo::default()
        };
        for cfa in ["RGGB", "GBRG", "RRGG/RRGG/GGBB/GGBB"] {
            let raw = frame(cfa, |_, _, channel| 64.0 + 2000.0 * neutral[channel]);
            assert!(render(&raw, &info).data.iter().all(|p| *p == [188; 3]), "{cfa}");
            assert!(thumbnail(&raw, &info, 4).data.iter().all(|p| *p == [188; 3]), "{cfa}");
        }
        let raw = frame("mono", |_, _, _| 2064.0);
        assert!(render(&raw, &DngInfo::default()).data.iter().all(|p| *p == [188; 3]));
    }

    /// Bilinear demosaicing is exact on a ramp, away from the edges.
    #[test]
    fn a_ramp_comes_back() {
        let level = |x: usize, y: usize| 64.0 + 160.0 * x as f64 + 80.0 * y as f64;
        let picture = render(&frame("GRBG", |x, y, _| level(x, y)), &DngInfo::default());
        for y in 1..11 {
            for x in 1..15 {
                let expected = srgb_byte((level(x, y) - 64.0) / 4000.0);
                assert_eq!(picture.at(x, y), [expected; 3], "{x} {y}");
            }
        }
    }

    /// Automatic brightness puts the brightest 1 % at white, keeps ratios of linear light, darkens
    /// nothing and leaves a dark frame dark.
    #[test]
    fn the_brightest_hundredth_becomes_white() {
        let info = DngInfo::default();
        let raw = frame("mono", |x, y, _| match (x, y) {
            (3, 4) | (9, 8) => 64.0 + 3000.0,
            (x, _) if x < 8 => 64.0 + 500.0,
            _ => 64.0 + 1000.0,
        });
        let (picture, factor) = bright_thumbnail(&raw, &info, 16);
        // Cells of 2 x 2 pixels: the second brightest of 48 has (3 · 500 + 3000)/4 of 4000 DN.
        assert!((factor - 4000.0 / 1125.0).abs() < 1e-3, "{factor}");
        assert_eq!((picture.width, picture.height), (8, 6));
        let flat = frame("mono", |_, _, _| 64.0 + 1000.0);
        let (picture, factor) = bright(&flat, &info);
        assert!((factor - 4.0).abs() < 1e-3 && picture.data.iter().all(|p| *p == [255; 3]));
        let half = frame("mono", |x, _, _| 64.0 + if x < 8 { 500.0 } else { 1000.0 });
        let (picture, _) = bright(&half, &info);
        // Half of white is sRGB 188.
        assert_eq!((picture.at(2, 5), picture.at(13, 5)), ([188; 3], [255; 3]));
        let white = frame("mono", |_, _, _| 4064.0);
        assert_eq!(bright(&white, &info), (render(&white, &info), 1.0));
        let dark = frame("mono", |_, _, _| 66.0);
        let (picture, factor) = bright(&dark, &info);
        assert_eq!(factor, 16.0);
        assert!(picture.data.iter().all(|p| p[0] < 30));
        assert!(brightness_words(4.0).contains("4.0 times"));
        assert_eq!(brightness_words(1.0), "brightness as captured");
    }

    /// A camera that is sRGB itself: its matrix is the inverse of [`XYZ_FROM_SRGB`], colours come
    /// back.
    #[test]
    fn colours_come_back() {
        let color = [0.6, 0.3, 0.1];
        let matrix = ColorMatrix::of_d65(inverse(&XYZ_FROM_SRGB).unwrap());
        let info = DngInfo { color_matrices: vec![matrix], ..DngInfo::default() };
        let raw = frame("RGGB", |_, _, channel| 64.0 + 4000.0 * color[channel]);
        assert_eq!(render(&raw, &info).at(8, 6), color.map(srgb_byte));
    }
}
