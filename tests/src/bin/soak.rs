//! A rig over a bad line for as long as one likes: every frame is compared with the sensor model
//! of this process, and what the line cost is counted.
//!
//! ```text
//! cargo run --release -p camrig-tests --bin soak -- MINUTES [pipe|pty]
//! ```
//! 30 frames/s of 16 x 16 pixels in 2 bands; of the bytes in both directions one in a hundred is
//! changed, by a sequence that is the same in each run. A line each minute; status 1 if a frame
//! was wrong or lost, or if memory grew by more than a tenth after the first minute.

use camrig::Plane;
use camrig::camera::Camera;
use camrig::render::{CubeHeader, IrradianceCube, IrradianceWriter, SimulatedSensor};
use camrig::rig::emulator::Emulator;
use camrig::rig::transport::{ByteLink, Transport};
use camrig::rig::{FrameRequest, Rig, Url, serve};
use camrig::scene::Bands;
use camrig_rig_link::framing::Framing;
use camrig_rig_link::host::Limits;
use camrig_tests::Pipe;
use std::fs::File;
use std::io::{self, Read, Write};
use std::os::unix::net::UnixStream;
use std::process::ExitCode;
use std::sync::mpsc;
use std::time::{Duration, Instant};

const SIDE: usize = 16;
const BANDS: usize = 2;
const FRAMES_PER_S: f64 = 30.0;
/// One byte in so many is changed.
const ONE_IN: u64 = 100;
const EXPOSURE_S: f64 = 0.01;
/// Short packets, of which more than half arrive whole, and a short wait where one does not.
fn limits() -> Limits {
    let mut limits = Limits::default();
    (limits.packet_bytes, limits.send_bytes, limits.credit) = (64, 64, 16);
    (limits.timeout, limits.idle_steps) = (500, 500);
    limits
}

/// Changes bytes on their way.
struct Faulty<T> {
    stream: T,
    state: u64,
}

impl<T> Faulty<T> {
    fn new(stream: T, seed: u64) -> Self {
        Self { stream, state: seed }
    }

    /// xorshift64 (Marsaglia 2003).
    fn next(&mut self) -> u64 {
        self.state ^= self.state << 13;
        self.state ^= self.state >> 7;
        self.state ^= self.state << 17;
        self.state
    }

    fn damage(&mut self, bytes: &mut [u8]) {
        for byte in bytes {
            let random = self.next();
            if random.is_multiple_of(ONE_IN) {
                *byte ^= (random >> 32) as u8 | 1;
            }
        }
    }
}

impl<T: Read> Read for Faulty<T> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let n = self.stream.read(out)?;
        self.damage(&mut out[..n]);
        Ok(n)
    }
}

impl<T: Write> Write for Faulty<T> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut damaged = bytes.to_vec();
        self.damage(&mut damaged);
        self.stream.write_all(&damaged)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

fn link(
    reader: impl Read + Send + 'static,
    writer: impl Write + Send + 'static,
) -> Box<dyn Transport> {
    let (reader, writer) = (Faulty::new(reader, 1), Faulty::new(writer, 2));
    Box::new(ByteLink::new("soak".into(), Framing::Cobs, limits(), writer, reader))
}

/// A bad line to an emulator.
fn open(kind: &str) -> io::Result<Box<dyn Transport>> {
    if kind == "pty" {
        let (sender, receiver) = mpsc::channel();
        std::thread::spawn(move || {
            // The other end waits for ever for a name that was not sent.
            let ready = |path: &str| sender.send(path.to_string()).unwrap_or_default();
            serve::pty(Emulator::with_threads(1, None), ready, drop)
        });
        let path = receiver.recv().map_err(io::Error::other)?;
        let port = File::options().read(true).write(true).open(path)?;
        return Ok(link(port.try_clone()?, port));
    }
    let (near, far) = UnixStream::pair()?;
    std::thread::spawn(move || {
        let mut far = Some(Pipe(far));
        Emulator::with_threads(1, None).run(Framing::Cobs, || far.take(), drop);
    });
    Ok(link(near.try_clone()?, near))
}

fn camera() -> camrig::Result<Camera> {
    let mut camera = Camera::load("mt9v024")?;
    (camera.sensor.width, camera.sensor.height) = (SIDE as u32, SIDE as u32);
    Ok(camera)
}

/// From dark to about half of the full well.
fn cube() -> camrig::Result<IrradianceCube> {
    let mut writer = IrradianceWriter::new(CubeHeader::new(
        (SIDE, SIDE),
        &Bands { start_nm: 400.0, step_nm: 300.0 / BANDS as f64, count: BANDS },
        "soak",
    ))?;
    for band in 0..BANDS {
        let value = |x: usize, y: usize| 2e-3 * ((x + y + band) % SIDE) as f32 / SIDE as f32;
        writer.push(&Plane::from_fn(SIDE, SIDE, value))?;
    }
    writer.finish()
}

/// Memory of this process, pages (on Linux; otherwise none).
fn pages() -> u64 {
    let statm = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    statm.split_whitespace().nth(1).and_then(|n| n.parse().ok()).unwrap_or(0)
}

/// What went wrong.
#[derive(Default)]
struct Faults {
    wrong: u64,
    lost: u64,
    late: u64,
}

fn soak(minutes: f64, kind: &str) -> camrig::Result<bool> {
    let camera = camera()?;
    let cube = cube()?;
    let sensor = SimulatedSensor::new(&camera, &cube.header)?;
    let transport = open(kind).map_err(|e| camrig::Error::device(e.to_string()))?;
    let mut rig = Rig::with_transport(Url::Emulator, transport)?;
    rig.set_camera(&sensor)?;
    let (began, mut faults, mut first_minute) = (Instant::now(), Faults::default(), None);
    let frames = (minutes * 60.0 * FRAMES_PER_S) as u32;
    for frame in 0..frames {
        let due = began + Duration::from_secs_f64(f64::from(frame) / FRAMES_PER_S);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let request = FrameRequest::new(camera.settings(frame, EXPOSURE_S, None));
        match rig.frame(&cube, &sensor, &request) {
            Err(error) => {
                faults.lost += 1;
                println!("frame {frame}: {error}");
            }
            Ok(got) => {
                let here = sensor.frame(&cube, &request.settings)?;
                faults.wrong += u64::from(got.to_raw(&sensor)?.data != here.data);
            }
        }
        let period = Duration::from_secs_f64(1.0 / FRAMES_PER_S);
        faults.late += u64::from(Instant::now() > due + period);
        if (frame + 1).is_multiple_of((60.0 * FRAMES_PER_S) as u32) || frame + 1 == frames {
            first_minute.get_or_insert(pages());
            let (s, Faults { wrong, lost, late }) = (rig.statistics(), &faults);
            println!(
                "{:5.0} s: {} frames, {wrong} wrong, {lost} lost, {late} late; {} packets, {} \
                 damaged, {} rewinds, {} time-outs, {} torn rows; memory {} pages",
                began.elapsed().as_secs_f64(),
                frame + 1,
                s.received,
                s.damaged,
                s.rewinds,
                s.timeouts,
                s.torn_rows,
                pages()
            );
        }
    }
    let grown = pages() * 10 > first_minute.unwrap_or(0) * 11;
    Ok(faults.wrong == 0 && faults.lost == 0 && !grown)
}

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let minutes = arguments.next().and_then(|text| text.parse().ok()).unwrap_or(1.0);
    match soak(minutes, &arguments.next().unwrap_or_default()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            eprintln!("{error}");
            ExitCode::from(2)
        }
    }
}
