//! The device's end: a state machine that answers. It has no clock and never speaks first;
//! noticing lost packets is the host's task.
//!
//! Spectral rows arrive part by part in the order of a [`Cursor`]. A part out of order is dropped
//! and the host is told where to continue (go-back-N). A raw row is computed as soon as the rows
//! that it depends on are there, is sent in pieces as credit allows, and is then discarded: if the
//! host misses one, it sends the spectral rows again ([`crate::wire::JUMP`]).

use crate::message::*;
use crate::registers::Registers;
use crate::wire::*;
use heapless::Deque;

/// Computes raw rows: what a device implements.
///
/// [`Model::units`] is called with the units of a row in order. A row begins only when at most
/// [`Model::rows_ahead`] of the raw rows that can already be computed have not yet been fetched
/// with [`Model::raw_row`]. So a model needs room for `2 * halo + 1 + rows_ahead` spectral rows,
/// used in turn.
pub trait Model {
    /// Number of raw rows that may wait while further spectral rows arrive; 0 for a device that
    /// computes one row at a time.
    fn rows_ahead(&self) -> u16 {
        0
    }

    /// What the model can do. The device itself fills in packet size, credit and the camera's
    /// identity.
    fn capabilities(&self) -> Capabilities;

    /// Takes a piece of a camera: the bytes from `offset` on, in order; offset 0 begins a new one.
    ///
    /// # Errors
    /// Why the device cannot hold it.
    fn camera_piece(&mut self, offset: u32, piece: &[u8]) -> Result<(), Refusal>;

    /// The camera is complete: checks it and puts it in force.
    ///
    /// # Errors
    /// Why the device cannot use it.
    fn camera_end(&mut self) -> Result<(), Refusal>;

    /// Begins a frame. `registers` has the test pattern; exposure and gain are in `exposure`.
    ///
    /// # Errors
    /// Why the device cannot compute the frame.
    fn begin(
        &mut self,
        frame: &FrameBegin,
        exposure: Exposure,
        registers: &Registers,
    ) -> Result<Begun, Refusal>;

    /// Takes complete units of spectral row `row`; `first` is the number of the first unit.
    fn units(&mut self, row: u16, first: u16, units: &[u8]);

    /// Computes raw row `row` and packs it into `out`, which has the frame's `raw_bytes`.
    fn raw_row(&mut self, row: u16, out: &mut [u8]);

    /// Where raw rows go that stay with the device ([`FrameBegin::raw_bits`] 0), if it has a place
    /// for them.
    fn sink(&mut self) -> Option<&mut dyn RowSink> {
        None
    }
}

/// A device's own way out for its raw rows, such as a camera interface (DVP, CSI-2) or an FPGA: a
/// frame with [`FrameBegin::raw_bits`] 0 goes there, and the link has a receipt of
/// [`RECEIPT_BYTES`] for each row instead.
///
/// A row goes out once in each announcement of a frame, in order. Where the link loses a receipt,
/// the row is computed again, to the same bytes, and only the receipt is sent again. A host that
/// has to connect again announces the rows that it still needs, and they begin a new announcement.
pub trait RowSink {
    /// Bits per sample of the rows, which [`crate::packing::Packing::of_bits`] packs.
    fn raw_bits(&self) -> u8;

    /// A frame begins; rows of `row_bytes` bytes follow, or none where `start.fault` drops it. A
    /// device with a clock delays a frame whose `start.fault` asks for that.
    fn begin(&mut self, start: &FrameStart, row_bytes: u16);

    /// The next packed row.
    fn row(&mut self, row: u16, packed: &[u8]);
}

/// What a model answers when it has begun a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Begun {
    /// Sizes on the link.
    pub shape: FrameShape,
    /// The camera's seed.
    pub seed: u64,
}

impl Begun {
    /// A frame of these sizes, with the camera's seed.
    pub const fn new(shape: FrameShape, seed: u64) -> Self {
        Self { shape, seed }
    }
}

/// Answers that may wait to be sent. A host has one operation at a time, so few ever wait; where
/// there is no room an answer is dropped, and the host asks again.
const ANSWERS: usize = 4;
/// The device acknowledges on its own after this fraction of the credit, so that a host never
/// stands still for want of an acknowledgement.
const CREDIT_PER_ACK: u16 = 4;

/// An answer that waits to be sent.
#[derive(Clone, Debug)]
enum Answer {
    Hello,
    Ack,
    Control(ToHost),
}

/// The frame in progress.
#[derive(Clone, Copy, Debug)]
struct Transfer {
    begin: FrameBegin,
    start: FrameStart,
    /// Next part expected.
    cursor: Cursor,
    /// Whether a part has been dropped since the cursor last moved.
    gap: bool,
    /// Next raw row to compute.
    next_out: u16,
    /// Bytes of a packed raw row: those of the link, or of the device's own way out.
    row_bytes: u16,
    /// Rows before this one have gone to the [`RowSink`]; `None` where rows go over the link.
    delivered: Option<u16>,
}

impl Transfer {
    /// The raw rows before this one can be computed.
    fn computable(&self) -> u16 {
        let shape = &self.start.shape;
        if self.cursor.row == shape.rows {
            shape.rows
        } else {
            self.cursor.row.saturating_sub(shape.halo.into())
        }
    }

    /// Number of raw rows that wait to be computed.
    fn waiting(&self) -> u16 {
        self.computable().saturating_sub(self.next_out)
    }

    /// Continues at row `row` instead of at the cursor.
    fn jump(&mut self, row: u16) {
        self.cursor = Cursor { row, unit: 0 };
        self.next_out =
            if row == 0 { 0 } else { row.saturating_add(self.start.shape.halo.into()) };
    }
}

/// The device's end of the link. `RAW`: longest packed raw row, bytes.
///
/// The model is an argument of the functions and not a member, so that during a frame it may
/// borrow what it computes with.
pub struct Device<const RAW: usize> {
    packet_bytes: u16,
    credit: u16,
    versions: (u8, u8),
    registers: Registers,
    statistics: Statistics,
    answers: Deque<Answer, ANSWERS>,

    version: u8,
    session: u16,
    /// Next packet's counter.
    seq: u16,
    /// Newest packet counter received from the host.
    heard: u16,
    /// The `ack` of the last packet sent.
    told: u16,
    /// Newest of this device's packet counters that the host has acknowledged.
    acknowledged: u16,
    host: Option<Hello>,

    /// The camera being received, or in force once `camera_ready`.
    camera_id: u64,
    camera_received: u32,
    /// [`camera_id`] of the bytes received so far.
    camera_hash: u64,
    camera_ready: bool,

    transfer: Option<Transfer>,
    raw: [u8; RAW],
    /// The row in `raw`, its CRC and how much of it has been sent.
    sending: Option<RawHeader>,
}

impl<const RAW: usize> Device<RAW> {
    /// A device that has just been switched on. `packet_bytes`: the longest packet that its
    /// receiver holds, bytes; `credit`: packets that the host may have under way.
    pub const fn new(packet_bytes: u16, credit: u16) -> Self {
        Self {
            packet_bytes,
            credit,
            versions: VERSIONS,
            registers: Registers::new(),
            statistics: Statistics::new(),
            answers: Deque::new(),
            version: 0,
            session: 0,
            seq: 0,
            heard: 0,
            told: 0,
            acknowledged: 0,
            host: None,
            camera_id: 0,
            camera_received: 0,
            camera_hash: NO_CAMERA_BYTES,
            camera_ready: false,
            transfer: None,
            raw: [0; RAW],
            sending: None,
        }
    }

    /// Pretends to speak other versions of the protocol, to test how a host reports an older rig.
    pub fn set_versions(&mut self, oldest: u8, newest: u8) {
        self.versions = (oldest, newest);
    }

    /// Takes one packet, as a [`crate::framing::Receiver`] delivers it.
    pub fn receive(&mut self, bytes: &[u8], model: &mut impl Model) {
        let packet = match Packet::parse(bytes) {
            Ok(packet) => packet,
            Err(Reject::Damaged) => return count(&mut self.statistics.damaged),
            Err(Reject::UnknownKind { kind, session, seq }) => {
                let ours = self.host.is_some() && session == self.session;
                if ours && after(seq, self.heard) {
                    // The answer acknowledges the packet that it is about.
                    self.heard = seq;
                    self.nack(Nack::Unsupported(kind));
                }
                return;
            }
        };
        count(&mut self.statistics.packets);
        if packet.header.kind == Kind::Hello {
            return self.hello(&packet);
        }
        if self.host.is_none() || self.version == 0 || packet.header.session != self.session {
            if self.host.is_none() {
                // Answer in the unknown session, so that its host accepts the answer.
                self.session = packet.header.session;
                self.nack(Nack::NoSession);
            }
            return;
        }
        if !after(packet.header.seq, self.heard) {
            return count(&mut self.statistics.stale);
        }
        self.heard = packet.header.seq;
        if after(packet.header.ack, self.acknowledged) {
            self.acknowledged = packet.header.ack;
        }
        match packet.header.kind {
            Kind::Part => self.part(&packet, model),
            Kind::Control => match postcard::from_bytes(packet.body) {
                Ok(message) => self.control(message, model),
                Err(_) => self.nack(Nack::Unsupported(Kind::Control as u8)),
            },
            Kind::Camera => self.camera(packet.body, model),
            Kind::Ping => self.answer(Answer::Ack),
            Kind::Ack => {}
            Kind::Hello | Kind::Raw => {
                self.nack(Nack::Unsupported(packet.header.kind as u8));
            }
        }
    }

    /// Writes the next packet to send into `out` and returns its length in bytes; `None` if there
    /// is nothing to send now. `out` must hold [`CONTROL_BYTES`], header and CRC; raw rows use as
    /// much of it as the host's limit allows.
    pub fn transmit(&mut self, out: &mut [u8], model: &mut impl Model) -> Option<usize> {
        if let Some(answer) = self.answers.pop_front() {
            return Some(self.send_answer(&answer, out, model));
        }
        if self.heard.wrapping_sub(self.told) >= (self.credit / CREDIT_PER_ACK).max(1) {
            return Some(self.send_answer(&Answer::Ack, out, model));
        }
        if self.seq.wrapping_sub(self.acknowledged) > self.host?.credit {
            return None;
        }
        if self.sending.is_none() {
            self.compute_row(model);
        }
        self.send_raw(out)
    }

    /// Whether [`Device::transmit`] must be called before the next packet is given to
    /// [`Device::receive`]. Otherwise packets that have already arrived may be taken first, so
    /// that answers are sent together.
    pub fn is_pressed(&self, model: &impl Model) -> bool {
        let rows = self.transfer.as_ref().map_or(0, Transfer::waiting);
        !self.answers.is_empty() || rows > model.rows_ahead()
    }

    /// Counters since power-on.
    pub fn statistics(&self) -> Statistics {
        self.statistics
    }

    fn hello(&mut self, packet: &Packet<'_>) {
        let Ok(hello) = postcard::from_bytes::<Hello>(packet.body) else { return };
        if hello.magic != MAGIC {
            return;
        }
        let again = self.host == Some(hello) && self.session == packet.header.session;
        if !again {
            self.session = packet.header.session;
            self.host = Some(hello);
            (self.seq, self.acknowledged) = (1, 0);
            (self.heard, self.told) = (packet.header.seq, packet.header.seq);
            self.transfer = None;
            self.sending = None;
            self.answers.clear();
            let newest = hello.newest.min(self.versions.1);
            let common = newest >= hello.oldest.max(self.versions.0);
            self.version = if common { newest } else { 0 };
        } else if after(packet.header.seq, self.heard) {
            self.heard = packet.header.seq;
        }
        self.answer(Answer::Hello);
    }

    fn control(&mut self, message: ToDevice, model: &mut impl Model) {
        let answer = match message {
            ToDevice::FrameBegin(begin) => match self.begin(begin, model) {
                Ok(start) => ToHost::FrameStart(start),
                Err(refusal) => ToHost::Nack(Nack::Refused(refusal)),
            },
            ToDevice::Abort => {
                self.transfer = None;
                self.sending = None;
                ToHost::Aborted
            }
            ToDevice::RegRead(address) => register(address, self.registers.read(address)),
            ToDevice::RegWrite(address, value) => {
                let taken = self.registers.write(address, value);
                register(address, taken.then_some(value))
            }
            ToDevice::ByteRead(address) => {
                register(address, self.registers.read_byte(address).map(u32::from))
            }
            ToDevice::ByteWrite(address, byte) => {
                let taken = self.registers.write_byte(address, byte);
                register(address, taken.then_some(byte.into()))
            }
            ToDevice::Statistics => ToHost::Statistics(self.statistics),
        };
        self.answer(Answer::Control(answer));
    }

    fn begin(&mut self, begin: FrameBegin, model: &mut impl Model) -> Result<FrameStart, Refusal> {
        if let Some(t) = &self.transfer
            && t.begin == begin
        {
            return Ok(t.start); // The host did not receive the answer.
        }
        self.transfer = None;
        self.sending = None;
        if !self.camera_ready {
            return Err(Refusal::NoCamera);
        }
        let exposure = begin.exposure.unwrap_or_else(|| self.registers.exposure());
        let stays = begin.raw_bits == 0;
        let mut asked = begin;
        if stays {
            asked.raw_bits = model.sink().ok_or(Refusal::Packing)?.raw_bits();
        }
        let Begun { mut shape, seed } = model.begin(&asked, exposure, &self.registers)?;
        if !shape.is_sound() || usize::from(shape.raw_bytes) > RAW || RECEIPT_BYTES > RAW {
            return Err(Refusal::WrongShape);
        }
        let row_bytes = shape.raw_bytes;
        if stays {
            shape.raw_bytes = RECEIPT_BYTES as u16;
        }
        let mut fault = self.registers.next_frame();
        if begin.exposure.is_none() && !self.registers.streaming {
            fault = Fault::DropFrame;
        }
        let start = FrameStart {
            transfer: begin.transfer,
            shape,
            exposure,
            counter: self.registers.frame_count,
            frame: begin.frame,
            seed,
            test_pattern: self.registers.test_pattern,
            fault,
        };
        count(&mut self.statistics.frames);
        if let Some(sink) = model.sink().filter(|_| stays) {
            sink.begin(&start, row_bytes);
        }
        self.transfer = Some(Transfer {
            begin,
            start,
            cursor: Cursor::default(),
            gap: false,
            next_out: 0,
            row_bytes,
            delivered: stays.then_some(0),
        });
        Ok(start)
    }

    fn part(&mut self, packet: &Packet<'_>, model: &mut impl Model) {
        let Some((head, units)) = PartHeader::split(packet.body) else { return };
        let Some(t) = self.transfer.as_mut().filter(|t| t.begin.transfer == head.transfer) else {
            return self.nack(Nack::NoTransfer(head.transfer));
        };
        let shape = t.start.shape;
        let (count_bytes, unit_bytes) = (units.len(), usize::from(shape.unit_bytes));
        let end = usize::from(head.unit) + count_bytes / unit_bytes;
        let sound = count_bytes > 0
            && count_bytes.is_multiple_of(unit_bytes)
            && end <= usize::from(shape.units)
            && head.row < shape.rows;
        let room = t.waiting() <= model.rows_ahead();
        let begins = head.unit == 0;
        let here = Cursor { row: head.row, unit: head.unit };
        let jumps = packet.header.flags & JUMP != 0 && here != t.cursor;
        if sound && begins && jumps && t.waiting() == 0 {
            t.jump(head.row);
        }
        if !sound || here != t.cursor || (begins && !room) {
            if !t.gap {
                t.gap = true;
                count(&mut self.statistics.gaps);
                self.answer(Answer::Ack);
            }
            return;
        }
        t.gap = false;
        t.cursor.unit = end as u16; // end <= units, a u16
        if t.cursor.unit == shape.units {
            t.cursor = Cursor { row: head.row + 1, unit: 0 };
            count(&mut self.statistics.rows_in);
        }
        model.units(head.row, head.unit, units);
    }

    fn camera(&mut self, body: &[u8], model: &mut impl Model) {
        let Some((head, piece)) = CameraHeader::split(body) else { return };
        if head.id != self.camera_id || (head.offset == 0 && !self.camera_ready) {
            self.camera_id = head.id;
            self.camera_received = 0;
            self.camera_hash = NO_CAMERA_BYTES;
            self.camera_ready = false;
            self.transfer = None;
            self.sending = None;
        }
        let end = u64::from(head.offset) + piece.len() as u64;
        let next = !self.camera_ready && head.offset == self.camera_received;
        if next
            && end <= u64::from(head.total)
            && let Err(refusal) = self.camera_piece(head, piece, model)
        {
            self.camera_received = 0;
            return self.nack(Nack::Refused(refusal));
        }
        self.answer(Answer::Control(ToHost::Camera {
            id: self.camera_id,
            received: self.camera_received,
            ready: self.camera_ready,
        }));
    }

    fn camera_piece(
        &mut self,
        head: CameraHeader,
        piece: &[u8],
        model: &mut impl Model,
    ) -> Result<(), Refusal> {
        model.camera_piece(head.offset, piece)?;
        self.camera_hash = continue_camera_id(self.camera_hash, piece);
        self.camera_received += piece.len() as u32;
        if self.camera_received == head.total {
            if self.camera_hash != head.id {
                return Err(Refusal::BadCamera);
            }
            model.camera_end()?;
            self.camera_ready = true;
        }
        Ok(())
    }

    fn nack(&mut self, nack: Nack) {
        self.answer(Answer::Control(ToHost::Nack(nack)));
    }

    /// Queues an answer. When there is no room it is dropped: the host will ask again.
    fn answer(&mut self, answer: Answer) {
        let _ = self.answers.push_back(answer);
    }

    fn send_answer(&mut self, answer: &Answer, out: &mut [u8], model: &impl Model) -> usize {
        let body = &mut out[HEADER_BYTES..];
        let (kind, flags, written) = match answer {
            Answer::Hello => {
                let device = (self.version > 0).then(|| Capabilities {
                    packet_bytes: self.packet_bytes,
                    credit: self.credit,
                    camera: if self.camera_ready { self.camera_id } else { 0 },
                    ..model.capabilities()
                });
                let (oldest, newest) = self.versions;
                let reply = HelloReply { version: self.version, oldest, newest, device };
                (Kind::Hello, 0, postcard::to_slice(&reply, body).map(|b| b.len()))
            }
            Answer::Ack => {
                let (mut transfer, mut cursor, mut flags) = (0, Cursor::default(), 0);
                if let Some(t) = &self.transfer {
                    (transfer, cursor) = (t.begin.transfer, t.cursor);
                    let pending = self.sending.is_some() || t.waiting() > 0;
                    flags = if t.gap { GAP } else { 0 } | if pending { PENDING } else { 0 };
                }
                AckBody { transfer, row: cursor.row, unit: cursor.unit }.write(body);
                (Kind::Ack, flags, Ok(AckBody::BYTES))
            }
            Answer::Control(message) => {
                (Kind::Control, 0, postcard::to_slice(message, body).map(|b| b.len()))
            }
        };
        // `transmit` asks for CONTROL_BYTES of room, and every message fits those (tested there).
        debug_assert!(written.is_ok());
        self.seal(out, kind, flags, written.unwrap_or(0))
    }

    /// Computes the next raw row that can be computed, if any.
    fn compute_row(&mut self, model: &mut impl Model) {
        let Some(t) = &mut self.transfer else { return };
        if t.start.fault == Fault::DropFrame {
            t.next_out = t.computable();
        }
        if t.waiting() == 0 {
            return;
        }
        let row = t.next_out;
        t.next_out += 1;
        let mut raw = &mut self.raw[..usize::from(t.row_bytes)];
        model.raw_row(row, raw);
        if t.start.fault == Fault::CorruptRow(row) {
            raw.iter_mut().for_each(|byte| *byte = !*byte);
        }
        count(&mut self.statistics.rows_out);
        if let Some(delivered) = &mut t.delivered {
            if row >= *delivered
                && let Some(sink) = model.sink()
            {
                sink.row(row, raw);
                *delivered = row + 1;
            }
            let receipt = crc32c(raw).to_le_bytes();
            raw = &mut self.raw[..RECEIPT_BYTES];
            raw.copy_from_slice(&receipt);
        }
        let row_crc = crc32c(raw);
        self.sending = Some(RawHeader { transfer: t.begin.transfer, row, offset: 0, row_crc });
    }

    fn send_raw(&mut self, out: &mut [u8]) -> Option<usize> {
        let (head, t) = (self.sending.as_mut()?, self.transfer.as_ref()?);
        let limit = out.len().min(self.host?.packet_bytes.into());
        // At least one byte, even for a host whose packets have no room for it.
        let room = limit.saturating_sub(HEADER_BYTES + RawHeader::BYTES + CHECK_BYTES).max(1);
        let rest = &self.raw[usize::from(head.offset)..usize::from(t.start.shape.raw_bytes)];
        let piece = &rest[..room.min(rest.len())];
        let body = &mut out[HEADER_BYTES..];
        head.write(body);
        body[RawHeader::BYTES..][..piece.len()].copy_from_slice(piece);
        head.offset += piece.len() as u16; // at most raw_bytes, a u16
        let bytes = RawHeader::BYTES + piece.len();
        if piece.len() == rest.len() {
            self.sending = None;
        }
        Some(self.seal(out, Kind::Raw, 0, bytes))
    }

    fn seal(&mut self, out: &mut [u8], kind: Kind, flags: u8, body_bytes: usize) -> usize {
        let header = Header { kind, flags, session: self.session, seq: self.seq, ack: self.heard };
        self.seq = self.seq.wrapping_add(1);
        self.told = self.heard;
        seal(out, header, body_bytes)
    }
}

/// The answer about a register: its value, or that there is none or it does not take this.
fn register(address: u16, value: Option<u32>) -> ToHost {
    value.map_or(ToHost::Nack(Nack::Register(address)), |v| ToHost::Register(address, v))
}

fn count(counter: &mut u32) {
    *counter = counter.wrapping_add(1);
}
