use super::*;
use crate::protocol::HEADER_BYTES;
use camrig_profiles::{Profile, Sensor};

const ADDRESS: u16 = 0x10;
const LAST: u8 = MESSAGE | 2;
const FIRST: u8 = MESSAGE | 1;
const READ: u16 = 1;
const EPIPE: u32 = -32i32 as u32;

fn bus(profile: &str) -> Mutex<Sensor> {
    Mutex::new(Sensor::new(Profile::builtin(profile).unwrap()))
}

/// An URB as Linux sends it.
fn header(kind: u8, request: u8, value: u16, index: u16, length: u16) -> [u8; HEADER_BYTES] {
    let is_in = u32::from(kind >> 7);
    let words = [1, 7, 0x1_0003, is_in, 0, 0, length.into(), 0, u32::MAX, 0];
    let mut header = [0; HEADER_BYTES];
    header[..40].copy_from_slice(words.map(u32::to_be_bytes).as_flattened());
    (header[40], header[41]) = (kind, request);
    for (at, half) in [(42, value), (44, index), (46, length)] {
        header[at..at + 2].copy_from_slice(&half.to_le_bytes());
    }
    header
}

/// Status of the transfer, its length, and data.
fn transfer(adapter: &mut Adapter<'_, Sensor>, header: &[u8; HEADER_BYTES], data: &[u8]) -> Urb {
    let request = Request::parse(header).unwrap();
    assert_eq!(request.body_bytes(), data.len());
    let answer = adapter.receive(&request, data);
    let word = |at: usize| u32::from_be_bytes(answer[at..at + 4].try_into().unwrap());
    assert_eq!((word(0), word(4)), (3, 7));
    Urb { status: word(20), length: word(24), data: answer[HEADER_BYTES..].to_vec() }
}

#[derive(Debug, PartialEq)]
struct Urb {
    status: u32,
    length: u32,
    data: Vec<u8>,
}

fn read(adapter: &mut Adapter<'_, Sensor>, request: u8, index: u16, length: u16) -> Vec<u8> {
    let urb = transfer(adapter, &header(FROM_DEVICE, request, READ, index, length), &[]);
    assert_eq!((urb.status, urb.length), (0, urb.data.len() as u32));
    urb.data
}

fn write(adapter: &mut Adapter<'_, Sensor>, request: u8, index: u16, data: &[u8]) {
    let setup = header(TO_DEVICE, request, 0, index, data.len() as u16);
    let urb = transfer(adapter, &setup, data);
    assert_eq!(urb, Urb { status: 0, length: data.len() as u32, data: vec![] });
}

fn status(adapter: &mut Adapter<'_, Sensor>) -> u8 {
    read(adapter, GET_STATUS, 0, 1)[0]
}

/// What Linux' i2c-tiny-usb asks, and the register reads of its I2C and SMBus clients.
#[test]
fn registers_are_read_and_written() {
    let bus = bus("imx219");
    let mut adapter = Adapter::new(&bus, "1");
    let device = transfer(&mut adapter, &header(0x80, 6, 0x0100, 0, 18), &[]).data;
    assert_eq!(device[8..12], [0x03, 0x04, 0x31, 0xC6]);
    let all = transfer(&mut adapter, &header(0x80, 6, 0x0200, 0, 255), &[]).data;
    assert_eq!((all.len(), all[2], all[9 + 4]), (18, 18, 0), "no endpoints");
    assert_eq!(read(&mut adapter, GET_FUNCTIONS, 0, 4), 0x0EFF_0001u32.to_le_bytes());
    write(&mut adapter, SET_DELAY, 0, &[]);
    assert_eq!(status(&mut adapter), IDLE);
    // A write and a read with a repeated start between them.
    write(&mut adapter, FIRST, ADDRESS, &[0, 0]);
    assert_eq!(status(&mut adapter), ACKNOWLEDGED);
    assert_eq!(read(&mut adapter, LAST, ADDRESS, 2), [0x02, 0x19]);
    // Each in a transfer of its own, as Linux' ov7670 does.
    write(&mut adapter, FIRST | LAST, ADDRESS, &[0x01, 0x5A, 0x03, 0xE8]);
    write(&mut adapter, FIRST | LAST, ADDRESS, &[0x01, 0x5A]);
    assert_eq!(read(&mut adapter, FIRST | LAST, ADDRESS, 2), [0x03, 0xE8]);
    assert_eq!(bus.lock().unwrap().register(0x015B), 0xE8);
    // i2cdetect writes nothing.
    write(&mut adapter, FIRST | LAST, ADDRESS, &[]);
    assert_eq!(status(&mut adapter), ACKNOWLEDGED);
}

#[test]
fn what_no_sensor_takes_is_not_acknowledged() {
    let bus = bus("imx219");
    let mut adapter = Adapter::new(&bus, "1");
    for address in [0x11, 0x110, 0xFF10] {
        write(&mut adapter, FIRST | LAST, address, &[0x01, 0x57, 9]);
        assert_eq!(status(&mut adapter), NOT_ACKNOWLEDGED, "{address:#x}");
        write(&mut adapter, FIRST | LAST, ADDRESS, &[]);
        assert_eq!(read(&mut adapter, FIRST | LAST, address, 3), [0; 3]);
        assert_eq!(status(&mut adapter), NOT_ACKNOWLEDGED, "{address:#x}");
    }
    assert_eq!(bus.lock().unwrap().register(0x0157), 0);
    bus.lock().unwrap().refuse(1);
    for expected in [NOT_ACKNOWLEDGED, ACKNOWLEDGED] {
        write(&mut adapter, FIRST | LAST, ADDRESS, &[0x01, 0x57, 9]);
        assert_eq!(status(&mut adapter), expected);
    }
    // Requests that there are not, and endpoints.
    for (kind, request) in [(FROM_DEVICE, 8), (TO_DEVICE, 8), (FROM_DEVICE, 0), (0xA1, 1)] {
        let setup = header(kind, request, 0, ADDRESS, 0);
        assert_eq!(transfer(&mut adapter, &setup, &[]).status, EPIPE);
    }
    let mut setup = header(FROM_DEVICE, MESSAGE, READ, ADDRESS, 1);
    setup[19] = 1;
    assert_eq!(transfer(&mut adapter, &setup, &[]).status, EPIPE);
}

#[test]
fn long_messages_go_through_all_registers() {
    let bus = bus("imx219");
    let mut adapter = Adapter::new(&bus, "1");
    let values: Vec<u8> = (0..u16::MAX - 2).map(|i| (i % 251) as u8).collect();
    write(&mut adapter, FIRST | LAST, ADDRESS, &[&[0x10, 0x00], &values[..]].concat());
    write(&mut adapter, FIRST, ADDRESS, &[0x10, 0x00]);
    let found = read(&mut adapter, LAST, ADDRESS, u16::MAX);
    // The address begins again at 0, where there is the identity.
    assert_eq!(
        (found[..0xF000] == values[..0xF000], &found[0xF000..0xF002]),
        (true, &[2, 0x19][..])
    );
    // No more than the host has room for.
    let mut setup = header(FROM_DEVICE, MESSAGE, READ, ADDRESS, 8);
    setup[27] = 3;
    assert_eq!(transfer(&mut adapter, &setup, &[]).length, 3);
    // Less data than announced: what came is written.
    let setup = header(TO_DEVICE, MESSAGE, 0, ADDRESS, 100);
    adapter.receive(&Request::parse(&setup).unwrap(), &[0x01]);
    assert_eq!(status(&mut adapter), ACKNOWLEDGED);
}
