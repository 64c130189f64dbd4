//! Scenes of wide range and lenses of any sharpness: what must hold of the light.

use super::*;
use crate::reference::{self, Psfs};

/// A lamp of 1e9 beside a wall of 10.
fn lamp() -> impl Scene {
    let average = |g: &Grid, x: usize, y: usize| {
        let (u, v) = (g.left + (x as f64 + 0.5) * g.cell, g.top + (y as f64 + 0.5) * g.cell);
        let inside = (u + 0.21).abs() < 0.03 && (v - 0.11).abs() < 0.02;
        if inside { 1e9 } else { 10.0 + 2.0 * (9.0 * u).sin() }
    };
    Exact { bands: one_band(550.0), average }
}

#[test]
fn dark_pixels_beside_a_lamp_are_right() {
    let grid = SensorGrid { width: 66, height: 50, pitch_um: 2.2, fill_factor: 1.0 };
    let lit = LitScene { scene: &lamp(), white: vec![1.0] };
    for (table, oversample) in [(false, 1), (false, 2), (true, 1), (true, 2), (true, 3)] {
        let lens = GaussianOtf { sigma_um: 1.1, table };
        for device in Device::available() {
            let options = Options { oversample: Some(oversample), device, ..Options::default() };
            let mut bytes = Vec::new();
            for threads in [1, 3] {
                let options = Options { threads: Some(threads), ..options };
                bytes.push(render(&lamp(), &lens, &grid, &options).remove(0));
            }
            assert_eq!(bytes[0], bytes[1]);
            let choice = Psfs::OwnPlace;
            let exact = reference::irradiance(&lit, 0, &lens, &grid, oversample, &options, choice);
            let (exact, mut dark) = (exact.unwrap(), 0);
            for (k, (found, exact)) in bytes[0].data.iter().zip(&exact.data).enumerate() {
                let error = f64::from(*found) / exact - 1.0;
                let name = device.name().unwrap_or("cpu");
                // Where the light is the wall's: to 1 %. An OTF cut at the cell grid's Nyquist
                // frequency and next to nothing may leave either sign.
                if (8.0..12.5).contains(exact) {
                    dark += 1;
                    assert!(error.abs() < 1e-2, "{name}, pixel {k}: {found}, not {exact}");
                }
            }
            println!("table {table}, s {oversample}: {dark} dark pixels");
            assert!(dark > 1000, "{dark}");
        }
    }
}

#[test]
fn a_lamp_in_the_dark_leaves_it_dark() {
    let average = |g: &Grid, x: usize, y: usize| {
        let (u, v) = (g.left + x as f64 * g.cell, g.top + y as f64 * g.cell);
        if u.abs() < g.cell && v.abs() < g.cell { 1e9 } else { 0.0 }
    };
    let scene = Exact { bands: one_band(550.0), average };
    let grid = SensorGrid { width: 256, height: 200, pitch_um: 2.2, fill_factor: 1.0 };
    for table in [false, true] {
        let lens = GaussianOtf { sigma_um: 1.1, table };
        let plane = &render(&scene, &lens, &grid, &Options::default())[0];
        let far = plane.data[..60 * 256].iter().fold(0.0f32, |m, &v| m.max(v));
        // f64 leaves 1e-16 of the lamp.
        assert!(far < 1e-5, "{far}");
    }
}

#[test]
fn no_light_is_made_or_lost_whatever_the_ratio_of_psf_to_pixel() {
    // A bright square in the dark, whose edges lie anywhere in a cell, and one point, through PSFs
    // of λN = 0.1 to 8 µm on whole pixels of 30 and 3 µm. Of a diffraction-limited lens, the wings
    // that leave the frame are missing: 2λN/(π³X) of the light beyond X on each side.
    let edges = |half: f64| {
        move |g: &Grid, x: usize, y: usize| {
            let share = |from: f64, to: f64| (to.min(half) - from.max(-half)).max(0.0) / g.cell;
            let (u, v) = (g.left + x as f64 * g.cell, g.top + y as f64 * g.cell);
            share(u, u + g.cell) * share(v, v + g.cell)
        }
    };
    for (pitch_um, half) in [(30.0, 0.1037), (30.0, 0.0008), (3.0, 0.1037)] {
        for lambda_n_um in [0.1, 0.2, 0.4, 0.8, 1.5, 3.0, 8.0] {
            let scene = Exact { bands: one_band(550.0), average: edges(half) };
            let grid = SensorGrid { width: 100, height: 100, pitch_um, fill_factor: 1.0 };
            for kind in 0..3 {
                let lens: Box<dyn Lens> = match kind {
                    0 => Box::new(perfect(lambda_n_um / 0.55)),
                    _ => Box::new(GaussianOtf { sigma_um: 0.4 * lambda_n_um, table: kind == 1 }),
                };
                let plane = &render(&scene, &*lens, &grid, &Options::default())[0];
                let sum: f64 = plane.data.iter().map(|&v| f64::from(v)).sum();
                let share = sum / (lens.steradians(550.0) * (2.0 * half * 100.0).powi(2));
                let wings = if kind == 0 {
                    4.0 * 2.0 * lambda_n_um / (PI.powi(3) * (0.5 - half) * 100.0 * pitch_um)
                } else {
                    0.0
                };
                let what = format!("{kind}, λN {lambda_n_um}, {pitch_um} µm, half {half}");
                println!("{what}: {:+.1e}, wings {wings:.1e}", share - 1.0);
                let least = plane.data.iter().fold(f32::INFINITY, |m, &v| m.min(v));
                assert!(least >= 0.0, "{what}: {least}");
                assert!((-wings - 1e-4..1e-4).contains(&(share - 1.0)), "{what}: {share}");
            }
        }
    }
}
