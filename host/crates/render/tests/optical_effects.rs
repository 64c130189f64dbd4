//! Every effect of the optics against its closed form, over its range: the tests that
//! `camrig effects` names.

use camrig_base::{Bands, Plane};
use camrig_camera::{Camera, OpticalEffect};
use camrig_optics::{Blur, Lens, Options};
use camrig_render::{SceneLight, lens, scene_irradiance, sensor_grid};
use std::f64::consts::PI;

/// Of 1 nm, so that the mean over a band is the value at its centre.
const BANDS: Bands = Bands { start_nm: 400.0, step_nm: 1.0, count: 301 };

/// A diffraction-limited lens of f/2.8 on a small sensor, with one effect.
fn camera(effect: Option<(&str, &[f32])>) -> Camera {
    let mut camera = Camera::load("mt9t012").unwrap().with_size(120, 90).unwrap();
    let effect = effect.map(|(kind, values)| OpticalEffect::new(kind, values).unwrap());
    camera.optical_effects.extend(effect);
    camera
}

fn through(kind: &str, values: &[f32]) -> (Camera, Box<dyn Lens>) {
    let camera = camera(Some((kind, values)));
    let lens = lens(&camera, &BANDS, &Options::default()).unwrap();
    (camera, lens)
}

/// The lens without effects.
fn plain() -> Box<dyn Lens> {
    lens(&camera(None), &BANDS, &Options::default()).unwrap()
}

/// The transfer function of a lens that blurs alike everywhere, at a frequency in cycles/mm.
fn otf(lens: &dyn Lens, nm: f64, f: f64) -> f64 {
    let Blur::Otf(otf) = lens.blur(nm) else { panic!("no transfer function") };
    (otf.at)(f)
}

/// The first band of a grey card through the camera, W m⁻² nm⁻¹.
fn grey_card(camera: &Camera) -> Plane<f32> {
    let (light, options) = (SceneLight::lux("D65", 300.0), Options::default());
    let scene = scene_irradiance(camera, "uniform:0.3", &light, &options, |_, _| ()).unwrap();
    scene.cube.plane(0).unwrap()
}

/// Every combination of some values of each parameter.
fn corners(values: &[[f32; 3]]) -> Vec<Vec<f32>> {
    values.iter().fold(vec![Vec::new()], |all, of_one| {
        let with = |rest: &Vec<f32>| of_one.map(|v| [rest.as_slice(), &[v]].concat());
        all.iter().flat_map(with).collect()
    })
}

#[test]
fn defocus() {
    // The autocorrelation of the pupil e^(2πi·W·ρ²), W = δ/(8N²) in waves, as an integral across
    // the overlap of the two circles: (4/π)∫ √(1 − (u + x)²)·cos(8πW·x·u) du from 0 to 1 − x.
    for shift_um in [-1000.0f32, -40.0, 5.0, 1000.0] {
        let (_, lens) = through("defocus", &[shift_um]);
        for nm in [450.0, 650.0] {
            let waves = f64::from(shift_um) * 1e3 / (8.0 * 2.8f64.powi(2) * nm);
            for x in [0.01, 0.05, 0.2, 0.5, 0.9] {
                let steps = 40_000;
                let du = (1.0 - x) / f64::from(steps);
                let value = |i: i32| {
                    let u = (f64::from(i) + 0.5) * du;
                    (1.0 - (u + x).powi(2)).sqrt() * (8.0 * PI * waves * x * u).cos()
                };
                let exact = 4.0 / PI * du * (0..steps).map(value).sum::<f64>();
                let found = otf(&*lens, nm, x * 1e6 / (nm * 2.8));
                assert!((found - exact).abs() < 1e-5, "{shift_um} µm, {x}: {found}, not {exact}");
            }
        }
    }
}

#[test]
fn lateral_colour() {
    for values in corners(&[[-20.0, 3.0, 20.0], [-20.0, -1.0, 20.0]]) {
        let (camera, lens) = through("lateral-colour", &values);
        let corner = sensor_grid(&camera).corner_mm();
        let [blue, red] = [0, 1].map(|k| f64::from(values[k]));
        let shifts =
            [(420.0, blue), (450.0, blue), (500.0, 0.5 * blue), (625.0, 0.75 * red), (690.0, red)];
        for (nm, px) in shifts {
            for h in [0.2 * corner, corner] {
                // Where the point lies whose ideal height is h.
                let real = h + h / corner * px * 2.2e-3;
                let ideal = lens.ideal_place(nm).map_or(real, |place| place.at(real, 0.0).0);
                assert!((ideal - h).abs() < 1e-9, "{values:?}, {nm} nm: {ideal}, not {h}");
            }
        }
    }
}

#[test]
fn distortion() {
    for values in corners(&[[-0.1, 0.03, 0.2], [-0.02, 0.01, 0.1], [0.8, 1.0, 1.25]]) {
        let (camera, lens) = through("distortion", &values);
        let corner = sensor_grid(&camera).corner_mm();
        let [k1, k2, size] = [0, 1, 2].map(|k| f64::from(values[k]));
        for r in [0.1, 0.5, 0.9] {
            let real = r * corner * (size + k1 * r * r + k2 * r.powi(4));
            let (x, y) = lens
                .ideal_place(550.0)
                .map_or((0.6 * real, 0.8 * real), |place| place.at(0.6 * real, 0.8 * real));
            let off = (x - 0.6 * r * corner).hypot(y - 0.8 * r * corner);
            assert!(off < 1e-9, "{values:?}, r {r}: {off} mm");
        }
    }
}

#[test]
fn decentre_tilt() {
    // cos⁴ about the axis, a lens of 4.9 mm, pixels of 2.2 µm.
    for values in corners(&[[-500.0, 20.0, 500.0], [-500.0, 0.0, 500.0]]) {
        let (camera, lens) = through("decentre-tilt", &values);
        let axis = [0, 1].map(|k| 2.2e-3 * f64::from(values[k]));
        let found = lens.axis_mm();
        assert!((found.0 - axis[0]).abs() < 1e-9 && (found.1 - axis[1]).abs() < 1e-9);
        let plane = grey_card(&camera);
        let fall_off = |x: usize, y: usize| {
            let [dx, dy] = [(x, 60.0, axis[0]), (y, 45.0, axis[1])]
                .map(|(i, half, axis)| (i as f64 + 0.5 - half) * 2.2e-3 - axis);
            (1.0 + (dx * dx + dy * dy) / 4.9f64.powi(2)).powi(-2)
        };
        let scale = f64::from(plane.at(60, 45)) / fall_off(60, 45);
        for (x, y) in [(0, 0), (119, 0), (0, 89), (119, 89), (30, 70)] {
            let ratio = f64::from(plane.at(x, y)) / (scale * fall_off(x, y));
            // 16 bits of the brightest of 16 pixels.
            assert!((ratio - 1.0).abs() < 3e-5, "{values:?}, {x},{y}: {ratio}");
        }
    }
}

#[test]
fn lens_transmittance() {
    for values in corners(&[[0.01, 0.7, 2.0], [-0.5, 0.1, 0.5]]) {
        let (_, lens) = through("lens-transmittance", &values);
        let [factor, slope] = [0, 1].map(|k| f64::from(values[k]));
        for nm in [405.0, 500.0, 550.0, 680.0] {
            let found = lens.steradians(nm) / plain().steradians(nm);
            let exact = (factor + slope * (nm - 550.0) / 100.0).max(0.0);
            assert!((found - exact).abs() < 1e-6, "{values:?}, {nm} nm: {found}, not {exact}");
        }
    }
}

#[test]
fn f_number() {
    for light in [0.06f32, 0.5, 2.0, 16.0] {
        let (_, lens) = through("f-number", &[light]);
        let n = 2.8 / f64::from(light).sqrt();
        let found = lens.steradians(550.0) / plain().steradians(550.0);
        // Eq. 7; for large N, the light.
        let exact = (1.0 + 4.0 * 2.8f64.powi(2)) / (1.0 + 4.0 * n * n);
        assert!((found / exact - 1.0).abs() < 1e-6, "{light}: {found}, not {exact}");
        let cutoff = 1e6 / (550.0 * n);
        for x in [0.1, 0.5, 0.99] {
            let exact = 2.0 / PI * (f64::acos(x) - x * (1.0 - x * x).sqrt());
            assert!((otf(&*lens, 550.0, x * cutoff) - exact).abs() < 1e-6, "{light}, {x}");
        }
        assert!(otf(&*lens, 550.0, 1.01 * cutoff).abs() < 1e-6);
    }
}

#[test]
fn veiling_glare() {
    // Of a card that falls off towards the corners: (1 − g) of it, and g of its mean.
    let without = grey_card(&camera(None));
    let mean = without.data.iter().map(|&e| f64::from(e)).sum::<f64>() / without.data.len() as f64;
    for fraction in [0.0f32, 0.01, 0.2, 0.5] {
        let g = f64::from(fraction);
        let with = grey_card(&camera(Some(("veiling-glare", &[fraction]))));
        for (found, e) in with.data.iter().zip(&without.data) {
            let exact = (1.0 - g) * f64::from(*e) + g * mean;
            // 16 bits of the brightest of 16 pixels, twice.
            assert!((f64::from(*found) / exact - 1.0).abs() < 5e-5, "{g}: {found}, not {exact}");
        }
    }
}
