//! GigE Vision's control protocol: datagrams of a command and of its acknowledgement, big endian.
//!
//! Command: `0x42, flags, command u16, length u16, id u16`, payload. Flag 1 asks for an
//! acknowledgement, flag 0x10 says that a resend request has block numbers of 64 bits.
//! Acknowledgement: `status u16, command + 1 u16, length u16, id u16`, payload.

/// UDP port of a device.
pub const PORT: u16 = 3956;
/// Most bytes of a payload: a datagram has at most 576 bytes with the headers of IP and UDP.
pub const MAX_PAYLOAD: usize = 540;
const KEY: u8 = 0x42;
const HEADER_BYTES: usize = 8;
const ACKNOWLEDGE: u8 = 0x01;
const EXTENDED_IDS: u8 = 0x10;

/// Numbers of commands.
pub mod code {
    /// Who is there?
    pub const DISCOVERY: u16 = 0x0002;
    /// Packets of the stream once more.
    pub const RESEND: u16 = 0x0040;
    /// Registers.
    pub const READ_REGISTERS: u16 = 0x0080;
    /// Registers.
    pub const WRITE_REGISTERS: u16 = 0x0082;
    /// Bytes at an address.
    pub const READ_MEMORY: u16 = 0x0084;
    /// Bytes at an address.
    pub const WRITE_MEMORY: u16 = 0x0086;
}

/// Why a command is refused: the status of its acknowledgement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum Status {
    /// The command is none of this device's.
    NotImplemented = 0x8001,
    /// The register does not take the value.
    InvalidParameter = 0x8002,
    /// Nothing is at the address.
    InvalidAddress = 0x8003,
    /// The register cannot be written.
    WriteProtect = 0x8004,
    /// Address or length are not a multiple of 4.
    BadAlignment = 0x8005,
    /// Another application controls the device, or it is streaming.
    AccessDenied = 0x8006,
    /// The packet is no longer in memory.
    PacketUnavailable = 0x800C,
}

/// A command without its header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command<'a> {
    /// Who is there?
    Discovery,
    /// Addresses, 4 bytes each.
    ReadRegisters(&'a [[u8; 4]]),
    /// Addresses and values, 8 bytes each.
    WriteRegisters(&'a [[u8; 8]]),
    /// So many bytes from an address on.
    ReadMemory {
        /// First address.
        address: u32,
        /// Bytes.
        count: u16,
    },
    /// Bytes to an address and those after it.
    WriteMemory {
        /// First address.
        address: u32,
        /// Bytes.
        data: &'a [u8],
    },
    /// Packets of a block once more.
    Resend(Resend),
    /// Any other, or one whose payload is not whole.
    Unknown,
}

/// A request for packets of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Resend {
    /// Number of the block, 16 bits of it unless `extended`.
    pub block: u64,
    /// Whether the number has 64 bits.
    pub extended: bool,
    /// First packet.
    pub first: u32,
    /// Last packet.
    pub last: u32,
}

/// A command as it came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request<'a> {
    /// Its number.
    pub code: u16,
    /// Number of the request, for the acknowledgement.
    pub id: u16,
    /// Whether an acknowledgement is wanted.
    pub acknowledge: bool,
    /// What is wanted.
    pub command: Command<'a>,
}

impl<'a> Request<'a> {
    /// Reads a datagram; `None` for one that is no command.
    pub fn parse(datagram: &'a [u8]) -> Option<Self> {
        let (header, rest) = datagram.split_first_chunk::<HEADER_BYTES>()?;
        let &[key, flags, c0, c1, l0, l1, i0, i1] = header;
        let payload = rest.get(..u16::from_be_bytes([l0, l1]).into())?;
        let code = u16::from_be_bytes([c0, c1]);
        let command = command(code, flags, payload).unwrap_or(Command::Unknown);
        let id = u16::from_be_bytes([i0, i1]);
        (key == KEY).then_some(Self { code, id, acknowledge: flags & ACKNOWLEDGE != 0, command })
    }

    /// The acknowledgement of the request.
    pub fn answer(&self, outcome: Result<&[u8], Status>) -> Vec<u8> {
        let (status, payload) = match outcome {
            Ok(payload) => (0, payload),
            Err(status) => (status as u16, &[][..]),
        };
        // Unknown codes reach to the end of the range.
        acknowledgement(status, self.code.wrapping_add(1), self.id, payload)
    }
}

fn command(code: u16, flags: u8, payload: &[u8]) -> Option<Command<'_>> {
    let word = |i: usize| payload[i..].first_chunk().map(|b| u32::from_be_bytes(*b));
    let words = payload.len() / 4;
    Some(match code {
        code::DISCOVERY => Command::Discovery,
        code::READ_REGISTERS => match payload.as_chunks() {
            (addresses, []) if words > 0 => Command::ReadRegisters(addresses),
            _ => return None,
        },
        code::WRITE_REGISTERS => match payload.as_chunks() {
            (writes, []) if words > 0 => Command::WriteRegisters(writes),
            _ => return None,
        },
        code::READ_MEMORY if words >= 2 => {
            Command::ReadMemory { address: word(0)?, count: word(4)? as u16 }
        }
        code::WRITE_MEMORY if words >= 2 => {
            Command::WriteMemory { address: word(0)?, data: &payload[4..] }
        }
        code::RESEND if flags & EXTENDED_IDS != 0 && words >= 5 => Command::Resend(Resend {
            block: u64::from(word(12)?) << 32 | u64::from(word(16)?),
            extended: true,
            first: word(4)?,
            last: word(8)?,
        }),
        code::RESEND if flags & EXTENDED_IDS == 0 && words >= 3 => Command::Resend(Resend {
            block: (word(0)? & 0xffff).into(),
            extended: false,
            first: word(4)? & 0xff_ffff,
            last: word(8)? & 0xff_ffff,
        }),
        _ => return None,
    })
}

fn acknowledgement(status: u16, code: u16, id: u16, payload: &[u8]) -> Vec<u8> {
    let header = [status, code, payload.len() as u16, id].map(u16::to_be_bytes);
    [header.as_flattened(), payload].concat()
}

/// A command as an application sends it, with an acknowledgement asked for; with `extended`, the
/// block number of a resend request has 64 bits.
pub fn request(code: u16, id: u16, extended: bool, payload: &[u8]) -> Vec<u8> {
    let flags = if extended { EXTENDED_IDS } else { 0 };
    let flags = if code == code::RESEND { flags } else { flags | ACKNOWLEDGE };
    let words = [code, payload.len() as u16, id].map(u16::to_be_bytes);
    [&[KEY, flags], words.as_flattened(), payload].concat()
}

/// Status, number of the request and payload of an acknowledgement; `None` if it is none.
pub fn parse_acknowledgement(datagram: &[u8]) -> Option<(u16, u16, &[u8])> {
    let (header, payload) = datagram.split_first_chunk::<HEADER_BYTES>()?;
    let &[s0, s1, _, _, l0, l1, i0, i1] = header;
    let payload = payload.get(..u16::from_be_bytes([l0, l1]).into())?;
    Some((u16::from_be_bytes([s0, s1]), u16::from_be_bytes([i0, i1]), payload))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(bytes: &[u8]) -> Request<'_> {
        Request::parse(bytes).unwrap()
    }

    #[test]
    fn commands_are_read_as_the_standard_lays_them_out() {
        let discovery = parsed(&[0x42, 0x11, 0, 2, 0, 0, 0xAB, 0xCD]);
        assert_eq!((discovery.id, discovery.acknowledge), (0xABCD, true));
        assert_eq!(discovery.command, Command::Discovery);
        let read = [0x42, 1, 0, 0x84, 0, 8, 0, 1, 0, 0, 2, 0, 0xFF, 0xFF, 2, 0];
        let expected = Command::ReadMemory { address: 0x200, count: 512 };
        assert_eq!(parsed(&read).command, expected, "of the count the low 16 bits");
        let write = [0x42, 1, 0, 0x82, 0, 8, 0, 2, 0, 0, 0x0A, 0, 0, 0, 0, 2];
        let expected = Command::WriteRegisters(&[[0, 0, 0x0A, 0, 0, 0, 0, 2]]);
        assert_eq!(parsed(&write).command, expected);
        let resend = [0x42, 0, 0, 0x40, 0, 12, 0, 3, 0, 0, 0, 7, 0, 0, 0, 2, 0, 0, 0, 5];
        let expected = Resend { block: 7, extended: false, first: 2, last: 5 };
        assert_eq!(parsed(&resend).command, Command::Resend(expected));
        let mut extended = vec![0x42, 0x10, 0, 0x40, 0, 20, 0, 3, 0, 0, 0, 0, 0, 0, 0, 2];
        extended.extend([0, 0, 0, 5, 0, 0, 0, 1, 0, 0, 0, 7]);
        let expected = Resend { block: 1 << 32 | 7, extended: true, first: 2, last: 5 };
        assert_eq!(parsed(&extended).command, Command::Resend(expected));
    }

    #[test]
    fn what_is_not_whole_is_no_command() {
        assert_eq!(Request::parse(&[0x42, 1, 0, 2, 0, 0, 0]), None);
        assert_eq!(Request::parse(&[0x41, 1, 0, 2, 0, 0, 0, 1]), None, "another key");
        assert_eq!(Request::parse(&[0x42, 1, 0, 0x80, 0, 4, 0, 1, 0, 0]), None, "shorter");
        let half = [0x42, 1, 0, 0x82, 0, 4, 0, 1, 0, 0, 0x0A, 0];
        assert_eq!(parsed(&half).command, Command::Unknown, "an address without a value");
        let none = [0x42, 1, 0, 0x80, 0, 0, 0, 1];
        assert_eq!(parsed(&none).command, Command::Unknown);
    }

    #[test]
    fn acknowledgements_carry_status_and_number() {
        let bytes = [0x42, 1, 0, 0x80, 0, 4, 0, 9, 0, 0, 0, 0];
        let answered = parsed(&bytes).answer(Ok(&[1, 2, 3, 4]));
        assert_eq!(answered, [0, 0, 0, 0x81, 0, 4, 0, 9, 1, 2, 3, 4]);
        assert_eq!(parse_acknowledgement(&answered), Some((0, 9, &[1, 2, 3, 4][..])));
        let refused = parsed(&bytes).answer(Err(Status::AccessDenied));
        assert_eq!(refused, [0x80, 6, 0, 0x81, 0, 0, 0, 9]);
        assert_eq!(request(code::READ_REGISTERS, 9, false, &[0; 4]), bytes);
    }
}
