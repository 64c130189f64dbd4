//! The emulator as a USB video camera, seen by a host that knows USB/IP and UVC alone.

use super::gige::{Server, exposed, light, serve_as};
use camrig::usbip::protocol::{ADAPTER_BUS_ID, BUS_ID, HEADER_BYTES};
use std::collections::BTreeSet;
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::time::Duration;

/// Longest wait for an answer.
const PATIENCE: Duration = Duration::from_secs(60);
/// Time in which an answer would have come.
const QUIET: Duration = Duration::from_millis(300);
/// Most bytes of a transfer: an image of these tests and its header fit.
const TRANSFER: u32 = 16_384;
const BUSY: u32 = 2;
const NO_DEVICE: u32 = 4;
const EPIPE: i32 = -32;
const ECONNRESET: i32 = -104;
/// Address of the IMX477 on I2C.
const IMX477: u16 = 0x1A;
/// Interface and unit of controls, as set-up packets name them.
const CAMERA: u16 = 0x0100;
const PROCESSING: u16 = 0x0200;
const STREAMING: u16 = 1;

struct Client {
    link: TcpStream,
    seq: u32,
    /// Transfers to the device, whose answers bring no data.
    outs: BTreeSet<u32>,
}

/// An answer: status and data.
type Answer = (i32, Vec<u8>);

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn ask(server: &Server, code: u16, body: &[u8]) -> (TcpStream, u32) {
    let mut link = TcpStream::connect(&server.address).unwrap();
    link.set_read_timeout(Some(PATIENCE)).unwrap();
    link.write_all(&[&[0x01, 0x11][..], &code.to_be_bytes(), &[0; 4], body].concat()).unwrap();
    let mut header = [0; 8];
    link.read_exact(&mut header).unwrap();
    assert_eq!(header[..4], [0x01, 0x11, 0, code as u8]);
    (link, word(&header, 4))
}

/// Asks for a device; the status instead where it is refused.
fn attach(server: &Server, bus_id: &str) -> Result<Client, u32> {
    let mut name = [0; 32];
    name[..bus_id.len()].copy_from_slice(bus_id.as_bytes());
    let (mut link, status) = ask(server, 0x8003, &name);
    if status != 0 {
        return Err(status);
    }
    let mut device = [0; 0x138];
    link.read_exact(&mut device).unwrap();
    assert_eq!(&device[256..259], bus_id.as_bytes());
    Ok(Client { link, seq: 0, outs: BTreeSet::new() })
}

impl Client {
    /// Writes a message on I2C and returns the status: 1 acknowledged, 2 not.
    fn i2c_write(&mut self, address: u16, message: &[u8]) -> u8 {
        let [low, high] = address.to_le_bytes();
        let setup = [0x41, 7, 0, 0, low, high, message.len() as u8, 0];
        let submitted = self.submit(0, Some(message), message.len() as u32, setup);
        assert_eq!(self.answer_to(submitted).0, 0);
        self.get(0xC1, 3, 0, 0, 1).1[0]
    }

    /// Reads a register of 16 bits in two of 8.
    fn i2c_read(&mut self, address: u16, register: u16) -> u16 {
        assert_eq!(self.i2c_write(address, &register.to_be_bytes()), 1);
        let (status, data) = self.get(0xC1, 7, 1, address, 2);
        assert_eq!(status, 0);
        u16::from_be_bytes(data.try_into().unwrap())
    }

    /// Writes two registers.
    fn set_sensor(&mut self, register: u16, value: u16) {
        let message = [register, value].map(u16::to_be_bytes);
        assert_eq!(self.i2c_write(IMX477, message.as_flattened()), 1);
    }
}

/// The device, once the host that had it is noticed to have gone.
fn attach_again(server: &Server) -> Client {
    for _ in 0..100 {
        match attach(server, BUS_ID) {
            Ok(client) => return client,
            Err(status) => assert_eq!(status, BUSY),
        }
        std::thread::sleep(QUIET / 10);
    }
    panic!("the device stays busy");
}

impl Client {
    /// Sends a transfer and returns its number.
    fn submit(&mut self, endpoint: u32, out: Option<&[u8]>, length: u32, setup: [u8; 8]) -> u32 {
        self.seq += 1;
        let is_in = out.is_none().into();
        let words = [1, self.seq, 0x1_0002, is_in, endpoint, 0, length, 0, u32::MAX, 0];
        let header: Vec<u8> = words.into_iter().flat_map(u32::to_be_bytes).collect();
        let data = out.unwrap_or_default();
        self.link.write_all(&[&header, &setup[..], data].concat()).unwrap();
        if out.is_some() {
            self.outs.insert(self.seq);
        }
        self.seq
    }

    /// The next answer: its code, the number of the transfer, status and data.
    fn answer(&mut self) -> (u32, u32, Answer) {
        let mut header = [0; HEADER_BYTES];
        self.link.read_exact(&mut header).unwrap();
        let [code, seq, status, length] = [0, 4, 20, 24].map(|at| word(&header, at));
        let brings = code == 3 && !self.outs.contains(&seq);
        let mut data = vec![0; if brings { length as usize } else { 0 }];
        self.link.read_exact(&mut data).unwrap();
        (code, seq, (status as i32, data))
    }

    /// The answer to a transfer, which comes next.
    fn answer_to(&mut self, submitted: u32) -> Answer {
        let (code, seq, answer) = self.answer();
        assert_eq!((code, seq), (3, submitted));
        answer
    }

    /// Reads by a control transfer.
    fn get(&mut self, kind: u8, request: u8, value: u16, index: u16, length: u16) -> Answer {
        let [v0, v1] = value.to_le_bytes();
        let [i0, i1] = index.to_le_bytes();
        let [l0, l1] = length.to_le_bytes();
        let setup = [kind, request, v0, v1, i0, i1, l0, l1];
        let submitted = self.submit(0, None, length.into(), setup);
        self.answer_to(submitted)
    }

    /// Sets a control of the video class, and returns the status.
    fn set(&mut self, selector: u8, index: u16, data: &[u8]) -> i32 {
        let [i0, i1] = index.to_le_bytes();
        let setup = [0x21, 1, 0, selector, i0, i1, data.len() as u8, 0];
        let submitted = self.submit(0, Some(data), data.len() as u32, setup);
        self.answer_to(submitted).0
    }

    /// Commits a format and a frame interval, 100 ns; returns the bytes of a payload.
    fn commit(&mut self, format: u8, interval: u32) -> u32 {
        let mut wanted = [0; 26];
        (wanted[2], wanted[3]) = (format, 1);
        wanted[4..8].copy_from_slice(&interval.to_le_bytes());
        assert_eq!(self.set(1, STREAMING, &wanted), 0);
        let (status, offered) = self.get(0xA1, 0x81, 0x0100, STREAMING, 26);
        assert_eq!((status, offered.len(), offered[2]), (0, 26, format));
        assert_eq!(self.set(2, STREAMING, &offered), 0);
        u32::from_le_bytes(offered[22..26].try_into().unwrap())
    }

    /// An image, by one transfer, and the bit that tells it from the one before.
    fn image(&mut self) -> (Vec<u8>, u8) {
        let submitted = self.submit(1, None, TRANSFER, [0; 8]);
        let (status, data) = self.answer_to(submitted);
        assert_eq!((status, data[0], data[1] & 0xFE), (0, 2, 0x82));
        (data[2..].to_vec(), data[1] & 1)
    }

    /// Whether nothing comes.
    fn is_quiet(&mut self) -> bool {
        self.link.set_read_timeout(Some(QUIET)).unwrap();
        let peeked = self.link.peek(&mut [0]);
        self.link.set_read_timeout(Some(PATIENCE)).unwrap();
        let waits = [ErrorKind::WouldBlock, ErrorKind::TimedOut];
        peeked.is_err_and(|e| waits.contains(&e.kind()))
    }
}

fn serve(folder: &Path, options: &str) -> Server {
    serve_as(folder, "usbip", options)
}

/// Exposure acts after two frames and gain after one, the delays of the rig's registers.
#[test]
fn frames_are_those_of_expose_and_controls_act_after_the_sensors_delay() {
    const COUNT: usize = 6;
    let folder = tempfile::tempdir().unwrap();
    let server = serve(folder.path(), "--scene colorchecker --exposure 5ms --fps 50");
    light(folder.path());
    let camera = camrig::camera::Camera::load(folder.path().join("c.toml").to_str().unwrap());
    let cfa = camera.unwrap().sensor.cfa;
    let mut client = attach(&server, BUS_ID).unwrap();
    let (status, device) = client.get(0x80, 6, 0x0100, 0, 18);
    assert_eq!((status, &device[8..12]), (0, &[0x09, 0x12, 0x01, 0x00][..]));
    // Formats in the descriptors: that of 16 bits first, that of 8 bits last.
    let (_, configuration) = client.get(0x80, 6, 0x0200, 0, u16::MAX);
    assert!(configuration.windows(5).any(|bytes| bytes == [27, 0x24, 4, 1, 1]));
    let formats = configuration.windows(3).filter(|bytes| *bytes == [27, 0x24, 4]).count();
    for (format, bits) in [(1, 16), (formats as u8, 8)] {
        assert_eq!(client.set(4, CAMERA, &50u32.to_le_bytes()), 0); // 5 ms
        assert_eq!(client.set(4, PROCESSING, &256u16.to_le_bytes()), 0);
        let bytes = client.commit(format, 200_000);
        assert_eq!(bytes, 64 * 48 * bits / 8 + 2);
        let first = if bits == 16 { 0 } else { COUNT };
        let expected = [("5ms", "1"), ("5ms", "2"), ("10ms", "2")].map(|(exposure, gain)| {
            let options = format!("--exposure {exposure} --gain {gain}");
            exposed(folder.path(), &format!("S{cfa}{bits}"), &options, 2 * COUNT)
        });
        let mut bit = None;
        for frame in 0..COUNT {
            let (image, image_bit) = client.image();
            let settings = [0, 0, 0, 1, 2, 2][frame];
            assert!(image == expected[settings][first + frame], "{bits} bits, frame {frame}");
            assert_ne!(bit.replace(image_bit), Some(image_bit), "images are told apart");
            if frame == 2 {
                assert_eq!(client.set(4, CAMERA, &100u32.to_le_bytes()), 0);
                assert_eq!(client.set(4, PROCESSING, &512u16.to_le_bytes()), 0);
                let (_, exposure) = client.get(0xA1, 0x81, 0x0400, CAMERA, 4);
                let (_, gain) = client.get(0xA1, 0x81, 0x0400, PROCESSING, 2);
                assert_eq!((&exposure[..], &gain[..]), (&[100, 0, 0, 0][..], &[0, 2][..]));
            }
        }
    }
    // Values that no sensor has, and controls that there are not.
    assert_eq!(client.set(4, CAMERA, &[0; 4]), EPIPE);
    assert_eq!(client.set(4, PROCESSING, &[0, 0]), EPIPE);
    assert_eq!(client.set(9, CAMERA, &[1]), EPIPE);
    assert_eq!(client.get(0xA1, 0x81, 0x0900, CAMERA, 4).0, EPIPE);
}

/// Exposure and gain of the IMX477 act after two frames: the rig's own registers have another
/// delay of the gain.
#[test]
fn a_sensors_registers_on_i2c_set_exposure_and_gain_after_its_delays() {
    const COUNT: usize = 9;
    let folder = tempfile::tempdir().unwrap();
    let server = serve(folder.path(), "--scene colorchecker --sensor imx477");
    light(folder.path());
    let camera = camrig::camera::Camera::load(folder.path().join("c.toml").to_str().unwrap());
    let cfa = camera.unwrap().sensor.cfa;
    let mut client = attach(&server, BUS_ID).unwrap();
    let mut bus = attach(&server, ADAPTER_BUS_ID).unwrap();
    assert_eq!(attach(&server, ADAPTER_BUS_ID).err(), Some(BUSY));
    let (mut list, _) = ask(&server, 0x8005, &[]);
    let mut listed = Vec::new();
    list.read_to_end(&mut listed).unwrap();
    assert_eq!((word(&listed, 0), listed.len()), (2, 4 + 2 * 0x138 + 3 * 4));
    // One master: the camera has no controls of its own.
    assert_eq!(client.set(4, CAMERA, &50u32.to_le_bytes()), EPIPE);
    assert_eq!(client.get(0xA1, 0x81, 0x0400, PROCESSING, 2).0, EPIPE);
    assert_eq!((bus.i2c_write(0x36, &[]), bus.i2c_read(IMX477, 0x0016)), (2, 0x0477));
    // The sensor stands by until it is told to stream.
    for (register, value) in [(0x0342, 11_000), (0x0340, 1000), (0x0202, 400), (0x0204, 0)] {
        bus.set_sensor(register, value);
    }
    client.commit(1, 0);
    let first = client.submit(1, None, TRANSFER, [0; 8]);
    assert!(client.is_quiet());
    assert_eq!(bus.i2c_write(IMX477, &[0x01, 0x00, 1]), 1);
    let expected = [(400, "1"), (400, "2"), (800, "2")].map(|(lines, gain)| {
        let options = format!("--exposure {}s --gain {gain}", f64::from(lines) * 11_000.0 / 840e6);
        exposed(folder.path(), &format!("S{cfa}16"), &options, COUNT)
    });
    for frame in 0..COUNT {
        let image = match frame {
            0 => client.answer_to(first).1[2..].to_vec(),
            _ => client.image().0,
        };
        match frame {
            1 => bus.set_sensor(0x0204, 512), // 1024 / (1024 - 512)
            4 => bus.set_sensor(0x0202, 800),
            _ => {}
        }
        let settings = [0, 0, 0, 1, 1, 1, 2, 2, 2][frame];
        assert!(image == expected[settings][frame], "frame {frame}");
    }
}

#[test]
fn a_host_may_stop_leave_and_hang_and_others_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let server = serve(folder.path(), "--scene ramp --fps 100 --collapse");
    // Connections that ask for nothing hold nobody up.
    let _silent = [(); 3].map(|()| TcpStream::connect(&server.address).unwrap());
    let mut client = attach(&server, BUS_ID).unwrap();
    assert_eq!(attach(&server, BUS_ID).err(), Some(BUSY));
    assert_eq!(attach(&server, "1-2").err(), Some(NO_DEVICE));
    let (mut list, status) = ask(&server, 0x8005, &[]);
    let mut listed = Vec::new();
    list.read_to_end(&mut listed).unwrap();
    assert_eq!((status, word(&listed, 0), listed.len()), (0, 1, 4 + 0x138 + 2 * 4));
    // Without a format committed nothing comes; a transfer that is forgotten has no answer.
    let waiting = client.submit(1, None, TRANSFER, [0; 8]);
    assert!(client.is_quiet());
    let unlink = |client: &mut Client, victim: u32| {
        client.seq += 1;
        let mut words = [0; 12];
        (words[0], words[1], words[5]) = (2, client.seq, victim);
        client.link.write_all(words.map(u32::to_be_bytes).as_flattened()).unwrap();
        client.answer()
    };
    assert_eq!(unlink(&mut client, waiting), (4, 2, (ECONNRESET, vec![])));
    assert_eq!(unlink(&mut client, waiting), (4, 3, (0, vec![])), "it is over");
    // Streams, stops by clearing the endpoint, and streams again.
    for _ in 0..2 {
        client.commit(1, 0);
        let (first, bit) = client.image();
        let (second, other) = client.image();
        assert!(first != second && bit != other, "noise differs from frame to frame");
        let cleared = client.submit(0, Some(&[]), 0, [0x02, 1, 0, 0, 0x81, 0, 0, 0]);
        assert_eq!(client.answer_to(cleared).0, 0);
        let waiting = client.submit(1, None, TRANSFER, [0; 8]);
        assert!(client.is_quiet());
        assert_eq!(unlink(&mut client, waiting).2.0, ECONNRESET);
    }
    // It leaves while it streams; the next one begins anew.
    client.commit(1, 0);
    client.image();
    client.submit(1, None, TRANSFER, [0; 8]);
    drop(client);
    let mut client = attach_again(&server);
    client.commit(1, 0);
    client.image();
    // What does not follow the protocol ends the connection.
    client.link.write_all(&[9; HEADER_BYTES]).unwrap();
    assert!(matches!(client.link.read(&mut [0]), Ok(0) | Err(_)));
    attach_again(&server);
}
