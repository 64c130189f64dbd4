//! The optics stage: workload W (4096 x 4096 cells x 31 bands, 31 x 31 kernels that vary over the
//! field), its scaling, live pictures by the fast path, the whole stage from scene to irradiance,
//! and the characterisation of a phone lens.
//!
//! `cargo bench -p camrig-benches --bench optics [-- FILTER]`; `CAMRIG_BENCH_SMALL=1` runs one
//! sixteenth of the area. Every figure has the processor time of all threads beside it, which is
//! the one to compare on a busy machine. `benches/peers/optics` runs other programs on the same
//! data in one run.

use camrig::lens::characterise::{Plan, PsfMethod, characterise};
use camrig::lens::{Catalogue, Conditions, System};
use camrig::optics::engine::collapsed::{Collapsed, Mixture};
use camrig::optics::engine::varying::{Blurrer, Kernels, Pairs, Rows, Tiling};
use camrig::optics::{
    Blur, Characterisation, Departed, Departures, Diffraction, Distortion, Illumination, Lens,
    Options, OverField, PsfGrid, SensorGrid, irradiance,
};
use camrig::prescription::toml;
use camrig::scene::{Bands, Grid, LitScene, Quantity, Scene, Spectrum};
use camrig::{Plane, Result};
use camrig_benches::sensor;
use rayon::prelude::*;
use std::hint::black_box;
use std::time::Instant;

/// Bands of W.
const BANDS: usize = 31;

fn main() {
    let filter = std::env::args().skip(1).find(|a| !a.starts_with("--")).unwrap_or_default();
    let wanted = |name: &str| name.contains(&filter);
    let side = if std::env::var_os("CAMRIG_BENCH_SMALL").is_some() { 1024 } else { 4096 };
    if let Some(folder) = std::env::var_os("CAMRIG_BENCH_DUMP") {
        return dump(folder.as_ref()).expect("the folder can be written");
    }
    println!("{} threads", rayon::current_num_threads());
    if wanted("exact") {
        exact(side);
    }
    if wanted("collapsed") {
        collapsed(side);
    }
    if wanted("live") {
        live();
    }
    if wanted("scaling") {
        scaling(side);
    }
    if wanted("stages") {
        stages(side);
    }
    if wanted("diffraction") {
        diffraction(side);
    }
    if wanted("characterise") {
        characterisation();
    }
}

/// Wall and processor time of a run, seconds.
#[derive(Clone, Copy)]
struct Time {
    wall: f64,
    processor: f64,
}

impl Time {
    fn milliseconds(self) -> String {
        format!("{:.1} ms ({:.0} ms processor)", 1e3 * self.wall, 1e3 * self.processor)
    }
}

impl std::fmt::Display for Time {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.2} s wall, {:.2} s processor", self.wall, self.processor)
    }
}

fn time(run: impl FnOnce()) -> Time {
    let (start, before) = (Instant::now(), processor_seconds());
    run();
    Time { wall: start.elapsed().as_secs_f64(), processor: processor_seconds() - before }
}

/// The shortest of several runs.
fn least(times: usize, mut run: impl FnMut()) -> Time {
    let all: Vec<Time> = (0..times).map(|_| time(&mut run)).collect();
    let of = |pick: fn(&Time) -> f64| all.iter().map(pick).fold(f64::MAX, f64::min);
    Time { wall: of(|t| t.wall), processor: of(|t| t.processor) }
}

/// User and system time of this process, seconds, in steps of 10 ms; NaN where there is no
/// `/proc`.
fn processor_seconds() -> f64 {
    let ticks = || -> Option<f64> {
        let text = std::fs::read_to_string("/proc/self/stat").ok()?;
        // Fields 14 and 15; the name, field 2, ends with the last parenthesis.
        let mut fields = text.rsplit(") ").next()?.split(' ').skip(11);
        Some(fields.next()?.parse::<f64>().ok()? + fields.next()?.parse::<f64>().ok()?)
    };
    ticks().map_or(f64::NAN, |t| t / 100.0)
}

/// Peak memory of this process, MiB; NaN where there is no `/proc`.
fn peak_mib() -> f64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    let kib = line.and_then(|l| l.split_whitespace().next()?.parse::<f64>().ok());
    kib.unwrap_or(f64::NAN) / 1024.0
}

/// Gaussian kernels that grow and stretch along the radius towards the corners.
fn kernels(tiling: &Tiling, wavelength: usize) -> Kernels {
    let size = tiling.kernel;
    let half = (size / 2) as f64;
    let (w, h) = (tiling.width as f64, tiling.height as f64);
    let across = tiling.across() + 1;
    let data: Vec<Vec<f32>> = (0..across * (tiling.down() + 1))
        .into_par_iter()
        .map(|node| {
            let (x, y) = tiling.node(node % across, node / across);
            let (x, y) = (2.0 * x / w - 1.0, 2.0 * y / h - 1.0);
            let r = x.hypot(y);
            let (sin, cos) = y.atan2(x).sin_cos();
            let radial = 1.0 + 2.5 * r * r + wavelength as f64 * 0.02;
            let across = 0.9 + 0.7 * r;
            let values: Vec<f64> = (0..size * size)
                .map(|k| {
                    let (dy, dx) = ((k / size) as f64 - half, (k % size) as f64 - half);
                    let (u, v) = (dx * cos + dy * sin - 0.7 * r, dy * cos - dx * sin);
                    (-0.5 * ((u / radial).powi(2) + (v / across).powi(2))).exp()
                })
                .collect();
            let sum: f64 = values.iter().sum();
            values.iter().map(|v| (v / sum) as f32).collect()
        })
        .collect();
    Kernels { size, data: data.concat() }
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

fn rows_of(source: &Plane<f32>, first: usize, count: usize) -> Plane<f32> {
    let w = source.width;
    Plane { width: w, height: count, data: source.data[first * w..(first + count) * w].to_vec() }
}

/// Response of a channel in a band: three bell curves.
fn response(channel: usize, band: usize) -> f32 {
    let x = (band as f32 - [22.0, 14.0, 6.0][channel]) / 5.0;
    (-x * x).exp()
}

/// W: every band through its own kernels and into three channels.
fn exact(side: usize) {
    let source = image(side);
    let tiling = Tiling::new(1, (side, side), 31, 15, 341);
    let mut blurrer = Blurrer::new(&tiling);
    let by_band: Vec<Kernels> = (0..BANDS).map(|b| kernels(&tiling, b)).collect();
    let mut channels = vec![Plane::filled(side, side, 0.0f32); 3];
    let rows = |first: usize, count: usize| Ok(rows_of(&source, first, count));
    let spent = time(|| {
        for (band, kernels) in by_band.iter().enumerate() {
            let responses = [0, 1, 2].map(|channel| [response(channel, band)]);
            let weights = responses.each_ref().map(|r| r.as_slice());
            blurrer
                .add(&[&rows], Pairs::Kernels(&[&[kernels]]), (0, 0), &weights, &mut channels)
                .unwrap();
        }
    });
    black_box(channels);
    println!(
        "exact: {side} x {side} x {BANDS} bands to 3 channels, 31 x 31 kernels at {} x {} nodes: \
         {spent}, {:.0} Mcell/s, peak memory {:.0} MiB",
        tiling.across() + 1,
        tiling.down() + 1,
        (side * side * BANDS) as f64 / spent.wall * 1e-6,
        peak_mib()
    );
}

/// W for a scene of six spectral components.
fn collapsed(side: usize) {
    const COMPONENTS: usize = 6;
    let source = image(side);
    let tiling = Tiling::new(1, (side, side), 31, 15, 341);
    let mixture = |k: usize, b: usize| (0.1 * (b * k) as f32).cos() / (1.0 + k as f32);
    let by_band: Vec<Kernels> = (0..BANDS).map(|b| kernels(&tiling, b)).collect();
    let collapse = |channel: usize, k: usize| {
        let parts: Vec<(f32, &Kernels)> =
            (0..BANDS).map(|b| (response(channel, b) * mixture(k, b), &by_band[b])).collect();
        Kernels::combined(&parts)
    };
    let mut all: Vec<Kernels> = Vec::new();
    let preparing = time(|| {
        all = (0..3 * COMPONENTS)
            .into_par_iter()
            .map(|i| collapse(i / COMPONENTS, i % COMPONENTS))
            .collect();
    });
    let all: Vec<&Kernels> = all.iter().collect();
    let all: Vec<&[&Kernels]> = all.chunks(COMPONENTS).collect();
    // Components are the image from different rows on, because a scene is rendered strip by strip.
    let rows: Vec<_> = (0..COMPONENTS)
        .map(|k| {
            let source = &source;
            move |first: usize, count: usize| {
                let first = (first + 29 * k).min(source.height - count);
                Ok(rows_of(source, first, count))
            }
        })
        .collect();
    let rows: Vec<&Rows<'_>> = rows.iter().map(|r| r as &Rows<'_>).collect();
    let mut blurrer = Blurrer::new(&tiling);
    let weights: [&[f32]; 3] = [&[1.0, 0.0, 0.0], &[0.0, 1.0, 0.0], &[0.0, 0.0, 1.0]];
    let mut channels = vec![Plane::filled(side, side, 0.0f32); 3];
    let spent = time(|| {
        blurrer.add(&rows, Pairs::Kernels(&all), (0, 0), &weights, &mut channels).unwrap();
    });
    black_box(channels);
    println!(
        "collapsed: {COMPONENTS} components to 3 channels, 31 x 31 kernels at {} x {} nodes: \
         {spent} (kernels {preparing}), peak memory {:.0} MiB",
        tiling.across() + 1,
        tiling.down() + 1,
        peak_mib()
    );
}

/// Pictures of few components in memory to raw frames, by the stage that takes the time: the
/// blur, the sensor chain, and the memory that both must touch at least. Without lateral colour.
fn live() {
    for (width, height) in [(640, 480), (1920, 1080)] {
        let lens = lens(width);
        let grid = SensorGrid { width, height, pitch_um: 1.4, fill_factor: 0.9 };
        let options = Options { oversample: Some(1), ..Options::default() };
        let sensor = sensor::config(width as u32, height as u32, &sensor::chain());
        for components in [3, 12] {
            let mixed = |c: usize, k: usize, b: usize| {
                f64::from(response(c, b)) * (0.1 * (b * k) as f64).cos() / (1.0 + k as f64)
            };
            let of = |c, k| (0..BANDS).map(|b| mixed(c, k, b)).collect();
            let weights = (0..3).map(|c| (0..components).map(|k| of(c, k)).collect()).collect();
            let mixture = Mixture { bands: Bands::VISIBLE, weights };
            let (start, mut collapsed) =
                (Instant::now(), Collapsed::new(&lens, &grid, &options, &mixture).unwrap());
            let prepared = start.elapsed().as_secs_f64();
            let scene = Checks { bands: components };
            let scene = LitScene { scene: &scene, white: vec![1.0; components] };
            let mut channels = Vec::new();
            let blur = least(5, || channels = collapsed.channels(&scene).unwrap());
            let mut means = vec![0.0f32; width * height];
            let mosaic = least(5, || {
                for (i, mean) in means.iter_mut().enumerate() {
                    let (x, y) = (i % width, i / width);
                    *mean = 1e3 * channels[x % 2 + y % 2].data[i];
                }
            });
            let mut dn = vec![0u16; width * height];
            let threads = rayon::current_num_threads();
            let chain = least(5, || sensor::frame(&sensor, &means, &mut dn, threads));
            let pictures = vec![1.0f32; components * width * height];
            let floor = least(5, || {
                black_box(pictures.clone());
                black_box(channels.clone());
                black_box(dn.clone());
            });
            let wall = blur.wall + mosaic.wall + chain.wall;
            let nodes = collapsed.report().nodes.expect("the blur varies");
            println!(
                "live: {width} x {height}, {components} components, 1 cell a pixel, {0} x {0} \
                 kernels at {1} x {2} nodes (misplaced {3:.1e} in the mean): {4:.1} frames/s; blur \
                 {5}; mosaic {6}; sensor {7}; memory {8}; lens once {prepared:.1} s",
                nodes.kernel,
                nodes.grid.0,
                nodes.grid.1,
                nodes.nodes.mean,
                1.0 / wall,
                blur.milliseconds(),
                mosaic.milliseconds(),
                chain.milliseconds(),
                floor.milliseconds()
            );
        }
    }
}

/// One band with other sizes, kernels and tiles.
fn scaling(side: usize) {
    let mut rates = Vec::new();
    for (side, size, largest) in [
        (side / 4, 31, 341),
        (side / 2, 31, 341),
        (side, 31, 341),
        (side, 31, 256),
        (side, 31, 128),
        (side, 81, 341),
    ] {
        let source = image(side);
        let rows = |first: usize, count: usize| Ok(rows_of(&source, first, count));
        let tiling = Tiling::new(1, (side, side), size, size / 2, largest);
        let kernels = kernels(&tiling, 0);
        let mut blurrer = Blurrer::new(&tiling);
        let spent = least(3, || {
            black_box(blurrer.blur(&rows, &kernels, (0, 0), (side, side)).unwrap());
        });
        let rate = (side * side) as f64 / spent.processor * 1e-6;
        rates.push(rate);
        println!(
            "scaling: {side} x {side}, {size} x {size} kernels, tiles of {}: {spent}, \
            {rate:.0} Mcell per processor second",
            tiling.tile
        );
    }
    println!(
        "scaling: a cell at 1/16 and 1/4 of the area costs {:.2} and {:.2} of one at full area; \
        81 x 81 costs {:.2} of 31 x 31",
        rates[2] / rates[0],
        rates[2] / rates[1],
        rates[2] / rates[5]
    );
}

/// A checkerboard that takes hardly any time to render, so that the engine's own time is measured.
struct Checks {
    bands: usize,
}

impl Scene for Checks {
    fn bands(&self) -> Bands {
        Bands { count: self.bands, ..Bands::VISIBLE }
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

/// A made-up lens whose kernels have 31 cells on pixels of 1.4 µm, without distortion.
fn lens(side: usize) -> Characterisation {
    const SIZE: usize = 65;
    let top = 0.8 * side as f64 * 1.4e-3;
    let heights_mm: Vec<f64> = (0..21).map(|i| top * f64::from(i) / 20.0).collect();
    let data = heights_mm.iter().flat_map(|&h| {
        let (radial, across) = (3.0 + 2.0 * (h / top).powi(2), 2.5 + 0.5 * h / top);
        (0..SIZE * SIZE).map(move |k| {
            let (y, x) = ((k / SIZE) as f64 - 32.0, (k % SIZE) as f64 - 32.0);
            (-0.5 * ((y / radial).powi(2) + (x / across).powi(2))).exp() as f32 + 1e-6
        })
    });
    let mut psf = PsfGrid {
        heights_mm: heights_mm.clone(),
        wavelengths_nm: vec![550.0],
        size: SIZE,
        spacing_um: 0.55,
        data: data.collect(),
        captured: None,
        between: None,
    };
    psf.normalise().expect("PSFs have light");
    Characterisation {
        name: "bench".into(),
        source: "made up".into(),
        efl_mm: 4.0,
        f_number: 2.0,
        magnification: 0.0,
        pupil_magnification: 1.0,
        axis_solid_angle_sr: None,
        stop_radius_mm: None,
        transmittance: Spectrum::constant(0.9),
        wavelengths_nm: vec![550.0],
        real_height_mm: heights_mm.clone(),
        relative_illumination: heights_mm
            .iter()
            .map(|h| 1.0 / (1.0 + h * h / 16.0).powi(2))
            .collect(),
        chief_ray_angle_deg: None,
        heights_mm,
        psf,
    }
}

fn render(lens: &dyn Lens, grid: &SensorGrid, bands: usize, options: &Options) -> Time {
    let scene = Checks { bands };
    let scene = LitScene { scene: &scene, white: vec![1.0; bands] };
    let mut report = None;
    let spent = time(|| {
        let sink = |_: usize, plane: Plane<f32>| {
            black_box(plane);
            Ok(())
        };
        report = Some(irradiance(&scene, lens, grid, options, |_, _| {}, sink));
    });
    report.expect("it ran").expect("the scene renders");
    spent
}

/// The same lens without its geometric mapping.
struct Unmapped(Characterisation);

impl Lens for Unmapped {
    fn steradians(&self, nm: f64) -> f64 {
        self.0.steradians(nm)
    }
    fn illumination(&self, nm: f64) -> Option<OverField<'_, f64>> {
        Lens::illumination(&self.0, nm)
    }
    fn ideal_place(&self, _nm: f64) -> Option<OverField<'_, (f64, f64)>> {
        None
    }
    fn principal_distance_mm(&self) -> f64 {
        self.0.principal_distance_mm()
    }
    fn blur(&self, nm: f64) -> Blur<'_> {
        self.0.blur(nm)
    }
}

/// From scene to irradiance: the time that each stage adds, and whether all bands take the same.
fn stages(side: usize) {
    let grid = SensorGrid { width: side, height: side, pitch_um: 1.4, fill_factor: 0.9 };
    let options = Options { oversample: Some(1), ..Options::default() };
    let plain = Unmapped(lens(side));
    let distorting = |lateral: f64| Departed {
        lens: Box::new(lens(side)),
        departures: Departures {
            distortion: Distortion {
                k1: -0.08,
                unit_mm: grid.corner_mm(),
                ..Distortion::default()
            },
            lateral_colour: Spectrum::constant(lateral),
            ..Departures::default()
        },
    };
    let (bands, few) = (8, 2);
    let base = render(&plain, &grid, bands, &options);
    let warped = render(&distorting(1.001), &grid, bands, &options);
    println!("stages: scene, blur, illumination, {bands} bands: {base}");
    println!("stages: with distortion and lateral colour: {warped}");
    println!(
        "stages: the warp adds {:.2} of the rest (processor time)",
        (warped.processor - base.processor) / base.processor
    );
    let less = render(&distorting(1.001), &grid, few, &options);
    println!(
        "stages: {few} bands {less}: a band of {bands} costs {:.2} of one of {few}",
        warped.processor / less.processor * few as f64 / bands as f64
    );
    println!(
        "stages: all {BANDS} bands would be {:.1} s of processor time",
        warped.processor * BANDS as f64 / bands as f64
    );
}

fn diffraction(side: usize) {
    let lens = Diffraction {
        f_number: 2.8,
        focal_length_mm: 3.6,
        magnification: 0.0,
        transmittance: Spectrum::constant(0.9),
        illumination: Illumination::Cos4,
        defocus_um: 0.0,
    };
    let (width, height) = (side / 2, side * 3 / 8);
    let grid = SensorGrid { width, height, pitch_um: 2.2, fill_factor: 0.8 };
    let spent = render(&lens, &grid, BANDS, &Options::default());
    println!("diffraction: {width} x {height} x {BANDS} bands: {spent}");
}

/// 21 fields x 31 wavelengths of a phone lens, PSFs of 128 x 128.
fn characterisation() {
    let text = include_str!("../../host/lenses/phone-80deg.toml");
    let prescription = toml::read(text, &Catalogue::default()).expect("a lens of the repository");
    let system = System::new(prescription, Conditions::default()).expect("it images");
    let fields = system.fields_deg().expect("it has fields");
    let plan = Plan {
        heights: 21,
        density: None,
        max_field_deg: fields.into_iter().fold(0.0, f64::max),
        wavelengths_nm: (0..BANDS).map(|i| 400.0 + 10.0 * i as f64).collect(),
        psf_size: 128,
        psf_spacing_um: None,
        method: PsfMethod::Auto,
    };
    let spent = least(2, || {
        black_box(characterise(&system, &plan, &|_, _| ()).expect("it is traced"));
    });
    println!("characterise: 21 fields x {BANDS} wavelengths, 128 x 128: {spent}");
}

/// Inputs, result and time of one band of 1024 x 1024 for `benches/peers/optics_peers.py`.
fn dump(folder: &std::path::Path) -> std::io::Result<()> {
    let side = 1024;
    let tiling = Tiling::new(1, (side, side), 31, 15, 256);
    let (source, kernels) = (image(side), kernels(&tiling, 0));
    let mut blurrer = Blurrer::new(&tiling);
    let mut answer = Plane::filled(0, 0, 0.0);
    let mut blur = || {
        let rows = |first: usize, count: usize| Ok(rows_of(&source, first, count));
        answer = blurrer.blur(&rows, &kernels, (0, 0), (side, side)).unwrap();
    };
    // Processor time comes in steps of 10 ms.
    const RUNS: usize = 40;
    let processor = time(|| (0..RUNS).for_each(|_| blur())).processor / RUNS as f64;
    let wall = least(RUNS, blur).wall;
    std::fs::create_dir_all(folder)?;
    let bytes = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    std::fs::write(folder.join("image.f32"), bytes(&source.data))?;
    std::fs::write(folder.join("kernels.f32"), bytes(&kernels.data))?;
    std::fs::write(folder.join("ours.f32"), bytes(&answer.data))?;
    let job = format!(
        "{{\"side\": {side}, \"tile\": {}, \"kernel\": 31, \"before\": 15, \"seconds\": {wall}, \
         \"processor\": {processor}}}",
        tiling.tile
    );
    std::fs::write(folder.join("job.json"), job)
}
