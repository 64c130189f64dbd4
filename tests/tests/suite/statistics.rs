//! Statistics of a seeded frame set for each preset, so that no figure changes unnoticed.
//!
//! `cargo insta review` (or `INSTA_UPDATE=always cargo test`) accepts new figures; they belong
//! under "Numbers changed" in the changelog.

use camrig::camera::{Camera, presets};
use camrig::render::{Arithmetic, CubeHeader, IrradianceCube, SimulatedSensor};
use camrig::scene::Bands;
use std::fmt::Write;

const SIDE: usize = 128;
const FRAMES: u32 = 8;

#[test]
fn of_every_preset() {
    let mut text = String::new();
    for name in presets::NAMES {
        for arithmetic in [Arithmetic::F32, Arithmetic::Fixed] {
            writeln!(text, "{name} {arithmetic:?}\n{}", figures(name, arithmetic)).unwrap();
        }
    }
    insta::assert_snapshot!(text);
}

/// Mean, variance, its temporal and fixed parts and the covariance with the right and lower
/// neighbour of the same colour (DN, DN²), and a digest of all DN.
fn figures(name: &str, arithmetic: Arithmetic) -> String {
    let mut camera = Camera::load(name).unwrap();
    camera.sensor.width = SIDE as u32;
    camera.sensor.height = SIDE as u32;
    let bands = Bands::VISIBLE;
    let header = CubeHeader::new((SIDE, SIDE), &bands, "");
    // Equal irradiance in all bands that half fills the green pixels in 10 ms.
    let exposure_s = 0.01;
    let green: f64 = camera.sensor.response(&bands)[1].iter().sum();
    let level = 0.5 * camera.sensor.full_well_e / (green * exposure_s);
    let cube = IrradianceCube::uniform(header, &vec![level as f32; bands.count]).unwrap();
    let sensor = SimulatedSensor::new(&camera, &cube.header).unwrap();
    let mut digest = 0xcbf2_9ce4_8422_2325u64;
    let frames: Vec<Vec<f64>> = (0..FRAMES)
        .map(|i| {
            let settings = camera.settings(i, exposure_s, None);
            let frame = sensor
                .frame_with(
                    &cube,
                    &settings,
                    camrig::render::FrameOptions {
                        arithmetic,
                        ..camrig::render::FrameOptions::default()
                    },
                )
                .unwrap();
            for byte in frame.data.iter().flat_map(|v| v.to_le_bytes()) {
                digest = (digest ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
            }
            frame.data.iter().map(|&v| f64::from(v)).collect()
        })
        .collect();
    // Green pixels of one parity, so that colours do not mix.
    let green = camera.sensor.cfa.channels().iter().position(|&c| c == 'G').unwrap_or(0);
    let x0 = (0..2).find(|&x| camera.sensor.cfa.channel(x, 0) == green).unwrap_or(0);
    let pixels: Vec<usize> = (0..SIDE - 2)
        .step_by(2)
        .flat_map(|y| (x0..SIDE - 2).step_by(2).map(move |x| y * SIDE + x))
        .collect();
    let n = pixels.len() as f64;
    let mean_frame: Vec<f64> = (0..SIDE * SIDE)
        .map(|p| frames.iter().map(|f| f[p]).sum::<f64>() / f64::from(FRAMES))
        .collect();
    let mean = pixels.iter().map(|&p| mean_frame[p]).sum::<f64>() / n;
    let over = |f: &dyn Fn(usize) -> f64| pixels.iter().map(|&p| f(p)).sum::<f64>() / n;
    let temporal = over(&|p| {
        frames.iter().map(|f| (f[p] - mean_frame[p]).powi(2)).sum::<f64>() / f64::from(FRAMES - 1)
    });
    let spatial = over(&|p| (mean_frame[p] - mean).powi(2)) - temporal / f64::from(FRAMES);
    let covariance = |step: usize| {
        over(&|p| {
            let off = |f: &[f64], p: usize| f[p] - mean_frame[p];
            let pair = |f: &Vec<f64>| off(f, p) * off(f, p + step);
            frames.iter().map(pair).sum::<f64>() / f64::from(FRAMES - 1)
        })
    };
    format!(
        "mean {mean:.4}  temporal {temporal:.4}  fixed {spatial:.4}  covariance right {:.4} \
         below {:.4}  digest {digest:016x}",
        covariance(2),
        covariance(2 * SIDE)
    )
}
