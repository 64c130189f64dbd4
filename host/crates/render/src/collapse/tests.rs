use super::*;
use crate::{Motion, MotionStage, OpticsStage, SequenceStage, SimulatedSensor, check_made_for};
use camrig_light::LightLevel;
use camrig_optics::Characterisation;
use camrig_scene_files::sequence::{self, Reading};
use std::path::Path;

/// A picture of squares of saturated and muted colours, some of them in stripes.
fn picture(file: &Path) {
    const SIDE: (usize, usize) = (64, 48);
    let colour = |x: usize, y: usize| -> [u8; 3] {
        let patch = (x / 8 + 8 * (y / 8)) % 11;
        let stripe = if y > 24 && x % 4 < 2 { 40 } else { 0 };
        let colours = [
            [115, 82, 68],
            [194, 150, 130],
            [98, 122, 157],
            [87, 108, 67],
            [133, 128, 177],
            [214, 126, 44],
            [56, 61, 150],
            [70, 148, 73],
            [175, 54, 60],
            [231, 199, 31],
            [243, 243, 242],
        ];
        colours[patch].map(|c: u8| c.saturating_sub(stripe))
    };
    let data: Vec<u8> =
        (0..SIDE.0 * SIDE.1).flat_map(|i| colour(i % SIDE.0, i / SIDE.0)).collect();
    let out = std::fs::File::create(file).unwrap();
    let mut encoder = png::Encoder::new(out, SIDE.0 as u32, SIDE.1 as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder.write_header().unwrap().write_image_data(&data).unwrap();
}

fn camera(changes: &[(&str, camrig_camera::Value)]) -> Camera {
    let small = [("sensor.width", 64.into()), ("sensor.height", 48.into())];
    let all = small.iter().chain(changes).cloned();
    Camera::load_with("mt9t012", all).unwrap()
}

/// The same sensor behind a lens with distortion, lateral colour and PSFs over the field.
fn behind_tables(folder: &Path) -> Camera {
    let mut camera = camera(&[]);
    Characterisation::example(17, 0.5).write(&folder.join("lens"), false).unwrap();
    camera.lens.kind = camrig_camera::LensKind::Characterised(folder.join("lens"));
    camera
}

fn stage(scene: &Path, path: OpticsPath) -> OpticsStage {
    OpticsStage {
        scene: scene.display().to_string(),
        illuminant: None,
        level: Some(LightLevel::Lux(400.0)),
        options: Options { oversample: Some(2), ..Options::default() },
        cache: None,
        motion: None,
        path,
    }
}

/// Mean electrons of every pixel.
fn electrons(camera: &Camera, cube: &IrradianceCube) -> Plane<f32> {
    let sensor = SimulatedSensor::new(camera, &cube.header).unwrap();
    sensor.electrons(cube, &camera.settings(0, 0.01, None)).unwrap()
}

/// The largest difference of two frames, in parts of the brightest pixel.
fn apart(found: &Plane<f32>, exact: &Plane<f32>) -> f64 {
    let peak = exact.data.iter().fold(0.0f32, |m, v| m.max(*v));
    let apart = found.data.iter().zip(&exact.data).map(|(a, b)| (a - b).abs());
    f64::from(apart.fold(0.0, f32::max) / peak)
}

#[test]
fn fast_paths_give_the_electrons_of_the_bands_as_nearly_as_they_say() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("p.png");
    picture(&scene);
    // Largest difference in parts of the brightest pixel: without lateral colour what components
    // leave out, which the report bounds; with it also what kernels and grid approximate.
    for (camera, order) in [(camera(&[]), 0.0), (behind_tables(folder.path()), 1e-2)] {
        let of = |path| stage(&scene, path).run(&camera, |_, _| ()).unwrap();
        let exact = electrons(&camera, &of(OpticsPath::Bands).cube);
        for path in [OpticsPath::Components, OpticsPath::Live] {
            let output = of(path);
            let report = output.collapse.unwrap();
            let worst = apart(&electrons(&camera, &output.cube), &exact);
            println!("{path}: {worst:.1e} of the peak; {report:?}");
            // 1e-3: light beyond the margins of the bands, which differ.
            assert!(worst < order + report.left_out + 1e-3, "{path}: {worst}, {report:?}");
            assert!(worst < 2e-2, "{path}: {worst}");
            assert_eq!(report.lateral_um > 0.0, order > 0.0);
            assert!(output.notes.iter().any(|note| note.contains("components in place")));
        }
    }
}

/// A cube of reflectances, mixtures of three spectra in squares, and its name as a scene.
fn mixtures(file: &Path, bands: usize, centres: &str) -> String {
    let mut bytes = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    let header =
        format!("{{'descr': '<f4', 'fortran_order': False, 'shape': (24, 32, {bands}), }}");
    bytes.extend(format!("{header:<117}\n").bytes());
    for pixel in 0..24 * 32 {
        let (x, y) = (pixel % 32 / 4, pixel / 32 / 4);
        for band in 0..bands {
            let part = band as f32 / bands as f32;
            let spectra = [part, 1.0 - part, (part - 0.5).abs()];
            let weights = [x % 2, y % 2, (x + y) % 3].map(|w| 0.4 * w as f32);
            let value: f32 = weights.iter().zip(spectra).map(|(w, s)| w * s).sum();
            bytes.extend(value.to_le_bytes());
        }
    }
    std::fs::write(file, bytes).unwrap();
    format!("{}:quantity=reflectance,{centres}", file.display())
}

#[test]
fn cubes_of_few_spectra_take_fast_paths_too() {
    let folder = tempfile::tempdir().unwrap();
    let cameras = [(camera(&[]), 0.0), (behind_tables(folder.path()), 1e-2)];
    for (bands, centres) in [(31, "start_nm=400,step_nm=10"), (33, "start_nm=400,step_nm=10")] {
        let spec = mixtures(&folder.path().join("cube.npy"), bands, centres);
        for (camera, order) in &cameras[..if bands == 31 { 2 } else { 1 }] {
            let of = |path| stage(Path::new(&spec), path).run(camera, |_, _| ()).unwrap();
            let exact = electrons(camera, &of(OpticsPath::Bands).cube);
            for path in [OpticsPath::Components, OpticsPath::Live] {
                let output = of(path);
                let report = output.collapse.unwrap();
                let worst = apart(&electrons(camera, &output.cube), &exact);
                println!("{bands} bands, {path}: {worst:.1e} of the peak; {report:?}");
                assert!(worst < order + report.left_out.min(1e-2) + 1e-3, "{worst}, {report:?}");
                if path == OpticsPath::Components {
                    // Three spectra, and what three or four channels see.
                    assert!(report.components <= 7 && report.left_out < 1e-4, "{report:?}");
                }
            }
        }
    }
}

#[test]
fn charts_take_fast_paths_at_rest_in_motion_and_in_part() {
    let camera = camera(&[]);
    let motion = Some(Motion { velocity_pixels: [3.0, -1.0], rolling: 0.8 });
    for (chart, grey) in [
        ("colorchecker", false),
        ("slanted-edge", true),
        ("resolution", true),
        ("ramp", true),
        ("dots", true),
        ("checkerboard", true),
    ] {
        let of = |path: OpticsPath| {
            let still = stage(Path::new(chart), path);
            let moving = OpticsStage { motion, ..still.clone() };
            let mut moving = MotionStage::open(&moving, &camera).unwrap();
            [
                still.run(&camera, |_, _| ()).unwrap(),
                moving.run_frame(&camera, 4, |_, _| ()).unwrap(),
                still.run_part(&camera, [0.25, 0.25, 0.5, 0.25]).unwrap(),
            ]
        };
        let exact = of(OpticsPath::Bands);
        for path in [OpticsPath::Components, OpticsPath::Live] {
            for (exact, found) in exact.iter().zip(of(path)) {
                let worst =
                    apart(&electrons(&camera, &found.cube), &electrons(&camera, &exact.cube));
                let report = found.collapse.unwrap();
                println!("{chart} {path}: {worst:.1e} of the peak; {report:?}");
                assert!(worst < report.left_out.min(1e-2) + 1e-3, "{chart} {path}: {worst}");
                assert!(!grey || report.left_out < 1e-12, "{chart}: {report:?}");
                assert_eq!(exact.light, found.light);
            }
        }
    }
}

#[test]
fn a_sequence_and_stored_electrons_give_the_bytes_of_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let frames = folder.path().join("frames");
    std::fs::create_dir(&frames).unwrap();
    picture(&frames.join("1.png"));
    picture(&frames.join("2.png"));
    let camera = behind_tables(folder.path());
    let raw = |cube: &IrradianceCube| {
        let sensor = SimulatedSensor::new(&camera, &cube.header).unwrap();
        let settings = camera.settings(0, 0.01, None);
        sensor.frame(cube, &settings).unwrap().data
    };
    let still = stage(&frames.join("1.png"), OpticsPath::Components);
    let still = still.run(&camera, |_, _| ()).unwrap().cube;
    let expected = raw(&still);
    let brightest = expected.iter().max();
    assert!(brightest > Some(&100), "{brightest:?}");

    let mut sequence = SequenceStage::new(stage(&frames, OpticsPath::Components)).unwrap();
    let spec = frames.display().to_string();
    let reading = Reading { rate_hz: Some(30.0), ..Reading::default() };
    let mut opened = sequence::open(&spec, &reading).unwrap().unwrap();
    for _ in 0..2 {
        let frame = opened.next_frame().unwrap().unwrap();
        let cube = sequence.run(&camera, frame, |_, _| ()).unwrap().cube;
        assert!(raw(&cube) == expected);
    }

    let file = folder.path().join("a.irr");
    still.save(&file, false).unwrap();
    let stored = IrradianceCube::open(&file).unwrap();
    check_made_for(&camera, &stored.header).unwrap();
    assert!(raw(&stored) == expected);
}

#[test]
fn electrons_refuse_another_response_and_scenes_and_sensors_that_need_bands() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("p.png");
    picture(&scene);
    let own = camera(&[]);
    let cube = stage(&scene, OpticsPath::Live).run(&own, |_, _| ()).unwrap().cube;
    check_made_for(&own, &cube.header).unwrap();
    let mut other = camera(&[]);
    other.sensor.cfa = camrig_base::Cfa::parse("BGGR").unwrap();
    let said = check_made_for(&other, &cube.header).unwrap_err().to_string();
    assert!(said.contains("sensor.response"), "{said}");

    let spec = mixtures(&folder.path().join("cube.npy"), 80, "start_nm=400,step_nm=5");
    let many = stage(Path::new(&spec), OpticsPath::Components);
    let said = many.run(&own, |_, _| ()).err().unwrap();
    assert_eq!(said.code(), Some(camrig_base::ErrorCode::PathUnsupported), "{said}");
}
