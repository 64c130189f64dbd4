//! Messages of USB/IP 1.1.1, big endian (Linux Documentation/usb/usbip_protocol.rst).

/// TCP port of USB/IP servers.
pub const PORT: u16 = 3240;
/// Bytes of a request's header once a device is attached; data to the device follows it.
pub const HEADER_BYTES: usize = 48;
/// The place of the camera on its bus.
pub const BUS_ID: &str = "1-1";
/// The place of the I2C adapter beside it.
pub const ADAPTER_BUS_ID: &str = "1-2";

const VERSION: u16 = 0x0111;
/// Codes of operations before a device is attached, in requests; answers have them without the
/// highest bit.
const LIST: u16 = 0x8005;
const IMPORT: u16 = 0x8003;
const BUS_ID_BYTES: usize = 32;
/// Most data that a host may send to the device at once, bytes: control transfers have no more.
const MAX_OUT: u32 = u16::MAX as u32;
/// Isochronous packets of requests that are not isochronous.
const NO_PACKETS: [u32; 2] = [0, u32::MAX];
/// Linux' errors in answers.
const EPIPE: i32 = -32;
const ECONNRESET: i32 = -104;
const ESHUTDOWN: i32 = -108;

/// What a host asks before it has attached a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// Which devices there are.
    List,
    /// To attach one, which it names in the bytes that follow: [`Operation::BODY`].
    Import,
}

impl Operation {
    /// Bytes of its header.
    pub const HEADER: usize = 8;
    /// Bytes that follow the header of [`Operation::Import`].
    pub const BODY: usize = BUS_ID_BYTES;

    /// Reads a header.
    pub fn parse(header: [u8; Self::HEADER]) -> Option<Self> {
        let [_, _, high, low, ..] = header;
        match u16::from_be_bytes([high, low]) {
            LIST => Some(Self::List),
            IMPORT => Some(Self::Import),
            _ => None,
        }
    }

    /// The place on the bus that the body of an import names.
    pub fn bus_id(body: &[u8; Self::BODY]) -> &[u8] {
        let end = body.iter().position(|byte| *byte == 0).unwrap_or(body.len());
        &body[..end]
    }
}

/// Why a device cannot be attached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// Another host has it.
    Busy = 2,
    /// There is none of this name.
    Unknown = 4,
}

fn answer(code: u16, status: u32) -> Vec<u8> {
    let mut out = VERSION.to_be_bytes().to_vec();
    out.extend((code & 0x7fff).to_be_bytes());
    out.extend(status.to_be_bytes());
    out
}

/// Answer to [`Operation::List`]: devices with their interfaces.
pub fn listed(devices: &[Vec<u8>]) -> Vec<u8> {
    [&answer(LIST, 0), &(devices.len() as u32).to_be_bytes()[..], &devices.concat()].concat()
}

/// Answer to [`Operation::Import`].
pub fn imported(device: Result<&[u8], Refusal>) -> Vec<u8> {
    match device {
        Ok(device) => [&answer(IMPORT, 0), device].concat(),
        Err(refusal) => answer(IMPORT, refusal as u32),
    }
}

/// A request to an attached device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// A transfer.
    Submit(Submit),
    /// A transfer that is no longer wanted.
    Unlink {
        /// Number of this request.
        seq: u32,
        /// Number of the transfer.
        victim: u32,
    },
}

/// A transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Submit {
    /// Its number.
    pub seq: u32,
    /// From the device to the host.
    pub is_in: bool,
    /// Endpoint; 0 is control.
    pub endpoint: u32,
    /// Bytes that follow to the device, or the most that the host takes.
    pub length: u32,
    /// The set-up packet of a control transfer.
    pub setup: [u8; 8],
}

impl Submit {
    /// Bytes of data that the set-up packet of a control transfer asks for or announces.
    pub fn asked(&self) -> u16 {
        u16::from_le_bytes([self.setup[6], self.setup[7]])
    }
}

impl Request {
    /// Reads a header; `None` if it does not follow the protocol, or asks for what this device does
    /// not have (isochronous transfers, more data than any control takes).
    pub fn parse(header: &[u8; HEADER_BYTES]) -> Option<Self> {
        let (words, _) = header.as_chunks::<4>();
        let word = |i: usize| u32::from_be_bytes(words[i]);
        match word(0) {
            1 => {
                let mut setup = [0; 8];
                setup.copy_from_slice(&header[40..]);
                let is_in = word(3) == 1;
                let fits = is_in || word(6) <= MAX_OUT;
                let submit =
                    Submit { seq: word(1), is_in, endpoint: word(4), length: word(6), setup };
                (fits && NO_PACKETS.contains(&word(8))).then_some(Self::Submit(submit))
            }
            2 => Some(Self::Unlink { seq: word(1), victim: word(5) }),
            _ => None,
        }
    }

    /// Bytes that follow the header.
    pub fn body_bytes(&self) -> usize {
        match self {
            Self::Submit(submit) if !submit.is_in => submit.length as usize,
            _ => 0,
        }
    }
}

fn header(words: [u32; 7]) -> Vec<u8> {
    let mut out: Vec<u8> = words.into_iter().flat_map(u32::to_be_bytes).collect();
    out.resize(HEADER_BYTES, 0);
    out
}

/// The end of a control transfer with its answer; without one the device refuses it.
pub fn answered(submit: &Submit, answer: Option<Vec<u8>>) -> Vec<u8> {
    match answer {
        Some(mut answer) if submit.is_in => {
            answer.truncate((submit.length as usize).min(submit.asked().into()));
            sent(submit.seq, &[&answer])
        }
        Some(_) => taken(submit.seq, submit.length),
        None => refused(submit.seq),
    }
}

/// The end of a transfer from the device.
pub fn sent(seq: u32, data: &[&[u8]]) -> Vec<u8> {
    let length: usize = data.iter().map(|part| part.len()).sum();
    let mut out = header([3, seq, 0, 0, 0, 0, length as u32]);
    out.extend(data.iter().copied().flatten());
    out
}

/// The end of a transfer of so many bytes to the device.
pub fn taken(seq: u32, length: u32) -> Vec<u8> {
    header([3, seq, 0, 0, 0, 0, length])
}

/// A transfer that the device refuses (STALL).
pub fn refused(seq: u32) -> Vec<u8> {
    header([3, seq, 0, 0, 0, EPIPE as u32, 0])
}

/// The end of a transfer of a stream that is over, as of a device that is shut down: Linux lets the
/// program that waits know.
pub fn ended(seq: u32) -> Vec<u8> {
    header([3, seq, 0, 0, 0, ESHUTDOWN as u32, 0])
}

/// The end of a request to forget a transfer, which was waiting or already over.
pub fn forgotten(seq: u32, was_waiting: bool) -> Vec<u8> {
    header([4, seq, 0, 0, 0, if was_waiting { ECONNRESET as u32 } else { 0 }, 0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_read_and_what_does_not_follow_the_protocol_is_refused() {
        let mut bytes = [0; HEADER_BYTES];
        for (at, word) in [(0, 1u32), (4, 7), (12, 1), (16, 1), (24, 0x4000), (32, u32::MAX)] {
            bytes[at..at + 4].copy_from_slice(&word.to_be_bytes());
        }
        bytes[40..].copy_from_slice(&[0x80, 6, 0, 1, 0, 0, 18, 0]);
        let setup = [0x80, 6, 0, 1, 0, 0, 18, 0];
        let submit = Submit { seq: 7, is_in: true, endpoint: 1, length: 0x4000, setup };
        assert_eq!(Request::parse(&bytes), Some(Request::Submit(submit)));
        (bytes[15], bytes[25]) = (0, 1);
        assert_eq!(Request::parse(&bytes), None, "80 KiB in a control transfer");
        (bytes[25], bytes[26]) = (0, 0);
        assert_eq!(Request::parse(&bytes).map(|r| r.body_bytes()), Some(0));
        bytes[32..36].copy_from_slice(&8u32.to_be_bytes());
        assert_eq!(Request::parse(&bytes), None, "isochronous");
        bytes[3] = 2;
        bytes[23] = 5;
        assert_eq!(Request::parse(&bytes), Some(Request::Unlink { seq: 7, victim: 5 }));
        bytes[3] = 9;
        assert_eq!(Request::parse(&bytes), None);
        assert_eq!(Operation::parse([1, 0x11, 0x80, 5, 0, 0, 0, 0]), Some(Operation::List));
        assert_eq!(Operation::parse([0; 8]), None);
    }
}
