//! The link to a rig: its rate against that of the bare transport, the bytes that the protocol
//! adds, the emulator's sensor stage against `camrig expose`, and frames per second over TCP.
//!
//! `cargo bench -p camrig-benches --bench link`. Ratios are between figures of one run on one
//! machine.

use camrig::Plane;
use camrig::camera::Camera;
use camrig::render::{CubeHeader, IrradianceCube, IrradianceWriter, SimulatedSensor};
use camrig::rig::emulator::{self, Emulator};
use camrig::rig::feed::Feed;
use camrig::rig::transport::MAX_PACKET;
use camrig::rig::{FrameRequest, Rig, hid, serial, serve};
use camrig::scene::Bands;
use camrig_firmware_sim::rig as device;
use camrig_rig_link::device::Model;
use camrig_rig_link::framing::Framing;
use camrig_rig_link::host::Limits;
use camrig_rig_link::message::{Codec, FrameBegin};
use camrig_rig_link::registers::Registers;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::mpsc;
use std::time::{Duration, Instant};

const WIDTH: usize = 1920;
const HEIGHT: usize = 1080;
const BITS: u8 = 12;
const EXPOSURE_S: f64 = 0.01;

fn main() {
    overhead();
    sensor_stage();
    let tcp = Raw::tcp();
    frames_per_second(&tcp);
    link_rate("TCP", &tcp, Rig::open(&tcp_server()).unwrap());
    #[cfg(unix)]
    link_rate("pty", &Raw::pty(), Rig::open(&pty_server()).unwrap());
}

/// The mt9v024 preset with another size and bit depth.
fn camera(height: usize) -> Camera {
    let mut camera = Camera::load("mt9v024").unwrap();
    (camera.sensor.width, camera.sensor.height) = (WIDTH as u32, height as u32);
    camera.sensor.bits = BITS;
    camera
}

/// Irradiance from dark at the left to most of the full well at the right, different in each band
/// and row.
fn cube(height: usize, bands: usize) -> IrradianceCube {
    let header = CubeHeader::new(
        (WIDTH, height),
        &Bands { start_nm: 400.0, step_nm: 300.0 / bands as f64, count: bands },
        "bench",
    );
    let mut writer = IrradianceWriter::new(header).unwrap();
    for band in 0..bands {
        let plane = Plane::from_fn(WIDTH, height, |x, y| {
            4e-3 * x as f32 / WIDTH as f32 * (1.0 - 0.1 * ((y + band) % 7) as f32)
        });
        writer.push(&plane).unwrap();
    }
    writer.finish().unwrap()
}

fn request(camera: &Camera, frame: u32) -> FrameRequest {
    FrameRequest::new(camera.settings(frame, EXPOSURE_S, None))
}

/// A server for one emulator on a free port.
fn tcp_server() -> String {
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || {
        let ready = |address: &str| sender.send(format!("tcp://{address}")).unwrap();
        serve::tcp("127.0.0.1:0", None, Emulator::new(None), ready, drop).unwrap();
    });
    receiver.recv().unwrap()
}

#[cfg(unix)]
fn pty_server() -> String {
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || {
        serve::pty(Emulator::new(None), |path| sender.send(path.to_string()).unwrap(), drop)
            .unwrap();
    });
    format!("serial://{}", receiver.recv().unwrap())
}

/// Bytes on the link in addition to those of the rows, for whole frames on a clean link.
fn overhead() {
    println!(
        "bytes on the link beyond rows of {WIDTH} pixels and their raw rows, both directions:"
    );
    println!("  {:22} {:>10} {:>10} {:>10}", "", "collapsed", "8 bands", "31 bands");
    let camera = camera(64);
    let mut tcp = Limits::default();
    tcp.packet_bytes = MAX_PACKET as u16;
    for (name, framing, limits) in [
        ("TCP", Framing::Length, tcp),
        ("serial", Framing::Cobs, serial::limits(3_000_000)),
        ("HID, 1024-byte reports", Framing::Report(1024), hid::limits(1024)),
        ("HID, 64-byte reports", Framing::Report(64), hid::limits(64)),
    ] {
        print!("  {name:22}");
        for bands in [1, 8, 31] {
            let cube = cube(64, bands);
            let sensor = SimulatedSensor::new(&camera, &cube.header).unwrap();
            let mut feed =
                if bands == 1 { Feed::collapsed(&cube, &sensor) } else { Feed::spectral(&cube) };
            let transport = emulator::open_as(framing, limits);
            let mut rig = Rig::with_transport(camrig::rig::Url::Emulator, transport).unwrap();
            rig.set_camera(&sensor).unwrap();
            let before = rig.link_bytes();
            let frame = rig.frame_from(&mut feed, &sensor, &request(&camera, 0)).unwrap();
            let after = rig.link_bytes();
            let moved = (after.0 - before.0 + after.1 - before.1) as f64;
            let rows = (feed.bytes() + frame.packed.len()) as f64;
            print!(" {:9.2} %", 100.0 * (moved / rows - 1.0));
        }
        println!();
    }
}

/// Rows of the emulator without a link, against the sensor stage of `camrig expose`, one thread
/// each.
fn sensor_stage() {
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let camera = camera(256);
    for bands in [1, 8] {
        let cube = cube(256, bands);
        let sensor = SimulatedSensor::new(&camera, &cube.header).unwrap();
        let settings = camera.settings(0, EXPOSURE_S, None);
        let on_link =
            device::Sensor { captures: [&sensor.config].into_iter().collect(), readout: None };
        let shape = on_link.frame_shape(bands as u16, BITS).unwrap();
        let mut feed = Feed::spectral(&cube).kept();
        let row_bytes = feed.bytes() / 256;
        let mut spectral = vec![0; feed.bytes()];
        for (y, row) in spectral.chunks_mut(row_bytes).enumerate() {
            feed.units(y, 0, row).unwrap();
        }
        let mut camera_bytes = vec![0; 1 << 20];
        let n = camrig_firmware_sim::camera::encode(
            &sensor.config,
            sensor.crosstalk(),
            &mut camera_bytes,
        );
        let mut emulator = Emulator::with_threads(1, None);
        let mut model = emulator.model();
        model.camera_piece(0, &camera_bytes[..n.unwrap()]).unwrap();
        model.camera_end().unwrap();
        let begin = FrameBegin {
            transfer: 1,
            frame: 0,
            rows: shape.rows,
            width: WIDTH as u16,
            bands: bands as u16,
            codec: Codec::Bfp16,
            arithmetic: camrig_rig_link::message::NumberFormat::F32,
            raw_bits: BITS,
            temperature_c: settings.temperature_c,
            before: camrig_rig_link::message::Before::Dark,
            exposure: None,
        };
        let exposure_of = camrig_rig_link::message::Exposure {
            exposure_s: settings.exposure_s,
            analog_gain: settings.analog_gain,
        };
        let mut raw = vec![0; shape.raw_bytes.into()];
        let mut times = [f64::MAX; 2];
        one.install(|| {
            for _ in 0..15 {
                times[0] = times[0].min(seconds(|| {
                    sensor.frame(&cube, &settings).unwrap();
                }));
                times[1] = times[1].min(seconds(|| {
                    model.begin(&begin, exposure_of, &Registers::new()).unwrap();
                    let mut taken = 0;
                    for (y, row) in (0u16..).zip(spectral.chunks(row_bytes)) {
                        model.units(y, 0, row);
                        if y + 1 == shape.rows || y - taken == model.rows_ahead() {
                            while taken <= y {
                                model.raw_row(taken, &mut raw);
                                taken += 1;
                            }
                        }
                    }
                }));
            }
        });
        let rate = |t: f64| (WIDTH * 256) as f64 / t / 1e6;
        println!(
            "sensor stage, {bands} bands, one thread: expose {:.1} Mpixel/s, emulator \
            {:.1} Mpixel/s with packing, {:.2} x",
            rate(times[0]),
            rate(times[1]),
            times[0] / times[1]
        );
    }
}

fn seconds(run: impl FnOnce()) -> f64 {
    let start = Instant::now();
    run();
    start.elapsed().as_secs_f64()
}

/// Processor time that this process has used, s (on Linux; otherwise zero).
fn cpu_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The name ends with a parenthesis; then fields 14 and 15 of proc(5), in ticks of 10 ms.
    let fields: Vec<f64> = stat
        .rsplit(')')
        .next()
        .unwrap_or_default()
        .split_whitespace()
        .skip(11)
        .take(2)
        .filter_map(|f| f.parse().ok())
        .collect();
    fields.iter().sum::<f64>() * 0.01
}

/// The rate that a bench sees: stored irradiance to raw frames over TCP.
fn frames_per_second(tcp: &Raw) {
    println!("{WIDTH} x {HEIGHT} RAW12 over TCP, host to emulator and raw back, unpacked:");
    let camera = camera(HEIGHT);
    for (bands, frames, fps) in
        [(1, 600u32, None), (1, 600, Some(60.0)), (8, 60, None), (31, 30, None)]
    {
        let cube = cube(HEIGHT, bands);
        let sensor = SimulatedSensor::new(&camera, &cube.header).unwrap();
        let collapsed = bands == 1;
        let feed = if collapsed { Feed::collapsed(&cube, &sensor) } else { Feed::spectral(&cube) };
        let mut feed = feed.kept();
        let mut rig = Rig::open(&tcp_server()).unwrap();
        rig.set_camera(&sensor).unwrap();
        let mut latency = Vec::new();
        let (mut start, mut cpu) = (Instant::now(), cpu_s());
        for i in 0..=frames {
            if i == 1 {
                // The first frame computes the rows.
                (start, cpu) = (Instant::now(), cpu_s());
            }
            if let (Some(fps), Some(n)) = (fps, i.checked_sub(1)) {
                let due = start + Duration::from_secs_f64(f64::from(n) / fps);
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
            }
            let sent = Instant::now();
            let frame = rig.frame_from(&mut feed, &sensor, &request(&camera, i)).unwrap();
            frame.to_raw(&sensor).unwrap();
            latency.push(sent.elapsed().as_secs_f64());
        }
        let (seconds, cpu) = (start.elapsed().as_secs_f64(), cpu_s() - cpu);
        latency.remove(0);
        latency.sort_by(f64::total_cmp);
        let percentile = |p: f64| 1e3 * latency[(p * (latency.len() - 1) as f64) as usize];
        let bytes = feed.bytes() + HEIGHT * WIDTH * 3 / 2;
        let pace = fps.map_or("free".into(), |f: f64| format!("paced to {f}"));
        println!(
            "  {} {pace}: {:.1} frames/s, latency p50 {:.1} ms, p99 {:.1} ms, processor \
            {:.1} ms/frame; TCP alone {:.0} frames/s",
            if bands == 1 { "collapsed".into() } else { format!("{bands} bands") },
            f64::from(frames) / seconds,
            percentile(0.5),
            percentile(0.99),
            1e3 * cpu / f64::from(frames),
            tcp.rate / bytes as f64
        );
    }
}

/// Rate of the bare transport, bytes/s: as many bytes as frames take, sent and returned at the
/// same time.
struct Raw {
    rate: f64,
}

impl Raw {
    fn tcp() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let near = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let far = listener.accept().unwrap().0;
        let pair = |s: TcpStream| (s.try_clone().unwrap(), s);
        Self::measure(pair(near), pair(far), 1 << 30)
    }

    #[cfg(unix)]
    fn pty() -> Self {
        use serialport::{SerialPort, TTYPort};
        let (mut near, mut far) = TTYPort::pair().unwrap();
        for port in [&mut near, &mut far] {
            port.set_timeout(Duration::from_secs(60)).unwrap();
        }
        let pair = |port: TTYPort| (port.try_clone_native().unwrap(), port);
        Self::measure(pair(near), pair(far), 64 << 20)
    }

    fn measure<S: Read + Write + Send>(mut near: (S, S), mut far: (S, S), bytes: usize) -> Self {
        // As in a collapsed frame of 12 bits: 33 bytes are sent for 24 returned.
        let back = bytes / 57 * 24;
        let there = bytes - back;
        let write = |to: &mut S, bytes: usize| {
            let chunk = vec![0x5a; 64 * 1024];
            for at in (0..bytes).step_by(chunk.len()) {
                to.write_all(&chunk[..chunk.len().min(bytes - at)]).unwrap();
            }
        };
        let read = |from: &mut S, bytes: usize| {
            let (mut chunk, mut got) = (vec![0; 256 * 1024], 0);
            while got < bytes {
                got += from.read(&mut chunk).unwrap();
            }
        };
        // The ends stay open until everything is read, because a closed terminal drops what it
        // holds.
        let seconds = seconds(|| {
            std::thread::scope(|scope| {
                scope.spawn(|| write(&mut near.0, there));
                scope.spawn(|| read(&mut near.1, back));
                scope.spawn(|| read(&mut far.0, there));
                scope.spawn(|| write(&mut far.1, back));
            });
        });
        Self { rate: bytes as f64 / seconds }
    }
}

/// Rate of frames with a test pattern, for which the sensor stage computes nothing.
fn link_rate(name: &str, raw: &Raw, mut rig: Rig) {
    let camera = camera(HEIGHT);
    let cube = cube(HEIGHT, 1);
    let sensor = SimulatedSensor::new(&camera, &cube.header).unwrap();
    let mut feed = Feed::collapsed(&cube, &sensor).kept();
    rig.set_camera(&sensor).unwrap();
    rig.write_register(camrig_rig_link::registers::address::TEST_PATTERN, 1).unwrap();
    rig.frame_from(&mut feed, &sensor, &request(&camera, 0)).unwrap();
    let before = rig.link_bytes();
    let seconds = seconds(|| {
        for i in 0..30 {
            rig.frame_from(&mut feed, &sensor, &request(&camera, i)).unwrap();
        }
    });
    let after = rig.link_bytes();
    let rate = (after.0 - before.0 + after.1 - before.1) as f64 / seconds;
    println!(
        "{name}: link {:.0} MB/s (test pattern), transport alone {:.0} MB/s, {:.2} x",
        rate / 1e6,
        raw.rate / 1e6,
        rate / raw.rate
    );
}
