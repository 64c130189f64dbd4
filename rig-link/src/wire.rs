//! Packets: the units that both ends exchange, complete or not at all.
//!
//! ```text
//! byte  0      kind
//!       1      flags, meaning depends on the kind
//!       2..4   session, chosen by the host at Hello
//!       4..6   seq, the sender's packet counter
//!       6..8   ack, the newest seq that the sender has received from its peer
//!       8..n-4 body
//!       n-4..n CRC-32C of everything before it
//! ```
//! All numbers are little-endian. Bodies of control messages are postcard; spectral and raw rows
//! are raw bytes behind the fixed fields of [`PartHeader`] and [`RawHeader`].
//!
//! Nothing here panics on bytes from outside: [`Packet::parse`] checks length, kind and CRC, and
//! the fixed fields are read with checked slicing. [`seal`] panics if its buffer, whose size the
//! caller chooses, is too small.

use crate::message::{Nack, ToHost, VERSIONS};
use core::fmt;

/// Bytes of the header before the body.
pub const HEADER_BYTES: usize = 8;
/// Bytes of the CRC after the body.
pub const CHECK_BYTES: usize = 4;

/// CRC-32C (Castagnoli; CRC-32/ISCSI in the catalogue of CRC algorithms) of some bytes.
#[cfg(feature = "hardware-crc")]
pub fn crc32c(bytes: &[u8]) -> u32 {
    crc32c::crc32c(bytes)
}

/// CRC-32C (Castagnoli; CRC-32/ISCSI in the catalogue of CRC algorithms) of some bytes.
#[cfg(not(feature = "hardware-crc"))]
pub fn crc32c(bytes: &[u8]) -> u32 {
    static CRC32C: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISCSI);
    CRC32C.checksum(bytes)
}

/// What a packet's body is. Number 8 is taken: early devices had it for a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[non_exhaustive]
pub enum Kind {
    /// Host: [`crate::message::Hello`]. Device: [`crate::message::HelloReply`]. The only kind
    /// whose layout no later version may change.
    Hello = 1,
    /// Postcard: [`crate::message::ToDevice`] or [`crate::message::ToHost`].
    Control = 2,
    /// Host: a piece of the camera, after a [`CameraHeader`].
    Camera = 3,
    /// Host: a piece of a spectral row, after a [`PartHeader`].
    Part = 4,
    /// Device: a piece of a raw row, after a [`RawHeader`].
    Raw = 5,
    /// Device: its [`Cursor`]. Host: empty; it only carries `ack`.
    Ack = 6,
    /// Host: empty; asks for an Ack. It needs no credit, so it can be sent on a link that stands
    /// still.
    Ping = 7,
}

impl Kind {
    /// All kinds, in the order of their numbers.
    pub const ALL: [Self; 7] =
        [Self::Hello, Self::Control, Self::Camera, Self::Part, Self::Raw, Self::Ack, Self::Ping];

    fn from_byte(byte: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|&k| k as u8 == byte)
    }
}

/// Flag of a [`Kind::Part`]: the first part of a row that does not follow the previous one.
pub const JUMP: u8 = 1;
/// Flag of a device's [`Kind::Ack`]: parts did not continue at [`Cursor`]; send again from there.
pub const GAP: u8 = 1;
/// Flag of a device's [`Kind::Ack`]: raw rows wait for credit.
pub const PENDING: u8 = 2;

/// Fields of every packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// What the body is.
    pub kind: Kind,
    /// Bits that depend on the kind.
    pub flags: u8,
    /// The host's number of this connection.
    pub session: u16,
    /// The sender's packet counter.
    pub seq: u16,
    /// Newest packet counter received from the peer.
    pub ack: u16,
}

/// A packet with a correct CRC.
#[derive(Clone, Copy, Debug)]
pub struct Packet<'a> {
    /// The common fields.
    pub header: Header,
    /// What lies between header and CRC.
    pub body: &'a [u8],
}

/// Why bytes are not a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Reject {
    /// Too short, or the CRC does not match.
    Damaged,
    /// Undamaged, but of a kind that this version does not know.
    UnknownKind {
        /// The kind's byte.
        kind: u8,
        /// The packet's session.
        session: u16,
        /// The packet's counter.
        seq: u16,
    },
}

impl fmt::Display for Reject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Damaged => f.write_str(
                "the packet is too short or its CRC-32C is wrong: drop it, the host will ask \
                 again",
            ),
            Self::UnknownKind { kind, session, .. } => write!(
                f,
                "packet kind {kind} in session {session} is not one of protocol versions {} to \
                 {}: update this end",
                VERSIONS.0, VERSIONS.1
            ),
        }
    }
}

impl core::error::Error for Reject {}

impl<'a> Packet<'a> {
    /// Checks and splits a received packet.
    ///
    /// # Errors
    /// [`Reject`]: damaged, or of an unknown kind.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, Reject> {
        let (rest, crc) = bytes.split_last_chunk::<CHECK_BYTES>().ok_or(Reject::Damaged)?;
        let (head, body) = rest.split_first_chunk::<HEADER_BYTES>().ok_or(Reject::Damaged)?;
        if crc32c(rest) != u32::from_le_bytes(*crc) {
            return Err(Reject::Damaged);
        }
        let word = |i: usize| u16::from_le_bytes([head[i], head[i + 1]]);
        let kind = Kind::from_byte(head[0]).ok_or(Reject::UnknownKind {
            kind: head[0],
            session: word(2),
            seq: word(4),
        })?;
        let header = Header { kind, flags: head[1], session: word(2), seq: word(4), ack: word(6) };
        Ok(Self { header, body })
    }
}

/// Completes a packet whose body was written to `buffer[HEADER_BYTES..][..body_bytes]`. Returns
/// the packet's length.
///
/// # Panics
/// If the buffer is shorter than header, body and CRC.
pub fn seal(buffer: &mut [u8], header: Header, body_bytes: usize) -> usize {
    buffer[0] = header.kind as u8;
    buffer[1] = header.flags;
    buffer[2..4].copy_from_slice(&header.session.to_le_bytes());
    buffer[4..6].copy_from_slice(&header.seq.to_le_bytes());
    buffer[6..8].copy_from_slice(&header.ack.to_le_bytes());
    let end = HEADER_BYTES + body_bytes;
    let crc = crc32c(&buffer[..end]);
    buffer[end..end + CHECK_BYTES].copy_from_slice(&crc.to_le_bytes());
    end + CHECK_BYTES
}

/// Whether a packet tells its host that the device has no session with it.
#[must_use]
pub fn tells_no_session(packet: &[u8]) -> bool {
    Packet::parse(packet).is_ok_and(|packet| {
        let message = postcard::from_bytes(packet.body);
        packet.header.kind == Kind::Control && message == Ok(ToHost::Nack(Nack::NoSession))
    })
}

/// Whether counter `a` comes after `b`; counters wrap.
pub fn after(a: u16, b: u16) -> bool {
    (a.wrapping_sub(b) as i16) > 0
}

/// Position of the device within a frame: the part that it expects next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Cursor {
    /// Spectral row.
    pub row: u16,
    /// Unit (one codec block) within the row.
    pub unit: u16,
}

macro_rules! fixed_fields {
    (
        $(#[$doc:meta])*
        $name:ident { $($(#[$field_doc:meta])* $field:ident: $type:ty),* $(,)? }
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub struct $name { $($(#[$field_doc])* pub $field: $type),* }

        impl $name {
            /// Bytes on the wire.
            pub const BYTES: usize = 0 $(+ size_of::<$type>())*;

            /// Splits the fields off the front of a body; `None` if the body is too short.
            pub fn split(body: &[u8]) -> Option<(Self, &[u8])> {
                $(let (bytes, body) = body.split_first_chunk()?;
                let $field = <$type>::from_le_bytes(*bytes);)*
                Some((Self { $($field),* }, body))
            }

            /// Writes the fields to the front of a body.
            ///
            /// # Panics
            /// If the body is shorter than [`Self::BYTES`].
            pub fn write(&self, body: &mut [u8]) {
                let mut at = 0;
                $(let bytes = self.$field.to_le_bytes();
                body[at..at + bytes.len()].copy_from_slice(&bytes);
                at += bytes.len();)*
                debug_assert_eq!(at, Self::BYTES);
            }
        }
    };
}

fixed_fields! {
    /// Front of a [`Kind::Camera`] body.
    CameraHeader {
        /// [`crate::message::camera_id`] of the whole camera.
        id: u64,
        /// Bytes of the whole camera.
        total: u32,
        /// Offset of this piece, bytes.
        offset: u32,
    }
}

fixed_fields! {
    /// Front of a [`Kind::Part`] body; whole units of a spectral row follow.
    PartHeader {
        /// Which [`crate::message::FrameBegin`] it belongs to.
        transfer: u16,
        /// Spectral row.
        row: u16,
        /// The first unit.
        unit: u16,
    }
}

fixed_fields! {
    /// Front of a [`Kind::Raw`] body; bytes of a packed raw row follow.
    RawHeader {
        /// Which [`crate::message::FrameBegin`] it belongs to.
        transfer: u16,
        /// Raw row.
        row: u16,
        /// Offset of the bytes in the packed row.
        offset: u16,
        /// CRC-32C of the whole packed row. A row may be assembled from pieces of several
        /// computations of it; the CRC shows that they agree.
        row_crc: u32,
    }
}

fixed_fields! {
    /// Body of a device's [`Kind::Ack`].
    AckBody {
        /// The transfer in progress, or the last.
        transfer: u16,
        /// [`Cursor::row`].
        row: u16,
        /// [`Cursor::unit`].
        unit: u16,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crc_matches_the_catalogue_check_value() {
        // reveng CRC catalogue, CRC-32/ISCSI: check = 0xe3069283.
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
    }

    #[test]
    fn a_sealed_packet_parses_and_any_flipped_bit_is_noticed() {
        let header =
            Header { kind: Kind::Part, flags: JUMP, session: 0x1234, seq: 7, ack: 0xfffe };
        let mut bytes = [0u8; 40];
        PartHeader { transfer: 3, row: 513, unit: 9 }.write(&mut bytes[HEADER_BYTES..]);
        let n = seal(&mut bytes, header, 28);
        let packet = Packet::parse(&bytes[..n]).unwrap();
        assert_eq!(packet.header, header);
        let (part, rest) = PartHeader::split(packet.body).unwrap();
        assert_eq!((part.transfer, part.row, part.unit, rest.len()), (3, 513, 9, 22));
        for bit in 0..n * 8 {
            let mut damaged = bytes;
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(Packet::parse(&damaged[..n]).unwrap_err(), Reject::Damaged);
        }
        for short in 0..n {
            assert!(Packet::parse(&bytes[..short]).is_err());
        }
    }

    #[test]
    fn counters_wrap() {
        assert!(after(0, 0xffff) && after(5, 4) && !after(4, 4) && !after(0xffff, 0));
    }
}
