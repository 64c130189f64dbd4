//! Framing: how packets are told apart on a link.
//!
//! * [`Framing::Cobs`] for byte streams that may lose or damage bytes (serial lines): consistent
//!   overhead byte stuffing, packets end with a zero byte. After any damage the next zero
//!   byte begins a new packet. Costs at most 1 byte in 254, and 2 bytes.
//! * [`Framing::Length`] for byte streams that lose nothing (TCP, pipes): a 4-byte length before each
//!   packet. A length that cannot be right means that the two ends are not in step:
//!   [`OutOfStep`], after which only a new connection helps.
//! * [`Framing::Report`] for HID: fixed-size reports, each with a two-byte little-endian head (bit 15:
//!   first of a packet, bit 14: last, bits 0..14: bytes used). A lost report spoils its packet only.

/// How packets are told apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Framing {
    /// COBS with zero bytes between packets.
    Cobs,
    /// A `u32` length before each packet.
    Length,
    /// Reports of this many bytes (at least 3).
    Report(u16),
}

const FIRST: u16 = 0x8000;
const LAST: u16 = 0x4000;
const USED: u16 = 0x3fff;
const REPORT_HEAD: usize = 2;
const LENGTH_HEAD: usize = 4;

/// A length came that no packet has: the ends of a loss-free stream are not in step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutOfStep;

impl Framing {
    /// Bytes that a packet of `packet` bytes takes at most on the link.
    pub const fn max_encoded(self, packet: usize) -> usize {
        match self {
            // One code byte per 254, one more at the start; a delimiter before and after.
            Framing::Cobs => packet + packet / 254 + 3,
            Framing::Length => packet + LENGTH_HEAD,
            Framing::Report(size) => packet.div_ceil(size as usize - REPORT_HEAD) * size as usize,
        }
    }

    /// Writes a packet as it goes over the link and returns the number of bytes.
    ///
    /// # Panics
    /// If `out` is shorter than [`Framing::max_encoded`].
    pub fn encode(self, packet: &[u8], out: &mut [u8]) -> usize {
        match self {
            Framing::Cobs => {
                let n = cobs::encode(packet, out);
                out[n] = 0;
                n + 1
            }
            Framing::Length => {
                let (head, rest) = out.split_at_mut(LENGTH_HEAD);
                head.copy_from_slice(&(packet.len() as u32).to_le_bytes());
                rest[..packet.len()].copy_from_slice(packet);
                LENGTH_HEAD + packet.len()
            }
            Framing::Report(size) => {
                let room = size as usize - REPORT_HEAD;
                let count = packet.len().div_ceil(room);
                let reports = out.chunks_exact_mut(size as usize);
                for (i, (chunk, report)) in packet.chunks(room).zip(reports).enumerate() {
                    let first = if i == 0 { FIRST } else { 0 };
                    let last = if i + 1 == count { LAST } else { 0 };
                    let head = first | last | chunk.len() as u16;
                    report[..REPORT_HEAD].copy_from_slice(&head.to_le_bytes());
                    report[REPORT_HEAD..][..chunk.len()].copy_from_slice(chunk);
                    report[REPORT_HEAD + chunk.len()..].fill(0);
                }
                count * size as usize
            }
        }
    }
}

/// Puts packets together from received bytes, in a buffer of fixed size. Longer packets are dropped.
#[derive(Debug)]
pub struct Receiver<B> {
    framing: Framing,
    buffer: B,
    filled: usize,
    /// Skip to the next packet's beginning: the present one is damaged or too long.
    skipping: bool,
    /// Where in the buffer the last whole packet lies.
    packet: (usize, usize),
}

impl<B: AsMut<[u8]>> Receiver<B> {
    /// A receiver; `buffer` must hold [`Framing::max_encoded`] of the longest packet.
    pub fn new(framing: Framing, buffer: B) -> Self {
        Self { framing, buffer, filled: 0, skipping: false, packet: (0, 0) }
    }

    /// The packet that [`Receiver::push`] has completed, not yet checked; until the next push.
    pub fn packet(&mut self) -> &[u8] {
        &self.buffer.as_mut()[self.packet.0..self.packet.1]
    }

    /// Takes bytes from the front of `input` until a packet is whole, and says whether one is; if not,
    /// the input is used up.
    pub fn push(&mut self, input: &mut &[u8]) -> Result<bool, OutOfStep> {
        let whole = match self.framing {
            Framing::Cobs => self.push_cobs(input),
            Framing::Length => self.push_length(input)?,
            Framing::Report(size) => self.push_report(input, size as usize),
        };
        self.packet = whole.unwrap_or((0, 0));
        Ok(whole.is_some())
    }

    fn push_cobs(&mut self, input: &mut &[u8]) -> Option<(usize, usize)> {
        let buffer = self.buffer.as_mut();
        while !input.is_empty() {
            let zero = input.iter().position(|&b| b == 0);
            let (run, rest) = input.split_at(zero.unwrap_or(input.len()));
            let room = buffer.len() - self.filled;
            self.skipping |= run.len() > room;
            if !self.skipping {
                buffer[self.filled..][..run.len()].copy_from_slice(run);
                self.filled += run.len();
            }
            *input = rest;
            if zero.is_some() {
                *input = &rest[1..];
                let encoded = core::mem::take(&mut self.filled);
                if !core::mem::take(&mut self.skipping)
                    && encoded > 0
                    && let Ok(n) = cobs::decode_in_place(&mut buffer[..encoded])
                {
                    return Some((0, n));
                }
            }
        }
        None
    }

    fn push_length(&mut self, input: &mut &[u8]) -> Result<Option<(usize, usize)>, OutOfStep> {
        let buffer = self.buffer.as_mut();
        loop {
            let wanted = if self.filled < LENGTH_HEAD {
                LENGTH_HEAD
            } else {
                let head = [buffer[0], buffer[1], buffer[2], buffer[3]];
                let body = u32::from_le_bytes(head) as usize;
                if body > buffer.len() - LENGTH_HEAD {
                    return Err(OutOfStep);
                }
                LENGTH_HEAD + body
            };
            let take = (wanted - self.filled).min(input.len());
            buffer[self.filled..][..take].copy_from_slice(&input[..take]);
            *input = &input[take..];
            self.filled += take;
            if self.filled < wanted {
                return Ok(None);
            }
            if wanted > LENGTH_HEAD {
                self.filled = 0;
                return Ok(Some((LENGTH_HEAD, wanted)));
            }
            if buffer[..LENGTH_HEAD] == [0; LENGTH_HEAD] {
                self.filled = 0; // An empty packet is no packet.
            }
        }
    }

    fn push_report(&mut self, input: &mut &[u8], size: usize) -> Option<(usize, usize)> {
        let buffer = self.buffer.as_mut();
        while input.len() >= size {
            let (report, rest) = input.split_at(size);
            *input = rest;
            let head = u16::from_le_bytes([report[0], report[1]]);
            let used = (head & USED) as usize;
            if head & FIRST != 0 {
                (self.filled, self.skipping) = (0, false);
            }
            if used > size - REPORT_HEAD || self.filled + used > buffer.len() {
                self.skipping = true;
            }
            if self.skipping {
                continue;
            }
            buffer[self.filled..][..used].copy_from_slice(&report[REPORT_HEAD..][..used]);
            self.filled += used;
            if head & LAST != 0 {
                self.skipping = true; // Until the next first report.
                return Some((0, self.filled));
            }
        }
        *input = &[]; // Half a report is no report.
        None
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec::Vec;

    fn packets() -> Vec<Vec<u8>> {
        let bytes = |n: usize| (0..n).map(|i| (i * i % 7) as u8).collect();
        [1, 12, 61, 62, 63, 124, 253, 254, 255, 508, 1000].into_iter().map(bytes).collect()
    }

    #[test]
    fn packets_come_back_whole_however_the_bytes_are_cut() {
        for framing in [Framing::Cobs, Framing::Length, Framing::Report(64), Framing::Report(1024)]
        {
            let mut link = Vec::new();
            for packet in packets() {
                let mut out = std::vec![0xaa; framing.max_encoded(packet.len())];
                let n = framing.encode(&packet, &mut out);
                link.extend_from_slice(&out[..n]);
            }
            let cuts = match framing {
                Framing::Report(size) => std::vec![size as usize, link.len()],
                _ => std::vec![1, 7, link.len()],
            };
            for cut in cuts {
                let mut receiver = Receiver::new(framing, [0; 1100]);
                let mut got = Vec::new();
                for mut chunk in link.chunks(cut) {
                    while receiver.push(&mut chunk).unwrap() {
                        got.push(receiver.packet().to_vec());
                    }
                }
                assert_eq!(got, packets(), "{framing:?} cut {cut}");
            }
        }
    }

    #[test]
    fn an_overlong_packet_is_dropped_and_the_next_one_heard() {
        for framing in [Framing::Cobs, Framing::Report(64)] {
            let mut link = [0; 1500];
            let mut n = framing.encode(&[5; 1000], &mut link);
            n += framing.encode(&[6; 20], &mut link[n..]);
            let mut receiver = Receiver::new(framing, [0; 100]);
            let mut input = &link[..n];
            assert!(receiver.push(&mut input).unwrap());
            assert_eq!(receiver.packet(), [6; 20], "{framing:?}");
        }
        let mut receiver = Receiver::new(Framing::Length, [0; 100]);
        assert_eq!(receiver.push(&mut &[0xff, 0xff, 0xff, 0x7f][..]), Err(OutOfStep));
    }

    #[test]
    fn a_lost_report_spoils_its_packet_only() {
        let framing = Framing::Report(64);
        let mut link = [0; 640];
        let first = framing.encode(&[5; 200], &mut link);
        let n = first + framing.encode(&[6; 20], &mut link[first..]);
        for lost in 0..first / 64 {
            let mut receiver = Receiver::new(framing, [0; 300]);
            let mut whole = Vec::new();
            for (i, mut report) in link[..n].chunks(64).enumerate() {
                if i != lost && receiver.push(&mut report).unwrap() {
                    whole.push(receiver.packet().to_vec());
                }
            }
            // What is left of the first packet may come out short; its CRC then says no.
            assert_eq!(whole.last().unwrap(), &[6; 20]);
            assert!(whole.iter().all(|p| p != &[5; 200]));
        }
    }
}
