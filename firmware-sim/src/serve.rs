//! The rig's main loop: packets in, answers out, over any `embedded_io` link.

use crate::rig::Rig;
use crate::running::{self, AnyRunning};
use camrig_rig_link::device::{Begun, Device, Model, RowSink};
use camrig_rig_link::framing::{Framing, OutOfStep, Receiver, Sender};
use camrig_rig_link::message::*;
use camrig_rig_link::registers::Registers;
use camrig_rig_link::wire::Kind;
use core::fmt;
use core::marker::PhantomData;
use embedded_io::{Read, Write};

/// Buffers of a link.
pub struct Buffers<'m> {
    /// Bytes as they arrive; on HID a whole number of reports.
    pub input: &'m mut [u8],
    /// The packet that is being received: [`Framing::max_encoded`] of the longest one.
    pub packet: &'m mut [u8],
    /// The packet to send.
    pub answer: &'m mut [u8],
    /// Bytes to be written: [`Framing::max_encoded`] of the longest packet, or on HID a whole
    /// number of reports.
    pub framed: &'m mut [u8],
}

/// Why [`serve`] ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ServeError<E> {
    /// The link failed.
    Link(E),
    /// The ends of a loss-free link are out of step ([`OutOfStep`]).
    OutOfStep,
}

impl<E: fmt::Debug> fmt::Display for ServeError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Link(error) => write!(f, "the link failed ({error:?}): open it again"),
            Self::OutOfStep => OutOfStep.fmt(f),
        }
    }
}

impl<E: fmt::Debug> core::error::Error for ServeError<E> {}

struct Port<'m, L> {
    link: &'m mut L,
    receiver: Receiver<&'m mut [u8]>,
    sender: Sender<&'m mut [u8]>,
    input: &'m mut [u8],
    /// Start and end of the unused part of `input`.
    left: (usize, usize),
    /// Start and end of the current packet in `input`; elsewhere it is in the receiver.
    in_place: Option<(usize, usize)>,
    answer: &'m mut [u8],
}

impl<'m, L: Read + Write> Port<'m, L> {
    fn new(link: &'m mut L, framing: Framing, buffers: Buffers<'m>) -> Self {
        let Buffers { input, packet, answer, framed } = buffers;
        Self {
            link,
            receiver: Receiver::new(framing, packet),
            sender: Sender::new(framing, framed),
            input,
            left: (0, 0),
            in_place: None,
            answer,
        }
    }

    /// Whether another packet has arrived.
    fn arrived(&mut self) -> Result<bool, ServeError<L::Error>> {
        let (start, end) = self.left;
        let mut bytes = &self.input[start..end];
        let in_place = self.receiver.whole(&mut bytes).map(<[u8]>::len);
        let whole = in_place.is_some()
            || self.receiver.push(&mut bytes).map_err(|_| ServeError::OutOfStep)?;
        let used = end - bytes.len();
        self.in_place = in_place.map(|length| (used - length, used));
        self.left = (used, end);
        Ok(whole)
    }

    /// The packet that has arrived.
    fn packet(&mut self) -> &[u8] {
        match self.in_place {
            Some((start, end)) => &self.input[start..end],
            None => self.receiver.packet(),
        }
    }

    /// Waits for a packet; false when the link is closed.
    fn wait(&mut self) -> Result<bool, ServeError<L::Error>> {
        while !self.arrived()? {
            let read = self.link.read(self.input).map_err(ServeError::Link)?;
            if read == 0 {
                return Ok(false);
            }
            self.left = (0, read);
        }
        Ok(true)
    }

    /// Sends everything that the device has to send; the last bytes stay in the buffer until the
    /// next flush.
    fn send<const RAW: usize>(
        &mut self,
        device: &mut Device<RAW>,
        model: &mut impl Model,
    ) -> Result<(), ServeError<L::Error>> {
        while let Some(bytes) = device.transmit(self.answer, model) {
            let write = |bytes: &[u8]| self.link.write_all(bytes);
            self.sender.push(&self.answer[..bytes], write).map_err(ServeError::Link)?;
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), ServeError<L::Error>> {
        self.sender.flush(|bytes| self.link.write_all(bytes)).map_err(ServeError::Link)?;
        self.link.flush().map_err(ServeError::Link)
    }

    /// Gives the current packet to the device, and those that follow as long as they are `wanted`;
    /// answers when no further packet has arrived. Returns false when the link is closed.
    fn run<const RAW: usize>(
        &mut self,
        device: &mut Device<RAW>,
        model: &mut impl Model,
        wanted: impl Fn(&[u8]) -> bool,
    ) -> Result<bool, ServeError<L::Error>> {
        loop {
            device.receive(self.packet(), model);
            if device.is_pressed(model) {
                self.send(device, model)?;
            }
            if !self.arrived()? {
                self.send(device, model)?;
                self.flush()?;
                if !self.wait()? {
                    return Ok(false);
                }
            }
            if !wanted(self.packet()) {
                return Ok(true);
            }
        }
    }
}

/// Whether a packet belongs to a frame in progress, and needs nothing else of the model.
fn is_of_frame(packet: &[u8]) -> bool {
    const KINDS: [u8; 3] = [Kind::Part as u8, Kind::Ack as u8, Kind::Ping as u8];
    packet.first().is_some_and(|kind| KINDS.contains(kind))
}

/// Calls the row functions of a frame in progress; an implementation may count or time them.
pub trait Dispatch {
    /// Calls [`AnyRunning::units`].
    fn units(running: &mut AnyRunning<'_, '_>, row: u16, first: u16, units: &[u8]) {
        running::units(running, row, first, units);
    }

    /// Calls [`AnyRunning::raw_row`].
    fn raw_row(running: &mut AnyRunning<'_, '_>, row: u16, out: &mut [u8]) {
        running::raw_row(running, row, out);
    }
}

/// Calls the row functions and does nothing else.
pub struct Plain;

impl Dispatch for Plain {}

/// Serves a link until it is closed.
///
/// # Errors
/// The link failed, or its ends are out of step.
pub fn serve<L: Read + Write, const RAW: usize>(
    device: &mut Device<RAW>,
    model: &mut impl Model,
    link: &mut L,
    framing: Framing,
    buffers: Buffers<'_>,
) -> Result<(), ServeError<L::Error>> {
    let mut port = Port::new(link, framing, buffers);
    if port.wait()? {
        port.run(device, model, |_| true)?;
    }
    Ok(())
}

/// Serves a link until it is closed, and keeps the working state of a frame from packet to packet.
///
/// # Errors
/// The link failed, or its ends are out of step.
pub fn serve_rig<D: Dispatch, L: Read + Write, const RAW: usize>(
    device: &mut Device<RAW>,
    rig: &mut Rig<'_>,
    link: &mut L,
    framing: Framing,
    buffers: Buffers<'_>,
) -> Result<(), ServeError<L::Error>> {
    let mut port = Port::new(link, framing, buffers);
    let mut open = port.wait()?;
    while open {
        open = if is_of_frame(port.packet())
            && let Some(open) = rig.with_running(|running, sink| {
                let mut model = Streaming::<D> { running, sink, dispatch: PhantomData };
                port.run(device, &mut model, is_of_frame)
            }) {
            open?
        } else {
            port.run(device, rig, |packet| !is_of_frame(packet))?
        };
    }
    Ok(())
}

/// A frame in progress as the device's model; it only receives packets of that frame.
struct Streaming<'w, 'c, 'r, 's, D> {
    running: &'w mut AnyRunning<'c, 'r>,
    sink: Option<&'w mut (dyn RowSink + Send + 's)>,
    dispatch: PhantomData<D>,
}

impl<D: Dispatch> Model for Streaming<'_, '_, '_, '_, D> {
    fn capabilities(&self) -> Capabilities {
        Capabilities::default()
    }

    fn camera_piece(&mut self, _: u32, _: &[u8]) -> Result<(), Refusal> {
        Err(Refusal::NoCamera)
    }

    fn camera_end(&mut self) -> Result<(), Refusal> {
        Err(Refusal::NoCamera)
    }

    fn begin(&mut self, _: &FrameBegin, _: Exposure, _: &Registers) -> Result<Begun, Refusal> {
        Err(Refusal::NoCamera)
    }

    fn units(&mut self, row: u16, first: u16, units: &[u8]) {
        D::units(self.running, row, first, units);
    }

    fn raw_row(&mut self, row: u16, out: &mut [u8]) {
        D::raw_row(self.running, row, out);
    }

    fn sink(&mut self) -> Option<&mut dyn RowSink> {
        Some(&mut **self.sink.as_mut()?)
    }
}
