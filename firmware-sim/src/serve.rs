//! The rig's main loop: packets in, answers out, over any `embedded_io` link.

use crate::rig::Rig;
use crate::running::{self, AnyRunning};
use core::marker::PhantomData;
use embedded_io::{Read, Write};
use rig_link::device::{Begun, Device, Model};
use rig_link::framing::{Framing, Receiver};
use rig_link::message::*;
use rig_link::registers::Registers;
use rig_link::wire::Kind;

/// Memory of a link.
pub struct Buffers<'m> {
    /// Bytes as they come; on HID a whole number of reports.
    pub input: &'m mut [u8],
    /// The packet that is being received: its longest framed form.
    pub packet: &'m mut [u8],
    /// The packet to send.
    pub answer: &'m mut [u8],
    /// Its framed form.
    pub framed: &'m mut [u8],
}

/// Why [`serve`] ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ServeError<E> {
    /// The link failed.
    Link(E),
    /// A loss-free link is out of step.
    OutOfStep,
}

struct Port<'m, L> {
    link: &'m mut L,
    framing: Framing,
    receiver: Receiver<&'m mut [u8]>,
    input: &'m mut [u8],
    /// What of `input` is yet to be used.
    left: (usize, usize),
    answer: &'m mut [u8],
    framed: &'m mut [u8],
}

impl<L: Read + Write> Port<'_, L> {
    /// Waits for a packet; false when the link is closed.
    fn wait(&mut self) -> Result<bool, ServeError<L::Error>> {
        loop {
            let (start, end) = self.left;
            let mut bytes = &self.input[start..end];
            let whole = self.receiver.push(&mut bytes).map_err(|_| ServeError::OutOfStep)?;
            self.left = (end - bytes.len(), end);
            if whole {
                return Ok(true);
            }
            let read = self.link.read(self.input).map_err(ServeError::Link)?;
            if read == 0 {
                return Ok(false);
            }
            self.left = (0, read);
        }
    }

    /// Hands the packet to the device and sends all that it answers.
    fn handle<const RAW: usize>(
        &mut self,
        device: &mut Device<RAW>,
        model: &mut impl Model,
    ) -> Result<(), ServeError<L::Error>> {
        device.receive(self.receiver.packet(), model);
        while let Some(bytes) = device.transmit(self.answer, model) {
            let bytes = self.framing.encode(&self.answer[..bytes], self.framed);
            self.link.write_all(&self.framed[..bytes]).map_err(ServeError::Link)?;
        }
        self.link.flush().map_err(ServeError::Link)
    }

    /// Whether the packet is one of the many of a frame, which ask nothing else of the model.
    fn is_of_frame(&mut self) -> bool {
        const KINDS: [u8; 3] = [Kind::Part as u8, Kind::Ack as u8, Kind::Ping as u8];
        self.receiver.packet().first().is_some_and(|kind| KINDS.contains(kind))
    }
}

/// Calls the row functions of a frame in progress. A workstation puts versions for its vector
/// instructions in between.
pub trait Dispatch {
    /// Calls [`AnyRunning::units`].
    fn units(running: &mut AnyRunning<'_>, row: u16, first: u16, units: &[u8]) {
        running::units(running, row, first, units);
    }

    /// Calls [`AnyRunning::raw_row`].
    fn raw_row(running: &mut AnyRunning<'_>, row: u16, out: &mut [u8]) {
        running::raw_row(running, row, out);
    }
}

/// Calls them as they are.
pub struct Plain;

impl Dispatch for Plain {}

/// Serves a link until it is closed.
pub fn serve<D: Dispatch, L: Read + Write, const RAW: usize>(
    device: &mut Device<RAW>,
    rig: &mut Rig<'_>,
    link: &mut L,
    framing: Framing,
    buffers: Buffers<'_>,
) -> Result<(), ServeError<L::Error>> {
    let Buffers { input, packet, answer, framed } = buffers;
    let receiver = Receiver::new(framing, packet);
    let mut port = Port { link, framing, receiver, input, left: (0, 0), answer, framed };
    let mut open = port.wait()?;
    while open {
        if port.is_of_frame()
            && let Some(running) = rig.running()
        {
            let mut streaming = Streaming::<D>(running, PhantomData);
            while open && port.is_of_frame() {
                port.handle(device, &mut streaming)?;
                open = port.wait()?;
            }
        } else {
            port.handle(device, rig)?;
            open = port.wait()?;
        }
    }
    Ok(())
}

/// A frame in progress as the device's model; it only ever sees the parts of a frame.
struct Streaming<'r, D>(AnyRunning<'r>, PhantomData<D>);

impl<D: Dispatch> Model for Streaming<'_, D> {
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
        D::units(&mut self.0, row, first, units);
    }

    fn raw_row(&mut self, row: u16, out: &mut [u8]) {
        D::raw_row(&mut self.0, row, out);
    }
}
