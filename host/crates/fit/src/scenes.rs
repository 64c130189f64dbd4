//! Photon transfer without flats: frames of one scene that does not change.
//!
//! The variance of a pixel over frames of such a scene is K (m − b) + σ², as that of a flat: what
//! the scene is like does not matter. Pixels are taken together in squares, and squares of one level
//! in bins: bins of the pixels' own means would put noise into both axes and bend the line. Black
//! and noise of the darks are taken off pixel by pixel, and each frame is scaled to the light of
//! all, so that lamps may flicker. What moves shows as variances on no line (χ²).

use super::response::Datum;
use camrig_base::{Plane, Value};
use camrig_estimates::Sites;

/// Side of the squares, in periods of the colour filter pattern.
const SIDE: usize = 8;
/// Bins of a site of a stack.
const BINS: usize = 10;
/// Smallest level, in standard deviations of the dark noise: below, light's noise is no tenth of
/// all.
const MIN_LEVEL: f64 = 1.0;

/// Squares of one level at a site.
pub struct Bin {
    /// The site.
    pub site: usize,
    /// Mean above black, DN.
    pub level: Value,
    /// Variance over frames above that of the darks, over `level`: DN.
    pub ratio: Value,
}

impl Bin {
    /// As a datum of a gain, without known light.
    pub fn datum(&self, gain: usize, light_of: usize) -> Datum {
        let Self { level, ratio, .. } = *self;
        Datum { gain, light_of, photons: None, level, dark_dn: 0.0, ratio }
    }
}

/// Mean and variance over frames of each pixel.
struct Moments {
    mean: Vec<f64>,
    variance: Vec<f64>,
}

impl Moments {
    /// Of frames, each less `black` and times its factor.
    fn of(frames: &[Plane<u16>], black: &[f64], factors: &[f64]) -> Self {
        let n = frames.len() as f64;
        let at = |i: usize| {
            let each =
                frames.iter().zip(factors).map(|(f, s)| s * (f64::from(f.data[i]) - black[i]));
            let (sum, squares) = each.fold((0.0, 0.0), |(a, b), v| (a + v, b + v * v));
            (sum / n, ((squares - sum * sum / n) / (n - 1.0)).max(0.0))
        };
        let (mean, variance) = (0..black.len()).map(at).unzip();
        Self { mean, variance }
    }
}

/// Bins of a stack of a scene beside the darks of the shortest exposure, with two frames or more
/// each. `white` is the code of saturated pixels.
pub fn bins(scene: &[Plane<u16>], darks: &[Plane<u16>], sites: Sites, white: u16) -> Vec<Bin> {
    let (width, height) = (scene[0].width, scene[0].height);
    let none = vec![0.0; width * height];
    let dark = Moments::of(darks, &none, &vec![1.0; darks.len()]);
    let light = |frame: &Plane<u16>| {
        frame.data.iter().zip(&dark.mean).map(|(v, b)| f64::from(*v) - b).sum::<f64>()
    };
    let lights: Vec<f64> = scene.iter().map(light).collect();
    let mean = lights.iter().sum::<f64>() / lights.len() as f64;
    let factors: Vec<f64> = lights.iter().map(|l| if *l > 0.0 { mean / l } else { 1.0 }).collect();
    let lit = Moments::of(scene, &dark.mean, &factors);
    let full = |i: usize| scene.iter().any(|frame| frame.data[i] >= white);
    let [across, down] = [SIDE * sites.across, SIDE * sites.down];
    let mut all: Vec<Vec<[f64; 3]>> = vec![Vec::new(); sites.count()];
    for (y0, x0) in (0..height / down).flat_map(|y| (0..width / across).map(move |x| (y, x))) {
        let mut sums = vec![[0.0; 3]; sites.count()];
        let mut saturated = false;
        for (y, x) in (0..down).flat_map(|y| (0..across).map(move |x| (y, x))) {
            let i = (y0 * down + y) * width + x0 * across + x;
            saturated |= full(i);
            let sum = &mut sums[sites.of(x, y)];
            for (sum, v) in sum.iter_mut().zip([lit.mean[i], lit.variance[i], dark.variance[i]]) {
                *sum += v / (SIDE * SIDE) as f64;
            }
        }
        if !saturated {
            all.iter_mut().zip(sums).for_each(|(all, square)| all.push(square));
        }
    }
    let [n, m] = [scene.len(), darks.len()].map(|n| n as f64);
    let mut found = Vec::new();
    for (site, mut squares) in all.into_iter().enumerate() {
        squares.sort_by(|a, b| a[0].total_cmp(&b[0]));
        for bin in squares.chunks(squares.len().div_ceil(BINS).max(1)) {
            let of = |i: usize| bin.iter().map(|s| s[i]).sum::<f64>() / bin.len() as f64;
            let [level, variance, dark] = [0, 1, 2].map(of);
            if level < MIN_LEVEL * dark.sqrt() {
                continue;
            }
            let pixels = (bin.len() * SIDE * SIDE) as f64;
            // Of a normal variable the variance's own variance is 2 V²/(n − 1).
            let of_variance = 2.0 * variance * variance / (pixels * (n - 1.0))
                + 2.0 * dark * dark / (pixels * (m - 1.0));
            let of_level = (variance / n + dark / m) / pixels;
            found.push(Bin {
                site,
                level: Value::new(level, of_level.sqrt()),
                ratio: Value::new((variance - dark) / level, of_variance.sqrt() / level),
            });
        }
    }
    found
}
