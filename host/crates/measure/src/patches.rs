//! Patches of a ColorChecker in a raw frame: means and standard deviations per channel and of the
//! luminance.
//!
//! Luminance is that of Rec. ITU-R BT.709, `Y = 0.2126 R + 0.7152 G + 0.0722 B`. R, G and B are
//! the means of each channel over one period of the colour filter pattern, less black and
//! white-balanced on the white patch (19). Its noise is that of the raw frame without demosaicing,
//! and is comparable between frames of one camera. The luminance of a mono frame is its signal.

use camrig_base::median::{SD_PER_MAD, median};
use camrig_base::{Cfa, Error, ErrorCode, Plane, Result};
use camrig_linear::moments;
use camrig_scene::chart::colorchecker::{COLUMNS, ROWS};
use serde::Serialize;

/// Number of patches.
pub const COUNT: usize = COLUMNS * ROWS;

/// The patches that Chen et al. 2009 count as dark.
pub const DARK: [usize; 4] = [10, 13, 15, 24];

/// Side of the sampled square over the distance between patches: 0.5 leaves a margin of 0.18 to
/// the edges of a patch (0.86) for blur and misplaced corners.
const SAMPLED: f64 = 0.5;

/// Index of the white patch, counted from 0.
const WHITE: usize = 18;
/// Fewest samples of a patch, for a standard deviation.
const MIN_SAMPLES: usize = 4;
/// Largest share of saturated pixels of a patch: one bright patch of small noise may clip single
/// pixels, but the mean must not change.
const SATURATED: f64 = 0.01;
/// Share of a channel's samples in a patch at the frame's largest value from which it counts as
/// saturated where the white level is not known: of symmetric noise, half lies above its mean, and
/// a level at which the patch is cut off there or below has at least as many samples.
const ONE_VALUE: f64 = 0.5;

/// Figures of one patch.
#[derive(Clone, Debug, Serialize)]
pub struct Patch {
    /// Number on the chart, 1 (dark skin) to 24 (black).
    pub number: usize,
    /// Centre in the frame, pixels.
    pub centre: [f64; 2],
    /// Number of samples (pattern periods).
    pub samples: usize,
    /// Share of its pixels at 0 DN, where the signal may be cut off: their mean is too large then,
    /// and their standard deviation too small.
    pub at_zero: f64,
    /// Mean of each channel above black, DN.
    pub mean_dn: Vec<f64>,
    /// Standard deviation of each channel over the samples, DN.
    pub std_dn: Vec<f64>,
    /// Mean luminance, DN.
    pub luminance_dn: f64,
    /// Standard deviation of the luminance, DN.
    pub luminance_std_dn: f64,
    /// Standard error of that standard deviation for Gaussian noise, DN.
    pub luminance_std_error_dn: f64,
    /// Excess kurtosis of the luminance: positive where single samples are outliers.
    pub luminance_excess_kurtosis: f64,
}

/// Centres of the four corner patches in pixels: dark skin (1), bluish green (6), black (24),
/// white (19): clockwise from the top left.
pub type Corners = [[f64; 2]; 4];

/// Corners of the built-in chart in a frame of `width` x `height` pixels of an ideal lens; the
/// card is `card_width` sensor widths wide and centred.
pub fn built_in_corners(width: usize, height: usize, card_width: f64) -> Corners {
    [0, COLUMNS - 1, COUNT - 1, COUNT - COLUMNS].map(|index| {
        let [left, top, edge] = camrig_scene::chart::colorchecker::patch(index, card_width);
        let w = width as f64;
        [(left + 0.5 * edge + 0.5) * w, (top + 0.5 * edge) * w + 0.5 * height as f64]
    })
}

/// Measures all patches. `black` is the black level, `white` the white level, both in DN; of a
/// unknown white level, patches at the frame's largest value are saturated.
///
/// # Errors
/// Corners whose patches leave the frame or hold fewer than four samples, patches that are
/// saturated, a white patch without signal.
pub fn measure<T: Copy + Into<f64>>(
    frame: &Plane<T>,
    cfa: &Cfa,
    black: f64,
    white: impl Into<Option<u16>>,
    corners: &Corners,
) -> Result<Vec<Patch>> {
    let channels = cfa.channels().len();
    let top = Top::of(frame, white.into());
    let mut all: Vec<([f64; 2], Sampled)> = Vec::with_capacity(COUNT);
    for index in 0..COUNT {
        let (centre, half) = place(corners, index);
        let sampled = sample(frame, cfa, black, top, centre, half)
            .map_err(|e| e.at(format!("patch {}", index + 1)))?;
        all.push((centre, sampled));
    }
    let mean = |cells: &[Vec<f64>], c: usize| {
        cells.iter().map(|cell| cell[c]).sum::<f64>() / cells.len() as f64
    };
    let balance: Vec<f64> = (0..channels).map(|c| mean(&all[WHITE].1.cells, c)).collect();
    if balance.iter().any(|b| *b <= 0.0) {
        return Err(Error::input("the white patch (19) has no signal above black")
            .help("check the corners and the black level"));
    }
    let weights = luminance_weights(cfa);
    let level: f64 = weights.iter().zip(&balance).map(|(w, b)| w * b).sum();
    Ok(all
        .into_iter()
        .enumerate()
        .map(|(index, (centre, Sampled { cells, at_zero }))| {
            let n = cells.len() as f64;
            let luminance: Vec<f64> = cells
                .iter()
                .map(|cell| (0..channels).map(|c| weights[c] * cell[c] / balance[c] * level).sum())
                .collect();
            let of = |values: &[f64]| {
                let (mean, variance) = moments(values);
                (mean, variance.sqrt())
            };
            let (y, sd) = of(&luminance);
            let fourth = luminance.iter().map(|v| ((v - y) / sd).powi(4)).sum::<f64>() / n;
            let per_channel: Vec<(f64, f64)> = (0..channels)
                .map(|c| of(&cells.iter().map(|cell| cell[c]).collect::<Vec<_>>()))
                .collect();
            Patch {
                number: index + 1,
                centre,
                samples: cells.len(),
                at_zero,
                mean_dn: per_channel.iter().map(|p| p.0).collect(),
                std_dn: per_channel.iter().map(|p| p.1).collect(),
                luminance_dn: y,
                luminance_std_dn: sd,
                luminance_std_error_dn: sd / (2.0 * (n - 1.0)).sqrt(),
                luminance_excess_kurtosis: if sd > 0.0 { fourth - 3.0 } else { 0.0 },
            }
        })
        .collect())
}

/// Share of the patches' pixels that differ from the median of their patch and channel by more
/// than `sigmas` robust standard deviations (1.4826 times the median absolute deviation, at least
/// that of rounding).
///
/// # Errors
/// Patches that leave the frame.
pub fn outliers(frame: &Plane<u16>, cfa: &Cfa, corners: &Corners, sigmas: f64) -> Result<f64> {
    let (mut found, mut all) = (0usize, 0usize);
    for index in 0..COUNT {
        let (centre, half) = place(corners, index);
        check_inside(frame, centre, half).map_err(|e| e.at(format!("patch {}", index + 1)))?;
        let span = |v: f64| (v - half).ceil() as usize..(v + half) as usize;
        for channel in 0..cfa.channels().len() {
            let pixels = span(centre[1]).flat_map(|y| span(centre[0]).map(move |x| (x, y)));
            let mut values: Vec<f64> = pixels
                .filter(|&(x, y)| cfa.channel(x, y) == channel)
                .map(|(x, y)| f64::from(frame.at(x, y)))
                .collect();
            let middle = median(&mut values, f64::total_cmp);
            let mut off: Vec<f64> = values.iter().map(|v| (v - middle).abs()).collect();
            let limit =
                sigmas * (SD_PER_MAD * median(&mut off, f64::total_cmp)).max(1.0 / 12f64.sqrt());
            found += off.iter().filter(|d| **d > limit).count();
            all += off.len();
        }
    }
    Ok(found as f64 / all.max(1) as f64)
}

/// Luminance weights of the channels: BT.709 for red, green, blue; equal for other patterns.
fn luminance_weights(cfa: &Cfa) -> Vec<f64> {
    let letters = cfa.channels();
    if letters == ['R', 'G', 'B'] {
        return vec![0.2126, 0.7152, 0.0722];
    }
    vec![1.0 / letters.len() as f64; letters.len()]
}

/// Centre of a patch and half the side of its sampled square, pixels, by bilinear interpolation
/// between the corner patches, so that the chart may be seen at an angle.
fn place(corners: &Corners, index: usize) -> ([f64; 2], f64) {
    let u = (index % COLUMNS) as f64 / (COLUMNS - 1) as f64;
    let v = (index / COLUMNS) as f64 / (ROWS - 1) as f64;
    let [tl, tr, br, bl] = corners;
    let at = |k: usize| {
        (1.0 - v) * ((1.0 - u) * tl[k] + u * tr[k]) + v * ((1.0 - u) * bl[k] + u * br[k])
    };
    let distance = |a: &[f64; 2], b: &[f64; 2]| libm::hypot(a[0] - b[0], a[1] - b[1]);
    let pitch = (distance(tl, tr) / (COLUMNS - 1) as f64)
        .min(distance(tl, bl) / (ROWS - 1) as f64)
        .min(distance(bl, br) / (COLUMNS - 1) as f64);
    ([at(0), at(1)], 0.5 * SAMPLED * pitch)
}

fn check_inside<T>(frame: &Plane<T>, centre: [f64; 2], half: f64) -> Result<()> {
    let inside = centre[0] - half >= 0.0
        && centre[1] - half >= 0.0
        && centre[0] + half <= frame.width as f64
        && centre[1] + half <= frame.height as f64;
    if !inside || half.is_nan() {
        return Err(Error::input("the patch lies outside the frame")
            .help("give the centres of patches 1, 6, 24 and 19 in pixels")
            .with_code(ErrorCode::PatchOutside));
    }
    Ok(())
}

/// The level from which samples count as saturated.
#[derive(Clone, Copy)]
struct Top {
    dn: f64,
    /// Whether it is the white level; the frame's largest value otherwise.
    known: bool,
}

impl Top {
    fn of<T: Copy + Into<f64>>(frame: &Plane<T>, white: Option<u16>) -> Self {
        let largest = || frame.data.iter().map(|v| (*v).into()).fold(f64::MIN, f64::max);
        Self { dn: white.map_or_else(largest, f64::from), known: white.is_some() }
    }

    /// Refuses a patch of which each channel has (samples at the level, samples).
    fn check(self, channels: &[(usize, usize)]) -> Result<()> {
        let sum = |k: fn(&(usize, usize)) -> usize| channels.iter().map(k).sum::<usize>() as f64;
        if self.known && sum(|c| c.0) > SATURATED * sum(|c| c.1) {
            return Err(Error::input("more than 1 % of the patch is saturated")
                .help("expose less: a saturated patch has no true mean or noise"));
        }
        let one_value = |c: &(usize, usize)| c.0 as f64 >= ONE_VALUE * c.1 as f64;
        if !self.known && channels.iter().any(one_value) {
            let what = "half of the patch's samples or more are at the frame's largest value";
            return Err(Error::input(format!("{what}, {} DN: it may be saturated", self.dn))
                .help("give the white level (--white DN), or expose less"));
        }
        Ok(())
    }
}

/// The samples of a patch.
struct Sampled {
    /// Channel means of every pattern period, above black, DN.
    cells: Vec<Vec<f64>>,
    /// Share of pixels at 0 DN.
    at_zero: f64,
}

/// The samples of every pattern period inside a square.
fn sample<T: Copy + Into<f64>>(
    frame: &Plane<T>,
    cfa: &Cfa,
    black: f64,
    top: Top,
    centre: [f64; 2],
    half: f64,
) -> Result<Sampled> {
    check_inside(frame, centre, half)?;
    let channels = cfa.channels().len();
    let cell = |v: f64, step: usize| (v / step as f64).ceil() as usize;
    let columns = cell(centre[0] - half, cfa.width)..cell(centre[0] + half, cfa.width);
    let rows = cell(centre[1] - half, cfa.height)..cell(centre[1] + half, cfa.height);
    let mut cells = Vec::new();
    let mut saturated = vec![(0usize, 0usize); channels];
    let mut zeros = 0usize;
    for (j, i) in rows.flat_map(|j| columns.clone().map(move |i| (j, i))) {
        let mut sums = vec![(0.0, 0u32); channels];
        for (y, x) in (0..cfa.height).flat_map(|y| (0..cfa.width).map(move |x| (y, x))) {
            let (px, py) = (i * cfa.width + x, j * cfa.height + y);
            if px >= frame.width || py >= frame.height {
                continue;
            }
            let value: f64 = frame.at(px, py).into();
            let channel = cfa.channel(px, py);
            saturated[channel].0 += usize::from(value >= top.dn);
            saturated[channel].1 += 1;
            zeros += usize::from(value == 0.0);
            sums[channel].0 += value - black;
            sums[channel].1 += 1;
        }
        if sums.iter().all(|s| s.1 > 0) {
            cells.push(sums.iter().map(|s| s.0 / f64::from(s.1)).collect());
        }
    }
    if cells.len() < MIN_SAMPLES {
        return Err(Error::input(format!("{} samples in the patch", cells.len()))
            .help("the chart is too small in the frame, or the corners are wrong"));
    }
    top.check(&saturated)?;
    let pixels: usize = saturated.iter().map(|c| c.1).sum();
    Ok(Sampled { cells, at_zero: zeros as f64 / pixels as f64 })
}

/// A note on patches with samples at 0 DN.
#[must_use]
pub fn cut_off(patches: &[Patch]) -> Option<String> {
    let some = patches.iter().filter(|p| p.at_zero > 0.0);
    let some: Vec<String> =
        some.map(|p| format!("{} ({:.1} %)", p.number, 100.0 * p.at_zero)).collect();
    (!some.is_empty()).then(|| {
        format!(
            "pixels at 0 DN in patch {}: where the signal is cut off there, the mean is too large \
             and the standard deviation too small; raise the black level",
            some.join(", ")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, Normal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    #[test]
    fn known_patches_come_back() {
        let (w, h) = (600, 420);
        let corners = built_in_corners(w, h, 0.8);
        let cfa = Cfa::parse("GRBG").unwrap();
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        let noise = Normal::new(0.0, 6.0).unwrap();
        let mut frame = Plane::filled(w, h, 100u16);
        for index in 0..COUNT {
            let (c, half) = place(&corners, index);
            for y in (c[1] - 1.5 * half) as usize..(c[1] + 1.5 * half) as usize {
                for x in (c[0] - 1.5 * half) as usize..(c[0] + 1.5 * half) as usize {
                    let level =
                        [300.0, 600.0, 200.0][cfa.channel(x, y)] * (1.0 - 0.03 * index as f64);
                    let v = 64.0 + level + noise.sample(&mut rng);
                    frame.data[y * w + x] = v.round() as u16;
                }
            }
        }
        let patches = measure(&frame, &cfa, 64.0, 1023, &corners).unwrap();
        for (index, p) in patches.iter().enumerate() {
            let scale = 1.0 - 0.03 * index as f64;
            for (mean, level) in p.mean_dn.iter().zip([300.0, 600.0, 200.0]) {
                let error = 6.0 / (p.samples as f64).sqrt();
                assert!((mean - level * scale).abs() < 5.0 * error + 0.05, "{index} {p:?}");
            }
            // Two greens are averaged in a period.
            let green = 6.1 / 2f64.sqrt();
            let error = green / (2.0 * p.samples as f64).sqrt();
            assert!((p.std_dn[1] - green).abs() < 5.0 * error, "{index} {p:?}");
        }
        // Noise has no outliers; a hundred bright pixels within the patches are found.
        assert_eq!(outliers(&frame, &cfa, &corners, 6.0).unwrap(), 0.0);
        let (c, half) = place(&corners, 7);
        let (x, y) = ((c[0] - half) as usize + 2, (c[1] - half) as usize + 2);
        for k in 0..100 {
            frame.data[(y + k / 10) * w + x + k % 10] = 1000;
        }
        let pixels = (2.0 * half).floor().powi(2) * COUNT as f64;
        let share = outliers(&frame, &cfa, &corners, 6.0).unwrap();
        assert!((share * pixels - 100.0).abs() < 15.0, "{}", share * pixels);
        let outside = [[-50.0, 0.0], [600.0, 0.0], [600.0, 400.0], [0.0, 400.0]];
        assert!(measure(&frame, &cfa, 64.0, 1023, &outside).is_err());
        assert!(measure(&frame, &cfa, 64.0, 300, &corners).is_err());
    }

    /// A frame of small patches, all of them of 300 DN and noise of 3 DN except white: `white` DN.
    fn grey(white: f64, top: f64) -> (Plane<u16>, Corners) {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        let noise = Normal::new(0.0, 3.0).unwrap();
        let corners = [[20.0, 20.0], [120.0, 20.0], [120.0, 80.0], [20.0, 80.0]];
        let inside = |x: usize, y: usize| x < 30 && y >= 70;
        let frame = Plane::from_fn(140, 100, |x, y| {
            let level = if inside(x, y) { white } else { 300.0 };
            (level + noise.sample(&mut rng)).round().clamp(0.0, top) as u16
        });
        (frame, corners)
    }

    /// The white patch is clipped at a level that may be unknown: it has no mean in either case.
    #[test]
    fn a_clipped_patch_is_refused_without_a_white_level() {
        let mono = Cfa::parse("mono").unwrap();
        let of = |(frame, corners): &(Plane<u16>, Corners), white: Option<u16>| {
            measure(frame, &mono, 64.0, white, corners)
        };
        let clipped = grey(1504.0, 1023.0);
        let told = of(&clipped, None).unwrap_err().to_string();
        assert!(told.contains("1023 DN") && told.contains("patch 19"), "{told}");
        assert!(of(&clipped, Some(1023)).unwrap_err().to_string().contains("saturated"));
        let whole = of(&grey(1504.0, 4095.0), None).unwrap();
        assert!((whole[WHITE].mean_dn[0] - 1440.0).abs() < 3.0, "{:?}", whole[WHITE]);
        assert_eq!(cut_off(&whole), None);
    }

    #[test]
    fn patches_cut_off_at_0_are_told() {
        let mono = Cfa::parse("mono").unwrap();
        let (frame, corners) = grey(1504.0, 4095.0);
        let dark =
            Plane { data: frame.data.iter().map(|v| v.saturating_sub(300)).collect(), ..frame };
        let patches = measure(&dark, &mono, 0.0, 4095, &corners).unwrap();
        // The median of the noise is at 0 DN.
        assert!((patches[0].at_zero - 0.5).abs() < 0.25, "{:?}", patches[0]);
        let told = cut_off(&patches).unwrap();
        assert!(told.contains("pixels at 0 DN in patch 1 (") && !told.contains("19 ("), "{told}");
    }
}
