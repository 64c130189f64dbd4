//! The emulator as a GigE Vision camera, seen by a client that knows the protocol alone.

use super::{camrig_ok, small_camera};
use camrig::gige::gvcp::{self, code};
use camrig::gige::gvsp::{self, Kind};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufRead, BufReader};
use std::net::UdpSocket;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

/// Longest wait for the server's address, for a frame, and for an answer.
const PATIENCE: Duration = Duration::from_secs(60);
/// Time in which an image would have come.
const QUIET: Duration = Duration::from_secs(1);
/// Silence after which missing packets are asked for.
const SILENCE: Duration = Duration::from_millis(20);
const SIZE: (u32, u32) = (64, 48);
const DENIED: u16 = 0x8006;

pub struct Server {
    child: Child,
    pub address: String,
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A camera in front of a scene, in a folder where `c.toml` is the camera.
fn serve(folder: &Path, options: &str) -> Server {
    serve_as(folder, "gige", options)
}

/// The same as another kind of camera.
pub fn serve_as(folder: &Path, link: &str, options: &str) -> Server {
    let (width, height) = SIZE;
    std::fs::write(folder.join("c.toml"), small_camera(width, height, &[])).unwrap();
    let arguments = format!("rig serve --{link} 127.0.0.1:0 --camera c.toml {options}");
    let mut child = Command::new(env!("CARGO_BIN_EXE_camrig-under-test"))
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let stdout = child.stdout.take().unwrap();
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || sender.send(BufReader::new(stdout).lines().next()));
    let line = receiver.recv_timeout(PATIENCE).unwrap().unwrap().unwrap();
    let address = line.strip_prefix(&format!("{link}://")).unwrap().to_string();
    Server { child, address }
}

/// An image as it was put together.
struct Image {
    block: u64,
    bytes: Vec<u8>,
}

/// Packets by their numbers, and how many there are in all.
type Block = (BTreeMap<u32, Vec<u8>>, Option<u32>);

struct Client {
    control: UdpSocket,
    stream: UdpSocket,
    id: u16,
    xml: String,
    /// Blocks that are not whole.
    blocks: BTreeMap<u64, Block>,
    /// Numbers of those that were.
    done: BTreeSet<u64>,
    extended: bool,
    repeated: u32,
}

impl Client {
    fn new(server: &Server) -> Self {
        let [control, stream] = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").unwrap());
        control.connect(&server.address).unwrap();
        control.set_read_timeout(Some(PATIENCE)).unwrap();
        stream.set_read_timeout(Some(SILENCE)).unwrap();
        let (xml, blocks, done) = (String::new(), BTreeMap::new(), BTreeSet::new());
        let (extended, repeated) = (false, 0);
        let mut client = Self { control, stream, id: 0, xml, blocks, done, extended, repeated };
        let url = String::from_utf8(client.read(0x200, 512)).unwrap();
        let url: Vec<&str> = url.trim_end_matches('\0').split(';').collect();
        let [address, length] =
            [1, 2].map(|i| usize::from_str_radix(url[i], 16).unwrap().next_multiple_of(4));
        let pieces = (0..length)
            .step_by(512)
            .map(|at| client.read((address + at) as u32, 512.min(length - at)));
        client.xml = String::from_utf8(pieces.collect::<Vec<_>>().concat()).unwrap();
        client
    }

    /// Status and payload of a command's answer.
    fn ask(&mut self, code: u16, payload: &[u8]) -> (u16, Vec<u8>) {
        self.id += 1;
        self.control.send(&gvcp::request(code, self.id, false, payload)).unwrap();
        let mut answer = [0; 1000];
        let length = self.control.recv(&mut answer).unwrap();
        let (status, id, payload) = gvcp::parse_acknowledgement(&answer[..length]).unwrap();
        assert_eq!(id, self.id);
        (status, payload.to_vec())
    }

    fn read(&mut self, address: u32, count: usize) -> Vec<u8> {
        let payload = [address, count as u32].map(u32::to_be_bytes);
        let (status, data) = self.ask(code::READ_MEMORY, payload.as_flattened());
        assert_eq!(status, 0);
        data[4..].to_vec()
    }

    fn write(&mut self, address: u32, data: &[u8]) -> u16 {
        self.ask(code::WRITE_MEMORY, &[&address.to_be_bytes(), data].concat()).0
    }

    fn set(&mut self, address: u32, value: u32) {
        assert_eq!(self.write(address, &value.to_be_bytes()), 0, "{address:#x} {value}");
    }

    /// Address of a feature by the XML.
    fn address(&self, feature: &str) -> u32 {
        let register = format!("Name=\"{feature}Register\"><Address>0x");
        let (_, rest) = self.xml.split_once(&register).unwrap();
        u32::from_str_radix(rest.split_once('<').unwrap().0, 16).unwrap()
    }

    fn set_feature(&mut self, feature: &str, value: u32) {
        self.set(self.address(feature), value);
    }

    fn set_float(&mut self, feature: &str, value: f64) {
        let status = self.write(self.address(feature), &value.to_be_bytes());
        assert_eq!(status, 0, "{feature} {value}");
    }

    /// Takes control, for as long as tests take without a sign of life, and has the stream sent
    /// here.
    fn take_control(&mut self) {
        self.set(0xA00, 2);
        self.set(0x938, 600_000);
        self.set(0xD04, 1500);
        self.set(0xD18, u32::from_be_bytes([127, 0, 0, 1]));
        self.set(0xD00, self.stream.local_addr().unwrap().port().into());
    }

    /// A datagram of the stream is put in its place; false after a silence.
    fn receive(&mut self) -> bool {
        let mut datagram = [0; 2000];
        let Ok(length) = self.stream.recv(&mut datagram) else { return false };
        let packet = gvsp::parse(&datagram[..length]).unwrap();
        assert_eq!(packet.status, 0, "block {} packet {}", packet.block, packet.number);
        if self.done.contains(&packet.block) {
            return true; // a packet that was asked for twice
        }
        let (packets, count) = self.blocks.entry(packet.block).or_default();
        packets.insert(packet.number, packet.body.to_vec());
        if packet.kind == Kind::Trailer {
            *count = Some(packet.number + 1);
        }
        if packet.kind != Kind::Payload {
            self.ask_again(packet.block);
        }
        true
    }

    /// Asks for what is missing of the blocks before this one, and of itself after its trailer.
    fn ask_again(&mut self, newest: u64) {
        let wanted: Vec<(u64, u32)> = (self.blocks.iter())
            .filter(|(block, (_, count))| **block < newest || count.is_some())
            .flat_map(|(block, (packets, count))| {
                let last = packets.keys().last().copied().unwrap_or(0);
                let beyond = if count.is_none() { last + 1 } else { last };
                let missing = (0..=beyond).filter(|number| !packets.contains_key(number));
                missing.map(|number| (*block, number)).collect::<Vec<_>>()
            })
            .collect();
        for (block, number) in wanted {
            let [high, low] = [(block >> 32) as u32, block as u32];
            let payload = match self.extended {
                true => vec![0, number, number, high, low],
                false => vec![low, number, number],
            };
            let payload: Vec<u8> = payload.into_iter().flat_map(u32::to_be_bytes).collect();
            let request = gvcp::request(code::RESEND, 1, self.extended, &payload);
            self.control.send(&request).unwrap();
            self.repeated += 1;
        }
    }

    /// The next whole image.
    fn image(&mut self) -> Image {
        self.image_within(PATIENCE).expect("an image")
    }

    /// The next whole image, if it comes within this time.
    fn image_within(&mut self, wait: Duration) -> Option<Image> {
        let began = Instant::now();
        while began.elapsed() < wait {
            let whole = |(packets, count): &(BTreeMap<u32, Vec<u8>>, Option<u32>)| {
                count.is_some_and(|count| packets.len() == count as usize)
            };
            let found = self.blocks.iter().find(|(_, b)| whole(b)).map(|(id, _)| *id);
            if let Some(block) = found {
                let (packets, _) = self.blocks.remove(&block).unwrap();
                self.done.insert(block);
                let inner = 1..packets.len() as u32 - 1;
                let bytes = inner.flat_map(|number| packets[&number].clone()).collect();
                return Some(Image { block, bytes });
            }
            if !self.receive() {
                self.ask_again(u64::MAX);
            }
        }
        None
    }
}

/// Frames that `camrig expose` makes of the light in `a.irr`, from frame 0 on.
pub fn exposed(folder: &Path, format: &str, options: &str, count: usize) -> Vec<Vec<u8>> {
    let arguments =
        format!("expose --camera c.toml --irradiance a.irr --frames {count} -o - --to {format}");
    let output = camrig_ok(folder, &format!("{arguments} {options}"));
    let bytes = output.stdout.len() / count;
    output.stdout.chunks(bytes).map(<[u8]>::to_vec).collect()
}

pub fn light(folder: &Path) {
    let arguments = "simulate --camera c.toml --scene colorchecker --exposure 5ms -o one.npy \
                     --save-irradiance a.irr";
    camrig_ok(folder, arguments);
}

/// Exposure acts after two frames and gain after one, the delays of the rig's registers.
#[test]
fn frames_are_those_of_expose_and_settings_act_after_the_sensors_delay() {
    const COUNT: usize = 100;
    let folder = tempfile::tempdir().unwrap();
    let server = serve(folder.path(), "--scene colorchecker --exposure 5ms --fps 20");
    light(folder.path());
    let mut client = Client::new(&server);
    client.take_control();
    let formats = client.xml.split_once("Name=\"PixelFormat\"").unwrap().1;
    let entry = formats.split("EnumEntry Name=\"").find(|e| e.contains("12p\"")).unwrap();
    let format = entry.split('"').next().unwrap().to_string();
    let code = entry.split_once("<Value>").unwrap().1.split('<').next().unwrap();
    client.set_feature("PixelFormat", code.parse().unwrap());
    let settings = [("5ms", "1"), ("5ms", "2"), ("10ms", "2")];
    let expected = settings.map(|(exposure, gain)| {
        let options = format!("--exposure {exposure} --gain {gain}");
        exposed(folder.path(), &format, &options, COUNT)
    });
    client.set_feature("AcquisitionStart", 1);
    let mut seen = Vec::new();
    while seen.last() != Some(&2) {
        let image = client.image();
        let frame = image.block as usize - 1;
        assert!(frame < COUNT, "{seen:?}");
        let found = expected.iter().position(|frames| frames[frame] == image.bytes);
        seen.push(found.unwrap_or_else(|| panic!("frame {frame} is none of expose's")));
        if seen.len() == 5 {
            // Both at once: the addresses are neighbours.
            let address = client.address("ExposureTime");
            assert_eq!(client.address("Gain"), address + 8);
            let gain_db = 20.0 * 2f64.log10();
            let data = [10_000f64.to_be_bytes(), gain_db.to_be_bytes()].concat();
            assert_eq!(client.write(address, &data), 0);
        }
    }
    assert!(seen.is_sorted() && seen[..5] == [0; 5], "{seen:?}");
    assert_eq!(seen.iter().filter(|s| **s == 1).count(), 1, "{seen:?}");
}

#[test]
fn packets_that_are_lost_are_repeated_and_no_frame_is() {
    let folder = tempfile::tempdir().unwrap();
    // At a rate that a machine keeps which runs other tests at once: lost packets are meant.
    let server = serve(folder.path(), "--scene ramp --exposure 2ms --fps 25 --collapse");
    for extended in [false, true] {
        let mut client = Client::new(&server);
        client.take_control();
        client.set(0xD04, 576);
        client.set(0x960, u32::from(extended) << 30);
        client.extended = extended;
        client.set_float("FaultPacketLoss", 3.0);
        client.set_feature("AcquisitionStart", 1);
        let images: Vec<Image> = (0..60).map(|_| client.image()).collect();
        let blocks: BTreeSet<u64> = images.iter().map(|image| image.block).collect();
        let span = blocks.last().unwrap() - blocks.first().unwrap();
        assert_eq!((blocks.len(), span), (60, 59), "{blocks:?}");
        let bytes = (SIZE.0 * SIZE.1 * 2) as usize;
        assert!(images.iter().all(|image| image.bytes.len() == bytes));
        assert!(client.repeated > 5, "{} of some 840 packets", client.repeated);
        client.set(0xA00, 0);
    }
}

#[test]
fn one_application_controls_until_it_is_silent() {
    let folder = tempfile::tempdir().unwrap();
    let server = serve(folder.path(), "--scene ramp --fps 50 --collapse");
    let [mut one, mut other] = [(); 2].map(|()| Client::new(&server));
    one.take_control();
    assert_eq!(other.write(0xA00, &[0, 0, 0, 2]), DENIED);
    let exposure = other.address("ExposureTime");
    assert_eq!(other.write(exposure, &5000f64.to_be_bytes()), DENIED);
    assert_eq!(other.read(0xA00, 4), [0, 0, 0, 2], "others read");
    one.set_feature("AcquisitionStart", 1);
    one.set(0x938, 500);
    one.image();
    while one.image_within(QUIET).is_some() {}
    assert_eq!(one.read(one.address("AcquisitionStart"), 4), [0; 4]);
    other.take_control();
    other.set_feature("AcquisitionStart", 1);
    other.image();
    assert_eq!(one.write(0xD00, &[0; 4]), DENIED);
}

#[test]
fn a_software_trigger_gives_one_frame_and_faults_act_on_it() {
    let folder = tempfile::tempdir().unwrap();
    let server = serve(folder.path(), "--scene colorchecker --exposure 5ms");
    light(folder.path());
    let mut client = Client::new(&server);
    client.take_control();
    client.set_feature("TriggerMode", 1);
    client.set_feature("Width", 32);
    client.set_feature("OffsetX", 8);
    client.set_feature("Height", 20);
    client.set_feature("AcquisitionStart", 1);
    assert!(client.image_within(QUIET).is_none(), "none without a trigger");
    // A triggered sensor stands by between frames: settings act at once.
    client.set_float("ExposureTime", 10_000.0);
    client.set_feature("TriggerSoftware", 1);
    let image = client.image();
    let entry = client.xml.split("EnumEntry Name=\"").nth(1).unwrap();
    let format = entry.split('"').next().unwrap();
    let options = "--exposure 10ms --roi 8,0,32,20";
    assert_eq!(image.block, 1);
    assert!(image.bytes == exposed(folder.path(), format, options, 1)[0]);
    // Dropped in the sensor: its number is not used.
    client.set_feature("FaultNextFrame", 1);
    client.set_feature("TriggerSoftware", 1);
    assert!(client.image_within(QUIET).is_none());
    client.set_feature("TriggerSoftware", 1);
    assert_eq!(client.image().block, 3);
}

/// Frames of the schedule are what its log says, in the stream as in `rig stream`.
#[test]
fn faults_by_schedule_are_in_the_stream_and_in_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let table = "1: drop\n2: row 3 corrupt\n3-4: freeze\n";
    std::fs::write(folder.path().join("faults.txt"), table).unwrap();
    let faults = "--faults faults.txt --fault-log served.jsonl";
    let options = format!("--scene colorchecker --exposure 5ms --fps 20 {faults}");
    let server = serve(folder.path(), &options);
    light(folder.path());
    let mut client = Client::new(&server);
    client.take_control();
    client.set_feature("AcquisitionStart", 1);
    let entry = client.xml.split("EnumEntry Name=\"").nth(1).unwrap();
    let format = entry.split('"').next().unwrap().to_string();
    let expected = exposed(folder.path(), &format, "--exposure 5ms", 6);
    let row_bytes = SIZE.0 as usize * 2;
    for frame in [0, 2, 3, 4, 5] {
        let Image { block, bytes } = client.image();
        assert_eq!(block, frame as u64 + 1);
        let wrong = |bytes: &[u8], of: &[u8]| {
            let rows = bytes.chunks(row_bytes).zip(of.chunks(row_bytes)).enumerate();
            rows.filter(|(_, (a, b))| a != b).map(|(row, _)| row).collect::<Vec<_>>()
        };
        match frame {
            0 | 5 => assert!(bytes == expected[frame], "frame {frame}"),
            _ => assert_eq!(wrong(&bytes, &expected[2]), [3], "frame {frame}"),
        }
    }
    drop(server);
    let log = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    let lines = log("served.jsonl");
    let lines: Vec<&str> = lines.lines().take(6).collect();
    let said = ["[]", "[\"drop\"]", "[\"row 3 corrupt\"]", "[\"freeze\"]", "[\"freeze\"]", "[]"];
    for (frame, (line, said)) in lines.iter().zip(said).enumerate() {
        let dropped = said.contains("drop");
        let expected = format!("{{\"dropped\":{dropped},\"faults\":{said},\"frame\":{frame}}}");
        assert_eq!(*line, expected);
    }
    let arguments = "rig stream emulator: --camera c.toml --irradiance a.irr --exposure 5ms \
                     --frames 6 --faults faults.txt --fault-log streamed.jsonl -o x.csi2";
    camrig_ok(folder.path(), arguments);
    assert_eq!(log("streamed.jsonl").lines().collect::<Vec<_>>(), lines);
}

/// The write before frame 2 is lost; that before frame 4 acts after the sensor's two frames.
#[test]
fn writes_to_stuck_registers_are_lost() {
    let folder = tempfile::tempdir().unwrap();
    let write = |frame, exposure_s| {
        format!("[[write]]\nbefore_frame = {frame}\nexposure_s = {exposure_s}\n")
    };
    let script = [write(0, 0.01), write(2, 0.005), write(4, 0.007)].concat();
    let script = format!("format = \"rig-script/1\"\n{script}");
    std::fs::write(folder.path().join("loop.toml"), script).unwrap();
    std::fs::write(folder.path().join("faults.txt"), "2: stuck registers").unwrap();
    std::fs::write(folder.path().join("c.toml"), small_camera(SIZE.0, SIZE.1, &[])).unwrap();
    let arguments = "rig stream emulator: --camera c.toml --scene ramp --script loop.toml \
                     --frames 7 --faults faults.txt --json";
    let output = camrig_ok(folder.path(), arguments);
    let figures: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let settings = figures["settings"].as_array().unwrap();
    let exposures = settings.iter().map(|s| (1e3 * s["exposure_s"].as_f64().unwrap()).round());
    assert_eq!(exposures.collect::<Vec<_>>(), [10.0, 10.0, 10.0, 10.0, 10.0, 7.0, 7.0]);
}

#[test]
fn what_is_no_camera_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let said = |arguments: &str| {
        let output = super::camrig(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert!(said("rig serve --gige").contains("--camera C --scene S"));
    assert!(said("rig serve --tcp 127.0.0.1:0 --camera mobile --scene ramp").contains("--gige"));
    let open = said("rig serve --gige 0.0.0.0 --camera mobile --scene ramp");
    assert!(open.contains("--allow-remote"), "{open}");
    let elsewhere = said("rig serve --gige 192.0.2.1 --allow-remote --camera mobile --scene ramp");
    assert!(elsewhere.contains("address of this machine"), "{elsewhere}");
}
