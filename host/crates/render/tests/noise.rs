//! What is left of the noise of a camera that keeps a part of it.

use camrig_camera::{Camera, KeptNoise};
use camrig_optics::Options;
use camrig_render::{SceneLight, SimulatedSensor, scene_irradiance};

/// Of a grey card with every kind of noise in the camera: what is left of each pixel after its
/// mean signal, in frames 0 and 1, e⁻; and electrons per DN.
fn residuals(kept: KeptNoise) -> ([Vec<f64>; 2], Vec<f64>, f64) {
    let keys = [
        ("effect.hot-pixels.fraction", 0.01),
        ("effect.hot-pixels.mean_e_per_s", 1e4),
        ("effect.column-offset-fpn.sigma_e", 20.0),
        ("effect.row-temporal-noise.sigma_e", 20.0),
    ];
    let camera = Camera::load_with("mt9v024", keys).unwrap();
    let mut camera = camera.with_size(256, 192).unwrap();
    camera.keep_noise(kept);
    let (light, options) = (SceneLight::lux("D65", 300.0), Options::default());
    let cube = scene_irradiance(&camera, "uniform:0.3", &light, &options, |_, _| ());
    let cube = cube.unwrap().cube;
    let sensor = SimulatedSensor::new(&camera, &cube.header).unwrap();
    let mean = sensor.electrons(&cube, &camera.settings(0, 0.01, None)).unwrap().data;
    let max_dn = f64::from((1u32 << camera.sensor.bits) - 1);
    let e_per_dn = camera.sensor.full_well_e / max_dn;
    let frame = |number| {
        let settings = camera.settings(number, 0.01, None);
        let frame = sensor.frame(&cube, &settings).unwrap();
        let signal = |dn: &u16| (f64::from(*dn) - camera.sensor.black_level_dn) * e_per_dn;
        frame.data.iter().zip(&mean).map(|(dn, e)| signal(dn) - f64::from(*e)).collect()
    };
    let frames: [Vec<f64>; 2] = [0, 1].map(frame);
    (frames, mean.into_iter().map(f64::from).collect(), e_per_dn)
}

#[test]
fn without_noise_pixels_have_their_mean_and_with_shot_noise_its_variance() {
    let ([first, second], mean, e_per_dn) = residuals(KeptNoise::None);
    assert_eq!(first, second);
    assert!(mean[0] > 20.0 * e_per_dn, "{}", mean[0]);
    assert!(first.iter().all(|left| left.abs() < 0.5001 * e_per_dn));

    let ([first, second], mean, e_per_dn) = residuals(KeptNoise::Shot);
    let expected = mean.iter().sum::<f64>() / mean.len() as f64 + e_per_dn * e_per_dn / 12.0;
    let square = |v: &[f64]| v.iter().map(|e| e * e).sum::<f64>() / v.len() as f64;
    // 49,152 pixels: 0.6 % of a variance.
    assert!((square(&first) / expected - 1.0).abs() < 0.03, "{}", square(&first) / expected);
    // No part of it is the same in two frames.
    let common: f64 = first.iter().zip(&second).map(|(a, b)| a * b).sum();
    assert!((common / first.len() as f64 / expected).abs() < 0.03);
}
