//! Each end against a peer that is wrong: what it must not believe, and when it gives up.

#[allow(dead_code, reason = "the link with faults is for other tests")]
mod common;

use camrig_rig_link::framing::Framing;
use camrig_rig_link::host::{Event, Host, Limits, Poll};
use camrig_rig_link::message::*;
use camrig_rig_link::registers::address;
use camrig_rig_link::wire::*;
use common::*;

const SESSION: u16 = 0x4321;

fn packet(header: Header, body: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0; HEADER_BYTES + body.len() + CHECK_BYTES];
    bytes[HEADER_BYTES..][..body.len()].copy_from_slice(body);
    seal(&mut bytes, header, body.len());
    bytes
}

fn postcard(message: &impl serde::Serialize) -> Vec<u8> {
    let mut buffer = [0; CONTROL_BYTES];
    postcard::to_slice(message, &mut buffer).unwrap().to_vec()
}

/// What a host makes of a HelloReply.
fn connects(reply: &[u8]) -> Option<Event> {
    let frame = Frame { frame: 0, camera: Vec::new(), raw: Vec::new() };
    let (mut host, mut io) = (Host::new(Limits::default(), [0; 16]), frame);
    host.connect(SESSION);
    let mut out = [0; 2000];
    assert!(matches!(host.poll(0, &mut io, &mut out), Poll::Send(_)));
    let header = Header { kind: Kind::Hello, flags: 0, session: SESSION, seq: 1, ack: 1 };
    host.receive(1, &packet(header, reply), &mut io)
}

#[test]
fn a_hello_that_cannot_be_used_is_told_at_once() {
    let reply = |change: &dyn Fn(&mut HelloReply, &mut Capabilities)| {
        let mut device = Capabilities { packet_bytes: 600, credit: 8, ..Capabilities::default() };
        let mut reply = HelloReply { version: 1, oldest: 1, newest: 1, device: None };
        change(&mut reply, &mut device);
        reply.device = Some(device);
        connects(&postcard(&reply))
    };
    assert_eq!(reply(&|_, _| {}), Some(Event::Connected));
    assert_eq!(reply(&|_, device| device.packet_bytes = 0), Some(Event::UnusableHello));
    assert_eq!(reply(&|_, device| device.credit = 0), Some(Event::UnusableHello));
    assert_eq!(reply(&|reply, _| reply.version = 2), Some(Event::UnusableHello));
    // Without capabilities, though there is a version of both.
    let without = |version, oldest, newest| {
        connects(&postcard(&HelloReply { version, oldest, newest, device: None }))
    };
    assert_eq!(without(1, 1, 1), Some(Event::UnusableHello));
    assert_eq!(without(0, 1, 1), Some(Event::UnusableHello));
    let (oldest, newest) = (VERSIONS.1 + 1, VERSIONS.1 + 2);
    assert_eq!(without(0, oldest, newest), Some(Event::NoCommonVersion { oldest, newest }));
    // A text that is not UTF-8, and one beyond its 40 bytes.
    assert_eq!(connects(&[1, 1, 1, 1, 1, 0xff]), Some(Event::UnusableHello));
    let long = [&[1, 1, 1, 1, 50][..], &[b'x'; 60]].concat();
    assert_eq!(connects(&long), Some(Event::UnusableHello));
}

/// A device whose host is this test.
struct Rig {
    device: Box<ToyDevice>,
    toy: Toy,
    seq: u16,
    /// What is acknowledged to the device.
    ack: u16,
}

impl Rig {
    fn new(packet_bytes: u16, credit: u16) -> Self {
        let (device, toy) = (Box::new(ToyDevice::new(600, 32)), Toy::default());
        let mut rig = Self { device, toy, seq: 0, ack: 0 };
        let hello = Hello { magic: MAGIC, oldest: 1, newest: 1, packet_bytes, credit };
        assert_eq!(rig.send(Kind::Hello, &postcard(&hello)).len(), 1);
        rig
    }

    fn header(&mut self, kind: Kind) -> Header {
        self.seq += 1;
        Header { kind, flags: 0, session: SESSION, seq: self.seq, ack: self.ack }
    }

    /// Sends a packet; kinds and bodies of the answers.
    fn send(&mut self, kind: Kind, body: &[u8]) -> Vec<(Kind, Vec<u8>)> {
        let header = self.header(kind);
        self.send_as(header, body)
    }

    fn send_as(&mut self, header: Header, body: &[u8]) -> Vec<(Kind, Vec<u8>)> {
        self.device.receive(&packet(header, body), &mut self.toy);
        let (mut out, mut answers) = ([0; 2000], Vec::new());
        while let Some(n) = self.device.transmit(&mut out, &mut self.toy) {
            let answer = Packet::parse(&out[..n]).unwrap();
            answers.push((answer.header.kind, answer.body.to_vec()));
        }
        answers
    }

    /// Sends a packet of a kind that nobody knows; the `ack` of the answer.
    fn send_unknown(&mut self) -> u16 {
        let header = self.header(Kind::Ping);
        let mut bytes = packet(header, &[]);
        bytes[0] = 99;
        let end = bytes.len() - CHECK_BYTES;
        let crc = crc32c(&bytes[..end]).to_le_bytes();
        bytes[end..].copy_from_slice(&crc);
        self.device.receive(&bytes, &mut self.toy);
        let mut out = [0; 2000];
        let n = self.device.transmit(&mut out, &mut self.toy).expect("an answer");
        let answer = Packet::parse(&out[..n]).unwrap();
        let said = postcard::from_bytes::<ToHost>(answer.body).unwrap();
        assert_eq!(said, ToHost::Nack(Nack::Unsupported(99)));
        answer.header.ack
    }

    fn control(&mut self, message: ToDevice) -> ToHost {
        let answers = self.send(Kind::Control, &postcard(&message));
        answers.iter().find_map(|(_, body)| postcard::from_bytes(body).ok()).expect("an answer")
    }

    /// Sends a camera in one piece under an identity; the answer.
    fn camera(&mut self, bytes: &[u8], id: u64) -> ToHost {
        let mut body = vec![0; CameraHeader::BYTES];
        CameraHeader { id, total: bytes.len() as u32, offset: 0 }.write(&mut body);
        body.extend(bytes);
        postcard::from_bytes(&self.send(Kind::Camera, &body)[0].1).unwrap()
    }
}

#[test]
fn a_device_takes_no_old_packet_and_none_of_another_session() {
    let mut rig = Rig::new(600, 64);
    let write = |value| postcard(&ToDevice::RegWrite(address::TEST_DATA, value));
    rig.control(ToDevice::RegWrite(address::TEST_DATA, 111));
    let stale = rig.device.statistics().stale;
    let newest = rig.header(Kind::Control);
    rig.seq -= 1; // not used
    for header in [
        Header { seq: rig.seq, ..newest },
        Header { seq: rig.seq - 1, ..newest },
        Header { session: SESSION + 1, ..newest },
    ] {
        assert!(rig.send_as(header, &write(222)).is_empty(), "{header:?}");
    }
    let value = rig.control(ToDevice::RegRead(address::TEST_DATA));
    assert_eq!(value, ToHost::Register(address::TEST_DATA, 111));
    assert_eq!(rig.device.statistics().stale, stale + 2);
}

#[test]
fn a_device_takes_no_camera_whose_bytes_are_not_those_of_its_identity() {
    let mut rig = Rig::new(600, 64);
    let bytes: Vec<u8> = (0..100).collect();
    let id = camera_id(&bytes);
    let refused = ToHost::Nack(Nack::Refused(Refusal::BadCamera));
    assert_eq!(rig.camera(&bytes, id ^ 1), refused);
    assert_eq!(rig.control(ToDevice::FrameBegin(begin(0))), {
        ToHost::Nack(Nack::Refused(Refusal::NoCamera))
    });
    assert_eq!(rig.camera(&bytes, id), ToHost::Camera { id, received: 100, ready: true });
}

#[test]
fn a_device_sends_no_more_than_its_credit() {
    // Each raw row of 80 bytes takes several packets.
    const CREDIT: u16 = 7;
    let mut rig = Rig::new(60, CREDIT);
    let bytes = [1, 2, 3];
    rig.camera(&bytes, camera_id(&bytes));
    rig.control(ToDevice::FrameBegin(FrameBegin { transfer: 9, ..begin(0) }));
    // The packets sent so far: Hello, camera, frame start.
    rig.ack = 3;
    let mut raw = 0;
    for row in 0..5 {
        let mut body = vec![0; PartHeader::BYTES];
        PartHeader { transfer: 9, row, unit: 0 }.write(&mut body);
        body.extend(spectral_row(0, row));
        let answers = rig.send(Kind::Part, &body);
        raw += answers.iter().filter(|(kind, _)| *kind == Kind::Raw).count();
    }
    assert_eq!(raw, usize::from(CREDIT));
    // What is acknowledged makes room for as much.
    rig.ack += 4;
    let answers = rig.send(Kind::Ack, &[]);
    assert_eq!(answers.iter().filter(|(kind, _)| *kind == Kind::Raw).count(), 4);
}

/// A raw row that may not leave for want of credit keeps its place: spectral rows beyond it wait.
#[test]
fn a_device_takes_no_row_that_it_has_no_room_for() {
    let mut rig = Rig::new(600, 2);
    let bytes = [1, 2, 3];
    rig.camera(&bytes, camera_id(&bytes));
    rig.control(ToDevice::FrameBegin(FrameBegin { transfer: 9, ..begin(0) }));
    for row in 0..8 {
        let mut body = vec![0; PartHeader::BYTES];
        PartHeader { transfer: 9, row, unit: 0 }.write(&mut body);
        body.extend(spectral_row(0, row));
        rig.send(Kind::Part, &body);
    }
    let answers = rig.send(Kind::Ping, &[]);
    let (kind, body) = answers.last().unwrap();
    assert_eq!(*kind, Kind::Ack);
    // Of raw row 0 rows 0 and 1 are needed, and no raw row has left since nothing was acknowledged.
    let (cursor, _) = AckBody::split(body).unwrap();
    assert_eq!((cursor.row, cursor.unit), (2, 0));
}

#[test]
fn bytes_of_registers_are_read_and_written_over_the_link() {
    let mut rig = Rig::new(600, 64);
    let exposure = address::COARSE_INTEGRATION_TIME;
    rig.control(ToDevice::RegWrite(exposure, 0x01f4));
    assert_eq!(rig.control(ToDevice::ByteRead(exposure)), ToHost::Register(exposure, 0x01));
    let low = ToDevice::ByteWrite(exposure + 1, 0x2c);
    assert_eq!(rig.control(low), ToHost::Register(exposure + 1, 0x2c));
    let high = ToDevice::ByteWrite(exposure, 0x02);
    assert_eq!(rig.control(high), ToHost::Register(exposure, 0x02));
    assert_eq!(rig.control(ToDevice::RegRead(exposure)), ToHost::Register(exposure, 0x022c));
    let none = ToDevice::ByteRead(0x7777);
    assert_eq!(rig.control(none), ToHost::Nack(Nack::Register(0x7777)));
}

/// A host whose device is this test.
struct Guest {
    host: ToyHost,
    io: Frame,
    seq: u16,
    now: u64,
}

impl Guest {
    fn new(limits: Limits, credit: u16) -> Self {
        let (camera, raw) = (vec![1, 2, 3], vec![vec![0; RAW_BYTES]; ROWS.into()]);
        let io = Frame { frame: 0, camera, raw };
        let mut guest = Self { host: Host::new(limits, [0; ROWS as usize]), io, seq: 0, now: 1 };
        guest.host.connect(SESSION);
        let hello = guest.sent();
        let device = Capabilities { packet_bytes: 600, credit, ..Default::default() };
        let reply = HelloReply { version: 1, oldest: 1, newest: 1, device: Some(device) };
        let ack = hello[0].seq;
        let event = guest.answer(Kind::Hello, ack, &postcard(&reply));
        assert_eq!(event, Some(Event::Connected));
        guest
    }

    /// How the device begins a frame.
    fn start(transfer: u16) -> FrameStart {
        FrameStart {
            transfer,
            shape: SHAPE,
            exposure: Exposure { exposure_s: 0.01, analog_gain: 1.0 },
            counter: 1,
            frame: 0,
            seed: 1,
            test_pattern: 0,
            fault: Fault::None,
        }
    }

    /// Announces a frame and lets it begin.
    fn begin(&mut self) -> FrameStart {
        self.host.begin(begin(0), SHAPE, false);
        let announced = self.next().expect("an announcement").seq;
        let start = Self::start(1);
        let begun = postcard(&ToHost::FrameStart(start));
        assert_eq!(self.answer(Kind::Control, announced, &begun), None);
        start
    }

    /// The next packet that the host sends at this time.
    fn next(&mut self) -> Option<Header> {
        let mut out = [0; 2000];
        match self.host.poll(self.now, &mut self.io, &mut out) {
            Poll::Send(n) => Some(Packet::parse(&out[..n]).unwrap().header),
            _ => None,
        }
    }

    /// All packets that the host sends at this time.
    fn sent(&mut self) -> Vec<Header> {
        std::iter::from_fn(|| self.next()).collect()
    }

    fn answer(&mut self, kind: Kind, ack: u16, body: &[u8]) -> Option<Event> {
        self.seq += 1;
        let header = Header { kind, flags: 0, session: SESSION, seq: self.seq, ack };
        self.host.receive(self.now, &packet(header, body), &mut self.io)
    }

    fn raw(&mut self, row: u16, crc: u32, ack: u16) -> Option<Event> {
        let mut body = vec![0; RawHeader::BYTES];
        RawHeader { transfer: 1, row, offset: 0, row_crc: crc }.write(&mut body);
        body.extend([0; RAW_BYTES]);
        self.answer(Kind::Raw, ack, &body)
    }
}

#[test]
fn a_host_keeps_no_row_whose_crc_is_anothers() {
    let mut guest = Guest::new(Limits::default(), 64);
    let start = guest.begin();
    let newest = guest.sent().last().unwrap().seq;
    let right = crc32c(&[0; RAW_BYTES]);
    for row in 0..ROWS {
        assert_eq!(guest.raw(row, right ^ u32::from(row == 3), newest), None);
    }
    assert_eq!(guest.host.missing(ROWS).collect::<Vec<_>>(), [3]);
    assert_eq!(guest.host.statistics().torn_rows, 1);
    assert_eq!(guest.raw(3, right, newest), Some(Event::FrameDone(start)));
}

#[test]
fn a_host_takes_no_old_packet() {
    let mut guest = Guest::new(Limits::default(), 64);
    guest.begin();
    let newest = guest.sent().last().unwrap().seq;
    let right = crc32c(&[0; RAW_BYTES]);
    assert_eq!(guest.raw(0, right, newest), None);
    let seq = guest.seq;
    for old in [seq, seq - 1] {
        guest.seq = old - 1;
        assert_eq!(guest.raw(1, right, newest), None);
        assert_eq!(guest.host.missing(ROWS).next(), Some(1), "packet {old} after {seq}");
    }
    guest.seq = seq;
    guest.raw(1, right, newest);
    assert_eq!(guest.host.missing(ROWS).next(), Some(2));
}

/// Rows of an earlier attempt at a frame stay only if the device began it as this time.
#[test]
fn a_host_keeps_rows_of_an_attempt_that_began_alike_alone() {
    let exposure = Exposure { exposure_s: 0.02, analog_gain: 1.0 };
    let alike = Guest::start(2);
    for start in [
        alike,
        FrameStart { fault: Fault::CorruptRow(0), ..alike },
        FrameStart { test_pattern: 1, ..alike },
        FrameStart { seed: 2, ..alike },
        FrameStart { exposure, ..alike },
    ] {
        let mut guest = Guest::new(Limits::default(), 64);
        guest.begin();
        let newest = guest.sent().last().unwrap().seq;
        guest.raw(0, crc32c(&[0; RAW_BYTES]), newest);
        guest.host.begin(begin(0), SHAPE, true);
        assert_eq!(guest.host.missing(ROWS).next(), Some(1));
        let announced = guest.next().expect("an announcement").seq;
        guest.answer(Kind::Control, announced, &postcard(&ToHost::FrameStart(start)));
        let first_missing = u16::from(start == alike);
        assert_eq!(guest.host.missing(ROWS).next(), Some(first_missing), "{start:?}");
    }
}

#[test]
fn a_host_sends_no_more_than_its_credit() {
    for credit in [1, 3, 8] {
        let mut limits = Limits::default();
        limits.send_bytes = 60;
        let mut guest = Guest::new(limits, credit);
        guest.begin();
        let parts = |sent: &[Header]| sent.iter().filter(|h| h.kind == Kind::Part).count();
        let sent = guest.sent();
        assert_eq!(parts(&sent), usize::from(credit));
        // An acknowledgement of them all makes room for as many.
        let newest = sent.last().unwrap().seq;
        let mut cursor = [0; AckBody::BYTES];
        AckBody { transfer: 1, row: 0, unit: credit.min(UNITS as u16 - 1) }.write(&mut cursor);
        guest.answer(Kind::Ack, newest, &cursor);
        assert!(parts(&guest.sent()) > 0);
    }
}

#[test]
fn a_device_that_talks_and_gets_no_further_is_given_up() {
    let mut limits = Limits::default();
    limits.timeout = 100_000;
    limits.idle_steps = 10;
    // Each of them renews the wait for the next packet; none is of use.
    let mut raw = vec![0; RawHeader::BYTES + RAW_BYTES];
    RawHeader { transfer: 77, row: 0, offset: 0, row_crc: 0 }.write(&mut raw);
    let mut ack = vec![0; AckBody::BYTES];
    AckBody { transfer: 1, row: ROWS, unit: 0 }.write(&mut ack);
    for (kind, body) in [(Kind::Raw, raw), (Kind::Ack, ack), (Kind::Control, vec![1])] {
        let mut guest = Guest::new(limits, 64);
        guest.begin();
        let began = guest.now;
        let mut out = [0; 2000];
        let mut newest = 0;
        let event = loop {
            match guest.host.poll(guest.now, &mut guest.io, &mut out) {
                Poll::Done(event) => break event,
                Poll::Send(n) => newest = Packet::parse(&out[..n]).unwrap().header.seq,
                Poll::Wait(_) => {
                    guest.now += 10_000;
                    guest.answer(kind, newest, &body);
                }
            }
            assert!(guest.now - began <= limits.patience() + 100_000, "{kind:?}: no end");
        };
        assert!(matches!(event, Event::NoAnswer | Event::NoProgress), "{kind:?}: {event:?}");
    }
}

#[test]
fn a_camera_that_comes_and_goes_is_given_up() {
    let mut limits = Limits::default();
    limits.timeout = 100_000;
    limits.idle_steps = 10;
    let mut guest = Guest::new(limits, 64);
    guest.io.camera = vec![0; 1000];
    guest.host.send_camera(5, 1000);
    let mut out = [0; 2000];
    let mut there = 0;
    for _ in 0..10_000 {
        match guest.host.poll(guest.now, &mut guest.io, &mut out) {
            Poll::Done(event) => {
                assert!(matches!(event, Event::NoAnswer | Event::NoProgress));
                return;
            }
            Poll::Send(n) => {
                let ack = Packet::parse(&out[..n]).unwrap().header.seq;
                there = if there == 0 { 1 } else { 0 };
                let has = ToHost::Camera { id: 5, received: there, ready: false };
                guest.answer(Kind::Control, ack, &postcard(&has));
            }
            Poll::Wait(_) => guest.now += 10_000,
        }
    }
    panic!("no end");
}

/// Hello reports which camera a device has; sending a camera replaces it.
#[test]
fn a_host_knows_which_camera_the_device_has_now() {
    let mut bench = Bench::new(Framing::Cobs, Limits::default(), 1);
    assert_eq!(bench.connect(), Event::Connected);
    for first in [1, 2, 1] {
        bench.io.camera = vec![first; 300];
        assert_eq!(bench.send_camera(), Event::CameraReady);
        let id = camera_id(&bench.io.camera);
        assert_eq!(bench.host.device().map(|d| d.camera), Some(id));
    }
}

/// A fault shows in one announcement only. Rows of the attempt that had it must not stay among
/// those of an attempt that has none.
#[test]
fn rows_of_two_attempts_are_not_mixed_where_a_fault_came_between() {
    for packets in 3..40 {
        let mut bench = Bench::new(Framing::Cobs, Limits::default(), 1);
        assert_eq!(bench.connect(), Event::Connected);
        assert_eq!(bench.send_camera(), Event::CameraReady);
        for (address, value) in [(address::FAULT_ARGUMENT, 0), (address::FAULT, 2)] {
            bench.host.request(ToDevice::RegWrite(address, value));
            assert!(matches!(bench.run(None), Some(Event::Answer(_))));
        }
        bench.begin(1, false);
        if bench.run(Some(packets)).is_some() {
            continue; // Over before the cable came out.
        }
        bench.disconnect();
        assert_eq!(bench.connect(), Event::Connected);
        let Event::FrameDone(start) = bench.frame(1, true) else { panic!() };
        let told = start.fault == Fault::CorruptRow(0);
        assert_eq!(bench.is_right(), !told, "{packets} packets, {:?}", start.fault);
    }
}

#[test]
fn the_answer_to_an_unknown_kind_acknowledges_its_packet() {
    let mut rig = Rig::new(600, 8);
    assert_eq!(rig.send_unknown(), rig.seq);
}
