//! The reference: the physics of the engine by direct sums in f64, for small images.
//!
//! It shares with the engine what is data — the padded cell grid, the scene on it and the kernels — and nothing of how the engine computes: no fast transform, no folding, no tiles. Every
//! cell scatters through the PSF of its own place, or, to tell the engine's arithmetic from its
//! interpolation, through the blend of the nodes around it ([`Psfs`]). Cost grows with the square
//! of the number of cells: keep images below some 64 x 64 pixels.

use super::engine::FieldGrids;
use super::engine::fourier::{self, Kernel};
use super::engine::nodes::Place;
use super::engine::psf::KernelGrid;
use super::engine::sampling::{Cells, Layout};
use super::engine::source::{Source, Warp};
use super::engine::wide::Wide;
use super::engine::{Blur, Lens, Options, SensorGrid};
use camrig_base::{Plane, Result};
use camrig_scene::LitScene;
use std::borrow::Cow;

/// Which PSF a cell of the scene has where PSFs vary over the field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Psfs {
    /// The PSF of its own place.
    OwnPlace,
    /// The bilinear blend of the PSFs at the corners of its square of this many cells.
    Nodes(usize),
}

/// Irradiance in one band, W m⁻² nm⁻¹, as [`super::irradiance`] gives it with `oversample` cells
/// per pixel.
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
    choice: Psfs,
) -> Result<Plane<f64>> {
    let nm = scene.scene.bands().nm(band);
    let source = |cells: &Cells| {
        let warp = Warp::new(lens, nm, grid, cells);
        Source::new(scene, band, warp, cells, options.border)
    };
    let mut plane = match lens.blur(nm) {
        Blur::Otf(otf) => {
            let spread = |cells: &Plane<f32>, kernel: &Kernel, grid, layout: &Layout| {
                let values = kernel.values(&SensorGrid::geometry(grid, layout));
                scatter(cells, layout, &otf_grid(layout, grid), &|_, _| Cow::Borrowed(&values))
            };
            let wide = Wide::new(grid, &[&otf]);
            let core = wide.core(&otf);
            let layout = fourier::layout(grid, oversample, core.spread_um);
            let kernel = Kernel::of_core(&core, wide.far(&otf), &grid.geometry(&layout));
            let cells = source(&layout.cells(grid)).plane()?;
            let mut plane = spread(&cells, &kernel, grid, &layout);
            let light = wide.light(|_, cells| source(cells))?;
            for (ring, light) in wide.rings.iter().zip(&light) {
                let cells = ring.rows(light)(0, ring.layout.padded_height)?;
                let kernel = ring.kernel(otf.tail_um);
                ring.add_to(&mut plane, &spread(&cells, &kernel, &ring.grid, &ring.layout));
            }
            plane
        }
        Blur::Field { psfs, .. } => {
            let FieldGrids { layout, kernel } = FieldGrids::new(&psfs, grid, oversample);
            let cells = source(&layout.cells(grid)).plane()?;
            let place =
                Place { layout: &layout, pitch_mm: grid.pitch_um * 1e-3, axis_mm: lens.axis_mm() };
            let kernel_at = |x: f64, y: f64| {
                let (x, y) = place.from_axis((x, y));
                let kernel = psfs.kernel(x, y, &kernel);
                kernel.into_iter().map(f64::from).collect::<Vec<f64>>()
            };
            match choice {
                Psfs::OwnPlace => scatter(&cells, &layout, &kernel, &|x, y| {
                    Cow::Owned(kernel_at(x as f64 + 0.5, y as f64 + 0.5))
                }),
                Psfs::Nodes(tile) => {
                    let (across, down) = (cells.width / tile + 2, cells.height / tile + 2);
                    let node = |k: usize| (k % across * tile) as f64;
                    let nodes: Vec<Vec<f64>> = (0..across * down)
                        .map(|k| kernel_at(node(k), (k / across * tile) as f64))
                        .collect();
                    scatter(&cells, &layout, &kernel, &|x, y| {
                        Cow::Owned(blend(&nodes, across, tile, x, y))
                    })
                }
            }
        }
    };
    apply_field(&mut plane, lens, nm, grid);
    Ok(plane)
}

/// Where the entries of an OTF's kernel lie.
fn otf_grid(layout: &Layout, grid: &SensorGrid) -> KernelGrid {
    let (n, s) = (layout.support(), layout.oversample);
    KernelGrid {
        size: n,
        before: (n + s) / 2 - 1,
        oversample: s,
        cell_um: grid.pitch_um / s as f64,
        aperture_um: grid.aperture_um(),
    }
}

/// Every cell's light through the kernel of its own place.
fn scatter<'a>(
    cells: &Plane<f32>,
    layout: &Layout,
    grid: &KernelGrid,
    kernel: &dyn Fn(usize, usize) -> Cow<'a, [f64]>,
) -> Plane<f64> {
    let s = layout.oversample;
    let mut out = Plane::filled(layout.width, layout.height, 0.0);
    // Pixel p of the frame lies `before` kernel entries from cell c where s·(p + edge) = c + i −
    // before.
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
                    out.data[y * layout.width + x] += light * weights[i * grid.size + j];
                }
            }
        }
    }
    out
}

/// The blend of the four nodes around cell (x, y).
fn blend(nodes: &[Vec<f64>], across: usize, tile: usize, x: usize, y: usize) -> Vec<f64> {
    let corner = y / tile * across + x / tile;
    let [t, v] = [x, y].map(|c| ((c % tile) as f64 + 0.5) / tile as f64);
    let weighted = [
        ((1.0 - v) * (1.0 - t), &nodes[corner]),
        ((1.0 - v) * t, &nodes[corner + 1]),
        (v * (1.0 - t), &nodes[corner + across]),
        (v * t, &nodes[corner + across + 1]),
    ];
    (0..nodes[corner].len()).map(|k| weighted.iter().map(|(w, node)| w * node[k]).sum()).collect()
}

fn apply_field(plane: &mut Plane<f64>, lens: &dyn Lens, nm: f64, grid: &SensorGrid) {
    let illumination = lens.illumination(nm);
    let (ax, ay) = lens.axis_mm();
    let pitch_mm = grid.pitch_um * 1e-3;
    let from_centre = |i: usize, n: usize| (i as f64 + 0.5 - n as f64 / 2.0) * pitch_mm;
    for y in 0..plane.height {
        for x in 0..plane.width {
            let (dx, dy) = (from_centre(x, plane.width) - ax, from_centre(y, plane.height) - ay);
            let ratio = illumination.as_ref().map_or(1.0, |ratio| ratio.at(dx, dy));
            let e = &mut plane.data[y * plane.width + x];
            *e = e.max(0.0) * lens.steradians(nm) * ratio;
        }
    }
    let glare = lens.veiling_glare();
    let mean = plane.data.iter().sum::<f64>() / plane.data.len() as f64;
    plane.data.iter_mut().for_each(|e| *e = (1.0 - glare) * *e + glare * mean);
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::Device;
    use crate::{
        Characterisation, Departed, Departures, Diffraction, Distortion, Illumination, Report,
    };
    use camrig_base::{Bands, Spectrum};
    use camrig_scene::{Grid, Quantity, Scene};
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

    /// The engine's plane of the pattern, and its report.
    pub(crate) fn engine(
        lens: &dyn Lens,
        grid: &SensorGrid,
        oversample: usize,
        options: &Options,
    ) -> (Plane<f32>, Report) {
        let lit = LitScene { scene: &Patches, white: vec![1.0] };
        let options = Options { oversample: Some(oversample), ..*options };
        let mut plane = Plane::filled(0, 0, 0.0);
        let report = crate::irradiance(
            &lit,
            lens,
            grid,
            &options,
            |_, _| {},
            |_, p| {
                plane = p;
                Ok(())
            },
        );
        (plane, report.unwrap())
    }

    /// Largest difference of a plane and the reference over the irradiance of the scene's
    /// brightest place.
    fn difference(
        plane: &Plane<f32>,
        lens: &dyn Lens,
        grid: &SensorGrid,
        oversample: usize,
        options: &Options,
        psfs: Psfs,
    ) -> f64 {
        let lit = LitScene { scene: &Patches, white: vec![1.0] };
        let exact = irradiance(&lit, 0, lens, grid, oversample, options, psfs).unwrap();
        assert_eq!((plane.width, plane.height), (exact.width, exact.height));
        // The brightest radiance is 1 + 0.8 + 0.2.
        let peak = 2.0 * lens.steradians(520.0);
        let differences = plane.data.iter().zip(&exact.data).map(|(a, e)| f64::from(*a) - e);
        differences.fold(0.0, |m: f64, d| m.max(d.abs())) / peak
    }

    use crate::Border::{Black, Edge, Mirror, Scene as Beyond};

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
        for (oversample, border) in [(1, Mirror), (1, Edge), (2, Beyond), (2, Black)] {
            let options = Options { border, ..Options::default() };
            let (plane, _) = engine(&lens, &grid, oversample, &options);
            let worst = difference(&plane, &lens, &grid, oversample, &options, Psfs::OwnPlace);
            println!("OTF, s {oversample}, {border:?}: {worst:.1e}");
            // f32 transforms and a 4096-step table of the OTF.
            assert!(worst < 2e-6, "s {oversample}, {border:?}: {worst}");
        }
    }

    /// A lens whose PSFs, distortion and fall-off vary over the field, and its axis off the
    /// sensor's centre.
    fn varying(axis_mm: (f64, f64)) -> Departed {
        let lens = Characterisation::example(17, 0.5);
        Departed {
            lens: Box::new(lens),
            departures: Departures { axis_mm, ..Departures::default() },
        }
    }

    #[test]
    fn the_engine_agrees_through_a_varying_field_with_the_same_nodes_everywhere() {
        // Odd and even sizes, nodes few and many, every border, the axis inside and outside the
        // frame.
        for (width, height, pitch_um, oversample, border, axis_mm) in [
            (40, 30, 8.0, 2, Beyond, (0.0, 0.0)),
            (37, 29, 8.0, 1, Black, (0.02, -0.01)),
            (23, 41, 6.5, 3, Edge, (-0.2, 0.1)),
            (33, 17, 9.0, 2, Mirror, (0.0, 0.05)),
            (1, 3, 8.0, 2, Beyond, (0.0, 0.0)),
        ] {
            let (lens, grid) =
                (varying(axis_mm), SensorGrid { width, height, pitch_um, fill_factor: 0.7 });
            let devices = Device::available().into_iter();
            for (device, misplaced_light) in devices.flat_map(|d| [(d, 0.02), (d, 1e-4)]) {
                let options = Options { border, misplaced_light, device, ..Options::default() };
                let (plane, report) = engine(&lens, &grid, oversample, &options);
                assert_eq!(report.device.as_deref(), device.name());
                let nodes = Psfs::Nodes(report.nodes.unwrap().tile);
                let worst = difference(&plane, &lens, &grid, oversample, &options, nodes);
                let name = device.name().unwrap_or("cpu");
                println!(
                    "{width}x{height}, s {oversample}, {border:?}, {nodes:?}, {name}: {worst:.1e}"
                );
                // Transforms or sums in f32: a few 1e-7. Asked for: 1e-5 everywhere in the field.
                assert!(worst < 1e-6, "{width}x{height}, {border:?}, {nodes:?}, {name}: {worst}");
            }
        }
    }

    #[test]
    fn what_interpolation_between_nodes_costs_is_what_the_report_says() {
        let (lens, grid) = (
            varying((0.0, 0.0)),
            SensorGrid { width: 40, height: 30, pitch_um: 8.0, fill_factor: 0.7 },
        );
        let options = Options { misplaced_light: 1e-3, ..Options::default() };
        let (plane, report) = engine(&lens, &grid, 2, &options);
        let nodes = report.nodes.unwrap();
        let worst = difference(&plane, &lens, &grid, 2, &options, Psfs::OwnPlace);
        println!("field, s 2: {worst:.1e}, {nodes:?}");
        // A pixel's error is at most the brightest radiance times Σ|ΔK|, twice the misplaced
        // light; the report's sample of the field finds its largest value to some tens of per
        // cent.
        assert!(worst < 3.0 * nodes.nodes.largest, "{worst}, {nodes:?}");
        assert!(worst > 1e-5, "else the test above says the same: {worst}");
    }
}
