//! The host's end: a state machine that sends requests and notices losses. Time is passed in.
//!
//! One operation at a time: [`Host::connect`], [`Host::send_camera`], [`Host::begin`] a frame, or
//! [`Host::request`]. Then call [`Host::poll`] and do what it says, and give every received packet
//! to [`Host::receive`], until one of them returns the [`Event`] that ends the operation. Every
//! operation ends: steps without progress are counted, and after [`Limits::idle_steps`] of them in
//! a row the operation has failed. A device that goes on talking and gets no further is given up
//! after [`Limits::patience`], counted from its last progress.

use crate::message::*;
use crate::wire::*;
use core::fmt;

/// Time in microseconds since any fixed moment.
pub type Micros = u64;

/// The host's data: read and written while it sends a frame or a camera.
pub trait FrameIo {
    /// Fills `out` with the units of spectral row `row` from unit `first` on
    /// (see [`Codec`]; [`FrameShape::unit_bytes`] each).
    fn spectral(&mut self, row: u16, first: u16, out: &mut [u8]);

    /// The buffer of packed raw row `row`, of at least [`FrameShape::raw_bytes`].
    fn raw_row(&mut self, row: u16) -> &mut [u8];

    /// Fills `out` with the camera's bytes from `offset` on.
    fn camera(&mut self, offset: u32, out: &mut [u8]);
}

/// Time limits of the host and the amounts that it handles at once.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Limits {
    /// Longest packet that the host accepts, bytes. Short packets are more likely to pass a bad
    /// link.
    pub packet_bytes: u16,
    /// Packets that the device may have under way. On HID keep it to 16 reports.
    pub credit: u16,
    /// Longest packet that the host sends, even if the device accepts longer ones, bytes.
    pub send_bytes: u16,
    /// Rows that the host may send beyond the one whose raw row it waits for. On a link whose
    /// credit delays the device's answers, rows sent far ahead find no room in the device and must
    /// be sent again.
    pub rows_ahead: u16,
    /// The host asks again after this time without a packet, µs.
    pub timeout: Micros,
    /// Steps without progress after which an operation has failed.
    pub idle_steps: u16,
}

impl Limits {
    /// Longest time without progress, µs, whatever the device says meanwhile: twice the time after
    /// which a silent one is given up.
    pub fn patience(&self) -> Micros {
        2 * self.timeout * (Micros::from(self.idle_steps) + 1)
    }
}

/// Default [`Limits::packet_bytes`]: a raw row of 2048 samples of 16 bits fits into one packet.
const PACKET_BYTES: u16 = 4400;
/// Default [`Limits::credit`]: 280 kB of packets under way at most.
const CREDIT: u16 = 64;
/// Default [`Limits::timeout`], µs: far above the round trips measured on serial lines and pipes,
/// which are below 1 ms.
const TIMEOUT: Micros = 250_000;
/// Default [`Limits::idle_steps`]: with the default time-out 5 s until a silent device is given
/// up.
const IDLE_STEPS: u16 = 20;
/// Shortest piece of a camera that the host sends, bytes.
const MIN_CAMERA_PIECE: usize = 16;
/// A piece of a camera is halved with each step without progress, this often at most.
const MAX_CAMERA_HALVINGS: u16 = 8;

impl Default for Limits {
    fn default() -> Self {
        Self {
            packet_bytes: PACKET_BYTES,
            credit: CREDIT,
            send_bytes: u16::MAX,
            rows_ahead: u16::MAX,
            timeout: TIMEOUT,
            idle_steps: IDLE_STEPS,
        }
    }
}

/// What to do next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Poll {
    /// Send this many bytes of `out`, then poll again.
    Send(usize),
    /// Wait for a packet, at most until this time (µs), then poll again.
    Wait(Micros),
    /// The operation has ended.
    Done(Event),
}

/// How an operation ended.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// A session is open; see [`Host::device`].
    Connected,
    /// The device speaks only other versions of the protocol.
    NoCommonVersion {
        /// Oldest version that it speaks.
        oldest: u8,
        /// Newest version that it speaks.
        newest: u8,
    },
    /// The device answers the Hello with what this host cannot read, or with limits or a version
    /// that no device can have.
    UnusableHello,
    /// The camera is in force.
    CameraReady,
    /// Every raw row has arrived and its CRC is correct.
    FrameDone(FrameStart),
    /// The device dropped this frame, as its fault register asked, or in standby.
    FrameDropped(FrameStart),
    /// The answer to a request.
    Answer(ToHost),
    /// The device refused.
    Refused(Nack),
    /// The device no longer answers. The [`Host::missing`] rows of a frame can be requested in a
    /// new session.
    NoAnswer,
    /// The device answers, but the link loses too much for the operation to advance.
    NoProgress,
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Connected => f.write_str("connected"),
            Self::NoCommonVersion { oldest, newest } => write!(
                f,
                "the device speaks versions {oldest} to {newest} of the protocol, this host {} to \
                 {}: update the {}",
                VERSIONS.0,
                VERSIONS.1,
                if *newest < VERSIONS.0 { "device's firmware" } else { "host" }
            ),
            Self::UnusableHello => f.write_str(
                "the device's answer to the Hello cannot be used: check its HelloReply against \
                 the specification of the protocol",
            ),
            Self::CameraReady => f.write_str("the camera is in force"),
            Self::FrameDone(start) => write!(f, "frame {} is complete", start.frame),
            Self::FrameDropped(start) => {
                write!(f, "the device dropped frame {}, as its registers asked", start.frame)
            }
            Self::Answer(answer) => write!(f, "the device answered {answer:?}"),
            Self::Refused(nack) => nack.fmt(f),
            Self::NoAnswer => {
                f.write_str("no answer from the device: is it switched on, and is this its port?")
            }
            Self::NoProgress => f.write_str(
                "the device answers, but the link loses too much: use shorter packets \
                 (Limits::packet_bytes and send_bytes) or a slower line",
            ),
        }
    }
}

/// Counters of a host since it was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct HostStatistics {
    /// Packets sent.
    pub sent: u64,
    /// Bytes of the packets sent, before framing.
    pub sent_bytes: u64,
    /// Packets received with a correct CRC and of this session.
    pub received: u64,
    /// Bytes of the packets received, without framing.
    pub received_bytes: u64,
    /// Packets dropped because of their CRC.
    pub damaged: u64,
    /// Number of times that the host went back to an earlier part.
    pub rewinds: u64,
    /// Number of times that the host asked again because no packet came.
    pub timeouts: u64,
    /// Raw rows whose pieces did not give the row's CRC.
    pub torn_rows: u64,
}

#[derive(Clone, Copy, Debug)]
enum Operation {
    None,
    Hello,
    /// `furthest`: the most bytes that the device has acknowledged.
    Camera {
        id: u64,
        total: u32,
        received: u32,
        furthest: u32,
        ask: bool,
    },
    Request {
        message: ToDevice,
        ask: bool,
    },
    Frame(Frame),
}

/// The frame in progress.
#[derive(Clone, Copy, Debug)]
struct Frame {
    begin: FrameBegin,
    start: Option<FrameStart>,
    /// Whether the announcement has to be sent (again).
    announce: bool,
    /// Sizes on the link: given by the caller, confirmed by the device's FrameStart.
    shape: FrameShape,
    /// Next part to send; its row is the number of rows at the end of a pass.
    cursor: Cursor,
    /// The part that the device expects if it has received everything.
    expected: Cursor,
    /// Acknowledgements of packets older than this say nothing new about gaps.
    mark: u16,
    /// Whether to send a Ping, as the pass is over or the time has run out.
    ask: bool,
    /// Furthest position that the device has reported in this pass.
    reached: Cursor,
    /// Furthest position that the device has reported in any pass.
    furthest: Cursor,
    /// Number of raw rows that are not yet complete.
    missing: u16,
    /// Number of rows sent whose raw rows have not come back.
    ahead: u16,
    /// Number of raw rows whose pieces did not give the row's CRC.
    torn: u16,
    /// Units per part: halved when parts are lost, doubled after each row.
    part_units: u16,
}

impl Frame {
    /// Goes through the rows from the top again, to send those that are still needed.
    fn start_pass(&mut self) {
        (self.cursor, self.reached) = (Cursor::default(), Cursor::default());
    }
}

/// The host's end of the link. `R` has room for one number per raw row of the largest frame
/// (`Vec<u16>`, `[u16; N]`): how many bytes of that row have arrived.
pub struct Host<R> {
    limits: Limits,
    rows: R,
    operation: Operation,
    device: Option<Capabilities>,
    session: u16,
    transfer: u16,
    seq: u16,
    heard: u16,
    told: u16,
    acknowledged: u16,
    /// The operation's first packet: answers that acknowledge an older one belong to an earlier
    /// operation.
    first: u16,
    deadline: Micros,
    /// Steps without progress in a row.
    idle: u16,
    /// When the operation last got further, and whether it has since the last poll. Going again
    /// where it was before is not getting further.
    progressed: Micros,
    advanced: bool,
    /// How the device began the frame whose raw rows are in `rows`.
    begun: Option<FrameStart>,
    statistics: HostStatistics,
}

/// Marks a raw row as complete in `rows`.
const WHOLE: u16 = u16::MAX;

impl<R: AsRef<[u16]> + AsMut<[u16]>> Host<R> {
    /// A host without a session.
    pub fn new(limits: Limits, rows: R) -> Self {
        Self {
            limits,
            rows,
            operation: Operation::None,
            device: None,
            session: 0,
            transfer: 0,
            seq: 1,
            heard: 0,
            told: 0,
            acknowledged: 0,
            first: 1,
            deadline: 0,
            idle: 0,
            progressed: 0,
            advanced: false,
            begun: None,
            statistics: HostStatistics::default(),
        }
    }

    /// Opens a session. `session` must differ from earlier ones on the same device; a random
    /// number does.
    pub fn connect(&mut self, session: u16) {
        self.session = session;
        (self.seq, self.heard, self.told, self.acknowledged) = (1, 0, 0, 0);
        self.device = None;
        self.start(Operation::Hello);
    }

    /// Sends the camera of [`FrameIo::camera`], unless the device already holds it. `id`: its
    /// [`camera_id`]; `total`: its bytes.
    pub fn send_camera(&mut self, id: u64, total: u32) {
        self.hold_camera(0);
        self.start(Operation::Camera { id, total, received: 0, furthest: 0, ask: true });
    }

    /// Sends a request, any message except [`ToDevice::FrameBegin`], and waits for its answer.
    pub fn request(&mut self, message: ToDevice) {
        self.start(Operation::Request { message, ask: true });
    }

    /// Begins a frame; the host chooses `begin.transfer` itself. `shape`: its sizes, which the
    /// device's model has to confirm. With `resume`, raw rows received in the last attempt at the
    /// same frame are kept, unless the device begins it with another exposure, fault or test
    /// pattern.
    ///
    /// # Panics
    /// If `rows` has less room than the frame has rows.
    pub fn begin(&mut self, begin: FrameBegin, shape: FrameShape, resume: bool) {
        self.transfer = self.transfer.wrapping_add(1);
        let rows = &mut self.rows.as_mut()[..usize::from(shape.rows)];
        if !resume {
            rows.fill(0);
            self.begun = None;
        }
        let missing = rows.iter().filter(|&&r| r != WHOLE).count() as u16;
        self.start(Operation::Frame(Frame {
            begin: FrameBegin { transfer: self.transfer, ..begin },
            start: None,
            announce: true,
            shape,
            cursor: Cursor::default(),
            expected: Cursor::default(),
            mark: self.seq,
            ask: false,
            reached: Cursor::default(),
            furthest: Cursor::default(),
            missing,
            ahead: 0,
            torn: 0,
            part_units: u16::MAX,
        }));
    }

    /// Changes the room for rows, for a larger frame for instance; only between operations.
    pub fn reserve_rows(&mut self, change: impl FnOnce(&mut R)) {
        change(&mut self.rows);
    }

    /// What the device of this session can do.
    pub fn device(&self) -> Option<&Capabilities> {
        self.device.as_ref()
    }

    /// Counters since the host was made.
    pub fn statistics(&self) -> HostStatistics {
        self.statistics
    }

    /// Those of the first `rows` raw rows that are not yet complete.
    pub fn missing(&self, rows: u16) -> impl Iterator<Item = u16> + '_ {
        let state = self.rows.as_ref().iter().take(usize::from(rows));
        (0..rows).zip(state).filter(|(_, state)| **state != WHOLE).map(|(row, _)| row)
    }

    fn start(&mut self, operation: Operation) {
        self.operation = operation;
        self.first = self.seq;
        self.deadline = 0;
        self.idle = 0;
        self.advanced = false;
    }

    /// Records which camera the device has, as it has reported since its Hello.
    fn hold_camera(&mut self, id: u64) {
        if let Some(device) = &mut self.device {
            device.camera = id;
        }
    }

    fn end(&mut self, event: Event) -> Option<Event> {
        self.operation = Operation::None;
        Some(event)
    }

    /// What to do at time `now` (µs). `out` must hold the longest packet of either end.
    pub fn poll(&mut self, now: Micros, io: &mut impl FrameIo, out: &mut [u8]) -> Poll {
        let first = self.deadline == 0;
        let late = !first && now >= self.deadline;
        if first || late {
            self.deadline = now + self.limits.timeout;
        }
        if first || core::mem::take(&mut self.advanced) {
            self.progressed = now;
        }
        if late {
            self.statistics.timeouts += 1;
            self.idle += 1;
        }
        let stuck = now.saturating_sub(self.progressed) > self.limits.patience();
        if stuck || self.idle > self.limits.idle_steps {
            let event = if late { Event::NoAnswer } else { Event::NoProgress };
            self.operation = Operation::None;
            return Poll::Done(event);
        }
        let sent = match self.operation {
            Operation::None => None,
            Operation::Hello => (first || late).then(|| {
                let hello = Hello {
                    magic: MAGIC,
                    oldest: VERSIONS.0,
                    newest: VERSIONS.1,
                    packet_bytes: self.limits.packet_bytes,
                    credit: self.limits.credit,
                };
                self.send_postcard(Kind::Hello, &hello, out)
            }),
            Operation::Request { message, ask } => (ask || late).then(|| {
                self.operation = Operation::Request { message, ask: false };
                self.send_postcard(Kind::Control, &message, out)
            }),
            Operation::Camera { id, total, received, furthest, ask } => (ask || late).then(|| {
                self.operation = Operation::Camera { id, total, received, furthest, ask: false };
                self.send_camera_piece(CameraHeader { id, total, offset: received }, io, out)
            }),
            Operation::Frame(mut frame) => {
                frame.ask |= late;
                let sent = self.poll_frame(&mut frame, io, out);
                self.operation = Operation::Frame(frame);
                sent
            }
        };
        match sent {
            Some(bytes) => Poll::Send(bytes),
            None => Poll::Wait(self.deadline),
        }
    }

    fn poll_frame(
        &mut self,
        frame: &mut Frame,
        io: &mut impl FrameIo,
        out: &mut [u8],
    ) -> Option<usize> {
        if frame.announce || (frame.ask && frame.start.is_none()) {
            frame.announce = false;
            frame.ask = false;
            let message = ToDevice::FrameBegin(frame.begin);
            return Some(self.send_postcard(Kind::Control, &message, out));
        }
        if frame.ask {
            frame.ask = false;
            return Some(self.send(Kind::Ping, 0, 0, out));
        }
        let credit = self.device.as_ref().map_or(1, |d| d.credit);
        let free = self.seq.wrapping_sub(self.acknowledged) <= credit;
        let far = self.limits.rows_ahead.saturating_add(frame.shape.halo.into());
        let near = frame.cursor.unit > 0 || frame.ahead <= far;
        if free && near && frame.cursor.row < frame.shape.rows {
            if frame.cursor.unit == 0 {
                frame.cursor.row = self.next_needed(frame, frame.cursor.row);
            }
            if frame.cursor.row < frame.shape.rows {
                return Some(self.send_part(frame, io, out));
            }
            // The pass is over: ask what is missing.
            return Some(self.send(Kind::Ping, 0, 0, out));
        }
        if self.heard.wrapping_sub(self.told) >= self.limits.credit.div_ceil(2) {
            return Some(self.send(Kind::Ack, 0, 0, out));
        }
        None
    }

    /// The first spectral row from `row` on that a missing raw row depends on.
    fn next_needed(&self, frame: &Frame, row: u16) -> u16 {
        let halo = u16::from(frame.shape.halo);
        let rows = &self.rows.as_ref()[..usize::from(frame.shape.rows)];
        let from = row.saturating_sub(halo);
        (from..frame.shape.rows)
            .find(|&r| rows[usize::from(r)] != WHOLE)
            .map_or(frame.shape.rows, |missing| missing.saturating_sub(halo).max(row))
    }

    fn send_part(&mut self, frame: &mut Frame, io: &mut impl FrameIo, out: &mut [u8]) -> usize {
        let shape = frame.shape;
        let limit = self.device.as_ref().map_or(0, |d| d.packet_bytes);
        let limit = usize::from(limit.min(self.limits.send_bytes)).min(out.len());
        let room = limit.saturating_sub(HEADER_BYTES + PartHeader::BYTES + CHECK_BYTES);
        let fitting = (room / usize::from(shape.unit_bytes)).max(1);
        frame.part_units = frame.part_units.min(fitting.min(usize::from(u16::MAX)) as u16).max(1);
        let at = frame.cursor;
        let count = frame.part_units.min(shape.units - at.unit);
        let bytes = usize::from(count) * usize::from(shape.unit_bytes);
        let body = &mut out[HEADER_BYTES..];
        PartHeader { transfer: frame.begin.transfer, row: at.row, unit: at.unit }.write(body);
        io.spectral(at.row, at.unit, &mut body[PartHeader::BYTES..][..bytes]);
        let flags = if at != frame.expected { JUMP } else { 0 };
        frame.cursor.unit += count;
        if frame.cursor.unit == shape.units {
            frame.cursor = Cursor { row: at.row + 1, unit: 0 };
            frame.ahead = frame.ahead.saturating_add(1);
            frame.part_units = frame.part_units.saturating_mul(2);
        }
        frame.expected = frame.cursor;
        if frame.cursor.row == shape.rows {
            frame.ask = true;
        }
        self.send(Kind::Part, flags, PartHeader::BYTES + bytes, out)
    }

    fn send_camera_piece(
        &mut self,
        head: CameraHeader,
        io: &mut impl FrameIo,
        out: &mut [u8],
    ) -> usize {
        let limit = self.device.as_ref().map_or(0, |d| d.packet_bytes);
        let limit = usize::from(limit.min(self.limits.send_bytes)).min(out.len());
        let room = limit.saturating_sub(HEADER_BYTES + CameraHeader::BYTES + CHECK_BYTES);
        // On a link that loses pieces, send shorter ones.
        let room = (room >> self.idle.min(MAX_CAMERA_HALVINGS)).max(MIN_CAMERA_PIECE);
        let bytes = room.min((head.total - head.offset) as usize);
        let body = &mut out[HEADER_BYTES..];
        head.write(body);
        io.camera(head.offset, &mut body[CameraHeader::BYTES..][..bytes]);
        self.send(Kind::Camera, 0, CameraHeader::BYTES + bytes, out)
    }

    fn send_postcard(
        &mut self,
        kind: Kind,
        message: &impl serde::Serialize,
        out: &mut [u8],
    ) -> usize {
        // `out` holds the longest packet, and control messages are shorter (CONTROL_BYTES).
        let written = postcard::to_slice(message, &mut out[HEADER_BYTES..]).map(|b| b.len());
        debug_assert!(written.is_ok());
        self.send(kind, 0, written.unwrap_or(0), out)
    }

    fn send(&mut self, kind: Kind, flags: u8, body_bytes: usize, out: &mut [u8]) -> usize {
        let header = Header { kind, flags, session: self.session, seq: self.seq, ack: self.heard };
        self.seq = self.seq.wrapping_add(1);
        self.told = self.heard;
        let bytes = seal(out, header, body_bytes);
        self.statistics.sent += 1;
        self.statistics.sent_bytes += bytes as u64;
        bytes
    }

    /// Takes one packet, as a [`crate::framing::Receiver`] delivers it, at time `now` (µs).
    /// Returns an event if it ends the operation.
    pub fn receive(&mut self, now: Micros, bytes: &[u8], io: &mut impl FrameIo) -> Option<Event> {
        let Ok(packet) = Packet::parse(bytes) else {
            self.statistics.damaged += 1;
            return None;
        };
        let header = packet.header;
        if header.session != self.session {
            return None;
        }
        let control = match header.kind {
            Kind::Control => postcard::from_bytes(packet.body).ok(),
            _ => None,
        };
        if control == Some(ToHost::Nack(Nack::NoSession)) {
            // A device that lost the session has lost its counters as well.
            return self.end(Event::Refused(Nack::NoSession));
        }
        if !after(header.seq, self.heard) {
            return None;
        }
        self.heard = header.seq;
        self.statistics.received += 1;
        self.statistics.received_bytes += bytes.len() as u64;
        if after(header.ack, self.acknowledged) {
            self.acknowledged = header.ack;
        }
        if matches!(self.operation, Operation::Frame(_)) {
            self.deadline = now + self.limits.timeout;
        }
        match (header.kind, self.operation) {
            (Kind::Hello, Operation::Hello) => {
                let reply = postcard::from_bytes::<HelloReply>(packet.body);
                let Some(reply) = reply.ok().filter(HelloReply::is_sound) else {
                    return self.end(Event::UnusableHello);
                };
                self.device = reply.device;
                let (oldest, newest) = (reply.oldest, reply.newest);
                self.end(match self.device {
                    Some(_) => Event::Connected,
                    None => Event::NoCommonVersion { oldest, newest },
                })
            }
            (Kind::Control, _) if !after(self.first, header.ack) => {
                self.control(control?, header.ack)
            }
            (Kind::Ack, Operation::Frame(mut frame)) => {
                let (body, _) = AckBody::split(packet.body)?;
                self.frame_ack(&mut frame, body, header);
                self.operation = Operation::Frame(frame);
                None
            }
            (Kind::Raw, Operation::Frame(mut frame)) => {
                let event = self.frame_raw(&mut frame, packet.body, io);
                self.operation = Operation::Frame(frame);
                event.and_then(|event| self.end(event))
            }
            _ => None,
        }
    }

    fn control(&mut self, message: ToHost, heard: u16) -> Option<Event> {
        match (self.operation, message) {
            (Operation::Frame(mut frame), ToHost::Nack(Nack::NoTransfer(transfer))) => {
                if transfer == frame.begin.transfer && !after(frame.mark, heard) {
                    // The announcement was lost: begin again.
                    frame.announce = true;
                    frame.mark = self.seq;
                    (frame.cursor, frame.expected) = (Cursor::default(), Cursor::default());
                    self.idle += 1;
                    self.operation = Operation::Frame(frame);
                }
                None
            }
            (Operation::Frame(mut frame), ToHost::FrameStart(start)) => {
                if start.transfer != frame.begin.transfer {
                    return None;
                }
                if start.shape != frame.shape {
                    return self.end(Event::Refused(Nack::Refused(Refusal::WrongShape)));
                }
                if start.fault == Fault::DropFrame {
                    return self.end(Event::FrameDropped(start));
                }
                if self.begun.is_some_and(|earlier| !same_rows(&earlier, &start)) {
                    self.rows.as_mut()[..usize::from(frame.shape.rows)].fill(0);
                    frame.missing = frame.shape.rows;
                    frame.start_pass();
                }
                self.begun = Some(start);
                frame.start = Some(start);
                self.operation = Operation::Frame(frame);
                (frame.missing == 0).then_some(Event::FrameDone(start)).and_then(|e| self.end(e))
            }
            (
                Operation::Camera { id, total, received, furthest, .. },
                ToHost::Camera { id: got, received: there, ready },
            ) if got == id => {
                if ready {
                    self.hold_camera(id);
                    return self.end(Event::CameraReady);
                }
                if there > furthest && there < total {
                    self.idle = 0;
                    self.advanced = true;
                } else if there < received {
                    self.idle += 1; // The device has lost, or could not use, what it had.
                }
                if there != received && there < total {
                    let furthest = furthest.max(there);
                    self.operation =
                        Operation::Camera { id, total, received: there, furthest, ask: true };
                }
                None
            }
            (Operation::Request { message: asked, .. }, answer) => {
                let fits = match (asked, answer) {
                    (
                        ToDevice::RegRead(a)
                        | ToDevice::RegWrite(a, _)
                        | ToDevice::ByteRead(a)
                        | ToDevice::ByteWrite(a, _),
                        ToHost::Register(b, _) | ToHost::Nack(Nack::Register(b)),
                    ) => a == b,
                    (ToDevice::Statistics, ToHost::Statistics(_))
                    | (ToDevice::Abort, ToHost::Aborted) => true,
                    _ => matches!(answer, ToHost::Nack(Nack::Unsupported(_))),
                };
                fits.then_some(match answer {
                    ToHost::Nack(nack) => Event::Refused(nack),
                    answer => Event::Answer(answer),
                })
                .and_then(|event| self.end(event))
            }
            (Operation::Frame(_) | Operation::Camera { .. }, ToHost::Nack(nack)) => {
                self.end(Event::Refused(nack))
            }
            _ => None,
        }
    }

    fn frame_ack(&mut self, frame: &mut Frame, body: AckBody, header: Header) {
        if body.transfer != frame.begin.transfer || after(frame.mark, header.ack) {
            return;
        }
        let cursor = Cursor { row: body.row, unit: body.unit };
        let end = Cursor { row: frame.shape.rows, unit: 0 };
        if cursor > end || cursor.unit >= frame.shape.units {
            return; // Not a position within the frame.
        }
        if cursor > frame.reached {
            frame.reached = cursor;
            self.idle = 0;
        }
        if cursor > frame.furthest {
            frame.furthest = cursor;
            self.advanced = true;
        }
        let all_heard = header.ack == self.seq.wrapping_sub(1);
        let rows = frame.shape.rows;
        if header.flags & GAP != 0 || (all_heard && cursor != frame.expected) {
            // Go back to the device's position, and continue in smaller parts.
            frame.mark = self.seq;
            frame.ahead = 0;
            (frame.cursor, frame.expected) = (cursor, cursor);
            if cursor.unit == 0 && self.next_needed(frame, cursor.row) == rows {
                frame.start_pass();
            }
            frame.part_units = (frame.part_units / 2).max(1);
            self.statistics.rewinds += 1;
            self.idle += 1;
        } else if all_heard && header.flags & PENDING != 0 {
            // Raw rows wait for credit, which another request grants.
            frame.ask |= frame.cursor.row == rows;
            self.idle += 1;
        } else if all_heard {
            frame.ahead = 0;
            if frame.cursor.row == rows {
                // Everything was received and answered: what is missing was lost on its way to the
                // host.
                frame.mark = self.seq;
                frame.start_pass();
                self.idle += 1;
            }
        }
    }

    fn frame_raw(
        &mut self,
        frame: &mut Frame,
        body: &[u8],
        io: &mut impl FrameIo,
    ) -> Option<Event> {
        let (head, piece) = RawHeader::split(body)?;
        let state = self.rows.as_mut().get_mut(usize::from(head.row))?;
        let end = usize::from(head.offset) + piece.len();
        let raw_bytes = usize::from(frame.shape.raw_bytes);
        if head.transfer != frame.begin.transfer
            || head.row >= frame.shape.rows
            || *state != head.offset
            || end > raw_bytes
        {
            return None; // Of another frame, already there, or out of order.
        }
        let raw = io.raw_row(head.row);
        raw[usize::from(head.offset)..end].copy_from_slice(piece);
        *state = end as u16; // at most raw_bytes, a u16
        self.idle = 0;
        self.advanced = true;
        if end < raw_bytes {
            return None;
        }
        if crc32c(&raw[..raw_bytes]) != head.row_crc {
            *state = 0;
            self.statistics.torn_rows += 1;
            frame.torn += 1;
            return (frame.torn > self.limits.idle_steps).then_some(Event::NoProgress);
        }
        *state = WHOLE;
        frame.ahead = frame.ahead.saturating_sub(1);
        frame.missing -= 1;
        if frame.missing > 0 {
            return None;
        }
        match frame.start {
            Some(start) => Some(Event::FrameDone(start)),
            None => {
                frame.ask = true; // The answer to the announcement was lost: ask for it.
                None
            }
        }
    }
}

/// Whether raw rows of two attempts at a frame belong together.
fn same_rows(a: &FrameStart, b: &FrameStart) -> bool {
    let of = |start: &FrameStart| (start.exposure, start.fault, start.test_pattern, start.seed);
    of(a) == of(b)
}
