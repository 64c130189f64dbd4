//! Charge-transfer inefficiency of a CCD: charge that stays behind makes the shot noise of a pixel
//! part of the next one's, the more the longer its way to the output.
//!
//! Of l of a pixel's charge that comes with the next pixel, their correlation in the noise of light
//! is ρ = l (1 − l)/(1 − 2 l (1 − l)). A packet that is transferred n times leaves l = 1 − (1 − ε)ⁿ
//! behind, so that −ln (1 − l) grows by ε from pixel to pixel: its slope over columns, or rows.
//! Coupling of neighbours is the same everywhere and has no slope. Noise of rows and light that
//! flickers are taken off as the mean of each row.

use super::robust::mad_sd;
use camrig_base::Value;

/// Parts of a side in which the correlation is taken.
const PARTS: usize = 16;
/// Robust standard deviations at which noise is clipped.
const CLIP: f64 = 6.0;
/// Share of the light's in the noise without which it does not show.
const MIN_SHOT: f64 = 0.3;

/// Sums over a part of the frames: products of neighbours, squares, how many.
#[derive(Clone, Copy, Default)]
struct Sums {
    products: f64,
    squares: f64,
    count: f64,
}

/// What stays behind at each transfer along rows and down columns, from frames of a flat without
/// their offsets; `read_variance` is that of the same unit without light. None where the noise is
/// not that of light.
pub(crate) fn inefficiency(
    frames: &[Vec<f64>],
    width: usize,
    read_variance: f64,
) -> [Option<Value>; 2] {
    let n = frames.len() as f64;
    let pixels = frames[0].len();
    let height = pixels / width;
    let average: Vec<f64> =
        (0..pixels).map(|p| frames.iter().map(|f| f[p]).sum::<f64>() / n).collect();
    let parts = [width, height].map(|side| PARTS.min(side / 2).max(1));
    let mut sums = parts.map(|count| vec![Sums::default(); count]);
    let mut reach = None;
    for frame in frames {
        let mut noise: Vec<f64> = frame.iter().zip(&average).map(|(v, a)| v - a).collect();
        for row in noise.chunks_mut(width) {
            let mean = row.iter().sum::<f64>() / width as f64;
            row.iter_mut().for_each(|v| *v -= mean);
        }
        let reach = *reach.get_or_insert_with(|| CLIP * mad_sd(&noise));
        noise.iter_mut().for_each(|v| *v = v.clamp(-reach, reach));
        for (p, v) in noise.iter().enumerate() {
            let (x, y) = (p % width, p / width);
            let next = [(x + 1 < width).then_some(p + 1), (y + 1 < height).then_some(p + width)];
            let part = [x * parts[0] / width, y * parts[1] / height];
            for axis in 0..2 {
                let Some(next) = next[axis] else { continue };
                let sum = &mut sums[axis][part[axis]];
                sum.products += v * noise[next];
                sum.squares += 0.5 * (v * v + noise[next] * noise[next]);
                sum.count += (n - 1.0) / n;
            }
        }
    }
    let per_part = [width as f64 / parts[0] as f64, height as f64 / parts[1] as f64];
    [0, 1].map(|axis| slope(&sums[axis], read_variance).map(|s| s.scaled(1.0 / per_part[axis])))
}

/// The slope of −ln (1 − l) over parts, its error that of products of independent noise.
fn slope(sums: &[Sums], read_variance: f64) -> Option<Value> {
    let mut points = Vec::with_capacity(sums.len());
    for (i, s) in sums.iter().enumerate() {
        let shot = s.squares - read_variance * s.count;
        if shot < MIN_SHOT * s.squares {
            return None;
        }
        let correlation = s.products / shot;
        let both = (correlation / (1.0 + 2.0 * correlation)).clamp(-0.25, 0.25);
        let l = 0.5 * (1.0 - (1.0 - 4.0 * both).max(0.0).sqrt());
        let error = s.squares / shot / ((1.0 - 2.0 * l).max(0.1) * (1.0 - l)) / s.count.sqrt();
        points.push((i as f64, -libm::log(1.0 - l), error.powi(2).recip()));
    }
    let weight: f64 = points.iter().map(|p| p.2).sum();
    let centre = points.iter().map(|p| p.2 * p.0).sum::<f64>() / weight;
    let (num, den) = points.iter().fold((0.0, 0.0), |(num, den), (at, t, w)| {
        (num + w * (at - centre) * t, den + w * (at - centre).powi(2))
    });
    (den > 0.0).then(|| Value::new(num / den, 1.0 / den.sqrt()))
}
