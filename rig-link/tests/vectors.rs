//! The vectors of `docs/protocol.md`, which a client in Python reads and writes too
//! (`tests/protocol/client.py`): every message, and an exchange as each end has it. Where a byte
//! changes, `VERSIONS` changes with it.

use camrig_rig_link::device::{Begun, Device, Model};
use camrig_rig_link::framing::{Framing, Receiver, Sender};
use camrig_rig_link::host::{Event, FrameIo, Host, Limits, Poll};
use camrig_rig_link::message::*;
use camrig_rig_link::packing::{Packing, pack_row};
use camrig_rig_link::registers::{MODEL_ID, Registers};
use camrig_rig_link::wire::*;
use serde_json::Value;

const WIDTH: usize = 32;
const UNIT: usize = 33;
const RAW_BYTES: usize = Packing::Raw10.row_bytes(WIDTH);
const SHAPE: FrameShape = FrameShape {
    rows: 2,
    units: 2,
    unit_bytes: UNIT as u16,
    raw_bytes: RAW_BYTES as u16,
    halo: 0,
};

fn vectors() -> Value {
    serde_json::from_str(include_str!("../../tests/protocol/vectors.json")).unwrap()
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap()
}

fn bytes(value: &Value) -> Vec<u8> {
    let digits = text(value);
    (0..digits.len())
        .step_by(2)
        .map(|i| u8::from_str_radix(&digits[i..i + 2], 16).unwrap())
        .collect()
}

/// A list of the vectors that must not be empty.
fn entries(vectors: &Value, name: &str) -> Vec<Value> {
    let entries = vectors[name].as_array().unwrap().clone();
    assert!(!entries.is_empty(), "{name}");
    entries
}

fn is_from_host(entry: &Value) -> bool {
    text(&entry["from"]) == "host"
}

#[test]
fn checksums_and_framing_are_those_of_the_vectors() {
    let vectors = vectors();
    for entry in entries(&vectors, "crc32c") {
        let crc = u32::from_str_radix(text(&entry["crc"]), 16).unwrap();
        assert_eq!(crc32c(&bytes(&entry["bytes"])), crc, "{entry}");
    }
    for entry in entries(&vectors, "camera_id") {
        let id = u64::from_str_radix(text(&entry["id"]), 16).unwrap();
        assert_eq!(camera_id(&bytes(&entry["bytes"])), id, "{entry}");
    }
    for entry in entries(&vectors, "varint") {
        let number = entry["number"].as_u64().unwrap();
        let mut buffer = [0; 10];
        assert_eq!(postcard::to_slice(&number, &mut buffer).unwrap(), bytes(&entry["bytes"]));
    }
    for entry in entries(&vectors, "cobs") {
        let (packet, link) = (bytes(&entry["packet"]), bytes(&entry["link"]));
        let mut sent = Vec::new();
        let mut write = |bytes: &[u8]| {
            sent.extend_from_slice(bytes);
            Ok::<(), ()>(())
        };
        let mut sender = Sender::new(Framing::Cobs, [0; 600]);
        sender.push(&packet, &mut write).unwrap();
        sender.flush(&mut write).unwrap();
        let mut receiver = Receiver::new(Framing::Cobs, [0; 600]);
        for link in [&sent, &link] {
            assert!(receiver.push(&mut &link[..]).unwrap(), "{entry}");
            assert_eq!(receiver.packet(), packet, "{entry}");
        }
    }
}

/// The set of effects with these numbers.
fn set(numbers: &[Value]) -> EffectSet {
    numbers.iter().map(|number| number.as_u64().unwrap() as u8).collect()
}

/// A message of the vectors as serde writes it: variants of one field without the field's name.
fn as_serde(value: &Value) -> Value {
    const NAMED: [&str; 9] = [
        "FrameBegin",
        "LitFor",
        "FrameStart",
        "Statistics",
        "Camera",
        "CameraTooLong",
        "TooWide",
        "TooManyBands",
        "Captures",
    ];
    let object = |fields: &serde_json::Map<String, Value>| {
        fields.iter().map(|(key, value)| (key.clone(), as_serde(value))).collect()
    };
    match value {
        Value::Array(numbers) if numbers.iter().all(Value::is_u64) => {
            serde_json::to_value(set(numbers)).unwrap()
        }
        Value::Array(variant) => {
            let (name, fields) = (text(&variant[0]), variant[1].as_object().unwrap());
            let fields = match fields.len() {
                _ if NAMED.contains(&name) => Value::Object(object(fields)),
                1 => as_serde(fields.values().next().unwrap()),
                _ => fields.values().map(as_serde).collect(),
            };
            Value::Object([(name.to_string(), fields)].into_iter().collect())
        }
        Value::Object(fields) => Value::Object(object(fields)),
        // Numbers with a point are single precision in every message.
        Value::Number(n) if n.is_f64() => Value::from(n.as_f64().unwrap() as f32),
        other => other.clone(),
    }
}

/// Reads a postcard body, compares its fields, and writes it again.
fn message<T: serde::de::DeserializeOwned + serde::Serialize>(
    entry: &Value,
    body: &[u8],
) -> Vec<u8> {
    let read: T = postcard::from_bytes(body).unwrap();
    let mut found = serde_json::to_value(&read).unwrap();
    let mut expected = as_serde(&entry["body"]);
    if expected["magic"].is_string() {
        assert_eq!(found["magic"], serde_json::json!(MAGIC));
        (found["magic"], expected["magic"]) = (Value::Null, Value::Null);
    }
    assert_eq!(found, expected, "{}", entry["says"]);
    let mut buffer = [0; CONTROL_BYTES];
    postcard::to_slice(&read, &mut buffer).unwrap().to_vec()
}

/// The same for fixed fields, with what follows them.
macro_rules! fixed {
    ($type:ident, $entry:ident, $body:ident, $($field:ident),*) => {{
        let (head, rest) = $type::split($body).unwrap();
        let fields = &$entry["body"];
        $(assert_eq!(Some(u64::from(head.$field)), fields[stringify!($field)].as_u64());)*
        let behind = ["bytes", "units"].iter().find_map(|key| fields.get(key));
        assert_eq!(rest, behind.map(bytes).unwrap_or_default());
        let mut again = vec![0; $type::BYTES];
        head.write(&mut again);
        again.extend(rest);
        again
    }};
}

#[test]
fn every_message_is_read_and_written_as_in_the_vectors() {
    let vectors = vectors();
    for entry in entries(&vectors, "messages").iter().chain(&entries(&vectors, "exchange")) {
        let sent = bytes(&entry["packet"]);
        let Packet { header, body } = Packet::parse(&sent).unwrap();
        let number = |key: &str| entry[key].as_u64().unwrap();
        assert_eq!(format!("{:?}", header.kind), text(&entry["kind"]), "{entry}");
        let fields = [header.flags.into(), header.session, header.seq, header.ack];
        let expected = ["flags", "session", "seq", "ack"].map(number);
        assert_eq!(fields.map(u64::from), expected, "{entry}");
        let again = match (header.kind, is_from_host(entry)) {
            (Kind::Hello, true) => message::<Hello>(entry, body),
            (Kind::Hello, false) => message::<HelloReply>(entry, body),
            (Kind::Control, true) => message::<ToDevice>(entry, body),
            (Kind::Control, false) => message::<ToHost>(entry, body),
            (Kind::Camera, _) => fixed!(CameraHeader, entry, body, id, total, offset),
            (Kind::Part, _) => fixed!(PartHeader, entry, body, transfer, row, unit),
            (Kind::Raw, _) => {
                fixed!(RawHeader, entry, body, transfer, row, offset, row_crc)
            }
            (Kind::Ack, false) => fixed!(AckBody, entry, body, transfer, row, unit),
            (Kind::Ack, true) | (Kind::Ping, _) => Vec::new(),
            (kind, _) => panic!("{kind:?} in the vectors"),
        };
        let mut packet = vec![0; sent.len()];
        packet[HEADER_BYTES..][..again.len()].copy_from_slice(&again);
        let n = seal(&mut packet, header, again.len());
        assert_eq!(packet[..n], sent, "{}", entry["says"]);
    }
}

/// The sensor of the exchange: 2e6 e⁻/s per W m⁻² nm⁻¹, 10 e⁻ per DN, black at 41 DN, no noise.
#[derive(Default)]
struct Sensor {
    exposure_s: f32,
    units: Vec<u8>,
}

impl Model for Sensor {
    fn capabilities(&self) -> Capabilities {
        Capabilities {
            firmware: "vectors 1.0".try_into().unwrap(),
            max_width: 64,
            max_bands: 8,
            max_camera: 1000,
            arithmetics: 1,
            codecs: 3,
            memory_bytes: 2048,
            ..Default::default()
        }
    }

    fn camera_piece(&mut self, _: u32, _: &[u8]) -> Result<(), Refusal> {
        Ok(())
    }

    fn camera_end(&mut self) -> Result<(), Refusal> {
        Ok(())
    }

    fn begin(
        &mut self,
        frame: &FrameBegin,
        exposure: Exposure,
        _: &Registers,
    ) -> Result<Begun, Refusal> {
        assert_eq!((frame.rows, frame.width, frame.bands), (2, WIDTH as u16, 1));
        self.exposure_s = exposure.exposure_s;
        Ok(Begun::new(SHAPE, 9))
    }

    fn units(&mut self, _: u16, first: u16, units: &[u8]) {
        assert_eq!(first, 0);
        self.units = units.to_vec();
    }

    fn raw_row(&mut self, _: u16, out: &mut [u8]) {
        let dn = self.units.chunks(UNIT).flat_map(|unit| {
            let scale = f32::from(unit[0] as i8).exp2() * 2e6 * self.exposure_s / 10.0;
            let words = unit[1..].chunks(2).map(|b| u16::from_le_bytes([b[0], b[1]]));
            words.map(move |m| (41.0 + f32::from(m) * scale).round() as u16)
        });
        pack_row(Packing::Raw10, &dn.collect::<Vec<_>>(), out).unwrap();
    }
}

#[test]
fn a_device_answers_the_exchange_to_the_byte() {
    let exchange = entries(&vectors(), "exchange");
    let (mut device, mut sensor) = (Device::<64>::new(600, 32), Sensor::default());
    let mut out = [0; 600];
    for entry in &exchange {
        if is_from_host(entry) {
            assert_eq!(device.transmit(&mut out, &mut sensor), None, "{}", entry["says"]);
            device.receive(&bytes(&entry["packet"]), &mut sensor);
        } else {
            let n = device.transmit(&mut out, &mut sensor).expect("an answer");
            assert_eq!(out[..n], bytes(&entry["packet"]), "{}", entry["says"]);
        }
    }
}

/// What the host of the exchange sends, and where its raw rows go.
struct Rows {
    units: Vec<u8>,
    camera: Vec<u8>,
    raw: [[u8; RAW_BYTES]; 2],
}

impl FrameIo for Rows {
    fn spectral(&mut self, _: u16, first: u16, out: &mut [u8]) {
        out.copy_from_slice(&self.units[usize::from(first) * UNIT..][..out.len()]);
    }

    fn raw_row(&mut self, row: u16) -> &mut [u8] {
        &mut self.raw[usize::from(row)]
    }

    fn camera(&mut self, offset: u32, out: &mut [u8]) {
        out.copy_from_slice(&self.camera[offset as usize..][..out.len()]);
    }
}

#[test]
fn a_host_sends_the_exchange_to_the_byte() {
    let vectors = vectors();
    let exchange = entries(&vectors, "exchange");
    let body_of = |says: &str| {
        let entry = exchange.iter().find(|e| text(&e["says"]) == says).unwrap();
        entry["body"].clone()
    };
    let mut io = Rows {
        units: bytes(&body_of("spectral row 0")["units"]),
        camera: bytes(&vectors["camera"]["bytes"]),
        raw: [[0; RAW_BYTES]; 2],
    };
    let mut limits = Limits::default();
    limits.packet_bytes = 4400;
    limits.credit = 64;
    let mut host = Host::new(limits, [0; 2]);
    let mut rest = exchange.iter().peekable();
    let mut out = [0; 4400];
    // Runs an operation to its end; what it sends is what comes next in the exchange.
    let mut run = |host: &mut Host<[u16; 2]>, io: &mut Rows| loop {
        let Poll::Send(n) = host.poll(1, io, &mut out) else { panic!("nothing to send") };
        let asked = rest.next().expect("more than the exchange has");
        assert_eq!(out[..n], bytes(&asked["packet"]), "{}", asked["says"]);
        while let Some(answer) = rest.next_if(|entry| !is_from_host(entry)) {
            if let Some(event) = host.receive(1, &bytes(&answer["packet"]), io) {
                return event;
            }
        }
    };
    host.connect(0x5a17);
    assert_eq!(run(&mut host, &mut io), Event::Connected);
    let requests = [
        (ToDevice::RegRead(0), Ok((0, MODEL_ID.into()))),
        (ToDevice::RegWrite(0x202, 800), Ok((0x202, 800))),
        (ToDevice::ByteRead(0x203), Ok((0x203, 0x20))),
        (ToDevice::RegRead(0x7777), Err(0x7777)),
    ];
    for (request, answer) in requests {
        host.request(request);
        let expected = match answer {
            Ok((address, value)) => Event::Answer(ToHost::Register(address, value)),
            Err(address) => Event::Refused(Nack::Register(address)),
        };
        assert_eq!(run(&mut host, &mut io), expected);
    }
    host.send_camera(camera_id(&io.camera), io.camera.len() as u32);
    assert_eq!(run(&mut host, &mut io), Event::CameraReady);
    let begin = FrameBegin {
        transfer: 0,
        frame: 5,
        rows: 2,
        width: WIDTH as u16,
        bands: 1,
        codec: Codec::Bfp16,
        arithmetic: NumberFormat::F32,
        raw_bits: 10,
        temperature_c: 25.0,
        before: Before::Dark,
        exposure: Some(Exposure { exposure_s: 0.008, analog_gain: 1.0 }),
    };
    host.begin(begin, SHAPE, false);
    let Event::FrameDone(start) = run(&mut host, &mut io) else { panic!("no frame") };
    assert_eq!((start.frame, start.counter, start.seed), (5, 1, 9));
    assert!(rest.next().is_none(), "the exchange goes on");
    // 141, 241, 341 and 441 DN.
    let row: Vec<u8> = [35, 60, 85, 110, 0x55].repeat(8);
    assert!(io.raw.iter().all(|raw| raw[..] == row));
}
