//! Framing: how packets are separated on a link.
//!
//! * [`Framing::Cobs`] for byte streams that may lose or damage bytes (serial lines): consistent
//!   overhead byte stuffing (COBS; Cheshire & Baker 1999), packets end with a zero byte. After any
//!   damage the next zero byte begins a new packet. It costs at most 1 byte in 254, and 2 bytes
//!   per packet.
//! * [`Framing::Length`] for byte streams that lose nothing (TCP, pipes): a 4-byte length before
//!   each packet. An impossible length means that the two ends are out of step: [`OutOfStep`],
//!   after which only a new connection helps.
//! * [`Framing::Report`] for USB HID: reports of fixed size that may be lost. Packets follow one
//!   another through the reports, each after a two-byte length. Each report begins with a pointer
//!   to the first packet that begins in it (as MPEG-2 transport packets and the M_PDU of CCSDS
//!   732.0-B do), so after a lost report the next packet is found. Only a flush leaves part of a
//!   report unused.

use core::ffi::CStr;
use core::fmt;

/// How packets are separated. Lengths are little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Framing {
    /// COBS with zero bytes between packets.
    Cobs,
    /// A `u32` length before each packet.
    Length,
    /// Reports of this many bytes (at least 8).
    Report(u16),
}

/// Bytes of the length before a packet in [`Framing::Length`].
const LENGTH_HEAD: usize = 4;
/// Bytes of the length before a packet in reports; a length of 0: no more packets begin in this
/// report.
const REPORT_LENGTH: usize = 2;

/// Bytes of the pointer at the front of a report of `size` bytes.
const fn pointer_bytes(size: usize) -> usize {
    if size <= 255 { 1 } else { 2 }
}

/// Pointer of a report in which no packet begins: an offset that no report has.
const fn no_beginning(size: usize) -> usize {
    if size <= 255 { 0xff } else { 0xffff }
}

/// A length that no packet can have was received: the ends of a loss-free stream are out of step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutOfStep;

impl fmt::Display for OutOfStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(
            "a packet's length on the stream is impossible, so the ends are out of step: open a \
             new connection, and check that both ends use the same framing",
        )
    }
}

impl core::error::Error for OutOfStep {}

impl Framing {
    /// Largest number of bytes on the link for a packet of `packet` bytes that is sent alone.
    pub const fn max_encoded(self, packet: usize) -> usize {
        match self {
            // One code byte per 254, one more at the start; the delimiter.
            Framing::Cobs => packet + packet / 254 + 2,
            Framing::Length => packet + LENGTH_HEAD,
            Framing::Report(size) => {
                let size = size as usize;
                (packet + REPORT_LENGTH).div_ceil(size - pointer_bytes(size)) * size
            }
        }
    }
}

/// Encodes packets for the link, and collects them in a buffer until it is full or
/// [`Sender::flush`] is called.
#[derive(Debug)]
pub struct Sender<B> {
    framing: Framing,
    buffer: B,
    filled: usize,
}

impl<B: AsMut<[u8]>> Sender<B> {
    /// A sender; `buffer` must hold [`Framing::max_encoded`] of the longest packet, or at least
    /// one report.
    pub fn new(framing: Framing, buffer: B) -> Self {
        Self { framing, buffer, filled: 0 }
    }

    /// Appends a packet; when the buffer is full its bytes go to `write`, in whole reports.
    ///
    /// # Errors
    /// Those of `write`.
    ///
    /// # Panics
    /// If the buffer is shorter than [`Sender::new`] asks.
    pub fn push<E>(
        &mut self,
        packet: &[u8],
        mut write: impl FnMut(&[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        if let Framing::Report(size) = self.framing {
            return self.push_reports(packet, size.into(), write);
        }
        if self.framing.max_encoded(packet.len()) > self.buffer.as_mut().len() - self.filled {
            self.flush(&mut write)?;
        }
        let out = &mut self.buffer.as_mut()[self.filled..];
        self.filled += if self.framing == Framing::Cobs {
            let n = cobs::encode(packet, out);
            out[n] = 0;
            n + 1
        } else {
            let (head, rest) = out.split_at_mut(LENGTH_HEAD);
            head.copy_from_slice(&(packet.len() as u32).to_le_bytes());
            rest[..packet.len()].copy_from_slice(packet);
            LENGTH_HEAD + packet.len()
        };
        Ok(())
    }

    /// Where the next packet, of at most `bytes`, can be made so that [`Sender::push_placed`] sends
    /// it without a copy: in [`Framing::Length`] alone, which changes no byte of a packet.
    ///
    /// # Errors
    /// Those of `write`, which takes what no longer has room.
    pub fn place<E>(
        &mut self,
        bytes: usize,
        write: impl FnMut(&[u8]) -> Result<(), E>,
    ) -> Result<Option<&mut [u8]>, E> {
        if self.framing != Framing::Length {
            return Ok(None);
        }
        if self.framing.max_encoded(bytes) > self.buffer.as_mut().len() - self.filled {
            self.flush(write)?;
        }
        let start = self.filled + LENGTH_HEAD;
        Ok(self.buffer.as_mut().get_mut(start..start + bytes))
    }

    /// Appends the packet of `bytes` bytes that was made in [`Sender::place`].
    pub fn push_placed(&mut self, bytes: usize) {
        let head = &mut self.buffer.as_mut()[self.filled..][..LENGTH_HEAD];
        head.copy_from_slice(&(bytes as u32).to_le_bytes());
        self.filled += LENGTH_HEAD + bytes;
    }

    fn push_reports<E>(
        &mut self,
        packet: &[u8],
        size: usize,
        mut write: impl FnMut(&[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let buffer = self.buffer.as_mut();
        let whole = buffer.len() / size * size;
        let pointer = pointer_bytes(size);
        // A length is not split.
        if size - self.filled % size < REPORT_LENGTH {
            buffer[self.filled] = 0;
            self.filled += 1;
        }
        let length = (packet.len() as u16).to_le_bytes();
        let mut begins = true;
        for mut rest in [&length[..], packet] {
            while !rest.is_empty() {
                if self.filled == whole {
                    write(&buffer[..whole])?;
                    self.filled = 0;
                }
                let start = self.filled / size * size;
                if self.filled == start {
                    buffer[start..start + pointer].fill(0xff);
                    self.filled += pointer;
                }
                if core::mem::take(&mut begins)
                    && buffer[start..start + pointer] == [0xff; 2][..pointer]
                {
                    let place = (self.filled - start - pointer) as u16;
                    buffer[start..start + pointer]
                        .copy_from_slice(&place.to_le_bytes()[..pointer]);
                }
                let (now, later) = rest.split_at(rest.len().min(start + size - self.filled));
                buffer[self.filled..][..now.len()].copy_from_slice(now);
                self.filled += now.len();
                rest = later;
            }
        }
        Ok(())
    }

    /// Passes the contents of the buffer to `write`; a report in progress is filled up with zeros.
    ///
    /// # Errors
    /// Those of `write`.
    pub fn flush<E>(&mut self, mut write: impl FnMut(&[u8]) -> Result<(), E>) -> Result<(), E> {
        if let Framing::Report(size) = self.framing {
            let end = self.filled.next_multiple_of(size.into());
            self.buffer.as_mut()[self.filled..end].fill(0);
            self.filled = end;
        }
        match core::mem::take(&mut self.filled) {
            0 => Ok(()),
            filled => write(&self.buffer.as_mut()[..filled]),
        }
    }
}

/// Assembles packets from received bytes, in a buffer of fixed size. What is longer is no packet.
#[derive(Debug)]
pub struct Receiver<B> {
    framing: Framing,
    buffer: B,
    filled: usize,
    /// COBS: skip to the beginning of the next packet, as this one is too long.
    skipping: bool,
    /// Reports: length of the packet that is being received; 0 between packets.
    wanted: usize,
    /// Reports: bytes of the current report that are not yet used.
    left: usize,
    /// Start and end of the last complete packet in the buffer.
    packet: (usize, usize),
}

impl<B: AsMut<[u8]>> Receiver<B> {
    /// A receiver; `buffer` must hold [`Framing::max_encoded`] of the longest packet.
    pub fn new(framing: Framing, buffer: B) -> Self {
        Self { framing, buffer, filled: 0, skipping: false, wanted: 0, left: 0, packet: (0, 0) }
    }

    /// The packet that [`Receiver::push`] has completed, not yet checked; valid until the next
    /// push. Bytes between two zeros of [`Framing::Cobs`] that are no packet give an empty one.
    pub fn packet(&mut self) -> &[u8] {
        &self.buffer.as_mut()[self.packet.0..self.packet.1]
    }

    /// Takes bytes from the front of `input` until a packet is complete. Returns whether one is;
    /// if not, the whole input has been used. Inputs must hold whole reports.
    ///
    /// # Errors
    /// [`OutOfStep`], with [`Framing::Length`] only.
    pub fn push(&mut self, input: &mut &[u8]) -> Result<bool, OutOfStep> {
        let whole = match self.framing {
            Framing::Cobs => self.push_cobs(input),
            Framing::Length => self.push_length(input)?,
            Framing::Report(size) => self.push_report(input, size.into()),
        };
        self.packet = whole.unwrap_or((0, 0));
        Ok(whole.is_some())
    }

    /// Takes a packet that lies whole at the front of `input`, without a copy; `None` where there
    /// is none, and [`Receiver::push`] goes on: of [`Framing::Length`] alone, between packets.
    pub fn whole<'i>(&mut self, input: &mut &'i [u8]) -> Option<&'i [u8]> {
        if self.framing != Framing::Length || self.filled > 0 {
            return None;
        }
        let (head, rest) = input.split_first_chunk()?;
        let bytes = u32::from_le_bytes(*head) as usize;
        if bytes == 0 || bytes > self.buffer.as_mut().len() - LENGTH_HEAD {
            return None;
        }
        let (packet, rest) = rest.split_at_checked(bytes)?;
        *input = rest;
        Some(packet)
    }

    fn push_cobs(&mut self, input: &mut &[u8]) -> Option<(usize, usize)> {
        let buffer = self.buffer.as_mut();
        while !input.is_empty() {
            // The search of `CStr` looks at a word at a time, on small processors too.
            let zero = CStr::from_bytes_until_nul(input).ok().map(CStr::count_bytes);
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
                let too_long = core::mem::take(&mut self.skipping);
                if encoded > 0 || too_long {
                    // What no packet encodes to becomes an empty one, which counts as damaged.
                    let whole = if too_long { None } else { decode_cobs(&mut buffer[..encoded]) };
                    return Some((0, whole.unwrap_or(0)));
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
                self.filled = 0; // Ignore an empty packet.
            }
        }
    }

    fn push_report(&mut self, input: &mut &[u8], size: usize) -> Option<(usize, usize)> {
        let buffer = self.buffer.as_mut();
        let left = &mut self.left;
        loop {
            if *left > input.len() {
                // The rest of the report was not received.
                (*left, self.wanted, self.filled) = (0, 0, 0);
            }
            if *left == 0 {
                let Some((report, _)) = input.split_at_checked(size) else {
                    *input = &[]; // Ignore an incomplete report.
                    return None;
                };
                let (head, _) = report.split_at(pointer_bytes(size));
                let pointer = head.iter().rev().fold(0, |p, &byte| p << 8 | usize::from(byte));
                let to_come = self.wanted - self.filled;
                *input = &input[head.len()..];
                *left = size - head.len();
                let heard_all =
                    pointer == to_come || (pointer == no_beginning(size) && to_come > 0);
                if !heard_all {
                    // A report was lost: continue where the next packet begins.
                    (self.wanted, self.filled) = (0, 0);
                    skip(left, input, pointer);
                }
            }
            if self.wanted == 0 {
                let length = match input.first_chunk() {
                    Some(bytes) if *left >= REPORT_LENGTH => u16::from_le_bytes(*bytes).into(),
                    _ => 0,
                };
                if length == 0 || length > buffer.len() {
                    skip(left, input, usize::MAX);
                    continue;
                }
                skip(left, input, REPORT_LENGTH);
                (self.wanted, self.filled) = (length, 0);
            }
            let take = (*left).min(self.wanted - self.filled);
            buffer[self.filled..][..take].copy_from_slice(&input[..take]);
            self.filled += take;
            skip(left, input, take);
            if self.filled == self.wanted {
                let length = self.wanted;
                (self.wanted, self.filled) = (0, 0);
                return Some((0, length));
            }
        }
    }
}

/// Decodes COBS in place and returns the packet's length; `None` for what no packet encodes to. As
/// `cobs::decode_in_place`, but run by run and without a search for zeros: with the search above, a
/// Cortex-M4F needs 16 instructions for a byte that arrives instead of 27.
fn decode_cobs(bytes: &mut [u8]) -> Option<usize> {
    let (mut from, mut to) = (0, 0);
    while let Some(&code) = bytes.get(from) {
        let run = usize::from(code).checked_sub(1)?;
        bytes.get(from + 1..from + 1 + run)?;
        bytes.copy_within(from + 1..from + 1 + run, to);
        (from, to) = (from + 1 + run, to + run);
        if code < 0xff && from < bytes.len() {
            bytes[to] = 0;
            to += 1;
        }
    }
    Some(to)
}

/// Skips bytes of a report, of which `left` remain in the input.
fn skip(left: &mut usize, input: &mut &[u8], bytes: usize) {
    let bytes = bytes.min(*left);
    *input = &input[bytes..];
    *left -= bytes;
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

    /// What goes over the link for some packets.
    fn link_bytes(framing: Framing, packets: &[Vec<u8>], buffer: usize) -> Vec<u8> {
        let mut link = Vec::new();
        let mut write = |bytes: &[u8]| {
            link.extend_from_slice(bytes);
            Ok::<(), ()>(())
        };
        let mut sender = Sender::new(framing, std::vec![0xaa; buffer]);
        for packet in packets {
            sender.push(packet, &mut write).unwrap();
        }
        sender.flush(&mut write).unwrap();
        link
    }

    fn received(framing: Framing, link: &[u8], cut: usize) -> Vec<Vec<u8>> {
        let mut receiver = Receiver::new(framing, [0; 1100]);
        let mut got = Vec::new();
        for mut chunk in link.chunks(cut) {
            while receiver.push(&mut chunk).unwrap() {
                got.push(receiver.packet().to_vec());
            }
        }
        got
    }

    #[test]
    fn packets_come_back_whole_however_the_bytes_are_cut() {
        for (framing, buffers) in [
            (Framing::Cobs, [1100, 5000]),
            (Framing::Length, [1100, 5000]),
            (Framing::Report(8), [8, 500]),
            (Framing::Report(64), [64, 500]),
            (Framing::Report(1024), [1024, 5000]),
        ] {
            for buffer in buffers {
                let link = link_bytes(framing, &packets(), buffer);
                let cuts = match framing {
                    Framing::Report(size) => [size.into(), 2 * usize::from(size), link.len()],
                    _ => [1, 7, link.len()],
                };
                for cut in cuts {
                    assert_eq!(received(framing, &link, cut), packets(), "{framing:?} cut {cut}");
                }
            }
        }
    }

    #[test]
    fn runs_decode_as_the_crate_cobs_decodes_bytes() {
        let mut seed = 1u32;
        let mut next = |below: u32| {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            ((u64::from(seed) * u64::from(below)) >> 32) as u8
        };
        let (mut whole, mut damaged) = (0, 0);
        for round in 0..20_000 {
            // Few values and so short runs, or all of them; no zero, as those end a packet.
            let (length, values) = (1 + usize::from(next(200)), [4, 60, 255][round % 3]);
            let mut encoded: Vec<u8> = (0..length).map(|_| 1 + next(values)).collect();
            if round % 2 == 0 {
                let packet: Vec<u8> = encoded.iter().map(|b| b - 1).chain([9; 300]).collect();
                encoded = cobs_encoded(&packet);
            }
            let mut peer = encoded.clone();
            let want = cobs::decode_in_place(&mut peer).ok();
            let got = decode_cobs(&mut encoded);
            assert_eq!(got, want);
            let length = got.unwrap_or(0);
            assert_eq!(encoded[..length], peer[..length]);
            *(if got.is_some() { &mut whole } else { &mut damaged }) += 1;
        }
        assert!(whole > 10_000 && damaged > 1000, "{whole} {damaged}");
    }

    fn cobs_encoded(packet: &[u8]) -> Vec<u8> {
        let mut encoded = std::vec![0; Framing::Cobs.max_encoded(packet.len())];
        let length = cobs::encode(packet, &mut encoded);
        encoded.truncate(length);
        encoded
    }

    #[test]
    fn packets_made_in_place_and_taken_whole_are_the_same() {
        let mut link = Vec::new();
        let mut write = |bytes: &[u8]| {
            link.extend_from_slice(bytes);
            Ok::<(), ()>(())
        };
        let mut sender = Sender::new(Framing::Length, std::vec![0xaa; 1100]);
        for packet in packets() {
            let place = sender.place(1000, &mut write).unwrap().unwrap();
            place[..packet.len()].copy_from_slice(&packet);
            sender.push_placed(packet.len());
        }
        sender.flush(&mut write).unwrap();
        assert_eq!(link, link_bytes(Framing::Length, &packets(), 1100));
        assert!(
            Sender::new(Framing::Cobs, [0; 99]).place(9, |_| Ok::<(), ()>(())).unwrap().is_none()
        );
        for cut in [1, 7, 300, link.len()] {
            let mut receiver = Receiver::new(Framing::Length, [0; 1100]);
            let mut got = Vec::new();
            for mut chunk in link.chunks(cut) {
                loop {
                    if let Some(packet) = receiver.whole(&mut chunk) {
                        got.push(packet.to_vec());
                    } else if receiver.push(&mut chunk).unwrap() {
                        got.push(receiver.packet().to_vec());
                    } else {
                        break;
                    }
                }
            }
            assert_eq!(got, packets(), "cut {cut}");
        }
        // What looks like a packet inside one is not taken for one.
        let outer = [12, 0, 0, 0, 1, 1, 2, 0, 0, 0, 9, 9, 2, 0, 0, 0, 9, 9, 1, 1];
        let mut receiver = Receiver::new(Framing::Length, [0; 100]);
        let (mut head, mut rest) = outer.split_at(6);
        assert!(receiver.whole(&mut head).is_none() && !receiver.push(&mut head).unwrap());
        assert_eq!(receiver.whole(&mut rest), None);
        assert!(receiver.push(&mut rest).unwrap());
        assert_eq!((receiver.packet(), rest), (&outer[4..16], &outer[16..]));
        // Anything else is left for `push`, which reports it.
        let mut receiver = Receiver::new(Framing::Length, [0; 100]);
        assert_eq!(receiver.whole(&mut &[0xff, 0xff, 0xff, 0x7f, 1, 2][..]), None);
        assert_eq!(receiver.whole(&mut &[0; 9][..]), None);
    }

    /// One pointer byte of 64, two of 1024, two bytes of length for each packet, and no other room
    /// lost.
    #[test]
    fn reports_are_filled() {
        for (size, pointer) in [(64, 1), (1024, 2)] {
            let packets = std::vec![std::vec![7; 300]; 100];
            let reports =
                link_bytes(Framing::Report(size), &packets, 4096).len() / usize::from(size);
            let fewest = (100 * 302usize).div_ceil(usize::from(size) - pointer);
            // A length that does not fit a report's last byte moves to the next one.
            assert!((fewest..=fewest + 1).contains(&reports), "{reports} {fewest}");
        }
    }

    #[test]
    fn an_overlong_packet_is_dropped_and_the_next_one_heard() {
        for framing in [Framing::Cobs, Framing::Report(64)] {
            let link = link_bytes(framing, &[std::vec![5; 1000], std::vec![6; 20]], 1500);
            let mut receiver = Receiver::new(framing, [0; 100]);
            let mut input = &link[..];
            assert!(receiver.push(&mut input).unwrap());
            if framing == Framing::Cobs {
                // It is heard of, as damaged.
                assert_eq!(receiver.packet(), []);
                assert!(receiver.push(&mut input).unwrap());
            }
            assert_eq!(receiver.packet(), [6; 20], "{framing:?}");
        }
        let mut receiver = Receiver::new(Framing::Length, [0; 100]);
        assert_eq!(receiver.push(&mut &[0xff, 0xff, 0xff, 0x7f][..]), Err(OutOfStep));
    }

    /// Whatever byte is lost, the packet arrives as one that is counted as damaged.
    #[test]
    fn a_packet_that_lost_a_byte_is_heard_of() {
        let packet: Vec<u8> = (1..=80).map(|i| i % 9).collect();
        let whole = link_bytes(Framing::Cobs, std::slice::from_ref(&packet), 1000);
        for lost in 0..whole.len() - 1 {
            let mut link = whole.clone();
            link.remove(lost);
            let heard = received(Framing::Cobs, &link, link.len());
            assert!(!heard.is_empty() && !heard.contains(&packet), "byte {lost}");
        }
    }

    #[test]
    fn a_lost_report_spoils_the_packets_in_it_only() {
        let framing = Framing::Report(64);
        let link = link_bytes(framing, &packets(), 64);
        let reports = link.len() / 64;
        for lost in 0..reports {
            let mut rest = link.clone();
            rest.drain(lost * 64..(lost + 1) * 64);
            let got = received(framing, &rest, 64);
            // Where each packet lies, of 63 bytes per report.
            let mut at = 0;
            for packet in packets() {
                if 63 - at % 63 < 2 {
                    at += 1;
                }
                let end = at + 2 + packet.len();
                let touched = at / 63 <= lost && lost <= (end - 1) / 63;
                // What is left of a spoiled packet may decode to anything; its CRC then fails.
                assert!(touched || got.contains(&packet), "{} lost {lost}", packet.len());
                at = end;
            }
        }
    }

    #[test]
    fn a_report_that_ends_early_does_no_harm() {
        let framing = Framing::Report(64);
        let link = link_bytes(framing, &packets(), 64);
        let mut receiver = Receiver::new(framing, [0; 1100]);
        let mut input = &link[..128];
        assert!(receiver.push(&mut input).unwrap());
        // The rest of what was read is lost.
        let mut nothing = &[][..];
        assert!(!receiver.push(&mut nothing).unwrap());
        let mut input = &link[128..];
        let mut got = 0;
        while receiver.push(&mut input).unwrap() {
            got += 1;
        }
        assert!(got >= packets().len() - 4, "{got}");
    }
}
