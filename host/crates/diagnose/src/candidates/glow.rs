//! A glow at the edge of the dark-current map.

use super::fixed::{amplitude, block_means};
use super::{Proposal, list};
use crate::evidence::Evidence;
use crate::maps::MapKind;
use crate::model::current;
use camrig_measure::fit::Fit;
use camrig_sensor_core::effects::amp_glow::AmpGlow;
use std::f64::consts::{PI, SQRT_2};

/// Pixels along a side of the blocks.
const BLOCK: f64 = 16.0;
/// Change of place and width from which slopes are taken, half widths.
const STEP: f64 = 1e-3;

/// Of x, y, width in half widths: the mean of the glow over a block about (u, v) of a sensor of so many columns and rows.
fn glow([x, y, width]: [f64; 3], (w, h): (f64, f64)) -> impl Fn(f64, f64) -> f64 {
    let half = BLOCK / w;
    let mean = move |d: f64| {
        let to = |d: f64| libm::erf(d / (width * SQRT_2));
        (to(d + half) - to(d - half)) * width * (PI / 8.0).sqrt() / half
    };
    move |u, v| mean(u - x) * mean((v - y) * h / w)
}

/// The best of a coarse grid of places and widths, then least squares of all four parameters.
pub fn amp_glow(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        if current(e.camera, "amp-glow").is_some() {
            return None;
        }
        let map = e.map(MapKind::DarkCurrent)?;
        let noise = map.spatial.pixel_variance.max(1e-24);
        let blocks = block_means(&map.plane, 6.0 * noise.sqrt());
        let mut best: Option<(f64, [f64; 4])> = None;
        for yi in -6i32..=6 {
            for xi in -6i32..=6 {
                for width in [0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.7, 1.0] {
                    let (x, y) = (f64::from(xi) * 0.2, f64::from(yi) * 0.2);
                    let (a, _, gain) = amplitude(&blocks, glow([x, y, width], e.size()));
                    if a > 0.0 && best.is_none_or(|b| gain > b.0) {
                        best = Some((gain, [a, x, y, width]));
                    }
                }
            }
        }
        let error = noise.sqrt() / BLOCK;
        let fitted = refined(&blocks, error, best?.1, e.size());
        let ([a, x, y, width], errors) = fitted.unwrap_or((best?.1, [f64::NAN; 4]));
        let gain = amplitude(&blocks, glow([x, y, width], e.size())).2;
        let effect =
            AmpGlow { rate_e_per_s: a as f32, x: x as f32, y: y as f32, width: width as f32 };
        // Place and width were searched for: their look-elsewhere takes about 3 standard errors.
        let strength = (gain.sqrt() / error - 3.0).max(0.0);
        Some(
            Proposal::new("amp-glow", effect.into(), strength)
                .with("rate_e_per_s", a, errors[0])
                .with("x", x, errors[1])
                .with("y", y, errors[2])
                .with("width", width, errors[3]),
        )
    })())
}

/// Rate, place and width by Gauss-Newton from a start, with standard errors; none where that leads nowhere.
fn refined(
    blocks: &[(f64, f64, f64)],
    error: f64,
    mut at: [f64; 4],
    size: (f64, f64),
) -> Option<([f64; 4], [f64; 4])> {
    let errors = vec![error; blocks.len()];
    let mut fit = None;
    for _ in 0..12 {
        let [a, place @ ..] = at;
        let by = |i: usize, d: f64| {
            let mut p = place;
            p[i] += d;
            glow(p, size)
        };
        let here = glow(place, size);
        let beside = [0, 1, 2].map(|i| (by(i, STEP), by(i, -STEP)));
        let design: Vec<Vec<f64>> = blocks
            .iter()
            .map(|&(u, v, _)| {
                let slope = |i: usize| {
                    let (up, down) = &beside[i];
                    a * (up(u, v) - down(u, v)) / (2.0 * STEP)
                };
                vec![here(u, v), slope(0), slope(1), slope(2), 1.0]
            })
            .collect();
        let left: Vec<f64> = blocks.iter().map(|&(u, v, b)| b - a * here(u, v)).collect();
        let step = Fit::new(&design, &left, &errors).ok()?;
        for (i, p) in at.iter_mut().enumerate() {
            // At most half of the rate or of the width at a time.
            let most = if i == 0 { 0.5 * a } else { 0.5 * place[2] };
            *p += step.coefficients[i].clamp(-most, most);
        }
        fit = Some(step);
    }
    let fit = fit?;
    let [a, x, y, width] = at;
    let inside = a > 0.0 && x.abs() <= 2.0 && y.abs() <= 2.0 && (0.01..=10.0).contains(&width);
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
        let blocks: Vec<(f64, f64, f64)> = (0..12 * 16)
            .map(|i| ((i % 16) as f64, (i / 16) as f64))
            .map(|(i, j)| ((2.0 * i + 1.0) / 16.0 - 1.0, (2.0 * j + 1.0) / 12.0 - 1.0))
            .map(|(u, v)| (u, v, 0.3 + a * shape(u, v)))
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
