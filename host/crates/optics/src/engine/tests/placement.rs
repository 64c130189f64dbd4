//! Points and lines land where the lens's distortion says.

use super::*;
use crate::{Characterisation, Departed, Departures, Distortion};

#[test]
fn points_land_where_distortion_and_lateral_colour_say() {
    // The example lens: 2 % lateral colour and barrel distortion over a 0.9 mm wide sensor. Points
    // of half a pixel at ideal places; their centroids against the distortion table, per
    // wavelength.
    let lens = Characterisation::example(33, 0.25);
    let grid = SensorGrid { width: 400, height: 300, pitch_um: 2.2, fill_factor: 1.0 };
    let half = 0.25 / 400.0;
    let places: Vec<(f64, f64)> = (0..5)
        .flat_map(|j| {
            (0..6).map(move |i| (-0.42 + 0.164 * f64::from(i), -0.3 + 0.148 * f64::from(j)))
        })
        .collect();
    let inside = places.clone();
    let scene = Exact {
        bands: Bands { start_nm: 400.0, step_nm: 150.0, count: 3 },
        average: move |g: &Grid, x, y| {
            let (u, v) = (g.left + x as f64 * g.cell, g.top + y as f64 * g.cell);
            let overlap = |a: f64, p: f64| ((a + g.cell).min(p + half) - a.max(p - half)).max(0.0);
            inside.iter().map(|p| overlap(u, p.0) * overlap(v, p.1)).sum::<f64>()
                / (g.cell * g.cell)
        },
    };
    let planes = render(&scene, &lens, &grid, &Options::default());
    for (plane, nm) in planes.iter().zip([400.0, 550.0, 700.0]) {
        let distortion = lens.distortion(nm);
        for &(u, v) in &places {
            let (x, y) = (u * grid.width_mm(), v * grid.width_mm());
            let scale = distortion.at(x.hypot(y)) / x.hypot(y);
            let (px, py) = (x * scale / 2.2e-3 + 200.0, y * scale / 2.2e-3 + 150.0);
            let (mut sum, mut cx, mut cy) = (0.0, 0.0, 0.0);
            for j in (py as usize).saturating_sub(9)..(py as usize + 10).min(300) {
                for i in (px as usize).saturating_sub(9)..(px as usize + 10).min(400) {
                    let e = f64::from(plane.at(i, j));
                    sum += e;
                    cx += e * (i as f64 + 0.5);
                    cy += e * (j as f64 + 0.5);
                }
            }
            // The example's PSFs lean outwards beyond the axis: their own centroid is part of
            // them.
            let lean = lean_pixels(&lens, nm, x.hypot(y));
            let (ex, ey) = (px + lean * x / x.hypot(y), py + lean * y / x.hypot(y));
            let miss = (cx / sum - ex).hypot(cy / sum - ey);
            assert!(miss < 0.05, "{nm} nm ({u:.2}, {v:.2}): {miss:.3} pixels off");
        }
    }
}

/// Centroid of the PSF along the radius at a paraxial height, in pixels of 2.2 µm.
fn lean_pixels(lens: &Characterisation, nm: f64, height: f64) -> f64 {
    let psfs = lens.psf.at_wavelength(nm);
    let n = lens.psf.size;
    let lean = |psf: &[f32]| -> f64 {
        psf.iter()
            .enumerate()
            .map(|(k, &v)| f64::from(v) * ((k / n) as f64 - (n / 2) as f64))
            .sum()
    };
    let t = (height / 0.1).min(4.999);
    let (i, t) = (t as usize, t.fract());
    (lean(&psfs[i]) * (1.0 - t) + lean(&psfs[i + 1]) * t) * lens.psf.spacing_um / 2.2
}

#[test]
fn lines_of_a_grid_bend_as_distortion_says() {
    // Lines of 1.5 pixels at even ideal distances, read along rows (columns) between those that
    // cross them.
    let lens = Characterisation::example(33, 0.25);
    let grid = SensorGrid { width: 400, height: 300, pitch_um: 2.2, fill_factor: 1.0 };
    let (half, lines) = (0.75 / 400.0, [-0.33, -0.2, -0.07, 0.06, 0.19, 0.32]);
    let cover = move |from: f64, cell: f64| -> f64 {
        let overlap = |p: f64| ((from + cell).min(p + half) - from.max(p - half)).max(0.0);
        lines.iter().map(|&p| overlap(p)).sum::<f64>() / cell
    };
    let scene = Exact {
        bands: one_band(550.0),
        average: move |g: &Grid, x, y| {
            let across = cover(g.left + x as f64 * g.cell, g.cell);
            let down = cover(g.top + y as f64 * g.cell, g.cell);
            across + down - across * down
        },
    };
    let plane = &render(&scene, &lens, &grid, &Options::default())[0];
    let distortion = lens.distortion(550.0);
    let (width_mm, pitch_mm) = (grid.width_mm(), 2.2e-3);
    let middles: Vec<f64> = lines.windows(2).map(|w| 0.5 * (w[0] + w[1])).collect();
    let mut worst = 0.0f64;
    for (line, along, vertical) in lines.iter().flat_map(|&line| {
        middles.iter().flat_map(move |&along| [(line, along, true), (line, along, false)])
    }) {
        let limit = if vertical { 0.36 } else { 0.48 };
        if along.abs() > limit || line.abs() > 0.84 - limit {
            continue;
        }
        // The ideal line's real image where it meets the centre of a row (or column) of pixels.
        let (across_mm, mut along_mm) = (line * width_mm, along * width_mm);
        let scale = |a: f64, b: f64| distortion.at(a.hypot(b)) / a.hypot(b);
        let size = if vertical { 300 } else { 400 };
        let place = |mm: f64, n: usize| mm / pitch_mm + n as f64 / 2.0;
        let target = place(along_mm * scale(across_mm, along_mm), size).floor() + 0.5;
        let target_mm = (target - size as f64 / 2.0) * pitch_mm;
        for _ in 0..50 {
            along_mm = target_mm / scale(across_mm, along_mm);
        }
        let real_mm = across_mm * scale(across_mm, along_mm);
        let height = across_mm.hypot(along_mm);
        let expected = place(real_mm, if vertical { 400 } else { 300 })
            + lean_pixels(&lens, 550.0, height) * across_mm / height;
        let (mut sum, mut centre) = (0.0, 0.0);
        for i in (expected as usize).saturating_sub(10)..expected as usize + 11 {
            let e = match vertical {
                true => plane.at(i, target as usize),
                false => plane.at(target as usize, i),
            };
            sum += f64::from(e);
            centre += f64::from(e) * (i as f64 + 0.5);
        }
        worst = worst.max((centre / sum - expected).abs());
    }
    println!("lines: worst {worst:.3} pixels");
    assert!(worst > 0.0 && worst < 0.05, "{worst}");
}

#[test]
fn distortions_beyond_reason_keep_within_the_scene() {
    // Half the frame of margin and an axis off the centre take the mapping far beyond where a
    // strong barrel folds.
    let grid = SensorGrid { width: 90, height: 60, pitch_um: 5.0, fill_factor: 1.0 };
    let scene = Exact { bands: one_band(550.0), average: |_: &Grid, _, _| 1.0 };
    for k1 in [-0.3, -0.2, -0.1, -0.05, 0.2] {
        for axis_mm in [(0.0, 0.0), (0.05, -0.04), (-0.2, 0.1)] {
            let distortion = Distortion { size: 1.0, k1, k2: 0.0, unit_mm: grid.corner_mm() };
            let departures = Departures { distortion, axis_mm, ..Departures::default() };
            let lens = Departed { lens: Box::new(perfect(2.8)), departures };
            let plane = &render(&scene, &lens, &grid, &Options::default())[0];
            for &e in &plane.data {
                let light = f64::from(e) / lens.steradians(550.0);
                assert!((light - 1.0).abs() < 2e-6, "k1 {k1}, axis {axis_mm:?}: {light}");
            }
        }
    }
}
