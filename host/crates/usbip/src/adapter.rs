//! An I2C adapter of the kind i2c-tiny-usb, without sockets and clock: control transfers in,
//! transactions on a bus out (Linux drivers/i2c/busses/i2c-tiny-usb.c).
//!
//! A message is a control transfer with the I2C address as its index, and a transaction of its own
//! on the bus: sensors go on at the register written last after a stop, too. The host then asks for
//! the status.

use crate::descriptors::{self, ADAPTER};
use crate::protocol::{self, Request, Submit};
use embedded_hal::i2c::I2c;
use std::sync::{Mutex, PoisonError};

/// Control transfers of the vendor for an interface, to the device and from it.
const TO_DEVICE: u8 = 0x41;
const FROM_DEVICE: u8 = 0xC1;
/// Requests: what the adapter can do, the length of half a clock (which a bus in software has not),
/// the status, and messages: bits 0 and 1 say that the first and the last of a transfer.
const GET_FUNCTIONS: u8 = 1;
const SET_DELAY: u8 = 2;
const GET_STATUS: u8 = 3;
const MESSAGE: u8 = 4;
const LAST_MESSAGE: u8 = 7;
/// What it can do: I2C messages, and all of SMBus that Linux makes of them.
const FUNCTIONS: u32 = 0x0EFF_0001;
/// Statuses: no message yet, acknowledged, not acknowledged.
const IDLE: u8 = 0;
const ACKNOWLEDGED: u8 = 1;
const NOT_ACKNOWLEDGED: u8 = 2;
/// Highest I2C address of 7 bits.
const MAX_ADDRESS: u16 = 0x7F;

/// An adapter and its bus.
#[derive(Debug)]
pub struct Adapter<'a, B> {
    bus: &'a Mutex<B>,
    status: u8,
    serial: String,
}

impl<'a, B: I2c> Adapter<'a, B> {
    /// An adapter that was just plugged in.
    pub fn new(bus: &'a Mutex<B>, serial: &str) -> Self {
        Self { bus, status: IDLE, serial: serial.into() }
    }

    /// Takes a request with the data that follow it, and returns the answer.
    pub fn receive(&mut self, request: &Request, data: &[u8]) -> Vec<u8> {
        match request {
            // Nothing waits.
            Request::Unlink { seq, .. } => protocol::forgotten(*seq, false),
            Request::Submit(submit) if submit.endpoint == 0 => {
                let answer = self.control(submit, data);
                protocol::answered(submit, answer)
            }
            Request::Submit(submit) => protocol::refused(submit.seq),
        }
    }

    /// Answers a control transfer; `None` refuses it.
    fn control(&mut self, submit: &Submit, data: &[u8]) -> Option<Vec<u8>> {
        let [kind, request, _, _, index_low, index_high, ..] = submit.setup;
        let address = u16::from_le_bytes([index_low, index_high]);
        match (kind, request) {
            (FROM_DEVICE, GET_FUNCTIONS) => Some(FUNCTIONS.to_le_bytes().to_vec()),
            (TO_DEVICE, SET_DELAY) => Some(vec![]),
            (FROM_DEVICE, GET_STATUS) => Some(vec![self.status]),
            (FROM_DEVICE, MESSAGE..=LAST_MESSAGE) => {
                let mut read = vec![0; submit.asked().into()];
                self.message(address, |bus, address| bus.read(address, &mut read));
                Some(read)
            }
            (TO_DEVICE, MESSAGE..=LAST_MESSAGE) => {
                self.message(address, |bus, address| bus.write(address, data));
                Some(vec![])
            }
            _ => {
                let texts = ["camrig I2C adapter", &self.serial];
                ADAPTER.answer(submit, descriptors::adapter_configuration, texts)
            }
        }
    }

    fn message(
        &mut self,
        address: u16,
        transfer: impl FnOnce(&mut B, u8) -> Result<(), B::Error>,
    ) {
        // Whole with a thread that panicked, too: it answers transactions one by one.
        let mut bus = self.bus.lock().unwrap_or_else(PoisonError::into_inner);
        let is_taken = address <= MAX_ADDRESS && transfer(&mut bus, address as u8).is_ok();
        self.status = if is_taken { ACKNOWLEDGED } else { NOT_ACKNOWLEDGED };
    }
}

#[cfg(test)]
mod tests;
