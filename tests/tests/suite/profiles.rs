//! A driver's writes to a sensor's registers, in the sensor's own units, become frames.

use super::{camrig_ok, small_camera};
use camrig::camera::Camera;
use camrig::exposure::IrradianceCube;
use camrig::formats::{Format, Frames};
use camrig::profiles::{Profile, Sensor};
use camrig::render::SimulatedSensor;
use embedded_hal::i2c::I2c;

/// The profile in the guide is one.
#[test]
fn the_profile_in_the_guide_is_read() {
    let page = include_str!("../../../docs/guide/sensor-drivers.md");
    let text = page.split("```toml\n").nth(1).unwrap().split("```").next().unwrap();
    assert_eq!(Profile::parse(text).unwrap().name, "mine");
}

/// Frames whose exposure and gain come from registers are those of `camrig expose` with the
/// seconds and factors of the data sheet's laws, from the frame on that the delay says.
#[test]
fn what_a_driver_writes_gives_the_frames_of_expose_after_the_sensors_delay() {
    const FRAMES: usize = 5;
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("c.toml"), small_camera(32, 24, &[])).unwrap();
    let light = "simulate --camera c.toml --scene ramp --exposure 5ms -o one.npy \
                 --save-irradiance a.irr";
    camrig_ok(folder.path(), light);
    let camera = Camera::load(folder.path().join("c.toml").to_str().unwrap()).unwrap();
    let cube = IrradianceCube::open(&folder.path().join("a.irr")).unwrap();
    let simulated = SimulatedSensor::new(&camera, &cube.header).unwrap();
    let format = format!("S{}{}", camera.sensor.cfa, camera.sensor.bits);

    // IMX219: 500 and 700 lines of 3448 clocks at 182.4 MHz; gains 256 / (256 - code).
    let mut sensor = Sensor::new(Profile::builtin("imx219").unwrap());
    let write = |sensor: &mut Sensor, bytes: &[u8]| sensor.write(0x10, bytes).unwrap();
    write(&mut sensor, &[0x01, 0x5A, 0x01, 0xF4]);
    write(&mut sensor, &[0x01, 0x57, 0]);
    write(&mut sensor, &[0x01, 0x00, 1]);
    let mut taken = Vec::new();
    for frame in 0..FRAMES as u32 {
        let with = sensor.next_frame().unwrap();
        let settings = camera.settings(frame, with.exposure_s, Some(with.analog_gain));
        let raw = simulated.frame(&cube, &settings).unwrap();
        taken.push(Format::parse(&format).unwrap().encode(&Frames::from_raw(&raw)).unwrap());
        if frame == 1 {
            write(&mut sensor, &[0x01, 0x5A, 0x02, 0xBC]);
            write(&mut sensor, &[0x01, 0x57, 128]);
        }
    }
    let settings = [(500.0, 1), (500.0, 2), (700.0, 2)];
    let [first, second, third] = settings.map(|(lines, gain)| {
        let exposure_s = lines * 3448.0 / 182.4e6;
        let arguments = format!(
            "expose --camera c.toml --irradiance a.irr --frames {FRAMES} -o - --to {format} \
             --exposure {exposure_s}s --gain {gain}"
        );
        let bytes = camrig_ok(folder.path(), &arguments).stdout;
        bytes.chunks(bytes.len() / FRAMES).map(<[u8]>::to_vec).collect::<Vec<_>>()
    });
    let expected = [&first[0], &first[1], &second[2], &third[3], &third[4]];
    for (frame, (taken, expected)) in taken.iter().zip(expected).enumerate() {
        assert!(taken == expected, "frame {frame}");
    }
}
