//! The exact path: the same physics as the engine by direct sums in f64, for small images.
//!
//! It shares with the engine what is data — the padded cell grid, the scene on it and the PSF tables — and
//! nothing of how the engine computes: no fast transform, no folding, no tiles, no interpolation between
//! nodes (every cell scatters through the PSF of its own place). Cost grows with the square of the number
//! of cells: keep images below some 64 x 64 pixels.

use super::engine::psf::{KernelGrid, Place, TAIL};
use super::engine::sampling::{Layout, sinc};
use super::engine::source::Source;
use super::engine::{Blur, Lens, Options, SensorGrid};
use crate::scene::LitScene;
use crate::{Plane, Result};
use std::f64::consts::TAU;

/// Irradiance in one band, W m⁻² nm⁻¹, as [`super::irradiance`] gives it with `oversample` cells per pixel.
///
/// # Errors
/// Those of the scene.
pub fn irradiance(
    scene: &LitScene<'_>,
    band: usize,
    lens: &dyn Lens,
    grid: &SensorGrid,
    oversample: usize,
    options: &Options,
) -> Result<Plane<f64>> {
    let nm = scene.scene.bands().nm(band);
    let padded = |margin_um: f64| {
        let layout = Layout::new(grid, oversample, margin_um);
        let source = Source::new(scene, band, lens, nm, grid, &layout, options.border);
        source.rows(0, layout.cells_down()).map(|cells| (layout, cells))
    };
    let mut plane = match lens.blur(nm) {
        Blur::Otf { spread_um, otf, .. } => {
            let (layout, cells) = padded(spread_um + 4.0 * grid.pitch_um)?;
            through_otf(&cells, &layout, grid, &otf)
        }
        Blur::Field { psfs, .. } => {
            let radius_um = psfs.radius_um(TAIL);
            let kernel = KernelGrid::new(oversample, grid.pitch_um, grid.aperture_um(), radius_um);
            let (layout, cells) = padded((kernel.before + oversample) as f64 * kernel.cell_um)?;
            let place =
                Place { layout: &layout, pitch_mm: grid.pitch_um * 1e-3, axis_mm: lens.axis_mm() };
            scatter(&cells, &layout, &kernel, &|x, y| {
                let (x, y) = place.from_axis((x as f64 + 0.5, y as f64 + 0.5));
                psfs.kernel(x, y, &kernel)
            })
        }
    };
    apply_field(&mut plane, lens, nm, grid);
    Ok(plane)
}

/// Fourier series of the padded cells, multiplied by OTF, aperture and the inverse of the cells' own
/// average, summed at the pixel centres.
fn through_otf(
    cells: &Plane<f32>,
    layout: &Layout,
    grid: &SensorGrid,
    otf: &dyn Fn(f64) -> f64,
) -> Plane<f64> {
    let (w, h) = (cells.width, cells.height);
    let cell_mm = grid.pitch_um * 1e-3 / layout.oversample as f64;
    let aperture_mm = grid.aperture_um() * 1e-3;
    let range = |n: usize| -(((n - 1) / 2) as isize)..=((n - 1) / 2) as isize;
    let frequency = |k: isize, n: usize| k as f64 / (n as f64 * cell_mm);
    let gain = |f: f64| sinc(aperture_mm * f) / sinc(cell_mm * f);
    // Rows first: half-transformed[kx][y].
    let half: Vec<Vec<(f64, f64)>> = range(w)
        .map(|kx| {
            let row = |y: usize| {
                cells.row(y).iter().enumerate().fold((0.0, 0.0), |(re, im), (x, &v)| {
                    let (s, c) = (-TAU * kx as f64 * (x as f64 + 0.5) / w as f64).sin_cos();
                    (re + f64::from(v) * c, im + f64::from(v) * s)
                })
            };
            (0..h).map(row).collect()
        })
        .collect();
    let s = layout.oversample as f64;
    let centre = |p: usize, edge: usize| (p + edge) as f64 * s + s / 2.0;
    let mut out = Plane::filled(layout.width, layout.height, 0.0);
    for (kx, column) in range(w).zip(&half) {
        let fx = frequency(kx, w);
        for ky in range(h) {
            let fy = frequency(ky, h);
            let transfer = otf(fx.hypot(fy)) * gain(fx) * gain(fy) / (w * h) as f64;
            if transfer == 0.0 {
                continue;
            }
            let (mut re, mut im) = (0.0, 0.0);
            for (y, (a, b)) in column.iter().enumerate() {
                let (s, c) = (-TAU * ky as f64 * (y as f64 + 0.5) / h as f64).sin_cos();
                re += a * c - b * s;
                im += a * s + b * c;
            }
            for y in 0..layout.height {
                let turn = TAU * ky as f64 * centre(y, layout.top()) / h as f64;
                for x in 0..layout.width {
                    let phase = turn + TAU * kx as f64 * centre(x, layout.left()) / w as f64;
                    out.data[y * layout.width + x] +=
                        transfer * (re * phase.cos() - im * phase.sin());
                }
            }
        }
    }
    out
}

/// Every cell's light through the kernel of its own place.
fn scatter(
    cells: &Plane<f32>,
    layout: &Layout,
    grid: &KernelGrid,
    kernel: &dyn Fn(usize, usize) -> Vec<f32>,
) -> Plane<f64> {
    let s = layout.oversample;
    let mut out = Plane::filled(layout.width, layout.height, 0.0);
    // Pixel p of the frame lies `before` kernel entries from cell c where s·(p + edge) = c + i − before.
    let pixel = |c: usize, i: usize, edge: usize, n: usize| {
        let place = (c + i).checked_sub(grid.before + s * edge)?;
        (place.is_multiple_of(s) && place / s < n).then_some(place / s)
    };
    for cy in 0..cells.height {
        for cx in 0..cells.width {
            let light = f64::from(cells.at(cx, cy));
            let weights = kernel(cx, cy);
            for i in 0..grid.size {
                let Some(y) = pixel(cy, i, layout.top(), layout.height) else { continue };
                for j in 0..grid.size {
                    let Some(x) = pixel(cx, j, layout.left(), layout.width) else { continue };
                    out.data[y * layout.width + x] += light * f64::from(weights[i * grid.size + j]);
                }
            }
        }
    }
    out
}

fn apply_field(plane: &mut Plane<f64>, lens: &dyn Lens, nm: f64, grid: &SensorGrid) {
    let illumination = lens.illumination(nm);
    let (ax, ay) = lens.axis_mm();
    let pitch_mm = grid.pitch_um * 1e-3;
    let from_centre = |i: usize, n: usize| (i as f64 + 0.5 - n as f64 / 2.0) * pitch_mm;
    for y in 0..plane.height {
        for x in 0..plane.width {
            let h = (from_centre(x, plane.width) - ax).hypot(from_centre(y, plane.height) - ay);
            let ratio = illumination.as_ref().map_or(1.0, |curve| curve(h));
            let e = &mut plane.data[y * plane.width + x];
            *e = e.max(0.0) * lens.steradians(nm) * ratio;
        }
    }
    let glare = lens.veiling_glare();
    let mean = plane.data.iter().sum::<f64>() / plane.data.len() as f64;
    plane.data.iter_mut().for_each(|e| *e = (1.0 - glare) * *e + glare * mean);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::{
        Departed, Departures, Diffraction, Distortion, Illumination, Report, characterisation,
    };
    use crate::scene::{Bands, Grid, Quantity, Scene, Spectrum};
    use std::f64::consts::PI;

    /// Bright and dark patches with detail down to a cell.
    struct Patches;

    impl Scene for Patches {
        fn bands(&self) -> Bands {
            Bands { start_nm: 520.0, step_nm: 10.0, count: 1 }
        }
        fn quantity(&self) -> Quantity {
            Quantity::Radiance
        }
        fn aspect(&self) -> Option<f64> {
            None
        }
        fn plane(&self, _band: usize, grid: &Grid) -> Result<Plane<f32>> {
            Ok(Plane::from_fn(grid.width, grid.height, |x, y| {
                let u = grid.left + (x as f64 + 0.5) * grid.cell;
                let v = grid.top + (y as f64 + 0.5) * grid.cell;
                let patch = ((u * 9.0).floor() * 3.7 + (v * 7.0).floor() * 1.9).sin();
                (1.0 + 0.8 * patch + 0.2 * (60.0 * PI * u * (1.0 + v)).sin()) as f32
            }))
        }
    }

    /// Largest difference of engine and reference over the irradiance of the scene's brightest place, and
    /// the engine's report.
    fn difference(
        lens: &dyn Lens,
        grid: &SensorGrid,
        oversample: usize,
        options: &Options,
    ) -> (f64, Report) {
        let lit = LitScene { scene: &Patches, white: vec![1.0] };
        let exact = irradiance(&lit, 0, lens, grid, oversample, options).unwrap();
        let options = Options { oversample: Some(oversample), ..*options };
        let mut worst = 0.0f64;
        // The brightest radiance is 1 + 0.8 + 0.2.
        let peak = 2.0 * lens.steradians(520.0);
        let report = crate::optics::irradiance(
            &lit,
            lens,
            grid,
            &options,
            |_, _| {},
            |_, plane| {
                for (a, e) in plane.data.iter().zip(&exact.data) {
                    worst = worst.max((f64::from(*a) - e).abs() / peak);
                }
                Ok(())
            },
        )
        .unwrap();
        (worst, report)
    }

    #[test]
    fn the_engine_agrees_through_an_otf_with_every_departure_and_border() {
        let lens = Diffraction {
            f_number: 2.8,
            focal_length_mm: 0.2,
            magnification: 0.05,
            transmittance: Spectrum::constant(0.9),
            illumination: Illumination::Cos4,
            defocus_um: 9.0,
        };
        let departures = Departures {
            transmittance: Spectrum::constant(0.95),
            distortion: Distortion { size: 0.99, k1: -0.08, k2: 0.03, unit_mm: 0.21 },
            lateral_colour: Spectrum::constant(1.01),
            veiling_glare: 0.03,
            axis_mm: (0.003, -0.005),
        };
        let lens = Departed { lens: Box::new(lens), departures };
        let grid = SensorGrid { width: 30, height: 22, pitch_um: 2.2, fill_factor: 0.7 };
        use crate::optics::Border::{Black, Edge, Mirror, Scene};
        for (oversample, border) in [(1, Mirror), (1, Edge), (2, Scene), (2, Black)] {
            let options = Options { border, ..Options::default() };
            let (worst, _) = difference(&lens, &grid, oversample, &options);
            println!("OTF, s {oversample}, {border:?}: {worst:.1e}");
            // f32 transforms and a 4096-step table of the OTF.
            assert!(worst < 2e-6, "s {oversample}, {border:?}: {worst}");
        }
    }

    #[test]
    fn the_engine_agrees_through_a_varying_field_as_its_node_error_says() {
        let lens = characterisation::tests::example(17, 0.5);
        let grid = SensorGrid { width: 40, height: 30, pitch_um: 8.0, fill_factor: 0.7 };
        let options = Options { misplaced_light: 1e-3, ..Options::default() };
        let (worst, report) = difference(&lens, &grid, 2, &options);
        let nodes = report.nodes.unwrap();
        println!("field, s 2: {worst:.1e}, {nodes:?}");
        // What is left is interpolation between nodes. A pixel's error is at most the brightest radiance
        // times Σ|ΔK|, twice the misplaced light; the report's sample of the field finds its largest value
        // to some tens of per cent.
        assert!(worst < 3.0 * nodes.misplaced.1, "{worst}, {nodes:?}");
    }
}
