//! The emulator: in this process, over TCP and over a pseudo-terminal.

use crate::common::{self, BANDS};
use camrig::render::Arithmetic;
use camrig::rig::emulator::Emulator;
use camrig::rig::{FrameRequest, Rig, serve};
use camrig_rig_link::message::Fault;
use camrig_rig_link::registers::address;
use std::sync::mpsc;

/// Serves an emulator on a free port and returns its address.
pub fn tcp_server(versions: Option<(u8, u8)>) -> String {
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || {
        let ready = |address: &str| sender.send(format!("tcp://{address}")).unwrap();
        serve::tcp("127.0.0.1:0", None, Emulator::new(versions), ready, drop).unwrap();
    });
    receiver.recv().unwrap()
}

#[test]
fn in_process_frames_are_those_of_the_host() {
    common::compare(&mut Rig::open("emulator:").unwrap(), &Arithmetic::ALL);
}

/// A rig has all arithmetics that the host can ask for, and computes in the one that is asked for.
/// With 16 bits a frame shows which that is; with fewer their rounding is the same.
#[test]
fn a_rig_computes_in_the_arithmetic_that_is_asked_for() {
    let mut rig = Rig::open("emulator:").unwrap();
    assert_eq!(rig.device().arithmetics.count_ones() as usize, Arithmetic::ALL.len());
    let folder = tempfile::tempdir().unwrap();
    let mut camera = common::camera(folder.path(), 0);
    camera.sensor.bits = 16;
    let cube = common::cube(&camera, BANDS);
    let (sensor, settings) = (common::sensor(&camera, &cube), camera.settings(0, 0.02, None));
    let [float, fixed] = Arithmetic::ALL.map(|arithmetic| {
        common::compare_frame(&mut rig, &camera, &cube, arithmetic, 0);
        sensor
            .frame_with(
                &cube,
                &settings,
                camrig::render::FrameOptions {
                    arithmetic,
                    ..camrig::render::FrameOptions::default()
                },
            )
            .unwrap()
    });
    assert!(float != fixed);
}

#[test]
fn frames_over_tcp_are_those_of_the_host() {
    common::compare(&mut Rig::open(&tcp_server(None)).unwrap(), &Arithmetic::ALL);
}

#[cfg(unix)]
#[test]
fn frames_over_a_pseudo_terminal_are_those_of_the_host() {
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || {
        serve::pty(Emulator::new(None), |path| sender.send(path.to_string()).unwrap(), drop)
            .unwrap();
    });
    let url = format!("serial://{}", receiver.recv().unwrap());
    common::compare(&mut Rig::open(&url).unwrap(), &Arithmetic::ALL);
}

/// A proxy between a host and a rig that cuts the first connection after `after` bytes to the rig.
/// Later connections are to the second of the rigs.
fn cutting_proxy(rigs: [String; 2], after: u64) -> String {
    use std::io::Read;
    use std::net::{Shutdown, TcpListener, TcpStream};
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("tcp://{}", listener.local_addr().unwrap());
    std::thread::spawn(move || {
        let (mut limit, mut rig) = (after, &rigs[0]);
        for host in listener.incoming() {
            let host = host.unwrap();
            let link = TcpStream::connect(rig.trim_start_matches("tcp://")).unwrap();
            let pump = |from: &TcpStream, to: &TcpStream, limit| {
                let (from, to) = (from.try_clone().unwrap(), to.try_clone().unwrap());
                std::thread::spawn(move || {
                    let _ = std::io::copy(&mut (&from).take(limit), &mut &to);
                    let _ = (from.shutdown(Shutdown::Both), to.shutdown(Shutdown::Both));
                });
            };
            pump(&host, &link, limit);
            pump(&link, &host, u64::MAX);
            (limit, rig) = (u64::MAX, &rigs[1]);
        }
    });
    url
}

#[test]
fn a_frame_resumes_after_the_connection_broke() {
    let folder = tempfile::tempdir().unwrap();
    let camera = common::camera(folder.path(), 1);
    let cube = common::cube(&camera, BANDS);
    // The camera takes some 4 KB on the link, the frame 90.
    for after in [6_000, 20_000, 60_000] {
        let server = tcp_server(None);
        let mut rig = Rig::open(&cutting_proxy([server.clone(), server], after)).unwrap();
        common::compare_frame(&mut rig, &camera, &cube, Arithmetic::F32, 0);
        let sent = rig.link_bytes().0;
        assert!(sent < 100_000, "{sent} bytes in the second connection");
    }
}

/// A rig that was without power comes back with its registers at power-on: 10 ms at gain 1. The
/// frame that goes on has those that it had, and says so.
#[test]
fn a_rig_that_restarts_gets_its_registers_again() {
    let folder = tempfile::tempdir().unwrap();
    let camera = common::camera(folder.path(), 1);
    let cube = common::cube(&camera, BANDS);
    let sensor = common::sensor(&camera, &cube);
    let by_registers =
        FrameRequest { by_registers: true, ..FrameRequest::new(camera.settings(3, 1.0, None)) };
    let url = cutting_proxy([tcp_server(None), tcp_server(None)], 40_000);
    let mut rig = Rig::open(&url).unwrap();
    rig.write_register(address::COARSE_INTEGRATION_TIME, 1700).unwrap();
    rig.set_camera(&sensor).unwrap();
    rig.write_register(address::ANALOG_GAIN, 512).unwrap();
    let frame = rig.frame(&cube, &sensor, &by_registers).unwrap();
    let restored = frame.restored.unwrap();
    assert_eq!(restored, "exposure 1700 (it was 1000), gain 512 (it was 256)");
    let said = frame.start.exposure;
    assert!((said.exposure_s - 0.017).abs() < 1e-8 && said.analog_gain == 2.0, "{said:?}");
    let next = rig.frame(&cube, &sensor, &by_registers).unwrap();
    assert_eq!(next.restored, None);
    assert_eq!(next.start.exposure, said);
}

#[test]
fn collapsed_rows_differ_by_their_rounding_only() {
    let folder = tempfile::tempdir().unwrap();
    let camera = common::camera(folder.path(), 0);
    let cube = common::cube(&camera, BANDS);
    let sensor = common::sensor(&camera, &cube);
    let mut rig = Rig::open("emulator:").unwrap();
    rig.set_camera(&sensor).unwrap();
    let mut request = FrameRequest::new(camera.settings(5, 0.02, None));
    let spectral = rig.frame(&cube, &sensor, &request).unwrap().to_raw(&sensor).unwrap();
    request.collapse = true;
    let collapsed = rig.frame(&cube, &sensor, &request).unwrap().to_raw(&sensor).unwrap();
    // The rig applies the exposure, whether rig or host integrated the bands, by registers as by
    // request.
    rig.write_register(address::LINE_LENGTH_NS, 20_000).unwrap();
    rig.write_register(address::COARSE_INTEGRATION_TIME, 1000).unwrap();
    request.by_registers = true;
    request.settings.exposure_s = 1.0;
    let by_registers = rig.frame(&cube, &sensor, &request).unwrap();
    assert!(by_registers.to_raw(&sensor).unwrap() == collapsed);
    // The mean moves by at most 2^-17 of the largest of its group, far less than a DN here. The
    // noise is the same draw, so a DN changes only by the rounding of the count and of the
    // converter.
    let worst = spectral.data.iter().zip(&collapsed.data).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(worst <= Some(1), "{worst:?}");
}

#[test]
fn registers_set_the_exposure_and_faults_happen_as_ordered() {
    let folder = tempfile::tempdir().unwrap();
    let camera = common::camera(folder.path(), 0);
    let cube = common::cube(&camera, BANDS);
    let sensor = common::sensor(&camera, &cube);
    let mut rig = Rig::open(&tcp_server(None)).unwrap();
    rig.set_camera(&sensor).unwrap();
    rig.write_register(address::LINE_LENGTH_NS, 20_000).unwrap();
    rig.write_register(address::COARSE_INTEGRATION_TIME, 1000).unwrap();
    rig.write_register(address::ANALOG_GAIN, 512).unwrap();
    let mut request =
        FrameRequest { by_registers: true, ..FrameRequest::new(camera.settings(3, 1.0, None)) };
    let by_registers = rig.frame(&cube, &sensor, &request).unwrap();
    let said = by_registers.start.exposure;
    assert!((said.exposure_s - 0.02).abs() < 1e-8);
    assert_eq!(said.analog_gain, 2.0);
    request.by_registers = false;
    request.settings.exposure_s = said.exposure_s;
    request.settings.analog_gain = said.analog_gain;
    let by_message = rig.frame(&cube, &sensor, &request).unwrap();
    assert!(by_registers.packed == by_message.packed);
    assert_eq!(by_message.start.counter, by_registers.start.counter + 1);
    assert_eq!(rig.read_register(address::FRAME_COUNT).unwrap(), 2);

    let row_bytes = by_message.packed.len() / camera.sensor.height as usize;
    rig.write_register(address::FAULT_ARGUMENT, 7).unwrap();
    rig.write_register(address::FAULT, 2).unwrap();
    let corrupt = rig.frame(&cube, &sensor, &request).unwrap();
    assert_eq!(corrupt.start.fault, Fault::CorruptRow(7));
    let rows = corrupt.packed.chunks(row_bytes).zip(by_message.packed.chunks(row_bytes));
    let wrong = rows.enumerate().filter(|(_, (a, b))| a != b).map(|(row, _)| row);
    let wrong: Vec<usize> = wrong.collect();
    assert_eq!(wrong, [7]);
    rig.write_register(address::FAULT, 1).unwrap();
    assert!(rig.frame(&cube, &sensor, &request).unwrap().dropped);
    assert!(rig.frame(&cube, &sensor, &request).unwrap().packed == by_message.packed);

    // Writes between frames take effect after the delay of the sensor: gain in the next frame,
    // exposure in the one after.
    request.by_registers = true;
    rig.write_register(address::COARSE_INTEGRATION_TIME, 500).unwrap();
    rig.write_register(address::ANALOG_GAIN, 256).unwrap();
    let shown: Vec<_> = (0..2)
        .map(|_| {
            let said = rig.frame(&cube, &sensor, &request).unwrap().start.exposure;
            ((said.exposure_s * 1e3).round(), said.analog_gain)
        })
        .collect();
    assert_eq!(shown, [(20.0, 1.0), (10.0, 1.0)]);
    request.by_registers = false;

    rig.write_register(address::FAULT_ARGUMENT, 120).unwrap();
    rig.write_register(address::FAULT, 4).unwrap();
    let start = std::time::Instant::now();
    let late = rig.frame(&cube, &sensor, &request).unwrap();
    assert_eq!(late.start.fault, Fault::LateFrame(120));
    assert!(start.elapsed().as_millis() >= 120 && late.packed == by_message.packed);

    rig.write_register(address::TEST_PATTERN, 2).unwrap();
    let bars = rig.frame(&cube, &sensor, &request).unwrap().to_raw(&sensor).unwrap();
    let max = (1 << camera.sensor.bits) - 1;
    // Left: white; right: black.
    assert!(bars.data.iter().all(|&d| d == 0 || d == max));
    assert_eq!((bars.data[0], bars.data[bars.width - 1]), (max, 0));
}
