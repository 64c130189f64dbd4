//! Packets damaged as a link damages them, for tests of receivers.

use super::packet::{Found, Packets, Writer};
use super::{RAW, data_type};
use camrig_base::{Error, Result};

/// What happens to a packet of a frame. Rows are image lines, counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// One bit of the header of a row's packet is inverted, which its code corrects.
    HeaderBit(u32),
    /// Two bits of it, which the code finds and cannot correct: the packet is lost.
    HeaderBits(u32),
    /// A bit of a row's samples is inverted: its checksum does not hold.
    Checksum(u32),
    /// A row's packet is missing.
    NoPacket(u32),
    /// A row ends after half of its bytes, in a sound packet.
    Short(u32),
    /// The header of a row's packet, whose code holds, states more bytes than there are.
    WordCount(u32),
    /// A row's packet is on the next virtual channel.
    VirtualChannel(u32),
    /// A row's packet has the data type of another image format.
    DataType(u32),
    /// The Frame Start packet is missing.
    NoFrameStart,
    /// The Frame End packet is missing.
    NoFrameEnd,
}

impl Damage {
    /// The row it happens to.
    pub fn row(self) -> Option<u32> {
        match self {
            Self::HeaderBit(row)
            | Self::HeaderBits(row)
            | Self::Checksum(row)
            | Self::NoPacket(row)
            | Self::Short(row)
            | Self::WordCount(row)
            | Self::VirtualChannel(row)
            | Self::DataType(row) => Some(row),
            Self::NoFrameStart | Self::NoFrameEnd => None,
        }
    }
}

/// The packets of a frame of one virtual channel with damage to some of them, in its order.
///
/// # Errors
/// Bytes that are no sound packets.
pub fn damage(frame: &[u8], damages: &[Damage]) -> Result<Vec<u8>> {
    let mut writer = Writer::default();
    let mut rows = 0;
    for found in Packets::new(frame) {
        let Found { at, packet: Some(packet), fault: None } = found else {
            return Err(Error::internal("packets that were written are not sound"));
        };
        let begin = writer.bytes.len();
        let is_row = RAW.iter().any(|raw| raw.data_type == packet.data_type);
        writer.bytes.extend(&frame[at..at + packet.bytes()]);
        for &damage in damages {
            let of_frame = match damage {
                Damage::NoFrameStart => packet.data_type == data_type::FRAME_START,
                Damage::NoFrameEnd => packet.data_type == data_type::FRAME_END,
                _ => is_row && damage.row() == Some(rows),
            };
            if of_frame {
                act(damage, &mut writer, begin)?;
            }
        }
        rows += u32::from(is_row);
    }
    Ok(writer.bytes)
}

/// Does one thing to the packet that begins at a place and is the last.
fn act(damage: Damage, writer: &mut Writer, begin: usize) -> Result<()> {
    let Some(&[id, low, high, _]) = writer.bytes[begin..].first_chunk() else {
        return Ok(()); // taken out before
    };
    let (virtual_channel, data_type) = (id >> 6, id & 0x3F);
    let length = u16::from_le_bytes([low, high]);
    match damage {
        Damage::HeaderBit(_) => writer.bytes[begin + 1] ^= 1,
        Damage::HeaderBits(_) => writer.bytes[begin + 1] ^= 3,
        Damage::Checksum(_) => writer.bytes[begin + 4 + usize::from(length) / 2] ^= 1,
        Damage::NoPacket(_) | Damage::NoFrameStart | Damage::NoFrameEnd => {
            writer.bytes.truncate(begin);
        }
        Damage::Short(_) => {
            let end = begin + 4 + usize::from(length / 2);
            let payload = writer.bytes[begin + 4..end].to_vec();
            writer.bytes.truncate(begin);
            writer.long(virtual_channel, data_type, &payload)?;
        }
        Damage::WordCount(_) => {
            writer.header(begin, virtual_channel, data_type, length.saturating_add(16));
        }
        Damage::VirtualChannel(_) => {
            writer.header(begin, (virtual_channel + 1) % 4, data_type, length);
        }
        Damage::DataType(_) => {
            let at = RAW.iter().position(|raw| raw.data_type == data_type).unwrap_or_default();
            let other = RAW[(at + 1) % RAW.len()].data_type;
            writer.header(begin, virtual_channel, other, length);
        }
    }
    Ok(())
}
