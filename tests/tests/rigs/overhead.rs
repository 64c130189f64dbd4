//! Bytes on a clean link in addition to those of the spectral rows and the packed raw rows.

use camrig::Plane;
use camrig::camera::Camera;
use camrig::render::{CubeHeader, IrradianceCube, IrradianceWriter, SimulatedSensor};
use camrig::rig::feed::Feed;
use camrig::rig::transport::MAX_PACKET;
use camrig::rig::{FrameRequest, Rig, Url, emulator, hid, serial};
use camrig::scene::Bands;
use camrig_rig_link::framing::Framing;
use camrig_rig_link::host::Limits;

const WIDTH: usize = 1920;
const HEIGHT: usize = 32;

fn cube(bands: usize) -> IrradianceCube {
    let header = CubeHeader::new(
        (WIDTH, HEIGHT),
        &Bands { start_nm: 400.0, step_nm: 300.0 / bands as f64, count: bands },
        "test",
    );
    let mut writer = IrradianceWriter::new(header).unwrap();
    for band in 0..bands {
        let light = |x: usize, y: usize| 1e-3 * ((x * 7 + y * 3 + band) % 100) as f32;
        writer.push(&Plane::from_fn(WIDTH, HEIGHT, light)).unwrap();
    }
    writer.finish().unwrap()
}

/// Share that the protocol adds in one frame of 12 bits, both directions together.
fn overhead(framing: Framing, limits: Limits, bands: usize) -> f64 {
    let mut camera = Camera::load("mt9v024").unwrap();
    (camera.sensor.width, camera.sensor.height) = (WIDTH as u32, HEIGHT as u32);
    camera.sensor.bits = 12;
    let cube = cube(bands);
    let sensor = SimulatedSensor::new(&camera, &cube.header).unwrap();
    let collapsed = bands == 1;
    let mut feed = if collapsed { Feed::collapsed(&cube, &sensor) } else { Feed::spectral(&cube) };
    let mut rig = Rig::with_transport(Url::Emulator, emulator::open_as(framing, limits)).unwrap();
    rig.set_camera(&sensor).unwrap();
    let before = rig.link_bytes();
    let request = FrameRequest::new(camera.settings(0, 0.01, None));
    let frame = rig.frame_from(&mut feed, &sensor, &request).unwrap();
    let after = rig.link_bytes();
    let rows = (feed.bytes() + frame.packed.len()) as f64;
    (after.0 - before.0 + after.1 - before.1) as f64 / rows - 1.0
}

/// In per cent, for collapsed rows, 8 bands and 31. Streams add the header, place, CRC and length
/// of a packet, and COBS. Reports add their pointer (1 byte of 64, 2 of 1024) and what each flush
/// leaves unused, half a report in the mean; the number of flushes depends on which end waits for
/// the other. At most 16 reports from the rig may be under way, so a host acknowledges a row of
/// 2880 packed bytes 7 times in reports of 64 bytes (417 of its bytes in each packet of 7), each
/// time with a report of its own: 448 bytes. In any arrangement, an acknowledgement for every 16
/// reports is 6 % of what comes back and the pointer 1.6 % of everything, so collapsed rows, with
/// 33 bytes sent for 24 returned, cannot come below 1.6 + 6 x 24 / 57 = 4.2 %.
#[test]
fn streams_add_less_than_3_percent_and_reports_where_bands_are_many() {
    let mut tcp = Limits::default();
    tcp.packet_bytes = MAX_PACKET as u16;
    for (framing, limits, most) in [
        (Framing::Length, tcp, [1.0, 0.3, 0.3]),
        (Framing::Cobs, serial::limits(3_000_000), [2.0, 1.2, 1.2]),
        (Framing::Report(1024), hid::limits(1024), [12.0, 5.0, 3.0]),
        (Framing::Report(64), hid::limits(64), [12.0, 5.0, 3.0]),
    ] {
        for (bands, most) in [1, 8, 31].into_iter().zip(most) {
            let share = 100.0 * overhead(framing, limits, bands);
            println!("{framing:?}, {bands} bands: {share:.2} %");
            assert!(share < most, "{framing:?}, {bands} bands: {share} %");
        }
    }
}
