use super::*;
use crate::optics::diffraction::{Departures, Diffraction, Illumination};
use crate::scene::{Bands, Grid, LitScene, Quantity, Scene, Spectrum};
use std::f64::consts::PI;
use std::path::PathBuf;

/// A scene given by its exact cell averages in one or more bands.
struct Exact<F> {
    bands: Bands,
    average: F,
}

impl<F: Fn(&Grid, usize, usize) -> f64 + Send + Sync> Scene for Exact<F> {
    fn bands(&self) -> Bands {
        self.bands
    }
    fn quantity(&self) -> Quantity {
        Quantity::Radiance
    }
    fn aspect(&self) -> Option<f64> {
        None
    }
    fn plane(&self, _band: usize, grid: &Grid) -> crate::Result<Plane<f32>> {
        Ok(Plane::from_fn(grid.width, grid.height, |x, y| (self.average)(grid, x, y) as f32))
    }
}

fn one_band(nm: f64) -> Bands {
    Bands { start_nm: nm, step_nm: 10.0, count: 1 }
}

fn perfect(f_number: f64) -> Diffraction {
    Diffraction {
        f_number,
        focal_length_mm: 4.0,
        magnification: 0.0,
        transmittance: Spectrum::constant(1.0),
        illumination: Illumination::Uniform,
        departures: Departures::default(),
    }
}

fn render(
    scene: &dyn Scene,
    lens: &dyn Lens,
    grid: &SensorGrid,
    options: &Options,
) -> Vec<Plane<f32>> {
    let lit = LitScene { scene, white: vec![1.0; scene.bands().count] };
    let mut planes = Vec::new();
    irradiance(
        &lit,
        lens,
        grid,
        options,
        |_, _| {},
        |_, plane| {
            planes.push(plane);
            Ok(())
        },
    )
    .unwrap();
    planes
}

fn shared(path: &str) -> Option<PathBuf> {
    let root = std::env::var_os("CAMRIG_SHARED").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared")),
        PathBuf::from,
    );
    let path = root.join(path);
    if !path.exists() {
        println!("SKIP: {} is not there", path.display());
        return None;
    }
    Some(path)
}

fn csv(path: &str) -> Option<Vec<Vec<f64>>> {
    let text = std::fs::read_to_string(shared(path)?).unwrap();
    Some(
        text.lines()
            .skip(1)
            .map(|l| l.split(',').map(|v| v.parse().unwrap_or(f64::NAN)).collect())
            .collect(),
    )
}

#[test]
fn otf_agrees_with_another_program() {
    let Some(rows) = csv("golden/isetcam/c_otf_diffraction_dlMTF.csv") else { return };
    for row in rows {
        let [f_number, nm, cutoff, f, otf] = row[..] else { panic!("{row:?}") };
        let lens = perfect(f_number);
        assert!((lens.cutoff_per_mm(nm) / cutoff - 1.0).abs() < 1e-6);
        assert!((lens.otf(nm, f) - otf).abs() < 1e-6, "{row:?}");
    }
}

#[test]
fn cos4_agrees_with_another_program() {
    let Some(rows) = csv("golden/isetcam/d_cos4th.csv") else { return };
    for row in rows {
        let mut lens = perfect(4.0);
        lens.illumination = Illumination::Cos4;
        lens.focal_length_mm = row[3] * 1e3;
        let ratio = lens.illumination(550.0).unwrap()(row[6]);
        assert!((ratio - row[9]).abs() < 1e-6, "{row:?}: {ratio}");
    }
}

#[test]
fn irradiance_agrees_with_another_program() {
    // Radiance of the D65 scene of 100 cd/m² and its irradiance at f/4, m = -0.0033445, from the same
    // run; the other program loses 0.06 % to diffraction tails at its frame's edge.
    let Some(rows) = csv("golden/isetcam/a_scene_and_oi_spectrum_100cdm2_f4.csv") else { return };
    let lens = Diffraction { magnification: 0.0033445, ..perfect(4.0) };
    for row in rows {
        let ratio = lens.steradians(row[0]) * row[2] / row[4];
        assert!((ratio - 1.0).abs() < 1e-3, "{row:?}: {ratio}");
    }
    let Some(rows) = csv("golden/isetcam/b_illuminance_vs_distance_f4.csv") else { return };
    for row in rows {
        let lens = Diffraction { magnification: row[1].abs(), ..perfect(4.0) };
        let lux = 100.0 * lens.steradians(550.0);
        assert!((lux / row[2] - 1.0).abs() < 1e-3, "{row:?}: {lux}");
    }
    let Some(rows) = csv("golden/isetcam/b_irradiance_vs_luminance_fnumber.csv") else { return };
    for row in rows {
        let lens = Diffraction { magnification: 0.0033445, ..perfect(row[0]) };
        // That loss, 0.06 % at f/4, is proportional to λN.
        let lux = row[1] * lens.steradians(550.0) * (1.0 - 1.5e-4 * row[0]);
        assert!((lux / row[2] - 1.0).abs() < 1e-3, "{row:?}: {lux}");
    }
}

#[test]
fn uniform_scenes_come_out_as_equation_7_says() {
    let scene = Exact { bands: one_band(550.0), average: |_: &Grid, _, _| 2.0 };
    let grid = SensorGrid { width: 50, height: 31, pitch_um: 2.2, fill_factor: 0.6 };
    let mut lens = perfect(2.8);
    lens.magnification = 0.1;
    lens.transmittance = Spectrum::constant(0.8);
    let plane = &render(&scene, &lens, &grid, &Options::default())[0];
    let expected = PI * 2.0 * 0.8 / (1.0 + 4.0 * (2.8f64 * 1.1).powi(2));
    for &e in &plane.data {
        assert!((f64::from(e) / expected - 1.0).abs() < 2e-6, "{e} instead of {expected}");
    }
}

/// Overlap of the cell with a square of side `side` about the origin, as a fraction of the cell, over
/// side²: a point of unit flux.
fn point(side: f64) -> impl Fn(&Grid, usize, usize) -> f64 + Send + Sync {
    let overlap = move |from: f64, to: f64| (to.min(side / 2.0) - from.max(-side / 2.0)).max(0.0);
    move |g, x, y| {
        let (u, v) = (g.left + x as f64 * g.cell, g.top + y as f64 * g.cell);
        overlap(u, u + g.cell) * overlap(v, v + g.cell) / (g.cell * side).powi(2)
    }
}

#[test]
fn measured_otf_of_a_point_is_equation_4() {
    // Pixels of λN/2.5 sample the whole pass band. Of the tolerance of 0.5 % of full scale, the frame of
    // 512 of them takes 0.06 % on each of its four sides (2λN/(π³X) of the light falls beyond X), and
    // cells of λN/12.5 take (πhf)²/6 < 0.1 %: a point is the one scene that cell averages cannot hold.
    for nm in [400.0, 550.0, 700.0] {
        let lens = perfect(4.0);
        let pitch_um = nm * 1e-3 * 4.0 / 2.5;
        let n = 512;
        let grid = SensorGrid { width: n, height: n, pitch_um, fill_factor: 1e-6 };
        let side = 1.0 / (64.0 * n as f64);
        let scene = Exact { bands: one_band(nm), average: point(side) };
        let plane =
            &render(&scene, &lens, &grid, &Options { oversample: Some(5), ..Options::default() })
                [0];
        // The line-spread function's transform along x; the point sits between four pixels.
        let lines: Vec<f64> = (0..n)
            .map(|x| (0..n).map(|y| f64::from(plane.at(x, y))).sum::<f64>() / (n * n) as f64)
            .collect();
        let centre = n as f64 / 2.0;
        let mut worst: f64 = 0.0;
        for k in 0..100 {
            let per_mm = lens.cutoff_per_mm(nm) * f64::from(k) / 99.0;
            let turns = per_mm * pitch_um * 1e-3;
            let measured: f64 = lines
                .iter()
                .enumerate()
                .map(|(x, v)| v * (2.0 * PI * turns * (x as f64 + 0.5 - centre)).cos())
                .sum();
            worst = worst.max((measured / lens.steradians(nm) - lens.otf(nm, per_mm)).abs());
        }
        println!("{nm} nm: worst {worst:.5}");
        assert!(worst < 0.005, "{nm} nm: {worst}");
    }
}
