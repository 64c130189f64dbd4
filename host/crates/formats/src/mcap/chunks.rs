//! Compressed chunks of a recording, unpacked before anything else looks into them: what they
//! hold is then checked like the rest.

use crate::{MCAP_MAGIC, gzip};
use camrig_base::{Error, Result};
use mcap::records::op;
use std::io::Read;

/// Bytes of an opcode and a length.
const HEAD: usize = 9;
/// Bytes of a chunk's times, size and checksum, in front of the name of its compression.
const FIXED: usize = 28;

/// A chunk's fields (MCAP specification, "Chunk").
struct Chunk<'a> {
    /// Times, size and checksum of what it holds.
    fixed: &'a [u8],
    compression: &'a [u8],
    records: &'a [u8],
}

impl<'a> Chunk<'a> {
    fn of(record: &'a [u8]) -> Option<Self> {
        let (fixed, rest) = record.split_at_checked(FIXED)?;
        let (length, rest) = rest.split_first_chunk()?;
        let (compression, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
        let (length, rest) = rest.split_first_chunk()?;
        let records = rest.get(..usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
        Some(Self { fixed, compression, records })
    }

    /// The records, of which there are as many bytes as the chunk states, `room` at most.
    fn unpacked(&self, room: usize) -> Result<Vec<u8>> {
        let stated = u64::from_le_bytes(std::array::from_fn(|i| self.fixed[16 + i]));
        let name = String::from_utf8_lossy(self.compression);
        let failed = |e: &dyn std::fmt::Display| {
            Error::input(format!("a chunk of an MCAP recording is no {name}: {e}"))
                .help("the recording is damaged")
        };
        if stated > room as u64 {
            return Err(Error::limit(format!(
                "more than {} bytes in an MCAP recording, unpacked",
                gzip::LARGEST
            )));
        }
        let mut bytes = Vec::new();
        let read = match &*name {
            "zstd" => ruzstd::decoding::StreamingDecoder::new(self.records)
                .map_err(|e| failed(&e))?
                .take(stated + 1)
                .read_to_end(&mut bytes),
            "lz4" => lz4_flex::frame::FrameDecoder::new(self.records)
                .take(stated + 1)
                .read_to_end(&mut bytes),
            _ => {
                return Err(Error::unsupported(format!(
                    "an MCAP recording compressed by {name:?}"
                ))
                .help("read are zstd and lz4: `mcap compress --compression none` unpacks it"));
            }
        };
        read.map_err(|e| failed(&e))?;
        if bytes.len() as u64 != stated {
            return Err(failed(&format!("{stated} bytes are stated, {} come", bytes.len())));
        }
        Ok(bytes)
    }
}

/// The recording with its chunks unpacked and without what follows the data, whose places would
/// not be right; `None` where nothing is compressed.
///
/// # Errors
/// A chunk that cannot be unpacked, or data that do not agree with their checksum.
pub(super) fn unpacked(bytes: &[u8]) -> Result<Option<Vec<u8>>> {
    let mut rest = bytes.get(MCAP_MAGIC.len()..).unwrap_or_default();
    let (mut out, mut found) = (MCAP_MAGIC.to_vec(), false);
    while let Some((head, after)) = rest.split_at_checked(HEAD) {
        let length = u64::from_le_bytes(std::array::from_fn(|i| head[1 + i]));
        let record = usize::try_from(length).ok().and_then(|n| after.split_at_checked(n));
        let Some((record, next)) = record else { break };
        match Chunk::of(record).filter(|_| head[0] == op::CHUNK) {
            _ if head[0] == op::DATA_END => {
                check_data(&bytes[..bytes.len() - rest.len()], record)?;
                break;
            }
            Some(chunk) if !chunk.compression.is_empty() => {
                found = true;
                let records = chunk.unpacked(gzip::LARGEST.saturating_sub(out.len()))?;
                put_chunk(&mut out, &Chunk { compression: b"", records: &records, ..chunk });
            }
            _ => put(&mut out, head[0], record),
        }
        rest = next;
    }
    // Without checksum, and without a summary.
    put(&mut out, op::DATA_END, &[0; 4]);
    put(&mut out, op::FOOTER, &[0; 20]);
    out.extend(MCAP_MAGIC);
    Ok(found.then_some(out))
}

/// Checks all bytes before the end of the data by the CRC-32 that is stated there; 0 states none.
fn check_data(before: &[u8], end: &[u8]) -> Result<()> {
    let stated = end.first_chunk().map_or(0, |crc| u32::from_le_bytes(*crc));
    if stated == 0 || stated == crc32fast::hash(before) {
        return Ok(());
    }
    Err(Error::input("the data of an MCAP recording do not agree with their CRC")
        .help("the recording is damaged"))
}

fn put(out: &mut Vec<u8>, opcode: u8, record: &[u8]) {
    out.push(opcode);
    out.extend((record.len() as u64).to_le_bytes());
    out.extend(record);
}

fn put_chunk(out: &mut Vec<u8>, chunk: &Chunk) {
    let name_bytes = (chunk.compression.len() as u32).to_le_bytes();
    let bytes = (chunk.records.len() as u64).to_le_bytes();
    let fields = [chunk.fixed, &name_bytes, chunk.compression, &bytes, chunk.records];
    put(out, op::CHUNK, &fields.concat());
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use std::io::Write;

    /// A recording with each message in a chunk that is compressed by `packing`.
    pub fn packed(plain: &[u8], packing: &str) -> Vec<u8> {
        let (mut rest, mut out) = (&plain[MCAP_MAGIC.len()..], MCAP_MAGIC.to_vec());
        while rest.len() > HEAD {
            let length = u64::from_le_bytes(std::array::from_fn(|i| rest[1 + i])) as usize;
            let (record, next) = rest.split_at(HEAD + length);
            if record[0] == op::MESSAGE {
                let records = compressed(record, packing);
                // Two times, the length when unpacked, the checksum.
                let crc = crc32fast::hash(record).to_le_bytes();
                let fixed = [&[0; 16][..], &(record.len() as u64).to_le_bytes(), &crc].concat();
                let compression = packing.as_bytes();
                put_chunk(&mut out, &Chunk { fixed: &fixed, compression, records: &records });
            } else if record[0] == op::DATA_END {
                // No checksum of the data, which are others now.
                put(&mut out, op::DATA_END, &[0; 4]);
            } else {
                out.extend(record);
            }
            rest = next;
        }
        out.extend(rest);
        out
    }

    fn compressed(bytes: &[u8], packing: &str) -> Vec<u8> {
        match packing {
            "zstd" => {
                let level = ruzstd::encoding::CompressionLevel::Fastest;
                ruzstd::encoding::compress_to_vec(bytes, level)
            }
            "lz4" => {
                let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
                encoder.write_all(bytes).unwrap();
                encoder.finish().unwrap()
            }
            _ => bytes.to_vec(),
        }
    }
}
