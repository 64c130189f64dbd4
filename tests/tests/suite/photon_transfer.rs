//! Photon transfer on simulated flats recovers the values of the camera file, in both arithmetics.

use super::{camera, small_camera};
use camrig::camera::Camera;
use camrig::render::{Arithmetic, CubeHeader, IrradianceCube, SimulatedSensor};
use camrig::scene::Bands;

/// (bits, full well, gain, read, read after gain, PRNU, dark e-/s, DSNU e-/s, row pattern, black
/// level)
type Figures = (u8, u32, f64, f64, f64, f64, f64, f64, f64, f64);

const CAMERAS: [Figures; 10] = [
    (10, 6500, 1.0, 4.0, 2.5, 0.01, 20.0, 6.0, 0.5, 42.0),
    (12, 6500, 1.0, 4.0, 0.0, 0.01, 20.0, 6.0, 0.5, 64.0),
    (12, 2000, 1.0, 1.5, 0.0, 0.02, 5.0, 1.0, 0.2, 100.0),
    (12, 30000, 1.0, 22.0, 12.0, 0.009, 350.0, 60.0, 3.0, 168.0),
    (14, 100_000, 1.0, 30.0, 0.0, 0.005, 100.0, 20.0, 2.0, 500.0),
    (12, 10_000, 4.0, 5.0, 4.0, 0.008, 10.0, 3.0, 0.4, 256.0),
    (10, 5000, 8.0, 2.6, 2.2, 0.01, 8.0, 3.0, 0.15, 64.0),
    (16, 60_000, 1.0, 8.0, 0.0, 0.006, 2.0, 1.0, 0.0, 1000.0),
    (12, 15_000, 2.0, 6.0, 3.0, 0.03, 1000.0, 100.0, 1.0, 240.0),
    (14, 20_000, 1.0, 3.0, 1.0, 0.007, 0.0, 0.0, 1.5, 512.0),
];

const WIDTH: u32 = 512;
const HEIGHT: u32 = 256;
const EXPOSURE_S: f64 = 1e-3;

struct Bench<'a> {
    camera: &'a Camera,
    arithmetic: Arithmetic,
    next: std::cell::Cell<u32>,
}

impl Bench<'_> {
    /// A fresh frame of a flat of `mean_e` photo-electrons.
    fn flat(&self, mean_e: f64) -> Vec<f64> {
        let bands = Bands { start_nm: 550.0, step_nm: 10.0, count: 1 };
        let per_unit = self.camera.sensor.response(&bands)[0][0] * EXPOSURE_S;
        let header = CubeHeader::new(
            (WIDTH as usize, HEIGHT as usize),
            &Bands { start_nm: bands.start_nm, step_nm: bands.step_nm, count: 1 },
            "",
        );
        let cube = IrradianceCube::uniform(header, &[(mean_e / per_unit) as f32]).unwrap();
        let sensor = SimulatedSensor::new(self.camera, &cube.header).unwrap();
        let settings =
            self.camera.settings(self.next.replace(self.next.get() + 1), EXPOSURE_S, None);
        let frame = sensor
            .frame_with(
                &cube,
                &settings,
                camrig::render::FrameOptions {
                    arithmetic: self.arithmetic,
                    ..camrig::render::FrameOptions::default()
                },
            )
            .unwrap();
        frame.data.iter().map(|&v| f64::from(v)).collect()
    }

    /// Mean and temporal variance (DN, DN²) from a pair of frames: the fixed pattern drops out.
    fn pair(&self, mean_e: f64) -> (f64, f64) {
        let (a, b) = (self.flat(mean_e), self.flat(mean_e));
        let n = a.len() as f64;
        let mean = a.iter().chain(&b).sum::<f64>() / (2.0 * n);
        let difference = a.iter().zip(&b).map(|(a, b)| a - b);
        let offset = difference.clone().sum::<f64>() / n;
        (mean, difference.map(|d| (d - offset).powi(2)).sum::<f64>() / (2.0 * (n - 1.0)))
    }

    /// Mean of `count` frames, pixel by pixel.
    fn stack(&self, mean_e: f64, count: u32) -> Vec<f64> {
        let mut sum = vec![0.0; (WIDTH * HEIGHT) as usize];
        for _ in 0..count {
            sum.iter_mut().zip(self.flat(mean_e)).for_each(|(s, v)| *s += v / f64::from(count));
        }
        sum
    }
}

fn spatial_variance(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0))
}

/// Janesick's photon transfer: gain from the slope of temporal variance over mean, read noise from
/// the dark pair, PRNU from the spatial variance of averaged flats. The required tolerances are
/// 0.5 %, 2 % and 5 %; the sampling errors are 0.1 %, 0.3 % and up to 1 %.
fn recover(figures: Figures, arithmetic: Arithmetic) {
    let (bits, full_well, gain, read, post, prnu, dark, dsnu, row, black) = figures;
    let camera = camera(&small_camera(
        WIDTH,
        HEIGHT,
        &[
            ("cfa", "\"mono\""),
            ("bits", &bits.to_string()),
            ("full_well_e", &full_well.to_string()),
            ("analog_gain", &gain.to_string()),
            ("read_e", &read.to_string()),
            ("read_e_post", &post.to_string()),
            ("prnu", &prnu.to_string()),
            ("dark_current_e_per_s", &dark.to_string()),
            ("dsnu_e_per_s", &dsnu.to_string()),
            ("row_fpn_e", &row.to_string()),
            ("black_level_dn", &black.to_string()),
        ],
    ));
    let bench = Bench { camera: &camera, arithmetic, next: 0.into() };
    let max_dn = f64::from((1u32 << bits) - 1);
    let true_gain = gain * max_dn / f64::from(full_well);
    let range_e = (max_dn - black) / true_gain;

    let (dark_mean, dark_variance) = bench.pair(0.0);
    let (mut xy, mut xx) = (0.0, 0.0);
    for level in 1..=16 {
        let (mean, variance) = bench.pair(range_e * 0.045 * f64::from(level));
        let (x, y) = (mean - dark_mean, variance - dark_variance);
        let weight = 1.0 / (variance * variance);
        xy += weight * x * y;
        xx += weight * x * x;
    }
    let slope = xy / xx;

    let level = 0.6 * range_e;
    let stacked = 6;
    let (light, dark_map) = (bench.stack(level, stacked), bench.stack(0.0, stacked));
    let difference: Vec<f64> = light.iter().zip(&dark_map).map(|(a, b)| a - b).collect();
    let (mean, spatial) = spatial_variance(&difference);
    let (_, light_variance) = bench.pair(level);
    let temporal = (light_variance + dark_variance) / f64::from(stacked);
    let got_prnu = (spatial - temporal).max(0.0).sqrt() / mean;
    // Eq. 10 multiplies shot noise by the pixel's gain too, so the slope is K (1 + p²).
    let got_gain = slope / (1.0 + got_prnu * got_prnu);
    let got_read = ((dark_variance - 1.0 / 12.0) / (got_gain * got_gain)).sqrt();
    let at_gain = (read * read - post * post + post * post / (gain * gain)).sqrt();
    let true_read = (at_gain * at_gain + dark * EXPOSURE_S).sqrt();

    let off = |got: f64, truth: f64| (got / truth - 1.0).abs();
    let what = format!("{figures:?} {arithmetic:?}");
    assert!(off(got_gain, true_gain) < 0.005, "{what}: gain {got_gain} DN/e-, true {true_gain}");
    assert!(off(got_read, true_read) < 0.02, "{what}: read noise {got_read} e-, true {true_read}");
    assert!(off(got_prnu, prnu) < 0.05, "{what}: PRNU {got_prnu}, true {prnu}");
}

#[test]
fn photon_transfer_recovers_ten_cameras_in_floating_point() {
    CAMERAS.into_iter().for_each(|c| recover(c, Arithmetic::F32));
}

#[test]
fn photon_transfer_recovers_ten_cameras_in_fixed_point() {
    CAMERAS.into_iter().for_each(|c| recover(c, Arithmetic::Fixed));
}
