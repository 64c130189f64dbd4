//! RGB frames in memory to raw frames, as `rig view` and `simulate` do on the path for live
//! pictures: colour to what channels see, the lens, the sensor; stage by stage, beside copying the
//! same bytes.
//!
//! `cargo bench -p camrig-benches --bench live [-- FILTER]`. Two lenses: diffraction-limited, and
//! one whose PSFs, 31 x 31 pixels, differ over the field; one cell a pixel. Frames are of many
//! colours, no two alike. Rates are those of the whole, one frame after another.

use camrig::camera::{Camera, LensKind};
use camrig::exposure::IrradianceCube;
use camrig::light::LightLevel;
use camrig::optics::{Characterisation, Options};
use camrig::render::{OpticsPath, OpticsStage, SequenceStage, SimulatedSensor};
use camrig::scene::sequence::{SceneFrame, SceneSequence};
use camrig::scene_files::sequence::frames::Frames;
use camrig_benches::cost::Time;
use camrig_benches::scene_frames::{Kind, header};
use std::hint::black_box;
use std::io::Cursor;
use std::path::Path;
use std::time::Instant;

/// Frames that are timed, after one that finds colours and collapses the lens.
const FRAMES: u64 = 20;

fn main() {
    let filter = std::env::args().skip(1).find(|a| !a.starts_with("--")).unwrap_or_default();
    let folder = std::env::temp_dir().join(format!("camrig-live-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    println!("{} threads", rayon::current_num_threads());
    for size in [[640, 480], [1920, 1080]] {
        for (lens, camera) in [
            ("diffraction-limited", camera(size)),
            ("varying", behind_tables(size, &folder, false)),
            ("varying, lateral colour", behind_tables(size, &folder, true)),
        ] {
            let name = format!("{} x {}, {lens}", size[0], size[1]);
            if name.contains(&filter) {
                frames(&name, &camera, size);
            }
        }
    }
    std::fs::remove_dir_all(&folder).expect("the folder goes");
}

fn camera([width, height]: [u32; 2]) -> Camera {
    Camera::load("mt9v024").and_then(|c| c.with_size(width, height)).expect("a camera")
}

/// The same sensor behind a lens whose PSFs grow and stretch towards the corners, with distortion
/// of 2 %, and lateral colour of two pixels at the corners if it is asked for.
fn behind_tables(size: [u32; 2], folder: &Path, lateral: bool) -> Camera {
    const SIDE: usize = 128;
    const HEIGHTS: usize = 13;
    let mut camera = camera(size);
    let pitch_mm = camera.sensor.pitch_um * 1e-3;
    let corner_mm = 0.55 * pitch_mm * size.iter().map(|n| f64::from(n * n)).sum::<f64>().sqrt();
    let heights: Vec<f64> =
        (0..HEIGHTS).map(|i| corner_mm * i as f64 / (HEIGHTS - 1) as f64).collect();
    let wavelengths_nm = vec![400.0, 550.0, 700.0];
    let table = |of: &dyn Fn(f64, f64) -> f64| -> Vec<f64> {
        let pairs = heights.iter().flat_map(|h| wavelengths_nm.iter().map(move |nm| (*h, *nm)));
        pairs.map(|(h, nm)| of(h, nm)).collect()
    };
    let spacing_um = 27.0 * camera.sensor.pitch_um / SIDE as f64;
    let colour = if lateral { 2.0 * pitch_mm / corner_mm } else { 0.0 };
    let mut lens = Characterisation::example(3, 1.0);
    lens.real_height_mm =
        table(&|h, nm| h * (1.0 - 0.02 * (h / corner_mm).powi(2) + colour * (nm - 550.0) / 300.0));
    lens.relative_illumination = table(&|h, _| 1.0 - 0.4 * (h / corner_mm).powi(2));
    lens.chief_ray_angle_deg = None;
    lens.psf.data = Vec::new();
    for h in &heights {
        let r = h / corner_mm;
        for nm in &wavelengths_nm {
            let chromatic = 0.02 * (nm - 400.0) / 10.0;
            let pixels = |i: usize| (i as f64 - (SIDE / 2) as f64) * 27.0 / SIDE as f64;
            let (radial, across) = (1.0 + 2.5 * r * r + chromatic, 0.9 + 0.7 * r);
            lens.psf.data.extend((0..SIDE * SIDE).map(|k| {
                let (y, x) = (pixels(k / SIDE) / radial, pixels(k % SIDE) / across);
                (-0.5 * (x * x + y * y)).exp() as f32
            }));
        }
    }
    (lens.psf.size, lens.psf.spacing_um) = (SIDE, spacing_um);
    lens.psf.heights_mm = heights.clone();
    lens.psf.wavelengths_nm = wavelengths_nm.clone();
    (lens.heights_mm, lens.wavelengths_nm) = (heights, wavelengths_nm);
    lens.psf.normalise().expect("light");
    let tables = folder.join(format!("{}-{lateral}", size[0]));
    lens.write(&tables, true).expect("tables");
    camera.lens.kind = LensKind::Characterised(tables);
    camera
}

/// The codes of a frame: soft shapes that move, under noise of a few codes.
fn codes(number: u64, [width, height]: [u32; 2]) -> Vec<u8> {
    let mut state = 0x9E37_79B9_7F4A_7C15u64 ^ (number << 32);
    let mut noise = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f64 / f64::from(1 << 24)
    };
    let mut bytes = Vec::with_capacity(Kind::Codes.payload([width, height]));
    for y in 0..height {
        for x in 0..width {
            let (u, v) = (f64::from(x) / 60.0 + number as f64 / 9.0, f64::from(y) / 45.0);
            for c in 0..3 {
                let phase = f64::from(c) * 0.9;
                let wave = (u + phase).sin() * (v - 0.6 * phase).cos() + (0.3 * u * v).sin();
                bytes.push((128.0 + 55.0 * wave + 8.0 * noise()).clamp(0.0, 255.0) as u8);
            }
        }
    }
    bytes
}

/// Frames of a stream in memory.
fn stream(size: [u32; 2], count: u64) -> Vec<SceneFrame> {
    let mut bytes = Vec::new();
    for number in 0..count {
        bytes.extend(header(number, Some((size, Kind::Codes))));
        bytes.extend(codes(number, size));
    }
    bytes.extend(header(count, None));
    let mut frames = Frames::new("memory", Box::new(Cursor::new(bytes)));
    let frame = |_| frames.next_frame().expect("a frame").expect("not the end");
    (0..count).map(frame).collect()
}

fn frames(name: &str, camera: &Camera, size: [u32; 2]) {
    let mut stage = SequenceStage::new(OpticsStage {
        scene: "memory".into(),
        illuminant: None,
        level: Some(LightLevel::Lux(400.0)),
        options: Options { oversample: Some(1), ..Options::default() },
        cache: None,
        motion: None,
        path: OpticsPath::Live,
    })
    .expect("a stage");
    let settings = camera.settings(0, 0.01, None);
    // One for all frames, as the programs have it.
    let mut kept = None;
    let mut raw = |cube: &IrradianceCube| {
        let sensor = kept
            .get_or_insert_with(|| SimulatedSensor::new(camera, &cube.header).expect("a sensor"));
        sensor.frame(cube, &settings).expect("a frame")
    };
    let all = stream(size, FRAMES + 1);
    let (mut whole, mut colour, mut optics, mut sensor) = (0.0, 0.0, 0.0, 0.0);
    let mut spent = Time { wall: 0.0, cpu: 0.0 };
    let mut said = None;
    for (frame, again) in all.into_iter().zip(stream(size, FRAMES + 1)) {
        let number = frame.number;
        let opening = Instant::now();
        black_box(again.open().expect("a picture").size());
        let opening = opening.elapsed().as_secs_f64();
        let (mut with_lens, mut with_sensor) = (0.0, 0.0);
        let time = Time::of(|| {
            let begin = Instant::now();
            let output = stage.run(camera, frame, |_, _| ()).expect("light");
            with_lens = begin.elapsed().as_secs_f64();
            black_box(raw(&output.cube));
            with_sensor = begin.elapsed().as_secs_f64();
            said = Some((output.optics, output.collapse));
        });
        if number == 0 {
            println!("live: {name}: the first frame {:.1} s", time.wall);
            continue;
        }
        spent = Time { wall: spent.wall + time.wall, cpu: spent.cpu + time.cpu };
        whole += with_sensor;
        colour += opening;
        optics += with_lens - opening;
        sensor += with_sensor - with_lens;
    }
    let ms = |seconds: f64| 1e3 * seconds / FRAMES as f64;
    let bytes = codes(0, size);
    let floor =
        (0..5).map(|_| Time::of(|| drop(black_box(bytes.clone())))).fold(Time::most(), Time::best);
    let Some((report, Some(collapse))) = said else { panic!("no fast path") };
    let blur = report.nodes.map_or("one blur".to_string(), |nodes| {
        format!("{0} x {0} kernels at {1} x {2} nodes", nodes.kernel, nodes.grid.0, nodes.grid.1)
    });
    println!(
        "live: {name}: {:.1} frames/s ({:.1} ms, {:.0} ms processor): colour {:.1} ms, lens {:.1} \
         ms, sensor {:.1} ms; copying the frame {:.2} ms; {blur}; at edges at most {:.1e} of \
         white left out, bands {:.1} µm apart",
        FRAMES as f64 / whole,
        ms(whole),
        ms(spent.cpu),
        ms(colour),
        ms(optics),
        ms(sensor),
        1e3 * floor.wall,
        collapse.left_out,
        collapse.lateral_um,
    );
}
