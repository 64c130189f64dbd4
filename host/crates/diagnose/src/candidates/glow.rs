//! `amp-glow`: a glow at the edge of the dark-current map.
//!
//! Block means b(u, v) of the map (e⁻/s) are fitted by
//!
//!   b = c + rate · mean over the block of exp(−((u − x)² + (v − y)² h²/w²)/2 width²),
//!
//! u, v in half widths and half heights from the centre: first the best of a grid of places and
//! widths, each with its own rate by linear least squares, then all parameters by Gauss-Newton.

use super::blocks::{self, Block, block_means, fit_template};
use super::proposal::Proposal;
use crate::evidence::Evidence;
use crate::model::effects::current;
use crate::statistics::maps::MapKind;
use camrig_base::Value;
use camrig_measure::fit::Fit;
use std::f64::consts::{PI, SQRT_2};

/// Values further than this many standard deviations of the pixels from the median of their block
/// are held: hot pixels, which would pull its mean. Clear of all 256 normal ones.
const CLIP_SD: f64 = 6.0;
/// Steps of the grid to either side of the centre, across and down.
const GRID_REACH: i32 = 6;
/// Step of the grid, half widths and half heights. The last step lies a fifth of them outside the
/// frame, where the amplifier may be.
const GRID_STEP: f64 = 0.2;
/// Widths of the grid, half widths: steps of up to a half, from which Gauss-Newton converges.
const WIDTHS: [f64; 9] = [0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.7, 1.0];
/// Change of place and width from which slopes are taken, half widths: differences of second order
/// are good to its square, 1e-6 of the slope.
const SLOPE_STEP: f64 = 1e-3;
/// Turns of Gauss-Newton, of which the last few change nothing.
const TURNS: usize = 12;
/// What the search over place and width adds to a significance by chance, standard errors: the
/// grid has some hundred glows that do not overlap, whose largest is 3 above the mean.
const LOOK_ELSEWHERE: f64 = 3.0;
/// Ranges of place and width that the effect allows, half widths.
const PLACES: f64 = 2.0;
const ALLOWED_WIDTHS: std::ops::RangeInclusive<f64> = 0.01..=10.0;

/// The mean of a glow of unit rate over a block, as a function of the block's centre (u, v): place
/// x, y and width in half widths, on a sensor of so many columns and rows.
fn glow([x, y, width]: [f64; 3], (w, h): (f64, f64)) -> impl Fn(f64, f64) -> f64 {
    let half = blocks::SIDE as f64 / w;
    let mean = move |d: f64| {
        let to = |d: f64| libm::erf(d / (width * SQRT_2));
        (to(d + half) - to(d - half)) * width * (PI / 8.0).sqrt() / half
    };
    move |u, v| mean(u - x) * mean((v - y) * h / w)
}

/// `amp-glow`: rate, place and width.
pub fn amp_glow(e: &Evidence<'_>) -> Option<Proposal> {
    if current(e.camera, "amp-glow").is_some() {
        return None;
    }
    let map = e.map(MapKind::DarkCurrent)?;
    let noise = map.spatial.pixel_variance.max(1e-24);
    let blocks = block_means(&map.plane, CLIP_SD * noise.sqrt());
    let start = best_of_grid(&blocks, e.size())?;
    let error = noise.sqrt() / blocks::SIDE as f64;
    let fitted = refined(&blocks, error, start, e.size());
    let ([a, x, y, width], errors) = fitted.unwrap_or((start, [f64::NAN; 4]));
    let fall = fit_template(&blocks, glow([x, y, width], e.size())).fall;
    let strength = (fall.sqrt() / error - LOOK_ELSEWHERE).max(0.0);
    let keys = ["rate_e_per_s", "x", "y", "width"].into_iter();
    let values = std::iter::zip([a, x, y, width], errors);
    let glow: Vec<_> = keys.zip(values.map(|(value, se)| Value::new(value, se))).collect();
    Proposal::of("amp-glow", strength, glow)
}

/// Rate, place and width of the glow of the grid that explains most. `None` where all rates are
/// negative.
fn best_of_grid(blocks: &[Block], size: (f64, f64)) -> Option<[f64; 4]> {
    let mut best: Option<(f64, [f64; 4])> = None;
    for yi in -GRID_REACH..=GRID_REACH {
        for xi in -GRID_REACH..=GRID_REACH {
            for width in WIDTHS {
                let (x, y) = (f64::from(xi) * GRID_STEP, f64::from(yi) * GRID_STEP);
                let fit = fit_template(blocks, glow([x, y, width], size));
                if fit.amplitude > 0.0 && best.is_none_or(|b| fit.fall > b.0) {
                    best = Some((fit.fall, [fit.amplitude, x, y, width]));
                }
            }
        }
    }
    best.map(|b| b.1)
}

/// Rate, place and width by Gauss-Newton from a start, with standard errors. `error` is the
/// standard deviation of a block mean, e⁻/s. `None` where the fit is singular or ends outside the
/// effect's ranges.
fn refined(
    blocks: &[Block],
    error: f64,
    mut at: [f64; 4],
    size: (f64, f64),
) -> Option<([f64; 4], [f64; 4])> {
    let mut fit = None;
    for _ in 0..TURNS {
        let [a, place @ ..] = at;
        let by = |i: usize, d: f64| {
            let mut p = place;
            p[i] += d;
            glow(p, size)
        };
        let here = glow(place, size);
        let beside = [0, 1, 2].map(|i| (by(i, SLOPE_STEP), by(i, -SLOPE_STEP)));
        let datum = |&Block { u, v, mean }: &Block| {
            let slope = |i: usize| {
                let (up, down) = &beside[i];
                a * (up(u, v) - down(u, v)) / (2.0 * SLOPE_STEP)
            };
            let row = vec![here(u, v), slope(0), slope(1), slope(2), 1.0];
            (row, Value::new(mean - a * here(u, v), error))
        };
        let step = Fit::new(&blocks.iter().map(datum).collect::<Vec<_>>()).ok()?;
        for (i, p) in at.iter_mut().enumerate() {
            // At most half of the rate or of the width at a time.
            let most = if i == 0 { 0.5 * a } else { 0.5 * place[2] };
            *p += step.coefficients[i].clamp(-most, most);
        }
        fit = Some(step);
    }
    let fit = fit?;
    let [a, x, y, width] = at;
    let inside =
        a > 0.0 && x.abs() <= PLACES && y.abs() <= PLACES && ALLOWED_WIDTHS.contains(&width);
    inside.then(|| (at, [0, 1, 2, 3].map(|i| fit.std_error(i))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_glow_is_fitted_from_the_nearest_of_the_grid() {
        let (size, truth) = ((256.0, 192.0), [7.0, -0.93, 0.41, 0.27]);
        let [a, place @ ..] = truth;
        let shape = glow(place, size);
        let blocks: Vec<Block> = (0..12 * 16)
            .map(|i| ((i % 16) as f64, (i / 16) as f64))
            .map(|(i, j)| ((2.0 * i + 1.0) / 16.0 - 1.0, (2.0 * j + 1.0) / 12.0 - 1.0))
            .map(|(u, v)| Block { u, v, mean: 0.3 + a * shape(u, v) })
            .collect();
        let (found, errors) = refined(&blocks, 0.01, [6.0, -1.0, 0.4, 0.3], size).unwrap();
        for (f, t) in found.iter().zip(truth) {
            // Slopes are differences over 2e-3, good to 1e-6 of it.
            assert!((f - t).abs() < 1e-5, "{found:?}");
        }
        assert!(errors.iter().all(|e| *e > 0.0 && *e < 0.05), "{errors:?}");
        // The mean over a block of a glow much wider than it is the glow.
        assert!((glow([0.0, 0.0, 9.0], size)(0.0, 0.0) - 1.0).abs() < 1e-3);
    }
}
