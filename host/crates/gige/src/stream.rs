//! What the device sends: blocks packet by packet, with the delay between packets that the host
//! asks for, and packets once more as soon as they are asked for, also during a block.

use crate::gvcp::Resend;
use crate::gvsp::{self, Block, IP_UDP_BYTES};
use std::collections::VecDeque;
use std::time::Duration;

/// Blocks kept for repeats after they were sent: four, and as many more up to 64 as this memory
/// holds. A trade: hosts ask within 100 ms, at 30 frames/s for three blocks.
const MIN_KEPT_BLOCKS: usize = 4;
const MAX_KEPT_BLOCKS: usize = 64;
const KEPT_BYTES: usize = 64 << 20;
/// Blocks that may wait or be on their way. A trade: one is exposed while another is sent.
const MAX_WAITING: usize = 2;
/// Requests for repeats that may wait; further ones are ignored, and hosts ask again.
const MAX_REPEATS: usize = 256;

/// Packets so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Blocks begun.
    pub blocks: u64,
    /// Packets sent once more.
    pub repeated: u64,
    /// Packets not sent on request.
    pub lost: u64,
}

/// How packets are sent.
#[derive(Clone, Copy, Debug)]
pub struct Sending {
    /// Time from one packet to the next.
    pub delay: Duration,
    /// Share of the packets that are not sent, 0 to 1.
    pub loss: f64,
}

/// The blocks.
#[derive(Debug)]
pub struct Stream {
    /// The first is being sent.
    waiting: VecDeque<Block>,
    next_packet: u32,
    sent: VecDeque<Block>,
    repeats: VecDeque<Resend>,
    /// Bytes of a test packet.
    test: Option<usize>,
    /// When the next packet may be sent.
    due: Duration,
    draws: u64,
    pub counts: Counts,
}

impl Stream {
    /// Nothing to send.
    pub fn new() -> Self {
        Self {
            waiting: VecDeque::new(),
            next_packet: 0,
            sent: VecDeque::new(),
            repeats: VecDeque::new(),
            test: None,
            due: Duration::ZERO,
            draws: 1,
            counts: Counts::default(),
        }
    }

    /// Whether no further block can wait.
    pub fn is_full(&self) -> bool {
        self.waiting.len() >= MAX_WAITING
    }

    /// Adds a block.
    pub fn push(&mut self, block: Block) {
        self.waiting.push_back(block);
    }

    /// Drops the blocks that wait; the one being sent is finished.
    pub fn end(&mut self) {
        self.waiting.truncate(usize::from(self.next_packet > 0));
    }

    /// Drops everything.
    pub fn clear(&mut self) {
        (self.waiting, self.sent, self.repeats) = Default::default();
        (self.next_packet, self.test) = (0, None);
    }

    /// Packets to be sent once more.
    pub fn repeat(&mut self, request: Resend) {
        // No block has the number 0.
        let names_packets = request.block > 0 && request.first <= request.last;
        if names_packets && self.repeats.len() < MAX_REPEATS {
            self.repeats.push_back(request);
        }
    }

    /// A packet of this size, all headers counted.
    pub fn test(&mut self, packet_size: u32) {
        self.test = Some((packet_size as usize).saturating_sub(IP_UDP_BYTES));
    }

    /// Writes the next packet, and returns whether a block ends with it; else when there is one, if
    /// that is known.
    pub fn next(
        &mut self,
        now: Duration,
        sending: Sending,
        out: &mut Vec<u8>,
    ) -> Result<bool, Option<Duration>> {
        if let Some(bytes) = self.test.take() {
            out.clear();
            out.resize(bytes, 0);
            return Ok(false);
        }
        // Packets that are lost may be the last ones of blocks.
        let mut ends = false;
        loop {
            if self.repeats.is_empty() && self.waiting.is_empty() {
                return Err(None);
            }
            if now < self.due {
                return Err(Some(self.due));
            }
            ends |= !self.repeated(out) && self.packet(out);
            if self.draw() >= sending.loss {
                self.due = now + sending.delay;
                return Ok(ends);
            }
            self.counts.lost += 1;
        }
    }

    /// Writes the next packet that was asked for once more.
    fn repeated(&mut self, out: &mut Vec<u8>) -> bool {
        let Some(request) = self.repeats.front_mut() else { return false };
        let Resend { block, extended, first, last } = *request;
        let mut blocks = self.waiting.iter().chain(&self.sent);
        let found = blocks.find(|b| b.is(block, extended)).filter(|b| first < b.packets());
        let last = found.map_or(first, |b| last.min(b.packets() - 1));
        match found {
            Some(found) => found.packet(first, out),
            None => gvsp::unavailable(out, block, first, extended),
        }
        request.first += 1;
        if request.first > last {
            self.repeats.pop_front();
        }
        self.counts.repeated += 1;
        true
    }

    /// Writes the next packet of the block that is being sent, and returns whether it is the last.
    fn packet(&mut self, out: &mut Vec<u8>) -> bool {
        let Some(block) = self.waiting.front() else { return false };
        block.packet(self.next_packet, out);
        self.counts.blocks += u64::from(self.next_packet == 0);
        self.next_packet += 1;
        let ends = self.next_packet == block.packets();
        if ends {
            self.next_packet = 0;
            self.sent.extend(self.waiting.pop_front());
            self.forget();
        }
        ends
    }

    /// Forgets the oldest blocks.
    fn forget(&mut self) {
        let mut bytes: usize = self.sent.iter().map(|block| block.image.len()).sum();
        let mut count = self.sent.len();
        while count > MAX_KEPT_BLOCKS || (count > MIN_KEPT_BLOCKS && bytes > KEPT_BYTES) {
            count -= 1;
            bytes -= self.sent.pop_front().map_or(0, |block| block.image.len());
        }
    }

    /// A random number from 0 to 1 (xorshift64*): the same losses in every run.
    fn draw(&mut self) -> f64 {
        self.draws ^= self.draws >> 12;
        self.draws ^= self.draws << 25;
        self.draws ^= self.draws >> 27;
        (self.draws.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Region;
    use crate::gvsp::{Kind, parse};

    const AT_ONCE: Sending = Sending { delay: Duration::ZERO, loss: 0.0 };

    fn block(id: u64) -> Block {
        Block {
            id,
            extended: false,
            timestamp: 0,
            pixel_format: 0x0108_0001,
            region: Region { x: 0, y: 0, width: 10, height: 3 },
            image: vec![id as u8; 30],
            packet_size: 46,
        }
    }

    /// Numbers of the blocks and packets that are sent at a time.
    fn sent(stream: &mut Stream, now: Duration, sending: Sending) -> Vec<(u64, u32)> {
        let mut out = Vec::new();
        std::iter::from_fn(|| {
            stream.next(now, sending, &mut out).ok().map(|_| {
                let packet = parse(&out).unwrap();
                (packet.block, packet.number)
            })
        })
        .collect()
    }

    #[test]
    fn a_repeat_does_not_wait_for_the_end_of_the_block() {
        let mut stream = Stream::new();
        stream.push(block(1));
        assert_eq!(sent(&mut stream, Duration::ZERO, AT_ONCE).len(), 5);
        stream.push(block(2));
        let mut out = Vec::new();
        assert_eq!(stream.next(Duration::ZERO, AT_ONCE, &mut out), Ok(false));
        stream.repeat(Resend { block: 1, extended: false, first: 2, last: 3 });
        stream.repeat(Resend { block: 1, extended: false, first: 4, last: 0xff_ffff });
        stream.repeat(Resend { block: 1, extended: false, first: 3, last: 2 });
        let expected = [(1, 2), (1, 3), (1, 4), (2, 1), (2, 2), (2, 3), (2, 4)];
        assert_eq!(sent(&mut stream, Duration::ZERO, AT_ONCE), expected);
        assert_eq!(stream.counts, Counts { blocks: 2, repeated: 3, lost: 0 });
    }

    #[test]
    fn a_block_that_is_no_longer_there_is_told() {
        let mut stream = Stream::new();
        let large = Block { packet_size: 60_000, image: vec![0; KEPT_BYTES / 4], ..block(1) };
        for id in 1..=5 {
            stream.push(Block { id, ..large.clone() });
            sent(&mut stream, Duration::ZERO, AT_ONCE);
        }
        stream.repeat(Resend { block: 1, extended: false, first: 0, last: 4 });
        let mut out = Vec::new();
        assert_eq!(stream.next(Duration::ZERO, AT_ONCE, &mut out), Ok(false));
        let packet = parse(&out).unwrap();
        assert_eq!((packet.status, packet.block, packet.kind), (0x800C, 1, Kind::Payload));
        assert_eq!(stream.next(Duration::ZERO, AT_ONCE, &mut out), Err(None), "once for all");
    }

    #[test]
    fn packets_keep_their_distance() {
        let mut stream = Stream::new();
        stream.push(block(1));
        let sending = Sending { delay: Duration::from_micros(10), loss: 0.0 };
        let mut out = Vec::new();
        let mut times = Vec::new();
        for us in 0..50 {
            let now = Duration::from_micros(us);
            times.extend(stream.next(now, sending, &mut out).ok().map(|_| us));
        }
        assert_eq!(times, [0, 10, 20, 30, 40]);
    }

    /// Standard deviation of 10000 draws of 1 %: 10.
    #[test]
    fn losses_are_as_frequent_as_asked_for() {
        let mut stream = Stream::new();
        let sending = Sending { loss: 0.01, ..AT_ONCE };
        for id in 1..=2000 {
            stream.push(block(id));
            sent(&mut stream, Duration::ZERO, sending);
        }
        assert!(stream.counts.lost.abs_diff(100) < 50, "{:?}", stream.counts);
    }

    #[test]
    fn what_waits_ends_with_the_acquisition_and_all_with_control() {
        let mut stream = Stream::new();
        let mut out = Vec::new();
        stream.push(block(1));
        stream.push(block(2));
        assert!(stream.is_full());
        stream.next(Duration::ZERO, AT_ONCE, &mut out).unwrap();
        stream.end();
        assert_eq!(sent(&mut stream, Duration::ZERO, AT_ONCE).last(), Some(&(1, 4)));
        stream.push(block(3));
        stream.test(100);
        stream.clear();
        assert_eq!(stream.next(Duration::ZERO, AT_ONCE, &mut out), Err(None));
    }
}
