//! Merging exposures into one frame, and channels into spectra, at 16 Mpixel, against copying the
//! same bytes in the same run.
//!
//! `cargo bench -p camrig-benches --bench scene`. Each input byte counts as read once and each
//! output byte as written once. The copy is between buffers that have been used before; a merged
//! frame is written to new pages, which the system clears first, and that time is printed beside
//! it. Spectra are written band by band to one plane.

use camrig::Plane;
use camrig::calibrate::exposures::{Exposure, Series};
use camrig::calibrate::hdr;
use camrig::calibrate::spectral::{Channels, Estimator};
use camrig::camera::{Camera, Cfa};
use camrig::light::Illuminant;
use camrig::scene::Bands;
use camrig::scene::chart::colorchecker;
use rayon::prelude::*;
use std::hint::black_box;
use std::time::Instant;

const SIDE: usize = 4096;
const FULL_SCALE_DN: f64 = 4095.0;

fn main() {
    merging();
    spectra();
}

/// Shortest of a few runs, s.
fn seconds(mut run: impl FnMut()) -> f64 {
    let mut best = f64::MAX;
    for _ in 0..4 {
        let start = Instant::now();
        run();
        best = best.min(start.elapsed().as_secs_f64());
    }
    best
}

/// Time to get so many bytes of new pages, on all threads, s.
fn new_pages(bytes: usize) -> f64 {
    seconds(|| {
        let mut pages = vec![0u8; bytes];
        pages
            .par_chunks_mut(1 << 20)
            .for_each(|piece| piece.iter_mut().step_by(4096).for_each(|b| *b = 1));
        black_box(&pages);
    })
}

/// Time to copy so many bytes on all threads, half of them read and half written, s.
fn copying(bytes: usize) -> f64 {
    let from = vec![1u8; 256 << 20];
    let mut to = vec![0u8; 256 << 20];
    let each = seconds(|| {
        let pieces = to.par_chunks_mut(1 << 20).zip(from.par_chunks(1 << 20));
        pieces.for_each(|(to, from)| to.copy_from_slice(from));
        black_box(&to);
    });
    each * bytes as f64 / (512 << 20) as f64
}

fn told(what: &str, seconds: f64, bytes: usize) {
    let copy = copying(bytes);
    println!(
        "{what}: {seconds:.2} s, copying the same {:.1} GB {copy:.2} s: {:.1} x",
        bytes as f64 / 1e9,
        seconds / copy
    );
}

/// Four exposures of a scene of 80 dB with shot and read noise.
fn merging() {
    const TIMES: [f64; 4] = [0.001, 0.008, 0.064, 0.512];
    let noise = |i: usize, j: usize| {
        let z = ((i * 4 + j) as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        ((z ^ (z >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f64 / (1u64 << 24) as f64
            - 0.5
    };
    let exposures = TIMES.iter().enumerate().map(|(j, &seconds)| {
        let mut signal = Plane::filled(SIDE, SIDE, 0.0f32);
        signal.data.par_iter_mut().enumerate().for_each(|(i, v)| {
            let light = 300.0 * 1e4f64.powf((i % SIDE) as f64 / SIDE as f64);
            let mean = light * seconds;
            let deviation = (4.0 + 0.4 * mean).sqrt();
            *v = (mean + 12f64.sqrt() * deviation * noise(i, j)).min(FULL_SCALE_DN) as f32;
        });
        Exposure { id: format!("e{j}"), seconds, frames: 1, signal }
    });
    let series = Series { name: "bench".into(), exposures: exposures.collect() };
    let cfa = Cfa::parse("RGGB").expect("a pattern");
    let time = seconds(|| {
        black_box(hdr::merge(&series, &cfa, FULL_SCALE_DN, &[]).expect("a merged frame"));
    });
    // Input: signals. Output: radiance, its standard deviation and a flag.
    let result = 4 + 4 + 1;
    told("merging 4 exposures of 16 Mpixel", time, SIDE * SIDE * (4 * TIMES.len() + result));
    println!("  of which new pages for the result {:.2} s", new_pages(SIDE * SIDE * result));
}

/// Three channels to 31 bands.
fn spectra() {
    let bands = Bands { start_nm: 400.0, step_nm: 10.0, count: 31 };
    let camera = Camera::load("mt9v024").expect("a preset");
    let light = Illuminant::parse("D65").expect("an illuminant").in_bands(&bands);
    let channels = Channels::new(&camera.sensor.response(&bands), &light).expect("channels");
    let table = colorchecker::reflectances();
    let training: Vec<Vec<f64>> =
        (0..24).map(|i| table.spectrum(i).expect("a patch").in_bands(&bands)).collect();
    let estimator = Estimator::regularised(&channels, &training, 6, 0.01).expect("an estimator");
    let planes: Vec<Vec<f32>> = (0..3)
        .map(|c| (0..SIDE * SIDE).map(|i| ((i * 7 + c) % 1000) as f32 * 1e-3).collect())
        .collect();
    let planes: Vec<&[f32]> = planes.iter().map(Vec::as_slice).collect();
    let mut out = vec![0.0; SIDE * SIDE];
    let time = seconds(|| {
        for band in 0..bands.count {
            estimator.band(band, &planes, &mut out);
            black_box(&out);
        }
    });
    told("16 Mpixel to 31 bands", time, SIDE * SIDE * 4 * (3 + 1) * bands.count);
}
