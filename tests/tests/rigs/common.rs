//! Small cameras with effects of every kind, and irradiance that exercises them.

use camrig::Plane;
use camrig::camera::{Camera, presets};
use camrig::render::{Arithmetic, CubeHeader, IrradianceCube, IrradianceWriter, SimulatedSensor};
use camrig::rig::{FrameRequest, Rig};
use camrig::scene::Bands;
use camrig_sensor_core::config::Streams;
use std::ops::Range;
use std::path::Path;

pub const WIDTH: usize = 150;
pub const HEIGHT: usize = 37;

/// Effects in addition to those of the presets: one reads its neighbours, so that rows depend on
/// one another; one remembers the frame before.
const EFFECTS: [&str; 3] = [
    "",
    "[[effect]]\nkind = \"charge-coupling\"\nside = 0.02\nvertical = 0.03\ndiagonal = 0.004\n",
    "[[effect]]\nkind = \"image-lag\"\nfraction = 0.02\n\
     [[effect]]\nkind = \"row-temporal-noise\"\nsigma_e = 2.0\n",
];

/// A preset with a small sensor whose width is a multiple of no block, group or packing group.
pub fn camera(folder: &Path, i: usize) -> Camera {
    let name = presets::NAMES[i];
    let text = presets::file(&format!("{name}.toml")).unwrap();
    let mut small = String::new();
    for line in text.lines() {
        let line = match line.split_once(" =") {
            Some(("width", _)) => format!("width = {}", WIDTH + i),
            Some(("height", _)) => format!("height = {}", HEIGHT + i),
            Some((key @ ("qe" | "ir_cut" | "crosstalk"), value)) => {
                let file = value.trim().trim_matches('"');
                std::fs::write(folder.join(file), presets::file(file).unwrap()).unwrap();
                format!("{key} ={value}")
            }
            _ => line.to_string(),
        };
        small += &line;
        small.push('\n');
    }
    small += EFFECTS[i];
    let path = folder.join(format!("{name}-small.toml"));
    std::fs::write(&path, small).unwrap();
    let mut camera = Camera::load(path.to_str().unwrap()).unwrap();
    if i == 1 {
        // As a capture of a sensor with several.
        camera.sensor.streams = Streams { photodiode: 1, window: 2, capture: 3 };
    }
    camera
}

/// Irradiance from dark to about full well, different in every band and pixel: all groups are of
/// high dynamic range.
pub fn cube(camera: &Camera, bands: Bands) -> IrradianceCube {
    cube_from(camera, bands, 0)
}

/// The same with `darkest` of 101 steps up to the brightest as the least.
fn cube_from(camera: &Camera, bands: Bands, darkest: usize) -> IrradianceCube {
    let (width, height) = (camera.sensor.width as usize, camera.sensor.height as usize);
    let header = CubeHeader::new((width, height), &bands, "test");
    let mut writer = IrradianceWriter::new(header).unwrap();
    for band in 0..bands.count {
        let plane = Plane::from_fn(width, height, |x, y| {
            let t = ((x * 31 + y * 17 + band * 7) % 101).max(darkest);
            4e-3 * (t as f32 / 101.0).powi(4)
        });
        writer.push(&plane).unwrap();
    }
    writer.finish().unwrap()
}

pub const BANDS: Bands = Bands { start_nm: 420.0, step_nm: 40.0, count: 7 };

pub fn sensor(camera: &Camera, cube: &IrradianceCube) -> SimulatedSensor {
    SimulatedSensor::new(camera, &cube.header).unwrap()
}

/// Takes a frame of a camera that has taken none before, and compares it with the result of the
/// host.
pub fn compare_frame(
    rig: &mut Rig,
    camera: &Camera,
    cube: &IrradianceCube,
    arithmetic: Arithmetic,
    frame: u32,
) {
    let sensor = sensor(camera, cube);
    rig.set_camera(&sensor).unwrap();
    // As after a bracket: what lags is of the exposure before.
    let settings = camera.settings(frame, 0.02, Some(1.0 + f64::from(frame))).after_exposure(0.07);
    let request =
        FrameRequest { arithmetic, lit_before: frame > 0, ..FrameRequest::new(settings) };
    let before = (frame > 0).then_some(cube);
    let here = sensor
        .frame_with(
            cube,
            &settings,
            camrig::render::FrameOptions { before, traps: None, arithmetic },
        )
        .unwrap();
    let there = rig.frame(cube, &sensor, &request).unwrap().to_raw(&sensor).unwrap();
    assert!(here == there, "{}, {arithmetic:?}, frame {frame}", camera.name);
    let (low, high) = (here.data.iter().min().unwrap(), here.data.iter().max().unwrap());
    assert!(high - low > 300, "{}: DN from {low} to {high} only", camera.name);
}

/// Takes two frames of each of the three cameras in the given arithmetics and compares them with
/// the results of the host.
pub fn compare(rig: &mut Rig, arithmetics: &[Arithmetic]) {
    compare_cameras(rig, arithmetics, 0..3);
}

/// The same for some of the cameras; the first two have effects of the base model only.
pub fn compare_cameras(rig: &mut Rig, arithmetics: &[Arithmetic], cameras: Range<usize>) {
    let folder = tempfile::tempdir().unwrap();
    for i in cameras {
        let camera = camera(folder.path(), i);
        let cube = cube(&camera, BANDS);
        for &arithmetic in arithmetics {
            for frame in 0..2 {
                compare_frame(rig, &camera, &cube, arithmetic, frame);
            }
        }
    }
}

/// One frame of one camera, for slow links.
pub fn one_frame(rig: &mut Rig, arithmetic: Arithmetic) {
    let folder = tempfile::tempdir().unwrap();
    let camera = camera(folder.path(), 0);
    compare_frame(rig, &camera, &cube(&camera, BANDS), arithmetic, 0);
}

/// Takes one frame of the unchanged mt9v024 sensor and returns its number of pixels.
pub fn count_frame(rig: &mut Rig, arithmetic: Arithmetic) -> usize {
    let folder = tempfile::tempdir().unwrap();
    let mut camera = camera(folder.path(), 1);
    camera.effects.clear();
    // As in most scenes, no group is of high dynamic range: the darkest is (13/101)⁴ = 1/3643.
    let cube = cube_from(&camera, BANDS, 13);
    compare_frame(rig, &camera, &cube, arithmetic, 0);
    camera.sensor.width as usize * camera.sensor.height as usize
}
