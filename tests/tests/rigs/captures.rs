//! Sensors of several captures: a rig merges and compands to the bytes of this process.

use crate::common::BANDS;
use camrig::Plane;
use camrig::camera::Camera;
use camrig::exposure::hdr::{HdrSensor, Sent};
use camrig::render::{Arithmetic, CubeHeader, IrradianceCube, IrradianceWriter};
use camrig::rig::{FrameRequest, Rig};
use camrig_rig_link::registers::address;
use camrig_testing::hdr;
use std::path::Path;

/// Widths that are multiples of no block, group or packing group.
const SIZE: [u32; 2] = [150, 21];
const OUTPUTS: [&str; 3] = ["companded", "linear", "captures"];

/// One of the cameras of `golden/hdr`; every second with an effect that reads its neighbours.
fn camera(folder: &Path, name: &str, output: &str, more: &str) -> Camera {
    let path = folder.join("camera.toml");
    std::fs::write(&path, hdr::camera(name, SIZE, output) + more).unwrap();
    Camera::load(path.to_str().unwrap()).unwrap()
}

const NEIGHBOURS: &str =
    "[[effect]]\nkind = \"charge-coupling\"\nside = 0.02\nvertical = 0.03\ndiagonal = 0.004\n";

/// Irradiance over nine decades, different in every band and pixel.
fn cube(shift: usize) -> IrradianceCube {
    let size = SIZE.map(|n| n as usize);
    let header = CubeHeader::new((size[0], size[1]), &BANDS, "test");
    let mut writer = IrradianceWriter::new(header).unwrap();
    for band in 0..BANDS.count {
        let light = |x: usize, y: usize| {
            let t = (x * 31 + y * 17 + band * 7 + shift) % 101;
            1e-7 * 10f32.powf(9.0 * t as f32 / 100.0)
        };
        writer.push(&Plane::from_fn(size[0], size[1], light)).unwrap();
    }
    writer.finish().unwrap()
}

fn same(here: &Sent, there: &Sent) -> bool {
    match (here, there) {
        (Sent::Captures(here), Sent::Captures(there)) => here == there,
        (Sent::Merged(here), Sent::Merged(there)) => here == there,
        (Sent::Wide(here), Sent::Wide(there)) => here == there,
        _ => false,
    }
}

/// What this process sends under a light that all captures see, or that of each.
fn here(sensor: &HdrSensor, cubes: &[&IrradianceCube], request: &FrameRequest) -> Sent {
    let FrameRequest { settings, arithmetic, lit_before, .. } = *request;
    let before = lit_before.then_some(cubes);
    sensor.frame(cubes, before, &settings, arithmetic).unwrap()
}

fn compare_frame(
    rig: &mut Rig,
    camera: &Camera,
    cubes: &[&IrradianceCube],
    request: &FrameRequest,
) {
    let sensor = HdrSensor::in_light(camera, &cubes[0].header, 1.0).unwrap();
    rig.set_captures(&sensor).unwrap();
    let there = rig.frame_of_captures(cubes, &sensor, request).unwrap().to_sent(&sensor).unwrap();
    assert!(same(&here(&sensor, cubes, request), &there), "{} {request:?}", camera.name);
}

/// Takes a frame of each camera of `golden/hdr` in each output.
pub fn compare(rig: &mut Rig, arithmetic: Arithmetic) {
    let folder = tempfile::tempdir().unwrap();
    let light = cube(0);
    for (frame, name) in (0..).zip(hdr::CAMERAS) {
        for output in OUTPUTS {
            let camera = camera(folder.path(), name, output, "");
            let settings = camera.settings(frame, hdr::exposure_s(name), None);
            let request = FrameRequest { arithmetic, ..FrameRequest::new(settings) };
            compare_frame(rig, &camera, &[&light], &request);
        }
    }
}

/// Takes one companded frame of four captures and returns its number of pixels.
pub fn count_frame(rig: &mut Rig, arithmetic: Arithmetic) -> usize {
    let folder = tempfile::tempdir().unwrap();
    let camera = camera(folder.path(), "split4", "companded", "");
    let settings = camera.settings(0, hdr::exposure_s("split4"), None);
    let request = FrameRequest { arithmetic, ..FrameRequest::new(settings) };
    compare_frame(rig, &camera, &[&cube(0)], &request);
    SIZE.map(|n| n as usize).iter().product()
}

#[test]
fn an_emulator_sends_the_codes_of_this_process() {
    let mut rig = Rig::open("emulator:").unwrap();
    for arithmetic in Arithmetic::ALL {
        compare(&mut rig, arithmetic);
    }
}

/// Light that differs from window to window, effects that read neighbours, an exposure before, and
/// gain.
#[test]
fn captures_see_their_own_light_and_their_neighbours() {
    let mut rig = Rig::open("emulator:").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let lag = "[[effect]]\nkind = \"image-lag\"\nfraction = 0.02\n";
    let lights = [0, 20, 40, 60].map(cube);
    for arithmetic in Arithmetic::ALL {
        for output in OUTPUTS {
            let camera = camera(folder.path(), "split4", output, &format!("{NEIGHBOURS}{lag}"));
            let settings = camera.settings(5, 0.005, Some(2.0)).after_exposure(0.011);
            let request =
                FrameRequest { arithmetic, lit_before: true, ..FrameRequest::new(settings) };
            compare_frame(&mut rig, &camera, &lights.each_ref(), &request);
        }
    }
}

/// Exposure and gain of the registers are those of the frame, and captures have theirs by their
/// ratios; a test pattern takes the place of the captures' codes.
#[test]
fn registers_expose_all_captures() {
    let mut rig = Rig::open("emulator:").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let camera = camera(folder.path(), "split4", "linear", "");
    let light = cube(0);
    let sensor = HdrSensor::in_light(&camera, &light.header, 1.0).unwrap();
    rig.set_captures(&sensor).unwrap();
    for (register, value) in [
        (address::LINE_LENGTH_NS, 10_000),
        (address::COARSE_INTEGRATION_TIME, 800),
        (address::ANALOG_GAIN, 512),
    ] {
        rig.write_register(register, value).unwrap();
    }
    let mut request =
        FrameRequest { by_registers: true, ..FrameRequest::new(camera.settings(3, 0.001, None)) };
    let frame = rig.frame_of_captures(&[&light], &sensor, &request).unwrap();
    let said = frame.start.exposure;
    assert!((said.exposure_s - 0.008).abs() < 1e-8 && said.analog_gain == 2.0, "{said:?}");
    request.settings = camera.settings(3, said.exposure_s.into(), Some(said.analog_gain.into()));
    assert!(same(&here(&sensor, &[&light], &request), &frame.to_sent(&sensor).unwrap()));

    rig.write_register(address::TEST_PATTERN, 2).unwrap();
    let bars = rig.frame_of_captures(&[&light], &sensor, &request).unwrap();
    let Sent::Wide(bars) = bars.to_sent(&sensor).unwrap() else { panic!("24 bits") };
    // White is the end of all converters, black their 0: below black in the first.
    assert_eq!((bars.data[0], bars.data[149]), (64 + (4095 - 64) * 4096, 0));
}
