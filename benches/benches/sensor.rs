//! Throughput of the sensor stage against its peers, and the counts of the Poisson method against
//! the exact law.
//!
//! `cargo bench -p camrig-benches --bench sensor`. Ratios are between figures of one run on one
//! machine. The Python peers (numpy, GalSim) run if `python3` has them.

use camrig::Plane;
use camrig::camera::Camera;
use camrig::exposure::hdr::HdrSensor;
use camrig::exposure::{Arithmetic, CubeHeader, IrradianceWriter, SimulatedSensor};
use camrig_benches::sensor::{
    SETTINGS, chain, collected_rows, config, cube, frame, means, rows, spectral_config,
};
use camrig_sensor_core::effects::shot_noise::ShotNoise;
use criterion::{BenchmarkId, Criterion, Throughput};
use std::hint::black_box;
use std::process::Command;
use std::time::{Duration, Instant};

const WIDTH: usize = 2048;
const HEIGHT: usize = 1536;

fn main() {
    let mut criterion = Criterion::default()
        .configure_from_args()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(2));
    stages(&mut criterion);
    frame_sizes(&mut criterion);
    criterion.final_summary();
    ratios();
    several_captures();
    poisson();
}

/// The whole chain, and each of its stages alone, on one core.
fn stages(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("sensor stage");
    group.throughput(Throughput::Elements((WIDTH * 64) as u64));
    let means = means(WIDTH, 64);
    let mut dn = vec![0; WIDTH * 64];
    let mut time = |name: &str, effects: &[_]| {
        let config = config(WIDTH as u32, 64, effects);
        group.bench_function(name, |b| b.iter(|| rows(&config, 0, black_box(&means), &mut dn)));
    };
    time("all", &chain());
    for effect in chain() {
        time(effect.entry().kind, &[effect]);
    }
    group.finish();
}

/// Time against frame size, which should be linear.
fn frame_sizes(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("frame size");
    for megapixels in [1usize, 4, 16] {
        let height = megapixels * 512;
        let means = means(WIDTH, height);
        let mut dn = vec![0; WIDTH * height];
        let config = config(WIDTH as u32, height as u32, &chain());
        group.throughput(Throughput::Elements((WIDTH * height) as u64));
        group.bench_function(BenchmarkId::from_parameter(format!("{megapixels} Mpixel")), |b| {
            b.iter(|| frame(&config, black_box(&means), &mut dn, 1));
        });
    }
    group.finish();
}

/// Shortest of many runs, in millions of pixels per second.
fn megapixels_per_s(pixels: usize, mut run: impl FnMut()) -> f64 {
    let mut best = f64::MAX;
    for _ in 0..25 {
        let start = Instant::now();
        run();
        best = best.min(start.elapsed().as_secs_f64());
    }
    pixels as f64 / best / 1e6
}

/// Ratios to the time of the memory traffic alone, to several threads and to the peers.
fn ratios() {
    let pixels = WIDTH * HEIGHT;
    let means = means(WIDTH, HEIGHT);
    let mut dn = vec![0u16; pixels];
    let sensor = config(WIDTH as u32, HEIGHT as u32, &chain());
    let one = megapixels_per_s(pixels, || frame(&sensor, &means, &mut dn, 1));
    let two = megapixels_per_s(pixels, || frame(&sensor, &means, &mut dn, 2));
    let floor = megapixels_per_s(pixels, || {
        for (dn, mean) in dn.iter_mut().zip(black_box(&means)) {
            *dn = *mean as u16;
        }
    });
    println!("\nsensor stage, f32, {WIDTH} x {HEIGHT}:");
    println!("  1 thread          {one:8.1} Mpixel/s");
    println!("  2 threads         {two:8.1} Mpixel/s, {:.2} x one", two / one);
    println!(
        "  memory floor      {floor:8.1} Mpixel/s (read f32, write u16), {:.1} x one thread",
        floor / one
    );
    for (name, script) in [("numpy", "numpy_noise.py"), ("GalSim", "galsim_noise.py")] {
        let path = format!("{}/peers/{script}", env!("CARGO_MANIFEST_DIR"));
        let (width, height) = (WIDTH.to_string(), HEIGHT.to_string());
        let run = Command::new("python3").args([&path, &width, &height]).output();
        let text = run
            .ok()
            .filter(|o| o.status.success())
            .map(|o| String::from_utf8_lossy(&o.stdout).into_owned());
        match text.and_then(|t| t.trim().parse::<f64>().ok()) {
            Some(peer) => println!(
                "  {name:<17} {peer:8.1} Mpixel/s: one thread is {:.1} x, two are {:.1} x as fast",
                one / peer,
                two / peer
            ),
            None => println!(
                "  {name}: SKIP, python3 has no {name} (pip install {})",
                name.to_lowercase()
            ),
        }
    }

    let (width, height) = (WIDTH, 128);
    let sensor = spectral_config(width as u32, height as u32, &chain());
    let cube = cube(width, height);
    let mut dn = vec![0; width * height];
    let whole =
        megapixels_per_s(width * height, || collected_rows(&sensor, black_box(&cube), &mut dn));
    let bands =
        (0..usize::from(sensor.bands)).map(|b| cube.chunk(b, 0, height).expect("in memory"));
    let bands: Vec<_> = bands.collect();
    let read = megapixels_per_s(width * height, || {
        let rows = bands.iter().flat_map(|band| (0..height).map(|y| band.row(width, y)));
        let samples = rows.flat_map(|row| row.mantissas);
        black_box(samples.fold(0u64, |sum, &m| sum.wrapping_add(u64::from(m))));
    });
    println!("collector with crosstalk factors and chain, {} bands:", sensor.bands);
    println!("  1 thread          {whole:8.1} Mpixel/s");
    println!("  reading the cube  {read:8.1} Mpixel/s, {:.1} x", read / whole);
}

/// Four captures of two photodiodes, merged and companded, against one capture of 12 bits, both
/// from the same light on all cores.
fn several_captures() {
    let camera =
        Camera::load("ox03c10").and_then(|c| c.with_size(1920, 1080)).expect("a built-in camera");
    let plain = camera.of_capture(0).expect("its first capture");
    let (width, height) = (1920, 1080);
    let header = CubeHeader { first_band_nm: 550.0, bands: 1, ..cube(width, 1).header };
    let header = CubeHeader { height, ..header };
    let light = Plane::from_fn(width, height, |x, _| 3.0 * x as f32 / width as f32);
    let mut writer = IrradianceWriter::new(header).expect("valid header");
    writer.push(&light).expect("a plane of the header's size");
    let cube = writer.finish().expect("one band");
    let pixels = width * height;
    let sensor = SimulatedSensor::new(&plain, &cube.header).expect("valid camera");
    let one = megapixels_per_s(pixels, || {
        black_box(sensor.frame(&cube, &SETTINGS).expect("a frame"));
    });
    let sensor = HdrSensor::in_light(&camera, &cube.header, 1.0).expect("valid camera");
    let four = megapixels_per_s(pixels, || {
        let frame = sensor.frame(&[&cube], None, &SETTINGS, Arithmetic::F32);
        black_box(frame.expect("a frame"));
    });
    println!("{width} x {height}, from one band of light, all threads:");
    println!("  one capture       {one:8.1} Mpixel/s");
    println!("  four, companded   {four:8.1} Mpixel/s, {:.2} x the time", one / four);
}

/// Chi-square of 1e8 counts for each mean against the exact law.
fn poisson() {
    println!("Poisson counts, 1e8 for each mean, f32:");
    let (width, height) = (10_000, 10_000);
    let mut sensor = config(width as u32, 500, &[ShotNoise {}.into()]);
    sensor.full_well_e = 65_535.0;
    sensor.bits = 16;
    sensor.black_level_dn = 0.0;
    for lambda in [0.1f64, 1.0, 5.0, 15.9, 16.0, 20.0, 30.0, 100.0, 1000.0] {
        let means = vec![lambda as f32; width * 500];
        let lambda = f64::from(lambda as f32);
        let mut seen = vec![0.0; (lambda + 9.0 * lambda.sqrt() + 20.0) as usize];
        let top = seen.len() - 1;
        let mut dn = vec![0; width * 500];
        for part in 0..height / 500 {
            // Another sensor seed, and so other random streams, for each part.
            sensor.seed = part as u64;
            rows(&sensor, 0, &means, &mut dn);
            dn.iter().for_each(|&d| seen[usize::from(d).min(top)] += 1.0);
        }
        let n = (width * height) as f64;
        let (mut chi2, mut cells, mut distance, mut log_p) = (0.0, 0.0f64, 0.0, -lambda);
        for (k, seen) in seen.iter().enumerate() {
            let expected = n * log_p.exp();
            log_p += (lambda / (k as f64 + 1.0)).ln();
            if expected >= 20.0 {
                chi2 += (seen - expected).powi(2) / expected;
                cells += 1.0;
                distance += (seen - expected).abs() / n / 2.0;
            }
        }
        println!(
            "  mean {lambda:8.2}: chi-square {:6.2} per cell of {cells:4.0}, total variation \
            {distance:.1e} (by chance {:.1e})",
            chi2 / cells,
            (cells / n / 2.0 / core::f64::consts::PI).sqrt()
        );
    }
    println!("settings: exposure {} s, gain {}", SETTINGS.exposure_s, SETTINGS.analog_gain);
}
