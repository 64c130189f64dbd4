//! GigE Vision's streaming protocol: a block (an image) as datagrams, big endian.
//!
//! Header: `status u16, block u16, kind << 24 | packet u24`; with extended ids `status u16, 0 u16,
//! 0x80000000 | kind << 24 u32, block u64, packet u32`. Packet 0 is the leader, then come payload
//! packets 1 to n, all but the last of one size, then the trailer, n + 1. Block numbers begin at 1;
//! those of 16 bits skip 0.

use crate::camera::Region;
use crate::gvcp::Status;

/// Bytes of the headers of IP and UDP, which a packet size counts.
pub const IP_UDP_BYTES: usize = 28;
const IMAGE: u16 = 1;

/// Kind of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// What the block is.
    Leader,
    /// The end of the block.
    Trailer,
    /// Bytes of the image.
    Payload,
}

impl Kind {
    const ALL: [(Self, u8); 3] = [(Self::Leader, 1), (Self::Trailer, 2), (Self::Payload, 3)];

    fn code(self) -> u32 {
        Self::ALL.iter().find(|(kind, _)| *kind == self).map_or(0, |(_, code)| (*code).into())
    }
}

/// An image on its way.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block {
    /// Its number, from 1.
    pub id: u64,
    /// Whether its packets have extended ids.
    pub extended: bool,
    /// When it was exposed, ticks.
    pub timestamp: u64,
    /// PFNC code.
    pub pixel_format: u32,
    /// Which part of the sensor it is.
    pub region: Region,
    /// Its pixels.
    pub image: Vec<u8>,
    /// Bytes of a packet with all headers.
    pub packet_size: usize,
}

/// A block number in 16 bits, which skip 0.
pub fn short_id(id: u64) -> u16 {
    (id.saturating_sub(1) % 0xffff + 1) as u16
}

fn header_bytes(extended: bool) -> usize {
    if extended { 20 } else { 8 }
}

impl Block {
    /// Bytes of the image in a payload packet.
    fn body_bytes(&self) -> usize {
        let headers = IP_UDP_BYTES + header_bytes(self.extended);
        self.packet_size.saturating_sub(headers).max(1)
    }

    /// Packets of the block, leader and trailer included.
    pub fn packets(&self) -> u32 {
        self.image.len().div_ceil(self.body_bytes()) as u32 + 2
    }

    /// Whether a number of 16 or 64 bits is this block's.
    pub fn is(&self, id: u64, extended: bool) -> bool {
        if extended { self.id == id } else { u64::from(short_id(self.id)) == id }
    }

    /// Writes a packet, one of [`Self::packets`].
    pub fn packet(&self, number: u32, out: &mut Vec<u8>) {
        out.clear();
        if number == 0 {
            header(out, 0, Kind::Leader, self.id, number, self.extended);
            out.extend([[0, 0], IMAGE.to_be_bytes()].as_flattened());
            out.extend(self.timestamp.to_be_bytes());
            let Region { x, y, width, height } = self.region;
            let words = [self.pixel_format, width, height, x, y, 0];
            out.extend(words.map(u32::to_be_bytes).as_flattened());
        } else if number + 1 == self.packets() {
            header(out, 0, Kind::Trailer, self.id, number, self.extended);
            out.extend([[0, 0], IMAGE.to_be_bytes()].as_flattened());
            out.extend(self.region.height.to_be_bytes());
        } else {
            header(out, 0, Kind::Payload, self.id, number, self.extended);
            let bytes = self.body_bytes();
            let start = (number as usize - 1) * bytes;
            let end = self.image.len().min(start + bytes);
            out.extend(self.image.get(start..end).unwrap_or_default());
        }
    }
}

/// Says that a packet that was asked for is no longer in memory.
pub fn unavailable(out: &mut Vec<u8>, id: u64, packet: u32, extended: bool) {
    out.clear();
    header(out, Status::PacketUnavailable as u16, Kind::Payload, id, packet, extended);
}

fn header(out: &mut Vec<u8>, status: u16, kind: Kind, id: u64, packet: u32, extended: bool) {
    out.extend(status.to_be_bytes());
    if extended {
        out.extend([0, 0]);
        out.extend((0x8000_0000 | kind.code() << 24).to_be_bytes());
        out.extend(id.to_be_bytes());
        out.extend(packet.to_be_bytes());
    } else {
        out.extend(short_id(id).to_be_bytes());
        out.extend((kind.code() << 24 | packet & 0xff_ffff).to_be_bytes());
    }
}

/// A packet as a receiver reads it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet<'a> {
    /// 0, or why there is no content.
    pub status: u16,
    /// Number of the block, 16 bits of it without extended ids.
    pub block: u64,
    /// Number of the packet in the block.
    pub number: u32,
    /// What it is.
    pub kind: Kind,
    /// Its content.
    pub body: &'a [u8],
}

/// Reads a packet; `None` for a datagram that is none.
pub fn parse(datagram: &[u8]) -> Option<Packet<'_>> {
    let &[s0, s1, b0, b1, kind, ref number @ ..] = datagram.first_chunk::<8>()?;
    let [n0, n1, n2] = *number;
    let extended = kind & 0x80 != 0;
    let (kind, _) = *Kind::ALL.iter().find(|(_, code)| *code == kind & 0x7f)?;
    let body = datagram.get(header_bytes(extended)..)?;
    let (block, number) = match extended {
        true => (
            u64::from_be_bytes(*datagram.get(8..)?.first_chunk()?),
            u32::from_be_bytes(*datagram.get(16..)?.first_chunk()?),
        ),
        false => (u16::from_be_bytes([b0, b1]).into(), u32::from_be_bytes([0, n0, n1, n2])),
    };
    Some(Packet { status: u16::from_be_bytes([s0, s1]), block, number, kind, body })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(extended: bool) -> Block {
        let region = Region { x: 2, y: 4, width: 8, height: 3 };
        let (packet_size, pixel_format) = (46, 0x0108_0009);
        let image = (0..24).collect();
        Block { id: 0x1_0000, extended, timestamp: 5, pixel_format, region, image, packet_size }
    }

    #[test]
    fn a_block_is_a_leader_its_bytes_and_a_trailer() {
        let block = block(false);
        // 46 - 28 - 8 = 10 bytes of 24 in each.
        assert_eq!(block.packets(), 5);
        let mut out = Vec::new();
        block.packet(0, &mut out);
        let mut leader = vec![0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 5];
        leader.extend([1, 8, 0, 9, 0, 0, 0, 8, 0, 0, 0, 3, 0, 0, 0, 2, 0, 0, 0, 4, 0, 0, 0, 0]);
        assert_eq!(out, leader, "of 0x10000 the 16 bits skip 0");
        block.packet(3, &mut out);
        assert_eq!(out, [0, 0, 0, 1, 3, 0, 0, 3, 20, 21, 22, 23]);
        block.packet(4, &mut out);
        assert_eq!(out, [0, 0, 0, 1, 2, 0, 0, 4, 0, 0, 0, 1, 0, 0, 0, 3]);
        assert!(block.is(1, false) && !block.is(0x1_0000, false) && block.is(0x1_0000, true));
    }

    #[test]
    fn extended_ids_have_64_and_32_bits() {
        let block = Block { packet_size: 58, ..block(true) };
        let mut out = Vec::new();
        block.packet(1, &mut out);
        let header = [0, 0, 0, 0, 0x83, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1];
        assert_eq!((&out[..20], &out[20..]), (&header[..], &(0..10).collect::<Vec<_>>()[..]));
        let read = parse(&out).unwrap();
        assert_eq!((read.block, read.number, read.kind), (0x1_0000, 1, Kind::Payload));
        unavailable(&mut out, 7, 2, false);
        assert_eq!(out, [0x80, 0x0C, 0, 7, 3, 0, 0, 2]);
    }

    #[test]
    fn every_packet_is_read_back() {
        for extended in [false, true] {
            let (block, mut out, mut image) = (block(extended), Vec::new(), Vec::<u8>::new());
            for number in 0..block.packets() {
                block.packet(number, &mut out);
                let read = parse(&out).unwrap();
                assert_eq!((read.status, read.number), (0, number));
                if read.kind == Kind::Payload {
                    assert!(out.len() <= block.packet_size.max(49) - IP_UDP_BYTES);
                    image.extend(read.body);
                }
            }
            assert_eq!(image, block.image);
        }
        assert_eq!(parse(&[0; 7]), None);
        assert_eq!(parse(&[0, 0, 0, 1, 9, 0, 0, 0]), None, "no such kind");
        assert_eq!(parse(&[0, 0, 0, 1, 0x81, 0, 0, 0]), None, "shorter than its header");
    }
}
