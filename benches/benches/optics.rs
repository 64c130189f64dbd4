//! The optics stage: field-varying blur of workload W (4096 x 4096 cells x 31 bands, 31 x 31 kernels)
//! and the diffraction-limited engine, as times and as ratios within one run.
//!
//! `cargo bench -p camrig-benches --bench optics [-- FILTER]`; `CAMRIG_BENCH_SMALL=1` runs one
//! sixteenth of the area.

use camrig::optics::engine::varying::{Blurrer, Kernels, Tiling};
use camrig::optics::{Diffraction, Illumination, Options, SensorGrid, irradiance};
use camrig::scene::{Bands, Grid, LitScene, Quantity, Scene, Spectrum};
use camrig::{Plane, Result};
use std::hint::black_box;
use std::time::Instant;

/// Gaussian kernels that grow and stretch along the radius towards the corners.
fn kernels(tiling: &Tiling, wavelength: usize) -> Kernels {
    let size = tiling.kernel;
    let half = (size / 2) as f64;
    let (w, h) = (tiling.width as f64, tiling.height as f64);
    let mut data = Vec::new();
    for j in 0..=tiling.down() {
        for i in 0..=tiling.across() {
            let (x, y) = tiling.node(i, j);
            let (x, y) = (2.0 * x / w - 1.0, 2.0 * y / h - 1.0);
            let r = x.hypot(y);
            let (sin, cos) = y.atan2(x).sin_cos();
            let (radial, across) = (1.0 + 2.5 * r * r + wavelength as f64 * 0.02, 0.9 + 0.7 * r);
            let values: Vec<f64> = (0..size * size)
                .map(|k| {
                    let (dy, dx) = ((k / size) as f64 - half, (k % size) as f64 - half);
                    let (u, v) = (dx * cos + dy * sin - 0.7 * r, dy * cos - dx * sin);
                    (-0.5 * ((u / radial).powi(2) + (v / across).powi(2))).exp()
                })
                .collect();
            let sum: f64 = values.iter().sum();
            data.extend(values.iter().map(|v| (v / sum) as f32));
        }
    }
    Kernels { size, data }
}

fn image(side: usize) -> Plane<f32> {
    let mut state = 0x9E37_79B9_7F4A_7C15u64;
    Plane::from_fn(side, side, |x, y| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        let base = if (x / 37 + y / 53) % 2 == 0 { 200.0 } else { 20.0 };
        base + (state >> 40) as f32 / (1u32 << 24) as f32 * 50.0
    })
}

/// A checkerboard that costs next to nothing to render: the engine's own time is what is measured.
struct Checks;

impl Scene for Checks {
    fn bands(&self) -> Bands {
        Bands::VISIBLE
    }
    fn quantity(&self) -> Quantity {
        Quantity::Radiance
    }
    fn aspect(&self) -> Option<f64> {
        None
    }
    fn plane(&self, _band: usize, grid: &Grid) -> Result<Plane<f32>> {
        let mut plane = Plane::filled(grid.width, grid.height, 0.1f32);
        for y in 0..grid.height {
            for (x, v) in plane.row_mut(y).iter_mut().enumerate() {
                *v = if (x / 64 + y / 64) % 2 == 0 { 1.0 } else { 0.1 };
            }
        }
        Ok(plane)
    }
}

fn diffraction(small: bool) {
    let lens = Diffraction {
        f_number: 2.8,
        focal_length_mm: 3.6,
        magnification: 0.0,
        transmittance: Spectrum::constant(0.9),
        illumination: Illumination::Cos4,
        defocus_um: 0.0,
    };
    let (width, height) = if small { (512, 384) } else { (2048, 1536) };
    let grid = SensorGrid { width, height, pitch_um: 2.2, fill_factor: 0.8 };
    let scene = LitScene { scene: &Checks, white: vec![1.0; 31] };
    let start = Instant::now();
    let report = irradiance(
        &scene,
        &lens,
        &grid,
        &Options::default(),
        |_, _| {},
        |_, plane| {
            black_box(plane);
            Ok(())
        },
    );
    println!(
        "diffraction {width}x{height} x 31 bands: {:.2} s, {report:?}",
        start.elapsed().as_secs_f64()
    );
}

/// Inputs, answer and time of one 1024 x 1024 band for `benches/peers/optics_scipy.py`.
fn dump(folder: &std::path::Path) -> std::io::Result<()> {
    let side = 1024;
    let tiling = Tiling::new(1, (side, side), 31, 15, 256);
    let (source, kernels) = (image(side), kernels(&tiling, 0));
    let mut blurrer = Blurrer::new(&tiling);
    let mut answer = Plane::filled(0, 0, 0.0);
    let seconds = minimum(5, || {
        answer = blurrer
            .blur(
                &|first, count| Ok(rows_of(&source, first, count)),
                &kernels,
                (0, 0),
                (side, side),
            )
            .unwrap();
    });
    std::fs::create_dir_all(folder)?;
    let bytes = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    std::fs::write(folder.join("image.f32"), bytes(&source.data))?;
    std::fs::write(folder.join("kernels.f32"), bytes(&kernels.data))?;
    std::fs::write(folder.join("ours.f32"), bytes(&answer.data))?;
    let job = format!(
        "{{\"side\": {side}, \"tile\": {}, \"kernel\": 31, \"before\": 15, \"seconds\": {seconds}}}",
        tiling.tile
    );
    std::fs::write(folder.join("job.json"), job)
}

fn rows_of(source: &Plane<f32>, first: usize, count: usize) -> Plane<f32> {
    let w = source.width;
    Plane { width: w, height: count, data: source.data[first * w..(first + count) * w].to_vec() }
}

fn minimum(times: usize, mut run: impl FnMut()) -> f64 {
    (0..times)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64()
        })
        .fold(f64::MAX, f64::min)
}

fn main() {
    let small = std::env::var_os("CAMRIG_BENCH_SMALL").is_some();
    let filter = std::env::args().skip(1).find(|a| !a.starts_with("--")).unwrap_or_default();
    if "diffraction".contains(&filter) {
        diffraction(small);
    }
    let side = if small { 1024 } else { 4096 };
    let source = image(side);
    let rows = |first: usize, count: usize| Ok(rows_of(&source, first, count));
    if let Some(folder) = std::env::var_os("CAMRIG_BENCH_DUMP") {
        dump(folder.as_ref()).expect("the folder can be written");
    }
    for size in [31, 81] {
        for largest in [341, 256, 128] {
            let name = format!("blur {size}x{size} tiles up to {largest}");
            if !name.contains(&filter) {
                continue;
            }
            let tiling = Tiling::new(1, (side, side), size, size / 2, largest);
            let kernels = kernels(&tiling, 0);
            let mut blurrer = Blurrer::new(&tiling);
            let seconds = minimum(3, || {
                black_box(blurrer.blur(&rows, &kernels, (0, 0), (side, side)).unwrap());
            });
            let cells = (side * side) as f64;
            println!(
                "{name}: tile {}, {} x {} nodes, {seconds:.3} s a band, {:.0} Mcell/s, 31 bands {:.2} s",
                tiling.tile,
                tiling.across() + 1,
                tiling.down() + 1,
                cells / seconds * 1e-6,
                31.0 * seconds * (4096.0 * 4096.0) / cells,
            );
        }
    }
}
