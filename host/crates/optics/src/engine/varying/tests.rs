//! The blur against its defining sum.

use super::super::device::{self, Device};
use super::*;

pub fn noise(seed: usize) -> f32 {
    ((seed.wrapping_mul(2_654_435_761) >> 9) % 4096) as f32 / 4096.0
}

/// The defining sum in f64.
fn direct(
    source: &Plane<f32>,
    t: &Tiling,
    kernels: &Kernels,
    (left, top): (usize, usize),
    (width, height): (usize, usize),
) -> Plane<f64> {
    let (size, nodes) = (kernels.size, t.across() + 1);
    let mut out = Plane::filled(width, height, 0.0);
    for cy in 0..source.height {
        for cx in 0..source.width {
            let (i, j) = (cx / t.tile, cy / t.tile);
            let x = ((cx % t.tile) as f64 + 0.5) / t.tile as f64;
            let y = ((cy % t.tile) as f64 + 0.5) / t.tile as f64;
            let corners = [
                ((1.0 - y) * (1.0 - x), j * nodes + i),
                ((1.0 - y) * x, j * nodes + i + 1),
                (y * (1.0 - x), (j + 1) * nodes + i),
                (y * x, (j + 1) * nodes + i + 1),
            ];
            for ky in 0..size {
                for kx in 0..size {
                    let (py, px) = (cy + ky, cx + kx);
                    let s = t.oversample;
                    if py % s != t.before % s || px % s != t.before % s {
                        continue;
                    }
                    let place = |p: usize, edge: usize| (p / s).checked_sub(t.before / s + edge);
                    let (Some(qy), Some(qx)) = (place(py, top), place(px, left)) else {
                        continue;
                    };
                    if qy < height && qx < width {
                        let k: f64 = corners
                            .iter()
                            .map(|&(w, n)| {
                                w * f64::from(kernels.data[(n * size + ky) * size + kx])
                            })
                            .sum();
                        out.data[qy * width + qx] += k * f64::from(source.at(cx, cy));
                    }
                }
            }
        }
    }
    out
}

#[test]
fn equals_the_defining_sum() {
    for (s, size, before, tile, (w, h)) in [
        (1, 5, 2, 12, (40, 33)),
        (2, 8, 4, 14, (44, 30)),
        (3, 11, 3, 21, (60, 45)),
        (1, 35, 17, 40, (64, 70)),
        (1, 81, 40, 50, (140, 128)),
        (2, 62, 30, 70, (150, 120)),
        // A graphics processor's workgroup has as much fast memory as this takes, and a stand-in
        // in software would leave its loops early.
        (16, 40, 16, 48, (480, 320)),
        // Transforms of one stage and of none.
        (1, 1, 0, 2, (5, 4)),
        (1, 1, 0, 1, (3, 2)),
    ] {
        let t = Tiling::new(s, (w, h), size, before, tile);
        let nodes = (t.across() + 1) * (t.down() + 1);
        let kernels = Kernels {
            size,
            data: (0..nodes * size * size).map(|i| noise(i) / (size * size) as f32).collect(),
        };
        let source = Plane::from_fn(w, h, |x, y| noise(x * 71 + y * 1009 + 5));
        let rows = rows_of(&source);
        let edge = (size / s / 2, size / s / 2);
        let frame = (w / s - 2 * edge.0, h / s - 2 * edge.1);
        let exact = direct(&source, &t, &kernels, edge, frame);
        let peak = exact.data.iter().fold(0.0f64, |m, v| m.max(*v));
        for device in Device::available() {
            let mut blurrer = device::Blurrer::new(device, &t).unwrap();
            let fast = blurrer.blur(&rows, &kernels, edge, frame).unwrap();
            let worst = fast.data.iter().zip(&exact.data).map(|(a, b)| (f64::from(*a) - b).abs());
            let worst = worst.fold(0.0, f64::max) / peak;
            let name = device.name().unwrap_or("cpu");
            println!("s {s} kernel {size} tile {}, {name}: {worst:.2e}", t.tile);
            // f32 arithmetic: a few 2⁻²⁴ over log2(n) stages of transforms; √(2n + 16)·2⁻²⁴ for
            // sums over n entries of n rows and nine nodes, where roundings have random signs:
            // 8e-7 for 81 entries.
            assert!(worst < 1e-6, "s {s}, kernel {size}, {name}: {worst}");
        }
    }
}

/// Rows of a plane.
pub fn rows_of(source: &Plane<f32>) -> impl Fn(usize, usize) -> Result<Plane<f32>> + Sync {
    move |first, count| {
        let w = source.width;
        let data = source.data[first * w..(first + count) * w].to_vec();
        Ok(Plane { width: w, height: count, data })
    }
}

#[test]
fn spectral_components_give_what_the_bands_give() {
    // Seven bands that are mixtures of three components, into two channels; kernels differ by band
    // and node.
    let (bands, (w, h), size) = (7, (70, 50), 9);
    let t = Tiling::new(1, (w, h), size, 4, 24);
    let nodes = (t.across() + 1) * (t.down() + 1);
    let kernels: Vec<Kernels> = (0..bands)
        .map(|b| Kernels {
            size,
            data: (0..nodes * size * size)
                .map(|i| noise(i * 7 + b * 1013) / (size * size) as f32)
                .collect(),
        })
        .collect();
    let components: Vec<Plane<f32>> =
        (0..3).map(|k| Plane::from_fn(w, h, |x, y| noise(x * 71 + y * 1009 + k * 37))).collect();
    let mixture = |k: usize, b: usize| ((b * k) as f32 * 0.7).cos();
    let response = |c: usize, b: usize| 0.1 + ((b + 2 * c) as f32 * 0.9).sin().abs();
    let (frame, corner) = ((w - 8, h - 8), (4, 4));
    let mut blurrer = Blurrer::new(&t);

    let mut exact = vec![Plane::filled(frame.0, frame.1, 0.0f64); 2];
    for b in 0..bands {
        let band = Plane::from_fn(w, h, |x, y| {
            components.iter().enumerate().map(|(k, c)| mixture(k, b) * c.at(x, y)).sum()
        });
        let blurred = direct(&band, &t, &kernels[b], corner, frame);
        for (c, sum) in exact.iter_mut().enumerate() {
            for (s, v) in sum.data.iter_mut().zip(&blurred.data) {
                *s += f64::from(response(c, b)) * v;
            }
        }
    }

    let collapsed: Vec<Vec<Kernels>> = (0..2)
        .map(|c| {
            (0..3)
                .map(|k| {
                    let parts: Vec<(f32, &Kernels)> = kernels
                        .iter()
                        .enumerate()
                        .map(|(b, kernels)| (response(c, b) * mixture(k, b), kernels))
                        .collect();
                    Kernels::combined(&parts)
                })
                .collect()
        })
        .collect();
    let collapsed: Vec<Vec<&Kernels>> = collapsed.iter().map(|c| c.iter().collect()).collect();
    let collapsed: Vec<&[&Kernels]> = collapsed.iter().map(Vec::as_slice).collect();
    let rows: Vec<_> = components.iter().map(rows_of).collect();
    let rows: Vec<&Rows<'_>> = rows.iter().map(|r| r as &Rows<'_>).collect();
    // Into three planes: each channel and their mean.
    let weights: [&[f32]; 3] = [&[1.0, 0.0], &[0.0, 1.0], &[0.5, 0.5]];
    let mut found = vec![Plane::filled(frame.0, frame.1, 0.0); 3];
    blurrer.add(&rows, Pairs::Kernels(&collapsed), corner, &weights, &mut found).unwrap();
    // Kernels transformed before give the same bits.
    let transformed = blurrer.transformed(&collapsed).unwrap();
    let mut again = vec![Plane::filled(frame.0, frame.1, 0.0); 3];
    let pairs = Pairs::Transformed(&transformed);
    blurrer.add(&rows, pairs, corner, &weights, &mut again).unwrap();
    assert!(found.iter().zip(&again).all(|(found, again)| found.data == again.data));
    exact.push(Plane::from_fn(frame.0, frame.1, |x, y| {
        0.5 * (exact[0].at(x, y) + exact[1].at(x, y))
    }));
    for (found, exact) in found.iter().zip(&exact) {
        let peak = exact.data.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let errors = found.data.iter().zip(&exact.data).map(|(a, b)| (f64::from(*a) - b).abs());
        let worst = errors.fold(0.0, f64::max) / peak;
        println!("three components of seven bands: {worst:.1e} of the peak");
        // f32 throughout: mixtures, kernels and transforms, a few 2⁻²⁴ each.
        assert!(worst < 1e-6, "{worst}");
    }
}

#[test]
fn ripple_of_f32_is_what_the_range_allows() {
    // A lamp of `side` cells in a plane of 10: what f32 adds to the dark cells, over the lamp.
    let mut worst: f64 = 0.0;
    for (n, tile, side) in [(64, 40, 1), (200, 96, 6), (400, 200, 30), (600, 500, 100)] {
        let t = Tiling::new(1, (n, n), 9, 4, tile);
        let nodes = (t.across() + 1) * (t.down() + 1);
        let kernels = Kernels { size: 9, data: vec![1.0 / 81.0; nodes * 81] };
        let lit = |i: usize| (n / 3..n / 3 + side).contains(&i);
        let lamp = 1e9;
        let source = Plane::from_fn(n, n, |x, y| if lit(x) && lit(y) { lamp } else { 10.0 });
        let mut plane = [Plane::filled(n - 8, n - 8, 0.0)];
        let place = Place { corner: (4, 4), weights: &[&[1.0]] };
        let rows = rows_of(&source);
        let range =
            Transforms::<f32>::new(&t).add(&[&rows], &[&[&kernels]], None, &place, &mut plane);
        assert!(range.unwrap().is_wide());
        let near = |i: usize| (n / 3 - 4..n / 3 + side + 4).contains(&(i + 4));
        for (k, v) in plane[0].data.iter().enumerate() {
            if !(near(k % (n - 8)) && near(k / (n - 8))) {
                worst = worst.max((f64::from(*v) - 10.0).abs() / f64::from(lamp));
            }
        }
        println!("{n} cells, lamp of {side}: {worst:.1e}");
    }
    assert!(worst < super::super::range::RIPPLE, "{worst}");
}
